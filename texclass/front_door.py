"""What most users call; each takes what they have at hand: a name, a path, arrays, a dataset."""

import warnings
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from texclass.evaluation import BenchmarkResult, PipelineDefinition
    from texclass.features import FeatureSet
    from texclass.loaders import Dataset
    from texclass.recording import Recording


def extract(
    recordings: Any,
    features: "str | Path | FeatureSet" = "texclass",
    *,
    fs: float | None = None,
    unit: str | None = None,
    channels: Any = "combine",
    n_jobs: int | None = None,
) -> "pd.DataFrame":
    """Return the features of recordings, one row a recording.

    Parameters
    ----------
    recordings : Dataset, str, Path, Recording, array_like or sequence of these
        A dataset, or the name of a shipped one, a card or folder; one recording, or several; one array of
        shape (n_samples,) or (n_samples, n_axes), arrays of unequal lengths, or a panel of shape
        (n_recordings, n_axes, n_samples): see `FeatureExtractor`. Or what MNE, xarray, aeon or sktime hold:
        see `loaders.recordings_of`.
    features : str, Path or FeatureSet
        A shipped set, a TOML, or a set.
    fs : float, optional
        Sampling rate in Hz, of arrays and of files that do not state it.
    unit : str, optional
        Of the same; "arbitrary" by default for arrays.
    channels : {"combine", "each", "auto", "all"}
        See `FeatureExtractor`.
    n_jobs : int, optional
        Processes.

    Returns
    -------
    DataFrame of shape (n_recordings, n_columns)
        Indexed by recording; NaN where a feature is undefined. ``attrs["reasons"]`` lists (feature, reason,
        number of recordings); `FeatureExtractor.extract` has the reasons of each recording.

    Raises
    ------
    ValueError
        If `fs` is missing for arrays, a recording breaks a rule, or recordings have different axes.

    Warns
    -----
    UserWarning
        If columns have no value for some or all recordings.

    Examples
    --------
    >>> import numpy as np
    >>> import texclass as tx
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> tx.extract(x, "strese2015", fs=10_000).shape
    (1, 210)
    """
    from texclass.features import FeatureExtractor
    from texclass.features.extractor import gaps
    from texclass.recording import Recording

    given = opened([recordings] if isinstance(recordings, Recording) else recordings, fs, unit)
    extractor = FeatureExtractor(features, channels=channels, fs=fs, unit=unit, n_jobs=n_jobs)
    found = extractor.fit(given).extract(given)
    table = found.table
    if table.isna().to_numpy().any():
        warnings.warn(f"{gaps(table, found.reasons)}. `.attrs['reasons']` has all", UserWarning, stacklevel=2)
    counts = Counter((one.feature, one.reason) for one in found.reasons)
    table.attrs["reasons"] = [(*undefined, n) for undefined, n in counts.items()]
    return table


def benchmark(
    dataset: "Dataset | str | Path",
    pipeline: "PipelineDefinition | str | Path" = "strese2015",
    *,
    fs: float | None = None,
    unit: str | None = None,
    **options: Any,
) -> "BenchmarkResult":
    """Evaluate every row of a pipeline's table on a dataset, beside the published figures.

    Parameters
    ----------
    dataset : Dataset, str or Path
        Labelled recordings, or what `open_dataset` opens.
    pipeline : PipelineDefinition, str or Path
        A shipped name, a TOML, or a definition.
    fs, unit : optional
        As `open_dataset` takes them.
    **options
        `protocol`, `n_folds`, `choose`, `n_jobs`, `skip_bad`, `progress` of `evaluation.run_benchmark`.

    Returns
    -------
    BenchmarkResult
        Its `table` is a DataFrame; `plot()` draws it, `save(folder)` writes JSON, Markdown and pictures.
    """
    from texclass.evaluation import run_benchmark

    return run_benchmark(opened(dataset, fs, unit), pipeline, **options)


def plot_recording(
    recording: "Recording | str | Path", *, fs: float | None = None, unit: str | None = None
) -> "Figure":
    """Draw a recording at a glance: signal and phases, a tap, spectrogram, the paper's feature values.

    Parameters
    ----------
    recording : Recording, str or Path
        Or a file, or "DATASET:RECORDING".
    fs, unit : optional
        As `load_recording` takes them.
    """
    from texclass.evaluation.inspection import inspected
    from texclass.loaders import find_recording

    one = find_recording(recording, fs=fs, unit=unit) if isinstance(recording, str | Path) else recording
    return inspected(one, "strese2015")[0]


def opened(dataset: Any, fs: float | None, unit: str | None) -> Any:
    """Return a dataset, opened if only its name or place is given; whatever else it is, as it is."""
    from texclass.loaders import open_dataset

    return open_dataset(dataset, fs=fs, unit=unit) if isinstance(dataset, str | Path) else dataset
