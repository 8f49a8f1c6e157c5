"""Perceptual scales follow their features, and features follow the parameters of simulated surfaces."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import spearmanr

import texclass as tx
from texclass.haptics import SCALES, SPATIAL_SCALES, scale_values, select_scale
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


def test_scales_are_monotone_and_undefined_without_their_feature():
    steps = np.linspace(0.5, 2.0, 7)
    features = pd.DataFrame({s.column: s.at_0 + steps * (s.at_10 - s.at_0) for s in SCALES.values()})
    values = scale_values(features)
    assert (values.diff().iloc[1:] > 0).all(axis=None)
    features.loc[3, "friction"] = np.nan
    assert scale_values(features)["sticky"].isna().tolist() == [i == 3 for i in range(7)]


def test_fine_and_regular_use_spatial_features_where_they_are_defined():
    columns = [scale.column for scale in SCALES.values()]
    features = pd.DataFrame([[100.0, 0.0, -0.5, 0.5, 50.0, 0.1]] * 3, columns=columns)
    temporal = scale_values(features)
    with_ridges = features.assign(ridge_density=[0.2, 1.45, np.nan], ridge_prominence=[2.2, np.nan, 9.0])
    values = scale_values(with_ridges)
    np.testing.assert_allclose(values["fine"], [0, 10, temporal["fine"][2]])
    np.testing.assert_allclose(values["regular"], [0, temporal["regular"][1], 10])
    pd.testing.assert_frame_equal(values.drop(columns=["fine", "regular"]), temporal.iloc[:, :4])
    columns = [select_scale("fine", row).column for row in with_ridges.to_dict("records")]
    assert columns == ["ridge_density", "ridge_density", "grain_frequency"]
    assert {select_scale(name, features.iloc[0].to_dict()) for name in SCALES} == set(SCALES.values())
    assert set(SPATIAL_SCALES) < set(SCALES)


def test_scales_follow_the_parameters_of_simulated_surfaces():
    surfaces = tx.simulate.surface_catalogue(28, seed=401)
    operator = tx.simulate.operator_catalogue(1, seed=4)[0]
    recordings = [
        tx.simulate.record_freehand(s, operator, duration_s=5.0, seed=i).with_(recording_id=s.name)
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
