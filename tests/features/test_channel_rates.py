"""Recordings whose signals have different sampling rates: features, windows and conversions."""

import numpy as np
import pytest
from feature_signals import noise

from texclass.features import FeatureExtractor, load_feature_set
from texclass.features.friction import friction
from texclass.features.phase_view import pairs_of, separate_channels, views_of
from texclass.features.plan import Plan
from texclass.phases import find_phases
from texclass.recording import Phases, Recording, RecordingError
from texclass.tradeoff.cost_curves import resample

FS, SLOW_FS, SECONDS = 10_000, 1000, 4
MOVEMENT = Phases(movement=(10_000, 35_000))
T = np.arange(SECONDS * SLOW_FS) / SLOW_FS
FRICTION = 0.4 + 0.1 * np.sin(2 * np.pi * 3 * T) + 0.05 * T


def scraped(**changes):
    """Return 4 s of acceleration at 10 kHz next to friction at 1 kHz, with movement from 1 to 3.5 s."""
    facts = {"friction": FRICTION, "auxiliary_fs": {"friction": SLOW_FS}, "phases": MOVEMENT} | changes
    return Recording(noise(SECONDS * FS), FS, **facts)


def robot(imu_fs=100, mic_fs=10_000, seconds=20, **changes):
    """Return an inertial sensor at 100 Hz and a contact microphone at 10 kHz, with movement from 2 s on."""
    imu, mic = noise(6 * imu_fs * seconds, 1).reshape(-1, 6), noise(mic_fs * seconds, 2)
    facts = {"turn_rate": imu[:, 3:], "sound": mic, "auxiliary_fs": {"sound": mic_fs}}
    phases = Phases(movement=(2 * imu_fs, seconds * imu_fs))
    return Recording(imu[:, :3], imu_fs, **{"phases": phases, **facts, **changes})


def features_of(recording, channels="all", names=("mfcc", "vibration_level", "fineness")):
    extractor = FeatureExtractor(load_feature_set("texclass").restricted_to(list(names)), channels=channels)
    return extractor.set_output(transform="pandas").fit_transform([recording]).iloc[0]


def test_friction_is_read_at_its_own_rate_during_the_movement():
    during = FRICTION[1000:3500]
    view = views_of(scraped())[""].friction
    assert view.fs == SLOW_FS
    np.testing.assert_array_equal(view.samples, during)
    extractor = FeatureExtractor(load_feature_set("strese2015").restricted_to(["friction"]))
    (value,) = extractor.fit_transform([scraped()])[0]
    assert value == friction(during, fs=SLOW_FS)


def test_windows_cut_all_signals_at_the_same_times():
    recording = scraped(auxiliary_fs={"friction": SLOW_FS, "speed": 30}, speed=np.arange(120.0))
    windows = [recording.cut(k, k + 3333, str(k)) for k in range(0, 39_996, 3333)]
    for k, window in enumerate(windows):
        start_s = 3333 * k / FS
        assert window.auxiliary_fs == recording.auxiliary_fs
        for name, signal, rate in (("friction", FRICTION, SLOW_FS), ("speed", np.arange(120.0), 30)):
            part = getattr(window, name)
            first = int(np.flatnonzero(signal == part[0])[0])
            assert abs(first / rate - start_s) <= 0.5 / rate + 1e-9
            assert abs(len(part) / rate - window.duration_s) <= 1 / rate + 1e-9
    np.testing.assert_array_equal(np.concatenate([one.friction for one in windows]), FRICTION)
    np.testing.assert_array_equal(np.concatenate([one.speed for one in windows]), np.arange(120.0))
    # A window shorter than the sampling interval of a signal contains its nearest sample.
    assert recording.cut(5000, 5100, "short").speed.tolist() == [15.0]


def test_an_inertial_sensor_and_a_microphone_have_the_features_of_each_alone():
    both = robot()
    features = features_of(both)
    inertial = features_of(both.with_(sound=None))
    alone = Recording(both.sound, 10_000, phases=Phases(movement=(20_000, 200_000)))
    sound = features_of(alone, "combine").add_prefix("sound/")
    assert len(inertial) + len(sound) == len(features)
    assert separate_channels(both, "all") == ("x", "y", "z", "turn_x", "turn_y", "turn_z", "sound")
    np.testing.assert_array_equal(features[inertial.index], inertial)
    np.testing.assert_array_equal(features[sound.index], sound)
    assert features_of(both, "combine").equals(features_of(both.with_(sound=None), "combine"))


def test_a_turn_rate_keeps_its_rate_in_single_channels_and_is_interpolated_in_pairs():
    t = np.arange(4000) / 200
    turn = np.column_stack([np.sin(2 * np.pi * f * t) for f in (1, 2, 3)])
    slow = Recording(
        turn, 200, turn_rate=turn[::2], auxiliary_fs={"turn_rate": 100}, phases=Phases(movement=(0, 4000))
    )
    channels = separate_channels(slow, "all")
    views = views_of(slow, channels)
    assert (views["x/"].movement.fs, views["turn_y/"].movement.fs) == (200, 100)
    np.testing.assert_allclose(views["turn_y/"].movement.samples, turn[::2, 1], atol=1e-12)
    sides = views["x*turn_x/"].of("pair").sides
    assert [side.fs for side in sides] == [200, 200]
    np.testing.assert_allclose(sides[1].samples[:-1], sides[0].samples[:-1], atol=1e-3)
    correlations = load_feature_set("coarse").restricted_to(["lag_correlation"])
    values = Plan.of(correlations, channels).compute(slow).values
    assert np.isfinite(values).all()
    assert pairs_of(("x", "turn_x", "sound")) == (("x", "turn_x"),)


def test_the_speed_is_interpolated_for_the_path_of_the_tool():
    speed = 50 + 10 * np.sin(2 * np.pi * 0.5 * np.arange(SECONDS * FS) / FS)
    fast = scraped(speed=speed)
    slow = scraped(speed=speed[::10], auxiliary_fs={"friction": SLOW_FS, "speed": 1000})
    expected, view = (views_of(one)[""].travel for one in (fast, slow))
    assert view.fs == pytest.approx(expected.fs, rel=1e-4)
    np.testing.assert_allclose(view.samples[:2000], expected.samples[:2000], atol=0.02)


def test_phases_are_found_in_the_acceleration_and_converted():
    signal = noise(SECONDS * FS) * np.repeat([0.01, 1.0], [10_000, 30_000])
    recording = scraped(phases=None).with_(acceleration=signal)
    assert find_phases(recording).movement == find_phases(recording.with_(friction=None)).movement
    phases = find_phases(recording)
    own = recording.with_(phases=phases).as_acceleration("friction")
    assert (own.fs, own.unit, own.friction, own.native_fs) == (SLOW_FS, "arbitrary", None, SLOW_FS)
    np.testing.assert_array_equal(own.acceleration, FRICTION)
    times, expected = np.array(own.phases.movement) / SLOW_FS, np.array(phases.movement) / FS
    np.testing.assert_allclose(times, expected, atol=0.5 / SLOW_FS)
    assert expected[0] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"auxiliary_fs": {}}, r"friction has 4000 samples, .* Expected the same duration .*auxiliary_fs_hz"),
        (
            {"auxiliary_fs": {"friction": 500}},
            "friction has 4000 samples at 500 Hz, but acceleration has 40000",
        ),
        ({"auxiliary_fs": {"friction": 0}}, "Expected a positive sampling rate"),
        ({"auxiliary_fs": {"fricton": 500}}, "auxiliary_fs names fricton. Expected some of friction, "),
    ],
)
def test_a_wrong_rate_is_refused(changes, message):
    with pytest.raises(RecordingError, match=message):
        scraped(**changes)


def test_the_rate_of_the_acceleration_and_of_missing_signals_is_not_kept():
    assert scraped(auxiliary_fs={"friction": FS, "speed": 10}, friction=noise(40_000)).auxiliary_fs == {}
    recording = scraped()
    assert recording.facts["other signals"] == "friction at 1000 Hz"
    assert recording.rate_of("friction") == SLOW_FS
    assert recording.rate_of("speed") == FS
    assert recording.with_interpolated("speed") is recording
    one_rate = recording.with_interpolated("friction")
    assert one_rate.auxiliary_fs == {}
    np.testing.assert_array_equal(one_rate.friction[::10], FRICTION)


def test_a_lower_rate_of_the_sensor_lowers_all_rates():
    half = resample(scraped(), FS / 2)
    assert (half.fs, half.auxiliary_fs) == (FS / 2, {"friction": SLOW_FS / 2})
    np.testing.assert_allclose(half.friction[100:-100], FRICTION[::2][100:-100], atol=1e-3)
    assert half.phases.movement == (5000, 17_500)


def test_recordings_with_different_rates_of_a_signal_are_not_mixed():
    other = scraped(friction=FRICTION[::2], auxiliary_fs={"friction": 500}, recording_id="other")
    extractor = FeatureExtractor(load_feature_set("strese2015").restricted_to(["friction"]))
    with pytest.raises(RecordingError, match=r"other: the rates of signals in Hz are .*500.*1000"):
        extractor.fit_transform([scraped(), other])
    level = FeatureExtractor(load_feature_set("texclass").restricted_to(["vibration_level"]))
    assert len(level.fit_transform([scraped(), other])) == 2  # no feature reads the friction
