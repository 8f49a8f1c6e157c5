"""Recording -> phases: taps (hand acceleration, impact, decay), static-friction onset, movement."""

from dataclasses import dataclass

import numpy as np

from texclass.phases.strikes import Strike, find_strikes, follow_hand, impact_sample, lone_tap, only_taps
from texclass.phases.vibration_track import Track, sustained_span, track
from texclass.recording import Phases, Recording, Tap

AT_REST_M_S2 = 0.06
"""A steady acceleration below this (rms of all axes, about 6 mg) is that of a resting sensor."""
_OPENING_S = 0.03
"""An impulse that begins this early has no hand's acceleration before it; twice as long, it is a stroke."""
_NOTHING = "neither taps nor movement: nothing stands out of the noise"
_NEVER_QUIET = "no quiet stretch, so the noise is unknown: the whole recording is taken as movement"
_LONE_TAP = "too short for a stroke, at rest before or after: taken as one tap; the hand's part is unknown"
_STARTS_MOVING = "the recording starts in movement: no onset of sliding"


@dataclass(frozen=True, kw_only=True)
class Segmenter:
    """How phases are found; the defaults suit a hand-held tool. Durations in seconds, ratios of power.

    Attributes
    ----------
    hand_hz
        Motion below this frequency (Hz) belongs to hand, tremor and gravity, not to the contact.
    bin_s
        Resolution of the search.
    quiet_s
        The quietest stretch of this length gives the noise floor.
    movement_ratio
        Vibration stands this far above the noise floor.
    tap_ratio
        A tap's peak stands this far above it.
    tap_range_db, tap_sure_db
        The weakest tap against the strongest one; and down to where no other evidence is asked for.
    tap_spacing_s
        Impulses closer than this are one tap and its rebounds.
    hand_s
        Longest acceleration of the hand before an impact.
    window_s, share
        The tool strokes where at least this share of a window vibrates; a tap leaves most of it quiet.
    pause_s
        Longest pause at which a movement still reaches to the end of the recording.
    """

    hand_hz: float = 60.0
    bin_s: float = 0.001
    quiet_s: float = 0.1
    movement_ratio: float = 2.0
    tap_ratio: float = 40.0
    tap_range_db: float = 22.0
    tap_sure_db: float = 12.0
    tap_spacing_s: float = 0.08
    hand_s: float = 0.25
    window_s: float = 0.3
    share: float = 0.65
    pause_s: float = 1.0

    def __call__(self, recording: Recording) -> Phases:
        """Return the phases of `recording`; those it declares are returned as they are."""
        if recording.phases is not None:
            return recording.phases
        if recording.duration_s < self.window_s:
            return _short(recording)
        found = track(recording, hand_hz=self.hand_hz, bin_s=self.bin_s, quiet_s=self.quiet_s)
        span = sustained_span(
            found, ratio=self.movement_ratio, window_s=self.window_s, share=self.share, gap_s=0.03
        )
        strikes = self._strikes(recording, found, span)
        opening = [strike for strike in strikes if strike.impact < found.n_bins(_OPENING_S)]
        strikes = strikes[len(opening) :]  # cut off by the start of the recording: no tap to measure
        if span is not None:
            pause = found.n_bins(self.pause_s)
            opens_with_vibration = opening and opening[0].end > 2 * found.n_bins(_OPENING_S)
            if opens_with_vibration and span[0] <= pause:  # both are one movement
                span, strikes = (0, span[1]), [s for s in strikes if s.impact >= span[1]]
            span, strikes = _absorb_after(span, strikes, pause)
        taps = self._taps(recording, found, strikes)
        if span is not None and (found.steady or taps):
            first, last = (min(edge * found.bin_samples, recording.n_samples) for edge in span)
            taps_follow = any(strike.impact >= span[1] for strike in strikes)
            if recording.n_samples - last < self.pause_s * recording.fs and not taps_follow:
                last = recording.n_samples
            movement = (first, last)
            return Phases(taps, movement, movement[0] or None, () if movement[0] else (_STARTS_MOVING,))
        if span is None and (taps or _at_rest(recording, found)):
            return Phases(taps, notes=() if taps else (_NOTHING,))
        return Phases((), (0, recording.n_samples), None, (_NEVER_QUIET,))

    def _strikes(self, recording: Recording, found: Track, span: tuple[int, int] | None) -> list[Strike]:
        n_bins = len(found.ratio)
        strikes: list[Strike] = []
        for first, last in [(0, n_bins)] if span is None else [(0, span[0]), (span[1], n_bins)]:
            strikes += find_strikes(
                found,
                first,
                last,
                ratio=self.tap_ratio,
                end_ratio=self.movement_ratio,
                spacing_s=self.tap_spacing_s,
            )
        hand = follow_hand(recording)
        return only_taps(strikes, hand, found, range_db=self.tap_range_db, sure_db=self.tap_sure_db)

    def _taps(self, recording: Recording, found: Track, strikes: list[Strike]) -> tuple[Tap, ...]:
        if not strikes:
            return ()
        hand = follow_hand(recording)
        taps, free_from = [], 0
        for strike in strikes:
            impact = impact_sample(found, strike)
            end = max(impact + 1, min(strike.end * found.bin_samples, recording.n_samples))
            earliest = max(free_from, impact - round(self.hand_s * recording.fs))
            taps.append(Tap(hand.start(earliest, impact), impact, end))
            free_from = end
        return tuple(taps)


def segment(recording: Recording) -> Phases:
    """Find taps, static-friction onset and movement of a recording.

    Gravity, tremor and the hand's motion are filtered away; what is left is compared, millisecond by
    millisecond, with the noise of the quietest stretch. Where it stays above the noise the tool strokes; an
    isolated impulse is a tap, unless it is weak and goes the way the hand was accelerating (a tool that is
    lifted).

    Parameters
    ----------
    recording : Recording
        Any number of axes, any unit, rates from about 1 kHz; declared phases are returned untouched.

    Returns
    -------
    Phases
        Half-open ranges of samples. A tap starts where the hand starts to accelerate and ends when its
        vibration is down in the noise or 30 dB below its peak. The movement reaches from the onset of sliding
        to the last vibration (to the end of the recording, if less than a pause remains), pauses at turning
        points included. `notes` say what is missing or was assumed: no quiet stretch, a start in the
        middle of a movement, nothing at all.

    See Also
    --------
    Segmenter : The same with other thresholds and durations.

    Notes
    -----
    `strese2015` names the phases (Figs. 4 and 7) and gives no algorithm; this one is ours. Its cost is
    linear in the length of the recording.
    """
    return Segmenter()(recording)


def _absorb_after(
    span: tuple[int, int], strikes: list[Strike], pause: int
) -> tuple[tuple[int, int], list[Strike]]:
    """Give the movement what follows it within a pause: strokes that had been too faint, not taps."""
    first, last = span
    taps = []
    for strike in strikes:
        if first <= strike.impact < last + pause:
            last = max(last, strike.end)
        else:
            taps.append(strike)
    return (first, last), taps


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
