"""What another stroke does to features is known, and keeps a classifier from trusting what it changes."""

import numpy as np
import pytest

from texclass.experiment import load_pipeline
from texclass.experiment.kernel_discriminant import KernelDiscriminant
from texclass.experiment.vote_of_pieces import VoteOfPieces, changes_of, knowing
from texclass.features.plan import Plan
from texclass.features.sets import load_feature_set


def test_every_column_of_the_default_set_is_known_and_some_move_together() -> None:
    columns = Plan.of(load_feature_set("surfaces")).columns
    changes = changes_of(columns)
    assert changes.shape[1] == len(columns)
    assert np.isfinite(changes).all()
    moved = [c for c, size in zip(columns, np.abs(changes).max(axis=0), strict=True) if size > 0]
    assert {c.partition(".")[0] for c in moved} >= {"band_level", "vibration_level", "tap_strength"}


def test_pieces_and_channels_change_alike_and_strangers_not_at_all() -> None:
    one, same, other, unknown = changes_of(
        ["band_level.b3.piece1", "y/band_level.b3.piece4", "band_level.b4.piece1", "my_feature"]
    ).T
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()
    assert not unknown.any()


def test_neighbouring_levels_rise_and_fall_together() -> None:
    C = changes_of(["slope_level.lag1", "slope_level.lag2"])
    first, second = (C / np.linalg.norm(C, axis=0)).T
    assert first @ second > 0.8


def one_of_each() -> tuple[np.ndarray, np.ndarray]:
    """Twenty classes, a sample of each: the first two columns tell them apart, a stroke shifts the first."""
    rng = np.random.default_rng(3)
    X = rng.standard_normal((20, 2))
    return X, np.arange(20)


def test_what_is_known_to_change_misleads_less() -> None:
    X, y = one_of_each()
    later = X + np.array([0.6, 0.0])
    plain = KernelDiscriminant().fit(X, y).score(later, y)
    knowing_it = KernelDiscriminant().fit(X, y, changes=np.array([[1.0, 0.0]])).score(later, y)
    assert knowing_it > plain


def test_no_change_known_is_as_none() -> None:
    X, y = np.random.default_rng(0).standard_normal((40, 6)), np.repeat(np.arange(4), 10)
    plain = KernelDiscriminant().fit(X, y).decision_function(X)
    nothing = KernelDiscriminant().fit(X, y, changes=np.zeros((3, 6))).decision_function(X)
    np.testing.assert_allclose(nothing, plain)


def test_units_of_columns_do_not_matter() -> None:
    rng = np.random.default_rng(0)
    X, y, C = rng.standard_normal((40, 6)), np.repeat(np.arange(4), 10), rng.standard_normal((3, 6))
    unit = 10.0 ** rng.integers(-3, 4, 6)
    told = [KernelDiscriminant().fit(X * u, y, C * u).decision_function(X * u) for u in (1.0, unit)]
    np.testing.assert_allclose(*told, rtol=1e-6, atol=1e-9)


def test_changes_of_other_columns_are_refused() -> None:
    X, y = one_of_each()
    with pytest.raises(ValueError, match="changes have 3 columns; the rule is those of X, 2"):
        KernelDiscriminant().fit(X, y, changes=np.zeros((1, 3)))
    with pytest.raises(ValueError, match="3 names of columns; the rule is one a column, 2"):
        VoteOfPieces(columns=("a", "b", "c")).fit(X, y)


def test_the_default_pipeline_knows_its_columns() -> None:
    classifier = load_pipeline("surfaces").classifiers["vote"].make()
    columns = [f"band_level.b{b}.piece{p}" for b in (1, 2) for p in (1, 2, 3, 4)]
    told = knowing(classifier, columns)
    assert (told.columns, told.undivided) == (tuple(columns), ())
    assert knowing(VoteOfPieces(n_pieces=4), columns).columns == ()


def test_pieces_get_the_changes_of_their_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of columns in pieces and one of the whole, every piece has each feature once, in its order."""
    seen = []

    class Judge(KernelDiscriminant):
        def fit(self, X: np.ndarray, y: np.ndarray, changes: np.ndarray | None = None) -> "Judge":
            seen.append(changes)
            return super().fit(X, y, changes)

    columns = ["tap_strength", *(f"band_level.b{b}.piece{p}" for b in (1, 2) for p in (1, 2, 3, 4))]
    X, y = np.random.default_rng(0).standard_normal((8, 9)), np.repeat([0, 1], 4)
    vote = VoteOfPieces(Judge(), n_pieces=4, known_changes=True)
    knowing(vote, columns).fit(X, y)
    (changes,) = seen
    np.testing.assert_array_equal(changes, changes_of(["band_level.b1", "band_level.b2", "tap_strength"]))
    knowing(vote, columns[1:]).fit(X[:, 1:], y)
    np.testing.assert_array_equal(seen[-1], changes_of(columns[1:]))
