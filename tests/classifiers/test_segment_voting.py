"""Pieces of a recording vote, and know what another stroke does to their columns."""

from itertools import product

import numpy as np
import pytest
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.neighbors import KNeighborsClassifier
from sklearn.utils.estimator_checks import check_estimator

from texclass.classifiers.kernel_discriminant import KernelDiscriminant
from texclass.classifiers.segment_voting import SegmentVoting, changes_of, with_segment_columns
from texclass.evaluation import load_pipeline
from texclass.features.plan import Plan
from texclass.features.sets import load_feature_set
from texclass.recording import Samples


def recordings(n_each: int, seed: int, noise: float = 1.0, n_classes: int = 4) -> tuple[Samples, Samples]:
    """Five features of four pieces that scatter about the mean of the class, shape (n, 20)."""
    means = np.random.default_rng(0).standard_normal((n_classes, 5))
    y = np.repeat(np.arange(n_classes), n_each)
    scatter = noise * np.random.default_rng(seed).standard_normal((y.size, 5, 4))
    return (means[y][:, :, None] + scatter).reshape(y.size, -1), y


def test_it_keeps_the_rules_of_scikit_learn() -> None:
    check_estimator(SegmentVoting(), on_skip=None)


def test_one_piece_is_the_classifier_itself_and_so_is_a_recording_without_columns_of_pieces() -> None:
    X, y = recordings(10, 1)
    without = with_segment_columns(SegmentVoting(n_segments=4), [f"tap.{i}" for i in range(20)])
    alone = KernelDiscriminant().fit(X, y).decision_function(X)
    for model in (SegmentVoting(), without):
        np.testing.assert_allclose(model.fit(X, y).decision_function(X), alone, atol=1e-12)


def test_decision_is_the_mean_of_those_of_the_pieces_and_of_the_whole() -> None:
    X, y = recordings(10, 2)
    model = SegmentVoting(n_segments=4, whole_weight=0).fit(X, y)
    mean = np.mean([model.estimator_.decision_function(X[:, i::4]) for i in range(4)], axis=0)
    np.testing.assert_allclose(model.decision_function(X), mean, atol=1e-12)
    np.testing.assert_array_equal(model.predict(X), mean.argmax(axis=1))
    whole = KernelDiscriminant().fit(X, y).decision_function(X)
    both = SegmentVoting(n_segments=4, whole_weight=1.1).fit(X, y).decision_function(X)  # ten of each class
    np.testing.assert_allclose(both, (mean + whole) / 2, atol=1e-12)


def test_the_whole_is_heard_the_more_the_more_recordings_of_the_smallest_class_train() -> None:
    X, y = recordings(10, 12)
    for n, weight in ((1, 1 / 2), (3, 3 / 4), (10, 10 / 11)):
        few = np.concatenate([np.flatnonzero(y == 0)[:n], np.flatnonzero(y > 0)])
        assert SegmentVoting(n_segments=4).fit(X[few], y[few]).weight_ == pytest.approx(weight)


def test_recordings_too_short_to_be_divided_count_once() -> None:
    X, y = recordings(6, 5)
    whole = X[:, ::4]
    same = np.repeat(whole, 4, axis=1)
    both = SegmentVoting(KNeighborsClassifier(), n_segments=4).fit(np.concatenate([same, X]), [*y, *y])
    assert both.estimator_.n_samples_fit_ == len(same) + 4 * len(X)
    model, alone = SegmentVoting(n_segments=4).fit(same, y), KernelDiscriminant().fit(whole, y)
    assert model.whole_ is None
    np.testing.assert_allclose(model.decision_function(same), alone.decision_function(whole), atol=1e-12)


def test_any_classifier_may_judge_the_pieces() -> None:
    judges = (LinearDiscriminantAnalysis(), ExtraTreesClassifier(50, random_state=0))
    for estimator, n_classes in product(judges, (2, 4)):
        train, test = recordings(20, 6, 0.5, n_classes), recordings(20, 7, 0.5, n_classes)
        model = SegmentVoting(estimator, n_segments=4).fit(*train)
        assert model.score(*test) > 0.95
        np.testing.assert_allclose(model.predict_proba(test[0]).sum(axis=1), 1)


def test_columns_that_are_no_multiple_of_the_pieces_are_refused() -> None:
    X, y = recordings(5, 8)
    with pytest.raises(ValueError, match="n_segments == 0"):
        SegmentVoting(n_segments=0).fit(X, y)
    with pytest.raises(TypeError, match="does not seem to be a scikit-learn estimator"):
        SegmentVoting(3).fit(X, y)
    with pytest.raises(ValueError, match="n_segments = 4 columns of segments, got 19"):
        SegmentVoting(n_segments=4).fit(X[:, 1:], y)


def of_two_kinds(seed: int) -> tuple[Samples, Samples]:
    """Twenty columns of pieces between two of the whole recording."""
    X, y = recordings(4, seed, 0.3)
    taps = y[:, None] % 2 + 0.2 * np.random.default_rng(seed).standard_normal((y.size, 2))
    return np.column_stack([taps[:, 0], X, taps[:, 1]]), y


def test_columns_of_the_whole_stand_in_each_piece() -> None:
    X, y = of_two_kinds(9)
    pieces = np.concatenate([X[:, [*range(1 + i, 21, 4), 0, 21]] for i in range(4)])
    alone = KernelDiscriminant().fit(pieces, np.tile(y, 4)).decision_function(pieces)
    model = SegmentVoting(n_segments=4, undivided=(0, 21)).fit(X, y)
    assert model.whole_ is None
    np.testing.assert_allclose(
        model.decision_function(X), alone.reshape(4, y.size, -1).mean(axis=0), atol=1e-9
    )


def test_a_classifier_knows_the_columns_of_the_whole_by_their_names() -> None:
    names = ["x/level.segment1", "x/level.segment2", "damping", "y/level.segment1", "y/level.segment2"]
    assert with_segment_columns(SegmentVoting(n_segments=2), names).undivided == (2,)
    assert with_segment_columns(SegmentVoting(), names).undivided == ()
    told = with_segment_columns(
        load_pipeline("surfaces").classifiers["vote"].make(), names[:2]
    )  # knows what changes
    assert (told.columns, told.undivided) == (tuple(names[:2]), ())
    assert with_segment_columns(SegmentVoting(n_segments=2), names).columns == ()
    X, y = recordings(3, 11)
    with pytest.raises(ValueError, match=r"undivided must be columns 0 to 19, got \(20,\)"):
        SegmentVoting(n_segments=4, undivided=(20,)).fit(X, y)
    with pytest.raises(ValueError, match="columns must be 20 names, one a column, got 3"):
        SegmentVoting(columns=("a", "b", "c")).fit(X, y)


def test_every_column_of_the_default_set_is_known_and_some_move_together() -> None:
    columns = Plan.of(load_feature_set("surfaces")).columns
    changes = changes_of(columns)
    assert changes.shape[1] == len(columns)
    assert np.isfinite(changes).all()
    moved = [c for c, size in zip(columns, np.abs(changes).max(axis=0), strict=True) if size > 0]
    assert {c.partition(".")[0] for c in moved} >= {"band_level", "vibration_level", "tap_strength"}


def test_pieces_and_channels_change_alike_and_strangers_not_at_all() -> None:
    one, same, other, unknown = changes_of(
        ["band_level.b3.segment1", "y/band_level.b3.segment4", "band_level.b4.segment1", "my_feature"]
    ).T
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()
    assert not unknown.any()


def test_neighbouring_levels_rise_and_fall_together() -> None:
    C = changes_of(["slope_level.lag1", "slope_level.lag2"])
    first, second = (C / np.linalg.norm(C, axis=0)).T
    assert first @ second > 0.8


def test_pieces_get_the_changes_of_their_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of columns in pieces and one of the whole, every piece has each feature once, in its order."""
    seen = []

    class Judge(KernelDiscriminant):
        def fit(self, X: np.ndarray, y: np.ndarray, changes: np.ndarray | None = None) -> "Judge":
            seen.append(changes)
            return super().fit(X, y, changes)

    columns = ["tap_strength", *(f"band_level.b{b}.segment{p}" for b in (1, 2) for p in (1, 2, 3, 4))]
    X, y = np.random.default_rng(0).standard_normal((8, 9)), np.repeat([0, 1], 4)
    vote = SegmentVoting(Judge(), n_segments=4, known_changes=True)
    with_segment_columns(vote, columns).fit(X, y)
    (changes,) = seen
    np.testing.assert_array_equal(changes, changes_of(["band_level.b1", "band_level.b2", "tap_strength"]))
    with_segment_columns(vote, columns[1:]).fit(X[:, 1:], y)
    np.testing.assert_array_equal(seen[-1], changes_of(columns[1:]))
