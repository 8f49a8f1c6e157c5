"""Draw figures 2 to 12 of `guruswamy2011` for simulated scans, and results that the paper does not show."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from guruswamy2011_measures import BOUNDS
from guruswamy2011_objects import LAWS, OBJECTS, ROW, TABLE_1, Samples
from matplotlib.figure import Figure as Drawing
from scipy import ndimage, signal

from texclass.haptics.textures.guruswamy2011 import FittedScan, LevelFit, MeshForces, SinusoidTexture
from texclass.haptics.textures.guruswamy2011.fit import SMOOTHING_HZ
from texclass.reporting.figure_style import FAINT, INK, LOOKS, OTHER, OURS, legend_above
from texclass.reporting.wording import MINUS

COLOURS = (*(colour for colour, _ in LOOKS), INK)


def draw_profiles(width: float, fitted: Mapping[str, FittedScan]) -> Drawing:
    """Draw whole profiles, and a part with about eight features (figure 2)."""
    figure, panels = _panels(len(fitted), 2, (width, 2 * len(fitted)), sharey="row")
    for (whole, part), (name, each) in zip(
        zip(panels[::2], panels[1::2], strict=True), fitted.items(), strict=True
    ):
        t = each.scan.time_s
        features_per_s = each.texture.n_features / t[-1]
        shown = (t >= 2) & (t <= 2 + 8 / features_per_s)
        whole.plot(t, each.acceleration, color=OURS, linewidth=0.5)
        whole.axvspan(t[shown][0], t[shown][-1], color=FAINT, alpha=0.5)
        part.plot(t[shown], each.acceleration[shown], color=OURS, linewidth=0.9)
        whole.set_title(name)
        part.set_title(f"{name}, shaded part")
        whole.set_ylabel("acceleration (m/s²)")
        for axes in (whole, part):
            axes.margins(x=0)
    for axes in panels[-2:]:
        axes.set_xlabel("time (s)")
    return figure


def draw_tutorial(width: float, texture: SinusoidTexture, forces: MeshForces, speed: float) -> Drawing:
    """Draw the filters of a texture on its profile, and the rendered vibration (figure 3)."""
    figure, (top, bottom) = _panels(2, 1, (width, 4.6))
    height = -np.sin(texture.phase) * texture.amplitude
    top.vlines(texture.position_mm, 0, height, color=OURS)
    top.plot(texture.position_mm, height, "o", color=OURS, markersize=5)
    top.set(xlabel="position along the profile (mm)", ylabel="A (m/s²)", xlim=(0, texture.length_mm))
    top.set_title("filters on the surface")
    t = np.arange(forces.texture.size) / texture.fs
    bottom.plot(t, forces.texture, color=OURS, linewidth=1.1)
    for onset in texture.position_mm / speed:
        bottom.axvline(onset, color=FAINT, linewidth=0.9, zorder=0)
    bottom.set(xlabel="time (s)", ylabel="acceleration (m/s²)", xlim=(0, texture.length_mm / speed))
    bottom.set_title(f"rendered on the plane at {speed:.0f} mm/s")
    return figure


def draw_meshes(width: float, shown: Mapping[str, tuple[Samples, MeshForces]], fs: float) -> Drawing:
    """Draw contact and texture forces along hand-held paths, one column per mesh."""
    figure, panels = _panels(3, len(shown), (width, 6.2), sharey="row")
    for column, (shape, (path, forces)) in enumerate(shown.items()):
        t = np.arange(len(path)) / fs
        part = t <= 2
        own = panels[column :: len(shown)]
        own[0].plot(t[part], np.linalg.norm(forces.constraint, axis=1)[part], color=OURS, label="constraint")
        own[0].plot(t[part], np.linalg.norm(forces.friction, axis=1)[part], color=OTHER, label="friction")
        own[1].plot(t[part], 1e3 * forces.texture[part], color=OURS, linewidth=0.8)
        for values, colour, label in (
            (forces.along_mm, OURS, "along the profile"),
            (forces.across_mm, OTHER, "distance from it"),
        ):
            in_contact = np.any(forces.constraint != 0, axis=1)
            own[2].plot(t[part], np.where(in_contact, values, np.nan)[part], color=colour, label=label)
        own[0].set_title(shape)
        own[2].set_xlabel("time (s)")
        for axes in own:
            axes.set_xlim(0, 2)
    for axes, label in zip(
        panels[:: len(shown)], ("force (N)", "texture force (mN)", "position (mm)"), strict=True
    ):
        axes.set_ylabel(label)
    panels[0].legend()
    panels[2 * len(shown)].legend()
    return figure


def draw_complexity(
    width: float, groups: Mapping[str, Sequence[Mapping[str, Any]]], titles: Mapping[str, str]
) -> Drawing:
    """Draw the complexity of the segments of each scan, one row per group."""
    figure, panels = _panels(1, len(titles), (width, 2.8), sharey=True)
    for axes, (measure, title) in zip(panels, titles.items(), strict=True):
        for y, (colour, rows) in enumerate(zip(COLOURS, groups.values(), strict=False)):
            values = np.array([row[measure] for row in rows], dtype=float)
            axes.plot(values, np.full(values.size, y), "o", color=colour, markersize=5, alpha=0.6)
            axes.plot([np.median(values)] * 2, [y - 0.3, y + 0.3], color=colour, linewidth=2)
        axes.set_title(title)
        axes.set_xlim(0, None)
    panels[0].set_yticks(range(len(groups)), list(groups))
    panels[0].set_ylim(len(groups) - 0.5, -0.5)
    return figure


def draw_orders(width: float, segment: Samples, fits: Sequence[Mapping[str, Any]], fs: float) -> Drawing:
    """Draw one segment and its fits (figure 4)."""
    figure, panels = _panels(1, 2, (width, 3.6), sharey=True)
    t = 1e3 * np.arange(segment.size) / fs
    for axes, chosen, title in (
        (panels[0], fits[:1], "decaying sinusoid"),
        (panels[1], fits[1:], "filters"),
    ):
        axes.plot(t, segment, "x", color=INK, markersize=4, label="band-passed scan")
        for colour, fit in zip(COLOURS, chosen, strict=False):
            label = f"{fit['method']}, order {fit['order']}: {1e3 * fit['error']:.3g} mm/s²"
            axes.plot(t, fit["response"], color=colour, linewidth=1.2, label=label)
        axes.set_title(title)
        axes.legend()
        axes.set_xlabel("time (ms)")
    panels[0].set_ylim(1.3 * min(segment.min(), 0.0) - 0.5, 1.3 * max(segment.max(), 0.0) + 0.5)
    panels[0].set_ylabel("acceleration (m/s²)")
    return figure


def draw_segmentation(width: float, fitted: FittedScan, segment: int) -> Drawing:
    """Draw the magnitude around a segment, its peaks, and the starts of segments (figure 5)."""
    figure, (axes,) = _panels(1, 1, (width, 3.2))
    bounds, x, fs = fitted.profile.segmentation.bounds, fitted.profile.samples, fitted.scan.fs
    start, stop = bounds[max(segment - 1, 0)], bounds[min(segment + 2, bounds.size - 1)]
    t = np.arange(start, stop) / fs
    magnitude = np.abs(x[start:stop])
    peaks = signal.find_peaks(magnitude)[0]
    axes.plot(t, x[start:stop], color=FAINT, linewidth=1, label="profile")
    axes.plot(t, magnitude, color=OURS, linewidth=1.2, label="its magnitude")
    axes.plot(t[peaks], magnitude[peaks], "s", color=OTHER, markersize=4, fillstyle="none", label="peaks")
    for i, bound in enumerate(bounds[(bounds >= start) & (bounds <= stop)]):
        axes.axvline(bound / fs, color=INK, linewidth=0.9, label="" if i else "segments begin")
    axes.axvspan(bounds[segment] / fs, bounds[segment + 1] / fs, color=FAINT, alpha=0.3)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("acceleration (m/s²)")
    axes.set_title(f"{fitted.scan.name}: segment {segment}")
    axes.legend()
    return figure


def draw_spectra(width: float, fitted: Mapping[str, FittedScan]) -> Drawing:
    """Draw the smoothed power spectra with our cut-offs and the published ones (figures 6 and 7)."""
    figure, panels = _panels(2, 3, (width, 5.4))
    for axes, (name, each) in zip(panels, fitted.items(), strict=False):
        f, power = signal.periodogram(signal.detrend(each.acceleration), each.scan.fs)
        smooth = ndimage.gaussian_filter1d(power, SMOOTHING_HZ / f[1])
        axes.fill_between(f, smooth / smooth.max(), color=FAINT)
        band, theirs = each.profile.band, dict(zip(ROW, TABLE_1[name], strict=True))
        for ours, printed, style in (
            (band.major_hz, theirs["f_major_hz"], ":"),
            (band.upper_hz, theirs["f_max_hz"], "-"),
        ):
            axes.axvline(ours, color=OURS, linestyle=style, linewidth=1.4)
            axes.axvline(printed, color=OTHER, linestyle=style, linewidth=1.0)
        axes.axhline(0.1, color=INK, linewidth=0.5)
        axes.set(xlim=(0, 330), ylim=(0, 1.05))
        axes.set_title(name)
        axes.set_xlabel("frequency (Hz)")
    names = ("f_major, ours", "f_major, published", "upper cut-off, ours", "upper cut-off, published")
    _legend(panels[-1], list(zip(names, (OURS, OTHER) * 2, "::--", strict=True)))
    panels[0].set_ylabel("power, relative")
    return figure


def draw_textures(width: float, fitted: Mapping[str, FittedScan]) -> Drawing:
    """Draw the sum of the filters over the scans (figures 8 and 9)."""
    figure, panels = _panels(5, 1, (width, 10))
    for axes, (name, each) in zip(panels, fitted.items(), strict=True):
        n, fs = len(each.scan), each.scan.fs
        total = each.responses.sum(n, fs)
        speed = each.scan.speed.mean()
        per_s = speed * each.texture.n_features / each.texture.length_mm
        cut = slice(int(2 * fs), int(2 * fs + 8 * fs / max(per_s, 8)))
        t = np.arange(n)[cut] / fs
        axes.plot(t, each.acceleration[cut], "x", color=INK, markersize=3, label="scan")
        axes.plot(t, total[cut], color=OURS, linewidth=1.4, label="texture")
        axes.set_title(name)
        axes.set_ylabel("m/s²")
    panels[0].legend(ncols=2)
    panels[-1].set_xlabel("time (s)")
    return figure


def draw_laws(width: float, fits: Mapping[str, LevelFit]) -> Drawing:
    """Draw RMS minus force term over speed, with the fitted and published lines (figure 10)."""
    figure, panels = _panels(1, len(fits), (width, 3.6))
    for axes, (name, fit) in zip(panels, fits.items(), strict=True):
        v = np.linspace(0, fit.speed.max(), 2)
        theirs = LAWS[name]
        axes.plot(
            fit.speed,
            fit.rms - fit.law.k_c * fit.force,
            "o",
            color=OURS,
            markersize=4,
            label="scans (simulated)",
        )
        axes.plot(
            v, fit.law.rms(v, 0.0), color=OURS, label=f"ours: {fit.law.k_v:.1f} 1/s, {fit.law.a_0:.3f} m/s²"
        )
        axes.plot(
            v, theirs.rms(v, 0.0), "--", color=OTHER, label=f"published: {theirs.k_v} 1/s, {theirs.a_0} m/s²"
        )
        axes.set_title(name)
        axes.set_xlabel("speed (mm/s)")
        axes.set(xlim=(0, None), ylim=(0, None))
        axes.legend()
    panels[0].set_ylabel("RMS − k_c · force (m/s²)")
    return figure


def draw_speeds(width: float, name: str, pairs: Sequence[Mapping[str, Any]]) -> Drawing:
    """Draw scan and texture at three speeds, over space and over time (figures 11 and 12).

    The curves have the same scale and different zero lines; the scan is above the texture.
    """
    figure, panels = _panels(2, len(pairs), (width, 5.6), sharey=True)
    loudest = max(float(np.abs(pair["scan"].acceleration).max()) for pair in pairs)
    step = 5.0 * max(1, round(loudest / 10))  # tick spacing in m/s^2
    lift = 2 * step + loudest
    density = TABLE_1[name][ROW.index("segments_per_mm")]
    for column, pair in enumerate(pairs):
        scan = pair["scan"]
        x = scan.distance_mm
        start = float(x[-1]) / 3
        here = (x >= start) & (x <= start + 6 / density)
        t = 1e3 * (scan.time_s - scan.time_s[here][0])
        top, bottom = panels[column], panels[column + len(pairs)]
        for axes, along, shown in ((top, x - start, here), (bottom, t, (t >= 0) & (t <= 300))):
            axes.plot(along[shown], scan.acceleration[shown] + lift, color=INK, linewidth=0.9, label="scan")
            axes.plot(along[shown], pair["rendered"][shown], color=OURS, linewidth=0.9, label="texture")
            axes.set_xlim(0, along[shown][-1])
        top.set_title(f"{name}, {scan.speed.mean():.0f} mm/s")
        top.set_xlabel("distance (mm)")
        bottom.set_xlabel("time (ms)")
    for axes in (panels[0], panels[len(pairs)]):
        ticks = np.array([-step, 0.0, step])
        axes.set_yticks([*ticks, *(ticks + lift)], 2 * [f"{tick:g}".replace("-", MINUS) for tick in ticks])
        axes.set_ylabel("acceleration (m/s²)")
    legend_above(figure, panels[0])
    return figure


def draw_recovery(width: float, recovered: Mapping[str, Samples]) -> Drawing:
    """Draw the error of every trial relative to its bound."""
    figure, panels = _panels(1, len(BOUNDS), (width, 3.2), sharey=True)
    for axes, (k, (quantity, bound)) in zip(panels, enumerate(BOUNDS.items()), strict=True):
        for y, errors in enumerate(recovered.values()):
            n = errors.shape[1]
            axes.plot(errors[k] / bound, y + np.linspace(-0.3, 0.3, n), ".", color=OURS, markersize=4)
        axes.axvspan(-1, 1, color=FAINT, alpha=0.4)
        axes.set_title(quantity)
        axes.set_xlabel(f"error / {'2 Hz' if quantity == 'f_major' else f'{100 * bound:g} %'}")
        axes.set_xlim(-2.2, 2.2)
    panels[0].set_yticks(range(len(OBJECTS)), [thing.name for thing in OBJECTS])
    panels[0].invert_yaxis()
    return figure


def _panels(
    rows: int, columns: int, size: tuple[float, float], *, sharey: bool | Literal["row"] = False
) -> tuple[Drawing, list[Any]]:
    figure = Drawing(figsize=size, layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False, sharey=sharey).ravel())


def _legend(axes: Any, lines: Sequence[tuple[str, str, str]]) -> None:
    axes.set_axis_off()
    for label, colour, style in lines:
        axes.plot([], [], color=colour, linestyle=style, label=label)
    axes.legend(loc="center")
