"""Decision whether the axes of an accelerometer are merged or kept separate."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np

from texclass.evaluation.windows import Window
from texclass.features.phase_view import Channels
from texclass.loaders.dataset import Dataset, Entry
from texclass.phases import find_phases
from texclass.recording import Recording, Samples
from texclass.signals import remove_hand_motion

AxesOption = Literal["auto", "merged", "separate"]
MIN_CONSISTENCY = 0.7
"""Consistency of the orientation from which axes are kept separate. In the study `axes`, sensors on robots
reach 0.85 to 0.93, and simulated tools in freely moving hands 0.37."""
MIN_ANISOTROPY = 0.1
"""Anisotropy below which the vibration counts as having no main direction."""
N_BLOCKS = 10
"""Number of alternating blocks of a recording."""
MAX_SURFACES, MAX_RECORDINGS = 10, 4
"""Number of surfaces, and of recordings of each, from which the consistency is computed."""


class AxesDecision(NamedTuple):
    """Channels of which features are computed, and the reason.

    Attributes
    ----------
    channels : {"combine", "each", "auto", "all"}
        Channels; see `FeatureExtractor`.
    reason : str
        Reason, for reports and model cards; empty if the recordings have one axis.
    """

    channels: Channels
    reason: str


def decide_axes(dataset: Dataset, channels: Channels, axes: AxesOption = "auto") -> AxesDecision:
    """Decide whether the axes of a dataset are merged or kept separate.

    A tool that turns in the hand vibrates along other axes in every recording, so its axes are merged
    (DFT321). A mounted sensor has a constant orientation, and merging would lose the direction of the
    vibration. Its axes are kept separate, together with those of the turn rate.

    Parameters
    ----------
    dataset : Dataset
        Labelled recordings, or windows of recordings.
    channels : {"combine", "each", "auto", "all"}
        Channels of the pipeline. With "auto", the recordings decide.
    axes : {"auto", "merged", "separate"}
        Decision of the user, which overrides the pipeline and the recordings (default "auto").

    Raises
    ------
    ValueError
        If `axes` is none of these values.

    Examples
    --------
    >>> from texclass.loaders import open_dataset
    >>> decide_axes(open_dataset("simulated6"), "auto").channels
    'auto'
    """
    if axes not in ("auto", "merged", "separate"):
        raise ValueError(f"axes must be 'auto', 'merged' or 'separate', got {axes!r}")
    if axes != "auto":
        return AxesDecision("combine" if axes == "merged" else "all", f"{axes}, as requested")
    example = next(_load_valid(dataset, dataset.entries), None) if channels == "auto" else None
    if example is None:
        return AxesDecision(channels, "")
    if example.sound is not None:
        return AxesDecision("all", "separate, because there is a sound")
    if not has_axes_of_one_sensor(example):
        return AxesDecision(channels if example.turn_rate is None else "all", "")
    return _decide_by_orientation(dataset, has_turn_rate=example.turn_rate is not None)


def _decide_by_orientation(dataset: Dataset, *, has_turn_rate: bool) -> AxesDecision:
    anisotropy, consistency = measure_orientation(dataset)
    if np.isnan(anisotropy):
        return AxesDecision("auto", "merged: fewer than two recordings show the orientation of the sensor")
    if anisotropy < MIN_ANISOTROPY:
        reason = f"the vibration has no main direction (anisotropy {anisotropy:.2f})"
        if has_turn_rate:
            return AxesDecision("all", f"separate, because there is a turn rate: {reason}")
        return AxesDecision("auto", f"merged: {reason}")
    measured = f"consistency {consistency:.2f}, limit {MIN_CONSISTENCY:g}"
    if consistency >= MIN_CONSISTENCY:
        return AxesDecision("all", f"separate: the orientation of the sensor is constant ({measured})")
    return AxesDecision("auto", f"merged: the orientation of the sensor changes ({measured})")


def has_axes_of_one_sensor(recording: Recording) -> bool:
    """Return whether a recording has two or three channels whose names end in x, y or z."""
    ends = [name.lower()[-1] for name in recording.channels]
    return 1 < len(ends) == len(set(ends)) and set(ends) <= set("xyz")


def measure_orientation(dataset: Dataset) -> tuple[float, float]:
    """Measure how directional the vibration is, and how consistent its direction is between recordings.

    D = C / tr C - I / n_axes describes the direction, where C is the covariance of the axes during movement
    without hand motion. It is computed for two halves a and b of each recording, which consist of alternating
    blocks, so that <D_a, D_b> is free of the bias that few samples cause. Pairs of recordings have the same
    surface and different operators or sessions, as far as there are such pairs.

    Parameters
    ----------
    dataset : Dataset
        Labelled recordings of at least two axes, or windows, whose whole recordings are used.

    Returns
    -------
    anisotropy : float
        Root of the mean of <D_a, D_b> within recordings: 0 if all directions are equally strong, at most 0.82
        for three axes.
    consistency : float
        Mean of <D_a, D_b> over pairs of recordings, divided by its mean within recordings: 1 for a constant
        orientation, 0 for random orientations. Both are NaN if fewer than two recordings contain movement.
    """
    by_surface = defaultdict(list)
    for entry in dict.fromkeys(e.parent if isinstance(e, Window) else e for e in dataset.entries):
        by_surface[entry.surface].append(entry)
    surfaces = _spread(sorted(by_surface), MAX_SURFACES)
    selected = [entry for surface in surfaces for entry in _spread(by_surface[surface], MAX_RECORDINGS)]
    movements = [(one, find_phases(one).movement) for one in _load_valid(dataset, selected)]
    moving = [(recording, movement) for recording, movement in movements if movement]
    if len(moving) < 2:
        return np.nan, np.nan
    D = np.array([directions_of(recording, *movement) for recording, movement in moving])
    products = np.einsum("aij,bij->ab", D[:, 0], D[:, 1])
    within = products.trace() / len(D)
    # Recordings of several operators or sessions are compared between them: one of them may hold still.
    is_pair = ~np.eye(len(D), dtype=bool)
    for name in ("surface", "operator", "session"):
        labels = np.array([str(getattr(recording, name)) for recording, _ in moving])
        is_closer = is_pair & ((labels[:, None] == labels) == (name == "surface"))
        is_pair = is_closer if is_closer.any() else is_pair
    between = products[is_pair].mean()
    return (float(np.sqrt(within)), float(between / within)) if within > 0 else (0.0, 0.0)


def directions_of(recording: Recording, start: int, stop: int) -> Samples:
    """Return D of both halves of a movement, shape (2, n_axes, n_axes); see `measure_orientation`."""
    axes = np.array([remove_hand_motion(x, recording.fs) for x in recording.acceleration[start:stop].T])
    is_first_half = np.arange(stop - start) * N_BLOCKS // (stop - start) % 2 == 0
    covariances = [np.cov(axes[:, is_first_half]), np.cov(axes[:, ~is_first_half])]
    return np.array([C / (np.trace(C) or 1.0) - np.eye(len(C)) / len(C) for C in covariances])


def _load_valid(dataset: Dataset, entries: Iterable[Entry]) -> Iterator[Recording]:
    """Load recordings without the invalid ones, which the extraction of features reports."""
    attempts = map(replace(dataset, skip_bad=True).attempt, entries)
    return (one for one in attempts if isinstance(one, Recording))


def _spread(items: Sequence[Any], n: int) -> list[Any]:
    """Return at most n items at equal distances."""
    return [items[i] for i in np.unique(np.linspace(0, len(items) - 1, n).astype(int))]
