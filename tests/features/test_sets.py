"""Feature sets: TOML files, restricted sets, and long movements computed in parts."""

import tracemalloc

import numpy as np
import pytest
from feature_signals import noise

from texclass.features import load_feature_set, sets
from texclass.features.contract import Feature, UndefinedFeatureError
from texclass.features.phase_view import views_of
from texclass.features.sets import FeatureSet, Member
from texclass.recording import Phases, Recording, Tap
from texclass.shipped import names

CALLS = []


def level(view):
    CALLS.append("level")
    return np.mean(view.samples**2)


def moments(view):
    CALLS.append("moments")
    return np.array([view.samples.min(), view.samples.max()])


def silent(view):
    raise UndefinedFeatureError("silence")


def infinite(view):
    return -np.inf


def broken(view):
    raise KeyError("oops")


def too_many(view):
    return np.zeros(3)


def size(view):
    CALLS.append(view.n_samples)
    return view.n_samples


def half_silent(view):
    if not view.samples.any():
        raise UndefinedFeatureError("silence")
    return 2.0


def a_set(*functions, phase="movement", depends_on=()):
    features = (
        Feature(
            f.__name__, f, phase, "1", "test", ("min", "max") if f is moments else (), depends_on=depends_on
        )
        for f in functions
    )
    return FeatureSet("toy", tuple(Member(f.name, f) for f in features))


@pytest.fixture
def views():
    """Return views of 1000 samples of movement, the first half silent, and one tap."""
    signal = np.concatenate([np.zeros(600), noise(500)])
    phases = Phases((Tap(0, 10, 50),), (100, 1100))
    return views_of(Recording(signal, 1000, "V", "r1", phases=phases))[""]


@pytest.fixture
def load(tmp_path):
    def load_text(text):
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return load_feature_set(path)

    return load_text


def test_shipped_sets_have_unique_columns_that_start_with_the_feature_name():
    for name in names("feature_defs"):
        feature_set = load_feature_set(name)
        assert len(set(feature_set.column_names)) == len(feature_set.column_names)
        assert all(c.split(".")[0] == f for f, columns in feature_set.columns.items() for c in columns)


def test_an_override_changes_the_value_and_the_hash(load, views):
    plain, override = load("[features.m]\nuse = 'mfcc'"), load("[features.m]\nuse = 'mfcc'\nhop_s = 0.02")
    assert plain.columns == override.columns
    assert plain.hash != override.hash
    assert not np.allclose(plain.compute(views)[0], override.compute(views)[0])
    many = load("[features.m]\nuse = 'mfcc'\ncoefficients = [2, 5]\ndecay_hz = inf\nhigh_hz = 1000")
    assert many.column_names == ("m.c2", "m.c5")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[features.friction]\nhopp = 1", r"mine\.toml: features\.friction: unknown key hopp"),
        ("[features.m]\nuse = 'mfcc'\nhopp_s = 1", "hopp_s.*hop_s"),
        ("[features.frictoin]", "Did you mean friction"),
        ("[features.m]\nuse = 'mfcc'\nhop_s = 'long'", r"features\.m: hop_s is 'long'"),
        ("[features.m]\nuse = 'mfcc'\nn_filters = true", r"features\.m: n_filters is True"),
        ("[features.m]\nuse = 'mfcc'\ncoefficients = ['a']", r"features\.m: coefficients\.1 is 'a'"),
        ("[features.band_level]\nn_bands = 100000", "must be at most 65536"),
        (
            "[features.b]\nuse = 'band_level'\n[features.'b.b1']\nuse = 'waviness'",
            "two columns have the name 'b.b1'",
        ),
        ("features = {}", "at least 1"),
        ("features.friction = 3", r"features\.friction is 3. Expected"),
    ],
)
def test_an_invalid_set_is_rejected_with_file_key_and_expected_value(load, text, message):
    with pytest.raises(ValueError, match=message):
        load(text)


def test_an_unknown_set_name_lists_the_shipped_sets():
    with pytest.raises(FileNotFoundError, match="strese2015"):
        load_feature_set("nope")


def test_a_restricted_set_computes_only_its_columns_in_the_order_of_the_set(views):
    whole = a_set(level, moments)
    CALLS.clear()
    values, _ = whole.restricted_to(["moments.max"]).compute(views)
    assert CALLS == ["moments"]
    assert values == whole.compute(views)[0][[whole.column_names.index("moments.max")]]
    assert whole.restricted_to(["moments.max", "level"]).column_names == ("level", "moments.max")
    with pytest.raises(ValueError, match="'shape' is neither a feature nor a column"):
        whole.restricted_to(["shape"])


def test_undefined_features_are_nan_with_a_reason_and_failures_name_the_recording(views):
    for function, reason in ((silent, "silence"), (infinite, "not a finite number (-inf)")):
        values, reasons = a_set(function, level).compute(views)
        assert np.isnan(values[0])
        assert np.isfinite(values[1])
        assert reasons == ((function.__name__, reason),)
    for function, message in ((broken, "failed with KeyError: 'oops'"), (too_many, "declares 1 output")):
        with pytest.raises(ValueError, match=f"r1: feature {function.__name__} .*{message}"):
            a_set(function).compute(views)


def test_a_long_movement_has_the_mean_over_the_parts_with_a_value(views, monkeypatch):
    monkeypatch.setattr(sets, "MAX_MOVEMENT_SAMPLES", 300)
    CALLS.clear()
    values, reasons = a_set(size, half_silent, silent).compute(views)
    assert CALLS == [250] * 4
    assert (values[:2].tolist(), reasons) == ([250.0, 2.0], (("silent", "silence"),))
    assert np.isnan(values[2])
    # Features of taps and features that depend on the length are computed as a whole.
    assert a_set(lambda view: len(view.taps), phase="tap").compute(views)[0].tolist() == [1.0]
    assert a_set(size, depends_on=("length",)).compute(views)[0].tolist() == [1000.0]


def test_a_steady_movement_has_the_same_features_in_parts_and_as_a_whole(monkeypatch):
    recording = Recording(noise(30_000, 1), 2000.0, "V", phases=Phases(movement=(0, 30_000)))
    features = load_feature_set("texclass").with_phases("movement")
    whole, _ = features.compute(views_of(recording)[""])
    monkeypatch.setattr(sets, "MAX_MOVEMENT_SAMPLES", 10_000)
    divided, _ = features.compute(views_of(recording)[""])
    course = ["band_course", "fine_band_course", "level_persistence"]  # random for noise
    noisy = np.isin(features.column_names, features.columns_of(course))
    np.testing.assert_allclose(divided[~noisy], whole[~noisy], rtol=0.05, atol=0.05)
    np.testing.assert_allclose(divided[noisy], whole[noisy], atol=0.15)


def test_printed_features_of_a_long_movement_need_the_memory_of_five_copies():
    n = 1 << 20
    recording = Recording(np.random.default_rng(0).standard_normal(n), 1e4, phases=Phases(movement=(0, n)))
    printed = load_feature_set("strese2015")
    printed.compute(views_of(recording)[""])  # results that are cached by length stay in memory
    tracemalloc.start()
    printed.compute(views_of(recording)[""])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 5.2 * 8 * n
