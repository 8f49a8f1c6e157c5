"""ROS 2 over DDS, without ROS: its names, messages, qualities of service; publishers (extra `robot`).

ROS 2 puts `rt/` before a topic, calls the type `package::msg::dds_::Type_`, and serialises in CDR version 1.
A ROS 2 node can be at the other end.
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
from rosbags.typesys import Stores, get_typestore

from texclass.recording import Samples

Reliability = Literal["reliable", "best effort"]
DEPTH = 20_000
"""Messages kept until they are taken: 2 s at 10 kHz. ROS 2 keeps 5 of sensor data by default."""
LAST_DOMAIN = 232
"""Of DDS: the ports of later ones do not exist."""
OK, WARN = 0, 1
"""Levels of diagnostics."""


def dds_topic(topic: str) -> str:
    """Return the DDS name of a ROS 2 topic: "/imu/data" is "rt/imu/data"."""
    return f"rt/{topic.lstrip('/')}"


def dds_type(type_name: str) -> str:
    """Return the DDS name of a ROS 2 type: "sensor_msgs/msg/Imu" is "sensor_msgs::msg::dds_::Imu_"."""
    package, _, name = type_name.split("/")
    return f"{package}::msg::dds_::{name}_"


def ros_type(dds_name: str) -> str:
    """Return the ROS 2 name of a DDS type, the inverse of `dds_type`; other names as they are."""
    package, mark, name = dds_name.partition("::msg::dds_::")
    return f"{package}/msg/{name.removesuffix('_')}" if mark else dds_name


@cache
def message_class(type_name: str) -> Any:
    """Return the DDS type of a standard message of ROS 2, as its definition in rosbags has it.

    Parameters
    ----------
    type_name : str
        "sensor_msgs/msg/Imu".

    Returns
    -------
    type of IdlStruct
        A dataclass with the members of the message, zero or empty by default.
    """
    members = {
        name: _member(kind) for name, kind in get_typestore(Stores.ROS2_HUMBLE).get_msgdef(type_name).fields
    }
    body = {"__annotations__": {name: kind for name, (kind, _) in members.items()}, "__module__": __name__}
    body |= {name: field(default_factory=default) for name, (_, default) in members.items()}
    name = {"typename": dds_type(type_name)}
    made = types.new_class(type_name.rpartition("/")[2], (idl.IdlStruct,), name, lambda ns: ns.update(body))
    return dataclass(made)


def _member(described: Any) -> tuple[Any, Any]:
    """Return type and default of a member of a message."""
    match described[0].name, described[1]:
        case "BASE", ("string", _):
            return str, str
        case "BASE", (number, _):
            kind = getattr(idl.types, {"byte": "uint8"}.get(number, number))
            return kind, float if number.startswith("float") else int
        case "NAME", name:
            return message_class(name), message_class(name)
        case "ARRAY", (inner, n):
            kind, default = _member(inner)
            return idl.types.array[kind, n], lambda: [default() for _ in range(n)]
    return idl.types.sequence[_member(described[1][0])[0]], list


def participant(domain: int | None = None) -> DomainParticipant:
    """Join a domain: the given one, else $ROS_DOMAIN_ID, else 0.

    Raises
    ------
    ValueError
        If it is no domain.
    """
    given = str(os.environ.get("ROS_DOMAIN_ID") or 0 if domain is None else domain)
    if not (given.isascii() and given.isdigit() and int(given) <= LAST_DOMAIN):
        where = "ROS_DOMAIN_ID" if domain is None else "domain"
        raise ValueError(
            f"{where} is {given!r}. Expected 0 to {LAST_DOMAIN} (--domain goes before ROS_DOMAIN_ID)"
        )
    return DomainParticipant(int(given))


def quality(reliability: Reliability, depth: int = DEPTH) -> Qos:
    """Return the quality of service of a topic: volatile, the last `depth` messages kept, CDR version 1.

    "best effort" is what ROS 2 drivers use for sensor data, and hears reliable publishers too; "reliable"
    repeats what was lost, and hears reliable publishers only.
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
    """Publishes answers as JSON in a `std_msgs/String`, and as `diagnostic_msgs/DiagnosticArray`.

    Parameters
    ----------
    topic : str
        Of the JSON.
    diagnostics : str or None
        Of the diagnostics; None publishes none.
    name : str
        Under which the diagnostics are shown.
    reliability : str
        "reliable" is what ROS 2 subscribers expect of both.
    domain : int, optional
        $ROS_DOMAIN_ID or 0 by default.
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
            What goes into the JSON; `surface` is the message of the diagnostics, a true `unknown` makes it a
            warning.
        stamp_ns : int, optional
            Instant of the answer, nanoseconds; now by default.
        """
        self._text.write(message_class("std_msgs/msg/String")(json.dumps(answer)))
        if self._array is not None:
            self._array.write(self.diagnostics(answer, time.time_ns() if stamp_ns is None else stamp_ns))

    def diagnostics(self, answer: Mapping[str, Any], stamp_ns: int) -> Any:
        """Return an answer as diagnostics."""
        key_value = message_class("diagnostic_msgs/msg/KeyValue")
        unknown = bool(answer.get("unknown"))
        said = "unknown surface" if unknown else str(answer.get("surface", ""))
        texts = {key: value if isinstance(value, str) else json.dumps(value) for key, value in answer.items()}
        values = [key_value(*pair) for pair in texts.items()]
        status = message_class("diagnostic_msgs/msg/DiagnosticStatus")
        whole = message_class("diagnostic_msgs/msg/DiagnosticArray")
        return whole(_header(stamp_ns), [status(WARN if unknown else OK, self._name, said, "", values)])

    def close(self) -> None:
        """Leave the domain."""
        self._text = self._array = self._participant = None


class ImuPublisher:
    """Publishes accelerations and turn rates as `sensor_msgs/Imu`, 10 kHz and more.

    Parameters
    ----------
    topic : str
        "/imu/data".
    frame : str
        Name of the frame in the headers.
    reliability : str
        "best effort" is what ROS 2 drivers use; "reliable" serves both kinds of subscriber.
    depth : int
        Messages kept for subscribers that fall behind.
    domain : int, optional
        $ROS_DOMAIN_ID or 0 by default.
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
        upright = message_class("geometry_msgs/msg/Quaternion")(w=1.0)
        self._message = message_class("sensor_msgs/msg/Imu")(_header(0, frame), upright)
        # Its 37 numbers come last; serialising each message anew would take longer than a period at 10 kHz.
        self._bytes = bytearray(self._message.serialize(use_version_2=False))
        self._message.serialize = lambda *_, **__: bytes(self._bytes)
        first = len(self._bytes) - 8 * 37
        self._turn_rate_at, self._acceleration_at = first + 8 * 13, first + 8 * 25

    @property
    def n_subscribers(self) -> int:
        """How many subscribers hear it."""
        return len(self._writer.get_matched_subscriptions())

    def publish(self, stamp_ns: int, acceleration: Samples, turn_rate: Samples | None = None) -> None:
        """Publish one sample.

        Parameters
        ----------
        stamp_ns : int
            Instant, nanoseconds.
        acceleration : array_like of shape (3,)
            In m/s^2.
        turn_rate : array_like of shape (3,), optional
            In rad/s.
        """
        struct.pack_into("<iI", self._bytes, 4, *divmod(stamp_ns, 10**9))
        struct.pack_into("<3d", self._bytes, self._acceleration_at, *acceleration)
        if turn_rate is not None:
            struct.pack_into("<3d", self._bytes, self._turn_rate_at, *np.asarray(turn_rate))
        self._writer.write(self._message)

    def close(self) -> None:
        """Leave the domain."""
        self._writer = self._participant = None


def _writer(member: DomainParticipant, topic: str, type_name: str, qos: Qos) -> Any:
    return DataWriter(member, Topic(member, dds_topic(topic), message_class(type_name), qos=qos), qos=qos)


def _header(stamp_ns: int, frame: str = "") -> Any:
    stamp = message_class("builtin_interfaces/msg/Time")(*divmod(stamp_ns, 10**9))
    return message_class("std_msgs/msg/Header")(stamp, frame)
