import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy import signal

from texclass.stability import references
from texclass.vibration.autoregressive import Autoregression, fit
from texclass.vibration.lattice import LatticeInverse, LatticeSynthesis, synthesize, whiten

DTYPES = [np.float64, np.float32]


def _noise(n, seed=0):
    return np.random.default_rng(seed).standard_normal(n)


def _model(p, seed=0, gain=1.0):
    rng = np.random.default_rng(seed)
    return Autoregression(rng.uniform(-0.9, 0.9, p) * np.exp(-np.arange(p) / 10), np.asarray(gain))


def test_inverse_filter_is_the_prediction_error_of_the_model():
    x = signal.lfilter([1.0], [1.0, -1.5, 0.9], _noise(5000))
    model = fit(x, 8)
    expected = signal.lfilter(model.direct_form(), [model.gain], x)
    assert_allclose(whiten(model, x), expected, atol=1e-10)
    assert_allclose(np.std(whiten(model, x)), 1.0, atol=0.01)


@pytest.mark.parametrize("dtype", DTYPES)
def test_process_varying_with_constant_parameters_equals_process_and_keeps_the_last(dtype):
    model, e = _model(200), _noise(2000)
    rows = np.broadcast_to(model.reflection, (2000, 200))
    levels = np.full(2000, model.level)
    x = np.concatenate([e, e])
    for kind in (LatticeSynthesis, LatticeInverse):
        lattice = kind(_model(200, seed=9), dtype=dtype)
        varying = np.concatenate([lattice.process_varying(x[:2000], rows, levels), lattice.process(x[2000:])])
        x = kind(model, dtype=dtype).process(x)
        assert_array_equal(varying, x)


@given(st.integers(0, 1000), st.sampled_from(DTYPES), st.sampled_from([0.5, 1e-3, 1e-9, 1e-15]))
@settings(deadline=None, max_examples=40)
def test_states_never_gain_energy_for_any_change_of_the_parameters(seed, dtype, gap):
    rng = np.random.default_rng(seed)
    lattice = LatticeSynthesis(_model(20), dtype=dtype).settle(rng)
    for _ in range(20):
        initial = np.sum(lattice._b[:20].astype(np.float64) ** 2)
        k = rng.choice([-1, 1], (50, 20)) * (1 - gap * rng.uniform(0.1, 1, (50, 20)))
        lattice.process_varying(np.zeros(50), k, np.ones(50))
        assert np.sum(lattice._b[:20].astype(np.float64) ** 2) <= initial


def test_level_is_exact_at_every_sample_while_parameters_change():
    """Orthogonal stages turn states and excitation of unit variance into an output of unit variance."""
    p, n = 6, 40
    out = np.empty((p + n, n))
    k = np.linspace(_model(p).reflection, _model(p, seed=4).reflection, 30)
    level = np.geomspace(0.1, 7.0, 30)
    for row in range(p + n):
        lattice, e = LatticeSynthesis(_model(p)), np.zeros(n)
        if row < p:
            lattice._b[row] = 1.0
        else:
            e[row - p] = 1.0
        out[row] = np.append(lattice.process_varying(e[:30], k, level), lattice.process(e[30:]))
    assert_allclose(np.sqrt((out**2).sum(axis=0)), [*level] + [level[-1]] * 10, rtol=1e-12)


def test_settled_process_starts_at_its_level():
    model = fit(signal.lfilter([1.0], [1.0, -1.99, 0.9999], _noise(20_000)), 2)
    rng = np.random.default_rng(0)
    starts = np.array([synthesize(model, 3, rng) for _ in range(4000)])
    assert_allclose(starts.std(axis=0), model.level, rtol=0.04)


def test_a_pole_at_radius_1_minus_1e_9_agrees_with_sixty_digits():
    radius, e = 1 - 1e-9, _noise(400)
    k = np.array([-2 * radius * np.cos(0.3) / (1 + radius**2), radius**2])
    expected = references.all_pole_response(k, e)
    model = Autoregression(k, np.asarray(1.0))
    assert_allclose(LatticeSynthesis(model).process(e), expected, atol=1e-10 * np.abs(expected).max())
    assert_allclose(LatticeInverse(model).process(expected), e, atol=1e-6)


def test_reset_clears_the_state_and_empty_blocks_change_nothing():
    lattice, e = LatticeSynthesis(_model(5)), _noise(100)
    first = lattice.process(e)
    lattice.reset()
    assert lattice.process([]).shape == (0,)
    assert_array_equal(lattice.process(e), first)
