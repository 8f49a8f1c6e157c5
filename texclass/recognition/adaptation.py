"""Another sensor, another day: a model follows, by a map in front of its features, or by sets made anew.

Another tool filters what is felt, so levels of bands (logarithms) move by a constant each; a slower or
noisier one also narrows how far surfaces lie apart. Both are told by the mean and the variance of each column
over recordings felt with it, beside what the model knows of its surfaces (`adapt`). A sensor that only gets
older lets right answers be thought less of; what it feels now and then tells how much (`with_references`).
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, polygamma

from texclass.evaluation.feature_table import metadata
from texclass.loaders.dataset import Dataset
from texclass.recognition.conformal import HALF_LIFE, conformities, facts_of, n_later, recency
from texclass.recognition.model import Model
from texclass.recognition.unknown import ClassMoments, Novelty, Ranges, least_held_out, strangeness
from texclass.recording import Recording, Samples


@dataclass(frozen=True)
class AdaptationLimits:
    """What an adaptation needs, and how far it may go.

    Attributes
    ----------
    min_labelled, min_unlabelled
        References that it takes: of known surfaces, or of which nothing is known.
    min_surfaces
        Surfaces, 1 / sum shares^2, that references without labels must seem to be of.
    max_scale
        Factor by which a column is scaled at most, and at least its inverse.
    noise_factor
        Times what chance explains that a change must exceed to be believed at all.
    significance
        How often chance may take for a worse map what is none.
    n_folds
        Folds of references, each judged under the map of the others.
    n_rounds, tolerance
        Rounds in which shares of surfaces are estimated, and the change after which they are found.
    prior, max_prior
        Added references of each surface, and of all at most, as a part of those whose surface is estimated.
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


LIMITS = AdaptationLimits()
Map = tuple[Samples, Samples]
"""Scale and shift, both of shape (n_columns,): values of the new sensor -> as the old one would have them."""


def adapt(
    model: Model, references: Iterable[Recording], *, labelled: bool = True, resampled: bool = False
) -> Model:
    """Return a model that answers for the sensor with which references were felt.

    Features are scaled and shifted one by one before anything else: what trained is not needed. Where the
    surfaces of references are not known, the share of each is estimated with the map (expectation
    maximisation over the model's probabilities). The threshold of unknown surfaces follows (`Novelty`), so
    that false alarms stay where they were set. Accuracy, calibration and sets in the manifest remain those of
    the training.

    Parameters
    ----------
    model : Model
        As `train` made it.
    references : iterable of Recording
        Felt with the new sensor, at the model's sampling rate (or brought to it) and in its unit; of known
        surfaces, in `Recording.surface`, or of unknown ones among those that the model knows.
    labelled : bool
        Whether surfaces of references count.
    resampled : bool
        Whether the model should from now on bring files to its rate, as references were.

    Returns
    -------
    Model
        Its manifest tells of the references (`adapted`).

    Raises
    ------
    ValueError
        If references are too few, of a surface that the model does not know, of another rate or unit, lack a
        channel, or cannot be told apart by the adapted model; or the model is adapted already or too old to
        be.

    References
    ----------
    Sun, Feng, Saenko: Return of frustratingly easy domain adaptation, AAAI 2016 (moments, here one column at
    a time). Saerens, Latinne, Decaestecker: Adjusting the outputs of a classifier to new a priori
    probabilities, Neural Computation 14, 2002 (shares).

    Examples
    --------
    >>> felt = [load_recording(f"new/oak_{k}.txt") for k in (1, 2, 3)]  # doctest: +SKIP
    >>> adapt(model, felt).save("adapted.skops")  # doctest: +SKIP
    """
    felt, digest = list(references), hashlib.sha256()
    X, known, of = rows_of(model, felt, labelled=labelled)
    for one in felt:
        digest.update(f"\0{one.recording_id}\0{one.surface}\0".encode())
        digest.update(np.ascontiguousarray(one.acceleration).tobytes())
    named = [(one.recording_id, one.surface if labelled else None) for one in felt]
    told = {"references": named, "hash": digest.hexdigest()}
    return adapted_to(model, X, known, of, told, resampled=resampled)


def adapted_to(
    model: Model,
    X: Samples,
    known: Samples,
    of: NDArray[np.intp],
    told: Mapping[str, Any],
    *,
    resampled: bool = False,
) -> Model:
    """Return a model that answers for the sensor of rows of features, as `rows_of` gives them.

    Parameters
    ----------
    model, X, known, of
        As there.
    told : mapping
        Of the references, for the manifest.
    resampled : bool
        As `adapt` takes it.

    Raises
    ------
    ValueError
        If references are too few, or cannot be told apart; or the model is adapted already or too old to be.
    """
    class_moments = _class_moments_of(model)
    n_recordings, n_labelled = len(np.unique(of)), len(np.unique(of[known.any(axis=1)]))
    if n_labelled < LIMITS.min_labelled and n_recordings < LIMITS.min_unlabelled:
        raise ValueError(
            f"{n_labelled} of {n_recordings} references are of a known surface. Expected at least "
            f"{LIMITS.min_labelled} that are, or {LIMITS.min_unlabelled} recordings of any surfaces of the "
            "model"
        )
    hits_before = _hits(model.decide(X)[1], known)
    for kind in ("affine", "shift", "none"):  # each simpler than the one before
        found = fit_map(model, X, known, class_moments, n_recordings, kind)
        decisions, strange = _held_out(model, X, known, of, class_moments, found, kind)
        if not _is_worse(hits_before, _hits(decisions, known), of):
            break
    _check_told_apart(model, X * found[0] + found[1], known, n_labelled)
    novelty, by = _reset(model.novelty, strange, len(np.unique(of)))
    scale = np.quantile(found[0], [0.1, 0.5, 0.9]).round(6).tolist()
    told = {**told, "map": kind, "threshold_by": by, "scale": scale}
    return _mapped(model, found, novelty, told, resampled=resampled)


def _hits(decisions: Samples, known: Samples) -> Samples:
    """Return one for each labelled row whose largest decision is that of its surface, else zero."""
    return np.asarray(known[np.arange(len(known)), decisions.argmax(axis=1)])


def _is_worse(before: Samples, after: Samples, of: NDArray[np.intp]) -> bool:
    """Return whether more recordings lose by a map than win, beyond chance (sign test).

    Each is judged under the map of the others, which is poorer than that of all: of three or four lost, none
    won, nothing follows. P[Binomial(lost + won, 1/2) >= lost] decides, of recordings with fewer or more rows
    right than before.
    """
    from scipy.stats import binom

    change = np.bincount(of, weights=after - before)
    lost, won = np.count_nonzero(change < 0), np.count_nonzero(change > 0)
    return bool(binom.sf(lost - 1, lost + won, 0.5) <= LIMITS.significance)


def _check_told_apart(model: Model, mapped: Samples, known: Samples, n_labelled: int) -> None:
    """Refuse a map under which references seem to be of one surface, or labelled ones are not told apart."""
    p = model.judge(mapped)[0]
    if n_labelled < LIMITS.min_labelled:
        shares = np.where(known.any(axis=1, keepdims=True), known, p).mean(axis=0)
        if (n_apart := 1 / (shares**2).sum()) < LIMITS.min_surfaces:
            raise ValueError(
                f"references seem to be of {n_apart:.2g} surfaces, most of "
                f"{model.surfaces[shares.argmax()]!r}, so sensor and surface cannot be separated. Expected "
                f"at least {LIMITS.min_surfaces:g} surfaces, or labelled references (SURFACE=FILE)"
            )
        return
    counts, hits = known.sum(axis=0), int(_hits(p, known).sum())
    if np.count_nonzero(counts) > 1 and hits <= counts.max():
        raise ValueError(
            f"{hits} of {counts.sum():.0f} labelled references are answered right by the adapted model. "
            f"Expected more than one answer for all would get ({counts.max():.0f}): check their labels, "
            "or give more"
        )


def fit_map(
    model: Model,
    X: Samples,
    known: Samples,
    class_moments: ClassMoments,
    n_recordings: int,
    kind: str = "affine",
) -> Map:
    """Return the map under which rows of a new sensor lie as the model's surfaces do.

    Parameters
    ----------
    model : Model
        Says which surface unlabelled rows are of.
    X : ndarray of shape (n, n_columns)
        Features of the new sensor.
    known : ndarray of shape (n, n_surfaces)
        One where a row is of a surface, zeros where it is not known.
    class_moments : ClassMoments
        Where they lay with the old sensor.
    n_recordings : int
        Of which the rows are.
    kind : {"affine", "shift", "none"}
        What the map may do.
    """
    n, n_surfaces = known.shape
    if kind == "none":
        return np.ones(X.shape[1]), np.zeros(X.shape[1])
    open_rows = ~known.any(axis=1)
    n_open = int(open_rows.sum())
    shares = np.full(n_surfaces, 1 / n_surfaces)
    for _ in range(LIMITS.n_rounds if n_open else 1):
        mixture = (known.sum(axis=0) + n_open * shares) / n
        found = moments_map(X, mixture, class_moments, n_recordings, scaled=kind == "affine")
        if not n_open:
            break
        scale, shift = found
        likely = model.judge(X[open_rows] * scale + shift)[0].sum(axis=0)
        # Shares that follow probabilities alone may end at one surface, of which then all seem to be.
        prior = min(LIMITS.prior, LIMITS.max_prior / n_surfaces)
        before, shares = shares, (likely / n_open + prior) / (1 + n_surfaces * prior)
        if np.abs(shares - before).max() < LIMITS.tolerance:
            break
    return found


def moments_map(
    X: Samples, shares: Samples, class_moments: ClassMoments, n_recordings: int, *, scaled: bool = True
) -> Map:
    """Return scale and shift that give each column the mean and variance of a mixture of known surfaces.

    Both are shrunk towards none by how much they exceed, over all columns, what chance explains of so few
    recordings: of the mean of n of them, within^2 / n; of the logarithm of the standard deviation,
    psi'((m - 1)/2) / 4, of m = 1 / sum shares^2 surfaces at most, for some vary more than others. A column
    without values stays.

    Parameters
    ----------
    X : ndarray of shape (n, n_columns)
        Features of the new sensor; NaN where undefined.
    shares : ndarray of shape (n_surfaces,)
        Of each surface among the rows.
    class_moments : ClassMoments
        Where they lay with the old sensor.
    n_recordings : int
        Of which the rows are: touches of one recording are one witness.
    scaled : bool
        Whether columns are scaled, too.
    """
    means, within = class_moments
    n = min(n_recordings, len(X))
    there = ~np.isnan(X)
    count = np.maximum(there.sum(axis=0), 1)
    mean = np.where(there, X, 0).sum(axis=0) / count
    variance = np.where(there, (X - mean) ** 2, 0).sum(axis=0) / np.maximum(count - 1, 1)
    weights = shares[:, None] * np.isfinite(means)  # of surfaces for which the column has a value
    weights = weights / np.where((total := weights.sum(axis=0)) > 0, total, np.nan)
    known = np.nan_to_num(means)
    aim = (weights * known).sum(axis=0)
    aimed = (weights * (known - aim) ** 2).sum(axis=0) + within**2
    usable = there.any(axis=0) & np.isfinite(aim) & (within > 0)
    half = (min(n, 1 / (shares**2).sum()) - 1) / 2
    varies = usable & (variance > 0) & (half > LIMITS.tolerance) & scaled
    log_scale = np.zeros(len(aim))
    if varies.any():
        unbiased = digamma(half) - np.log(half)
        log_scale[varies] = 0.5 * (np.log(aimed[varies] / variance[varies]) + unbiased)
        log_scale *= _believed(log_scale[varies], polygamma(1, half) / 4)
    scale = np.clip(np.exp(log_scale), 1 / LIMITS.max_scale, LIMITS.max_scale)
    moved = np.where(usable, aim - mean, 0.0)
    if usable.any():
        moved *= _believed(moved[usable] / within[usable], 1 / n)
    return scale, np.where(usable, mean + moved - scale * mean, 0.0)


def _believed(changes: Samples, noise: float) -> float:
    """Return t / (t + noise): which part of changes is believed, of noise of such a variance."""
    t = max(0.0, float(np.mean(np.minimum(changes**2, 1e6))) - LIMITS.noise_factor * noise)
    return t / (t + noise)


def _class_moments_of(model: Model) -> ClassMoments:
    if model.manifest.adapted:
        raise ValueError(f"{model!r} is adapted already. Expected the model as it was trained")
    if model.class_moments is None or not (model.class_moments.within > 0).any():
        raise ValueError(
            f"{model!r} was trained on one recording of each surface, which do not say how far others of the "
            "same surface lie. Expected two or more"
        )
    return model.class_moments


def rows_of(
    model: Model, felt: Sequence[Recording], *, labelled: bool = True
) -> tuple[Samples, Samples, NDArray[np.intp]]:
    """Return the features of recordings, or of their touches, that have any.

    Parameters
    ----------
    model : Model
        Says which features.
    felt : sequence of Recording
        As `adapt` takes them.
    labelled : bool
        Whether their surfaces count.

    Returns
    -------
    X : ndarray of shape (n, n_columns)
        NaN where undefined.
    known : ndarray of shape (n, n_surfaces)
        One where a row is of a surface, zeros where it is not known.
    of : ndarray of int, shape (n,)
        The recording of each row.

    Raises
    ------
    ValueError
        If a recording is of a surface that the model does not know, of another rate or unit, or lacks a
        channel.
    """
    rows, known, of = [], [], []
    for i, recording in enumerate(felt):
        unlike = model.unlike(recording.fs, recording.unit, f"--resample {model.manifest.fs:g}")
        if unlike := unlike + model.other_axes(recording.channels):
            raise ValueError(f"{recording.recording_id}: {unlike[0]}")
        label = recording.surface if labelled else None
        if label is not None and label not in model.surfaces:
            raise ValueError(
                f"{recording.recording_id}: surface {label!r} is not in the model. Expected "
                f"one of {', '.join(model.surfaces)}, or references without labels (--unlabelled)"
            )
        for touch in model.cut(recording):
            rows.append(model.compute(touch).values)
            known.append([float(surface == label) for surface in model.surfaces])
            of.append(i)
    X = np.array(rows).reshape(-1, len(model.columns))
    valued = ~np.isnan(X).all(axis=1)
    return X[valued], np.array(known).reshape(len(X), -1)[valued], np.array(of, dtype=np.intp)[valued]


def _held_out(
    model: Model,
    X: Samples,
    known: Samples,
    of: NDArray[np.intp],
    class_moments: ClassMoments,
    found: Map,
    kind: str,
) -> tuple[Samples, Samples]:
    """Return decisions (n, n_surfaces) on each reference, and its strangeness (n,), under a map of others.

    Where they are of less than half of the surfaces, others are of other surfaces, as most that will be asked
    about are (and as they are likeliest under the map of all).
    """
    novelty, strange, decisions = model.novelty, np.empty(len(X)), np.empty(known.shape)
    likeliest = model.judge(X * found[0] + found[1])[0].argmax(axis=1)
    groups = np.where(known.any(axis=1), known.argmax(axis=1), likeliest)
    if not LIMITS.min_labelled <= len(np.unique(groups)) < len(model.surfaces) / 2:
        groups = of
    folds = np.unique(groups, return_inverse=True)[1] % LIMITS.n_folds
    for fold in range(folds.max() + 1):
        rest, asked = folds != fold, folds == fold
        n_rest = len(set(of[rest].tolist()))
        scale, shift = fit_map(model, X[rest], known[rest], class_moments, n_rest, kind)
        prepared, decisions[asked] = model.decide(X[asked] * scale + shift)
        strange[asked] = strangeness(novelty.kind, decisions[asked], prepared, novelty.nearness)
    return decisions, strange


def _reset(novelty: Novelty, strange: Samples, n_recordings: int) -> tuple[Novelty, str]:
    """Return when a recording of the new sensor is of no known surface, and how that was found.

    If references are enough for the rate of false alarms, they take the place of the recordings held out in
    training; else these are moved by as much as the median of references is stranger, decisions by a
    difference, distances by a factor.
    """
    if n_recordings >= max(LIMITS.min_unlabelled, least_held_out(novelty.false_alarms)):
        return replace(novelty, held_out=np.sort(strange)), "references"
    typical, before = float(np.median(strange)), float(np.median(novelty.held_out))
    if novelty.kind == "decision":
        moved = novelty.held_out + max(0.0, typical - before)
    else:
        moved = novelty.held_out * max(1.0, typical / max(before, 1e-300))
    return replace(novelty, held_out=moved), "recordings held out in training, moved by references"


def _mapped(model: Model, found: Map, novelty: Novelty, told: Mapping[str, Any], *, resampled: bool) -> Model:
    """Return a model whose features go through a map first."""
    scale, shift = found
    ranges = model.ranges
    low, median, high = ((edge - shift) / scale for edge in (ranges.low, ranges.median, ranges.high))
    facts = model.manifest
    unknown = {**facts.unknown, "threshold": novelty.threshold, "n": len(novelty.held_out)}
    changed: dict[str, Any] = {"adapted": told, "unknown": unknown}
    if resampled:
        changed["input"] = facts.input.model_copy(update={"resample": True})
    return replace(
        model,
        steps=[{"does": "affine", "scale": scale, "shift": shift}, *model.steps],
        novelty=novelty,
        ranges=Ranges(low, median, high),
        class_moments=None,
        manifest=facts.model_copy(update=changed),
    )


def with_references(model: Model, references: Dataset) -> Model:
    """Return a model whose sets follow recordings that were felt since its training.

    A sensor that drifts makes right surfaces less likely than they were when the model was trained.
    Recordings of known surfaces, felt now and then, tell how likely they are now. Each counts half with every
    `HALF_LIFE` recordings of its surface that came later; so do contacts held out in training, which all
    references followed. Answers and probabilities stay as they are.

    Parameters
    ----------
    model : Model
        Trained.
    references : Dataset
        Whole recordings of surfaces that it knows, not among those that trained it; in their order of
        repetitions where these are numbered, else all count the same.

    Raises
    ------
    ValueError
        If a surface is unknown to it, or a recording cannot be judged by it; the message names it.
    """
    table = metadata(references.entries)
    surfaces = table["surface"].to_numpy(dtype=str)
    if unknown := sorted({*surfaces.tolist()} - {*model.surfaces}):
        raise ValueError(
            f"{references.name}: {unknown[0]!r} is no surface of the model. Expected one of "
            f"{', '.join(model.surfaces)}"
        )
    rows, contacts = list[Samples](), list[int]()
    for i, recording in enumerate(references):
        unlike = model.unlike(recording.fs, recording.unit) + model.other_axes(recording.channels)
        if unlike:
            raise ValueError(f"{recording.recording_id}: {unlike[0]}")
        for touch in model.cut(recording) or (recording,):
            rows.append(model.compute(touch).values)
            contacts.append(i)
    numbered = table["repetition"].notna().all()
    ages = n_later(surfaces, table["repetition"].to_numpy()) if numbered else np.zeros(len(table))
    known = model.manifest.calibration
    later = conformities(
        model.decide(np.array(rows))[1],
        np.array([model.surfaces.index(name) for name in surfaces[contacts].tolist()]),
        contacts,
        model.calibration,
        correlation=known.get("correlation"),
        counts=recency(ages[contacts], HALF_LIFE),
    )
    share = float(recency(1 + ages.max(), HALF_LIFE))
    conformity = {
        kind: held_out.and_later(later[kind], share) if kind in later else held_out
        for kind, held_out in model.conformity.items()
    }
    told = {**known, "prediction_sets": {**facts_of(conformity), "references": references.input_hash}}
    return replace(
        model, conformity=conformity, manifest=model.manifest.model_copy(update={"calibration": told})
    )
