"""Detection of impulses (which rise and decay) and movement (lasting vibration) in vibration levels.

This is the core of the search for phases. Its input consists of the levels of all bins of a recording, or of
the current contact in a live stream. The search looks back a few hundredths of a second, and looks ahead
until an impulse has decayed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from texclass.phase_settings import PhaseSettings
from texclass.recording import Samples


@dataclass(frozen=True)
class Levels:
    """Power of each bin relative to the noise; 0 where there are no data.

    Attributes
    ----------
    broadband : ndarray of shape (n_bins,)
        Power at all frequencies above hand motion.
    combined : ndarray of shape (n_bins,)
        The larger of `broadband` and the power in the band in which soft contacts ring.
    strokes : ndarray of shape (n_bins,)
        Level for the detection of strokes: similar to `combined` where `broadband` exceeds the noise, and
        equal to `broadband` elsewhere, so that hand motion is ignored. It is reduced if the noise is
        intermittent.
    bin_s : float
        Duration of a bin in s.
    min_bins : int
        Smallest number of bins from which a level is reliable (default 1).

    Examples
    --------
    >>> power = np.ones(1000)
    >>> Levels(power, power, power, bin_s=0.001).n_bins(0.03)
    30
    """

    broadband: Samples
    combined: Samples
    strokes: Samples
    bin_s: float
    min_bins: int = 1

    def n_bins(self, seconds: float) -> int:
        """Return the number of bins of a duration, at least 1."""
        return max(1, round(seconds / self.bin_s))


@dataclass(frozen=True)
class Impulse:
    """Impulse in the levels of a recording. All times are in bins.

    Attributes
    ----------
    start, peak, end, decay_end : int
        Bins in which the impulse starts to rise, has its peak, ends, and has decayed completely. It ends 30
        dB below its peak, in the noise, or at the next impulse.
    width : int
        Number of bins from the start until the level is 10 dB below the peak.
    combined_db, broadband_db : float
        Level of the peak above the noise, with and without the band in which soft contacts ring.
    prominence_db : float
        Level of the peak above the higher of the levels before and after the impulse.
    fall_db : float
        Level of the peak above the level after the impulse.

    Examples
    --------
    >>> impulse = Impulse(10, 12, 40, 50, 5, combined_db=30, broadband_db=30, prominence_db=20, fall_db=25)
    >>> impulse.quality
    0.9
    """

    start: int
    peak: int
    end: int
    decay_end: int
    width: int
    combined_db: float
    broadband_db: float
    prominence_db: float
    fall_db: float

    @property
    def quality(self) -> float:
        """Confidence from 0 to 1: 1 minus the ratio of the surrounding amplitude to the peak."""
        return 1.0 - float(10.0 ** (-self.prominence_db / 20.0))


def decibels(ratio: Samples) -> Samples:
    """Return power ratios in dB; ratios below 1 give 0 dB."""
    return np.asarray(10.0 * np.log10(np.maximum(ratio, 1.0)))


def find_impulses(levels: Levels, settings: PhaseSettings) -> list[Impulse]:
    """Return the impulses of a recording: levels that rise sharply and decay.

    1. Smooth the levels and convert them to dB.
    2. Find candidate peaks: local maxima above the level before them.
    3. Measure the candidates from the last to the first, because an impulse ends where the next one starts.
    4. Keep the impulses that decay by at least `prominence_db`.

    Parameters
    ----------
    levels : Levels
        Levels of all bins.
    settings : PhaseSettings
        Thresholds and durations.

    Returns
    -------
    list of Impulse
        Impulses in order of time.

    Examples
    --------
    >>> power = np.ones(1000)
    >>> power[300:340] = 1000.0 * np.exp(-np.arange(40) / 10)
    >>> impulses = find_impulses(Levels(power, power, power, bin_s=0.001), PhaseSettings())
    >>> [(impulse.start, impulse.decay_end) for impulse in impulses]
    [(299, 349)]
    """
    smooth = SmoothLevels.of(levels, settings)
    rise_db = rise_over_past(smooth, settings)
    impulses: list[Impulse] = []
    stop = len(rise_db)
    for peak in candidate_peaks(smooth, rise_db, settings)[::-1]:
        if peak < stop:
            impulse = measure(smooth, peak, stop, float(rise_db[peak]), settings)
            if impulse.fall_db >= settings.prominence_db:
                impulses.append(impulse)
                stop = max(impulse.start, 1)
    return impulses[::-1]


@dataclass(frozen=True, eq=False)
class SmoothLevels:
    """Levels in dB above the noise, smoothed over different times.

    Attributes
    ----------
    sharp, broadband : ndarray of shape (n_bins,)
        Short averages, with and without the band in which soft contacts ring. Peaks are located in them.
    calm : ndarray of shape (n_bins,)
        Longer average of the same level as `sharp`. Decays are measured in it.
    n_bins : callable
        Function that converts seconds to a number of bins.
    """

    sharp: Samples
    broadband: Samples
    calm: Samples
    n_bins: Callable[[float], int]

    @classmethod
    def of(cls, levels: Levels, settings: PhaseSettings) -> Self:
        """Smooth the levels of a recording."""
        n = levels.n_bins
        sharp, broadband, calm = (
            decibels(moving_mean(level, n(seconds)))
            for level, seconds in (
                (levels.combined, settings.sharp_s),
                (levels.broadband, settings.sharp_s),
                (levels.combined, settings.calm_s),
            )
        )
        return cls(sharp, broadband, calm, n)


def rise_over_past(smooth: SmoothLevels, settings: PhaseSettings) -> Samples:
    """Return by how many dB each bin, or a bin shortly before, exceeds the maximum of the preceding window.

    The preceding window has the length `look_back_s` and ends `rise_s` before the bin. The rise of the
    broadband level is also used if the preceding window is at rest in all bands, so that hand motion in the
    soft band does not hide a loud tap.
    """
    n_past, n_rise = smooth.n_bins(settings.look_back_s), smooth.n_bins(settings.rise_s)
    rise = np.zeros(len(smooth.sharp))
    for level, highest_past_db in ((smooth.sharp, np.inf), (smooth.broadband, settings.prominence_db)):
        past = _delayed(_trailing_max(level, n_past), n_rise + 1 - n_past % 2)
        past[: n_rise + n_past // 2] = 0.0  # at the start, less than half of the window contains data
        above = np.where(past < highest_past_db, level - past, 0.0)
        rise = np.maximum(rise, _trailing_max(above, n_past))
    return rise


def candidate_peaks(smooth: SmoothLevels, rise_db: Samples, settings: PhaseSettings) -> list[int]:
    """Return the bins of hits: local maxima that exceed the preceding window and are as loud as a tap.

    Among hits within `tap_spacing_s`, the strongest is selected. Peaks that are not hits are ignored if they
    are stronger by at most `rebound_db`, so that a later rebound does not hide the first hit.
    """
    spacing, rise = (2 * smooth.n_bins(seconds) - 1 for seconds in (settings.tap_spacing_s, settings.rise_s))
    loud_db = 10 * np.log10(settings.tap_ratio)
    is_peak = np.zeros(len(rise_db), dtype=bool)
    for level in (smooth.sharp, smooth.broadband):
        is_hit = (rise_db >= settings.prominence_db) & (level >= loud_db) & (level == _maximum(level, rise))
        is_highest = level == _maximum(np.where(is_hit, level, 0.0), spacing)
        is_peak |= is_hit & is_highest & (level >= _maximum(level, spacing) - settings.rebound_db)
    return np.flatnonzero(is_peak).tolist()


def measure(smooth: SmoothLevels, peak: int, stop: int, rise_db: float, settings: PhaseSettings) -> Impulse:
    """Return the impulse whose peak is in bin `peak`. The next impulse starts in bin `stop`."""
    sharp, broadband, n_bins = smooth.sharp, smooth.broadband, smooth.n_bins
    quiet_db = 10 * np.log10(settings.active_ratio)
    peak_db = float(sharp[peak])

    hit = first_hit(smooth, peak, settings)
    onset = max(0, hit - n_bins(settings.look_back_s))
    rise, hit_db = sharp[onset:hit], float(sharp[hit])
    # In the tail of another impulse, the level before the hit may not be `onset_db` lower.
    lowest_db = float(rise.min(initial=hit_db))
    onset_db = max(quiet_db, hit_db - settings.onset_db, lowest_db + (hit_db - lowest_db) / 3)
    below = np.flatnonzero(rise < onset_db)
    start = onset + (int(below[-1]) + 1 if below.size else 0)

    decay_stop, lowest = find_decay_end(smooth, peak, stop, settings)
    end = min(decay_stop, peak + _first(sharp[peak:stop] < peak_db - settings.decay_db, stop - peak))
    fall_db = max(0.0, peak_db - lowest)

    loudest = start + int(broadband[start : peak + n_bins(settings.rise_s)].argmax())
    broadband_db = float(broadband[loudest])
    width = loudest + _first(broadband[loudest:] < broadband_db - settings.width_db, stop - loudest) - start
    return Impulse(
        start, peak, max(end, start + 1), max(decay_stop, start + 1), width,
        combined_db=peak_db, broadband_db=broadband_db, prominence_db=min(rise_db, fall_db), fall_db=fall_db,
    )  # fmt: skip


def first_hit(smooth: SmoothLevels, peak: int, settings: PhaseSettings) -> int:
    """Return the bin of the first hit of a tap whose strongest hit is in bin `peak`.

    The first hit is less than `tap_spacing_s` earlier than the strongest one, and weaker by at most
    `rebound_db`. The level rises by `prominence_db` within `rise_s` before it, unlike in the tail of an
    earlier tap, and falls by `rebound_db` after it.
    """
    sharp, n_rise = smooth.sharp, smooth.n_bins(settings.rise_s)
    earliest = max(0, peak - smooth.n_bins(settings.tap_spacing_s) + 1)
    (strong,) = np.nonzero(sharp[earliest:peak] >= sharp[peak] - settings.rebound_db)
    if not strong.size:
        return peak
    first = earliest + int(strong[0])
    hit = first + int(sharp[first : min(peak, first + n_rise)].argmax())
    lowest_before = float(sharp[max(0, hit - n_rise) : hit].min(initial=np.inf))
    lowest_after = float(sharp[hit:peak].min(initial=np.inf))
    is_rising = lowest_before < sharp[hit] - settings.prominence_db
    is_hit = is_rising and lowest_after < sharp[hit] - settings.rebound_db
    return hit if is_hit else peak


def find_decay_end(smooth: SmoothLevels, peak: int, stop: int, settings: PhaseSettings) -> tuple[int, float]:
    """Return the bin in which an impulse has decayed, and the lowest level (dB) up to this bin.

    The decay ends when the level is at rest or stops falling. A tail that continues to fall without rising is
    part of the decay.
    """
    n_bins, quiet_db = smooth.n_bins, 10 * np.log10(settings.active_ratio)
    start = min(peak + n_bins(settings.calm_s / 2), len(smooth.calm) - 1)
    decay = smooth.calm[start : start + stop - peak]
    n_stall = n_bins(settings.stall_s)
    quiet = min(_first(smooth.sharp[peak:stop] < quiet_db, stop - peak), stop - peak - 1)
    n_falling = min(_end_of_fall(decay[: quiet + 3 * n_stall], n_stall, settings.stall_db), quiet)
    fall_end = peak + n_falling
    tail = smooth.calm[fall_end : min(fall_end + n_bins(settings.tail_s), stop)]
    n_tail = _tail_length(tail, quiet_db, settings.tail_db, is_last=stop - fall_end <= len(tail))
    lowest = float(decay[: n_falling + n_tail + 1].min(initial=np.inf))
    return min(fall_end + n_tail, stop), lowest


def find_movement(
    levels: Levels, impulses: Sequence[Impulse], settings: PhaseSettings
) -> tuple[int, int] | None:
    """Return the bins [first, last) of lasting vibration including pauses, or None if there is none.

    1. Remove impulses that are followed by a quiet period.
    2. Find the windows in which the level exceeds `settings.stroke_ratio` for at least the fraction
       `settings.share` of the time.
    3. Extend both ends over adjacent vibration, up to an impulse that is much stronger than the strokes.
    """
    size = max(levels.min_bins, levels.n_bins(0.005))
    window = max(1, round(levels.n_bins(settings.window_s) / size))
    rings = [i for i in impulses if i.fall_db >= settings.ring_db]
    level = bin_means(remove_impulses(levels.strokes, rings, settings.lasting_db), size)
    share = ndimage.uniform_filter1d((level > settings.stroke_ratio).astype(float), window, mode="constant")
    (lasting,) = np.nonzero(share > settings.share - 1e-9)
    if not len(lasting):
        return None
    start, end = int(lasting[0]), int(lasting[-1])
    peak_db = np.quantile(decibels(levels.strokes[start * size : (end + 1) * size]), 0.95)
    strong = float(peak_db) + settings.strong_db
    level = bin_means(remove_impulses(levels.strokes, impulses, strong), size)
    is_active = ndimage.uniform_filter1d(level, 3, mode="nearest") > settings.stroke_ratio
    gap = max(1, round(levels.n_bins(settings.gap_s) / size))
    first = len(is_active) - 1 - _outermost(is_active[::-1], len(is_active) - 1 - start, gap)
    last = _outermost(is_active, end, gap)
    return first * size, min((last + 1) * size, len(levels.strokes))


def split_taps_and_movement(
    levels: Levels,
    impulses: Sequence[Impulse],
    settings: PhaseSettings,
    begins: int | None = None,
    opening: Sequence[Impulse] = (),
) -> tuple[list[Impulse], tuple[int, int] | None]:
    """Return the taps among the impulses, and the bins of the movement (None without movement).

    Impulses inside the movement belong to the texture. Impulses adjacent to its start belong to the texture
    unless they are much stronger than the strokes. Impulses that follow its end after less than `pause_s`
    also belong to the texture.

    Parameters
    ----------
    levels : Levels
        Levels of all bins.
    impulses : sequence of Impulse
        Impulses in order of time.
    settings : PhaseSettings
        Thresholds and durations.
    begins : int, optional
        First bin of the data, if the data start with vibration. If vibration fills a third of the time
        before the lasting strokes, the movement starts in this bin.
    opening : sequence of Impulse
        Impulses at the start of the data. They are not taps, and their decay is not movement.

    Returns
    -------
    taps : list of Impulse
        Taps in order of time.
    movement : tuple of int or None
        First bin of the movement, and the bin after its last bin.

    Examples
    --------
    >>> power = np.ones(3000)
    >>> power[300:340] = 1000.0 * np.exp(-np.arange(40) / 10)
    >>> power[1000:] = 20.0
    >>> levels, settings = Levels(power, power, power, bin_s=0.001), PhaseSettings()
    >>> taps, movement = split_taps_and_movement(levels, find_impulses(levels, settings), settings)
    >>> len(taps), movement
    (1, (995, 3000))
    """
    span = find_movement(levels, [*opening, *impulses], settings)
    if span is None or _is_echo(levels, impulses, span, settings):
        return select_taps(impulses, levels, settings), None
    first, last = span
    if begins is not None and begins < first:
        n = max(levels.min_bins, levels.n_bins(settings.calm_s))
        is_active = bin_means(levels.strokes[begins:first], n) > settings.active_ratio
        if np.mean(is_active) > settings.share / 2:
            first = begins
    median_db, strong_db = np.quantile(decibels(levels.combined[first:last]), [0.5, 0.95])
    earlier = [i for i in impulses if i.start < first]
    later = [i for i in impulses if i.start >= first and i.decay_end > last]
    while earlier and earlier[-1].combined_db < strong_db + settings.strong_db:
        gap_s = settings.first_gap_s if earlier[-1].combined_db < median_db else settings.gap_s
        if first - earlier[-1].end >= levels.n_bins(gap_s):
            break
        first = min(first, earlier.pop().start)
    while later and later[0].start < last + levels.n_bins(settings.pause_s):
        last = max(last, later.pop(0).decay_end)
    return select_taps(earlier + later, levels, settings), (first, last)


def _is_echo(
    levels: Levels, impulses: Sequence[Impulse], span: tuple[int, int], settings: PhaseSettings
) -> bool:
    """Return whether short and weak vibration is an echo of impulses, or noise before or between them."""
    n_bins = span[1] - span[0]
    strongest_db = 0.0
    for impulse in impulses:
        is_before = impulse.start < span[0]
        longest_s = settings.echo_s if is_before else settings.between_s
        # An impulse of a coarse texture rises less over the vibration before it.
        is_tap = is_before or impulse.prominence_db >= settings.clear_db
        if is_tap and n_bins < levels.n_bins(longest_s):
            strongest_db = max(strongest_db, impulse.broadband_db)
    rest = remove_impulses(levels.broadband, impulses, settings.lasting_db)[slice(*span)]
    return bool(np.quantile(decibels(rest), 0.75) < strongest_db - settings.echo_db)


def select_taps(impulses: Sequence[Impulse], levels: Levels, settings: PhaseSettings) -> list[Impulse]:
    """Remove weak impulses, which occur when the tool is lifted, set down or pulled.

    Examples
    --------
    >>> power = np.ones(2000)
    >>> for start, peak in ((300, 1e6), (1200, 1e3)):
    ...     power[start : start + 40] = peak * np.exp(-np.arange(40) / 10)
    >>> levels, settings = Levels(power, power, power, bin_s=0.001), PhaseSettings()
    >>> impulses = find_impulses(levels, settings)
    >>> len(impulses), len(select_taps(impulses, levels, settings))  # the second is 30 dB weaker
    (2, 1)
    """
    combined_db = max((i.combined_db for i in impulses), default=0.0)
    broadband_db = max((i.broadband_db for i in impulses), default=0.0)

    def is_pull(impulse: Impulse) -> bool:
        latest = impulse.start + levels.n_bins(settings.pull_s)
        stronger_db = impulse.combined_db + settings.pull_db
        return any(impulse.start < i.start < latest and i.combined_db > stronger_db for i in impulses)

    def is_tap(impulse: Impulse) -> bool:
        if impulse.broadband_db < settings.soft_db:
            return combined_db - impulse.combined_db <= settings.soft_db and not is_pull(impulse)
        is_short = impulse.width <= levels.n_bins(settings.clear_s)
        is_clear = impulse.broadband_db >= settings.clear_db and is_short
        range_db = settings.clear_range_db if is_clear else settings.range_db
        return broadband_db - impulse.broadband_db <= range_db

    return [impulse for impulse in impulses if is_tap(impulse)]


def bin_means(x: Samples, size: int) -> Samples:
    """Return the means of bins of `size` samples along the last axis. The last bin may be shorter.

    Examples
    --------
    >>> bin_means(np.array([1.0, 3.0, 5.0, 7.0, 9.0]), 2).tolist()
    [2.0, 6.0, 9.0]
    """
    if size == 1:
        return x
    whole = x.shape[-1] // size * size
    means = x[..., :whole].reshape(*x.shape[:-1], -1, size) @ np.full(size, 1 / size)  # faster than mean
    rest = x[..., whole:]
    return np.concatenate([means, rest.mean(axis=-1, keepdims=True)], axis=-1) if rest.size else means


def moving_mean(level: Samples, n: int) -> Samples:
    """Return the centred moving average over `n` bins of a non-negative level. End values are repeated."""
    return np.asarray(np.maximum(ndimage.uniform_filter1d(level, max(1, n), mode="nearest"), 0.0))


def remove_impulses(strokes: Samples, impulses: Sequence[Impulse], min_db: float) -> Samples:
    """Return the level with all impulses of at least `min_db`, including their decay, set to 0."""
    rest = strokes.copy()
    for impulse in impulses:
        if impulse.broadband_db >= min_db:
            rest[max(0, impulse.start - 2) : impulse.decay_end + 1] = 0.0
    return rest


def _end_of_fall(level: Samples, n: int, stall_db: float) -> int:
    """Return the bin in which a falling level (dB) stops falling: the valley before the next rise.

    If the level does not stop falling, its length is returned. The maximum of the next `2 n` bins is used, so
    that a beat between two modes does not count as a stop.
    """
    upper = ndimage.maximum_filter1d(level, 2 * n, origin=-n, mode="nearest")
    stall = _first(upper[:-n] - upper[n:] < stall_db, len(level))
    valley = level[stall : stall + 3 * n]
    return stall + int(np.argmax(valley <= valley.min() + stall_db)) if valley.size else stall


def _tail_length(level: Samples, quiet_db: float, rise_db: float, *, is_last: bool) -> int:
    """Return how many bins a tail decays: to rest, to the valley before a rise, or to the next impulse."""
    if not level.size:
        return 0
    n = len(level)
    rest = _first(level < quiet_db, n)
    rise = _first(level[:rest] > np.minimum.accumulate(level[:rest]) + rise_db, n)
    if rest <= rise and rest < n:
        return rest
    if rise < n:
        return int(np.argmin(level[: rise + 1]))
    return n if is_last else 0


def _maximum(x: Samples, n: int) -> Samples:
    """Return the maximum over the n bins around each bin."""
    return ndimage.maximum_filter1d(x, n, mode="constant")


def _trailing_max(x: Samples, n: int) -> Samples:
    """Return the maximum over each bin and the n - 1 bins before it. Bins before the start count as 0."""
    return ndimage.maximum_filter1d(x, n, origin=(n - 1) // 2, mode="constant")


def _delayed(x: Samples, n: int) -> Samples:
    return np.concatenate([np.zeros(n), x])[: len(x)]


def _first(condition: NDArray[np.bool_], default: int) -> int:
    """Return the index of the first true element, or `default` if there is none."""
    index = int(condition.argmax()) if len(condition) else 0
    return index if len(condition) and condition[index] else default


def _outermost(is_active: NDArray[np.bool_], start: int, gap: int) -> int:
    """Return the last active element at or after `start` before a gap of more than `gap` elements."""
    (indices,) = np.nonzero(is_active[start:])
    if not len(indices):
        return start
    (breaks,) = np.nonzero(np.diff(indices) > gap)
    return start + int(indices[breaks[0]] if len(breaks) else indices[-1])
