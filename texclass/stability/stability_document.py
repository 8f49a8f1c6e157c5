"""Create the report of the tests on extreme inputs: counts, heat maps, and examples of all failures."""

from collections.abc import Iterator, Mapping
from typing import Any

import pandas as pd

from texclass.reporting import Details, Document, Finding, Heading, HeatMap, Shade, Table
from texclass.stability.checks import FAILURES, OURS, Mark
from texclass.stability.inputs import FAMILIES

CHECK, DOT = "\N{CHECK MARK}", "\N{MIDDLE DOT}"
LEGEND = {
    "d3": f"{CHECK} all results are exact enough",
    "d2": f"{CHECK}{DOT} all results are exact enough, and some inputs are rejected with a reason",
    "d1": f"{DOT} all inputs are rejected with a reason, or ? the reference was not computed",
    "e1 e2 e3 e4 e5": "number of wrong results (colour: their share), or w: correct, but NumPy warned",
}
METHOD = (
    "Texclass and other libraries are evaluated by the same rules (`texclass.stability.checks`). A cell is "
    "one subject on one input (and at one order). It is correct if the result agrees with its reference "
    "(60-digit arithmetic, exact integer sums, or 80-bit floats) and its invariants within the limits. It "
    "is also correct if the input is rejected by a deliberate exception or with a reason; plain noise in "
    "float64 or float32 must not be rejected. Other libraries declare no gain laws: a law is checked only "
    "if they follow it from 1e-6 to 1e6."
)


def stability_document(data: Mapping[str, Any]) -> Document:
    """Create the report from the `data` of a `StabilityResult` or of its JSON file."""
    tallies = pd.DataFrame(data["tallies"])
    marks = pd.DataFrame(list(tallies["marks"]), index=tallies.index).reindex(columns=list(Mark))
    tallies = tallies.drop(columns="marks").join(marks.fillna(0).astype(int))
    tallies["failures"] = tallies[list(FAILURES)].sum(axis=1)
    is_ours = tallies["library"] == OURS
    tallies["name"] = tallies["subject"].where(is_ours, tallies["library"] + ": " + tallies["subject"])
    ours, theirs = tallies[is_ours], tallies[~is_ours]
    quick = ", a small part of the battery" if data["quick"] else ""
    comparison = (
        f"Other libraries on the same inputs, by the same rules: {theirs['failures'].sum():,} of "
        f"{theirs['cells'].sum():,}."
        if len(theirs)
        else ""
    )
    summary = f"of {ours['cells'].sum():,} pairs of subject and input are wrong in texclass"
    return Document(
        "Results on extreme inputs",
        list(_blocks(data, tallies)),
        subtitle=f"{ours['subject'].nunique()} models, filters, transforms and features{quick}",
        finding=Finding(
            f"{ours['failures'].sum():,}",
            "",
            "",
            f"{summary}: a wrong number, NaN without a reason, a crash, or no result within the time limit.",
            comparison=comparison,
            brief=f"{summary}. {comparison}".strip(),
        ),
        reproduction={"command": "texclass stability", "seed": str(data["seed"]), "battery": data["battery"]},
        versions=data["versions"],
    )


def _blocks(data: Mapping[str, Any], tallies: pd.DataFrame) -> Iterator[Any]:
    is_ours, is_feature = tallies["library"] == OURS, tallies["group"] == "features"
    yield Heading("How many of each kind")
    yield count_table(tallies, "library", "Library")
    for name, title, rows in (
        ("models", "Models, filters and transforms of texclass", is_ours & ~is_feature),
        ("features", "Features of texclass", is_ours & is_feature),
        ("libraries", "Other libraries", ~is_ours),
    ):
        if rows.any():
            yield heat_map(tallies[rows], name, title)
    yield Heading("Every subject")
    yield count_table(tallies, "name", "Subject")
    if failures := [*data["failures"], *data["library_failures"]]:
        names = {
            "library": "Library", "subject": "Subject", "family": "Inputs", "mark": "Outcome",
            "reason": "Reason of the first", "cells": "Cells",
        }  # fmt: skip
        frame = pd.DataFrame(failures).reindex(columns=list(names)).fillna({"cells": 1}).rename(columns=names)
        yield Details("Failures, with an example of each", [Table(frame, n_words=5)])
    if data.get("closest_to_limit"):
        names = {
            "subject": "Subject", "what": "Check closest to its limit", "case": "On", "error": "Error",
            "limit": "Limit",
        }  # fmt: skip
        frame = pd.DataFrame(data["closest_to_limit"])[list(names)]
        frame[["error", "limit"]] = frame[["error", "limit"]].map("{:.1e}".format)
        yield Details("Accuracy of texclass", [Table(frame.rename(columns=names), n_words=3)])
    yield Heading("Notes")
    yield [METHOD, *data["skipped"]]


def count_table(tallies: pd.DataFrame, by: str, title: str) -> Table:
    """Return a table of outcome counts with one row per library or subject."""
    counts = tallies.groupby(by, sort=False)[["cells", *Mark, "failures"]].sum()
    share = (100 * counts.pop("failures") / counts["cells"]).map("{:.1f}".format)
    counts = counts.loc[:, counts.any()].map(lambda n: f"{n:,}" if n else None)
    frame = counts.assign(**{"% wrong": share}).rename_axis(title).reset_index()
    return Table(frame, "Number of inputs by outcome.")


def heat_map(tallies: pd.DataFrame, name: str, title: str) -> HeatMap:
    """Return a heat map with one row per subject and one column per family of inputs."""
    present = set(tallies["family"])
    families = [family for family in FAMILIES if family in present] + sorted(present - set(FAMILIES))
    rows: dict[str, list[Shade]] = {}
    for subject, group in tallies.groupby("name", sort=False):
        by_family = {tally["family"]: tally for tally in group.to_dict("records")}
        rows[str(subject)] = [shade(by_family.get(family)) for family in families]
    columns = {family: str(FAMILIES.get(family, family)) for family in families}
    summary = f"{tallies['failures'].sum():,} of {tallies['cells'].sum():,} cells are wrong."
    return HeatMap(
        name, f"{title}, by family of inputs", summary, columns, rows, LEGEND, "not tested", "Subject"
    )


def shade(tally: Mapping[Any, Any] | None) -> Shade:
    """Return symbol, colour and tooltip for the outcomes of a subject on a family of inputs."""
    if tally is None:
        return Shade(description="not tested")
    n = tally["cells"]
    tooltip = ", ".join(f"{tally[mark]} {mark}" for mark in Mark if tally[mark]) + f" of {n}"
    if n_failures := tally["failures"]:
        return Shade(f"e{max(1, -(-5 * n_failures // n))}", str(n_failures), tooltip)
    if tally[Mark.WARNED]:
        return Shade("e1", "w", tooltip)
    if not tally[Mark.EXACT]:
        return Shade("d1", "?" if tally[Mark.UNCHECKED] else DOT, tooltip)
    if tally[Mark.DOCUMENTED] or tally[Mark.REFUSED]:
        return Shade("d2", CHECK + DOT, tooltip)
    return Shade("d3", CHECK, tooltip)
