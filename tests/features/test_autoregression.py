import numpy as np
import pytest
from feature_signals import noise
from numpy.typing import NDArray
from scipy import signal

from texclass.features.autoregression import (
    line_spectral_frequencies,
    log_area_ratios,
    lpc_cepstrum,
    mean_model,
    prediction_gain,
    resonances,
    upper_poles,
)
from texclass.features.phase_view import PhaseView
from texclass.vibration import Autoregression, line_spectrum

FS = 2000.0
FREQUENCY = np.array([120.0, 330.0, 640.0, 810.0])
BANDWIDTH = np.array([20.0, 40.0, 15.0, 30.0])
POLES = np.exp((-np.pi * BANDWIDTH + 2j * np.pi * FREQUENCY) / FS)
A = np.poly(np.concatenate([POLES, POLES.conj()])).real


PROCESS = signal.lfilter([1.0], A, noise(42_000))[2000:]
"""Process of order 8, 20 s at `FS`."""
VIEW = PhaseView(PROCESS, FS)


def test_resonances_recover_the_process() -> None:
    values = resonances(VIEW, n_resonances=4, order=8)
    np.testing.assert_allclose(values[:4], FREQUENCY, rtol=0.02)
    np.testing.assert_allclose(values[4:], BANDWIDTH, rtol=0.3)


def test_model_of_the_band_does_not_depend_on_the_sampling_rate() -> None:
    fast_view = PhaseView(signal.resample_poly(PROCESS, 5, 1), 5 * FS)
    assert mean_model(fast_view, 8, 0.25, 1000.0)[1] == pytest.approx(FS, rel=1e-4)
    np.testing.assert_allclose(resonances(fast_view)[:4], resonances(VIEW)[:4], rtol=0.02)


def test_prediction_gain_matches_the_process_and_rises_with_the_order() -> None:
    gain = prediction_gain(VIEW, orders=(1, 2, 4, 8))
    response = np.abs(signal.freqz([1.0], A, 1 << 16)[1]) ** 2
    assert gain[-1] == pytest.approx(10 * np.log10(response.mean()), abs=0.7)
    assert np.all(np.diff(gain) >= 0)


def test_all_parametrisations_describe_the_same_model() -> None:
    k = np.tanh(log_area_ratios(VIEW) / 2)
    lsf = line_spectral_frequencies(VIEW) * 2 * np.pi / FS
    np.testing.assert_allclose(line_spectrum.to_reflection(lsf), k, atol=1e-9)
    omega = np.linspace(0, np.pi, 4001)
    c = lpc_cepstrum(VIEW, n_coefficients=400)
    ln_h = np.cos(np.outer(omega, np.arange(1, 401))) @ c
    # 0.2 dB: the sharpest resonance has not decayed completely at c_400
    np.testing.assert_allclose(
        20 / np.log(10) * ln_h, Autoregression(k, 1.0).log_spectrum_db(omega), atol=0.2
    )


def test_one_fit_serves_all_features() -> None:
    view = PhaseView(PROCESS[:4000], FS)
    for feature in (line_spectral_frequencies, log_area_ratios, lpc_cepstrum, prediction_gain, resonances):
        feature(view)
    assert sum(key[0].__name__ == "mean_model" for key in view.memory) == 1


def test_loud_and_quiet_frames_have_equal_weight_and_silent_frames_are_skipped() -> None:
    x = PROCESS[:8000]
    with_pause = log_area_ratios(PhaseView(np.concatenate([x, np.zeros(x.size)]), FS))
    without_pause = log_area_ratios(PhaseView(x, FS))
    np.testing.assert_allclose(with_pause, without_pause, atol=1e-9)
    noise_frames = noise(x.size, 1)
    equal = log_area_ratios(PhaseView(np.concatenate([x, noise_frames]), FS))
    unequal = log_area_ratios(PhaseView(np.concatenate([x, 1e-3 * noise_frames]), FS))
    np.testing.assert_allclose(unequal, equal, atol=1e-6)


def test_poles_are_ordered_pairs_first_and_by_frequency() -> None:
    z: NDArray[np.complex128] = np.array([0.9, 0.5j, -0.5j, 0.2 + 0.6j, 0.2 - 0.6j, 0.0])
    np.testing.assert_allclose(upper_poles(z, 2), [0.2 + 0.6j, 0.5j])
    np.testing.assert_allclose(upper_poles(z, 3), [0.9, 0.2 + 0.6j, 0.5j])
