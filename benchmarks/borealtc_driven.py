"""Accuracy of terrain classification against seconds driven (`reports/studies/borealtc-driven`).

Run it by hand from the project's root: `python benchmarks/borealtc_driven.py [--draws N]`. Pipeline
`coarse` with its kernel discriminant, windows of 5 s, one each second, folds of the protocol
`grouped`. Each fold's classifier is calibrated on runs held out of its training part, so no run that is
tested has been seen in any way. Evidence is that of the online recogniser.
"""

import warnings
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from sklearn.base import clone
from study import command_line, interval, table, write

from texclass.evaluation import (
    PipelineDefinition,
    cached_table,
    cut_windows,
    find_protocol,
    load_pipeline,
    wilson_interval,
)
from texclass.evaluation.splits import runs
from texclass.loaders import open_dataset
from texclass.recognition import Answer, Evidence, expected_calibration_error, fit_calibration
from texclass.recognition.probabilities import class_scores
from texclass.recording import Samples

WINDOW_S, HOP_S = 5.0, 1.0
N_FOLDS, N_INNER = 5, 4
SECONDS = (5, 6, 7, 8, 10, 12, 15, 20, 25, 30, 40, 60)
KINDS = ("sequential", "majority")


def probabilities(frame: pd.DataFrame, X: Samples, pipeline: PipelineDefinition, seed: int) -> Samples:
    """Return calibrated probabilities (n, n_classes) of windows by a classifier that never saw their run."""
    y, run, protocol = frame["surface"].to_numpy(str), runs(frame).to_numpy(), find_protocol("grouped")
    classes, labels = np.unique(y, return_inverse=True)
    number = frame["recording_id"].str.rpartition("#")[2].astype(int)
    single = np.flatnonzero((number - 1) % round(WINDOW_S / HOP_S) == 0)
    P = np.zeros((len(frame), len(classes)))

    def scores(train_rows: Any, test_rows: Any) -> Samples:
        prepare = clone(pipeline.preparation(pipeline.rows[0], "kernel")).fit(X[train_rows], y[train_rows])
        classifier = (
            pipeline.classifiers["kernel"].make().fit(prepare.transform(X[train_rows]), y[train_rows])
        )
        return class_scores(classifier, prepare.transform(X[test_rows]))

    # Folds as for windows that do not overlap.
    for train, test in protocol.split(frame.iloc[single].reset_index(drop=True), N_FOLDS, seed):
        train_rows, test_rows = (np.isin(run, run[single[part]]) for part in (train, test))
        inner = frame.iloc[single[train]].reset_index(drop=True)
        decision_values, right = [], []
        for a, b in protocol.split(inner, N_INNER, seed + 1):
            decision_values.append(scores(np.isin(run, run[single[train][a]]), single[train][b]))
            right.append(labels[single[train][b]])
        calibration = fit_calibration(np.concatenate(decision_values), np.concatenate(right))
        P[test_rows] = calibration(scores(train_rows, test_rows))
    return P


def driven(frame: pd.DataFrame, P: Samples) -> dict[str, Any]:
    """Return accuracy after so many seconds of each run, and at its end.

    Shorter runs count with their last prediction.
    """
    y, run = frame["surface"].to_numpy(str), runs(frame).to_numpy()
    classes = tuple(np.unique(y).tolist())
    hits = P.argmax(axis=1) == np.searchsorted(classes, y)
    summary: dict[str, Any] = {
        "window": hits.mean(),
        "calibration_error": expected_calibration_error(P.max(axis=1), hits),
    }
    for kind in KINDS:
        right: dict[Any, list[bool]] = {}
        for one in pd.unique(run):
            evidence = Evidence(classes, kind, window_s=WINDOW_S, hop_s=HOP_S)
            right[one] = []
            for k, i in enumerate(np.flatnonzero(run == one)):
                best, second = np.argsort(-P[i])[:2]
                probability = dict(zip(classes, P[i].tolist(), strict=True))
                answer = Answer(
                    "window", classes[best], float(P[i][best]), classes[second], False, 1.0, (), probability
                )
                right[one].append(evidence.add(answer, WINDOW_S + HOP_S * k).surface == y[i])
        last = {s: round((s - WINDOW_S) / HOP_S) for s in SECONDS}
        summary[kind] = {
            "curve": [
                {
                    "seconds": s,
                    "n_long": sum(len(r) > k for r in right.values()),
                    **share([r[min(k, len(r) - 1)] for r in right.values()]),
                }
                for s, k in last.items()
            ],
            "run": share([r[-1] for r in right.values()]),
            "wrong": sorted(str(one) for one, r in right.items() if not r[-1]),
        }
    return summary


def share(hits: list[bool]) -> dict[str, Any]:
    """Return the share of hits with its interval."""
    low, high = wilson_interval(sum(hits), len(hits))
    return {"n": len(hits), "hits": sum(hits), "accuracy": float(np.mean(hits)), "low": low, "high": high}


def draw(draws: list[dict[str, Any]]) -> Figure:
    """Draw the curves of the first draw of folds, and the others thin."""
    figure = Figure(figsize=(6.4, 4), layout="constrained")
    axes = figure.add_subplot()
    for kind, colour in zip(KINDS, ("C0", "C1"), strict=True):
        curves = [100 * pd.DataFrame(each[kind]["curve"])[["accuracy", "low", "high"]] for each in draws]
        for i, curve in enumerate(curves):
            axes.plot(
                SECONDS,
                curve["accuracy"],
                colour,
                lw=0.6 if i else 2,
                label=None if i else kind,
                zorder=3 - i,
            )
        if kind == "sequential":
            low, high = curves[0]["low"], curves[0]["high"]
            axes.fill_between(SECONDS, low, high, color=colour, alpha=0.12, lw=0, label="95 % over runs")
    axes.set(xlabel="Seconds driven", ylabel="Runs right (%)", xscale="log", ylim=(80, 100))
    axes.set_xticks(SECONDS[::2], [str(s) for s in SECONDS[::2]])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    return figure


def main() -> None:
    args = command_line(__doc__, draws=3)
    pipeline, dataset = load_pipeline("coarse"), open_dataset("borealtc")
    windows = cut_windows(dataset, WINDOW_S, step=HOP_S)
    features = cached_table(windows, *pipeline.needed, channels=pipeline.channels, n_jobs=1, skip_bad=True)
    frame, draws = features.frame, []
    X = frame[list(features.columns)].to_numpy(dtype=np.float64)
    for seed in range(args.draws):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            draws.append(driven(frame, probabilities(frame, X, pipeline, seed)))
        result = {
            "draws": draws,
            "n_runs": int(runs(frame).nunique()),
            "n_windows": len(frame),
            "input_hash": dataset.input_hash,
        }
        first = draws[0]
        whole = {kind: [f"{100 * each[kind]['run']['accuracy']:.1f}" for each in draws] for kind in KINDS}
        curves = zip(first["sequential"]["curve"], first["majority"]["curve"], strict=True)
        blocks = [
            f"{result['n_runs']} runs, {len(frame)} windows of {WINDOW_S:g} s, one each {HOP_S:g} s, "
            f"resting level removed; {N_FOLDS} folds grouped by run; pipeline `coarse`, kernel discriminant "
            f"trained on all windows of the training runs; calibrated on {N_INNER} inner folds, "
            "grouped by run, too.",
            f"Evidence over the whole run: **{whole['sequential'][0]} %** of the runs by the mean log "
            f"posterior, {whole['majority'][0]} % by majority (draws of the folds with seeds 0, 1, ...: "
            f"{', '.join(whole['sequential'])} and {', '.join(whole['majority'])}). Single windows: "
            f"{', '.join(format(100 * each['window'], '.1f') for each in draws)} %, calibration error "
            f"{', '.join(format(each['calibration_error'], '.3f') for each in draws)}. Windows weigh alike: "
            "chosen after another weighting had been seen on these runs, so the figure is a little too high. "
            f"Wrong runs of the first draw: {', '.join(first['sequential']['wrong'])}.",
            table(
                ({**s, "own": interval(s), "other": interval(m)} for s, m in curves),
                "seconds = {seconds} | runs as long = {n_long} | sequential % [95 %] = {own} | "
                "majority % [95 %] = {other}",
                "Runs that are shorter count with what was known at their end.",
            ),
        ]
        title = "Terrain against seconds driven (`borealtc`)"
        write(args.out, "borealtc-driven", result, title, blocks, draw(draws))


if __name__ == "__main__":
    main()
