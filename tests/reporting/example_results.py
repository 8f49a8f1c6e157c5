"""Small results of every kind, with names that are hostile to HTML."""

import json
from pathlib import Path
from typing import Any

from rich.console import Console

from texclass.reporting import Document, render_markdown, render_terminal
from texclass.reporting.result_files import RESULTS

HOSTILE = '<script>alert("x")</script>'
DATA = Path(__file__).parent / "data"
FILES = sorted(DATA.glob("*.json"))


def result(kind: str) -> Any:
    """Return a result as JSON values."""
    return json.loads((DATA / f"{kind}.json").read_text(encoding="utf-8"))


def document(kind: str, data: Any = None) -> Document:
    """Return a result, or the given one of its kind, as a document."""
    return RESULTS[kind](result(kind) if data is None else data).document()


def on_terminal(document: Document, width: int = 120) -> str:
    """Return what a terminal shows."""
    console = Console(width=width)
    with console.capture() as capture:
        console.print(render_terminal(document))
    return capture.get()


def everywhere(document: Document) -> tuple[str, str]:
    """Return terminal and Markdown, each with single spaces."""
    return " ".join(on_terminal(document).split()), " ".join(render_markdown(document).split())
