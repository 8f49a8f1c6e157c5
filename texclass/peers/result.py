"""What a comparison with peers found."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from texclass.experiment.accuracy import Accuracy
from texclass.experiment.paired import Paired
from texclass.peers.launch import Status


@dataclass(frozen=True)
class Cost:
    """CPU time on one thread, compilation left out, and memory.

    Attributes
    ----------
    feature_ms
        Features of one recording.
    fit_s
        Everything that learns, for one fold, without the features of its recordings.
    predict_ms
        Classifying the features of one recording.
    total_s
        One fold from signals to answers: features of all its recordings, fit, predictions.
    memory_mb
        Growth of the process at its largest, over its size after the first call.
    first_s
        The first call on two recordings: imports and compilation.
    """

    feature_ms: float
    fit_s: float
    predict_ms: float
    total_s: float
    memory_mb: float
    first_s: float


@dataclass(frozen=True)
class Contestant:
    """One line of the comparison: features with a classifier.

    Attributes
    ----------
    name, classifier, title, reference
        What it is; the classifier is empty where nothing ran.
    ours
        Whether it is a row of our table.
    status, message
        How it ended; "out of time" may have an accuracy, on the folds that were finished.
    n_columns, n_folds
        Columns at the classifier; folds that were finished.
    accuracy, cost
        None where no fold was finished.
    difference
        Our reference row minus this one, on the same test recordings; None for the reference itself.
    """

    name: str
    classifier: str
    title: str
    ours: bool
    status: Status
    message: str = ""
    reference: str = ""
    n_columns: int = 0
    n_folds: int = 0
    accuracy: Accuracy | None = None
    cost: Cost | None = None
    difference: Paired | None = None


@dataclass(frozen=True)
class PeerComparison:
    """Our rows and peers on the same folds.

    Attributes
    ----------
    dataset
        Facts: name, title, numbers of recordings, materials and tests.
    pipeline, pipeline_hash, protocol, protocol_description, n_folds
        What was evaluated, and how.
    contestants : tuple of Contestant
        Ours first; the first is the reference of the differences.
    signals
        What the peers were given.
    notes
        What a reader must know.
    time_limit_s
        Of each peer, in seconds.
    versions, peer_versions, seed, input_hash
        What is needed to do it again.
    """

    dataset: Mapping[str, Any]
    pipeline: str
    pipeline_hash: str
    protocol: str
    protocol_description: str
    n_folds: int
    contestants: tuple[Contestant, ...]
    signals: str
    time_limit_s: float
    versions: Mapping[str, str]
    peer_versions: Mapping[str, str]
    seed: int
    input_hash: str
    notes: tuple[str, ...] = field(default=())

    @property
    def reference(self) -> Contestant:
        """Our row that all others are compared with."""
        return self.contestants[0]

    @property
    def best_peer(self) -> Contestant | None:
        """The most accurate peer of those that finished every fold; the first of equals."""
        finished = [c for c in self.contestants if not c.ours and c.accuracy and c.n_folds == self.n_folds]
        return max(finished, key=_accuracy, default=None)

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain JSON values; accuracies are fractions."""
        return {
            **asdict(self),
            "accuracy_unit": "fraction of tests; low and high are the 95 % interval",
            "contestants": [_contestant(c) for c in self.contestants],
        }

    def to_json(self) -> str:
        """Return the comparison as JSON text."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"


def _accuracy(contestant: Contestant) -> float:
    return contestant.accuracy.mean if contestant.accuracy else 0.0


def _contestant(contestant: Contestant) -> dict[str, Any]:
    accuracy, difference = contestant.accuracy, contestant.difference
    found = asdict(contestant)
    if accuracy is not None:
        low, high = accuracy.interval
        found["accuracy"] = {"mean": accuracy.mean, "low": low, "high": high, **found["accuracy"]}
    if difference is not None:
        low, high = difference.interval
        del found["difference"]["interval"]
        found["difference"] |= {"low": low, "high": high}
    return found
