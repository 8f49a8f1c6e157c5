"""Touches: single windows of the movement of each recording, as a dataset of their own."""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, pairwise
from pathlib import Path
from typing import Annotated

import pandas as pd
from pydantic import Field, TypeAdapter

from texclass.atomic_write import cache_root, write_if_possible
from texclass.evaluation.workers import Progress, each
from texclass.loaders.dataset import Dataset, Entry
from texclass.phases import find_phases
from texclass.provenance import code_hash
from texclass.recording import Recording, RecordingError
from texclass.validation import check_positive


@dataclass(frozen=True, kw_only=True)
class Window(Entry):
    """A stretch of a recording's movement; surface, groups and repetition are the recording's.

    Attributes
    ----------
    parent
        The recording.
    start, stop
        Samples [start, stop) of the recording.
    problem
        Why there is nothing to cut; loading the window then raises RecordingError.
    between
        Whether it lies across two others: such a window trains, but is never asked about.
    """

    parent: Entry
    start: int
    stop: int
    problem: str = ""
    between: bool = False


Movement = tuple[
    Annotated[int, Field(ge=0, strict=True)],
    Annotated[int, Field(strict=True)],
    Annotated[float, Field(gt=0, strict=True, allow_inf_nan=False)],
    str,
]
"""Where a recording moves: samples [start, stop) at fs; the problem that keeps it from being cut, or ""."""
SHORT = 1024
"""Samples of a touch below which windows overlap to train; of longer ones they say the same again."""
MOST_WINDOWS = 12_000
"""Windows of a dataset, those that overlap included: to train on more would take minutes a fold."""


def cut_windows(
    dataset: Dataset,
    seconds: float,
    *,
    per_recording: int | None = None,
    step: float | None = None,
    n_jobs: int = 1,
    progress: Progress | None = None,
) -> Dataset:
    """Return the windows of a dataset's movements as a dataset of single touches.

    A touch holds movement only: no taps, and nothing of the recording around it. Recordings whose movement is
    shorter than a touch are bad recordings of the new dataset: loading them raises RecordingError.

    Parameters
    ----------
    dataset : Dataset
        Whole recordings; each is loaded once to find its movement, which the cache folder remembers.
    seconds : float
        Length of a touch.
    per_recording : int, optional
        At most so many touches of each recording, the first ones; 1 gives its first `seconds` of movement.
    step : float, optional
        Seconds from the start of a touch to that of the next; by default they do not overlap.
    n_jobs : int
        Processes.
    progress : callable, optional
        Called with (done, total, "movements") while they are looked for.

    Returns
    -------
    Dataset
        Its entries are `Window` objects in the order of the recordings, then of time. Loaded in this order,
        each file is read once.

    Raises
    ------
    ValueError
        If a length or number is not above 0, or the dataset holds windows already.
    """
    check_positive(seconds=seconds, step=step, per_recording=per_recording)
    if any(isinstance(entry, Window) for entry in dataset.entries):
        raise ValueError(f"{dataset.name} contains windows already. Expected whole recordings")
    stride = seconds if step is None else step
    found = zip(dataset.entries, _movements(dataset, n_jobs, progress), strict=True)
    first = "" if per_recording is None else f"-first{per_recording}"
    return replace(
        dataset,
        name=f"{dataset.name}-window{seconds:g}s{first}",
        entries=tuple(w for e, m in found for w in _cut(e, m, seconds, stride, per_recording)),
        load=WindowLoader(dataset.load),
    )


def overlapping(dataset: Dataset, overlap: int) -> Dataset:
    """Return a dataset of short touches with further windows across those that follow one another.

    Much of what a window of few samples says depends on where it happens to begin. Windows that begin
    elsewhere show a classifier more of that, from the same samples. They are for training alone; what is
    asked about stays as it is (`asked`).

    Parameters
    ----------
    dataset : Dataset
        Any other dataset, and touches of `SHORT` samples or more, come back as they are.
    overlap : int
        Windows that begin within a touch, itself included; a half or a quarter of them where there would be
        more than `MOST_WINDOWS`.
    """
    pairs = [
        (a, b)
        for a, b in pairwise(dataset.entries)
        if isinstance(a, Window) and isinstance(b, Window) and a.parent == b.parent and a.stop == b.start
    ]
    while len(dataset) + (overlap - 1) * len(pairs) > MOST_WINDOWS and overlap > 1:
        overlap //= 2
    across = {
        a.recording_id: tuple(_moved(a, k, overlap) for k in range(1, overlap))
        for a, _ in pairs
        if a.stop - a.start < SHORT
    }
    entries = (one for entry in dataset.entries for one in (entry, *across.get(entry.recording_id, ())))
    return replace(dataset, entries=tuple(entries))


def _moved(window: Window, k: int, overlap: int) -> Window:
    """Return the window that begins k parts of `overlap` later, for training alone."""
    later, name = k * (window.stop - window.start) // overlap, f"{window.recording_id}.{k}"
    start, stop = window.start + later, window.stop + later
    return replace(window, recording_id=name, start=start, stop=stop, between=True)


class WindowLoader:
    """Loads windows; a `Dataset`'s `load`, picklable.

    The last recording stays in memory, so that windows in order cost one reading of each file.
    """

    def __init__(self, load: Callable[[Entry], Recording]) -> None:
        self.load = load
        self._last: tuple[Entry, Recording] | None = None

    def __call__(self, entry: Entry) -> Recording:
        """Load one window.

        Raises
        ------
        RecordingError
            If its recording is bad, or its movement too short.
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
    """Return the recording an entry comes from: a window's parent, or the entry itself."""
    return entry.parent.recording_id if isinstance(entry, Window) else entry.recording_id


def by_recording(entries: Iterable[Entry]) -> Iterator[tuple[Entry, ...]]:
    """Yield neighbouring entries of one recording together, so that whoever loads them reads it once."""
    return (tuple(group) for _, group in groupby(entries, key=parent_id))


def parents(table: pd.DataFrame) -> "pd.Series[str]":
    """Return the recording of each row of a table: the one it is a window of, or the row itself."""
    return table["parent" if "parent" in table else "recording_id"]


def asked(table: pd.DataFrame) -> "pd.Series[bool]":
    """Return whether each row of a table may be asked about: all but windows between others."""
    return ~table["between"] if "between" in table else pd.Series(True, index=table.index)


def _cut(
    entry: Entry, movement: Movement, seconds: float, step: float, per_recording: int | None
) -> Iterator[Window]:
    """Yield the windows of a recording, or one that says why there is none."""
    start, stop, fs, problem = movement
    n, hop = (max(1, round(s * fs)) for s in (seconds, step))
    starts = range(start, stop - n + 1, hop)[:per_recording]
    if not starts:
        short = (
            f"{entry.recording_id}: {(stop - start) / fs:.3g} s of movement. Expected at least {seconds:g}"
        )
        yield Window(**vars(entry), parent=entry, start=0, stop=0, problem=problem or short)
    for number, first in enumerate(starts, start=1):
        facts = vars(entry) | {"recording_id": f"{entry.recording_id}#{number}"}
        yield Window(**facts, parent=entry, start=first, stop=first + n)


def _movements(dataset: Dataset, n_jobs: int, progress: Progress | None) -> tuple[Movement, ...]:
    """Return where each recording moves; found once for a dataset, then read from the cache folder."""
    ids = [(entry.recording_id, entry.paths) for entry in dataset.entries]
    facts = [dataset.input_hash, ids, code_hash("recording", "signals", "phases")]
    key = hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:16]
    path = cache_root() / "movements" / f"{key}.json"
    with suppress(OSError, ValueError):  # not there, or damaged: it is found again
        return read_movements(path, len(dataset))
    calls = [partial(_movement, dataset.load, entry) for entry in dataset.entries]
    found = tuple(each(calls, n_jobs=n_jobs, progress=progress, what="movements", total=len(calls)))
    if not any(problem for *_, problem in found):
        write_if_possible(path, json.dumps(found).encode())
    return found


def read_movements(path: Path, n: int) -> tuple[Movement, ...]:
    """Read the remembered movements of n recordings.

    Raises
    ------
    ValueError
        If the file holds anything else; the message names it.
    OSError
        If it cannot be read.
    """
    try:
        found = TypeAdapter(tuple[Movement, ...]).validate_json(path.read_bytes())
        if len(found) != n or any(start > stop for start, stop, *_ in found):
            raise ValueError(f"{len(found)} movements")
    except ValueError as error:
        raise ValueError(f"{path}: {error}. Expected {n} of [start, stop, fs, problem]") from error
    return found


def _movement(load: Callable[[Entry], Recording], entry: Entry) -> Movement:
    try:
        recording = load(entry)
        movement = find_phases(recording).movement
    except RecordingError as error:
        return 0, 0, 1.0, str(error)
    if movement is None:
        return 0, 0, recording.fs, f"{entry.recording_id}: no movement found"
    return *movement, recording.fs, ""
