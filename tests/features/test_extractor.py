"""Extractor: a scikit-learn transformer of recordings and arrays, with reasons of undefined values."""

import pickle
import re

import numpy as np
import pandas as pd
import pytest
from feature_signals import noise
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.utils.estimator_checks import estimator_checks_generator

from texclass.features.contract import Feature
from texclass.features.extractor import FeatureExtractor
from texclass.features.sets import FeatureSet, Member, load_feature_set
from texclass.recording import Phases, Recording, RecordingError, Tap
from texclass.shipped import names

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
FEW = load_feature_set("texclass").restricted_to(["slope_level", "waviness"])


def exploration(seed=0, **changes):
    """Return a recording with a tap and a movement; the level rises with the seed."""
    axes = (1 + seed) * noise(3000, seed).reshape(1000, 3)
    phases = Phases(taps=(Tap(180, 200, 260),), movement=(400, 1000), onset=400)
    return Recording(axes, FS, "m/s^2", f"r{seed}", phases=phases).with_(**changes)


RECORDINGS = [exploration(seed) for seed in range(6)]


def test_an_array_of_at_least_64_samples_is_one_signal():
    assert FeatureExtractor(FEW, fs=FS, unit="g").fit_transform(noise(64)).shape[0] == 1
    with pytest.raises(ValueError, match="Expected 2D array"):
        FeatureExtractor(FEW, fs=FS, unit="g").fit_transform(noise(63))


# IDs contain the check only: addresses in the representation of the estimator differ between processes.
@pytest.mark.parametrize(
    ("estimator", "check"),
    list(estimator_checks_generator(FeatureExtractor(FEW, fs=FS, unit="g"))),
    ids=lambda x: getattr(x, "func", type(x)).__name__,
)
def test_extractor_is_a_scikit_learn_transformer(estimator, check):
    check(estimator)


def test_undefined_values_are_nan_with_recording_feature_and_reason():
    untapped = exploration(1, phases=Phases(movement=(400, 1000)))
    extractor = FeatureExtractor(TOY).fit([untapped])
    attributes = dict(vars(extractor))
    extraction = extractor.extract([untapped, exploration(2)])
    assert extraction.table.isna().to_numpy().tolist() == [[False, True, True], [False, False, True]]
    assert ("r1", "strongest", "no tap found") in extraction.reasons
    assert ("r2", "voltage", "no friction signal") in extraction.reasons
    assert (extraction.table.index.tolist(), extraction.table.index.name) == (["r1", "r2"], "recording")
    assert (extraction.ms > 0).all()
    assert {name: id(value) for name, value in vars(extractor).items()} == {
        n: id(v) for n, v in attributes.items()
    }


def test_columns_of_each_channel_equal_those_of_the_channel_alone():
    recording = exploration(channels=("a", "b", "c"))
    each = FeatureExtractor(TOY, channels="each").fit([recording])
    expected = [f"{c}/{f}" for c in "abc" for f in ("rms", "strongest")]
    assert each.get_feature_names_out().tolist() == [*expected, "voltage"]
    alone = recording.with_(acceleration=recording.acceleration[:, 1], channels=())
    values = FeatureExtractor(TOY).fit_transform([alone])[0, :2]
    np.testing.assert_allclose(each.transform([recording])[0, 2:4], values)
    with pytest.raises(ValueError, match=r"has the axes a, b, d\. Expected a, b, c"):
        each.transform([recording.with_(channels=("a", "b", "d"))])


def as_recording(x, unit="arbitrary", **facts):
    return Recording(x, FS, unit, phases=Phases(movement=(0, len(x))), **facts)


def test_arrays_have_the_features_of_recordings_with_movement_only():
    rows, axes = noise(800).reshape(2, 400), noise(1200, 1).reshape(400, 3)
    unequal = [noise(300, 2), noise(350, 3), noise(400, 4)]
    panel = noise(2 * 3 * 400, 5).reshape(2, 3, 400)
    for X, movements in (
        (rows, list(rows)),
        (rows.tolist(), list(rows)),
        (list(rows), list(rows)),
        (rows[0], [rows[0]]),
        (rows[0].tolist(), [rows[0]]),
        (axes, [axes]),
        ([axes], [axes]),
        (unequal, unequal),
        (pd.Series(unequal), unequal),
        (panel, [x.T for x in panel]),
        (list(panel.swapaxes(1, 2)), [x.T for x in panel]),
        (list(panel), [x.T for x in panel]),
        ([panel[0], panel[1, :, :70]], [panel[0].T, panel[1, :, :70].T]),
        (
            pd.concat({name: pd.DataFrame(x.T) for name, x in zip("ab", panel, strict=True)}),
            [x.T for x in panel],
        ),
    ):
        expected = FeatureExtractor(TOY).fit_transform([as_recording(x) for x in movements])
        np.testing.assert_array_equal(FeatureExtractor(TOY, fs=FS).fit_transform(X), expected)
    in_g = FeatureExtractor(TOY, fs=FS, unit="g").fit_transform(axes)
    np.testing.assert_array_equal(in_g, FeatureExtractor(TOY).fit_transform([as_recording(axes, "g")]))


def test_invalid_input_and_missing_sampling_rates_are_rejected():
    for X in (noise(1200).reshape(3, 400), [noise(300), noise(400)]):
        with pytest.raises(ValueError, match="fs is required if X contains arrays"):
            FeatureExtractor(TOY).fit(X)
    for nothing in ([], "strese2015", None, noise(20)):
        with pytest.raises(ValueError):  # noqa: PT011  (message of scikit-learn)
            FeatureExtractor(TOY, fs=FS).fit(nothing)
    for wide in ((9, 400), (3, 40)):
        with pytest.raises(
            ValueError, match=re.escape(f"has the ambiguous shape {wide}. Expected (n_samples, n_axes)")
        ):
            FeatureExtractor(TOY, fs=FS).fit([np.zeros(wide)])
    with pytest.raises(RecordingError, match="row 1: acceleration contains 1 NaN or infinite values"):
        FeatureExtractor(TOY, fs=FS).fit([noise(300), np.append(noise(300), np.nan)])


def test_rows_of_a_data_frame_have_recording_names_and_processes_do_not_change_values():
    extractor = FeatureExtractor(FEW).set_output(transform="pandas")
    table = extractor.fit_transform(RECORDINGS)
    assert table.columns.tolist() == list(FEW.column_names)
    assert table.index.tolist() == [f"r{i}" for i in range(6)]
    assert table.equals(clone(extractor).set_params(n_jobs=2).fit_transform(RECORDINGS))
    assert table.equals(extractor.fit_transform(pd.Series(RECORDINGS, index=list("abcdef"))))
    signals = pd.Series([noise(300), noise(400)], index=["x", "y"])
    assert extractor.set_params(fs=FS).fit_transform(signals).index.tolist() == ["x", "y"]


@pytest.mark.parametrize("name", names("feature_defs"))
def test_an_extractor_of_each_shipped_set_can_be_pickled(name):
    fitted = FeatureExtractor(name).fit(RECORDINGS[:1])
    restored = pickle.loads(pickle.dumps(fitted))
    assert restored.feature_set_ == fitted.feature_set_
    np.testing.assert_array_equal(restored.transform(RECORDINGS[:1]), fitted.transform(RECORDINGS[:1]))


def test_extractor_works_in_a_cached_pipeline_and_in_a_grid_search(tmp_path):
    labels = np.array(["soft", "soft", "soft", "loud", "loud", "loud"])
    steps = make_pipeline(FeatureExtractor(TOY), "passthrough", KNeighborsClassifier(1), memory=str(tmp_path))
    steps.set_params(
        featureextractor__features=load_feature_set("texclass").restricted_to(["vibration_level"])
    )
    grid = {"featureextractor__channels": ["combine", "each"]}
    for X in (RECORDINGS, pd.Series(RECORDINGS)):
        search = GridSearchCV(steps, grid, cv=3, error_score="raise").fit(X, labels)
        assert search.predict(RECORDINGS).tolist() == labels.tolist()
    assert any(tmp_path.rglob("output.pkl"))
