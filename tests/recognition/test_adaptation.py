"""A model follows another sensor from a few references felt with it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from toy_surfaces import SURFACES, recording

from texclass.recognition import adapt, load_model
from texclass.recognition.adaptation import (
    LIMITS,
    _check_told_apart,
    adapted_to,
    fit_map,
    moments_map,
    rows_of,
)
from texclass.recognition.unknown import ClassMoments


def felt(name, seed, **facts):
    """Return a recording as another sensor feels it: its mount rings at 191 Hz."""
    one, ring = recording(name, seed), [1, -2 * 0.97 * np.cos(0.3), 0.97**2]
    return one.with_(acceleration=lfilter([1], ring, one.acceleration), **facts)


TESTS = [felt(surface, seed) for surface in SURFACES for seed in range(100, 115)]
THREE = [felt(surface, 50) for surface in list(SURFACES)[:3]]
UNLABELLED = [felt(surface, seed, surface=None) for surface in SURFACES for seed in range(50, 60)]


def right(model):
    return np.mean([model.answer(one).surface == one.surface for one in TESTS])


def unknown(model, recordings):
    return np.mean([model.answer(one).unknown for one in recordings])


@pytest.mark.parametrize("references", [THREE, UNLABELLED], ids=["three surfaces", "unlabelled"])
@pytest.mark.parametrize("kind", ["kernel", "linear"])
def test_what_another_sensor_cost_is_recovered_and_false_alarms_stay(kind, references, request):
    model = request.getfixturevalue(f"{kind}_model")
    adapted = adapt(model, references)
    assert right(model) < 0.6
    assert right(adapted) > 0.95
    assert unknown(model, TESTS) > 0.5
    assert unknown(adapted, TESTS) <= 2 * model.novelty.false_alarms
    strangers = [felt("stranger", seed) for seed in range(10)]
    assert unknown(adapted, strangers) > 0.8
    assert not any(r.startswith("outside") for one in TESTS[::9] for r in adapted.answer(one).reasons)


def test_the_same_sensor_changes_next_to_nothing(kernel_model):
    again = [recording(surface, seed) for surface in SURFACES for seed in (50, 51, 52)]
    adapted = adapt(kernel_model, again)
    asked = [recording(surface, 100) for surface in SURFACES]
    for one in asked:
        assert adapted.answer(one).surface == one.surface
    X = rows_of(kernel_model, asked)[0]
    moved = (adapted.steps[0]["scale"] - 1) * X + adapted.steps[0]["shift"]
    assert np.sqrt(np.mean((moved / kernel_model.class_moments.within) ** 2)) < 0.5


def test_an_adapted_model_is_saved_answers_the_same_and_tells_of_its_references(linear_model, tmp_path):
    adapted = adapt(linear_model, THREE)
    adapted.save(tmp_path / "a.skops")
    again = load_model(tmp_path / "a.skops")
    assert again.answer(TESTS[0]) == adapted.answer(TESTS[0])
    told = again.manifest.adapted
    assert told["references"] == [[one.recording_id, one.surface] for one in THREE]
    assert told["hash"] == adapt(linear_model, THREE).manifest.adapted["hash"]
    assert told["hash"] != adapt(linear_model, [*THREE[:2], felt("oak", 51)]).manifest.adapted["hash"]
    assert again.manifest.unknown["threshold"] == adapted.novelty.threshold != linear_model.novelty.threshold


def test_a_known_change_of_columns_is_found():
    rng = np.random.default_rng(0)
    means, within = 5 * rng.standard_normal((40, 30)), np.full(30, 0.5)
    shares = np.repeat([0.03, 0.02], 20)
    labels = rng.choice(40, 4000, p=shares)
    old = means[labels] + within * rng.standard_normal((4000, 30))
    scale, shift = moments_map(3 * old - 3, shares, ClassMoments(means, within), len(old))
    np.testing.assert_allclose(scale, 1 / 3, rtol=0.1)
    np.testing.assert_allclose((3 * old - 3) * scale + shift, old, atol=0.1 * np.abs(old).max())
    # Chance alone is not believed, and a column without values, or one that never varied, stays.
    few = means[:3] + within * rng.standard_normal((3, 30))
    few[:, 0] = np.nan
    still = ClassMoments(means, np.where(np.arange(30) == 1, 0.0, within))
    scale, shift = moments_map(few, np.repeat([1 / 3, 0], [3, 37]), still, 3)
    assert (scale[:2] == 1).all()
    assert (shift[:2] == 0).all()
    assert np.abs(few[:, 2:] * (scale[2:] - 1) + shift[2:]).max() < 0.5


def test_shares_of_unlabelled_references_are_estimated(kernel_model):
    """References of two surfaces are moved less than if they were of all four alike."""
    two = [recording(surface, seed, surface=None) for surface in ("cork", "slate") for seed in range(50, 60)]
    X, known, of = rows_of(kernel_model, two)
    assert not known.any()
    moments, n = kernel_model.class_moments, len(set(of))
    maps = fit_map(kernel_model, X, known, moments, n), moments_map(X, np.full(4, 0.25), moments, n)
    moved, by_equal = (
        np.sqrt(np.mean((((scale - 1) * X + shift) / moments.within) ** 2)) for scale, shift in maps
    )
    assert moved < 0.7 * by_equal


ONE_SURFACE = [felt("oak", seed, surface=None) for seed in range(50, 62)]
NOISE = [
    one.with_(acceleration=np.random.default_rng(k).standard_normal(2000))
    for k, one in enumerate(ONE_SURFACE)
]


@pytest.mark.parametrize("references", [ONE_SURFACE, NOISE], ids=["one surface", "noise"])
@pytest.mark.parametrize("kind", ["kernel", "linear"])
def test_references_of_which_nothing_can_be_told_are_refused(kind, references, request):
    with pytest.raises(ValueError, match=r"Expected at least 2.5 surfaces, or labelled"):
        adapt(request.getfixturevalue(f"{kind}_model"), references)


def test_labelled_references_that_sound_alike_are_refused(kernel_model):
    alike = [one.with_(surface=m) for one, m in zip(NOISE, SURFACES, strict=False)]
    with pytest.raises(ValueError, match=r"more than one answer for all would get .1.: check their labels"):
        adapt(kernel_model, alike)


def test_the_commonest_surface_is_no_evidence_that_references_differ():
    surfaces = np.eye(3)
    model = SimpleNamespace(judge=lambda rows: (rows,), surfaces=("cork", "felt", "foil"))
    labels = surfaces[[0, 0, 0, 0, 1, 1]]
    with pytest.raises(ValueError, match=r"4 of 6 labelled .* would get .4."):
        _check_told_apart(model, surfaces[[0] * 6], labels, 6)
    _check_told_apart(model, surfaces[[0, 0, 0, 0, 1, 0]], labels, 6)

    predicted, unlabelled = surfaces[[1, 1, 2, 0]], np.zeros((4, 3))
    _check_told_apart(model, predicted, unlabelled, 0)
    one_label = np.vstack([surfaces[0], unlabelled[1:]])
    _check_told_apart(model, predicted, one_label, 1)
    with pytest.raises(ValueError, match=r"1.6 surfaces, most of 'felt'"):
        _check_told_apart(model, surfaces[[1, 1, 1, 1]], one_label, 1)


def test_a_map_that_answers_fewer_references_right_is_not_taken(kernel_model, monkeypatch):
    monkeypatch.setattr("texclass.recognition.adaptation.moments_map", halving_map)
    again = [recording(surface, seed) for surface in SURFACES for seed in (50, 51, 52)]
    adapted = adapt(kernel_model, again)
    assert adapted.manifest.adapted["map"] == "none"
    assert [adapted.answer(one).surface for one in again] == [one.surface for one in again]


@pytest.mark.parametrize("n_touches", [1, 3])
@pytest.mark.parametrize(("n_lost", "kind"), [(4, "affine"), (5, "shift")])
def test_references_lost_by_chance_reject_no_map(kernel_model, monkeypatch, n_lost, kind, n_touches):
    """Of nine; touches of one reference are one witness."""
    n = len(kernel_model.columns)
    constant, still = (np.zeros(n), np.full(n, 1e6)), (np.ones(n), np.zeros(n))
    always = kernel_model.surfaces[kernel_model.judge(constant[1][None])[0].argmax()]
    others = [s for s in SURFACES if s != always]
    X, known, of = (
        np.repeat(one, n_touches, axis=0)
        for one in rows_of(kernel_model, [recording(s, k) for s in others for k in (50, 51, 52)])
    )
    asked = iter(range(100))

    def poor_of_some(X, *_, scaled=True):
        return constant if 1 <= next(asked) <= n_lost else still

    monkeypatch.setattr("texclass.recognition.adaptation.moments_map", poor_of_some)
    assert adapted_to(kernel_model, X, known, of, {}).manifest.adapted["map"] == kind


def halving_map(X, *_, scaled=True):
    """Return a map after which a model answers wrongly."""
    return np.full(X.shape[1], 0.5), np.full(X.shape[1], 3.0)


@pytest.mark.parametrize(
    ("references", "rule"),
    [
        (THREE[:2], "2 of 2 references are of a known surface. Expected at least 3"),
        (UNLABELLED[: LIMITS.min_unlabelled - 1], "0 of 9 references"),
        (
            [*THREE, felt("stranger", 1)],
            "surface 'stranger' is not in the model. Expected one of",
        ),
        ([one.with_(fs=8000.0) for one in THREE], "wrong rate: 8000 Hz, trained at 4000 Hz; --resample 4000"),
        ([one.with_(unit="counts") for one in THREE], "wrong unit: counts, trained with m/s"),
    ],
)
def test_references_that_cannot_serve_are_refused(kernel_model, references, rule):
    with pytest.raises(ValueError, match=rule):
        adapt(kernel_model, references)


def test_a_model_is_adapted_once_and_as_it_was_trained(kernel_model):
    with pytest.raises(ValueError, match=r"adapted already. Expected the model as it was trained"):
        adapt(adapt(kernel_model, THREE), THREE)
    single = replace(kernel_model, class_moments=kernel_model.class_moments._replace(within=np.zeros(12)))
    with pytest.raises(ValueError, match="Expected two or more"):
        adapt(single, THREE)
