"""The same answers sooner: fitted steps as plain arithmetic, without the checks of a general library."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.impute import SimpleImputer
from sklearn.preprocessing import MinMaxScaler, StandardScaler

from texclass.experiment.kernel_discriminant import KernelDiscriminant
from texclass.recognition.model import Model
from texclass.recognition.unknown import strangeness
from texclass.recording import Samples

Step = Callable[[Samples], Samples]


@dataclass(frozen=True, eq=False)
class LeanModel(Model):
    """A model that judges single rows in microseconds: the arithmetic of scikit-learn's steps, nothing else.

    Steps and classifiers it does not know are left to `Model`.
    """

    @classmethod
    def of(cls, model: Model) -> "LeanModel":
        """Return the lean form of a model."""
        return cls(**{f.name: getattr(model, f.name) for f in fields(Model)})

    def judge(self, X: Samples) -> tuple[Samples, Samples]:
        """Return probabilities (n, n_materials), and p-values of "known" (n,), of rows of features."""
        if self._steps is None:
            return super().judge(X)
        prepared = X
        for step in self._steps[:-1]:
            prepared = step(prepared)
        if not np.isfinite(prepared).all():
            raise ValueError("features are undefined; the rule is a pipeline with a step that fills them")
        decisions, novelty = self._steps[-1](prepared), self.novelty
        strange = strangeness(novelty.kind, decisions, prepared, novelty.nearness)
        return self.calibration(decisions), novelty.p_value(strange)

    @cached_property
    def _steps(self) -> tuple[Step, ...] | None:
        """The steps after the features; None where one of them is not known."""
        found = [_plain(step) for _, step in self.recogniser.steps[1:-1]]
        found.append(_decide(self.recogniser.steps[-1][1]))
        return None if None in found else tuple(step for step in found if step is not None)


def _plain(step: Any) -> Step | None:
    match step:
        case "passthrough" | None:
            return lambda X: X
        case SimpleImputer(add_indicator=False) if np.isnan(step.missing_values):
            if np.isnan(step.statistics_).any():  # such columns are left out, or filled in some other way
                return None
            return lambda X: np.where(np.isnan(X), step.statistics_, X)
        case MinMaxScaler(clip=False):
            return lambda X: X * step.scale_ + step.min_
        case StandardScaler(with_mean=True, with_std=True):
            return lambda X: (X - step.mean_) / step.scale_
    return None


def _decide(classifier: Any) -> Step | None:
    if isinstance(classifier, LinearDiscriminantAnalysis) and len(classifier.classes_) > 2:
        return lambda X: np.asarray(X @ classifier.coef_.T + classifier.intercept_)
    if isinstance(classifier, KernelDiscriminant) and len(classifier.classes_) > 2:
        return lambda X: np.asarray(
            classifier._kernel([view(X) for view in classifier.views_]) @ classifier.dual_
        )
    return None
