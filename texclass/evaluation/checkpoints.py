"""Checkpoints of a feature table: one small file per finished recording.

Processes that compute features import this module, which therefore imports neither pandas nor scikit-learn.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from pydantic import BaseModel, FiniteFloat, TypeAdapter

from texclass.atomic_write import write_atomic
from texclass.features.plan import Plan
from texclass.loaders.dataset import Entry
from texclass.recording import Recording, RecordingError


class CheckpointRow(BaseModel):
    """Values of one recording (or window), stored until the feature table is complete.

    Attributes
    ----------
    features : list of float
        Feature values in the order of the columns.
    axes : list of str
        Channels of the recording.
    rates : dict of str to float
        Sampling rates in Hz of the signals that have another rate than the acceleration.
    phases : tuple of (int, float, float)
        Number of taps, duration of the movement in s, and duration of the recording in s.
    reasons : list of (str, str)
        Undefined features, each with the reason why it is undefined.
    flags : list of str
        Notices of the loader.
    ms : float
        Computing time in ms.
    """

    features: list[float]
    axes: list[str]
    rates: dict[str, float]
    phases: tuple[int, float, float]
    reasons: list[tuple[str, str]]
    flags: list[str]
    ms: FiniteFloat


CHECKPOINT = TypeAdapter(list[CheckpointRow])
"""Validator of the content of a checkpoint file."""


def write_checkpoint(
    load: Callable[[Entry], Recording], entries: Sequence[Entry], plan: Plan, path: Path
) -> str | None:
    """Compute the features of a recording, or of its windows, and write them to a checkpoint.

    Parameters
    ----------
    load : callable
        Function that loads an entry.
    entries : sequence of Entry
        The recording, or its windows.
    plan : Plan
        Features to compute.
    path : Path
        Checkpoint file.

    Returns
    -------
    str or None
        Reason why the recording cannot be used, or None if the checkpoint was written.
    """
    rows = []
    try:
        for recording in map(load, entries):
            row = plan.compute(recording)
            values: list[float] = row.values.tolist()
            start, stop = row.phases.movement or (0, 0)
            phases = len(row.phases.taps), (stop - start) / recording.fs, recording.duration_s
            rates = plan.other_rates(recording)
            facts = {"features": values, "axes": recording.channels, "phases": phases, "ms": row.ms}
            rows.append(facts | {"rates": rates, "reasons": row.reasons, "flags": recording.flags})
    except RecordingError as error:
        return str(error)
    write_atomic(path, json.dumps(rows).encode())
    return None


def read_checkpoint(path: Path, n_columns: int) -> list[CheckpointRow]:
    """Read the checkpoint of a recording. Return one row for the recording, or one row per window.

    Raises
    ------
    ValueError
        If the file is damaged.
    """
    try:
        rows = CHECKPOINT.validate_json(path.read_bytes())
        if any(len(row.features) != n_columns for row in rows):
            raise ValueError(f"every row must contain {n_columns} values")
    except ValueError as error:
        raise ValueError(f"{path} is damaged. Delete it and run the command again") from error
    return rows
