"""A new feature against the table, as a document: what to know of it before it goes into a paper."""

from collections.abc import Iterator, Mapping
from typing import Any

import pandas as pd

from texclass.document import Document, Finding, Folded, Heading, Table
from texclass.document.blocks import Block
from texclass.document.wording import digits, estimate, p_value, percent, points, points_interval
from texclass.experiment.benchmark_document import benchmark_blocks, benchmark_document
from texclass.experiment.gains_document import LEVEL, unseen
from texclass.experiment.result_words import classifier_title, over
from texclass.features.contract import Gain
from texclass.features.examination import EXACT

Data = Mapping[str, Any]


def new_feature_document(data: Data) -> Document:
    """Return a study as a document: what the feature adds, what it is, then the table.

    Parameters
    ----------
    data : mapping
        As `FeatureStudy.to_dict` returns it, or its JSON read back.
    """
    table, new = benchmark_document(data), data["new_feature"]
    return Document(
        f"New feature {new['name']} on {table.title}",
        [Heading("The feature itself"), *_itself(new, data), *benchmark_blocks(data)],
        table.subtitle, _finding(data), table.data, table.again, table.versions,
    )  # fmt: skip


def _finding(data: Data) -> Finding:
    gains, name = data.get("gains"), data["new_feature"]["name"]
    groups = [group for group in gains["groups"] if group["paired"]] if gains else []
    if not gains or not groups:
        return Finding(
            "none", "", "", f"gain could be measured for {name}: there is no row that it can join."
        )
    paired, p = groups[0]["paired"], p_value(groups[0]["paired"]["p_value"])
    base = f"{gains['row']} with {classifier_title(gains['classifier'])}"
    seen = paired["p_value"] < LEVEL
    told = "" if seen else f" No difference seen{unseen(groups)}."
    return Finding(
        points(paired["difference"]), "points", points_interval(paired),
        f"of accuracy when {name} joins the best row, {base} "
        f"({percent(gains['without']['accuracy'])} % without it); p {p} by {paired['test']}, 95 % "
        f"interval{over(paired)}.{told}",
        brief=f"Gain when it joins {base}; p {p}.",
    )  # fmt: skip


def _itself(new: Data, data: Data) -> Iterator[Block]:
    """Yield what was found about the feature itself."""
    alone = data["rows"][-1]
    accuracies = [f"{classifier_title(n)} {estimate(a)} %" for n, a in alone["accuracy"].items()]
    cost = f"{digits(new['ms_alone'])} ms per recording alone"
    if new["ms_added"] is not None:
        cost += f"; {digits(max(new['ms_added'], 0.0))} ms more beside the best row"
    repeats = []
    for found in new["redundancy"]:
        kin = [f"{near['column']} {near['rank_correlation']:+.2f}" for near in found["nearest"]]
        repeats.append(f"{found['column']}: rank correlation with {', '.join(kin) or 'nothing'}")
        if (explained := found["explained"]) is not None:
            repeats[-1] += f"; all columns together explain R\N{SUPERSCRIPT TWO} = {explained:.2f}"
    answers = pd.DataFrame(
        [(a["input"], a["answer"], a["detail"], "kept" if a["kept"] else "BROKEN") for a in new["behaviour"]],
        columns=["Input", "Answer", "Detail", "Contract"],
    )
    broken = answers[answers["Contract"] == "BROKEN"]
    title = f"{len(answers) - len(broken)} of {len(answers)} answered as the contract asks"
    yield {
        "Feature": f"{new['name']}: {new.get('summary', '')} Phase {new['phase']}, unit {new['unit']}, "
        f"{new['reference']}.",
        "Alone": alone["missing"] or ", ".join(accuracies),
        "Cost": cost,
        "Gain law": _law(new["gain_law"]),
        "Repeats": "; ".join(repeats) or "nothing: it does not vary",
        "Degenerate input": title,
    }
    if len(broken):
        yield Table(broken, "Answers that break the contract.", n_words=4)
    yield Folded(f"Answers to degenerate input: {title}", [Table(answers, n_words=4)])


def _law(law: Data | None) -> str:
    if law is None:
        return "not measured: the feature has no value on the recordings it was tried on"
    declared = f"declared y(g x) = {Gain(**law['declared'])}"
    if law["holds"]:
        return f"{declared}; measured the same (to {law['deviation']:.0e})"
    found = f"y(g x) = {Gain(**law['measured'])}"
    if law.get("measured_deviation", 0.0) > EXACT:
        found = "another, of no power and no shift"
    return f"{declared}; BROKEN by {digits(law['deviation'])}; measured {found}"
