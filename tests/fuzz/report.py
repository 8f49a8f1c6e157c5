"""The report of a run: JSON, and a table in Markdown."""

import json
from pathlib import Path
from typing import Any

from fuzz.contract import MOST_GROWTH_MB, MOST_SECONDS

_SUMMED = ("inputs", "accepted", "refused", "broken", "timeouts", "crashes")
_COLUMNS = (*_SUMMED[:3], "other exceptions", *_SUMMED[4:], "slowest (ms)", "peak (MB)", "inputs/s")
_TEXT = """# Readers fed with rubbish

{inputs:,} inputs: {accepted:,} were read, {refused:,} refused with a message that names the file,
{broken:,} broke a promise ({timeouts} took too long, {crashes} ended the process).

A reader may return a valid object or raise a ValueError or OSError that names its file. It may raise or warn
of nothing else, take no more than {seconds:g} s of CPU or {growth} MB for an input of at most 64 kB,
unpickle, start or write nothing and leave no file behind. "Other exceptions" counts what broke any of
these promises, but for time and the end of the process. "peak" is the resident memory of the process,
libraries included.
"""


def write_report(output: Path, found: dict[str, Any], facts: dict[str, Any]) -> None:
    """Write OUTPUT.json and OUTPUT.md; called after each target, so that partial results stay."""
    total = {key: sum(one[key] for one in found.values()) for key in _SUMMED}
    allowed = {"seconds_allowed": MOST_SECONDS, "growth_allowed_mb": MOST_GROWTH_MB}
    document = {**facts, **allowed, "total": total, "targets": found}
    output.parent.mkdir(parents=True, exist_ok=True)
    output.with_suffix(".json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    output.with_suffix(".md").write_text(_markdown(document), encoding="utf-8")


def _markdown(document: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in document["versions"].items())
    lines = [
        _TEXT.format(**document["total"], seconds=MOST_SECONDS, growth=MOST_GROWTH_MB),
        f"| reader | {' | '.join(_COLUMNS)} |",
        f"|---|{'---:|' * len(_COLUMNS)}",
        *(_row(name, one) for name, one in document["targets"].items()),
        "",
        *_findings(document["targets"]),
        f"Engine {document['engine']}, seed {document['seed']}; {versions}.",
        "Made by `python tests/fuzz/run.py`.",
    ]
    return "\n".join(lines) + "\n"


def _row(name: str, one: dict[str, Any]) -> str:
    other = one["broken"] - one["timeouts"] - one["crashes"]
    cells = [*(one[key] for key in _SUMMED[:3]), other, one["timeouts"], one["crashes"]]
    cells += [round(1000 * one["slowest_s"]), one["peak_mb"], one["inputs_per_s"]]
    return f"| {name} | {' | '.join(f'{cell:,}' if cell is not None else '-' for cell in cells)} |"


def _findings(found: dict[str, Any]) -> list[str]:
    lines = [
        f"- {name}: {times} x {what}"
        for name, one in found.items()
        for what, times in one["findings"].items()
    ]
    return ["What broke a promise:", "", *lines, ""] if lines else []
