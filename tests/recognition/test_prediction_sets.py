"""Prediction sets: coverage over recordings rather than windows, and recalibration under drift."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from toy_surfaces import SURFACES, pipeline, recording, signal, surfaces

from texclass.recognition import Answer, Evidence, OnlineRecogniser, OnlineSettings, load_model, train
from texclass.recognition.adaptation import with_references
from texclass.recognition.model_document import answers_document, model_document
from texclass.recognition.prediction_sets import (
    ConformalCalibration,
    describe_sets,
    log_odds,
    n_later_repetitions,
    recency_weights,
)

NAMES = tuple(SURFACES)


def calibration_of(log_odds, recordings=None, **weights):
    recordings = np.arange(len(log_odds)) if recordings is None else recordings
    return ConformalCalibration.from_answers(log_odds, recordings, **weights)


@pytest.fixture(scope="module")
def short_window_model():
    return train(surfaces(), pipeline(), row="Spectrum", classifier="lda", window_s=0.1)


def test_log_odds_are_those_of_the_softmax_also_if_it_rounds_to_one():
    scores = np.random.default_rng(0).normal(size=(30, 4))
    p = np.exp(scores) / np.exp(scores).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(log_odds(scores), np.log(p / (1 - p)), rtol=1e-12)
    np.testing.assert_allclose(log_odds(np.array([[80.0, 0.0], [90.0, 0.0]])), [[80, -80], [90, -90]])
    assert np.isfinite(log_odds(np.array([[3.0, -np.inf, 1.0], [-np.inf, -np.inf, 0.0]]))).all()


@pytest.mark.parametrize("level", [0.9, 0.95])
def test_the_coverage_of_exchangeable_recordings_is_the_level(level):
    """With n held out, the expected share is ceil((n + 1) level) / (n + 1), for any distribution."""
    n, rng = 20, np.random.default_rng(1)
    log_odds = rng.standard_cauchy((4000, n + 1))
    share = np.mean([new >= calibration_of(held_out).threshold(level) for *held_out, new in log_odds])
    expected = np.ceil((n + 1) * level) / (n + 1)
    assert share == pytest.approx(expected, abs=3 * np.sqrt(expected * (1 - expected) / len(log_odds)))
    assert share >= level - 0.005


def test_all_windows_of_a_recording_share_its_weight():
    """Easy recordings have 20 good windows, hard ones a single bad window."""
    rng, by_recording, by_window = np.random.default_rng(2), [], []
    for _ in range(500):
        is_hard = rng.random(51) < 0.3
        odds = [rng.normal(0 if hard else 3, 1, 1 if hard else 20) for hard in is_hard]
        recordings = np.repeat(np.arange(50), [len(one) for one in odds[:50]])
        held_out = np.concatenate(odds[:50])
        by_recording.append(np.mean(odds[50] >= calibration_of(held_out, recordings).threshold(0.9)))
        by_window.append(np.mean(odds[50] >= calibration_of(held_out).threshold(0.9)))
    assert 0.87 < np.mean(by_recording) < 0.95
    assert np.mean(by_window) < 0.85


def test_too_few_recordings_give_sets_of_all_surfaces_and_a_warning():
    few = calibration_of(np.linspace(0, 0.5, 18))
    assert few.predict_sets(np.arange(4.0), NAMES) == {0.9: ("slate",), 0.95: NAMES[::-1]}
    assert few.warning((0.9, 0.95)) == (
        "prediction sets at 95 % contain all surfaces: they need at least 19 held-out recordings, got 18"
    )
    assert calibration_of(np.linspace(1, 2, 19)).warning((0.9, 0.95)) == ""
    assert calibration_of([]).threshold(0.5) == -np.inf


def test_sets_of_higher_levels_contain_those_of_lower_levels():
    odds = np.sort(np.random.default_rng(3).normal(0, 2, 400))
    sets = calibration_of(odds).predict_sets(np.array([2.0, 1.5, 0.0, -1.0]), NAMES, (0.5, 0.7, 0.95, 0.999))
    members = list(sets.values())
    assert all(set(a) <= set(b) for a, b in pairwise(members))


def test_no_set_is_empty_even_if_the_model_is_correct_more_often_than_required():
    always_correct = calibration_of(np.linspace(5, 9, 40))
    assert always_correct.threshold(0.9) > 5
    uncertain = np.array([0.1, 0.0, 0.0, 0.0])
    assert always_correct.predict_sets(uncertain, NAMES, (0.5, 0.9)) == {0.5: NAMES[:1], 0.9: NAMES[:1]}


def test_sets_are_described_in_words():
    assert describe_sets({0.9: ("oak",), 0.95: ("oak", "felt"), 0.99: NAMES}, 4) == {
        "90 %": "oak", "95 %": "oak or felt", "99 %": "any"
    }  # fmt: skip
    assert describe_sets({0.9: tuple("abcde")}, 9) == {"90 %": "a or b or c or 2 more"}


def test_under_drift_recency_weights_keep_more_coverage_than_equal_weights():
    """Log odds of the true surface decrease with every recording, by 2 % of their standard deviation."""
    rng, ages = np.random.default_rng(4), np.arange(200)[::-1]
    log_odds = rng.normal(size=(400, 201)) - 0.02 * np.arange(201)
    share = {
        half_life: np.mean(
            [
                new >= calibration_of(old, weights=recency_weights(ages, half_life)).threshold(0.9)
                for *old, new in log_odds
            ]
        )
        for half_life in (20.0, 1e9)
    }
    assert share[1e9] < 0.6
    assert share[20.0] > 0.8


def test_later_repetitions_of_the_same_surface_are_counted_once():
    surfaces, repetitions = np.array(list("aaabbb")), np.array([1, 3, 3, 2, 7, 9])
    assert n_later_repetitions(surfaces, repetitions).tolist() == [1, 0, 0, 2, 1, 0]


def test_a_trained_model_predicts_sets_of_any_level_also_when_loaded(linear_model, tmp_path):
    answer = linear_model.predict(recording("oak", 77))
    assert answer.prediction_sets[0.95][0] == "oak"
    assert answer.to_dict()["prediction_sets"] == {
        str(level): list(members) for level, members in answer.prediction_sets.items()
    }
    linear_model.save(tmp_path / "m.skops")
    loaded = load_model(tmp_path / "m.skops")
    assert loaded.predict(recording("oak", 77)).prediction_sets == answer.prediction_sets
    assert loaded.predict_set(recording("oak", 77), 0.95) == answer.prediction_sets[0.95]
    assert sorted(loaded.predict_set(recording("oak", 77), 0.999)) == sorted(SURFACES)
    with pytest.raises(ValueError, match=r"level must be between 0 and 1, got 95"):
        loaded.predict_set(recording("oak", 77), 95)


def test_a_recording_that_cannot_be_classified_has_no_sets(linear_model):
    assert linear_model.predict(recording("oak", 77, fs=8000.0)).prediction_sets == {}


def test_the_sets_of_held_out_recordings_have_the_coverage_of_the_level(linear_model):
    calibration = linear_model.set_calibrations["answer"]
    assert calibration.effective_n == 40
    for level in (0.8, 0.9, 0.95):
        assert np.mean(calibration.log_odds >= calibration.threshold(level)) == np.ceil(41 * level) / 40


def test_documents_contain_the_sets_and_their_calibration(linear_model):
    (table, _) = answers_document([("a", linear_model.predict(recording("oak", 77)))]).blocks
    assert table.frame["95 % set"][0].startswith("oak")
    assert (
        "coverage 90 and 95 %, from 40 held-out recordings"
        in model_document(linear_model).blocks[0]["Prediction sets"]
    )
    uncalibrated = replace(linear_model, set_calibrations={})
    document = answers_document([("a", uncalibrated.predict(recording("oak", 77)))])
    assert "95 % set" not in document.blocks[0].frame


@pytest.mark.usefixtures("_own_cache")
def test_a_model_of_windows_has_sets_of_recordings_and_of_contacts(short_window_model):
    assert [*short_window_model.set_calibrations] == [
        "answer",
        "recording",
        "contact 1",
        "contact 2",
        "contact 4",
    ]
    assert short_window_model.set_calibrations["recording"].effective_n == 40
    correlation = short_window_model.manifest.calibration["correlation"]
    assert short_window_model.set_calibrations["answer"].effective_n == pytest.approx(
        40 * 5 / (1 + 4 * correlation)
    )
    stroke = recording("felt", 78)
    p = [
        list(short_window_model.answer(one).probabilities.values()) for one in short_window_model.cut(stroke)
    ]
    assert short_window_model.predict(stroke).prediction_sets == short_window_model.prediction_sets(
        "recording", np.log(p).mean(axis=0)
    )
    live = OnlineRecogniser(short_window_model)
    verdicts = [u.verdict for u in live.push(signal(SURFACES["felt"], 5)) if hasattr(u, "verdict")]
    assert all(set(v.prediction_sets) == {0.9, 0.95} for v in verdicts)
    assert verdicts[-1].prediction_sets[0.95] == ("felt",)
    other = OnlineRecogniser(short_window_model, settings=OnlineSettings(window_s=0.2))
    updates = other.push(signal(SURFACES["felt"], 5))
    assert {len(u.verdict.prediction_sets) for u in updates if hasattr(u, "verdict")} == {0}


def test_a_verdict_uses_the_calibration_of_contacts_of_the_same_length():
    calibrations = {1: calibration_of(np.full(40, -5.0)), 4: calibration_of(np.full(40, 5.0))}
    p = dict(zip(NAMES, (0.4, 0.3, 0.2, 0.1), strict=True))
    answer = Answer("w", NAMES[0], 0.4, NAMES[1], unknown=False, p_known=0.5, probabilities=p)
    evidence = Evidence(NAMES, correlation=1.0, set_calibrations=calibrations, levels=(0.9,))
    sets = [evidence.add(answer, float(i)).prediction_sets[0.9] for i in range(5)]
    assert sets == [NAMES] * 3 + [NAMES[:1]] * 2


@pytest.mark.usefixtures("_own_cache")
def test_recent_references_recalibrate_the_sets(linear_model):
    later = surfaces(14)
    recent = replace(later, entries=tuple(e for e in later.entries if e.repetition > 10))
    updated = with_references(linear_model, recent)
    assert updated.set_calibrations["answer"].effective_n == pytest.approx(
        40 / 2**0.8 + 4 * (recency_weights(range(4), 5.0)).sum()
    )
    assert updated.manifest.calibration["prediction_sets"]["references"] == recent.input_hash
    assert (
        updated.predict(recording("oak", 99)).probability
        == linear_model.predict(recording("oak", 99)).probability
    )
    drifted = replace(recent, load=lambda entry: recording("cork", entry.repetition, surface=entry.surface))
    assert with_references(linear_model, drifted).set_calibrations["answer"].threshold(0.9) < -5
    assert linear_model.set_calibrations["answer"].threshold(0.9) > 0
    unknown = replace(recent, entries=tuple(replace(e, surface="tin") for e in recent.entries))
    with pytest.raises(ValueError, match=r"surface 'tin' is not in the model. Expected one of cork"):
        with_references(linear_model, unknown)


@pytest.mark.parametrize("level", [-0.1, 0, 1, 95])
def test_a_level_outside_0_and_1_is_refused(short_window_model, level):
    with pytest.raises(ValueError, match=rf"level must be between 0 and 1, got {level}"):
        short_window_model.predict_set(recording("oak", 77), level)


def test_the_worst_case_of_two_hold_outs_covers_recordings_of_both():
    rng = np.random.default_rng(0)
    distributions = ((4.0, 1.0), (3.0, 3.0))  # the second one has the lower tail
    early, late = (
        ConformalCalibration.from_answers(rng.normal(mean, std, n), np.arange(n))
        for (mean, std), n in zip(distributions, (400, 200), strict=True)
    )
    for calibration in (early.worst_case(late), late.worst_case(early)):
        for level in (0.9, 0.95):
            for mean, std in distributions:
                assert np.mean(rng.normal(mean, std, 4000) >= calibration.threshold(level)) >= level - 0.03
            assert calibration.threshold(level) <= early.threshold(level) - 1
