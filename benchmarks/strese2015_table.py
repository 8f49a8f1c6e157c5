"""Table I of strese2015 in the size of the paper, over ten seeds.

`python benchmarks/strese2015_table.py` (about an hour, and 9 GB in the cache folder at a time) writes
reports/papers/strese2015-table: the accuracy of the sixteen rows with three classifiers on 69 simulated
surfaces with 10 recordings of 25 s each. A seed draws other surfaces, operators, recordings and folds.
"""

import os
import tempfile
from pathlib import Path
from typing import Any
from unittest import mock

import pandas as pd
from scipy import stats
from study import command_line, table, write

from texclass.evaluation.benchmark import run_benchmark
from texclass.evaluation.pipeline import load_pipeline

SEED, N_SURFACES, DURATION_S, N_RECORDINGS, N_OPERATORS = 2015, 69, 25.0, 10, 5
TITLES = {"naive_bayes": "Naive Bayes", "lda": "LDA", "euclidean": "Euclidean"}


def accuracies(seed: int, n_surfaces: int, duration_s: float) -> pd.DataFrame:
    """Return the rows of Table I on the surfaces of one seed: row, classifier, ours, published."""
    pipeline = load_pipeline("strese2015")
    pipeline = pipeline.model_copy(
        update={"rows": tuple(r for r in pipeline.rows if r.published), "seed": seed}
    )
    recipe = {
        "n_surfaces": n_surfaces, "n_recordings": N_RECORDINGS, "n_operators": N_OPERATORS,
        "duration_s": duration_s, "fs": 10000, "seed": seed,
    }  # fmt: skip
    recipe_text = "".join(f"{key} = {value}\n" for key, value in recipe.items())
    with tempfile.TemporaryDirectory() as folder:
        card = Path(folder) / f"catalogue{seed}.toml"
        card.write_text(
            'title = "Catalogue"\nsource = "study"\nlicence = "MIT"\nformat = "simulated"\n[recipe]\n'
            + recipe_text
        )
        rows = run_benchmark(card, pipeline, nested_cv=False).data["rows"]
    return pd.DataFrame(
        {
            "seed": seed,
            "row": row["name"],
            "classifier": name,
            "ours": ours["mean"],
            "published": row["paper"][name],
        }
        for row in rows
        for name, ours in row["accuracy"].items()
    )


def agreement(ranks: pd.DataFrame) -> pd.Series:
    """Return the rank correlation of ours with the published accuracies for each seed."""
    of_seed = ranks.groupby("seed")[["ours", "published"]]
    return of_seed.apply(lambda rows: float(stats.spearmanr(rows["ours"], rows["published"]).statistic))


def summary(values: pd.Series) -> dict[str, Any]:
    """Return mean, 95 % interval of the mean (t over catalogues), least, largest and all values."""
    half = stats.t.ppf(0.975, len(values) - 1) * stats.sem(values)
    mean = values.mean()
    return {
        "mean": mean, "low": max(-1.0, mean - half), "high": min(1.0, mean + half), "least": values.min(),
        "largest": values.max(), "of_catalogues": values.round(4).tolist(),
    }  # fmt: skip


def accuracies_of_seed(seed: int) -> pd.DataFrame:
    """Return the accuracies of one seed; its recordings are deleted afterwards."""
    with (
        tempfile.TemporaryDirectory() as cache,
        mock.patch.dict(os.environ, {"TEXCLASS_CACHE": cache}),
    ):
        return accuracies(seed, N_SURFACES, DURATION_S)


def main() -> None:
    args = command_line(__doc__, "papers", seeds=10)
    parts = []
    for seed in range(SEED, SEED + args.seeds):
        parts.append(accuracies_of_seed(seed))
        print(f"seed {seed}", flush=True)
    accuracy = pd.concat(parts)
    ranks = [
        {"classifier": title} | summary(agreement(accuracy[accuracy["classifier"] == name]))
        for name, title in TITLES.items()
    ]
    result = {
        "seed": f"{SEED} ... {SEED + args.seeds - 1}",
        "n_surfaces": N_SURFACES,
        "n_recordings": N_RECORDINGS,
        "duration_s": DURATION_S,
        "results": ranks,
        "accuracy": accuracy.round(4).to_dict("records"),
    }
    blocks = [
        "The chapter [strese2015](strese2015.md) shows the accuracies. Rank correlation of the 16 rows with "
        f"the published ones: mean over {args.seeds} seeds and its 95 % interval (t distribution).",
        table(
            ranks,
            "Classifier = {classifier} | Spearman, mean [95 %] = {mean:.2f} [{low:.2f}, {high:.2f}] | "
            "smallest = {least:.2f} | largest = {largest:.2f}",
        ),
    ]
    write(args.out, "strese2015-table", result, "Table I of strese2015 over ten seeds", blocks)


if __name__ == "__main__":
    main()
