"""Recordings played as if they were live."""

import numpy as np

from texclass.features.views import TURN
from texclass.recognition.model import Model
from texclass.recording import Recording


def with_turn_rate(recording: Recording, model: Model) -> Recording:
    """Return a recording whose columns are what a stream has: axes, then the turn rate if a model reads it.

    Raises
    ------
    ValueError
        If the model reads a turn rate that the recording does not have.
    """
    if not set(TURN) & set(model.plan.channels):
        return recording
    if recording.turn_rate is None:
        raise ValueError(
            f"{recording.source or recording.recording_id}: no turn rate; the rule is "
            f"{', '.join(model.plan.channels)}, as the model was trained"
        )
    axes = recording.acceleration.reshape(recording.n_samples, -1)
    return recording.with_(
        acceleration=np.column_stack([axes, recording.turn_rate]),
        turn_rate=None,
        channels=model.plan.channels,
    )
