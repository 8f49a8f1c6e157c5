"""A ROS 2 topic as a source of blocks, heard over DDS without ROS (extra `robot`)."""

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
from texclass.recognition.sources.blocks import Block, BlockSource, Timing
from texclass.recognition.sources.training_input import ACCELERATION_ONLY, Needs
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
    MULTI_ARRAY,
    TYPES,
    MessageError,
    decode_multi_array,
    decode_stamped,
)

SIGNALS = ("sensor_msgs/msg/Imu", "geometry_msgs/msg/AccelStamped", MULTI_ARRAY)
"""Types that can be subscribed to."""
MOST_AT_ONCE = 4096
"""Messages taken at a time."""
SILENT_S = 1.0
"""After so many seconds without a message an empty block says so."""
UNTURNED_S = 1.0
"""After so many seconds of a turn rate of exactly 0 a block says so."""


class Received(NamedTuple):
    """Messages that arrived together.

    Attributes
    ----------
    stamps_ns : ndarray of shape (n,)
        Of the headers; when sent, for messages without header or stamp.
    sent_ns : ndarray of shape (n,)
        When each was sent, by the clock of the publisher.
    samples : ndarray of shape (n, k, n_channels)
        k samples a message.
    n_bad : int
        Messages that could not be decoded and are left out.
    """

    stamps_ns: NDArray[np.int64]
    sent_ns: NDArray[np.int64]
    samples: Samples
    n_bad: int = 0


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
    needs: Needs = ACCELERATION_ONLY,
) -> BlockSource:
    """Return the acceleration of a ROS 2 topic, and the turn rate where it is needed, as it arrives.

    A second of silence, a gyroscope that stands still for a second, and several publishers are told.

    Parameters
    ----------
    topic : str
        "/imu/data".
    fs : float, optional
        Sampling rate in Hz; by default measured over the first second.
    unit : str, optional
        Must be the one that the type of the messages states; needed if it states none.
    type_name : str, optional
        "sensor_msgs/msg/Imu"; by default what is published there.
    reliability : str, optional
        By default "reliable" if every publisher offers it, else "best effort".
    depth : int
        Messages kept until they are taken.
    domain : int, optional
        $ROS_DOMAIN_ID or 0 by default.
    wait_s : float
        How long to wait for a first publisher.
    end_s : float, optional
        End after so many seconds without a message; by default go on for ever.
    needs : Needs
        Columns that a model needs. An array of numbers is taken to have them in their order.

    Raises
    ------
    RecordingError
        If nobody publishes there, a type that cannot be read or lacks what is needed, or the unit is missing
        or contradicted.
    ValueError
        If the reliability, depth or domain is none.
    """
    if reliability not in (None, "reliable", "best effort") or depth < 1:
        raise ValueError(
            f"ros2:{topic}: reliability is {reliability!r}, depth {depth}. Expected 'reliable' or 'best "
            "effort', and 1 or more"
        )
    if type_name is None or reliability is None:
        offered = discover(topic, domain=domain, timeout_s=wait_s)
        if not offered:
            raise RecordingError(f"ros2:{topic}: nobody publishes there; waited {wait_s:g} s")
        type_name = type_name or offered[0][0]
        are_reliable = all(offer == "reliable" for _, offer in offered)
        reliability = reliability or ("reliable" if are_reliable else "best effort")
    if type_name not in SIGNALS:
        raise RecordingError(f"ros2:{topic}: carries {type_name!r}. Expected one of {', '.join(SIGNALS)}")
    columns, stated = (), "arbitrary"  # of an array of numbers
    if type_name in TYPES:
        type_ = TYPES[type_name]
        turn = TURN_RATE if "turn_rate" in needs.beside else ()
        for name in needs.beside:
            if name != "turn_rate" or not set(turn) <= set(type_.columns):
                raise RecordingError(f"ros2:{topic}: {type_name} has {needs.lacks(name)}")
        columns, stated = (*type_.acceleration, *turn), type_.unit or stated
    if stated != "arbitrary" and unit not in (None, stated):
        raise RecordingError(
            f"ros2:{topic}: unit is {stated!r} by its type, {unit!r} was given. Expected one"
        )
    subscriber = Subscriber(
        topic, type_name, reliability=reliability, depth=depth, domain=domain, columns=columns
    )
    blocks = _blocks(subscriber, Timing(fs, unit or stated), end_s)
    turned = [subscriber.columns.index(name) for name in TURN_RATE if name in subscriber.columns]
    return _doubted(blocks, turned) if turned else blocks


def discover(
    topic: str, *, domain: int | None = None, timeout_s: float = 5.0
) -> list[tuple[str, Reliability]]:
    """Return type and reliability that the publishers of a ROS 2 topic offer, as soon as there is one.

    Parameters
    ----------
    topic : str
        "/imu/data".
    domain : int, optional
        $ROS_DOMAIN_ID or 0 by default.
    timeout_s : float
        How long to wait.

    Returns
    -------
    list of (str, {"reliable", "best effort"})
        Empty if nobody publishes there within the time.
    """
    member = participant(domain)
    reader = BuiltinDataReader(member, BuiltinTopicDcpsPublication)
    end = time.monotonic() + timeout_s
    while True:
        found = [endpoint for endpoint in reader.read(1000) if endpoint.topic_name == dds_topic(topic)]
        if found or time.monotonic() >= end:
            reliable = Policy.Reliability.Reliable
            return [
                (
                    ros_type(endpoint.type_name),
                    "reliable" if isinstance(endpoint.qos[Policy.Reliability], reliable) else "best effort",
                )
                for endpoint in found
            ]
        time.sleep(0.02)


class Subscriber:
    """Hears a ROS 2 topic; a publisher may come, go and come back.

    Parameters
    ----------
    topic : str
        "/imu/data".
    type_name : str
        "sensor_msgs/msg/Imu", "geometry_msgs/msg/AccelStamped" or "std_msgs/msg/Float64MultiArray".
    reliability : str
        "best effort" hears everybody and loses what the network loses; "reliable" hears reliable publishers.
    depth : int
        Messages kept until they are taken.
    domain : int, optional
        $ROS_DOMAIN_ID or 0 by default.
    columns : tuple of str, optional
        Of the message; its acceleration by default.

    Raises
    ------
    ValueError
        If the type or a column is not one of those.
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
        if type_name not in SIGNALS:
            raise ValueError(f"{topic}: type is {type_name!r}. Expected one of {', '.join(SIGNALS)}")
        known = TYPES[type_name].columns if type_name in TYPES else {}
        if unknown := set(columns) - set(known):
            raise ValueError(f"{topic}: columns {sorted(unknown)}. Expected one of {', '.join(known)}")
        self.topic, self.type_name = topic, type_name
        self.columns = columns or (TYPES[type_name].acceleration if type_name in TYPES else ())
        self._participant = participant(domain)
        qos = quality(reliability, depth)
        heard = Topic(self._participant, dds_topic(topic), message_class(type_name), qos=qos)
        heard.data_type = _AsBytes
        self._reader = DataReader(self._participant, heard, qos=qos)
        self._waitset = WaitSet(self._participant)
        self._news = ReadCondition(self._reader, ViewState.Any | InstanceState.Any | SampleState.NotRead)
        self._waitset.attach(self._news)

    @property
    def n_publishers(self) -> int:
        """How many publishers are heard."""
        return len(self._reader.get_matched_publications())

    def publishers(self) -> list[str]:
        """Return who publishes, by the identifiers (GID) that `ros2 topic info --verbose` shows, sorted."""
        handles = self._reader.get_matched_publications()
        found = [self._reader.get_matched_publication_data(handle) for handle in handles]
        return sorted(endpoint.key.hex for endpoint in found if endpoint is not None)

    @property
    def n_lost(self) -> int:
        """Messages that DDS knows it has lost: overwritten before they were taken, or never arrived."""
        return int(self._reader.get_sample_lost_status().total_count)

    def whereabouts(self) -> str:
        """Return, in words, why nothing may arrive."""
        if self.n_publishers:
            return "its publisher is there"
        if self._reader.get_requested_incompatible_qos_status().total_count:
            return "its publisher does not offer what is asked for (reliable?)"
        return "its publisher is gone"

    def take(self, timeout_s: float = 0.1) -> Received | None:
        """Return what has arrived; wait if there is nothing yet.

        Parameters
        ----------
        timeout_s : float
            How long to wait.

        Returns
        -------
        received : Received or None
            None if nothing arrived in time.

        Raises
        ------
        RecordingError
            If the messages say that a column is not measured.
        """
        messages = self._reader.take(MOST_AT_ONCE)
        if not messages:
            self._waitset.wait(duration(seconds=timeout_s))
            messages = self._reader.take(MOST_AT_ONCE)
        valid = [message for message in messages if message.sample_info.valid_data]
        if not valid:
            return None
        sent = [message.sample_info.source_timestamp for message in valid]
        try:
            return decoded_messages([message.data for message in valid], sent, self.type_name, self.columns)
        except RecordingError as error:
            raise RecordingError(f"ros2:{self.topic}: {error}") from error

    def close(self) -> None:
        """Leave the domain."""
        self._waitset = self._news = self._reader = self._participant = None


class _AsBytes:
    """Stands for the type of a topic: messages are kept as bytes, to be decoded many at a time."""

    __slots__ = ("data", "sample_info")

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.sample_info: Any = None  # what DDS tells of a message; the reader adds it

    @classmethod
    def deserialize(cls, data: bytes) -> Self:
        return cls(data)

    deserialize_key = deserialize


def decoded_messages(
    raws: list[bytes], sent: list[int], type_name: str, columns: tuple[str, ...]
) -> Received | None:
    """Decode messages together; where one is damaged, each by itself.

    Parameters
    ----------
    raws : list of bytes
        Serialised messages, at least one.
    sent : list of int
        When each was sent, nanoseconds.
    type_name : str
        One of `SIGNALS`.
    columns : tuple of str
        Those wanted of a type with a header.

    Returns
    -------
    received : Received or None
        None if none is whole; messages of another size than the first whole one are left out.

    Raises
    ------
    RecordingError
        If the messages say that a column is not measured.
    """
    good = list(range(len(raws)))
    try:
        stamps, samples = _samples(raws, type_name, columns)
    except MessageError:
        shapes = [_shape(raw, type_name) for raw in raws]
        first = next(filter(None, shapes), None)
        good = [i for i, shape in enumerate(shapes) if shape is not None and shape == first]
        if not good:
            return None
        stamps, samples = _samples([raws[i] for i in good], type_name, columns)
    sent_ns = np.array([sent[i] for i in good], np.int64)
    stamps_ns = sent_ns if stamps is None else np.where(stamps == 0, sent_ns, stamps)
    return Received(stamps_ns, sent_ns, samples, len(raws) - len(good))


def _shape(raw: bytes, type_name: str) -> tuple[int, ...] | None:
    """Return the shape of a message's samples; None if it is damaged."""
    try:
        return _samples([raw], type_name, ())[1].shape[1:]
    except MessageError:
        return None


def _samples(
    raws: list[bytes], type_name: str, columns: tuple[str, ...]
) -> tuple[NDArray[np.int64] | None, Samples]:
    if type_name == MULTI_ARRAY:
        blocks = [decode_multi_array(raw, ros1=False) for raw in raws]
        if len({block.shape for block in blocks}) > 1:
            raise MessageError(f"{type_name}: blocks differ in size. Expected equal sizes")
        return None, np.stack(blocks)
    stamps, samples = decode_stamped(TYPES[type_name], raws, columns, ros1=False)
    return stamps, samples[:, None, :]


def _blocks(subscriber: Subscriber, timing: Timing, end_s: float | None) -> BlockSource:
    """Yield blocks as messages arrive; what DDS says of them goes with the first."""
    heard, is_silent, n_lost, ended_s = time.monotonic(), False, 0, 0.0
    said, several, looked = list[str](), list[str](), -math.inf
    with closing(subscriber):
        while True:
            received = subscriber.take(0.1)
            silent_s = time.monotonic() - heard
            if received is None:
                if end_s is not None and silent_s >= end_s:
                    return
                if silent_s >= SILENT_S and not is_silent:
                    is_silent = True
                    told = f"silent: nothing for {silent_s:.1f} s, {subscriber.whereabouts()}"
                    yield Block(ended_s, np.empty((0, 3)), timing.fs or 0.0, timing.unit, 0, (told,))
                continue
            heard, is_silent = time.monotonic(), False
            if received.n_bad:
                said.append(f"damaged: {received.n_bad} messages left out")
            if heard - looked >= SILENT_S:
                looked, before, several = heard, several, subscriber.publishers()
                if len(several) > 1 and several != before:
                    said.append(
                        f"publishers: {len(several)} mix their samples: {', '.join(several)}. Expected one"
                    )
            if subscriber.n_lost > n_lost:
                said.append(f"lost: {subscriber.n_lost - n_lost} messages on the network")
                n_lost = subscriber.n_lost
            for block in timing.push(received.stamps_ns, received.sent_ns, received.samples):
                ended_s = block.t_s + len(block.samples) / block.fs
                age_s = max(0.0, (time.time_ns() - int(received.sent_ns[-1])) / 1e9)
                yield replace(block, flags=(*said, *block.flags), age_s=age_s)
                said.clear()


def _doubted(blocks: BlockSource, turned: list[int]) -> BlockSource:
    """Yield blocks, and say if a gyroscope is quiet for long: its driver sends what it does not measure."""
    quiet_s = 0.0
    with closing(blocks):
        for block in blocks:
            said: tuple[str, ...] = ()
            if quiet_s < UNTURNED_S and len(block.samples):
                quiet_s += len(block.samples) / block.fs
                if block.samples[:, turned].any():
                    quiet_s = math.inf
                elif quiet_s >= UNTURNED_S:
                    said = (f"turn rate: 0 for the first {UNTURNED_S:g} s, does the sensor measure it?",)
            yield replace(block, flags=(*said, *block.flags))
