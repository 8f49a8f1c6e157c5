"""Statistics of the leaderboard, against values computed by hand."""

import numpy as np
import pandas as pd
import pytest

from texclass.leaderboard.statistics import (
    by_question,
    critical_difference,
    leakage,
    losses,
    mean_ranks,
    summarize,
    unit_counts,
)
from texclass.suite.cells import COLUMNS


def fold(method, hits, *, dataset="toy", question="same operator", protocol="grouped", number=0, **facts):
    """Return the row of one fold; `hits` maps the number of a unit to (hits, tests)."""
    n_hits, n_tests = np.sum(list(hits.values()), axis=0)
    row = dict.fromkeys(COLUMNS) | {
        "dataset": dataset, "question": question, "protocol": protocol, "method": method, "title": method,
        "fold": number, "accuracy": n_hits / n_tests, "balanced_accuracy": n_hits / n_tests, "ms": 1.0,
        "n_test": n_tests, "n_surfaces": 2, "chance": 0.5, "unit": "run", "n_units": len(hits),
        "unit_hits": " ".join(f"{unit}:{a}/{n}" for unit, (a, n) in hits.items()),
        "choice": "lda", "status": "done", "is_simulated": False, "units_hash": "u", "window_s": np.nan,
    }  # fmt: skip
    return row | facts


def table(*rows):
    return pd.DataFrame(rows, columns=list(COLUMNS))


def all_units(rate, n_units=20):
    """Return the hits of units with ten tests each; `rate` is the number of hits of each unit."""
    rates = np.broadcast_to(rate, n_units)
    return {unit: (int(rates[unit]), 10) for unit in range(n_units)}


def test_units_that_are_tested_in_several_folds_are_summed():
    rows = table(fold("a", {0: (3, 4), 2: (1, 1)}), fold("a", {2: (0, 2)}, number=1))
    assert unit_counts(rows).loc[2].tolist() == [1, 3]


def test_accuracy_is_pooled_over_tests_and_the_worst_fold_is_kept():
    rows = table(fold("a", {0: (9, 10)}), fold("a", {1: (10, 30)}, number=1))
    (line,) = summarize(rows).to_dict("records")
    assert (line["accuracy"], line["worst"], line["n_tests"]) == (19 / 40, 10 / 30, 40)
    assert line["balanced_accuracy"] == pytest.approx((10 * 0.9 + 30 / 3) / 40)  # weighted by tests


def test_a_clear_difference_is_no_tie_and_a_small_one_is():
    rng = np.random.default_rng(0)
    noise = rng.integers(-1, 2, 20)
    rows = table(fold("best", all_units(8 + noise)), fold("close", all_units(8)), fold("worse", all_units(4)))
    ties = summarize(rows).set_index("method")["is_tied"].to_dict()
    assert ties == {"best": True, "close": True, "worse": False}


def test_differences_are_paired_over_units():
    # Both methods vary between units in the same way, so that a difference of one hit per unit is clear.
    level = np.tile([2, 9], 10)
    rows = table(fold("a", all_units(level)), fold("b", all_units(level - 1 - (np.arange(20) % 4 == 0))))
    line = summarize(rows).set_index("method").loc["b"]
    assert line["difference_low"] > 0
    assert not line["is_tied"]
    assert line["low"] < summarize(rows).set_index("method").loc["a", "accuracy"]  # intervals overlap


def test_failures_are_kept_and_never_the_best():
    failed = fold("broken", all_units(9)) | {"status": "failed", "message": "out of time", "accuracy": None}
    summary = summarize(table(failed, fold("a", all_units(5)))).set_index("method")
    assert summary.loc["broken", "message"] == "out of time"
    assert np.isnan(summary.loc["broken", "accuracy"])
    assert summary.loc["a", "difference"] == 0


def test_leakage_is_the_paired_difference_of_published_and_honest_split():
    rows = table(
        fold("a", all_units(9), question="published", protocol="shuffled-windows"),
        fold("a", all_units(7 + np.arange(20) % 2)),
    )
    (line,) = leakage(rows).to_dict("records")
    assert line["leakage"] == pytest.approx(0.9 - 0.75)
    assert 0.1 < line["low"] < line["leakage"] < line["high"] < 0.2


def test_a_split_that_is_published_and_honest_hides_nothing():
    rows = table(fold("a", all_units(9), question="published"), fold("a", all_units(9)))
    assert leakage(rows).empty


def test_few_shot_protocols_are_no_measure_of_leakage():
    rows = table(
        fold("a", all_units(9), question="published", protocol="shuffled-windows"),
        fold("a", all_units(3), question="few-shot", protocol="few-shot"),
    )
    assert leakage(rows).empty


def test_questions_are_averaged_over_datasets_unless_a_method_failed_on_one():
    failed = fold("b", all_units(9), dataset="two") | {"status": "failed", "message": "no", "accuracy": None}
    rows = table(
        fold("a", all_units(6)),
        fold("a", all_units(8), dataset="two"),
        fold("b", all_units(9)),
        failed,
        fold("a", all_units(3), question="few-shot", protocol="few-shot"),
        fold("a", all_units(7), question="few-shot", protocol="few-shot", number=1),
    )
    questions = by_question(summarize(rows))
    assert questions.loc["a", "same operator"] == pytest.approx(0.7)
    assert np.isnan(questions.loc["b", "same operator"])
    assert questions.loc["a", ["few-shot", "few-shot, worst"]].tolist() == pytest.approx([0.5, 0.3])


def test_critical_difference_is_that_of_demsar():
    # Demsar (2006), table 5: q = 2.569 for 4 classifiers, so CD = 2.569 sqrt(4 5/(6 14)) for 14 datasets.
    assert critical_difference(4, 14) == pytest.approx(2.569 * np.sqrt(20 / 84), abs=2e-3)


def test_ranks_average_the_protocols_of_a_dataset_and_ignore_published_splits():
    rows = table(
        fold("a", all_units(9)),
        fold("b", all_units(8)),
        fold("a", all_units(5), question="later", protocol="chronological"),
        fold("b", all_units(6), question="later", protocol="chronological"),
        fold("a", all_units(1), question="published", protocol="shuffled-windows"),
        fold("b", all_units(9), question="published", protocol="shuffled-windows"),
        fold("a", all_units(9), dataset="two"),
        fold("b", all_units(7), dataset="two"),
    )
    ranks = mean_ranks(summarize(rows))
    assert ranks.set_index("method")["rank"].to_dict() == {"a": (1.5 + 1) / 2, "b": (1.5 + 2) / 2}
    assert ranks.attrs["n_datasets"] == 2
    assert ranks["is_tied"].all()


def test_losses_begin_with_the_largest():
    rows = table(
        fold("ours", all_units(6)),
        fold("other", all_units(7)),
        fold("ours", all_units(2), dataset="two"),
        fold("other", all_units(9), dataset="two"),
        fold("ours", all_units(9), dataset="three"),
        fold("other", all_units(7), dataset="three"),
    )
    lost = losses(summarize(rows), "ours")
    assert lost["dataset"].tolist() == ["two", "toy"]
    assert lost["best_accuracy"].tolist() == [0.9, 0.7]
