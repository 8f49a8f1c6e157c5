"""Contestants run apart: a baseline in an interpreter of its own, a row of ours in a process of its own.

The crash, memory and threads of a baseline are not ours; clock and memory gauge are the same for all.
"""

import json
import os
import subprocess
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from texclass.baselines.baseline_worker.run import timed, watch_memory
from texclass.evaluation.feature_table import FeatureTable
from texclass.evaluation.folds import Evaluation
from texclass.evaluation.pipeline import MatchedRow, PipelineDefinition
from texclass.evaluation.splits import Split
from texclass.evaluation.workers import each
from texclass.features.phase_view import separate_channels
from texclass.features.plan import Plan
from texclass.features.sets import FeatureSet
from texclass.loaders.dataset import Dataset, Entry
from texclass.phases import find_phases

HERE = Path(__file__).parent
START = "import sys; sys.path.append(sys.argv.pop(1)); from baseline_worker.run import main; sys.exit(main())"
"""The worker's folder comes last on the path, so that none of its neighbours hides an installed module."""
ENVIRONMENT = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
    "NUMBA_THREADING_LAYER": "workqueue",
    "MPLBACKEND": "Agg",
    "PYTHONWARNINGS": "ignore",
}
N_TIMED = 100
"""Recordings, spread over the dataset, on which our features are timed."""


def run_worker(python: Path, task: Path, baseline: str, out: Path, time_limit_s: float) -> dict[str, Any]:
    """Evaluate one baseline on a task.

    Parameters
    ----------
    python : Path
        Interpreter with numpy, scikit-learn and the baseline; nothing of texclass is imported by it.
    task : Path
        Folder written by `baseline_worker.run.write_task`.
    baseline : str
        Name in the registry.
    out : Path
        Empty folder for what the worker writes.
    time_limit_s : float
        Wall-clock seconds after which the worker is stopped; the folds it finished are kept.

    Returns
    -------
    dict
        See `read_outcome`.

    Raises
    ------
    ValueError
        If there is no such interpreter.
    """
    out.mkdir(parents=True, exist_ok=True)
    command = [str(python), "-c", START, str(HERE), str(task), baseline, str(out)]
    expired = False
    with (out / "stderr.txt").open("w", encoding="utf-8") as errors:
        try:
            subprocess.run(
                command,
                cwd=out,
                env=os.environ | ENVIRONMENT,
                stdout=errors,
                stderr=errors,
                stdin=subprocess.DEVNULL,
                timeout=time_limit_s,
                check=False,
            )
        except subprocess.TimeoutExpired:
            expired = True
        except OSError as error:
            raise ValueError(f"{python} cannot be run ({error}). Expected a Python interpreter") from None
    return read_outcome(out, expired=expired, time_limit_s=time_limit_s)


def read_outcome(out: Path, *, expired: bool, time_limit_s: float) -> dict[str, Any]:
    """Return what the worker of a baseline left behind, whether or not it came to its end.

    Returns
    -------
    dict
        `status`: "done", "not installed", or "out of time" and "failed", which may have finished some of the
        folds; `message`: what went wrong; `folds`: what each finished fold took and predicted; `first_s`: CPU
        seconds of the first call on two recordings, imports and compilation; `versions` of the packages used.
    """
    started = _read(out / "started.json") or {}
    failed = _read(out / "failed.json")
    folds: list[dict[str, Any]] = []
    while (fold := _read(out / f"fold_{len(folds)}.json")) is not None:
        folds.append(fold)
    if (out / "done.json").exists():
        status, message = "done", ""
    elif expired:
        status, message = "out of time", f"stopped after {time_limit_s:g} s"
    elif failed is not None:
        status, message = (
            "not installed" if failed.get("missing") else "failed",
            str(failed.get("message", "")),
        )
    else:
        lines = (out / "stderr.txt").read_text(encoding="utf-8", errors="replace").strip().splitlines()
        status, message = "failed", lines[-1] if lines else "ended without a word (out of memory?)"
    facts = {"first_s": started.get("first_s"), "versions": started.get("versions", {})}
    return {"status": status, "message": message, "folds": folds, **facts}


def _read(path: Path) -> dict[str, Any] | None:
    """Return what a worker wrote; None if it wrote nothing, or nothing whole."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def measure_ours(
    row: MatchedRow,
    classifier: str,
    pipeline: PipelineDefinition,
    dataset: Dataset,
    table: FeatureTable,
    splits: Sequence[Split],
    *,
    nested: bool,
) -> dict[str, Any]:
    """Evaluate and time one row of ours in a process of its own.

    Returns
    -------
    dict
        `predicted` labels of each fold; CPU seconds, as a worker writes them: `feature_s` of a recording,
        `fit_s` of a fold, `predict_s` of a recording, `first_s` of the first call on two recordings; and
        `memory_mb`, the growth of the process at its largest.
    """
    wanted = set(table.frame["recording_id"])
    usable = [entry for entry in dataset.entries if entry.recording_id in wanted]
    some = np.unique(np.linspace(0, len(usable) - 1, min(N_TIMED, len(usable))).astype(int))
    features = pipeline.features.restricted_to(row.definition.features)
    trial = pipeline.trial(row, classifier, table)
    work = (dataset, [usable[i] for i in some], features, pipeline.channels, trial, tuple(splits), nested)
    (found,) = each([partial(_measure, *work)], n_jobs=2)  # two, because one process would be this one
    return found


def _measure(
    dataset: Dataset,
    entries: Sequence[Entry],
    features: FeatureSet,
    channels: Any,
    trial: Callable[..., Evaluation],
    splits: Sequence[Split],
    nested: bool,
) -> dict[str, Any]:
    first = dataset.load(entries[0])
    plan = Plan.of(features, separate_channels(first, channels))
    _, first_s = timed(lambda: [plan.compute(first) for _ in range(2)])
    megabytes, seconds, segmentation = watch_memory(), [], []
    for recording in map(dataset.load, entries):
        # Apart, for baselines are given movements that have been found already.
        phases, took = timed(partial(find_phases, recording))
        segmentation.append(took)
        seconds.append(timed(partial(plan.compute, recording.with_(phases=phases)))[1])
    found = trial(splits, nested=nested)
    return {
        "predicted": found.predicted,
        "segmentation_s": float(np.mean(segmentation)),
        "feature_s": float(np.mean(seconds)),
        "fit_s": found.fit_s,
        "predict_s": found.predict_s,
        "first_s": first_s,
        "memory_mb": megabytes(),
    }
