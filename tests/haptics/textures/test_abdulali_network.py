import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import RBFInterpolator
from scipy.spatial import ConvexHull

from texclass.haptics.textures.abdulali2016 import fit_exact, fit_sparse
from texclass.haptics.textures.abdulali2016.network_fit import (
    ModelPoints,
    fit_smooth,
    has_symmetric_spectra,
    mirror_points,
    pool_spectra,
    predict_left_out,
    to_autocorrelation,
    zero_force_points,
    zero_speed_points,
)
from texclass.vibration import line_spectrum
from texclass.vibration.autoregressive import from_autocorrelation


@pytest.fixture
def cloud():
    rng = np.random.default_rng(0)
    return rng.standard_normal((60, 3)), rng.standard_normal((60, 4)), rng.standard_normal((20, 3))


def _points(u, lsf):
    n = len(u)
    return ModelPoints(u, lsf, np.ones(n), np.full(n, 0.2))


def test_equation_5_and_leave_one_out_agree_with_the_linear_kernel_of_scipy(cloud):
    u, f, new = cloud
    for smoothing in (0.0, 0.7):
        reference = RBFInterpolator(u, f, kernel="linear", degree=1, smoothing=smoothing)
        assert_allclose(fit_exact(u, f, smoothing).at(new), reference(new), atol=1e-9)
    others = np.arange(len(u)) != 7
    assert_allclose(predict_left_out(u, f)[7], fit_exact(u[others], f[others]).at(u[7:8])[0], atol=1e-9)


def test_weights_are_orthogonal_to_polynomials_and_linear_functions_need_no_centres(cloud):
    u, f, new = cloud
    d = np.array([[1.0, 2.0], [0.5, -1.0], [0.0, 3.0], [1.0, 1.0]])
    for solve in (fit_exact, fit_sparse):
        net = solve(u, f)
        assert_allclose(
            np.column_stack([np.ones(len(net.centres)), net.centres]).T @ net.weights, 0, atol=1e-9
        )
        linear = solve(u, np.column_stack([np.ones(len(u)), u]) @ d)
        assert_allclose(linear.at(new), np.column_stack([np.ones(len(new)), new]) @ d, atol=1e-9)


def test_a_higher_sparsity_gives_fewer_centres_and_a_worse_fit(cloud):
    u, _, _ = cloud
    f = np.column_stack([np.abs(u[:, 0]), np.hypot(u[:, 1], u[:, 2])])
    nets = [fit_sparse(u, f, sparsity) for sparsity in (0.03, 0.1, 0.4)]
    n, misfit = [len(net.centres) for net in nets], [np.mean((net.at(u) - f) ** 2) for net in nets]
    assert n == sorted(n, reverse=True)
    assert n[-1] < n[0] < len(u)
    assert misfit == sorted(misfit)
    for sparsity in (0.0, 1.0):
        with pytest.raises(ValueError, match="sparsity must be"):
            fit_sparse(u, f, sparsity)


def test_smoothing_removes_noise():
    rng = np.random.default_rng(2)
    u = rng.uniform(-1, 1, (80, 2))
    noisy = np.sin(u[:, :1]) + 0.2 * rng.standard_normal((80, 1))
    new = rng.uniform(-0.8, 0.8, (200, 2))
    nets = fit_smooth(u, noisy, np.ones(80)), fit_exact(u, noisy)
    smooth, exact = (np.mean((net.at(new) - np.sin(new[:, :1])) ** 2) for net in nets)
    assert smooth < exact / 2


def test_points_that_coincide_or_lie_in_a_plane_can_be_fitted():
    u = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.7, 0]])
    values = fit_exact(u, np.array([[0.0], [1.0], [3.0], [2.0], [1.5]])).at(u)
    assert np.isfinite(values).all()
    assert_allclose(values[1], 2.0, atol=0.5)


def test_silent_points_are_the_projected_lower_hull_and_the_force_axis():
    rng = np.random.default_rng(5)
    u, lsf = rng.uniform(-1, 1, (40, 3)), np.sort(rng.uniform(0.1, 3, (40, 4)), axis=1)
    scaling = np.array([[10.0, -5.0, 1.0], [50.0, 40.0, 0.4]])
    silent = zero_force_points(_points(u, lsf), scaling)
    assert_allclose(silent.u[:, 2], -1.0 / 0.4)
    assert not silent.loudness.any()
    # the lowest point belongs to them, the highest does not, and their outline is that of all points
    assert (u[np.argmin(u[:, 2]), :2] == silent.u[:, :2]).all(axis=1).any()
    assert not (u[np.argmax(u[:, 2]), :2] == silent.u[:, :2]).all(axis=1).any()
    assert_allclose(ConvexHull(silent.u[:, :2]).volume, ConvexHull(u[:, :2]).volume)
    original = np.argmin(np.abs(u[:, :2] - silent.u[0, :2]).sum(axis=1))
    assert_allclose(silent.lsf[0], lsf[original])
    triangle = _points(np.eye(3), np.tile([0.5, 1.0], (3, 1)))  # too few for a hull: all are projected
    assert len(zero_force_points(triangle, np.array([np.zeros(3), np.ones(3)])).u) == 3
    silent = zero_speed_points(_points(u, lsf), scaling, 8)
    raw = silent.u * scaling[1] + scaling[0]
    assert_allclose(raw[:, :2], 0, atol=1e-12)
    assert_allclose(raw[:, 2], np.linspace(0, u[:, 2].max() * 0.4 + 1, 8))
    assert_allclose(silent.lsf[3], lsf[np.argmin(np.linalg.norm(u - silent.u[3], axis=1))])
    assert not silent.loudness.any()


def test_levinson_recursion_inverts_the_autocorrelation_of_models():
    k = np.random.default_rng(0).uniform(-0.8, 0.8, (5, 30))
    assert_allclose(from_autocorrelation(to_autocorrelation(k)).reflection, k, atol=1e-9)


def test_constant_spectra_are_pooled_and_varying_spectra_are_not():
    rng = np.random.default_rng(1)
    u = rng.uniform(-2, 2, (60, 2))
    same = np.sort(np.linspace(0.4, 2.7, 8) + 0.1 * rng.standard_normal((60, 8)), axis=1)
    pooled, reach = pool_spectra(_points(u, line_spectrum.spread(same)))
    assert reach >= 0.8
    assert pooled.lsf.std(axis=0).max() < same.std(axis=0).max() / 2
    moving = np.linspace(0.4, 2.2, 8) * (1 + 0.1 * u[:, :1])
    unpooled, reach = pool_spectra(_points(u, moving))
    assert reach == 0
    assert_allclose(unpooled.lsf, moving)


def test_a_period_of_pi_over_directions_is_symmetric_and_2_pi_is_not():
    rng = np.random.default_rng(4)
    scaling = np.array([[5.0, -3.0, 1.0], [60.0, 50.0, 0.5]])
    velocity, force = rng.uniform(-150, 150, (80, 2)), rng.uniform(0.3, 2, 80)
    u = (np.column_stack([velocity, force]) - scaling[0]) / scaling[1]
    angle, noise = np.arctan2(*velocity.T[::-1]), 0.005 * rng.standard_normal((80, 4))
    for period, expected in ((2, True), (1, False)):
        lsf = np.linspace(0.5, 2.4, 4) * (1 + 0.1 * np.cos(period * angle))[:, np.newaxis] + noise
        points = _points(u, lsf)
        assert has_symmetric_spectra(points, scaling) == expected
    assert_allclose(mirror_points(mirror_points(points, scaling), scaling).u, points.u, atol=1e-12)
