"""A triangulation of the plane of speed and force, and the weights of its nodes at points of the plane."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import Delaunay

from texclass.recording import Samples
from texclass.textures.contract import freeze

N_BORDER = 6
"""Nodes that `triangulate` puts on each side of the rectangle from rest to the largest speed and force."""
MOST_TRIANGLES = 20_000
"""All are looked at for each point."""


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
        freeze(self, speed=("n_nodes",), force=("n_nodes",), triangles=("n_triangles", 3))
        for name in ("speed", "force"):
            if np.any(getattr(self, name) < 0):
                raise ValueError(f"{name} of a node is {getattr(self, name).min()}; the rule is >= 0")
        n, found = self.speed.size, self.triangles
        if not 0 < len(found) <= MOST_TRIANGLES:
            raise ValueError(
                f"triangles have shape {found.shape}; the rule is (n, 3), n in 1 ... {MOST_TRIANGLES}"
            )
        wrong = ~((found >= 0) & (found < n) & (found == np.floor(found)))
        if wrong.any():
            raise ValueError(f"a corner is node {found[wrong][0]:g} of {n}; the rule is one of them")
        corners = found.astype(np.int64)
        corners.setflags(write=False)
        object.__setattr__(self, "triangles", corners)
        flat = np.flatnonzero(~(np.abs(_doubled_areas(self.points[corners])) > 1e-12))
        if flat.size:
            raise ValueError(f"triangle {flat[0]} {corners[flat[0]].tolist()} has no area; the rule is one")

    @cached_property
    def points(self) -> Samples:
        """Nodes (n_nodes, 2) as shares of the largest speed and the largest force."""
        return np.column_stack([self.speed, self.force]) / self.largest

    @cached_property
    def largest(self) -> tuple[float, float]:
        """Largest speed (mm/s) and force (N) of a node; 1 where all are 0."""
        return float(self.speed.max(initial=0.0)) or 1.0, float(self.force.max(initial=0.0)) or 1.0

    def weights(self, speed: ArrayLike, force: ArrayLike) -> tuple[NDArray[np.int64], Samples]:
        """Return three nodes and their barycentric coordinates (at least 0, 1 in sum) at each point.

        Outside all triangles they are those of the nearest point of an edge, in the plane of `points`.

        Parameters
        ----------
        speed, force : array_like of shape (...)
            mm/s and N.

        Returns
        -------
        nodes : ndarray of int, shape (..., 3)
        weights : ndarray of shape (..., 3)
        """
        at = np.stack([np.ravel(speed), np.ravel(force)], axis=1) / self.largest
        nodes, weights = np.zeros((len(at), 3), dtype=np.int64), np.zeros((len(at), 3))
        _locate(at, self.points, self.triangles, nodes, weights)
        shape = (*np.shape(speed), 3)
        return nodes.reshape(shape), weights.reshape(shape)


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


def _doubled_areas(corners: Samples) -> Samples:
    """Return twice the signed area of triangles (n, 3, 2)."""
    return np.asarray(np.linalg.det(np.diff(corners, axis=1)))


@njit(cache=True, error_model="numpy")
def _locate(at, points, triangles, nodes, weights):  # type: ignore[no-untyped-def]
    """Write the nodes and weights at each place: inside a triangle, or on the nearest edge."""
    for i in range(len(at)):
        (x, y), nearest = at[i], np.inf
        for a, b, c in triangles:
            (ax, ay), (bx, by), (cx, cy) = points[a], points[b], points[c]
            area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            wb = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
            wc = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
            if wb >= 0.0 and wc >= 0.0 and wb + wc <= 1.0:
                nodes[i] = a, b, c
                weights[i] = max(1.0 - wb - wc, 0.0), wb, wc
                break
            for first, second in ((a, b), (b, c), (c, a)):
                (px, py), (qx, qy) = points[first], points[second]
                dx, dy = qx - px, qy - py
                w = min(max(((x - px) * dx + (y - py) * dy) / (dx * dx + dy * dy), 0.0), 1.0)
                distance = (x - px - w * dx) ** 2 + (y - py - w * dy) ** 2
                if distance < nearest:
                    nearest = distance
                    nodes[i] = first, second, first
                    weights[i] = 1.0 - w, w, 0.0
