"""Is the simulation like the real thing: level, slope, kurtosis and envelope modulation of the movement.

Run `python tests/benchmarks/realism_study.py`; it writes `reports/studies/realism.{md,json,png}`. The real
recordings are looked for under `$TEXCLASS_DATA` (else `../shared/data`).
"""

import json
import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import signal, stats

from texclass import __version__
from texclass.loaders import Dataset, open_dataset
from texclass.phases import segment
from texclass.recording import Recording
from texclass.signals import combine

ROOT = Path(__file__).parents[2]
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
    phases = segment(recording)
    start, stop = phases.movement or (0, recording.n_samples)
    x = combine(recording.acceleration[start:stop])
    sos = signal.butter(4, BAND_HZ, "bandpass", fs=recording.fs, output="sos")
    band = signal.sosfiltfilt(sos, x)
    f, power = signal.welch(x, recording.fs, nperseg=int(0.25 * recording.fs))
    inside = (f >= BAND_HZ[0]) & (f <= BAND_HZ[1])
    slope = np.polyfit(np.log2(f[inside]), 10 * np.log10(power[inside]), 1)[0]
    window = int(WINDOW_S * recording.fs)
    envelope = np.sqrt((band[: band.size // window * window].reshape(-1, window) ** 2).mean(axis=1))
    return {
        "level": float(band.std()) if recording.unit == "m/s^2" else float("nan"),
        "slope_db_octave": float(slope),
        "kurtosis": float(stats.kurtosis(band, fisher=False)),
        "modulation": float(envelope.std() / envelope.mean()),
    }


def table(datasets: Iterable[Dataset]) -> pd.DataFrame:
    """One row a recording; of a simulated dataset the first two recordings of each surface."""
    rows = []
    for dataset in datasets:
        for entry in dataset.entries:
            if dataset.name == "simulated" and (entry.repetition or 0) > 2:
                continue
            rows.append(
                {"dataset": dataset.name, "recording": entry.recording_id, **describe(dataset.load(entry))}
            )
    return pd.DataFrame(rows)


def draw(values: pd.DataFrame, path: Path) -> None:
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
        axis.set_title(label, fontsize=9)
        axis.grid(axis="y", alpha=0.3)
        if column in ("level", "kurtosis", "modulation"):
            axis.set_yscale("log")
    figure.savefig(path, dpi=130)


def verdicts(values: pd.DataFrame) -> list[str]:
    """Say, statistic by statistic, which share of the real recordings lies in the simulation's range."""
    simulated = values[values["dataset"] == "simulated"]
    lines = []
    for column, label in STATISTICS.items():
        low, high = simulated[column].quantile([0.05, 0.95])
        for name, real in values[values["dataset"] != "simulated"].groupby("dataset"):
            y = real[column].dropna()
            if y.empty:
                continue
            share = float(y.between(low, high).mean())
            lines.append(
                f"- {label}, {name}: {share:.0%} of {y.size} recordings lie in the simulation's 5-95 % range "
                f"[{low:.3g}, {high:.3g}]; "
                f"medians {y.median():.3g} (real) and {simulated[column].median():.3g}."
            )
    return lines


def main() -> None:
    """Run the study and write its report."""
    os.environ.setdefault("TEXCLASS_DATA", str(ROOT.parent / "shared" / "data"))
    datasets = [open_dataset(name) for name in ("simulated", "lmt_excerpts", "stylus6")]
    values = table(datasets)
    out = ROOT / "reports" / "studies"
    draw(values, out / "realism.png")
    lines = verdicts(values)
    medians = values.groupby("dataset", sort=False)[list(STATISTICS)].median()
    hashes = {dataset.name: dataset.input_hash for dataset in datasets}
    text = [
        "# Simulated against real recordings of a tool's movement",
        "",
        "![level, slope, kurtosis, modulation](realism.png)",
        "",
        "All statistics are taken in the band 40-350 Hz that every recording has. Medians:",
        "",
        "| dataset | " + " | ".join(STATISTICS.values()) + " |",
        "|" + "---|" * (len(STATISTICS) + 1),
        *(
            "| " + " | ".join([str(name), *("-" if np.isnan(v) else f"{v:.3g}" for v in row)]) + " |"
            for name, row in zip(medians.index, medians.to_numpy(), strict=True)
        ),
        "",
        "Where the simulation is like the real thing, and where not:",
        "",
        *lines,
        "",
        f"texclass {__version__}, numpy {np.__version__}; input hashes: "
        + ", ".join(f"{name} {digest[:12]}" for name, digest in hashes.items())
        + ". Rerun: `python tests/benchmarks/realism_study.py`.",
    ]
    (out / "realism.md").write_text("\n".join(text) + "\n", encoding="utf-8")
    document = {
        "versions": {"texclass": __version__},
        "input_hash": hashes,
        "values": values.to_dict("records"),
    }
    (out / "realism.json").write_text(
        json.dumps(document, indent=1).replace("NaN", "null") + "\n", encoding="utf-8"
    )
    print("\n".join(text))


if __name__ == "__main__":
    main()
