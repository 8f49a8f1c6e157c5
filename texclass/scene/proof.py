"""A model is proved as it will be felt: rendered sample by sample at speeds and forces it has not seen."""

import numpy as np

from texclass.recording import Samples
from texclass.scene.definition import Device
from texclass.scene.judge import Judge, Verdict
from texclass.scene.models import GridModel
from texclass.scene.observed import Points
from texclass.scene.planned import PlannedScene
from texclass.scene.renderer import SceneRenderer

SECONDS, SETTLE_S = 6.0, 0.3
"""What is rendered at each point, and what is cut off before."""


def prove(model: GridModel, points: Points, judge: Judge, *, seed: int = 0) -> Verdict:
    """Return what the rendered model scores against held-out points."""
    rendered = np.stack([judge.spectrum(x) for x in render_at(model, points, judge.device, seed=seed)])
    return judge.verdict(points.spectra, rendered)


def render_at(model: GridModel, points: Points, device: Device, *, seed: int = 0) -> Samples:
    """Return what a model sounds like at the speed and force of each point, shape (n_points, n)."""
    n, n_points = round((SECONDS + SETTLE_S) * device.rate_hz), len(points)
    alone = PlannedScene(
        "proof",
        device.rate_hz,
        device.unit,
        device.band_hz,
        device.largest_output,
        n_points,
        {"it": 0},
        (model,),
    )
    renderer = SceneRenderer(alone, seed=seed)
    for contact in range(n_points):
        renderer.touch(contact, "it")
    velocity = np.zeros((n_points, n, 2))
    velocity[..., 0] = points.speed[:, np.newaxis]
    force = np.repeat(points.force[:, np.newaxis], n, axis=1)
    return renderer.process(velocity, force)[:, round(SETTLE_S * device.rate_hz) :]
