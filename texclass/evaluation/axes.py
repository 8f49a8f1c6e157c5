"""Decision whether the axes of an accelerometer are merged or kept separate."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from texclass.evaluation.windows import parent_id
from texclass.features.phase_view import Channels
from texclass.loaders.dataset import Dataset, Entry
from texclass.phases import find_phases
from texclass.recording import Recording, RecordingError, Samples
from texclass.signals import remove_hand_motion

AxesOption = Literal["auto", "merged", "separate"]
MIN_CONSISTENCY = 0.7
"""Consistency of the orientation from which axes are kept separate. Sensors on robots reach 0.84 to 0.89,
simulated tools in freely moving hands 0.37 to 0.58; see benchmarks/axes_study.py."""
MIN_ANISOTROPY = 0.1
"""Anisotropy below which the direction cannot be measured. Isotropic noise of 400 samples has 0.06."""
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
    recordings = [] if channels != "auto" else _load(dataset, dataset.entries[:1])
    if not recordings or not has_axes_of_one_sensor(recordings[0]):
        has_turn_rate = bool(recordings) and recordings[0].turn_rate is not None
        return AxesDecision("all" if has_turn_rate else channels, "")
    anisotropy, consistency = measure_orientation(dataset)
    if anisotropy < MIN_ANISOTROPY:
        choice: Channels = "auto" if recordings[0].turn_rate is None else "all"
        words = "merged" if choice == "auto" else "separate, because there is a turn rate"
        return AxesDecision(
            choice, f"{words}: the vibration has no main direction (anisotropy {anisotropy:.2f})"
        )
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
    without hand motion. If each surface has one recording, all pairs of recordings are compared.

    Parameters
    ----------
    dataset : Dataset
        Labelled recordings, or windows of recordings, of at least two axes. Of each recording, one window is
        used.

    Returns
    -------
    anisotropy : float
        Root of the mean of <D_i, D_i>: 0 if all directions are equally strong, at most 0.82 for three axes.
    consistency : float
        Mean of <D_i, D_j> over pairs of recordings of one surface, divided by the mean of <D_i, D_i>: 1 for a
        constant orientation, 0 for random orientations.
    """
    by_surface = defaultdict(list)
    for entry in {parent_id(entry): entry for entry in dataset.entries}.values():
        by_surface[entry.surface].append(entry)
    surfaces = _spread(sorted(by_surface), MAX_SURFACES)
    selected = [_spread(by_surface[surface], MAX_RECORDINGS) for surface in surfaces]
    groups = [[direction_of(recording) for recording in _load(dataset, entries)] for entries in selected]
    if not any(len(group) > 1 for group in groups):
        groups = [[direction for group in groups for direction in group]]
    products = [np.einsum("aij,bij->ab", group, group) for group in groups if len(group) > 1]
    if not products:
        return 0.0, 0.0
    own = np.mean([p.trace() / len(p) for p in products])
    between = np.mean([(p.sum() - p.trace()) / (len(p) * (len(p) - 1)) for p in products])
    return float(np.sqrt(own)), float(between / own) if own > 0 else 0.0


def direction_of(recording: Recording) -> Samples:
    """Return D = C / tr C - I / n_axes of the vibration of a recording, shape (n_axes, n_axes)."""
    start, stop = find_phases(recording).movement or (0, len(recording.acceleration))
    axes = [remove_hand_motion(x, recording.fs) for x in recording.acceleration[start:stop].T]
    C = np.cov(axes)
    return np.asarray(C / (np.trace(C) or 1.0) - np.eye(len(C)) / len(C))


def _load(dataset: Dataset, entries: Sequence[Entry]) -> list[Recording]:
    """Load recordings without the invalid ones, which the extraction of features reports."""
    recordings = []
    for entry in entries:
        try:
            recordings.append(dataset.load(entry))
        except RecordingError:
            continue
    return recordings


def _spread(items: Sequence[Any], n: int) -> list[Any]:
    """Return at most n items at equal distances."""
    return [items[i] for i in np.unique(np.linspace(0, len(items) - 1, n).astype(int))]
