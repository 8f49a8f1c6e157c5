"""The worker: computes a peer's features, fits, predicts and measures; one file a fold says what came out."""

import sys
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.pipeline import make_pipeline

from .files import Task, read_task, write_json
from .peers import CLASSIFIERS, PEERS, Extractor, Peer, Table

N_WARM = 2
STATUS, RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
MEGABYTE = 2**20


def main() -> int:
    """Evaluate one peer on one task; what went wrong is written, not raised."""
    task_folder, name, out = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3])
    warnings.simplefilter("ignore")
    peer = PEERS[name]
    try:
        work(peer, read_task(task_folder), out)
    except Exception as error:
        known = missing(peer)
        message = f"needs {', '.join(known)}" if known else f"{type(error).__name__}: {error}"
        write_json(out / "failed.json", {"missing": bool(known), "message": message})
        traceback.print_exc()
        return 1
    return 0


def missing(peer: Peer) -> list[str]:
    """Return the packages of a peer that are not installed."""
    return [package for package in peer.packages if _version(package) is None]


def work(peer: Peer, task: Task, out: Path) -> None:
    """Compute features, fit and predict fold after fold; one file a fold."""
    if known := missing(peer):
        raise ModuleNotFoundError(", ".join(known))
    extractor = peer.make(task.fs, task.seed)
    with timed() as first:
        extractor.fit(task.signals[:N_WARM]).transform(task.signals[:N_WARM])
    packages = ("numpy", "scikit-learn", *peer.packages)
    write_json(
        out / "started.json", {"first_s": first.seconds, "versions": {p: _version(p) for p in packages}}
    )
    memory = PeakMemory()
    once = None if extractor.learns else _Once(extractor, task)
    for k, (train, test) in enumerate(task.splits):
        fold = _fold(peer, extractor, task, once, train, test)
        write_json(out / f"fold_{k}.json", {**fold, "memory_mb": memory.megabytes})
    write_json(out / "done.json", {})


class _Once:
    """Features of every recording that some fold uses, computed before the first fold."""

    def __init__(self, extractor: Extractor, task: Task) -> None:
        used = np.unique(np.concatenate([rows for split in task.splits for rows in split]))
        self.position = np.zeros(len(task.signals), dtype=np.intp)
        self.position[used] = np.arange(len(used))
        extractor.fit(task.of(used))
        rows, self.seconds = [], 0.0
        for signal in task.of(used):
            with timed() as clock:
                rows.append(extractor.transform([signal]))
            self.seconds += clock.seconds / len(used)
        self.table = np.concatenate(rows)


def _fold(
    peer: Peer, extractor: Extractor, task: Task, once: _Once | None, train: Any, test: Any
) -> dict[str, Any]:
    """Return what a fold took and, for each classifier, what it predicted."""
    if once is not None:
        learnt, asked = once.table[once.position[train]], once.table[once.position[test]]
        fit_s, feature_s = 0.0, once.seconds
    else:
        with timed() as fitting:
            extractor.fit(task.of(train))
        with timed() as transforming:
            learnt, asked = extractor.transform(task.of(train)), extractor.transform(task.of(test))
        fit_s, feature_s = fitting.seconds, transforming.seconds / (len(train) + len(test))
    return {
        "n_columns": learnt.shape[1],
        "feature_s": feature_s,
        "classifiers": {
            name: _classify(extractor, name, task.seed, learnt, task.labels[train], asked, fit_s)
            for name in peer.classifiers
        },
    }


def _classify(
    extractor: Extractor, name: str, seed: int, learnt: Table, labels: Any, asked: Table, fit_s: float
) -> dict[str, Any]:
    recogniser = make_pipeline(extractor.scaler(), CLASSIFIERS[name](seed))
    with timed() as fitting:
        recogniser.fit(learnt, labels)
    with timed() as predicting:
        predicted = recogniser.predict(asked)
    return {
        "fit_s": fit_s + fitting.seconds,
        "predict_s": predicting.seconds / len(asked),
        "predicted": predicted.tolist(),
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


@dataclass
class Clock:
    """CPU seconds of this process (all threads), once the block that it times has ended."""

    seconds: float = 0.0


@contextmanager
def timed() -> Iterator[Clock]:
    """Time a block."""
    clock = Clock()
    start = time.process_time()
    yield clock
    clock.seconds = time.process_time() - start


class PeakMemory:
    """By how much the process has grown, at its largest, since this was made.

    Linux forgets the earlier peak when asked to. Elsewhere the peak of the whole life of the process counts,
    imports and compilation included, so the figure may be too low, never too high.
    """

    def __init__(self) -> None:
        try:
            RESET.write_text("5")
        except OSError:
            self.start = _lifelong_peak()
        else:
            self.start = _in_bytes("VmRSS")

    @property
    def megabytes(self) -> float:
        """Growth in MB (2^20 bytes)."""
        peak = _in_bytes("VmHWM") if STATUS.exists() else _lifelong_peak()
        return max(peak - self.start, 0) / MEGABYTE


def _in_bytes(field: str) -> int:
    line = next(line for line in STATUS.read_text().splitlines() if line.startswith(field))
    return 1024 * int(line.split()[1])


def _lifelong_peak() -> int:
    import resource  # not on Windows

    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
