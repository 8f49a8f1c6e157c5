"""What is kept of each recording while a feature table is made.

Processes that compute features load this module, so that neither pandas nor scikit-learn is loaded there.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from pydantic import BaseModel, FiniteFloat, TypeAdapter

from texclass.atomic_write import write_atomic
from texclass.features.plan import Plan
from texclass.loaders.dataset import Entry
from texclass.recording import Recording, RecordingError


class Part(BaseModel):
    """What is kept of a recording (or window) until all are done: its values, and why some are undefined.

    `phases` are the number of taps, and seconds of movement and of the recording.
    """

    features: list[float]
    axes: list[str]
    phases: tuple[int, float, float]
    reasons: list[tuple[str, str]]
    flags: list[str]
    ms: FiniteFloat


PARTS = TypeAdapter(list[Part])


def write_part(
    load: Callable[[Entry], Recording], entries: Sequence[Entry], plan: Plan, path: Path
) -> str | None:
    """Compute one recording, or its windows, into a file; return why not if it is bad."""
    rows = []
    try:
        for recording in map(load, entries):
            row = plan.compute(recording)
            values: list[float] = row.values.tolist()
            start, stop = row.phases.movement or (0, 0)
            phases = len(row.phases.taps), (stop - start) / recording.fs, recording.duration_s
            part = {"features": values, "axes": recording.channels, "phases": phases, "ms": row.ms}
            rows.append(part | {"reasons": row.reasons, "flags": recording.flags})
    except RecordingError as error:
        return str(error)
    write_atomic(path, json.dumps(rows).encode())
    return None


def read_part(path: Path, n_columns: int) -> list[Part]:
    """Read what is kept of one finished recording: one `Part`, or those of its windows.

    Raises
    ------
    ValueError
        If the file is damaged; the message names it.
    """
    try:
        rows = PARTS.validate_json(path.read_bytes())
        if any(len(row.features) != n_columns for row in rows):
            raise ValueError(f"Expected {n_columns} values per row")
    except ValueError as error:
        raise ValueError(f"{path}: is damaged; delete it, and it is computed again") from error
    return rows
