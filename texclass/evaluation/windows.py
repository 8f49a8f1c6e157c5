"""Cut the movement of each recording into windows, which form a new dataset."""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, pairwise
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from pydantic import Field, TypeAdapter

from texclass.atomic_write import cache_root, write_if_possible
from texclass.evaluation.workers import Progress, run_parallel
from texclass.loaders.dataset import Dataset, Entry
from texclass.phases import find_phases
from texclass.provenance import code_hash
from texclass.recording import Recording, RecordingError
from texclass.validation import check_positive


@dataclass(frozen=True, kw_only=True)
class Window(Entry):
    """Window of the movement of a recording, with the surface and the other labels of the recording.

    Attributes
    ----------
    parent
        Entry of the whole recording.
    start, stop
        Index of the first sample of the window, and index after its last sample.
    problem
        Reason why the recording cannot be cut into windows, or "". If it is not empty, loading the window
        raises RecordingError.
    is_train_only
        Whether the window overlaps adjacent windows. Such a window is used for training, never for testing.

    Examples
    --------
    >>> recording = Entry(recording_id="oak_1", surface="oak")
    >>> window = Window(recording_id="oak_1#1", surface="oak", parent=recording, start=0, stop=500)
    >>> window.parent.recording_id
    'oak_1'
    """

    parent: Entry
    start: int
    stop: int
    problem: str = ""
    is_train_only: bool = False


Movement = tuple[
    Annotated[int, Field(ge=0, strict=True)],
    Annotated[int, Field(strict=True)],
    Annotated[float, Field(gt=0, strict=True, allow_inf_nan=False)],
    str,
]
"""Movement of a recording: start, stop (samples), fs (Hz), and the reason why it cannot be cut, or ""."""
SHORT_WINDOW = 1024
"""Window length in samples below which training windows overlap. Overlap does not improve longer windows."""
MAX_WINDOWS = 12_000
"""Largest number of windows, including overlapping ones. With more windows, training a fold takes minutes."""


def cut_windows(
    dataset: Dataset,
    seconds: float,
    *,
    per_recording: int | None = None,
    step: float | None = None,
    n_jobs: int = 1,
    progress: Progress | None = None,
) -> Dataset:
    """Cut the movement of each recording into windows of fixed length.

    A window contains only movement and no taps. If the movement of a recording is shorter than a window, the
    new dataset contains the recording as a bad recording, and loading it raises RecordingError.

    Parameters
    ----------
    dataset : Dataset
        Whole recordings. Each is loaded once to find its movement, whose position is stored in the cache.
    seconds : float
        Length of a window in s.
    per_recording : int, optional
        Largest number of windows per recording; the first windows are used (default: all windows).
    step : float, optional
        Time in s between the starts of adjacent windows (default: `seconds`, so windows do not overlap).
    n_jobs : int
        Number of processes (default 1).
    progress : callable, optional
        Function called with (done, total, "movements") after each recording.

    Returns
    -------
    Dataset
        Dataset of `Window` entries, ordered by recording and then by time. If they are loaded in this order,
        each file is read once.

    Raises
    ------
    ValueError
        If `seconds`, `per_recording` or `step` is not positive, or the dataset already contains windows.

    Examples
    --------
    >>> from texclass.loaders import open_dataset
    >>> dataset = open_dataset("simulated")
    >>> windows = cut_windows(replace(dataset, entries=dataset.entries[:1]), 0.5)
    >>> [window.recording_id for window in windows.entries][:2]
    ['stone-01-01#1', 'stone-01-01#2']
    """
    check_positive(seconds=seconds, step=step, per_recording=per_recording)
    if any(isinstance(entry, Window) for entry in dataset.entries):
        raise ValueError(f"{dataset.name} already contains windows. Expected a dataset of whole recordings")
    stride = seconds if step is None else step
    movements = zip(dataset.entries, _movements(dataset, n_jobs, progress), strict=True)
    suffix = "" if per_recording is None else f"-first{per_recording}"
    return replace(
        dataset,
        name=f"{dataset.name}-window{seconds:g}s{suffix}",
        entries=tuple(w for e, m in movements for w in _cut(e, m, seconds, stride, per_recording)),
        load=WindowLoader(dataset.load),
    )


def add_overlapping_windows(dataset: Dataset, overlap: int) -> Dataset:
    """Return a dataset with additional training windows that overlap its short windows.

    The features of a short window depend strongly on where it starts. Additional windows of the same movement
    with different starts represent this variation in the training set. They are never tested (see
    `is_testable`).

    Parameters
    ----------
    dataset : Dataset
        Dataset of windows. A dataset of whole recordings, or of windows of `SHORT_WINDOW` samples or more, is
        returned unchanged.
    overlap : int
        Number of windows that start within each window, including the window itself. It is halved until there
        are at most `MAX_WINDOWS` windows.
    """
    pairs = [
        (a, b)
        for a, b in pairwise(dataset.entries)
        if isinstance(a, Window) and isinstance(b, Window) and a.parent == b.parent and a.stop == b.start
    ]
    while len(dataset) + (overlap - 1) * len(pairs) > MAX_WINDOWS and overlap > 1:
        overlap //= 2
    additional = {
        a.recording_id: tuple(_shifted_window(a, k, overlap) for k in range(1, overlap))
        for a, _ in pairs
        if a.stop - a.start < SHORT_WINDOW
    }
    entries = (one for entry in dataset.entries for one in (entry, *additional.get(entry.recording_id, ())))
    return replace(dataset, entries=tuple(entries))


def _shifted_window(window: Window, k: int, overlap: int) -> Window:
    """Return a window for training only, shifted by k/overlap of the window length."""
    shift, name = k * (window.stop - window.start) // overlap, f"{window.recording_id}.{k}"
    start, stop = window.start + shift, window.stop + shift
    return replace(window, recording_id=name, start=start, stop=stop, is_train_only=True)


class WindowLoader:
    """Function that loads an entry of a dataset of windows, and that can be pickled.

    The most recent recording stays in memory, so that each file is read once if windows are loaded in order.
    """

    def __init__(self, load: Callable[[Entry], Recording]) -> None:
        self.load = load
        self._last: tuple[Entry, Recording] | None = None

    def __call__(self, entry: Entry) -> Recording:
        """Load one window.

        Raises
        ------
        RecordingError
            If the recording is bad, or its movement is shorter than a window.
        """
        if not isinstance(entry, Window):
            return self.load(entry)
        if entry.problem:
            raise RecordingError(entry.problem)
        if self._last is None or self._last[0] != entry.parent:
            self._last = (entry.parent, self.load(entry.parent))
        return self._last[1].cut(entry.start, entry.stop, entry.recording_id)

    def __reduce__(self) -> tuple[type["WindowLoader"], tuple[Callable[[Entry], Recording]]]:
        return WindowLoader, (self.load,)


def parent_id(entry: Entry) -> str:
    """Return the id of the recording of an entry: the parent of a window, or the entry itself."""
    return entry.parent.recording_id if isinstance(entry, Window) else entry.recording_id


def file_id(entry: Entry) -> str:
    """Return the id of the whole recording of an entry: of the files that contain its window or part."""
    return (entry.parent if isinstance(entry, Window) else entry).whole_id


def group_by_recording(entries: Iterable[Entry]) -> Iterator[tuple[Entry, ...]]:
    """Yield a tuple of the consecutive entries of each recording, so that its file is read only once."""
    return (tuple(group) for _, group in groupby(entries, key=parent_id))


def parents(table: pd.DataFrame) -> "pd.Series[str]":
    """Return the recording id of each row of a feature table: the parent of a window, or the row itself."""
    return table["parent" if "parent" in table else "recording_id"]


def files(table: pd.DataFrame) -> "pd.Series[str]":
    """Return the id of the whole recording of each row; several surfaces may be marked in one recording."""
    return table["file_id"] if "file_id" in table else parents(table)


def is_testable(table: pd.DataFrame) -> "pd.Series[bool]":
    """Return, for each row, whether it may be in a test set: all except overlapping training windows."""
    return ~table["is_train_only"] if "is_train_only" in table else pd.Series(True, index=table.index)


def _cut(
    entry: Entry, movement: Movement, seconds: float, step: float, per_recording: int | None
) -> Iterator[Window]:
    """Yield the windows of a recording, or one window whose `problem` states why it cannot be cut."""
    start, stop, fs, problem = movement
    n, hop = (max(1, round(s * fs)) for s in (seconds, step))
    starts = range(start, stop - n + 1, hop)[:per_recording]
    if not starts:
        too_short = (
            f"{entry.recording_id}: the movement lasts {(stop - start) / fs:.3g} s, but a window lasts "
            f"{seconds:g} s. Choose a shorter window"
        )
        yield Window(**vars(entry), parent=entry, start=0, stop=0, problem=problem or too_short)
    for number, first in enumerate(starts, start=1):
        facts = vars(entry) | {"recording_id": f"{entry.recording_id}#{number}"}
        yield Window(**facts, parent=entry, start=first, stop=first + n)


def _movements(dataset: Dataset, n_jobs: int, progress: Progress | None) -> tuple[Movement, ...]:
    """Return the movement of each recording. It is read from the cache folder if possible."""
    ids = [(entry.recording_id, entry.paths) for entry in dataset.entries]
    facts = [dataset.input_hash, ids, code_hash("recording", "signals", "phases")]
    key = hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:16]
    path = cache_root() / "movements" / f"{key}.json"
    with suppress(OSError, ValueError):  # compute a missing or damaged file again
        return read_movements(path, len(dataset))
    calls = [partial(_movement, dataset.load, entry) for entry in dataset.entries]
    options: dict[str, Any] = {"n_jobs": n_jobs, "progress": progress, "total": len(calls)}
    movements = tuple(run_parallel(calls, stage="movements", **options))
    if not any(problem for *_, problem in movements):
        write_if_possible(path, json.dumps(movements).encode())
    return movements


def read_movements(path: Path, n: int) -> tuple[Movement, ...]:
    """Read the cached movements of `n` recordings.

    Raises
    ------
    ValueError
        If the file does not contain `n` movements.
    OSError
        If the file cannot be read.
    """
    try:
        movements = TypeAdapter(tuple[Movement, ...]).validate_json(path.read_bytes())
        if len(movements) != n or any(start > stop for start, stop, *_ in movements):
            raise ValueError(f"it contains {len(movements)} movements")
    except ValueError as error:
        raise ValueError(f"{path}: {error}. Expected {n} lists of [start, stop, fs, problem]") from error
    return movements


def _movement(load: Callable[[Entry], Recording], entry: Entry) -> Movement:
    try:
        recording = load(entry)
        movement = find_phases(recording).movement
    except RecordingError as error:
        return 0, 0, 1.0, str(error)
    if movement is None:
        return 0, 0, recording.fs, f"{entry.recording_id}: no movement found"
    return *movement, recording.fs, ""
