"""Fit of filters and of the level law to scans."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from texclass.haptics.textures.guruswamy2011 import (
    Amplitude,
    LevelLaw,
    estimate_band,
    extract_profile,
    fit_level_law,
)
from texclass.haptics.textures.guruswamy2011.fit import (
    MAX_AMPLITUDE_RATIO,
    MAX_POLES,
    RING_S,
    fit_modes,
    fit_responses,
    fit_sinusoid,
    normalise_acceleration,
    scan_level,
    smooth_path,
)
from texclass.haptics.textures.scan import Scan
from texclass.vibration.decaying_modes import DecayingModes

# Filters, bands and segments --------------------------------------------------------------------------------


FS = 500.0
RING = DecayingModes(*np.array([[30.0, 80.0], [25.0, 60.0], [3.0, 2.0], [-1.5, 0.3]]))


def test_the_modes_of_a_response_are_recovered_with_as_few_poles_as_the_resolution_needs():
    segment = RING.synthesize(80, FS)
    modes = fit_modes(segment, FS, 1e-6)
    assert np.sort(modes.frequency_hz) == pytest.approx([30, 80], rel=1e-6)
    assert np.sort(modes.decay_per_s) == pytest.approx([25, 60], rel=1e-5)
    assert fit_modes(segment, FS, 0.3).n_modes < 2
    assert fit_modes(segment, FS, 10.0).n_modes == 0


def test_any_segment_gives_stable_modes_of_limited_duration_and_order():
    for n in (1, 2, 3, 5, 20, 300):
        modes = fit_modes(np.cumsum(np.random.default_rng(n).standard_normal(n)), FS, 1e-3)
        assert np.all(modes.decay_per_s >= np.log(1000) / RING_S * (1 - 1e-9))
        assert np.sum(1 + (modes.frequency_hz > 0)) <= MAX_POLES
        assert np.all(np.isfinite(modes.synthesize(2000, FS)))


def test_a_decaying_sinusoid_is_recovered():
    t = np.arange(100) / FS
    for sign in (1.0, -1.0):
        segment = sign * 4 * np.exp(-30 * t) * np.sin(2 * np.pi * 22 * t)
        modes = fit_sinusoid(segment, FS)
        assert modes.frequency_hz == pytest.approx([22], rel=1e-2)
        assert modes.decay_per_s == pytest.approx([30], rel=5e-2)
        assert np.abs(modes.synthesize(100, FS) - segment).max() < 0.2


def test_subtracting_tails_makes_the_sum_of_the_filters_equal_the_profile():
    early, late = RING.synthesize(200, FS), RING.synthesize(185, FS)
    x = early.copy()
    x[15:] -= late  # a second response starts before the first has decayed
    bounds = [0, 15, 200]
    assert np.mean(np.abs(fit_responses(x, bounds, FS, 1e-3).sum(200, FS) - x)) < 2e-3


def test_modes_do_not_cancel_each_other():
    rng = np.random.default_rng(8)
    for n in (4, 9, 15, 30) * 6:
        segment = rng.standard_normal(n) * np.exp(-np.arange(n) / 5)
        amplitude = fit_modes(segment, FS, 1e-3).amplitude
        assert amplitude.max() <= MAX_AMPLITUDE_RATIO * np.abs(segment).max()


def impulses(spacing: int = 100, n: int = 40, f: float = 30.0, B: float = 40.0) -> np.ndarray:
    t = np.arange(spacing) / FS
    return np.tile(5 * np.exp(-B * t) * np.sin(2 * np.pi * f * t), n)


def test_the_major_frequency_and_cut_off_of_a_narrow_band_are_estimated():
    rng = np.random.default_rng(0)
    x = np.convolve(rng.standard_normal(20_000), np.sin(2 * np.pi * 60 * np.arange(50) / FS), mode="same")
    band = estimate_band(x, FS)
    assert band.major_hz == pytest.approx(60, abs=2)
    assert 65 < band.upper_hz < 80


def test_every_impulse_is_one_segment_that_starts_at_its_onset_without_delay():
    for f in (25.0, 30.0, 40.0):
        x = impulses(f=f)
        profile = extract_profile(x, FS)
        assert profile.segmentation.n_segments == 40
        assert np.abs(profile.segmentation.bounds[1:-1] - 100 * np.arange(1, 40)).max() <= 5
        lags = np.arange(-8, 9)
        overlap = [np.dot(np.roll(profile.samples, lag), x) for lag in lags]
        assert abs(lags[int(np.argmax(overlap))]) <= 1


def test_the_delay_of_the_filter_is_removed_to_a_fraction_of_a_sample():
    x = 0.3 * impulses(f=20.0) + 2 * impulses(f=112.0, B=150.0)
    samples = extract_profile(x, FS).samples
    fine = [signal.resample(each, 16 * x.size) for each in (samples, x)]
    lags = np.arange(-32, 33)
    overlap = [np.dot(np.roll(fine[0], lag), fine[1]) for lag in lags]
    assert abs(lags[int(np.argmax(overlap))]) <= 1


def test_a_backward_pass_splits_onsets_into_several_segments():
    x = impulses(f=40.0) + impulses(f=100.0, B=200.0)
    causal, zero = (
        extract_profile(x, FS, phase=phase).segmentation.n_segments for phase in ("causal", "zero")
    )
    assert causal == 40
    assert zero > 1.2 * causal


def test_no_upper_cut_off_is_applied_if_the_band_reaches_half_the_rate():
    x = np.random.default_rng(1).standard_normal(4000)
    profile = extract_profile(x, FS, resolution=0.01)
    assert profile.cutoff_hz == FS / 2
    assert np.abs(profile.samples - (x - x.mean()))[1000:].max() < 0.3


def test_drift_is_removed():
    x = impulses()
    drifting = extract_profile(x + 3 * np.sin(2 * np.pi * 0.02 * np.arange(x.size) / FS), FS)
    assert abs(drifting.samples[1000:].mean()) < 0.1


def test_constant_short_and_invalid_signals_are_refused():
    for invalid in (np.zeros(100), np.ones(4), np.full(100, np.nan), np.ones((50, 2))):
        with pytest.raises(ValueError, match="at least 8 samples"):
            extract_profile(invalid, FS)


# Levels -----------------------------------------------------------------------------------------------------


LAW = LevelLaw(k_v=18.5, k_c=0.117, a_0=0.435)


def steady(rms: float, speed: float, force: float, n: int = 2000) -> Scan:
    tone = np.sqrt(2) * rms * np.sin(2 * np.pi * 50 * np.arange(n) / FS)
    return Scan.along_line(tone, speed, force, FS, "tone")


def scans(law: LevelLaw, k: int = 6) -> list[Scan]:
    speeds, forces = np.linspace(10, 80, k), np.array([0.3, 0.9, 0.5, 1.2, 0.4, 0.7])[:k]
    return [steady(float(law.rms(v, f)), v, f) for v, f in zip(speeds, forces, strict=True)]


def test_the_level_law_is_recovered():
    for k_c in (0.117, None):
        fit = fit_level_law(scans(LAW), k_c)
        assert fit.law.k_v == pytest.approx(18.5, rel=1e-3)
        assert fit.law.k_c == pytest.approx(0.117, rel=2e-2)
        assert fit.law.a_0 == pytest.approx(0.435, rel=2e-3)
        assert fit.r_squared > 0.9999
    assert LAW.rms(21.6, 0.443) == pytest.approx(18.5 * 0.0216 + 0.117 * 0.443 + 0.435)


def test_relative_deviations_are_minimised():
    gains = 1 + 0.1 * (-1.0) ** np.arange(6)
    scattered = [
        replace(scan, acceleration=g * scan.acceleration) for g, scan in zip(gains, scans(LAW), strict=True)
    ]
    fit = fit_level_law(scattered, 0.117)
    level = fit.law.rms(fit.speed, fit.force)
    weighted = (fit.rms - level) / level**2  # the normal equations
    for column in (fit.speed, np.ones(6)):
        assert abs(weighted @ column) < 1e-3 * np.abs(weighted) @ column


def test_a_linear_drift_is_not_part_of_the_level():
    scan = steady(1.0, 20.0, 0.5)
    drifting = Scan.along_line(scan.acceleration + np.linspace(0, 5, len(scan)), 20.0, 0.5, FS)
    assert scan_level(drifting)[2] == pytest.approx(1.0, rel=1e-3)


def test_factors_are_never_negative():
    falling = [steady(rms, v, 0.5) for rms, v in ((2.0, 10.0), (1.0, 40.0), (0.5, 80.0))]
    law = fit_level_law(falling, 0.0).law
    assert law.k_v == 0
    assert law.a_0 > 0


def test_scans_of_one_speed_and_invalid_factors_are_refused():
    with pytest.raises(ValueError, match="differ in speed"):
        fit_level_law([steady(1.0, 20.0, 0.5)] * 3, 0.1)
    for values in ((-1, 0, 1), (0, 0, 0), (np.nan, 0, 1)):
        with pytest.raises(ValueError, match="must be finite"):
            LevelLaw(*values)


def test_the_amplitude_is_the_limited_ratio_of_levels_and_compensation_divides_by_the_root_of_speed():
    printed, ours = (Amplitude(LAW, 20.0, 0.4, compensated=c).factor(80.0, 0.4) for c in (False, True))
    assert printed == pytest.approx(LAW.rms(80, 0.4) / LAW.rms(20, 0.4))
    assert ours == pytest.approx(printed / 2)
    slow = [Amplitude(LAW, 20.0, 0.4, compensated=c).factor(5.0, 0.4) for c in (False, True)]
    assert slow[0] == slow[1]
    assert Amplitude(LAW, 21.6, 0.443).factor(21.6, 0.443) == pytest.approx(1.0)
    assert Amplitude(LAW, 20.0, 0.4, compensated=False).factor(1e8, 1e8) == 4.0


def test_normalisation_removes_the_effect_of_speed_and_force():
    n = 4000
    force = 0.5 + 0.2 * np.sin(2 * np.pi * 0.5 * np.arange(n) / FS)
    law = LevelLaw(0.0, 1.0, 0.1)
    tone = np.sin(2 * np.pi * 60 * np.arange(n) / FS)
    scan = Scan.along_line(tone * law.rms(20.0, force) / law.rms(20.0, 0.5), 20.0, force, FS)
    result = normalise_acceleration(scan, Amplitude(law, 20.0, 0.5))
    assert np.abs(result - tone)[200:-200].max() < 0.01


def test_the_smoothed_path_has_no_frequencies_above_hand_motion():
    scan = Scan.along_line(np.zeros(2000), 20.0, 1 + np.sin(2 * np.pi * 100 * np.arange(2000) / FS), FS)
    _, force = smooth_path(scan)
    assert np.abs(force - 1)[100:-100].max() < 0.01
