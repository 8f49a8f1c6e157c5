"""Draw figures 4 to 12 of `guruswamy2011` for simulated scans, and the recovery of the ground truth."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from guruswamy2011_measures import BOUNDS
from guruswamy2011_objects import LAWS, OBJECTS, ROW, TABLE_1, Samples
from matplotlib.figure import Figure as Drawing
from scipy import ndimage, signal

from texclass.haptics.textures.guruswamy2011 import FittedScan, LevelFit
from texclass.haptics.textures.guruswamy2011.fit import SMOOTHING_HZ
from texclass.reporting.figure_style import FAINT, INK, LOOKS, OTHER, OURS, legend_above
from texclass.reporting.wording import MINUS

COLOURS = (*(colour for colour, _ in LOOKS), INK)


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
    rows: int, columns: int, size: tuple[float, float], *, sharey: bool = False
) -> tuple[Drawing, list[Any]]:
    figure = Drawing(figsize=size, layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False, sharey=sharey).ravel())


def _legend(axes: Any, lines: Sequence[tuple[str, str, str]]) -> None:
    axes.set_axis_off()
    for label, colour, style in lines:
        axes.plot([], [], color=colour, linestyle=style, label=label)
    axes.legend(loc="center")
