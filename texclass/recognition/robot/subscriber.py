"""Hear a ROS 2 topic without ROS."""

import time
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import numpy as np
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import InstanceState, Policy, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from numpy.typing import NDArray

from texclass.loaders.ros_messages import (
    MULTI_ARRAY,
    TYPES,
    MessageError,
    column_values,
    decode_multi_array,
    decode_stamped,
    lacking,
    not_measured,
)
from texclass.recognition.robot.endpoints import DEPTH, AsBytes, Reliability, participant, quality
from texclass.recognition.robot.messages import SIGNALS, dds_topic, ros_type
from texclass.recording import RecordingError, Samples

MOST_AT_ONCE = 4096
"""Messages taken at a time."""


@dataclass(frozen=True)
class Received:
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


@dataclass(frozen=True)
class Offered:
    """What a publisher on a topic offers."""

    type_name: str
    reliability: Reliability


def discover(
    topic: str, *, domain: int | None = None, timeout_s: float = 5.0, inside: DomainParticipant | None = None
) -> list[Offered]:
    """Return what the publishers of a ROS 2 topic offer, as soon as there is one.

    Parameters
    ----------
    topic : str
        "/imu/data".
    domain : int, optional
        $ROS_DOMAIN_ID or 0 by default.
    timeout_s : float
        How long to wait.
    inside : DomainParticipant, optional
        Whose discovery to ask.

    Returns
    -------
    offered : list of Offered
        Empty if nobody publishes there within the time.
    """
    member = inside or participant(domain)
    reader = BuiltinDataReader(member, BuiltinTopicDcpsPublication)
    end = time.monotonic() + timeout_s
    while True:
        found = [endpoint for endpoint in reader.read(1000) if endpoint.topic_name == dds_topic(topic)]
        if found or time.monotonic() >= end:
            return [Offered(ros_type(endpoint.type_name), _reliability(endpoint.qos)) for endpoint in found]
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
            raise ValueError(f"{topic}: type is {type_name!r}; the rule is one of {', '.join(SIGNALS)}")
        known = TYPES[type_name].columns if type_name in TYPES else {}
        if unknown := set(columns) - set(known):
            raise ValueError(f"{topic}: columns {sorted(unknown)}; the rule is one of {', '.join(known)}")
        self.topic, self.type_name = topic, type_name
        self.columns = columns or (TYPES[type_name].acceleration if type_name in TYPES else ())
        self._participant = participant(domain)
        qos = quality(reliability, depth)
        heard = Topic(self._participant, dds_topic(topic), SIGNALS[type_name], qos=qos)
        heard.data_type = AsBytes
        self._reader = DataReader(self._participant, heard, qos=qos)
        self._waitset = WaitSet(self._participant)
        self._news = ReadCondition(self._reader, ViewState.Any | InstanceState.Any | SampleState.NotRead)
        self._waitset.attach(self._news)

    @property
    def unit(self) -> str:
        """Unit of the acceleration."""
        return (TYPES[self.type_name].unit if self.type_name in TYPES else None) or "arbitrary"

    @property
    def n_publishers(self) -> int:
        """How many publishers are heard."""
        return len(self._reader.get_matched_publications())

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
            return _decoded([message.data for message in valid], sent, self.type_name, self.columns)
        except RecordingError as error:
            raise RecordingError(f"ros2:{self.topic}: {error}") from error

    def wait_for_publisher(self, timeout_s: float) -> bool:
        """Wait until somebody publishes; return whether somebody does."""
        end = time.monotonic() + timeout_s
        while not self.n_publishers:
            if time.monotonic() >= end:
                return False
            time.sleep(0.01)
        return True

    def close(self) -> None:
        """Leave the domain."""
        self._waitset = self._news = self._reader = self._participant = None

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the domain."""
        self.close()


def _decoded(raws: list[bytes], sent: list[int], type_name: str, columns: tuple[str, ...]) -> Received | None:
    """Decode messages together; where one is damaged, each by itself."""
    try:
        stamps, samples = _samples(raws, type_name, columns)
    except MessageError:
        shapes = [_shape(raw, type_name) for raw in raws]
        first = next((shape for shape in shapes if shape is not None), None)
        good = [i for i, shape in enumerate(shapes) if first is not None and shape == first]
        if not good:
            return None
        found = _decoded([raws[i] for i in good], [sent[i] for i in good], type_name, columns)
        assert found is not None
        return Received(found.stamps_ns, found.sent_ns, found.samples, len(raws) - len(good))
    sent_ns = np.array(sent, np.int64)
    return Received(sent_ns if stamps is None else np.where(stamps == 0, sent_ns, stamps), sent_ns, samples)


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
            raise MessageError(f"{type_name}: blocks differ in size; the rule is one")
        return None, np.stack(blocks)
    stamps, numbers = decode_stamped(TYPES[type_name], raws, ros1=False)
    if absent := lacking(TYPES[type_name], numbers, columns):
        raise RecordingError(not_measured(absent))
    chosen = [column_values(TYPES[type_name], numbers, column) for column in columns]
    return stamps, np.stack(chosen, axis=-1)[:, None, :] if chosen else numbers[:, None, :0]


def _reliability(qos: Any) -> Reliability:
    return "reliable" if isinstance(qos[Policy.Reliability], Policy.Reliability.Reliable) else "best effort"
