"""Publish answers, or an inertial signal, to ROS 2 without ROS."""

import json
import struct
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic

from texclass.recognition.robot.endpoints import DEPTH, Reliability, participant, quality
from texclass.recognition.robot.messages import (
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    Imu,
    KeyValue,
    String,
    Time,
    dds_topic,
)
from texclass.recording import Samples

OK, WARN = 0, 1


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
        self._participant = participant(domain)
        self._name = name
        self._text = self._writer(topic, String, reliability)
        self._array = self._writer(diagnostics, DiagnosticArray, reliability) if diagnostics else None

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
        self._text.write(String(json.dumps(answer)))
        if self._array is not None:
            self._array.write(self.diagnostics(answer, time.time_ns() if stamp_ns is None else stamp_ns))

    def diagnostics(self, answer: Mapping[str, Any], stamp_ns: int) -> DiagnosticArray:
        """Return an answer as diagnostics."""
        unknown = bool(answer.get("unknown"))
        values = [
            KeyValue(key, value if isinstance(value, str) else json.dumps(value))
            for key, value in answer.items()
        ]
        said = "unknown surface" if unknown else str(answer.get("surface", ""))
        status = DiagnosticStatus(WARN if unknown else OK, self._name, said, "", values)
        return DiagnosticArray(Header(Time(*divmod(stamp_ns, 10**9)), ""), [status])

    def close(self) -> None:
        """Leave the domain."""
        self._text = self._array = self._participant = None

    def _writer(self, topic: str, kind: type[IdlStruct], reliability: Reliability) -> DataWriter:
        qos = quality(reliability, 10)
        return DataWriter(
            self._participant, Topic(self._participant, dds_topic(topic), kind, qos=qos), qos=qos
        )


class _Serialised(Imu):
    """An Imu whose bytes are already known."""

    raw: bytes = b""

    def serialize(self, *_: Any, **__: Any) -> bytes:
        """Return the bytes."""
        return self.raw


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
        qos = quality(reliability, depth)
        self._writer = DataWriter(
            self._participant, Topic(self._participant, dds_topic(topic), Imu, qos=qos), qos=qos
        )
        self._message = _Serialised()
        self._bytes = bytearray(Imu(Header(Time(), frame)).serialize(use_version_2=False))
        numbers = len(self._bytes) - 8 * 37
        self._turn_rate_at, self._acceleration_at = numbers + 8 * 13, numbers + 8 * 25

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
        self._message.raw = bytes(self._bytes)
        self._writer.write(self._message)

    def close(self) -> None:
        """Leave the domain."""
        self._writer = self._participant = None
