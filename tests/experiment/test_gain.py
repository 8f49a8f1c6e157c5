"""What a group adds: a group that helps, one that is noise, one that the dataset lacks."""

import json
from dataclasses import replace

import numpy as np
import pytest

from texclass.experiment.benchmark import run_benchmark
from texclass.experiment.definition import (
    GainSettings,
    PipelineDefinition,
    RowDefinition,
    Selection,
    load_pipeline,
)
from texclass.experiment.use import Use

STEPS = (
    Use("sklearn.impute.SimpleImputer", {"strategy": "median", "keep_empty_features": True}),
    Use("sklearn.preprocessing.MinMaxScaler"),
)
CLASSIFIERS = {
    "naive_bayes": Use("sklearn.naive_bayes.GaussianNB"),
    "euclidean": Use("sklearn.neighbors.NearestCentroid"),
}
ROWS = (RowDefinition("Chance", ("rarely",)), RowDefinition("All", ("rarely", "level")))
GROUPS = (RowDefinition("Loudness", ("level",)), RowDefinition("Taps", ("knock",)))


@pytest.fixture
def pipeline(feature_set):
    return PipelineDefinition("toy", feature_set, STEPS, CLASSIFIERS, ROWS, 5, folds=4, additions=GROUPS)


@pytest.fixture
def dataset(toy_dataset):
    return toy_dataset(n_materials=4, n_repetitions=8)


def test_a_group_that_helps_is_found_and_one_that_is_lacking_is_named(dataset, pipeline):
    gains = run_benchmark(dataset, pipeline).gains
    loudness, taps = gains.groups
    assert (gains.row, gains.n_repeats, gains.n_folds) == ("Chance", 5, 4)
    assert loudness.paired.difference == pytest.approx(loudness.joined.accuracy - gains.without.accuracy)
    assert loudness.paired.difference > 0.3
    assert loudness.p_corrected < 0.01
    assert np.shape(loudness.paired.folds) == (5, 4)
    assert (taps.joined, taps.paired, taps.missing) == (None, None, "no tap found (knock)")


def test_the_first_repeat_has_the_folds_of_the_table(dataset, pipeline):
    result = run_benchmark(dataset, replace(pipeline, gain=GainSettings(repeats=1)))
    rows = {row.name: row.accuracy[result.gains.classifier].folds for row in result.rows}
    assert result.gains.groups[0].paired.folds[0] == pytest.approx(np.subtract(rows["All"], rows["Chance"]))


def test_rows_with_a_group_inside_are_no_base(pipeline):
    assert [row.name for row in pipeline.bases] == ["Chance"]


def test_a_named_row_and_classifier_are_taken(dataset, pipeline):
    rows = (*ROWS, RowDefinition("Peaks", ("peaks",)))
    named = replace(pipeline, rows=rows, gain=GainSettings("Chance", "euclidean", 2))
    gains = run_benchmark(dataset, named).gains
    assert (gains.row, gains.classifier) == ("Chance", "euclidean")
    assert gains.chosen == "row and classifier named by the pipeline"
    best = run_benchmark(dataset, replace(named, gain=GainSettings(repeats=2))).gains
    assert best.row == "Peaks"
    assert "on these very recordings" in best.chosen


@pytest.mark.parametrize("protocol", ["operator", "blocks"])
def test_splits_that_are_not_drawn_are_compared_once_over_recordings(dataset, pipeline, protocol):
    gains = run_benchmark(dataset, pipeline, protocol=protocol).gains
    paired = gains.groups[0].paired
    assert gains.n_repeats == 1
    assert paired.test == "exact McNemar test and paired bootstrap over recordings"
    assert paired.p_value < 0.05
    assert paired.interval[0] < paired.difference < paired.interval[1]


def test_a_row_that_selects_keeps_its_number_of_columns(dataset, pipeline):
    rows = (RowDefinition("Selected", ("rarely", "peaks"), Selection(2, 2)),)
    gains = run_benchmark(dataset, replace(pipeline, rows=rows)).gains
    assert gains.selects
    assert gains.groups[0].joined.n_features == gains.without.n_features == 2


def test_json_keeps_the_difference_of_every_fold_and_repeats(dataset, pipeline):
    first, second = (run_benchmark(dataset, pipeline).to_dict()["gains"] for _ in range(2))
    for group in (*first["groups"], *second["groups"]):
        group["joined"] = None
    first["without"] = second["without"] = None
    assert json.loads(json.dumps(first)) == json.loads(json.dumps(second))
    assert np.shape(first["groups"][0]["paired"]["folds"]) == (5, 4)
    assert {"low", "high", "p_value", "difference", "test"} <= set(first["groups"][0]["paired"])


def test_without_additions_there_are_no_gains(dataset, pipeline):
    assert run_benchmark(dataset, replace(pipeline, additions=())).gains is None


TOML = """features = "strese2015"
seed = 1
[classifiers.nb]
use = "sklearn.naive_bayes.GaussianNB"
[[rows]]
name = "F"
features = ["friction"]
[[rows]]
name = "W"
features = ["waviness"]
[[additions]]
name = "more"
features = ["waviness", "mfcc_constant.c2"]
"""


def test_additions_are_read(tmp_path):
    (tmp_path / "p.toml").write_text(
        TOML + 'reference = "mine"\nskip_missing = true\n[gain]\nbase = "F"\nrepeats = 3\n'
    )
    pipeline = load_pipeline(tmp_path / "p.toml")
    (group,) = pipeline.additions
    assert (group.name, group.reference, group.skip_missing) == ("more", "mine", True)
    assert pipeline.gain == GainSettings("F", None, 3)
    assert set(pipeline.needed[0].columns) == {"friction", "waviness", "mfcc_constant"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TOML + "select = { n = 2 }\n", "additions 1: unknown key 'select'"),
        (TOML.replace("mfcc_constant.c2", "smell"), r"additions 1 \(more\): .*'smell' is neither"),
        (
            TOML + "[gain]\nbase = 'W'\n",
            "gain.base is 'W'; the rule is a row without features of an addition: F",
        ),
        (TOML + "[gain]\nclassifier = 'svm'\n", "gain.classifier is 'svm'; the rule is a classifier: nb"),
        (TOML + "[gain]\nrepeats = 0\n", "gain.repeats is 0; the rule is a whole number of at least 1"),
        (TOML + "[gain]\nluck = 1\n", "gain: unknown key 'luck'"),
        (TOML.replace('"friction"', '"waviness"'), "every row has features of an addition"),
        (TOML + TOML[TOML.index("[[additions]]") :], "two additions are named 'more'"),
    ],
)
def test_wrong_additions_are_refused_with_place_and_rule(tmp_path, text, message):
    (tmp_path / "p.toml").write_text(text)
    with pytest.raises(ValueError, match=message):
        load_pipeline(tmp_path / "p.toml")
