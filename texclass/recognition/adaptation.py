"""Domain adaptation of a model to another sensor, and recalibration of its prediction sets.

Another tool filters the vibration, so band levels (logarithms) shift by constants. A slower or noisier sensor
also reduces the distances between surfaces. `adapt` matches the mean and variance of each column over
reference recordings to those of the training set, and recalibrates the threshold for unknown surfaces and the
prediction sets. `with_references` recalibrates the sets alone with recent recordings.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, polygamma

from texclass.recognition.model import Model
from texclass.recognition.novelty import (
    ClassMoments,
    FeatureRanges,
    NoveltyDetector,
    min_held_out,
    novelty_scores,
)
from texclass.recognition.prediction_sets import (
    HALF_LIFE,
    ConformalCalibration,
    calibrate_sets,
    manifest_entry,
    n_later_repetitions,
    recency_weights,
)
from texclass.recognition.probabilities import log_probabilities
from texclass.recording import Recording, Samples

if TYPE_CHECKING:
    from texclass.loaders.dataset import Dataset


@dataclass(frozen=True)
class AdaptationLimits:
    """Minimum numbers of references, and limits of the map.

    Attributes
    ----------
    min_labelled : int
        Minimum number of labelled references.
    min_unlabelled : int
        Minimum number of references without labels.
    min_surfaces : float
        Minimum effective number of surfaces, 1 / sum shares^2, of references without labels.
    max_scale : float
        Largest factor by which a column is scaled; the smallest factor is its inverse.
    noise_factor : float
        Factor of the variance expected by chance, which is subtracted from the mean square of the changes.
    significance : float
        Significance level of the test that rejects a map.
    n_folds : int
        Number of folds of the references; each fold is evaluated with a map fitted to the other folds.
    n_rounds : int
        Maximum number of iterations that estimate the shares of surfaces.
    tolerance : float
        Change in the estimated class proportions below which the iterations stop.
    prior : float
        Weight per surface of a uniform prior on the shares, relative to the references without labels.
    max_prior : float
        Upper limit of the prior weight, summed over all surfaces.
    within_ratio : float
        Standard deviation within a surface, divided by that of the surface means, for a model of one
        recording per surface. It is the geometric mean over seven datasets of the median over columns.
    """

    min_labelled: int = 3
    min_unlabelled: int = 10
    min_surfaces: float = 2.5
    max_scale: float = 10.0
    noise_factor: float = 2.0
    significance: float = 0.05
    n_folds: int = 10
    n_rounds: int = 20
    tolerance: float = 1e-3
    prior: float = 0.025
    max_prior: float = 0.5
    within_ratio: float = 1.0


LIMITS = AdaptationLimits()
AffineMap = tuple[Samples, Samples]
"""Scale and shift, both of shape (n_columns,), from features of the new sensor to those of the old one."""
MAP_KINDS = ("affine", "shift", "none")
"""Kinds of maps, from the most to the least flexible."""
MIN_SHIFT = 0.05
"""Shift in standard deviations within a surface below which a column counts as unchanged."""


def adapt(
    model: Model, references: Iterable[Recording], *, use_labels: bool = True, resample: bool = False
) -> Model:
    """Adapt a model to another sensor with reference recordings.

    Each feature is scaled and shifted before all other steps; the training recordings are not needed. If the
    surfaces of references are unknown, their shares are estimated together with the map (expectation
    maximisation over the probabilities of the model). The threshold for unknown surfaces and the prediction
    sets are recalibrated, so that the rate of false alarms and the coverage stay the same; see
    `recalibrate_threshold` and `recalibrate_sets`. The accuracy and the calibration of the probabilities in
    the manifest are not updated.

    For a model of one recording per surface, the variation within a surface is unknown. It is estimated from
    the variation between these recordings, with `LIMITS.within_ratio` from other datasets.

    Parameters
    ----------
    model : Model
        Trained model.
    references : iterable of Recording
        Recordings of the new sensor at the sampling rate of the model (or resampled to it) and in its unit.
        `Recording.surface` must be a surface of the model, or None if it is unknown.
    use_labels : bool
        Whether to use the surfaces of references (default True).
    resample : bool
        Whether the adapted model resamples files, because the references were resampled (default False).

    Returns
    -------
    Model
        Adapted model, with the references in its manifest (`adapted`).

    Raises
    ------
    ValueError
        If there are too few references, or one has a surface that is not in the model, another sampling rate
        or unit, or lacks a channel; if the adapted model cannot separate their surfaces; or if the model is
        already adapted.

    References
    ----------
    Sun, Feng, Saenko: Return of frustratingly easy domain adaptation, AAAI 2016 (moments, here one column at
    a time). Saerens, Latinne, Decaestecker: Adjusting the outputs of a classifier to new a priori
    probabilities, Neural Computation 14, 2002 (shares).

    Examples
    --------
    >>> references = [load_recording(f"new/oak_{k}.txt") for k in (1, 2, 3)]  # doctest: +SKIP
    >>> adapt(model, references).save("adapted.skops")  # doctest: +SKIP
    """
    recordings, digest = list(references), hashlib.sha256()
    X, one_hot, recording_index = reference_rows(model, recordings, use_labels=use_labels)
    for recording in recordings:
        digest.update(f"\0{recording.recording_id}\0{recording.surface}\0".encode())
        digest.update(np.ascontiguousarray(recording.acceleration).tobytes())
    names = [(one.recording_id, one.surface if use_labels else None) for one in recordings]
    entry = {"references": names, "hash": digest.hexdigest()}
    return adapt_to_rows(model, X, one_hot, recording_index, entry, resample=resample)


def adapt_to_rows(
    model: Model,
    X: Samples,
    one_hot: Samples,
    recording_index: NDArray[np.intp],
    entry: Mapping[str, Any],
    *,
    resample: bool = False,
) -> Model:
    """Return a model that is adapted to the features of references, which `reference_rows` computes.

    Parameters
    ----------
    model : Model
        Trained model.
    X : ndarray of shape (n, n_columns)
        Features of the new sensor; NaN where undefined.
    one_hot : ndarray of shape (n, n_surfaces)
        1 for the surface of a row; zeros if it is unknown.
    recording_index : ndarray of int, shape (n,)
        Index of the recording of each row.
    entry : mapping
        Description of the references for the manifest.
    resample : bool
        Whether the adapted model resamples files (default False).

    Raises
    ------
    ValueError
        If there are too few references, or the adapted model cannot separate their surfaces; or if the model
        is already adapted.
    """
    class_moments = class_moments_of(model)
    n_recordings = len(np.unique(recording_index))
    n_labelled = len(np.unique(recording_index[one_hot.any(axis=1)]))
    if n_labelled < LIMITS.min_labelled and n_recordings < LIMITS.min_unlabelled:
        raise ValueError(
            f"too few references: {n_labelled} of {n_recordings} are labelled. Expected at least "
            f"{LIMITS.min_labelled} labelled references (SURFACE=FILE), or {LIMITS.min_unlabelled} "
            "recordings of any surfaces of the model"
        )
    hits_without_map = _hits(model.decide(X)[1], one_hot)
    for kind in MAP_KINDS:
        affine_map = fit_map(model, X, one_hot, class_moments, n_recordings, kind)
        decisions, novelty = _predict_held_out(
            model, X, one_hot, recording_index, class_moments, affine_map, kind
        )
        if not _is_worse(hits_without_map, _hits(decisions, one_hot), recording_index):
            break
    _check_separation(model, X * affine_map[0] + affine_map[1], one_hot, n_labelled)
    has_labels = n_labelled >= LIMITS.min_labelled
    detector, source = recalibrate_threshold(model.novelty, novelty, n_recordings, has_labels=has_labels)
    sets = recalibrate_sets(model, decisions, one_hot, recording_index, has_labels=has_labels)
    entry = {
        **entry,
        "map": kind,
        "threshold_from": source,
        "sets_from": "references" if has_labels else "recordings held out in training, moved by references",
        "has_trained_variation": _has_trained_variation(model),
        **describe_map(model.columns, X, affine_map, class_moments),
    }
    return _with_map(model, affine_map, detector, sets, entry, resample=resample)


def describe_map(
    columns: Sequence[str], X: Samples, affine_map: AffineMap, class_moments: ClassMoments
) -> dict[str, Any]:
    """Return the changes of the columns by a map, for the manifest.

    Parameters
    ----------
    columns : sequence of str
        Names of the columns.
    X : ndarray of shape (n, n_columns)
        Features of the new sensor.
    affine_map : tuple of ndarray
        Scale and shift.
    class_moments : ClassMoments
        Moments of the training features.

    Returns
    -------
    dict
        n_shifted (number of columns whose mean is shifted), shift (median, 90 % quantile and largest of their
        absolute shifts, in standard deviations within a surface), most_shifted (name of the column with the
        largest shift, or None), scale (10, 50 and 90 % quantile of the factors of all columns).
    """
    scale, shift = affine_map
    is_defined = ~np.isnan(X)
    mean = np.where(is_defined, X, 0).sum(axis=0) / np.maximum(is_defined.sum(axis=0), 1)
    within_std = class_moments.within_std
    change = np.zeros(len(mean))
    np.divide(np.abs((scale - 1) * mean + shift), within_std, out=change, where=within_std > 0)
    is_shifted = change > MIN_SHIFT
    sizes = np.quantile(change[is_shifted], [0.5, 0.9, 1.0]) if is_shifted.any() else np.zeros(3)
    return {
        "n_shifted": int(np.count_nonzero(is_shifted)),
        "shift": sizes.round(6).tolist(),
        "most_shifted": columns[int(change.argmax())] if is_shifted.any() else None,
        "scale": np.quantile(scale, [0.1, 0.5, 0.9]).round(6).tolist(),
    }


def _hits(decisions: Samples, one_hot: Samples) -> Samples:
    """Return 1 for each labelled row with a correct decision, else 0."""
    return np.asarray(one_hot[np.arange(len(one_hot)), decisions.argmax(axis=1)])


def _is_worse(hits_without_map: Samples, hits: Samples, recording_index: NDArray[np.intp]) -> bool:
    """Return whether the map reduces the hits of significantly more recordings than it increases (sign test).

    Each recording is evaluated with a map fitted to the other recordings, which is less precise than the
    final map. A few losses are therefore tolerated: the map is worse if P[Binomial(losses + gains, 1/2) >=
    losses] is at most `LIMITS.significance`, which requires at least five losses.
    """
    from scipy.stats import binom

    change = np.bincount(recording_index, weights=hits - hits_without_map)
    n_losses, n_gains = np.count_nonzero(change < 0), np.count_nonzero(change > 0)
    return bool(binom.sf(n_losses - 1, n_losses + n_gains, 0.5) <= LIMITS.significance)


def _check_separation(model: Model, X_mapped: Samples, one_hot: Samples, n_labelled: int) -> None:
    """Check that the references cover several surfaces, or that labelled ones are predicted above chance."""
    p = model.classify(X_mapped)[0]
    if n_labelled < LIMITS.min_labelled:
        shares = np.where(one_hot.any(axis=1, keepdims=True), one_hot, p).mean(axis=0)
        if (n_effective := effective_number(shares)) < LIMITS.min_surfaces:
            raise ValueError(
                f"the effective number of surfaces in the references appears to be {n_effective:.2g} (mostly "
                f"{model.surfaces[shares.argmax()]!r}), so the effects of sensor and surface cannot be "
                f"separated. Expected at least {LIMITS.min_surfaces:g} surfaces, or labelled references "
                "(SURFACE=FILE)"
            )
        return
    counts, n_hits = one_hot.sum(axis=0), int(_hits(p, one_hot).sum())
    if np.count_nonzero(counts) > 1 and n_hits <= counts.max():
        raise ValueError(
            f"the adapted model classifies {n_hits} of {counts.sum():.0f} labelled references correctly, no "
            f"more than if it always predicted the most frequent surface ({counts.max():.0f}). Check the "
            "labels, or add references"
        )


def effective_number(shares: Samples) -> float:
    """Return the effective number of surfaces, 1 / sum shares^2, for shares (n_surfaces,) with sum 1."""
    return float(1 / (shares**2).sum())


def fit_map(
    model: Model,
    X: Samples,
    one_hot: Samples,
    class_moments: ClassMoments,
    n_recordings: int,
    kind: str = "affine",
) -> AffineMap:
    """Fit the map from features of the new sensor to those of the training sensor.

    Parameters
    ----------
    model : Model
        Model that predicts the surfaces of rows without labels.
    X : ndarray of shape (n, n_columns)
        Features of the new sensor.
    one_hot : ndarray of shape (n, n_surfaces)
        1 for the surface of a row; zeros if it is unknown.
    class_moments : ClassMoments
        Moments of the training features.
    n_recordings : int
        Number of recordings of the rows.
    kind : {"affine", "shift", "none"}
        Kind of map (default "affine").
    """
    n, n_surfaces = one_hot.shape
    if kind == "none":
        return np.ones(X.shape[1]), np.zeros(X.shape[1])
    is_unlabelled = ~one_hot.any(axis=1)
    n_unlabelled = int(is_unlabelled.sum())
    shares = np.full(n_surfaces, 1 / n_surfaces)
    for _ in range(LIMITS.n_rounds if n_unlabelled else 1):
        mixture = (one_hot.sum(axis=0) + n_unlabelled * shares) / n
        scale, shift = moments_map(X, mixture, class_moments, n_recordings, with_scale=kind == "affine")
        if not n_unlabelled:
            break
        p_sum = model.classify(X[is_unlabelled] * scale + shift)[0].sum(axis=0)
        # Without a prior, the shares may converge to one surface, which then explains all references.
        prior = min(LIMITS.prior, LIMITS.max_prior / n_surfaces)
        previous, shares = shares, (p_sum / n_unlabelled + prior) / (1 + n_surfaces * prior)
        if np.abs(shares - previous).max() < LIMITS.tolerance:
            break
    return scale, shift


def moments_map(
    X: Samples,
    shares: Samples,
    class_moments: ClassMoments,
    n_recordings: int,
    *,
    with_scale: bool = True,
) -> AffineMap:
    """Return the scale and shift that match mean and variance of each column to a mixture of surfaces.

    Scale and shift are shrunk towards the identity (`_shrinkage`), because part of the changes is due to
    chance. The variance expected by chance is within_std^2 / n for the mean of n recordings. For the
    logarithm of the standard deviation, it is psi'((m - 1)/2) / 4, because surfaces differ in their
    variation; m is the effective number of surfaces, 1 / sum shares^2, and at most n. Columns without values
    are not changed.

    Parameters
    ----------
    X : ndarray of shape (n, n_columns)
        Features of the new sensor; NaN where undefined.
    shares : ndarray of shape (n_surfaces,)
        Share of each surface among the rows.
    class_moments : ClassMoments
        Moments of the training features.
    n_recordings : int
        Number of recordings that the rows belong to. Windows of one recording are correlated, so each
        recording counts once.
    with_scale : bool
        Whether columns are scaled as well as shifted (default True).
    """
    means, within_std = class_moments
    n = min(n_recordings, len(X))
    is_defined = ~np.isnan(X)
    count = np.maximum(is_defined.sum(axis=0), 1)
    mean = np.where(is_defined, X, 0).sum(axis=0) / count
    variance = np.where(is_defined, (X - mean) ** 2, 0).sum(axis=0) / np.maximum(count - 1, 1)
    weights = shares[:, None] * np.isfinite(means)  # only surfaces for which the column has a value
    weights = weights / np.where((total := weights.sum(axis=0)) > 0, total, np.nan)
    class_means = np.nan_to_num(means)
    target_mean = (weights * class_means).sum(axis=0)
    target_variance = (weights * (class_means - target_mean) ** 2).sum(axis=0) + within_std**2
    is_usable = is_defined.any(axis=0) & np.isfinite(target_mean) & (within_std > 0)
    half_freedom = (min(n, effective_number(shares)) - 1) / 2
    is_scaled = is_usable & (variance > 0) & (half_freedom > LIMITS.tolerance) & with_scale
    log_scale = np.zeros(len(target_mean))
    if is_scaled.any():
        bias = digamma(half_freedom) - np.log(half_freedom)
        log_scale[is_scaled] = 0.5 * (np.log(target_variance[is_scaled] / variance[is_scaled]) + bias)
        log_scale *= _shrinkage(log_scale[is_scaled], polygamma(1, half_freedom) / 4)
    scale = np.clip(np.exp(log_scale), 1 / LIMITS.max_scale, LIMITS.max_scale)
    change = np.where(is_usable, target_mean - mean, 0.0)
    if is_usable.any():
        change *= _shrinkage(change[is_usable] / within_std[is_usable], 1 / n)
    return scale, np.where(is_usable, mean + change - scale * mean, 0.0)


def _shrinkage(changes: Samples, noise: float) -> float:
    """Return t / (t + noise), where t is the mean square of the changes beyond the variance of the noise."""
    t = max(0.0, float(np.mean(np.minimum(changes**2, 1e6))) - LIMITS.noise_factor * noise)
    return t / (t + noise)


def _has_trained_variation(model: Model) -> bool:
    """Return whether the model was trained on several recordings of a surface."""
    return model.class_moments is not None and bool((model.class_moments.within_std > 0).any())


def class_moments_of(model: Model) -> ClassMoments:
    """Return the moments of the training features, with a prior for the variation if it is unknown.

    Raises
    ------
    ValueError
        If the model is already adapted.
    """
    if model.manifest.adapted or model.class_moments is None:
        raise ValueError(f"{model!r} is already adapted. Adapt the original model instead")
    if _has_trained_variation(model):
        return model.class_moments
    # The variance between single recordings is the sum of the variances between and within surfaces.
    means, ratio = model.class_moments.means, LIMITS.within_ratio
    n = np.maximum(np.isfinite(means).sum(axis=0), 2)
    center = np.nan_to_num(means).sum(axis=0) / n
    std = np.sqrt((np.nan_to_num(means - center) ** 2).sum(axis=0) / (n - 1))
    between_share = 1 / np.sqrt(1 + ratio**2)
    return ClassMoments(center + between_share * (means - center), ratio * between_share * std)


def reference_rows(
    model: Model, recordings: Sequence[Recording], *, use_labels: bool = True
) -> tuple[Samples, Samples, NDArray[np.intp]]:
    """Compute the features of references, or of their windows; leave out rows that are entirely undefined.

    Parameters
    ----------
    model : Model
        Model that is adapted.
    recordings : sequence of Recording
        References; see `adapt`.
    use_labels : bool
        Whether to use their surfaces (default True).

    Returns
    -------
    X : ndarray of shape (n, n_columns)
        Features; NaN where undefined.
    one_hot : ndarray of shape (n, n_surfaces)
        1 for the surface of a row; zeros if it is unknown.
    recording_index : ndarray of int, shape (n,)
        Index of the recording of each row.

    Raises
    ------
    ValueError
        If a recording has a surface that is not in the model, another sampling rate or unit, or lacks a
        channel.
    """
    rows, one_hot, recording_index = [], [], []
    for i, recording in enumerate(recordings):
        problems = model.rate_and_unit_problems(recording.fs, recording.unit)
        problems += model.auxiliary_rate_problems(recording)
        if problems := problems + model.axis_problems(recording.channels):
            raise ValueError(f"{recording.recording_id}: {problems[0]}")
        label = recording.surface if use_labels else None
        if label is not None and label not in model.surfaces:
            raise ValueError(
                f"{recording.recording_id}: surface {label!r} is not in the model. Expected "
                f"one of {', '.join(model.surfaces)}, or references without labels (--unlabelled)"
            )
        for window in model.cut(recording):
            rows.append(model.compute(window).values)
            one_hot.append([float(surface == label) for surface in model.surfaces])
            recording_index.append(i)
    X = np.array(rows).reshape(-1, len(model.columns))
    has_values = ~np.isnan(X).all(axis=1)
    labels = np.array(one_hot).reshape(len(X), -1)
    return X[has_values], labels[has_values], np.array(recording_index, dtype=np.intp)[has_values]


def _predict_held_out(
    model: Model,
    X: Samples,
    one_hot: Samples,
    recording_index: NDArray[np.intp],
    class_moments: ClassMoments,
    affine_map: AffineMap,
    kind: str,
) -> tuple[Samples, Samples]:
    """Return decisions (n, n_surfaces) and novelty scores (n,), with maps fitted to the other references.

    If the references cover less than half of the surfaces, whole surfaces are held out, because most later
    recordings will be of surfaces without references. For rows without labels, the surface is predicted with
    the map fitted to all references.
    """
    detector, novelty, decisions = model.novelty, np.empty(len(X)), np.empty(one_hot.shape)
    predicted = model.classify(X * affine_map[0] + affine_map[1])[0].argmax(axis=1)
    groups = np.where(one_hot.any(axis=1), one_hot.argmax(axis=1), predicted)
    if not LIMITS.min_labelled <= len(np.unique(groups)) < len(model.surfaces) / 2:
        groups = recording_index
    folds = np.unique(groups, return_inverse=True)[1] % LIMITS.n_folds
    for fold in range(folds.max() + 1):
        train, test = folds != fold, folds == fold
        n_recordings = len(set(recording_index[train].tolist()))
        scale, shift = fit_map(model, X[train], one_hot[train], class_moments, n_recordings, kind)
        prepared, decisions[test] = model.decide(X[test] * scale + shift)
        novelty[test] = novelty_scores(detector.kind, decisions[test], prepared, detector.class_distance)
    return decisions, novelty


def recalibrate_threshold(
    detector: NoveltyDetector, novelty: Samples, n_recordings: int, *, has_labels: bool
) -> tuple[NoveltyDetector, str]:
    """Return the detector for the new sensor, and the source of its threshold.

    If there are enough labelled references for the rate of false alarms, their novelty scores replace the
    held-out scores of the training. Otherwise, the held-out scores are increased by the same amount as the
    median: by addition for decisions, by multiplication for distances. Their margin to the threshold remains.
    The median hardly depends on a few recordings of unknown surfaces among unlabelled references, so these
    surfaces are still detected. The threshold is never lowered.

    Parameters
    ----------
    detector : NoveltyDetector
        Detector of the original model.
    novelty : ndarray of shape (n,)
        Novelty scores of the references, from maps fitted to the other references.
    n_recordings : int
        Number of recordings of the references.
    has_labels : bool
        Whether the references are labelled.
    """
    n_needed = max(LIMITS.min_unlabelled, min_held_out(detector.false_alarms))
    if has_labels and n_recordings >= n_needed:
        return replace(detector, held_out=np.sort(novelty)), "references"
    if not len(detector.held_out):
        return detector, "no recordings: unknown surfaces are not detected"
    median, trained_median = float(np.median(novelty)), float(np.median(detector.held_out))
    if detector.kind == "decision":
        scores = detector.held_out + max(0.0, median - trained_median)
    else:
        scores = detector.held_out * max(1.0, median / max(trained_median, 1e-300))
    return replace(detector, held_out=scores), "recordings held out in training, moved by references"


def recalibrate_sets(
    model: Model,
    decisions: Samples,
    one_hot: Samples,
    recording_index: NDArray[np.intp],
    *,
    has_labels: bool,
) -> dict[str, ConformalCalibration]:
    """Return the calibrations of the prediction sets for the new sensor.

    Labelled references are added to the recordings held out in training, which count as older than all
    references (`HALF_LIFE`). Without labels, all held-out log odds are reduced by the same amount as the
    median over recordings, where the predicted surface replaces the true one. The spread of the held-out log
    odds, and with it the share of errors, remains. Log odds are never increased.

    Parameters
    ----------
    model : Model
        Original model.
    decisions : ndarray of shape (n, n_surfaces)
        Decisions for the references, from maps fitted to the other references.
    one_hot : ndarray of shape (n, n_surfaces)
        1 for the surface of a row; zeros if it is unknown.
    recording_index : ndarray of int, shape (n,)
        Index of the recording of each row.
    has_labels : bool
        Whether the references are labelled.
    """
    rows, labels = np.arange(len(decisions)), one_hot.argmax(axis=1)
    if has_labels:
        rows = np.flatnonzero(one_hot.any(axis=1))
    else:
        recordings = np.unique(recording_index, return_inverse=True)[1]
        mean = np.eye(recordings.max() + 1)[recordings].T @ log_probabilities(model.calibration(decisions))
        labels = mean.argmax(axis=1)[recordings]
    later = calibrate_sets(
        decisions[rows],
        labels[rows],
        recording_index[rows],
        model.calibration,
        correlation=model.manifest.calibration.get("correlation"),
    )
    if has_labels:
        n_per_surface = len(np.unique(recording_index[rows])) / len(model.surfaces)
        return _updated_sets(model, later, float(recency_weights(n_per_surface, HALF_LIFE)))
    return {
        kind: calibration.moved(min(0.0, later[kind].median - calibration.median))
        if kind in later and len(calibration.log_odds)
        else calibration
        for kind, calibration in model.set_calibrations.items()
    }


def _updated_sets(
    model: Model, later: Mapping[str, ConformalCalibration], discount: float
) -> dict[str, ConformalCalibration]:
    """Return the calibrations of a model with later answers added, and its own weights discounted."""
    return {
        kind: calibration.updated(later[kind], discount) if kind in later else calibration
        for kind, calibration in model.set_calibrations.items()
    }


def _with_map(
    model: Model,
    affine_map: AffineMap,
    detector: NoveltyDetector,
    sets: dict[str, ConformalCalibration],
    entry: Mapping[str, Any],
    *,
    resample: bool,
) -> Model:
    """Return a model that applies a map to the features before its other steps."""
    scale, shift = affine_map
    ranges = model.ranges
    low, median, high = ((edge - shift) / scale for edge in (ranges.low, ranges.median, ranges.high))
    manifest = model.manifest
    threshold = detector.threshold if len(detector.held_out) else None
    unknown = {**manifest.unknown, "threshold": threshold, "n": len(detector.held_out)}
    changes: dict[str, Any] = {"adapted": entry, "unknown": unknown}
    if sets:
        sets_entry = {**manifest.calibration["prediction_sets"], **manifest_entry(sets)}
        changes["calibration"] = {**manifest.calibration, "prediction_sets": sets_entry}
    if resample:
        changes["input"] = manifest.input.model_copy(update={"resample": True})
    return replace(
        model,
        steps=[{"operation": "affine", "scale": scale, "shift": shift}, *model.steps],
        novelty=detector,
        ranges=FeatureRanges(low, median, high),
        class_moments=None,
        set_calibrations=sets,
        manifest=manifest.model_copy(update=changes),
    )


def with_references(model: Model, references: "Dataset") -> Model:
    """Return a model whose prediction sets are recalibrated with recent recordings of known surfaces.

    If a sensor drifts, the true surface receives lower probabilities than in training, and prediction sets
    lose coverage. The weight of a reference is halved for every `HALF_LIFE` later recordings of its surface.
    The recordings held out in training count as older than all references, and their weights are reduced in
    the same way. Predicted surfaces and probabilities do not change.

    Parameters
    ----------
    model : Model
        Trained model.
    references : Dataset
        Whole recordings of surfaces of the model; the recordings must not be in its training set. Numbered
        repetitions define the chronological order; without numbers, all references have the same weight.

    Returns
    -------
    Model
        Model with recalibrated prediction sets.

    Raises
    ------
    ValueError
        If a surface is not in the model, or a recording cannot be classified; the message names it.

    Examples
    --------
    >>> recent = tx.open_dataset("recent")  # doctest: +SKIP
    >>> with_references(model, recent).save("recalibrated.skops")  # doctest: +SKIP
    """
    from texclass.evaluation.feature_table import metadata

    table = metadata(references.entries)
    surfaces = table["surface"].to_numpy(dtype=str)
    if unknown := sorted({*surfaces.tolist()} - {*model.surfaces}):
        raise ValueError(
            f"{references.name}: surface {unknown[0]!r} is not in the model. Expected one of "
            f"{', '.join(model.surfaces)}"
        )
    rows, recording_index = list[Samples](), list[int]()
    for i, recording in enumerate(references):
        problems = model.rate_and_unit_problems(recording.fs, recording.unit)
        if problems := problems + model.axis_problems(recording.channels):
            raise ValueError(f"{recording.recording_id}: {problems[0]}")
        for window in model.cut(recording) or (recording,):
            rows.append(model.compute(window).values)
            recording_index.append(i)
    ages = np.zeros(len(table), dtype=np.intp)
    if table["repetition"].notna().all():
        ages = n_later_repetitions(surfaces, table["repetition"].to_numpy())
    entry = model.manifest.calibration
    later = calibrate_sets(
        model.decide(np.array(rows))[1],
        np.array([model.surfaces.index(name) for name in surfaces[recording_index].tolist()]),
        recording_index,
        model.calibration,
        correlation=entry.get("correlation"),
        weights=recency_weights(ages[recording_index], HALF_LIFE),
    )
    discount = float(recency_weights(1 + ages.max(), HALF_LIFE))
    set_calibrations = _updated_sets(model, later, discount)
    sets_entry = {
        **entry["prediction_sets"],
        **manifest_entry(set_calibrations),
        "references": references.input_hash,
    }
    calibration_entry = {**entry, "prediction_sets": sets_entry}
    manifest = model.manifest.model_copy(update={"calibration": calibration_entry})
    return replace(model, set_calibrations=set_calibrations, manifest=manifest)
