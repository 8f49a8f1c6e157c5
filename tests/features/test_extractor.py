"""The extractor: a scikit-learn transformer whose undefined values carry reasons."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.utils.estimator_checks import estimator_checks_generator

from texclass.features.contract import Feature
from texclass.features.extractor import FeatureExtractor
from texclass.features.phase_view import channels_apart, views_of
from texclass.features.sets import FeatureSet, Member, load_feature_set
from texclass.recording import Phases, Recording, Tap
from texclass.signals import combine, remove_hand_motion

FS = 1000.0


def rms(view):
    return np.sqrt(np.mean(view.samples**2))


def strongest(view):
    return max(np.abs(tap.impulse).max() for tap in view.taps)


def voltage(view):
    return np.mean(np.abs(view.samples))


TOY = FeatureSet(
    "toy",
    tuple(
        Member(f.__name__, Feature(f.__name__, f, phase, "1", "test"))
        for f, phase in ((rms, "movement"), (strongest, "tap"), (voltage, "friction"))
    ),
)


def exploration(seed=0, *, n_channels=3, name="r", **changes):
    """Make a quiet start, one tap, one movement, gravity on the last axis."""
    rng = np.random.default_rng(seed)
    axes = 0.01 * rng.normal(size=(1000, n_channels))
    axes[200:230] += np.exp(-np.arange(30) / 8)[:, None] * [1.0, *[0.5] * (n_channels - 1)]
    axes[400:] += rng.normal(size=(600, n_channels))
    axes[:, -1] += 9.81
    phases = Phases(taps=(Tap(180, 200, 260),), movement=(400, 1000), onset=400)
    facts = {"fs": FS, "unit": "m/s^2", "recording_id": f"{name}{seed}", "phases": phases} | changes
    return Recording(axes if n_channels > 1 else axes[:, 0], **facts)


PLAIN = FeatureExtractor(load_feature_set("texclass").restricted_to(["mfcc", "waviness"]), fs=FS, unit="g")


# Named by the check alone: the estimator's representation holds addresses, which differ between processes.
@pytest.mark.parametrize(
    ("estimator", "check"),
    list(estimator_checks_generator(PLAIN)),
    ids=lambda x: getattr(x, "func", type(x)).__name__,
)
def test_extractor_is_a_scikit_learn_transformer(estimator, check):
    check(estimator)


def test_undefined_values_are_nan_with_recording_feature_and_reason():
    untapped = exploration(1, phases=Phases(movement=(400, 1000)))
    found = FeatureExtractor(TOY).fit([untapped]).extract([untapped, exploration(2)])
    assert np.isnan(found.values).tolist() == [[False, True, True], [False, False, True]]
    assert ("r1", "strongest", "no tap found") in found.reasons
    assert ("r2", "voltage", "no friction signal") in found.reasons
    assert found.recording_ids == ("r1", "r2")
    assert (found.ms > 0).all()


@pytest.mark.parametrize("unit", ["m/s^2", "counts"])
def test_movement_without_gravity_in_it_is_left_as_it_is(unit):
    acceleration = exploration().acceleration - [0.0, 0.0, 9.81 * (unit == "m/s^2")]
    recording = exploration().with_(acceleration=acceleration, unit=unit)
    value = FeatureExtractor(TOY).fit_transform([recording])[0, 0]
    assert value == pytest.approx(rms_of(combine(recording.acceleration[400:])), rel=1e-12)


def test_movement_is_the_combined_movement_without_the_hand():
    recording = exploration()
    value = FeatureExtractor(TOY).fit_transform([recording])[0, 0]
    movement = remove_hand_motion(combine(recording.acceleration[400:]), recording.fs)
    assert value == pytest.approx(rms_of(movement), rel=1e-12)


def rms_of(signal):
    return np.sqrt(np.mean(signal**2))


def test_friction_is_read_during_the_movement_only():
    friction = np.r_[np.full(400, 9.0), np.full(600, -2.0)]
    assert FeatureExtractor(TOY).fit_transform([exploration(friction=friction)])[0, 2] == 2.0


def test_taps_are_split_at_the_contact_on_their_resting_level():
    view = views_of(exploration(n_channels=1))[""].tap
    (tap,) = view.taps
    assert (tap.hand.size, tap.impulse.size) == (20, 60)
    assert np.median(tap.hand) == pytest.approx(0, abs=0.02)
    assert tap.impulse[0] == pytest.approx(1.0, abs=0.05)


def test_noise_of_the_quiet_stretch_does_not_see_the_taps():
    recording = exploration()
    strong = recording.acceleration.copy()
    strong[200:260] *= 100
    noise = views_of(recording)[""].tap.noise
    assert noise == pytest.approx(0.01 * np.sqrt(3), rel=0.1)
    assert views_of(recording.with_(acceleration=strong))[""].tap.noise == noise


def test_each_channel_gives_the_columns_of_that_channel_alone():
    recording = exploration(channels=("a", "b", "c"))
    each = FeatureExtractor(TOY, channels="each").fit([recording])
    assert each.get_feature_names_out().tolist() == [
        f"{c}/{f}" for c in "abc" for f in ("rms", "strongest")
    ] + ["voltage"]
    alone = recording.with_(acceleration=recording.acceleration[:, 1], channels=())
    values = FeatureExtractor(TOY).fit_transform([alone])[0, :2]
    np.testing.assert_allclose(each.transform([recording])[0, 2:4], values)


@pytest.mark.parametrize(
    ("channels", "apart"),
    [((), ()), (("acc_x", "acc_y", "acc_z"), ()), (("c1", "c2", "c3"), ("c1", "c2", "c3"))],
)
def test_auto_combines_the_axes_of_one_accelerometer_only(channels, apart):
    assert channels_apart(exploration(channels=channels), "auto") == apart


def test_channels_that_differ_from_the_first_recording_are_refused():
    first, other = exploration(channels=("a", "b", "c")), exploration(channels=("a", "b", "d"))
    extractor = FeatureExtractor(TOY, channels="each").fit([first])
    with pytest.raises(ValueError, match=r"\('a', 'b', 'd'\); the rule is \('a', 'b', 'c'\)"):
        extractor.transform([other])


def test_an_array_needs_a_rate():
    X = np.random.default_rng(0).normal(size=(3, 400))
    with pytest.raises(ValueError, match="fs is None; the rule is a sampling rate"):
        FeatureExtractor(TOY).fit(X)


@pytest.mark.parametrize("nothing", [[], "strese2015", None])
def test_what_is_neither_recordings_nor_an_array_is_refused(nothing):
    with pytest.raises(ValueError):  # noqa: PT011  (scikit-learn words it)
        FeatureExtractor(TOY, fs=FS, unit="g").fit(nothing)


def test_an_array_gives_what_recordings_of_movement_give():
    X = np.random.default_rng(0).normal(size=(2, 400))
    whole = Phases(movement=(0, 400))
    recordings = [Recording(x, fs=FS, unit="g", recording_id=str(i), phases=whole) for i, x in enumerate(X)]
    of_array = FeatureExtractor(TOY, fs=FS, unit="g").fit_transform(X)
    np.testing.assert_array_equal(of_array, FeatureExtractor(TOY).fit_transform(recordings))


def test_output_can_be_a_data_frame_and_processes_change_nothing():
    recordings = [exploration(seed, name="p") for seed in range(3)]
    few = load_feature_set("texclass").restricted_to(["fineness", "mfcc"])
    one = FeatureExtractor(few).set_output(transform="pandas")
    two = clone(one).set_params(n_jobs=2)
    frame = one.fit_transform(recordings)
    assert list(frame.columns) == list(few.column_names)
    assert frame.equals(two.fit_transform(recordings))


def test_transform_leaves_the_fitted_extractor_as_it_is():
    extractor = FeatureExtractor(TOY).fit([exploration()])
    before = {name: id(value) for name, value in vars(extractor).items()}
    extractor.transform([exploration(1), exploration(2)])
    assert {name: id(value) for name, value in vars(extractor).items()} == before
