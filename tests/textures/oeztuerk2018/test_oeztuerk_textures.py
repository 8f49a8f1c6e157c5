from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oeztuerk2018_study import render_check
from scipy import signal

from texclass.textures.oeztuerk2018 import (
    STILL,
    FrequencyTexture,
    LpcTexture,
    fit_frequencies,
    fit_lpc,
    follow_lines,
)
from texclass.vibration import Autoregression, MajorFrequencies, fit, interpolation, major_frequencies

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


def test_output_is_finite_and_bounded_over_random_paths_and_speed_jumps_cause_no_click(texture):
    found = render_check(texture, 0, 8)
    assert found["finite"]
    assert found["click"] < 1.3


def test_without_contact_or_motion_it_falls_silent(texture):
    renderer = texture.renderer()
    moving = np.tile([100.0, 0.0], (3000, 1))
    assert np.abs(renderer.process(moving, np.ones(3000))[1000:]).max() > 0.1 * texture.peak
    assert np.abs(renderer.process(moving, np.zeros(3000))[2000:]).max() < 1e-6 * texture.peak
    assert np.abs(renderer.process(0 * moving, np.ones(3000))[2000:]).max() < 1e-6 * texture.peak


def test_below_the_slowest_speed_it_fades_in_proportion(texture):
    v = STILL * SPEEDS[0] / 2
    n = 20_000
    loud, half = (
        texture.renderer(seed=2).process(np.tile([u, 0.0], (n, 1)), np.ones(n))[2000:] for u in (SPEEDS[0], v)
    )
    assert_allclose(half, loud / 2, atol=1e-6 * texture.peak)


@pytest.mark.parametrize("speed", [50.0, 75.0, 160.0])
def test_rendered_spectrum_is_that_of_the_model_at_the_speed(speed):
    texture = TEXTURES["lpc"]
    n = 100_000
    y = texture.renderer(seed=0).process(np.tile([0.0, speed], (n, 1)), np.ones(n))[2000:]
    f, power = signal.welch(y, FS, nperseg=512)
    band = (f > 60) & (f < 500)
    expected = texture.at(speed).log_spectrum_db(2 * np.pi * f[band] / FS) + 10 * np.log10(2 / FS)
    assert np.sqrt(np.mean((10 * np.log10(power[band]) - expected) ** 2)) < 1.0
    assert_allclose(y.std(), texture.at(speed).level, rtol=0.1)


def test_lpc_at_a_recorded_speed_is_the_fit_and_between_the_interpolation():
    texture = TEXTURES["lpc"]
    slow, middle = (fit(x - x.mean(), 40) for x in RECORDINGS[:2])
    assert_allclose(texture.at(50.0).level, slow.level, rtol=1e-9)
    assert_allclose(
        texture.at(75.0).reflection, interpolation.interpolate(slow, middle, 0.5).reflection, atol=1e-9
    )
    assert_allclose(texture.at(20.0).reflection, texture.at(50.0).reflection)
    assert_allclose(texture.at(900.0).reflection, texture.at(200.0).reflection)


def test_tracks_between_speeds_are_the_interpolated_frequencies_and_oscillators_render_them():
    texture = TEXTURES["frequencies"]
    for speed in (50.0, 60.0, 100.0, 170.0, 200.0, 300.0):
        place = np.interp(speed, texture.speeds, [0, 1, 2])
        i = min(int(place), 1)
        expected = major_frequencies.interpolate(*texture.models[i : i + 2], place - i)
        assert_array_equal(texture.at(speed).phase, expected.phase)
        f, A = ((1 - place + i) * table[i] + (place - i) * table[i + 1] for table in texture.tracks[:2])
        order = np.argsort(f[A > 0])
        assert_allclose(f[A > 0][order], expected.frequency_hz)
        assert_allclose(A[A > 0][order], expected.amplitude)
    n = 20_000
    y = texture.renderer().process(np.tile([50.0, 0.0], (n, 1)), np.ones(n))
    assert_allclose(y[3000:], texture.at(50.0).synthesize(n, FS)[3000:], atol=1e-6 * texture.peak)


def test_a_line_that_pairs_glides_one_that_does_not_fades_and_all_have_the_recorded_peak():
    slow = MajorFrequencies([100.0, 300.0], [1.0, 2.0], [0.0, 0.0])
    fast = MajorFrequencies([104.0, 600.0], [3.0, 4.0], [0.0, 0.0])
    frequency_hz, amplitude, _ = follow_lines([slow, fast])
    assert_array_equal(frequency_hz, [[100, 300, 600], [104, 300, 600]])
    assert_array_equal(amplitude, [[1, 2, 0], [3, 0, 4]])
    for x, model in zip(RECORDINGS, TEXTURES["frequencies"].models, strict=True):
        assert_allclose(np.abs(model.synthesize(x.size, FS)).max(), np.abs(x - x.mean()).max(), rtol=1e-9)


def test_broken_models_are_refused():
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
        with pytest.raises(ValueError, match="rule is"):
            call()


def test_bad_recordings_are_refused():
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
        with pytest.raises(ValueError, match="rule is"):
            fit_texture(signals, speeds, FS)
