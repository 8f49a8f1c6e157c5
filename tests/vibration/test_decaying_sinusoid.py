import numpy as np
import pytest
from numpy.testing import assert_allclose

from texclass.vibration.decaying_sinusoid import TapModel, fit_okamura, fit_tap_model

FS = 25_000.0
RUBBER, WOOD, ALUMINIUM = TapModel(-116.7, 40, 18), TapModel(-1500, 600, 592), TapModel(-1e5, 1500, 1153)
"""`okamura2001`, Table I, decay rates divided by 1000."""
SPEEDS = np.array([0.05, 0.1, 0.2, 0.3])


def _taps(model, noise=0.0, seed=0, n=None):
    rng = np.random.default_rng(seed)
    n = n or int(5 / model.decay_per_s * FS)
    clean = [model.synthesize(v, n - 10 * i, FS) for i, v in enumerate(SPEEDS)]
    level = noise * np.sqrt(np.mean(np.concatenate(clean) ** 2))
    return [tap + level * rng.standard_normal(tap.size) for tap in clean]


def _values(model):
    return [model.amplitude_slope, model.decay_per_s, model.frequency_hz]


def test_a_tap_equals_the_printed_equation():
    t = np.arange(300) / FS
    printed = -1500 * 0.2 * np.exp(-600 * t) * np.sin(2 * np.pi * 592 * t)
    assert_allclose(WOOD.synthesize(0.2, 300, FS), printed, atol=1e-11)
    assert_allclose(WOOD.synthesize(-0.2, 300, FS), -printed, atol=1e-11)


def test_maximum_likelihood_recovers_noise_free_taps_and_fit_okamura_roughly():
    """The maximum of the spectrum lies near sqrt(w^2 - B^2); a parabola is a little lower than a sine."""
    for truth in (RUBBER, WOOD, ALUMINIUM):
        assert_allclose(_values(fit_tap_model(_taps(truth), SPEEDS, FS)), _values(truth), rtol=1e-8)
        fitted = fit_okamura(_taps(truth), SPEEDS, FS)
        assert_allclose([fitted.amplitude_slope, fitted.decay_per_s], _values(truth)[:2], rtol=0.03)
        w = np.sqrt(truth.frequency_hz**2 - (truth.decay_per_s / (2 * np.pi)) ** 2)
        assert_allclose(fitted.frequency_hz, w, rtol=0.02)
    alone = fit_tap_model([WOOD.synthesize(1.0, 200, FS)], [1.0], FS)
    assert_allclose(_values(alone), _values(WOOD), rtol=1e-8)


@pytest.mark.parametrize(
    ("noise_db", "within"), [(-34, (0.03, 0.03, 0.03)), (-30, (0.04, 0.05, 0.04)), (-20, (0.1, 0.2, 0.08))]
)
def test_fit_okamura_ends_the_envelope_before_the_noise_at_any_recording_length(noise_db, within):
    for truth in (WOOD, ALUMINIUM):
        errors = []
        for seed in range(12):
            rng, n = np.random.default_rng(seed), int(60 / truth.decay_per_s * FS)
            clean = [truth.synthesize(v, n, FS) for v in SPEEDS]
            noise = [10 ** (noise_db / 20) * np.max(np.abs(tap)) * rng.standard_normal(n) for tap in clean]
            fitted = fit_okamura([tap + e for tap, e in zip(clean, noise, strict=True)], SPEEDS, FS)
            errors.append(np.divide(_values(fitted), _values(truth)) - 1)
        assert np.all(np.sqrt(np.mean(np.square(errors), axis=0)) < within)


def test_maximum_likelihood_reaches_the_cramer_rao_bound_over_several_taps():
    noise, p = 0.1, np.array(_values(WOOD), dtype=float)
    clean = np.concatenate(_taps(WOOD))
    steps = np.diag(1e-6 * np.abs(p))
    sides = [[np.concatenate(_taps(TapModel(*q), n=208)) for q in (p + s, p - s)] for s in steps]
    J = np.stack([(up - down) / (2 * s.sum()) for (up, down), s in zip(sides, steps, strict=True)], axis=1)
    bound = noise * np.sqrt(np.mean(clean**2)) * np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    fits = [_values(fit_tap_model(_taps(WOOD, noise=noise, seed=s), SPEEDS, FS)) for s in range(25)]
    assert np.all(np.sqrt(np.mean((np.array(fits) - p) ** 2, axis=0)) < 1.3 * bound)


def test_the_unit_of_the_velocity_only_scales_the_slope():
    taps = _taps(WOOD, noise=0.05)
    for fit in (fit_okamura, fit_tap_model):
        in_m, in_mm = fit(taps, SPEEDS, FS), fit(taps, 1000 * SPEEDS, FS)
        assert_allclose(1000 * in_mm.amplitude_slope, in_m.amplitude_slope, rtol=1e-9)


def _noisy(model, noise_db, duration_s, seed):
    rng, n = np.random.default_rng(seed), round(duration_s * FS)
    clean = [model.synthesize(v, n, FS) for v in SPEEDS]
    return [x + 10 ** (noise_db / 20) * np.abs(x).max() * rng.standard_normal(n) for x in clean]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("duration_s", [0.05, 0.5])
@pytest.mark.parametrize("model", [RUBBER, WOOD, ALUMINIUM], ids=["rubber", "wood", "aluminium"])
def test_fit_okamura_is_within_its_documented_error_or_raises(model, duration_s):
    for noise_db, off_f, off_B in (
        (-30, 0.1, 0.1),
        (-20, 0.15, 0.3),
        (-10, np.inf, np.inf),
        (0, np.inf, np.inf),
    ):
        for seed in range(6):
            try:
                fitted = fit_okamura(_noisy(model, noise_db, duration_s, seed), SPEEDS, FS)
            except ValueError:
                assert noise_db > -30
                continue
            assert np.isfinite(_values(fitted)).all()
            assert abs(fitted.frequency_hz / model.frequency_hz - 1) <= max(off_f, 0.2 * (model is RUBBER))
            assert abs(fitted.decay_per_s / model.decay_per_s - 1) <= off_B


@pytest.mark.parametrize("model", [RUBBER, WOOD, ALUMINIUM], ids=["rubber", "wood", "aluminium"])
@pytest.mark.parametrize("noise_db", [-20, -15, -10])
def test_maximum_likelihood_fits_no_worse_than_the_truth(model, noise_db):
    for seed in range(2):
        taps = _noisy(model, noise_db, 0.5, seed)
        fitted = fit_tap_model(taps, SPEEDS, FS)
        of_fit, of_truth = (
            sum(np.sum((x - m.synthesize(v, x.size, FS)) ** 2) for x, v in zip(taps, SPEEDS, strict=True))
            for m in (fitted, model)
        )
        assert of_fit <= of_truth * (1 + 1e-9)
