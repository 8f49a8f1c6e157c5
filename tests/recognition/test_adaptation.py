"""Domain adaptation to another sensor from a few reference recordings."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from toy_surfaces import SURFACES, recording

from texclass.recognition import adapt, load_model
from texclass.recognition.adaptation import (
    LIMITS,
    _check_separation,
    adapt_to_rows,
    class_moments_of,
    describe_map,
    fit_map,
    moments_map,
    recalibrate_sets,
    reference_rows,
)
from texclass.recognition.model_document import describe_adaptation, describe_shift
from texclass.recognition.novelty import ClassMoments
from texclass.recognition.prediction_sets import log_odds


def other_sensor(name, seed, **changes):
    """Return a recording of another sensor, whose mount resonates at 191 Hz."""
    original, resonance = recording(name, seed), [1, -2 * 0.97 * np.cos(0.3), 0.97**2]
    return original.with_(acceleration=lfilter([1], resonance, original.acceleration), **changes)


TESTS = [other_sensor(surface, seed) for surface in SURFACES for seed in range(100, 115)]
THREE = [other_sensor(surface, 50) for surface in list(SURFACES)[:3]]
UNLABELLED = [other_sensor(surface, seed, surface=None) for surface in SURFACES for seed in range(50, 60)]


def accuracy(model):
    return np.mean([model.answer(one).surface == one.surface for one in TESTS])


def share_unknown(model, recordings):
    return np.mean([model.answer(one).unknown for one in recordings])


@pytest.mark.parametrize("references", [THREE, UNLABELLED], ids=["three surfaces", "unlabelled"])
@pytest.mark.parametrize("kind", ["kernel", "linear"])
def test_adaptation_restores_the_accuracy_and_the_rate_of_false_alarms(kind, references, request):
    model = request.getfixturevalue(f"{kind}_model")
    adapted = adapt(model, references)
    assert accuracy(model) < 0.6
    assert accuracy(adapted) > 0.95
    assert share_unknown(model, TESTS) > 0.5
    assert share_unknown(adapted, TESTS) <= 2 * model.novelty.false_alarms
    strangers = [other_sensor("stranger", seed) for seed in range(10)]
    assert share_unknown(adapted, strangers) > 0.8
    assert not any(r.startswith("outside") for one in TESTS[::9] for r in adapted.answer(one).reasons)


def test_references_of_the_same_sensor_hardly_change_the_features(kernel_model):
    references = [recording(surface, seed) for surface in SURFACES for seed in (50, 51, 52)]
    adapted = adapt(kernel_model, references)
    tests = [recording(surface, 100) for surface in SURFACES]
    for one in tests:
        assert adapted.answer(one).surface == one.surface
    X = reference_rows(kernel_model, tests)[0]
    change = (adapted.steps[0]["scale"] - 1) * X + adapted.steps[0]["shift"]
    assert np.sqrt(np.mean((change / kernel_model.class_moments.within_std) ** 2)) < 0.5


def test_an_adapted_model_is_saved_with_its_references(linear_model, tmp_path):
    adapted = adapt(linear_model, THREE)
    adapted.save(tmp_path / "a.skops")
    loaded = load_model(tmp_path / "a.skops")
    assert loaded.answer(TESTS[0]) == adapted.answer(TESTS[0])
    entry = loaded.manifest.adapted
    assert entry["references"] == [[one.recording_id, one.surface] for one in THREE]
    assert entry["hash"] == adapt(linear_model, THREE).manifest.adapted["hash"]
    assert (
        entry["hash"] != adapt(linear_model, [*THREE[:2], other_sensor("oak", 51)]).manifest.adapted["hash"]
    )
    assert loaded.manifest.unknown["threshold"] == adapted.novelty.threshold != linear_model.novelty.threshold


def test_a_known_scale_and_shift_of_columns_is_estimated():
    rng = np.random.default_rng(0)
    means, within_std = 5 * rng.standard_normal((40, 30)), np.full(30, 0.5)
    shares = np.repeat([0.03, 0.02], 20)
    labels = rng.choice(40, 4000, p=shares)
    X = means[labels] + within_std * rng.standard_normal((4000, 30))
    scale, shift = moments_map(3 * X - 3, shares, ClassMoments(means, within_std), len(X))
    np.testing.assert_allclose(scale, 1 / 3, rtol=0.1)
    np.testing.assert_allclose((3 * X - 3) * scale + shift, X, atol=0.1 * np.abs(X).max())
    # Differences by chance, columns without values and constant columns do not change the map.
    three = means[:3] + within_std * rng.standard_normal((3, 30))
    three[:, 0] = np.nan
    constant = ClassMoments(means, np.where(np.arange(30) == 1, 0.0, within_std))
    scale, shift = moments_map(three, np.repeat([1 / 3, 0], [3, 37]), constant, 3)
    assert (scale[:2] == 1).all()
    assert (shift[:2] == 0).all()
    assert np.abs(three[:, 2:] * (scale[2:] - 1) + shift[2:]).max() < 0.5


def test_shares_of_unlabelled_references_are_estimated(kernel_model):
    """References of two surfaces are moved less than with equal shares of all four."""
    two = [recording(surface, seed, surface=None) for surface in ("cork", "slate") for seed in range(50, 60)]
    X, one_hot, recording_index = reference_rows(kernel_model, two)
    assert not one_hot.any()
    moments, n = kernel_model.class_moments, len(set(recording_index))
    maps = fit_map(kernel_model, X, one_hot, moments, n), moments_map(X, np.full(4, 0.25), moments, n)
    change, change_with_equal_shares = (
        np.sqrt(np.mean((((scale - 1) * X + shift) / moments.within_std) ** 2)) for scale, shift in maps
    )
    assert change < 0.7 * change_with_equal_shares


ONE_SURFACE = [other_sensor("oak", seed, surface=None) for seed in range(50, 62)]
NOISE = [
    one.with_(acceleration=np.random.default_rng(k).standard_normal(2000))
    for k, one in enumerate(ONE_SURFACE)
]


@pytest.mark.parametrize("references", [ONE_SURFACE, NOISE], ids=["one surface", "noise"])
@pytest.mark.parametrize("kind", ["kernel", "linear"])
def test_unlabelled_references_of_one_surface_or_noise_are_refused(kind, references, request):
    with pytest.raises(ValueError, match=r"Expected at least 2.5 surfaces, or labelled"):
        adapt(request.getfixturevalue(f"{kind}_model"), references)


def test_labelled_references_with_equal_features_are_refused(kernel_model):
    alike = [one.with_(surface=m) for one, m in zip(NOISE, SURFACES, strict=False)]
    with pytest.raises(
        ValueError,
        match=r"most frequent surface .1.\. Check the labels",
    ):
        adapt(kernel_model, alike)


def test_hits_on_the_most_frequent_surface_alone_do_not_show_a_separation():
    surfaces = np.eye(3)
    model = SimpleNamespace(classify=lambda rows: (rows,), surfaces=("cork", "felt", "foil"))
    labels = surfaces[[0, 0, 0, 0, 1, 1]]
    with pytest.raises(ValueError, match=r"4 of 6 labelled .* most frequent surface .4."):
        _check_separation(model, surfaces[[0] * 6], labels, 6)
    _check_separation(model, surfaces[[0, 0, 0, 0, 1, 0]], labels, 6)

    predicted, unlabelled = surfaces[[1, 1, 2, 0]], np.zeros((4, 3))
    _check_separation(model, predicted, unlabelled, 0)
    one_label = np.vstack([surfaces[0], unlabelled[1:]])
    _check_separation(model, predicted, one_label, 1)
    with pytest.raises(ValueError, match=r"1.6 .mostly 'felt'"):
        _check_separation(model, surfaces[[1, 1, 1, 1]], one_label, 1)


def test_a_map_with_fewer_hits_on_the_references_is_rejected(kernel_model, monkeypatch):
    monkeypatch.setattr("texclass.recognition.adaptation.moments_map", halving_map)
    references = [recording(surface, seed) for surface in SURFACES for seed in (50, 51, 52)]
    adapted = adapt(kernel_model, references)
    assert adapted.manifest.adapted["map"] == "none"
    assert [adapted.answer(one).surface for one in references] == [one.surface for one in references]


@pytest.mark.parametrize("n_windows", [1, 3])
@pytest.mark.parametrize(("n_losses", "kind"), [(4, "affine"), (5, "shift")])
def test_losses_by_chance_do_not_reject_a_map(kernel_model, monkeypatch, n_losses, kind, n_windows):
    """Four of nine references may lose; windows of one reference count once."""
    n = len(kernel_model.columns)
    constant, identity = (np.zeros(n), np.full(n, 1e6)), (np.ones(n), np.zeros(n))
    constant_surface = kernel_model.surfaces[kernel_model.classify(constant[1][None])[0].argmax()]
    others = [s for s in SURFACES if s != constant_surface]
    X, one_hot, recording_index = (
        np.repeat(array, n_windows, axis=0)
        for array in reference_rows(kernel_model, [recording(s, k) for s in others for k in (50, 51, 52)])
    )
    calls = iter(range(100))

    def constant_in_some_folds(X, *_, with_scale=True):
        return constant if 1 <= next(calls) <= n_losses else identity

    monkeypatch.setattr("texclass.recognition.adaptation.moments_map", constant_in_some_folds)
    assert adapt_to_rows(kernel_model, X, one_hot, recording_index, {}).manifest.adapted["map"] == kind


def halving_map(X, *_, with_scale=True):
    """Return a map after which predictions are wrong."""
    return np.full(X.shape[1], 0.5), np.full(X.shape[1], 3.0)


@pytest.mark.parametrize(
    ("references", "message"),
    [
        (THREE[:2], "2 of 2 are labelled. Expected at least 3 labelled references"),
        (UNLABELLED[: LIMITS.min_unlabelled - 1], "0 of 9 are labelled"),
        (
            [*THREE, other_sensor("stranger", 1)],
            "surface 'stranger' is not in the model. Expected one of",
        ),
        ([one.with_(fs=8000.0) for one in THREE], "wrong rate: 8000 Hz, trained at 4000 Hz; --resample 4000"),
        ([one.with_(unit="counts") for one in THREE], "wrong unit: counts, trained with m/s"),
    ],
)
def test_unsuitable_references_are_refused(kernel_model, references, message):
    with pytest.raises(ValueError, match=message):
        adapt(kernel_model, references)


def test_an_adapted_model_is_not_adapted_again(kernel_model):
    with pytest.raises(ValueError, match=r"is already adapted. Adapt the original model instead"):
        adapt(adapt(kernel_model, THREE), THREE)


@pytest.mark.parametrize("references", [THREE, UNLABELLED], ids=["three surfaces", "unlabelled"])
def test_a_model_of_one_recording_per_surface_is_adapted(kernel_model, references):
    """The variation within a surface is then from other datasets, and the model card says so."""
    moments = kernel_model.class_moments
    first = np.array([kernel_model.compute(recording(surface, 0)).values for surface in sorted(SURFACES)])
    single = replace(kernel_model, class_moments=ClassMoments(first, np.zeros_like(moments.within_std)))
    prior = class_moments_of(single)
    total = np.sqrt(prior.means.var(axis=0, ddof=1) + prior.within_std**2)
    np.testing.assert_allclose(total, first.std(axis=0, ddof=1))
    adapted = adapt(single, references)
    assert accuracy(single) < 0.6
    assert accuracy(adapted) > 0.9
    assert "the variation within a surface is from other datasets" in describe_adaptation(adapted.manifest)
    assert "other datasets" not in describe_adaptation(adapt(kernel_model, references).manifest)


def test_the_description_states_the_shift_of_the_columns(kernel_model):
    """The columns that `moved` shifts by three standard deviations are counted, with their shift."""
    moments = kernel_model.class_moments
    rng, n = np.random.default_rng(1), len(kernel_model.columns)
    labels = np.arange(400) % len(SURFACES)
    X = moments.means[labels] + moments.within_std * rng.standard_normal((400, n))
    moved = np.where(np.arange(n) < 5, 3.0, 0.0) * moments.within_std
    moved[2] *= 1.1
    entry = describe_map(kernel_model.columns, X + moved, (np.ones(n), -moved), moments)
    assert (entry["n_shifted"], entry["most_shifted"]) == (5, kernel_model.columns[2])
    np.testing.assert_allclose(entry["shift"], [3, 3.18, 3.3])
    text = "5 columns shifted by 3 standard deviations within a surface (median; largest 3.3: "
    assert describe_shift(entry).startswith(text)
    assert "scaled" not in describe_shift(entry)
    unchanged = describe_map(kernel_model.columns, X, (np.ones(n), np.zeros(n)), moments)
    assert describe_shift(unchanged) == "no column shifted"


def test_unknown_surfaces_among_unlabelled_references_are_still_detected(kernel_model):
    """A fifth of the references are of an unknown surface; the threshold is not raised to its scores."""
    strangers = [other_sensor("stranger", seed, surface=None) for seed in range(50, 60)]
    adapted = adapt(kernel_model, [*UNLABELLED, *strangers])
    assert share_unknown(adapted, TESTS) <= 2 * kernel_model.novelty.false_alarms
    assert share_unknown(adapted, [other_sensor("stranger", seed) for seed in range(10)]) > 0.8


def coverage(model, level):
    sets = [model.answer(one).prediction_sets[level] for one in TESTS]
    return np.mean([one.surface in members for one, members in zip(TESTS, sets, strict=True)])


@pytest.mark.parametrize("references", [THREE, UNLABELLED], ids=["three surfaces", "unlabelled"])
def test_prediction_sets_keep_their_coverage_after_an_adaptation(linear_model, references):
    adapted = adapt(linear_model, references)
    for level in (0.9, 0.95):
        assert coverage(linear_model, level) < 0.8
        assert coverage(adapted, level) >= level - 0.03
    entry = adapted.manifest.calibration["prediction_sets"]
    assert entry["thresholds"] != linear_model.manifest.calibration["prediction_sets"]["thresholds"]


def test_sets_are_recalibrated_by_labels_or_by_the_median(linear_model):
    """Without labels, the held-out log odds fall with those of the references; labels are added to them."""
    references = [recording(surface, seed) for surface in SURFACES for seed in range(9)]
    X, one_hot, index = reference_rows(linear_model, references)
    decisions = 0.25 * linear_model.decide(X)[1]
    old = linear_model.set_calibrations["answer"]
    moved = recalibrate_sets(linear_model, decisions, 0 * one_hot, index, has_labels=False)["answer"]
    true = log_odds(linear_model.calibration.beta * decisions)[one_hot.astype(bool)]
    assert moved.median == pytest.approx(np.sort(true)[(len(true) - 1) // 2], abs=1e-9)
    np.testing.assert_allclose(np.diff(moved.log_odds), np.diff(old.log_odds), atol=1e-9)
    added = recalibrate_sets(linear_model, decisions, one_hot, index, has_labels=True)["answer"]
    assert set(true) <= set(added.log_odds.tolist())
    assert len(added.log_odds) == len(old.log_odds) + len(true)
    better = recalibrate_sets(linear_model, 40 * decisions, 0 * one_hot, index, has_labels=False)
    np.testing.assert_array_equal(better["answer"].log_odds, old.log_odds)
