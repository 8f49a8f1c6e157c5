"""Accuracy against seconds of touch, ours and public libraries on the same windows and folds.

Run it by hand from the project's root: `python tests/benchmarks/touch_peers.py --peers-python PATH`, with
the interpreter of an environment that has the extra `peers`. It writes
reports/studies/touch_peers_<dataset>.json, .md and .png. Training windows and test windows are the first few
of each recording; recordings are split as the protocol says, so no recording is on both sides. Intervals
count recordings, not windows.
"""

import argparse
import json
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from texclass.experiment import load_pipeline, run_benchmark
from texclass.experiment.windows import touches
from texclass.loaders import open_dataset
from texclass.loaders.dataset import Dataset
from texclass.peers import PeerComparison, PeerSettings, compare_with_peers

ROOT = Path(__file__).resolve().parents[2]
SECONDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0)
PEERS = ("mfcc", "catch22", "minirocket")


def at(seconds: float | None, dataset: Dataset, options: argparse.Namespace) -> PeerComparison:
    """Compare at one length of touch; whole movements where it is None."""
    pipeline = load_pipeline(options.pipeline)
    felt = dataset
    if seconds is not None:
        felt = touches(dataset, seconds, per_recording=options.touches, n_jobs=options.jobs)
    result = run_benchmark(felt, pipeline, protocol=options.protocol, n_jobs=options.jobs)
    settings = PeerSettings(
        names=tuple(options.peers.split(",")), python=options.peers_python, time_limit_s=options.peers_seconds
    )
    return compare_with_peers(felt, pipeline, result, settings, n_jobs=options.jobs)


def lines_of(found: list[dict[str, Any]]) -> dict[str, list[tuple[float, dict[str, Any]]]]:
    """Return (seconds, contestant) of each tool: its best classifier at that length; ours is one tool."""
    lines: dict[str, list[tuple[float, dict[str, Any]]]] = {}
    for part in found:
        best: dict[str, dict[str, Any]] = {}
        for contestant in part["contestants"]:
            name = "texclass" if contestant["ours"] else contestant["title"]
            ahead = contestant["accuracy"]
            if ahead and (name not in best or ahead["mean"] > best[name]["accuracy"]["mean"]):
                best[name] = contestant
        for name, contestant in best.items():
            lines.setdefault(name, []).append((part["felt_s"], contestant))
    return lines


def as_markdown(result: dict[str, Any]) -> str:
    """Return the report as Markdown."""
    found = result["lengths"]
    rows = [
        f"# {result['dataset']}: accuracy against seconds of touch, ours and peers, protocol "
        f"`{result['protocol']}`",
        "",
        f"![{result['name']}.png]({result['name']}.png)",
        "",
        "| seconds | tests | tool | classifier | % [95 %] | ours ahead by [95 %] | features ms | total s |",
        "|---:|---:|---|---|---:|---:|---:|---:|",
    ]
    for part in found:
        for c in part["contestants"]:
            if not c["accuracy"]:
                rows.append(f"| {part['label']} | | {c['title']} | | {c['status']} | | | |")
                continue
            a, d = c["accuracy"], c["difference"]
            ahead = "reference"
            if d:
                ahead = f"{100 * d['difference']:+.1f} [{100 * d['low']:+.1f}, {100 * d['high']:+.1f}]"
            told = f"{100 * a['mean']:.1f} [{100 * a['low']:.1f}, {100 * a['high']:.1f}]"
            title = f"ours: {c['title']}" if c["ours"] else c["title"]
            rows.append(
                f"| {part['label']} | {part['n_tests']} | {title} | {c['classifier']} | {told} | {ahead} "
                f"| {c['cost']['feature_ms']:.3g} | {c['cost']['total_s']:.3g} |"
            )
    rows += [
        "",
        f"Pipeline `{result['pipeline']}`; the first {result['touches']} windows of each recording train and "
        "test (recordings too short for one are left out at that length). Of ours, the most accurate row on "
        "these folds and the one with the most features; of a peer, every classifier it is given. Times are "
        "CPU seconds of one thread.",
        "",
        f"Input hash `{result['input_hash']}`, seed {result['seed']}. Versions: "
        + ", ".join(f"{k} {v}" for k, v in (result["versions"] | result["peer_versions"]).items())
        + ".",
    ]
    return "\n".join(rows) + "\n"


def draw(result: dict[str, Any]) -> Figure:
    """Draw a line for each tool, with intervals."""
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    axes = figure.add_subplot()
    styles = {"texclass": {"color": "#0b6e99", "linewidth": 2.2, "marker": "o"}}
    others = iter(("#b8651b", "#7a7a7a", "#8a5fa8", "#4f8f4f"))
    for name, points in lines_of(result["lengths"]).items():
        style = styles.get(name) or {"color": next(others), "linewidth": 1.2, "marker": "s", "markersize": 4}
        x = [seconds for seconds, _ in points]
        y = [100 * c["accuracy"]["mean"] for _, c in points]
        below = [100 * (c["accuracy"]["mean"] - c["accuracy"]["low"]) for _, c in points]
        above = [100 * (c["accuracy"]["high"] - c["accuracy"]["mean"]) for _, c in points]
        axes.errorbar(x, y, (below, above), capsize=2, elinewidth=0.8, label=name, **style)
    ticks = {part["felt_s"]: part["label"] for part in result["lengths"]}
    axes.set_xscale("log")
    axes.set_xticks(list(ticks), list(ticks.values()))
    axes.minorticks_off()
    axes.set_xlabel("seconds of touch")
    axes.set_ylabel("accuracy (%)")
    axes.set_title(
        f"{result['dataset']}, protocol {result['protocol']}: best classifier of each tool", fontsize=9
    )
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="lower right", frameon=False, fontsize=8)
    return figure


def main() -> None:
    """Compare at every length; write the report after each, so that nothing computed is lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peers-python", type=Path, required=True)
    parser.add_argument("--dataset", default="biotac20")
    parser.add_argument("--pipeline", default="multiscale")
    parser.add_argument("--protocol", default="blocks")
    parser.add_argument("--touches", type=int, default=4, help="windows of each recording")
    parser.add_argument("--seconds", type=float, nargs="*", default=SECONDS)
    parser.add_argument(
        "--whole-s", type=float, default=8.0, help="where whole movements stand in the figure"
    )
    parser.add_argument("--peers", default=",".join(PEERS))
    parser.add_argument("--peers-seconds", type=float, default=900.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "studies")
    options = parser.parse_args()
    dataset, found = open_dataset(options.dataset), []
    name = f"touch_peers_{options.dataset}"
    for seconds in (*options.seconds, None):
        comparison = at(seconds, dataset, options)
        part = comparison.to_dict()
        whole = {"felt_s": options.whole_s, "label": "whole"}
        felt = whole if seconds is None else {"felt_s": seconds, "label": f"{seconds:g}"}
        found.append(felt | {"n_tests": part["dataset"]["n_tests"], "contestants": part["contestants"]})
        result = {
            "name": name,
            "dataset": options.dataset,
            "touches": options.touches,
            "lengths": found,
            **{k: part[k] for k in ("pipeline", "protocol", "seed", "input_hash", "versions")},
            "peer_versions": part["peer_versions"],
        }
        (options.out / f"{name}.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        (options.out / f"{name}.md").write_text(as_markdown(result), encoding="utf-8")
        draw(result).savefig(options.out / f"{name}.png", dpi=150)
        print(as_markdown(result), flush=True)


if __name__ == "__main__":
    main()
