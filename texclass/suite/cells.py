"""Evaluate one method on one dataset: features once, then every declared protocol with the same windows."""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from texclass.atomic_write import write_atomic
from texclass.evaluation.axes import decide_axes
from texclass.evaluation.cost import CostMeter
from texclass.evaluation.feature_table import cached_table, metadata
from texclass.evaluation.result_facts import CODE_DEPENDENCIES
from texclass.evaluation.windows import Window, add_overlapping_windows, cut_windows
from texclass.loaders import open_dataset
from texclass.loaders.cards import DeclaredProtocol, read_card
from texclass.loaders.dataset import Dataset
from texclass.provenance import code_hash, versions
from texclass.recognition.candidates import list_candidates
from texclass.recognition.novelty import score_kind
from texclass.recording import Samples
from texclass.suite.baseline_features import compute_features
from texclass.suite.fold_scores import Choice, evaluate_fold, unknown_groups
from texclass.suite.methods import Method
from texclass.suite.stored_folds import StoredFolds, load_folds

CODE_OF = (*CODE_DEPENDENCIES, "recognition", "baselines", "suite")
"""Subpackages whose code determines the results of the suite."""
LIBRARIES = ("numpy", "scipy", "scikit-learn", "PyWavelets", "librosa")
COLUMNS = (
    "dataset", "question", "protocol", "window_s", "method", "title", "fold", "choice",
    "accuracy", "balanced_accuracy", "macro_f1", "auroc_unknown", "ece", "coverage", "set_size", "ms", "kb",
    "n_surfaces", "chance", "n_train", "n_test", "unit", "n_units", "unit_hits",
    "status", "message", "is_simulated", "licence", "dataset_hash", "folds_hash", "units_hash", "method_hash",
    "code_hash", "versions", "author",
)  # fmt: skip
"""Columns of the table: one row per fold, or one row without scores for a failure."""


@dataclass(frozen=True)
class SuiteSettings:
    """Settings of a run of the suite.

    Attributes
    ----------
    folder
        Folder of stored folds and finished cells.
    baselines_python
        Interpreter with the packages of the baselines.
    time_limit_s
        Time limit of the features of a baseline on one dataset in s of wall-clock time.
    """

    folder: Path
    baselines_python: Path
    time_limit_s: float = 1800.0


@dataclass(frozen=True)
class Cell:
    """One method on one dataset, under declared protocols with the same windows.

    Attributes
    ----------
    card
        Name of a shipped card, or path of a card.
    protocols
        Declared protocols with the same `window_s` and `max_windows`.
    method
        Method.
    """

    card: str
    protocols: tuple[DeclaredProtocol, ...]
    method: Method

    @property
    def dataset_name(self) -> str:
        """Name of the dataset."""
        return Path(self.card).stem

    def path(self, protocol: DeclaredProtocol, folder: Path) -> Path:
        """Return the file of a finished protocol."""
        return folder / "cells" / self.dataset_name / f"{slug(protocol)}--{slug_text(self.method.name)}.csv"


def slug_text(text: str) -> str:
    """Return a text as part of a file name, with a short digest if characters were replaced."""
    plain = "".join(c if c.isalnum() or c in "+_." else "-" for c in text)
    return plain if plain == text else f"{plain[:60]}-{hashlib.sha256(text.encode()).hexdigest()[:6]}"


def slug(protocol: DeclaredProtocol) -> str:
    """Return question, protocol and window length as part of a file name."""
    window = f" {protocol.window_s:g}s" if protocol.window_s else ""
    return slug_text(f"{protocol.question} {protocol.protocol}{window}".replace(" ", "-"))


@cache
def suite_code_hash() -> str:
    """Return the hash of the code that determines the results."""
    return code_hash(*CODE_OF, words=False)


def evaluate_cell(cell: Cell, settings: SuiteSettings) -> list[Path]:
    """Evaluate the protocols of a cell that are not finished, and write one CSV file for each.

    Parameters
    ----------
    cell : Cell
        Dataset, protocols and method.
    settings : SuiteSettings
        Settings of the run.

    Returns
    -------
    list of Path
        CSV files of all protocols of the cell. If the method fails, its file contains one row with the
        message.
    """
    paths = [cell.path(protocol, settings.folder) for protocol in cell.protocols]
    dataset = prepare_dataset(cell.card, cell.protocols[0])
    is_finished = [is_current(path, cell.method, dataset) for path in paths]
    if all(is_finished):
        return paths
    folds: dict[int, StoredFolds] = {}
    failures: dict[int, str] = {}
    frame = metadata(dataset.entries)
    for k, protocol in enumerate(cell.protocols):
        path = settings.folder / "folds" / cell.dataset_name / f"{slug(protocol)}.json"
        if not is_finished[k]:
            try:
                folds[k] = load_folds(frame, protocol.protocol, protocol.folds, path)
            except ValueError as error:
                failures[k] = str(error)
    evaluate = _evaluate_baseline if cell.method.is_baseline else _evaluate_pipeline
    results: dict[int, list[dict[str, Any]]] = {}
    software = versions(*LIBRARIES)
    try:
        if folds:
            results, more_versions = evaluate(cell.method, dataset, folds, settings)
            software |= more_versions
    except Exception as error:  # a failure is a result of the suite, and must not stop the other cells
        failures |= dict.fromkeys(folds, f"{type(error).__name__}: {error}")
    facts = _facts(cell, dataset, software)
    for k, protocol in enumerate(cell.protocols):
        if not is_finished[k]:
            lines = results.get(k) or [{"status": "failed", "message": failures.get(k, "no result")}]
            lines = [facts | _protocol_facts(protocol, folds.get(k)) | line for line in lines]
            write_atomic(paths[k], pd.DataFrame(lines).reindex(columns=list(COLUMNS)).to_csv(index=False))
    return paths


def prepare_dataset(card: str, protocol: DeclaredProtocol) -> Dataset:
    """Return the recordings or windows of a dataset, without copies and without unusable recordings."""
    dataset = open_dataset(card)
    copies = {entry.recording_id for group in dataset.copies for entry in group[1:]}
    entries = tuple(entry for entry in dataset.entries if entry.recording_id not in copies)
    dataset = replace(dataset, entries=entries, copies=())
    if protocol.window_s is None:
        return dataset
    windows = cut_windows(dataset, protocol.window_s, per_recording=protocol.max_windows)
    usable = tuple(e for e in windows.entries if not (isinstance(e, Window) and e.problem))
    return replace(windows, entries=usable)


def is_current(path: Path, method: Method, dataset: Dataset) -> bool:
    """Return whether a cell was finished without failure by the same code, method and dataset."""
    try:
        first = pd.read_csv(path, nrows=1, dtype=str).iloc[0]
    except (OSError, ValueError, IndexError):
        return False
    expected = {
        "status": "done",
        "code_hash": suite_code_hash(),
        "method_hash": method.hash,
        "dataset_hash": dataset.input_hash[:16],
    }
    return all(first.get(key) == value for key, value in expected.items())


def _facts(cell: Cell, dataset: Dataset, software: Mapping[str, str]) -> dict[str, Any]:
    return {
        "dataset": cell.dataset_name,
        "method": cell.method.name,
        "title": cell.method.title,
        "is_simulated": read_card(cell.card).format in ("simulated", "hatt-models"),
        "licence": dataset.licence,
        "dataset_hash": dataset.input_hash[:16],
        "method_hash": cell.method.hash,
        "code_hash": suite_code_hash(),
        "versions": "; ".join(f"{name} {version}" for name, version in software.items()),
        "author": cell.method.author,
        "n_surfaces": len(dataset.surfaces),
        "status": "done",
    }


def _protocol_facts(protocol: DeclaredProtocol, folds: StoredFolds | None) -> dict[str, Any]:
    facts: dict[str, Any] = {
        "question": protocol.question,
        "protocol": protocol.protocol,
        "window_s": protocol.window_s,
    }
    if folds is not None:
        counts = folds.frame["surface"].iloc[folds.tests].value_counts()
        facts |= {
            "folds_hash": folds.hash,
            "unit": folds.units[0],
            "n_units": len(folds.tested_units),
            "units_hash": hashlib.sha256("\n".join(folds.tested_units).encode()).hexdigest()[:16],
            "chance": float(counts.max() / counts.sum()),
        }
    return facts


def _score_folds(
    folds: StoredFolds,
    table: pd.DataFrame,
    X_of: Callable[[int], Samples | None],
    choices_of: Callable[[int], Sequence[Choice]],
    ms_of: Callable[[Choice], float],
) -> Iterator[dict[str, Any]]:
    """Yield the scores of each fold, up to the first fold without features."""
    _, units = folds.units
    for k, split in enumerate(folds.splits_of(table)):
        if (X := X_of(k)) is None:
            return
        unknown = unknown_groups(np.unique(table["surface"].to_numpy(dtype=str)), k, len(folds.splits))
        inner = folds.inner(table, split)
        scores, hits = evaluate_fold(choices_of(k), X, table, split, inner, unknown, ms_of)
        numbers = np.searchsorted(folds.tested_units, units[folds.splits[k][1]])
        sums = pd.Series(hits.astype(int)).groupby(numbers).agg(["sum", "size"])
        unit_hits = " ".join(f"{number}:{a}/{n}" for number, a, n in sums.itertuples())
        yield {"fold": k, **scores, "unit_hits": unit_hits}


def _evaluate_pipeline(
    method: Method, dataset: Dataset, folds: Mapping[int, StoredFolds], settings: SuiteSettings
) -> tuple[dict[int, list[dict[str, Any]]], dict[str, str]]:
    """Return the scores of each protocol of a pipeline of texclass."""
    definition = method.pipeline
    assert definition is not None
    channels, _ = decide_axes(dataset, definition.channels)
    definition = definition.model_copy(update={"channels": channels})
    dataset = dataset.with_phase_settings(definition.phase_settings.changes, override=False)
    table = cached_table(
        add_overlapping_windows(dataset, definition.overlap), *definition.needed, channels=channels
    )
    ids = next(iter(folds.values())).frame["recording_id"].tolist()
    meter = CostMeter.from_dataset(dataset, ids, channels)
    index = {column: i for i, column in enumerate(table.columns)}
    candidates = list_candidates(definition, table, meter)
    choices = [
        Choice(
            str(candidate),
            np.array([index[column] for column in candidate.plan.columns]),
            candidate.preparation,
            candidate.classifier,
            score_kind(candidate.classifier),
        )
        for candidate in candidates
    ]
    plans = {str(candidate): candidate.plan for candidate in candidates}

    @cache
    def feature_ms(name: str) -> float:
        return meter.segmentation_ms + meter.measure(plans[name])[0]

    X = table.select(table.columns)
    results = {
        k: list(
            _score_folds(
                one, table.frame, lambda fold: X, lambda fold: choices, lambda choice: feature_ms(choice.name)
            )
        )
        for k, one in folds.items()
    }
    return results, {}


def _evaluate_baseline(
    method: Method, dataset: Dataset, folds: Mapping[int, StoredFolds], settings: SuiteSettings
) -> tuple[dict[int, list[dict[str, Any]]], dict[str, str]]:
    """Return the scores of each protocol of a baseline, and the versions of its packages."""
    baseline = method.baseline
    assert baseline is not None
    frame = next(iter(folds.values())).frame
    meter = CostMeter.from_dataset(dataset, frame["recording_id"].tolist(), "all")
    splits = list(chain.from_iterable(one.splits for one in folds.values()))
    settings.folder.mkdir(parents=True, exist_ok=True)
    results: dict[int, list[dict[str, Any]]] = {}
    with TemporaryDirectory(prefix="features-", dir=settings.folder) as scratch:
        computed = compute_features(
            baseline, dataset, frame, splits, Path(scratch), settings.baselines_python, settings.time_limit_s
        )
        first = 0
        for k, one in folds.items():
            lines = list(
                _score_folds(
                    one,
                    frame,
                    partial(computed.matrix, first=first),
                    partial(computed.choices, first=first),
                    lambda choice: meter.segmentation_ms + computed.ms,
                )
            )
            for line in lines:
                line["kb"] += computed.kb
            if len(lines) < len(one.splits):
                n = f"{len(lines)} of {len(one.splits)} folds"
                lines = [{"status": "failed", "message": f"{computed.message} ({n})"}]
            results[k] = lines
            first += len(one.splits)
    return results, computed.versions
