"""What a planned model sounds like, without rendering it."""

import numpy as np

from texclass.recording import Samples
from texclass.scene.judge import Judge
from texclass.scene.lattices import unit_spectra
from texclass.scene.models import GridModel, mixed_power, weights
from texclass.scene.observed import Points
from texclass.scene.sinusoids import line_spectra


def model_spectra(model: GridModel, points: Points, judge: Judge) -> Samples:
    """Return the power densities of a model at speeds and forces, shape (n_points, n_bins), unit^2/Hz."""
    if model.kind == "silence":
        return np.zeros_like(points.spectra)
    found = line_spectra(model, points, judge) if model.n_lines else np.zeros_like(points.spectra)
    if not model.order:
        return found
    share = weights(model.speeds, model.forces, points.speed, points.force)
    rows = share @ model.rows.reshape(-1, model.order + model.n_lines)
    tonal = (rows[:, model.order :] ** 2).sum(axis=1) / 2
    power = mixed_power(share, model.power.ravel()) * np.maximum(1 - tonal, 0.0)
    k = rows[:, : model.order]
    noise = [p * unit_spectra(row, judge)[-1] for row, p in zip(k, power, strict=True)]
    return np.asarray(found + np.stack(noise))
