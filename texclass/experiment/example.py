"""One recording of a dataset as a result keeps it: the outline of its signal, and its phases."""

from typing import Any

import numpy as np

from texclass.recording import Recording, Samples

N_BLOCKS = 300


def example_of(recording: Recording) -> dict[str, Any]:
    """Return what a picture of a recording and its phases needs, as plain JSON values.

    Parameters
    ----------
    recording : Recording
        With its phases.

    Returns
    -------
    dict
        `recording`, `material`, `unit`, `seconds`; `low` and `high`, the outline of the signal in equal
        parts; `taps`, of each start, impact and end in s; `movement`, its start and end in s, or None.
    """
    phases, fs = recording.phases, recording.fs
    assert phases is not None
    low, high = outline(main_direction(recording), N_BLOCKS)
    return {
        "recording": recording.recording_id,
        "material": recording.material,
        "unit": recording.unit,
        "seconds": recording.duration_s,
        "low": [float(f"{x:.4g}") for x in low],
        "high": [float(f"{x:.4g}") for x in high],
        "taps": [[tap.start / fs, tap.impact / fs, tap.end / fs] for tap in phases.taps],
        "movement": phases.movement and [sample / fs for sample in phases.movement],
    }


def outline(x: Samples, n: int) -> tuple[Samples, Samples]:
    """Return least and greatest sample of about `n` equal blocks; each touches the next."""
    size = max(1, x.size // n)
    blocks = x[: x.size // size * size].reshape(-1, size)
    low, high = blocks.min(axis=1), blocks.max(axis=1)
    low[1:], high[1:] = np.minimum(low[1:], blocks[:-1, -1]), np.maximum(high[1:], blocks[:-1, -1])
    return low, high


def main_direction(recording: Recording) -> Samples:
    """Project the axes, without their means, on the direction in which they change most.

    For pictures: DFT321 mixes the phases of the axes and would blur the contact.
    """
    acceleration = recording.acceleration
    axes = acceleration.reshape(len(acceleration), -1)
    axes = axes - axes.mean(axis=0)
    if axes.shape[1] == 1:
        return np.asarray(axes[:, 0])
    lag = max(1, round(2e-3 * recording.fs))  # slow against noise, fast against gravity
    steps = axes[lag:] - axes[:-lag]
    direction = np.linalg.eigh(steps.T @ steps)[1][:, -1]
    return np.asarray(axes @ (direction * np.sign(direction[np.argmax(np.abs(direction))])))
