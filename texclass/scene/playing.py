"""A path played over a planned scene, one sample a call, as a haptic loop would."""

import time
from dataclasses import dataclass

import numpy as np

from texclass.recording import Samples
from texclass.scene.budget import Timing, without_garbage_collection
from texclass.scene.paths import HandPath, sweep
from texclass.scene.planned import PlannedScene
from texclass.scene.renderer import SceneRenderer


@dataclass(frozen=True, eq=False)
class Played:
    """What was rendered, and how long a sample took.

    Attributes
    ----------
    samples : ndarray of shape (n,)
        In the scene's unit.
    timing : Timing
        Microseconds per sample, on the clock.
    """

    samples: Samples
    timing: Timing


def play_path(scene: PlannedScene, path: HandPath, *, seed: int = 0) -> Played:
    """Render one contact along a path.

    Raises
    ------
    ValueError
        If the path meets a surface that the scene does not have.
    """
    velocity, force, surfaces = path.at_rate(scene.fs)
    if unknown := sorted({name for name in surfaces if name is not None} - set(scene.assigned)):
        raise ValueError(f"surface is {unknown[0]!r}; the rule is one of {', '.join(scene.assigned)}")
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
    return Played(samples, Timing.of(took))


def sweep_of(scene: PlannedScene) -> HandPath:
    """Return the default path over all surfaces, within the speeds and forces of their models."""
    models = [model for model in scene.models if model.kind != "silence"]
    ends = [
        (min(float(axis[0]) for axis in axes), max(float(axis[-1]) for axis in axes))
        if axes
        else (50.0, 150.0)
        for axes in ([m.speeds for m in models], [m.forces for m in models])
    ]
    return sweep(list(scene.assigned), *ends, fs=scene.fs)
