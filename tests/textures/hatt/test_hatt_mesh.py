import numpy as np
import pytest
from numpy.testing import assert_allclose

from texclass.textures.hatt import Mesh, triangulate

SQUARE = ([0.0, 100.0, 0.0, 100.0], [0.0, 0.0, 4.0, 4.0], [[0, 1, 2], [1, 3, 2]])


def test_weights_inside_reproduce_every_linear_function():
    rng = np.random.default_rng(0)
    mesh, _ = triangulate(rng.uniform(10, 200, 9), rng.uniform(0.2, 3, 9))
    for speed, force in rng.uniform([0, 0], mesh.largest, (50, 2)):
        nodes, weights = mesh.weights(speed, force)
        assert weights.min() >= 0
        assert_allclose(weights @ np.column_stack([mesh.speed, mesh.force])[nodes], [speed, force], atol=1e-9)
        assert weights.sum() == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize(
    ("outside", "nearest"), [((300, 2), (100, 2)), ((50, 9), (50, 4)), ((300, 9), (100, 4))]
)
def test_outside_the_nearest_point_of_an_edge_holds(outside, nearest):
    mesh = Mesh(*map(np.array, SQUARE))
    nodes, weights = mesh.weights(*outside)
    assert_allclose(weights @ np.column_stack([mesh.speed, mesh.force])[nodes], nearest, atol=1e-12)


def test_triangulation_fills_the_rectangle_and_keeps_the_given_models_first():
    rng = np.random.default_rng(1)
    speed, force = rng.uniform(10, 200, 12), rng.uniform(0.2, 3, 12)
    mesh, source = triangulate(speed, force)
    assert_allclose(mesh.speed[:12], speed)
    assert source[:12].tolist() == list(range(12))
    a, b, c = (mesh.points[mesh.triangles[:, i]] for i in range(3))
    areas = np.abs(np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(c - a, ((0, 0), (0, 1))))[:, 2]) / 2
    assert areas.sum() == pytest.approx(1, abs=1e-9)
    assert len(mesh.triangles) >= 16  # where the toolkit begins its search
    away = np.hypot(speed / speed.max() - mesh.points[-1, 0], force / force.max() - mesh.points[-1, 1])
    assert source[-1] == away.argmin()


def test_one_model_makes_a_mesh():
    mesh, source = triangulate([80.0], [1.5])
    assert mesh.largest == (80.0, 1.5)
    assert not source.any()


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"speed": [0.0, np.nan, 0.0, 100.0]}, "finite"),
        ({"force": [0.0, 0.0, -4.0, 4.0]}, ">= 0"),
        ({"force": [0.0, 0.0]}, "shape"),
        ({"triangles": [[0, 1, 4]]}, "node 4 of 4"),
        ({"triangles": [[0, 1, 1]]}, "no area"),
        ({"triangles": [[0, 1, 1.5]]}, "node 1.5"),
        ({"triangles": np.zeros((0, 3))}, "n in 1"),
    ],
)
def test_broken_meshes_are_refused_with_the_rule(change, rule):
    parts = dict(zip(("speed", "force", "triangles"), SQUARE, strict=True)) | change
    with pytest.raises(ValueError, match=rule):
        Mesh(**{name: np.array(part) for name, part in parts.items()})


@pytest.mark.parametrize(("speed", "force"), [([0.0], [1.0]), ([1.0], [0.0]), ([np.inf], [1.0]), ([], [])])
def test_models_without_motion_or_force_are_not_triangulated(speed, force):
    with pytest.raises(ValueError, match="largest above 0"):
        triangulate(speed, force)
