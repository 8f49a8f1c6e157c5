"""Models on a grid: interpolation between the nodes, and checks."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from texclass.haptics.textures.grid import GridModel, cell, interpolation_weights, operations, warp

ONE = {"axes": ([50.0], [1.0]), "rows": [[[0.5]]], "power": [[1.0]], "peak": 1.0}


@pytest.mark.parametrize("scale", ["log", "root"])
def test_rows_and_power_are_linear_over_warped_axes(scale):
    rng = np.random.default_rng(0)
    axes = [4.0, 25.0, 100.0], [1.0, 4.0]
    model = GridModel(axes, rng.uniform(-0.9, 0.9, (3, 2, 2)), rng.uniform(1, 9, (3, 2)), 9.0, scale=scale)
    speed, force = np.array([25.0, 9.0, 400.0, 4.0]), np.array([4.0, 2.0, 9.0, 0.5])
    rows, power = model.at(speed, force)
    assert_allclose(rows[[0, 2, 3]], model.rows[[1, 2, 0], [1, 1, 0]])  # nodes, and beyond the outermost
    assert_allclose(power[[0, 2, 3]], model.power[[1, 2, 0], [1, 1, 0]])
    w = [(warp(x, scale) - warp(a, scale)) / (warp(b, scale) - warp(a, scale)) for a, x, b in
         ((4.0, 9.0, 25.0), (1.0, 2.0, 4.0))]  # fmt: skip
    corners = np.outer([1 - w[0], w[0]], [1 - w[1], w[1]])
    assert_allclose(rows[1], np.einsum("ij,ijk", corners, model.rows[:2]))
    assert_allclose(warp(power[1], scale), np.sum(corners * warp(model.power[:2], scale)))
    for x in (*speed, 1.0, 99.0):
        i, j, fraction = cell(warp(axes[0], scale), warp(x, scale).item())
        expected = interpolation_weights(axes[:1], [[x]], scale)[0]
        assert_allclose((1 - fraction) * np.eye(3)[i] + fraction * np.eye(3)[j], expected)


def test_a_grid_of_velocities_covers_all_directions():
    axes = [-9.0, 0.0, 9.0], [-9.0, 0.0, 9.0], [0.0, 1.0]
    rows = np.stack(np.meshgrid([-0.6, 0.0, 0.6], [-0.3, 0.0, 0.3], [0.0, 0.0], indexing="ij")[:2], axis=-1)
    rows, power = GridModel(axes, rows, np.ones((3, 3, 2)), 1.0, scale="root").at([-2.25], [1.0], [0.25])
    assert_allclose(rows, [[-0.3, 0.1]])
    assert_allclose(power, 1.0)


def test_the_number_of_operations_follows_the_formula():
    assert operations(400, 0, 1000.0) == 70 + 400 * 27
    assert operations(0, 0, 1000.0) == 0
    assert operations(10, 2, 10_000.0) == pytest.approx(70 + 10 * 8.1 + 2 * 19.2)


def test_invalid_models_are_refused():
    for change, message in (
        ({"rows": np.ones((1, 1, 1))}, "reflection coefficients must be below 1.*got 1"),
        ({"power": [[-1.0]]}, "at least 0"),
        ({"axes": ([0.0], [1.0])}, "be positive"),
        ({"axes": ([2.0, 1.0], [1.0])}, "must increase"),
        ({"axes": ([1.0, 2.0], [1.0])}, "rows must have shape"),
        ({"axes": ([1.0],)}, "speed and force"),
        ({"peak": np.nan}, "must be (a )?finite"),
        ({"frequency_hz": [1.0]}, "per_mm must have shape"),
        ({"frequency_hz": [1.0, 2.0], "per_mm": [1.0, 2.0]}, "at least 2 columns.*got 1"),
        ({"frequency_hz": [1.0], "per_mm": [1.0], "rows": [[[3.0]]]}, "amplitudes"),
        ({"frequency_hz": [1.0], "per_mm": [1.0], "rows": [[[1e300]]]}, "amplitudes"),
    ):
        with pytest.raises(ValueError, match=message):
            GridModel(**(ONE | change))
