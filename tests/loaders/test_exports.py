"""Folders exported by sensor apps: one recording each, with its turn rate."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

from texclass.cli import app
from texclass.loaders import draft_card, find_recording, load_recording, open_dataset
from texclass.loaders.exports import find_exports
from texclass.recording import RecordingError

FS, N = 200.0, 2000
GRAVITY = np.array([0.0, 0.0, 9.81])
START_NS = 1_700_000_000_000_000_000


def sensor_logger(folder, seed=0, *, late_s=0.004):
    """Write an export of Sensor Logger; the gyroscope starts later and has its own time stamps."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True)
    t = np.arange(N) / FS
    acceleration, turn = rng.normal(size=(N, 3)), np.column_stack([np.sin(t + k) for k in range(3)])
    for name, values, delay in (
        ("TotalAcceleration", acceleration + GRAVITY, 0.0),
        ("Accelerometer", acceleration, 0.0),
        ("Gyroscope", turn, late_s),
        ("Magnetometer", 30 * acceleration, 0.0),
        ("Gravity", 0 * acceleration + 9.81, 0.0),
    ):
        x, y, z = values.T
        stamps = START_NS + np.rint(1e9 * (t + delay)).astype(np.int64)
        lines = [f"{ns},{(ns - START_NS) / 1e9:.6f},{c:.6f},{b:.6f},{a:.6f}"
                 for ns, a, b, c in zip(stamps.tolist(), x, y, z, strict=True)]  # fmt: skip
        (folder / f"{name}.csv").write_text("\n".join(["time,seconds_elapsed,z,y,x", *lines]))
    (folder / "Metadata.csv").write_text("version,device name\n3,phone\n")
    (folder / "Annotation.csv").write_text("time,text\n1,begin\n")
    return acceleration + GRAVITY, t


def phyphox(folder, seed=0, mark=",", decimal="."):
    """Write an export of phyphox."""
    rng = np.random.default_rng(seed)
    (folder / "meta").mkdir(parents=True)
    t, acceleration = np.arange(N) / FS, rng.normal(size=(N, 3)) + GRAVITY
    for name, unit in (("Accelerometer", "m/s^2"), ("Gyroscope", "rad/s"), ("Magnetometer", "µT")):
        head = mark.join(['"Time (s)"', *(f'"{axis} ({unit})"' for axis in "XYZ")])
        rows = (
            mark.join(f"{v:.9E}".replace(".", decimal) for v in row)
            for row in np.column_stack([t, acceleration])
        )
        (folder / f"{name}.csv").write_text("\n".join([head, *rows]), encoding="utf-8")
    (folder / "meta/device.csv").write_text('"property","value"\n"deviceModel","phone"\n')
    (folder / "meta/time.csv").write_text('"event","experiment time","system time"\n"START",0,1.7E9\n')
    return acceleration


def test_an_export_is_one_recording_with_the_turn_rate_at_the_times_of_the_acceleration(tmp_path):
    acceleration, t = sensor_logger(tmp_path / "rec.1")
    recording = load_recording(tmp_path / "rec.1", unit="m/s^2")
    assert (recording.recording_id, recording.channels) == ("rec.1", ("x", "y", "z"))
    assert recording.fs == pytest.approx(FS)
    np.testing.assert_allclose(recording.acceleration, acceleration, atol=2e-6)
    expected = np.column_stack([np.sin(t - 0.004 + k) for k in range(3)])
    np.testing.assert_allclose(recording.turn_rate[5:], expected[5:], atol=1e-4)
    flag = "export: TotalAcceleration.csv is read with the turn rate of Gyroscope.csv, 5 other files ignored"
    assert flag in recording.flags
    assert "joined: turn_rate of Gyroscope.csv, at the times of TotalAcceleration.csv" in recording.flags


@pytest.mark.parametrize(("mark", "decimal"), [(",", "."), (";", ",")])
def test_an_export_of_phyphox_states_rate_and_unit(tmp_path, mark, decimal):
    acceleration = phyphox(tmp_path / "rec", mark=mark, decimal=decimal)
    recording = load_recording(tmp_path / "rec")
    np.testing.assert_allclose(recording.acceleration, acceleration, rtol=1e-8)
    assert recording.fs == pytest.approx(FS)
    assert recording.turn_rate.shape == (N, 3)
    assert any(flag.endswith("3 other files ignored") for flag in recording.flags)


def test_acceleration_without_gravity_is_reported_once(tmp_path):
    for surface in ("oak", "wool"):
        sensor_logger(tmp_path / surface / "rec", seed=len(surface))
        (tmp_path / surface / "rec/TotalAcceleration.csv").unlink()
    notice = "Accelerometer.csv is read (acceleration without gravity)"
    (note,) = open_dataset(tmp_path, unit="m/s^2").notes
    assert note.startswith(f"2 sensor app exports: {notice} with the turn rate of Gyroscope.csv")
    (flag,) = (flag for flag in load_recording(tmp_path / "oak/rec", unit="m/s^2").flags if notice in flag)
    assert flag.startswith("export: ")


def test_only_linear_accelerations_are_reported_as_without_gravity():
    phyphox_files = ["Accelerometer.csv", "Linear Accelerometer.csv", "Gyroscope.csv", "meta/device.csv"]
    sensor_logger_files = ["Accelerometer.csv", "Gyroscope.csv", "Metadata.csv"]
    for files, has_gravity in (
        (phyphox_files, True),
        (phyphox_files[1:], False),
        (sensor_logger_files, False),
        ([*sensor_logger_files, "TotalAcceleration.csv"], True),
        (["Accelerometer.csv", "Gyroscope.csv"], True),
    ):
        (export,) = find_exports(files)
        assert export.has_gravity is has_gravity


def test_an_export_of_phyphox_with_one_sensor_is_one_recording(tmp_path):
    for surface in ("oak", "wool"):
        phyphox(tmp_path / surface / "rec")
        (tmp_path / surface / "rec/Accelerometer.csv").rename(tmp_path / surface / "rec/Raw Data.csv")
        for other in ("Gyroscope.csv", "Magnetometer.csv"):
            (tmp_path / surface / "rec" / other).unlink()
    dataset = open_dataset(tmp_path)
    assert [entry.recording_id for entry in dataset.entries] == ["oak/rec", "wool/rec"]
    assert "2 sensor app exports: Raw Data.csv is read, 2 other files ignored" in dataset.notes
    assert load_recording(tmp_path / "oak/rec").acceleration.shape == (N, 3)


def _two_surfaces(root):
    for number, surface in enumerate(("oak", "wool")):
        for k in (1, 2, 3):
            sensor_logger(root / surface / f"2024-01-0{k}", seed=10 * number + k)
    return root


def test_a_folder_of_exports_is_a_dataset_of_their_folders(tmp_path):
    dataset = open_dataset(_two_surfaces(tmp_path / "own"), unit="m/s^2")
    assert [entry.recording_id for entry in dataset.entries[:2]] == ["oak/2024-01-01", "oak/2024-01-02"]
    assert (len(dataset), dataset.surfaces) == (6, ("oak", "wool"))
    (note,) = dataset.notes
    summary = "TotalAcceleration.csv is read with the turn rate of Gyroscope.csv, 5 other files ignored"
    assert note == f"6 sensor app exports: {summary}"
    assert dataset[0].turn_rate is not None
    original_hash = dataset.input_hash
    path = tmp_path / "own/oak/2024-01-01/Gyroscope.csv"
    path.write_text(path.read_text().replace("0.1", "0.2"))
    assert open_dataset(tmp_path / "own", unit="m/s^2").input_hash != original_hash


def test_the_drafted_card_of_exports_gives_the_same_recordings(tmp_path):
    root = _two_surfaces(tmp_path / "own")
    card = draft_card(root, tmp_path, unit="m/s^2")
    assert "QUESTION" not in card
    assert "[companions]\nturn_rate = ['{recording}/Gyroscope.csv']" in card
    (tmp_path / "card.toml").write_text(card)
    drafted, folder = open_dataset(tmp_path / "card.toml"), open_dataset(root, unit="m/s^2")
    assert drafted.labels.to_dict() == folder.labels.to_dict()
    np.testing.assert_array_equal(drafted[3].turn_rate, folder[3].turn_rate)


def test_the_drafted_card_of_labelled_exports_has_their_turn_rate(tmp_path):
    for k in (1, 2):
        sensor_logger(tmp_path / "own" / f"rec{k}", seed=k)
    table = tmp_path / "own" / "labels.csv"
    table.write_text("file,surface\nrec1,oak\nrec2,wool\n")
    (tmp_path / "card.toml").write_text(draft_card(tmp_path / "own", tmp_path, unit="m/s^2"))
    drafted = open_dataset(tmp_path / "card.toml")
    folder = open_dataset(tmp_path / "own", unit="m/s^2", labels=table)
    assert drafted.labels.to_dict() == folder.labels.to_dict() == {"rec1": "oak", "rec2": "wool"}
    np.testing.assert_array_equal(drafted[1].turn_rate, folder[1].turn_rate)


def test_a_model_trained_on_exports_predicts_an_export(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _two_surfaces(tmp_path / "own")
    sensor_logger(tmp_path / "new", seed=99)

    def run(*words):
        done = CliRunner().invoke(app, list(words))
        assert done.exit_code == 0, (done.output, done.exception)
        return done.output

    run("train", "own", "--unit", "m/s^2", "--jobs", "1", "-o", "m.skops")
    assert "new" in run("predict", "m.skops", "new")
    assert "6 recordings" in run("predict", "m.skops", "own")
    assert find_recording("new", unit="m/s^2").turn_rate is not None


@pytest.mark.parametrize(
    "name", ["Gyroscope.csv", "MagnetometerUncalibrated.csv", "magnetic_field.txt", "gyroscope_02.csv"]
)
def test_a_file_of_another_sensor_is_no_acceleration(tmp_path, name):
    path = tmp_path / name
    path.write_text("time,x,y,z\n" + "".join(f"{k / 100},{k % 7},{k % 5},{k % 3}\n" for k in range(300)))
    with pytest.raises(
        RecordingError, match=rf"{re.escape(name)}: the file name denotes another sensor .*--column"
    ):
        load_recording(path, unit="m/s^2")
    assert load_recording(path, unit="arbitrary", column=("x", "y", "z")).fs == 100


def test_files_of_two_sensors_must_share_their_time(tmp_path):
    sensor_logger(tmp_path / "rec", late_s=5.0)
    with pytest.raises(RecordingError, match=r"Gyroscope\.csv: it covers 50% of the duration of"):
        load_recording(tmp_path / "rec", unit="m/s^2")
    gyroscope = tmp_path / "rec/Gyroscope.csv"
    gyroscope.write_text(gyroscope.read_text().replace("time,", "clock,", 1))
    with pytest.raises(RecordingError, match=r"Gyroscope\.csv: no column 'time'"):
        load_recording(tmp_path / "rec", unit="m/s^2")


def test_a_card_joins_two_files_by_their_times(tmp_path):
    t = np.arange(N) / FS
    acceleration, force = np.random.default_rng(0).normal(size=N), np.sin(t)
    slow = t[::4]
    (tmp_path / "oak_1.csv").write_text(
        "time,x\n" + "".join(f"{a},{b}\n" for a, b in zip(t, acceleration, strict=True))
    )
    degrees = np.column_stack([slow, 90 * np.sin(slow), slow, slow])
    turn = "time,gx (deg/s),gy (deg/s),gz (deg/s)\n" + "".join(f"{','.join(map(str, r))}\n" for r in degrees)
    (tmp_path / "turn_1.csv").write_text(turn)
    rows = "".join(f"{a},{np.sin(a)}\n" for a in slow)
    (tmp_path / "force_1.csv").write_text(f"time,Fz\n{rows}")
    (tmp_path / "card.toml").write_text(
        "fs_hz = 200\nunit = 'g'\nfiles = '(?P<surface>oak)_(?P<repetition>[0-9]+)[.]csv'\n[companions]\n"
        "normal_force = 'force_{repetition}.csv'\nturn_rate = 'turn_{repetition}.csv'\n"
    )
    recording = open_dataset(tmp_path / "card.toml")[0]
    assert recording.auxiliary_fs == {"normal_force": 50.0, "turn_rate": 50.0}
    np.testing.assert_allclose(recording.normal_force, force[::4], atol=1e-9)
    np.testing.assert_allclose(recording.turn_rate[:, 0], np.pi / 2 * np.sin(slow), atol=1e-9)
    assert "joined: normal_force of force_1.csv, at its own rate, 50 Hz" in recording.flags
    (tmp_path / "force_1.csv").write_text("Fz\n" + "".join(f"{np.sin(a)}\n" for a in slow))
    with pytest.raises(RecordingError, match=r"force_1\.csv: no column 'time'"):
        open_dataset(tmp_path / "card.toml")[0]


def test_only_folders_with_several_sensors_are_exports():
    assert find_exports(["oak/accelerometer.csv", "oak/1.csv", "wool/gyroscope.csv"]) == []
    (export,) = find_exports(["a/Linear Accelerometer.csv", "a/Gyroscope.csv", "a/meta/time.csv", "b/1.csv"])
    assert (export.acceleration, export.turn_rate) == ("a/Linear Accelerometer.csv", "a/Gyroscope.csv")
    assert export.ignored == ("a/meta/time.csv",)
