"""Classify the messages of a sensor topic, independent of the library that receives and sends them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from texclass.loaders.plausibility import CLIPPED_SHARE, clipped_share
from texclass.loaders.timestamps import TIMESTAMPS, Timestamps
from texclass.recognition import (
    Block,
    BlockAssembler,
    ContactVerdict,
    Event,
    Model,
    Notice,
    OnlineSettings,
    Session,
)
from texclass.recognition.live.online_recogniser import Update
from texclass.recording import RecordingError, Samples
from texclass.robot.answer_messages import (
    ERROR,
    OK,
    WARN,
    Make,
    answer_message,
    diagnostics_message,
    event_message,
    status_message,
    surface_status,
)
from texclass.robot.ros_messages import (
    TYPES,
    MessageError,
    live_signals,
    multi_array_samples,
    stamped_samples,
)


class SampleClock(NamedTuple):
    """Time stamps of the samples of a stream, from the time stamp of its last block.

    Attributes
    ----------
    end_s : float
        Time stamp one period after the last sample, in seconds.
    n_samples : int
        Number of samples so far.
    fs : float
        Sampling rate in Hz.

    Examples
    --------
    >>> SampleClock(end_s=10.0, n_samples=5000, fs=1000.0).time_of(4500)
    9500000000
    """

    end_s: float
    n_samples: int
    fs: float

    def time_of(self, sample: int) -> int:
        """Return the time stamp of a sample in nanoseconds."""
        return round(1e9 * (self.end_s - (self.n_samples - sample) / self.fs))


@dataclass
class Period:
    """Counts and samples since the last diagnostics.

    Attributes
    ----------
    start_s : float
        Time stamp from which the rate is measured, in seconds; NaN before the first message.
    n_missing, n_invalid : int
        Numbers of missing and of invalid samples at the start of the period.
    n_before : int
        Number of samples in `samples` up to `start_s`.
    samples : list of ndarray of shape (n, k, n_channels)
        Samples of the messages.
    notices : list of str
        Faults of the stream.
    """

    start_s: float
    n_missing: int
    n_invalid: int
    n_before: int = 0
    samples: list[Samples] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)

    def rate(self, stop_s: float) -> float:
        """Return the number of samples per second until the time stamp `stop_s`; NaN if unknown."""
        n = sum(samples.shape[0] * samples.shape[1] for samples in self.samples) - self.n_before
        return n / (stop_s - self.start_s) if stop_s > self.start_s else math.nan

    def clipped_share(self) -> float:
        """Return the largest fraction of clipped samples of any channel."""
        if not self.samples:
            return 0.0
        rows = np.concatenate([samples.reshape(-1, samples.shape[2]) for samples in self.samples])
        rows = rows[np.isfinite(rows).all(axis=1)]
        varying = rows[:, np.ptp(rows, axis=0) > 0] if len(rows) > 1 else rows[:, :0]
        return max(map(clipped_share, varying.T), default=0.0)


class Output(NamedTuple):
    """Messages and notices that result from the messages of a sensor.

    Attributes
    ----------
    answers : list
        `texclass_msgs/SurfaceAnswer` messages.
    events : list
        `texclass_msgs/ContactEvent` messages.
    notices : list of str
        Faults of the stream.
    """

    answers: list[Any]
    events: list[Any]
    notices: list[str]


class MessageClassifier:
    """Recognition in the messages of a sensor topic, with diagnostics.

    The recognition itself is `Session`. An error, such as a sampling rate that is too low for the model, ends
    the recognition; the diagnostics then report it.

    Parameters
    ----------
    model : Model
        Trained model.
    make : callable
        Function that creates a message, see `texclass.robot.answer_messages.Make`.
    type_name : str
        Message type of the sensor (default "sensor_msgs/msg/Imu").
    topic : str
        Topic of the sensor, which messages and diagnostics name.
    fs : float, optional
        Sampling rate in Hz (default: measured over the first second).
    unit : str, optional
        Unit of the acceleration in a Float64MultiArray (default: as in training).
    frame : str
        Frame in the headers of the answers (default: that of the sensor messages).
    settings : OnlineSettings, optional
        Settings of the recognition.
    adapt : bool
        Whether to adapt the model to drift, see `Session` (default False).

    Raises
    ------
    RecordingError
        If the message type has no acceleration or lacks a signal that the model needs, or `unit` is not its
        unit.

    Examples
    --------
    >>> classifier = MessageClassifier(model, make, topic="/imu")  # doctest: +SKIP
    >>> classifier.push(message, receipt_ns=time.time_ns())  # doctest: +SKIP
    >>> classifier.process().answers  # doctest: +SKIP
    """

    def __init__(
        self,
        model: Model,
        make: Make,
        *,
        type_name: str = "sensor_msgs/msg/Imu",
        topic: str = "imu",
        fs: float | None = None,
        unit: str | None = None,
        frame: str = "",
        settings: OnlineSettings | None = None,
        adapt: bool = False,
    ) -> None:
        self._make, self._topic, self._type_name, self._frame = make, topic, type_name, frame
        default_unit = None if type_name in TYPES else model.manifest.input.unit
        self._columns, unit = live_signals(type_name, model.input_columns, unit or default_unit, topic)
        self._expected_fs = fs or model.manifest.fs
        self._assembler = BlockAssembler(fs, unit)
        self._session = Session(model, settings=settings, adapt=adapt)
        self._clock = self._previous_clock = SampleClock(0.0, 0, 1.0)
        self._waiting, self._receipts = list[Any](), list[int]()
        self._array_shape: tuple[int, ...] = ()
        self._last_verdict: ContactVerdict | None = None
        self._last_stamp_s, self._drift = math.nan, ""
        self._n_interrupted = 0
        self._start_period()
        self.problem = ""
        """Error that ended the recognition, or ""."""

    def _start_period(self) -> None:
        """Start to count for the next diagnostics."""
        self._period = Period(self._last_stamp_s, self._assembler.n_lost, self._n_invalid)

    @property
    def _n_invalid(self) -> int:
        """Number of invalid samples. The session also counts missing samples that end a contact."""
        return self._session.n_lost - self._n_interrupted

    def push(self, message: Any, receipt_ns: int) -> None:
        """Store a message of the sensor until the next call of `process`.

        Parameters
        ----------
        message : object
            Message with the fields of its type as attributes.
        receipt_ns : int
            Time of receipt in nanoseconds.
        """
        self._waiting.append(message)
        self._receipts.append(receipt_ns)

    def process(self) -> Output:
        """Classify the stored messages and return the results in chronological order."""
        output = Output([], [], [])
        messages, receipt_ns = self._waiting, np.array(self._receipts, np.int64)
        self._waiting, self._receipts = [], []
        if not messages or self.problem:
            return output
        try:
            stamps_ns, samples, is_valid = self._decode(messages)
            receipt_ns = receipt_ns[is_valid]
            if n_damaged := len(messages) - len(receipt_ns):
                output.notices.append(f"damaged: {n_damaged} messages left out")
            if len(receipt_ns):
                stamps_ns = np.where(stamps_ns == 0, receipt_ns, stamps_ns)
                if math.isnan(self._last_stamp_s):  # the rate is measured from the first message on
                    self._period.start_s, self._period.n_before = stamps_ns[0] / 1e9, samples.shape[1]
                self._period.samples.append(samples)
                self._last_stamp_s = float(stamps_ns[-1]) / 1e9
                for block in self._assembler.push(stamps_ns, receipt_ns, samples):
                    self._push_block(block, output)
        except (RecordingError, ValueError) as error:
            self.problem = f"{self._topic}: {error}"
            output.notices.append(f"{self.problem}. The recognition has ended")
        self._period.notices += output.notices
        return output

    def finish(self) -> Output:
        """End the recognition and return the remaining answers, including one for a last, short contact."""
        output = self.process()
        if not self.problem:
            self._add(output, self._session.finish())
        return output

    def _decode(self, messages: list[Any]) -> tuple[Timestamps, Samples, NDArray[np.bool_]]:
        """Return time stamps, samples (n, k, n_channels) and a mask of the valid messages."""
        if self._type_name in TYPES:
            self._frame = self._frame or messages[-1].header.frame_id
            stamps_ns, rows = stamped_samples(TYPES[self._type_name], messages, self._columns)
            return stamps_ns, rows[:, None, :], np.ones(len(messages), bool)
        arrays = []
        for message in messages:
            try:
                arrays.append(multi_array_samples(message))
            except MessageError:
                arrays.append(np.empty((0, 0)))
        self._array_shape = self._array_shape or next((a.shape for a in arrays if a.size), ())
        valid = [array for array in arrays if array.shape == self._array_shape]
        samples = np.stack(valid) if valid else np.empty((0, 1, 1))
        is_valid = np.array([array.shape == self._array_shape for array in arrays])
        return np.zeros(len(valid), np.int64), samples, is_valid

    def _push_block(self, block: Block, output: Output) -> None:
        self._n_interrupted += block.n_lost
        previous = self._session.recogniser
        updates = self._session.push(block)
        recogniser = self._session.recogniser
        if recogniser is not None and len(block.samples):
            if recogniser is not previous:
                self._previous_clock = self._clock
            end_s = block.t_s + len(block.samples) / block.fs
            self._clock = SampleClock(end_s, recogniser.n_samples, block.fs)
        self._add(output, updates)

    def _add(self, output: Output, updates: Sequence[Update | Notice]) -> None:
        """Add the messages for updates of the session to the output."""
        for update in updates:
            if isinstance(update, Notice):
                output.notices.append(update.message)
                if update.message.startswith("drift:"):
                    self._drift = update.message
                continue
            # A change of the rate restarts the recogniser, and the first updates are those of the old one.
            is_old = update.n_received > self._clock.n_samples
            time_of = (self._previous_clock if is_old else self._clock).time_of
            if isinstance(update, Event):
                output.events.append(event_message(self._make, update, time_of, self._frame))
            else:
                self._last_verdict = update.verdict
                output.answers.append(answer_message(self._make, update, time_of, self._frame))

    def diagnostics(self, now_ns: int) -> Any:
        """Return a `diagnostic_msgs/DiagnosticArray` for the time since the last call.

        The level of the input is ERROR if no messages arrive or the recognition has ended, and WARN if the
        sampling rate differs from the expected one by more than `TIMESTAMPS.near_rate`, samples are missing
        or invalid, or the signal is clipped.

        Parameters
        ----------
        now_ns : int
            Current time in nanoseconds.
        """
        statuses = [
            self._input_status(now_ns),
            surface_status(self._make, "texclass: surface", self._last_verdict),
            status_message(
                self._make, "texclass: drift", WARN if self._drift else OK, self._drift or "no drift", {}
            ),
        ]
        self._start_period()
        return diagnostics_message(self._make, statuses, now_ns)

    def _input_status(self, now_ns: int) -> Any:
        period, n_missing, n_invalid = self._period, self._assembler.n_lost, self._n_invalid
        rate, share = period.rate(self._last_stamp_s), period.clipped_share()
        rate_text = f"{rate:.4g} Hz instead of {self._expected_fs:.4g} Hz"
        faults = {
            rate_text: abs(rate / self._expected_fs - 1) > TIMESTAMPS.near_rate,
            f"{n_missing - period.n_missing} samples missing": n_missing > period.n_missing,
            f"{n_invalid - period.n_invalid} samples invalid": n_invalid > period.n_invalid,
            f"{100 * share:.1f} % of the samples clipped": share >= CLIPPED_SHARE,
        }
        problems = [text for text, is_fault in faults.items() if is_fault] + period.notices
        level, message = WARN if problems else OK, "; ".join(problems) or "ok"
        if self.problem or not period.samples:
            level, message = ERROR, self.problem or "no messages"
        age_s = now_ns / 1e9 - self._last_stamp_s
        values = {
            "expected sampling rate (Hz)": round(self._expected_fs, 3),
            "measured sampling rate (Hz)": round(rate, 3) if math.isfinite(rate) else "unknown",
            "missing samples, in total": n_missing,
            "invalid samples, in total": n_invalid,
            "clipped samples (%)": round(100 * share, 3),
            "age of the last sample (s)": round(age_s, 3) if math.isfinite(age_s) else "unknown",
        }
        return status_message(self._make, "texclass: input", level, message, values, self._topic)
