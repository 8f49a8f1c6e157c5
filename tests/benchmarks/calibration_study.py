"""Do probabilities mean what they say: expected calibration error on recordings that no model has seen.

Run `python tests/benchmarks/calibration_study.py` from the project's root (some minutes). Writes
`reports/studies/calibration.md` and `.json`.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.model_selection import StratifiedKFold
from threadpoolctl import threadpool_limits

from texclass.experiment import load_pipeline, touches
from texclass.experiment.accuracy import cluster_interval
from texclass.experiment.feature_table import cached_table
from texclass.experiment.windows import parents
from texclass.loaders import open_dataset
from texclass.provenance import versions
from texclass.recognition import expected_calibration_error, train
from texclass.recognition.probabilities import N_BINS

SEED = 6
N_DRAWS = 1000
REPORTS = Path(__file__).parents[2] / "reports" / "studies"
AIM = 0.05


@dataclass(frozen=True)
class Case:
    """What is trained, how it is calibrated, and what it is asked about."""

    dataset: str
    pipeline: str
    row: str
    classifier: str
    protocol: str
    touch_s: float | None = None


CASES = (
    Case("biotac20", "multiscale", "All", "vote", "recording"),
    Case("biotac20", "multiscale", "All", "vote", "blocks"),
    Case("biotac20", "texclass", "Modified MFCC", "lda", "recording"),
    Case("biotac20", "texclass", "Modified MFCC", "lda", "blocks"),
    Case("biotac20", "texclass", "Modified MFCC", "naive_bayes", "recording"),
    Case("biotac20", "texclass", "Modified MFCC", "naive_bayes", "blocks"),
    Case("biotac20", "multiscale", "All", "kernel", "recording", 1.0),
    Case("biotac20", "multiscale", "All", "kernel", "blocks", 1.0),
    Case("simulated", "multiscale", "All", "vote", "recording"),
    Case("simulated", "texclass", "All", "lda", "recording"),
    Case("simulated", "texclass", "All", "naive_bayes", "recording"),
)


def halves(dataset) -> Iterator[tuple[Any, Any]]:
    """Yield (training, test) datasets: repetitions 1-20 and 21-40 of `biotac20`, else five folds."""
    entries = np.array(dataset.entries, dtype=object)
    if dataset.name == "biotac20":
        late = np.array([entry.repetition > 20 for entry in entries])
        splits = [(np.flatnonzero(~late), np.flatnonzero(late))]
    else:
        folds = StratifiedKFold(5, shuffle=True, random_state=SEED)
        splits = folds.split(entries, [entry.material for entry in entries])
    for split in splits:
        yield tuple(replace(dataset, entries=tuple(entries[part])) for part in split)


def measure(case: Case) -> dict[str, Any]:
    """Return accuracy and calibration errors of a case."""
    pipeline, dataset = load_pipeline(case.pipeline), open_dataset(case.dataset)
    settings = {name: getattr(case, name) for name in ("row", "classifier", "touch_s", "protocol")}
    confidence, raw, hits, clusters, alarms = [], [], [], [], []
    for known, asked in halves(dataset):
        model = train(known, pipeline, **settings)
        felt = asked if case.touch_s is None else touches(asked, case.touch_s)
        table = cached_table(felt, *pipeline.needed, channels=pipeline.channels)
        X = table.frame[list(model.columns)].to_numpy(dtype=np.float64)
        p, p_known = model.judge(X)
        right = np.array(model.materials)[p.argmax(axis=1)] == table.frame["material"].to_numpy(dtype=str)
        prepared = X
        for _, step in model.recogniser.steps[1:-1]:
            prepared = step.transform(prepared)
        confidence.append(p.max(axis=1))
        raw.append(model.recogniser[-1].predict_proba(prepared).max(axis=1))
        hits.append(right)
        clusters.append(parents(table.frame).to_numpy(dtype=str))
        alarms.append(p_known <= settings.false_alarms)
    confidence, raw, hits, clusters = map(np.concatenate, (confidence, raw, hits, clusters))
    low, high = cluster_interval(hits, clusters, SEED)
    return {
        **vars(case),
        "n": len(hits),
        "accuracy": float(hits.mean()),
        "accuracy_interval": [low, high],
        "confidence": float(confidence.mean()),
        "ece": expected_calibration_error(confidence, hits),
        "ece_interval": interval(confidence, hits, clusters),
        "ece_equal_counts": expected_calibration_error(confidence, hits, equal_counts=True),
        "ece_uncalibrated": expected_calibration_error(raw, hits),
        "false_alarms": float(np.concatenate(alarms).mean()),
        "input_hash": dataset.input_hash,
    }


def interval(confidence, hits, clusters) -> list[float]:
    """Return the basic bootstrap interval over recordings: resamples are biased upwards, as the error is."""
    rng, names = np.random.default_rng(SEED), np.unique(clusters)
    rows = {name: np.flatnonzero(clusters == name) for name in names}
    found = expected_calibration_error(confidence, hits)
    drawn = []
    for _ in range(N_DRAWS):
        chosen = np.concatenate([rows[name] for name in rng.choice(names, len(names))])
        drawn.append(expected_calibration_error(confidence[chosen], hits[chosen]))
    low, high = np.quantile(drawn, [0.025, 0.975])
    return [max(0.0, float(2 * found - high)), float(2 * found - low)]


def report(results: list[dict[str, Any]], facts: dict[str, Any]) -> str:
    """Return the report in Markdown."""
    lines = [
        "# Calibration",
        "",
        "Models are trained, thresholds and temperatures included, on repetitions 1-20 of `biotac20`, and",
        "asked about 21-40 (the sensor has drifted); on `simulated` they are asked in five outer folds.",
        "`held out` says how the training recordings were held out to calibrate: in random folds",
        "(recording), or later ones from earlier ones (blocks). ECE is the expected calibration error of",
        f"the likeliest surface in {N_BINS} bins of equal width (of equal counts in the next column), with a",
        "bootstrap interval over recordings; `before` is that of the classifier's own probabilities.",
        f"Aim: at most {AIM}.",
        "False alarms: known surfaces called unknown, 5 % asked for.",
        "",
        "| dataset | touch | row, classifier | held out | n | accuracy, % | ECE | equal counts | before "
        "| false alarms, % |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for r in results:
        low, high = (100 * end for end in r["accuracy_interval"])
        touch = "whole" if r["touch_s"] is None else f"{r['touch_s']:g} s"
        lines.append(
            f"| {r['dataset']} | {touch} | {r['pipeline']}: {r['row']}, {r['classifier']} | {r['protocol']} "
            f"| {r['n']} | {100 * r['accuracy']:.1f} [{low:.1f}, {high:.1f}] "
            f"| {r['ece']:.3f} [{r['ece_interval'][0]:.3f}, {r['ece_interval'][1]:.3f}] "
            f"| {r['ece_equal_counts']:.3f} | {r['ece_uncalibrated']:.3f} | {100 * r['false_alarms']:.1f} |"
        )
    made = ", ".join(f"{name} {version}" for name, version in facts["versions"].items())
    hashes = dict.fromkeys(f"{r['dataset']} {r['input_hash'][:16]}" for r in results)
    return "\n".join([*lines, "", f"Made with {made}; seed {SEED}; input {', '.join(hashes)}.", ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=REPORTS)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of cases")
    options = parser.parse_args()
    results: list[dict[str, Any]] = []
    facts = {"versions": versions("numpy", "scipy", "scikit-learn"), "seed": SEED, "n_bins": N_BINS}
    with threadpool_limits(1):
        for number, case in enumerate(CASES):
            if options.only is None or number in options.only:
                results.append(measure(case))
                print(results[-1], flush=True)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "calibration.json").write_text(
        json.dumps({**facts, "results": results}, indent=1), encoding="utf-8"
    )
    (options.out / "calibration.md").write_text(report(results, facts), encoding="utf-8")


if __name__ == "__main__":
    main()
