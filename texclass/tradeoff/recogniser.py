"""Fitted pipelines from recordings to surfaces that compute only the selected features."""

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
from texclass.evaluation.skops_archive import dump_archive, load_archive, read_bounded
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
"""Steps that transform each column separately, and their fitted attributes of shape (n_columns,)."""


def fit_recogniser(
    plan: Plan, values: Samples, surfaces: NDArray[Any], steps: Sequence[tuple[str, Any]]
) -> Pipeline:
    """Fit a pipeline of feature extractor, preprocessing steps and classifier to features already computed.

    Parameters
    ----------
    plan : Plan
        Plan with which the features were computed.
    values : ndarray of shape (n_recordings, n_columns)
        Feature values in the columns of the plan; NaN where undefined.
    surfaces : ndarray of shape (n_recordings,)
        Surface labels.
    steps : sequence of (name, estimator)
        Unfitted steps. The last step is the classifier.

    Returns
    -------
    Pipeline
        Fitted pipeline from recordings to surfaces.

    Examples
    --------
    >>> import texclass as tx
    >>> from sklearn.naive_bayes import GaussianNB
    >>> features = tx.load_feature_set("strese2015").restricted_to(["variance", "mean_magnitude"])
    >>> values = np.array([[1.0, 1.0], [1.1, 0.9], [5.0, 3.0], [5.2, 3.1]])
    >>> surfaces = np.array(["felt", "felt", "mesh", "mesh"])
    >>> recogniser = fit_recogniser(Plan.of(features, ()), values, surfaces, [("classify", GaussianNB())])
    >>> list(recogniser.named_steps), recogniser.classes_.tolist()
    (['features', 'classify'], ['felt', 'mesh'])
    """
    with quiet_fits():
        fitted = Pipeline(list(steps)).fit(values, surfaces)
    return Pipeline([("features", _extractor(plan)), *fitted.steps])


def prune(recogniser: Pipeline) -> Pipeline:
    """Return a recogniser with the same predictions that computes only the selected columns.

    Selectors are removed, and imputers and scalers are restricted to the selected columns. A step that mixes
    columns (such as a PCA) needs all its input columns, so the steps before it are not changed.

    Parameters
    ----------
    recogniser : Pipeline
        Fitted pipeline whose first step is a `FeatureExtractor`.

    Returns
    -------
    Pipeline
        Pruned pipeline.

    Examples
    --------
    >>> import texclass as tx
    >>> from sklearn.feature_selection import SelectKBest
    >>> from sklearn.naive_bayes import GaussianNB
    >>> features = tx.load_feature_set("strese2015").restricted_to(["variance", "mean_magnitude"])
    >>> values = np.array([[1.0, 0.3], [1.1, 0.2], [5.0, 0.3], [5.2, 0.2]])
    >>> steps = [("select", SelectKBest(k=1)), ("classify", GaussianNB())]
    >>> recogniser = fit_recogniser(Plan.of(features, ()), values, np.array(["a", "a", "b", "b"]), steps)
    >>> list(prune(recogniser).named_steps), prune(recogniser)[0].plan_.columns
    (['features', 'classify'], ('mean_magnitude',))
    """
    steps = list(_flat(recogniser.steps[1:-1]))
    # Output columns of the current step that later steps need; None means all.
    needed: NDArray[np.intp] | None = None
    pruned: list[tuple[str, Any]] = []
    is_mixing = [not isinstance(step, SelectorMixin) and type(step) not in COLUMN_WISE for _, step in steps]
    for i, (name, step) in reversed(list(enumerate(steps))):
        if isinstance(step, SelectorMixin) and not any(is_mixing[:i]):
            columns = np.flatnonzero(step.get_support())
            needed = columns if needed is None else columns[needed]
        elif type(step) in COLUMN_WISE and not getattr(step, "add_indicator", False):
            columns = np.arange(step.n_features_in_)
            if isinstance(step, SimpleImputer) and not step.keep_empty_features:
                columns = np.flatnonzero(~np.isnan(step.statistics_))  # empty columns are dropped
            needed = columns if needed is None else columns[needed]
            pruned.insert(0, (name, _sliced(step, needed)))
        else:
            pruned.insert(0, (name, step))
            needed = None
    extractor = recogniser[0]
    plan: Plan = extractor.plan_
    names = plan.columns if needed is None else [plan.columns[i] for i in needed]
    restricted = _extractor(plan.restricted_to(names), fs=extractor.fs, unit=extractor.unit)
    return Pipeline([("features", restricted), *pruned, recogniser.steps[-1]])


def save_recogniser(recogniser: Pipeline, path: str | Path) -> None:
    """Save a fitted recogniser as a skops file, which contains data and class names but no code.

    Parameters
    ----------
    recogniser : Pipeline
        Fitted pipeline whose first step is a `FeatureExtractor`.
    path : str or path
        File to write (.skops).

    Examples
    --------
    See `load_recogniser`.
    """
    extractor = recogniser[0]
    document = {
        "texclass": __version__,
        "plan": extractor.plan_.to_json(),
        "channels": list(extractor.plan_.channels),
        "signal": {"fs": extractor.fs, "unit": extractor.unit},
        "steps": [list(step) for step in recogniser.steps[1:]],
    }
    write_atomic(Path(path), dump_archive(document))


def load_recogniser(path: str | Path) -> Pipeline:
    """Load a recogniser that `save_recogniser` wrote. Only classes on the allow-list are loaded.

    Parameters
    ----------
    path : str or path
        File to read (.skops).

    Returns
    -------
    Pipeline
        Fitted recogniser.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    ValueError
        If the file is not a recogniser of texclass, or contains an unknown feature or a class that is not on
        the allow-list.

    Warns
    -----
    UserWarning
        If the code of the features has changed since the training.

    Examples
    --------
    >>> import texclass as tx
    >>> from sklearn.naive_bayes import GaussianNB
    >>> features = tx.load_feature_set("strese2015").restricted_to(["variance"])
    >>> values, surfaces = np.array([[1.0], [1.1], [5.0], [5.2]]), np.array(["felt", "felt", "mesh", "mesh"])
    >>> recogniser = fit_recogniser(Plan.of(features, ()), values, surfaces, [("classify", GaussianNB())])
    >>> save_recogniser(recogniser, "recogniser.skops")
    >>> load_recogniser("recogniser.skops").classes_.tolist()
    ['felt', 'mesh']
    """
    try:
        document = load_archive(read_bounded(path))
        plan, is_same_code = Plan.of_json(document["plan"], document["channels"])
        steps = [(name, step) for name, step in document["steps"]]
        recogniser = Pipeline([("features", _extractor(plan, **document["signal"])), *steps])
    except FileNotFoundError:
        raise
    except Exception as error:
        raise ValueError(
            f"{path}: not a recogniser of texclass ({error}). Expected a file written by `texclass tradeoff` "
            "or `save_recogniser`"
        ) from error
    if not is_same_code:
        warnings.warn(
            f"{path}: the code of the features has changed since this recogniser was trained. Train it again",
            UserWarning,
            stacklevel=2,
        )
    return recogniser


def _extractor(plan: Plan, fs: float | None = None, unit: str | None = None) -> FeatureExtractor:
    """Return a fitted feature extractor with a given plan."""
    members = tuple(member for _, part in plan.parts for member in part.members)
    feature_set = plan.parts[0][1] if len(plan.parts) == 1 else FeatureSet(plan.parts[0][1].name, members)
    channels: Channels = "each" if plan.channels else "combine"
    extractor = FeatureExtractor(feature_set, channels=channels, fs=fs, unit=unit)
    extractor.feature_set_, extractor.plan_ = feature_set, plan
    return extractor


def _flat(steps: Sequence[tuple[str, Any]]) -> list[tuple[str, Any]]:
    """Return the steps with nested pipelines expanded and "passthrough" steps removed."""
    flat: list[tuple[str, Any]] = []
    for name, step in steps:
        members = _flat(step.steps) if isinstance(step, Pipeline) else [(name, step)]
        flat += [(f"{name}-{n}" if step is not s else n, s) for n, s in members]
    return [(name, step) for name, step in flat if step not in (None, "passthrough")]


def _sliced(step: Any, columns: NDArray[np.intp]) -> Any:
    """Return a fitted column-wise step that is restricted to some of its columns."""
    sliced = copy.deepcopy(step)
    for name in COLUMN_WISE[type(step)]:
        if getattr(step, name, None) is not None:
            setattr(sliced, name, getattr(step, name)[columns])
    sliced.n_features_in_ = len(columns)
    if np.ndim(getattr(step, "n_samples_seen_", 0)) == 1:  # one count per column if there are NaN
        sliced.n_samples_seen_ = step.n_samples_seen_[columns]
    if hasattr(sliced, "feature_names_in_"):
        sliced.feature_names_in_ = sliced.feature_names_in_[columns]
    return sliced
