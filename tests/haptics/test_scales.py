import numpy as np
import pandas as pd
import pytest
from scipy.stats import spearmanr

import texclass as tx
from texclass.haptics import OVER_THE_WAY, SCALES, link_of, scale_values
from texclass.recording import Phases, Recording
from texclass.simulate.profile import synthesize_profile


def _grains(hertz, fs=10_000.0, seconds=3.0):
    """Return a movement whose velocity is a tone under a little noise."""
    t = np.arange(round(seconds * fs)) / fs
    x = 2 * np.pi * hertz * np.cos(2 * np.pi * hertz * t) + 1e-3 * np.random.default_rng(0).normal(
        size=t.size
    )
    return Recording(x, fs, "m/s^2", f"{hertz:g}", phases=Phases(movement=(0, t.size)))


def test_the_grain_frequency_of_a_tone_is_its_frequency_at_any_rate():
    found = tx.extract([_grains(hertz, fs) for hertz in (20, 50, 120) for fs in (1000.0, 10_000.0)], "scales")
    np.testing.assert_allclose(found["grain_frequency"], np.repeat([20, 50, 120], 2), rtol=0.02)


def test_the_grain_frequency_follows_the_velocity_not_the_acceleration():
    slow, fast = _grains(30).acceleration, _grains(90).acceleration  # of equal velocity, 1:3 in acceleration
    both = _grains(30).with_(acceleration=slow + fast)
    assert tx.extract(both, "scales")["grain_frequency"].item() == pytest.approx(np.sqrt(30 * 90), rel=0.03)


def test_scales_are_monotone_and_undefined_where_their_feature_is():
    steps = np.linspace(0.5, 2.0, 7)
    low = pd.DataFrame({s.column: s.at_0 + steps * (s.at_10 - s.at_0) for s in SCALES.values()})
    values = scale_values(low)
    assert (values.diff().iloc[1:] > 0).all(axis=None)
    low.loc[3, "friction"] = np.nan
    assert scale_values(low)["sticky"].isna().tolist() == [i == 3 for i in range(7)]


def test_fine_and_regular_are_linked_over_the_way_where_it_is_known():
    columns = [scale.column for scale in SCALES.values()]
    told = pd.DataFrame([[100.0, 0.0, -0.5, 0.5, 50.0, 0.1]] * 3, columns=columns)
    by_time = scale_values(told)
    ribs = told.assign(ridge_density=[0.2, 1.45, np.nan], ridge_prominence=[2.2, np.nan, 9.0])
    found = scale_values(ribs)
    np.testing.assert_allclose(found["fine"], [0, 10, by_time["fine"][2]])
    np.testing.assert_allclose(found["regular"], [0, by_time["regular"][1], 10])
    pd.testing.assert_frame_equal(found.drop(columns=["fine", "regular"]), by_time.iloc[:, :4])
    links = [link_of("fine", row).column for row in ribs.to_dict("records")]
    assert links == ["ridge_density", "ridge_density", "grain_frequency"]
    assert {link_of(name, told.iloc[0].to_dict()) for name in SCALES} == set(SCALES.values())
    assert set(OVER_THE_WAY) < set(SCALES)


def test_scales_follow_what_simulated_surfaces_are_made_of():
    surfaces = tx.simulate.surface_catalogue(28, seed=401)
    operator = tx.simulate.operator_catalogue(1, seed=4)[0]
    felt = [
        tx.simulate.record_freehand(s, operator, duration_s=5.0, seed=i).with_(recording_id=s.name)
        for i, s in enumerate(surfaces)
    ]
    values = scale_values(tx.extract(felt, "scales"))
    made_of = {
        "hard": [s.stiffness_n_m for s in surfaces],
        "sticky": [s.kinetic_friction for s in surfaces],
        "fine": [1 / s.gratings[0].wavelength_mm if s.gratings else np.nan for s in surfaces],
        "regular": [bool(s.gratings) for s in surfaces],
        "bumpy": [synthesize_profile(s, 4, np.random.default_rng(1))[0].std() for s in surfaces],
    }
    for scale, property_ in made_of.items():
        rho = spearmanr(values[scale], property_, nan_policy="omit")[0]
        least = {"hard": 0.9, "sticky": 0.9, "fine": 0.7, "regular": 0.5, "bumpy": 0.5}
        assert rho > least[scale], (scale, rho)
