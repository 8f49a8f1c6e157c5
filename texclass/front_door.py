"""High-level functions, which accept names, paths, arrays, recordings and datasets."""

import warnings
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from texclass.evaluation import BenchmarkResult, PipelineDefinition
    from texclass.evaluation.axes import AxesOption
    from texclass.evaluation.result_comparison import ResultComparison
    from texclass.evaluation.workers import Progress
    from texclass.features import FeatureSet
    from texclass.loaders import Dataset
    from texclass.recording import Recording
    from texclass.reporting.result_files import Result


def extract(
    recordings: Any,
    features: "str | Path | FeatureSet" = "texclass",
    *,
    fs: float | None = None,
    unit: str | None = None,
    channels: Any = "combine",
    n_jobs: int | None = None,
) -> "pd.DataFrame":
    """Compute the features of recordings, one row per recording.

    Parameters
    ----------
    recordings : Dataset, str, Path, Recording, array_like or sequence of these
        Dataset, name of a shipped dataset, dataset card or folder; one or several recordings; one array of
        shape (n_samples,) or (n_samples, n_axes), several arrays, or a panel of shape
        (n_recordings, n_axes, n_samples), see `FeatureExtractor`; or data of MNE, xarray, aeon or sktime, see
        `loaders.recordings_of`.
    features : str, Path or FeatureSet
        Name of a shipped feature set, path of a feature set (TOML), or a feature set (default "texclass").
    fs : float, optional
        Sampling rate in Hz of arrays, and of files that do not state it.
    unit : str, optional
        Unit of arrays (default "arbitrary"), and of files that do not state it.
    channels : {"combine", "each", "auto", "all"}
        See `FeatureExtractor`.
    n_jobs : int, optional
        Number of processes (default 1).

    Returns
    -------
    DataFrame of shape (n_recordings, n_columns)
        Feature values, indexed by recording; NaN where a feature is undefined. ``attrs["reasons"]`` lists
        (feature, reason, number of recordings); `FeatureExtractor.extract` returns the reasons for each
        recording.

    Raises
    ------
    ValueError
        If `fs` is missing for arrays, a recording is invalid, or recordings have different axes.

    Warns
    -----
    UserWarning
        If columns are undefined for some or all recordings.

    Examples
    --------
    >>> import numpy as np
    >>> import texclass as tx
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> tx.extract(x, "strese2015", fs=10_000).shape
    (1, 210)
    """
    from texclass.features import FeatureExtractor
    from texclass.features.reasons import describe_missing_values
    from texclass.recording import Recording

    dataset = as_dataset([recordings] if isinstance(recordings, Recording) else recordings, fs, unit)
    extractor = FeatureExtractor(features, channels=channels, fs=fs, unit=unit, n_jobs=n_jobs)
    extraction = extractor.fit(dataset).extract(dataset)
    table = extraction.table
    if table.isna().to_numpy().any():
        summary = describe_missing_values(table, extraction.reasons)
        warnings.warn(f"{summary}. For all reasons, see `.attrs['reasons']`", UserWarning, stacklevel=2)
    counts = Counter((item.feature, item.reason) for item in extraction.reasons)
    table.attrs["reasons"] = [(feature, reason, n) for (feature, reason), n in counts.items()]
    return table


def benchmark(
    dataset: "Dataset | str | Path",
    pipeline: "PipelineDefinition | str | Path | None" = None,
    *,
    fs: float | None = None,
    unit: str | None = None,
    protocol: str | None = None,
    n_folds: int | None = None,
    nested_cv: bool | None = None,
    axes: "AxesOption" = "auto",
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: "Progress | None" = None,
) -> "BenchmarkResult":
    """Evaluate every feature subset and classifier of a pipeline on a dataset.

    Parameters
    ----------
    dataset : Dataset, str or Path
        Dataset with labels, or an argument of `open_dataset`.
    pipeline : PipelineDefinition, str or Path
        Name of a shipped pipeline, path of a pipeline (TOML), or a definition. The default is the published
        table, "strese2015", followed by the default pipeline of `train` on the same folds.
    fs : float, optional
        Sampling rate in Hz of files that do not state it.
    unit : str, optional
        Unit of the acceleration in files that do not state it.
    protocol, n_folds, nested_cv, axes, n_jobs, skip_bad, progress : optional
        See `evaluation.run_benchmark`.

    Returns
    -------
    BenchmarkResult
        Accuracy of each feature subset and classifier. `table` is a DataFrame, `plot()` returns a figure, and
        `save(folder)` writes JSON, Markdown and figures.
    """
    from texclass.evaluation import run_benchmark

    return run_benchmark(
        as_dataset(dataset, fs, unit),
        pipeline,
        protocol=protocol,
        n_folds=n_folds,
        nested_cv=nested_cv,
        axes=axes,
        n_jobs=n_jobs,
        skip_bad=skip_bad,
        progress=progress,
    )


def compare_results(first: "Result | str | Path", second: "Result | str | Path") -> "ResultComparison":
    """Compare two results of one kind that were computed on the same folds.

    Parameters
    ----------
    first, second : Result, str or Path
        Results of `benchmark` or of a comparison with baselines, or the JSON files that their commands write.

    Returns
    -------
    ResultComparison
        Changed settings, paired differences of the accuracies (second minus first), and the recordings whose
        prediction is correct in only one of the results. `document()` is the report.

    Raises
    ------
    ValueError
        If the results are of different kinds, contain no predictions, or have different folds.
    """
    from texclass.baselines import comparison  # noqa: F401 - registers its kind of results
    from texclass.evaluation import result_comparison

    sides = {"first result": first, "second result": second}
    names = [str(one) if isinstance(one, str | Path) else side for side, one in sides.items()]
    return result_comparison.compare_results(first, second, names=(names[0], names[1]))


def plot_recording(
    recording: "Recording | str | Path", *, fs: float | None = None, unit: str | None = None
) -> "Figure":
    """Plot the signal, phases, one tap, spectrogram and feature values of a recording.

    Parameters
    ----------
    recording : Recording, str or Path
        Recording, file, or "DATASET:RECORDING".
    fs : float, optional
        Sampling rate in Hz of a file that does not state it.
    unit : str, optional
        Unit of the acceleration in a file that does not state it.

    Returns
    -------
    Figure
        A Matplotlib figure.

    Examples
    --------
    >>> import numpy as np
    >>> import texclass as tx
    >>> recording = tx.Recording(np.random.default_rng(0).standard_normal((20_000, 3)), fs=10_000)
    >>> tx.plot_recording(recording).savefig("recording.png")
    """
    from texclass.evaluation.inspection import inspect_recording
    from texclass.loaders import find_recording

    if isinstance(recording, str | Path):
        recording = find_recording(recording, fs=fs, unit=unit)
    return inspect_recording(recording, "strese2015")[0]


def as_dataset(dataset: Any, fs: float | None, unit: str | None) -> Any:
    """Open a dataset given by name or path; return other objects unchanged."""
    from texclass.loaders import open_dataset

    return open_dataset(dataset, fs=fs, unit=unit) if isinstance(dataset, str | Path) else dataset
