"""Cross-validation: recovery of known classes, chance level, bias of selection before the folds."""

from typing import ClassVar

import numpy as np
import pytest
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.impute import SimpleImputer
from sklearn.model_selection import StratifiedKFold
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import NearestCentroid
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import MinMaxScaler

from texclass.classifiers.forward_selection import ForwardSelector
from texclass.evaluation.folds import evaluate, evaluate_each

Y = np.repeat(["a", "b", "c", "d"], 15)
SPLITS = tuple(StratifiedKFold(5, shuffle=True, random_state=0).split(Y, Y))
SCALE = make_pipeline(SimpleImputer(strategy="median"), MinMaxScaler())


def selecting(n):
    judge = NearestCentroid()
    return make_pipeline(MinMaxScaler(), ForwardSelector(judge, n_features_to_select=n, cv=3))


def test_a_constant_column_takes_nothing_from_the_others_and_alone_names_the_commonest():
    calls = np.unique(Y, return_inverse=True)[1] * 10.0 + np.random.default_rng(0).normal(size=60)
    other_columns = np.column_stack([calls, np.ones(60)])
    assert evaluate(other_columns, Y, SPLITS, SCALE, GaussianNB()).accuracy.mean == 1.0
    assert evaluate(np.ones((60, 2)), Y, SPLITS, SCALE, GaussianNB()).accuracy.mean == 0.25


def test_overlap_gives_the_accuracy_of_the_best_possible_rule():
    # Two unit normals 2 apart: the best rule is right with probability Phi(1) = 0.841.
    rng = np.random.default_rng(1)
    y = np.repeat(["a", "b"], 1000)
    X = rng.normal(size=(2000, 1)) + 2 * (y == "b")[:, None]
    splits = tuple(StratifiedKFold(5, shuffle=True, random_state=0).split(X, y))
    assert evaluate(X, y, splits, SCALE, GaussianNB()).accuracy.mean == pytest.approx(0.841, abs=0.025)


def test_nested_selection_stays_at_chance_where_selection_before_the_folds_does_not():
    nested, biased = [], []
    for seed in range(4):
        X = np.random.default_rng(seed).normal(size=(60, 200))
        nested.append(evaluate(X, Y, SPLITS, selecting(5), NearestCentroid()).accuracy.mean)
        biased.append(evaluate(X, Y, SPLITS, selecting(5), NearestCentroid(), nested=False).accuracy.mean)
    assert np.mean(nested) == pytest.approx(0.25, abs=0.08)
    assert np.mean(biased) > 0.45


class Spy(TransformerMixin, BaseEstimator):
    """Remembers the rows it was fitted on."""

    fitted: ClassVar[list] = []

    def fit(self, X, y=None):
        Spy.fitted.append(sorted(X[:, 0].tolist()))
        self.fitted_ = True
        return self

    def transform(self, X):
        return X


def test_preparation_sees_training_recordings_only_when_nested():
    X = np.arange(60.0)[:, None]
    parts = [sorted(train.tolist()) for train, _ in SPLITS]
    for nested, expected in ((True, parts), (False, [list(range(60))])):
        Spy.fitted = []
        evaluate(X, Y, SPLITS, make_pipeline(Spy()), GaussianNB(), nested=nested)
        assert Spy.fitted == expected


def test_classifiers_that_share_their_preparation_answer_as_each_alone_and_it_is_fitted_once_a_fold():
    X = np.random.default_rng(0).normal(size=(60, 3)) + np.unique(Y, return_inverse=True)[1][:, None]
    Spy.fitted, judges = [], [GaussianNB(), NearestCentroid()]
    together = evaluate_each(X, Y, SPLITS, make_pipeline(Spy()), judges)
    assert len(Spy.fitted) == len(SPLITS)
    for judge, evaluations in zip(judges, together, strict=True):
        alone = evaluate(X, Y, SPLITS, make_pipeline(Spy()), judge)
        assert [p.tolist() for p in evaluations.y_pred] == [p.tolist() for p in alone.y_pred]
        assert evaluations.accuracy == alone.accuracy
    assert together[0].accuracy != together[1].accuracy


def test_undefined_values_without_an_imputer_are_refused():
    X = np.ones((60, 1))
    X[3] = np.nan
    with pytest.raises(ValueError, match="SimpleImputer"):
        evaluate(X, Y, SPLITS, make_pipeline(MinMaxScaler()), GaussianNB())


def test_support_tells_in_how_many_folds_a_column_was_selected():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(60, 6))
    X[:, 2] += 20 * np.unique(Y, return_inverse=True)[1]
    assert evaluate(X, Y, SPLITS, selecting(1), GaussianNB()).support.tolist() == [0, 0, 1, 0, 0, 0]
