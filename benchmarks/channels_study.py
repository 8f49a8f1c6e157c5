"""Slow sensors with several channels: accuracy gained by shapes and pairs, compared with MiniRocket.

Run it by hand from the project's root: `python benchmarks/channels_study.py --baselines-python PATH`, with
the interpreter of an environment that has aeon. It writes reports/studies/channels.json. Windows of
5 s; folds grouped by run, drawn `--draws` times (seeds 0, 1, ...). The figure is the balanced accuracy, the
mean of the draws; its interval, and that of a difference on the same windows, draws runs anew within each
surface. No recording of either data set is in this project: one that is absent is left out.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from study import command_line, interval, table, timed, write

from texclass.baselines.baseline_worker.run import write_task
from texclass.baselines.comparison import same_signals
from texclass.baselines.worker_process import run_worker
from texclass.evaluation import cached_table, cut_windows, load_pipeline
from texclass.evaluation.pipeline import MatchedRow
from texclass.evaluation.protocols import find_protocol
from texclass.features.phase_view import separate_channels
from texclass.features.plan import Plan
from texclass.loaders import open_dataset
from texclass.loaders.places import DataNotFoundError

SECONDS, N_FOLDS, N_RESAMPLED, N_TIMED = 5.0, 5, 2000, 60
FIRST, LAST = "Bands", "Bands, shape and pairs of channels"


def resampled(hits: np.ndarray, surfaces: np.ndarray, runs: np.ndarray) -> dict[str, float]:
    """Return the mean over surfaces of the mean of `hits` (n_windows,), with an interval over runs."""
    sums = pd.DataFrame({"surface": surfaces, "run": runs, "hits": hits, "n": 1.0})
    by_run = sums.groupby(["surface", "run"])[["hits", "n"]].sum()
    rng, means = np.random.default_rng(0), []
    for _, group in by_run.groupby("surface"):
        indices = rng.integers(len(group), size=(N_RESAMPLED, len(group)))
        drawn = group.to_numpy()[indices].sum(axis=1)
        means.append(np.append(drawn[:, 0] / drawn[:, 1], group["hits"].sum() / group["n"].sum()))
    balanced = np.mean(means, axis=0)
    low, high = np.quantile(balanced[:-1], [0.025, 0.975])
    return {"accuracy": float(balanced[-1]), "low": float(low), "high": float(high)}


def of_baseline(
    signals: list[Any], labels: Any, splits: Any, fs: float, args: Any
) -> Iterator[tuple[int, Any]]:
    """Yield (fold, predicted class numbers, CPU seconds of features of a window) of MiniRocket and ridge."""
    with tempfile.TemporaryDirectory(prefix="texclass-channels-") as folder:
        task = Path(folder) / "task"
        write_task(task, signals, labels, splits, fs, 0)
        outcome = run_worker(
            Path(args.baselines_python), task, "minirocket", Path(folder) / "out", args.limit_s
        )
    if outcome["status"] != "done":
        print("MiniRocket:", outcome["status"], outcome["message"])
    for k, fold in enumerate(outcome["folds"]):
        yield k, (np.array(fold["classifiers"]["ridge"]["predicted"]), fold["feature_s"])


def compared(name: str, n_baseline_draws: int, args: Any) -> dict[str, Any]:
    """Return what each contestant gets on one data set."""
    windows, pipeline = cut_windows(open_dataset(name), SECONDS), load_pipeline("coarse")
    feature_table = cached_table(windows, *pipeline.needed, channels=pipeline.channels)
    names, labels = np.unique(feature_table.surfaces, return_inverse=True)
    protocol = find_protocol("grouped")
    runs = protocol.clusters(feature_table.frame)
    recordings = [windows.load(entry) for entry in windows.entries]
    apart = separate_channels(recordings[0], "all")
    hits: dict[str, list[Any]] = {}
    ms: dict[str, float] = {}
    definitions = {row.name: row for row in pipeline.rows}
    for row in (FIRST, LAST):
        plan = Plan.of(pipeline.features.restricted_to(definitions[row].features), apart)
        plan.compute(recordings[0])
        took = [timed(lambda r=r, p=plan: p.compute(r))[1] for r in recordings[:: len(recordings) // N_TIMED]]
        ms[row] = 1e3 * float(np.median(took))
    for seed in range(args.draws):
        splits = protocol.split(feature_table.frame, N_FOLDS, seed)
        for row in (FIRST, LAST):
            trial = pipeline.trial(
                MatchedRow.match(definitions[row], pipeline.features, feature_table), "kernel", feature_table
            )
            right = np.full(len(labels), np.nan)
            for (_, test), results_by_dataset in zip(splits, trial(splits).hits, strict=True):
                right[test] = results_by_dataset
            hits.setdefault(row, []).append(right)
            print(name, seed, row, resampled(right, feature_table.surfaces, runs), flush=True)
        if args.baselines_python and seed < n_baseline_draws:
            right = np.full(len(labels), np.nan)
            signals = [
                same_signals(r, apart, remove_hand_motion=pipeline.features.remove_hand_motion)
                for r in recordings
            ]
            for k, (predicted, feature_s) in of_baseline(signals, labels, splits, recordings[0].fs, args):
                right[splits[k][1]] = predicted == labels[splits[k][1]]
                ms["MiniRocket"] = 1e3 * feature_s
            if np.isfinite(right).all():
                hits.setdefault("MiniRocket", []).append(right)
                print(name, seed, "MiniRocket", resampled(right, feature_table.surfaces, runs), flush=True)
    lines = []
    for contestant, drawn in hits.items():
        line = {"contestant": contestant, "n_draws": len(drawn), "feature_ms": ms[contestant]}
        line |= resampled(np.mean(drawn, axis=0), feature_table.surfaces, runs)
        line["draws"] = [resampled(one, feature_table.surfaces, runs)["accuracy"] for one in drawn]
        ahead = np.mean([ours - one for ours, one in zip(hits[LAST], drawn, strict=False)], axis=0)
        line["behind"] = resampled(ahead, feature_table.surfaces, runs)
        lines.append(line)
    return {
        "dataset": name, "n_windows": len(labels), "n_runs": len(set(runs)), "surfaces": names.tolist(),
        "lines": lines, "input_hash": windows.input_hash,
    }  # fmt: skip


def main() -> None:
    """Compare on each data set; write the report after each."""
    args = command_line(__doc__, draws=3, limit_s=3600.0, baselines_python="", baseline_draws=(3, 3))
    results_by_dataset = []
    for name, n_baseline_draws in zip(("borealtc", "dogsurf"), args.baseline_draws, strict=True):
        try:
            results_by_dataset.append(compared(name, n_baseline_draws, args))
        except DataNotFoundError as absent:
            print(absent)
            continue
        rows = [{**line, "dataset": one["dataset"]} for one in results_by_dataset for line in one["lines"]]
        for row in rows:
            row["right"] = interval(row)
            row["ahead"] = "" if row["contestant"] == LAST else interval(row["behind"])
            row["each"] = ", ".join(f"{100 * a:.1f}" for a in row["draws"])
        result = {
            "name": "channels", "seconds": SECONDS, "n_folds": N_FOLDS, "found": results_by_dataset,
            "seed": 0,
            "input_hash": {one["dataset"]: one["input_hash"] for one in results_by_dataset},
        }  # fmt: skip
        blocks = [
            table(
                rows,
                "dataset = {dataset} | features, classifier = {contestant} | draws = {n_draws} | "
                "balanced % [95 %] = {right} | each draw = {each} | last row ahead by [95 %] = {ahead} | "
                "features ms = {feature_ms:.2f}",
                n_words=2,
            ),
            f"Windows of {SECONDS:g} s, {N_FOLDS} folds grouped by run, drawn by seeds 0, 1, ...; rows "
            "of the pipeline `coarse` with its kernel discriminant; MiniRocket (10,000 kernels) with "
            "ridge on the same signals. Intervals: runs drawn anew within each surface, 2000 times; "
            "differences are of the same windows in the draws that both have. Milliseconds of one "
            "window, one thread, CPU time. Both cards remove the resting level of the acceleration, and "
            "with it the tilt of the robot.",
        ]
        title = "Several channels of a slow sensor: bands, shapes and pairs"
        write(args.out, "channels", result, title, blocks)


if __name__ == "__main__":
    main()
