"""What is deployed: recordings in, materials out, computing only what the selected features need."""

import copy
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from sklearn.feature_selection import SelectorMixin
from sklearn.impute import SimpleImputer
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import MaxAbsScaler, MinMaxScaler, RobustScaler, StandardScaler

from texclass import __version__
from texclass.atomic_write import write_atomic
from texclass.evaluation.trusted import archive_of, load_trusted, read_bounded
from texclass.features.extractor import FeatureExtractor
from texclass.features.phase_view import Channels
from texclass.features.plan import Plan
from texclass.features.sets import FeatureSet
from texclass.recording import Samples

COLUMN_WISE: Mapping[type, tuple[str, ...]] = {
    SimpleImputer: ("statistics_",),
    StandardScaler: ("mean_", "var_", "scale_"),
    MinMaxScaler: ("min_", "scale_", "data_min_", "data_max_", "data_range_"),
    MaxAbsScaler: ("max_abs_", "scale_"),
    RobustScaler: ("center_", "scale_"),
}
"""Steps that treat each column by itself, and their fitted attributes of shape (n_columns,)."""


class Recogniser(Pipeline):  # type: ignore[misc]
    """Recordings in, materials out: a `FeatureExtractor`, steps that prepare its columns, a classifier.

    Parameters
    ----------
    steps : list of (name, estimator)
        The first a `FeatureExtractor`. Nothing that `Pipeline` has is changed.

    Examples
    --------
    >>> from sklearn.naive_bayes import GaussianNB
    >>> from texclass.features import FeatureExtractor
    >>> recogniser = Recogniser([("features", FeatureExtractor("texclass")), ("classifier", GaussianNB())])
    """

    @classmethod
    def fitted_on(
        cls, plan: Plan, values: Samples, materials: NDArray[Any], steps: Sequence[tuple[str, Any]]
    ) -> Self:
        """Fit the steps on features that are extracted already.

        Parameters
        ----------
        plan : Plan
            What was extracted.
        values : ndarray of shape (n_recordings, n_columns)
            The plan's columns; NaN where undefined.
        materials : ndarray of shape (n_recordings,)
            Labels.
        steps : sequence of (name, estimator)
            Unfitted, the classifier last.
        """
        learnt = Pipeline(list(steps)).fit(values, materials)
        return cls([("features", _extractor(plan)), *learnt.steps])

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that are computed."""
        plan: Plan = self[0].plan_
        return plan.columns

    def prune(self) -> "Recogniser":
        """Return a recogniser that computes only what its selected columns need: the same predictions.

        Selectors go; imputers and scalers keep what belongs to the columns that are left. A step that mixes
        columns (a PCA) needs all it was fitted on, and so keeps what stands before it.
        """
        steps = list(_flat(self.steps[1:-1]))
        wanted: NDArray[np.intp] | None = None  # columns of a step's output that later steps need; None: all
        pruned: list[tuple[str, Any]] = []
        mixing = [not isinstance(step, SelectorMixin) and type(step) not in COLUMN_WISE for _, step in steps]
        for i, (name, step) in reversed(list(enumerate(steps))):
            if isinstance(step, SelectorMixin) and not any(mixing[:i]):
                kept = np.flatnonzero(step.get_support())
                wanted = kept if wanted is None else kept[wanted]
            elif type(step) in COLUMN_WISE and not getattr(step, "add_indicator", False):
                kept = np.arange(step.n_features_in_)
                if isinstance(step, SimpleImputer) and not step.keep_empty_features:
                    kept = np.flatnonzero(~np.isnan(step.statistics_))  # empty columns are left out
                wanted = kept if wanted is None else kept[wanted]
                pruned.insert(0, (name, _sliced(step, wanted)))
            else:
                pruned.insert(0, (name, step))
                wanted = None
        plan: Plan = self[0].plan_
        columns = plan.columns if wanted is None else [plan.columns[i] for i in wanted]
        signal = {"fs": self[0].fs, "unit": self[0].unit}
        extractor = _extractor(plan.restricted_to(columns), **signal)
        return Recogniser([("features", extractor), *pruned, self.steps[-1]])

    def save(self, path: str | Path) -> None:
        """Write the fitted recogniser with skops, which holds data and names of classes, and no code."""
        write_atomic(Path(path), archive_of(self.document()))

    def document(self) -> dict[str, Any]:
        """Return the fitted recogniser as what skops writes: plain data and scikit-learn objects."""
        plan: Plan = self[0].plan_
        return {
            "texclass": __version__,
            "plan": plan.to_json(),
            "channels": list(plan.channels),
            "signal": {"fs": self[0].fs, "unit": self[0].unit},
            "steps": [list(step) for step in self.steps[1:]],
        }

    @classmethod
    def of_document(cls, document: Mapping[str, Any]) -> tuple[Self, bool]:
        """Return the recogniser of a `document`, and whether the code of its features is still the same."""
        plan, same = Plan.of_json(document["plan"], document["channels"])
        extractor = _extractor(plan, **document["signal"])
        return cls([("features", extractor), *((name, step) for name, step in document["steps"])]), same


def load_recogniser(path: str | Path) -> Recogniser:
    """Read a recogniser that `Recogniser.save` wrote; nothing but known classes is ever loaded.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file is none of ours, names a class that is not trusted, or a feature that is not known here.

    Warns
    -----
    UserWarning
        If the code of the features is not the one it was trained with.
    """
    try:
        recogniser, same = Recogniser.of_document(load_trusted(read_bounded(path)))
    except FileNotFoundError:
        raise
    except Exception as error:
        raise ValueError(f"{path}: not a recogniser of texclass ({error})") from error
    if not same:
        warnings.warn(
            "the code of the features has changed since this recogniser was trained; train it again",
            UserWarning,
            stacklevel=2,
        )
    return recogniser


def _extractor(plan: Plan, fs: float | None = None, unit: str | None = None) -> FeatureExtractor:
    """Return an extractor that is fitted: it has its plan."""
    whole = tuple(member for _, part in plan.parts for member in part.members)
    feature_set = plan.parts[0][1] if len(plan.parts) == 1 else FeatureSet(plan.parts[0][1].name, whole)
    kept: Channels = "each" if plan.channels else "combine"
    extractor = FeatureExtractor(feature_set, channels=kept, fs=fs, unit=unit)
    extractor.feature_set_, extractor.plan_ = feature_set, plan
    return extractor


def _flat(steps: Sequence[tuple[str, Any]]) -> list[tuple[str, Any]]:
    """Return the steps with pipelines inside them opened and what does nothing left out."""
    flat: list[tuple[str, Any]] = []
    for name, step in steps:
        inside = _flat(step.steps) if isinstance(step, Pipeline) else [(name, step)]
        flat += [(f"{name}-{n}" if step is not s else n, s) for n, s in inside]
    return [(name, step) for name, step in flat if step not in (None, "passthrough")]


def _sliced(step: Any, columns: NDArray[np.intp]) -> Any:
    """Return a fitted column-wise step for some of its columns."""
    sliced = copy.deepcopy(step)
    for name in COLUMN_WISE[type(step)]:
        if getattr(step, name, None) is not None:
            setattr(sliced, name, getattr(step, name)[columns])
    sliced.n_features_in_ = len(columns)
    if np.ndim(getattr(step, "n_samples_seen_", 0)) == 1:  # counted by column where some are NaN
        sliced.n_samples_seen_ = step.n_samples_seen_[columns]
    if hasattr(sliced, "feature_names_in_"):
        sliced.feature_names_in_ = sliced.feature_names_in_[columns]
    return sliced
