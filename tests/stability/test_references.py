"""Tests of the references against each other and against libraries that are exact."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import fft, linalg, signal

from texclass import vibration
from texclass.stability import references
from texclass.stability.inputs import plain
from texclass.vibration import line_spectrum

X = plain(300)
K = np.random.default_rng(0).uniform(-0.8, 0.8, 8)


def test_moving_averages_are_exact():
    assert_allclose(references.moving_average(X, 1), X, rtol=0)
    assert_allclose(
        references.moving_average(X, 9)[4:-4], np.convolve(X, np.ones(9) / 9, "valid"), atol=1e-14
    )
    assert_allclose(references.moving_average(np.array([1e300, 1.0, -1e300]), 5), 1 / 3, rtol=1e-15)


def test_fixed_point_and_80_bit_references_of_burg_agree():
    if not references.EXTENDED:
        pytest.skip("no 80-bit floats on this machine")
    extended = references.burg_energies(X, references.MAX_FIXED_POINT_ORDER + 1)
    assert_allclose(references.burg_energies(X, 40), extended[:41], rtol=1e-15)


def test_the_optimum_of_the_autocorrelation_method_solves_the_normal_equations():
    r = np.array([X[i:] @ X[: X.size - i] for i in range(19)])
    a = linalg.solve_toeplitz(r[:-1], -r[1:])
    energies = references.burg_energies(np.pad(X, 18), 18)
    assert_allclose(energies[-1], (r[0] + a @ r[1:]) / r[0], rtol=1e-10)


def test_the_optimum_equals_the_residual_of_its_coefficients():
    model = vibration.fit(X, 12)
    energies = references.lattice_energies(X, model.reflection)
    assert_allclose(energies, references.burg_energies(X, 12), rtol=1e-12)
    assert_allclose(references.direct_energy(X, model.direct_form()), energies[-1], rtol=1e-12)


def test_step_down_inverts_step_up():
    pytest.importorskip("mpmath")
    assert_allclose(references.step_down(references.coefficients(K)), K, rtol=1e-12)
    assert np.isnan(references.step_down(np.array([1.0, 0.0, 1.0000001]))).any()


def test_model_references_agree_with_polynomials():
    pytest.importorskip("mpmath")
    a = references.coefficients(K).astype(float)
    omega = np.array([0.1, 1.0, 3.0])
    response = signal.freqz(1.0, a, worN=omega)[1]
    assert_allclose(references.log_spectrum_db(K, omega), 20 * np.log10(np.abs(response)), atol=1e-10)
    impulse = np.eye(1, 50)[0]
    assert_allclose(references.all_pole_response(K, impulse), signal.lfilter([1.0], a, impulse), atol=1e-12)
    spectrum = np.log(np.abs(1 / np.fft.fft(a, 8192)))
    assert_allclose(references.cepstrum(K, 10), 2 * np.fft.ifft(spectrum).real[1:10], atol=1e-12)


def test_an_error_of_a_line_spectral_frequency_is_measured():
    pytest.importorskip("mpmath")
    lsf = line_spectrum.from_reflection(K)
    assert references.line_spectrum_error(K, lsf) < 1e-14
    assert references.line_spectrum_error(K, lsf * (1 + 1e-9)) == pytest.approx(1e-9, rel=1e-3)


def test_filter_references_agree_with_scipy():
    pytest.importorskip("mpmath")
    sos = signal.butter(3, (0.1, 0.3), "bandpass", output="sos")
    x = X[:80]
    state = signal.sosfilt_zi(sos) * x[0]
    assert_allclose(references.causal(sos, x), signal.sosfilt(sos, x, zi=state)[0], atol=1e-12)
    assert_allclose(references.zero_phase(sos, x, 21), signal.sosfiltfilt(sos, x, padlen=21), atol=1e-12)
    f = np.array([0.02, 0.1, 0.3])
    for kind in ("lowpass", "highpass"):
        sections = signal.butter(3, 0.1, kind, output="sos")
        gain = np.abs(signal.sosfreqz(sections, 2 * np.pi * f)[1])
        assert_allclose(references.sections_gain(sections, f), gain, rtol=1e-10)
        assert_allclose(references.butterworth_gain(kind, 0.05, 1.0, 3, f), gain, rtol=1e-10)


def test_80_bit_transforms_agree_with_60_digits():
    mp = pytest.importorskip("mpmath").mp
    wide = fft.dct(X[:32].astype(np.longdouble), norm="ortho").astype(np.float64)
    with mp.workdps(60):
        cosines = [[mp.cos(mp.pi * (2 * i + 1) * k / 64) for i in range(32)] for k in range(32)]
        right = [
            mp.fdot(X[:32].tolist(), row) * mp.sqrt(mp.mpf(2 if k else 1) / 32)
            for k, row in enumerate(cosines)
        ]
    assert_allclose(wide, [float(v) for v in right], atol=1e-15)
