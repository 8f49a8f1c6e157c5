"""What a planned scene really does, measured through its renderer: its spectra, its time, its bytes."""

import gc
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from texclass.haptics.scene.definition import Device, HandPath, SceneDefinition, sweep
from texclass.haptics.scene.observations import Judge, Points, Scored
from texclass.haptics.scene.renderer import PlannedScene, SceneRenderer
from texclass.haptics.textures.grid import GridModel
from texclass.recording import Samples


@dataclass(frozen=True)
class ProofSettings:
    """What is rendered and timed.

    Attributes
    ----------
    seconds, settle_s : float
        Rendered at each point of a proof, and cut off before, s.
    n_samples, n_each : int
        Timed samples of the whole scene, and of each surface alone.
    n_runs : int
        Each sample counts with the least of so many runs: what else the machine did is left out.
    """

    seconds: float = 6.0
    settle_s: float = 0.3
    n_samples: int = 6_000
    n_each: int = 1_000
    n_runs: int = 5


PROOF = ProofSettings()


def prove(model: GridModel, points: Points, judge: Judge) -> Scored:
    """Return what a model scores, rendered sample by sample, at speeds and forces it has not seen."""
    rendered = np.stack([judge.spectrum(x) for x in render_at(model, points, judge.device)])
    return judge.verdict(points, rendered)


def render_at(model: GridModel, points: Points, device: Device) -> Samples:
    """Return what a model sounds like at the speed and force of each point, shape (n_points, n)."""
    n, n_points = round((PROOF.seconds + PROOF.settle_s) * device.rate_hz), len(points)
    output, band = device.largest_output, device.band_hz
    alone = PlannedScene("proof", device.rate_hz, device.unit, band, output, n_points, {"it": 0}, (model,))
    renderer = SceneRenderer(alone)
    for contact in range(n_points):
        renderer.touch(contact, "it")
    velocity = np.zeros((n_points, n, 2))
    velocity[..., 0] = points.speed[:, np.newaxis]
    force = np.repeat(points.force[:, np.newaxis], n, axis=1)
    return renderer.process(velocity, force)[:, round(PROOF.settle_s * device.rate_hz) :]


def measure(scene: PlannedScene, definition: SceneDefinition) -> dict[str, Any]:
    """Measure a planned scene with as many contacts as the budget says, one sample a call.

    Each contact passes from one surface to the next, so that crossfades count; speed and force move within
    what is expected.

    Returns
    -------
    dict
        As JSON knows it: "budget"; "microseconds", `quantiles` of samples that count with the least of
        `PROOF.n_runs` runs each; "microseconds_as_it_was", of the last run by itself, with whatever else the
        machine did; "bytes" of models and state in the renderer; "microseconds_each", surface -> median of
        one contact; "met", whether 99.9 % of the samples and all bytes are within the budget.
    """
    budget, expected, names = definition.budget, definition.expected, list(scene.assigned)
    motion = expected.speeds_mm_s, expected.forces_n
    renderer, alone = SceneRenderer(scene, n_contacts=budget.contacts), SceneRenderer(scene, n_contacts=1)
    with without_garbage_collection():
        runs = np.stack([run_steps(renderer, names, *motion, PROOF.n_samples) for _ in range(PROOF.n_runs)])
        alone_runs = {
            name: np.min([run_steps(alone, [name], *motion, PROOF.n_each) for _ in range(3)], axis=0)
            for name in names
        }
    quiet, n_bytes = quantiles(runs.min(axis=0)), renderer.n_bytes
    return {
        "met": quiet["p999"] <= budget.microseconds and n_bytes <= budget.bytes,
        "budget": budget.model_dump(),
        "microseconds": quiet,
        "microseconds_as_it_was": quantiles(runs[-1]),
        "bytes": n_bytes,
        "microseconds_each": {name: quantiles(took)["p50"] for name, took in alone_runs.items()},
    }


def quantiles(nanoseconds: Samples) -> dict[str, float]:
    """Return p50, p99, p999 and worst of measured times, in microseconds."""
    found = np.quantile(np.asarray(nanoseconds) / 1000, [0.5, 0.99, 0.999, 1.0])
    return dict(zip(("p50", "p99", "p999", "worst"), found.tolist(), strict=True))


def run_steps(
    renderer: SceneRenderer,
    surfaces: Sequence[str],
    speeds: tuple[float, float],
    forces: tuple[float, float],
    n_samples: int,
    *,
    paced: bool = False,
) -> Samples:
    """Return the time (ns) of each sample of all contacts, one call a sample; the same path at each call.

    To be run `without_garbage_collection`, as a haptic loop would. Contacts pass over all surfaces. `paced`
    waits for the next period before each sample, as a haptic loop does.
    """
    contacts, took = range(renderer.n_contacts), np.empty(n_samples)
    stay = max(1, n_samples // max(len(surfaces), 8))
    courses = [
        low + (high - low) * (0.5 - 0.5 * np.cos(n * np.linspace(0, 2 * np.pi, n_samples)))
        for n, (low, high) in ((7, speeds), (5, forces))
    ]
    motion = renderer.motion
    clock, step = time.perf_counter_ns, renderer.step_all
    renderer.reset()
    begin, period = clock(), 1e9 / renderer.fs
    for t in range(n_samples):
        if t % stay == 0:
            for contact in contacts:
                renderer.touch(contact, surfaces[(t // stay + contact) % len(surfaces)])
        motion[:, 0], motion[:, 2] = courses[0][t], courses[1][t]
        if paced:
            time.sleep(max(0.0, (begin + t * period - clock()) / 1e9))
        before = clock()
        step()
        took[t] = clock() - before
    return took


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Keep the garbage collector from interrupting; what exists stays out of its sight."""
    was_on = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if was_on:
            gc.enable()


@dataclass(frozen=True, eq=False)
class Played:
    """What was rendered, and how long a sample took.

    Attributes
    ----------
    samples : ndarray of shape (n,)
        In the scene's unit.
    microseconds : dict
        `quantiles` of what a sample took, on the clock.
    """

    samples: Samples
    microseconds: dict[str, float]

    def lines(self, scene: PlannedScene) -> list[str]:
        """Return how long the samples took, and how large they are."""
        t = self.microseconds
        seconds = self.samples.size / scene.fs
        return [
            f"{seconds:.1f} s at {scene.fs:g} Hz, one sample a call: {t['p50']:.1f} us (median), "
            f"{t['p99']:.1f} us (99 %), {t['p999']:.1f} us (99.9 %), {t['worst']:.0f} us (worst)",
            f"peak {abs(self.samples).max():.3g} {scene.unit}, the device's largest {scene.largest_output:g}",
        ]


def play_path(scene: PlannedScene, path: HandPath, *, seed: int = 0) -> Played:
    """Render one contact along a path.

    Raises
    ------
    ValueError
        If the path meets a surface that the scene does not have.
    """
    velocity, force, surfaces = path.at_rate(scene.fs)
    for name in sorted({name for name in surfaces if name is not None}):
        scene.index_of(name)
    renderer = SceneRenderer(scene, n_contacts=1, seed=seed)
    samples, took = np.empty((2, force.size))
    motion = zip(velocity[:, 0].tolist(), velocity[:, 1].tolist(), force.tolist(), surfaces, strict=True)
    touched: str | None = None
    clock = time.perf_counter_ns
    with without_garbage_collection():
        for t, (vx, vy, f, surface) in enumerate(motion):
            before = clock()
            if surface != touched:
                renderer.touch(0, surface)
                touched = surface
            samples[t] = renderer.step(0, vx, vy, f)
            took[t] = clock() - before
    return Played(samples, quantiles(took))


def sweep_of(scene: PlannedScene) -> HandPath:
    """Return the default path over all surfaces, within the speeds and forces of their models."""
    models = [model for model in scene.models if model.kind != "silence"]
    ends = [
        (float(np.min(nodes)), float(np.max(nodes))) if nodes else (50.0, 150.0)
        for nodes in ([v for m in models for v in m.speeds], [f for m in models for f in m.forces])
    ]
    return sweep(list(scene.assigned), *ends, fs=scene.fs)
