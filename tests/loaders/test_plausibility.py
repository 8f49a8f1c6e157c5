"""Invalid values are errors, implausible ones are flagged, usual ones give no flag."""

import numpy as np
import pytest

from texclass.loaders import load_recording, open_dataset
from texclass.loaders.plausibility import folder_level_notes, plausibility_flags, similar_label_notes
from texclass.recording import RecordingError

FS = 1000.0
RNG = np.random.default_rng(3)
AT_REST = np.array([3.0, -4.0, 8.44]) + RNG.normal(size=(4000, 3))  # 9.8 m/s^2 through strong vibration


def flags_of(acceleration, unit="m/s^2", **options):
    return plausibility_flags({"acceleration": acceleration}, FS, unit, **options)


@pytest.mark.parametrize(
    ("factor", "unit", "message"),
    [
        (1 / 9.81, "m/s^2", "level at rest is 1 m/s^2, but gravity is 9.81 m/s^2. If the data are in g, set"),
        (1000 / 9.81, "m/s^2", "If the data are in mg, set --unit mg"),
        (1.0, "g", "gravity is 1 g. If the data are in m/s^2, set --unit m/s^2"),
        (0.55, "m/s^2", "Check unit, scale and columns"),
        (2.0, "m/s^2", "Check unit, scale and columns"),
    ],
)
def test_a_level_at_rest_other_than_gravity_is_flagged_with_the_likely_unit(factor, unit, message):
    (flag,) = flags_of(factor * AT_REST, unit)
    assert message in flag
    assert flags_of(AT_REST, unit, scale=factor) == flags_of(factor * AT_REST, unit)
    assert flags_of(factor * AT_REST, unit, flags=("unit: as in the bag",)) == ()


def test_gravity_on_any_axis_or_none_and_units_without_scale_give_no_flag():
    turn = np.linspace(0, 1, 4000)[:, None]
    turning = 9.81 * np.hstack([np.sin(turn), np.cos(turn), 0 * turn]) + RNG.normal(size=(4000, 3))
    for acceleration in (AT_REST, turning, AT_REST - AT_REST.mean(axis=0), AT_REST[:, 0]):
        assert flags_of(acceleration) == ()
    for unit in ("counts", "V", "arbitrary"):
        assert flags_of(AT_REST / 9.81, unit) == ()


def test_clipped_turn_rates_are_flagged():
    turn = np.clip(30_000 * np.sin(np.arange(4000) / 20)[:, None] * [1, 2, 0.1], -32768, 32767)
    (flag,) = plausibility_flags({"acceleration": AT_REST, "turn_rate": turn}, FS, "m/s^2")
    assert flag.startswith("clipped: ")
    assert "of the turn_rate at full scale" in flag


@pytest.mark.parametrize(
    ("scale", "fs", "message"),
    [
        (1e300, FS, r"contains a value of 4e\+300. Expected at most 1e\+30"),
        (1.0, 1e12, r"fs is 1e\+12 Hz. Expected"),
    ],
)
def test_values_and_rates_beyond_any_sensor_are_errors(tmp_path, scale, fs, message):
    np.savetxt(tmp_path / "r.txt", scale * np.array([1.0, -4.0, 2.0, 3.0]))
    with pytest.raises(RecordingError, match=rf"r\.txt: {message}"):
        load_recording(tmp_path / "r.txt", fs=fs, unit="counts")


def test_similar_folder_names_and_labels_that_are_sessions_are_noted(tmp_path):
    for session in ("day 1", "day 2"):
        for k, surface in enumerate(("wood", "Wood", "steel")):
            (tmp_path / session / surface).mkdir(parents=True)
            np.savetxt(tmp_path / session / surface / "r.txt", AT_REST[k:, 0] + (session == "day 1"))
    (note,) = open_dataset(tmp_path, fs=FS, unit="m/s^2").notes
    assert note.startswith("the labels are day 1, day 2, and each of these folders contains Wood, steel")
    (note,) = open_dataset(tmp_path / "day 1", fs=FS, unit="m/s^2").notes
    assert note.startswith("surfaces 'Wood' and 'wood' differ only in case or blanks: rename one of them if")
    assert similar_label_notes(["oak", "beech"]) == []
    for usual in (
        ["wood/one/r.txt", "steel/one/r.txt"],
        ["wood/a/r.txt", "steel/b/r.txt"],
        ["a/r.txt", "b/r.txt"],
    ):
        assert folder_level_notes([name.split("/") for name in usual]) == []
    train_and_test = [f"{m}/{part}/r.txt".split("/") for m in "abc" for part in ("test", "train")]
    assert folder_level_notes(train_and_test) == []


def test_a_wrong_unit_is_reported_once_for_all_recordings(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for surface in ("wood", "steel"):
        (tmp_path / "own" / surface).mkdir(parents=True)
        for i in range(3):
            np.savetxt(tmp_path / "own" / surface / f"{i}.csv", AT_REST / 9.81, delimiter=",")
    arguments = "own --fs 1000 --unit m/s^2 --column 1,2,3 --jobs 1 --features coarse -o t.csv"
    message = "6 of 6 recordings: unit: the level at rest is 1 m/s^2, but gravity is 9.81 m/s^2"
    code, out, _ = command("extract", *arguments.split())
    assert (code, out.count(message)) == (0, 1)
