"""Fitted pipelines from recordings to surfaces that compute only what the selected features need."""

import copy
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.feature_selection import SelectorMixin
from sklearn.impute import SimpleImputer
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import MaxAbsScaler, MinMaxScaler, RobustScaler, StandardScaler

from texclass import __version__
from texclass.atomic_write import write_atomic
from texclass.classifiers.fitting import quiet_fits
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


def fit_recogniser(
    plan: Plan, values: Samples, surfaces: NDArray[Any], steps: Sequence[tuple[str, Any]]
) -> Pipeline:
    """Return a fitted pipeline: a `FeatureExtractor`, steps that prepare its columns, a classifier.

    Parameters
    ----------
    plan : Plan
        The features, which are extracted already.
    values : ndarray of shape (n_recordings, n_columns)
        The plan's columns; NaN where undefined.
    surfaces : ndarray of shape (n_recordings,)
        Labels.
    steps : sequence of (name, estimator)
        Unfitted, the classifier last.
    """
    with quiet_fits():
        fitted = Pipeline(list(steps)).fit(values, surfaces)
    return Pipeline([("features", _extractor(plan)), *fitted.steps])


def prune(recogniser: Pipeline) -> Pipeline:
    """Return a recogniser that computes only what its selected columns need: the same predictions.

    Selectors go; imputers and scalers keep what belongs to the columns that are left. A step that mixes
    columns (a PCA) needs all it was fitted on, and so keeps what stands before it.
    """
    steps = list(_flat(recogniser.steps[1:-1]))
    wanted: NDArray[np.intp] | None = None  # columns of a step's output that later steps need; None: all
    pruned: list[tuple[str, Any]] = []
    is_mixing = [not isinstance(step, SelectorMixin) and type(step) not in COLUMN_WISE for _, step in steps]
    for i, (name, step) in reversed(list(enumerate(steps))):
        if isinstance(step, SelectorMixin) and not any(is_mixing[:i]):
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
    extractor = recogniser[0]
    plan: Plan = extractor.plan_
    columns = plan.columns if wanted is None else [plan.columns[i] for i in wanted]
    restricted = _extractor(plan.restricted_to(columns), fs=extractor.fs, unit=extractor.unit)
    return Pipeline([("features", restricted), *pruned, recogniser.steps[-1]])


def save_recogniser(recogniser: Pipeline, path: str | Path) -> None:
    """Write a fitted recogniser with skops, which holds data and names of classes, and no code."""
    extractor = recogniser[0]
    document = {
        "texclass": __version__,
        "plan": extractor.plan_.to_json(),
        "channels": list(extractor.plan_.channels),
        "signal": {"fs": extractor.fs, "unit": extractor.unit},
        "steps": [list(step) for step in recogniser.steps[1:]],
    }
    write_atomic(Path(path), archive_of(document))


def load_recogniser(path: str | Path) -> Pipeline:
    """Read a recogniser that `save_recogniser` wrote; nothing but known classes is ever loaded.

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
        document = load_trusted(read_bounded(path))
        plan, is_same_code = Plan.of_json(document["plan"], document["channels"])
        steps = [(name, step) for name, step in document["steps"]]
        recogniser = Pipeline([("features", _extractor(plan, **document["signal"])), *steps])
    except FileNotFoundError:
        raise
    except Exception as error:
        raise ValueError(f"{path}: not a recogniser of texclass ({error})") from error
    if not is_same_code:
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
