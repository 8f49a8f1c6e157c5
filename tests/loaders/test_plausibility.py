"""What cannot be is refused, what is unlikely is told, what is usual passes without a word."""

import numpy as np
import pytest

from texclass.loaders import load_recording, open_dataset
from texclass.loaders.plausibility import folder_level_notes, plausibility_flags, similar_label_notes
from texclass.recording import RecordingError

FS = 1000.0
RNG = np.random.default_rng(3)
AT_REST = np.array([3.0, -4.0, 8.44]) + RNG.normal(size=(4000, 3))  # 9.8 m/s^2 through strong vibration


def found(acceleration, unit="m/s^2", **how):
    return plausibility_flags({"acceleration": acceleration}, FS, unit, **how)


@pytest.mark.parametrize(
    ("factor", "unit", "said"),
    [
        (1 / 9.81, "m/s^2", "rests at 1 m/s^2, gravity is 9.81: is it in g?"),
        (1000 / 9.81, "m/s^2", "is it in mg?"),
        (1.0, "g", "gravity is 1: is it in m/s^2?"),
        (0.55, "m/s^2", "or none: are unit, scale and columns right"),
        (2.0, "m/s^2", "or none: are unit, scale and columns right"),
    ],
)
def test_a_level_at_rest_that_is_no_gravity_is_told_with_the_unit_it_would_be_in(factor, unit, said):
    (told,) = found(factor * AT_REST, unit)
    assert said in told
    assert found(AT_REST, unit, scale=factor) == found(factor * AT_REST, unit)
    assert found(factor * AT_REST, unit, said=("unit: the bag said so",)) == ()


def test_gravity_none_of_it_any_axis_and_units_without_scale_pass_without_a_word():
    turn = np.linspace(0, 1, 4000)[:, None]
    turning = 9.81 * np.hstack([np.sin(turn), np.cos(turn), 0 * turn]) + RNG.normal(size=(4000, 3))
    for acceleration in (AT_REST, turning, AT_REST - AT_REST.mean(axis=0), AT_REST[:, 0]):
        assert found(acceleration) == ()
    for unit in ("counts", "V", "arbitrary"):
        assert found(AT_REST / 9.81, unit) == ()


def test_turn_rates_at_their_rails_are_told():
    turn = np.clip(30_000 * np.sin(np.arange(4000) / 20)[:, None] * [1, 2, 0.1], -32768, 32767)
    (told,) = plausibility_flags({"acceleration": AT_REST, "turn_rate": turn}, FS, "m/s^2")
    assert told.startswith("clipped: ")
    assert "of the turn_rate at full scale" in told


@pytest.mark.parametrize(
    ("scale", "fs", "said"),
    [
        (1e300, FS, r"holds a value of 4e\+300. Expected at most 1e\+30"),
        (1.0, 1e12, r"fs is 1e\+12 Hz. Expected"),
    ],
)
def test_values_and_rates_of_no_sensor_are_refused(tmp_path, scale, fs, said):
    np.savetxt(tmp_path / "r.txt", scale * np.array([1.0, -4.0, 2.0, 3.0]))
    with pytest.raises(RecordingError, match=rf"r\.txt: {said}"):
        load_recording(tmp_path / "r.txt", fs=fs, unit="counts")


def test_folders_that_differ_in_case_and_labels_that_are_sessions_are_told_where_the_folder_is_opened(
    tmp_path,
):
    for session in ("day 1", "day 2"):
        for k, surface in enumerate(("wood", "Wood", "steel")):
            (tmp_path / session / surface).mkdir(parents=True)
            np.savetxt(tmp_path / session / surface / "r.txt", AT_REST[k:, 0] + (session == "day 1"))
    (told,) = open_dataset(tmp_path, fs=FS, unit="m/s^2").notes
    assert told.startswith("the labels are day 1, day 2, and each of these folders holds Wood, steel, wood")
    (told,) = open_dataset(tmp_path / "day 1", fs=FS, unit="m/s^2").notes
    assert told == "surfaces 'Wood' and 'wood' differ in case or blanks only: are they one surface?"
    assert similar_label_notes(["oak", "beech"]) == []
    for usual in (
        ["wood/one/r.txt", "steel/one/r.txt"],
        ["wood/a/r.txt", "steel/b/r.txt"],
        ["a/r.txt", "b/r.txt"],
    ):
        assert folder_level_notes([name.split("/") for name in usual]) == []
    train_and_test = [f"{m}/{part}/r.txt".split("/") for m in "abc" for part in ("test", "train")]
    assert folder_level_notes(train_and_test) == []


def test_g_taken_for_metres_is_said_once_and_loudly_by_every_command_that_reads_a_dataset(
    command, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    for surface in ("wood", "steel"):
        (tmp_path / "felt" / surface).mkdir(parents=True)
        for i in range(3):
            np.savetxt(tmp_path / "felt" / surface / f"{i}.csv", AT_REST / 9.81, delimiter=",")
    told = "felt --fs 1000 --unit m/s^2 --column 1,2,3 --jobs 1 --features coarse -o t.parquet"
    said = "6 of 6 recordings: unit: rests at 1 m/s^2, gravity is 9.81: is it in g?"
    code, out, _ = command("extract", *told.split())
    assert (code, out.count(said)) == (0, 1)
