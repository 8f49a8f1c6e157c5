"""Models of random features with any steps, classifier and number of surfaces, trained in milliseconds."""

import numpy as np

from texclass.features import load_feature_set
from texclass.features.plan import Plan
from texclass.recognition import Calibration, Model, NoveltyDetector
from texclass.recognition.array_form import classifier_of, steps_of
from texclass.recognition.model_files import Manifest
from texclass.recognition.novelty import FeatureRanges, fit_class_distance, novelty_scores, score_kind
from texclass.recognition.probabilities import class_scores
from texclass.tradeoff.recogniser import fit_recogniser, prune

NAMES = ("cork", "felt", "oak", "slate", "tin", "wool")


def rows_of(n_columns, n_classes, n_each=12, *, seed=0, undefined=0.05):
    """Return features (n, n_columns) in very different units, some undefined, and their surfaces."""
    rng = np.random.default_rng(seed)
    units = 10.0 ** np.random.default_rng(1).uniform(-4, 4, n_columns)
    means = np.random.default_rng(2).standard_normal((len(NAMES), n_columns))
    labels = np.repeat(np.arange(n_classes), n_each)
    X = (means[labels] + 0.6 * rng.standard_normal((len(labels), n_columns)) + 3) * units
    X[rng.random(X.shape) < undefined] = np.nan
    return X, np.array(NAMES)[labels]


def plan_of(features=("mfcc",), feature_set="texclass"):
    return Plan.of(load_feature_set(feature_set).restricted_to(list(features)))


def fitted(steps, classifier, *, n_classes=4, plan=None, undefined=0.05, X=None, false_alarms=0.05):
    """Return a model with other held-out recordings, and its pruned scikit-learn recogniser."""
    plan = plan_of() if plan is None else plan
    random_X, y = rows_of(len(plan.columns), n_classes, undefined=undefined)
    X = random_X if X is None else X
    named_steps = [(f"step{i}", step) for i, step in enumerate(steps)]
    recogniser = prune(fit_recogniser(plan, X, y, [*named_steps, ("classifier", classifier)]))
    held_out_X = rows_of(X.shape[1], n_classes, seed=3, undefined=undefined)[0]
    held_out_X = held_out_X[:, [plan.columns.index(c) for c in recogniser[0].plan_.columns]]
    X = X[:, [plan.columns.index(c) for c in recogniser[0].plan_.columns]]
    prepared, held_out = prepared_by(recogniser, X), prepared_by(recogniser, held_out_X)
    kind = score_kind(recogniser[-1])
    labels = np.unique(y, return_inverse=True)[1]
    distance = fit_class_distance(prepared, labels) if kind == "distance" else None
    scores = novelty_scores(kind, class_scores(recogniser[-1], held_out), held_out, distance)
    model = Model(
        recogniser[0].plan_,
        tuple(recogniser.classes_.tolist()),
        [part for _, step in recogniser.steps[1:-1] for part in steps_of(step)],
        classifier_of(recogniser[-1], (prepared, y)),
        Calibration(0.7, 0.02),
        NoveltyDetector(kind, np.sort(scores), false_alarms, distance),
        FeatureRanges.from_features(X),
        manifest_of(y, false_alarms),
    )
    return model, recogniser


def model_of(steps, classifier, **options):
    return fitted(steps, classifier, **options)[0]


def prepared_by(recogniser, X):
    """Return rows of features after the steps between features and classifier."""
    for _, step in recogniser.steps[1:-1]:
        X = step.transform(X)
    return X


def manifest_of(y, false_alarms):
    return Manifest(
        surfaces=tuple(np.unique(y).tolist()),
        pipeline={"name": "toy", "row": "r", "classifier": "c", "hash": ""},
        features=("mfcc",), phases=("movement",), fs=4000.0, unit="m/s^2",
        input={"fs": 4000.0, "unit": "m/s^2"}, trained_on={"name": "toy"},
        accuracy={}, calibration={}, unknown={"false_alarms": false_alarms}, cost={}, window_s=0.5,
        versions={"texclass": "0"}, shortest_s=0.4,
    )  # fmt: skip
