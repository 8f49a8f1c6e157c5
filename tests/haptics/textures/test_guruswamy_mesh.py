"""Textures on triangle meshes: smooth surface, registration, contact, friction and texture force."""

import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import ndimage

trimesh = pytest.importorskip("trimesh", reason="the extra `haptics` is not installed")

from guruswamy2011_meshes import (  # noqa: E402
    BUMP_WIDTH_MM,
    MESHES,
    RADIUS_MM,
    bump_height,
    hand_path,
    place,
)

from texclass.haptics.textures.guruswamy2011 import (  # noqa: E402
    Amplitude,
    LevelLaw,
    MeshRenderer,
    MeshSurface,
    SpatialTexture,
    SurfaceProfile,
    fit_texture,
    register_scan,
)
from texclass.haptics.textures.guruswamy2011.mesh_surface import divide_triangles  # noqa: E402
from texclass.vibration import DecayingModes  # noqa: E402

K = 0.5
MODE = 60.0, 30.0, 2.0, -1.0
TEXTURE = SpatialTexture(
    "two ridges", 500.0, 10.0, [2.0, 7.0], [0, 1], *([value] * 2 for value in MODE),
    scaling=Amplitude(LevelLaw(20.0, 0.5, 0.3), 20.0, 0.5), peak=2.0, direction=[1.0, 0.0],
)  # fmt: skip
LINE = SurfaceProfile([[-60.0, 0, 0], [60, 0, 0]], [0.0, 120.0])


@pytest.fixture(scope="module")
def surfaces():
    return {name: MeshSurface.from_mesh(mesh()) for name, mesh in MESHES.items()}


@pytest.fixture(scope="module")
def box():
    return MeshSurface.from_mesh(trimesh.creation.box([40, 40, 20]))


def contact_force(forces):
    return forces.constraint + forces.friction


# Surface ----------------------------------------------------------------------------------------------------


def test_distance_and_normal_are_those_of_the_simulated_shapes(surfaces):
    rng = np.random.default_rng(0)
    along, across, depth = rng.uniform(-25, 25, 40), rng.uniform(-15, 15, 40), rng.uniform(-0.5, 0.5, 40)
    for shape, surface in surfaces.items():
        inside, on_surface = place(shape, along, across, depth), place(shape, along, across, 0 * depth)
        for p, q, d in zip(inside, on_surface, depth, strict=True):
            distance, gradient = surface.evaluate(p)
            assert distance == pytest.approx(-d, abs=0.02)
            expected = (q - p) / d
            assert np.degrees(np.arccos(gradient @ expected / np.linalg.norm(gradient))) < 0.5


def test_the_gradient_is_the_derivative_of_the_distance(surfaces):
    for point in ([20.1, 1.3, 4.0], [19.9, 0.1, -7.0], [10.0, 17.2, 29.5]):
        numerical = [
            (surfaces["cylinder"].evaluate(point + h)[0] - surfaces["cylinder"].evaluate(point - h)[0]) / 2e-5
            for h in 1e-5 * np.eye(3)
        ]
        assert surfaces["cylinder"].evaluate(point)[1] == pytest.approx(numerical, abs=1e-7)


def test_large_and_narrow_triangles_are_divided_evenly():
    corners = np.array([
        [[0.0, 0, 0], [100, 0, 0], [100, 60, 0]],
        [[0, 0, 0], [0, 0.1, 0], [100, 0, 0]],
        [[0, 0, 0], [0, 0, 0], [1, 0, 0]],
    ])  # fmt: skip
    cell, area = divide_triangles(corners, 1.0)
    assert area.sum() == pytest.approx(3000 + 5, rel=1e-3)
    assert area.max() <= 1.0
    assert len(cell) < 3 * 3005
    centre = area @ cell / area.sum()
    assert centre == pytest.approx([(3000 * 200 / 3 + 5 * 100 / 3) / 3005, 3000 * 20 / 3005, 0], rel=0.01)


def test_two_triangles_are_a_plane():
    mesh = trimesh.Trimesh([[0, 0, 0], [50, 0, 0], [50, 30, 0], [0, 30, 0]], [[0, 1, 2], [0, 2, 3]])
    distance, gradient = MeshSurface.from_mesh(mesh).evaluate([20.0, 11.0, 0.7])
    assert distance == pytest.approx(0.7, abs=1e-12)
    assert gradient == pytest.approx([0, 0, 1], abs=1e-12)


def test_faces_that_meet_at_a_sharp_edge_stay_flat(box):
    for x in (-17.5, 0.0, 12.3, 17.5):
        assert box.evaluate([x, 3.0, 10.4])[1] == pytest.approx([0, 0, 1], abs=1e-12)


def test_meshes_without_area_or_with_too_many_cells_are_refused():
    with pytest.raises(ValueError, match="must have triangles with an area, got 0"):
        MeshSurface.from_mesh(trimesh.Trimesh())
    with pytest.raises(ValueError, match="pass a larger smoothing_mm"):
        MeshSurface.from_mesh(trimesh.creation.box([1000, 1000, 1000]), smoothing_mm=0.5)


def test_a_missing_extra_is_named(monkeypatch):
    mesh = trimesh.creation.box([1, 1, 1])
    monkeypatch.setitem(sys.modules, "trimesh.graph", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'texclass\[haptics\]'"):
        MeshSurface.from_mesh(mesh)


# Registration -----------------------------------------------------------------------------------------------


def stroke(shape, *, n=2000, length=50.0, start=-25.0, depth=0.0):
    along = np.linspace(start, start + length, n)
    return place(shape, along, np.zeros(n), np.full(n, depth))


@pytest.mark.parametrize("shape", MESHES)
def test_a_surface_point_has_a_position_along_the_profile_and_a_distance_from_it(surfaces, shape):
    path = stroke(shape)
    scan, profile = register_scan(surfaces[shape], np.zeros(2000), path, np.ones(2000), 500.0)
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert profile.length_mm == pytest.approx(steps.sum(), rel=2e-3)
    assert scan.distance_mm == pytest.approx(np.concatenate([[0], np.cumsum(steps)]), abs=0.15)
    rng = np.random.default_rng(1)
    chosen = rng.integers(100, 1900, 30)
    across = rng.uniform(-3, 3, 30)
    point = place(shape, np.linspace(-25, 25, 2000)[chosen], across, np.zeros(30))
    on_surface = [surfaces[shape].project(each) for each in point]
    s, d = profile.locate(*(np.array(each) for each in zip(*on_surface, strict=True)))
    tolerance = 0.15 if shape != "bump" else 0.5  # its lines of equal y are no straight lines
    assert s == pytest.approx(scan.distance_mm[chosen], abs=tolerance)
    if shape == "cylinder":  # the profile turns to the left of the axis, seen from outside
        assert d == pytest.approx(across, abs=0.03)
    else:
        assert np.sign(d).tolist() == np.sign(across).tolist()
        assert np.abs(d) == pytest.approx(np.abs(across), rel=0.1, abs=0.05)


def test_beyond_its_ends_an_open_profile_is_extended():
    s, d = LINE.locate([[-63.0, 1, 0], [64.0, -2, 0]], [[0, 0, 1], [0, 0, 1]])
    assert s == pytest.approx([-3, 124])
    assert d.tolist() == [1.0, -2.0]


def test_a_closed_profile_around_a_cylinder_has_no_ends(surfaces):
    n = 4000
    along = np.linspace(0, 2 * np.pi * RADIUS_MM, n, endpoint=False)
    path = place("cylinder", along, np.zeros(n), np.zeros(n))
    _, profile = register_scan(surfaces["cylinder"], np.zeros(n), path, np.ones(n), 500.0, is_closed=True)
    assert profile.length_mm == pytest.approx(2 * np.pi * RADIUS_MM, rel=2e-3)
    chosen = np.array([0.02, 40.0, 80.0, 125.6, 2 * np.pi * RADIUS_MM - 0.01])
    point = place("cylinder", chosen, np.full(5, 4.0), np.zeros(5))
    s, d = profile.locate(point, point * [1 / RADIUS_MM, 1 / RADIUS_MM, 0])
    difference = (s - chosen + profile.length_mm / 2) % profile.length_mm - profile.length_mm / 2
    assert np.abs(difference).max() < 0.25
    assert d == pytest.approx(np.full(5, 4.0), abs=0.05)
    assert np.all((s >= 0) & (s <= profile.length_mm))


def test_the_noise_of_a_tracker_does_not_lengthen_the_profile(surfaces):
    path = stroke("plane") + 0.1 * np.random.default_rng(0).standard_normal((2000, 3))
    scan, profile = register_scan(surfaces["plane"], np.zeros(2000), path, np.ones(2000), 500.0)
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).sum() > 300
    assert profile.length_mm == pytest.approx(50, rel=0.02)
    assert scan.speed.mean() == pytest.approx(50 / 4, rel=0.02)


def test_a_path_away_from_the_surface_and_a_path_at_rest_are_refused(surfaces):
    with pytest.raises(ValueError, match="Align the mesh"):
        register_scan(surfaces["plane"], np.zeros(9), np.full((9, 3), 5.0), np.ones(9), 500.0)
    with pytest.raises(ValueError, match="must contain a movement"):
        register_scan(surfaces["plane"], np.zeros(9), np.zeros((9, 3)), np.ones(9), 500.0)
    with pytest.raises(ValueError, match="must have shape"):
        register_scan(surfaces["plane"], np.zeros(9), np.zeros((9, 2)), np.ones(9), 500.0)


# Constraint and friction ------------------------------------------------------------------------------------


def test_the_constraint_is_k_times_the_depth_along_the_normal_and_zero_outside(surfaces):
    rng = np.random.default_rng(2)
    for shape, surface in surfaces.items():
        depth = np.concatenate([np.linspace(-1, 1.5, 100), np.linspace(1.5, -1, 100)])
        along, across = rng.uniform(-20, 20, 2)
        path = place(shape, np.full(200, along), np.full(200, across), depth)
        forces = MeshRenderer(surface, LINE, TEXTURE, stiffness=K, friction=0.0).process(path)
        size = np.linalg.norm(forces.constraint, axis=1)
        assert size == pytest.approx(np.maximum(K * depth, 0), abs=0.02)
        assert not np.any(contact_force(forces)[depth < -0.02])
        assert np.abs(forces.friction).max() < 2e-6
        inwards = (path[-1] - path[100]) / np.linalg.norm(path[-1] - path[100])
        assert np.all(forces.constraint[20:180] @ inwards >= 0.999 * size[20:180])


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("shape", MESHES)
def test_the_force_is_continuous_on_every_shape(surfaces, shape, friction):
    largest = []
    coarse = hand_path(shape, np.random.default_rng(3), duration_s=0.5)
    for refinement in (1, 6):
        knots = np.arange(len(coarse))
        fine = np.linspace(0, knots[-1], refinement * knots[-1] + 1)
        path = np.column_stack([np.interp(fine, knots, column) for column in coarse.T])
        renderer = MeshRenderer(surfaces[shape], LINE, TEXTURE, stiffness=K, friction=friction)
        force = contact_force(renderer.process(path))
        change = np.linalg.norm(np.diff(force, axis=0), axis=1)
        # Lipschitz: at most that of the spring, plus the rotation of the normal at the depth of the tip
        assert np.all(change <= 1.2 * K * np.linalg.norm(np.diff(path, axis=0), axis=1) + 1e-5)
        largest.append(change.max())
    assert largest[1] < 0.25 * largest[0]


def over_an_edge(box, depth, refinement):
    """Return the changes of the force and the steps of a tip that moves over the edge of a box."""
    x = np.concatenate([np.full(100 * refinement, 10.0), np.linspace(10, 22, 2000 * refinement)])
    z = np.full(x.size, 10 - depth)
    z[: 100 * refinement] = np.linspace(10.5, 10 - depth, 100 * refinement)
    path = np.column_stack([x, np.zeros(x.size), z])
    forces = MeshRenderer(box, LINE, TEXTURE, stiffness=K, friction=0.0).process(path)
    assert not np.any(forces.total[-1])
    assert np.sum(forces.constraint[:-1] * np.diff(path, axis=0)) <= K / 2 * np.sum(
        np.diff(path, axis=0) ** 2
    )
    return (np.linalg.norm(np.diff(each, axis=0), axis=1) for each in (forces.constraint, path))


def test_the_force_is_continuous_over_a_sharp_edge_unless_the_tip_is_deeper_than_its_radius(box):
    for refinement in (1, 8):
        change, step = over_an_edge(box, 0.3, refinement)
        assert np.all(change <= 4 * K * step + 1e-5)
        change, step = over_an_edge(box, 1.0, refinement)
        assert change.max() > 0.5 * K


@pytest.mark.parametrize("friction", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("shape", MESHES)
def test_constraint_and_friction_are_passive_on_random_paths(surfaces, shape, friction):
    renderer = MeshRenderer(surfaces[shape], LINE, TEXTURE, stiffness=K, friction=friction)
    for seed in range(2):
        renderer.reset()
        path = hand_path(shape, np.random.default_rng(seed), duration_s=1.5)
        forces = renderer.process(path)
        force, step = contact_force(forces), np.diff(path, axis=0)
        energy = K / 2 * np.sum((forces.contact_point - path) ** 2, axis=1)
        held = np.sum(force[:-1] * step, axis=1)
        leak = K / 2 * np.sum(step**2, axis=1)  # of holding the force; see MeshRenderer.required_damping
        assert np.all(held <= -np.diff(energy) + leak + 1e-9)
        # without the effect of sampling: over the closed path, and from its start to any point
        work = np.cumsum(np.sum((force[1:] + force[:-1]) / 2 * step, axis=1))
        bound = 2e-3 if friction == 0 else -1.0
        assert work[-1] <= bound
        assert work.max() <= 5e-3
        if friction == 0:
            assert work[-1] >= -2e-3


@pytest.mark.parametrize("kind", ["noisy sphere", "random triangles"])
def test_constraint_and_friction_are_passive_on_meshes_without_a_smooth_surface(kind):
    rng = np.random.default_rng(1)
    if kind == "noisy sphere":
        mesh = trimesh.creation.icosphere(2, 15.0)
        mesh.vertices += rng.normal(0, 0.6, mesh.vertices.shape)
    else:
        mesh = trimesh.Trimesh(rng.normal(0, 10, (60, 3)), rng.integers(0, 60, (40, 3)), process=False)
    surface, n_contacts = MeshSurface.from_mesh(mesh), 0
    for friction, sigma in ((0.0, 3), (0.0, 30), (0.5, 3), (0.5, 10)):
        renderer = MeshRenderer(surface, LINE, TEXTURE, stiffness=K, friction=friction)
        path = ndimage.gaussian_filter1d(rng.standard_normal((1500, 3)), sigma, axis=0)
        path *= 22 / np.abs(path).max()
        forces, step = renderer.process(path), np.diff(path, axis=0)
        energy = K / 2 * np.sum((forces.contact_point - path) ** 2, axis=1)
        held = np.sum(contact_force(forces)[:-1] * step, axis=1)
        assert np.all(held <= -np.diff(energy) + 1.003 * K / 2 * np.sum(step**2, axis=1) + 1e-9)
        n_contacts += int(np.sum(energy > 0))
    assert n_contacts > 200


def test_friction_dissipates_mu_times_the_constraint_times_the_distance(surfaces):
    n = 2000
    x = np.concatenate([np.linspace(-20, 20, n), np.linspace(20, -20, n)])
    depth = np.concatenate([np.linspace(-0.5, 1.0, 200), np.full(2 * n - 200, 1.0)])
    path = np.column_stack([x, np.zeros(2 * n), -depth])
    forces = MeshRenderer(surfaces["plane"], LINE, TEXTURE, stiffness=K, friction=0.4).process(path)
    sliding = np.r_[400:n, n + 200 : 2 * n]
    direction = np.sign(np.gradient(x))[sliding]
    assert forces.friction[sliding][:, 0] == pytest.approx(-0.4 * K * direction, abs=1e-6)
    work = np.sum((forces.friction[1:] + forces.friction[:-1]) / 2 * np.diff(path, axis=0), axis=1)
    assert work[400 : n - 1].sum() == pytest.approx(-0.4 * K * (x[n - 1] - x[400]), rel=1e-3)
    # after the reversal, the tip sticks over twice the stretch of the spring
    stuck = (np.abs(x[n:] - 20) < 0.79) & (np.arange(n) > 0)
    assert np.ptp(forces.contact_point[n:][stuck][:, 0]) < 2e-6


def test_a_tip_that_is_pushed_through_a_part_stays_on_the_side_where_it_entered(box):
    path = np.linspace([0.0, 0, 11], [0, 0, -14], 2000)
    forces = MeshRenderer(box, LINE, TEXTURE, stiffness=K).process(path)
    assert forces.contact_point[-1] == pytest.approx([0, 0, 10], abs=1e-6)
    assert forces.constraint[-1] == pytest.approx([0, 0, 24 * K], abs=1e-6)


def test_contact_starts_only_from_outside_and_ends_at_a_border_or_a_jump(surfaces):
    surface = surfaces["plane"]
    inside = np.linspace([0.0, 0, -30], [0, 0, -0.5], 300)
    renderer = MeshRenderer(surface, LINE, TEXTURE)
    assert not np.any(renderer.process(inside).total)
    fast = MeshRenderer(surface, LINE, TEXTURE, stiffness=K).process([[0, 0, 25.0], [0, 0, -15.0]])
    assert fast.constraint[1] == pytest.approx([0, 0, 15 * K])
    renderer.reset()
    down = np.linspace([50.0, 0, 1], [50, 0, -1], 100)
    over = np.linspace([50.0, 0, -1], [70, 0, -1], 1000)
    force = contact_force(renderer.process(np.vstack([down, over])))
    assert np.all(force[110:600, 2] > 0)
    assert not np.any(force[-200:])
    renderer.reset()
    assert np.any(renderer.process(down).total[-1])
    assert not np.any(contact_force(renderer.process([[-50.0, 0, -1], [-50.0, 0, -1]])))


def bounce(renderer, damping, *, mass=0.1, n=4000):
    """Return the largest energy of a mass that falls onto the plane, in N mm, after each contact."""
    fs, z, v, energies = renderer.fs, 0.5, -50.0, []
    renderer.reset()
    rate = max(damping, 1e-6) / mass  # in 1/s
    decay = np.exp(-rate / fs)
    for _ in range(n):
        force = contact_force(renderer.process([[0.0, 0, z]]))[0, 2]
        steady = 1000 * force / (rate * mass)  # 1 N accelerates 1 kg by 1000 mm/s^2
        # exact solution of m dv/dt = F - b v over one sample
        z += steady / fs + (v - steady) * (1 - decay) / rate
        v = steady + (v - steady) * decay
        if force == 0:
            energies.append(mass * v**2 / 2000)
    return np.array(energies)


def test_a_device_with_the_required_damping_is_stable_and_one_without_gains_energy(surfaces):
    renderer = MeshRenderer(surfaces["plane"], LINE, TEXTURE, stiffness=2.0, friction=0.0)
    assert renderer.required_damping == pytest.approx(1.0)  # 2000 N/m / (2 x 1000 Hz)
    first = 0.1 * 50**2 / 2000
    assert bounce(renderer, 1.0).max() <= first
    assert bounce(renderer, 0.0).max() > 1.02 * first


# Texture force ----------------------------------------------------------------------------------------------


def filter_sum(forces, texture, fs, *, period, speed, is_excited=None):
    """Return the sum of eq. (5) from the positions along the profile, without the renderer."""
    n, total = forces.along_mm.size, np.zeros(forces.along_mm.size)
    in_contact = np.any(forces.constraint != 0, axis=1)
    force = np.linalg.norm(forces.constraint, axis=1)
    for position in texture.position_mm:
        lap = np.floor((forces.along_mm - position) / period)
        for i in np.flatnonzero(np.diff(lap) > 0) + 1:
            if in_contact[i] and in_contact[i - 1] and (is_excited is None or is_excited[i]):
                A = texture.scaling.factor(speed[i], force[i])
                response = DecayingModes(*(np.array([value]) for value in MODE)).synthesize(n - i, fs)
                total[i:] += A * response
    return total


@pytest.mark.parametrize("shape", MESHES)
def test_the_texture_force_is_the_sum_of_the_active_filters(surfaces, shape):
    n, fs = 3000, 1000.0
    t = np.arange(n) / fs
    along, depth = 30 * (t + 0.04 * np.sin(9 * t)) - 45, 0.6 + 0.3 * np.sin(5 * t)
    depth[:100] = np.linspace(-0.5, depth[100], 100)
    path = place(shape, along, np.zeros(n), depth)
    on_surface = place(shape, along, np.zeros(n), np.zeros(n))
    _, profile = register_scan(surfaces[shape], np.zeros(n), on_surface, np.ones(n), fs)
    renderer = MeshRenderer(surfaces[shape], profile, TEXTURE, friction=0.2, mass_kg=0.03, stiffness=K)
    forces = renderer.process(path)
    step = np.diff(path, axis=0, prepend=path[:1])
    tangential = step - np.sum(step * forces.normal, axis=1)[:, np.newaxis] * forces.normal
    speed = np.linalg.norm(tangential, axis=1) * fs
    expected = 0.03 * filter_sum(forces, TEXTURE, fs, period=10.0, speed=speed)
    assert np.abs(expected).max() > 0.05
    assert forces.texture == pytest.approx(expected, abs=0.03 * 0.02)
    total = contact_force(forces) + forces.texture[:, np.newaxis] * forces.normal
    assert np.array_equal(forces.total, total)


def count_onsets(texture_force):
    """Return the number of jumps of the texture force, which filters with a phase of 0 cause."""
    return int(np.sum(np.diff(texture_force, prepend=0.0) > 0.02))


CLICK = replace(TEXTURE, frequency_hz=[0.0, 0.0], decay_per_s=[400.0, 400.0], phase=[0.0, 0.0])


@pytest.mark.parametrize(("speed", "direction", "n_expected"), [(50.0, 0, 20), (100.0, 0, 20), (50.0, 1, 0)])
def test_filters_become_active_with_the_position_along_the_profile(surfaces, speed, direction, n_expected):
    n = int(50 / speed * 1000)
    path = np.full((n + 50, 3), -1.0)
    path[:50, 2] = np.linspace(0.5, -1, 50)
    path[:, direction] = np.concatenate([np.full(50, -25.0), np.linspace(-25, 25, n)])
    path[:, 1 - direction] = 0.0
    period = 5.0 * 50 / 100
    texture = replace(CLICK, length_mm=period, position_mm=[0.2, 0.2 + 1e-9])
    forces = MeshRenderer(surfaces["plane"], LINE, texture, friction=0.0).process(path)
    assert abs(count_onsets(forces.texture) - n_expected) <= (1 if n_expected else 0)


def test_no_filter_becomes_active_in_the_air_beyond_the_reach_or_while_the_tip_sticks(surfaces):
    n = 1000
    x = np.linspace(-20, 20, n)
    depth = np.concatenate([np.linspace(-0.5, 1, 50), np.ones(n - 50)])

    def texture_force(y=0.0, depth=depth, x=x, **settings):
        renderer = MeshRenderer(surfaces["plane"], LINE, CLICK, **settings)
        return renderer.process(np.column_stack([x, np.full(n, y), -depth])).texture

    assert count_onsets(texture_force()) == 8
    assert not np.any(texture_force(depth=np.full(n, -0.2)))
    assert count_onsets(texture_force(y=8.0, reach_mm=10.0)) == 8
    assert not np.any(texture_force(y=12.0, reach_mm=10.0))
    assert not np.any(texture_force(x=np.linspace(-0.4, 0.4, n) + 4.5, friction=1.0))
    # lifted over 15 mm in the middle: the features there are not excited when the tip lands
    lifted = np.where(np.abs(x) < 7.4, -0.5, depth)
    assert count_onsets(texture_force(depth=lifted)) == 5
    # lifted just behind a feature: the filter that it made active decays in the air
    lift = int(np.argmax(x > -2.6))
    decayed = texture_force(depth=np.where(x > -2.6, -0.5, depth))
    assert decayed[lift] > decayed[lift + 5] > 0
    assert not np.any(decayed[-200:])


def test_between_the_legs_of_a_profile_its_nearest_point_jumps_and_no_filter_becomes_active(surfaces):
    legs = [[-20.0, -5, 0], [20, -5, 0], [20, 5, 0], [-20, 5, 0]]
    path = np.vstack([np.linspace(a, b, 200) for a, b in pairwise(legs)])
    _, profile = register_scan(surfaces["plane"], np.zeros(600), path, np.ones(600), fs=20.0)
    n = 1000
    tip = np.column_stack([np.full(n, -15.0), np.linspace(-3, 3, n), np.full(n, -1.0)])
    tip[:50, 2] = np.linspace(0.5, -1, 50)
    forces = MeshRenderer(surfaces["plane"], profile, CLICK, friction=0.0).process(tip)
    assert forces.along_mm[[60, -1]] == pytest.approx([5, 85], abs=0.3)
    assert not np.any(forces.texture)


def test_each_lap_around_a_cylinder_passes_the_same_features(surfaces):
    n = 3000
    along = np.linspace(0, 2 * np.pi * RADIUS_MM, n, endpoint=False)
    ring = place("cylinder", along, np.zeros(n), np.zeros(n))
    scan, profile = register_scan(surfaces["cylinder"], np.zeros(n), ring, np.ones(n), 500.0, is_closed=True)
    texture = replace(CLICK, length_mm=scan.distance_mm[-1], position_mm=[30.0, 80.0])
    laps = np.linspace(-20.0, 4 * np.pi * RADIUS_MM + 10, 2 * n)
    depth = np.concatenate([np.linspace(-0.5, 0.8, 100), np.full(2 * n - 100, 0.8)])
    renderer = MeshRenderer(surfaces["cylinder"], profile, texture, friction=0.0)
    forces = renderer.process(place("cylinder", laps, np.zeros(2 * n), depth))
    onsets = laps[np.diff(forces.texture, prepend=0.0) > 0.02]
    circumference = 2 * np.pi * RADIUS_MM
    assert onsets == pytest.approx([30, 80, circumference + 30, circumference + 80], abs=0.3)


def test_blocks_give_the_same_forces_as_the_whole_path(surfaces):
    path = hand_path("bump", np.random.default_rng(5), duration_s=0.8)
    renderer = MeshRenderer(surfaces["bump"], LINE, TEXTURE)
    whole = renderer.process(path)
    renderer.reset()
    parts = [renderer.process(block) for block in np.split(path, [1, 100, 101, 500])]
    for name in ("constraint", "friction", "texture", "normal", "contact_point", "along_mm", "across_mm"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert np.array_equal(joined, getattr(whole, name)), name


def test_invalid_input_is_refused_and_leaves_the_state_unchanged(surfaces):
    path = hand_path("plane", np.random.default_rng(6), duration_s=0.4)
    renderer = MeshRenderer(surfaces["plane"], LINE, TEXTURE)
    renderer.process(path[:200])
    for wrong in (path[200:, :2], np.where(np.arange(3) == 1, np.nan, path[200:])):
        with pytest.raises(ValueError, match="position"):
            renderer.process(wrong)
    rest = renderer.process(path[200:])
    whole = MeshRenderer(surfaces["plane"], LINE, TEXTURE).process(path)
    assert np.array_equal(rest.total, whole.total[200:])
    for settings in ({"stiffness": 0}, {"friction": -1}, {"mass_kg": np.nan}, {"fs": 0}, {"reach_mm": 0}):
        with pytest.raises(ValueError, match=next(iter(settings))):
            MeshRenderer(surfaces["plane"], LINE, TEXTURE, **settings)


def test_a_registered_scan_is_rendered_as_it_was_recorded(surfaces):
    n, fs = 2500, 500.0
    t = np.arange(n) / fs
    vibration = 5 * np.exp(-40 * (t % 0.2)) * np.sin(2 * np.pi * 30 * (t % 0.2))
    path = stroke("bump", n=n)
    scan, profile = register_scan(surfaces["bump"], vibration, path, np.full(n, 0.5), fs)
    fitted = fit_texture(scan)
    texture = fitted.texture
    assert texture.n_features == pytest.approx(25, abs=1)
    pressed = stroke("bump", n=n, depth=1.0)
    landing = np.linspace(stroke("bump", n=n, depth=-0.5)[0], pressed[0], 100)
    renderer = MeshRenderer(surfaces["bump"], profile, texture, fs=fs, friction=0.0, mass_kg=1.0)
    rendered = renderer.process(np.vstack([landing, pressed])).texture[100:]
    assert np.corrcoef(rendered[100:], fitted.responses.sum(n, fs)[100:])[0, 1] > 0.95


def test_the_bump_of_the_tests_is_smooth_and_steep_enough_to_turn_the_normal():
    slope = np.gradient(bump_height(np.linspace(0, 40, 400)), np.linspace(0, 40, 400)).min()
    assert np.degrees(np.arctan(-slope)) > 10
    assert slope == pytest.approx(-5 / BUMP_WIDTH_MM * np.exp(-0.5), rel=0.01)
