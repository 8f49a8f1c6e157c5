"""The normalised lattice: an autoregressive model made to sound, and undone, sample by sample.

Stage m turns the forward residual f_m of this sample and the backward residual b_{m-1} of the last one::

    f_{m-1} = c f_m - k b_{m-1},    b_m = k f_m + c b_{m-1},    c = sqrt(1 - k^2)

from the excitation f_p down to f_0, and the signal is level f_0. Every stage is a rotation, so the energy of
the states never grows, whatever the k and however they change, and rounding cannot make it: k and c are
shrunk by twice the machine epsilon, more than the rounding of a stage. With white excitation of unit
variance all states have unit variance and are uncorrelated, so the signal has the RMS `level` at every
sample, even while the parameters move. gain e[t] drives the same model in direct form, gain = level prod c.
"""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from texclass.recording import Samples
from texclass.vibration import lattice_kernels as kernels
from texclass.vibration.autoregressive import Autoregression

Real = NDArray[np.floating[Any]]

_CHUNK = 4096


class Lattice:
    """Parameters, and the state between calls: what both directions share.

    Parameters
    ----------
    model : Autoregression
        Of one signal: leading shape ().
    level : float, optional
        RMS of the signal in its unit; that of the model by default. To be given where gain / prod c exceeds
        the range of a float, as for 1000 times k = 0.9.
    dtype : float64 or float32
        Of the arithmetic and the result. Float32 costs 1e-7 per stage and sample, and a pole closer to the
        unit circle than that sounds like one at that distance.

    Raises
    ------
    ValueError
        If the model is a stack, its level not finite or out of the range of `dtype`, or the order 0.
    """

    def __init__(
        self, model: Autoregression, *, level: float | None = None, dtype: DTypeLike = np.float64
    ) -> None:
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        if self.dtype not in (np.dtype(np.float64), np.dtype(np.float32)):
            raise ValueError(f"dtype is {self.dtype}; the rule is float64 or float32")
        if model.order < 1:
            raise ValueError("order is 0; the rule is at least 1")
        if model.reflection.ndim != 1:
            raise ValueError(f"reflection has shape {model.reflection.shape}; the rule is one model, (p,)")
        self._shrink = 1 - 2 * float(np.finfo(self.dtype).eps)
        self.order, self._level = model.order, float(model.level if level is None else level)
        self._check_level(np.array([self._level]))
        self._rotation = self._turns(model.reflection)
        self.reset()

    def reset(self) -> None:
        """Put the lattice at rest: all states 0. The parameters stay as they are."""
        self._b = np.zeros(self.order + 1, dtype=self.dtype)

    def process(self, x: ArrayLike) -> Real:
        """Pass the next piece on; the pieces together are, bit for bit, what one call would return.

        Parameters
        ----------
        x : array_like of shape (n,)
            Excitation of unit variance (`LatticeSynthesis`) or signal (`LatticeInverse`); n may be 0.

        Returns
        -------
        ndarray of shape (n,)
            Of the lattice's dtype.

        Raises
        ------
        ValueError
            If `x` is not one-dimensional or holds NaN or infinity: it would stay in the state for ever.
        """
        out = self._checked(x)
        for start in range(0, out.size, _CHUNK):
            self._pass(out[start : start + _CHUNK])
        return out

    def process_varying(self, x: ArrayLike, reflection: ArrayLike, level: ArrayLike) -> Real:
        """Pass the next piece on with parameters of each sample's own; the last ones stay.

        Parameters
        ----------
        x : array_like of shape (n,)
            As for `process`.
        reflection : array_like of shape (n, p)
            Each |k| < 1.
        level : array_like of shape (n,)
            RMS at each sample, in the unit of the signal.

        Returns
        -------
        ndarray of shape (n,)
        """
        out = self._checked(x)
        k, levels = np.asarray(reflection, dtype=np.float64), np.asarray(level, dtype=np.float64)
        if k.shape != (out.size, self.order) or levels.shape != out.shape or not np.all(np.abs(k) < 1):
            raise ValueError(
                f"reflection {k.shape} and level {levels.shape} for {out.size} samples; "
                f"the rule is (n, {self.order}) and (n,), each |k| < 1"
            )
        self._check_level(levels)
        for start in range(0, out.size, _CHUNK):
            rows = slice(start, start + _CHUNK)
            self._pass_rows(out[rows], *self._turns(k[rows]), levels[rows].astype(self.dtype))
        if out.size:
            self._rotation, self._level = self._turns(k[-1]), float(levels[-1])
        return out

    def _pass(self, x: Real) -> None:
        raise NotImplementedError

    def _pass_rows(self, x: Real, k: Real, c: Real, level: Real) -> None:
        raise NotImplementedError

    def _turns(self, k: Samples) -> tuple[Real, Real]:
        c = np.sqrt((1 - k) * (1 + k))
        return (k * self._shrink).astype(self.dtype), (c * self._shrink).astype(self.dtype)

    def _check_level(self, level: Samples) -> None:
        info = np.finfo(self.dtype)
        bad = ~((level == 0) | ((level >= float(info.tiny)) & (level <= float(info.max))))
        if bad.any():
            raise ValueError(
                f"level is {level[bad][0]:g}; the rule is 0, or {info.tiny:.2g} ... {info.max:.2g} "
                f"for {self.dtype}: give a level, or scale the signal"
            )

    def _checked(self, x: ArrayLike) -> Real:
        out = np.array(x, dtype=self.dtype)
        if out.ndim != 1 or not np.all(np.isfinite(out)):
            raise ValueError(f"got shape {out.shape}; the rule is (n,) finite samples")
        return out


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
