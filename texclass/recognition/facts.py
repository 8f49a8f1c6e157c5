"""What a manifest states of a training."""

import time
from typing import Any

import numpy as np

from texclass.experiment.cost import CostMeter
from texclass.experiment.feature_table import FeatureTable
from texclass.experiment.pipeline import PipelineDefinition
from texclass.experiment.windows import parents
from texclass.loaders.dataset import Dataset
from texclass.provenance import versions
from texclass.recognition.calibration import Calibration, expected_calibration_error
from texclass.recognition.held_out import HeldOut
from texclass.recognition.manifest import Manifest
from texclass.recognition.source import Source
from texclass.recognition.study import Choice, Study
from texclass.recognition.unknown import Novelty
from texclass.recording import Recording, RecordingError, Samples
from texclass.tradeoff.deploy import Recogniser

LIBRARIES = ("numpy", "scipy", "scikit-learn", "skops", "PyWavelets", "librosa")


def manifest_of(
    chosen: Choice,
    study: Study,
    felt: Dataset,
    pipeline: PipelineDefinition,
    meter: CostMeter,
    calibration: Calibration,
    novelty: Novelty,
    touch_s: float | None,
    *,
    stretch: float,
) -> Manifest:
    """Return the manifest of a model that was trained on the recordings of a study."""
    return Manifest(
        materials=tuple(np.unique(study.y).tolist()),
        pipeline={
            "name": pipeline.name, "row": chosen.candidate.row, "hash": pipeline.hash,
            "classifier": chosen.candidate.classifier_name, "feature_set": pipeline.features.name,
        },
        trained_on=_trained_on(felt, study.table),
        accuracy=_accuracy(chosen, study),
        calibration=_calibration(calibration, chosen.held_out),
        unknown={
            "score": novelty.kind, "false_alarms": novelty.false_alarms, "threshold": novelty.threshold,
            "n": len(novelty.held_out), "stretch": stretch,
        },
        touch_s=touch_s,
        versions=versions(*LIBRARIES),
        **_of_recordings(chosen.recogniser, felt, meter, study.values(chosen.recogniser[0].plan_)),
    )  # fmt: skip


def _trained_on(felt: Dataset, table: FeatureTable) -> dict[str, Any]:
    n_recordings = int(parents(table.frame).nunique())
    return {
        "name": felt.name, "hash": felt.input_hash, "n_recordings": n_recordings,
        "n_windows": len(table.frame) if "parent" in table.frame else n_recordings,
        "left_out": [item.recording_id for item in table.left_out],
    }  # fmt: skip


def _accuracy(chosen: Choice, study: Study) -> dict[str, Any]:
    low, high = chosen.accuracy.interval
    tested = "touches" if "parent" in study.table.frame else "recordings"
    return {
        "mean": chosen.accuracy.mean, "low": low, "high": high, "n_tested": chosen.accuracy.n_tested,
        "protocol": study.held.protocol.name, "why": study.held.why, "n_folds": len(study.splits),
        "n_candidates": chosen.n_candidates,
        "how": f"held-out {tested}" + ", the choice among candidates included" * (chosen.n_candidates > 1),
    }  # fmt: skip


def _calibration(calibration: Calibration, held_out: HeldOut) -> dict[str, Any]:
    p = calibration(held_out.decisions)
    return {
        "method": "temperature", "beta": calibration.beta, "lapse": calibration.lapse,
        "expected_error": expected_calibration_error(p.max(axis=1), held_out.hits), "n": len(p),
    }  # fmt: skip


def _of_recordings(recogniser: Recogniser, felt: Dataset, meter: CostMeter, X: Samples) -> dict[str, Any]:
    """Return what is known by looking at a few recordings: rate, unit, phases, source, costs."""
    like: Recording = meter.recordings[0]
    if others := {r.fs for r in meter.recordings} - {like.fs}:
        raise RecordingError(f"{felt.name}: rates are {like.fs:g} and {others.pop():g} Hz; the rule is one")
    plan = recogniser[0].plan_
    spans = [r.phases.movement for r in meter.recordings if r.phases and r.phases.movement]
    members = [member for _, part in plan.parts for member in part.members]
    return {
        "features": tuple(dict.fromkeys(member.name for member in members)),
        "phases": tuple(sorted({member.feature.phase for member in members})),
        "fs": like.fs,
        "unit": like.unit,
        "input": Source.of(felt, like).to_dict(),
        "shortest_s": min(((stop - start) / like.fs for start, stop in spans), default=None),
        "cost": {
            "features_ms": meter.measured(plan)[0],
            "classifier_ms": _classifier_ms(recogniser, X),
        },
    }


def _classifier_ms(recogniser: Recogniser, X: Samples) -> float:
    """Return what everything after the features takes for one recording: the best of a few."""
    best = np.inf
    for row in X[:5]:
        start, values = time.perf_counter(), row[None]
        for _, step in recogniser.steps[1:-1]:
            values = step.transform(values)
        recogniser[-1].predict(values)
        best = min(best, 1e3 * (time.perf_counter() - start))
    return float(best)
