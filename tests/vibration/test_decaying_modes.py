import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy import signal
from scipy.linalg import hankel as hankel_matrix
from scipy.linalg import svdvals

from texclass.stability.checks import stable_sections
from texclass.stability.inputs import cases_of
from texclass.vibration.decaying_modes import (
    DecayingModes,
    fit_matrix_pencil,
    fit_prony,
    n_extrema,
    numerical_rank,
    prony,
)

FS = 10_000.0
THREE = DecayingModes([100.0, 340.0, 900.0], [60.0, 150.0, 20.0], [2.0, 1.0, 0.5], [-1.5, 0.4, 2.0])


def _noisy(x, snr_db, rng):
    return x + np.sqrt(np.mean(x**2)) * 10 ** (-snr_db / 20) * rng.standard_normal(x.size)


def _is_stable(sections):
    return stable_sections(sections).error == 0


def _bound(modes, noise, n):
    """Cramer-Rao bound of frequency and decay of one mode, derivatives by central differences."""
    p = np.array([modes.frequency_hz[0], modes.decay_per_s[0], modes.amplitude[0], modes.phase[0]])

    def at(q):
        return DecayingModes(*q[:, np.newaxis]).synthesize(n, FS)

    steps = np.diag(1e-5 * np.abs(p))
    J = np.stack([(at(p + s) - at(p - s)) / (2 * s.sum()) for s in steps], axis=1)
    return noise * np.sqrt(np.diag(np.linalg.inv(J.T @ J)))[:2]


# Modes ------------------------------------------------------------------------------------------------------


def test_the_sections_have_the_modes_as_impulse_response():
    for fs in (4000.0, FS, 50_000.0):
        assert_allclose(THREE.filter(np.eye(1, 500)[0], fs), THREE.synthesize(500, fs), atol=1e-11)


def test_one_sine_mode_is_the_filter_of_guruswamy2011_eq_4():
    A, B, w, T = 2.0, 60.0, 2 * np.pi * 180.0, 1 / FS
    section = DecayingModes(180.0, B, A, -np.pi / 2).sections(FS)[0]
    printed = [A * np.exp(-B * T) * np.sin(w * T), -2 * np.exp(-B * T) * np.cos(w * T), np.exp(-2 * B * T)]
    assert_allclose([section[1], *section[4:]], printed, rtol=1e-12)
    assert_allclose(section[0], 0.0, atol=1e-15)


def test_modes_above_nyquist_are_omitted_and_strongest_depends_on_the_duration():
    low = DecayingModes(*THREE.table[:2].T)
    assert_array_equal(THREE.synthesize(50, 1000.0), low.synthesize(50, 1000.0))
    assert THREE.sections(1000.0).shape == (2, 6)
    modes = DecayingModes([100.0, 200.0], [1.0, 1000.0], [1.0, 3.0], [0.0, 0.0])
    assert_array_equal(modes.strongest(2).frequency_hz, [100.0, 200.0])
    assert_array_equal(modes.strongest(1, duration_s=1e-3).frequency_hz, [200.0])


# Fit --------------------------------------------------------------------------------------------------------


def test_the_pencil_recovers_three_modes_from_noise_free_samples():
    model = fit_matrix_pencil(THREE.synthesize(300, FS), FS)
    order = np.argsort(model.frequency_hz)
    for name in ("frequency_hz", "decay_per_s", "amplitude", "phase"):
        assert_allclose(getattr(model, name)[order], getattr(THREE, name), rtol=1e-8)


def test_real_poles_are_modes_at_zero_and_at_half_the_sampling_rate():
    n = np.arange(60)
    model = fit_matrix_pencil(3 * 0.9**n - 2 * (-0.8) ** n, FS)
    assert_array_equal(np.sort(model.frequency_hz), [0.0, FS / 2])
    assert_allclose(np.exp(-model.decay_per_s / FS)[np.argsort(model.frequency_hz)], [0.9, 0.8], rtol=1e-9)
    assert_allclose(model.synthesize(60, FS), 3 * 0.9**n - 2 * (-0.8) ** n, atol=1e-9)
    assert_allclose(model.filter(np.eye(1, 60)[0], FS), model.synthesize(60, FS), atol=1e-9)


def test_error_at_20_db_lies_within_1_5_times_the_cramer_rao_bound():
    truth, n, rng = DecayingModes(100.0, 60.0, 1.0, -np.pi / 2), 400, np.random.default_rng(17)
    x = truth.synthesize(n, FS)
    fits = [fit_matrix_pencil(_noisy(x, 20.0, rng), FS) for _ in range(60)]
    errors = np.array([[fit.frequency_hz[0] - 100.0, fit.decay_per_s[0] - 60.0] for fit in fits])
    bound = _bound(truth, 0.1 * np.sqrt(np.mean(x**2)), n)
    assert np.all(np.sqrt(np.mean(errors**2, axis=0)) < 1.5 * bound)
    assert abs(errors[:, 1].mean()) < 1.0


@given(st.integers(4, 150), st.integers(0, 10_000), st.sampled_from([1e-12, 1e-3, 1.0, 30.0]))
@settings(deadline=None, max_examples=60)
def test_any_short_signal_gives_stable_sections_at_any_rate(n, seed, growth):
    rng = np.random.default_rng(seed)
    x = rng.standard_normal(n) * np.exp(growth * np.arange(n) / n)
    modes = fit_matrix_pencil(x, FS, order=int(rng.integers(1, n // 2 + 1)))
    assert _is_stable(modes.sections(FS))
    assert _is_stable(modes.sections(1e6 * FS))


def test_rank_counts_the_modes_at_30_db():
    rng = np.random.default_rng(2)
    x = THREE.synthesize(400, FS)
    assert [fit_matrix_pencil(_noisy(x, 30.0, rng), FS).n_modes for _ in range(10)] == [3] * 10


def test_white_noise_alone_has_rank_0_in_most_segments():
    for n in (20, 60, 200):
        rng = np.random.default_rng(n)
        noise = (rng.standard_normal(n) for _ in range(60))
        ranks = [numerical_rank(svdvals(hankel_matrix(x[: n - n // 2], x[n - n // 2 - 1 :]))) for x in noise]
        assert np.mean(np.array(ranks) > 0) < 0.08


def test_a_growing_mode_is_reflected_with_its_frequency_and_rate():
    t = np.arange(300) / FS
    x = np.exp(80 * t) * np.cos(2 * np.pi * 250 * t)
    reflected = fit_matrix_pencil(x, FS)
    projected = fit_matrix_pencil(x, FS, unstable_poles="project")
    assert_allclose([reflected.frequency_hz[0], reflected.decay_per_s[0]], [250.0, 80.0], rtol=1e-8)
    assert_allclose(projected.frequency_hz[0], 250.0, rtol=1e-8)
    assert 0 < projected.decay_per_s[0] < 1e-6

    louder = DecayingModes(*(reflected.table * [1, 1, 1.01, 1]).T)
    errors = [np.sum((each.synthesize(300, FS) - x) ** 2) for each in (projected, reflected, louder)]
    assert errors == sorted(errors)  # amplitudes belong to the poles returned


@pytest.mark.parametrize("outside", ["reflect", "project"])
def test_degenerate_segments_give_stable_and_finite_modes(outside):
    segments = [case.x[:300] for case in cases_of("silent", "impulse", "sine", "offset", "clipped")]
    for x in (*segments, np.arange(50.0) ** 2, [1.0, 2.0, 3.0, 4.0]):
        modes = fit_matrix_pencil(x, FS, unstable_poles=outside)
        assert _is_stable(modes.sections(FS))
        assert np.all(np.isfinite(modes.synthesize(1000, FS)))
    assert fit_matrix_pencil(np.zeros(20), FS, unstable_poles=outside).n_modes == 0


def test_a_long_segment_is_fitted_as_precisely():
    truth = DecayingModes([100.0, 300.0], [3.0, 5.0], [1.0, 2.0], [0.0, 1.0])
    model = fit_matrix_pencil(truth.synthesize(12_000, FS), FS, order=4)
    assert_allclose(model.frequency_hz, [300.0, 100.0], rtol=1e-9)
    assert_allclose(model.decay_per_s, [5.0, 3.0], rtol=1e-6)


# Prony ------------------------------------------------------------------------------------------------------


def _noisy_decay(n=120, noise=0.1):
    t = np.arange(n) / 10_000
    x = np.exp(-60 * t) * np.sin(2 * np.pi * 300 * t)
    return x + noise * x.std() * np.random.default_rng(0).standard_normal(n)


def test_prony_recovers_the_filter_of_its_order():
    B, A = [1.0, 0.4, 0.2, 0.1], [1.0, -1.5, 0.8, -0.1]
    H = signal.lfilter(B, A, np.eye(1, 200)[0])
    model = prony(H, 3)
    assert_allclose(model.a, A, atol=1e-10)
    assert_allclose(model.b, B, atol=1e-10)
    assert_allclose(model.synthesize(200), H, atol=1e-10)
    assert model.is_stable


def test_the_numerator_makes_the_first_samples_exact_and_the_denominator_fits_the_rest():
    x, N = _noisy_decay(), 11
    assert_allclose(prony(x, N).synthesize(N + 1), x[: N + 1], atol=1e-12)
    past = np.stack([x[N + 1 - k : x.size - k] for k in range(1, N + 1)], axis=1)
    residual = x[N + 1 :] + past @ prony(x, N).a[1:]
    assert_allclose(past.T @ residual, 0, atol=1e-10)  # the normal equations


def test_the_order_grows_from_the_extrema_until_the_error_is_below_the_resolution():
    x = _noisy_decay()
    model = fit_prony(x, 0.05)
    assert model.is_resolved
    assert model.error < 0.05
    assert model.order >= n_extrema(x)
    tried = [prony(x, order) for order in range(n_extrema(x), model.order)]
    assert all(fit.error >= 0.05 for fit in tried)
    assert_allclose(model.error, np.mean(np.abs(model.synthesize(x.size) - x)), rtol=1e-9)
    best = fit_prony(x, 1e-9, max_order=n_extrema(x) + 11)
    assert not best.is_resolved
    assert best.error == min(prony(x, n_extrema(x) + i).error for i in range(12))  # of the last but one


def test_an_unstable_prony_filter_is_returned_and_marked_unstable():
    growing = np.cumprod(np.full(60, 1.05))
    model = prony(growing, 1)
    assert_allclose(model.pole_radius, 1.05, rtol=1e-9)
    assert not model.is_stable


def test_extrema_are_counted_once_per_plateau_and_not_at_the_ends():
    assert n_extrema([0, 1, 1, 0, -1, 2, 2, 2]) == 2
    assert n_extrema(np.sin(2 * np.pi * np.arange(100) / 25 + 0.1)) == 8
    assert n_extrema([3.0, 3.0]) == 0


@pytest.mark.parametrize("n_modes", [1, 2, 3])
def test_four_samples_per_mode_are_enough(n_modes):
    truth = DecayingModes(*THREE.table[:n_modes].T)
    model = fit_matrix_pencil(truth.synthesize(4 * n_modes, 2500.0), 2500.0, order=2 * n_modes)
    order = np.argsort(model.frequency_hz)
    assert_allclose(model.frequency_hz[order], truth.frequency_hz, rtol=1e-6)
    assert_allclose(model.decay_per_s[order], truth.decay_per_s, rtol=1e-4)
