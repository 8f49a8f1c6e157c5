"""What features and classifiers cost: measured milliseconds per recording, shared transforms counted once."""

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
"""Seconds of this thread alone, where the system counts them finely: what else runs then matters little."""
QUARTILE = 0.25
"""Of several runs: what else runs can only make one slower."""
N_RECORDINGS, N_REPEATS = 3, 5
"""On how many recordings costs are measured, and how often."""


@dataclass(frozen=True, eq=False)
class CostModel:
    """What any choice of columns costs on one machine, for one dataset.

    A part is what is computed at most once a recording: the conditioning of a phase, a transform that
    features share, or what a feature computes for itself. A column needs some of the parts, and

        cost(S) = segmentation + sum_p ms_p [some column of S needs p],

    so the columns of one feature share all of its cost, a transform is paid by whoever asks first, and the
    cost is that of the whole path from the samples as recorded to the features. No columns cost nothing.

    Attributes
    ----------
    columns : tuple of str
        Columns of the feature table.
    features : tuple of str
        The feature of each column.
    parts : tuple of str
        Names of the parts.
    ms : ndarray of shape (n_parts,)
        Milliseconds per recording.
    needs : ndarray of bool, shape (n_columns, n_parts)
        Which column needs which part.
    segmentation_ms : float
        Finding the phases: paid once, whatever is chosen.
    machine : str
        On which machine, and when, the milliseconds were measured.
    """

    columns: tuple[str, ...]
    features: tuple[str, ...]
    parts: tuple[str, ...]
    ms: Samples
    needs: NDArray[np.bool_]
    segmentation_ms: float = 0.0
    machine: str = ""

    def cost(self, columns: Sequence[str]) -> float:
        """Return the milliseconds that these columns cost together, 0.0 for none.

        Raises
        ------
        ValueError
            If a column is not in the model.
        """
        if unknown := [c for c in columns if c not in self._index]:
            raise ValueError(f"column {unknown[0]!r} has no cost. Expected a column of the cost model")
        return self.of([self._index[c] for c in columns])

    def of(self, indices: Sequence[int] | NDArray[np.intp]) -> float:
        """Return the cost of columns given by number."""
        chosen = np.asarray(indices, dtype=np.intp)
        features_ms = self.ms[self.needs[chosen].any(axis=0)].sum()
        return float(self.segmentation_ms + features_ms) if chosen.size else 0.0

    @property
    def total(self) -> float:
        """Cost of all columns."""
        return self.cost(self.columns)

    @property
    def features_ms(self) -> float:
        """The share of features in the cost of all columns: conditioning, transforms, what each computes."""
        return self.total - self.segmentation_ms

    @property
    def cheapest(self) -> float:
        """Cost of the cheapest column."""
        return min(self.of([i]) for i in range(len(self.columns)))

    def by_feature(self) -> pd.DataFrame:
        """Return what each feature costs: its `share` of the total, `alone`, and as the `last`, by name.

        A part's cost is split equally between the features that need it. That is the Shapley value: the mean
        marginal cost of a feature over all orders in which features could be bought; the shares add up to
        `features_ms`. `last` is what leaving the feature out of the full set would save.
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
        """Return the model of some of the columns, in the order given."""
        chosen = [self._index[c] for c in columns]
        features = tuple(self.features[i] for i in chosen)
        return replace(self, columns=tuple(columns), features=features, needs=self.needs[chosen])

    @cached_property
    def _index(self) -> dict[str, int]:
        return {column: i for i, column in enumerate(self.columns)}


@dataclass(frozen=True)
class CostMeter:
    """Measures feature sets on a few recordings whose phases are known already.

    Attributes
    ----------
    recordings
        The recordings.
    channels
        Channels kept apart; see `FeatureExtractor`.
    segmentation_ms
        Of finding the phases: lower quartiles of a few runs, the mean over recordings.
    input_hash
        Of the dataset that they are of.
    """

    recordings: tuple[Recording, ...]
    channels: tuple[str, ...] = ()
    segmentation_ms: float = 0.0
    input_hash: str = ""

    @classmethod
    def on(cls, dataset: Dataset, usable: Sequence[str], channels: Channels) -> "CostMeter":
        """Take up to `N_RECORDINGS` usable recordings spread over a dataset."""
        n = min(N_RECORDINGS, len(usable))
        wanted = {usable[i] for i in np.linspace(0, len(usable) - 1, n).astype(int)}
        loaded = [dataset.load(entry) for entry in dataset.entries if entry.recording_id in wanted]
        recordings = tuple(recording.with_(phases=find_phases(recording)) for recording in loaded)
        with one_thread():
            runs = [[_timed(partial(find_phases, r))[1] for _ in range(3)] for r in loaded]
        ms = float(np.quantile(runs, QUARTILE, axis=1).mean())
        return cls(recordings, separate_channels(recordings[0], channels), ms, dataset.input_hash)

    def milliseconds(self, feature_set: FeatureSet) -> float:
        """Return what a set takes, finding the phases included; see `CostModel`."""
        return self.segmentation_ms + self.measured(Plan.of(feature_set, self.channels), n_repeats=3)[0]

    def measured(self, *plans: Plan, n_repeats: int = N_REPEATS) -> tuple[float, ...]:
        """Return what plans take where phases are known: lower quartiles of runs, means over recordings.

        They take turns, so that a machine that gets slower or faster meanwhile does so for all of them.
        """
        runs = np.empty((len(self.recordings), n_repeats, len(plans)))
        with one_thread():
            for i, k, j in np.ndindex(runs.shape):
                runs[i, k, j] = _timed(partial(plans[j].compute, self.recordings[i]))[1]
        return tuple(map(float, np.quantile(runs, QUARTILE, axis=1).mean(axis=0)))

    def kept(self, feature_set: FeatureSet) -> CostModel:
        """Return what `model` measured when it was first asked for here: what is decided by costs stays so.

        The table is kept in the cache folder, for a machine, a dataset, features, their code and the versions
        of libraries; who wants it measured anew removes `costs` there.
        """
        names = [member.name for member in feature_set.members]
        known = (platform.node(), self.input_hash, [r.recording_id for r in self.recordings], names)
        code = (code_hash(feature_set), hash_of_code("phases", "signals"))
        made_by = (self.channels, *code, versions("numpy", "scipy", "PyWavelets", "librosa"))
        key = hashlib.sha256(repr((known, made_by)).encode()).hexdigest()[:16]
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
        """Measure every part of a set, each feature by itself on fresh views.

        A part's time is the lower quartile of the runs that computed it, and the mean over recordings. All
        are then multiplied by what the full set takes over their sum: quartiles of parts do not add up.
        """
        plan = Plan.of(feature_set, self.channels)
        members = [(prefix, member) for prefix, part in plan.parts for member in part.members]
        by_recording: list[dict[Hashable, float]] = []
        users: dict[Hashable, set[int]] = defaultdict(set)
        with one_thread():
            for recording in self.recordings:
                times: dict[Hashable, list[float]] = defaultdict(list)
                for _ in range(1 + N_REPEATS):  # the first run warms up
                    for i, (prefix, member) in enumerate(members):
                        views = views_of(recording, self.channels)[prefix]
                        for part, seconds in _seconds_of(member, views, prefix).items():
                            times[part].append(1e3 * seconds)
                            users[part].add(i)
                by_recording.append({part: float(np.quantile(ms, QUARTILE)) for part, ms in times.items()})
        ms = np.array([np.mean([found.get(part, 0.0) for found in by_recording]) for part in users])
        ms *= self.measured(plan)[0] / ms.sum()
        owner = [i for i, (_, member) in enumerate(members) for _ in member.columns]
        return CostModel(
            plan.columns,
            tuple(f"{members[i][0]}{members[i][1].name}" for i in owner),
            tuple(_named(part) for part in users),
            ms,
            np.array([[i in who for who in users.values()] for i in owner], dtype=bool).reshape(-1, len(ms)),
            self.segmentation_ms,
        )


def _seconds_of(member: Member, views: Views, prefix: str) -> dict[Hashable, float]:
    """Compute a feature on fresh views: seconds of conditioning, each transform and the rest, none twice."""
    seconds: dict[Hashable, float] = defaultdict(float)
    inside = [0.0]  # what computations within the present one have taken

    def timed(part: Hashable, compute: Callable[[], R]) -> R:
        inside.append(0.0)
        start = clock()
        try:
            return compute()
        finally:
            elapsed = clock() - start
            seconds[part] += elapsed - inside.pop()
            inside[-1] += elapsed

    phase = member.feature.phase
    with suppress(UndefinedFeatureError):
        view = timed((prefix, phase), lambda: member.view(views))
        view.memory.timed = lambda key, compute: timed((prefix, phase, key), compute)
        timed((prefix, member.name, ""), lambda: member.values(views))
    return seconds


def classifier_cost(classifier: Any, X: Samples, y: NDArray[Any]) -> dict[str, float]:
    """Measure a classifier on prepared features (finite), one thread; medians of a few runs.

    Returns
    -------
    dict
        `fit_ms`: fitting all recordings once; `predict_ms`: one recording at a time, as a robot asks.
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
    """Return a result and the milliseconds it took."""
    start = clock()
    result = call()
    return result, 1e3 * (clock() - start)


def _named(part: Any) -> str:
    match part:
        case (prefix, phase):
            return f"{prefix}conditioning of the {phase}"
        case (prefix, feature, ""):
            return f"{prefix}{feature}"
        case (prefix, _, (function, *parameters)):
            return f"{prefix}{function.__name__}({', '.join(map(str, parameters))})"
    raise AssertionError(part)
