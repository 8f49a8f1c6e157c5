"""Fuzz all readers and write reports/studies/fuzzing.json and the section in tests.md.

    python benchmarks/fuzz/run.py [--inputs 1000000] [--targets text,csv] [--engine atheris|own]

`--inputs`: in all, divided by the targets' shares; `--targets`: names, divided by commas, all by default.
Each target runs in processes of its own, one after another. What is done stays in the folder `--state` (in
memory by default), so that a run that is started again goes on. Inputs that broke a promise are there, too.
"""

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from study import command_line, table, write

from fuzz.contract import MOST_GROWTH_MB, MOST_SECONDS
from fuzz.targets import parts_of
from fuzz.worker import shared_counts
from texclass.provenance import versions

BENCHMARKS = Path(__file__).resolve().parents[1]
SEED = 20260711
MOST_WALL_S = 90.0
MOST_RESTARTS = 200
LIBRARIES = (
    "numpy", "scipy", "h5py", "pyarrow", "pandas", "soundfile", "mcap", "rosbags", "openpyxl",
    "npTDMS", "skops", "scikit-learn", "atheris",
)  # fmt: skip
SUMMED = ("inputs", "accepted", "refused", "broken", "timeouts", "crashes")


def main() -> None:
    args = command_line(
        __doc__, inputs=1_000_000, targets="", state=Path("/dev/shm/texclass-fuzz"), engine=""
    )
    there = importlib.util.find_spec("atheris") is not None
    engine = args.engine or ("atheris" if there else "own")
    if engine not in ("atheris", "own"):
        raise SystemExit(f"--engine is {engine!r}. Expected atheris or own")
    if engine == "atheris" and not there:
        raise SystemExit("atheris is not installed. Expected --engine own, or pip install atheris")
    parts = parts_of()
    results: dict[str, Any] = {}
    for name in args.targets.split(",") if args.targets else parts:
        n = -(-parts[name] * args.inputs // sum(parts.values()))
        results[name] = run_target(name, n, args.state / name.replace(" ", "_"), engine)
        report(args.out, results, {"engine": engine, "seed": SEED, "inputs_asked_for": args.inputs})
    if any(one["broken"] for one in results.values()):
        raise SystemExit("some inputs broke a promise of their reader; see the report")


def report(folder: Path, results: dict[str, Any], facts: dict[str, Any]) -> None:
    """Write the report; called after each target, so that partial results stay."""
    total = {key: sum(one[key] for one in results.values()) for key in SUMMED}
    result = {
        **facts,
        "versions": versions(*LIBRARIES),
        "seconds_allowed": MOST_SECONDS,
        "growth_allowed_mb": MOST_GROWTH_MB,
        "total": total,
        "targets": results,
    }
    rows = [
        {"name": name, "other": one["broken"] - one["timeouts"] - one["crashes"], **one}
        for name, one in results.items()
    ]
    blocks: list[Any] = [
        "{inputs:,} inputs: {accepted:,} were read, {refused:,} refused with a message that names the file, "
        "{broken:,} broke a promise ({timeouts} took too long, {crashes} ended the process).".format(**total),
        "A reader may return a valid object or raise a ValueError or OSError that names its file. It may "
        f"raise or warn of nothing else, take no more than {MOST_SECONDS:g} s of CPU or {MOST_GROWTH_MB} MB "
        "for an input of at most 64 kB, unpickle, start or write nothing and leave no file behind. Other "
        "exceptions: what broke any of these promises, but for time and the end of the process. peak: the "
        f"resident memory of the process, libraries included. Engine: {facts['engine']}.",
        table(
            rows,
            "reader = {name} | inputs = {inputs:,} | accepted = {accepted:,} | refused = {refused:,} | "
            "other exceptions = {other} | timeouts = {timeouts} | crashes = {crashes} | "
            "slowest (s) = {slowest_s:.3f} | peak (MB) = {peak_mb:,} | inputs/s = {inputs_per_s}",
        ),
    ]
    broken = [f"{row['name']}: {times} x {what}" for row in rows for what, times in row["findings"].items()]
    if broken:
        blocks += ["What broke a promise:", broken]
    write(folder, "fuzzing", result, "Readers on damaged inputs", blocks)


def run_target(name: str, n: int, folder: Path, engine: str) -> dict[str, Any]:
    """Feed one reader until it had n inputs, in as many processes as it takes."""
    folder.mkdir(parents=True, exist_ok=True)
    counts, ends = shared_counts(folder), _read(folder / "ends.json")
    seconds = float(ends.pop("seconds", 0.0))
    for attempt in range(MOST_RESTARTS):
        n_done = int(counts["inputs"])
        if n_done >= n:
            break
        start = time.monotonic()
        how = _one_process(name, n - n_done, SEED + attempt + n_done, folder, engine)
        seconds += time.monotonic() - start
        if how:
            at_hand = counts["data"][: counts["size"]].tobytes()
            (folder / f"{how.replace(' ', '_')}{sum(ends.values())}.bin").write_bytes(at_hand)
            ends[how] = ends.get(how, 0) + 1
            counts["inputs"] += 1
            counts["broken"] += 1
        elif counts["inputs"] == n_done:
            raise RuntimeError(f"{name}: the worker did nothing; see {folder / 'log'}")
        (folder / "ends.json").write_text(json.dumps(ends | {"seconds": seconds}))
    return {
        **{key: int(counts[key]) for key in ("inputs", "accepted", "refused", "broken")},
        "crashes": sum(times for how, times in ends.items() if how.startswith("crash")),
        "timeouts": ends.get("timeout", 0),
        "slowest_s": round(float(counts["slowest_s"]), 3),
        "slowest_bytes": int(counts["slowest_bytes"]),
        "peak_mb": round(float(counts["peak_mb"])),
        "inputs_per_s": round(int(counts["inputs"]) / seconds) if seconds else None,
        "findings": _read(folder / "findings.json") | ends,
    }


def _one_process(name: str, n: int, seed: int, folder: Path, engine: str) -> str:
    """Run a worker to its end; return "" or how it ended: "timeout", "crash by SIGSEGV"."""
    command = [sys.executable, "-m", "fuzz.worker", name, str(n), str(seed), str(folder), engine]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(BENCHMARKS), os.environ.get("PYTHONPATH", "")]),
        "PYTHONHASHSEED": "0",
        "PYTHONDONTWRITEBYTECODE": "1",
        "OMP_NUM_THREADS": "1",
        "TEXCLASS_CACHE": str(folder / "cache"),
        "TEXCLASS_DATA": str(folder / "data"),
    }
    with (folder / "log").open("ab") as log:
        process = subprocess.Popen(command, env=environment, stdout=log, stderr=log, cwd=folder)
        hung = _watch(process, folder)
    if hung:
        return "timeout"
    if process.returncode < 0:
        return f"crash by {signal.Signals(-process.returncode).name}"
    return f"crash with exit code {process.returncode}" if process.returncode else ""


def _watch(process: "subprocess.Popen[bytes]", folder: Path) -> bool:
    """Wait; kill a worker that stays at one input for more than the seconds (of its CPU) that it may."""
    counts, last, at_s, since = shared_counts(folder), -1, 0.0, time.monotonic()
    while process.poll() is None:
        time.sleep(0.25)
        try:
            fields = Path(f"/proc/{process.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        except OSError:
            continue
        cpu_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        n_done = int(counts["inputs"])
        if n_done != last:
            last, at_s, since = n_done, cpu_s, time.monotonic()
        if n_done and (cpu_s - at_s > 2 * MOST_SECONDS or time.monotonic() - since > MOST_WALL_S):
            process.kill()
            process.wait()
            return True
    return False


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


if __name__ == "__main__":
    main()
