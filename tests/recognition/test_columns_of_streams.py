"""A model that was trained on more than accelerations hears the rest on a stream, or says what is missing."""

import importlib
import io
import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from toy_surfaces import pipeline
from turning_surfaces import FS, TERRAINS, N, terrains, turning_model, values

from texclass.evaluation.pipeline import RowDefinition
from texclass.features import load_feature_set
from texclass.loaders import load_recording, open_dataset
from texclass.loaders.dataset import Dataset
from texclass.recognition import Session, is_live, load_model, open_source, train
from texclass.recognition.live.online_recogniser import Stretches
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
material = "terrain"
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
        ("type", "no turn rate; the rule is ax, ay, az, turn_x, turn_y, turn_z"),
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


@pytest.mark.parametrize("n_columns", [3, 5, 7])
def test_text_of_other_columns_is_refused_by_name(turning, n_columns):
    text = io.BytesIO("\n".join([" ".join(["1"] * n_columns)] * 50).encode())
    session = Session(turning)
    with pytest.raises(
        ValueError, match=f"has {n_columns} columns; the rule is 6, ax, ay, az, turn_x, turn_y"
    ):
        list(session.run(open_source("-", fs=FS, unit="m/s^2", file=text, model=turning)))
    with pytest.raises(ValueError, match=f"has {n_columns} columns; the rule is 6"):
        open_source("-", fs=FS, unit="m/s^2", file=io.BytesIO(b""), raw_channels=n_columns, model=turning)


# Friction: a last column.


def rubbed():
    """Return the terrains with a friction that alone tells them apart; they do not turn."""
    level = {"gravel": 0.2, "grass": 1.0, "sand": 3.0}
    turning = terrains()

    def load(entry):
        whole = turning.load(entry)
        noise = np.random.default_rng(entry.repetition).standard_normal(N)
        return whole.with_(turn_rate=None, friction=level[entry.material] * (1 + 0.05 * noise))

    return Dataset("rubbed", turning.entries, load, "rubbed")


@pytest.fixture(scope="module")
def rubbing_model():
    friction = load_feature_set("texclass").restricted_to(["friction", "prediction_gain"])
    rows = (RowDefinition(name="Friction", features=("friction", "prediction_gain")),)
    return train(
        rubbed(), pipeline(features=friction, rows=rows), row="Friction", classifier="lda", false_alarms=0.2
    )


def test_friction_is_the_last_column_of_a_stream(rubbing_model):
    model = rubbing_model
    assert model.needs.names == ("ax", "ay", "az", "friction")
    for index in (0, 8, 16):
        recording = rubbed()[index]
        both = np.column_stack([recording.acceleration, recording.friction])
        shape = Stretches(model, 4, FS, "m/s^2")
        window = shape.window(both, 0)
        np.testing.assert_array_equal(window.friction, recording.friction)
        np.testing.assert_array_equal(window.acceleration, recording.acceleration)
        asked = model.answer(recording)
        assert asked.surface == recording.material
        assert model.answer(window).probabilities == asked.probabilities
        text = io.BytesIO("\n".join(" ".join(map(repr, row)) for row in both.tolist()).encode())
        session = Session(model)
        list(session.run(open_source("-", fs=FS, unit="m/s^2", file=text, model=model)))
        assert session.live.verdict.surface == recording.material


def test_a_stream_without_friction_is_refused_before_it_begins(rubbing_model, tmp_path):
    told = "no friction, needed by friction; the rule is ax, ay, az, friction, .* --row of acceleration only"
    np.savetxt(tmp_path / "r.csv", values("sand", 1)[:, :3], delimiter=",", header="ax,ay,az", comments="")
    with pytest.raises(RecordingError, match=told):
        open_source(str(tmp_path / "r.csv"), fs=FS, model=rubbing_model)
    pytest.importorskip("cyclonedds", reason="the extra `robot` is not installed")
    from texclass.robot import topic_blocks

    with pytest.raises(RecordingError, match=f"ros2:/imu: sensor_msgs/msg/Imu has {told}"):
        topic_blocks(
            "/imu", type_name="sensor_msgs/msg/Imu", reliability="reliable", needs=rubbing_model.needs
        )
    with pytest.raises(ValueError, match="has 3 columns; the rule is 4, ax, ay, az, friction"):
        Stretches(rubbing_model, 3, FS, "m/s^2")


def test_what_is_live_is_not_conditioned_yet():
    assert [is_live(name) for name in ("-", "ros2:/imu", "bag:a.mcap", "a.wav")] == [True, True, False, False]
