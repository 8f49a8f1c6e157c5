"""The benchmark: dataset and pipeline in, the table out.

The best of a table is chosen with the tests in view; what it is really worth, `choose_inside` tells.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy.stats import spearmanr
from sklearn.metrics import confusion_matrix

from texclass.evaluation.accuracy import most_frequent, score
from texclass.evaluation.additions import choose_base, measure_additions
from texclass.evaluation.confusion import write_confusion
from texclass.evaluation.cost import CostMeter
from texclass.evaluation.feature_table import FeatureTable, cached_table, metadata
from texclass.evaluation.folds import Evaluation
from texclass.evaluation.pipeline import MatchedRow, PipelineDefinition, load_pipeline
from texclass.evaluation.protocols import (
    Protocol,
    fewest,
    find_protocol,
    require_unseen,
    splits_of,
)
from texclass.evaluation.result import COMPUTED_BY, best_of, example_of, measured_on, pairs_of
from texclass.evaluation.splits import Split, n_starts
from texclass.evaluation.windows import asked, overlapping
from texclass.evaluation.workers import Progress, each
from texclass.features.extractor import Reason
from texclass.loaders import open_dataset
from texclass.loaders.dataset import Dataset
from texclass.provenance import code_provenance, versions
from texclass.reporting.result_files import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from texclass.reporting import Document

LEAST_TRAINED = 2
"""Recordings of each surface that must be left to train on: spread cannot be learnt from one."""


class BenchmarkResult(Result, kind="benchmark"):
    """A pipeline evaluated on a dataset; see `run_benchmark`.

    `data` holds `dataset` (facts and numbers), `pipeline`, `protocol`, `rows` (accuracies by classifier,
    published ones, milliseconds, what is missing), `confusion` of the best row, `gains` (what additions
    add), `choice` (made inside training parts), `example` (a recording and its phases), `left_out`, `flags`,
    `undefined`, and what is needed to do it again.
    """

    def __repr__(self) -> str:
        named = f"{self.data['dataset']['name']}, {self.data['pipeline']['name']}, {self.data['protocol']}"
        if self.best is None:
            return f"<{type(self).__name__}: {named}; no row was computed>"
        mean = 100 * self.table["mean"].max()
        return f"<{type(self).__name__}: {named}; best {mean:.1f} %, {' with '.join(self.best)}>"

    def _repr_html_(self) -> str:
        """Return the table for a notebook."""
        return self.table.to_html(index=False, float_format="{:.3g}".format)

    @property
    def stem(self) -> str:
        """What the names of its files begin with: dataset, pipeline and protocol."""
        protocol = re.sub(r"[^\w.+-]+", "-", self.data["protocol"].replace("->", "to"))
        return f"{self.data['dataset']['name']}-{self.data['pipeline']['name']}-{protocol}"

    @property
    def definitions(self) -> dict[str, tuple[str, str]]:
        """Name and hash of pipeline and feature set."""
        made_with = self.data["pipeline"]
        return {
            "pipeline": (made_with["name"], made_with["hash"]),
            "feature set": (made_with["features"], made_with.get("features_hash", "")),
        }

    @property
    def table(self) -> pd.DataFrame:
        """One line a row and classifier: accuracy with its interval, published accuracy, milliseconds."""
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
            for pair in pairs_of(self.data)
        ]
        return pd.DataFrame(lines)

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write JSON, Markdown, pictures and the confusion matrix (CSV) into a folder."""
        written = super().save(folder)
        if self.data["confusion"] is None:
            return written
        return (*written, self.save_confusion(Path(folder) / f"{self.stem}-confusion.csv"))

    def save_confusion(self, path: str | Path) -> Path:
        """Write the confusion matrix of the best row as CSV, one line per true label.

        Raises
        ------
        ValueError
            If no row was computed.
        """
        found = self.data["confusion"]
        if found is None:
            raise ValueError("cannot write the confusion matrix: no row could be evaluated")
        return write_confusion(path, found["surfaces"], found["surfaces"], found["counts"])

    def document(self) -> "Document":
        """Return the benchmark as a document."""
        from texclass.evaluation.benchmark_document import benchmark_document

        return benchmark_document(self.data)

    def plot(self, classifier: str | None = None, width: float = 8.0) -> "Figure":
        """Draw each row's accuracy beside the published figure.

        Parameters
        ----------
        classifier : str, optional
            Whose; every one by default.
        width : float
            In inches.

        Raises
        ------
        ValueError
            If no row was computed.
        """
        from texclass.evaluation.benchmark_document import draw_rows

        if self.best is None:
            raise ValueError("cannot plot: no row could be evaluated")
        return draw_rows(self.data, [classifier] if classifier else None, width)

    @property
    def best(self) -> tuple[str, str] | None:
        """Row and classifier of the highest accuracy, the first of equals; None if no row was computed."""
        best = best_of(self.data)
        return (best.row["name"], best.classifier) if best else None


def run_benchmark(
    dataset: Dataset | str | Path,
    pipeline: PipelineDefinition | str | Path = "strese2015",
    *,
    protocol: str | None = None,
    n_folds: int | None = None,
    nested_cv: bool = False,
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> BenchmarkResult:
    """Evaluate every row of a pipeline on a dataset.

    Parameters
    ----------
    dataset : Dataset, str or path
        Labelled recordings, or their windows (`cut_windows`), which stay in the fold of their recording and
        vote for it; short windows overlap in the training set where the pipeline asks for it. Or an argument
        of `open_dataset`: a shipped name, a card, or a folder whose files give rate and unit.
    pipeline : PipelineDefinition, str or path
        See `load_pipeline`.
    protocol : str, optional
        A name of `PROTOCOLS`; the pipeline's own by default.
    n_folds : int, optional
        Folds of "recording", "grouped" and "paper"; the pipeline's own by default.
    nested_cv : bool
        Also choose a row and a classifier inside each training part, see `choose_inside`.
    n_jobs : int
        Processes.
    skip_bad : bool
        List bad recordings in the result instead of stopping at the first.
    progress : callable, optional
        Called with (done, total, what).

    Returns
    -------
    BenchmarkResult
        The same for the same dataset, pipeline, protocol and versions, apart from milliseconds.

    Raises
    ------
    RecordingError
        At a bad recording.
    ValueError
        If the protocol cannot split the dataset; the message names value and rule.
    """
    dataset = dataset if isinstance(dataset, Dataset) else open_dataset(dataset)
    pipeline = pipeline if isinstance(pipeline, PipelineDefinition) else load_pipeline(pipeline)
    dataset = dataset.with_phase_settings(pipeline.phase_settings.changes, override=False)
    dataset = overlapping(dataset, pipeline.overlap)
    chosen = find_protocol(protocol or pipeline.protocol.name)
    folds = pipeline.protocol.folds if n_folds is None else n_folds
    # Before the features: a split that is impossible should not cost an extraction.
    facts = metadata(dataset.entries)
    splits = chosen.split(facts, folds, pipeline.seed)
    if nested_cv:
        require_unseen(chosen)
        if sum(len(row.judged_by(pipeline.classifiers)) for row in pipeline.rows) > 1:
            inner_splits(chosen, facts, splits, pipeline.seed)
    work: dict[str, Any] = {"n_jobs": n_jobs, "progress": progress}
    table = cached_table(dataset, *pipeline.needed, channels=pipeline.channels, skip_bad=skip_bad, **work)
    splits = chosen.split(table.frame, folds, pipeline.seed)
    rows = [MatchedRow.of(row, pipeline.features, table) for row in pipeline.rows]
    meter = CostMeter.on(dataset, table.frame["recording_id"].tolist(), pipeline.channels)
    evaluations = _evaluate(rows, table, splits, pipeline, chosen, **work)
    choice = choose_inside(rows, table, splits, pipeline, chosen, evaluations, **work) if nested_cv else None
    base = choose_base(pipeline, rows, evaluations) if pipeline.additions else None
    units = (chosen.unit, chosen.independent(table.frame)[0])
    lines = [_line(row, pipeline, meter, evaluations.get(row.definition.name, {}), units) for row in rows]
    agreement = {name: rank_agreement(lines, name) for name in pipeline.classifiers}
    frame = table.frame
    tested = "windows" if "parent" in frame else "recordings"
    return BenchmarkResult(
        {
            "dataset": measured_on(dataset, frame, meter.recordings[0]),
            "example": example_of(meter.recordings[0]),
            "pipeline": {
                "name": pipeline.name,
                "hash": pipeline.hash,
                "features": pipeline.features.name,
                "features_hash": pipeline.features.hash,
            },
            "movement": pipeline.features.movement,
            "protocol": chosen.name,
            "protocol_description": chosen.description,
            "n_folds": len(splits),
            **({"n_starts": starts} if (starts := n_starts(splits)) else {}),
            "accuracy_unit": f"fraction of {tested}; low and high are the 95 % interval by `interval`",
            "rows": lines,
            "segmentation_ms": meter.segmentation_ms,
            "published_on": pipeline.published_on and pipeline.published_on.model_dump(),
            "rank_agreement": {name: found and found[0] for name, found in agreement.items()},
            "rank_agreement_interval": {name: found and found[1] for name, found in agreement.items()},
            "confusion": _confusion(lines, evaluations, dataset.surfaces),
            "gains": base and measure_additions(pipeline, table, base, chosen, folds, meter, **work),
            "choice": choice,
            "left_out": [list(item) for item in table.left_out],
            "flags": [list(item) for item in table.flags],
            "undefined": _undefined(table),
            "versions": versions(
                "numpy", "scipy", "scikit-learn", "pandas", "PyWavelets", "librosa", "joblib"
            ),
            "seed": pipeline.seed,
            "input_hash": dataset.input_hash,
            **code_provenance(*COMPUTED_BY),
        }
    )


def _evaluate(
    rows: Sequence[MatchedRow],
    table: FeatureTable,
    splits: Any,
    pipeline: PipelineDefinition,
    protocol: Protocol,
    **work: Any,
) -> dict[str, dict[str, Evaluation]]:
    """Evaluate every computable row with every classifier: row name -> classifier -> evaluation."""
    options = {
        "nested": protocol.is_nested,
        "clusters": protocol.clusters(table.frame),
        "independent": protocol.independent(table.frame)[1],
    }
    single = min(fewest(protocol, table.frame.iloc[train]) for train, _ in splits) < LEAST_TRAINED
    tasks, calls = [], []
    for row in rows:
        judges = row.definition.judged_by(pipeline.classifiers) if row.columns else ()
        # A row that selects does so for each classifier; each by itself may refuse single recordings.
        apart = single or row.definition.select is not None
        for names in [(name,) for name in judges] if apart else filter(None, [judges]):
            trial = partial(pipeline.trials(row, names, table), splits, **options)
            calls.append(partial(_unless_too_few, trial) if single else trial)
            tasks.append((row.definition.name, names))
    evaluations: dict[str, dict[str, Evaluation]] = {}
    # Other processes would take up to 2 s of CPU time to load scikit-learn.
    found = each(calls, what="rows", total=len(calls), here_s=2.0, **work)
    for (row_name, names), answers in zip(tasks, found, strict=True):
        if answers:
            evaluations.setdefault(row_name, {}).update(zip(names, answers, strict=True))
    return evaluations


def _undefined(table: FeatureTable) -> list[Any]:
    """Return for each undefined feature the commonest reason, and the number of recordings."""
    tested = table.frame["recording_id"][asked(table.frame)]
    reasons = pd.DataFrame(table.reasons, columns=Reason._fields)
    by_feature = reasons[reasons["recording_id"].isin(tested)].groupby("feature", sort=False)["reason"]
    undefined = by_feature.agg(reason=most_frequent, n_recordings="size")
    return undefined.reset_index().to_dict("records")


def _unless_too_few(trial: Callable[[], list[Evaluation]]) -> list[Evaluation]:
    """Return evaluations; none if a classifier or selection refuses single recordings of a surface."""
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
    """Return a line of the table; published figures as fractions."""
    # Of the whole pool, where columns are selected.
    features = pipeline.features.restricted_to(row.definition.features)
    shares = {name: zip(row.columns, e.support.tolist(), strict=True) for name, e in evaluations.items()}
    selects = row.definition.select is not None
    too_few = "single recordings are too few for its classifiers" if row.columns and not evaluations else None
    return {
        "name": row.definition.name,
        "n_features": row.n_features,
        "accuracy": {name: e.accuracy.to_dict(*units) for name, e in evaluations.items()},
        "paper": {name: value / 100 for name, value in row.definition.published.items()},
        "ms_per_recording": meter.milliseconds(features) if row.columns else None,
        "missing": too_few or row.missing,
        "selected": {name: {c: s for c, s in pairs if s > 0} for name, pairs in shares.items() if selects},
        "reference": row.definition.reference,
        **({"note": row.definition.note} if row.definition.note else {}),
    }


def rank_agreement(
    lines: Sequence[Mapping[str, Any]], classifier: str
) -> tuple[float, tuple[float, float] | None] | None:
    """Return Spearman's correlation of our accuracies with the published ones, and its 95 % interval.

    tanh(atanh(r) -+ 1.96 sqrt((1 + r^2/2)/(n - 3))) over n rows. None with fewer than three rows; no interval
    with fewer than four, or of a perfect agreement.

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


def _confusion(
    lines: Sequence[Mapping[str, Any]],
    evaluations: Mapping[str, Mapping[str, Evaluation]],
    surfaces: Sequence[str],
) -> dict[str, Any] | None:
    """Return who is taken for whom by the row and classifier with the highest accuracy."""
    best = best_of({"rows": lines})
    if best is None:
        return None
    row, name = best.row["name"], best.classifier
    found = evaluations[row][name]
    truth, predicted = np.concatenate(found.truth), np.concatenate(found.predicted)
    counts = confusion_matrix(truth, predicted, labels=list(surfaces)).tolist()
    return {"row": row, "classifier": name, "surfaces": list(surfaces), "counts": counts}


def choose_inside(
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
    """Choose for each fold the row and classifier that do best within its training part.

    Parameters
    ----------
    rows, table, splits, pipeline, protocol
        What the benchmark evaluated.
    evaluations
        Row -> classifier -> predictions of the test parts, fold after fold.
    n_jobs : int
        Processes.
    progress : callable, optional
        Called with (done, total, what).

    Returns
    -------
    dict or None
        As JSON: the `accuracy` of the chosen rows and classifiers on the test parts, which had no say; row
        and classifier `chosen` in each fold; the `protocols` that split the training parts, none where
        there is nothing to choose. None where no row could be computed. Of rows that do equally well within a
        training part, as few recordings often leave them, the one that reads the most columns is chosen; of
        such, the first.

    Raises
    ------
    ValueError
        As `inner_splits`.
    """
    pairs = [(row, name) for row in rows for name in evaluations.get(row.definition.name, ())]
    if not pairs:
        return None
    require_unseen(protocol)
    if len(pairs) == 1:  # the choice is made before any recording is seen, of one a surface, too
        ((row, name),) = pairs
        known = evaluations[row.definition.name][name].accuracy
        chosen = [[row.definition.name, name]] * len(splits)
        units = protocol.unit, protocol.independent(table.frame)[0]
        return {"accuracy": known.to_dict(*units), "chosen": chosen, "protocols": []}
    inner = inner_splits(protocol, table.frame, splits, pipeline.seed)
    y, clusters = table.surfaces, protocol.clusters(table.frame)
    over, independent = protocol.independent(table.frame)
    trials = [pipeline.trial(row, name, table) for row, name in pairs]
    calls = [
        partial(trial, [(train[a], train[b]) for a, b in found])
        for (train, _), (_, found) in zip(splits, inner, strict=True)
        for trial in trials
    ]
    reported: dict[str, Any] = {"progress": progress, "what": "choices", "total": len(calls)}
    hits = [e.accuracy.n_hits for e in each(calls, n_jobs=n_jobs, **reported)]
    # Less than one recording, so that it only parts equals.
    wider = np.array([row.n_features for row, _ in pairs]) / (1 + sum(row.n_features for row, _ in pairs))
    best = (np.reshape(hits, (len(splits), len(pairs))) + wider).argmax(axis=1)
    chosen = [[pairs[k][0].definition.name, pairs[k][1]] for k in best]
    predicted = [evaluations[row][name].predicted[k] for k, (row, name) in enumerate(chosen)]
    truth, *tested = ([of[test] for _, test in splits] for of in (y, clusters, independent))
    return {
        "accuracy": score(truth, predicted, *tested).to_dict(protocol.unit, over),
        "chosen": chosen,
        "protocols": list(dict.fromkeys(name for name, _ in inner)),
    }


def inner_splits(
    protocol: Protocol, table: pd.DataFrame, splits: Sequence[Split], seed: int
) -> list[tuple[str, tuple[Split, ...]]]:
    """Return how each training part is split to choose within it, with the name of that protocol.

    As the whole is, where that is possible; else into stratified folds over recordings (three repetitions are
    too few for `few-shot` again, and one operator alone cannot be left out).

    Raises
    ------
    ValueError
        If the protocol lets preparation see the test parts, or a training part cannot be split.
    """
    require_unseen(protocol)
    return [_split_again(protocol, table.iloc[train].reset_index(drop=True), seed) for train, _ in splits]


def _split_again(protocol: Protocol, part: pd.DataFrame, seed: int) -> tuple[str, tuple[Split, ...]]:
    for tried in dict.fromkeys((protocol.name, "recording")):
        way = find_protocol(tried)
        try:
            found = splits_of(way, part, seed)
            least = min(fewest(way, part.iloc[train]) for train, _ in found)
            if least >= LEAST_TRAINED:
                return tried, found
            problem = f"{least} {way.unit} of a surface would train. Expected at least {LEAST_TRAINED}"
        except ValueError as error:
            problem = str(error)
    raise ValueError(f"a training part cannot be split again to choose within it: {problem}")
