"""Phase views: cached transforms, segments of a movement, and the samples that a feature reads."""

import numpy as np
import pytest
from feature_signals import noise
from scipy import fft

from texclass.features.bands import band_course, band_level
from texclass.features.contract import feature, list_features
from texclass.features.movement_filters import level
from texclass.features.phase_view import (
    MIN_SEGMENT_SAMPLES,
    PhaseView,
    UndefinedFeatureError,
    separate_channels,
    transform,
    trimmed_length,
    undefined_if,
    views_of,
)
from texclass.features.sets import load_feature_set
from texclass.features.slopes import vibration_level
from texclass.recording import Phases, Recording, Tap
from texclass.signals import combine, remove_hand_motion

FS = 1000.0
CALLS = []


@transform
def scaled(view, factor, offset=0.0, *, negative=False):
    CALLS.append((factor, offset, negative))
    return (-1 if negative else 1) * (factor * view.n_samples + offset)


def test_a_transform_is_computed_once_for_positional_and_keyword_parameters():
    CALLS.clear()
    view = PhaseView(np.zeros(7), 100.0)
    forms = [
        scaled(view, 2.0),
        scaled(view, 2.0, 0.0),
        scaled(view, factor=2.0),
        scaled(view, 2.0, offset=0.0),
    ]
    assert {*forms, scaled(view, 2.0, negative=False)} == {14.0}
    assert CALLS == [(2.0, 0.0, False)]
    assert [scaled(view, 2.0, 1.0), scaled(view, 3.0), scaled(view, 2.0, negative=True)] == [15, 21, -14]
    assert scaled(PhaseView(np.zeros(1), 100.0), 2.0) == 2.0
    assert len(CALLS) == 5


def test_a_failing_transform_is_not_cached_and_invalid_arguments_are_rejected():
    view = PhaseView(np.zeros(7), 100.0)
    for arguments, keywords, message in (
        ((), {}, "factor"),
        ((1.0, 2.0, 3.0), {}, "positional"),
        ((1.0,), {"unknown": 2.0}, "unknown"),
    ):
        for _ in range(2):
            with pytest.raises(TypeError, match=message):
                scaled(view, *arguments, **keywords)
    assert not view.memory


X = noise(4 * MIN_SEGMENT_SAMPLES) * np.linspace(1, 2, 4 * MIN_SEGMENT_SAMPLES)


def test_each_segment_has_the_value_of_the_segment_alone():
    values = band_level(PhaseView(X, FS), n_bands=8, n_segments=4).reshape(8, 4)
    for i, segment in enumerate(X.reshape(4, -1)):  # sums of several segments have another order
        np.testing.assert_allclose(
            values[:, i], band_level(PhaseView(segment, FS), n_bands=8), rtol=1e-6, atol=1e-6
        )


def test_segments_of_a_short_movement_have_the_value_of_the_movement():
    view = PhaseView(X, FS)
    np.testing.assert_array_equal(band_course(view, n_parts=3, n_segments=1), band_course(view, n_parts=3))
    short = PhaseView(X[:-1], FS)  # too short: counts as equal segments
    assert vibration_level(short, n_segments=4).tolist() == 4 * vibration_level(short).tolist()


def test_a_feature_of_single_signals_is_computed_segment_by_segment(monkeypatch):
    monkeypatch.setattr("texclass.features.contract._REGISTRY", list_features())

    @feature("movement", "m/s^2", "test", divisible=True)
    def last_magnitude(view):
        undefined_if(view.samples[-1] == 0, "the last sample is 0")
        return abs(float(view.samples[-1])) / level(view)

    view, timed = PhaseView(X, FS), []
    view.memory.timed = lambda key, compute: (timed.append((key[0].__name__, *key[1:])), compute())[1]
    ends = np.abs(X.reshape(4, -1)) / np.abs(X.reshape(4, -1)).max(axis=1, keepdims=True)
    np.testing.assert_array_equal(last_magnitude(view, n_segments=4), ends[:, -1])
    assert ("level", "segment 3", "4 segments") in timed
    zero = X.copy()
    zero[2 * MIN_SEGMENT_SAMPLES - 1] = 0
    with pytest.raises(UndefinedFeatureError, match="segment 2: the last sample is 0"):
        last_magnitude(PhaseView(zero, FS), n_segments=4)


@pytest.mark.parametrize("name", [n for n, f in list_features().items() if f.divisible == "at once"])
def test_segments_computed_at_once_equal_segments_computed_separately(name):
    function = list_features()[name].function
    values = function(PhaseView(X, FS), n_segments=4)
    alone = [np.atleast_1d(function(PhaseView(segment, FS))) for segment in X.reshape(4, -1)]
    np.testing.assert_allclose(values.reshape(-1, 4), np.stack(alone, axis=1), rtol=1e-6, atol=1e-7)


def test_segments_share_their_transforms_which_are_timed_together():
    timed = []
    view = PhaseView(X, FS)
    view.memory.timed = lambda key, compute: (timed.append((key[0].__name__, *key[1:])), compute())[1]
    band_level(view, n_segments=2)
    assert ("whole_periodogram", "2 segments") in timed
    n_timed = len(timed)
    band_level(view, n_segments=2)
    assert len(timed) == n_timed


def test_an_undefined_segment_and_an_invalid_number_of_segments_are_named():
    quiet = X.copy()
    quiet[MIN_SEGMENT_SAMPLES : 2 * MIN_SEGMENT_SAMPLES] = 0
    with pytest.raises(UndefinedFeatureError, match="segment 2: silence"):
        band_level(PhaseView(quiet, FS), n_segments=4)
    for n_segments in (0, -1, 1.5):
        with pytest.raises(ValueError, match="n_segments must be a positive whole number"):
            band_level(PhaseView(X, FS), n_segments=n_segments)


def test_the_set_multiscale_contains_features_of_texclass_on_quarters():
    quarters, names = load_feature_set("multiscale"), {m.name for m in load_feature_set("texclass").members}
    own = [m.feature.function.__module__ for m in quarters.members if m.name not in names]
    assert set(own) == {"texclass.features.residual_bands"}
    shared = quarters.restricted_to(m.name for m in quarters.members if m.name in names)
    whole = load_feature_set("texclass").restricted_to(m.name for m in shared.members)
    assert shared.column_names == tuple(f"{c}.segment{i}" for c in whole.column_names for i in (1, 2, 3, 4))
    for a, b in zip(whole.members, shared.members, strict=True):
        assert (a.name, {**a.parameters, "n_segments": 4}) == (b.name, b.parameters)
    assert {m.parameters["n_segments"] for m in quarters.members} == {4}


def exploration(**changes):
    """Return a quiet start, one tap, one movement, and gravity on the last axis."""
    rng = np.random.default_rng(0)
    axes = 0.01 * rng.normal(size=(1000, 3))
    axes[200:230] += np.exp(-np.arange(30) / 8)[:, None] * [1.0, 0.5, 0.5]
    axes[400:] += rng.normal(size=(600, 3))
    axes[:, -1] += 9.81
    phases = Phases(taps=(Tap(180, 200, 260),), movement=(400, 1000), onset=400)
    return Recording(axes, FS, "m/s^2", phases=phases).with_(**changes)


def test_hand_motion_is_removed_only_on_request_and_if_gravity_is_measured():
    movement = combine(exploration().acceleration[400:])
    views = views_of(exploration())[""]
    np.testing.assert_allclose(views.of("movement").samples, movement, atol=3e-5)
    np.testing.assert_allclose(
        views.of("movement", remove_hand_motion=True).samples, remove_hand_motion(movement, FS), atol=3e-5
    )
    for unit in ("m/s^2", "counts"):
        level = exploration().acceleration - [0.0, 0.0, 9.81 * (unit == "m/s^2")]
        view = views_of(exploration(acceleration=level, unit=unit))[""].of(
            "movement", remove_hand_motion=True
        )
        np.testing.assert_allclose(view.samples, combine(level[400:]), atol=3e-5)


def test_a_long_movement_is_trimmed_to_a_fast_length():
    for n in (5001, 17_003, 40_000, 99_991):
        length = trimmed_length(n)
        assert 0.93 * n <= length <= n
        assert length % 4 == 0
        assert fft.prev_fast_len(length, real=True) == length
    assert trimmed_length(5000) == 5000


def test_printed_features_keep_frequencies_below_10_hz_and_do_not_depend_on_the_unit():
    rng, n = np.random.default_rng(0), 12_000
    axes = 0.3 * rng.normal(size=(n, 3)) + [0.0, 3.0, 9.0]
    axes[:, 0] += 2 * np.sin(2 * np.pi * 1.5 * np.arange(n) / 10_000)  # hand motion
    phases = Phases(taps=(Tap(180, 200, 260),), movement=(1000, n))
    views_by_unit = {
        unit: views_of(Recording(axes, 10_000, unit, friction=axes[:, 1], phases=phases))[""]
        for unit in ("m/s^2", "V", "counts", "arbitrary")
    }
    for name in ("strese2015", "strese2015+models"):
        values = [load_feature_set(name).compute(views)[0] for views in views_by_unit.values()]
        np.testing.assert_array_equal(values, values[:1] * len(values))
    printed, corrected = (
        load_feature_set(name).restricted_to(["waviness"]).compute(views_by_unit["m/s^2"])[0][0]
        for name in ("strese2015", "texclass")
    )
    assert printed > corrected + 0.5  # contains the hand motion at 1.5 Hz


def test_taps_are_split_at_the_contact_on_their_resting_level():
    one_axis = exploration(acceleration=exploration().acceleration[:, 0] + 9.81, channels=())
    (tap,) = views_of(one_axis)[""].tap.taps
    assert (tap.hand.size, tap.impulse.size) == (20, 60)
    assert np.median(tap.hand) == pytest.approx(0, abs=0.02)
    assert tap.impulse[0] == pytest.approx(1.0, abs=0.05)


def test_noise_of_the_quiet_start_does_not_depend_on_the_taps():
    strong = exploration().acceleration.copy()
    strong[200:260] *= 100
    noise_level = views_of(exploration())[""].tap.noise
    assert noise_level == pytest.approx(0.01 * np.sqrt(3), rel=0.1)
    assert views_of(exploration(acceleration=strong))[""].tap.noise == noise_level


def test_friction_is_limited_to_the_movement():
    friction = np.r_[np.full(400, 9.0), np.full(600, -2.0)]
    assert (views_of(exploration(friction=friction))[""].friction.samples == -2.0).all()


def test_auto_combines_the_axes_of_one_accelerometer_only():
    for channels, separate in (
        ((), ()), (("acc_x", "acc_y", "acc_z"), ()), (("c1", "c2", "c3"), ("c1", "c2", "c3"))
    ):  # fmt: skip
        assert separate_channels(exploration(channels=channels), "auto") == separate
    with pytest.raises(ValueError, match=r"channels must be .combine"):
        separate_channels(exploration(), "both")


def test_all_adds_the_axes_of_the_turn_rate():
    recording = exploration(turn_rate=noise(3000).reshape(1000, 3), channels=("ax", "ay", "az"))
    separate = separate_channels(recording, "all")
    assert separate == ("ax", "ay", "az", "turn_x", "turn_y", "turn_z")
    assert (
        separate_channels(recording, "each")
        == separate_channels(recording.with_(turn_rate=None), "all")
        == separate[:3]
    )
    views, turn = views_of(recording, separate), recording.turn_rate[400:, 1]
    np.testing.assert_allclose(views["turn_y/"].movement.samples, turn - turn.mean())
    ay = recording.acceleration[400:, 1]
    np.testing.assert_allclose(views["ay/"].movement.samples, ay - ay.mean())
    with pytest.raises(ValueError, match=r"has the axes ax, ay, az\. Expected .*turn_z"):
        views_of(recording.with_(turn_rate=None), separate)
