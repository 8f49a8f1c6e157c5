"""Results as JSON, as `texclass report` reads and shows them."""

import json
import sys
from pathlib import Path

from fuzz.contract import Target
from fuzz.mutate import json_of, trees
from texclass.reporting.page import read_result, render_page


def _seeds() -> list[bytes]:
    folder = str(Path(__file__).parents[1] / "reporting")
    if folder not in sys.path:
        sys.path.insert(0, folder)
    import page_results as made

    documents = (
        made.benchmark().to_dict(),
        made.feature(),
        made.tradeoff().to_dict(),
        made.peers().to_dict(),
        made.invariance(),
        made.stability().to_dict(),
    )
    return [json.dumps(document).encode() for document in documents]


def _page(path: Path) -> object:
    page = render_page([read_result(path)])
    assert page.startswith("<!")
    return page


TARGETS = (Target("result for the page", _seeds, _page, trees(json.loads, json_of), "result.json"),)
