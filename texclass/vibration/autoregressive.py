"""Autoregressive models (LPC) of orders 1 to 1000 and beyond: x[t] = -sum_i a_i x[t-i] + gain e[t].

A(z) = 1 + sum_i a_i z^-i. The last coefficient a_m of the model of order m is its reflection coefficient k_m.
A model is stored as reflection coefficients and gain: it is stable if all |k_m| < 1. The fits compute the k_m
directly, never the a_i. Each frame is first divided by a power of two. This prevents under- and
overflow, and k does not depend on the unit of the signal.
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
from texclass.vibration.reflection import MAX_REFLECTION, MIN_RELATIVE_RESIDUAL, log_cosines, residual_levels

Method = Literal["autocorrelation", "burg", "modified_covariance"]
Variance = Literal["residual", "yule_walker"]

DIRECT_FORM_ERROR = 1e-6
"""Largest accepted error of a reflection coefficient due to the rounding of direct-form coefficients."""
MIN_NUMBA_WORK = 1e7
"""Product of samples and order above which numba saves more time than its import takes."""


@dataclass(frozen=True, eq=False)
class Autoregression:
    """An autoregressive model of one signal (leading shape ``()``) or of a stack of frames.

    Parameters
    ----------
    reflection : array_like of shape (..., p)
        Reflection coefficients k_1 ... k_p with |k| < 1. The order p may be 0.
    gain : array_like of shape (...)
        Standard deviation of the innovation, in the unit of the signal, at least 0.
    residual : array_like of shape (..., p + 1), optional
        Standard deviation of the prediction residual of the orders 0 ... p, in the unit of the signal
        (default: gain / prod_{i > m} sqrt(1 - k_i^2)).
    fitted_order : array_like of int, shape (...), optional
        Highest order that could be fitted to the signal (default p). All higher k are 0.
    is_fallback : array_like of bool, shape (...), optional
        Whether Burg's method was used because the requested method was unstable (default False).

    Raises
    ------
    ValueError
        If any |k| is 1 or more, a gain is negative or not finite, or the shapes do not match.

    Notes
    -----
    The arrays are copied and read-only. A model with a gain of 0 describes silence: its log spectrum is -inf.

    Examples
    --------
    >>> model = Autoregression([-0.9, 0.5], gain=1.0)
    >>> model.order, float(model.level.round(3))
    (2, 2.649)
    >>> model.direct_form()
    array([ 1.  , -1.35,  0.5 ])
    """

    reflection: Samples
    gain: Samples
    residual: Samples = None  # type: ignore[assignment]
    fitted_order: NDArray[np.int64] = None  # type: ignore[assignment]
    is_fallback: NDArray[np.bool_] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        k, gain = np.asarray(self.reflection, dtype=np.float64), np.asarray(self.gain, dtype=np.float64)
        if k.ndim < 1 or k.shape[:-1] != gain.shape:
            raise ValueError(
                f"reflection and gain must have the shapes (..., p) and (...), got {k.shape} and {gain.shape}"
            )
        is_stable = np.abs(k) < 1
        if not np.all(is_stable):
            raise ValueError(f"reflection coefficients must lie between -1 and 1, got {k[~is_stable][0]}")
        is_valid = (gain >= 0) & np.isfinite(gain)
        if not np.all(is_valid):
            raise ValueError(f"gain must be finite and not negative, got {gain[~is_valid][0]}")
        lead, p = k.shape[:-1], k.shape[-1]
        self._store("reflection", k, k.shape, np.float64)
        self._store("gain", gain, lead, np.float64)
        residual = residual_levels(k, gain) if self.residual is None else self.residual
        self._store("residual", residual, (*lead, p + 1), np.float64)
        self._store("fitted_order", p if self.fitted_order is None else self.fitted_order, lead, np.int64)
        self._store("is_fallback", self.is_fallback is not None and self.is_fallback, lead, np.bool_)

    def _store(self, name: str, value: ArrayLike, shape: tuple[int, ...], dtype: Any) -> None:
        array = np.empty(shape, dtype=dtype)
        array[...] = value
        array.setflags(write=False)
        object.__setattr__(self, name, array)

    @property
    def order(self) -> int:
        """Order p of the model."""
        return int(self.reflection.shape[-1])

    @property
    def is_clipped(self) -> NDArray[np.bool_]:
        """Whether a |k| of 1 was clipped to the largest number below 1, shape (...)."""
        return np.asarray(np.abs(self.reflection).max(axis=-1, initial=0.0) == MAX_REFLECTION)

    @property
    def log_gain(self) -> Samples:
        """Natural logarithm of the gain, shape (...); -inf for silence."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(self.gain))

    @property
    def level(self) -> Samples:
        """RMS of the process, gain / prod sqrt(1 - k^2), in the unit of the signal; shape (...)."""
        return residual_levels(self.reflection, self.gain)[..., 0]

    @property
    def prediction_gain_db(self) -> Samples:
        """Power of the process relative to the innovation, -10 sum log10(1 - k^2), in dB; shape (...)."""
        return np.asarray(-20.0 / np.log(10.0) * log_cosines(self.reflection).sum(axis=-1))

    @property
    def log_area_ratios(self) -> Samples:
        """Log area ratios ln((1 + k) / (1 - k)) = 2 artanh k, shape (..., p)."""
        return np.asarray(np.log1p(self.reflection) - np.log1p(-self.reflection))

    def truncate(self, order: int) -> "Autoregression":
        """Return the model of the first `order` reflection coefficients, with the gain of that order.

        For the autocorrelation method and Burg's method, this equals a fit of that order.
        """
        if not 0 <= order <= self.order:
            raise ValueError(
                f"order must lie between 0 and {self.order}, the order of the model, got {order}"
            )
        residual = self.residual[..., : order + 1]
        fitted = np.minimum(self.fitted_order, order)
        return Autoregression(
            self.reflection[..., :order], residual[..., -1], residual, fitted, self.is_fallback
        )

    def direct_form(self) -> Samples:
        """Return the direct-form coefficients 1, a_1 ... a_p.

        The recursion is a_i^(m) = a_i^(m-1) + k_m a_{m-i}^(m-1) with a_m^(m) = k_m.

        Returns
        -------
        ndarray of shape (..., p + 1)

        Raises
        ------
        ValueError
            If a k recomputed from the rounded coefficients differs by more than `DIRECT_FORM_ERROR`, or by
            more than half of 1 - |k|. Such coefficients describe a different and possibly unstable filter.
            Use the lattice (`LatticeSynthesis`) instead.
        """
        from texclass.vibration import recursions

        k = self.reflection.reshape(self.gain.size, self.order)
        a = recursions.step_up(k)
        tolerance = np.minimum(DIRECT_FORM_ERROR, (1 - np.abs(k)) / 2)
        relative_error = (np.abs(recursions.step_down(a) - k) / tolerance).max(axis=1, initial=0.0)
        if not np.all(relative_error <= 1):
            worst = int(np.argmax(np.where(np.isnan(relative_error), np.inf, relative_error)))
            raise ValueError(
                f"rounding of the direct form of order {self.order} changes a reflection coefficient of "
                f"frame {worst} by {relative_error[worst]:.2g} times the tolerance, which is the smaller of "
                f"{DIRECT_FORM_ERROR:g} and (1 - |k|) / 2. Use the lattice (LatticeSynthesis) instead"
            )
        return np.asarray(a.reshape(*self.gain.shape, self.order + 1))

    def poles(self) -> NDArray[np.complex128]:
        """Return the p poles (the zeros of z^p A(z)) in the z-plane, shape (..., p), in no particular order.

        They are the eigenvalues of the Hessenberg matrix H_ij = -k_{i-1} k_j c_i ... c_{j-1}, H_{j+1,j} = c_j
        with c = sqrt(1 - k^2) and k_0 = 1. The matrix has norm 1, so the poles are accurate even if the
        coefficients a_i are not. If rounding moves a pole to the unit circle or beyond, its radius is set to
        1 - 2^-52.
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
        """Return the first n cepstral coefficients of the spectrum of the model.

        ln |H(e^jw)| = c_0 + sum_i c_i cos(i w) with H = gain / A, c_0 = ln(gain) and c_i = (1/i) sum_j p_j^i
        over the poles p_j. Sums of powers are accurate even if poles lie close together, and they do not
        suffer from aliasing.

        Parameters
        ----------
        n : int
            Number of coefficients, at least 1. It may exceed the order.

        Returns
        -------
        ndarray of shape (..., n)
        """
        if n < 1:
            raise ValueError(f"n must be at least 1 coefficient, got {n}")
        poles, i = self.poles(), np.arange(1, n)
        powers = np.ones_like(poles)
        c = np.empty((*self.gain.shape, n))
        c[..., 0] = self.log_gain
        for index in i:
            powers = powers * poles
            c[..., index] = powers.real.sum(axis=-1) / index
        return c

    def log_spectrum_db(self, omega: ArrayLike) -> Samples:
        """Return the log spectrum 20 log10(gain / |A(e^jw)|) in dB.

        It is computed by the lattice recursion on the unit circle.

        Parameters
        ----------
        omega : array_like of shape (n_frequencies,)
            Angular frequencies 2 pi f / fs in rad per sample.

        Returns
        -------
        ndarray of shape (..., n_frequencies)
            Log spectrum in dB; -inf for silence.
        """
        from texclass.vibration import recursions

        k = self.reflection.reshape(self.gain.size, self.order)
        ln_a = [recursions.log_magnitudes(row, angular_frequencies(omega))[-1] for row in k]
        ln_h = self.log_gain.reshape(-1, 1) - np.reshape(ln_a, (len(k), -1))
        return np.asarray(20.0 / np.log(10.0) * ln_h.reshape(*self.gain.shape, -1))


def fit(
    x: ArrayLike, order: int, *, method: Method = "burg", variance: Variance = "residual"
) -> Autoregression:
    """Fit an autoregressive model to a signal or to each of several frames.

    Parameters
    ----------
    x : array_like of shape (n,) or (n_frames, n)
        Signal or frames, of any unit and real dtype. The mean is not removed, and no window is applied.
    order : int
        Order p, at least 1. It may equal or exceed n; see Notes.
    method : {"burg", "autocorrelation", "modified_covariance"}
        Method of estimation (default "burg"), see Notes.
    variance : {"residual", "yule_walker"}
        Definition of the gain. "residual" (default) is the RMS of the residual. "yule_walker" is
        ``rms(x) * prod sqrt(1 - k^2)``, so that the model has the power of the signal. Both are equal for the
        autocorrelation method.

    Returns
    -------
    Autoregression
        Model with the leading shape () or (n_frames,).

    Raises
    ------
    ValueError
        If a sample is NaN or infinite, the signal is empty or not one- or two-dimensional, the order is below
        1, or the method is unknown.

    Notes
    -----
    The methods differ as follows:

    - Burg's method minimises the forward and backward residuals order by order. The model is always stable,
      and no window is needed.
    - The autocorrelation method solves the Yule-Walker equations of the biased autocorrelation. It is always
      stable
      and the fastest method, but the truncation of the signal at its ends smears the spectrum.
    - The modified covariance method minimises both residuals over all coefficients at once. It is unbiased
      for sinusoids and takes O(n p^2) operations. Burg's result is used instead, and `is_fallback` is set, in
      three cases: the model is unstable; the problem is underdetermined (2 (n - p) <= p, or Burg's recursion
      ends before order p); or the conversion from coefficients to k is inaccurate (the residual exceeds
      Burg's).

    Special cases:

    - Silence: k = 0 and gain = 0 with every method. `fitted_order` is 0 (p for the modified covariance
      method).
    - Constant signal: with Burg's method, k_1 = -(1 - 2^-53), `is_clipped` is True, all other k are 0, and
      the gain is
      1.1e-16 times the constant (1.5e-8 times with "yule_walker"). With the autocorrelation method,
      k_1 = -(n-1)/n, because the signal steps to 0 at its ends.
    - Early end of Burg's recursion: it ends if the residual is rounding noise (below 9e-16 of the signal) or
      no sample is left (order n and above). `fitted_order` is the last order, and all higher k are 0. The
      recursion of the autocorrelation method does not end early.

    Burg's residual energy is summed anew at each order, because an update by (1 - k^2) would lose all digits
    for sinusoids and oversampled signals. If Levinson's recursion would magnify the rounding errors of the
    autocorrelation by more than 1e8, the same k are computed from the zero-padded signal instead.

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
    if method not in get_args(Method):
        raise ValueError(f"method must be one of {get_args(Method)}, got {method!r}")
    if variance not in get_args(Variance):
        raise ValueError(f"variance must be one of {get_args(Variance)}, got {variance!r}")
    if order < 1:
        raise ValueError(f"order must be at least 1, got {order}")
    frames, exponent, lead = _scaled(x)
    if method == "autocorrelation":
        k, deviation, fitted = _autocorrelation(frames, order)
    else:
        k, deviation, fitted = _burg(frames, order)
    is_fallback = np.zeros(len(frames), dtype=np.bool_)
    for row, each in enumerate(frames if method == "modified_covariance" else ()):
        from texclass.vibration import recursions

        a, gain = _modified_covariance(each, order)
        candidate = recursions.step_down(a[np.newaxis])[0]
        # The residual of this method is the smallest possible. If it exceeds Burg's, rounding spoiled k.
        max_residual = 1.001 * deviation[row, -1] + MIN_RELATIVE_RESIDUAL * deviation[row, 0]
        is_stable = np.isfinite(gain) and np.all(np.abs(candidate) < 1)
        # If Burg's recursion ends before the last order, the solution is not unique and would depend on
        # rounding.
        is_unique = fitted[row] in {0, order}
        if is_unique and is_stable and recursions.residual(each, candidate) <= max_residual:
            k[row], fitted[row] = candidate, order
            deviation[row] = residual_levels(candidate, np.asarray(gain))
        else:
            is_fallback[row] = True
    if variance == "yule_walker":
        deviation[:, 0] = np.sqrt(np.mean(frames**2, axis=1))
        deviation[:, 1:] = deviation[:, :1] * np.exp(np.cumsum(log_cosines(k), axis=1))
    deviation = np.ldexp(deviation, exponent)
    residual = deviation.reshape(*lead, order + 1)
    return Autoregression(
        k.reshape(*lead, order), residual[..., -1], residual, fitted.reshape(lead), is_fallback.reshape(lead)
    )


def from_autocorrelation(r: ArrayLike) -> Autoregression:
    """Return the model whose autocorrelation starts with r_0 ... r_p, by the Levinson-Durbin recursion.

    Parameters
    ----------
    r : array_like of shape (..., p + 1)
        Autocorrelation from lag 0, in the squared unit of the signal. r_0 may only be 0 if all lags are 0.

    Returns
    -------
    Autoregression
        Model. The recursion ends before the first |k| of 1 or more, which occurs if the sequence is not
        positive definite or is affected by rounding. `fitted_order` is the last order, and all higher k are
        0.

    Raises
    ------
    ValueError
        If a value is not finite, r_0 is negative, or r_0 is 0 while other lags are not.

    Examples
    --------
    >>> model = from_autocorrelation([2.0, 1.0, 0.5])
    >>> model.reflection, float(model.gain.round(4))
    (array([-0.5, -0. ]), 1.2247)
    """
    from texclass.vibration import recursions

    lags = np.asarray(r, dtype=np.float64)
    if lags.ndim < 1 or lags.shape[-1] < 1 or not np.all(np.isfinite(lags)):
        raise ValueError(
            f"autocorrelation must be finite and have the shape (..., p + 1), got the shape {lags.shape}"
        )
    r0 = lags[..., :1]
    if np.any(r0 < 0) or np.any((r0 == 0) & (lags != 0)):
        raise ValueError(f"r_0 must be positive, or 0 if all lags are 0, got {r0.min()}")
    unit = np.where(r0 == 0, np.eye(1, lags.shape[-1]), lags / np.where(r0 == 0, 1.0, r0))
    lead = lags.shape[:-1]
    k, energy, _, fitted = recursions.levinson(unit.reshape(-1, lags.shape[-1]))
    deviation = np.sqrt(energy.reshape(lags.shape)) * np.sqrt(r0)
    return Autoregression(k.reshape(*lead, -1), deviation[..., -1], deviation, fitted.reshape(lead))


def from_direct_form(a: ArrayLike, gain: ArrayLike) -> Autoregression:
    """Return the model with the direct-form coefficients 1, a_1 ... a_p, by the step-down recursion.

    Parameters
    ----------
    a : array_like of shape (..., p + 1)
        Coefficients of A(z). The first coefficient must be 1.
    gain : array_like of shape (...)
        Standard deviation of the innovation, in the unit of the signal.

    Returns
    -------
    Autoregression

    Raises
    ------
    ValueError
        If a_0 is not 1 or the model is not stable.

    Examples
    --------
    >>> from_direct_form([1.0, -1.35, 0.5], gain=1.0).reflection
    array([-0.9,  0.5])
    """
    from texclass.vibration import recursions

    direct = np.asarray(a, dtype=np.float64)
    if direct.ndim < 1 or direct.size == 0 or not np.all(direct[..., 0] == 1):
        raise ValueError(
            f"coefficients must have the shape (..., p + 1) and start with 1, got the shape {direct.shape}"
        )
    k = recursions.step_down(direct.reshape(-1, direct.shape[-1]))
    return Autoregression(k.reshape(*direct.shape[:-1], -1), np.asarray(gain, dtype=np.float64))


def autocorrelation(frames: Samples, n_lags: int) -> Samples:
    """Return sum_t x[t] x[t+i] of each row for i = 0 ... n_lags, shape (rows, n_lags + 1), by FFT."""
    size = fft.next_fast_len(frames.shape[-1] + n_lags, real=True)  # lags beyond n_lags may wrap around
    spectrum = fft.rfft(frames, size, axis=-1)
    power = spectrum.real**2 + spectrum.imag**2
    return np.asarray(fft.irfft(power, size, axis=-1)[..., : n_lags + 1])


def _autocorrelation(frames: Samples, order: int) -> tuple[Samples, Samples, NDArray[np.int64]]:
    """Return k, the standard deviations of the residuals of the orders 0 ... p, and the fitted order."""
    from texclass.vibration import recursions

    r = autocorrelation(frames, order)
    silent = ~frames.any(axis=1)
    r[silent] = np.eye(1, order + 1)
    k, energy, magnification, fitted = recursions.levinson(r / r[:, :1])
    rms = np.where(silent, 0.0, np.sqrt(r[:, 0] / frames.shape[1]))
    deviation = rms[:, np.newaxis] * np.sqrt(energy)
    is_inaccurate = magnification > 1e8  # of the rounding errors of r: half of the digits are lost
    if is_inaccurate.any():
        k[is_inaccurate], deviation[is_inaccurate], fitted[is_inaccurate] = recursions.burg(
            frames[is_inaccurate], order, order
        )
    fitted[silent] = 0
    return k, deviation, fitted


def _modified_covariance(x: Samples, order: int) -> tuple[Samples, float]:
    """Minimise |x[t] + sum_i a_i x[t-i]|^2 + |x[t-p] + sum_i a_i x[t-p+i]|^2 over t = p ... n-1.

    Returns the coefficients 1, a_1 ... a_p and the RMS of the residual, which is NaN if there are too few
    equations. The equations are reduced block by block to a triangular matrix (QR), because normal equations
    would square the condition number.
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
    """Return the frames divided by 2^exponent, the exponent (n_frames, 1), and the leading shape."""
    samples = np.asarray(x)
    if samples.ndim not in (1, 2) or samples.shape[-1] == 0:
        raise ValueError(f"x must have the shape (n,) or (n_frames, n) with n >= 1, got {samples.shape}")
    if np.iscomplexobj(samples):
        raise ValueError(f"x must contain real samples, got {samples.dtype}")
    frames = np.ascontiguousarray(np.atleast_2d(samples), dtype=np.float64)
    if not np.all(np.isfinite(frames)):
        index = np.argwhere(~np.isfinite(frames))[0]
        raise ValueError(f"x must contain finite samples, got {frames[tuple(index)]} at sample {index[-1]}")
    _, exponent = np.frexp(np.abs(frames).max(axis=1, keepdims=True))
    return np.ldexp(frames, -exponent), exponent, samples.shape[:-1]


def _burg(frames: Samples, order: int) -> tuple[Samples, Samples, NDArray[np.int64]]:
    """Fit each row by Burg's method, like `recursions.burg` without padding.

    Below `MIN_NUMBA_WORK`, the computation runs in numpy. This is fast enough, and `texclass predict` does
    not have to import numba, which takes a second.
    """
    if "numba" in sys.modules or frames.size * order > MIN_NUMBA_WORK:
        from texclass.vibration import recursions

        fitted_rows: tuple[Samples, Samples, NDArray[np.int64]] = recursions.burg(frames, order, 0)
        return fitted_rows
    n, f, b = frames.shape[1], frames, frames
    deviation = np.repeat(np.sqrt(np.mean(frames**2, axis=1, keepdims=True)), order + 1, axis=1)
    k, fitted = np.zeros((len(frames), order)), np.zeros(len(frames), np.int64)
    is_active = np.ones(len(frames), np.bool_)
    min_energy = 2 * (MIN_RELATIVE_RESIDUAL * deviation[:, 0]) ** 2
    total = _energy(f[:, 1:]) + _energy(b[:, :-1])
    for m in range(1, min(order, n - 1) + 1):
        is_active &= total > (n - m) * min_energy
        if not is_active.any():
            break
        f, b = f[:, 1:], b[:, :-1]
        step = -2.0 * np.einsum("kt,kt->k", f, b) / np.where(is_active, total, 1.0)
        step = np.where(is_active, np.clip(step, -MAX_REFLECTION, MAX_REFLECTION), 0.0)
        f, b = f + step[:, None] * b, b + step[:, None] * f
        total = _energy(f[:, 1:]) + _energy(b[:, :-1])
        energy = total + f[:, 0] ** 2 + b[:, -1] ** 2  # the sum for the next stage omits these two samples
        k[:, m - 1] = step
        fitted[is_active] = m
        deviation[is_active, m:] = np.sqrt(energy / (2 * (n - m)))[is_active, np.newaxis]
    return k, deviation, fitted


def _energy(x: Samples) -> Samples:
    return np.asarray(np.einsum("kt,kt->k", x, x))
