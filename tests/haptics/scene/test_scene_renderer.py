"""The renderer of a scene: same samples in any blocks, no clicks, no allocation, bounded output."""

import gc
import re
import tracemalloc

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys
from scipy import signal

from texclass.haptics.scene import PlannedScene, SceneRenderer
from texclass.haptics.scene.renderer import FADE_S, PEAK_FACTOR
from texclass.haptics.textures.grid import GridModel
from texclass.haptics.textures.motion_renderer import MAX_INPUT
from texclass.vibration.autoregressive import Autoregression

FS = 1000.0
V, F = np.array([40.0, 160.0]), np.array([0.5, 2.0])
LATTICE = GridModel(
    (V, F), np.array([[[-0.9, 0.8], [-0.8, 0.7]], [[-0.5, 0.6], [-0.4, 0.5]]]),
    np.array([[1.0, 4.0], [4.0, 16.0]]), 8.0,
)  # fmt: skip
LINES = GridModel(
    (V, F), np.ones((2, 2, 2)), np.ones((2, 2)), 2.5, np.array([120.0, 0.0]), np.array([0.0, 0.5])
)
RNG = np.random.default_rng(0)
K400 = RNG.uniform(-0.4, 0.4, (2, 2, 400))
LONG = GridModel((V, F), K400, np.ones((2, 2)), 4.0)


@pytest.fixture
def scene():
    models = (LATTICE, LINES, GridModel.silence(), LONG)
    indices = {"a": 0, "b": 1, "c": 2, "d": 3, "a too": 0}
    return PlannedScene("test", FS, "m/s^2", (20.0, 450.0), 20.0, 2, indices, models)


def render_steady(renderer, surface, n, *, speed=80.0, force=1.0):
    renderer.reset()
    for contact in range(renderer.n_contacts):
        renderer.touch(contact, surface)
    velocity = np.zeros((renderer.n_contacts, n, 2))
    velocity[..., 0] = speed
    return renderer.process(velocity, np.full((renderer.n_contacts, n), force))


def random_motion(rng, n, n_contacts, surfaces):
    """Return velocity, force and surfaces with jumps, lifts, rests and extreme values."""
    block = np.repeat(rng.integers(0, 1000, (n_contacts, n // 20 + 1)), 20, axis=1)[:, :n]
    velocity = rng.normal(0, 1, (n_contacts, 1000, 2)) * 10.0 ** rng.uniform(-2, 4, (n_contacts, 1000, 1))
    force = rng.choice([-1.0, 0.0, 0.01, 1.0, 100.0], (n_contacts, 1000))
    names = rng.choice(np.array([*surfaces, None], dtype=object), (n_contacts, 1000))
    row = np.arange(n_contacts)[:, np.newaxis]
    return velocity[row, block], force[row, block], names[row, block].tolist()


def test_any_blocking_and_single_steps_give_the_same_samples(scene):
    velocity, force, names = random_motion(np.random.default_rng(1), 300, 2, scene.model_indices)
    whole = SceneRenderer(scene, seed=3).process(velocity, force, names)
    in_blocks, by_step, by_step_all = (SceneRenderer(scene, seed=3) for _ in range(3))
    blocks = [
        in_blocks.process(velocity[:, i : i + 37], force[:, i : i + 37], [row[i : i + 37] for row in names])
        for i in range(0, 300, 37)
    ]
    np.testing.assert_array_equal(np.concatenate(blocks, axis=1), whole)
    for t in range(300):
        for contact in range(2):
            by_step.touch(contact, names[contact][t])
            by_step_all.touch(contact, names[contact][t])
            assert by_step.step(contact, *velocity[contact, t], force[contact, t]) == whole[contact, t]
            by_step_all.motion[contact] = *velocity[contact, t], force[contact, t]
        np.testing.assert_array_equal(by_step_all.step_all(), whole[:, t])


def test_reset_returns_to_the_first_sample_and_contacts_have_their_own_noise(scene):
    renderer = SceneRenderer(scene, seed=1)
    first = render_steady(renderer, "a", 500)
    np.testing.assert_array_equal(render_steady(renderer, "a", 500), first)
    assert np.corrcoef(first)[0, 1] < 0.3
    single = SceneRenderer(scene, n_contacts=1, seed=1)
    np.testing.assert_array_equal(render_steady(single, "a", 500)[0], first[0])


def test_a_lattice_has_the_spectrum_of_its_node_and_power_follows_a_power_law_between_nodes(scene):
    renderer = SceneRenderer(scene, n_contacts=4, seed=5)
    x = render_steady(renderer, "a", 60_000, speed=160.0, force=2.0)[:, 1000:]
    assert np.sqrt(np.mean(x**2)) == pytest.approx(4.0, rel=0.02)
    f, power = signal.welch(x, FS, nperseg=256)
    k = LATTICE.rows[1, 1]
    model = Autoregression(k, 4.0 * np.sqrt(np.prod(1 - k**2)))
    expected = model.log_spectrum_db(2 * np.pi * f / FS) + 10 * np.log10(2 / FS)
    measured = 10 * np.log10(power.mean(axis=0))
    assert np.sqrt(np.mean((measured - expected)[2:-2] ** 2)) < 0.4
    x = render_steady(renderer, "a", 60_000, speed=80.0, force=1.0)[:, 1000:]
    assert np.mean(x**2) == pytest.approx(4.0, rel=0.05)  # geometric mean of 1 and 16


def test_lines_are_constant_or_proportional_to_the_speed(scene):
    x = render_steady(SceneRenderer(scene, n_contacts=1), "b", 9192, speed=120.0)[0, 1000:]
    power = np.abs(np.fft.rfft(x * np.hanning(x.size)))
    f = np.fft.rfftfreq(x.size, 1 / FS)
    assert np.abs(f[np.argmax(np.where(f > 90, power, 0))] - 120) < 0.2
    assert np.abs(f[np.argmax(np.where(f < 90, power, 0))] - 60) < 0.2


def test_the_output_is_silent_without_model_contact_speed_or_force(scene):
    renderer = SceneRenderer(scene)
    for surface, speed, force in (("c", 80, 1), (None, 80, 1), ("a", 0, 1), ("a", 80, 0), ("a", 80, -3)):
        assert not render_steady(renderer, surface, 300, speed=speed, force=force).any(), surface


def test_there_is_no_click_when_contact_surface_speed_or_force_change():
    """The vibration is so smooth that a click would exceed the largest step between its samples."""
    smooth = np.full((2, 2, 1), np.sqrt(2)), np.ones((2, 2)), 2.0
    models = tuple(GridModel((V, F), *smooth, [hz], [0.0]) for hz in (5.0, 7.0))
    scene = PlannedScene("s", 10_000.0, "m/s^2", (1.0, 4500.0), 20.0, 1, {"a": 0, "b": 1}, models)
    renderer = SceneRenderer(scene)
    n = 20_000
    surfaces = ["a"] * 4000 + ["b"] * 50 + ["a"] * 3950 + [None] * 2000 + ["b"] * 10_000
    velocity, force = np.full((1, n, 2), 60.0), np.ones((1, n))
    velocity[0, 12_000:14_000] = 0.0
    force[0, 15_000:17_000] = 0.0
    x = renderer.process(velocity, force, [surfaces])[0]
    slope = 2 * np.pi * 7 / 10_000 * 1.5 + 1.5 * 1.5 / (FADE_S * 10_000)
    assert np.abs(x).max() > 1
    assert np.abs(np.diff(x, prepend=0.0)).max() < 2 * slope


@pytest.mark.parametrize("surface", ["a", "b"])
def test_steps_allocate_no_memory(scene, surface):
    renderer = SceneRenderer(scene)
    for contact in range(2):
        renderer.touch(contact, surface)
    renderer.motion[:] = 80.0, 0.0, 1.0

    def loop(n):
        for _ in range(n):
            renderer.step_all()
            renderer.step(0, 80.0, 0.0, 1.0)

    loop(50)
    gc.collect()
    _nrt_python.memsys_enable_stats()
    initial = rtsys.get_allocation_stats()
    tracemalloc.start()
    loop(50)
    start, _ = tracemalloc.get_traced_memory()
    tracemalloc.reset_peak()
    loop(300)
    end, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert end - start < 200
    assert peak - start < 1000  # one float and one call, not 300
    final = rtsys.get_allocation_stats()
    assert final.alloc - final.free == initial.alloc - initial.free


def test_the_output_is_finite_and_bounded_for_any_motion(scene):
    renderer, rng = SceneRenderer(scene, n_contacts=100), np.random.default_rng(2)
    for _ in range(4):
        x = renderer.process(*random_motion(rng, 400, 100, scene.model_indices))
        assert np.isfinite(x).all()
        assert np.abs(x).max() <= min(scene.largest_output, np.sqrt(2) * PEAK_FACTOR * 8.0)
    loud = GridModel((V, F), np.full((2, 2, 1), -0.9), np.full((2, 2), 100.0), 1.0)
    loud_scene = PlannedScene("s", FS, "m/s^2", (20.0, 450.0), 20.0, 1, {"a": 0}, (loud,))
    assert np.abs(render_steady(SceneRenderer(loud_scene), "a", 1000)).max() == PEAK_FACTOR * 1.0


def test_one_sample_at_the_input_bound_is_forgotten(scene):
    renderer, twin = (SceneRenderer(scene, n_contacts=1, seed=4) for _ in range(2))
    velocity, force = np.full((1, 1000, 2), 60.0), np.ones((1, 1000))
    for each in (renderer, twin):
        each.touch(0, "a")
    expected = twin.process(velocity, force)
    velocity[0, 10], force[0, 10] = -MAX_INPUT, MAX_INPUT
    samples = renderer.process(velocity, force)
    assert np.isfinite(samples).all()
    np.testing.assert_allclose(samples[:, 500:], expected[:, 500:], rtol=1e-5, atol=1e-5)


def test_invalid_arguments_are_rejected_with_their_value_and_change_nothing(scene):
    renderer, twin = (SceneRenderer(scene, n_contacts=2) for _ in range(2))
    for either in (renderer, twin):
        either.touch(0, "a")
    for match, call in (
        ("must be finite", lambda: renderer.step(0, np.nan, 0.0, 1.0)),
        ("must be finite", lambda: renderer.step(0, 0.0, 0.0, np.inf)),
        ("must be finite", lambda: renderer.process(np.full((2, 1, 2), np.nan), np.ones((2, 1)))),
        (r"\(2, n, 2\)", lambda: renderer.process(np.ones((1, 1, 2)), np.ones((1, 1)))),
        ("shape of force", lambda: renderer.process(np.ones((2, 1, 2)), np.ones((2, 1)), [["a", "a"]])),
        ("between 0 and 1, got 7", lambda: renderer.step(7, 0.0, 0.0, 0.0)),
        ("one of a, b, c, d, a too, got 'x'", lambda: renderer.touch(0, "x")),
        ("n_contacts must be at least 1, got 0", lambda: SceneRenderer(scene, n_contacts=0)),
    ):
        with pytest.raises(ValueError, match=match):
            call()
    for motion in ((1.4e154, 0.0, 1.0), (0.0, -1.01 * MAX_INPUT, 1.0), (0.0, 0.0, 1e300)):
        with pytest.raises(ValueError, match=rf"got {re.escape(f'{motion[0]:g}')} and"):
            renderer.step(0, *motion)
        with pytest.raises(ValueError, match=r"at most 1e\+09 mm/s and N"):
            renderer.process(np.full((2, 1, 2), motion[:2]), np.full((2, 1), motion[2]))
    assert renderer.step(0, 80.0, 0.0, 1.0) == twin.step(0, 80.0, 0.0, 1.0)
    renderer.motion[1, 2] = np.nan
    with pytest.raises(ValueError, match=r"must be finite"):
        renderer.step_all()
