"""What the speed does to a surface and to its model: levels and spectra, as numbers and as a picture."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from texclass.haptics.scene.fits import model_spectra
from texclass.haptics.scene.observations import LEAST_POWER, Judge, Observed, Points, Scored, slopes
from texclass.haptics.textures.grid import GridModel
from texclass.recording import Samples
from texclass.reporting import Figure, Table
from texclass.reporting import figure_style as style

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

N_CURVE = 24
"""Speeds at which the course of the model's level is told."""


def against_speed(model: GridModel, observed: Observed, verdict: Scored, judge: Judge) -> dict[str, Any]:
    """Return levels and spectra of a surface and of its model over the speed, as JSON knows them.

    Parameters
    ----------
    model : GridModel
    observed : Observed
        The surface.
    verdict : dict
        Of the rendered model where it was proved, see `Judge.verdict`.
    judge : Judge

    Returns
    -------
    dict
        "unit"; "points": speed (mm/s), force (N), level (dB re 1 unit, within the band) of the surface, and
        "model", that of the rendered model, where it is proved; "fitted": the first three, where it is not;
        "curve": speeds and levels of the model at the lowest, the middle and the highest force; "spectra":
        the middle of each third of all points in "speeds", "hz", and densities in dB of "surface", "model";
        "rise_db": how much the surface's level rises at twice the speed, and at twice the force.
    """
    fitted = _joined(observed.fit, observed.choose)
    every = _joined(fitted, observed.prove)
    largest = float(judge.power(every.spectra).max())
    least = max(judge.device.noise_floor**2, LEAST_POWER * largest, 1e-300)

    def level(spectra: Samples) -> Samples:
        return np.asarray(10 * np.log10(np.maximum(judge.power(spectra), least)))

    def told(points: Points) -> dict[str, list[float]]:
        speed, force = _rounded(points.speed), _rounded(points.force, 3)
        return {"speed": speed, "force": force, "level": _rounded(level(points.spectra))}

    rendered = _rounded(level(observed.prove.spectra) + np.array(verdict["levels_db"]))
    v = np.geomspace(every.speed.min(), every.speed.max(), N_CURVE)
    forces = np.quantile(every.force, [0.0, 0.5, 1.0])
    at = [Points(np.zeros((N_CURVE, 0)), v, np.full(N_CURVE, f)) for f in forces]
    part, band_least = judge.parts @ judge.frequencies, least / float(judge.in_band.sum())
    thirds = np.array_split(np.argsort(every.speed, kind="stable"), 3)
    groups = [Points(every.spectra[g], every.speed[g], every.force[g]) for g in thirds if g.size]

    def density(spectra: Samples) -> list[float]:
        found = np.maximum(spectra.mean(axis=0) @ judge.parts.T, band_least)
        return _rounded(10 * np.log10(found))

    return {
        "unit": judge.device.unit,
        "points": told(observed.prove) | {"model": rendered},
        "fitted": told(fitted),
        "curve": {
            "speed": _rounded(v),
            "force": _rounded(forces, 3),
            "level": [_rounded(level(model_spectra(model, points, judge))) for points in at],
        },
        "spectra": {
            "speeds": _rounded(np.array([np.exp(np.log(g.speed).mean()) for g in groups])),
            "hz": _rounded(part),
            "surface": [density(g.spectra) for g in groups],
            "model": [density(model_spectra(model, g, judge)) for g in groups],
        },
        "rise_db": _rounded(slopes(level(every.spectra), every), 2),
    }


def speed_figure(name: str, told: Mapping[str, Any], verdict: Scored) -> Figure:
    """Return the picture of what `against_speed` told of a surface."""
    points, (over_speed, over_force) = told["points"], told["rise_db"]
    more = verdict["slopes_db"]
    worst = max(map(abs, verdict["levels_db"]))
    return Figure(
        f"speed-{name}",
        f"What the speed does to {name}",
        f"at twice the speed its level rises by {over_speed:.1f} dB, the model's by "
        f"{over_speed + more[0]:.1f}; at twice the force by {over_force:.1f} and {over_force + more[1]:.1f} "
        f"dB; where it was not fitted, the model's level is off by {worst:.1f} dB at most.",
        lambda width: draw_speed(told, width),
        Table(
            pd.DataFrame(
                {
                    "mm/s": [f"{v:.0f}" for v in points["speed"]],
                    "N": [f"{f:.2f}" for f in points["force"]],
                    "level, dB": [f"{x:.1f}" for x in points["level"]],
                    "model, dB": [f"{x:.1f}" for x in points["model"]],
                }
            ),
            f"Levels re 1 {told['unit']}, within the band, where the model was proved.",
        ),
    )


def draw_speed(told: Mapping[str, Any], width: float) -> "Drawing":
    """Draw the levels over the speed, and the spectra of the surface and of its model at three speeds."""
    from matplotlib.figure import Figure as Drawing

    narrow = width < style.WIDTH / 2
    figure = Drawing(figsize=(width, 6.0 if narrow else 3.2), layout="constrained")
    left, right = figure.subplots(*((2, 1) if narrow else (1, 2)))
    points, fitted, curve, spectra = (told[key] for key in ("points", "fitted", "curve", "spectra"))
    low, middle, high = curve["level"]
    label = "model, lowest to highest force"
    left.fill_between(curve["speed"], low, high, color=style.PALETTE["e1"], linewidth=0, label=label)
    left.plot(curve["speed"], middle, color=style.OTHER, label="model, middle force")
    left.plot(fitted["speed"], fitted["level"], ".", color=style.FAINT, label="surface, fitted to")
    for v, f, surface, model in zip(*(points[key] for key in points), strict=True):
        said = f"{v:.0f} mm/s, {f:.2f} N: surface {surface:.1f} dB, model {model:.1f} dB"
        left.plot(v, surface, "o", color=style.OURS, markersize=5, gid=said, label="surface, held out")
        left.plot(v, model, "_", color=style.OTHER, markersize=8, label="model, there")
    left.set_xlabel("speed, mm/s")
    left.set_ylabel(f"level, dB re 1 {told['unit']}")
    style.log_x(left)
    of_surface, of_model = spectra["surface"], spectra["model"]
    for speed, surface, model, (colour, _) in zip(
        spectra["speeds"], of_surface, of_model, style.LOOKS, strict=False
    ):
        right.plot(spectra["hz"], surface, color=colour, linewidth=1.2)
        right.plot(spectra["hz"], model, color=colour, linewidth=1.2, linestyle="--")
        end = (spectra["hz"][-1], surface[-1])
        right.annotate(
            f"{speed:.0f} mm/s", end, (4, 0), textcoords="offset points", color=colour, va="center"
        )
    right.set_xlabel("Hz; dashed: the model")
    right.set_ylabel("dB/Hz")
    style.log_x(right)
    style.legend_above(figure, left)
    return figure


def _joined(*parts: Points) -> Points:
    return Points(*(np.concatenate([getattr(p, a) for p in parts]) for a in ("spectra", "speed", "force")))


def _rounded(values: Samples, digits: int = 1) -> list[float]:
    return [round(float(x), digits) for x in values]
