import numpy as np
import pytest

from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import PhaseView
from texclass.features.related_work import (
    discretized_spectrogram,
    gaussian_band_energies,
    spectral_centroid,
    spectral_peaks,
)
from texclass.recording import Samples

FS = 10_000.0


def noise(n: int = 50_000, seed: int = 0) -> Samples:
    x = np.random.default_rng(seed).standard_normal(n)
    return np.asarray(x - x.mean())


def tone(f_hz: float, n: int = 50_000) -> Samples:
    return np.asarray(np.sin(2 * np.pi * f_hz * np.arange(n) / FS))


@pytest.mark.parametrize("f_hz", [50.0, 321.0, 555.5])
def test_spectral_centroid_of_a_sine_is_its_frequency(f_hz: float) -> None:
    assert spectral_centroid(PhaseView(tone(f_hz), FS)) == pytest.approx(f_hz, abs=1)


def test_spectral_centroid_does_not_hear_above_600_hz() -> None:
    both = PhaseView(tone(200.0) + 10 * tone(2000.0), FS)
    assert spectral_centroid(both) == pytest.approx(200, abs=1)


def test_energy_of_a_tone_lies_in_the_nearest_band() -> None:
    centre = np.geomspace(20, 1400, 30)
    for b in (0, 10, 29):
        energies = gaussian_band_energies(PhaseView(tone(centre[b]), FS))
        assert int(np.argmax(energies)) == b
        assert energies[b] == pytest.approx(0.5, rel=0.1)  # mean square of a unit sine, at the bin's peak


def test_band_energy_of_white_noise_is_its_density_times_the_width_of_the_bin() -> None:
    energies = gaussian_band_energies(PhaseView(noise(400_000), FS))
    centre = np.geomspace(20, 1400, 30)
    width = centre * (centre[1] / centre[0] - 1) / 2 * np.sqrt(2 * np.pi)
    np.testing.assert_allclose(energies[5:], width[5:] * 2 / FS, rtol=0.25)


def test_spectrogram_shows_when_and_where() -> None:
    x = np.concatenate([tone(100.0, 25_000), tone(1200.0, 25_000)]) + 1e-3 * noise()
    cells = discretized_spectrogram(PhaseView(x, FS)).reshape(25, 5)
    assert (np.argmax(cells[:12], axis=1) == 0).all()
    assert (np.argmax(cells[13:], axis=1) == 4).all()


def test_spectrogram_of_white_noise_is_flat_at_its_density() -> None:
    cells = discretized_spectrogram(PhaseView(noise(250_000), FS))
    assert cells.mean() == pytest.approx(np.log10(2 / FS), abs=0.02)


def test_peaks_are_the_tones_in_order_of_their_power() -> None:
    tones = (300.0, 900.0, 120.0, 600.0, 1200.0)
    x = sum((5.0 - i) * tone(f) for i, f in enumerate(tones)) + 0.1 * noise()
    np.testing.assert_allclose(spectral_peaks(PhaseView(np.asarray(x), FS)), tones, atol=11)


def test_fewer_peaks_than_asked_for_is_the_reason() -> None:
    with pytest.raises(UndefinedFeatureError, match=r"peaks in the spectral envelope; the rule is 600"):
        spectral_peaks(PhaseView(noise(), FS), n_peaks=600)
