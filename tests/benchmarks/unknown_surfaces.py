"""Are surfaces that were never trained told apart from known ones: pairs of materials left out of `biotac20`.

Run `python tests/benchmarks/unknown_surfaces.py --pairs 40` from the project's root (about half a minute a
pair; all 190 by default). Writes `reports/studies/unknown_surfaces.md` and `.json`.
"""

import argparse
import itertools
import json
import textwrap
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import linalg
from sklearn.metrics import roc_auc_score
from threadpoolctl import threadpool_limits

from texclass.experiment import find_protocol, load_pipeline
from texclass.experiment.feature_table import cached_table
from texclass.experiment.pipeline import MatchedRow
from texclass.loaders import open_dataset
from texclass.provenance import versions
from texclass.recognition.probabilities import class_scores
from texclass.recognition.unknown import Novelty, fit_nearness

SEED = 6
FALSE_ALARMS = 0.05
PIPELINE, ROW, CLASSIFIER = "multiscale", "All", "vote"
AIM_AUROC, AIM_FLAGGED = 0.95, 0.80
REPORTS = Path(__file__).parents[2] / "reports" / "studies"
SCORES = {
    "decision": "minus the largest decision of the classifier (kept)",
    "margin": "minus the gap between the two largest decisions",
    "distance": "squared distance to the nearest class mean in the discriminant's view (kept for others)",
    "neighbours": "distance to the third nearest training recording in the discriminant's view",
    "kernel": "1 - kernel of the nearest training recording",
    "mahalanobis": "squared distance to the nearest class mean, all directions whitened",
}
DESIGNS = {
    "recordings": "every fifth repetition of the known materials tests, the others train",
    "blocks": "repetitions 1-20 of the known materials train, 21-40 test: the sensor has drifted",
    "blocks, drift expected": "as blocks; the threshold is set on 11-20 by a recogniser of 1-10",
}


@dataclass(frozen=True, eq=False)
class Material:
    """Features, labels and repetitions of all recordings."""

    X: Any
    frame: pd.DataFrame

    @property
    def y(self):
        return self.frame["material"].to_numpy(dtype=str)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=190, help="how many of the 190, drawn with the seed")
    parser.add_argument("--out", type=Path, default=REPORTS)
    options = parser.parse_args()
    dataset, pipeline = open_dataset("biotac20"), load_pipeline(PIPELINE)
    table = cached_table(dataset, *pipeline.needed, channels=pipeline.channels)
    row = next(r for r in pipeline.rows if r.name == ROW)
    columns = list(MatchedRow.of(row, pipeline.features, table).columns)
    material = Material(table.frame[columns].to_numpy(), table.frame)
    pairs = list(itertools.combinations(dataset.materials, 2))
    drawn = np.random.default_rng(SEED).permutation(len(pairs))[: options.pairs]
    results, start = [], time.monotonic()
    with threadpool_limits(1):
        for n, i in enumerate(drawn):
            results += study(material, pipeline, pairs[i], int(i))
            seconds = (time.monotonic() - start) / (n + 1)
            print(f"{n + 1}/{len(drawn)} {pairs[i]} {seconds:.1f} s a pair", flush=True)
            if (n + 1) % 5 == 0 or n + 1 == len(drawn):  # a run that is stopped leaves what it has
                write(results, dataset, pipeline, n + 1, len(columns), options.out)


def study(material: Material, pipeline, pair: tuple[str, str], number: int) -> list[dict[str, Any]]:
    """Return AUROC, share of unknowns flagged and false alarms of every score under every design."""
    y, repetition = material.y, material.frame["repetition"].to_numpy(dtype=int)
    unknown, found = np.isin(y, pair), []
    fifth, late = (repetition + number) % 5 == 0, repetition > 20
    for name, protocol, test in (
        ("recordings", "recording", fifth),
        ("blocks", "recording", late),
        ("blocks, drift expected", "blocks", late),
    ):
        train, asked = (
            np.flatnonzero(~unknown & ~test),
            np.flatnonzero(test | (unknown & (name == "recordings"))),
        )
        held_out = {score: [] for score in SCORES}
        splits = find_protocol(protocol).split(material.frame.iloc[train].reset_index(drop=True), 5, SEED)
        for inner, outer in splits:
            for score, values in scores(material, pipeline, train[inner], train[outer]).items():
                held_out[score].append(values)
        said = scores(material, pipeline, train, asked)
        is_unknown = unknown[asked]
        for score in SCORES:
            novelty = Novelty("decision", np.sort(np.concatenate(held_out[score])), FALSE_ALARMS)
            flagged = novelty.is_unknown(said[score])
            found.append(
                {
                    "pair": list(pair),
                    "design": name,
                    "score": score,
                    "auroc": float(roc_auc_score(is_unknown, said[score])),
                    "flagged": float(flagged[is_unknown].mean()),
                    "false_alarms": float(flagged[~is_unknown].mean()),
                    "n_unknown": int(is_unknown.sum()),
                    "n_known": int((~is_unknown).sum()),
                }
            )
    return found


def scores(material: Material, pipeline, train, asked) -> dict[str, Any]:
    """Return how strange recordings are by every score: fitted on `train`, for `asked`."""
    row = next(r for r in pipeline.rows if r.name == ROW)
    prepare = pipeline.preparation(row, CLASSIFIER).fit(material.X[train])
    X, asked_X = prepare.transform(material.X[train]), prepare.transform(material.X[asked])
    labels = np.unique(material.y[train], return_inverse=True)[1]
    classifier = pipeline.classifiers[CLASSIFIER].make().fit(X, material.y[train])
    decisions = class_scores(classifier, asked_X)
    ordered = np.sort(decisions, axis=1)
    near = fit_nearness(X, labels)
    whole = classifier.whole_
    kernel = whole._kernel([view(asked_X) for view in whole.views_])
    return {
        "decision": -ordered[:, -1],
        "margin": ordered[:, -2] - ordered[:, -1],
        "distance": near(asked_X),
        "neighbours": third_nearest((X - near.mean) @ near.view, (asked_X - near.mean) @ near.view),
        "kernel": 1 - kernel.max(axis=1),
        "mahalanobis": mahalanobis(X, labels, asked_X),
    }


def third_nearest(known, asked):
    """Return the distance to the third nearest known sample."""
    squared = (asked**2).sum(1)[:, None] + (known**2).sum(1) - 2 * asked @ known.T
    return np.sqrt(np.maximum(np.partition(squared, 2, axis=1)[:, 2], 0))


def mahalanobis(X, labels, asked, shrinkage: float = 0.1):
    """Return the squared distance to the nearest class mean, the shrunk within-class covariance whitened."""
    mean, scale = X.mean(axis=0), X.std(axis=0)
    scale[scale == 0] = np.inf
    Z, A = (X - mean) / scale, (asked - mean) / scale
    means = np.array([Z[labels == k].mean(axis=0) for k in range(labels.max() + 1)])
    S = (Z - means[labels]).T @ (Z - means[labels]) / len(Z)
    S = (1 - shrinkage) * S + shrinkage * np.trace(S) / len(S) * np.eye(len(S))
    root = linalg.solve_triangular(linalg.cholesky(S, lower=True), np.vstack([A, means]).T, lower=True).T
    A, means = root[: len(A)], root[len(A) :]
    return ((A[:, None] - means) ** 2).sum(axis=2).min(axis=1)


def summary(results: list[dict[str, Any]]) -> pd.DataFrame:
    """Return means over pairs with percentile-bootstrap intervals, and the worst pair."""
    rng, rows = np.random.default_rng(SEED), []
    for (design, score), group in pd.DataFrame(results).groupby(["design", "score"], sort=False):
        row = {"design": design, "score": score, "n_pairs": len(group)}
        drawn = rng.integers(len(group), size=(2000, len(group)))
        for name in ("auroc", "flagged", "false_alarms"):
            values = group[name].to_numpy()
            low, high = np.quantile(values[drawn].mean(axis=1), [0.025, 0.975])
            worst = values.max() if name == "false_alarms" else values.min()
            row |= {name: values.mean(), f"{name}_low": low, f"{name}_high": high, f"{name}_worst": worst}
        rows.append(row)
    return pd.DataFrame(rows)


def write(results, dataset, pipeline, n_pairs: int, n_columns: int, out: Path) -> None:
    table = summary(results)
    facts = {
        "versions": versions("numpy", "scipy", "scikit-learn"),
        "seed": SEED,
        "input_hash": dataset.input_hash,
        "pipeline": [PIPELINE, ROW, CLASSIFIER, pipeline.hash],
        "n_columns": n_columns,
        "n_pairs": n_pairs,
        "false_alarms": FALSE_ALARMS,
    }
    out.mkdir(parents=True, exist_ok=True)
    document = {**facts, "summary": table.to_dict("records"), "results": results}
    (out / "unknown_surfaces.json").write_text(json.dumps(document, indent=1), encoding="utf-8")
    (out / "unknown_surfaces.md").write_text(report(table, facts), encoding="utf-8")


def report(table: pd.DataFrame, facts: dict[str, Any]) -> str:
    """Return the report in Markdown."""
    of = (
        "all 190 pairs"
        if facts["n_pairs"] == 190
        else f"{facts['n_pairs']} of the 190 pairs, drawn at random"
    )
    words = (
        f"`biotac20`, {of} (seed {SEED}): a recogniser (`{PIPELINE}`, row {ROW}, {CLASSIFIER}, "
        f"{facts['n_columns']} columns) is trained without two materials, then asked about them and about "
        "held-out recordings of the other 18. One is flagged where the conformal p-value of its score "
        f"is at most {FALSE_ALARMS}; held-out scores come from five-fold cross-validation on the training "
        "recordings, unless it says otherwise. Means over pairs, 95 % bootstrap intervals over pairs. Aims: "
        f"AUROC at least {AIM_AUROC}, at least {100 * AIM_FLAGGED:.0f} % flagged at {100 * FALSE_ALARMS:g} % "
        "false alarms. Scores of distance need recordings enough for a held-out one to lie as near as one of "
        "training: half of few, as where drift is expected, puts the threshold too far out."
    )
    lines = ["# Unknown surfaces", "", *textwrap.wrap(words, 100), ""]
    for design, meaning in DESIGNS.items():
        lines += [
            f"## {design[0].upper() + design[1:]}",
            "",
            f"{meaning[0].upper() + meaning[1:]}.",
            "",
            "| score | AUROC | worst pair | flagged, % | worst pair | false alarms, % | worst |",
            "| --- | --- | --- | --- | --- | --- | --- |",
        ]
        for row in table[table["design"] == design].to_dict("records"):
            cells = [f"{row['auroc']:.4f} [{row['auroc_low']:.4f}, {row['auroc_high']:.4f}]"]
            cells += [f"{row['auroc_worst']:.4f}"]
            for name in ("flagged", "false_alarms"):
                mean, low, high = (100 * row[name + end] for end in ("", "_low", "_high"))
                cells += [f"{mean:.1f} [{low:.1f}, {high:.1f}]", f"{100 * row[f'{name}_worst']:.1f}"]
            lines.append(f"| {row['score']} | {' | '.join(cells)} |")
        lines.append("")
    lines += ["## Scores", "", *(f"- {name}: {meaning}" for name, meaning in SCORES.items()), ""]
    lines += ["## Made with", "", ", ".join(f"{k} {v}" for k, v in facts["versions"].items())]
    lines += [f"input {facts['input_hash'][:16]}, pipeline {facts['pipeline'][3]}, seed {SEED}", ""]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
