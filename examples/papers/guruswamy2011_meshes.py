"""Simulate triangle meshes and hand-held paths, and render on them: `guruswamy2011`, section III-A."""

from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import ndimage, spatial

from texclass.haptics.textures.guruswamy2011 import (
    Amplitude,
    LevelLaw,
    MeshForces,
    MeshRenderer,
    MeshSurface,
    SinusoidTexture,
    SurfaceProfile,
    register_scan,
)
from texclass.haptics.textures.guruswamy2011.texture import BACKLASH_MM
from texclass.vibration import DecayingModes

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


# Rendering --------------------------------------------------------------------------------------------------

FS = 1000.0
"""Haptic rate in Hz (section III-A)."""
FRICTION, MASS_KG, STIFFNESS = 0.3, 0.05, 0.5
"""Settings of the renderer: the defaults of `MeshRenderer`."""
N_PATHS, PATH_S = 10, 4.0
"""Number and duration in s of the hand-held paths on each mesh."""
TUTORIAL_SPEED = 100.0
"""Speed of the stroke in figure 3 in mm/s (the figure has no scale)."""


def tutorial_texture() -> SinusoidTexture:
    """Return the texture of figure 3: ten damped sinusoids with amplitudes of 1 and -1 m/s^2.

    Frequency, decay rate and positions are our choice, because the figure has no scale.
    """
    x = np.array([5.0, 12, 23, 29, 38, 52, 59, 71, 80, 92])
    sign = np.array([1, -1, 1, 1, -1, 1, -1, -1, 1, -1])
    ones = np.ones(x.size)
    law = LevelLaw(k_v=0.0, k_c=0.0, a_0=1.0)
    return SinusoidTexture(
        "tutorial", FS, 100.0, x, np.arange(x.size), 60 * ones, 50 * ones, ones, -sign * np.pi / 2,
        Amplitude(law, TUTORIAL_SPEED, 0.5, compensated=False), 1.0, [1.0, 0.0],
    )  # fmt: skip


def tutorial_stroke() -> MeshForces:
    """Render the texture of figure 3 on the plane, along the profile at constant speed and depth."""
    along = np.arange(0.0, 100.0, TUTORIAL_SPEED / FS)
    depth = np.concatenate([np.linspace(-0.2, 0.5, 20), np.full(along.size - 20, 0.5)])
    profile = SurfaceProfile([[-50.0, 0, 0], [50, 0, 0]], [0.0, 100.0])
    renderer = MeshRenderer(
        MeshSurface.from_mesh(plane()), profile, tutorial_texture(), friction=0.0, mass_kg=1.0
    )
    return renderer.process(place("plane", along - 50, np.zeros(along.size), depth))


def registered_profile(shape: str, surface: MeshSurface) -> SurfaceProfile:
    """Return the profile of a scan over the middle of a shape, 80 mm long, with the noise of a tracker."""
    n = 4000
    along = np.linspace(-40, 40, n)
    path = place(shape, along, np.zeros(n), np.zeros(n))
    path += 0.1 * np.random.default_rng(0).standard_normal(path.shape)
    return register_scan(surface, np.zeros(n), path, np.ones(n), 500.0)[1]


def render_meshes(
    rng: np.random.Generator, n_paths: int = N_PATHS, duration_s: float = PATH_S
) -> tuple[dict[str, Any], dict[str, tuple[Samples, MeshForces]]]:
    """Render hand-held paths on all shapes; return measures per shape, and the last path with its forces.

    The measures are distance_error and normal_error (of the surface, 95th percentile in mm and degrees),
    change (largest change of the contact force relative to k |dp|), work (of the constraint alone, on closed
    paths without friction, largest magnitude in N mm), friction_work (mean work of constraint and friction),
    most_returned (largest energy that the contact returned up to any sample, in N mm), texture_error (largest
    difference of the texture force and the sum of eq. (5) in N), texture_peak (N) and n_features (number of
    filters that became active).
    """
    results, shown = {}, {}
    for shape, mesh in MESHES.items():
        surface = MeshSurface.from_mesh(mesh())
        profile = registered_profile(shape, surface)
        rows = []
        for _ in range(n_paths):
            path = hand_path(shape, rng, duration_s=duration_s)
            rows.append(measure_path(surface, profile, path))
            shown[shape] = path, rows[-1].pop("forces")
        largest = ("change", "work", "most_returned", "texture_error", "texture_peak")
        results[shape] = surface_errors(shape, surface, rng)
        results[shape] |= {name: float(max(row[name] for row in rows)) for name in largest}
        results[shape]["friction_work"] = float(np.mean([row["friction_work"] for row in rows]))
        results[shape]["n_features"] = int(sum(row["n_features"] for row in rows))
    return results, shown


def surface_errors(shape: str, surface: MeshSurface, rng: np.random.Generator) -> dict[str, float]:
    """Return the 95th percentiles of the errors of distance (mm) and normal (degrees) near the surface."""
    along, across, depth = rng.uniform([[-25], [-15], [0.1]], [[25], [15], [0.5]], (3, 200))
    inside, outside = (place(shape, along, across, sign * depth) for sign in (1, -1))
    errors = []
    for p, normal, d in zip(inside, outside - inside, depth, strict=True):
        here = surface.evaluate(p)
        assert here is not None
        cosine = here[1] @ normal / np.linalg.norm(normal) / np.linalg.norm(here[1])
        errors.append((abs(here[0] + d), np.degrees(np.arccos(min(cosine, 1.0)))))
    distance, angle = np.quantile(errors, 0.95, axis=0)
    return {"distance_error": float(distance), "normal_error": float(angle)}


def measure_path(surface: MeshSurface, profile: SurfaceProfile, path: Samples) -> dict[str, Any]:
    """Render a path, and return the measures of `render_meshes` for it, and its forces."""
    texture = tutorial_texture()
    smooth, rough = (
        MeshRenderer(surface, profile, texture, stiffness=STIFFNESS, friction=mu, mass_kg=MASS_KG).process(
            path
        )
        for mu in (0.0, FRICTION)
    )
    step = np.diff(path, axis=0)
    moved = np.linalg.norm(step, axis=1) > 1e-9
    work, change = [], 0.0
    for forces in (smooth, rough):
        contact = forces.constraint + forces.friction
        work.append(np.cumsum(np.sum((contact[1:] + contact[:-1]) / 2 * step, axis=1)))
        changes = np.linalg.norm(np.diff(contact, axis=0), axis=1)[moved]
        change = max(change, float(np.max(changes / (STIFFNESS * np.linalg.norm(step, axis=1)[moved]))))
    total, n_features = sum_of_filters(rough, path, texture)
    return {
        "forces": rough,
        "change": change,
        "work": abs(float(work[0][-1])),
        "friction_work": float(work[1][-1]),
        "most_returned": float(max(work[0].max(), work[1].max())),
        "texture_error": float(np.abs(rough.texture - MASS_KG * total).max()),
        "texture_peak": float(np.abs(rough.texture).max()),
        "n_features": n_features,
    }


def sum_of_filters(forces: MeshForces, path: Samples, texture: SinusoidTexture) -> tuple[Samples, int]:
    """Return the sum of eq. (5), from the positions along the profile, and the number of its filters."""
    pressure = np.linalg.norm(forces.constraint, axis=1)
    in_contact = pressure > 0
    step = np.diff(path, axis=0, prepend=path[:1])
    sideways = step - np.sum(step * forces.normal, axis=1, keepdims=True) * forces.normal
    amplitude = texture.scaling.factor(FS * np.linalg.norm(sideways, axis=1), pressure)
    total, n_features = np.zeros(len(path)), 0
    passed = [forces.along_mm[0]]
    for s in forces.along_mm[1:]:
        passed.append(min(max(passed[-1], s), s + BACKLASH_MM))
    for k, x in enumerate(texture.position_mm):
        row = slice(k, k + 1)
        modes = DecayingModes(
            texture.frequency_hz[row], texture.decay_per_s[row], texture.amplitude[row], texture.phase[row]
        )
        lap = np.floor((np.array(passed) - x) / texture.length_mm)
        for i in np.flatnonzero(np.diff(lap)) + 1:
            if in_contact[i] and in_contact[i - 1]:
                total[i:] += amplitude[i] * modes.synthesize(len(path) - i, FS)
                n_features += 1
    return total, n_features
