"""Features of related work, fineness and decaying segments, on signals with known values."""

import numpy as np
import pytest
import pywt
from feature_signals import FS, noise, tone
from scipy import ndimage, signal

from texclass.features import decaying_segments as segments
from texclass.features import fineness as fine
from texclass.features import related_work as work
from texclass.features.phase_view import PhaseView


def view(x):
    return PhaseView(np.asarray(x), FS)


NOISE = noise(50_000) - noise(50_000).mean()


def test_power_magnitude_and_variance_equal_those_of_numpy():
    x = 3 * NOISE
    assert work.standard_roughness(view(x)) == pytest.approx(np.mean(x**2))
    assert work.variance(view(x + 1)) == pytest.approx(np.var(x))
    assert work.mean_magnitude(view(x)) == pytest.approx(np.mean(np.abs(x)))


def test_lpc_recovers_a_known_process():
    for order in (2, 10):
        poles = 0.8 * np.exp(1j * np.linspace(0.3, 2.6, order // 2))
        a = np.poly([*poles, *poles.conj()]).real
        x = signal.lfilter([1.0], a, noise(200_000))
        np.testing.assert_allclose(work.lpc_coefficients(view(x), order=order), -a[1:], atol=0.02)


def test_wavelet_energy_equals_that_of_pywt():
    x = noise(20_000)
    low = signal.firwin(331, 100.0, fs=FS)
    details = pywt.wavedec(x - ndimage.convolve1d(x, low), "coif3", level=5)[1:]
    assert work.wavelet_energy(view(x)) == pytest.approx(
        sum(np.sum(d**2) for d in details) / x.size, rel=2e-3
    )


def test_spectral_centroid_of_a_sine_is_its_frequency_in_a_band_up_to_600_hz():
    for f_hz in (50.0, 321.0, 555.5):
        assert work.spectral_centroid(view(tone(f_hz))) == pytest.approx(f_hz, abs=1)
    assert work.spectral_centroid(view(tone(200) + 10 * tone(2000))) == pytest.approx(200, abs=1)


def test_a_tone_is_in_the_nearest_band_and_noise_energy_is_proportional_to_bandwidth():
    centre = np.geomspace(20, 1400, 30)
    for b in (0, 10, 29):
        energies = work.gaussian_band_energies(view(tone(centre[b])))
        assert int(np.argmax(energies)) == b
        assert energies[b] == pytest.approx(0.5, rel=0.1)  # mean square of a unit sine, at the bin's peak
    width = centre * (centre[1] / centre[0] - 1) / 2 * np.sqrt(2 * np.pi)
    energies = work.gaussian_band_energies(view(noise(400_000)))
    np.testing.assert_allclose(energies[5:], width[5:] * 2 / FS, rtol=0.25)


def test_spectrogram_resolves_time_and_frequency_and_is_flat_for_noise():
    x = np.concatenate([tone(100, 25_000), tone(1200, 25_000)]) + 1e-3 * NOISE
    cells = work.discretized_spectrogram(view(x)).reshape(25, 5)
    assert (np.argmax(cells[:12], axis=1) == 0).all()
    assert (np.argmax(cells[13:], axis=1) == 4).all()
    cells = work.discretized_spectrogram(view(noise(250_000)))
    assert cells.mean() == pytest.approx(np.log10(2 / FS), abs=0.02)


def test_peaks_are_the_tones_in_order_of_their_power():
    tones = (300.0, 900.0, 120.0, 600.0, 1200.0)
    x = sum((5.0 - i) * tone(f) for i, f in enumerate(tones)) + 0.1 * NOISE
    np.testing.assert_allclose(work.spectral_peaks(view(x)), tones, atol=11)
    # The band ends with the bin at its end: a peak in the second last bin has a neighbour there.
    assert work.spectral_peaks(view(tone(300.5)), n_peaks=1, smooth_hz=1, high_hz=301.5) == 300.5


def test_fineness_of_a_sine_is_its_frequency_and_spread_of_two_is_half_their_distance():
    for f_hz in (50.0, 432.1, 1400.0, 4000.0):
        assert fine.fineness(view(tone(f_hz, 40_960))) == pytest.approx(f_hz, rel=1e-3)
        assert fine.fineness_spread(view(tone(f_hz, 40_960))) < 3
    two_tones = view(tone(1000, 40_960) + tone(3000, 40_960))
    assert fine.fineness_spread(two_tones) == pytest.approx(1000, rel=1e-3)


def test_printed_fineness_is_equation_2_and_stops_at_a_quarter_of_the_rate():
    x, centroids = noise(128), []
    for frame in x.reshape(2, 64):
        n, k = np.arange(64), np.arange(1, 33)
        spectrum = np.cos(np.pi * k[:, np.newaxis] * (n + 0.5) / 64) @ frame
        centroids.append(sum(k * spectrum**2) / sum(spectrum**2))
    assert fine.fineness_as_printed(view(x), length=64) == pytest.approx(np.mean(centroids), rel=1e-5)
    assert fine.fineness_as_printed(view(tone(500, 40_960))) == pytest.approx(2 * 4096 * 500 / FS, rel=0.01)
    two_tones = view(tone(1000, 40_960) + tone(4000, 40_960))
    assert fine.fineness_as_printed(two_tones) == pytest.approx(2 * 4096 * 1000 / FS, rel=0.02)
    assert fine.fineness(two_tones) == pytest.approx(2500, rel=1e-3)


def ridges(rate, duration_s=5.0):
    """Return a mode of 200 Hz that is excited `rate` times per second."""
    t = np.arange(round(duration_s * FS)) / FS
    excitation = np.zeros(t.size)
    excitation[(np.arange(int(duration_s * rate)) * FS / rate).astype(int)] = 1.0
    ring = np.exp(-150 * t[:500]) * np.sin(2 * np.pi * 200 * t[:500])
    return view(signal.fftconvolve(excitation, ring)[: t.size])


def test_segment_rate_is_the_rate_of_impacts_and_faster_impacts_have_fewer_peaks():
    for rate in (10.0, 20.0, 32.0):
        assert segments.segment_rate(ridges(rate)) == pytest.approx(rate, rel=0.05)
    assert segments.segment_peaks(ridges(40.0)) < segments.segment_peaks(ridges(10.0))


def test_major_frequency_is_the_centre_of_a_band_below_the_cut_off():
    sos = signal.butter(2, (250, 350), "bandpass", fs=FS, output="sos")
    hump = view(signal.sosfilt(sos, noise(100_000)))
    assert segments.major_frequency(hump) == pytest.approx(300, abs=15)
    assert 350 < segments.upper_cutoff(hump) < 600


def test_band_passed_movement_has_unit_deviation():
    samples, fs = segments.band_passed_unit(view(tone(100) + 3 * tone(0.8) + 0.01 * tone(1900)), 15.0, 30.0)
    f, power = signal.periodogram(samples, fs)
    assert samples.std() == pytest.approx(1)
    assert power[np.abs(f - 100) < 5].sum() > 0.95 * power.sum()


def test_a_finer_resolution_needs_a_higher_order():
    orders = [segments.segment_order(view(noise(20_000)), resolution=r) for r in (0.5, 0.2, 0.1)]
    assert orders == sorted(orders)
    assert orders[0] < orders[-1]
