"""Run each contestant in a separate process. Baselines can use another interpreter.

Crashes, memory use and threads of a baseline therefore do not affect this process. Time and memory are
measured in the same way for all contestants.
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
from texclass.evaluation.workers import run_parallel
from texclass.features.phase_view import separate_channels
from texclass.features.plan import Plan
from texclass.features.sets import FeatureSet
from texclass.loaders.dataset import Dataset, Entry
from texclass.phases import find_phases

HERE = Path(__file__).parent
START = "import sys; sys.path.append(sys.argv.pop(1)); from baseline_worker.run import main; sys.exit(main())"
"""Start code of the worker. Its folder is last on the path, so its files cannot hide installed modules."""
ENVIRONMENT = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
    "NUMBA_THREADING_LAYER": "workqueue",
    "MPLBACKEND": "Agg",
    "PYTHONWARNINGS": "ignore",
}
N_TIMED = 100
"""Number of recordings, spread over the dataset, on which feature times of texclass are measured."""


def run_worker(
    python: Path, task: Path, baseline: str, out: Path, time_limit_s: float, *, features_only: bool = False
) -> dict[str, Any]:
    """Evaluate one baseline on a task, or compute its features.

    Parameters
    ----------
    python : Path
        Interpreter with NumPy, scikit-learn and the packages of the baseline; texclass is not needed.
    task : Path
        Folder written by `baseline_worker.run.write_task`.
    baseline : str
        Name of the baseline.
    out : Path
        Empty output folder of the worker.
    time_limit_s : float
        Limit of the wall-clock time in s. Folds that finish within the limit are returned.
    features_only : bool
        Whether the worker writes the features instead of predictions (default False).

    Returns
    -------
    dict
        Outcome of the worker; see `read_outcome`.

    Raises
    ------
    ValueError
        If the interpreter cannot be run.
    """
    out.mkdir(parents=True, exist_ok=True)
    command = [str(python), "-c", START, str(HERE), str(task), baseline, str(out)]
    command += ["features"] * features_only
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
            raise ValueError(
                f"{python} cannot be run ({error}). Expected the path of a Python interpreter"
            ) from None
    return read_outcome(out, expired=expired, time_limit_s=time_limit_s)


def read_outcome(out: Path, *, expired: bool, time_limit_s: float) -> dict[str, Any]:
    """Read the output of a baseline worker, even if it is incomplete.

    Returns
    -------
    dict
        `status`: "done", "not installed", "out of time" or "failed"; `message`: the error; `folds`: costs and
        predictions of each finished fold; `first_s`: CPU time in s of the first call on two recordings,
        including imports and compilation; `versions`: package versions.
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
        status, message = "failed", lines[-1] if lines else "ended without a message (out of memory?)"
    facts = {"first_s": started.get("first_s"), "versions": started.get("versions", {})}
    return {"status": status, "message": message, "folds": folds, **facts}


def _read(path: Path) -> dict[str, Any] | None:
    """Return the content of a JSON file of a worker, or None if the file is missing or incomplete."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


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
    """Evaluate a row of the pipeline and measure its cost in a separate process.

    Returns
    -------
    dict
        `predicted`: labels of each fold; `segmentation_s`, `feature_s`, `predict_s`: CPU times per recording
        in s; `fit_s`: CPU time per fold in s; `first_s`: CPU time of the first call on two recordings in s;
        `memory_mb`: peak increase of the memory of the process in MB.
    """
    recording_ids = set(table.frame["recording_id"])
    usable = [entry for entry in dataset.entries if entry.recording_id in recording_ids]
    indices = np.unique(np.linspace(0, len(usable) - 1, min(N_TIMED, len(usable))).astype(int))
    features = pipeline.features.restricted_to(row.definition.features)
    trial = pipeline.trial(row, classifier, table)
    work = (dataset, [usable[i] for i in indices], features, pipeline.channels, trial, tuple(splits), nested)
    # With n_jobs=1, the measurement would run in this process.
    (measurement,) = run_parallel([partial(_measure, *work)], n_jobs=2)
    return measurement


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
        # The segmentation is measured separately, because the baselines get segmented movements.
        phases, segmentation_s = timed(partial(find_phases, recording))
        segmentation.append(segmentation_s)
        seconds.append(timed(partial(plan.compute, recording.with_(phases=phases)))[1])
    evaluation = trial(splits, nested=nested)
    return {
        "predicted": evaluation.y_pred,
        "segmentation_s": float(np.mean(segmentation)),
        "feature_s": float(np.mean(seconds)),
        "fit_s": evaluation.fit_s,
        "predict_s": evaluation.predict_s,
        "first_s": first_s,
        "memory_mb": megabytes(),
    }
