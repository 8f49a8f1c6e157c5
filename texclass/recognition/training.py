"""Recordings and a pipeline in, a trained model out; what is chosen is chosen by cross-validation alone."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from timeit import repeat
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from texclass.classifiers.fitting import quiet_fits
from texclass.evaluation.cost import CostMeter
from texclass.evaluation.feature_table import FeatureTable, cached_table, metadata
from texclass.evaluation.pipeline import PipelineDefinition, load_pipeline
from texclass.evaluation.protocols import find_protocol, splits_of
from texclass.evaluation.windows import asked, cut_windows, overlapping, parents
from texclass.evaluation.workers import Progress, each, one_thread
from texclass.features.plan import Plan
from texclass.loaders import open_dataset
from texclass.loaders.dataset import Dataset
from texclass.provenance import versions
from texclass.recognition.array_form import Part, apply_all, classifier_of, decide, estimators_in, steps_of
from texclass.recognition.candidates import (
    Candidate,
    HeldOut,
    accuracy_of_choice,
    candidates_of,
    hold_out,
    untested,
    without_choice,
)
from texclass.recognition.candidates import exportable as with_graph
from texclass.recognition.conformal import HALF_LIFE, Conformity, conformities, facts_of, n_later, recency
from texclass.recognition.holding_out import AT_RANDOM, FALSE_ALARMS, IN_TIME, HoldingOut, holding_out
from texclass.recognition.model import Model
from texclass.recognition.model_files import Manifest, unsafe_classes
from texclass.recognition.probabilities import (
    CORRELATION,
    Calibration,
    calibration_error_of_chance,
    expected_calibration_error,
    fit_calibration,
    fit_correlation,
    prior_calibration,
)
from texclass.recognition.sources.training_input import TrainingFiles
from texclass.recognition.unknown import (
    ClassMoments,
    Novelty,
    Ranges,
    fit_nearness,
    kind_for,
    least_held_out,
)
from texclass.recording import RecordingError, Samples
from texclass.tradeoff.recogniser import fit_recogniser, prune
from texclass.validation import check_positive

Facts = dict[str, Any]
"""What a manifest states."""


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
    protocol: str | None = None,
    false_alarms: float = FALSE_ALARMS,
    fs: float | None = None,
    unit: str | None = None,
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> Model:
    """Train a model: select feature subset and classifier, fit them on all recordings, and calibrate.

    The default pipeline has one row and one classifier, so nothing is selected (`pipeline_for`); nor is
    anything below ten recordings (or runs) per surface (`without_choice`). One recording per surface is
    enough to train. Then none can be held out: the model states no accuracy, its probabilities are those of
    `prior_calibration`, and no recording is unknown.

    Held-out recordings also give the calibration, the prediction sets, the threshold for unknown surfaces,
    and the accuracy in the manifest, corrected for the selection. The same recordings, options and versions
    give the same model file, except for measured costs.

    Parameters
    ----------
    dataset : Dataset, str or Path
        Labelled recordings of at least two surfaces, or an argument of `open_dataset`.
    pipeline : PipelineDefinition, str or Path, optional
        Name of a shipped pipeline, path of a pipeline (TOML), or a definition. Default: `surfaces`, or
        `coarse` with a turn rate; `texclass` if a row, a classifier or a budget is given.
    row, classifier : str, optional
        Row and classifier of the pipeline (default: selected by cross-validation).
    max_ms : float, optional
        Largest latency per recording on this machine in ms, from samples to features; see `CostMeter.kept`.
    max_features : int, optional
        Largest number of columns at the classifier.
    max_kb : float, optional
        Largest size of an exported kernel discriminant in kB; see `KernelDiscriminant`. No effect on other
        classifiers.
    window_s : float, optional
        Length of a window in s (default: whole recordings).
    exportable : bool
        Use only features that `export_onnx` can compute from samples (default False). The manifest lists the
        others, and the accuracy with them.
    protocol : str, optional
        Protocol by which recordings are held out (default: see `holding_out`). `chronological` tests on later
        repetitions, as sensors drift.
    false_alarms : float
        Accepted rate of trained surfaces that are reported as unknown (default 0.05). With too few held-out
        recordings no surface is unknown, unless a smaller rate than the default is given.
    fs : float, optional
        Sampling rate in Hz of files that do not state it.
    unit : str, optional
        Unit of the acceleration in files that do not state it.
    n_jobs : int
        Number of processes (default 1).
    skip_bad : bool
        Leave out invalid recordings instead of stopping at the first (default False).
    progress : callable, optional
        Called with (done, total, what).

    Returns
    -------
    Model

    Raises
    ------
    RecordingError
        At a bad recording, or if none is left.
    ValueError
        If one recording of a surface is to train what needs several, the protocol cannot hold recordings out,
        a name is unknown, or nothing is affordable.

    Examples
    --------
    >>> train("simulated", row="Movement", window_s=1.0).save("surfaces.skops")  # doctest: +SKIP
    """
    check_positive(max_ms=max_ms, max_features=max_features, max_kb=max_kb)
    felt = dataset if isinstance(dataset, Dataset) else open_dataset(dataset, fs=fs, unit=unit)
    # What is named without a pipeline is of `texclass`: its columns can be selected.
    is_named = row or classifier or max_ms or max_features
    named = pipeline or ("texclass" if is_named else pipeline_for(felt))
    defined = named if isinstance(named, PipelineDefinition) else load_pipeline(named)
    felt = felt.with_phase_settings(defined.phase_settings.changes, override=False)
    work: dict[str, Any] = {"n_jobs": n_jobs, "progress": progress}
    if window_s is not None:
        felt = cut_windows(felt, window_s, **work)
    felt = overlapping(felt, defined.overlap)
    known = metadata(felt.entries)
    held_out_by, why = holding_out(protocol, defined.protocol.name, known, false_alarms)
    tests = HoldingOut(known, held_out_by, why, protocol is not None, defined.seed)
    # Before the features: what is impossible should not cost an extraction.
    tests.check_vouched_for(false_alarms)
    table = cached_table(felt, *defined.needed, channels=defined.channels, skip_bad=skip_bad, **work)
    tests = replace(tests, table=table.frame)
    meter = CostMeter.on(felt, table.frame["recording_id"].tolist(), defined.channels)
    limits: dict[str, Any] = {"max_ms": max_ms, "max_features": max_features, "max_kb": max_kb}
    candidates = candidates_of(defined, table, meter, row=row, classifier=classifier, **limits)
    chosen, held_out, fitted, accuracy = _choice(candidates, tests, exportable=exportable, **work)
    calibration, conformity, calibrated = _calibrated(held_out, tests)
    far, stretch = _distances(chosen, held_out, tests, false_alarms)
    plan: Plan = fitted["plan"]
    X, y = replace(chosen, plan=plan).trained_on(table.frame)
    novelty = _novelty(chosen, fitted["steps"], X, y, far, tests.level(false_alarms, len(far)))
    manifest = Manifest(
        **_recordings(felt, meter, table, plan),
        surfaces=fitted["surfaces"],
        pipeline=_pipeline(defined, chosen, meter, tests.few, max_kb, max_ms),
        accuracy=accuracy,
        calibration=calibrated,
        unknown=_unknown(novelty, false_alarms, stretch),
        cost=_cost(fitted, meter, X[:1]),
        window_s=window_s,
        versions=versions("numpy", "scipy", "scikit-learn", "skops", "PyWavelets", "librosa"),
    )
    return Model(
        **fitted,
        calibration=calibration,
        novelty=novelty,
        ranges=Ranges.of(X),
        manifest=manifest,
        left_out=table.left_out,
        conformity=conformity,
        class_moments=ClassMoments.of(X, y),
    )


def _choice(
    candidates: Sequence[Candidate],
    tests: HoldingOut,
    *,
    exportable: bool,
    n_jobs: int,
    progress: Progress | None,
) -> tuple[Candidate, HeldOut, Facts, Facts]:
    """Return the best candidate, what it said, its parts of a model, and what the manifest says of it."""
    candidates = without_choice(candidates) if tests.few else candidates
    candidates = candidates if tests.splits else untested(candidates)
    candidates, others, lacking = with_graph(candidates) if exportable else (candidates, [], ())
    calls = [partial(hold_out, one, tests.table, tests.splits) for one in (*candidates, *others)]
    n_jobs = n_jobs if len(calls) > 1 else 1
    said = list(each(calls, n_jobs=n_jobs, progress=progress, what="candidates", total=len(calls)))
    clusters = tests.protocol.clusters(tests.table)[said[0].rows]
    tried = list(zip(candidates, said, strict=False))
    candidate, held_out, fitted, expected = _best(tried, tests, clusters)
    accuracy = tests.promised(expected, len(set(clusters)), len(fitted["surfaces"]))
    if others:
        hits = np.array([one.hits for one in said[len(candidates) :]])
        _, with_all = accuracy_of_choice(hits, [c.n_columns for c in others], clusters, tests.seed)
        accuracy |= {"without_graph": list(lacking), "with_all_features": with_all.mean}
    return candidate, held_out, fitted, accuracy


def _best(
    tried: Sequence[tuple[Candidate, HeldOut]], tests: HoldingOut, clusters: NDArray[Any]
) -> tuple[Candidate, HeldOut, Facts, Facts]:
    """Return the best candidate that can be saved, its parts of a model, and its expected accuracy."""
    left = list(tried)
    while left:
        best, expected = 0, dict[str, Any]()
        if len(clusters):
            hits = np.array([held_out.hits for _, held_out in left])
            best, accuracy = accuracy_of_choice(hits, [c.n_columns for c, _ in left], clusters, tests.seed)
            low, high = accuracy.interval
            expected = {"mean": accuracy.mean, "low": low, "high": high, "n_tested": accuracy.n_tested}
        candidate, held_out = left[best]
        fitted = fitted_on(candidate, tests.table)
        estimators = estimators_in((fitted["steps"], fitted["classifier"]))
        if not (unsafe := unsafe_classes({"estimators": estimators}) if estimators else []):
            return candidate, held_out, fitted, expected | {"n_candidates": len(left)}
        left = [pair for pair in left if pair[0].classifier_name != candidate.classifier_name]
    raise ValueError(f"{candidate} holds {unsafe[0]}. Expected a classifier whose file can be loaded safely")


def fitted_on(candidate: Candidate, table: pd.DataFrame) -> Facts:
    """Fit a candidate on all rows of a table, and return what a model computes with it: its parts, pruned."""
    X, y = candidate.trained_on(table)
    with quiet_fits(), one_thread():  # the number of threads would change last digits
        recogniser = prune(fit_recogniser(candidate.plan, X, y, candidate.steps))
        plan: Plan = recogniser[0].plan_
        X, y = replace(candidate, plan=plan).trained_on(table)
        steps = [part for _, step in recogniser.steps[1:-1] for part in steps_of(step)]
        classifier = classifier_of(recogniser[-1], (apply_all(steps, X), y))
    surfaces = tuple(str(name) for name in recogniser.classes_)
    return {"plan": plan, "surfaces": surfaces, "steps": steps, "classifier": classifier}


def _calibrated(held_out: HeldOut, tests: HoldingOut) -> tuple[Calibration, dict[str, Conformity], Facts]:
    """Return how decisions become probabilities, and sets, and what the manifest says of both."""
    told, decisions = tests.table.iloc[held_out.rows], held_out.decisions
    n_apart = int(asked(tests.table).sum())
    calibration, how = prior_calibration(decisions.shape[1], n_apart), "prior temperature"
    if len(told):
        calibration, how = fit_calibration(decisions, held_out.labels), "temperature"
    p = calibration(decisions)
    of_contacts = _of_contacts(p, held_out, told)
    ages = np.zeros(len(told), dtype=np.intp)
    if tests.protocol.name == IN_TIME:
        ages = n_later(told["surface"].to_numpy(dtype=str), told["repetition"].to_numpy())
    conformity = conformities(
        decisions,
        held_out.labels,
        parents(told),
        calibration,
        correlation=of_contacts.get("correlation"),
        counts=recency(ages, HALF_LIFE),
    )
    facts = {
        "method": how,
        **vars(calibration),
        "n": len(p),
        **of_contacts,
        "prediction_sets": facts_of(conformity),
    }
    if len(told):
        facts["expected_error"] = expected_calibration_error(p.max(axis=1), held_out.hits)
        facts["error_of_chance"] = calibration_error_of_chance(p.max(axis=1))
    return calibration, conformity, facts | _of_gestures(p, held_out, tests.table)


def _of_contacts(p: Samples, held_out: HeldOut, told: pd.DataFrame) -> dict[str, float]:
    """Return how windows of one recording agree by their recording; nothing where each has but one."""
    contacts = parents(told).to_numpy()
    n_contacts = len(set(contacts))
    if "parent" not in told or n_contacts == len(contacts):  # several starts ask about a recording again
        return {}
    return {"correlation": fit_correlation(p, held_out.labels, contacts), "n_contacts": n_contacts}


def _of_gestures(p: Samples, held_out: HeldOut, frame: pd.DataFrame) -> Facts:
    """Return what is answered where a surface is felt, and how answers agree by the hand that repeats it.

    Of the confusion, row m is the mean probability of each surface where m was felt; one answer that knows
    nothing is added to each, so that few recordings promise little.
    """
    n_classes = p.shape[1]
    felt = np.eye(n_classes)[held_out.labels]
    confusion = (felt.T @ p + 1 / n_classes) / (felt.sum(axis=0)[:, None] + 1)
    hands = frame.groupby(["surface", "operator", "session"], dropna=False).ngroup()
    same = hands.to_numpy()[held_out.rows]
    repeated = len(set(same)) < len(same)
    repetition = fit_correlation(p, held_out.labels, same) if repeated else CORRELATION
    return {"confusion": confusion.round(4).tolist(), "repetition": repetition}


def _distances(
    chosen: Candidate, held_out: HeldOut, tests: HoldingOut, false_alarms: float
) -> tuple[Samples, float]:
    """Return how far held-out recordings lie, shape (n,), ascending, and by what drift stretched that.

    Distances shrink with every recording that trains: those of blocks in time, for which a half trains,
    tell of the smaller half and of drift in one. Folds at random tell of neither. Their distances are
    stretched by what later recordings are farther, in the median, than as many drawn at random.
    """
    if len(held_out.rows) < least_held_out(false_alarms):
        return np.empty(0), 1.0
    if tests.protocol.name != IN_TIME or kind_for(chosen.classifier) != "distance":
        return np.sort(held_out.strange), 1.0
    at_random, table = find_protocol(AT_RANDOM), tests.table
    halves = hold_out(chosen, table, at_random.split(table, 2, tests.seed)).strange
    folds = hold_out(chosen, table, splits_of(at_random, table, tests.seed)).strange
    stretch = max(1.0, float(np.median(held_out.strange) / max(np.median(halves), 1e-300)))
    return np.sort(stretch * folds), stretch


def _novelty(
    chosen: Candidate, steps: Sequence[Part], X: Samples, y: NDArray[Any], far: Samples, level: float
) -> Novelty:
    """Return when a surface is unknown to a candidate that was trained on X and y."""
    kind, near = kind_for(chosen.classifier), None
    if kind == "distance":
        with one_thread():
            near = fit_nearness(apply_all(steps, X), np.unique(y, return_inverse=True)[1])
    return Novelty(kind, far, level, near)


def _unknown(novelty: Novelty, false_alarms: float, stretch: float) -> Facts:
    """Return what the manifest states of unknown surfaces."""
    return {
        "score": novelty.kind,
        "false_alarms": false_alarms,
        "level": novelty.false_alarms,
        "threshold": novelty.threshold if len(novelty.held_out) else None,
        "n": len(novelty.held_out),
        "stretch": stretch,
    }


def _cost(fitted: Facts, meter: CostMeter, row: Samples) -> dict[str, float]:
    """Return what the manifest states of milliseconds here, the classifier's on one row of features."""
    call = partial(decide, fitted["steps"], fitted["classifier"], row)
    return {
        "segmentation_ms": meter.segmentation_ms,
        "features_ms": meter.measured(fitted["plan"])[0],
        "classifier_ms": 1e3 * min(repeat(call, number=1, repeat=5)),
    }


def _pipeline(
    defined: PipelineDefinition,
    chosen: Candidate,
    meter: CostMeter,
    few: str,
    max_kb: float | None,
    max_ms: float | None,
) -> dict[str, str]:
    """Return what the manifest states of what was trained, within which limits."""
    limits = [f"{max_kb:g} kB of a kernel"] if max_kb else []
    limits += [f"{max_ms:g} ms on {meter.kept(defined.features).machine}"] if max_ms else []
    return {
        "name": defined.name,
        "hash": defined.hash,
        "feature_set": defined.features.name,
        "row": chosen.row,
        "classifier": chosen.classifier_name,
        **({"few": few} if few else {}),
        **({"budget": ", ".join(limits)} if limits else {}),
    }


def _recordings(felt: Dataset, meter: CostMeter, table: FeatureTable, plan: Plan) -> Facts:
    """Return what the manifest states of the recordings: those trained on, and which ones a model is for."""
    like = meter.recordings[0]
    if others := {recording.fs for recording in meter.recordings} - {like.fs}:
        raise RecordingError(f"{felt.name}: rates are {like.fs:g} and {others.pop():g} Hz. Expected one")
    spans = [r.phases.movement for r in meter.recordings if r.phases and r.phases.movement]
    members = [member for _, part in plan.parts for member in part.members]
    sizes = [np.abs(r.acceleration - np.median(r.acceleration, axis=0)).max() for r in meter.recordings]
    return {
        "features": tuple(dict.fromkeys(member.name for member in members)),
        "phases": tuple(sorted({member.feature.phase for member in members})),
        "fs": like.fs,
        "native_fs": min(r.native_fs for r in meter.recordings if r.native_fs is not None),
        "unit": like.unit,
        "phase_settings": like.phase_settings,
        "input": TrainingFiles.of(felt, like),
        "loudest": float(max(sizes)) or None,
        "shortest_s": min(((stop - start) / like.fs for start, stop in spans), default=None),
        "trained_on": {
            "name": felt.name,
            "hash": felt.input_hash,
            "n_recordings": int(parents(table.frame).nunique()),
            "n_windows": len(table.frame),
            "left_out": [item.recording_id for item in table.left_out],
        },
    }


def pipeline_for(dataset: Dataset) -> str:
    """Return the pipeline that is trained where none is named.

    `coarse` for an inertial unit (a turn rate beside the acceleration): slow, its axes kept apart; for any
    other recordings `surfaces`.
    """
    for entry in dataset.entries:
        with suppress(RecordingError):  # bad ones are told, or skipped, by the extraction
            return "surfaces" if dataset.load(entry).turn_rate is None else "coarse"
    return "surfaces"
