"""The online recogniser: blocks of samples in; events, answers and verdicts out, as soon as known."""

import math
import time
from collections import deque

import numpy as np
from numpy.typing import ArrayLike

from texclass.recognition.answer import Answer
from texclass.recognition.model import Model
from texclass.recognition.online.contact import Contact, Event
from texclass.recognition.online.evidence import Evidence, Verdict
from texclass.recognition.online.lean import LeanModel
from texclass.recognition.online.level import Level
from texclass.recognition.online.ring import Ring
from texclass.recognition.online.settings import (
    HOPS,
    OnlineSettings,
    Update,
    WindowAnswer,
    begins_in_contact,
    window_seconds,
)
from texclass.recognition.online.taps import TapMemory
from texclass.recognition.online.windows import Shape, Tapped
from texclass.recording import Samples

TAPS_S = 6.0
"""Taps of so many seconds before a movement are remembered."""
SPREAD_S = 0.025
"""Windows that were waiting are answered one after the other, this far apart: no block has to do them all."""
_PIECE_S = 0.1
"""Longer blocks are taken in in pieces, so that the memory does not depend on their length."""


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
        self._raw = raw
        self.model, self.settings = LeanModel.of(model), settings
        self.fs, self.unit = float(fs or manifest.fs), unit or manifest.unit
        self.window = max(1, round(self.fs * window_seconds(model, settings)))
        hop_s = settings.hop_s or self.window / self.fs / HOPS
        self.hop = max(1, round(self.fs * hop_s))
        self._needs_taps = "tap" in manifest.phases
        self._taps_only = self._needs_taps and "movement" not in manifest.phases
        self._rules = settings.rules
        self._ready = False
        self.evidence = Evidence(
            model.materials,
            settings.evidence,
            window_s=self.window / self.fs,
            hop_s=self.hop / self.fs,
            discount=settings.discount,
            forget_s=settings.forget_s,
            confidence=settings.confidence,
        )
        self._due = deque[int]()  # ends of windows that wait for a pause to end
        self._next = self._free_from = 0
        self._contact_from = 0
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
            raise ValueError(f"samples have shape {block.shape}; the rule is (n,) or (n, n_columns)")
        if not np.isfinite(rows).all():
            raise ValueError("a sample is NaN or infinite; the rule is finite samples, or an interruption")
        if not self._ready:
            self._prepare(rows.shape[1])
        if rows.shape[1] != self.n_columns:
            raise ValueError(f"samples have {rows.shape[1]} columns; the rule is {self.n_columns}, as before")
        rows, found = self._shape.conditioned(rows), list[Update]()
        for first in range(0, len(rows), self._piece):
            found += self._take(rows[first : first + self._piece])
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

    def reset(self) -> None:
        """Forget the contact at hand: windows begin with the next sample."""
        self.evidence.reset()
        self._due.clear()
        if self._ready:
            self._contact_from = self._ring.stop
            self._next = self._ring.stop + self.window

    @property
    def verdict(self) -> Verdict | None:
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

    def window_recording(self, start: int, stop: int) -> "Samples":
        """Return samples [start, stop) as far as they are at hand, a copy of shape (n, n_columns)."""
        return self._ring.view(start, stop).copy()

    def _prepare(self, n_columns: int) -> None:
        self._shape = Shape(self.model, n_columns, self.fs, self.unit, self._raw)
        self.unit = self._shape.unit
        self.n_columns = n_columns
        rules, n_axes = self._rules, self._shape.n_axes
        self._piece = max(1, round(_PIECE_S * self.fs))
        behind_s = rules.pause_s + rules.window_s + (TAPS_S if self._needs_taps else 1.0)
        self._ring = Ring(self.window + round(behind_s * self.fs) + 2 * self._piece, n_columns)
        self._level = Level(self.fs, n_axes, behind_s)
        bin_s = self._level.bin_size / self.fs
        begins = begins_in_contact(self.model, self.settings)
        self._contact = Contact(bin_s, rules, begins, self.unit, self._level.correlation)
        self._taps = TapMemory(self._shape, self._ring, self._level)
        spread = max(round(SPREAD_S * self.fs), self._level.bin_size)
        self._spread = spread if 2 * spread <= self.hop else 0  # else more would come than go
        self._ready = True

    def _take(self, rows: Samples) -> list[Update]:
        self._ring.push(rows)
        heard, found = self._level.vibration.stop, list[Update]()
        whole = self._ring.stop - (self._ring.stop - heard) % self._level.bin_size
        for new in self._level.push(self._ring.view(heard, whole)[:, : self._shape.n_axes]):
            for event in self._contact.step(new):
                found += self._after(event)
            if self._contact.moving and not self._taps_only:
                found += self._windows(new.stop)
        return found

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
                return [tap, self._answer_tap(tap)] if self._taps_only else [tap]
        return [event]

    def _windows(self, known: int) -> list[Update]:
        """Answer the windows that are due and do not end in a pause."""
        while self._next <= known:
            self._due.append(self._next)
            self._next += self.hop
        found: list[Update] = []
        latest = self._contact.active_until + round(self._rules.turn_s * self.fs)
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
        began = time.perf_counter()
        samples = self._ring.view(start, stop)
        answer = self.model.answer(self._shape.window(samples, start, self._tapped))
        return self._told(answer, start, stop, known, self._contact_from, began)

    def _answer_tap(self, event: Event) -> WindowAnswer:
        began = time.perf_counter()
        tapped, start = self._taps.last()
        answer = self.model.answer(self._shape.tap(tapped, start))
        return self._told(answer, start, event.end, event.known, start, began)

    def _told(
        self, answer: Answer, start: int, stop: int, known: int, onset: int, began: float
    ) -> WindowAnswer:
        verdict = self.evidence.add(answer, (stop - onset) / self.fs)
        return WindowAnswer(start, stop, known, answer, verdict, onset, 1e3 * (time.perf_counter() - began))
