"""The controlled runs change one condition and show what that does to the signal."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from texclass.simulate import (
    Grating,
    operator_catalogue,
    record_rising_force,
    record_rising_speed,
    record_rising_taps,
    surface_catalogue,
)

OPERATOR = replace(operator_catalogue(1, 1)[0], direction_deg=0.0)
ROUGH = replace(surface_catalogue(1, 1)[0], gratings=(), bumps=None, rms_um=2.0, stiffness_n_m=6e4)
RIBBED = replace(ROUGH, rms_um=0.1, gratings=(Grating(wavelength_mm=2.0, depth_um=8.0),))


def peak_hz(recording, low=15.0):
    frequency, power = signal.welch(recording.acceleration[5000:, 2], recording.fs, nperseg=20_000)
    power[frequency < low] = 0.0
    return frequency[np.argmax(power)]


@pytest.mark.parametrize("speed", [60.0, 120.0, 200.0])
def test_grating_gives_a_line_at_speed_over_wavelength(speed):
    recording = record_rising_speed(RIBBED, OPERATOR, duration_s=5.0, seed=1, speed_mm_s=(speed, speed))
    assert peak_hz(recording) == pytest.approx(speed / 2.0, abs=1.0)


def test_rising_speed_rises_and_moves_the_spectrum_up():
    recording = record_rising_speed(ROUGH, OPERATOR, duration_s=8.0, seed=2, speed_mm_s=(20.0, 200.0))
    seconds = recording.speed[: 8 * 10_000].reshape(8, -1).mean(axis=1)
    assert (np.diff(seconds) > 10.0).all()
    assert recording.speed[-2000:].mean() == pytest.approx(200.0, rel=0.05)
    early, late = recording.acceleration[5000:25000, 2], recording.acceleration[60000:, 2]
    share = []
    for part in (early, late):
        frequency, power = signal.welch(part, recording.fs, nperseg=4096)
        share.append(power[(frequency > 150)].sum() / power[frequency > 15].sum())
    assert share[1] > share[0]
    assert late.std() > 2 * early.std()


def test_rising_force_rises_at_constant_speed_and_raises_the_contact_resonance():
    recording = record_rising_force(ROUGH, OPERATOR, duration_s=8.0, seed=3, force_n=(0.3, 3.0))
    assert recording.normal_force[6000:9000].mean() < 0.6
    assert recording.normal_force[-5000:].mean() == pytest.approx(3.0, rel=0.15)
    assert recording.speed[6000:].reshape(-1, 2000).mean(axis=1).std() < 10.0
    parts = recording.acceleration[5000:25000, 2], recording.acceleration[-20000:, 2]
    centroids = []
    for part in parts:
        frequency, power = signal.welch(part, recording.fs, nperseg=4096)
        band = (frequency > 100) & (frequency < 1500)
        centroids.append((frequency * power)[band].sum() / power[band].sum())
    assert centroids[1] > centroids[0]


def test_level_rises_with_force():
    levels = []
    for force in (0.4, 1.6):
        recording = record_rising_force(ROUGH, OPERATOR, duration_s=4.0, seed=4, force_n=(force, force))
        levels.append(recording.acceleration[5000:].std(axis=0).mean())
    assert levels[1] > 1.1 * levels[0]


def test_rising_taps_hit_harder_and_harder():
    soft = replace(ROUGH, stiffness_n_m=8e3)
    recording = record_rising_taps(soft, OPERATOR, n_taps=6, seed=5)
    assert recording.phases.kind == "taps only"
    peaks = [recording.normal_force[tap.impact : tap.end].max() for tap in recording.phases.taps]
    assert len(peaks) == 6
    assert (np.diff(peaks) > 0).all()


def test_controlled_runs_repeat_by_seed():
    a, b = (record_rising_taps(ROUGH, OPERATOR, n_taps=3, seed=6) for _ in range(2))
    np.testing.assert_array_equal(a.acceleration, b.acceleration)


@pytest.mark.parametrize("fs", [1000.0, 10_000.0, 50_000.0])
def test_controlled_runs_take_any_rate(fs):
    recording = record_rising_speed(RIBBED, OPERATOR, duration_s=3.0, seed=1, fs=fs, speed_mm_s=(80.0, 80.0))
    assert recording.n_samples == round(3.0 * fs)
    assert recording.speed[recording.n_samples // 2 :].mean() == pytest.approx(80.0, rel=0.02)


def test_impossible_taps_are_refused():
    for wrong in ({"n_taps": 0}, {"tap_speed_mm_s": (0.0, 10.0)}):
        with pytest.raises(ValueError, match="at least one, above 0"):
            record_rising_taps(ROUGH, OPERATOR, seed=1, **wrong)
