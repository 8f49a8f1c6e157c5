"""Results as JSON files: a kind, its version and plain values; one writer and one reader for all of them.

A subpackage registers a kind by deriving its result from `Result`:

>>> from texclass.reporting import Document
>>> class Tally(Result, kind="tally", version=2):
...     stem = "tally"
...
...     def document(self):
...         return Document(f"{self.data['n']} of them", [])
>>> print(Tally({"n": 3}).to_json())
{
 "kind": "tally",
 "version": 2,
 "n": 3
}
<BLANKLINE>
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from texclass.reporting.blocks import Document

RESULTS: dict[str, type["Result"]] = {}
"""Kind -> class. A class is registered when its module is imported."""


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """A result that can be saved as JSON and shown as a document.

    Attributes
    ----------
    data : mapping
        Plain JSON values, with accuracies as fractions: the content of the file and of the document.
    kind : str
        Kind of the result in its file; "" for a class that is not registered.
    version : int
        Version of the kind: a higher one for each change of what a key holds.
    """

    data: Mapping[str, Any]
    kind: ClassVar[str] = ""
    version: ClassVar[int] = 1

    def __init_subclass__(cls, *, kind: str = "", version: int = 1) -> None:
        super().__init_subclass__()
        if kind:
            cls.kind, cls.version = kind, version
            RESULTS[kind] = cls

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.data['dataset']['name']}>"

    def to_dict(self) -> dict[str, Any]:
        """Return kind, version and data as plain JSON values."""
        return {"kind": self.kind, "version": self.version, **self.data}

    def to_json(self) -> str:
        """Return the result as JSON text."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"

    @property
    def stem(self) -> str:
        """What the names of its files begin with."""
        raise NotImplementedError

    @property
    def definitions(self) -> dict[str, tuple[str, str]]:
        """Name and hash of the "pipeline" and the "feature set" it was made with, where it has any."""
        return {}

    def document(self) -> Document:
        """Return the result as a document."""
        raise NotImplementedError

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write JSON, Markdown and pictures into a folder; their names begin with `stem`."""
        from texclass.reporting.markdown import write_document

        return write_document(self.document(), folder, self.stem, json=self.to_json())


class Study(Result, kind="study"):
    """Values of a script below `benchmarks`, which writes its own Markdown; no page shows them."""

    def document(self) -> Document:
        """Refuse.

        Raises
        ------
        ValueError
            Always.
        """
        raise ValueError("a study has no page. See the Markdown file beside it")


def read_result(path: str | Path, number: Callable[[str], float] | None = None) -> Result:
    """Read a result of any registered kind.

    Parameters
    ----------
    path : str or path
        JSON file.
    number : callable, optional
        Text of a number, NaN and Infinity included -> number; by default as `json.loads` reads it.

    Raises
    ------
    ValueError
        If it is not JSON, or of an unknown kind or version; the message names file and value.
    OSError
        If it cannot be read.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        data = json.loads(text, parse_float=number, parse_int=number, parse_constant=number)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: is not a JSON file that can be read ({error})") from error
    kind, version = (data.pop(key, None) if isinstance(data, dict) else None for key in ("kind", "version"))
    made = RESULTS.get(kind) if isinstance(kind, str) else None
    if made is None or version != made.version:
        known = ", ".join(f"{name} (version {of.version})" for name, of in sorted(RESULTS.items()))
        raise ValueError(
            f"{path}: contains no result of a known kind (kind {str(kind)[:40]!r}, version "
            f"{str(version)[:40]!r}). Expected JSON of {known}: write it again with its command"
        )
    return made(data)
