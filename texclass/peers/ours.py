"""Our rows, timed in a process of their own with the clock and the memory gauge of the peers' worker."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from joblib import Parallel, delayed, parallel_config
from numpy.typing import NDArray
from sklearn.pipeline import Pipeline
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from texclass.experiment.feature_table import FeatureTable
from texclass.experiment.folds import evaluate
from texclass.experiment.pipeline import MatchedRow, PipelineDefinition
from texclass.experiment.protocols import Split
from texclass.features.extractor import Plan
from texclass.features.phase_view import channels_apart
from texclass.loaders.dataset import Dataset, Entry
from texclass.peers.peer_worker.measure import PeakMemory, timed
from texclass.phases import segment

N_TIMED = 100
"""Recordings, spread over the dataset, on which our features are timed."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A row of our table with a classifier."""

    row: MatchedRow
    classifier: str


@dataclass(frozen=True, eq=False)
class Measured:
    """What a row of ours predicts and costs; see the fields of a worker's fold.

    Attributes
    ----------
    predicted : tuple of ndarray
        Labels, one array a fold.
    feature_s, fit_s, predict_s : float
        CPU seconds: features of a recording, fitting one fold, predicting one recording.
    first_s : float
        The first call on two recordings.
    memory_mb : float
        Growth of the process at its largest.
    """

    predicted: tuple[NDArray[Any], ...]
    feature_s: float
    fit_s: float
    predict_s: float
    first_s: float
    memory_mb: float


def measure_ours(
    candidate: Candidate,
    pipeline: PipelineDefinition,
    dataset: Dataset,
    table: FeatureTable,
    splits: Sequence[Split],
    *,
    nested: bool,
) -> Measured:
    """Evaluate and time one row of ours in a process of its own."""
    wanted = set(table.frame["recording_id"])
    usable = [entry for entry in dataset.entries if entry.recording_id in wanted]
    some = np.unique(np.linspace(0, len(usable) - 1, min(N_TIMED, len(usable))).astype(int))
    job = _Job(
        dataset,
        [usable[i] for i in some],
        pipeline,
        candidate,
        table.frame[list(candidate.row.columns)].to_numpy(dtype=np.float64),
        table.frame["material"].to_numpy(dtype=str),
        tuple(splits),
        nested,
    )
    with parallel_config(backend="loky", inner_max_num_threads=1):
        # Two, because one process would be this one.
        return Parallel(n_jobs=2)([delayed(_measure)(job)])[0]  # type: ignore[no-any-return]


@dataclass(frozen=True, eq=False)
class _Job:
    dataset: Dataset
    entries: list[Entry]
    pipeline: PipelineDefinition
    candidate: Candidate
    X: NDArray[np.float64]
    y: NDArray[np.str_]
    splits: tuple[Split, ...]
    nested: bool

    @property
    def preparation(self) -> Pipeline:
        return self.pipeline.preparation(self.candidate.row.definition, self.candidate.classifier)

    @property
    def classifier(self) -> Any:
        return self.pipeline.classifiers[self.candidate.classifier].make()


def _measure(job: _Job) -> Measured:
    features = job.pipeline.features.restricted_to(job.candidate.row.definition.features)
    first = job.dataset.load(job.entries[0])
    plan = Plan.of(features, channels_apart(first, job.pipeline.channels))
    with threadpool_limits(1):
        with timed() as warming:
            for _ in range(2):
                plan.compute(first)
        memory = PeakMemory()
        feature_s = float(np.mean([_seconds(plan, job.dataset, entry) for entry in job.entries]))
        found = evaluate(job.X, job.y, job.splits, job.preparation, job.classifier, nested=job.nested)
    return Measured(
        found.predicted, feature_s, found.fit_s, found.predict_s, warming.seconds, memory.megabytes
    )


def _seconds(plan: Plan, dataset: Dataset, entry: Entry) -> float:
    recording = dataset.load(entry)
    # Peers are given movements that have been found already.
    known = recording.with_(phases=segment(recording))
    with timed() as clock:
        plan.compute(known)
    return clock.seconds
