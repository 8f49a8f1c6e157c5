"""How extraction scales: with the number of recordings, cores, the length of a recording; and after kill -9.

Run it by hand from the project's root, on a machine that does nothing else: `python
tests/benchmarks/scaling_study.py`. It writes reports/studies/scaling.json, .md and .png. `--only cores`
(numbers, cores, length, kill) measures one part again and keeps the others. Everything goes the real way:
WAV files of a card are opened, loaded, segmented, computed, written to Parquet and joined. One thread a
process. Runs that are compared take turns; of cores the best of each counts, because what else runs can only
make one slower, of numbers of recordings, whose runs differ in length, the median. With one process it is
CPU time.
"""

# ruff: noqa: E402  (the number of threads is set before numpy reads it)
import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import contextlib
import hashlib
import json
import platform
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
import soundfile
from scaling_report import as_markdown, draw

from texclass.experiment import extract_table
from texclass.features import load_feature_set
from texclass.features.extractor import Plan
from texclass.loaders import open_dataset
from texclass.phases import segment
from texclass.provenance import versions

R = TypeVar("R")
FS, SEED = 10_000, 2015
NUMBERS = (100, 250, 500, 1000, 2000, 3000, 4000, 5000)
SHORT_S, LONG_S, N_LONG = 1.5, 10.0, 600
LENGTHS_S = (10.0, 60.0, 600.0, 1800.0, 3600.0, 10800.0)
N_KILLED = 200
CARD = """title = "synthetic strokes"
source = "tests/benchmarks/scaling_study.py"
licence = "MIT"
folder = "{folder}"
format = "files"
fs_hz = {fs}.0
unit = "m/s^2"
phases = "detect"
files = ['(?P<material>m\\d)_\\d+\\.wav']
"""


def write_stroke(path: Path, seconds: float, seed: int) -> None:
    """Write three taps and a stroke, a minute at a time, as WAV of 4-byte floats."""
    rng, n = np.random.default_rng([SEED, seed]), round(seconds * FS)
    start = 1e-3 * rng.standard_normal(FS // 2)
    t = np.arange(600) / FS
    for i in range(3):
        at = (1 + i) * FS // 10
        start[at : at + t.size] += (
            (2 + i) * np.exp(-120 * t) * np.sin(2 * np.pi * (200 + 100 * (seed % 9)) * t)
        )
    with soundfile.SoundFile(path, "w", samplerate=FS, channels=1, subtype="FLOAT") as file:
        file.write(start.astype(np.float32))
        for k in range(0, n - start.size, 60 * FS):
            size = min(60 * FS, n - start.size - k)
            file.write(np.convolve(rng.standard_normal(size + 1), [0.5, 0.5], "valid").astype(np.float32))


def card_of(folder: Path, n: int, seconds: float, pool: Path) -> Path:
    """Return a card of `n` recordings of a pool, which is filled as far as it has to be."""
    pool.mkdir(exist_ok=True)
    (folder / f"data{n}").mkdir()
    for i in range(n):
        file = pool / f"m{i % 9}_{i:05d}.wav"
        if not file.exists():
            write_stroke(file, seconds, i)
        os.link(file, folder / f"data{n}" / file.name)
    card = folder / f"card{n}.toml"
    card.write_text(CARD.format(folder=f"data{n}", fs=FS), encoding="utf-8")
    return card


@contextlib.contextmanager
def workplace() -> Iterator[Path]:
    """Give an empty folder for recordings, tables and caches; none of them is left."""
    with tempfile.TemporaryDirectory() as name:
        os.environ["TEXCLASS_DATA"] = name
        os.environ["TEXCLASS_CACHE"] = str(Path(name) / "cache")
        yield Path(name)


def extract(card: Path, n_jobs: int, output: Path, progress: Callable[..., None] | None = None) -> None:
    """Do what `texclass extract` does, from the card to the table."""
    table = extract_table(
        open_dataset(card), load_feature_set("texclass"), output, n_jobs=n_jobs, progress=progress
    )
    assert table.n_recordings > 0


def peak_mb() -> float:
    """Return the most memory this process ever held, in MB."""
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (2**20 if sys.platform == "darwin" else 2**10)


def numbers(n_rounds: int, largest: int) -> dict[str, object]:
    """Time extraction against the number of recordings, one process, and each batch of the largest run."""
    sizes = [n for n in NUMBERS if n <= largest]
    with workplace() as folder:
        cards = {n: card_of(folder, n, SHORT_S, folder / "pool") for n in sizes}
        extract(cards[sizes[0]], 1, folder / "warm.parquet")
        seconds, memory = {n: [] for n in sizes}, {}
        batches: list[list[float]] = []
        for i in range(n_rounds):
            for n in sizes if i % 2 == 0 else sizes[::-1]:
                ticks: list[float] = []
                start = time.process_time()
                extract(
                    cards[n],
                    1,
                    folder / f"{n}-{i}.parquet",
                    lambda *_, t=ticks: t.append(time.process_time()),
                )
                seconds[n].append(time.process_time() - start)
                memory.setdefault(n, peak_mb())
                if n == sizes[-1]:
                    batches.append(np.diff(np.array(ticks)[:: max(1, n // 50)]).tolist())
    return {"sizes": sizes, "seconds": [seconds[n] for n in sizes], "peak_mb": [memory[n] for n in sizes]} | {
        "batches": batches
    }


def linearity(found: dict[str, object]) -> dict[str, object]:
    """Return the line through median times, the deviations from it, and the exponent with its interval.

    Medians, not the best: a run of a second may catch a fast moment of the machine, a run of a minute cannot,
    so that the best times bend upwards by themselves.

    The exponent p of t ~ n^p is fitted in each round from 500 recordings on, where what a run costs once is
    small; its 95 % interval is Student's over rounds.
    """
    n, t = np.array(found["sizes"], dtype=float), np.array(found["seconds"], dtype=float)
    usual = np.median(t, axis=1)
    # Relative errors count: the smallest run as much as the largest.
    slope, once = np.linalg.lstsq(
        np.stack([n, np.ones_like(n)], 1) / usual[:, None], np.ones_like(n), rcond=None
    )[0]
    large = n >= min(500, n[-1] / 2)
    each = np.array([np.polyfit(np.log(n[large]), np.log(column), 1)[0] for column in t[large].T])
    batches = np.min(np.array(found["batches"]), axis=0)
    trend = np.polyfit(np.linspace(-0.5, 0.5, batches.size), batches / np.median(batches), 1)
    spread = np.std(batches / np.median(batches)) * np.sqrt(12 / batches.size)
    half = 4.3 * each.std(ddof=1) / np.sqrt(each.size) if each.size > 2 else float("nan")
    return {
        "ms_per_recording": 1e3 * slope,
        "ms_once": 1e3 * once,
        "deviation": (usual / (slope * n + once) - 1).tolist(),
        "exponent": float(np.polyfit(np.log(n[large]), np.log(usual[large]), 1)[0]),
        "exponent_half_width": float(half),
        "drift": float(trend[0]),
        "drift_half_width": float(1.96 * spread),
    }


def cores(n_rounds: int) -> dict[str, object]:
    """Time the same extraction by one process and by two, in turns, the two started before."""
    with workplace() as folder:
        few = card_of(folder, 4, LONG_S, folder / "pool")
        card = card_of(folder, N_LONG, LONG_S, folder / "pool")
        extract(few, 1, folder / "warm.parquet")
        started = wall(lambda: extract(few, 2, folder / "start.parquet"))
        again = wall(lambda: extract(few, 2, folder / "again.parquet"))
        seconds: dict[int, list[float]] = {1: [], 2: []}
        load = []
        for i in range(n_rounds):
            for n_jobs in (1, 2):
                load.append(os.getloadavg()[0])
                output = folder / f"{i}-{n_jobs}.parquet"
                seconds[n_jobs].append(wall(lambda j=n_jobs, o=output: extract(card, j, o)))  # type: ignore[misc]
    return {
        "n_recordings": N_LONG,
        "recording_s": LONG_S,
        "seconds": {str(k): v for k, v in seconds.items()},
        "speed_up": min(seconds[1]) / min(seconds[2]),
        "start_s": started - again,
        "load_before": load,
    }


def wall(call: Callable[[], object]) -> float:
    """Return the seconds that a call takes."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def length(longest: float) -> list[dict[str, float]]:
    """Measure memory and time of single recordings, each in a process of its own."""
    rows = []
    for seconds in (s for s in LENGTHS_S if s <= longest):
        with workplace() as folder:
            (folder / "data1").mkdir()
            write_stroke(folder / "data1" / "m0_0.wav", seconds, 0)
            card = folder / "card1.toml"
            card.write_text(CARD.format(folder="data1", fs=FS), encoding="utf-8")
            child = [sys.executable, __file__, "--child", "length", str(card)]
            done = subprocess.run(child, check=True, capture_output=True, text=True)
            rows.append({"seconds": seconds} | json.loads(done.stdout))
            print(rows[-1], flush=True)
    return rows


def measure_length(card: Path) -> dict[str, float]:
    """Load, segment and compute the only recording of a card; the peaks are of everything so far."""
    dataset, plan = open_dataset(card), Plan.of(load_feature_set("texclass"))
    with (
        tempfile.TemporaryDirectory() as name
    ):  # warms up: what is imported or compiled once is no part of it
        write_stroke(Path(name) / "m0_0.wav", 2.0, 0)
        short = Path(name) / "card.toml"
        short.write_text(CARD.format(folder=name, fs=FS), encoding="utf-8")
        plan.compute(open_dataset(short)[0])
    found = {"base_mb": peak_mb()}

    def staged(stage: str, call: Callable[[], R]) -> R:
        start = time.process_time()
        result = call()
        found[f"{stage}_cpu_s"], found[f"{stage}_peak_mb"] = time.process_time() - start, peak_mb()
        return result

    recording = staged("load", lambda: dataset[0])
    phases = staged("segment", lambda: segment(recording))
    row = staged("features", lambda: plan.compute(recording.with_(phases=phases)))
    found["samples_mb"], found["n_undefined"] = recording.acceleration.nbytes / 2**20, len(row.reasons)
    return found


def kill() -> dict[str, object]:
    """Kill an extraction half-way with SIGKILL, start it again, and count what was computed."""
    with workplace() as folder:
        card, output = card_of(folder, N_KILLED, SHORT_S, folder / "pool"), folder / "t.parquet"
        child = [sys.executable, __file__, "--child", "extract", str(card), "--child-output", str(output)]
        parts = output.with_name(f"{output.name}.parts")
        process = subprocess.Popen(child, start_new_session=True)
        while len(list(parts.glob("*/*.parquet"))) < N_KILLED // 2 and process.poll() is None:
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGKILL)  # the process and its workers
        process.wait()
        before = {part: part.stat().st_mtime_ns for part in parts.glob("*/*.parquet")}
        calls, untouched = [], []

        def watch(done: int, total: int, what: str) -> None:
            calls.append((done, total))
            if done == total:
                untouched.append(all(part.stat().st_mtime_ns == at for part, at in before.items()))

        extract(card, 2, output, watch)
        extract(card, 1, folder / "whole.parquet")
        return {
            "n_recordings": N_KILLED,
            "exit_code": process.returncode,
            "computed_before": len(before),
            "found_at_restart": calls[0][0],
            "computed_after": calls[-1][0] - calls[0][0],
            "parts_untouched": untouched == [True],
            "table_identical": pd.read_parquet(output).equals(pd.read_parquet(folder / "whole.parquet")),
        }


def main() -> None:
    """Measure, print and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--largest", type=int, default=NUMBERS[-1])
    parser.add_argument("--longest", type=float, default=LENGTHS_S[-1])
    parser.add_argument("--only", choices=("numbers", "cores", "length", "kill"), action="append")
    parser.add_argument(
        "--out", type=Path, default=Path(__file__).resolve().parents[2] / "reports" / "studies"
    )
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--child-output", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    match options.child:
        case ["extract", card]:
            return extract(Path(card), 2, options.child_output)
        case ["length", card]:
            return print(json.dumps(measure_length(Path(card))))
    path = options.out / "scaling.json"
    result = json.loads(path.read_text(encoding="utf-8")) if options.only and path.is_file() else {}
    parts: dict[str, Callable[[], object]] = {
        "numbers": lambda: numbers(options.rounds, options.largest),
        "cores": lambda: cores(options.rounds),
        "length": lambda: length(options.longest),
        "kill": kill,
    }
    for name in options.only or parts:
        print(f"{name} ...", flush=True)
        result[name] = parts[name]()
        options.out.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    if lacking := [name for name in parts if name not in result]:
        return print(f"no report yet: {', '.join(lacking)} not measured")
    settings = [FS, SEED, NUMBERS, SHORT_S, LONG_S, N_LONG, LENGTHS_S, N_KILLED, CARD]
    result |= {
        "linearity": linearity(result["numbers"]),
        "machine": {"name": platform.machine(), "cores": os.cpu_count()},
        "input_hash": hashlib.sha256(json.dumps(settings).encode()).hexdigest()[:16],
        "seed": SEED,
        "short_s": SHORT_S,
        "versions": versions("numpy", "scipy", "joblib", "pyarrow", "soundfile"),
    }
    path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    path.with_suffix(".md").write_text(as_markdown(result), encoding="utf-8")
    draw(result, path.with_suffix(".png"))
    print(as_markdown(result))


if __name__ == "__main__":
    main()
