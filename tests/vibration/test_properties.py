"""What holds for every model of a vibration, tried on examples that hypothesis draws.

The examples are the same in every run; with `TEXCLASS_EXAMPLES=2000` in the environment as many new ones are
drawn.
"""

import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal

from texclass.vibration import (
    Autoregression,
    LatticeInverse,
    LatticeSynthesis,
    fit,
    fit_major_frequencies,
    fit_matrix_pencil,
    fit_okamura,
    fit_prony,
    fit_tap_model,
    select_order,
)

DRAWN = int(os.environ.get("TEXCLASS_EXAMPLES", "0"))
BELOW_ONE = float(np.nextafter(1.0, 0.0))
OMEGA = np.linspace(0.02, 3.12, 200)
EXPONENTS = st.integers(-530, 498)  # 2^-530 = 3e-160, 2^498 = 8e149
SEEDS = st.integers(0, 2**32 - 1)
FINITE = st.floats(allow_nan=False, allow_infinity=False)


def examples(n):
    return settings(max_examples=DRAWN or n, derandomize=not DRAWN, database=None, deadline=None)


def _vectors(elements, min_size, max_size):
    return st.integers(min_size, max_size).flatmap(lambda n: arrays(np.float64, n, elements=elements))


NEXT_TO_ONE = st.sampled_from([1 - 1e-3, 1 - 1e-6, 1 - 1e-9, 1 - 1e-12, BELOW_ONE]).flatmap(
    lambda size: st.sampled_from([-size, size])
)
ANY_K = st.floats(-BELOW_ONE, BELOW_ONE) | NEXT_TO_ONE


@st.composite
def reflections(draw, size=1.0, max_order=40):
    """Reflection coefficients, some of them next to 1."""
    if size == 1.0 and draw(st.booleans()):
        return draw(_vectors(ANY_K, 1, 12))
    p = draw(st.integers(1, max_order))
    return np.random.default_rng(draw(SEEDS)).uniform(-size, size, p)


@st.composite
def textures(draw, n=400):
    """Noise with a resonance and an offset, as a signal to fit."""
    rng = np.random.default_rng(draw(SEEDS))
    k = np.array([draw(st.floats(-0.99, 0.99)), draw(st.floats(-0.9, 0.99))])
    lattice = LatticeSynthesis(Autoregression(k, 1.0), level=1.0).settle(rng)
    return lattice.process(rng.standard_normal(n)) + draw(st.sampled_from([0.0, 0.0, 3.0]))


@st.composite
def taps(draw):
    rng = np.random.default_rng(draw(SEEDS))
    t = np.arange(150) / 10_000.0
    f, B = draw(st.floats(150, 900)), draw(st.floats(20, 150))
    return np.exp(-B * t) * np.sin(2 * np.pi * f * t) + 0.01 * rng.standard_normal(t.size)


@st.composite
def blockings(draw, n=600):
    """Lengths of blocks, some of them empty, and the block in which the parameters start to change."""
    cuts = draw(st.lists(st.integers(0, n), max_size=12))
    return [slice(i, j) for i, j in zip([0, *sorted(cuts)], [*sorted(cuts), n], strict=True)]


# |k| < 1: a stable filter -----------------------------------------------------------------------------------


@given(reflections(), st.sampled_from([np.float64, np.float32]))
@examples(100)
def test_impulse_response_of_every_lattice_is_bounded_by_its_level(k, dtype):
    """The energy of the response is at most the power of the process, the square of the level."""
    impulse = np.eye(1, 1000)[0]
    h = LatticeSynthesis(Autoregression(k, 1.0), level=1.0, dtype=dtype).process(impulse).astype(np.float64)
    energy = np.cumsum(h**2)
    assert energy[-1] <= 1 + 1e-6
    assert np.abs(h).max() <= 1 + 1e-6


@given(_vectors(FINITE, 1, 60), st.integers(1, 80), st.sampled_from(["burg", "autocorrelation"]))
@examples(80)
def test_fit_of_any_finite_signal_is_stable_and_its_gain_below_the_signal(x, order, method):
    model = fit(x, order, method=method)
    assert np.abs(model.reflection).max() < 1
    assert 0 <= model.gain * (1 - 1e-12) <= np.abs(x).max()


# Gain law ---------------------------------------------------------------------------------------------------


def _parameters(model, names, level):
    """Return the parameters that do not depend on a gain, and those that are proportional to it."""
    return [np.asarray(getattr(model, name)) for name in names], np.asarray(getattr(model, level))


FITS = {
    "burg": lambda x, g: _parameters(fit(x, 8), ["reflection"], "residual"),
    "autocorrelation": lambda x, g: _parameters(
        fit(x, 8, method="autocorrelation", variance="yule_walker"), ["reflection"], "residual"
    ),
    "modified covariance": lambda x, g: _parameters(
        fit(x, 8, method="modified_covariance"), ["reflection"], "gain"
    ),
    "order": lambda x, g: _parameters(select_order(x, 20).model, ["reflection"], "gain"),
    "aicc": lambda x, g: _parameters(select_order(x, 20, criterion="aicc").model, ["reflection"], "gain"),
    "major frequencies": lambda x, g: _parameters(
        fit_major_frequencies(x, 1e4, n_frequencies=4), ["frequency_hz", "phase"], "amplitude"
    ),
}
TAP_FITS = {
    "pencil": lambda x, g: _parameters(
        fit_matrix_pencil(x, 1e4, order=4), ["frequency_hz", "decay_per_s", "phase"], "amplitude"
    ),
    "prony": lambda x, g: _parameters(fit_prony(x, 0.02 * g), ["a", "is_resolved"], "b"),
    "okamura": lambda x, g: _parameters(
        fit_okamura([x], [2.0], 1e4), ["frequency_hz", "decay_per_s"], "amplitude_slope"
    ),
    "tap model": lambda x, g: _parameters(
        fit_tap_model([x], [2.0], 1e4), ["frequency_hz", "decay_per_s"], "amplitude_slope"
    ),
}
CASES = [pytest.param(textures(), one, 5, id=name) for name, one in FITS.items()]
CASES += [pytest.param(taps(), one, 2, id=name) for name, one in TAP_FITS.items()]


@pytest.mark.parametrize(("signals", "parameters", "n_examples"), CASES)
def test_power_of_two_scales_every_model_exactly(signals, parameters, n_examples):
    @given(signals, EXPONENTS)
    @examples(n_examples)
    def holds(x, drawn):
        shape, level = parameters(x, 1.0)
        for exponent in (-530, 498, drawn):
            gain = 2.0**exponent
            scaled_shape, scaled = parameters(gain * x, gain)
            for plain, other in zip(shape, scaled_shape, strict=True):
                assert_array_equal(other, plain)
            assert_array_equal(scaled, gain * level)

    holds()


# Streams, and float32 ---------------------------------------------------------------------------------------


@given(reflections(), blockings(), SEEDS, st.sampled_from([np.float64, np.float32]))
@pytest.mark.parametrize("kind", [LatticeSynthesis, LatticeInverse])
@examples(60)
def test_lattice_output_does_not_depend_on_the_blocks(kind, k, pieces, seed, dtype):
    if kind is LatticeInverse:
        k = 0.9 * k
    rng = np.random.default_rng(seed)
    x, rows = rng.standard_normal(1200), np.linspace(k, rng.uniform(-0.9, 0.9, k.size), 600)
    levels = np.geomspace(1.0, 7.0, 600)

    def run(halves):
        lattice = kind(Autoregression(k, 1.0), level=1.0, dtype=dtype)
        out = [lattice.process(x[:600][piece]) for piece in halves]
        out += [lattice.process_varying(x[600:][piece], rows[piece], levels[piece]) for piece in halves]
        return np.concatenate([*out, lattice.process(x)])

    assert_array_equal(run(pieces), run([slice(0, 600)]))


@given(reflections(size=0.9, max_order=24), reflections(size=0.9, max_order=24), SEEDS)
@examples(60)
def test_inverse_filter_inverts_synthesis_while_parameters_change(k, other, seed):
    e = np.random.default_rng(seed).standard_normal(400)
    size = max(k.size, other.size)
    start, end = (np.pad(each, (0, size - each.size)) for each in (k, other))
    y = e
    for kind in (LatticeSynthesis, LatticeInverse):
        lattice = kind(Autoregression(start, 1.0), level=1e-3)
        y = lattice.process_varying(y, np.linspace(start, end, 400), np.geomspace(1e-3, 1e3, 400))
    bound = max(np.exp(np.arctanh(np.abs(each)).sum()) for each in (start, end))
    assert_allclose(y, e, rtol=0, atol=1e-13 * bound * size)
