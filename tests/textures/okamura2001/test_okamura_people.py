from itertools import permutations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from texclass.textures.okamura2001.factorial import DESIGN, EFFECTS, FACTORS, runs
from texclass.textures.okamura2001.identification import noise_for
from texclass.textures.okamura2001.simulated import MATERIALS, MOST_SENSITIVE, TABLE_II, simulate_ratings
from texclass.textures.okamura2001.study import fit_real, recover

from texclass.textures.okamura2001 import IdentificationTest, analyse, normalized_ratings, simulate_test
from texclass.vibration import TapModel


def test_the_design_has_each_combination_once_and_balanced():
    assert len(np.unique(DESIGN, axis=0)) == 8
    assert_array_equal(DESIGN.T @ DESIGN, 8 * np.eye(3))
    low, high = TapModel(1.0, 2.0, 3.0), TapModel(4.0, 5.0, 6.0)
    models = runs(low, high)
    assert (models[0], models[7]) == (low, high)
    assert models[1] == TapModel(4.0, 2.0, 3.0)


def test_normalised_ratings_have_mean_0_and_deviation_1_for_each_user():
    r = simulate_ratings("decay", np.random.default_rng(0))
    y = normalized_ratings(r)
    assert_allclose(y.mean(axis=1), 0, atol=1e-12)
    assert_allclose(y.std(axis=1), 1)
    assert_allclose(normalized_ratings(3 * r + 7), y, atol=1e-12)


def test_ratings_that_follow_one_factor_have_only_its_effect():
    result = analyse(np.tile(5 + 3 * DESIGN[:, 1], (4, 1)))
    assert result.most_sensitive == "decay"
    assert_allclose([result.effect[name] for name in EFFECTS], [0, 2, 0, 0, 0, 0, 0], atol=1e-12)


def test_analysis_of_variance_is_that_of_the_linear_model():
    y = normalized_ratings(simulate_ratings("frequency", np.random.default_rng(1), n_users=6))
    result = analyse(y)
    A, B, w = DESIGN.T
    columns = np.stack([np.ones(8), A, B, w, A * B, A * w, B * w, A * B * w], axis=1)
    full = np.tile(columns, (6, 1))
    users = np.kron(np.eye(6), np.ones((8, 1)))[:, 1:]

    def left(x):
        x = np.hstack([x, users])
        return np.sum((y.ravel() - x @ np.linalg.lstsq(x, y.ravel(), rcond=None)[0]) ** 2)

    freedom = 48 - 8 - 5
    for i, name in enumerate(EFFECTS, start=1):
        more = left(np.delete(full, i, axis=1)) - left(full)
        f_value = more / (left(full) / freedom)
        assert_allclose(result.f_value[name], f_value, rtol=1e-8)
        assert_allclose(result.p_value[name], stats.f.sf(f_value, 1, freedom), rtol=1e-6)


@pytest.mark.parametrize("material", MATERIALS)
def test_the_factor_that_raters_are_most_sensitive_to_is_found(material):
    factor = MOST_SENSITIVE[material]
    found = [analyse(simulate_ratings(factor, np.random.default_rng(seed))) for seed in range(20)]
    assert all(r.most_sensitive == factor and r.p_value[factor] < 0.01 for r in found)


def test_ratings_without_preference_reject_as_often_as_the_level_says():
    rng = np.random.default_rng(0)
    p = [analyse(rng.standard_normal((10, 8))).p_value[name] for _ in range(300) for name in FACTORS]
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.08


@pytest.mark.parametrize(
    "ratings", [np.ones((3, 8)), np.zeros((0, 8)), np.arange(8.0), np.arange(8.0)[None], np.eye(7)]
)
def test_ratings_that_say_nothing_are_refused(ratings):
    with pytest.raises(ValueError, match="rule is"):
        analyse(ratings)


def test_users_without_noise_name_everything_right():
    test = simulate_test(TABLE_II, 0.0, np.random.default_rng(0))
    assert_array_equal(test.confusion, 42 * np.eye(3))
    assert test.correct == 1


def test_users_with_much_noise_guess():
    test = simulate_test(TABLE_II, 1e6, np.random.default_rng(0), n_experiments=6000)
    assert_allclose(test.correct, 1 / len(list(permutations(range(3)))), atol=0.02)


def test_confusions_count_every_surface_and_every_name_once_an_experiment():
    test = simulate_test(TABLE_II, 1.0, np.random.default_rng(0), n_experiments=100)
    assert_array_equal(test.confusion.sum(axis=0), [100] * 3)
    assert_array_equal(test.confusion.sum(axis=1), [100] * 3)
    assert test.n_correct <= test.confusion.trace() / 3


def test_swapping_two_names_makes_an_experiment_wrong():
    test = IdentificationTest(MATERIALS, np.array([[0, 1, 2], [1, 0, 2]]))
    assert test.n_correct == 1
    assert_array_equal(test.confusion, [[1, 1, 0], [1, 1, 0], [0, 0, 2]])
    low, high = test.interval
    assert low < 0.5 < high


def test_noise_is_found_for_a_share_of_right_answers():
    noise = noise_for(TABLE_II, 0.8, n_experiments=4000)
    test = simulate_test(TABLE_II, noise, np.random.default_rng(9), n_experiments=4000)
    assert_allclose(test.correct, 0.8, atol=0.03)
    with pytest.raises(ValueError, match="guessing"):
        noise_for(TABLE_II, 0.1)


def test_velocity_errors_only_move_the_slope():
    found = recover(0, n_seeds=1)
    for m in MATERIALS:
        few, many = (found[e].errors[m][0] for e in (0.02, 0.06))
        assert_array_equal(few[1:], many[1:])
        assert few[0] != many[0]


def test_real_taps_are_fitted_in_samples():
    taps = [
        np.concatenate([np.zeros(10), TapModel(a, 0.02, 0.05).synthesize(1.0, 190, 1.0)]) for a in (50, -80)
    ]
    found = fit_real(taps)
    assert_allclose(found.decay, 0.02, rtol=1e-3)
    assert_allclose(found.frequency, 0.05, rtol=1e-3)
    assert_allclose(found.explained, 1, atol=1e-4)
