"""What the battery found, to be read: a table for the terminal, Markdown and JSON."""

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from texclass.reporting.report import save_figure
from texclass.reporting.stability_figure import draw_stability
from texclass.stability.result import StabilityResult
from texclass.stability.signals import FAMILIES
from texclass.stability.verdict import BAD, Cell, Mark

if TYPE_CHECKING:
    from rich.table import Table

GROUPS = ("models", "filters", "transforms", "features")
SIGNS = {Mark.SILENT: "N", Mark.WRONG: "✗", Mark.CRASH: "†", Mark.HANG: "∞", Mark.WARNED: "w"}
ALWAYS = (Mark.EXACT, Mark.DOCUMENTED, Mark.REFUSED, Mark.WRONG)
_COLUMNS = (*ALWAYS[:3], Mark.UNCHECKED, Mark.WARNED, Mark.WRONG)
LEGEND = """\
`✓` every cell exact enough · `✓.` right, and some inputs refused: a documented NaN with its reason, or a
clear error · `.` all inputs refused so · `?` reference not computed · `✗3/50` three of fifty wrong: a result
breaking an invariant or missing its reference · `N` NaN or infinity without a word · `†` an accident (crash,
or an exception that nobody raised on purpose) · `∞` no answer in time · `w` right, but NumPy warned."""
RULE = """\
Both sides are judged by one rule (`texclass.stability.rules`). A cell is right if the result meets its
reference (60-digit arithmetic, exact integer sums, or 80-bit floats) and its invariants within the limits, or
if the input is refused by an exception raised on purpose or by a reason that comes with the result; plain
noise in float64 or float32 may not be refused. Public libraries declare no gain laws: they are held to one
only where they follow it from 1e-6 to 1e6."""
INPUTS = {
    "plain": "coloured and white noise",
    "silent": "zeros, constants",
    "impulse": "one sample that is not 0",
    "sine": "pure, at fs/4, alternating, with 1e-8 noise",
    "poles": "resonances 1e-3 ... 1e-12 inside the unit circle; reflection coefficients up to 1 - 2^-53",
    "oversampled": "low-passed by 20 and 100",
    "gain": "1e-160 ... 1e150",
    "offset": "1e6 + noise 1e-3, 1e3 + noise, ramp",
    "clipped": "full-scale square, clipped, quantised",
    "dtype": "int8, int16, int32, float16, float32, big-endian, bool; full-scale squares",
    "layout": "strided, reversed, column, read-only",
    "broken": "NaN, infinity, gaps; for designs: parameters out of range",
    "length": "0, 1, 2, ... 600 samples",
    "rate": "500 Hz ... 50 kHz; for designs: cut-offs 1e-5 ... 0.4999 fs",
    "order": "signals of order/2, order - 1, order and order + 1 samples",
    "stream": "10^8 samples piece by piece; 5 10^6 at once",
}


def stability_table(result: StabilityResult) -> "Table":
    """Return the summary for the terminal: one row a subject, ours first, how many cells of each kind."""
    from rich.table import Table

    present = {cell.mark for cell in result.cells}
    columns = [mark for mark in _COLUMNS if mark in present or mark in ALWAYS]
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("subject", no_wrap=True)
    for mark in columns:
        table.add_column(mark.value, justify="right", no_wrap=True)
    for (library, subject), cells in _by_subject(result.cells).items():
        counts = Counter(Mark.WRONG if cell.mark in BAD else cell.mark for cell in cells)
        name = subject if library == "texclass" else f"{library}: {subject}"
        shown = [str(counts[mark]) if counts[mark] else "" for mark in columns]
        alarming = counts[Mark.WRONG] and library == "texclass"
        table.add_row(name, *shown, style="red" if alarming else None)
    return table


def wrong_lines(result: StabilityResult) -> list[str]:
    """Return one line for each of our cells that is wrong, and for each that warned."""
    found = [*result.wrong, *(cell for cell in result.ours if cell.mark is Mark.WARNED)]
    return [
        f"{cell.mark.value}: {cell.subject}, {cell.case} ({cell.family}): {cell.reason}" for cell in found
    ]


def write_stability_report(result: StabilityResult, folder: str | Path) -> tuple[Path, ...]:
    """Write `stability.md`, `.json` and `.png` into a folder (made if needed) and return the paths."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    texts = {"stability.md": stability_markdown(result), "stability.json": result.to_json()}
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    picture = folder / "stability.png"
    save_figure(draw_stability(result), picture)
    return (*(folder / name for name in texts), picture)


def stability_markdown(result: StabilityResult) -> str:
    """Return the report: totals, our matrix, that of the public libraries, findings, how exact we are."""
    theirs = [cell for cell in result.cells if cell.library != "texclass"]
    parts = ["# At the extremes: `texclass stability`", _headline(result, theirs), RULE]
    parts += ["## Totals", _totals(result.cells), "## texclass", LEGEND]
    for group in GROUPS:
        cells = [cell for cell in result.ours if cell.group == group]
        if cells:
            parts += [f"### {group.capitalize()}", _matrix(cells)]
    if theirs:
        parts += ["## Public libraries", "The same inputs, the same rule.", _matrix(theirs)]
    parts += ["## The inputs", _markdown(("family", "what"), INPUTS.items())]
    parts += ["## Findings: texclass", _our_findings(result)]
    if theirs:
        parts += ["## Findings: public libraries", _their_findings(theirs)]
    parts += ["## How exact texclass is", _accuracy(result.ours), "## Made with", _provenance(result)]
    return "\n\n".join(parts) + "\n"


def _headline(result: StabilityResult, theirs: Sequence[Cell]) -> str:
    bad = sum(cell.mark in BAD for cell in theirs)
    ours = f"**texclass: {len(result.wrong)} of {len(result.ours):,} cells wrong."
    peers = f" Public libraries: {bad:,} of {len(theirs):,}.**" if theirs else "**"
    battery = " A quick run: a small part of the battery." if result.quick else ""
    return f"{ours}{peers}{battery} A cell is one subject on one input (and at one order)."


def _totals(cells: Sequence[Cell]) -> str:
    rows = []
    for library in dict.fromkeys(cell.library for cell in cells):
        own = [cell for cell in cells if cell.library == library]
        counts = Counter(cell.mark for cell in own)
        bad = 100 * sum(counts[mark] for mark in BAD) / len(own)
        rows.append((library, len(own), *(counts[mark] or "" for mark in Mark), f"{bad:.1f} %"))
    return _markdown(("library", "cells", *(mark.value for mark in Mark), "wrong in all"), rows)


def _matrix(cells: Sequence[Cell]) -> str:
    families = [family for family in FAMILIES if any(cell.family == family for cell in cells)]
    rows = []
    for (library, subject), own in _by_subject(cells).items():
        name = subject if library == "texclass" else f"**{library}** {subject}"
        row = [_sign([cell for cell in own if cell.family == family]) for family in families]
        rows.append((name, *row))
    return _markdown(("", *families), rows)


def _sign(cells: Sequence[Cell]) -> str:
    if not cells:
        return ""
    counts = Counter(cell.mark for cell in cells)
    bad = " ".join(f"{sign}{counts[mark]}/{len(cells)}" for mark, sign in SIGNS.items() if counts[mark])
    if bad:
        return bad
    if not counts[Mark.EXACT]:
        return "?" if counts[Mark.UNCHECKED] else "."
    return "✓." if counts[Mark.DOCUMENTED] + counts[Mark.REFUSED] else "✓"


def _our_findings(result: StabilityResult) -> str:
    lines = [f"- {line}" for line in wrong_lines(result)]
    unchecked = Counter(cell.reason for cell in result.ours if cell.mark is Mark.UNCHECKED)
    lines += [f"- {n} cells {reason}" for reason, n in unchecked.items()]
    return "\n".join(lines) or "None: no wrong cell, no crash, no hang, no silent NaN, no NumPy warning."


def _their_findings(cells: Sequence[Cell]) -> str:
    """One row for each library, subject and kind: how often, in which families, and one example."""
    found: dict[tuple[str, str, str], list[Cell]] = {}
    for cell in cells:
        if cell.mark in (*BAD, Mark.WARNED):
            found.setdefault((cell.library, cell.subject, cell.mark.value), []).append(cell)
    rows = []
    for (library, subject, mark), own in found.items():
        families = ", ".join(family for family in FAMILIES if any(cell.family == family for cell in own))
        worst = max(own, key=_severity)
        rows.append((library, subject, mark, len(own), families, f"{worst.case}: {_short(worst.reason)}"))
    return _markdown(("library", "subject", "", "cells", "families", "the worst of them"), rows)


def _severity(cell: Cell) -> float:
    """Error over limit, where that is a number: a measured error tells more than a broken invariant."""
    if cell.error is None or not cell.limit or not cell.error < float("inf"):
        return 0.0
    return cell.error / cell.limit


def _accuracy(cells: Sequence[Cell]) -> str:
    """One row a subject: the right cell that comes nearest to its limit."""
    rows = []
    for (_, subject), own in _by_subject(cells).items():
        measured = [cell for cell in own if cell.error is not None and cell.limit and cell.mark not in BAD]
        if measured:
            worst = max(measured, key=_severity)
            rows.append((subject, worst.what, f"{worst.error:.1e}", f"{worst.limit:.1e}", worst.case))
    return _markdown(("subject", "nearest to its limit", "error", "limit", "on"), rows)


def _provenance(result: StabilityResult) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in result.versions.items())
    lines = [
        f"Versions: {versions}.",
        f"Seed {result.seed}, battery {result.battery}, {result.seconds:.0f} s.",
    ]
    if result.left_out:
        lines.append(f"Left out: {'; '.join(result.left_out)}.")
    return "\n".join(lines)


def _by_subject(cells: Iterable[Cell]) -> dict[tuple[str, str], list[Cell]]:
    found: dict[tuple[str, str], list[Cell]] = {}
    for cell in cells:
        found.setdefault((cell.library, cell.subject), []).append(cell)
    return found


def _short(text: str, most: int = 140) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"


def _markdown(header: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    titles = [str(title) for title in header]
    lines = ["| " + " | ".join(titles) + " |", "|" + "---|" * len(titles)]
    for row in rows:
        lines.append("| " + " | ".join(str(value).replace("|", "\\|") for value in row) + " |")
    return "\n".join(lines)
