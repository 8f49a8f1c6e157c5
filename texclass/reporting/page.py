"""Documents as one HTML page that holds all it shows and asks for nothing outside."""

import re
import warnings
from base64 import b64encode
from collections.abc import Mapping, Sequence
from functools import cache
from hashlib import sha256
from importlib.resources import files
from io import BytesIO
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import pandas as pd
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from texclass.reporting.blocks import Document, Figure, Folded, Heading, Heat, Table
from texclass.reporting.figure_style import NARROW, PALETTE, STYLE, WIDTH
from texclass.reporting.wording import split_interval, texts_of, titles_of

MACROS: dict[type, str] = {
    Heading: "heading", str: "text", Mapping: "facts", Table: "table", Figure: "figure", Heat: "heat",
    Folded: "folded", Sequence: "notes",
}  # fmt: skip
"""Kind of a block -> the macro of the template that shows it; the first that fits."""
_TAG = "{http://www.w3.org/2000/svg}"
_LINK = "{http://www.w3.org/1999/xlink}href"
_COLOURS = {value: f"var(--{name})" for name, value in PALETTE.items()}
_COLOUR = re.compile("|".join(_COLOURS))
_LONG = re.compile(r"(\.\d\d)\d+")
"""Decimals of a coordinate that nobody sees."""


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
        raise ValueError("no result given. Expected at least one")
    templates = files(__package__).joinpath("templates")
    script, style = (
        templates.joinpath(name).read_text(encoding="utf-8").strip() for name in ("page.js", "page.css")
    )
    data: dict[tuple[str, str], dict[str, str]] = {}  # what was measured on, each once
    for name, facts in (document.data for document in documents if document.data):
        data.setdefault((name, facts.get("Input hash", "")), {}).update(facts)
    again = pd.DataFrame([dict(document.again) for document in documents if document.again]).fillna("")
    return _environment().get_template("page.html").render(
        title=title or documents[0].title,
        documents=documents,
        data=[(name, facts) for (name, _), facts in data.items()],
        again=None if again.empty else Table(again, "What the results came from", again.shape[1]),
        versions=_versions(documents),
        scripts={"page": Markup(script)},
        style=Markup(style),
        written_by=written_by,
    )  # fmt: skip


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


def _heads(table: Table) -> list[list[dict[str, Any]]]:
    """Return the titles of the columns: one line, or, if they have two levels, groups and what is in each."""
    columns = [tuple(title.replace(" %", "\xa0%") for title in parts) for parts in titles_of(table.frame)]
    below = [{"text": part, "span": 1, "rows": 1, "column": i} for i, (_, part) in enumerate(columns) if part]
    above: list[dict[str, Any]] = []
    for i, (group, part) in enumerate(columns):
        if part and above and above[-1]["text"] == group:
            above[-1]["span"] += 1
        else:
            rows = 2 if below and not part else 1
            above.append({"text": group, "span": 1, "rows": rows, "column": None if part else i})
    return [line for line in (above, below) if line]


def inline_svg(figure: Figure, width: float, name: str) -> str:
    """Return a figure as an SVG element.

    Parameters
    ----------
    figure : Figure
        What is drawn. The gid of an artist, if it is a sentence, is what a screen reader says of it.
    width : float
        In inches.
    name : str
        Begins the ids inside; the page has its title as `name-t` and its sentence as `name-d`.
    """
    written = BytesIO()
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph", UserWarning)  # it is drawn as a box
        warnings.filterwarnings("ignore", "constrained_layout not applied", UserWarning)  # no room for labels
        figure.draw(width).savefig(written, format="svg", transparent=True, metadata={"Date": None})
    root = ElementTree.fromstring(written.getvalue())  # matplotlib wrote it
    box = root.get("viewBox", "")
    kind = "wide" if width > NARROW else "narrow"
    root.attrib.clear()
    for metadata in root.findall(f"{_TAG}metadata"):
        root.remove(metadata)
    for element in root.iter():
        _adapt(element, f"{name}-{kind}-")
    root.attrib |= {
        "class": f"plot {kind}", "viewBox": box, "role": "group",
        "aria-labelledby": f"{name}-t", "aria-describedby": f"{name}-d",
    }  # fmt: skip
    return ElementTree.tostring(root, encoding="unicode")


def _adapt(element: ElementTree.Element, prefix: str) -> None:
    """Give an element ids of its own, the page's colours, and words where it has them."""
    element.tag = element.tag.removeprefix(_TAG)
    found = element.attrib
    said = found.pop("id", "")
    if " " in said:  # no id of matplotlib's, so an artist's words
        found |= {"class": "point", "role": "img", "aria-label": said}
        title = ElementTree.Element("title")
        title.text = said
        element.insert(0, title)
    elif element.tag in {"path", "clipPath"} and said:
        found["id"] = prefix + said
        # A shape in store would keep its colour where it is used; its uses say theirs.
        found.pop("style", None)
    if _LINK in found:
        found["href"] = f"#{prefix}{found.pop(_LINK)[1:]}"
    for key, value in found.items():
        if key in {"d", "x", "y", "points", "transform", "style"}:
            found[key] = _COLOUR.sub(lambda colour: _COLOURS[colour[0]], _LONG.sub(r"\1", value))
        elif key == "clip-path":
            found[key] = f"url(#{prefix}{value[5:-1]})"


def templates(package: str, folder: str) -> Environment:
    """Return the templates of pages in a folder of a package: escaped, and nothing in them undefined.

    They may extend `shell.html`, which is given `title`, `style` and `scripts`, name -> text.
    """
    folders = PackageLoader(package, folder), PackageLoader("texclass.reporting", "templates")
    environment = Environment(
        loader=ChoiceLoader(folders),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["sha256"] = lambda text: b64encode(sha256(text.encode()).digest()).decode()
    return environment


@cache
def _environment() -> Environment:
    environment = templates("texclass.reporting", "templates")
    environment.filters |= {
        "kind": lambda block: next(macro for kind, macro in MACROS.items() if isinstance(block, kind)),
        "heads": _heads,
        "cells": lambda table: texts_of(table.frame),
        "code": lambda text: Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text)))),
        "parted": split_interval,
        "drawings": lambda figure, name: [Markup(inline_svg(figure, w, name)) for w in (WIDTH, NARROW)],
    }  # fmt: skip
    return environment
