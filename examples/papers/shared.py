"""Common functions of the scripts that reproduce papers: command line, text blocks, and writing reports."""

import argparse
import inspect
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from texclass.loaders import DataNotFoundError, open_dataset
from texclass.provenance import code_provenance, loaded_places
from texclass.recording import Recording
from texclass.reporting import Document, Figure, Table, print_document, write_document

FABRIC_MM_S = (20.0, 30.0, 50.0, 60.0)
"""Speeds v1 to v4 of `fabric_speeds` in mm/s, from the program of the experiment (its file sound.pde). They
were not measured."""
ABSENT = "Skipped: the recordings are not on this machine (`TEXCLASS_DATA`)."


def arguments(description: str | None) -> argparse.Namespace:
    """Parse the command line options `out`, `seed` and `small`."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--out", type=Path, required=True, help="folder for the report, its figures and JSON")
    parser.add_argument("--seed", type=int, default=0, help="seed of the simulations")
    parser.add_argument("--small", action="store_true", help="few repetitions: seconds instead of minutes")
    return parser.parse_args()


def write_chapter(document: Document, numbers: dict[str, Any], out: Path, key: str) -> list[Path]:
    """Print a report, and write it to a folder with its figures, results and the hash of their code."""
    print_document(document)
    numbers = numbers | code_provenance(*loaded_places())
    written = list(write_document(document, out, key))
    written.append(out / f"{key}.json")
    written[-1].write_text(
        json.dumps({"kind": "study", "version": 1, **numbers}, indent=1) + "\n", encoding="utf-8"
    )
    for path in written:
        print(f"wrote {path}")
    return written


def document(title: str, blocks: Sequence[Any], reproduction: Mapping[str, str] | None = None) -> Document:
    """Return a document; line breaks and indentation in its paragraphs are removed."""
    unwrapped = [" ".join(block.split()) if type(block) is str else block for block in blocks]
    return Document(title, unwrapped, reproduction=reproduction or {})


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> Table:
    """Return a table with a header and rows of text."""
    return Table(pd.DataFrame([list(row) for row in rows], columns=list(head)))


def figure(name: str, draw: Callable[..., Any], *given: Any) -> Figure:
    """Return a figure drawn by `draw(*given, width)`, whose docstring contains the title and the caption."""
    title, _, says = (inspect.getdoc(draw) or name).partition("\n\n")
    return Figure(name, title.rstrip("."), " ".join(says.split()), lambda width: draw(*given, width))


def recordings(card: str) -> tuple[dict[str, Recording], str]:
    """Return the recordings of a dataset by id, and the hash of its files; both empty if it is missing."""
    try:
        dataset = open_dataset(card)
        return {entry.recording_id: dataset.load(entry) for entry in dataset.entries}, dataset.input_hash
    except (DataNotFoundError, FileNotFoundError):
        return {}, ""
