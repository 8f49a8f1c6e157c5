import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy import signal

from texclass.signals import (
    bandpass,
    butterworth,
    causal,
    combine,
    dft321,
    highpass,
    lowpass,
    moving_average,
    remove_hand_motion,
    to_unit_scale,
    zero_phase,
)  # fmt: skip

FS = 10_000.0


def _axes(n, c=3, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n, c)).cumsum(axis=0) * 0.1 + np.arange(c) * 9.81


# DFT321 -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 3, 64, 997, 1000, 1001])
@pytest.mark.parametrize("c", [1, 2, 3, 6])
def test_dft321_has_the_printed_magnitude_and_phase(n, c):
    spectra = np.fft.rfft(_axes(n, c) - _axes(n, c).mean(axis=0), axis=0)
    combined = np.fft.rfft(dft321(_axes(n, c)))
    assert_allclose(np.abs(combined), np.sqrt((np.abs(spectra) ** 2).sum(axis=1)), rtol=1e-9, atol=1e-9)
    total = spectra.sum(axis=1)
    assert_allclose(
        combined * np.abs(total), total * np.abs(combined), atol=1e-6 * np.abs(spectra).max() ** 2
    )


def test_dft321_of_opposite_axes_takes_the_phase_of_the_earlier_one():
    shake = _axes(1000, 1)[:, 0]
    shake -= shake.mean()
    noise = 1e-15 * np.random.default_rng(1).standard_normal((1000, 2))
    combined = dft321(np.stack([shake, -shake], axis=1) + noise)
    assert_allclose(combined, np.sqrt(2) * shake, atol=1e-4 * np.abs(shake).max())
    white = np.random.default_rng(0).standard_normal(1000)
    combined = dft321(np.stack([white, -white], axis=1), single=True)
    assert_allclose(combined, np.sqrt(2) * (white - white.mean()), atol=0.1)


def test_dft321_is_continuous_where_the_axes_nearly_cancel():
    shake = _axes(1000, 1)[:, 0]
    shake -= shake.mean()
    near = [dft321(np.stack([shake, -(1 - gap) * shake], axis=1)) for gap in (0.0, 1e-12, 1e-10, 1e-8)]
    for combined in near[1:]:
        assert_allclose(combined, near[0], atol=1e-6 * np.abs(shake).max())


@pytest.mark.parametrize("gain", [1.0, 1e-200, 1e200])
@pytest.mark.parametrize("n", [4, 1001, 1004, 20_000])
def test_dft321_in_single_precision_is_that_in_double_to_a_few_millionths(n, gain):
    axes = gain * _axes(n)
    exact = dft321(axes)
    combined = dft321(axes, single=True)
    assert combined.dtype == np.float64
    assert_allclose(combined / gain, exact / gain, atol=1e-5 * np.abs(exact / gain).max())
    assert abs((combined / gain).mean()) < 1e-6 * np.abs(exact / gain).max()


@pytest.mark.parametrize("axes", [np.zeros((50, 3)), np.full((50, 3), 9.81), np.ones((1, 3))])
def test_dft321_of_no_motion_is_zero(axes):
    assert_array_equal(dft321(axes), np.zeros(len(axes)))


@pytest.mark.parametrize("shape", [(10,), (0, 3), (10, 0), (4, 3, 2)])
def test_dft321_names_a_wrong_shape(shape):
    with pytest.raises(ValueError, match="must"):
        dft321(np.zeros(shape))


def test_combine_only_centres_one_channel():
    x = _axes(100, 1)[:, 0]
    assert_array_equal(combine(x), x - x.mean())
    assert_array_equal(combine(x[:, np.newaxis]), x - x.mean())


# Moving average, framing, level -----------------------------------------------------------------------------


@given(st.integers(1, 60), st.integers(1, 130), st.integers(0, 10))
@settings(deadline=None, max_examples=150)
def test_moving_average_is_the_mean_of_the_window_cut_at_the_ends(size, n, seed):
    x = np.random.default_rng(seed).standard_normal(size)
    expected = [x[max(i - n // 2, 0) : i - n // 2 + n].mean() for i in range(size)]
    assert_allclose(moving_average(x, n), expected, atol=1e-13)


@pytest.mark.parametrize(("x", "n"), [(np.zeros((3, 2)), 2), (np.zeros(0), 2), (np.zeros(5), 0)])
def test_moving_average_names_wrong_arguments(x, n):
    with pytest.raises(ValueError, match="must"):
        moving_average(x, n)


@pytest.mark.parametrize(("frequency", "passed"), [(1.0, 0.065), (2.5, 0.363), (5.0, 1.0), (80.0, 1.0)])
def test_hand_motion_is_removed_with_the_documented_gain(frequency, passed):
    time = np.arange(4 * int(FS)) / FS
    middle = slice(int(FS), 3 * int(FS))
    out = remove_hand_motion(np.sin(2 * np.pi * frequency * time) + 9.81, FS)
    assert_allclose(np.sqrt(2) * np.std(out[middle]), passed, atol=0.01)


def test_hand_motion_of_a_short_or_slow_signal_is_defined():
    assert remove_hand_motion(np.arange(3.0), 100.0).shape == (3,)
    assert_allclose(remove_hand_motion(np.full(50, 7.0), 1.0), 0.0, atol=1e-12)


@given(st.floats(1e-300, 1e300), st.integers(1, 20))
def test_unit_scale_is_exact(gain, n):
    x = gain * np.linspace(-1, 0.5, n)
    unit, exponent = to_unit_scale(x)
    assert 0.5 <= np.abs(unit).max() < 1
    assert_array_equal(np.ldexp(unit, exponent)[0], x[0])


# Filters ----------------------------------------------------------------------------------------------------


def _sine(hz, n=20_000):
    return np.sin(2 * np.pi * hz * np.arange(n) / FS)


@pytest.mark.parametrize(
    ("filtered", "hz", "gain"),
    [
        (lambda x: lowpass(x, 500.0, FS), 50.0, 1.0),
        (lambda x: lowpass(x, 500.0, FS), 500.0, 0.5),
        (lambda x: lowpass(x, 500.0, FS), 4000.0, 0.0),
        (lambda x: highpass(x, 500.0, FS), 4000.0, 1.0),
        (lambda x: highpass(x, 500.0, FS), 500.0, 0.5),
        (lambda x: highpass(x, 500.0, FS), 50.0, 0.0),
        (lambda x: bandpass(x, (200.0, 800.0), FS), 400.0, 1.0),
        (lambda x: bandpass(x, (200.0, 800.0), FS), 200.0, 0.5),
        (lambda x: bandpass(x, (200.0, 800.0), FS), 3000.0, 0.0),
    ],
)
def test_filter_passes_a_sine_undelayed_with_its_gain(filtered, hz, gain):
    middle = slice(5000, 15_000)
    assert_allclose(filtered(_sine(hz))[middle], gain * _sine(hz)[middle], atol=4e-3)


@pytest.mark.parametrize("filtered", [lambda x: lowpass(x, 100.0, FS), lambda x: highpass(x, 100.0, FS)])
@pytest.mark.parametrize("n", [1, 2, 5, 40, 1000])
def test_filter_takes_signals_of_any_length_and_keeps_a_constant_apart(filtered, n):
    output = filtered(np.full(n, 1e3))
    assert output.shape == (n,)
    assert np.ptp(output) < 1e-6
    assert np.isclose(output[0], 0.0, atol=1e-6) or np.isclose(output[0], 1e3, atol=1e-6)


def test_zero_phase_filters_each_axis_by_itself():
    axes = _axes(3000)
    sos = butterworth("highpass", 100.0, FS)
    assert_allclose(zero_phase(sos, axes)[:, 1], zero_phase(sos, axes[:, 1]), atol=1e-10)


@pytest.mark.parametrize("cutoff", [5000.0, 6000.0, 0.0, -1.0, float("nan")])
@pytest.mark.parametrize("make", [lowpass, highpass])
def test_cutoff_outside_the_band_is_an_error(make, cutoff):
    with pytest.raises(ValueError, match=r"ritical frequencies|cutoff_hz contains 1 NaN"):
        make(np.zeros(100), cutoff, FS)


@pytest.mark.parametrize("band", [(800.0, 200.0), (200.0, 200.0), (200.0, 5000.0)])
def test_band_with_wrong_edges_is_an_error(band):
    with pytest.raises(ValueError, match=r"ritical frequencies|Wn"):
        bandpass(np.zeros(100), band, FS)


@pytest.mark.parametrize("n", [1, 31, 32, 1025, 5000])
@pytest.mark.parametrize(
    ("kind", "edges"),
    [("highpass", 60.0), ("lowpass", 900.0), ("bandpass", (20.0, 4000.0)), ("bandpass", (30.0, 60.0))],
)
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_design_and_causal_filter_are_those_of_scipy(kind, edges, order, n):
    x = np.random.default_rng(0).standard_normal((n, 2)) + 9.81
    sos = butterworth(kind, edges, FS, order=order)
    theirs = signal.butter(order, edges, kind, fs=FS, output="sos")
    f = np.geomspace(1, 0.49 * FS, 50)
    assert_allclose(signal.freqz_sos(sos, f, fs=FS)[1], signal.freqz_sos(theirs, f, fs=FS)[1], atol=1e-9)
    at_rest = signal.sosfilt_zi(sos)[:, :, None] * x[0]
    filtered, state = causal(sos, x)
    expected, after = signal.sosfilt(sos, x, axis=0, zi=at_rest)
    assert_allclose(filtered, expected, atol=2e-11)
    assert_allclose(state, after, atol=2e-11)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"order": 0}, "order must be at least 1, got 0"),
        ({"cutoff_hz": np.nan}, "cutoff_hz contains"),
        ({"fs": 0.0}, "fs must be positive and finite, got 0.0"),
    ],
)
def test_invalid_filters_are_errors(change, message):
    with pytest.raises(ValueError, match=message):
        butterworth(**{"kind": "highpass", "cutoff_hz": 100.0, "fs": FS} | change)
