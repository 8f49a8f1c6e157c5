"""Spectra, scores and fitted models of surfaces recover signals whose parameters are known."""

import re

import numpy as np
import pytest
from scipy import signal

from texclass.haptics.scene.definition import Device, Tolerance
from texclass.haptics.scene.fits import (
    fit_lattices,
    model_spectra,
    node_powers,
    separate_lines,
    spatial_frequencies,
    unit_spectra,
)
from texclass.haptics.scene.measurement import render_points
from texclass.haptics.scene.surface_spectra import (
    OperatingPoints,
    SpectralScorer,
    SurfaceSpectra,
    level_slopes,
    resample,
    split_by_speed,
    unit_factor,
)
from texclass.haptics.textures.grid import GridModel, interpolate_power, interpolation_weights
from texclass.vibration.autoregressive import Autoregression

DEVICE = Device(rate_hz=1000.0, band_hz=(20.0, 450.0), noise_floor=0.01, largest_output=50.0)


def make_scorer(score="log_spectral_db", limit=3.0, **options):
    return SpectralScorer(DEVICE, Tolerance(score=score, limit=limit, **options))


def points_at(spectra, speeds):
    return OperatingPoints(spectra, np.array(speeds), np.ones(len(spectra)))


def noise(n=20_000, seed=0):
    return np.random.default_rng(seed).standard_normal(n)


@pytest.fixture
def surface():
    """Return the spectra of noise of order 2 whose power follows v^1.6 f, at 3 speeds and 2 forces."""
    windows = []
    for i, (v, f) in enumerate([(v, f) for v in (40.0, 80.0, 160.0) for f in (0.5, 2.0)]):
        x = signal.lfilter([1.0], [1.0, -0.9, 0.6], noise(seed=i))
        windows.append(((v / 80) ** 0.8 * f**0.5 * x, v, f))
    points = OperatingPoints.from_windows(windows, make_scorer())
    return SurfaceSpectra("noise", points, points, points, 10.0, "")


def test_a_gain_changes_the_scores_in_db_and_only_the_level_of_gfc():
    S = make_scorer().spectrum(noise())[np.newaxis]
    for score in ("log_spectral_db", "band_db"):
        np.testing.assert_allclose(make_scorer(score).errors(S, 4 * S)[0], 20 * np.log10(2), rtol=1e-9)
    score, level = make_scorer("gfc", 0.9).errors(S, 4 * S)
    np.testing.assert_allclose([score[0], level[0]], [1.0, 20 * np.log10(2)], rtol=1e-9)
    result = make_scorer("gfc", 0.9, level_db=3.0).score(points_at(S, [80.0]), 4 * S)
    assert result["tolerance_ratio"] == pytest.approx(6.02 / 3, abs=1e-3)


def test_power_within_the_band_excludes_tones_below_it():
    t = np.arange(20_000) / 1000
    x = 2 * np.cos(2 * np.pi * 100 * t) + 5 * np.cos(2 * np.pi * 5 * t)
    assert make_scorer().power(make_scorer().spectrum(x)) == pytest.approx(2.0, rel=0.01)


def test_errors_are_aggregated_by_worst_or_mean_and_ignored_below_the_noise_of_the_device():
    S = make_scorer().spectrum(noise())[np.newaxis].repeat(2, axis=0)
    M = S * np.array([[1.0], [10 ** (0.4)]])
    points = points_at(S, [80.0, 80.0])
    for aggregate, expected in (("worst", 4 / 3), ("mean", 2 / 3)):
        assert make_scorer(aggregate=aggregate).score(points, M)["tolerance_ratio"] == pytest.approx(
            expected, abs=1e-3
        )
    two_models = np.stack([np.zeros(3), np.ones(3)], axis=1)  # three points of each
    assert make_scorer(aggregate="mean").tolerance_ratio(two_models, two_models, np.zeros((2, 2)))[0] == 0
    weak = 1e-8 * S
    result = make_scorer().score(points_at(weak, [80.0, 80.0]), np.zeros_like(weak))
    assert result["within_tolerance"]
    assert result["scores"] == [0.0, 0.0]


def test_level_slopes_recover_the_law_and_are_0_for_a_constant_variable():
    rng = np.random.default_rng(0)
    v, f = rng.uniform(40, 200, 9), rng.uniform(0.5, 2, 9)
    level = 1 + 3 * np.log2(v) - 2 * np.log2(f)
    slopes = level_slopes(np.stack([level, 2 * level], axis=1), OperatingPoints(np.zeros((9, 1)), v, f))
    np.testing.assert_allclose(slopes, [[3, 6], [-2, -4]], rtol=1e-9)
    narrow = OperatingPoints(np.zeros((9, 1)), v, np.linspace(1.0, 1.3, 9))
    np.testing.assert_allclose(level_slopes(3 * np.log2(v), narrow), [3, 0], atol=1e-9)
    assert not level_slopes(np.ones(1), points_at(np.zeros((1, 1)), [80.0])).any()


@pytest.mark.parametrize("aggregate", ["worst", "mean"])
def test_a_model_that_ignores_the_speed_is_outside_the_tolerance(aggregate):
    v = np.geomspace(60, 140, 8)
    S = np.multiply.outer((v / 90) ** 2, make_scorer().spectrum(noise()))  # 6 dB per doubling of the speed
    flat = np.broadcast_to(make_scorer().spectrum(noise()), S.shape)
    wrong_slope, correct = (make_scorer(aggregate=aggregate).score(points_at(S, v), M) for M in (flat, S))
    assert not wrong_slope["within_tolerance"]
    np.testing.assert_allclose(wrong_slope["slope_errors_db"], [-20 * np.log10(2), 0], atol=1e-9)
    assert wrong_slope["tolerance_ratio"] == pytest.approx(20 * np.log10(2) / 1.5)
    assert correct["within_tolerance"]
    lenient = make_scorer(aggregate="mean", slope_db=99.0)
    assert lenient.score(points_at(S, v), flat)["within_tolerance"]


def test_node_powers_represent_a_power_law_with_two_nodes_and_are_unbiased_by_scatter():
    axes = np.array([40.0, 160.0]), np.ones(1)
    v = np.geomspace(40, 160, 9)
    weights = interpolation_weights(axes, (v, np.ones(9)))
    power = node_powers(weights, v**1.6, axes)
    np.testing.assert_allclose(power, [40**1.6, 160**1.6], rtol=3e-3)
    np.testing.assert_allclose(interpolate_power(weights, power), v**1.6, rtol=3e-3)
    v = np.tile(np.geomspace(40, 160, 5), 400)
    random_powers = np.random.default_rng(0).gamma(2.0, v / 2.0)
    power = node_powers(interpolation_weights(axes, (v, np.ones(v.size))), random_powers, axes)
    np.testing.assert_allclose(power, [40, 160], rtol=0.08)


def test_lattices_recover_the_process_and_its_power_law(surface):
    axes = np.array([40.0, 160.0]), np.array([0.5, 2.0])
    grid = fit_lattices(surface, make_scorer(), axes, 8, np.zeros(0))
    model = grid.model(2)
    true = Autoregression([-0.9 / 1.6, 0.6], 1.0)
    np.testing.assert_allclose(model.rows[..., 1], 0.6, atol=0.06)
    ratio = model.power / (float(true.level) ** 2 * np.outer([0.5**1.6, 2**1.6], [0.5, 2.0]))
    np.testing.assert_allclose(ratio, 1.0, rtol=0.1)
    modelled = grid.spectra(surface.selection, make_scorer(), np.array([2, 8]))
    scores, _ = make_scorer().errors(surface.selection.spectra[:, np.newaxis], modelled)
    assert scores.max() < 1.2


def test_spectra_of_all_orders_are_those_of_the_models_of_each_order(surface):
    axes = np.array([40.0, 160.0]), np.array([0.5, 2.0])
    grid = fit_lattices(surface, make_scorer(), axes, 8, np.array([1.5, 0.8]))
    points = points_at(np.ones((2, 1)), [60.0, 130.0])
    spectra = grid.spectra(points, make_scorer(), np.array([1, 8]))
    for i, order in enumerate((1, 8)):
        expected = model_spectra(grid.model(order), points, make_scorer())
        np.testing.assert_allclose(spectra[:, i], expected, rtol=1e-9)


BOTH = GridModel(
    ([40, 160], [0.5, 2]), np.tile([-0.5, 0.6, 0.8], (2, 2, 1)), [[1, 2], [3, 6]], 8.0, [0.0], [1.3]
)
CROSSING = GridModel(  # one line fades into the other; halfway, half of the power is missing
    ([40, 160], [1]), np.sqrt(2) * np.eye(2)[:, np.newaxis], [[1], [1]], 8.0, [90.0, 210.0], [0.0, 0.0]
)


@pytest.mark.parametrize("model", [BOTH, CROSSING], ids=["both", "crossing"])
def test_model_spectra_are_those_of_the_rendered_vibration(model):
    points = OperatingPoints(
        np.ones((2, make_scorer().frequencies.size)), np.array([60.0, 130.0]), np.array([1.0, 1.7])
    )
    rendered = np.stack([make_scorer().spectrum(x) for x in render_points(model, points, DEVICE)])
    scores, levels = make_scorer().errors(rendered, model_spectra(model, points, make_scorer()))
    assert scores.max() < 1.5
    assert np.abs(levels).max() < 0.3


def test_unit_spectra_are_those_of_autoregressive_models():
    k = np.array([-0.7, 0.5, 0.1])
    spectra = unit_spectra(k, make_scorer())
    f = make_scorer().frequencies
    for m in range(4):
        model = Autoregression(k[:m], np.sqrt(np.prod(1 - k[:m] ** 2)))
        expected = 2 / 1000 * 10 ** (model.log_spectrum_db(2 * np.pi * f / 1000) / 10)
        np.testing.assert_allclose(spectra[m], expected, rtol=1e-9)


def test_spatial_lines_are_separated_from_resonances():
    windows, t = [], np.arange(8000) / 1000
    for i, v in enumerate(np.geomspace(40, 160, 6)):
        x = noise(8000, i) + 2 * np.cos(2 * np.pi * 1.5 * v * t) + 3 * np.cos(2 * np.pi * 300 * t)
        windows.append((x, float(v), 1.0))
    points = OperatingPoints.from_windows(windows, make_scorer())
    per_mm = spatial_frequencies(points, make_scorer(), 4)
    np.testing.assert_allclose(per_mm, [1.5], rtol=0.02)
    residual, power = separate_lines(points, per_mm, make_scorer())
    np.testing.assert_allclose(power[:, 0], 2.0, rtol=0.15)
    assert make_scorer().power(residual.spectra).max() < make_scorer().power(points.spectra).min() - 1


def test_units_and_sampling_rates_are_converted_and_incompatible_ones_rejected():
    assert unit_factor("g", "m/s^2", "file") == pytest.approx(9.80665)
    assert unit_factor("m", "m", "file") == 1
    for unit, device_unit in (("m", "m/s^2"), ("g", "m")):
        message = rf"file: unit must be convertible to {re.escape(device_unit)}, .* got {unit}\. "
        with pytest.raises(ValueError, match=message):
            unit_factor(unit, device_unit, "file")
    x = resample(np.sin(2 * np.pi * 50 * np.arange(0, 2, 1 / 2200)), 2200.0, 1000.0)
    expected = np.sin(2 * np.pi * 50 * np.arange(x.size) / 1000)
    assert np.abs(x - expected)[100:-100].max() < 0.01
    with pytest.raises(ValueError, match="a fraction of integers"):
        resample(np.ones(10), 1000.0, 1001.37)


def test_held_out_speeds_are_not_in_the_fitting_set():
    windows = [(noise(4096, i), v, 1.0) for i, v in enumerate((20.0, 40.0, 80.0, 160.0))]
    surface = split_by_speed("noise", windows, make_scorer())
    assert surface.test_set == "second half at 40 mm/s"
    assert set(surface.fitting.speed) == {20.0, 80.0, 160.0}
    assert set(surface.selection.speed) == set(surface.test.speed) == {40.0}
    assert not np.array_equal(surface.selection.spectra, surface.test.spectra)
