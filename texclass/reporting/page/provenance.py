"""What stands behind the results: datasets, and what is needed to compute them again."""

from collections.abc import Iterator, Sequence
from typing import Any

from texclass.reporting.page.blocks import Table, simple_table
from texclass.reporting.page.read import Result
from texclass.reporting.page.wording import sentence, size

COUNTS = (("n_operators", "operators"), ("n_sessions", "sessions"), ("n_tests", "tests"))


def dataset_facts(results: Sequence[Result]) -> list[tuple[str, list[tuple[str, str]]]]:
    """Return name and (what, fact) pairs of every dataset, each once."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for result in results:
        facts = result.data.get("dataset")
        if facts:
            known = found.setdefault((facts["name"], result.data["input_hash"]), {})
            known.update({key: value for key, value in facts.items() if value or key not in known})
    return [(name, list(_facts(facts, hashed))) for (name, hashed), facts in found.items()]


def _facts(facts: dict[str, Any], hashed: str) -> Iterator[tuple[str, str]]:
    if facts.get("title"):
        yield "What it is", facts["title"]
    counts = [size(facts), *(f"{facts[key]} {what}" for key, what in COUNTS if facts.get(key))]
    yield "Size", ", ".join(counts)
    if facts.get("materials"):
        yield "Materials", ", ".join(facts["materials"])
    for key in ("source", "licence"):
        if facts.get(key):
            yield key.capitalize(), facts[key]
    if facts.get("notes"):
        yield "Notes", " ".join(map(sentence, facts["notes"]))
    yield "Input hash", hashed


def again_table(results: Sequence[Result]) -> Table:
    """Return for every result the file, pipeline, protocol, seed and hash it came from."""
    titles = ("File", "Pipeline or features (hash)", "Protocol", "Seed", "Input hash")
    rows = [
        (r.file, _pipeline(r.data), r.data.get("protocol", ""), str(r.data.get("seed", "")), _hash(r.data))
        for r in results
    ]
    return simple_table("What the results came from", titles, rows, n_text=5)


def _hash(data: dict[str, Any]) -> str:
    """Return the input hash, cut where the description of the dataset has all of it."""
    found = str(data.get("input_hash") or data.get("battery", ""))
    return f"{found[:12]}\N{HORIZONTAL ELLIPSIS}" if "dataset" in data and len(found) > 12 else found


def _pipeline(data: dict[str, Any]) -> str:
    pipeline = data.get("pipeline")
    if isinstance(pipeline, dict):
        return f"{pipeline['name']} ({pipeline['hash']}), features {pipeline['features']}"
    if pipeline is not None:
        return f"{pipeline} ({data['pipeline_hash']})"
    return str(data.get("features", ""))


def version_table(results: Sequence[Result]) -> Table:
    """Return the versions of every result; one column where all agree."""
    sets: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for result in results:
        if versions := result.data.get("versions"):
            sets.setdefault(tuple(versions.items()), []).append(result.file)
    names = list(dict.fromkeys(name for versions in sets for name, _ in versions))
    titles = ["Version" if len(sets) == 1 else ", ".join(files) for files in sets.values()]
    rows = ((name, *(dict(versions).get(name, "") for versions in sets)) for name in names)
    return simple_table("Versions", ("Package", *titles), rows, n_text=1 + len(sets))
