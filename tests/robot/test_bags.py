import re

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra `robot` is not installed")
pytest.importorskip("mcap", reason="the extra `robot` is not installed")

from bag_writer import ARRAY, IMU, KINDS, START_NS, Topic, regular, write_bag
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from texclass.loaders import draft_card, find_recording, load_recording, open_dataset
from texclass.recording import RecordingError
from texclass.robot.ros_messages import type_of

FS = 200.0
N = 300


@pytest.fixture
def values():
    """Acceleration and turn rate of shape (300, 6)."""
    return np.random.default_rng(0).normal(size=(N, 6))


def _imu(values, fs=FS, **changes):
    return Topic(IMU, values, regular(len(values), fs), **changes)


@pytest.mark.parametrize("kind", KINDS)
def test_an_imu_is_read_as_it_was_written(tmp_path, values, kind):
    path = write_bag(tmp_path, kind, {"/imu": _imu(values)})
    recording = load_recording(path, auxiliary={"turn_rate": ["wx", "wy", "wz"]})
    np.testing.assert_array_equal(recording.acceleration, values[:, :3])
    np.testing.assert_array_equal(recording.turn_rate, values[:, 3:])
    assert (recording.fs, recording.unit, recording.recording_id) == (FS, "m/s^2", "run")
    assert recording.flags == ("rate: 200 Hz by the header time stamps",)


@pytest.mark.parametrize(
    ("kind", "compression"),
    [
        ("bag", "bz2"),
        ("bag", "lz4"),
        ("mcap", "storage"),
        ("mcap", "file"),
        ("db3", "message"),
        ("db3", "file"),
    ],
)
def test_compressed_bags_and_folders_are_read(tmp_path, values, kind, compression):
    path = write_bag(tmp_path, kind, {"/imu": _imu(values)}, compression=compression)
    recording = load_recording(path if kind == "bag" else path.parent)
    np.testing.assert_array_equal(recording.acceleration, values[:, :3])
    assert recording.recording_id == "run"


def test_a_split_bag_is_one_recording(tmp_path, values):
    half = N // 2
    stamps = regular(N, FS)
    for i, part in enumerate((slice(half), slice(half, N))):
        topic = Topic(IMU, values[part], stamps[part])
        write_bag(tmp_path / str(i), "mcap", {"/imu": topic}).rename(tmp_path / f"run_{i}.mcap")
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:")
    np.testing.assert_array_equal(load_recording(tmp_path).acceleration, values[:, :3])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("per_message", [1, 10])
def test_arrays_are_samples_or_blocks_of_samples(tmp_path, values, kind, per_message):
    blocks = values.reshape(-1, per_message, 6)
    received = regular(len(blocks), FS)
    path = write_bag(tmp_path, kind, {"/raw": Topic(ARRAY, blocks, None, received)})
    recording = load_recording(path, unit="g", column=["c1", "c2", "c3"])
    np.testing.assert_allclose(recording.acceleration, values[:, :3] * 9.80665)
    assert recording.fs == FS * per_message
    assert recording.flags == (f"rate: {FS * per_message:g} Hz by the times of receipt",)


@pytest.mark.parametrize("shape", [(0, 1, 6), (N, 2, 2, 1)])
def test_an_array_topic_that_is_not_needed_may_be_empty_or_have_other_dimensions(tmp_path, values, shape):
    array = Topic(ARRAY, np.ones(shape), None, regular(shape[0], FS))
    path = write_bag(tmp_path, "mcap", {"/imu": _imu(values), "/map": array})
    np.testing.assert_array_equal(load_recording(path).acceleration, values[:, :3])


@pytest.mark.parametrize("kind", KINDS)
def test_speed_and_force_of_other_topics_keep_their_rate(tmp_path, values, kind):
    slow = regular(60, 40.0)
    ramp = np.zeros((60, 6))
    ramp[:, 0] = np.arange(60) / 40
    topics = {
        "/imu": _imu(values),
        "/twist": Topic("geometry_msgs/msg/TwistStamped", ramp, slow),
        "/wrench": Topic("geometry_msgs/msg/WrenchStamped", -ramp, slow),
    }
    path = write_bag(tmp_path, kind, topics)
    auxiliary = {"speed": "/twist/speed", "normal_force": "/wrench/force"}
    recording = load_recording(path, auxiliary=auxiliary)
    assert recording.auxiliary_fs == {"speed": 40, "normal_force": 40}
    np.testing.assert_allclose(recording.speed, 1000 * ramp[:, 0], atol=1e-9)
    np.testing.assert_array_equal(recording.normal_force, ramp[:, 0])
    one_rate = load_recording(path, auxiliary=auxiliary, resample=100)
    assert (one_rate.fs, one_rate.auxiliary_fs, len(one_rate.speed)) == (100, {}, one_rate.n_samples)
    expected = np.minimum(1000 * np.arange(150) / 100, 1475)
    np.testing.assert_allclose(one_rate.speed[5:-10], expected[5:-10], atol=15)
    assert any("band-limited, speed from 40 Hz" in flag for flag in one_rate.flags)


def test_topics_of_three_rates_are_aligned_in_time(tmp_path):
    """An IMU at 100 Hz, a microphone at 10 kHz in blocks without headers, a wrench at 1 kHz; one event."""
    imu, wrench = (np.random.default_rng(0).normal(scale=1e-3, size=(n, 6)) for n in (500, 5000))
    mic = np.random.default_rng(1).normal(scale=1e-3, size=(500, 100, 2))
    event_s = 2.0  # after the first message of the IMU
    imu[200] += 1
    early_ns, late_ns = START_NS - 250_000_000, START_NS + 100_000_000
    wrench[2250] += 1  # starts 0.25 s before
    mic.reshape(-1, 2)[19_000] += 1  # starts 0.1 s after
    received = regular(500, 100.0, late_ns + 9_900_000)  # a block is received with its last sample
    topics = {
        "/imu": Topic(IMU, imu, regular(500, 100.0), regular(500, 100.0)),
        "/wrench": Topic("geometry_msgs/msg/WrenchStamped", wrench, regular(5000, 1000.0, early_ns)),
        "/mic": Topic(ARRAY, mic, None, received),
    }
    path = write_bag(tmp_path, "mcap", topics)
    auxiliary = {"friction": "/wrench/fz", "sound": "/mic/c2"}
    recording = load_recording(path, auxiliary=auxiliary)
    assert (recording.fs, recording.auxiliary_fs) == (100, {"friction": 1000, "sound": 10_000})
    for name, signal in (("friction", recording.friction), ("sound", recording.sound)):
        assert len(signal) == 5 * recording.rate_of(name)
        assert np.argmax(signal) / recording.rate_of(name) == event_s
    # Before the first and after the last sample, the signal is constant.
    assert np.ptp(recording.sound[:1000]) == 0
    np.testing.assert_array_equal(recording.sound[1000:], mic.reshape(-1, 2)[:49_000, 1])
    np.testing.assert_array_equal(recording.friction[:4750], wrench[250:, 2])
    assert "/mic: aligned by the times of receipt, since a topic has no time stamps" in recording.flags
    own = load_recording(path, topic="/mic", unit="V", column=["c1"], auxiliary={"turn_rate": ["/imu/wx"]})
    assert (own.fs, own.auxiliary_fs, own.n_samples) == (10_000, {"turn_rate": 100}, 50_000)
    with pytest.raises(RecordingError, match="column '/mic/c3' does not exist"):
        load_recording(path, auxiliary={"sound": "/mic/c3"})
    with pytest.raises(RecordingError, match=r"columns differ in rate: '/mic/c1' at 10000 Hz, '/wrench/fx'"):
        load_recording(path, auxiliary={"turn_rate": ["/mic/c1", "/wrench/fx", "/wrench/fy"]})
    short = topics | {
        "/wrench": Topic("geometry_msgs/msg/WrenchStamped", wrench[:4000], regular(4000, 1000.0))
    }
    path = write_bag(tmp_path, "mcap", short, name="short")
    with pytest.raises(RecordingError, match=r"topic=/wrench: it covers 80% of the duration"):
        load_recording(path, auxiliary=auxiliary)


def test_a_topic_must_be_selected_by_name_if_several_have_an_acceleration(tmp_path, values):
    topics = {
        "/left/imu": _imu(values),
        "/right/imu": _imu(-values),
        "/odd": Topic(ARRAY, values, None, regular(N, 9)),
    }
    path = write_bag(tmp_path, "mcap", topics)
    described = r"/left/imu (sensor_msgs/msg/Imu, 300 messages at 200 Hz), /right/imu (sensor_msgs/msg/Imu, "
    with pytest.raises(RecordingError, match=re.escape(described) + ".* Select one with --topic /left/imu"):
        load_recording(path)
    for recording in (
        find_recording(f"bag:{path}?topic=/right/imu"),
        load_recording(path, topic="right/imu"),
    ):
        np.testing.assert_array_equal(recording.acceleration, -values[:, :3])
    with pytest.raises(
        RecordingError, match=r"'/odd', '/right/imu'|'/right/imu', '/odd'. Try --topic /left/imu"
    ):
        load_recording(path, topic="/lef/imu")
    with pytest.raises(
        RecordingError, match="is a pattern with groups, which selects one recording per topic"
    ):
        load_recording(path, topic="/(?P<session>left|right)/imu")
    with pytest.raises(RecordingError, match=r"topic '/left/imu' contradicts it\. Expected the topic in one"):
        load_recording(f"bag:{path}?topic=/right/imu", topic="/left/imu")
    with pytest.raises(RecordingError, match=r"'/\(' is not a valid regular expression"):
        load_recording(path, topic="/(")
    np.savetxt(tmp_path / "one.csv", values)
    with pytest.raises(RecordingError, match="topic '/imu' cannot be selected, it is not a bag"):
        load_recording(tmp_path / "one.csv", fs=FS, unit="g", column=("1", "2"), topic="/imu")
    for no_topic in (f"bag:{path}?top=/left/imu", f"bag:{path}?/left/imu"):
        with pytest.raises(RecordingError, match=r"Expected bag:FILE\?topic="):
            find_recording(no_topic)


def test_a_contradicting_rate_or_unit_raises_an_error(tmp_path, values):
    path = write_bag(tmp_path, "bag", {"/imu": _imu(values)})
    assert load_recording(path, fs=200, unit="m/s^2").fs == 200
    with pytest.raises(
        RecordingError, match="fs is 200 Hz according to its header time stamps, but 250 Hz was given"
    ):
        load_recording(path, fs=250)
    with pytest.raises(RecordingError, match=r"its unit is 'm/s\^2', but 'g' was given"):
        load_recording(path, unit="g")


def test_a_slightly_different_rate_is_resampled_with_a_flag(tmp_path):
    t = np.arange(2020) / 202
    path = write_bag(tmp_path, "mcap", {"/imu": _imu(np.tile(np.sin(2 * np.pi * 7 * t)[:, None], 6), 202.0)})
    recording = load_recording(path, fs=200)
    expected = np.sin(2 * np.pi * 7 * np.arange(2000) / 200)
    np.testing.assert_allclose(recording.acceleration[50:-50, 0], expected[50:-50], atol=5e-3)
    assert recording.flags == ("rate: 202 Hz by the header time stamps, resampled (band-limited) to 200 Hz",)


def test_times_of_receipt_are_used_without_timestamps_in_the_headers(tmp_path, values):
    late = regular(N, FS) + np.random.default_rng(1).integers(0, 30_000_000, N)
    by_header = write_bag(tmp_path / "a", "db3", {"/imu": Topic(IMU, values, regular(N, FS), np.sort(late))})
    assert load_recording(by_header).flags == ("rate: 200 Hz by the header time stamps",)
    without = write_bag(tmp_path / "b", "db3", {"/imu": Topic(IMU, values, np.zeros(N, int), regular(N, FS))})
    recording = load_recording(without)
    assert recording.flags == ("time stamps: none in the headers", "rate: 200 Hz by the times of receipt")
    np.testing.assert_array_equal(recording.acceleration, values[:, :3])


def test_a_driver_that_sends_g_causes_a_flag(tmp_path, values):
    still = 0.01 * values + [0, 0, 1, 0, 0, 0]
    path = write_bag(tmp_path, "bag", {"/imu": _imu(still)})
    assert "Check whether the driver sends g" in load_recording(path).flags[-1]


def test_a_folder_of_bags_is_a_dataset(tmp_path, values):
    for surface in ("steel", "wood"):
        for name, kind in zip("abc", KINDS, strict=True):
            write_bag(tmp_path / surface, kind, {"/imu": _imu(values)}, name=name)
    dataset = open_dataset(tmp_path)
    ids = [f"{surface}/{name}" for surface in ("steel", "wood") for name in "abc"]
    assert [entry.recording_id for entry in dataset.entries] == ids
    assert [recording.surface for recording in dataset] == ["steel"] * 3 + ["wood"] * 3
    assert {(recording.fs, recording.unit) for recording in dataset} == {(FS, "m/s^2")}
    old_hash = dataset.input_hash
    (tmp_path / "metadata.yaml").write_text("somebody else's")
    (tmp_path / "steel/metadata.yaml").write_text("somebody else's")
    write_bag(tmp_path, "mcap", {"/imu": _imu(-values)}, name="new").replace(tmp_path / "wood/b/b.mcap")
    assert open_dataset(tmp_path).input_hash != old_hash


def test_a_topic_selects_the_recordings_of_a_folder_of_bags(tmp_path, values):
    topics = {"/steel/imu": _imu(values), "/wood/imu": _imu(-values)}
    for name in ("one", "two"):
        write_bag(tmp_path / "drives/floor", "mcap", topics, name=name)
    with pytest.raises(RecordingError, match="several topics with an acceleration"):
        open_dataset(tmp_path / "drives")
    dataset = open_dataset(tmp_path / "drives", topic="wood/imu")
    assert [(one.recording_id, one.surface) for one in dataset] == [
        ("floor/one", "floor"),
        ("floor/two", "floor"),
    ]
    assert not dataset.notes or "session" not in " ".join(dataset.notes)
    for recording in dataset:
        np.testing.assert_array_equal(recording.acceleration, -values[:, :3])
    dataset = open_dataset(tmp_path / "drives", topic="/(?P<session>[a-z]+)/imu")
    assert [(one.recording_id, one.session) for one in dataset] == [
        (f"floor/{bag}/{session}/imu", session) for bag in ("one", "two") for session in ("steel", "wood")
    ]
    for folder in (tmp_path / "drives", tmp_path / "drives/floor"):  # the pattern names the surface
        dataset = open_dataset(folder, topic="/(?P<surface>[a-z]+)/imu")
        assert [one.surface for one in dataset] == ["steel", "wood"] * 2
        for recording in dataset:
            sign = 1 if recording.surface == "steel" else -1
            np.testing.assert_array_equal(recording.acceleration, sign * values[:, :3])
    with pytest.raises(RecordingError, match=r"no topic matches .* /steel/imu, /wood/imu"):
        open_dataset(tmp_path / "drives", topic="/(?P<surface>[a-z]+)/gyro")
    dataset = open_dataset(tmp_path / "drives", topic="/(?P<wheel>[a-z]+)/imu")  # a further label
    assert dataset.table["wheel"].tolist() == ["steel", "wood"] * 2
    with pytest.raises(ValueError, match="topic defines the group 'surfce', which resembles 'surface'"):
        open_dataset(tmp_path / "drives", topic="/(?P<surfce>[a-z]+)/imu")


def test_a_card_is_drafted_for_folders_of_bags(tmp_path, values):
    topics = {"/imu": _imu(values), "/spare": _imu(-values)}
    for surface in ("steel", "wood"):
        for k in (1, 2, 3):
            write_bag(tmp_path / "drives" / surface, "mcap", topics, name=f"run_{k}")
    text = draft_card(tmp_path / "drives", tmp_path, topic="/imu")
    (tmp_path / "card.toml").write_text(text)
    assert "topic = '/imu'" in text
    assert "QUESTION" not in text
    dataset = open_dataset(tmp_path / "card.toml")
    assert [(one.recording_id, one.surface, one.repetition) for one in dataset.entries] == [
        (f"{surface}/run_{k}", surface, k) for surface in ("steel", "wood") for k in (1, 2, 3)
    ]
    np.testing.assert_array_equal(dataset[0].acceleration, values[:, :3])


CARD = """
title = "Robot"
format = "files"
folder = "bags"
fs_hz = 200
unit = "m/s^2"
phases = "movement"
"""


def _card(tmp_path, monkeypatch, more):
    monkeypatch.setenv("TEXCLASS_DATA", str(tmp_path))
    (tmp_path / "robot.toml").write_text(CARD + more)
    return tmp_path / "robot.toml"


def test_the_topic_can_be_the_label(tmp_path, values, monkeypatch):
    for kind in KINDS:
        topics = {"/wood/imu": _imu(values), "/steel/imu": _imu(-values), "/steel/rpm": _imu(values)}
        write_bag(tmp_path / "bags", kind, topics, name=f"r{kind}")
    files = r"""files = ['.*\.bag', '.*/metadata\.yaml']
topic = '/(?P<surface>[a-z]+)/imu'
"""
    dataset = open_dataset(_card(tmp_path, monkeypatch, files))
    assert [(e.recording_id, e.surface, e.topic) for e in dataset.entries[:2]] == [
        ("rbag/steel/imu", "steel", "/steel/imu"),
        ("rbag/wood/imu", "wood", "/wood/imu"),
    ]
    assert len(dataset) == 6
    for recording in dataset:
        sign = 1 if recording.surface == "wood" else -1
        np.testing.assert_array_equal(recording.acceleration, sign * values[:, :3])


def test_a_table_can_state_the_labels_and_a_card_the_topic(tmp_path, values, monkeypatch):
    topics = {"/imu": _imu(values), "/spare": _imu(-values)}
    write_bag(tmp_path / "bags", "mcap", topics, name="one")
    write_bag(tmp_path / "bags", "bag", topics, name="two")
    (tmp_path / "bags/labels.csv").write_text("bag,surface\none,wood\ntwo,steel\n")
    more = r"""files = ['(?P<recording>\w+)\.bag', '(?P<recording>\w+)/metadata\.yaml']
topic = "/imu"
[labels]
file = "labels.csv"
recording = "bag"
surface = "surface"
"""
    dataset = open_dataset(_card(tmp_path, monkeypatch, more))
    assert {entry.recording_id: entry.surface for entry in dataset.entries} == {
        "one": "wood",
        "two": "steel",
    }
    for recording in dataset:
        np.testing.assert_array_equal(recording.acceleration, values[:, :3])


def test_a_bag_without_acceleration_raises_an_error_with_its_topics(tmp_path, values):
    path = write_bag(
        tmp_path, "bag", {"/twist": Topic("geometry_msgs/msg/TwistStamped", values, regular(N, FS))}
    )
    with pytest.raises(RecordingError, match=r"only '/twist \(geometry_msgs/msg/TwistStamped\)'"):
        load_recording(path)


def test_header_timestamps_may_have_another_epoch_than_the_bag(tmp_path, values):
    path = write_bag(tmp_path, "bag", {"/imu": Topic(IMU, values, regular(N, FS, 5 * 10**9), regular(N, FS))})
    assert START_NS > 5 * 10**9
    assert load_recording(path).fs == FS


CUSTOM = """std_msgs/Header header
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
string frame
float32 roll
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
FIELDS = tuple(f"linear_acceleration.{axis}" for axis in "xyz")


def custom_bag(folder, kind, values, definition=CUSTOM):
    ros1 = kind == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    own = get_types_from_msg(definition, "tm200/msg/Imu")
    store.register({name: fields for name, fields in own.items() if name not in store.fielddefs})
    types = store.types
    path = folder / ("own.bag" if ros1 else "own/own.mcap")
    plugin = rosbag2.StoragePlugin.MCAP
    writer = (
        rosbag1.Writer(path) if ros1 else rosbag2.Writer(folder / "own", version=9, storage_plugin=plugin)
    )
    vector = types["geometry_msgs/msg/Vector3"]
    with writer:
        connection = writer.add_connection("/tm200", "tm200/msg/Imu", typestore=store)
        for t_ns, row in zip(regular(len(values), 100.0).tolist(), values.tolist(), strict=True):
            time = types["builtin_interfaces/msg/Time"](t_ns // 10**9, t_ns % 10**9)
            header = types["std_msgs/msg/Header"](*([7] if ros1 else []), time, "imu")
            content = types["tm200/msg/Imu"](header, vector(1, 2, 3), np.zeros(9), vector(*row), "f", row[0])
            serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
            writer.write(connection, t_ns + 1000, serialize(content, "tm200/msg/Imu"))
    return path


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_messages_of_a_custom_type_are_read_by_the_names_of_their_fields(tmp_path, kind):
    values = np.random.default_rng(0).standard_normal((60, 3))
    path = custom_bag(tmp_path, kind, values)
    recording = load_recording(f"bag:{path}?topic=/tm200", column=FIELDS, unit="m/s^2")
    assert (recording.fs, recording.channels) == (100.0, FIELDS)
    np.testing.assert_array_equal(recording.acceleration, values)
    with pytest.raises(RecordingError, match=r"--topic NAME --column FIELD\.x"):
        load_recording(path)
    with pytest.raises(RecordingError, match="unit is missing"):
        load_recording(f"bag:{path}?topic=/tm200", column=FIELDS)
    with pytest.raises(RecordingError, match=r"linear_acceleration\.x"):
        load_recording(f"bag:{path}?topic=/tm200", column=("pitch",), unit="m/s^2")


@pytest.mark.parametrize(
    "definition",
    [
        "",
        "float64 x",
        "Header header\nWhat x",
        "Header header\nImu again\nfloat64 x",
        "\x00" * 99,
        "#" * 99_999,
    ],
)
def test_an_invalid_definition_is_not_a_type(definition):
    assert type_of("own/msg/Imu", definition, True) is None


def test_messages_that_are_not_finite_count_as_missing(tmp_path, values):
    values[[100, 101, 200], 0] = np.nan
    values[150, 1] = np.inf
    recording = load_recording(write_bag(tmp_path, "bag", {"/imu": _imu(values)}))
    assert len(recording.acceleration) == len(values)
    assert "not finite: 4 messages left out" in recording.flags
    assert "gaps: 4 messages missing in 3 gaps, interpolated" in recording.flags
    values[:200] = np.nan
    with pytest.raises(RecordingError, match="201 of 300 messages contain NaN"):
        load_recording(write_bag(tmp_path, "bag", {"/imu": _imu(values)}, name="worse"))
