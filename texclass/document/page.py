"""Documents as one HTML page that holds all it shows and asks for nothing outside."""

import base64
import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from texclass.document.blocks import Block, Document, Figure, Folded, Heading, Heat, Table
from texclass.document.figure_style import NARROW, WIDTH
from texclass.document.svg import inline_svg
from texclass.document.wording import split_interval, texts_of


def render_page(documents: Sequence[Document], title: str = "", *, written_by: str = "texclass") -> str:
    """Return documents as one page.

    Parameters
    ----------
    documents : sequence of Document
        In the order of the page. What they share (data, versions) is told once, at its end.
    title : str
        Its title; that of the first document by default.
    written_by : str
        Named at the foot.

    Raises
    ------
    ValueError
        If there are no documents.
    """
    if not documents:
        raise ValueError("0 results; the rule is at least 1")
    templates = files(__package__).joinpath("templates")
    script, style = (
        templates.joinpath(name).read_text(encoding="utf-8").strip() for name in ("page.js", "page.css")
    )
    again = pd.DataFrame([dict(document.again) for document in documents if document.again])
    return _environment().get_template("page.html").render(
        title=title or documents[0].title,
        documents=documents,
        data=list(_data(documents)),
        again=None if again.empty else Table(again, "What the results came from", again.shape[1]),
        versions=_versions(documents),
        script=Markup(script),
        style=Markup(style),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        written_by=written_by,
    )  # fmt: skip


def _data(documents: Sequence[Document]) -> Iterator[tuple[str, Mapping[str, str]]]:
    """Yield name and facts of what was measured on, each once."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for name, facts in (document.data for document in documents if document.data):
        found.setdefault((name, facts.get("Input hash", "")), {}).update(facts)
    return ((name, facts) for (name, _), facts in found.items())


def _versions(documents: Sequence[Document]) -> Table | None:
    """Return the versions behind the results; one column where all agree."""
    known: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for document in documents:
        if document.versions:
            name = document.again.get("File", document.title)
            known.setdefault(tuple(document.versions.items()), []).append(name)
    if not known:
        return None
    titles = ["Version" if len(known) == 1 else ", ".join(names) for names in known.values()]
    frame = pd.DataFrame({title: dict(versions) for title, versions in zip(titles, known, strict=True)})
    return Table(frame.rename_axis("Package").reset_index(), "Versions", n_words=1 + len(titles))


def _kind(block: Block) -> str:
    """Return the name of the macro that shows a block."""
    match block:
        case Heading():
            return "heading"
        case str():
            return "text"
        case Mapping():
            return "facts"
        case Table() | Figure() | Heat() | Folded():
            return type(block).__name__.lower()
    return "notes"


def _heads(table: Table) -> list[list[dict[str, Any]]]:
    """Return the titles of the columns: one line, or, if they have two levels, groups and what is in each."""
    titles: list[Any] = list(table.frame.columns)
    columns = [title if isinstance(title, tuple) else (title, "") for title in titles]
    columns = [(group.replace(" %", "\xa0%"), part.replace(" %", "\xa0%")) for group, part in columns]
    below = [{"text": part, "span": 1, "rows": 1, "column": i} for i, (_, part) in enumerate(columns) if part]
    above: list[dict[str, Any]] = []
    for i, (group, part) in enumerate(columns):
        if part and above and above[-1]["text"] == group:
            above[-1]["span"] += 1
        else:
            rows = 2 if below and not part else 1
            above.append({"text": group, "span": 1, "rows": rows, "column": None if part else i})
    return [line for line in (above, below) if line]


def _code(text: str) -> Markup:
    """Return text with what stands between backticks as code."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("texclass.document"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "kind": _kind, "heads": _heads, "code": _code, "cells": lambda table: texts_of(table.frame),
        "parted": split_interval,
        "drawings": lambda figure, name: [Markup(inline_svg(figure, w, name)) for w in (WIDTH, NARROW)],
    }  # fmt: skip
    return environment
