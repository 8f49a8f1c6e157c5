"""A model on a grid: what holds between the nodes, and what breaks a rule."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from texclass.haptics.textures.grid import GridModel, cell, operations, shares, warped

ONE = {"axes": ([50.0], [1.0]), "rows": [[[0.5]]], "power": [[1.0]], "peak": 1.0}


@pytest.mark.parametrize("scale", ["log", "root"])
def test_between_the_nodes_everything_is_linear_over_warped_axes(scale):
    rng = np.random.default_rng(0)
    axes = [4.0, 25.0, 100.0], [1.0, 4.0]
    model = GridModel(axes, rng.uniform(-0.9, 0.9, (3, 2, 2)), rng.uniform(1, 9, (3, 2)), 9.0, scale=scale)
    speed, force = np.array([25.0, 9.0, 400.0, 4.0]), np.array([4.0, 2.0, 9.0, 0.5])
    rows, power = model.at(speed, force)
    assert_allclose(rows[[0, 2, 3]], model.rows[[1, 2, 0], [1, 1, 0]])  # nodes, and beyond the outermost
    assert_allclose(power[[0, 2, 3]], model.power[[1, 2, 0], [1, 1, 0]])
    w = [(warped(x, scale) - warped(a, scale)) / (warped(b, scale) - warped(a, scale)) for a, x, b in
         ((4.0, 9.0, 25.0), (1.0, 2.0, 4.0))]  # fmt: skip
    corners = np.outer([1 - w[0], w[0]], [1 - w[1], w[1]])
    assert_allclose(rows[1], np.einsum("ij,ijk", corners, model.rows[:2]))
    assert_allclose(warped(power[1], scale), np.sum(corners * warped(model.power[:2], scale)))
    for x in (*speed, 1.0, 99.0):
        i, j, share = cell(warped(axes[0], scale), warped(x, scale).item())
        expected = shares(axes[:1], [[x]], scale)[0]
        assert_allclose((1 - share) * np.eye(3)[i] + share * np.eye(3)[j], expected)


def test_a_grid_of_velocities_reaches_all_directions():
    axes = [-9.0, 0.0, 9.0], [-9.0, 0.0, 9.0], [0.0, 1.0]
    rows = np.stack(np.meshgrid([-0.6, 0.0, 0.6], [-0.3, 0.0, 0.3], [0.0, 0.0], indexing="ij")[:2], axis=-1)
    rows, power = GridModel(axes, rows, np.ones((3, 3, 2)), 1.0, scale="root").at([-2.25], [1.0], [0.25])
    assert_allclose(rows, [[-0.3, 0.1]])
    assert_allclose(power, 1.0)


def test_order_400_costs_what_the_formula_says():
    assert operations(400, 0, 1000.0) == 70 + 400 * 27
    assert operations(0, 0, 1000.0) == 0
    assert operations(10, 2, 10_000.0) == pytest.approx(70 + 10 * 8.1 + 2 * 19.2)


def test_a_model_that_breaks_a_rule_is_refused():
    for change, message in (
        ({"rows": np.ones((1, 1, 1))}, "reflection coefficient is 1"),
        ({"power": [[-1.0]]}, "at least 0"),
        ({"axes": ([0.0], [1.0])}, "above 0"),
        ({"axes": ([2.0, 1.0], [1.0])}, "rising"),
        ({"axes": ([1.0, 2.0], [1.0])}, "rows has shape"),
        ({"axes": ([1.0],)}, "speed and force"),
        ({"peak": np.nan}, "Expected (a )?finite"),
        ({"frequency_hz": [1.0]}, "per_mm has shape"),
        ({"frequency_hz": [1.0, 2.0], "per_mm": [1.0, 2.0]}, "rows have 1 columns"),
        ({"frequency_hz": [1.0], "per_mm": [1.0], "rows": [[[3.0]]]}, "amplitudes"),
        ({"frequency_hz": [1.0], "per_mm": [1.0], "rows": [[[1e300]]]}, "amplitudes"),
    ):
        with pytest.raises(ValueError, match=message):
            GridModel(**(ONE | change))
