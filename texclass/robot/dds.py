"""ROS 2 over DDS, without ROS: names, messages, quality of service and publishers (extra `robot`).

ROS 2 adds the prefix `rt/` to the name of a topic, names a message type `package::msg::dds_::Type_`, and
serialises messages in CDR version 1. A program that follows these conventions can exchange messages with
ROS 2 nodes.
"""

import json
import os
import struct
import time
import types
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal

import numpy as np
from cyclonedds import idl
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from texclass import shipped
from texclass.recognition import Event, WindowAnswer
from texclass.recording import Samples
from texclass.robot.answer_messages import (
    OK,
    WARN,
    TimeOf,
    answer_message,
    diagnostics_message,
    event_message,
    header,
    status_message,
    surface_status,
)

Reliability = Literal["reliable", "best effort"]
DEPTH = 20_000
"""Default queue length in messages: 2 s at 10 kHz. The default of ROS 2 for sensor data, 5, is too short."""
MAX_DOMAIN = 232
"""Largest DDS domain; higher numbers have no valid ports."""


def dds_topic(topic: str) -> str:
    """Return the DDS name of a ROS 2 topic.

    Examples
    --------
    >>> dds_topic("/imu/data")
    'rt/imu/data'
    """
    return f"rt/{topic.lstrip('/')}"


def dds_type(type_name: str) -> str:
    """Return the DDS name of a ROS 2 message type.

    Examples
    --------
    >>> dds_type("sensor_msgs/msg/Imu")
    'sensor_msgs::msg::dds_::Imu_'
    """
    package, _, name = type_name.split("/")
    return f"{package}::msg::dds_::{name}_"


def ros_type(dds_name: str) -> str:
    """Return the ROS 2 name of a DDS type (the inverse of `dds_type`); return other names unchanged."""
    package, mark, name = dds_name.partition("::msg::dds_::")
    return f"{package}/msg/{name.removesuffix('_')}" if mark else dds_name


@cache
def message_class(type_name: str) -> Any:
    """Return the DDS type of a message: of ROS 2, from its definition in rosbags, or of `texclass_msgs`.

    Parameters
    ----------
    type_name : str
        Message type, such as "sensor_msgs/msg/Imu" or "texclass_msgs/msg/SurfaceAnswer".

    Returns
    -------
    type of IdlStruct
        Dataclass with the fields of the message, which are zero or empty by default.

    Examples
    --------
    >>> message_class("geometry_msgs/msg/Vector3")(z=9.81)
    Vector3(x=0.0, y=0.0, z=9.81)
    """
    members = {name: _member(kind) for name, kind in _typestore().get_msgdef(type_name).fields}
    body = {"__annotations__": {name: kind for name, (kind, _) in members.items()}, "__module__": __name__}
    body |= {name: field(default_factory=default) for name, (_, default) in members.items()}
    name = {"typename": dds_type(type_name)}
    class_ = types.new_class(type_name.rpartition("/")[2], (idl.IdlStruct,), name, lambda ns: ns.update(body))
    return dataclass(class_)


@cache
def _typestore() -> Any:
    """Return the message definitions of ROS 2 and of `texclass_msgs`."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    definitions: dict[str, Any] = {}
    for path in shipped.folder("texclass_msgs").glob("*.msg"):
        text = path.read_text(encoding="utf-8")
        definitions |= get_types_from_msg(text, f"texclass_msgs/msg/{path.stem}")
    store.register(definitions)
    return store


def make_message(name: str, /, **fields: Any) -> Any:
    """Return a DDS message from the name of its type and its fields.

    Examples
    --------
    >>> make_message("geometry_msgs/msg/Vector3", z=9.81)
    Vector3(x=0.0, y=0.0, z=9.81)
    """
    return message_class(name)(**fields)


def _member(description: Any) -> tuple[Any, Any]:
    """Return the type and the default factory of a field of a message."""
    match description[0].name, description[1]:
        case "BASE", ("string", _):
            return str, str
        case "BASE", ("bool", _):
            return bool, bool
        case "BASE", (number, _):
            kind = getattr(idl.types, {"byte": "uint8"}.get(number, number))
            return kind, float if number.startswith("float") else int
        case "NAME", name:
            return message_class(name), message_class(name)
        case "ARRAY", (inner, n):
            kind, default = _member(inner)
            return idl.types.array[kind, n], lambda: [default() for _ in range(n)]
    return idl.types.sequence[_member(description[1][0])[0]], list


def participant(domain: int | None = None) -> DomainParticipant:
    """Return a participant of a DDS domain (default: $ROS_DOMAIN_ID, or 0).

    Raises
    ------
    ValueError
        If the domain is not an integer from 0 to 232.
    """
    number = str(os.environ.get("ROS_DOMAIN_ID") or 0 if domain is None else domain)
    if not (number.isascii() and number.isdigit() and int(number) <= MAX_DOMAIN):
        name = "ROS_DOMAIN_ID" if domain is None else "domain"
        raise ValueError(
            f"{name} must be an integer from 0 to {MAX_DOMAIN}, got {number!r} (--domain overrides "
            "ROS_DOMAIN_ID)"
        )
    return DomainParticipant(int(number))


def quality(reliability: Reliability, depth: int = DEPTH) -> Qos:
    """Return the quality of service of a topic: volatile, with a queue of `depth` messages, in CDR version 1.

    Parameters
    ----------
    reliability : str
        "best effort" (usual for sensor data in ROS 2) connects to all publishers. "reliable" retransmits lost
        messages, but connects to reliable publishers only.
    depth : int
        Queue length in messages.
    """
    return Qos(
        Policy.Reliability.Reliable(duration(milliseconds=100))
        if reliability == "reliable"
        else Policy.Reliability.BestEffort,
        Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )


class AnswerPublisher:
    """Publisher of answers as JSON (`std_msgs/String`) and as `diagnostic_msgs/DiagnosticArray`.

    Parameters
    ----------
    topic : str
        Topic of the answers as JSON.
    diagnostics : str or None
        Topic of the diagnostics; None disables them.
    name : str
        Name of the diagnostic status.
    reliability : str
        "reliable" (the default of ROS 2 subscribers) or "best effort".
    domain : int, optional
        DDS domain (default: $ROS_DOMAIN_ID, or 0).

    Examples
    --------
    >>> from texclass.robot import AnswerPublisher
    >>> publisher = AnswerPublisher("/surface", diagnostics=None)
    >>> publisher.publish({"surface": "oak", "probability": 0.97, "unknown": False})
    >>> publisher.diagnostics({"surface": "oak"}, stamp_ns=0).status[0].message
    'oak'
    >>> publisher.close()
    """

    def __init__(
        self,
        topic: str = "/texclass/surface",
        diagnostics: str | None = "/diagnostics",
        *,
        name: str = "texclass: surface",
        reliability: Reliability = "reliable",
        domain: int | None = None,
    ) -> None:
        self._participant, qos = participant(domain), quality(reliability, 10)
        self._name = name
        self._text = _writer(self._participant, topic, "std_msgs/msg/String", qos)
        self._array = None
        if diagnostics:
            kind = "diagnostic_msgs/msg/DiagnosticArray"
            self._array = _writer(self._participant, diagnostics, kind, qos)

    def publish(self, answer: Mapping[str, Any], *, stamp_ns: int | None = None) -> None:
        """Publish an answer.

        Parameters
        ----------
        answer : mapping
            Content of the JSON message. `surface` becomes the message of the diagnostic status, whose level
            is a warning if `unknown` is true.
        stamp_ns : int, optional
            Time stamp of the answer in nanoseconds (default: now).
        """
        self._text.write(make_message("std_msgs/msg/String", data=json.dumps(answer)))
        if self._array is not None:
            self._array.write(self.diagnostics(answer, time.time_ns() if stamp_ns is None else stamp_ns))

    def diagnostics(self, answer: Mapping[str, Any], stamp_ns: int) -> Any:
        """Return the message `diagnostic_msgs/DiagnosticArray` for an answer."""
        is_unknown = bool(answer.get("unknown"))
        message = "unknown surface" if is_unknown else str(answer.get("surface", ""))
        level = WARN if is_unknown else OK
        status = status_message(make_message, self._name, level, message, answer)
        return diagnostics_message(make_message, [status], stamp_ns)

    def close(self) -> None:
        """Disconnect from the domain."""
        self._text = self._array = self._participant = None


class SurfacePublisher:
    """Publisher of answers and events as messages of `texclass_msgs`, and of diagnostics.

    Subscribers with ROS need the package `ros2/texclass_msgs`.

    Parameters
    ----------
    topic : str
        Topic of the answers (`texclass_msgs/SurfaceAnswer`). Events (`texclass_msgs/ContactEvent`) are
        published on `topic` followed by "/contact".
    diagnostics : str or None
        Topic of the diagnostics; None disables them.
    frame : str
        Name of the frame in the headers.
    reliability : str
        "reliable" (the default of ROS 2 subscribers) or "best effort".
    domain : int, optional
        DDS domain (default: $ROS_DOMAIN_ID, or 0).

    Examples
    --------
    >>> from texclass.recognition import Event
    >>> from texclass.robot import SurfacePublisher
    >>> publisher = SurfacePublisher("/surface", diagnostics=None)
    >>> event = Event("lift-off", sample=1180, n_received=1400, end=1180)
    >>> publisher.publish_update(event, time_of=lambda sample: sample * 10**6)
    >>> publisher.close()
    """

    def __init__(
        self,
        topic: str = "/texclass/answer",
        diagnostics: str | None = "/diagnostics",
        *,
        frame: str = "",
        reliability: Reliability = "reliable",
        domain: int | None = None,
    ) -> None:
        self._participant, qos = participant(domain), quality(reliability, 10)
        self._frame = frame
        self._answers = _writer(self._participant, topic, "texclass_msgs/msg/SurfaceAnswer", qos)
        events = f"{topic.rstrip('/')}/contact"
        self._events = _writer(self._participant, events, "texclass_msgs/msg/ContactEvent", qos)
        self._array = None
        if diagnostics:
            kind = "diagnostic_msgs/msg/DiagnosticArray"
            self._array = _writer(self._participant, diagnostics, kind, qos)

    def publish_update(self, update: Event | WindowAnswer, time_of: TimeOf) -> None:
        """Publish an answer or event.

        Parameters
        ----------
        update : Event or WindowAnswer
            Update of a session.
        time_of : callable
            Function that returns the time stamp of a sample in nanoseconds.
        """
        if isinstance(update, Event):
            self._events.write(event_message(make_message, update, time_of, self._frame))
            return
        self._answers.write(answer_message(make_message, update, time_of, self._frame))
        if self._array is not None:
            status = surface_status(make_message, "texclass: surface", update.verdict)
            self._array.write(diagnostics_message(make_message, [status], time_of(update.n_received)))

    def close(self) -> None:
        """Disconnect from the domain."""
        self._answers = self._events = self._array = self._participant = None


class ImuPublisher:
    """Publisher of accelerations and turn rates as `sensor_msgs/Imu`, at 10 kHz and more.

    Parameters
    ----------
    topic : str
        Name of the topic, such as "/imu/data".
    frame : str
        Name of the frame in the headers.
    reliability : str
        "reliable" serves all subscribers; "best effort" (usual for ROS 2 drivers) serves only best-effort
        subscribers.
    depth : int
        Queue length in messages, for slow subscribers.
    domain : int, optional
        DDS domain (default: $ROS_DOMAIN_ID, or 0).

    Examples
    --------
    >>> from texclass.robot import ImuPublisher
    >>> publisher = ImuPublisher("/imu/data")
    >>> publisher.publish(0, acceleration=[0.0, 0.0, 9.81], turn_rate=[0.0, 0.0, 0.1])
    >>> publisher.close()
    """

    def __init__(
        self,
        topic: str,
        *,
        frame: str = "imu_link",
        reliability: Reliability = "reliable",
        depth: int = DEPTH,
        domain: int | None = None,
    ) -> None:
        self._participant = participant(domain)
        self._writer = _writer(self._participant, topic, "sensor_msgs/msg/Imu", quality(reliability, depth))
        orientation = message_class("geometry_msgs/msg/Quaternion")(w=1.0)
        self._message = message_class("sensor_msgs/msg/Imu")(header(make_message, 0, frame), orientation)
        # Serialising each message takes longer than a sampling period at 10 kHz. Therefore, one message is
        # serialised, and the 37 numbers at its end are overwritten for each sample.
        self._bytes = bytearray(self._message.serialize(use_version_2=False))
        self._message.serialize = lambda *_, **__: bytes(self._bytes)
        first = len(self._bytes) - 8 * 37
        self._turn_rate_offset, self._acceleration_offset = first + 8 * 13, first + 8 * 25

    @property
    def n_subscribers(self) -> int:
        """Number of connected subscribers."""
        return len(self._writer.get_matched_subscriptions())

    def publish(self, stamp_ns: int, acceleration: Samples, turn_rate: Samples | None = None) -> None:
        """Publish one sample.

        Parameters
        ----------
        stamp_ns : int
            Time stamp in nanoseconds.
        acceleration : array_like of shape (3,)
            Acceleration in m/s^2.
        turn_rate : array_like of shape (3,), optional
            Turn rate in rad/s (default: the turn rate of the previous sample, initially 0).
        """
        struct.pack_into("<iI", self._bytes, 4, *divmod(stamp_ns, 10**9))
        struct.pack_into("<3d", self._bytes, self._acceleration_offset, *acceleration)
        if turn_rate is not None:
            struct.pack_into("<3d", self._bytes, self._turn_rate_offset, *np.asarray(turn_rate))
        self._writer.write(self._message)

    def close(self) -> None:
        """Disconnect from the domain."""
        self._writer = self._participant = None


def _writer(member: DomainParticipant, topic: str, type_name: str, qos: Qos) -> Any:
    return DataWriter(member, Topic(member, dds_topic(topic), message_class(type_name), qos=qos), qos=qos)
