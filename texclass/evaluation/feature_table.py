"""The feature table of a dataset: computed one recording at a time, resumed after a kill, never done twice.

It is one Parquet file that also holds why values are undefined. While it is being made, each finished
recording stands in a small file of its own beside it.
"""

import hashlib
import io
import json
import logging
import re
import shutil
from collections import Counter
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, replace
from functools import partial, reduce
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from texclass import __version__
from texclass.atomic_write import cache_root, check_suffix, sibling_path, write_atomic
from texclass.evaluation.parts import Part, read_part, write_part
from texclass.evaluation.windows import Window, by_recording, parent_id
from texclass.evaluation.workers import Progress, each
from texclass.features.extractor import Reason, describe_missing_values
from texclass.features.phase_view import Channels, separate_channels
from texclass.features.plan import Plan
from texclass.features.sets import FeatureSet, code_hash
from texclass.loaders.dataset import Dataset, Entry
from texclass.recording import RecordingError, Samples, axes_differ, describe_axes
from texclass.reporting.wording import counted

METADATA = ("recording_id", "surface", "operator", "session", "repetition")
"""Columns of every table, before the features; tables of windows add `parent`, the recording; and
`between`, where windows overlap to train."""


class FoundPhases(NamedTuple):
    """Number of taps of a recording, and seconds of its movement and of the whole."""

    n_taps: int
    movement_s: float
    duration_s: float


class LeftOut(NamedTuple):
    """A recording that could not be used, and why."""

    recording_id: str
    reason: str

    def __str__(self) -> str:
        return f"{self.recording_id}: {self.reason}"


@dataclass(frozen=True, eq=False)
class FeatureTable:
    """The features of a dataset.

    Attributes
    ----------
    frame : DataFrame
        One row a recording (or window) in the dataset's order: the columns of `METADATA`, then the features
        (NaN where undefined).
    columns : tuple of str
        The feature columns.
    ms : ndarray of shape (n_recordings,)
        Milliseconds that each recording took, segmentation included, loading not.
    reasons : tuple of Reason
        Why features are undefined.
    flags : tuple of (str, str)
        What loaders noticed of recordings that are used all the same ("clipped: 3.1 % ...").
    left_out : tuple of LeftOut
        Bad recordings that were skipped.
    key : str
        Digest of input, feature set, code and version.
    phases : tuple of FoundPhases
        What was found in each recording.
    """

    frame: pd.DataFrame
    columns: tuple[str, ...]
    ms: Samples
    reasons: tuple[Reason, ...] = ()
    flags: tuple[tuple[str, str], ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    key: str = ""
    phases: tuple[FoundPhases, ...] = ()

    @property
    def n_recordings(self) -> int:
        """Number of rows."""
        return len(self.frame)

    @property
    def n_columns(self) -> int:
        """Number of feature columns."""
        return len(self.columns)

    @property
    def values(self) -> Samples:
        """The features, shape (n_recordings, n_columns)."""
        return self.of(self.columns)

    @property
    def surfaces(self) -> Any:
        """The label of each row, shape (n_recordings,)."""
        return self.frame["surface"].to_numpy(dtype=str)

    @property
    def defined(self) -> tuple[str, ...]:
        """The feature columns that some recording has."""
        return tuple(c for c in self.columns if self.frame[c].notna().any())

    def of(self, columns: Sequence[str]) -> Samples:
        """Return some of the columns, shape (n_recordings, n_chosen)."""
        return self.frame[list(columns)].to_numpy(dtype=np.float64)

    def matching(self, base: Sequence[str]) -> tuple[str, ...]:
        """Return the columns named in `base`, under every channel prefix, in the order of the table."""
        wanted = set(base)
        return tuple(c for c in self.columns if c in wanted or c.rpartition("/")[2] in wanted)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What loaders doubt of the recordings, each once, with how many it is true of."""
        kinds = ("unit:", "clipped:", "constant:", "narrow band:", "time:", "merged log:", "divided:")
        found: dict[str, list[tuple[str, str]]] = {}
        for name, flag in self.flags:
            if flag.startswith(kinds):
                found.setdefault(re.sub(r"[\d.]+", "", flag), []).append((name, flag))
        n = self.frame["parent" if "parent" in self.frame else "recording_id"].nunique()
        return tuple(
            f"{len(same)} of {n} recordings: {same[0][1]}{f' (the first: {same[0][0]})' if n > 1 else ''}"
            for same in found.values()
        )

    @property
    def summary(self) -> str:
        """What was found in the recordings and which columns have no value, in one line."""
        n = len(self.phases)
        movement_s, whole_s = sum(p.movement_s for p in self.phases), sum(p.duration_s for p in self.phases)
        tapped = sum(one.n_taps > 0 for one in self.phases)
        found = (
            f"movement in {movement_s:.3g} of {whole_s:.3g} s, taps in {tapped} of {counted(n, 'recording')}"
        )
        return f"{found}; {describe_missing_values(self.frame[list(self.columns)], self.reasons)}"

    def reason_of(self, name: str) -> str:
        """Return the commonest reason why a feature, or the feature of a column, has no value."""
        names = (name, name.split(".", 1)[0])
        reasons = Counter(r.reason for r in self.reasons if r.feature.rpartition("/")[2] in names)
        return reasons.most_common(1)[0][0]


def metadata(entries: Sequence[Entry]) -> pd.DataFrame:
    """Return what is known of recordings (or windows of them) before they are loaded, one row each."""
    frame = pd.DataFrame([[getattr(e, name) for name in METADATA] for e in entries], columns=METADATA)
    text = [name for name in METADATA if name != "repetition"]
    frame = frame.astype({**dict.fromkeys(text, "str"), "repetition": "Int64"})
    if any(isinstance(entry, Window) for entry in entries):
        frame["parent"] = pd.Series([parent_id(entry) for entry in entries], dtype="str")
    between = [isinstance(entry, Window) and entry.between for entry in entries]
    return frame.assign(between=between) if any(between) else frame


def cached_table(dataset: Dataset, *feature_sets: FeatureSet, **options: Any) -> FeatureTable:
    """Like `extract_table`, with the table kept in the cache folder, so that a second call is immediate.

    Of several sets (with no column in common) each has a file of its own: a new feature does not make the old
    ones compute again. The recordings are those that all tables have, without copies of others.

    Raises
    ------
    RecordingError
        As `extract_table`, or if recordings of different surfaces have the same content.
    """
    dataset, copies = _without_copies(dataset, skip_bad=options.get("skip_bad", False))
    tables = []
    for one in feature_sets:
        key = table_key(dataset, one, options.get("channels", "combine"))
        tables.append(extract_table(dataset, one, _in_cache(one, key), **options))
    table = reduce(_beside, tables)
    table = replace(table, left_out=table.left_out + copies)
    for doubt in table.doubts:
        logging.getLogger(__name__).warning("note: %s", doubt)  # on standard error, unless logging is set up
    return table


def _without_copies(dataset: Dataset, *, skip_bad: bool) -> tuple[Dataset, tuple[LeftOut, ...]]:
    """Return a dataset without recordings (or their windows) that have the content of another, and those.

    One of several copies stays; none where their labels differ.
    """
    left_out: dict[str, LeftOut] = {}
    present = {parent_id(entry) for entry in dataset.entries}
    for alike in dataset.copies:
        first, *others = [entry for entry in alike if entry.recording_id in present] or alike[:1]
        if len({entry.surface for entry in (first, *others)}) > 1:
            names = ", ".join(f"{entry.recording_id!r} of {entry.surface!r}" for entry in (first, *others))
            problem = f"recordings of different surfaces have the same content: {names}"
            if not skip_bad:
                raise RecordingError(
                    f"{dataset.name}: {problem}. Expected one surface: remove the files in the wrong place, "
                    "or leave all out with --skip-bad"
                )
            left_out |= {one.recording_id: LeftOut(one.recording_id, problem) for one in (first, *others)}
        for one in others:
            same = LeftOut(one.recording_id, f"same content as {first.recording_id!r}")
            left_out.setdefault(one.recording_id, same)
    if not left_out:
        return dataset, ()
    entries = tuple(entry for entry in dataset.entries if parent_id(entry) not in left_out)
    return replace(dataset, entries=entries), tuple(left_out.values())


def _in_cache(feature_set: FeatureSet, key: str) -> Path:
    return cache_root() / "features" / f"{feature_set.name}-{key}.parquet"


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
    """Compute the features of every recording of a dataset into one Parquet or CSV file.

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
        Output file; its suffix decides. A Parquet file (.parquet) keeps the key, and a table with another key
        is replaced. A CSV file (.csv) has no room for the key: the table is kept in the cache folder, too.
    channels : {"combine", "each", "auto", "all"}
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
    ValueError
        If the suffix of `path` is another one.
    """
    path, key = check_suffix(path, ".parquet", ".csv"), table_key(dataset, feature_set, channels)
    if path.suffix.lower() == ".csv":
        options: dict[str, Any] = {"channels": channels, "n_jobs": n_jobs, "skip_bad": skip_bad}
        kept = extract_table(dataset, feature_set, _in_cache(feature_set, key), **options, progress=progress)
        write_atomic(path, kept.frame.to_csv(index=False))
        return kept
    table: FeatureTable | None = None
    with suppress(FileNotFoundError, ValueError):  # not there, or damaged: it is computed
        table = read_table(path)
    while table is None or table.key != key:
        folder = sibling_path(path, ".parts") / key
        plan = _plan(dataset, feature_set, channels, skip_bad)
        left_out = _compute_missing(dataset, plan, folder, n_jobs, skip_bad, progress)
        table = _join(dataset, plan, folder, key, left_out)
        if table is not None:
            write_table(table, path)
            shutil.rmtree(folder.parent, ignore_errors=True)
            break
        # Another process finished the same table, and took the parts away.
        with suppress(FileNotFoundError, ValueError):
            table = read_table(path)
    if table.left_out and not skip_bad:
        raise RecordingError(table.left_out[0].reason)
    return table


def extract_partitions(
    dataset: Dataset,
    feature_set: FeatureSet,
    folder: str | Path,
    size: int,
    *,
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Compute the features of a dataset into a folder of Parquet files that never meet in one process.

    Each file is what `extract_table` makes of `size` recordings, computed, joined and written by one worker;
    files that stand are kept, and so are the recordings of one that was killed half-way. ``pd.read_parquet``
    and Dask read the folder as one table.

    Parameters
    ----------
    dataset, feature_set, n_jobs, skip_bad
        See `extract_table`.
    folder : str or Path
        Where the files stand, named after the place of their recordings in the dataset.
    size : int
        Recordings of a file (the last may hold fewer).
    progress : callable, optional
        Called with (done, total, "partitions") after each file.

    Returns
    -------
    DataFrame of shape (n_partitions, 3)
        Indexed by file: `recordings`, the recordings `left_out`, and the `doubts` of loaders.

    Raises
    ------
    ValueError
        If `size` is less than 1.
    RecordingError
        At the first file with a bad recording; what was done is kept.
    """
    if size < 1:
        raise ValueError(f"size must be at least 1 recording, got {size}")
    groups = list(by_recording(dataset.entries))
    calls = []
    for first in range(0, len(groups), size):
        some = replace(dataset, entries=tuple(chain.from_iterable(groups[first : first + size])))
        path = Path(folder) / f"{first:09d}.parquet"
        calls.append(partial(_partition, some, feature_set, path, skip_bad))
    facts = each(calls, n_jobs=n_jobs, progress=progress, what="partitions", total=len(calls))
    with closing(facts):
        told = pd.DataFrame(list(facts), columns=["partition", "recordings", "left_out", "doubts"])
    return told.set_index("partition")


def _partition(
    dataset: Dataset, feature_set: FeatureSet, path: Path, skip_bad: bool
) -> tuple[str, int, tuple[LeftOut, ...], tuple[str, ...]]:
    """Compute some recordings into their file, and return what a report says of it: no table travels."""
    table = extract_table(dataset, feature_set, path, skip_bad=skip_bad)
    return path.name, table.n_recordings, table.left_out, table.doubts


def table_key(dataset: Dataset, feature_set: FeatureSet, channels: str) -> str:
    """Digest of everything that the values of a table depend on."""
    entries = [asdict(entry) for entry in dataset.entries]
    facts = [dataset.input_hash, entries, feature_set.hash, code_hash(feature_set), channels, __version__]
    return hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:16]


def read_table(path: str | Path) -> FeatureTable:
    """Read a feature table.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file is not a whole feature table; the message names it.
    """
    try:
        arrow = pq.read_table(path, use_threads=False)
        facts = json.loads((arrow.schema.metadata or {})[b"texclass"])
        columns, ms = tuple(facts["columns"]), np.array(facts["ms"], dtype=np.float64)
        lacking = [name for name in (*METADATA, *columns) if arrow.schema.names.count(name) != 1]
        if lacking or ms.shape != (arrow.num_rows,) or not isinstance(facts["key"], str):
            raise ValueError(f"{lacking or ms.shape}. Expected each column once, as many times as rows")
        frame = arrow.to_pandas()
        if list(frame.columns) != arrow.schema.names:
            raise ValueError(f"columns {list(frame.columns)!r:.80}. Expected those of the schema")
        reasons = tuple(Reason(*reason) for reason in facts["reasons"])
        flags = tuple((name, flag) for name, flag in facts["flags"])
        left_out = tuple(LeftOut(*bad) for bad in facts["left_out"])
        phases = tuple(FoundPhases(*found) for found in facts["phases"])
        table = FeatureTable(frame, columns, ms, reasons, flags, left_out, facts["key"], phases)
        table.of(columns)  # or raises: a column holds no numbers
        return table
    except FileNotFoundError:
        raise
    except Exception as error:  # damaged bytes make pyarrow and pandas raise almost anything
        raise ValueError(f"{path}: not a feature table of texclass ({error})") from error


def write_table(table: FeatureTable, path: Path) -> None:
    """Write a feature table: complete, or not at all."""
    facts = {
        "key": table.key,
        "columns": table.columns,
        "ms": table.ms.tolist(),
        "reasons": table.reasons,
        "flags": table.flags,
        "left_out": table.left_out,
        "phases": table.phases,
    }
    arrow = pa.Table.from_pandas(table.frame, preserve_index=False)
    stated = {**(arrow.schema.metadata or {}), b"texclass": json.dumps(facts).encode()}
    file = io.BytesIO()
    pq.write_table(arrow.replace_schema_metadata(stated), file)
    write_atomic(path, file.getvalue())


def _plan(dataset: Dataset, feature_set: FeatureSet, channels: Channels, skip_bad: bool) -> Plan:
    """Decide what is computed on which channel; only channels kept apart need a recording to look at."""
    problem = "there is none. Expected at least one"
    for entry in dataset.entries:
        try:
            apart = () if channels == "combine" else separate_channels(dataset.load(entry), channels)
            return Plan.of(feature_set, apart)
        except RecordingError as error:
            if not skip_bad:
                raise
            problem = str(error)
    raise RecordingError(f"{dataset.name}: no recording can be used; {problem}")


def _files(dataset: Dataset, folder: Path) -> list[tuple[tuple[Entry, ...], Path]]:
    """Return each recording, or the windows of it, with the file of its part."""
    groups = enumerate(by_recording(dataset.entries))
    return [(entries, folder / f"{number:06d}.json") for number, entries in groups]


def _compute_missing(
    dataset: Dataset, plan: Plan, folder: Path, n_jobs: int, skip_bad: bool, progress: Progress | None
) -> tuple[LeftOut, ...]:
    """Compute every recording that has no part yet; return the bad ones."""
    every = _files(dataset, folder)
    missing = [(entries, part) for entries, part in every if not part.is_file()]
    done = len(every) - len(missing)
    if progress:
        progress(done, len(every), "features")
    calls = (partial(write_part, dataset.load, entries, plan, part) for entries, part in missing)
    bad: list[LeftOut] = []
    reported: dict[str, Any] = {"progress": progress, "what": "features", "done": done, "total": len(every)}
    with closing(each(calls, n_jobs=n_jobs, **reported)) as outcomes:
        for (entries, _), problem in zip(missing, outcomes, strict=True):
            if problem and not skip_bad:
                raise RecordingError(problem)
            bad += [LeftOut(parent_id(entries[0]), problem)] if problem else []
    return tuple(bad)


def _join(
    dataset: Dataset, plan: Plan, folder: Path, key: str, left_out: tuple[LeftOut, ...]
) -> FeatureTable | None:
    """Join the parts in the dataset's order; None if one is not there any more."""
    bad = {item.recording_id for item in left_out}
    found: list[tuple[Entry, Part]] = []
    for entries, part in _files(dataset, folder):
        if parent_id(entries[0]) in bad:
            continue
        try:
            found += zip(entries, read_part(part, len(plan.columns)), strict=True)
        except FileNotFoundError:
            return None
    if not found:
        raise RecordingError(f"{dataset.name}: no recording can be used; the first: {left_out[0].reason}")
    axes = Counter(tuple(row.axes) for _, row in found)
    usual, n_usual = axes.most_common(1)[0]
    if any(axes_differ(names, usual) for names in axes):
        of_others = (
            f"but {n_usual} of {len(found)} have {describe_axes(usual)}. Expected the same axes in each "
            "recording: select them with --column, or leave it out with --skip-bad"
        )
        for entry, row in found:
            if axes_differ(row.axes, usual):
                problem = f"{parent_id(entry)}: {describe_axes(row.axes)}, {of_others}"
                left_out += (LeftOut(parent_id(entry), problem),)
        left_out = tuple(dict.fromkeys(left_out))
        found = [(entry, row) for entry, row in found if not axes_differ(row.axes, usual)]
    entries, rows = zip(*found, strict=True)
    values = pd.DataFrame(np.array([row.features for row in rows]), columns=plan.columns)
    frame, ms = pd.concat([metadata(entries), values], axis=1), np.array([row.ms for row in rows])
    reasons = tuple(Reason(entry.recording_id, *pair) for entry, row in found for pair in row.reasons)
    flags = dict.fromkeys((parent_id(entry), flag) for entry, row in found for flag in row.flags)
    phases = tuple(FoundPhases(*row.phases) for _, row in found)
    return FeatureTable(frame, plan.columns, ms, reasons, tuple(flags), left_out, key, phases)


def _beside(table: FeatureTable, other: FeatureTable) -> FeatureTable:
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
