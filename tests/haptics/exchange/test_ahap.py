import itertools
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from texclass.haptics.exchange import Rendition, play_ahap, play_taps, read_ahap, write_ahap
from texclass.haptics.exchange.ahap import FS, MAX_POINTS, SHARPNESS_HZ
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
    middle = (150 - SHARPNESS_HZ[0]) / (SHARPNESS_HZ[1] - SHARPNESS_HZ[0])
    assert_allclose(event.parameter("HapticSharpness", 0.0), middle, atol=0.02)
    played = play_ahap(pattern)
    envelope = [np.sqrt(2 * np.mean(np.square(frame))) for frame in np.split(played, 10)]
    expected = np.sin(np.pi * (np.arange(10) + 0.5) / 10)
    assert_allclose(envelope, expected, atol=0.06)
    power = np.abs(np.fft.rfft(played))
    assert_allclose(np.argmax(power) * FS / played.size, 150, atol=6)
    full = np.sqrt(np.mean(np.square(x[490:510])))
    assert_allclose(float(losses["level"].split()[2]), full, rtol=0.02)
    assert losses["speed"] == "fixed"


def test_taps_are_transients_relative_to_the_strongest(tmp_path):
    write_ahap(play_taps(TAPS), tmp_path / "a.ahap")
    events = [item.Event for item in read_ahap(tmp_path / "a.ahap").Pattern]
    assert [event.EventType for event in events] == ["HapticTransient"] * 2
    assert [event.Time for event in events] == [0.0, 0.25]
    assert events[1].parameter("HapticIntensity", 0.0) == 1
    assert_allclose(events[0].parameter("HapticSharpness", 0.0), 0.5)
    assert events[1].parameter("HapticSharpness", 0.0) == 1
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
