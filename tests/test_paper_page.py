"""The page on the contents of the papers: complete, and consistent with code and figures."""

import importlib
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs" / "_ext"))
import paper_page  # noqa: E402  (from the folder above)

CONTENTS = paper_page.read_contents()
REPORTS = ROOT / "reports" / "papers"
EXPECTED = {
    "strese2015": [
        *(f"eq. {i}" for i in range(1, 9)),
        *(f"fig. {i}" for i in range(1, 14)),
        "table I",
    ],
    "guruswamy2011": [
        *(f"eq. {i}" for i in range(1, 8)),
        *(f"fig. {i}" for i in range(1, 13)),
        *(f"table {i}" for i in ("I", "II", "III")),
        "section III-A",
    ],
    "abdulali2016": [
        *(f"eq. {i}" for i in range(1, 7)),
        *(f"fig. {i}" for i in ("1", "2(a)", "2(b)", "3", "4", "5(a)", "5(b)", "5(c)", "5(d)")),
    ],
    "oeztuerk2018": [
        *(f"eq. 3.{i}" for i in range(1, 17)),
        *(f"fig. {i}" for i in ("2.1", *(f"3.{i}" for i in range(1, 10)), "4.1", "4.2")),
        *(f"fig. {i}" for i in ("5.1", "5.2", "6.1", "6.2")),
        *(f"table {i}" for i in ("3.1", "3.2", "5.1", "6.1")),
    ],
    "okamura2001": [
        "eq. 1",
        *(f"fig. {i}" for i in range(1, 8)),
        *(f"table {i}" for i in ("I", "II", "III")),
    ],
}
"""Numbered equations, figures and tables of each paper, and sections with a method of their own."""


@pytest.mark.parametrize("paper", EXPECTED)
def test_every_item_of_a_paper_is_listed_once(paper):
    assert CONTENTS.loc[CONTENTS["paper"] == paper, "item"].tolist() == EXPECTED[paper]


def find(name):
    """Return the object of a dotted name."""
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        try:
            value = importlib.import_module(".".join(parts[:n]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[n:]:
            value = getattr(value, attribute)
        return value
    raise ModuleNotFoundError(name)


def test_the_code_of_every_item_exists():
    names = {name for cell in CONTENTS["code"] for name in cell.split()}
    assert len(names) > 50
    for name in names:
        if "/" in name:
            assert (ROOT / name).is_file(), name
        else:
            assert find(name) is not None
    with pytest.raises((AttributeError, ModuleNotFoundError)):
        find("texclass.features.hardness.softness")


def test_every_figure_of_an_item_is_in_the_report_of_its_chapter():
    for row in CONTENTS[CONTENTS["figure"] != ""].itertuples():
        picture = f"{row.paper}-{row.figure}.png"
        assert (REPORTS / picture).is_file()
        assert f"]({picture})" in (REPORTS / f"{row.paper}.md").read_text(encoding="utf-8")


def test_every_numbered_figure_of_a_chapter_is_on_the_page():
    listed = set(CONTENTS["paper"] + "-" + CONTENTS["figure"])
    drawn = {path.stem for path in REPORTS.glob("*-fig*.png")} | {"strese2015-table1"}
    assert drawn <= listed


def test_an_item_that_is_not_as_printed_has_a_reason():
    assert set(CONTENTS["status"]) == set(paper_page.STATUSES)
    differs = CONTENTS["status"] != "as printed"
    assert (CONTENTS.loc[differs, "reason"] != "").all()
    assert (CONTENTS.loc[CONTENTS["status"] != "not available", "code"] != "").all()


def test_formulas_with_two_forms_name_both():
    corrected = CONTENTS[(CONTENTS["status"] == "corrected") & (CONTENTS["paper"] == "strese2015")]
    for code in corrected["code"]:
        printed = {name for name in code.split() if name.endswith("_as_printed")}
        assert {name.removesuffix("_as_printed") for name in printed} <= set(code.split())
        assert printed


def test_the_page_contains_every_item_and_its_status():
    page = paper_page.paper_page(CONTENTS)
    for row in CONTENTS.itertuples():
        assert f"   * - {row.item}\n" in page
        assert row.content in page
    assert page.count(":doc:`strese2015 </reports/papers/strese2015>`") == 1
    for status in paper_page.STATUSES:
        assert page.count(f"**{status}**") == (CONTENTS["status"] == status).sum()
