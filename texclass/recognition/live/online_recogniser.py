"""Online recognition: events, answers for windows and verdicts for contacts from the samples of a stream.

1. `Session.push` (module `session`) checks a `Block` of samples, repairs or removes invalid ones, and passes
   the rest to `OnlineRecogniser.push`.
2. The samples are conditioned and stored; their level detects movements, taps and lift-offs (module
   `contact`).
3. Each complete window becomes a recording (`RecordingBuilder`), which the model classifies like any other.
4. `Evidence` combines the answers of one contact.
"""

import math
import time
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from texclass.features.phase_view import TURN_CHANNELS
from texclass.recognition.answers import DEFAULT_CONFIDENCE, Answer, ContactVerdict, Evidence, Kind
from texclass.recognition.live.contact import (
    ContactDetector,
    ContactSettings,
    Event,
    LevelMeter,
    Ring,
    TapMemory,
    TapSamples,
)
from texclass.recognition.model import Model
from texclass.recognition.probabilities import DEFAULT_CORRELATION
from texclass.recording import ACCELERATION_UNITS, Phases, Recording, Samples
from texclass.signals import causal
from texclass.validation import check_positive

LONGEST_WINDOW_S = 30.0
"""Longest training recordings (s) whose length is used as the default length of a window."""
LONG_RECORDING_WINDOW_S = 5.0
"""Default length of a window (s) for longer training recordings. It limits the time to the first answer."""


@dataclass(frozen=True, kw_only=True)
class OnlineSettings:
    """Settings of the recognition in a stream.

    Attributes
    ----------
    window_s
        Length of a window in seconds (default: as in training; 5 s if the training recordings were longer
        than 30 s).
    hop_s
        Time between the ends of consecutive windows in seconds (default: half a window).
    evidence
        Rule that combines the windows of a contact; see `Evidence`.
    confidence, forget_s
        See `Evidence`.
    correlation
        Correlation between windows of one contact, see `Evidence` (default: as measured in training; 1 if the
        training recordings had one window each).
    stop_when_sure
        Whether to skip the remaining windows of a contact once its verdict is sure.
    starts_in_contact
        Whether the stream starts during a movement (default: yes for models trained on movements only,
        otherwise detected in the first 0.1 s).
    always_in_contact
        Whether the tool is in permanent contact, like a wheel or a leg. Only a vibration of exactly 0 then
        counts as a lift-off, and evidence fades with the time constant `forget_s` (default: four windows).
    contact
        Thresholds and durations of contact detection.

    Examples
    --------
    >>> OnlineSettings(window_s=0.5, confidence=0.99).hop_s is None  # half a window
    True
    """

    window_s: float | None = None
    hop_s: float | None = None
    evidence: Kind = "sequential"
    confidence: float = DEFAULT_CONFIDENCE
    correlation: float | None = None
    forget_s: float = math.inf
    stop_when_sure: bool = False
    starts_in_contact: bool | None = None
    always_in_contact: bool = False
    contact: ContactSettings = field(default_factory=ContactSettings)

    def __post_init__(self) -> None:
        check_positive(window_s=self.window_s, hop_s=self.hop_s)


@dataclass(frozen=True, eq=False)
class WindowAnswer:
    """Answer for one window of a stream, and the verdict for its contact so far.

    Attributes
    ----------
    start, stop
        The window consists of the samples [start, stop) of the stream.
    n_received
        Number of samples received when the window was classified.
    answer
        Answer for this window alone, as if the window were a recording.
    verdict
        Verdict for all windows of the contact so far.
    onset
        First sample of the contact.
    compute_ms
        Time for computing the features and the answer, in milliseconds.

    Examples
    --------
    >>> p = {"cork": 0.02, "oak": 0.98}
    >>> answer = Answer("window", "oak", 0.98, "cork", unknown=False, p_known=0.5, probabilities=p)
    >>> verdict = Evidence(("cork", "oak")).add(answer, contact_s=1.0)
    >>> window = WindowAnswer(1200, 5200, 5210, answer, verdict, onset=1200, compute_ms=1.3)
    >>> window.n_received - window.stop  # delay in samples
    10
    """

    start: int
    stop: int
    n_received: int
    answer: Answer
    verdict: ContactVerdict
    onset: int
    compute_ms: float


Update = Event | WindowAnswer


def scale_of(model: Model, unit: str, raw: bool) -> float:
    """Return the factor that converts the acceleration of a stream to the unit of the training recordings."""
    files = model.manifest.input
    scale = files.scale if raw and unit == files.unit else 1.0
    return ACCELERATION_UNITS.get(unit, 1.0) * scale


class RecordingBuilder:
    """Convert streamed samples to recordings with the channels, scale and conditioning of the training data.

    Parameters
    ----------
    model : Model
        Trained model, which defines the channels, the scale and the conditioning.
    n_columns : int
        Number of columns of the stream: axes of the acceleration, then turn rate and friction if the model
        needs them.
    fs : float
        Sampling rate of the stream in Hz.
    unit : str
        Unit of the acceleration.
    raw : bool
        Whether the samples are raw values, like those in the training files. They are then multiplied by the
        scale of the training files if the unit is the same (default True).

    Raises
    ------
    ValueError
        If the number of columns differs from that in training.
    """

    def __init__(self, model: Model, n_columns: int, fs: float, unit: str, raw: bool = True) -> None:
        columns = model.input_columns
        self.n_axes = columns.n_axes(n_columns)
        self._n_turn = len(TURN_CHANNELS) * ("turn_rate" in columns.auxiliary)
        self._has_friction = "friction" in columns.auxiliary
        self.fs, self.unit = fs, "m/s^2" if unit in ACCELERATION_UNITS else unit
        self._factor = scale_of(model, unit, raw)
        self._channels = columns.axes if model.plan.channels else ()
        self._rest_is_removed = model.manifest.input.remove_resting_level

    def condition(self, rows: Samples) -> Samples:
        """Return samples (n, n_columns) in the unit and scale of the training recordings."""
        if self._factor == 1.0:
            return rows
        return np.column_stack([rows[:, : self.n_axes] * self._factor, rows[:, self.n_axes :]])

    def build_window(self, samples: Samples, start: int, tap_samples: TapSamples | None = None) -> Recording:
        """Return a window as a recording: a movement, preceded by taps if there are any.

        Parameters
        ----------
        samples : ndarray of shape (n, n_columns)
            Samples of the window, which contain movement only.
        start : int
            Index of the first sample of the window in the stream.
        tap_samples : tuple of ndarray and taps, optional
            Samples that contain the taps before the movement, and these taps.
        """
        tap_rows, taps = tap_samples or (samples[:0], ())
        phases = Phases(taps, (len(tap_rows), len(tap_rows) + len(samples)))
        return self._build(tap_rows, samples, phases, f"window at {start / self.fs:.3f} s")

    def build_tap(self, tap_samples: TapSamples, start: int) -> Recording:
        """Return taps as a recording without a movement; `start` is its first sample in the stream."""
        tap_rows, taps = tap_samples
        return self._build(tap_rows, tap_rows[:0], Phases(taps), f"tap at {start / self.fs:.3f} s")

    def _build(self, tap_rows: Samples, movement_rows: Samples, phases: Phases, name: str) -> Recording:
        rows, n = np.concatenate([tap_rows, movement_rows]), self.n_axes
        # Taps and movement are not contiguous in time, so each has its own resting level.
        for phase_rows in np.split(rows, [len(tap_rows)]):
            if self._rest_is_removed and len(phase_rows):
                phase_rows[:, :n] -= np.median(phase_rows[:, :n], axis=0)
        return Recording(
            rows[:, 0] if n == 1 else rows[:, :n],
            self.fs,
            self.unit,
            name,
            turn_rate=rows[:, n : n + self._n_turn] if self._n_turn else None,
            friction=rows[:, -1] if self._has_friction else None,
            channels=self._channels,
            phases=phases,
        )


class OnlineRecogniser:
    """Recogniser for a stream of samples.

    The windows of a contact end at onset + window + k hop (k = 0, 1, 2 and so on). Each window is classified
    once, by the same code as a recording, so the answers do not depend on the block size. A window that ends
    in a pause is classified only after the movement continues; a lift-off discards it. Memory is bounded: the
    buffer holds about one window and one pause.

    Parameters
    ----------
    model : Model
        Trained model, preferably on windows of the same length.
    fs : float, optional
        Sampling rate of the stream in Hz (default: that of the model). At another rate, all answers are
        "unknown" and state the reason; resample such a stream first.
    unit : str, optional
        Unit of the acceleration (default: that of the model). Physical units are converted.
    raw : bool
        Whether the samples are raw values, like those in the training files, so that the scale of the dataset
        card applies (default True).
    settings : OnlineSettings, optional
        Settings of the recognition.

    Examples
    --------
    >>> recogniser = OnlineRecogniser(load_model("surface.skops"))  # doctest: +SKIP
    >>> for update in recogniser.push(samples):  # doctest: +SKIP
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
            trained_s = LONG_RECORDING_WINDOW_S
        self.window = max(1, round(self.fs * (settings.window_s or trained_s)))
        self.hop = max(1, round(self.fs * (settings.hop_s or self.window / self.fs / 2)))
        self._needs_taps = "tap" in manifest.phases
        self._taps_only = self._needs_taps and "movement" not in manifest.phases
        self._is_ready = False
        self.evidence = _create_evidence(model, settings, self.window / self.fs, self.hop / self.fs)
        self._window_queue = deque[int]()  # ends of complete windows that are not yet classified
        self._next_stop = 0  # end of the next window
        self._next_free = 0  # number of received samples from which the next window may be classified
        self._onset = 0  # first sample of the contact
        self._tap_samples: TapSamples | None = None  # taps before the current movement

    def push(self, samples: ArrayLike) -> tuple[Update, ...]:
        """Process the next samples and return the events and answers that they complete.

        Parameters
        ----------
        samples : array_like of shape (n,) or (n, n_columns)
            Any number of samples. The columns are the axes of the acceleration, then turn rate and friction
            if the model needs them.

        Returns
        -------
        updates : tuple of Event and WindowAnswer
            Events and answers in chronological order.

        Raises
        ------
        ValueError
            If a sample is not finite, or the number of columns differs from that of the model or of earlier
            blocks.
        """
        block = np.asarray(samples, dtype=np.float64)
        rows = block[:, None] if block.ndim == 1 else block
        if rows.ndim != 2 or rows.shape[1] == 0:
            raise ValueError(f"samples must have shape (n,) or (n, n_columns), got {block.shape}")
        if not np.isfinite(rows).all():
            raise ValueError(
                f"samples must be finite, got NaN or infinity among {block.size} values. Replace "
                "these samples, or call interrupt() with the number of missing ones"
            )
        if not self._is_ready:
            self._prepare(rows.shape[1])
        if rows.shape[1] != self.n_columns:
            raise ValueError(
                f"samples must have {self.n_columns} columns, as in earlier blocks, got {rows.shape[1]}"
            )
        rows, updates = self._builder.condition(rows), list[Update]()
        for first in range(0, len(rows), self._chunk_size):
            self._ring.push(rows[first : first + self._chunk_size])
            metered = self._meter.vibration.stop
            stop_of_bins = self._ring.stop - (self._ring.stop - metered) % self._meter.bin_size
            axes = self._ring.view(metered, stop_of_bins)[:, : self._builder.n_axes]
            for stop, power in self._meter.push(axes):
                for event in self._contact.step(stop, power):
                    updates += self._handle_event(event)
                if self._contact.is_moving and not self._taps_only:
                    updates += self._classify_windows(stop)
        return tuple(updates)

    def interrupt(self, n_missing: int) -> tuple[Update, ...]:
        """Skip `n_missing` lost samples and return the resulting events; windows never span a break."""
        if not self._is_ready or n_missing < 1:
            return ()
        sample = self._ring.stop
        self._ring.skip(n_missing)
        self._meter.skip(self._ring.stop - self._meter.vibration.stop)
        events = self._contact.interrupt(sample, n_missing, n_missing / self.fs)
        self._window_queue.clear()
        self._taps.clear()
        self._next_stop = self._ring.stop + self.window
        return tuple(update for event in events for update in self._handle_event(event))

    def finish(self) -> tuple[Update, ...]:
        """End the stream and return the remaining answers, including one for a last, short contact."""
        if not self._is_ready:
            return ()
        updates: list[Update] = []
        n_received = self._ring.stop
        while (
            self._contact.is_moving and not self._taps_only and (last := self._classify_windows(n_received))
        ):
            updates += last
            self._next_free = 0
        return (*updates, *self._classify_short_contact(n_received))

    def constants(self, n_columns: int) -> dict[str, Any]:
        """Return the constants of docs/stream-logic.md, for implementations in other languages.

        Parameters
        ----------
        n_columns : int
            Number of columns of the stream.
        """
        if not self._is_ready:
            self._prepare(n_columns)
        sections = self._meter.high_pass
        return {
            "window": self.window,
            "hop": self.hop,
            "spacing": self._spacing,
            "turn": round(self.settings.contact.turn_s * self.fs),
            "contact": {
                **self._contact.constants,
                "high_pass": sections.tolist(),
                "high_pass_rest": np.asarray(causal(sections, np.ones(1))[1]).tolist(),
            },
            "evidence": self.evidence.constants,
        }

    @property
    def min_samples(self) -> int:
        """Smallest number of samples of a complete window, or of taps."""
        return 0 if self._taps_only else self.window

    def replace_model(self, model: Model) -> None:
        """Replace the model by an adaptation of it. The evidence of a current contact remains."""
        self.model = model
        if self.evidence.set_calibrations:
            self.evidence.set_calibrations = model.contact_calibrations

    @property
    def verdict(self) -> ContactVerdict | None:
        """Verdict for the current contact; None before its first window."""
        return self.evidence.verdict

    @property
    def phase(self) -> str:
        """State of the tool: "starting", "rest", "active", "moving" or "pause"."""
        return self._contact.phase if self._is_ready else "starting"

    @property
    def level(self) -> tuple[float, float]:
        """RMS of the vibration in the unit of the stream, and its level above the noise floor in dB."""
        return (math.sqrt(self._contact.level), self._contact.level_db) if self._is_ready else (0.0, 0.0)

    @property
    def n_samples(self) -> int:
        """Number of samples so far, including missing ones."""
        return self._ring.stop if self._is_ready else 0

    @property
    def n_bytes(self) -> int:
        """Size of the buffers in bytes."""
        return self._ring.n_bytes + self._meter.vibration.n_bytes if self._is_ready else 0

    def _prepare(self, n_columns: int) -> None:
        """Create the buffers and the contact detector, whose size depends on the number of columns."""
        settings, in_contact = self.settings.contact, self.settings.starts_in_contact
        settings = replace(settings, **(self.model.manifest.phase_settings.changes | settings.changes))
        if in_contact is None and self.model.manifest.input.phases == "movement":
            in_contact = True  # the training recordings had no rest either
        if self.settings.always_in_contact:
            in_contact = True
            settings = replace(settings, drop_ratio=1e300)  # only a level of exactly 0 is that much lower
        if self.model.manifest.input.phases == "taps":
            settings = replace(settings, share=math.inf)  # long ringing after a tap is not a movement
        self._builder = RecordingBuilder(self.model, n_columns, self.fs, self.unit, self._raw)
        self.unit, self.n_columns = self._builder.unit, n_columns
        # Long blocks are processed in chunks of 0.1 s, so that memory does not depend on their length.
        self._chunk_size = max(1, round(0.1 * self.fs))
        # A model that combines taps with a movement uses the taps of the last 6 s.
        memory_s = settings.pause_s + settings.window_s + (6.0 if self._needs_taps else 1.0)
        self._ring = Ring(self.window + round(memory_s * self.fs) + 2 * self._chunk_size, n_columns)
        self._meter = LevelMeter(self.fs, self._builder.n_axes, memory_s)
        self._contact = ContactDetector(self._meter, settings, in_contact, self.unit)
        self._taps = TapMemory(self._ring, self._builder.n_axes, self._meter, settings.hand_s)
        # Windows that had to wait are classified 25 ms apart, which limits the load of a single block. With a
        # hop shorter than 50 ms the queue would grow, so it is emptied at once.
        spacing = max(round(0.025 * self.fs), self._meter.bin_size)
        self._spacing = spacing if 2 * spacing <= self.hop else 0
        self._is_ready = True

    def _handle_event(self, event: Event) -> list[Update]:
        """Update windows, taps and evidence after an event, and return it with the resulting answers."""
        match event.kind:
            case "contact":
                self._onset = event.sample
                self._next_stop = event.sample + self.window
                self._tap_samples = self._taps.taps_until(event.sample) if self._needs_taps else None
            case "lift-off":
                answers = self._classify_short_contact(event.n_received, event.sample)
                self._window_queue.clear()
                self.evidence.reset()
                self._taps.clear()
                return [*answers, event]
            case "tap":
                tap = self._taps.add(event, self._contact.floor)
                if tap is None:
                    return []
                if not self._taps_only:
                    return [tap]
                tap_samples, start = self._taps.last_tap()
                recording = self._builder.build_tap(tap_samples, start)
                return [tap, self._classify(recording, start, tap.end, tap.n_received, start)]
        return [event]

    def _classify_windows(self, n_received: int) -> list[Update]:
        """Classify the complete windows that do not end in a pause."""
        while self._next_stop <= n_received:
            self._window_queue.append(self._next_stop)
            self._next_stop += self.hop
        answers: list[Update] = []
        latest = self._contact.active_stop + round(self.settings.contact.turn_s * self.fs)
        while self._window_queue and self._window_queue[0] <= latest and n_received >= self._next_free:
            stop, verdict = self._window_queue.popleft(), self.evidence.verdict
            if not (self.settings.stop_when_sure and verdict is not None and verdict.sure):
                answers.append(self._classify_samples(stop - self.window, stop, n_received))
                self._next_free = n_received + self._spacing
        return answers

    def _classify_short_contact(self, n_received: int, end: int | None = None) -> list[Update]:
        """Classify a contact that is shorter than a window but at least half as long."""
        if self.evidence.verdict is not None or self._taps_only or not (end or self._contact.is_moving):
            return []
        start = max(self._onset, self._ring.start)
        stop = min(end or self._contact.active_stop, n_received, start + self.window)
        is_long_enough = 2 * (stop - start) >= self.window
        return [self._classify_samples(start, stop, n_received)] if is_long_enough else []

    def _classify_samples(self, start: int, stop: int, n_received: int) -> WindowAnswer:
        window = self._builder.build_window(self._ring.view(start, stop), start, self._tap_samples)
        return self._classify(window, start, stop, n_received, self._onset)

    def _classify(
        self, recording: Recording, start: int, stop: int, n_received: int, onset: int
    ) -> WindowAnswer:
        started = time.perf_counter()
        answer = self.model.answer(recording)
        verdict = self.evidence.add(answer, (stop - onset) / self.fs)
        compute_ms = 1e3 * (time.perf_counter() - started)
        return WindowAnswer(start, stop, n_received, answer, verdict, onset, compute_ms)


def _create_evidence(model: Model, settings: OnlineSettings, window_s: float, hop_s: float) -> Evidence:
    """Create the evidence of a contact from the settings of the user and the values measured in training."""
    calibration = model.manifest.calibration
    trained_correlation = calibration.get("correlation")
    forget_s = settings.forget_s
    if settings.always_in_contact and forget_s == math.inf:
        forget_s = 4 * window_s  # a contact that never ends must forget earlier surfaces
    # Prediction sets are valid only for windows of the training's length, combined as in training.
    has_trained_length = settings.window_s in (None, model.manifest.window_s)
    is_like_training = has_trained_length and settings.evidence == "sequential" and forget_s == math.inf
    return Evidence(
        model.surfaces,
        settings.evidence,
        window_s=window_s,
        hop_s=hop_s,
        correlation=next(
            r for r in (settings.correlation, trained_correlation, DEFAULT_CORRELATION) if r is not None
        ),
        lapse=0.0 if trained_correlation is None else 1 / (calibration["n_contacts"] + 2),
        forget_s=forget_s,
        confidence=settings.confidence,
        set_calibrations=model.contact_calibrations if is_like_training else None,
        levels=model.levels,
    )
