"""Tests of cost-aware feature selection."""

from itertools import product

import numpy as np
import pytest
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.model_selection import cross_val_score
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier
from sklearn.tree import DecisionTreeClassifier
from sklearn.utils.estimator_checks import parametrize_with_checks

from texclass.classifiers.forward_selection import SubsetScore, inner_splits
from texclass.evaluation.cost import CostModel
from texclass.tradeoff.cost_selection import CostAwareSelector


def columns_of_classes(rng=None):
    """Column 0 separates four classes, 1 and 2 together do so, 3 repeats 0 with noise, others are noise."""
    rng = rng or np.random.default_rng(0)
    y = np.repeat(np.arange(4), 20)
    noise = rng.normal(size=(80, 6))
    signal = np.column_stack([3 * y, 4 * (y % 2), 4 * (y // 2), 3 * y])
    return np.column_stack([signal + 0.5 * noise[:, :4], noise[:, 4:]]), y


def test_a_cheap_pair_is_preferred_to_an_expensive_column():
    X, y = columns_of_classes()
    costs = [50.0, 1.0, 1.0, 60.0, 1.0, 1.0]
    assert CostAwareSelector(costs=costs).fit(X, y).get_support(indices=True).tolist() == [1, 2]
    plain = CostAwareSelector(costs=costs, cost_exponent=0.0, floating=False, direction="forward").fit(X, y)
    assert plain.get_support()[[0, 3]].any()


def test_budget_and_number_of_columns_are_respected():
    X, y = columns_of_classes()
    selector = CostAwareSelector(costs=[3.0, 2.0, 2.0, 9.0, 1.0, 1.0], max_cost=2.5).fit(X, y)
    assert selector.cost_ <= 2.5
    assert all(subset.cost <= 2.5 for subset in selector.path_)
    assert CostAwareSelector(max_features=1).fit(X, y).get_support().sum() == 1
    with pytest.raises(ValueError, match=r"max_cost must be at least 1"):
        CostAwareSelector(costs=[3.0, 2.0, 2.0, 9.0, 1.0, 1.0], max_cost=0.5).fit(X, y)


def test_further_columns_of_a_selected_feature_are_free():
    X, y = columns_of_classes()
    needs = np.array([[1, 0], [0, 1], [0, 1], [1, 0], [1, 0], [1, 0]], dtype=bool)
    model = CostModel(tuple("abcdef"), tuple("pqqppp"), ("p", "q"), np.array([9.0, 2.0]), needs)
    selector = CostAwareSelector(costs=model, unit="column").fit(X, y)
    assert selector.get_support(indices=True).tolist() == [1, 2]
    assert selector.cost_ == 2


def test_floating_removes_a_column_that_a_later_one_makes_redundant():
    X, y = columns_of_classes()
    # Column 1 is cheap and selected first; column 0 separates all classes and makes column 1 redundant.
    X[:, 0] = 9 * y + 0.01 * X[:, 4]
    X = X[:, [0, 1, 4]]
    selector = CostAwareSelector(costs=[3.0, 1.0, 1.0], cost_exponent=3.0, direction="forward").fit(X, y)
    assert selector.path_[0].columns == (1,) or selector.get_support(indices=True).tolist() == [0]
    assert selector.get_support(indices=True).tolist() == [0]


def test_backward_search_selects_columns_that_are_informative_only_together():
    rng = np.random.default_rng(4)
    bits = rng.integers(0, 2, (120, 3))
    X = np.column_stack([bits + 0.1 * rng.normal(size=(120, 3)), 0.3 * rng.normal(size=(120, 2))])
    classifier, parity = KNeighborsClassifier(1), bits.sum(axis=1) % 2
    forward = CostAwareSelector(classifier, direction="forward").fit(X, parity)
    assert forward.score_ < 0.7
    assert CostAwareSelector(classifier).fit(X, parity).get_support(indices=True).tolist() == [0, 1, 2]


def test_best_within_returns_the_best_subset_for_a_smaller_budget():
    X, y = columns_of_classes()
    selector = CostAwareSelector(costs=[5.0, 1.0, 1.0, 9.0, 1.0, 1.0]).fit(X, y)
    assert selector.best_within(1.0).cost == 1.0
    assert selector.best_within(0.5) is None
    assert selector.best_within(np.inf).columns == tuple(selector.get_support(indices=True))


def test_the_score_of_a_subset_equals_that_of_cross_val_score():
    X, y = columns_of_classes()
    splits, columns = inner_splits(y, None, 4), [1, 4, 5]
    closed = (GaussianNB(), LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.1))
    tree = DecisionTreeClassifier(random_state=0)
    scorers = (("accuracy", "accuracy"), ("log_likelihood", "neg_log_loss"))
    for classifier, (scoring, scorer) in (*product(closed, scorers), (tree, scorers[0])):
        expected = cross_val_score(classifier, X[:, columns], y, cv=splits, scoring=scorer).mean()
        assert SubsetScore(classifier, X, y, splits, scoring).of(columns) == pytest.approx(expected, rel=1e-6)
    selector = CostAwareSelector(tree, costs=[50, 1, 1, 60, 1, 1]).fit(
        X, y
    )  # any classifier can be the estimator
    assert selector.get_support()[[1, 2]].all()


def test_inner_folds_never_separate_groups():
    X, y = columns_of_classes()
    groups = np.arange(80) // 5
    for train, test in inner_splits(y, groups, 4):
        assert not set(groups[train]) & set(groups[test])
    # Column 4 identifies the group: it helps only if samples of a group are separated.
    X[:, 4] = np.random.default_rng(1).permutation(16)[groups]
    X = X[:, [1, 4]]
    classifier = DecisionTreeClassifier(random_state=0)
    assert CostAwareSelector(classifier).fit(X, y).get_support()[1]
    assert not CostAwareSelector(classifier).fit(X, y, groups).get_support()[1]


def test_a_class_with_one_sample_or_group_and_costs_that_do_not_match_raise():
    X, y = columns_of_classes()
    with pytest.raises(ValueError, match="at least 2 samples of each class, got 1 sample of class 3"):
        CostAwareSelector().fit(X[:61], y[:61])
    with pytest.raises(ValueError, match="at least 2 groups of each class, got 1 group of class 0"):
        CostAwareSelector().fit(X, y, y)
    for costs in ([1.0], [1.0, 1, 1, 1, 1, -1]):
        with pytest.raises(ValueError, match="non-negative number for each"):
            CostAwareSelector(costs=costs).fit(X, y)


@parametrize_with_checks([CostAwareSelector(GaussianNB(), max_features=2, cv=2)])
def test_selector_is_a_scikit_learn_transformer(estimator, check):
    check(estimator)


def test_unit_feature_selects_whole_features_and_unit_column_single_columns():
    X, y = columns_of_classes()
    # p: columns 0 and 4; q: 1 and 2; r: 3; s: 5
    needs = np.eye(4, dtype=bool)[[0, 1, 1, 2, 0, 3]]
    model = CostModel(tuple("abcdef"), tuple("pqqrps"), tuple("pqrs"), np.array([1.0, 9.0, 9.0, 9.0]), needs)
    options = {"costs": model, "direction": "forward", "floating": False}
    columns_of_feature = {0: {0, 4}, 4: {0, 4}, 1: {1, 2}, 2: {1, 2}, 3: {3}, 5: {5}}
    whole = CostAwareSelector(unit="feature", **options).fit(X, y)
    for subset in whole.path_:
        assert all(columns_of_feature[column] <= set(subset.columns) for column in subset.columns)
    single = CostAwareSelector(unit="column", **options).fit(X, y)
    assert single.path_[0].columns == (0,)
