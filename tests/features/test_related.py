import numpy as np
import pytest
import pywt
from scipy import signal

from texclass.features.phase_view import PhaseView
from texclass.features.related_work import (
    lpc_coefficients,
    mean_magnitude,
    standard_roughness,
    variance,
    wavelet_energy,
)
from texclass.recording import Samples
from texclass.signals import highpass_fir

FS = 10_000.0


def noise(n: int = 50_000, seed: int = 0) -> Samples:
    x = np.random.default_rng(seed).standard_normal(n)
    return np.asarray(x - x.mean())


def test_power_magnitude_and_variance_are_those_of_numpy() -> None:
    x = 3 * noise()
    view = PhaseView(x, FS)
    assert standard_roughness(view) == pytest.approx(np.mean(x**2))
    assert variance(view) == pytest.approx(np.var(x))
    assert mean_magnitude(view) == pytest.approx(np.mean(np.abs(x)))


@pytest.mark.parametrize("order", [2, 10])
def test_lpc_recovers_a_known_process(order: int) -> None:
    angles = np.linspace(0.3, 2.6, order // 2)
    poles = np.concatenate([0.8 * np.exp(1j * angles), 0.8 * np.exp(-1j * angles)])
    a = np.poly(poles).real
    x = signal.lfilter([1.0], a, noise(200_000))
    np.testing.assert_allclose(lpc_coefficients(PhaseView(x, FS), order=order), -a[1:], atol=0.02)


def test_lpc_names_follow_the_order() -> None:
    from texclass.features.contract import find

    assert find("lpc_coefficients").columns("lpc", {"order": 2}) == ("lpc.a1", "lpc.a2")


def test_wavelet_energy_is_that_of_the_details_of_pywt() -> None:
    x = noise(20_000)
    details = pywt.wavedec(highpass_fir(x, 100.0, FS), "coif3", level=5)[1:]
    expected = sum(np.sum(d**2) for d in details) / x.size
    assert wavelet_energy(PhaseView(x, FS)) == pytest.approx(expected, rel=2e-3)
