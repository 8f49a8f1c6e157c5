"""Standard messages of ROS 2 as DDS types, and the names under which ROS 2 sends them.

ROS 2 puts `rt/` before a topic, calls the type `package::msg::dds_::Type_`, and serialises in CDR version 1.
What is here has the same names, members and bytes, so that a ROS 2 node can be at the other end.
"""

from dataclasses import dataclass, field

from cyclonedds.idl import IdlStruct, types

from texclass.loaders.ros_messages import MULTI_ARRAY


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


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    """Seconds and nanoseconds."""

    sec: types.int32 = 0
    nanosec: types.uint32 = 0


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    """When and in which frame."""

    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    """A vector."""

    x: types.float64 = 0.0
    y: types.float64 = 0.0
    z: types.float64 = 0.0


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    """A rotation."""

    x: types.float64 = 0.0
    y: types.float64 = 0.0
    z: types.float64 = 0.0
    w: types.float64 = 1.0


def _no_covariance() -> list[float]:
    return [0.0] * 9


@dataclass
class Imu(IdlStruct, typename="sensor_msgs::msg::dds_::Imu_"):
    """Acceleration (m/s^2) and turn rate (rad/s) of an inertial unit."""

    header: Header = field(default_factory=Header)
    orientation: Quaternion = field(default_factory=Quaternion)
    orientation_covariance: types.array[types.float64, 9] = field(default_factory=_no_covariance)
    angular_velocity: Vector3 = field(default_factory=Vector3)
    angular_velocity_covariance: types.array[types.float64, 9] = field(default_factory=_no_covariance)
    linear_acceleration: Vector3 = field(default_factory=Vector3)
    linear_acceleration_covariance: types.array[types.float64, 9] = field(default_factory=_no_covariance)


@dataclass
class Accel(IdlStruct, typename="geometry_msgs::msg::dds_::Accel_"):
    """Linear (m/s^2) and angular acceleration."""

    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@dataclass
class AccelStamped(IdlStruct, typename="geometry_msgs::msg::dds_::AccelStamped_"):
    """`Accel` with a header."""

    header: Header = field(default_factory=Header)
    accel: Accel = field(default_factory=Accel)


@dataclass
class MultiArrayDimension(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayDimension_"):
    """One dimension of a `Float64MultiArray`."""

    label: str = ""
    size: types.uint32 = 0
    stride: types.uint32 = 0


@dataclass
class MultiArrayLayout(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayLayout_"):
    """The dimensions of a `Float64MultiArray`."""

    dim: types.sequence[MultiArrayDimension] = field(default_factory=list)
    data_offset: types.uint32 = 0


@dataclass
class Float64MultiArray(IdlStruct, typename="std_msgs::msg::dds_::Float64MultiArray_"):
    """Numbers: a sample of many channels, or a block of (samples, channels)."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: types.sequence[types.float64] = field(default_factory=list)


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    """A text."""

    data: str = ""


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    """A name and a text."""

    key: str = ""
    value: str = ""


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    """How something is: level 0 ok, 1 warning, 2 error, 3 stale."""

    level: types.uint8 = 0
    name: str = ""
    message: str = ""
    hardware_id: str = ""
    values: types.sequence[KeyValue] = field(default_factory=list)


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    """What /diagnostics carries."""

    header: Header = field(default_factory=Header)
    status: types.sequence[DiagnosticStatus] = field(default_factory=list)


SIGNALS: dict[str, type[IdlStruct]] = {
    "sensor_msgs/msg/Imu": Imu,
    "geometry_msgs/msg/AccelStamped": AccelStamped,
    MULTI_ARRAY: Float64MultiArray,
}
"""Types that can be subscribed to, by their ROS 2 name."""
