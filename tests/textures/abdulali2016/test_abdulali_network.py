import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import RBFInterpolator
from scipy.spatial import ConvexHull

from texclass.textures.abdulali2016 import RadialNetwork, fit_exact, fit_sparse
from texclass.textures.abdulali2016.mirroring import is_symmetric, mirrored
from texclass.textures.abdulali2016.network import fit_smooth, predict_left_out
from texclass.textures.abdulali2016.points import (
    ModelPoints,
    Normalisation,
    zero_force_points,
    zero_speed_points,
)
from texclass.textures.abdulali2016.pooling import autocorrelation_of, pool_spectra
from texclass.vibration import line_spectrum
from texclass.vibration.autoregressive import from_autocorrelation


@pytest.fixture
def cloud():
    rng = np.random.default_rng(0)
    return rng.standard_normal((60, 3)), rng.standard_normal((60, 4)), rng.standard_normal((20, 3))


def _points(u, lsf, seconds=0.2):
    n = len(u)
    return ModelPoints(u, lsf, np.ones(n), np.full(n, seconds), np.zeros(n, dtype=np.int64))


@pytest.mark.parametrize("smoothing", [0.0, 0.7])
def test_equation_5_is_scipys_linear_kernel(cloud, smoothing):
    u, f, at = cloud
    theirs = RBFInterpolator(u, f, kernel="linear", degree=1, smoothing=smoothing)
    assert_allclose(fit_exact(u, f, smoothing).at(at), theirs(at), atol=1e-9)


def test_weights_are_orthogonal_to_the_polynomials(cloud):
    u, f, _ = cloud
    for net in (fit_exact(u, f), fit_sparse(u, f)):
        q = net.centres
        assert_allclose(np.column_stack([np.ones(len(q)), q]).T @ net.weights, 0, atol=1e-9)


def test_left_out_prediction_is_that_of_a_network_without_the_point(cloud):
    u, f, _ = cloud
    rest = np.arange(len(u)) != 7
    assert_allclose(predict_left_out(u, f)[7], fit_exact(u[rest], f[rest]).at(u[7:8])[0], atol=1e-9)


def test_a_linear_function_needs_no_centre(cloud):
    u, _, at = cloud
    d = np.array([[1.0, 2.0], [0.5, -1.0], [0.0, 3.0], [1.0, 1.0]])
    f = np.column_stack([np.ones(len(u)), u]) @ d
    for net in (fit_exact(u, f), fit_sparse(u, f)):
        assert_allclose(net.at(at), np.column_stack([np.ones(len(at)), at]) @ d, atol=1e-9)


def test_sparser_is_fewer_centres_and_a_worse_fit(cloud):
    u, _, _ = cloud
    f = np.column_stack([np.abs(u[:, 0]), np.hypot(u[:, 1], u[:, 2])])
    n, misfit = [], []
    for sparsity in (0.03, 0.1, 0.4):
        net = fit_sparse(u, f, sparsity)
        n.append(len(net.centres))
        misfit.append(np.mean((net.at(u) - f) ** 2))
    assert n == sorted(n, reverse=True)
    assert n[-1] < n[0] < len(u)
    assert misfit == sorted(misfit)


def test_smoothing_takes_noise_away_where_there_is_noise():
    rng = np.random.default_rng(2)
    u = rng.uniform(-1, 1, (80, 2))
    truth = np.sin(u[:, :1])
    noisy = truth + 0.2 * rng.standard_normal(truth.shape)
    at = rng.uniform(-0.8, 0.8, (200, 2))
    smooth, exact = (
        net.at(at) - np.sin(at[:, :1]) for net in (fit_smooth(u, noisy, np.ones(80)), fit_exact(u, noisy))
    )
    assert np.mean(smooth**2) < np.mean(exact**2) / 2


def test_points_that_coincide_or_lie_in_a_plane_are_no_obstacle():
    u = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.7, 0]])
    f = np.array([[0.0], [1.0], [3.0], [2.0], [1.5]])
    values = fit_exact(u, f).at(u)
    assert np.isfinite(values).all()
    assert_allclose(values[1], 2.0, atol=0.5)


def test_shapes_of_a_network_are_checked():
    with pytest.raises(ValueError, match="shapes"):
        RadialNetwork(np.zeros((3, 2)), np.zeros((4, 1)), np.zeros((3, 1)))
    with pytest.raises(ValueError, match="finite"):
        RadialNetwork(np.full((3, 2), np.nan), np.zeros((3, 1)), np.zeros((3, 1)))


def test_zero_force_points_are_the_hull_seen_from_below():
    rng = np.random.default_rng(5)
    u = rng.uniform(-1, 1, (40, 3))
    lsf = np.sort(rng.uniform(0.1, 3, (40, 4)), axis=1)
    norm = Normalisation(np.array([0.0, 0.0, 1.0]), np.array([50.0, 50.0, 0.4]))
    found = zero_force_points(_points(u, lsf), norm)
    assert_allclose(found.u[:, 2], -1.0 / 0.4)
    assert np.all(found.loudness == 0)
    # the lowest point is one, the highest none, and together they have the outline of all points
    assert (u[np.argmin(u[:, 2]), :2] == found.u[:, :2]).all(axis=1).any()
    assert not (u[np.argmax(u[:, 2]), :2] == found.u[:, :2]).all(axis=1).any()
    assert_allclose(ConvexHull(found.u[:, :2]).volume, ConvexHull(u[:, :2]).volume)
    original = np.argmin(np.abs(u[:, :2] - found.u[0, :2]).sum(axis=1))
    assert_allclose(found.lsf[0], lsf[original])


def test_zero_speed_points_stand_on_the_force_axis_with_the_nearest_spectrum():
    rng = np.random.default_rng(6)
    u = rng.uniform(-1, 1, (30, 3))
    lsf = np.sort(rng.uniform(0.1, 3, (30, 4)), axis=1)
    norm = Normalisation(np.array([10.0, -5.0, 1.0]), np.array([50.0, 40.0, 0.4]))
    found = zero_speed_points(_points(u, lsf), norm, 8)
    raw = found.u * norm.deviation + norm.mean
    assert_allclose(raw[:, :2], 0, atol=1e-12)
    assert_allclose(raw[:, 2], np.linspace(0, u[:, 2].max() * 0.4 + 1, 8))
    assert_allclose(found.lsf[3], lsf[np.argmin(np.linalg.norm(u - found.u[3], axis=1))])
    assert np.all(found.loudness == 0)


def test_too_few_points_for_a_hull_are_all_projected():
    norm = Normalisation(np.zeros(3), np.ones(3))
    lsf = np.tile([0.5, 1.0], (3, 1))
    assert len(zero_force_points(_points(np.eye(3), lsf), norm)) == 3


def test_autocorrelation_of_models_is_undone_by_levinson():
    k = np.random.default_rng(0).uniform(-0.8, 0.8, (5, 30))
    assert_allclose(from_autocorrelation(autocorrelation_of(k)).reflection, k, atol=1e-9)


def test_spectra_that_do_not_change_are_pooled_and_those_that_do_are_not():
    rng = np.random.default_rng(1)
    u = rng.uniform(-2, 2, (60, 2))
    same = np.sort(np.linspace(0.4, 2.7, 8) + 0.1 * rng.standard_normal((60, 8)), axis=1)
    pooled, reach = pool_spectra(_points(u, line_spectrum.spread(same)))
    assert reach >= 0.8
    assert pooled.lsf.std(axis=0).max() < same.std(axis=0).max() / 2
    moving = np.linspace(0.4, 2.2, 8) * (1 + 0.1 * u[:, :1])
    kept, reach = pool_spectra(_points(u, moving))
    assert reach == 0
    assert_allclose(kept.lsf, moving)


def test_a_grain_is_symmetric_and_hairs_are_not():
    rng = np.random.default_rng(4)
    norm = Normalisation(np.array([5.0, -3.0, 1.0]), np.array([60.0, 50.0, 0.5]))
    velocity, force = rng.uniform(-150, 150, (80, 2)), rng.uniform(0.3, 2, 80)
    u = norm.apply(np.column_stack([velocity, force]))
    angle = np.arctan2(*velocity.T[::-1])
    noise = 0.005 * rng.standard_normal((80, 4))
    for period, expected in ((2, True), (1, False)):
        lsf = np.linspace(0.5, 2.4, 4) * (1 + 0.1 * np.cos(period * angle))[:, np.newaxis] + noise
        points = _points(u, lsf)
        assert is_symmetric(points, norm) == expected
    twice = mirrored(mirrored(points, norm), norm)
    assert_allclose(twice.u, points.u, atol=1e-12)
