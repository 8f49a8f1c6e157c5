"""What the chapters about papers share: command line, blocks of text, and writing a report."""

import argparse
import inspect
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from texclass.loaders import DataNotFoundError, open_dataset
from texclass.recording import Recording
from texclass.reporting import Document, Figure, Table, print_document, write_document

ABSENT = "Skipped: the recordings are not on this machine (`TEXCLASS_DATA`)."


def arguments(description: str | None) -> argparse.Namespace:
    """Return the options of a chapter: `out`, `seed` and `small`."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--out", type=Path, required=True, help="folder for the report, its figures and JSON")
    parser.add_argument("--seed", type=int, default=0, help="of what is simulated")
    parser.add_argument("--small", action="store_true", help="few repetitions: seconds instead of minutes")
    return parser.parse_args()


def write_chapter(document: Document, numbers: dict[str, Any], out: Path, key: str) -> list[Path]:
    """Print a chapter, and write it with its figures and numbers into a folder."""
    print_document(document)
    written = list(write_document(document, out, key))
    written.append(out / f"{key}.json")
    written[-1].write_text(
        json.dumps({"kind": "study", "version": 1, **numbers}, indent=1) + "\n", encoding="utf-8"
    )
    for path in written:
        print(f"wrote {path}")
    return written


def document(title: str, blocks: Sequence[Any], reproduction: Mapping[str, str] | None = None) -> Document:
    """Return a document; its paragraphs may be broken and indented like the code around them."""
    unwrapped = [" ".join(block.split()) if type(block) is str else block for block in blocks]
    return Document(title, unwrapped, reproduction=reproduction or {})


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> Table:
    """Return a table of rows of texts under their head."""
    return Table(pd.DataFrame([list(row) for row in rows], columns=list(head)))


def figure(name: str, draw: Callable[..., Any], *given: Any) -> Figure:
    """Return what a function draws from what is given and a width; its docstring is title and explanation."""
    title, _, says = (inspect.getdoc(draw) or name).partition("\n\n")
    return Figure(name, title.rstrip("."), " ".join(says.split()), lambda width: draw(*given, width))


def recordings(card: str) -> tuple[dict[str, Recording], str]:
    """Return the recordings of a dataset, by id, and the hash of their files; nothing where it is absent."""
    try:
        dataset = open_dataset(card)
        return {entry.recording_id: dataset.load(entry) for entry in dataset.entries}, dataset.input_hash
    except (DataNotFoundError, FileNotFoundError):
        return {}, ""
