"""Accuracy against what costs: seconds of touch, training recordings, rate, bits, order of the model.

A cheaper sensor is what `degraded` makes of a dataset: a lower sampling rate, fewer bits.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from typing import Any

import numpy as np
import pandas as pd
from scipy import fft
from sklearn.neighbors import NearestCentroid

from texclass import vibration
from texclass.evaluation.feature_table import FeatureTable, cached_table
from texclass.evaluation.folds import evaluate
from texclass.evaluation.protocols import Protocol, repeated
from texclass.evaluation.splits import Split
from texclass.evaluation.windows import cut_windows
from texclass.evaluation.workers import Progress, each
from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import Channels, views_of
from texclass.features.sets import FeatureSet
from texclass.loaders.dataset import Dataset, Entry
from texclass.recording import AUXILIARY_UNITS, Phases, Recording, RecordingError, Samples, Tap
from texclass.tradeoff.front import Facts, Labelled, Labels, accuracy_of, discriminant, labelled, preparation
from texclass.validation import check_positive

LINEAR = "linear discriminants"


@dataclass(frozen=True)
class CurveSettings:
    """Where the curves of a trade-off are measured.

    Attributes
    ----------
    seconds
        Of touch.
    n_trained
        Training recordings of each surface.
    rates_hz, bits
        Of cheaper sensors.
    orders
        Of the movement model.
    n_recordings
        Recordings, at most, for rate, bits and order: each is extracted anew.
    """

    seconds: tuple[float, ...] = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0)
    n_trained: tuple[int, ...] = (1, 2, 3, 5, 8)
    rates_hz: tuple[float, ...] = (500.0, 1000.0, 2000.0, 5000.0)
    bits: tuple[int, ...] = (4, 6, 8, 12)
    orders: tuple[int, ...] = (2, 4, 8, 16, 32, 64)
    n_recordings: int = 150


CURVES = CurveSettings()


@dataclass(frozen=True, eq=False)
class Conditions:
    """Under which conditions everything about a dataset is measured.

    Attributes
    ----------
    dataset
        Recordings.
    features, channels
        What is computed.
    protocol, n_folds, n_repeats, seed
        How recordings are split.
    n_jobs
        Processes.
    progress
        Called with (done, total, what), or None.
    """

    dataset: Dataset
    features: FeatureSet
    channels: Channels
    protocol: Protocol
    n_folds: int
    n_repeats: int
    seed: int
    n_jobs: int = 1
    progress: Progress | None = None

    def table(self, dataset: Dataset) -> FeatureTable:
        """Return the features of a dataset, bad recordings left out."""
        work = {"n_jobs": self.n_jobs, "progress": self.progress}
        return cached_table(dataset, self.features, channels=self.channels, skip_bad=True, **work)

    def splits(self, frame: pd.DataFrame) -> tuple[Split, ...]:
        """Return all folds of all repeats, fewer folds where a surface has few recordings."""
        n_folds = min(self.n_folds, int(frame["surface"].value_counts().min()))
        n_repeats = self.n_repeats if self.protocol.is_random else 1
        drawn = repeated(self.protocol, frame, n_folds, n_repeats, self.seed)
        return tuple(split for repeat in drawn for split in repeat)

    def data(self, table: FeatureTable) -> Labelled:
        """Return the columns that some recording has, with labels and groups."""
        return labelled(table.of(table.defined), table.frame, self.protocol)

    def accuracy(self, table: FeatureTable) -> Facts:
        """Return the accuracy of the trade's classifier on all columns of a table."""
        return cross_validated(self.data(table), self.splits(table.frame), discriminant())


def cross_validated(
    data: Labelled, splits: Sequence[Split], classifier: Any, used: Sequence[Split] | None = None
) -> Facts:
    """Cross-validate a classifier on all columns; `used` are the splits with fewer training recordings."""
    found = evaluate(data.X, data.y, used or splits, preparation(), classifier)
    return accuracy_of(np.concatenate(found.hits), splits, data)


def training_curves(conditions: Conditions, table: FeatureTable) -> list[Facts]:
    """Accuracy against the number of training recordings of each surface, by two classifiers."""
    data, splits = conditions.data(table), conditions.splits(table.frame)
    most = min(int(np.unique(data.y[train], return_counts=True)[1].min()) for train, _ in splits)
    numbers = sorted({n for n in CURVES.n_trained if n < most} | {most})
    curves = []
    for series, classifier, used in (
        # Discriminants need a spread within classes, which one recording of each does not have.
        (LINEAR, discriminant(), [n for n in numbers if n > 1]),
        ("nearest class mean", NearestCentroid(), numbers),
    ):
        points = []
        for n in used:
            accuracy = cross_validated(
                data, splits, classifier, [_thinned(data.y, n, conditions.seed, split) for split in splits]
            )
            points.append((float(n), accuracy))
        if points:
            curves.append(_curve("training recordings per surface", "", points, series))
    return curves


def _thinned(y: Labels, n: int, seed: int, split: Split) -> Split:
    """Return a split with `n` training recordings of each class, drawn at random."""
    order = np.random.default_rng([seed, n, int(split[1][0])]).permutation(split[0])
    rank = pd.Series(y[order]).groupby(y[order]).cumcount().to_numpy()
    return np.sort(order[rank < n]), split[1]


def touch_curve(conditions: Conditions, whole: FeatureTable) -> Facts | None:
    """Accuracy against seconds of touch: the first window of every recording's movement, then all of it."""
    points: list[tuple[float, Facts]] = []
    for seconds in CURVES.seconds:
        try:
            felt = cut_windows(conditions.dataset, seconds, per_recording=1, n_jobs=conditions.n_jobs)
            found = conditions.table(felt)
            if len(found.frame) < 0.9 * len(whole.frame):  # the others are too short
                break
            points.append((seconds, conditions.accuracy(found)))
        except (RecordingError, ValueError):
            break
    if not points:
        return None
    longest = 2 * points[-1][0]
    points.append((longest, conditions.accuracy(whole)))
    note = "the first stretch of each movement; whole: with taps, if any"
    curve = _curve("touch", "s", points, LINEAR, note)
    return {**curve, "labels": [*curve["labels"][:-1], "whole"]}


def sensor_curves(conditions: Conditions) -> list[Facts]:
    """Accuracy against sampling rate and against bit depth, trained and tested alike."""
    dataset, note = _fewer(conditions.dataset)
    few = replace(conditions, dataset=dataset)
    own = few.dataset[0].fs
    scale = full_scale_of(few.dataset)
    rates = [fs for fs in CURVES.rates_hz if fs <= own / 1.5]
    at_rate = {fs: degraded(few.dataset, fs=fs) for fs in rates} | {own: few.dataset}
    at_bits = {float(bits): degraded(few.dataset, bits=bits, full_scale=scale) for bits in CURVES.bits}
    curves = []
    for name, unit, variants in (("sampling rate", "Hz", at_rate), ("bit depth", "bits", at_bits)):
        points = [(x, few.accuracy(few.table(varied))) for x, varied in variants.items()]
        curves.append(_curve(name, unit, points, LINEAR, note))
    return curves


def order_curve(conditions: Conditions) -> Facts | None:
    """Accuracy of a movement model alone, against its order: Burg's reflection coefficients and the gain.

    A model of order p is the first p coefficients of one of a higher order, so each movement is fitted once.
    """
    dataset, note = _fewer(conditions.dataset)
    found = list(each([partial(_model, dataset.load, e) for e in dataset.entries], n_jobs=conditions.n_jobs))
    kept = [i for i, row in enumerate(found) if row is not None]
    if len(kept) < 0.9 * len(found):
        return None
    models = np.array([found[i] for i in kept])
    frame = pd.DataFrame([vars(dataset.entries[i]) for i in kept])
    splits, data = conditions.splits(frame), labelled(models, frame, conditions.protocol)
    points = []
    for p in CURVES.orders:
        up_to = data._replace(X=models[:, : p + 1])
        points.append((float(p), cross_validated(up_to, splits, discriminant())))
    return _curve("order of the movement model", "", points, "AR coefficients alone", note)


def _model(load: Callable[[Entry], Any], entry: Entry) -> Samples | None:
    """Return log gain and arctanh of the reflection coefficients of a movement, or None without one."""
    try:
        movement = views_of(load(entry))[""].vibration
    except (RecordingError, UndefinedFeatureError):
        return None
    model = vibration.fit(movement.samples, CURVES.orders[-1])
    log_gain = np.log(np.maximum(model.gain, np.finfo(np.float64).tiny))
    return np.concatenate([[log_gain], np.arctanh(model.reflection)])


def _fewer(dataset: Dataset) -> tuple[Dataset, str]:
    """Return few recordings, as many of each surface as there is room for, at least four."""
    per_surface = max(4, CURVES.n_recordings // max(len(dataset.surfaces), 1))
    surfaces = pd.Series([e.surface for e in dataset.entries])
    rank = surfaces.groupby(surfaces).cumcount()
    kept = tuple(e for e, r in zip(dataset.entries, rank, strict=True) if r < per_surface)
    note = "" if len(kept) == len(dataset) else f"from {len(kept)} of the recordings"
    return replace(dataset, entries=kept), note


def _curve(name: str, unit: str, points: Sequence[tuple[float, Facts]], series: str, note: str = "") -> Facts:
    """Return a curve of (value, accuracy); `series` names it where several share a panel."""
    x, accuracy = map(list, zip(*points, strict=True))
    facts = {"name": name, "unit": unit, "series": series, "note": note}
    return {**facts, "x": x, "accuracy": accuracy, "labels": [f"{value:g}" for value in x]}


def degraded(
    dataset: Dataset, *, fs: float | None = None, bits: int | None = None, full_scale: float = 1.0
) -> Dataset:
    """Return a dataset as a cheaper sensor would have recorded it.

    Parameters
    ----------
    dataset : Dataset
        As it was recorded.
    fs : float, optional
        Sampling rate in Hz; recordings that have a lower one keep it.
    bits : int, optional
        Of the acceleration's converter.
    full_scale : float
        Largest magnitude that the converter holds; what is beyond is clipped.

    Raises
    ------
    ValueError
        If the rate, the bits or the full scale is not above 0.
    """
    check_positive(fs=fs, bits=bits, full_scale=full_scale)
    how = f"{dataset.input_hash} fs {fs} bits {bits} of {full_scale}"
    return replace(
        dataset,
        load=partial(_degraded, dataset.load, fs, bits, full_scale),
        input_hash=hashlib.sha256(how.encode()).hexdigest(),
    )


def _degraded(
    load: Callable[[Entry], Recording], fs: float | None, bits: int | None, full_scale: float, entry: Entry
) -> Recording:
    recording = load(entry)
    if fs is not None and fs < recording.fs:
        recording = resampled(recording, fs)
    if bits is not None:
        recording = recording.with_(acceleration=quantised(recording.acceleration, bits, full_scale))
    return recording


def quantised(x: Samples, bits: int, full_scale: float) -> Samples:
    """Return x on the levels of a converter: q round(x / q) with q = 2 full_scale / 2^bits, clipped.

    Parameters
    ----------
    x : ndarray
        Signal.
    bits : int
        Of the converter.
    full_scale : float
        It reaches from -full_scale to full_scale - q, in the unit of x.
    """
    q = 2 * full_scale / 2**bits
    return np.asarray(np.clip(q * np.round(x / q), -full_scale, full_scale - q))


def resampled(recording: Recording, fs: float) -> Recording:
    """Return a recording at a lower rate (Hz), declared phases and all.

    The spectrum is cut at the new fs/2, where an ideal anti-aliasing filter ends. The signal is continued
    by its mirror image, so that it does not jump at its ends.
    """
    n = max(1, round(recording.n_samples * fs / recording.fs))
    ratio, changes = n / recording.n_samples, dict[str, Any]()
    for name in ("acceleration", *AUXILIARY_UNITS):
        if (signal := getattr(recording, name)) is not None:
            # DCT-II is the Fourier transform of signal and mirror image; its first n bins lie below fs/2.
            spectrum = fft.dct(signal, axis=0, norm="ortho")[:n]
            changes[name] = fft.idct(spectrum, axis=0, norm="ortho") * np.sqrt(ratio)
    if (phases := recording.phases) is not None:

        def at(sample: int) -> int:
            return min(n, round(sample * ratio))

        kept = (tap for tap in phases.taps if at(tap.impact) < n)
        taps = tuple(
            Tap(at(t.start), at(t.impact), max(at(t.end), at(t.impact) + 1), at(t.width), t.quality)
            for t in kept
        )
        movement = phases.movement and (at(phases.movement[0]), at(phases.movement[1]))
        onset = None if phases.onset is None else at(phases.onset)
        changes["phases"] = Phases(taps, movement, onset, phases.notes)
    return recording.with_(**changes, fs=ratio * recording.fs)


def full_scale_of(dataset: Dataset, n: int = 12) -> float:
    """Return a converter's full scale: the largest magnitude in `n` recordings spread over a dataset."""
    step = ceil(len(dataset) / n)
    peaks = [np.abs(dataset[i].acceleration).max() for i in range(0, len(dataset), step)]
    return float(max(peaks))
