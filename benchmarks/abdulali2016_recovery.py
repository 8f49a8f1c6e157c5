"""Held-out speed, force and direction on every simulated surface next to nulls, and the bound of the output.

`python benchmarks/abdulali2016_recovery.py` (some minutes) writes reports/papers/abdulali2016-recovery.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from study import command_line, table, write

sys.path.insert(0, str(Path(__file__).parents[1] / "examples" / "papers"))
from abdulali2016_simulated import SURFACES, simulate_scan
from abdulali2016_study import FS, study_bound, study_held_out, study_held_out_nulls

from texclass.haptics.textures.abdulali2016 import bake, model_scan
from texclass.reporting import Table

KEPT = ("speed", "force", "direction")
LEAST = 0.95


def bounds(n_paths: int) -> dict[str, tuple[float, float]]:
    """Largest sample over the recorded peak, and share of samples held at the limit, per family."""
    scan = simulate_scan(SURFACES[0], 20.0, FS, np.random.default_rng(0))
    modelled, peak = model_scan(scan), float(np.abs(scan.acceleration).max())
    network = modelled.network()
    textures = (network, modelled.delaunay(), bake(network, "S1"))
    return {each.family: study_bound(each, peak, n_paths, 0) for each in textures}


def main() -> None:
    args = command_line(__doc__, "papers", seeds=50, paths=1000)
    study_scores = pd.DataFrame(
        {"surface": s.name, **study_held_out(s, seed)} for s in SURFACES for seed in range(args.seeds)
    )
    gfc = study_scores.groupby("surface", sort=False)[list(KEPT)]
    nulls = pd.concat(
        {axis: pd.DataFrame(rows).T for axis, rows in study_held_out_nulls(SURFACES, 0).items()},
        names=["held out", "surface"],
    ).reset_index()
    result = {
        "nulls": nulls.to_dict("records"),
        "n_seeds": args.seeds,
        "n_paths": args.paths,
        "gfc": {name: scores.to_dict("list") for name, scores in gfc},
        "bound": bounds(args.paths),
    }
    long = pd.concat([study_scores, study_scores.assign(surface="all")]).melt(
        "surface", KEPT, "held out", "GFC"
    )
    scores = long.groupby(["surface", "held out"], sort=False)["GFC"]
    score_table = scores.agg(["mean", "min"]).round(4).reset_index()
    score_table[f"above {LEAST}"] = scores.apply(
        lambda gfc: f"{(gfc > LEAST).sum()} of {gfc.size}"
    ).to_numpy()
    bound = [{"family": family, "top": top, "held": held} for family, (top, held) in result["bound"].items()]
    blocks = [
        "GFC at held-out speeds, forces and directions (see abdulali2016.md), "
        f"{args.seeds} seeds each; required: {LEAST}.",
        Table(score_table.astype({"mean": str, "min": str}), n_words=2),
        "GFC of nulls, and of the other half of a recording, under the same conditions. "
        f"{(nulls['best null'] > LEAST).sum()} of {len(nulls)} best nulls are above {LEAST}, too: the limit "
        "alone proves nothing; only the distance to the null does.",
        table(
            nulls,
            "surface = {surface} | held out = {held out} | white noise = {white noise:.4f} | "
            "next surface = {next surface:.4f} | mean of others = {mean of others:.4f} | "
            "best null = {best null:.4f} | other half = {other half:.4f}",
            n_words=2,
        ),
        f"Output on {args.paths} wild paths, largest sample over the recorded peak (limit: 2):",
        table(bound, "texture = `{family}` | largest = {top:.2f} | share held there = {held:.1e}"),
    ]
    write(args.out, "abdulali2016-recovery", result, "Recovery of simulated anisotropic surfaces", blocks)


if __name__ == "__main__":
    main()
