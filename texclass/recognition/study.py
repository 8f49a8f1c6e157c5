"""Candidates compared on the same held-out recordings, and the best of them trained on everything."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from texclass.experiment.accuracy import Accuracy
from texclass.experiment.feature_table import FeatureTable
from texclass.experiment.folds import without_remarks
from texclass.experiment.protocols import Split, find_protocol, splits_of
from texclass.experiment.workers import Progress, each
from texclass.features.extractor import Plan
from texclass.recognition.candidates import Candidate
from texclass.recognition.files import unsafe_classes
from texclass.recognition.held_out import HeldOut, accuracy_of_choice, hold_out
from texclass.recognition.holding_out import AT_RANDOM, HoldingOut
from texclass.recording import Samples
from texclass.tradeoff.deploy import Recogniser


@dataclass(frozen=True, eq=False)
class Choice:
    """What was chosen.

    Attributes
    ----------
    candidate, recogniser
        Unfitted, and trained on everything.
    held_out
        What it said of recordings it had not seen.
    accuracy
        To be expected of the best of so many candidates.
    n_candidates
        How many.
    """

    candidate: Candidate
    recogniser: Recogniser
    held_out: HeldOut
    accuracy: Accuracy
    n_candidates: int


@dataclass(frozen=True, eq=False)
class Study:
    """The recordings, and how they are held out."""

    table: FeatureTable
    held: HoldingOut
    splits: tuple[Split, ...]
    seed: int

    @property
    def y(self) -> Any:
        """Materials, shape (n,)."""
        return self.table.frame["material"].to_numpy(dtype=str)

    def values(self, plan: Plan) -> Samples:
        """Return the columns of a plan, shape (n, n_columns)."""
        return self.table.frame[list(plan.columns)].to_numpy(dtype=np.float64)

    def choose(self, candidates: Sequence[Candidate], n_jobs: int, progress: Progress | None) -> Choice:
        """Return the best candidate that can be saved."""
        calls = [partial(_held_out, c, self.values(c.plan), self.y, self.splits) for c in candidates]
        jobs = n_jobs if len(candidates) > 1 else 1
        found = list(each(calls, n_jobs=jobs, progress=progress, what="candidates"))
        clusters = self.held.protocol.clusters(self.table.frame)[found[0].rows]
        left = list(zip(candidates, found, strict=True))
        while left:
            hits, ms = np.array([h.hits for _, h in left]), [c.ms for c, _ in left]
            best, accuracy = accuracy_of_choice(hits, ms, clusters, self.seed)
            candidate, held_out = left[best]
            recogniser = self.fitted(candidate)
            if not (unsafe := unsafe_classes(recogniser)):
                return Choice(candidate, recogniser, held_out, accuracy, len(left))
            left = [pair for pair in left if pair[0].classifier_name != candidate.classifier_name]
        raise ValueError(
            f"{candidate} holds {unsafe[0]}; the rule is a classifier whose file can be loaded safely"
        )

    def distances(self, chosen: Choice) -> tuple[Samples, float]:
        """Return how far held-out recordings lie, shape (n,), and the factor that drift has put on it.

        Distances shrink with every recording that trains: those of blocks in time, for which a half trains,
        tell of the smaller half and of drift in one. Folds at random tell of neither. Their distances are
        stretched by what later recordings are farther, in the median, than as many drawn at random. On twelve
        pairs of `biotac20`, at 5 %, 3.3 % of later known recordings were then called unknown, and 85 % of
        strangers (by blocks: 0.3 % and 59 %; by folds: 8.4 % and 94 %).
        """
        later = chosen.held_out.strange
        if not self.held.is_in_time:
            return later, 1.0
        at_random, frame = find_protocol(AT_RANDOM), self.table.frame
        halves = self._strange(chosen, at_random.split(frame, 2, self.seed))
        stretch = max(1.0, float(np.median(later) / max(np.median(halves), 1e-300)))
        return stretch * self._strange(chosen, splits_of(at_random, frame, self.seed)), stretch

    def _strange(self, chosen: Choice, splits: tuple[Split, ...]) -> Samples:
        return _held_out(chosen.candidate, self.values(chosen.candidate.plan), self.y, splits).strange

    def fitted(self, candidate: Candidate) -> Recogniser:
        """Return a candidate trained on everything, pruned."""
        with without_remarks():
            whole = Recogniser.fitted_on(candidate.plan, self.values(candidate.plan), self.y, candidate.steps)
        return whole.prune()


def _held_out(candidate: Candidate, X: Samples, y: Any, splits: tuple[Split, ...]) -> HeldOut:
    with without_remarks():
        return hold_out(candidate, X, y, splits)
