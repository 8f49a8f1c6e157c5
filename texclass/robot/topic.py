"""ROS 2 topics as sources of blocks, received over DDS without ROS (extra `robot`)."""

import math
import time
from contextlib import closing
from dataclasses import replace
from typing import Any, NamedTuple, Self

import numpy as np
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import InstanceState, Policy, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from numpy.typing import NDArray

from texclass.loaders.columns import TURN_RATE
from texclass.recognition.sources.blocks import Block, BlockAssembler, BlockSource
from texclass.recognition.sources.training_input import ACCELERATION_ONLY, InputColumns
from texclass.recording import RecordingError, Samples
from texclass.robot.dds import (
    DEPTH,
    Reliability,
    dds_topic,
    message_class,
    participant,
    quality,
    ros_type,
)
from texclass.robot.ros_messages import (
    LIVE,
    MULTI_ARRAY,
    TYPES,
    MessageError,
    decode_multi_array,
    decode_stamped,
    live_signals,
)

MAX_MESSAGES = 4096
"""Largest number of messages that are read at once; the limit bounds the memory."""
SILENCE_S = 1.0
"""Time without messages (s) after which an empty block reports the silence."""
ZERO_TURN_RATE_S = 1.0
"""Duration (s) of a turn rate of exactly 0 after which a block reports it, because gyroscopes have noise."""


class MessageBatch(NamedTuple):
    """Messages that were read together.

    Attributes
    ----------
    timestamps_ns : ndarray of shape (n,)
        Time stamps of the headers in nanoseconds, or times of sending for messages without a time stamp.
    sent_ns : ndarray of shape (n,)
        Times of sending in nanoseconds, according to the clock of the publisher.
    samples : ndarray of shape (n, k, n_channels)
        Samples of the n messages, which have k samples each.
    n_damaged : int
        Number of messages that could not be decoded and are omitted.
    """

    timestamps_ns: NDArray[np.int64]
    sent_ns: NDArray[np.int64]
    samples: Samples
    n_damaged: int = 0


def topic_blocks(
    topic: str,
    *,
    fs: float | None = None,
    unit: str | None = None,
    type_name: str | None = None,
    reliability: Reliability | None = None,
    depth: int = DEPTH,
    domain: int | None = None,
    wait_s: float = 10.0,
    end_s: float | None = None,
    columns: InputColumns = ACCELERATION_ONLY,
) -> BlockSource:
    """Return the acceleration of a ROS 2 topic as blocks, with the turn rate if the model needs it.

    Flags of the blocks report, for example, one second of silence, a turn rate of exactly 0 for one second,
    and several publishers of the topic.

    Parameters
    ----------
    topic : str
        Name of the topic, such as "/imu/data".
    fs : float, optional
        Sampling rate in Hz (default: measured over the first second).
    unit : str, optional
        Unit of the acceleration; required if the message type does not define it.
    type_name : str, optional
        Message type, such as "sensor_msgs/msg/Imu" (default: that of the publisher).
    reliability : str, optional
        "reliable" or "best effort" (default: "reliable" if every publisher offers it).
    depth : int
        Queue length in messages.
    domain : int, optional
        DDS domain (default: $ROS_DOMAIN_ID, or 0).
    wait_s : float
        Time to wait for the first publisher, in seconds.
    end_s : float, optional
        Time without messages after which the source ends, in seconds (default: never).
    columns : InputColumns
        Columns that the model needs. A Float64MultiArray must have them in this order.

    Returns
    -------
    blocks : BlockSource
        Generator of blocks.

    Raises
    ------
    RecordingError
        If there is no publisher, its message type cannot be read or lacks a signal that the model needs, or
        `unit` is not the unit of the type.
    ValueError
        If the reliability, depth or domain is invalid.

    Examples
    --------
    Publish and receive 200 samples in one process, with the loopback interface:

    >>> from texclass.robot import ImuPublisher, topic_blocks
    >>> publisher = ImuPublisher("/imu")  # doctest: +SKIP
    >>> for block in topic_blocks("/imu", fs=1000):  # doctest: +SKIP
    ...     print(block.t_s, block.samples.shape, block.flags)
    """
    if reliability not in (None, "reliable", "best effort"):
        raise ValueError(
            f"ros2:{topic}: reliability must be 'reliable' or 'best effort', got {reliability!r}"
        )
    if depth < 1:
        raise ValueError(f"ros2:{topic}: depth must be at least 1 message, got {depth}")
    if type_name is None or reliability is None:
        publishers = discover(topic, domain=domain, timeout_s=wait_s)
        if not publishers:
            raise RecordingError(
                f"ros2:{topic}: no publisher within {wait_s:g} s. Check the topic with `ros2 topic list`, "
                "and the domain (--domain)"
            )
        type_name = type_name or publishers[0][0]
        are_reliable = all(offer == "reliable" for _, offer in publishers)
        reliability = reliability or ("reliable" if are_reliable else "best effort")
    names, unit = live_signals(type_name, columns, unit, f"ros2:{topic}")
    subscriber = Subscriber(
        topic, type_name, reliability=reliability, depth=depth, domain=domain, columns=names
    )
    blocks = _read_blocks(subscriber, BlockAssembler(fs, unit), end_s)
    turn_columns = [subscriber.columns.index(name) for name in TURN_RATE if name in subscriber.columns]
    return _check_turn_rate(blocks, turn_columns) if turn_columns else blocks


def discover(
    topic: str, *, domain: int | None = None, timeout_s: float = 5.0
) -> list[tuple[str, Reliability]]:
    """Wait for a publisher of a ROS 2 topic; return message type and reliability of each publisher.

    Parameters
    ----------
    topic : str
        Name of the topic, such as "/imu/data".
    domain : int, optional
        DDS domain (default: $ROS_DOMAIN_ID, or 0).
    timeout_s : float
        Time to wait in seconds.

    Returns
    -------
    list of (str, {"reliable", "best effort"})
        Message type and reliability of each publisher; empty if there is none within this time.

    Examples
    --------
    >>> from texclass.robot import discover
    >>> discover("/no_such_topic", timeout_s=0.01)
    []
    """
    member = participant(domain)
    reader = BuiltinDataReader(member, BuiltinTopicDcpsPublication)
    end = time.monotonic() + timeout_s
    while True:
        endpoints = [endpoint for endpoint in reader.read(1000) if endpoint.topic_name == dds_topic(topic)]
        if endpoints or time.monotonic() >= end:
            reliable = Policy.Reliability.Reliable
            return [
                (
                    ros_type(endpoint.type_name),
                    "reliable" if isinstance(endpoint.qos[Policy.Reliability], reliable) else "best effort",
                )
                for endpoint in endpoints
            ]
        time.sleep(0.02)


class Subscriber:
    """Subscriber of a ROS 2 topic; publishers may start, stop and restart.

    Parameters
    ----------
    topic : str
        Name of the topic, such as "/imu/data".
    type_name : str
        Message type: "sensor_msgs/msg/Imu", "geometry_msgs/msg/AccelStamped" or
        "std_msgs/msg/Float64MultiArray".
    reliability : str
        "best effort" receives from all publishers, without retransmission; "reliable" receives from reliable
        publishers only.
    depth : int
        Queue length in messages.
    domain : int, optional
        DDS domain (default: $ROS_DOMAIN_ID, or 0).
    columns : tuple of str, optional
        Columns to read from each message (default: those of the acceleration).

    Raises
    ------
    ValueError
        If the message type cannot be decoded or lacks a column.

    Examples
    --------
    >>> from texclass.robot import Subscriber
    >>> subscriber = Subscriber("/imu")
    >>> subscriber.columns, subscriber.n_publishers
    (('ax', 'ay', 'az'), 0)
    >>> subscriber.close()
    """

    def __init__(
        self,
        topic: str,
        type_name: str = "sensor_msgs/msg/Imu",
        *,
        reliability: Reliability = "best effort",
        depth: int = DEPTH,
        domain: int | None = None,
        columns: tuple[str, ...] = (),
    ) -> None:
        if type_name not in LIVE:
            raise ValueError(f"{topic}: type_name must be one of {', '.join(LIVE)}, got {type_name!r}")
        names = TYPES[type_name].columns if type_name in TYPES else {}
        if unknown := set(columns) - set(names):
            raise ValueError(
                f"{topic}: {type_name} has no columns {', '.join(sorted(unknown))}. Expected some of "
                f"{', '.join(names) or 'none'}"
            )
        self.topic, self.type_name = topic, type_name
        self.columns = columns or (TYPES[type_name].acceleration if type_name in TYPES else ())
        self._participant = participant(domain)
        qos = quality(reliability, depth)
        dds = Topic(self._participant, dds_topic(topic), message_class(type_name), qos=qos)
        dds.data_type = _RawMessage
        self._reader = DataReader(self._participant, dds, qos=qos)
        self._waitset = WaitSet(self._participant)
        self._condition = ReadCondition(self._reader, ViewState.Any | InstanceState.Any | SampleState.NotRead)
        self._waitset.attach(self._condition)

    @property
    def n_publishers(self) -> int:
        """Number of connected publishers."""
        return len(self._reader.get_matched_publications())

    def publishers(self) -> list[str]:
        """Return the sorted identifiers (GIDs) of the publishers, as in `ros2 topic info --verbose`."""
        handles = self._reader.get_matched_publications()
        endpoints = [self._reader.get_matched_publication_data(handle) for handle in handles]
        return sorted(endpoint.key.hex for endpoint in endpoints if endpoint is not None)

    @property
    def n_lost(self) -> int:
        """Number of messages that DDS reports as lost: overwritten in the queue, or lost on the network."""
        return int(self._reader.get_sample_lost_status().total_count)

    def status(self) -> str:
        """Return the state of the connection in words, as a possible reason for silence."""
        if self.n_publishers:
            return "a publisher is connected"
        if self._reader.get_requested_incompatible_qos_status().total_count:
            return "the publisher does not offer the requested quality of service (try 'best effort')"
        return "no publisher is connected"

    def take(self, timeout_s: float = 0.1) -> MessageBatch | None:
        """Return the messages that have arrived; if there are none, wait for the first one.

        Parameters
        ----------
        timeout_s : float
            Time to wait in seconds.

        Returns
        -------
        batch : MessageBatch or None
            The messages; None if no message arrived in time.

        Raises
        ------
        RecordingError
            If the messages declare a column as not measured.
        """
        messages = self._reader.take(MAX_MESSAGES)
        if not messages:
            self._waitset.wait(duration(seconds=timeout_s))
            messages = self._reader.take(MAX_MESSAGES)
        valid = [message for message in messages if message.sample_info.valid_data]
        if not valid:
            return None
        sent_ns = [message.sample_info.source_timestamp for message in valid]
        try:
            return decode_messages([message.data for message in valid], sent_ns, self.type_name, self.columns)
        except RecordingError as error:
            raise RecordingError(f"ros2:{self.topic}: {error}") from error

    def close(self) -> None:
        """Disconnect from the domain."""
        self._waitset = self._condition = self._reader = self._participant = None


class _RawMessage:
    """Data type that keeps a message as bytes, because decoding many messages together is faster."""

    __slots__ = ("data", "sample_info")

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.sample_info: Any = None  # metadata of DDS, which the reader sets

    @classmethod
    def deserialize(cls, data: bytes) -> Self:
        return cls(data)

    deserialize_key = deserialize


def decode_messages(
    messages: list[bytes], sent_ns: list[int], type_name: str, columns: tuple[str, ...]
) -> MessageBatch | None:
    """Decode messages together, or one by one if any is damaged.

    Parameters
    ----------
    messages : list of bytes
        Serialised messages, at least one.
    sent_ns : list of int
        Times of sending in nanoseconds.
    type_name : str
        Message type, one of `LIVE`.
    columns : tuple of str
        Columns to return, for types with a header.

    Returns
    -------
    batch : MessageBatch or None
        The valid messages; None if all are damaged. Messages that differ in size from the first valid one
        count as damaged.

    Raises
    ------
    RecordingError
        If the messages declare a column as not measured.
    """
    valid = list(range(len(messages)))
    try:
        timestamps, samples = _decode(messages, type_name, columns)
    except MessageError:
        shapes = [_shape(message, type_name) for message in messages]
        first_shape = next(filter(None, shapes), None)
        valid = [i for i, shape in enumerate(shapes) if shape is not None and shape == first_shape]
        if not valid:
            return None
        timestamps, samples = _decode([messages[i] for i in valid], type_name, columns)
    valid_sent_ns = np.array([sent_ns[i] for i in valid], np.int64)
    timestamps_ns = (
        valid_sent_ns if timestamps is None else np.where(timestamps == 0, valid_sent_ns, timestamps)
    )
    return MessageBatch(timestamps_ns, valid_sent_ns, samples, len(messages) - len(valid))


def _shape(message: bytes, type_name: str) -> tuple[int, ...] | None:
    """Return the shape of the samples of a message; None if it is damaged."""
    try:
        return _decode([message], type_name, ())[1].shape[1:]
    except MessageError:
        return None


def _decode(
    messages: list[bytes], type_name: str, columns: tuple[str, ...]
) -> tuple[NDArray[np.int64] | None, Samples]:
    if type_name == MULTI_ARRAY:
        arrays = [decode_multi_array(message, ros1=False) for message in messages]
        if len({array.shape for array in arrays}) > 1:
            raise MessageError(f"{type_name}: messages differ in size. Expected equal sizes")
        return None, np.stack(arrays)
    timestamps, samples = decode_stamped(TYPES[type_name], messages, columns, ros1=False)
    return timestamps, samples[:, None, :]


def _read_blocks(subscriber: Subscriber, assembler: BlockAssembler, end_s: float | None) -> BlockSource:
    """Yield blocks as messages arrive, with flags for silence, lost messages and several publishers."""
    last_message_s, last_check_s, is_silent = time.monotonic(), -math.inf, False
    n_lost, stop_s = 0, 0.0
    flags, publishers = list[str](), list[str]()
    with closing(subscriber):
        while True:
            batch = subscriber.take(0.1)
            silence_s = time.monotonic() - last_message_s
            if batch is None:
                if end_s is not None and silence_s >= end_s:
                    return
                if silence_s >= SILENCE_S and not is_silent:
                    is_silent = True
                    flag = f"silence: no message for {silence_s:.1f} s, {subscriber.status()}"
                    yield Block(stop_s, np.empty((0, 3)), assembler.fs or 0.0, assembler.unit, 0, (flag,))
                continue
            last_message_s, is_silent = time.monotonic(), False
            if batch.n_damaged:
                flags.append(f"damaged: {batch.n_damaged} messages left out")
            if last_message_s - last_check_s >= SILENCE_S:
                last_check_s, last_publishers = last_message_s, publishers
                publishers = subscriber.publishers()
                if len(publishers) > 1 and publishers != last_publishers:
                    flags.append(
                        f"publishers: the samples of {len(publishers)} publishers are mixed "
                        f"({', '.join(publishers)}). Expected one publisher"
                    )
            if subscriber.n_lost > n_lost:
                flags.append(f"lost: {subscriber.n_lost - n_lost} messages on the network")
                n_lost = subscriber.n_lost
            for block in assembler.push(batch.timestamps_ns, batch.sent_ns, batch.samples):
                stop_s = block.t_s + len(block.samples) / block.fs
                age_s = max(0.0, (time.time_ns() - int(batch.sent_ns[-1])) / 1e9)
                yield replace(block, flags=(*flags, *block.flags), age_s=age_s)
                flags.clear()


def _check_turn_rate(blocks: BlockSource, turn_columns: list[int]) -> BlockSource:
    """Yield blocks, with a flag if the turn rate stays exactly 0, as from a driver without a gyroscope."""
    zero_s = 0.0
    with closing(blocks):
        for block in blocks:
            flags: tuple[str, ...] = ()
            if zero_s < ZERO_TURN_RATE_S and len(block.samples):
                zero_s += len(block.samples) / block.fs
                if block.samples[:, turn_columns].any():
                    zero_s = math.inf
                elif zero_s >= ZERO_TURN_RATE_S:
                    flags = (
                        f"turn rate: 0 for the first {ZERO_TURN_RATE_S:g} s. Check that the sensor measures "
                        "it",
                    )
            yield replace(block, flags=(*flags, *block.flags))
