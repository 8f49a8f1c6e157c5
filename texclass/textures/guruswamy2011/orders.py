"""One segment fitted by filters of several orders, figure 4 of `guruswamy2011`."""

from dataclasses import dataclass

import numpy as np

from texclass.recording import Samples
from texclass.textures.guruswamy2011.responses import fit_modes, fit_sinusoid
from texclass.vibration.decaying_modes import DecayingModes
from texclass.vibration.prony import prony

ORDERS = (11, 16, 106)


@dataclass(frozen=True, eq=False)
class OrderFit:
    """A segment and its fit.

    Attributes
    ----------
    method : str
    order : int
        Poles.
    pole_radius : float
        Magnitude of the outermost pole.
    error : float
        Mean absolute difference, in the unit of the segment.
    response : ndarray of shape (n_samples,)
    """

    method: str
    order: int
    pole_radius: float
    error: float
    response: Samples


def fits_by_order(piece: Samples, fs: float, resolution: float) -> list[OrderFit]:
    """Fit a segment by the decaying sinusoid, by Prony's method at the paper's orders, by modes."""
    fits = [_of_modes("decaying sinusoid", fit_sinusoid(piece, fs), piece, fs)]
    for order in ORDERS:
        filter_ = prony(piece, order)
        with np.errstate(over="ignore", invalid="ignore"):
            response = filter_.synthesize(piece.size)
        fits.append(OrderFit("Prony", order, filter_.pole_radius, filter_.error, response))
    return [*fits, _of_modes("stable modes", fit_modes(piece, fs, resolution), piece, fs)]


def _of_modes(method: str, modes: DecayingModes, piece: Samples, fs: float) -> OrderFit:
    response = modes.synthesize(piece.size, fs)
    radius = float(np.exp(-modes.decay_per_s.min(initial=np.inf) / fs))
    order = int(np.sum(1 + (modes.frequency_hz > 0)))
    return OrderFit(method, order, radius, float(np.mean(np.abs(piece - response))), response)
