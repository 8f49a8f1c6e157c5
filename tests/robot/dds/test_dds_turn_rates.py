"""Turn rates from another process, over loopback, as a model that was trained on them needs them."""

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (the extra `robot`)")

from turning_surfaces import FS, N, recording, values

from texclass.recognition import Notice, OnlineSettings, Session, WindowAnswer, open_source
from texclass.recording import RecordingError
from texclass.robot import topic_blocks
from texclass.robot.dds import message_class
from texclass.robot.topic import decoded_messages


def test_a_model_of_turn_rates_hears_them_over_dds(child, turning, tmp_path):
    terrain = "grass"
    both = values(terrain, 70)
    both[:, :3] -= np.median(both[:, :3], axis=0)
    np.save(tmp_path / "rows.npy", both)
    child("rows", "/turning", FS, tmp_path / "rows.npy")
    source = topic_blocks("/turning", fs=FS, end_s=0.6, needs=turning.needs)
    session = Session(turning, settings=OnlineSettings(assume_contact=True, window_s=N / FS))
    heard, said = [], []
    for block in source:
        heard.append(block.samples)
        said += session.take(block)
    source.close()
    np.testing.assert_array_equal(np.concatenate(heard), both)
    assert not any(isinstance(update, Notice) for update in said)
    (answer,) = [update.answer for update in said if isinstance(update, WindowAnswer)]
    asked = turning.answer(recording(terrain, 70))
    assert asked.surface == terrain
    assert answer.probabilities == pytest.approx(asked.probabilities)


def test_open_source_asks_a_topic_for_what_the_model_needs(child, turning, monkeypatch):
    monkeypatch.setattr("texclass.robot.topic.UNTURNED_S", 0.2)
    child("imu", "/plain", 200, 30, 0)
    source = open_source("ros2:/plain", fs=200, model=turning)
    flags = []
    for block in source:
        assert block.samples.shape[1] == 6
        flags += block.flags
        if flags:
            break
    assert flags == ["turn rate: 0 for the first 0.2 s, does the sensor measure it?"]
    source.close()
    with pytest.raises(RecordingError, match=r"geometry_msgs/msg/AccelStamped has no turn rate. Expected ax"):
        topic_blocks(
            "/x", type_name="geometry_msgs/msg/AccelStamped", reliability="reliable", needs=turning.needs
        )


def test_messages_that_disclaim_what_is_needed_end_the_stream_with_a_reason():
    imu, vector = message_class("sensor_msgs/msg/Imu"), message_class("geometry_msgs/msg/Vector3")
    header = message_class("std_msgs/msg/Header")(message_class("builtin_interfaces/msg/Time")(1, 5), "imu")
    a = vector(0.5, 0.5, 9.81)
    columns = ("ax", "wx", "wy", "wz")
    covariance = [-1.0] + [0.0] * 8

    def take(**facts):
        raw = imu(header, linear_acceleration=a, **facts).serialize(use_version_2=False)
        return decoded_messages([raw, raw], [7, 8], "sensor_msgs/msg/Imu", columns)

    with pytest.raises(RecordingError, match="say that wx, wy, wz are not measured"):
        take(angular_velocity_covariance=covariance)
    measured = take(angular_velocity=vector(0.1, 0.2, 0.3), angular_velocity_covariance=covariance)
    np.testing.assert_array_equal(measured.samples[0], [[0.5, 0.1, 0.2, 0.3]])
    orientation_only = imu(header, linear_acceleration_covariance=covariance).serialize(use_version_2=False)
    with pytest.raises(RecordingError, match="say that ax, ay, az are not measured"):
        decoded_messages([orientation_only], [7], "sensor_msgs/msg/Imu", ("ax", "ay", "az"))
