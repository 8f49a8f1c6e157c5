"""Ablation: a group that helps, a group of noise, a group that the dataset lacks."""

import json

import numpy as np
import pytest
from toy_noises import row

from texclass.evaluation.ablation import detectable
from texclass.evaluation.benchmark import run_benchmark
from texclass.evaluation.pipeline import AblationSettings, Selection

GROUPS = (row("Loudness", "level"), row("Taps", "knock"))
ROWS = (row("Chance", "rarely"), row("All", "rarely", "level"))


@pytest.fixture
def gains(toy_dataset, pipeline):
    """Run the benchmark of a dataset with two groups; return it and what they add."""

    def run(*rows, protocol=None, additions=GROUPS, **gain):
        changed = pipeline(*(rows or ROWS), additions=additions, seed=5, gain=AblationSettings(**gain))
        result = run_benchmark(toy_dataset(n_surfaces=4, n_repetitions=8), changed, protocol=protocol)
        return result, result.data["ablation"]

    return run


def test_a_group_that_helps_is_found_and_one_that_is_lacking_is_named(gains):
    result, gains_of_groups = gains()
    loudness, taps = gains_of_groups["groups"]
    comparison = loudness["comparison"]
    assert (gains_of_groups["row"], gains_of_groups["n_repeats"], gains_of_groups["n_folds"]) == (
        "Chance",
        5,
        4,
    )
    assert comparison["difference"] == pytest.approx(
        loudness["combined"]["accuracy"] - gains_of_groups["base"]["accuracy"]
    )
    assert comparison["difference"] > 0.3
    assert comparison["low"] <= comparison["difference"] <= comparison["high"]
    assert loudness["p_corrected"] < 0.01
    assert np.shape(comparison["folds"]) == (5, 4)
    assert (taps["combined"], taps["comparison"], taps["missing"]) == (None, None, "no tap found (knock)")
    assert json.loads(result.to_json())["ablation"]["groups"][1] == taps


def test_the_first_repeat_has_the_folds_of_the_table(gains):
    result, gains_of_groups = gains(repeats=1)
    folds = {r["name"]: r["accuracy"][gains_of_groups["classifier"]]["folds"] for r in result.data["rows"]}
    assert gains_of_groups["groups"][0]["comparison"]["folds"][0] == pytest.approx(
        np.subtract(folds["All"], folds["Chance"])
    )


def test_a_named_row_and_classifier_are_taken_else_the_best_without_a_group_inside(gains, pipeline):
    rows = (*ROWS, row("Peaks", "peaks"))
    assert [r.name for r in pipeline(*rows, additions=(row("Loudness", "level"),)).bases] == [
        "Chance",
        "Peaks",
    ]
    named = gains(*rows, base="Chance", classifier="euclidean", repeats=2)[1]
    assert (named["row"], named["classifier"]) == ("Chance", "euclidean")
    assert named["selection"] == "row and classifier named by the pipeline"
    best = gains(*rows, repeats=2)[1]
    assert best["row"] == "Peaks"
    assert "selected on these recordings" in best["selection"]


def test_splits_that_are_not_drawn_are_compared_once_over_what_is_independent(gains):
    for protocol, test, p in (
        ("operator", "t-test over operators", 0.5),  # two of them say no more than two coins
        ("chronological", "exact McNemar test, t interval over recordings", 0.05),
    ):
        gains_of_groups = gains(protocol=protocol)[1]
        comparison = gains_of_groups["groups"][0]["comparison"]
        assert gains_of_groups["n_repeats"] == 1
        assert comparison["test"] == test
        assert comparison["p_value"] <= p
        assert comparison["low"] < comparison["difference"] < comparison["high"]


def test_a_row_that_selects_keeps_its_number_of_columns_and_no_group_gives_no_gains(gains):
    selected = row("Selected", "rarely", "peaks", select=Selection(n=2, folds=2))
    gains_of_groups = gains(selected)[1]
    assert gains_of_groups["selects"]
    assert (
        gains_of_groups["groups"][0]["combined"]["n_features"] == gains_of_groups["base"]["n_features"] == 2
    )
    assert gains(additions=())[1] is None


@pytest.mark.parametrize(("n", "share"), [(3, "25.0%"), (5, "6.2%"), (6, None), (12, None)])
def test_the_report_states_where_a_sign_test_of_few_clusters_cannot_be_significant(n, share):
    comparison = {"n_clusters": n, "clusters": "operator", "minimum_detectable": 0.125}
    text = detectable([{"comparison": comparison}])
    assert f"80 % power with {n} operators: 12.5 points" in text
    assert ("a sign test of" in text) == (share is not None)
    assert share is None or f"(at best {share})" in text
