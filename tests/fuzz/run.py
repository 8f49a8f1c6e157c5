"""Feed every reader with inputs and write reports/studies/fuzzing.{json,md}.

    python tests/fuzz/run.py [--inputs 1000000] [--targets text,csv] [--engine atheris|own]

Each target runs in processes of its own, one after another. What is done stays in the folder `--state` (in
memory by default), so that a run that is started again goes on. Inputs that broke a promise are there, too.
"""

import argparse
import importlib.metadata
import importlib.util
import json
import os
import platform
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from fuzz.contract import MOST_SECONDS
from fuzz.report import write_report
from fuzz.state import Shared
from fuzz.targets import parts_of

SEED = 20260711
MOST_WALL_S = 90.0
MOST_RESTARTS = 200
LIBRARIES = (
    "texclass", "numpy", "scipy", "h5py", "pyarrow", "pandas", "soundfile", "mcap", "rosbags", "skops",
    "scikit-learn", "atheris",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--inputs", type=int, default=1_000_000, help="in all, divided by the targets' shares"
    )
    parser.add_argument("--targets", default="", help="names, divided by commas; all by default")
    parser.add_argument("--engine", choices=["atheris", "own"], default=None)
    parser.add_argument("--state", type=Path, default=Path("/dev/shm/texclass-fuzz"))
    parser.add_argument("--output", type=Path, default=Path("reports/studies/fuzzing"))
    options = parser.parse_args()
    there = importlib.util.find_spec("atheris") is not None
    engine = options.engine or ("atheris" if there else "own")
    if engine == "atheris" and not there:
        parser.error("atheris is not installed; the rule is --engine own, or pip install atheris")
    parts = parts_of()
    names = options.targets.split(",") if options.targets else list(parts)
    found: dict[str, Any] = {}
    for name in names:
        n = -(-parts[name] * options.inputs // sum(parts.values()))
        found[name] = run_target(name, n, options.state / name.replace(" ", "_"), engine)
        print(f"{name}: {json.dumps({k: v for k, v in found[name].items() if k != 'findings'})}", flush=True)
        for what, times in found[name]["findings"].items():
            print(f"    {times} x {what}", flush=True)
        write_report(options.output, found, _facts(engine, options.inputs))


def run_target(name: str, n: int, folder: Path, engine: str) -> dict[str, Any]:
    """Feed one reader until it had n inputs, in as many processes as it takes."""
    folder.mkdir(parents=True, exist_ok=True)
    shared, ends = Shared(folder / "shared"), _read(folder / "ends.json")
    seconds = float(ends.pop("seconds", 0.0))
    for attempt in range(MOST_RESTARTS):
        done = shared.read().inputs
        if done >= n:
            break
        start = time.monotonic()
        how = _one_process(name, n - done, SEED + attempt + done, folder, engine, shared)
        seconds += time.monotonic() - start
        if how:
            (folder / f"{how.replace(' ', '_')}{sum(ends.values())}.bin").write_bytes(shared.at_hand)
            ends[how] = ends.get(how, 0) + 1
            counts = shared.read()
            counts.inputs += 1
            counts.broken += 1
            shared.write(counts)
        elif shared.read().inputs == done:
            raise RuntimeError(f"{name}: the worker did nothing; see {folder / 'log'}")
        (folder / "ends.json").write_text(json.dumps(ends | {"seconds": seconds}))
    counts = shared.read()
    return {
        "inputs": counts.inputs,
        "accepted": counts.accepted,
        "refused": counts.refused,
        "broken": counts.broken,
        "crashes": sum(times for how, times in ends.items() if how.startswith("crash")),
        "timeouts": ends.get("timeout", 0),
        "slowest_s": round(counts.slowest_s, 3),
        "slowest_bytes": counts.slowest_bytes,
        "peak_mb": round(counts.peak_mb),
        "inputs_per_s": round(counts.inputs / seconds) if seconds else None,
        "findings": _read(folder / "findings.json") | ends,
    }


def _one_process(name: str, n: int, seed: int, folder: Path, engine: str, shared: Shared) -> str:
    """Run a worker to its end; return "" or how it ended: "timeout", "crash by SIGSEGV"."""
    command = [sys.executable, "-m", "fuzz.worker", name, str(n), str(seed), str(folder), engine]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]),
        "PYTHONHASHSEED": "0",
        "PYTHONDONTWRITEBYTECODE": "1",
        "OMP_NUM_THREADS": "1",
        "TEXCLASS_CACHE": str(folder / "cache"),
        "TEXCLASS_DATA": str(folder / "data"),
    }
    with (folder / "log").open("ab") as log:
        process = subprocess.Popen(command, env=environment, stdout=log, stderr=log, cwd=folder)
        hung = _watch(process, shared)
    if hung:
        return "timeout"
    code = process.returncode
    if code < 0:
        return f"crash by {signal.Signals(-code).name}"
    return f"crash with exit code {code}" if code else ""


def _watch(process: "subprocess.Popen[bytes]", shared: Shared) -> bool:
    """Wait; kill a worker that stays at one input for more than the seconds (of its CPU) that it may."""
    last, at_s, since = -1, 0.0, time.monotonic()
    while process.poll() is None:
        time.sleep(0.25)
        done, cpu_s = shared.read().inputs, _cpu_s(process.pid)
        if done != last:
            last, at_s, since = done, cpu_s, time.monotonic()
        started = done > 0
        if started and (cpu_s - at_s > 2 * MOST_SECONDS or time.monotonic() - since > MOST_WALL_S):
            process.kill()
            process.wait()
            return True
    return False


def _cpu_s(pid: int) -> float:
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text()) if path.exists() else {}


def _facts(engine: str, inputs: int) -> dict[str, Any]:
    versions = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return {"engine": engine, "seed": SEED, "inputs_asked_for": inputs, "versions": versions}


if __name__ == "__main__":
    main()
