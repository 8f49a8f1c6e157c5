"""Figures 2(b), 4 and 5 of `abdulali2016`, of simulated recordings."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import signal

from texclass.recording import Samples
from texclass.textures.abdulali2016.fitting import ModelledScan
from texclass.textures.abdulali2016.segmentation import InputSegments
from texclass.textures.abdulali2016.study import SurfaceScores
from texclass.textures.scan import Scan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, OURS, PAPER, FAINT = "#222222", "#1f5f99", "#c2571a", "#cccccc"
COLOURS = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#D55E00",
)  # Okabe and Ito: safe for all eyes


def draw_segments(scan: Scan, segments: InputSegments) -> "Figure":
    """Draw the path with its segments in colour, and the speed and force they were cut by (Fig. 2b)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.4), layout="constrained")
    path, speed, force = figure.subplot_mosaic(
        [["path", "speed"], ["path", "force"]], width_ratios=(1, 1.5)
    ).values()
    path.plot(*scan.position.T, color=FAINT, linewidth=1, zorder=1)
    signals = ((speed, scan.speed), (force, scan.force))
    for axes, x in signals:
        axes.plot(scan.time_s, x, color=FAINT, linewidth=1)
    for i, (a, b) in enumerate(zip(segments.start, segments.stop, strict=True)):
        colour = COLOURS[i % len(COLOURS)]
        path.plot(*scan.position[a:b].T, color=colour, linewidth=2)
        for axes, x in signals:
            axes.plot(scan.time_s[a:b], x[a:b], color=colour, linewidth=2)
            axes.plot([scan.time_s[a], scan.time_s[b - 1]], 2 * [x[a:b].mean()], color=INK, linewidth=0.6)
    path.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal", title="position")
    speed.set(ylabel="speed (mm/s)", ylim=(0, None))
    speed.set_title(f"{len(segments)} segments; grey: shorter than 75 ms, or no contact", fontsize=10)
    force.set(ylabel="normal force (N)", xlabel="time (s)", ylim=(0, None))
    _clean((path, speed, force))
    return figure


def draw_input_space(modelled: ModelledScan) -> "Figure":
    """Draw the model points in the input space, without and with the silent ones (Fig. 4)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.8), layout="constrained")
    norm = modelled.normalisation
    titles = ("(a) segments", "(b) with points of zero force and of zero speed")
    for column, title in enumerate(titles, start=1):
        axes: Any = figure.add_subplot(1, 2, column, projection="3d")
        shown = modelled.points if column == 1 else modelled.points.joined(modelled.silent)
        u = shown.u * norm.deviation + norm.mean
        looks = ((0, "segment", OURS, "o"), (1, "zero force", PAPER, "^"), (2, "zero speed", COLOURS[2], "s"))
        for kind, label, colour, marker in looks:
            at = u[shown.kind == kind]
            if len(at):
                axes.scatter(
                    at[:, 0], at[:, 1], at[:, 2], color=colour, marker=marker, label=label, depthshade=False
                )
        axes.set(xlabel="$v_x$ (mm/s)", ylabel="$v_y$ (mm/s)", title=title)
        axes.set_zlabel("$f_n$ (N)")
        axes.set_zlim(0, None)
        axes.view_init(elev=22, azim=-60)
        axes.set_box_aspect(None, zoom=0.85)
        if column == 2:
            axes.legend(loc="upper left", frameon=False, fontsize=8)
    return figure


def draw_scores(rows: Sequence[SurfaceScores]) -> "Figure":
    """Draw mean GFC and its deviation over windows of each surface (Fig. 5a)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.5, 4.2), layout="constrained")
    axes = figure.add_subplot()
    ways = (("network", "network, ours", OURS), ("as published", "network, as published", PAPER),
            ("Delaunay", "Delaunay", COLOURS[2]), ("one AR model", "one AR model", FAINT))  # fmt: skip
    x, width = np.arange(len(rows)), 0.2
    for i, (way, label, colour) in enumerate(ways):
        have = [(j, row.scores[way]) for j, row in enumerate(rows)]
        shown = [(j, score) for j, score in have if score is not None]
        place = [x[j] + (i - 1.5) * width for j, _ in shown]
        mean = [score.gfc for _, score in shown]
        error = [[min(score.deviation, score.gfc) for _, score in shown],
                 [min(score.deviation, 1 - score.gfc) for _, score in shown]]  # fmt: skip
        axes.bar(place, mean, width, color=colour, label=label)
        axes.errorbar(place, mean, yerr=error, fmt="none", ecolor=INK, elinewidth=0.8, capsize=1.5)
    if all("the truth again" in row.scores for row in rows):
        ceiling = [score.gfc for row in rows if (score := row.scores["the truth again"]) is not None]
        axes.hlines(ceiling, x - 0.45, x + 0.45, color=INK, linewidth=1.2, label="the truth with other noise")
    axes.axhline(0.9, color=INK, linewidth=0.8, linestyle=":", label="0.90: good, says the paper")
    labels = [row.name if row.anisotropic or row.kind == "real" else f"{row.name}\nisotropic" for row in rows]
    axes.set_xticks(x, labels)
    axes.set(ylim=(0.6, 1.0), ylabel="GFC, mean and deviation over windows")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    _clean([axes])
    return figure


def draw_spectra(pairs: dict[str, tuple[Samples, Samples]], fs: float) -> "Figure":
    """Draw recorded beside rendered power spectra of surfaces, by name (Fig. 5b-d)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.2), layout="constrained")
    panels = figure.subplots(1, len(pairs), squeeze=False)[0]
    for letter, (name, both), axes in zip("bcd", pairs.items(), panels, strict=False):
        for x, label, colour in zip(both, ("recorded", "rendered"), (INK, PAPER), strict=True):
            f, power = signal.welch(x, fs, window="hamming", nperseg=250)
            axes.plot(f, 10 * np.log10(power), color=colour, label=label, linewidth=1.4)
        axes.set(xlabel="frequency (Hz)", title=f"({letter}) sample {name}", xlim=(0, fs / 2))
    panels[0].set_ylabel("power (dB re 1 m²/s⁴/Hz)")
    panels[0].legend(frameon=False, fontsize=8)
    _clean(panels)
    return figure


def draw_held_out(gfc: dict[str, Samples]) -> "Figure":
    """Draw the distribution of the GFC at held-out speeds, forces and directions."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.5, 3.4), layout="constrained")
    axes = figure.add_subplot()
    for (label, values), colour in zip(gfc.items(), COLOURS, strict=False):
        ordered = np.sort(values)
        share = np.arange(1, ordered.size + 1) / ordered.size
        axes.step(ordered, share, where="post", color=colour, label=f"held-out {label}")
    axes.axvline(0.95, color=INK, linestyle=":", linewidth=0.8)
    axes.set(xlabel="mean GFC of a run", ylabel="share of runs at or below", ylim=(0, 1))
    axes.legend(frameon=False, fontsize=8)
    _clean([axes])
    return figure


def _clean(panels: "Sequence[Axes]") -> None:
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
