"""What a trade-off study found: costs, fronts, curves, the chosen pipeline, and how it was done."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from texclass.experiment.accuracy import wilson_interval
from texclass.experiment.cost import ClassifierCost
from texclass.experiment.paired import corrected_resampled_t

KNEE_LOSS = 0.01
"""The knee is the cheapest point that loses at most this much accuracy to the best one: 1 point."""


@dataclass(frozen=True)
class Estimate:
    """An accuracy as a fraction, with its 95 % interval."""

    mean: float
    low: float
    high: float


def estimate(folds: ArrayLike, n_test: float, n_train: float) -> Estimate:
    """Return mean and 95 % interval of the accuracies of repeated cross-validation.

    The interval is that of the corrected resampled t-test; where all folds agree, their spread tells nothing:
    then it is Wilson's over the recordings of one repeat.

    Parameters
    ----------
    folds : array_like of shape (n_repeats * n_folds,)
        Accuracy of each fold of each repeat.
    n_test, n_train : float
        Recordings of a fold.
    """
    a = np.asarray(folds, dtype=np.float64)
    mean = float(a.mean())
    if np.ptp(a) == 0:
        n = round(n_test + n_train)
        return Estimate(mean, *wilson_interval(round(mean * n), n))
    (low, high), _ = corrected_resampled_t(a, n_test / n_train)
    return Estimate(mean, max(0.0, low), min(1.0, high))


@dataclass(frozen=True)
class FrontPoint:
    """What a budget buys.

    Attributes
    ----------
    budget_ms
        What a choice may cost per recording.
    ms
        What the choices of all folds cost, on average.
    accuracy
        Of recordings that had no part in the choice.
    plain
        The same for plain sequential selection, which does not look at costs and ends at the budget.
    n_features, n_columns
        Of the choices, on average.
    """

    budget_ms: float
    ms: float
    accuracy: Estimate
    plain: Estimate
    n_features: float
    n_columns: float


@dataclass(frozen=True)
class Curve:
    """Accuracy against something that costs.

    Attributes
    ----------
    name, unit
        What is varied, and its unit.
    series
        Label of this curve, where several share a panel.
    x
        Its values; `labels` are how they are printed.
    accuracy
        One a value.
    note
        How it was measured.
    """

    name: str
    unit: str
    x: tuple[float, ...]
    accuracy: tuple[Estimate, ...]
    labels: tuple[str, ...] = ()
    series: str = ""
    note: str = ""


@dataclass(frozen=True)
class FeatureCost:
    """What a feature costs per recording, in ms.

    Attributes
    ----------
    feature
        Name.
    share
        Its share of the full set: shared transforms split equally between those that need them.
    alone
        When nothing else is computed.
    last
        What leaving it out of the full set would save.
    """

    feature: str
    share: float
    alone: float
    last: float


@dataclass(frozen=True)
class Chosen:
    """The pipeline at the budget.

    Attributes
    ----------
    why
        Which rule chose it.
    columns, features
        What it computes.
    predicted_ms, measured_ms
        Cost by the model, and of the pruned pipeline itself.
    accuracy
        Nested estimate of choosing so.
    file
        Where it was saved; empty if it was not.
    """

    why: str
    columns: tuple[str, ...]
    features: tuple[str, ...]
    predicted_ms: float
    measured_ms: float
    accuracy: Estimate
    file: str = ""


@dataclass(frozen=True, eq=False)
class Tradeoff:
    """A trade-off study; see `run_tradeoff`.

    Attributes
    ----------
    dataset
        Facts.
    features
        Name of the feature set.
    protocol
        How recordings were split.
    costs
        One a feature, dearest first.
    parts
        Shared transforms and conditioning -> ms.
    segmentation_ms, total_ms
        Finding phases (part of no cost), and the full set.
    model_check
        (predicted, measured) ms of random subsets.
    classifiers
        Costs of classifiers on all columns.
    full
        Accuracy of the full set.
    front : tuple of FrontPoint
        By rising budget.
    fewest : tuple of (number of columns, Estimate)
        For a scene's materials: accuracy of the best so many columns; empty without.
    curves
        Accuracy against touch, training, rate, bits, order.
    chosen
        The pipeline at the budget.
    versions, seed, input_hash
        What is needed to do it again.
    notes
        What a reader must know.
    """

    dataset: Mapping[str, Any]
    features: str
    protocol: str
    costs: tuple[FeatureCost, ...]
    parts: Mapping[str, float]
    segmentation_ms: float
    total_ms: float
    model_check: tuple[tuple[float, float], ...]
    classifiers: tuple[ClassifierCost, ...]
    full: Estimate
    front: tuple[FrontPoint, ...]
    fewest: tuple[tuple[int, Estimate], ...]
    curves: tuple[Curve, ...]
    chosen: Chosen
    versions: Mapping[str, str]
    seed: int
    input_hash: str
    notes: tuple[str, ...] = ()

    @property
    def knee(self) -> FrontPoint:
        """The cheapest point of the front that loses at most `KNEE_LOSS` to its best."""
        return knee(self.front)

    @property
    def at_half(self) -> FrontPoint:
        """The dearest point of the front within half the cost of the full set."""
        affordable = [p for p in self.front if p.budget_ms <= self.total_ms / 2 * (1 + 1e-9)]
        return affordable[-1] if affordable else self.front[0]

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON values; accuracies as fractions."""
        return asdict(self) | {
            "dataset": dict(self.dataset),
            "parts": dict(self.parts),
            "versions": dict(self.versions),
            "knee": asdict(self.knee),
            "knee_rule": f"cheapest point within {KNEE_LOSS:.0%} of the best accuracy",
            "at_half_cost": asdict(self.at_half),
        }

    def to_json(self) -> str:
        """Return the study as JSON text."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"


def knee(front: tuple[FrontPoint, ...]) -> FrontPoint:
    """Return the cheapest point that loses at most `KNEE_LOSS` to the best one."""
    best = max(point.accuracy.mean for point in front)
    return next(point for point in front if point.accuracy.mean >= best - KNEE_LOSS)
