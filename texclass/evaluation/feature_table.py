"""Feature table of a dataset, which is computed one recording at a time and cached.

The table is stored in one NPZ file, which also contains the reasons for undefined values. Until it is
complete, each finished recording is stored in a checkpoint next to the file, so that an interrupted
computation can be continued. CSV and Parquet files are written from the table in the cache.
"""

import hashlib
import io
import json
import logging
import re
import shutil
from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, replace
from functools import partial, reduce
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
import pandas as pd

from texclass import __version__
from texclass.atomic_write import cache_root, check_suffix, sibling_path, write_atomic
from texclass.evaluation.checkpoints import CheckpointRow, read_checkpoint, write_checkpoint
from texclass.evaluation.windows import Window, file_id, group_by_recording, parent_id
from texclass.evaluation.workers import Progress, run_parallel
from texclass.features.phase_view import Channels, separate_channels
from texclass.features.plan import Plan
from texclass.features.reasons import Reason, describe_missing_values
from texclass.features.sets import FeatureSet, code_hash
from texclass.loaders.dataset import Dataset, Entry, label_columns
from texclass.recording import RecordingError, Samples, axes_differ, describe_axes
from texclass.reporting.wording import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

METADATA = ("recording_id", "surface", "operator", "session", "repetition")
"""Label columns of every table. Columns of further labels follow, if the dataset has some. Tables of windows
also have `parent` (the recording) and, if training windows overlap, `is_train_only`. If surfaces are marked
in a recording, `file_id` is the whole recording."""


class PhaseSummary(NamedTuple):
    """Number of taps in a recording, and durations of its movement and of the whole recording in s."""

    n_taps: int
    movement_s: float
    duration_s: float


class LeftOutRecording(NamedTuple):
    """Recording that cannot be used, and the reason why."""

    recording_id: str
    reason: str

    def __str__(self) -> str:
        return f"{self.recording_id}: {self.reason}"


@dataclass(frozen=True, eq=False)
class FeatureTable:
    """Features of all recordings of a dataset.

    Attributes
    ----------
    frame : DataFrame
        One row per recording (or window) in the order of the dataset: the columns of `METADATA`, further
        labels, then the features (NaN where undefined).
    columns : tuple of str
        Names of the feature columns.
    ms : ndarray of shape (n_recordings,)
        Computing time of each recording in ms, including segmentation but not loading.
    reasons : tuple of Reason
        Reasons for undefined features.
    flags : tuple of (str, str)
        Pairs of a recording id and a notice of its loader, for example a notice that begins with "clipped:".
    left_out : tuple of LeftOutRecording
        Recordings that could not be used.
    key : str
        Digest of the input, the feature set, the code and the version.
    phases : tuple of PhaseSummary
        Phases of each recording.

    Examples
    --------
    >>> import pandas as pd
    >>> frame = pd.DataFrame({"recording_id": ["a", "b"], "surface": ["oak", "cork"], "rms": [1.0, 2.0]})
    >>> table = FeatureTable(frame, ("rms",), np.zeros(2))
    >>> table.values.tolist(), table.surfaces.tolist()
    ([[1.0], [2.0]], ['oak', 'cork'])
    """

    frame: pd.DataFrame
    columns: tuple[str, ...]
    ms: Samples
    reasons: tuple[Reason, ...] = ()
    flags: tuple[tuple[str, str], ...] = ()
    left_out: tuple[LeftOutRecording, ...] = ()
    key: str = ""
    phases: tuple[PhaseSummary, ...] = ()

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
        """Features, shape (n_recordings, n_columns)."""
        return self.select(self.columns)

    @property
    def surfaces(self) -> Any:
        """Surface of each row, shape (n_recordings,)."""
        return self.frame["surface"].to_numpy(dtype=str)

    @property
    def defined_columns(self) -> tuple[str, ...]:
        """Feature columns that have a value in at least one recording."""
        return tuple(c for c in self.columns if self.frame[c].notna().any())

    def select(self, columns: Sequence[str]) -> Samples:
        """Return the values of some columns, shape (n_recordings, len(columns))."""
        return self.frame[list(columns)].to_numpy(dtype=np.float64)

    def plot(self, column: str, ax: "Axes | None" = None) -> "Axes":
        """Plot the values of a column per surface; see `plot_features`."""
        from texclass.evaluation.plots import plot_features

        return plot_features(self, column, ax)

    def match_columns(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return the columns that have these names with or without a channel prefix, in table order."""
        wanted = set(names)
        return tuple(c for c in self.columns if c in wanted or c.rpartition("/")[2] in wanted)

    @property
    def notices(self) -> tuple[str, ...]:
        """Distinct notices of the loaders about implausible recordings, with the number of recordings."""
        kinds = (
            "unit:", "clipped:", "constant:", "few levels:", "narrow band:", "time:", "merged log:",
            "divided:",
        )  # fmt: skip
        flags_by_text: dict[str, list[tuple[str, str]]] = {}
        for name, flag in self.flags:
            if flag.startswith(kinds):
                flags_by_text.setdefault(re.sub(r"[\d.]+", "", flag), []).append((name, flag))
        n = self.frame["parent" if "parent" in self.frame else "recording_id"].nunique()
        return tuple(
            f"{len(flags)} of {n} recordings: {flags[0][1]}{f' (the first: {flags[0][0]})' if n > 1 else ''}"
            for flags in flags_by_text.values()
        )

    @property
    def summary(self) -> str:
        """One-line summary of the phases of all recordings and of the undefined columns."""
        n = len(self.phases)
        movement_s, total_s = sum(p.movement_s for p in self.phases), sum(p.duration_s for p in self.phases)
        n_with_taps = sum(one.n_taps > 0 for one in self.phases)
        phases = (
            f"movement in {movement_s:.3g} of {total_s:.3g} s, "
            f"taps in {n_with_taps} of {counted(n, 'recording')}"
        )
        return f"{phases}; {describe_missing_values(self.frame[list(self.columns)], self.reasons)}"

    def reason_of(self, name: str) -> str:
        """Return the most frequent reason why a feature, given by its name or a column, is undefined."""
        names = (name, name.split(".", 1)[0])
        reasons = Counter(r.reason for r in self.reasons if r.feature.rpartition("/")[2] in names)
        return reasons.most_common(1)[0][0]


def metadata(entries: Sequence[Entry]) -> pd.DataFrame:
    """Return a table with the labels of each recording or window, without loading their signals."""
    frame = pd.DataFrame([[getattr(e, name) for name in METADATA] for e in entries], columns=METADATA)
    for name, values in label_columns(entries).items():
        frame[name] = values
    if any(isinstance(entry, Window) for entry in entries):
        frame["parent"] = [parent_id(entry) for entry in entries]
    file_ids = [file_id(entry) for entry in entries]
    if file_ids != [parent_id(entry) for entry in entries]:
        frame["file_id"] = file_ids
    train_only = [isinstance(entry, Window) and entry.is_train_only for entry in entries]
    return _with_types(frame.assign(is_train_only=train_only) if any(train_only) else frame)


def _with_types(labels: pd.DataFrame) -> pd.DataFrame:
    """Convert label columns to text, `repetition` to integers, and `is_train_only` to booleans."""
    types: dict[Hashable, str] = {"repetition": "Int64", "is_train_only": "bool"}
    return labels.astype({name: types.get(name, "str") for name in labels})


def cached_table(
    dataset: Dataset,
    *feature_sets: FeatureSet,
    channels: Channels = "combine",
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> FeatureTable:
    """Compute the feature table of a dataset, or read it from the cache folder.

    Each feature set has its own file, so that adding a feature does not require computing all features again.

    Parameters
    ----------
    dataset : Dataset
        Recordings or windows. If several recordings have the same content, only the first is used.
    *feature_sets : FeatureSet
        Feature sets without common columns.
    channels, n_jobs, skip_bad, progress
        See `extract_table`.

    Returns
    -------
    FeatureTable
        Columns of all feature sets, for the recordings that could be used with each of them.

    Raises
    ------
    RecordingError
        If a recording is bad (or recordings of different surfaces have the same content) and `skip_bad` is
        False, or no recording can be used.
    """
    dataset, copies = _without_copies(dataset, skip_bad=skip_bad)
    tables = [
        extract_table(
            dataset,
            one,
            _in_cache(one, table_key(dataset, one, channels)),
            channels=channels,
            n_jobs=n_jobs,
            skip_bad=skip_bad,
            progress=progress,
        )
        for one in feature_sets
    ]
    table = reduce(_merge, tables)
    table = replace(table, left_out=table.left_out + copies)
    for notice in table.notices:
        logging.getLogger(__name__).warning("note: %s", notice)  # standard error, unless logging is set up
    return table


def _without_copies(dataset: Dataset, *, skip_bad: bool) -> tuple[Dataset, tuple[LeftOutRecording, ...]]:
    """Return a dataset without duplicate recordings, and the recordings that were left out.

    The first of several copies is kept. If the copies have different surfaces, none of them is kept.
    """
    left_out: dict[str, LeftOutRecording] = {}
    recording_ids = {file_id(entry) for entry in dataset.entries}
    for copies in dataset.copies:
        first, *others = [entry for entry in copies if entry.recording_id in recording_ids] or copies[:1]
        if len({entry.surface for entry in (first, *others)}) > 1:
            names = ", ".join(f"{entry.recording_id!r} of {entry.surface!r}" for entry in (first, *others))
            problem = f"recordings of different surfaces have the same content: {names}"
            if not skip_bad:
                raise RecordingError(
                    f"{dataset.name}: {problem}. Expected one surface per recording: remove the files with "
                    "the wrong surface, or leave out all of these recordings with --skip-bad"
                )
            left_out |= {
                one.recording_id: LeftOutRecording(one.recording_id, problem) for one in (first, *others)
            }
        for one in others:
            copy = LeftOutRecording(one.recording_id, f"same content as {first.recording_id!r}")
            left_out.setdefault(one.recording_id, copy)
    if not left_out:
        return dataset, ()
    entries = tuple(entry for entry in dataset.entries if file_id(entry) not in left_out)
    return replace(dataset, entries=entries), tuple(left_out.values())


def _in_cache(feature_set: FeatureSet, key: str) -> Path:
    return cache_root() / "features" / f"{feature_set.name}-{key}.npz"


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
    """Compute the features of all recordings of a dataset and write them to a file.

    Each finished recording is stored in a checkpoint next to `path`, under a key computed from the input, the
    feature set, the code and the version. An interrupted run continues with the missing recordings. If the
    table is already complete, it is read and not computed again.

    Parameters
    ----------
    dataset : Dataset
        Recordings or windows. Each process that computes features loads them one at a time.
    feature_set : FeatureSet
        Features to compute.
    path : str or path
        Output file with the suffix .csv, .parquet (extra `parquet`) or .npz. An NPZ file contains the
        complete table and its key; a file with a different key is replaced. A CSV or Parquet file contains
        only the labels and features, so the complete table is also written to the cache.
    channels : {"combine", "each", "auto", "all"}
        See `FeatureExtractor`.
    n_jobs : int
        Number of processes (default 1). Each process uses one thread for linear algebra.
    skip_bad : bool
        Whether to leave out bad recordings and list them in `left_out` (default False: the first bad
        recording raises an error).
    progress : callable, optional
        Function called with (done, total, "features") at the start and after each recording.

    Returns
    -------
    FeatureTable
        The table.

    Raises
    ------
    RecordingError
        If a recording is bad and `skip_bad` is False, or no recording can be used. The checkpoints of
        finished recordings are kept.
    ValueError
        If the suffix of `path` is not valid, or a label has the name of a feature column.
    """
    path = check_suffix(path, ".csv", ".parquet", ".npz")
    key = table_key(dataset, feature_set, channels)
    if (suffix := path.suffix.lower()) != ".npz":
        cached = extract_table(
            dataset,
            feature_set,
            _in_cache(feature_set, key),
            channels=channels,
            n_jobs=n_jobs,
            skip_bad=skip_bad,
            progress=progress,
        )
        frame = cached.frame
        write_atomic(path, frame.to_csv(index=False) if suffix == ".csv" else frame.to_parquet(index=False))
        return cached
    table: FeatureTable | None = None
    with suppress(FileNotFoundError, ValueError):  # compute a missing or damaged table
        table = read_table(path)
    while table is None or table.key != key:
        folder = sibling_path(path, ".parts") / key
        plan = _plan(dataset, feature_set, channels, skip_bad)
        if common := [name for name in label_columns(dataset.entries) if name in plan.columns]:
            raise ValueError(
                f"{dataset.name}: the label {common[0]!r} has the name of a feature. Expected another name: "
                "rename the group in the dataset card, or the column of the label table"
            )
        left_out = _compute_missing(dataset, plan, folder, n_jobs, skip_bad, progress)
        table = _join(dataset, plan, folder, key, left_out)
        if table is not None:
            write_table(table, path)
            shutil.rmtree(folder.parent, ignore_errors=True)
            break
        # Another process has finished the same table and removed the checkpoints.
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
    suffix: Literal[".csv", ".parquet"] = ".csv",
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Compute the features of a large dataset and write them to a folder of files.

    Each file of `size` recordings is computed and written by one worker, so that no process holds the whole
    table in memory. Features in the cache, also of an incomplete file, are not computed again. Dask reads
    the folder as one table, and so does ``pd.read_parquet``.

    Parameters
    ----------
    dataset, feature_set, n_jobs, skip_bad
        See `extract_table`.
    folder : str or Path
        Output folder. Each file is named after the index of its first recording.
    size : int
        Number of recordings per file.
    suffix : {".csv", ".parquet"}
        Suffix and format of the files (default ".csv"). Parquet requires the extra `parquet`.
    progress : callable, optional
        Function called with (done, total, "partitions") after each file.

    Returns
    -------
    DataFrame of shape (n_partitions, 3)
        One row per file, with the number of `recordings`, the recordings `left_out`, and the `notices` of the
        loaders.

    Raises
    ------
    ValueError
        If `size` is less than 1, or the suffix is not valid.
    RecordingError
        If a recording is bad and `skip_bad` is False. Finished files and checkpoints are kept.
    """
    if size < 1:
        raise ValueError(f"size must be at least 1 recording, got {size}")
    groups = list(group_by_recording(dataset.entries))
    calls = []
    for first in range(0, len(groups), size):
        subset = replace(dataset, entries=tuple(chain.from_iterable(groups[first : first + size])))
        path = check_suffix(Path(folder) / f"{first:09d}{suffix}", ".csv", ".parquet")
        calls.append(partial(_write_partition, subset, feature_set, path, skip_bad))
    facts = run_parallel(calls, n_jobs=n_jobs, progress=progress, stage="partitions", total=len(calls))
    with closing(facts):
        partitions = pd.DataFrame(list(facts), columns=["partition", "recordings", "left_out", "notices"])
    return partitions.set_index("partition")


def _write_partition(
    dataset: Dataset, feature_set: FeatureSet, path: Path, skip_bad: bool
) -> tuple[str, int, tuple[LeftOutRecording, ...], tuple[str, ...]]:
    """Compute and write one file. Return only a summary, because transferring tables is slow."""
    table = extract_table(dataset, feature_set, path, skip_bad=skip_bad)
    return path.name, table.n_recordings, table.left_out, table.notices


def table_key(dataset: Dataset, feature_set: FeatureSet, channels: str) -> str:
    """Return a digest of everything on which the values of a table depend."""
    entries = [asdict(entry) for entry in dataset.entries]
    facts = [dataset.input_hash, entries, feature_set.hash, code_hash(feature_set), channels, __version__]
    return hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:16]


def read_table(path: str | Path) -> FeatureTable:
    """Read a feature table from an NPZ file.

    Parameters
    ----------
    path : str or path
        File with the suffix .npz, written by `extract_table`.

    Returns
    -------
    FeatureTable
        The table.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    ValueError
        If the file is not a complete feature table.
    """
    try:
        with np.load(path) as arrays:
            values, facts = arrays["values"], json.loads(arrays["facts"].tobytes())
        labels, columns = facts["labels"], tuple(facts["columns"])
        missing = [name for name in METADATA if name not in labels]
        if missing or len(set(columns) - set(labels)) < len(columns):
            raise ValueError(f"label columns {missing} are missing, or columns are duplicated")
        n_rows, ms = len(labels["recording_id"]), np.array(facts["ms"], dtype=np.float64)
        if values.dtype != np.float64 or values.shape != (n_rows, len(columns)) or ms.shape != (n_rows,):
            raise ValueError(f"expected {len(columns)} numbers and a computing time in each of {n_rows} rows")
        if not isinstance(facts["key"], str):
            raise ValueError("the key must be a text")
        frame = pd.concat([_with_types(pd.DataFrame(labels)), pd.DataFrame(values, columns=columns)], axis=1)
        reasons = tuple(Reason(*reason) for reason in facts["reasons"])
        flags = tuple((name, flag) for name, flag in facts["flags"])
        left_out = tuple(LeftOutRecording(*bad) for bad in facts["left_out"])
        phases = tuple(PhaseSummary(*one) for one in facts["phases"])
        return FeatureTable(frame, columns, ms, reasons, flags, left_out, facts["key"], phases)
    except FileNotFoundError:
        raise
    except Exception as error:  # numpy, zipfile and pandas raise many types of errors on damaged files
        raise ValueError(
            f"{path}: not a feature table of texclass ({error}). Expected an NPZ file of `extract_table`"
        ) from error


def write_table(table: FeatureTable, path: Path) -> None:
    """Write a feature table to an NPZ file atomically."""
    labels = table.frame.drop(columns=list(table.columns)).astype(object)
    facts = {
        "key": table.key,
        "labels": labels.where(labels.notna(), None).to_dict("list"),
        "columns": table.columns,
        "ms": table.ms.tolist(),
        "reasons": table.reasons,
        "flags": table.flags,
        "left_out": table.left_out,
        "phases": table.phases,
    }
    buffer = io.BytesIO()
    np.savez(buffer, values=table.values, facts=np.frombuffer(json.dumps(facts).encode(), np.uint8))
    write_atomic(path, buffer.getvalue())


def _plan(dataset: Dataset, feature_set: FeatureSet, channels: Channels, skip_bad: bool) -> Plan:
    """Return the plan of a feature set, with the separate channels of the first usable recording."""
    problem = "the dataset is empty. Expected at least one recording"
    for entry in dataset.entries:
        try:
            separate = () if channels == "combine" else separate_channels(dataset.load(entry), channels)
            return Plan.of(feature_set, separate)
        except RecordingError as error:
            if not skip_bad:
                raise
            problem = str(error)
    raise RecordingError(f"{dataset.name}: no recording can be used; {problem}")


def _checkpoints(dataset: Dataset, folder: Path) -> list[tuple[tuple[Entry, ...], Path]]:
    """Return the entry of each recording (or those of its windows) with the path of its checkpoint."""
    groups = enumerate(group_by_recording(dataset.entries))
    return [(entries, folder / f"{number:06d}.json") for number, entries in groups]


def _compute_missing(
    dataset: Dataset, plan: Plan, folder: Path, n_jobs: int, skip_bad: bool, progress: Progress | None
) -> tuple[LeftOutRecording, ...]:
    """Compute every recording that has no checkpoint. Return the bad recordings."""
    checkpoints = _checkpoints(dataset, folder)
    missing = [(entries, path) for entries, path in checkpoints if not path.is_file()]
    done, total = len(checkpoints) - len(missing), len(checkpoints)
    if progress:
        progress(done, total, "features")
    calls = (partial(write_checkpoint, dataset.load, entries, plan, path) for entries, path in missing)
    bad: list[LeftOutRecording] = []
    options: dict[str, Any] = {"progress": progress, "stage": "features", "done": done, "total": total}
    with closing(run_parallel(calls, n_jobs=n_jobs, **options)) as outcomes:
        for (entries, _), problem in zip(missing, outcomes, strict=True):
            if problem and not skip_bad:
                raise RecordingError(problem)
            bad += [LeftOutRecording(parent_id(entries[0]), problem)] if problem else []
    return tuple(bad)


def _join(
    dataset: Dataset, plan: Plan, folder: Path, key: str, left_out: tuple[LeftOutRecording, ...]
) -> FeatureTable | None:
    """Join the checkpoints in dataset order. Return None if another process has removed one of them."""
    bad = {item.recording_id for item in left_out}
    pairs: list[tuple[Entry, CheckpointRow]] = []
    for entries, path in _checkpoints(dataset, folder):
        if parent_id(entries[0]) in bad:
            continue
        try:
            pairs += zip(entries, read_checkpoint(path, len(plan.columns)), strict=True)
        except FileNotFoundError:
            return None
    if not pairs:
        raise RecordingError(
            f"{dataset.name}: no recording can be used. Problem of the first recording: {left_out[0].reason}"
        )
    axes = Counter(tuple(row.axes) for _, row in pairs)
    usual_axes, n_usual = axes.most_common(1)[0]
    expected = (
        f"but {n_usual} of {len(pairs)} have {describe_axes(usual_axes)}. Expected the same axes in each "
        "recording: select axes with --column, or leave this recording out with --skip-bad"
    )
    problems = {
        parent_id(entry): f"{describe_axes(row.axes)}, {expected}"
        for entry, row in pairs
        if axes_differ(row.axes, usual_axes)
    }
    same_axes = [(entry, row) for entry, row in pairs if parent_id(entry) not in problems]
    rates = Counter(tuple(sorted(row.rates.items())) for _, row in same_axes)
    usual_rates, n_usual = rates.most_common(1)[0]
    expected = (
        f"but {n_usual} of {len(same_axes)} have {_describe_rates(dict(usual_rates))}. Expected the same "
        "rates in each recording: convert them with --resample HZ, or leave this recording out with "
        "--skip-bad"
    )
    problems |= {
        parent_id(entry): f"{_describe_rates(row.rates)}, {expected}"
        for entry, row in same_axes
        if row.rates != dict(usual_rates)
    }
    left_out += tuple(LeftOutRecording(name, f"{name}: {problem}") for name, problem in problems.items())
    pairs = [(entry, row) for entry, row in pairs if parent_id(entry) not in problems]
    entries, rows = zip(*pairs, strict=True)
    values = pd.DataFrame(np.array([row.features for row in rows]), columns=plan.columns)
    frame, ms = pd.concat([metadata(entries), values], axis=1), np.array([row.ms for row in rows])
    reasons = tuple(Reason(entry.recording_id, *pair) for entry, row in pairs for pair in row.reasons)
    flags = dict.fromkeys((parent_id(entry), flag) for entry, row in pairs for flag in row.flags)
    phases = tuple(PhaseSummary(*row.phases) for _, row in pairs)
    return FeatureTable(frame, plan.columns, ms, reasons, tuple(flags), left_out, key, phases)


def _describe_rates(rates: Mapping[str, float]) -> str:
    """Return the sampling rates of signals as text, such as "friction at 1000 Hz"."""
    texts = (f"{name} at {rate:g} Hz" for name, rate in rates.items())
    return ", ".join(texts) or "signals with the rate of the acceleration"


def _merge(table: FeatureTable, other: FeatureTable) -> FeatureTable:
    """Join the columns of two tables for the recordings in both, in the order of the first table."""
    ms = dict(zip(other.frame["recording_id"], other.ms, strict=True))
    is_common = table.frame["recording_id"].isin(list(ms)).to_numpy()
    columns = other.frame[["recording_id", *other.columns]]
    frame = table.frame[is_common].merge(columns, on="recording_id", how="left", validate="1:1")
    return replace(
        table,
        frame=frame,
        columns=table.columns + other.columns,
        ms=table.ms[is_common] + [ms[i] for i in frame["recording_id"]],
        reasons=table.reasons + other.reasons,
        flags=tuple(dict.fromkeys(table.flags + other.flags)),
        left_out=tuple(dict.fromkeys(table.left_out + other.left_out)),
        key=f"{table.key}+{other.key}",
    )
