"""Figure 3.2: the spectral error of models of rising order, on the recording and on its other half."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from texclass.recording import Samples
from texclass.vibration import fit, select_order
from texclass.vibration.order import spectral_error
from texclass.vibration.scores import N_DFT

LARGEST = 1000
AT_MOST = 0.4


@dataclass(frozen=True, eq=False)
class OrderCurves:
    """Errors of the orders 0 ... largest on one recording.

    Attributes
    ----------
    curve, other_half : ndarray of shape (largest + 1,)
        RMS spectral error, eq. (3.11): fitted to and compared with the whole; fitted to one half and compared
        with the other, mean of both ways.
    floor, floor_of_half : float
        What the true model would keep, see `floor`.
    aicc, little : int
        Orders chosen by AICc, and beyond which little is gained.
    at_most : int or None
        Smallest order with an error of at most 0.4, if any has.
    """

    curve: Samples
    other_half: Samples
    floor: float
    floor_of_half: float
    aicc: int
    little: int
    at_most: int | None


def order_curves(x: Samples, *, largest: int = LARGEST) -> OrderCurves:
    """Return the curves of one recording without its mean, shape (n_samples,), by Burg's method."""
    little = select_order(x, largest)
    met = select_order(x, largest, at_most=AT_MOST)
    first, second = np.array_split(x, 2)
    both_ways = [spectral_error(b, fit(a, largest)) for a, b in ((first, second), (second, first))]
    return OrderCurves(
        little.values,
        np.mean(both_ways, axis=0),
        floor(x.size // N_DFT),
        floor(x.size // 2 // N_DFT),
        select_order(x, largest, criterion="aicc").order,
        little.order,
        met.order if met.met else None,
    )


def floor(n_segments: int) -> float:
    """Error that the true model keeps: |X|, the RMS over M segments of a Gaussian process, is not its mean.

    E |X| / |G| = Gamma(M + 1/2) / (Gamma(M) sqrt(M)), so C^2 = 2 - 2 E |X| / |G|.
    """
    mean = special.poch(n_segments, 0.5) / np.sqrt(n_segments)
    return float(np.sqrt(2 - 2 * mean))
