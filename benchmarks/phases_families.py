"""Accuracy of the segmentation on synthetic recordings that differ from those of the simulator.

`python benchmarks/phases_families.py [--recordings N]` (a few minutes) writes
reports/studies/phases_families. The seeds were drawn after the last change of the method.
"""

import os
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import wavfile
from study import command_line, timed, write

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from made_recordings import FAMILIES, MATCH_S, make, matched, overlap

from texclass.phases import find_phases
from texclass.provenance import code_hash
from texclass.recording import Recording
from texclass.reporting import Heading, Table

SEED = 1_732_050
"""Seed of the first recording of each family; smaller seeds were used in development."""


def rows(n: int, families: list[str]) -> Iterator[dict[str, object]]:
    """Segment `n` recordings of each family and yield what was found."""
    for family in families:
        for seed in range(SEED, SEED + n):
            true = make(family, seed)
            detected, cpu_s = timed(partial(find_phases, true.with_(phases=None)), time.process_time)
            yield {
                "family": family,
                "fs": true.fs,
                "true": len(true.phases.taps),
                "found": len(detected.taps),
                "matched": matched(true.phases, detected, true.fs),
                "overlap": overlap(true.phases, detected),
                "ms_per_s": 1e3 * cpu_s / true.duration_s,
            }


def summary(table: pd.DataFrame, by: str) -> pd.DataFrame:
    """Taps found, taps that are none, F1, and overlap of movement for each group."""
    groups = table.groupby(by, sort=False)
    sums = groups[["matched", "true", "found"]].sum()
    columns = {
        "recordings": groups.size(),
        "taps": sums["true"],
        "lost": sums["true"] - sums["matched"],
        "false": sums["found"] - sums["matched"],
        "F1": (2 * sums["matched"] / (sums["true"] + sums["found"])).where(sums["true"] > 0),
        "overlap mean": groups["overlap"].mean(),
        "overlap 5 %": groups["overlap"].quantile(0.05),
    }
    return pd.DataFrame(columns).round(3).reset_index()


def knocks(folder: str) -> dict[str, int]:
    """Count the real knocks with taps, and those with a movement; they were used in development."""
    files = sorted((Path(os.environ["TEXCLASS_DATA"]) / folder).glob("*/*.wav"))
    detected = []
    for file in files:
        fs, x = wavfile.read(file)
        detected.append(find_phases(Recording(np.asarray(x, dtype=float), fs, "arbitrary")))
    return {
        "recordings": len(detected),
        "with taps": sum(bool(phases.taps) for phases in detected),
        "with movement": sum(phases.movement is not None for phases in detected),
    }


def main() -> None:
    args = command_line(__doc__, recordings=40)
    table = pd.DataFrame(rows(args.recordings, list(FAMILIES)))
    views = {"Family": summary(table, "family"), "Sampling rate (Hz)": summary(table, "fs")}
    real = {folder: knocks(folder) for folder in ("knocks30", "knocks9")}
    result = {
        "seed": SEED,
        "recordings": args.recordings,
        "match_s": MATCH_S,
        "ms_per_s": round(float(table["ms_per_s"].median()), 3),
        "input_hash": {"code": code_hash("recording", "signals", "phases")},
        "knocks": real,
        "results": {title: view.to_dict("records") for title, view in views.items()},
    }
    blocks = [
        f"{args.recordings} recordings of each family, 1 to 50 kHz, one axis or three, with gravity or "
        "without, made by tests/made_recordings.py: pulses of force with ringing modes, filtered noise and "
        "ridges that follow a speed, and what happens on the way into a file. The seeds were drawn after the "
        "last change of the method. A tap counts as found if its impact lies within "
        f"{1e3 * MATCH_S:g} ms of the true one; overlap is intersection over union of the movement. Aim: "
        "F1 >= 0.98 and overlap >= 0.97 in each family with taps and strokes, at most one false tap in 50 "
        "recordings of strokes alone.",
        *(
            f"Real knocks (`{folder}`, used in development): taps in {counts['with taps']} of "
            f"{counts['recordings']}, a false movement in {counts['with movement']}."
            for folder, counts in real.items()
        ),
    ]
    for title, view in views.items():
        blocks += [Heading(title), Table(view, n_words=1)]
    write(args.out, "phases_families", result, "Phases in families of synthetic recordings", blocks)


@pytest.mark.benchmark
def test_every_family_reaches_the_aims():
    families = [family for family, plan in FAMILIES.items() if plan.strokes_s and plan.n_taps[1]]
    view = summary(pd.DataFrame(rows(20, families)), "family")
    assert view["F1"].min() >= 0.96  # of 20 recordings; the aim of 0.98 is for all of the report
    assert view["overlap mean"].min() >= 0.97


if __name__ == "__main__":
    main()
