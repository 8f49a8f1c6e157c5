"""Recording -> phases: taps (hand acceleration, impact, decay), static-friction onset, movement."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from texclass.phases.hand import hand_start, lone_tap
from texclass.phases.impulses import Impulse, Rules, divide, find_impulses, mean_over, only_taps, without
from texclass.phases.vibration_track import Track, track
from texclass.recording import Phases, Recording, Samples, Tap

Holds = Literal["taps and strokes", "taps"]
AT_REST_M_S2 = 0.06
"""A steady acceleration below this (rms of all axes, about 6 mg) is that of a resting sensor."""
_OPENING_S = 0.03
"""An impulse that begins this early has no hand's acceleration before it; twice as long, it is a stroke."""
CLEAR = 20.0
"""Ratio to its mean that a single sample of noise does not reach."""
FAINT_STROKES = 30.0
"""Ratio to the noise that faint strokes nowhere reach as a mean over 0.1 s."""
SURE_DB, FEW = 20.0, 3
"""Fewer impulses, none so strong, may be those of faint strokes."""
_KINK_S = 0.01
"""So near to a kink of gravity the filter still answers to it."""
_MARGIN_S = 0.003
"""Of where the sample of an impact is looked for."""
_NO_TAPS = "no taps: nothing stands out of the noise sharply enough"
_NOTHING = "neither taps nor movement: nothing stands out of the noise"
_NEVER_QUIET = "no quiet stretch, so the noise is unknown: the whole recording is taken as movement"
_LONE_TAP = "too short for a stroke, at rest before or after: taken as one tap; the hand's part is unknown"
_STARTS_MOVING = "the recording starts in movement: no onset of sliding"


MOST_SQUARED = 1e100
"""Larger accelerations are scaled down first: their squares would overflow."""


@dataclass(frozen=True, kw_only=True)
class Segmenter(Rules):
    """How phases are found; the defaults suit a hand-held tool. Durations in seconds.

    Attributes
    ----------
    hand_hz
        Motion below this frequency (Hz) belongs to hand, tremor and gravity, not to the contact.
    bin_s
        Resolution of the search.
    quiet_s
        The quietest stretch of this length gives the noise floor.
    hand_s
        Longest acceleration of the hand before an impact.
    rest_s
        A rest at the end that is shorter is a turning point of the movement.
    holds
        What there is to be found: "taps and strokes", or "taps" alone, as many as there are.
    """

    hand_hz: float = 60.0
    bin_s: float = 0.001
    quiet_s: float = 0.1
    hand_s: float = 0.25
    rest_s: float = 0.3
    holds: Holds = "taps and strokes"

    def __call__(self, recording: Recording) -> Phases:
        """Return the phases of `recording`; those it declares are returned as they are."""
        if recording.phases is not None:
            return recording.phases
        peak = max(abs(float(recording.acceleration.min())), abs(float(recording.acceleration.max())))
        if peak > MOST_SQUARED:  # levels are relative
            recording = recording.with_(acceleration=recording.acceleration / peak)
        if recording.duration_s < self.window_s:
            return _short(recording)
        found = track(recording, hand_hz=self.hand_hz, bin_s=self.bin_s, quiet_s=self.quiet_s)
        impulses, opening = self._impulses(found)
        if self.holds == "taps":
            taps = self._taps(recording, found, only_taps(impulses, found.levels, self))
            return Phases(taps, notes=() if taps else (_NO_TAPS,))
        begins = found.data[0] if self._opens_in_movement(found, opening) else None
        struck, span = divide(found.levels, impulses, self, begins)
        if span is not None and len(struck) < FEW and self._is_faint(found, (0, span[1])):
            struck = [] if max((i.loud_db for i in struck), default=0.0) < SURE_DB else struck
        taps = self._taps(recording, found, struck)
        if span is None:
            if taps or _at_rest(recording, found):
                return Phases(taps, notes=() if taps else (_NOTHING,))
        elif found.steady or taps:
            movement = self._movement(recording, found, span, struck)
            return Phases(taps, movement, movement[0] or None, () if movement[0] else (_STARTS_MOVING,))
        return Phases((), (0, recording.n_samples), None, (_NEVER_QUIET,))

    def _impulses(self, found: Track) -> tuple[list[Impulse], list[Impulse]]:
        """Return impulses but those at an edge of the data, and those with which the data begin.

        What is cut off by the start of the data cannot be measured, and the kink with which a fade of
        gravity begins or ends is no impact.
        """
        levels, (first, _), (up, down) = found.levels, found.data, found.full
        opening = first + levels.n_bins(_OPENING_S)
        impulses = find_impulses(levels, self)
        cut_off = [i for i in impulses if i.start < opening]
        kinks = up + (up - first) + levels.n_bins(_KINK_S), down - levels.n_bins(_KINK_S)
        kept = [
            i
            for i in impulses[len(cut_off) :]
            if i.loud_db >= self.clear_db
            or (kinks[0] if up > first else 0)
            <= i.start
            < (kinks[1] if down < found.data[1] else i.start + 1)
        ]
        return kept, cut_off

    def _opens_in_movement(self, found: Track, opening: list[Impulse]) -> bool:
        """Whether the data begin with vibration, what impulses leave not counted."""
        levels, first = found.levels, found.data[0]
        stop = first + levels.n_bins(2 * _OPENING_S)
        begin = without(levels.strokes[:stop], opening, 0.0)[first:]
        return len(begin) > 0 and found.full[0] == first and float(begin.mean()) > self.active_ratio

    def _is_faint(self, found: Track, span: tuple[int, int]) -> bool:
        """Whether vibration hardly leaves the noise."""
        level = mean_over(found.levels.strokes, found.levels.n_bins(self.quiet_s))[slice(*span)]
        return float(level.max()) < FAINT_STROKES

    def _movement(
        self, recording: Recording, found: Track, span: tuple[int, int], taps: list[Impulse]
    ) -> tuple[int, int]:
        """Return the movement in samples: to the end unless the tool rests there.

        Where strokes hardly leave the noise, a rest after them (and a short one before, if there are no taps)
        may be fainter strokes.
        """
        (first, last), n_bins = span, found.levels.n_bins
        is_faint = self._is_faint(found, span)
        if is_faint and not taps and first - found.data[0] < n_bins(self.rest_s):
            first = found.data[0]
        rest_s = self.pause_s if is_faint else self.rest_s
        if found.data[1] - last < n_bins(rest_s) and not (taps and taps[-1].start >= last):
            last = found.data[1]
        return first * found.bin_samples, min(last * found.bin_samples, recording.n_samples)

    def _taps(self, recording: Recording, found: Track, impulses: list[Impulse]) -> tuple[Tap, ...]:
        size, free_from, taps = found.bin_samples, found.data[0] * found.bin_samples, list[Tap]()
        for impulse in impulses:
            impact = self._impact(found, impulse)
            end = max(impact + 1, min(impulse.end * size, recording.n_samples))
            earliest = min(impact, max(free_from, impact - round(self.hand_s * recording.fs)))
            start = earliest + hand_start(found.samples(earliest, impact), recording.fs)
            taps.append(Tap(start, impact, end, impulse.width * size, impulse.quality))
            free_from = end
        return tuple(taps)

    def _impact(self, found: Track, impulse: Impulse) -> int:
        """Return the sample at which the vibration leaves the noise."""
        margin = found.levels.n_bins(_MARGIN_S)
        start = max(0, impulse.start - margin) * found.bin_size
        stop = (max(impulse.start + margin, impulse.peak) + margin) * found.bin_size
        near = found.vibration.between(start, stop)
        power = np.einsum("ij,ij->j", near, near)
        at = leaves_noise(power, found.noise)
        return impulse.start * found.bin_samples if at is None else (start + at) * found.step


def leaves_noise(power: Samples, noise: float) -> int | None:
    """Return the sample from which a power is no noise and within 25 dB of its peak; None if it hardly is."""
    peak = float(power.max())
    least = max(CLEAR * noise, 3e-3 * peak)
    return int(np.argmax(power >= least)) if peak >= 2.0 * least else None


def segment(recording: Recording, holds: Holds = "taps and strokes") -> Phases:
    """Find taps, static-friction onset and movement of a recording.

    Gravity, tremor and the hand's motion are filtered away; what is left is compared, millisecond by
    millisecond, with the noise at rest. What rises sharply, by 10 dB or more, out of what was just before and
    dies away is an impulse; where the level stays above the noise otherwise, the tool strokes. Impulses
    inside a movement are the texture's; the others are taps, unless they are far weaker than the strongest (a
    tool that is lifted). Values held at the ends of a file, a volume that is turned up or down, and single
    wild samples are no noise and no impulses.

    Parameters
    ----------
    recording : Recording
        Any number of axes, any unit, rates from about 1 kHz; declared phases are returned untouched.
    holds : {"taps and strokes", "taps"}
        What is known of it; "taps" finds any number of them, and nothing else, however long they ring.

    Returns
    -------
    Phases
        Half-open ranges of samples. A tap starts where the hand starts to accelerate and ends when its
        vibration is down in the noise or 30 dB below its peak; it has a width and a quality. The movement
        reaches from the onset of sliding to where the tool rests (to the end, if it rests for less than
        0.3 s), pauses at turning points included. `notes` say what is missing or was assumed: no quiet
        stretch, a start in the middle of a movement, nothing at all.

    See Also
    --------
    Segmenter : The same with other thresholds and durations.

    Notes
    -----
    `strese2015` names the phases (Figs. 4 and 7) and gives no algorithm; this one is ours. Its cost is
    linear in the length of the recording.
    """
    return (_DEFAULT if holds == _DEFAULT.holds else replace(_DEFAULT, holds=holds))(recording)


_DEFAULT = Segmenter()


def _short(recording: Recording) -> Phases:
    """Return the phases of a recording too short for a stroke to tell: one tap, or a piece of a movement."""
    tap = lone_tap(recording)
    if tap is not None:
        return Phases((tap,), notes=(_LONE_TAP,))
    if np.ptp(recording.acceleration, axis=0).max() == 0:
        return Phases(notes=(_NOTHING,))
    return Phases((), (0, recording.n_samples), None, (_NEVER_QUIET,))


def _at_rest(recording: Recording, found: Track) -> bool:
    """Whether a signal of steady level is noise: small for an acceleration, white in a unit without scale."""
    power = found.vibration.correlation(0)
    if recording.unit == "m/s^2":
        return power < AT_REST_M_S2**2
    return abs(found.vibration.correlation(1)) <= 0.25 * power
