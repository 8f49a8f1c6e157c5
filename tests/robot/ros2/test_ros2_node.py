"""The lifecycle node with substitutes for rclpy, a real model and simulated recordings."""

import numpy as np
import pytest
import toy_surfaces
from turning_surfaces import FS, N, recording, values

from texclass.recognition import Session
from texclass.recognition.sources.blocks import Block
from texclass.robot.dds import make_message

START_NS = 1_700_000_000 * 10**9
IMU = "sensor_msgs/msg/Imu"
MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"


@pytest.fixture
def node(turning, tmp_path, start_node):
    """Node with a model of acceleration and turn rate, before its configuration."""
    turning.save(tmp_path / "m.skops")
    return start_node(model=str(tmp_path / "m.skops"), topic="/drive/imu", fs=FS)


@pytest.fixture
def active_node(node):
    assert node.trigger("configure") == "inactive", node.errors
    assert node.trigger("activate") == "active", node.errors
    return node


def imu(row, stamp_ns, frame="imu_link"):
    a, w = (make_message("geometry_msgs/msg/Vector3", x=v[0], y=v[1], z=v[2]) for v in (row[:3], row[3:]))
    time = make_message("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    header = make_message("std_msgs/msg/Header", stamp=time, frame_id=frame)
    return make_message(IMU, header=header, linear_acceleration=a, angular_velocity=w)


def play(node, rows, fs=FS, start_ns=START_NS, skip=()):
    """Send samples to the node by its clock; return the time of the last one."""
    for i, row in enumerate(rows.tolist()):
        stamp_ns = start_ns + round(i * 1e9 / fs)
        if i not in skip:
            (subscription,) = node.subscriptions
            node.spin_until(stamp_ns)
            subscription.callback(imu(row, stamp_ns))
    node.spin_until(stamp_ns + 25_000_000)
    return stamp_ns


def sent(node, topic):
    (publisher,) = [publisher for publisher in node.publishers if publisher.topic == topic]
    return publisher.sent


def ns(time):
    return time.sec * 10**9 + time.nanosec


def test_the_node_subscribes_when_active_with_the_quality_of_service_of_sensors(node):
    assert not node.subscriptions
    node.trigger("configure")
    assert not node.subscriptions
    node.trigger("activate")
    (subscription,) = node.subscriptions
    assert (subscription.topic, subscription.quality.depth) == ("/drive/imu", 1000)
    assert subscription.quality.reliability == "BEST_EFFORT"
    assert {p.topic for p in node.publishers} == {"~/answer", "~/contact", "/diagnostics"}
    node.trigger("deactivate")
    assert not node.subscriptions
    assert not node.timers
    node.trigger("cleanup")
    assert not node.publishers
    assert node.trigger("shutdown") == "finalized"
    assert not node.errors


@pytest.mark.parametrize("terrain", ["gravel", "sand"])
def test_the_node_publishes_the_answer_of_the_session(active_node, turning, terrain):
    rows = values(terrain, 90)
    play(active_node, rows)
    (answer,) = sent(active_node, "~/answer")
    (expected,) = [u for u in Session(turning).push(Block(0.0, rows, FS, "m/s^2")) if hasattr(u, "verdict")]
    assert answer.surface == expected.verdict.surface == turning.answer(recording(terrain, 90)).surface
    assert answer.surface == terrain
    assert dict(zip(answer.surfaces, answer.probabilities, strict=True)) == pytest.approx(
        expected.verdict.probabilities
    )
    assert sum(answer.probabilities) == pytest.approx(1)
    assert (answer.unknown, answer.sure) == (expected.verdict.unknown, expected.verdict.sure)
    assert (answer.p_known, answer.n_windows) == (pytest.approx(expected.answer.p_known), 1)
    assert answer.contact_s == pytest.approx(N / FS)
    assert answer.header.frame_id == "imu_link"
    assert ns(answer.window_start) == ns(answer.contact_start) == pytest.approx(START_NS, abs=1000)
    assert ns(answer.header.stamp) == pytest.approx(START_NS + N / FS * 1e9, abs=1000)
    assert not active_node.warnings


def test_time_stamps_follow_the_clock_of_the_sensor(active_node):
    play(active_node, values("sand", 90), start_ns=START_NS)
    late_ns = START_NS + 60 * 10**9
    play(active_node, values("sand", 91), start_ns=late_ns)
    events = sent(active_node, "~/contact")
    assert [event.kind for event in events].count(5) == 1  # a break
    answer = sent(active_node, "~/answer")[-1]
    assert ns(answer.header.stamp) == pytest.approx(late_ns + N / FS * 1e9, abs=1000)


def test_deactivation_publishes_the_answer_for_a_short_contact(active_node):
    play(active_node, values("sand", 90)[: 3 * N // 4])
    assert not sent(active_node, "~/answer")
    active_node.trigger("deactivate")
    assert [answer.surface for answer in sent(active_node, "~/answer")] == ["sand"]


def test_an_activation_starts_a_new_recognition(active_node):
    play(active_node, values("sand", 90)[: N // 4])
    active_node.trigger("deactivate")
    active_node.trigger("activate")
    play(active_node, values("gravel", 90), start_ns=START_NS + 10**12)
    assert [answer.surface for answer in sent(active_node, "~/answer")] == ["gravel"]
    assert not active_node.warnings


def statuses(node):
    array = sent(node, "/diagnostics")[-1]
    return {status.name: status for status in array.status}


def keyed(status):
    return {pair.key: pair.value for pair in status.values}


def test_diagnostics_report_rate_and_answer(active_node):
    end_ns = play(active_node, np.concatenate([values("sand", 90), values("sand", 91)]))
    active_node.spin_until(end_ns + 10**9)
    active_node.subscriptions[0].callback(imu([0.0, 1, 9, 0, 0, 1], end_ns + 10**9))
    sent(active_node, "/diagnostics").clear()
    play(active_node, values("sand", 92), start_ns=end_ns + 10**9 + 5_000_000)
    status = statuses(active_node)["texclass: input"]
    assert (status.level, status.message, status.hardware_id) == (0, "ok", "/drive/imu")
    assert float(keyed(status)["measured sampling rate (Hz)"]) == pytest.approx(FS, rel=0.01)
    surface = statuses(active_node)["texclass: surface"]
    assert (surface.level, surface.message) == (0, "sand")
    assert statuses(active_node)["texclass: drift"].level == 0


def test_diagnostics_report_silence(active_node):
    end_ns = play(active_node, values("sand", 90))
    active_node.spin_until(end_ns + 3 * 10**9)
    status = statuses(active_node)["texclass: input"]
    assert (status.level, status.message) == (2, "no messages")


@pytest.mark.parametrize(
    ("rows", "options", "message"),
    [
        (values("sand", 90), {"skip": range(100, 104)}, "4 samples missing"),
        (values("sand", 90), {"fs": 210.0}, "Hz instead of 200 Hz"),
        (np.clip(values("sand", 90), -1, 1), {}, "% of the samples clipped"),
    ],
)
def test_diagnostics_report_faults_of_the_input(active_node, rows, options, message):
    play(active_node, rows, **options)
    found = [s for array in sent(active_node, "/diagnostics") for s in array.status if message in s.message]
    assert [status.level for status in found] == [1] * len(found)
    assert found


def test_a_fault_is_logged(active_node):
    rows = values("sand", 90)
    rows[100] = float("nan")
    play(active_node, rows)
    assert any("not finite" in warning for warning in active_node.warnings)


def test_an_error_ends_the_recognition_and_stays_in_the_diagnostics(active_node):
    rows = values("sand", 90)
    rows[:, 3:] = 0
    (subscription,) = active_node.subscriptions
    active_node.spin_until(START_NS)
    message = imu(rows[0].tolist(), START_NS)
    message.angular_velocity_covariance[0] = -1.0
    subscription.callback(message)
    active_node.spin_until(START_NS + 5 * 10**9)
    (warning,) = active_node.warnings
    assert warning.startswith("/drive/imu: the messages declare wx, wy, wz as not measured")
    status = statuses(active_node)["texclass: input"]
    assert (status.level, status.message) == (2, warning.removesuffix(". The recognition has ended"))
    assert active_node.state == "active"


@pytest.mark.parametrize(
    ("parameters", "error"),
    [
        ({"model": ""}, "the parameter model is empty. Expected a file written by 'texclass train'"),
        ({"model": "absent.skops"}, "absent.skops"),
        ({"queue_depth": 0}, "queue_depth must be at least 1 message, got 0"),
        ({"diagnostics_period_s": 0.0}, "diagnostics_period_s must be positive, got 0.0 s"),
        ({"window_s": -1.0}, "window_s must be positive"),
        (
            {"message_type": "sensor_msgs/msg/Range"},
            "imu: cannot read messages of type 'sensor_msgs/msg/Range'",
        ),
        ({"message_type": "geometry_msgs/msg/AccelStamped"}, "has no turn rate"),
        ({"unit": "g"}, "imu: unit must be 'm/s^2' for sensor_msgs/msg/Imu, got 'g'"),
    ],
)
def test_a_configuration_with_an_invalid_parameter_fails(turning, tmp_path, start_node, parameters, error):
    turning.save(tmp_path / "m.skops")
    node = start_node(**{"model": str(tmp_path / "m.skops")} | parameters)
    assert node.trigger("configure") == "unconfigured"
    (message,) = node.errors
    assert error in message
    assert not node.publishers


def multi_array(block):
    dims = [
        make_message("std_msgs/msg/MultiArrayDimension", label=label, size=size, stride=block.size)
        for label, size in zip(("samples", "channels"), block.shape, strict=True)
    ]
    layout = make_message("std_msgs/msg/MultiArrayLayout", dim=dims)
    return make_message(MULTI_ARRAY, layout=layout, data=block.ravel().tolist())


@pytest.fixture
def array_node(window_model, tmp_path, start_node):
    window_model.save(tmp_path / "w.skops")
    node = start_node(
        model=str(tmp_path / "w.skops"), message_type=MULTI_ARRAY, fs=toy_surfaces.FS, frame_id="tool"
    )
    node.trigger("configure")
    node.trigger("activate")
    return node


def play_array(node, samples, n=100):
    (subscription,) = node.subscriptions
    for k in range(0, len(samples), n):
        node.spin_until(START_NS + round(k * 1e9 / toy_surfaces.FS))
        subscription.callback(multi_array(samples[k : k + n, None]))
    node.spin_until(node.now_ns + 25_000_000)


def test_blocks_of_samples_give_prediction_sets_and_contact_events(array_node):
    rest = 0.001 * np.random.default_rng(0).standard_normal(2000)
    stroke = toy_surfaces.signal(toy_surfaces.SURFACES["oak"], 90, n=4000)
    play_array(array_node, np.concatenate([rest, stroke, np.roll(rest, 7), rest]))
    kinds = [event.kind for event in sent(array_node, "~/contact")]
    assert (kinds[0], kinds[-1]) == (1, 4)
    answers = sent(array_node, "~/answer")
    assert len(answers) >= 5
    assert {answer.surface for answer in answers} == {"oak"}
    assert {answer.header.frame_id for answer in answers} == {"tool"}
    assert [each.coverage for each in answers[-1].prediction_sets] == [0.9, 0.95]
    assert answers[-1].prediction_sets[0].surfaces[0] == "oak"
    lift_off = sent(array_node, "~/contact")[-1]
    assert ns(answers[-1].header.stamp) <= ns(lift_off.header.stamp) < ns(lift_off.detection_time)
    assert not array_node.warnings


def test_damaged_arrays_are_left_out(array_node):
    stroke = toy_surfaces.signal(toy_surfaces.SURFACES["oak"], 90, n=3000)
    (subscription,) = array_node.subscriptions
    play_array(array_node, stroke[:1000])
    subscription.callback(make_message(MULTI_ARRAY))
    subscription.callback(multi_array(stroke[:50, None]))
    array_node.spin_until(array_node.now_ns + 25_000_000)
    assert array_node.warnings == ["damaged: 2 messages left out"]
    play_array(array_node, stroke)
    assert array_node.state == "active"
    assert not array_node.errors


def test_a_change_of_the_rate_keeps_the_time_stamps_of_earlier_answers(turning):
    from texclass.robot.message_classifier import MessageClassifier

    classifier = MessageClassifier(turning, make_message, fs=FS)
    rows = values("sand", 90)[: 3 * N // 4].tolist()
    outputs, stamp_ns = [], START_NS
    for i, row in enumerate([*rows, *rows[:100]]):
        classifier.push(imu(row, stamp_ns), stamp_ns)
        stamp_ns += round(1e9 / (FS if i < len(rows) else FS / 2))
        outputs.append(classifier.process())
    (answer,) = [answer for output in outputs for answer in output.answers]
    assert ns(answer.header.stamp) < START_NS + 1e9 * len(rows) / FS + 5e8
