"""Sessions: recognition in a stream of blocks, with notices about faults of the stream."""

import math
import time
from collections.abc import Generator, Iterable, Iterator
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from texclass.loaders.timestamps import TIMESTAMPS
from texclass.recognition.live.contact import Event
from texclass.recognition.live.drift_monitor import DriftMonitor
from texclass.recognition.live.online_recogniser import (
    LONG_RECORDING_WINDOW_S,
    LONGEST_WINDOW_S,
    OnlineRecogniser,
    OnlineSettings,
    Update,
    scale_of,
)
from texclass.recognition.model import Model, load_model
from texclass.recognition.sources.blocks import Block
from texclass.recognition.sources.source_by_name import is_live, open_source
from texclass.recording import ACCELERATION_UNITS, Recording, RecordingError, Samples


@dataclass(frozen=True)
class Notice:
    """Notice about a fault of the stream, such as lost samples, a clock jump, or a wrong rate or unit.

    Attributes
    ----------
    t_s
        Time stamp of the block in seconds, according to the clock of its source.
    message
        Description of the fault.

    Examples
    --------
    >>> Notice(1.5, "lost: 40 samples").message
    'lost: 40 samples'
    """

    t_s: float
    message: str


class SampleRepair:
    """Repair samples that are not finite, or too far from the last valid one to be caused by a surface.

    Up to `TIMESTAMPS.max_gap` consecutive invalid samples are interpolated linearly, like missing messages.
    Longer sequences count as lost. The result does not depend on the block size, because invalid samples are
    held back until the next valid one arrives.

    Parameters
    ----------
    model : Model
        Trained model. The largest acceleration of its training recordings limits the step between two
        samples.
    n_axes : int
        Number of axes of the acceleration, which are the first columns.
    fs : float
        Sampling rate in Hz.
    scale : float
        Factor that converts the values of the stream to the unit of the training recordings.

    Attributes
    ----------
    max_step : float
        Largest plausible step between two samples, in the unit of the stream.
    """

    def __init__(self, model: Model, n_axes: int, fs: float, scale: float) -> None:
        loudest = model.manifest.peak_acceleration
        # A step of a hundred times the largest acceleration of training is a loose wire, not a surface. A tap
        # on a hard surface can cause a step of 1000 m/s^2, independent of the training recordings.
        max_step = 1e6 if loudest is None else 100 * loudest
        max_step = max(max_step, 1000.0) if model.manifest.unit == "m/s^2" else max_step
        self.n_axes, self.max_step = n_axes, max_step / scale
        # If the level after a step persists for 0.1 s, it is a new resting level: the stream continues, like
        # after a break.
        self._n_new_level = max(TIMESTAMPS.max_gap + 2, round(0.1 * fs))
        self._last_valid: Samples | None = None
        self._n_waiting = self._n_beyond = 0

    def repair(self, rows: Samples) -> tuple[list[tuple[int, Samples]], int, int]:
        """Return the valid and interpolated rows of a block.

        Parameters
        ----------
        rows : ndarray of shape (n, n_columns)
            Samples in the unit of the stream.

        Returns
        -------
        segments : list of (int, ndarray)
            For each segment, the number of rows lost before it, and its rows.
        n_invalid : int
            Number of rows with values that are not finite, or too large for any sensor.
        n_glitches : int
            Number of rows that are omitted because they exceed the largest plausible step.
        """
        # No sensor sends NaN or values above 1e15, in any unit.
        invalid = np.asarray(~(np.abs(rows) <= 1e15).all(axis=1))
        previous = rows[:1] if self._last_valid is None else self._last_valid[None]
        with np.errstate(invalid="ignore"):
            steps = np.abs(np.diff(rows[:, : self.n_axes], axis=0, prepend=previous[:, : self.n_axes]))
        if not self._n_waiting and not invalid.any() and (steps <= self.max_step).all():
            self._last_valid = rows[-1].copy()
            return [(0, rows)], 0, 0
        segments: list[tuple[int, list[Samples]]] = [(0, [])]
        n_glitches = 0
        for row, is_invalid in zip(rows, invalid.tolist(), strict=True):
            last = row if self._last_valid is None else self._last_valid
            is_beyond = not is_invalid and bool((np.abs(row - last)[: self.n_axes] > self.max_step).any())
            self._n_beyond = self._n_beyond + 1 if is_beyond else 0
            if is_invalid or 0 < self._n_beyond < self._n_new_level:
                n_glitches += is_beyond
                self._n_waiting += 1
                continue
            if self._last_valid is None or self._n_waiting > TIMESTAMPS.max_gap:
                segments.append((self._n_waiting, []))
            else:
                weights = np.arange(1, self._n_waiting + 1)[:, None] / (self._n_waiting + 1)
                segments[-1][1].extend(last + weights * (row - last))
            segments[-1][1].append(row)
            self._last_valid, self._n_waiting, self._n_beyond = row.copy(), 0, 0
        arrays = [(n_lost, np.array(segment)) for n_lost, segment in segments if segment]
        return arrays, int(np.count_nonzero(invalid)), n_glitches


class Session:
    """Recognition in a stream of blocks, with notices about faults.

    - Invalid samples are interpolated or treated like lost samples; see `SampleRepair`.
    - If the rate or unit differs from that of the model, there is a notice, and all answers are "unknown".
    - A change of the rate or unit restarts the recognition.
    - If the features of several surfaces have shifted as a whole, there is a notice; see `DriftMonitor`.
    - Notices of one kind are limited to one per 5 s; the next one states how many were omitted.

    Parameters
    ----------
    model : Model
        Trained model.
    raw : bool
        Whether samples are raw values, like those in the training files; see `OnlineRecogniser` (default
        True).
    settings : OnlineSettings, optional
        Settings of the recognition.
    adapt : bool
        Whether the model is adapted to the last contacts without labels (default False). The adaptation lasts
        as long as the session.

    Attributes
    ----------
    model : Model
        Model, or its last adaptation.
    recogniser : OnlineRecogniser or None
        Recogniser of the stream; None before the first block.
    n_lost : int
        Number of lost or invalid samples.
    start_s : float
        Time stamp of sample 0 in seconds, according to the clock of the source.

    Examples
    --------
    >>> session = Session(load_model("surfaces.skops"))  # doctest: +SKIP
    >>> for update in session.run(open_source("ros2:/imu")):  # doctest: +SKIP
    ...     print(update)
    """

    def __init__(
        self, model: Model, *, raw: bool = True, settings: OnlineSettings | None = None, adapt: bool = False
    ) -> None:
        self.model, self.raw, self.settings = model, raw, settings
        is_always_in_contact = settings is not None and settings.always_in_contact
        self._monitor = DriftMonitor(model, adapts=adapt, is_always_in_contact=is_always_in_contact)
        self._has_trained_length = True
        self.recogniser: OnlineRecogniser | None = None
        self.n_lost, self.start_s = 0, 0.0
        self._sent_s = -math.inf
        self._notice_counts: dict[str, tuple[float, int, str]] = {}
        """Kind of notice -> time of the last notice, number of omitted notices, last omitted message."""

    @property
    def age_s(self) -> float:
        """Age of the last sample in seconds, including its delay if known; infinite before the first one."""
        return time.monotonic() - self._sent_s

    def run(self, blocks: Iterable[Block]) -> Iterator[Update | Notice]:
        """Yield events, answers and notices until the blocks end, then close their source."""
        with closing(blocks) if isinstance(blocks, Generator) else nullcontext():
            for block in blocks:
                yield from self.push(block)
            yield from self.finish()

    def push(self, block: Block) -> tuple[Update | Notice, ...]:
        """Process a block and return its events, answers and notices in chronological order.

        Raises
        ------
        ValueError
            If the number of columns differs from that in training.
        RecordingError
            If the rate of the sensor is too low for the features of the model.
        """
        updates: list[Update | Notice] = []
        for flag in block.flags:
            updates += self._limit(block.t_s, flag)
        if not len(block.samples):
            return (*updates, *self._interrupt(block.n_lost))
        self._sent_s = time.monotonic() - block.age_s
        if self.recogniser is None or (block.fs, block.unit) != self._fs_and_unit:
            updates += self._start(block)
        assert self.recogniser is not None
        updates += self._interrupt(block.n_lost)
        rows = block.samples.reshape(len(block.samples), -1)
        segments, n_invalid, n_glitches = self._repair.repair(rows)
        self.n_lost += n_invalid + n_glitches
        if n_invalid:
            updates += self._limit(block.t_s, f"not finite: {n_invalid} samples left out")
        if n_glitches:
            limit = f"{self._repair.max_step:.3g} {block.unit}"
            updates += self._limit(
                block.t_s,
                f"glitch: {n_glitches} samples left out, because steps above {limit} are far larger than "
                "those in the training set",
            )
        for n_missing, samples in segments:
            if n_missing:
                updates += self.recogniser.interrupt(n_missing)
            new = self.recogniser.push(samples)
            updates += new
            for update in new:
                updates += self._notices_about(block.t_s, update)
        return tuple(updates)

    def _notices_about(self, t_s: float, update: Update) -> list[Notice]:
        """Return notices if the noise floor or the features have changed, or the evidence has restarted."""
        notices = self._follow_drift(t_s, update)
        if isinstance(update, Event):
            is_noise = update.kind == "lift-off" and update.message
            return notices + self._limit(t_s, f"noise: {update.message}") if is_noise else notices
        verdict = update.verdict
        if not verdict.previous_surface:
            return notices
        return notices + self._limit(
            t_s,
            f"surface: the last windows indicate {verdict.surface}, not {verdict.previous_surface}: the "
            "evidence restarts",
        )

    def _follow_drift(self, t_s: float, update: Update) -> list[Notice]:
        """Return a notice about drift after a contact, and replace the model if it was adapted."""
        assert self.recogniser is not None
        message = ""
        if isinstance(update, Event):
            if update.kind in ("lift-off", "break"):
                message = self._monitor.end_contact()
        elif self._has_trained_length and update.stop - update.start >= self.recogniser.min_samples:
            message = self._monitor.add(update)
        self._replace_model()
        return self._limit(t_s, message) if message else []

    def _replace_model(self) -> None:
        if self.model is not self._monitor.model and self.recogniser is not None:
            self.model = self._monitor.model
            self.recogniser.replace_model(self.model)

    def _interrupt(self, n_lost: int) -> tuple[Update, ...]:
        self.n_lost += n_lost
        return self.recogniser.interrupt(n_lost) if n_lost and self.recogniser else ()

    def finish(self) -> tuple[Update | Notice, ...]:
        """End the stream and return a summary of the omitted notices, and the remaining answers."""
        counts = self._notice_counts.values()
        notices = [Notice(t_s, f"{message} ({n} similar)") for t_s, n, message in counts if n]
        self._notice_counts.clear()
        updates = self.recogniser.finish() if self.recogniser else ()
        t_s = self.start_s + (self.recogniser.n_samples / self.recogniser.fs if self.recogniser else 0.0)
        for update in updates:
            notices += self._follow_drift(t_s, update)
        if message := self._monitor.end_contact(is_last=True):
            notices.append(Notice(t_s, message))
        return (*notices, *updates)

    def _limit(self, t_s: float, message: str) -> list[Notice]:
        """Return a notice, or nothing if the last one of its kind was less than 5 s ago."""
        kind = message.partition(":")[0]
        last_s, n_omitted, _ = self._notice_counts.get(kind, (-math.inf, 0, ""))
        if abs(t_s - last_s) < 5.0:
            self._notice_counts[kind] = (last_s, n_omitted + 1, message)
            return []
        self._notice_counts[kind] = (t_s, 0, "")
        return [Notice(t_s, message + f" ({n_omitted} similar since the last notice)" * (n_omitted > 0))]

    def _start(self, block: Block) -> list[Update | Notice]:
        """Create the recogniser, or a new one after a change of rate or unit."""
        updates: list[Update | Notice] = []
        if self.recogniser is not None:
            updates += self.recogniser.finish()
            updates += self._limit(block.t_s, f"restart: the stream now is in {block.unit}, {block.fs:g} Hz")
        self._fs_and_unit = (block.fs, block.unit)
        self.recogniser = OnlineRecogniser(
            self.model, fs=block.fs, unit=block.unit, raw=self.raw, settings=self.settings
        )
        self.start_s = block.t_s
        n_axes = self.model.input_columns.n_axes(block.samples[0].size)
        scale = scale_of(self.model, block.unit, self.raw)
        self._repair = SampleRepair(self.model, n_axes, block.fs, scale)
        window_s, trained_s = self.recogniser.window / block.fs, self.model.manifest.shortest_s or 0.0
        # Features depend on the length, so windows of another length differ from the training set.
        expected_s = self.model.manifest.window_s or trained_s
        self._has_trained_length = math.isclose(window_s, expected_s, rel_tol=0.01)
        if self._monitor.adapts and not self._has_trained_length:
            message = f"not adapted: windows of {window_s:g} s, trained on {expected_s:g} s"
            updates += self._limit(block.t_s, f"{message}. Train with 'texclass train --window {window_s:g}'")
        is_shortened = window_s == LONG_RECORDING_WINDOW_S < LONGEST_WINDOW_S < trained_s
        if is_shortened and self.model.manifest.window_s is None:
            updates += self._limit(
                block.t_s,
                f"window: {window_s:g} s, but the training recordings have {trained_s:.3g} s or more, so "
                f"the confidence is not calibrated. Train with 'texclass train --window {window_s:g}'",
            )
        unit = "m/s^2" if block.unit in ACCELERATION_UNITS else block.unit
        for difference in self.model.rate_and_unit_problems(block.fs, unit):
            updates += self._limit(block.t_s, difference)
        if reasons := self.model.bandwidth_problems(block.native_fs or block.fs):
            raise RecordingError(f"cannot classify the source: {reasons[0]}")
        return updates


def listen(
    model: Model | str | Path,
    source: str | Recording | Iterable[Block] = "-",
    *,
    fs: float | None = None,
    unit: str | None = None,
    resample: float | None = None,
    paced: bool = False,
    raw_channels: int | None = None,
    settings: OnlineSettings | None = None,
    adapt: bool = False,
) -> Iterator[Update | Notice]:
    """Classify a live stream: yield events, answers and notices as soon as they are available.

    Parameters
    ----------
    model : Model, str or Path
        Trained model, or path of a model file.
    source : str, Recording, or iterable of Block
        Recording, or name of a source: "-" (standard input), "FILE", "DATASET:RECORDING",
        "bag:FILE?topic=/name" or "ros2:/topic"; see `open_source`. Alternatively, blocks whose samples have
        the scale and unit of the training recordings.
    fs, unit, paced, raw_channels : optional
        See `open_source`.
    resample : float, optional
        Rate in Hz to which the stream is resampled, usually that of the model (default: its own rate).
    settings : OnlineSettings, optional
        Settings of the recognition.
    adapt : bool
        Whether the model is adapted to the last contacts without labels (default False); see `Session`.

    Yields
    ------
    Update or Notice
        Events (such as taps, contacts and lift-offs), answers and notices in chronological order.

    Raises
    ------
    RecordingError, ValueError
        If the source cannot be opened (see `open_source`), or a block is invalid (see `Session.push`).

    Examples
    --------
    >>> for update in listen("surfaces.skops", "new/oak/oak_07.txt"):  # doctest: +SKIP
    ...     print(update)
    """
    trained = model if isinstance(model, Model) else load_model(model)
    if not isinstance(source, str | Recording):
        return Session(trained, settings=settings, adapt=adapt).run(source)
    blocks = open_source(
        source, fs=fs, unit=unit, rate=resample, paced=paced, raw_channels=raw_channels, model=trained
    )
    return Session(trained, raw=is_live(source), settings=settings, adapt=adapt).run(blocks)
