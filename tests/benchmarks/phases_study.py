"""How well phases are found: taps (precision, recall, F1) and overlap of movement, on simulated recordings.

Run `python tests/benchmarks/phases_study.py` from the project's root (a few minutes), or
`pytest -m benchmark`. Writes `reports/studies/phases.md`, `.json` and `.png`. The seeds are not
those the method was developed on.
"""

import argparse
import json
import platform
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy

from texclass import __version__
from texclass.phases import segment
from texclass.recording import Phases, Recording
from texclass.simulate import operator_catalogue, record_freehand, surface_catalogue

SEED = 48611
"""Run once, the method frozen; seeds 3 and 7102 led to changes of the method and are not reported."""
RATES_HZ = (1000.0, 2200.0, 5000.0, 10_000.0, 20_000.0, 50_000.0)
SNRS_DB = (None, 20.0, 10.0, 5.0)
MATCH_S = 0.010
N_OPERATORS = 5
REPORTS = Path(__file__).parents[2] / "reports" / "studies"


def matched(true: Phases, found: Phases, fs: float) -> int:
    """Count true impacts that one found impact, used once, meets within `MATCH_S`."""
    free = [tap.impact for tap in found.taps]
    n_matched = 0
    for tap in true.taps:
        near = [impact for impact in free if abs(impact - tap.impact) <= MATCH_S * fs]
        if near:
            free.remove(min(near, key=lambda impact: abs(impact - tap.impact)))
            n_matched += 1
    return n_matched


def overlap(true: Phases, found: Phases) -> float:
    """Intersection over union of the movements; 1 if neither has one."""
    if true.movement is None or found.movement is None:
        return float(true.movement == found.movement)
    (a, b), (c, d) = true.movement, found.movement
    return max(0, min(b, d) - max(a, c)) / (max(b, d) - min(a, c))


def rows(n_surfaces: int, duration_s: float) -> Iterator[dict[str, object]]:
    """Segment every recording of the study and yield what was found."""
    surfaces = surface_catalogue(n_surfaces, SEED)
    operators = operator_catalogue(N_OPERATORS, SEED)
    for fs in RATES_HZ:
        for snr in SNRS_DB:
            for i, surface in enumerate(surfaces):
                operator = operators[i % N_OPERATORS]
                for with_taps in (True, False) if i % 4 == 0 else (True,):
                    recording = record_freehand(
                        surface,
                        operator,
                        duration_s=duration_s,
                        fs=fs,
                        seed=(SEED, i),
                        snr_db=snr,
                        with_taps=with_taps,
                    )
                    yield _row(recording, snr)


def _row(recording: Recording, snr: float | None) -> dict[str, object]:
    true = recording.phases
    assert true is not None
    hidden = recording.with_(phases=None)
    start = time.process_time()
    found = segment(hidden)
    return {
        "fs": recording.fs,
        "snr": "sensor" if snr is None else f"{snr:g} dB",
        "operator": recording.operator,
        "surface": recording.material,
        "matched": matched(true, found, recording.fs),
        "true": len(true.taps),
        "found": len(found.taps),
        "overlap": overlap(true, found),
        "ms_per_s": 1e3 * (time.process_time() - start) / recording.duration_s,
    }


def summary(table: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Precision, recall, F1 of taps and overlap of movement for each group."""
    groups = table.groupby(by, sort=False)
    sums = groups[["matched", "true", "found"]].sum()
    result = pd.DataFrame(
        {
            "recordings": groups.size(),
            "taps": sums["true"],
            "precision": sums["matched"] / sums["found"].clip(lower=1),
            "recall": sums["matched"] / sums["true"].clip(lower=1),
            "F1": 2 * sums["matched"] / (sums["true"] + sums["found"]).clip(lower=1),
            "overlap mean": groups["overlap"].mean(),
            "overlap 5 %": groups["overlap"].quantile(0.05),
            "ms per s": groups["ms_per_s"].median(),
        }
    )
    return result.round(3)


def write(table: pd.DataFrame, folder: Path, n_surfaces: int, duration_s: float) -> None:
    """Write the report as Markdown, JSON and a figure."""
    table = table.assign(kind=table["surface"].str.rsplit("-", n=1).str[0])
    views = {
        "All": summary(table.assign(all="all"), ["all"]),
        "Sampling rate (Hz) and noise": summary(table, ["fs", "snr"]),
        "Noise": summary(table, ["snr"]),
        "Operator": summary(table, ["operator"]),
        "Kind of surface": summary(table, ["kind"]),
    }
    versions = {
        "texclass": __version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
    }
    facts = {
        "seed": SEED,
        "surfaces": n_surfaces,
        "duration_s": duration_s,
        "match_s": MATCH_S,
        "versions": versions,
    }
    lines = [
        "# Phases found in simulated recordings",
        "",
        f"{len(table)} recordings of {duration_s:g} s, {n_surfaces} surfaces, {N_OPERATORS} operators, "
        f"seed {SEED} (the method",
        "was developed on other seeds). A tap counts as found if its impact lies within "
        f"{1e3 * MATCH_S:g} ms of the true one; overlap is",
        "intersection over union of the movement. Noise is white, on every axis, so far below the strokes'",
        "vibration; `sensor` means the sensor's own noise only. Aim: F1 >= 0.98, overlap >= 0.97.",
        "The same surfaces and gestures return at every rate and noise, so rows are not independent.",
        "",
        "![F1 and overlap](phases.png)",
        "",
    ]
    for title, view in views.items():
        lines += [f"## {title}", "", *_markdown(view.reset_index()), ""]
    lines += ["Versions: " + ", ".join(f"{k} {v}" for k, v in versions.items()) + ".", ""]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "phases.md").write_text("\n".join(lines))
    results = {title: view.reset_index().to_dict(orient="records") for title, view in views.items()}
    (folder / "phases.json").write_text(json.dumps({**facts, "results": results}, indent=1) + "\n")
    _draw(views["Sampling rate (Hz) and noise"].reset_index(), folder / "phases.png")


def _markdown(view: pd.DataFrame) -> list[str]:
    cells = [
        [f"{value:g}" if isinstance(value, float) else str(value) for value in row] for row in view.to_numpy()
    ]
    header = [str(column) for column in view.columns]
    return ["| " + " | ".join(row) + " |" for row in (header, ["---"] * len(header), *cells)]


def _draw(view: pd.DataFrame, path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, column, aim in zip(figure.subplots(1, 2), ("F1", "overlap mean"), (0.98, 0.97), strict=True):
        for (snr, group), style in zip(
            view.groupby("snr", sort=False), ("o-", "s--", "^-.", "v:"), strict=True
        ):
            axes.plot(group["fs"] / 1e3, group[column], style, label=f"noise: {snr}")
        axes.axhline(aim, color="0.5", linewidth=0.8)
        axes.set_xscale("log")
        axes.set_xticks([1, 2.2, 5, 10, 20, 50], ["1", "2.2", "5", "10", "20", "50"])
        axes.minorticks_off()
        axes.set_ylim(min(0.7, float(view[column].min()) - 0.02), 1.01)
        axes.set_xlabel("sampling rate (kHz)")
        axes.set_title(f"{'F1 of taps' if column == 'F1' else 'overlap of movement'} (grey: aim)")
        axes.legend()
    figure.savefig(path, dpi=130)


def main() -> None:
    """Run the study and write its report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--surfaces", type=int, default=24)
    parser.add_argument("--duration", type=float, default=6.0, help="seconds a recording")
    parser.add_argument("--out", type=Path, default=REPORTS)
    chosen = parser.parse_args()
    table = pd.DataFrame(rows(chosen.surfaces, chosen.duration))
    write(table, chosen.out, chosen.surfaces, chosen.duration)
    print(summary(table, ["fs", "snr"]).to_string())


@pytest.mark.benchmark
def test_phases_of_recordings_at_least_at_five_kilohertz_reach_the_aim_above_ten_decibel(tmp_path):
    table = pd.DataFrame(rows(6, 6.0))
    write(table, tmp_path, 6, 6.0)
    usual = summary(
        table[(table["fs"] >= 5000) & table["snr"].isin(["sensor", "20 dB"])].assign(all=1), ["all"]
    )
    assert usual["F1"].item() >= 0.95
    assert usual["overlap mean"].item() >= 0.97


if __name__ == "__main__":
    main()
