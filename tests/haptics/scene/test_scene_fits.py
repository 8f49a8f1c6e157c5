"""What a scene's models are fitted and judged by recovers what is known."""

import re

import numpy as np
import pytest
from scipy import signal

from texclass.haptics.scene.definition import Device, Tolerance
from texclass.haptics.scene.fits import (
    fit_lattices,
    model_spectra,
    node_powers,
    pattern_frequencies,
    split,
    unit_spectra,
)
from texclass.haptics.scene.observations import (
    Judge,
    Observed,
    Points,
    _factor,
    at_rate,
    divide_by_speed,
    slopes,
)
from texclass.haptics.scene.proof import render_at
from texclass.haptics.textures.grid import GridModel, interpolate_power, interpolation_weights
from texclass.vibration.autoregressive import Autoregression

DEVICE = Device(rate_hz=1000.0, band_hz=(20.0, 450.0), noise_floor=0.01, largest_output=50.0)


def judge(score="log_spectral_db", limit=3.0, **options):
    return Judge(DEVICE, Tolerance(score=score, limit=limit, **options))


def at(spectra, speeds):
    return Points(spectra, np.array(speeds), np.ones(len(spectra)))


def noise(n=20_000, seed=0):
    return np.random.default_rng(seed).standard_normal(n)


@pytest.fixture
def observed():
    """Noise of order 2 whose power follows v^1.6 f, observed at 3 speeds and 2 forces."""
    pieces = []
    for i, (v, f) in enumerate([(v, f) for v in (40.0, 80.0, 160.0) for f in (0.5, 2.0)]):
        x = signal.lfilter([1.0], [1.0, -0.9, 0.6], noise(seed=i))
        pieces.append(((v / 80) ** 0.8 * f**0.5 * x, v, f))
    points = Points.of(pieces, judge())
    return Observed("it", points, points, points, 10.0, "nothing")


def test_scores_know_what_a_gain_is():
    S = judge().spectrum(noise())[np.newaxis]
    for score in ("log_spectral_db", "band_db"):
        np.testing.assert_allclose(judge(score).errors(S, 4 * S)[0], 20 * np.log10(2), rtol=1e-9)
    score, level = judge("gfc", 0.9).errors(S, 4 * S)
    np.testing.assert_allclose([score[0], level[0]], [1.0, 20 * np.log10(2)], rtol=1e-9)
    found = judge("gfc", 0.9, level_db=3.0).verdict(at(S, [80.0]), 4 * S)
    assert found["relative"] == pytest.approx(6.02 / 3, abs=1e-3)


def test_power_within_the_band_is_that_of_the_signal_there():
    t = np.arange(20_000) / 1000
    x = 2 * np.cos(2 * np.pi * 100 * t) + 5 * np.cos(2 * np.pi * 5 * t)
    assert judge().power(judge().spectrum(x)) == pytest.approx(2.0, rel=0.01)


def test_worst_and_mean_decide_as_asked_and_what_drowns_in_the_noise_of_the_device_does_not_count():
    S = judge().spectrum(noise())[np.newaxis].repeat(2, axis=0)
    M = S * np.array([[1.0], [10 ** (0.4)]])
    points = at(S, [80.0, 80.0])
    for over, expected in (("worst", 4 / 3), ("mean", 2 / 3)):
        assert judge(over=over).verdict(points, M)["relative"] == pytest.approx(expected, abs=1e-3)
    two_models = np.stack([np.zeros(3), np.ones(3)], axis=1)  # three points of each
    assert judge(over="mean").relative(two_models, two_models, np.zeros((2, 2)))[0] == 0
    weak = 1e-8 * S
    verdict = judge().verdict(at(weak, [80.0, 80.0]), np.zeros_like(weak))
    assert verdict["within"]
    assert verdict["scores"] == [0.0, 0.0]


def test_slopes_of_levels_are_those_that_were_put_in_and_none_where_nothing_tells_them():
    rng = np.random.default_rng(0)
    v, f = rng.uniform(40, 200, 9), rng.uniform(0.5, 2, 9)
    level = 1 + 3 * np.log2(v) - 2 * np.log2(f)
    found = slopes(np.stack([level, 2 * level], axis=1), Points(np.zeros((9, 1)), v, f))
    np.testing.assert_allclose(found, [[3, 6], [-2, -4]], rtol=1e-9)
    narrow = Points(np.zeros((9, 1)), v, np.linspace(1.0, 1.3, 9))
    np.testing.assert_allclose(slopes(3 * np.log2(v), narrow), [3, 0], atol=1e-9)
    assert not slopes(np.ones(1), at(np.zeros((1, 1)), [80.0])).any()


@pytest.mark.parametrize("over", ["worst", "mean"])
def test_a_model_that_loses_what_speed_does_is_outside_even_where_its_mean_is_within(over):
    v = np.geomspace(60, 140, 8)
    S = np.multiply.outer((v / 90) ** 2, judge().spectrum(noise()))  # 6 dB from a speed to twice that
    flat = np.broadcast_to(judge().spectrum(noise()), S.shape)
    lost, kept = (judge(over=over).verdict(at(S, v), M) for M in (flat, S))
    assert not lost["within"]
    np.testing.assert_allclose(lost["slopes_db"], [-20 * np.log10(2), 0], atol=1e-9)
    assert lost["relative"] == pytest.approx(20 * np.log10(2) / 1.5)
    assert kept["within"]
    assert judge(over="mean", slope_db=99.0).verdict(at(S, v), flat)["within"]


def test_node_powers_need_no_node_within_a_power_law_and_are_unbiased_by_the_scatter_of_spectra():
    axes = np.array([40.0, 160.0]), np.ones(1)
    v = np.geomspace(40, 160, 9)
    H = interpolation_weights(axes, (v, np.ones(9)))
    found = node_powers(H, v**1.6, axes)
    np.testing.assert_allclose(found, [40**1.6, 160**1.6], rtol=3e-3)
    np.testing.assert_allclose(interpolate_power(H, found), v**1.6, rtol=3e-3)
    v = np.tile(np.geomspace(40, 160, 5), 400)
    drawn = np.random.default_rng(0).gamma(2.0, v / 2.0)
    found = node_powers(interpolation_weights(axes, (v, np.ones(v.size))), drawn, axes)
    np.testing.assert_allclose(found, [40, 160], rtol=0.08)


def test_lattices_recover_the_process_and_its_law(observed):
    grid = fit_lattices(observed, judge(), (np.array([40.0, 160.0]), np.array([0.5, 2.0])), 8, np.zeros(0))
    model = grid.model(2)
    true = Autoregression([-0.9 / 1.6, 0.6], 1.0)
    np.testing.assert_allclose(model.rows[..., 1], 0.6, atol=0.06)
    ratio = model.power / (float(true.level) ** 2 * np.outer([0.5**1.6, 2**1.6], [0.5, 2.0]))
    np.testing.assert_allclose(ratio, 1.0, rtol=0.1)
    seen = grid.spectra(observed.choose, judge(), np.array([2, 8]))
    scores, _ = judge().errors(observed.choose.spectra[:, np.newaxis], seen)
    assert scores.max() < 1.2


def test_what_is_predicted_of_all_orders_is_what_their_models_sound_like(observed):
    axes = np.array([40.0, 160.0]), np.array([0.5, 2.0])
    grid = fit_lattices(observed, judge(), axes, 8, np.array([1.5, 0.8]))
    between = at(np.ones((2, 1)), [60.0, 130.0])
    seen = grid.spectra(between, judge(), np.array([1, 8]))
    for i, order in enumerate((1, 8)):
        expected = model_spectra(grid.model(order), between, judge())
        np.testing.assert_allclose(seen[:, i], expected, rtol=1e-9)


BOTH = GridModel(
    ([40, 160], [0.5, 2]), np.tile([-0.5, 0.6, 0.8], (2, 2, 1)), [[1, 2], [3, 6]], 8.0, [0.0], [1.3]
)
CROSSING = GridModel(  # from one line to the other: halfway, half of the power is missing
    ([40, 160], [1]), np.sqrt(2) * np.eye(2)[:, np.newaxis], [[1], [1]], 8.0, [90.0, 210.0], [0.0, 0.0]
)


@pytest.mark.parametrize("model", [BOTH, CROSSING], ids=["both", "crossing"])
def test_what_is_predicted_is_what_is_rendered(model):
    points = Points(np.ones((2, judge().frequencies.size)), np.array([60.0, 130.0]), np.array([1.0, 1.7]))
    rendered = np.stack([judge().spectrum(x) for x in render_at(model, points, DEVICE)])
    scores, levels = judge().errors(rendered, model_spectra(model, points, judge()))
    assert scores.max() < 1.5
    assert np.abs(levels).max() < 0.3


def test_unit_spectra_are_those_of_the_models():
    k = np.array([-0.7, 0.5, 0.1])
    found = unit_spectra(k, judge())
    f = judge().frequencies
    for m in range(4):
        model = Autoregression(k[:m], np.sqrt(np.prod(1 - k[:m] ** 2)))
        expected = 2 / 1000 * 10 ** (model.log_spectrum_db(2 * np.pi * f / 1000) / 10)
        np.testing.assert_allclose(found[m], expected, rtol=1e-9)


def test_a_pattern_is_told_from_what_rings():
    pieces, t = [], np.arange(8000) / 1000
    for i, v in enumerate(np.geomspace(40, 160, 6)):
        x = noise(8000, i) + 2 * np.cos(2 * np.pi * 1.5 * v * t) + 3 * np.cos(2 * np.pi * 300 * t)
        pieces.append((x, float(v), 1.0))
    points = Points.of(pieces, judge())
    found = pattern_frequencies(points, judge(), 4)
    np.testing.assert_allclose(found, [1.5], rtol=0.02)
    left, power = split(points, found, judge())
    np.testing.assert_allclose(power[:, 0], 2.0, rtol=0.15)
    assert judge().power(left.spectra).max() < judge().power(points.spectra).min() - 1


def test_units_and_rates_are_changed_and_others_refused():
    assert _factor("g", "m/s^2", "it") == pytest.approx(9.80665)
    assert _factor("m", "m", "it") == 1
    for unit, wanted in (("m", "m/s^2"), ("g", "m")):
        with pytest.raises(ValueError, match=rf"it: unit is {unit}, the device's {re.escape(wanted)}\. "):
            _factor(unit, wanted, "it")
    x = at_rate(np.sin(2 * np.pi * 50 * np.arange(0, 2, 1 / 2200)), 2200.0, 1000.0)
    expected = np.sin(2 * np.pi * 50 * np.arange(x.size) / 1000)
    assert np.abs(x - expected)[100:-100].max() < 0.01
    with pytest.raises(ValueError, match="ratio of whole numbers"):
        at_rate(np.ones(10), 1000.0, 1001.37)


def test_held_out_speeds_are_in_no_fit():
    pieces = [(noise(4096, i), v, 1.0) for i, v in enumerate((20.0, 40.0, 80.0, 160.0))]
    observed = divide_by_speed("it", pieces, judge())
    assert observed.how == "speeds 40 mm/s"
    assert set(observed.fit.speed) == {20.0, 80.0, 160.0}
    assert set(observed.choose.speed) == set(observed.prove.speed) == {40.0}
    assert not np.array_equal(observed.choose.spectra, observed.prove.spectra)
