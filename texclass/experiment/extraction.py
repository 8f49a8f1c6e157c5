"""From a dataset to a feature table on disk: streamed, resumed after a kill, never computed twice."""

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from texclass import __version__
from texclass.experiment.table import (
    FeatureTable,
    Flag,
    LeftOut,
    metadata,
    read_part,
    read_table,
    write_atomically,
    write_table,
)
from texclass.experiment.windows import by_recording, parent_id
from texclass.experiment.workers import each
from texclass.features.extractor import Plan, Reason
from texclass.features.phase_view import Channels, channels_apart
from texclass.features.sets import FeatureSet, code_hash
from texclass.loaders.dataset import Dataset, Entry
from texclass.loaders.places import cache_root
from texclass.recording import Recording, RecordingError

Progress = Callable[[int, int, str], None]
"""Called with what is done, out of how many, and what is being done."""


def cached_table(dataset: Dataset, feature_set: FeatureSet, **options: Any) -> FeatureTable:
    """Like `extract_table`, with the table kept in the cache folder, so that a second call is immediate."""
    key = table_key(dataset, feature_set, options.get("channels", "combine"))
    path = cache_root() / "features" / f"{feature_set.name}-{key}.parquet"
    return extract_table(dataset, feature_set, path, **options)


def extract_table(
    dataset: Dataset,
    feature_set: FeatureSet,
    path: str | Path,
    *,
    channels: Channels = "combine",
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> FeatureTable:
    """Compute the features of every recording of a dataset into one Parquet file.

    Each finished recording is written at once to a small file beside `path`, atomically, under a key of
    input, feature set, code and version. A run that was killed continues with what is missing; a complete
    table is only read.

    Parameters
    ----------
    dataset : Dataset
        Recordings are loaded one at a time, by the process that computes them.
    feature_set : FeatureSet
        What to compute.
    path : str or path
        The Parquet file; a table there with another key is replaced.
    channels : {"combine", "each", "auto"}
        See `FeatureExtractor`.
    n_jobs : int
        Processes; each uses one thread for linear algebra.
    skip_bad : bool
        List bad recordings in `left_out` instead of stopping at the first.
    progress : callable, optional
        Called with (done, total, "features") at the start and after each recording.

    Raises
    ------
    RecordingError
        At a bad recording (file, value, rule), or if none is left; what was done is kept.
    """
    path = Path(path)
    key = table_key(dataset, feature_set, channels)
    table = _complete(path, key)
    if table is None:
        parts = path.with_name(f"{path.name}.parts") / key
        plan = _plan(dataset, feature_set, channels, skip_bad)
        left_out = _compute_missing(dataset, plan, parts, n_jobs=n_jobs, skip_bad=skip_bad, progress=progress)
        table = _join(dataset, plan, parts, key, left_out)
        write_table(table, path)
        shutil.rmtree(parts.parent, ignore_errors=True)
    if table.left_out and not skip_bad:
        raise RecordingError(table.left_out[0].reason)
    return table


def table_key(dataset: Dataset, feature_set: FeatureSet, channels: str) -> str:
    """Digest of everything that the values of a table depend on."""
    entries = [asdict(entry) for entry in dataset.entries]
    facts = [dataset.input_hash, entries, feature_set.hash, code_hash(feature_set), channels, __version__]
    return hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:16]


def _complete(path: Path, key: str) -> FeatureTable | None:
    if not path.is_file():
        return None
    try:
        table = read_table(path)
    except ValueError:
        return None
    return table if table.key == key else None


def _plan(dataset: Dataset, feature_set: FeatureSet, channels: Channels, skip_bad: bool) -> Plan:
    """Decide what is computed on which channel; only channels kept apart need a recording to look at."""
    if len(dataset) == 0:
        raise RecordingError(f"{dataset.name}: no recording; the rule is at least one")
    if channels == "combine":
        return Plan.of(feature_set)
    for entry in dataset.entries:
        try:
            return Plan.of(feature_set, channels_apart(dataset.load(entry), channels))
        except RecordingError as error:
            if not skip_bad:
                raise
            last = error
    raise RecordingError(f"{dataset.name}: no recording can be used; the last: {last}")


def _compute_missing(
    dataset: Dataset, plan: Plan, parts: Path, *, n_jobs: int, skip_bad: bool, progress: Progress | None
) -> tuple[LeftOut, ...]:
    """Compute every recording that has no part yet; return the bad ones."""
    parts.mkdir(parents=True, exist_ok=True)
    every = [(entries, _part(parts, i)) for i, entries in enumerate(by_recording(dataset.entries))]
    missing = [(entries, part) for entries, part in every if not part.is_file()]
    report = progress or (lambda done, total, what: None)
    report(len(every) - len(missing), len(every), "features")
    bad: list[LeftOut] = []
    calls = (partial(_compute, dataset.load, entries, plan, part) for entries, part in missing)
    with closing(each(calls, n_jobs=n_jobs)) as outcomes:
        for n_done, outcome in enumerate(outcomes, start=1 + len(every) - len(missing)):
            if outcome is not None and not skip_bad:
                raise RecordingError(outcome.reason)
            bad += [] if outcome is None else [outcome]
            report(n_done, len(every), "features")
    return tuple(bad)


def _compute(
    load: Callable[[Entry], Recording], entries: Sequence[Entry], plan: Plan, part: Path
) -> LeftOut | None:
    """Compute one recording, or its windows, into its part; return why not if it is bad."""
    rows: list[dict[str, Any]] = []
    try:
        for entry in entries:
            recording = load(entry)
            row = plan.compute(recording)
            rows.append(
                {
                    "values": row.values.tolist(),  # noqa: PD011  (no pandas object)
                    "reasons": json.dumps(row.reasons),
                    "flags": json.dumps(recording.flags),
                    "ms": row.ms,
                }
            )
    except RecordingError as error:
        return LeftOut(parent_id(entries[0]), str(error))
    write_atomically(pa.Table.from_pylist(rows), part)
    return None


def _part(parts: Path, index: int) -> Path:
    return parts / f"{index:06d}.parquet"


def _join(dataset: Dataset, plan: Plan, parts: Path, key: str, left_out: tuple[LeftOut, ...]) -> FeatureTable:
    """Join the parts in the dataset's order."""
    parted = ((entries, _part(parts, i)) for i, entries in enumerate(by_recording(dataset.entries)))
    found = [(entries, part) for entries, part in parted if part.is_file()]
    if not found:
        raise RecordingError(f"{dataset.name}: no recording can be used; the first: {left_out[0].reason}")
    rows = [row for _, part in found for row in read_part(part, len(plan.columns))]
    entries = [entry for group, _ in found for entry in group]
    ids = [entry.recording_id for entry in entries]
    whole = [parent_id(entry) for entry in entries]
    flags = (Flag(i, flag) for i, row in zip(whole, rows, strict=True) for flag in row.flags)
    values = pd.DataFrame(np.array([row.values for row in rows]), columns=plan.columns)  # noqa: PD011
    return FeatureTable(
        pd.concat([metadata(entries), values], axis=1),
        plan.columns,
        np.array([row.ms for row in rows]),
        tuple(Reason(i, *pair) for i, row in zip(ids, rows, strict=True) for pair in row.reasons),
        tuple(dict.fromkeys(flags)),
        left_out,
        key,
    )
