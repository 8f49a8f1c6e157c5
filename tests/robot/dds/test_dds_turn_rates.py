"""Turn rates over DDS, for a model that was trained on them."""

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (the extra `robot`)")

from turning_surfaces import FS, N, recording, values

from texclass.recognition import Notice, OnlineSettings, Session, WindowAnswer, open_source
from texclass.recording import RecordingError
from texclass.robot import topic_blocks
from texclass.robot.dds import message_class
from texclass.robot.topic import decode_messages


def test_a_model_that_needs_turn_rates_receives_them_over_dds(child, turning, tmp_path):
    terrain = "grass"
    rows = values(terrain, 70)
    rows[:, :3] -= np.median(rows[:, :3], axis=0)
    np.save(tmp_path / "rows.npy", rows)
    child("rows", "/turning", FS, tmp_path / "rows.npy")
    source = topic_blocks("/turning", fs=FS, end_s=0.6, columns=turning.input_columns)
    session = Session(turning, settings=OnlineSettings(starts_in_contact=True, window_s=N / FS))
    samples, updates = [], []
    for block in source:
        samples.append(block.samples)
        updates += session.push(block)
    source.close()
    np.testing.assert_array_equal(np.concatenate(samples), rows)
    assert not any(isinstance(update, Notice) for update in updates)
    (answer,) = [update.answer for update in updates if isinstance(update, WindowAnswer)]
    expected = turning.answer(recording(terrain, 70))
    assert expected.surface == terrain
    assert answer.probabilities == pytest.approx(expected.probabilities)


def test_open_source_requests_the_columns_of_the_model(child, turning, monkeypatch):
    monkeypatch.setattr("texclass.robot.topic.ZERO_TURN_RATE_S", 0.2)
    child("imu", "/plain", 200, 30, 0)
    source = open_source("ros2:/plain", fs=200, model=turning)
    flags = []
    for block in source:
        assert block.samples.shape[1] == 6
        flags += block.flags
        if flags:
            break
    assert flags == ["turn rate: 0 for the first 0.2 s. Check that the sensor measures it"]
    source.close()
    with pytest.raises(RecordingError, match=r"geometry_msgs/msg/AccelStamped has no turn rate. Expected ax"):
        topic_blocks(
            "/x",
            type_name="geometry_msgs/msg/AccelStamped",
            reliability="reliable",
            columns=turning.input_columns,
        )


def test_messages_that_declare_a_needed_column_as_not_measured_raise_an_error():
    imu, vector = message_class("sensor_msgs/msg/Imu"), message_class("geometry_msgs/msg/Vector3")
    header = message_class("std_msgs/msg/Header")(message_class("builtin_interfaces/msg/Time")(1, 5), "imu")
    a = vector(0.5, 0.5, 9.81)
    columns = ("ax", "wx", "wy", "wz")
    covariance = [-1.0] + [0.0] * 8

    def decode(**fields):
        raw = imu(header, linear_acceleration=a, **fields).serialize(use_version_2=False)
        return decode_messages([raw, raw], [7, 8], "sensor_msgs/msg/Imu", columns)

    with pytest.raises(RecordingError, match="declare wx, wy, wz as not measured"):
        decode(angular_velocity_covariance=covariance)
    batch = decode(angular_velocity=vector(0.1, 0.2, 0.3), angular_velocity_covariance=covariance)
    np.testing.assert_array_equal(batch.samples[0], [[0.5, 0.1, 0.2, 0.3]])
    orientation_only = imu(header, linear_acceleration_covariance=covariance).serialize(use_version_2=False)
    with pytest.raises(RecordingError, match="declare ax, ay, az as not measured"):
        decode_messages([orientation_only], [7], "sensor_msgs/msg/Imu", ("ax", "ay", "az"))
