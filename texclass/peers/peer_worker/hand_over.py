"""The files of a hand-over, as the worker reads and writes them.

In the folder of the task: `task.json` (fs in Hz, seed), `signal_000000.npy`, ... (one a recording, shape
(n_channels, n_samples)), `layout.npz` (`labels`: class numbers; `train_0`, `test_0`, ...: row numbers of
each fold). The worker writes, into a folder of its own, `started.json`, one `fold_<k>.json` for each fold as
soon as it is done, `done.json` or `failed.json`.
"""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .peers import Signal

Rows = NDArray[np.intp]


class Signals(Sequence[Signal]):
    """Signals of some recordings, each read from its file when it is asked for."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = paths

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: Any) -> Any:
        """Read one recording, or return those of a slice."""
        found: Any = self.paths[index]
        return Signals(found) if isinstance(index, slice) else np.load(found)


class Task(NamedTuple):
    """What is handed over: rate in Hz, seed, signals, class numbers, (train, test) rows of each fold."""

    fs: float
    seed: int
    signals: Signals
    labels: NDArray[np.int64]
    splits: tuple[tuple[Rows, Rows], ...]

    def of(self, rows: Rows) -> Signals:
        """Return the signals of some recordings."""
        return Signals([self.signals.paths[row] for row in rows])


def write_task(
    folder: Path, signals: Iterable[Signal], labels: Any, splits: Any, fs: float, seed: int
) -> tuple[int, ...]:
    """Write a task, its signals one at a time; return how many samples each of them has."""
    folder.mkdir(parents=True, exist_ok=True)
    lengths = []
    for number, signal in enumerate(signals):
        np.save(folder / f"signal_{number:06d}.npy", np.asarray(signal, dtype=np.float64, order="C"))
        lengths.append(signal.shape[1])
    folds: dict[str, Any] = {}
    for k, (train, test) in enumerate(splits):
        folds |= {f"train_{k}": train, f"test_{k}": test}
    np.savez(folder / "layout.npz", labels=np.array(labels), **folds)
    write_json(folder / "task.json", {"fs": fs, "seed": seed})
    return tuple(lengths)


def read_task(folder: Path) -> Task:
    """Read a task."""
    facts = json.loads((folder / "task.json").read_text(encoding="utf-8"))
    with np.load(folder / "layout.npz") as layout:
        n_folds = sum(name.startswith("train_") for name in layout)
        splits = tuple((layout[f"train_{k}"], layout[f"test_{k}"]) for k in range(n_folds))
        labels = layout["labels"]
    return Task(facts["fs"], facts["seed"], Signals(sorted(folder.glob("*.npy"))), labels, splits)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a JSON file that is either complete or not there."""
    unfinished = path.with_suffix(".unfinished")
    unfinished.write_text(json.dumps(content), encoding="utf-8")
    unfinished.replace(path)
