"""Compute and draw level and spectrum over speed, for a surface and its model."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from texclass.haptics.scene.fits import model_spectra
from texclass.haptics.scene.surface_spectra import (
    MIN_RELATIVE_POWER,
    OperatingPoints,
    Score,
    SpectralScorer,
    SurfaceSpectra,
    level_slopes,
)
from texclass.haptics.textures.grid import GridModel
from texclass.recording import Samples
from texclass.reporting import Figure, Table
from texclass.reporting import figure_style as style

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

N_CURVE = 24
"""Number of speeds on each level curve of the model."""


def speed_dependence(
    model: GridModel, spectra: SurfaceSpectra, score: Score, scorer: SpectralScorer
) -> dict[str, Any]:
    """Return levels and spectra of a surface and its model as functions of the speed.

    Parameters
    ----------
    model : GridModel
        Model of the surface.
    spectra : SurfaceSpectra
        Spectra of the surface.
    score : dict
        Score of the rendered model on the test set, see `SpectralScorer.score`.
    scorer : SpectralScorer
        Band and noise of the device.

    Returns
    -------
    dict
        JSON-serializable, levels in dB re 1 unit within the band:

        - "unit": unit of the vibration;
        - "test": "speed" (mm/s), "force" (N), "level" and "model_level" of each point of the test set;
        - "fitting": "speed", "force" and "level" of the fitting and selection sets;
        - "curve": level of the model over "speed" for the lowest, median and highest "force";
        - "spectra": mean power densities in dB of "surface" and "model" over "hz", for each third of the
          points in order of speed, with the mean "speeds" of the thirds;
        - "slopes_db": level change of the surface per doubling of speed and of force.
    """
    fitting = _concatenate(spectra.fitting, spectra.selection)
    all_points = _concatenate(fitting, spectra.test)
    largest = float(scorer.power(all_points.spectra).max())
    lowest = max(scorer.device.noise_floor**2, MIN_RELATIVE_POWER * largest, 1e-300)

    def level(densities: Samples) -> Samples:
        return np.asarray(10 * np.log10(np.maximum(scorer.power(densities), lowest)))

    def point_levels(points: OperatingPoints) -> dict[str, list[float]]:
        speed, force = _round(points.speed), _round(points.force, 3)
        return {"speed": speed, "force": force, "level": _round(level(points.spectra))}

    model_level = _round(level(spectra.test.spectra) + np.array(score["level_errors_db"]))
    v = np.geomspace(all_points.speed.min(), all_points.speed.max(), N_CURVE)
    forces = np.quantile(all_points.force, [0.0, 0.5, 1.0])
    curve_points = [OperatingPoints(np.zeros((N_CURVE, 0)), v, np.full(N_CURVE, f)) for f in forces]
    hz, lowest_density = scorer.subbands @ scorer.frequencies, lowest / float(scorer.bin_widths.sum())
    thirds = np.array_split(np.argsort(all_points.speed, kind="stable"), 3)
    groups = [
        OperatingPoints(all_points.spectra[rows], all_points.speed[rows], all_points.force[rows])
        for rows in thirds
        if rows.size
    ]

    def mean_density_db(densities: Samples) -> list[float]:
        mean = np.maximum(densities.mean(axis=0) @ scorer.subbands.T, lowest_density)
        return _round(10 * np.log10(mean))

    return {
        "unit": scorer.device.unit,
        "test": point_levels(spectra.test) | {"model_level": model_level},
        "fitting": point_levels(fitting),
        "curve": {
            "speed": _round(v),
            "force": _round(forces, 3),
            "level": [_round(level(model_spectra(model, points, scorer))) for points in curve_points],
        },
        "spectra": {
            "speeds": _round(np.array([np.exp(np.log(group.speed).mean()) for group in groups])),
            "hz": _round(hz),
            "surface": [mean_density_db(group.spectra) for group in groups],
            "model": [mean_density_db(model_spectra(model, group, scorer)) for group in groups],
        },
        "slopes_db": _round(level_slopes(level(all_points.spectra), all_points), 2),
    }


def speed_figure(name: str, dependence: Mapping[str, Any], score: Score) -> Figure:
    """Return the figure of the effect of speed on a surface and its model.

    Parameters
    ----------
    name : str
        Name of the surface.
    dependence : mapping
        Result of `speed_dependence`.
    score : dict
        Score of the model on the test set, see `SpectralScorer.score`.

    Returns
    -------
    Figure
        Figure with caption and table.
    """
    test, (speed_slope, force_slope) = dependence["test"], dependence["slopes_db"]
    speed_error, force_error = score["slope_errors_db"]
    largest_error = max(map(abs, score["level_errors_db"]))
    return Figure(
        f"speed-{name}",
        f"Effect of speed on {name}",
        f"per doubling of the speed, the level rises by {speed_slope:.1f} dB (model: "
        f"{speed_slope + speed_error:.1f} dB); per doubling of the force, by {force_slope:.1f} dB (model: "
        f"{force_slope + force_error:.1f} dB). Largest level error of the model on the test set: "
        f"{largest_error:.1f} dB.",
        lambda width: draw_speed(dependence, width),
        Table(
            pd.DataFrame(
                {
                    "mm/s": [f"{v:.0f}" for v in test["speed"]],
                    "N": [f"{f:.2f}" for f in test["force"]],
                    "level, dB": [f"{x:.1f}" for x in test["level"]],
                    "model, dB": [f"{x:.1f}" for x in test["model_level"]],
                }
            ),
            f"Levels on the test set, re 1 {dependence['unit']}, within the band of the device.",
        ),
    )


def draw_speed(dependence: Mapping[str, Any], width: float) -> "Drawing":
    """Draw the levels over speed, and the spectra of surface and model at three speeds."""
    from matplotlib.figure import Figure as Drawing

    is_narrow = width < style.WIDTH / 2
    figure = Drawing(figsize=(width, 6.0 if is_narrow else 3.2), layout="constrained")
    level_axes, spectrum_axes = figure.subplots(*((2, 1) if is_narrow else (1, 2)))
    test, fitting, curve, spectra = (dependence[key] for key in ("test", "fitting", "curve", "spectra"))
    low, middle, high = curve["level"]
    level_axes.fill_between(
        curve["speed"], low, high,
        color=style.PALETTE["e1"], linewidth=0, label="model, lowest to highest force",
    )  # fmt: skip
    level_axes.plot(curve["speed"], middle, color=style.OTHER, label="model, median force")
    level_axes.plot(fitting["speed"], fitting["level"], ".", color=style.FAINT, label="surface, fitting set")
    for v, f, surface, model in zip(*(test[key] for key in test), strict=True):
        tooltip = f"{v:.0f} mm/s, {f:.2f} N: surface {surface:.1f} dB, model {model:.1f} dB"
        level_axes.plot(
            v, surface, "o", color=style.OURS, markersize=5, gid=tooltip, label="surface, test set"
        )
        level_axes.plot(v, model, "_", color=style.OTHER, markersize=8, label="model, test set")
    level_axes.set_xlabel("speed, mm/s")
    level_axes.set_ylabel(f"level, dB re 1 {dependence['unit']}")
    style.log_x(level_axes)
    for speed, surface, model, (colour, _) in zip(
        spectra["speeds"], spectra["surface"], spectra["model"], style.LOOKS, strict=False
    ):
        spectrum_axes.plot(spectra["hz"], surface, color=colour, linewidth=1.2)
        spectrum_axes.plot(spectra["hz"], model, color=colour, linewidth=1.2, linestyle="--")
        end = (spectra["hz"][-1], surface[-1])
        spectrum_axes.annotate(
            f"{speed:.0f} mm/s", end, (4, 0), textcoords="offset points", color=colour, va="center"
        )
    spectrum_axes.set_xlabel("Hz; dashed: the model")
    spectrum_axes.set_ylabel("dB/Hz")
    style.log_x(spectrum_axes)
    style.legend_above(figure, level_axes)
    return figure


def _concatenate(*sets: OperatingPoints) -> OperatingPoints:
    return OperatingPoints(
        *(np.concatenate([getattr(points, a) for points in sets]) for a in ("spectra", "speed", "force"))
    )


def _round(values: Samples, digits: int = 1) -> list[float]:
    return [round(float(x), digits) for x in values]
