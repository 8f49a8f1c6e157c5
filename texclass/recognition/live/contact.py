"""Online detection of contacts, strokes, taps and lift-offs.

`LevelMeter` measures the power of the vibration bin by bin. `ContactDetector` compares it with the noise
floor, with hysteresis, and finds the time spans with activity. The segmentation of recordings
(`texclass.phases.split_taps_and_movement`) then decides whether an activity is a movement or taps.
`TapMemory` stores the taps, because some models use them together with the movement that follows.
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

TapSamples = tuple[Samples, tuple[Tap, ...]]
"""Samples that contain taps, and the taps; their indices count from the first of these samples."""
Kind = Literal["contact", "stroke", "tap", "lift-off", "break"]
_ROUNDING_RATIO = 1e-14
"""Power below this fraction of the largest power is rounding error of the filter."""
_MIN_POWER = 1e-300
"""Replaces a power of 0, to avoid a division by zero."""


@dataclass(frozen=True)
class SteadyNoise:
    """Thresholds that separate a steady noise from a stroke.

    Attributes
    ----------
    n_blocks
        Number of blocks over which the level must be steady.
    max_ratio
        Largest ratio of the highest to the lowest power of these blocks. In 800 windows of 4 s, strokes of a
        robot had a ratio of at least 1.32. Hum has a ratio of 1.1. White noise has a ratio of 1.1 at 10 kHz,
        and of 1.2 to 1.4 at 1 kHz.
    min_samples
        Smallest number of samples in a block. The power of shorter blocks fluctuates too much.
    max_correlation
        Largest magnitude of the lag-1 autocorrelation at which a signal counts as white noise. A steady
        signal at the start of the stream counts as rest if it is white, in any unit.
    """

    n_blocks: int = 16
    max_ratio: float = 1.3
    min_samples: int = 250
    max_correlation: float = 0.25


STEADY = SteadyNoise()


class Ring:
    """Ring buffer of the last rows of a stream, of which any range is available as a contiguous view.

    Rows are numbered from the first row of the stream. The memory holds twice `capacity` rows; when it is
    full, the last `capacity` rows are moved to its front.

    Parameters
    ----------
    capacity : int
        Number of rows in the buffer.
    n_columns : int
        Number of columns.

    Examples
    --------
    >>> ring = Ring(capacity=3, n_columns=1)
    >>> ring.push(np.array([[0.0], [1.0]]))
    >>> ring.push(np.array([[2.0], [3.0]]))
    >>> ring.start, ring.stop
    (1, 4)
    >>> ring.view(2, 4).ravel()
    array([2., 3.])
    """

    def __init__(self, capacity: int, n_columns: int) -> None:
        self.capacity = capacity
        self._rows = np.zeros((2 * capacity, n_columns))
        self._front = 0
        """Number of the row at the front of the memory."""
        self.start = self.stop = 0
        """The buffer contains the rows [start, stop)."""

    def push(self, rows: Samples) -> None:
        """Append rows of shape (n, n_columns), with n <= capacity, and drop the oldest rows."""
        if self.stop + len(rows) - self._front > len(self._rows):
            self._rows[: self.stop - self.start] = self.view(self.start, self.stop)
            self._front = self.start
        offset = self.stop - self._front
        self._rows[offset : offset + len(rows)] = rows
        self.stop += len(rows)
        self.start = max(self.start, self.stop - self.capacity)

    def skip(self, n: int) -> None:
        """Skip `n` missing rows and drop all earlier ones."""
        self._front = self.start = self.stop = self.stop + n

    def view(self, start: int, stop: int) -> Samples:
        """Return rows [start, stop) as a view of shape (stop - start, n_columns), valid until the next push.

        Raises
        ------
        ValueError
            If the buffer does not contain all of these rows.
        """
        if not self.start <= start <= stop <= self.stop:
            raise ValueError(
                f"start and stop must be within [{self.start}, {self.stop}] (the rows in the buffer), "
                f"got {start} and {stop}"
            )
        return self._rows[start - self._front : stop - self._front]

    @property
    def n_bytes(self) -> int:
        """Size of the buffer in bytes."""
        return self._rows.nbytes


class LevelMeter:
    """Meter for the power of the vibration in bins of about 5 ms.

    The power is the mean square after a causal high-pass filter, summed over all axes. The result does not
    depend on the block size: the filter keeps its state between blocks, and bins are counted from the first
    sample of the stream, or from the first sample after a break.

    Parameters
    ----------
    fs : float
        Sampling rate in Hz.
    n_axes : int
        Number of axes of the acceleration.
    memory_s : float
        Duration of the vibration that is kept in memory, in seconds.

    Attributes
    ----------
    fs : float
        Sampling rate in Hz.
    bin_size : int
        Number of samples in a bin.
    vibration : Ring
        High-pass filtered acceleration, shape (n, n_axes).
    high_pass : ndarray of shape (n_sections, 6)
        Second-order sections of the high-pass filter.

    Examples
    --------
    >>> meter = LevelMeter(fs=4000, n_axes=1, memory_s=1.0)
    >>> noise = np.random.default_rng(0).standard_normal((40, 1))
    >>> [(stop, round(power, 2)) for stop, power in meter.push(noise)]
    [(20, 0.71), (40, 0.45)]
    """

    def __init__(self, fs: float, n_axes: int, memory_s: float) -> None:
        self.fs = fs
        # Bins of 5 ms resolve the pauses between strokes (60 ms and more).
        self.bin_size = max(MIN_LEVEL_SAMPLES, round(0.005 * fs))
        self.vibration = Ring(round(memory_s * fs) + 4 * self.bin_size, n_axes)
        # Hand motion, tremor and gravity are below 60 Hz, as in `texclass.phases`.
        self.high_pass = butterworth("highpass", min(60.0, 0.2 * fs), fs)
        self._state: Samples | None = None

    def push(self, rows: Samples) -> Iterable[tuple[int, float]]:
        """Filter samples, and return the end and the power of each bin.

        The samples (n, n_axes) must be finite, and n a multiple of `bin_size`. If all samples of a bin are
        equal, its power is 0, because padding contains no information about the noise.
        """
        if not len(rows):
            return []
        # The filter starts in its steady state for the first sample, so that gravity causes no transient.
        filtered, self._state = causal(self.high_pass, rows, self._state)
        start, size = self.vibration.stop, self.bin_size
        self.vibration.push(filtered)
        # `reduceat` sums each bin separately, so that rounding does not depend on the number of bins.
        powers = np.add.reduceat(self.power(start, self.vibration.stop), range(0, len(rows), size))
        bins = rows.reshape(-1, size, rows.shape[1])
        sums = np.where(np.ptp(bins, axis=1).any(axis=1), powers, 0.0).tolist()  # held values are padding
        return zip(range(start + size, self.vibration.stop + 1, size), (s / size for s in sums), strict=True)

    def power(self, start: int, stop: int) -> Samples:
        """Return the squared vibration of samples [start, stop), summed over the axes."""
        vibration = self.vibration.view(start, stop)
        return np.asarray(np.einsum("ij,ij->i", vibration, vibration))

    def fine_powers(self, start: int, stop: int) -> tuple[int, int, Samples]:
        """Return the powers of samples [start, stop) in bins of about 1 ms.

        Returns
        -------
        start : int
            First sample of the first bin; later than the argument if earlier samples are no longer in memory.
        size : int
            Number of samples in a bin.
        powers : ndarray of shape (n_bins,)
            Power of each bin.
        """
        start, size = max(start, self.vibration.start), max(1, round(0.001 * self.fs))
        return start, size, bin_means(self.power(start, stop), size)

    def correlation(self, start: int, stop: int) -> float:
        """Return the lag-1 autocorrelation of samples [start, stop), which is about 0 for white noise."""
        v = self.vibration.view(start, stop)
        power = float((v**2).sum())
        return float((v[1:] * v[:-1]).sum()) / power if power > 0 else 0.0

    def skip(self, n: int) -> None:
        """Skip `n` missing samples and reset the filter."""
        self.vibration.skip(n)
        self._state = None


@dataclass(frozen=True)
class Event:
    """Event of a stream: contact, stroke, tap, lift-off or break.

    Attributes
    ----------
    kind
        "contact" (start of a movement), "stroke" (the movement continues after a turning point), "tap",
        "lift-off" or "break" (missing samples).
    sample
        Index of the sample at which the event occurs. For a tap, this is the impact; for a lift-off, it is
        one past the last sample with vibration.
    n_received
        Number of samples received when the event was detected.
    end
        For a tap, the index one past the end of its decay; otherwise equal to `sample`.
    message
        Reason for the event in words, or "".
    width, quality
        Width and quality of a tap; see `texclass.recording.Tap`.

    Examples
    --------
    >>> event = Event("tap", sample=1180, n_received=1400, end=1250, width=24)
    >>> event.n_received - event.sample  # delay of the detection in samples
    220
    """

    kind: Kind
    sample: int
    n_received: int
    end: int
    message: str = ""
    width: int = 0
    quality: float = 1.0


@dataclass(frozen=True, kw_only=True)
class ContactSettings(PhaseSettings):
    """Settings of contact detection in a stream, in addition to the settings of segmentation.

    Durations are in seconds, and ratios compare powers.

    Attributes
    ----------
    quiet_s
        Duration at the start of the stream whose mean power is the first noise floor.
    off_ratio
        Ratio to the noise floor below which an activity ends (it begins above `active_ratio`).
    smooth_s
        Length of the averaging window of the level.
    turn_s
        Duration of a pause that ends a stroke.
    pause_s
        Duration of a pause that counts as a lift-off.
    floor_s
        Time constant with which the noise floor follows the level at rest.
    drop_ratio
        Ratio by which the level must drop to count as a lift-off, if the stream starts in contact.
    block_s
        Length of a block. A level that is steady for 16 blocks counts as noise, not as a stroke.

    Examples
    --------
    >>> ContactSettings(pause_s=1.0, tap_spacing_s=0.05).pause_s
    1.0
    """

    quiet_s: float = 0.1
    off_ratio: float = 1.6
    smooth_s: float = 0.015
    turn_s: float = 0.06
    pause_s: float = 0.5
    floor_s: float = 2.0
    drop_ratio: float = 1000.0
    block_s: float = 0.25


class ContactDetector:
    """State machine that detects contacts, strokes, taps and lift-offs from the power of each bin.

    The table in docs/stream-logic.md defines the states and transitions; the names of its states are
    attributes of this class.

    Parameters
    ----------
    meter : LevelMeter
        Source of the powers.
    settings : ContactSettings
        Thresholds and durations.
    in_contact : bool, optional
        Whether the stream starts during a movement. By default, this is detected from the first `quiet_s` of
        the stream, which count as rest if their level is steady, and they are below 6 mg or white noise.
    unit : str
        Unit of the acceleration.

    Attributes
    ----------
    is_moving : bool
        Whether the tool slides over the surface.
    onset : int
        First sample of the movement.
    active_stop : int
        Index one past the last sample with vibration.
    floor : float
        Noise floor (power at rest); 0 while it is unknown.
    level : float
        Mean power over the last `smooth_s`.
    tap_impulses : list of Impulse
        Taps since the last lift-off.

    Examples
    --------
    >>> meter = LevelMeter(fs=4000, n_axes=1, memory_s=2.0)
    >>> detector = ContactDetector(meter, ContactSettings(), in_contact=False, unit="m/s^2")
    >>> noise = np.random.default_rng(0).standard_normal((4000, 1))
    >>> noise[:800] *= 0.01  # 0.2 s of rest, then a stroke
    >>> [(event.kind, event.sample) for bin in meter.push(noise) for event in detector.step(*bin)]
    [('contact', 780)]
    """

    def __init__(
        self, meter: LevelMeter, settings: ContactSettings, in_contact: bool | None, unit: str
    ) -> None:
        self.settings, self.unit, self._meter = settings, unit, meter
        bin_s = meter.bin_size / meter.fs
        self._n = {
            name: max(1, round(getattr(settings, f"{name}_s") / bin_s))
            for name in ("quiet", "smooth", "window", "gap", "turn", "pause")
        }
        """Durations as numbers of bins."""
        self._n["block"] = max(round(settings.block_s / bin_s), -(-STEADY.min_samples // meter.bin_size))
        self._floor_weight = 1 - math.exp(-bin_s / settings.floor_s)
        """Weight of a new bin in the exponential average of the noise floor."""
        self._in_contact = in_contact
        self.is_moving, self.onset, self.active_stop = bool(in_contact), 0, 0
        self.floor = 0.0
        self.level = 0.0
        self._peak_power = 0.0
        self._initial_level = 0.0
        """Level of the contact in which the stream started; 0 once the noise floor is known."""
        self._opening_powers: list[float] = []
        """Powers of the first bins, until the noise floor can be estimated."""
        self._recent_powers: deque[float] = deque(maxlen=self._n["smooth"])
        self._activity_flags: deque[bool] = deque(maxlen=self._n["window"])
        self._block_powers: list[float] = []
        self._block_means: deque[float] = deque(maxlen=STEADY.n_blocks)
        self._is_active, self._n_quiet = False, 0
        self._last_tap_end, self._last_tap_peak = 0, -math.inf
        self.tap_impulses: list[Impulse] = []
        self._activity: list[int] = []
        """Start and end of the current activity; empty if there is none, or if it became a movement."""

    @property
    def constants(self) -> dict[str, Any]:
        """Constants used in the table of docs/stream-logic.md, for implementations in other languages."""
        names = ("active_ratio", "off_ratio", "share", "drop_ratio", "pause_s")
        return {
            "bin_samples": self._meter.bin_size,
            "n_bins": dict(self._n),
            **{name: getattr(self.settings, name) for name in names},
            "floor_weight": self._floor_weight,
            "rounding_ratio": _ROUNDING_RATIO,
            "min_power": _MIN_POWER,
            "rest_power": AT_REST_M_S2**2 if self.unit == "m/s^2" else 0.0,
            "white_correlation": STEADY.max_correlation,
            "in_contact": self._in_contact,
            "steady_blocks": STEADY.n_blocks,
            "steady_ratio": STEADY.max_ratio,
        }

    @property
    def phase(self) -> Literal["starting", "rest", "active", "moving", "pause"]:
        """Current state; "active" means vibration that is not yet classified as a movement or taps."""
        if self.is_moving:
            return "moving" if self._n_quiet <= self._n["turn"] else "pause"
        if self._opening_powers or not self.floor:
            return "starting"
        return "active" if self._activity else "rest"

    @property
    def level_db(self) -> float:
        """Level above the noise floor in dB; 0 while the noise floor is unknown."""
        floor = self._effective_floor()
        return 10 * math.log10(max(self.level, _MIN_POWER) / floor) if floor > 0 and self.floor > 0 else 0.0

    def step(self, stop: int, power: float) -> list[Event]:
        """Process the bin that ends at sample `stop` and return the events that it completes.

        Parameters
        ----------
        stop : int
            One past the last sample of the bin.
        power : float
            Power of the bin, as returned by `LevelMeter.push`.

        Returns
        -------
        events : list of Event
            Events in chronological order; usually none.
        """
        self._recent_powers.append(power)
        self.level = sum(self._recent_powers) / len(self._recent_powers)
        self._peak_power = max(self._peak_power, power)
        if self.floor == 0.0 and not self._initial_level:
            return self._measure_opening(stop, power) if power > 0 or self._in_contact else []
        if self._initial_level:
            events = self._follow_initial_contact(stop)
        else:
            events = self._compare_with_floor(stop, power)
        return events + self._detect_steady_noise(stop, power)

    def interrupt(self, sample: int, n_missing: int, missing_s: float) -> list[Event]:
        """Skip missing samples; a break longer than `pause_s` is a lift-off.

        Parameters
        ----------
        sample : int
            First missing sample.
        n_missing : int
            Number of missing samples.
        missing_s : float
            Duration of the break in seconds.
        """
        events = [Event("break", sample, sample, sample, f"{n_missing} samples missing")]
        self._recent_powers.clear()
        self._clear_activity()
        self._is_active, self._opening_powers = False, []
        if self.is_moving and missing_s > self.settings.pause_s:
            events += self._end_contact(sample)
            self.is_moving = bool(self._initial_level)
        self.onset = self.active_stop = sample + n_missing
        if self.is_moving and len(events) > 1:
            events.append(
                Event("contact", self.onset, self.onset, self.onset, "assumed to continue after the break")
            )
        return events

    def _measure_opening(self, stop: int, power: float) -> list[Event]:
        """Collect the first bins, then decide whether they are rest (the noise floor) or contact."""
        events = []
        if not self._opening_powers:
            self.onset = stop - self._meter.bin_size
            if self._in_contact:
                events = [Event("contact", self.onset, stop, self.onset, "the stream starts in contact")]
        self._opening_powers.append(power)
        self.active_stop = stop
        if len(self._opening_powers) < self._n["quiet"]:
            return events
        mean = math.fsum(self._opening_powers) / len(self._opening_powers)
        in_contact = self._in_contact
        if in_contact is None:
            is_steady = max(self._opening_powers) <= 10 * mean
            is_weak = self.unit == "m/s^2" and mean < AT_REST_M_S2**2
            is_white = abs(self._meter.correlation(self.onset, stop)) <= STEADY.max_correlation
            in_contact = mean > 0 and not (is_steady and (is_weak or is_white))
        if in_contact:
            if not self.is_moving:
                message = "no rest at the start: assumed to be in contact"
                events = [Event("contact", self.onset, stop, self.onset, message)]
            self.is_moving, self._initial_level = True, mean or _MIN_POWER
        else:
            self.floor = mean or _MIN_POWER
        self._opening_powers = []
        return events

    def _follow_initial_contact(self, stop: int) -> list[Event]:
        """Follow a contact without a known noise floor; it ends when its level drops by `drop_ratio`."""
        level = max(self.level, _MIN_POWER)
        if self.level * self.settings.drop_ratio >= self._initial_level:
            ratio = level / self._initial_level
            self._initial_level = max(self._initial_level, _MIN_POWER) * ratio**self._floor_weight
            self._n_quiet, self.active_stop = 0, stop
            return []
        self._n_quiet += 1
        if self._n_quiet < self._n["pause"]:
            return []
        self.floor, self._initial_level = level, 0.0
        return self._end_contact(stop)

    def _compare_with_floor(self, stop: int, power: float) -> list[Event]:
        """Update activity and noise floor, and detect the start and end of a movement."""
        settings, n, start = self.settings, self._n, stop - self._meter.bin_size
        ratio = settings.off_ratio if self._is_active else settings.active_ratio
        self._is_active = self.level > ratio * self._effective_floor()
        self._activity_flags.append(self._is_active)
        events: list[Event] = []
        if self._is_active:
            if self.is_moving and self._n_quiet >= n["turn"]:
                events.append(Event("stroke", start, stop, start))
            self._n_quiet, self.active_stop = 0, stop
            self._activity = [self._activity[0] if self._activity else start, stop]
        else:
            self._n_quiet += 1
            if not self._activity and power > 0:
                self.floor += self._floor_weight * (power - self.floor)
        if self.is_moving:
            return events + (self._end_contact(stop) if self._n_quiet >= n["pause"] else [])
        if self._activity and self._n_quiet >= n["gap"]:
            events += self._classify_activity(stop, is_over=True)
            self._activity = []
        elif self._activity and sum(self._activity_flags) >= settings.share * n["window"]:
            events += self._classify_activity(stop, is_over=False)
        return events

    def _detect_steady_noise(self, stop: int, power: float) -> list[Event]:
        """End a contact whose level stays constant, and use this level as the new noise floor.

        A contact that the user declared with `in_contact` never ends in this way.
        """
        if self._in_contact or power == 0 or not self.is_moving:
            self._block_powers.clear()
            self._block_means.clear()
            return []
        self._block_powers.append(power)
        if len(self._block_powers) < self._n["block"]:
            return []
        means = self._block_means
        means.append(math.fsum(self._block_powers) / len(self._block_powers))
        self._block_powers.clear()
        if len(means) < STEADY.n_blocks or max(means) > STEADY.max_ratio * min(means):
            return []
        self.floor, self._initial_level = math.fsum(means) / len(means), 0.0
        means.clear()
        seconds = STEADY.n_blocks * self._n["block"] * self._meter.bin_size / self._meter.fs
        return self._end_contact(stop, f"constant level for {seconds:.3g} s, used as the new noise floor")

    def _classify_activity(self, n_received: int, *, is_over: bool) -> list[Event]:
        """Return the taps of an activity that is over, or the taps and the onset if it is a movement."""
        settings, meter = self.settings, self._meter
        margin = round(2 * settings.look_back_s * meter.fs)
        start, size, powers = meter.fine_powers(self._activity[0] - margin, n_received)
        ratio = powers / self._effective_floor()
        levels = Levels(ratio, ratio, ratio, size / meter.fs, -(-MIN_LEVEL_SAMPLES // size))
        impulses = find_impulses(levels, settings)
        taps, span = (impulses, None) if is_over else split_taps_and_movement(levels, impulses, settings)
        if not is_over and span is None:
            return []
        events = []
        spacing = settings.tap_spacing_s * meter.fs
        for tap in taps:
            first, peak = start + tap.start * size, start + tap.peak * size
            is_apart = first >= self._last_tap_end and peak - self._last_tap_peak >= spacing
            if is_apart and tap in select_taps([*self.tap_impulses, tap], levels, settings):
                self.tap_impulses.append(tap)
                self._last_tap_peak, self._last_tap_end = peak, start + tap.end * size
                width = tap.width * size
                events.append(Event("tap", first, n_received, self._last_tap_end, "", width, tap.quality))
        if span is not None:
            self.is_moving, self.onset, self._activity = True, start + span[0] * size, []
            events.append(Event("contact", self.onset, n_received, self.onset))
        return events

    def _end_contact(self, n_received: int, message: str = "") -> list[Event]:
        self.is_moving = False
        self._clear_activity()
        return [Event("lift-off", self.active_stop, n_received, self.active_stop, message)]

    def _clear_activity(self) -> None:
        self._activity, self.tap_impulses = [], []
        self._activity_flags.clear()
        self._block_powers.clear()
        self._block_means.clear()

    def _effective_floor(self) -> float:
        return max(self.floor, _ROUNDING_RATIO * self._peak_power, _MIN_POWER)


class TapMemory:
    """Memory of the taps since the last lift-off, with impacts that are located to the sample.

    Parameters
    ----------
    ring : Ring
        Samples of the stream; the first columns are the axes of the acceleration.
    n_axes : int
        Number of axes.
    meter : LevelMeter
        Vibration of the stream.
    hand_s : float
        Longest duration of the hand's acceleration before an impact, in seconds.
    """

    def __init__(self, ring: Ring, n_axes: int, meter: LevelMeter, hand_s: float) -> None:
        self._ring, self._n_axes, self._meter, self._hand_s = ring, n_axes, meter, hand_s
        self.clear()

    def clear(self) -> None:
        """Delete all taps, after a lift-off or a break."""
        self._taps: list[Tap] = []

    def add(self, event: Event, floor: float) -> Event | None:
        """Store a tap and return its event with the exact impact; return None for a single-sample glitch.

        Parameters
        ----------
        event : Event
            Tap event of a `ContactDetector`.
        floor : float
            Power of the noise floor.
        """
        fs, last_end = self._meter.fs, self._taps[-1].end if self._taps else 0
        # The impact is at most 3 ms before the start of the impulse.
        start = max(self._meter.vibration.start, event.sample - round(0.003 * fs))
        stop = max(start + 1, event.sample + event.width)
        offset = find_impact(self._meter.power(start, stop), floor)
        impact = event.sample if offset is None else start + offset
        earliest = max(self._ring.start, last_end, impact - round(self._hand_s * fs))
        axes = self._ring.view(earliest, event.end)[:, : self._n_axes]
        glitches = find_glitches(axes)
        if ((glitches >= start - earliest) & (glitches < stop - earliest)).any():
            return None
        approach = interpolate_glitches(axes, glitches)[: max(0, impact - earliest)]
        hand_onset = min(impact, earliest + find_hand_start(approach, fs))
        tap = Tap(hand_onset, impact, max(event.end, impact + 1), event.width, event.quality)
        self._taps = [*self._taps, tap][-16:]  # 16 taps bound the memory
        return replace(event, sample=impact, end=tap.end)

    def taps_until(self, onset: int) -> TapSamples | None:
        """Return the taps in memory before the onset of a movement, or None if there are none."""
        taps = [tap for tap in self._taps if self._ring.start <= tap.start and tap.end <= onset]
        return self._extract(taps) if taps else None

    def last_tap(self) -> tuple[TapSamples, int]:
        """Return the last tap alone, and the index of its first sample in the stream."""
        return self._extract(self._taps[-1:]), self._first_sample(self._taps[-1])

    def _extract(self, taps: list[Tap]) -> TapSamples:
        first = self._first_sample(taps[0])
        samples = self._ring.view(first, taps[-1].end).copy()
        return samples, tuple(
            replace(t, start=t.start - first, impact=t.impact - first, end=t.end - first) for t in taps
        )

    def _first_sample(self, tap: Tap) -> int:
        # Features estimate the noise from 0.1 s of rest before a tap.
        return max(self._ring.start, tap.start - round(0.1 * self._meter.fs))
