import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oeztuerk2018 import TABLE_3_1
from oeztuerk2018_study import (
    displayed_signals,
    floor,
    intervals_from_speeds,
    intervals_of,
    mean_scores,
    mirrored,
    order_curves,
    predict_left_out,
    seamless,
)

from texclass.textures.oeztuerk2018 import (
    FRICTION,
    N_INTERVALS,
    fit_frequencies,
    fit_lpc,
    speed_intervals,
)
from texclass.vibration.major_frequencies import BEAT_THRESHOLDS_HZ

FS = 10_000.0


def _noise(n, seed=0):
    return np.random.default_rng(seed).standard_normal(n)


def _largest_jump_at_joins(endless, n):
    joins = np.arange(n, endless.size, n)
    return np.abs(endless[joins] - endless[joins - 1]).max()


def test_one_second_becomes_ten_of_five_mirrored_copies_that_join_without_a_jump():
    x = _noise(10_000)
    assert_array_equal(seamless(x, FS), np.tile(mirrored(x), 5))
    endless = seamless(x[:777], FS, duration_s=0.5, peak=2.5)
    assert _largest_jump_at_joins(endless, 777) == 0
    assert_allclose(np.abs(endless).max(), 2.5)
    assert not seamless(np.zeros(10), FS, peak=1.0).any()


def test_intervals_are_those_of_table_6_1_and_never_more_with_more_friction():
    assert str(speed_intervals(0.6)) == "0-4, 4-8, > 8 cm/s"
    assert str(speed_intervals(0.2)) == "0-4, 4-8, 8-12, 12-16, > 16 cm/s"
    assert str(speed_intervals(0.4)) == "0-4, 4-8, 8-12, > 12 cm/s"
    assert speed_intervals(0.4).centres_mm_s == (20, 60, 100, 140)
    counts = [speed_intervals(mu).n_intervals for mu in np.linspace(0, 2, 201)]
    assert np.all(np.diff(counts) <= 0)
    assert (counts[0], counts[-1]) == (7, 1)
    assert tuple(speed_intervals(mu).n_intervals for mu in FRICTION) == N_INTERVALS


def test_speeds_ask_for_intervals_up_to_the_last_notable_bin():
    v = np.concatenate([np.full(60, 10.0), np.full(30, 90.0), np.full(8, 130.0), np.full(2, 300.0)])
    assert intervals_from_speeds(v).n_intervals == 4
    assert intervals_from_speeds(v, notable=0.1).n_intervals == 3
    assert intervals_from_speeds(np.linspace(1, 400, 100), notable=0.5).n_intervals == 1


def test_simulated_speeds_ask_for_about_the_published_intervals():
    for mu, n in zip(FRICTION, N_INTERVALS, strict=True):
        drawn = np.repeat(*np.array(list(enumerate(intervals_of(mu, 0)["simulated"]))).T)
        assert abs(np.median(drawn) - n) <= 1
    assert tuple(max(row) for row in TABLE_3_1) == BEAT_THRESHOLDS_HZ


def test_impossible_frictions_are_refused():
    for mu in (-0.1, np.nan, np.inf):
        with pytest.raises(ValueError, match="rule is"):
            speed_intervals(mu)


@pytest.mark.parametrize("fit_texture", [fit_lpc, fit_frequencies])
def test_one_seamless_signal_is_made_for_each_interval(fit_texture):
    signals = [a * _noise(2000, seed) for a, seed in ((1, 0), (3, 1))]
    texture = fit_texture(signals, [20.0, 180.0], FS, **({"order": 10} if fit_texture is fit_lpc else {}))
    shown = displayed_signals(texture, 0.2, duration_s=1.0, peaks=(1.0, 2.0, 3.0, 4.0, 5.0))
    assert [x.size for x in shown] == [10_000] * 5
    assert_allclose([np.abs(x).max() for x in shown], [1, 2, 3, 4, 5])
    assert [_largest_jump_at_joins(x, 1000) for x in shown] == [0] * 5


def test_error_falls_with_the_order_to_what_the_true_model_keeps():
    x = np.convolve(_noise(28_100), [1, 0.9, 0.5, 0.3])[50:28_050]
    curve = order_curves(x, largest=60)["curve"]
    assert curve[0] > curve[3] > curve[20]
    assert_allclose(curve[20], floor(10), atol=0.05)
    assert_allclose(floor(1), np.sqrt(2 - np.sqrt(np.pi)), rtol=1e-12)


def test_a_level_that_rises_with_speed_is_predicted_better_than_by_the_nearest_recording():
    signals = [v * _noise(6000, round(v)) for v in (1.0, 2.0, 4.0, 8.0)]
    mean = mean_scores(predict_left_out(signals, [1.0, 2.0, 3.0, 4.0], "noise", order=10))
    ours, nearest = mean.loc["LPC, log level"], mean.loc["nearest speed"]
    assert ours.level_db < 0.5
    assert nearest.level_db > 5
    assert ours.log_spectral_db < nearest.log_spectral_db
