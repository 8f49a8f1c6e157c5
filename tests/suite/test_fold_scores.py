"""Scores of a fold on data whose answers are known."""

import numpy as np
import pandas as pd
import pytest
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.dummy import DummyClassifier
from sklearn.neighbors import KNeighborsClassifier

from texclass.suite.fold_scores import Choice, auroc_of_unknown, evaluate_fold, unknown_groups

SURFACES = np.repeat(["cork", "felt", "oak"], 40)
TRAIN, TEST = np.flatnonzero(np.arange(120) % 2 == 0), np.flatnonzero(np.arange(120) % 2)


def blobs(distance):
    """Return points around three corners, shape (120, 2), and a column without information."""
    rng = np.random.default_rng(1)
    corners = distance * np.array([[0, 0], [1, 0], [0, 1]])[np.repeat(range(3), 40)]
    return np.column_stack([corners + rng.normal(size=(120, 2)), rng.normal(size=120)])


def frame():
    return pd.DataFrame({"recording_id": [f"r{i}" for i in range(120)], "surface": SURFACES})


def inner_splits(shift=0):
    half = TRAIN.size // 2
    order = np.random.default_rng(2).permutation(TRAIN)
    return [(order[:half], order[half:]), (order[half:], order[:half])]


def choice(name="lda", columns=(0, 1), classifier=None, novelty="decision"):
    return Choice(name, np.array(columns), None, classifier or LinearDiscriminantAnalysis(), novelty)


def evaluate(choices, distance=5.0, inner=None):
    inner = inner_splits() if inner is None else inner
    groups = unknown_groups(np.unique(SURFACES), 0, 1)
    return evaluate_fold(choices, blobs(distance), frame(), (TRAIN, TEST), inner, groups, lambda one: 2.0)


def test_the_choice_is_selected_inside_the_training_set():
    scores, hits = evaluate([choice("noise", columns=(2,)), choice("good"), choice("same as good")])
    assert scores["choice"] == "good"  # the first of equally accurate choices
    assert scores["accuracy"] == hits.mean() > 0.97


def test_swapped_labels_of_the_test_set_do_not_change_the_selection():
    table = frame()
    table.loc[TEST, "surface"] = np.roll(SURFACES, 40)[TEST]
    groups = unknown_groups(np.unique(SURFACES), 0, 1)
    scores, _ = evaluate_fold(
        [choice("noise", columns=(2,)), choice("good")],
        blobs(5.0), table, (TRAIN, TEST), inner_splits(), groups, lambda one: 2.0,
    )  # fmt: skip
    assert scores["choice"] == "good"
    assert scores["accuracy"] < 0.05


def test_calibration_and_coverage_of_a_correct_model():
    scores, _ = evaluate([choice()], distance=2.0)
    assert scores["coverage"] == pytest.approx(0.9, abs=0.1)
    assert scores["ece"] < 0.15
    assert 1 < scores["set_size"] < 2
    assert scores["ms"] > 2.0


def test_without_inner_splits_calibrated_scores_are_undefined():
    scores, _ = evaluate([choice("first"), choice("second")], inner=[])
    assert scores["choice"] == "first"
    assert np.isnan([scores["ece"], scores["coverage"], scores["set_size"]]).all()
    assert np.isfinite(scores["accuracy"])


@pytest.mark.parametrize(
    ("classifier", "novelty", "low", "high"),
    [
        (KNeighborsClassifier(5), "distance", 0.75, 1.0),
        (DummyClassifier(), "decision", 0.5, 0.5),
    ],
)
def test_auroc_of_unknown_surfaces(classifier, novelty, low, high):
    one = choice(classifier=classifier, novelty=novelty)
    groups = unknown_groups(np.unique(SURFACES), 0, 1)
    assert low <= auroc_of_unknown(one, blobs(12.0), SURFACES, (TRAIN, TEST), groups) <= high


def test_each_group_of_surfaces_is_unknown_in_turn():
    names = np.array(["a", "b", "c", "d", "e"])
    groups = [unknown_groups(names, fold, 5) for fold in range(3)]
    assert [group[0].tolist() for group in groups] == [["a", "d"], ["b", "e"], ["c"]]
    assert len(unknown_groups(names, 0, 2)) == 3
    assert unknown_groups(names[:2], 0, 5) == []
