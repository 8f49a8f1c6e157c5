"""Accuracy against signal length, for texclass and other libraries on the same windows and folds.

Run it by hand from the project's root: `python benchmarks/window_baselines.py --baselines-python PATH`, with
the interpreter of an environment that has the extra `baselines`. It writes
reports/studies/window_baselines_<dataset>.json and .png. Training windows and test windows are the first few
(`--windows`) of each recording; the protocol splits recordings, so no recording is in both sets.
Confidence intervals are over recordings, not windows. `--whole-s`: position of whole movements in the figure.
"""

from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure
from study import command_line, interval, table, write

from texclass.baselines import BaselineSettings, compare_with_baselines
from texclass.evaluation import cut_windows, load_pipeline, run_benchmark
from texclass.loaders import open_dataset
from texclass.reporting.figure_style import FOURTH, MUTED, OTHER, OURS, THIRD

SECONDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0)
BASELINES = "mfcc,catch22,minirocket"


def draw(result: dict[str, Any]) -> Figure:
    """Draw the accuracy of the best classifier of each library at each length, with intervals."""
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    axes = figure.add_subplot()
    points = pd.DataFrame(
        {
            "tool": "texclass" if c["ours"] else c["title"],
            "seconds": comparison_data["felt_s"],
            **{key: 100 * c["accuracy"][key] for key in ("mean", "low", "high")},
        }
        for comparison_data in result["lengths"]
        for c in comparison_data["contestants"]
        if c["accuracy"]
    )
    best = points.loc[points.groupby(["tool", "seconds"], sort=False)["mean"].idxmax()]
    others = iter((OTHER, MUTED, FOURTH, THIRD))
    for name, line in best.groupby("tool", sort=False):
        ours = name == "texclass"
        look = {"color": OURS if ours else next(others), "lw": 2.2 if ours else 1.2, "marker": "os"[not ours]}
        away = (line["mean"] - line["low"], line["high"] - line["mean"])
        axes.errorbar(line["seconds"], line["mean"], away, capsize=2, elinewidth=0.8, label=name, **look)
    ticks = {comparison_data["felt_s"]: comparison_data["label"] for comparison_data in result["lengths"]}
    axes.set(xscale="log", xlabel="signal length (s)", ylabel="accuracy (%)")
    axes.set_xticks(list(ticks), list(ticks.values()))
    axes.minorticks_off()
    title = f"{result['dataset']}, protocol {result['protocol']}: best classifier of each tool"
    axes.set_title(title, fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="lower right", frameon=False, fontsize=8)
    return figure


def table_row(comparison_data: dict[str, Any], c: dict[str, Any]) -> dict[str, str]:
    """Return the table row of a library at a length."""
    row = dict.fromkeys(("tests", "classifier", "ahead", "ms", "total"), "")
    row |= {"seconds": comparison_data["label"], "tool": f"ours: {c['title']}" if c["ours"] else c["title"]}
    if not c["accuracy"]:
        return row | {"right": c["status"]}
    ahead = "reference"
    if d := c["difference"]:
        ahead = f"{100 * d['difference']:+.1f} [{100 * d['low']:+.1f}, {100 * d['high']:+.1f}]"
    return row | {
        "tests": str(comparison_data["n_tests"]),
        "classifier": c["classifier"],
        "right": interval(c["accuracy"], "mean"),
        "ahead": ahead,
        "ms": f"{c['cost']['feature_ms']:.3g}",
        "total": f"{c['cost']['total_s']:.3g}",
    }


def main() -> None:
    """Compare at every length, and write the report after each length."""
    args = command_line(
        __doc__, dataset="biotac20", pipeline="surfaces", protocol="chronological", windows=4, whole_s=8.0,
        baselines=BASELINES, baselines_seconds=900.0, jobs=2, baselines_python=Path, seconds=SECONDS,
    )  # fmt: skip
    dataset, pipeline, lengths = open_dataset(args.dataset), load_pipeline(args.pipeline), []
    settings = BaselineSettings(
        names=tuple(args.baselines.split(",")),
        python=args.baselines_python,
        time_limit_s=args.baselines_seconds,
    )
    for seconds in (*args.seconds, None):
        windows, length = dataset, {"felt_s": args.whole_s, "label": "whole"}
        if seconds is not None:
            windows = cut_windows(dataset, seconds, per_recording=args.windows, n_jobs=args.jobs)
            length = {"felt_s": seconds, "label": f"{seconds:g}"}
        benchmark = run_benchmark(
            windows, pipeline, protocol=args.protocol, nested_cv=False, n_jobs=args.jobs
        )
        comparison_data = compare_with_baselines(
            windows, pipeline, benchmark, settings, n_jobs=args.jobs
        ).to_dict()
        lengths.append(
            length
            | {
                "n_tests": comparison_data["dataset"]["n_tests"],
                "contestants": comparison_data["contestants"],
            }
        )
        result = {
            "name": f"window_baselines_{args.dataset}",
            "dataset": args.dataset,
            "windows": args.windows,
            "lengths": lengths,
            **{k: comparison_data[k] for k in ("pipeline", "protocol", "seed", "input_hash", "versions")},
            "baseline_versions": comparison_data["baseline_versions"],
        }
        blocks = [
            table(
                (table_row(length, c) for length in lengths for c in length["contestants"]),
                "seconds = {seconds} | tests = {tests} | tool = {tool} | classifier = {classifier} | "
                "% [95 %] = {right} | ours ahead by [95 %] = {ahead} | features ms = {ms} | "
                "total s = {total}",
                n_words=4,
            ),
            f"Pipeline `{result['pipeline']}`; the first {args.windows} windows of each recording train and "
            "test (recordings too short for one are left out at that length). Of ours, the most accurate row "
            "on these folds and the one with the most features; of a baseline, every classifier it is given. "
            "Times are CPU seconds of one thread.",
            f"Baselines: {', '.join(f'{k} {v}' for k, v in result['baseline_versions'].items())}.",
        ]
        title = f"{args.dataset}: accuracy against signal length, texclass and baselines, `{args.protocol}`"
        write(args.out, result["name"], result, title, blocks, draw(result))


if __name__ == "__main__":
    main()
