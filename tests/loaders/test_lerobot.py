"""Datasets in the layout of LeRobot 3."""

import json
import pickle
import sys

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="pyarrow is not installed (the extra `parquet`)")

import pyarrow.parquet as pq
from lerobot_writer import ACCELERATION, FPS, N_FRAMES, STATE, rows_of, write_lerobot

from texclass.loaders import draft_card, find_recording, open_dataset
from texclass.recording import RecordingError

TASKS = {"labels": "task", "unit": "m/s^2"}
IDS = [f"episode_{i:06d}" for i in range(6)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_lerobot(tmp_path_factory.mktemp("lerobot") / "strokes")


def test_each_episode_is_a_recording(folder):
    dataset = open_dataset(folder, **TASKS)
    assert [entry.recording_id for entry in dataset.entries] == IDS
    assert dataset.surfaces == ("stroke the foam", "stroke the oak", "stroke the slate")
    assert [entry.repetition for entry in dataset.entries] == [1, 1, 2, 2, 1, 2]
    assert [entry.paths for entry in dataset.entries][::2] == [
        ("data/chunk-000/file-000.parquet",),
        ("data/chunk-000/file-001.parquet",),
        ("data/chunk-001/file-000.parquet",),
    ]
    assert dataset.notes == (
        f"acceleration: {ACCELERATION}, the only feature with the name of an acceleration",
    )
    for i, (recording, surface) in enumerate(zip(dataset, ("oak", "foam", "oak", "foam"), strict=False)):
        np.testing.assert_allclose(recording.acceleration, rows_of(surface, i), atol=1e-5)
        assert (recording.fs, recording.unit, recording.channels) == (FPS, "m/s^2", ("x", "y", "z"))
        assert recording.surface == f"stroke the {surface}"


def test_the_label_is_the_task_a_feature_or_a_table(folder, tmp_path):
    (tmp_path / "labels.csv").write_text(
        "file,surface,operator\n" + "".join(f"{name},wood,anna\n" for name in IDS), encoding="utf-8"
    )
    assert open_dataset(folder, labels="surface_id", unit="g").surfaces == ("0", "1", "2")
    dataset = open_dataset(folder, labels=tmp_path / "labels.csv", unit="g")
    assert {(entry.surface, entry.operator) for entry in dataset.entries} == {("wood", "anna")}


def test_a_table_numbers_the_repetitions(folder, tmp_path):
    table = tmp_path / "labels.csv"
    rows = [f"{name},wood,{7 - i}\n" for i, name in enumerate(IDS)]
    table.write_text("file,surface,repetition\n" + "".join(rows), encoding="utf-8")
    dataset = open_dataset(folder, labels=table, unit="g")
    assert [entry.repetition for entry in dataset.entries] == [7, 6, 5, 4, 3, 2]
    table.write_text(table.read_text(encoding="utf-8").replace("wood,7", "wood,first"), encoding="utf-8")
    with pytest.raises(RecordingError, match=r"repetition of episode 0 is 'first'. Expected a whole number"):
        open_dataset(folder, labels=table, unit="g")


def test_the_label_is_never_guessed(folder):
    with pytest.raises(RecordingError) as error:
        open_dataset(folder, unit="m/s^2")
    assert "the surface of episode 0 is unknown" in str(error.value)
    assert "--labels task (the text of the task), --labels FEATURE (surface_id)" in str(error.value)


@pytest.mark.parametrize(
    ("labels", "error"),
    [
        (
            "action",
            "'action' is not a feature with one text or whole number.*Expected one of task, surface_id",
        ),
        ("absent", "'absent' is not a feature"),
        ("absent.csv", "absent.csv: the label table cannot be read"),
    ],
)
def test_an_invalid_label_raises_an_error(folder, labels, error):
    with pytest.raises((RecordingError, ValueError), match=error):
        open_dataset(folder, unit="g", labels=labels)


def test_an_episode_with_several_labels_raises_an_error(tmp_path):
    root = write_lerobot(
        tmp_path / "d",
        tasks={3: ["stroke the oak", "rest"]},
        columns={"surface_id": lambda surface, index: [0] * 499 + [index]},
    )
    with pytest.raises(RecordingError, match="episode 3 has 2 values of 'task': 'stroke the oak', 'rest'"):
        open_dataset(root, **TASKS)
    with pytest.raises(RecordingError, match="episode 1 has 2 values of 'surface_id': '0', '1'"):
        open_dataset(root, unit="g", labels="surface_id")


def with_state(**changes):
    names = ["pan.pos", "accelerometer_x", "accelerometer_y", "accelerometer_z"]
    state = {STATE: {"dtype": "float32", "shape": [4], "names": names}}
    columns = {STATE: lambda s, i: np.column_stack([np.zeros(N_FRAMES), rows_of(s, i)]).tolist()}
    return {"features": state, "columns": columns} | changes


def test_components_of_a_vector_are_columns(tmp_path):
    root = write_lerobot(tmp_path / "d", **with_state())
    columns = [f"{STATE}.accelerometer_{axis}" for axis in "xz"]
    recording = open_dataset(root, column=columns, **TASKS)[0]
    np.testing.assert_allclose(recording.acceleration, rows_of("oak", 0)[:, [0, 2]], atol=1e-5)
    assert recording.channels == ("accelerometer_x", "accelerometer_z")
    assert open_dataset(root, column="action.pan", **TASKS).notes == ()


def test_several_accelerations_raise_an_error_that_names_them(tmp_path):
    features = {"observation.base.accelerometer": {"dtype": "float32", "shape": [3]}}
    columns = {"observation.base.accelerometer": lambda s, i: rows_of(s, i).tolist()}
    root = write_lerobot(tmp_path / "d", features=features, columns=columns)
    with pytest.raises(
        RecordingError, match=rf"{ACCELERATION}, observation.base.accelerometer. Expected --column"
    ):
        open_dataset(root, **TASKS)
    assert open_dataset(root, column="observation.base.accelerometer", **TASKS)[0].channels == ("1", "2", "3")


def test_a_dataset_without_acceleration_raises_an_error_that_suggests_columns(tmp_path):
    options = with_state()
    options["features"][ACCELERATION] = {"dtype": "video", "shape": [3]}
    root = write_lerobot(tmp_path / "d", **options)
    axes = ",".join(f"{STATE}.accelerometer_{axis}" for axis in "xyz")
    with pytest.raises(RecordingError, match=f"no feature has the name of an acceleration.*--column {axes}"):
        open_dataset(root, **TASKS)
    with pytest.raises(
        RecordingError, match=r"no feature or component 'ax'.*observation.state \(pan.pos, acc"
    ):
        open_dataset(root, column="ax", **TASKS)
    with pytest.raises(RecordingError, match=r"action.pan is selected twice"):
        open_dataset(root, column=["action", "action.pan"], **TASKS)


def test_a_block_of_samples_per_frame_multiplies_the_rate(tmp_path):
    n = 20

    def blocks(surface, index):
        return rows_of(surface, index, n * N_FRAMES).reshape(N_FRAMES, n, 3).tolist()

    features = {
        ACCELERATION: {"dtype": "float64", "shape": [n, 3]},
        "observation.imu.acc": {"dtype": "float64", "shape": [3, n]},
    }
    root = write_lerobot(tmp_path / "d", ("oak", "foam"), features=features, columns={ACCELERATION: blocks})
    dataset = open_dataset(root, **TASKS)
    assert dataset[0].fs == n * FPS
    np.testing.assert_allclose(dataset[1].acceleration, rows_of("foam", 1, n * N_FRAMES))
    with pytest.raises(RecordingError, match="equal numbers of samples per frame"):
        open_dataset(root, column=[ACCELERATION, "action"], **TASKS)


def test_missing_frames_are_interpolated_and_reported(tmp_path):
    times = np.delete(np.arange(N_FRAMES + 3) / FPS, [100, 101, 102])
    root = write_lerobot(tmp_path / "d", times=lambda n: times)
    recording = open_dataset(root, **TASKS)[0]
    assert recording.n_samples == N_FRAMES + 3
    assert any("gap" in flag for flag in recording.flags)


def test_time_stamps_that_contradict_the_rate_raise_an_error(tmp_path):
    root = write_lerobot(tmp_path / "d", times=lambda n: np.arange(n) / 800)
    with pytest.raises(RecordingError, match=r"\(episode 0\).*800 Hz.*1000 Hz in meta/info.json"):
        open_dataset(root, **TASKS)[0]
    with pytest.raises(RecordingError, match="fs is 1000 Hz, but 800 Hz was given"):
        open_dataset(root, fs=800, **TASKS)


def test_long_episodes_have_coarse_time_stamps(tmp_path):
    """A float32 resolves 0.06 ms after 1000 s."""
    root = write_lerobot(tmp_path / "d", ("oak",), times=lambda n: 1000 + np.arange(n) / FPS)
    recording = open_dataset(root, **TASKS)[0]
    np.testing.assert_allclose(recording.acceleration, rows_of("oak", 0), atol=1e-5)
    assert not any("jitter" in flag or "timestamp" in flag for flag in recording.flags)


def test_only_the_rows_of_the_episode_and_its_columns_are_read(folder, monkeypatch):
    calls = []
    read = pq.read_table

    def record(path, **options):
        calls.append((path, options["columns"], read(path, **options).num_rows))
        return read(path, **options)

    dataset = open_dataset(folder, **TASKS)
    monkeypatch.setattr(pq, "read_table", record)
    assert dataset[3].n_samples == N_FRAMES
    ((path, columns, n_rows),) = calls
    assert path.name == "file-001.parquet"
    assert (columns, n_rows) == ([ACCELERATION, "frame_index", "timestamp"], N_FRAMES)


def test_the_hash_depends_on_the_content_and_a_dataset_is_picklable(folder, tmp_path):
    dataset = open_dataset(folder, **TASKS)
    copy = pickle.loads(pickle.dumps(dataset))
    np.testing.assert_array_equal(copy[0].acceleration, dataset[0].acceleration)
    other = write_lerobot(tmp_path / "d", ("foam", "foam", "oak", "foam", "slate", "slate"))
    assert open_dataset(other, **TASKS).input_hash != dataset.input_hash
    assert open_dataset(folder, labels="surface_id", unit="m/s^2").input_hash != dataset.input_hash


def test_a_single_episode_needs_no_label(folder):
    recording = find_recording(f"{folder}:episode_000004", unit="m/s^2")
    assert recording.surface is None
    np.testing.assert_allclose(recording.acceleration, rows_of("slate", 4), atol=1e-5)
    with pytest.raises(RecordingError, match="there is no recording 'episode_000009'"):
        find_recording(f"{folder}:episode_000009", unit="m/s^2")


CARD = """
format = "lerobot"
folder = "strokes"
fs_hz = 1000
unit = "g"
surface = "task"
scale = 0.5
[channels]
acceleration = "observation.imu.acceleration"
turn_rate = ["action.pan", "action.lift", "observation.imu.acceleration.x"]
[surfaces]
"stroke the oak" = "oak"
"stroke the foam" = "foam"
"""


def test_a_card_describes_a_dataset(folder):
    (folder.parent / "card.toml").write_text(CARD, encoding="utf-8")
    dataset = open_dataset(folder.parent / "card.toml")
    assert dataset.surfaces == ("foam", "oak", "stroke the slate")
    recording = dataset[0]
    np.testing.assert_allclose(recording.acceleration, 0.5 * 9.80665 * rows_of("oak", 0), atol=1e-3)
    assert recording.turn_rate.shape == (N_FRAMES, 3)
    (folder.parent / "card.toml").write_text(CARD.replace("1000", "500"), encoding="utf-8")
    with pytest.raises(RecordingError, match="fs is 1000 Hz, but 500 Hz"):
        open_dataset(folder.parent / "card.toml")[0]


def test_a_draft_of_a_card_refers_to_the_format(folder, tmp_path):
    with pytest.raises(RecordingError, match=r"is a LeRobot dataset.*format = 'lerobot'"):
        draft_card(folder, tmp_path)


@pytest.mark.parametrize(
    ("info", "error"),
    [
        (
            {"codebase_version": "v2.1"},
            "codebase_version is 'v2.1'. Expected v3.0: convert it with lerobot",
        ),
        ({"codebase_version": "v4.0"}, "codebase_version is 'v4.0'. Expected v3.0"),
        ({"fps": 0}, "fps"),
        ({"features": []}, "features"),
        (
            {"data_path": "../{chunk_index:03d}/{file_index:03d}.parquet"},
            "data_path leads to '../000/000.parquet'",
        ),
        ({"data_path": "data/{chunk_index.real}"}, "data_path is 'data/{chunk_index.real}'"),
        ({"data_path": "data/{file_index:99999999d}"}, "data_path is"),
        ({"data_path": "data/{}.parquet"}, "data_path is"),
        ({"data_path": "data/{file_index"}, "info.json"),
        (
            {"data_path": "frames/{file_index}.parquet"},
            "missing files: 'frames/0.parquet', 'frames/1.parquet'",
        ),
    ],
)
def test_a_damaged_description_raises_an_error(tmp_path, info, error):
    root = write_lerobot(tmp_path / "d", info=info)
    with pytest.raises(RecordingError) as caught:
        open_dataset(root, **TASKS)
    assert error in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"fps": 3}', "\x00"])
def test_a_description_that_is_no_json_raises_an_error(tmp_path, text):
    root = write_lerobot(tmp_path / "d")
    (root / "meta" / "info.json").write_text(text, encoding="utf-8")
    with pytest.raises(
        RecordingError, match=r"info.json: not readable as the description of a LeRobot dataset"
    ):
        open_dataset(root, **TASKS)


def test_damaged_files_raise_an_error(tmp_path):
    root = write_lerobot(tmp_path / "d")
    dataset = open_dataset(root, **TASKS, skip_bad=True)
    path = root / "data/chunk-000/file-001.parquet"
    path.write_bytes(path.read_bytes()[:1000])
    assert dataset[0].n_samples == N_FRAMES
    assert "file-001.parquet: not a readable Parquet file" in str(dataset.attempt(dataset.entries[2]))
    path.unlink()
    with pytest.raises(RecordingError, match=r"missing files: 'data/chunk-000/file-001.parquet'"):
        open_dataset(root, **TASKS)
    (root / "meta/episodes/chunk-000/file-000.parquet").unlink()
    with pytest.raises(RecordingError, match="it lists no episode"):
        open_dataset(root, **TASKS)


def test_an_incomplete_episode_raises_an_error(tmp_path):
    root = write_lerobot(tmp_path / "d", length=501)
    with pytest.raises(RecordingError, match=r"\(episode 0\): it has 500 frames.*Expected 501 frames"):
        open_dataset(root, **TASKS)[0]


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (lambda rows: [None, *rows[1:]], "has 1 missing value"),
        (lambda rows: [[0.0, 1.0], *rows[1:]], "numbers in the shape"),
        (lambda rows: [["a"] * 3 for _ in rows], "values of type"),
        (lambda rows: [[0.0, None, 1.0], *rows[1:]], "missing value"),
    ],
)
def test_damaged_values_raise_an_error(tmp_path, change, error):
    def rows(surface, index):
        return change(rows_of(surface, index).tolist())

    features = {"observation.acc": {"dtype": "float32", "shape": [3]}}
    root = write_lerobot(tmp_path / "d", features=features, columns={"observation.acc": rows})
    with pytest.raises(RecordingError, match=error):
        open_dataset(root, column="observation.acc", **TASKS)[0]


def test_options_of_text_files_raise_an_error(folder):
    with pytest.raises(RecordingError, match="delimiter cannot be used with a LeRobot dataset"):
        open_dataset(folder, delimiter=";", **TASKS)


def test_without_pyarrow_the_message_names_the_extra(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(
        RecordingError, match=r"require the extra `parquet`.*pip install 'texclass\[parquet\]'"
    ):
        open_dataset(folder, **TASKS)


def test_commands_train_and_predict(folder, tmp_path, command):
    model = tmp_path / "m.skops"
    options = ["--unit", "m/s^2", "--labels", "task"]
    root = write_lerobot(tmp_path / "d", ("oak", "foam", "slate") * 4)
    arguments = ["train", root, *options, "--pipeline", "coarse", "--classifier", "lda", "-o", model]
    code, _, errors = command(*arguments)
    assert not code, errors
    code, text, errors = command("predict", model, f"{root}:episode_000004", "--jsonl")
    assert not code, errors
    assert json.loads(text.splitlines()[0])["surface"] == "stroke the foam"
    code, text, errors = command("predict", model, folder)
    assert not code, errors
    assert text.count("stroke the") >= 6
