"""Which stretches of a stream are answered, as recordings: windows of a movement, single taps."""

from dataclasses import replace

import numpy as np

from texclass.features.phase_view import TURN
from texclass.phases import Segmenter, find_glitches, hand_start, leaves_noise, mended
from texclass.recognition.live.contact import Event, Level, Ring
from texclass.recognition.model import Model
from texclass.recording import ACCELERATION_UNITS, Phases, Recording, Samples, Tap

MOST_TAPS = 16
"""Taps that are remembered."""
QUIET_S = 0.1
"""Rest that is kept before the first of them: it gives the noise."""
TAP_RULES = Segmenter()
MARGIN_S = 0.003
"""Before an impulse begins: its impact is looked for from there."""

Tapped = tuple[Samples, tuple[Tap, ...]]
"""What was felt before a movement: a stretch of samples with its taps, counted from its start."""


def scale_of(model: Model, unit: str, raw: bool) -> float:
    """Return the factor from the acceleration of a stream to that of the model's recordings."""
    files = model.manifest.input
    scale = files.scale if raw and unit == files.unit else 1.0
    return ACCELERATION_UNITS.get(unit, 1.0) * scale


class Stretches:
    """How samples of a stream become recordings that a model answers.

    Parameters
    ----------
    model : Model
        Says which channels are kept apart, and whether files lost their resting level.
    n_columns : int
        Columns of the stream: axes of the acceleration, then, where the model has them, of the turn rate, and
        the friction.
    fs : float
        Sampling rate of the stream in Hz.
    unit : str
        Of its acceleration.
    raw : bool
        Whether samples are as in the files the model was trained on, so that the scale of these applies, if
        they are in their unit.

    Raises
    ------
    ValueError
        If the model needs other columns.
    """

    def __init__(self, model: Model, n_columns: int, fs: float, unit: str, raw: bool = True) -> None:
        needs = model.needs
        self.n_axes = needs.n_axes(n_columns)
        self._n_turn = len(TURN) * ("turn_rate" in needs.beside)
        self._has_friction = "friction" in needs.beside
        self.fs, self.unit = fs, "m/s^2" if unit in ACCELERATION_UNITS else unit
        self._factor = scale_of(model, unit, raw)
        self._channels = needs.axes if model.plan.channels else ()
        self._rest_is_removed = model.manifest.input.remove_resting_level

    def conditioned(self, rows: Samples) -> Samples:
        """Return samples (n, n_columns) as recordings keep them: in their unit, scaled as the files were.

        What is to change samples before anything looks at them, contact and windows alike, belongs here.
        """
        if self._factor == 1.0:
            return rows
        return np.column_stack([rows[:, : self.n_axes] * self._factor, rows[:, self.n_axes :]])

    def window(self, samples: Samples, start: int, tapped: Tapped | None = None) -> Recording:
        """Return samples (n, n_columns), all movement, as a recording, after what was tapped before."""
        before, taps = tapped or (samples[:0], ())
        phases = Phases(taps, (len(before), len(before) + len(samples)))
        return self._recording(before, samples, phases, f"window at {start / self.fs:.3f} s")

    def tap(self, tapped: Tapped, start: int) -> Recording:
        """Return taps alone as a recording."""
        samples, taps = tapped
        return self._recording(samples, samples[:0], Phases(taps), f"tap at {start / self.fs:.3f} s")

    def _recording(self, before: Samples, samples: Samples, phases: Phases, name: str) -> Recording:
        """Return two stretches as one recording, each without the level that training files had lost, too."""
        whole, n = np.concatenate([before, samples]), self.n_axes
        for part in np.split(whole, [len(before)]):
            if self._rest_is_removed and len(part):
                part[:, :n] -= np.median(part[:, :n], axis=0)
        return Recording(
            whole[:, 0] if n == 1 else whole[:, :n],
            self.fs,
            self.unit,
            name,
            turn_rate=whole[:, n : n + self._n_turn] if self._n_turn else None,
            friction=whole[:, -1] if self._has_friction else None,
            channels=self._channels,
            phases=phases,
        )


class TapMemory:
    """The taps since the last lift-off, measured as `texclass.phases` does.

    Parameters
    ----------
    stretches : Stretches
        How they become recordings.
    ring : Ring
        Samples of the stream.
    level : Level
        Of the vibration.
    """

    def __init__(self, stretches: Stretches, ring: Ring, level: Level) -> None:
        self._stretches, self._ring, self._level = stretches, ring, level
        self.clear()

    def clear(self) -> None:
        """Forget the taps: another contact, or samples are missing."""
        self._taps: list[Tap] = []

    def add(self, event: Event, floor: float) -> Event | None:
        """Remember a tap and return its event, the impact to the sample; None if it was a wild sample."""
        fs, last = self._stretches.fs, self._taps[-1].end if self._taps else 0
        start = max(self._level.vibration.start, event.sample - round(MARGIN_S * fs))
        stop = max(start + 1, event.sample + event.width)
        at = leaves_noise(self._level.power(start, stop), floor)
        impact = event.sample if at is None else start + at
        earliest = max(self._ring.start, last, impact - round(TAP_RULES.hand_s * fs))
        axes = self._ring.view(earliest, event.end)[:, : self._stretches.n_axes]
        glitches = find_glitches(axes)
        if ((glitches >= start - earliest) & (glitches < stop - earliest)).any():
            return None
        before = mended(axes, glitches)[: max(0, impact - earliest)]
        began = min(impact, earliest + hand_start(before, fs))
        tap = Tap(began, impact, max(event.end, impact + 1), event.width, event.quality)
        self._taps = [*self._taps, tap][-MOST_TAPS:]
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
        return max(self._ring.start, tap.start - round(QUIET_S * self._stretches.fs))
