"""Candidates for training: feature subsets with classifiers, and the selection of the best."""

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
from texclass.evaluation.pipeline import MatchedRow, PipelineDefinition
from texclass.features.plan import Plan
from texclass.recognition.novelty import score_kind
from texclass.recording import Samples
from texclass.tradeoff.pareto_front import cost_aware_selector, discriminant, preprocessing

Labels = NDArray[Any]
BUDGET = "budget"
"""Name of the row whose columns are selected within a budget."""
N_BOOTSTRAP = 1000
"""Number of bootstrap samples for the accuracy of a selected candidate."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """One feature subset with one classifier, unfitted.

    Attributes
    ----------
    row, classifier_name : str
        Names in the pipeline.
    plan : Plan
        Features to compute.
    preparation : Pipeline
        Unfitted steps between features and classifier.
    classifier : classifier
        Unfitted classifier.
    n_columns : int
        Number of columns. Among equally accurate candidates, the one with the fewest columns is selected,
        because this number is the same on every machine (the latency is not).
    """

    row: str
    classifier_name: str
    plan: Plan
    preparation: Pipeline
    classifier: Any
    n_columns: int

    def training_set(self, frame: pd.DataFrame) -> tuple[Samples, Labels]:
        """Return the columns of a feature table, shape (n, n_columns), and the surfaces, shape (n,)."""
        X = frame[list(self.plan.columns)].to_numpy(dtype=np.float64)
        return X, frame["surface"].to_numpy(dtype=str)

    @property
    def steps(self) -> list[tuple[str, Any]]:
        """The unfitted steps after the features."""
        return [*self.preparation.steps, ("classifier", self.classifier)]

    def __str__(self) -> str:
        return f"{self.row} with {self.classifier_name}"


def list_candidates(
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
    """Return the candidates of a pipeline whose features are in the table, within a budget.

    Parameters
    ----------
    pipeline : PipelineDefinition
        Rows and classifiers.
    table : FeatureTable
        Features of the dataset.
    meter : CostMeter
        Meter of the cost of the columns, for `max_ms` and the row "budget".
    row, classifier : str, optional
        Row and classifier of the pipeline (default: all). The row "budget" selects from the columns of the
        whole feature set.
    max_ms : float, optional
        Largest latency of the features in ms (default: no limit).
    max_features : int, optional
        Largest number of columns at the classifier (default: no limit). Within a limit of latency or columns,
        columns are also selected.
    max_kb : float, optional
        Largest size of kernel discriminants in kB (default: no limit); no effect on other classifiers.

    Raises
    ------
    ValueError
        If there is no such row or classifier, the dataset lacks features of the row, no row is within the
        budget, or `max_kb` is given without a kernel discriminant.
    """
    _check_name(row, [*(r.name for r in pipeline.rows), BUDGET], "row", pipeline.name)
    _check_name(classifier, list(pipeline.classifiers), "classifier", pipeline.name)
    whole = Plan.of(pipeline.features, meter.channels)
    costs = meter.cached_model(pipeline.features) if max_ms is not None else None
    candidates, missing = [], list[str]()
    for definition in pipeline.rows:
        if row not in (None, definition.name):
            continue
        matched = MatchedRow.match(definition, pipeline.features, table)
        missing += [f"{definition.name}: {matched.missing}"] * bool(matched.missing)
        if not matched.columns or matched.n_features > (max_features or len(table.columns)):
            continue
        if costs is not None and costs.cost(matched.columns) > (max_ms or 0):
            continue
        plan = whole.restricted_to(matched.columns)
        names = definition.select_classifiers(pipeline.classifiers) if classifier is None else (classifier,)
        candidates += [
            Candidate(
                definition.name,
                name,
                plan,
                pipeline.preparation(definition, name),
                with_segment_columns(use.make(), plan.columns),
                matched.n_features,
            )
            for name, use in pipeline.classifiers.items()
            if name in names
        ]
    is_limited = max_ms is not None or max_features is not None
    if row == BUDGET or (is_limited and row is None and classifier is None):
        plan = whole.restricted_to(c for c in table.columns if table.frame[c].notna().any())
        candidates.append(_budget_candidate(plan, pipeline, meter, max_ms, max_features))
    if not candidates:
        raise ValueError(
            f"pipeline {pipeline.name}: {missing[0] if missing else 'no row is within the budget'}. Expected "
            f"at least one row with features of the dataset{', within the budget' if is_limited else ''}"
        )
    return candidates if max_kb is None else _limit_size(candidates, max_kb)


def _check_name(name: str | None, names: Sequence[str], kind: str, pipeline: str) -> None:
    if name is not None and name not in names:
        raise ValueError(f"pipeline {pipeline} has no {kind} {name!r}. Expected one of {', '.join(names)}")


def _budget_candidate(
    plan: Plan, pipeline: PipelineDefinition, meter: CostMeter, max_ms: float | None, max_features: int | None
) -> Candidate:
    """Return the candidate with cost-aware selection of columns inside each training set."""
    costs = meter.cached_model(pipeline.features).restricted_to(plan.columns)
    cheapest = min(costs.cost_of_indices([i]) for i in range(len(plan.columns)))
    if max_ms is not None and max_ms < cheapest:
        raise ValueError(
            f"max_ms must be at least {cheapest:.3g} ms (the cost of the cheapest feature, including "
            f"{costs.segmentation_ms:.3g} ms for the segmentation), got {max_ms:g} ms"
        )
    selector = cost_aware_selector(costs, max_cost=max_ms, max_features=max_features)
    steps = Pipeline([*preprocessing().steps, ("select", selector)])
    n_columns = min(max_features or len(plan.columns), len(plan.columns))
    return Candidate(BUDGET, "lda", plan, steps, discriminant(), n_columns)


def exportable_candidates(
    candidates: Sequence[Candidate],
) -> tuple[list[Candidate], list[Candidate], tuple[str, ...]]:
    """Return the candidates without features that `texclass export --from samples` cannot compute.

    Returns
    -------
    exportable : list of Candidate
        Candidates with exportable features only.
    others : list of Candidate
        All candidates with all features, for comparison; empty if all features are exportable.
    not_exportable : tuple of str
        Names of the features that are left out.

    Raises
    ------
    ValueError
        If no candidate has an exportable feature.
    """
    without_graph = shipped.module_of("exporters", "onnx").features_without_graph
    exportable, not_exportable = [], dict[str, None]()
    for candidate in candidates:
        plan, columns = candidate.plan, []
        for prefix, part in plan.parts:
            names = without_graph(part)
            not_exportable |= dict.fromkeys(names)
            columns += [f"{prefix}{c}" for m in part.members if m.name not in names for c in m.columns]
        # A selector needs more columns than it selects.
        is_selecting = candidate.n_columns < len(plan.columns)
        if columns and not (is_selecting and candidate.n_columns >= len(columns)):
            n = min(candidate.n_columns, len(columns))
            plan = plan.restricted_to(columns)
            classifier = with_segment_columns(candidate.classifier, plan.columns)
            exportable.append(replace(candidate, plan=plan, classifier=classifier, n_columns=n))
    if not exportable:
        raise ValueError(
            f"no row has an exportable feature: {', '.join(not_exportable)} cannot be computed by an ONNX "
            "graph. Select a row with other features (--row), or omit --exportable"
        )
    return exportable, list(candidates) if not_exportable else [], tuple(not_exportable)


def _limit_size(candidates: Sequence[Candidate], max_kb: float) -> list[Candidate]:
    """Return the candidates with the size of kernel discriminants limited to `max_kb`."""
    is_kernel = [isinstance(candidate.classifier, KernelDiscriminant) for candidate in candidates]
    if not any(is_kernel):
        raise ValueError(
            f"max_kb = {max_kb:g} has no effect: no candidate is a KernelDiscriminant. Select a "
            "KernelDiscriminant as classifier, or omit max_kb"
        )
    return [
        replace(c, classifier=clone(c.classifier).set_params(max_kb=max_kb)) if limited else c
        for c, limited in zip(candidates, is_kernel, strict=True)
    ]


def without_selection(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidate with the most columns whose classifier weights columns; all if there is none.

    With few recordings, nearly all candidates classify all held-out recordings correctly, so a selection
    would be random. A large number of features is more robust if later recordings differ.
    """
    weighting = [c for c in candidates if score_kind(c.classifier) == "decision"]
    return [max(weighting, key=lambda c: len(c.plan.columns))] if weighting else list(candidates)


def without_holdout(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the one candidate that can be trained without any held-out recording.

    Raises
    ------
    ValueError
        If there are several, or the classifier needs several recordings per surface.
    """
    (candidate, *others) = candidates
    if others or score_kind(candidate.classifier) != "decision":
        raise ValueError(
            f"{candidate.classifier_name} needs at least 2 recordings (or runs) per surface, got 1. "
            "Record more, or use the pipeline 'surfaces'"
        )
    return [candidate]


def select_best(
    hits: NDArray[np.bool_], n_columns: Sequence[int], clusters: Labels, seed: int
) -> tuple[int, Accuracy]:
    """Return the best candidate, and its accuracy corrected for the selection.

    The best of many candidates is best partly by chance. To correct this bias, recordings are drawn with
    replacement. The candidate with the highest accuracy on the drawn recordings is scored on the remaining
    ones, and the scores are averaged over many draws.

    Parameters
    ----------
    hits : ndarray of bool, shape (n_candidates, n)
        Whether the prediction of each candidate for each held-out recording is correct.
    n_columns : sequence of int
        Number of columns of each candidate. Among equally accurate candidates, the first one with the fewest
        columns is selected.
    clusters : ndarray of shape (n,)
        Recording (or run) of each test, which is drawn as a whole.
    seed : int
        Seed of the draws.

    Returns
    -------
    best : int
        Index of the best candidate.
    accuracy : Accuracy
        Corrected accuracy with its confidence interval.

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
    cluster_hits = np.array([np.bincount(cluster, weights=h) for h in hits])  # (n_candidates, n_clusters)
    rng, n = np.random.default_rng(seed), len(n_tests)
    n_draws = rng.multinomial(n, np.full(n, 1 / n), size=N_BOOTSTRAP)
    n_draws = n_draws[(n_draws == 0).any(axis=1)]  # with few clusters, a draw may contain all of them
    winners = _best(n_draws @ cluster_hits.T / (n_draws @ n_tests)[:, None], n_columns)
    is_test = n_draws == 0
    accuracies = (is_test * cluster_hits[winners]).sum(axis=1) / (is_test @ n_tests)
    n_hits = round(float(accuracies.mean()) * hits.shape[1])
    low, high = (
        np.quantile(accuracies, [0.025, 0.975])
        if np.ptp(accuracies)
        else cluster_interval(hits[best], clusters)
    )
    return best, Accuracy(n_hits, hits.shape[1], bounds=(float(low), float(high)))


def _best(accuracy: Samples, n_columns: Sequence[int]) -> NDArray[np.intp]:
    """Return the candidate with the highest accuracy in each row; ties go to the fewest columns."""
    order = np.argsort(np.asarray(n_columns), kind="stable")
    return np.asarray(order[accuracy[:, order].argmax(axis=1)])
