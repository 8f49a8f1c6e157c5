"""Measure a planned scene with its renderer: score of the rendered spectra, time and memory."""

import gc
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from texclass.haptics.scene.definition import Device, HandPath, SceneDefinition, sweep_path
from texclass.haptics.scene.renderer import PlannedScene, SceneRenderer
from texclass.haptics.scene.surface_spectra import OperatingPoints, Score, SpectralScorer
from texclass.haptics.textures.grid import GridModel
from texclass.recording import Samples


@dataclass(frozen=True)
class MeasurementSettings:
    """Durations of rendering and timing.

    Attributes
    ----------
    duration_s : float
        Rendered duration at each operating point in s.
    settle_s : float
        Duration in s that is rendered first and discarded.
    n_samples : int
        Number of timed samples for the whole scene.
    n_surface_samples : int
        Number of timed samples for each surface.
    n_runs : int
        Number of runs. The time of each sample is the minimum over the runs, which excludes interruptions by
        other processes.
    """

    duration_s: float = 6.0
    settle_s: float = 0.3
    n_samples: int = 6_000
    n_surface_samples: int = 1_000
    n_runs: int = 5


MEASUREMENT = MeasurementSettings()


def score_rendered(model: GridModel, points: OperatingPoints, scorer: SpectralScorer) -> Score:
    """Render a model sample by sample at operating points, and return its score."""
    rendered = np.stack([scorer.spectrum(x) for x in render_points(model, points, scorer.device)])
    return scorer.score(points, rendered)


def render_points(model: GridModel, points: OperatingPoints, device: Device) -> Samples:
    """Render a model at the speed and force of each operating point, shape (n_points, n)."""
    n = round((MEASUREMENT.duration_s + MEASUREMENT.settle_s) * device.rate_hz)
    n_points = len(points)
    scene = PlannedScene(
        "measurement", device.rate_hz, device.unit, device.band_hz, device.largest_output, n_points,
        {"surface": 0}, (model,),
    )  # fmt: skip
    renderer = SceneRenderer(scene)
    for contact in range(n_points):
        renderer.touch(contact, "surface")
    velocity = np.zeros((n_points, n, 2))
    velocity[..., 0] = points.speed[:, np.newaxis]
    force = np.repeat(points.force[:, np.newaxis], n, axis=1)
    return renderer.process(velocity, force)[:, round(MEASUREMENT.settle_s * device.rate_hz) :]


def measure_scene(scene: PlannedScene, definition: SceneDefinition) -> dict[str, Any]:
    """Measure time per sample and memory of a planned scene for the number of contacts in the budget.

    Each contact moves from surface to surface, which includes crossfades. Speed and force cover the motion
    range of the definition. Each call renders one sample.

    Parameters
    ----------
    scene : PlannedScene
        Scene to measure.
    definition : SceneDefinition
        Budget and motion range.

    Returns
    -------
    dict
        - "within_budget": whether 99.9 % of the samples and the memory are within the budget;
        - "budget": the budget;
        - "microseconds": `time_quantiles` of the minimum over `MeasurementSettings.n_runs` runs;
        - "microseconds_single_run": `time_quantiles` of the last run;
        - "bytes": memory of models and state;
        - "microseconds_per_surface": surface -> median time of one contact.
    """
    budget, names = definition.budget, list(scene.model_indices)
    motion = definition.motion.speeds_mm_s, definition.motion.forces_n
    renderer, single = SceneRenderer(scene, n_contacts=budget.contacts), SceneRenderer(scene, n_contacts=1)
    with garbage_collection_off():
        runs = np.stack(
            [time_steps(renderer, names, *motion, MEASUREMENT.n_samples) for _ in range(MEASUREMENT.n_runs)]
        )
        surface_runs = {
            name: np.min(
                [time_steps(single, [name], *motion, MEASUREMENT.n_surface_samples) for _ in range(3)], axis=0
            )
            for name in names
        }
    fastest, n_bytes = time_quantiles(runs.min(axis=0)), renderer.n_bytes
    return {
        "within_budget": fastest["p999"] <= budget.microseconds and n_bytes <= budget.bytes,
        "budget": budget.model_dump(),
        "microseconds": fastest,
        "microseconds_single_run": time_quantiles(runs[-1]),
        "bytes": n_bytes,
        "microseconds_per_surface": {name: time_quantiles(run)["p50"] for name, run in surface_runs.items()},
    }


def time_quantiles(nanoseconds: Samples) -> dict[str, float]:
    """Return the quantiles p50, p99 and p999 and the maximum ("worst") of times, in microseconds."""
    quantiles = np.quantile(np.asarray(nanoseconds) / 1000, [0.5, 0.99, 0.999, 1.0])
    return dict(zip(("p50", "p99", "p999", "worst"), quantiles.tolist(), strict=True))


def time_steps(
    renderer: SceneRenderer,
    surfaces: Sequence[str],
    speeds: tuple[float, float],
    forces: tuple[float, float],
    n_samples: int,
    *,
    real_time: bool = False,
) -> Samples:
    """Measure the time of each sample of all contacts, one call per sample, over a fixed path.

    Call this function inside `garbage_collection_off`, as in a haptic loop.

    Parameters
    ----------
    renderer : SceneRenderer
        Renderer to measure; it is reset first.
    surfaces : sequence of str
        Surfaces that the contacts touch one after another.
    speeds, forces : (float, float)
        Range of speed (mm/s) and force (N).
    n_samples : int
        Number of samples.
    real_time : bool
        Whether to wait for the next sampling period before each sample (default False).

    Returns
    -------
    ndarray of shape (n_samples,)
        Time of each sample in ns.
    """
    contacts, elapsed = range(renderer.n_contacts), np.empty(n_samples)
    n_per_surface = max(1, n_samples // max(len(surfaces), 8))
    speed, force = (
        low + (high - low) * (0.5 - 0.5 * np.cos(n * np.linspace(0, 2 * np.pi, n_samples)))
        for n, (low, high) in ((7, speeds), (5, forces))
    )
    motion = renderer.motion
    clock, step = time.perf_counter_ns, renderer.step_all
    renderer.reset()
    begin, period = clock(), 1e9 / renderer.fs
    for t in range(n_samples):
        if t % n_per_surface == 0:
            for contact in contacts:
                renderer.touch(contact, surfaces[(t // n_per_surface + contact) % len(surfaces)])
        motion[:, 0], motion[:, 2] = speed[t], force[t]
        if real_time:
            time.sleep(max(0.0, (begin + t * period - clock()) / 1e9))
        start = clock()
        step()
        elapsed[t] = clock() - start
    return elapsed


@contextmanager
def garbage_collection_off() -> Iterator[None]:
    """Disable garbage collection, and exclude existing objects from later collections."""
    was_enabled = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if was_enabled:
            gc.enable()


@dataclass(frozen=True, eq=False)
class RenderedPath:
    """Vibration along a path, and the time per sample.

    Attributes
    ----------
    samples : ndarray of shape (n,)
        Vibration in the unit of the scene.
    microseconds : dict
        `time_quantiles` of the samples.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.haptics.scene import RenderedPath
    >>> rendered = RenderedPath(np.zeros(1000), {"p50": 2.0, "p99": 3.0, "p999": 5.0, "worst": 40.0})
    >>> rendered.samples.size
    1000
    """

    samples: Samples
    microseconds: dict[str, float]

    def summary_lines(self, scene: PlannedScene) -> list[str]:
        """Return two lines: time per sample, and peak relative to the limit of the device."""
        t = self.microseconds
        seconds = self.samples.size / scene.fs
        return [
            f"{seconds:.1f} s at {scene.fs:g} Hz, one sample per call: {t['p50']:.1f} us (median), "
            f"{t['p99']:.1f} us (99 %), {t['p999']:.1f} us (99.9 %), {t['worst']:.0f} us (worst)",
            f"peak {abs(self.samples).max():.3g} {scene.unit}, limit of the device {scene.largest_output:g}",
        ]


def render_path(scene: PlannedScene, path: HandPath, *, seed: int = 0) -> RenderedPath:
    """Render one contact along a path, one sample per call.

    Parameters
    ----------
    scene : PlannedScene
        Planned scene.
    path : HandPath
        Hand path of the contact, which is resampled to the sampling rate of the scene.
    seed : int
        Seed of the noise (default 0).

    Returns
    -------
    RenderedPath
        Vibration and time per sample.

    Raises
    ------
    ValueError
        If the scene does not contain a surface of the path.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.haptics.scene import PlannedScene, default_path, render_path
    >>> from texclass.haptics.textures.grid import GridModel
    >>> model = GridModel(([40.0, 160.0], [1.0]), np.full((2, 1, 1), 0.5), [[1.0], [4.0]], 8.0)
    >>> scene = PlannedScene("desk", 1000.0, "m/s^2", (20.0, 450.0), 30.0, 1, {"oak": 0}, (model,))
    >>> render_path(scene, default_path(scene)).samples.shape
    (1999,)
    """
    velocity, force, surfaces = path.resample(scene.fs)
    for name in sorted({name for name in surfaces if name is not None}):
        scene.index_of(name)
    renderer = SceneRenderer(scene, n_contacts=1, seed=seed)
    samples, elapsed = np.empty((2, force.size))
    motion = zip(velocity[:, 0].tolist(), velocity[:, 1].tolist(), force.tolist(), surfaces, strict=True)
    previous: str | None = None
    clock = time.perf_counter_ns
    with garbage_collection_off():
        for t, (vx, vy, f, surface) in enumerate(motion):
            start = clock()
            if surface != previous:
                renderer.touch(0, surface)
                previous = surface
            samples[t] = renderer.step(0, vx, vy, f)
            elapsed[t] = clock() - start
    return RenderedPath(samples, time_quantiles(elapsed))


def default_path(scene: PlannedScene) -> HandPath:
    """Return a sweep over all surfaces of a scene, within the speed and force ranges of their models.

    Parameters
    ----------
    scene : PlannedScene
        Planned scene.

    Returns
    -------
    HandPath
        Two seconds per surface, see `sweep_path`.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.haptics.scene import PlannedScene, default_path
    >>> from texclass.haptics.textures.grid import GridModel
    >>> model = GridModel(([40.0, 160.0], [1.0]), np.full((2, 1, 1), 0.5), [[1.0], [4.0]], 8.0)
    >>> scene = PlannedScene("desk", 1000.0, "m/s^2", (20.0, 450.0), 30.0, 1, {"oak": 0}, (model,))
    >>> default_path(scene).ranges()[1]
    (1.0, 1.0)
    """
    models = [model for model in scene.models if model.kind != "silence"]
    ranges = [
        (float(np.min(nodes)), float(np.max(nodes))) if nodes else (50.0, 150.0)
        for nodes in ([v for m in models for v in m.speeds], [f for m in models for f in m.forces])
    ]
    return sweep_path(list(scene.model_indices), *ranges, fs=scene.fs)
