"""Figure of one recording: signal, phases, one tap, spectrogram and feature values."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import signal

from texclass.evaluation.result_facts import main_direction, signal_envelope
from texclass.phases import find_phases
from texclass.recording import Phases, Recording, Samples
from texclass.reporting.figure_style import shorten_middle
from texclass.reporting.wording import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {
    "hand": "#56B4E9",
    "impact": "#D55E00",
    "decay": "#E69F00",
    "movement": "#009E73",
    "signal": "#333333",
}
"""Palette of Okabe and Ito, whose colours remain distinguishable with common forms of colour blindness."""
MAX_POINTS = 4000
"""Number of samples above which the envelope is drawn instead of the signal, to keep files small."""
MAX_VALUES = 40
"""Largest number of feature values in the figure."""
LEGEND: Any = {
    "loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "fontsize": 8, "frameon": False,
    "handlelength": 1.2, "columnspacing": 1.2,
}  # fmt: skip
"""Arguments that place a legend above the axes, where it does not cover data."""


def inspect_recording(recording: Recording, features: str | Path) -> tuple["Figure", Phases]:
    """Find the phases of a recording, compute its features, and draw them with `draw_inspection`.

    Parameters
    ----------
    recording : Recording
        Recording to inspect.
    features : str or Path
        Name of a shipped feature set, or path of a TOML file that defines one.

    Returns
    -------
    figure : matplotlib.figure.Figure
        The figure.
    phases : Phases
        Phases of the recording.
    """
    from texclass.features import FeatureExtractor, load_feature_set

    phases, feature_set = find_phases(recording), load_feature_set(features)
    recordings = [recording.with_(phases=phases)]
    extracted = FeatureExtractor(feature_set).fit(recordings).extract(recordings)
    values = dict(zip(extracted.columns, extracted.values[0], strict=True))
    return draw_inspection(recording, phases, values, feature_set.units), phases


def draw_inspection(
    recording: Recording,
    phases: Phases,
    feature_values: Mapping[str, float] | None,
    units: Mapping[str, str] | None = None,
) -> "Figure":
    """Draw signal, phases, one tap, spectrogram and feature values of a recording.

    Parameters
    ----------
    recording : Recording
        Recording to draw. If it has several axes, they are projected on the direction of the largest changes.
        DFT321 is not used, because it mixes the phases of the axes and thereby blurs the contact.
    phases : Phases
        Phases of the recording.
    feature_values : mapping of str to float, optional
        Feature values; NaN is shown as "undefined". At most 40 are shown.
    units : mapping of str to str, optional
        Units of the feature values for recordings in m/s^2. In the figure, the unit of the recording replaces
        m/s^2.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    samples, n = main_direction(recording), len(phases.taps)
    facts = [
        recording.surface or "surface unknown",
        recording.recording_id,
        f"fs {recording.fs:g} Hz",
        f"{recording.duration_s:.3g} s",
        f"{phases.kind} ({counted(n, 'tap')})" if n else phases.kind,
    ]
    with mpl.rc_context({"text.parse_math": False}):
        figure = Figure(figsize=(14, 8.5), layout="constrained")
        remarks = [f"note: {remark}" for remark in (*recording.flags, *phases.notes)]
        figure.suptitle("\n".join(["  |  ".join(facts), *remarks[:3]]), fontsize=12)
        ((signal_part, value_part),) = figure.subfigures(1, 2, squeeze=False, width_ratios=[2.4, 1.0])
        signal_axes, spectrogram_axes = signal_part.subplots(2, 1, sharex=True)
        draw_signal(signal_axes, samples, recording, phases)
        _draw_spectrogram(spectrogram_axes, samples, recording)
        tap_axes, value_axes = value_part.subplots(2, 1, height_ratios=[1.0, 1.9])
        _draw_tap(tap_axes, samples, recording, phases)
        value_units = {name: unit.replace("m/s^2", recording.unit) for name, unit in (units or {}).items()}
        _draw_values(value_axes, feature_values, value_units)
    return figure


def draw_signal(axes: "Axes", samples: Samples, recording: Recording, phases: Phases) -> None:
    """Draw the samples of a recording in one direction, with taps, movement and a legend."""
    fs, n = recording.fs, samples.size
    if n <= MAX_POINTS:
        axes.plot(np.arange(n) / fs, samples, color=COLOURS["signal"], linewidth=0.9, label="signal")
    else:
        low, high = signal_envelope(samples, MAX_POINTS)
        times = (np.arange(low.size) + 0.5) * (n // MAX_POINTS) / fs
        axes.fill_between(times, low, high, color=COLOURS["signal"], linewidth=0.5, label="signal")
    spans = [] if phases.movement is None else [(*phases.movement, "movement", 0.22)]
    for tap in phases.taps:
        spans += [(tap.start, tap.impact, "hand", 0.45), (tap.impact, tap.end, "decay", 0.6)]
        axes.axvline(tap.impact / fs, color=COLOURS["impact"], linewidth=0.8)
    for i, (start, stop, what, alpha) in enumerate(spans):
        label = {"decay": "impact, decay"}.get(what, what)
        is_in_legend = what in [span[2] for span in spans[:i]]  # one legend entry for all taps
        label = f"_{label}" if is_in_legend else label
        axes.axvspan(start / fs, stop / fs, color=COLOURS[what], alpha=alpha, label=label)
    if phases.onset is not None:
        axes.axvline(phases.onset / fs, color=COLOURS["movement"], linestyle="--", label="onset of sliding")
    if phases.taps:
        impacts = [tap.impact / fs for tap in phases.taps]
        top = [1.02 * float(np.abs(samples).max())] * len(impacts)
        axes.plot(impacts, top, "v", color=COLOURS["impact"], clip_on=False, label="tap")
    axes.set(xlim=(0.0, recording.duration_s), xlabel="time (s)", ylabel=f"acceleration ({_unit(recording)})")
    axes.tick_params(labelbottom=True)
    axes.set_title("Signal and phases", fontsize=10, loc="left")
    axes.legend(ncols=6, **LEGEND)


def _draw_spectrogram(axes: "Axes", samples: Samples, recording: Recording) -> None:
    fs, n = recording.fs, samples.size
    axes.set_title("Spectrogram", fontsize=10, loc="left")
    axes.set(xlabel="time (s)", ylabel="frequency (Hz)")
    axes.grid(visible=False)
    length = min(n, max(128, round(0.0256 * fs)))
    if length < 8:
        axes.text(0.5, 0.5, "too short", transform=axes.transAxes, ha="center")
        return
    hop = max(length // 4, n // 1500, 1)
    transform = signal.ShortTimeFFT(signal.windows.hann(length, sym=False), hop, fs, scale_to="psd")
    power = transform.spectrogram(samples)
    decibel = 10.0 * np.log10(np.maximum(power, 1e-10 * max(float(power.max()), 1e-300)))
    top = float(np.quantile(decibel, 0.999))
    image = axes.imshow(
        decibel, origin="lower", aspect="auto", cmap="cividis", vmin=top - 70.0, vmax=top,
        extent=transform.extent(n), interpolation="nearest",
    )  # fmt: skip
    axes.set(xlim=(0.0, recording.duration_s), ylim=(0.0, fs / 2))
    label = f"dB re ({_unit(recording)})²/Hz"
    axes.figure.colorbar(image, ax=axes, location="bottom", shrink=0.5, aspect=40, pad=0.02, label=label)


def _draw_tap(axes: "Axes", samples: Samples, recording: Recording, phases: Phases) -> None:
    """Draw the tap with the median peak."""
    if not phases.taps:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no tap in this recording", transform=axes.transAxes, ha="center", color="0.4")
        return
    peaks = [float(np.abs(samples[tap.impact : tap.end]).max()) for tap in phases.taps]
    index = int(np.argsort(peaks)[len(peaks) // 2])
    tap, to_ms = phases.taps[index], 1e3 / recording.fs
    margin = round(0.3 * (tap.end - tap.start)) + 1
    indices = np.arange(max(0, tap.start - margin), min(samples.size, tap.end + margin))
    axes.plot((indices - tap.impact) * to_ms, samples[indices], color=COLOURS["signal"], lw=0.9)
    for what, start, stop in (("hand", tap.start, tap.impact), ("decay", tap.impact, tap.end)):
        ends = (start - tap.impact) * to_ms, (stop - tap.impact) * to_ms
        label = {"decay": "impact, decay"}.get(what, what)
        axes.axvspan(*ends, color=COLOURS[what], alpha=0.4, label=label)
    axes.axvline(0.0, color=COLOURS["impact"], lw=1.5, label="contact")
    axes.set(xlabel="time after contact (ms)", ylabel=f"acceleration ({_unit(recording)})")
    axes.set_title(f"Tap {index + 1} of {len(phases.taps)}", fontsize=10, loc="left")
    axes.legend(ncols=3, **LEGEND)


def _draw_values(axes: "Axes", values: Mapping[str, float] | None, units: Mapping[str, str]) -> None:
    axes.set_axis_off()
    axes.set_title("Features", fontsize=10, loc="left")
    if not values:
        axes.text(0.5, 0.5, "no feature values", transform=axes.transAxes, ha="center", color="0.4")
        return
    lines = [
        (name, f"{values[name]:.4g}" if np.isfinite(values[name]) else "undefined", units.get(name, ""))
        for name in sorted(values, key=lambda name: "." in name)[:MAX_VALUES]  # scalars first
    ]
    if len(values) > MAX_VALUES:
        lines[-1] = ("...", f"and {len(values) - MAX_VALUES + 1} more", "")
    n_rows = max(20, len(lines))
    style: dict[str, Any] = {"transform": axes.transAxes, "fontsize": 7, "family": "monospace"}
    for i, (name, text, unit) in enumerate(lines):
        height = 1.0 - (i + 0.8) / n_rows
        axes.text(0.0, height, shorten_middle(name, 32), **style)
        axes.text(0.68, height, text, ha="right", **style)
        # The unit "1" of ratios is not shown.
        axes.text(0.7, height, "" if unit == "1" else unit.replace("^2", "²"), **style)


def _unit(recording: Recording) -> str:
    return recording.unit.replace("^2", "²")
