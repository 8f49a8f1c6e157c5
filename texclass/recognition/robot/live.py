"""A ROS 2 topic as a source of blocks."""

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from texclass.loaders.ros_messages import MULTI_ARRAY, TURN_RATE, TYPES
from texclass.recognition.blocks import Block
from texclass.recognition.needs import ACCELERATION_ONLY, Needs
from texclass.recognition.robot.endpoints import Reliability
from texclass.recognition.robot.messages import SIGNALS
from texclass.recognition.robot.subscriber import Received, Subscriber, discover
from texclass.recognition.timing import Timing
from texclass.recording import RecordingError

SILENT_S = 1.0
"""After so many seconds without a message an empty block says so."""
UNTURNED_S = 1.0
"""After so many seconds of a turn rate of exactly 0 a block says so."""


class TopicSource:
    """The acceleration of a ROS 2 topic, and the turn rate where it is needed, block by block as it arrives.

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
    """

    def __init__(
        self,
        topic: str,
        *,
        fs: float | None = None,
        unit: str | None = None,
        type_name: str | None = None,
        reliability: Reliability | None = None,
        domain: int | None = None,
        wait_s: float = 10.0,
        end_s: float | None = None,
        needs: Needs = ACCELERATION_ONLY,
    ) -> None:
        if type_name is None or reliability is None:
            offered = discover(topic, domain=domain, timeout_s=wait_s)
            if not offered:
                raise RecordingError(f"ros2:{topic}: nobody publishes there; waited {wait_s:g} s")
            type_name = type_name or offered[0].type_name
            all_reliable = all(offer.reliability == "reliable" for offer in offered)
            reliability = reliability or ("reliable" if all_reliable else "best effort")
        if type_name not in SIGNALS:
            raise RecordingError(
                f"ros2:{topic}: carries {type_name!r}; the rule is one of {', '.join(SIGNALS)}"
            )
        columns = _columns(topic, type_name, needs)
        self.subscriber = Subscriber(
            topic, type_name, reliability=reliability, domain=domain, columns=columns
        )
        stated = self.subscriber.unit
        if stated != "arbitrary" and unit not in (None, stated):
            self.close()
            raise RecordingError(
                f"ros2:{topic}: unit is {stated!r} by its type, {unit!r} was given; the rule is one"
            )
        self.timing = Timing(fs, unit or stated)
        self._end_s = end_s
        self._end = (0.0, np.empty((0, 3)))
        self._pending: list[str] = []
        self._n_lost = 0
        self._turn = [columns.index(name) for name in TURN_RATE if name in columns]
        self._unturned_s = 0.0

    def __iter__(self) -> Iterator[Block]:
        """Yield blocks as messages arrive; an empty one that says so after a second of silence."""
        heard, is_silent = time.monotonic(), False
        while True:
            received = self.subscriber.take(0.1)
            silent_s = time.monotonic() - heard
            if received is not None:
                heard, is_silent = time.monotonic(), False
                yield from self._blocks(received)
            elif self._end_s is not None and silent_s >= self._end_s:
                return
            elif silent_s >= SILENT_S and not is_silent:
                is_silent = True
                yield self._silence(silent_s)

    def _blocks(self, received: Received) -> Iterator[Block]:
        """Yield the blocks that messages make; what DDS says of them goes with the first."""
        if received.n_bad:
            self._pending.append(f"damaged: {received.n_bad} messages left out")
        if (n_lost := self.subscriber.n_lost) > self._n_lost:
            self._pending.append(f"lost: {n_lost - self._n_lost} messages on the network")
            self._n_lost = n_lost
        for block in self.timing.push(received.stamps_ns, received.sent_ns, received.samples):
            self._end = (block.t_s + len(block.samples) / block.fs, block.samples[:0])
            self._watch_turning(block)
            yield replace(block, flags=(*self._pending, *block.flags))
            self._pending.clear()

    def _watch_turning(self, block: Block) -> None:
        """Say once that a turn rate has been 0 from the start on: a gyroscope is never so quiet for long."""
        if self._turn and not block.samples[:, self._turn].any():
            self._unturned_s += len(block.samples) / block.fs
            if self._unturned_s < UNTURNED_S:
                return
            self._pending.append(f"turn rate: 0 for the first {UNTURNED_S:g} s, does the sensor measure it?")
        self._turn = []

    def _silence(self, silent_s: float) -> Block:
        told = f"silent: nothing for {silent_s:.1f} s, {self.subscriber.whereabouts()}"
        at, nothing = self._end
        return Block(at, nothing, self.timing.fs or 0.0, self.timing.unit, 0, (told,))

    def close(self) -> None:
        """Leave the domain."""
        self.subscriber.close()


def _columns(topic: str, type_name: str, needs: Needs) -> tuple[str, ...]:
    """Return the columns of a type of messages that are needed."""
    if type_name == MULTI_ARRAY:
        return ()
    type_ = TYPES[type_name]
    turn = TURN_RATE if "turn_rate" in needs.beside else ()
    for name in needs.beside:
        if name != "turn_rate" or not set(turn) <= set(type_.columns):
            raise RecordingError(f"ros2:{topic}: {type_name} has {needs.lacks(name)}")
    return (*type_.acceleration, *turn)
