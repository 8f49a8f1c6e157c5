import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from scipy import optimize

from texclass.stability import references
from texclass.vibration.autoregressive import Autoregression
from texclass.vibration.line_spectrum import conditioning, from_reflection, spread, to_reflection

OMEGA = (np.arange(2048) + 0.5) * np.pi / 2048
BELOW_ONE = float(np.nextafter(1.0, 0.0))


def _random_k(p, size=0.5, seed=0):
    return np.random.default_rng(seed).uniform(-size, size, p)


def _log_spectrum(k, omega=OMEGA):
    return Autoregression(k, np.ones(np.shape(k)[:-1])).log_spectrum_db(omega)


def _rms_db(k, other):
    return float(np.sqrt(np.mean((_log_spectrum(k) - _log_spectrum(other)) ** 2)))


def _is_interlaced(lsf):
    return bool(np.all(np.diff(lsf) > 0) and np.all(lsf > 0) and np.all(lsf < np.pi))


# The definition ---------------------------------------------------------------------------------------------


def test_white_noise_divides_the_half_circle_evenly():
    for p in (1, 2, 17, 18, 999, 1000):
        lsf = from_reflection(np.zeros(p))
        assert_allclose(lsf, np.arange(1, p + 1) * np.pi / (p + 1), rtol=1e-14)
        assert_allclose(to_reflection(lsf), 0.0, atol=1e-12)


def test_frequencies_are_the_roots_of_p_and_q_in_60_digits():
    for p in (1, 2, 3, 4, 5, 18, 50):
        k = _random_k(p, 0.8 if p < 10 else 0.3, seed=p)
        lsf = from_reflection(k)
        assert _is_interlaced(lsf)
        assert references.line_spectrum_error(k, lsf) < 4e-15


def test_a_frequency_close_to_zero_keeps_its_relative_accuracy():
    k = np.full(18, -0.9)
    lsf = from_reflection(k)
    assert lsf[0] < 1e-11
    assert references.line_spectrum_error(k, lsf) < 1e-14
    assert_allclose(1 + to_reflection(lsf), 1 + k, rtol=1e-13)


# There and back ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("distance", [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("p", [2, 33, 400])
def test_the_height_of_a_resonance_is_preserved_within_the_conditioning(distance, p):
    radius = 1 - distance
    k = np.append([-2 * radius * np.cos(0.7) / (1 + radius**2), radius**2], _random_k(p - 2, 0.05))
    lsf = from_reflection(k)
    condition = float(conditioning(lsf))
    i = np.argmin(np.diff(lsf))
    at_peak = [(lsf[i] + lsf[i + 1]) / 2]
    assert condition < 1e-3
    error = _log_spectrum(to_reflection(lsf), at_peak) - _log_spectrum(k, at_peak)
    assert abs(error[0]) < 40 * 20 * np.log10(1 + condition) + 1e-11
    assert _rms_db(k, to_reflection(lsf)) < 1e-10


@pytest.mark.parametrize("size", [0.9, BELOW_ONE])
@pytest.mark.parametrize("p", [3, 18, 127, 500])
def test_extreme_coefficients_give_stable_models_of_the_same_spectrum(p, size):
    signs = np.random.default_rng(p).choice([-1.0, 1.0], p)
    k = size * np.stack([np.ones(p), -np.ones(p), (-1.0) ** np.arange(p), signs])
    lsf = from_reflection(k)
    back = to_reflection(lsf)
    assert all(_is_interlaced(row) for row in lsf)
    assert np.abs(back).max() < 1
    assert np.abs(_log_spectrum(back) - _log_spectrum(k)).max() < 1e-5  # of thousands of dB


def test_conditioning_is_large_where_k_cannot_be_recovered():
    constant, alternating = np.full(128, 0.9), 0.9 * (-1.0) ** np.arange(128)
    for k in (constant, alternating, -constant):
        lsf = from_reflection(k)
        comes_back = np.abs(to_reflection(lsf) - k).max() < 1e-6
        assert comes_back == (conditioning(lsf) < 0.1)
    assert conditioning(from_reflection(constant)) < 1e-9


@given(arrays(np.float64, st.integers(1, 60), elements=st.floats(-BELOW_ONE, BELOW_ONE)))
@settings(deadline=None, max_examples=60)
def test_any_reflection_coefficients_give_interlacing_frequencies_and_a_stable_model(k):
    lsf = from_reflection(k)
    back = to_reflection(lsf)
    assert _is_interlaced(lsf)
    assert np.abs(back).max() < 1
    assert _rms_db(k, back) < 1e-5


@pytest.mark.parametrize("p", [1, 8])
def test_stacks_of_any_layout_and_dtype_equal_single_models(p):
    k = _random_k(24 * p).reshape(2, 3, 4, p).astype(np.float32)[:, ::2, ::-1]
    k.setflags(write=False)
    lsf = from_reflection(k)
    assert lsf.shape == k.shape
    assert lsf.dtype == np.float64
    assert conditioning(lsf).shape == k.shape[:-1]
    for i in np.ndindex(k.shape[:-1]):
        assert_array_equal(lsf[i], from_reflection(k[i].astype(np.float64)))
        assert_array_equal(to_reflection(lsf[..., :])[i], to_reflection(lsf[i]))
    assert_allclose(to_reflection(lsf), k, atol=1e-13)
    assert from_reflection(k[:, :0]).shape == to_reflection(lsf[:, :0]).shape == k[:, :0].shape


# The nearest frequencies of a stable model ------------------------------------------------------------------


def test_valid_frequencies_are_not_changed_by_spread():
    lsf = from_reflection(_random_k(18))
    assert_array_equal(spread(lsf), lsf)
    assert_array_equal(spread(np.stack([lsf, lsf[::-1]]))[0], lsf)


@given(st.integers(1, 40), st.floats(0, 1), st.integers(0, 1000))
@settings(deadline=None, max_examples=60)
def test_any_numbers_become_increasing_frequencies_with_the_gap(p, share, seed):
    min_gap = share * np.pi / (p + 1)
    near = spread(np.random.default_rng(seed).normal(1.5, 2.0, p), min_gap)
    assert _is_interlaced(near)
    assert np.diff(near, prepend=0.0, append=np.pi).min() >= min_gap - 2e-15
    k = to_reflection(near)  # any increasing sequence is a stable model
    assert np.abs(k).max() < 1
    assert np.isfinite(_log_spectrum(k)).all()


def test_spread_returns_the_nearest_valid_frequencies():
    """The reference is a general solver of the constrained least-squares problem."""
    lsf, gap = np.random.default_rng(3).normal(1.5, 1.2, 7), 0.1
    ends = {"type": "ineq", "fun": lambda x: np.diff(x, prepend=0.0, append=np.pi) - gap}
    best = optimize.minimize(lambda x: np.sum((x - lsf) ** 2), np.linspace(0.3, 2.8, 7), constraints=ends)
    assert_allclose(spread(lsf, gap), best.x, atol=1e-5)
