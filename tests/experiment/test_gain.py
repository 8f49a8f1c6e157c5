"""What a group adds: a group that helps, one that is noise, one that the dataset lacks."""

import json

import numpy as np
import pytest
from toy_noises import row

from texclass.experiment.benchmark import run_benchmark
from texclass.experiment.pipeline import AdditionSettings, Selection

ROWS = (row("Chance", "rarely"), row("All", "rarely", "level"))
GROUPS = (row("Loudness", "level"), row("Taps", "knock"))


@pytest.fixture
def grouped(pipeline):
    return pipeline(*ROWS, additions=GROUPS, seed=5)


@pytest.fixture
def dataset(toy_dataset):
    return toy_dataset(n_materials=4, n_repetitions=8)


def test_a_group_that_helps_is_found_and_one_that_is_lacking_is_named(dataset, grouped):
    gains = run_benchmark(dataset, grouped).gains
    loudness, taps = gains.groups
    assert (gains.row, gains.n_repeats, gains.n_folds) == ("Chance", 5, 4)
    assert loudness.paired.difference == pytest.approx(loudness.joined.accuracy - gains.without.accuracy)
    assert loudness.paired.difference > 0.3
    assert loudness.p_corrected < 0.01
    assert np.shape(loudness.paired.folds) == (5, 4)
    assert (taps.joined, taps.paired, taps.missing) == (None, None, "no tap found (knock)")


def test_the_first_repeat_has_the_folds_of_the_table(dataset, grouped):
    result = run_benchmark(dataset, grouped.model_copy(update={"gain": AdditionSettings(repeats=1)}))
    rows = {row.name: row.accuracy[result.gains.classifier].folds for row in result.rows}
    assert result.gains.groups[0].paired.folds[0] == pytest.approx(np.subtract(rows["All"], rows["Chance"]))


def test_rows_with_a_group_inside_are_no_base(grouped):
    assert [row.name for row in grouped.bases] == ["Chance"]


def test_a_named_row_and_classifier_are_taken(dataset, grouped):
    settings = AdditionSettings(base="Chance", classifier="euclidean", repeats=2)
    named = grouped.model_copy(update={"rows": (*ROWS, row("Peaks", "peaks")), "gain": settings})
    gains = run_benchmark(dataset, named).gains
    assert (gains.row, gains.classifier) == ("Chance", "euclidean")
    assert gains.chosen == "row and classifier named by the pipeline"
    best = run_benchmark(dataset, named.model_copy(update={"gain": AdditionSettings(repeats=2)})).gains
    assert best.row == "Peaks"
    assert "on these very recordings" in best.chosen


@pytest.mark.parametrize("protocol", ["operator", "blocks"])
def test_splits_that_are_not_drawn_are_compared_once_over_recordings(dataset, grouped, protocol):
    gains = run_benchmark(dataset, grouped, protocol=protocol).gains
    paired = gains.groups[0].paired
    assert gains.n_repeats == 1
    assert paired.test == "exact McNemar test and paired bootstrap over recordings"
    assert paired.p_value < 0.05
    assert paired.interval[0] < paired.difference < paired.interval[1]


def test_a_row_that_selects_keeps_its_number_of_columns(dataset, grouped):
    rows = (row("Selected", "rarely", "peaks", select=Selection(n=2, folds=2)),)
    gains = run_benchmark(dataset, grouped.model_copy(update={"rows": rows})).gains
    assert gains.selects
    assert gains.groups[0].joined.n_features == gains.without.n_features == 2


def test_json_keeps_the_difference_of_every_fold_and_repeats(dataset, grouped):
    first, second = (run_benchmark(dataset, grouped).to_dict()["gains"] for _ in range(2))
    for group in (*first["groups"], *second["groups"]):
        group["joined"] = None
    first["without"] = second["without"] = None
    assert json.loads(json.dumps(first)) == json.loads(json.dumps(second))
    assert np.shape(first["groups"][0]["paired"]["folds"]) == (5, 4)
    assert {"low", "high", "p_value", "difference", "test"} <= set(first["groups"][0]["paired"])


def test_without_additions_there_are_no_gains(dataset, grouped):
    assert run_benchmark(dataset, grouped.model_copy(update={"additions": ()})).gains is None
