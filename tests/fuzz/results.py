"""Results as JSON, as `texclass report` reads and shows them."""

import json
from pathlib import Path

from fuzz.contract import Target
from fuzz.mutate import json_of, trees
from texclass.document import render_page
from texclass.reporting import read_document

DATA = Path(__file__).parents[1] / "reporting" / "data"


def _seeds() -> list[bytes]:
    return [path.read_bytes() for path in sorted(DATA.glob("*.json"))]


def _page(path: Path) -> object:
    page = render_page([read_document(path)])
    assert page.startswith("<!")
    return page


TARGETS = (Target("result for the page", _seeds, _page, trees(json.loads, json_of), "result.json"),)
