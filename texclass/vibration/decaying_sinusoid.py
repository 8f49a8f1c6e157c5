"""Taps as decaying sinusoids, a(t) = A v exp(-B t) sin(w t): amplitude slope, decay rate and frequency."""

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
    """Thresholds of `fit_okamura`, which the paper leaves open.

    Attributes
    ----------
    least_ringing
        Samples of the shortest beginning of a tap whose spectrum is looked at.
    clear
        Height of a spectral peak over the largest of noise alone, from which it is one.
    apart
        Least distance of two peaks, in half periods.
    peak_floor
        The envelope ends before the first peak below this part of the largest: there noise makes the peaks.
    most_before
        Nepers by which the envelope at the impact may exceed the largest peak.
    """

    least_ringing: int = 64
    clear: float = 1.5
    apart: float = 0.7
    peak_floor: float = 0.1
    most_before: float = 5.0


OKAMURA = OkamuraSettings()


@dataclass(frozen=True)
class TapModel:
    """A tap at impact velocity v as a(t) = A v exp(-B t) sin(2 pi f t), t >= 0 from the impact.

    Attributes
    ----------
    amplitude_slope : float
        A, amplitude per impact velocity: (m/s^2) / (m/s) = 1/s for accelerations in m/s^2. Its sign is that
        of the first half wave.
    decay_per_s : float
        B > 0, in 1/s.
    frequency_hz : float
        f > 0.

    Notes
    -----
    `okamura2001`, eq. (1) and Table I. The printed decay rates of 40,000 to 1,500,000 1/s contradict its
    Fig. 3, where vibrations last for milliseconds: read 40 to 1500 1/s. Frequencies are in Hz.
    """

    amplitude_slope: float
    decay_per_s: float
    frequency_hz: float

    def __post_init__(self) -> None:
        numbers = (self.amplitude_slope, self.decay_per_s, self.frequency_hz)
        if not (np.isfinite(numbers).all() and min(numbers[1:]) > 0):
            raise ValueError(f"{self}. Expected finite numbers, decay rate and frequency above 0")

    def modes(self, velocity: float) -> DecayingModes:
        """Return the tap at one impact velocity as a decaying mode, to be filtered or mixed with others."""
        amplitude = self.amplitude_slope * velocity
        phase = -np.pi / 2 if amplitude >= 0 else np.pi / 2
        f, B, A, phi = np.array([[self.frequency_hz], [self.decay_per_s], [abs(amplitude)], [phase]])
        return DecayingModes(f, B, A, phi)

    def synthesize(self, velocity: float, n_samples: int, fs: float) -> Samples:
        """Return the tap at an impact velocity, shape (n_samples,), from the impact on, at any `fs` (Hz)."""
        return self.modes(velocity).synthesize(n_samples, fs)


def fit_okamura(
    taps: Sequence[ArrayLike], velocity: ArrayLike, fs: float, *, settings: OkamuraSettings = OKAMURA
) -> TapModel:
    """Fit the tap model as published: frequency from the spectrum, decay from the peaks, slope by regression.

    - Frequency: maximum of the magnitude spectrum (interpolated) of each tap; the mean over taps. For a
      complete decay it lies at sqrt(w^2 - B^2), below w.
    - Decay: log |peak| = log E - B t by least squares over the positive and negative peaks of each tap, each
      peak weighted with its height; the mean over taps. There is one peak in half a period, from the largest
      on, and the first one below `peak_floor` of it, or not below the one before, ends the envelope.
    - Amplitude slope: regression through the origin of the amplitudes on the velocities, as A v has no
      offset. The amplitude of a tap is E sqrt(1 + (B/w)^2): exp(-B t) sin(w t) has its peaks where sin(w t)
      is w / sqrt(w^2 + B^2).

    Parameters
    ----------
    taps : sequence of array_like, each of shape (n_samples,)
        From the impact on, without offset; lengths may differ. Any one unit.
    velocity : array_like of shape (n_taps,)
        Impact velocities, not all zero; ones, if they are unknown.
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
        For no tap, a tap with fewer than two peaks that decay or within the noise, other numbers of
        velocities than of taps, velocities that are all zero, NaN or infinity.

    Notes
    -----
    Its limit is the noise on the few peaks that there are. Of the materials of Table I, in recordings of 0.05
    and 0.5 s with white noise 30 dB below the largest peak, f is within 10 % of the undamped frequency
    (rubber 20 %: a spectrum of few periods) and B within 10 %; with noise 20 dB below, B is within 30 %.
    Where no spectral peak stands out of the noise, or the peaks do not decay, the fit is refused.
    `fit_tap_model` reads all samples instead.

    References
    ----------
    `okamura2001`, section II-B.
    """
    scaled, v, exponent = checked_taps(taps, velocity)
    frequency_hz, B, E = np.empty((3, len(scaled)))
    for i, tap in enumerate(scaled):
        x = tap[: _ringing(tap, f"tap {i}", settings)]
        frequency_hz[i] = _spectral_peak_hz(x, fs)
        place, height = _falling_peaks(x, fs / (2 * frequency_hz[i]), settings)
        if place.size < 2:
            raise ValueError(f"tap {i} has {place.size} peaks that decay. Expected at least 2")
        slope, level = np.polyfit(place / fs, np.log(np.abs(height)), 1, w=np.abs(height))
        if not (slope < 0 and level < np.log(np.abs(height).max()) + settings.most_before):
            raise ValueError(f"tap {i} does not decay as a sinusoid does: its peaks are within the noise")
        B[i], E[i] = -slope, np.sign(height[0]) * np.exp(level)
    E *= np.sqrt(1 + (B / (2 * np.pi * frequency_hz)) ** 2)
    u = v / np.max(np.abs(v))
    A = float(u @ E / (u @ u))
    return TapModel(_slope(A, v, exponent), float(B.mean()), float(frequency_hz.mean()))


def _falling_peaks(x: Samples, half_period: float, settings: OkamuraSettings) -> tuple[Samples, Samples]:
    """Return place (in samples) and signed height of the peaks of a tap, from the largest on while they fall.

    Each is that of a parabola through the eighth of a period on either side, which averages noise.
    """
    side = max(1, int(half_period / 4))
    found, _ = find_peaks(np.abs(x), distance=max(1.0, settings.apart * half_period))
    found = found[(found >= side) & (found < x.size - side)]
    if not found.size:
        return np.empty(0), np.empty(0)
    around = np.arange(-side, side + 1)
    a, b, c = np.linalg.pinv(np.vander(around, 3)) @ x[found + around[:, np.newaxis]]
    shift = np.clip(np.divide(-b, 2 * a, out=np.zeros_like(b), where=a != 0), -side, side)
    place, height = found + shift, c + (b + a * shift) * shift
    size = np.abs(height)
    first = int(np.argmax(size))
    ends = (size[first + 1 :] < settings.peak_floor * size[first]) | (np.diff(size[first:]) >= 0)
    last = first + 1 + (int(np.argmax(ends)) if ends.any() else ends.size)
    return place[first:last], height[first:last]


def fit_tap_model(taps: Sequence[ArrayLike], velocity: ArrayLike, fs: float) -> TapModel:
    """Fit the tap model to all taps at once by maximum likelihood (white Gaussian noise of one level).

    Minimises sum_i |x_i - A v_i exp(-B t) sin(w t)|^2 over B and w, with A eliminated: for given B and w it
    is the projection of the taps on the shape (variable projection). The search starts from `fit_okamura`,
    where that succeeds, from the matrix pencil of the tap of most energy, and from spectral peaks of the
    beginnings of the taps; the best end counts.

    Parameters
    ----------
    taps : sequence of array_like, each of shape (n_samples,)
        From the impact on, without offset; lengths may differ, at least 4 samples each. Any one unit.
    velocity : array_like of shape (n_taps,)
        Impact velocities, not all zero; ones, if they are unknown.
    fs : float
        Sampling rate in Hz.

    Returns
    -------
    TapModel
        B lies between 1e-6 and 1e3 nepers over the longest tap, f between 0.01 periods in it and fs/2.

    Raises
    ------
    ValueError
        For no tap, taps that are all silent, other numbers of velocities than of taps, velocities that are
        all zero, NaN or infinity.

    References
    ----------
    Model of `okamura2001`, eq. (1). Golub, Pereyra, "Separable nonlinear least squares", 2003; Jacobian after
    Kaufman.

    Examples
    --------
    >>> truth = TapModel(-1500.0, 60.0, 592.0)
    >>> v = [0.1, 0.3]
    >>> found = fit_tap_model([truth.synthesize(u, 300, 25_000.0) for u in v], v, 25_000.0)
    >>> round(found.amplitude_slope), round(found.decay_per_s, 6), round(found.frequency_hz, 6)
    (-1500, 60.0, 592.0)
    """
    scaled, v, exponent = checked_taps(taps, velocity, at_least=4)
    if not any(np.any(tap) for tap in scaled):
        raise ValueError("taps are all zero. Expected at least one sample that is not")
    problem = TapShapes(scaled, v / np.max(np.abs(v)))
    longest = max(tap.size for tap in scaled)
    lower, upper = np.array([1e-6, 0.02 * np.pi]) / longest, np.array([1e3 / longest, np.pi])
    ends = [
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
    best = min(ends, key=lambda end: float(end.cost)).x
    (A,), (beta, omega) = problem.amplitudes(problem.shapes(best)[1]), best
    return TapModel(_slope(float(A), v, exponent), float(beta * fs), float(omega * fs / (2 * np.pi)))


def checked_taps(
    taps: Sequence[ArrayLike], velocity: ArrayLike, at_least: int = 1
) -> tuple[list[Samples], Samples, int]:
    """Return the taps in one common scale, the velocities and the exponent of the scale."""
    v = one_channel(velocity, "velocity")
    if v.size != len(taps) or not np.any(v):
        raise ValueError(f"velocity is {v} for {len(taps)} taps. Expected one for each, not all zero")
    arrays = [one_channel(tap, f"tap {i}", at_least=at_least) for i, tap in enumerate(taps)]
    unit, exponent = to_unit_scale(np.concatenate(arrays))
    return np.split(unit, np.cumsum([tap.size for tap in arrays])[:-1]), v, exponent


def _slope(amplitude: float, v: Samples, exponent: int) -> float:
    """Return the amplitude at the largest velocity, in its own scale, per velocity; infinite if too large."""
    with np.errstate(over="ignore", under="ignore"):
        return float(np.ldexp(amplitude / np.max(np.abs(v)), exponent))


def _ringing(x: Samples, name: str, settings: OkamuraSettings) -> int:
    """Return how many samples of a tap have the clearest spectral peak: later ones add noise alone.

    Raises
    ------
    ValueError
        If no peak is higher than noise makes it.
    """
    sizes = [x.size]
    while sizes[-1] >= 2 * settings.least_ringing:
        sizes.append(sizes[-1] // 2)
    clear = []
    for size in sizes:
        magnitude = np.abs(fft.rfft(x[:size]))
        # The largest of m magnitudes of white noise is about sqrt(log2 m) times their median.
        of_noise = np.median(magnitude) * np.sqrt(np.log2(max(magnitude.size, 2)))
        clear.append(magnitude[1:].max(initial=0.0) / max(of_noise, 1e-300))
    if x.size >= settings.least_ringing and max(clear) < settings.clear:
        raise ValueError(f"{name} is within the noise. Expected a spectral peak that stands out")
    return next(size for size, ratio in zip(sizes, clear, strict=True) if ratio >= 0.7 * max(clear))


def _spectral_peak_hz(x: Samples, fs: float) -> float:
    """Return the frequency of the largest magnitude: a grid 16 times finer than 1/duration, a parabola."""
    n = fft.next_fast_len(16 * x.size, real=True)
    magnitude = np.abs(fft.rfft(x, n))
    k = int(np.argmax(magnitude[1:-1])) + 1
    left, top, right = magnitude[k - 1 : k + 2]
    curvature = left - 2 * top + right
    shift = np.clip((left - right) / (2 * curvature), -0.5, 0.5) if curvature < 0 else 0.0
    return float((k + shift) * fs / n)


def _starts(taps: list[Samples], v: Samples, fs: float) -> list[Samples]:
    """Return starting values (B, w) per sample: as published, spectrum, and modes of the strongest tap."""
    strongest = max(taps, key=lambda tap: float(tap @ tap))
    omega = 2 * np.pi * _spectral_peak_hz(strongest, 1.0)
    starts = [np.array([1 / strongest.size, omega]), np.array([10 / strongest.size, omega])]
    # Short decays in long recordings: the best of a grid, of the peaks of the taps' beginnings together.
    problem = TapShapes(taps, v / np.max(np.abs(v)))
    grid = []
    size = strongest.size
    while size >= OKAMURA.least_ringing:
        power = np.sum([np.abs(fft.rfft(tap[:size], 2 * size)) ** 2 for tap in taps], axis=0)
        peaks, _ = find_peaks(power)
        for k in peaks[np.argsort(power[peaks])[-3:]]:
            grid += [np.array([B / size, np.pi * k / size]) for B in (1.0, 3.0, 10.0)]
        size //= 2
    grid.sort(key=lambda start: float(np.sum(problem.residual(start) ** 2)))
    starts += grid[:3]
    try:
        eye = fit_okamura(taps, v, fs)
        starts.append(np.array([eye.decay_per_s, 2 * np.pi * eye.frequency_hz]) / fs)
    except ValueError:
        pass  # no clear peaks: the other starts remain
    for order in (2, None):
        modes = fit_matrix_pencil(strongest, 1.0, order=order)
        for f, B in zip(modes.frequency_hz[:2], modes.decay_per_s[:2], strict=True):
            starts.append(np.array([B, 2 * np.pi * f]))
    return starts


class TapShapes:
    """Taps less their decaying sinusoids: what `scipy.optimize.least_squares` brings near zero.

    The parameters are B / fs, w / fs and, where the taps do not begin with the impact, the sample of each
    one's onset. The amplitudes are eliminated: at given parameters they are projections.

    Parameters
    ----------
    taps : list of ndarray of shape (n_samples,)
    share : ndarray of shape (n_taps,), optional
        Amplitudes of the taps relative to each other, of which one is found for all; by default each tap has
        its own.
    """

    def __init__(self, taps: list[Samples], share: Samples | None = None) -> None:
        sizes = [x.size for x in taps]
        self.x = np.concatenate(taps)
        self.n = np.concatenate([np.arange(size, dtype=np.float64) for size in sizes])
        self.tap: NDArray[np.intp] = np.repeat(np.arange(len(taps)), sizes)
        self.group = self.tap if share is None else np.zeros_like(self.tap)
        self.weight = 1.0 if share is None else share[self.tap]

    def sums(self, values: Samples) -> Samples:
        """Sum over the samples that have one amplitude."""
        return np.asarray(np.bincount(self.group, values), dtype=np.float64)

    def shapes(self, p: Samples) -> tuple[Samples, Samples, Samples]:
        """Return t, phi = exp(-B t) sin(w t) and exp(-B t) cos(w t), 0 before the onset."""
        t = self.n - p[2:][self.tap] if p.size > 2 else self.n
        with np.errstate(under="ignore"):
            envelope = np.where(t >= 0, self.weight * np.exp(-p[0] * np.maximum(t, 0.0)), 0.0)
            return t, envelope * np.sin(p[1] * t), envelope * np.cos(p[1] * t)

    def amplitudes(self, phi: Samples) -> Samples:
        """Return a = phi x / phi phi of each tap, or the one of all."""
        energy = self.sums(phi * phi)
        return np.asarray(self.sums(phi * self.x) / np.where(energy > 0, energy, 1.0))

    def residual(self, p: Samples) -> Samples:
        """Return a phi - x."""
        phi = self.shapes(p)[1]
        return np.asarray(self.amplitudes(phi)[self.group] * phi - self.x)

    def jacobian(self, p: Samples) -> Samples:
        """Return a (1 - phi phi^T / phi^T phi) d phi, Kaufman's form; a row has B, w and one onset."""
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
