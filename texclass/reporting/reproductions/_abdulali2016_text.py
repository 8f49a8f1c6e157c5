"""The report on `abdulali2016` in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from texclass.reporting.words import line_of
from texclass.textures.abdulali2016 import study as studies
from texclass.textures.abdulali2016.simulated import GROWTH, SURFACES
from texclass.textures.abdulali2016.study import Score, SurfaceScores
from texclass.textures.abdulali2016.timing import FitTime, RenderTime

KEY = "abdulali2016"
WAYS = (
    "network", "network, baked", "exact, plain", "sparse, plain", "as published", "Delaunay",
    "Delaunay, plain", "without direction", "one AR model", "the truth again",
)  # fmt: skip


@dataclass(frozen=True)
class Study:
    """Everything the report says.

    Attributes
    ----------
    seed : int
    simulated, real : list of SurfaceScores
        S1 ... S9, and T1 ... T6 of `stylus6` (empty where that is absent).
    held_out : dict of str to list of float
        GFC of each seed with speed, force and direction left out.
    sparsity : list of (float, float, float)
        Sparsity, and mean number of centres and mean GFC over the surfaces.
    fits : list of FitTime
    renders : list of RenderTime
    input_hash : str
        Of `stylus6`.
    """

    seed: int
    simulated: list[SurfaceScores]
    real: list[SurfaceScores]
    held_out: dict[str, list[float]]
    sparsity: list[tuple[float, float, float]]
    fits: list[FitTime]
    renders: list[RenderTime]
    input_hash: str


def markdown(result: Study) -> str:
    """Return the report."""
    parts = [
        "# Abdulali and Jeon, Data-Driven Modeling of Anisotropic Haptic Textures (2016)\n",
        "**What is simulated.** The paper's recordings are not public. S1 ... S9 are simulated surfaces, "
        "autoregressive processes whose resonances and level vary smoothly with velocity and force, "
        "all but S4 "
        "with direction; a simulated hand strokes them freely. Frequencies and levels are ours, so no "
        "number below says anything about the paper's materials. Real recordings: `stylus6`, isotropic.\n",
        "The paper has no table. Its Fig. 5(a) says: GFC above 0.90 for every sample but S1, and S1 "
        "close to it.\n",
        _scores_section(result),
        _held_out_section(result),
        _real_section(result),
        _sparsity_section(result),
        _times_section(result),
    ]
    return "\n".join(parts)


def _scores_section(result: Study) -> str:
    pooled = ", ".join(f"{row.name} with a reach of {row.reach:g}" for row in result.simulated if row.reach)
    symmetric = ", ".join(row.name for row in result.simulated if row.symmetric)
    n_good = sum(_of(row, "network").gfc > 0.9 for row in result.simulated)
    return "\n".join(
        [
            "## Fig. 5(a): cross-validation, 20 s of training, 10 s of validation (simulated)\n",
            f"Published: 8 of 9 samples above 0.90. Ours: {n_good} of {len(result.simulated)}. "
            "Mean GFC over windows of 500 samples ± deviation over windows; *the truth again* is the true "
            "process along the same motion with other noise: no model can be expected to exceed it.\n",
            _score_table(result.simulated, WAYS),
            "\nRMS error of the level per window, dB, and the exponents found in it (the truth is "
            f"{GROWTH[0]}, {GROWTH[1]}):\n",
            _score_table(result.simulated, WAYS, level=True),
            f"\n![scores]({KEY}-fig5a.png)\n\n![spectra]({KEY}-fig5bcd.png)\n",
            "*network*: exact solution of eq. (5), spectra pooled where that predicts left-out "
            "segments better "
            f"(here {pooled or 'nowhere'}), segments counted for both ways of a stroke where that fits (here "
            f"{symmetric or 'nowhere'}: the simulated grain has a period of 180°; *plain* does "
            "neither), as extra output what a power law of speed and force "
            "leaves of the "
            "level, parameters that glide. *As published*: Yule-Walker, variance as extra output, sparse "
            "network, parameters that jump every 16 samples. Where a variance among zeros swings "
            "below zero it "
            "counts as silence, and such windows score 0: this is what costs it most.\n",
            f"## Fig. 2(b) and 4: segments and input space (simulated)\n\n![segments]({KEY}-fig2b.png)\n\n"
            f"![input space]({KEY}-fig4.png)\n",
        ]
    )


def _held_out_section(result: Study) -> str:
    names = {
        "speed": "speeds {:g}-{:g} mm/s, tested at {:g}".format(*studies.SPEED_BAND, studies.SPEED),
        "force": "forces {:g}-{:g} N, tested at {:g}".format(*studies.FORCE_BAND, studies.FORCE),
        "direction": f"directions ± {np.rad2deg(studies.SECTOR_RAD):.0f}° "
        "around the tested one and its opposite",
    }
    rows = [("left out of the training", "mean", "5 %", "least", "runs above 0.95")]
    for kept, gfc in result.held_out.items():
        shown = f"{np.mean(gfc):.4f}", f"{np.percentile(gfc, 5):.4f}", f"{min(gfc):.4f}"
        rows.append((names[kept], *shown, f"{sum(x > 0.95 for x in gfc)} of {len(gfc)}"))
    missed = [
        f"{SURFACES[i % len(SURFACES)].name} {kept} {x:.3f}"
        for kept, gfc in result.held_out.items()
        for i, x in enumerate(gfc)
        if x <= 0.95
    ]
    return "\n".join(
        [
            f"## Held-out speed, force and direction, {len(result.held_out['speed'])} seeds (simulated)\n",
            "Each seed draws another hand, another noise and another held-out direction; surfaces in turn. "
            "Required: above 0.95.\n",
            _table(rows),
            "\nMisses: " + ("; ".join(missed) if missed else "none") + ".\n",
            f"![held out]({KEY}-held-out.png)\n",
        ]
    )


def _real_section(result: Study) -> str:
    if not result.real:
        return "## Real recordings\n\nSkipped: `stylus6` is not present (set TEXCLASS_DATA).\n"
    covered = [row.coverage for row in result.real]
    pairs = [(_of(row, "network"), _of(row, "one AR model")) for row in result.real]
    better, truer = sum(a.gfc > b.gfc for a, b in pairs), sum(a.level_db < b.level_db for a, b in pairs)
    ways = tuple(way for way in WAYS if way not in ("the truth again", "without direction"))
    return "\n".join(
        [
            "## Real recordings: `stylus6`, first half for training, second half for validation, isotropic\n",
            _score_table(result.real, ways),
            "\nRMS error of the level per window, dB:\n",
            _score_table(result.real, ways, level=True),
            "\nThese hands are never steady: with the printed tau_2 = 0.08 segments cover "
            f"{min(covered):.0%} to "
            f"{max(covered):.0%} of the training (- where none is left); the default doubles tau_2 "
            "until half is "
            "covered. *One AR model* of everything at one level is deaf to speed and force. Against "
            "it the network "
            f"has the higher GFC on {better} and the smaller error of the level on {truer} of "
            f"{len(result.real)}: "
            "spectra and levels of these textures hardly change with speed and force (see the exponents), so "
            "there is little to gain.\n",
        ]
    )


def _sparsity_section(result: Study) -> str:
    rows = [("tau / largest tau", "centres", "GFC")]
    rows += [(f"{tau:g}" if tau else "exact", f"{n:.0f}", f"{gfc:.4f}") for tau, n, gfc in result.sparsity]
    return "\n".join(
        [
            "## Sparse or exact (simulated, mean over S1 ... S9, plain)\n",
            _table(rows),
            "\nThe sparse solution minimises SpaRSA's objective (scikit-learn's MultiTaskLasso: one "
            "set of centres for "
            "all outputs) and refits the centres it keeps.\n",
        ]
    )


def _times_section(result: Study) -> str:
    fits = [("rate", "order", "segmentation", "fit in all", "baking")]
    for t in result.fits:
        seconds = f"{t.segmenting_s:.3f} s", f"{t.fitting_s:.2f} s", f"{t.baking_s:.2f} s"
        fits.append((f"{t.fs:g} Hz", str(t.order), *seconds))
    renders = [("texture", "order", "median", "p99.9", "CPU median", "CPU p99.9", "operations a sample")]
    renders += [
        (t.family, str(t.order), f"{t.median_us:.0f} µs", f"{t.p999_us:.0f} µs", f"{t.cpu_median_us:.0f} µs",
         f"{t.cpu_p999_us:.0f} µs", f"{t.operations:,.0f}")
        for t in result.renders
    ]  # fmt: skip
    return "\n".join(
        [
            "## Times\n\nFit of 20 s (limit: 5 s):\n",
            _table(fits),
            "\nFour contacts, one sample per call, together, on a machine that others use too (limit: "
            "p99.9 below 100 µs; "
            "the buffered network computes LSF and k every 16 samples, the baked one reads a grid of "
            "k at each):\n",
            _table(renders),
            "",
        ]
    )


def _of(row: SurfaceScores, way: str) -> Score:
    score = row.scores.get(way)
    return Score(float("nan"), float("nan"), float("nan")) if score is None else score


def _score_table(rows: Sequence[SurfaceScores], ways: Sequence[str], *, level: bool = False) -> str:
    def shown(row: SurfaceScores, way: str) -> str:
        score = row.scores.get(way)
        if score is None:
            return "-"
        return f"{score.level_db:.1f}" if level else f"{score.gfc:.3f} ± {score.deviation:.3f}"

    table = [("", *(row.name for row in rows))]
    if not level:
        table.append(("segments", *(str(row.n_segments) for row in rows)))
    else:
        powers = (f"{row.growth[0]:.2f}, {row.growth[1]:.2f}" for row in rows)
        table.append(("exponents of speed, force", *powers))
    return _table(table + [(way, *(shown(row, way) for row in rows)) for way in ways])


def _table(rows: Sequence[tuple[str, ...]]) -> str:
    rule = "|" + " --- |" * len(rows[0])
    return "\n".join([line_of(rows[0]), rule, *map(line_of, rows[1:])])
