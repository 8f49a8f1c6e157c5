"""Expected calibration error of probabilities on held-out recordings.

`python benchmarks/calibration_study.py [--only NUMBER ...]` (some minutes) writes
reports/studies/calibration.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from sklearn.model_selection import StratifiedKFold
from study import command_line, interval, table, write

from texclass.classifiers.segment_voting import with_segment_columns
from texclass.evaluation import cached_table, cluster_interval, cut_windows, load_pipeline
from texclass.evaluation.pipeline import PipelineDefinition
from texclass.evaluation.windows import parents
from texclass.loaders import Dataset, open_dataset
from texclass.recognition import expected_calibration_error, train
from texclass.recognition.probabilities import N_BINS

SEED = 6
N_DRAWS = 1000
AIM = 0.05
CASE = ("dataset", "pipeline", "row", "classifier", "protocol", "window_s")
CASES = (
    ("biotac20", "multiscale", "All", "vote", "recording", None),
    ("biotac20", "multiscale", "All", "vote", "chronological", None),
    ("biotac20", "texclass", "Modified MFCC", "lda", "recording", None),
    ("biotac20", "texclass", "Modified MFCC", "lda", "chronological", None),
    ("biotac20", "texclass", "Modified MFCC", "naive_bayes", "recording", None),
    ("biotac20", "texclass", "Modified MFCC", "naive_bayes", "chronological", None),
    ("biotac20", "multiscale", "All", "kernel", "recording", 1.0),
    ("biotac20", "multiscale", "All", "kernel", "chronological", 1.0),
    ("simulated", "multiscale", "All", "vote", "recording", None),
    ("simulated", "texclass", "All", "lda", "recording", None),
    ("simulated", "texclass", "All", "naive_bayes", "recording", None),
)
"""What is trained, how it is calibrated (protocol), and what it is asked about."""


def halves(dataset: Dataset) -> Iterator[tuple[Dataset, ...]]:
    """Yield (training, test) datasets: repetitions 1-20 and 21-40 of `biotac20`, else five folds."""
    entries = np.array(dataset.entries, dtype=object)
    if dataset.name == "biotac20":
        late = np.array([entry.repetition > 20 for entry in entries])
        splits = [(np.flatnonzero(~late), np.flatnonzero(late))]
    else:
        folds = StratifiedKFold(5, shuffle=True, random_state=SEED)
        splits = folds.split(entries, [entry.surface for entry in entries])
    for split in splits:
        yield tuple(replace(dataset, entries=tuple(entries[part])) for part in split)


def features_of(
    window_dataset: Dataset, pipeline: PipelineDefinition, window_s: float | None
) -> pd.DataFrame:
    """Return the features of recordings, or of their touches."""
    window_dataset = window_dataset if window_s is None else cut_windows(window_dataset, window_s)
    return cached_table(window_dataset, *pipeline.needed, channels=pipeline.channels).frame


def measure(case: dict[str, Any]) -> dict[str, Any]:
    """Return accuracy and calibration errors of a case."""
    pipeline, dataset = load_pipeline(case["pipeline"]), open_dataset(case["dataset"])
    asked_for = {name: case[name] for name in ("row", "classifier", "window_s", "protocol")}
    fold_results = []
    for training_set, test_set in halves(dataset):
        model = train(training_set, pipeline, **asked_for)
        trained, frame = (
            features_of(window_dataset, pipeline, case["window_s"])
            for window_dataset in (training_set, test_set)
        )
        X_train, X = (one[list(model.columns)].to_numpy(dtype=np.float64) for one in (trained, frame))
        p, p_known = model.classify(X)
        classifier = with_segment_columns(pipeline.classifiers[case["classifier"]].make(), model.columns)
        classifier.fit(model.prepare(X_train), trained["surface"].to_numpy(dtype=str))
        raw = classifier.predict_proba(model.prepare(X)).max(axis=1)
        hits = np.array(model.surfaces)[p.argmax(axis=1)] == frame["surface"].to_numpy(dtype=str)
        alarms = p_known <= model.novelty.false_alarms
        fold_results.append((p.max(axis=1), raw, hits, parents(frame).to_numpy(dtype=str), alarms))
    confidence, raw, hits, clusters, alarms = map(np.concatenate, zip(*fold_results, strict=True))
    ece = expected_calibration_error(confidence, hits)
    rng, names, drawn = np.random.default_rng(SEED), np.unique(clusters), []
    rows = {name: np.flatnonzero(clusters == name) for name in names}
    for _ in range(N_DRAWS):
        resampled = np.concatenate([rows[name] for name in rng.choice(names, len(names))])
        drawn.append(expected_calibration_error(confidence[resampled], hits[resampled]))
    # The basic bootstrap interval over recordings: resamples are biased upwards, as the error is.
    low, high = 2 * ece - np.quantile(drawn, [0.975, 0.025])
    return {
        **case,
        "n": len(hits),
        "accuracy": hits.mean(),
        "accuracy_interval": cluster_interval(hits, clusters),
        "confidence": confidence.mean(),
        "ece": ece,
        "ece_interval": [max(0.0, low), high],
        "ece_equal_counts": expected_calibration_error(confidence, hits, equal_counts=True),
        "ece_uncalibrated": expected_calibration_error(raw, hits),
        "false_alarms": alarms.mean(),
        "input_hash": dataset.input_hash,
    }


def main() -> None:
    args = command_line(__doc__, only=range(len(CASES)))
    results = []
    for number in args.only:
        results.append(measure(dict(zip(CASE, CASES[number], strict=True))))
        print(results[-1], flush=True)
    settings = {
        "seed": SEED,
        "n_bins": N_BINS,
        "results": results,
    }
    table_rows = []
    for r in results:
        low, high = r["accuracy_interval"]
        touch = "whole" if r["window_s"] is None else f"{r['window_s']:g} s"
        table_rows.append(r | {"touch": touch, "right": interval(r | {"low": low, "high": high})})
    blocks = [
        "Models are trained, thresholds and temperatures included, on repetitions 1-20 of `biotac20`, and "
        "asked about 21-40 (the sensor has drifted); on `simulated` they are asked in five outer folds. "
        "`held out` says how the training recordings were held out to calibrate: in random folds "
        "(recording), or later ones from earlier ones (chronological). ECE is the expected calibration "
        f"error of the likeliest surface in {N_BINS} bins of equal width (of equal counts in the next "
        "column), with a bootstrap interval over recordings; `before` is that of the classifier's own "
        f"probabilities. Aim: at most {AIM}. False alarms: known surfaces called unknown, 5 % asked for.",
        table(
            table_rows,
            "dataset = {dataset} | touch = {touch} | row, classifier = {pipeline}: {row}, {classifier} | "
            "held out = {protocol} | n = {n} | accuracy, % = {right} | "
            "ECE = {ece:.3f} [{ece_interval[0]:.3f}, {ece_interval[1]:.3f}] | "
            "equal counts = {ece_equal_counts:.3f} | before = {ece_uncalibrated:.3f} | "
            "false alarms = {false_alarms:.1%}",
            n_words=4,
        ),
        {r["dataset"]: f"input {r['input_hash'][:16]}" for r in results},
    ]
    write(args.out, "calibration", settings, "Calibration", blocks)


if __name__ == "__main__":
    main()
