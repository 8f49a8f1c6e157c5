"""Evaluate a baseline on a task: compute features, fit, predict, and write predictions and costs.

The folder of a task contains `task.json` (fs in Hz, seed), `signal_000000.npy`, ... (one per recording, shape
(n_channels, n_samples)), and `layout.npz` (`labels`: class indices; `train_0`, `test_0`, ...: row indices of
each fold). The worker writes `started.json`, `fold_<k>.json` after each fold, and finally `done.json` or
`failed.json` to a separate output folder. Instead of predictions, it can write the features: `features.npy`,
or `features_<k>.npy` for each fold if they depend on the training set.
"""

import json
import pickle
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
    """Sequence of signals, each read from its file on access."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = paths

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: Any) -> Any:
        """Read one signal, or return a `Signals` object for a slice."""
        selection: Any = self.paths[index]
        return Signals(selection) if isinstance(index, slice) else np.load(selection)


class Task(NamedTuple):
    """Input of a worker: sampling rate in Hz, seed, signals, class indices, and row indices of each fold."""

    fs: float
    seed: int
    signals: Signals
    labels: NDArray[np.int64]
    splits: tuple[tuple[Rows, Rows], ...]

    def select(self, rows: Rows) -> Signals:
        """Return the signals of the recordings with these row indices."""
        return Signals([self.signals.paths[row] for row in rows])


def write_task(
    folder: Path, signals: Iterable[Signal], labels: Any, splits: Any, fs: float, seed: int
) -> tuple[int, ...]:
    """Write the files of a task, one signal at a time. Return the number of samples of each signal."""
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
    """Read a task. The signals are read later, on access."""
    facts = json.loads((folder / "task.json").read_text(encoding="utf-8"))
    with np.load(folder / "layout.npz") as layout:
        n_folds = sum(name.startswith("train_") for name in layout)
        splits = tuple((layout[f"train_{k}"], layout[f"test_{k}"]) for k in range(n_folds))
        labels = layout["labels"]
    return Task(facts["fs"], facts["seed"], Signals(sorted(folder.glob("*.npy"))), labels, splits)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a JSON file atomically."""
    unfinished = path.with_suffix(".unfinished")
    unfinished.write_text(json.dumps(content), encoding="utf-8")
    unfinished.replace(path)


def main() -> int:
    """Evaluate one baseline on one task. Errors are written to `failed.json` instead of being raised."""
    task_folder, name, out = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3])
    run = write_features if sys.argv[4:] == ["features"] else work
    warnings.simplefilter("ignore")
    baseline = BASELINES[name]
    try:
        run(baseline, read_task(task_folder), out)
    except Exception as error:
        packages = missing_packages(baseline)
        message = f"needs {', '.join(packages)}" if packages else f"{type(error).__name__}: {error}"
        write_json(out / "failed.json", {"missing": bool(packages), "message": message})
        traceback.print_exc()
        return 1
    return 0


def missing_packages(baseline: Baseline) -> list[str]:
    """Return the packages of a baseline that are not installed."""
    return [package for package in baseline.packages if _version(package) is None]


def _start(baseline: Baseline, task: Task, out: Path) -> Extractor:
    """Return the extractor of a baseline after a first call, whose time is written to `started.json`."""
    if packages := missing_packages(baseline):
        raise ModuleNotFoundError(", ".join(packages))
    extractor = baseline.make(task.fs, task.seed)
    first_signals = task.signals[:2]
    _, first_s = timed(lambda: extractor.fit(first_signals).transform(first_signals))
    versions = {package: _version(package) for package in ("numpy", "scikit-learn", *baseline.packages)}
    write_json(out / "started.json", {"first_s": first_s, "versions": versions})
    return extractor


def write_features(baseline: Baseline, task: Task, out: Path) -> None:
    """Write the features of all recordings, once or for each fold, and their cost.

    The facts of a fold are `feature_s` (CPU time per recording in s), `widths` (number of columns of each
    transformer) and `kb` (size of the fitted transformers).
    """
    extractor = _start(baseline, task, out)
    for k, (train, test) in enumerate(task.splits if extractor.depends_on_training else task.splits[:1]):
        if extractor.depends_on_training:
            extractor.fit(task.select(train))
            rows = np.concatenate([train, test])
            features, seconds = timed(partial(extractor.transform, task.select(rows)))
            table = np.full((len(task.signals), features.shape[1]), np.nan, dtype=features.dtype)
            table[rows], name = features, f"features_{k}.npy"
            seconds /= len(rows)
        else:
            (table, seconds), name = _feature_table(extractor, task), "features.npy"
        np.save(out / name, table)
        kilobytes = len(pickle.dumps(getattr(extractor, "transformers", []))) / 1000
        facts = {"feature_s": seconds, "widths": getattr(extractor, "widths", []), "kb": kilobytes}
        write_json(out / f"fold_{k}.json", facts)
    write_json(out / "done.json", {})


def work(baseline: Baseline, task: Task, out: Path) -> None:
    """Compute the features, then fit, predict and write one file for each fold."""
    extractor = _start(baseline, task, out)
    megabytes = watch_memory()
    table, seconds = (None, 0.0) if extractor.depends_on_training else _feature_table(extractor, task)
    for k, (train, test) in enumerate(task.splits):
        if table is not None:
            X_train, X_test, fit_s, feature_s = table[train], table[test], 0.0, seconds
        else:
            _, fit_s = timed(partial(extractor.fit, task.select(train)))
            X_train, train_s = timed(partial(extractor.transform, task.select(train)))
            X_test, test_s = timed(partial(extractor.transform, task.select(test)))
            feature_s = (train_s + test_s) / (len(train) + len(test))
        results = {
            name: _classify(extractor, name, task.seed, X_train, task.labels[train], X_test, fit_s)
            for name in baseline.classifiers
        }
        facts = {"n_columns": X_train.shape[1], "feature_s": feature_s, "memory_mb": megabytes()}
        write_json(out / f"fold_{k}.json", {**facts, "classifiers": results})
    write_json(out / "done.json", {})


def _feature_table(extractor: Extractor, task: Task) -> tuple[Table, float]:
    """Return the features of all recordings, and the mean CPU time per recording in s.

    Recordings that no fold uses get NaN.
    """
    rows = np.unique(np.concatenate([rows for split in task.splits for rows in split]))
    extractor.fit(task.select(rows))
    timings = [timed(partial(extractor.transform, [signal])) for signal in task.select(rows)]
    features = np.concatenate([values for values, _ in timings])
    table = np.full((len(task.signals), features.shape[1]), np.nan, dtype=features.dtype)
    table[rows] = features
    return table, sum(seconds for _, seconds in timings) / len(rows)


def _classify(
    extractor: Extractor, name: str, seed: int, X_train: Table, y_train: Any, X_test: Table, fit_s: float
) -> dict[str, Any]:
    classifier = make_pipeline(extractor.scaler(), CLASSIFIERS[name](seed))
    _, classifier_s = timed(lambda: classifier.fit(X_train, y_train))
    y_pred, predict_s = timed(lambda: classifier.predict(X_test))
    return {
        "fit_s": fit_s + classifier_s,
        "predict_s": predict_s / len(X_test),
        "predicted": y_pred.tolist(),
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """Return the result of a call, and the CPU time in s that all threads of this process spent on it."""
    start = time.process_time()
    result = call()
    return result, time.process_time() - start


def watch_memory() -> Callable[[], float]:
    """Return a function that returns the peak memory growth of this process in MB (2^20 bytes).

    The growth is measured from the call of `watch_memory` on. On Linux, the recorded peak is reset first. On
    other systems, the recorded peak includes imports and compilation before this call, so the growth can be
    underestimated but not overestimated. On Windows, the growth is always 0.
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
