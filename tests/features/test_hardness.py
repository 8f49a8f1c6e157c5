"""Taps: hardness and damping as printed and corrected, decay and modes; friction."""

import numpy as np
import pytest
from scipy import fft
from scipy.signal import find_peaks

from texclass.features import hardness as h
from texclass.features.contract import UndefinedFeatureError
from texclass.features.friction import friction
from texclass.features.phase_view import PhaseView, TapSignal, TapView
from texclass.features.tap_modes import decimated, tap_amplitude_slope, tap_mode_decay, tap_mode_frequency
from texclass.vibration import DecayingModes

FS = 10_000.0
HAND = 0.1 * np.sin(np.linspace(0, np.pi, 400))


def bounces(*at, n=1000):
    """Return impulses of decreasing height, each 5 samples wide."""
    i = np.zeros(n)
    for height, start in zip((1.0, 0.6, 0.4, 0.2), at, strict=False):
        i[start : start + 5] += height * np.array([0.2, 0.7, 1.0, 0.7, 0.2])
    return i


def one(hand, impulse, fs=FS, noise=0.0):
    return TapView((TapSignal(np.asarray(hand, dtype=float), np.asarray(impulse, dtype=float)),), fs, noise)


def ringing(decay, f_hz, fs=FS):
    t = np.arange(round(0.3 * fs)) / fs
    return one([], np.exp(-decay * t) * np.sin(2 * np.pi * f_hz * t), fs)


def test_hardness_as_printed_equals_equation_1():
    n_mean = ((10 + 2) + (250 + 2) + (600 + 2)) / 3 + 1
    expected = 1.0 / n_mean / sum(abs(x) for x in HAND)
    assert h.hardness_as_printed(one(HAND, bounces(10, 250, 600))) == pytest.approx(expected)


def test_impulse_peaks_are_the_three_highest_prominent_peaks():
    rng = np.random.default_rng(0)
    for spacing, prominence in ((1, 0.0), (7, 0.05), (30, 0.3)):
        taps, expected = [np.zeros(40), np.zeros(0)], list[list[int]]([[], []])
        for _ in range(50):
            i = np.abs(rng.standard_normal(300) * np.exp(-np.arange(300) / 100))
            padded = np.pad(i, 1)
            threshold = prominence * i.max()
            peaks, _ = find_peaks(padded, height=threshold, distance=spacing, prominence=threshold)
            highest = sorted(peaks, key=lambda k: -padded[k])[:3]
            taps.append(i)
            expected.append(sorted(k - 1 for k in highest))
        assert h.impulse_peaks(taps, spacing, prominence) == expected


def test_only_printed_hardness_depends_on_the_square_of_the_sampling_rate():
    def at(fs):
        t = np.arange(round(0.1 * fs)) / fs
        return one(np.sin(np.pi * t / 0.1), np.exp(-80 * t) * np.sin(2 * np.pi * 250 * t), fs)

    slow, fast = at(10_000.0), at(40_000.0)
    printed = h.hardness_as_printed(fast, spacing=400)
    assert printed == pytest.approx(h.hardness_as_printed(slow) / 16, rel=0.05)
    assert h.hardness(fast) == pytest.approx(h.hardness(slow), rel=0.02)


def test_corrected_hardness_is_impact_over_time_and_velocity_above_the_noise():
    t, v = 13 / FS, np.abs(HAND).sum() / FS
    clean = h.hardness(one(HAND, bounces(10)))
    assert clean == pytest.approx(1.0 / (t * v))
    hand = np.append(np.zeros(4000), HAND) + 0.01 * np.random.default_rng(0).standard_normal(4400)
    assert h.hardness(one(hand, bounces(10), noise=0.01)) == pytest.approx(clean, rel=0.05)
    assert h.hardness(one(hand, bounces(10))) < 0.7 * clean  # what the noise would cost otherwise
    for function in (h.hardness, h.hardness_as_printed):
        with pytest.raises(UndefinedFeatureError, match="the hand does not accelerate before the contact"):
            function(one([], bounces(10)))


def test_damping_as_printed_equals_equation_2():
    i, k = bounces(10, 250), np.arange(1, 2049)
    energy = fft.dct(np.append(i, np.zeros(4096 - i.size)))[1:2049] ** 2
    assert h.damping_as_printed(one(HAND, i)) == pytest.approx(k @ energy / energy.sum())


def test_a_silent_or_unusual_tap_does_not_change_mean_or_median():
    good, silent = TapSignal(HAND, ringing(60, 400).taps[0].impulse), TapSignal(HAND, np.zeros(100))
    odd = TapSignal(7 * HAND, ringing(500, 3000).taps[0].impulse)
    alone, other = TapView((good,), FS), TapView((odd,), FS)
    medians = h.hardness, h.damping, h.tap_band, h.tap_course, h.tap_decay_rate, h.tap_strength, h.tap_crest
    for median in medians:
        assert np.all(median(alone) != median(other))
        np.testing.assert_array_equal(median(TapView((good, odd, good), FS)), median(alone))
    for mean in (h.hardness_as_printed, h.damping_as_printed):
        assert mean(TapView((good, silent, good), FS)) == pytest.approx(mean(alone))
        expected = (2 * mean(alone) + mean(other)) / 3
        assert mean(TapView((good, odd, good), FS)) == pytest.approx(expected)


def test_features_of_a_decaying_sinusoid_match_its_parameters():
    for decay in (30.0, 60.0, 200.0):
        assert h.tap_decay_rate(ringing(decay, 400.0)) == pytest.approx(decay, rel=0.05)
    assert h.damping(ringing(20.0, 400.0)) == pytest.approx(400, rel=0.05)
    assert h.damping(ringing(20.0, 800.0)) > h.damping(ringing(20.0, 200.0))
    quantiles = -np.log(1 - np.array([0.1, 0.25, 0.5, 0.75, 0.9])) / (2 * 60)
    np.testing.assert_allclose(h.tap_course(ringing(60.0, 800.0)), quantiles, atol=1 / 800)
    band = h.tap_band(ringing(10.0, 500.0))
    assert (np.diff(band) > 0).all()
    assert band[2] == pytest.approx(500, abs=5)
    np.testing.assert_allclose(band[[1, 3]], 500, atol=10)
    assert h.tap_crest(ringing(0.0, 1000.0)) == pytest.approx(np.sqrt(2), rel=0.06)


def test_strength_is_the_logarithm_of_the_peak():
    assert h.tap_strength(one([], np.append(0.01 * np.ones(20), -100.0))) == pytest.approx(2)


MODES = DecayingModes([220.0, 610.0], [50.0, 120.0], [1.0, 0.6], [-1.5, -1.2])


def taps(fs, noise=0.0, velocities=(0.05, 0.08, 0.12)):
    rng = np.random.default_rng(0)
    hand = np.sin(np.pi * np.arange(round(0.05 * fs)) / (0.05 * fs)) ** 2
    hand *= fs / hand.sum()
    x = MODES.synthesize(round(0.1 * fs), fs)
    impulse = [500 * v * (x + noise * rng.standard_normal(x.size)) for v in velocities]
    return TapView(tuple(TapSignal(v * hand, i) for v, i in zip(velocities, impulse, strict=True)), fs)


def test_modes_of_a_tap_are_recovered_at_any_sampling_rate_and_in_noise():
    for fs in (2000.0, 5000.0, 10_000.0, 25_000.0, 50_000.0):
        np.testing.assert_allclose(tap_mode_frequency(taps(fs)), [220, 610], rtol=1e-6)
        np.testing.assert_allclose(10 ** tap_mode_decay(taps(fs)), [50, 120], rtol=1e-5)
    noisy = taps(FS, noise=0.03, velocities=np.linspace(0.05, 0.15, 7))
    np.testing.assert_allclose(tap_mode_frequency(noisy), [220, 610], rtol=0.03)
    np.testing.assert_allclose(10 ** tap_mode_decay(noisy), [50, 120], rtol=0.4)
    np.testing.assert_allclose(
        tap_mode_frequency(ringing(60, 300)), [300, 300], rtol=1e-6
    )  # one, given twice


def test_decimation_preserves_a_mode():
    fs = 20_000.0
    z = np.exp((-100 + 2j * np.pi * 400) / fs)
    y, rate = decimated((z ** np.arange(500)).real, fs)
    q = fs / rate
    np.testing.assert_allclose(y[2:], 2 * (z**q).real * y[1:-1] - abs(z**q) ** 2 * y[:-2], atol=1e-12)


def test_amplitude_slope_recovers_that_of_the_taps():
    peak = np.abs(MODES.synthesize(1000, FS)).max()
    assert tap_amplitude_slope(taps(FS)) == pytest.approx(np.log10(500 * peak), rel=1e-9)


def test_friction_is_the_mean_magnitude_in_any_direction():
    assert friction(PhaseView(np.array([0.5, -1.5, 1.0]), 1e4)) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("function", "view", "reason"),
    [
        (h.damping, one(np.zeros(3), np.ones(7)), "7 samples after the contact. Expected at least 8"),
        (
            tap_mode_frequency,
            one(np.ones(2), [1.0, -1.0, 0.5], 1.0),
            "3 samples of a tap. Expected at least 8",
        ),
        (tap_amplitude_slope, taps(FS, velocities=(0.1, 0.2)), "at least 3"),
        (tap_amplitude_slope, taps(FS, velocities=(0.1, 0.1, 0.1)), "of their mean. Expected"),
        (friction, PhaseView(np.zeros(10), 1e4), "silence: all 10 samples are 0"),
    ],
)
def test_undefined_features_of_taps_have_a_reason(function, view, reason):
    with pytest.raises(UndefinedFeatureError, match=reason):
        function(view)
