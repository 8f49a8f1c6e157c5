import itertools
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from texclass.haptics.exchange import Rendition, play_ahap, play_taps, read_ahap, write_ahap
from texclass.haptics.exchange.ahap import FELT_HZ, FS, MAX_POINTS, PLAYED_HZ
from texclass.haptics.textures.okamura2001 import TapLibrary
from texclass.vibration import TapModel

TAPS = TapLibrary(("wood", "steel"), (TapModel(300.0, 80.0, 155.0), TapModel(-800.0, 40.0, 600.0)))


def make_rendition(samples, fs=1000.0):
    return Rendition("cloth", "m/s^2", fs, samples, 80.0, 1.0, losses={"speed": "fixed"})


def swell(seconds, fs=1000.0, hz=150.0):
    t = np.arange(round(seconds * fs)) / fs
    return 3 * np.sin(np.pi * t / seconds) * np.sin(2 * np.pi * hz * t)


def test_curves_are_short_and_continuous(tmp_path):
    names = "HapticIntensityControl", "HapticSharpnessControl"
    for seconds, name in itertools.product((0.001, 0.02, 0.3, 0.62, 2.0, 30.0), names):
        write_ahap(make_rendition(swell(seconds)), tmp_path / "a.ahap")
        items = json.loads((tmp_path / "a.ahap").read_text())["Pattern"]
        curves = [item["ParameterCurve"] for item in items if "ParameterCurve" in item]
        end = 0.0
        for curve in (curve for curve in curves if curve["ParameterID"] == name):
            times = [point["Time"] for point in curve["ParameterCurveControlPoints"]]
            assert times[0] == 0
            assert times == sorted(times)
            assert len(times) <= MAX_POINTS
            assert curve["Time"] == pytest.approx(end, abs=1e-5)
            end = curve["Time"] + times[-1]
        if seconds > 0.1:
            assert end == pytest.approx(seconds, abs=1e-5)


def test_intensity_follows_the_level_and_sharpness_the_frequency(tmp_path):
    x = swell(1.0)
    losses = write_ahap(make_rendition(x), tmp_path / "a.ahap")
    pattern = read_ahap(tmp_path / "a.ahap")
    event = pattern.Pattern[0].Event
    assert (event.EventType, event.EventDuration) == ("HapticContinuous", 1.0)
    middle = np.log(150 / FELT_HZ[0]) / np.log(FELT_HZ[1] / FELT_HZ[0])
    assert_allclose(event.parameter("HapticSharpness", 0.0), middle, atol=0.02)
    played = play_ahap(pattern)
    envelope = [np.sqrt(2 * np.mean(np.square(frame))) for frame in np.split(played, 10)]
    expected = np.sin(np.pi * (np.arange(10) + 0.5) / 10)
    assert_allclose(envelope, expected, atol=0.06)
    power = np.abs(np.fft.rfft(played))
    played_hz = PLAYED_HZ[0] + middle * (PLAYED_HZ[1] - PLAYED_HZ[0])
    assert_allclose(np.argmax(power) * FS / played.size, played_hz, atol=6)
    assert losses["band"].endswith(f"played at about {played_hz:.0f} Hz")
    full = np.sqrt(np.mean(np.square(x[490:510])))
    assert_allclose(float(losses["level"].split()[2]), full, rtol=0.02)
    assert losses["speed"] == "fixed"


def test_taps_are_transients_relative_to_the_strongest(tmp_path):
    write_ahap(play_taps(TAPS), tmp_path / "a.ahap")
    events = [item.Event for item in read_ahap(tmp_path / "a.ahap").Pattern]
    assert [event.EventType for event in events] == ["HapticTransient"] * 2
    assert [event.Time for event in events] == [0.0, 0.25]
    assert events[1].parameter("HapticIntensity", 0.0) == 1
    sharpness = [event.parameter("HapticSharpness", 0.0) for event in events]
    assert_allclose(np.diff(sharpness), np.log(600 / 155) / np.log(50), atol=1e-3)
    played = play_ahap(read_ahap(tmp_path / "a.ahap"))
    assert np.abs(played[2000:]).max() > np.abs(played[:1900]).max() > 0.1


def test_silence_is_written_as_silence(tmp_path):
    write_ahap(make_rendition(np.zeros(500)), tmp_path / "a.ahap")
    assert not play_ahap(read_ahap(tmp_path / "a.ahap")).any()


def test_values_outside_their_range_are_clamped_and_very_long_patterns_are_refused(tmp_path):
    event = {"Time": 0, "EventType": "HapticContinuous", "EventDuration": 0.1, "Vendor": 1}
    event["EventParameters"] = [{"ParameterID": "HapticIntensity", "ParameterValue": 7}]
    pattern = {"Version": 1.0, "Pattern": [{"Event": event}]}
    (tmp_path / "a.ahap").write_text(json.dumps(pattern))
    assert 0.99 < np.abs(play_ahap(read_ahap(tmp_path / "a.ahap"))).max() <= 1
    pattern["Pattern"] *= 11
    messages = {1e6: "at most 600 s, got 1e\\+06 s", 599.0: "got 6589 s"}
    for seconds, match in messages.items():
        event["EventDuration"] = seconds
        (tmp_path / "a.ahap").write_text(json.dumps(pattern))
        with pytest.raises(ValueError, match=match):
            play_ahap(read_ahap(tmp_path / "a.ahap"))


def test_sharpness_keeps_the_order_and_the_frequency_ratios_of_a_set(tmp_path):
    rng, sharpness = np.random.default_rng(0), []
    centres = [30.0, 90.0, 150.0, 240.0, 330.0, 480.0, 700.0]
    for hz in centres:
        t = np.arange(8000) / 8000
        x = sum(np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in hz * np.array([0.9, 1.0, 1.1]))
        x = x + 3 * np.sin(2 * np.pi * 2500 * t) + 20 * np.sin(2 * np.pi * 3 * t)  # cannot be felt
        write_ahap(make_rendition(x, 8000.0), tmp_path / "a.ahap")
        sharpness.append(read_ahap(tmp_path / "a.ahap").Pattern[0].Event.parameter("HapticSharpness", 0.0))
    assert 0 < sharpness[0] < sharpness[-1] < 1
    assert_allclose(np.diff(sharpness), np.diff(np.log(centres)) / np.log(50), atol=0.01)


def test_files_of_one_full_scale_keep_their_level_differences(tmp_path):
    levels = []
    for factor in (1.0, 10 ** (-27 / 20)):
        losses = write_ahap(make_rendition(factor * swell(1.0)), tmp_path / "a.ahap", full_scale=2.5)
        levels.append(20 * np.log10(play_ahap(read_ahap(tmp_path / "a.ahap")).std()))
        assert losses["level"].startswith(
            "relative to 2.5 m/s^2, which is intensity 1; the strongest moment has"
        )
    assert_allclose(levels[0] - levels[1], 27, atol=0.1)
    losses = write_ahap(make_rendition(10 * swell(1.0)), tmp_path / "a.ahap", full_scale=2.5)
    assert "18.6 dB stronger and is limited" in losses["level"]
    assert np.abs(play_ahap(read_ahap(tmp_path / "a.ahap"))).max() <= 1
    losses = write_ahap(play_taps(TAPS), tmp_path / "a.ahap", full_scale=200.0)
    events = [item.Event for item in read_ahap(tmp_path / "a.ahap").Pattern]
    peaks = play_taps(TAPS).taps[:, 1]
    intensities = [event.parameter("HapticIntensity", 0.0) for event in events]
    assert_allclose(intensities, peaks / 200, atol=1e-3)
    with pytest.raises(ValueError, match="full_scale must be positive"):
        write_ahap(make_rendition(swell(1.0)), tmp_path / "a.ahap", full_scale=0.0)
