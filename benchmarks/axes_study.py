"""Axes merged or separate: accuracy of the default pipeline, its decision, and the pipeline `coarse`.

Run it by hand from the project's root: `python benchmarks/axes_study.py`. It writes
reports/studies/axes.json. Data sets that are absent are left out. "Turned" rotates every recording at random,
like a tool that turns in the hand; "acceleration" removes the turn rate.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from channels_study import resampled
from scipy.stats import special_ortho_group
from study import command_line, interval, table, write

from texclass.evaluation import cached_table, cut_windows, load_pipeline
from texclass.evaluation.axes import MIN_CONSISTENCY, decide_axes, measure_orientation
from texclass.evaluation.pipeline import MatchedRow, PipelineDefinition
from texclass.evaluation.protocols import find_protocol
from texclass.evaluation.windows import add_overlapping_windows
from texclass.loaders import open_dataset
from texclass.loaders.dataset import Dataset, Entry
from texclass.loaders.places import DataNotFoundError
from texclass.recording import Recording

N_FOLDS, SEED = 5, 0
ROWS = (
    ("floors10", "acceleration", 5.0, "chronological"),
    ("floors10", "acceleration, turned", 5.0, "chronological"),
    ("floors10", "with turn rate", 5.0, "chronological"),
    ("borealtc", "acceleration", 5.0, "grouped"),
    ("borealtc", "with turn rate", 5.0, "grouped"),
    ("dogsurf", "acceleration", 5.0, "grouped"),
    ("dogsurf", "with turn rate", 5.0, "grouped"),
    ("simulated", "acceleration", None, "recording"),
)
"""Data set, variant, length of a window in s, protocol."""


@dataclass(frozen=True)
class Loader:
    """Load a recording without its turn rate, and turned at random if `is_turned`."""

    load: Callable[[Entry], Recording]
    is_turned: bool

    def __call__(self, entry: Entry) -> Recording:
        recording = self.load(entry).with_(turn_rate=None)
        if not self.is_turned:
            return recording
        rotation = special_ortho_group.rvs(
            3, random_state=np.random.default_rng([*entry.recording_id.encode()])
        )
        return recording.with_(acceleration=recording.acceleration @ rotation)


def variant_of(dataset: Dataset, variant: str) -> Dataset:
    """Return a variant of a data set."""
    if variant == "with turn rate":
        return dataset
    load = Loader(dataset.load, variant.endswith("turned"))
    return replace(dataset, load=load, input_hash=f"{dataset.input_hash} {variant}")


def hits_of(dataset: Dataset, pipeline: PipelineDefinition, classifier: str, protocol: str) -> pd.DataFrame:
    """Return recording_id, surface, cluster and hit of every test recording or window."""
    dataset = add_overlapping_windows(dataset, pipeline.overlap)
    features = cached_table(dataset, *pipeline.needed, channels=pipeline.channels)
    splits = find_protocol(protocol).split(features.frame, N_FOLDS, SEED)
    row = MatchedRow.match(pipeline.rows[-1], pipeline.features, features)
    trial = pipeline.trial(row, classifier, features)
    tests = np.concatenate([test for _, test in splits])
    frame = features.frame.iloc[tests][["recording_id", "surface"]].reset_index(drop=True)
    clusters = np.asarray(find_protocol(protocol).clusters(features.frame))[tests]
    return frame.assign(cluster=clusters, hit=np.concatenate(trial(splits).hits)).sort_values("recording_id")


def compared(name: str, variant: str, window_s: float | None, protocol: str) -> list[dict[str, Any]]:
    """Return one line per contestant."""
    dataset = variant_of(open_dataset(name), variant)
    dataset = cut_windows(dataset, window_s) if window_s else dataset
    default, coarse = load_pipeline("surfaces"), load_pipeline("coarse")
    decided = decide_axes(dataset, "auto").channels
    _, consistency = measure_orientation(dataset)
    run = partial(hits_of, dataset, protocol=protocol)
    hits = {
        "merged": run(default.model_copy(update={"channels": "auto"}), "vote"),
        "separate": run(default.model_copy(update={"channels": "all"}), "vote"),
        "coarse": run(coarse, "kernel"),
    }
    chosen = hits["separate" if decided == "all" else "merged"]
    lines = []
    for contestant, frame in hits.items():
        groups = frame["surface"].to_numpy(), frame["cluster"].to_numpy()
        ahead = chosen["hit"].to_numpy(dtype=float) - frame["hit"].to_numpy(dtype=float)
        lines.append(
            {
                "dataset": name, "variant": variant, "protocol": protocol, "consistency": consistency,
                "contestant": contestant, "is_default": frame is chosen, "n_tests": len(frame),
                **resampled(frame["hit"].to_numpy(dtype=float), *groups), "ahead": resampled(ahead, *groups),
                "input_hash": dataset.input_hash,
            }
        )  # fmt: skip
        print(lines[-1], flush=True)
    return lines


def main() -> None:
    """Compare on each data set; write the report after each."""
    args = command_line(__doc__)
    lines: list[dict[str, Any]] = []
    for row in ROWS:
        try:
            lines += compared(*row)
        except DataNotFoundError as absent:
            print(absent)
            continue
        result = {
            "name": "axes", "n_folds": N_FOLDS, "seed": SEED, "lines": lines,
            "input_hash": {f"{one['dataset']}, {one['variant']}": one["input_hash"] for one in lines},
        }  # fmt: skip
        rows = [
            {
                **line,
                "right": interval(line),
                "decision": "default" if line["is_default"] else "",
                "gain": "" if line["is_default"] else interval(line["ahead"]),
            }
            for line in lines
        ]
        blocks = [
            table(
                rows,
                "dataset = {dataset} | recordings = {variant} | protocol = {protocol} | "
                "consistency = {consistency:.2f} | axes = {contestant} | decision = {decision} | "
                "balanced % [95 %] = {right} | default ahead by [95 %] = {gain}",
                n_words=6,
            ),
            "Default pipeline (`surfaces`) with merged and with separate axes, and `coarse` with separate "
            f"axes. Axes are separate from a consistency of {MIN_CONSISTENCY:g} on. Windows of 5 s "
            "(simulated: whole recordings). Intervals: runs or recordings drawn anew within each surface, "
            "2000 times; differences are of the same tests.",
        ]
        write(args.out, "axes", result, "Axes of an accelerometer: merged or separate", blocks)


if __name__ == "__main__":
    main()
