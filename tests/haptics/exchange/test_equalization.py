"""The inverse of a device's response is limited, and its remaining error and headroom are stated."""

import json
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal
from typer.testing import CliRunner

from texclass.cli import app
from texclass.haptics import commands
from texclass.haptics.exchange import (
    Equalizer,
    Rendition,
    equalize,
    play_hjif,
    play_taps,
    play_texture,
    read_hjif,
    read_response,
    read_wav,
    save_texture,
    write_hjif,
)
from texclass.haptics.exchange.equalization import MAX_BOOST_DB
from texclass.haptics.scene import PlannedScene, write_scene_page
from texclass.haptics.scene.pages import FULL_SCALE_FACTOR, middle_stroke, tap_modes
from texclass.haptics.textures import GridModel, pack
from texclass.haptics.textures.oeztuerk2018 import FrequencyTexture
from texclass.haptics.textures.okamura2001 import TapLibrary
from texclass.vibration import MajorFrequencies, TapModel

FS = 1000.0
HZ = np.geomspace(20, 450, 80)
NOISE = np.random.default_rng(0).standard_normal(20_000)
ROWS = "\n".join(["frequency,gain_db", "20,-30", "60,-10", "150,0", "450,-14"])


def resonance(hz, centre=150.0, quality=4.0):
    """Return the magnitude of an actuator with a resonance, whose response is flat above it."""
    ratio = hz / centre
    return ratio**2 / np.abs(1 - ratio**2 + 1j * ratio / quality)


def band_levels(x, fs=FS, response=None):
    """Return the levels of bands of 25 Hz from 25 Hz on, as played by a device with this response."""
    hz, power = signal.welch(x, fs, nperseg=1000)
    power = power * (1.0 if response is None else response(hz) ** 2)
    return 10 * np.log10(power[25:450].reshape(-1, 25).mean(axis=1))


@pytest.mark.parametrize("fs", [1000.0, 8000.0])
def test_a_device_with_a_resonance_plays_the_vibration_of_the_surface(fs):
    equalizer = Equalizer(HZ, resonance(HZ), max_boost_db=40.0)
    n = round(fs / FS)
    x = signal.resample_poly(NOISE, n, 1)
    played = equalizer.apply(x, fs)
    levels = [
        band_levels(signal.resample_poly(y, 1, n), FS, response)
        for y, response in ((x, None), (played, equalizer.response), (x, equalizer.response))
    ]
    assert np.abs(levels[1] - levels[0]).max() < 0.5
    assert np.abs(levels[2] - levels[0]).max() > 10


def test_the_filter_inverts_a_minimum_phase_device_in_time():
    b, a = signal.butter(1, [100, 200], "bandpass", fs=FS)
    hz = np.linspace(2, 498, 400)
    gain = np.abs(signal.freqz(b, a, hz, fs=FS)[1])
    equalizer = Equalizer(hz, gain, max_boost_db=60.0)
    x = signal.sosfiltfilt(signal.butter(4, [60, 350], "bandpass", fs=FS, output="sos"), NOISE)
    played = signal.lfilter(b, a, equalizer.apply(x, FS))
    assert np.corrcoef(played[500:], x[500:])[0, 1] > 0.98


def test_the_boost_is_limited_and_the_loss_is_stated():
    gain = resonance(HZ)
    equalizer = Equalizer(HZ, gain, max_boost_db=15.0)
    boost_db = 20 * np.log10(equalizer.target_gain(HZ) * gain.max())
    assert boost_db.max() == pytest.approx(15)
    lack_db = -20 * np.log10(equalizer.target_gain(HZ) * gain)
    text = equalizer.describe(NOISE, FS)["device"]
    stated = re.search(r"boost is limited to 15 dB, so 20 to (\d+) Hz.* up to ([\d.]+) dB too weak", text)
    assert float(stated[2]) == pytest.approx(lack_db.max(), abs=0.1)
    assert float(stated[1]) == pytest.approx(HZ[np.argmax(lack_db <= 0.05)], rel=0.05)
    worst, worst_without = map(float, re.findall(r"at most ([\d.]+) dB.*and ([\d.]+) dB\)", text)[0])
    assert 0 < worst < worst_without
    unlimited = Equalizer(HZ, gain, max_boost_db=60.0).describe(NOISE, FS)["device"]
    assert "limited" not in unlimited
    assert float(re.search(r"by ([\d.]+) dB RMS", unlimited)[1]) < 0.6
    assert "known from 20 to 450 Hz" in unlimited


def test_the_scale_of_the_gain_is_that_of_the_vibration():
    equalizer = Equalizer(HZ, np.full(HZ.size, 0.25))
    y = equalizer.apply(NOISE, FS)
    assert_allclose(y, 4 * NOISE, atol=0.05)
    stated = float(re.search(r"changes by (\S+) dB", equalizer.describe(NOISE, FS)["headroom"])[1])
    assert stated == pytest.approx(20 * np.log10(np.abs(y).max() / np.abs(NOISE).max()), abs=0.06)
    assert Equalizer(HZ, np.ones(HZ.size)).describe(np.zeros(100), FS) == {"device": "silence"}


def test_noise_lines_and_taps_of_a_hjif_file_are_equalised(tmp_path):
    equalizer = Equalizer(HZ, resonance(HZ), max_boost_db=40.0)
    models = [MajorFrequencies([90.0, 210.0], [1.0, 0.5], [0.1, 0.2])] * 2
    lines = FrequencyTexture([50.0, 150.0], models, 3.0, 2000.0, "slate")
    for rendition in (Rendition("noise", "m/s^2", FS, NOISE, 80.0, 1.0), play_texture(lines)):
        losses = write_hjif(equalize(rendition, equalizer), tmp_path / "a.hjif")
        assert "third-octave levels on the device" in losses["device"]
        played = signal.resample_poly(play_hjif(read_hjif(tmp_path / "a.hjif"))[:, 0], 1, 8)
        wanted = signal.resample_poly(rendition.samples, 1, round(rendition.fs / FS))
        on_device, levels = band_levels(played, FS, equalizer.response), band_levels(wanted)
        is_strong = levels > levels.max() - 15
        assert_allclose(on_device[is_strong], levels[is_strong], atol=0.8)
    taps = play_taps(
        TapLibrary(("wood", "steel"), (TapModel(300.0, 80.0, 60.0), TapModel(800.0, 40.0, 400.0)))
    )
    ratio = equalize(taps, equalizer).taps[:, 1] / taps.taps[:, 1]
    assert_allclose(ratio, equalizer.target_gain(np.array([60.0, 400.0])), rtol=0.05)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hz,gain\n20,1\n50,2", "columns must be frequency .Hz. and gain .ratio. or gain_db, got hz, gain"),
        ("frequency,gain\n20,1", "at least 2 rows"),
        ("frequency,gain\n50,1\n20,2", "increasing, positive frequencies"),
        ("frequency,gain\n20,1\n50,0", "positive gains"),
        ("frequency,gain_db\n20,nan\n50,2", "positive gains"),
        ("frequency,gain\n20,x\n50,2", "could not convert"),
        ("", "No columns"),
    ],
)
def test_invalid_responses_are_refused(text, message, tmp_path):
    path = tmp_path / "response.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        read_response(path)
    assert str(path) in str(error.value)


def test_an_invalid_boost_is_refused():
    with pytest.raises(ValueError, match="between 0 and 100 dB, got -1"):
        Equalizer(HZ, resonance(HZ), max_boost_db=-1.0)


@pytest.fixture
def files(tmp_path):
    (tmp_path / "response.csv").write_text(ROWS)
    texture = pack(np.random.default_rng(0).standard_normal(4000), 40, fs=FS, name="noise")
    return save_texture(texture, tmp_path / "noise.texture"), tmp_path / "response.csv"


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_commands_equalise_wav_and_hjif_and_refuse_other_formats(files, tmp_path):
    texture, response = files
    equalizer = read_response(response)
    plain = play_texture(pack(np.random.default_rng(0).standard_normal(4000), 40, fs=FS)).samples
    result = run("convert", texture, "-o", tmp_path / "a.wav", "--physical", "--device", response)
    assert result.exit_code == 0, result.output
    assert "dB RMS" in result.output
    assert "boost is limited to 20 dB" in " ".join(result.output.split())
    assert_allclose(read_wav(tmp_path / "a.wav").samples, equalizer.apply(plain, FS), atol=1e-5)
    arguments = ("--device", response, "--max-boost", 40)
    assert run("convert", texture, "-o", tmp_path / "a.hjif", *arguments).exit_code == 0
    assert run("convert", texture, "-o", tmp_path / "plain.hjif").exit_code == 0
    result = run("convert", tmp_path / "plain.hjif", "-o", tmp_path / "b.wav", "--physical", *arguments)
    assert result.exit_code == 0, result.output
    on_device = [
        band_levels(signal.resample_poly(x, 1, 8), FS, equalizer.response)
        for x in (play_hjif(read_hjif(tmp_path / "a.hjif"))[:, 0], read_wav(tmp_path / "b.wav").samples)
    ]
    assert_allclose(on_device[0], on_device[1], atol=1.0)
    assert_allclose(on_device[0], band_levels(plain), atol=1.0)
    for name in ("a.ahap", "a.xml"):
        error = run("convert", texture, "-o", tmp_path / name, "--device", response).exception
        assert "--device applies to .wav and .hjif" in str(error)
    assert "--full-scale applies to .ahap" in str(
        run("convert", texture, "-o", tmp_path / "a.wav", "--full-scale", 3).exception
    )
    assert "add --page" in str(run("texture", texture, "--device", response).exception)
    result = run("convert", texture, "-o", tmp_path / "a.ahap", "--full-scale", 3)
    assert "relative to 3 m/s^2, which is intensity 1" in " ".join(result.output.split())


def test_pages_and_rendered_scenes_are_equalised(files, tmp_path):
    texture, response = files
    equalizer = read_response(response)
    grid = GridModel(([50.0, 200.0], [0.5, 2.0]), np.full((2, 2, 1), 0.5), np.full((2, 2), 4.0), 5.0)
    scene = PlannedScene("desk", FS, "m/s^2", (20.0, 400.0), 30.0, 1, {"wood": 0}, (grid,))
    tap = TapModel(30.0, 90.0, 60.0)
    path = write_scene_page(tmp_path / "a.html", scene, taps={"wood": tap}, equalizer=equalizer)
    data = json.loads(re.search(r'<script[^>]*id="scene"[^>]*>(.*?)</script>', path.read_text(), re.S)[1])
    assert_allclose(data["equalizer"], equalizer.taps(FS))
    x = middle_stroke(scene, "wood")
    assert data["full_scale"] == pytest.approx(FULL_SCALE_FACTOR * equalizer.apply(x, FS).std())
    plain, equalized = (np.array(tap_modes(tap, e)[0]) for e in (None, equalizer))
    assert equalized[0] / plain[0] == pytest.approx(equalizer.target_gain([60.0])[0], rel=0.05)
    saved = scene.save(tmp_path / "desk.texture")
    for words in (
        ("scene", "page", saved, "-o", tmp_path / "b.html"),
        ("texture", texture, "--page", tmp_path / "c.html"),
        ("scene", "render", saved, "-o", tmp_path / "b.wav", "--physical"),
    ):
        result = run(*words, "--device", response)
        assert result.exit_code == 0, result.output
        assert "dB RMS" in result.output
    assert run("scene", "render", saved, "-o", tmp_path / "d.wav", "--physical").exit_code == 0
    played, plain = (read_wav(tmp_path / name).samples for name in ("b.wav", "d.wav"))
    assert_allclose(played, equalizer.apply(plain, FS), atol=1e-4)


def test_commands_have_the_default_boost_of_python():
    assert commands.MAX_BOOST_DB == MAX_BOOST_DB
