"""A figure inside a page: text is text, colours are the page's, and keys and pointer reach its points."""

import re
from io import BytesIO
from xml.etree import ElementTree

import matplotlib as mpl

from texclass.document.blocks import Figure
from texclass.document.figure_style import NARROW, PALETTE, STYLE

_TAG = "{http://www.w3.org/2000/svg}"
_LINK = "{http://www.w3.org/1999/xlink}href"
_COLOURS = {value: f"var(--{name})" for name, value in PALETTE.items()}
_COLOUR = re.compile("|".join(_COLOURS))
_LONG = re.compile(r"(\.\d\d)\d+")
"""Decimals of a coordinate that nobody sees."""


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
    with mpl.rc_context(STYLE):
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
