"""Content of the documents of results, on a terminal and in Markdown."""

import re
from itertools import pairwise

import pytest
from example_results import FILES, HOSTILE, document, everywhere, result

from texclass.evaluation.ablation import verdict
from texclass.reporting import Figure, HeatMap, Table, render_markdown, write_document
from texclass.reporting.figure_style import NARROW, WIDTH, draw_block

KINDS = [file.stem for file in FILES]


def table(report, i=0):
    """Return the cells of a document's table by the name of its row."""
    frame = [block for block in report.blocks if isinstance(block, Table)][i].frame
    return {row[0]: list(row[1:]) for row in frame.itertuples(index=False)}


def figure(report, name):
    return next(
        block for block in report.blocks if isinstance(block, Figure | HeatMap) and block.name == name
    )


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("benchmark", ["Pipeline small: 100 recordings of 3 surfaces", "leave one operator out, 2 folds",
                       "[82.6, 94.5] of the recordings", "best of 3 pairs", "Columns selected in All",
                       "mfcc.c1 100%", "significantly (corrected p below 0.05)", "exact McNemar test",
                       "not evaluated: no friction signal", "onerror"]),
        ("feature", ["crest", "2 ms per recording alone; 0.5 ms more", "mfcc.c1 -0.50", "R² = 0.20",
                     "1 of 1 results", "declared y(g x) = g y; measured the same", "+5.0"]),
        ("tradeoff", ["89.5", "of the 8 ms of the full set", "1 column of mfcc", "2.2 ms measured",
                      "deviates from the measured cost of 1 random subset by at most 5 %",
                      "4 ms for every selection"]),
        ("baselines", ["+5.0 points", "ours is better", "In total, ours is 1 times as fast", "ours: All",
                   "not installed",
                   "exact McNemar", "60 s"]),
        ("comparison", ["+5.0 points", "from 90.0 % to 95.0 %", "6 tests gained, 1 lost", "Seed", "a0",
                        "Added: Friction (LDA)"]),
        ("invariance", ["2.5 times", "related work: 0.5", "Trend"]),
        ("stream_score", ["4 intervals of contact in 2 recordings", "intervals end with the right answer",
                          "1 of 4 intervals", "1 in 30 s", "tin (not trained)", "left out: bad.csv",
                          "lost: 40 samples"]),
        ("stability", ["of 2 pairs of subject and input are wrong", "same rules: 1 of 2", "not installed"]),
    ],
)  # fmt: skip
def test_every_result_is_shown_on_the_terminal_and_in_markdown(kind, said):
    for report in everywhere(document(kind)):
        for text in said:
            assert text in report, text


@pytest.mark.parametrize("kind", KINDS)
def test_reports_contain_their_figures_and_what_is_needed_to_reproduce_them(kind, tmp_path):
    written = write_document(document(kind), tmp_path, "x", json="{}")
    assert [path.suffix for path in written[:2]] == [".json", ".md"]
    text = written[1].read_text(encoding="utf-8")
    assert re.search(r"^- \w*[Ss]eed: \d+$", text, re.M)
    assert "- Versions: texclass 1" in text
    for path in written[2:]:
        assert f"]({path.name})" in text
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert all(line.replace("\\|", "").endswith("|") for line in lines)


def test_a_row_holds_ours_with_its_interval_then_the_published_figure():
    rows = table(document("benchmark"))
    assert rows["All"] == ["90.0 [82.6, 94.5]", "86", "80.0 [71.1, 86.7]", "12", "3.50"]
    assert "Friction not evaluated: no friction signal" in everywhere(document("benchmark"))[0]


def test_windows_have_their_balance_and_the_vote_of_each_run():
    data = result("benchmark")
    data["dataset"]["n_windows"] = 800
    for accuracy in accuracies(data):
        accuracy |= {"interval": "t over runs", "clusters": "run", "n_clusters": 8}
        accuracy["per_run"] = accuracy.pop("per_recording", {"mean": 1.0, "low": 0.4, "high": 1.0})
    report = document("benchmark", data)
    assert table(report, 1)["All"] == ["85.0", "90.0 [69.9, 97.2]", "80.0", "100.0 [40.0, 100.0]"]
    for text in everywhere(report):
        for said in ("800 windows of 100 recordings", "fraction of windows", "over 8 runs", "majority"):
            assert said in text


def accuracies(data):
    """Return the accuracies of a benchmark, to be changed."""
    return [accuracy for row in data["rows"] for accuracy in row["accuracy"].values()]


def nothing_published(data):
    for row in data["rows"]:
        row["paper"] = {}


def as_balanced(data):
    for accuracy in accuracies(data):
        accuracy["balanced"] = accuracy["mean"]
        accuracy.pop("per_recording", None)


def nothing_computed(data):
    data |= {"confusion": None, "ablation": None}
    for row in data["rows"]:
        row |= {"accuracy": {}, "missing": "no taps"}


def over_operators(data, interval, n, **more):
    for accuracy in accuracies(data):
        accuracy |= {
            "interval": f"{interval} over operators",
            "clusters": "operator",
            "n_clusters": n,
            **more,
        }


NESTED_CV = {
    "accuracy": {"mean": 0.7, "low": 0.604, "high": 0.781}, "inner_protocols": ["chronological"],
    "selected": [["All", "lda"], ["Level", "lda"], ["All", "lda"]],
}  # fmt: skip
PROBLEMS = {
    "left_out": [["r1", "empty"]],
    "flags": [[f"r{i}", "clipped"] for i in range(9)],
    "undefined": [{"feature": "waviness", "reason": "too short", "n_recordings": n} for n in (3, 100)],
}


@pytest.mark.parametrize(
    ("change", "said", "unsaid"),
    [
        (lambda d: None, ["Balanced: mean recall over surfaces."], []),
        (nothing_published, ["No row of this table has a published accuracy."], ["aper"]),
        (as_balanced, [], ["Further accuracies"]),
        (nothing_computed, ["of the rows could be evaluated", "not evaluated: no taps"], []),
        (lambda d: d["rows"][0].update(paper={}), ["−10.0 points", "% for Row"], []),
        (lambda d: d.update(nested_cv=NESTED_CV),
         ["70.0 %", "[60.4, 78.1] of the recordings of 3 surfaces classified correctly, with row and",
          "Selected: All with LDA (2 of 3 folds); Level with LDA (1 of 3 folds).",
          "Optimistic: 90.0 % [82.6, 94.5] by All with LDA, the best of 3 pairs of row and classifier"],
         []),
        (lambda d: d.update(PROBLEMS),
         ["Recordings left out, 1: r1: empty.", "r5: clipped; and 3 more in the JSON file.",
          "waviness in 3 of 100: too short"], ["100 of 100"]),
        (lambda d: over_operators(d, "Wilson", 3),
         ["95 % confidence interval over 3 operators", "3 operators are too few to show their spread"], []),
        (lambda d: over_operators(d, "t", 7, mean=0.97),
         ["Near 0 or 100 % the interval of 7 operators may be too narrow."], []),
    ],
)  # fmt: skip
def test_special_cases_of_a_benchmark_are_reported(change, said, unsaid):
    data = result("benchmark")
    change(data)
    for report in everywhere(document("benchmark", data)):
        assert all(text in report for text in said), [text for text in said if text not in report]
        assert not any(text in report for text in unsaid)


def test_each_cell_of_the_confusion_matrix_has_count_and_description():
    heat = figure(document("benchmark"), "confusion")
    assert heat.summary.startswith("3 of 30 recordings are misclassified")
    shade = heat.rows[HOSTILE][0]
    assert shade == ("d5", "9", "9 of 10 recordings (90 %)")
    assert heat.rows[HOSTILE][1].colour == "e1"
    assert not heat.rows[HOSTILE][2].text


@pytest.mark.parametrize(
    ("change", "low", "high"),
    [
        (lambda data: None, 40, 90),
        (lambda data: data["rows"].pop(1), 80, 95),
        (lambda data: data["rows"][1]["accuracy"]["lda"].update(mean=0.1, low=0.05), 0, 10),
    ],
)
def test_the_accuracy_axis_starts_below_the_lowest_interval(change, low, high):
    data = result("benchmark")
    change(data)
    for width in (WIDTH, NARROW):
        (axes,) = draw_block(figure(document("benchmark", data), "ranking"), width).axes
        begin, end = axes.get_xlim()
        assert begin <= low
        assert low - begin <= 12
        assert end >= 100
        labels = {line.get_label() for line in axes.lines}
        assert ("chance, 33.3 %" in labels) == (begin < 100 / 3)
        assert ("chance, 33.3 %, is below" in labels) == (begin > 100 / 3)


def test_every_classifier_is_drawn_and_told_and_every_row_costs():
    report = document("benchmark")
    ranking = figure(report, "ranking")
    (axes,) = draw_block(ranking).axes
    said = [line.get_gid() for line in axes.lines if line.get_gid() and "All" in line.get_gid()]
    assert said == ["All, LDA: published 86 %", "All, LDA: ours 90.0 [82.6, 94.5] %",
                    "All, Naive Bayes: ours 80.0 [71.1, 86.7] %"]  # fmt: skip
    assert ranking.table.frame["Classifier"].tolist() == ["LDA", "Naive Bayes", "LDA"]
    costs = figure(report, "row-costs")
    assert (
        "All, 3.5 ms per recording, is the most accurate row; no faster row has an accuracy within 5 points"
        in costs.summary
    )
    assert [text.get_text() for text in draw_block(costs).axes[0].texts] == ["90.0 %", "50.0 %"]


def test_a_recording_and_its_phases_come_before_the_table_where_the_result_holds_one():
    data = result("benchmark")
    report = document("benchmark", data)
    assert report.blocks[0].name == "example"
    assert "s): 1 tap, movement from 1.00 to 2.00 s." in report.blocks[0].summary
    assert report.blocks[0].table.frame["Phase"].tolist() == ["tap 1", "movement"]
    for width in (WIDTH, NARROW):
        (axes,) = draw_block(report.blocks[0], width).axes
        assert axes.get_legend_handles_labels()[1] == ["signal", "tap: hand, impact, decay", "movement"]
    del data["example"]
    assert not any(getattr(block, "name", "") == "example" for block in document("benchmark", data).blocks)


def test_the_bars_of_one_feature_do_not_overlap():
    (axes,) = draw_block(figure(document("tradeoff"), "costs")).axes
    places = sorted((bar.get_y(), bar.get_y() + bar.get_height()) for bar in axes.patches)
    assert all(end <= start for (_, end), (start, _) in pairwise(places))


def test_the_verdict_of_an_ablation_names_significant_groups_only():
    ablation = result("benchmark")["ablation"]
    assert "groups change the accuracy significantly (corrected p below 0.05): taps +5.0 points." in verdict(
        ablation
    )
    ablation["groups"][0]["p_corrected"] = 0.4
    assert verdict(ablation) == (
        "No significant difference with taps (corrected p below 0.05); minimum detectable difference at 80 % "
        "power with 40 recordings: 7 points; try more recordings, or `--window 1`."
    )
    ablation["groups"][0]["comparison"] |= {"clusters": "operator", "n_clusters": 5}
    assert "a sign test of 5 operators cannot reach 5% (at best 6.2%); try more operators" in verdict(
        ablation
    )
    assert "no gain is possible" in verdict(ablation | {"base": {"accuracy": 1}})
    assert verdict(ablation | {"groups": ablation["groups"][1:]}) == "The dataset has none of the groups."
    report = document("benchmark")
    assert table(report, 2)["+ taps"] == ["15", "95.0", "+5.0 [+1.0, +9.0]", "2/1", "0.012", "0.024", "4.00"]
    (axes,) = draw_block(figure(report, "gains")).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["+ taps"]


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (None, "not measured"),
        ({"declared": {"power": 2, "shift": 0}, "measured": {"power": 2, "shift": 0}, "deviation": 1e-15,
          "holds": True}, "declared y(g x) = g^2 y; measured the same"),
        ({"declared": {"power": 0, "shift": -20}, "measured": {"power": 0.5, "shift": 1}, "deviation": 0.99,
          "holds": False}, "y(g x) = y - 20 log10 g; BROKEN by 0.99; measured y(g x) = g^0.5 y + log10 g"),
        ({"declared": {"power": 0, "shift": 0}, "measured": {"power": 0, "shift": 0}, "deviation": 0.5,
          "measured_deviation": 0.5, "holds": False}, "measured another law, neither a power nor a shift"),
    ],
)  # fmt: skip
def test_a_gain_law_is_shown_as_an_equation(law, said):
    data = result("feature")
    data["new_feature"]["gain_law"] = law
    assert said in everywhere(document("feature", data))[0]


def test_a_feature_that_violates_the_contract_or_has_no_base_row_is_reported():
    data = result("feature")
    data["new_feature"]["degenerate_inputs"].append(
        {"input": "one NaN", "outcome": "no reason", "detail": "nan", "is_valid": False}
    )
    report, _ = everywhere(document("feature", data))
    assert "1 of 2 results meet the feature contract" in report
    assert "one NaN no reason nan INVALID" in report
    assert (
        "there is no row to which it can be added"
        in everywhere(document("feature", data | {"ablation": None}))[0]
    )


def test_the_front_marks_knee_half_and_the_full_set():
    rows = table(document("tradeoff"))
    assert rows["2"][-1] == "knee point, half the cost"
    assert rows["full set"][:2] == ["8", "2"]
    data = result("tradeoff")
    data["dataset"] |= {"surfaces": ["oak", "felt"], "max_seconds": 2.0}
    report, _ = everywhere(document("tradeoff", data))
    assert "for oak, felt" in report
    assert "2 s of each" in report


def test_who_did_not_finish_is_told_with_the_reason():
    data = result("baselines")
    late = data["contestants"][1] | {
        "name": "quant", "title": "QUANT", "status": "out of time", "message": "stopped after 9 s",
        "n_folds": 1, "reference": "10,000 kernels",
    }  # fmt: skip
    data["contestants"].append(late)
    text = " ".join(render_markdown(document("baselines", data)).split())
    for said in ("QUANT, Ridge: stopped after 9 s", "1 of 2 folds", "needs tsfel", "10,000 kernels", "aeon"):
        assert said in text
    axes = draw_block(figure(document("baselines", data), "time")).axes[0]
    assert {text.get_text() for text in axes.texts} == {"1", "2", "3"}
    del data["contestants"][1]
    assert (
        "of the baselines can be compared with ours on every fold."
        in everywhere(document("baselines", data))[0]
    )


def test_long_names_of_tools_are_broken_where_the_figure_is_narrow():
    data = result("baselines")
    data["contestants"][0]["title"] = "ours: " + "a long name " * 6
    (axes,) = draw_block(figure(document("baselines", data), "time"), NARROW).axes
    lines = [line for label in axes.get_legend_handles_labels()[1] for line in label.split("\n")]
    assert max(map(len, lines)) <= 11 * NARROW


def test_the_features_of_the_study_are_ordered_by_their_worst_condition():
    shown = figure(document("invariance"), "ratios")
    (axes,) = draw_block(shown).axes
    assert axes.get_yticklabels()[0].get_text() == "mfcc (texclass)"
    assert shown.table.frame["Ratio"].tolist() == ["2", "3", "0.5", "undefined"]


def test_published_figures_are_a_measure_only_of_as_many_surfaces_under_the_same_protocol():
    for changed, why in (
        ({"protocol": "chronological"}, "protocol `chronological` here, `operator` in the publication"),
        (
            {"published_on": {"n_surfaces": 69, "protocols": ["operator"]}},
            "3 surfaces here, 69 in the publication",
        ),
        ({"published_on": None}, "the pipeline does not state the number of surfaces and the protocol"),
    ):
        report = document("benchmark", result("benchmark") | changed)
        for text in everywhere(report):
            assert why in text
            assert "points [" not in text.partition("All rows, with")[0]
            assert "reach their published" not in text
        assert not any(figure(report, "ranking").table.frame["Points"])


def test_the_chance_level_is_next_to_every_accuracy_in_text_and_figure():
    for kind, name in (("benchmark", "ranking"), ("tradeoff", "front"), ("baselines", "time")):
        report = document(kind)
        assert "chance" in report.finding.sentence
        for text in everywhere(report):
            assert "chance level" in text.lower()
        (axes,) = draw_block(figure(report, name), WIDTH).axes
        assert any("chance" in label for label in axes.get_legend_handles_labels()[1])


def test_what_was_chosen_with_the_tests_in_view_is_named_and_no_figure_is_of_another_run():
    choice = {"accuracy": {"mean": 0.818, "low": 0.777, "high": 0.853}}
    report, _ = everywhere(document("baselines", result("baselines") | {"choice": choice, "n_pairs": 20}))
    assert "Ours is the most accurate of 20 pairs of row and classifier, selected on the test folds" in report
    assert "81.8" not in report
    assert "selected on the test folds, optimistic" in everywhere(document("tradeoff"))[0]


def test_the_note_of_a_row_stands_below_the_table_once_the_row_has_an_accuracy():
    data = result("benchmark")
    data["rows"][0]["note"] = "amplitudes act before the logarithm"
    expected = f"{data['rows'][0]['name']}: amplitudes act before the logarithm."
    assert expected in everywhere(document("benchmark", data))[1]
    data["rows"][0]["accuracy"] = {}
    assert "before the logarithm" not in everywhere(document("benchmark", data))[1]
