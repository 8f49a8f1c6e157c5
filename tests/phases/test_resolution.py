"""Signals with too few distinct values are detected, and usual signals are not."""

import numpy as np
import pandas as pd
import pytest
import soundfile
from scipy.signal import lfilter

import texclass as tx
from texclass.haptics import scale_values
from texclass.loaders import load_recording
from texclass.phases import find_phases, resolution_problem

FS = 2000.0
NOISE = np.random.default_rng(11).standard_normal(8000)
SMOOTH = lfilter([1.0], [1.0, -1.6, 0.8], NOISE)
SMOOTH /= SMOOTH.std()


@pytest.mark.parametrize("signal", [NOISE, SMOOTH], ids=["white", "resonant"])
@pytest.mark.parametrize("offset", [0.0, 0.5, 1e6])
def test_a_deviation_below_one_step_is_detected_at_any_gain_and_offset(signal, offset):
    for n_steps in (0.2, 0.5, 0.8):
        assert resolution_problem(0.01 * (np.rint(n_steps * signal) + offset), FS).startswith("few levels")
    for n_steps in (1.1, 2.0, 40.0):
        assert resolution_problem(0.01 * (np.rint(n_steps * signal) + offset), FS) == ""


def test_the_message_states_levels_and_deviation():
    problem = resolution_problem(np.rint(NOISE).clip(-1, 1), FS)
    deviation = np.rint(NOISE).clip(-1, 1).std()
    assert f"3 distinct values, with a deviation of {deviation:.2g} quantisation steps" in problem
    assert "Expected at least 7 values and 1 step" in problem


@pytest.mark.parametrize(
    "signal",
    [
        NOISE,  # not quantised: no value occurs twice
        np.concatenate([np.zeros(9000), NOISE]),  # digital silence before a fine signal
        np.float32(SMOOTH),
        np.rint(9000 * np.sin(np.arange(8000) / 3000)),  # slow, in steps of one
        np.rint(3 * np.sin(np.arange(8000) / 7) + 0.7 * NOISE),
        np.rint(NOISE[:49] * 0.4),  # too short
        np.full(8000, 3.0),  # constant: other messages explain it
    ],
)
def test_usual_signals_are_not_flagged(signal):
    assert resolution_problem(signal, FS) == ""


def test_the_vibration_counts_and_not_a_slow_drift_over_many_levels():
    drift = 40 * np.sin(np.arange(8000) / 4000)
    assert resolution_problem(np.rint(drift + 0.2 * NOISE), FS).startswith("few levels")
    assert resolution_problem(np.rint(drift + 2.0 * NOISE), FS) == ""


def test_a_rare_value_between_two_levels_does_not_hide_the_step():
    coarse = np.rint(0.5 * NOISE)
    coarse[100] += 0.01
    assert resolution_problem(coarse, FS).startswith("few levels")


def test_one_fine_axis_suffices_and_constant_axes_do_not_count():
    coarse, fine = np.rint(0.4 * NOISE), np.rint(30 * NOISE)
    assert resolution_problem(np.column_stack([coarse, fine, coarse]), FS) == ""
    assert resolution_problem(np.column_stack([coarse, 0 * fine]), FS).startswith("few levels")


def test_every_reader_flags_a_coarse_recording_and_not_a_fine_one(tmp_path):
    for n_steps, is_flagged in ((0.4, True), (20.0, False)):
        codes = np.rint(n_steps * SMOOTH).clip(-127, 127)
        soundfile.write(tmp_path / "r.wav", codes / 128, int(FS), subtype="PCM_U8")
        soundfile.write(tmp_path / "r.flac", codes / 128, int(FS), subtype="PCM_S8")
        np.save(tmp_path / "r.npy", 0.02 * codes)
        np.savetxt(tmp_path / "r.txt", 0.02 * codes, fmt="%.2f")
        pd.DataFrame({"time": np.arange(codes.size) / FS, "a": 9.81 + 0.1 * codes}).to_csv(
            tmp_path / "r.csv", index=False
        )
        for name, options in {
            "r.wav": {}, "r.flac": {}, "r.npy": {"fs": FS}, "r.txt": {"fs": FS}, "r.csv": {"column": "a"},
        }.items():  # fmt: skip
            flags = load_recording(tmp_path / name, unit="arbitrary", **options).flags
            assert any(flag.startswith("few levels") for flag in flags) == is_flagged, (name, flags)


def test_features_of_coarse_recordings_come_with_a_notice(tmp_path, command):
    for surface in ("oak", "slate"):
        (tmp_path / "set" / surface).mkdir(parents=True)
        for i in range(2):
            codes = np.rint((0.4 if surface == "oak" else 20) * np.roll(SMOOTH, 99 * i))
            soundfile.write(tmp_path / "set" / surface / f"{i}.wav", codes / 128, int(FS), subtype="PCM_U8")
    code, out, err = command("extract", tmp_path / "set", "--unit", "counts", "-o", tmp_path / "out.csv")
    assert code == 0, err
    assert "2 of 4 recordings: few levels: " in out + err


def test_at_two_steps_the_levels_of_simulated_surfaces_are_those_of_the_fine_signal():
    operator = tx.simulate.operator_catalogue(1, seed=71)[0]
    changes = []
    for surface in tx.simulate.surface_catalogue(4, seed=71):
        recording = tx.simulate.record_freehand(surface, operator, duration_s=4.0, seed=1)
        phases = find_phases(recording)
        step = recording.acceleration[slice(*phases.movement)].std(axis=0).max() / 2
        coarse = step * np.rint(recording.acceleration / step)
        pair = [recording.with_(phases=phases), recording.with_(phases=phases, acceleration=coarse)]
        values = [scale_values(tx.extract([one], "scales")).iloc[0] for one in pair]
        changes.append(values[1] - values[0])
    assert np.abs([change["rough"] for change in changes]).max() < 0.5
