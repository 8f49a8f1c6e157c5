"""Kernel discriminant: equations, invariances, size limits and known variations."""

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
    """Return classes that differ slightly in every column, with a common variation ten times as large."""
    means = np.random.default_rng(0).standard_normal((n_classes, n_columns))
    common = np.random.default_rng(1).standard_normal((3, n_columns))
    rng = np.random.default_rng(seed)
    y = np.repeat(np.arange(n_classes), n_each)
    spread = 10 * rng.standard_normal((y.size, 3)) @ common
    return means[y] + spread + 0.5 * rng.standard_normal((y.size, n_columns)), y


def test_it_passes_the_estimator_checks_of_scikit_learn() -> None:
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


def test_few_prototypes_have_the_best_coefficients_for_all_samples() -> None:
    X, y = drifting(40, 2)
    model = KernelDiscriminant(max_kb=12).fit(X, y)
    m = len(model.dual_)
    assert 6 <= m < 120
    assert len(np.unique(model.predict(X))) == 6
    K_mm = sum(matern32(a, a, 1.6) for a in model.prototypes_) / 2
    projections = [view(X) for view in model.views_]
    K_nm = sum(matern32(a, b, 1.6) for a, b in zip(projections, model.prototypes_, strict=True)) / 2
    Y = np.eye(6)[y] - 1 / 6
    # The derivative of |Y - K_nm alpha|^2 + ridge alpha' K_mm alpha is 0.
    slope = K_nm.T @ (K_nm @ model.dual_ - Y) + 0.04 * K_mm @ model.dual_
    np.testing.assert_allclose(slope, 0, atol=1e-3)
    subsampled = KernelDiscriminant(max_samples=m).fit(X, y)
    test = drifting(50, 5)
    assert model.score(*test) > subsampled.score(*test) + 0.02


def test_rounding_to_few_bits_is_part_of_the_model() -> None:
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


def test_equal_samples_and_small_classes_are_kept_within_the_size_limit() -> None:
    X, y = np.zeros((60, 2)), np.repeat([0, 1, 1, 1, 2, 2], 10)
    y[:9] = 1  # the first class has one sample
    n_prototypes = []
    for max_kb in (0.3, 0.5, 100, None):
        model = KernelDiscriminant(max_kb=max_kb).fit(X, y)
        assert np.isfinite(model.predict_proba(X)).all()
        n_prototypes.append(len(model.dual_))
    assert 3 <= n_prototypes[0] < n_prototypes[1] < n_prototypes[2] == n_prototypes[3] == 60


def test_the_whitened_view_has_identity_covariance_within_classes() -> None:
    X, y = drifting(200, 3)
    for distance in (0.0, 1e4):  # also if the classes are far apart
        separated = X + distance * np.random.default_rng(4).standard_normal((6, 30))[y]
        projected = fit_view(separated, y, 1e-6, relevance=0.0)(separated)
        covariance = sum(np.cov(projected[y == c].T, bias=True) for c in range(6)) / 6
        np.testing.assert_allclose(covariance / np.trace(covariance) * 30, np.eye(30), atol=5e-3)


def test_whitening_removes_common_variation_with_few_recordings() -> None:
    train, test = drifting(4, 4), drifting(50, 5)
    plain = KernelDiscriminant(shrinkage=1.0).fit(*train).score(*test)
    whitened = KernelDiscriminant(shrinkage=0.05).fit(*train).score(*test)
    assert whitened > plain + 0.2


def test_a_nonlinear_boundary_is_learnt() -> None:
    rng = np.random.default_rng(6)
    X = rng.standard_normal((400, 2))
    y = np.hypot(*X.T) > 1.2
    assert LinearDiscriminantAnalysis().fit(X, y).score(X, y) < 0.75
    assert KernelDiscriminant().fit(X[:200], y[:200]).score(X[200:], y[200:]) > 0.93


def test_scale_and_offset_of_a_column_and_constant_columns_have_no_effect() -> None:
    (X, y), (new, _) = drifting(10, 7), drifting(10, 8)
    scale = np.logspace(-6, 6, 30)
    model = KernelDiscriminant().fit(X, y).decision_function(new)
    scaled = KernelDiscriminant().fit(X * scale + 3, y).decision_function(new * scale + 3)
    np.testing.assert_allclose(scaled, model, atol=1e-6)
    constant = KernelDiscriminant(relevance=1.0).fit(np.column_stack([X, np.full(60, 7.0)]), y)
    without_constant = KernelDiscriminant(relevance=1.0).fit(X, y).predict(new)
    assert (constant.predict(np.column_stack([new, np.full(60, 9.0)])) == without_constant).mean() > 0.98


def test_classes_of_different_size_count_equally() -> None:
    rng = np.random.default_rng(9)
    X = np.concatenate([rng.standard_normal((500, 3)), rng.standard_normal((25, 3)) + 1.0])
    y = np.repeat([0, 1], [500, 25])
    new = np.concatenate([rng.standard_normal((500, 3)), rng.standard_normal((500, 3)) + 1.0])
    predicted = KernelDiscriminant(ridge=1.0).fit(X, y).predict(new)
    assert predicted[500:].mean() > 0.5


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


def test_a_subsample_has_every_class_the_order_and_all_windows_equally() -> None:
    labels = np.repeat([0, 1, 2], [100, 50, 4])
    subsample = stratified_subsample(labels, 60, 0)
    assert subsample.size == 60
    assert set(labels[subsample]) == {0, 1, 2}
    assert (np.diff(subsample) > 0).all()
    assert stratified_subsample(labels, 154, 0).size == 154
    counts = np.bincount(stratified_subsample(np.zeros(4000, dtype=int), 1000, 0) % 4)
    assert (np.abs(counts - 250) < 60).all()


def test_a_parameter_out_of_range_is_refused_by_name() -> None:
    zeros = dict.fromkeys(("length", "shrinkage", "limit"), 0.0)
    for name, value in (zeros | {"ridge": -1.0, "relevance": -1.0, "max_samples": 1}).items():
        with pytest.raises(ValueError, match=f"{name} == {value}, must be"):
            KernelDiscriminant(**{name: value}).fit(*drifting(3, 12))
    with pytest.raises(TypeError, match="ridge must be an instance of"):
        KernelDiscriminant(ridge="much").fit(*drifting(3, 12))
    with pytest.raises(ValueError, match=r"max_kb must be at least 3\.\d+ kB for 30 features and 6 classes"):
        KernelDiscriminant(max_kb=3).fit(*drifting(3, 12))


def test_values_beyond_the_limit_are_clipped() -> None:
    X, y = drifting(20, 2)
    model = KernelDiscriminant(limit=1.5).fit(X, y)
    deviation = (X - X.mean(axis=0)) / X.std(axis=0)
    clipped = X.mean(axis=0) + np.clip(deviation, -1.5, 1.5) * X.std(axis=0)
    assert (np.abs(deviation) > 1.5).any()
    np.testing.assert_allclose(model.decision_function(X), model.decision_function(clipped), atol=1e-12)
    expected = KernelDiscriminant().fit(clipped, y).decision_function(clipped)
    np.testing.assert_allclose(model.decision_function(X), expected, atol=1e-10)
    assert not np.allclose(model.decision_function(X), KernelDiscriminant().fit(X, y).decision_function(X))


def test_known_variations_improve_the_accuracy_and_zero_variations_have_no_effect() -> None:
    """Twenty classes with one sample each differ in two columns; strokes vary in the first."""
    X, y = np.random.default_rng(3).standard_normal((20, 2)), np.arange(20)
    later = X + np.array([0.6, 0.0])
    for relevance in (0.0, 0.5):  # by whitening alone, and by the weights of columns
        plain = KernelDiscriminant(relevance=relevance).fit(X, y)
        informed = KernelDiscriminant(relevance=relevance).fit(X, y, variations=np.array([[1.0, 0.0]]))
        assert informed.score(later, y) > plain.score(later, y)
    uninformed = KernelDiscriminant().fit(X, y, variations=np.zeros((3, 2)))
    np.testing.assert_allclose(uninformed.decision_function(later), plain.decision_function(later))
    with pytest.raises(ValueError, match="variations must have 2 columns like X, got 3"):
        KernelDiscriminant().fit(X, y, variations=np.zeros((1, 3)))


def test_units_of_columns_have_no_effect() -> None:
    rng = np.random.default_rng(0)
    X, y, C = rng.standard_normal((40, 6)), np.repeat(np.arange(4), 10), rng.standard_normal((3, 6))
    unit = 10.0 ** rng.integers(-3, 4, 6)
    decisions = [KernelDiscriminant().fit(X * u, y, C * u).decision_function(X * u) for u in (1.0, unit)]
    np.testing.assert_allclose(*decisions, rtol=1e-6, atol=1e-9)
