"""The normalised lattice: an autoregressive model made to sound, and undone, sample by sample.

Stage m turns the forward residual f_m of this sample and the backward residual b_{m-1} of the last one::

    f_{m-1} = c f_m - k b_{m-1},    b_m = k f_m + c b_{m-1},    c = sqrt(1 - k^2)

from the excitation f_p down to f_0, and the signal is level f_0. Every stage is a rotation, so the energy of
the states never grows, whatever the k and however they change, and rounding cannot make it: k and c are
shrunk by twice the machine epsilon, more than the rounding of a stage. With white excitation of unit
variance all states have unit variance and are uncorrelated, so the signal has the RMS `level` at every
sample, even while the parameters move. gain e[t] drives the same model in direct form, gain = level prod c.
"""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.vibration import _lattice_kernels as kernels
from texclass.vibration._autoregression import Autoregression
from texclass.vibration._moving_lattice import Lattice, Real

__all__ = ["Lattice", "LatticeInverse", "LatticeSynthesis", "synthesize", "whiten"]


class LatticeSynthesis(Lattice):
    """Turn white excitation of unit variance into the vibration of a model; parameters as for `Lattice`.

    Examples
    --------
    >>> import numpy as np
    >>> lattice = LatticeSynthesis(Autoregression([-0.9, 0.5], 1.0))
    >>> lattice.process([1.0, 0.0, 0.0]).round(6)
    array([1.    , 1.35  , 1.3225])
    """

    def settle(self, rng: np.random.Generator) -> Self:
        """Draw the state of a process that has gone on for ever: the sound starts without a transient.

        The states of the normalised lattice are uncorrelated and of unit variance.
        """
        self._b[: self.order] = rng.standard_normal(self.order)
        return self

    def _pass(self, x: Real) -> None:
        k, c = self._rotation
        if self.order >= kernels.WAVE_ORDER and x.size >= 32:
            kernels.synthesize_front(x, k, c, self._b)
        else:
            whole = x.size // 4 * 4 if self.order >= kernels.FOURS_ORDER else 0
            kernels.synthesize_fours(x[:whole], k, c, self._b)
            kernels.synthesize(x[whole:], k, c, self._b)
        x *= self.dtype.type(self._level)

    def _pass_rows(self, x: Real, k: Real, c: Real, level: Real) -> None:
        kernels.synthesize_rows(x, k, c, self._b)
        x *= level


class LatticeInverse(Lattice):
    """Turn a vibration back into the excitation: undo `LatticeSynthesis`, moving parameters included.

    Parameters as for `Lattice`; a level of 0 is refused, as nothing comes back from silence. For a signal
    that the model fits, the result is white with unit variance; times the gain it is the prediction error.
    """

    def _check_level(self, level: Samples) -> None:
        super()._check_level(level)
        if np.any(level == 0):
            raise ValueError("level is 0; the rule for inverse filtering is a level above 0")

    def _pass(self, x: Real) -> None:
        x /= self.dtype.type(self._level)
        kernels.whiten(x, *self._rotation, self._b)

    def _pass_rows(self, x: Real, k: Real, c: Real, level: Real) -> None:
        x /= level
        kernels.whiten_rows(x, k, c, self._b)


def synthesize(model: Autoregression, n: int, rng: np.random.Generator) -> Samples:
    """Return n samples of the stationary Gaussian process of a model, from its first sample on.

    Parameters
    ----------
    model : Autoregression
        Of one signal.
    n : int
        Number of samples.
    rng : numpy.random.Generator
        Draws the states the process is met in and its excitation.

    Returns
    -------
    ndarray of shape (n,)
        In the unit of the model.
    """
    lattice = LatticeSynthesis(model).settle(rng)
    return np.asarray(lattice.process(rng.standard_normal(n)), dtype=np.float64)


def whiten(model: Autoregression, x: ArrayLike) -> Samples:
    """Return the excitation (unit variance) a model needs to sound like `x`, silence before it.

    Parameters
    ----------
    model : Autoregression
        Of one signal.
    x : array_like of shape (n,)
        In the unit of the model.

    Returns
    -------
    ndarray of shape (n,)
    """
    return np.asarray(LatticeInverse(model).process(x), dtype=np.float64)
