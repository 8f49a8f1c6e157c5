"""Band levels and their changes: known filters, tones and modulations are recovered."""

import numpy as np
import pytest
from feature_signals import noise, tone
from scipy import signal

from texclass.features import bands
from texclass.features.bands import (
    band_course,
    band_level,
    level_fluctuation,
    level_persistence,
    octave_level,
)
from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import PhaseView

FS = 2000.0


def view(x):
    return PhaseView(np.asarray(x), FS)


def test_level_of_white_noise_is_its_density():
    white, expected = view(3 * noise(200_000)), np.log10(9 / (FS / 2))
    np.testing.assert_allclose(band_level(white)[1:], expected, atol=0.02)
    np.testing.assert_allclose(octave_level(white), expected, atol=0.05)


def test_power_of_all_bins_obeys_parseval():
    x = noise(1000).astype(np.float32)
    power = bands.density(bands.periodogram(x, FS), np.array([0.0, FS / 2]))[0] * FS / 2
    assert power == pytest.approx(np.mean(np.diff(x) ** 2), rel=0.1)


def test_a_bin_that_contains_an_edge_is_divided_in_proportion():
    power = np.array([[4.0, 1.0, 8.0, 2.0]], dtype=np.float32)
    edges = np.array([0.0, 0.5, 0.75, 2.25, 4.0])  # in bins of 1 Hz; the second band lies inside one bin
    expected = [4.0, 4.0, (1.0 + 1.0 + 2.0) / 1.5, (6.0 + 2.0) / 1.75]
    np.testing.assert_allclose(bands.density((power, np.zeros((1, 1)), 1.0), edges), [expected], rtol=1e-12)
    floored = bands.density((power, np.full((1, 1), 5.0), 1.0), edges)
    np.testing.assert_array_equal(floored, [[5.0, 5.0, 5.0, 5.0]])


def test_parts_computed_together_equal_parts_computed_separately():
    x = noise(3000).astype(np.float32).reshape(3, 1000)
    together, floor, step_hz = bands.periodogram(x, FS)
    for row, part in enumerate(x):
        alone = bands.periodogram(part, FS)
        np.testing.assert_allclose(together[row], alone[0], rtol=1e-4, atol=1e-6 * alone[0].max())
        assert [floor[row, 0], step_hz] == pytest.approx([alone[1][0], alone[2]])
    x[1] = 0.25
    with pytest.raises(UndefinedFeatureError, match="silence"):
        bands.periodogram(x, FS)


def test_long_movements_have_the_same_periodogram_as_in_numpy():
    x = noise(12_000).astype(np.float32)
    n = x.size - 1
    d = np.diff(x) * signal.windows.tukey(2 * n + 1, 2 * bands.TAPER)[1::2]
    expected = np.abs(np.fft.rfft(d, 12_000)) ** 2
    power, _, _ = bands.periodogram(x, FS)
    np.testing.assert_allclose(power / power.sum(), expected / expected.sum(), atol=1e-7)


def test_a_strong_slow_motion_does_not_leak_over_weak_high_frequencies():
    weak = 1e-3 * noise(2000)
    together = band_level(view(weak + tone(3.3, 2000, FS)))
    np.testing.assert_allclose(together[6:], band_level(view(weak))[6:], atol=0.1)


def test_a_tone_is_in_its_band_only():
    assert band_level(view(tone(520, 20_000, FS))).argmax() == int(520 / (FS / 2 / 24))
    names = [f"o{k}.{i}" for k in (2, 3, 4) for i in (1, 2, 3)]
    assert names[octave_level(view(tone(100, 20_000, FS))).argmax()] == "o3.1"
    assert bands.fraction_names(octaves=(2, 5), per_octave=3) == tuple(names)


def test_all_levels_share_one_transform():
    movement = view(noise(1000))
    first = bands.whole_periodogram(movement)
    band_level(movement)
    octave_level(movement)
    assert bands.whole_periodogram(movement) is first


def test_a_constant_change_of_the_sensor_cancels_in_features_of_change():
    x = noise(60_000) * (1 + 0.5 * tone(0.7, 60_000, FS))
    tilted = signal.lfilter([1, 0.3], [1], x)  # +2.3 dB at 0 Hz, -3.1 dB at fs/2
    for feature in (band_course, level_fluctuation, level_persistence):
        np.testing.assert_allclose(feature(view(tilted)), feature(view(x)), atol=0.03)


def test_band_course_of_a_falling_level_is_its_first_term_and_reverses_with_time():
    n = 120_000
    fall = 10 ** (0.05 * np.cos(np.pi * (np.arange(n) + 0.5) / n))
    terms = band_course(view(noise(n) * fall), n_parts=6).reshape(5, 4)
    np.testing.assert_allclose(terms[0], 0.1, atol=0.03)
    np.testing.assert_allclose(terms[1:], 0, atol=0.03)
    x = noise(30_000) * np.linspace(1, 3, 30_000)
    thirds = band_course(view(x))
    np.testing.assert_allclose(band_course(view(x[::-1].copy())), thirds * np.repeat([-1, 1], 4), atol=2e-3)
    np.testing.assert_allclose(thirds[:4], band_course(view(x), n_parts=6)[:4], atol=0.05)
    with pytest.raises(ValueError, match=r"n_parts must be 2, 3 or 6, got 4"):
        band_course(view(x), n_parts=4)


def test_noise_of_steady_level_fluctuates_less_in_wider_octaves():
    levels = level_fluctuation(view(noise(100_000)))
    assert (np.diff(levels) > 0).all()
    # The highest octave holds 16 bins, 12 independent ones of a Hann window: log10 of their mean.
    assert levels[0] == pytest.approx(np.sqrt(1.5 / 16) / np.log(10), rel=0.25)


def test_grains_fluctuate_and_bursts_persist():
    bursts = 1 + 5 * (tone(1.5, 100_000, FS) > 0)
    steady, bursting = view(noise(100_000)), view(noise(100_000) * bursts)
    assert (level_fluctuation(bursting) > level_fluctuation(steady) + 0.1).all()
    assert (np.abs(level_persistence(steady)) < 0.1).all()
    assert (level_persistence(bursting) > 0.3).all()
