"""Our rows and baselines on the same folds: accuracy, cost, paired difference."""

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
from texclass.evaluation.result import CHOICE, COMPUTED_BY
from texclass.evaluation.splits import Split
from texclass.evaluation.windows import overlapping
from texclass.evaluation.workers import Progress
from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import Views, separate_channels, views_of
from texclass.loaders.dataset import Dataset
from texclass.phases import find_phases
from texclass.provenance import code_provenance
from texclass.recording import Phases, Recording, Samples
from texclass.reporting import Document
from texclass.reporting.result_files import Result

Given = Literal["same", "each"]
DESCRIPTIONS: dict[Given, str] = {
    "same": "the very signals that our movement features read (axes of one accelerometer combined by DFT321, "
    "other channels apart; mean removed, and the path of the hand where the feature set does so)",
    "each": "every axis of accelerometer and gyroscope by itself, cut to the movement, mean removed",
}
"""What baselines are given."""
Entrant = Mapping[str, Any]
"""What a classifier is, what it `predicted` in each fold, and what it took: see `measure_ours`."""


@dataclass(frozen=True)
class BaselineSettings:
    """How baselines are run.

    Attributes
    ----------
    names
        Which, in this order; all of them by default.
    python
        The interpreter that has them.
    time_limit_s
        Wall-clock seconds for each.
    signals
        What they are given: "same" or "each", see `DESCRIPTIONS`.

    Raises
    ------
    ValueError
        If there is no such baseline or signal, or the limit is not above 0.
    """

    names: tuple[str, ...] = tuple(BASELINES)
    python: Path = Path(sys.executable)
    time_limit_s: float = 900.0
    signals: Given = "same"

    def __post_init__(self) -> None:
        if unknown := [name for name in self.names if name not in BASELINES]:
            raise ValueError(f"no baseline is named {unknown[0]!r}; the baselines are {', '.join(BASELINES)}")
        if self.signals not in DESCRIPTIONS:
            raise ValueError(f"signals of baselines are {self.signals!r}. Expected 'same' or 'each'")
        if not self.time_limit_s > 0:
            raise ValueError(
                f"the time limit of baselines is {self.time_limit_s} s. Expected a positive number"
            )


class BaselineComparison(Result, kind="baselines"):
    """Our rows and baselines on the same folds; see `compare_with_baselines`.

    `data` holds facts of `dataset`, `pipeline` and `protocol`; what baselines were given (`signals`) and the
    `time_limit_s` of each; and `contestants`, ours first: each with its `status` and `message`, `n_columns`,
    `n_folds` that were finished, `accuracy`, `cost` (CPU time on one thread without compilation, memory) and
    the `difference` of our first row from it, on the same tests.
    """

    @property
    def stem(self) -> str:
        """What the names of its files begin with."""
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
        """The most accurate baseline of those that finished every fold; the first of equals."""
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
    """Evaluate baselines on the folds of a benchmark, and time our rows with the same clock.

    Of ours, what was chosen inside the training parts competes, if the benchmark chose; the most accurate row
    of the table; and the one with the most features. Each contestant runs alone in a process of its own with
    one thread; baselines run in another interpreter, if one is given, and get signals and folds as files.
    Whatever learns is fitted on the training part of each fold.

    Parameters
    ----------
    dataset, pipeline, n_folds, n_jobs, skip_bad, progress
        As in `run_benchmark`.
    result : BenchmarkResult
        What `run_benchmark` returned for them; names the protocol and our best row.
    settings : BaselineSettings, optional
        Which baselines, in which interpreter, for how long.

    Returns
    -------
    BaselineComparison

    Raises
    ------
    ValueError
        If no row of ours could be computed, or the interpreter cannot be run.
    """
    settings = settings or BaselineSettings()
    options = {"channels": pipeline.channels, "n_jobs": n_jobs, "skip_bad": skip_bad}
    dataset = overlapping(dataset, pipeline.overlap)
    table = cached_table(dataset, *pipeline.needed, **options)
    protocol = find_protocol(result.data["protocol"])
    n_folds = pipeline.protocol.folds if n_folds is None else n_folds
    splits = protocol.split(table.frame, n_folds, pipeline.seed)
    report = progress or (lambda done, total, what: None)
    total = len(settings.names) + 1
    report(0, total, "baselines")
    entrants, segmentation_s = _ours(result, pipeline, dataset, table, protocol, splits)
    report(1, total, "baselines")
    versions: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="texclass-baselines-") as folder:
        task = Path(folder) / "task"
        lengths = _hand_over(task, settings.signals, dataset, pipeline, table, splits)
        for done, name in enumerate(settings.names, start=2):
            outcome = run_worker(settings.python, task, name, Path(folder) / name, settings.time_limit_s)
            entrants += _theirs(BASELINES[name], outcome, np.unique(table.surfaces))
            versions |= outcome["versions"]
            report(done, total, "baselines")
    notes, benchmark = list[str](), result.data
    if not protocol.is_nested:
        notes.append(
            "ours is prepared on all recordings, test folds included, as the protocol says; no baseline is"
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
                _judged(found, entrants[0], table, protocol, splits, segmentation_s) for found in entrants
            ],
            "signals": DESCRIPTIONS[settings.signals],
            "time_limit_s": settings.time_limit_s,
            "versions": benchmark["versions"],
            "baseline_versions": versions,
            "seed": pipeline.seed,
            "input_hash": benchmark["input_hash"],
            **code_provenance(*COMPUTED_BY, "baselines"),
            "notes": notes,
            "accuracy_unit": "fraction of tests; low and high are the 95 % interval",
        }
    )


def whole_surfaces(dataset: Dataset, limit: int) -> Dataset:
    """Return a dataset of at most `limit` recordings: whole surfaces, spread evenly over the sorted names.

    Raises
    ------
    ValueError
        If not even two surfaces fit.
    """
    names = dataset.surfaces
    for n in range(len(names), 1, -1):
        chosen = {names[i] for i in np.linspace(0, len(names) - 1, n).astype(int)}
        entries = tuple(entry for entry in dataset.entries if entry.surface in chosen)
        if len(entries) > limit:
            continue
        if n == len(names):
            return dataset
        note = f"{n} of the {len(names)} surfaces, spread evenly: fewer surfaces are easier to tell apart"
        name = f"{dataset.name}-{n}of{len(names)}"
        return replace(dataset, name=name, entries=entries, notes=(*dataset.notes, note))
    raise ValueError(f"a limit of {limit} recordings leaves no two surfaces whole. Expected at least two")


def _ours(
    result: BenchmarkResult,
    pipeline: PipelineDefinition,
    dataset: Dataset,
    table: FeatureTable,
    protocol: Protocol,
    splits: Sequence[Split],
) -> tuple[list[Entrant], float]:
    """Return what competes, and the seconds that finding the phases of a recording takes.

    What was chosen inside the training parts, if the benchmark chose; our most accurate row; and the widest
    one, with its most accurate classifier.
    """
    if result.best is None:
        raise ValueError(f"no row of pipeline {pipeline.name} can be evaluated")
    accuracies = {row["name"]: row["accuracy"] for row in result.data["rows"] if row["accuracy"]}
    definitions = {row.name: row for row in pipeline.rows}
    widest = max(accuracies, key=lambda name: len(definitions[name].features))
    judge = max(accuracies[widest], key=lambda name: accuracies[widest][name]["mean"])
    pairs = list(dict.fromkeys((result.best, (widest, judge))))
    chosen = [tuple(pair) for pair in (result.data.get("choice") or {"chosen": ()})["chosen"]]
    measured: dict[tuple[str, str], Entrant] = {}
    for name, judge in dict.fromkeys((*pairs, *chosen)):
        row = MatchedRow.of(definitions[name], pipeline.features, table)
        measured[name, judge] = {
            "name": name, "title": name, "ours": True, "reference": definitions[name].reference,
            "classifier": judge, "status": "done", "message": "", "n_columns": row.n_features,
            **measure_ours(row, judge, pipeline, dataset, table, splits, nested=protocol.is_nested),
        }  # fmt: skip
    entrants = [_chosen([measured[pair] for pair in chosen])] if chosen else []
    entrants += [measured[pair] for pair in pairs]
    return entrants, min(of["segmentation_s"] for of in measured.values())


def _hand_over(
    task: Path,
    given: Given,
    dataset: Dataset,
    pipeline: PipelineDefinition,
    table: FeatureTable,
    splits: Sequence[Split],
) -> tuple[int, ...]:
    """Write signals and folds for the baselines; return how many samples each recording has."""
    entries = {entry.recording_id: entry for entry in dataset.entries}
    ordered = [entries[recording_id] for recording_id in table.frame["recording_id"]]
    first = dataset.load(ordered[0])
    apart, remove_hand_motion = (
        separate_channels(first, pipeline.channels),
        pipeline.features.remove_hand_motion,
    )
    recordings = map(dataset.load, ordered)
    signals = (
        every_channel(r) if given == "each" else same_signals(r, apart, remove_hand_motion=remove_hand_motion)
        for r in recordings
    )
    labels = np.unique(table.surfaces, return_inverse=True)[1]
    return write_task(task, signals, labels, splits, first.fs, pipeline.seed)


def _chosen(measured: Sequence[Mapping[str, Any]]) -> Entrant:
    """Return what was chosen inside the training part of each fold; its costs are means over folds."""
    costs = ("feature_s", "fit_s", "predict_s", "first_s", "memory_mb")
    return {
        **measured[0],
        "name": CHOICE, "title": CHOICE, "reference": "", "classifier": "selected", "n_columns": 0,
        "predicted": tuple(found["predicted"][k] for k, found in enumerate(measured)),
        **{key: float(np.mean([found[key] for found in measured])) for key in costs},
    }  # fmt: skip


def _theirs(baseline: Baseline, outcome: Mapping[str, Any], names: NDArray[np.str_]) -> Iterator[Entrant]:
    """Yield each classifier of a baseline; the baseline itself, if it has predicted nothing."""
    facts = {"name": baseline.name, "title": baseline.title, "ours": False, "reference": baseline.reference}
    facts |= {"status": outcome["status"], "message": outcome["message"]}
    if not outcome["folds"]:
        yield {**facts, "classifier": "", "n_columns": 0, "predicted": ()}
        return
    for classifier in baseline.classifiers:
        ran = [fold["classifiers"][classifier] for fold in outcome["folds"]]
        yield {
            **facts,
            "classifier": classifier,
            "n_columns": outcome["folds"][0]["n_columns"],
            "predicted": tuple(names[fold["predicted"]] for fold in ran),
            "feature_s": np.mean([fold["feature_s"] for fold in outcome["folds"]]),
            "fit_s": np.mean([fold["fit_s"] for fold in ran]),
            "predict_s": np.mean([fold["predict_s"] for fold in ran]),
            "first_s": outcome["first_s"] or 0.0,
            "memory_mb": outcome["folds"][-1]["memory_mb"],
        }


def _judged(
    found: Entrant,
    first: Entrant,
    table: FeatureTable,
    protocol: Protocol,
    splits: Sequence[Split],
    segmentation_s: float,
) -> dict[str, Any]:
    """Return a line of the comparison: its accuracy, its cost, and what the first one is ahead of it."""
    told = ("name", "classifier", "title", "ours", "status", "message", "reference", "n_columns")
    line: dict[str, Any] = {key: found[key] for key in told}
    line |= {"n_folds": len(found["predicted"]), "accuracy": None, "cost": None, "difference": None}
    tests = [test for _, test in splits[: line["n_folds"]]]
    if not tests:
        return line
    n_train, n_test = np.mean([[train.size, test.size] for train, test in splits], axis=0)
    # All read the movements that we found.
    features_s = (n_train + n_test) * (segmentation_s + found["feature_s"])
    line["cost"] = {  # of one fold, from samples to answers, and the parts of that
        "feature_ms": float(1e3 * found["feature_s"]),
        "fit_s": float(found["fit_s"]),
        "predict_ms": float(1e3 * found["predict_s"]),
        "total_s": float(features_s + found["fit_s"] + n_test * found["predict_s"]),
        "memory_mb": found["memory_mb"],
        "first_s": found["first_s"],
    }
    truth, independent = [table.surfaces[test] for test in tests], protocol.independent(table.frame)
    groups = ([of[test] for test in tests] for of in (protocol.clusters(table.frame), independent[1]))
    accuracy = score(truth, found["predicted"], *groups)
    counts = {"n_hits": accuracy.n_hits, "n_tested": accuracy.n_tested}
    line["accuracy"] = counts | accuracy.to_dict(protocol.unit, independent[0])
    if found is not first:
        hits, others = (  # on the folds that both have
            [[t == p for t, p in zip(truth, of["predicted"], strict=False)]] for of in (first, found)
        )
        line["difference"] = compare(hits, others, splits, protocol, independent)
    return line


def _length_notes(lengths: tuple[int, ...]) -> Iterator[str]:
    """Say what equal-length baselines are given, where recordings differ in length."""
    shortest, median, longest = min(lengths), int(np.median(lengths)), max(lengths)
    if shortest < longest:
        short = sum(n < median for n in lengths) / len(lengths)
        yield (
            f"signals have {shortest} to {longest} samples; QUANT and the rockets need one length, the "
            "median (of the training recordings for the rockets, of all for QUANT; here about "
            f"{median}): longer ones lose equal parts at both ends, shorter ones ({short:.0%}) are followed "
            "by zeros, which may tell the baseline how long they were"
        )


def same_signals(
    recording: Recording, apart: tuple[str, ...], *, remove_hand_motion: bool = False
) -> Samples:
    """Return the movement that our features read, one row a channel.

    Where there is no movement, its place is taken by the taps, one after the other; without taps, by the
    whole recording.
    """
    views = views_of(recording, apart)
    prefixes = [f"{name}/" for name in apart] or [""]
    return np.stack([_felt(views[prefix], remove_hand_motion) for prefix in prefixes])


def every_channel(recording: Recording) -> Samples:
    """Return each axis without its mean during the movement, one row an axis."""
    start, stop = find_phases(recording).movement or (0, recording.n_samples)
    parts = (recording.acceleration, recording.turn_rate)
    axes = np.column_stack([part[start:stop] for part in parts if part is not None])
    return np.ascontiguousarray((axes - axes.mean(axis=0)).T)


def _felt(view: Views, remove_hand_motion: bool) -> Samples:
    with suppress(UndefinedFeatureError):
        return (view.vibration if remove_hand_motion else view.movement).samples
    with suppress(UndefinedFeatureError):
        return np.concatenate([part for tap in view.tap.taps for part in (tap.hand, tap.impulse)])
    whole = Phases(movement=(0, view.recording.n_samples))
    return _felt(Views(view.recording, whole, view.channel), remove_hand_motion)
