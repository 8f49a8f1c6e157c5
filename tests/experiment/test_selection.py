"""Forward selection: the columns scikit-learn selects, without its refits."""

import numpy as np
import pytest
from sklearn.covariance import EmpiricalCovariance
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.feature_selection import SequentialFeatureSelector
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid
from sklearn.tree import DecisionTreeClassifier
from sklearn.utils.estimator_checks import parametrize_with_checks

from texclass.experiment.selection import ForwardSelector, closed_form

CLASSIFIERS = [
    GaussianNB(),
    LinearDiscriminantAnalysis(),
    LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.1),
    NearestCentroid(),
    KNeighborsClassifier(1),
]


def classes(seed, n_classes=5, n_each=9, n_columns=9):
    rng = np.random.default_rng(seed)
    y = np.repeat(np.arange(n_classes), n_each)
    return rng.normal(size=(n_classes, n_columns))[y] + rng.normal(size=(len(y), n_columns)) * 1.5, y


def test_closed_form_predicts_what_the_classifier_predicts():
    X, y = classes(0)
    train, test = np.arange(len(y)) % 3 > 0, np.arange(len(y)) % 3 == 0
    columns = [4, 1, 7]
    for classifier in CLASSIFIERS:
        scores, prototypes = closed_form(classifier, X[train], y[train], X[test])
        predicted = prototypes[scores(columns[:2], np.array(columns[2:])).argmax(axis=2)]
        expected = classifier.fit(X[train][:, columns], y[train]).predict(X[test][:, columns])
        np.testing.assert_array_equal(predicted[0], expected)


def test_what_has_no_closed_form_is_fitted_again():
    X, y = classes(0)
    for other in (
        GaussianNB(priors=np.full(5, 0.2)),
        NearestCentroid(metric="manhattan"),
        NearestCentroid(shrink_threshold=0.5),
        NearestCentroid(priors="empirical"),
        KNeighborsClassifier(3),
        KNeighborsClassifier(1, metric="manhattan"),
        LinearDiscriminantAnalysis(priors=np.full(5, 0.2)),
        LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto"),
        LinearDiscriminantAnalysis(solver="lsqr", covariance_estimator=EmpiricalCovariance()),
    ):
        assert closed_form(other, X, y, X) is None, other


def test_selects_the_columns_that_scikit_learn_selects_and_those_that_carry_the_classes():
    (X, y), rng = classes(1), np.random.default_rng(2)
    labels = np.repeat(np.arange(4), 12)
    told = rng.normal(size=(48, 12))
    told[:, 3] += 4 * (labels % 2)
    told[:, 8] += 4 * (labels // 2)
    for classifier in (*CLASSIFIERS, DecisionTreeClassifier(random_state=0)):
        ours = ForwardSelector(classifier, n_features_to_select=2, cv=3).fit(X, y)
        theirs = SequentialFeatureSelector(classifier, n_features_to_select=2, cv=3).fit(X, y)
        np.testing.assert_array_equal(ours.get_support(), theirs.get_support())
        support = ForwardSelector(classifier, n_features_to_select=2).fit(told, labels).get_support()
        assert np.flatnonzero(support).tolist() == [3, 8]


def test_collinear_and_constant_columns_do_no_harm():
    X, y = classes(3)
    X = np.column_stack([X, X[:, 0], np.ones(len(y))])
    for classifier in CLASSIFIERS[:2]:
        support = ForwardSelector(classifier, n_features_to_select=4).fit(X, y).get_support()
        assert support.sum() == 4


def test_a_small_pool_is_kept_and_a_lonely_class_is_refused():
    X, y = classes(4)
    assert ForwardSelector(GaussianNB(), n_features_to_select=20).fit(X, y).get_support().all()
    with pytest.raises(ValueError, match="class 4 has 1 sample to train on"):
        ForwardSelector(GaussianNB(), n_features_to_select=2).fit(X[:37], y[:37])


def test_discriminants_of_one_sample_a_class_choose_by_the_nearest_mean():
    y, misleads, tells = [0, 1, 0, 1], [0.0, 1.0, 1.0, 0.0], [0.0, 1.0, 0.1, 1.1]
    selector = ForwardSelector(LinearDiscriminantAnalysis(), n_features_to_select=1)
    assert selector.fit(np.column_stack([misleads, tells]), y).get_support(indices=True) == [1]


@parametrize_with_checks([ForwardSelector(GaussianNB(), n_features_to_select=1)])
def test_selector_is_a_scikit_learn_transformer(estimator, check):
    check(estimator)
