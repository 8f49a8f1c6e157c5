"""Rows of features on which two programs are compared: ordinary, extreme, undefined, and near boundaries."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from texclass.recognition.reasons import Ranges
from texclass.recording import Samples

N_DRAWN = 100
N_KNOWN = 150
"""At most; as many again on the way from them to others."""
N_CORNERS = 64
N_PAIRS = 64
N_HALVINGS = 30
MARGINS = (0.0, 1e-9, 1e-6, 1e-3)
"""How far from a boundary rows lie, in parts of the way between two rows with different answers."""
SHARE_UNDEFINED = 0.2

Name = Callable[[Samples], NDArray[np.intp]]
"""Rows (n, n_columns) -> a number for each answer (n,)."""


@dataclass(frozen=True, eq=False)
class CheckRows:
    """Rows, and what they are for.

    Attributes
    ----------
    X : ndarray of shape (n, n_columns)
        NaN where undefined.
    kind : ndarray of str, shape (n,)
        "ordinary", "extreme", "undefined" or "boundary".
    """

    X: Samples
    kind: NDArray[np.str_]


def check_rows(ranges: Ranges, known: Samples, name: Name, seed: int) -> CheckRows:
    """Return rows of every kind.

    Parameters
    ----------
    ranges : Ranges
        What values the columns had in training; a column without any stays undefined.
    known : ndarray of shape (n, n_columns)
        Rows like those of training; may be none.
    name : callable
        A number for each answer; boundaries are where it changes.
    seed : int
        Of everything random.
    """
    rng = np.random.default_rng(seed)
    anywhere = drawn(ranges, rng)
    ordinary = np.concatenate([anywhere, like(known, anywhere, rng)])
    rows = {
        "ordinary": ordinary,
        "extreme": extreme(ranges, rng),
        "undefined": with_gaps(ordinary, rng),
        "boundary": near_boundaries(ordinary, name, rng),
    }
    kind = np.repeat(list(rows), [len(X) for X in rows.values()])
    return CheckRows(np.concatenate(list(rows.values())), kind)


def drawn(ranges: Ranges, rng: np.random.Generator) -> Samples:
    """Return rows between the ends of the ranges; how far each strays from the median is drawn as well."""
    u = rng.uniform(-1, 1, (N_DRAWN, len(ranges.median))) * rng.uniform(0, 1, (N_DRAWN, 1))
    reach = np.where(u < 0, ranges.median - ranges.low, ranges.high - ranges.median)
    return np.asarray(ranges.median + u * reach)


def like(known: Samples, others: Samples, rng: np.random.Generator) -> Samples:
    """Return some of the known rows, and rows on the way from them to each other and to others."""
    if not len(known):
        return known
    every = np.concatenate([known, others])
    A, B = (rows[rng.integers(len(rows), size=N_KNOWN)] for rows in (known, every))
    some = known[rng.permutation(len(known))[:N_KNOWN]]
    return np.concatenate([some, _mixed(A, B, rng.uniform(0, 1, N_KNOWN) ** 2)])


def extreme(ranges: Ranges, rng: np.random.Generator) -> Samples:
    """Return the lowest, the median, the highest, corners of the ranges, and rows as far outside again."""
    corner = rng.random((N_CORNERS, len(ranges.median))) < 0.5
    corners = np.where(corner, ranges.low, ranges.high)
    outside = corners + (corners - ranges.median)
    return np.concatenate([[ranges.low, ranges.median, ranges.high], corners, outside])


def with_gaps(rows: Samples, rng: np.random.Generator) -> Samples:
    """Return the rows without a fifth of their values, or without one, and a row without any."""
    n, n_columns = rows.shape
    gaps = rng.random((n, n_columns)) < SHARE_UNDEFINED
    gaps[::2] = np.arange(n_columns) == rng.integers(n_columns, size=(len(gaps[::2]), 1))
    return np.concatenate([np.where(gaps, np.nan, rows), np.full((1, n_columns), np.nan)])


def near_boundaries(rows: Samples, name: Name, rng: np.random.Generator) -> Samples:
    """Return mixtures of two rows with different answers, close to where the answer changes, if it does."""
    names = name(rows)
    i, j = rng.integers(len(rows), size=(2, 50 * N_PAIRS))
    pairs = np.flatnonzero(names[i] != names[j])[:N_PAIRS]
    A, B, named = rows[i[pairs]], rows[j[pairs]], names[i[pairs]]
    low, high = np.zeros(len(pairs)), np.ones(len(pairs))
    for _ in range(N_HALVINGS if len(pairs) else 0):
        middle = (low + high) / 2
        same = name(_mixed(A, B, middle)) == named
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.concatenate([_mixed(A, B, t) for m in MARGINS for t in (low - m, high + m)])


def _mixed(A: Samples, B: Samples, t: Samples) -> Samples:
    return np.asarray(A + t[:, None] * (B - A))
