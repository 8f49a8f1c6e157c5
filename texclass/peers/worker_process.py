"""Run the worker of a peer in an interpreter of its own: its crash, memory and threads are not ours."""

import json
import os
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

HERE = Path(__file__).parent
START = "import sys; sys.path.append(sys.argv.pop(1)); from peer_worker.run import main; sys.exit(main())"
"""The worker's folder comes last on the path, so that none of its neighbours hides an installed module."""
ENVIRONMENT = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
    "NUMBA_THREADING_LAYER": "workqueue",
    "MPLBACKEND": "Agg",
    "PYTHONWARNINGS": "ignore",
}
Status = Literal["done", "not installed", "out of time", "failed"]


@dataclass(frozen=True)
class Outcome:
    """What the worker of a peer left behind.

    Attributes
    ----------
    status
        "out of time" and "failed" may have finished some of the folds.
    folds
        What each finished fold took and predicted.
    first_s
        CPU seconds of the first call on two recordings: imports and compilation.
    versions
        Of the packages the peer used.
    message
        What went wrong.
    """

    status: Status
    folds: tuple[dict[str, Any], ...] = ()
    first_s: float | None = None
    versions: dict[str, str] = field(default_factory=dict)
    message: str = ""


def run_worker(python: Path, task: Path, peer: str, out: Path, time_limit_s: float) -> Outcome:
    """Evaluate one peer on a task.

    Parameters
    ----------
    python : Path
        Interpreter with numpy, scikit-learn and the peer; nothing of texclass is imported by it.
    task : Path
        Folder written by `peer_worker.files.write_task`.
    peer : str
        Name in the registry.
    out : Path
        Empty folder for what the worker writes.
    time_limit_s : float
        Wall-clock seconds after which the worker is stopped; the folds it finished are kept.

    Returns
    -------
    Outcome

    Raises
    ------
    ValueError
        If there is no such interpreter.
    """
    out.mkdir(parents=True, exist_ok=True)
    command = [str(python), "-c", START, str(HERE), str(task), peer, str(out)]
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
            raise ValueError(f"{python} cannot be run ({error}); the rule is a Python interpreter") from None
    return read_outcome(out, expired=expired, time_limit_s=time_limit_s)


def read_outcome(out: Path, *, expired: bool, time_limit_s: float) -> Outcome:
    """Return what a worker wrote, whether or not it came to its end."""
    started = _read(out / "started.json") or {}
    failed = _read(out / "failed.json")
    folds: list[dict[str, Any]] = []
    while (fold := _read(out / f"fold_{len(folds)}.json")) is not None:
        folds.append(fold)
    facts = (tuple(folds), started.get("first_s"), started.get("versions", {}))
    if (out / "done.json").exists():
        return Outcome("done", *facts)
    if expired:
        return Outcome("out of time", *facts, message=f"stopped after {time_limit_s:g} s")
    if failed is not None:
        status: Status = "not installed" if failed.get("missing") else "failed"
        return Outcome(status, *facts, message=str(failed.get("message", "")))
    lines = (out / "stderr.txt").read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return Outcome("failed", *facts, message=lines[-1] if lines else "ended without a word (out of memory?)")


def _read(path: Path) -> dict[str, Any] | None:
    """Return what a worker wrote; None if it wrote nothing, or nothing whole."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None
