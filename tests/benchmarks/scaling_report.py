"""The report of `scaling_study.py`: its figure and its tables."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

STAGES = ("load", "segment", "features")
INK, OURS, PAPER = "#222222", "#1f5f99", "#c2571a"


def draw(result: dict[str, Any], path: Path) -> None:
    """Draw time against recordings, the cost of each batch, and time and memory against length."""
    figure = Figure(figsize=(10, 6.4), layout="constrained")
    (many, course), (memory, hours) = figure.subplots(2, 2)
    found, line = result["numbers"], result["linearity"]
    n, usual = np.array(found["sizes"]), np.median(found["seconds"], axis=1)
    many.plot(n, usual, "o", color=OURS, ms=5, label="median of the rounds")
    label = f"{line['ms_per_recording']:.2f} ms a recording + {line['ms_once'] / 1e3:.2f} s"
    many.plot(n, (line["ms_per_recording"] * n + line["ms_once"]) / 1e3, "-", color=INK, lw=1, label=label)
    titled(many, "Extraction by one process", "recordings", "CPU time in s")
    many.set(xlim=(0, None), ylim=(0, None))
    batches = np.min(found["batches"], axis=0)
    course.plot(
        np.linspace(0, n[-1], batches.size), 1e3 * batches / (n[-1] / batches.size), ".-", color=OURS, lw=0.8
    )
    course.set_ylim(0, None)
    titled(course, f"The run of {n[-1]}, batch by batch", "recordings done", "CPU time in ms a recording")
    rows = pd.DataFrame(result["length"])
    x, extra = rows["seconds"] / 3600, rows["features_peak_mb"] - rows["base_mb"] - rows["samples_mb"]
    memory.plot(x, rows["features_peak_mb"] - rows["base_mb"], "o-", color=OURS, ms=4, label="peak")
    memory.plot(x, rows["samples_mb"], "--", color=INK, lw=1, label="the samples themselves")
    memory.plot(x, extra, "o-", color=PAPER, ms=4, label="peak above the samples")
    titled(memory, "Memory of one recording", "length in hours at 10 kHz", "MB")
    for stage, colour in (("features", OURS), ("segment", PAPER), ("load", INK)):
        hours.plot(x, rows[f"{stage}_cpu_s"], "o-", color=colour, ms=4, label=stage)
    titled(hours, "Time of one recording", "length in hours at 10 kHz", "CPU time in s")
    for axes in (many, memory, hours):
        axes.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=130, metadata={"Software": None})


def titled(axes: Axes, title: str, x: str, y: str) -> None:
    """Label a panel."""
    axes.set_title(title, fontsize=10, loc="left")
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.3)


def as_markdown(result: dict[str, Any]) -> str:
    """Return the report for people."""
    found, line, two, killed = (result[k] for k in ("numbers", "linearity", "cores", "kill"))
    worst = max(map(abs, line["deviation"]))
    lines = [
        "# How extraction scales",
        "",
        "The `texclass` set from WAV files of a card to a Parquet table, one thread a process, "
        f"{len(found['seconds'][0])} rounds in turns. Asked for: linear to 5 % from 100 to 5,000 recordings, "
        "two cores at least 1.8 times as fast as one, memory flat in the length of a recording.",
        "",
        "![Time against recordings, batch by batch; memory and time against length](scaling.png)",
        "",
        "## Recordings",
        "",
        f"Recordings of {result['short_s']:g} s, one process, CPU time. The line is "
        f"{line['ms_per_recording']:.2f} ms "
        f"a recording and {line['ms_once']:.0f} ms once; it is off by {worst:.1%} at most. From 500 "
        f"on, t ~ n^p with p = {line['exponent']:.3f} (95 % over rounds: "
        f"+-{line['exponent_half_width']:.3f}). Along the longest run the cost of a recording drifts by "
        f"{line['drift']:+.1%} (+-{line['drift_half_width']:.1%}) from its first to its last batch.",
        "",
        "| recordings | CPU s, median | all rounds | off the line | peak memory in MB |",
        "|---|---|---|---|---|",
    ]
    for n, seconds, off, mb in zip(
        found["sizes"], found["seconds"], line["deviation"], found["peak_mb"], strict=True
    ):
        every = ", ".join(f"{s:.2f}" for s in seconds)
        lines.append(f"| {n} | {np.median(seconds):.2f} | {every} | {off:+.1%} | {mb:.0f} |")
    lines += [
        "",
        "## Cores",
        "",
        f"{two['n_recordings']} recordings of {two['recording_s']:g} s, wall time, workers started before "
        f"(takes {two['start_s']:.1f} s once): **{two['speed_up']:.2f} times** as fast by two processes.",
        "",
        "| processes | best in s | all rounds |",
        "|---|---|---|",
        *(f"| {k} | {min(v):.2f} | {', '.join(f'{s:.2f}' for s in v)} |" for k, v in two["seconds"].items()),
        "",
        f"Load average before the runs: {', '.join(f'{x:.1f}' for x in two['load_before'])}"
        f" on {result['machine']['cores']} cores; above 1, other work took part of them.",
        "",
        "## Length",
        "",
        "One recording a process, one axis at 10 kHz. Peaks are above what an extraction of 2 s needs, each "
        "stage's with what stood before; the last column is what the whole needs beyond its samples.",
        "",
        "| length | samples in MB | loaded | segmented | features | beyond the samples | CPU s: load, "
        "segment, features | s an hour |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["length"]:
        peaks = [row[f"{stage}_peak_mb"] - row["base_mb"] for stage in STAGES]
        seconds = [row[f"{stage}_cpu_s"] for stage in STAGES]
        lines.append(
            f"| {row['seconds']:g} s | {row['samples_mb']:.0f} | {' | '.join(f'{mb:.0f}' for mb in peaks)} | "
            f"{peaks[-1] - row['samples_mb']:.0f} | {', '.join(f'{s:.2f}' for s in seconds)} | "
            f"{sum(seconds) / row['seconds'] * 3600:.1f} |"
        )
    lines += [
        "",
        "Samples are held once, as 8-byte floats. Segmentation filters in blocks and holds its levels, one a "
        "millisecond; a movement above 5 minutes is computed in parts.",
        "",
        "## Killed half-way",
        "",
        f"`kill -9` to a run by two processes after {killed['computed_before']} of {killed['n_recordings']} "
        f"recordings: the restart found {killed['found_at_restart']}, computed {killed['computed_after']}, "
        f"{'touched none' if killed['parts_untouched'] else 'TOUCHED SOME'} of those there, and the "
        f"table {'equals' if killed['table_identical'] else 'DIFFERS from'} that of an uninterrupted run.",
        "",
        f"Machine: {result['machine']['name']}, {result['machine']['cores']} cores. Input: "
        f"{result['input_hash']}, seed {result['seed']}. Versions: "
        + ", ".join(f"{name} {version}" for name, version in result["versions"].items())
        + ".",
    ]
    return "\n".join(lines) + "\n"
