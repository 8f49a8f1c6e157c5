"""Compare simulated with real movements: levels, slope, kurtosis and envelope modulation.

`python benchmarks/realism_study.py [--most N]` writes reports/studies/realism. `--most` limits the recordings
per dataset.
"""

import json
import os
import tempfile
from unittest import mock

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from scipy import signal, stats
from study import command_line, write

from texclass.loaders import Dataset, open_dataset
from texclass.phases import find_phases
from texclass.recording import Recording
from texclass.reporting import Table
from texclass.simulate import profile

BAND_HZ = (40.0, 350.0)
"""A band that every recording has: stylus6 is sampled at 1 kHz and carries a device line at 400 Hz."""
WINDOW_S = 0.05
COLORS = ("#0072B2", "#56B4E9", "#D55E00", "#009E73")
LOW_BANDS_HZ = {"low": (20.0, 50.0), "middle": (50.0, 100.0)}
"""Bands in which waviness matters; their levels are relative to `REFERENCE_HZ`, below the device line."""
REFERENCE_HZ = (100.0, 350.0)
NO_WAVINESS = "no waviness"
STATISTICS = {
    "low": "20-50 Hz re 100-350 Hz [dB]",
    "middle": "50-100 Hz re 100-350 Hz [dB]",
    "level": "RMS, 40-350 Hz [m/s²]",
    "slope_db_octave": "spectral slope, 40-350 Hz [dB/octave]",
    "kurtosis": "kurtosis, 40-350 Hz [normal = 3]",
    "modulation": "envelope modulation [std/mean, 50 ms]",
}


def describe(recording: Recording) -> dict[str, float]:
    """Return the statistics of the movement."""
    start, stop = find_phases(recording).movement or (0, recording.n_samples)
    axes = recording.acceleration[start:stop].reshape(stop - start, -1)
    x = axes[:, -1]  # along the tool; most of the real recordings contain only this axis
    sos = signal.butter(4, BAND_HZ, "bandpass", fs=recording.fs, output="sos")
    band = signal.sosfiltfilt(sos, x)
    f, power = signal.welch(x, recording.fs, nperseg=int(0.25 * recording.fs))
    inside = (f >= BAND_HZ[0]) & (f <= BAND_HZ[1])
    window = int(WINDOW_S * recording.fs)
    reference = power[(f >= REFERENCE_HZ[0]) & (f < REFERENCE_HZ[1])].sum()
    levels = {
        name: 10 * np.log10(power[(f >= low) & (f < high)].sum() / reference)
        for name, (low, high) in LOW_BANDS_HZ.items()
    }
    envelope = np.sqrt((band[: band.size // window * window].reshape(-1, window) ** 2).mean(axis=1))
    return levels | {
        "level": band.std() if recording.unit == "m/s^2" else np.nan,
        "slope_db_octave": np.polyfit(np.log2(f[inside]), 10 * np.log10(power[inside]), 1)[0],
        "kurtosis": stats.kurtosis(band, fisher=False),
        "modulation": envelope.std() / envelope.mean(),
    }


def draw(values: pd.DataFrame) -> Figure:
    """Draw one panel per statistic, with one dot per recording and the median of each dataset."""
    names = list(dict.fromkeys(values["dataset"]))
    figure = Figure(figsize=(14, 3.8), layout="constrained")
    rng = np.random.default_rng(0)
    for axis, (column, label) in zip(figure.subplots(1, len(STATISTICS)), STATISTICS.items(), strict=True):
        for position, name in enumerate(names):
            y = values.loc[values["dataset"] == name, column].dropna()
            jitter = position + rng.uniform(-0.18, 0.18, y.size)
            axis.plot(jitter, y, "o", ms=4, alpha=0.65, color=COLORS[position])
            if y.empty:
                axis.text(position, 0.5, "scale\nunknown", ha="center", transform=axis.get_xaxis_transform())
            else:
                axis.hlines(y.median(), position - 0.32, position + 0.32, color="black", lw=2)
        axis.set_xticks(range(len(names)), names, rotation=20)
        axis.set_xlim(-0.6, len(names) - 0.4)
        axis.set_title(label.replace(" [", "\n["), fontsize=9)
        axis.grid(axis="y", alpha=0.3)
        if column in ("level", "kurtosis", "modulation"):
            axis.set_yscale("log")
            axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.yaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_minor_locator(NullLocator())
    return figure


def verdicts(values: pd.DataFrame) -> list[str]:
    """Return, for each statistic, the share of real recordings within the range of the simulation."""
    simulated, lines = values[values["dataset"] == "simulated"], []
    for column, label in STATISTICS.items():
        low, high = simulated[column].quantile([0.05, 0.95])
        for name, real in values[~values["dataset"].isin(["simulated", NO_WAVINESS])].groupby("dataset"):
            y = real[column].dropna()
            if not y.empty:
                lines.append(
                    f"{label}, {name}: {y.between(low, high).mean():.0%} of {y.size} recordings lie within "
                    f"the 5-95 % range of the simulation [{low:.3g}, {high:.3g}]; medians {y.median():.3g} "
                    f"(real) and {simulated[column].median():.3g} (simulated)."
                )
    return lines


def statistics(dataset: Dataset, most: int) -> pd.DataFrame:
    """Return the statistics of the recordings of a dataset; of a simulated one, of two per surface."""
    return pd.DataFrame(
        {"dataset": dataset.name, "recording": entry.recording_id, **describe(dataset.load(entry))}
        for entry in dataset.entries[:most]
        if dataset.name != "simulated" or (entry.repetition or 0) <= 2
    )


def main() -> None:
    args = command_line(__doc__, most=1_000_000)
    datasets = [open_dataset(name) for name in ("simulated", "lmt_excerpts", "stylus6")]
    values = pd.concat(statistics(dataset, args.most) for dataset in datasets)
    with (
        tempfile.TemporaryDirectory() as cache,
        mock.patch.dict(os.environ, {"TEXCLASS_CACHE": cache}),
        mock.patch.object(profile, "waviness_gain", lambda surface, frequency: np.ones_like(frequency)),
    ):
        before = statistics(open_dataset("simulated"), args.most).assign(dataset=NO_WAVINESS)
    is_simulated = values["dataset"] == "simulated"
    values = pd.concat([values[is_simulated], before, values[~is_simulated]], ignore_index=True)
    medians = values.groupby("dataset", sort=False)[list(STATISTICS)].median().rename(columns=STATISTICS)
    result = {
        "input_hash": {dataset.name: dataset.input_hash for dataset in datasets},
        "values": json.loads(values.to_json(orient="records", double_precision=15)),  # NaN becomes null
    }
    blocks = [
        f"All recordings contain the band 40-350 Hz. `{NO_WAVINESS}`: the same simulated recordings with a "
        "height spectrum that is flat above the corner wavelength, as in versions up to 0.3. Medians:",
        Table(medians.reset_index()),
        "Similarities and differences of simulated and real recordings:",
        verdicts(values),
    ]
    title = "Simulated against real recordings of a tool's movement"
    write(args.out, "realism", result, title, blocks, draw(values))


if __name__ == "__main__":
    main()
