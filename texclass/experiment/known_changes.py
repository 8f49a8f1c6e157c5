"""What another stroke does to features: a quicker one, a stronger one, a brighter one, known from simulation.

One recording of a surface says little about the next one of it. How features change when the same surface is
felt in another way is known all the same, and much the same for all surfaces.
"""

import csv
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np

from texclass.recording import Samples

FILE = Path(__file__).with_name("known_changes.csv")
"""Columns of the set `surfaces`, and their changes; made by tests/benchmarks/known_changes.py."""


def changes_of(columns: Sequence[str]) -> Samples:
    """Return what changes columns of the set `surfaces` together, in the units of each.

    Parameters
    ----------
    columns : sequence of str
        Names, with or without a channel before and a piece behind: all channels and pieces change alike.

    Returns
    -------
    ndarray of shape (n_changes, n_columns)
        Principal changes C of features when strokes are a tenth quicker, 1.3 times as strong, or rise by
        1.5 dB an octave against what they were: C' C / n_changes is their covariance about no change. 0 for
        columns that are not known.
    """
    known = _known()
    nothing = np.zeros_like(next(iter(known.values())))
    names = [column.rpartition("/")[2].partition(".piece")[0] for column in columns]
    return np.array([known.get(name, nothing) for name in names]).T


@cache
def _known() -> dict[str, Samples]:
    with FILE.open(encoding="utf-8", newline="") as file:
        return {name: np.array(values, dtype=np.float64) for name, *values in csv.reader(file)}
