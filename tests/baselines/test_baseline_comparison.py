"""Comparison of our rows with baselines on the same folds."""

import json

import numpy as np
import pytest

from texclass.baselines import (
    BASELINES,
    BaselineComparison,
    BaselineSettings,
    compare_with_baselines,
    whole_surfaces,
)
from texclass.baselines.comparison import _length_notes, every_channel, same_signals
from texclass.evaluation import BenchmarkResult
from texclass.evaluation.result_facts import NESTED_CV_TITLE
from texclass.features.phase_view import views_of
from texclass.recording import Phases, Recording, Tap


@pytest.fixture(scope="module")
def compared(bench, interpreter):
    """Compare the benchmark with a baseline of each behaviour."""
    baselines = {
        "tsfel": "absent", "minirocket": "perfect", "mfcc": "first fold wrong", "quant": "slow",
        "catch22": "crash",
    }  # fmt: skip
    return compare_with_baselines(
        *bench, BaselineSettings(tuple(baselines), interpreter(**baselines), time_limit_s=4.0)
    )


def of_baseline(compared, name):
    return next(c for c in compared.data["contestants"] if c["name"] == name)


def test_a_perfect_baseline_is_level_with_a_perfect_row_at_the_cost_of_one_fold(bench, compared):
    *_, result = bench
    ours, baseline = compared.data["contestants"][0], of_baseline(compared, "minirocket")
    assert compared.best_baseline is baseline
    assert (baseline["accuracy"]["mean"], baseline["n_folds"], baseline["classifier"]) == (1.0, 4, "ridge")
    assert baseline["difference"]["difference"] == ours["accuracy"]["mean"] - 1.0
    assert (ours["name"], ours["classifier"], ours["ours"], ours["difference"]) == (*result.best, True, None)
    assert ours["accuracy"]["mean"] == result.table["mean"].max()
    assert compared.data["baseline_versions"] == {"fake": "1.0"}
    cost = baseline["cost"]
    assert (cost["feature_ms"], cost["fit_s"], cost["predict_ms"], cost["memory_mb"]) == (2.0, 0.5, 1.0, 3.0)
    # 9 + 3 recordings of a fold from their samples on, fit, 3 predictions.
    of_a_recording = 0.002 + compared.data["segmentation_ms"] / 1000
    assert cost["total_s"] == pytest.approx(12 * of_a_recording + 0.5 + 3 * 0.001)


def test_a_baseline_that_is_missing_or_dies_is_a_line_and_our_widest_row_competes_beside_the_best(
    compared,
):
    subset = json.loads(compared.to_json())
    assert {"dataset", "protocol", "versions", "baseline_versions", "seed", "input_hash"} <= set(subset)
    ours = [c for c in subset["contestants"] if c["ours"]]
    assert all(c["cost"]["feature_ms"] > 0 and c["cost"]["fit_s"] > 0 for c in ours)
    assert "Modified MFCC, Constant Mel Filter Bank" in {c["name"] for c in ours}
    for name, status, message in (
        ("tsfel", "not installed", "needs aeon"),
        ("catch22", "failed", "Killed by its own hand"),
    ):
        baseline = of_baseline(compared, name)
        assert (baseline["status"], baseline["message"], baseline["accuracy"]) == (status, message, None)


def test_a_wrong_fold_costs_what_it_tests_and_one_that_is_not_finished_nothing(compared):
    wrong, slow = of_baseline(compared, "mfcc"), of_baseline(compared, "quant")
    assert wrong["accuracy"]["folds"] == [0.0, 1.0, 1.0, 1.0]
    assert wrong["difference"]["test"].startswith("corrected resampled")
    assert (slow["status"], slow["message"]) == ("out of time", "stopped after 4 s")
    assert (slow["n_folds"], slow["accuracy"]["n_tested"]) == (2, 6)
    assert len(slow["difference"]["folds"][0]) == 2
    contestants = [c for c in compared.data["contestants"] if c["ours"] or c is slow]
    assert BaselineComparison({**compared.data, "contestants": contestants}).best_baseline is None


@pytest.mark.usefixtures("ours_here")
def test_what_was_chosen_inside_the_training_parts_competes_first_and_is_compared(bench, interpreter):
    dataset, pipeline, result = bench
    (row, judge), other = result.best, result.table.iloc[-1]
    folds = [[row, judge]] * 3 + [[other["row"], other["classifier"]]]
    accuracy = result.data["rows"][0]["accuracy"][judge]
    chosen = BenchmarkResult(
        {
            **result.data,
            "nested_cv": {"accuracy": accuracy, "selected": folds, "inner_protocols": ["recording"]},
        }
    )
    settings = BaselineSettings(("mfcc",), interpreter("perfect"))
    outcome = compare_with_baselines(dataset, pipeline, chosen, settings)
    first, best, *_ = outcome.data["contestants"]
    assert (first["name"], first["classifier"], first["difference"]) == (NESTED_CV_TITLE, "selected", None)
    assert first["accuracy"]["folds"][:3] == best["accuracy"]["folds"][:3]
    hits = first["accuracy"]["mean"]
    assert of_baseline(outcome, "mfcc")["difference"]["difference"] == pytest.approx(hits - 1.0)
    text = (
        "Ours is selected inside each training set (nested cross-validation). The best baseline is the most"
    )
    assert text in outcome.document().finding.rest


def test_settings_are_checked():
    for wrong, text in (
        ({"names": ("mfcc", "weka")}, "weka"),
        ({"time_limit_s": 0.0}, "0.0 s"),
        ({"time_limit_s": np.nan}, "nan"),
        ({"signals": "raw"}, "'same' or 'each', got 'raw'"),
    ):
        with pytest.raises(ValueError, match=text):
            BaselineSettings(**wrong)
    assert BaselineSettings().names == tuple(BASELINES)


def test_a_limit_keeps_complete_surfaces(bench):
    dataset = bench[0]
    some = whole_surfaces(dataset, 9)
    assert some.surfaces == ("felt", "tile")
    assert len(some) == 8
    assert "2 of the 3 surfaces" in some.notes[-1]
    assert whole_surfaces(dataset, 12) is dataset
    with pytest.raises(ValueError, match=r"limit must be .* got 7"):
        whole_surfaces(dataset, 7)


@pytest.fixture
def recording():
    rng = np.random.default_rng(0)
    return Recording(
        rng.normal(size=(4000, 3)) + np.array([0, 0, 9.8]), fs=1000.0, unit="m/s^2", recording_id="r",
        turn_rate=rng.normal(size=(4000, 3)), phases=Phases(movement=(500, 3500)),
    )  # fmt: skip


def test_baselines_are_given_the_movement_that_our_features_read_or_each_channel_without_its_mean(recording):
    arguments = same_signals(recording, ())
    np.testing.assert_array_equal(arguments, views_of(recording)[""].movement.samples[None])
    apart = same_signals(recording, recording.channels)
    assert apart.shape[0] == 3
    views = views_of(recording, recording.channels)
    np.testing.assert_array_equal(apart[2], views["z/"].movement.samples)
    each = every_channel(recording)
    assert each.shape == (6, 3000)
    assert np.abs(each.mean(axis=1)).max() < 1e-12
    turn = recording.turn_rate[500:3500, 1]
    np.testing.assert_allclose(each[4], turn - turn.mean())


def test_taps_stand_in_where_there_is_no_movement_and_all_of_it_where_there_are_neither(recording):
    one = recording.with_(acceleration=recording.acceleration[:, 0], turn_rate=None, channels=())
    tapped = one.with_(phases=Phases(taps=(Tap(100, 150, 400), Tap(600, 650, 900))))
    assert same_signals(tapped, ()).shape == (1, 600)
    assert same_signals(one.with_(phases=Phases()), ()).shape == (1, 4000)
    assert every_channel(one.with_(phases=Phases())).shape == (1, 4000)


def test_recordings_of_different_lengths_are_told_about():
    (note,) = _length_notes((100, 200, 200, 240))
    assert "100 to 240 samples" in note
    assert "(25%)" in note
    assert not list(_length_notes((200, 200)))
