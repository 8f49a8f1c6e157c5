"""Benchmark: evaluate every row of a pipeline with every classifier on a dataset.

The best row of a benchmark is selected on the test folds, so its accuracy is optimistic. The report therefore
opens with the accuracy of nested cross-validation (`run_nested_cv`), which is unbiased.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import spearmanr
from sklearn.metrics import confusion_matrix

from texclass.evaluation.ablation import measure_ablation, select_base
from texclass.evaluation.accuracy import most_frequent, score
from texclass.evaluation.axes import AxesOption, decide_axes
from texclass.evaluation.confusion import write_confusion
from texclass.evaluation.cost import CostMeter
from texclass.evaluation.feature_table import FeatureTable, cached_table, metadata
from texclass.evaluation.folds import Evaluation
from texclass.evaluation.pipeline import DEFAULT_PIPELINE, MatchedRow, PipelineDefinition, load_pipeline
from texclass.evaluation.protocols import (
    Protocol,
    find_protocol,
    make_splits,
    min_per_surface,
    require_nested,
)
from texclass.evaluation.result_comparison import list_tests
from texclass.evaluation.result_facts import (
    CODE_DEPENDENCIES,
    best_pair,
    describe_dataset,
    example_facts,
    list_pairs,
)
from texclass.evaluation.splits import Split, n_starts
from texclass.evaluation.windows import add_overlapping_windows, is_testable
from texclass.evaluation.workers import Progress, run_parallel
from texclass.features.reasons import Reason
from texclass.loaders import open_dataset
from texclass.loaders.dataset import Dataset
from texclass.provenance import code_provenance, versions
from texclass.reporting.result_files import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from texclass.reporting import Document

MIN_TRAINING_RECORDINGS = 2
"""Smallest number of training recordings per surface: estimating the variance within a surface needs two."""
INNER_FOLDS = 3
"""Largest number of inner folds of nested cross-validation, as in the forward selection of the shipped
pipelines. The time of nested cross-validation is proportional to it."""
SWITCHED_OFF = "it was switched off (`--no-nested-cv`)"
"""Reason in the result of a benchmark without nested cross-validation."""


class BenchmarkResult(Result, kind="benchmark"):
    """Accuracies of a pipeline on a dataset, as returned by `run_benchmark`.

    `data` contains `dataset` (facts about it), `pipeline`, `protocol`, `rows` (accuracies by classifier,
    published accuracies, latency, missing features), `confusion` (confusion matrix of the best row),
    `ablation` (gain of each feature group), `nested_cv` (nested cross-validation) or `nested_cv_skipped`
    (reason why it was not run), `tests` (tested recordings and correct predictions), `example` (a recording
    and its phases), `left_out` (unusable recordings), `flags` (notices of the loaders), `undefined`
    (undefined features with reasons), and the settings, hashes and versions that are needed to reproduce the
    result.

    Examples
    --------
    >>> accuracy = {"lda": {"mean": 0.9, "low": 0.8, "high": 0.95}}
    >>> rows = [{"name": "MFCC", "accuracy": accuracy}]
    >>> BenchmarkResult({"rows": rows}).best
    ('MFCC', 'lda')
    """

    def __repr__(self) -> str:
        title = f"{self.data['dataset']['name']}, {self.data['pipeline']['name']}, {self.data['protocol']}"
        if self.best is None:
            return f"<{type(self).__name__}: {title}; no row could be evaluated>"
        nested, mean = self.data.get("nested_cv"), 100 * self.table["mean"].max()
        unbiased = f"nested cross-validation {100 * nested['accuracy']['mean']:.1f} %; " if nested else ""
        return f"<{type(self).__name__}: {title}; {unbiased}best {mean:.1f} %, {' with '.join(self.best)}>"

    def _repr_html_(self) -> str:
        """Return the summary and the table as HTML for a notebook."""
        head = f"<p><strong>{escape(repr(self).strip('<>'))}</strong></p>"
        return head + self.table.to_html(index=False, float_format="{:.3g}".format, na_rep="", border=0)

    @property
    def stem(self) -> str:
        """Prefix of the file names: dataset, pipeline and protocol."""
        protocol = re.sub(r"[^\w.+-]+", "-", self.data["protocol"].replace("->", "to"))
        return f"{self.data['dataset']['name']}-{self.data['pipeline']['name']}-{protocol}"

    @property
    def definitions(self) -> dict[str, tuple[str, str]]:
        """Name and hash of the pipeline and of the feature set."""
        pipeline = self.data["pipeline"]
        return {
            "pipeline": (pipeline["name"], pipeline["hash"]),
            "feature set": (pipeline["features"], pipeline.get("features_hash", "")),
        }

    @property
    def table(self) -> pd.DataFrame:
        """Accuracy, interval, published accuracy and latency of each row with each classifier."""
        keys = ("mean", "low", "high", "interval", "clusters", "n_clusters", "balanced", "worst")
        lines = [
            {
                "row": pair.row["name"],
                "classifier": pair.classifier,
                "n_features": pair.row["n_features"],
                **{key: pair.accuracy[key] for key in keys},
                "paper": pair.published,
                "ms_per_recording": pair.row["ms_per_recording"],
            }
            for pair in list_pairs(self.data)
        ]
        return pd.DataFrame(lines)

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write JSON, Markdown, figures and the confusion matrix (CSV) into a folder. Return the paths."""
        written = super().save(folder)
        if self.data["confusion"] is None:
            return written
        return (*written, self.save_confusion(Path(folder) / f"{self.stem}-confusion.csv"))

    def save_confusion(self, path: str | Path) -> Path:
        """Write the confusion matrix of the best row as CSV, one line per true label.

        Raises
        ------
        ValueError
            If no row could be evaluated.
        """
        confusion = self.data["confusion"]
        if confusion is None:
            raise ValueError("cannot write the confusion matrix: no row could be evaluated")
        return write_confusion(path, confusion["surfaces"], confusion["surfaces"], confusion["counts"])

    def document(self) -> "Document":
        """Return the benchmark as a document."""
        from texclass.evaluation.benchmark_document import benchmark_document

        return benchmark_document(self.data)

    def plot(self, classifier: str | None = None, ax: "Axes | None" = None) -> "Axes":
        """Plot the accuracy of each row with its confidence interval, and the published accuracy.

        Parameters
        ----------
        classifier : str, optional
            Name of one classifier (default: all).
        ax : matplotlib.axes.Axes, optional
            Axes to draw on (default: axes of a new figure).

        Returns
        -------
        matplotlib.axes.Axes
            The axes, with accuracies in per cent.

        Raises
        ------
        ValueError
            If no row could be evaluated.
        """
        from texclass.evaluation.benchmark_document import plot_benchmark

        if self.best is None:
            raise ValueError("cannot plot: no row could be evaluated")
        return plot_benchmark(self.data, [classifier] if classifier else None, ax)

    def plot_confusion_matrix(self, ax: "Axes | None" = None) -> "Axes":
        """Plot the confusion matrix of the best row: true labels in rows, predicted labels in columns.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on (default: axes of a new figure).

        Returns
        -------
        matplotlib.axes.Axes
            The axes.

        Raises
        ------
        ValueError
            If no row could be evaluated.
        """
        from texclass.evaluation.plots import plot_confusion_matrix

        if self.data["confusion"] is None:
            raise ValueError("cannot plot the confusion matrix: no row could be evaluated")
        return plot_confusion_matrix(self.data["confusion"], ax)

    @property
    def best(self) -> tuple[str, str] | None:
        """Row and classifier with the highest accuracy, or None if no row could be evaluated."""
        best = best_pair(self.data)
        return (best.row["name"], best.classifier) if best else None


def run_benchmark(
    dataset: Dataset | str | Path,
    pipeline: PipelineDefinition | str | Path | None = None,
    *,
    protocol: str | None = None,
    n_folds: int | None = None,
    nested_cv: bool | None = None,
    axes: AxesOption = "auto",
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> BenchmarkResult:
    """Evaluate every row of a pipeline with every classifier on a dataset by cross-validation.

    Parameters
    ----------
    dataset : Dataset, str or path
        Labelled recordings, or windows from `cut_windows`. Windows of one recording stay in the same fold
        (except with "shuffled-windows"), and the accuracy of their majority vote is also reported.
        Alternatively, an argument of
        `open_dataset`: the name of a shipped dataset, the path of a dataset card, or the path of a folder
        whose files state the sampling rate and the unit.
    pipeline : PipelineDefinition, str or path
        Pipeline, or its name or path; see `load_pipeline`. The default is the published table, "strese2015",
        followed by the default pipeline of `train` on the same folds.
    protocol : str, optional
        Name of a protocol; see `find_protocol` (default: the protocol of the pipeline).
    n_folds : int, optional
        Number of folds for protocols that draw folds (default: the number in the pipeline).
    nested_cv : bool, optional
        Whether to run nested cross-validation, which selects the row and the classifier inside each training
        set. By default, it is run where this is possible; otherwise the result contains the reason. If True,
        an error is raised where it is impossible.
    axes : {"auto", "merged", "separate"}
        Whether to merge the axes of the accelerometer (default "auto": as in the pipeline, or decided from
        the recordings if it leaves this open); see `decide_axes`.
    n_jobs : int
        Number of processes (default 1).
    skip_bad : bool
        Whether to leave out bad recordings and list them in the result (default False: the first bad
        recording raises an error).
    progress : callable, optional
        Function called with (done, total, stage).

    Returns
    -------
    BenchmarkResult
        The result. Except for the latency, it is deterministic for the same dataset, pipeline, protocol and
        package versions.

    Raises
    ------
    RecordingError
        If a recording is bad and `skip_bad` is False.
    ValueError
        If the protocol cannot split the dataset, or `nested_cv` is True and a training set cannot be split.
    """
    dataset = dataset if isinstance(dataset, Dataset) else open_dataset(dataset)
    if pipeline is None:
        options = {"n_jobs": n_jobs, "skip_bad": skip_bad, "progress": progress}
        return _with_default_pipeline(
            dataset, protocol=protocol, n_folds=n_folds, nested_cv=nested_cv, axes=axes, **options
        )
    pipeline = pipeline if isinstance(pipeline, PipelineDefinition) else load_pipeline(pipeline)
    dataset = dataset.with_phase_settings(pipeline.phase_settings.changes, override=False)
    channels, axes_reason = decide_axes(dataset, pipeline.channels, axes)
    pipeline = pipeline.model_copy(update={"channels": channels})
    split_protocol = find_protocol(protocol or pipeline.protocol.name)
    if split_protocol.separates_recordings:
        dataset = add_overlapping_windows(dataset, pipeline.overlap)
    n_folds = pipeline.protocol.folds if n_folds is None else n_folds
    # Split before the features are computed, so that an impossible split fails at once.
    labels = metadata(dataset.entries)
    splits = split_protocol.split(labels, n_folds, pipeline.seed)
    if nested_cv:
        require_nested(split_protocol)
        if sum(len(row.select_classifiers(pipeline.classifiers)) for row in pipeline.rows) > 1:
            inner_splits(split_protocol, labels, splits, pipeline.seed)
    work: dict[str, Any] = {"n_jobs": n_jobs, "progress": progress}
    table = cached_table(dataset, *pipeline.needed, channels=pipeline.channels, skip_bad=skip_bad, **work)
    frame = table.frame
    splits = split_protocol.split(frame, n_folds, pipeline.seed)
    rows = [MatchedRow.match(row, pipeline.features, table) for row in pipeline.rows]
    meter = CostMeter.from_dataset(dataset, frame["recording_id"].tolist(), pipeline.channels)
    evaluations = _evaluate(rows, table, splits, pipeline, split_protocol, **work)
    nested, skipped = None, None if nested_cv is not False else SWITCHED_OFF
    if nested_cv is not False:
        try:
            nested = run_nested_cv(rows, table, splits, pipeline, split_protocol, evaluations, **work)
        except ValueError as error:  # inner folds are impossible, or too small for a classifier
            if nested_cv:
                raise
            skipped = str(error)
    ablation = None
    if pipeline.additions and (base := select_base(pipeline, rows, evaluations)):
        ablation = measure_ablation(pipeline, table, base, split_protocol, n_folds, meter, **work)
    units = (split_protocol.unit, split_protocol.independent(frame)[0])
    lines = [_line(row, pipeline, meter, evaluations.get(row.definition.name, {}), units) for row in rows]
    agreement = {name: rank_agreement(lines, name) for name in pipeline.classifiers}
    test_unit = "windows" if "parent" in frame else "recordings"
    return BenchmarkResult(
        {
            "dataset": describe_dataset(dataset, frame, meter.recordings[0]),
            "example": example_facts(meter.recordings[0]),
            "pipeline": {
                "name": pipeline.name,
                "hash": pipeline.hash,
                "features": pipeline.features.name,
                "features_hash": pipeline.features.hash,
            },
            "movement": pipeline.features.movement,
            "channels": channels,
            "axes": axes_reason,
            "protocol": split_protocol.name,
            "protocol_description": split_protocol.description,
            "n_folds": len(splits),
            **({"n_starts": starts} if (starts := n_starts(splits)) else {}),
            "accuracy_unit": f"fraction of {test_unit}; low and high are the 95 % interval by `interval`",
            "rows": lines,
            "segmentation_ms": meter.segmentation_ms,
            "published_on": pipeline.published_on and pipeline.published_on.model_dump(),
            "rank_agreement": {name: value and value[0] for name, value in agreement.items()},
            "rank_agreement_interval": {name: value and value[1] for name, value in agreement.items()},
            "confusion": _confusion(lines, evaluations, dataset.surfaces),
            "ablation": ablation,
            "nested_cv": nested,
            "nested_cv_skipped": skipped,
            "tests": list_tests(frame, splits, split_protocol, _hits(lines, evaluations, nested)),
            "left_out": [list(item) for item in table.left_out],
            "flags": [list(item) for item in table.flags],
            "undefined": _undefined(table),
            "versions": versions(
                "numpy", "scipy", "scikit-learn", "pandas", "PyWavelets", "librosa", "joblib"
            ),
            "seed": pipeline.seed,
            "input_hash": dataset.input_hash,
            **code_provenance(*CODE_DEPENDENCIES),
        }
    )


def _with_default_pipeline(
    dataset: Dataset, *, protocol: str | None, n_folds: int | None, **options: Any
) -> BenchmarkResult:
    """Return the published table, with the default pipeline of `train` on the same folds."""
    published, default = load_pipeline("strese2015"), load_pipeline(DEFAULT_PIPELINE)
    result = run_benchmark(dataset, published, protocol=protocol, n_folds=n_folds, **options)
    # The folds depend on the number of folds and the seed.
    settings = {"seed": published.seed, "protocol": published.protocol}
    comparison = run_benchmark(
        dataset,
        default.model_copy(update=settings),
        protocol=protocol,
        n_folds=n_folds,
        **(options | {"nested_cv": False}),
    )
    keys = ("pipeline", "channels", "axes", "rows")
    return BenchmarkResult({**result.data, "default": {key: comparison.data[key] for key in keys}})


def _evaluate(
    rows: Sequence[MatchedRow],
    table: FeatureTable,
    splits: Any,
    pipeline: PipelineDefinition,
    protocol: Protocol,
    **work: Any,
) -> dict[str, dict[str, Evaluation]]:
    """Evaluate every row that has columns: row name -> classifier name -> evaluation."""
    options = {
        "nested": protocol.is_nested,
        "clusters": protocol.clusters(table.frame),
        "independent": protocol.independent(table.frame)[1],
    }
    n_train = min(min_per_surface(protocol, table.frame.iloc[train]) for train, _ in splits)
    is_single = n_train < MIN_TRAINING_RECORDINGS
    tasks, calls = [], []
    for row in rows:
        classifiers = row.definition.select_classifiers(pipeline.classifiers) if row.columns else ()
        # Some classifiers reject surfaces with one recording.
        groups = [(name,) for name in classifiers] if is_single else _groups(row, classifiers)
        for names in groups:
            trial = partial(pipeline.trials(row, names, table), splits, **options)
            calls.append(partial(_evaluate_if_possible, trial) if is_single else trial)
            tasks.append((row.definition.name, names))
    evaluations: dict[str, dict[str, Evaluation]] = {}
    # New processes import scikit-learn first, which takes longer than short work.
    results = run_parallel(calls, stage="rows", total=len(calls), local_s=0.3, **work)
    for (row_name, names), row_evaluations in zip(tasks, results, strict=True):
        if row_evaluations:
            evaluations.setdefault(row_name, {}).update(zip(names, row_evaluations, strict=True))
    return evaluations


def _groups(row: MatchedRow, classifiers: Iterable[str]) -> list[tuple[str, ...]]:
    """Return groups of classifiers that share the preparation of a row. Forward selection has a criterion."""
    names = tuple(classifiers)
    if row.definition.select is not None:
        return [(name,) for name in names]
    return [names] if names else []


def _undefined(table: FeatureTable) -> list[Any]:
    """Return each undefined feature with its most frequent reason and the number of recordings affected."""
    testable = table.frame["recording_id"][is_testable(table.frame)]
    reasons = pd.DataFrame(table.reasons, columns=Reason._fields)
    by_feature = reasons[reasons["recording_id"].isin(testable)].groupby("feature", sort=False)["reason"]
    undefined = by_feature.agg(reason=most_frequent, n_recordings="size")
    return undefined.reset_index().to_dict("records")


def _evaluate_if_possible(trial: Callable[[], list[Evaluation]]) -> list[Evaluation]:
    """Return evaluations, or an empty list if a surface has too few recordings for the classifiers."""
    try:
        return trial()
    except ValueError:
        return []


def _line(
    row: MatchedRow,
    pipeline: PipelineDefinition,
    meter: CostMeter,
    evaluations: Mapping[str, Evaluation],
    units: tuple[str, str],
) -> dict[str, Any]:
    """Return the results of a row as JSON values, with the published accuracies as fractions."""
    # Count all features of the row even if columns are selected, because the selection differs between folds.
    features = pipeline.features.restricted_to(row.definition.features)
    shares = {name: zip(row.columns, e.support.tolist(), strict=True) for name, e in evaluations.items()}
    has_selection = row.definition.select is not None
    problem = "its classifiers need more recordings per surface" if row.columns and not evaluations else None
    return {
        "name": row.definition.name,
        "n_features": row.n_features,
        "accuracy": {name: e.accuracy.to_dict(*units) for name, e in evaluations.items()},
        "paper": {name: value / 100 for name, value in row.definition.published.items()},
        "ms_per_recording": meter.milliseconds(features) if row.columns else None,
        "missing": problem or row.missing,
        "selected": {
            name: {column: share for column, share in pairs if share > 0}
            for name, pairs in shares.items()
            if has_selection
        },
        "reference": row.definition.reference,
        **({"note": row.definition.note} if row.definition.note else {}),
    }


def rank_agreement(
    lines: Sequence[Mapping[str, Any]], classifier: str
) -> tuple[float, tuple[float, float] | None] | None:
    """Return the Spearman correlation of measured and published accuracies, with its 95 % interval.

    The interval over n rows is tanh(atanh(r) -+ 1.96 sqrt((1 + r^2/2)/(n - 3))).

    Parameters
    ----------
    lines : sequence of mapping
        Rows of a benchmark, as in the `rows` of `BenchmarkResult.data`.
    classifier : str
        Name of the classifier.

    Returns
    -------
    tuple or None
        Correlation and interval, or None if there are fewer than three rows. The interval is None if there
        are fewer than four rows, or if the correlation is perfect.

    References
    ----------
    Bonett, Wright (2000): Sample size requirements for estimating Pearson, Kendall and Spearman correlations.
    Psychometrika 65.
    """
    pairs = [
        (line["accuracy"][classifier]["mean"], line["paper"][classifier])
        for line in lines
        if classifier in line["accuracy"] and classifier in line["paper"]
    ]
    if len(pairs) < 3 or any(len(set(values)) < 2 for values in zip(*pairs, strict=True)):
        return None
    r, n = float(spearmanr(*np.array(pairs).T).statistic), len(pairs)
    if n < 4 or abs(r) > 1 - 1e-12:
        return r, None
    # tanh(atanh(r) -+ 1.96 sqrt((1 + r^2/2)/(n - 3)))
    half = 1.96 * np.sqrt((1 + r**2 / 2) / (n - 3))
    low, high = np.tanh(np.arctanh(r) + np.array([-half, half]))
    return r, (float(low), float(high))


def _hits(
    lines: Sequence[Mapping[str, Any]],
    evaluations: Mapping[str, Mapping[str, Evaluation]],
    nested: Mapping[str, Any] | None,
) -> dict[str, list[NDArray[np.bool_]]]:
    """Return whether nested cross-validation and the best pair predict each test correctly, by fold."""
    hits = dict[str, list[NDArray[np.bool_]]]()
    if nested:
        hits["nested_cv"] = [
            evaluations[row][name].hits[k] for k, (row, name) in enumerate(nested["selected"])
        ]
    if best := best_pair({"rows": lines}):
        hits["best"] = [*evaluations[best.row["name"]][best.classifier].hits]
    return hits


def _confusion(
    lines: Sequence[Mapping[str, Any]],
    evaluations: Mapping[str, Mapping[str, Evaluation]],
    surfaces: Sequence[str],
) -> dict[str, Any] | None:
    """Return the confusion matrix of the row and classifier with the highest accuracy."""
    best = best_pair({"rows": lines})
    if best is None:
        return None
    row, name = best.row["name"], best.classifier
    evaluation = evaluations[row][name]
    y_true, y_pred = np.concatenate(evaluation.y_true), np.concatenate(evaluation.y_pred)
    counts = confusion_matrix(y_true, y_pred, labels=list(surfaces)).tolist()
    return {"row": row, "classifier": name, "surfaces": list(surfaces), "counts": counts}


def run_nested_cv(
    rows: Sequence[MatchedRow],
    table: FeatureTable,
    splits: Sequence[Split],
    pipeline: PipelineDefinition,
    protocol: Protocol,
    evaluations: Mapping[str, Mapping[str, Evaluation]],
    *,
    n_jobs: int = 1,
    progress: Progress | None = None,
) -> dict[str, Any] | None:
    """Run nested cross-validation, which selects row and classifier inside each training set.

    The selected pair of row and classifier is tested on the test set. If several pairs have the highest
    accuracy inside a training set, the pair with the most columns is selected, or the first of them.

    Parameters
    ----------
    rows, table, splits, pipeline, protocol
        Matched rows, feature table, splits, pipeline and protocol of the benchmark.
    evaluations : mapping
        Predictions for the test set of each fold: row name -> classifier name -> evaluation.
    n_jobs : int
        Number of processes (default 1).
    progress : callable, optional
        Function called with (done, total, "choices").

    Returns
    -------
    dict or None
        JSON values: `accuracy` of the selected pairs on the test sets; row and classifier `selected` in each
        fold; names of the `inner_protocols` (empty if there is only one pair). None if no row could be
        evaluated.

    Raises
    ------
    ValueError
        If `inner_splits` cannot split the training sets.
    """
    pairs = [(row, name) for row in rows for name in evaluations.get(row.definition.name, ())]
    if not pairs:
        return None
    require_nested(protocol)
    if len(pairs) == 1:  # nothing to select, so one training recording per surface is enough
        ((row, name),) = pairs
        accuracy = evaluations[row.definition.name][name].accuracy
        selected = [[row.definition.name, name]] * len(splits)
        units = protocol.unit, protocol.independent(table.frame)[0]
        return {"accuracy": accuracy.to_dict(*units), "selected": selected, "inner_protocols": []}
    inner = inner_splits(protocol, table.frame, splits, pipeline.seed)
    unit_name, units_of_rows = protocol.independent(table.frame)
    trials = [
        pipeline.trials(row, names, table)
        for row in rows
        for names in _groups(row, evaluations.get(row.definition.name, ()))
    ]
    calls = [
        partial(trial, [(train[a], train[b]) for a, b in inner_folds])
        for (train, _), (_, inner_folds) in zip(splits, inner, strict=True)
        for trial in trials
    ]
    options: dict[str, Any] = {"progress": progress, "stage": "choices", "total": len(calls)}
    results = run_parallel(calls, n_jobs=n_jobs, **options)
    hits = [evaluation.accuracy.n_hits for group in results for evaluation in group]
    # A bonus of less than one hit only breaks ties between pairs with equal numbers of hits.
    bonus = np.array([row.n_features for row, _ in pairs]) / (1 + sum(row.n_features for row, _ in pairs))
    best = (np.reshape(hits, (len(splits), len(pairs))) + bonus).argmax(axis=1)
    selected = [[pairs[k][0].definition.name, pairs[k][1]] for k in best]
    y_pred = [evaluations[row][name].y_pred[k] for k, (row, name) in enumerate(selected)]
    y_true, *groups = (
        [values[test] for _, test in splits]
        for values in (table.surfaces, protocol.clusters(table.frame), units_of_rows)
    )
    return {
        "accuracy": score(y_true, y_pred, *groups).to_dict(protocol.unit, unit_name),
        "selected": selected,
        "inner_protocols": list(dict.fromkeys(name for name, _ in inner)),
    }


def inner_splits(
    protocol: Protocol, table: pd.DataFrame, splits: Sequence[Split], seed: int
) -> list[tuple[str, tuple[Split, ...]]]:
    """Return the inner splits of each training set, with the name of their protocol.

    The inner splits use the protocol of the outer splits if possible. Otherwise, they are stratified folds
    over recordings. For example, a training set of one operator cannot be split by operator.

    Raises
    ------
    ValueError
        If the protocol fits the preparation (scaling and selection) on test recordings, or a training set
        cannot be split.
    """
    require_nested(protocol)
    return [_inner_split(protocol, table.iloc[train].reset_index(drop=True), seed) for train, _ in splits]


def _inner_split(protocol: Protocol, training_set: pd.DataFrame, seed: int) -> tuple[str, tuple[Split, ...]]:
    for name in dict.fromkeys((protocol.name, "recording")):
        inner_protocol = find_protocol(name)
        try:
            splits = make_splits(inner_protocol, training_set, seed, INNER_FOLDS)
            n_train = min(min_per_surface(inner_protocol, training_set.iloc[train]) for train, _ in splits)
            if n_train >= MIN_TRAINING_RECORDINGS:
                return name, splits
            problem = (
                f"a surface would have {n_train} training {inner_protocol.unit}. "
                f"Expected at least {MIN_TRAINING_RECORDINGS}"
            )
        except ValueError as error:
            problem = str(error)
    raise ValueError(
        f"a training set cannot be split for nested cross-validation: {problem}. Record more repetitions"
    )
