"""A model that listens to samples as they come: events, answers of windows, verdicts of contacts.

A sample comes in a `Block` (`sources.blocks`) to `Session.take` (`session`), which says what is
wrong with the stream and passes finite samples on to `OnlineRecogniser.push`. There it is conditioned, kept,
and part of a level, which tells movement, taps and lift-off (`contact`). A window that is due becomes a
recording (`Stretches`), which the model answers as any other, and the answers of a contact are put together
(`Evidence`).
"""

import math
import time
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from texclass.features.phase_view import TURN
from texclass.recognition.answers import DEFAULT_CONFIDENCE, Answer, ContactVerdict, Evidence, Kind
from texclass.recognition.live.contact import Contact, ContactRules, Event, Level, Ring, TapMemory, Tapped
from texclass.recognition.model import Model
from texclass.recognition.probabilities import DEFAULT_CORRELATION
from texclass.recording import ACCELERATION_UNITS, Phases, Recording, Samples
from texclass.signals import causal
from texclass.validation import check_positive

LONGEST_WINDOW_S = 30.0
RUN_WINDOW_S = 5.0
"""Of a model whose recordings are runs, longer than the longest window: who waits so long for an answer?"""


@dataclass(frozen=True, kw_only=True)
class OnlineSettings:
    """How a stream is listened to.

    Attributes
    ----------
    window_s
        Seconds of one answer; None: those the model was trained on, or `RUN_WINDOW_S` where these were runs.
    hop_s
        Seconds from one answer to the next; None: half a window.
    evidence
        How windows of a contact are put together; see `Evidence`.
    confidence, forget_s
        See `Evidence`.
    correlation
        See `Evidence`; None: as found in training, where contacts had several windows, else 1.
    stop_when_sure
        No more windows of a contact are computed once its verdict is sure.
    assume_contact
        Whether the stream begins in a movement; None: it does if the model was trained on movement only, else
        the first tenth of a second decides.
    always_in_contact
        Wheels and legs: there is no lift-off but digital silence, and evidence fades after four
        windows, or `forget_s`.
    rules
        Which levels and durations make a contact, a tap, a lift-off.
    """

    window_s: float | None = None
    hop_s: float | None = None
    evidence: Kind = "sequential"
    confidence: float = DEFAULT_CONFIDENCE
    correlation: float | None = None
    forget_s: float = math.inf
    stop_when_sure: bool = False
    assume_contact: bool | None = None
    always_in_contact: bool = False
    rules: ContactRules = field(default_factory=ContactRules)

    def __post_init__(self) -> None:
        check_positive(window_s=self.window_s, hop_s=self.hop_s)


@dataclass(frozen=True, eq=False)
class WindowAnswer:
    """What was said of one window of a stream.

    Attributes
    ----------
    start, stop
        Samples [start, stop) of the stream.
    known
        Samples that had come when it was due.
    answer
        Of this window alone: the same as the model gives for it as a recording.
    verdict
        Of the contact so far.
    onset
        Sample at which the contact began.
    ms
        What features and classifier took.
    """

    start: int
    stop: int
    known: int
    answer: Answer
    verdict: ContactVerdict
    onset: int
    ms: float


Update = Event | WindowAnswer


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


class OnlineRecogniser:
    """A model that listens: the same answers for any block size, each that of the model on its window.

    Windows end at onset + window + k hop and are computed by the code that computes recordings, when a window
    is due and at no other time. A window that ends in a pause waits until the pause is over; a lift-off
    discards it and begins anew. Memory is a ring of a window and a pause, and does not grow.

    Parameters
    ----------
    model : Model
        Trained, best on touches of the length of a window.
    fs : float, optional
        Sampling rate of the stream in Hz; the model's by default. With another, answers say so and count as
        unknown: resample first.
    unit : str, optional
        Of the acceleration; the model's by default. Physical units are converted.
    raw : bool
        Whether samples are as in the files the model was trained on: the scale of its dataset card applies.
    settings : OnlineSettings
        How it listens.

    Examples
    --------
    >>> live = OnlineRecogniser(load_model("surface.skops"))  # doctest: +SKIP
    >>> for update in live.push(block):  # doctest: +SKIP
    ...     print(update)
    """

    def __init__(
        self,
        model: Model,
        *,
        fs: float | None = None,
        unit: str | None = None,
        raw: bool = True,
        settings: OnlineSettings | None = None,
    ) -> None:
        manifest, settings = model.manifest, settings or OnlineSettings()
        self.model, self.settings, self._raw = model, settings, raw
        self.fs, self.unit = float(fs or manifest.fs), unit or manifest.unit
        trained_s = manifest.window_s or manifest.shortest_s or 1.0
        if trained_s > LONGEST_WINDOW_S and settings.window_s is None:
            trained_s = RUN_WINDOW_S
        self.window = max(1, round(self.fs * (settings.window_s or trained_s)))
        self.hop = max(1, round(self.fs * (settings.hop_s or self.window / self.fs / 2)))
        self._needs_taps = "tap" in manifest.phases
        self._taps_only = self._needs_taps and "movement" not in manifest.phases
        self._ready = False
        self.evidence = _evidence(model, settings, self.window / self.fs, self.hop / self.fs)
        self._due = deque[int]()  # ends of windows that wait for a pause to end
        self._next = self._free_from = self._contact_from = 0
        self._tapped: Tapped | None = None

    def push(self, samples: ArrayLike) -> tuple[Update, ...]:
        """Take in the next samples and return what is known now.

        Parameters
        ----------
        samples : array_like of shape (n,) or (n, n_columns)
            Of any length. Columns are the axes of the acceleration, then (where the model has one) of the
            turn rate.

        Raises
        ------
        ValueError
            If a sample is not finite, or the columns are not those of the model or of earlier blocks.
        """
        block = np.asarray(samples, dtype=np.float64)
        rows = block[:, None] if block.ndim == 1 else block
        if rows.ndim != 2 or rows.shape[1] == 0:
            raise ValueError(f"samples have shape {block.shape}. Expected (n,) or (n, n_columns)")
        if not np.isfinite(rows).all():
            raise ValueError("a sample is NaN or infinite. Expected finite samples, or an interruption")
        if not self._ready:
            self._prepare(rows.shape[1])
        if rows.shape[1] != self.n_columns:
            raise ValueError(f"samples have {rows.shape[1]} columns. Expected {self.n_columns}, as before")
        rows, found = self._stretches.conditioned(rows), list[Update]()
        for first in range(0, len(rows), self._piece):
            self._ring.push(rows[first : first + self._piece])
            heard = self._level.vibration.stop
            whole = self._ring.stop - (self._ring.stop - heard) % self._level.bin_size
            axes = self._ring.view(heard, whole)[:, : self._stretches.n_axes]
            for stop, power in self._level.push(axes):
                for event in self._contact.step(stop, power):
                    found += self._after(event)
                if self._contact.moving and not self._taps_only:
                    found += self._windows(stop)
        return tuple(found)

    def interrupt(self, n_missing: int) -> tuple[Update, ...]:
        """Say that `n_missing` samples were lost; no window reaches over a break."""
        if not self._ready or n_missing < 1:
            return ()
        at = self._ring.stop
        self._ring.skip(n_missing)
        self._level.skip(self._ring.stop - self._level.vibration.stop)
        events = self._contact.interrupt(at, n_missing, n_missing / self.fs)
        self._due.clear()
        self._taps.clear()
        self._next = self._ring.stop + self.window
        return tuple(update for event in events for update in self._after(event))

    def finish(self) -> tuple[Update, ...]:
        """Say that the stream has ended: a contact too short for a window is answered as far as it went."""
        if not self._ready:
            return ()
        found: list[Update] = []
        while self._contact.moving and not self._taps_only and (last := self._windows(self._ring.stop)):
            found += last
            self._free_from = 0
        return (*found, *self._short_contact(self._ring.stop))

    def constants(self, n_columns: int) -> dict[str, Any]:
        """Return what a program needs to know that does the same around a window; see docs/stream-logic.md.

        Parameters
        ----------
        n_columns : int
            Of the stream.
        """
        if not self._ready:
            self._prepare(n_columns)
        sections = self._level.high_pass
        return {
            "window": self.window,
            "hop": self.hop,
            "spread": self._spread,
            "turn": round(self.settings.rules.turn_s * self.fs),
            "contact": {
                **self._contact.constants,
                "high_pass": sections.tolist(),
                "high_pass_rest": np.asarray(causal(sections, np.ones(1))[1]).tolist(),
            },
            "evidence": self.evidence.constants,
        }

    @property
    def verdict(self) -> ContactVerdict | None:
        """What is known of the contact at hand; None before its first window."""
        return self.evidence.verdict

    @property
    def phase(self) -> str:
        """What the tool does: listening, rest, touched, moving, pause."""
        return self._contact.phase if self._ready else "listening"

    @property
    def level(self) -> tuple[float, float]:
        """Root mean square of the vibration (unit of the stream), and its level above the noise in dB."""
        return (math.sqrt(self._contact.level), self._contact.level_db) if self._ready else (0.0, 0.0)

    @property
    def n_samples(self) -> int:
        """Samples so far, missing ones included."""
        return self._ring.stop if self._ready else 0

    @property
    def n_bytes(self) -> int:
        """Memory of the rings, which is all that depends on the stream."""
        return self._ring.n_bytes + self._level.vibration.n_bytes if self._ready else 0

    def _prepare(self, n_columns: int) -> None:
        """Make what depends on the number of columns."""
        rules, asked = self.settings.rules, self.settings.assume_contact
        rules = replace(rules, **(self.model.manifest.phase_settings.changes | rules.changes))
        if asked is None and self.model.manifest.input.phases == "movement":
            asked = True  # all that the model knows is movement
        if self.settings.always_in_contact:
            asked, rules = True, replace(rules, drop_ratio=1e300)  # that far a level falls only to exactly 0
        if self.model.manifest.input.phases == "taps":
            rules = replace(rules, share=math.inf)  # nothing is a movement, however long it rings
        self._stretches = Stretches(self.model, n_columns, self.fs, self.unit, self._raw)
        self.unit, self.n_columns = self._stretches.unit, n_columns
        # Longer blocks are taken in in pieces, so that the memory does not depend on their length.
        self._piece = max(1, round(0.1 * self.fs))
        # Taps of the last 6 s before a movement are remembered.
        behind_s = rules.pause_s + rules.window_s + (6.0 if self._needs_taps else 1.0)
        self._ring = Ring(self.window + round(behind_s * self.fs) + 2 * self._piece, n_columns)
        self._level = Level(self.fs, self._stretches.n_axes, behind_s)
        self._contact = Contact(self._level, rules, asked, self.unit)
        self._taps = TapMemory(self._ring, self._stretches.n_axes, self._level, rules.hand_s)
        # Windows that were waiting are answered 25 ms apart: no block has to do them all.
        spread = max(round(0.025 * self.fs), self._level.bin_size)
        self._spread = spread if 2 * spread <= self.hop else 0  # else more would come than go
        self._ready = True

    def _after(self, event: Event) -> list[Update]:
        """Act on an event: what it means for windows and evidence."""
        match event.kind:
            case "contact":
                self._contact_from = event.sample
                self._next = event.sample + self.window
                self._tapped = self._taps.before(event.sample) if self._needs_taps else None
            case "lift-off":
                last = self._short_contact(event.known, event.sample)
                self._due.clear()
                self.evidence.reset()
                self._taps.clear()
                return [*last, event]
            case "tap":
                tap = self._taps.add(event, self._contact.floor)
                if tap is None:
                    return []
                if not self._taps_only:
                    return [tap]
                tapped, start = self._taps.last()
                felt = self._stretches.tap(tapped, start)
                return [tap, self._told(felt, start, tap.end, tap.known, start)]
        return [event]

    def _windows(self, known: int) -> list[Update]:
        """Answer the windows that are due and do not end in a pause."""
        while self._next <= known:
            self._due.append(self._next)
            self._next += self.hop
        found: list[Update] = []
        latest = self._contact.active_until + round(self.settings.rules.turn_s * self.fs)
        while self._due and self._due[0] <= latest and known >= self._free_from:
            stop, verdict = self._due.popleft(), self.evidence.verdict
            if not (self.settings.stop_when_sure and verdict is not None and verdict.sure):
                found.append(self._answer(stop - self.window, stop, known))
                self._free_from = known + self._spread
        return found

    def _short_contact(self, known: int, end: int | None = None) -> list[Update]:
        """Answer what was felt of a contact that no window was heard of, if it is half a window or more."""
        if self.evidence.verdict is not None or self._taps_only or not (end or self._contact.moving):
            return []
        start = max(self._contact_from, self._ring.start)
        stop = min(end or self._contact.active_until, known, start + self.window)
        return [self._answer(start, stop, known)] if 2 * (stop - start) >= self.window else []

    def _answer(self, start: int, stop: int, known: int) -> WindowAnswer:
        window = self._stretches.window(self._ring.view(start, stop), start, self._tapped)
        return self._told(window, start, stop, known, self._contact_from)

    def _told(self, recording: Recording, start: int, stop: int, known: int, onset: int) -> WindowAnswer:
        began = time.perf_counter()
        answer = self.model.answer(recording)
        verdict = self.evidence.add(answer, (stop - onset) / self.fs)
        return WindowAnswer(start, stop, known, answer, verdict, onset, 1e3 * (time.perf_counter() - began))


def _evidence(model: Model, settings: OnlineSettings, window_s: float, hop_s: float) -> Evidence:
    """Return how windows of a contact are put together: as asked for, else as found in training."""
    known = model.manifest.calibration
    found = known.get("correlation")
    forget_s = settings.forget_s
    if settings.always_in_contact and forget_s == math.inf:
        forget_s = 4 * window_s  # for contact never ends
    # Windows of another length, or put together otherwise, conform otherwise.
    is_long_as_trained = settings.window_s in (None, model.manifest.window_s)
    like_training = is_long_as_trained and settings.evidence == "sequential" and forget_s == math.inf
    return Evidence(
        model.surfaces,
        settings.evidence,
        window_s=window_s,
        hop_s=hop_s,
        correlation=next(r for r in (settings.correlation, found, DEFAULT_CORRELATION) if r is not None),
        lapse=0.0 if found is None else 1 / (known["n_contacts"] + 2),
        forget_s=forget_s,
        confidence=settings.confidence,
        set_calibrations=model.contact_calibrations if like_training else None,
        levels=model.levels,
    )
