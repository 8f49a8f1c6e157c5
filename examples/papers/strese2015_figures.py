"""Draw figures 4 to 13 and Table I of `strese2015`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import strese2015_study as study
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from scipy import fft, signal
from strese2015_study import FS

from texclass.features.cepstrum import log_energies, mel_filters, mfcc
from texclass.features.movement_filters import level, low_passed
from texclass.features.phase_view import PhaseView
from texclass.phases import find_phases
from texclass.recording import Recording
from texclass.reporting.figure_style import FAINT, INK, LOOKS, MUTED, OTHER, OURS, label_rows, legend_above
from texclass.signals import combine, moving_average

CLASSIFIERS = {"naive_bayes": "naive Bayes", "lda": "linear discriminant", "euclidean": "Euclidean distance"}


def panels(width: float, rows: int, columns: int, height: float = 2.3, **options: Any) -> tuple[Drawing, Any]:
    """Return a figure and its axes, shape (rows, columns)."""
    figure = Drawing(figsize=(width, 0.4 + height * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def draw_phases(recording: Recording, width: float) -> Drawing:
    """Figure 4: phases of a recording.

    Shaded: true taps and true movement. Dashed: movement found by `find_phases`; triangles: taps found.
    """
    figure, ((axes,),) = panels(width, 1, 1, 2.6)
    phases, truth = find_phases(recording), recording.phases
    t = np.arange(recording.n_samples) / recording.fs
    axes.plot(t, combine(recording.acceleration), color=OURS, linewidth=0.4)
    for k, tap in enumerate(truth.taps):
        label = "" if k else "true taps"
        axes.axvspan(tap.start / FS, tap.end / FS, color=OTHER, alpha=0.35, linewidth=0, label=label)
    start, stop = (edge / FS for edge in truth.movement)
    axes.axvspan(start, stop, color=FAINT, alpha=0.4, linewidth=0, label="true movement")
    for k, edge in enumerate(phases.movement):
        axes.axvline(
            edge / FS, color=INK, linewidth=1.2, linestyle="--", label="" if k else "found: movement"
        )
    top = axes.get_ylim()[1]
    impacts = [tap.impact / FS for tap in phases.taps]
    axes.plot(impacts, [top] * len(impacts), "v", color=INK, markersize=6, clip_on=False, label="found: taps")
    axes.set(xlabel="time (s)", ylabel="acceleration (m/s²)", xlim=(0, t[-1]))
    legend_above(figure, axes)
    return figure


def draw_taps(recording: Recording, width: float) -> Drawing:
    """Figures 5 and 7: taps of rising velocity, and the sections of one tap.

    Left: taps at 10 to 45 mm/s. Right: magnitude of the last tap; only its impact and decay enter max(i) of
    eq. 1, and only the motion of the hand before the contact enters the sum over h.
    """
    figure, ((left, right),) = panels(width, 1, 2, 2.6, width_ratios=(1.5, 1))
    x = combine(recording.acceleration)
    x -= np.median(x)
    left.plot(np.arange(x.size) / FS, x, color=OURS, linewidth=0.6)
    left.set(xlabel="time (s)", ylabel="acceleration (m/s²)", xlim=(0, x.size / FS))
    tap = recording.phases.taps[-1]
    begin, end = tap.start - round(0.03 * FS), tap.end
    t = 1e3 * (np.arange(begin, end) - tap.impact) / FS
    right.semilogy(t, np.maximum(np.abs(x[begin:end]), 1e-3), color=INK, linewidth=0.7)
    bounds = 1e3 * (np.array([begin, tap.start, tap.impact, end]) - tap.impact) / FS
    titles = ("noise", "hand", "impact and decay")
    for low, high, title, colour in zip(bounds[:-1], bounds[1:], titles, (FAINT, OTHER, OURS), strict=True):
        right.axvspan(low, high, color=colour, alpha=0.3, linewidth=0, label=title)
    right.set(xlabel="time since contact (ms)", ylabel="magnitude (m/s²)", xlim=(bounds[0], bounds[-1]))
    legend_above(figure, right)
    return figure


def draw_mfcc(view: PhaseView, width: float) -> Drawing:
    """Figure 6: modified MFCC of one frame of 25 ms.

    From left to right: frame and Hamming window, power spectrum and mel filters up to 1400 Hz, energies of
    the 20 filters, and the 13 coefficients. Filled bars: the five coefficients of Table I.
    """
    figure, (row,) = panels(width, 1, 4, 2.2)
    n = view.n_samples
    window = signal.get_window("hamming", n)
    t = 1e3 * np.arange(n) / view.fs
    row[0].plot(t, view.samples, color=OURS, linewidth=1)
    row[0].plot(t, window * np.abs(view.samples).max(), color=OTHER, linewidth=1)
    row[0].set(title="frame and window", xlabel="time (ms)", ylabel="acceleration (m/s²)")
    n_fft = 1024
    f = np.arange(n_fft // 2 + 1) * view.fs / n_fft
    power = np.abs(fft.rfft(window * view.samples, n_fft)) ** 2
    row[1].plot(f, mel_filters(view.fs, n_fft, 20, 0.0, 1400.0, np.inf), color=FAINT, linewidth=0.8)
    row[1].plot(f, power / power.max(), color=OURS, linewidth=1.2)
    row[1].set(title="power spectrum", xlabel="frequency (Hz)", ylabel="relative", xlim=(0, 1500))
    energies = log_energies(view, 20, 0.0, 1400.0, np.inf, 0.025, 0.015)[0]
    row[2].bar(np.arange(1, 21), energies - energies.min(), color=OURS)
    row[2].set(title="log energies", xlabel="mel filter", ylabel="ln, from the smallest")
    c = mfcc(view)
    is_used = np.isin(np.arange(1, 14), (2, 5, 6, 8, 12))
    row[3].bar(np.arange(1, 14), c, color=np.where(is_used, OURS, FAINT))
    row[3].axhline(0, color=MUTED, linewidth=0.8)
    row[3].set(title="coefficients", xlabel="number", ylabel="value")
    return figure


def draw_lines(axes: Axes, values: pd.DataFrame, column: str, names: Sequence[str], x: Any) -> None:
    """Draw a feature along a run, one line per surface."""
    for name, (colour, mark) in zip(names, LOOKS, strict=False):
        y = values.loc[values["surface"] == name, column]
        axes.plot(x, y, f"{mark}-", color=colour, markersize=4, linewidth=1.2, label=name)


def draw_hardness(
    taps: pd.DataFrame, names: Sequence[str], plates: pd.DataFrame | None, width: float
) -> Drawing:
    """Figure 8: hardness and damping against impact velocity.

    Hardness scatters from tap to tap, and separates soft from hard surfaces. The spectral centroid of a tap
    separates all of them. Right: real taps on five plates (`taps5`), one dot per tap.
    """
    figure, (row,) = panels(width, 1, 3 if plates is None else 4, 2.5)
    speeds = np.linspace(*study.TAP_SPEEDS_MM_S, study.N_TAPS)
    columns = {
        "hardness": "H, eq. 1 (log10)",
        "hardness_corrected": "H, corrected (log10)",
        "damping": "SC, eq. 2 (log10 bin)",
    }
    for axes, (column, title) in zip(row[:3], columns.items(), strict=True):
        draw_lines(axes, taps, column, names, speeds)
        axes.set(title=title, xlabel="speed of the hand (mm/s)")
    if plates is not None:
        order = plates.groupby("surface")["damping"].median().sort_values().index
        for y, name in enumerate(order):
            x = plates.loc[plates["surface"] == name, "damping"]
            row[3].plot(x, y + np.linspace(-0.25, 0.25, x.size), "o", color=OURS, markersize=2.5)
        row[3].set_yticks(range(len(order)), order)
        row[3].set(title="SC of real taps", xlabel="log10 DCT bin")
    legend_above(figure, row[0])
    return figure


def draw_two_roughnesses(runs: pd.DataFrame, name: str, width: float) -> Drawing:
    """Figure 9: two definitions of roughness under rising force.

    Left and middle: one surface, relative to the largest value, as in the paper. Right: variance of eq. 3
    divided by that of the roughness of [7], in log10 levels, one mark per surface. With the sensor of the
    paper, d_1 of eq. 3 lies above its band, and mostly contains noise of constant level.
    """
    figure, (row,) = panels(width, 1, 3, 2.6)
    titles = {"force": "sensor of the paper", "force, wide band": "sensor with a band of 5 kHz"}
    labels = {
        "standard_roughness": ("roughness of [7]", "o", INK),
        "temporal_roughness": ("temporal roughness, eq. 3", "x", OURS),
    }
    for axes, (run, title) in zip(row, titles.items(), strict=False):
        values = runs[(runs["surface"] == name) & (runs["run"] == run)]
        for column, (label, mark, colour) in labels.items():
            amplitude = 10 ** values[column]
            y = amplitude**2 if column == "standard_roughness" else amplitude
            axes.plot(values["step"] + 1, y / y.max(), mark, color=colour, markersize=7, fillstyle="none",
                      label=label)  # fmt: skip
        axes.set(title=f"{name}, {title}", xlabel="frame of 1 s at rising force", ylim=(0, 1.05))
    row[0].set_ylabel("relative to the largest")
    for (run, title), (colour, mark) in zip(titles.items(), LOOKS, strict=False):
        ratios = np.sort(study.variance_ratios(runs, run))
        row[2].plot(np.arange(1, ratios.size + 1), ratios, mark, color=colour, markersize=4, label=title)
    row[2].axhline(1, color=MUTED, linewidth=1)
    row[2].set(title="ratio of the variances", xlabel="surface, sorted", yscale="log")
    row[2].legend(loc="lower right", fontsize=7)
    legend_above(figure, row[0])
    return figure


def draw_roughness(runs: pd.DataFrame, names: Sequence[str], width: float) -> Drawing:
    """Figure 10: roughness of several surfaces under rising force.

    As printed, the temporal roughness is the same for most surfaces: the noise of the sensor. In bands within
    the range of the sensor, it separates them, as the spectral roughness does.
    """
    figure, (row,) = panels(width, 1, 3, 2.5)
    force = np.linspace(0.4, 2.5, study.N_STEPS)
    columns = {
        "temporal_roughness": "TR, eq. 3 as printed",
        "temporal_roughness_corrected": "TR, 150-300 and 500-1000 Hz",
        "spectral_roughness": "SR, eq. 4",
    }
    rising = runs[runs["run"] == "force"]
    for axes, (column, title) in zip(row, columns.items(), strict=True):
        draw_lines(axes, rising, column, names, force)
        axes.set(title=title, xlabel="force (N)")
    row[0].set_ylabel("log10 level")
    row[1].sharey(row[0])
    legend_above(figure, row[0])
    return figure


def draw_macroscopic(view: PhaseView, features: pd.DataFrame, width: float) -> Drawing:
    """Figure 11: waviness, spikiness and regularity, and the heights that they measure.

    Above: the quantities of eqs 5 to 7 for a surface with bumps. Below: means of the features over repeated
    runs of one surface to which bumps or a grating are added. A grating without spikes has a low spikiness.
    """
    figure, (above, below) = panels(width, 2, 3, 2.4)
    slow, factor = low_passed(view, 100.0)
    x, frame = slow * level(view), 200 // factor
    t = np.arange(x.size) * factor / FS
    m = np.abs(x[: x.size // frame * frame]).reshape(-1, frame).mean(axis=1)
    frames = 0.02 * np.arange(m.size)
    above[0].plot(frames, m, color=OURS, linewidth=1, label="m")
    above[0].plot(frames, moving_average(m, 100), color=OTHER, label="moving average")
    above[0].set(title="frame means (eq. 5)", xlabel="time (s)", ylabel="m/s²")
    threshold = 2 * x.std() + x.mean() + moving_average(x, 5000 // factor)
    shown = slice(0, 2 * FS // factor)
    above[1].plot(t[shown], x[shown], color=FAINT, linewidth=0.8, label="x below 100 Hz")
    above[1].plot(t[shown], np.where(x > threshold, x, np.nan)[shown], color=OURS, label="excess")
    above[1].plot(t[shown], threshold[shown], color=OTHER, linewidth=1, label="threshold")
    above[1].set(title="spikes (eq. 6)", xlabel="time (s)", ylabel="m/s²")
    y = view.samples[:FS] / np.ptp(view.samples[:FS])
    r = signal.correlate(y, y, method="fft")[y.size - 1 :][:600]
    lag = 1e3 * np.arange(r.size) / FS
    above[2].plot(lag, r, color=FAINT, label="autocorrelation")
    rising = np.r_[False, np.diff(r) > 0]
    above[2].plot(lag, np.where(rising, r, np.nan), color=OURS, label="rising")
    above[2].set(title="autocorrelation (eq. 7)", xlabel="lag (ms)", ylabel="r")
    for axes in above:
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.4 * (high - low))
        axes.legend(loc="upper right", fontsize=7)
    looks = {"bumps": (OURS, "o"), "grating": (OTHER, "s")}
    for axes, column in zip(below, study.MACROSCOPIC, strict=True):
        for kind, (colour, mark) in looks.items():
            mean = features[features["kind"] == kind].groupby("height")[column].mean()
            axes.plot(mean.index, mean, f"{mark}-", color=colour, markersize=4, label=kind)
        unit = "value" if column == "regularity" else "log10(m/s²)"
        axes.set(title=column, xlabel="height or depth (µm)", ylabel=unit)
    below[0].legend()
    return figure


def draw_fineness(
    runs: pd.DataFrame, names: Sequence[str], fabrics: pd.DataFrame | None, width: float
) -> Drawing:
    """Figure 12: fineness against velocity.

    Left: simulated surfaces. Other panels: real recordings of a finger on four fabrics (`fabric_speeds`) at
    20, 30, 50 and 60 mm/s, with the printed sum of eq. 2 and with the centroid below 600 Hz of [7].
    """
    figure, (row,) = panels(width, 1, 1 if fabrics is None else 3, 2.6)
    speed = runs[runs["run"] == "speed"].assign(bin=10 ** runs["fineness"])
    draw_lines(row[0], speed, "bin", names, np.linspace(20, 200, study.N_STEPS))
    row[0].set(title="simulated, eq. 2 (DCT bin)", xlabel="speed (mm/s)", ylim=(0, None))
    row[0].legend(loc="lower right", fontsize=7)
    if fabrics is not None:
        titles = {"fineness": "fabrics, eq. 2 (DCT bin)", "below 600 Hz": "fabrics, below 600 Hz (Hz)"}
        for axes, (column, title) in zip(row[1:], titles.items(), strict=True):
            for (name, rows), (colour, mark) in zip(fabrics.groupby("surface"), LOOKS, strict=True):
                ordered = rows.sort_values("step")
                axes.plot(
                    ordered["step"], ordered[column], f"{mark}-", color=colour, markersize=4, label=name
                )
            axes.set(title=title, xlabel="speed, slowest to fastest", xticks=range(1, 5), ylim=(0, None))
        row[1].legend(loc="lower right", fontsize=7)
    return figure


def draw_friction(
    recordings: Mapping[str, Recording], runs: pd.DataFrame, truth: Mapping[str, float], width: float
) -> Drawing:
    """Figure 13: voltage of the bridge, and the friction feature.

    Left: voltage during freehand strokes on three surfaces, with their coefficients of kinetic friction.
    Right: Fr at 1 N and rising speed against the true coefficient, one dot per surface.
    """
    figure, (row,) = panels(width, 1, 2, 2.6, width_ratios=(1.5, 1))
    for (name, recording), (colour, _) in zip(recordings.items(), LOOKS, strict=False):
        start, stop = recording.phases.movement
        v = recording.friction[start:stop][: 3 * FS : 10]
        row[0].plot(np.arange(v.size) / 1000, v, color=colour, linewidth=1, label=name)
    row[0].set(title="voltage of the bridge", xlabel="time (s)", ylabel="V")
    means = 10 ** runs[runs["run"] == "speed"].groupby("surface")["friction"].mean()
    row[1].plot([truth[name] for name in means.index], means, "o", color=OURS, markersize=5)
    row[1].set(
        title="Fr, eq. 8 (V)", xlabel="coefficient of kinetic friction", xlim=(0, None), ylim=(0, None)
    )
    legend_above(figure, row[0])
    return figure


def draw_table(summary: pd.DataFrame, width: float) -> Drawing:
    """Table I: published accuracies and ours.

    Circles: published, 69 real surfaces. Dots with 95 % intervals: ours, 69 simulated surfaces, mean over ten
    seeds.
    """
    names = list(summary["row"].unique())
    figure, (row,) = panels(width, 1, 3, 0.27 * len(names) + 0.6, sharey=True)
    for axes, (classifier, title) in zip(row, CLASSIFIERS.items(), strict=True):
        values = summary[summary["classifier"] == classifier]
        y = np.arange(len(names))
        error = 100 * np.abs(values[["low", "high"]].to_numpy().T - values["mean"].to_numpy())
        axes.plot(100 * values["published"], y, "o", color=INK, fillstyle="none", label="published")
        axes.errorbar(100 * values["mean"], y, xerr=error, fmt="o", color=OURS, markersize=4, label="ours")
        axes.set(title=title, xlabel="accuracy (%)", xlim=(0, 100))
    label_rows(row[0], [name.replace("Modified MFCC, ", "MFCC, ") for name in names], "accuracy (%)")
    legend_above(figure, row[0])
    return figure
