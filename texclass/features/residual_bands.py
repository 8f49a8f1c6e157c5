"""Levels above the line of the vibration: what is left of a spectrum without its height and its tilt.

A sensor that warms up, another grip or more force raise or tilt all levels together: one change, which a
distance between recordings counts once in every column. Here the tilt is a column, height is left to
`vibration_level`, and the others say where a surface stands out from both.
"""

import numpy as np

from texclass.features.bands import even_levels, fraction_names, octave_levels
from texclass.features.contract import feature_in_samples
from texclass.features.phase_view import PhaseView, transform
from texclass.features.slopes import LAGS, curvature_levels, slope_levels
from texclass.recording import Samples

REFERENCE = "texclass; residuals of a straight line in log level over log frequency"


def octaves_of(lags: tuple[int, ...]) -> Samples:
    """Return where differences over spans of samples look, fs/(2 lag), in octaves from fs/2."""
    return -np.log2(lags)


@transform
def line(view: PhaseView) -> tuple[Samples, Samples]:
    """Return the least-squares line through the `slope_level` of `LAGS`: height at their middle, and tilt.

    Both of shape (..., 1).

    Mean magnitudes follow how much a signal changes most of the time, so that single strong events and a
    strong tone move the line less than they would move one through a spectrum.

    Raises
    ------
    UndefinedFeatureError
        As `slope_level`.
    """
    octaves = octaves_of(LAGS)
    away = octaves - octaves.mean()
    levels = slope_levels(view, LAGS)
    return levels.mean(axis=-1, keepdims=True), levels @ away[:, np.newaxis] / (away @ away)


def line_at(view: PhaseView, octaves: Samples) -> Samples:
    """Return the `line` at frequencies given in octaves from fs/2 (negative below it), (..., n_octaves)."""
    height, tilt = line(view)
    return np.asarray(height + tilt * (octaves - octaves_of(LAGS).mean()))


@feature_in_samples("log10(1) per octave", REFERENCE, outputs="tilt")
def level_tilt(view: PhaseView) -> Samples:
    """By how much the mean magnitude of changes rises from one octave to the next higher; see `line`.

    With L_l the `slope_level` over lag l and u_l = -log2 l: sum (u_l - mean u) L_l / sum (u_l - mean u)^2. It
    is 0 for white noise and -0.15 = -log10(2)/2 for a random walk.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        As `slope_level`.
    """
    return line(view)[1]


@feature_in_samples("log10(1)", REFERENCE, outputs="b{n_bands}")
def band_residual_level(view: PhaseView, *, n_bands: int = 24) -> Samples:
    """`band_level` minus twice (power of a magnitude) the `line` at the middle of each band.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_bands : int
        Number of bands of equal width from 0 to fs/2.
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        As `band_level` and `slope_level`.
    """
    middle = np.log2((np.arange(n_bands) + 0.5) / n_bands)
    return np.asarray(even_levels(view, n_bands) - 2 * line_at(view, middle))


@feature_in_samples("log10(1)", REFERENCE, outputs=fraction_names)
def octave_residual_level(
    view: PhaseView, *, octaves: tuple[int, int] = (2, 5), per_octave: int = 3
) -> Samples:
    """`octave_level` minus twice the `line` at the middle of each fraction of an octave.

    Parameters
    ----------
    view : PhaseView
        Movement.
    octaves : tuple of int
        First octave, and the one after the last, counted downwards from fs/2.
    per_octave : int
        Bands in an octave.
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        As `octave_level` and `slope_level`.
    """
    n_bands = (octaves[1] - octaves[0]) * per_octave
    middle = -octaves[0] - (np.arange(n_bands) + 0.5) / per_octave
    return np.asarray(octave_levels(view, octaves, per_octave) - 2 * line_at(view, middle))


@feature_in_samples("log10(1)", REFERENCE, outputs="lag{lags}")
def slope_residual_level(view: PhaseView, *, lags: tuple[int, ...] = LAGS) -> Samples:
    """`slope_level` minus the `line` at fs/(2 lag): where the changes bend away from a straight line.

    Parameters
    ----------
    view : PhaseView
        Movement.
    lags : tuple of int
        Spans, in samples.
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        As `slope_level`.
    """
    return np.asarray(slope_levels(view, lags) - line_at(view, octaves_of(lags)))


@feature_in_samples("log10(1)", REFERENCE, outputs="lag{lags}")
def curvature_residual_level(view: PhaseView, *, lags: tuple[int, ...] = LAGS) -> Samples:
    """`curvature_level` minus the `line` at fs/(2 lag), where a second difference lets most through.

    Parameters
    ----------
    view : PhaseView
        Movement.
    lags : tuple of int
        Half the spans of the curvatures, in samples.
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        As `curvature_level` and `slope_level`.
    """
    return np.asarray(curvature_levels(view, lags) - line_at(view, octaves_of(lags)))
