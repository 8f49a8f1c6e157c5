"""Simulated compared with real movements: level, slope, kurtosis and envelope modulation.

`python benchmarks/realism_study.py [--most N]` writes reports/studies/realism. The real recordings are
looked for under `$TEXCLASS_DATA` (else `../shared/data`). `--most`: at most so many recordings of a dataset.
"""

import json

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from scipy import signal, stats
from study import command_line, write

from texclass.loaders import open_dataset
from texclass.phases import find_phases
from texclass.recording import Recording
from texclass.reporting import Table
from texclass.signals import combine

BAND_HZ = (40.0, 350.0)
"""A band that every recording has: stylus6 is sampled at 1 kHz and carries a device line at 400 Hz."""
WINDOW_S = 0.05
STATISTICS = {
    "level": "RMS, 40-350 Hz [m/s²]",
    "slope_db_octave": "spectral slope, 40-350 Hz [dB/octave]",
    "kurtosis": "kurtosis, 40-350 Hz [normal = 3]",
    "modulation": "envelope modulation [std/mean, 50 ms]",
}


def describe(recording: Recording) -> dict[str, float]:
    """Level, slope, kurtosis and envelope modulation of the movement in the common band."""
    start, stop = find_phases(recording).movement or (0, recording.n_samples)
    x = combine(recording.acceleration[start:stop])
    sos = signal.butter(4, BAND_HZ, "bandpass", fs=recording.fs, output="sos")
    band = signal.sosfiltfilt(sos, x)
    f, power = signal.welch(x, recording.fs, nperseg=int(0.25 * recording.fs))
    inside = (f >= BAND_HZ[0]) & (f <= BAND_HZ[1])
    window = int(WINDOW_S * recording.fs)
    envelope = np.sqrt((band[: band.size // window * window].reshape(-1, window) ** 2).mean(axis=1))
    return {
        "level": band.std() if recording.unit == "m/s^2" else np.nan,
        "slope_db_octave": np.polyfit(np.log2(f[inside]), 10 * np.log10(power[inside]), 1)[0],
        "kurtosis": stats.kurtosis(band, fisher=False),
        "modulation": envelope.std() / envelope.mean(),
    }


def draw(values: pd.DataFrame) -> Figure:
    """One panel a statistic, one strip a dataset, one dot a recording, the median marked."""
    names = list(dict.fromkeys(values["dataset"]))
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    rng = np.random.default_rng(0)
    for axis, (column, label) in zip(figure.subplots(1, len(STATISTICS)), STATISTICS.items(), strict=True):
        for position, name in enumerate(names):
            y = values.loc[values["dataset"] == name, column].dropna()
            jitter = position + rng.uniform(-0.18, 0.18, y.size)
            axis.plot(jitter, y, "o", ms=4, alpha=0.65, color=("#0072B2", "#D55E00", "#009E73")[position])
            if y.empty:
                axis.text(position, 0.5, "scale\nunknown", ha="center", transform=axis.get_xaxis_transform())
            else:
                axis.hlines(y.median(), position - 0.32, position + 0.32, color="black", lw=2)
        axis.set_xticks(range(len(names)), names, rotation=20)
        axis.set_xlim(-0.6, len(names) - 0.4)
        axis.set_title(label.replace(" [", "\n["), fontsize=9)
        axis.grid(axis="y", alpha=0.3)
        if column != "slope_db_octave":
            axis.set_yscale("log")
            axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.yaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_minor_locator(NullLocator())
    return figure


def verdicts(values: pd.DataFrame) -> list[str]:
    """Return, for each statistic, the share of real recordings within the range of the simulation."""
    simulated = values[values["dataset"] == "simulated"]
    lines = []
    for column, label in STATISTICS.items():
        low, high = simulated[column].quantile([0.05, 0.95])
        for name, real in values[values["dataset"] != "simulated"].groupby("dataset"):
            y = real[column].dropna()
            if not y.empty:
                lines.append(
                    f"{label}, {name}: {y.between(low, high).mean():.0%} of {y.size} recordings lie in the "
                    f"simulation's 5-95 % range [{low:.3g}, {high:.3g}]; medians {y.median():.3g} (real) and "
                    f"{simulated[column].median():.3g}."
                )
    return lines


def main() -> None:
    args = command_line(__doc__, most=1_000_000)
    datasets = [open_dataset(name) for name in ("simulated", "lmt_excerpts", "stylus6")]
    values = pd.DataFrame(
        {"dataset": dataset.name, "recording": entry.recording_id, **describe(dataset.load(entry))}
        for dataset in datasets
        for entry in dataset.entries[: args.most]
        if dataset.name != "simulated" or (entry.repetition or 0) <= 2
    )
    medians = values.groupby("dataset", sort=False)[list(STATISTICS)].median().rename(columns=STATISTICS)
    result = {
        "input_hash": {dataset.name: dataset.input_hash for dataset in datasets},
        "values": json.loads(values.to_json(orient="records", double_precision=15)),  # NaN becomes null
    }
    blocks = [
        "All statistics are taken in the band 40-350 Hz that every recording has (of a simulated surface, of "
        "its first two recordings). Medians:",
        Table(medians.reset_index()),
        "Where the simulation is like the real thing, and where not:",
        verdicts(values),
    ]
    title = "Simulated against real recordings of a tool's movement"
    write(args.out, "realism", result, title, blocks, draw(values))


if __name__ == "__main__":
    main()
