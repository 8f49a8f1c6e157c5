"""Table I of strese2015 in the size of the paper, over ten seeds.

`python benchmarks/strese2015_table.py` (about an hour, and 9 GB in the cache folder at a time) writes
reports/papers/strese2015-table: the accuracy of the sixteen rows with three classifiers on 69 simulated
surfaces with 10 recordings of 25 s each. A seed draws other surfaces, operators, recordings and folds.
"""

import os
import tempfile
from unittest import mock

import pandas as pd
from rank_agreement_study import N_RECORDINGS, TITLES, accuracies, agreement, summary
from study import command_line, table, write

SEED, N_SURFACES, DURATION_S = 2015, 69, 25.0


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
