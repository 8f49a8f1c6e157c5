"""The figures of the report on `okamura2001`."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy import signal

from texclass.reporting.figures import FAINT, INK, OURS, PAPER
from texclass.textures.okamura2001.factorial import DESIGN
from texclass.textures.okamura2001.simulated import FS, MATERIALS, TABLE_I, TABLE_II
from texclass.textures.okamura2001.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KEY = "okamura2001"


def draw(result: Study, out: Path) -> list[Path]:
    """Draw all figures into a folder and return the files."""
    pictures = {
        "fig1": draw_chain,
        "fig3": draw_tap,
        "fig4": draw_slopes,
        "fig5": draw_wall,
        "fig6": draw_device,
        "fig7": draw_ratings,
        "table3": draw_confusion,
    }
    if result.real:
        pictures["taps5"] = draw_real
    paths = []
    for name, picture in pictures.items():
        paths.append(out / f"{KEY}-{name}.png")
        picture(result).savefig(paths[-1], dpi=120)
    return paths


def draw_chain(result: Study) -> "Figure":
    """Draw figure 1: measured, modelled, scaled, chosen by people, and displayed, at 0.2 m/s."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 6), layout="constrained")
    grid = figure.subplots(3, 5)
    fs, rate = 20_000.0, result.device.cutoff_hz
    for row, m in zip(grid, MATERIALS, strict=True):
        one, found = result.examples[m]
        x = one.taps[np.argmin(np.abs(one.velocity - 0.2))]
        row[0].plot(1e3 * np.arange(x.size) / FS[m], x, color=INK, linewidth=0.8)
        models = (found.model, result.scaled[m], TABLE_II[m])
        for axes, model in zip(row[1:4], models, strict=True):
            n = round(5 / model.decay_per_s * fs)
            axes.plot(1e3 * np.arange(n) / fs, model.synthesize(0.2, n, fs), color=OURS, linewidth=1)
        felt = TABLE_II[m].synthesize(0.2, round(5 / TABLE_II[m].decay_per_s * fs), fs)
        shown = signal.sosfilt(signal.butter(2, rate, fs=fs, output="sos"), felt)
        row[4].plot(1e3 * np.arange(shown.size) / fs, shown, color=PAPER, linewidth=1)
        row[0].set_ylabel(f"{m}\n(m/s²)")
    titles = ("simulated tap", "model found", "scaled, our rule", "Table II", "as our device shows it")
    for axes, title in zip(grid[0], titles, strict=True):
        _finish(axes, title, "")
    for axes in grid[2]:
        _finish(axes, "", "time (ms)")
    for axes in grid[1]:
        _finish(axes, "", "")
    return figure


def draw_tap(result: Study) -> "Figure":
    """Draw figure 3: a simulated tap per material and the model found."""
    figure, panels = _panels(3, (12, 3.4))
    for axes, m in zip(panels, MATERIALS, strict=True):
        one, found = result.examples[m]
        x, fs = one.taps[-1], FS[m]
        t = (np.arange(x.size) - found.onset[-1]) / fs
        fine = np.linspace(0, t[-1], 1500)
        w, B = 2 * np.pi * found.model.frequency_hz, found.model.decay_per_s
        axes.plot(1e3 * t, x, color=OURS, linewidth=0.9, label="simulated tap")
        axes.plot(
            1e3 * fine,
            found.amplitude[-1] * np.exp(-B * fine) * np.sin(w * fine),
            "--", color=PAPER, linewidth=1.4, label="model found",
        )  # fmt: skip
        _finish(axes, f"{m} at 0.4 m/s", "time since impact (ms)")
    panels[0].set_ylabel("acceleration (m/s²)")
    panels[0].legend(fontsize=9, loc="upper right")
    return figure


def draw_slopes(result: Study) -> "Figure":
    """Draw figure 4: amplitude against measured velocity, and the line through the origin."""
    figure, panels = _panels(3, (12, 3.4))
    for axes, m in zip(panels, MATERIALS, strict=True):
        one, found = result.examples[m]
        v = np.linspace(0, 0.42, 2)
        axes.plot(1e3 * one.velocity, np.abs(found.amplitude), "o", color=OURS, ms=5, label="simulated taps")
        axes.plot(1e3 * v, np.abs(found.model.amplitude_slope) * v, color=PAPER, label="|A| v, fitted")
        A, truth = abs(found.model.amplitude_slope), abs(TABLE_I[m].amplitude_slope)
        text = f"|A| = {A:,.1f} 1/s\nTable I: {truth:,.1f}"
        axes.text(0.95, 0.06, f"{text}\nR² = {found.r_squared:.3f}", ha="right", transform=axes.transAxes)
        _finish(axes, m, "attack velocity (mm/s)")
        axes.set(xlim=(0, None), ylim=(0, None))
    panels[0].set_ylabel("amplitude (m/s²)")
    panels[0].legend(fontsize=9, loc="upper left")
    return figure


def draw_wall(result: Study) -> "Figure":
    """Draw figure 5: position, velocity and force of two taps on walls of the three materials."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 6.5), layout="constrained")
    grid = figure.subplots(3, 3, sharex=True, sharey="row")
    for column, m in zip(grid.T, MATERIALS, strict=True):
        trace = result.walls[m]
        t = 1e3 * trace.time_s
        column[0].plot(t, -trace.depth_mm, color=INK)
        column[0].axhspan(-3.4, 0, color=FAINT, zorder=0)
        column[1].plot(t, trace.velocity_mm_s, color=INK)
        column[2].plot(t, trace.force_n, color=OURS, linewidth=1, label="wall and vibration")
        column[2].plot(t, trace.spring_n, color=PAPER, linewidth=1, label="wall alone")
        column[2].axhline(result.device.limit_n, color=INK, linewidth=0.8, linestyle=":")
        _finish(column[0], f"{m} (Table II)", "")
        _finish(column[1], "", "")
        _finish(column[2], "", "time (ms)")
    grid[2, 0].legend(fontsize=9, loc="upper left")
    for axes, label in zip(grid[:, 0], ("height (mm)", "velocity (mm/s)", "force (N)"), strict=True):
        axes.set_ylabel(label)
    return figure


def draw_device(result: Study) -> "Figure":
    """Draw figure 6: the device's response (ours), and where the libraries lie in it."""
    figure, panels = _panels(2, (12, 3.8))
    f = np.geomspace(5, 2000, 300)
    panels[0].semilogx(f, result.device.response(f), color=INK)
    panels[0].axvspan(*result.device.band_hz, color=FAINT, zorder=0, label="band of the device")
    panels[0].axvline(250, color=INK, linestyle=":", linewidth=1, label="most sensitive (250 Hz)")
    _finish(panels[0], "response of our device (in the place of figure 6)", "frequency (Hz)")
    panels[0].set_ylabel("normalised magnitude")
    panels[0].legend(fontsize=9)
    for name, library, colour, marker in (
        ("measured, Table I", TABLE_I, INK, "o"),
        ("published, Table II", TABLE_II, PAPER, "D"),
        ("our rule", result.scaled, OURS, "s"),
    ):
        w = [library[m].frequency_hz for m in MATERIALS]
        B = [library[m].decay_per_s for m in MATERIALS]
        panels[1].loglog(w, B, marker, ls="-", lw=0.7, color=colour, label=name)
    for m in MATERIALS:
        at = (TABLE_I[m].frequency_hz, TABLE_I[m].decay_per_s)
        panels[1].annotate(m, at, (5, -12), textcoords="offset points", fontsize=9)
    panels[1].axvspan(*result.device.band_hz, color=FAINT, zorder=0)
    _finish(panels[1], "frequency and decay rate of the libraries", "frequency (Hz)")
    panels[1].set_ylabel("decay rate (1/s)")
    panels[1].legend(fontsize=9)
    return figure


def draw_ratings(result: Study) -> "Figure":
    """Draw figure 7: the eight corners of the design and their mean normalised ratings."""
    figure, panels = _panels(3, (12, 3.6))
    labels = ["".join("+" if level > 0 else "−" for level in row) for row in DESIGN]
    for axes, m in zip(panels, MATERIALS, strict=True):
        r = result.factorial[m]
        colours = [PAPER if i == r.best_run else OURS for i in range(8)]
        axes.bar(range(8), r.mean_rating, color=colours)
        axes.axhline(0, color=INK, linewidth=0.8)
        axes.set_xticks(range(8), labels)
        _finish(axes, f"{m}: most sensitive is {r.most_sensitive}", "low (−) or high (+): A, B, w")
    panels[0].set_ylabel("mean normalised rating (simulated)")
    return figure


def draw_confusion(result: Study) -> "Figure":
    """Draw the confusion of the simulated identification test."""
    figure, panels = _panels(1, (4.6, 4.2))
    axes, counts = panels[0], result.identification.confusion
    axes.imshow(counts / counts.sum(axis=1, keepdims=True), cmap="Blues", vmin=0, vmax=1)
    for (i, j), n in np.ndenumerate(counts):
        colour = "white" if n > counts[i].sum() / 2 else INK
        axes.text(j, i, str(n), ha="center", va="center", color=colour, fontsize=13)
    axes.set_xticks(range(3), MATERIALS)
    axes.set_yticks(range(3), MATERIALS)
    axes.set_xlabel("named")
    axes.set_ylabel("displayed")
    correct = result.identification.correct
    axes.set_title(f"simulated users: {correct:.1%} all right\n(published: 83.3 %)", fontsize=10)
    return figure


def draw_real(result: Study) -> "Figure":
    """Draw a typical real tap per plate and what one decaying sinusoid makes of it."""
    figure, panels = _panels(len(result.real), (14, 3.2))
    for axes, (m, r) in zip(panels, result.real.items(), strict=True):
        axes.plot(r.example, color=OURS, linewidth=1, label="recorded")
        axes.plot(r.fitted, "--", color=PAPER, linewidth=1.2, label="model")
        _finish(axes, f"{m}: {np.nanmedian(r.explained):.0%} explained", "sample")
    panels[0].set_ylabel("counts")
    panels[0].legend(fontsize=9, loc="upper right")
    return figure


def _panels(n: int, size: tuple[float, float]) -> "tuple[Figure, list[Axes]]":
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    return figure, list(figure.subplots(1, n, squeeze=False)[0])


def _finish(axes: "Axes", title: str, x_label: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set_xlabel(x_label)
    axes.grid(color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
