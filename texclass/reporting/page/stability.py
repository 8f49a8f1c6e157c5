"""The battery of extreme inputs on the page: what is wrong, by subject and by family of inputs."""

from collections import Counter
from collections.abc import Iterator
from typing import Any

from texclass.reporting.page.blocks import (
    Block,
    Finding,
    Folded,
    Heading,
    Heat,
    Notes,
    Section,
    Shade,
    Table,
    simple_table,
)
from texclass.reporting.page.wording import sentence
from texclass.stability.inputs import FAMILIES
from texclass.stability.judging import BAD, Mark
from texclass.stability.stability_document import RULE

OURS = "texclass"
REFUSALS = (Mark.DOCUMENTED, Mark.REFUSED)
MARKS = {mark.value: mark for mark in Mark}
CHECK, DOT = "\N{CHECK MARK}", "\N{MIDDLE DOT}"
LEGEND = (
    f"{CHECK}: every result is exact enough. {CHECK}{DOT}: so are all results, and some inputs are refused "
    f"with a reason. {DOT}: all are refused so. ?: the reference was not computed. w: right, but NumPy "
    "warned. A number: so many are wrong; its colour says which share. Empty: not tried."
)
Tallies = list[dict[str, Any]]


def stability_section(data: dict[str, Any]) -> Section:
    """Return the section of the battery."""
    ours, theirs = _parted(data["tallies"])
    bad, cells = _bad(ours), _cells(ours)
    beside = f"Public libraries on the same inputs, by the same rule: {_bad(theirs):,} of {_cells(theirs):,}."
    said = f"of {cells:,} pairs of subject and input are wrong in texclass"
    finding = Finding(
        f"{bad:,}", "", "",
        f"{said}: a wrong number handed over as right, NaN without a word, a crash, or no answer.",
        beside=beside if theirs else "", brief=f"{said}. {beside if theirs else ''}".strip(),
    )  # fmt: skip
    subjects = len({(tally["library"], tally["subject"]) for tally in ours})
    quick = ", a small part of the battery" if data["quick"] else ""
    subtitle = f"{subjects} models, filters, transforms and features{quick}"
    return Section("At the extremes", subtitle, finding, tuple(_blocks(data, ours, theirs)))


def _blocks(data: dict[str, Any], ours: Tallies, theirs: Tallies) -> Iterator[Block]:
    yield Heading("How many of each kind")
    yield total_table(data["tallies"])
    parts = {
        "Models, filters and transforms of texclass": [t for t in ours if t["group"] != "features"],
        "Features of texclass": [t for t in ours if t["group"] == "features"],
        "Public libraries": theirs,
    }
    for title, tallies in parts.items():
        if tallies:
            yield Heading(f"{title}, by family of inputs")
            yield heat_map(tallies, LEGEND)
    found = [*data["ours_wrong"], *data["theirs_wrong"]]
    if found:
        yield Folded("What is wrong, with an example of each", finding_table(found))
    yield Heading("Notes")
    yield Notes((RULE.replace("`", "").replace("\n", " "), *(sentence(why) for why in data["left_out"])))


def total_table(tallies: Tallies) -> Table:
    """Return the number of cells of each kind, one row a library."""
    rows = []
    for library in dict.fromkeys(tally["library"] for tally in tallies):
        own = [tally for tally in tallies if tally["library"] == library]
        marks = _marks(own)
        counts = [f"{marks[mark]:,}" if marks[mark] else "" for mark in Mark]
        rows.append((library, f"{_cells(own):,}", *counts, f"{100 * _bad(own) / max(_cells(own), 1):.1f}"))
    titles = ("Library", "Cells", *(mark.value.replace("WRONG", "wrong") for mark in Mark), "% wrong in all")
    return simple_table("Subjects on inputs, by what became of them", titles, rows, hidden=False)


def heat_map(tallies: Tallies, caption: str) -> Heat:
    """Return subjects by families of inputs."""
    families = [name for name in FAMILIES if any(tally["family"] == name for tally in tallies)]
    families += sorted({tally["family"] for tally in tallies} - set(families))
    found: dict[tuple[str, str], dict[str, dict[str, Any]]] = {}
    for tally in tallies:
        found.setdefault((tally["library"], tally["subject"]), {})[tally["family"]] = tally
    rows = tuple(
        (subject if library == OURS else f"{library}: {subject}", tuple(shade(by.get(f)) for f in families))
        for (library, subject), by in found.items()
    )
    return Heat(caption, tuple((name, FAMILIES.get(name, name)) for name in families), rows)


def shade(tally: dict[str, Any] | None) -> Shade:
    """Return how the cells of a subject and a family are shown."""
    if tally is None:
        return Shade(says="not tried")
    marks, n = _marks([tally]), tally["cells"]
    says = ", ".join(f"{count} {mark.value}" for mark, count in marks.items() if count) + f" of {n}"
    if bad := _bad([tally]):
        return Shade(f"e{max(1, -(-5 * bad // n))}", str(bad), says)
    if marks[Mark.WARNED]:
        return Shade("e1", "w", says)
    if not marks[Mark.EXACT]:
        return Shade("d1", "?" if marks[Mark.UNCHECKED] else DOT, says)
    mixed = any(marks[mark] for mark in REFUSALS)
    return Shade("d2" if mixed else "d3", CHECK + DOT * mixed, says)


def finding_table(found: list[dict[str, Any]]) -> Table:
    """Return what is wrong: library, subject, family, kind, how often, and the reason of one."""
    rows = [
        (f["library"], f["subject"], f["family"], f["mark"], f["reason"], f"{f.get('cells', 1)}")
        for f in found
    ]
    titles = ("Library", "Subject", "Inputs", "What", "Reason of the first", "Cells")
    return simple_table("What is wrong", titles, rows, n_text=5)


def _parted(tallies: Tallies) -> tuple[Tallies, Tallies]:
    ours = [tally for tally in tallies if tally["library"] == OURS]
    return ours, [tally for tally in tallies if tally["library"] != OURS]


def _marks(tallies: Tallies) -> Counter[Mark]:
    counts: Counter[Mark] = Counter()
    for tally in tallies:
        counts.update({MARKS[name]: count for name, count in tally["marks"].items()})
    return counts


def _cells(tallies: Tallies) -> int:
    return sum(tally["cells"] for tally in tallies)


def _bad(tallies: Tallies) -> int:
    marks = _marks(tallies)
    return sum(marks[mark] for mark in BAD)
