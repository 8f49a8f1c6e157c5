"""Scaling of the extraction with recordings, cores and length, and restart after kill -9.

Run it by hand from the project's root, on a machine that does nothing else: `python
benchmarks/scaling_study.py`. It writes reports/studies/scaling.json and .png. `--only cores`
(numbers, cores, length, kill) measures one part again and keeps the others. Everything goes the real way:
WAV files of a card are opened, loaded, segmented, computed, written to a table and joined. One thread a
process. Runs that are compared take turns; of cores the best of each counts, because what else runs can only
make one slower, of numbers of recordings, whose runs differ in length, the median. With one process it is
CPU time.
"""

import contextlib
import hashlib
import json
import os
import platform
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import soundfile
from matplotlib.figure import Figure
from study import command_line, table, timed, write

from texclass.evaluation import extract_table, read_table
from texclass.features import load_feature_set
from texclass.features.plan import Plan
from texclass.loaders import open_dataset
from texclass.phases import find_phases
from texclass.provenance import versions
from texclass.reporting import Heading
from texclass.reporting.figure_style import INK, OTHER, OURS

FS, SEED = 10_000, 2015
NUMBERS = (100, 250, 500, 1000, 2000, 3000, 4000, 5000)
SHORT_S, LONG_S = 1.5, 10.0
LENGTHS_S = (10.0, 60.0, 600.0, 1800.0, 3600.0, 10800.0)
N_KILLED = 200
STAGES = ("load", "segment", "features")
CARD = """title = "synthetic strokes"
source = "benchmarks/scaling_study.py"
licence = "MIT"
folder = "{folder}"
format = "files"
fs_hz = {fs}.0
unit = "m/s^2"
phases = "detect"
files = ['(?P<surface>m\\d)_\\d+\\.wav']
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
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak_kb / (2**20 if sys.platform == "darwin" else 2**10)


def numbers(n_rounds: int, largest: int) -> dict[str, Any]:
    """Time extraction against the number of recordings, one process, and each batch of the largest run."""
    sizes = [n for n in NUMBERS if n <= largest]
    with workplace() as folder:
        cards = {n: card_of(folder, n, SHORT_S, folder / "pool") for n in sizes}
        extract(cards[sizes[0]], 1, folder / "warm.npz")
        seconds, memory, batches = {n: [] for n in sizes}, {}, []
        for i in range(n_rounds):
            for n in sizes if i % 2 == 0 else sizes[::-1]:
                ticks: list[float] = []
                run = partial(extract, cards[n], 1, folder / f"{n}-{i}.npz")
                progress = lambda *_, ticks=ticks: ticks.append(time.process_time())  # noqa: E731
                seconds[n].append(timed(partial(run, progress), time.process_time)[1])
                memory.setdefault(n, peak_mb())
                if n == sizes[-1]:
                    batches.append(np.diff(np.array(ticks)[:: max(1, n // 50)]).tolist())
    return {
        "sizes": sizes,
        "seconds": list(seconds.values()),
        "peak_mb": [memory[n] for n in sizes],
        "batches": batches,
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


def cores(n_rounds: int, n_long: int) -> dict[str, Any]:
    """Time the same extraction by one process and by two, in turns, the two started before."""
    with workplace() as folder:

        def wall(card: Path, n_jobs: int, name: str) -> float:
            return timed(partial(extract, card, n_jobs, folder / f"{name}.npz"), time.perf_counter)[1]

        small_card = card_of(folder, 4, LONG_S, folder / "pool")
        card = card_of(folder, n_long, LONG_S, folder / "pool")
        extract(small_card, 1, folder / "warm.npz")
        first_run, repeated = wall(small_card, 2, "start"), wall(small_card, 2, "again")
        seconds: dict[int, list[float]] = {1: [], 2: []}
        load = []
        for i in range(n_rounds):
            for n_jobs in (1, 2):
                load.append(os.getloadavg()[0])
                seconds[n_jobs].append(wall(card, n_jobs, f"{i}-{n_jobs}"))
    return {
        "n_recordings": n_long,
        "recording_s": LONG_S,
        "seconds": {str(k): v for k, v in seconds.items()},
        "speed_up": min(seconds[1]) / min(seconds[2]),
        "start_s": first_run - repeated,
        "load_before": load,
    }


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
            completed = subprocess.run(child, check=True, capture_output=True, text=True)
            rows.append({"seconds": seconds} | json.loads(completed.stdout))
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

    def staged(stage: str, call: Callable[[], Any]) -> Any:
        result, found[f"{stage}_cpu_s"] = timed(call, time.process_time)
        found[f"{stage}_peak_mb"] = peak_mb()
        return result

    recording = staged("load", lambda: dataset[0])
    phases = staged("segment", lambda: find_phases(recording))
    row = staged("features", lambda: plan.compute(recording.with_(phases=phases)))
    found["samples_mb"], found["n_undefined"] = recording.acceleration.nbytes / 2**20, len(row.reasons)
    return found


def kill() -> dict[str, object]:
    """Kill an extraction half-way with SIGKILL, start it again, and count what was computed."""
    with workplace() as folder:
        card, output = card_of(folder, N_KILLED, SHORT_S, folder / "pool"), folder / "t.npz"
        child = [sys.executable, __file__, "--child", "extract", str(card), str(output)]
        parts = output.with_name(f"{output.name}.parts")
        process = subprocess.Popen(child, start_new_session=True)
        while len(list(parts.glob("*/[0-9]*.json"))) < N_KILLED // 2 and process.poll() is None:
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGKILL)  # the process and its workers
        process.wait()
        mtimes = {part: part.stat().st_mtime_ns for part in parts.glob("*/[0-9]*.json")}
        calls, untouched = [], []

        def watch(completed: int, total: int, what: str) -> None:
            calls.append((completed, total))
            if completed == total:
                untouched.append(all(part.stat().st_mtime_ns == at for part, at in mtimes.items()))

        extract(card, 2, output, watch)
        extract(card, 1, folder / "whole.npz")
        return {
            "n_recordings": N_KILLED,
            "exit_code": process.returncode,
            "computed_before": len(mtimes),
            "found_at_restart": calls[0][0],
            "computed_after": calls[-1][0] - calls[0][0],
            "parts_untouched": untouched == [True],
            "table_identical": read_table(output).frame.equals(read_table(folder / "whole.npz").frame),
        }


def draw(result: dict[str, Any]) -> Figure:
    """Draw time against recordings, the cost of each batch, and time and memory against length."""
    figure = Figure(figsize=(10, 6.4), layout="constrained")
    (many, course), (memory, hours) = figure.subplots(2, 2)
    found, line = result["numbers"], result["linearity"]
    n, usual = np.array(found["sizes"]), np.median(found["seconds"], axis=1)
    many.plot(n, usual, "o", color=OURS, ms=5, label="median of the rounds")
    label = f"{line['ms_per_recording']:.2f} ms a recording + {line['ms_once'] / 1e3:.2f} s"
    many.plot(n, (line["ms_per_recording"] * n + line["ms_once"]) / 1e3, "-", color=INK, lw=1, label=label)
    many.set(xlim=(0, None), ylim=(0, None))
    batches = np.min(found["batches"], axis=0)
    completed, cost = np.linspace(0, n[-1], batches.size), 1e3 * batches / (n[-1] / batches.size)
    course.plot(completed, cost, ".-", color=OURS, lw=0.8)
    course.set_ylim(0, None)
    rows = pd.DataFrame(result["length"])
    x, peak = rows["seconds"] / 3600, rows["features_peak_mb"] - rows["base_mb"]
    memory.plot(x, peak, "o-", color=OURS, ms=4, label="peak")
    memory.plot(x, rows["samples_mb"], "--", color=INK, lw=1, label="the samples themselves")
    memory.plot(x, peak - rows["samples_mb"], "o-", color=OTHER, ms=4, label="peak above the samples")
    for stage, colour in zip(STAGES, (INK, OTHER, OURS), strict=True):
        hours.plot(x, rows[f"{stage}_cpu_s"], "o-", color=colour, ms=4, label=stage)
    for axes, title, across, up in (
        (many, "Extraction by one process", "recordings", "CPU time in s"),
        (course, f"The run of {n[-1]}, batch by batch", "recordings done", "CPU time in ms a recording"),
        (memory, "Memory of one recording", "length in hours at 10 kHz", "MB"),
        (hours, "Time of one recording", "length in hours at 10 kHz", "CPU time in s"),
    ):
        axes.set_title(title, fontsize=10, loc="left")
        axes.set(xlabel=across, ylabel=up)
        axes.grid(alpha=0.3)
        if axes is not course:
            axes.legend(fontsize=8, frameon=False)
    return figure


def report(result: dict[str, Any], out: Path) -> None:
    """Write the report of all parts."""
    found, line, two, killed = (result[k] for k in ("numbers", "linearity", "cores", "kill"))
    sizes = [
        {"n": n, "s": np.median(s), "every": ", ".join(f"{x:.2f}" for x in s), "off": off, "mb": mb}
        for n, s, off, mb in zip(
            found["sizes"], found["seconds"], line["deviation"], found["peak_mb"], strict=True
        )
    ]
    lengths = []
    for row in result["length"]:
        above = {stage: row[f"{stage}_peak_mb"] - row["base_mb"] for stage in STAGES}
        hour = sum(row[f"{stage}_cpu_s"] for stage in STAGES) / row["seconds"] * 3600
        lengths.append(row | above | {"beyond": above["features"] - row["samples_mb"], "hour": hour})
    blocks = [
        "The `texclass` set from WAV files of a card to a Parquet table, one thread a process, "
        f"{len(found['seconds'][0])} rounds in turns. Asked for: linear to 5 % from 100 to 5,000 recordings, "
        "two cores at least 1.8 times as fast as one, memory flat in the length of a recording.",
        Heading("Recordings"),
        f"Recordings of {result['short_s']:g} s, one process, CPU time. The line is "
        f"{line['ms_per_recording']:.2f} ms a recording and {line['ms_once']:.0f} ms once; it is off by "
        f"{max(map(abs, line['deviation'])):.1%} at most. From 500 on, t ~ n^p with p = "
        f"{line['exponent']:.3f} (95 % over rounds: +-{line['exponent_half_width']:.3f}). Along the longest "
        f"run the cost of a recording drifts by {line['drift']:+.1%} (+-{line['drift_half_width']:.1%}) "
        "from its first to its last batch.",
        table(
            sizes,
            "recordings = {n} | CPU s, median = {s:.2f} | all rounds = {every} | "
            "off the line = {off:+.1%} | peak memory in MB = {mb:.0f}",
        ),
        Heading("Cores"),
        f"{two['n_recordings']} recordings of {two['recording_s']:g} s, wall time, workers started before "
        f"(takes {two['start_s']:.1f} s once): **{two['speed_up']:.2f} times** as fast by two processes.",
        table(
            (
                {"k": k, "best": min(v), "every": ", ".join(f"{s:.2f}" for s in v)}
                for k, v in two["seconds"].items()
            ),
            "processes = {k} | best in s = {best:.2f} | all rounds = {every}",
            f"Load average before the runs: {', '.join(f'{x:.1f}' for x in two['load_before'])} on "
            f"{result['machine']['cores']} cores; above 1, other work took part of them.",
        ),
        Heading("Length"),
        "One recording a process, one axis at 10 kHz. Peaks (MB) are above what an extraction of 2 s needs, "
        "each stage's with what stood before; then what the whole needs beyond its samples, and CPU time.",
        table(
            lengths,
            "length = {seconds:g} s | samples in MB = {samples_mb:.0f} | loaded = {load:.0f} | "
            "segmented = {segment:.0f} | features = {features:.0f} | beyond the samples = {beyond:.0f} | "
            "load in s = {load_cpu_s:.2f} | segment in s = {segment_cpu_s:.2f} | "
            "features in s = {features_cpu_s:.2f} | s an hour = {hour:.1f}",
            "Samples are held once, as 8-byte floats. Segmentation filters in blocks and holds its levels, "
            "one a millisecond; a movement above 5 minutes is computed in parts.",
        ),
        Heading("Killed half-way"),
        f"`kill -9` to a run by two processes after {killed['computed_before']} of {killed['n_recordings']} "
        f"recordings: the restart found {killed['found_at_restart']}, computed {killed['computed_after']}, "
        f"{'touched none' if killed['parts_untouched'] else 'TOUCHED SOME'} of those there, and the table "
        f"{'equals' if killed['table_identical'] else 'DIFFERS from'} that of an uninterrupted run.",
    ]
    write(out, "scaling", result, "How extraction scales", blocks, draw(result))


def main() -> None:
    parts: dict[str, Callable[[], object]] = {
        "numbers": lambda: numbers(args.rounds, args.largest),
        "cores": lambda: cores(args.rounds, args.long),
        "length": lambda: length(args.longest),
        "kill": kill,
    }
    args = command_line(
        __doc__, rounds=5, largest=NUMBERS[-1], longest=LENGTHS_S[-1], long=600, only=tuple(parts), child=(),
    )  # fmt: skip
    match args.child:
        case ["extract", card, output]:
            return extract(Path(card), 2, Path(output))
        case ["length", card]:
            return print(json.dumps(measure_length(Path(card))))
    path = args.out / "scaling.json"
    is_kept = set(args.only) < set(parts) and path.is_file()
    result = json.loads(path.read_text(encoding="utf-8")) if is_kept else {}
    args.out.mkdir(parents=True, exist_ok=True)
    for name in args.only:
        print(f"{name} ...", flush=True)
        result[name] = parts[name]()
        path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    if lacking := [name for name in parts if name not in result]:
        return print(f"no report yet: {', '.join(lacking)} not measured")
    settings = [FS, SEED, NUMBERS, SHORT_S, LONG_S, args.long, LENGTHS_S, N_KILLED, CARD]
    result |= {
        "linearity": linearity(result["numbers"]),
        "machine": {"name": platform.machine(), "cores": os.cpu_count()},
        "input_hash": hashlib.sha256(json.dumps(settings).encode()).hexdigest()[:16],
        "seed": SEED,
        "short_s": SHORT_S,
        "versions": versions("numpy", "scipy", "joblib", "soundfile"),
    }
    report(result, args.out)


if __name__ == "__main__":
    main()
