"""A vibration as a sum of decaying sinusoids: by the matrix pencil, and by Prony's method as published."""

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
        Largest pencil parameter, in samples: beyond it the cost of the decomposition grows without need.
    noise_edge
        Largest over median singular value that white noise in a square Hankel matrix exceeds once in 100
        cases.
    resolved
        Part of the largest singular value below which rounding turns the singular vectors by 1e-6 and more.
    least_decay
        Least decay of a mode over the whole segment, in nepers: an undamped tone gets this one.
    """

    max_width: int = 400
    noise_edge: float = 3.3
    resolved: float = 1e-10
    least_decay: float = 1e-9


PENCIL = PencilSettings()


@dataclass(frozen=True, eq=False)
class Sinusoids:
    """What models of several sinusoids share: read-only arrays of one checked value for each of them."""

    frequency_hz: Samples

    def __post_init__(self) -> None:
        for name in (each.name for each in fields(self)):
            values = make_read_only(np.array(getattr(self, name), dtype=np.float64, ndmin=1))
            object.__setattr__(self, name, values)
            if values.shape != self.frequency_hz.shape or not np.all(np.isfinite(values)):
                raise ValueError(f"{name} is {values}. Expected one finite value for each frequency")
            if name != "phase" and np.any(values <= 0 if name == "decay_per_s" else values < 0):
                raise ValueError(f"{name} is {values}. Expected f >= 0, B > 0, A >= 0")


@dataclass(frozen=True, eq=False)
class DecayingModes(Sinusoids):
    """A vibration as a sum of decaying sinusoids, at no particular sampling rate.

    x(t) = sum_i A_i exp(-B_i t) cos(2 pi f_i t + phi_i) for t >= 0. Every B_i is positive, so every
    realisation is stable.

    Attributes
    ----------
    frequency_hz : ndarray of shape (n_modes,)
        f_i, not negative; 0 for a plain exponential.
    decay_per_s : ndarray of shape (n_modes,)
        B_i > 0, in 1/s.
    amplitude : ndarray of shape (n_modes,)
        A_i >= 0, in the unit of the vibration, strongest mode first when fitted.
    phase : ndarray of shape (n_modes,)
        phi_i, in rad.

    Raises
    ------
    ValueError
        If the shapes differ, a value is not finite, or a frequency, decay or amplitude breaks its rule.
    """

    decay_per_s: Samples
    amplitude: Samples
    phase: Samples

    @property
    def n_modes(self) -> int:
        """How many modes there are; a mode with 0 < f has two poles."""
        return int(np.size(self.frequency_hz))

    @property
    def table(self) -> Samples:
        """Frequency (Hz), decay rate (1/s), amplitude and phase of each mode, shape (n_modes, 4)."""
        return np.stack([self.frequency_hz, self.decay_per_s, self.amplitude, self.phase], axis=1)

    def strongest(self, n_modes: int, duration_s: float = np.inf) -> "DecayingModes":
        """Return the modes of most energy A^2 (1 - exp(-2 B T)) / B over the duration T, in that order."""
        largest = np.max(self.amplitude, initial=np.finfo(float).tiny)
        B = self.decay_per_s
        energy = (self.amplitude / largest) ** 2 * -np.expm1(-2 * B * duration_s) / B
        return DecayingModes(*self.table[np.argsort(-energy, kind="stable")[:n_modes]].T)

    def synthesize(self, n_samples: int, fs: float) -> Samples:
        """Return the vibration at t = 0, 1/fs, ..., evaluated in closed form.

        Parameters
        ----------
        n_samples : int
            Any length.
        fs : float
            Sampling rate in Hz, not that of the fit necessarily. Modes above fs/2 are left out.

        Returns
        -------
        ndarray of shape (n_samples,)
            In the unit of the amplitudes.
        """
        t = np.arange(n_samples) / positive(fs, "fs")
        x = np.zeros(n_samples)
        for f, B, A, phi in self.table[self.frequency_hz <= fs / 2]:
            x += A * np.exp(-B * t) * np.cos(2 * np.pi * f * t + phi)
        return x

    def sections(self, fs: float) -> Samples:
        """Return the filter whose impulse response is the vibration: parallel second-order sections.

        Mode i is one section, and the outputs of all sections are added::

            H_i(z) = A (cos phi - r cos(w - phi) z^-1) / (1 - 2 r cos w z^-1 + r^2 z^-2),
            r = exp(-B / fs),  w = 2 pi f / fs

        A real pole (f = 0, or f = fs/2) leaves z^-2 with coefficient 0. In parallel no section can overload
        another, and each is stable by itself.

        Parameters
        ----------
        fs : float
            Sampling rate in Hz. Modes above fs/2 are left out.

        Returns
        -------
        ndarray of shape (n_modes, 6)
            b0, b1, b2, a0, a1, a2 of each section, as scipy orders them.
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
        """Return `x` (shape (n_samples,), impulses for instance) through the `sections`, started at rest."""
        from scipy import signal

        excitation = one_channel(x, "excitation")
        parts = (signal.sosfilt(section[np.newaxis], excitation) for section in self.sections(fs))
        return np.asarray(sum(parts, np.zeros_like(excitation)))


NO_MODES = DecayingModes(*np.zeros((4, 0)))
"""Silence: no mode at all."""


def fit_matrix_pencil(
    x: ArrayLike,
    fs: float,
    *,
    order: int | None = None,
    outside: Literal["reflect", "project"] = "reflect",
    settings: PencilSettings = PENCIL,
) -> DecayingModes:
    """Fit decaying modes to a segment by the total-least-squares matrix pencil on its signal subspace.

    The Hankel matrix Y[i, j] = x[i + j] of a sum of P exponentials z_i^n has rank P, and its rows are
    combinations of the vectors (1, z_i, z_i^2, ...). With Y = U S V^T cut to the P largest singular values,
    V without its last row (V_1) and without its first (V_2) obey V_1 Phi = V_2, where the eigenvalues of Phi
    are the z_i. Both sides carry noise, so Phi is the total-least-squares solution. Amplitudes and phases
    then follow by linear least squares.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Segment that starts at the onset of the vibration. Any unit, at least 4 samples.
    fs : float
        Sampling rate in Hz.
    order : int, optional
        Number of poles P, at most n_samples // 2 (a decaying sinusoid has two). Without it, the rank that
        `numerical_rank` reads from the singular values.
    outside : {"reflect", "project"}
        What becomes of a pole outside the unit circle, see the notes.
    settings : PencilSettings
        Limits of the algorithm.

    Returns
    -------
    DecayingModes
        Strongest first. None at all for silence, or when no singular value stands out of the noise.

    Raises
    ------
    ValueError
        For fewer than 4 samples, more than one channel, NaN or infinity, or an order out of its range.

    Notes
    -----
    A pole outside the unit circle is *reflected* to 1/conj(z): frequency and rate stay, the growth becomes a
    decay, and nothing rings on past the segment. On request it is *projected* along its radius instead, to a
    decay of `least_decay` nepers over the segment: a segment that does not decay is fitted better that way,
    but the mode practically never ends. A pole closer to the circle than that is projected in either case.
    The amplitudes are fitted afterwards, so they are the best ones for the poles returned.

    The pencil parameter is n_samples // 2, at most `max_width`.

    References
    ----------
    Hua, Sarkar, "Matrix pencil method for estimating parameters of exponentially damped/undamped sinusoids in
    noise", 1990; Van Huffel et al., "Algorithm for time-domain NMR data fitting based on total least
    squares", 1994. It stands in for Prony's method in `guruswamy2011`, section IV-A.

    Examples
    --------
    >>> truth = DecayingModes(180.0, 60.0, 2.0, 0.5)
    >>> found = fit_matrix_pencil(truth.synthesize(300, 10_000.0), 10_000.0)
    >>> bool(abs(found.decay_per_s[0] - 60.0) < 1e-6)
    True
    """
    samples, exponent = to_unit_scale(one_channel(x, "segment", at_least=4))
    positive(fs, "fs")
    n = samples.size
    if order is not None and not 1 <= order <= n // 2:
        raise ValueError(f"order is {order}. Expected 1 to n_samples // 2 = {n // 2}")
    singular, V = _right_subspace(samples, settings.max_width)
    above_rounding = int(np.sum(singular > settings.resolved * singular[0]))
    rank = min(numerical_rank(singular, settings.noise_edge) if order is None else order, above_rounding)
    if rank == 0:
        return NO_MODES
    # The eigenvalues of Phi, V_1 Phi = V_2: with W the right vectors of [V_1 V_2], Phi = -W_12 W_22^-1.
    rank = min(rank, len(V) - 1)
    both = np.hstack([V[:-1, :rank], V[1:, :rank]])
    W = linalg.svd(both, lapack_driver="gesvd")[2].T  # many equal singular values: gesdd may give up
    Phi = -W[:rank, rank:] @ linalg.pinv(W[rank:, rank:])
    z = stabilised(np.asarray(linalg.eigvals(Phi), dtype=np.complex128), outside, settings.least_decay / n)
    z = z[z.imag >= 0]  # one of each conjugate pair; a negative real pole lies exactly at fs/2
    f, B = fs * (np.abs(np.angle(z)) / (2 * np.pi)), -np.log(np.abs(z)) * fs
    modes = fit_amplitudes(samples, f, B, fs).strongest(n, n / fs)
    with np.errstate(under="ignore"):
        amplitude = np.ldexp(modes.amplitude, exponent)
    return DecayingModes(modes.frequency_hz, modes.decay_per_s, amplitude, modes.phase)


def numerical_rank(singular: ArrayLike, noise_edge: float = PENCIL.noise_edge) -> int:
    """Return how many singular values of a nearly square Hankel matrix stand out of noise.

    Those above `noise_edge` times the median of the others count; signal is taken out of the median step by
    step. White noise alone gives 0 in 99 of 100 segments, at 20 to 800 samples.

    Parameters
    ----------
    singular : array_like of shape (n_values,)
        Descending.
    noise_edge : float
        See `PencilSettings`.

    Returns
    -------
    int
        At most three quarters of the values: the rest must show the noise.
    """
    s = np.asarray(singular, dtype=np.float64)
    rank, last = 0, -1
    while rank > last:
        last = rank
        rank = min(int(np.sum(s > noise_edge * np.median(s[rank:]))), 3 * s.size // 4)
    return rank


def stabilised(z: Poles, outside: Literal["reflect", "project"], least_decay: float) -> Poles:
    """Return the poles brought into the unit circle, to a decay of `least_decay` nepers a sample or more."""
    least = 2.0**-52  # a pole at 0 is a single impulse: no frequency, and a decay that log can still give
    z = np.where(np.abs(z) < least, least, z)
    radius = np.abs(z)
    inside = np.where(radius > 1, 1 / radius, radius) if outside == "reflect" else radius
    return np.asarray(z / radius * np.minimum(inside, np.exp(-least_decay)))


def _right_subspace(x: Samples, max_width: int) -> tuple[Samples, Samples]:
    """Return singular values and right singular vectors (columns) of the Hankel matrix."""
    Y = sliding_window_view(x, min(x.size // 2, max_width) + 1)
    step = 4 * max_width
    R: Samples = Y[:step]
    for start in range(step, len(Y), step):  # Y^T Y = R^T R, without ever storing a long Y
        R = np.asarray(np.linalg.qr(np.vstack([R, Y[start : start + step]]), mode="r"))
    try:
        _, singular, Vh = linalg.svd(R, full_matrices=False)
    except linalg.LinAlgError:  # divide and conquer is twice as fast, but gives up on a few finite matrices
        _, singular, Vh = linalg.svd(R, full_matrices=False, lapack_driver="gesvd")
    return singular, Vh.T


def fit_amplitudes(x: Samples, frequency_hz: Samples, decay_per_s: Samples, fs: float) -> DecayingModes:
    """Return the modes of these frequencies (0 ... fs/2) and decay rates with the best amplitudes and phases.

    They are linear in the vibration: real and imaginary part of one complex amplitude a mode, of which those
    without oscillation (f = 0, f = fs/2) have the real part alone.
    """
    turning = (frequency_hz > 0) & (frequency_hz < fs / 2)
    n = np.arange(x.size)[:, np.newaxis]
    with np.errstate(under="ignore"):
        powers = np.exp(-n * (decay_per_s / fs)) * np.exp(2j * np.pi * n * (frequency_hz / fs))
    design = np.hstack([powers.real, -powers.imag[:, turning]])
    size = np.maximum(linalg.norm(design, axis=0), np.finfo(float).tiny)
    c = linalg.lstsq(design / size, x, cond=1e-12)[0] / size
    amplitude = c[: frequency_hz.size].astype(np.complex128)
    amplitude[turning] += 1j * c[frequency_hz.size :]
    return DecayingModes(frequency_hz, decay_per_s, np.abs(amplitude), np.angle(amplitude))


# Prony's method, kept for comparison ------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PronyFilter:
    """H(z) = sum_i b_i z^-i / sum_i a_i z^-i with M = N, whose impulse response stands for a segment.

    It is what the method gave: whether it is stable is stated, not ensured.

    Attributes
    ----------
    b, a : ndarray of shape (order + 1,)
        Numerator (unit of the segment) and denominator (a_0 = 1).
    error : float
        Mean absolute difference of the impulse response to the segment, in the unit of the segment; infinite
        if the response overflows within the segment.
    resolved : bool
        Whether the error came to lie below the resolution that was asked for.
    """

    b: Samples
    a: Samples
    error: float
    resolved: bool

    @property
    def order(self) -> int:
        """Order N of the denominator and M = N of the numerator."""
        return self.a.size - 1

    @property
    def pole_radius(self) -> float:
        """Magnitude of the outermost pole, that of the companion matrix of `a`; 0 without poles."""
        return float(np.max(np.abs(np.roots(self.a)), initial=0.0))

    @property
    def is_stable(self) -> bool:
        """Whether all poles lie inside the unit circle."""
        return self.pole_radius < 1

    def synthesize(self, n_samples: int) -> Samples:
        """Return the impulse response, shape (n_samples,), at the rate of the segment, in direct form.

        An unstable filter grows without bound: to infinity and NaN, if `n_samples` is large enough.
        """
        from scipy import signal

        impulse = np.zeros(n_samples)
        impulse[:1] = 1.0
        return np.asarray(signal.lfilter(self.b, self.a, impulse))


def fit_prony(x: ArrayLike, resolution: float, *, max_order: int | None = None) -> PronyFilter:
    """Fit a filter of the smallest order that meets the sensor's resolution, by Prony's method.

    The order starts at the number of extrema of the segment and is raised by one until the mean absolute
    error (1/n) sum |x - h| of the impulse response h falls below the resolution.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Segment that starts at the onset of a decaying vibration. Any unit, at least 2 samples.
    resolution : float
        In the unit of `x`, above 0; the paper's is one bit, 0.153 m/s^2.
    max_order : int, optional
        Last order tried; n_samples - 1 by default, where the numerator alone can hold the segment.

    Returns
    -------
    PronyFilter
        The first one that meets the resolution, stable or not; otherwise that of the least error.

    Raises
    ------
    ValueError
        For fewer than 2 samples, more than one channel, NaN or infinity, a resolution that is not above 0, or
        a last order below 1.

    References
    ----------
    `guruswamy2011`, section IV-A; its denominators of section III with M = N.
    """
    samples = one_channel(x, "segment", at_least=2)
    last = samples.size - 1 if max_order is None else max_order
    first = min(max(n_extrema(samples), 1), last)
    if not resolution > 0:
        raise ValueError(f"resolution is {resolution}. Expected above 0, in the unit of the segment")
    if first < 1:
        raise ValueError(f"orders run from {first} to {last}. Expected 1 <= first <= last")
    best = prony(samples, first, resolution)
    for order in range(first + 1, last + 1):
        if best.resolved:
            break
        tried = prony(samples, order, resolution)
        best = tried if tried.error < best.error else best
    return best


def prony(x: ArrayLike, order: int, resolution: float = 0.0) -> PronyFilter:
    """Fit the filter of one order M = N by Prony's method.

    Past sample M the impulse response obeys h_n = -sum_(k=1..N) a_k h_(n-k): the a_k are the least-squares
    solution over n = M+1 ... of the segment. The numerator makes the first M+1 samples exact,
    b_n = sum_(k=0..n) a_k h_(n-k). A segment shorter than M + N + 2 samples is padded with zeros to that
    length.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Segment. Any unit.
    order : int
        At least 1.
    resolution : float
        Only decides `resolved`.

    Returns
    -------
    PronyFilter

    Raises
    ------
    ValueError
        For an empty segment, more than one channel, NaN or infinity, or an order below 1.

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
        raise ValueError(f"order is {order}. Expected at least 1")
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
    """Return how many local maxima and minima lie inside a segment; a plateau counts once."""
    slopes = np.sign(np.diff(np.asarray(x, dtype=np.float64)))
    slopes = slopes[slopes != 0]
    return int(np.sum(slopes[1:] != slopes[:-1]))
