"""What may be trained, what each candidate says of recordings it was not trained on, and which is best."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.pipeline import Pipeline

from texclass import shipped
from texclass.classifiers.kernel_discriminant import KernelDiscriminant
from texclass.classifiers.segment_voting import with_segment_columns
from texclass.evaluation.accuracy import Accuracy, cluster_interval, score
from texclass.evaluation.cost import CostMeter
from texclass.evaluation.feature_table import FeatureTable
from texclass.evaluation.folds import Fold, over_folds
from texclass.evaluation.pipeline import MatchedRow, PipelineDefinition
from texclass.evaluation.splits import Split
from texclass.features.plan import Plan
from texclass.recognition.probabilities import class_scores
from texclass.recognition.unknown import fit_nearness, kind_for, strangeness
from texclass.recording import Samples
from texclass.tradeoff.front import cost_aware, discriminant, preparation

Labels = NDArray[Any]
BUDGET = "budget"
"""Name of the row whose columns are selected under a budget."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """One way to recognise surfaces.

    Attributes
    ----------
    row, classifier_name
        What it is called in the pipeline.
    plan
        The features it computes.
    preparation, classifier
        Unfitted.
    n_columns
        Of equally good ones the one with fewest is taken: a count, the same on every machine.
    """

    row: str
    classifier_name: str
    plan: Plan
    preparation: Pipeline
    classifier: Any
    n_columns: int

    def trained_on(self, frame: pd.DataFrame) -> tuple[Samples, Labels]:
        """Return its columns of a table, shape (n, n_columns), and the surfaces, shape (n,)."""
        X = frame[list(self.plan.columns)].to_numpy(dtype=np.float64)
        return X, frame["surface"].to_numpy(dtype=str)

    @property
    def steps(self) -> list[tuple[str, Any]]:
        """The unfitted steps after the features."""
        return [*self.preparation.steps, ("classifier", self.classifier)]

    def __str__(self) -> str:
        return f"{self.row} with {self.classifier_name}"


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


def candidates_of(
    pipeline: PipelineDefinition,
    table: FeatureTable,
    meter: CostMeter,
    *,
    row: str | None = None,
    classifier: str | None = None,
    max_ms: float | None = None,
    max_features: int | None = None,
    max_kb: float | None = None,
) -> list[Candidate]:
    """Return what may be trained, and is affordable.

    Parameters
    ----------
    pipeline : PipelineDefinition
        Rows and classifiers.
    table : FeatureTable
        What the dataset has.
    meter : CostMeter
        Of the dataset; measures what columns cost, once, where milliseconds are limited.
    row, classifier : str, optional
        Only this one; the row "budget" is a selection among the columns of the whole set.
    max_ms, max_features : optional
        Milliseconds of the features, columns at the classifier. Within them, columns are also selected.
    max_kb : float, optional
        Kilobytes of kernels; other classifiers are as they are.

    Raises
    ------
    ValueError
        If there is no such row or classifier, the dataset lacks what the row needs, nothing is affordable, or
        kilobytes are limited and none is a kernel.
    """
    _check_named(row, [*(r.name for r in pipeline.rows), BUDGET], "row", pipeline.name)
    _check_named(classifier, list(pipeline.classifiers), "classifier", pipeline.name)
    whole = Plan.of(pipeline.features, meter.channels)
    costs = meter.kept(pipeline.features) if max_ms is not None else None
    found, lacking = [], list[str]()
    for definition in pipeline.rows:
        if row not in (None, definition.name):
            continue
        matched = MatchedRow.of(definition, pipeline.features, table)
        lacking += [f"{definition.name}: {matched.missing}"] * bool(matched.missing)
        if not matched.columns or matched.n_features > (max_features or len(table.columns)):
            continue
        if costs is not None and costs.cost(matched.columns) > (max_ms or 0):
            continue
        plan = whole.restricted_to(matched.columns)
        judges = definition.judged_by(pipeline.classifiers) if classifier is None else (classifier,)
        found += [
            Candidate(
                definition.name,
                name,
                plan,
                pipeline.preparation(definition, name),
                with_segment_columns(use.make(), plan.columns),
                matched.n_features,
            )
            for name, use in pipeline.classifiers.items()
            if name in judges
        ]
    limited = max_ms is not None or max_features is not None
    if row == BUDGET or (limited and row is None and classifier is None):
        plan = whole.restricted_to(c for c in table.columns if table.frame[c].notna().any())
        found.append(_selected(plan, pipeline, meter, max_ms, max_features))
    if not found:
        raise ValueError(
            f"pipeline {pipeline.name}: {lacking[0] if lacking else 'no row is affordable'}. Expected at "
            f"least one row that the dataset has the features for{' within the budget' if limited else ''}"
        )
    return found if max_kb is None else _of_size(found, max_kb)


def _check_named(given: str | None, known: Sequence[str], what: str, where: str) -> None:
    if given is not None and given not in known:
        raise ValueError(f"pipeline {where} has no {what} {given!r}. Expected one of {', '.join(known)}")


def _selected(
    plan: Plan, pipeline: PipelineDefinition, meter: CostMeter, max_ms: float | None, max_features: int | None
) -> Candidate:
    """Return the selection under the budget: the tradeoff's, chosen anew inside each fold."""
    costs = meter.kept(pipeline.features).restricted_to(plan.columns)
    cheapest = min(costs.of([i]) for i in range(len(plan.columns)))
    if max_ms is not None and max_ms < cheapest:
        raise ValueError(
            f"max_ms is {max_ms:g}. Expected at least {cheapest:.3g}: the cheapest feature, and "
            f"{costs.segmentation_ms:.3g} for finding the phases"
        )
    selector = cost_aware(costs, max_cost=max_ms, max_features=max_features)
    steps = Pipeline([*preparation().steps, ("select", selector)])
    most = min(max_features or len(plan.columns), len(plan.columns))
    return Candidate(BUDGET, "lda", plan, steps, discriminant(), most)


def exportable(
    candidates: Sequence[Candidate],
) -> tuple[list[Candidate], list[Candidate], tuple[str, ...]]:
    """Return the candidates without features that have no graph (`texclass export --from samples`).

    And those with all features, to compare them with, and the names of the features left out: none of either
    where nothing is.

    Raises
    ------
    ValueError
        If nothing is left of any.
    """
    without_graph = shipped.module_of("exporters", "onnx").without_graph
    found, lacking = [], dict[str, None]()
    for candidate in candidates:
        plan, columns = candidate.plan, []
        for prefix, part in plan.parts:
            left_out = without_graph(part)
            lacking |= dict.fromkeys(left_out)
            columns += [f"{prefix}{c}" for m in part.members if m.name not in left_out for c in m.columns]
        # Of fewer columns than it is to keep, a selector cannot select.
        selects = candidate.n_columns < len(plan.columns)
        if columns and not (selects and candidate.n_columns >= len(columns)):
            n = min(candidate.n_columns, len(columns))
            kept = plan.restricted_to(columns)
            classifier = with_segment_columns(candidate.classifier, kept.columns)
            found.append(replace(candidate, plan=kept, classifier=classifier, n_columns=n))
    if not found:
        raise ValueError(
            f"no row has a feature with a graph ({', '.join(lacking)} have none). Expected at least one, "
            "or no --exportable"
        )
    return found, list(candidates) if lacking else [], tuple(lacking)


def _of_size(candidates: Sequence[Candidate], max_kb: float) -> list[Candidate]:
    """Return the candidates with kernels of at most so many kilobytes."""
    kernels = [isinstance(candidate.classifier, KernelDiscriminant) for candidate in candidates]
    if not any(kernels):
        raise ValueError(
            f"max_kb is {max_kb:g}, but no candidate is a KernelDiscriminant. Expected at least one"
        )
    return [
        replace(c, classifier=clone(c.classifier).set_params(max_kb=max_kb)) if is_kernel else c
        for c, is_kernel in zip(candidates, kernels, strict=True)
    ]


def without_choice(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the one of all columns with a classifier that weighs them itself; all, if none does.

    With few recordings nearly every candidate is right on all that are held out, so that what is chosen is
    chosen by chance; many features fail less when something changes later.
    """
    able = [c for c in candidates if kind_for(c.classifier) == "decision"]
    return [max(able, key=lambda c: len(c.plan.columns))] if able else list(candidates)


def untested(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the one candidate that can be trained without any recording to test it on.

    Raises
    ------
    ValueError
        If its decisions need several recordings of each surface to be understood.
    """
    (candidate, *others) = candidates
    if others or kind_for(candidate.classifier) != "decision":
        raise ValueError(
            f"1 recording (or run) of a surface trains {candidate.classifier_name}. Expected 2 or more, "
            "or the pipeline surfaces"
        )
    return [candidate]


def hold_out(candidate: Candidate, frame: pd.DataFrame, splits: Sequence[Split]) -> HeldOut:
    """Fit preparation and classifier on each fold's training part, decide on its test part.

    Parameters
    ----------
    candidate : Candidate
        What is fitted.
    frame : DataFrame
        A feature table with the surfaces.
    splits : sequence of (train, test)
        Rows.
    """
    X, y = candidate.trained_on(frame)
    classes, labels = np.unique(y, return_inverse=True)
    if not splits:
        nothing = np.empty(0, dtype=np.intp)
        return HeldOut(nothing, np.empty((0, len(classes))), np.empty(0), nothing)

    def said(fold: Fold) -> tuple[NDArray[Any], ...]:
        classifier = fold.fitted(candidate.classifier)
        decisions = np.full((len(fold.test), len(classes)), -np.inf)
        decisions[:, np.searchsorted(classes, classifier.classes_)] = class_scores(classifier, fold.asked)
        kind = kind_for(classifier)
        known = np.unique(fold.labels, return_inverse=True)[1]
        near = fit_nearness(fold.learnt, known) if kind == "distance" else None
        return fold.test, decisions, strangeness(kind, decisions, fold.asked, near), labels[fold.test]

    folds = over_folds(said, X, y, splits, candidate.preparation)
    return HeldOut(*(np.concatenate(parts) for parts in zip(*folds, strict=True)))


def accuracy_of_choice(
    hits: NDArray[np.bool_], n_columns: Sequence[int], clusters: Labels, seed: int
) -> tuple[int, Accuracy]:
    """Return the best candidate, and the accuracy to be expected of a candidate chosen so.

    The best of many is best partly by luck. Recordings are drawn with replacement; the best on those drawn is
    scored on those that were not, and the mean of this over many draws is free of that luck.

    Parameters
    ----------
    hits : ndarray of bool, shape (n_candidates, n)
        Whether each candidate was right on each held-out recording.
    n_columns : sequence of int
        Of each candidate; of equally good ones the one with fewest is taken, then the first.
    clusters : ndarray of shape (n,)
        Which recording (or run) each test comes from; drawn as a whole.
    seed : int
        Of the draws.

    References
    ----------
    Tsamardinos, Greasidou, Borboudakis: Bootstrapping the out-of-sample predictions for efficient and
    accurate cross-validation, Machine Learning 107, 2018.
    """
    best = _best(hits.mean(axis=1)[None], n_columns)[0]
    if len(hits) == 1:
        return best, score([np.ones(hits.shape[1], dtype=bool)], [hits[0]], [clusters])
    _, cluster = np.unique(clusters, return_inverse=True)
    n_tests = np.bincount(cluster)
    by_cluster = np.array([np.bincount(cluster, weights=h) for h in hits])  # (n_candidates, n_clusters)
    rng, n = np.random.default_rng(seed), len(n_tests)
    times = rng.multinomial(n, np.full(n, 1 / n), size=1000)  # bootstrap samples
    times = times[(times == 0).any(axis=1)]  # of few recordings some draws hold all
    winners = _best(times @ by_cluster.T / (times @ n_tests)[:, None], n_columns)
    left = times == 0
    found = (left * by_cluster[winners]).sum(axis=1) / (left @ n_tests)
    n_hits = round(float(found.mean()) * hits.shape[1])
    low, high = (
        np.quantile(found, [0.025, 0.975]) if np.ptp(found) else cluster_interval(hits[best], clusters)
    )
    return best, Accuracy(n_hits, hits.shape[1], bounds=(float(low), float(high)))


def _best(accuracy: Samples, n_columns: Sequence[int]) -> NDArray[np.intp]:
    """Return the column with the largest value in each row, of equals the candidate with fewest columns."""
    order = np.argsort(np.asarray(n_columns), kind="stable")
    return np.asarray(order[accuracy[:, order].argmax(axis=1)])
