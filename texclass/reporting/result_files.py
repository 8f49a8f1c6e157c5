"""JSON files of results. Each file contains a kind of result, the version of the kind, and the values.

A subpackage registers a kind by deriving a class from `Result`:

>>> from texclass.reporting import Document
>>> class Count(Result, kind="count", version=2):
...     stem = "count"
...
...     def document(self):
...         return Document(f"{self.data['n']} recordings", [])
>>> print(Count({"n": 3}).to_json())
{
 "kind": "count",
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
"""Classes of results by kind. Importing the module of a class adds the class."""


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """Result that can be saved as JSON, shown as a document and plotted.

    Attributes
    ----------
    data : mapping
        Plain JSON values, which the file contains and the document shows. Accuracies are fractions.
    kind : str
        Kind of the result in its file, or "" for a class that is not registered.
    version : int
        Version of the kind, which is increased when the meaning of a key changes.
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
        """Prefix of the file names."""
        raise NotImplementedError

    @property
    def definitions(self) -> dict[str, tuple[str, str]]:
        """Name and hash of the "pipeline" and of the "feature set", if the result has them."""
        return {}

    def document(self) -> Document:
        """Return the result as a document."""
        raise NotImplementedError

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write JSON, Markdown and figures into a folder. The file names begin with `stem`."""
        from texclass.reporting.markdown import write_document

        return write_document(self.document(), folder, self.stem, json=self.to_json())


class Study(Result, kind="study"):
    """Result of a script in `benchmarks`. The script writes its own Markdown, so there is no document."""

    def document(self) -> Document:
        """Raise an error, because a study has no document.

        Raises
        ------
        ValueError
            Always.
        """
        raise ValueError("a study has no document. Open the Markdown file of the same name instead")


def read_result(path: str | Path, number: Callable[[str], float] | None = None) -> Result:
    """Read a result of any registered kind.

    Parameters
    ----------
    path : str or path
        JSON file.
    number : callable, optional
        Function that converts the text of a number, including NaN and Infinity (default: the conversion of
        `json.loads`).

    Raises
    ------
    ValueError
        If the file is not JSON, or its kind or version is unknown.
    OSError
        If the file cannot be read.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        data = json.loads(text, parse_float=number, parse_int=number, parse_constant=number)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: not a valid JSON file ({error})") from error
    kind, version = (data.pop(key, None) if isinstance(data, dict) else None for key in ("kind", "version"))
    result_class = RESULTS.get(kind) if isinstance(kind, str) else None
    if result_class is None or version != result_class.version:
        kinds = ", ".join(f"{name} (version {one.version})" for name, one in sorted(RESULTS.items()))
        raise ValueError(
            f"{path}: contains no result of a known kind and version (kind {str(kind)[:40]!r}, version "
            f"{str(version)[:40]!r}). Expected one of {kinds}. Run the command that wrote the file again"
        )
    return result_class(data)
