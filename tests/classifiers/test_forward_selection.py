"""Forward selection: the columns that scikit-learn selects, without fitting every candidate."""

import numpy as np
import pytest
from sklearn.covariance import EmpiricalCovariance
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.feature_selection import SequentialFeatureSelector
from sklearn.model_selection import cross_val_score
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid
from sklearn.tree import DecisionTreeClassifier
from sklearn.utils.estimator_checks import parametrize_with_checks

from texclass.classifiers import closed_form_scores
from texclass.classifiers.closed_form_scores import closed_form
from texclass.classifiers.forward_selection import ForwardSelector, SubsetScore, inner_splits

CLASSIFIERS = [
    GaussianNB(),
    GaussianNB(var_smoothing=0.1),
    LinearDiscriminantAnalysis(),
    LinearDiscriminantAnalysis(tol=0.3),
    LinearDiscriminantAnalysis(solver="lsqr"),
    LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.1),
    LinearDiscriminantAnalysis(solver="eigen"),
    LinearDiscriminantAnalysis(solver="eigen", shrinkage=0.5),
    NearestCentroid(),
    KNeighborsClassifier(1),
]


def classes(seed, sizes=(9, 9, 9, 9, 9), n_columns=9):
    """Return normally distributed classes; the divisors n and n - n_classes differ by a fifth."""
    rng = np.random.default_rng(seed)
    y = np.repeat(np.arange(len(sizes)), sizes)
    X = rng.normal(size=(len(sizes), n_columns))[y] + rng.normal(size=(len(y), n_columns)) * 1.5
    return X, y


def quantised(X):
    return np.round(X)


def with_other_units(X):
    n = X.shape[1]
    return X * 10.0 ** np.linspace(-3, 3, n) + np.linspace(-10, 10, n)


def with_redundant_columns(X):
    X = X.copy()
    X[:, 5], X[:, 7], X[:, 8] = X[:, 0], 2 * X[:, 1] - X[:, 2], 0.1
    return X


def selected_by_scikit_learn(classifier, X, y, **options):
    return SequentialFeatureSelector(classifier, **options).fit(X, y).get_support()


def count_fits(monkeypatch, kind):
    """Return a list that grows by one entry with each fit of a kind of classifier."""
    fits, fit = [], kind.fit
    monkeypatch.setattr(kind, "fit", lambda self, X, y: fits.append(1) or fit(self, X, y))
    return fits


@pytest.mark.parametrize("classifier", CLASSIFIERS, ids=str)
def test_closed_form_predicts_what_the_classifier_predicts(classifier):
    X, y = classes(0, (5, 9, 14, 22, 7))
    train, test = np.arange(len(y)) % 3 > 0, np.arange(len(y)) % 3 == 0
    columns = [4, 1, 7]
    scores, error = closed_form(classifier, X[train], y[train], X[test])(columns[:2], np.array(columns[2:]))
    expected = classifier.fit(X[train][:, columns], y[train]).predict(X[test][:, columns])
    np.testing.assert_array_equal(scores.argmax(axis=2)[0], expected)
    assert (error > 0).all()


@pytest.mark.parametrize("change", [np.copy, quantised, with_other_units])
@pytest.mark.parametrize("classifier", [*CLASSIFIERS, DecisionTreeClassifier(random_state=0)], ids=str)
def test_selects_what_scikit_learn_selects_from_classes_of_unequal_size(classifier, change):
    for seed in range(3):
        X, y = classes(seed, (3, 5, 9, 14, 22))
        X = change(X)
        ours = ForwardSelector(classifier, n_features_to_select=5).fit(X, y).get_support()
        theirs = selected_by_scikit_learn(classifier, X, y, n_features_to_select=5, cv=3)
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    "classifier", [GaussianNB(), LinearDiscriminantAnalysis(), KNeighborsClassifier(1)], ids=str
)
def test_selects_what_scikit_learn_selects_from_redundant_columns_and_with_many_folds(classifier):
    X, y = classes(4, (10, 12, 14, 22))
    X = with_redundant_columns(X)
    ours = ForwardSelector(classifier, n_features_to_select=6, cv=9).fit(X, y).get_support()
    theirs = selected_by_scikit_learn(classifier, X, y, n_features_to_select=6, cv=9)
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("solver", ["svd", "lsqr", "eigen"])
def test_probabilities_of_discriminants_are_those_of_scikit_learn(solver):
    X, y = classes(5, (4, 5, 9, 14))
    splits, classifier = inner_splits(y, None, 4), LinearDiscriminantAnalysis(solver=solver)
    expected = cross_val_score(classifier, X[:, [1, 4, 5]], y, cv=splits, scoring="neg_log_loss").mean()
    assert SubsetScore(classifier, X, y, splits, "log_likelihood").of([1, 4, 5]) == pytest.approx(expected)


# A tolerance of 0.3 drops directions of almost any columns.
@pytest.mark.parametrize("classifier", [c for c in CLASSIFIERS if getattr(c, "tol", 0) != 0.3], ids=str)
def test_a_candidate_is_fitted_only_if_rounding_could_change_a_prediction(classifier, monkeypatch):
    X, y = classes(6, (5, 9, 14, 22))
    closed_form_scores.svd_degrees_of_freedom_per_class()
    fits = count_fits(monkeypatch, type(classifier))
    ForwardSelector(classifier, n_features_to_select=5).fit(X, y)
    assert len(fits) == 0
    ForwardSelector(classifier, n_features_to_select=5).fit(quantised(X), y)
    # Classes tie in quantised columns: one fit per candidate and fold.
    assert len(fits) <= 3 * (9 + 8 + 7 + 6 + 5)


def test_the_divisor_of_the_covariance_is_measured_on_the_installed_scikit_learn(monkeypatch):
    """The closed form agrees with both divisors of released versions, n - n_classes and n."""
    X, y = classes(7, (4, 6, 8))
    for c in (0.0, 1.0):
        monkeypatch.setattr(closed_form_scores, "svd_degrees_of_freedom_per_class", lambda c=c: c)
        score, _ = closed_form(LinearDiscriminantAnalysis(), X, y, X)([0], np.array([1]))
        means = np.array([X[y == k][:, :2].mean(axis=0) for k in range(3)])
        scatter = (X[:, :2] - means[y]).T @ (X[:, :2] - means[y])
        inverse = np.linalg.inv(scatter / (18 - 3 * c))
        expected = X[:, :2] @ inverse @ means.T - 0.5 * np.einsum("kp,pq,kq->k", means, inverse, means)
        expected += np.log([4 / 18, 6 / 18, 8 / 18])
        np.testing.assert_allclose(np.diff(score[0]), np.diff(expected))
    monkeypatch.undo()
    assert closed_form_scores.svd_degrees_of_freedom_per_class() in (0, 1)


def test_a_singular_covariance_and_a_class_outside_the_training_set_score_zero():
    X, y = classes(8)
    X[:, 5], eigen = 0, LinearDiscriminantAnalysis(solver="eigen")
    score = SubsetScore(eigen, X, y, inner_splits(y, None, 3))
    assert score.of([0, 5]) == 0 < score.of([0, 1])
    splits = [(np.flatnonzero(y != 2), np.flatnonzero(y == 2))]
    for classifier in (GaussianNB(), eigen, DecisionTreeClassifier()):
        assert SubsetScore(classifier, X, y, splits).of([0, 1]) == 0
        assert SubsetScore(classifier, X, y, splits, "log_likelihood").of([0, 1]) < -700


def test_other_classifiers_and_parameters_have_no_closed_form():
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
        LinearDiscriminantAnalysis(solver="svd", shrinkage=0.1),
        LinearDiscriminantAnalysis(solver="lsqr", covariance_estimator=EmpiricalCovariance()),
    ):
        assert closed_form(other, X, y, X) is None, other


def test_selects_the_columns_in_which_classes_differ():
    rng, labels = np.random.default_rng(2), np.repeat(np.arange(4), 12)
    X = rng.normal(size=(48, 12))
    X[:, 3] += 4 * (labels % 2)
    X[:, 8] += 4 * (labels // 2)
    for classifier in (*CLASSIFIERS, DecisionTreeClassifier(random_state=0)):
        support = ForwardSelector(classifier, n_features_to_select=2).fit(X, labels).get_support()
        assert np.flatnonzero(support).tolist() == [3, 8]


def test_collinear_and_constant_columns_are_accepted():
    X, y = classes(3)
    X = np.column_stack([X, X[:, 0], np.ones(len(y))])
    for classifier in CLASSIFIERS[:3]:
        support = ForwardSelector(classifier, n_features_to_select=4).fit(X, y).get_support()
        assert support.sum() == 4


def test_few_columns_are_all_selected_and_a_class_of_one_sample_is_refused():
    X, y = classes(4)
    assert ForwardSelector(GaussianNB(), n_features_to_select=20).fit(X, y).get_support().all()
    with pytest.raises(ValueError, match="at least 2 samples of each class, got 1 sample of class 4"):
        ForwardSelector(GaussianNB(), n_features_to_select=2).fit(X[:37], y[:37])


def test_discriminants_with_one_sample_per_class_use_the_nearest_mean():
    y, misleading, informative = [0, 1, 0, 1], [0.0, 1.0, 1.0, 0.0], [0.0, 1.0, 0.1, 1.1]
    selector = ForwardSelector(LinearDiscriminantAnalysis(), n_features_to_select=1)
    assert selector.fit(np.column_stack([misleading, informative]), y).get_support(indices=True) == [1]


@parametrize_with_checks([ForwardSelector(GaussianNB(), n_features_to_select=1)])
def test_selector_is_a_scikit_learn_transformer(estimator, check):
    check(estimator)
