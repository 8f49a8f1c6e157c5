"""Tests of the statistics and structures of height profiles."""

from dataclasses import replace

import numpy as np
import pytest

from texclass.simulate.profile import (
    N_POINTS,
    ROLL_OFF_MM,
    synthesize_profile,
    tip_response,
    waviness_gain,
)
from texclass.simulate.surfaces import Bumps, Grating, Surface

PLAIN = Surface(
    name="plain",
    category="test",
    rms_um=5.0,
    slope=3.0,
    corner_mm=4.0,
    gratings=(),
    bumps=None,
    stiffness_n_m=2e5,
    dissipation_s_m=5.0,
    static_friction=0.4,
    kinetic_friction=0.3,
)


def lines(surface, n=4, seed=1, **options):
    return synthesize_profile(surface, n, np.random.default_rng(seed), **options)


def spectrum(profile):
    heights, step_m = profile
    power = (np.abs(np.fft.rfft(heights, axis=1)) ** 2).mean(axis=0)
    return np.fft.rfftfreq(heights.shape[1], 1e3 * step_m), power


def test_rms_height_is_the_declared_one_for_structures_wider_than_the_tip():
    frequency, power = spectrum(lines(PLAIN, n=40, drift_mm=50.0))
    power = power / waviness_gain(PLAIN, frequency)
    rms_um = 1e6 * np.sqrt(2.0 * power.sum()) / N_POINTS
    assert rms_um == pytest.approx(5.0, rel=0.05)


@pytest.mark.parametrize("hurst", [0.7, 1.0])
def test_heights_are_self_affine_between_the_corner_and_the_roll_off(hurst):
    surface = replace(PLAIN, corner_mm=0.5, hurst=hurst)
    frequency, power = spectrum(lines(surface, n=60, drift_mm=50.0))
    band = (frequency > 2.0 / ROLL_OFF_MM) & (frequency < 0.5 / surface.corner_mm)
    fitted = np.polyfit(np.log(frequency[band]), np.log(power[band]), 1)[0]
    assert -fitted == pytest.approx(1.0 + 2.0 * hurst, abs=0.2)
    longest = power[(frequency > 0.1 / ROLL_OFF_MM) & (frequency < 0.3 / ROLL_OFF_MM)]
    assert longest.mean() == pytest.approx(power[np.argmin(abs(frequency - 0.5 / ROLL_OFF_MM))], rel=0.5)


@pytest.mark.parametrize("slope", [2.0, 3.0, 4.0])
def test_spectrum_falls_with_the_declared_slope(slope):
    surface = replace(PLAIN, slope=slope)
    frequency, power = spectrum(lines(surface, n=60, drift_mm=50.0))
    power = power / np.maximum(tip_response(surface, frequency), 1e-12) ** 2
    band = (frequency > 1.0) & (frequency < 4.0)
    fitted = np.polyfit(np.log(frequency[band]), np.log(power[band]), 1)[0]
    assert -fitted == pytest.approx(slope, abs=0.12)


@pytest.mark.parametrize(("direction_deg", "expected_mm"), [(0.0, 1.7), (30.0, 1.7 / np.cos(np.pi / 6))])
def test_grating_gives_a_line_at_its_wavelength_seen_along_the_stroke(direction_deg, expected_mm):
    surface = replace(PLAIN, rms_um=0.1, gratings=(Grating(1.7, 20.0),))
    frequency, power = spectrum(lines(surface, direction_deg=direction_deg))
    assert frequency[np.argmax(power)] == pytest.approx(1 / expected_mm, rel=1e-3)


def test_sharper_gratings_have_more_harmonics():
    def harmonics(sharpness):
        surface = replace(PLAIN, rms_um=1e-3, gratings=(Grating(3.0, 20.0, sharpness),))
        frequency, power = spectrum(lines(surface))
        return power[frequency > 0.5].sum() / power.sum()

    assert harmonics(0.0) < 1e-3 < harmonics(0.4) < harmonics(0.8)


def test_neighbouring_lines_share_wide_structures_and_differ_in_fine_ones():
    heights, step_m = lines(PLAIN, n=2, drift_mm=0.3)
    first, second = np.fft.rfft(heights, axis=1)
    frequency = np.fft.rfftfreq(heights.shape[1], 1e3 * step_m)

    def coherence(low, high):
        band = (frequency > low) & (frequency < high)
        cross = np.vdot(second[band], first[band]).real
        return cross / np.linalg.norm(first[band]) / np.linalg.norm(second[band])

    assert coherence(0.02, 0.5) > 0.95
    assert coherence(4.0, 6.0) < 0.4


def test_a_line_is_periodic():
    heights = lines(replace(PLAIN, gratings=(Grating(2.3, 30.0, 0.5, 0.3),)), n=1)[0][0]
    seam = abs(heights[0] - heights[-1])
    assert seam <= 1.5 * np.abs(np.diff(heights)).max()


def test_lines_have_mean_0_and_the_first_one_starts_there():
    heights = lines(PLAIN)[0]
    assert abs(heights[0, 0]) < 0.01 * heights.std()
    np.testing.assert_allclose(heights.mean(axis=1), 0.0, atol=1e-3 * heights.std())


def test_bumps_stand_out_of_the_profile():
    bumpy = replace(PLAIN, rms_um=1.0, bumps=Bumps(0.1, 30.0, 0.6))
    heights = 1e6 * lines(bumpy, n=6)[0]
    skewness = ((heights - heights.mean()) ** 3).mean() / heights.std() ** 3
    assert skewness > 1.0


def test_softer_contacts_smooth_more():
    frequency = np.array([2.0])
    assert tip_response(replace(PLAIN, stiffness_n_m=1e4), frequency) < tip_response(PLAIN, frequency)
