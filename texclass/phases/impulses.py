"""What a level over time holds: impulses that rise and die away, and vibration that keeps on.

The one core of segmentation. A recording asks it once, of all its bins; a stream asks of the bins of the
contact at hand. It looks back a few hundredths of a second, and ahead until an impulse has died away.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from texclass.recording import Samples

SHARP_S, CALM_S = 0.003, 0.02
"""Levels are averaged over this to place a peak, and over this to follow what it leaves."""
RISE_S = 0.015
"""Longest rise of an impulse: half the duration of a soft contact and the delay of a filter."""
STALL_S, STALL_DB = 0.075, 2.0
"""What loses less than so many dB in this time no longer dies away (27 dB/s: a time constant of 0.33 s)."""
TAIL_S, TAIL_DB = 0.7, 6.0
"""What an impulse leaves rises nowhere by so much, and is gone (or struck again) in this time."""
LASTING_DB, RING_DB = 25.0, 18.0
"""An impulse below this level is over before it could pass for movement; one that falls by less before other
vibration sets in may be the first of the texture."""
DECAY_DB, WIDTH_DB, ONSET_DB = 30.0, 10.0, 20.0
"""A tap is measured to so far below its peak; it is so wide; it begins so far below."""
STRONG_DB = 6.0
"""An impulse so far above the strokes' own peaks (95 of 100 bins) is none of them."""
FIRST_GAP_S = 0.1
"""Impulses weaker than the strokes, so soon before them, are the first that a slow stroke felt."""
FAINT_DB = 25.0
"""What follows taps and lies so far below them, for less than 0.7 s, is their echo, no movement."""
SHORT_S = 0.7
WEAK_DB, PULL_S, PULL_DB = 16.0, 0.15, 6.0
"""Felt in the soft band alone, so soon before an impulse that is so much stronger, it is the hand's pull."""


@dataclass(frozen=True, kw_only=True)
class Rules:
    """What tells a tap from a stroke. Durations in seconds, ratios of power to that of the noise.

    Attributes
    ----------
    active_ratio, stroke_ratio
        Vibration stands this far above the noise; vibration that lasts, so far.
    tap_ratio
        A tap's peak stands this far above it.
    stand_out_db
        And this far above what was just before and what is left when it has died away.
    spacing_s
        Impulses closer than this are one tap and its rebounds.
    before_s
        What was before: this long, up to the rise.
    window_s, share
        The tool strokes where at least this share of a window vibrates; a tap leaves most of it quiet.
    gap_s
        A rest below this is none.
    pause_s
        Within this time after a stroke there are strokes, however faint, but no taps.
    range_db
        The weakest tap against the strongest one: a tool that is lifted, set down or turned in the hand
        moves, too, but less.
    clear_db, clear_s
        A weaker one (by at most `clear_range_db`) must be so strong, and so short.
    """

    active_ratio: float = 2.0
    stroke_ratio: float = 1.5
    tap_ratio: float = 40.0
    stand_out_db: float = 10.0
    spacing_s: float = 0.08
    before_s: float = 0.03
    window_s: float = 0.3
    share: float = 0.65
    gap_s: float = 0.03
    pause_s: float = 1.0
    range_db: float = 20.0
    clear_range_db: float = 32.0
    clear_db: float = 30.0
    clear_s: float = 0.02


@dataclass(frozen=True)
class Levels:
    """Power over that of the noise, bin by bin; 0 where there are no data.

    Attributes
    ----------
    loud : ndarray of shape (n_bins,)
        Of everything above the hand's own motion.
    felt : ndarray of shape (n_bins,)
        The greater of that and what is felt in the band in which soft contacts ring.
    strokes : ndarray of shape (n_bins,)
        The same where everything stands out a little, so that it is not the hand's unrest; less by a quarter
        where the noise comes and goes.
    bin_s : float
        Seconds a bin.
    least : int
        Bins without which a level is too uncertain to call vibration.
    """

    loud: Samples
    felt: Samples
    strokes: Samples
    bin_s: float
    least: int = 1

    def n_bins(self, seconds: float) -> int:
        """Return how many bins come nearest to `seconds`, at least one."""
        return max(1, round(seconds / self.bin_s))


@dataclass(frozen=True)
class Impulse:
    """Something that struck.

    Attributes
    ----------
    start, peak, end, gone : int
        Bins: it leaves what was before, is strongest, is down by 30 dB (or in the noise, or overtaken), and
        has left nothing.
    width : int
        Bins from the start until it is 10 dB below its peak.
    felt_db, loud_db : float
        Its peak above the noise, soft band included or not.
    stands_out_db : float
        Its peak above the greater of what was before and what is left.
    fall_db : float
        Its peak above what is left.
    """

    start: int
    peak: int
    end: int
    gone: int
    width: int
    felt_db: float
    loud_db: float
    stands_out_db: float
    fall_db: float

    @property
    def quality(self) -> float:
        """How surely it is one: 1 less the amplitude of what is around over that of its peak."""
        return 1.0 - float(10.0 ** (-self.stands_out_db / 20.0))


def decibels(ratio: Samples) -> Samples:
    """Return powers over the noise in dB, 0 for less than the noise."""
    return np.asarray(10.0 * np.log10(np.maximum(ratio, 1.0)))


def find_impulses(levels: Levels, rules: Rules) -> list[Impulse]:
    """Return what rises sharply out of what was before, noise or vibration, and dies away."""
    n = levels.n_bins
    sharp, loud = (decibels(mean_over(x, n(SHARP_S))) for x in (levels.felt, levels.loud))
    calm = decibels(mean_over(levels.felt, n(CALM_S)))
    quiet_db, least_db = 10.0 * np.log10(rules.active_ratio), rules.stand_out_db
    peaks, rises = _peaks(sharp, loud, n, rules)
    back, after, stall, tail, rise = (n(s) for s in (rules.before_s, CALM_S / 2, STALL_S, TAIL_S, RISE_S))
    found: list[Impulse] = []
    limit = len(sharp)
    for peak in reversed(peaks):
        if peak >= limit:
            continue
        top, look = float(sharp[peak]), max(0, peak - back)
        (below,) = np.nonzero(sharp[look:peak] < max(quiet_db, top - ONSET_DB))
        start = look + (int(below[-1]) + 1 if len(below) else 0)
        left = calm[min(peak + after, len(calm) - 1) :][: limit - peak]
        over = min(_first(sharp[peak:limit] < quiet_db, limit - peak), limit - peak - 1)
        gone = peak + min(_stall(left[: over + 3 * stall], stall), over)
        gone = min(gone + _tail(calm[gone : gone + tail][: limit - gone], quiet_db, limit - gone), limit)
        end = min(gone, peak + _first(sharp[peak:limit] < top - DECAY_DB, limit - peak))
        fall = top - float(left[: gone - peak + 1].min(initial=top))
        if fall < least_db:
            continue
        loudest = start + int(loud[start : peak + rise].argmax())
        strongest = float(loud[loudest])
        width = loudest + _first(loud[loudest:] < strongest - WIDTH_DB, limit - loudest) - start
        ends = max(end, start + 1), max(gone, start + 1)
        stands_out = min(float(rises[peak]), fall)
        found.append(Impulse(start, peak, *ends, width, top, strongest, stands_out, fall))
        limit = max(start, 1)
    return found[::-1]


def _peaks(
    sharp: Samples, loud: Samples, n_bins: Callable[[float], int], rules: Rules
) -> tuple[list[int], Samples]:
    """Return the peaks of both levels (dB) that rise sharply, and by how much each bin stands above before.

    The hand's pull, felt in the soft band, hides no tap that is loud besides and comes out of rest.
    """
    tap_db, least_db, back = 10.0 * np.log10(rules.tap_ratio), rules.stand_out_db, n_bins(rules.before_s)
    rises, near = np.zeros(len(sharp)), 2 * n_bins(rules.spacing_s) - 1
    reach = n_bins(RISE_S) + back // 2
    for level, most_db in ((sharp, np.inf), (loud, least_db)):
        before = _highest(level, back, reach + back // 2)[: len(level)]
        before[:reach] = 0.0  # so near to the start it is not known
        above = np.where(before < most_db, level - before, 0.0)
        np.maximum(rises, _highest(above, back, back - 1), out=rises)
    (risen,) = np.nonzero(rises >= least_db)
    highest = [x[risen] == _highest(x, near, near // 2, near // 2)[risen] for x in (sharp, loud)]
    is_peak = (highest[0] & (sharp[risen] >= tap_db)) | (highest[1] & (loud[risen] >= tap_db))
    return risen[is_peak].tolist(), rises


def _highest(level: Samples, n: int, before: int = 0, after: int = 0) -> Samples:
    """Return the maximum of each `n` bins in a row, with so many zeros before and after: len - n + 1 of them.

    Maxima of twice as many are those of two neighbours, so it takes a few passes.
    """
    high, done = np.concatenate([np.zeros(before), level, np.zeros(after)]), 1
    while 2 * done <= n:
        high = np.maximum(high[:-done], high[done:])
        done *= 2
    return np.asarray(np.maximum(high[: len(high) - n + done], high[n - done :]))


def find_movement(levels: Levels, impulses: Sequence[Impulse], rules: Rules) -> tuple[int, int] | None:
    """Return the bins [first, last) between which the tool keeps vibrating, pauses included; None if never.

    It does where at least `share` of a window is active, what impulses leave not counted: these leave most of
    a window quiet, however strong they are and however long they ring. The ends are then moved to the
    outermost vibration that hangs together with them, up to an impulse far stronger than the strokes.
    """
    size = max(levels.least, levels.n_bins(0.005))
    window = max(1, round(levels.n_bins(rules.window_s) / size))
    rings = [i for i in impulses if i.fall_db >= RING_DB]
    level = _blocks(without(levels.strokes, rings, LASTING_DB), size)
    share = ndimage.uniform_filter1d((level > rules.stroke_ratio).astype(float), window, mode="constant")
    (lasting,) = np.nonzero(share > rules.share - 1e-9)
    if not len(lasting):
        return None
    begun, ended = int(lasting[0]), int(lasting[-1])
    strong = quantiles(levels.strokes[begun * size : (ended + 1) * size], 0.95, of=decibels)[0] + STRONG_DB
    level = _blocks(without(levels.strokes, impulses, strong), size)
    active = ndimage.uniform_filter1d(level, 3, mode="nearest") > rules.stroke_ratio
    gap = max(1, round(levels.n_bins(rules.gap_s) / size))
    first = len(active) - 1 - _outermost(active[::-1], len(active) - 1 - begun, gap)
    last = _outermost(active, ended, gap)
    return first * size, min((last + 1) * size, len(levels.strokes))


def divide(
    levels: Levels, impulses: Sequence[Impulse], rules: Rules, begins: int | None = None
) -> tuple[list[Impulse], tuple[int, int] | None]:
    """Return what of impulses and of vibration that keeps on are the taps, and the bins of the movement.

    Impulses inside the movement belong to the texture, and so do those that hang together with its start,
    or follow within a pause, unless they are far stronger than the strokes. Where vibration `begins` with the
    data, in that bin, and fills a third of the time up to lasting strokes, so does the movement.
    """
    span = find_movement(levels, impulses, rules)
    if span is None or _is_echo(levels, impulses, span):
        return only_taps(impulses, levels, rules), None
    first, last = span
    if begins is not None:
        active = _blocks(levels.strokes[begins:first], max(levels.least, levels.n_bins(CALM_S)))
        first = begins if len(active) and np.mean(active > rules.active_ratio) > rules.share / 2 else first
    usual, strong = quantiles(levels.felt[first:last], 0.5, 0.95, of=decibels)
    before = [i for i in impulses if i.start < first]
    after = [i for i in impulses if i.start >= first and i.gone > last]
    while before and before[-1].felt_db < strong + STRONG_DB:
        gap_s = FIRST_GAP_S if before[-1].felt_db < usual else rules.gap_s
        if first - before[-1].end >= levels.n_bins(gap_s):
            break
        first = min(first, before.pop().start)
    while after and after[0].start < last + levels.n_bins(rules.pause_s):
        last = max(last, after.pop(0).gone)
    return only_taps(before + after, levels, rules), (first, last)


def _is_echo(levels: Levels, impulses: Sequence[Impulse], span: tuple[int, int]) -> bool:
    if span[1] - span[0] >= levels.n_bins(SHORT_S):
        return False
    strongest = max((i.loud_db for i in impulses if i.start < span[0]), default=0.0)
    left = without(levels.loud, impulses, LASTING_DB)[slice(*span)]
    return quantiles(left, 0.75, of=decibels)[0] < strongest - FAINT_DB


def only_taps(impulses: Sequence[Impulse], levels: Levels, rules: Rules) -> list[Impulse]:
    """Leave out the impulses of a tool that is lifted, set down or pulled, by what the strongest are like."""
    felt = max((i.felt_db for i in impulses), default=0.0)
    loud = max((i.loud_db for i in impulses), default=0.0)

    def is_tap(impulse: Impulse) -> bool:
        if impulse.loud_db < WEAK_DB:  # in the soft band alone
            soon = impulse.start + levels.n_bins(PULL_S)
            pulled = any(
                impulse.start < i.start < soon and i.felt_db > impulse.felt_db + PULL_DB for i in impulses
            )
            return not pulled and felt - impulse.felt_db <= WEAK_DB
        below = loud - impulse.loud_db
        is_clear = impulse.loud_db >= rules.clear_db and impulse.width <= levels.n_bins(rules.clear_s)
        return below <= (rules.clear_range_db if is_clear else rules.range_db)

    return [impulse for impulse in impulses if is_tap(impulse)]


def quantiles(level: Samples, *q: float, of: Callable[[Samples], Samples] = np.asarray) -> list[float]:
    """Return quantiles of a rising function of a level as `numpy.quantile` does, which takes far longer."""
    place = [each * (len(level) - 1) for each in q]
    near = sorted({k for at in place for k in (int(at), min(int(at) + 1, len(level) - 1))})
    values = of(np.partition(level, near)[near])
    return [float(np.interp(at, near, values)) for at in place]


def mean_over(level: Samples, n: int, block: int = 1 << 19) -> Samples:
    """Centred mean over `n` bins, the ends repeated, not below 0; in blocks, for scipy buffers its input."""
    mean = np.empty_like(level)
    for k in range(0, len(level), block):
        first = max(0, k - n)
        near = ndimage.uniform_filter1d(level[first : k + block + n], n, mode="nearest")
        np.maximum(near[k - first : k - first + block], 0.0, out=mean[k : k + block])
    return mean


def without(strokes: Samples, impulses: Sequence[Impulse], least_db: float) -> Samples:
    """Return a level without what impulses of at least `least_db` leave."""
    left = strokes.copy()
    for impulse in impulses:
        if impulse.loud_db >= least_db:
            left[max(0, impulse.start - 2) : impulse.gone + 1] = 0.0
    return left


def _stall(level: Samples, n: int) -> int:
    """Return where a falling level (dB) stops falling: the valley before what comes; its length if nowhere.

    The strongest within the next `2 n` bins is followed, so that a beat of two modes is no stop.
    """
    high = ndimage.maximum_filter1d(level, 2 * n, origin=-n, mode="nearest")  # faster, so short a level
    at = _first(high[:-n] - high[n:] < STALL_DB, len(level))
    ahead = level[at : at + 3 * n]
    return at + int(np.argmax(ahead <= ahead.min() + STALL_DB)) if len(ahead) else at


def _tail(level: Samples, quiet_db: float, n_left: int) -> int:
    """Return how long what is left goes on, if it comes to rest, or to the next impulse, without a rise."""
    if not len(level):
        return 0
    rest = _first(level < quiet_db, len(level))
    before = level[:rest]
    rise = _first(before > np.minimum.accumulate(before) + TAIL_DB, len(level))
    if rest < len(level) and rest <= rise:
        return rest
    if rise < len(level):
        return int(np.argmin(level[: rise + 1]))
    return len(level) if n_left <= len(level) else 0


def _first(where: NDArray[np.bool_], otherwise: int) -> int:
    at = int(where.argmax()) if len(where) else 0
    return at if len(where) and where[at] else otherwise


def _blocks(level: Samples, size: int) -> Samples:
    whole = len(level) // size * size
    means = level[:whole].reshape(-1, size) @ np.full(size, 1 / size)
    return np.append(means, level[whole:].mean()) if len(level) > whole else means


def _outermost(active: NDArray[np.bool_], start: int, gap: int) -> int:
    """Follow `active` forwards from `start` to its last true element before a gap of `gap` elements."""
    (where,) = np.nonzero(active[start:])
    if not len(where):
        return start
    (breaks,) = np.nonzero(np.diff(where) > gap)
    return start + int(where[breaks[0]] if len(breaks) else where[-1])
