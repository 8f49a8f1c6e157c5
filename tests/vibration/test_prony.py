import numpy as np
from numpy.testing import assert_allclose
from scipy import signal

from texclass.vibration.decaying_modes import fit_prony, n_extrema, prony

IMPULSE = np.eye(1, 200)[0]
B, A = [1.0, 0.4, 0.2, 0.1], [1.0, -1.5, 0.8, -0.1]
H = signal.lfilter(B, A, IMPULSE)


def _noisy_decay(n=120, noise=0.1):
    t = np.arange(n) / 10_000
    x = np.exp(-60 * t) * np.sin(2 * np.pi * 300 * t)
    return x + noise * x.std() * np.random.default_rng(0).standard_normal(n)


def test_prony_recovers_the_filter_of_its_order():
    found = prony(H, 3)
    assert_allclose(found.a, A, atol=1e-10)
    assert_allclose(found.b, B, atol=1e-10)
    assert_allclose(found.synthesize(200), H, atol=1e-10)
    assert found.is_stable


def test_the_numerator_makes_the_first_samples_exact():
    x = _noisy_decay()
    assert_allclose(prony(x, 11).synthesize(12), x[:12], atol=1e-12)


def test_the_denominator_solves_the_normal_equations_of_the_rest():
    x, N = _noisy_decay(), 11
    past = np.stack([x[N + 1 - k : x.size - k] for k in range(1, N + 1)], axis=1)
    residual = x[N + 1 :] + past @ prony(x, N).a[1:]
    assert_allclose(past.T @ residual, 0, atol=1e-10)


def test_the_order_grows_from_the_extrema_until_the_error_is_below_the_resolution():
    x = _noisy_decay()
    found = fit_prony(x, 0.05)
    assert found.resolved
    assert found.error < 0.05
    assert found.order >= n_extrema(x)
    tried = [prony(x, order) for order in range(n_extrema(x), found.order)]
    assert all(fit.error >= 0.05 for fit in tried)
    assert_allclose(found.error, np.mean(np.abs(found.synthesize(x.size) - x)), rtol=1e-9)


def test_an_unreachable_resolution_returns_the_best_and_says_so():
    x = _noisy_decay()
    found = fit_prony(x, 1e-9, max_order=n_extrema(x) + 6)
    assert not found.resolved
    assert found.error == min(prony(x, n_extrema(x) + i).error for i in range(7))


def test_an_unstable_fit_is_returned_and_called_unstable():
    growing = np.cumprod(np.full(60, 1.05))
    found = prony(growing, 1)
    assert_allclose(found.pole_radius, 1.05, rtol=1e-9)
    assert not found.is_stable


def test_extrema_are_counted_once_per_plateau_and_not_at_the_ends():
    assert n_extrema([0, 1, 1, 0, -1, 2, 2, 2]) == 2
    assert n_extrema(np.sin(2 * np.pi * np.arange(100) / 25 + 0.1)) == 8
    assert n_extrema([3.0, 3.0]) == 0
