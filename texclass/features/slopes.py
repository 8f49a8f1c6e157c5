"""Slopes and curvatures of a vibration over several spans of time: how large, how even, how they follow.

A spectrum says how strong each frequency is, not whether the strength comes in bursts, nor to which side
bumps and catches point. The curvature over a lag is a band-pass around fs/(3 lag) that costs two additions; a
few means of it answer both. The signs of slopes and curvatures are shape without level: a gain, a sensor that
drifts and single strong events change these little, and counting costs next to nothing.
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
"""Spans of time, in samples, from one octave to the next."""
SHAPES = ("lopsidedness", "peakedness", "evenness")
LEAST = 1e-6
"""Least root mean square, relative to the largest sample: below it, single precision says nothing."""


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
    """Return the shares of times t at which the signs at t and t + shift agree, of each shift and row."""
    rows = signs.reshape(-1, signs.shape[-1])
    same = (rows[:, shift:] == rows[:, :-shift] for shift in shifts)
    return [[np.count_nonzero(row) / row.size for row in rows] for rows in same]  # along an axis it is slow


@feature_in_samples("1", SIGNS, outputs="lag{lags}.step{steps}", depends_on=("rate", "sign"))
def slope_agreement(
    view: PhaseView, *, lags: tuple[int, ...] = LAGS, steps: tuple[int, ...] = (1, 2, 3)
) -> Samples:
    """Share of times at which two slopes some time apart have the same sign, at several time scales.

    With d_t = x_(t+lag) - x_t, the share of t with sign d_t = sign d_(t + step lag). For a Gaussian signal it
    is 1/2 + arcsin(r)/pi, r the correlation of the two; each lag is a band-pass around fs/(2 lag). A slope of
    0 counts as falling: of a signal that is coarsely quantised, the value depends on the sign.

    Parameters
    ----------
    view : PhaseView
        Movement.
    lags : tuple of int
        Spans of the slopes, in samples.
    steps : tuple of int
        Distances of the two slopes, in lags.
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        For silence, or a movement not twice as long as the longest lag and step together.
    """
    require(view, 2 * max(lags) * (1 + max(steps)), "slopes that far apart")
    shares = [each for lag in lags for each in agreements(rising(view, lag), [s * lag for s in steps])]
    return np.array(shares).T.reshape(*view.samples.shape[:-1], -1)


@feature_in_samples("1", SIGNS, outputs="lag{lags}.step{steps}", depends_on=("rate", "sign"))
def curvature_agreement(
    view: PhaseView, *, lags: tuple[int, ...] = LAGS, steps: tuple[int, ...] = (1, 2, 3)
) -> Samples:
    """Share of times at which two curvatures some time apart have the same sign, at several time scales.

    As `slope_agreement`, with the second difference x_(t+2 lag) - 2 x_(t+lag) + x_t: a narrower band-pass.

    Parameters
    ----------
    view : PhaseView
        Movement.
    lags : tuple of int
        Half the spans of the curvatures, in samples.
    steps : tuple of int
        Distances of the two curvatures, in lags.
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        As `slope_agreement`, for a movement twice as long as the longest span and step together.
    """
    require(view, 2 * max(lags) * (2 + max(steps)), "curvatures that far apart")
    shares = [each for lag in lags for each in agreements(convex(view, lag), [s * lag for s in steps])]
    return np.array(shares).T.reshape(*view.samples.shape[:-1], -1)


@feature_in_samples(
    "log10(m/s^2)", "texclass; first-order structure function", outputs="lag{lags}", gain=Gain(shift=1)
)
def slope_level(view: PhaseView, *, lags: tuple[int, ...] = LAGS) -> Samples:
    """Mean magnitude of the change over several spans of time, log10 mean |x_(t+lag) - x_t|.

    Beside the power of a band, which single strong events may make up, the magnitude says how much the
    vibration changes most of the time.

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
        For silence, a movement not twice as long as the longest lag, or one that does not change over a lag.
    """
    return slope_levels(view, lags)


@transform
def slope_levels(view: PhaseView, lags: tuple[int, ...]) -> Samples:
    """Return what `slope_level` is, shape (..., n_lags)."""
    require(view, 2 * max(lags), "slopes of that span")
    x = unit32(view)
    means = []
    for lag in lags:
        change = x[..., lag:] - x[..., :-lag]
        # numpy adds in pairs: single precision is enough
        means.append(np.abs(change, out=change).sum(axis=-1) / np.float64(change.shape[-1]))
    mean = np.array(means).T
    undefined_if(not mean.all(), "the mean change is 0. Expected a positive value, for its logarithm")
    return np.asarray(np.log10(mean) + np.log10(level(view)))


@transform
def moments(view: PhaseView, lag: int) -> tuple[Samples, Samples]:
    """Return the mean square (...) and the `SHAPES` (..., 3) of c_t = (x_(t+2 lag) + x_t)/2 - x_(t+lag).

    Of the samples divided by `level`; for lag 0, of x - mean x.

    Raises
    ------
    UndefinedFeatureError
        For silence, or if c stays within rounding.
    """
    x = unit32(view)
    if lag:
        c = x[..., 2 * lag :] + x[..., : -2 * lag]
        c *= 0.5
        c -= x[..., lag:-lag]
    else:
        c = x - (x.sum(axis=-1, keepdims=True, dtype=np.float64) / x.shape[-1]).astype(np.float32)
    return _shapes(c, f"the curvature over {lag} samples")


def _shapes(c: NDArray[np.float32], what: str) -> tuple[Samples, Samples]:
    """Return the mean square (...) and the `SHAPES` (..., 3) of some samples, which are overwritten."""
    size, n = np.abs(c), c.shape[-1]
    sums = [size.sum(axis=-1), _dot(c, size)]
    c *= c
    sums += [c.sum(axis=-1), _dot(c, c)]
    first, signed, second, fourth = np.array(sums, dtype=np.float64) / n  # means of |c|, c |c|, c^2, c^4
    if not (least := second.min()) > LEAST**2:
        raise UndefinedFeatureError(
            f"{what} is {np.sqrt(least):.2g} of the largest sample. Expected more than {LEAST:g}"
        )
    peakedness, evenness = np.log10(fourth / second**2), np.log10(first / np.sqrt(second))
    return second, np.array([signed / second, peakedness, evenness]).T


def _dot(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the dot products along the last axis."""
    return np.asarray((a[..., np.newaxis, :] @ b[..., np.newaxis])[..., 0, 0])


def shape_names(*, lags: tuple[int, ...]) -> tuple[str, ...]:
    """Return the names of the `SHAPES` of several lags."""
    return tuple(f"lag{lag}.{shape}" for lag in lags for shape in SHAPES)


@feature("movement", "1", MOMENTS, outputs=SHAPES, depends_on=("sign",), divisible="at once")
def vibration_shape(view: PhaseView) -> Samples:
    """Lopsidedness, peakedness and evenness of the samples about their mean; see `curvature_shape`.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        For silence, or fewer than 32 samples.
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
    """Lopsidedness, peakedness and evenness of the curvature over several spans of time.

    With c the second difference over a lag: lopsidedness is mean(c |c|) / mean(c^2), 0 for what is the same
    upside down and +-1 for what bends to one side only; peakedness is log10(mean(c^4) / mean(c^2)^2), 0.48
    for noise and more for bursts; evenness is log10(mean |c| / rms c), -0.10 for noise, near 0 where c always
    has the same size. The sign of lopsidedness is that of the sensor's mounting.

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
        For silence, a movement not four times as long as the longest lag, or one that does not bend over a
        lag.
    """
    require(view, 4 * max(lags), "curvatures of that span")
    return np.concatenate([moments(view, lag)[1] for lag in lags], axis=-1)


@feature_in_samples(
    "1",
    "texclass; moments of first differences",
    outputs=shape_names,
    depends_on=("rate", "sign"),
)
def slope_shape(view: PhaseView, *, lags: tuple[int, ...] = LAGS) -> Samples:
    """Lopsidedness, peakedness and evenness of the change over several spans of time.

    As `curvature_shape`, of d_t = x_(t+lag) - x_t. Lopsidedness is not 0 where rises are steeper than falls,
    as where something sticks slowly and slips at once: a spectrum does not know which way time runs. A touch
    of a tenth of a second tells surfaces apart by it that no level can.

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
        For silence, a movement not twice as long as the longest lag, or one that does not change over a lag.
    """
    require(view, 2 * max(lags), "slopes of that span")
    x = unit32(view)
    changes = ((x[..., lag:] - x[..., :-lag], f"the change over {lag} samples") for lag in lags)
    return np.concatenate([_shapes(*change)[1] for change in changes], axis=-1)


@feature_in_samples("log10(m/s^2)", MOMENTS, outputs="lag{lags}", gain=Gain(shift=1))
def curvature_level(view: PhaseView, *, lags: tuple[int, ...] = LAGS) -> Samples:
    """Root mean square of half the second difference over several spans of time, log10.

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
        As `curvature_shape`.
    """
    return curvature_levels(view, lags)


@transform
def curvature_levels(view: PhaseView, lags: tuple[int, ...]) -> Samples:
    """Return what `curvature_level` is, shape (..., n_lags)."""
    require(view, 4 * max(lags), "curvatures of that span")
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
    """Root mean square of the samples about their mean, log10.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        As `vibration_shape`.
    """
    require(view, 32, "a level")
    return np.asarray(np.log10(moments(view, 0)[0][..., np.newaxis]) / 2 + np.log10(level(view)))
