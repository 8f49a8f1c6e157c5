"""Prony's method as published, kept for comparison; `decaying_modes` holds the default fit."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from texclass.recording import Samples
from texclass.signals import one_channel, to_unit_scale


@dataclass(frozen=True, eq=False)
class PronyFilter:
    """H(z) = sum_i b_i z^-i / sum_i a_i z^-i with M = N, whose impulse response stands for a segment.

    It is what the method gave: whether it is stable is stated, not ensured.

    Attributes
    ----------
    b, a : ndarray of shape (order + 1,)
        Numerator (unit of the segment) and denominator (a_0 = 1).
    error : float
        Mean absolute difference of the impulse response to the segment, in the unit of the segment; infinite
        if the response overflows within the segment.
    resolved : bool
        Whether the error came to lie below the resolution that was asked for.
    """

    b: Samples
    a: Samples
    error: float
    resolved: bool

    @property
    def order(self) -> int:
        """Order N of the denominator and M = N of the numerator."""
        return self.a.size - 1

    @property
    def pole_radius(self) -> float:
        """Magnitude of the outermost pole, that of the companion matrix of `a`; 0 without poles."""
        return float(np.max(np.abs(np.roots(self.a)), initial=0.0))

    @property
    def is_stable(self) -> bool:
        """Whether all poles lie inside the unit circle."""
        return self.pole_radius < 1

    def synthesize(self, n_samples: int) -> Samples:
        """Return the impulse response, shape (n_samples,), at the rate of the segment, in direct form.

        An unstable filter grows without bound: to infinity and NaN, if `n_samples` is large enough.
        """
        from scipy import signal

        impulse = np.zeros(n_samples)
        impulse[:1] = 1.0
        return np.asarray(signal.lfilter(self.b, self.a, impulse))


def fit_prony(
    x: ArrayLike, resolution: float, *, least_order: int | None = None, max_order: int | None = None
) -> PronyFilter:
    """Fit a filter of the smallest order that meets the sensor's resolution, by Prony's method.

    The order starts at the number of extrema of the segment and is raised by one until the mean absolute
    error (1/n) sum |x - h| of the impulse response h falls below the resolution.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Segment that starts at the onset of a decaying vibration. Any unit, at least 2 samples.
    resolution : float
        In the unit of `x`, above 0; the paper's is one bit, 0.153 m/s^2.
    least_order : int, optional
        First order tried instead of the number of extrema (at least 1).
    max_order : int, optional
        Last order tried; n_samples - 1 by default, where the numerator alone can hold the segment.

    Returns
    -------
    PronyFilter
        The first one that meets the resolution, stable or not; otherwise that of the least error.

    Raises
    ------
    ValueError
        For fewer than 2 samples, more than one channel, NaN or infinity, a resolution that is not above 0, or
        a first order beyond `max_order` or below 1.

    References
    ----------
    `guruswamy2011`, section IV-A; its denominators of section III with M = N.
    """
    samples = one_channel(x, "segment", at_least=2)
    last = samples.size - 1 if max_order is None else max_order
    first = min(max(n_extrema(samples), 1), last) if least_order is None else least_order
    if not resolution > 0:
        raise ValueError(f"resolution is {resolution}; the rule is above 0, in the unit of the segment")
    if not 1 <= first <= last:
        raise ValueError(f"orders run from {first} to {last}; the rule is 1 <= first <= last")
    best = prony(samples, first, resolution)
    for order in range(first + 1, last + 1):
        if best.resolved:
            break
        tried = prony(samples, order, resolution)
        best = tried if tried.error < best.error else best
    return best


def prony(x: ArrayLike, order: int, resolution: float = 0.0) -> PronyFilter:
    """Fit the filter of one order M = N by Prony's method.

    Past sample M the impulse response obeys h_n = -sum_(k=1..N) a_k h_(n-k): the a_k are the least-squares
    solution over n = M+1 ... of the segment. The numerator makes the first M+1 samples exact,
    b_n = sum_(k=0..n) a_k h_(n-k). A segment shorter than M + N + 2 samples is padded with zeros to that
    length.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Segment. Any unit.
    order : int
        At least 1.
    resolution : float
        Only decides `resolved`.

    Returns
    -------
    PronyFilter

    Raises
    ------
    ValueError
        For an empty segment, more than one channel, NaN or infinity, or an order below 1.

    References
    ----------
    `guruswamy2011`, section IV-A.

    Examples
    --------
    >>> from scipy import signal
    >>> h = signal.lfilter([1.0, 0.4], [1.0, -1.5, 0.8], np.eye(1, 40)[0])
    >>> prony(h, 2).a.round(9)
    array([ 1. , -1.5,  0.8])
    """
    from scipy import signal

    samples = one_channel(x, "segment")
    if order < 1:
        raise ValueError(f"order is {order}; the rule is at least 1")
    h, exponent = to_unit_scale(samples)
    padded = np.pad(h, (0, max(0, 2 * order + 2 - h.size)))
    past = linalg.toeplitz(padded[order:-1], padded[order::-1][:order])
    a = np.concatenate([[1.0], linalg.lstsq(past[:, :order], -padded[order + 1 :])[0]])
    b = np.convolve(a, padded[: order + 1])[: order + 1]
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        response = signal.lfilter(b, a, np.eye(1, h.size)[0])
        error = float(np.ldexp(np.mean(np.abs(response - h)), exponent))
        error = error if np.isfinite(error) else np.inf
        return PronyFilter(np.ldexp(b, exponent), a, error, error < resolution)


def n_extrema(x: ArrayLike) -> int:
    """Return how many local maxima and minima lie inside a segment; a plateau counts once."""
    slopes = np.sign(np.diff(np.asarray(x, dtype=np.float64)))
    slopes = slopes[slopes != 0]
    return int(np.sum(slopes[1:] != slopes[:-1]))
