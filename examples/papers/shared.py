"""What the chapters about papers share: their command line, and writing a report with its numbers."""

import argparse
import json
from pathlib import Path
from typing import Any

from texclass.document import Document, print_document, write_document


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
    written[-1].write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    for path in written:
        print(f"wrote {path}")
    return written
