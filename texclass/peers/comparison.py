"""Our rows and peers on the same folds: accuracy, cost, paired difference."""

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from texclass.experiment.feature_table import FeatureTable, cached_table
from texclass.experiment.pipeline import MatchedRow, PipelineDefinition
from texclass.experiment.protocols import Protocol, find_protocol
from texclass.experiment.result import BenchmarkResult
from texclass.experiment.workers import Progress
from texclass.loaders.dataset import Dataset
from texclass.peers.bench import Bench
from texclass.peers.launch import run_worker
from texclass.peers.ours import Candidate
from texclass.peers.peer_worker.registry import PEERS
from texclass.peers.result import PeerComparison
from texclass.peers.signals import DESCRIPTIONS, Given


@dataclass(frozen=True)
class PeerSettings:
    """How peers are run.

    Attributes
    ----------
    names
        Which, in this order; all of them by default.
    python
        The interpreter that has them.
    time_limit_s
        Wall-clock seconds for each.
    signals
        What they are given: "same" or "each", see `texclass.peers.signals.DESCRIPTIONS`.

    Raises
    ------
    ValueError
        If there is no such peer or signal, or the limit is not above 0.
    """

    names: tuple[str, ...] = tuple(PEERS)
    python: Path = Path(sys.executable)
    time_limit_s: float = 900.0
    signals: Given = "same"

    def __post_init__(self) -> None:
        if unknown := [name for name in self.names if name not in PEERS]:
            raise ValueError(f"no peer is named {unknown[0]!r}; the peers are {', '.join(PEERS)}")
        if self.signals not in DESCRIPTIONS:
            raise ValueError(f"signals of peers are {self.signals!r}; the rule is 'same' or 'each'")
        if not self.time_limit_s > 0:
            raise ValueError(f"the time limit of peers is {self.time_limit_s} s; the rule is above 0")


def compare_with_peers(
    dataset: Dataset,
    pipeline: PipelineDefinition,
    result: BenchmarkResult,
    settings: PeerSettings | None = None,
    *,
    n_folds: int | None = None,
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> PeerComparison:
    """Evaluate peers on the folds of a benchmark, and time our rows with the same clock.

    Of ours, the most accurate row of the table competes, and the one with the most features. Each contestant
    runs alone in a process of its own with one thread; peers run in another interpreter, if one is given, and
    get signals and folds as files. Whatever learns is fitted on the training part of each fold.

    Parameters
    ----------
    dataset, pipeline, n_folds, n_jobs, skip_bad, progress
        As in `run_benchmark`.
    result : BenchmarkResult
        What `run_benchmark` returned for them; names the protocol and our best row.
    settings : PeerSettings, optional
        Which peers, in which interpreter, for how long.

    Returns
    -------
    PeerComparison

    Raises
    ------
    ValueError
        If no row of ours could be computed, or the interpreter cannot be run.
    """
    settings = settings or PeerSettings()
    options = {"channels": pipeline.channels, "n_jobs": n_jobs, "skip_bad": skip_bad}
    table = cached_table(dataset, *pipeline.needed, **options)
    protocol = find_protocol(result.protocol)
    folds = protocol.split(
        table.frame, pipeline.protocol.folds if n_folds is None else n_folds, pipeline.seed
    )
    bench = Bench(dataset, pipeline, table, protocol, folds)
    report = progress or (lambda done, total, what: None)
    total = len(settings.names) + 1
    report(0, total, "peers")
    contestants = [bench.ours(candidate) for candidate in _candidates(result, pipeline, table)]
    report(1, total, "peers")
    versions: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="texclass-peers-") as folder:
        task = Path(folder) / "task"
        lengths = bench.write(task, settings.signals)
        for done, name in enumerate(settings.names, start=2):
            outcome = run_worker(settings.python, task, name, Path(folder) / name, settings.time_limit_s)
            contestants += bench.theirs(PEERS[name], outcome)
            versions |= outcome.versions
            report(done, total, "peers")
    return PeerComparison(
        dataset=dict(result.dataset) | {"n_tests": sum(test.size for _, test in folds)},
        pipeline=result.pipeline,
        pipeline_hash=result.pipeline_hash,
        protocol=protocol.name,
        protocol_description=protocol.description,
        n_folds=len(folds),
        contestants=bench.paired(contestants),
        signals=DESCRIPTIONS[settings.signals],
        time_limit_s=settings.time_limit_s,
        versions=result.versions,
        peer_versions=versions,
        seed=pipeline.seed,
        input_hash=result.input_hash,
        notes=(*_notes(result, protocol), *_length_notes(lengths)),
    )


def whole_materials(dataset: Dataset, limit: int) -> Dataset:
    """Return a dataset of at most `limit` recordings: whole materials, spread evenly over the sorted names.

    Raises
    ------
    ValueError
        If not even two materials fit.
    """
    names = dataset.materials
    for n in range(len(names), 1, -1):
        chosen = {names[i] for i in np.linspace(0, len(names) - 1, n).astype(int)}
        entries = tuple(entry for entry in dataset.entries if entry.material in chosen)
        if len(entries) > limit:
            continue
        if n == len(names):
            return dataset
        note = f"{n} of the {len(names)} materials, spread evenly: fewer materials are easier to tell apart"
        name = f"{dataset.name}-{n}of{len(names)}"
        return replace(dataset, name=name, entries=entries, notes=(*dataset.notes, note))
    raise ValueError(f"a limit of {limit} recordings leaves no two materials whole; the rule is at least two")


def _candidates(
    result: BenchmarkResult, pipeline: PipelineDefinition, table: FeatureTable
) -> list[Candidate]:
    """Return our most accurate row and the widest one, each with its most accurate classifier."""
    computed = [row for row in result.rows if row.accuracy]
    if result.best is None:
        raise ValueError(f"no row of pipeline {pipeline.name} can be computed; the rule is at least one")
    definitions = {row.name: row for row in pipeline.rows}
    widest = max(computed, key=lambda row: len(definitions[row.name].features))
    judge = max(widest.accuracy, key=lambda name: widest.accuracy[name].mean)
    pairs = dict.fromkeys(((result.best[0].name, result.best[1]), (widest.name, judge)))
    return [
        Candidate(MatchedRow.of(definitions[row], pipeline.features, table), classifier)
        for row, classifier in pairs
    ]


def _length_notes(lengths: tuple[int, ...]) -> Iterator[str]:
    """Say what equal-length peers are given, where recordings differ in length."""
    shortest, median, longest = min(lengths), int(np.median(lengths)), max(lengths)
    if shortest < longest:
        short = sum(n < median for n in lengths) / len(lengths)
        yield (
            f"signals have {shortest} to {longest} samples; QUANT and the rockets need one length, the "
            "median (of the training recordings for the rockets, of all for QUANT; here about "
            f"{median}): longer ones lose equal parts at both ends, shorter ones ({short:.0%}) are followed "
            "by zeros, which may tell the peer how long they were"
        )


def _notes(result: BenchmarkResult, protocol: Protocol) -> Iterator[str]:
    if sum(len(row.accuracy) for row in result.rows) > 1:
        yield (
            "our first row is the most accurate of our table on these very test folds, so its figure is a "
            "little too high; so is that of the best peer, for the same reason"
        )
    if not protocol.nested:
        yield "ours is prepared on all recordings, test folds included, as the protocol says; peers never are"
