"""Coverage of prediction sets of 90 and 95 %, also for a sensor that drifts.

`python benchmarks/prediction_set_coverage.py [--only NUMBER ...]` (ten minutes) writes
reports/studies/prediction_sets.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import StratifiedGroupKFold
from study import command_line, table, write

from texclass.evaluation import cached_table, cluster_interval, cut_windows, load_pipeline
from texclass.evaluation.cost import CostMeter
from texclass.evaluation.protocols import find_protocol, make_splits
from texclass.evaluation.windows import parents
from texclass.loaders import open_dataset
from texclass.recognition.candidates import list_candidates
from texclass.recognition.held_out_predictions import predict_held_out
from texclass.recognition.prediction_sets import (
    DEFAULT_LEVELS,
    HALF_LIFE,
    ConformalCalibration,
    calibrate_sets,
    log_odds,
    n_later_repetitions,
    recency_weights,
)
from texclass.recognition.probabilities import fit_calibration, fit_correlation
from texclass.recording import Samples

SEED, N_DRAWS = 9, 20
N_TRAINED, LAST_TRAINED = 16, 20
"""Number of training repetitions of `biotac20` in a draw, out of the first `LAST_TRAINED` repetitions."""
CASE = ("dataset", "pipeline", "row", "classifier", "window_s", "held_out")
CASES = (
    ("biotac20", "multiscale", "All", "vote", None, "recording"),
    ("biotac20", "multiscale", "All", "vote", None, "chronological"),
    ("borealtc", "coarse", "Bands", "kernel", 5.0, "grouped"),
)
"""Dataset, pipeline, row and classifier, window length in s, and protocol of the held-out calibration."""
Rows = NDArray[np.intp]
Columns = dict[str, NDArray[Any]]


def draws(dataset: str, frame: pd.DataFrame) -> Iterator[tuple[Rows, Rows]]:
    """Yield training and test rows: some early and all later repetitions, or grouped folds."""
    if dataset == "biotac20":
        repetition, rng = frame["repetition"].to_numpy(), np.random.default_rng(SEED)
        for _ in range(N_DRAWS):
            chosen = rng.permutation(LAST_TRAINED)[:N_TRAINED] + 1
            yield np.flatnonzero(np.isin(repetition, chosen)), np.flatnonzero(repetition > LAST_TRAINED)
        return
    for seed in range(N_DRAWS // 5):
        folds = StratifiedGroupKFold(5, shuffle=True, random_state=SEED + seed)
        yield from folds.split(frame, frame["surface"], parents(frame))


def measure(case: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the coverage of sets with thresholds from the training set and from reference recordings."""
    pipeline, dataset = load_pipeline(case["pipeline"]), open_dataset(case["dataset"])
    window_dataset = dataset if case["window_s"] is None else cut_windows(dataset, case["window_s"])
    features = cached_table(window_dataset, *pipeline.needed, channels=pipeline.channels)
    frame = features.frame.reset_index(drop=True)
    meter = CostMeter.from_dataset(window_dataset, frame["recording_id"].tolist(), pipeline.channels)
    (candidate,) = list_candidates(pipeline, features, meter, row=case["row"], classifier=case["classifier"])
    results_by_source: dict[tuple[str, float], list[dict[str, Any]]] = {}
    for train, test in draws(case["dataset"], frame):
        training, test_frame = frame.iloc[train].reset_index(drop=True), frame.iloc[test]
        splits = make_splits(find_protocol(case["held_out"]), training, pipeline.seed)
        held_out = predict_held_out(candidate, training, splits)
        calibration = fit_calibration(held_out.decisions, held_out.labels)
        of = facts(training.iloc[held_out.rows])
        several = case["window_s"] is not None
        p = calibration(held_out.decisions)
        correlation = fit_correlation(p, held_out.labels, of["contact"]) if several else None
        ages = (
            n_later_repetitions(of["surface"], of["repetition"]) if case["held_out"] == "chronological" else 0
        )
        training_calibration = calibrate_sets(
            held_out.decisions,
            held_out.labels,
            of["contact"],
            calibration,
            correlation=correlation,
            weights=recency_weights(ages, HALF_LIFE),
        )["answer"]
        answers = predict_held_out(candidate, frame, [(train, test)])
        odds, p = log_odds(calibration.beta * answers.decisions), calibration(answers.decisions)
        thresholds = {
            "training": {
                level: np.full(len(test), training_calibration.threshold(level)) for level in DEFAULT_LEVELS
            }
        }
        if case["held_out"] == "chronological":
            right = odds[np.arange(len(test)), answers.labels]
            thresholds["references"] = reference_thresholds(training_calibration, right, facts(test_frame))
        for source, of_level in thresholds.items():
            for level, at_least in of_level.items():
                inside = odds >= at_least[:, None]
                draw_result = evaluate_sets(
                    inside, answers.labels, p, parents(test_frame).to_numpy(dtype=str)
                )
                results_by_source.setdefault((source, level), []).append(draw_result)
    return [
        {**case, "way": source, "level": level, "input_hash": dataset.input_hash, **summary(of_draws, level)}
        for (source, level), of_draws in results_by_source.items()
    ]


def facts(part: pd.DataFrame) -> Columns:
    """Return the contact, surface and repetition of each row."""
    return {
        "contact": parents(part).to_numpy(dtype=str),
        "surface": part["surface"].to_numpy(dtype=str),
        "repetition": part["repetition"].to_numpy(),
    }


def reference_thresholds(
    training_calibration: ConformalCalibration, right: Samples, of: Columns
) -> dict[float, Samples]:
    """Return the thresholds of the log odds for each repetition, with all earlier ones as references."""
    thresholds = {level: np.zeros(len(right)) for level in DEFAULT_LEVELS}
    for now in np.unique(of["repetition"]):
        window_dataset, renewed = of["repetition"] < now, training_calibration
        if window_dataset.any():
            ages = n_later_repetitions(of["surface"][window_dataset], of["repetition"][window_dataset])
            later = ConformalCalibration.from_answers(
                right[window_dataset], of["contact"][window_dataset], recency_weights(ages, HALF_LIFE)
            )
            renewed = training_calibration.updated(later, float(recency_weights(1 + ages.max(), HALF_LIFE)))
        for level in DEFAULT_LEVELS:
            thresholds[level][of["repetition"] == now] = renewed.threshold(level)
    return thresholds


def evaluate_sets(
    inside: NDArray[np.bool_], labels: Rows, p: Samples, contacts: NDArray[np.str_]
) -> dict[str, Any]:
    """Return coverage, size and accuracy of the sets of a draw, shape (n, n_surfaces)."""
    holds, hits = inside[np.arange(len(labels)), labels], p.argmax(axis=1) == labels
    low, high = cluster_interval(holds, contacts)
    return {
        "coverage": holds.mean(),
        "low": low,
        "high": high,
        "by_contact": pd.Series(holds).groupby(contacts).mean().mean(),
        "size": inside.sum(axis=1).mean(),
        "empty": (~inside.any(axis=1)).mean(),
        "or_best": (holds | (hits & ~inside.any(axis=1))).mean(),
        "accuracy": hits.mean(),
        "ranking": roc_auc_score(hits, p.max(axis=1)) if 0 < hits.sum() < len(hits) else np.nan,
    }


def summary(of_draws: list[dict[str, Any]], level: float) -> dict[str, Any]:
    """Return means over draws, and the number of draws whose interval contains the level."""
    frame = pd.DataFrame(of_draws)
    means = {name: None if frame[name].isna().all() else float(frame[name].mean()) for name in frame}
    n_inside = int(((frame["low"] <= level) & (level <= frame["high"])).sum())
    return {**means, "n_inside": n_inside, "n_draws": len(frame)}


def main() -> None:
    args = command_line(__doc__, only=range(len(CASES)))
    results = []
    for number in args.only:
        results += measure(dict(zip(CASE, CASES[number], strict=True)))
        print(results[-1], flush=True)
    settings = {
        "seed": SEED,
        "half_life": HALF_LIFE,
        "results": results,
    }
    table_rows = [
        r
        | {
            "touch": "whole" if r["window_s"] is None else f"{r['window_s']:g} s",
            "ranks": "" if r["ranking"] is None else f"{r['ranking']:.3f}",
        }
        for r in results
    ]
    blocks = [
        f"Means over {N_DRAWS} draws. Of `biotac20` a draw trains on {N_TRAINED} of the repetitions 1 to "
        f"{LAST_TRAINED} and asks about 21 to 40 (the sensor has drifted); of `borealtc` "
        f"it tests a fifth of the "
        f"runs, in {N_DRAWS // 5} times five folds. `held out` says how training "
        f"recordings were held out for the "
        f"sets; with blocks, a recording counts half with every {HALF_LIFE:g} of its "
        f"surface that came later. "
        "`references`: before a repetition is asked about, all repetitions of the tests "
        "before it have told how "
        "they conformed.",
        "`holds` is the share of answers whose set holds the right surface, with the "
        "mean of the intervals over "
        "recordings or runs, and `nominal` in how many draws the level is inside; `by contact` counts every "
        "recording or run once. Sets may be empty: where answers are right more often "
        "than the level, the least "
        "sure of them get none; `or best` is the share that holds if these take the best "
        "answer. `ranks` is the "
        "share of pairs of a right and a wrong answer of which the right one has the larger probability.",
        table(
            table_rows,
            "dataset = {dataset} | answer = {touch} | held out = {held_out} | sets from = {way} | "
            "level = {level:.0%} | holds, % = {coverage:.1%} [{low:.1%}, {high:.1%}] | "
            "nominal = {n_inside} of {n_draws} | by contact = {by_contact:.1%} | size = {size:.2f} | "
            "empty = {empty:.1%} | or best = {or_best:.1%} | accuracy = {accuracy:.1%} | ranks = {ranks}",
            n_words=4,
        ),
        {r["dataset"]: f"input {r['input_hash'][:16]}" for r in results},
    ]
    write(args.out, "prediction_sets", settings, "Coverage of prediction sets", blocks)


if __name__ == "__main__":
    main()
