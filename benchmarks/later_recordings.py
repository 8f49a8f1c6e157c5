"""Statements of model cards compared with later recordings: accuracy, sets, false alarms, probabilities.

`python benchmarks/later_recordings.py [--only DATASET ...]` (more than an hour) writes
reports/studies/later_recordings. `train` with its defaults fits the earlier recordings of each dataset, and
the saved statements are compared with predictions for the later ones. A second part fits the calibration of
models from one recording of each surface.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.metrics import roc_auc_score
from study import command_line, table, write

from texclass.evaluation import cached_table, cluster_interval, cut_windows, decide_axes, load_pipeline
from texclass.evaluation.axes import AxesOption
from texclass.evaluation.cost import CostMeter
from texclass.evaluation.feature_table import FeatureTable, metadata
from texclass.evaluation.pipeline import DEFAULT_PIPELINE, PipelineDefinition
from texclass.evaluation.protocols import find_protocol
from texclass.evaluation.windows import add_overlapping_windows, is_testable, parents
from texclass.loaders import open_dataset
from texclass.loaders.dataset import Dataset
from texclass.phases import find_phases
from texclass.recognition import Model, train
from texclass.recognition.candidates import Candidate, list_candidates, without_selection
from texclass.recognition.held_out_predictions import predict_held_out
from texclass.recognition.holdout import LIMITS
from texclass.recognition.prediction_sets import DEFAULT_LEVELS, TIE_TOLERANCE, log_odds
from texclass.recognition.probabilities import (
    Calibration,
    calibration_error_by_chance,
    expected_calibration_error,
)
from texclass.recording import Recording, Samples
from texclass.reporting import Heading, Table

SEED = 5
FALSE_ALARMS = 0.05
WINDOW_S = {"borealtc": 5.0, "dogsurf": 5.0, "floors10": 5.0}
"""Length of the windows of robots in s; other datasets are classified by recording."""
DATASETS = ("biotac20", "taps5", "floors10", "borealtc", "dogsurf", "simulated")
LAST_EARLY = {"biotac20": 20}
"""Number of earlier recordings of each surface; half of them in other datasets."""
STARTS = {"biotac20": {1: (0, 5, 10, 15), 3: (0, 5, 10)}}
"""Number of training recordings -> first ones; in other datasets the first and the last possible one."""
N_TRAINED = (1, 3, 10)
N_FOLDS = 5
N_CLASSES = (2, 3, 5, 10, 20)
"""Numbers of surfaces for the calibration of models from one recording of each surface."""
N_DRAWS = 4
PRIORS = np.geomspace(1, 20, 61)
"""Candidates for the inverse temperature, divided by the logarithm of the number of surfaces."""
OVERLAPS = (1, 2, 4)
"""Numbers of training windows that start within each window."""
LAPSES = (0.0, 0.01, 0.02, 0.05, 0.1)
N_SILENT = 4
"""Number of recordings of each dataset that are replaced by signals without contact."""
NOISE_LEVELS = (0.001, 0.01, 0.1, 1.0, 10.0)
MIN_GAP = 0.02
"""Smallest mean difference of the two largest decisions; below it, the features distinguish nothing."""
Rows = NDArray[np.intp]


def main() -> None:
    args = command_line(__doc__, only=DATASETS)
    answers, hashes = list[pd.DataFrame](), {}
    priors, silent = list[dict[str, Any]](), list[dict[str, Any]]()
    for name in args.only:
        dataset = open_dataset(name)
        hashes[name] = dataset.input_hash
        tables = features(dataset)
        for split, start, early, later in splits(dataset):
            answers += compare(dataset, tables, split, start, early, later)
            print(name, split, start, flush=True)
        priors += one_recording_decisions(dataset)
        silent += no_contact(dataset)
    statements = summarise(pd.concat(answers, ignore_index=True))
    settings = {"seed": SEED, "input_hash": hashes, "false_alarms": FALSE_ALARMS}
    report(statements, fit_priors(priors), silent, settings, args.out)


def splits(dataset: Dataset) -> Iterator[tuple[str, int, set[str], set[str]]]:
    """Yield the name of a split, its number, and the identifiers of the earlier and the later recordings."""
    frame = dataset.table.reset_index().sort_values(["surface", "repetition"])
    rank = frame.groupby("surface").cumcount()
    half = frame.groupby("surface")["surface"].transform("size") // 2
    if dataset.name in LAST_EARLY:
        half = half * 0 + LAST_EARLY[dataset.name]
    later = set(frame.loc[rank >= half, "recording_id"])
    yield "first half", 0, set(frame.loc[rank < half, "recording_id"]), later
    for n in N_TRAINED:
        last = int(half.min()) - n
        for start in STARTS.get(dataset.name, {}).get(n, sorted({0, last}) if last >= 0 else ()):
            yield str(n), start, set(frame.loc[(rank >= start) & (rank < start + n), "recording_id"]), later
    if dataset.name in WINDOW_S:
        runs = frame.reset_index(drop=True)
        for number, (train_rows, test_rows) in enumerate(find_protocol("grouped").split(runs, N_FOLDS, SEED)):
            ids = runs["recording_id"].to_numpy()
            yield "folds of runs", number, set(ids[train_rows]), set(ids[test_rows])


def compare(
    dataset: Dataset,
    tables: tuple[FeatureTable, ...],
    split: str,
    start: int,
    early: set[str],
    later: set[str],
) -> list[pd.DataFrame]:
    """Return the answers for the later recordings, of models with and without an order in time.

    A second model is trained without a fifth of the surfaces, which are then unknown.
    """
    frame = tables[0].frame
    test = frame[is_testable(frame) & parents(frame).isin(later)]
    part = replace(dataset, entries=tuple(e for e in dataset.entries if e.recording_id in early))
    surfaces = sorted({entry.surface for entry in part.entries})
    rng = np.random.default_rng([SEED, start])
    strange = set(rng.permutation(surfaces)[: max(1, len(surfaces) // 5)])
    known = tuple(entry for entry in part.entries if entry.surface not in strange)
    unordered = tuple(replace(entry, repetition=None) for entry in part.entries)
    case = {"dataset": dataset.name, "split": split, "start": start}
    model = train_on(part, tables)
    results = [answers_of(model, test) | case | {"order": "numbered"}]
    if split.isdigit() and 1 < int(split) < LIMITS.few_recordings:
        model_without = train_on(replace(part, entries=unordered), tables)
        results.append(answers_of(model_without, test) | case | {"order": "unnumbered"})
    restricted = train_on(replace(part, entries=known), tables)
    unknown = answers_of(restricted, test) | case | {"order": "surfaces left out"}
    return [
        pd.DataFrame(one)
        for one in (*results, unknown | {"strange": test["surface"].isin(strange).to_numpy()})
    ]


def default_pipeline(dataset: Dataset) -> PipelineDefinition:
    """Return the default pipeline of `train`, with the channels that it decides for the dataset."""
    pipeline = load_pipeline(DEFAULT_PIPELINE)
    return pipeline.model_copy(update={"channels": decide_axes(dataset, pipeline.channels).channels})


def features(dataset: Dataset) -> tuple[FeatureTable, ...]:
    """Return the features of all recordings, or of their windows, for the default pipeline.

    There is one table of recordings, or one table of windows for each overlap, because `train` reduces the
    overlap if a dataset has many windows.
    """
    pipeline = default_pipeline(dataset)
    if (seconds := WINDOW_S.get(dataset.name)) is None:
        sources = [dataset]
    else:
        with patch("texclass.evaluation.windows.MAX_WINDOWS", math.inf):
            windows = cut_windows(dataset, seconds)
            sources = [add_overlapping_windows(windows, overlap) for overlap in OVERLAPS]
    return tuple(cached_table(one, *pipeline.needed, channels=pipeline.channels) for one in sources)


def train_on(dataset: Dataset, tables: tuple[FeatureTable, ...]) -> Model:
    """Return the model of `train` with its defaults, with features from the tables of the whole dataset."""

    def rows_of(part: Dataset, *_: Any, **__: Any) -> FeatureTable:
        labels = metadata(part.entries).set_index("recording_id")
        # Additional windows are numbered from 1, so the first table that contains all has the same overlap.
        feature_table = next(one for one in tables if labels.index.isin(one.frame["recording_id"]).all())
        frame = feature_table.frame.set_index("recording_id").loc[labels.index]
        frame = frame.assign(repetition=labels["repetition"]).reset_index()
        return replace(feature_table, frame=frame, left_out=())

    # A part of the dataset may lead to another decision than the whole dataset, which the table follows.
    axes: AxesOption = "separate" if any("/" in name for name in tables[0].columns) else "merged"
    with patch("texclass.recognition.training.cached_table", rows_of):
        return train(dataset, window_s=WINDOW_S.get(dataset.name), axes=axes)


def answers_of(model: Model, test: pd.DataFrame) -> dict[str, Any]:
    """Return predictions for the rows of a feature table, and the statements of the model card."""
    X = test[list(model.columns)].to_numpy(dtype=np.float64)
    _, decisions = model.decide(X)
    p, p_known = model.classify(X)
    surfaces, true = np.array(model.surfaces), test["surface"].to_numpy(dtype=str)
    odds, best = log_odds(model.calibration.beta * decisions), p.argmax(axis=1)
    is_true = surfaces == true[:, None]
    accuracy = model.manifest.accuracy
    later = accuracy.get("later_recordings", {})
    answers = {
        "recording": parents(test).to_numpy(dtype=str),
        "hit": surfaces[best] == true,
        "confidence": p.max(axis=1),
        "p_known": p_known,
        "unknown": p_known <= model.novelty.false_alarms,
        "strange": np.zeros(len(test), dtype=bool),
        "n_surfaces": len(surfaces),
        "stated": accuracy.get("mean", np.nan),
        "later_low": later.get("low", np.nan),
        "later_high": later.get("high", np.nan),
        "half": min(later.get("halves", ()), default=np.nan),
    }
    for level in DEFAULT_LEVELS:
        threshold = model.set_calibrations["answer"].threshold(level) - TIE_TOLERANCE
        members = odds >= threshold
        members[np.arange(len(odds)), best] = True
        answers |= {
            f"holds_{100 * level:g}": (members & is_true).any(axis=1),
            f"size_{100 * level:g}": members.sum(axis=1),
        }
    return answers


def summarise(answers: pd.DataFrame) -> list[dict[str, Any]]:
    """Return one row per dataset and split: what the cards state, and what the later recordings show."""
    rows = []
    for (name, split, order), part in answers.groupby(["dataset", "split", "order"], sort=False):
        row: dict[str, Any] = {"dataset": name, "split": split, "order": order}
        if order == "surfaces left out":
            starts = [one for _, one in part.groupby("start") if 0 < one["strange"].mean() < 1]
            row["auroc"] = np.mean([roc_auc_score(one["strange"], -one["p_known"]) for one in starts])
            row["flagged"] = part.loc[part["strange"], "unknown"].mean()
            rows.append(row)
            continue
        found = part.groupby("start")["hit"].mean()
        first = part.groupby("start").first()
        chance = 1 / first["n_surfaces"]
        row |= {
            "n_models": len(found),
            "stated": first["stated"].mean(),
            "found": found.mean(),
            "later_low": first["later_low"].mean(),
            "later_high": first["later_high"].mean(),
            "n_in_range": int(((first["later_low"] <= found) & (found <= first["later_high"])).sum()),
            "kept": ((found - chance) / (first["half"] - chance)).mean(),
            "false_alarms": part["unknown"].mean(),
            "ece": np.mean(
                [
                    expected_calibration_error(one["confidence"], one["hit"])
                    for _, one in part.groupby("start")
                ]
            ),
            "pooled_ece": expected_calibration_error(part["confidence"], part["hit"]),
            "ece_by_chance": np.mean(
                [calibration_error_by_chance(one["confidence"]) for _, one in part.groupby("start")]
            ),
        }
        for level in (f"{100 * level:g}" for level in DEFAULT_LEVELS):
            low, high = cluster_interval(part[f"holds_{level}"].to_numpy(), part["recording"].to_numpy())
            row |= {f"coverage_{level}": part[f"holds_{level}"].mean(), f"low_{level}": low}
            row |= {f"high_{level}": high, f"size_{level}": part[f"size_{level}"].mean()}
        rows.append(row)
    return rows


def one_recording_decisions(dataset: Dataset) -> list[dict[str, Any]]:
    """Return decisions of models from one recording of each of K surfaces for all other recordings.

    Datasets of robots are also divided into windows, with the windows of one run as the training set.
    """
    results = []
    for kind in ("recordings", "windows") if dataset.name in WINDOW_S else ("recordings",):
        whole = kind == "recordings"
        pipeline = default_pipeline(dataset)
        source = (
            dataset
            if whole
            else add_overlapping_windows(cut_windows(dataset, WINDOW_S[dataset.name]), pipeline.overlap)
        )
        features = cached_table(source, *pipeline.needed, channels=pipeline.channels)
        meter = CostMeter.from_dataset(source, features.frame["recording_id"].tolist(), pipeline.channels)
        candidate, *_ = without_selection(list_candidates(pipeline, features, meter))
        frame = features.frame.reset_index(drop=True)
        names = np.unique(frame["surface"])
        for n_classes in (n for n in N_CLASSES if n <= len(names) and (whole or n == len(names))):
            for draw in range(N_DRAWS):
                result = predict_from_one(candidate, frame, n_classes, draw)
                results.append(result | {"dataset": dataset.name, "kind": kind, "n_classes": n_classes})
    return results


def predict_from_one(candidate: Candidate, frame: pd.DataFrame, n_classes: int, draw: int) -> dict[str, Any]:
    """Return decisions and labels of a model from one recording of each of some surfaces."""
    rng = np.random.default_rng([SEED, n_classes, draw])
    names = np.unique(frame["surface"])
    chosen = np.sort(rng.permutation(names)[:n_classes])
    recording = parents(frame)
    trained = [rng.choice(np.unique(recording[frame["surface"] == one])) for one in chosen]
    is_trained, is_chosen = recording.isin(trained).to_numpy(), frame["surface"].isin(chosen).to_numpy()
    test = np.flatnonzero(is_chosen & ~is_trained & is_testable(frame).to_numpy())
    answers = predict_held_out(candidate, frame, [(np.flatnonzero(is_trained), test)])
    columns = np.searchsorted(names, chosen)
    return {
        "decisions": answers.decisions[:, columns],
        "labels": np.searchsorted(columns, answers.labels),
        "n_rows": int(is_trained.sum()),
    }


def no_contact(dataset: Dataset) -> list[dict[str, Any]]:
    """Return how often recordings without contact are unknown, for one training recording per surface."""
    first = {entry.surface: entry for entry in reversed(dataset.entries)}
    last = list({entry.surface: entry for entry in dataset.entries}.values())[:N_SILENT]
    model = train(replace(dataset, entries=tuple(first.values())), window_s=WINDOW_S.get(dataset.name))
    unknown: dict[str, list[bool]] = {}
    for number, entry in enumerate(last):
        recording = dataset.load(entry)
        for kind, changes in silent_signals(recording, np.random.default_rng([SEED, number])):
            answer = model.predict(recording.with_(**changes))
            unknown.setdefault(kind, []).append(answer.unknown)
    contact = {
        "kind": "recordings of trained surfaces",
        "n": len(dataset),
        "unknown": np.mean([model.contact_problem(r, find_phases(r)) != "" for r in dataset]),
    }
    rows = [{"kind": kind, "n": len(values), "unknown": np.mean(values)} for kind, values in unknown.items()]
    return [{"dataset": dataset.name, **row} for row in (*rows, contact)]


def silent_signals(recording: Recording, rng: np.random.Generator) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield kinds of signals without contact, as changes of a recording with its axes and length."""
    signals = {"acceleration": recording.acceleration, "turn_rate": recording.turn_rate}
    signals = {name: signal for name, signal in signals.items() if signal is not None}
    steps = {name: np.diff(np.unique(signal)) for name, signal in signals.items()}
    yield "silence", {name: np.zeros_like(signal) for name, signal in signals.items()}
    yield "constant", {name: signal * 0 + signal[:1] for name, signal in signals.items()}
    yield (
        "quantisation noise",
        {
            name: rng.integers(-1, 2, signal.shape) * steps[name][steps[name] > 0].min()
            for name, signal in signals.items()
        },
    )
    for factor in NOISE_LEVELS:
        yield (
            f"white noise, {factor:g} times the level",
            {
                name: factor * signal.std(axis=0) * rng.standard_normal(signal.shape)
                for name, signal in signals.items()
            },
        )


def fit_priors(results: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the most likely inverse temperature and lapse of all datasets, and without each of them."""
    entry: dict[str, Any] = {}
    for kind in ("recordings", "windows"):
        losses: dict[str, Samples] = {}
        parts = [one for one in results if one["kind"] == kind and gap(one["decisions"]) >= MIN_GAP]
        for name in dict.fromkeys(one["dataset"] for one in parts):
            losses[name] = np.mean([loss(one) for one in parts if one["dataset"] == name], axis=0)
        if len(losses) < 2:
            continue
        entry[kind] = {"all": best_prior(np.mean(list(losses.values()), axis=0)), "datasets": []}
        for name, own in losses.items():
            prior = best_prior(np.mean([losses[other] for other in losses if other != name], axis=0))
            largest = max(one["n_classes"] for one in parts if one["dataset"] == name)
            tested = [one for one in parts if one["dataset"] == name and one["n_classes"] == largest]
            entry[kind]["datasets"].append(
                {"dataset": name, **prior, "own": best_prior(own), **reliability(tested, prior)}
            )
    return entry


def gap(decisions: Samples) -> float:
    """Return the mean difference of the two largest decisions."""
    ordered = np.sort(decisions, axis=1)
    return float((ordered[:, -1] - ordered[:, -2]).mean())


def loss(result: dict[str, Any]) -> Samples:
    """Return the mean negative log likelihood of each lapse (row) and inverse temperature (column)."""
    rows, scale = np.arange(len(result["labels"])), np.log(result["n_classes"])
    p = [
        [Calibration(prior * scale, lapse)(result["decisions"])[rows, result["labels"]] for prior in PRIORS]
        for lapse in LAPSES
    ]
    return -np.log(np.maximum(p, 1e-12)).mean(axis=2)


def best_prior(losses: Samples) -> dict[str, float]:
    lapse, prior = np.unravel_index(np.argmin(losses), losses.shape)
    return {"prior": float(PRIORS[prior]), "lapse": LAPSES[lapse]}


def reliability(results: list[dict[str, Any]], prior: dict[str, float]) -> dict[str, float]:
    """Return accuracy, confidence and calibration error of models with a prior calibration."""
    confidence, hits = list[Samples](), list[NDArray[np.bool_]]()
    for one in results:
        calibration = Calibration(prior["prior"] * float(np.log(one["n_classes"])), prior["lapse"])
        p = calibration(one["decisions"])
        confidence.append(p.max(axis=1))
        hits.append(p.argmax(axis=1) == one["labels"])
    errors = [expected_calibration_error(p, hit) for p, hit in zip(confidence, hits, strict=True)]
    by_chance = [calibration_error_by_chance(p) for p in confidence]
    return {
        "accuracy": float(np.concatenate(hits).mean()),
        "confidence": float(np.concatenate(confidence).mean()),
        "ece": float(np.mean(errors)),
        "ece_by_chance": float(np.mean(by_chance)),
        "pooled_ece": expected_calibration_error(np.concatenate(confidence), np.concatenate(hits)),
    }


def report(
    statements: list[dict[str, Any]],
    priors: dict[str, Any],
    silent: list[dict[str, Any]],
    settings: dict[str, Any],
    out: Any,
) -> None:
    """Write the statements of the model cards, the later recordings, and the prior calibrations."""
    compared = [row for row in statements if row["order"] != "surfaces left out"]
    unknown = {(row["dataset"], row["split"]): row for row in statements if "auroc" in row}
    for row in compared:
        left_out = unknown[row["dataset"], row["split"]]
        row |= {name: left_out[name] for name in ("auroc", "flagged")}
        row["range"] = (
            "none" if np.isnan(row["later_low"]) else f"{row['later_low']:.0%} to {row['later_high']:.0%}"
        )
        row["stated_text"] = "none" if np.isnan(row["stated"]) else f"{row['stated']:.1%}"
    blocks: list[Any] = [
        "`train` with its defaults is trained on the earlier recordings of each surface (numbers: so many "
        "consecutive ones, with several starts), and tested on the later half, or on folds of whole runs. "
        "Robots are tested by windows of 5 s. Unnumbered: the same recordings without repetition numbers. "
        "Intervals: 95 %, over recordings (runs). AUROC and flagged: a fifth of the surfaces is left out of "
        f"the training set; flagged at {FALSE_ALARMS:.0%} stated false alarms. Values are means over models.",
        table(
            compared,
            "dataset = {dataset} | trained on = {split} | order = {order} | models = {n_models} | "
            "stated accuracy = {stated_text} | found = {found:.1%} | stated range = {range} | "
            "in range = {n_in_range} | "
            "90 % sets hold = {coverage_90:.1%} [{low_90:.1%}, {high_90:.1%}] | size = {size_90:.2f} | "
            "95 % sets hold = {coverage_95:.1%} [{low_95:.1%}, {high_95:.1%}] | "
            "size = {size_95:.2f} | false alarms = {false_alarms:.1%} | AUROC = {auroc:.3f} | "
            "flagged = {flagged:.1%} | ECE = {ece:.3f} | ECE, pooled = {pooled_ece:.3f} | "
            "ECE by chance = {ece_by_chance:.3f}",
            n_words=3,
        ),
    ]
    for kind, entry in priors.items():
        blocks += [
            Heading(f"One recording of each surface, {kind}"),
            "Inverse temperature divided by log K, and lapse, with the largest mean likelihood over the "
            "other datasets; accuracy, confidence and calibration error of the left-out dataset with them. "
            f"All datasets: {entry['all']['prior']:.2f}, lapse {entry['all']['lapse']:g}.",
            table(
                entry["datasets"],
                "dataset = {dataset} | prior = {prior:.2f} | lapse = {lapse:g} | "
                "own prior = {own[prior]:.2f} | accuracy = {accuracy:.1%} | confidence = {confidence:.1%} | "
                "ECE = {ece:.3f} | "
                "by chance = {ece_by_chance:.3f} | pooled ECE = {pooled_ece:.3f}",
            ),
        ]
    shares = pd.DataFrame(silent).pivot_table(index="kind", columns="dataset", values="unknown", sort=False)
    blocks += [
        Heading("Recordings without contact"),
        "Share of unknown answers of models from one recording of each surface. The last row contains all "
        "recordings of the trained surfaces, with the share that is reported as without contact.",
        Table(shares.map("{:.1%}".format).reset_index().rename(columns={"kind": "signal"}), n_words=1),
    ]
    result = settings | {"statements": statements, "priors": priors, "no_contact": silent}
    write(out, "later_recordings", result, "Model cards and later recordings", blocks)


if __name__ == "__main__":
    main()
