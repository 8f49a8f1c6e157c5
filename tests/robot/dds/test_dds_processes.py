"""DDS between two processes over the loopback interface."""

import json
import time
from contextlib import closing

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (the extra `robot`)")

from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from texclass.recognition import open_source
from texclass.recording import RecordingError
from texclass.robot import ImuPublisher, Subscriber, discover, topic_blocks
from texclass.robot.dds import dds_topic, message_class, participant, quality


def test_no_sample_is_lost(child):
    fs = 10_000
    child("imu", "/fast", fs, 0.5, 0)
    source = topic_blocks("/fast", fs=fs, end_s=0.6)
    blocks = list(source)
    source.close()
    signal = np.concatenate([block.samples for block in blocks])
    np.testing.assert_array_equal(signal[:, 0], np.arange(0.5 * fs))
    np.testing.assert_array_equal(signal[:, 1:], [[0.5, 9.81]] * len(signal))
    assert {(block.fs, block.unit, block.n_lost, block.flags) for block in blocks} == {(fs, "m/s^2", 0, ())}
    steps = np.diff([block.t_s for block in blocks])
    np.testing.assert_allclose(steps, [len(block.samples) / fs for block in blocks[:-1]], atol=1e-6)


def test_a_stream_continues_after_a_restart_of_its_publisher(child):
    first = child("imu", "/imu", 500, 60, 0)
    source = open_source("ros2:/imu")
    flags, n_lost, largest = [], 0, 0.0
    second = None
    for block in source:
        flags += block.flags
        n_lost += block.n_lost
        largest = max(largest, block.samples[:, 0].max(initial=0.0))
        if second is None and largest > 300:
            first.kill()
            largest = 0.0
        if second is None and any(flag.startswith("silence") for flag in flags):
            second = child("imu", "/imu", 500, 60, 10_000)
        if second is not None and largest > 10_300:
            break
    source.close()
    assert block.fs == 500
    assert any(flag.startswith("silence: no message for 1") for flag in flags)
    assert n_lost >= 400


def wait_for(condition, seconds=5.0):
    """Wait wait_for a condition is true, and return whether it is."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return bool(condition())


def test_discovery_returns_type_and_reliability_and_detects_a_stopped_publisher(child):
    assert discover("/left", timeout_s=0.1) == []
    process = child("imu", "/left", 100, 0.1, 0)
    with closing(Subscriber("/left")) as subscriber:
        assert wait_for(lambda: subscriber.n_publishers, 10)
        assert discover("/left") == [("sensor_msgs/msg/Imu", "reliable")]
        process.stdin.write("\n")
        process.stdin.flush()
        assert wait_for(lambda: not subscriber.n_publishers)


def test_the_status_reports_an_incompatible_quality_of_service():
    publisher = ImuPublisher("/less", reliability="best effort")
    for reliability, status in (
        ("reliable", "the publisher does not offer the requested quality of service (try 'best effort')"),
        ("best effort", "a publisher is connected"),
    ):
        with closing(Subscriber("/less", reliability=reliability)) as subscriber:
            assert wait_for(lambda subscriber=subscriber, status=status: subscriber.status() == status)
    publisher.close()


def test_answers_arrive_as_json_and_as_diagnostics(child):
    domain_participant = participant()
    qos = quality("reliable", 10)
    text, array = (
        DataReader(
            domain_participant,
            Topic(domain_participant, dds_topic(name), message_class(kind), qos=qos),
            qos=qos,
        )
        for name, kind in (
            ("/surface", "std_msgs/msg/String"),
            ("/diag", "diagnostic_msgs/msg/DiagnosticArray"),
        )
    )
    child("answers", "/surface", "/diag")
    strings, arrays = [], []

    def has_both():
        strings.extend(text.take(10))
        arrays.extend(array.take(10))
        return len(strings) > 1 and len(arrays) > 1

    assert wait_for(has_both, 10)
    answers = [json.loads(message.data) for message in strings if hasattr(message, "data")]
    assert {answer["probability"] for answer in answers} == {0.9, 0.2}
    statuses = [message.status[0] for message in arrays if hasattr(message, "status")]
    assert {(status.level, status.message) for status in statuses} == {(0, "wood"), (1, "unknown surface")}
    values = {s.message: {pair.key: pair.value for pair in s.values} for s in statuses}
    reasons = '["unlike training"]'
    unknown = {"surface": "wood", "probability": "0.2", "unknown": "true", "reasons": reasons}
    assert values["unknown surface"] == unknown
    assert (arrays[0].header.stamp.sec, arrays[0].header.stamp.nanosec) == (5, 7)


def test_a_flag_lists_several_publishers():
    one, other = ImuPublisher("/two"), ImuPublisher("/two")
    source = topic_blocks("/two", fs=1000, end_s=0.5)
    with closing(Subscriber("/two")) as subscriber:
        assert wait_for(lambda: len(subscriber.publishers()) == 2)
        names = subscriber.publishers()
    assert wait_for(lambda: one.n_subscribers and other.n_subscribers)
    for i in range(50):
        one.publish(10**9 + i * 10**6, (i, 0, 0))
    blocks = list(source)
    (flag,) = [f for block in blocks for f in block.flags if f.startswith("publishers: the samples of 2")]
    assert all(name in flag for name in names)
    assert all(0 <= block.age_s < 10 for block in blocks)
    one.close()
    other.close()


@pytest.mark.parametrize("domain", ["999", "-1", "two"])
def test_invalid_options_of_topics_raise_an_error(domain, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    with pytest.raises(ValueError, match=f"ROS_DOMAIN_ID must be .* from 0 to 232, got '{domain}'"):
        open_source("ros2:/imu", wait_s=0.1)
    with pytest.raises(ValueError, match=r"domain must be .* from 0 to 232, got '1000'"):
        open_source("ros2:/imu", domain=1000, column=None, depth=None)
    with pytest.raises(ValueError, match="reliability must be 'reliable' or 'best effort', got 'fast'"):
        open_source("ros2:/imu", reliability="fast")
    with pytest.raises(ValueError, match="depth must be at least 1 message, got 0"):
        open_source("ros2:/imu", depth=0)
    with pytest.raises(ValueError, match=r"depth can only be used with ROS 2 topics .* got source -"):
        open_source("-", fs=100, unit="g", depth=5)


def test_a_topic_without_publisher_raises_an_error():
    with pytest.raises(RecordingError, match=r"ros2:/nothing: no publisher within 0.1 s"):
        topic_blocks("/nothing", wait_s=0.1)


def test_types_units_and_columns_are_checked(child):
    with pytest.raises(ValueError, match=r"must be one of sensor_msgs/msg/Imu.* got 'std_msgs/msg/String'"):
        Subscriber("/x", "std_msgs/msg/String")
    with pytest.raises(ValueError, match=r"no columns pitch. Expected some of ax, ay"):
        Subscriber("/x", columns=("pitch",))
    with pytest.raises(RecordingError, match=r"unit must be 'm/s\^2' for sensor_msgs/msg/Imu, got 'g'"):
        topic_blocks("/x", type_name="sensor_msgs/msg/Imu", reliability="reliable", unit="g")
