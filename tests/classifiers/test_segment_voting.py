"""Segment voting, and the known variations between strokes."""

from itertools import product

import numpy as np
import pytest
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.neighbors import KNeighborsClassifier
from sklearn.utils.estimator_checks import check_estimator

from texclass.classifiers.kernel_discriminant import KernelDiscriminant
from texclass.classifiers.segment_voting import SegmentVoting, stroke_variations, with_segment_columns
from texclass.evaluation import load_pipeline
from texclass.features.plan import Plan
from texclass.features.sets import load_feature_set
from texclass.recording import Samples


def recordings(n_each: int, seed: int, noise: float = 1.0, n_classes: int = 4) -> tuple[Samples, Samples]:
    """Return five features of four segments that scatter about the class mean, shape (n, 20)."""
    means = np.random.default_rng(0).standard_normal((n_classes, 5))
    y = np.repeat(np.arange(n_classes), n_each)
    scatter = noise * np.random.default_rng(seed).standard_normal((y.size, 5, 4))
    return (means[y][:, :, None] + scatter).reshape(y.size, -1), y


def test_it_passes_the_estimator_checks_of_scikit_learn() -> None:
    check_estimator(SegmentVoting(), on_skip=None)


def test_one_segment_or_no_segment_columns_give_the_plain_classifier() -> None:
    X, y = recordings(10, 1)
    without_segments = with_segment_columns(SegmentVoting(n_segments=4), [f"tap.{i}" for i in range(20)])
    plain = KernelDiscriminant().fit(X, y).decision_function(X)
    for model in (SegmentVoting(), without_segments):
        np.testing.assert_allclose(model.fit(X, y).decision_function(X), plain, atol=1e-12)


def test_decisions_are_averaged_over_segments_and_the_whole_recording() -> None:
    X, y = recordings(10, 2)
    model = SegmentVoting(n_segments=4, whole_weight=0).fit(X, y)
    mean = np.mean([model.segment_classifier_.decision_function(X[:, i::4]) for i in range(4)], axis=0)
    np.testing.assert_allclose(model.decision_function(X), mean, atol=1e-12)
    np.testing.assert_array_equal(model.predict(X), mean.argmax(axis=1))
    whole = KernelDiscriminant().fit(X, y).decision_function(X)
    both = SegmentVoting(n_segments=4, whole_weight=1.1).fit(X, y).decision_function(X)
    np.testing.assert_allclose(both, (mean + whole) / 2, atol=1e-12)


def test_the_weight_of_the_whole_grows_with_the_recordings_of_the_smallest_class() -> None:
    X, y = recordings(10, 12)
    for n, weight in ((1, 1 / 2), (3, 3 / 4), (10, 10 / 11)):
        rows = np.concatenate([np.flatnonzero(y == 0)[:n], np.flatnonzero(y > 0)])
        assert SegmentVoting(n_segments=4).fit(X[rows], y[rows]).whole_weight_ == pytest.approx(weight)


def test_recordings_too_short_to_be_divided_count_once() -> None:
    X, y = recordings(6, 5)
    whole = X[:, ::4]
    same = np.repeat(whole, 4, axis=1)
    both = SegmentVoting(KNeighborsClassifier(), n_segments=4).fit(np.concatenate([same, X]), [*y, *y])
    assert both.segment_classifier_.n_samples_fit_ == len(same) + 4 * len(X)
    model, plain = SegmentVoting(n_segments=4).fit(same, y), KernelDiscriminant().fit(whole, y)
    assert model.whole_classifier_ is None
    np.testing.assert_allclose(model.decision_function(same), plain.decision_function(whole), atol=1e-12)


def test_any_classifier_can_classify_segments() -> None:
    estimators = (LinearDiscriminantAnalysis(), ExtraTreesClassifier(50, random_state=0))
    for estimator, n_classes in product(estimators, (2, 4)):
        train, test = recordings(20, 6, 0.5, n_classes), recordings(20, 7, 0.5, n_classes)
        model = SegmentVoting(estimator, n_segments=4).fit(*train)
        assert model.score(*test) > 0.95
        np.testing.assert_allclose(model.predict_proba(test[0]).sum(axis=1), 1)


def test_a_number_of_columns_that_is_not_a_multiple_of_the_segments_is_refused() -> None:
    X, y = recordings(5, 8)
    with pytest.raises(ValueError, match="n_segments == 0"):
        SegmentVoting(n_segments=0).fit(X, y)
    with pytest.raises(TypeError, match="does not seem to be a scikit-learn estimator"):
        SegmentVoting(3).fit(X, y)
    with pytest.raises(ValueError, match="n_segments = 4 segment columns, got 19"):
        SegmentVoting(n_segments=4).fit(X[:, 1:], y)


def recordings_with_taps(seed: int) -> tuple[Samples, Samples]:
    """Return twenty segment columns between two columns of the whole recording."""
    X, y = recordings(4, seed, 0.3)
    taps = y[:, None] % 2 + 0.2 * np.random.default_rng(seed).standard_normal((y.size, 2))
    return np.column_stack([taps[:, 0], X, taps[:, 1]]), y


def test_recording_columns_are_repeated_in_every_segment() -> None:
    X, y = recordings_with_taps(9)
    segments = np.concatenate([X[:, [*range(1 + i, 21, 4), 0, 21]] for i in range(4)])
    plain = KernelDiscriminant().fit(segments, np.tile(y, 4)).decision_function(segments)
    model = SegmentVoting(n_segments=4, recording_columns=(0, 21)).fit(X, y)
    assert model.whole_classifier_ is None
    np.testing.assert_allclose(
        model.decision_function(X), plain.reshape(4, y.size, -1).mean(axis=0), atol=1e-9
    )


def test_recording_columns_are_found_by_their_names() -> None:
    names = ["x/level.segment1", "x/level.segment2", "damping", "y/level.segment1", "y/level.segment2"]
    assert with_segment_columns(SegmentVoting(n_segments=2), names).recording_columns == (2,)
    assert with_segment_columns(SegmentVoting(), names).recording_columns == ()
    shipped = load_pipeline("surfaces").classifiers["vote"].make()  # it uses variations
    configured = with_segment_columns(shipped, names[:2])
    assert (configured.column_names, configured.recording_columns) == (tuple(names[:2]), ())
    assert with_segment_columns(SegmentVoting(n_segments=2), names).column_names == ()
    X, y = recordings(3, 11)
    with pytest.raises(ValueError, match=r"recording_columns must be in 0 \.\.\. 19, got \(20,\)"):
        SegmentVoting(n_segments=4, recording_columns=(20,)).fit(X, y)
    with pytest.raises(ValueError, match="column_names must contain 20 names, one per column, got 3"):
        SegmentVoting(column_names=("a", "b", "c")).fit(X, y)


def test_the_default_set_has_variations_of_the_most_important_features() -> None:
    columns = Plan.of(load_feature_set("surfaces")).columns
    variations = stroke_variations(columns)
    assert variations.shape[1] == len(columns)
    assert np.isfinite(variations).all()
    varying = [c for c, size in zip(columns, np.abs(variations).max(axis=0), strict=True) if size > 0]
    assert {c.partition(".")[0] for c in varying} >= {"band_level", "vibration_level", "tap_strength"}


def test_segments_and_channels_vary_alike_and_unknown_columns_do_not_vary() -> None:
    one, same, other, unknown = stroke_variations(
        ["band_level.b3.segment1", "y/band_level.b3.segment4", "band_level.b4.segment1", "my_feature"]
    ).T
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()
    assert not unknown.any()


def test_neighbouring_levels_vary_together() -> None:
    C = stroke_variations(["slope_level.lag1", "slope_level.lag2"])
    first, second = (C / np.linalg.norm(C, axis=0)).T
    assert first @ second > 0.8


def test_segments_get_the_variations_of_their_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every segment has each feature once: segment features first, then recording features."""
    calls = []

    class Recorder(KernelDiscriminant):
        def fit(self, X: np.ndarray, y: np.ndarray, variations: np.ndarray | None = None) -> "Recorder":
            calls.append(variations)
            return super().fit(X, y, variations)

    columns = ["tap_strength", *(f"band_level.b{b}.segment{p}" for b in (1, 2) for p in (1, 2, 3, 4))]
    X, y = np.random.default_rng(0).standard_normal((8, 9)), np.repeat([0, 1], 4)
    vote = SegmentVoting(Recorder(), n_segments=4, use_variations=True)
    with_segment_columns(vote, columns).fit(X, y)
    (variations,) = calls
    expected = stroke_variations(["band_level.b1", "band_level.b2", "tap_strength"])
    np.testing.assert_array_equal(variations, expected)
    with_segment_columns(vote, columns[1:]).fit(X[:, 1:], y)
    np.testing.assert_array_equal(calls[-1], stroke_variations(columns[1:]))
