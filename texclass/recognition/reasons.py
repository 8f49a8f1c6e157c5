"""What a user should know of an answer: a recording that is not like those the model was trained on."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from texclass.recognition.manifest import Manifest
from texclass.recording import Phases, Recording, Samples

RATE_TOLERANCE = 0.01
"""Relative difference of sampling rates that clocks of sensors may have."""
SHORTER = 0.5
"""A movement below this share of the shortest one trained on is too short."""
MARGIN = 0.5
"""A value this many widths of the training range outside of it is far out."""
MOST_NAMES = 3
"""Features that are named; the others are counted."""


@dataclass(frozen=True, eq=False)
class Ranges:
    """Between which values each column lay in training, and its median; NaN for a column without values."""

    low: Samples
    median: Samples
    high: Samples

    @classmethod
    def of(cls, X: Samples) -> "Ranges":
        """Return the ranges of the columns of X (n, n_columns), NaN where undefined."""
        defined = np.where(np.isnan(X).all(axis=0), 0.0, X)
        low, median, high = np.nanquantile(defined, [0, 0.5, 1], axis=0)
        empty = np.isnan(X).all(axis=0)
        return cls(*(np.where(empty, np.nan, edge) for edge in (low, median, high)))

    def far(self, values: Samples) -> Samples:
        """Return how far values lie outside, in widths of the range, shape (n_columns,); 0 inside."""
        beyond = np.fmax(np.fmax(self.low - values, values - self.high), 0.0)
        width = np.maximum(self.high - self.low, 1e-9 * np.maximum(np.abs(self.high), np.abs(self.low)))
        with np.errstate(divide="ignore", invalid="ignore"):
            far = np.where(beyond > 0, beyond / width, 0.0)
        return np.asarray(np.nan_to_num(far))


def unlike_in_kind(recording: Recording, manifest: Manifest) -> tuple[str, ...]:
    """Return why a recording cannot be judged at all: another sampling rate, another unit."""
    found = []
    if abs(recording.fs / manifest.fs - 1) > RATE_TOLERANCE:
        found.append(f"wrong rate: {recording.fs:g} Hz, trained at {manifest.fs:g} Hz")
    if recording.unit != manifest.unit:
        found.append(f"wrong unit: {recording.unit}, trained with {manifest.unit}")
    return tuple(found)


def too_short(recording: Recording, phases: Phases, manifest: Manifest) -> tuple[str, ...]:
    """Return whether less was felt than in training."""
    least = manifest.shortest_s
    if "movement" not in manifest.phases or least is None:
        return ()
    start, stop = phases.movement or (0, 0)
    felt = (stop - start) / recording.fs
    short = f"too short: {felt:.3g} s of movement, trained on {least:.3g} s and more"
    return (short,) if felt < SHORTER * least else ()


def undefined(reasons: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """Return which features have no value, by reason."""
    by_reason: dict[str, list[str]] = {}
    for feature, reason in reasons:
        by_reason.setdefault(reason, []).append(feature)
    return tuple(f"undefined: {_named(names)} ({reason})" for reason, names in by_reason.items())


def outside(values: Samples, columns: Sequence[str], ranges: Ranges) -> tuple[str, ...]:
    """Return which features have values far from all that were seen in training, the farthest first."""
    if not ((values < ranges.low) | (values > ranges.high)).any():
        return ()
    far = ranges.far(values)
    order = [int(i) for i in np.argsort(-far, kind="stable") if far[i] > MARGIN]
    if not order:
        return ()
    worst = order[0]
    trained = f"{values[worst]:.3g}, trained on {ranges.low[worst]:.3g} to {ranges.high[worst]:.3g}"
    names = _named([columns[i] for i in order])
    return (f"outside the range of training: {names} ({columns[worst]} is {trained})",)


def _named(names: Sequence[str]) -> str:
    more = len(names) - MOST_NAMES
    return ", ".join(names[:MOST_NAMES]) + (f" and {more} more" if more > 0 else "")
