"""Correlations between the channels of a sensor, and clipping of a channel.

When a robot rolls, pitches and shakes on a floor, the correlations between its channels depend on the floor.
The spectrum of a single channel does not contain this information.
"""

import functools

import numpy as np

from texclass.features.contract import feature
from texclass.features.movement_filters import level, require, unit
from texclass.features.phase_view import PairView, PhaseView, transform
from texclass.recording import Samples


@functools.cache
def symmetric_lags(lags: tuple[int, ...]) -> tuple[int, ...]:
    """Return the lags and their negatives in ascending order."""
    return tuple(sorted({sign * lag for lag in lags for sign in (-1, 1)}))


@transform
def standardised(view: PhaseView) -> Samples:
    """Return the samples with mean 0 and Euclidean norm 1."""
    x = unit(view)
    x -= x.sum() / x.size
    x /= np.sqrt(x @ x)
    return x


@transform
def shifted(view: PhaseView, lags: tuple[int, ...]) -> Samples:
    """Return the `standardised` samples shifted by each lag, with zeros at the ends, shape (n_lags, n)."""
    x, n = standardised(view), view.n_samples
    rows = np.zeros((len(lags), n))
    for row, lag in zip(rows, lags, strict=True):
        row[max(-lag, 0) : n - max(lag, 0)] = x[max(lag, 0) : n - max(-lag, 0)]
    return rows


@feature(
    "pair",
    "1",
    "texclass; cross-correlation of two channels",
    outputs=lambda lags: tuple(f"lag{lag}" for lag in symmetric_lags(lags)),
    depends_on=("rate",),
    divisible=True,
)
def lag_correlation(view: PairView, *, lags: tuple[int, ...] = (0, 1, 2, 4)) -> Samples:
    """Return the correlation of two channels at several lags.

    The correlation is sum_t x_t y_(t+lag) / sqrt(sum x^2 sum y^2), where x and y are the channels without
    their means. It lies between -1 and 1 and does not depend on the units. A maximum at a positive lag means
    that the second channel follows the first.

    Parameters
    ----------
    view : PairView or array_like of shape (n, 2)
        Movements of two channels. For an array, also pass `fs` in Hz.
    lags : tuple of int
        Lags in samples (default 0, 1, 2, 4). The correlation is computed for each lag and its negative.

    Returns
    -------
    ndarray of shape (n_lags,)
        Correlations from the most negative to the most positive lag.

    Raises
    ------
    UndefinedFeatureError
        If a channel is silent, or the movement has fewer than 32 samples or is shorter than four times the
        longest lag.

    References
    ----------
    texclass; cross-correlation of two channels.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(1000)
    >>> pair = np.column_stack([x, np.roll(x, 2)])  # the second channel is 2 samples late
    >>> lag_correlation(pair, fs=100, lags=(0, 2)).round(1).tolist()  # lags -2, 0, 2
    [0.0, -0.0, 1.0]
    """
    require(view.sides[0], max(32, 4 * max(lags)), "four times the longest lag")
    first, second = view.sides
    return np.asarray(shifted(second, symmetric_lags(lags)) @ standardised(first))


@feature("movement", "1", "texclass; fraction of clipped samples", outputs="share")
def clipping(view: PhaseView) -> Samples:
    """Return the fraction of samples that repeat the largest or the smallest value.

    The fraction is 0 unless the sensor saturates. A gyroscope, for example, records its largest value when
    the rotation exceeds its range. The fraction of clipped samples then still indicates the strength of the
    vibration, although the recorded level does not.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.

    Returns
    -------
    ndarray of shape (1,)
        Fraction of clipped samples, 0 to 1.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or has fewer than 32 samples.

    References
    ----------
    texclass; fraction of clipped samples.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.sin(2 * np.pi * np.arange(1000) / 100)
    >>> clipping(np.clip(x, -0.9, 0.9), fs=100).round(1).tolist()
    [0.3]
    """
    require(view, 32, "a fraction")
    level(view)  # raises for silence
    x = view.samples
    low, high = x.min(), x.max()
    rounding = 1e-9 * high - 1e-9 * low  # relative to the range; high - low may overflow
    n_clipped = np.count_nonzero(x >= high - rounding) + np.count_nonzero(x <= low + rounding)
    return np.array([(n_clipped - 2) / x.size])
