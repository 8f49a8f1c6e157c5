"""How datasets, protocols and classifiers of saved results are named wherever such results are told."""

from collections.abc import Mapping
from typing import Any

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
COUNTS = ("operators", "sessions", "tests")


def classifier_title(name: str) -> str:
    """Return a classifier in words."""
    return CLASSIFIERS.get(name, name.replace("_", " ").capitalize())


def protocol_title(name: str) -> str:
    """Return a protocol in words."""
    return PROTOCOLS.get(name, name)


def size(facts: Mapping[str, Any]) -> str:
    """Return how many recordings of how many materials a dataset has."""
    windows = f"{facts['n_windows']:,} windows of " if "n_windows" in facts else ""
    return f"{windows}{facts['n_recordings']:,} recordings of {facts['n_materials']} materials"


def dataset_facts(data: Mapping[str, Any]) -> tuple[str, dict[str, str]]:
    """Return name and facts of the dataset that a result was measured on."""
    facts = data["dataset"]
    counts = [f"{facts[f'n_{what}']} {what}" for what in COUNTS if facts.get(f"n_{what}")]
    told = {
        "What it is": facts.get("title"),
        "Size": ", ".join([size(facts), *counts]),
        "Materials": ", ".join(facts.get("materials") or ()),
        "Source": facts.get("source"),
        "Licence": facts.get("licence"),
        "Input hash": data["input_hash"],
    }
    return facts["name"], {what: fact for what, fact in told.items() if fact}


def again_facts(data: Mapping[str, Any], pipeline: str) -> dict[str, str]:
    """Return what is needed to compute a result again; its dataset's facts have the whole hash."""
    hashed = data["input_hash"]
    return {
        "Pipeline or features": pipeline,
        "Protocol": data["protocol"],
        "Seed": str(data["seed"]),
        "Input hash": f"{hashed[:12]}\N{HORIZONTAL ELLIPSIS}" if len(hashed) > 12 else hashed,
    }
