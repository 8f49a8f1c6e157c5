"""The files of a hand-over, as the worker reads and writes them.

In the folder of the task: `task.json` (fs in Hz, seed), `samples.f64` (little-endian; recording after
recording, channel after channel), `layout.npz` (`shapes`: channels and samples of each recording; `labels`:
class numbers; `train_0`, `test_0`, ...: row numbers of each fold). The worker writes, into a folder of its
own, `started.json`, one `fold_<k>.json` for each fold as soon as it is done, `done.json` or `failed.json`.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .peers import Signal

Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Signals(Sequence[Signal]):
    """Signals of some recordings, read from the file when they are asked for.

    Attributes
    ----------
    path
        The samples.
    shapes : ndarray of shape (n_recordings, 2)
        Channels and samples of every recording in the file.
    rows : ndarray of int
        The recordings of this sequence.
    """

    path: Path
    shapes: NDArray[np.int64]
    rows: Rows

    @cached_property
    def starts(self) -> NDArray[np.int64]:
        """First sample of each recording in the file."""
        sizes = self.shapes.prod(axis=1)
        return np.asarray(np.cumsum(sizes) - sizes)

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: Any) -> Any:
        """Read one recording, or return those of a slice."""
        if isinstance(index, slice):
            return Signals(self.path, self.shapes, self.rows[index])
        row = self.rows[index]
        n_channels, n_samples = self.shapes[row]
        offset = 8 * int(self.starts[row])
        read = np.fromfile(self.path, dtype="<f8", count=n_channels * n_samples, offset=offset)
        return read.astype(np.float64, copy=False).reshape(n_channels, n_samples)

    def __iter__(self) -> Iterator[Signal]:
        return (self[i] for i in range(len(self)))


@dataclass(frozen=True, eq=False)
class Task:
    """What is handed over.

    Attributes
    ----------
    fs : float
        Sampling rate in Hz.
    seed : int
        For whatever is random.
    signals : Signals
        All recordings.
    labels : ndarray of shape (n_recordings,)
        Class numbers.
    splits : tuple of (train, test)
        Row numbers of each fold.
    """

    fs: float
    seed: int
    signals: Signals
    labels: NDArray[np.int64]
    splits: tuple[tuple[Rows, Rows], ...]

    def of(self, rows: Rows) -> Signals:
        """Return the signals of some recordings."""
        return Signals(self.signals.path, self.signals.shapes, rows)


def write_task(
    folder: Path, signals: Iterator[Signal], labels: Any, splits: Any, fs: float, seed: int
) -> tuple[int, ...]:
    """Write a task, its signals one at a time; return how many samples each of them has."""
    folder.mkdir(parents=True, exist_ok=True)
    shapes = []
    with (folder / "samples.f64").open("wb") as file:
        for signal in signals:
            shapes.append(signal.shape)
            file.write(np.ascontiguousarray(signal, dtype="<f8").tobytes())
    folds: dict[str, Any] = {}
    for k, (train, test) in enumerate(splits):
        folds |= {f"train_{k}": train, f"test_{k}": test}
    np.savez(folder / "layout.npz", shapes=np.array(shapes), labels=np.array(labels), **folds)
    write_json(folder / "task.json", {"fs": fs, "seed": seed})
    return tuple(n_samples for _, n_samples in shapes)


def read_task(folder: Path) -> Task:
    """Read a task."""
    facts = json.loads((folder / "task.json").read_text())
    with np.load(folder / "layout.npz") as layout:
        n_folds = sum(name.startswith("train_") for name in layout)
        splits = tuple((layout[f"train_{k}"], layout[f"test_{k}"]) for k in range(n_folds))
        shapes, labels = layout["shapes"], layout["labels"]
    signals = Signals(folder / "samples.f64", shapes, np.arange(len(shapes)))
    return Task(facts["fs"], facts["seed"], signals, labels, splits)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a JSON file that is either complete or not there."""
    unfinished = path.with_suffix(".unfinished")
    unfinished.write_text(json.dumps(content))
    unfinished.replace(path)
