"""Comparison of two results on the same folds."""

import copy
import json
from pathlib import Path

import pytest
from toy_noises import CLASSIFIERS, row

import texclass as tx
from texclass.baselines import BaselineComparison
from texclass.evaluation import BenchmarkResult
from texclass.evaluation.benchmark import run_benchmark
from texclass.evaluation.result_comparison import compare_results
from texclass.reporting import render_markdown
from texclass.reporting.result_files import Study, read_result

SMALL = Path(__file__).parents[1] / "reporting" / "data" / "benchmark.json"


@pytest.fixture
def data():
    """Benchmark of 100 recordings of two operators, of which the best pair predicts 90 correctly."""
    values = read_result(SMALL).data
    for row_values in values["rows"]:
        for accuracy in row_values["accuracy"].values():
            accuracy |= {"clusters": "operator", "n_clusters": 2}
    recordings = [[f"{operator}{i}" for i in range(50)] for operator in "ab"]
    values["tests"] = {
        "folds_hash": "0123", "recordings": recordings, "units": [["a"] * 50, ["b"] * 50],
        "n_train": [50, 50], "hits": {"best": ["1" * 45 + "0" * 5] * 2},
    }  # fmt: skip
    return values


def changed(data, **values):
    return BenchmarkResult({**copy.deepcopy(data), **values})


def test_the_difference_is_paired_and_its_tests_are_the_operators(data):
    second = changed(data)
    second.data["tests"]["hits"]["best"] = ["0" + "1" * 48 + "0", "1" * 47 + "000"]
    comparison = compare_results(BenchmarkResult(data), second).data
    (one,) = comparison["accuracies"]
    assert one["lost"] == ["a0"]
    assert one["gained"] == ["a45", "a46", "a47", "a48", "b45", "b46"]
    difference = one["difference"]
    assert difference["difference"] == pytest.approx(0.05)
    assert (difference["clusters"], difference["n_clusters"]) == ("operator", 2)
    assert difference["low"] < 0.05 < difference["high"]
    assert difference["p_value"] == 0.5  # two operators, both better
    back = compare_results(second, BenchmarkResult(data)).data["accuracies"][0]
    assert (back["lost"], back["gained"]) == (one["gained"], one["lost"])
    assert back["difference"]["difference"] == pytest.approx(-0.05)


def test_changed_settings_and_rows_are_listed(data):
    rows = copy.deepcopy(data["rows"])
    rows[0]["accuracy"]["lda"]["mean"] = 0.95
    del rows[0]["accuracy"]["naive_bayes"]
    rows[2]["accuracy"]["lda"] = rows[0]["accuracy"]["lda"]
    second = changed(data, rows=rows, seed=8, versions={"texclass": "9.9"}, input_hash="def")
    comparison = compare_results(BenchmarkResult(data), second)
    settings = {key: values for key, *values in comparison.data["settings"]}
    assert settings["Seed"] == [7, 8]
    assert settings["Input hash"] == ["abc", "def"]
    assert settings["Version of texclass"][1] == "9.9"
    assert "Protocol" not in settings
    text = render_markdown(comparison.document())
    assert "Added: Friction (LDA)" in text
    assert "Removed: All (Naive Bayes)" in text
    assert "1 of 2 accuracies are the same in both results" in text
    assert json.loads(comparison.to_json())["kind"] == "comparison"


def test_a_result_compared_with_itself_has_no_differences(data):
    comparison = compare_results(BenchmarkResult(data), BenchmarkResult(data))
    assert comparison.data["settings"] == []
    assert comparison.document().finding.value == "+0.0"
    text = render_markdown(comparison.document())
    assert "No setting, version or code has changed." in text
    assert "None." in text


def test_other_folds_recordings_and_kinds_are_refused_with_what_differs(data):
    first = BenchmarkResult(data)
    other = changed(data, seed=8, protocol="recording")
    other.data["tests"] |= {"folds_hash": "4567"}
    other.data["tests"]["recordings"][0][0] = "z"
    expected = (
        "cannot compare first result with second result, because their folds differ: 1 recording only in the "
        "first (for example a0); 1 recording only in the second (for example z); protocol operator and "
        "recording; seed 7 and 8."
    )
    with pytest.raises(ValueError, match="because their folds differ") as refused:
        compare_results(first, other)
    assert expected in str(refused.value)
    same = changed(data)
    same.data["tests"]["folds_hash"] = "89"
    with pytest.raises(ValueError, match="the same recordings, in other training or test sets"):
        compare_results(first, same)
    with pytest.raises(ValueError, match=r"cannot compare .* Expected two results of the same kind"):
        compare_results(first, Study({}))
    with pytest.raises(ValueError, match="second result contains no predictions"):
        compare_results(first, read_result(SMALL))


def test_two_benchmarks_differ_by_the_added_row(toy_dataset, pipeline, tmp_path):
    euclidean = {"euclidean": CLASSIFIERS["euclidean"]}
    one = pipeline(row("Chance", "rarely"), classifiers=euclidean)
    two = pipeline(row("Chance", "rarely"), row("Level", "level"), classifiers=euclidean)
    files = []
    for name, definition in (("a", one), ("b", two)):
        files.append(tmp_path / f"{name}.json")
        files[-1].write_text(run_benchmark(toy_dataset(3, 8), definition).to_json())
    comparison = tx.compare_results(*files).data
    nested = comparison["accuracies"][0]
    means = [nested[side]["mean"] for side in ("first", "second")]
    assert nested["name"] == "nested_cv"
    assert nested["difference"]["difference"] == pytest.approx(means[1] - means[0])
    assert len(nested["gained"]) - len(nested["lost"]) == round(24 * (means[1] - means[0])) > 0
    added = [line for line in comparison["rows"] if line["first"] is None]
    assert [line["row"] for line in added] == ["Level"]
    with pytest.raises(ValueError, match="12 recordings only in the first"):
        tx.compare_results(files[0], run_benchmark(toy_dataset(3, 4), two))


def test_baselines_are_compared_by_tool_and_classifier(data):
    accuracy = {"mean": 0.9, "low": 0.8, "high": 0.95, "clusters": "operator", "n_clusters": 2}
    contestants = [
        {"title": "MFCC", "classifier": "lda", "accuracy": accuracy},
        {"title": "TSFEL", "classifier": "", "accuracy": None},
    ]
    tests = {**data["tests"], "hits": {"MFCC, lda": data["tests"]["hits"]["best"]}}
    facts = {key: data[key] for key in ("dataset", "protocol", "n_folds", "seed", "versions", "input_hash")}
    results = [
        BaselineComparison({**facts, "pipeline": name, "contestants": contestants, "tests": tests})
        for name in ("coarse", "texclass")
    ]
    comparison = compare_results(*results).data
    assert comparison["settings"] == [["Pipeline", "coarse", "texclass"]]
    assert [one["name"] for one in comparison["accuracies"]] == ["MFCC, lda"]
