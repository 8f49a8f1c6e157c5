import numpy as np
import pytest
import soundfile as sf
from numpy.testing import assert_allclose, assert_array_equal

from texclass.textures.oeztuerk2018 import (
    displayed_signals,
    fit_frequencies,
    fit_lpc,
    intervals_from_speeds,
    mirrored,
    seamless,
    speed_intervals,
    write_wav,
)
from texclass.textures.oeztuerk2018.intervals import FRICTION, N_INTERVALS
from texclass.textures.oeztuerk2018.orders import floor, order_curves
from texclass.textures.oeztuerk2018.prediction import mean_scores, predict_left_out
from texclass.textures.oeztuerk2018.seamless import largest_jump_at_joins
from texclass.textures.oeztuerk2018.simulated import stroking_speeds
from texclass.textures.oeztuerk2018.study import TABLE_3_1, interval_row
from texclass.vibration.major_frequencies import BEAT_THRESHOLDS_HZ

FS = 10_000.0


def _noise(n, seed=0):
    return np.random.default_rng(seed).standard_normal(n)


def test_one_second_becomes_ten_of_five_mirrored_copies():
    x = _noise(10_000)
    endless = seamless(x, FS)
    assert_array_equal(endless, np.tile(mirrored(x), 5))
    assert endless.size == 100_000


def test_joins_have_no_jump_and_the_peak_is_the_references():
    x = _noise(777)
    endless = seamless(x, FS, duration_s=0.5, peak=2.5)
    assert largest_jump_at_joins(endless, 777) == 0
    assert_allclose(np.abs(endless).max(), 2.5)
    assert not seamless(np.zeros(10), FS, peak=1.0).any()


def test_wav_keeps_the_unit_or_says_the_factor(tmp_path):
    x = 3 * _noise(1000)
    for sample_format, tolerance in (("FLOAT", 1e-6), ("PCM_16", 1e-4)):
        path = tmp_path / f"{sample_format}.wav"
        factor = write_wav(path, x, FS, sample_format=sample_format)
        read, fs = sf.read(path)
        assert fs == FS
        assert_allclose(read * factor, x, atol=tolerance * np.abs(x).max())


@pytest.mark.parametrize(("fs", "sample_format"), [(1000.5, "FLOAT"), (FS, "MP3"), (-1.0, "FLOAT")])
def test_wav_refuses_what_it_cannot_keep(tmp_path, fs, sample_format):
    with pytest.raises(ValueError, match="rule is"):
        write_wav(tmp_path / "x.wav", [0.0, 1.0], fs, sample_format=sample_format)


@pytest.mark.parametrize(
    ("friction", "published"),
    [
        (0.6, "0-4, 4-8, > 8 cm/s"),
        (0.2, "0-4, 4-8, 8-12, 12-16, > 16 cm/s"),
        (0.4, "0-4, 4-8, 8-12, > 12 cm/s"),
    ],
)
def test_intervals_are_those_of_table_6_1(friction, published):
    assert str(speed_intervals(friction)) == published


def test_more_friction_never_asks_for_more_intervals():
    counts = [speed_intervals(mu).n_intervals for mu in np.linspace(0, 2, 201)]
    assert np.all(np.diff(counts) <= 0)
    assert (counts[0], counts[-1]) == (7, 1)
    assert tuple(speed_intervals(mu).n_intervals for mu in FRICTION) == N_INTERVALS


def test_each_speed_belongs_to_the_interval_that_holds_it():
    intervals = speed_intervals(0.4)
    assert_array_equal(intervals.index([0, 39, 40, 119, 120, 900]), [0, 0, 1, 2, 3, 3])
    assert_array_equal(intervals.index(intervals.centres_mm_s), [0, 1, 2, 3])


def test_speeds_ask_for_intervals_up_to_the_last_notable_bin():
    v = np.concatenate([np.full(60, 10.0), np.full(30, 90.0), np.full(8, 130.0), np.full(2, 300.0)])
    assert intervals_from_speeds(v).n_intervals == 4
    assert intervals_from_speeds(v, notable=0.1).n_intervals == 3


def test_simulated_speeds_ask_for_about_the_published_intervals():
    for mu, n in zip(FRICTION, N_INTERVALS, strict=True):
        assert abs(np.median(interval_row(mu, 0).found) - n) <= 1
    assert stroking_speeds(0.2, np.random.default_rng(0)).size == 240


@pytest.mark.parametrize("friction", [-0.1, np.nan, np.inf])
def test_impossible_friction_is_refused(friction):
    with pytest.raises(ValueError, match="rule is"):
        speed_intervals(friction)


@pytest.mark.parametrize("speed", [[-1.0], [], [np.nan]])
def test_impossible_speeds_are_refused(speed):
    with pytest.raises(ValueError, match="rule is"):
        intervals_from_speeds(speed)


def test_table_3_2_takes_the_largest_thresholds_of_table_3_1():
    assert tuple(max(row) for row in TABLE_3_1) == BEAT_THRESHOLDS_HZ


@pytest.mark.parametrize("fit_texture", [fit_lpc, fit_frequencies])
def test_one_seamless_signal_is_made_for_each_interval(fit_texture, tmp_path):
    signals = [a * _noise(2000, seed) for a, seed in ((1, 0), (3, 1))]
    options = {"order": 10} if fit_texture is fit_lpc else {}
    texture = fit_texture(signals, [20.0, 180.0], FS, **options)
    shown = displayed_signals(texture, 0.2, duration_s=1.0, peaks=(1.0, 2.0, 3.0, 4.0, 5.0))
    assert [x.size for x in shown.signals] == [10_000] * 5
    assert_allclose([np.abs(x).max() for x in shown.signals], [1, 2, 3, 4, 5])
    assert [largest_jump_at_joins(x, 1000) for x in shown.signals] == [0] * 5
    assert [p.name for p in shown.write(tmp_path, "oak")] == [f"oak-{i}.wav" for i in range(1, 6)]


def test_error_falls_with_the_order_to_what_the_true_model_keeps():
    rng = np.random.default_rng(0)
    x = np.convolve(rng.standard_normal(28_100), [1, 0.9, 0.5, 0.3])[50:28_050]
    curves = order_curves(x, largest=60)
    assert curves.curve[0] > curves.curve[3] > curves.curve[20]
    assert_allclose(curves.curve[20], floor(10), atol=0.05)
    assert_allclose(floor(1), np.sqrt(2 - np.sqrt(np.pi)), rtol=1e-12)


def test_a_level_that_rises_with_speed_is_predicted_better_than_by_the_nearest_recording():
    signals = [v * _noise(6000, round(v)) for v in (1.0, 2.0, 4.0, 8.0)]
    found = predict_left_out(signals, [1.0, 2.0, 3.0, 4.0], FS, surface="noise", order=10)
    mean = mean_scores(found)
    assert mean["LPC, log level"].level_db < 0.5
    assert mean["nearest speed"].level_db > 5
    assert mean["LPC, log level"].log_spectral_db < mean["nearest speed"].log_spectral_db
