"""The benchmark on a toy dataset, and nested cross-validation, whose selection does not see the test sets."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from scipy.stats import spearmanr
from toy_noises import CLASSIFIERS, FS, STEPS, TINY, a_table, row

from texclass.evaluation.benchmark import inner_splits, rank_agreement, run_benchmark, run_nested_cv
from texclass.evaluation.feature_table import FeatureTable
from texclass.evaluation.pipeline import MatchedRow, Selection, Use, load_pipeline
from texclass.evaluation.protocols import find_protocol
from texclass.recording import RecordingError
from texclass.reporting import render_markdown

ROWS = (
    row("Level", "level", published={"naive_bayes": 90}),
    row("Taps", "knock", "level", published={"naive_bayes": 10}),
    row("Whatever there is", "knock", "level", skip_missing=True),
    row("Selected", "level", "peaks", select=Selection(n=2, folds=2), published={"naive_bayes": 95}),
    row("Chance", "rarely", published={"naive_bayes": 20}),
)

EUCLIDEAN = {"euclidean": CLASSIFIERS["euclidean"]}
PIPELINE = """
features = "strese2015"
seed = 1
[classifiers.euclidean]
use = "sklearn.neighbors.NearestCentroid"
[[rows]]
name = "Level"
features = ["variance"]
"""


@pytest.fixture(scope="module")
def several(pipeline):
    return pipeline(*ROWS)


@pytest.fixture(scope="module")
def result(toy_dataset, several):
    return run_benchmark(toy_dataset(), several)


def test_json_has_the_keys_that_were_promised_and_the_table_the_same_figures(result):
    outcome = json.loads(result.to_json())
    assert outcome == json.loads(json.dumps(result.to_dict()))
    assert outcome["dataset"]["n_recordings"] == 12
    assert {"dataset", "protocol", "rows", "versions", "seed", "input_hash"} <= set(outcome)
    assert {"texclass", "numpy", "scikit-learn"} <= set(outcome["versions"])
    for line in outcome["rows"]:
        keys = {"name", "n_features", "accuracy", "paper", "ms_per_recording", "missing"}
        assert keys <= set(line)
        for classifier, accuracy in line["accuracy"].items():
            assert 0 <= accuracy["low"] <= accuracy["mean"] <= accuracy["high"] <= 1
            table = result.table.set_index(["row", "classifier"])
            assert table.loc[(line["name"], classifier), "mean"] == accuracy["mean"]
    assert outcome["rows"][0]["paper"] == {"naive_bayes": 0.9}
    assert len(result.table) == sum(len(line["accuracy"]) for line in outcome["rows"])


def test_a_result_is_told_in_a_line_and_a_table_written_and_drawn(result, tmp_path):
    assert repr(result) == (
        "<BenchmarkResult: toy, toy, recording; nested cross-validation 91.7 %; best 100.0 %, Level with "
        "euclidean>"
    )
    assert result._repr_html_().count("<tr") == 1 + len(result.table)
    written = result.save(tmp_path)
    assert {path.suffix for path in written} >= {".json", ".md", ".png", ".csv"}
    (lines,) = ([*csv.reader(path.read_text().splitlines())] for path in written if path.suffix == ".csv")
    confusion = result.data["confusion"]
    assert lines[0] == ["true label", *confusion["surfaces"]]
    assert [[label, *map(int, row)] for label, *row in lines[1:]] == [
        [label, *row] for label, row in zip(confusion["surfaces"], confusion["counts"], strict=True)
    ]
    assert json.loads(next(tmp_path.glob("*.json")).read_text()) == json.loads(result.to_json())
    axes = result.plot("naive_bayes", Figure().add_subplot())
    assert "Level" in " ".join(label.get_text() for label in axes.get_yticklabels())
    published = [line.get_xdata()[0] for line in axes.lines if line.get_marker() == "D"]
    assert published == pytest.approx([90, 95, 20])


def test_a_result_contains_facts_hashes_undefined_features_and_an_example_recording(result, several):
    facts, example = result.data["dataset"], result.data["example"]
    assert (facts["fs_hz"], facts["unit"], facts["n_surfaces"], facts["chance"]) == (FS, "m/s^2", 3, 1 / 3)
    assert len(result.data["code_hash"]) == 16
    assert result.data["movement"] == "hand motion kept, as printed"
    assert result.data["pipeline"]["features_hash"] == several.features.hash
    assert set(zip(result.table["clusters"], result.table["n_clusters"], strict=True)) == {("recording", 12)}
    undefined = {u["feature"]: u for u in result.data["undefined"]}
    assert undefined["knock"]["n_recordings"] == 12
    assert undefined["rarely"]["reason"] == "starts above 0"
    assert 0 < undefined["rarely"]["n_recordings"] < 12
    assert len(example["low"]) == len(example["high"]) >= 300
    low, high = np.array(example["low"]), np.array(example["high"])
    assert (low <= high).all()
    assert (low[1:] <= high[:-1]).all()  # each block touches the next
    assert (high[1:] >= low[:-1]).all()
    assert example["recording"]
    assert 0 <= example["movement"][0] < example["movement"][1] <= example["seconds"]


def test_separable_levels_are_recognised_and_confused_with_nothing(result):
    assert result.data["rows"][0]["accuracy"]["euclidean"]["mean"] == 1.0
    assert result.data["confusion"]["counts"] == [[4, 0, 0], [0, 4, 0], [0, 0, 4]]
    assert result.best[0] == "Level"
    agreement = result.data["rank_agreement"]
    assert agreement["euclidean"] is None  # nothing is published
    lines = (result.data["rows"][i] for i in (0, 3, 4))  # those that are computed and published
    ours = [line["accuracy"]["naive_bayes"]["mean"] for line in lines]
    assert agreement["naive_bayes"] == pytest.approx(spearmanr(ours, [90, 95, 20]).statistic)
    assert agreement["naive_bayes"] > 0.4


def test_a_row_that_lacks_a_phase_says_so_and_one_that_selects_how_often_what(result):
    level, taps, whatever, selected, _ = result.data["rows"]
    assert (taps["missing"], taps["accuracy"], taps["n_features"]) == ("no tap found (knock)", {}, 2)
    assert taps["ms_per_recording"] is None
    assert (whatever["missing"], whatever["n_features"]) == ("no tap found (knock)", 1)
    assert whatever["accuracy"] == level["accuracy"]
    assert selected["n_features"] == 2
    assert sum(selected["selected"]["naive_bayes"].values()) == pytest.approx(2)


def test_each_classifier_selects_for_itself(toy_dataset, pipeline):
    selecting, outcome = row("Selected", "peaks", select=Selection(n=1, folds=2)), []
    for classifiers in (CLASSIFIERS, EUCLIDEAN):
        result = run_benchmark(toy_dataset(3, 8), pipeline(selecting, classifiers=classifiers))
        outcome.append(result.data["rows"][0]["selected"])
    assert outcome[0]["naive_bayes"] != outcome[0]["euclidean"] == outcome[1]["euclidean"]


def test_a_second_run_changes_nothing_but_milliseconds(result, toy_dataset, several):
    def without_ms(result):
        rows = [line | {"ms_per_recording": 0} for line in result.data["rows"]]
        return result.to_dict() | {"segmentation_ms": 0, "rows": rows}

    assert without_ms(run_benchmark(toy_dataset(), several)) == without_ms(result)


def test_an_impossible_protocol_is_refused_before_anything_is_loaded(toy_dataset, several):
    dataset = toy_dataset()
    with pytest.raises(ValueError, match="surface m0 has 4 recordings; 10 folds need at least 10 of each"):
        run_benchmark(dataset, several, n_folds=10)
    assert dataset.load.loaded == []


def test_bad_recordings_stop_the_run_or_are_listed(toy_dataset, several):
    dataset = toy_dataset(n_repetitions=5, bad=("m1_3",))
    with pytest.raises(RecordingError, match="m1_3"):
        run_benchmark(dataset, several)
    result = run_benchmark(dataset, several, skip_bad=True)
    assert [name for name, _ in result.data["left_out"]] == ["m1_3"]
    assert result.data["dataset"]["n_recordings"] == 14


def test_dataset_and_pipeline_may_be_named(tmp_path):
    (tmp_path / "tiny.toml").write_text(TINY)
    (tmp_path / "few.toml").write_text(PIPELINE)
    result = run_benchmark(tmp_path / "tiny.toml", str(tmp_path / "few.toml"), n_folds=2)
    assert (result.data["dataset"]["n_surfaces"], result.data["pipeline"]["name"]) == (3, "few")


def test_intervals_and_nested_cross_validation_are_over_held_out_operators(toy_dataset, pipeline):
    few = pipeline(row("Chance", "rarely", "level"), classifiers=EUCLIDEAN)
    data = run_benchmark(toy_dataset(3, 12, operators=6), few, protocol="operator", nested_cv=True).data
    for outcome in (data["rows"][0]["accuracy"]["euclidean"], data["nested_cv"]["accuracy"]):
        assert (outcome["clusters"], outcome["n_clusters"]) == ("operator", 6)
        assert outcome["interval"].endswith("over operators")


def test_intervals_and_report_are_over_combinations_of_any_labels(toy_dataset, pipeline):
    dataset = toy_dataset(3, 12)
    labels = {r: (("speed", str(20 + 10 * (r % 3))), ("tool", "ab"[r % 2])) for r in range(1, 13)}
    entries = tuple(replace(entry, labels=labels[entry.repetition]) for entry in dataset.entries)
    few = pipeline(row("Level", "level"), classifiers=EUCLIDEAN, steps=())
    result = run_benchmark(replace(dataset, entries=entries), few, protocol="leave-out speed, tool")
    outcome = result.data["rows"][0]["accuracy"]["euclidean"]
    assert (result.data["protocol"], result.data["n_folds"]) == ("leave-out speed,tool", 6)
    assert (outcome["clusters"], outcome["n_clusters"]) == ("speed-tool combination", 6)
    assert result.data["dataset"]["labels"] == {"speed": 3, "tool": 2}
    report = render_markdown(result.document())
    assert "over 6 speed-tool combinations" in report
    assert "3 values of speed, 2 values of tool" in report
    names = sorted({f"{speed}, {tool}" for (_, speed), (_, tool) in labels.values()})
    shares = [f"{name}: {100 * share:.1f}" for name, share in zip(names, outcome["folds"], strict=True)]
    note = re.search(r"Accuracy in % of each speed-tool combination outside .*?: (20.*)\.", report)
    assert note[1] == "; ".join(shares)
    assert result.stem == "toy-toy-leave-out-speed-tool"


def test_several_starts_tell_mean_and_worst_and_count_each_recording_once(toy_dataset, pipeline):
    one = pipeline(row("Peaks", "peaks"), classifiers=EUCLIDEAN, steps=STEPS[1:])
    result = run_benchmark(toy_dataset(3, 16), one, protocol="few-shot 1")
    outcome = result.data["rows"][0]["accuracy"]["euclidean"]
    assert (result.data["n_folds"], result.data["n_starts"], len(outcome["folds"])) == (8, 4, 8)
    assert (
        outcome["worst"]
        == min(outcome["folds"])
        < outcome["mean"]
        == pytest.approx(np.mean(outcome["folds"]))
    )
    assert outcome["n_clusters"] == 3 * 8  # asked of four starts each
    assert np.sum(result.data["confusion"]["counts"]) == 4 * 3 * 8
    text = render_markdown(result.document())
    assert f"Accuracy in the worst fold: {100 * outcome['worst']:.1f} %." in text
    assert re.search(r"Euclidean.* worst", text)
    assert "of 96 tests are misclassified" in text
    assert "1 repetition, several starts, to second half" in text


def test_classifiers_that_reject_single_recordings_have_no_accuracy(toy_dataset, pipeline):
    rows = (row("Level", "level"), row("Selected", "level", "peaks", select=Selection(n=1, folds=2)))
    with_lda = CLASSIFIERS | {"lda": Use(use="sklearn.discriminant_analysis.LinearDiscriminantAnalysis")}
    several = pipeline(*rows, classifiers=with_lda)
    outcome = run_benchmark(toy_dataset(3, 8), several, protocol="few-shot 1").data["rows"]
    assert list(outcome[0]["accuracy"]) == ["naive_bayes", "euclidean"]  # no lda
    assert not outcome[1]["accuracy"]
    assert outcome[1]["missing"] == "its classifiers need more recordings per surface"


def test_the_interval_of_rank_agreement_covers():
    rng, rho, inside = np.random.default_rng(0), 0.8, 0
    for _ in range(300):
        ours, noise = rng.normal(size=(2, 16))
        pairs = zip(ours, rho * ours + np.sqrt(1 - rho**2) * noise, strict=True)
        lines = [{"accuracy": {"lda": {"mean": x}}, "paper": {"lda": y}} for x, y in pairs]
        r, (low, high) = rank_agreement(lines, "lda")
        assert low < r < high
        inside += low <= 6 / np.pi * np.arcsin(rho / 2) <= high
    assert inside / 300 == pytest.approx(0.95, abs=0.03)


@pytest.fixture
def two(pipeline):
    return pipeline(row("Peaks", "peaks"), row("Level", "level"), classifiers=EUCLIDEAN, steps=STEPS[1:])


def choice_of(pipeline, frame):
    """Choose a row and a classifier for some values, blocks first; return it beside every evaluation."""
    table = FeatureTable(frame, pipeline.features.column_names, np.zeros(len(frame)))
    protocol = find_protocol("chronological")
    splits = protocol.split(table.frame, 0, 0)
    rows = [MatchedRow.match(definition, pipeline.features, table) for definition in pipeline.rows]
    evaluations = {
        one.definition.name: {name: pipeline.trial(one, name, table)(splits) for name in pipeline.classifiers}
        for one in rows
    }
    return run_nested_cv(rows, table, splits, pipeline, protocol, evaluations), evaluations


def test_nested_cv_does_not_select_the_row_that_fits_the_tests_by_chance(two):
    """`level` tells surfaces apart in training; `peaks` only in the tests, where `level` is noise."""
    rng, later = np.random.default_rng(0), np.tile(np.arange(20) >= 10, 4)
    truth, noise = np.repeat(np.arange(4.0), 20) + rng.normal(0, 0.05, 80), rng.uniform(0, 3, (2, 80))
    level, *peaks = two.features.restricted_to(["level", "peaks"]).column_names
    values = dict.fromkeys(two.features.column_names, np.zeros(80))
    values |= {level: np.where(later, noise[0], truth)}
    values |= {peak: np.where(later, truth, noise[1]) for peak in peaks}
    choice, evaluations = choice_of(two, a_table(4, 20).assign(**values))
    assert choice["selected"] == [["Level", "euclidean"]]
    assert choice["inner_protocols"] == ["chronological"]
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
        best.append(max(outcome.accuracy.mean for of in evaluations.values() for outcome in of.values()))
    assert np.mean(chosen) == pytest.approx(0.25, abs=0.04)
    assert np.mean(best) > 0.31


def test_nested_cv_uses_the_selected_pair_of_each_fold(toy_dataset, two):
    outcome = run_benchmark(toy_dataset(), two).data
    accuracies = {line["name"]: line["accuracy"] for line in outcome["rows"]}
    chosen = outcome["nested_cv"]["selected"]
    expected = [accuracies[name][classifier]["folds"][k] for k, (name, classifier) in enumerate(chosen)]
    assert outcome["nested_cv"]["accuracy"]["folds"] == expected
    assert len(expected) == 4
    assert outcome["nested_cv_skipped"] is None


def test_hits_of_nested_cv_and_of_the_best_pair_are_listed_with_their_recordings(toy_dataset, two):
    dataset = toy_dataset(3, 6)
    data = run_benchmark(dataset, two).data
    tests = data["tests"]
    assert sorted(name for fold in tests["recordings"] for name in fold) == sorted(
        entry.recording_id for entry in dataset.entries
    )
    for name, accuracy in (
        ("nested_cv", data["nested_cv"]["accuracy"]),
        ("best", data["rows"][1]["accuracy"]["euclidean"]),
    ):
        hits = "".join(tests["hits"][name])
        assert hits.count("1") / len(hits) == accuracy["mean"]
        assert [len(fold) for fold in tests["hits"][name]] == [len(fold) for fold in tests["recordings"]]
    assert tests["units"] is None
    by_operator = run_benchmark(toy_dataset(3, 6, operators=2), two, protocol="operator").data["tests"]
    assert [set(fold) for fold in by_operator["units"]] == [{"o0"}, {"o1"}]
    assert by_operator["folds_hash"] != tests["folds_hash"]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"nested_cv": False}, "was not run: it was switched off (`--no-nested-cv`)."),
        ({"protocol": "paper"}, "was not run: protocol 'paper' fits scaling and selection on the test"),
        (
            {"protocol": "few-shot 1"},
            "a training set cannot be split for nested cross-validation: surface m0 has 1 recording",
        ),
    ],
)
def test_without_nested_cv_the_report_opens_with_the_reason_and_the_best_pair(
    toy_dataset, two, options, reason
):
    result = run_benchmark(toy_dataset(3, 8), two, **options)
    assert result.data["nested_cv"] is None
    finding = result.document().finding
    assert reason in finding.sentence
    assert "the best of 2 pairs of row and classifier, selected on the test folds (optimistic" in finding.rest
    assert finding.value == f"{100 * result.table['mean'].max():.1f}"


def test_a_report_opens_with_nested_cv_and_marks_the_best_pair_in_a_footnote(result):
    document = result.document()
    nested, finding = result.data["nested_cv"], document.finding
    assert finding.value == f"{100 * nested['accuracy']['mean']:.1f}" == "91.7"
    assert "nested cross-validation" in finding.sentence
    assert f"Selected: {nested['selected'][0][0]} with " in finding.sentence
    assert "100.0" not in finding.rest
    text = render_markdown(document)
    assert text.index("91.7 %") < text.index("Optimistic: 100.0 %")
    assert "by Level with Euclidean, the best of 8 pairs of row and classifier, selected on the test" in text


def test_of_rows_with_equal_accuracy_the_one_with_most_columns_is_selected(toy_dataset, pipeline):
    rows = (row("Level", "level"), row("Both", "level", "peaks"))
    widening = pipeline(*rows, classifiers=EUCLIDEAN, steps=STEPS[1:])
    outcome = run_benchmark(toy_dataset(), widening, nested_cv=True).data
    assert [line["accuracy"]["euclidean"]["mean"] for line in outcome["rows"]] == [1.0, 1.0]
    assert outcome["nested_cv"]["selected"] == [["Both", "euclidean"]] * 4


def test_a_single_pair_of_row_and_classifier_needs_no_inner_folds(toy_dataset, pipeline):
    one = pipeline(row("Both", "level", "peaks"), classifiers=EUCLIDEAN, steps=STEPS[1:])
    result = run_benchmark(toy_dataset(), one, protocol="repetition=1 -> repetition=2-4")
    outcome = result.data
    assert outcome["nested_cv"]["inner_protocols"] == []
    assert outcome["nested_cv"]["accuracy"] == outcome["rows"][0]["accuracy"]["euclidean"]
    assert "the only pair of row and classifier: nothing was selected" in result.document().finding.sentence
    assert "Optimistic" not in render_markdown(result.document())


def test_inner_splits_use_the_outer_protocol_where_possible():
    two_operators = a_table(3, 6).assign(operator=np.tile(["a", "a", "a", "b", "b", "b"], 3))
    for protocol, frame, inner in (
        ("recording", a_table(3, 6), "recording"),
        ("chronological", a_table(3, 8), "chronological"),
        ("chronological", a_table(3, 6), "recording"),
        ("few-shot", a_table(3, 8), "recording"),
        ("operator", two_operators, "recording"),  # one is left, and cannot be left out
    ):
        ((train, _), *_) = find_protocol(protocol).split(frame, 3, 0)
        ((name, splits),) = inner_splits(find_protocol(protocol), frame, [(train, None)], 0)
        assert name == inner
        for inner_train, inner_test in splits:
            assert sorted([*inner_train, *inner_test]) == list(range(len(train)))
            assert frame["surface"].iloc[train[inner_train]].value_counts().min() >= 2


def test_nested_cv_rejects_the_paper_protocol_and_single_training_recordings(toy_dataset, two):
    with pytest.raises(
        ValueError, match=r"protocol 'paper' fits scaling and selection on the test recordings"
    ):
        run_benchmark(toy_dataset(), two, protocol="paper", nested_cv=True)
    with pytest.raises(ValueError, match="cannot be split for nested cross-validation"):
        inner_splits(find_protocol("recording"), a_table(3, 2), [(np.arange(6), None)], 0)


RANKS = Path(__file__).parents[2] / "reports" / "studies" / "rank_agreement.json"


def test_the_study_of_rank_agreement_summarizes_its_accuracies_and_finds_the_causes():
    report = json.loads(RANKS.read_text(encoding="utf-8"))
    rows = pd.DataFrame(report["accuracy"])
    published = [row.name for row in load_pipeline("strese2015").rows if row.published]
    assert list(rows["row"].unique()) == published
    assert rows["seed"].nunique() >= 3
    for one in report["results"]:
        chosen = published if one["rows"] == "all" else published[:-2]
        part = rows[(rows["condition"] == one["condition"]) & (rows["classifier"] == one["classifier"])]
        part = part[part["row"].isin(chosen)]
        outcome = [spearmanr(of["ours"], of["published"]).statistic for _, of in part.groupby("seed")]
        np.testing.assert_allclose(one["of_catalogues"], outcome, atol=0.01)
        assert one["mean"] == pytest.approx(np.mean(outcome), abs=0.01)
    means = rows.groupby(["condition", "row", "classifier"])["ours"].mean()
    macroscopic, lpc = "Macroscopic Roughness", "10 LPC Coefficients"
    for name in ("naive_bayes", "euclidean"):
        assert means["no waviness", macroscopic, name] < 0.8 * means["standard", macroscopic, name]
        assert means["low-pass", lpc, name] < 0.5 * means["standard", lpc, name]
    spectrogram = pd.DataFrame(report["spectrogram"])
    lda = spectrogram[spectrogram["classifier"] == "lda"].groupby("n_surfaces")["ours"].mean()
    assert lda.idxmin() == 16
