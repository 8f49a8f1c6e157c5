"""Accuracy with few recordings: all rows and the row selected by `train`, and expected accuracy.

`python benchmarks/few_recordings.py [--only SET]` (minutes, once the features are cached) writes
reports/studies/few_recordings. In each cell, a data set under a protocol with so many recordings (or runs) of
each surface, every row and classifier of some pipelines stands beside the default. Then: what recordings held
out from those made in one go promise of later ones.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from study import command_line, table, write

from texclass.evaluation import (
    PipelineDefinition,
    cached_table,
    cut_windows,
    find_protocol,
    load_pipeline,
    windows,
)
from texclass.evaluation.cost import CostMeter
from texclass.evaluation.feature_table import FeatureTable
from texclass.evaluation.folds import Evaluation, evaluate
from texclass.evaluation.pipeline import MatchedRow
from texclass.evaluation.protocols import FewShot, make_splits
from texclass.evaluation.splits import Indices, Split, runs
from texclass.loaders import open_dataset
from texclass.recognition import NoveltyDetector
from texclass.recognition.candidates import Candidate, list_candidates, without_selection
from texclass.recognition.held_out_predictions import HeldOutPredictions, predict_held_out
from texclass.recognition.holdout import LIMITS, rule_of_succession
from texclass.recognition.novelty import conservative_rate
from texclass.reporting import Heading

SEED = 11
FALSE_ALARMS = 0.05
NEAR = 1.0
"""Points that the default may lack of the best row."""
N_SHOTS = (1, 3, 10)
N_OTHERS = 600
ONE_GO = (2, 3, 5, 9)
"""Recordings of each surface in a row that train where the promise is looked at."""
CASES = (
    ("biotac20", "surfaces", ("multiscale",), None),
    ("taps5", "surfaces", ("texclass", "strese2015"), None),
    ("simulated", "surfaces", ("texclass", "multiscale"), None),
    ("borealtc", "coarse", ("coarse",), 5.0),
    ("dogsurf", "coarse", ("coarse",), 5.0),
)
"""A data set, the pipeline that `train` takes for it, those whose rows stand beside, and s of windows."""


def main() -> None:
    args = command_line(__doc__, only="")
    study_results: dict[str, list[dict[str, Any]]] = {"cells": [], "promises": []}
    hashes = {}
    for name, own, others, window_s in (case for case in CASES if args.only in ("", case[0])):
        dataset = open_dataset(name)
        hashes[name] = dataset.input_hash
        if window_s is not None:
            dataset = windows.add_overlapping_windows(
                cut_windows(dataset, window_s, n_jobs=1), load_pipeline(own).overlap
            )
        pipelines = [load_pipeline(each) for each in dict.fromkeys((own, *others))]
        tables = [cached_table(dataset, *p.needed, channels=p.channels, n_jobs=1) for p in pipelines]
        meter = CostMeter.from_dataset(
            dataset, tables[0].frame["recording_id"].tolist(), pipelines[0].channels
        )
        default, *_ = without_selection(list_candidates(pipelines[0], tables[0], meter))
        for protocol, n, splits in cells(tables[0].frame):
            cell = {"set": name, "protocol": protocol, "n": n, "n_folds": len(splits)}
            study_results["cells"].append(
                cell | compared(default, list(zip(pipelines, tables, strict=True)), splits)
            )
            print(cell, *(study_results["cells"][-1][who]["mean"] for who in ("default", "best")), flush=True)
        frame = tables[0].frame[windows.is_testable(tables[0].frame)].reset_index(drop=True)
        for n, start, trains, later in made_in_one_go(frame):
            cell_key = {"set": name, "n": n, "start": start}
            study_results["promises"].append(cell_key | promised(default, frame, trains, later, start))
    settings = {
        "seed": SEED, "input_hash": hashes,
        "near": NEAR, "false_alarms": FALSE_ALARMS,
    }  # fmt: skip
    report(study_results, settings, args.out)


def cells(frame: pd.DataFrame) -> Iterator[tuple[str, str, Sequence[Split]]]:
    """Yield protocol, number of recordings (or runs) of each surface that train, and splits of a data set."""
    if several("operator", frame) or several("session", frame):
        apart = find_protocol("operator" if several("operator", frame) else "grouped")
        splits = apart.split(frame, 5, SEED)
        unit = runs(frame)
        min_units = min(unit.iloc[a].groupby(frame["surface"].iloc[a]).nunique().min() for a, _ in splits)
        for n in (n for n in N_SHOTS if n < min_units):
            thinned_splits = [
                (thinned(frame, train, n, SEED + i), test) for i, (train, test) in enumerate(splits)
            ]
            yield apart.name, str(n), thinned_splits
        yield apart.name, "all", splits
    if not several("session", frame):
        counts = frame["surface"].value_counts()
        for n in (n for n in N_SHOTS if 2 * n <= counts.min()):
            yield "few-shot", str(n), find_protocol(f"few-shot {n}").split(frame, 1, SEED)
        yield "chronological", "all", find_protocol("chronological").split(frame, 1, SEED)


def several(label: str, frame: pd.DataFrame) -> bool:
    """Return whether recordings name several operators (sessions)."""
    return len(frame[label].dropna().unique()) > 1


def thinned(frame: pd.DataFrame, rows: Indices, n: int, seed: int) -> Indices:
    """Return the rows of n recordings (or runs) of each surface, drawn from some."""
    part = pd.DataFrame({"surface": frame["surface"], "unit": runs(frame)}).iloc[rows]
    drawn = part.drop_duplicates().groupby("surface").sample(n, random_state=seed)["unit"]
    return rows[part["unit"].isin(drawn).to_numpy()]


def compared(
    default: Candidate, offers: list[tuple[PipelineDefinition, FeatureTable]], splits: Sequence[Split]
) -> dict[str, Any]:
    """Return mean and worst accuracy, in per cent, of the default and of every row with every classifier.

    Rows that select columns are left out, and what refuses single recordings of a surface.
    """
    X, y = default.training_set(offers[0][1].frame)
    own = evaluate(X, y, splits, default.preparation, default.classifier)
    rows = []
    for pipeline, features in offers:
        for definition in (row for row in pipeline.rows if row.select is None):
            row = MatchedRow.match(definition, pipeline.features, features)
            names = definition.select_classifiers(pipeline.classifiers) if row.columns else ()
            for name in names:
                with suppress(ValueError):
                    held_out_evaluation = pipeline.trial(row, name, features)(splits)
                    rows.append(
                        {
                            "row": f"{pipeline.name}: {definition.name}, {name}",
                            **interpolation_weights(held_out_evaluation),
                        }
                    )
    name = f"{offers[0][0].name}: {default.row}, {default.classifier_name}"
    best = max((row for row in rows if row["row"] != name), key=lambda row: row["mean"])
    return {"default": {"row": name, **interpolation_weights(own)}, "best": best, "rows": rows}


def interpolation_weights(held_out_evaluation: Evaluation) -> dict[str, float]:
    """Return balanced mean and worst fold in per cent."""
    accuracy = held_out_evaluation.accuracy
    mean = accuracy.mean if accuracy.balanced is None else accuracy.balanced
    return {"mean": round(100 * mean, 2), "worst": round(100 * accuracy.worst, 2)}


def made_in_one_go(frame: pd.DataFrame) -> Iterator[tuple[int, int, Indices, Indices]]:
    """Yield recordings of each surface that were made in a row, with their number, and later (or other) ones.

    Repetitions in a row, and the later half; those of one operator, and of all others; where recordings are
    windows of runs, windows of one run in a row, and those of other runs.
    """
    for n in ONE_GO:
        if several("session", frame):
            for start in range(FewShot.n_starts):
                yield n, start, *windows_of_one_run(frame, n, SEED + start)
        elif several("operator", frame):
            for start, (others, own) in enumerate(find_protocol("operator").split(frame, 1, SEED)):
                rank = frame.iloc[own].groupby("surface").cumcount().to_numpy()
                if rank.max() + 1 >= n:
                    yield n, start, own[rank < n], others
        elif 2 * n <= frame["surface"].value_counts().min():
            splits = find_protocol(f"few-shot {n}").split(frame, 1, SEED)
            later = np.unique(np.concatenate([test for _, test in splits]))
            for start, rows in enumerate(dict.fromkeys(tuple(train) for train, _ in splits)):
                yield n, start, np.array(rows), later


def windows_of_one_run(frame: pd.DataFrame, n: int, seed: int) -> Split:
    """Return n windows in a row from one run of each surface, and at most `N_OTHERS` of the other runs."""
    rng, run, trains = np.random.default_rng(seed), runs(frame), []
    for _, of_surface in frame.groupby("surface"):
        sizes = of_surface.groupby(run).size()
        rows = of_surface.index[run[of_surface.index] == rng.choice(sizes.index[sizes >= n])]
        first = rng.integers(len(rows) - n + 1)
        trains += list(rows[first : first + n])
    others = np.flatnonzero(~run.isin(run[trains]))
    return np.array(trains), others[:: -(-len(others) // N_OTHERS)]


def promised(
    default: Candidate, frame: pd.DataFrame, trains: Indices, later: Indices, seed: int
) -> dict[str, Any]:
    """Return the expected accuracy from held-out recordings, and that of later recordings.

    A fifth of the surfaces is unknown, in two draws. The result contains the shares of unknown surfaces and
    of later recordings that are predicted as unknown, with the plain and with a wider threshold.
    """
    frame = frame.drop(columns="parent", errors="ignore")
    frame = frame.assign(recording_id=[str(i) for i in range(len(frame))])
    calibration, got = answers(default, frame, trains, later)
    surfaces, rng = frame["surface"].to_numpy(dtype=str), np.random.default_rng(seed)
    chance = 1 / len(set(surfaces))
    study_results: dict[str, Any] = {
        "promise": rule_of_succession(float(calibration.hits.mean()), len(calibration.hits)),
        "later": float(got.hits.mean()),
        "kept": (float(got.hits.mean()) - chance) / (float(calibration.hits.mean()) - chance),
    }  # fmt: skip
    alarms = []
    for _ in range(2):
        strangers = rng.permutation(np.unique(surfaces))[: max(1, len(set(surfaces)) // 5)]
        calibration, got = answers(default, frame, trains[~np.isin(surfaces[trains], strangers)], later)
        strange = np.isin(surfaces[got.rows], strangers)
        for margin, level in (
            ("plain", FALSE_ALARMS),
            ("wide", conservative_rate(FALSE_ALARMS, len(calibration.novelty), LIMITS.later_alarm_factor)),
        ):  # fmt: skip
            min_units = 1 / (len(calibration.novelty) + 1)
            novelty = NoveltyDetector("decision", np.sort(calibration.novelty), max(level, min_units))
            unknown = novelty.p_value(got.novelty) <= novelty.false_alarms
            alarms.append(
                {f"{margin}_alarms": unknown[~strange].mean(), f"{margin}_found": unknown[strange].mean()}
            )
    return study_results | pd.DataFrame(alarms).mean().to_dict()


def answers(
    default: Candidate, frame: pd.DataFrame, trains: Indices, later: Indices
) -> tuple[HeldOutPredictions, HeldOutPredictions]:
    """Return predictions for held-out training recordings and for later ones."""
    part = frame.iloc[trains].reset_index(drop=True)
    return (
        predict_held_out(default, part, make_splits(find_protocol("recording"), part, SEED)),
        predict_held_out(default, frame, [(trains, later)]),
    )


def report(study_results: dict[str, list[dict[str, Any]]], settings: dict[str, Any], out: Path) -> None:
    """Write the cells, the expected accuracies and their summary."""
    comparison = [
        {
            **{key: cell[key] for key in ("set", "protocol", "n", "n_folds")},
            **{
                f"{who}_{what}": cell[who][what]
                for who in ("default", "best")
                for what in ("row", "mean", "worst")
            },
            "lacks": cell["best"]["mean"] - cell["default"]["mean"],
        }
        for cell in study_results["cells"]
    ]
    n_near = sum(cell["lacks"] <= NEAR + 1e-9 for cell in comparison)
    sentence = (
        pd.DataFrame(study_results["promises"])
        .groupby(["set", "n"], sort=False)
        .mean(numeric_only=True)
        .reset_index()
    )
    sentence["growth"] = sentence["plain_alarms"] / FALSE_ALARMS
    of_sets = sentence[sentence["n"] >= 3] if (sentence["n"] >= 3).any() else sentence
    summary = {
        "n_cells": len(comparison), "n_near": n_near,
        "least_kept": float(sentence.groupby("set")["kept"].mean().min()),
        "median_growth": float(of_sets.groupby("set")["growth"].mean().median()),
    }  # fmt: skip
    blocks: list[Any] = [
        f"What `train` takes by default is within {NEAR:g} point of the best other row, or better, in "
        f"{n_near} of {len(comparison)} cells. The best is selected on the test folds (optimistic). "
        "Accuracies in %, mean over surfaces and folds, and the worst fold. n: recordings of "
        "each surface that train (runs, under `grouped`).",
        table(
            comparison,
            "set = {set} | protocol = {protocol} | n = {n} | folds = {n_folds} | default = {default_row} | "
            "% = {default_mean:.1f} | worst = {default_worst:.1f} | best = {best_row} | "
            "% = {best_mean:.1f} | worst = {best_worst:.1f} | default lacks = {lacks:.1f}",
        ),
        Heading("What is promised, and what later recordings get"),
        "Recordings of each surface made in a row train the default: repetitions (later: the second half), "
        "those of one operator (later: other operators'), windows of one run (later: those of other runs). "
        "Promised is what some of them, held out at random, come to (rule of succession). Kept: of what "
        f"their accuracy is above chance. Called unknown at a setting of {FALSE_ALARMS:.0%}: later "
        "recordings, and strangers (a fifth of the surfaces, left out), by a threshold as held-out "
        f"recordings give it (plain), and by one that expects {LIMITS.later_alarm_factor:g} times as many "
        "false alarms later (wide).",
        table(
            sentence,
            "set = {set} | n = {n} | promised = {promise:.1%} | later = {later:.1%} | kept = {kept:.2f} | "
            "later, plain = {plain_alarms:.1%} | strangers, plain = {plain_found:.1%} | "
            "later, wide = {wide_alarms:.1%} | strangers, wide = {wide_found:.1%}",
        ),
        f"The set that keeps least keeps {summary['least_kept']:.2f}; later recordings are called unknown "
        f"{summary['median_growth']:.1f} times as often as was asked for (plain; median over sets).",
    ]
    write(out, "few_recordings", settings | summary | study_results, "Accuracy with few recordings", blocks)


if __name__ == "__main__":
    main()
