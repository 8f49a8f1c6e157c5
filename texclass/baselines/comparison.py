"""Comparison of texclass with baselines on the same folds: accuracy, cost and paired differences."""

import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from texclass.baselines.baseline_worker.baselines import BASELINES, Baseline
from texclass.baselines.baseline_worker.run import write_task
from texclass.baselines.worker_process import measure_ours, run_worker
from texclass.evaluation.accuracy import compare, score
from texclass.evaluation.benchmark import BenchmarkResult
from texclass.evaluation.feature_table import FeatureTable, cached_table
from texclass.evaluation.pipeline import MatchedRow, PipelineDefinition
from texclass.evaluation.protocols import Protocol, find_protocol
from texclass.evaluation.result_comparison import list_tests
from texclass.evaluation.result_facts import CODE_DEPENDENCIES, NESTED_CV_TITLE
from texclass.evaluation.splits import Split
from texclass.evaluation.windows import add_overlapping_windows
from texclass.evaluation.workers import Progress
from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import Views, separate_channels, views_of
from texclass.loaders.dataset import Dataset
from texclass.phases import find_phases
from texclass.provenance import code_provenance
from texclass.recording import Phases, Recording, Samples
from texclass.reporting import Document
from texclass.reporting.result_files import Result

SignalChoice = Literal["same", "each"]
DESCRIPTIONS: dict[SignalChoice, str] = {
    "same": "the signals of our movement features (axes of one accelerometer combined by DFT321, other "
    "channels separate; mean removed, and hand motion if the feature set removes it)",
    "each": "every axis of accelerometer and gyroscope separately, cut to the movement, mean removed",
}
"""Descriptions of the input signals of the baselines."""
Contestant = Mapping[str, Any]
"""Description of a contestant, its predictions in each fold, and its cost (see `measure_ours`)."""


@dataclass(frozen=True)
class BaselineSettings:
    """Settings of the baselines.

    Attributes
    ----------
    names
        Names of the baselines, in the order of the comparison (default: all).
    python
        Path of a Python interpreter in which the packages of the baselines are installed (default: the
        running interpreter).
    time_limit_s
        Time limit of each baseline in s of wall-clock time (default 900).
    signals
        Input signals of the baselines: "same" (default) for the signals from which texclass computes its
        features, or "each" for every axis; see `DESCRIPTIONS`.

    Raises
    ------
    ValueError
        If a name or `signals` is unknown, or the time limit is not positive.

    Examples
    --------
    >>> BaselineSettings(("mfcc", "catch22"), time_limit_s=60).signals
    'same'
    """

    names: tuple[str, ...] = tuple(BASELINES)
    python: Path = Path(sys.executable)
    time_limit_s: float = 900.0
    signals: SignalChoice = "same"

    def __post_init__(self) -> None:
        if unknown := [name for name in self.names if name not in BASELINES]:
            raise ValueError(f"unknown baseline {unknown[0]!r}. Expected one of {', '.join(BASELINES)}")
        if self.signals not in DESCRIPTIONS:
            raise ValueError(f"signals must be 'same' or 'each', got {self.signals!r}")
        if not self.time_limit_s > 0:
            raise ValueError(f"time_limit_s must be positive, got {self.time_limit_s} s")


class BaselineComparison(Result, kind="baselines"):
    """Accuracy and cost of texclass and of baselines on the same folds.

    `compare_with_baselines` returns this result. `data` contains facts about `dataset`, `pipeline` and
    `protocol`; the input `signals` and the `time_limit_s` of the baselines; and the `contestants`, beginning
    with those of texclass. Each contestant has a `status` and a `message`, the number of columns
    (`n_columns`) and of finished folds (`n_folds`), its `accuracy`, its `cost` (memory, and CPU time of one
    thread without compilation), and a `difference`: the accuracy of the first contestant minus the accuracy
    of this contestant.
    """

    @property
    def stem(self) -> str:
        """Prefix of the file names: dataset, pipeline, protocol, and "baselines"."""
        return f"{self.data['dataset']['name']}-{self.data['pipeline']}-{self.data['protocol']}-baselines"

    @property
    def definitions(self) -> dict[str, tuple[str, str]]:
        """Name and hash of the pipeline."""
        return {"pipeline": (self.data["pipeline"], self.data["pipeline_hash"])}

    def document(self) -> Document:
        """Return the comparison as a document."""
        from texclass.baselines.baselines_document import baselines_document

        return baselines_document(self.data)

    @property
    def best_baseline(self) -> Mapping[str, Any] | None:
        """Most accurate baseline that finished every fold, or None if no baseline did."""
        from texclass.baselines.baselines_document import best_baseline

        return best_baseline(self.data)


def compare_with_baselines(
    dataset: Dataset,
    pipeline: PipelineDefinition,
    result: BenchmarkResult,
    settings: BaselineSettings | None = None,
    *,
    n_folds: int | None = None,
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> BaselineComparison:
    """Evaluate baselines on the folds of a benchmark, and measure the cost of texclass in the same way.

    The contestants of texclass are nested cross-validation (if the benchmark ran it), the most accurate row,
    and the row with the most features. Each contestant runs in its own process with one thread. The baselines
    run in the interpreter `settings.python`, and read signals and folds from files. Everything is fitted only
    on the training set of a fold, except that the protocol "paper" fits the preparation of texclass on all
    recordings.

    Parameters
    ----------
    dataset, pipeline, n_folds, n_jobs, skip_bad, progress
        See `run_benchmark`.
    result : BenchmarkResult
        Result of `run_benchmark` for this dataset and pipeline.
    settings : BaselineSettings, optional
        Settings of the baselines (default: all baselines in the running interpreter).

    Returns
    -------
    BaselineComparison
        The comparison.

    Raises
    ------
    ValueError
        If no row of the pipeline could be evaluated, or the interpreter cannot be run.
    """
    settings = settings or BaselineSettings()
    pipeline = pipeline.model_copy(update={"channels": result.data["channels"]})
    protocol = find_protocol(result.data["protocol"])
    if protocol.separates_recordings:
        dataset = add_overlapping_windows(dataset, pipeline.overlap)
    table = cached_table(
        dataset, *pipeline.needed, channels=pipeline.channels, n_jobs=n_jobs, skip_bad=skip_bad
    )
    n_folds = pipeline.protocol.folds if n_folds is None else n_folds
    splits = protocol.split(table.frame, n_folds, pipeline.seed)
    report = progress or (lambda done, total, what: None)
    total = len(settings.names) + 1
    report(0, total, "baselines")
    contestants, segmentation_s = _our_contestants(result, pipeline, dataset, table, protocol, splits)
    report(1, total, "baselines")
    versions: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="texclass-baselines-") as folder:
        task = Path(folder) / "task"
        lengths = _write_signals(task, settings.signals, dataset, pipeline, table, splits)
        for done, name in enumerate(settings.names, start=2):
            outcome = run_worker(settings.python, task, name, Path(folder) / name, settings.time_limit_s)
            contestants += _baseline_contestants(BASELINES[name], outcome, np.unique(table.surfaces))
            versions |= outcome["versions"]
            report(done, total, "baselines")
    notes, benchmark = list[str](), result.data
    if not protocol.is_nested:
        notes.append(
            "our preparation is fitted on all recordings, test folds included, as in the protocol; the "
            "preparation of the baselines is fitted on the training set of each fold"
        )
    notes += _length_notes(lengths)
    return BaselineComparison(
        {
            "dataset": {**benchmark["dataset"], "n_tests": sum(test.size for _, test in splits)},
            "pipeline": benchmark["pipeline"]["name"],
            "pipeline_hash": benchmark["pipeline"]["hash"],
            "movement": pipeline.features.movement,
            "protocol": protocol.name,
            "protocol_description": protocol.description,
            "n_folds": len(splits),
            "n_pairs": len(result.table),
            "segmentation_ms": 1e3 * segmentation_s,
            "contestants": [
                _line(contestant, contestants[0], table, protocol, splits, segmentation_s)
                for contestant in contestants
            ],
            "tests": list_tests(table.frame, splits, protocol, _hits(contestants, table, splits)),
            "signals": DESCRIPTIONS[settings.signals],
            "time_limit_s": settings.time_limit_s,
            "versions": benchmark["versions"],
            "baseline_versions": versions,
            "seed": pipeline.seed,
            "input_hash": benchmark["input_hash"],
            **code_provenance(*CODE_DEPENDENCIES, "baselines"),
            "notes": notes,
            "accuracy_unit": "fraction of tests; low and high are the 95 % interval",
        }
    )


def _hits(
    contestants: Sequence[Contestant], table: FeatureTable, splits: Sequence[Split]
) -> dict[str, list[NDArray[np.bool_]]]:
    """Return whether each contestant predicts each test of its finished folds correctly."""
    return {
        f"{one['title']}, {one['classifier']}": [
            table.surfaces[test] == predicted
            for (_, test), predicted in zip(splits, one["predicted"], strict=False)
        ]
        for one in contestants
        if len(one["predicted"])
    }


def whole_surfaces(dataset: Dataset, limit: int) -> Dataset:
    """Return a dataset of at most `limit` recordings, with all recordings of evenly chosen surfaces.

    Parameters
    ----------
    dataset : Dataset
        Dataset to reduce.
    limit : int
        Maximum number of recordings.

    Returns
    -------
    Dataset
        The same dataset if it has at most `limit` recordings. Otherwise, a dataset with fewer surfaces, which
        are evenly spaced in the sorted list of names.

    Raises
    ------
    ValueError
        If any two surfaces together have more than `limit` recordings.

    Examples
    --------
    >>> from texclass.loaders import open_dataset
    >>> whole_surfaces(open_dataset("simulated"), 30).surfaces
    ('cork-17', 'plastic-19', 'wood-23')
    """
    names = dataset.surfaces
    for n in range(len(names), 1, -1):
        subset = {names[i] for i in np.linspace(0, len(names) - 1, n).astype(int)}
        entries = tuple(entry for entry in dataset.entries if entry.surface in subset)
        if len(entries) > limit:
            continue
        if n == len(names):
            return dataset
        note = f"{n} of the {len(names)} surfaces, spread evenly: fewer surfaces are easier to classify"
        name = f"{dataset.name}-{n}of{len(names)}"
        return replace(dataset, name=name, entries=entries, notes=(*dataset.notes, note))
    raise ValueError(
        f"limit must be at least the number of recordings of two surfaces, got {limit}. Increase it, because "
        "a comparison needs at least two surfaces"
    )


def _our_contestants(
    result: BenchmarkResult,
    pipeline: PipelineDefinition,
    dataset: Dataset,
    table: FeatureTable,
    protocol: Protocol,
    splits: Sequence[Split],
) -> tuple[list[Contestant], float]:
    """Return the contestants of texclass, and the CPU time of the segmentation per recording in s.

    The contestants are nested cross-validation (if the benchmark ran it), the most accurate row, and the row
    with the most features, combined with its most accurate classifier.
    """
    if result.best is None:
        raise ValueError(
            f"no row of pipeline {pipeline.name} can be evaluated on this dataset. Use a pipeline with at "
            "least one row whose features the dataset has"
        )
    accuracies = {row["name"]: row["accuracy"] for row in result.data["rows"] if row["accuracy"]}
    definitions = {row.name: row for row in pipeline.rows}
    widest = max(accuracies, key=lambda name: len(definitions[name].features))
    best_classifier = max(accuracies[widest], key=lambda name: accuracies[widest][name]["mean"])
    pairs = list(dict.fromkeys((result.best, (widest, best_classifier))))
    nested = result.data["nested_cv"]
    # Without inner folds there is only one pair.
    selected = [tuple(pair) for pair in nested["selected"]] if nested and nested["inner_protocols"] else []
    measurements: dict[tuple[str, str], Contestant] = {}
    for name, classifier in dict.fromkeys((*pairs, *selected)):
        row = MatchedRow.match(definitions[name], pipeline.features, table)
        measurements[name, classifier] = {
            "name": name, "title": name, "ours": True, "reference": definitions[name].reference,
            "classifier": classifier, "status": "done", "message": "", "n_columns": row.n_features,
            **measure_ours(row, classifier, pipeline, dataset, table, splits, nested=protocol.is_nested),
        }  # fmt: skip
    contestants = [_nested_contestant([measurements[pair] for pair in selected])] if selected else []
    contestants += [measurements[pair] for pair in pairs]
    return contestants, min(one["segmentation_s"] for one in measurements.values())


def _write_signals(
    task: Path,
    choice: SignalChoice,
    dataset: Dataset,
    pipeline: PipelineDefinition,
    table: FeatureTable,
    splits: Sequence[Split],
) -> tuple[int, ...]:
    """Write signals and folds for the baselines. Return the number of samples of each recording."""
    entries = {entry.recording_id: entry for entry in dataset.entries}
    ordered = [entries[recording_id] for recording_id in table.frame["recording_id"]]
    first = dataset.load(ordered[0]).with_(sound=None)  # baselines need signals of one rate
    separate, remove_hand_motion = (
        separate_channels(first, pipeline.channels),
        pipeline.features.remove_hand_motion,
    )
    recordings = (dataset.load(entry).with_(sound=None) for entry in ordered)
    signals = (
        every_channel(r)
        if choice == "each"
        else same_signals(r, separate, remove_hand_motion=remove_hand_motion)
        for r in recordings
    )
    labels = np.unique(table.surfaces, return_inverse=True)[1]
    return write_task(task, signals, labels, splits, first.fs, pipeline.seed)


def _nested_contestant(folds: Sequence[Mapping[str, Any]]) -> Contestant:
    """Return a contestant for nested cross-validation, with costs averaged over folds."""
    costs = ("feature_s", "fit_s", "predict_s", "first_s", "memory_mb")
    return {
        **folds[0],
        "name": NESTED_CV_TITLE, "title": NESTED_CV_TITLE, "reference": "",
        "classifier": "selected", "n_columns": 0,
        "predicted": tuple(fold["predicted"][k] for k, fold in enumerate(folds)),
        **{key: float(np.mean([fold[key] for fold in folds])) for key in costs},
    }  # fmt: skip


def _baseline_contestants(
    baseline: Baseline, outcome: Mapping[str, Any], names: NDArray[np.str_]
) -> Iterator[Contestant]:
    """Yield a contestant for each classifier of a baseline. It has no predictions if the baseline failed."""
    facts = {"name": baseline.name, "title": baseline.title, "ours": False, "reference": baseline.reference}
    facts |= {"status": outcome["status"], "message": outcome["message"]}
    if not outcome["folds"]:
        yield {**facts, "classifier": "", "n_columns": 0, "predicted": ()}
        return
    for classifier in baseline.classifiers:
        folds = [fold["classifiers"][classifier] for fold in outcome["folds"]]
        yield {
            **facts,
            "classifier": classifier,
            "n_columns": outcome["folds"][0]["n_columns"],
            "predicted": tuple(names[fold["predicted"]] for fold in folds),
            "feature_s": np.mean([fold["feature_s"] for fold in outcome["folds"]]),
            "fit_s": np.mean([fold["fit_s"] for fold in folds]),
            "predict_s": np.mean([fold["predict_s"] for fold in folds]),
            "first_s": outcome["first_s"] or 0.0,
            "memory_mb": outcome["folds"][-1]["memory_mb"],
        }


def _line(
    contestant: Contestant,
    first: Contestant,
    table: FeatureTable,
    protocol: Protocol,
    splits: Sequence[Split],
    segmentation_s: float,
) -> dict[str, Any]:
    """Return accuracy and cost of a contestant, and the difference from the first contestant."""
    keys = ("name", "classifier", "title", "ours", "status", "message", "reference", "n_columns")
    line: dict[str, Any] = {key: contestant[key] for key in keys}
    line |= {"n_folds": len(contestant["predicted"]), "accuracy": None, "cost": None, "difference": None}
    tests = [test for _, test in splits[: line["n_folds"]]]
    if not tests:
        return line
    n_train, n_test = np.mean([[train.size, test.size] for train, test in splits], axis=0)
    # All contestants use our segmentation.
    features_s = (n_train + n_test) * (segmentation_s + contestant["feature_s"])
    line["cost"] = {
        "feature_ms": float(1e3 * contestant["feature_s"]),
        "fit_s": float(contestant["fit_s"]),
        "predict_ms": float(1e3 * contestant["predict_s"]),
        "total_s": float(features_s + contestant["fit_s"] + n_test * contestant["predict_s"]),
        "memory_mb": contestant["memory_mb"],
        "first_s": contestant["first_s"],
    }
    y_true, independent = [table.surfaces[test] for test in tests], protocol.independent(table.frame)
    groups = ([values[test] for test in tests] for values in (protocol.clusters(table.frame), independent[1]))
    accuracy = score(y_true, contestant["predicted"], *groups)
    counts = {"n_hits": accuracy.n_hits, "n_tested": accuracy.n_tested}
    line["accuracy"] = counts | accuracy.to_dict(protocol.unit, independent[0])
    if contestant is not first:
        hits, others = (  # folds that both contestants have finished
            [[t == p for t, p in zip(y_true, one["predicted"], strict=False)]] for one in (first, contestant)
        )
        line["difference"] = compare(hits, others, splits, protocol, independent)
    return line


def _length_notes(lengths: tuple[int, ...]) -> Iterator[str]:
    """Yield a note on the lengths of the signals if they differ."""
    shortest, median, longest = min(lengths), int(np.median(lengths)), max(lengths)
    if shortest < longest:
        share = sum(n < median for n in lengths) / len(lengths)
        yield (
            f"signals have {shortest} to {longest} samples; QUANT and the rockets need signals of equal "
            "length: the median of all recordings (QUANT) or of the training set (rockets), here about "
            f"{median}; longer signals are cut at both ends, shorter signals ({share:.0%}) are padded with "
            "zeros, from which the baseline may learn their length"
        )


def same_signals(
    recording: Recording, separate: tuple[str, ...], *, remove_hand_motion: bool = False
) -> Samples:
    """Return the movement signals used for the features of texclass, shape (n_channels, n_samples).

    If the recording has no movement, its taps are concatenated. If it has no taps either, the whole recording
    is returned.
    """
    views = views_of(recording.with_interpolated("turn_rate"), separate)
    prefixes = [f"{name}/" for name in separate] or [""]
    return np.stack([_movement_samples(views[prefix], remove_hand_motion) for prefix in prefixes])


def every_channel(recording: Recording) -> Samples:
    """Return each axis during the movement, with its mean removed, shape (n_axes, n_samples)."""
    start, stop = find_phases(recording).movement or (0, recording.n_samples)
    signals = (recording.acceleration, recording.with_interpolated("turn_rate").turn_rate)
    axes = np.column_stack([signal[start:stop] for signal in signals if signal is not None])
    return np.ascontiguousarray((axes - axes.mean(axis=0)).T)


def _movement_samples(view: Views, remove_hand_motion: bool) -> Samples:
    with suppress(UndefinedFeatureError):
        return (view.vibration if remove_hand_motion else view.movement).samples
    with suppress(UndefinedFeatureError):
        return np.concatenate([part for tap in view.tap.taps for part in (tap.hand, tap.impulse)])
    whole = Phases(movement=(0, view.recording.n_samples))
    return _movement_samples(Views(view.recording, whole, view.channel), remove_hand_motion)
