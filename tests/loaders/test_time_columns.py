"""Columns of time stamps: which column, in which unit, and what its samples become."""

import os
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from texclass.evaluation.feature_table import extract_table
from texclass.features import load_feature_set
from texclass.loaders import load_recording
from texclass.loaders.cards import CardError
from texclass.loaders.open import open_dataset
from texclass.recording import RecordingError

N = 1000
VALUES = np.round(np.random.default_rng(0).normal(size=N), 3)


def write(path, cells, values=VALUES, name="time"):
    """Write a table of a time column and an acceleration."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = (f"{cell},{value:.6g}" for cell, value in zip(cells, values, strict=True))
    path.write_text("\n".join([f"{name},a", *rows]))
    return path


def loaded(path, **options):
    return load_recording(path, unit="counts", **options)


def numbers(times):
    return [f"{time:.12g}" if abs(time) < 1e9 else f"{time:.0f}" for time in times]


EPOCH = 1_700_000_000
DATES = np.datetime64("2019-08-06T14:15:18.503", "ms") + np.arange(N) * np.timedelta64(10, "ms")
TEXTS = [str(date).replace("T", " ") for date in DATES]


@pytest.mark.parametrize(
    ("cells", "name", "unit"),
    [
        (numbers(np.arange(N) / 100), "time", "s"),
        (numbers(10.0 * np.arange(N)), "t", "ms"),
        (numbers(10_000.0 * np.arange(N)), "time", "us"),
        (numbers(1e7 * np.arange(N)), "timestamp", "ns"),
        (numbers(EPOCH * 1000 + 10.0 * np.arange(N)), "timestamp", "ms"),
        ([f"{EPOCH + k / 100:.2f}" for k in range(N)], "timestamp", "s"),
        ([f"{45_000.59 + k / 8.64e6:.10f}" for k in range(N)], "time", "days"),
        ([f"{738_000.59 + k / 8.64e6:.10f}" for k in range(N)], "time", "days"),
    ],
)
def test_the_unit_of_time_stamps_follows_from_their_range_and_step(tmp_path, cells, name, unit):
    recording = loaded(write(tmp_path / "r.csv", cells, name=name))
    assert recording.fs == 100
    np.testing.assert_allclose(recording.acceleration, VALUES, atol=0.05)
    notice = f"time: unit of column {name!r} is {unit}, inferred from range and step (--time-unit)"
    assert (notice in recording.flags) == (unit != "s")
    recording_with_unit = loaded(tmp_path / "r.csv", time_unit=unit)
    assert recording_with_unit.fs == 100
    assert not any("inferred" in flag for flag in recording_with_unit.flags)


@pytest.mark.parametrize(
    "cells",
    [
        [text[:-4] + ":" + text[-3:] for text in TEXTS],
        [text.replace("-", "/") for text in TEXTS],
        [f"{text[8:10]}.{text[5:7]}.{text[:4]} {text[11:]}" for text in TEXTS],
        [f"{text[5:7]}/{text[8:10]}/{text[:4]} {int(text[11:13]) % 12}{text[13:]} PM" for text in TEXTS],
        [text[11:] for text in TEXTS],
    ],
)
def test_dates_and_times_of_day_as_loggers_write_them_give_the_rate(tmp_path, cells):
    recording = loaded(write(tmp_path / "r.csv", cells, name="timestamp"))
    assert recording.fs == 100
    np.testing.assert_array_equal(recording.acceleration, VALUES)


def test_times_of_day_pass_midnight(tmp_path):
    texts = [str(np.datetime64("2019-08-06T23:59:55") + np.timedelta64(10 * k, "ms"))[11:] for k in range(N)]
    assert len(loaded(write(tmp_path / "r.csv", texts)).acceleration) == N


def test_several_plausible_units_are_refused_and_the_message_names_the_option(tmp_path):
    path = write(tmp_path / "r.csv", numbers(np.arange(N) / 10))
    with pytest.raises(RecordingError, match=r"10 Hz if in s or 10000 Hz if in ms.*--time-unit"):
        loaded(path)
    assert loaded(path, time_unit="ms").fs == 10_000
    assert loaded(path, time_unit="s").fs == 10
    assert loaded(path, fs=10_000).fs == 10_000
    with pytest.raises(RecordingError, match=r"unknown time unit 'weeks'\. Expected one of s, ms, us"):
        loaded(path, time_unit="weeks")


def test_a_name_that_contradicts_the_step_is_refused(tmp_path):
    path = write(tmp_path / "r.csv", numbers(np.arange(N) / 100), name="time_ms")
    with pytest.raises(RecordingError, match=r"100000 Hz if in ms or 100 Hz if in s.*--time-unit"):
        loaded(path)
    with pytest.raises(RecordingError, match=r"100000 Hz if in ms or 100 Hz if in s.*100 Hz was given"):
        loaded(path, fs=100)
    assert loaded(path, time_unit="s").fs == 100
    assert loaded(path, time_unit="ms").fs == loaded(path, fs=100_000).fs == 100_000


def test_a_column_that_is_named_like_time_but_is_no_time_is_ignored_and_reported(tmp_path):
    path = tmp_path / "r.csv"
    rows = "\n".join(f"{np.sin(i):.4f},{i % 7} o'clock" for i in range(200))
    path.write_text(f"x,time\n{rows}\n")
    recording = load_recording(path, fs=100, unit="g")
    (flag,) = recording.flags
    assert flag == "time: column 'time' is ignored, some rows contain no number or date"


def test_a_time_column_of_another_length_is_ignored_and_reported_or_refused(tmp_path):
    path = tmp_path / "r.npz"
    x = np.sin(np.arange(300.0))
    np.savez(path, x=x, time=np.arange(200) / 100)
    recording = load_recording(path, fs=100, unit="g", column="x")
    assert "time: column 'time' is ignored, its length differs from the signals" in recording.flags
    with pytest.raises(RecordingError, match=r"'time' has 200 values, a signal has 300.*--time-column none"):
        load_recording(path, fs=100, unit="g", column="x", time_column="time")


def test_a_column_that_is_named_like_time_but_does_not_increase_is_ignored_and_reported(tmp_path):
    temperature = 23 + np.round(np.random.default_rng(1).normal(size=N).cumsum() * 0.01, 2)
    path = write(tmp_path / "r.csv", numbers(temperature), name="T")
    recording = loaded(path, fs=1000)
    np.testing.assert_array_equal(recording.acceleration, VALUES)
    assert recording.flags == ("time: column 'T' is ignored, it does not increase like time stamps",)
    with pytest.raises(RecordingError, match=r"fs is missing.*--time-column"):
        loaded(path)


def test_no_time_column_leaves_time_stamps_unread(tmp_path):
    path = write(tmp_path / "mine" / "oak" / "r.csv", numbers(np.arange(N) / 100))
    with pytest.raises(
        RecordingError, match="fs is 100 Hz according to its column 'time', but 1000 Hz was given"
    ):
        loaded(path, fs=1000)
    for recording in (
        loaded(path, fs=1000, time_column="none"),
        open_dataset(tmp_path / "mine", fs=1000, unit="counts", time_column="none")[0],
        open_dataset(card(tmp_path, 'time_column = "none"'))[0],
    ):
        assert recording.fs == 1000
        np.testing.assert_array_equal(recording.acceleration, VALUES)
    assert open_dataset(card(tmp_path, 'time_unit = "us"', 1e8))[0].fs == 1e8
    with pytest.raises(CardError, match="time_unit"):
        open_dataset(card(tmp_path, 'time_unit = "weeks"'))


def card(folder, line, fs_hz=1000):
    path = folder / "card.toml"
    path.write_text(
        f"""title = "t"\nformat = "files"\nfolder = "mine"\nfs_hz = {fs_hz}\nunit = "counts"
phases = "movement"\nfiles = '(?P<surface>[^/]+)/.+[.]csv'\n{line}\n[channels]\nacceleration = "a"\n"""
    )
    return path


def test_lost_rows_are_filled_in_and_reported_whether_the_rate_is_given_or_not(tmp_path):
    t = np.arange(2000) / 1000
    rows = np.flatnonzero(np.arange(2000) % 10 != 5)
    tone = np.sin(2 * np.pi * 30 * t)
    path = write(tmp_path / "r.csv", numbers(t[rows]), tone[rows])
    for options in ({}, {"fs": 1000}):
        recording = loaded(path, **options)
        assert recording.fs == 1000
        np.testing.assert_allclose(recording.acceleration, tone, atol=0.02)
        assert recording.flags[0] == "gaps: 200 messages missing in 200 gaps, interpolated"


def test_a_long_pause_divides_the_recording_although_the_rate_is_given(tmp_path):
    t = np.arange(N) / 100 + 3.0 * (np.arange(N) >= 400)
    recording = loaded(write(tmp_path / "r.csv", numbers(t)), fs=100)
    np.testing.assert_array_equal(recording.acceleration, VALUES[400:])
    assert recording.flags[0].startswith("divided: 1 gaps of up to 3 s")


def test_rows_in_bursts_have_one_rate_whether_it_is_given_or_not(tmp_path):
    t = np.arange(N) // 10 * 0.11 + np.arange(N) % 10 * 60e-6
    path = write(tmp_path / "r.csv", numbers(t + 0.6 * (np.arange(N) >= 500)))
    assert loaded(path).fs == pytest.approx(90.9, rel=0.01)
    assert loaded(path, fs=91).fs == 91


@pytest.mark.parametrize(
    ("fs", "tick"), [(2000, 1e-3), (100, 1.0), (1500, 1e-3), (250, 0.015625), (100.4, 1.0)]
)
@pytest.mark.parametrize("begin_s", [0.0, 0.37])
def test_several_samples_per_tick_of_a_coarse_clock_are_evenly_spaced(tmp_path, fs, tick, begin_s):
    n = int(12 * fs)
    rng = np.random.default_rng(2)
    values = np.round(rng.normal(size=n) * (rng.random(n) < 0.2), 1)  # quantised, and mostly at rest
    t = np.floor((begin_s + np.arange(n) / fs) / tick + 1e-9) * tick
    path = write(tmp_path / "r.csv", numbers(t), values)
    for options in ({}, {"fs": fs}):
        recording = loaded(path, time_unit="s", **options)
        assert recording.fs == pytest.approx(fs, rel=2e-3)
        assert len(recording.acceleration) == pytest.approx(n, rel=2e-3)
        if recording.fs == fs:
            np.testing.assert_array_equal(recording.acceleration, values)


def test_rows_that_were_written_twice_are_dropped(tmp_path):
    order = np.repeat(np.arange(N), 2)
    recording = loaded(write(tmp_path / "r.csv", numbers(order / 100), VALUES[order]))
    np.testing.assert_array_equal(recording.acceleration, VALUES)
    assert recording.flags[0].startswith("duplicates: 1000 messages")


def test_a_folder_with_two_rates_names_the_file_that_the_first_one_is_from(tmp_path):
    for surface, fs in (("oak", 100), ("slate", 300)):
        write(tmp_path / surface / "r.csv", numbers(np.arange(N) / fs))
    dataset = open_dataset(tmp_path, unit="counts")
    assert dataset[0].fs == 100
    with pytest.raises(RecordingError, match=r"fs is 300 Hz according.*100 Hz in .*oak/r.csv.*resample all"):
        dataset[1]


def merged_log(path, n_decimals, seed=0):
    """Write an IMU of 100 Hz whose rows repeat between those of a motor, at 40 Hz."""
    rng = np.random.default_rng(seed)
    imu_s, motor_s = np.arange(N) / 100 + rng.uniform(0, 1e-4, N), 0.003 + np.arange(400) / 40
    t = np.sort(np.concatenate((imu_s, motor_s)))
    values = np.round(rng.normal(size=N), n_decimals)
    latest = values[np.searchsorted(imu_s, t, side="right").clip(1) - 1]
    return values, write(path, [f"{time:.7f}" for time in t], latest)


@pytest.mark.parametrize("options", [{}, {"fs": 100}])
def test_rows_of_other_sensors_in_a_merged_log_are_left_out_and_reported(tmp_path, options):
    values, path = merged_log(tmp_path / "r.csv", 6)
    recording = loaded(path, **options)
    assert recording.fs == 100
    np.testing.assert_allclose(recording.acceleration, values, atol=0.1)
    assert recording.flags[0] == "merged log: 29% of the rows repeat all values of the previous row, dropped"


def test_a_quantised_sensor_at_rest_keeps_its_repeated_rows(tmp_path):
    path = write(tmp_path / "r.csv", numbers(np.arange(N) / 100), np.round(0.6 * VALUES))
    np.testing.assert_allclose(loaded(path).acceleration, np.round(0.6 * VALUES))


def test_a_log_with_most_samples_missing_names_the_way_out(tmp_path):
    t = np.cumsum(np.where(np.arange(N) % 3 == 2, 0.05, 0.01))
    path = write(tmp_path / "r.csv", numbers(t))
    with pytest.raises(RecordingError, match=r"according to its time stamps.*--time-column none"):
        loaded(path, fs=100)


def test_a_merged_log_of_a_robot_is_read_at_the_rate_of_its_inertial_unit():
    folder = Path(os.environ.get("TEXCLASS_DATA", "")) / "floors10_raw"
    if not (folder / "artificial_grass_01.csv").is_file():
        pytest.skip("recordings of floors10_raw are not here")
    for path in sorted(folder.glob("*.csv")):
        columns = [f"linear_acceleration.{axis}" for axis in "xyz"]
        recording = load_recording(path, unit="m/s^2", column=columns, fs=100)
        assert recording.duration_s > 30
        assert recording.flags[0].startswith("merged log: ")
        assert load_recording(path, unit="m/s^2", column=columns).fs == pytest.approx(100, rel=0.03)


def test_recordings_that_were_resampled_up_are_reported_before_any_table(tmp_path):
    for surface, fs in (("oak", 1000), ("slate", 300)):
        for k in range(2):
            write(tmp_path / surface / f"r{k}.csv", numbers(np.arange(N) / fs))
    dataset = open_dataset(tmp_path, unit="counts", resample=1000)
    table = extract_table(dataset, load_feature_set("coarse"), tmp_path / "t.npz")
    assert table.notices == (
        "2 of 4 recordings: narrow band: sampled at 300 Hz, so no content above 150 Hz (the first: slate/r0)",
    )


def test_a_stored_rate_that_contradicts_the_time_stamps_is_refused(tmp_path):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"acc": VALUES, "t": np.arange(N) / 100, "Fs": 1000.0})
    with pytest.raises(RecordingError, match=r"'t' contradicts its sampling rate, 1000 Hz.*column t to"):
        loaded(path, column="acc")
    assert loaded(path, column="acc", time_column="t").fs == pytest.approx(100)
    assert loaded(path, column="acc", time_column="none").fs == 1000


def test_time_stamps_of_another_struct_are_not_used(tmp_path):
    path = tmp_path / "a.mat"
    logs = {name: {"t": step * np.arange(N), "acc": VALUES} for name, step in (("a", 0.01), ("b", 0.001))}
    scipy.io.savemat(path, logs)
    assert loaded(path, column="a.acc").fs == pytest.approx(100)
    assert loaded(path, column="b.acc").fs == pytest.approx(1000)
    scipy.io.savemat(path, {"a": logs["a"], "b": {"acc": VALUES}})
    with pytest.raises(RecordingError, match="fs is missing"):
        loaded(path, column="b.acc")
    assert loaded(path, column="b.acc", time_column="a.t").fs == pytest.approx(100)


def test_columns_of_different_length_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, u=VALUES, v=VALUES[:-1])
    with pytest.raises(
        RecordingError, match=r"a\.npz: its columns differ in length: 'u' has 1000, 'v' has 999"
    ):
        loaded(path, column=("u", "v"), fs=100)
