"""Detection of unknown surfaces: pairs of surfaces are left out of `biotac20`.

`python benchmarks/unknown_surfaces.py [--pairs N]` (about half a minute a pair; all 190 by default,
else so many drawn with the seed) writes reports/studies/unknown_surfaces.
"""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import linalg
from scipy.special import stdtrit
from sklearn.metrics import roc_auc_score
from study import command_line, table, write

from texclass.classifiers.kernel import mean_kernel
from texclass.evaluation import PipelineDefinition, cached_table, find_protocol, load_pipeline
from texclass.evaluation.accuracy import jackknife_error
from texclass.evaluation.pipeline import MatchedRow
from texclass.loaders import open_dataset
from texclass.recognition import NoveltyDetector
from texclass.recognition.novelty import fit_class_distance
from texclass.recognition.probabilities import class_scores
from texclass.recording import Samples
from texclass.reporting import Heading

SEED = 6
FALSE_ALARMS = 0.05
PIPELINE, ROW, CLASSIFIER = "multiscale", "All", "vote"
AIM_AUROC, AIM_FLAGGED = 0.95, 0.80
SCORES = {
    "decision": "minus the largest decision of the classifier (kept)",
    "margin": "minus the gap between the two largest decisions",
    "distance": "squared distance to the nearest class mean in the discriminant's view (kept for others)",
    "neighbours": "distance to the third nearest training recording in the discriminant's view",
    "kernel": "1 - kernel of the nearest training recording",
    "mahalanobis": "squared distance to the nearest class mean, all directions whitened",
}
DESIGNS = {
    "recordings": "every fifth repetition of the known surfaces tests, the others train",
    "chronological": "repetitions 1-20 of the known surfaces train, 21-40 test: the sensor has drifted",
    "chronological, drift expected": "the same; the threshold is set on 11-20 by a recogniser of 1-10",
}


def main() -> None:
    args = command_line(__doc__, pairs=190)
    dataset, pipeline = open_dataset("biotac20"), load_pipeline(PIPELINE)
    features = cached_table(dataset, *pipeline.needed, channels=pipeline.channels)
    row = next(r for r in pipeline.rows if r.name == ROW)
    columns = list(MatchedRow.match(row, pipeline.features, features).columns)
    pairs = list(itertools.combinations(dataset.surfaces, 2))
    drawn = np.random.default_rng(SEED).permutation(len(pairs))[: args.pairs]
    settings = {
        "seed": SEED,
        "input_hash": dataset.input_hash,
        "pipeline": [PIPELINE, ROW, CLASSIFIER, pipeline.hash],
        "n_columns": len(columns),
        "false_alarms": FALSE_ALARMS,
    }
    results: list[dict[str, Any]] = []
    for n, i in enumerate(drawn, 1):
        results += study(features.frame, columns, pipeline, pairs[i], int(i))
        print(f"{n}/{len(drawn)} {pairs[i]}", flush=True)
        if n % 5 == 0 or n == len(drawn):  # a run that is stopped leaves what it has
            report(results, settings | {"n_pairs": n}, args.out)


def study(
    frame: pd.DataFrame, columns: list[str], pipeline: PipelineDefinition, pair: tuple[str, str], number: int
) -> list[dict[str, Any]]:
    """Return AUROC, share of unknowns flagged and false alarms of every score under every design."""
    X, y = frame[columns].to_numpy(), frame["surface"].to_numpy(dtype=str)
    repetition = frame["repetition"].to_numpy(dtype=int)
    unknown, found = np.isin(y, pair), []
    fifth, late = (repetition + number) % 5 == 0, repetition > 20
    for name, protocol, test in (
        ("recordings", "recording", fifth),
        ("chronological", "recording", late),
        ("chronological, drift expected", "chronological", late),
    ):
        train = np.flatnonzero(~unknown & ~test)
        test_rows = np.flatnonzero(test | (unknown & (name == "recordings")))
        splits = find_protocol(protocol).split(frame.iloc[train].reset_index(drop=True), 5, SEED)
        held_out = [
            scores(pipeline, X[train[inner]], y[train[inner]], X[train[outer]]) for inner, outer in splits
        ]
        test_scores = scores(pipeline, X[train], y[train], X[test_rows])
        is_unknown = unknown[test_rows]
        for score in SCORES:
            reference_scores = np.sort(np.concatenate([each[score] for each in held_out]))
            flagged = (
                NoveltyDetector("decision", reference_scores, FALSE_ALARMS).p_value(test_scores[score])
                <= FALSE_ALARMS
            )
            found.append(
                {
                    "pair": list(pair),
                    "design": name,
                    "score": score,
                    "auroc": roc_auc_score(is_unknown, test_scores[score]),
                    "flagged": flagged[is_unknown].mean(),
                    "false_alarms": flagged[~is_unknown].mean(),
                    "n_unknown": int(is_unknown.sum()),
                    "n_known": int((~is_unknown).sum()),
                }
            )
    return found


def scores(pipeline: PipelineDefinition, X: Samples, y: Any, test_rows: Samples) -> dict[str, Samples]:
    """Return all novelty scores of the rows `test_rows`, fitted on X."""
    row = next(r for r in pipeline.rows if r.name == ROW)
    prepare = pipeline.preparation(row, CLASSIFIER).fit(X)
    X, test_rows = prepare.transform(X), prepare.transform(test_rows)
    labels = np.unique(y, return_inverse=True)[1]
    classifier = pipeline.classifiers[CLASSIFIER].make().fit(X, y)
    decisions = class_scores(classifier, test_rows)
    ordered = np.sort(decisions, axis=1)
    distance, whole = fit_class_distance(X, labels), classifier.whole_classifier_
    views = (each(test_rows) for each in whole.views_)
    known_view, view = ((x - distance.mean) @ distance.projection for x in (X, test_rows))
    squared = (view**2).sum(1)[:, None] + (known_view**2).sum(1) - 2 * view @ known_view.T
    return {
        "decision": -ordered[:, -1],
        "margin": ordered[:, -2] - ordered[:, -1],
        "distance": distance(test_rows),
        "neighbours": np.sqrt(np.maximum(np.partition(squared, 2, axis=1)[:, 2], 0)),
        "kernel": 1 - mean_kernel(views, whole.prototypes_, whole.length).max(axis=1),
        "mahalanobis": mahalanobis(X, labels, test_rows),
    }


def mahalanobis(X: Samples, labels: Any, test_rows: Samples, shrinkage: float = 0.1) -> Samples:
    """Return the squared distance to the nearest class mean, the shrunk within-class covariance whitened."""
    mean, scale = X.mean(axis=0), X.std(axis=0)
    scale[scale == 0] = np.inf
    Z, A = (X - mean) / scale, (test_rows - mean) / scale
    means = np.array([Z[labels == k].mean(axis=0) for k in range(labels.max() + 1)])
    S = (Z - means[labels]).T @ (Z - means[labels]) / len(Z)
    S = (1 - shrinkage) * S + shrinkage * np.trace(S) / len(S) * np.eye(len(S))
    root = linalg.solve_triangular(linalg.cholesky(S, lower=True), np.vstack([A, means]).T, lower=True).T
    A, means = root[: len(A)], root[len(A) :]
    return ((A[:, None] - means) ** 2).sum(axis=2).min(axis=1)


def summary(results: list[dict[str, Any]]) -> pd.DataFrame:
    """Return means over pairs with 95 % intervals over surfaces, and the worst pair.

    Each surface is in many pairs, so pairs are not independent: t, jackknife that leaves out a surface.
    """
    rows = []
    for (design, score), group in pd.DataFrame(results).groupby(["design", "score"], sort=False):
        row = {"design": design, "score": score, "n_pairs": len(group)}
        jackknife_samples = [
            ~group["pair"].map(lambda pair, m=m: m in pair) for m in sorted({*group["pair"].explode()})
        ]
        t = stdtrit(len(jackknife_samples) - 1, 0.975)
        for name in ("auroc", "flagged", "false_alarms"):
            values = group[name].to_numpy()
            half = t * jackknife_error(np.array([values[sample].mean() for sample in jackknife_samples]))
            low, high = np.clip([values.mean() - half, values.mean() + half], 0, 1)
            worst = values.max() if name == "false_alarms" else values.min()
            row |= {name: values.mean(), f"{name}_low": low, f"{name}_high": high, f"{name}_worst": worst}
        rows.append(row)
    return pd.DataFrame(rows)


def report(results: list[dict[str, Any]], settings: dict[str, Any], out: Path) -> None:
    """Write what has been found so far."""
    found, n = summary(results), settings["n_pairs"]
    of = "all 190 pairs" if n == 190 else f"{n} of the 190 pairs, drawn at random"
    blocks: list[Any] = [
        f"`biotac20`, {of}: a recogniser (`{PIPELINE}`, row {ROW}, {CLASSIFIER}, "
        f"{settings['n_columns']} columns) is trained without two surfaces, then asked about them and about "
        "held-out recordings of the other 18. One is flagged where the conformal p-value of its score "
        f"is at most {FALSE_ALARMS}; held-out scores come from five-fold cross-validation on the training "
        "recordings, unless it says otherwise. Means over pairs, 95 % intervals over surfaces (t, "
        "jackknife). Aims: "
        f"AUROC at least {AIM_AUROC}, at least {AIM_FLAGGED:.0%} flagged at {FALSE_ALARMS:.0%} false alarms. "
        "Scores of distance need recordings enough for a held-out one to lie as near as one of training: "
        "half of few, as where drift is expected, puts the threshold too far out."
    ]
    columns = (
        "score = {score} | AUROC = {auroc:.4f} [{auroc_low:.4f}, {auroc_high:.4f}] | "
        "least AUROC = {auroc_worst:.4f} | flagged = {flagged:.1%} [{flagged_low:.1%}, {flagged_high:.1%}] | "
        "least flagged = {flagged_worst:.1%} | "
        "false alarms = {false_alarms:.1%} [{false_alarms_low:.1%}, {false_alarms_high:.1%}] | "
        "most false alarms = {false_alarms_worst:.1%}"
    )
    for design, meaning in DESIGNS.items():
        rows = found[found["design"] == design]
        blocks += [
            Heading(design.capitalize()),
            f"{meaning[0].upper()}{meaning[1:]}.",
            table(rows, columns),
        ]
    blocks += [Heading("Scores"), SCORES]
    result = settings | {"summary": found.to_dict("records"), "results": results}
    write(out, "unknown_surfaces", result, "Unknown surfaces", blocks)


if __name__ == "__main__":
    main()
