import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from texclass.vibration.autoregressive import Autoregression, fit
from texclass.vibration.interpolation import ModelBlend, interpolate
from texclass.vibration.line_spectrum import MIN_GAP, from_reflection

TONE = Autoregression([-np.cos(0.5), np.nextafter(1.0, 0.0)], 1e-12)


def _model(seed, p=18, gain=1.0):
    return Autoregression(np.random.default_rng(seed).uniform(-0.9, 0.9, p), gain)


def test_frequencies_and_log_gain_are_mixed_linearly():
    models = [_model(seed, gain=10.0**seed) for seed in range(4)]
    weights = np.random.default_rng(0).dirichlet(np.ones(4), size=(2, 3))
    mixed = ModelBlend(models).at(weights)
    assert mixed.reflection.shape == (2, 3, 18)
    lsf = np.array([from_reflection(m.reflection) for m in models])
    assert_allclose(from_reflection(mixed.reflection), weights @ lsf, atol=1e-12)
    assert_allclose(np.log10(mixed.gain), weights @ np.arange(4), atol=1e-12)
    assert_array_equal(ModelBlend(models).at(weights[1, 2]).reflection, mixed.reflection[1, 2])
    stack = Autoregression(np.stack([m.reflection for m in models]), [m.gain for m in models])
    assert_array_equal(ModelBlend(stack).at(weights).reflection, mixed.reflection)
    path = interpolate(models[1], models[2], np.linspace(0, 1, 9))
    pair = ModelBlend(models[1:3]).at(np.column_stack([np.linspace(1, 0, 9), np.linspace(0, 1, 9)]))
    assert_array_equal(path.reflection, pair.reflection)
    assert_array_equal(path.gain, pair.gain)


def test_every_model_on_the_path_is_stable_and_its_frequencies_a_gap_apart():
    for p in (1, 2, 50, 400):
        path = interpolate(_model(1, p), _model(2, p), np.linspace(0, 1, 5))
        lsf = from_reflection(path.reflection)
        assert np.diff(lsf, prepend=0.0, append=np.pi).min() >= MIN_GAP - 1e-13
        assert np.abs(path.reflection).max() < 1
    tone = from_reflection(interpolate(TONE, TONE, 0.5).reflection)  # closer than the gap itself
    assert np.diff(tone)[0] >= 0.9 * MIN_GAP


def test_a_tone_shifts_in_frequency_and_is_not_cross_faded():
    high = Autoregression([-np.cos(1.5), TONE.reflection[1]], 1e-12)
    poles = interpolate(TONE, high, 0.5).poles()
    assert_allclose(np.abs(np.angle(poles)), 1.0, atol=1e-9)


def test_loudness_level_preserves_the_level_of_a_mixture_of_tones():
    noise = 1e-3 * np.random.default_rng(0).standard_normal(3000)
    quiet, loud = (fit(a * np.sin(w * np.arange(3000)) + noise, 6) for a, w in ((1.0, 0.4), (4.0, 0.9)))
    weight = np.linspace(0, 1, 5)
    level = interpolate(quiet, loud, weight, loudness="level").level
    assert_allclose(level, quiet.level * (loud.level / quiet.level) ** weight, rtol=1e-6)
    assert interpolate(quiet, loud, 0.5).level < 0.01 * level[2]  # no resonance is left halfway


def test_a_silent_model_reduces_the_amplitude_and_not_the_frequencies():
    loud, silent = _model(1, gain=2.0), fit(np.zeros(100), 18)
    for loudness in ("gain", "level"):
        faded = interpolate(loud, silent, [0.25, 0.999, 1.0], loudness=loudness)
        assert_allclose(faded.gain, [1.5, 0.002, 0.0])
        assert_allclose(faded.reflection[:2], [loud.reflection] * 2, atol=1e-9)
    assert ModelBlend([silent, silent]).at([0.3, 0.7]).gain == 0


def test_weights_may_differ_from_a_sum_of_one_by_rounding():
    models = [_model(seed) for seed in range(3)]
    assert_allclose(
        ModelBlend(models).at([-1e-16, 0.5, 0.5 + 1e-15]).reflection,
        ModelBlend(models).at([0.0, 0.5, 0.5]).reflection,
        atol=1e-12,
    )
