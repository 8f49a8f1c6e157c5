import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import linalg, signal

from texclass.stability.inputs import low_passed
from texclass.vibration import recursions
from texclass.vibration.autoregressive import Autoregression, fit, from_autocorrelation, from_direct_form

METHODS = ["autocorrelation", "burg", "modified_covariance"]
POLES = np.array([0.95 * np.exp(0.5j), 0.9 * np.exp(1.5j), 0.8 * np.exp(2.6j)])
LARGEST = np.nextafter(1.0, 0.0)


def _noise(n, seed=0):
    return np.random.default_rng(seed).standard_normal(n)


def _process(n=100_000, gain=1.0, seed=0):
    a = np.poly(np.concatenate([POLES, POLES.conj()])).real
    return signal.lfilter([gain], a, _noise(n + 1000, seed))[1000:], a


# The fits ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_every_method_recovers_a_process_and_yule_walker_variance_preserves_its_power(method):
    x, a = _process(gain=0.3)
    model = fit(x, 6, method=method)
    assert_allclose(model.direct_form(), a, atol=0.02)
    assert_allclose(model.gain, 0.3, rtol=0.01)
    recovered = model.poles()
    for pole in POLES:
        assert np.abs(recovered - pole).min() < 0.01
    yule_walker = fit(x, 18, method=method, variance="yule_walker")
    assert_allclose(yule_walker.level, np.sqrt(np.mean(x**2)), rtol=1e-12)


def test_autocorrelation_method_agrees_with_solve_toeplitz():
    x, _ = _process(5000)
    for order in (1, 5, 18, 100):
        model = fit(x, order, method="autocorrelation")
        r = np.correlate(x, x, "full")[x.size - 1 :][: order + 1] / x.size
        a = linalg.solve_toeplitz(r[:-1], -r[1:])
        assert_allclose(model.direct_form()[1:], a, atol=1e-10)
        assert_allclose(model.gain**2, r[0] + r[1:] @ a, rtol=1e-9)


def test_autocorrelation_method_is_accurate_where_levinson_is_not():
    """The k of a windowed, oversampled signal minimise the residual of the padded signal."""
    x = np.hanning(4000) * low_passed(20, 4000)
    model = fit(x, 50, method="autocorrelation")
    f = b = np.concatenate([np.zeros(50), x, np.zeros(50)])
    for k in model.reflection:
        f, b = f[1:], b[:-1]
        assert_allclose(k, -(f @ b) * 2 / (f @ f + b @ b), atol=1e-6)
        f, b = f + k * b, b + k * f
    assert_allclose(model.gain, np.sqrt((f @ f + b @ b) / (2 * x.size)), rtol=1e-6)


def test_modified_covariance_solves_the_least_squares_problem():
    x, p = _process(3000)[0], 12
    model = fit(x, p, method="modified_covariance")
    rows = np.lib.stride_tricks.sliding_window_view(x, p + 1)
    rows = np.concatenate([rows[:, ::-1], rows])
    a = np.linalg.lstsq(rows[:, 1:], -rows[:, 0])[0]
    assert_allclose(model.direct_form()[1:], a, atol=1e-10)
    assert_allclose(model.gain, np.sqrt(np.mean((rows[:, 0] + rows[:, 1:] @ a) ** 2)), rtol=1e-10)


@pytest.mark.parametrize("x", [np.full(50, 2.0), 1.3 ** np.arange(30), _noise(6)])
def test_modified_covariance_falls_back_to_burg_and_sets_is_fallback(x):
    model, expected = fit(x, 8, method="modified_covariance"), fit(x, 8)
    assert model.is_fallback
    assert not expected.is_fallback
    assert_array_equal(model.reflection, expected.reflection)
    assert_array_equal(model.gain, expected.gain)


@pytest.mark.parametrize("method", METHODS)
def test_a_stack_of_frames_equals_its_frames(method):
    frames = np.stack([_process(500, seed=s)[0] for s in range(3)] + [np.zeros(500), np.ones(500)])
    for variance in ("residual", "yule_walker"):
        stack = fit(frames, 10, method=method, variance=variance)
        assert stack.reflection.shape == (5, 10)
        for row, frame in enumerate(frames):
            single = fit(frame, 10, method=method, variance=variance)
            assert_allclose(stack.reflection[row], single.reflection, atol=1e-13)
            assert_allclose(stack.residual[row], single.residual, rtol=1e-12)
            assert_allclose(stack.gain[row], single.gain, rtol=1e-12)
            assert stack.is_clipped[row] == single.is_clipped
            assert stack.is_fallback[row] == single.is_fallback


def test_a_constant_is_predicted_by_one_clipped_coefficient():
    model = fit(np.full(100, 5.0), 10)
    assert_array_equal(model.reflection, np.concatenate([[-LARGEST], np.zeros(9)]))
    assert model.is_clipped
    assert model.fitted_order == 1
    assert 0 < model.gain < 5 * 2.0**-50
    yule_walker = fit(np.full(100, 5.0), 10, variance="yule_walker")
    assert_allclose(yule_walker.level, 5.0)
    padded = fit(np.full(100, 5.0), 10, method="autocorrelation")
    assert_allclose(padded.reflection[0], -99 / 100)
    assert fit(np.zeros(100), 10, method="autocorrelation").fitted_order == 0


# What follows from a model ----------------------------------------------------------------------------------


def test_from_autocorrelation_inverts_the_autocorrelation_of_a_model():
    model = fit(_process()[0], 6)
    impulse = signal.lfilter([1.0], model.direct_form(), np.eye(1, 4000)[0]) * model.gain
    r = np.correlate(impulse, impulse, "full")[3999:][:7]
    recovered = from_autocorrelation(r)
    assert_allclose(recovered.reflection, model.reflection, atol=1e-9)
    assert_allclose(recovered.gain, model.gain, rtol=1e-8)
    assert_allclose(recovered.level, model.level, rtol=1e-8)
    assert_allclose(from_autocorrelation([4.0]).gain, 2.0)  # of order 0


def test_truncate_equals_the_fit_of_the_lower_order():
    x = _process(3000)[0]
    for method in ("burg", "autocorrelation"):
        low, high = fit(x, 4, method=method), fit(x, 30, method=method)
        assert_allclose(high.truncate(4).reflection, low.reflection, atol=1e-14)
        assert_allclose(high.truncate(4).gain, low.gain, rtol=1e-12)
    cut = Autoregression([0.5, 0.5, LARGEST, 0.5], 1.0)
    assert [bool(cut.truncate(order).is_clipped) for order in (2, 3, 4)] == [False, True, True]


def test_direct_form_raises_where_rounding_changes_the_filter():
    for good, atol in ((fit(_process()[0], 6), 1e-12), (Autoregression(np.full(10, 0.9), 1.0), 1e-6)):
        assert_allclose(from_direct_form(good.direct_form(), 1.0).reflection, good.reflection, atol=atol)
    with pytest.raises(ValueError, match="Use the lattice"):
        Autoregression(np.full(400, 0.9), 1.0).direct_form()
    with pytest.raises(ValueError, match="Use the lattice"):
        fit(low_passed(20, 20_000), 100).direct_form()


def test_log_spectrum_is_accurate_next_to_a_pole_on_the_unit_circle():
    for gap in (1e-3, 1e-9, 1e-12):
        theta, radius = 0.3, 1 - gap
        model = Autoregression([-2 * radius * np.cos(theta) / (1 + radius**2), radius**2], 1.0)
        (peak,) = model.log_spectrum_db([theta])
        assert_allclose(peak, -20 * np.log10(gap * abs(1 - radius * np.exp(-2j * theta))), atol=0.01)


def test_cepstrum_of_a_stack_equals_that_of_each_model_and_starts_with_the_log_gain():
    assert_allclose(Autoregression([0.5], 3.0).cepstrum(1), [np.log(3)])
    stack = Autoregression(np.array([[0.3, -0.5], [0.9, 0.2], [-0.1, 0.4]]), np.array([1.0, 2.0, 3.0]))
    for row, one in enumerate(zip(stack.reflection, stack.gain, strict=True)):
        assert_allclose(stack.cepstrum(6)[row], Autoregression(*one).cepstrum(6), atol=1e-14)


def test_area_ratios_level_and_prediction_gain_match_their_formulas():
    k, gain = np.array([[-0.9, 0.5, 1 - 1e-15], [0.0, 0.1, -0.2]]), np.array([2.0, 1e-160])
    model = Autoregression(k, gain)
    assert_allclose(np.tanh(model.log_area_ratios / 2), k, atol=1e-15)
    assert_allclose(model.prediction_gain_db, -10 * np.log10((1 - k) * (1 + k)).sum(axis=1), rtol=1e-12)
    assert_allclose(20 * np.log10(model.level / gain), model.prediction_gain_db, rtol=1e-12)
    assert_allclose(model.log_gain, np.log(gain))
    assert_allclose(Autoregression(np.full(1000, 0.9), 1.0).prediction_gain_db, -1e4 * np.log10(0.19))


def test_a_model_is_read_only():
    k = np.array([0.5])
    model = Autoregression(k, np.asarray(1.0))
    k[0] = 2.0
    assert model.reflection[0] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        model.reflection[0] = 0.1


@pytest.mark.parametrize("method", ["burg", "modified_covariance"])
def test_burg_is_equal_with_and_without_numba(method, monkeypatch):
    rng = np.random.default_rng(0)
    steady, ramp = rng.standard_normal(500), rng.standard_normal(500).cumsum()
    frames = np.stack([steady, np.zeros(500), np.ones(500), ramp])
    compiled = fit(frames, 18, method=method)
    monkeypatch.delitem(sys.modules, "numba")
    plain = fit(frames, 18, method=method)
    assert_allclose(plain.reflection, compiled.reflection, atol=1e-12)
    assert_allclose(plain.residual, compiled.residual, rtol=1e-12)
    assert_array_equal(plain.fitted_order, compiled.fitted_order)
    assert_array_equal(plain.is_clipped, compiled.is_clipped)


def test_log_magnitude_equals_the_last_order_of_log_magnitudes():
    omega = np.linspace(0, np.pi, 60)
    for order, largest in ((0, 0.5), (1, 0.9), (16, 0.9), (127, 0.9), (1000, 1 - 1e-9)):
        k = largest * np.sign(np.random.default_rng(order).uniform(-1, 1, order))
        expected = recursions.log_magnitudes(k, omega)[-1]
        assert_allclose(recursions.log_magnitude(k, omega), expected, rtol=1e-9, atol=1e-9)


def test_unit_spectra_equal_those_of_log_magnitudes_at_every_order():
    omega = np.linspace(0, np.pi, 60)
    for order, largest in ((0, 0.5), (1, 0.9), (16, 0.9), (400, 0.3), (100, 1 - 1e-9)):
        k = largest * np.random.default_rng(order).uniform(-1, 1, order)
        ln_g2 = np.concatenate([[0.0], np.cumsum(np.log1p(-(k**2)))])
        expected = ln_g2[:, np.newaxis] - 2 * recursions.log_magnitudes(k, omega)
        assert_allclose(np.log(recursions.unit_spectra(k, omega)), expected, rtol=1e-9, atol=1e-9)
