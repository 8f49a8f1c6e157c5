"""One feature table from several that are cached apart: a new feature does not compute the old ones again."""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

from texclass.experiment.extraction import cached_table
from texclass.experiment.table import FeatureTable
from texclass.features.sets import FeatureSet
from texclass.loaders.dataset import Dataset


def cached_tables(dataset: Dataset, feature_sets: Sequence[FeatureSet], **options: Any) -> FeatureTable:
    """Return the features of several sets as one table; see `cached_table`.

    Parameters
    ----------
    dataset : Dataset
        Labelled recordings.
    feature_sets : sequence of FeatureSet
        With no column in common.
    **options
        As in `extract_table`.
    """
    return reduce(_joined, (cached_table(dataset, one, **options) for one in feature_sets))


def _joined(table: FeatureTable, other: FeatureTable) -> FeatureTable:
    """Return the recordings that both have, in the order of the first."""
    ms = dict(zip(other.frame["recording_id"], other.ms, strict=True))
    both = table.frame["recording_id"].isin(list(ms)).to_numpy()
    columns = other.frame[["recording_id", *other.columns]]
    frame = table.frame[both].merge(columns, on="recording_id", how="left", validate="1:1")
    return replace(
        table,
        frame=frame,
        columns=table.columns + other.columns,
        ms=table.ms[both] + [ms[i] for i in frame["recording_id"]],
        reasons=table.reasons + other.reasons,
        flags=tuple(dict.fromkeys(table.flags + other.flags)),
        left_out=tuple(dict.fromkeys(table.left_out + other.left_out)),
        key=f"{table.key}+{other.key}",
    )
