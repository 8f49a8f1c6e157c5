"""Simulate triangle meshes and hand-held paths on them, for `guruswamy2011`, section III-A."""

from collections.abc import Callable

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import ndimage, spatial

Samples = NDArray[np.float64]
RADIUS_MM, BUMP_HEIGHT_MM, BUMP_WIDTH_MM = 20.0, 5.0, 15.0
"""Radius of the cylinder, and height and standard deviation of the bump (our choice)."""


def plane() -> trimesh.Trimesh:
    """Return a plane of 120 x 60 mm at z = 0."""
    return height_field(np.zeros_like)


def bump() -> trimesh.Trimesh:
    """Return a plane of 120 x 60 mm with a Gaussian bump at the origin."""
    return height_field(bump_height)


def bump_height(r: Samples) -> Samples:
    """Return the height of the bump in mm at a distance r (mm) from its axis."""
    return np.asarray(BUMP_HEIGHT_MM * np.exp(-((r / BUMP_WIDTH_MM) ** 2) / 2))


def cylinder() -> trimesh.Trimesh:
    """Return a closed cylinder of 60 mm along z, with facets of 1.3 mm."""
    return trimesh.creation.cylinder(RADIUS_MM, 60.0, sections=96)


def height_field(height: Callable[[Samples], Samples], edge_mm: float = 1.5) -> trimesh.Trimesh:
    """Return a mesh of 120 x 60 mm whose height is a function of the distance from the z axis."""
    x, y = (
        axis.ravel() for axis in np.meshgrid(np.arange(-60, 60.1, edge_mm), np.arange(-30, 30.1, edge_mm))
    )
    faces = spatial.Delaunay(np.column_stack([x, y])).simplices
    mesh = trimesh.Trimesh(np.column_stack([x, y, height(np.hypot(x, y))]), faces)
    if mesh.face_normals[:, 2].sum() < 0:
        mesh.invert()
    return mesh


MESHES = {"plane": plane, "cylinder": cylinder, "bump": bump}


def place(shape: str, along: Samples, across: Samples, depth: Samples) -> Samples:
    """Return the points (n, 3) at positions on a shape and depths below it in mm.

    On the plane and the bump, `along` is x and `across` is y. On the cylinder, `along` is the length of the
    arc and `across` is z.
    """
    if shape == "cylinder":
        angle, r = along / RADIUS_MM, RADIUS_MM - depth
        return np.column_stack([r * np.cos(angle), r * np.sin(angle), across])
    r = np.hypot(along, across)
    z = bump_height(r) if shape == "bump" else np.zeros_like(r)
    slope = -z * r / BUMP_WIDTH_MM**2
    normal = np.column_stack([*(-slope / np.maximum(r, 1e-12) * np.stack([along, across])), np.ones_like(r)])
    normal /= np.linalg.norm(normal, axis=1)[:, np.newaxis]
    return np.column_stack([along, across, z]) - depth[:, np.newaxis] * normal


def hand_path(
    shape: str, rng: np.random.Generator, *, duration_s: float = 4.0, fs: float = 1000.0
) -> Samples:
    """Simulate a hand-held path (n, 3) in mm that starts and ends at the same point above the surface.

    Position, distance from the profile and depth vary smoothly at up to about 3 Hz, with speeds of some 100
    mm/s. The depth varies from -1 mm, above the surface, to 2 mm.
    """
    n = int(duration_s * fs)
    motion = ndimage.gaussian_filter1d(rng.standard_normal((3, n)), 0.06 * fs, mode="wrap")
    low, high = motion.min(axis=1, keepdims=True), motion.max(axis=1, keepdims=True)
    along, across, depth = (motion - low) / (high - low)
    columns = 80 * along - 40, 30 * across - 15, 3 * depth - 1
    start = int(np.argmin(depth))
    path = place(shape, *(np.roll(each, -start) for each in columns))
    return np.vstack([path, path[:1]])
