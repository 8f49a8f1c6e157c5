"""Slopes and curvatures over several spans of time: how large, and how their signs follow each other.

Signs are shape without level. Whether two slopes have the same sign needs no scale, so a gain, a sensor that
drifts and single strong events change these little, and counting costs next to nothing.
"""

import numpy as np
from numpy.typing import NDArray

from texclass.features.contract import Gain, feature
from texclass.features.divided import divisible, named_pieces
from texclass.features.transforms import level, log10_of, require, unit32
from texclass.features.view import PhaseView, transform
from texclass.recording import Samples

REFERENCE = "texclass; clipped autocorrelation (Van Vleck, 1943) of differences"


@transform
def rising(view: PhaseView, lag: int) -> NDArray[np.bool_]:
    """Return whether x_(t+lag) > x_t, shape (n - lag,)."""
    x = unit32(view)
    return np.asarray(x[lag:] > x[:-lag])


@transform
def convex(view: PhaseView, lag: int) -> NDArray[np.bool_]:
    """Return whether x_(t+2 lag) + x_t > 2 x_(t+lag), shape (n - 2 lag,)."""
    x = unit32(view)
    ends = x[2 * lag :] + x[: -2 * lag]
    ends *= 0.5
    return np.asarray(ends > x[lag:-lag])


def agreement(signs: NDArray[np.bool_], shift: int) -> float:
    """Return the share of times t at which the signs at t and t + shift agree."""
    return float(np.count_nonzero(signs[shift:] == signs[:-shift]) / (signs.size - shift))


def _names(*, lags: tuple[int, ...], steps: tuple[int, ...]) -> tuple[str, ...]:
    return tuple(f"lag{lag}.step{step}" for lag in lags for step in steps)


@feature(phase="movement", unit="1", reference=REFERENCE, outputs=named_pieces(_names), depends_on=("rate",))
@divisible
def slope_agreement(
    view: PhaseView, *, lags: tuple[int, ...] = (1, 2, 4, 8, 16, 32), steps: tuple[int, ...] = (1, 2, 3)
) -> Samples:
    """Share of times at which two slopes some time apart have the same sign, at several time scales.

    With d_t = x_(t+lag) - x_t, the share of t with sign d_t = sign d_(t + step lag). For a Gaussian signal it
    is 1/2 + arcsin(r)/pi, r the correlation of the two; each lag is a band-pass around fs/(2 lag).

    Parameters
    ----------
    view : PhaseView
        Movement.
    lags : tuple of int
        Spans of the slopes, in samples.
    steps : tuple of int
        Distances of the two slopes, in lags.
    n_pieces : int
        Equal pieces to compute it of, each by itself; see `divisible`.

    Raises
    ------
    UndefinedFeatureError
        For silence, or a movement not twice as long as the longest lag and step together.
    """
    require(view, 2 * max(lags) * (1 + max(steps)), "slopes that far apart")
    return np.array([agreement(rising(view, lag), step * lag) for lag in lags for step in steps])


@feature(phase="movement", unit="1", reference=REFERENCE, outputs=named_pieces(_names), depends_on=("rate",))
@divisible
def curvature_agreement(
    view: PhaseView, *, lags: tuple[int, ...] = (1, 2, 4, 8, 16, 32), steps: tuple[int, ...] = (1, 2, 3)
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
    n_pieces : int
        Equal pieces to compute it of, each by itself; see `divisible`.

    Raises
    ------
    UndefinedFeatureError
        As `slope_agreement`, for a movement twice as long as the longest span and step together.
    """
    require(view, 2 * max(lags) * (2 + max(steps)), "curvatures that far apart")
    return np.array([agreement(convex(view, lag), step * lag) for lag in lags for step in steps])


def lag_names(*, lags: tuple[int, ...]) -> tuple[str, ...]:
    """Return a name for each lag."""
    return tuple(f"lag{lag}" for lag in lags)


@feature(
    phase="movement",
    unit="log10(m/s^2)",
    reference="texclass; first-order structure function",
    outputs=named_pieces(lag_names),
    gain=Gain(shift=1),
    depends_on=("rate",),
)
@divisible
def slope_level(view: PhaseView, *, lags: tuple[int, ...] = (1, 2, 4, 8, 16, 32)) -> Samples:
    """Mean magnitude of the change over several spans of time, log10 mean |x_(t+lag) - x_t|.

    Beside the power of a band, which single strong events may make up, the magnitude says how much the
    vibration changes most of the time.

    Parameters
    ----------
    view : PhaseView
        Movement.
    lags : tuple of int
        Spans, in samples.
    n_pieces : int
        Equal pieces to compute it of, each by itself; see `divisible`.

    Raises
    ------
    UndefinedFeatureError
        For silence, a movement not twice as long as the longest lag, or one that does not change over a lag.
    """
    require(view, 2 * max(lags), "slopes of that span")
    x = unit32(view)
    means = [_mean_size(x[lag:] - x[:-lag]) for lag in lags]
    return np.asarray([log10_of(m, "the mean change") for m in means] + np.log10(level(view)))


def _mean_size(d: NDArray[np.float32]) -> float:
    return float(np.abs(d, out=d).sum()) / d.size  # numpy adds in pairs: single precision is enough
