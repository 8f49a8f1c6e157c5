from itertools import product

import numpy as np
import pytest
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.utils.estimator_checks import check_estimator

from texclass.experiment.kernel_discriminant import KernelDiscriminant
from texclass.experiment.vote_of_pieces import VoteOfPieces, divided
from texclass.recording import Samples


def recordings(n_each: int, seed: int, noise: float = 1.0, n_classes: int = 4) -> tuple[Samples, Samples]:
    """Five features of four pieces that scatter about the mean of the class, shape (n, 20)."""
    means = np.random.default_rng(0).standard_normal((n_classes, 5))
    y = np.repeat(np.arange(n_classes), n_each)
    scatter = noise * np.random.default_rng(seed).standard_normal((y.size, 5, 4))
    return (means[y][:, :, None] + scatter).reshape(y.size, -1), y


def test_it_keeps_the_rules_of_scikit_learn() -> None:
    check_estimator(VoteOfPieces(), on_skip=None)


def test_one_piece_is_the_classifier_itself() -> None:
    X, y = recordings(10, 1)
    alone = KernelDiscriminant().fit(X, y)
    np.testing.assert_allclose(VoteOfPieces().fit(X, y).decision_function(X), alone.decision_function(X))


def test_decision_is_the_mean_of_those_of_the_pieces_and_of_the_whole() -> None:
    X, y = recordings(10, 2)
    model = VoteOfPieces(n_pieces=4, whole_weight=0).fit(X, y)
    mean = np.mean([model.estimator_.decision_function(X[:, i::4]) for i in range(4)], axis=0)
    np.testing.assert_allclose(model.decision_function(X), mean, atol=1e-12)
    np.testing.assert_array_equal(model.predict(X), mean.argmax(axis=1))
    whole = KernelDiscriminant().fit(X, y).decision_function(X)
    both = VoteOfPieces(n_pieces=4, whole_weight=0.5).fit(X, y).decision_function(X)
    np.testing.assert_allclose(both, (mean + 0.5 * whole) / 1.5, atol=1e-12)


def test_voting_beats_pieces_side_by_side_with_few_recordings() -> None:
    train, test = recordings(3, 3), recordings(100, 4)
    voted = VoteOfPieces(n_pieces=4).fit(*train).score(*test)
    assert voted > KernelDiscriminant().fit(*train).score(*test) + 0.02


def test_recordings_too_short_to_be_divided_count_once() -> None:
    X, y = recordings(6, 5)
    whole = X[:, ::4]
    same = np.repeat(whole, 4, axis=1)
    rows, owner = divided(np.concatenate([same, X]), 4)
    assert owner.tolist() == [*range(24), *np.repeat(range(24, 48), 4)]
    np.testing.assert_array_equal(rows[:24], whole)
    model, alone = VoteOfPieces(n_pieces=4).fit(same, y), KernelDiscriminant().fit(whole, y)
    assert model.whole_ is None
    np.testing.assert_allclose(model.decision_function(same), alone.decision_function(whole), atol=1e-12)


def test_any_classifier_may_judge_the_pieces() -> None:
    judges = (LinearDiscriminantAnalysis(), ExtraTreesClassifier(50, random_state=0))
    for estimator, n_classes in product(judges, (2, 4)):
        train, test = recordings(20, 6, 0.5, n_classes), recordings(20, 7, 0.5, n_classes)
        model = VoteOfPieces(estimator, n_pieces=4).fit(*train)
        assert model.score(*test) > 0.95
        np.testing.assert_allclose(model.predict_proba(test[0]).sum(axis=1), 1)


def test_columns_that_are_no_multiple_of_the_pieces_are_refused() -> None:
    X, y = recordings(5, 8)
    with pytest.raises(ValueError, match="n_pieces == 0"):
        VoteOfPieces(n_pieces=0).fit(X, y)
    with pytest.raises(TypeError, match="does not seem to be a scikit-learn estimator"):
        VoteOfPieces(3).fit(X, y)
    with pytest.raises(ValueError, match="19 columns; the rule is a multiple of n_pieces = 4"):
        VoteOfPieces(n_pieces=4).fit(X[:, 1:], y)
