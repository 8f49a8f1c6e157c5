"""The outcomes of the battery as a document: counts, heat maps, and every finding with an example."""

from collections.abc import Iterator, Mapping
from typing import Any

import pandas as pd

from texclass.reporting import Document, Finding, Folded, Heading, Heat, Shade, Table
from texclass.stability.inputs import FAMILIES
from texclass.stability.rules import BAD, OURS, Mark

CHECK, DOT = "\N{CHECK MARK}", "\N{MIDDLE DOT}"
LEGEND = {
    "d3": f"{CHECK} every result is exact enough",
    "d2": f"{CHECK}{DOT} so are all results, and some inputs are refused with a reason",
    "d1": f"{DOT} all are refused so, or ? the reference was not computed",
    "e1 e2 e3 e4 e5": "so many are wrong (colour: which share), or w: right, but NumPy warned",
}
RULE = (
    "Both sides are judged by one rule (`texclass.stability.rules`). A cell is one subject on one input (and "
    "at one order). It is right if the result meets its reference (60-digit arithmetic, exact integer sums, "
    "or 80-bit floats) and its invariants within the limits, or if the input is refused by an exception "
    "raised on purpose or by a reason that comes with the result; plain noise in float64 or float32 may not "
    "be refused. Public libraries declare no gain laws: they are held to one only where they follow it from "
    "1e-6 to 1e6."
)


def stability_document(data: Mapping[str, Any]) -> Document:
    """Return the outcomes as a document, from the `data` of a `StabilityResult` or its JSON file."""
    tallies = pd.DataFrame(data["tallies"])
    marks = pd.DataFrame(list(tallies["marks"]), index=tallies.index).reindex(columns=list(Mark))
    tallies = tallies.drop(columns="marks").join(marks.fillna(0).astype(int))
    tallies["bad"] = tallies[list(BAD)].sum(axis=1)
    is_ours = tallies["library"] == OURS
    tallies["name"] = tallies["subject"].where(is_ours, tallies["library"] + ": " + tallies["subject"])
    ours, theirs = tallies[is_ours], tallies[~is_ours]
    quick = ", a small part of the battery" if data["quick"] else ""
    beside = (
        f"Public libraries on the same inputs, by the same rule: {theirs['bad'].sum():,} of "
        f"{theirs['cells'].sum():,}."
        if len(theirs)
        else ""
    )
    wrong = f"of {ours['cells'].sum():,} pairs of subject and input are wrong in texclass"
    return Document(
        "At the extremes",
        list(_blocks(data, tallies)),
        subtitle=f"{ours['subject'].nunique()} models, filters, transforms and features{quick}",
        finding=Finding(
            f"{ours['bad'].sum():,}",
            "",
            "",
            f"{wrong}: a wrong number handed over as right, NaN without a word, a crash, or no answer.",
            beside=beside,
            brief=f"{wrong}. {beside}".strip(),
        ),
        again={"command": "texclass stability", "seed": str(data["seed"]), "battery": data["battery"]},
        versions=data["versions"],
    )


def _blocks(data: Mapping[str, Any], tallies: pd.DataFrame) -> Iterator[Any]:
    is_ours, is_feature = tallies["library"] == OURS, tallies["group"] == "features"
    yield Heading("How many of each kind")
    yield count_table(tallies, "library", "Library")
    for name, title, rows in (
        ("models", "Models, filters and transforms of texclass", is_ours & ~is_feature),
        ("features", "Features of texclass", is_ours & is_feature),
        ("libraries", "Public libraries", ~is_ours),
    ):
        if rows.any():
            yield heat_map(tallies[rows], name, title)
    yield Heading("Every subject")
    yield count_table(tallies, "name", "Subject")
    if wrong := [*data["ours_wrong"], *data["theirs_wrong"]]:
        names = {
            "library": "Library", "subject": "Subject", "family": "Inputs", "mark": "What",
            "reason": "Reason of the first", "cells": "Cells",
        }  # fmt: skip
        frame = pd.DataFrame(wrong).reindex(columns=list(names)).fillna({"cells": 1}).rename(columns=names)
        yield Folded("What is wrong, with an example of each", [Table(frame, n_words=5)])
    if data.get("nearest"):
        names = {
            "subject": "Subject", "what": "Nearest to its limit", "case": "On", "error": "Error",
            "limit": "Limit",
        }  # fmt: skip
        frame = pd.DataFrame(data["nearest"])[list(names)]
        frame[["error", "limit"]] = frame[["error", "limit"]].map("{:.1e}".format)
        yield Folded("How exact texclass is", [Table(frame.rename(columns=names), n_words=3)])
    yield Heading("Notes")
    yield [RULE, *data["left_out"]]


def count_table(tallies: pd.DataFrame, by: str, title: str) -> Table:
    """Return how many inputs came to which end, one row a library or subject."""
    counts = tallies.groupby(by, sort=False)[["cells", *Mark, "bad"]].sum()
    wrong = (100 * counts.pop("bad") / counts["cells"]).map("{:.1f}".format)
    counts = counts.loc[:, counts.any()].map(lambda n: f"{n:,}" if n else None)
    frame = counts.assign(**{"% wrong in all": wrong}).rename_axis(title).reset_index()
    return Table(frame, "Inputs, by what became of them.")


def heat_map(tallies: pd.DataFrame, name: str, title: str) -> Heat:
    """Return subjects by families of inputs."""
    present = set(tallies["family"])
    families = [family for family in FAMILIES if family in present] + sorted(present - set(FAMILIES))
    rows: dict[str, list[Shade]] = {}
    for subject, part in tallies.groupby("name", sort=False):
        by_family = {tally["family"]: tally for tally in part.to_dict("records")}
        rows[str(subject)] = [shade(by_family.get(family)) for family in families]
    columns = {family: str(FAMILIES.get(family, family)) for family in families}
    says = f"{tallies['bad'].sum():,} of {tallies['cells'].sum():,} cells are wrong."
    return Heat(name, f"{title}, by family of inputs", says, columns, rows, LEGEND, "not tried", "Subject")


def shade(tally: Mapping[Any, Any] | None) -> Shade:
    """Return how the outcomes of a subject on a family are shown."""
    if tally is None:
        return Shade(says="not tried")
    n = tally["cells"]
    says = ", ".join(f"{tally[mark]} {mark}" for mark in Mark if tally[mark]) + f" of {n}"
    if bad := tally["bad"]:
        return Shade(f"e{max(1, -(-5 * bad // n))}", str(bad), says)
    if tally[Mark.WARNED]:
        return Shade("e1", "w", says)
    if not tally[Mark.EXACT]:
        return Shade("d1", "?" if tally[Mark.UNCHECKED] else DOT, says)
    if tally[Mark.DOCUMENTED] or tally[Mark.REFUSED]:
        return Shade("d2", CHECK + DOT, says)
    return Shade("d3", CHECK, says)
