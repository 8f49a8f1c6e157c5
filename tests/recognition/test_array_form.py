"""Array form: predictions without scikit-learn equal those of scikit-learn."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import RandomForestClassifier
from sklearn.feature_selection import SelectKBest
from sklearn.impute import SimpleImputer
from sklearn.linear_model import LogisticRegression, RidgeClassifier
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import MaxAbsScaler, MinMaxScaler, RobustScaler, StandardScaler
from toy_models import fitted, model_of, prepared_by

from texclass.classifiers.kernel_discriminant import KernelDiscriminant
from texclass.classifiers.segment_voting import SegmentVoting
from texclass.recognition import load_model
from texclass.recognition.array_form import apply, apply_all, classifier_of, estimators_in, steps_of
from texclass.recognition.probabilities import class_scores
from texclass.recording import Phases, Recording

RNG = np.random.default_rng(0)
CLASSIFIERS = (
    LinearDiscriminantAnalysis(),
    LogisticRegression(),
    RidgeClassifier(),
    GaussianNB(),
    NearestCentroid(),
    KNeighborsClassifier(1, algorithm="brute"),
    KNeighborsClassifier(4, algorithm="brute"),
    KernelDiscriminant(),
    KernelDiscriminant(shrinkage=1.0),
    KernelDiscriminant(limit=0.8),
    SegmentVoting(n_segments=2),
    SegmentVoting(
        make_pipeline(StandardScaler(), LinearDiscriminantAnalysis()), n_segments=3, whole_weight=0.0
    ),
    SegmentVoting(GaussianNB(), n_segments=2),
    SegmentVoting(n_segments=2, recording_columns=(0, 3)),
    SegmentVoting(n_segments=2, recording_columns=tuple(range(6))),
    make_pipeline(SelectKBest(k=3), GaussianNB()),
)


@pytest.mark.parametrize("n_classes", [2, 3, 5])
@pytest.mark.parametrize("classifier", CLASSIFIERS, ids=lambda c: f"{type(c).__name__}")
def test_decisions_equal_those_of_scikit_learn(classifier, n_classes):
    y = np.arange(80) % n_classes
    X = RNG.normal(size=(80, 6)) + y[:, None] * RNG.normal(size=6)
    trained = clone(classifier).fit(X[:50], y[:50])
    rows = np.concatenate([X, np.tile(X[:3, :2], 3)])  # some have identical segments
    step = classifier_of(trained, (X[:50], y[:50]))
    assert not estimators_in(step)
    np.testing.assert_allclose(apply(step, rows), class_scores(trained, rows), rtol=1e-9, atol=1e-9)


def test_segments_with_recording_columns_give_the_decisions_of_scikit_learn():
    y = np.arange(40) % 3
    X = np.column_stack([np.repeat(RNG.normal(size=(40, 2)), 2, axis=1), RNG.normal(size=40)]) + y[:, None]
    trained = SegmentVoting(n_segments=2, recording_columns=(4,)).fit(X, y)
    rows = np.concatenate([X, RNG.normal(size=(9, 5))])  # the last ones have several segments
    decisions = apply(classifier_of(trained), rows)
    np.testing.assert_allclose(decisions, class_scores(trained, rows), rtol=1e-9, atol=1e-9)


@pytest.mark.filterwarnings("ignore:Skipping features without any observed values")
def test_prepared_rows_equal_those_of_scikit_learn():
    X = RNG.normal(size=(60, 4)) * [1, 10, 100, 1e-3]
    X[::7, 1] = np.nan
    X[:, 2] = np.nan  # one imputer drops a column without values, the other keeps it
    fill, keep = SimpleImputer(strategy="median"), SimpleImputer(keep_empty_features=True)
    for scaler in (
        StandardScaler(), StandardScaler(with_mean=False), StandardScaler(with_std=False), MinMaxScaler(),
        MinMaxScaler(clip=True), RobustScaler(), RobustScaler(with_centering=False), MaxAbsScaler(),
        "passthrough",
    ):  # fmt: skip
        for first in (fill, keep):
            steps = make_pipeline(clone(first), scaler).fit(X[:40])
            rows = apply_all(steps_of(steps), X)
            np.testing.assert_allclose(rows, steps.transform(X), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("n_classes", [2, 4])
@pytest.mark.parametrize(
    "classifier",
    [c for c in CLASSIFIERS if not isinstance(c, SegmentVoting | Pipeline)],
    ids=lambda c: type(c).__name__,
)
def test_a_saved_model_predicts_as_its_estimators_do(classifier, n_classes, tmp_path):
    model, recogniser = fitted([SimpleImputer(), StandardScaler()], clone(classifier), n_classes=n_classes)
    model.save(tmp_path / "m.skops")
    loaded = load_model(tmp_path / "m.skops")
    assert loaded.estimators == ()
    low, high = loaded.ranges.low, loaded.ranges.high
    X = RNG.uniform(2 * low - high, 2 * high - low, size=(200, len(low)))
    X[RNG.random(X.shape) < 0.05] = np.nan
    rows = prepared_by(recogniser, X)
    scores = class_scores(recogniser[-1], rows)
    p, p_known = loaded.classify(X)
    np.testing.assert_allclose(p, loaded.calibration(scores), rtol=0, atol=1e-9)
    distance = loaded.novelty.class_distance
    novelty = -scores.max(axis=1) if distance is None else distance(rows)
    np.testing.assert_array_equal(p_known, loaded.novelty.p_value(novelty))
    assert loaded.surfaces == tuple(recogniser.classes_)
    copy = tmp_path / "copy.skops"
    loaded.save(copy)
    assert copy.read_bytes() == (tmp_path / "m.skops").read_bytes()


def test_an_estimator_without_array_form_is_applied_itself(tmp_path):
    forest = RandomForestClassifier(5, random_state=0)
    model, recogniser = fitted([SimpleImputer(), StandardScaler()], forest)
    assert model.estimators == ("RandomForestClassifier",)
    X = np.tile(model.ranges.median, (3, 1))
    scores = class_scores(recogniser[-1], prepared_by(recogniser, X))
    np.testing.assert_allclose(model.classify(X)[0], model.calibration(scores), atol=1e-12)


def test_a_model_file_contains_only_the_filters_of_its_sampling_rate(tmp_path):
    model_of([SimpleImputer()], LinearDiscriminantAnalysis()).save(tmp_path / "m.skops")
    model = load_model(tmp_path / "m.skops")
    ((rate, *_),) = model.banks
    assert rate == model.manifest.fs
    for fs in (rate, 1.005 * rate):
        x = RNG.standard_normal(4000)
        model.answer(Recording(x, fs, "m/s^2", "r", phases=Phases(movement=(0, len(x)))))
    model.save(tmp_path / "copy.skops")
    assert (tmp_path / "copy.skops").read_bytes() == (tmp_path / "m.skops").read_bytes()
