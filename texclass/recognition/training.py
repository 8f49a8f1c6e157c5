"""Training: selection by cross-validation, fit on all recordings, calibration on held-out recordings."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from timeit import repeat
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from texclass.classifiers.fitting import quiet_fits
from texclass.evaluation.accuracy import cluster_interval
from texclass.evaluation.axes import AxesOption, decide_axes
from texclass.evaluation.cost import CostMeter
from texclass.evaluation.feature_table import FeatureTable, cached_table, metadata
from texclass.evaluation.pipeline import DEFAULT_PIPELINE, PipelineDefinition, load_pipeline
from texclass.evaluation.protocols import find_protocol, make_splits
from texclass.evaluation.windows import add_overlapping_windows, cut_windows, is_testable, parents
from texclass.evaluation.workers import Progress, one_thread, run_parallel
from texclass.features.plan import Plan
from texclass.loaders import open_dataset
from texclass.loaders.dataset import Dataset
from texclass.provenance import versions
from texclass.recognition.array_form import (
    ArrayStep,
    apply_all,
    classifier_of,
    decide,
    estimators_in,
    steps_of,
)
from texclass.recognition.candidates import (
    Candidate,
    exportable_candidates,
    list_candidates,
    select_best,
    without_holdout,
    without_selection,
)
from texclass.recognition.contact_check import N_PER_SURFACE, ContactLimits
from texclass.recognition.held_out_predictions import HeldOutPredictions, predict_held_out
from texclass.recognition.holdout import (
    CHRONOLOGICAL_PROTOCOL,
    DEFAULT_FALSE_ALARMS,
    LIMITS,
    RANDOM_PROTOCOL,
    Holdout,
    select_protocol,
)
from texclass.recognition.model import Model
from texclass.recognition.model_files import Manifest, unsafe_classes
from texclass.recognition.novelty import (
    ClassMoments,
    FeatureRanges,
    NoveltyDetector,
    fit_class_distance,
    min_held_out,
    score_kind,
)
from texclass.recognition.prediction_sets import (
    HALF_LIFE,
    ConformalCalibration,
    calibrate_sets,
    manifest_entry,
    n_later_repetitions,
    recency_weights,
)
from texclass.recognition.probabilities import (
    DEFAULT_CORRELATION,
    Calibration,
    calibration_error_by_chance,
    expected_calibration_error,
    fit_calibration,
    fit_correlation,
    prior_calibration,
)
from texclass.recognition.sources.training_input import TrainingFiles
from texclass.recording import RecordingError, Samples
from texclass.tradeoff.recogniser import fit_recogniser, prune
from texclass.validation import check_positive

Entry = dict[str, Any]
"""Entry of a manifest, or arguments of a model."""


def train(
    dataset: Dataset | str | Path,
    pipeline: PipelineDefinition | str | Path | None = None,
    *,
    row: str | None = None,
    classifier: str | None = None,
    max_ms: float | None = None,
    max_features: int | None = None,
    max_kb: float | None = None,
    window_s: float | None = None,
    exportable: bool = False,
    axes: AxesOption = "auto",
    protocol: str | None = None,
    false_alarms: float = DEFAULT_FALSE_ALARMS,
    fs: float | None = None,
    unit: str | None = None,
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> Model:
    """Train a model: select feature subset and classifier, fit them on all recordings, and calibrate.

    The default pipeline has one row and one classifier, so there is nothing to select. With
    fewer than ten recordings (or runs) per surface, no candidate is selected by accuracy
    (`without_selection`). One recording per surface is enough to train, but then no recording can be held
    out: the model reports no accuracy, uses the probabilities of `prior_calibration`, and never reports a
    surface as unknown.

    Held-out recordings also determine the calibration, the prediction sets, the threshold for unknown
    surfaces, and the accuracy in the manifest, corrected for the selection. The same recordings, options and
    versions give the same model file, except for measured costs.

    Parameters
    ----------
    dataset : Dataset, str or Path
        Labelled recordings of at least two surfaces, or an argument of `open_dataset`.
    pipeline : PipelineDefinition, str or Path, optional
        Name of a shipped pipeline, path of a pipeline (TOML), or a definition. Default: `surfaces`, or
        `texclass` if a row, a classifier or a budget is given.
    row, classifier : str, optional
        Row and classifier of the pipeline (default: selected by cross-validation).
    max_ms : float, optional
        Largest latency per recording on this machine in ms, from samples to features (default: no limit); see
        `CostMeter.cached_model`.
    max_features : int, optional
        Largest number of columns at the classifier (default: no limit).
    max_kb : float, optional
        Largest size of an exported kernel discriminant in kB (default: no limit); see `KernelDiscriminant`.
        No effect on other classifiers.
    window_s : float, optional
        Length of a window in s (default: whole recordings).
    exportable : bool
        Use only features that `export_onnx` can compute from samples (default False). The manifest lists the
        excluded features, and the accuracy with all features.
    axes : {"auto", "merged", "separate"}
        Whether to merge the axes of the accelerometer (default "auto": as in the pipeline, or decided from
        the recordings if it leaves this open); see `decide_axes`. The model card states the decision.
    protocol : str, optional
        Protocol by which recordings are held out (default: see `select_protocol`). Use `chronological` to
        test on later repetitions, because sensors drift.
    false_alarms : float
        Accepted share of recordings of trained surfaces that are reported as unknown (default 0.05). With too
        few held-out recordings, no surface is reported as unknown; a rate below the default then raises an
        error.
    fs : float, optional
        Sampling rate in Hz of files that do not state it.
    unit : str, optional
        Unit of the acceleration in files that do not state it.
    n_jobs : int
        Number of processes (default 1).
    skip_bad : bool
        Whether to leave out invalid recordings, instead of stopping at the first one (default False).
    progress : callable, optional
        Function called with (n_finished, n_total, task).

    Returns
    -------
    Model

    Raises
    ------
    RecordingError
        If a recording is invalid, or all are.
    ValueError
        If the classifier needs several recordings per surface, the protocol cannot hold recordings out, a
        name is unknown, or no candidate is within the budget.

    Examples
    --------
    >>> train("simulated", row="Movement", window_s=1.0).save("surfaces.skops")  # doctest: +SKIP
    """
    check_positive(max_ms=max_ms, max_features=max_features, max_kb=max_kb)
    recordings = dataset if isinstance(dataset, Dataset) else open_dataset(dataset, fs=fs, unit=unit)
    # A row, classifier or budget without a pipeline refers to `texclass`, whose columns can be selected.
    has_selection = row or classifier or max_ms or max_features
    name = pipeline or ("texclass" if has_selection else DEFAULT_PIPELINE)
    definition = name if isinstance(name, PipelineDefinition) else load_pipeline(name)
    channels, axes_reason = decide_axes(recordings, definition.channels, axes)
    definition = definition.model_copy(update={"channels": channels})
    recordings = recordings.with_phase_settings(definition.phase_settings.changes, override=False)
    work: dict[str, Any] = {"n_jobs": n_jobs, "progress": progress}
    if window_s is not None:
        recordings = cut_windows(recordings, window_s, **work)
    recordings = add_overlapping_windows(recordings, definition.overlap)
    entries = metadata(recordings.entries)
    selected_protocol, reason = select_protocol(protocol, definition.protocol.name, entries, false_alarms)
    holdout = Holdout(entries, selected_protocol, reason, protocol is not None, definition.seed)
    # Impossible rates are refused before the features are computed.
    holdout.check_rate(false_alarms)
    table = cached_table(
        recordings, *definition.needed, channels=definition.channels, skip_bad=skip_bad, **work
    )
    holdout = replace(holdout, table=table.frame)
    meter = CostMeter.from_dataset(recordings, table.frame["recording_id"].tolist(), definition.channels)
    limits: dict[str, Any] = {"max_ms": max_ms, "max_features": max_features, "max_kb": max_kb}
    candidates = list_candidates(definition, table, meter, row=row, classifier=classifier, **limits)
    candidate, held_out, parts, accuracy = _select(candidates, holdout, exportable=exportable, **work)
    half_predictions = _predict_halves(candidate, holdout)
    accuracy |= _later_entry(accuracy, half_predictions, holdout, len(parts["surfaces"]))
    calibration, set_calibrations, calibration_entry = _calibrate(held_out, half_predictions, holdout)
    scores, drift_factor = _held_out_novelty(candidate, held_out, half_predictions, holdout, false_alarms)
    plan: Plan = parts["plan"]
    X, y = replace(candidate, plan=plan).training_set(table.frame)
    p_threshold = holdout.p_threshold(false_alarms, len(scores))
    novelty = _novelty_detector(candidate, parts["steps"], X, y, scores, p_threshold)
    manifest = Manifest(
        **_recordings_entries(recordings, meter, table, plan),
        surfaces=parts["surfaces"],
        pipeline=_pipeline_entry(definition, candidate, meter, holdout.shortage, max_kb, max_ms)
        | ({"axes": axes_reason} if axes_reason else {}),
        accuracy=accuracy,
        calibration=calibration_entry,
        unknown=_novelty_entry(novelty, false_alarms, drift_factor),
        cost=_cost_entry(parts, meter, X[:1]),
        contact=_contact_entry(recordings, table.frame),
        window_s=window_s,
        versions=versions("numpy", "scipy", "scikit-learn", "skops", "PyWavelets", "librosa"),
    )
    return Model(
        **parts,
        calibration=calibration,
        novelty=novelty,
        ranges=FeatureRanges.from_features(X),
        manifest=manifest,
        left_out=table.left_out,
        set_calibrations=set_calibrations,
        class_moments=ClassMoments.from_features(X, y),
    )


def _select(
    candidates: Sequence[Candidate],
    holdout: Holdout,
    *,
    exportable: bool,
    n_jobs: int,
    progress: Progress | None,
) -> tuple[Candidate, HeldOutPredictions, Entry, Entry]:
    """Return the best candidate, its held-out predictions, arguments of its model, and the accuracy entry."""
    candidates = without_selection(candidates) if holdout.shortage else candidates
    candidates = candidates if holdout.splits else without_holdout(candidates)
    others, not_exportable = list[Candidate](), tuple[str, ...]()
    if exportable:
        candidates, others, not_exportable = exportable_candidates(candidates)
    calls = [partial(predict_held_out, one, holdout.table, holdout.splits) for one in (*candidates, *others)]
    n_jobs = n_jobs if len(calls) > 1 else 1
    predictions = list(
        run_parallel(calls, n_jobs=n_jobs, progress=progress, stage="candidates", total=len(calls))
    )
    clusters = holdout.protocol.clusters(holdout.table)[predictions[0].rows]
    pairs = list(zip(candidates, predictions, strict=False))
    candidate, held_out, parts, estimate = _fit_best(pairs, holdout, clusters)
    accuracy = holdout.accuracy_entry(estimate, len(set(clusters)))
    if others:
        hits = np.array([one.hits for one in predictions[len(candidates) :]])
        _, with_all = select_best(hits, [c.n_columns for c in others], clusters, holdout.seed)
        accuracy |= {"not_exportable": list(not_exportable), "with_all_features": with_all.mean}
    return candidate, held_out, parts, accuracy


def _fit_best(
    pairs: Sequence[tuple[Candidate, HeldOutPredictions]], holdout: Holdout, clusters: NDArray[Any]
) -> tuple[Candidate, HeldOutPredictions, Entry, Entry]:
    """Fit the best candidate that can be saved; return it with predictions, model arguments and accuracy."""
    remaining = list(pairs)
    while remaining:
        best, estimate = 0, dict[str, Any]()
        if len(clusters):
            hits = np.array([held_out.hits for _, held_out in remaining])
            n_columns = [candidate.n_columns for candidate, _ in remaining]
            best, accuracy = select_best(hits, n_columns, clusters, holdout.seed)
            low, high = accuracy.interval
            estimate = {"mean": accuracy.mean, "low": low, "high": high, "n_tested": accuracy.n_tested}
        candidate, held_out = remaining[best]
        parts = fit_candidate(candidate, holdout.table)
        estimators = estimators_in((parts["steps"], parts["classifier"]))
        if not (unsafe := unsafe_classes({"estimators": estimators}) if estimators else []):
            return candidate, held_out, parts, estimate | {"n_candidates": len(remaining)}
        remaining = [pair for pair in remaining if pair[0].classifier_name != candidate.classifier_name]
    raise ValueError(
        f"{candidate} contains {unsafe[0]}, which is not on the allow-list of model files. "
        "Use another classifier"
    )


def fit_candidate(candidate: Candidate, table: pd.DataFrame) -> Entry:
    """Fit a candidate to a feature table, and return plan, surfaces, steps and classifier of a model.

    Parameters
    ----------
    candidate : Candidate
        Feature subset and classifier.
    table : DataFrame
        Feature table with the surfaces.
    """
    X, y = candidate.training_set(table)
    with quiet_fits(), one_thread():  # the number of threads would change the last digits
        recogniser = prune(fit_recogniser(candidate.plan, X, y, candidate.steps))
        plan: Plan = recogniser[0].plan_
        X, y = replace(candidate, plan=plan).training_set(table)
        steps = [array_step for _, step in recogniser.steps[1:-1] for array_step in steps_of(step)]
        classifier = classifier_of(recogniser[-1], (apply_all(steps, X), y))
    surfaces = tuple(str(name) for name in recogniser.classes_)
    return {"plan": plan, "surfaces": surfaces, "steps": steps, "classifier": classifier}


def _predict_halves(candidate: Candidate, holdout: Holdout) -> list[HeldOutPredictions]:
    """Return the predictions from the earlier half of the recordings for the later half, and vice versa."""
    if holdout.shortage and score_kind(candidate.classifier) == "distance":
        return []  # half of few recordings is too few to fit such a classifier
    return [predict_held_out(candidate, holdout.table, splits) for splits in holdout.halves]


def _later_entry(
    accuracy: Entry, halves: Sequence[HeldOutPredictions], holdout: Holdout, n_classes: int
) -> Entry:
    """Return the expected accuracy on later recordings, as an entry of the accuracy."""
    clusters = holdout.protocol.clusters(holdout.table)
    entries = []
    for half in halves:
        low, high = cluster_interval(half.hits, clusters[half.rows])
        entries.append({"mean": float(half.hits.mean()), "low": low, "high": high})
    later = holdout.later_entry(accuracy, entries, n_classes)
    return {"later_recordings": later} if later else {}


def _calibrate(
    held_out: HeldOutPredictions, halves: Sequence[HeldOutPredictions], holdout: Holdout
) -> tuple[Calibration, dict[str, ConformalCalibration], Entry]:
    """Return the calibration of probabilities and of prediction sets, and the manifest entry of both."""
    tests, decisions = holdout.table.iloc[held_out.rows], held_out.decisions
    n_recordings = int(is_testable(holdout.table).sum())
    calibration, method = prior_calibration(decisions.shape[1], n_recordings), "prior temperature"
    if len(tests):
        calibration, method = fit_calibration(decisions, held_out.labels), "temperature"
    p = calibration(decisions)
    window_entry = _window_entry(p, held_out, tests)
    correlation = window_entry.get("correlation")
    set_calibrations = _calibrate_sets(held_out, calibration, correlation, holdout)
    shift = 0.0
    for half in halves:
        half_calibrations = _calibrate_sets(half, calibration, correlation, holdout)
        for kind in set_calibrations.keys() & half_calibrations.keys():
            set_calibrations[kind] = set_calibrations[kind].worst_case(half_calibrations[kind])
    if not halves and holdout.shortage and holdout.is_random_order:
        shift = LIMITS.later_shift
        set_calibrations = {kind: one.moved(-shift) for kind, one in set_calibrations.items()}
    entry = {
        "method": method,
        **vars(calibration),
        "n": len(p),
        **window_entry,
        "prediction_sets": {
            **manifest_entry(set_calibrations),
            "n_halves": len(halves),
            "shift": shift,
            **({"later_coverage": list(LIMITS.later_coverage)} if holdout.shortage and len(tests) else {}),
        },
    }
    if len(tests):
        entry["expected_error"] = expected_calibration_error(p.max(axis=1), held_out.hits)
        entry["error_by_chance"] = calibration_error_by_chance(p.max(axis=1))
    return calibration, set_calibrations, entry | _exploration_entry(p, held_out, holdout.table)


def _calibrate_sets(
    held_out: HeldOutPredictions, calibration: Calibration, correlation: float | None, holdout: Holdout
) -> dict[str, ConformalCalibration]:
    """Return the calibration of prediction sets from one hold-out."""
    tests = holdout.table.iloc[held_out.rows]
    ages = np.zeros(len(tests), dtype=np.intp)
    if holdout.protocol.name == CHRONOLOGICAL_PROTOCOL:
        ages = n_later_repetitions(tests["surface"].to_numpy(dtype=str), tests["repetition"].to_numpy())
    return calibrate_sets(
        held_out.decisions,
        held_out.labels,
        parents(tests),
        calibration,
        correlation=correlation,
        weights=recency_weights(ages, HALF_LIFE),
    )


def _window_entry(p: Samples, held_out: HeldOutPredictions, tests: pd.DataFrame) -> dict[str, float]:
    """Return the correlation between windows of one recording; empty if each recording has one window."""
    recordings = parents(tests).to_numpy()
    n_contacts = len(set(recordings))
    # Without windows, a recording occurs more than once if the protocol tests it in several folds.
    if "parent" not in tests or n_contacts == len(recordings):
        return {}
    return {"correlation": fit_correlation(p, held_out.labels, recordings), "n_contacts": n_contacts}


def _exploration_entry(p: Samples, held_out: HeldOutPredictions, frame: pd.DataFrame) -> Entry:
    """Return the confusion matrix of probabilities, and the correlation between repetitions, for exploration.

    Row m of the confusion matrix is the mean probability of each surface for recordings of surface m. One
    uniform answer is added to each row, so that the probabilities from few recordings are not 0 or 1.
    """
    n_classes = p.shape[1]
    is_true = np.eye(n_classes)[held_out.labels]
    confusion = (is_true.T @ p + 1 / n_classes) / (is_true.sum(axis=0)[:, None] + 1)
    # Repetitions by one operator in one session.
    numbers = frame.groupby(["surface", "operator", "session"], dropna=False).ngroup()
    group = numbers.to_numpy()[held_out.rows]
    has_repetitions = len(set(group)) < len(group)
    correlation = fit_correlation(p, held_out.labels, group) if has_repetitions else DEFAULT_CORRELATION
    return {"confusion": confusion.round(4).tolist(), "repetition_correlation": correlation}


def _held_out_novelty(
    candidate: Candidate,
    held_out: HeldOutPredictions,
    halves: Sequence[HeldOutPredictions],
    holdout: Holdout,
    false_alarms: float,
) -> tuple[Samples, float]:
    """Return the held-out novelty scores, ascending, and the factor by which drift increases them.

    The scores are those of the hold-out with the largest threshold: the protocol's, or a half that was
    predicted from the other half. Random folds alone do not reflect that later recordings differ.

    Distances decrease with the number of training recordings, so those between halves would reflect the
    smaller training set as well. The distances in random folds are therefore multiplied by the drift factor:
    the median distance between halves, divided by the median in a random split into halves.
    """
    if len(held_out.rows) < (n_needed := min_held_out(false_alarms)):
        return np.empty(0), 1.0
    if not halves:
        return np.sort(held_out.novelty), 1.0
    if score_kind(candidate.classifier) == "decision":
        scores = [one.novelty for one in (held_out, *halves) if len(one.rows) >= n_needed]
        return np.sort(max(scores, key=lambda one: float(np.quantile(one, 1 - false_alarms)))), 1.0
    random, table = find_protocol(RANDOM_PROTOCOL), holdout.table
    is_chronological = holdout.protocol.name == CHRONOLOGICAL_PROTOCOL
    random_halves = predict_held_out(candidate, table, random.split(table, 2, holdout.seed)).novelty
    folds = held_out
    if is_chronological:
        folds = predict_held_out(candidate, table, make_splits(random, table, holdout.seed))
    between_halves = [*halves, held_out] if is_chronological else halves
    median = float(np.median(np.concatenate([one.novelty for one in between_halves])))
    factor = max(1.0, median / max(float(np.median(random_halves)), 1e-300))
    return np.sort(factor * folds.novelty), factor


def _novelty_detector(
    candidate: Candidate,
    steps: Sequence[ArrayStep],
    X: Samples,
    y: NDArray[Any],
    held_out: Samples,
    p_threshold: float,
) -> NoveltyDetector:
    """Return the detector of a candidate trained on X and y, from held-out novelty scores."""
    kind, distance = score_kind(candidate.classifier), None
    if kind == "distance":
        with one_thread():
            distance = fit_class_distance(apply_all(steps, X), np.unique(y, return_inverse=True)[1])
    return NoveltyDetector(kind, held_out, p_threshold, distance)


def _novelty_entry(novelty: NoveltyDetector, false_alarms: float, drift_factor: float) -> Entry:
    return {
        "score": novelty.kind,
        "false_alarms": false_alarms,
        "p_threshold": novelty.false_alarms,
        "threshold": novelty.threshold if len(novelty.held_out) else None,
        "n": len(novelty.held_out),
        "drift_factor": drift_factor,
    }


def _contact_entry(dataset: Dataset, frame: pd.DataFrame) -> dict[str, float]:
    """Return the limits of a contact, from a few recordings of each surface."""
    usable = frame[is_testable(frame)]
    chosen = {
        names.iloc[i]
        for _, names in usable.groupby("surface")["recording_id"]
        for i in np.linspace(0, len(names) - 1, N_PER_SURFACE).astype(int)
    }
    entries = [entry for entry in dataset.entries if entry.recording_id in chosen]
    limits = ContactLimits.from_recordings(dataset.load(entry) for entry in entries)
    return {} if limits is None else limits._asdict()


def _cost_entry(parts: Entry, meter: CostMeter, row: Samples) -> dict[str, float]:
    """Return the latency of each stage in ms on this machine."""
    call = partial(decide, parts["steps"], parts["classifier"], row)
    return {
        "segmentation_ms": meter.segmentation_ms,
        "features_ms": meter.measure(parts["plan"])[0],
        "classifier_ms": 1e3 * min(repeat(call, number=1, repeat=5)),
    }


def _pipeline_entry(
    definition: PipelineDefinition,
    candidate: Candidate,
    meter: CostMeter,
    shortage: str,
    max_kb: float | None,
    max_ms: float | None,
) -> dict[str, str]:
    limits = [f"{max_kb:g} kB of a kernel"] if max_kb else []
    limits += [f"{max_ms:g} ms on {meter.cached_model(definition.features).machine}"] if max_ms else []
    return {
        "name": definition.name,
        "hash": definition.hash,
        "feature_set": definition.features.name,
        "row": candidate.row,
        "classifier": candidate.classifier_name,
        **({"shortage": shortage} if shortage else {}),
        **({"budget": ", ".join(limits)} if limits else {}),
    }


def _recordings_entries(dataset: Dataset, meter: CostMeter, table: FeatureTable, plan: Plan) -> Entry:
    """Return the entries of a manifest that describe the training recordings and the required input."""
    example = meter.recordings[0]
    if other_rates := {recording.fs for recording in meter.recordings} - {example.fs}:
        raise RecordingError(
            f"{dataset.name}: sampling rates differ ({example.fs:g} and {other_rates.pop():g} Hz). Expected "
            "one rate: convert the recordings with --resample HZ"
        )
    movements = [r.phases.movement for r in meter.recordings if r.phases and r.phases.movement]
    members = [member for _, part in plan.parts for member in part.members]
    peaks = [np.abs(r.acceleration - np.median(r.acceleration, axis=0)).max() for r in meter.recordings]
    return {
        "features": tuple(dict.fromkeys(member.name for member in members)),
        "phases": tuple(sorted({member.feature.phase for member in members})),
        "fs": example.fs,
        "auxiliary_fs": {k: v for k, v in example.auxiliary_fs.items() if k in plan.signals},
        "native_fs": min(r.native_fs for r in meter.recordings if r.native_fs is not None),
        "unit": example.unit,
        "phase_settings": example.phase_settings,
        "input": TrainingFiles.from_dataset(dataset, example),
        "peak_acceleration": float(max(peaks)) or None,
        "shortest_s": min(((stop - start) / example.fs for start, stop in movements), default=None),
        "trained_on": {
            "name": dataset.name,
            "hash": dataset.input_hash,
            "n_recordings": int(parents(table.frame).nunique()),
            "n_windows": len(table.frame),
            "left_out": [item.recording_id for item in table.left_out],
        },
    }
