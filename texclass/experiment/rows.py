"""Rows of a pipeline matched with what the recordings of a dataset have."""

from collections import Counter
from dataclasses import dataclass

from texclass.experiment.definition import RowDefinition
from texclass.experiment.table import FeatureTable
from texclass.features.sets import FeatureSet


@dataclass(frozen=True)
class Ready:
    """A row of the pipeline matched with what the dataset has.

    Attributes
    ----------
    definition
        The row.
    columns
        Its columns in the table; empty when the row cannot be computed.
    n_features
        Columns that reach the classifier, or would if the dataset lacked nothing.
    missing
        What the dataset lacks for it.
    """

    definition: RowDefinition
    columns: tuple[str, ...]
    n_features: int
    missing: str | None = None


def ready(row: RowDefinition, feature_set: FeatureSet, table: FeatureTable) -> Ready:
    """Match a row with the table; a feature that no recording has is missing."""
    found = {name: table.matching(feature_set.columns_of([name])) for name in row.features}
    defined = {c for names in found.values() for c in names if table.frame[c].notna().any()}
    by_reason: dict[str, list[str]] = {}
    for name, columns in found.items():
        if not defined.intersection(columns):
            by_reason.setdefault(_reason_of(table, name), []).append(name)
    missing = "; ".join(f"{reason} ({', '.join(names)})" for reason, names in by_reason.items()) or None
    every = tuple(dict.fromkeys(c for names in found.values() for c in names))
    usable = tuple(c for c in every if c in defined)
    n_features = len(usable if row.skip_missing else every)
    return Ready(
        row,
        usable if missing is None or row.skip_missing else (),
        min(row.select.n, n_features) if row.select else n_features,
        missing,
    )


def _reason_of(table: FeatureTable, name: str) -> str:
    feature = name.split(".", 1)[0]
    reasons = Counter(r.reason for r in table.reasons if r.feature.split("/", 1)[-1] in (name, feature))
    return reasons.most_common(1)[0][0]
