"""Tap models: decaying sinusoids a(t) = A v exp(-B t) sin(w t) at the impact velocity v."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft, optimize
from scipy.signal import find_peaks

from texclass.recording import Samples
from texclass.signals import one_channel, to_unit_scale
from texclass.vibration.decaying_modes import DecayingModes, fit_matrix_pencil


@dataclass(frozen=True)
class OkamuraSettings:
    """Thresholds of `fit_okamura`. The paper does not state them.

    Attributes
    ----------
    min_samples
        Smallest number of initial samples of a tap from which a spectrum is computed.
    min_peak_to_noise
        Smallest ratio of a spectral peak to the largest magnitude expected from noise alone.
    min_peak_distance
        Smallest distance between two peaks of the envelope, in half periods.
    peak_floor
        Peaks are used up to the first that is below this fraction of the largest peak, because noise
        dominates smaller peaks.
    max_onset_excess
        Largest excess of the fitted envelope at the impact over the largest peak, in nepers.
    """

    min_samples: int = 64
    min_peak_to_noise: float = 1.5
    min_peak_distance: float = 0.7
    peak_floor: float = 0.1
    max_onset_excess: float = 5.0


OKAMURA = OkamuraSettings()


@dataclass(frozen=True)
class TapModel:
    """Model of a tap at the impact velocity v: a(t) = A v exp(-B t) sin(2 pi f t), t >= 0 from the impact.

    Attributes
    ----------
    amplitude_slope : float
        Amplitude per unit of impact velocity, A, in (m/s^2) / (m/s) = 1/s for accelerations in m/s^2. It has
        the sign of the first half-wave.
    decay_per_s : float
        Decay rate B > 0 in 1/s.
    frequency_hz : float
        Frequency f > 0 in Hz.

    Notes
    -----
    `okamura2001`, eq. (1) and Table I. The printed decay rates of 40,000 to 1,500,000 1/s contradict its
    Fig. 3, where vibrations last for milliseconds, so they are read as 40 to 1500 1/s. Frequencies are in Hz.

    Examples
    --------
    >>> aluminium = TapModel(amplitude_slope=-300.0, decay_per_s=90.0, frequency_hz=1153.0)
    >>> aluminium.synthesize(velocity=0.2, n_samples=4, fs=10_000.0).round(1)
    array([  0. , -39.4, -58.5, -48.1])
    """

    amplitude_slope: float
    decay_per_s: float
    frequency_hz: float

    def __post_init__(self) -> None:
        numbers = (self.amplitude_slope, self.decay_per_s, self.frequency_hz)
        if not (np.isfinite(numbers).all() and min(numbers[1:]) > 0):
            raise ValueError(f"a TapModel must be finite, with positive decay rate and frequency, got {self}")

    def modes(self, velocity: float) -> DecayingModes:
        """Return the tap at one impact velocity as a decaying mode."""
        amplitude = self.amplitude_slope * velocity
        phase = -np.pi / 2 if amplitude >= 0 else np.pi / 2
        f, B, A, phi = np.array([[self.frequency_hz], [self.decay_per_s], [abs(amplitude)], [phase]])
        return DecayingModes(f, B, A, phi)

    def synthesize(self, velocity: float, n_samples: int, fs: float) -> Samples:
        """Return the first `n_samples` samples of a tap at `velocity`, starting at the impact."""
        return self.modes(velocity).synthesize(n_samples, fs)


def fit_okamura(
    taps: Sequence[ArrayLike], velocity: ArrayLike, fs: float, *, settings: OkamuraSettings = OKAMURA
) -> TapModel:
    """Fit the tap model as published: frequency from the spectrum, decay from the peaks, slope by regression.

    1. Frequency: maximum of the interpolated magnitude spectrum of each tap, averaged over the taps. For a
       complete decay it lies at sqrt(w^2 - B^2), below w.
    2. Decay: least-squares line log |peak| = log E - B t through the positive and negative peaks of each tap,
       weighted by their heights, and averaged over the taps. One peak per half period is used, from the
       largest peak up to the first peak that is below `peak_floor` or not below its predecessor.
    3. Amplitude slope: regression through the origin of the amplitudes on the velocities, because A v has no
       offset. The amplitude of a tap is E sqrt(1 + (B/w)^2), because exp(-B t) sin(w t) has its peaks where
       sin(w t) = w / sqrt(w^2 + B^2).

    Parameters
    ----------
    taps : sequence of array_like, each of shape (n_samples,)
        Taps that start at the impact, without offset, all in the same unit. Lengths may differ.
    velocity : array_like of shape (n_taps,)
        Impact velocities in m/s, not all zero. Pass ones if they are unknown.
    fs : float
        Sampling rate in Hz.
    settings : OkamuraSettings
        Thresholds of the algorithm.

    Returns
    -------
    TapModel

    Raises
    ------
    ValueError
        If there is no tap, a tap has fewer than two decaying peaks or does not exceed the noise, the numbers
        of velocities and taps differ, all velocities are zero, or a value is NaN or infinite.

    Notes
    -----
    The accuracy is limited, because only a few noisy peaks are used. For the materials of Table I, in
    recordings of 0.05 and 0.5 s with white noise 30 dB below the largest peak, f is within 10 % of the
    undamped frequency (20 % for rubber, whose taps have few periods) and B is within 10 %. With noise 20 dB
    below the largest peak, B is within 30 %. `fit_tap_model` uses all samples and is more accurate.

    References
    ----------
    `okamura2001`, section II-B.

    Examples
    --------
    >>> truth = TapModel(-1500.0, 60.0, 592.0)
    >>> velocity = [0.1, 0.3]
    >>> model = fit_okamura([truth.synthesize(v, 300, 25_000.0) for v in velocity], velocity, 25_000.0)
    >>> round(model.amplitude_slope), round(model.decay_per_s), round(model.frequency_hz)
    (-1498, 60, 591)
    """
    scaled, v, exponent = checked_taps(taps, velocity)
    frequency_hz, B, E = np.empty((3, len(scaled)))
    for i, tap in enumerate(scaled):
        x = tap[: _ringing(tap, f"tap {i}", settings)]
        frequency_hz[i] = _spectral_peak_hz(x, fs)
        position, height = _falling_peaks(x, fs / (2 * frequency_hz[i]), settings)
        if position.size < 2:
            raise ValueError(f"tap {i} must contain at least 2 decaying peaks, got {position.size}")
        slope, level = np.polyfit(position / fs, np.log(np.abs(height)), 1, w=np.abs(height))
        if not (slope < 0 and level < np.log(np.abs(height).max()) + settings.max_onset_excess):
            raise ValueError(
                f"tap {i} must be a decaying sinusoid, but its peaks do not exceed the noise. Omit this tap"
            )
        B[i], E[i] = -slope, np.sign(height[0]) * np.exp(level)
    E *= np.sqrt(1 + (B / (2 * np.pi * frequency_hz)) ** 2)
    u = v / np.max(np.abs(v))
    A = float(u @ E / (u @ u))
    return TapModel(_slope(A, v, exponent), float(B.mean()), float(frequency_hz.mean()))


def _falling_peaks(x: Samples, half_period: float, settings: OkamuraSettings) -> tuple[Samples, Samples]:
    """Return the positions in samples and the signed heights of the peaks of a tap.

    The largest peak is the first; the series ends where the heights no longer fall. Each peak is the vertex
    of a parabola fitted to an eighth of a period on either side, which reduces noise.
    """
    side = max(1, int(half_period / 4))
    peaks, _ = find_peaks(np.abs(x), distance=max(1.0, settings.min_peak_distance * half_period))
    peaks = peaks[(peaks >= side) & (peaks < x.size - side)]
    if not peaks.size:
        return np.empty(0), np.empty(0)
    offsets = np.arange(-side, side + 1)
    a, b, c = np.linalg.pinv(np.vander(offsets, 3)) @ x[peaks + offsets[:, np.newaxis]]
    shift = np.clip(np.divide(-b, 2 * a, out=np.zeros_like(b), where=a != 0), -side, side)
    position, height = peaks + shift, c + (b + a * shift) * shift
    size = np.abs(height)
    first = int(np.argmax(size))
    ends = (size[first + 1 :] < settings.peak_floor * size[first]) | (np.diff(size[first:]) >= 0)
    last = first + 1 + (int(np.argmax(ends)) if ends.any() else ends.size)
    return position[first:last], height[first:last]


def fit_tap_model(taps: Sequence[ArrayLike], velocity: ArrayLike, fs: float) -> TapModel:
    """Fit the tap model to all taps jointly by maximum likelihood (white Gaussian noise of constant level).

    The fit minimises sum_i |x_i - A v_i exp(-B t) sin(w t)|^2 over B and w. The slope A is eliminated: for
    fixed B and w it is the projection of the taps on the shape (variable projection). The search starts from
    `fit_okamura` if that succeeds, from the matrix pencil of the tap with the most energy, and from the
    spectral peaks of the initial parts of the taps. The best result is returned.

    Parameters
    ----------
    taps : sequence of array_like, each of shape (n_samples,)
        Taps of at least 4 samples that start at the impact, without offset, all in the same unit. Lengths may
        differ.
    velocity : array_like of shape (n_taps,)
        Impact velocities in m/s, not all zero. Pass ones if they are unknown.
    fs : float
        Sampling rate in Hz.

    Returns
    -------
    TapModel
        Model. B lies between 1e-6 and 1e3 divided by the duration of the longest tap, and f between 0.01
        divided by this duration and fs/2.

    Raises
    ------
    ValueError
        If there is no tap, all taps are silent, the numbers of velocities and taps differ, all velocities are
        zero, or a value is NaN or infinite.

    References
    ----------
    `okamura2001`, eq. (1), for the model; Golub, Pereyra, "Separable nonlinear least squares", 2003, also for
    the Jacobian of Kaufman.

    Examples
    --------
    >>> truth = TapModel(-1500.0, 60.0, 592.0)
    >>> velocity = [0.1, 0.3]
    >>> model = fit_tap_model([truth.synthesize(v, 300, 25_000.0) for v in velocity], velocity, 25_000.0)
    >>> round(model.amplitude_slope), round(model.decay_per_s, 6), round(model.frequency_hz, 6)
    (-1500, 60.0, 592.0)
    """
    scaled, v, exponent = checked_taps(taps, velocity, at_least=4)
    if not any(np.any(tap) for tap in scaled):
        raise ValueError("taps must contain a sample that is not zero, got silence")
    problem = TapShapes(scaled, v / np.max(np.abs(v)))
    longest = max(tap.size for tap in scaled)
    lower, upper = np.array([1e-6, 0.02 * np.pi]) / longest, np.array([1e3 / longest, np.pi])
    solutions = [
        optimize.least_squares(
            problem.residual,
            np.clip(start, lower * 1.01, upper / 1.01),
            problem.jacobian,
            bounds=(lower, upper),
            x_scale="jac",
            xtol=1e-12,
            ftol=1e-14,
            gtol=1e-14,
        )
        for start in _starts(scaled, v, fs)
    ]
    best = min(solutions, key=lambda solution: float(solution.cost)).x
    (A,), (beta, omega) = problem.amplitudes(problem.shapes(best)[1]), best
    return TapModel(_slope(float(A), v, exponent), float(beta * fs), float(omega * fs / (2 * np.pi)))


def checked_taps(
    taps: Sequence[ArrayLike], velocity: ArrayLike, at_least: int = 1
) -> tuple[list[Samples], Samples, int]:
    """Check taps and velocities. Return taps divided by 2^exponent, velocities, and exponent."""
    v = one_channel(velocity, "velocity")
    if v.size != len(taps) or not np.any(v):
        raise ValueError(f"velocity must contain one value per tap ({len(taps)}), not all zero, got {v}")
    arrays = [one_channel(tap, f"tap {i}", at_least=at_least) for i, tap in enumerate(taps)]
    unit, exponent = to_unit_scale(np.concatenate(arrays))
    return np.split(unit, np.cumsum([tap.size for tap in arrays])[:-1]), v, exponent


def _slope(amplitude: float, v: Samples, exponent: int) -> float:
    """Convert a scaled amplitude at the largest velocity to an amplitude slope; infinite on overflow."""
    with np.errstate(over="ignore", under="ignore"):
        return float(np.ldexp(amplitude / np.max(np.abs(v)), exponent))


def _ringing(x: Samples, name: str, settings: OkamuraSettings) -> int:
    """Return the number of initial samples whose spectrum has the clearest peak.

    Raises
    ------
    ValueError
        If no peak exceeds the noise.
    """
    sizes = [x.size]
    while sizes[-1] >= 2 * settings.min_samples:
        sizes.append(sizes[-1] // 2)
    ratios = []
    for size in sizes:
        magnitude = np.abs(fft.rfft(x[:size]))
        # The largest of m magnitudes of white noise is about sqrt(log2 m) times their median.
        noise_peak = np.median(magnitude) * np.sqrt(np.log2(max(magnitude.size, 2)))
        ratios.append(magnitude[1:].max(initial=0.0) / max(noise_peak, 1e-300))
    if x.size >= settings.min_samples and max(ratios) < settings.min_peak_to_noise:
        raise ValueError(
            f"{name} must have a spectral peak above the noise. Omit this tap, or use fit_tap_model"
        )
    return next(size for size, ratio in zip(sizes, ratios, strict=True) if ratio >= 0.7 * max(ratios))


def _spectral_peak_hz(x: Samples, fs: float) -> float:
    """Return the frequency of the spectral maximum, interpolated by a parabola on a zero-padded grid."""
    n = fft.next_fast_len(16 * x.size, real=True)
    magnitude = np.abs(fft.rfft(x, n))
    k = int(np.argmax(magnitude[1:-1])) + 1
    lower, top, upper = magnitude[k - 1 : k + 2]
    curvature = lower - 2 * top + upper
    shift = np.clip((lower - upper) / (2 * curvature), -0.5, 0.5) if curvature < 0 else 0.0
    return float((k + shift) * fs / n)


def _starts(taps: list[Samples], v: Samples, fs: float) -> list[Samples]:
    """Return starting values (B / fs, w / fs) from `fit_okamura`, the spectrum and the matrix pencil."""
    strongest = max(taps, key=lambda tap: float(tap @ tap))
    omega = 2 * np.pi * _spectral_peak_hz(strongest, 1.0)
    starts = [np.array([1 / strongest.size, omega]), np.array([10 / strongest.size, omega])]
    # For short decays in long recordings: the best points of a grid over spectral peaks at the start of the
    # taps.
    problem = TapShapes(taps, v / np.max(np.abs(v)))
    grid = []
    size = strongest.size
    while size >= OKAMURA.min_samples:
        power = np.sum([np.abs(fft.rfft(tap[:size], 2 * size)) ** 2 for tap in taps], axis=0)
        peaks, _ = find_peaks(power)
        for k in peaks[np.argsort(power[peaks])[-3:]]:
            grid += [np.array([B / size, np.pi * k / size]) for B in (1.0, 3.0, 10.0)]
        size //= 2
    grid.sort(key=lambda start: float(np.sum(problem.residual(start) ** 2)))
    starts += grid[:3]
    try:
        published = fit_okamura(taps, v, fs)
        starts.append(np.array([published.decay_per_s, 2 * np.pi * published.frequency_hz]) / fs)
    except ValueError:
        pass  # without clear peaks, only the other starting values are used
    for order in (2, None):
        modes = fit_matrix_pencil(strongest, 1.0, order=order)
        for f, B in zip(modes.frequency_hz[:2], modes.decay_per_s[:2], strict=True):
            starts.append(np.array([B, 2 * np.pi * f]))
    return starts


class TapShapes:
    """Residuals between decaying sinusoids and taps, for `scipy.optimize.least_squares`.

    The parameters are B / fs, w / fs and, if the taps do not start at the impact, the onset of each tap in
    samples. The amplitudes are eliminated, because they follow from the other parameters by linear least
    squares.

    Parameters
    ----------
    taps : list of ndarray of shape (n_samples,)
        Taps in the same unit.
    share : ndarray of shape (n_taps,), optional
        Relative amplitudes of the taps. If given, only a common factor is fitted. By default, one amplitude
        is fitted per tap.
    """

    def __init__(self, taps: list[Samples], share: Samples | None = None) -> None:
        sizes = [x.size for x in taps]
        self.x = np.concatenate(taps)
        self.n = np.concatenate([np.arange(size, dtype=np.float64) for size in sizes])
        self.tap: NDArray[np.intp] = np.repeat(np.arange(len(taps)), sizes)
        self.group = self.tap if share is None else np.zeros_like(self.tap)
        self.weight = 1.0 if share is None else share[self.tap]

    def sums(self, values: Samples) -> Samples:
        """Return the sum of `values` for each amplitude, over all samples with this amplitude."""
        return np.asarray(np.bincount(self.group, values), dtype=np.float64)

    def shapes(self, p: Samples) -> tuple[Samples, Samples, Samples]:
        """Return t, phi = exp(-B t) sin(w t) and exp(-B t) cos(w t), 0 before the onset."""
        t = self.n - p[2:][self.tap] if p.size > 2 else self.n
        with np.errstate(under="ignore"):
            envelope = np.where(t >= 0, self.weight * np.exp(-p[0] * np.maximum(t, 0.0)), 0.0)
            return t, envelope * np.sin(p[1] * t), envelope * np.cos(p[1] * t)

    def amplitudes(self, phi: Samples) -> Samples:
        """Return the amplitude a = phi x / phi phi of each tap, or the common amplitude."""
        energy = self.sums(phi * phi)
        return np.asarray(self.sums(phi * self.x) / np.where(energy > 0, energy, 1.0))

    def residual(self, p: Samples) -> Samples:
        """Return the residual a phi - x."""
        phi = self.shapes(p)[1]
        return np.asarray(self.amplitudes(phi)[self.group] * phi - self.x)

    def jacobian(self, p: Samples) -> Samples:
        """Return Kaufman's Jacobian a (1 - phi phi^T / phi^T phi) d phi; columns are B, w and the onsets."""
        t, phi, cosine = self.shapes(p)
        a, energy = self.amplitudes(phi)[self.group], self.sums(phi * phi)
        energy = np.where(energy > 0, energy, 1.0)
        derivatives: list[tuple[Any, Samples]] = [(0, -t * phi), (1, t * cosine)]
        if p.size > 2:
            derivatives.append((2 + self.tap, p[0] * phi - p[1] * cosine))
        out = np.zeros((self.x.size, p.size))
        for column, d_phi in derivatives:
            along = (self.sums(phi * d_phi) / energy)[self.group] * phi
            out[np.arange(self.x.size), column] = a * (d_phi - along)
        return out
