"""A bag is streamed as it is predicted, with the turn rates that a model needs."""

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

    def write(folder, both, name="bag", kind=bags.IMU, **others):
        topics = {"/imu": bags.Topic(kind, both, bags.regular(N, FS)), **others}
        return bags.write_bag(folder, "mcap", topics, name=name)

    return write


@pytest.fixture(scope="module")
def folder(bags, imu_bag, tmp_path_factory):
    """Bags with an Imu and a topic that nobody asks for, labelled by a table; a model trained on them."""
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


def test_a_stream_of_a_bag_gives_the_answers_of_predict(run, folder, imu_bag):
    for terrain in TERRAINS:
        both = values(terrain, 50)
        name = f"bag:{imu_bag(folder, both, f'new_{terrain}')}?topic=/imu"
        code, out, err = run("predict", "terrains.skops", name, "--jsonl")
        assert (code, err) == (0, "")
        (asked,) = map(json.loads, out.splitlines())
        assert asked["surface"] == terrain
        assert asked["probability"] > 0.9
        code, out, err = run("stream", "terrains.skops", name, "--jsonl")
        assert code == 0
        assert [a["probability"] for a in _answers(out)] == [pytest.approx(asked["probability"])]
        assert json.loads(out.splitlines()[-1])["surface"] == terrain
        # The same samples as text, not yet scaled.
        text = "\n".join(",".join(map(repr, row)) for row in both.tolist())
        code, out, _ = run("stream", "terrains.skops", "--fs", 200, "--jsonl", text=text)
        assert [a["probability"] for a in _answers(out)] == [pytest.approx(asked["probability"])]


def test_a_bag_is_conditioned_as_the_bags_of_training_were(folder):
    model = load_model(folder / "terrains.skops")
    bag = folder / "bags/sand2"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEXCLASS_DATA", str(folder))
        (by_card,) = predict(model, [f"{folder}/terrains.toml:sand2"])
    for name in (bag, bag / "sand2.mcap", f"bag:{bag}", f"bag:{bag / 'sand2.mcap'}?topic=/imu"):
        (by_file,) = predict(model, [str(name)])  # of two topics, that of the card
        assert by_file.problem == ""
        assert by_file.answer.probabilities == pytest.approx(by_card.answer.probabilities)


def test_a_bag_stands_for_files_whose_columns_have_other_names(bags, imu_bag, tmp_path):
    axes = ("a1", "a2", "a3")
    roles = {"acceleration": axes, "auxiliary": {"turn_rate": ("g1", "g2", "g3")}, "axes": axes}
    csv = TrainingFiles(fs=FS, unit="m/s^2", scale=2.0, turn_rate_scale=0.5, **roles)
    both = values("sand", 3)
    imu = imu_bag(tmp_path, both)
    numbers = bags.Topic(bags.ARRAY, list(both.reshape(40, 10, 6)), None, bags.regular(40, FS / 10))
    array = bags.write_bag(tmp_path, "mcap", {"/imu": numbers}, name="array")
    for bag in (imu, array):
        found = csv.find(str(bag))
        assert found.channels == ("a1", "a2", "a3")
        np.testing.assert_array_equal(found.acceleration, 2 * both[:, :3])
        np.testing.assert_array_equal(found.turn_rate, both[:, 3:])  # rad/s, as messages say
    in_g = TrainingFiles(fs=FS, unit="g", scale=2.0)
    np.testing.assert_array_equal(in_g.find(str(imu)).acceleration, both[:, :3])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("disclaimed", r"say that wx, wy, wz are not measured \(a covariance that begins with -1\)"),
        ("zero", "the turn rate is 0 in each of its messages"),
        ("type", "no turn rate. Expected ax, ay, az, turn_x, turn_y, turn_z"),
    ],
)
def test_a_bag_without_turn_rates_is_refused_before_the_stream_begins(
    bags, imu_bag, turning, tmp_path, monkeypatch, change, told
):
    both = values("sand", 3)
    both[:, 3:] = 0
    if change == "disclaimed":
        monkeypatch.setattr(bags, "message", _disclaiming(bags.message))
    bag = imu_bag(tmp_path, both, kind=bags.IMU if change != "type" else "geometry_msgs/msg/AccelStamped")
    roles = {"turn_rate": ("wx", "wy", "wz")}
    files = TrainingFiles(fs=FS, unit="m/s^2", acceleration=("ax", "ay", "az"), auxiliary=roles)
    turning = replace(turning, manifest=turning.manifest.model_copy(update={"input": files}))
    with pytest.raises(RecordingError, match=told):
        open_source(f"bag:{bag}", model=turning)


def _disclaiming(make):
    """Let an Imu say, as its definition asks for, that it does not measure what it does not measure."""

    def message(store, told, stamp, value, *, ros1):
        made = make(store, told, stamp, value, ros1=ros1)
        made.angular_velocity_covariance[0] = -1
        return made

    return message


def test_a_disclaimer_beside_real_numbers_is_not_believed(bags, imu_bag, tmp_path, monkeypatch):
    monkeypatch.setattr(bags, "message", _disclaiming(bags.message))
    both = values("sand", 3)
    found = load_recording(imu_bag(tmp_path, both), auxiliary={"turn_rate": ("wx", "wy", "wz")})
    np.testing.assert_array_equal(found.turn_rate, both[:, 3:])
