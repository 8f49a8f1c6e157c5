"""What may be trained: rows of a pipeline with each of its classifiers, and a selection under a budget."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sklearn.pipeline import Pipeline

from texclass.experiment.choice import Limits
from texclass.experiment.cost import CostMeter
from texclass.experiment.feature_table import FeatureTable
from texclass.experiment.pipeline import MatchedRow, PipelineDefinition
from texclass.features.extractor import Plan
from texclass.tradeoff.front import cost_aware, discriminant, preparation

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
    ms
        What its features take, per recording.
    """

    row: str
    classifier_name: str
    plan: Plan
    preparation: Pipeline
    classifier: Any
    ms: float

    @property
    def steps(self) -> list[tuple[str, Any]]:
        """The unfitted steps after the features."""
        return [*self.preparation.steps, ("classifier", self.classifier)]

    def __str__(self) -> str:
        return f"{self.row} with {self.classifier_name}"


def candidates_of(
    pipeline: PipelineDefinition,
    table: FeatureTable,
    meter: CostMeter,
    limits: Limits,
    *,
    row: str | None = None,
    classifier: str | None = None,
) -> tuple[Candidate, ...]:
    """Return what may be trained, and is affordable.

    Parameters
    ----------
    pipeline : PipelineDefinition
        Rows and classifiers.
    table : FeatureTable
        What the dataset has.
    meter : CostMeter
        Measures what rows cost.
    limits : Limits
        `max_ms` and `max_features`. Within them, columns of the whole set are also selected.
    row, classifier : str, optional
        Only this one.

    Raises
    ------
    ValueError
        If there is no such row or classifier, the dataset lacks what the row needs, or nothing is affordable.
    """
    names = [r.name for r in pipeline.rows]
    _check_named(row, [*names, BUDGET], "row", pipeline.name)
    _check_named(classifier, list(pipeline.classifiers), "classifier", pipeline.name)
    limited = limits.max_ms is not None or limits.max_features is not None
    found = [
        candidate
        for name in ([row] if row not in (None, BUDGET) else [] if row == BUDGET else names)
        for candidate in _of_row(pipeline, table, meter, limits, str(name), classifier)
    ]
    if row == BUDGET or (limited and row is None and classifier is None):
        found.append(_selected(pipeline, table, meter, limits))
    if not found:
        raise ValueError(
            f"pipeline {pipeline.name}: {_missing(pipeline, table, row)}; the rule is at least one row that "
            f"the dataset has the features for{' within the budget' if limited else ''}"
        )
    return tuple(found)


def _of_row(
    pipeline: PipelineDefinition,
    table: FeatureTable,
    meter: CostMeter,
    limits: Limits,
    name: str,
    classifier: str | None,
) -> list[Candidate]:
    definition = next(r for r in pipeline.rows if r.name == name)
    matched = MatchedRow.of(definition, pipeline.features, table)
    if not matched.columns or matched.n_features > (limits.max_features or len(table.columns)):
        return []
    ms = meter.milliseconds(pipeline.features.restricted_to(definition.features))
    if limits.max_ms is not None and ms > limits.max_ms:
        return []
    plan = Plan.of(pipeline.features, meter.channels).restricted_to(matched.columns)
    return [
        Candidate(name, c, plan, pipeline.preparation(definition, c), use.make(), ms)
        for c, use in pipeline.classifiers.items()
        if classifier == c or (classifier is None and c in definition.judged_by(pipeline.classifiers))
    ]


def _selected(
    pipeline: PipelineDefinition, table: FeatureTable, meter: CostMeter, limits: Limits
) -> Candidate:
    """Return the selection under the budget: the tradeoff's, chosen anew inside each fold."""
    whole = Plan.of(pipeline.features, meter.channels)
    plan = whole.restricted_to(c for c in table.columns if table.frame[c].notna().any())
    columns, costs = plan.columns, meter.model(pipeline.features).restricted_to(plan.columns)
    cheapest = min(costs.of([i]) for i in range(len(columns)))
    if limits.max_ms is not None and limits.max_ms < cheapest:
        raise ValueError(
            f"max_ms is {limits.max_ms:g}; the rule is at least {cheapest:.3g}, the cheapest feature"
        )
    selector = cost_aware(costs, max_cost=limits.max_ms, max_features=limits.max_features)
    steps = Pipeline([*preparation().steps, ("select", selector)])
    return Candidate(BUDGET, "lda", plan, steps, discriminant(), limits.max_ms or costs.total)


def _check_named(given: str | None, known: Sequence[str], what: str, where: str) -> None:
    if given is not None and given not in known:
        raise ValueError(f"pipeline {where} has no {what} {given!r}; the rule is one of {', '.join(known)}")


def _missing(pipeline: PipelineDefinition, table: FeatureTable, row: str | None) -> str:
    lacking = (MatchedRow.of(r, pipeline.features, table) for r in pipeline.rows if row in (None, r.name))
    return next((f"{m.definition.name}: {m.missing}" for m in lacking if m.missing), "no row is affordable")
