"""Curves of accuracy against signal length, training recordings, sampling rate, bits and model order.

`degrade` simulates a cheaper sensor with a lower sampling rate or fewer bits.
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
from texclass.evaluation.protocols import Protocol, repeated_splits
from texclass.evaluation.splits import Split
from texclass.evaluation.windows import cut_windows
from texclass.evaluation.workers import Progress, run_parallel
from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import Channels, views_of
from texclass.features.sets import FeatureSet
from texclass.loaders.dataset import Dataset, Entry
from texclass.recording import AUXILIARY_UNITS, Recording, RecordingError, Samples
from texclass.tradeoff.pareto_front import (
    Facts,
    LabelledData,
    Labels,
    accuracy_with_interval,
    discriminant,
    label_data,
    preprocessing,
)
from texclass.validation import check_positive

LINEAR = "linear discriminants"


@dataclass(frozen=True)
class CurveSettings:
    """Values at which the curves of a trade-off are measured.

    Attributes
    ----------
    seconds
        Lengths of the movement in s.
    n_training
        Numbers of training recordings per surface.
    rates_hz, bits
        Sampling rates in Hz and bit depths of cheaper sensors.
    orders
        Orders of the autoregressive model of the movement.
    n_recordings
        Largest number of recordings for the curves of sampling rate, bit depth and model order, which compute
        features again.
    """

    seconds: tuple[float, ...] = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0)
    n_training: tuple[int, ...] = (1, 2, 3, 5, 8)
    rates_hz: tuple[float, ...] = (500.0, 1000.0, 2000.0, 5000.0)
    bits: tuple[int, ...] = (4, 6, 8, 12)
    orders: tuple[int, ...] = (2, 4, 8, 16, 32, 64)
    n_recordings: int = 150


CURVES = CurveSettings()


@dataclass(frozen=True, eq=False)
class Conditions:
    """Dataset, features and protocol of a trade-off study.

    Attributes
    ----------
    dataset
        Recordings of the study.
    features, channels
        Feature set, and handling of channels (see `FeatureExtractor`).
    protocol, n_folds, n_repeats, seed
        Protocol of the splits, number of folds, number of repeats, and random seed.
    n_jobs
        Number of processes.
    progress
        Function called with (done, total, stage), or None.
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
        """Return the feature table of a dataset, without unusable recordings."""
        return cached_table(
            dataset,
            self.features,
            channels=self.channels,
            n_jobs=self.n_jobs,
            skip_bad=True,
            progress=self.progress,
        )

    def splits(self, frame: pd.DataFrame) -> tuple[Split, ...]:
        """Return the folds of all repeats, with at most as many folds as a surface has recordings."""
        n_folds = min(self.n_folds, int(frame["surface"].value_counts().min()))
        n_repeats = self.n_repeats if self.protocol.is_random else 1
        repeats = repeated_splits(self.protocol, frame, n_folds, n_repeats, self.seed)
        return tuple(split for repeat in repeats for split in repeat)

    def data(self, table: FeatureTable) -> LabelledData:
        """Return the columns that are defined for at least one recording, with labels and groups."""
        return label_data(table.select(table.defined_columns), table.frame, self.protocol)

    def accuracy(self, table: FeatureTable) -> Facts:
        """Return the cross-validated accuracy of `discriminant` with all columns of a table."""
        return cross_validate(self.data(table), self.splits(table.frame), discriminant())


def cross_validate(
    data: LabelledData,
    splits: Sequence[Split],
    classifier: Any,
    reduced_splits: Sequence[Split] | None = None,
) -> Facts:
    """Cross-validate a classifier on all columns.

    `reduced_splits` are the splits with fewer training recordings.
    """
    result = evaluate(data.X, data.y, reduced_splits or splits, preprocessing(), classifier)
    return accuracy_with_interval(np.concatenate(result.hits), splits, data)


def training_curves(conditions: Conditions, table: FeatureTable) -> list[Facts]:
    """Measure accuracy against the number of training recordings per surface, with two classifiers."""
    data, splits = conditions.data(table), conditions.splits(table.frame)
    largest = min(int(np.unique(data.y[train], return_counts=True)[1].min()) for train, _ in splits)
    numbers = sorted({n for n in CURVES.n_training if n < largest} | {largest})
    curves = []
    for series, classifier, sizes in (
        # Discriminants need the variance within classes, which is undefined for one recording per class.
        (LINEAR, discriminant(), [n for n in numbers if n > 1]),
        ("nearest class mean", NearestCentroid(), numbers),
    ):
        points = []
        for n in sizes:
            accuracy = cross_validate(
                data,
                splits,
                classifier,
                [_limit_training_set(data.y, n, conditions.seed, split) for split in splits],
            )
            points.append((float(n), accuracy))
        if points:
            curves.append(_curve("training recordings per surface", "", points, series))
    return curves


def _limit_training_set(y: Labels, n: int, seed: int, split: Split) -> Split:
    """Return a split with `n` training recordings of each class, drawn at random."""
    order = np.random.default_rng([seed, n, int(split[1][0])]).permutation(split[0])
    rank = pd.Series(y[order]).groupby(y[order]).cumcount().to_numpy()
    return np.sort(order[rank < n]), split[1]


def signal_length_curve(conditions: Conditions, whole: FeatureTable) -> Facts | None:
    """Measure accuracy against signal length, with the first window of each movement and whole recordings."""
    points: list[tuple[float, Facts]] = []
    for seconds in CURVES.seconds:
        try:
            windows = cut_windows(conditions.dataset, seconds, per_recording=1, n_jobs=conditions.n_jobs)
            table = conditions.table(windows)
            if len(table.frame) < 0.9 * len(whole.frame):  # too many recordings are shorter than the window
                break
            points.append((seconds, conditions.accuracy(table)))
        except (RecordingError, ValueError):
            break
    if not points:
        return None
    longest = 2 * points[-1][0]
    points.append((longest, conditions.accuracy(whole)))
    note = "the first window of each movement; whole: with taps, if any"
    curve = _curve("signal length", "s", points, LINEAR, note)
    return {**curve, "labels": [*curve["labels"][:-1], "whole"]}


def sensor_curves(conditions: Conditions) -> list[Facts]:
    """Measure accuracy against sampling rate and bit depth, both equal in training set and test set."""
    dataset, note = _limit_recordings(conditions.dataset)
    conditions = replace(conditions, dataset=dataset)
    fs_recorded = dataset[0].fs
    scale = full_scale_of(dataset)
    rates = [fs for fs in CURVES.rates_hz if fs <= fs_recorded / 1.5]
    rate_variants = {fs: degrade(dataset, fs=fs) for fs in rates} | {fs_recorded: dataset}
    bit_variants = {float(bits): degrade(dataset, bits=bits, full_scale=scale) for bits in CURVES.bits}
    curves = []
    for name, unit, variants in (("sampling rate", "Hz", rate_variants), ("bit depth", "bits", bit_variants)):
        points = [(x, conditions.accuracy(conditions.table(variant))) for x, variant in variants.items()]
        curves.append(_curve(name, unit, points, LINEAR, note))
    return curves


def order_curve(conditions: Conditions) -> Facts | None:
    """Measure accuracy against the order of an autoregressive model of the movement.

    The columns are the reflection coefficients of Burg's method and the gain. The model of order p has the
    first p coefficients of the model of the largest order, so each movement is fitted once.
    """
    dataset, note = _limit_recordings(conditions.dataset)
    rows = list(
        run_parallel([partial(_model, dataset.load, e) for e in dataset.entries], n_jobs=conditions.n_jobs)
    )
    fitted = [i for i, row in enumerate(rows) if row is not None]
    if len(fitted) < 0.9 * len(rows):
        return None
    models = np.array([rows[i] for i in fitted])
    frame = pd.DataFrame([vars(dataset.entries[i]) for i in fitted])
    splits, data = conditions.splits(frame), label_data(models, frame, conditions.protocol)
    points = []
    for p in CURVES.orders:
        truncated = data._replace(X=models[:, : p + 1])
        points.append((float(p), cross_validate(truncated, splits, discriminant())))
    return _curve("order of the movement model", "", points, "AR coefficients alone", note)


def _model(load: Callable[[Entry], Any], entry: Entry) -> Samples | None:
    """Return log gain and arctanh of reflection coefficients of the movement, or None without movement."""
    try:
        movement = views_of(load(entry))[""].vibration
    except (RecordingError, UndefinedFeatureError):
        return None
    model = vibration.fit(movement.samples, CURVES.orders[-1])
    log_gain = np.log(np.maximum(model.gain, np.finfo(np.float64).tiny))
    return np.concatenate([[log_gain], np.arctanh(model.reflection)])


def _limit_recordings(dataset: Dataset) -> tuple[Dataset, str]:
    """Return about `CURVES.n_recordings` recordings: the same number of each surface, and at least four."""
    per_surface = max(4, CURVES.n_recordings // max(len(dataset.surfaces), 1))
    surfaces = pd.Series([e.surface for e in dataset.entries])
    rank = surfaces.groupby(surfaces).cumcount()
    entries = tuple(e for e, r in zip(dataset.entries, rank, strict=True) if r < per_surface)
    note = "" if len(entries) == len(dataset) else f"from {len(entries)} of the recordings"
    return replace(dataset, entries=entries), note


def _curve(name: str, unit: str, points: Sequence[tuple[float, Facts]], series: str, note: str = "") -> Facts:
    """Return a curve of (value, accuracy) points; `series` is its name in a panel with several curves."""
    x, accuracy = map(list, zip(*points, strict=True))
    facts = {"name": name, "unit": unit, "series": series, "note": note}
    return {**facts, "x": x, "accuracy": accuracy, "labels": [f"{value:g}" for value in x]}


def degrade(
    dataset: Dataset, *, fs: float | None = None, bits: int | None = None, full_scale: float = 1.0
) -> Dataset:
    """Return a dataset that simulates recordings of a cheaper sensor.

    Parameters
    ----------
    dataset : Dataset
        Original recordings.
    fs : float, optional
        Sampling rate in Hz (default: unchanged). Recordings with a lower rate are not resampled.
    bits : int, optional
        Bit depth of the analogue-to-digital converter of the acceleration (default: no quantisation).
    full_scale : float
        Full scale of the converter in the unit of the acceleration (default 1). Larger samples are clipped.

    Raises
    ------
    ValueError
        If `fs`, `bits` or `full_scale` is not positive.
    """
    check_positive(fs=fs, bits=bits, full_scale=full_scale)
    hash_input = f"{dataset.input_hash} fs {fs} bits {bits} of {full_scale}"
    return replace(
        dataset,
        load=partial(_degrade, dataset.load, fs, bits, full_scale),
        input_hash=hashlib.sha256(hash_input.encode()).hexdigest(),
    )


def _degrade(
    load: Callable[[Entry], Recording], fs: float | None, bits: int | None, full_scale: float, entry: Entry
) -> Recording:
    recording = load(entry)
    if fs is not None and fs < recording.fs:
        recording = resample(recording, fs)
    if bits is not None:
        recording = recording.with_(acceleration=quantise(recording.acceleration, bits, full_scale))
    return recording


def quantise(x: Samples, bits: int, full_scale: float) -> Samples:
    """Quantise and clip a signal like an analogue-to-digital converter.

    The result is q round(x / q) with the step q = 2 full_scale / 2^bits.

    Parameters
    ----------
    x : ndarray
        Signal.
    bits : int
        Bit depth of the converter.
    full_scale : float
        Full scale of the converter in the unit of x. Its range is from -full_scale to full_scale - q.

    Examples
    --------
    >>> quantise(np.array([-2.0, 0.3, 0.6, 2.0]), bits=2, full_scale=1.0)
    array([-1. ,  0.5,  0.5,  0.5])
    """
    q = 2 * full_scale / 2**bits
    return np.asarray(np.clip(q * np.round(x / q), -full_scale, full_scale - q))


def resample(recording: Recording, fs: float) -> Recording:
    """Resample a recording with its phases and all its channels to a lower sampling rate `fs` in Hz.

    The spectrum is truncated at the new fs/2, as with an ideal anti-aliasing filter. The signal is extended
    by its mirror image, so that there are no steps at its ends.
    """
    n = max(1, round(recording.n_samples * fs / recording.fs))
    ratio, changes = n / recording.n_samples, dict[str, Any]()
    for name in ("acceleration", *AUXILIARY_UNITS):
        if (signal := getattr(recording, name)) is not None:
            # The DCT-II is the Fourier transform of the signal extended by its mirror image. Its first n bins
            # are below the new fs/2.
            n_new = n if len(signal) == recording.n_samples else max(1, round(ratio * len(signal)))
            spectrum = fft.dct(signal, axis=0, norm="ortho")[:n_new]
            changes[name] = fft.idct(spectrum, axis=0, norm="ortho") * np.sqrt(n_new / len(signal))
    phases = recording.phases and recording.phases.at_rate(ratio, n)
    rates = {name: ratio * rate for name, rate in recording.auxiliary_fs.items()}
    return recording.with_(**changes, phases=phases, fs=ratio * recording.fs, auxiliary_fs=rates)


def full_scale_of(dataset: Dataset, n: int = 12) -> float:
    """Return the full scale for a converter: the largest magnitude in `n` recordings across a dataset."""
    step = ceil(len(dataset) / n)
    peaks = [np.abs(dataset[i].acceleration).max() for i in range(0, len(dataset), step)]
    return float(max(peaks))
