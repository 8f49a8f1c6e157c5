"""Messages of ROS as bytes: which types can be signals, what their numbers mean; rosbags decodes them.

The same bytes stand in bags and go over the wire: CDR of ROS 2, and the packed form of ROS 1.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

import numpy as np

from texclass.loaders.columns import TURN_RATE
from texclass.loaders.timestamps import Timestamps
from texclass.recording import RecordingError, Samples

MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
MOST_CHANNELS = 1024
"""Channels of a `Float64MultiArray`; more is taken for a damaged message."""


class MessageError(ValueError):
    """A message is not what its type says; the message names type, value and rule."""


@dataclass(frozen=True)
class MessageType:
    """A type of messages with a header (time stamp and frame).

    Attributes
    ----------
    name
        "package/msg/Type".
    columns
        Column -> where its number stands in a message; several places stand for their norm.
    acceleration
        Columns that are an acceleration; empty where the type has none.
    unit
        Of the acceleration.
    factors
        Column -> factor to the unit `Recording` keeps it in, where that is not 1.
    disclaimers
        Column -> covariance whose first number is -1 where the sender lacks the column.
    definition
        As a bag tells it, of a type that is not known here.
    """

    name: str
    columns: dict[str, tuple[str, ...]]
    acceleration: tuple[str, ...] = ()
    unit: str | None = None
    factors: dict[str, float] = field(default_factory=dict)
    disclaimers: dict[str, str] = field(default_factory=dict)
    definition: str = ""


def _axes(vector: str, *names: str) -> dict[str, tuple[str, ...]]:
    return {name: (f"{vector}.{axis}",) for name, axis in zip(names, "xyz", strict=True)}


_ACCELERATION = ("ax", "ay", "az")
_TWIST = _axes("twist.linear", "vx", "vy", "vz")
_WRENCH = _axes("wrench.force", "fx", "fy", "fz")
TYPES = {
    type_.name: type_
    for type_ in (
        MessageType(
            "sensor_msgs/msg/Imu",
            _axes("linear_acceleration", *_ACCELERATION) | _axes("angular_velocity", *TURN_RATE),
            _ACCELERATION,
            "m/s^2",
            disclaimers=dict.fromkeys(_ACCELERATION, "linear_acceleration_covariance")
            | dict.fromkeys(TURN_RATE, "angular_velocity_covariance"),
        ),
        MessageType(
            "geometry_msgs/msg/AccelStamped", _axes("accel.linear", *_ACCELERATION), _ACCELERATION, "m/s^2"
        ),
        MessageType(
            "geometry_msgs/msg/TwistStamped",
            _TWIST | {"speed": sum(_TWIST.values(), ())} | _axes("twist.angular", *TURN_RATE),
            factors={"speed": 1000.0},
        ),
        MessageType(
            "geometry_msgs/msg/WrenchStamped",
            _WRENCH | {"force": sum(_WRENCH.values(), ())} | _axes("wrench.torque", "tx", "ty", "tz"),
        ),
    )
}
"""Types with a header, by name; speed is in mm/s, what else there is in SI units."""
READABLE = (*TYPES, MULTI_ARRAY)


@functools.cache
def type_of(name: str, definition: str, ros1: bool) -> MessageType | None:
    """Return what messages of a type hold: of one not known here, every number by its place ("angle.roll").

    Parameters
    ----------
    name : str
        "package/msg/Type".
    definition : str
        As a bag tells it; "" if it does not.
    ros1 : bool
        Packed as by ROS 1, not in CDR.

    Returns
    -------
    type_ : MessageType or None
        None without a definition that can be read, with a header and numbers.
    """
    if name in TYPES or not 0 < len(definition) <= 1 << 16:
        return TYPES.get(name)
    try:
        store = _store(ros1, name, definition)
        columns: dict[str, tuple[str, ...]] = {place: (place,) for place in _numbers(store, name)}
        has_header = dict(store.get_msgdef(name).fields)["header"][1] == "std_msgs/msg/Header"
    except Exception:  # of a damaged definition the library raises almost anything
        return None
    return MessageType(name, columns, definition=definition) if has_header and columns else None


def _numbers(store: Any, name: str) -> tuple[str, ...]:
    """Return the places of the numbers of a message, those of its header and of arrays left out."""

    @functools.cache
    def places_of(type_name: str) -> tuple[str, ...]:
        places: list[str] = []
        for own, (kind, described) in store.get_msgdef(type_name).fields:
            if kind.name == "NAME" and described != "std_msgs/msg/Header":
                places += [f"{own}.{place}" for place in places_of(described)]
            elif kind.name == "BASE" and described[0].startswith(("float", "int", "uint")):
                places.append(own)
            if len(places) > MOST_CHANNELS:
                raise ValueError(f"{type_name} has more than {MOST_CHANNELS} numbers")
        return tuple(places)

    return places_of(name)


def decode_stamped(
    type_: MessageType, raws: Sequence[bytes], columns: Sequence[str], *, ros1: bool
) -> tuple[Timestamps, Samples]:
    """Decode columns of messages with a header, in the units a `Recording` keeps them in.

    A covariance that begins with -1 says that its columns are not measured [sensor_msgs/Imu]. Some drivers
    put it beside real numbers, whose covariance they do not know: only with zeros (or NaN) in every message
    is it taken at its word.

    Parameters
    ----------
    type_ : MessageType
        What they are.
    raws : sequence of bytes
        Serialised messages, at least one.
    columns : sequence of str
        Of `type_.columns`.
    ros1 : bool
        Packed as by ROS 1, not in CDR.

    Returns
    -------
    stamps_ns : ndarray of shape (n,)
        Time stamps of the headers, nanoseconds.
    samples : ndarray of shape (n, n_columns)

    Raises
    ------
    MessageError
        If a message is damaged or not in plain CDR.
    RecordingError
        If the messages say that a column is not measured.
    """
    places = list(dict.fromkeys(place for column in columns for place in type_.columns[column]))
    messages = [_decoded(raw, type_.name, ros1, type_.definition) for raw in raws]
    stamp = attrgetter("header.stamp.sec", "header.stamp.nanosec")
    stamps = np.array([stamp(message) for message in messages], np.int64) @ (1_000_000_000, 1)
    numbers = {place: np.array([*map(attrgetter(place), messages)], np.float64) for place in places}
    absent = []
    samples = np.empty((len(raws), len(columns)))
    for i, column in enumerate(columns):
        first, *others = type_.columns[column]
        disclaimer = attrgetter(type_.disclaimers[column]) if column in type_.disclaimers else None
        with np.errstate(invalid="ignore", over="ignore"):  # of damaged numbers
            norm = functools.reduce(np.hypot, (numbers[place] for place in others), numbers[first])
            samples[:, i] = norm * type_.factors.get(column, 1.0)
        is_said = disclaimer is not None and all(disclaimer(message)[0] == -1 for message in messages)
        if is_said and np.all((norm == 0) | np.isnan(norm)):
            absent.append(column)
    if absent:
        raise RecordingError(
            f"its messages say that {', '.join(sorted(absent))} are not measured (a covariance that begins "
            "with -1). Expected a sensor that measures them"
        )
    return stamps, samples


def decode_multi_array(raw: bytes, *, ros1: bool) -> Samples:
    """Decode a `std_msgs/Float64MultiArray`.

    Two dimensions are (samples, channels), a block of samples; none or one is a single sample.

    Returns
    -------
    samples : ndarray of shape (n, n_channels)

    Raises
    ------
    MessageError
        If it is damaged, empty, or its dimensions are not those of its data.
    """
    message = _decoded(raw, MULTI_ARRAY, ros1)
    sizes = [dimension.size for dimension in message.layout.dim]
    data = message.data[message.layout.data_offset :]
    shape = tuple(sizes) if len(sizes) == 2 else (1, len(data))
    if not data.size or shape[0] * shape[1] != data.size or len(sizes) > 2 or shape[1] > MOST_CHANNELS:
        raise MessageError(
            f"{MULTI_ARRAY}: {data.size} numbers with dimensions {sizes}. Expected (samples, channels), "
            f"or a single sample, of at most {MOST_CHANNELS} channels"
        )
    return np.asarray(data, np.float64).reshape(shape)


def _decoded(raw: bytes, type_name: str, ros1: bool, definition: str = "") -> Any:
    try:
        store = _store(ros1, type_name, definition) if definition else _store(ros1)
        decode = store.deserialize_ros1 if ros1 else store.deserialize_cdr
        return decode(raw, type_name)
    except Exception as error:  # damaged bytes make the library raise almost anything
        raise MessageError(
            f"{type_name}: a message of {len(raw)} bytes is damaged ({error}). Expected a whole message "
            "in plain CDR, or as ROS 1 packs it"
        ) from error


@functools.cache
def _store(ros1: bool, name: str = "", definition: str = "") -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # of the extra `robot`

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if definition:
        told = get_types_from_msg(definition, name)
        store.register({key: value for key, value in told.items() if key not in store.fielddefs})
    return store
