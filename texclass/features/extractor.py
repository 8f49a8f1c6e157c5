"""Feature extractor: a scikit-learn transformer that converts recordings to a table of features."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from joblib import Parallel, delayed, parallel_config
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils import Tags
from sklearn.utils.validation import check_is_fitted, validate_data

from texclass.features.phase_view import Channels, separate_channels
from texclass.features.plan import Computed, Plan
from texclass.features.reasons import Reason
from texclass.features.sets import FeatureSet, load_feature_set
from texclass.recording import Phases, Recording, RecordingError, Samples, axes_differ, describe_axes

if TYPE_CHECKING:
    import pandas as pd

MIN_SAMPLES = 64
"""Minimum number of samples of a recording in an array. An array with at least this many rows and at most
`MAX_AXES` columns is one recording; any other two-dimensional array contains one recording per row."""
MAX_AXES = 8
"""Maximum number of axes of a recording in an array; see `MIN_SAMPLES`."""


@dataclass(frozen=True, eq=False)
class Extraction:
    """Features of several recordings.

    Attributes
    ----------
    values : ndarray of shape (n_recordings, n_columns)
        Feature values; NaN where a feature is undefined.
    columns : tuple of str
        Column names.
    recording_ids : tuple of str
        Names of the recordings. For signals in a DataFrame or Series, the elements of its index.
    reasons : tuple of Reason
        Reasons why features are undefined, one per feature and recording.
    ms : ndarray of shape (n_recordings,)
        Computing time per recording in ms. It includes the search for phases but not loading.

    Examples
    --------
    >>> from texclass.recording import Phases, Recording
    >>> moving = Phases(movement=(0, 3000))
    >>> recording = Recording(np.sin(np.arange(3000.0)), fs=1000, recording_id="r1", phases=moving)
    >>> features = load_feature_set("texclass").restricted_to(["fineness", "damping"])
    >>> extraction = FeatureExtractor(features).fit([recording]).extract([recording])
    >>> extraction.table.round().to_dict("index")
    {'r1': {'fineness': 159.0, 'damping': nan}}
    >>> extraction.reasons
    (Reason(recording_id='r1', feature='damping', reason='no tap found'),)
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
    """Transformer that returns the values of an extraction in the container selected by `set_output`."""

    def transform(self, X: Any) -> Any:
        return X.values  # noqa: PD011  (no pandas object)


class FeatureExtractor(_Values):
    """Scikit-learn transformer that extracts features from recordings.

    Parameters
    ----------
    features : str, path or FeatureSet
        Name of a shipped feature set, path of a TOML file, or a `FeatureSet`.
    channels : {"combine", "each", "auto", "all"}
        Treatment of the channels:

        - "combine" (default) reduces the channels to one by DFT321 [strese2015, section III];
        - "each" computes the feature set on each channel, with the column prefix "x/" for channel x;
        - "auto" combines the axes of a single accelerometer, and keeps all other channels separate;
        - "all" is like "each", and includes the axes of the turn rate, and the sound.

    fs : float, optional
        Sampling rate in Hz; required if X contains arrays.
    unit : str, optional
        Unit of the signals if X contains arrays (default "arbitrary"). If the unit is arbitrary, levels can
        only be compared with each other, and hand motion is not removed; see `Recording`.
    n_jobs : int, optional
        Number of processes, as in joblib.

    Attributes
    ----------
    feature_set_ : FeatureSet
        The feature set.
    plan_ : Plan
        The feature set of each channel.

    Notes
    -----
    X is a sequence or Series of `Recording` objects. (A `Dataset` loads its recordings one at a time.) X can
    also consist of arrays that contain only movement:

    - one array of shape (n_samples,) or (n_samples, n_axes), with at least 64 samples and at most 8 axes;
    - any other two-dimensional array, which has the shape (n_recordings, n_samples) as in scikit-learn;
    - an array of shape (n_recordings, n_axes, n_samples);
    - a sequence of arrays of shape (n_samples,) or (n_samples, n_axes), of any lengths. As in aeon, an array
      with at most 8 rows and at least 64 columns has the shape (n_axes, n_samples). Any other array with more
      than 8 columns and more columns than rows is rejected as ambiguous;
    - a DataFrame as in sktime, with one row per sample, indexed by recording and time.

    `Raw` and `Epochs` objects of MNE and the `DataArray` of xarray are converted by `loaders.recordings_of`.
    Undefined features are NaN; use `extract` to obtain the reasons. After
    ``set_output(transform="pandas")``, the rows are labelled with the names of the recordings.

    Examples
    --------
    >>> x = 3 * np.random.default_rng(0).standard_normal((3, 1000))  # three recordings
    >>> features = load_feature_set("texclass").restricted_to(["vibration_level", "fineness"])
    >>> FeatureExtractor(features, fs=1000).set_output(transform="pandas").fit_transform(x).round(1)
           fineness  vibration_level.rms
    row 0     252.7                  0.5
    row 1     252.0                  0.5
    row 2     248.2                  0.5
    >>> from sklearn.naive_bayes import GaussianNB
    >>> from sklearn.pipeline import make_pipeline
    >>> classifier = make_pipeline(FeatureExtractor("strese2015", fs=1000), GaussianNB())
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
        """Load the feature set, and determine the channels from the first recording.

        Parameters
        ----------
        X : sequence of Recording, or array_like
            Recordings; see the Notes of the class.
        y : None
            Not used.

        Raises
        ------
        ValueError
            If X is empty or of the wrong type, or `fs` is missing for arrays.
        """
        recordings = self._recordings(X, reset=True)
        features = self.features
        self.feature_set_ = features if isinstance(features, FeatureSet) else load_feature_set(features)
        self.plan_ = Plan.of(self.feature_set_, separate_channels(recordings[0], self.channels))
        return self

    def transform(self, X: Sequence[Recording] | ArrayLike) -> Any:
        """Return the features, shape (n_recordings, n_columns); undefined values are NaN."""
        extraction = self.extract(X)
        values = super().transform(extraction)
        if hasattr(values, "iloc"):
            values.index = list(extraction.recording_ids)
        return values

    def extract(self, X: Sequence[Recording] | ArrayLike) -> Extraction:
        """Return the features, the reasons for undefined values, and the computing times."""
        check_is_fitted(self)
        recordings = self._recordings(X, reset=False)
        load, entries = getattr(recordings, "load", None), getattr(recordings, "entries", recordings)
        with parallel_config(backend="loky", inner_max_num_threads=1):
            results = Parallel(n_jobs=self.n_jobs)(
                delayed(_extract)(self.plan_, load, entry) for entry in entries
            )
        ids, rows, axes, rates = zip(*results, strict=True)
        if other := next((i for i, names in enumerate(axes) if axes_differ(names, axes[0])), 0):
            raise RecordingError(
                f"{ids[other]}: {describe_axes(axes[other])}, but {ids[0]} has {describe_axes(axes[0])}. "
                "Expected the same axes in each recording"
            )
        if other := next((i for i, one in enumerate(rates) if one != rates[0]), 0):
            raise RecordingError(
                f"{ids[other]}: the rates of signals in Hz are {rates[other]}, but those of {ids[0]} are "
                f"{rates[0]}. Expected the same rates in each recording"
            )
        return Extraction(
            np.stack([row.values for row in rows]),  # noqa: PD011
            self.plan_.columns,
            ids,
            tuple(Reason(i, *pair) for i, row in zip(ids, rows, strict=True) for pair in row.reasons),
            np.array([row.ms for row in rows]),
        )

    def get_feature_names_out(self, input_features: Any = None) -> NDArray[np.object_]:
        """Return the column names; `input_features` is ignored."""
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
        has_objects = getattr(X, "dtype", None) == np.object_
        items = list(X) if isinstance(X, list | tuple) or has_objects else []
        if items and isinstance(items[0], Recording):
            return items
        signals = _signals(items or X)
        if signals is None:
            table = validate_data(self, X, reset=reset, dtype=np.float64)
            is_signal = not hasattr(X, "iloc") and len(table) >= MIN_SAMPLES and table.shape[1] <= MAX_AXES
            signals = [table] if is_signal else table
        if self.fs is None:
            raise ValueError("fs is required if X contains arrays. Pass the sampling rate in Hz: fs=...")
        names = X.index if hasattr(X, "iloc") else [f"row {i}" for i in range(len(signals))]
        return [
            Recording(x, self.fs, self.unit or "arbitrary", name, phases=Phases(movement=(0, len(x))))
            for name, x in zip(names, signals, strict=True)
        ]


def _signals(X: Any) -> list[Samples] | None:
    """Return the signals in a list or an array; None if X is a table with one recording per row."""
    if isinstance(X, list) and (shapes := {np.shape(x) for x in X}) not in ({()}, set()):
        return [_time_first(np.asarray(x)) for x in X] if len(shapes) > 1 or len(min(shapes)) > 1 else None
    array = np.asarray(X) if isinstance(X, list | np.ndarray) else np.empty((0, 0))
    if array.ndim == 3:
        return list(array.swapaxes(1, 2))
    return [array] if array.ndim == 1 and array.size >= MIN_SAMPLES else None


def _time_first(x: NDArray[Any]) -> NDArray[Any]:
    """Return a signal with shape (n_samples, n_axes); signals of an aeon collection are transposed."""
    if x.ndim != 2 or x.shape[1] <= max(MAX_AXES, x.shape[0]):
        return x
    if x.shape[0] <= MAX_AXES and x.shape[1] >= MIN_SAMPLES:
        return x.T
    raise ValueError(
        f"an array in X has the ambiguous shape {x.shape}. Expected (n_samples, n_axes), or (n_axes, "
        f"n_samples) with at most {MAX_AXES} axes and at least {MIN_SAMPLES} samples"
    )


def _extract(
    plan: Plan, load: Callable[[Any], Recording] | None, entry: Any
) -> tuple[str, Computed, tuple[str, ...], dict[str, float]]:
    """Compute the features of one recording. An entry of a lazy dataset is loaded in the same process."""
    recording: Recording = entry if load is None else load(entry)
    rates = plan.other_rates(recording)
    return recording.recording_id, plan.compute(recording), recording.channels, rates
