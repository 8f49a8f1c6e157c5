"""Which terrain a robot drives on, against the seconds it has driven (`reports/studies/borealtc-driven`).

Run it by hand from the project's root: `python tests/benchmarks/borealtc_driven.py [--draws N]`. Pipeline
`coarse` with its kernel discriminant, windows of 5 s, one each second, folds grouped by run as protocol
`run` draws them. Each fold's classifier is calibrated on runs held out of its training part, so no run that
is tested has been seen in any way. Evidence is that of the online recogniser.
"""

# ruff: noqa: E402  (the number of threads is set before numpy reads it)
import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import json
import warnings
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from sklearn.base import clone

from texclass.experiment import touches
from texclass.experiment.accuracy import wilson_interval
from texclass.experiment.feature_table import cached_table
from texclass.experiment.pipeline import PipelineDefinition, load_pipeline
from texclass.experiment.protocols import find_protocol, runs
from texclass.loaders import open_dataset
from texclass.provenance import versions
from texclass.recognition import Answer, Evidence, expected_calibration_error, fit_calibration
from texclass.recognition.probabilities import class_scores
from texclass.recording import Samples

ROOT = Path(__file__).resolve().parents[2]
WINDOW_S, HOP_S = 5.0, 1.0
N_FOLDS, N_INNER = 5, 4
SECONDS = (5, 6, 7, 8, 10, 12, 15, 20, 25, 30, 40, 60)
KINDS = ("sequential", "majority")


def probabilities(frame: pd.DataFrame, X: Samples, pipeline: PipelineDefinition, seed: int) -> Samples:
    """Return calibrated probabilities (n, n_classes) of windows by a classifier that never saw their run."""
    y, run, protocol = frame["material"].to_numpy(str), runs(frame).to_numpy(), find_protocol("run")
    classes, labels = np.unique(y, return_inverse=True)
    P = np.zeros((len(frame), len(classes)))
    single = np.flatnonzero(_apart(frame))  # folds as for windows that do not overlap
    for train, test in protocol.split(frame.iloc[single].reset_index(drop=True), N_FOLDS, seed):
        known = np.isin(run, run[single[train]])
        asked = np.isin(run, run[single[test]])
        inner = frame.iloc[single[train]].reset_index(drop=True)
        scores, right = [], []
        for a, b in protocol.split(inner, N_INNER, seed + 1):
            seen = np.isin(run, run[single[train][a]])
            scores.append(_scores(pipeline, X[seen], y[seen], X[single[train][b]]))
            right.append(labels[single[train][b]])
        calibration = fit_calibration(np.concatenate(scores), np.concatenate(right))
        P[asked] = calibration(_scores(pipeline, X[known], y[known], X[asked]))
    return P


def _apart(frame: pd.DataFrame) -> Any:
    """Return which windows are every fifth of their recording, shape (n,)."""
    number = frame["recording_id"].str.rpartition("#")[2].astype(int)
    return (number - 1) % round(WINDOW_S / HOP_S) == 0


def _scores(pipeline: PipelineDefinition, X: Samples, y: Any, asked: Samples) -> Samples:
    prepare = clone(pipeline.preparation(pipeline.rows[0], "kernel")).fit(X, y)
    classifier = pipeline.classifiers["kernel"].make().fit(prepare.transform(X), y)
    return class_scores(classifier, prepare.transform(asked))


def driven(frame: pd.DataFrame, P: Samples) -> dict[str, Any]:
    """Return accuracy after so many seconds of each run, and at its end."""
    y, run = frame["material"].to_numpy(str), runs(frame).to_numpy()
    classes = tuple(np.unique(y).tolist())
    found: dict[str, Any] = {}
    for kind in KINDS:
        verdicts: dict[Any, list[tuple[bool, float]]] = {}
        for one in pd.unique(run):
            evidence: Any = Evidence(classes, kind, window_s=WINDOW_S, hop_s=HOP_S)  # type: ignore[arg-type]
            rows = np.flatnonzero(run == one)
            told = [evidence.add(_answer(classes, P[i]), WINDOW_S + HOP_S * k) for k, i in enumerate(rows)]
            verdicts[one] = [(v.surface == y[rows[0]], v.probability) for v in told]
        found[kind] = {
            "curve": [_after(list(verdicts.values()), s) for s in SECONDS],
            "run": _point([v[-1] for v in verdicts.values()]),
            "wrong": sorted(str(one) for one, v in verdicts.items() if not v[-1][0]),
        }
    hits = P.argmax(axis=1) == np.searchsorted(classes, y)
    found["window"] = float(hits.mean())
    found["calibration_error"] = expected_calibration_error(P.max(axis=1), hits)
    return found


def _answer(classes: tuple[str, ...], p: Samples) -> Answer:
    best, second = np.argsort(-p)[:2]
    named = dict(zip(classes, p.tolist(), strict=True))
    return Answer("window", classes[best], float(p[best]), classes[second], False, 1.0, (), named)


def _after(verdicts: list[list[tuple[bool, float]]], seconds: float) -> dict[str, Any]:
    """Return the accuracy of the runs that are so long, and of all runs with shorter ones at their end."""
    k = round((seconds - WINDOW_S) / HOP_S)
    long = [v[k] for v in verdicts if len(v) > k]
    every = [v[min(k, len(v) - 1)] for v in verdicts]
    return {"seconds": seconds, "n_long": len(long), **_point(every)}


def _point(told: list[tuple[bool, float]]) -> dict[str, Any]:
    hits = sum(hit for hit, _ in told)
    low, high = wilson_interval(hits, len(told))
    return {"n": len(told), "hits": hits, "accuracy": hits / len(told), "low": low, "high": high}


def figure(draws: list[dict[str, Any]], path: Path) -> None:
    """Draw the curves of the first draw of folds, and the others thin."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    fig, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
    for kind, colour in zip(KINDS, ("C0", "C1"), strict=True):
        for i, draw in enumerate(draws):
            curve = draw[kind]["curve"]
            y = [100 * point["accuracy"] for point in curve]
            axes.plot(
                SECONDS, y, colour, lw=2 if i == 0 else 0.6, label=kind if i == 0 else None, zorder=3 - i
            )
        first = draws[0][kind]["curve"]
        if kind == "sequential":
            low, high = ([100 * point[edge] for point in first] for edge in ("low", "high"))
            axes.fill_between(SECONDS, low, high, color=colour, alpha=0.12, lw=0, label="95 % over runs")
    axes.set(xlabel="Seconds driven", ylabel="Runs right (%)", xscale="log", ylim=(80, 100))
    axes.set_xticks(SECONDS[::2], [str(s) for s in SECONDS[::2]])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    fig.savefig(path, dpi=120)
    plt.close(fig)


def markdown(result: dict[str, Any]) -> str:
    """Return the report."""
    draws, first = result["draws"], result["draws"][0]
    runs_right = {kind: [f"{100 * d[kind]['run']['accuracy']:.1f}" for d in draws] for kind in KINDS}
    lines = [
        "# Terrain against seconds driven (`borealtc`)",
        "",
        f"{result['n_runs']} runs, {result['n_windows']} windows of {WINDOW_S:g} s, one each {HOP_S:g} s, "
        f"resting level removed; {N_FOLDS} folds grouped by run; pipeline `coarse`, kernel discriminant "
        f"trained on all windows of the training runs; calibrated on {N_INNER} inner folds grouped by run.",
        "",
        f"Evidence over the whole run: **{runs_right['sequential'][0]} %** of the runs by the mean log "
        f"posterior, {runs_right['majority'][0]} % by majority (draws of the folds with seeds 0, 1, ...: "
        f"{', '.join(runs_right['sequential'])} and {', '.join(runs_right['majority'])}). Single windows: "
        f"{', '.join(format(100 * d['window'], '.1f') for d in draws)} %, calibration error "
        f"{', '.join(format(d['calibration_error'], '.3f') for d in draws)}. Windows weigh alike: "
        "chosen after another weighting had been seen on these runs, so the figure is a little too high. "
        "Wrong runs of the first draw: "
        f"{', '.join(first['sequential']['wrong'])}.",
        "",
        "![Accuracy against seconds driven](borealtc-driven.png)",
        "",
        "| seconds | runs as long | sequential % [95 %] | majority % [95 %] |",
        "|---:|---:|---|---|",
    ]
    for s, m in zip(first["sequential"]["curve"], first["majority"]["curve"], strict=True):
        told = [f"{100 * p['accuracy']:.1f} [{100 * p['low']:.1f}, {100 * p['high']:.1f}]" for p in (s, m)]
        lines.append(f"| {s['seconds']} | {s['n_long']} | {told[0]} | {told[1]} |")
    stated = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    return "\n".join([
        *lines, "", "Runs that are shorter count with what was known at their end.", "",
        f"Input hash `{result['input_hash']}`, seeds 0 to {len(draws) - 1}. Versions: {stated}.", "",
    ])  # fmt: skip


def main() -> None:
    """Compute and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "studies")
    asked = parser.parse_args()
    pipeline, dataset = load_pipeline("coarse"), open_dataset("borealtc")
    windows = touches(dataset, WINDOW_S, step=HOP_S)
    table = cached_table(windows, *pipeline.needed, channels=pipeline.channels, n_jobs=1, skip_bad=True)
    X, draws = table.frame[list(table.columns)].to_numpy(dtype=np.float64), []
    for seed in range(asked.draws):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            draws.append(driven(table.frame, probabilities(table.frame, X, pipeline, seed)))
        print(seed, draws[-1]["window"], *(draws[-1][kind]["run"]["accuracy"] for kind in KINDS), flush=True)
        result = {
            "draws": draws, "n_runs": int(runs(table.frame).nunique()), "n_windows": len(table.frame),
            "input_hash": dataset.input_hash, "versions": versions("numpy", "scipy", "scikit-learn"),
        }  # fmt: skip
        (asked.out / "borealtc-driven.json").write_text(json.dumps(result, indent=1, sort_keys=True) + "\n")
        (asked.out / "borealtc-driven.md").write_text(markdown(result))
        figure(draws, asked.out / "borealtc-driven.png")


if __name__ == "__main__":
    main()
