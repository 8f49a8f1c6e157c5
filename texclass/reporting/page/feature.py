"""A new feature against the table, on the page."""

from collections.abc import Iterator
from typing import Any

from texclass.reporting.page.benchmark import benchmark_blocks, benchmark_section
from texclass.reporting.page.blocks import Block, Finding, Folded, Heading, Section, Table, simple_table
from texclass.reporting.page.rows import best_of
from texclass.reporting.page.wording import (
    digits,
    interval,
    p_value,
    percent,
    points,
    points_interval,
    title_of,
)  # fmt: skip


def feature_section(data: dict[str, Any]) -> Section:
    """Return the section of a new feature: what it adds, what it is, then the table."""
    new, table = data["new_feature"], benchmark_section(data)
    return Section(
        f"New feature {new['name']} on {table.title}",
        table.subtitle,
        _finding(data),
        (*feature_blocks(new, data), *benchmark_blocks(data, best_of(data))),
    )


def feature_blocks(new: dict[str, Any], data: dict[str, Any]) -> Iterator[Block]:
    """Yield what was found about the feature itself."""
    yield Heading("The feature itself")
    yield _facts(new, data)
    answers = [
        (a["input"], a["answer"], a["detail"], "kept" if a["kept"] else "BROKEN") for a in new["behaviour"]
    ]
    broken = sum(row[-1] == "BROKEN" for row in answers)
    title = f"Answers to degenerate input: {len(answers) - broken} of {len(answers)} as the contract asks"
    titles = ("Input", "Answer", "Detail", "Contract")
    yield Folded(title, simple_table(title, titles, answers, n_text=4))


def _finding(data: dict[str, Any]) -> Finding:
    gains, name = data.get("gains"), data["new_feature"]["name"]
    groups = [group for group in gains["groups"] if group["paired"]] if gains else []
    if not gains or not groups:
        return Finding(
            "none", "", "", f"gain could be measured for {name}: there is no row that it can join."
        )
    (group, *_), base = groups, gains["without"]["accuracy"]
    p = p_value(group["paired"]["p_value"])
    return Finding(
        points(group["paired"]["difference"]),
        "points",
        points_interval(group["paired"]),
        f"of accuracy when {name} joins the best row, {gains['row']} with {title_of(gains['classifier'])} "
        f"({percent(base)} % without it); p {p} by {group['paired']['test']}, 95 % interval.",
        brief=f"Gain when it joins {gains['row']} with {title_of(gains['classifier'])}; p {p}.",
    )


def _facts(new: dict[str, Any], data: dict[str, Any]) -> Table:
    alone = data["rows"][-1]
    accuracies = ", ".join(
        f"{title_of(n)} {percent(found['mean'])} % {interval(found)}"
        for n, found in alone["accuracy"].items()
    )
    added = (
        ""
        if new["ms_added"] is None
        else f"; {digits(max(new['ms_added'], 0.0))} ms more beside the best row"
    )
    facts = [
        ("Phase, unit, source", f"{new['phase']}, {new['unit']}, {new['reference']}"),
        ("Alone", alone["missing"] or accuracies),
        ("Cost", f"{digits(new['ms_alone'])} ms per recording alone{added}"),
        ("Gain law", _law(new["gain_law"])),
        *((f"Repeats ({r['column']})", _repeats(r)) for r in new["redundancy"]),
    ]
    return simple_table("What was found about the feature", ("What", "Finding"), facts, n_text=2)


def _law(law: dict[str, Any] | None) -> str:
    if law is None:
        return "not measured: the feature has no value on the recordings it was tried on"
    declared, measured = law["declared"], law["measured"]
    said = f"declared: power {digits(declared['power'])}, shift {digits(declared['shift'])}"
    found = f"power {digits(measured['power'])}, shift {digits(measured['shift'])}"
    return f"{said}; " + (
        "holds" if law["holds"] else f"BROKEN by {digits(law['deviation'])}, measured {found}"
    )


def _repeats(found: dict[str, Any]) -> str:
    kin = ", ".join(f"{k['column']} {k['rank_correlation']:+.2f}" for k in found["nearest"]) or "nothing"
    explained = found["explained"]
    more = (
        "" if explained is None else f"; all columns together explain R\N{SUPERSCRIPT TWO} = {explained:.2f}"
    )
    return f"rank correlation with {kin}{more}"
