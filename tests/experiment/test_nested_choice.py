"""Choosing inside training parts: the tests have no say, and the accuracy is that of what was chosen."""

import numpy as np
import pandas as pd
import pytest
from toy_noises import CLASSIFIERS, STEPS, a_table, row

from texclass.experiment.benchmark import run_benchmark
from texclass.experiment.feature_table import FeatureTable
from texclass.experiment.nested_choice import choose_inside, inner_splits
from texclass.experiment.pipeline import MatchedRow
from texclass.experiment.protocols import find_protocol

EUCLIDEAN = {"euclidean": CLASSIFIERS["euclidean"]}


@pytest.fixture
def two(pipeline):
    return pipeline(row("Peaks", "peaks"), row("Level", "level"), classifiers=EUCLIDEAN, steps=STEPS[1:])


def choice_of(pipeline, frame):
    """Choose a row and a classifier for some values, blocks first; return it beside every evaluation."""
    table = FeatureTable(frame, pipeline.features.column_names, np.zeros(len(frame)))
    protocol = find_protocol("blocks")
    splits = protocol.split(table.frame, 0, 0)
    rows = [MatchedRow.of(definition, pipeline.features, table) for definition in pipeline.rows]
    evaluations = {
        one.definition.name: {name: pipeline.trial(one, name, table)(splits) for name in pipeline.classifiers}
        for one in rows
    }
    return choose_inside(rows, table, splits, pipeline, protocol, evaluations), evaluations


def test_the_row_that_fits_the_tests_by_chance_is_not_chosen(two):
    """`level` tells materials apart in training; `peaks` only in the tests, where `level` is noise."""
    rng, later = np.random.default_rng(0), np.tile(np.arange(20) >= 10, 4)
    truth, noise = np.repeat(np.arange(4.0), 20) + rng.normal(0, 0.05, 80), rng.uniform(0, 3, (2, 80))
    level, *peaks = (column for name in ("level", "peaks") for column in _columns(two, name))
    values = dict.fromkeys(two.features.column_names, np.zeros(80))
    values |= {level: np.where(later, noise[0], truth)}
    values |= {peak: np.where(later, truth, noise[1]) for peak in peaks}
    choice, evaluations = choice_of(two, a_table(4, 20).assign(**values))
    assert choice["chosen"] == [["Level", "euclidean"]]
    assert choice["protocol"] == "blocks"
    assert choice["accuracy"]["mean"] == evaluations["Level"]["euclidean"].accuracy.mean


def test_permuted_labels_leave_the_choice_at_chance_where_the_best_of_the_table_is_above(pipeline):
    names = "level", "peaks", "rarely"
    rows = (*(row(name.title(), name) for name in names), row("All", *names))
    every = pipeline(*rows, classifiers=EUCLIDEAN, steps=STEPS[1:])
    chosen, best = [], []
    for seed in range(10):
        values = np.random.default_rng(seed).normal(size=(80, len(every.features.column_names)))
        noises = pd.DataFrame(values, columns=every.features.column_names)
        choice, evaluations = choice_of(every, pd.concat([a_table(4, 20), noises], axis=1))
        chosen.append(choice["accuracy"]["mean"])
        best.append(max(found.accuracy.mean for of in evaluations.values() for found in of.values()))
    assert np.mean(chosen) == pytest.approx(0.25, abs=0.04)
    assert np.mean(best) > 0.31


def test_each_fold_counts_with_what_it_chose(toy_dataset, two):
    found = run_benchmark(toy_dataset(), two, choose=True).data
    accuracies = {line["name"]: line["accuracy"] for line in found["rows"]}
    chosen = found["choice"]["chosen"]
    expected = [accuracies[name][classifier]["folds"][k] for k, (name, classifier) in enumerate(chosen)]
    assert found["choice"]["accuracy"]["folds"] == expected
    assert len(expected) == 4
    assert run_benchmark(toy_dataset(), two).data["choice"] is None


def test_of_rows_that_do_equally_well_the_widest_is_chosen(toy_dataset, pipeline):
    rows = (row("Level", "level"), row("Both", "level", "peaks"))
    widening = pipeline(*rows, classifiers=EUCLIDEAN, steps=STEPS[1:])
    found = run_benchmark(toy_dataset(), widening, choose=True).data
    assert [line["accuracy"]["euclidean"]["mean"] for line in found["rows"]] == [1.0, 1.0]
    assert found["choice"]["chosen"] == [["Both", "euclidean"]] * 4


def test_training_parts_are_split_as_the_whole_where_possible():
    two_operators = a_table(3, 6).assign(operator=np.tile(["a", "a", "a", "b", "b", "b"], 3))
    for protocol, frame, inner in (
        ("recording", a_table(3, 6), "recording"),
        ("blocks", a_table(3, 8), "blocks"),
        ("blocks", a_table(3, 6), "recording"),
        ("few-shot", a_table(3, 8), "recording"),
        ("operator", two_operators, "recording"),  # one is left, and cannot be left out
    ):
        ((train, _), *_) = find_protocol(protocol).split(frame, 3, 0)
        ((name, splits),) = inner_splits(find_protocol(protocol), frame, [(train, None)], 0)
        assert name == inner
        for inner_train, inner_test in splits:
            assert sorted([*inner_train, *inner_test]) == list(range(len(train)))
            assert frame["material"].iloc[train[inner_train]].value_counts().min() >= 2


def test_the_papers_protocol_is_refused_and_a_part_of_single_recordings_too(toy_dataset, two):
    with pytest.raises(ValueError, match="'paper'; the rule is one whose test recordings stay unseen"):
        run_benchmark(toy_dataset(), two, protocol="paper", choose=True)
    with pytest.raises(ValueError, match="cannot be split again"):
        inner_splits(find_protocol("recording"), a_table(3, 2), [(np.arange(6), None)], 0)


def _columns(pipeline, feature):
    return pipeline.features.restricted_to([feature]).column_names
