"""Messages of ROS as bytes: which types can be signals, what their numbers mean, and how they are laid out.

ROS 2 (bags and the wire) serialises in CDR: four bytes say how, every number stands at a multiple of its own
size. ROS 1 packs the same fields without gaps, and its header has a running number first.
"""

import struct
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples

Stamps = NDArray[np.int64]

MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
MOST_CHANNELS = 1024
"""Channels of a `Float64MultiArray`; more is taken for a damaged message."""


class MessageError(ValueError):
    """A message is not what its type says; the message names type, value and rule."""


@dataclass(frozen=True)
class MessageType:
    """A header (time stamp and frame) followed by a fixed number of float64.

    Attributes
    ----------
    name
        "package/msg/Type".
    n_numbers
        How many float64 follow the header.
    columns
        Column -> positions of the numbers; more than one position stands for their norm.
    acceleration
        Columns that are an acceleration; empty where the type has none.
    unit
        Of the acceleration.
    factors
        Column -> factor to the unit `Recording` keeps it in, where that is not 1.
    disclaimers
        Column -> position of the number (the first of a covariance) that is -1 where the sender lacks it.
    """

    name: str
    n_numbers: int
    columns: dict[str, tuple[int, ...]]
    acceleration: tuple[str, ...] = ()
    unit: str | None = None
    factors: dict[str, float] | None = None
    disclaimers: dict[str, int] | None = None


def _axes(first: int, *names: str) -> dict[str, tuple[int, ...]]:
    return {name: (first + i,) for i, name in enumerate(names)}


_ACCELERATION = ("ax", "ay", "az")
TURN_RATE = ("wx", "wy", "wz")
"""Columns of a turn rate, rad/s."""
TYPES = {
    type_.name: type_
    for type_ in (
        # orientation 4, its covariance 9, turn rate 3, its covariance 9, acceleration 3, its covariance 9
        MessageType(
            "sensor_msgs/msg/Imu",
            37,
            _axes(25, *_ACCELERATION) | _axes(13, *TURN_RATE),
            _ACCELERATION,
            "m/s^2",
            disclaimers=dict.fromkeys(_ACCELERATION, 28) | dict.fromkeys(TURN_RATE, 16),
        ),
        MessageType("geometry_msgs/msg/AccelStamped", 6, _axes(0, *_ACCELERATION), _ACCELERATION, "m/s^2"),
        MessageType(
            "geometry_msgs/msg/TwistStamped",
            6,
            _axes(0, "vx", "vy", "vz") | {"speed": (0, 1, 2)} | _axes(3, *TURN_RATE),
            factors={"speed": 1000.0},
        ),
        MessageType(
            "geometry_msgs/msg/WrenchStamped",
            6,
            _axes(0, "fx", "fy", "fz") | {"force": (0, 1, 2)} | _axes(3, "tx", "ty", "tz"),
        ),
    )
}
"""Types with a header, by name; speed is in mm/s, what else there is in SI units."""
READABLE = (*TYPES, MULTI_ARRAY)


def column_values(type_: MessageType, numbers: Samples, column: str) -> Samples:
    """Return one column of messages, in the unit a `Recording` keeps it in.

    Parameters
    ----------
    type_ : MessageType
        What the messages are.
    numbers : ndarray of shape (n, n_numbers)
        Of `decode_stamped`.
    column : str
        One of `type_.columns`.

    Returns
    -------
    values : ndarray of shape (n,)
    """
    where = type_.columns[column]
    values = numbers[:, where[0]]
    with np.errstate(invalid="ignore", over="ignore"):  # of damaged numbers
        for other in where[1:]:
            values = np.hypot(values, numbers[:, other])
        return values * (type_.factors or {}).get(column, 1.0)


def lacking(type_: MessageType, numbers: Samples, columns: Collection[str]) -> tuple[str, ...]:
    """Return those of some columns that the sender of messages does not measure, by what it says.

    A covariance that begins with -1 says so [sensor_msgs/Imu]. Some drivers put it beside real numbers, whose
    covariance they do not know: only with zeros (or NaN) in every message is it taken at its word.

    Parameters
    ----------
    type_ : MessageType
        What the messages are.
    numbers : ndarray of shape (n, n_numbers)
        Of `decode_stamped`.
    columns : collection of str
        Of `type_.columns`.
    """
    found = []
    for column in columns:
        at = (type_.disclaimers or {}).get(column)
        if at is not None and np.all(numbers[:, at] == -1):
            values = numbers[:, type_.columns[column][0]]
            if np.all((values == 0) | np.isnan(values)):
                found.append(column)
    return tuple(sorted(found))


def not_measured(columns: Sequence[str]) -> str:
    """Return the words for columns that are `lacking`."""
    return (
        f"its messages say that {', '.join(columns)} are not measured (a covariance that begins with -1); "
        "the rule is a sensor that measures them"
    )


def decode_stamped(type_: MessageType, raws: Sequence[bytes], *, ros1: bool) -> tuple[Stamps, Samples]:
    """Decode messages that are a header and numbers.

    Parameters
    ----------
    type_ : MessageType
        What they are.
    raws : sequence of bytes
        Serialised messages, at least one.
    ros1 : bool
        Packed as by ROS 1, not in CDR.

    Returns
    -------
    stamps_ns : ndarray of shape (n,)
        Time stamps of the headers, nanoseconds.
    numbers : ndarray of shape (n, n_numbers)

    Raises
    ------
    MessageError
        If a message is too short or not in plain CDR.
    """
    stamps = np.empty(len(raws), np.int64)
    numbers = np.empty((len(raws), type_.n_numbers))
    for first, last in _runs_of_one_layout(raws, ros1):
        layout = _layout(type_, raws[first], ros1)
        rows = np.frombuffer(b"".join(raws[first:last]), layout)
        stamps[first:last] = rows["sec"].astype(np.int64) * 1_000_000_000 + rows["nanosec"]
        numbers[first:last] = rows["numbers"]
    return stamps, numbers


def _runs_of_one_layout(raws: Sequence[bytes], ros1: bool) -> list[tuple[int, int]]:
    """Return half-open runs of messages with the same length, encoding and length of the frame's name."""
    encoding = slice(0, 0 if ros1 else 4)
    keys = [(len(raw), raw[encoding], raw[12:16]) for raw in raws]
    cuts = [0, *(i for i in range(1, len(keys)) if keys[i] != keys[i - 1]), len(keys)]
    return list(pairwise(cuts))


def _layout(type_: MessageType, raw: bytes, ros1: bool) -> np.dtype[np.void]:
    """Return where the stamp and the numbers stand in messages laid out like this one."""
    order, align = ("<", 1) if ros1 else _encoding(raw)
    if len(raw) < 16:
        raise MessageError(f"{type_.name}: a message has {len(raw)} bytes; the rule is a whole header")
    length = struct.unpack_from(f"{order}I", raw, 12)[0]  # 12 is 4 encoding + stamp 8, or 4 number + stamp 8
    body = 0 if ros1 else 4
    at = 16 + length
    at += -(at - body) % align
    need = at + 8 * type_.n_numbers
    if len(raw) < need:
        raise MessageError(f"{type_.name}: a message has {len(raw)} bytes; the rule is {need}")
    return np.dtype(
        {
            "names": ["sec", "nanosec", "numbers"],
            "formats": [f"{order}{'u' if ros1 else 'i'}4", f"{order}u4", f"({type_.n_numbers},){order}f8"],
            "offsets": [4, 8, at],
            "itemsize": len(raw),
        }
    )


def _encoding(raw: bytes) -> tuple[str, int]:
    """Return byte order and the largest alignment of a CDR message: 8 in version 1, 4 in version 2."""
    kind = raw[1] if len(raw) > 3 and raw[0] == 0 else -1
    if kind not in (0, 1, 6, 7):
        raise MessageError(f"a message starts with {raw[:4].hex(' ')!r}; the rule is plain CDR")
    return "<" if kind % 2 else ">", 8 if kind < 2 else 4


def decode_multi_array(raw: bytes, *, ros1: bool) -> Samples:
    """Decode a `std_msgs/Float64MultiArray`.

    Two dimensions are (samples, channels), a block of samples; none or one is a single sample.

    Returns
    -------
    samples : ndarray of shape (n, n_channels)

    Raises
    ------
    MessageError
        If it is cut short, empty, or its dimensions are not those of its data.
    """
    order, align = ("<", 1) if ros1 else _encoding(raw)
    body = 0 if ros1 else 4
    try:
        sizes, at = _dimensions(raw, order, body, 1 if ros1 else 4)
        start, n_data = struct.unpack_from(f"{order}II", raw, at)
        at += 8
        at += -(at - body) % align
        data = np.frombuffer(raw, f"{order}f8", n_data, at)[start:]
    except (struct.error, ValueError) as error:
        raise MessageError(f"{MULTI_ARRAY}: a message is cut short ({error})") from error
    shape = tuple(sizes) if len(sizes) == 2 else (1, len(data))
    if not data.size or shape[0] * shape[1] != data.size or len(sizes) > 2 or shape[1] > MOST_CHANNELS:
        raise MessageError(
            f"{MULTI_ARRAY}: {data.size} numbers with dimensions {sizes}; the rule is (samples, channels), "
            f"or a single sample, of at most {MOST_CHANNELS} channels"
        )
    return data.astype(np.float64).reshape(shape)


def _dimensions(raw: bytes, order: str, at: int, align: int) -> tuple[list[int], int]:
    """Return the sizes of the dimensions of a layout, and where the layout's `data_offset` stands."""
    body = at
    (n,) = struct.unpack_from(f"{order}I", raw, at)
    at += 4
    sizes = []
    for _ in range(n):
        (length,) = struct.unpack_from(f"{order}I", raw, at)
        at += 4 + length
        at += -(at - body) % align
        sizes.append(struct.unpack_from(f"{order}II", raw, at)[0])
        at += 8
    return sizes, at
