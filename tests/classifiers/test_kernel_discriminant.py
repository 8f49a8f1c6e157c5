"""The kernel discriminant: equations that it solves, rules that it keeps, what it makes of known changes."""

import numpy as np
import pytest
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.gaussian_process.kernels import Matern
from sklearn.utils.estimator_checks import check_estimator

from texclass.classifiers.kernel import matern32
from texclass.classifiers.kernel_discriminant import (
    KernelDiscriminant,
    correlation_ratio,
    fit_view,
    stratified_subsample,
)
from texclass.recording import Samples


def drifting(n_each: int, seed: int, n_classes: int = 6, n_columns: int = 30) -> tuple[Samples, Samples]:
    """Classes that differ a little in every column, under a common variation ten times as large."""
    means = np.random.default_rng(0).standard_normal((n_classes, n_columns))
    common = np.random.default_rng(1).standard_normal((3, n_columns))
    rng = np.random.default_rng(seed)
    y = np.repeat(np.arange(n_classes), n_each)
    spread = 10 * rng.standard_normal((y.size, 3)) @ common
    return means[y] + spread + 0.5 * rng.standard_normal((y.size, n_columns)), y


def test_it_keeps_the_rules_of_scikit_learn() -> None:
    check_estimator(KernelDiscriminant(), on_skip=None)


def test_kernel_is_the_matern_of_scikit_learn() -> None:
    a, b = np.random.default_rng(0).standard_normal((2, 20, 4))
    np.testing.assert_allclose(matern32(a, b, 0.7), Matern(0.7, nu=1.5)(a, b), atol=1e-12)


def test_coefficients_solve_kernel_ridge_regression() -> None:
    X, y = drifting(10, 2)
    model = KernelDiscriminant(ridge=0.2).fit(X, y)
    K = sum(Matern(1.6, nu=1.5)(a) for a in model.prototypes_) / 2
    Y = np.eye(6)[y] - 1 / 6
    np.testing.assert_allclose((K + 0.2 * np.eye(60)) @ model.dual_, Y, atol=1e-8)


def test_few_samples_have_the_coefficients_that_serve_all_best() -> None:
    X, y = drifting(40, 2)
    model = KernelDiscriminant(max_kb=12).fit(X, y)
    m = len(model.dual_)
    assert 6 <= m < 120
    assert len(np.unique(model.predict(X))) == 6
    of_kept = sum(matern32(a, a, 1.6) for a in model.prototypes_) / 2
    seen = [view(X) for view in model.views_]
    of_all = sum(matern32(a, b, 1.6) for a, b in zip(seen, model.prototypes_, strict=True)) / 2
    Y = np.eye(6)[y] - 1 / 6
    # Where the derivative of |Y - K_nm alpha|^2 + ridge alpha' K_mm alpha is 0.
    slope = of_all.T @ (of_all @ model.dual_ - Y) + 0.04 * of_kept @ model.dual_
    np.testing.assert_allclose(slope, 0, atol=1e-3)
    drawn_first = KernelDiscriminant(max_samples=m).fit(X, y)
    test = drifting(50, 5)
    assert model.score(*test) > drawn_first.score(*test) + 0.02


def test_numbers_of_few_bits_are_part_of_the_model() -> None:
    X, y = drifting(20, 2)
    model, exact = KernelDiscriminant(max_kb=1000).fit(X, y), KernelDiscriminant().fit(X, y)
    assert len(model.dual_) == len(X)
    first, second = model.views_
    Z = model.prototypes_[0] / first.weights
    short = Z.astype(np.float16).astype(float)
    np.testing.assert_array_equal(model.prototypes_[0], short * first.weights)
    np.testing.assert_array_equal(model.prototypes_[1], short @ second.weights)
    for values, dtype in ((second.weights, np.float16), (model.dual_, np.float32)):
        np.testing.assert_array_equal(values, values.astype(dtype))
    gap = np.abs(model.decision_function(X) - exact.decision_function(X)).max()
    assert 0 < gap < 2e-3


def test_samples_of_equal_features_and_small_classes_are_kept_within_the_limit() -> None:
    X, y = np.zeros((60, 2)), np.repeat([0, 1, 1, 1, 2, 2], 10)
    y[:9] = 1  # one sample is left of the first
    n_kept = []
    for max_kb in (0.3, 0.5, 100, None):
        model = KernelDiscriminant(max_kb=max_kb).fit(X, y)
        assert np.isfinite(model.predict_proba(X)).all()
        n_kept.append(len(model.dual_))
    assert 3 <= n_kept[0] < n_kept[1] < n_kept[2] == n_kept[3] == 60


def test_whitened_view_has_identity_within_classes_when_hardly_shrunk() -> None:
    X, y = drifting(200, 3)
    for apart in (0.0, 1e4):  # also where all variation within classes is small beside their distance
        moved = X + apart * np.random.default_rng(4).standard_normal((6, 30))[y]
        seen = fit_view(moved, y, 1e-6, relevance=0.0)(moved)
        within = sum(np.cov(seen[y == c].T, bias=True) for c in range(6)) / 6
        np.testing.assert_allclose(within / np.trace(within) * 30, np.eye(30), atol=5e-3)


def test_common_variation_costs_little_with_few_recordings() -> None:
    train, test = drifting(4, 4), drifting(50, 5)
    plain = KernelDiscriminant(shrinkage=1.0).fit(*train).score(*test)
    whitened = KernelDiscriminant(shrinkage=0.05).fit(*train).score(*test)
    assert whitened > plain + 0.2


def test_a_boundary_that_no_line_can_draw_is_learnt() -> None:
    rng = np.random.default_rng(6)
    X = rng.standard_normal((400, 2))
    y = np.hypot(*X.T) > 1.2
    assert LinearDiscriminantAnalysis().fit(X, y).score(X, y) < 0.75
    assert KernelDiscriminant().fit(X[:200], y[:200]).score(X[200:], y[200:]) > 0.93


def test_scale_and_offset_of_a_column_do_not_matter_nor_does_a_constant_one() -> None:
    (X, y), (new, _) = drifting(10, 7), drifting(10, 8)
    scale = np.logspace(-6, 6, 30)
    model = KernelDiscriminant().fit(X, y).decision_function(new)
    scaled = KernelDiscriminant().fit(X * scale + 3, y).decision_function(new * scale + 3)
    np.testing.assert_allclose(scaled, model, atol=1e-6)
    constant = KernelDiscriminant(relevance=1.0).fit(np.column_stack([X, np.full(60, 7.0)]), y)
    without = KernelDiscriminant(relevance=1.0).fit(X, y).predict(new)
    assert (constant.predict(np.column_stack([new, np.full(60, 9.0)])) == without).mean() > 0.98


def test_classes_count_alike_however_many_samples_they_have() -> None:
    rng = np.random.default_rng(9)
    X = np.concatenate([rng.standard_normal((500, 3)), rng.standard_normal((25, 3)) + 1.0])
    y = np.repeat([0, 1], [500, 25])
    new = np.concatenate([rng.standard_normal((500, 3)), rng.standard_normal((500, 3)) + 1.0])
    found = KernelDiscriminant(ridge=1.0).fit(X, y).predict(new)
    assert found[500:].mean() > 0.5


def test_correlation_ratio_is_near_zero_for_noise_and_near_one_for_labels() -> None:
    y = np.repeat(np.arange(10), 20)
    noise = np.random.default_rng(10).standard_normal((200, 3))
    ratio = correlation_ratio(np.column_stack([y, noise, np.ones(200)]), y)
    assert ratio[0] == 1
    assert (ratio[1:4] < 0.35).all()
    assert ratio[4] == 0


def test_probabilities_are_those_of_a_known_mixture() -> None:
    rng = np.random.default_rng(11)
    y = rng.integers(0, 2, 1500)
    X = rng.standard_normal((1500, 1)) + 2.0 * y[:, None]
    grid = np.linspace(-1, 3, 9)[:, None]
    p = KernelDiscriminant(ridge=5.0).fit(X, y).predict_proba(grid)
    np.testing.assert_allclose(p.sum(axis=1), 1)
    np.testing.assert_allclose(p[:, 1], 1 / (1 + np.exp(-2 * (grid[:, 0] - 1))), atol=0.08)


def test_a_draw_keeps_every_class_the_order_and_all_windows_of_a_recording_alike() -> None:
    labels = np.repeat([0, 1, 2], [100, 50, 4])
    kept = stratified_subsample(labels, 60, 0)
    assert kept.size == 60
    assert set(labels[kept]) == {0, 1, 2}
    assert (np.diff(kept) > 0).all()
    assert stratified_subsample(labels, 154, 0).size == 154
    of_window = np.bincount(stratified_subsample(np.zeros(4000, dtype=int), 1000, 0) % 4)
    assert (np.abs(of_window - 250) < 60).all()


def test_a_parameter_out_of_range_is_refused_by_name() -> None:
    above_0 = dict.fromkeys(("length", "shrinkage", "limit"), 0.0)
    for name, wrong in (above_0 | {"ridge": -1.0, "relevance": -1.0, "max_samples": 1}).items():
        with pytest.raises(ValueError, match=f"{name} == {wrong}, must be"):
            KernelDiscriminant(**{name: wrong}).fit(*drifting(3, 12))
    with pytest.raises(TypeError, match="ridge must be an instance of"):
        KernelDiscriminant(ridge="much").fit(*drifting(3, 12))
    with pytest.raises(ValueError, match=r"max_kb is 3. Expected at least 3\.\d+, for 30 features"):
        KernelDiscriminant(max_kb=3).fit(*drifting(3, 12))


def test_what_is_beyond_a_limit_counts_as_if_it_were_there() -> None:
    X, y = drifting(20, 2)
    model = KernelDiscriminant(limit=1.5).fit(X, y)
    deviation = (X - X.mean(axis=0)) / X.std(axis=0)
    at = X.mean(axis=0) + np.clip(deviation, -1.5, 1.5) * X.std(axis=0)
    assert (np.abs(deviation) > 1.5).any()
    np.testing.assert_allclose(model.decision_function(X), model.decision_function(at), atol=1e-12)
    of_limited = KernelDiscriminant().fit(at, y).decision_function(at)
    np.testing.assert_allclose(model.decision_function(X), of_limited, atol=1e-10)
    assert not np.allclose(model.decision_function(X), KernelDiscriminant().fit(X, y).decision_function(X))


def test_what_is_known_to_change_misleads_less_and_no_change_known_is_as_none() -> None:
    """Twenty classes, a sample of each: two columns tell them apart, a stroke shifts the first."""
    X, y = np.random.default_rng(3).standard_normal((20, 2)), np.arange(20)
    later = X + np.array([0.6, 0.0])
    for relevance in (0.0, 0.5):  # by whitening alone; by what columns count, too
        plain = KernelDiscriminant(relevance=relevance).fit(X, y)
        knowing_it = KernelDiscriminant(relevance=relevance).fit(X, y, changes=np.array([[1.0, 0.0]]))
        assert knowing_it.score(later, y) > plain.score(later, y)
    nothing = KernelDiscriminant().fit(X, y, changes=np.zeros((3, 2)))
    np.testing.assert_allclose(nothing.decision_function(later), plain.decision_function(later))
    with pytest.raises(ValueError, match="changes must have 2 columns as X, got 3"):
        KernelDiscriminant().fit(X, y, changes=np.zeros((1, 3)))


def test_units_of_columns_do_not_matter() -> None:
    rng = np.random.default_rng(0)
    X, y, C = rng.standard_normal((40, 6)), np.repeat(np.arange(4), 10), rng.standard_normal((3, 6))
    unit = 10.0 ** rng.integers(-3, 4, 6)
    told = [KernelDiscriminant().fit(X * u, y, C * u).decision_function(X * u) for u in (1.0, unit)]
    np.testing.assert_allclose(*told, rtol=1e-6, atol=1e-9)
