"""Training on few recordings: no selection, wider thresholds, and conditions that were not evaluated."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from toy_surfaces import SURFACES, pipeline, recording, surfaces

from texclass.evaluation.accuracy import cluster_interval
from texclass.evaluation.feature_table import metadata
from texclass.evaluation.protocols import find_protocol
from texclass.loaders import open_dataset
from texclass.recognition import load_model, train
from texclass.recognition.holdout import LIMITS, Holdout, later_accuracy
from texclass.recognition.model_document import model_document
from texclass.recognition.novelty import NoveltyDetector, conservative_rate
from texclass.recognition.probabilities import prior_calibration

STUDY = Path(__file__).parents[2] / "reports" / "studies" / "few_recordings.json"


@pytest.fixture(scope="module")
def few():
    return train(surfaces(LIMITS.few_recordings - 2), pipeline())


def test_nothing_is_selected_below_ten_recordings_per_surface(few):
    assert (few.manifest.accuracy["n_candidates"], len(few.columns)) == (1, 13)
    assert few.manifest.pipeline["classifier"] == "kernel"  # it weights columns itself
    (card,) = model_document(few).blocks
    assert card["Pipeline"].endswith(
        "8 recordings of a surface: too few to select row and classifier, and thresholds are wider"
    )
    accuracy = train(surfaces(LIMITS.few_recordings), pipeline()).manifest.accuracy
    assert accuracy["n_candidates"] == 4
    assert accuracy["low"] <= accuracy["mean"] <= accuracy["high"]
    assert "selection" in accuracy["description"]


def test_a_named_row_or_classifier_is_trained_on_few_recordings_too():
    model = train(surfaces(LIMITS.few_recordings - 2), pipeline(), row="Roughness", classifier="lda")
    assert (model.manifest.pipeline["row"], model.manifest.pipeline["classifier"]) == ("Roughness", "lda")
    model = train(surfaces(LIMITS.few_recordings - 2), pipeline(), classifier="lda")
    assert model.manifest.accuracy["n_candidates"] == 2


def without_order(dataset):
    """Return a dataset without repetition numbers."""
    entries = tuple(replace(entry, repetition=None) for entry in dataset.entries)
    return replace(dataset, entries=entries, load=Numbered(dataset.load), input_hash="unordered")


class Numbered:
    """Load the toy recordings of entries without repetition numbers."""

    def __init__(self, load):
        self.load = load

    def __call__(self, entry):
        return self.load(replace(entry, repetition=int(entry.recording_id.rpartition("-")[2])))


@pytest.fixture(scope="module")
def unordered():
    return train(without_order(surfaces(LIMITS.few_recordings - 2)), pipeline())


@pytest.fixture(scope="module")
def one():
    return train(surfaces(1), pipeline())


def test_one_recording_per_surface_trains_a_model_without_an_accuracy(one, tmp_path):
    (card,) = model_document(one).blocks
    assert "mean" not in one.manifest.accuracy
    assert card["Accuracy"] == "not evaluated: no recording could be held out"
    assert card["Pipeline"].endswith(
        "1 recording of a surface: too few to select row and classifier, and thresholds are wider"
    )
    assert card["Not evaluated"].startswith("accuracy on other recordings")
    assert card["Probabilities"] == "prior temperature scaling, beta 9.01, with beta from other datasets"
    assert card["Unknown surfaces"].endswith("not evaluated: too few recordings were held out")
    assert one.calibration == prior_calibration(4, 4)
    one.save(tmp_path / "one.skops")
    loaded = load_model(tmp_path / "one.skops")
    answers = loaded.predict(recording(name, 7) for name in SURFACES)
    assert [answer.surface for answer in answers] == list(SURFACES)
    assert all(0.4 < answer.probability < 0.99 for answer in answers)


def test_a_model_of_one_recording_per_surface_detects_no_unknown_surfaces_and_warns(one):
    answer = one.predict(recording("stranger", 1))
    assert (answer.unknown, answer.p_known) == (False, 1.0)
    assert "unknown surfaces are not detected: too few recordings were held out" in answer.reasons
    assert set(answer.prediction_sets[0.9]) == set(SURFACES)


def test_a_classifier_that_needs_several_recordings_is_not_trained_on_one():
    with pytest.raises(ValueError, match=r"lda needs at least 2 recordings .* use the pipeline 'surfaces'"):
        train(surfaces(1), pipeline(), classifier="lda")
    with pytest.raises(ValueError, match="2 folds need at least 2 of each"):
        train(surfaces(1), pipeline(), protocol="recording")


def test_two_recordings_of_four_surfaces_give_an_accuracy_but_no_novelty_threshold():
    two = train(surfaces(2), pipeline())
    assert two.manifest.accuracy["n_tested"] == 8
    assert two.manifest.unknown["threshold"] is None
    with pytest.raises(ValueError, match=r"requires at least 99 held-out recordings, got 8"):
        train(surfaces(2), pipeline(), false_alarms=0.01)


def test_the_model_card_states_that_later_recordings_and_other_sessions_were_not_evaluated(few):
    (card,) = model_document(few).blocks
    assert card["Accuracy"].startswith("97.1 % (89.3 to 100.0) of 32 held-out recordings (few: one correct")
    assert card["Accuracy"].endswith("; expected for later recordings: 61 to 100 % (from other datasets)")
    assert card["Unknown surfaces"].endswith(
        "from 32 held-out recordings; unknown surfaces are often missed, since there are few held-out "
        "recordings"
    )
    low, high = (100 * share for share in LIMITS.later_coverage)
    assert card["Prediction sets"].endswith(
        "from 32 held-out recordings, and from the earlier and the later half (worst case); few recordings: "
        f"in other datasets, 90 % sets contained {low:.0f} to {high:.0f} % of later ones"
    )
    assert card["Not evaluated"].startswith(
        "later recordings (8 of each surface, held out at random; from 20"
    )
    assert "another session or operator" in card["Not evaluated"]


def test_a_perfect_accuracy_on_few_recordings_is_corrected_and_extended_for_later_ones(few, unordered):
    accuracy = few.manifest.accuracy
    assert accuracy["mean"] == pytest.approx(33 / 34)  # 32 of 32
    for model, share in ((few, LIMITS.later_share_of_halves), (unordered, LIMITS.later_share)):
        accuracy = model.manifest.accuracy
        later = accuracy["later_recordings"]
        n_halves = 16 if later["halves"] else 32  # both halves are classified correctly
        low, _ = cluster_interval(np.ones(n_halves, dtype=bool), np.arange(n_halves))
        assert later["low"] == pytest.approx(1 / 4 + share * (low - 1 / 4))  # four surfaces
        assert (later["high"], later["source"]) == (accuracy["high"], "other datasets")
    assert later_accuracy(0.01, 0.3, 4, 0.5) == {"low": 0.01, "high": 0.3}  # below chance level already
    chronological = train(
        surfaces(LIMITS.few_recordings - 2), pipeline(), protocol="chronological", false_alarms=0.1
    ).manifest.accuracy
    assert len(chronological["later_recordings"]["halves"]) == 1
    assert chronological["mean"] == pytest.approx(17 / 18)


def test_without_an_order_in_time_sets_are_widened_as_in_other_datasets(few, unordered):
    for model, shift in ((few, 0.0), (unordered, LIMITS.later_shift)):
        entry = model.manifest.calibration["prediction_sets"]
        assert (entry["shift"], entry["later_coverage"]) == (shift, list(LIMITS.later_coverage))
    (card,) = model_document(unordered).blocks
    assert f"widened by {LIMITS.later_shift:g} of log odds (from other datasets)" in card["Prediction sets"]
    assert card["Unknown surfaces"].endswith("later recordings may be reported as unknown more often")
    many = train(without_order(surfaces(LIMITS.few_recordings)), pipeline(), row="Spectrum")
    assert many.manifest.calibration["prediction_sets"]["shift"] == 0


def test_the_constants_for_later_recordings_agree_with_the_committed_study():
    study = json.loads(STUDY.read_text(encoding="utf-8"))
    results = pd.DataFrame(study["promises"])
    share = results.groupby("set")["kept"].mean()
    assert len(share) == 5
    assert pytest.approx(share.min(), abs=0.05) == LIMITS.later_share
    several = results[results["n"] >= 3]
    growth = several.groupby("set")["plain_alarms"].mean().median() / study["false_alarms"]
    assert pytest.approx(growth, rel=0.25) == LIMITS.later_alarm_factor
    # The guide mentions datasets whose later recordings differ from the first ones.
    poor = several[several["promise"] > 0.95].groupby("set")["kept"].mean()
    assert poor.min() < 0.5


def test_the_study_compares_the_default_with_the_best_other_row_of_every_cell():
    study = json.loads(STUDY.read_text(encoding="utf-8"))
    deficits = [cell["best"]["mean"] - cell["default"]["mean"] for cell in study["cells"]]
    assert study["n_near"] == sum(deficit <= study["near"] + 1e-9 for deficit in deficits)
    assert f"better, in {study['n_near']} of {len(deficits)} cells" in (
        STUDY.parent / "certainty.md"
    ).read_text(encoding="utf-8")
    for cell in study["cells"]:
        others = [row["mean"] for row in cell["rows"] if row["row"] != cell["default"]["row"]]
        assert cell["best"]["mean"] == max(others)


def test_thresholds_are_wider_if_later_recordings_are_not_evaluated():
    def p_threshold(dataset, **options):
        return train(dataset, pipeline(), false_alarms=0.2, **options).manifest.unknown["p_threshold"]

    ten = surfaces(LIMITS.few_recordings)
    assert p_threshold(without_order(ten)) == conservative_rate(0.2, 40, LIMITS.later_alarm_factor) == 1 / 41
    assert p_threshold(ten) == p_threshold(ten, protocol="chronological") == 0.2
    assert p_threshold(without_order(surfaces(LIMITS.min_repetitions))) == 0.2


def test_recordings_that_are_tested_in_several_folds_are_not_windows():
    model = train(
        surfaces(LIMITS.few_recordings),
        pipeline(),
        protocol="few-shot 1",
        row="Spectrum",
        classifier="kernel",
    )
    assert "correlation" not in model.manifest.calibration
    assert model.manifest.accuracy["not_evaluated"] == [
        "another session or operator (`--leave-out session`, if the card names it)"
    ]


def test_the_protocol_determines_which_conditions_are_not_evaluated():
    table = metadata(surfaces(4).entries)

    def not_evaluated(protocol, **labels):
        holdout = Holdout(table.assign(**labels), find_protocol(protocol), "requested", True, 0)
        return [condition.split("(")[0].strip() for condition in holdout.not_evaluated]

    late = np.where(table["repetition"] > 2, "b", "a")
    assert not_evaluated("recording") == ["later recordings", "another session or operator"]
    assert not_evaluated("chronological") == ["another session or operator"]
    assert not_evaluated("repetition=1,2 -> repetition=4") == ["another session or operator"]
    assert not_evaluated("operator", operator=late) == ["later recordings", "another session"]
    assert not_evaluated("grouped", session=table["recording_id"]) == ["later recordings", "another operator"]
    assert not_evaluated("leave-out session", session=late) == ["later recordings", "another operator"]


@pytest.mark.parametrize(("n", "rate"), [(60, 0.05), (150, 0.05), (60, 0.1)])
def test_the_conservative_rate_keeps_false_alarms_in_95_percent_of_trainings(n, rate):
    """Scores are uniform, so a new recording is above a threshold t with probability 1 - t."""
    held_out = np.sort(np.random.default_rng(0).random((4000, n)), axis=1)
    plain, wide = (
        np.array([1 - NoveltyDetector("decision", scores, level).threshold for scores in held_out])
        for level in (rate, conservative_rate(rate, n))
    )
    assert 0.93 < (wide <= rate).mean() <= 1
    assert (plain <= rate).mean() < 0.7  # the rate is kept only on average
    assert plain.mean() <= rate


def test_the_widest_threshold_is_the_largest_held_out_score():
    assert conservative_rate(0.05, 58) == 1 / 59 < conservative_rate(0.05, 5000) < 0.05
    assert conservative_rate(0.05, 19, 100) == 1 / 20  # the smallest rate that 19 recordings support
    scores = np.arange(30.0)
    assert NoveltyDetector("decision", scores, conservative_rate(0.05, 30)).threshold == 29


def test_the_kernel_is_trained_on_three_real_recordings_per_surface(data_root):
    """Sixty recordings of 180 columns: most eigenvalues are equal, and LAPACK's default driver failed."""
    dataset = open_dataset("biotac20")
    three = replace(dataset, entries=tuple(e for e in dataset.entries if 11 <= e.repetition <= 13))
    model = train(three, "multiscale", row="Spectrum", classifier="kernel")
    assert model.manifest.accuracy["mean"] > 0.9
    assert model.manifest.accuracy["not_evaluated"][0].startswith("later recordings (3 of each surface")
