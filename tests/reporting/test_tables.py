"""What a reader of a report sees."""

import json
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from rich.console import Console

from texclass.experiment.accuracy import Accuracy
from texclass.experiment.feature_table import Flag, LeftOut
from texclass.experiment.nested_choice import NestedChoice
from texclass.experiment.result import BenchmarkResult, Confusion, RowResult, Undefined
from texclass.reporting.cells import cells, header
from texclass.reporting.figures import draw_confusion, draw_ranking, draw_table
from texclass.reporting.report import write_report
from texclass.reporting.tables import benchmark_table, markdown


def a_result(**changes):
    rows = (
        RowResult("Roughness", 2, {"naive_bayes": Accuracy(5, 10), "lda": Accuracy(9, 10)},
                  {"naive_bayes": 25}, 1.5),
        RowResult("Hardness", 2, {}, {"naive_bayes": 14, "lda": 11}, missing="no tap found (hardness)"),
        RowResult("All", 3, {"naive_bayes": Accuracy(10, 10), "lda": Accuracy(2, 10)}, {}, 0.0123,
                  selected={"naive_bayes": {"a": 1.0, "b": 0.5}}),
    )  # fmt: skip
    facts = {"name": "toy", "n_recordings": 10, "n_materials": 2, "notes": ["recorded | by hand"]}
    confusion = Confusion("All", "naive_bayes", ("felt", "oak"), np.array([[5, 0], [0, 5]]))
    fields = {
        "dataset": facts, "pipeline": "p", "pipeline_hash": "ff", "feature_set": "f", "n_folds": 10,
        "classifiers": ("naive_bayes", "lda"), "protocol": "recording", "protocol_description": "folds",
        "rows": rows, "confusion": confusion, "versions": {"texclass": "9.9"}, "seed": 7, "input_hash": "abc",
        "left_out": (LeftOut("r1", "empty"),), "flags": (Flag("r2", "clipped"),),
        "undefined": (Undefined("waviness", "too short", 3), Undefined("hardness", "no tap found", 10)),
    }  # fmt: skip
    return BenchmarkResult(**(fields | changes))


def rendered(result, width=140):
    console = Console(width=width, record=True, file=None, quiet=False)
    with console.capture() as capture:
        console.print(benchmark_table(result))
    return capture.get()


def unpublished():
    return a_result(rows=tuple(replace(row, published={}) for row in a_result().rows))


def test_a_row_holds_ours_with_interval_then_the_published_figures():
    result = a_result()
    assert cells(result, result.rows[0]).texts == (
        "Roughness", "2", "50.0 [23.7, 76.3]", "90.0 [59.6, 98.2]", "25 / -", "1.5",
    )  # fmt: skip


def test_where_nothing_is_published_there_is_no_column_for_it():
    result = unpublished()
    assert header(result).texts == ("Row", "Dim", "Naive Bayes % [95 %]", "LDA % [95 %]", "ms")
    assert {len(cells(result, row).texts) for row in result.rows} == {5}
    drawn = [text.get_text() for text in draw_table(result).axes[0].texts]
    assert all("aper" not in told for told in (markdown(result), rendered(result), *drawn))


def test_a_missing_row_says_what_the_dataset_lacks():
    result = a_result()
    assert cells(result, result.rows[1]).ours == ("no tap found (hardness)", "")
    assert "no tap found (hardness)" in markdown(result)
    assert "no tap found\n" in re.sub(" +\n", "\n", rendered(result))


@pytest.mark.parametrize("width", [50, 60, 80, 120])
@pytest.mark.parametrize("result", [a_result(), unpublished()], ids=["published", "not"])
def test_a_terminal_of_any_width_breaks_no_number(result, width):
    lines = rendered(result, width).splitlines()
    all_row = next(line.split() for line in lines if line.startswith("All"))
    assert [word for word in all_row if "–" not in word] == ["All", "3", "100.0", "20.0", "0.01"]


def test_intervals_stand_beside_the_accuracies_where_there_is_room():
    assert "100.0 72–100  20.0  6–51" in rendered(a_result(), 80)
    assert "–" not in rendered(a_result(), 40)


def test_points_of_one_column_stand_in_line():
    lines = [line for line in rendered(a_result(), 80).splitlines() if line.startswith(("Rough", "All"))]
    assert len({line.index(".") for line in lines}) == 1


@pytest.mark.parametrize(
    ("hits", "published", "begins"), [((95, 97), {}, 80), ((95, 97), {"lda": 62.0}, 60), ((20, 97), {}, 0)]
)
def test_the_ranking_begins_below_all_that_it_shows(hits, published, begins):
    rows = tuple(RowResult(f"R{k}", 1, {"lda": Accuracy(k, 100)}, published) for k in hits)
    (axes,) = draw_ranking(a_result(rows=rows, classifiers=("lda",))).axes
    low, high = axes.get_xlim()
    assert begins - 3 < low <= begins
    assert high >= 100
    assert {f"{k}.0" for k in hits} <= {text.get_text() for text in axes.texts}
    assert ("chance: 50" in axes.get_xlabel()) == (begins > 50)


@pytest.mark.parametrize("text_of", [rendered, markdown])
@pytest.mark.parametrize(
    "text", ["10 recordings of 2 materials", "recording", "Best row: All, Naive Bayes", "r1: empty",
             "r2: clipped", "waviness in 3 of 10: too short", "a 100%, b 50%"],
)  # fmt: skip
def test_table_and_notes_say(text_of, text):
    assert text in text_of(a_result())


@pytest.mark.parametrize("text", ["`abc`", "seed 7", "texclass 9.9", "`ff`"])
def test_markdown_says_how_to_compute_it_again(text):
    assert text in markdown(a_result())


def test_markdown_rows_have_as_many_cells_as_the_header():
    lines = [line for line in markdown(a_result()).splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in lines}) == 1


def test_report_writes_json_markdown_and_pictures_that_repeat_byte_for_byte(tmp_path):
    first, second = (write_report(a_result(), tmp_path / name) for name in ("a", "b"))
    assert [p.name for p in first] == [
        f"toy-p-recording{end}" for end in (".json", ".md", "-table.png", "-ranking.png", "-confusion.png")
    ]
    assert all(p.read_bytes() == q.read_bytes() for p, q in zip(first, second, strict=True))
    assert json.loads(first[0].read_text())["seed"] == 7


def test_nothing_computable_still_gives_a_report(tmp_path):
    lacking = a_result(rows=a_result().rows[1:2], confusion=None)
    assert [p.suffix for p in write_report(lacking, tmp_path)] == [".json", ".md", ".png", ".png"]
    assert "no tap found" in rendered(lacking)


def test_every_material_is_named_in_a_large_confusion_matrix():
    names = tuple(f"material number {i}" for i in range(69))
    figure = draw_confusion(Confusion("All", "lda", names, np.eye(69, dtype=int) * 10))
    axes = figure.axes[0]
    figure.draw_without_rendering()
    boxes = [label.get_window_extent() for label in axes.get_yticklabels()]
    assert [label.get_text() for label in axes.get_yticklabels()] == list(names)
    assert all(not upper.overlaps(lower) for upper, lower in pairwise(boxes))


def test_what_was_chosen_inside_the_training_parts_is_a_note():
    chosen = (("All", "lda"), ("Roughness", "lda"), ("All", "lda"))
    text = markdown(a_result(choice=NestedChoice(Accuracy(7, 10), chosen, "blocks")))
    assert "chosen inside each training part (by `blocks`)" in text
    assert "70.0 % [39.7, 89.2]; chosen: All, LDA in 2 of 3 folds; Roughness, LDA in 1 of 3 folds." in text
