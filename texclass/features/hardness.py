"""Hardness and damping of a surface, and how it rings, from taps on it [strese2015, section IV-B].

The features named after taps can be computed at any, even a nominal, rate.
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
Struck = tuple[TapSignal, Samples, list[int]]
"""A tap, the magnitude of its impulse, and where its largest peaks are."""
SHARES = (0.1, 0.25, 0.5, 0.75, 0.9)
SHARE_NAMES = tuple(f"q{100 * share:.0f}" for share in SHARES)


@transform
def tap_level(view: TapView) -> float:
    """Return the power of two next to the largest magnitude in all taps, in the unit of the samples.

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, a sample is not finite, or all are 0.
    """
    undefined_if(not view.taps, "no tap found")
    return magnitude_of(np.concatenate([part for tap in view.taps for part in (tap.hand, tap.impulse)]))


@transform
def unit_taps(view: TapView) -> tuple[TapSignal, ...]:
    """Return the taps divided by `tap_level`."""
    scale = tap_level(view)
    return tuple(TapSignal(tap.hand / scale, tap.impulse / scale, tap.quality) for tap in view.taps)


def per_tap(taps: Iterable[S], value: Callable[[S], T]) -> list[T]:
    """Return `value` of every tap (of `unit_taps`, or what was made of them) that has one.

    Raises
    ------
    UndefinedFeatureError
        If no tap has; the reason is that of the first.
    """
    found: list[T] = []
    reasons: list[UndefinedFeatureError] = []
    for tap in taps:
        try:
            found.append(value(tap))
        except UndefinedFeatureError as reason:
            reasons.append(reason)
    if not found:
        raise reasons[0]
    return found


def median_over_taps(values: ArrayLike) -> Samples:
    """Return the median along the first axis; numpy's own takes longer than most features of taps."""
    x = np.sort(values, axis=0)
    return np.asarray((x[(len(x) - 1) // 2] + x[len(x) // 2]) / 2)


def impulse_peaks(magnitudes: Sequence[Samples], spacing: int, prominence: float) -> list[list[int]]:
    """Return the indices of the (at most) three largest peaks of each tap, in order of time; none of silence.

    A tap that does not bounce has fewer than three; its first and last sample count as peaks if they stand
    out.

    Parameters
    ----------
    magnitudes : sequence of ndarray of shape (m,)
        |i| of each tap.
    spacing : int
        Least distance of two peaks, in samples.
    prominence : float
        Least prominence, in fractions of the largest magnitude of the tap.
    """
    silence = np.zeros(1)
    all_taps = np.concatenate([silence, *(part for i in magnitudes for part in (i, silence))])
    first = 1 + np.cumsum([0, *(i.size + 1 for i in magnitudes)])
    least = prominence * np.maximum.reduceat(all_taps, first[:-1])
    peaks, _ = scipy.signal.find_peaks(all_taps, height=0.0)
    of = np.searchsorted(first, peaks, side="right") - 1
    high = all_taps[peaks] >= least[of]  # what is lower neither stands out so far nor hides what is higher
    of, left = of[high], peaks[high].tolist()
    ends = np.searchsorted(of, np.arange(len(magnitudes) + 1)).tolist()
    x = all_taps.tolist()
    highest = (
        _highest(x, left[begin:end], spacing, fall)
        for begin, end, fall in zip(ends, ends[1:], least.tolist(), strict=False)
    )
    return [sorted(k - start for k in found) for found, start in zip(highest, first.tolist(), strict=False)]


def _struck(view: TapView, spacing: int, prominence: float) -> Iterable[Struck]:
    taps = unit_taps(view)
    magnitudes = [np.abs(tap.impulse) for tap in taps]
    return zip(taps, magnitudes, impulse_peaks(magnitudes, spacing, prominence), strict=True)


def _highest(x: list[float], peaks: list[int], spacing: int, least: float) -> list[int]:
    """Return the (at most) three highest of the peaks, `spacing` apart, that stand out by `least`."""
    found, left = list[int](), sorted(peaks, key=lambda k: (x[k], k), reverse=True)
    while left and not (len(found) >= 3 and x[left[0]] < x[found[2]]):
        k = left[0]
        left = [other for other in left[1:] if abs(other - k) >= spacing]
        if _falls(x, range(k, len(x)), least) and _falls(x, range(k, -1, -1), least):
            found.append(k)
    return sorted(found, key=lambda k: (-x[k], k))[:3]


def _falls(x: list[float], ks: range, least: float) -> bool:
    """Return whether numbers fall by `least` below the first one before one is above it."""
    top = x[ks[0]]
    for k in ks:  # beside a peak that stands out, few are looked at
        if x[k] > top:
            return False
        if top - x[k] >= least:
            return True
    return False


@feature("tap", "1", "strese2015, eq. 1", depends_on=("rate",))
def hardness_as_printed(view: TapView, *, spacing: int = 100, prominence: float = 0.01) -> float:
    """Hardness H = (max(i) / n) / sum(h), in samples; mean over taps.

    i is the magnitude of impact and decay, n the mean index (from 1) of its three largest peaks, h the
    magnitude of the hand's acceleration. A tap with one or two peaks takes the mean of those. Falls with
    1/fs^2: both n and the sum count samples.

    Parameters
    ----------
    view : TapView
        Taps.
    spacing : int
        Least distance of two peaks, in samples.
    prominence : float
        Least prominence of a peak, in fractions of the largest (which keeps H free of gain).

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse and some hand acceleration.
    """

    def hardness_of(struck: Struck) -> float:
        tap, i, peaks = struck
        undefined_if(not peaks, "silence: the tap has no impulse")
        n = sum(peaks) / len(peaks) + 1
        return float(i.max()) / n / _moved(float(np.abs(tap.hand).sum()))

    return float(np.mean(per_tap(_struck(view, spacing, prominence), hardness_of)))


@feature("tap", "1/s^2", "strese2015, eq. 1, corrected")
def hardness(view: TapView, *, spacing_s: float = 0.01, prominence: float = 0.05) -> float:
    """Hardness max|i| / (t v): impact over its time and over the velocity of the hand; median over taps.

    The median is weighted by how surely each is a tap (its quality): one that hardly leaves the noise, or
    what rings and moves around it, counts less.

    t is the mean time of the three largest peaks after the contact (the fewer there are), in s, and
    v = integral of |h| dt the hand's velocity, in m/s, over where |h| exceeds three times the noise of rest.
    Gravity and resting level are removed from the view.

    Parameters
    ----------
    view : TapView
        Taps.
    spacing_s : float
        Least distance of two peaks, in s.
    prominence : float
        Least prominence of a peak, in fractions of the largest.

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse and a hand acceleration above the noise.
    """
    noise = view.noise / tap_level(view)

    def hardness_of(struck: Struck) -> tuple[float, float]:
        tap, i, peaks = struck
        undefined_if(not peaks, "silence: the tap has no impulse")
        h, t = np.abs(tap.hand), (sum(peaks) / len(peaks) + 1) / view.fs
        return float(i.max()) / (t * _moved(float(h[h > 3 * noise].sum()) / view.fs)), tap.quality

    struck = _struck(view, round(spacing_s * view.fs), prominence)
    values, qualities = np.transpose(per_tap(struck, hardness_of))
    return weighted_median(values, qualities)


def weighted_median(values: Samples, weights: Samples) -> float:
    """Return the value with half of the weight on each side, the mean of two where it lies between them.

    Equal weights give the median.

    Examples
    --------
    >>> import numpy as np
    >>> weighted_median(np.array([1.0, 5.0, 100.0]), np.array([1.0, 1.0, 0.1]))
    5.0
    """
    order = np.argsort(values, kind="stable")
    values, weights = values[order], weights[order]
    left = np.cumsum(weights if weights.any() else np.ones(len(values)))
    left /= left[-1]
    low, high = np.searchsorted(left, (0.5 - 1e-9, 0.5 + 1e-9))
    return float((values[low] + values[min(high, len(values) - 1)]) / 2)


def _moved(velocity: float) -> float:
    undefined_if(velocity == 0, "the hand's acceleration before the contact is 0. Expected above the noise")
    return velocity


@feature("tap", "DCT bin", "strese2015, eq. 2", depends_on=("rate",))
def damping_as_printed(view: TapView, *, length: int = 4096) -> float:
    """Spectral centroid of a tap, SC = sum k |I(k)|^2 / sum |I(k)|^2 for k = 1 ... m/2; mean over taps.

    Inverse to damping: soft surfaces act as low-passes. Bin k of a DCT-II of m samples lies at k fs/(2m), so
    the printed sum stops at fs/4.

    Parameters
    ----------
    view : TapView
        Taps.
    length : int
        m; impact and decay are cut or zero-padded to it.

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse.
    """

    def centroid_of(tap: TapSignal) -> float:
        return float(printed_centroids(tap.impulse[np.newaxis], length)[0])

    return float(np.mean(per_tap(unit_taps(view), centroid_of)))


@transform
def tap_spectra(view: TapView) -> tuple[tuple[Samples, Samples], ...]:
    """Return frequency (Hz) and power of impact and decay of taps, zero-padded to twice their length.

    Taps that are padded to the same length stand together: (n_bins,) and (n_taps, n_bins).
    """
    alike: dict[int, list[Samples]] = {}
    for impulse in per_tap(unit_taps(view), _energetic):
        alike.setdefault(2 * fft.next_fast_len(max(impulse.size, 32), real=True), []).append(impulse)
    found = []
    for n_fft, impulses in alike.items():
        padded = np.zeros((len(impulses), n_fft))
        for row, impulse in zip(padded, impulses, strict=True):
            row[: impulse.size] = impulse
        spectra = fft.rfft(padded)
        power: Samples = np.asarray(spectra.real**2 + spectra.imag**2, dtype=np.float64)
        found.append((np.arange(n_fft // 2 + 1, dtype=np.float64) * (view.fs / n_fft), power))
    return tuple(found)


@transform
def tap_energies(view: TapView) -> tuple[tuple[float, Samples], ...]:
    """Return the largest magnitude, and the running energy of impact and decay, of each tap."""

    def energy_of(tap: TapSignal) -> tuple[float, Samples]:
        i = _energetic(tap)
        return float(max(i.max(), -i.min())), np.cumsum(i * i)

    return tuple(per_tap(unit_taps(view), energy_of))


def _energetic(tap: TapSignal) -> Samples:
    """Impact and decay; refused if silent or too short."""
    undefined_if(tap.impulse.size < 8, f"{tap.impulse.size} samples after the contact. Expected at least 8")
    undefined_if(not np.any(tap.impulse), "silence: the tap has no impulse")
    return tap.impulse


def _quantiles(x: Samples, running: Samples) -> Samples:
    """Return where over `x` a running sum reaches each of `SHARES` of its end."""
    return np.interp(SHARES, running / running[-1], x)


@feature("tap", "Hz", "strese2015, eq. 2, corrected")
def damping(view: TapView) -> float:
    """Spectral centroid of impact and decay in Hz over the full band; median over taps.

    sum f P(f) / sum P(f); inverse to damping. In cycles per sample where the rate is nominally 1 Hz.

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse of 8 samples or more.
    """
    centroids = [(power * f).sum(axis=1) / power.sum(axis=1) for f, power in tap_spectra(view)]
    return float(median_over_taps(np.concatenate(centroids)))


@feature("tap", "Hz", "texclass, after strese2015, eq. 2", outputs=SHARE_NAMES)
def tap_band(view: TapView) -> Samples:
    """Frequencies below which 10, 25, 50, 75 and 90 % of a tap's energy lie; median over taps.

    Returns
    -------
    ndarray of shape (5,)

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse of 8 samples or more.
    """
    spectra = tap_spectra(view)
    return median_over_taps([_quantiles(f, row) for f, power in spectra for row in np.cumsum(power, axis=1)])


@feature("tap", "s", "texclass, after strese2015, Fig. 7", outputs=SHARE_NAMES)
def tap_course(view: TapView) -> Samples:
    """Course of a tap: times after the contact by which 10 ... 90 % of its energy has come; median over taps.

    The last is the duration of the contact as far as it is felt.

    Returns
    -------
    ndarray of shape (5,)

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse of 8 samples or more.
    """
    running = [energy for _, energy in tap_energies(view)]
    times = [_quantiles(np.arange(1.0, energy.size + 1), energy) for energy in running]
    return median_over_taps(times) / view.fs


@feature("tap", "1/s", "texclass, after okamura2001")
def tap_decay_rate(view: TapView) -> float:
    """Decay rate b of the envelope exp(-b t) of a tap; median over taps.

    Half the slope of the logarithm of the energy still to come (Schroeder's backward integral), fitted from
    where 90 % to where 5 % are left: one number even for a tap that bounces.

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none that decays over 3 samples or more.
    """

    def rate_of(tap: tuple[float, Samples]) -> float:
        left = 1 - tap[1] / tap[1][-1]
        left = left[(left <= 0.9) & (left >= 0.05)]
        undefined_if(left.size < 3, f"the tap decays within {left.size} samples. Expected at least 3")
        t = np.arange(left.size) - (left.size - 1) / 2
        return -float(t @ np.log(left)) / (2 * float(t @ t)) * view.fs

    return float(median_over_taps(per_tap(tap_energies(view), rate_of)))


@feature("tap", "log10(m/s^2)", "texclass", gain=Gain(shift=1))
def tap_strength(view: TapView) -> float:
    """Strength of a tap, log10 max|i|; median over taps.

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse of 8 samples or more.
    """
    peaks = np.log10([peak for peak, _ in tap_energies(view)])
    return float(median_over_taps(peaks) + np.log10(tap_level(view)))


@feature("tap", "1", "texclass")
def tap_crest(view: TapView) -> float:
    """Crest factor of a tap, max|i| over the root mean square of impact and decay; median over taps.

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse of 8 samples or more.
    """
    crests = [peak * (running.size / running[-1]) ** 0.5 for peak, running in tap_energies(view)]
    return float(median_over_taps(crests))
