"""The feature extractor: recordings in, a table of features out, as a scikit-learn transformer."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from joblib import Parallel, delayed, parallel_config
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils import Tags
from sklearn.utils.validation import check_is_fitted, validate_data

from texclass.features.phase_view import Channels, separate_channels
from texclass.features.plan import Computed, Plan
from texclass.features.sets import FeatureSet, load_feature_set
from texclass.recording import Phases, Recording, RecordingError, Samples, axes_differ, describe_axes
from texclass.reporting.wording import counted

if TYPE_CHECKING:
    import pandas as pd

LEAST_SAMPLES = 64
"""Fewer are no signal: so many rows of at most `MOST_AXES` columns are one recording, not many."""
MOST_AXES = 8


class Reason(NamedTuple):
    """Why a feature has no value for a recording."""

    recording_id: str
    feature: str
    reason: str


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
        Names of the recordings; of signals in a DataFrame or Series, its index.
    reasons : tuple of Reason
        One for each feature of each recording that is undefined.
    ms : ndarray of shape (n_recordings,)
        Milliseconds that each recording took, segmentation included, loading not.
    """

    values: Samples
    columns: tuple[str, ...]
    recording_ids: tuple[Any, ...]
    reasons: tuple[Reason, ...]
    ms: Samples

    @property
    def table(self) -> "pd.DataFrame":
        """The values as a DataFrame, indexed by recording."""
        import pandas as pd

        index = pd.Index(self.recording_ids, name="recording")
        return pd.DataFrame(self.values, index=index, columns=pd.Index(self.columns))


class _Values(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Give the values of an extraction in the container that `set_output` asks for."""

    def transform(self, X: Any) -> Any:
        return X.values  # noqa: PD011  (no pandas object)


class FeatureExtractor(_Values):
    """Features of recordings, as a scikit-learn transformer.

    Parameters
    ----------
    features : str, path or FeatureSet
        Name of a shipped feature set, path of a TOML, or a set (for instance a restricted one).
    channels : {"combine", "each", "auto", "all"}
        "combine" reduces the channels to one by DFT321 [strese2015, section III]; "each" gives a set of
        columns per channel, prefixed "x/"; "auto" combines the axes of one accelerometer and keeps others
        apart; "all" is "each" with the axes of the turn rate.
    fs : float, optional
        Sampling rate in Hz, when X holds arrays.
    unit : str, optional
        Unit of the signals, when X holds arrays, "arbitrary" by default: features of level then compare only
        with each other, and nothing is removed but the mean; see `Recording`.
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
    X is a sequence or Series of `Recording` (a `Dataset` loads them one at a time), or arrays that are
    movements from their first sample to their last:

    - one array of shape (n_samples,) or (n_samples, n_axes), at least 64 samples of at most 8 axes;
    - any other two-dimensional array: (n_recordings, n_samples), one axis each, as scikit-learn has it;
    - a panel of shape (n_recordings, n_axes, n_samples);
    - a sequence of arrays (n_samples,) or (n_samples, n_axes), of any lengths; of at most 8 rows of at least
      64 columns each, it is a collection of aeon's: (n_axes, n_samples). Others wider than long and than 8
      columns are refused, for nothing says which way time runs;
    - a DataFrame of sktime's, one row a sample, indexed by recording and time.

    `Raw` and `Epochs` of MNE and a `DataArray` of xarray are what `loaders.recordings_of` makes of them.
    Undefined features are NaN; `extract` gives the reasons too. After ``set_output(transform="pandas")`` rows
    are named after the recordings.

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
            If X is empty or of the wrong kind, or `fs` is missing for arrays.
        """
        recordings = self._recordings(X, reset=True)
        given = self.features
        self.feature_set_ = given if isinstance(given, FeatureSet) else load_feature_set(given)
        self.plan_ = Plan.of(self.feature_set_, separate_channels(recordings[0], self.channels))
        return self

    def transform(self, X: Sequence[Recording] | ArrayLike) -> Any:
        """Return the features, shape (n_recordings, n_columns); NaN where undefined."""
        found = self.extract(X)
        values = super().transform(found)
        if hasattr(values, "iloc"):
            values.index = list(found.recording_ids)
        return values

    def extract(self, X: Sequence[Recording] | ArrayLike) -> Extraction:
        """Return the features with the reasons of undefined values and the time taken."""
        check_is_fitted(self)
        recordings = self._recordings(X, reset=False)
        load, entries = getattr(recordings, "load", None), getattr(recordings, "entries", recordings)
        with parallel_config(backend="loky", inner_max_num_threads=1):
            found = Parallel(n_jobs=self.n_jobs)(
                delayed(_extract)(self.plan_, load, entry) for entry in entries
            )
        ids, rows, axes = zip(*found, strict=True)
        if other := next((i for i, names in enumerate(axes) if axes_differ(names, axes[0])), 0):
            raise RecordingError(
                f"{ids[other]}: {describe_axes(axes[other])}, but {ids[0]} has {describe_axes(axes[0])}. "
                "Expected the same axes in each recording"
            )
        return Extraction(
            np.stack([row.values for row in rows]),  # noqa: PD011
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

    def _recordings(self, X: Any, *, reset: bool) -> Any:
        """Return X as a sequence of recordings."""
        if hasattr(X, "entries"):
            return X
        from texclass.loaders.interoperability import is_mne_or_xarray, recordings_of

        if is_mne_or_xarray(X):
            return recordings_of(X, fs=self.fs, unit=self.unit)
        if getattr(getattr(X, "index", None), "nlevels", 1) == 2:
            from pandas import Series

            X = Series({name: rows.to_numpy() for name, rows in X.groupby(level=0, sort=False)})
        of_objects = getattr(X, "dtype", None) == np.object_
        listed = list(X) if isinstance(X, list | tuple) or of_objects else []
        if listed and isinstance(listed[0], Recording):
            return listed
        signals = _signals(listed or X)
        if signals is None:
            table = validate_data(self, X, reset=reset, dtype=np.float64)
            in_time = not hasattr(X, "iloc") and len(table) >= LEAST_SAMPLES and table.shape[1] <= MOST_AXES
            signals = [table] if in_time else table
        if self.fs is None:
            raise ValueError("X holds arrays and fs is None. Expected a sampling rate in Hz: give fs=...")
        names = X.index if hasattr(X, "iloc") else [f"row {i}" for i in range(len(signals))]
        return [
            Recording(x, self.fs, self.unit or "arbitrary", name, phases=Phases(movement=(0, len(x))))
            for name, x in zip(names, signals, strict=True)
        ]


def gaps(values: "pd.DataFrame", reasons: Iterable[Reason]) -> str:
    """Return how many columns have no value in some or all recordings, and the commonest reasons."""
    absent = values.isna()
    never, some = int(absent.all().sum()), int(absent.any().sum())
    told = f"{never} of {counted(len(values.columns), 'column')} without any value"
    told += f", {some - never} with some missing" if some > never else ""
    common = Counter(reason.reason for reason in reasons).most_common(3)
    return told + (f": {' / '.join(reason for reason, _ in common)}" if some else "")


def _signals(X: Any) -> list[Samples] | None:
    """Return the signals of what is no table of numbers: one, a panel, or signals of unequal shapes."""
    if isinstance(X, list) and (shapes := {np.shape(x) for x in X}) not in ({()}, set()):
        return [_in_time(np.asarray(x)) for x in X] if len(shapes) > 1 or len(min(shapes)) > 1 else None
    array = np.asarray(X) if isinstance(X, list | np.ndarray) else np.empty((0, 0))
    if array.ndim == 3:
        return list(array.swapaxes(1, 2))
    return [array] if array.ndim == 1 and array.size >= LEAST_SAMPLES else None


def _in_time(x: NDArray[Any]) -> NDArray[Any]:
    """Return one of several signals with time along its rows: a collection of aeon's has axes there."""
    if x.ndim != 2 or x.shape[1] <= max(MOST_AXES, x.shape[0]):
        return x
    if x.shape[0] <= MOST_AXES and x.shape[1] >= LEAST_SAMPLES:
        return x.T
    raise ValueError(
        f"an array of X has shape {x.shape}. Expected (n_samples, n_axes), or (n_axes, n_samples) of at "
        f"most {MOST_AXES} axes and at least {LEAST_SAMPLES} samples"
    )


def _extract(
    plan: Plan, load: Callable[[Any], Recording] | None, entry: Any
) -> tuple[str, Computed, tuple[str, ...]]:
    """Compute a recording, or the entry of a lazy dataset, in the process that loads it."""
    recording: Recording = entry if load is None else load(entry)
    return recording.recording_id, plan.compute(recording), recording.channels
