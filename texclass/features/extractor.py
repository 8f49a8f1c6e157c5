"""The feature extractor: recordings in, a table of features out, as a scikit-learn transformer."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from joblib import Parallel, delayed, parallel_config
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils import Tags
from sklearn.utils.validation import check_is_fitted, validate_data

from texclass.features.sets import FeatureSet, load_feature_set
from texclass.features.views import Channels, channels_apart, views_of
from texclass.recording import Phases, Recording, Samples


class Reason(NamedTuple):
    """Why a feature has no value for a recording."""

    recording_id: str
    feature: str
    reason: str


class Row(NamedTuple):
    """What extraction gives for one recording: values (n_columns,), (feature, reason) pairs, milliseconds."""

    values: Samples
    reasons: tuple[tuple[str, str], ...]
    ms: float


@dataclass(frozen=True)
class Plan:
    """Which part of a feature set is computed on which channel.

    Attributes
    ----------
    parts
        (column prefix, feature set) pairs; the prefix "" reads the combined channels.
    channels
        Names of the channels that are kept apart; empty when they are combined.
    """

    parts: tuple[tuple[str, FeatureSet], ...]
    channels: tuple[str, ...] = ()

    @classmethod
    def of(cls, feature_set: FeatureSet, channels: tuple[str, ...] = ()) -> "Plan":
        """Plan a set: once on the combined channels, or once a channel and its friction features once."""
        if not channels:
            return cls((("", feature_set),))
        felt, friction = feature_set.reading("tap", "movement"), feature_set.reading("friction")
        return cls((*((f"{name}/", felt) for name in channels), ("", friction)), channels)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """All column names in order."""
        return tuple(f"{prefix}{column}" for prefix, part in self.parts for column in part.column_names)

    def restricted_to(self, columns: Iterable[str]) -> "Plan":
        """Return the plan that computes only what these columns need, in the plan's order."""
        wanted = set(columns)
        kept = [(p, part, [c for c in part.column_names if f"{p}{c}" in wanted]) for p, part in self.parts]
        return Plan(tuple((p, part.restricted_to(names)) for p, part, names in kept if names), self.channels)

    def compute(self, recording: Recording) -> Row:
        """Compute one recording, from segmentation to the last feature."""
        start = time.perf_counter()
        views = views_of(recording, self.channels)
        values, reasons = [], []
        for prefix, part in self.parts:
            part_values, part_reasons = part.compute(views[prefix])
            values.append(part_values)
            reasons += [(f"{prefix}{feature}", reason) for feature, reason in part_reasons]
        return Row(np.concatenate(values), tuple(reasons), 1e3 * (time.perf_counter() - start))


@dataclass(frozen=True, eq=False)
class Extraction:
    """Features of several recordings.

    Attributes
    ----------
    values : ndarray of shape (n_recordings, n_columns)
        NaN where a feature is undefined.
    columns : tuple of str
        Column names.
    recording_ids : tuple of str
        Row names.
    reasons : tuple of Reason
        One for each feature of each recording that is undefined.
    ms : ndarray of shape (n_recordings,)
        Milliseconds that each recording took, segmentation included, loading not.
    """

    values: Samples
    columns: tuple[str, ...]
    recording_ids: tuple[str, ...]
    reasons: tuple[Reason, ...]
    ms: Samples


class FeatureExtractor(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Features of recordings, as a scikit-learn transformer.

    Parameters
    ----------
    features : str, path or FeatureSet
        Name of a shipped feature set, path of a TOML, or a set (for instance a restricted one).
    channels : {"combine", "each", "auto"}
        "combine" reduces the channels to one by DFT321 [strese2015, section III]; "each" gives a set of
        columns per channel, prefixed "x/"; "auto" combines the axes of one accelerometer and keeps others
        apart.
    fs : float, optional
        Sampling rate in Hz, when X is an array of movement signals.
    unit : str, optional
        Unit of the signals, when X is an array; see `Recording`.
    n_jobs : int, optional
        Processes, as in joblib.

    Attributes
    ----------
    feature_set_ : FeatureSet
        What is computed.
    plan_ : Plan
        On which channels.

    Notes
    -----
    X is a sequence of `Recording` (a `Dataset` loads them one at a time), or an array of shape
    (n_recordings, n_samples) whose rows are movement signals. Undefined features are NaN; `extract` gives the
    reasons too.

    Examples
    --------
    >>> from sklearn.naive_bayes import GaussianNB
    >>> from sklearn.pipeline import make_pipeline
    >>> recogniser = make_pipeline(FeatureExtractor("strese2015"), GaussianNB())
    """

    def __init__(
        self,
        features: str | Path | FeatureSet = "strese2015",
        *,
        channels: Channels = "combine",
        fs: float | None = None,
        unit: str | None = None,
        n_jobs: int | None = None,
    ) -> None:
        self.features = features
        self.channels = channels
        self.fs = fs
        self.unit = unit
        self.n_jobs = n_jobs

    def fit(self, X: Sequence[Recording] | ArrayLike, y: Any = None) -> Self:
        """Read the feature set and learn the channels from the first recording.

        Raises
        ------
        ValueError
            If X is empty or of the wrong kind, or `fs` or `unit` is missing for an array.
        """
        recordings = self._recordings(X, reset=True)
        given = self.features
        self.feature_set_ = given if isinstance(given, FeatureSet) else load_feature_set(given)
        self.plan_ = Plan.of(self.feature_set_, channels_apart(recordings[0], self.channels))
        return self

    def transform(self, X: Sequence[Recording] | ArrayLike) -> Any:
        """Return the features, shape (n_recordings, n_columns); NaN where undefined."""
        return self.extract(X).values

    def extract(self, X: Sequence[Recording] | ArrayLike) -> Extraction:
        """Return the features with the reasons of undefined values and the time taken."""
        check_is_fitted(self)
        recordings = self._recordings(X, reset=False)
        with parallel_config(backend="loky", inner_max_num_threads=1):
            results = Parallel(n_jobs=self.n_jobs)(
                delayed(_extract)(self.plan_, load) for load in _loads(recordings)
            )
        ids = tuple(recording_id for recording_id, _ in results)
        rows = [row for _, row in results]
        return Extraction(
            np.stack([row.values for row in rows]),
            self.plan_.columns,
            ids,
            tuple(Reason(i, *pair) for i, row in zip(ids, rows, strict=True) for pair in row.reasons),
            np.array([row.ms for row in rows]),
        )

    def get_feature_names_out(self, input_features: Any = None) -> NDArray[np.object_]:
        """Return the column names; `input_features` is ignored, for samples have no names."""
        check_is_fitted(self)
        return np.array(self.plan_.columns, dtype=object)

    def __sklearn_tags__(self) -> Tags:
        tags = super().__sklearn_tags__()
        tags.transformer_tags.preserves_dtype = []
        return tags

    def _recordings(self, X: Any, *, reset: bool) -> Sequence[Recording]:
        if _holds_recordings(X):
            return X  # type: ignore[no-any-return]
        array = validate_data(self, X, reset=reset, dtype=np.float64)
        if self.fs is None or self.unit is None:
            raise ValueError(
                f"X is an array, fs is {self.fs!r} and unit is {self.unit!r}; "
                "the rule is that both are given for signals that do not carry them"
            )
        whole = Phases(movement=(0, array.shape[1]))
        return [
            Recording(signal, fs=self.fs, unit=self.unit, recording_id=f"row {i}", phases=whole)
            for i, signal in enumerate(array)
        ]


def _holds_recordings(X: Any) -> bool:
    if not isinstance(X, (Sequence, np.ndarray)) or len(X) == 0 or isinstance(X, str):
        return False
    return isinstance(X[0], Recording)


def _loads(recordings: Any) -> Iterator[Callable[[], Recording]]:
    """Yield one call a recording; those of a lazy dataset load in the process that computes them."""
    if hasattr(recordings, "entries"):
        return (partial(recordings.load, entry) for entry in recordings.entries)
    return (partial(_same, recording) for recording in recordings)


def _same(recording: Recording) -> Recording:
    return recording


def _extract(plan: Plan, load: Callable[[], Recording]) -> tuple[str, Row]:
    recording = load()
    return recording.recording_id, plan.compute(recording)
