import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from texclass.vibration.major_frequencies import (
    MajorFrequencies,
    beat_threshold_hz,
    fit_major_frequencies,
    interpolate,
    strongest_lines,
)

FS = 10_000.0
SLOW = MajorFrequencies([40.0, 120.0, 300.0], [1.0, 2.0, 0.5], [0.1, 0.2, 0.3])
FAST = MajorFrequencies([40.0, 125.0, 600.0], [3.0, 1.0, 1.0], [0.1, 2.0, -3.0])


def _noise(n=10_000, seed=0):
    return np.random.default_rng(seed).standard_normal(n)


def test_thresholds_are_those_of_table_3_2():
    f = [10, 50, 51, 100, 150, 151, 250, 251, 500, 501, 1400]
    assert_array_equal(beat_threshold_hz(f), [6, 6, 7, 7, 9, 9, 9, 15, 15, 80, 80])


def test_lines_on_the_frequency_grid_are_recovered_with_amplitude_and_phase():
    model = fit_major_frequencies(SLOW.synthesize(10_000, FS), FS, n_frequencies=3)
    for name in ("frequency_hz", "amplitude", "phase"):
        assert_allclose(getattr(model, name), getattr(SLOW, name), atol=1e-9)


def test_synthesis_is_the_inverse_transform_of_the_selected_lines():
    x = _noise()
    model = fit_major_frequencies(x, FS, n_frequencies=30)
    spectrum = np.fft.rfft(x)
    selected = np.zeros_like(spectrum)
    bins = np.round(model.frequency_hz * x.size / FS).astype(int)
    selected[bins] = spectrum[bins]
    assert_allclose(model.synthesize(x.size, FS), np.fft.irfft(selected, x.size), atol=1e-10)


def test_the_stronger_of_two_beating_lines_is_selected_by_the_threshold_of_the_lower():
    # 15 Hz from 250 to 500 Hz, 80 Hz above: table 3.2 of oeztuerk2018.
    f = np.arange(400.0, 700.0)
    for strong, weak, n in ((505, 480, 2), (505, 495, 1), (480, 505, 2), (600, 530, 1), (600, 515, 2)):
        values = 2.0 * (f == strong) + 1.0 * (f == weak)
        assert [f[i] for i in strongest_lines(values, f, 5)] == [strong, weak][:n]


def test_frequencies_at_or_above_half_the_sampling_rate_are_omitted():
    assert_allclose(
        SLOW.synthesize(50, 400.0), MajorFrequencies([40.0, 120.0], [1, 2], [0.1, 0.2]).synthesize(50, 400.0)
    )


def test_interpolation_is_linear_merges_close_lines_and_is_continuous():
    half = interpolate(SLOW, FAST, 0.5)
    assert_allclose(half.frequency_hz, [40.0, 122.5, 300.0, 600.0])
    assert_allclose(half.amplitude, [2.0, 1.5, 0.25, 0.5])
    x = [interpolate(SLOW, FAST, w).synthesize(200, FS) for w in np.linspace(0, 1, 401)]
    assert np.abs(np.diff(x, axis=0)).max() < 0.03
    assert_allclose([x[0], x[-1]], [end.synthesize(200, FS) for end in (SLOW, FAST)], atol=1e-12)
