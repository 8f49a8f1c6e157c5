"""One document on a terminal, in Markdown and on a page."""

import re
from xml.etree import ElementTree

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure as Drawing
from rich.console import Console

from texclass.reporting import (
    Details,
    Document,
    Figure,
    Finding,
    Heading,
    HeatMap,
    Shade,
    Table,
    render_markdown,
    render_page,
    render_terminal,
    write_document,
)
from texclass.reporting.figure_style import OTHER, OURS, PAPER, legend_above, row_axes, save_figure
from texclass.reporting.page import inline_svg

HOSTILE = '<script>alert("$x$")</script> & $y'
TWO_LEVELS = [("Row", ""), ("Columns", ""), ("LDA", "% [95 %]"), ("LDA", "Paper %"), ("ms", "")]


def draw(width):
    figure, axes = row_axes(width, ["All", HOSTILE], "accuracy, %")
    for y, (ours, theirs) in enumerate([(90, 86), (50, 60)]):
        axes.plot(theirs, y, "D", color=OTHER, markerfacecolor=PAPER)
        axes.plot(ours, y, "o", color=OURS, gid=f"{HOSTILE}: ours {ours} %")
    return figure


def a_table():
    rows = [
        ["All", 12, "90.0 [82.6, 94.5]", "86", 1.5],
        [HOSTILE, 2, "100.0 [72.2, 100.0]", "", 12345.6],
        ["Friction | taps", 1, None, None, None],
    ]
    frame = pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples(TWO_LEVELS))
    return Table(frame, "Best is bold.", bold_rows=[0], messages={2: "not computed: no taps"}, n_narrow=3)


def a_document():
    heat = HeatMap(
        "confusion",
        "Confusion matrix",
        "1 of 10 is taken for another.",
        {"oak": "", HOSTILE: "hard"},
        {"oak": (Shade("d5", "9", "9 of 9"), Shade())},
        {"d1 d5": "right"},
    )
    blocks = [
        Heading("Every row"),
        a_table(),
        Figure("ranking", "Every row", "The best is All.", draw, a_table()),
        heat,
        "A text of `code`.",
        ["first note", HOSTILE],
        {"What": "a fact"},
        Details("Behind", [a_table()]),
    ]
    return Document(
        "toy, folds",
        blocks,
        "Pipeline p",
        Finding("90.0", "%", "[82.6, 94.5]", "of recordings."),
        ("toy", {"Licence": "MIT", "Input hash": "abc"}),
        {"Pipeline": "p", "Seed": "7"},
        {"numpy": "2"},
    )


def on_terminal(width, document=None):
    console = Console(width=width)
    with console.capture() as capture:
        console.print(render_terminal(document or a_document()))
    return capture.get()


def test_terminal_markdown_and_page_have_the_same_content():
    page, text = render_page([a_document()]), render_markdown(a_document(), "toy")
    for report_text in (on_terminal(120), text, page):
        assert "toy, folds" in report_text
        assert "90.0" in report_text
        for texts in ("of recordings.", "Every row", "Best is bold.", "not computed: no taps", "first note",
                     "The best is All.", "1 of 10 is taken for another.", "a fact"):  # fmt: skip
            assert texts in report_text
    assert "![Every row](toy-ranking.png)" in text
    assert "- Seed: 7" in text
    assert "<code>code</code>" in page


@pytest.mark.parametrize("width", [40, 70, 80, 120])
def test_a_terminal_of_any_width_breaks_no_number(width):
    lines = on_terminal(width).splitlines()
    row = next(line for line in lines if line.startswith("All"))
    assert "90.0" in row
    assert any("83–94" in line for line in lines)  # beside, below, or in a part of its own
    assert ("1.5" in row) == (width > 40)
    assert max(map(len, lines)) <= width


def test_a_wide_table_is_split_into_parts_with_row_names_and_intervals():
    names = [f"Method {i}" for i in range(9)]
    frame = pd.DataFrame([["wood", *["90.0 [82.6, 94.5]"] * 9], ["tile", *["8.0 [2.6, 14.5]"] * 9]])
    frame.columns = pd.MultiIndex.from_tuples([("Row", ""), *((name, "% [95 %]") for name in names)])
    report_text = on_terminal(50, Document("t", [Table(frame)]))
    assert report_text.count("83–94") == report_text.count("90.0") == 9
    assert report_text.count("wood") == report_text.count("tile") > 1
    assert max(map(len, report_text.splitlines())) <= 50


def test_rows_of_markdown_have_as_many_cells_as_the_header_and_two_levels_of_titles_are_two_lines_on_a_page():
    text = render_markdown(Document("toy", [a_table()])).replace("\\|", "")
    assert {line.count("|") for line in text.splitlines() if line.startswith("|")} == {6}
    assert "| **All** | **12** | **90.0** [82.6, 94.5] | **86** | **1.5** |" in text
    head = re.findall("<thead>(.*?)</thead>", render_page([Document("toy", [a_table()])]), re.S)[0]
    assert head.count("<tr>") == 2
    assert 'colspan="2" class="group">LDA' in head
    assert 'data-column="3" class="num">Paper\xa0%' in head


def test_a_character_that_the_font_lacks_is_drawn_as_a_box_and_a_list_in_a_cell_as_it_is():
    assert "<svg" in inline_svg(
        Figure("a", "b", "c", lambda width: row_axes(width, ["a\tb"], "x")[0]), 4.4, "s"
    )
    report_text = render_markdown(Document("toy", [Table(pd.DataFrame({"a": [[1, 2], True, 3]}), "")]))
    assert "| [1, 2] |" in report_text


def test_a_picture_holds_text_the_colours_of_the_page_and_words_for_who_does_not_see_it():
    block = Figure("ranking", "Every row", "The best is All.", draw)
    for width, kind in ((9.2, "wide"), (4.4, "narrow")):
        svg = inline_svg(block, width, "s1-2")
        root = ElementTree.fromstring(svg)
        assert root.get("class") == f"plot {kind}"
        assert HOSTILE in [text.text for text in root.iter("text")]
        assert "var(--ours)" in svg
        assert not re.search("#[0-9a-f]{6}", svg.replace("#000000", ""))
        assert [point.get("aria-label") for point in root.iter() if point.get("class") == "point"] == [
            f"{HOSTILE}: ours {value} %" for value in (90, 50)
        ]
        ids = [element.get("id") for element in root.iter() if element.get("id")]
        assert len(ids) == len(set(ids))
        assert all(name.startswith(f"s1-2-{kind}-") for name in ids)
        assert {element.get("href")[1:] for element in root.iter() if element.get("href")} <= set(ids)


def test_figures_are_written_next_to_the_markdown_and_are_reproducible(tmp_path):
    first, second = (write_document(a_document(), tmp_path / name, "toy") for name in ("a", "b"))
    assert [path.name for path in first] == ["toy.md", "toy-ranking.png", "toy-confusion.png"]
    assert all(p.read_bytes() == q.read_bytes() for p, q in zip(first, second, strict=True))
    (alone,) = write_document(a_document(), tmp_path / "c", "toy", pictures=False)
    assert "![" not in alone.read_text(encoding="utf-8")


def test_shared_datasets_and_versions_are_shown_once_on_a_page():
    page = render_page([a_document(), a_document()])
    assert page.count("<dt>Licence</dt>") == 1
    assert page.count("<td>7</td>") == 2
    assert page.count('<th scope="row">numpy</th>') == 1
    with pytest.raises(ValueError, match="documents is empty"):
        render_page([])


def test_the_title_of_a_saved_figure_is_above_its_legend(tmp_path):
    def drawn(title):
        figure, axes = row_axes(6.0, ["All"], "accuracy, %")
        axes.plot(50, 0, "o", label="ours")
        legend_above(figure, axes)
        save_figure(figure, tmp_path / "a.png", title)
        return matplotlib.image.imread(tmp_path / "a.png")

    plain, titled = drawn(""), drawn("A title")
    added = len(titled) - len(plain)
    assert added > 30
    np.testing.assert_allclose(titled[added:], plain, atol=0.04)  # in 256 colours
    assert titled[:added, :, :3].min() < 0.2


def test_ticks_of_a_logarithmic_axis_are_saved_as_numbers(tmp_path):
    figure = Drawing()
    wide, narrow = figure.subplots(1, 2)
    wide.semilogy([1, 2], [0.01, 1000])
    narrow.loglog([1, 2], [20, 90])
    save_figure(figure, tmp_path / "a.png")
    shown = [tick.get_text() for tick in wide.get_yticklabels()]
    assert {"0.01", "1", "1000"} <= set(shown)
    assert {"20", "50"} <= {tick.get_text() for tick in narrow.get_yticklabels()}
    assert not any("$" in text for text in shown)
