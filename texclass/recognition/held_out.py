"""What a candidate says of recordings it was not trained on, and which candidate is best."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn import config_context
from sklearn.base import clone

from texclass.experiment.accuracy import Accuracy, score, wilson_interval
from texclass.experiment.protocols import Split
from texclass.recognition.calibration import class_scores
from texclass.recognition.candidates import Candidate
from texclass.recognition.unknown import fit_nearness, kind_for, strangeness
from texclass.recording import Samples

Labels = NDArray[Any]
N_DRAWS = 1000
"""Bootstrap samples of the choice."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """What was said of the test recordings of every fold, fold after fold.

    Attributes
    ----------
    rows : ndarray of shape (n,)
        Row of the table.
    decisions : ndarray of shape (n, n_classes)
        Of the classes, sorted.
    strange : ndarray of shape (n,)
        See `strangeness`.
    labels : ndarray of int, shape (n,)
        The right class.
    """

    rows: NDArray[np.intp]
    decisions: Samples
    strange: Samples
    labels: NDArray[np.intp]

    @property
    def hits(self) -> NDArray[np.bool_]:
        """Whether the largest decision is the right one, shape (n,)."""
        return np.asarray(self.decisions.argmax(axis=1) == self.labels)


def hold_out(candidate: Candidate, X: Samples, y: Labels, splits: Sequence[Split]) -> HeldOut:
    """Fit preparation and classifier on each fold's training part, decide on its test part.

    Parameters
    ----------
    candidate : Candidate
        What is fitted.
    X : ndarray of shape (n, n_columns)
        Its columns.
    y : ndarray of shape (n,)
        Materials.
    splits : sequence of (train, test)
        Rows.
    """
    classes, labels = np.unique(y, return_inverse=True)
    folds = []
    with config_context(assume_finite=True, skip_parameter_validation=True):
        for train, test in splits:
            prepare = clone(candidate.preparation).fit(X[train], y[train])
            learnt, asked = prepare.transform(X[train]), prepare.transform(X[test])
            if not (np.isfinite(learnt).all() and np.isfinite(asked).all()):
                raise ValueError(
                    "features are undefined (NaN) at the classifier; the rule is a step that fills them"
                )
            classifier = clone(candidate.classifier).fit(learnt, y[train])
            decisions = np.full((len(test), len(classes)), -np.inf)
            decisions[:, np.searchsorted(classes, classifier.classes_)] = class_scores(classifier, asked)
            kind = kind_for(classifier)
            known = np.unique(labels[train], return_inverse=True)[1]
            near = fit_nearness(learnt, known) if kind == "distance" else None
            folds.append((test, decisions, strangeness(kind, decisions, asked, near), labels[test]))
    return HeldOut(*(np.concatenate(parts) for parts in zip(*folds, strict=True)))


def accuracy_of_choice(
    hits: NDArray[np.bool_], ms: Sequence[float], clusters: Labels, seed: int
) -> tuple[int, Accuracy]:
    """Return the best candidate, and the accuracy to be expected of a candidate chosen so.

    The best of many is best partly by luck. Recordings are drawn with replacement; the best on those drawn is
    scored on those that were not, and the mean of this over many draws is free of that luck.

    Parameters
    ----------
    hits : ndarray of bool, shape (n_candidates, n)
        Whether each candidate was right on each held-out recording.
    ms : sequence of float
        What candidates cost; of equally good ones the cheapest is taken.
    clusters : ndarray of shape (n,)
        Which recording (or run) each test comes from; drawn as a whole.
    seed : int
        Of the draws.

    References
    ----------
    Tsamardinos, Greasidou, Borboudakis: Bootstrapping the out-of-sample predictions for efficient and
    accurate cross-validation, Machine Learning 107, 2018.
    """
    best = _best(hits.mean(axis=1)[None], ms)[0]
    if len(hits) == 1:
        return best, score([np.ones(hits.shape[1], dtype=bool)], [hits[0]], [clusters], seed=seed)
    _, cluster = np.unique(clusters, return_inverse=True)
    n_tests = np.bincount(cluster)
    by_cluster = np.array([np.bincount(cluster, weights=h) for h in hits])  # (n_candidates, n_clusters)
    rng, n = np.random.default_rng(seed), len(n_tests)
    times = rng.multinomial(n, np.full(n, 1 / n), size=N_DRAWS)
    winners = _best(times @ by_cluster.T / (times @ n_tests)[:, None], ms)
    left = times == 0
    found = (left * by_cluster[winners]).sum(axis=1) / (left @ n_tests)
    n_hits = round(float(found.mean()) * hits.shape[1])
    low, high = (
        np.quantile(found, [0.025, 0.975]) if np.ptp(found) else wilson_interval(round(n * found[0]), n)
    )
    return best, Accuracy(n_hits, hits.shape[1], bounds=(float(low), float(high)))


def _best(accuracy: Samples, ms: Sequence[float]) -> NDArray[np.intp]:
    """Return the column with the largest value in each row, the cheapest of equals."""
    order = np.argsort(np.asarray(ms), kind="stable")
    return np.asarray(order[accuracy[:, order].argmax(axis=1)])
