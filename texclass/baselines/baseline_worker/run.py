"""The worker: reads a task, computes the features of a baseline, fits, predicts, measures, and writes it.

In the folder of the task: `task.json` (fs in Hz, seed), `signal_000000.npy`, ... (one a recording, shape
(n_channels, n_samples)), `layout.npz` (`labels`: class numbers; `train_0`, `test_0`, ...: row numbers of
each fold). The worker writes, into a folder of its own, `started.json`, one `fold_<k>.json` for each fold as
soon as it is done, `done.json` or `failed.json`.
"""

import json
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.pipeline import make_pipeline

from .baselines import BASELINES, CLASSIFIERS, Baseline, Extractor, Signal, Table

Rows = NDArray[np.intp]
STATUS, RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


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


def main() -> int:
    """Evaluate one baseline on one task; what went wrong is written, not raised."""
    task_folder, name, out = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3])
    warnings.simplefilter("ignore")
    baseline = BASELINES[name]
    try:
        work(baseline, read_task(task_folder), out)
    except Exception as error:
        known = missing(baseline)
        message = f"needs {', '.join(known)}" if known else f"{type(error).__name__}: {error}"
        write_json(out / "failed.json", {"missing": bool(known), "message": message})
        traceback.print_exc()
        return 1
    return 0


def missing(baseline: Baseline) -> list[str]:
    """Return the packages of a baseline that are not installed."""
    return [package for package in baseline.packages if _version(package) is None]


def work(baseline: Baseline, task: Task, out: Path) -> None:
    """Compute features, fit and predict fold after fold; one file a fold."""
    if known := missing(baseline):
        raise ModuleNotFoundError(", ".join(known))
    extractor = baseline.make(task.fs, task.seed)
    few = task.signals[:2]
    _, first_s = timed(lambda: extractor.fit(few).transform(few))
    versions = {package: _version(package) for package in ("numpy", "scikit-learn", *baseline.packages)}
    write_json(out / "started.json", {"first_s": first_s, "versions": versions})
    megabytes = watch_memory()
    table, seconds = (None, 0.0) if extractor.learns else _of_all(extractor, task)
    for k, (train, test) in enumerate(task.splits):
        if table is not None:
            learnt, asked, fit_s, feature_s = table[train], table[test], 0.0, seconds
        else:
            _, fit_s = timed(partial(extractor.fit, task.of(train)))
            learnt, learnt_s = timed(partial(extractor.transform, task.of(train)))
            asked, asked_s = timed(partial(extractor.transform, task.of(test)))
            feature_s = (learnt_s + asked_s) / (len(train) + len(test))
        ran = {
            name: _classify(extractor, name, task.seed, learnt, task.labels[train], asked, fit_s)
            for name in baseline.classifiers
        }
        facts = {"n_columns": learnt.shape[1], "feature_s": feature_s, "memory_mb": megabytes()}
        write_json(out / f"fold_{k}.json", {**facts, "classifiers": ran})
    write_json(out / "done.json", {})


def _of_all(extractor: Extractor, task: Task) -> tuple[Table, float]:
    """Return the features of every recording (NaN where no fold uses it), and the seconds of each."""
    used = np.unique(np.concatenate([rows for split in task.splits for rows in split]))
    extractor.fit(task.of(used))
    timings = [timed(partial(extractor.transform, [signal])) for signal in task.of(used)]
    rows = np.concatenate([row for row, _ in timings])
    table = np.full((len(task.signals), rows.shape[1]), np.nan, dtype=rows.dtype)
    table[used] = rows
    return table, sum(seconds for _, seconds in timings) / len(used)


def _classify(
    extractor: Extractor, name: str, seed: int, learnt: Table, labels: Any, asked: Table, fit_s: float
) -> dict[str, Any]:
    recogniser = make_pipeline(extractor.scaler(), CLASSIFIERS[name](seed))
    _, fitting_s = timed(lambda: recogniser.fit(learnt, labels))
    predicted, predict_s = timed(lambda: recogniser.predict(asked))
    return {
        "fit_s": fit_s + fitting_s,
        "predict_s": predict_s / len(asked),
        "predicted": predicted.tolist(),
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """Return what a call returns, and the CPU seconds that it took of this process (all threads)."""
    start = time.process_time()
    found = call()
    return found, time.process_time() - start


def watch_memory() -> Callable[[], float]:
    """Return what tells by how many MB (2^20 bytes) the process has grown, at its largest, since now.

    Linux forgets the earlier peak when asked to. Elsewhere the peak of the whole life of the process counts,
    imports and compilation included, so the figure may be too low, never too high; Windows tells none (0).
    """
    try:
        RESET.write_text("5", encoding="ascii")
    except OSError:
        start = _lifelong_peak()
    else:
        start = _in_bytes("VmRSS")

    def megabytes() -> float:
        peak = _in_bytes("VmHWM") if STATUS.exists() else _lifelong_peak()
        return max(peak - start, 0) / 2**20

    return megabytes


def _in_bytes(field: str) -> int:
    line = next(line for line in STATUS.read_text(encoding="utf-8").splitlines() if line.startswith(field))
    return 1024 * int(line.split()[1])


def _lifelong_peak() -> int:
    try:
        import resource
    except ImportError:
        return 0
    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
