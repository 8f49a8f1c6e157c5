"""A picture of one recording that is understood at a glance."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import signal

from texclass.recording import Phases, Recording, Samples, Tap

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
"""Okabe and Ito's colours, told apart with every common kind of colour vision."""
_MAX_POINTS = 4000
_MAX_FEATURES = 40


def draw_inspection(
    recording: Recording, phases: Phases, feature_values: Mapping[str, float] | None, path: str | Path
) -> None:
    """Draw signal, phases, one tap, spectrogram and feature values of a recording.

    Parameters
    ----------
    recording : Recording
        Of any number of axes, unit and rate; several axes are shown along the direction in which they vary
        most (DFT321 mixes the phases of the axes and would blur the contact).
    phases : Phases
        Its phases.
    feature_values : mapping of str to float, optional
        What the table shows; NaN is shown as "undefined". Beyond 40 values the rest is counted.
    path : str or Path
        Where the picture goes; its suffix chooses the format (PNG at 130 dots per inch).
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 8.5), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(_title(recording, phases), fontsize=12)
    grid = figure.add_gridspec(2, 2, width_ratios=[2.6, 1.0], height_ratios=[1.0, 1.0])
    samples = _main_direction(recording.acceleration, recording.fs)
    time_axes = figure.add_subplot(grid[0, 0])
    _draw_signal(time_axes, samples, recording, phases)
    _draw_spectrogram(figure, figure.add_subplot(grid[1, 0], sharex=time_axes), samples, recording)
    _draw_tap(figure.add_subplot(grid[0, 1]), samples, recording, phases)
    _draw_table(figure.add_subplot(grid[1, 1]), feature_values)
    figure.savefig(path, dpi=130)


def _title(recording: Recording, phases: Phases) -> str:
    counted = f"{len(phases.taps)} tap{'s' * (len(phases.taps) != 1)}"
    kind = f"{phases.kind} ({counted})" if phases.taps else phases.kind
    facts = [
        recording.material or "material unknown",
        recording.recording_id,
        f"fs {recording.fs:g} Hz",
        f"{recording.duration_s:.3g} s",
        kind,
    ]
    remarks = [*recording.flags, *phases.notes]
    return "\n".join([_plain("  |  ".join(facts)), *(_plain(f"note: {remark}") for remark in remarks[:3])])


def _draw_signal(axes: "Axes", samples: Samples, recording: Recording, phases: Phases) -> None:
    fs = recording.fs
    if samples.size <= _MAX_POINTS:
        axes.plot(
            np.arange(samples.size) / fs, samples, color=COLOURS["signal"], linewidth=0.9, label="signal"
        )
    else:
        axes.fill_between(*_envelope(samples, fs), color=COLOURS["signal"], linewidth=0.5, label="signal")
    if phases.movement is not None:
        first, last = phases.movement
        axes.axvspan(first / fs, last / fs, color=COLOURS["movement"], alpha=0.22, label="movement")
    for i, tap in enumerate(phases.taps):
        mute = "_" * (i > 0)  # one entry of the legend for all taps
        axes.axvspan(tap.start / fs, tap.impact / fs, color=COLOURS["hand"], alpha=0.45, label=f"{mute}hand")
        axes.axvspan(
            tap.impact / fs, tap.end / fs, color=COLOURS["decay"], alpha=0.6, label=f"{mute}impact, decay"
        )
        axes.axvline(tap.impact / fs, color=COLOURS["impact"], linewidth=0.8)
    if phases.onset is not None:
        axes.axvline(phases.onset / fs, color=COLOURS["movement"], linestyle="--", label="onset of sliding")
    if phases.taps:
        top = 1.02 * float(np.abs(samples).max())
        axes.plot(
            [t.impact / fs for t in phases.taps],
            [top] * len(phases.taps),
            "v",
            color=COLOURS["impact"],
            clip_on=False,
            label="tap",
        )
    axes.set_xlim(0.0, recording.duration_s)
    axes.set_ylabel(f"acceleration ({_unit(recording)})")
    axes.set_xlabel("time (s)")
    axes.set_title("Signal and phases", fontsize=10)
    axes.legend(loc="lower right", ncols=6, fontsize=8)


def _draw_spectrogram(figure: "Figure", axes: "Axes", samples: Samples, recording: Recording) -> None:
    axes.set_title("Spectrogram", fontsize=10)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("frequency (Hz)")
    length = min(samples.size, max(128, round(0.0256 * recording.fs)))
    if length < 8:
        axes.text(0.5, 0.5, "too short", transform=axes.transAxes, ha="center")
        return
    hop = max(length // 4, samples.size // 1500, 1)
    transform = signal.ShortTimeFFT(signal.windows.hann(length, sym=False), hop, recording.fs, scale_to="psd")
    power = transform.spectrogram(samples)
    decibel = 10.0 * np.log10(np.maximum(power, 1e-10 * max(float(power.max()), 1e-300)))
    top = float(np.quantile(decibel, 0.999))
    image = axes.imshow(
        decibel,
        origin="lower",
        aspect="auto",
        cmap="cividis",
        vmin=top - 70.0,
        vmax=top,
        extent=transform.extent(samples.size),
        interpolation="nearest",
    )
    axes.set_xlim(0.0, recording.duration_s)
    axes.set_ylim(0.0, recording.fs / 2)
    figure.colorbar(
        image,
        ax=axes,
        location="bottom",
        shrink=0.5,
        aspect=40,
        pad=0.02,
        label=f"dB re ({_unit(recording)})²/Hz",
    )


def _draw_tap(axes: "Axes", samples: Samples, recording: Recording, phases: Phases) -> None:
    if not phases.taps:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no tap in this recording", transform=axes.transAxes, ha="center", color="0.4")
        return
    number, tap = _clearest(phases.taps, samples)
    margin = round(0.3 * (tap.end - tap.start)) + 1
    first, last = max(0, tap.start - margin), min(samples.size, tap.end + margin)
    to_ms = 1e3 / recording.fs
    axes.plot(
        (np.arange(first, last) - tap.impact) * to_ms, samples[first:last], color=COLOURS["signal"], lw=0.9
    )
    parts = {"hand": (tap.start, tap.impact), "decay": (tap.impact, tap.end)}
    for name, (start, stop) in parts.items():
        axes.axvspan(
            (start - tap.impact) * to_ms,
            (stop - tap.impact) * to_ms,
            color=COLOURS[name],
            alpha=0.4,
            label="hand" if name == "hand" else "impact, decay",
        )
    axes.axvline(0.0, color=COLOURS["impact"], lw=1.5, label="contact")
    axes.set_xlabel("time after contact (ms)")
    axes.set_ylabel(_unit(recording))
    axes.set_title(f"Tap {number} of {len(phases.taps)}", fontsize=10)
    axes.legend(loc="best", fontsize=8)


def _draw_table(axes: "Axes", values: Mapping[str, float] | None) -> None:
    axes.set_axis_off()
    axes.set_title("Features", fontsize=10)
    if not values:
        axes.text(0.5, 0.5, "no feature values", transform=axes.transAxes, ha="center", color="0.4")
        return
    scalars_first = sorted(values, key=lambda name: "." in name)
    shown = [(name, _number(values[name])) for name in scalars_first[:_MAX_FEATURES]]
    if len(values) > _MAX_FEATURES:
        shown[-1] = ("...", f"and {len(values) - _MAX_FEATURES + 1} more")
    n_rows = max(12, -(-len(shown) // 2)) if len(shown) > 20 else max(12, len(shown))
    for i, (name, text) in enumerate(shown):
        column, row = divmod(i, n_rows)
        width = 0.5 if len(shown) > n_rows else 1.0
        height = 1.0 - (row + 0.8) / n_rows
        place: dict[str, Any] = {
            "transform": axes.transAxes,
            "fontsize": 8 if width == 1.0 else 6.5,
            "family": "monospace",
        }
        axes.text(column * 0.52, height, _short(name, 26 if width == 1.0 else 17), **place)
        axes.text(column * 0.52 + width * 0.96, height, text, ha="right", **place)


def _main_direction(acceleration: Samples, fs: float) -> Samples:
    """Project the axes, without their means, on the direction in which they change most."""
    axes = acceleration.reshape(len(acceleration), -1)
    axes = axes - axes.mean(axis=0)
    if axes.shape[1] == 1:
        return np.asarray(axes[:, 0])
    lag = max(1, round(2e-3 * fs))  # slow against noise, fast against gravity
    steps = axes[lag:] - axes[:-lag]
    direction = np.linalg.eigh(steps.T @ steps)[1][:, -1]
    return np.asarray(axes @ (direction * np.sign(direction[np.argmax(np.abs(direction))])))


def _envelope(samples: Samples, fs: float) -> tuple[Samples, Samples, Samples]:
    """Least and greatest sample of so many blocks that a picture can show; each block touches the next."""
    size = max(1, samples.size // _MAX_POINTS)
    n = samples.size // size
    blocks = samples[: n * size].reshape(n, size)
    low, high = blocks.min(axis=1), blocks.max(axis=1)
    low[1:], high[1:] = np.minimum(low[1:], blocks[:-1, -1]), np.maximum(high[1:], blocks[:-1, -1])
    return np.asarray((np.arange(n) + 0.5) * size / fs, dtype=np.float64), low, high


def _clearest(taps: Sequence[Tap], samples: Samples) -> tuple[int, Tap]:
    """Return the tap of median strength, with its number."""
    peaks = [float(np.abs(samples[tap.impact : tap.end]).max()) for tap in taps]
    index = int(np.argsort(peaks)[len(peaks) // 2])
    return index + 1, taps[index]


def _unit(recording: Recording) -> str:
    return {"m/s^2": "m/s²"}.get(recording.unit, recording.unit)


def _number(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "undefined"


def _short(name: str, length: int) -> str:
    """Cut a long name in its middle: the end tells the outputs of one feature apart."""
    return _plain(name if len(name) <= length else f"{name[: length - 6]}…{name[-5:]}")


def _plain(text: str) -> str:
    """Keep matplotlib from reading mathematics into a name."""
    return text.replace("$", r"\$")
