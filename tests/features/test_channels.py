"""Correlations of channel pairs, clipping, and plans with separate channels."""

import numpy as np
import pytest
from feature_signals import noise

from texclass.features.channels import clipping, lag_correlation, symmetric_lags
from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import views_of
from texclass.features.plan import Plan
from texclass.features.sets import load_feature_set
from texclass.recording import Phases, Recording

FS, N = 100.0, 500
LAGS = (0, 1, 2, 4)


def pair(x, y, **parameters):
    return lag_correlation(np.column_stack([x, y]), fs=FS, **parameters)


def turning(n=N, seed=0, **facts):
    signals = noise(6 * n, seed).reshape(n, 6)
    return Recording(signals[:, :3], FS, turn_rate=signals[:, 3:], phases=Phases(movement=(0, n)), **facts)


def test_a_delayed_copy_correlates_at_its_delay_and_noise_nowhere_else():
    x = noise(N)
    for delay in (-4, -1, 0, 2):
        correlations = pair(x, 3 - 5 * np.roll(x, delay))
        expected = np.where(np.array(symmetric_lags(LAGS)) == delay, -1.0, 0.0)
        np.testing.assert_allclose(correlations, expected, atol=0.15)
        assert correlations[symmetric_lags(LAGS).index(delay)] < -0.98


def test_correlations_equal_those_of_numpy():
    x, y = noise(N, 1).cumsum(), noise(N, 2).cumsum()
    expected = np.correlate(y - y.mean(), x - x.mean(), "full")[N - 1 + np.array(symmetric_lags((3, 7)))]
    np.testing.assert_allclose(pair(x, y, lags=(3, 7)), expected / (N * x.std() * y.std()), atol=1e-12)
    assert pair(x, y)[symmetric_lags(LAGS).index(0)] == pytest.approx(np.corrcoef(x, y)[0, 1])


def test_clipped_samples_are_counted_and_rounding_is_not_clipping():
    x = noise(20_000)
    clipped = np.clip(x, -1, 2)
    assert clipping(x, fs=FS) == 0
    assert clipping(clipped, fs=FS)[0] == pytest.approx(np.mean((clipped == -1) | (clipped == 2)), abs=2e-4)
    assert clipping(7 - 0.3 * clipped, fs=FS)[0] == clipping(clipped, fs=FS)[0]


def test_each_pair_of_separate_channels_has_columns_named_after_both():
    recording, whole = turning(), load_feature_set("coarse")
    plan = Plan.of(whole, ("x", "y", "z", "turn_x", "turn_y", "turn_z"))
    values = dict(zip(plan.columns, plan.compute(recording).values, strict=True))
    assert sum("lag_correlation" in column for column in values) == 15 * 7
    both = pair(recording.acceleration[:, 1], recording.turn_rate[:, 2])
    columns = [values[f"y*turn_z/lag_correlation.lag{lag}"] for lag in symmetric_lags(LAGS)]
    np.testing.assert_allclose(columns, both)
    restored, is_same = Plan.of_json(plan.to_json(), plan.channels)
    assert is_same
    np.testing.assert_array_equal(restored.compute(recording).values, plan.compute(recording).values)
    subset = plan.restricted_to(["y*turn_z/lag_correlation.lag0"])
    assert subset.compute(recording).values.tolist() == [values["y*turn_z/lag_correlation.lag0"]]


def test_single_and_combined_channels_have_no_pair_and_a_reason():
    of_pairs = load_feature_set("coarse").restricted_to(["lag_correlation"])
    for recording, channels in ((turning(), ()), (Recording(noise(N), FS, channels=("x",)), ("x",))):
        values, reasons, *_ = Plan.of(of_pairs, channels).compute(recording)
        assert np.isnan(values).all()
        reason = "channels are combined or single. Expected two separate channels"
        assert reasons == (("lag_correlation", reason),)
    with pytest.raises(UndefinedFeatureError, match="Expected one channel for the phase 'movement'"):
        views_of(turning(), ("x", "y", "z"))["x*y/"].of("movement")


def test_a_dead_channel_does_not_affect_pairs_of_other_channels():
    signals = noise(3 * N).reshape(N, 3) * [1, 0, 1]
    plan = Plan.of(load_feature_set("coarse").restricted_to(["lag_correlation"]), ("x", "y", "z"))
    values, reasons, *_ = plan.compute(Recording(signals, FS, phases=Phases(movement=(0, N))))
    assert np.isfinite(values).tolist() == [False] * 7 + [True] * 7 + [False] * 7
    assert {name for name, _ in reasons} == {"x*y/lag_correlation", "y*z/lag_correlation"}
