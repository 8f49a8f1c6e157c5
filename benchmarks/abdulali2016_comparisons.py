"""Solvers of the sparse network of abdulali2016, and the network against one AR model on real recordings.

`python benchmarks/abdulali2016_comparisons.py` (some minutes) writes reports/papers/abdulali2016-comparisons.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats
from study import command_line, table, write
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).parents[1] / "examples" / "papers"))
import shared
from abdulali2016_real import study_real_sets
from abdulali2016_simulated import SURFACES, simulate_scan
from abdulali2016_sparsa import GAP, compare_solvers

from texclass.haptics.textures import Scan
from texclass.haptics.textures.abdulali2016 import condition
from texclass.reporting import Heading
from texclass.vibration.null_scores import NULLS, distance_to_null

SEED, FS, TRAINING_S = 0, 1000.0, 20.0
REASONS = {
    "stylus6": "speed and force explain only {low:.0%} to {high:.0%} of the variance of the level (adjusted "
    "R²), so there is little to predict, and the network also reproduces what does not recur",
    "fabric_speeds": "each texture has three training speeds, which were not measured. The network has the "
    "higher GFC on {at_v2} of 4 at v2, and on {at_v3} of 4 at v3",
    "biotac20": "a robot moves at constant speed, and the force hardly varies. All segments of a texture "
    "merge into one, so the network is a single model, too",
}
"""Reason for the result of each set."""


def main() -> None:
    args = command_line(__doc__, "papers")
    with threadpool_limits(1):
        solvers = pd.DataFrame(row for scan, options in scans() for row in compare_solvers(scan, **options))
        rows, hashes = study_real_sets()
    real = pd.DataFrame(rows)
    result = {
        "seed": SEED,
        "input_hash": hashes,
        "solvers": solvers.round(9).to_dict("records"),
        "real": real.astype(object).where(real.notna(), None).to_dict("records"),
    }
    blocks = [*solver_blocks(solvers), *real_blocks(real)]
    title = "abdulali2016: SpaRSA and MultiTaskLasso, network and one AR model"
    write(args.out, "abdulali2016-comparisons", result, title, blocks)


def scans():
    """Yield the scans of the solver study, and the options of `sparse_problem`."""
    for surface in SURFACES:
        yield simulate_scan(surface, TRAINING_S, FS, np.random.default_rng(SEED)), {}
    for recording in shared.recordings("stylus6")[0].values():
        yield condition(Scan.from_recording(recording)), {"isotropic": True}


def solver_blocks(solvers):
    """Return the comparison of the solvers."""
    groups = solvers.groupby(["sparsity", "solver"], sort=False)
    summary = groups.agg(
        {"excess": "max", "gap": "max", "centres": "mean", "agreement": "mean", "steps": "median",
         "ms": "median"}
    ).reset_index()  # fmt: skip
    ms = solvers.pivot_table("ms", "sparsity", "solver", aggfunc="median")
    ratio = ms["SpaRSA"] / ms["MultiTaskLasso"]
    stage = ms["SpaRSA"] / ms["SpaRSA, one stage"]
    return [
        Heading("SpaRSA and MultiTaskLasso"),
        f"Both minimise |A W - Y|² / 2 + tau Σ |W_j| for the points of {solvers['surface'].nunique()} scans "
        f"({solvers['points'].min()} to {solvers['points'].max()} points, simulated S1 to S9 and `stylus6`). "
        "SpaRSA is a proximal-gradient method with steps of Barzilai and Borwein and continuation, in numpy. "
        f"Both stop at a duality gap of {GAP:g} |Y|² / 2; `fit_sparse` stops earlier.",
        table(
            summary,
            "tau / largest tau = {sparsity:g} | Solver = {solver} | Excess over the optimum, largest = "
            "{excess:.0e} | Duality gap, largest = {gap:.0e} | Centres, mean = {centres:.1f} | "
            "Same centres, mean = {agreement:.2f} | Steps, median = {steps:.0f} | CPU ms, median = {ms:.0f}",
            "Excess and gap are relative to |Y|² / 2. Same centres: overlap with the centres of coordinate "
            "descent with a tolerance of 1e-9.",
            n_words=2,
        ),
        f"Both find the same optimum, and SpaRSA takes {ratio.min():.1f} to {ratio.max():.1f} times as long. "
        f"Continuation does not help here: it takes {stage.min():.1f} to {stage.max():.1f} times as long as "
        "a single stage.",
    ]


def real_blocks(real):
    """Return the comparison of the network with one AR model on real recordings, next to nulls."""
    real = real.assign(
        **{
            "best gfc": real[[f"{way}, gfc" for way in NULLS]].max(axis=1),
            "best perceptual": real[[f"{way}, perceptual_db" for way in NULLS]].min(axis=1),
        }
    )
    blocks = [
        Heading("Network and one AR model on real recordings"),
        "GFC and RMS error of the level (dB) in windows of 500 samples. `stylus6`: second half of each "
        "recording. `fabric_speeds`: v2 or v3, trained on the other three speeds. `biotac20`: every fourth "
        "repetition from 21 on, trained on 1 to 20. Explained: share of the variance of the level of the "
        "segments that speed and force explain. `lmt_excerpts` have neither speed nor force. Nulls: white "
        "noise, the next texture, and the mean spectrum of the others; a score proves something only if it "
        "is better than all of them. Training: the training vibration itself. Perceptual: distance in dB of "
        "the whole signals at equal level.",
        table(
            real.fillna({"explained": -1.0}).assign(
                share=lambda d: d["explained"].map(lambda x: "" if x < -0.5 else f"{x:.2f}")
            ),
            "Set = {set} | Texture = {surface} | Segments = {segments} | Explained = {share} | "
            "GFC, network = {network, gfc:.3f} | GFC, one model = {one model, gfc:.3f} | "
            "GFC, white noise = {white noise, gfc:.3f} | GFC, next = {next surface, gfc:.3f} | "
            "GFC, mean of others = {mean of others, gfc:.3f} | GFC, training = {training, gfc:.3f} | "
            "Level, network = {network, level_db:.1f} | Level, one model = {one model, level_db:.1f} | "
            "Level, next = {next surface, level_db:.1f} | "
            "Perceptual, network = {network, perceptual_db:.1f} | "
            "Perceptual, one model = {one model, perceptual_db:.1f} | "
            "Perceptual, best null = {best perceptual:.1f}",
            n_words=2,
        ),
    ]
    for name, rows in real.groupby("set", sort=False):
        n_gfc = int((rows["network, gfc"] > rows["one model, gfc"]).sum())
        n_level = int((rows["network, level_db"] < rows["one model, level_db"]).sum())
        gain = rows["network, gfc"] - rows["one model, gfc"]
        half = stats.t.ppf(0.975, len(gain) - 1) * gain.sem()
        margins = [
            distance_to_null(
                rows[f"network, {key}"], rows.rename(columns={best: "best null"}), higher_is_better=is_higher
            )
            for key, best, is_higher in (
                ("gfc", "best gfc", True), ("perceptual_db", "best perceptual", False)
            )
        ]  # fmt: skip
        at = {
            step: int((held_out["network, gfc"] > held_out["one model, gfc"]).sum())
            for step, held_out in rows.groupby(rows["surface"].str[-2:])
        }
        reason = REASONS[name].format(
            low=rows["explained"].min(), high=rows["explained"].max(), at_v2=at.get("v2"), at_v3=at.get("v3")
        )
        blocks.append(
            f"`{name}`: GFC of the network minus that of one model: {gain.mean():+.4f} "
            f"[{gain.mean() - half:+.4f}, {gain.mean() + half:+.4f}] (95 % interval over rows). The network "
            f"has the higher GFC on {n_gfc} and the smaller level error on {n_level} of {len(rows)}. "
            f"Reason: {reason}. Distance of the network to the best null: "
            f"{margin(margins[0], 3)} in GFC and {margin(margins[1], 2)} dB in perceptual distance (positive "
            f"is better): {verdict(margins)}."
        )
    return blocks


def margin(distance, digits):
    """Return a distance to a null with its interval."""
    mean, low, high = (f"{distance[key]:+.{digits}f}" for key in ("mean", "low", "high"))
    return f"{mean} [{low}, {high}]"


def verdict(margins):
    """Return whether the network is better than the best null in one of its scores."""
    if any(distance["low"] > 0 for distance in margins):
        return "the network is distinguished from the nulls"
    return "the set proves nothing about the network"


if __name__ == "__main__":
    main()
