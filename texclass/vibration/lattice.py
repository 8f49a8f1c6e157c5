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
from numba import njit
from numba.extending import intrinsic
from numpy.typing import ArrayLike, DTypeLike, NDArray

from texclass.recording import Samples
from texclass.vibration.autoregressive import Autoregression

Real = NDArray[np.floating[Any]]

FOURS_ORDER = 6
"""Least order with four samples in flight: twice as fast."""
CHUNK = 4096
"""Samples undone at a time, so that the next stage finds them in the cache: three times as fast."""


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
            raise ValueError(f"dtype is {self.dtype}. Expected float64 or float32")
        if model.order < 1:
            raise ValueError("order is 0. Expected at least 1")
        if model.reflection.ndim != 1:
            raise ValueError(f"reflection has shape {model.reflection.shape}. Expected one model, (p,)")
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
        self._pass(out, *self._rotation, self.dtype.type(self._level))
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
                f"reflection {k.shape} and level {levels.shape} for {out.size} samples. "
                f"Expected (n, {self.order}) and (n,), each |k| < 1"
            )
        self._check_level(levels)
        self._pass(out, *self._turns(k), levels.astype(self.dtype))
        if out.size:
            self._rotation, self._level = self._turns(k[-1]), float(levels[-1])
        return out

    def _pass(self, x: Real, k: Real, c: Real, level: Any) -> None:
        """Turn a piece in place; k, c and level are of shape (p,), (p,), () or (n, p), (n, p), (n,)."""
        raise NotImplementedError

    def _turns(self, k: Samples) -> tuple[Real, Real]:
        c = np.sqrt((1 - k) * (1 + k))
        return (k * self._shrink).astype(self.dtype), (c * self._shrink).astype(self.dtype)

    def _check_level(self, level: Samples) -> None:
        info = np.finfo(self.dtype)
        bad = ~((level == 0) | ((level >= float(info.tiny)) & (level <= float(info.max))))
        if bad.any():
            raise ValueError(
                f"level is {level[bad][0]:g}. Expected 0, or {info.tiny:.2g} ... {info.max:.2g} "
                f"for {self.dtype}: give a level, or scale the signal"
            )

    def _checked(self, x: ArrayLike) -> Real:
        out = np.array(x, dtype=self.dtype)
        if out.ndim != 1 or not np.all(np.isfinite(out)):
            raise ValueError(f"got shape {out.shape}. Expected (n,) finite samples")
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

    def _pass(self, x: Real, k: Real, c: Real, level: Any) -> None:
        (sound if k.ndim == 1 else sound_rows)(x, k, c, self._b)
        x *= level


class LatticeInverse(Lattice):
    """Turn a vibration back into the excitation: undo `LatticeSynthesis`, moving parameters included.

    Parameters as for `Lattice`; a level of 0 is refused, as nothing comes back from silence. For a signal
    that the model fits, the result is white with unit variance; times the gain it is the prediction error.
    """

    def _check_level(self, level: Samples) -> None:
        super()._check_level(level)
        if np.any(level == 0):
            raise ValueError("level is 0. Expected a positive level for inverse filtering")

    def _pass(self, x: Real, k: Real, c: Real, level: Any) -> None:
        x /= level
        if k.ndim == 2:
            undo_rows(x, k, c, self._b)
        else:
            for start in range(0, x.size, CHUNK):
                undo(x[start : start + CHUNK], k, c, self._b)


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


# Inner loops ------------------------------------------------------------------------------------------------
#
# Every sample meets the same operations in one order: each line of a stage is one product and one fused
# multiply-add, spelt out so that no compiler chooses for itself. Pieces of a signal then equal the whole bit
# for bit.


def _fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """Type and generate a b + c, rounded once."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.fma(*args)

    return a(a, b, c), generate


fma: Any = intrinsic(_fma)


@njit(inline="always", error_model="numpy")
def turn(f, b, k, c):  # type: ignore[no-untyped-def]
    """Return f_{m-1} and b_m."""
    return fma(c, f, -(k * b)), fma(k, f, c * b)


@njit(cache=True, error_model="numpy")
def sound(x: Real, k: Real, c: Real, b: Real) -> None:
    """Turn the excitation `x` into f_0 in place; state b_0 ... b_{p-1} in `b`.

    From `FOURS_ORDER` on four samples are in flight, each two stages behind the one before: they set out in
    turn, go on together, and arrive in turn; b1, b2, b3 go from one to the next. What is left follows one
    after the other.
    """
    p = k.size
    q = p - 1
    whole = x.size // 4 * 4 if p >= FOURS_ORDER else 0
    for t in range(0, whole, 4):
        f0, f1, f2, f3 = x[t], x[t + 1], x[t + 2], x[t + 3]
        for m in range(q, q - 2, -1):
            f0, b1 = turn(f0, b[m], k[m], c[m])
        for m in range(q - 2, q - 4, -1):
            f1, b2 = turn(f1, b1, k[m + 2], c[m + 2])
            f0, b1 = turn(f0, b[m], k[m], c[m])
        for m in range(q - 4, q - 6, -1):
            f2, b3 = turn(f2, b2, k[m + 4], c[m + 4])
            f1, b2 = turn(f1, b1, k[m + 2], c[m + 2])
            f0, b1 = turn(f0, b[m], k[m], c[m])
        for m in range(q - 6, -1, -1):
            f3, up = turn(f3, b3, k[m + 6], c[m + 6])
            f2, b3 = turn(f2, b2, k[m + 4], c[m + 4])
            f1, b2 = turn(f1, b1, k[m + 2], c[m + 2])
            f0, b1 = turn(f0, b[m], k[m], c[m])
            b[m + 7] = up
        for m in range(1, -1, -1):
            f3, b[m + 5] = turn(f3, b3, k[m + 4], c[m + 4])
            f2, b3 = turn(f2, b2, k[m + 2], c[m + 2])
            f1, b2 = turn(f1, b1, k[m], c[m])
            b1 = f0  # b_0 is f_0
        for m in range(1, -1, -1):
            f3, b[m + 3] = turn(f3, b3, k[m + 2], c[m + 2])
            f2, b3 = turn(f2, b2, k[m], c[m])
            b2 = f1
        for m in range(1, -1, -1):
            f3, b[m + 1] = turn(f3, b3, k[m], c[m])
            b3 = f2
        b[0] = f3
        x[t], x[t + 1], x[t + 2], x[t + 3] = f0, f1, f2, f3
    for t in range(whole, x.size):
        f = x[t]
        for m in range(p - 1, -1, -1):
            f, b[m + 1] = turn(f, b[m], k[m], c[m])
        b[0] = f
        x[t] = f


@njit(cache=True, error_model="numpy")
def sound_rows(x: Real, k: Real, c: Real, b: Real) -> None:
    """Do what `sound` does with parameters (n, p) of each sample's own."""
    p = k.shape[1]
    for t in range(x.size):
        f = x[t]
        for m in range(p - 1, -1, -1):
            f, b[m + 1] = turn(f, b[m], k[t, m], c[t, m])
        b[0] = f
        x[t] = f


@njit(cache=True, error_model="numpy")
def undo(x: Real, k: Real, c: Real, b: Real) -> None:
    """Turn f_0 in `x` into the excitation in place: what `sound` did, undone stage by stage."""
    now, after = np.zeros(x.size + 1, x.dtype), np.zeros(x.size + 1, x.dtype)
    now[1:] = x
    for m in range(k.size):
        now[0] = b[m]  # b_m of the sample before
        b[m] = now[x.size]
        for t in range(x.size):  # f_m = (f_{m-1} + k b_{m-1}) / c and b_m = k f_m + c b_{m-1}
            x[t] = fma(k[m], now[t], x[t]) / c[m]
            after[t + 1] = fma(k[m], x[t], c[m] * now[t])
        now, after = after, now


@njit(cache=True, error_model="numpy")
def undo_rows(x: Real, k: Real, c: Real, b: Real) -> None:
    """Do what `undo` does with parameters (n, p) of each sample's own."""
    for t in range(x.size):
        f = x[t]
        up = f
        for m in range(k.shape[1]):
            below = b[m]
            b[m] = up
            f = fma(k[t, m], below, f) / c[t, m]
            up = fma(k[t, m], f, c[t, m] * below)
        x[t] = f
