"""Choose a row and a classifier inside each training part: what the best of a table is really worth."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from texclass.experiment.accuracy import score
from texclass.experiment.feature_table import FeatureTable
from texclass.experiment.folds import Evaluation
from texclass.experiment.pipeline import MatchedRow, PipelineDefinition
from texclass.experiment.protocols import Protocol, Split, fewest, find_protocol, require_unseen, splits_of
from texclass.experiment.workers import Progress, each

LEAST_TRAINED = 2
"""Recordings of each material that must be left to train on: spread cannot be learnt from one."""


def choose_inside(
    rows: Sequence[MatchedRow],
    table: FeatureTable,
    splits: Sequence[Split],
    pipeline: PipelineDefinition,
    protocol: Protocol,
    evaluations: Mapping[str, Mapping[str, Evaluation]],
    *,
    n_jobs: int = 1,
    progress: Progress | None = None,
) -> dict[str, Any] | None:
    """Choose for each fold the row and classifier that do best within its training part.

    Parameters
    ----------
    rows, table, splits, pipeline, protocol
        What the benchmark evaluated.
    evaluations
        Row -> classifier -> predictions of the test parts, fold after fold.
    n_jobs : int
        Processes.
    progress : callable, optional
        Called with (done, total, what).

    Returns
    -------
    dict or None
        As JSON: the `accuracy` of the chosen rows and classifiers on the test parts, which had no say; row
        and classifier `chosen` in each fold; the `protocol` that split the training parts. None where no row
        could be computed. Of rows that do equally well within a training part, as few
        recordings often leave them, the one that reads the most columns is chosen; of such, the first.

    Raises
    ------
    ValueError
        As `inner_splits`.
    """
    pairs = [(row, name) for row in rows for name in evaluations.get(row.definition.name, ())]
    if not pairs:
        return None
    inner = inner_splits(protocol, table.frame, splits, pipeline.seed)
    y, clusters = table.materials, protocol.clusters(table.frame)
    over, independent = protocol.independent(table.frame)
    trials = [pipeline.trial(row, name, table) for row, name in pairs]
    calls = [
        partial(trial, [(train[a], train[b]) for a, b in found])
        for (train, _), (_, found) in zip(splits, inner, strict=True)
        for trial in trials
    ]
    reported: dict[str, Any] = {"progress": progress, "what": "choices", "total": len(calls)}
    hits = [e.accuracy.n_hits for e in each(calls, n_jobs=n_jobs, **reported)]
    # Less than one recording, so that it only parts equals.
    wider = np.array([row.n_features for row, _ in pairs]) / (1 + sum(row.n_features for row, _ in pairs))
    best = (np.reshape(hits, (len(splits), len(pairs))) + wider).argmax(axis=1)
    chosen = [[pairs[k][0].definition.name, pairs[k][1]] for k in best]
    predicted = [evaluations[row][name].predicted[k] for k, (row, name) in enumerate(chosen)]
    truth, *tested = ([of[test] for _, test in splits] for of in (y, clusters, independent))
    return {
        "accuracy": score(truth, predicted, *tested).to_dict(protocol.unit, over),
        "chosen": chosen,
        "protocol": ", ".join(dict.fromkeys(name for name, _ in inner)),
    }


def inner_splits(
    protocol: Protocol, table: pd.DataFrame, splits: Sequence[Split], seed: int
) -> list[tuple[str, tuple[Split, ...]]]:
    """Return how each training part is split to choose within it, with the name of that protocol.

    As the whole is, where that is possible; else into stratified folds over recordings (three repetitions are
    too few for `few-shot` again, and one operator alone cannot be left out).

    Raises
    ------
    ValueError
        If the protocol lets preparation see the test parts, or a training part cannot be split.
    """
    require_unseen(protocol)
    return [_split_again(protocol, table.iloc[train].reset_index(drop=True), seed) for train, _ in splits]


def _split_again(protocol: Protocol, part: pd.DataFrame, seed: int) -> tuple[str, tuple[Split, ...]]:
    problem: ValueError | None = None
    for tried in dict.fromkeys((protocol.name, "recording")):
        way = find_protocol(tried)
        try:
            found = splits_of(way, part, seed)
            least = min(fewest(way, part.iloc[train]) for train, _ in found)
            if least < LEAST_TRAINED:
                raise ValueError(
                    f"{least} {way.unit} of a material would train; the rule is at least {LEAST_TRAINED}"
                )
            return tried, found
        except ValueError as error:
            problem = error
    raise ValueError(f"a training part cannot be split again to choose within it: {problem}") from problem
