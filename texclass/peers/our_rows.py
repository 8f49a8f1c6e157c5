"""Our rows, timed in a process of their own with the clock and the memory gauge of the peers' worker."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from joblib import Parallel, delayed, parallel_config

from texclass.experiment.feature_table import FeatureTable
from texclass.experiment.folds import Evaluation
from texclass.experiment.pipeline import MatchedRow, PipelineDefinition
from texclass.experiment.protocols import Split
from texclass.experiment.workers import one_thread
from texclass.features.extractor import Plan
from texclass.features.phase_view import channels_apart
from texclass.features.sets import FeatureSet
from texclass.loaders.dataset import Dataset, Entry
from texclass.peers.peer_worker.run import PeakMemory, timed
from texclass.phases import segment

N_TIMED = 100
"""Recordings, spread over the dataset, on which our features are timed."""


def measure_ours(
    row: MatchedRow,
    classifier: str,
    pipeline: PipelineDefinition,
    dataset: Dataset,
    table: FeatureTable,
    splits: Sequence[Split],
    *,
    nested: bool,
) -> dict[str, Any]:
    """Evaluate and time one row of ours in a process of its own.

    Returns
    -------
    dict
        `predicted` labels of each fold; CPU seconds, as a worker writes them: `feature_s` of a recording,
        `fit_s` of a fold, `predict_s` of a recording, `first_s` of the first call on two recordings; and
        `memory_mb`, the growth of the process at its largest.
    """
    wanted = set(table.frame["recording_id"])
    usable = [entry for entry in dataset.entries if entry.recording_id in wanted]
    some = np.unique(np.linspace(0, len(usable) - 1, min(N_TIMED, len(usable))).astype(int))
    features = pipeline.features.restricted_to(row.definition.features)
    trial = pipeline.trial(row, classifier, table)
    job = delayed(_measure)(
        dataset, [usable[i] for i in some], features, pipeline.channels, trial, tuple(splits), nested
    )
    with parallel_config(backend="loky", inner_max_num_threads=1):
        # Two, because one process would be this one.
        return Parallel(n_jobs=2)([job])[0]  # type: ignore[no-any-return]


def _measure(
    dataset: Dataset,
    entries: Sequence[Entry],
    features: FeatureSet,
    channels: Any,
    trial: Callable[..., Evaluation],
    splits: Sequence[Split],
    nested: bool,
) -> dict[str, Any]:
    first = dataset.load(entries[0])
    plan = Plan.of(features, channels_apart(first, channels))
    with one_thread():
        _, first_s = timed(lambda: [plan.compute(first) for _ in range(2)])
        memory, seconds = PeakMemory(), []
        for recording in map(dataset.load, entries):
            # Peers are given movements that have been found already.
            known = recording.with_(phases=segment(recording))
            seconds.append(timed(partial(plan.compute, known))[1])
        found = trial(splits, nested=nested)
    return {
        "predicted": found.predicted,
        "feature_s": float(np.mean(seconds)),
        "fit_s": found.fit_s,
        "predict_s": found.predict_s,
        "first_s": first_s,
        "memory_mb": memory.megabytes,
    }
