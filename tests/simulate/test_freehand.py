"""Tests of simulated freehand recordings against mechanics and of their true phases."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from texclass.signals import bandpass
from texclass.simulate import Grating, Sensor, Tool, operator_catalogue, record_freehand, surface_catalogue
from texclass.simulate.freehand import generators, mechanics, perform
from texclass.simulate.hand import Gesture

SURFACES = surface_catalogue(12, 1)
OPERATORS = operator_catalogue(5, 1)
PLAIN = replace(SURFACES[0], gratings=(), bumps=None, rms_um=3.0, stiffness_n_m=6e4)


def record(surface=PLAIN, operator=OPERATORS[0], duration_s=5.0, seed=3, **options):
    return record_freehand(surface, operator, duration_s=duration_s, seed=seed, **options)


@pytest.fixture(scope="module")
def recordings():
    return [record(SURFACES[i], OPERATORS[i % 5], 6.0, seed=(7, i)) for i in range(12)]


def vibration(recording):
    """Return the acceleration above 20 Hz, without gravity."""
    sos = signal.butter(4, 20.0, "highpass", fs=recording.fs, output="sos")
    return signal.sosfiltfilt(sos, recording.acceleration, axis=0)


def level(x):
    return float(np.sqrt((x**2).sum(axis=1).mean()))


def test_equal_arguments_give_equal_samples_after_other_recordings():
    first = record()
    record(SURFACES[4], OPERATORS[2], seed=99)
    second = record()
    np.testing.assert_array_equal(first.acceleration, second.acceleration)
    np.testing.assert_array_equal(first.friction, second.friction)
    assert first.phases == second.phases


def test_masses_and_mode_of_the_tool_enter_the_equations_of_motion():
    tool, person = Tool(tip_mass_kg=0.045, mode_mass_kg=0.08, mode_hz=250.0), OPERATORS[0]
    person = replace(person, grip_stiffness_n_m=700.0)
    constants = mechanics(PLAIN, person, tool)
    assert (constants.mass, constants.mode_mass, constants.mode_hz) == (0.045, 0.08, 250.0)
    ratio = constants.damping / (2 * np.sqrt(constants.stiffness * constants.mass))
    assert ratio == pytest.approx(person.grip_damping)
    own, default = record(tool=tool), record()
    np.testing.assert_array_equal(record(tool=Tool()).acceleration, default.acceleration)
    assert abs(np.corrcoef(own.acceleration[-20000:, 2], default.acceleration[-20000:, 2])[0, 1]) < 0.99


def test_another_seed_gives_another_recording():
    a, b = record(seed=(1, 2)).acceleration, record(seed=(2, 1)).acceleration
    assert abs(np.corrcoef(a[-20000:, 2], b[-20000:, 2])[0, 1]) < 0.1


def test_taps_are_in_order_and_end_before_the_next_begins(recordings):
    for recording in recordings:
        taps = recording.phases.taps
        assert 3 <= len(taps) <= 6
        assert all(tap.start < tap.impact for tap in taps)
        ends = [*(tap.start for tap in taps[1:]), recording.phases.onset]
        assert all(tap.end <= following for tap, following in zip(taps, ends, strict=True))


def test_recording_starts_quiet_for_at_least_300_ms(recordings):
    for recording in recordings:
        assert recording.phases.taps[0].start >= 0.3 * recording.fs
        quiet = vibration(recording)[: int(0.25 * recording.fs)]
        assert level(quiet) < 0.15
        assert np.linalg.norm(recording.acceleration[:2000].mean(axis=0)) == pytest.approx(9.8, abs=0.8)


def test_contact_force_and_vibration_begin_at_the_impact(recordings):
    for recording in recordings:
        power = (vibration(recording) ** 2).sum(axis=1)
        for tap in recording.phases.taps:
            assert not recording.normal_force[tap.start : tap.impact].any()
            assert recording.normal_force[tap.impact] > 0
            n = round(0.02 * recording.fs)
            rest = power[tap.impact - n : tap.impact - 20].mean()
            assert power[tap.impact : tap.impact + n].mean() > 5 * rest


def test_onset_is_where_the_tip_starts_to_slide(recordings):
    for recording in recordings:
        begin, end = recording.phases.movement
        assert begin == recording.phases.onset
        assert end == recording.n_samples
        rest = slice(recording.phases.taps[-1].end, begin - round(0.05 * recording.fs))
        assert np.median(recording.speed[rest]) < 2.0
        assert np.median(recording.speed[begin:]) > 20.0


def test_strokes_slow_down_at_their_ends_and_turn_back_and_force_varies():
    recording = record(duration_s=10.0)
    slide = slice(*recording.phases.movement)
    turns = np.flatnonzero(np.diff(np.sign(recording.friction[slide])))
    assert turns.size >= 6
    assert np.median(recording.speed[slide][turns]) < 0.7 * np.median(recording.speed[slide])
    assert np.ptp(recording.friction[slide]) > 2 * abs(recording.friction[slide]).mean()
    assert recording.normal_force[slide].mean() == pytest.approx(OPERATORS[0].force_n, rel=0.5)


@pytest.mark.parametrize("fs", [1000.0, 2000.0, 5000.0, 8000.0, 16000.0, 44100.0, 50000.0])
def test_motion_does_not_depend_on_the_sampling_rate(fs):
    reference, other = record(duration_s=4.0), record(duration_s=4.0, fs=fs)
    assert other.n_samples == round(4.0 * fs)
    assert len(other.phases.taps) == len(reference.phases.taps)
    for ours, theirs in zip(other.phases.taps, reference.phases.taps, strict=True):
        assert ours.impact / fs == pytest.approx(theirs.impact / reference.fs, abs=1.5 / min(fs, 1e4))
    assert other.phases.onset / fs == pytest.approx(reference.phases.onset / reference.fs, abs=2e-3)
    time = np.arange(100, 3900) / 1000
    slow = [
        np.interp(time, np.arange(r.n_samples) / r.fs, signal.sosfiltfilt(
            signal.butter(4, 60.0, fs=r.fs, output="sos"), r.acceleration[:, 2]))
        for r in (reference, other)
    ]  # fmt: skip
    assert np.corrcoef(*slow)[0, 1] > 0.97


def first_contact_s(recording, tap):
    """Return the time from the first contact to the first rebound."""
    return np.argmin(recording.normal_force[tap.impact : tap.end] > 0) / recording.fs


def test_contact_time_falls_with_stiffness_as_in_hertz_theory():
    """Contact time ~ K^-0.4 and K ~ stiffness^1.5: four times as stiff is 4^0.6 = 2.3 times as short."""
    times, loose = [], replace(OPERATORS[0], grip_damping=0.1, tap_speed_mm_s=40.0)
    for stiffness in (4e4, 1.6e5):
        surface = replace(PLAIN, stiffness_n_m=stiffness, dissipation_s_m=0.5, body_mass_kg=100.0)
        recording = record(surface, loose, fs=50_000.0, duration_s=3.0)
        times.append(np.mean([first_contact_s(recording, tap) for tap in recording.phases.taps]))
    assert times[0] / times[1] == pytest.approx(4**0.6, rel=0.12)


def test_dissipation_shortens_the_decay():
    def rebound(dissipation):
        recording = record(replace(PLAIN, dissipation_s_m=dissipation), duration_s=3.0)
        ratios = []
        for tap in recording.phases.taps:
            ring = vibration(recording)[tap.impact : tap.impact + round(0.06 * recording.fs)]
            ratios.append(level(ring[len(ring) // 3 :]) / level(ring[: len(ring) // 3]))
        return np.mean(ratios)

    assert rebound(40.0) < 0.8 * rebound(1.0)


def test_contact_force_at_rest_equals_the_force_of_the_hand():
    """At rest spring, contact and the declared force balance: F = K d^1.5."""
    n = 1200
    force = 0.8
    depth = PLAIN.indentation_m(force) + force / OPERATORS[0].grip_stiffness_n_m
    still = np.zeros(n)
    path = Gesture(np.full(n, -float(depth)), still, still, still)
    flat = replace(PLAIN, rms_um=1e-6, body_mass_kg=1e3)
    recording = perform(path, flat, OPERATORS[0], duration_s=1.0, fs=10_000.0, rngs=generators(1),
                        sensor=Sensor(), recording_id="rest")  # fmt: skip
    assert recording.normal_force[-500:].mean() == pytest.approx(force, rel=1e-3)


def test_friction_voltage_grows_with_the_coefficient():
    voltages = []
    for mu in (0.15, 0.3, 0.6):
        recording = record(replace(PLAIN, kinetic_friction=mu, static_friction=1.2 * mu))
        voltages.append(np.abs(recording.friction[slice(*recording.phases.movement)]).mean())
    assert voltages[0] < 0.75 * voltages[1] < 0.6 * voltages[2]


def test_the_onset_of_sliding_accelerates_the_tool():
    surface = replace(PLAIN, rms_um=0.05, static_friction=0.9, kinetic_friction=0.3)
    recording = record(surface, with_taps=False, duration_s=2.0)
    onset, power = recording.phases.onset, (vibration(recording) ** 2).sum(axis=1)
    assert power[onset : onset + 300].mean() > 5 * power[1000:2500].mean()


def test_acceleration_is_clipped_at_the_range_of_the_sensor():
    hard = replace(PLAIN, stiffness_n_m=2e5)
    recording = record(hard, replace(OPERATORS[0], tap_speed_mm_s=90.0), duration_s=3.0)
    assert np.abs(recording.acceleration).max() == pytest.approx(6 * 9.80665, rel=1e-3)
    assert (np.abs(recording.acceleration) > 58.8).sum() > 3


def test_requested_signal_to_noise_ratio_is_met():
    clean, noisy = (record(snr_db=snr) for snr in (None, 6.0))
    slide = slice(*clean.phases.movement)
    noise = (noisy.acceleration - clean.acceleration)[slide].var()
    signal_power = clean.acceleration[slide].var(axis=0).mean()
    assert 10 * np.log10(signal_power / noise) == pytest.approx(6.0, abs=0.5)
    assert noisy.phases == clean.phases


def test_a_grip_with_more_damping_reduces_the_vibration():
    levels = []
    for damping in (0.3, 1.5):
        recording = record(operator=replace(OPERATORS[0], grip_damping=damping))
        levels.append(level(vibration(recording)[slice(*recording.phases.movement)]))
    assert levels[1] < levels[0]


def test_invalid_duration_and_rate_raise_a_value_error():
    for change, message in (
        ({"duration_s": 2.0}, "at least 3"),
        ({"duration_s": float("nan")}, "at least 3"),
        ({"duration_s": 0.5, "with_taps": False}, "at least 1"),
        ({"fs": 0.0}, "between 1,000 and 50,000"),
        ({"fs": 96_000.0}, "between 1,000 and 50,000"),
    ):
        with pytest.raises(ValueError, match=message):
            record(**change)


def test_vibration_of_a_grating_follows_the_speed_of_freehand_strokes():
    surface = replace(PLAIN, rms_um=0.2, gratings=(Grating(2.0, 12.0),))
    recording = record(surface, duration_s=10.0)
    x = vibration(recording)
    slide = np.arange(*recording.phases.movement)
    fast = recording.speed[slide] > np.percentile(recording.speed[slide], 75)
    slow = recording.speed[slide] < np.percentile(recording.speed[slide], 25)
    assert level(x[slide][fast]) > 2 * level(x[slide][slow])


def test_round_ends_of_strokes_reduce_the_acceleration_at_the_turns():
    smooth = replace(PLAIN, rms_um=0.01)

    def low_frequency_level(roundness):
        recording = record(smooth, replace(OPERATORS[0], roundness=roundness), 8.0, with_taps=False)
        slow = bandpass(recording.acceleration, (10.0, 60.0), recording.fs)
        # Without the break of static friction, and without the filter's end.
        return level(slow[recording.phases.onset + round(recording.fs) : -2000])

    assert low_frequency_level(0.3) < 0.5 * low_frequency_level(0.0)


def test_a_recording_without_a_name_is_named_after_surface_and_operator():
    assert record().recording_id == f"{PLAIN.name} by {OPERATORS[0].name}"
    assert record(recording_id="mine").recording_id == "mine"


@pytest.mark.parametrize("surface", SURFACES[:4], ids=lambda surface: surface.name)
def test_without_taps_the_tip_rests_on_the_surface_from_the_start(surface):
    recording = record_freehand(surface, OPERATORS[0], duration_s=1.0, seed=0, with_taps=False)
    start = recording.normal_force[:100]  # 10 ms
    assert start[0] == pytest.approx(start.mean(), rel=0.3)
    assert start.max() < 2.0 * np.median(recording.normal_force)
