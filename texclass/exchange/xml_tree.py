"""Elements and text of an XML file that may be hostile: no document type, no entities, limits throughout."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from texclass.exchange.limited import read_limited

LARGEST_FILE = 8 << 20
"""Bytes; the published textures have 120,000."""
MOST_ELEMENTS = 300_000
DEEPEST = 16
LONGEST_TEXT = 4096


@dataclass(slots=True)
class Element:
    """An element: name, text (without that of its children) and children; attributes are left out."""

    tag: str
    text: str = ""
    children: list["Element"] = field(default_factory=list)

    def all(self, tag: str) -> Iterator["Element"]:
        """Yield the children of a name."""
        return (child for child in self.children if child.tag == tag)

    def one(self, tag: str) -> "Element | None":
        """Return the only child of a name, or None.

        Raises
        ------
        ValueError
            If there are several.
        """
        found = list(self.all(tag))
        if len(found) > 1:
            raise ValueError(f"<{self.tag}> holds {len(found)} <{tag}>; the rule is one")
        return found[0] if found else None


class _Builder:
    """Collects elements while expat reads, and stops it where a limit is passed."""

    def __init__(self) -> None:
        self.root = Element("")
        self._open = [self.root]
        self._count = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if self._count > MOST_ELEMENTS or len(self._open) > DEEPEST:
            raise ValueError(f"has over {MOST_ELEMENTS} elements or {DEEPEST} levels; the rule is at most so")
        element = Element(tag)
        self._open[-1].children.append(element)
        self._open.append(element)

    def end(self, tag: str) -> None:
        self._open.pop()

    def text(self, text: str) -> None:
        element = self._open[-1]
        if not text.isspace():
            element.text += text
        if len(element.text) > LONGEST_TEXT:
            raise ValueError(f"<{element.tag:.40}> holds over {LONGEST_TEXT} characters; the rule is fewer")

    def refuse(self, *declared: object) -> None:
        raise ValueError(f"declares {str(declared[0])!r:.40}; the rule is no document type and no entities")


def parse_xml(path: Path) -> Element:
    """Return the root element of an XML file in UTF-8 (UTF-16 where a byte order mark says so).

    Raises
    ------
    ValueError
        If it is not well formed, passes a limit, or declares a document type or an entity: what expands
        (billion laughs) or reaches elsewhere (external entities) is never read.
    OSError
        If it cannot be read.
    """
    data = read_limited(path, LARGEST_FILE)
    parser, builder = expat.ParserCreate("utf-8"), _Builder()
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.text
    parser.StartDoctypeDeclHandler = builder.refuse
    parser.EntityDeclHandler = builder.refuse
    parser.ExternalEntityRefHandler = builder.refuse  # type: ignore[assignment]
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise ValueError(f"{path}: is not well formed ({error}); the rule is XML in UTF-8") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return builder.root.children[0]
