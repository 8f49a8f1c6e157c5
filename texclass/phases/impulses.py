"""Find impulses that rise and decay, and movement that keeps vibrating, in a level over time.

This is the core of segmentation. A recording passes the levels of all its bins at once, a live stream those
of the current contact. It looks back a few hundredths of a second, and ahead until an impulse has decayed.
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
    """Power relative to the noise, bin by bin; 0 where there are no data.

    Attributes
    ----------
    broadband : ndarray of shape (n_bins,)
        Power above hand motion in all bands.
    combined : ndarray of shape (n_bins,)
        The larger of `broadband` and the power in the band in which soft contacts ring.
    strokes : ndarray of shape (n_bins,)
        The same where all bands exceed the noise, so that hand motion does not count; lowered by a quarter
        where the noise is intermittent.
    bin_s : float
        Duration of a bin in s.
    min_bins : int
        Bins below which a level is too uncertain to count as vibration.
    """

    broadband: Samples
    combined: Samples
    strokes: Samples
    bin_s: float
    min_bins: int = 1

    def n_bins(self, seconds: float) -> int:
        """Return how many bins come nearest to `seconds`, at least one."""
        return max(1, round(seconds / self.bin_s))


@dataclass(frozen=True)
class Impulse:
    """An impulse, in bins.

    Attributes
    ----------
    start, peak, end, decay_end : int
        Bins in which it rises, is strongest, is 30 dB below its peak (or in the noise, or overtaken by the
        next), and has decayed.
    width : int
        Bins from the start until it is 10 dB below its peak.
    combined_db, broadband_db : float
        Peak above the noise, with and without the soft band.
    prominence_db : float
        Peak above the larger of what was before and what is left.
    fall_db : float
        Peak above what is left.
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
        """Confidence: 1 minus the ratio of the amplitude around it to that of its peak."""
        return 1.0 - float(10.0 ** (-self.prominence_db / 20.0))


def decibels(ratio: Samples) -> Samples:
    """Return powers over the noise in dB, 0 for less than the noise."""
    return np.asarray(10.0 * np.log10(np.maximum(ratio, 1.0)))


def find_impulses(levels: Levels, settings: PhaseSettings) -> list[Impulse]:
    """Return the impulses of a recording: levels that rise sharply and decay.

    1. Smooth the levels and convert them to dB.
    2. Find candidate peaks: local maxima that stand out from what came before.
    3. Measure each candidate from the last to the first, as an impulse ends where the next one begins.
    4. Keep those that decay by at least `stand_out_db`.
    """
    smooth = SmoothLevels.of(levels, settings)
    rise_db = prominence_over_past(smooth, settings)
    impulses: list[Impulse] = []
    stop = len(rise_db)
    for peak in candidate_peaks(smooth, rise_db, settings)[::-1]:
        if peak < stop:
            impulse = measure(smooth, peak, stop, float(rise_db[peak]), settings)
            if impulse.fall_db >= settings.stand_out_db:
                impulses.append(impulse)
                stop = max(impulse.start, 1)
    return impulses[::-1]


@dataclass(frozen=True, eq=False)
class SmoothLevels:
    """Levels in dB above the noise, shape (n_bins,), smoothed for three purposes.

    Attributes
    ----------
    sharp, broadband : ndarray
        Short average that locates peaks, with and without the soft band.
    calm : ndarray
        Longer average that follows the decay.
    n_bins : callable
        Convert seconds to bins.
    """

    sharp: Samples
    broadband: Samples
    calm: Samples
    n_bins: Callable[[float], int]

    @classmethod
    def of(cls, levels: Levels, settings: PhaseSettings) -> Self:
        """Smooth the levels of a recording."""
        n = levels.n_bins
        sharp, loud, calm = (
            decibels(moving_mean(level, n(seconds)))
            for level, seconds in (
                (levels.combined, settings.sharp_s),
                (levels.broadband, settings.sharp_s),
                (levels.combined, settings.calm_s),
            )
        )
        return cls(sharp, loud, calm, n)


def prominence_over_past(smooth: SmoothLevels, settings: PhaseSettings) -> Samples:
    """Return by how much (dB) each bin, or one shortly before it, exceeds the maximum of the past.

    The past is a window of `before_s` that ends `rise_s` earlier. The level of all bands counts only where
    that past is at rest: the pull of the hand in the soft band must not mask a loud tap.
    """
    n_past, n_rise = smooth.n_bins(settings.before_s), smooth.n_bins(settings.rise_s)
    rise = np.zeros(len(smooth.sharp))
    for level, highest_past_db in ((smooth.sharp, np.inf), (smooth.broadband, settings.stand_out_db)):
        past = _delayed(_trailing_max(level, n_past), n_rise + 1 - n_past % 2)
        past[: n_rise + n_past // 2] = 0.0  # less than half of the window exists
        above = np.where(past < highest_past_db, level - past, 0.0)
        rise = np.maximum(rise, _trailing_max(above, n_past))
    return rise


def candidate_peaks(smooth: SmoothLevels, rise_db: Samples, settings: PhaseSettings) -> list[int]:
    """Return the bins of hits: local maxima that stand out from the past and are loud as a tap.

    Of the hits within `tap_spacing_s` the strongest counts. It is compared with hits only: a later rebound
    that is stronger by up to `rebound_db` does not stand out from the first hit, and must not hide it.
    """
    spacing, rise = (2 * smooth.n_bins(seconds) - 1 for seconds in (settings.tap_spacing_s, settings.rise_s))
    loud_db = 10 * np.log10(settings.tap_ratio)
    is_peak = np.zeros(len(rise_db), dtype=bool)
    for level in (smooth.sharp, smooth.broadband):
        is_hit = (rise_db >= settings.stand_out_db) & (level >= loud_db) & (level == _maximum(level, rise))
        is_highest = level == _maximum(np.where(is_hit, level, 0.0), spacing)
        is_peak |= is_hit & is_highest & (level >= _maximum(level, spacing) - settings.rebound_db)
    return np.flatnonzero(is_peak).tolist()


def measure(smooth: SmoothLevels, peak: int, stop: int, rise_db: float, settings: PhaseSettings) -> Impulse:
    """Measure the impulse with its peak in bin `peak`; the next impulse starts in bin `stop`."""
    sharp, loud, n_bins = smooth.sharp, smooth.broadband, smooth.n_bins
    quiet_db = 10 * np.log10(settings.active_ratio)
    top = float(sharp[peak])

    hit = first_hit(smooth, peak, settings)
    onset = max(0, hit - n_bins(settings.before_s))
    before, top_of_hit = sharp[onset:hit], float(sharp[hit])
    # In the tail of another impulse the level may nowhere be 20 dB lower.
    lowest_db = float(before.min(initial=top_of_hit))
    onset_db = max(quiet_db, top_of_hit - settings.onset_db, lowest_db + (top_of_hit - lowest_db) / 3)
    below = np.flatnonzero(before < onset_db)
    start = onset + (int(below[-1]) + 1 if below.size else 0)

    gone, lowest = decay_end(smooth, peak, stop, settings)
    end = min(gone, peak + _first(sharp[peak:stop] < top - settings.decay_db, stop - peak))
    fall_db = max(0.0, top - lowest)

    loudest = start + int(loud[start : peak + n_bins(settings.rise_s)].argmax())
    broadband_db = float(loud[loudest])
    width = loudest + _first(loud[loudest:] < broadband_db - settings.width_db, stop - loudest) - start
    return Impulse(
        start, peak, max(end, start + 1), max(gone, start + 1), width,
        combined_db=top, broadband_db=broadband_db, prominence_db=min(rise_db, fall_db), fall_db=fall_db,
    )  # fmt: skip


def first_hit(smooth: SmoothLevels, peak: int, settings: PhaseSettings) -> int:
    """Return the bin of the first hit of a tap whose strongest hit is in bin `peak`.

    The first hit is less than `tap_spacing_s` earlier, and weaker by at most `rebound_db`. It rises by
    `stand_out_db` within `rise_s`, unlike the tail of an earlier tap, and falls by `rebound_db` after it.
    """
    sharp, n_rise = smooth.sharp, smooth.n_bins(settings.rise_s)
    begin = max(0, peak - smooth.n_bins(settings.tap_spacing_s) + 1)
    (strong,) = np.nonzero(sharp[begin:peak] >= sharp[peak] - settings.rebound_db)
    if not strong.size:
        return peak
    first = begin + int(strong[0])
    hit = first + int(sharp[first : min(peak, first + n_rise)].argmax())
    before, after = (
        float(part.min(initial=np.inf)) for part in (sharp[max(0, hit - n_rise) : hit], sharp[hit:peak])
    )
    is_hit = before < sharp[hit] - settings.stand_out_db and after < sharp[hit] - settings.rebound_db
    return hit if is_hit else peak


def decay_end(smooth: SmoothLevels, peak: int, stop: int, settings: PhaseSettings) -> tuple[int, float]:
    """Return the bin in which an impulse has decayed, and its lowest level (dB) until it stops falling.

    It has decayed when the level reaches rest or stops falling, and after a tail that falls without a rise.
    """
    n_bins, quiet_db = smooth.n_bins, 10 * np.log10(settings.active_ratio)
    after = min(peak + n_bins(settings.calm_s / 2), len(smooth.calm) - 1)
    decay = smooth.calm[after : after + stop - peak]
    n_stall = n_bins(settings.stall_s)
    quiet = min(_first(smooth.sharp[peak:stop] < quiet_db, stop - peak), stop - peak - 1)
    n_falling = min(_end_of_fall(decay[: quiet + 3 * n_stall], n_stall, settings.stall_db), quiet)
    gone = peak + n_falling
    tail = smooth.calm[gone : min(gone + n_bins(settings.tail_s), stop)]
    n_tail = _tail_length(tail, quiet_db, settings.tail_db, is_last=stop - gone <= len(tail))
    lowest = float(decay[: n_falling + n_tail + 1].min(initial=np.inf))
    return min(gone + n_tail, stop), lowest


def find_movement(
    levels: Levels, impulses: Sequence[Impulse], settings: PhaseSettings
) -> tuple[int, int] | None:
    """Return the bins [first, last) between which the tool keeps vibrating, pauses included; None if never.

    1. Remove impulses, which leave most of a window quiet, however strong they are and long they ring.
    2. Find the windows of which at least `share` is active.
    3. Move both ends to the outermost vibration connected with them, up to an impulse far stronger than the
       strokes.
    """
    size = max(levels.min_bins, levels.n_bins(0.005))
    window = max(1, round(levels.n_bins(settings.window_s) / size))
    rings = [i for i in impulses if i.fall_db >= settings.ring_db]
    level = bin_means(remove_impulses(levels.strokes, rings, settings.lasting_db), size)
    share = ndimage.uniform_filter1d((level > settings.stroke_ratio).astype(float), window, mode="constant")
    (lasting,) = np.nonzero(share > settings.share - 1e-9)
    if not len(lasting):
        return None
    begun, ended = int(lasting[0]), int(lasting[-1])
    peak_db = np.quantile(decibels(levels.strokes[begun * size : (ended + 1) * size]), 0.95)
    strong = float(peak_db) + settings.strong_db
    level = bin_means(remove_impulses(levels.strokes, impulses, strong), size)
    active = ndimage.uniform_filter1d(level, 3, mode="nearest") > settings.stroke_ratio
    gap = max(1, round(levels.n_bins(settings.gap_s) / size))
    first = len(active) - 1 - _outermost(active[::-1], len(active) - 1 - begun, gap)
    last = _outermost(active, ended, gap)
    return first * size, min((last + 1) * size, len(levels.strokes))


def split_taps_and_movement(
    levels: Levels,
    impulses: Sequence[Impulse],
    settings: PhaseSettings,
    begins: int | None = None,
    opening: Sequence[Impulse] = (),
) -> tuple[list[Impulse], tuple[int, int] | None]:
    """Return the taps among the impulses, and the bins of the movement (None if there is none).

    Impulses inside the movement belong to the texture, and so do those connected with its start, or within a
    pause after it, unless they are far stronger than the strokes. Where vibration `begins` with the
    data, in that bin, and fills a third of the time up to lasting strokes, so does the movement. The decay
    of `opening` impulses, which are no taps, is no movement either.
    """
    span = find_movement(levels, [*opening, *impulses], settings)
    if span is None or _is_echo(levels, impulses, span, settings):
        return select_taps(impulses, levels, settings), None
    first, last = span
    if begins is not None and begins < first:
        active = bin_means(levels.strokes[begins:first], max(levels.min_bins, levels.n_bins(settings.calm_s)))
        if np.mean(active > settings.active_ratio) > settings.share / 2:
            first = begins
    usual, strong = np.quantile(decibels(levels.combined[first:last]), [0.5, 0.95])
    before = [i for i in impulses if i.start < first]
    after = [i for i in impulses if i.start >= first and i.decay_end > last]
    while before and before[-1].combined_db < strong + settings.strong_db:
        gap_s = settings.first_gap_s if before[-1].combined_db < usual else settings.gap_s
        if first - before[-1].end >= levels.n_bins(gap_s):
            break
        first = min(first, before.pop().start)
    while after and after[0].start < last + levels.n_bins(settings.pause_s):
        last = max(last, after.pop(0).decay_end)
    return select_taps(before + after, levels, settings), (first, last)


def _is_echo(
    levels: Levels, impulses: Sequence[Impulse], span: tuple[int, int], settings: PhaseSettings
) -> bool:
    """Return whether short, weak vibration is an echo of impulses, or noise before or between them."""
    n_bins = span[1] - span[0]
    strongest_db = 0.0
    for impulse in impulses:
        is_before, is_after = impulse.start < span[0], impulse.start >= span[1]
        longest_s = settings.echo_s if is_before else settings.between_s
        is_tap = is_before or is_after or impulse.fall_db >= settings.clear_db
        if is_tap and n_bins < levels.n_bins(longest_s):
            strongest_db = max(strongest_db, impulse.broadband_db)
    rest = remove_impulses(levels.broadband, impulses, settings.lasting_db)[slice(*span)]
    return bool(np.quantile(decibels(rest), 0.75) < strongest_db - settings.echo_db)


def select_taps(impulses: Sequence[Impulse], levels: Levels, settings: PhaseSettings) -> list[Impulse]:
    """Return the impulses without weak ones, of a tool that is lifted, set down or pulled."""
    felt = max((i.combined_db for i in impulses), default=0.0)
    loud = max((i.broadband_db for i in impulses), default=0.0)

    def is_pull(impulse: Impulse) -> bool:
        soon = impulse.start + levels.n_bins(settings.pull_s)
        stronger_db = impulse.combined_db + settings.pull_db
        return any(impulse.start < i.start < soon and i.combined_db > stronger_db for i in impulses)

    def is_tap(impulse: Impulse) -> bool:
        if impulse.broadband_db < settings.soft_db:
            return felt - impulse.combined_db <= settings.soft_db and not is_pull(impulse)
        is_short = impulse.width <= levels.n_bins(settings.clear_s)
        is_clear = impulse.broadband_db >= settings.clear_db and is_short
        return loud - impulse.broadband_db <= (settings.clear_range_db if is_clear else settings.range_db)

    return [impulse for impulse in impulses if is_tap(impulse)]


def bin_means(x: Samples, size: int) -> Samples:
    """Return the means of consecutive bins of `size` samples along the last axis; the last may be shorter."""
    if size == 1:
        return x
    whole = x.shape[-1] // size * size
    means = x[..., :whole].reshape(*x.shape[:-1], -1, size) @ np.full(size, 1 / size)  # faster than mean
    rest = x[..., whole:]
    return np.concatenate([means, rest.mean(axis=-1, keepdims=True)], axis=-1) if rest.size else means


def moving_mean(level: Samples, n: int) -> Samples:
    """Return the centred mean over `n` bins (at least 1) of a level of at least 0; the ends are repeated."""
    return np.asarray(np.maximum(ndimage.uniform_filter1d(level, max(1, n), mode="nearest"), 0.0))


def remove_impulses(strokes: Samples, impulses: Sequence[Impulse], least_db: float) -> Samples:
    """Return a level that is 0 during impulses of at least `least_db` and their decay."""
    left = strokes.copy()
    for impulse in impulses:
        if impulse.broadband_db >= least_db:
            left[max(0, impulse.start - 2) : impulse.decay_end + 1] = 0.0
    return left


def _end_of_fall(level: Samples, n: int, stall_db: float) -> int:
    """Return where a falling level (dB) stops: in the valley before the next rise; its length if nowhere.

    The maximum of the next `2 n` bins is followed, so that a beat of two modes does not count as a stop.
    """
    upper = ndimage.maximum_filter1d(level, 2 * n, origin=-n, mode="nearest")
    stall = _first(upper[:-n] - upper[n:] < stall_db, len(level))
    ahead = level[stall : stall + 3 * n]
    return stall + int(np.argmax(ahead <= ahead.min() + stall_db)) if ahead.size else stall


def _tail_length(level: Samples, quiet_db: float, rise_db: float, *, is_last: bool) -> int:
    """Return how long a tail decays: to rest, to the valley before a rise, or to the next impulse."""
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
    """Return the maximum of the n bins around each bin."""
    return ndimage.maximum_filter1d(x, n, mode="constant")


def _trailing_max(x: Samples, n: int) -> Samples:
    """Return the maximum of each bin and the n - 1 before it; values before the start count as 0."""
    return ndimage.maximum_filter1d(x, n, origin=(n - 1) // 2, mode="constant")


def _delayed(x: Samples, n: int) -> Samples:
    return np.concatenate([np.zeros(n), x])[: len(x)]


def _first(where: NDArray[np.bool_], otherwise: int) -> int:
    at = int(where.argmax()) if len(where) else 0
    return at if len(where) and where[at] else otherwise


def _outermost(active: NDArray[np.bool_], start: int, gap: int) -> int:
    """Follow `active` forwards from `start` to its last true element before a gap of `gap` elements."""
    (where,) = np.nonzero(active[start:])
    if not len(where):
        return start
    (breaks,) = np.nonzero(np.diff(where) > gap)
    return start + int(where[breaks[0]] if len(breaks) else where[-1])
