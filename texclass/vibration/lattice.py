"""Normalised lattice filters: synthesis with an autoregressive model, and inverse filtering.

Stage m rotates the forward residual f_m of this sample and the backward residual b_{m-1} of the previous
one::

    f_{m-1} = c f_m - k b_{m-1},    b_m = k f_m + c b_{m-1},    c = sqrt(1 - k^2)

from the excitation f_p down to f_0, and the signal is level * f_0. Because every stage is a rotation, the
energy of the states never grows, even if the k change at every sample. To rule out growth by rounding, k and
c are reduced by twice the machine epsilon, which exceeds the rounding of a stage. White excitation of unit
variance gives uncorrelated states of unit variance, so the signal has the RMS `level` at every sample, even
while the parameters change. In direct form the excitation of the same model is gain * e[t] with gain = level
* prod c.
"""

from typing import Any, Self

import numpy as np
from numba.extending import intrinsic
from numpy.typing import ArrayLike, DTypeLike, NDArray

from texclass.compilation import njit
from texclass.recording import Samples
from texclass.vibration.autoregressive import Autoregression

Real = NDArray[np.floating[Any]]

MIN_INTERLEAVED_ORDER = 6
"""Order at and above which four samples are processed at a time, which is twice as fast."""
CHUNK_SAMPLES = 4096
"""Number of samples that are inverse filtered at a time. They stay in the cache, which is three times as
fast."""


class Lattice:
    """Base class of synthesis and inverse filter, with the parameters and the filter state between calls.

    Parameters
    ----------
    model : Autoregression
        Model of one signal: leading shape ().
    level : float, optional
        RMS of the signal in its unit (default: level of the model). Required if gain / prod c exceeds the
        range of a float, for example with 1000 coefficients k = 0.9.
    dtype : float64 or float32
        Type of the arithmetic and of the result (default float64). float32 adds an error of 1e-7 per stage
        and sample. A pole that is closer than 1e-7 to the unit circle acts like a pole at this distance.

    Raises
    ------
    ValueError
        If the model is a stack, its level is not finite or out of the range of `dtype`, or its order is 0.
    """

    def __init__(
        self, model: Autoregression, *, level: float | None = None, dtype: DTypeLike = np.float64
    ) -> None:
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        if self.dtype not in (np.dtype(np.float64), np.dtype(np.float32)):
            raise ValueError(f"dtype must be float64 or float32, got {self.dtype}")
        if model.order < 1:
            raise ValueError("the order of the model must be at least 1, got 0")
        if model.reflection.ndim != 1:
            raise ValueError(
                f"model must be one model with reflection of the shape (p,), got {model.reflection.shape}"
            )
        self._shrink = 1 - 2 * float(np.finfo(self.dtype).eps)
        self.order, self._level = model.order, float(model.level if level is None else level)
        self._check_level(np.array([self._level]))
        self._rotation = self._cosines(model.reflection)
        self.reset()

    def reset(self) -> None:
        """Set all states to 0; the parameters are not changed."""
        self._b = np.zeros(self.order + 1, dtype=self.dtype)

    def process(self, x: ArrayLike) -> Real:
        """Filter the next block. Consecutive blocks give exactly the same samples as a single call.

        Parameters
        ----------
        x : array_like of shape (n,)
            Excitation of unit variance (`LatticeSynthesis`) or signal (`LatticeInverse`); n may be 0.

        Returns
        -------
        ndarray of shape (n,)
            Filtered samples, of the dtype of the lattice.

        Raises
        ------
        ValueError
            If `x` is not one-dimensional or contains NaN or infinity, which would never leave the state.
        """
        out = self._checked(x)
        self._filter(out, *self._rotation, self.dtype.type(self._level))
        return out

    def process_varying(self, x: ArrayLike, reflection: ArrayLike, level: ArrayLike) -> Real:
        """Filter the next block with different parameters at each sample.

        Later blocks use the parameters of the last sample.

        Parameters
        ----------
        x : array_like of shape (n,)
            Excitation or signal, as for `process`.
        reflection : array_like of shape (n, p)
            Reflection coefficients at each sample, |k| < 1.
        level : array_like of shape (n,)
            RMS level at each sample, in the unit of the signal.

        Returns
        -------
        ndarray of shape (n,)
        """
        out = self._checked(x)
        k, levels = np.asarray(reflection, dtype=np.float64), np.asarray(level, dtype=np.float64)
        if k.shape != (out.size, self.order) or levels.shape != out.shape or not np.all(np.abs(k) < 1):
            raise ValueError(
                f"reflection and level must have the shapes ({out.size}, {self.order}) and ({out.size},), "
                f"with |k| < 1, got {k.shape} and {levels.shape}"
            )
        self._check_level(levels)
        self._filter(out, *self._cosines(k), levels.astype(self.dtype))
        if out.size:
            self._rotation, self._level = self._cosines(k[-1]), float(levels[-1])
        return out

    def _filter(self, x: Real, k: Real, c: Real, level: Any) -> None:
        """Filter a block in place; k, c and level have the shapes (p,), (p,), () or (n, p), (n, p), (n,)."""
        raise NotImplementedError

    def _cosines(self, k: Samples) -> tuple[Real, Real]:
        c = np.sqrt((1 - k) * (1 + k))
        return (k * self._shrink).astype(self.dtype), (c * self._shrink).astype(self.dtype)

    def _check_level(self, level: Samples) -> None:
        info = np.finfo(self.dtype)
        is_valid = (level == 0) | ((level >= float(info.tiny)) & (level <= float(info.max)))
        if not is_valid.all():
            raise ValueError(
                f"level must be 0 or lie between {info.tiny:.2g} and {info.max:.2g} for {self.dtype}, got "
                f"{level[~is_valid][0]:g}. Pass a level, or scale the signal"
            )

    def _checked(self, x: ArrayLike) -> Real:
        out = np.array(x, dtype=self.dtype)
        if out.ndim != 1 or not np.all(np.isfinite(out)):
            raise ValueError(
                f"x must contain finite samples and have the shape (n,), got the shape {out.shape}"
            )
        return out


class LatticeSynthesis(Lattice):
    """Synthesis of a vibration from white excitation of unit variance; parameters as for `Lattice`.

    Examples
    --------
    >>> import numpy as np
    >>> lattice = LatticeSynthesis(Autoregression([-0.9, 0.5], 1.0))
    >>> lattice.process([1.0, 0.0, 0.0]).round(6)
    array([1.    , 1.35  , 1.3225])
    """

    def settle(self, rng: np.random.Generator) -> Self:
        """Draw a stationary state, so that the vibration starts without a transient.

        The states of the normalised lattice are uncorrelated and have unit variance.
        """
        self._b[: self.order] = rng.standard_normal(self.order)
        return self

    def _filter(self, x: Real, k: Real, c: Real, level: Any) -> None:
        (synthesis_loop if k.ndim == 1 else synthesis_loop_varying)(x, k, c, self._b)
        x *= level


class LatticeInverse(Lattice):
    """Inverse filter of `LatticeSynthesis`, also for varying parameters; parameters as for `Lattice`.

    The level must be positive. If the model fits the signal, the result is white with unit variance.
    Multiplied by the gain, it is the prediction error.

    Examples
    --------
    >>> model = Autoregression([-0.9, 0.5], 1.0)
    >>> LatticeInverse(model).process([1.0, 1.35, 1.3225]).round(6)
    array([1., 0., 0.])
    """

    def _check_level(self, level: Samples) -> None:
        super()._check_level(level)
        if np.any(level == 0):
            raise ValueError("level must be positive for inverse filtering, got 0")

    def _filter(self, x: Real, k: Real, c: Real, level: Any) -> None:
        x /= level
        if k.ndim == 2:
            inverse_loop_varying(x, k, c, self._b)
        else:
            for start in range(0, x.size, CHUNK_SAMPLES):
                inverse_loop(x[start : start + CHUNK_SAMPLES], k, c, self._b)


def synthesize(model: Autoregression, n: int, rng: np.random.Generator) -> Samples:
    """Return n samples of the stationary Gaussian process of a model.

    Parameters
    ----------
    model : Autoregression
        Model of one signal.
    n : int
        Number of samples.
    rng : numpy.random.Generator
        Generator of the initial state and the excitation.

    Returns
    -------
    ndarray of shape (n,)
        Vibration in the unit of the model.

    Examples
    --------
    >>> import numpy as np
    >>> model = Autoregression([-0.9, 0.5], gain=0.1)
    >>> vibration = synthesize(model, 10_000, np.random.default_rng(0))
    >>> float(vibration.std().round(2)), float(model.level.round(2))
    (0.27, 0.26)
    """
    lattice = LatticeSynthesis(model).settle(rng)
    return np.asarray(lattice.process(rng.standard_normal(n)), dtype=np.float64)


def whiten(model: Autoregression, x: ArrayLike) -> Samples:
    """Return the excitation (unit variance) from which a model synthesizes the signal `x`.

    Parameters
    ----------
    model : Autoregression
        Model of one signal.
    x : array_like of shape (n,)
        Signal in the unit of the model. It is assumed to be 0 before the first sample.

    Returns
    -------
    ndarray of shape (n,)
        Dimensionless excitation.

    Examples
    --------
    >>> import numpy as np
    >>> model = Autoregression([-0.9, 0.5], gain=0.1)
    >>> vibration = synthesize(model, 10_000, np.random.default_rng(0))
    >>> float(whiten(model, vibration).std().round(2))
    1.0
    """
    return np.asarray(LatticeInverse(model).process(x), dtype=np.float64)


# Inner loops ------------------------------------------------------------------------------------------------
#
# Every sample passes through the same operations in the same order: each line of a stage is one product and
# one explicit fused multiply-add, so that the result does not depend on the compiler. Consecutive blocks then
# give exactly the samples of one call.


def _fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """Return the type and the code generator of a b + c, rounded once."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.fma(*args)

    return a(a, b, c), generate


fma: Any = intrinsic(_fma)


@njit(inline="always", error_model="numpy")
def rotate(f, b, k, c):  # type: ignore[no-untyped-def]
    """Return f_{m-1} and b_m."""
    return fma(c, f, -(k * b)), fma(k, f, c * b)


@njit(cache=True, error_model="numpy")
def synthesis_loop(x: Real, k: Real, c: Real, b: Real) -> None:
    """Replace the excitation `x` by f_0 in place; `b` contains the state b_0 ... b_{p-1}.

    From order `MIN_INTERLEAVED_ORDER` on, four samples are processed at a time, each two stages behind its
    predecessor; b1, b2, b3 pass from one sample to the next. The remaining samples follow one by one.
    """
    p = k.size
    q = p - 1
    whole = x.size // 4 * 4 if p >= MIN_INTERLEAVED_ORDER else 0
    for t in range(0, whole, 4):
        f0, f1, f2, f3 = x[t], x[t + 1], x[t + 2], x[t + 3]
        for m in range(q, q - 2, -1):
            f0, b1 = rotate(f0, b[m], k[m], c[m])
        for m in range(q - 2, q - 4, -1):
            f1, b2 = rotate(f1, b1, k[m + 2], c[m + 2])
            f0, b1 = rotate(f0, b[m], k[m], c[m])
        for m in range(q - 4, q - 6, -1):
            f2, b3 = rotate(f2, b2, k[m + 4], c[m + 4])
            f1, b2 = rotate(f1, b1, k[m + 2], c[m + 2])
            f0, b1 = rotate(f0, b[m], k[m], c[m])
        for m in range(q - 6, -1, -1):
            f3, up = rotate(f3, b3, k[m + 6], c[m + 6])
            f2, b3 = rotate(f2, b2, k[m + 4], c[m + 4])
            f1, b2 = rotate(f1, b1, k[m + 2], c[m + 2])
            f0, b1 = rotate(f0, b[m], k[m], c[m])
            b[m + 7] = up
        for m in range(1, -1, -1):
            f3, b[m + 5] = rotate(f3, b3, k[m + 4], c[m + 4])
            f2, b3 = rotate(f2, b2, k[m + 2], c[m + 2])
            f1, b2 = rotate(f1, b1, k[m], c[m])
            b1 = f0  # b_0 = f_0
        for m in range(1, -1, -1):
            f3, b[m + 3] = rotate(f3, b3, k[m + 2], c[m + 2])
            f2, b3 = rotate(f2, b2, k[m], c[m])
            b2 = f1
        for m in range(1, -1, -1):
            f3, b[m + 1] = rotate(f3, b3, k[m], c[m])
            b3 = f2
        b[0] = f3
        x[t], x[t + 1], x[t + 2], x[t + 3] = f0, f1, f2, f3
    for t in range(whole, x.size):
        f = x[t]
        for m in range(p - 1, -1, -1):
            f, b[m + 1] = rotate(f, b[m], k[m], c[m])
        b[0] = f
        x[t] = f


@njit(cache=True, error_model="numpy")
def synthesis_loop_varying(x: Real, k: Real, c: Real, b: Real) -> None:
    """Run `synthesis_loop` with different parameters (n, p) at each sample."""
    p = k.shape[1]
    for t in range(x.size):
        f = x[t]
        for m in range(p - 1, -1, -1):
            f, b[m + 1] = rotate(f, b[m], k[t, m], c[t, m])
        b[0] = f
        x[t] = f


@njit(cache=True, error_model="numpy")
def inverse_loop(x: Real, k: Real, c: Real, b: Real) -> None:
    """Replace f_0 in `x` by the excitation in place, stage by stage: the inverse of `synthesis_loop`."""
    lower, upper = np.zeros(x.size + 1, x.dtype), np.zeros(x.size + 1, x.dtype)
    lower[1:] = x
    for m in range(k.size):
        lower[0] = b[m]  # b_m of the previous sample
        b[m] = lower[x.size]
        for t in range(x.size):  # f_m = (f_{m-1} + k b_{m-1}) / c and b_m = k f_m + c b_{m-1}
            x[t] = fma(k[m], lower[t], x[t]) / c[m]
            upper[t + 1] = fma(k[m], x[t], c[m] * lower[t])
        lower, upper = upper, lower


@njit(cache=True, error_model="numpy")
def inverse_loop_varying(x: Real, k: Real, c: Real, b: Real) -> None:
    """Run `inverse_loop` with different parameters (n, p) at each sample."""
    for t in range(x.size):
        f = x[t]
        up = f
        for m in range(k.shape[1]):
            below = b[m]
            b[m] = up
            f = fma(k[t, m], below, f) / c[t, m]
            up = fma(k[t, m], f, c[t, m] * below)
        x[t] = f
