"""Held-out speed, force and direction on every simulated surface, and the bound of the output.

Run `python tests/benchmarks/abdulali2016_recovery.py` from the project's root (some minutes). Writes
`reports/papers/abdulali2016-recovery.{md,json}`.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "papers"))
from abdulali2016_simulated import SURFACES, simulate_scan
from abdulali2016_study import FS, study_bound, study_held_out

from texclass.provenance import versions
from texclass.textures.abdulali2016 import bake, model_scan

KEPT = ("speed", "force", "direction")
LEAST = 0.95


def bounds(n_paths: int) -> dict[str, tuple[float, float]]:
    """Largest sample over the recorded peak, and share of samples held at the limit, per family."""
    scan = simulate_scan(SURFACES[0], 20.0, FS, np.random.default_rng(0))
    modelled, peak = model_scan(scan), float(np.abs(scan.acceleration).max())
    network = modelled.network()
    textures = (network, modelled.delaunay(), bake(network, "S1"))
    return {each.family: study_bound(each, peak, n_paths, 0) for each in textures}


def row(name: str, scores: dict) -> str:
    cells = []
    for kept in KEPT:
        gfc = np.array(scores[kept])
        cells.append(f"{gfc.mean():.4f} | {gfc.min():.4f} | {np.sum(gfc > LEAST)} of {gfc.size}")
    return f"| {name} | " + " | ".join(cells) + " |"


def markdown(result: dict) -> str:
    gfc = result["gfc"]
    every = {kept: [x for scores in gfc.values() for x in scores[kept]] for kept in KEPT}
    lines = [
        "# Recovery of simulated anisotropic surfaces\n",
        "GFC at held-out speeds, forces and directions (see abdulali2016.md), "
        f"{result['n_seeds']} seeds each; required: {LEAST}.\n",
        "| surface | " + " | ".join(f"{kept}: mean | least | above {LEAST}" for kept in KEPT) + " |",
        "|" + " --- |" * 10,
        *(row(name, scores) for name, scores in gfc.items()),
        row("all", every),
        f"\nOutput on {result['n_paths']} wild paths, largest sample over the recorded peak (limit: 2):\n",
    ]
    for family, (top, held) in result["bound"].items():
        lines.append(f"- `{family}`: {top:.2f}; {held:.1e} of the samples are held at the limit")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--paths", type=int, default=1000)
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[2] / "reports" / "papers")
    asked = parser.parse_args()
    with threadpool_limits(1):
        runs = {s.name: [study_held_out(s, seed) for seed in range(asked.seeds)] for s in SURFACES}
        result = {
            "versions": versions("numpy", "scipy", "numba"),
            "n_seeds": asked.seeds,
            "n_paths": asked.paths,
            "gfc": {name: {k: [one[k] for one in each] for k in KEPT} for name, each in runs.items()},
            "bound": bounds(asked.paths),
        }
    (asked.out / "abdulali2016-recovery.json").write_text(
        json.dumps(result, indent=1) + "\n", encoding="utf-8"
    )
    (asked.out / "abdulali2016-recovery.md").write_text(markdown(result), encoding="utf-8")


if __name__ == "__main__":
    main()
