"""Textures between a few speeds, and the number of signals that a surface needs."""

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oeztuerk2018 import TABLE_3_1
from oeztuerk2018_study import (
    check_rendering,
    count_intervals,
    error_floor,
    interval_signals,
    intervals_from_speeds,
    mean_scores,
    mirror,
    order_curves,
    predict_held_out_speeds,
    seamless_signal,
)
from scipy import signal

from texclass.haptics.textures.oeztuerk2018 import (
    FADE_FRACTION,
    FRICTION,
    N_INTERVALS,
    FrequencyTexture,
    LpcTexture,
    fit_frequencies,
    fit_lpc,
    speed_intervals,
    track_lines,
)
from texclass.vibration import Autoregression, MajorFrequencies, fit, interpolation, major_frequencies
from texclass.vibration.major_frequencies import BEAT_THRESHOLDS_HZ

# Textures ---------------------------------------------------------------------------------------------------


FS = 10_000.0
SPEEDS = [50.0, 100.0, 200.0]


def _recording(v, seed=0, n=8000):
    rng = np.random.default_rng((seed, round(v)))
    sos = signal.butter(2, [v, 3 * v], btype="band", fs=FS, output="sos")
    return v * signal.sosfilt(sos, rng.standard_normal(n))


RECORDINGS = [_recording(v) for v in SPEEDS]
TEXTURES = {
    "lpc": fit_lpc(RECORDINGS, SPEEDS, FS, order=40, name="felt"),
    "frequencies": fit_frequencies(RECORDINGS, SPEEDS, FS, name="felt"),
}


@pytest.fixture(params=sorted(TEXTURES))
def texture(request):
    return TEXTURES[request.param]


def test_output_is_bounded_over_random_paths_and_speed_jumps_do_not_click(texture):
    check = check_rendering(texture, 0, 8)
    assert check["is_bounded"]
    assert check["relative_step"] < 1.3


def test_without_contact_or_motion_the_texture_becomes_silent(texture):
    renderer = texture.renderer()
    moving = np.tile([100.0, 0.0], (3000, 1))
    assert np.abs(renderer.process(moving, np.ones(3000))[1000:]).max() > 0.1 * texture.peak
    assert np.abs(renderer.process(moving, np.zeros(3000))[2000:]).max() < 1e-6 * texture.peak
    assert np.abs(renderer.process(0 * moving, np.ones(3000))[2000:]).max() < 1e-6 * texture.peak


def test_below_the_lowest_speed_the_texture_fades_in_proportion(texture):
    v = FADE_FRACTION * SPEEDS[0] / 2
    n = 20_000
    loud, half = (
        texture.renderer(seed=2).process(np.tile([u, 0.0], (n, 1)), np.ones(n))[2000:] for u in (SPEEDS[0], v)
    )
    assert_allclose(half, loud / 2, atol=1e-6 * texture.peak)


@pytest.mark.parametrize("speed", [50.0, 75.0, 160.0])
def test_the_rendered_spectrum_is_that_of_the_model_at_the_speed(speed):
    texture = TEXTURES["lpc"]
    n = 100_000
    y = texture.renderer(seed=0).process(np.tile([0.0, speed], (n, 1)), np.ones(n))[2000:]
    f, power = signal.welch(y, FS, nperseg=512)
    band = (f > 60) & (f < 500)
    expected = texture.at(speed).log_spectrum_db(2 * np.pi * f[band] / FS) + 10 * np.log10(2 / FS)
    assert np.sqrt(np.mean((10 * np.log10(power[band]) - expected) ** 2)) < 1.0
    assert_allclose(y.std(), texture.at(speed).level, rtol=0.1)


def test_lpc_models_equal_the_fit_at_recorded_speeds_and_the_interpolation_between_them():
    texture = TEXTURES["lpc"]
    slow, middle = (fit(x - x.mean(), 40) for x in RECORDINGS[:2])
    assert_allclose(texture.at(50.0).level, slow.level, rtol=1e-9)
    assert_allclose(
        texture.at(75.0).reflection, interpolation.interpolate(slow, middle, 0.5).reflection, atol=1e-9
    )
    assert_allclose(texture.at(20.0).reflection, texture.at(50.0).reflection)
    assert_allclose(texture.at(900.0).reflection, texture.at(200.0).reflection)


def test_tracks_equal_the_interpolated_frequencies_and_oscillators_render_them():
    texture = TEXTURES["frequencies"]
    for speed in (50.0, 60.0, 100.0, 170.0, 200.0, 300.0):
        index = np.interp(speed, texture.speeds, [0, 1, 2])
        i = min(int(index), 1)
        expected = major_frequencies.interpolate(*texture.models[i : i + 2], index - i)
        assert_array_equal(texture.at(speed).phase, expected.phase)
        f, A = ((1 - index + i) * table[i] + (index - i) * table[i + 1] for table in texture.tracks[:2])
        order = np.argsort(f[A > 0])
        assert_allclose(f[A > 0][order], expected.frequency_hz)
        assert_allclose(A[A > 0][order], expected.amplitude)
    n = 20_000
    y = texture.renderer().process(np.tile([50.0, 0.0], (n, 1)), np.ones(n))
    assert_allclose(y[3000:], texture.at(50.0).synthesize(n, FS)[3000:], atol=1e-6 * texture.peak)


def test_paired_lines_move_unpaired_lines_fade_and_the_peak_is_that_of_the_recording():
    slow = MajorFrequencies([100.0, 300.0], [1.0, 2.0], [0.0, 0.0])
    fast = MajorFrequencies([104.0, 600.0], [3.0, 4.0], [0.0, 0.0])
    frequency_hz, amplitude, _ = track_lines([slow, fast])
    assert_array_equal(frequency_hz, [[100, 300, 600], [104, 300, 600]])
    assert_array_equal(amplitude, [[1, 2, 0], [3, 0, 4]])
    for x, model in zip(RECORDINGS, TEXTURES["frequencies"].models, strict=True):
        assert_allclose(np.abs(model.synthesize(x.size, FS)).max(), np.abs(x - x.mean()).max(), rtol=1e-9)


def test_invalid_models_are_refused():
    lines = TEXTURES["frequencies"].models
    for call in (
        *(
            lambda k=k: LpcTexture(SPEEDS, Autoregression(k, np.ones(k.shape[:-1])), 1.0, FS)
            for k in (np.zeros((2, 4)), np.zeros(3), np.zeros((3, 0)), np.full((3, 400), 0.99))
        ),
        lambda: LpcTexture(SPEEDS, TEXTURES["lpc"].models, 1.0, FS, loudness="loud"),
        lambda: LpcTexture(SPEEDS, TEXTURES["lpc"].models, 0.0, FS),
        lambda: LpcTexture(SPEEDS, TEXTURES["lpc"].models, 1.0, -1.0),
        lambda: FrequencyTexture(SPEEDS, lines[:2], 1.0, FS),
        lambda: FrequencyTexture(SPEEDS, [MajorFrequencies([], [], [])] * 3, 1.0, FS),
        lambda: FrequencyTexture(SPEEDS, [MajorFrequencies([1, 2], [1e308] * 2, [0, 0])] * 3, 1.0, FS),
        lambda: TEXTURES["lpc"].at(-1.0),
        lambda: TEXTURES["frequencies"].at(np.nan),
    ):
        with pytest.raises(ValueError, match=r"must (be|have)"):
            call()


def test_invalid_recordings_are_refused():
    for fit_texture, (signals, speeds) in product(
        (fit_lpc, fit_frequencies),
        (
            (RECORDINGS[:1], [50.0]),
            (RECORDINGS[:2], [50.0]),
            (RECORDINGS[:2], [50.0, 50.0]),
            (RECORDINGS[:2], [0.0, 50.0]),
            ([RECORDINGS[0], np.ones(100)], [50.0, 60.0]),
            ([RECORDINGS[0], [np.nan] * 100], [50.0, 60.0]),
        ),
    ):
        with pytest.raises(ValueError, match=r"speeds must be|contains 100 NaN|Expected a vibration"):
            fit_texture(signals, speeds, FS)


# Displayed signals and intervals of the thesis --------------------------------------------------------------


def _noise(n, seed=0):
    return np.random.default_rng(seed).standard_normal(n)


def _largest_jump_at_joins(repeated, n):
    joins = np.arange(n, repeated.size, n)
    return np.abs(repeated[joins] - repeated[joins - 1]).max()


def test_one_second_is_repeated_for_ten_seconds_by_mirrored_copies_without_a_jump():
    x = _noise(10_000)
    assert_array_equal(seamless_signal(x, FS), np.tile(mirror(x), 5))
    repeated = seamless_signal(x[:777], FS, duration_s=0.5, peak=2.5)
    assert _largest_jump_at_joins(repeated, 777) == 0
    assert_allclose(np.abs(repeated).max(), 2.5)
    assert not seamless_signal(np.zeros(10), FS, peak=1.0).any()


def test_intervals_are_those_of_table_6_1_and_decrease_with_friction():
    assert str(speed_intervals(0.6)) == "0-4, 4-8, > 8 cm/s"
    assert str(speed_intervals(0.2)) == "0-4, 4-8, 8-12, 12-16, > 16 cm/s"
    assert str(speed_intervals(0.4)) == "0-4, 4-8, 8-12, > 12 cm/s"
    assert speed_intervals(0.4).centres_mm_s == (20, 60, 100, 140)
    counts = [speed_intervals(mu).n_intervals for mu in np.linspace(0, 2, 201)]
    assert np.all(np.diff(counts) <= 0)
    assert (counts[0], counts[-1]) == (7, 1)
    assert tuple(speed_intervals(mu).n_intervals for mu in FRICTION) == N_INTERVALS


def test_the_intervals_of_a_distribution_of_speeds_end_at_its_last_notable_bin():
    v = np.concatenate([np.full(60, 10.0), np.full(30, 90.0), np.full(8, 130.0), np.full(2, 300.0)])
    assert intervals_from_speeds(v).n_intervals == 4
    assert intervals_from_speeds(v, notable_share=0.1).n_intervals == 3
    assert intervals_from_speeds(np.linspace(1, 400, 100), notable_share=0.5).n_intervals == 1


def test_simulated_speeds_need_about_the_published_number_of_intervals():
    for mu, n in zip(FRICTION, N_INTERVALS, strict=True):
        counts = np.repeat(*np.array(list(enumerate(count_intervals(mu, 0)["simulated"]))).T)
        assert abs(np.median(counts) - n) <= 1
    assert tuple(max(row) for row in TABLE_3_1) == BEAT_THRESHOLDS_HZ


def test_invalid_frictions_are_refused():
    for mu in (-0.1, np.nan, np.inf):
        with pytest.raises(ValueError, match="friction must be finite"):
            speed_intervals(mu)


@pytest.mark.parametrize("fit_texture", [fit_lpc, fit_frequencies])
def test_each_interval_gets_one_seamless_signal(fit_texture):
    signals = [a * _noise(2000, seed) for a, seed in ((1, 0), (3, 1))]
    texture = fit_texture(signals, [20.0, 180.0], FS, **({"order": 10} if fit_texture is fit_lpc else {}))
    results = interval_signals(texture, 0.2, duration_s=1.0, peaks=(1.0, 2.0, 3.0, 4.0, 5.0))
    assert [x.size for x in results] == [10_000] * 5
    assert_allclose([np.abs(x).max() for x in results], [1, 2, 3, 4, 5])
    assert [_largest_jump_at_joins(x, 1000) for x in results] == [0] * 5


def test_the_error_decreases_with_the_order_to_that_of_the_true_model():
    x = np.convolve(_noise(28_100), [1, 0.9, 0.5, 0.3])[50:28_050]
    curve = order_curves(x, largest=60)["same_recording"]
    assert curve[0] > curve[3] > curve[20]
    assert_allclose(curve[20], error_floor(10), atol=0.05)
    assert_allclose(error_floor(1), np.sqrt(2 - np.sqrt(np.pi)), rtol=1e-12)


def test_a_level_that_rises_with_speed_is_predicted_better_than_by_the_nearest_recording():
    signals = [v * _noise(6000, round(v)) for v in (1.0, 2.0, 4.0, 8.0)]
    mean = mean_scores(predict_held_out_speeds(signals, [1.0, 2.0, 3.0, 4.0], "noise", order=10))
    ours, nearest = mean.loc["LPC, log level"], mean.loc["nearest speed"]
    assert ours.level_db < 0.5
    assert nearest.level_db > 5
    assert ours.log_spectral_db < nearest.log_spectral_db
