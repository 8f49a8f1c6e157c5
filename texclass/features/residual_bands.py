"""Residual band levels: the levels of a spectrum after removing its height and its tilt.

The temperature of the sensor, the grip and the force raise or tilt all levels together. This common change
dominates the distance between two recordings. Therefore, the tilt is a separate column (`level_tilt`), the
height is `vibration_level`, and the residual levels describe the remaining shape of the spectrum.
"""

import numpy as np

from texclass.features.bands import even_levels, fraction_names, octave_levels
from texclass.features.contract import feature_in_samples
from texclass.features.phase_view import PhaseView, transform
from texclass.features.slopes import LAGS, curvature_levels, slope_levels
from texclass.recording import Samples

REFERENCE = "texclass; residuals of a straight line in log level over log frequency"


def log_frequency(lags: tuple[int, ...]) -> Samples:
    """Return the centre frequencies fs/(2 lag) of differences, in octaves relative to fs/2."""
    return -np.log2(lags)


@transform
def fit_line(view: PhaseView) -> tuple[Samples, Samples]:
    """Return height and tilt of the least-squares line through the `slope_level` at `LAGS`, (..., 1) each.

    The height is the value at the mean log frequency. Because `slope_level` is a mean magnitude, single
    strong events and strong tones affect this line less than a line through a power spectrum.

    Raises
    ------
    UndefinedFeatureError
        If `slope_level` is undefined.
    """
    octaves = log_frequency(LAGS)
    centred = octaves - octaves.mean()
    levels = slope_levels(view, LAGS)
    return levels.mean(axis=-1, keepdims=True), levels @ centred[:, np.newaxis] / (centred @ centred)


def line_at(view: PhaseView, octaves: Samples) -> Samples:
    """Return the values of the line at frequencies in octaves relative to fs/2, shape (..., n_octaves)."""
    height, tilt = fit_line(view)
    return np.asarray(height + tilt * (octaves - log_frequency(LAGS).mean()))


@feature_in_samples("log10(1) per octave", REFERENCE, outputs="tilt")
def level_tilt(view: PhaseView) -> Samples:
    """Return the slope of the mean magnitude of differences over log frequency, per octave.

    Let L_l be the `slope_level` at lag l, and u_l = -log2 l. The tilt is sum (u_l - mean u) L_l / sum (u_l -
    mean u)^2. It is 0 for white noise and -log10(2)/2 = -0.15 for a random walk.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape (1,)
        Tilt in log10(1) per octave.

    Raises
    ------
    UndefinedFeatureError
        If `slope_level` is undefined.

    References
    ----------
    texclass; straight line in log level over log frequency.

    Examples
    --------
    >>> import numpy as np
    >>> walk = np.random.default_rng(0).standard_normal(10_000).cumsum()
    >>> level_tilt(walk, fs=10_000).round(2).tolist()
    [-0.16]
    """
    return fit_line(view)[1]


@feature_in_samples("log10(1)", REFERENCE, outputs="b{n_bands}")
def band_residual_level(view: PhaseView, *, n_bands: int = 24) -> Samples:
    """Return the residual of `band_level`: the level minus twice the fitted line at the centre of each band.

    The line is a least-squares fit to the `slope_level` over log frequency. The factor 2 converts its values
    from log magnitudes to log powers.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    n_bands : int
        Number of bands of equal width from 0 to fs/2.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape (n_bands,)
        Residuals in log10(1), lowest band first.

    Raises
    ------
    UndefinedFeatureError
        If `band_level` or `slope_level` is undefined.

    References
    ----------
    texclass; residuals of a straight line in log level over log frequency.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> residual = band_residual_level(x, fs=10_000, n_bands=4)
    >>> louder = band_residual_level(10 * x, fs=10_000, n_bands=4)
    >>> bool(np.allclose(residual, louder))
    True
    """
    centre = np.log2((np.arange(n_bands) + 0.5) / n_bands)
    return np.asarray(even_levels(view, n_bands) - 2 * line_at(view, centre))


@feature_in_samples("log10(1)", REFERENCE, outputs=fraction_names)
def octave_residual_level(
    view: PhaseView, *, octaves: tuple[int, int] = (2, 5), per_octave: int = 3
) -> Samples:
    """Return the residual of `octave_level`: the level minus twice the fitted line at each band centre.

    The line is described in `band_residual_level`.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    octaves : tuple of int
        First octave, and the octave after the last one, counted down from fs/2.
    per_octave : int
        Number of bands per octave.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape (n_octaves * per_octave,)
        Residuals in log10(1), highest band first.

    Raises
    ------
    UndefinedFeatureError
        If `octave_level` or `slope_level` is undefined.

    References
    ----------
    texclass; residuals of a straight line in log level over log frequency.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.sin(2 * np.pi * 400 * np.arange(10_000) / 10_000)
    >>> int(octave_residual_level(x, fs=10_000).argmax())  # the tone is in 496 to 394 Hz
    4
    """
    n_bands = (octaves[1] - octaves[0]) * per_octave
    centre = -octaves[0] - (np.arange(n_bands) + 0.5) / per_octave
    return np.asarray(octave_levels(view, octaves, per_octave) - 2 * line_at(view, centre))


@feature_in_samples("log10(1)", REFERENCE, outputs="lag{lags}")
def slope_residual_level(view: PhaseView, *, lags: tuple[int, ...] = LAGS) -> Samples:
    """Return the residual of `slope_level`: the level minus the fitted line at fs/(2 lag).

    The line is described in `band_residual_level`.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    lags : tuple of int
        Lags in samples.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape (n_lags,)
        Residuals in log10(1).

    Raises
    ------
    UndefinedFeatureError
        If `slope_level` is undefined.

    References
    ----------
    texclass; residuals of a straight line in log level over log frequency.

    Examples
    --------
    >>> import numpy as np
    >>> walk = np.random.default_rng(0).standard_normal(10_000).cumsum()  # its levels form a straight line
    >>> bool(abs(slope_residual_level(walk, fs=10_000)).max() < 0.02)
    True
    """
    return np.asarray(slope_levels(view, lags) - line_at(view, log_frequency(lags)))


@feature_in_samples("log10(1)", REFERENCE, outputs="lag{lags}")
def curvature_residual_level(view: PhaseView, *, lags: tuple[int, ...] = LAGS) -> Samples:
    """Return the residual of `curvature_level`: the level minus the fitted line at fs/(2 lag).

    The line is described in `band_residual_level`.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    lags : tuple of int
        Lags of the second differences, in samples.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape (n_lags,)
        Residuals in log10(1).

    Raises
    ------
    UndefinedFeatureError
        If `curvature_level` or `slope_level` is undefined.

    References
    ----------
    texclass; residuals of a straight line in log level over log frequency.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> curvature_residual_level(x, fs=10_000, lags=(1, 2)).round(1).tolist()
    [0.0, 0.0]
    """
    return np.asarray(curvature_levels(view, lags) - line_at(view, log_frequency(lags)))
