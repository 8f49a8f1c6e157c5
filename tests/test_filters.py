import numpy as np
import pytest
from numpy.testing import assert_allclose

from texclass.signals import bandpass, butterworth, causal, highpass, highpass_fir, lowpass, zero_phase

FS = 10_000.0


def _axes(n, c=3, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n, c)).cumsum(axis=0) * 0.1 + np.arange(c) * 9.81


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
        (lambda x: highpass_fir(x, 100.0, FS), 400.0, 1.0),
        (lambda x: highpass_fir(x, 100.0, FS), 100.0, 0.5),
        (lambda x: highpass_fir(x, 100.0, FS), 20.0, 0.0),
    ],
)
def test_filter_passes_a_sine_undelayed_with_its_gain(filtered, hz, gain):
    middle = slice(5000, 15_000)
    assert_allclose(filtered(_sine(hz))[middle], gain * _sine(hz)[middle], atol=4e-3)


@pytest.mark.parametrize(
    "filtered",
    [lambda x: lowpass(x, 100.0, FS), lambda x: highpass(x, 100.0, FS), lambda x: highpass_fir(x, 100.0, FS)],
)
@pytest.mark.parametrize("n", [1, 2, 5, 40, 1000])
def test_filter_takes_signals_of_any_length_and_keeps_a_constant_apart(filtered, n):
    found = filtered(np.full(n, 1e3))
    assert found.shape == (n,)
    assert np.ptp(found) < 1e-6
    assert np.isclose(found[0], 0.0, atol=1e-6) or np.isclose(found[0], 1e3, atol=1e-6)


def test_zero_phase_filters_each_axis_by_itself():
    axes = _axes(3000)
    sos = butterworth("highpass", 100.0, FS)
    assert_allclose(zero_phase(sos, axes)[:, 1], zero_phase(sos, axes[:, 1]), atol=1e-10)


@pytest.mark.parametrize("shape", [(2000,), (2000, 3)])
def test_causal_filter_gives_the_same_in_pieces(shape):
    x = np.random.default_rng(0).standard_normal(shape) + 9.81
    sos = butterworth("bandpass", (20.0, 900.0), FS)
    whole, _ = causal(sos, x)
    state, pieces = None, []
    for piece in np.split(x, [1, 7, 900, 901]):
        filtered, state = causal(sos, piece, state)
        pieces.append(filtered)
    assert_allclose(np.concatenate(pieces), whole, atol=1e-12)


def test_causal_filter_responds_to_nothing_before_it_happens_and_not_to_a_constant():
    x = np.full(1000, 9.81)
    x[600] += 1.0
    filtered, _ = causal(butterworth("highpass", 50.0, FS), x)
    assert np.abs(filtered[:600]).max() < 1e-9 < np.abs(filtered[600])


@pytest.mark.parametrize("cutoff", [5000.0, 6000.0, 0.0, -1.0, float("nan")])
@pytest.mark.parametrize("make", [lowpass, highpass, highpass_fir])
def test_cutoff_outside_the_band_is_named_with_the_rule(make, cutoff):
    with pytest.raises(ValueError, match=rf"cut-off is {cutoff:g} Hz at fs = 10000 Hz.*fs/2 = 5000 Hz"):
        make(np.zeros(100), cutoff, FS)


@pytest.mark.parametrize("band", [(800.0, 200.0), (200.0, 200.0), (200.0, 5000.0)])
def test_band_with_wrong_edges_is_named(band):
    with pytest.raises(ValueError, match="the edges of a band rising"):
        bandpass(np.zeros(100), band, FS)


def test_fir_transition_width_is_checked():
    with pytest.raises(ValueError, match=r"transition_hz is -3\.0"):
        highpass_fir(np.zeros(100), 100.0, FS, transition_hz=-3.0)
