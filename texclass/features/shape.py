"""The shape of a vibration at several time scales: how lopsided, how peaked, how even, and how strong.

A spectrum says how strong each frequency is, not whether the strength comes in bursts, nor to which side
bumps and catches point. The curvature over a lag is a band-pass around fs/(3 lag) that costs two additions;
a few means of it answer both.
"""

from typing import NamedTuple

import numpy as np

from texclass.features.contract import Gain, UndefinedFeatureError, feature
from texclass.features.differences import lag_names
from texclass.features.divided import divisible, named_pieces
from texclass.features.transforms import level, require, unit32
from texclass.features.view import PhaseView, transform
from texclass.recording import Samples

REFERENCE = "texclass; moments of second differences"
SHAPES = ("lopsidedness", "peakedness", "evenness")
LEAST = 1e-6
"""Least root mean square, relative to the largest sample: below it, single precision says nothing."""


class Moments(NamedTuple):
    """Means over time of a signal c: of |c|, c^2, c |c| and c^4."""

    first: float
    second: float
    signed: float
    fourth: float


@transform
def moments(view: PhaseView, lag: int) -> Moments:
    """Return the moments of c_t = (x_(t+2 lag) + x_t)/2 - x_(t+lag); of x - mean x for lag 0.

    Of the samples divided by `level`.

    Raises
    ------
    UndefinedFeatureError
        For silence, or if c stays within rounding.
    """
    x = unit32(view)
    if lag:
        c = x[2 * lag :] + x[: -2 * lag]
        c *= 0.5
        c -= x[lag:-lag]
    else:
        c = x - x.mean(dtype=np.float64).astype(np.float32)
    size, n = np.abs(c), c.size
    first, signed = float(size.sum()) / n, float(np.dot(c, size)) / n
    c *= c
    second, fourth = float(c.sum()) / n, float(np.dot(c, c)) / n
    if not second > LEAST**2:
        raise UndefinedFeatureError(
            f"the curvature over {lag} samples is {np.sqrt(second):.2g} of the largest sample; "
            f"the rule is more than {LEAST:g}"
        )
    return Moments(first, second, signed, fourth)


def shape_of(m: Moments) -> tuple[float, float, float]:
    """Return lopsidedness, peakedness and evenness; see `curvature_shape`."""
    peakedness = np.log10(m.fourth / m.second**2)
    return m.signed / m.second, float(peakedness), float(np.log10(m.first / np.sqrt(m.second)))


def _shapes() -> tuple[str, ...]:
    return SHAPES


def _shapes_of_lags(*, lags: tuple[int, ...]) -> tuple[str, ...]:
    return tuple(f"lag{lag}.{shape}" for lag in lags for shape in SHAPES)


def _one() -> tuple[str, ...]:
    return ("rms",)


@feature(phase="movement", unit="1", reference=REFERENCE, outputs=named_pieces(_shapes))
@divisible
def vibration_shape(view: PhaseView) -> Samples:
    """Lopsidedness, peakedness and evenness of the samples about their mean; see `curvature_shape`.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_pieces : int
        Equal pieces to compute it of, each by itself; see `divisible`.

    Raises
    ------
    UndefinedFeatureError
        For silence, or fewer than 32 samples.
    """
    require(view, 32, "a shape")
    return np.array(shape_of(moments(view, 0)))


@feature(
    phase="movement",
    unit="1",
    reference=REFERENCE,
    outputs=named_pieces(_shapes_of_lags),
    depends_on=("rate",),
)
@divisible
def curvature_shape(view: PhaseView, *, lags: tuple[int, ...] = (1, 2, 4, 8, 16, 32)) -> Samples:
    """Lopsidedness, peakedness and evenness of the curvature over several spans of time.

    With c the second difference over a lag: lopsidedness is mean(c |c|) / mean(c^2), 0 for what is the same
    upside down and +-1 for what bends to one side only; peakedness is log10(mean(c^4) / mean(c^2)^2), 0.48
    for noise and more for bursts; evenness is log10(mean |c| / rms c), -0.10 for noise, near 0 where c always
    has the same size.

    Parameters
    ----------
    view : PhaseView
        Movement.
    lags : tuple of int
        Half the spans of the curvatures, in samples.
    n_pieces : int
        Equal pieces to compute it of, each by itself; see `divisible`.

    Raises
    ------
    UndefinedFeatureError
        For silence, a movement not four times as long as the longest lag, or one that does not bend over a
        lag.
    """
    require(view, 4 * max(lags), "curvatures of that span")
    return np.array([value for lag in lags for value in shape_of(moments(view, lag))])


@feature(
    phase="movement",
    unit="log10(m/s^2)",
    reference=REFERENCE,
    outputs=named_pieces(lag_names),
    gain=Gain(shift=1),
    depends_on=("rate",),
)
@divisible
def curvature_level(view: PhaseView, *, lags: tuple[int, ...] = (1, 2, 4, 8, 16, 32)) -> Samples:
    """Root mean square of half the second difference over several spans of time, log10.

    Parameters
    ----------
    view : PhaseView
        Movement.
    lags : tuple of int
        Half the spans of the curvatures, in samples.
    n_pieces : int
        Equal pieces to compute it of, each by itself; see `divisible`.

    Raises
    ------
    UndefinedFeatureError
        As `curvature_shape`.
    """
    require(view, 4 * max(lags), "curvatures of that span")
    rms = np.sqrt([moments(view, lag).second for lag in lags])
    return np.asarray(np.log10(rms) + np.log10(level(view)))


@feature(
    phase="movement",
    unit="log10(m/s^2)",
    reference="texclass; level of a vibration",
    outputs=named_pieces(_one),
    gain=Gain(shift=1),
)
@divisible
def vibration_level(view: PhaseView) -> Samples:
    """Root mean square of the samples about their mean, log10.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_pieces : int
        Equal pieces to compute it of, each by itself; see `divisible`.

    Raises
    ------
    UndefinedFeatureError
        As `vibration_shape`.
    """
    require(view, 32, "a level")
    return np.array([np.log10(moments(view, 0).second) / 2 + np.log10(level(view))])
