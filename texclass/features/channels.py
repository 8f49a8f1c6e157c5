"""What several channels of a sensor tell together, and where one of them ends.

A robot that rolls, pitches and shakes at once moves its channels together in a way of its own on each floor:
how closely, and which follows which, no spectrum of one channel says.
"""

import functools

import numpy as np

from texclass.features.contract import feature
from texclass.features.movement_filters import level, require, unit
from texclass.features.phase_view import PairView, PhaseView, transform
from texclass.recording import Samples


@functools.cache
def both_ways(lags: tuple[int, ...]) -> tuple[int, ...]:
    """Return lags and what they are the other way, in order."""
    return tuple(sorted({way * lag for lag in lags for way in (-1, 1)}))


@transform
def standardised(view: PhaseView) -> Samples:
    """Return the samples about their mean, over their deviation and the root of their number: x.x = 1."""
    x = unit(view)
    x -= x.sum() / x.size
    x /= np.sqrt(x @ x)
    return x


@transform
def shifted(view: PhaseView, lags: tuple[int, ...]) -> Samples:
    """Return the `standardised` samples a lag later, 0 where there are none, shape (n_lags, n)."""
    x, n = standardised(view), view.n_samples
    later = np.zeros((len(lags), n))
    for row, lag in zip(later, lags, strict=True):
        row[max(-lag, 0) : n - max(lag, 0)] = x[max(lag, 0) : n - max(-lag, 0)]
    return later


@feature(
    "pair",
    "1",
    "texclass; cross-correlation of two channels",
    outputs=lambda lags: tuple(f"lag{lag}" for lag in both_ways(lags)),
    depends_on=("rate",),
)
def lag_correlation(view: PairView, *, lags: tuple[int, ...] = (0, 1, 2, 4)) -> Samples:
    """Correlation of two channels, one of them some samples later.

    With both channels about their means, sum_t x_t y_(t+lag) / sqrt(sum x^2 sum y^2): from -1 to 1, whatever
    the units; of a positive lag, the second channel follows the first.

    Parameters
    ----------
    view : PairView
        Movements of two channels.
    lags : tuple of int
        In samples; each counts both ways.

    Returns
    -------
    ndarray of shape (n_lags,)
        From the most negative lag to the most positive one.

    Raises
    ------
    UndefinedFeatureError
        For silence in a channel, or a movement not four times as long as the longest lag, or of fewer than 32
        samples.
    """
    require(view.sides[0], max(32, 4 * max(lags)), "correlations that far apart")
    one, other = view.sides
    return np.asarray(shifted(other, both_ways(lags)) @ standardised(one))


@feature("movement", "1", "texclass; share of clipped samples", outputs="share")
def clipping(view: PhaseView) -> Samples:
    """Share of samples that repeat the largest or the smallest value: 0 unless a sensor ends there.

    A turn rate beyond the range of its sensor stays at the last number that it can tell. How long it does
    says how much a surface shakes, where the level cannot say it any more.

    Parameters
    ----------
    view : PhaseView
        Movement.

    Returns
    -------
    ndarray of shape (1,)

    Raises
    ------
    UndefinedFeatureError
        For silence, or fewer than 32 samples.
    """
    require(view, 32, "a share")
    level(view)  # refuses silence
    x = view.samples
    low, high = x.min(), x.max()
    rounding = 1e-9 * high - 1e-9 * low  # of the range, whose difference itself may overflow
    n_held = np.count_nonzero(x >= high - rounding) + np.count_nonzero(x <= low + rounding)
    return np.array([(n_held - 2) / x.size])
