"""Autoregressive models (LPC) of orders 1 to 1000 and beyond: x[t] = -sum_i a_i x[t-i] + gain e[t].

A(z) = 1 + sum_i a_i z^-i, where a_m of the model of order m is its last reflection coefficient k_m. A model
is stored as reflection coefficients and gain: all |k_m| < 1 is the whole test of stability, and the fits end
in the k_m, never in the a_i. Each frame is first divided by a power of two: no gain under- or overflows, and
k does not depend on it.
"""

import sys
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from texclass.recording import Samples
from texclass.signals import angular_frequencies
from texclass.vibration.reflection import EXHAUSTED, LARGEST, log_cosines, residual_of

Method = Literal["autocorrelation", "burg", "modified_covariance"]
Variance = Literal["residual", "yule_walker"]

DIRECT_FORM_ERROR = 1e-6
"""Largest change of a reflection coefficient that direct-form coefficients may bring."""
WORTH_LOADING = 1e7
"""Samples times order from which on it takes less time to load numba than to do without."""


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
    fallback: NDArray[np.bool_] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        k, gain = np.asarray(self.reflection, dtype=np.float64), np.asarray(self.gain, dtype=np.float64)
        if k.ndim < 1 or k.shape[:-1] != gain.shape:
            raise ValueError(
                f"reflection {k.shape} and gain {gain.shape}. Expected shapes (..., p) and (...)"
            )
        if not np.all(np.abs(k) < 1):
            raise ValueError(f"a reflection coefficient is {k[~(np.abs(k) < 1)][0]}. Expected |k| < 1")
        if not np.all((gain >= 0) & np.isfinite(gain)):
            wrong = gain[~((gain >= 0) & np.isfinite(gain))][0]
            raise ValueError(f"a gain is {wrong}. Expected a finite number of at least 0")
        lead, p = k.shape[:-1], k.shape[-1]
        self._store("reflection", k, k.shape, np.float64)
        self._store("gain", gain, lead, np.float64)
        residual = residual_of(k, gain) if self.residual is None else self.residual
        self._store("residual", residual, (*lead, p + 1), np.float64)
        self._store("fitted_order", p if self.fitted_order is None else self.fitted_order, lead, np.int64)
        self._store("fallback", self.fallback is not None and self.fallback, lead, np.bool_)

    def _store(self, name: str, value: ArrayLike, shape: tuple[int, ...], dtype: Any) -> None:
        array = np.empty(shape, dtype=dtype)
        array[...] = value
        array.setflags(write=False)
        object.__setattr__(self, name, array)

    @property
    def order(self) -> int:
        """The order p."""
        return int(self.reflection.shape[-1])

    @property
    def clipped(self) -> NDArray[np.bool_]:
        """Whether a |k| of 1 was cut to the last number below 1, shape (...)."""
        return np.asarray(np.abs(self.reflection).max(axis=-1, initial=0.0) == LARGEST)

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
            raise ValueError(f"order is {order}. Expected 0 ... {self.order}, the order of the model")
        kept = self.residual[..., : order + 1]
        fitted = np.minimum(self.fitted_order, order)
        return Autoregression(self.reflection[..., :order], kept[..., -1], kept, fitted, self.fallback)

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
        from texclass.vibration import recursions

        k = self.reflection.reshape(self.gain.size, self.order)
        a = recursions.step_up(k)
        allowed = np.minimum(DIRECT_FORM_ERROR, (1 - np.abs(k)) / 2)
        excess = (np.abs(recursions.step_down(a) - k) / allowed).max(axis=1, initial=0.0)
        if not np.all(excess <= 1):
            worst = int(np.argmax(np.where(np.isnan(excess), np.inf, excess)))
            raise ValueError(
                f"direct form of order {self.order} changes a reflection coefficient of frame {worst} by "
                f"{excess[worst]:.2g} times what is allowed. Expected at most {DIRECT_FORM_ERROR:g} and "
                "half of what |k| has left to 1: use the lattice"
            )
        return np.asarray(a.reshape(*self.gain.shape, self.order + 1))

    def poles(self) -> NDArray[np.complex128]:
        """Return the p poles, the zeros of z^p A(z), in the z-plane; shape (..., p), in no particular order.

        They are the eigenvalues of the Hessenberg matrix H_ij = -k_{i-1} k_j c_i ... c_{j-1}, H_{j+1,j} = c_j
        with c = sqrt(1 - k^2) and k_0 = 1. Its norm is 1, so that they are right where the coefficients a_i
        are not; the direct form is never built. What rounding puts on the unit circle or beyond is returned
        at the radius 1 - 2^-52.
        """
        k, p = self.reflection, self.order
        c = np.sqrt((1 - k) * (1 + k))
        H = np.zeros((*k.shape, p))
        run = np.zeros(k.shape)  # column j of -k_{i-1} c_i ... c_{j-1}
        for j in range(p):
            run[..., :j] *= c[..., j - 1 : j] if j else 1.0
            run[..., j] = -(k[..., j - 1] if j else 1.0)
            H[..., : j + 1, j] = run[..., : j + 1] * k[..., j : j + 1]
            if j + 1 < p:
                H[..., j + 1, j] = c[..., j]
        poles = np.asarray(np.linalg.eigvals(H), dtype=np.complex128)
        outermost = 1 - 2.0**-52
        return poles * (outermost / np.maximum(np.abs(poles), outermost))

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
            raise ValueError(f"n is {n}. Expected at least 1 coefficient")
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
        from texclass.vibration import recursions

        k = self.reflection.reshape(self.gain.size, self.order)
        ln_a = [recursions.log_magnitudes(row, angular_frequencies(omega))[-1] for row in k]
        ln_h = self.log_gain.reshape(-1, 1) - np.reshape(ln_a, (len(k), -1))
        return np.asarray(20.0 / np.log(10.0) * ln_h.reshape(*self.gain.shape, -1))


def fit(
    x: ArrayLike, order: int, *, method: Method = "burg", variance: Variance = "residual"
) -> Autoregression:
    """Fit an autoregressive model to a signal or to each of a stack of frames.

    Parameters
    ----------
    x : array_like of shape (n,) or (n_frames, n)
        Any unit and real dtype. No mean is removed and no window applied: both are the caller's.
    order : int
        p, at least 1; may reach or exceed n, see Notes.
    method : {"burg", "autocorrelation", "modified_covariance"}
        Burg's minimises the forward and backward residual order by order, always stable, no window needed.
        The autocorrelation method solves the Yule-Walker equations of the biased autocorrelation: stable, the
        fastest, its spectrum smeared by the ends of the signal. The modified covariance method minimises both
        residuals over all coefficients at once: no bias on sinusoids; O(n p^2); it can be unstable,
        undetermined (2 (n - p) <= p, or Burg's residual ends before order p) or lost to rounding on the way
        from coefficients to k (a residual above Burg's shows it), and then Burg's result is returned and
        `fallback` says so.
    variance : {"residual", "yule_walker"}
        The gain is the RMS of the residual, or ``rms(x) * prod sqrt(1 - k^2)``, with which the model has the
        power of the signal. They are the same number for the autocorrelation method.

    Returns
    -------
    Autoregression
        With leading shape () or (n_frames,).

    Raises
    ------
    ValueError
        If a sample is NaN or infinite, the signal empty or not one- or two-dimensional, the order below 1.

    Notes
    -----
    - Zeros: k = 0, gain 0, whatever the method; `fitted_order` is 0 (p for modified covariance).
    - A constant (Burg): k_1 = -(1 - 2^-53), `clipped`, k = 0 beyond, and a gain of 1.1e-16 of the constant
      (1.5e-8 of it with "yule_walker"). Autocorrelation: k_1 = -(n-1)/n, the ends being steps to 0.
    - Burg's recursion ends where the residual is rounding noise (below 9e-16 of the signal) or has no sample
      left (order n and more); `fitted_order` says where, and k = 0 beyond. The autocorrelation method has no
      such end.

    Burg's residual energy is summed anew at each order: updated by (1 - k^2) it is lost to rounding in
    sinusoids and oversampled signals. Levinson's recursion is checked: where it would magnify the rounding of
    the autocorrelation by more than 1e8, the same k are computed on the zero-padded signal.

    References
    ----------
    `oeztuerk2018`, eq. (3.1)-(3.7); Burg 1975; Marple 1987 for the modified covariance method.

    Examples
    --------
    >>> import numpy as np
    >>> model = fit(np.sin(0.3 * np.arange(1000.0)), order=2, method="modified_covariance")
    >>> model.reflection.shape, bool(abs(model.reflection).max() < 1)
    ((2,), True)
    """
    if method not in get_args(Method) or variance not in get_args(Variance):
        allowed = (*get_args(Method), *get_args(Variance))
        raise ValueError(f"method is {method!r} and variance {variance!r}. Expected one of {allowed}")
    if order < 1:
        raise ValueError(f"order is {order}. Expected at least 1")
    frames, exponent, lead = _scaled(x)
    if method == "autocorrelation":
        k, deviation, fitted = _autocorrelation(frames, order)
    else:
        k, deviation, fitted = _burg(frames, order)
    fallback = np.zeros(len(frames), dtype=np.bool_)
    for row, each in enumerate(frames if method == "modified_covariance" else ()):
        from texclass.vibration import recursions

        a, gain = _both_ways(each, order)
        found = recursions.step_down(a[np.newaxis])[0]
        # The least residual of all can only exceed Burg's where k is lost on the way from the coefficients.
        loosest = 1.001 * deviation[row, -1] + EXHAUSTED * deviation[row, 0]
        stable = np.isfinite(gain) and np.all(np.abs(found) < 1)
        # Where Burg's residual ends before the last order, many coefficients do; rounding would choose.
        determined = fitted[row] in {0, order}
        if determined and stable and recursions.residual(each, found) <= loosest:
            k[row], deviation[row], fitted[row] = found, residual_of(found, np.asarray(gain)), order
        else:
            fallback[row] = True
    if variance == "yule_walker":
        deviation[:, 0] = np.sqrt(np.mean(frames**2, axis=1))
        deviation[:, 1:] = deviation[:, :1] * np.exp(np.cumsum(log_cosines(k), axis=1))
    deviation = np.ldexp(deviation, exponent)
    residual = deviation.reshape(*lead, order + 1)
    return Autoregression(
        k.reshape(*lead, order), residual[..., -1], residual, fitted.reshape(lead), fallback.reshape(lead)
    )


def from_autocorrelation(r: ArrayLike) -> Autoregression:
    """Return the model whose autocorrelation begins with r_0 ... r_p, by Levinson's and Durbin's recursion.

    Parameters
    ----------
    r : array_like of shape (..., p + 1)
        Lag 0 first, in the squared unit of the signal; r_0 = 0 only with all others 0.

    Returns
    -------
    Autoregression
        Where a |k| comes out at or above 1 (no positive definite sequence, or one lost to rounding) the
        recursion ends before it, k = 0 from there, and `fitted_order` says where.

    Raises
    ------
    ValueError
        If a value is not finite, r_0 negative, or r_0 = 0 with others not 0.
    """
    from texclass.vibration import recursions

    lags = np.asarray(r, dtype=np.float64)
    if lags.ndim < 1 or lags.shape[-1] < 1 or not np.all(np.isfinite(lags)):
        raise ValueError(f"autocorrelation has shape {lags.shape}. Expected (..., p + 1), all finite")
    r0 = lags[..., :1]
    if np.any(r0 < 0) or np.any((r0 == 0) & (lags != 0)):
        raise ValueError(f"r_0 is {r0.min()}. Expected r_0 > 0, or silence: all lags 0")
    unit = np.where(r0 == 0, np.eye(1, lags.shape[-1]), lags / np.where(r0 == 0, 1.0, r0))
    lead = lags.shape[:-1]
    k, energy, _, fitted = recursions.levinson(unit.reshape(-1, lags.shape[-1]))
    deviation = np.sqrt(energy.reshape(lags.shape)) * np.sqrt(r0)
    return Autoregression(k.reshape(*lead, -1), deviation[..., -1], deviation, fitted.reshape(lead))


def from_direct_form(a: ArrayLike, gain: ArrayLike) -> Autoregression:
    """Return the model of the coefficients 1, a_1 ... a_p, by the step-down recursion.

    Parameters
    ----------
    a : array_like of shape (..., p + 1)
        The first one is 1.
    gain : array_like of shape (...)
        Standard deviation of the innovation.

    Returns
    -------
    Autoregression

    Raises
    ------
    ValueError
        If a_0 is not 1 or the model is not stable.
    """
    from texclass.vibration import recursions

    direct = np.asarray(a, dtype=np.float64)
    if direct.ndim < 1 or direct.size == 0 or not np.all(direct[..., 0] == 1):
        raise ValueError(f"coefficients have shape {direct.shape}. Expected (..., p + 1), the first one 1")
    k = recursions.step_down(direct.reshape(-1, direct.shape[-1]))
    return Autoregression(k.reshape(*direct.shape[:-1], -1), np.asarray(gain, dtype=np.float64))


def autocorrelation(frames: Samples, n_lags: int) -> Samples:
    """Return sum_t x[t] x[t+i] of each row for i = 0 ... n_lags, (rows, n_lags + 1), by FFT."""
    size = fft.next_fast_len(frames.shape[-1] + n_lags, real=True)  # lags beyond n_lags may wrap around
    spectrum = fft.rfft(frames, size, axis=-1)
    power = spectrum.real**2 + spectrum.imag**2
    return np.asarray(fft.irfft(power, size, axis=-1)[..., : n_lags + 1])


def _autocorrelation(frames: Samples, order: int) -> tuple[Samples, Samples, NDArray[np.int64]]:
    """Return k, the residual deviations of the orders 0 ... p and the orders fitted, one row per frame."""
    from texclass.vibration import recursions

    r = autocorrelation(frames, order)
    silent = ~frames.any(axis=1)
    r[silent] = np.eye(1, order + 1)
    k, energy, loss, fitted = recursions.levinson(r / r[:, :1])
    rms = np.where(silent, 0.0, np.sqrt(r[:, 0] / frames.shape[1]))
    deviation = rms[:, np.newaxis] * np.sqrt(energy)
    lost = loss > 1e8  # by so much the rounding of r is magnified
    if lost.any():
        k[lost], deviation[lost], fitted[lost] = recursions.burg(frames[lost], order, order)
    fitted[silent] = 0
    return k, deviation, fitted


def _both_ways(x: Samples, order: int) -> tuple[Samples, float]:
    """Minimise |x[t] + sum_i a_i x[t-i]|^2 + |x[t-p] + sum_i a_i x[t-p+i]|^2 over t = p ... n-1.

    Returns 1, a_1 ... a_p and the RMS of the residual, NaN where there are too few equations. A triangle
    gathers the equations block by block (QR), which does not square their condition.
    """
    a = np.eye(1, order + 1)[0]
    if 2 * (x.size - order) <= order:
        return a, np.nan
    windows, n_rows = sliding_window_view(x, order + 1), 4 * (order + 64)
    triangle: Samples = np.zeros((0, order + 1))
    for start in range(0, len(windows), n_rows):
        block = windows[start : start + n_rows]
        triangle = np.asarray(np.linalg.qr(np.concatenate([triangle, block, block[:, ::-1]]), mode="r"))
    a[1:] = np.linalg.lstsq(triangle[:, 1:], -triangle[:, 0])[0]
    return a, float(np.linalg.norm(triangle @ a) / np.sqrt(2 * len(windows)))


def _scaled(x: ArrayLike) -> tuple[Samples, NDArray[np.int64], tuple[int, ...]]:
    """Return the frames divided by 2^exponent, that exponent (n_frames, 1), and the leading shape."""
    samples = np.asarray(x)
    if samples.ndim not in (1, 2) or samples.shape[-1] == 0:
        raise ValueError(f"signal has shape {samples.shape}. Expected (n,) or (n_frames, n), n at least 1")
    if np.iscomplexobj(samples):
        raise ValueError(f"signal is {samples.dtype}. Expected real samples")
    frames = np.ascontiguousarray(np.atleast_2d(samples), dtype=np.float64)
    if not np.all(np.isfinite(frames)):
        at = np.argwhere(~np.isfinite(frames))[0]
        raise ValueError(f"sample {at[-1]} is {frames[tuple(at)]}. Expected finite samples")
    _, exponent = np.frexp(np.abs(frames).max(axis=1, keepdims=True))
    return np.ldexp(frames, -exponent), exponent, samples.shape[:-1]


def _burg(frames: Samples, order: int) -> tuple[Samples, Samples, NDArray[np.int64]]:
    """Fit each row by Burg's method as `recursions.burg` does, without padding.

    A little work is done in numpy: below `WORTH_LOADING` that is fast enough, and spares answers of `texclass
    predict` the second that loading numba takes.
    """
    if "numba" in sys.modules or frames.size * order > WORTH_LOADING:
        from texclass.vibration import recursions

        return recursions.burg(frames, order, 0)
    n, f, b = frames.shape[1], frames, frames
    deviation = np.repeat(np.sqrt(np.mean(frames**2, axis=1, keepdims=True)), order + 1, axis=1)
    k, fitted = np.zeros((len(frames), order)), np.zeros(len(frames), np.int64)
    going, least = np.ones(len(frames), np.bool_), 2 * (EXHAUSTED * deviation[:, 0]) ** 2
    total = _energy(f[:, 1:]) + _energy(b[:, :-1])
    for m in range(1, min(order, n - 1) + 1):
        going &= total > (n - m) * least
        if not going.any():
            break
        f, b = f[:, 1:], b[:, :-1]
        step = -2.0 * np.einsum("kt,kt->k", f, b) / np.where(going, total, 1.0)
        step = np.where(going, np.clip(step, -LARGEST, LARGEST), 0.0)
        f, b = f + step[:, None] * b, b + step[:, None] * f
        total = _energy(f[:, 1:]) + _energy(b[:, :-1])
        left = total + f[:, 0] ** 2 + b[:, -1] ** 2  # the next stage pairs all but these two
        k[:, m - 1] = step
        fitted[going] = m
        deviation[going, m:] = np.sqrt(left / (2 * (n - m)))[going, np.newaxis]
    return k, deviation, fitted


def _energy(x: Samples) -> Samples:
    return np.asarray(np.einsum("kt,kt->k", x, x))
