"""Features of the first and second differences of a vibration at several lags: level, shape and signs.

A power spectrum contains no phase information. It shows neither whether the energy is concentrated in bursts
nor whether the signal is symmetric. A second difference is a band-pass around fs/(3 lag) that needs only two
additions per sample, and a few of its moments describe both properties. The signs of differences hardly
depend on the gain, on slow drift of the sensor, or on a few strong events.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from texclass.features.contract import Gain, UndefinedFeatureError, feature, feature_in_samples
from texclass.features.movement_filters import level, require, unit32
from texclass.features.phase_view import PhaseView, transform, undefined_if
from texclass.recording import Samples

SIGNS = "texclass; clipped autocorrelation (Van Vleck, 1943) of differences"
MOMENTS = "texclass; moments of second differences"
LAGS = (1, 2, 4, 8, 16, 32)
"""Lags in samples, one octave apart."""
SHAPES = ("lopsidedness", "peakedness", "evenness")
"""Moments that describe the shape of a signal; see `curvature_shape`."""
MIN_RMS = 1e-6
"""Smallest RMS relative to the largest sample; smaller values are rounding errors of single precision."""


def rising(view: PhaseView, lag: int) -> NDArray[np.bool_]:
    """Return whether x_(t+lag) > x_t, shape (..., n - lag)."""
    x = unit32(view)
    return np.asarray(x[..., lag:] > x[..., :-lag])


def convex(view: PhaseView, lag: int) -> NDArray[np.bool_]:
    """Return whether x_(t+2 lag) + x_t > 2 x_(t+lag), shape (..., n - 2 lag)."""
    x = unit32(view)
    ends = x[..., 2 * lag :] + x[..., : -2 * lag]
    ends *= 0.5
    return np.asarray(ends > x[..., lag:-lag])


def agreements(signs: NDArray[np.bool_], shifts: Iterable[int]) -> list[list[float]]:
    """Return the fraction of times t with equal signs at t and t + shift, for each shift and row."""
    rows = signs.reshape(-1, signs.shape[-1])
    same = (rows[:, shift:] == rows[:, :-shift] for shift in shifts)
    return [[np.count_nonzero(row) / row.size for row in rows] for rows in same]  # slower with axis=-1


@feature_in_samples("1", SIGNS, outputs="lag{lags}.step{steps}", depends_on=("rate", "sign"))
def slope_agreement(
    view: PhaseView, *, lags: tuple[int, ...] = LAGS, steps: tuple[int, ...] = (1, 2, 3)
) -> Samples:
    """Return how often a difference and its delayed copy have the same sign, at several lags.

    Let d_t = x_(t+lag) - x_t, which is a band-pass around fs/(2 lag). The value is the fraction of times t at
    which d_t and d_(t + step lag) have the same sign. For a Gaussian signal it is 1/2 + arcsin(r)/pi, where r
    is the correlation between d_t and its delayed copy. Zero differences count as negative. Therefore the
    value of a coarsely quantised signal changes if the signal is inverted.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    lags : tuple of int
        Lags of the differences, in samples.
    steps : tuple of int
        Delays of the copy, in multiples of the lag.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape (n_lags * n_steps,)
        Fractions from 0 to 1.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or shorter than twice the sum of the longest lag and the longest delay.

    References
    ----------
    Clipped autocorrelation: Van Vleck, "The spectrum of clipped noise", 1943.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> slope_agreement(x, fs=10_000, lags=(1,), steps=(1, 2)).round(2).tolist()  # white noise: 1/3, 1/2
    [0.33, 0.5]
    """
    require(view, 2 * max(lags) * (1 + max(steps)), "twice the longest lag and step")
    fractions = [row for lag in lags for row in agreements(rising(view, lag), [s * lag for s in steps])]
    return np.array(fractions).T.reshape(*view.samples.shape[:-1], -1)


@feature_in_samples("1", SIGNS, outputs="lag{lags}.step{steps}", depends_on=("rate", "sign"))
def curvature_agreement(
    view: PhaseView, *, lags: tuple[int, ...] = LAGS, steps: tuple[int, ...] = (1, 2, 3)
) -> Samples:
    """Return how often a second difference and its delayed copy have the same sign, at several lags.

    The definition is the same as in `slope_agreement`, but for the second difference, a narrower band-pass:
    x_(t+2 lag) - 2 x_(t+lag) + x_t.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    lags : tuple of int
        Lags of the second differences, in samples.
    steps : tuple of int
        Delays of the copy, in multiples of the lag.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape (n_lags * n_steps,)
        Fractions from 0 to 1.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or shorter than twice the sum of the longest span (two lags) and the longest
        delay.

    References
    ----------
    Clipped autocorrelation: Van Vleck, "The spectrum of clipped noise", 1943.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> curvature_agreement(x, fs=10_000, lags=(1,), steps=(1, 2)).round(2).tolist()
    [0.27, 0.56]
    """
    require(view, 2 * max(lags) * (2 + max(steps)), "twice the longest span and step")
    fractions = [row for lag in lags for row in agreements(convex(view, lag), [s * lag for s in steps])]
    return np.array(fractions).T.reshape(*view.samples.shape[:-1], -1)


@feature_in_samples(
    "log10(m/s^2)", "texclass; first-order structure function", outputs="lag{lags}", gain=Gain(shift=1)
)
def slope_level(view: PhaseView, *, lags: tuple[int, ...] = LAGS) -> Samples:
    """Return the mean magnitude of differences at several lags, log10 mean |x_(t+lag) - x_t|.

    A few strong events affect the mean magnitude less than the power of a band.

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
        Levels in log10(m/s^2).

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or shorter than twice the longest lag, or all differences at a lag are 0.

    References
    ----------
    First-order structure function.

    Examples
    --------
    >>> import numpy as np
    >>> walk = np.random.default_rng(0).standard_normal(10_000).cumsum()
    >>> slope_level(walk, fs=10_000, lags=(1, 2, 4)).round(2).tolist()  # +log10(2)/2 per octave
    [-0.1, 0.05, 0.21]
    """
    return slope_levels(view, lags)


@transform
def slope_levels(view: PhaseView, lags: tuple[int, ...]) -> Samples:
    """Return the values of `slope_level`, shape (..., n_lags)."""
    require(view, 2 * max(lags), "twice the longest lag")
    x = unit32(view)
    means = []
    for lag in lags:
        change = x[..., lag:] - x[..., :-lag]
        # Single precision is enough: numpy uses pairwise summation.
        means.append(np.abs(change, out=change).sum(axis=-1) / np.float64(change.shape[-1]))
    mean = np.array(means).T
    undefined_if(not mean.all(), "all differences at a lag are 0. Expected a positive mean magnitude")
    return np.asarray(np.log10(mean) + np.log10(level(view)))


@transform
def moments(view: PhaseView, lag: int) -> tuple[Samples, Samples]:
    """Return the mean square and the `SHAPES` of half the second difference at a lag.

    The half second difference is c_t = (x_(t+2 lag) + x_t)/2 - x_(t+lag), where x is the signal divided by
    `level`. For lag 0, c = x - mean x. The results have the shapes (...) and (..., 3).

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent, or c consists of rounding errors only.
    """
    x = unit32(view)
    if lag:
        c = x[..., 2 * lag :] + x[..., : -2 * lag]
        c *= 0.5
        c -= x[..., lag:-lag]
    else:
        c = x - (x.sum(axis=-1, keepdims=True, dtype=np.float64) / x.shape[-1]).astype(np.float32)
    return _shapes(c, f"the second difference at lag {lag}")


def _shapes(c: NDArray[np.float32], name: str) -> tuple[Samples, Samples]:
    """Return the mean square and the `SHAPES` of the samples; the samples are overwritten."""
    size, n = np.abs(c), c.shape[-1]
    sums = [size.sum(axis=-1), _dot(c, size)]
    c *= c
    sums += [c.sum(axis=-1), _dot(c, c)]
    first, signed, second, fourth = np.array(sums, dtype=np.float64) / n  # means of |c|, c |c|, c^2, c^4
    if not (smallest := second.min()) > MIN_RMS**2:
        raise UndefinedFeatureError(
            f"the RMS of {name} must be above {MIN_RMS:g} of the largest sample, got {np.sqrt(smallest):.2g}"
        )
    peakedness, evenness = np.log10(fourth / second**2), np.log10(first / np.sqrt(second))
    return second, np.array([signed / second, peakedness, evenness]).T


def _dot(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the dot products along the last axis."""
    return np.asarray((a[..., np.newaxis, :] @ b[..., np.newaxis])[..., 0, 0])


def shape_names(*, lags: tuple[int, ...]) -> tuple[str, ...]:
    """Return the output names of the `SHAPES` for several lags."""
    return tuple(f"lag{lag}.{shape}" for lag in lags for shape in SHAPES)


@feature("movement", "1", MOMENTS, outputs=SHAPES, depends_on=("sign",), divisible="at once")
def vibration_shape(view: PhaseView) -> Samples:
    """Return lopsidedness, peakedness and evenness of the samples about their mean; see `curvature_shape`.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape (3,)
        Lopsidedness, peakedness and evenness.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or has fewer than 32 samples.

    References
    ----------
    texclass; robust relatives of skewness and kurtosis.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> vibration_shape(x, fs=10_000).round(2).tolist()  # Gaussian noise: 0, log10(3), log10(sqrt(2/pi))
    [-0.01, 0.47, -0.1]
    """
    require(view, 32, "a shape")
    return moments(view, 0)[1]


@feature_in_samples(
    "1",
    MOMENTS,
    outputs=shape_names,
    depends_on=("rate", "sign"),
)
def curvature_shape(view: PhaseView, *, lags: tuple[int, ...] = LAGS) -> Samples:
    """Return lopsidedness, peakedness and evenness of second differences at several lags.

    Let c be the second difference at a lag:

    - Lopsidedness is mean(c |c|) / mean(c^2). It is 0 for a symmetric signal, and 1 or -1 if the signal bends
      to one side only. The sign depends on the mounting direction of the sensor.
    - Peakedness is log10(mean(c^4) / mean(c^2)^2), the logarithm of the kurtosis. It is 0.48 for Gaussian
      noise and larger for bursts.
    - Evenness is log10(mean |c| / RMS of c). It is -0.10 for Gaussian noise and close to 0 if |c| is
      constant.

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
    ndarray of shape (3 * n_lags,)
        Lopsidedness, peakedness and evenness of each lag.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or shorter than four times the longest lag, or all second differences at a
        lag are 0.

    References
    ----------
    texclass; moments of second differences.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000) ** 3  # bursts
    >>> curvature_shape(x, fs=10_000, lags=(1,)).round(2).tolist()
    [0.03, 1.28, -0.26]
    """
    require(view, 4 * max(lags), "four times the longest lag")
    return np.concatenate([moments(view, lag)[1] for lag in lags], axis=-1)


@feature_in_samples(
    "1",
    "texclass; moments of first differences",
    outputs=shape_names,
    depends_on=("rate", "sign"),
)
def slope_shape(view: PhaseView, *, lags: tuple[int, ...] = LAGS) -> Samples:
    """Return lopsidedness, peakedness and evenness of differences at several lags.

    The moments are defined in `curvature_shape`. Here they are computed for d_t = x_(t+lag) - x_t.
    Lopsidedness differs from 0 if rises are steeper than falls, or vice versa, as in stick-slip. A power
    spectrum does not show this, because it does not depend on the direction of time. In windows of 0.1 s,
    these moments separate surfaces that the level features cannot separate.

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
    ndarray of shape (3 * n_lags,)
        Lopsidedness, peakedness and evenness of each lag.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or shorter than twice the longest lag, or all differences at a lag are 0.

    References
    ----------
    texclass; moments of first differences.

    Examples
    --------
    >>> import numpy as np
    >>> saw = np.arange(10_000.0) % 20  # rises slowly, falls at once
    >>> slope_shape(saw, fs=10_000, lags=(1,)).round(2).tolist()
    [-0.9, 1.26, -0.36]
    """
    require(view, 2 * max(lags), "twice the longest lag")
    x = unit32(view)
    differences = ((x[..., lag:] - x[..., :-lag], f"the difference at lag {lag}") for lag in lags)
    return np.concatenate([_shapes(*difference)[1] for difference in differences], axis=-1)


@feature_in_samples("log10(m/s^2)", MOMENTS, outputs="lag{lags}", gain=Gain(shift=1))
def curvature_level(view: PhaseView, *, lags: tuple[int, ...] = LAGS) -> Samples:
    """Return the RMS level of half the second difference at several lags, in log10.

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
        Levels in log10(m/s^2).

    Raises
    ------
    UndefinedFeatureError
        If `curvature_shape` is undefined.

    References
    ----------
    texclass; moments of second differences.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.sin(2 * np.pi * 100 * np.arange(10_000) / 10_000)
    >>> curvature_level(x, fs=10_000, lags=(8, 16, 32)).round(2).tolist()
    [-1.06, -0.48, 0.0]
    """
    return curvature_levels(view, lags)


@transform
def curvature_levels(view: PhaseView, lags: tuple[int, ...]) -> Samples:
    """Return the values of `curvature_level`, shape (..., n_lags)."""
    require(view, 4 * max(lags), "four times the longest lag")
    rms = np.sqrt([moments(view, lag)[0] for lag in lags]).T
    return np.asarray(np.log10(rms) + np.log10(level(view)))


@feature(
    "movement",
    "log10(m/s^2)",
    "texclass; level of a vibration",
    outputs="rms",
    gain=Gain(shift=1),
    divisible="at once",
)
def vibration_level(view: PhaseView) -> Samples:
    """Return the RMS level of the samples about their mean, in log10.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape (1,)
        Level in log10(m/s^2).

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or has fewer than 32 samples.

    References
    ----------
    texclass; level of a vibration.

    Examples
    --------
    >>> import numpy as np
    >>> x = 3 * np.sin(2 * np.pi * 100 * np.arange(10_000) / 10_000)
    >>> vibration_level(x, fs=10_000).round(2).tolist()  # log10(3 / sqrt(2))
    [0.33]
    """
    require(view, 32, "a level")
    return np.asarray(np.log10(moments(view, 0)[0][..., np.newaxis]) / 2 + np.log10(level(view)))
