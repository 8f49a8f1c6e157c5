"""Recordings and a pipeline in, a trained model out; what is chosen is chosen by cross-validation alone."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from timeit import repeat
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from texclass.experiment.cost import CostMeter
from texclass.experiment.feature_table import cached_table, metadata
from texclass.experiment.folds import without_remarks
from texclass.experiment.pipeline import PipelineDefinition, load_pipeline
from texclass.experiment.protocols import Protocol, Split, fewest, find_protocol, splits_of
from texclass.experiment.windows import parents, touches
from texclass.experiment.workers import Progress, each, one_thread
from texclass.features.plan import Plan
from texclass.loaders import open_dataset
from texclass.loaders.dataset import Dataset
from texclass.provenance import versions
from texclass.recognition.candidates import (
    Candidate,
    HeldOut,
    accuracy_of_choice,
    candidates_of,
    hold_out,
    without_choice,
)
from texclass.recognition.candidates import exportable as with_graph
from texclass.recognition.deployed import Deployed
from texclass.recognition.live.evidence import fit_correlation
from texclass.recognition.model import Model, Ranges
from texclass.recognition.model_files import Manifest, unsafe_classes
from texclass.recognition.probabilities import (
    calibration_error_of_chance,
    expected_calibration_error,
    fit_calibration,
)
from texclass.recognition.sources.training_input import TrainingFiles
from texclass.recognition.unknown import (
    Novelty,
    cautious,
    check_false_alarms,
    fit_nearness,
    kind_for,
    least_held_out,
)
from texclass.recording import RecordingError, Samples
from texclass.tradeoff.recogniser import Recogniser

FALSE_ALARMS = 0.05
ENOUGH_REPETITIONS = 20
"""Of each material: half of them, ten, still train, as where the drift of `biotac20` was measured."""
FEW = 10
"""Recordings (or runs) of each material below which nothing is chosen, and margins are wider."""
AT_RANDOM, IN_TIME = "recording", "blocks"
LIBRARIES = ("numpy", "scipy", "scikit-learn", "skops", "PyWavelets", "librosa")


def train(
    dataset: Dataset | str | Path,
    pipeline: PipelineDefinition | str | Path = "texclass",
    *,
    row: str | None = None,
    classifier: str | None = None,
    max_ms: float | None = None,
    max_features: int | None = None,
    touch_s: float | None = None,
    exportable: bool = False,
    protocol: str | None = None,
    false_alarms: float = FALSE_ALARMS,
    fs: float | None = None,
    unit: str | None = None,
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> Model:
    """Choose a row and a classifier by cross-validation, train them on everything, calibrate.

    The same recordings, options and versions give the same model file, byte for byte but for the costs that
    its manifest reports. Below ten recordings (or runs) of a material nothing is chosen (`without_choice`).
    Held-out decisions of the choice also give its probabilities, the threshold for unknown surfaces, and the
    accuracy the manifest states, from which the luck of being chosen is taken out.

    Parameters
    ----------
    dataset : Dataset, str or Path
        Whole labelled recordings of at least two materials; or what `open_dataset` opens: a name, card or
        folder.
    pipeline : PipelineDefinition, str or Path
        What may be trained: a shipped name, a file, or a definition.
    row, classifier : str, optional
        Of the pipeline; the best by cross-validation by default.
    max_ms : float, optional
        Milliseconds that a recording may take on this machine, from its samples to its features, as measured
        when such a limit was first asked for here; see `CostMeter.kept`.
    max_features : int, optional
        Columns that may reach the classifier.
    touch_s : float, optional
        Seconds of movement of one answer; whole recordings by default.
    exportable : bool
        Only features that `export_onnx` can write from the samples on; the manifest says which are left out,
        and how accurate the same choice with them is, which is tried as well.
    protocol : str, optional
        How recordings are held out; see `holding_out` by default. `blocks` chooses, calibrates and sets the
        threshold on later repetitions than it trains on, as a sensor that drifts asks for.
    false_alarms : float
        Share of known surfaces that may be called unknown.
    fs, unit : optional
        Of a folder; see `open_dataset`.
    n_jobs : int
        Processes.
    skip_bad : bool
        Leave bad recordings out instead of stopping at the first.
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
        If the protocol cannot hold recordings out, a name is unknown, or nothing is affordable.

    Examples
    --------
    >>> train("simulated", row="Movement", touch_s=1.0).save("surfaces.skops")  # doctest: +SKIP
    """
    for name, value in (("max_ms", max_ms), ("max_features", max_features)):
        if value is not None and not 0 < value < np.inf:
            raise ValueError(f"{name} is {value!r}; the rule is above 0, and finite")
    defined = pipeline if isinstance(pipeline, PipelineDefinition) else load_pipeline(pipeline)
    felt = dataset if isinstance(dataset, Dataset) else open_dataset(dataset, fs=fs, unit=unit)
    if touch_s is not None:
        felt = touches(felt, touch_s, n_jobs=n_jobs, progress=progress)
    known = metadata(felt.entries)
    held_out_by, why = holding_out(protocol, defined.protocol.name, known, false_alarms)
    # Before the features: what is impossible should not cost an extraction.
    splits = splits_of(held_out_by, known, defined.seed)
    check_false_alarms(false_alarms, sum(len(test) for _, test in splits))
    table = cached_table(
        felt, *defined.needed, channels=defined.channels, n_jobs=n_jobs, skip_bad=skip_bad, progress=progress
    )
    meter = CostMeter.on(felt, table.frame["recording_id"].tolist(), defined.channels)
    candidates = candidates_of(
        defined, table, meter, row=row, classifier=classifier, max_ms=max_ms, max_features=max_features
    )
    frame = table.frame
    splits = splits_of(held_out_by, frame, defined.seed)
    few_of = {}
    if (n := fewest(held_out_by, frame)) < FEW:
        few_of = {"few": f"{n} {held_out_by.unit}s of a surface"}
        candidates = without_choice(candidates)
    candidates, others, lacking = with_graph(candidates) if exportable else (candidates, [], ())
    calls = [partial(hold_out, candidate, frame, splits) for candidate in (*candidates, *others)]
    jobs = n_jobs if len(calls) > 1 else 1
    said = list(each(calls, n_jobs=jobs, progress=progress, what="candidates", total=len(calls)))
    tried = list(zip(candidates, said, strict=False))
    clusters = held_out_by.clusters(frame)[tried[0][1].rows]
    candidate, held_out, recogniser, expected = _best(tried, frame, clusters, defined.seed)
    far, stretch = held_out.strange, 1.0
    if held_out_by.name == IN_TIME and kind_for(candidate.classifier) == "distance":
        far, stretch = _stretched(candidate, frame, far, defined.seed)
    plan = recogniser[0].plan_
    X = frame[list(plan.columns)].to_numpy(dtype=np.float64)
    kind, near = kind_for(recogniser[-1]), None
    if kind == "distance":
        prepared = X
        with one_thread():
            for _, step in recogniser.steps[1:-1]:
                prepared = step.transform(prepared)
            near = fit_nearness(prepared, np.unique(frame["material"], return_inverse=True)[1])
    level = cautious(false_alarms, len(far)) if few_of else false_alarms
    novelty = Novelty(kind, np.sort(far), level, near)
    calibration = fit_calibration(held_out.decisions, held_out.labels)
    p = calibration(held_out.decisions)
    tested = "touches" if "parent" in frame else "recordings"
    deployed = Deployed.of(recogniser)
    manifest = Manifest(
        **_recordings(felt, meter, plan),
        materials=tuple(recogniser.classes_.tolist()),
        pipeline={
            "name": defined.name,
            "hash": defined.hash,
            "feature_set": defined.features.name,
            "row": candidate.row,
            "classifier": candidate.classifier_name,
            **few_of,
            **({"budget": f"{max_ms:g} ms on {meter.kept(defined.features).machine}"} if max_ms else {}),
        },
        trained_on={
            "name": felt.name,
            "hash": felt.input_hash,
            "n_recordings": int(parents(frame).nunique()),
            "n_windows": len(frame),
            "left_out": [item.recording_id for item in table.left_out],
        },
        accuracy={
            **expected,
            "protocol": held_out_by.name,
            "why": why,
            "n_folds": len(splits),
            "how": f"held-out {tested}"
            + ", the choice among candidates included" * (expected["n_candidates"] > 1),
            "untold": untold(splits, frame),
            **_with_all(lacking, others, said[len(candidates) :], clusters, defined.seed),
        },
        calibration={
            "method": "temperature",
            **vars(calibration),
            "expected_error": expected_calibration_error(p.max(axis=1), held_out.hits),
            "error_of_chance": calibration_error_of_chance(p.max(axis=1)),
            "n": len(p),
            **_of_contacts(p, held_out, frame),
        },
        unknown={
            "score": kind,
            "false_alarms": false_alarms,
            "level": level,
            "threshold": novelty.threshold,
            "n": len(far),
            "stretch": stretch,
        },
        cost={
            "segmentation_ms": meter.segmentation_ms,
            "features_ms": meter.measured(plan)[0],
            "classifier_ms": 1e3 * min(repeat(partial(deployed.decided, X[:1]), number=1, repeat=5)),
        },
        touch_s=touch_s,
        versions=versions(*LIBRARIES),
    )
    return Model(deployed, calibration, novelty, Ranges.of(X), manifest, table.left_out)


def _best(
    tried: Sequence[tuple[Candidate, HeldOut]], frame: pd.DataFrame, clusters: NDArray[Any], seed: int
) -> tuple[Candidate, HeldOut, Recogniser, dict[str, Any]]:
    """Return the best candidate that can be saved, trained on everything, and its expected accuracy."""
    left = list(tried)
    while left:
        hits = np.array([held_out.hits for _, held_out in left])
        best, accuracy = accuracy_of_choice(hits, [c.n_columns for c, _ in left], clusters, seed)
        candidate, held_out = left[best]
        with without_remarks(), one_thread():  # the number of threads would change last digits
            X, y = candidate.trained_on(frame)
            recogniser = Recogniser.fitted_on(candidate.plan, X, y, candidate.steps).prune()
        if not (unsafe := unsafe_classes(recogniser.document())):
            low, high = accuracy.interval
            expected = {"mean": accuracy.mean, "low": low, "high": high, "n_tested": accuracy.n_tested}
            return candidate, held_out, recogniser, expected | {"n_candidates": len(left)}
        left = [pair for pair in left if pair[0].classifier_name != candidate.classifier_name]
    raise ValueError(
        f"{candidate} holds {unsafe[0]}; the rule is a classifier whose file can be loaded safely"
    )


def _with_all(
    lacking: Sequence[str],
    others: Sequence[Candidate],
    said: Sequence[HeldOut],
    clusters: NDArray[Any],
    seed: int,
) -> dict[str, Any]:
    """Return which features have no graph, and how accurate the best of candidates with them is."""
    if not others:
        return {}
    hits = np.array([held_out.hits for held_out in said])
    _, accuracy = accuracy_of_choice(hits, [c.n_columns for c in others], clusters, seed)
    return {"without_graph": list(lacking), "with_all_features": accuracy.mean}


def _stretched(chosen: Candidate, frame: pd.DataFrame, later: Samples, seed: int) -> tuple[Samples, float]:
    """Return how far recordings held out at random lie, stretched by drift, shape (n,), and the factor.

    Distances shrink with every recording that trains: those of blocks in time, for which a half trains,
    tell of the smaller half and of drift in one. Folds at random tell of neither. Their distances are
    stretched by what later recordings are farther, in the median, than as many drawn at random.
    """
    at_random = find_protocol(AT_RANDOM)
    halves = hold_out(chosen, frame, at_random.split(frame, 2, seed)).strange
    folds = hold_out(chosen, frame, splits_of(at_random, frame, seed)).strange
    stretch = max(1.0, float(np.median(later) / max(np.median(halves), 1e-300)))
    return stretch * folds, stretch


def _of_contacts(p: Samples, held_out: HeldOut, frame: pd.DataFrame) -> dict[str, float]:
    """Return how windows of one recording agree by their recording; nothing where each has but one."""
    contacts = parents(frame).to_numpy()[held_out.rows]
    n_contacts = len(set(contacts))
    if n_contacts == len(contacts):
        return {}
    return {"correlation": fit_correlation(p, held_out.labels, contacts), "n_contacts": n_contacts}


def _recordings(felt: Dataset, meter: CostMeter, plan: Plan) -> dict[str, Any]:
    """Return what the manifest states of the recordings a model is for: rate, unit, phases, length."""
    like = meter.recordings[0]
    if others := {recording.fs for recording in meter.recordings} - {like.fs}:
        raise RecordingError(f"{felt.name}: rates are {like.fs:g} and {others.pop():g} Hz; the rule is one")
    spans = [r.phases.movement for r in meter.recordings if r.phases and r.phases.movement]
    members = [member for _, part in plan.parts for member in part.members]
    sizes = [np.abs(r.acceleration - np.median(r.acceleration, axis=0)).max() for r in meter.recordings]
    return {
        "features": tuple(dict.fromkeys(member.name for member in members)),
        "phases": tuple(sorted({member.feature.phase for member in members})),
        "fs": like.fs,
        "unit": like.unit,
        "input": TrainingFiles.of(felt, like),
        "loudest": float(max(sizes)) or None,
        "shortest_s": min(((stop - start) / like.fs for start, stop in spans), default=None),
    }


def holding_out(
    asked: str | None, own: str, table: pd.DataFrame, false_alarms: float
) -> tuple[Protocol, str]:
    """Return how the recordings of a table are held out for choice, probabilities and threshold, and why so.

    A pipeline that draws recordings at random gives way to blocks in time where repetitions are numbered and
    many: a recogniser meets a sensor that is older than in its training, of which folds at random know
    nothing.

    Parameters
    ----------
    asked : str or None
        Protocol that the user asked for.
    own : str
        Protocol of the pipeline.
    table : DataFrame
        Metadata of recordings, or of windows of them.
    false_alarms : float
        Share that may be called unknown; it takes a number of held-out recordings.
    """
    if asked is not None:
        return find_protocol(asked), "asked for"
    recordings = table[~parents(table).duplicated()]
    counts = recordings["material"].value_counts()
    n_held_out = int((counts - counts // 2).sum())
    # One sequence in time, unless repetitions follow the people, not a clock.
    is_sequence = (
        table["repetition"].notna().all()
        and not recordings.duplicated(["material", "repetition"]).any()
        and len(recordings["operator"].unique()) == 1
    )
    is_enough = counts.min() >= ENOUGH_REPETITIONS and n_held_out >= least_held_out(false_alarms)
    if own == AT_RANDOM and is_sequence and is_enough:
        why = f"{counts.min()} numbered repetitions of each surface or more: the sensor may drift"
        return find_protocol(IN_TIME), why
    return find_protocol(own), "the pipeline's"


def untold(splits: Sequence[Split], table: pd.DataFrame) -> list[str]:
    """Return what the tests of a table's splits cannot tell of recordings to come, likeliest first.

    Recordings that are drawn at random were made between those that train, by the same hand in the same
    session: what changes later, or elsewhere, is in none of them.
    """
    parts = [(table.iloc[train], table.iloc[test]) for train, test in splits]
    found, names = [], ("session", "operator")
    after = [
        test.groupby("material")["repetition"].min() > learnt.groupby("material")["repetition"].max()
        for learnt, test in parts
    ]
    if table["repetition"].isna().any() or not all(later.all() for later in after):
        n = int(table[~parents(table).duplicated()]["material"].value_counts().min())
        found.append(
            f"later recordings ({n} of each surface, held out at random; from {ENOUGH_REPETITIONS} numbered "
            f"repetitions on, or with `--protocol {IN_TIME}`, the later half is held out)"
        )
    if others := [
        name
        for name in names
        if table[name].isna().any() or any(set(test[name]) & set(learnt[name]) for learnt, test in parts)
    ]:
        found.append(f"another {' or '.join(others)} (`--leave-out {others[0]}`, if the card names it)")
    return found
