"""Drift over time: how often it is reported, and what `predict --adapt` recovers without labels.

`python benchmarks/drift_study.py [--only NUMBER ...]` (an hour) writes reports/studies/drift.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
from later_recordings import default_pipeline
from sensor_adaptation import changed
from sklearn.metrics import roc_auc_score
from study import command_line, table, write

from texclass.evaluation import cached_table, cluster_interval, cut_windows
from texclass.evaluation.windows import parents
from texclass.loaders import open_dataset
from texclass.loaders.dataset import Dataset
from texclass.recognition import Answer, FeatureRow, Model, adapt_to_answers, detect_drift, train
from texclass.recognition.drift import SIGNIFICANCE, valid_rows
from texclass.recognition.novelty import novelty_scores
from texclass.recognition.prediction_sets import DEFAULT_LEVELS
from texclass.reporting import Heading

SEED = 11
N_BATCHES, BATCH_SHARE = 20, 0.5
"""Number of random batches of each test set in which drift is tested, and their share of its recordings."""
WINDOW_S = {"biotac20": None, "floors10": 5.0, "borealtc": 5.0, "dogsurf": 5.0}
N_UNKNOWN = {"biotac20": 2, "floors10": 2, "borealtc": 1, "dogsurf": 1}
"""Number of surfaces that are left out of training to measure the detection of unknown surfaces."""


@dataclass(frozen=True)
class Case:
    """A training set and later recordings, or other recordings of the same time.

    Attributes
    ----------
    dataset : str
        Name of the dataset.
    name : str
        Description.
    has_drift : bool
        Whether the sensor may have changed between training set and test set.
    trained : sequence of (int, int)
        First and last repetition of the training set of each draw; for a single pair, each draw trains on
        random halves of the recordings of each surface, and tests on the other halves.
    change : str
        Change of the signals in the test set, as in the study `sensor_adaptation`.
    """

    dataset: str
    name: str
    has_drift: bool
    trained: Sequence[tuple[int, int]] = ()
    change: str = "none"


CASES = (
    Case("biotac20", "repetitions 1-20, later: 21-40", True, [(1, 20)]),
    Case("biotac20", "three repetitions (1-3, 6-8, 11-13), later: 21-40", True, [(1, 3), (6, 8), (11, 13)]),
    Case("biotac20", "one repetition (1, 6, 11), later: 21-40", True, [(1, 1), (6, 6), (11, 11)]),
    Case("biotac20", "repetitions 1-20, later: 21-40 after a low-pass filter", True, [(1, 20)], "low-pass"),
    Case("floors10", "first half of the drives, later: second half", True, [(1, 0)]),
    Case("borealtc", "random half of the runs, others after a low-pass filter", True, change="low-pass"),
    Case("biotac20", "random half of repetitions 1-20, others", False),
    Case("floors10", "random half of the first half of the drives, others", False),
    Case("borealtc", "random half of the runs, others", False),
    Case("dogsurf", "random half of the runs, others after a low-pass filter", True, change="low-pass"),
    Case("dogsurf", "random half of the runs, others", False),
)
N_DRAWS = {"biotac20": 3, "floors10": 3, "borealtc": 3, "dogsurf": 1}
"""Number of random halves; training on `dogsurf` is slow."""


def split(case: Case, draw: int) -> tuple[set[str], set[str]]:
    """Return the identifiers of training and test recordings."""
    entries = open_dataset(case.dataset).entries
    frame = pd.DataFrame([(e.recording_id, e.surface, e.repetition) for e in entries], columns=list("isr"))
    if case.dataset == "biotac20" and case.trained:
        first, last = case.trained[draw]
        return set(frame.i[frame.r.between(first, last)]), set(frame.i[frame.r > 20])
    rng = np.random.default_rng([SEED, draw])
    trained, tested = list[str](), list[str]()
    for _, group in frame[frame.r <= 20 if case.dataset == "biotac20" else frame.r > -1].groupby("s"):
        ordered = group.sort_values("r")
        if case.dataset == "floors10" and not case.has_drift:
            ordered = ordered.iloc[: len(ordered) // 2]
        if not case.trained:
            ordered = ordered.sample(frac=1, random_state=rng)
        trained += ordered.i.tolist()[: len(ordered) // 2]
        tested += ordered.i.tolist()[len(ordered) // 2 :]
    return set(trained), set(tested)


def part(dataset: Dataset, ids: set[str], note: str) -> Dataset:
    """Return the recordings with these identifiers."""
    entries = tuple(entry for entry in dataset.entries if entry.recording_id in ids)
    return replace(dataset, entries=entries, input_hash=f"{dataset.input_hash} {note}")


@cache
def features_of(dataset: str, change: str) -> pd.DataFrame:
    """Return the features of all recordings or windows of a dataset after a change, as `train` uses them."""
    recordings = open_dataset(dataset)
    pipeline = default_pipeline(recordings)
    recordings = recordings if change == "none" else changed(recordings, change)
    window_s = WINDOW_S[dataset]
    recordings = recordings if window_s is None else cut_windows(recordings, window_s)
    return cached_table(recordings, *pipeline.needed, channels=pipeline.channels).frame.reset_index(drop=True)


def answers_of(model: Model, frame: pd.DataFrame) -> list[Answer]:
    """Return the answers for the recordings of a feature table."""
    recordings, values = parents(frame).astype(str), frame[list(model.columns)].to_numpy(dtype=float)
    answers = []
    for name in recordings.unique():
        rows = [FeatureRow(values[i], (), name) for i in np.flatnonzero(recordings == name)]
        is_window = model.manifest.window_s is not None
        answers.append(model.average_rows(rows, name) if is_window else model.answer_row(rows[0]))
    return answers


def novelty(model: Model, answers: list[Answer]) -> list[float]:
    """Return the median novelty score of each recording."""
    scores = []
    for answer in answers:
        prepared, decisions = model.decide(valid_rows([answer])[0])
        detector = model.novelty
        scores.append(
            float(np.median(novelty_scores(detector.kind, decisions, prepared, detector.class_distance)))
        )
    return scores


def results_of(
    model: Model, answers: list[Answer], surface_of: dict[str, str], **facts: Any
) -> list[dict[str, Any]]:
    """Return one row per recording: hit, alarm, prediction sets and novelty."""
    rows = []
    for answer, score in zip(answers, novelty(model, answers), strict=True):
        true = surface_of[answer.recording_id]
        row = {"recording": answer.recording_id, "known": true in model.surfaces, "novelty": score, **facts}
        row |= {"hit": answer.surface == true, "unknown": answer.unknown}
        for level in DEFAULT_LEVELS:
            members = answer.prediction_sets.get(level, model.surfaces)
            name = f"{100 * level:g}"
            row |= {f"covered{name}": true in members, f"size{name}": len(members)}
        rows.append(row)
    return rows


def measure(case: Case, draw: int, n_unknown: int) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return rows per recording before and after the adaptation, and rows per batch tested for drift."""
    trained_ids, tested_ids = split(case, draw)
    dataset = open_dataset(case.dataset)
    rng = np.random.default_rng([SEED, draw, n_unknown])
    left_out = set(rng.permutation(sorted(dataset.surfaces))[:n_unknown].tolist())
    surface_of = {entry.recording_id: entry.surface for entry in dataset.entries}
    trained_ids = {name for name in trained_ids if surface_of[name] not in left_out}
    training_set = part(dataset, trained_ids, f"drift {case.name} {draw} {sorted(left_out)}")
    model = train(training_set, window_s=WINDOW_S[case.dataset])
    frame = features_of(case.dataset, case.change)
    answers = answers_of(model, frame[parents(frame).astype(str).isin(tested_ids)])
    blocks = [answers]
    if case.dataset == "biotac20" and case.trained:  # batches of 200 recordings
        numbers = {entry.recording_id: entry.repetition for entry in dataset.entries}
        blocks = [[a for a in answers if (numbers[a.recording_id] <= 30) == early] for early in (True, False)]
    facts = {"dataset": case.dataset, "case": case.name, "draw": draw, "n_unknown": n_unknown}
    rows, batches = [], []
    for i, block in enumerate(blocks):
        rows += results_of(model, block, surface_of, **facts, when="before")
        try:
            adapted = adapt_to_answers(model, block)
        except ValueError as error:
            print(case.name, error, flush=True)
            adapted = model
        again = [adapted.answer_again(answer) for answer in block]
        rows += results_of(adapted, again, surface_of, **facts, when="after")
        for k in range(N_BATCHES):
            rng = np.random.default_rng([SEED, draw, i, k])
            chosen = rng.permutation(len(block))[: round(BATCH_SHARE * len(block))]
            drift = detect_drift(model, [block[j] for j in chosen])
            after = detect_drift(adapted, [again[j] for j in chosen])
            batches.append(
                {**facts, "kind": "random", "drift": drift.is_detected, "drift_after": after.is_detected}
            )
        if left_out:
            unknown = [answer for answer in block if surface_of[answer.recording_id] in left_out]
            drift = detect_drift(model, unknown)
            batches.append({**facts, "kind": "unknown", "drift": drift.is_detected, "drift_after": False})
    return rows, batches


def summary(case: Case, rows: pd.DataFrame, batches: pd.DataFrame) -> dict[str, Any]:
    """Return the figures of a case, with 95 % intervals over recordings."""
    found: dict[str, Any] = {"dataset": case.dataset, "case": case.name, "has_drift": case.has_drift}
    for when in ("before", "after"):
        known = rows[(rows.when == when) & (rows.n_unknown == 0)]
        for name in ("hit", "unknown", "covered90", "covered95"):
            low, high = cluster_interval(known[name].to_numpy(), known["recording"].to_numpy())
            found[f"{name}_{when}"] = {"mean": float(known[name].mean()), "low": low, "high": high}
        for level in DEFAULT_LEVELS:
            size = f"size{100 * level:g}"
            found[f"{size}_{when}"] = float(known[size].mean())
        mixed = rows[(rows.when == when) & (rows.n_unknown > 0)]
        draws = [group for _, group in mixed.groupby("draw") if not group.known.all()]
        found[f"auroc_{when}"] = float(np.mean([roc_auc_score(~g.known, g.novelty) for g in draws]))
        found[f"flagged_{when}"] = float(mixed.unknown[~mixed.known].mean())
    known_batches = batches[(batches.kind == "random") & (batches.n_unknown == 0)]
    mixed_batches = batches[(batches.kind == "random") & (batches.n_unknown > 0)]
    found["reported"] = float(known_batches.drift.mean())
    found["reported_after"] = float(known_batches.drift_after.mean())
    found["reported_mixed"] = float(mixed_batches.drift.mean())
    found["reported_unknown_only"] = float(batches.drift[batches.kind == "unknown"].mean())
    return found | {"n_recordings": int(known.recording.nunique()), "n_batches": len(known_batches)}


def main() -> None:
    args = command_line(__doc__, only=range(len(CASES)))
    results = []
    for number in args.only:
        case, rows, batches = CASES[number], list[dict[str, Any]](), list[dict[str, Any]]()
        for draw in range(len(case.trained) or N_DRAWS[case.dataset]):
            for n_unknown in (0, N_UNKNOWN[case.dataset]):
                more_rows, more_batches = measure(case, draw, n_unknown)
                rows, batches = rows + more_rows, batches + more_batches
        results.append(summary(case, pd.DataFrame(rows), pd.DataFrame(batches)))
        print(results[-1], flush=True)
        report(results, args.out)


def report(results: list[dict[str, Any]], out: Any) -> None:
    """Write the results so far."""
    names = {result["dataset"] for result in results}
    settings = {
        "seed": SEED,
        "input_hash": {name: open_dataset(name).input_hash for name in sorted(names)},
        "significance": SIGNIFICANCE,
        "n_batches": N_BATCHES,
    }
    cells = []
    for result in results:
        row = {"dataset": result["dataset"], "case": result["case"]}
        for name, value in result.items():
            if isinstance(value, dict):
                low, high = 100 * value["low"], 100 * value["high"]
                row[name] = f"{100 * value['mean']:.1f} [{low:.1f}, {high:.1f}]"
            elif isinstance(value, float):
                row[name] = f"{value:.2f}" if name.startswith("size") else f"{100 * value:.1f}"
        cells.append(row)
    blocks = [
        "A model is trained with the default pipeline and predicts later recordings, or others of the same "
        "time, before and after `texclass predict --adapt`: it is adapted to all of these recordings without "
        "labels. Of `biotac20`, each batch has 200 recordings. Per cent, 95 % intervals over recordings. "
        "Models of all other datasets classify windows of 5 s; a recording (run or drive) counts once.",
        Heading("Accuracy and false alarms"),
        "False alarms: recordings of trained surfaces that are reported as unknown; the accepted share is "
        "5 %. Models of one repetition do not report unknown surfaces.",
        table(
            cells,
            "dataset = {dataset} | training and test set = {case} | accuracy before = {hit_before} | "
            "after = {hit_after} | false alarms before = {unknown_before} | after = {unknown_after}",
            n_words=2,
        ),
        Heading("Prediction sets"),
        table(
            cells,
            "dataset = {dataset} | training and test set = {case} | "
            "90 %: coverage before = {covered90_before} | after = {covered90_after} | "
            "size before = {size90_before} | after = {size90_after} | "
            "95 %: coverage before = {covered95_before} | after = {covered95_after} | "
            "size before = {size95_before} | after = {size95_after}",
            n_words=2,
        ),
        Heading("Unknown surfaces"),
        "Surfaces are left out of the training set "
        f"({', '.join(f'{N_UNKNOWN[name]} of {name}' for name in sorted(names))}); their recordings "
        "are among those to which the model is adapted. AUROC of the novelty score, and share of "
        "their recordings that are reported as unknown, in per cent.",
        table(
            cells,
            "dataset = {dataset} | training and test set = {case} | AUROC before = {auroc_before} | "
            "after = {auroc_after} | detected before = {flagged_before} | after = {flagged_after}",
            n_words=2,
        ),
        Heading("Reports of drift"),
        f"Share of batches in which drift is reported, at a significance level of {100 * SIGNIFICANCE:g} %: "
        f"{N_BATCHES} random batches of half of the recordings of each test set, of trained surfaces only, "
        "and with unknown surfaces; the same batches after the adaptation; batches of unknown surfaces only.",
        table(
            cells,
            "dataset = {dataset} | training and test set = {case} | trained surfaces = {reported} | "
            "after the adaptation = {reported_after} | with unknown surfaces = {reported_mixed} | "
            "unknown surfaces only = {reported_unknown_only}",
            n_words=2,
        ),
    ]
    write(out, "drift", settings | {"results": results}, "Drift over time", blocks)


if __name__ == "__main__":
    main()
