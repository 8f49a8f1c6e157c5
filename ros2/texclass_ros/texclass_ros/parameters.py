"""Parameters of the node, with default values and descriptions."""

from texclass.recognition import OnlineSettings

PARAMETERS = {
    "model": ("", "Model file written by `texclass train`. Required."),
    "topic": ("imu", "Topic of the sensor."),
    "message_type": (
        "sensor_msgs/msg/Imu",
        "sensor_msgs/msg/Imu, geometry_msgs/msg/AccelStamped or std_msgs/msg/Float64MultiArray.",
    ),
    "unit": ("", "Unit of the acceleration in a Float64MultiArray. Empty: as in training."),
    "fs": (0.0, "Sampling rate in Hz. 0: measured during the first second."),
    "queue_depth": (1000, "Number of messages that wait while the node is busy; older ones are dropped."),
    "frame_id": ("", "Frame in the headers of the answers. Empty: the frame of the sensor messages."),
    "window_s": (0.0, "Length of a window in s. 0: as in training."),
    "hop_s": (0.0, "Time between two answers in s. 0: half a window."),
    "evidence": ("sequential", "Rule that combines the windows of a contact: sequential or majority."),
    "confidence": (0.95, "Probability from which an answer is sure."),
    "stop_when_sure": (False, "Skip the remaining windows of a contact once its answer is sure."),
    "always_in_contact": (False, "For wheels and legs: detect no lift-off, and let evidence decay."),
    "forget_s": (0.0, "Time constant in s with which evidence decays. 0: no decay."),
    "adapt": (False, "Adapt the model to the last contacts, without labels, as the sensor drifts."),
    "diagnostics_period_s": (1.0, "Time between two diagnostic messages in s."),
}
"""Name -> default value and description."""


def online_settings(values):
    """Return the settings of the recognition for the values of the parameters."""
    return OnlineSettings(
        window_s=values["window_s"] or None,
        hop_s=values["hop_s"] or None,
        evidence=values["evidence"],
        confidence=values["confidence"],
        stop_when_sure=values["stop_when_sure"],
        always_in_contact=values["always_in_contact"],
        forget_s=values["forget_s"] or float("inf"),
    )
