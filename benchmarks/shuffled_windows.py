"""What shuffled windows hide: accuracy of random folds over windows, and of folds over whole recordings.

Run it by hand from the project's root: `python benchmarks/shuffled_windows.py`. It writes
reports/studies/shuffled_windows.json and .md. Each window is described by the energies of 24 bands of each
channel, without anything from texclass. Both splits have the same windows, the same number of folds and the
same seeds. Datasets that are not on this machine are left out.
"""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import RandomForestClassifier
from sklearn.neighbors import KNeighborsClassifier, NearestNeighbors
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from study import command_line, table, write

from texclass.baselines.baseline_worker.baselines import band_energies
from texclass.baselines.comparison import every_channel
from texclass.evaluation import cut_windows
from texclass.evaluation.accuracy import clustered_t, sum_clusters
from texclass.evaluation.feature_table import metadata
from texclass.evaluation.protocols import find_protocol
from texclass.evaluation.splits import runs
from texclass.evaluation.windows import Window
from texclass.loaders import open_dataset
from texclass.loaders.places import DataNotFoundError
from texclass.reporting.figure_style import new_figure

DATASETS = {"borealtc": 5.0, "dogsurf": 5.0, "floors10": 5.0, "biotac20": 1.0, "simulated": 1.0}
"""Length of the windows in s."""
N_FOLDS, SEEDS = 5, (0, 1, 2)
CLASSIFIERS = {
    "nearest neighbour": lambda: KNeighborsClassifier(1),
    "LDA": lambda: LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto"),
    "random forest": lambda: RandomForestClassifier(200, random_state=0),
}
N_WINDOWS = (2, 4, 8, 16)
"""Numbers of windows per recording (or run)."""


def described(name: str, seconds: float) -> tuple[np.ndarray, pd.DataFrame, str]:
    """Return band energies of every window, the labels with the run of each window, and the input hash."""
    dataset = cut_windows(open_dataset(name), seconds)
    entries = [e for e in dataset.entries if not (isinstance(e, Window) and e.problem)]
    frame = metadata(entries)
    rows = []
    for entry in entries:
        recording = dataset.load(entry)
        rows.append(np.concatenate([band_energies(axis, recording.fs) for axis in every_channel(recording)]))
    return np.array(rows), frame.assign(run=runs(frame).to_numpy()), dataset.input_hash


def hits_of(classifier: Any, X: np.ndarray, frame: pd.DataFrame, protocol: str) -> np.ndarray:
    """Return the share of correct predictions of each window over the seeds."""
    y = frame["surface"].to_numpy(dtype=str)
    hits = np.zeros((len(SEEDS), len(y)))
    for i, seed in enumerate(SEEDS):
        for train, test in find_protocol(protocol).split(frame, N_FOLDS, seed):
            model = make_pipeline(StandardScaler(), classifier()).fit(X[train], y[train])
            hits[i, test] = model.predict(X[test]) == y[test]
    return hits.mean(axis=0)


def leakage_line(name: str, title: str, X: np.ndarray, frame: pd.DataFrame) -> dict[str, Any]:
    """Return the accuracies of both splits, and their difference with an interval over runs."""
    shuffled, grouped = (
        hits_of(CLASSIFIERS[title], X, frame, one) for one in ("shuffled-windows", "grouped")
    )
    sums, n = sum_clusters(shuffled - grouped, frame["run"].to_numpy(dtype=str))
    (low, high), _ = clustered_t(sums, n)
    return {
        "dataset": name, "classifier": title, "n_windows": len(frame), "n_runs": int(frame["run"].nunique()),
        "shuffled": float(shuffled.mean()), "grouped": float(grouped.mean()),
        "leakage": float((shuffled - grouped).mean()), "low": low, "high": high,
    }  # fmt: skip


def neighbour_line(name: str, X: np.ndarray, frame: pd.DataFrame) -> dict[str, Any]:
    """Return how often the nearest other window is from the same run, and how often by chance.

    By chance: the share of the other windows of the same surface that are from the same run.
    """
    Z = StandardScaler().fit_transform(X)
    nearest = NearestNeighbors(n_neighbors=2).fit(Z).kneighbors(Z, return_distance=False)[:, 1]
    run, surface = frame["run"].to_numpy(), frame["surface"].to_numpy()
    n_run = pd.Series(run).groupby(run).transform("size").to_numpy() - 1
    n_surface = pd.Series(surface).groupby(surface).transform("size").to_numpy() - 1
    return {
        "dataset": name,
        "same_run": float((run[nearest] == run).mean()),
        "by_chance": float((n_run / n_surface).mean()),
    }


def first_windows(frame: pd.DataFrame, n: int) -> np.ndarray:
    """Return the rows of n windows of each run, spread evenly; runs with fewer windows are left out."""
    groups = [np.asarray(rows) for rows in frame.groupby("run", sort=False).indices.values()]
    rows = [group[np.linspace(0, len(group) - 1, n).astype(int)] for group in groups if len(group) >= n]
    return np.sort(np.concatenate(rows)) if rows else np.empty(0, dtype=np.intp)


def draw(lines: list[dict[str, Any]]) -> Figure:
    """Draw the leakage against the number of windows per run."""
    figure, axes = new_figure(6.0, 3.0)
    for name, rows in pd.DataFrame(lines).groupby("dataset", sort=False):
        axes.plot(rows["n_per_run"], 100 * rows["leakage"], marker="o", label=name)
    axes.axhline(0, linewidth=0.8)
    axes.set_xscale("log", base=2)
    axes.set_xticks(N_WINDOWS, [str(n) for n in N_WINDOWS])
    axes.set_xlabel("windows per recording or run")
    axes.set_ylabel("leakage (percentage points)")
    axes.legend(frameon=False)
    return figure


def main() -> None:
    """Compare both splits on each dataset."""
    args = command_line(__doc__, datasets=tuple(DATASETS))
    lines, neighbours, curves, hashes = [], [], [], {}
    for name in args.datasets:
        try:
            X, frame, hashes[name] = described(name, DATASETS[name])
        except DataNotFoundError as absent:
            print(absent)
            continue
        lines += [leakage_line(name, title, X, frame) for title in CLASSIFIERS]
        neighbours.append(neighbour_line(name, X, frame))
        for n in N_WINDOWS:
            rows = first_windows(frame, n)
            part = frame.iloc[rows].reset_index(drop=True)
            if len(rows) and part.groupby("surface")["run"].nunique().min() >= N_FOLDS:
                line = leakage_line(name, "nearest neighbour", X[rows], part)
                curves.append(line | {"n_per_run": n})
        print(pd.DataFrame(lines), flush=True)
    result = {
        "name": "shuffled_windows", "n_folds": N_FOLDS, "seed": list(SEEDS), "window_s": DATASETS,
        "lines": lines, "neighbours": neighbours, "curves": curves, "input_hash": hashes,
    }  # fmt: skip
    interval = "{low} to {high}"
    shown = [
        line
        | {key: f"{100 * line[key]:.1f}" for key in ("shuffled", "grouped", "leakage", "low", "high")}
        | {"window": f"{DATASETS[line['dataset']]:g}"}
        for line in lines
    ]
    blocks = [
        "A published accuracy often comes from windows that were drawn at random, so that windows of one "
        "recording are in the training set and in the test set. They share the place, the speed, the force "
        "and the state of the sensor. The accuracy then includes the recognition of the recording. This adds "
        "much where the nearest other window is from the same recording far more often than by chance "
        "(second table), and little elsewhere.",
        table(
            shown,
            "dataset = {dataset} | classifier = {classifier} | window s = {window} | windows = {n_windows} | "
            "recordings or runs = {n_runs} | shuffled % = {shuffled} | whole runs % = {grouped} | "
            f"leakage (points) = {{leakage}} | 95 % interval = {interval}",
            "Leakage: accuracy of shuffled windows minus accuracy of whole recordings (or runs), mean of "
            "three draws of five folds; intervals over runs, paired.",
            n_words=2,
        ),
        table(
            [
                {key: f"{100 * v:.1f}" if isinstance(v, float) else v for key, v in line.items()}
                for line in neighbours
            ],
            "dataset = {dataset} | nearest window of the same run % = {same_run} | by chance % = {by_chance}",
            "Nearest other window in band energies. By chance: share of the other windows of the same "
            "surface that are from the same run.",
        ),
        table(
            [
                {"dataset": line["dataset"], "n_per_run": line["n_per_run"], "n_runs": line["n_runs"]}
                | {key: f"{100 * line[key]:.1f}" for key in ("shuffled", "grouped", "leakage", "low", "high")}
                for line in curves
            ],
            "dataset = {dataset} | windows per run = {n_per_run} | runs = {n_runs} | "
            "shuffled % = {shuffled} | whole runs % = {grouped} | leakage (points) = {leakage} | "
            f"95 % interval = {interval}",
            "Nearest neighbour with a fixed number of windows per run, spread evenly over the run.",
        ),
    ]
    write(args.out, "shuffled_windows", result, "What shuffled windows hide", blocks, draw(curves))


if __name__ == "__main__":
    main()
