"""A triangulation of the plane of speed and force, and the weights of its nodes at a point of the plane."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import Delaunay

from texclass.recording import Samples
from texclass.textures.hatt import _kernels as kernels

N_BORDER = 6
"""Nodes that `triangulate` puts on each side of the rectangle from rest to the largest speed and force."""

MOST_TRIANGLES = 20_000
"""All are looked at for each aim of a renderer."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Nodes and triangles. Frozen; its arrays are read-only.

    Parameters
    ----------
    speed : array_like of shape (n_nodes,)
        mm/s, at least 0.
    force : array_like of shape (n_nodes,)
        N, at least 0.
    triangles : array_like of shape (n_triangles, 3)
        Nodes at the corners, counted from 0; at least one triangle, none without an area.

    Raises
    ------
    ValueError
        If a shape does not fit or a rule is broken; the message names which.
    """

    speed: Samples
    force: Samples
    triangles: NDArray[np.integer | np.floating]

    def __post_init__(self) -> None:
        nodes = [np.array(each, dtype=np.float64) for each in (self.speed, self.force)]
        for name, axis in zip(("speed", "force"), nodes, strict=True):
            if axis.ndim != 1 or axis.shape != nodes[0].shape or not np.all(np.isfinite(axis) & (axis >= 0)):
                raise ValueError(f"{name} of the nodes, shape {axis.shape}; the rule is (n,), finite, >= 0")
        corners = _corners(self.triangles, nodes[0].size)
        for name, array in (("speed", nodes[0]), ("force", nodes[1]), ("triangles", corners)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        flat = np.flatnonzero(~(np.abs(_doubled_areas(self.points[corners])) > 1e-12))
        if flat.size:
            raise ValueError(f"triangle {flat[0]} {corners[flat[0]].tolist()} has no area; the rule is one")

    @cached_property
    def points(self) -> Samples:
        """Nodes (n_nodes, 2) as shares of the largest speed and the largest force."""
        return np.column_stack([self.speed / self.largest[0], self.force / self.largest[1]])

    @cached_property
    def largest(self) -> tuple[float, float]:
        """Largest speed (mm/s) and force (N) of a node; 1 where all are 0."""
        return float(self.speed.max(initial=0.0)) or 1.0, float(self.force.max(initial=0.0)) or 1.0

    def weights(self, speed: float, force: float) -> tuple[NDArray[np.int64], Samples]:
        """Return three nodes and their weights, at least 0 and 1 in sum: the barycentric coordinates.

        Outside all triangles they are those of the nearest point of an edge, in the plane of `points`.
        """
        nodes, weights = np.zeros(3, dtype=np.int64), np.zeros(3)
        x, y = speed / self.largest[0], force / self.largest[1]
        kernels.locate(x, y, self.points, self.triangles, nodes, weights)
        return nodes, weights


def triangulate(speed: ArrayLike, force: ArrayLike) -> tuple[Mesh, NDArray[np.int64]]:
    """Return the Delaunay triangulation of models and of the border around them, and whose model a node has.

    The border is the rectangle from rest to the largest speed and force, `N_BORDER` nodes a side; each takes
    the model of the nearest given point. The published files have it too: their renderer walks through the
    triangles of that rectangle and leaves it nowhere.

    Parameters
    ----------
    speed, force : array_like of shape (n,)
        Of the models, mm/s and N, at least 0, the largest of each above 0; n at least 1.

    Returns
    -------
    mesh : Mesh
        The given points come first.
    source : ndarray of int, shape (n_nodes,)
        Whose model each node has.

    Raises
    ------
    ValueError
        If a value is not finite, negative, or the largest speed or force is 0.
    """
    given = np.column_stack([np.ravel(speed), np.ravel(force)]).astype(np.float64)
    top = given.max(axis=0, initial=0.0)
    if not (np.all(np.isfinite(given) & (given >= 0)) and np.all(top > 0)):
        raise ValueError(f"speeds and forces reach {top.tolist()}; the rule is finite, >= 0, largest above 0")
    scaled = given / top
    side = np.linspace(0.0, 1.0, N_BORDER)
    border = np.array([(x, y) for x in side for y in side if x in (0.0, 1.0) or y in (0.0, 1.0)])
    away = np.linalg.norm(border[:, np.newaxis] - scaled, axis=2)
    new = away.min(axis=1) > 1e-6
    source = np.concatenate([np.arange(len(given)), away[new].argmin(axis=1)])
    points = np.concatenate([scaled, border[new]])
    triangles = Delaunay(points).simplices
    sound = np.abs(_doubled_areas(points[triangles])) > 1e-9
    nodes = np.concatenate([given, border[new] * top])
    return Mesh(nodes[:, 0], nodes[:, 1], triangles[sound].astype(np.int64)), source


def _corners(triangles: ArrayLike, n_nodes: int) -> NDArray[np.int64]:
    found = np.asarray(triangles)
    if found.ndim != 2 or found.shape[1:] != (3,) or not 0 < len(found) <= MOST_TRIANGLES:
        raise ValueError(
            f"triangles have shape {found.shape}; the rule is (n, 3), n in 1 ... {MOST_TRIANGLES}"
        )
    wrong = ~((found >= 0) & (found < n_nodes) & (found == np.floor(found)))
    if wrong.any():
        raise ValueError(f"a corner is node {found[wrong][0]:g} of {n_nodes}; the rule is one of them")
    return found.astype(np.int64)


def _doubled_areas(corners: Samples) -> Samples:
    """Return twice the signed area of triangles (n, 3, 2)."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.asarray(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
