"""Feature sets: what a TOML may say, and that a restricted set computes only what it needs."""

from pathlib import Path

import numpy as np
import pytest

from texclass.features.contract import Feature, UndefinedFeatureError
from texclass.features.phase_view import views_of
from texclass.features.sets import FeatureSet, Member, load_feature_set
from texclass.recording import Phases, Recording
from texclass.shipped import names

CALLS: list[str] = []


def level(view, *, power: float = 2.0):
    CALLS.append("level")
    return np.mean(np.abs(view.samples) ** power)


def moments(view):
    CALLS.append("moments")
    return np.array([view.samples.min(), view.samples.max()])


def undefined(view):
    raise UndefinedFeatureError("silence")


def infinite(view):
    return -np.inf


def broken(view):
    raise KeyError("oops")


def too_many(view):
    return np.zeros(3)


def stand_in(function, outputs=()):
    return Feature(function.__name__, function, "movement", "1", "test", outputs)


def a_set(*functions):
    members = (Member(f.__name__, stand_in(f, ("min", "max") if f is moments else ())) for f in functions)
    return FeatureSet("toy", tuple(members))


@pytest.fixture
def views():
    signal = np.random.default_rng(0).normal(size=200)
    recording = Recording(signal, fs=1000, unit="g", recording_id="r1", phases=Phases(movement=(0, 200)))
    return views_of(recording)[""]


def write(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", names("feature_defs"))
def test_shipped_sets_have_unique_columns_that_begin_with_their_feature(name):
    feature_set = load_feature_set(name)
    assert len(set(feature_set.column_names)) == len(feature_set.column_names)
    assert all(c.split(".")[0] == f for f, columns in feature_set.columns.items() for c in columns)


def test_an_override_changes_the_value_and_the_hash(tmp_path, views):
    plain = load_feature_set(write(tmp_path, "[features.m]\nuse = 'mfcc'"))
    other = load_feature_set(write(tmp_path, "[features.m]\nuse = 'mfcc'\nhop_s = 0.02"))
    assert plain.columns == other.columns
    assert plain.hash != other.hash
    assert not np.allclose(plain.compute(views)[0], other.compute(views)[0])


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("[features.friction]\nhopp = 1", r"mine\.toml: features\.friction: unknown key hopp"),
        ("[features.m]\nuse = 'mfcc'\nhopp_s = 1", "hopp_s.*hop_s"),
        ("[features.frictoin]", "did you mean friction"),
        ("[features.m]\nuse = 'mfcc'\nhop_s = 'long'", r"features\.m: hop_s is 'long'"),
        ("features = 3", "features is 3; the rule"),
        ("name = 'x'", "lacks the key features"),
        ("features = {}", "at least 1"),
        ("features.friction = 3", r"features\.friction is 3; the rule"),
        ("flavour = 'x'\n[features.friction]", "unknown key flavour"),
        ("[features.friction", "not valid TOML"),
    ],
)
def test_a_wrong_set_is_refused_with_file_key_and_rule(tmp_path, text, rule):
    with pytest.raises(ValueError, match=rule):
        load_feature_set(write(tmp_path, text))


def test_a_set_that_does_not_exist_lists_the_shipped_ones():
    with pytest.raises(FileNotFoundError, match="strese2015"):
        load_feature_set("nope")


def test_a_restricted_set_computes_only_what_its_columns_need(views):
    whole = a_set(level, moments)
    CALLS.clear()
    values, _ = whole.restricted_to(["moments.max"]).compute(views)
    assert CALLS == ["moments"]
    assert values == whole.compute(views)[0][[whole.column_names.index("moments.max")]]


def test_restricting_keeps_the_order_of_the_set_and_refuses_unknown_names():
    whole = a_set(level, moments)
    assert whole.restricted_to(["moments.max", "level"]).column_names == ("level", "moments.max")
    with pytest.raises(ValueError, match="'shape' is neither a feature nor a column"):
        whole.restricted_to(["shape"])


@pytest.mark.parametrize(
    ("function", "reason"), [(undefined, "silence"), (infinite, r"finite number \(-inf\)")]
)
def test_what_has_no_value_is_nan_with_its_reason(views, function, reason):
    values, reasons = a_set(function, level).compute(views)
    assert np.isnan(values[0])
    assert np.isfinite(values[1])
    assert reasons[0][0] == function.__name__
    assert reason.replace("\\", "") in reasons[0][1]


@pytest.mark.parametrize(
    ("function", "message"), [(broken, "KeyError: 'oops'"), (too_many, "declares 1 output")]
)
def test_a_feature_that_fails_is_named_with_its_recording(views, function, message):
    with pytest.raises(ValueError, match=f"r1: feature {function.__name__} .*{message}"):
        a_set(function).compute(views)
