"""Bags as streams, for models that need turn rates."""

import importlib
import io
import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from turning_surfaces import FS, TERRAINS, N, turning_model, values

from texclass.loaders import load_recording, open_dataset
from texclass.recognition import load_model, open_source
from texclass.recognition.model import predict
from texclass.recognition.sources.training_input import TrainingFiles
from texclass.recording import RecordingError

IMU_CARD = """
title = "Terrains"
format = "files"
folder = "bags"
fs_hz = 200
unit = "m/s^2"
scale = 2.0
turn_rate_scale = 0.5
phases = "movement"
remove_resting_level = true
topic = "/imu"
files = '(?P<recording>\\w+)/metadata\\.yaml'
[labels]
file = "labels.csv"
recording = "bag"
surface = "terrain"
repetition = "run"
[channels]
acceleration = ["ax", "ay", "az"]
turn_rate = ["wx", "wy", "wz"]
"""


@pytest.fixture(scope="module")
def bags():
    pytest.importorskip("rosbags", reason="the extra `robot` is not installed")
    return importlib.import_module("bag_writer")


@pytest.fixture(scope="module")
def imu_bag(bags):
    """Return a function that writes a bag with an Imu."""

    def write(folder, rows, name="bag", kind=bags.IMU, **others):
        topics = {"/imu": bags.Topic(kind, rows, bags.regular(N, FS)), **others}
        return bags.write_bag(folder, "mcap", topics, name=name)

    return write


@pytest.fixture(scope="module")
def folder(bags, imu_bag, tmp_path_factory):
    """Folder of bags with an Imu and an unused topic, labelled by a table, and a model trained on them."""
    root = tmp_path_factory.mktemp("terrains")
    labels = ["bag,terrain,run"]
    for terrain in TERRAINS:
        for run in range(1, 7):
            spare = bags.Topic(bags.IMU, np.ones((20, 6)), bags.regular(20, FS))
            imu_bag(root / "bags", values(terrain, run), f"{terrain}{run}", **{"/spare": spare})
            labels.append(f"{terrain}{run},{terrain},{run}")
    (root / "bags/labels.csv").write_text("\n".join(labels))
    (root / "terrains.toml").write_text(IMU_CARD)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEXCLASS_DATA", str(root))
        turning_model(open_dataset(root / "terrains.toml")).save(root / "terrains.skops")
    return root


@pytest.fixture
def run(command, folder, monkeypatch):
    def call(*arguments, text=""):
        monkeypatch.chdir(folder)
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode()), encoding="utf-8"))
        return command(*arguments)

    return call


def _answers(out):
    return [one for one in map(json.loads, out.splitlines()) if one.get("type") == "answer"]


def test_a_stream_of_a_bag_has_the_same_answers_as_predict(run, folder, imu_bag):
    for terrain in TERRAINS:
        rows = values(terrain, 50)
        name = f"bag:{imu_bag(folder, rows, f'new_{terrain}')}?topic=/imu"
        code, out, err = run("predict", "terrains.skops", name, "--jsonl")
        assert (code, err) == (0, "")
        (expected,) = map(json.loads, out.splitlines())
        assert expected["surface"] == terrain
        assert expected["probability"] > 0.9
        code, out, err = run("stream", "terrains.skops", name, "--jsonl")
        assert code == 0
        assert [a["probability"] for a in _answers(out)] == [pytest.approx(expected["probability"])]
        assert json.loads(out.splitlines()[-1])["surface"] == terrain
        # The same samples as text, which are not yet scaled.
        text = "\n".join(",".join(map(repr, row)) for row in rows.tolist())
        code, out, _ = run("stream", "terrains.skops", "--fs", 200, "--jsonl", text=text)
        assert [a["probability"] for a in _answers(out)] == [pytest.approx(expected["probability"])]


def test_bags_are_scored_against_intervals(run, folder, imu_bag):
    rows = ["recording,start_s,end_s,surface"]
    for terrain in TERRAINS:
        imu_bag(folder / "scored" / terrain, values(terrain, 60), terrain)
        rows.append(f"{terrain},0,{N / FS},{terrain}")
    (folder / "intervals.csv").write_text("\n".join(rows))
    arguments = (
        "score-stream",
        "terrains.skops",
        "scored",
        "--intervals",
        "intervals.csv",
        "--topic",
        "/imu",
    )
    code, out, err = run(*arguments, "--always-in-contact", "--json", "-")
    assert code == 0, err
    summary = json.loads(out)["summary"]
    assert (summary["right"]["n_hits"], summary["missed"]["n_hits"]) == (3, 0)


def test_a_bag_is_conditioned_like_the_training_bags(folder):
    model = load_model(folder / "terrains.skops")
    bag = folder / "bags/sand2"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEXCLASS_DATA", str(folder))
        (by_card,) = predict(model, [f"{folder}/terrains.toml:sand2"])
    for name in (bag, bag / "sand2.mcap", f"bag:{bag}", f"bag:{bag / 'sand2.mcap'}?topic=/imu"):
        (by_file,) = predict(model, [str(name)])  # reads the topic of the card
        assert by_file.problem == ""
        assert by_file.answer.probabilities == pytest.approx(by_card.answer.probabilities)


def test_a_bag_may_have_other_column_names_than_the_training_files(bags, imu_bag, tmp_path):
    axes = ("a1", "a2", "a3")
    roles = {"acceleration": axes, "auxiliary": {"turn_rate": ("g1", "g2", "g3")}, "axes": axes}
    csv = TrainingFiles(fs=FS, unit="m/s^2", scale=2.0, turn_rate_scale=0.5, **roles)
    rows = values("sand", 3)
    imu = imu_bag(tmp_path, rows)
    numbers = bags.Topic(bags.ARRAY, list(rows.reshape(40, 10, 6)), None, bags.regular(40, FS / 10))
    array = bags.write_bag(tmp_path, "mcap", {"/imu": numbers}, name="array")
    for bag in (imu, array):
        recording = csv.find(str(bag))
        assert recording.channels == ("a1", "a2", "a3")
        np.testing.assert_array_equal(recording.acceleration, 2 * rows[:, :3])
        np.testing.assert_array_equal(recording.turn_rate, rows[:, 3:])  # ROS messages are in rad/s
    in_g = TrainingFiles(fs=FS, unit="g", scale=2.0)
    np.testing.assert_array_equal(in_g.find(str(imu)).acceleration, rows[:, :3])


def test_the_topic_of_the_training_files_is_read_unless_another_is_given(bags, imu_bag, tmp_path):
    rows = values("sand", 3)
    spare = bags.Topic(bags.IMU, -rows, bags.regular(N, FS))
    bag = imu_bag(tmp_path, rows, **{"/spare": spare})
    trained_on = TrainingFiles(fs=FS, unit="m/s^2", topic="/imu")
    np.testing.assert_array_equal(trained_on.find(bag).acceleration, rows[:, :3])
    np.testing.assert_array_equal(trained_on.find(bag, topic="/spare").acceleration, -rows[:, :3])
    with pytest.raises(RecordingError, match=r"has no topic '/imu2'. .* Try --topic /imu"):
        trained_on.find(bag, topic="/imu2")
    other = trained_on.model_copy(update={"topic": "/front"})  # which the bag does not have
    with pytest.raises(RecordingError, match="Select one with --topic /imu"):
        other.find(bag)
    (tmp_path / "drives/sand").mkdir(parents=True)
    bag = bag.parent.rename(tmp_path / "drives/sand/one") / "metadata.yaml"
    members = other.members(tmp_path / "drives", topic="/(?P<session>[a-z]+)")
    for (name, load, surface), topic, sign in zip(members, ("/imu", "/spare"), (1, -1), strict=True):
        assert (name, surface) == (f"{bag}?topic={topic}", "sand")
        np.testing.assert_array_equal(load().acceleration, sign * rows[:, :3])


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ("covariance", r"declare wx, wy, wz as not measured \(a covariance that starts with -1\)"),
        ("zero", "the turn rate is 0 in every message"),
        ("type", "no turn rate. Expected ax, ay, az, turn_x, turn_y, turn_z"),
    ],
)
def test_a_bag_without_turn_rates_raises_an_error_before_the_stream_starts(
    bags, imu_bag, turning, tmp_path, monkeypatch, change, error
):
    rows = values("sand", 3)
    rows[:, 3:] = 0
    if change == "covariance":
        monkeypatch.setattr(bags, "message", _without_turn_rate(bags.message))
    bag = imu_bag(tmp_path, rows, kind=bags.IMU if change != "type" else "geometry_msgs/msg/AccelStamped")
    roles = {"turn_rate": ("wx", "wy", "wz")}
    files = TrainingFiles(fs=FS, unit="m/s^2", acceleration=("ax", "ay", "az"), auxiliary=roles)
    turning = replace(turning, manifest=turning.manifest.model_copy(update={"input": files}))
    with pytest.raises(RecordingError, match=error):
        open_source(f"bag:{bag}", model=turning)


def _without_turn_rate(create):
    """Return a function that creates an Imu message whose covariance declares no turn rate."""

    def message(store, topic, stamp, value, *, ros1):
        imu = create(store, topic, stamp, value, ros1=ros1)
        imu.angular_velocity_covariance[0] = -1
        return imu

    return message


def test_turn_rates_are_used_although_their_covariance_is_not_known(bags, imu_bag, tmp_path, monkeypatch):
    monkeypatch.setattr(bags, "message", _without_turn_rate(bags.message))
    rows = values("sand", 3)
    recording = load_recording(imu_bag(tmp_path, rows), auxiliary={"turn_rate": ("wx", "wy", "wz")})
    np.testing.assert_array_equal(recording.turn_rate, rows[:, 3:])
