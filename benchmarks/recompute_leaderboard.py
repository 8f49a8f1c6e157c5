"""Recompute a random sample of a leaderboard and compare the accuracies.

`python benchmarks/recompute_leaderboard.py` checks the published table; `--table FILE` checks a submission.
Only cells are drawn whose dataset, libraries and method are on this machine. The exit code is 1 if an
accuracy differs although code, folds and dataset are those of the table. If they differ, this is printed,
and the difference of the accuracies is no error.
"""

import sys
import tempfile
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
from study import set_data_folder

from texclass.baselines import BASELINES
from texclass.leaderboard import load_leaderboard
from texclass.suite import SuiteSettings, available_datasets, find_method
from texclass.suite.cells import evaluate_cell
from texclass.suite.methods import PIPELINE_TITLES
from texclass.suite.runner import CELL_KEYS, list_cells, read_table

MODULES = {"scikit-learn": "sklearn", "pycatch22": "pycatch22"}
TOLERANCE = 0.005
"""Largest difference of an accuracy between machines, whose libraries differ in the last digits."""


def can_run(name: str) -> bool:
    """Return whether a method is a pipeline of texclass, or a baseline whose packages are installed."""
    if name not in BASELINES:
        return name in PIPELINE_TITLES
    return all(find_spec(MODULES.get(package, package)) for package in BASELINES[name].packages)


def main() -> int:
    """Recompute cells and print both accuracies."""
    import argparse

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--table", type=Path, help="table to check (default: the published one)")
    parser.add_argument("--sample", type=int, default=3, help="number of cells (default 3)")
    parser.add_argument("--max-tests", type=int, default=300, help="largest number of tests of a cell")
    parser.add_argument("--seed", type=int, default=0, help="seed of the sample")
    args = parser.parse_args()
    set_data_folder()
    table = load_leaderboard(args.table)
    done = table[table["status"] == "done"]
    n_tests = done.groupby(CELL_KEYS, dropna=False)["n_test"].transform("sum")
    available, _ = available_datasets()
    usable = done[done["dataset"].isin(available) & done["method"].map(can_run) & (n_tests <= args.max_tests)]
    cells = usable.drop_duplicates(["dataset", "method"])[["dataset", "method"]]
    if cells.empty:
        print("no cell of the table can be recomputed on this machine")
        return 0
    rng = np.random.default_rng(args.seed)
    drawn = cells.iloc[rng.choice(len(cells), min(args.sample, len(cells)), replace=False)]
    n_wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        settings = SuiteSettings(Path(folder), Path(sys.executable), 600.0)
        for dataset, method in drawn.itertuples(index=False):
            for cell in list_cells([dataset], [find_method(method)]):
                for protocol in cell.protocols:
                    one = replace(cell, protocols=(protocol,))
                    (path,) = evaluate_cell(one, settings)
                    n_wrong += compared(done, read_table(path))
    return int(n_wrong > 0)


def compared(table: pd.DataFrame, again: pd.DataFrame) -> bool:
    """Print the accuracies of a cell; return whether they differ without a reason."""
    keys = ["dataset", "question", "protocol", "method"]
    first = again.iloc[0]
    rows = table[(table[keys] == first[keys]).all(axis=1)]
    if rows.empty:
        return False
    old, new = rows["accuracy"].mean(), again["accuracy"].mean()
    reasons = [
        name.removesuffix("_hash")
        for name in ("dataset_hash", "folds_hash", "method_hash", "code_hash")
        if rows.iloc[0][name] != first[name]
    ]
    is_wrong = not abs(old - new) <= TOLERANCE and not reasons
    remark = f"other {', '.join(reasons)}" if reasons else "DIFFERS" if is_wrong else "same"
    print(f"{' / '.join(first[keys])}: {100 * old:.2f} %, recomputed {100 * new:.2f} %: {remark}")
    return is_wrong


if __name__ == "__main__":
    sys.exit(main())
