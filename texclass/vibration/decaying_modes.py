"""Sums of decaying sinusoids, fitted by the matrix pencil method, or by Prony's method as published."""

from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from texclass.recording import Samples, make_read_only
from texclass.signals import one_channel, positive, to_unit_scale

Poles = NDArray[np.complex128]


@dataclass(frozen=True)
class PencilSettings:
    """Limits of the matrix pencil.

    Attributes
    ----------
    max_width
        Largest pencil parameter, in samples. A larger value takes more time without improving the accuracy.
    noise_edge
        Ratio of the largest to the median singular value that a square Hankel matrix of white noise exceeds
        in one of 100 cases.
    relative_tolerance
        Singular values below this fraction of the largest one are ignored, because rounding rotates their
        vectors by 1e-6 or more.
    min_decay
        Smallest decay of a mode over the whole segment, in nepers. This decay is assigned to undamped tones.
    """

    max_width: int = 400
    noise_edge: float = 3.3
    relative_tolerance: float = 1e-10
    min_decay: float = 1e-9


PENCIL = PencilSettings()


@dataclass(frozen=True, eq=False)
class Sinusoids:
    """Base class for models of several sinusoids. The arrays are read-only, one value per sinusoid."""

    frequency_hz: Samples

    def __post_init__(self) -> None:
        for name in (each.name for each in fields(self)):
            values = make_read_only(np.array(getattr(self, name), dtype=np.float64, ndmin=1))
            object.__setattr__(self, name, values)
            if values.shape != self.frequency_hz.shape or not np.all(np.isfinite(values)):
                raise ValueError(f"{name} must contain one finite value per frequency, got {values}")
            if name != "phase" and np.any(values <= 0 if name == "decay_per_s" else values < 0):
                sign = "positive" if name == "decay_per_s" else "not negative"
                raise ValueError(f"{name} must be {sign}, got {values}")


@dataclass(frozen=True, eq=False)
class DecayingModes(Sinusoids):
    """Sum of decaying sinusoids, independent of the sampling rate.

    x(t) = sum_i A_i exp(-B_i t) cos(2 pi f_i t + phi_i) for t >= 0. Every B_i is positive, so the filter is
    stable at every sampling rate.

    Attributes
    ----------
    frequency_hz : ndarray of shape (n_modes,)
        Frequencies f_i >= 0 in Hz; 0 for a plain exponential.
    decay_per_s : ndarray of shape (n_modes,)
        Decay rates B_i > 0 in 1/s.
    amplitude : ndarray of shape (n_modes,)
        Amplitudes A_i >= 0 in the unit of the vibration. The fits return the strongest mode first.
    phase : ndarray of shape (n_modes,)
        Phases phi_i in rad.

    Raises
    ------
    ValueError
        If the shapes differ, a value is not finite, a frequency or amplitude is negative, or a decay rate is
        not positive.

    Examples
    --------
    >>> modes = DecayingModes([200.0, 500.0], [40.0, 90.0], [1.0, 0.5], [0.0, 0.0])
    >>> modes.synthesize(n_samples=3, fs=10_000.0).round(3)
    array([1.5  , 1.459, 1.358])
    >>> modes.sections(fs=10_000.0).shape
    (2, 6)
    """

    decay_per_s: Samples
    amplitude: Samples
    phase: Samples

    @property
    def n_modes(self) -> int:
        """Number of modes. A mode has two poles, or one if its frequency is 0."""
        return int(np.size(self.frequency_hz))

    @property
    def table(self) -> Samples:
        """Frequency (Hz), decay rate (1/s), amplitude and phase of each mode, shape (n_modes, 4)."""
        return np.stack([self.frequency_hz, self.decay_per_s, self.amplitude, self.phase], axis=1)

    def strongest(self, n_modes: int, duration_s: float = np.inf) -> "DecayingModes":
        """Return the `n_modes` modes with the largest energy A^2 (1 - exp(-2 B T)) / B in the duration T."""
        largest = np.max(self.amplitude, initial=np.finfo(float).tiny)
        B = self.decay_per_s
        energy = (self.amplitude / largest) ** 2 * -np.expm1(-2 * B * duration_s) / B
        return DecayingModes(*self.table[np.argsort(-energy, kind="stable")[:n_modes]].T)

    def synthesize(self, n_samples: int, fs: float) -> Samples:
        """Return the vibration at the times 0, 1/fs, ..., computed in closed form.

        Parameters
        ----------
        n_samples : int
            Number of samples.
        fs : float
            Sampling rate in Hz, which may differ from the rate of the fit. Modes above fs/2 are omitted.

        Returns
        -------
        ndarray of shape (n_samples,)
            Vibration in the unit of the amplitudes.
        """
        t = np.arange(n_samples) / positive(fs, "fs")
        x = np.zeros(n_samples)
        for f, B, A, phi in self.table[self.frequency_hz <= fs / 2]:
            x += A * np.exp(-B * t) * np.cos(2 * np.pi * f * t + phi)
        return x

    def sections(self, fs: float) -> Samples:
        """Return parallel second-order sections whose impulse response is the vibration.

        Mode i is one section, and the outputs of all sections are added::

            H_i(z) = A (cos phi - r cos(w - phi) z^-1) / (1 - 2 r cos w z^-1 + r^2 z^-2),
            r = exp(-B / fs),  w = 2 pi f / fs

        For a real pole (f = 0 or f = fs/2), the coefficient of z^-2 is 0. Each section is stable.

        Parameters
        ----------
        fs : float
            Sampling rate in Hz. Modes above fs/2 are omitted.

        Returns
        -------
        ndarray of shape (n_modes, 6)
            Coefficients b0, b1, b2, a0, a1, a2 of each section, in scipy's order.
        """
        positive(fs, "fs")
        f, B, A, phi = self.table[self.frequency_hz <= fs / 2].T
        r = np.minimum(np.exp(-B / fs), 1 - 2**-50)
        w = 2 * np.pi * f / fs
        real = (f == 0) | (f == fs / 2)
        a2 = np.where(real, 0.0, r**2)
        limit = (1 + a2) * (1 - 2**-51)  # rounding must not push a pole of a very slow mode outside
        a1 = np.where(real, -r * np.cos(w), np.clip(-2 * r * np.cos(w), -limit, limit))
        b1 = np.where(real, 0.0, -A * r * np.cos(w - phi))
        zero, one = np.zeros_like(r), np.ones_like(r)
        return np.stack([A * np.cos(phi), b1, zero, one, a1, a2], axis=1)

    def filter(self, x: ArrayLike, fs: float) -> Samples:
        """Filter an excitation `x` of shape (n_samples,) with the `sections`, starting at rest."""
        from scipy import signal

        excitation = one_channel(x, "excitation")
        outputs = (signal.sosfilt(section[np.newaxis], excitation) for section in self.sections(fs))
        return np.asarray(sum(outputs, np.zeros_like(excitation)))


NO_MODES = DecayingModes(*np.zeros((4, 0)))
"""Model of silence, without any mode."""


def fit_matrix_pencil(
    x: ArrayLike,
    fs: float,
    *,
    order: int | None = None,
    unstable_poles: Literal["reflect", "project"] = "reflect",
    settings: PencilSettings = PENCIL,
) -> DecayingModes:
    """Fit decaying modes to a signal by the total-least-squares matrix pencil.

    The Hankel matrix Y[i, j] = x[i + j] of a sum of P exponentials z_i^n has rank P, and its rows are
    combinations of the vectors (1, z_i, z_i^2, ...). Let Y = U S V^T be truncated to the P largest singular
    values. V without its last row (V_1) and V without its first row (V_2) satisfy V_1 Phi = V_2, where the
    eigenvalues of Phi are the z_i. Both sides contain noise, so Phi is the total-least-squares solution.
    Amplitudes and phases then follow by linear least squares.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Signal that starts at the onset of the vibration, at least 4 samples, in any unit.
    fs : float
        Sampling rate in Hz.
    order : int, optional
        Number of poles P, at most n_samples // 2 (default: estimated by `numerical_rank`). A decaying
        sinusoid has two poles.
    unstable_poles : {"reflect", "project"}
        Treatment of poles outside the unit circle (default "reflect"), see Notes.
    settings : PencilSettings
        Limits of the algorithm.

    Returns
    -------
    DecayingModes
        Modes, strongest first. For silence, or if no singular value exceeds the noise, there are no modes.

    Raises
    ------
    ValueError
        If `x` has fewer than 4 samples, more than one channel, NaN or infinity, or the order is out of range.

    Notes
    -----
    With "reflect", a pole z outside the unit circle is moved to 1/conj(z): the growth becomes a decay with
    the same rate and frequency. With "project", the pole is moved along its radius to a decay of `min_decay`
    nepers over the signal. This is a better fit for signals that do not decay, but the mode practically never
    ends. Poles inside the unit circle that decay more slowly than `min_decay` are projected in both cases.
    The amplitudes are fitted afterwards, so they are optimal for the returned poles.

    The pencil parameter is n_samples // 2, but at most `max_width`.

    References
    ----------
    Hua, Sarkar, "Matrix pencil method for estimating parameters of exponentially damped/undamped sinusoids in
    noise", 1990; Van Huffel et al., "Algorithm for time-domain NMR data fitting based on total least
    squares", 1994. It replaces Prony's method of `guruswamy2011`, section IV-A.

    Examples
    --------
    >>> truth = DecayingModes(180.0, 60.0, 2.0, 0.5)
    >>> modes = fit_matrix_pencil(truth.synthesize(300, 10_000.0), 10_000.0)
    >>> modes.frequency_hz.round(3), modes.decay_per_s.round(3)
    (array([180.]), array([60.]))
    """
    samples, exponent = to_unit_scale(one_channel(x, "segment", at_least=4))
    positive(fs, "fs")
    n = samples.size
    if order is not None and not 1 <= order <= n // 2:
        raise ValueError(f"order must lie between 1 and n_samples // 2 = {n // 2}, got {order}")
    singular, V = _right_subspace(samples, settings.max_width)
    above_rounding = int(np.sum(singular > settings.relative_tolerance * singular[0]))
    rank = min(numerical_rank(singular, settings.noise_edge) if order is None else order, above_rounding)
    if rank == 0:
        return NO_MODES
    # Solve V_1 Phi = V_2. With W the right singular vectors of [V_1 V_2], Phi = -W_12 W_22^-1.
    rank = min(rank, len(V) - 1)
    shifted_pair = np.hstack([V[:-1, :rank], V[1:, :rank]])
    # gesvd, because gesdd may fail to converge for many equal singular values
    W = linalg.svd(shifted_pair, lapack_driver="gesvd")[2].T
    Phi = -W[:rank, rank:] @ linalg.pinv(W[rank:, rank:])
    z = stabilize_poles(
        np.asarray(linalg.eigvals(Phi), dtype=np.complex128), unstable_poles, settings.min_decay / n
    )
    z = z[z.imag >= 0]  # one pole of each conjugate pair; a negative real pole is a mode at exactly fs/2
    f, B = fs * (np.abs(np.angle(z)) / (2 * np.pi)), -np.log(np.abs(z)) * fs
    modes = fit_amplitudes(samples, f, B, fs).strongest(n, n / fs)
    with np.errstate(under="ignore"):
        amplitude = np.ldexp(modes.amplitude, exponent)
    return DecayingModes(modes.frequency_hz, modes.decay_per_s, amplitude, modes.phase)


def numerical_rank(singular: ArrayLike, noise_edge: float = PENCIL.noise_edge) -> int:
    """Return the number of singular values of a nearly square Hankel matrix that exceed the noise.

    The function counts values above `noise_edge` times the median of the remaining values, and repeats this
    until the count no longer changes. For white noise of 20 to 800 samples, the rank is 0 in 99 of 100 cases.

    Parameters
    ----------
    singular : array_like of shape (n_values,)
        Singular values in descending order.
    noise_edge : float
        Threshold of `PencilSettings`.

    Returns
    -------
    int
        Rank, at most three quarters of the number of values. The remaining values are needed to estimate the
        noise.

    Examples
    --------
    >>> numerical_rank([90.0, 70.0, 1.2, 1.1, 1.0, 0.9, 0.8, 0.7])
    2
    """
    s = np.asarray(singular, dtype=np.float64)
    rank, last = 0, -1
    while rank > last:
        last = rank
        rank = min(int(np.sum(s > noise_edge * np.median(s[rank:]))), 3 * s.size // 4)
    return rank


def stabilize_poles(z: Poles, unstable_poles: Literal["reflect", "project"], min_decay: float) -> Poles:
    """Move all poles into the unit circle, to a decay of at least `min_decay` nepers per sample."""
    min_radius = 2.0**-52  # a pole at 0 is a single impulse; this radius keeps the logarithm finite
    z = np.where(np.abs(z) < min_radius, min_radius, z)
    radius = np.abs(z)
    inside = np.where(radius > 1, 1 / radius, radius) if unstable_poles == "reflect" else radius
    return np.asarray(z / radius * np.minimum(inside, np.exp(-min_decay)))


def _right_subspace(x: Samples, max_width: int) -> tuple[Samples, Samples]:
    """Return the singular values and the right singular vectors (columns) of the Hankel matrix."""
    Y = sliding_window_view(x, min(x.size // 2, max_width) + 1)
    step = 4 * max_width
    R: Samples = Y[:step]
    for start in range(step, len(Y), step):  # Y^T Y = R^T R, without storing a long Y
        R = np.asarray(np.linalg.qr(np.vstack([R, Y[start : start + step]]), mode="r"))
    try:
        _, singular, Vh = linalg.svd(R, full_matrices=False)
    except linalg.LinAlgError:  # divide and conquer is twice as fast, but fails on a few finite matrices
        _, singular, Vh = linalg.svd(R, full_matrices=False, lapack_driver="gesvd")
    return singular, Vh.T


def fit_amplitudes(x: Samples, frequency_hz: Samples, decay_per_s: Samples, fs: float) -> DecayingModes:
    """Fit amplitudes and phases to modes of known frequencies (0 ... fs/2) and decay rates, by least squares.

    The unknowns are the real and imaginary parts of one complex amplitude per mode. Modes without oscillation
    (f = 0, f = fs/2) have a real amplitude.
    """
    is_oscillating = (frequency_hz > 0) & (frequency_hz < fs / 2)
    n = np.arange(x.size)[:, np.newaxis]
    with np.errstate(under="ignore"):
        powers = np.exp(-n * (decay_per_s / fs)) * np.exp(2j * np.pi * n * (frequency_hz / fs))
    design = np.hstack([powers.real, -powers.imag[:, is_oscillating]])
    size = np.maximum(linalg.norm(design, axis=0), np.finfo(float).tiny)
    c = linalg.lstsq(design / size, x, cond=1e-12)[0] / size
    amplitude = c[: frequency_hz.size].astype(np.complex128)
    amplitude[is_oscillating] += 1j * c[frequency_hz.size :]
    return DecayingModes(frequency_hz, decay_per_s, np.abs(amplitude), np.angle(amplitude))


# Prony's method, for comparison -----------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PronyFilter:
    """Filter H(z) = sum_i b_i z^-i / sum_i a_i z^-i whose impulse response models a segment.

    Numerator and denominator have the same order (M = N). The filter may be unstable, see `is_stable`.

    Attributes
    ----------
    b, a : ndarray of shape (order + 1,)
        Coefficients of the numerator (unit of the segment) and of the denominator (a_0 = 1).
    error : float
        Mean absolute difference between impulse response and segment, in the unit of the segment. Infinite if
        the response overflows within the segment.
    is_resolved : bool
        Whether the error is below the requested resolution.

    Examples
    --------
    >>> model = PronyFilter(np.array([1.0, 0.4]), np.array([1.0, -0.5]), error=0.0, is_resolved=True)
    >>> model.is_stable, model.synthesize(3)
    (True, array([1.  , 0.9 , 0.45]))
    """

    b: Samples
    a: Samples
    error: float
    is_resolved: bool

    @property
    def order(self) -> int:
        """Order N of the denominator and M = N of the numerator."""
        return self.a.size - 1

    @property
    def pole_radius(self) -> float:
        """Magnitude of the outermost pole, from the companion matrix of `a`; 0 if there are no poles."""
        return float(np.max(np.abs(np.roots(self.a)), initial=0.0))

    @property
    def is_stable(self) -> bool:
        """Whether all poles lie inside the unit circle."""
        return self.pole_radius < 1

    def synthesize(self, n_samples: int) -> Samples:
        """Return the impulse response, shape (n_samples,), at the sampling rate of the segment.

        The response of an unstable filter grows without bound, up to infinity and NaN.
        """
        from scipy import signal

        impulse = np.zeros(n_samples)
        impulse[:1] = 1.0
        return np.asarray(signal.lfilter(self.b, self.a, impulse))


def fit_prony(x: ArrayLike, resolution: float, *, max_order: int | None = None) -> PronyFilter:
    """Fit a filter by Prony's method, with the smallest order that reaches a given resolution.

    The order starts at the number of extrema of the segment. It is increased by one until the mean absolute
    error (1/n) sum |x - h| of the impulse response h falls below the resolution.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Segment that starts at the onset of a decaying vibration, at least 2 samples, in any unit.
    resolution : float
        Largest mean absolute error, positive, in the unit of `x`. The paper uses one bit of its sensor, 0.153
        m/s^2.
    max_order : int, optional
        Largest order (default n_samples - 1, where the numerator alone reproduces the segment).

    Returns
    -------
    PronyFilter
        First filter with an error below the resolution, stable or not; otherwise the filter with the smallest
        error.

    Raises
    ------
    ValueError
        If `x` has fewer than 2 samples, more than one channel, NaN or infinity, the resolution is not
        positive, or `max_order` is below 1.

    References
    ----------
    `guruswamy2011`, section IV-A; filters of section III with M = N.

    Examples
    --------
    >>> from scipy import signal
    >>> h = signal.lfilter([1.0, 0.4], [1.0, -1.5, 0.8], np.eye(1, 12)[0])
    >>> model = fit_prony(h, resolution=1e-6)
    >>> model.order, model.is_resolved, model.is_stable
    (2, True, True)
    """
    samples = one_channel(x, "segment", at_least=2)
    last = samples.size - 1 if max_order is None else max_order
    first = min(max(n_extrema(samples), 1), last)
    if not resolution > 0:
        raise ValueError(f"resolution must be positive, got {resolution} (in the unit of the segment)")
    if first < 1:
        raise ValueError(f"max_order must be at least 1, got {last}")
    best = prony(samples, first, resolution)
    for order in range(first + 1, last + 1):
        if best.is_resolved:
            break
        candidate = prony(samples, order, resolution)
        best = candidate if candidate.error < best.error else best
    return best


def prony(x: ArrayLike, order: int, resolution: float = 0.0) -> PronyFilter:
    """Fit a filter of a given order M = N by Prony's method.

    After sample M the impulse response satisfies h_n = -sum_(k=1..N) a_k h_(n-k): the a_k are the
    least-squares solution over n = M+1 ... of the segment. The numerator makes the first M+1 samples exact,
    b_n = sum_(k=0..n) a_k h_(n-k). A segment shorter than M + N + 2 samples is padded with zeros to that
    length.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Segment in any unit.
    order : int
        Order, at least 1.
    resolution : float
        Error below which `is_resolved` is True, in the unit of `x` (default 0).

    Returns
    -------
    PronyFilter

    Raises
    ------
    ValueError
        If the segment is empty, has more than one channel, NaN or infinity, or the order is below 1.

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
        raise ValueError(f"order must be at least 1, got {order}")
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
    """Return the number of local maxima and minima inside a segment; a plateau counts once."""
    slopes = np.sign(np.diff(np.asarray(x, dtype=np.float64)))
    slopes = slopes[slopes != 0]
    return int(np.sum(slopes[1:] != slopes[:-1]))
