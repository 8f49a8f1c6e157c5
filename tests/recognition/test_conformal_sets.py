"""Sets hold as often as they say, of contacts and not of windows, and follow references under drift."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from toy_surfaces import SURFACES, pipeline, recording, signal, surfaces

from texclass.recognition import Evidence, OnlineRecogniser, OnlineSettings, load_model, train
from texclass.recognition.adaptation import with_references
from texclass.recognition.conformal import Conformity, log_odds, n_later, recency, told
from texclass.recognition.model_document import answers_document, model_document

NAMES = tuple(SURFACES)


def conformity(odds, contacts=None, **counts):
    odds = np.asarray(odds, dtype=float)
    return Conformity.of(odds, np.arange(len(odds)) if contacts is None else contacts, **counts)


@pytest.fixture(scope="module")
def touched():
    return train(surfaces(), pipeline(), row="Spectrum", classifier="lda", window_s=0.1)


def test_log_odds_are_those_of_the_softmax_and_tell_apart_what_rounds_to_one():
    scores = np.random.default_rng(0).normal(size=(30, 4))
    p = np.exp(scores) / np.exp(scores).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(log_odds(scores), np.log(p / (1 - p)), rtol=1e-12)
    np.testing.assert_allclose(log_odds(np.array([[80.0, 0.0], [90.0, 0.0]])), [[80, -80], [90, -90]])
    assert np.isfinite(log_odds(np.array([[3.0, -np.inf, 1.0], [-np.inf, -np.inf, 0.0]]))).all()


@pytest.mark.parametrize("level", [0.9, 0.95])
def test_of_exchangeable_contacts_so_many_are_in_their_sets(level):
    """With n held out, the expected share is ceil((n + 1) level) / (n + 1), for any distribution."""
    n, rng = 20, np.random.default_rng(1)
    drawn = rng.standard_cauchy((4000, n + 1))
    share = np.mean([new >= conformity(held_out).least(level) for *held_out, new in drawn])
    expected = np.ceil((n + 1) * level) / (n + 1)
    assert share == pytest.approx(expected, abs=3 * np.sqrt(expected * (1 - expected) / len(drawn)))
    assert share >= level - 0.005


def test_a_contact_counts_once_however_often_it_answers():
    """Of 50 contacts, one answers with 20 good windows where another answers with one bad one."""
    rng, by_contact, by_window = np.random.default_rng(2), [], []
    for _ in range(500):
        rough = rng.random(51) < 0.3
        odds = [rng.normal(0 if hard else 3, 1, 1 if hard else 20) for hard in rough]
        contacts = np.repeat(np.arange(50), [len(one) for one in odds[:50]])
        held_out = np.concatenate(odds[:50])
        by_contact.append(np.mean(odds[50] >= conformity(held_out, contacts).least(0.9)))
        by_window.append(np.mean(odds[50] >= conformity(held_out).least(0.9)))
    assert 0.87 < np.mean(by_contact) < 0.95
    assert np.mean(by_window) < 0.85


def test_too_few_contacts_make_sets_of_all_surfaces_and_are_told():
    few = conformity(np.linspace(0, 0.5, 18))
    assert few.sets(np.arange(4.0), NAMES) == {0.9: ("slate",), 0.95: NAMES[::-1]}
    assert (
        few.too_few((0.9, 0.95))
        == "sets of 95 % contain all surfaces: 18 contacts were held out, at least 19 are needed"
    )
    assert conformity(np.linspace(1, 2, 19)).too_few((0.9, 0.95)) == ""
    assert conformity([]).least(0.5) == -np.inf


def test_sets_of_higher_levels_hold_those_of_lower_ones_and_are_told_in_words():
    odds = np.sort(np.random.default_rng(3).normal(0, 2, 400))
    sets = conformity(odds).sets(np.array([2.0, 1.5, 0.0, -1.0]), NAMES, (0.5, 0.7, 0.95, 0.999))
    members = list(sets.values())
    assert all(set(a) <= set(b) for a, b in pairwise(members))
    assert told({0.9: (), 0.95: ("oak", "felt"), 0.99: NAMES}, 4) == {
        "90 %": "none", "95 %": "oak or felt", "99 %": "any"
    }  # fmt: skip
    assert told({0.9: tuple("abcde")}, 9) == {"90 %": "a or b or c or 2 more"}


def test_under_drift_recent_contacts_hold_better_than_all_alike():
    """Odds of the right surface fall with every contact, by a tenth of their deviation."""
    rng, ages = np.random.default_rng(4), np.arange(200)[::-1]
    drawn = rng.normal(size=(400, 201)) - 0.02 * np.arange(201)
    share = {
        half_life: np.mean(
            [new >= conformity(old, counts=recency(ages, half_life)).least(0.9) for *old, new in drawn]
        )
        for half_life in (20.0, 1e9)
    }
    assert share[1e9] < 0.6
    assert share[20.0] > 0.8


def test_later_repetitions_are_counted_within_a_surface_and_once():
    surfaces, repetitions = np.array(list("aaabbb")), np.array([1, 3, 3, 2, 7, 9])
    assert n_later(surfaces, repetitions).tolist() == [1, 0, 0, 2, 1, 0]


def test_a_trained_model_tells_sets_saves_them_and_answers_for_any_level(linear_model, tmp_path):
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
    with pytest.raises(ValueError, match="Expected a number between 0 and 1"):
        loaded.predict_set(recording("oak", 77), 95)


def test_what_cannot_be_judged_has_no_sets(linear_model):
    assert linear_model.predict(recording("oak", 77, fs=8000.0)).prediction_sets == {}


def test_in_training_every_set_of_held_out_recordings_holds_as_often(linear_model):
    known = linear_model.conformity["answer"]
    assert known.n == 40
    for level in (0.8, 0.9, 0.95):
        assert np.mean(known.odds >= known.least(level)) == np.ceil(41 * level) / 40


def test_documents_say_which_sets_there_are(linear_model):
    (table, _) = answers_document([("a", linear_model.predict(recording("oak", 77)))]).blocks
    assert table.frame["95 % set"][0].startswith("oak")
    assert (
        "coverage 90 and 95 %, from 40 held-out contacts"
        in model_document(linear_model).blocks[0]["Prediction sets"]
    )
    old = answers_document([("a", replace(linear_model, conformity={}).predict(recording("oak", 77)))])
    assert "95 % set" not in old.blocks[0].frame


@pytest.mark.usefixtures("_own_cache")
def test_touches_of_one_recording_make_one_set_and_windows_of_a_stream_another(touched):
    assert [*touched.conformity] == ["answer", "recording", "contact 1", "contact 2", "contact 4"]
    assert touched.conformity["recording"].n == 40
    correlation = touched.manifest.calibration["correlation"]
    assert touched.conformity["answer"].n == pytest.approx(40 * 5 / (1 + 4 * correlation))
    felt = recording("felt", 78)
    p = [list(touched.answer(one).probabilities.values()) for one in touched.cut(felt)]
    assert touched.predict(felt).prediction_sets == touched.sets_of("recording", np.log(p).mean(axis=0))
    live = OnlineRecogniser(touched)
    verdicts = [u.verdict for u in live.push(signal(SURFACES["felt"], 5)) if hasattr(u, "verdict")]
    assert all(set(v.prediction_sets) == {0.9, 0.95} for v in verdicts)
    assert verdicts[-1].prediction_sets[0.95] == ("felt",)
    other = OnlineRecogniser(touched, settings=OnlineSettings(window_s=0.2))
    found = other.push(signal(SURFACES["felt"], 5))
    assert {len(u.verdict.prediction_sets) for u in found if hasattr(u, "verdict")} == {0}


def test_a_verdict_is_compared_with_contacts_that_were_felt_as_long():
    after = {1: conformity(np.full(40, -5.0)), 4: conformity(np.full(40, 5.0))}
    answer = train_answer = dict(zip(NAMES, (0.4, 0.3, 0.2, 0.1), strict=True))
    evidence = Evidence(NAMES, correlation=1.0, conformity=after, levels=(0.9,))
    said = type("Said", (), {"probabilities": answer, "unknown": False})()
    sets = [evidence.add(said, float(i)).prediction_sets[0.9] for i in range(5)]
    assert sets == [tuple(train_answer)] * 3 + [()] * 2


@pytest.mark.usefixtures("_own_cache")
def test_references_felt_later_move_the_sets(linear_model):
    later = surfaces(14)
    felt = replace(later, entries=tuple(e for e in later.entries if e.repetition > 10))
    renewed = with_references(linear_model, felt)
    assert renewed.conformity["answer"].n == pytest.approx(40 / 2**0.8 + 4 * (recency(range(4), 5.0)).sum())
    assert renewed.manifest.calibration["prediction_sets"]["references"] == felt.input_hash
    assert (
        renewed.predict(recording("oak", 99)).probability
        == linear_model.predict(recording("oak", 99)).probability
    )
    drifted = replace(felt, load=lambda entry: recording("cork", entry.repetition, surface=entry.surface))
    assert with_references(linear_model, drifted).conformity["answer"].least(0.9) < -5
    assert linear_model.conformity["answer"].least(0.9) > 0
    strange = replace(felt, entries=tuple(replace(e, surface="tin") for e in felt.entries))
    with pytest.raises(ValueError, match=r"'tin' is no surface of the model. Expected one of cork"):
        with_references(linear_model, strange)


@pytest.mark.parametrize("level", [-0.1, 0, 1, 95])
def test_a_level_that_is_no_share_is_refused(touched, level):
    with pytest.raises(ValueError, match=rf"level is {level}\. "):
        touched.predict_set(recording("oak", 77), level)
