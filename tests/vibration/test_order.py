import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import signal

from texclass.vibration.autoregressive import fit
from texclass.vibration.order import N_DFT, aicc, select_order, spectral_error

POLES = np.array([0.95 * np.exp(0.5j), 0.9 * np.exp(1.5j)])


def _process(n=50_000, seed=0):
    a = np.poly(np.concatenate([POLES, POLES.conj()])).real
    return signal.lfilter([1.0], a, np.random.default_rng(seed).standard_normal(n))


def test_order_of_a_known_process_is_found():
    x = _process()
    for method in ("burg", "autocorrelation"):
        model = fit(x, 60, method=method)
        for criterion in ("spectral_error", "aicc"):
            chosen = select_order(x, 60, criterion=criterion, method=method)
            assert 4 <= chosen.order <= 6
            assert chosen.met
            assert chosen.values.shape == (61,)
            assert_array_equal(chosen.model.reflection, model.reflection[: chosen.order])


def test_spectral_error_refuses_one_bad_sample():
    with pytest.raises(ValueError, match="finite samples"):
        spectral_error(np.array([1.0, np.nan, 2.0]), fit([1.0, 2.0, 3.0, 1.0], 1))
    with pytest.raises(ValueError, match="equal leading shapes"):
        spectral_error(np.ones((2, 8)), fit([1.0, 2.0, 3.0, 1.0], 1))


def test_spectral_error_is_the_printed_ratio_of_magnitudes():
    x = _process(N_DFT)
    model = fit(x, 10)
    measured = np.abs(np.fft.fft(x, N_DFT))
    for m in (0, 4, 10):
        response = signal.freqz([model.residual[m]], model.truncated(m).direct_form(), N_DFT, whole=True)[1]
        error = np.sqrt(np.mean((measured - np.abs(response) * np.sqrt(N_DFT)) ** 2) / np.mean(measured**2))
        assert_allclose(spectral_error(x, model)[m], error, rtol=1e-10)


def test_smallest_order_that_meets_an_error_is_taken_or_the_one_of_the_least():
    x = _process()
    chosen = select_order(x, 60, at_most=0.2)
    assert chosen.met
    assert np.all(chosen.values[: chosen.order] > 0.2)
    assert chosen.values[chosen.order] <= 0.2
    assert select_order(x, 60, at_most=10.0).order == 0
    unmet = select_order(x, 30, at_most=1e-6)
    assert not unmet.met
    assert unmet.order == np.argmin(unmet.values)


def test_aicc_is_its_equation():
    x = _process(200)
    model = fit(x, 198)
    m = np.arange(198)
    expected = 200 * np.log(model.residual[:198] ** 2) + 2 * 200 * (m + 1) / (200 - m - 2)
    assert_allclose(aicc(model, 200)[:198], expected)
    assert np.isposinf(aicc(model, 200)[198])


def test_silence_has_order_zero_and_a_constant_one_at_most():
    for criterion in ("spectral_error", "aicc"):
        assert select_order(np.zeros(500), 20, criterion=criterion).order == 0
        assert select_order(np.full(500, 2.0), 20, criterion=criterion).order == 1


def test_frames_share_one_order():
    frames = np.stack([_process(5000, seed) for seed in range(4)])
    chosen = select_order(frames, 30, criterion="aicc")
    assert 4 <= chosen.order <= 8
    assert chosen.model.reflection.shape == (4, chosen.order)
    assert_allclose(chosen.values, np.mean([aicc(fit(f, 30), 5000) for f in frames], axis=0))
