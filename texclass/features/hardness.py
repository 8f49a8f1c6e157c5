"""Hardness and damping of a surface, and other features of taps [strese2015, section IV-B].

Features whose names start with "tap" can be computed at any sampling rate, even if only a nominal rate is
known.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np
import scipy
from numpy.typing import ArrayLike
from scipy import fft

from texclass.features.contract import Gain, UndefinedFeatureError, feature
from texclass.features.fineness import printed_centroids
from texclass.features.movement_filters import magnitude_of
from texclass.features.phase_view import TapSignal, TapView, transform, undefined_if
from texclass.recording import Samples

S = TypeVar("S")
T = TypeVar("T")
TapPeaks = tuple[TapSignal, Samples, list[int]]
"""A tap, the magnitude of its impulse, and the indices of its largest peaks."""
ENERGY_FRACTIONS = (0.1, 0.25, 0.5, 0.75, 0.9)
"""Fractions of the energy of a tap at which `tap_band` and `tap_course` are evaluated."""
FRACTION_NAMES = tuple(f"q{100 * fraction:.0f}" for fraction in ENERGY_FRACTIONS)


@transform
def tap_level(view: TapView) -> float:
    """Return the largest magnitude of all taps, in the unit of the samples.

    Raises
    ------
    UndefinedFeatureError
        If there are no taps, a sample is not finite, or all samples are 0.
    """
    undefined_if(not view.taps, "no tap found")
    return magnitude_of(np.concatenate([x for tap in view.taps for x in (tap.hand, tap.impulse)]))


@transform
def unit_taps(view: TapView) -> tuple[TapSignal, ...]:
    """Return the taps divided by `tap_level`."""
    scale = tap_level(view)
    return tuple(TapSignal(tap.hand / scale, tap.impulse / scale, tap.quality) for tap in view.taps)


def map_taps(function: Callable[[S], T], taps: Iterable[S]) -> list[T]:
    """Apply a function to every tap, and return the results for the taps for which it is defined.

    Raises
    ------
    UndefinedFeatureError
        If the function is undefined for every tap. The message is the reason for the first tap.
    """
    values: list[T] = []
    reasons: list[UndefinedFeatureError] = []
    for tap in taps:
        try:
            values.append(function(tap))
        except UndefinedFeatureError as reason:
            reasons.append(reason)
    if not values:
        raise reasons[0]
    return values


def median_over_taps(values: ArrayLike) -> Samples:
    """Return the median along the first axis. For few taps, this is faster than `numpy.median`."""
    x = np.sort(values, axis=0)
    return np.asarray((x[(len(x) - 1) // 2] + x[len(x) // 2]) / 2)


def impulse_peaks(magnitudes: Sequence[Samples], spacing: int, prominence: float) -> list[list[int]]:
    """Return the indices of the largest peaks of each tap, at most three, in order of time.

    A tap without bounces has fewer than three peaks, and a silent tap has none. The first and the last sample
    count as peaks if they are prominent.

    Parameters
    ----------
    magnitudes : sequence of ndarray of shape (m,)
        Magnitude of the impulse of each tap.
    spacing : int
        Smallest distance between two peaks, in samples.
    prominence : float
        Smallest prominence of a peak, relative to the largest magnitude of the tap.

    Returns
    -------
    list of list of int
        Peak indices of each tap.
    """
    silence = np.zeros(1)
    all_taps = np.concatenate([silence, *(x for i in magnitudes for x in (i, silence))])
    first = 1 + np.cumsum([0, *(i.size + 1 for i in magnitudes)])
    drop = prominence * np.maximum.reduceat(all_taps, first[:-1])
    peaks, _ = scipy.signal.find_peaks(all_taps, height=0.0)
    tap_index = np.searchsorted(first, peaks, side="right") - 1
    # A peak that is lower than the required prominence is not prominent, and it cannot suppress a higher
    # peak.
    is_high = all_taps[peaks] >= drop[tap_index]
    tap_index, candidates = tap_index[is_high], peaks[is_high].tolist()
    ends = np.searchsorted(tap_index, np.arange(len(magnitudes) + 1)).tolist()
    x = all_taps.tolist()
    highest = (
        _highest_peaks(x, candidates[begin:end], spacing, drop_of_tap)
        for begin, end, drop_of_tap in zip(ends, ends[1:], drop.tolist(), strict=False)
    )
    return [sorted(k - start for k in ks) for ks, start in zip(highest, first.tolist(), strict=False)]


def _tap_peaks(view: TapView, spacing: int, prominence: float) -> Iterable[TapPeaks]:
    taps = unit_taps(view)
    magnitudes = [np.abs(tap.impulse) for tap in taps]
    return zip(taps, magnitudes, impulse_peaks(magnitudes, spacing, prominence), strict=True)


def _highest_peaks(x: list[float], peaks: list[int], spacing: int, prominence: float) -> list[int]:
    """Return the (at most three) highest peaks that are `spacing` apart and have at least this prominence."""
    highest, candidates = list[int](), sorted(peaks, key=lambda k: (x[k], k), reverse=True)
    while candidates and not (len(highest) >= 3 and x[candidates[0]] < x[highest[2]]):
        k = candidates[0]
        candidates = [other for other in candidates[1:] if abs(other - k) >= spacing]
        if _falls(x, range(k, len(x)), prominence) and _falls(x, range(k, -1, -1), prominence):
            highest.append(k)
    return sorted(highest, key=lambda k: (-x[k], k))[:3]


def _falls(x: list[float], ks: range, drop: float) -> bool:
    """Return whether x falls by `drop` below its first value before it exceeds that value."""
    top = x[ks[0]]
    for k in ks:  # next to a prominent peak, the loop ends after a few samples
        if x[k] > top:
            return False
        if top - x[k] >= drop:
            return True
    return False


@feature("tap", "1", "strese2015, eq. 1", depends_on=("rate",))
def hardness_as_printed(view: TapView, *, spacing: int = 100, prominence: float = 0.01) -> float:
    """Return the hardness H = (max(i) / n) / sum(h) as printed, averaged over taps.

    In this formula, i is the magnitude of impact and decay, n is the mean index (from 1) of its three largest
    peaks (or fewer), and h is the magnitude of the acceleration of the hand. H is proportional to 1/fs^2,
    because both n and the sum count samples.

    Parameters
    ----------
    view : TapView or array_like of shape (n,)
        Taps. For an array, also pass `fs` in Hz; the taps are located first.
    spacing : int
        Smallest distance between two peaks, in samples.
    prominence : float
        Smallest prominence of a peak, relative to the largest peak. Because the threshold is relative, H does
        not depend on the gain.

    Returns
    -------
    float
        Hardness.

    Raises
    ------
    UndefinedFeatureError
        If there are no taps, or no tap has both an impulse and an acceleration of the hand.

    References
    ----------
    `strese2015`, eq. 1.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000
    >>> x = 0.02 * np.random.default_rng(0).standard_normal(t.size)
    >>> for start in (0.5, 0.9, 1.4):  # three taps that ring at 300 Hz
    ...     x += 20 * (t >= start) * np.exp(-100 * (t - start).clip(0)) * np.sin(1885 * (t - start))
    >>> hardness_as_printed(x, fs=10_000) > 0
    True
    """

    def hardness_of(tap_peaks: TapPeaks) -> float:
        tap, i, peaks = tap_peaks
        undefined_if(not peaks, "silence: the tap has no impulse")
        n = sum(peaks) / len(peaks) + 1
        return float(i.max()) / n / _checked_velocity(float(np.abs(tap.hand).sum()))

    return float(np.mean(map_taps(hardness_of, _tap_peaks(view, spacing, prominence))))


@feature("tap", "1/s^2", "strese2015, eq. 1, corrected")
def hardness(view: TapView, *, spacing_s: float = 0.01, prominence: float = 0.05) -> float:
    """Return the hardness max|i| / (t v): the peak of the impact divided by its time and the hand velocity.

    In this formula, i is the acceleration of impact and decay, and t is the mean time in s from the contact
    to its three largest peaks (or fewer). The velocity v of the hand in m/s is the integral of |h|, the
    magnitude of the acceleration of the hand, over the times at which |h| exceeds three times the noise at
    rest. Gravity and the resting level are removed. The result is the median over taps, weighted by their
    quality, so that a tap close to the noise has less weight.

    Parameters
    ----------
    view : TapView or array_like of shape (n,)
        Taps. For an array, also pass `fs` in Hz; the taps are located first.
    spacing_s : float
        Smallest distance between two peaks, in s.
    prominence : float
        Smallest prominence of a peak, relative to the largest peak.

    Returns
    -------
    float
        Hardness in 1/s^2.

    Raises
    ------
    UndefinedFeatureError
        If there are no taps, or no tap has both an impulse and an acceleration of the hand above the noise.

    References
    ----------
    `strese2015`, eq. 1, corrected.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000
    >>> noise = 0.02 * np.random.default_rng(0).standard_normal(t.size)
    >>> def tap(decay):  # impact at 0.5 s after an acceleration of the hand
    ...     ringing = (t >= 0.5) * np.exp(-decay * (t - 0.5).clip(0)) * np.sin(1885 * (t - 0.5))
    ...     return 20 * ringing + (t < 0.5) * (t > 0.4) + noise
    >>> hardness(tap(400), fs=10_000) > hardness(tap(50), fs=10_000)  # hard surfaces respond quickly
    True
    """
    noise = view.noise / tap_level(view)

    def hardness_of(tap_peaks: TapPeaks) -> tuple[float, float]:
        tap, i, peaks = tap_peaks
        undefined_if(not peaks, "silence: the tap has no impulse")
        h, t = np.abs(tap.hand), (sum(peaks) / len(peaks) + 1) / view.fs
        velocity = _checked_velocity(float(h[h > 3 * noise].sum()) / view.fs)
        return float(i.max()) / (t * velocity), tap.quality

    tap_peaks = _tap_peaks(view, round(spacing_s * view.fs), prominence)
    values, qualities = np.transpose(map_taps(hardness_of, tap_peaks))
    return weighted_median(values, qualities)


def weighted_median(values: Samples, weights: Samples) -> float:
    """Return the weighted median: the value with half of the total weight on each side.

    If the median lies between two values, their mean is returned. Equal weights give the ordinary median.

    Examples
    --------
    >>> import numpy as np
    >>> weighted_median(np.array([1.0, 5.0, 100.0]), np.array([1.0, 1.0, 0.1]))
    5.0
    """
    order = np.argsort(values, kind="stable")
    values, weights = values[order], weights[order]
    cumulative = np.cumsum(weights if weights.any() else np.ones(len(values)))
    cumulative /= cumulative[-1]
    low, high = np.searchsorted(cumulative, (0.5 - 1e-9, 0.5 + 1e-9))
    return float((values[low] + values[min(high, len(values) - 1)]) / 2)


def _checked_velocity(velocity: float) -> float:
    undefined_if(
        velocity == 0,
        "the hand does not accelerate before the contact. Expected an acceleration above the noise",
    )
    return velocity


@feature("tap", "DCT bin", "strese2015, eq. 2", depends_on=("rate",))
def damping_as_printed(view: TapView, *, length: int = 4096) -> float:
    """Return the spectral centroid of a tap as printed, in DCT bins, averaged over taps.

    SC = sum k |I(k)|^2 / sum |I(k)|^2 for k = 1 ... m/2. The centroid decreases with the damping of the
    surface, because soft surfaces act as low-pass filters. Bin k of a DCT-II of m samples has the frequency k
    fs/(2m), so the printed sum ends at fs/4.

    Parameters
    ----------
    view : TapView or array_like of shape (n,)
        Taps. For an array, also pass `fs` in Hz; the taps are located first.
    length : int
        Length m of the DCT in samples (default 4096). Impact and decay are truncated or zero-padded to it.

    Returns
    -------
    float
        Centroid in DCT bins.

    Raises
    ------
    UndefinedFeatureError
        If there are no taps, or no tap has an impulse.

    References
    ----------
    `strese2015`, eq. 2.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000
    >>> x = 0.02 * np.random.default_rng(0).standard_normal(t.size)
    >>> for start in (0.5, 0.9, 1.4):  # three taps that ring at 300 Hz
    ...     x += 20 * (t >= start) * np.exp(-100 * (t - start).clip(0)) * np.sin(1885 * (t - start))
    >>> round(damping_as_printed(x, fs=10_000), -1)  # about 300 Hz * 2 * 4096 / fs
    230.0
    """

    def centroid_of(tap: TapSignal) -> float:
        return float(printed_centroids(tap.impulse[np.newaxis], length)[0])

    return float(np.mean(map_taps(centroid_of, unit_taps(view))))


@transform
def tap_spectra(view: TapView) -> tuple[tuple[Samples, Samples], ...]:
    """Return the power spectra of impact and decay of the taps, zero-padded to twice their length.

    Each pair contains the taps of one padded length: their frequencies (Hz), shape (n_bins,), and their
    powers, shape (n_taps, n_bins).
    """
    by_length: dict[int, list[Samples]] = {}
    for impulse in map_taps(_impulse_of, unit_taps(view)):
        by_length.setdefault(2 * fft.next_fast_len(max(impulse.size, 32), real=True), []).append(impulse)
    result = []
    for n_fft, impulses in by_length.items():
        padded = np.zeros((len(impulses), n_fft))
        for row, impulse in zip(padded, impulses, strict=True):
            row[: impulse.size] = impulse
        spectra = fft.rfft(padded)
        power: Samples = np.asarray(spectra.real**2 + spectra.imag**2, dtype=np.float64)
        result.append((np.arange(n_fft // 2 + 1, dtype=np.float64) * (view.fs / n_fft), power))
    return tuple(result)


@transform
def tap_energies(view: TapView) -> tuple[tuple[float, Samples], ...]:
    """Return the largest magnitude and the cumulative energy of impact and decay of each tap."""

    def energy_of(tap: TapSignal) -> tuple[float, Samples]:
        i = _impulse_of(tap)
        return float(max(i.max(), -i.min())), np.cumsum(i * i)

    return tuple(map_taps(energy_of, unit_taps(view)))


def _impulse_of(tap: TapSignal) -> Samples:
    """Return impact and decay of a tap; raise `UndefinedFeatureError` if they are silent or too short."""
    undefined_if(tap.impulse.size < 8, f"{tap.impulse.size} samples after the contact. Expected at least 8")
    undefined_if(not np.any(tap.impulse), "silence: the tap has no impulse")
    return tap.impulse


def _quantiles(x: Samples, cumulative: Samples) -> Samples:
    """Return the values of `x` at which a cumulative sum reaches `ENERGY_FRACTIONS` of its last value."""
    return np.interp(ENERGY_FRACTIONS, cumulative / cumulative[-1], x)


@feature("tap", "Hz", "strese2015, eq. 2, corrected")
def damping(view: TapView) -> float:
    """Return the spectral centroid of impact and decay in Hz, as the median over taps.

    The centroid is sum f P(f) / sum P(f) over the full band. It decreases with the damping of the surface. If
    the nominal sampling rate is 1 Hz, the unit is cycles per sample.

    Parameters
    ----------
    view : TapView or array_like of shape (n,)
        Taps. For an array, also pass `fs` in Hz; the taps are located first.

    Returns
    -------
    float
        Centroid in Hz.

    Raises
    ------
    UndefinedFeatureError
        If there are no taps, or no tap has an impulse of at least 8 samples.

    References
    ----------
    `strese2015`, eq. 2, corrected.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000
    >>> x = 0.02 * np.random.default_rng(0).standard_normal(t.size)
    >>> for start in (0.5, 0.9, 1.4):  # three taps that ring at 300 Hz
    ...     x += 20 * (t >= start) * np.exp(-100 * (t - start).clip(0)) * np.sin(1885 * (t - start))
    >>> round(damping(x, fs=10_000), -1)
    290.0
    """
    centroids = [(power * f).sum(axis=1) / power.sum(axis=1) for f, power in tap_spectra(view)]
    return float(median_over_taps(np.concatenate(centroids)))


@feature("tap", "Hz", "texclass, after strese2015, eq. 2", outputs=FRACTION_NAMES)
def tap_band(view: TapView) -> Samples:
    """Return the frequencies below which 10, 25, 50, 75 and 90 % of the energy of a tap lie.

    Each frequency is the median over taps.

    Parameters
    ----------
    view : TapView or array_like of shape (n,)
        Taps. For an array, also pass `fs` in Hz; the taps are located first.

    Returns
    -------
    ndarray of shape (5,)
        Frequencies in Hz.

    Raises
    ------
    UndefinedFeatureError
        If there are no taps, or no tap has an impulse of at least 8 samples.

    References
    ----------
    texclass, after `strese2015`, eq. 2.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000
    >>> x = 0.02 * np.random.default_rng(0).standard_normal(t.size)
    >>> for start in (0.5, 0.9, 1.4):  # three taps that ring at 300 Hz
    ...     x += 20 * (t >= start) * np.exp(-100 * (t - start).clip(0)) * np.sin(1885 * (t - start))
    >>> tap_band(x, fs=10_000).round(-1).tolist()
    [230.0, 270.0, 290.0, 310.0, 330.0]
    """
    spectra = tap_spectra(view)
    return median_over_taps([_quantiles(f, row) for f, power in spectra for row in np.cumsum(power, axis=1)])


@feature("tap", "s", "texclass, after strese2015, Fig. 7", outputs=FRACTION_NAMES)
def tap_course(view: TapView) -> Samples:
    """Return the times after the contact when 10, 25, 50, 75 and 90 % of the energy of a tap have arrived.

    Each time is the median over taps. The last time measures the duration of the contact.

    Parameters
    ----------
    view : TapView or array_like of shape (n,)
        Taps. For an array, also pass `fs` in Hz; the taps are located first.

    Returns
    -------
    ndarray of shape (5,)
        Times in s.

    Raises
    ------
    UndefinedFeatureError
        If there are no taps, or no tap has an impulse of at least 8 samples.

    References
    ----------
    texclass, after `strese2015`, Fig. 7.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000
    >>> x = 0.02 * np.random.default_rng(0).standard_normal(t.size)
    >>> for start in (0.5, 0.9, 1.4):  # three taps that ring at 300 Hz
    ...     x += 20 * (t >= start) * np.exp(-100 * (t - start).clip(0)) * np.sin(1885 * (t - start))
    >>> tap_course(x, fs=10_000).round(3).tolist()
    [0.001, 0.001, 0.004, 0.007, 0.011]
    """
    energies = [energy for _, energy in tap_energies(view)]
    times = [_quantiles(np.arange(1.0, energy.size + 1), energy) for energy in energies]
    return median_over_taps(times) / view.fs


@feature("tap", "1/s", "texclass, after okamura2001")
def tap_decay_rate(view: TapView) -> float:
    """Return the decay rate b of the envelope exp(-b t) of a tap, as the median over taps.

    The rate is half the slope of the logarithm of the remaining energy (Schroeder's backward integral),
    fitted from 90 % to 5 % of the energy. The method gives a single rate even if the tool bounces.

    Parameters
    ----------
    view : TapView or array_like of shape (n,)
        Taps. For an array, also pass `fs` in Hz; the taps are located first.

    Returns
    -------
    float
        Rate in 1/s.

    Raises
    ------
    UndefinedFeatureError
        If there are no taps, or no tap decays over at least 3 samples.

    References
    ----------
    texclass, after `okamura2001`; Schroeder, "New method of measuring reverberation time", 1965.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000
    >>> x = 0.02 * np.random.default_rng(0).standard_normal(t.size)
    >>> for start in (0.5, 0.9, 1.4):  # three taps that ring at 300 Hz
    ...     x += 20 * (t >= start) * np.exp(-100 * (t - start).clip(0)) * np.sin(1885 * (t - start))
    >>> round(tap_decay_rate(x, fs=10_000), -1)  # 100 per s
    100.0
    """

    def rate_of(tap: tuple[float, Samples]) -> float:
        remaining = 1 - tap[1] / tap[1][-1]
        remaining = remaining[(remaining <= 0.9) & (remaining >= 0.05)]
        n = remaining.size
        undefined_if(n < 3, f"the tap decays within {n} samples. Expected a decay over at least 3")
        t = np.arange(n) - (n - 1) / 2
        return -float(t @ np.log(remaining)) / (2 * float(t @ t)) * view.fs

    return float(median_over_taps(map_taps(rate_of, tap_energies(view))))


@feature("tap", "log10(m/s^2)", "texclass", gain=Gain(shift=1))
def tap_strength(view: TapView) -> float:
    """Return the strength log10 max|i| of a tap, as the median over taps.

    Parameters
    ----------
    view : TapView or array_like of shape (n,)
        Taps. For an array, also pass `fs` in Hz; the taps are located first.

    Returns
    -------
    float
        Level in log10(m/s^2).

    Raises
    ------
    UndefinedFeatureError
        If there are no taps, or no tap has an impulse of at least 8 samples.

    References
    ----------
    texclass.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000
    >>> x = 0.02 * np.random.default_rng(0).standard_normal(t.size)
    >>> for start in (0.5, 0.9, 1.4):  # three taps that ring at 300 Hz
    ...     x += 20 * (t >= start) * np.exp(-100 * (t - start).clip(0)) * np.sin(1885 * (t - start))
    >>> round(tap_strength(x, fs=10_000), 1)  # a peak of almost 20
    1.3
    """
    peaks = np.log10([peak for peak, _ in tap_energies(view)])
    return float(median_over_taps(peaks) + np.log10(tap_level(view)))


@feature("tap", "1", "texclass")
def tap_crest(view: TapView) -> float:
    """Return the crest factor of a tap, max|i| / RMS of impact and decay, as the median over taps.

    Parameters
    ----------
    view : TapView or array_like of shape (n,)
        Taps. For an array, also pass `fs` in Hz; the taps are located first.

    Returns
    -------
    float
        Crest factor.

    Raises
    ------
    UndefinedFeatureError
        If there are no taps, or no tap has an impulse of at least 8 samples.

    References
    ----------
    texclass.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000
    >>> x = 0.02 * np.random.default_rng(0).standard_normal(t.size)
    >>> for start in (0.5, 0.9, 1.4):  # three taps that ring at 300 Hz
    ...     x += 20 * (t >= start) * np.exp(-100 * (t - start).clip(0)) * np.sin(1885 * (t - start))
    >>> tap_crest(x, fs=10_000) > 2
    True
    """
    crests = [peak * (energy.size / energy[-1]) ** 0.5 for peak, energy in tap_energies(view)]
    return float(median_over_taps(crests))
