"""The figures of the report on `oeztuerk2018`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft, signal

from texclass.recording import Samples
from texclass.reporting.figures import FAINT, INK, OURS, PAPER
from texclass.textures.oeztuerk2018 import fit_frequencies, fit_lpc
from texclass.textures.oeztuerk2018.intervals import BIN_MM_S
from texclass.textures.oeztuerk2018.simulated import stroking_speeds
from texclass.textures.oeztuerk2018.study import COUNTS, FRICTIONS, SPEEDS_MM_S, Study
from texclass.vibration import MajorFrequencies, fit, fit_major_frequencies, synthesize

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KEY = "oeztuerk2018"
FS = 10_000.0
ORDER, SHOWN_HZ = 400, 1000.0
GREEN = "#2e7d4f"


def draw(
    result: Study,
    excerpts: Mapping[str, Samples],
    speeds: Mapping[str, Sequence[Samples]],
    wood: str,
    out: Path,
    seed: int,
) -> list[Path]:
    """Draw all figures into a folder and return the files."""
    x = next((v for k, v in excerpts.items() if k.startswith("CompressedWood")), speeds[wood][0])[:10_000]
    stone = next((v for k, v in excerpts.items() if k.startswith("Brick")), speeds[wood][-1])[:10_000]
    pictures = {
        "fig3-3": draw_lpc(stone, seed),
        "fig3-4": draw_beats(),
        "fig3-6": draw_frequencies(x),
        "fig3-9": draw_between(speeds[wood], wood),
        "fig4-1": draw_friction(seed),
        "fig4-2": draw_speeds(result, seed),
        "predicted": draw_predicted(speeds, wood, seed),
    }
    if result.orders:
        pictures["fig3-2"] = draw_orders(result)
        pictures["fig5-2"] = draw_counts(result)
    paths = []
    for name, picture in sorted(pictures.items()):
        paths.append(out / f"{KEY}-{name}.png")
        picture.savefig(paths[-1], dpi=120)
    return paths


def draw_orders(result: Study) -> "Figure":
    """Draw figure 3.2: spectral error against order."""
    figure, (left, right) = _panels(1, 2, (12, 4))
    for axes, key, title in (
        (left, "curve", "fitted and compared with the same recording"),
        (right, "other_half", "fitted to one half, compared with the other"),
    ):
        curves = np.array([getattr(o, key) for o in result.orders.values()])
        axes.plot(curves.T, color="0.7", linewidth=0.6)
        axes.plot(np.median(curves, axis=0), color=OURS, linewidth=2, label=f"median of {len(curves)}")
        axes.axvline(ORDER, color=PAPER, linestyle="--", label="order of the thesis, 400")
        axes.set_xscale("symlog", linthresh=1)
        axes.set(xlim=(0, 1000), ylim=(0, 1.3))
        _finish(axes, title, "order")
    left.set_ylabel("RMS spectral error, eq. (3.11)")
    left.legend(fontsize=9)
    return figure


def draw_lpc(x: Samples, seed: int) -> "Figure":
    """Draw figure 3.3: a recording and its LPC synthesis, in time and frequency."""
    sound = synthesize(fit(x, ORDER), x.size, np.random.default_rng(seed))
    return _time_and_spectrum([("recorded", x, INK), (f"LPC, order {ORDER}", sound, OURS)])


def draw_beats() -> "Figure":
    """Draw figures 3.4 and 3.5: two tones nearer than, at and beyond the beat threshold of Table 3.2."""
    figure, panels = _panels(1, 3, (12, 2.8))
    t = np.arange(round(0.6 * FS)) / FS
    for axes, difference in zip(panels, (3.0, 9.0, 30.0), strict=True):
        axes.plot(
            t, np.cos(2 * np.pi * 120 * t) + np.cos(2 * np.pi * (120 + difference) * t), color=OURS, lw=0.5
        )
        _finish(axes, f"120 Hz and {120 + difference:g} Hz (threshold 9 Hz)", "time (s)")
    return figure


def draw_frequencies(x: Samples) -> "Figure":
    """Draw figures 3.6 to 3.8: a recording, its 30 major frequencies, and what they make."""
    lines = fit_major_frequencies(x, FS, n_frequencies=30)
    made = lines.synthesize(x.size, FS, peak=float(np.abs(x).max()))
    figure = _time_and_spectrum([("recorded", x, INK), ("of 30 frequencies", made, OURS)])
    axes = figure.axes[1]
    f, A = _amplitudes(x)
    high = A[f <= SHOWN_HZ].max() / 2 < A
    axes.plot(f[high], A[high], ".", color=INK, ms=7, label="above half the largest")
    axes.plot(lines.frequency_hz, lines.amplitude, ".", color="#c00000", ms=6, label="30 selected")
    axes.legend(fontsize=9)
    return figure


def draw_between(signals: Sequence[Samples], name: str) -> "Figure":
    """Draw figure 3.9: frequencies at the slowest and fastest recording and between them."""
    ends = [signals[0], signals[-1]]
    texture = fit_frequencies(ends, (SPEEDS_MM_S[0], SPEEDS_MM_S[-1]), FS, n_frequencies=30)
    figure, rows = _panels(4, 2, (12, 8.5))
    titles = ("generated from the recording", "interpolated", "interpolated", "generated from the recording")
    for left, right, v, title in zip(rows[0::2], rows[1::2], SPEEDS_MM_S, titles, strict=True):
        model = texture.at(v)
        left.plot(np.arange(5000) / FS, model.synthesize(5000, FS), color=OURS, linewidth=0.6)
        _stems(right, model)
        _finish(left, f"{name} at {v:g} mm/s: {title}", "")
        _finish(right, "", "")
        right.set_xlim(0, SHOWN_HZ)
        left.set_ylabel("m/s²")
    rows[-2].set_xlabel("time (s)")
    rows[-1].set_xlabel("frequency (Hz)")
    return figure


def draw_friction(seed: int) -> "Figure":
    """Draw figure 4.1: simulated speeds against friction as boxes."""
    figure, (axes,) = _panels(1, 1, (7.5, 3.6))
    speeds = [stroking_speeds(mu, np.random.default_rng((seed, 0))) / 10 for mu in FRICTIONS]
    axes.boxplot(speeds, showmeans=True)
    axes.set_xticks(range(1, len(FRICTIONS) + 1), [f"{mu:g}" for mu in FRICTIONS])
    _finish(axes, "simulated speeds (triangles: means)", "friction coefficient")
    axes.set_ylabel("speed (cm/s)")
    return figure


def draw_speeds(result: Study, seed: int) -> "Figure":
    """Draw figure 4.2: histograms of simulated speeds."""
    figure, panels = _panels(2, 4, (12, 5))
    for axes, mu, row in zip(panels, FRICTIONS, result.intervals, strict=False):
        v = stroking_speeds(mu, np.random.default_rng((seed, 0)))
        edges = np.arange(0, v.max() + BIN_MM_S, BIN_MM_S) / 10
        axes.hist(v / 10, edges.tolist(), color=OURS, edgecolor="white")
        axes.axvline(row.published * BIN_MM_S / 10, color=PAPER, linestyle="--")
        _finish(axes, f"friction {mu:g}: {row.published} published", "speed (cm/s)")
    panels[-1].set_axis_off()
    text = "240 simulated speeds each.\nDashed: end of the last\ninterval the thesis counts."
    panels[-1].text(0, 0.6, text, fontsize=10)
    return figure


def draw_counts(result: Study) -> "Figure":
    """Draw the spectral counterpart of figure 5.2: goodness of fit against the number of frequencies."""
    figure, (axes,) = _panels(1, 1, (7.5, 4.2))
    curves = np.array([c.gfc for c in result.counts.values()])
    axes.plot(COUNTS, curves.T, color="0.7", linewidth=0.8)
    axes.plot(COUNTS, np.median(curves, axis=0), color=OURS, linewidth=2.2, label=f"median of {len(curves)}")
    axes.axhline(0.8, color=INK, linewidth=0.8, linestyle=":")
    axes.axhline(0.9, color=INK, linewidth=0.8, linestyle=":")
    axes.axvspan(9.4, 14, color=PAPER, alpha=0.2, label="published means of five materials (subjects)")
    axes.set(xlim=(2, 30), ylim=(None, 1))
    _finish(axes, "how many frequencies a spectrum needs", "number of frequencies")
    axes.set_ylabel("goodness of fit of the spectrum")
    axes.legend(fontsize=9, loc="lower right")
    return figure


def draw_predicted(speeds: Mapping[str, Sequence[Samples]], wood: str, seed: int) -> "Figure":
    """Draw recorded and predicted spectra of the speeds that were left out."""
    fabric = next((name for name in speeds if name.startswith("text24")), None)
    shown = [wood] if fabric is None else [wood, fabric]
    figure, panels = _panels(len(shown), 2, (12, 3.8 * len(shown)))
    for row, name in enumerate(shown):
        signals = speeds[name]
        v = SPEEDS_MM_S if name == wood else (1.0, 2.0, 3.0, 4.0)
        texture = fit_lpc([signals[0], signals[-1]], (v[0], v[-1]), FS, loudness="level")
        for i, axes in zip((1, 2), panels[2 * row : 2 * row + 2], strict=True):
            nearest, x = signals[0 if i == 1 else -1], signals[i]
            for label, y, colour, width in (
                ("recorded", x, INK, 1.6),
                ("LPC, log level", texture.signal(v[i], x.size, seed=seed), OURS, 1.1),
                ("nearest speed", nearest, PAPER, 0.9),
            ):
                f, P = signal.welch(y, FS, nperseg=1024)
                axes.semilogy(f, P, color=colour, linewidth=width, label=label)
            axes.set_xlim(0, 2000 if name == wood else 4000)
            what = f"{v[i]:g} mm/s (simulated)" if name == wood else f"speed v{i + 1} (fabric_speeds)"
            _finish(axes, f"{name} at {what}", "frequency (Hz)")
        panels[2 * row].set_ylabel("power density")
    panels[0].legend(fontsize=9)
    return figure


def _time_and_spectrum(rows: Sequence[tuple[str, Samples, str]]) -> "Figure":
    figure, panels = _panels(len(rows), 2, (12, 2.9 * len(rows)))
    for i, (title, x, colour) in enumerate(rows):
        left, right = panels[2 * i], panels[2 * i + 1]
        left.plot(np.arange(x.size) / FS, x, color=colour, linewidth=0.5)
        f, A = _amplitudes(x)
        right.plot(f, A, color=colour, linewidth=0.7)
        right.set_xlim(0, SHOWN_HZ)
        _finish(left, title, "time (s)")
        _finish(right, f"{title}: amplitude of each line", "frequency (Hz)")
    for column in (panels[0::2], panels[1::2]):
        top = max(axes.get_ylim()[1] for axes in column)
        bottom = min(axes.get_ylim()[0] for axes in column)
        for axes in column:
            axes.set_ylim(bottom, top)
    return figure


def _amplitudes(x: Samples) -> tuple[Samples, Samples]:
    return fft.rfftfreq(x.size, 1 / FS), np.abs(fft.rfft(x)) * 2 / x.size


def _stems(axes: "Axes", model: MajorFrequencies) -> None:
    axes.vlines(model.frequency_hz, 0, model.amplitude, color=OURS, linewidth=1.2)
    axes.plot(model.frequency_hz, model.amplitude, ".", color=OURS, ms=5)
    axes.set_ylim(0, None)


def _panels(n_rows: int, n_columns: int, size: tuple[float, float]) -> "tuple[Figure, list[Axes]]":
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    return figure, list(np.ravel(figure.subplots(n_rows, n_columns, squeeze=False)))


def _finish(axes: "Axes", title: str, x_label: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set_xlabel(x_label)
    axes.grid(color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
