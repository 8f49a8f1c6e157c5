"""Output of documents as one HTML page without external files."""

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

from texclass.reporting.blocks import Details, Document, Figure, Heading, HeatMap, Table
from texclass.reporting.figure_style import NARROW, PALETTE, STYLE, WIDTH
from texclass.reporting.wording import cell_texts, column_titles, split_interval

MACROS: dict[type, str] = {
    Heading: "heading", str: "text", Mapping: "facts", Table: "table", Figure: "figure", HeatMap: "heat",
    Details: "details", Sequence: "notes",
}  # fmt: skip
"""Name of the template macro for each type of block. The first matching type is used."""
_TAG = "{http://www.w3.org/2000/svg}"
_LINK = "{http://www.w3.org/1999/xlink}href"
_COLOURS = {value: f"var(--{name})" for name, value in PALETTE.items()}
_COLOUR = re.compile("|".join(_COLOURS))
_LONG = re.compile(r"(\.\d\d)\d+")
"""Pattern of the decimals after the second in SVG coordinates, which have no visible effect."""


def render_page(documents: Sequence[Document], title: str = "", *, written_by: str = "texclass") -> str:
    """Return documents as one HTML page.

    Parameters
    ----------
    documents : sequence of Document
        Documents in page order. Datasets and versions are shown only once, at the end of the page.
    title : str
        Page title (default: the title of the first document).
    written_by : str
        Name of the program that wrote the page, shown in the footer.

    Raises
    ------
    ValueError
        If there are no documents.

    Examples
    --------
    >>> from texclass.reporting import Document
    >>> render_page([Document("Latency", ["Below 1 ms."])])[:15]
    '<!DOCTYPE html>'
    """
    if not documents:
        raise ValueError("cannot render a page: documents is empty. Expected at least one document")
    templates = files(__package__).joinpath("templates")
    script, style = (
        templates.joinpath(name).read_text(encoding="utf-8").strip() for name in ("page.js", "page.css")
    )
    datasets: dict[tuple[str, str], dict[str, str]] = {}
    for name, facts in (document.dataset for document in documents if document.dataset):
        datasets.setdefault((name, facts.get("Input hash", "")), {}).update(facts)
    facts_of_results = [dict(document.reproduction) for document in documents if document.reproduction]
    reproduction = pd.DataFrame(facts_of_results).fillna("")
    return _environment().get_template("page.html").render(
        title=title or documents[0].title,
        documents=documents,
        datasets=[(name, facts) for (name, _), facts in datasets.items()],
        reproduction=None
        if reproduction.empty
        else Table(reproduction, "Origin of the results", reproduction.shape[1]),
        versions=_versions(documents),
        scripts={"page": Markup(script)},
        style=Markup(style),
        written_by=written_by,
    )  # fmt: skip


def _versions(documents: Sequence[Document]) -> Table | None:
    """Return a table of package versions, with one column per distinct set of versions."""
    names_by_versions: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for document in documents:
        if document.versions:
            name = document.reproduction.get("File", document.title)
            names_by_versions.setdefault(tuple(document.versions.items()), []).append(name)
    if not names_by_versions:
        return None
    is_same = len(names_by_versions) == 1
    titles = ["Version" if is_same else ", ".join(names) for names in names_by_versions.values()]
    columns = zip(titles, names_by_versions, strict=True)
    frame = pd.DataFrame({title: dict(versions) for title, versions in columns})
    return Table(frame.rename_axis("Package").reset_index(), "Versions", n_words=1 + len(titles))


def _heads(table: Table) -> list[list[dict[str, Any]]]:
    """Return the header lines of a table: the columns and, if they are grouped, the groups above them."""
    columns = [tuple(title.replace(" %", "\xa0%") for title in parts) for parts in column_titles(table.frame)]
    bottom = [
        {"text": part, "span": 1, "rows": 1, "column": i} for i, (_, part) in enumerate(columns) if part
    ]
    top: list[dict[str, Any]] = []
    for i, (group, part) in enumerate(columns):
        if part and top and top[-1]["text"] == group:
            top[-1]["span"] += 1
        else:
            rows = 2 if bottom and not part else 1
            top.append({"text": group, "span": 1, "rows": rows, "column": None if part else i})
    return [line for line in (top, bottom) if line]


def inline_svg(figure: Figure, width: float, name: str) -> str:
    """Return a figure as an SVG element.

    Parameters
    ----------
    figure : Figure
        Figure to draw. If the gid of an artist is a sentence, it becomes the label for screen readers.
    width : float
        Width in inches.
    name : str
        Prefix of the ids in the element. On the page, the title must have the id `name-t`, and the
        summary must have the id `name-d`.
    """
    svg = BytesIO()
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph", UserWarning)  # a missing glyph is drawn as a box
        # Very long names leave no space for the layout.
        warnings.filterwarnings("ignore", "constrained_layout not applied", UserWarning)
        figure.draw(width).savefig(svg, format="svg", transparent=True, metadata={"Date": None})
    root = ElementTree.fromstring(svg.getvalue())  # safe to parse: written by matplotlib above
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
    """Make the ids in an SVG element unique. Replace colours with CSS variables, and gids with labels."""
    element.tag = element.tag.removeprefix(_TAG)
    attributes = element.attrib
    gid = attributes.pop("id", "")
    if " " in gid:  # the ids of matplotlib contain no spaces, so this gid is a sentence
        attributes |= {"class": "point", "role": "img", "aria-label": gid}
        title = ElementTree.Element("title")
        title.text = gid
        element.insert(0, title)
    elif element.tag in {"path", "clipPath"} and gid:
        attributes["id"] = prefix + gid
        # A style in the definition of a shape would override the style of each use of the shape.
        attributes.pop("style", None)
    if _LINK in attributes:
        attributes["href"] = f"#{prefix}{attributes.pop(_LINK)[1:]}"
    for key, value in attributes.items():
        if key in {"d", "x", "y", "points", "transform", "style"}:
            attributes[key] = _COLOUR.sub(lambda colour: _COLOURS[colour[0]], _LONG.sub(r"\1", value))
        elif key == "clip-path":
            attributes[key] = f"url(#{prefix}{value[5:-1]})"


def templates(package: str, folder: str) -> Environment:
    """Return the Jinja environment of the page templates in a folder of a package.

    Values are escaped, and undefined names raise errors. Templates may extend `shell.html`, whose variables
    are `title`, `style` and `scripts` (name -> text).
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
        "cells": lambda table: cell_texts(table.frame),
        "code": lambda text: Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text)))),
        "split_interval": split_interval,
        "drawings": lambda figure, name: [Markup(inline_svg(figure, w, name)) for w in (WIDTH, NARROW)],
    }  # fmt: skip
    return environment
