"""How results name what they were found with: data, protocols, classifiers, chance, and too few clusters."""

from collections.abc import Mapping
from typing import Any

from texclass.document.wording import counted
from texclass.experiment.accuracy import LEAST_CLUSTERS

CLASSIFIERS = {
    "naive_bayes": "Naive Bayes",
    "lda": "LDA",
    "shrinkage_lda": "Shrinkage LDA",
    "euclidean": "Euclidean",
    "nearest_neighbour": "Nearest neighbour",
}
PROTOCOLS = {
    "recording": "folds over recordings",
    "operator": "leave one operator out",
    "run": "folds over whole runs",
    "blocks": "first half of the repetitions to second half",
    "few-shot": "three repetitions to second half",
    "paper": "the paper's protocol",
}
COUNTS = ("operator", "session", "test")
CHOICE = "row chosen inside the training parts"
"""What the choice of a benchmark is called beside its rows."""
FEW = 10
"""Clusters below which an accuracy above 90 % (or below 10 %) is told with a caution."""


def best_of(data: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return row and classifier of the highest accuracy, the first of equals; None if no row was computed."""
    pairs = {
        (row["name"], name): accuracy["mean"]
        for row in data["rows"]
        for name, accuracy in row["accuracy"].items()
    }
    return max(pairs, key=pairs.__getitem__, default=None)


def classifier_title(name: str) -> str:
    """Return a classifier in words."""
    return CLASSIFIERS.get(name, name.replace("_", " ").capitalize())


def protocol_title(name: str) -> str:
    """Return a protocol in words."""
    return PROTOCOLS.get(name, name)


def size(facts: Mapping[str, Any]) -> str:
    """Return how many recordings of how many materials a dataset has."""
    windows = f"{counted(facts['n_windows'], 'window')} of " if "n_windows" in facts else ""
    recordings, materials = (counted(facts[f"n_{what}s"], what) for what in ("recording", "material"))
    return f"{windows}{recordings} of {materials}"


def chance_of(data: Mapping[str, Any]) -> float:
    """Return the accuracy of answering always with the commonest material; an older result does not say."""
    facts = data["dataset"]
    return float(facts.get("chance") or 1 / facts["n_materials"])


def over(found: Mapping[str, Any]) -> str:
    """Return what the interval of an accuracy or a difference is over: " over 10 operators"."""
    return f" over {found['n_clusters']:,} {found['clusters']}s" if found.get("n_clusters") else ""


def caution(found: Mapping[str, Any]) -> str:
    """Return what the clusters of an accuracy cannot tell; nothing where they can."""
    n, what = found.get("n_clusters") or FEW, f"{found.get('clusters')}s"
    if found.get("interval", "").startswith("Wilson over"):
        why = "agree altogether" if n >= LEAST_CLUSTERS else "are too few"
        return f"{n} {what} {why}, so their spread tells nothing: each counts as one test in the interval."
    if n < FEW and found.get("interval", "").startswith("t over") and not 0.1 < found["mean"] < 0.9:
        return f"So near the end of the scale {n} {what} cannot tell well: the interval may be too narrow."
    return ""


def dataset_facts(data: Mapping[str, Any]) -> tuple[str, dict[str, str]]:
    """Return name and facts of the dataset that a result was measured on."""
    facts = data["dataset"]
    counts = [counted(facts[f"n_{what}s"], what) for what in COUNTS if facts.get(f"n_{what}s")]
    told = {
        "What it is": facts.get("title"),
        "Size": ", ".join([size(facts), *counts]),
        "Materials": ", ".join(facts.get("materials") or ()),
        "Signals": f"{facts['fs_hz']:g} Hz, {facts['unit']}" if facts.get("fs_hz") else "",
        "Chance": f"{100 * chance_of(data):.1f} %",
        "Source": facts.get("source"),
        "Licence": facts.get("licence"),
        "Input hash": data["input_hash"],
    }
    return facts["name"], {what: fact for what, fact in told.items() if fact}


def again_facts(data: Mapping[str, Any], pipeline: str) -> dict[str, str]:
    """Return what is needed to compute a result again; its dataset's facts have the whole hash."""
    hashed = data["input_hash"]
    told = {
        "Pipeline or features": pipeline,
        "Movement": data.get("movement", ""),
        "Protocol": data["protocol"],
        "Seed": str(data["seed"]),
        "Input hash": f"{hashed[:12]}\N{HORIZONTAL ELLIPSIS}" if len(hashed) > 12 else hashed,
        "Code": data.get("code_hash", ""),
    }
    return {what: fact for what, fact in told.items() if fact}
