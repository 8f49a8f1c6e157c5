"""What a fitted autoregressive model is, and what follows from its reflection coefficients.

A(z) = 1 + sum_i a_i z^-i, where a_m of the model of order m is its last reflection coefficient k_m. All
|k_m| < 1 is the whole test of stability.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.recording import Samples
from texclass.vibration import _recursions
from texclass.vibration._input import angular_frequencies

DIRECT_FORM_ERROR = 1e-6
"""Largest change of a reflection coefficient that direct-form coefficients may bring."""
OUTERMOST = 1 - 2.0**-52
"""The largest radius of a pole that is returned."""


@dataclass(frozen=True, eq=False)
class Autoregression:
    """An autoregressive model of one signal (leading shape ``()``) or of a stack of frames.

    Parameters
    ----------
    reflection : array_like of shape (..., p)
        Reflection coefficients k_1 ... k_p, each |k| < 1; p may be 0.
    gain : array_like of shape (...)
        Standard deviation of the innovation, in the unit of the signal, at least 0.
    residual : array_like of shape (..., p + 1), optional
        Standard deviation of what the orders 0 ... p leave unpredicted, in the unit of the signal. By default
        what k and `gain` say: gain / prod_{i > m} sqrt(1 - k_i^2).
    fitted_order : array_like of int, shape (...), optional
        Orders the signal gave; beyond it k = 0. p by default.
    clipped : array_like of bool, shape (...), optional
        Whether a |k| of 1 was cut to the last number below 1.
    fallback : array_like of bool, shape (...), optional
        Whether the method asked for was unstable and Burg's took its place.

    Raises
    ------
    ValueError
        If a |k| is not below 1, a gain is negative or not finite, or the shapes do not fit.

    Notes
    -----
    The arrays are copied and read-only. A gain of 0 is the model of silence: its log spectrum is -inf.
    """

    reflection: Samples
    gain: Samples
    residual: Samples = None  # type: ignore[assignment]
    fitted_order: NDArray[np.int64] = None  # type: ignore[assignment]
    clipped: NDArray[np.bool_] = None  # type: ignore[assignment]
    fallback: NDArray[np.bool_] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        k, gain = np.asarray(self.reflection, dtype=np.float64), np.asarray(self.gain, dtype=np.float64)
        _check_model(k, gain)
        lead, p = k.shape[:-1], k.shape[-1]
        self._store("reflection", k, k.shape, np.float64)
        self._store("gain", gain, lead, np.float64)
        residual = residual_of(k, gain) if self.residual is None else self.residual
        self._store("residual", residual, (*lead, p + 1), np.float64)
        self._store("fitted_order", p if self.fitted_order is None else self.fitted_order, lead, np.int64)
        self._store("clipped", self.clipped is not None and self.clipped, lead, np.bool_)
        self._store("fallback", self.fallback is not None and self.fallback, lead, np.bool_)

    def _store(self, name: str, value: ArrayLike, shape: tuple[int, ...], dtype: Any) -> None:
        array = np.array(np.broadcast_to(np.asarray(value, dtype=dtype), shape))
        array.setflags(write=False)
        object.__setattr__(self, name, array)

    @property
    def order(self) -> int:
        """The order p."""
        return int(self.reflection.shape[-1])

    @property
    def log_gain(self) -> Samples:
        """ln(gain), -inf for silence, shape (...)."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(self.gain))

    @property
    def level(self) -> Samples:
        """RMS of the process, gain / prod sqrt(1 - k^2), in the unit of the signal, shape (...)."""
        return residual_of(self.reflection, self.gain)[..., 0]

    @property
    def prediction_gain_db(self) -> Samples:
        """Power of the process over power of its innovation, -10 sum log10(1 - k^2) in dB, shape (...)."""
        return np.asarray(-20.0 / np.log(10.0) * log_cosines(self.reflection).sum(axis=-1))

    @property
    def log_area_ratios(self) -> Samples:
        """ln((1 + k) / (1 - k)) = 2 artanh k, shape (..., p)."""
        return np.asarray(np.log1p(self.reflection) - np.log1p(-self.reflection))

    def truncated(self, order: int) -> "Autoregression":
        """Return the model of the first `order` reflection coefficients, with the gain of that order.

        For the autocorrelation method and Burg's this is the fit at that order.
        """
        if not 0 <= order <= self.order:
            raise ValueError(f"order is {order}; the rule is 0 ... {self.order}, the order of the model")
        kept = self.residual[..., : order + 1]
        fitted = np.minimum(self.fitted_order, order)
        clipped = self.clipped & (self.fitted_order <= order)
        return Autoregression(
            self.reflection[..., :order], kept[..., -1], kept, fitted, clipped, self.fallback
        )

    def direct_form(self) -> Samples:
        """Return the coefficients 1, a_1 ... a_p, where they still describe the model.

        a_i^(m) = a_i^(m-1) + k_m a_{m-i}^(m-1), and a_m^(m) = k_m.

        Returns
        -------
        ndarray of shape (..., p + 1)

        Raises
        ------
        ValueError
            If the way back from the rounded coefficients misses a k by more than `DIRECT_FORM_ERROR`, or by
            more than half of what |k| has left to 1: such coefficients are another, maybe unstable, filter.
            Use the lattice there.
        """
        k = self.reflection.reshape(self.gain.size, self.order)
        a = _recursions.step_up(k)
        allowed = np.minimum(DIRECT_FORM_ERROR, (1 - np.abs(k)) / 2)
        excess = (np.abs(_recursions.step_down(a) - k) / allowed).max(axis=1, initial=0.0)
        if not np.all(excess <= 1):
            worst = int(np.argmax(np.where(np.isnan(excess), np.inf, excess)))
            raise ValueError(
                f"direct form of order {self.order} changes a reflection coefficient of frame {worst} by "
                f"{excess[worst]:.2g} times what is allowed; the rule is at most {DIRECT_FORM_ERROR:g} and "
                "half of what |k| has left to 1: use the lattice"
            )
        return np.asarray(a.reshape(*self.gain.shape, self.order + 1))

    def poles(self) -> NDArray[np.complex128]:
        """Return the p poles, the zeros of z^p A(z), in the z-plane; shape (..., p), in no particular order.

        They are the eigenvalues of the Hessenberg matrix H_ij = -k_{i-1} k_j c_i ... c_{j-1}, H_{j+1,j} = c_j
        with c = sqrt(1 - k^2) and k_0 = 1. Its norm is 1, so that they are right where the coefficients a_i
        are not; the direct form is never built. What rounding puts on the unit circle or beyond is returned
        at the radius `OUTERMOST`.
        """
        poles = np.asarray(np.linalg.eigvals(_hessenberg(self.reflection)), dtype=np.complex128)
        return poles * (OUTERMOST / np.maximum(np.abs(poles), OUTERMOST))

    def cepstrum(self, n: int) -> Samples:
        """Return c_0 = ln(gain) and c_1 ... c_{n-1} of ln |H(e^jw)| = c_0 + sum_i c_i cos(i w), H = gain / A.

        c_i = (1/i) sum_j p_j^i over the poles p_j: power sums do not suffer where poles crowd, and neither
        the direct form nor aliasing gets in.

        Parameters
        ----------
        n : int
            Number of coefficients, at least 1; may exceed the order.

        Returns
        -------
        ndarray of shape (..., n)
        """
        if n < 1:
            raise ValueError(f"n is {n}; the rule is at least 1 coefficient")
        poles, i = self.poles(), np.arange(1, n)
        powers = np.ones_like(poles)
        c = np.empty((*self.gain.shape, n))
        c[..., 0] = self.log_gain
        for index in i:
            powers = powers * poles
            c[..., index] = powers.real.sum(axis=-1) / index
        return c

    def log_spectrum_db(self, omega: ArrayLike) -> Samples:
        """Return 20 log10(gain / |A(e^jw)|) by the lattice recursion on the unit circle, in dB.

        Parameters
        ----------
        omega : array_like of shape (n_frequencies,)
            Angular frequency, radians per sample: 2 pi f / fs.

        Returns
        -------
        ndarray of shape (..., n_frequencies)
            -inf for silence.
        """
        k = self.reflection.reshape(self.gain.size, self.order)
        ln_a = [_recursions.log_magnitudes(row, angular_frequencies(omega))[-1] for row in k]
        ln_h = self.log_gain.reshape(-1, 1) - np.reshape(ln_a, (len(k), -1))
        return np.asarray(20.0 / np.log(10.0) * ln_h.reshape(*self.gain.shape, -1))


def log_cosines(k: Samples) -> Samples:
    """Return ln sqrt(1 - k^2), to full precision next to |k| = 1."""
    return np.asarray((np.log1p(k) + np.log1p(-k)) / 2)


def residual_of(k: Samples, gain: Samples) -> Samples:
    """Return gain / prod_{i > m} sqrt(1 - k_i^2) for m = 0 ... p; inf where that exceeds a float64."""
    below = np.zeros((*k.shape[:-1], k.shape[-1] + 1))
    below[..., :-1] = -np.cumsum(log_cosines(k)[..., ::-1], axis=-1)[..., ::-1]
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = np.exp(below / 2) * gain[..., np.newaxis] * np.exp(below / 2)
    return np.where(gain[..., np.newaxis] == 0, 0.0, scaled)


def _hessenberg(k: Samples) -> Samples:
    """Return the (..., p, p) matrix whose eigenvalues are the poles."""
    p = k.shape[-1]
    c = np.sqrt((1 - k) * (1 + k))
    h = np.zeros((*k.shape, p))
    run = np.zeros(k.shape)  # column j of -k_{i-1} c_i ... c_{j-1}
    for j in range(p):
        run[..., :j] *= c[..., j - 1 : j] if j else 1.0
        run[..., j] = -(k[..., j - 1] if j else 1.0)
        h[..., : j + 1, j] = run[..., : j + 1] * k[..., j : j + 1]
        if j + 1 < p:
            h[..., j + 1, j] = c[..., j]
    return h


def _check_model(k: Samples, gain: Samples) -> None:
    if k.ndim < 1 or k.shape[:-1] != gain.shape:
        raise ValueError(f"reflection {k.shape} and gain {gain.shape}; the rule is shapes (..., p) and (...)")
    if not np.all(np.abs(k) < 1):
        raise ValueError(f"a reflection coefficient is {k[~(np.abs(k) < 1)][0]}; the rule is |k| < 1")
    if not (np.all(gain >= 0) and np.all(np.isfinite(gain))):
        raise ValueError(f"a gain is {gain[~((gain >= 0) & np.isfinite(gain))][0]}; the rule is finite, >= 0")
