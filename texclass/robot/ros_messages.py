"""Types, columns and units of ROS messages that contain signals, and their decoding (with rosbags).

Bags and DDS contain messages in the same serialisation: CDR in ROS 2, a packed form in ROS 1.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from texclass.loaders.columns import TURN_RATE
from texclass.loaders.timestamps import Timestamps
from texclass.recording import RecordingError, Samples

if TYPE_CHECKING:
    from texclass.recognition.sources.training_input import InputColumns

MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
MAX_CHANNELS = 1024
"""Largest number of channels of a message; a larger number indicates a damaged message."""


class MessageError(ValueError):
    """Error for a message whose content is invalid; the text names the message type."""


@dataclass(frozen=True)
class MessageType:
    """Message type with a header (time stamp and frame).

    Attributes
    ----------
    name
        Name "package/msg/Type".
    columns
        Column -> fields of the message. The value of a column with several fields is their norm.
    acceleration
        Columns of the acceleration; empty if the type has none.
    unit
        Unit of the acceleration.
    factors
        Column -> factor that converts its values to the unit of `Recording` (default 1).
    covariances
        Column -> field of the covariance, whose first number is -1 if the sensor does not measure the column.
    definition
        Message definition in the bag, for types that are not in `TYPES`.
    """

    name: str
    columns: dict[str, tuple[str, ...]]
    acceleration: tuple[str, ...] = ()
    unit: str | None = None
    factors: dict[str, float] = field(default_factory=dict)
    covariances: dict[str, str] = field(default_factory=dict)
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
            covariances=dict.fromkeys(_ACCELERATION, "linear_acceleration_covariance")
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
"""Types with a header, by name. Speeds are in mm/s, all other columns in SI units."""
READABLE = (*TYPES, MULTI_ARRAY)
LIVE = ("sensor_msgs/msg/Imu", "geometry_msgs/msg/AccelStamped", MULTI_ARRAY)
"""Message types with an acceleration, which can be classified live."""


def live_signals(
    type_name: str, columns: "InputColumns", unit: str | None, where: str
) -> tuple[tuple[str, ...], str]:
    """Return the columns to read from messages of a type, and the unit of their acceleration.

    Parameters
    ----------
    type_name : str
        Message type.
    columns : InputColumns
        Columns that the model needs.
    unit : str or None
        Unit stated by the user.
    where : str
        Topic named in the messages.

    Returns
    -------
    names : tuple of str
        Columns of `TYPES`; empty for an array, which must have the columns of the model in their order.
    unit : str
        Unit of the acceleration.

    Raises
    ------
    RecordingError
        If the type has no acceleration or lacks a signal that the model needs, or `unit` is not its unit.
    """
    if type_name not in LIVE:
        raise RecordingError(
            f"{where}: cannot read messages of type {type_name!r}. Expected {', '.join(LIVE)}"
        )
    if type_name not in TYPES:
        return (), unit or "arbitrary"
    type_ = TYPES[type_name]
    turn = TURN_RATE if "turn_rate" in columns.auxiliary else ()
    for signal in columns.auxiliary:
        if signal != "turn_rate" or not set(turn) <= set(type_.columns):
            raise RecordingError(f"{where}: {type_name} has {columns.missing_signal(signal)}")
    if unit not in (None, type_.unit):
        raise RecordingError(
            f"{where}: unit must be {type_.unit!r} for {type_name}, got {unit!r}. Omit the unit"
        )
    return (*type_.acceleration, *turn), type_.unit or "arbitrary"


@functools.cache
def type_of(name: str, definition: str, ros1: bool) -> MessageType | None:
    """Return the type with the given name: one of `TYPES`, or one with all numeric fields of the definition.

    Parameters
    ----------
    name : str
        Name "package/msg/Type".
    definition : str
        Message definition in the bag; "" if there is none.
    ros1 : bool
        Whether messages are packed as in ROS 1, not in CDR.

    Returns
    -------
    type_ : MessageType or None
        Message type; None if the definition cannot be read, or has no header or no numbers.

    Examples
    --------
    >>> type_of("sensor_msgs/msg/Imu", "", ros1=False).acceleration
    ('ax', 'ay', 'az')
    """
    if name in TYPES or not 0 < len(definition) <= 1 << 16:
        return TYPES.get(name)
    try:
        store = _store(ros1, name, definition)
        columns: dict[str, tuple[str, ...]] = {field: (field,) for field in _numeric_fields(store, name)}
        has_header = dict(store.get_msgdef(name).fields)["header"][1] == "std_msgs/msg/Header"
    except Exception:  # the library raises many kinds of errors for damaged definitions
        return None
    return MessageType(name, columns, definition=definition) if has_header and columns else None


def _numeric_fields(store: Any, name: str) -> tuple[str, ...]:
    """Return the numeric fields of a message type, such as "angle.roll", without its header and arrays."""

    @functools.cache
    def fields_of(type_name: str) -> tuple[str, ...]:
        fields: list[str] = []
        for field_name, (kind, description) in store.get_msgdef(type_name).fields:
            if kind.name == "NAME" and description != "std_msgs/msg/Header":
                fields += [f"{field_name}.{inner}" for inner in fields_of(description)]
            elif kind.name == "BASE" and description[0].startswith(("float", "int", "uint")):
                fields.append(field_name)
            if len(fields) > MAX_CHANNELS:
                raise ValueError(f"{type_name} has more than {MAX_CHANNELS} numbers")
        return tuple(fields)

    return fields_of(name)


def decode_stamped(
    type_: MessageType, raws: Sequence[bytes], columns: Sequence[str], *, ros1: bool
) -> tuple[Timestamps, Samples]:
    """Decode columns of messages with a header, in the units of `Recording`.

    Parameters
    ----------
    type_ : MessageType
        Type of the messages.
    raws : sequence of bytes
        Serialised messages, at least one.
    columns : sequence of str
        Columns to decode, from `type_.columns`.
    ros1 : bool
        Whether messages are packed as in ROS 1, not in CDR.

    Returns
    -------
    timestamps_ns : ndarray of shape (n,)
        Time stamps of the headers in nanoseconds.
    samples : ndarray of shape (n, n_columns)
        Values of the columns.

    Raises
    ------
    MessageError
        If a message is damaged or not in plain CDR.
    RecordingError
        If the messages declare a column as not measured.
    """
    messages = [_deserialize(raw, type_.name, ros1, type_.definition) for raw in raws]
    return stamped_samples(type_, messages, columns)


def stamped_samples(
    type_: MessageType, messages: Sequence[Any], columns: Sequence[str]
) -> tuple[Timestamps, Samples]:
    """Return time stamps and columns of decoded messages with a header, in the units of `Recording`.

    A covariance that starts with -1 declares its columns as not measured [sensor_msgs/Imu]. Some drivers also
    send such a covariance when only the covariance is unknown. The declaration is therefore ignored unless
    the values are 0 or NaN in every message.

    Parameters
    ----------
    type_ : MessageType
        Type of the messages.
    messages : sequence of object
        Messages with the fields of the type as attributes, at least one: of rosbags, rclpy or DDS.
    columns : sequence of str
        Columns to return, from `type_.columns`.

    Returns
    -------
    timestamps_ns : ndarray of shape (n,)
        Time stamps of the headers in nanoseconds.
    samples : ndarray of shape (n, n_columns)
        Values of the columns.

    Raises
    ------
    RecordingError
        If the messages declare a column as not measured.
    """
    names = list(dict.fromkeys(name for column in columns for name in type_.columns[column]))
    stamp = attrgetter("header.stamp.sec", "header.stamp.nanosec")
    timestamps = np.array([stamp(message) for message in messages], np.int64) @ (1_000_000_000, 1)
    values = {name: np.array([*map(attrgetter(name), messages)], np.float64) for name in names}
    missing = []
    samples = np.empty((len(messages), len(columns)))
    for i, column in enumerate(columns):
        first, *others = type_.columns[column]
        covariance = attrgetter(type_.covariances[column]) if column in type_.covariances else None
        with np.errstate(invalid="ignore", over="ignore"):  # damaged messages contain any number
            norm = functools.reduce(np.hypot, (values[name] for name in others), values[first])
            samples[:, i] = norm * type_.factors.get(column, 1.0)
        is_declared = covariance is not None and all(covariance(message)[0] == -1 for message in messages)
        if is_declared and np.all((norm == 0) | np.isnan(norm)):
            missing.append(column)
    if missing:
        raise RecordingError(
            f"the messages declare {', '.join(sorted(missing))} as not measured (a covariance that starts "
            "with -1). Expected a sensor that measures them"
        )
    return timestamps, samples


def decode_multi_array(raw: bytes, *, ros1: bool) -> Samples:
    """Decode a `std_msgs/Float64MultiArray` with the dimensions (samples, channels).

    An array with fewer dimensions is one sample.

    Parameters
    ----------
    raw : bytes
        Serialised message.
    ros1 : bool
        Whether the message is packed as in ROS 1, not in CDR.

    Returns
    -------
    samples : ndarray of shape (n, n_channels)
        Samples of the message.

    Raises
    ------
    MessageError
        If the message is damaged or empty, or its dimensions do not fit its data.
    """
    return multi_array_samples(_deserialize(raw, MULTI_ARRAY, ros1))


def multi_array_samples(message: Any) -> Samples:
    """Return the samples (n, n_channels) of a decoded `std_msgs/Float64MultiArray`.

    Raises
    ------
    MessageError
        If the message is empty, or its dimensions do not fit its data.
    """
    sizes = [dimension.size for dimension in message.layout.dim]
    data = np.asarray(message.data[message.layout.data_offset :], np.float64)
    shape = tuple(sizes) if len(sizes) == 2 else (1, len(data))
    if not data.size or shape[0] * shape[1] != data.size or len(sizes) > 2 or shape[1] > MAX_CHANNELS:
        raise MessageError(
            f"{MULTI_ARRAY}: got {data.size} numbers with dimensions {sizes}. Expected (samples, channels), "
            f"or a single sample, with at most {MAX_CHANNELS} channels"
        )
    return data.reshape(shape)


def _deserialize(raw: bytes, type_name: str, ros1: bool, definition: str = "") -> Any:
    try:
        store = _store(ros1, type_name, definition) if definition else _store(ros1)
        decode = store.deserialize_ros1 if ros1 else store.deserialize_cdr
        return decode(raw, type_name)
    except Exception as error:  # the library raises many kinds of errors for damaged messages
        raise MessageError(
            f"{type_name}: a message of {len(raw)} bytes is damaged ({error}). Expected a complete message "
            "in plain CDR, or in the format of ROS 1"
        ) from error


@functools.cache
def _store(ros1: bool, name: str = "", definition: str = "") -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # of the extra `robot`

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if definition:
        definitions = get_types_from_msg(definition, name)
        store.register({key: value for key, value in definitions.items() if key not in store.fielddefs})
    return store
