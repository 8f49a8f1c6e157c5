"""Two real processes over loopback."""

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
    assert {(block.fs, block.unit, block.lost, block.flags) for block in blocks} == {(fs, "m/s^2", 0, ())}
    steps = np.diff([block.t_s for block in blocks])
    np.testing.assert_allclose(steps, [len(block.samples) / fs for block in blocks[:-1]], atol=1e-6)


def test_a_publisher_that_dies_and_comes_back_is_heard_again(child):
    first = child("imu", "/imu", 500, 60, 0)
    source = open_source("ros2:/imu")
    flags, lost, largest = [], 0, 0.0
    second = None
    for block in source:
        flags += block.flags
        lost += block.lost
        largest = max(largest, block.samples[:, 0].max(initial=0.0))
        if second is None and largest > 300:
            first.kill()
            largest = 0.0
        if second is None and any(flag.startswith("silent") for flag in flags):
            second = child("imu", "/imu", 500, 60, 10_000)
        if second is not None and largest > 10_300:
            break
    source.close()
    assert block.fs == 500
    assert any(flag.startswith("silent: nothing for 1") for flag in flags)
    assert lost >= 400


def until(condition, seconds=5.0):
    """Return whether a condition holds within some seconds."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return bool(condition())


def test_discovery_tells_type_and_reliability_and_a_publisher_that_leaves(child):
    assert discover("/left", timeout_s=0.1) == []
    process = child("imu", "/left", 100, 0.1, 0)
    with closing(Subscriber("/left")) as subscriber:
        assert until(lambda: subscriber.n_publishers, 10)
        assert discover("/left") == [("sensor_msgs/msg/Imu", "reliable")]
        process.stdin.write("\n")
        process.stdin.flush()
        assert until(lambda: not subscriber.n_publishers)


def test_a_publisher_that_offers_less_than_is_asked_for_is_told_from_one_that_is_gone():
    publisher = ImuPublisher("/less", reliability="best effort")
    for reliability, told in (
        ("reliable", "its publisher does not offer what is asked for (reliable?)"),
        ("best effort", "its publisher is there"),
    ):
        with closing(Subscriber("/less", reliability=reliability)) as subscriber:
            assert until(lambda subscriber=subscriber, told=told: subscriber.whereabouts() == told)
    publisher.close()


def test_answers_arrive_as_json_and_as_diagnostics(child):
    member = participant()
    qos = quality("reliable", 10)
    text, array = (
        DataReader(member, Topic(member, dds_topic(name), message_class(kind), qos=qos), qos=qos)
        for name, kind in (
            ("/surface", "std_msgs/msg/String"),
            ("/diag", "diagnostic_msgs/msg/DiagnosticArray"),
        )
    )
    child("answers", "/surface", "/diag")
    said, told = [], []

    def heard():
        said.extend(text.take(10))
        told.extend(array.take(10))
        return len(said) > 1 and len(told) > 1

    assert until(heard, 10)
    answers = [json.loads(message.data) for message in said if hasattr(message, "data")]
    assert {answer["probability"] for answer in answers} == {0.9, 0.2}
    statuses = [message.status[0] for message in told if hasattr(message, "status")]
    assert {(status.level, status.message) for status in statuses} == {(0, "wood"), (1, "unknown surface")}
    values = {s.message: {pair.key: pair.value for pair in s.values} for s in statuses}
    reasons = '["never felt"]'
    unknown = {"surface": "wood", "probability": "0.2", "unknown": "true", "reasons": reasons}
    assert values["unknown surface"] == unknown
    assert (told[0].header.stamp.sec, told[0].header.stamp.nanosec) == (5, 7)


def test_several_publishers_are_named():
    one, other = ImuPublisher("/two"), ImuPublisher("/two")
    source = topic_blocks("/two", fs=1000, end_s=0.5)
    with closing(Subscriber("/two")) as subscriber:
        assert until(lambda: len(subscriber.publishers()) == 2)
        names = subscriber.publishers()
    assert until(lambda: one.n_subscribers and other.n_subscribers)
    for i in range(50):
        one.publish(10**9 + i * 10**6, (i, 0, 0))
    blocks = list(source)
    told = [flag for block in blocks for flag in block.flags if flag.startswith("publishers: 2")]
    assert len(told) == 1
    assert all(name in told[0] for name in names)
    assert all(0 <= block.age_s < 10 for block in blocks)
    one.close()
    other.close()


@pytest.mark.parametrize("given", ["999", "-1", "two"])
def test_a_domain_that_cannot_be_is_refused_with_its_source(given, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", given)
    with pytest.raises(ValueError, match=f"ROS_DOMAIN_ID is '{given}'. Expected 0 to 232"):
        open_source("ros2:/imu", wait_s=0.1)
    with pytest.raises(ValueError, match=r"domain is '1000'. Expected 0 to 232"):
        open_source("ros2:/imu", domain=1000, column=None, depth=None)
    with pytest.raises(ValueError, match="Expected 'reliable' or 'best effort'"):
        open_source("ros2:/imu", reliability="fast")
    with pytest.raises(ValueError, match=r"depth given with -. Expected a source ros2:/TOPIC"):
        open_source("-", fs=100, unit="g", depth=5)


def test_nobody_there_is_said():
    with pytest.raises(RecordingError, match=r"ros2:/nothing: nobody publishes there; waited 0.1 s"):
        topic_blocks("/nothing", wait_s=0.1)


def test_types_units_and_columns_are_checked(child):
    with pytest.raises(
        ValueError, match=r"type is 'std_msgs/msg/String'. Expected one of sensor_msgs/msg/Imu"
    ):
        Subscriber("/x", "std_msgs/msg/String")
    with pytest.raises(ValueError, match="Expected one of ax, ay"):
        Subscriber("/x", columns=("pitch",))
    with pytest.raises(RecordingError, match=r"unit is 'm/s\^2' by its type, 'g' was given"):
        topic_blocks("/x", type_name="sensor_msgs/msg/Imu", reliability="reliable", unit="g")
