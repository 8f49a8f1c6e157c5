"""Taps of a stream: which impulses are some, where they begin, and what is kept of them."""

import numpy as np

from texclass.phases import CLEAR, LEAST_PUSH, Segmenter
from texclass.recognition.online.contact import Event
from texclass.recognition.online.level import Level
from texclass.recognition.online.ring import Ring
from texclass.recognition.online.windows import Shape, Tapped
from texclass.recording import Tap

MOST = 16
"""Taps that are remembered."""
QUIET_S = 0.1
"""Rest that is kept before the first of them: it gives the noise."""
RULES = Segmenter()


class TapMemory:
    """The taps since the last lift-off, judged as `texclass.phases` does, by those that came before.

    Parameters
    ----------
    shape : Shape
        Follows the hand.
    ring : Ring
        Samples of the stream.
    level : Level
        Of the vibration.
    """

    def __init__(self, shape: Shape, ring: Ring, level: Level) -> None:
        self._shape, self._ring, self._level = shape, ring, level
        self.clear()

    def clear(self) -> None:
        """Forget the taps: another contact, or samples are missing."""
        self._taps: list[Tap] = []
        self._strongest = self._greatest = 0.0

    def add(self, event: Event, floor: float) -> Event | None:
        """Remember a tap and return its event, the impact to the sample; None if it was none.

        An impulse far weaker than the strongest before it is one only if it pushes against the hand: a tool
        that is lifted goes the way the hand accelerates.
        """
        impact, peak = self._impact(event.sample, event.end, floor)
        fs, last = self._shape.fs, self._taps[-1].end if self._taps else 0
        earliest = max(self._ring.start, last, impact - round(RULES.hand_s * fs))
        stop = min(event.known, impact + round(0.02 * fs))
        hand = self._shape.hand(self._ring.view(earliest, stop))
        push = hand.push(impact - earliest)
        weaker_db = 10 * np.log10(max(self._strongest, 1e-300) / max(peak, 1e-300))
        pushes = push >= LEAST_PUSH * self._greatest
        if weaker_db > RULES.tap_range_db or (weaker_db > RULES.tap_sure_db and not pushes):
            return None
        self._strongest, self._greatest = max(self._strongest, peak), max(self._greatest, abs(push))
        began = earliest + hand.start(0, impact - earliest) if impact > earliest else impact
        end = max(event.end, impact + 1)
        self._taps = [*self._taps, Tap(began, impact, end)][-MOST:]
        return Event("tap", impact, event.known, end)

    def before(self, onset: int) -> Tapped | None:
        """Return what is kept of the taps before a movement; None without any at hand."""
        return self._kept([tap for tap in self._taps if tap.end <= onset])

    def last(self) -> tuple[Tapped, int]:
        """Return the last tap by itself, and the sample at which what is kept of it begins."""
        kept = self._kept(self._taps[-1:])
        assert kept is not None  # it has just been added, and the ring is longer than a tap
        return kept, self._start(self._taps[-1])

    def _kept(self, taps: list[Tap]) -> Tapped | None:
        taps = [tap for tap in taps if tap.start >= self._ring.start]
        if not taps:
            return None
        first = self._start(taps[0])
        samples = self._ring.view(first, taps[-1].end).copy()
        moved = (Tap(t.start - first, t.impact - first, t.end - first) for t in taps)
        return Tapped(samples, tuple(moved))

    def _start(self, tap: Tap) -> int:
        return max(self._ring.start, tap.start - round(QUIET_S * self._shape.fs))

    def _impact(self, first: int, end: int, floor: float) -> tuple[int, float]:
        """Return the sample at which the vibration leaves the noise, and its greatest power."""
        start = max(self._level.vibration.start, first - round(0.01 * self._shape.fs))
        power = self._level.power(start, end)
        peak = float(power.max())
        return start + int(np.argmax(power >= min(max(CLEAR * floor, 1e-3 * peak), peak))), peak
