"""Measured cost of features and classifiers in ms per recording. Shared transforms count once."""

import hashlib
import json
import platform
import time
from collections import defaultdict
from collections.abc import Callable, Hashable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import date
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.base import clone

from texclass.atomic_write import cache_root, write_if_possible
from texclass.classifiers.fitting import quiet_fits
from texclass.evaluation.workers import one_thread
from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import Channels, Views, separate_channels, views_of
from texclass.features.plan import Plan
from texclass.features.sets import FeatureSet, Member, code_hash
from texclass.loaders.dataset import Dataset
from texclass.phases import find_phases
from texclass.provenance import code_hash as hash_of_code
from texclass.provenance import versions
from texclass.recording import Recording, Samples

R = TypeVar("R")
clock = time.thread_time if time.get_clock_info("thread_time").resolution < 1e-5 else time.perf_counter
"""Clock in s: CPU time of this thread if its resolution is sufficient, otherwise wall-clock time."""
QUARTILE = 0.25
"""Quantile over repeated runs. A low quantile is used because other processes can only slow runs down."""
N_RECORDINGS, N_REPEATS = 3, 5
"""Number of recordings on which costs are measured, and number of repeats."""


@dataclass(frozen=True, eq=False)
class CostModel:
    """Cost of any set of feature columns, measured for one dataset on one machine.

    The computation is divided into parts, each of which runs at most once per recording. A part is the
    conditioning of a phase, a transform shared by several features, or the remaining computation of one
    feature. The cost of a set S of columns is

        cost(S) = segmentation + sum_p ms_p [some column of S needs part p].

    This is the cost of the whole computation from recorded samples to features, in which a shared transform
    counts only once. The cost of an empty set is 0.

    Attributes
    ----------
    columns : tuple of str
        Columns of the feature table.
    features : tuple of str
        Name of the feature to which each column belongs.
    parts : tuple of str
        Names of the parts.
    ms : ndarray of shape (n_parts,)
        Cost of each part in ms per recording.
    needs : ndarray of bool, shape (n_columns, n_parts)
        Whether each column needs each part.
    segmentation_ms : float
        Cost of the segmentation in ms. It is included in the cost of every non-empty set.
    machine : str
        Machine on which the costs were measured, and date of the measurement.

    Examples
    --------
    >>> needs = np.array([[True, False], [True, True]])
    >>> model = CostModel(("a", "b"), ("a", "b"), ("spectrum", "b"), np.array([2.0, 1.0]), needs)
    >>> model.cost(["a"]), model.cost(["a", "b"])
    (2.0, 3.0)
    """

    columns: tuple[str, ...]
    features: tuple[str, ...]
    parts: tuple[str, ...]
    ms: Samples
    needs: NDArray[np.bool_]
    segmentation_ms: float = 0.0
    machine: str = ""

    def cost(self, columns: Sequence[str]) -> float:
        """Return the cost of a set of columns in ms.

        Raises
        ------
        ValueError
            If a column is not in the model.
        """
        if unknown := [c for c in columns if c not in self._index]:
            raise ValueError(
                f"the cost model has no column {unknown[0]!r}. Expected one of its {len(self.columns)} "
                f"columns, for example {', '.join(self.columns[:5])}"
            )
        return self.cost_of_indices([self._index[c] for c in columns])

    def cost_of_indices(self, indices: Sequence[int] | NDArray[np.intp]) -> float:
        """Return the cost of the columns with these indices in ms."""
        subset = np.asarray(indices, dtype=np.intp)
        features_ms = self.ms[self.needs[subset].any(axis=0)].sum()
        return float(self.segmentation_ms + features_ms) if subset.size else 0.0

    @property
    def total(self) -> float:
        """Cost of all columns in ms."""
        return self.cost(self.columns)

    @property
    def features_ms(self) -> float:
        """Cost of all columns in ms, without the segmentation."""
        return self.total - self.segmentation_ms

    @property
    def cheapest(self) -> float:
        """Cost of the cheapest column in ms."""
        return min(self.cost_of_indices([i]) for i in range(len(self.columns)))

    def by_feature(self) -> pd.DataFrame:
        """Return three costs of each feature in ms: `share`, `alone` and `last`.

        For `share`, the cost of each part is divided equally among the features that need it. This is the
        Shapley value: the mean marginal cost of a feature over all orders in which features can be added. The
        sum of `share` over all features is `features_ms`. `alone` is the cost of computing only this feature.
        `last` is the cost that is saved if only this feature is dropped from the full set.
        """
        users = {f: self.needs[self.features.index(f)] for f in dict.fromkeys(self.features)}
        n_users = np.sum(list(users.values()), axis=0)
        costs = [
            (
                (self.ms[needs] / n_users[needs]).sum(),
                self.ms[needs].sum(),
                self.ms[needs & (n_users == 1)].sum(),
            )
            for needs in users.values()
        ]
        return pd.DataFrame(costs, index=pd.Index(users, name="feature"), columns=["share", "alone", "last"])

    def restricted_to(self, columns: Sequence[str]) -> "CostModel":
        """Return a cost model with only these columns, in the given order."""
        indices = [self._index[c] for c in columns]
        features = tuple(self.features[i] for i in indices)
        return replace(self, columns=tuple(columns), features=features, needs=self.needs[indices])

    @cached_property
    def _index(self) -> dict[str, int]:
        return {column: i for i, column in enumerate(self.columns)}


@dataclass(frozen=True)
class CostMeter:
    """Cost meter that measures feature sets on a few segmented recordings.

    Attributes
    ----------
    recordings
        Recordings with their phases.
    channels
        Separate channels; see `FeatureExtractor`.
    segmentation_ms
        Cost of the segmentation in ms, as the lower quartile of repeated runs, averaged over recordings.
    input_hash
        Hash of the dataset.
    """

    recordings: tuple[Recording, ...]
    channels: tuple[str, ...] = ()
    segmentation_ms: float = 0.0
    input_hash: str = ""

    @classmethod
    def from_dataset(cls, dataset: Dataset, recording_ids: Sequence[str], channels: Channels) -> "CostMeter":
        """Load up to `N_RECORDINGS` recordings, spread evenly over the usable recordings of a dataset."""
        n = min(N_RECORDINGS, len(recording_ids))
        sample = {recording_ids[i] for i in np.linspace(0, len(recording_ids) - 1, n).astype(int)}
        loaded = [dataset.load(entry) for entry in dataset.entries if entry.recording_id in sample]
        recordings = tuple(recording.with_(phases=find_phases(recording)) for recording in loaded)
        with one_thread():
            runs = [[_timed(partial(find_phases, r))[1] for _ in range(3)] for r in loaded]
        ms = float(np.quantile(runs, QUARTILE, axis=1).mean())
        return cls(recordings, separate_channels(recordings[0], channels), ms, dataset.input_hash)

    def milliseconds(self, feature_set: FeatureSet) -> float:
        """Return the cost of a feature set in ms per recording, including the segmentation."""
        return self.segmentation_ms + self.measure(Plan.of(feature_set, self.channels), n_repeats=3)[0]

    def measure(self, *plans: Plan, n_repeats: int = N_REPEATS) -> tuple[float, ...]:
        """Return the cost of each plan in ms per recording, without the segmentation.

        The cost is the lower quartile of repeated runs, averaged over recordings. The plans are measured
        alternately, so that changes in the speed of the machine affect all of them.
        """
        runs = np.empty((len(self.recordings), n_repeats, len(plans)))
        with one_thread():
            for i, k, j in np.ndindex(runs.shape):
                runs[i, k, j] = _timed(partial(plans[j].compute, self.recordings[i]))[1]
        return tuple(map(float, np.quantile(runs, QUARTILE, axis=1).mean(axis=0)))

    def cached_model(self, feature_set: FeatureSet) -> CostModel:
        """Return the cost model of a feature set, which is measured once and then read from the cache folder.

        Stored costs make repeated feature selection under a budget reproducible. The cache key depends on the
        machine, the dataset, the features, the code and the library versions. To measure again, delete the
        folder `costs` in the cache folder.
        """
        names = [member.name for member in feature_set.members]
        measurement = (platform.node(), self.input_hash, [r.recording_id for r in self.recordings], names)
        code = (code_hash(feature_set), hash_of_code("phases", "signals"))
        software = (self.channels, *code, versions("numpy", "scipy", "PyWavelets", "librosa"))
        key = hashlib.sha256(repr((measurement, software)).encode()).hexdigest()[:16]
        path = cache_root() / "costs" / f"{feature_set.name}-{key}.json"
        with suppress(OSError, ValueError, TypeError):
            facts: dict[str, Any] = json.loads(path.read_bytes())
            facts |= {name: tuple(facts[name]) for name in ("columns", "features", "parts")}
            facts |= {"ms": np.array(facts["ms"], float), "needs": np.array(facts["needs"], bool)}
            return CostModel(**facts)
        model = replace(self.model(feature_set), machine=f"{_processor()}, {date.today()}")
        facts = vars(model) | {"ms": model.ms.tolist(), "needs": model.needs.astype(int).tolist()}
        write_if_possible(path, json.dumps(facts).encode())
        return model

    def model(self, feature_set: FeatureSet) -> CostModel:
        """Measure the cost of each part of a feature set.

        Each feature is computed separately on fresh views. The cost of a part is the lower quartile of its
        runs, averaged over recordings. Because quartiles are not additive, the costs of all parts are then
        scaled so that their sum is the measured cost of the full set.
        """
        plan = Plan.of(feature_set, self.channels)
        members = [(prefix, member) for prefix, part in plan.parts for member in part.members]
        ms_of_recordings: list[dict[Hashable, float]] = []
        users: dict[Hashable, set[int]] = defaultdict(set)
        with one_thread():
            for recording in self.recordings:
                times: dict[Hashable, list[float]] = defaultdict(list)
                for _ in range(1 + N_REPEATS):  # the first run is a warm-up
                    for i, (prefix, member) in enumerate(members):
                        views = views_of(recording, self.channels)[prefix]
                        for part, seconds in _seconds_of(member, views, prefix).items():
                            times[part].append(1e3 * seconds)
                            users[part].add(i)
                quartiles = {part: float(np.quantile(ms, QUARTILE)) for part, ms in times.items()}
                ms_of_recordings.append(quartiles)
        ms = np.array([np.mean([times_ms.get(part, 0.0) for times_ms in ms_of_recordings]) for part in users])
        ms *= self.measure(plan)[0] / ms.sum()
        owner = [i for i, (_, member) in enumerate(members) for _ in member.columns]
        return CostModel(
            plan.columns,
            tuple(f"{members[i][0]}{members[i][1].name}" for i in owner),
            tuple(_part_name(part) for part in users),
            ms,
            np.array([[i in ids for ids in users.values()] for i in owner], dtype=bool).reshape(-1, len(ms)),
            self.segmentation_ms,
        )


def _seconds_of(member: Member, views: Views, prefix: str) -> dict[Hashable, float]:
    """Compute a feature on fresh views. Return the time in s spent in each part, without nested parts."""
    seconds: dict[Hashable, float] = defaultdict(float)
    nested_s = [0.0]  # stack: for each running computation, the time of those nested in it

    def timed(part: Hashable, compute: Callable[[], R]) -> R:
        nested_s.append(0.0)
        start = clock()
        try:
            return compute()
        finally:
            elapsed = clock() - start
            seconds[part] += elapsed - nested_s.pop()
            nested_s[-1] += elapsed

    phase = member.feature.phase
    with suppress(UndefinedFeatureError):
        view = timed((prefix, phase), lambda: member.view(views))
        view.memory.timed = lambda key, compute: timed((prefix, phase, key), compute)
        timed((prefix, member.name, ""), lambda: member.values(views))
    return seconds


def classifier_cost(classifier: Any, X: Samples, y: NDArray[Any]) -> dict[str, float]:
    """Measure how long a classifier takes to fit and to predict, with one thread.

    Parameters
    ----------
    classifier : classifier
        Unfitted classifier.
    X : ndarray of shape (n_recordings, n_columns)
        Prepared features; all values must be finite.
    y : ndarray of shape (n_recordings,)
        Labels.

    Returns
    -------
    dict
        Medians of repeated runs in ms: `fit_ms` for the fit on all recordings, `predict_ms` for the
        prediction of a single recording.
    """
    with one_thread(), quiet_fits():
        fits = [_timed(lambda: clone(classifier).fit(X, y)) for _ in range(N_REPEATS)]
        fitted = fits[-1][0]
        rows = X[np.linspace(0, len(X) - 1, 4 * N_REPEATS).astype(int)]
        predictions = [_timed(partial(fitted.predict, row[None]))[1] for row in rows]
    return {"fit_ms": float(np.median([ms for _, ms in fits])), "predict_ms": float(np.median(predictions))}


def _processor() -> str:
    with suppress(OSError, StopIteration):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return platform.processor() or platform.machine()


def _timed(call: Callable[[], R]) -> tuple[R, float]:
    """Return the result of a call and its duration in ms."""
    start = clock()
    result = call()
    return result, 1e3 * (clock() - start)


def _part_name(part: Any) -> str:
    match part:
        case (prefix, phase):
            return f"{prefix}conditioning of the {phase}"
        case (prefix, feature, ""):
            return f"{prefix}{feature}"
        case (prefix, _, (function, *parameters)):
            return f"{prefix}{function.__name__}({', '.join(map(str, parameters))})"
    raise AssertionError(part)
