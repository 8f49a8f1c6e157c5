"""What the tool does, as it happens: how strongly it vibrates; contacts, strokes, taps and lift-offs of that.

Vibration is measured bin by bin (`Level`); a level against a noise floor, with hysteresis, says when there is
some activity. Whether it is taps or strokes says the core that recordings are segmented by, asked of the
activity at hand (`texclass.phases.split_taps_and_movement`). `TapMemory` keeps the taps for what reads them
with a movement.
"""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from texclass.phase_settings import PhaseSettings
from texclass.phases import (
    AT_REST_M_S2,
    MIN_LEVEL_SAMPLES,
    Impulse,
    Levels,
    bin_means,
    find_glitches,
    find_hand_start,
    find_impact,
    find_impulses,
    interpolate_glitches,
    select_taps,
    split_taps_and_movement,
)
from texclass.recording import Samples, Tap
from texclass.signals import butterworth, causal

Tapped = tuple[Samples, tuple[Tap, ...]]
"""What was felt before a movement: a stretch of samples with its taps, counted from its start."""
Kind = Literal["contact", "stroke", "tap", "lift-off", "break"]
_DEAD = 1e-14
"""Power below this share of the strongest is rounding."""
_LEAST = 1e-300
"""Stands for a power of 0."""


@dataclass(frozen=True)
class SteadyNoise:
    """When a steady level is noise, not a stroke.

    Attributes
    ----------
    blocks, ratio
        Blocks in which a level is steady, and up to which ratio of their powers. Strokes of a robot have at
        least 1.32 in 4 s (800 stretches), a hum has 1.1, white noise 1.1 at 10 kHz and 1.2 to 1.4 at 1 kHz.
    min_samples
        Samples of a block: the power of fewer fluctuates too much to call a level steady.
    white
        Correlation of neighbouring samples up to which a steady signal without scale counts as noise.
    """

    blocks: int = 16
    ratio: float = 1.3
    min_samples: int = 250
    white: float = 0.25


STEADY = SteadyNoise()


class Ring:
    """The last rows of a stream, any stretch of them in one piece.

    Rows are numbered from the first one ever pushed. They are written one after another; where there is no
    place left, the last `capacity` of them go to the front.

    Parameters
    ----------
    capacity : int
        Rows that are kept.
    n_columns : int
        Numbers a row.
    """

    def __init__(self, capacity: int, n_columns: int) -> None:
        self.capacity = capacity
        self._rows = np.zeros((2 * capacity, n_columns))
        self._front = 0
        """Number of the row that stands first."""
        self.start = self.stop = 0
        """The rows [start, stop) are at hand."""

    def push(self, rows: Samples) -> None:
        """Append rows of shape (n, n_columns), n at most the capacity; the oldest ones make place."""
        if self.stop + len(rows) - self._front > len(self._rows):
            self._rows[: self.stop - self.start] = self.view(self.start, self.stop)
            self._front = self.start
        at = self.stop - self._front
        self._rows[at : at + len(rows)] = rows
        self.stop += len(rows)
        self.start = max(self.start, self.stop - self.capacity)

    def skip(self, n: int) -> None:
        """Go on `n` rows later: those between, and all before, are not at hand."""
        self._front = self.start = self.stop = self.stop + n

    def view(self, start: int, stop: int) -> Samples:
        """Return rows [start, stop), shape (stop - start, n_columns); valid until the next push.

        Raises
        ------
        ValueError
            If they are not at hand.
        """
        if not self.start <= start <= stop <= self.stop:
            raise ValueError(f"rows {start} to {stop}. Expected from {self.start} to {self.stop}")
        return self._rows[start - self._front : stop - self._front]

    @property
    def n_bytes(self) -> int:
        """Memory it takes."""
        return self._rows.nbytes


class Level:
    """Mean square of what a causal high-pass leaves, summed over axes, in bins of some milliseconds.

    The filter runs from sample to sample and bins are counted from the first sample after a break, so they
    do not depend on how samples come in blocks.

    Parameters
    ----------
    fs : float
        Sampling rate in Hz.
    n_axes : int
        Columns of what is pushed.
    keep_s : float
        Seconds of the vibration that are remembered.

    Attributes
    ----------
    fs : float
        Sampling rate in Hz.
    bin_size : int
        Samples a bin.
    vibration : Ring
        What the high-pass leaves, shape (n, n_axes).
    high_pass : ndarray of shape (n_sections, 6)
        Second-order sections of the filter.
    """

    def __init__(self, fs: float, n_axes: int, keep_s: float) -> None:
        self.fs = fs
        # The bins that are followed have about 5 ms.
        self.bin_size = max(MIN_LEVEL_SAMPLES, round(0.005 * fs))
        self.vibration = Ring(round(keep_s * fs) + 4 * self.bin_size, n_axes)
        # Below 60 Hz is the motion of hand, tremor and gravity, as in `texclass.phases`.
        self.high_pass = butterworth("highpass", min(60.0, 0.2 * fs), fs)
        self._state: Samples | None = None

    def push(self, rows: Samples) -> Iterable[tuple[int, float]]:
        """Filter finite samples (n, n_axes), n a multiple of `bin_size`; return end and power of each bin.

        The power is 0 where no sample differs: zeros and held values say nothing of the noise.
        """
        if not len(rows):
            return []
        # Without a state the filter is at rest on the first sample: gravity causes no transient.
        filtered, self._state = causal(self.high_pass, rows, self._state)
        start, size = self.vibration.stop, self.bin_size
        self.vibration.push(filtered)
        # Each segment is summed by itself: the order does not depend on how many there are.
        powers = np.add.reduceat(self.power(start, self.vibration.stop), range(0, len(rows), size))
        bins = rows.reshape(-1, size, rows.shape[1])
        sums = np.where(np.ptp(bins, axis=1).any(axis=1), powers, 0.0).tolist()  # held values are padding
        return zip(range(start + size, self.vibration.stop + 1, size), (s / size for s in sums), strict=True)

    def power(self, start: int, stop: int) -> Samples:
        """Return the square of the vibration, summed over axes, of samples [start, stop)."""
        near = self.vibration.view(start, stop)
        return np.asarray(np.einsum("ij,ij->i", near, near))

    def fine(self, start: int, stop: int) -> tuple[int, int, Samples]:
        """Return the powers of bins of about a millisecond of what is at hand of samples [start, stop).

        Before them stand the first sample, and how many there are in a bin.
        """
        start, size = max(start, self.vibration.start), max(1, round(0.001 * self.fs))
        return start, size, bin_means(self.power(start, stop), size)

    def correlation(self, start: int, stop: int) -> float:
        """Return how far samples [start, stop) resemble those before them: about 0 for white noise."""
        v = self.vibration.view(start, stop)
        power = float((v**2).sum())
        return float((v[1:] * v[:-1]).sum()) / power if power > 0 else 0.0

    def skip(self, n: int) -> None:
        """Go on `n` samples later, at rest on what comes then."""
        self.vibration.skip(n)
        self._state = None


@dataclass(frozen=True)
class Event:
    """Something that happened: at which sample, and after which sample it was known.

    Attributes
    ----------
    kind
        "contact" (a movement has begun), "stroke" (it goes on after a turning point), "tap", "lift-off",
        "break" (samples are missing).
    sample
        When it happened. Of a tap: of the impact; of a lift-off: one past the last vibration.
    known
        Samples that had to come before it was known.
    end
        Of a tap: one past its decay. Else `sample`.
    what
        In words.
    width, quality
        Of a tap: see `texclass.recording.Tap`.
    """

    kind: Kind
    sample: int
    known: int
    end: int
    what: str = ""
    width: int = 0
    quality: float = 1.0


@dataclass(frozen=True, kw_only=True)
class ContactRules(PhaseSettings):
    """Settings of segmentation, and those of a stream. Durations in seconds, ratios of power.

    Attributes
    ----------
    quiet_s
        Length of the stretch at the start whose level is the first noise floor.
    off_ratio
        Vibration above the floor that ends an activity (`active_ratio` begins it).
    smooth_s
        Levels are averaged over about this time.
    turn_s
        A pause of this length ends a stroke.
    pause_s
        A pause of this length is a lift-off.
    floor_s
        Time constant with which the floor follows the noise at rest.
    drop_ratio
        Where the stream began in contact: a level this far below that of the contact is a lift-off.
    block_s
        Length of a block; a level that is steady for `STEADY.blocks` of them is noise, not a stroke.
    """

    quiet_s: float = 0.1
    off_ratio: float = 1.6
    smooth_s: float = 0.015
    turn_s: float = 0.06
    pause_s: float = 0.5
    floor_s: float = 2.0
    drop_ratio: float = 1000.0
    block_s: float = 0.25


class Contact:
    """What the tool does, bin by bin.

    Parameters
    ----------
    level : Level
        Whose bins come.
    rules : ContactRules
        Which levels and durations make a contact, a tap, a lift-off.
    in_contact : bool, optional
        Whether the stream begins in the middle of a movement; None decides by its first `quiet_s`: a steady
        level below 6 mg, or white, is rest.
    unit : str
        Of the acceleration.

    Attributes
    ----------
    moving : bool
        Whether the tool strokes.
    active_until : int
        One past the last bin with vibration.
    onset : int
        Since when it strokes.
    """

    def __init__(self, level: Level, rules: ContactRules, in_contact: bool | None, unit: str) -> None:
        self.rules, self.unit, self._heard = rules, unit, level
        bin_s = level.bin_size / level.fs
        self._n = {
            name: max(1, round(getattr(rules, name) / bin_s))
            for name in ("quiet_s", "smooth_s", "window_s", "gap_s", "turn_s", "pause_s")
        }
        self._n["block_s"] = max(round(rules.block_s / bin_s), -(-STEADY.min_samples // level.bin_size))
        self._forget = 1 - math.exp(-bin_s / rules.floor_s)
        self._asked = in_contact
        self.moving, self.onset, self.active_until = bool(in_contact), 0, 0
        self.floor = 0.0
        self.level = 0.0
        self._peak = 0.0
        self._felt = 0.0
        """Level of a contact that the stream began in; 0 where the floor is known from a rest."""
        self._opening: list[float] = []
        """Powers of the bins so far, while nothing is known of the noise."""
        self._recent: deque[float] = deque(maxlen=self._n["smooth_s"])
        self._active: deque[bool] = deque(maxlen=self._n["window_s"])
        self._block: list[float] = []
        self._blocks: deque[float] = deque(maxlen=STEADY.blocks)
        """Powers of the last blocks of a contact."""
        self._on, self._quiet_for, self._tapped_until, self._tap_peak = False, 0, 0, -math.inf
        self.struck: list[Impulse] = []
        """What taps there were since the last lift-off."""
        self._run: list[int] = []
        """Start and end of the activity at hand, while it is not known what it is."""

    @property
    def constants(self) -> dict[str, Any]:
        """What a program needs to know that follows the tool by the table in docs/stream-logic.md."""
        ruled = ("active_ratio", "off_ratio", "share", "drop_ratio", "pause_s")
        return {
            "bin_samples": self._heard.bin_size,
            "n_bins": dict(self._n),
            **{name: getattr(self.rules, name) for name in ruled},
            "floor_forget": self._forget,
            "dead": _DEAD,
            "least": _LEAST,
            "rest_power": AT_REST_M_S2**2 if self.unit == "m/s^2" else 0.0,
            "white": STEADY.white,
            "in_contact": self._asked,
            "steady_blocks": STEADY.blocks,
            "steady_ratio": STEADY.ratio,
        }

    @property
    def phase(self) -> Literal["listening", "rest", "touched", "moving", "pause"]:
        """What the tool does, in a word."""
        if self.moving:
            return "moving" if self._quiet_for <= self._n["turn_s"] else "pause"
        if self._opening or not self.floor:
            return "listening"
        return "touched" if self._run else "rest"

    @property
    def level_db(self) -> float:
        """Level above the noise floor in dB; above nothing known, 0."""
        floor = self._floor()
        return 10 * math.log10(max(self.level, _LEAST) / floor) if floor > 0 and self.floor > 0 else 0.0

    def step(self, stop: int, power: float) -> list[Event]:
        """Take in the bin that ends at a sample, its mean square vibration, and return what is known now."""
        self._recent.append(power)
        self.level = sum(self._recent) / len(self._recent)
        self._peak = max(self._peak, power)
        if self.floor == 0.0 and not self._felt:
            return self._open(stop, power) if power > 0 or self._asked else []
        said = self._begun_in_contact(stop) if self._felt else self._against_floor(stop, power)
        return said + self._steady(stop, power)

    def interrupt(self, at: int, missing: int, missing_s: float) -> list[Event]:
        """Go on after `missing` samples; a break longer than a pause is a lift-off."""
        said = [Event("break", at, at, at, f"{missing} samples missing")]
        self._recent.clear()
        self._forget_activity()
        self._on, self._opening = False, []
        if self.moving and missing_s > self.rules.pause_s:
            said += self._lift(at)
            self.moving = bool(self._felt)
        self.onset = self.active_until = at + missing
        if self.moving and len(said) > 1:
            said.append(Event("contact", self.onset, self.onset, self.onset, "taken as going on"))
        return said

    def _open(self, stop: int, power: float) -> list[Event]:
        """Listen for a while before anything is said of the noise."""
        said = []
        if not self._opening:
            self.onset = stop - self._heard.bin_size
            if self._asked:
                said = [Event("contact", self.onset, stop, self.onset, "the stream begins in movement")]
        self._opening.append(power)
        self.active_until = stop
        if len(self._opening) < self._n["quiet_s"]:
            return said
        mean = math.fsum(self._opening) / len(self._opening)
        in_contact = self._asked
        if in_contact is None:
            steady = max(self._opening) <= 10 * mean
            small = self.unit == "m/s^2" and mean < AT_REST_M_S2**2
            white = abs(self._heard.correlation(self.onset, stop)) <= STEADY.white
            in_contact = mean > 0 and not (steady and (small or white))
        if in_contact:
            if not self.moving:
                what = "no rest at the start: taken as movement"
                said = [Event("contact", self.onset, stop, self.onset, what)]
            self.moving, self._felt = True, mean or _LEAST
        else:
            self.floor = mean or _LEAST
        self._opening = []
        return said

    def _begun_in_contact(self, stop: int) -> list[Event]:
        """Follow a contact whose noise floor nobody knows: it ends where its level drops by far."""
        if self.level * self.rules.drop_ratio >= self._felt:
            self._felt = max(self._felt, _LEAST) * (max(self.level, _LEAST) / self._felt) ** self._forget
            self._quiet_for, self.active_until = 0, stop
            return []
        self._quiet_for += 1
        if self._quiet_for < self._n["pause_s"]:
            return []
        self.floor, self._felt = max(self.level, _LEAST), 0.0
        return self._lift(stop)

    def _against_floor(self, stop: int, power: float) -> list[Event]:
        """Tell activity from noise, and a movement, which lasts, from a tap."""
        rules, n, start = self.rules, self._n, stop - self._heard.bin_size
        self._on = self.level > (rules.off_ratio if self._on else rules.active_ratio) * self._floor()
        self._active.append(self._on)
        said: list[Event] = []
        if self._on:
            if self.moving and self._quiet_for >= n["turn_s"]:
                said.append(Event("stroke", start, stop, start))
            self._quiet_for, self.active_until = 0, stop
            self._run = [self._run[0] if self._run else start, stop]
        else:
            self._quiet_for += 1
            if not self._run and power > 0:
                self.floor += self._forget * (power - self.floor)
        if self.moving:
            return said + (self._lift(stop) if self._quiet_for >= n["pause_s"] else [])
        if self._run and self._quiet_for >= n["gap_s"]:
            said += self._told(stop, is_over=True)
            self._run = []
        elif self._run and sum(self._active) >= rules.share * n["window_s"]:
            said += self._told(stop, is_over=False)
        return said

    def _steady(self, stop: int, power: float) -> list[Event]:
        """Take a level that is steady during a contact as the new noise floor, unless contact is stated."""
        if self._asked or power == 0 or not self.moving:
            self._block.clear()
            self._blocks.clear()
            return []
        self._block.append(power)
        if len(self._block) < self._n["block_s"]:
            return []
        self._blocks.append(math.fsum(self._block) / len(self._block))
        self._block.clear()
        if len(self._blocks) < STEADY.blocks or max(self._blocks) > STEADY.ratio * min(self._blocks):
            return []
        self.floor, self._felt = math.fsum(self._blocks) / len(self._blocks), 0.0
        self._blocks.clear()
        seconds = STEADY.blocks * self._n["block_s"] * self._heard.bin_size / self._heard.fs
        return self._lift(stop, f"the level is steady for {seconds:.3g} s: taken as the new noise floor")

    def _told(self, known: int, *, is_over: bool) -> list[Event]:
        """Say what the activity at hand is: taps once it is over; or what goes on, if it is a movement."""
        rules = self.rules
        before = round(2 * rules.before_s * self._heard.fs)
        start, size, powers = self._heard.fine(self._run[0] - before, known)
        ratio = powers / self._floor()
        levels = Levels(ratio, ratio, ratio, size / self._heard.fs, -(-MIN_LEVEL_SAMPLES // size))
        impulses = find_impulses(levels, rules)
        taps, span = (impulses, None) if is_over else split_taps_and_movement(levels, impulses, rules)
        if not is_over and span is None:
            return []
        told = []
        spacing = rules.tap_spacing_s * self._heard.fs
        for tap in taps:
            peak = start + tap.peak * size
            is_apart = start + tap.start * size >= self._tapped_until and peak - self._tap_peak >= spacing
            if is_apart and tap in select_taps([*self.struck, tap], levels, rules):
                self.struck.append(tap)
                self._tap_peak = peak
                at, self._tapped_until = start + tap.start * size, start + tap.end * size
                told.append(Event("tap", at, known, self._tapped_until, "", tap.width * size, tap.quality))
        if span is not None:
            self.moving, self.onset, self._run = True, start + span[0] * size, []
            told.append(Event("contact", self.onset, known, self.onset))
        return told

    def _lift(self, known: int, what: str = "") -> list[Event]:
        self.moving = False
        self._forget_activity()
        return [Event("lift-off", self.active_until, known, self.active_until, what)]

    def _forget_activity(self) -> None:
        self._run, self.struck = [], []
        self._active.clear()
        self._block.clear()
        self._blocks.clear()

    def _floor(self) -> float:
        return max(self.floor, _DEAD * self._peak, _LEAST)


class TapMemory:
    """The taps since the last lift-off, measured as `texclass.phases` does.

    Parameters
    ----------
    ring : Ring
        Samples of the stream, the axes of the acceleration first.
    n_axes : int
        How many these are.
    level : Level
        Of the vibration.
    hand_s : float
        Longest acceleration of the hand before an impact, in s.
    """

    def __init__(self, ring: Ring, n_axes: int, level: Level, hand_s: float) -> None:
        self._ring, self._n_axes, self._level, self._hand_s = ring, n_axes, level, hand_s
        self.clear()

    def clear(self) -> None:
        """Forget the taps: another contact, or samples are missing."""
        self._taps: list[Tap] = []

    def add(self, event: Event, floor: float) -> Event | None:
        """Remember a tap and return its event, the impact to the sample; None if it was a wild sample."""
        fs, last = self._level.fs, self._taps[-1].end if self._taps else 0
        # Its impact is at most 3 ms before the impulse begins.
        start = max(self._level.vibration.start, event.sample - round(0.003 * fs))
        stop = max(start + 1, event.sample + event.width)
        at = find_impact(self._level.power(start, stop), floor)
        impact = event.sample if at is None else start + at
        earliest = max(self._ring.start, last, impact - round(self._hand_s * fs))
        axes = self._ring.view(earliest, event.end)[:, : self._n_axes]
        glitches = find_glitches(axes)
        if ((glitches >= start - earliest) & (glitches < stop - earliest)).any():
            return None
        before = interpolate_glitches(axes, glitches)[: max(0, impact - earliest)]
        began = min(impact, earliest + find_hand_start(before, fs))
        tap = Tap(began, impact, max(event.end, impact + 1), event.width, event.quality)
        self._taps = [*self._taps, tap][-16:]  # so many are remembered
        return replace(event, sample=impact, end=tap.end)

    def before(self, onset: int) -> Tapped | None:
        """Return what is kept of the taps before a movement; None without any at hand."""
        taps = [tap for tap in self._taps if self._ring.start <= tap.start and tap.end <= onset]
        return self._kept(taps) if taps else None

    def last(self) -> tuple[Tapped, int]:
        """Return the last tap by itself, and the sample at which what is kept of it begins."""
        return self._kept(self._taps[-1:]), self._start(self._taps[-1])

    def _kept(self, taps: list[Tap]) -> Tapped:
        first = self._start(taps[0])
        samples = self._ring.view(first, taps[-1].end).copy()
        return samples, tuple(
            replace(t, start=t.start - first, impact=t.impact - first, end=t.end - first) for t in taps
        )

    def _start(self, tap: Tap) -> int:
        # 0.1 s of rest before a tap give the noise.
        return max(self._ring.start, tap.start - round(0.1 * self._level.fs))
