"""Allow-list of estimators, parameters and sizes in pipeline files and saved models."""

import importlib
import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import pairwise
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from sklearn.base import BaseEstimator

ESTIMATORS = frozenset(
    {
        "sklearn.calibration.CalibratedClassifierCV",
        "sklearn.decomposition.FactorAnalysis",
        "sklearn.decomposition.FastICA",
        "sklearn.decomposition.KernelPCA",
        "sklearn.decomposition.PCA",
        "sklearn.decomposition.TruncatedSVD",
        "sklearn.discriminant_analysis.LinearDiscriminantAnalysis",
        "sklearn.discriminant_analysis.QuadraticDiscriminantAnalysis",
        "sklearn.dummy.DummyClassifier",
        "sklearn.ensemble.AdaBoostClassifier",
        "sklearn.ensemble.BaggingClassifier",
        "sklearn.ensemble.ExtraTreesClassifier",
        "sklearn.ensemble.GradientBoostingClassifier",
        "sklearn.ensemble.HistGradientBoostingClassifier",
        "sklearn.ensemble.RandomForestClassifier",
        "sklearn.feature_selection.RFE",
        "sklearn.feature_selection.SelectFdr",
        "sklearn.feature_selection.SelectFpr",
        "sklearn.feature_selection.SelectFromModel",
        "sklearn.feature_selection.SelectFwe",
        "sklearn.feature_selection.SelectKBest",
        "sklearn.feature_selection.SelectPercentile",
        "sklearn.feature_selection.SequentialFeatureSelector",
        "sklearn.feature_selection.VarianceThreshold",
        "sklearn.gaussian_process.GaussianProcessClassifier",
        "sklearn.impute.KNNImputer",
        "sklearn.impute.SimpleImputer",
        "sklearn.kernel_approximation.Nystroem",
        "sklearn.kernel_approximation.RBFSampler",
        "sklearn.linear_model.LogisticRegression",
        "sklearn.linear_model.Perceptron",
        "sklearn.linear_model.RidgeClassifier",
        "sklearn.linear_model.SGDClassifier",
        "sklearn.naive_bayes.GaussianNB",
        "sklearn.neighbors.KNeighborsClassifier",
        "sklearn.neighbors.NearestCentroid",
        "sklearn.neighbors.NeighborhoodComponentsAnalysis",
        "sklearn.neighbors.RadiusNeighborsClassifier",
        "sklearn.neural_network.MLPClassifier",
        "sklearn.preprocessing.KBinsDiscretizer",
        "sklearn.preprocessing.MaxAbsScaler",
        "sklearn.preprocessing.MinMaxScaler",
        "sklearn.preprocessing.Normalizer",
        "sklearn.preprocessing.PowerTransformer",
        "sklearn.preprocessing.QuantileTransformer",
        "sklearn.preprocessing.RobustScaler",
        "sklearn.preprocessing.StandardScaler",
        "sklearn.svm.LinearSVC",
        "sklearn.svm.NuSVC",
        "sklearn.svm.SVC",
        "sklearn.tree.DecisionTreeClassifier",
        "sklearn.tree.ExtraTreeClassifier",
        "texclass.classifiers.kernel_discriminant.KernelDiscriminant",
        "texclass.classifiers.segment_voting.SegmentVoting",
    }
)
"""Classes allowed as the value of `use`. With the allowed parameters, none of them opens a file, imports a
module or starts a process."""
REFUSED_PARAMETERS = frozenset(
    {"callback", "importance_getter", "memory", "n_jobs", "pre_dispatch", "verbose"}
)
"""Refused parameters: they control caching, parallel processes or output, or accept functions or objects."""
UNBOUNDED = frozenset({"random_state", "subsample", "subsample_for_bin"})
"""Integer parameters without a limit, because large values increase neither run time nor memory."""


@dataclass(frozen=True)
class SizeLimits:
    """Upper limits of parameters. Larger values are rejected as a mistake or an attack.

    Attributes
    ----------
    integer
        Largest integer, for example a number of estimators, iterations or neurons (default 10,000).
    models
        Largest number of models, counting all members of nested ensembles (default 10,000).
    weights
        Largest number of weights between the hidden layers of a network (default 10 million: 80 MB).
    nesting
        Largest nesting depth of estimators (default 4).
    members, letters
        Largest number of elements in a list (default 1,000) and of characters in a string (default 200).
    """

    integer: int = 10_000
    models: int = 10_000
    weights: int = 10_000_000
    nesting: int = 4
    members: int = 1000
    letters: int = 200


LIMITS = SizeLimits()


def resolve(path: str) -> "type[BaseEstimator]":
    """Import the class with this path, if the path is on the allow-list.

    Raises
    ------
    ValueError
        If the path is not on the allow-list, or the installed scikit-learn has no such class.
    """
    if path not in ESTIMATORS:
        name = path.rpartition(".")[2]
        by_name = {one.rpartition(".")[2]: one for one in sorted(ESTIMATORS)}
        near = [by_name[one] for one in get_close_matches(name, by_name, n=1)]
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise ValueError(
            f"use = {path[: LIMITS.letters]!r} is not an allowed estimator. Expected the path of a "
            f"scikit-learn or texclass class on the allow-list.{hint}"
        )
    module, _, name = path.rpartition(".")
    try:
        return cast("type[BaseEstimator]", getattr(importlib.import_module(module), name))
    except AttributeError as error:
        raise ValueError(
            f"use = {path!r} does not exist in the installed scikit-learn ({error}). Install a version that "
            "contains it, or use another estimator"
        ) from None


def check_parameters(path: str, parameters: Mapping[str, Any]) -> None:
    """Check the names, types and sizes of the parameters of an estimator and of its nested estimators.

    Raises
    ------
    ValueError
        If a parameter is not allowed.
    """
    if (n_models := _count_models(path, parameters, 1)) > LIMITS.models:
        raise ValueError(f"{path} would fit {n_models} models. Expected at most {LIMITS.models}")


def _count_models(path: str, parameters: Mapping[str, Any], depth: int) -> int:
    """Check the parameters of an estimator. Return the number of models that it fits."""
    if depth > LIMITS.nesting:
        raise ValueError(f"{path} is nested {depth} levels deep. Expected at most {LIMITS.nesting}")
    names = [name for name in inspect.signature(resolve(path)).parameters if name not in REFUSED_PARAMETERS]
    n_models = 1
    for key, value in parameters.items():
        if key in REFUSED_PARAMETERS:
            raise ValueError(
                f"parameter {key!r} is not allowed, because a file must not set caches, processes or output. "
                f"Remove it. Allowed parameters of {path}: {', '.join(names) or 'none'}"
            )
        if key not in names:
            near = get_close_matches(key, names, n=1)
            hint = f"Did you mean {near[0]!r}?" if near else f"Its parameters: {', '.join(names) or 'none'}"
            raise ValueError(f"{path} has no parameter {key!r}. {hint}")
        if isinstance(value, dict) and isinstance(value.get("use"), str):
            nested = {name: one for name, one in value.items() if name != "use"}
            n_models *= _count_models(value["use"], nested, depth + 1)
        else:
            _check_value(key, value)
        if key == "n_estimators" or (key == "max_iter" and path.endswith("HistGradientBoostingClassifier")):
            n_models *= max(1, value) if isinstance(value, int) else 1
        if key == "hidden_layer_sizes" and isinstance(value, list | tuple):
            n_weights = sum(math.prod(pair) for pair in pairwise(value))
            if n_weights > LIMITS.weights:
                raise ValueError(f"{key} requires {n_weights:,} weights. Expected at most {LIMITS.weights:,}")
    return n_models


def _check_value(key: str, value: Any) -> None:
    """Check that a value is a number, a string, a boolean or a list of these, within the size limits."""
    if isinstance(value, bool):
        return
    if isinstance(value, str):
        if len(value) > LIMITS.letters:
            raise ValueError(f"{key} has {len(value)} characters. Expected at most {LIMITS.letters}")
    elif isinstance(value, int):
        if abs(value) > LIMITS.integer and key not in UNBOUNDED:
            raise ValueError(f"{key} is {value}. Expected at most {LIMITS.integer}")
    elif isinstance(value, list | tuple):
        if len(value) > LIMITS.members:
            raise ValueError(f"{key} has {len(value)} elements. Expected at most {LIMITS.members}")
        for one in value:
            if isinstance(one, list | tuple | dict):
                raise ValueError(f"{key} contains {str(one)[:40]!r}. Expected numbers, strings or booleans")
            _check_value(key, one)
    elif not isinstance(value, float):
        raise ValueError(
            f"{key} is {str(value)[:40]!r}. Expected a number, a string, a boolean, a list of these, or an "
            "estimator { use = ... }"
        )
