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


def test_order_of_an_autoregressive_process_is_recovered():
    x = _process()
    for method in ("burg", "autocorrelation"):
        model = fit(x, 60, method=method)
        for criterion in ("spectral_error", "aicc"):
            selection = select_order(x, 60, criterion=criterion, method=method)
            assert 4 <= selection.order <= 6
            assert selection.is_met
            assert selection.values.shape == (61,)
            assert_array_equal(selection.model.reflection, model.reflection[: selection.order])


def test_spectral_error_rejects_nan_and_unequal_shapes():
    with pytest.raises(ValueError, match="finite samples"):
        spectral_error(np.array([1.0, np.nan, 2.0]), fit([1.0, 2.0, 3.0, 1.0], 1))
    with pytest.raises(ValueError, match="equal leading shapes"):
        spectral_error(np.ones((2, 8)), fit([1.0, 2.0, 3.0, 1.0], 1))


def test_spectral_error_is_the_printed_ratio_of_magnitudes():
    x = _process(N_DFT)
    model = fit(x, 10)
    measured = np.abs(np.fft.fft(x, N_DFT))
    for m in (0, 4, 10):
        response = signal.freqz([model.residual[m]], model.truncate(m).direct_form(), N_DFT, whole=True)[1]
        error = np.sqrt(np.mean((measured - np.abs(response) * np.sqrt(N_DFT)) ** 2) / np.mean(measured**2))
        assert_allclose(spectral_error(x, model)[m], error, rtol=1e-10)


def test_smallest_order_within_max_error_is_selected_or_the_best_if_none_is():
    x = _process()
    selection = select_order(x, 60, max_error=0.2)
    assert selection.is_met
    assert np.all(selection.values[: selection.order] > 0.2)
    assert selection.values[selection.order] <= 0.2
    assert select_order(x, 60, max_error=10.0).order == 0
    best = select_order(x, 30, max_error=1e-6)
    assert not best.is_met
    assert best.order == np.argmin(best.values)


def test_aicc_equals_its_formula():
    x = _process(200)
    model = fit(x, 198)
    m = np.arange(198)
    expected = 200 * np.log(model.residual[:198] ** 2) + 2 * 200 * (m + 1) / (200 - m - 2)
    assert_allclose(aicc(model, 200)[:198], expected)
    assert np.isposinf(aicc(model, 200)[198])


def test_silence_has_order_zero_and_a_constant_order_one():
    for criterion in ("spectral_error", "aicc"):
        assert select_order(np.zeros(500), 20, criterion=criterion).order == 0
        assert select_order(np.full(500, 2.0), 20, criterion=criterion).order == 1


def test_frames_share_one_order():
    frames = np.stack([_process(5000, seed) for seed in range(4)])
    selection = select_order(frames, 30, criterion="aicc")
    assert 4 <= selection.order <= 8
    assert selection.model.reflection.shape == (4, selection.order)
    assert_allclose(selection.values, np.mean([aicc(fit(f, 30), 5000) for f in frames], axis=0))
