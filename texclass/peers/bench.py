"""The bench of a comparison: what all contestants share, and what they did as lines of a table."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from texclass.experiment.accuracy import score
from texclass.experiment.feature_table import FeatureTable
from texclass.experiment.paired import Paired, compare_once, compare_repeats
from texclass.experiment.pipeline import PipelineDefinition
from texclass.experiment.protocols import Protocol, Split
from texclass.loaders.dataset import Dataset
from texclass.peers.launch import Outcome
from texclass.peers.ours import Candidate, Measured, measure_ours
from texclass.peers.peer_worker.files import write_task
from texclass.peers.peer_worker.registry import Peer
from texclass.peers.result import Contestant, Cost
from texclass.peers.signals import Given, signal_reader
from texclass.recording import Samples

Predictions = Sequence[NDArray[Any]]
"""Fold -> labels."""


@dataclass(frozen=True, eq=False)
class Entrant:
    """A line of the comparison and the predictions behind it; empty where there are none."""

    contestant: Contestant
    predicted: Predictions = ()


@dataclass(frozen=True, eq=False)
class Bench:
    """What all contestants have in common, and how what they did becomes a line of the comparison."""

    dataset: Dataset
    pipeline: PipelineDefinition
    table: FeatureTable
    protocol: Protocol
    folds: tuple[Split, ...]

    @cached_property
    def materials(self) -> NDArray[np.str_]:
        """Material of each recording (or window)."""
        return self.table.frame["material"].to_numpy(dtype=str)

    @cached_property
    def names(self) -> NDArray[np.str_]:
        """Materials by class number."""
        return np.unique(self.materials)

    @cached_property
    def clusters(self) -> NDArray[np.str_]:
        """What each recording (or window) must not be parted from."""
        return self.protocol.clusters(self.table.frame)

    def write(self, task: Path, given: Given) -> tuple[int, ...]:
        """Hand signals and folds over; return how many samples each recording has."""
        entries = {entry.recording_id: entry for entry in self.dataset.entries}
        ordered = [entries[recording_id] for recording_id in self.table.frame["recording_id"]]
        first = self.dataset.load(ordered[0])
        read = signal_reader(given, first, self.pipeline.channels)
        signals: Iterator[Samples] = (read(self.dataset.load(entry)) for entry in ordered)
        labels = np.searchsorted(self.names, self.materials)
        return write_task(task, signals, labels, self.folds, first.fs, self.pipeline.seed)

    def ours(self, candidate: Candidate) -> Entrant:
        """Measure a row of ours."""
        measured = measure_ours(
            candidate, self.pipeline, self.dataset, self.table, self.folds, nested=self.protocol.nested
        )
        row = candidate.row
        contestant = Contestant(
            name=row.definition.name,
            classifier=candidate.classifier,
            title=row.definition.name,
            ours=True,
            status="done",
            reference=row.definition.reference,
            n_columns=row.n_features,
            cost=self._cost(measured),
        )
        return Entrant(contestant, measured.predicted)

    def theirs(self, peer: Peer, outcome: Outcome) -> list[Entrant]:
        """Return a line for each classifier of a peer; one that says why, where there is nothing to show."""
        line = Contestant(
            name=peer.name,
            classifier="",
            title=peer.title,
            ours=False,
            status=outcome.status,
            message=outcome.message,
            reference=peer.reference,
        )
        if not outcome.folds:
            return [Entrant(line)]
        return [self._their(line, outcome, classifier) for classifier in peer.classifiers]

    def _their(self, line: Contestant, outcome: Outcome, classifier: str) -> Entrant:
        ran = [fold["classifiers"][classifier] for fold in outcome.folds]
        predicted = tuple(self.names[fold["predicted"]] for fold in ran)
        measured = Measured(
            predicted,
            feature_s=float(np.mean([fold["feature_s"] for fold in outcome.folds])),
            fit_s=float(np.mean([fold["fit_s"] for fold in ran])),
            predict_s=float(np.mean([fold["predict_s"] for fold in ran])),
            first_s=outcome.first_s or 0.0,
            memory_mb=outcome.folds[-1]["memory_mb"],
        )
        n_columns = outcome.folds[0]["n_columns"]
        filled = replace(line, classifier=classifier, n_columns=n_columns, cost=self._cost(measured))
        return Entrant(filled, predicted)

    def _cost(self, measured: Measured) -> Cost:
        n_train, n_test = np.mean([[train.size, test.size] for train, test in self.folds], axis=0)
        features_s = (n_train + n_test) * measured.feature_s
        return Cost(
            feature_ms=1e3 * measured.feature_s,
            fit_s=measured.fit_s,
            predict_ms=1e3 * measured.predict_s,
            total_s=float(features_s + measured.fit_s + n_test * measured.predict_s),
            memory_mb=measured.memory_mb,
            first_s=measured.first_s,
        )

    def paired(self, entrants: Sequence[Entrant]) -> tuple[Contestant, ...]:
        """Return every line with its accuracy, and with what the first one is ahead of it."""
        reference = entrants[0].predicted
        return tuple(
            self._scored(entrant, None if entrant is entrants[0] else reference)
            if entrant.predicted
            else entrant.contestant
            for entrant in entrants
        )

    def _scored(self, entrant: Entrant, reference: Predictions | None) -> Contestant:
        predicted = entrant.predicted
        tests = [test for _, test in self.folds[: len(predicted)]]
        truth, clusters = ([of[test] for test in tests] for of in (self.materials, self.clusters))
        return replace(
            entrant.contestant,
            n_folds=len(predicted),
            accuracy=score(truth, predicted, clusters, seed=self.pipeline.seed),
            difference=None if reference is None else self._difference(reference, predicted, truth, clusters),
        )

    def _difference(
        self, one: Predictions, other: Predictions, truth: Predictions, clusters: Predictions
    ) -> Paired:
        """Compare on the folds that both have."""
        hits, others = ([[t == p for t, p in zip(truth, labels)]] for labels in (one, other))  # noqa: B905
        if self.protocol.drawn and len(truth) > 1:
            ratio = float(np.mean([test.size / train.size for train, test in self.folds]))
            return compare_repeats(hits, others, ratio)
        return compare_once(hits, others, clusters, self.pipeline.seed, self.protocol.unit)
