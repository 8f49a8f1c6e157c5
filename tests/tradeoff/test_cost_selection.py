"""Cost-aware selection: accuracy per millisecond, within a budget, groups never divided."""

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
    """Column 0 tells all four classes, 1 and 2 together do, 3 repeats 0 noisily, the others are noise."""
    rng = rng or np.random.default_rng(0)
    y = np.repeat(np.arange(4), 20)
    noise = rng.normal(size=(80, 6))
    signal = np.column_stack([3 * y, 4 * (y % 2), 4 * (y // 2), 3 * y])
    return np.column_stack([signal + 0.5 * noise[:, :4], noise[:, 4:]]), y


def test_buys_the_cheap_pair_instead_of_the_dear_column():
    X, y = columns_of_classes()
    costs = [50.0, 1.0, 1.0, 60.0, 1.0, 1.0]
    assert CostAwareSelector(costs=costs).fit(X, y).get_support(indices=True).tolist() == [1, 2]
    blind = CostAwareSelector(costs=costs, thrift=0.0, floating=False, direction="forward").fit(X, y)
    assert blind.get_support()[[0, 3]].any()


def test_keeps_to_budget_and_number_of_columns():
    X, y = columns_of_classes()
    selector = CostAwareSelector(costs=[3.0, 2.0, 2.0, 9.0, 1.0, 1.0], max_cost=2.5).fit(X, y)
    assert selector.cost_ <= 2.5
    assert all(choice.cost <= 2.5 for choice in selector.path_)
    assert CostAwareSelector(max_features=1).fit(X, y).get_support().sum() == 1
    with pytest.raises(ValueError, match=r"max_cost is 0\.5. Expected at least 1"):
        CostAwareSelector(costs=[3.0, 2.0, 2.0, 9.0, 1.0, 1.0], max_cost=0.5).fit(X, y)


def test_columns_of_a_bought_feature_are_free():
    X, y = columns_of_classes()
    needs = np.array([[1, 0], [0, 1], [0, 1], [1, 0], [1, 0], [1, 0]], dtype=bool)
    model = CostModel(tuple("abcdef"), tuple("pqqppp"), ("p", "q"), np.array([9.0, 2.0]), needs)
    selector = CostAwareSelector(costs=model, unit="column").fit(X, y)
    assert selector.get_support(indices=True).tolist() == [1, 2]
    assert selector.cost_ == 2


def test_floating_drops_what_a_better_purchase_made_idle():
    X, y = columns_of_classes()
    # 1 is bought first, being cheap; then 0 tells everything, and 1 no longer earns its cost.
    X[:, 0] = 9 * y + 0.01 * X[:, 4]
    X = X[:, [0, 1, 4]]
    selector = CostAwareSelector(costs=[3.0, 1.0, 1.0], thrift=3.0, direction="forward").fit(X, y)
    assert selector.path_[0].columns == (1,) or selector.get_support(indices=True).tolist() == [0]
    assert selector.get_support(indices=True).tolist() == [0]


def test_columns_that_tell_only_together_are_found_from_the_full_set():
    rng = np.random.default_rng(4)
    bits = rng.integers(0, 2, (120, 3))
    X = np.column_stack([bits + 0.1 * rng.normal(size=(120, 3)), 0.3 * rng.normal(size=(120, 2))])
    judge, parity = KNeighborsClassifier(1), bits.sum(axis=1) % 2
    onward = CostAwareSelector(judge, direction="forward").fit(X, parity)
    assert onward.score_ < 0.7
    assert CostAwareSelector(judge).fit(X, parity).get_support(indices=True).tolist() == [0, 1, 2]


def test_a_smaller_budget_gets_the_best_choice_on_the_way():
    X, y = columns_of_classes()
    selector = CostAwareSelector(costs=[5.0, 1.0, 1.0, 9.0, 1.0, 1.0]).fit(X, y)
    assert selector.within(1.0).cost == 1.0
    assert selector.within(0.5) is None
    assert selector.within(np.inf).columns == tuple(selector.get_support(indices=True))


def test_the_score_of_a_subset_is_scikit_learns_cross_validated_one():
    X, y = columns_of_classes()
    splits, columns = inner_splits(y, None, 4), [1, 4, 5]
    closed = (GaussianNB(), LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.1))
    tree = DecisionTreeClassifier(random_state=0)
    scorers = (("accuracy", "accuracy"), ("log_likelihood", "neg_log_loss"))
    for judge, (scoring, scorer) in (*product(closed, scorers), (tree, scorers[0])):
        expected = cross_val_score(judge, X[:, columns], y, cv=splits, scoring=scorer).mean()
        assert SubsetScore(judge, X, y, splits, scoring).of(columns) == pytest.approx(expected, rel=1e-6)
    selector = CostAwareSelector(tree, costs=[50, 1, 1, 60, 1, 1]).fit(X, y)  # anything can be the judge
    assert selector.get_support()[[1, 2]].all()


def test_groups_are_never_divided():
    X, y = columns_of_classes()
    groups = np.arange(80) // 5
    for train, test in inner_splits(y, groups, 4):
        assert not set(groups[train]) & set(groups[test])
    # Column 4 names the group: worth everything if samples of a group were divided, nothing otherwise.
    X[:, 4] = np.random.default_rng(1).permutation(16)[groups]
    X = X[:, [1, 4]]
    judge = DecisionTreeClassifier(random_state=0)
    assert CostAwareSelector(judge).fit(X, y).get_support()[1]
    assert not CostAwareSelector(judge).fit(X, y, groups).get_support()[1]


def test_a_lonely_class_or_group_is_refused_and_costs_that_do_not_fit_the_columns_too():
    X, y = columns_of_classes()
    with pytest.raises(ValueError, match="at least 2 samples of each class, got 1 sample of class 3"):
        CostAwareSelector().fit(X[:61], y[:61])
    with pytest.raises(ValueError, match="at least 2 groups of each class, got 1 group of class 0"):
        CostAwareSelector().fit(X, y, y)
    for costs in ([1.0], [1.0, 1, 1, 1, 1, -1]):
        with pytest.raises(ValueError, match="Expected a finite cost of at least 0 for each"):
            CostAwareSelector(costs=costs).fit(X, y)


@parametrize_with_checks([CostAwareSelector(GaussianNB(), max_features=2, cv=2)])
def test_selector_is_a_scikit_learn_transformer(estimator, check):
    check(estimator)


def test_features_are_bought_whole_and_columns_one_by_one():
    X, y = columns_of_classes()
    # p: columns 0 and 4; q: 1 and 2; r: 3; s: 5
    needs = np.eye(4, dtype=bool)[[0, 1, 1, 2, 0, 3]]
    model = CostModel(tuple("abcdef"), tuple("pqqrps"), tuple("pqrs"), np.array([1.0, 9.0, 9.0, 9.0]), needs)
    asked = {"costs": model, "direction": "forward", "floating": False}
    of_feature = {0: {0, 4}, 4: {0, 4}, 1: {1, 2}, 2: {1, 2}, 3: {3}, 5: {5}}
    whole = CostAwareSelector(unit="feature", **asked).fit(X, y)
    for choice in whole.path_:
        assert all(of_feature[column] <= set(choice.columns) for column in choice.columns)
    single = CostAwareSelector(unit="column", **asked).fit(X, y)
    assert single.path_[0].columns == (0,)
