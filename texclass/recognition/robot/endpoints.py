"""What subscriber and publisher share: the participant, qualities of service, messages kept as bytes."""

import os
from typing import Any, Literal

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.util import duration

Reliability = Literal["reliable", "best effort"]
DEPTH = 20_000
"""Messages kept until they are taken: 2 s at 10 kHz. ROS 2 keeps 5 of sensor data by default."""


class Wire:
    """A message as the bytes that went over the wire; what DDS tells of it is added by the reader."""

    __slots__ = ("data", "sample_info")

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.sample_info: Any = None


class AsBytes:
    """Stands for the type of a topic when messages shall be kept as bytes, decoded many at a time."""

    deserialize = Wire
    deserialize_key = Wire


def participant(domain: int | None = None) -> DomainParticipant:
    """Join a domain: the given one, else $ROS_DOMAIN_ID, else 0."""
    return DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID") or 0) if domain is None else domain)


def quality(reliability: Reliability, depth: int = DEPTH) -> Qos:
    """Return the quality of service of a topic: volatile, the last `depth` messages kept, CDR version 1.

    "best effort" is what ROS 2 drivers use for sensor data, and hears reliable publishers too; "reliable"
    repeats what was lost, and hears reliable publishers only.
    """
    is_reliable = reliability == "reliable"
    kind = (
        Policy.Reliability.Reliable(duration(milliseconds=100))
        if is_reliable
        else Policy.Reliability.BestEffort
    )
    return Qos(
        kind,
        Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )
