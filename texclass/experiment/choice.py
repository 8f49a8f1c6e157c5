"""The pipeline at the budget: chosen on all recordings by the rule that was tried inside the folds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from texclass.experiment.cost import CostModel
from texclass.features.extractor import Plan
from texclass.tradeoff.cost_selection import CostAwareSelector
from texclass.tradeoff.deploy import Recogniser
from texclass.tradeoff.front import Data, budgets_of, cost_aware, discriminant, fewest_path, preparation
from texclass.tradeoff.tradeoff_result import KNEE_LOSS, Chosen, Estimate, FrontPoint, knee


@dataclass(frozen=True)
class Limits:
    """What a user can afford.

    Attributes
    ----------
    max_ms
        Features of one recording, conditioning included, segmentation not; None takes the knee.
    max_seconds
        Of movement that is felt; None takes whole recordings.
    max_features
        Columns that reach the classifier.
    materials
        The scene's materials; all by default. With them, the fewest columns that separate just these.
    """

    max_ms: float | None = None
    max_seconds: float | None = None
    max_features: int | None = None
    materials: tuple[str, ...] = ()


NO_LIMITS = Limits()


def check(limits: Limits) -> None:
    """Refuse a limit that is not above 0.

    Raises
    ------
    ValueError
        If one is not.
    """
    for name, value in (("max_ms", limits.max_ms), ("max_features", limits.max_features)):
        if value is not None and not 0 < value < np.inf:
            raise ValueError(f"{name} is {value!r}; the rule is above 0, and finite")


def budgets_within(costs: CostModel, limits: Limits) -> tuple[float, ...]:
    """Return the budgets of the front, the user's among them.

    Raises
    ------
    ValueError
        If it buys nothing.
    """
    cheapest = min(costs.of([i]) for i in range(len(costs.columns)))
    if limits.max_ms is not None and limits.max_ms < cheapest:
        raise ValueError(
            f"max_ms is {limits.max_ms:g}; the rule is at least {cheapest:.3g}, the cheapest feature"
        )
    given = () if limits.max_ms is None else (min(limits.max_ms, costs.total),)
    return tuple(sorted({*budgets_of(costs), *given}))


def choose(
    limits: Limits,
    front: tuple[FrontPoint, ...],
    fewest: tuple[tuple[int, Estimate], ...],
    data: Data,
    costs: CostModel,
) -> Chosen:
    """Choose on all recordings by the rule that did best, or was asked for, inside the folds."""
    if fewest and limits.max_ms is None:
        best = max(accuracy.mean for _, accuracy in fewest)
        n, accuracy = next(pair for pair in fewest if pair[1].mean >= best - KNEE_LOSS)
        columns = fewest_path(preparation().fit_transform(data.X), data.y, data.groups, n)[n - 1]
        why = f"the fewest columns within {KNEE_LOSS:.0%} of the best that separate these materials"
        return _chosen(why, columns, accuracy, costs)
    within = [p for p in front if p.budget_ms <= (limits.max_ms or np.inf) * (1 + 1e-9)]
    point = knee(front) if limits.max_ms is None else within[-1]
    why = f"knee: the cheapest budget within {KNEE_LOSS:.0%} of the best accuracy"
    if limits.max_ms is not None:
        why = f"the best for {limits.max_ms:g} ms"
    if limits.max_features is None and point.budget_ms >= costs.total:
        return _chosen(f"{why}: everything", range(len(costs.columns)), point.accuracy, costs)
    selector: CostAwareSelector = cost_aware(
        costs, max_cost=point.budget_ms, max_features=limits.max_features
    ).fit(preparation().fit_transform(data.X), data.y, data.groups)
    return _chosen(why, selector.get_support(indices=True).tolist(), point.accuracy, costs)


def _chosen(why: str, columns: Sequence[int], accuracy: Estimate, costs: CostModel) -> Chosen:
    ordered = sorted(columns)
    return Chosen(
        why,
        tuple(costs.columns[i] for i in ordered),
        tuple(dict.fromkeys(costs.features[i] for i in ordered)),
        costs.of(ordered),
        float("nan"),
        accuracy,
    )


def deployed(plan: Plan, data: Data, usable: Sequence[str], columns: Sequence[str]) -> Recogniser:
    """Return the pruned pipeline of the chosen columns, fitted on all recordings."""
    chosen = plan.restricted_to(columns)
    X = data.X[:, [list(usable).index(c) for c in chosen.columns]]
    steps = [*preparation().steps, ("classifier", discriminant())]
    return Recogniser.fitted_on(chosen, X, data.y, steps)
