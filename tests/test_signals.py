import fractions

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from texclass.signals import combine, dft321, frame, moving_average, remove_hand_motion, rms

FS = 10_000.0


def _axes(n, c=3, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n, c)).cumsum(axis=0) * 0.1 + np.arange(c) * 9.81


# DFT321 -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 3, 64, 997, 1000, 1001])
@pytest.mark.parametrize("c", [2, 3, 6])
def test_dft321_has_the_printed_magnitude_and_phase(n, c):
    spectra = np.fft.rfft(_axes(n, c) - _axes(n, c).mean(axis=0), axis=0)[1:]
    found = np.fft.rfft(dft321(_axes(n, c)))[1:]
    assert_allclose(np.abs(found), np.sqrt((np.abs(spectra) ** 2).sum(axis=1)), rtol=1e-9)
    total = spectra.sum(axis=1)
    assert_allclose(found * np.abs(total), total * np.abs(found), atol=1e-6 * np.abs(spectra).max() ** 2)


@given(st.integers(1, 400), st.integers(1, 4), st.integers(0, 5))
@settings(deadline=None, max_examples=60)
def test_dft321_preserves_the_energy_of_the_axes_without_their_means(n, c, seed):
    axes = _axes(n, c, seed)
    energy = ((axes - axes.mean(axis=0)) ** 2).sum()
    assert_allclose((dft321(axes) ** 2).sum(), energy, rtol=1e-11, atol=1e-20)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_dft321_passes_a_single_moving_axis_unchanged(axis):
    axes = np.tile([0.0, 9.81, -3.0], (501, 1))
    axes[:, axis] += _axes(501, 1)[:, 0]
    assert_allclose(dft321(axes), axes[:, axis] - axes[:, axis].mean(), atol=1e-12)


def test_dft321_spectral_energy_is_invariant_to_rotation():
    axes = _axes(1000)
    turned = Rotation.from_rotvec([0.3, -1.1, 0.7]).apply(axes)
    assert_allclose(np.abs(np.fft.rfft(dft321(turned))), np.abs(np.fft.rfft(dft321(axes))), atol=1e-9)


def test_dft321_of_opposite_axes_takes_the_phase_of_the_earlier_one():
    shake = _axes(1000, 1)[:, 0]
    shake -= shake.mean()
    noise = 1e-15 * np.random.default_rng(1).standard_normal((1000, 2))
    found = dft321(np.stack([shake, -shake], axis=1) + noise)
    assert_allclose(found, np.sqrt(2) * shake, atol=1e-4 * np.abs(shake).max())


def test_dft321_is_continuous_where_the_axes_nearly_cancel():
    shake = _axes(1000, 1)[:, 0]
    shake -= shake.mean()
    near = [dft321(np.stack([shake, -(1 - gap) * shake], axis=1)) for gap in (0.0, 1e-12, 1e-10, 1e-8)]
    for found in near[1:]:
        assert_allclose(found, near[0], atol=1e-6 * np.abs(shake).max())


@pytest.mark.parametrize("axes", [np.zeros((50, 3)), np.full((50, 3), 9.81), np.ones((1, 3))])
def test_dft321_of_no_motion_is_zero(axes):
    assert_array_equal(dft321(axes), np.zeros(len(axes)))


def test_dft321_costs_no_huge_offset_its_precision():
    axes = np.random.default_rng(3).standard_normal((4096, 3))
    assert_allclose(dft321(axes + 1e6), dft321(axes), atol=1e-8)


@pytest.mark.parametrize("shape", [(10,), (0, 3), (10, 0), (4, 3, 2)])
def test_dft321_names_a_wrong_shape(shape):
    with pytest.raises(ValueError, match="the rule is"):
        dft321(np.zeros(shape))


def test_combine_only_centres_one_channel():
    x = _axes(100, 1)[:, 0]
    assert_array_equal(combine(x), x - x.mean())
    assert_array_equal(combine(x[:, np.newaxis]), x - x.mean())


# Filters ----------------------------------------------------------------------------------------------------


# Moving average, framing, level -----------------------------------------------------------------------------


@given(st.integers(1, 60), st.integers(1, 130), st.integers(0, 10))
@settings(deadline=None, max_examples=150)
def test_moving_average_is_the_mean_of_the_window_cut_at_the_ends(size, n, seed):
    x = np.random.default_rng(seed).standard_normal(size)
    expected = [x[max(i - n // 2, 0) : i - n // 2 + n].mean() for i in range(size)]
    assert_allclose(moving_average(x, n), expected, atol=1e-13)


def test_moving_average_agrees_with_pandas():
    x = _axes(5000, 1)[:, 0]
    for n in (1, 3, 100, 101):
        expected = pd.Series(x[::-1]).rolling(n, center=True, min_periods=1).mean().to_numpy()[::-1]
        assert_allclose(moving_average(x, n)[n:-n], expected[n:-n] if n % 2 else _even(x, n), rtol=1e-10)


def _even(x, n):
    return np.convolve(x, np.full(n, 1 / n), mode="valid")[n - n // 2 : len(x) - n - n // 2]


@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("n", [3, 100, 5000])
def test_moving_average_of_a_million_samples_is_exact(offset, n):
    x = np.random.default_rng(4).standard_normal(1_000_000) + offset
    found = moving_average(x, n)
    for i in (n, 123_457, 500_000, 999_000 - n):
        window = x[i - n // 2 : i - n // 2 + n]
        exact = sum(map(fractions.Fraction, window)) / n
        assert abs(fractions.Fraction(found[i]) - exact) <= 1e-12 * max(
            abs(exact), fractions.Fraction(1, 100)
        )


def test_moving_average_forgets_a_huge_sample_once_the_window_has_passed_it():
    x = np.random.default_rng(5).standard_normal(100_000)
    spoiled = x.copy()
    spoiled[1000], spoiled[1001] = 1e13, -1e13
    assert_allclose(moving_average(spoiled, 500)[3000:], moving_average(x, 500)[3000:], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("x", "n"), [(np.zeros((3, 2)), 2), (np.zeros(0), 2), (np.zeros(5), 0)])
def test_moving_average_names_wrong_arguments(x, n):
    with pytest.raises(ValueError, match="the rule is"):
        moving_average(x, n)


def test_frame_is_a_view_of_whole_frames():
    x = np.arange(11.0)
    frames = frame(x, 4, 3)
    assert_array_equal(frames, [[0, 1, 2, 3], [3, 4, 5, 6], [6, 7, 8, 9]])
    assert np.shares_memory(frames, x)
    assert not frames.flags.writeable


@pytest.mark.parametrize(("length", "hop"), [(0, 1), (1, 0), (12, 1)])
def test_frame_names_what_cannot_be_framed(length, hop):
    with pytest.raises(ValueError, match="the rule is"):
        frame(np.zeros(11), length, hop)


def test_rms_counts_every_sample_of_every_axis():
    assert_allclose(rms([[3.0, -4.0], [4.0, 3.0]]), np.sqrt(50 / 4))


@pytest.mark.parametrize(("frequency", "passed"), [(1.0, 0.065), (2.5, 0.363), (5.0, 1.0), (80.0, 1.0)])
def test_hand_motion_is_removed_as_its_equation_says(frequency, passed):
    time = np.arange(4 * int(FS)) / FS
    middle = slice(int(FS), 3 * int(FS))
    out = remove_hand_motion(np.sin(2 * np.pi * frequency * time) + 9.81, FS)
    assert_allclose(np.sqrt(2) * rms(out[middle]), passed, atol=0.01)


def test_hand_motion_of_a_short_or_slow_signal_is_defined():
    assert remove_hand_motion(np.arange(3.0), 100.0).shape == (3,)
    assert_allclose(remove_hand_motion(np.full(50, 7.0), 1.0), 0.0, atol=1e-12)
