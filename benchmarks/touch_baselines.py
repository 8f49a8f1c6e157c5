"""Accuracy against seconds of touch, ours and public libraries on the same windows and folds.

Run it by hand from the project's root: `python benchmarks/touch_baselines.py --baselines-python PATH`, with
the interpreter of an environment that has the extra `baselines`. It writes
reports/studies/touch_baselines_<dataset>.json and .png. Training windows and test windows are the first few
(`--touches`) of each recording; recordings are split as the protocol says, so no recording is on both sides.
Intervals count recordings, not windows. `--whole-s`: where whole movements stand in the figure.
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
    """Draw a line for each tool, ours being one: its best classifier at each length, with intervals."""
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    axes = figure.add_subplot()
    points = pd.DataFrame(
        {
            "tool": "texclass" if c["ours"] else c["title"],
            "seconds": part["felt_s"],
            **{key: 100 * c["accuracy"][key] for key in ("mean", "low", "high")},
        }
        for part in result["lengths"]
        for c in part["contestants"]
        if c["accuracy"]
    )
    best = points.loc[points.groupby(["tool", "seconds"], sort=False)["mean"].idxmax()]
    others = iter((OTHER, MUTED, FOURTH, THIRD))
    for name, line in best.groupby("tool", sort=False):
        ours = name == "texclass"
        look = {"color": OURS if ours else next(others), "lw": 2.2 if ours else 1.2, "marker": "os"[not ours]}
        away = (line["mean"] - line["low"], line["high"] - line["mean"])
        axes.errorbar(line["seconds"], line["mean"], away, capsize=2, elinewidth=0.8, label=name, **look)
    ticks = {part["felt_s"]: part["label"] for part in result["lengths"]}
    axes.set(xscale="log", xlabel="seconds of touch", ylabel="accuracy (%)")
    axes.set_xticks(list(ticks), list(ticks.values()))
    axes.minorticks_off()
    title = f"{result['dataset']}, protocol {result['protocol']}: best classifier of each tool"
    axes.set_title(title, fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="lower right", frameon=False, fontsize=8)
    return figure


def told(part: dict[str, Any], c: dict[str, Any]) -> dict[str, str]:
    """Return a row of the table: a contestant at a length."""
    row = dict.fromkeys(("tests", "classifier", "ahead", "ms", "total"), "")
    row |= {"seconds": part["label"], "tool": f"ours: {c['title']}" if c["ours"] else c["title"]}
    if not c["accuracy"]:
        return row | {"right": c["status"]}
    ahead = "reference"
    if d := c["difference"]:
        ahead = f"{100 * d['difference']:+.1f} [{100 * d['low']:+.1f}, {100 * d['high']:+.1f}]"
    return row | {
        "tests": str(part["n_tests"]),
        "classifier": c["classifier"],
        "right": interval(c["accuracy"], "mean"),
        "ahead": ahead,
        "ms": f"{c['cost']['feature_ms']:.3g}",
        "total": f"{c['cost']['total_s']:.3g}",
    }


def main() -> None:
    """Compare at every length; write the report after each, so that nothing computed is lost."""
    asked = command_line(
        __doc__, dataset="biotac20", pipeline="surfaces", protocol="chronological", touches=4, whole_s=8.0,
        baselines=BASELINES, baselines_seconds=900.0, jobs=2, baselines_python=Path, seconds=SECONDS,
    )  # fmt: skip
    dataset, pipeline, lengths = open_dataset(asked.dataset), load_pipeline(asked.pipeline), []
    settings = BaselineSettings(
        names=tuple(asked.baselines.split(",")),
        python=asked.baselines_python,
        time_limit_s=asked.baselines_seconds,
    )
    for seconds in (*asked.seconds, None):
        felt, length = dataset, {"felt_s": asked.whole_s, "label": "whole"}
        if seconds is not None:
            felt = cut_windows(dataset, seconds, per_recording=asked.touches, n_jobs=asked.jobs)
            length = {"felt_s": seconds, "label": f"{seconds:g}"}
        benchmark = run_benchmark(felt, pipeline, protocol=asked.protocol, n_jobs=asked.jobs)
        part = compare_with_baselines(felt, pipeline, benchmark, settings, n_jobs=asked.jobs).to_dict()
        lengths.append(length | {"n_tests": part["dataset"]["n_tests"], "contestants": part["contestants"]})
        result = {
            "name": f"touch_baselines_{asked.dataset}",
            "dataset": asked.dataset,
            "touches": asked.touches,
            "lengths": lengths,
            **{k: part[k] for k in ("pipeline", "protocol", "seed", "input_hash", "versions")},
            "baseline_versions": part["baseline_versions"],
        }
        blocks = [
            table(
                (told(length, c) for length in lengths for c in length["contestants"]),
                "seconds = {seconds} | tests = {tests} | tool = {tool} | classifier = {classifier} | "
                "% [95 %] = {right} | ours ahead by [95 %] = {ahead} | features ms = {ms} | "
                "total s = {total}",
                n_words=4,
            ),
            f"Pipeline `{result['pipeline']}`; the first {asked.touches} windows of each recording train and "
            "test (recordings too short for one are left out at that length). Of ours, the most accurate row "
            "on these folds and the one with the most features; of a baseline, every classifier it is given. "
            "Times are CPU seconds of one thread.",
            f"Baselines: {', '.join(f'{k} {v}' for k, v in result['baseline_versions'].items())}.",
        ]
        title = f"{asked.dataset}: accuracy against seconds of touch, ours and baselines, `{asked.protocol}`"
        write(asked.out, result["name"], result, title, blocks, draw(result))


if __name__ == "__main__":
    main()
