"""Strokes there and back: where they vibrate alike, each model point counts for both ways.

A grain has no sense of direction (hairs and scales do). Whether a surface has one is asked of the recording:
if the network says of the opposite of each segment's velocity what that segment says, about as well as a
network without the segment says it of the velocity itself, the surface is taken to be symmetric. The paper
does not do this.
"""

import numpy as np

from texclass.textures.abdulali2016.network import fit_exact, predict_left_out
from texclass.textures.abdulali2016.points import ModelPoints, Normalisation

ALIKE = 1.5
"""Largest squared error of the opposite over that of the left-out velocity itself.

In our simulations 0.85 to 1.6 where the period over directions is pi, 1.8 to 6 where it is 2 pi.
"""


def mirrored(points: ModelPoints, normalisation: Normalisation) -> ModelPoints:
    """Return the points at the opposite velocities (inputs v_x, v_y, f_n)."""
    raw = points.u * normalisation.deviation + normalisation.mean
    u = normalisation.apply(raw * [-1.0, -1.0, 1.0])
    return ModelPoints(u, points.lsf, points.loudness, points.weight, points.kind)


def is_symmetric(points: ModelPoints, normalisation: Normalisation) -> bool:
    """Return whether the spectra of segments (inputs v_x, v_y, f_n) are those of the opposite velocity."""
    back = fit_exact(points.u, points.lsf).at(mirrored(points, normalisation).u) - points.lsf
    itself = predict_left_out(points.u, points.lsf) - points.lsf
    weight = points.weight[:, np.newaxis]
    return bool(np.sum(weight * back**2) <= ALIKE * np.sum(weight * itself**2))
