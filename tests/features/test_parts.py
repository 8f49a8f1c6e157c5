"""A long movement in parts: the mean of the parts, in the memory of one; short ones as ever."""

import numpy as np
import pytest

from texclass.features import load_feature_set, sets
from texclass.features.contract import Feature, UndefinedFeatureError
from texclass.features.phase_view import views_of
from texclass.features.sets import FeatureSet, Member
from texclass.recording import Phases, Recording, Tap

SEEN: list[int] = []


def size(view):
    SEEN.append(view.n_samples)
    return view.n_samples


def deviation(view):
    return view.samples.std()


def half_silent(view):
    if not view.samples.any():
        raise UndefinedFeatureError("silence")
    return 2.0


def never(view):
    raise UndefinedFeatureError("never")


def n_taps(view):
    return len(view.taps)


def a_set(*functions, phase="movement", depends_on=()):
    made = (Feature(f.__name__, f, phase, "1", "test", depends_on=frozenset(depends_on)) for f in functions)
    return FeatureSet("toy", tuple(Member(f.name, f) for f in made))


@pytest.fixture
def views(monkeypatch):
    """1000 samples of movement, the first half silent, in parts of 300 at most; one tap."""
    monkeypatch.setattr(sets, "LONGEST", 300)
    signal = np.concatenate([np.zeros(600), np.random.default_rng(0).normal(size=500)])
    phases = Phases((Tap(0, 10, 50),), (100, 1100))
    return views_of(Recording(signal, fs=1000, unit="V", recording_id="r", phases=phases))[""]


def test_a_value_is_the_mean_over_the_parts_that_have_one(views):
    SEEN.clear()
    values, reasons = a_set(size, half_silent, never).compute(views)
    assert SEEN == [250] * 4
    assert (values[:2].tolist(), reasons) == ([250.0, 2.0], (("never", "never"),))
    assert np.isnan(values[2])


def test_taps_and_what_depends_on_the_length_are_computed_as_a_whole(views):
    assert a_set(n_taps, phase="tap").compute(views)[0].tolist() == [1.0]
    assert a_set(size, depends_on=("length",)).compute(views)[0].tolist() == [1000.0]


def test_a_steady_movement_gives_in_parts_what_it_gives_as_a_whole(monkeypatch):
    signal = np.random.default_rng(1).normal(size=30_000)
    recording = Recording(signal, 2000.0, "V", "r", phases=Phases(movement=(0, signal.size)))
    features = load_feature_set("texclass").reading("movement")
    whole, _ = features.compute(views_of(recording)[""])
    monkeypatch.setattr(sets, "LONGEST", 10_000)
    divided, _ = features.compute(views_of(recording)[""])
    course = ["band_course", "fine_band_course", "level_persistence"]  # of noise, which is noise
    noisy = np.isin(features.column_names, features.columns_of(course))
    np.testing.assert_allclose(divided[~noisy], whole[~noisy], rtol=0.05, atol=0.05)
    np.testing.assert_allclose(divided[noisy], whole[noisy], atol=0.15)
