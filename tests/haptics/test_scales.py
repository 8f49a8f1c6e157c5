"""Perceptual scales follow their features, and features follow the parameters of simulated surfaces."""

import numpy as np
import pandas as pd
import pytest
from reference_surfaces import RECIPE
from scipy.stats import spearmanr

import texclass as tx
from texclass.haptics import SCALES, SPATIAL_SCALES, reference_surfaces, scale_values, select_scale
from texclass.haptics.descriptions import reference_features
from texclass.loaders.simulated import open_simulated
from texclass.recording import Phases, Recording
from texclass.simulate.profile import synthesize_profile


def tone_movement(hertz, fs=10_000.0, seconds=3.0):
    """Return a movement whose velocity is a tone with weak noise."""
    t = np.arange(round(seconds * fs)) / fs
    x = 2 * np.pi * hertz * np.cos(2 * np.pi * hertz * t) + 1e-3 * np.random.default_rng(0).normal(
        size=t.size
    )
    return Recording(x, fs, "m/s^2", f"{hertz:g}", phases=Phases(movement=(0, t.size)))


def test_the_grain_frequency_of_a_tone_is_its_frequency_at_any_rate():
    features = tx.extract(
        [tone_movement(hertz, fs) for hertz in (20, 50, 120) for fs in (1000.0, 10_000.0)], "scales"
    )
    np.testing.assert_allclose(features["grain_frequency"], np.repeat([20, 50, 120], 2), rtol=0.02)


def test_the_grain_frequency_follows_the_velocity_not_the_acceleration():
    # Equal velocity, 1:3 in acceleration.
    slow, fast = tone_movement(30).acceleration, tone_movement(90).acceleration
    both = tone_movement(30).with_(acceleration=slow + fast)
    assert tx.extract(both, "scales")["grain_frequency"].item() == pytest.approx(np.sqrt(30 * 90), rel=0.03)


@pytest.mark.parametrize(
    "scale", [*SCALES.values(), *SPATIAL_SCALES.values()], ids=lambda scale: scale.column
)
def test_a_scale_is_the_continuous_rank_among_the_reference_surfaces(scale):
    references = np.sort(reference_surfaces()[scale.column].dropna())
    low, high = references[0], references[-1]
    values = np.array([scale.value(feature) for feature in references])
    assert (values[0], values[-1]) == (0.0, 10.0)
    ranks = pd.Series(references).rank()
    np.testing.assert_allclose(values, 10 * (ranks - ranks.iloc[0]) / (ranks.iloc[-1] - ranks.iloc[0]))
    is_frequency = scale.unit in ("Hz", "1/mm")
    ends = (0.7 * low, 1.4 * high) if is_frequency else (low - 0.3 * (high - low), high + 0.3 * (high - low))
    features = (np.geomspace if is_frequency else np.linspace)(*ends, 5000)
    values = np.array([scale.value(feature) for feature in features])
    assert (np.diff(values) >= 0).all()
    assert (values[0], values[-1]) == (0.0, 10.0)
    one_rank, close = 10 / (len(references) - 1), 1e-4 * high
    jumps = [scale.value(feature + close) - scale.value(feature - close) for feature in references]
    assert max(jumps) < 5 * one_rank
    for value in (0.0, 0.3, 4.0, 8.8, 10.0):
        assert scale.value(scale.feature_value(value)) == pytest.approx(value)


def test_equal_references_share_their_mean_rank_and_features_between_them_are_interpolated():
    rough, fine = SCALES["rough"], SCALES["fine"]
    references = [0.0, 1.0, 1.0, 1.0, 2.0]
    values = [rough.value(feature, references) for feature in (-9.0, 0.0, 0.5, 1.0, 1.25, 2.0, 9.0)]
    np.testing.assert_allclose(values, [0, 0, 2.5, 5, 6.25, 10, 10])
    assert rough.value(0.0, [0.0, 0.0, 0.0, 1.0]) == 0.0
    assert fine.value(20.0, [10.0, 40.0]) == pytest.approx(5.0)  # logarithmic
    assert fine.value(0.0, [10.0, 40.0]) == 0.0
    assert np.isnan(fine.value(np.nan))


def test_outside_the_references_the_excess_is_in_db_or_octaves():
    rough, fine, regular = SCALES["rough"], SCALES["fine"], SPATIAL_SCALES["regular"]
    assert rough.excess(-1.5, [-1.0, 1.0]) == pytest.approx(20 * -0.5)
    assert fine.excess(320.0, [10.0, 40.0]) == pytest.approx(3.0)
    assert regular.excess(12.5, [3.0, 9.0]) == pytest.approx(3.5)
    assert [scale.excess_unit for scale in (rough, fine, regular, SCALES["sticky"])] == [
        "dB", "octaves", "dB", "",
    ]  # fmt: skip
    assert rough.excess(0.3, [-1.0, 1.0]) == 0.0


def test_the_unlimited_value_equals_the_value_inside_and_continues_outside():
    scale = SCALES["rough"]
    low, high = (scale.feature_value(value) for value in (0.0, 10.0))
    for feature in np.linspace(low, high, 9):
        assert scale.unlimited_value(feature) == pytest.approx(scale.value(feature))
    assert scale.unlimited_value(high + (high - low) / 2) == pytest.approx(15.0)
    assert scale.unlimited_value(low - (high - low)) == pytest.approx(-10.0)


def test_the_reference_table_contains_the_features_of_the_simulated_surfaces():
    """Three of its surfaces are simulated again."""
    recipe = RECIPE.model_copy(update={"n_surfaces": 3})
    features = reference_features(open_simulated(recipe, name="three reference surfaces"))
    table = reference_surfaces()
    assert len(table) == RECIPE.n_surfaces
    pd.testing.assert_frame_equal(features, table.loc[features.index], rtol=1e-3, check_names=False)


def test_scales_are_undefined_without_their_feature():
    features = pd.DataFrame([{scale.column: scale.feature_value(5.0) for scale in SCALES.values()}] * 3)
    features.loc[1, "friction"] = np.nan
    values = scale_values(features.assign(surface="oak"))
    np.testing.assert_allclose(values.drop(columns="sticky"), 5.0)
    assert values["sticky"].isna().tolist() == [False, True, False]


def test_fine_and_regular_use_spatial_features_where_they_are_defined():
    columns = [scale.column for scale in SCALES.values()]
    features = pd.DataFrame([[100.0, 0.0, -0.5, 0.5, 50.0, 0.1]] * 3, columns=columns)
    temporal = scale_values(features)
    fine, regular = SPATIAL_SCALES["fine"], SPATIAL_SCALES["regular"]
    with_ridges = features.assign(
        ridge_density=[fine.feature_value(0.0), fine.feature_value(10.0), np.nan],
        ridge_prominence=[regular.feature_value(2.0), np.nan, regular.feature_value(9.0)],
    )
    values = scale_values(with_ridges)
    np.testing.assert_allclose(values["fine"], [0, 10, temporal["fine"][2]])
    np.testing.assert_allclose(values["regular"], [2, temporal["regular"][1], 9])
    others = ["hard", "rough", "bumpy", "sticky"]
    pd.testing.assert_frame_equal(values[others], temporal[others])
    columns = [select_scale("fine", row).column for row in with_ridges.to_dict("records")]
    assert columns == ["ridge_density", "ridge_density", "grain_frequency"]
    assert {select_scale(name, features.iloc[0].to_dict()) for name in SCALES} == set(SCALES.values())
    assert set(SPATIAL_SCALES) < set(SCALES)


def test_scales_follow_the_parameters_of_simulated_surfaces():
    surfaces = [s for seed in (401, 402, 403) for s in tx.simulate.surface_catalogue(28, seed=seed)]
    operator = tx.simulate.operator_catalogue(1, seed=4)[0]
    recordings = [
        tx.simulate.record_freehand(s, operator, duration_s=5.0, seed=i % 28).with_(recording_id=f"{i}")
        for i, s in enumerate(surfaces)
    ]
    values = scale_values(tx.extract(recordings, "scales"))
    parameters = {
        "hard": [s.stiffness_n_m for s in surfaces],
        "sticky": [s.kinetic_friction for s in surfaces],
        "fine": [1 / s.gratings[0].wavelength_mm if s.gratings else np.nan for s in surfaces],
        "regular": [bool(s.gratings) for s in surfaces],
        "bumpy": [synthesize_profile(s, 4, np.random.default_rng(1))[0].std() for s in surfaces],
    }
    for scale, parameter in parameters.items():
        rho = spearmanr(values[scale], parameter, nan_policy="omit")[0]
        lowest_rho = {"hard": 0.9, "sticky": 0.9, "fine": 0.7, "regular": 0.5, "bumpy": 0.5}
        assert rho > lowest_rho[scale], (scale, rho)
