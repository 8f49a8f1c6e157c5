"""Change of features with speed and force on one surface, relative to differences between surfaces.

`python benchmarks/invariance_study.py [--surfaces N]` writes reports/studies/invariance: strese2015,
Figs. 8-10 and 12, for every feature of both sets, ours and the related work's, on controlled runs of
simulated surfaces (a plate that turns faster and faster, a force that rises, taps that hit harder).
"""

import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from study import command_line, table, write

from texclass.features import load_feature_set
from texclass.features.plan import Plan
from texclass.phases import find_phases
from texclass.recording import AUXILIARY_UNITS, Phases, Recording, Tap
from texclass.reporting import Table
from texclass.reporting.figure_style import LOOKS, MUTED, OTHER, OURS, THIRD
from texclass.simulate import (
    Surface,
    operator_catalogue,
    record_rising_force,
    record_rising_speed,
    record_rising_taps,
    surface_catalogue,
)

SEED = 2015
N_STEPS, REST_S, RUN_S = 9, 0.5, 9.5
RELATED = {
    "gaussian_band_energies", "discretized_spectrogram", "spectral_centroid", "standard_roughness",
    "lpc_coefficients", "mean_magnitude", "variance", "wavelet_energy", "spectral_peaks",
}  # fmt: skip
"""Features of the works that strese2015 compares with."""
CONDITIONS = {"speed": "speed 20 to 200 mm/s", "force": "force 0.4 to 2.5 N", "impact": "rising impacts"}
UNITS = {
    ("strese2015", "hardness"): "hardness (1)",
    ("texclass", "hardness"): "hardness (1/s²)",
    ("strese2015", "temporal_roughness"): "temporal roughness (log10(m/s²))",
    ("strese2015", "fineness"): "fineness (DCT bin)",
    ("texclass", "fineness"): "fineness (Hz)",
}


def pieces(surface: Surface, seed: int) -> Iterator[tuple[str, int, Recording]]:
    """Yield (condition, step, recording): each second of a rising run, every three rising taps."""
    operator = replace(operator_catalogue(1, SEED)[0], direction_deg=0.0)
    for condition, record in (("speed", record_rising_speed), ("force", record_rising_force)):
        run = record(surface, operator, duration_s=RUN_S, seed=seed)
        for step in range(N_STEPS):
            start = int((REST_S + step) * run.fs)
            yield condition, step, run.with_(phases=Phases(movement=(start, start + int(run.fs))))
    run = record_rising_taps(surface, operator, n_taps=3 * N_STEPS, seed=seed)
    taps = find_phases(run).taps
    names = [name for name in AUXILIARY_UNITS if getattr(run, name) is not None]
    rest = taps[0].start
    for step in range(len(taps) // 3):
        # The rest before the first tap of the run, then these taps: what came between is left out.
        chosen = taps[3 * step : 3 * step + 3]
        start, moved = chosen[0].start, rest - chosen[0].start
        indices_kept = np.r_[0:rest, start : chosen[-1].end]
        yield (
            "impact",
            step,
            run.with_(
                acceleration=run.acceleration[indices_kept],
                phases=Phases(
                    taps=tuple(Tap(t.start + moved, t.impact + moved, t.end + moved) for t in chosen)
                ),
                **{name: getattr(run, name)[indices_kept] for name in names},
            ),
        )


def spreads(values: pd.DataFrame, columns: tuple[str, ...], condition: str) -> dict[str, float]:
    """Return between-surface over within-surface deviation of a feature, and how monotonic it is.

    b^2 is the variance of the surfaces' means, w^2 the mean variance within a surface along the run; columns
    of a vector feature are averaged in units of their own total variance. NaN where too few have a value.
    """
    part = values[values["condition"] == condition].dropna(subset=list(columns))
    of_surface = part.groupby("surface")
    if len(of_surface) < values["surface"].nunique() // 2 or of_surface.size().min() < 3:
        return {"ratio": np.nan, "trend": np.nan}
    grouped = of_surface[list(columns)]
    between_variance, within_variance = grouped.mean().var(ddof=1), grouped.var(ddof=1).mean()
    total = between_variance + within_variance
    rank = of_surface.apply(
        lambda g: g[list(columns)].corrwith(g["step"], method="spearman"), include_groups=False
    )
    return {
        "ratio": float(np.sqrt((between_variance / total).mean() / (within_variance / total).mean())),
        "trend": float(rank.abs().mean().mean()),
    }


def study(name: str, surfaces: tuple[Surface, ...]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the measured values of a set (one row a piece), and one row a feature and condition."""
    feature_set = load_feature_set(name)
    plan, rows = Plan.of(feature_set), []
    values = pd.DataFrame(
        {"surface": surface.name, "condition": condition, "step": step}
        | dict(zip(plan.columns, plan.compute(recording).values, strict=True))
        for i, surface in enumerate(surfaces)
        for condition, step, recording in pieces(surface, SEED + i)
    )
    for member in feature_set.members:
        for condition in ("impact",) if member.feature.phase == "tap" else ("speed", "force"):
            origin = "related work" if member.name in RELATED else name
            facts = {"set": name, "origin": origin, "feature": member.name, "condition": condition}
            rows.append(facts | spreads(values, member.columns, condition))
    return values, pd.DataFrame(rows)


def course(axes: Axes, values: pd.DataFrame, condition: str, title: str, lines: dict[str, pd.Series]) -> None:
    """Draw values along a recording, one line each, with different colours and markers."""
    for (name, line), (colour, mark) in zip(lines.items(), LOOKS, strict=False):
        axes.plot(values.loc[line.index, "step"] + 1, line, f"{mark}-", ms=4, lw=1, color=colour, label=name)
    axes.set_title(title, fontsize=8, loc="left")
    axes.set_xlabel(f"{N_STEPS} pieces, {CONDITIONS[condition]}", fontsize=7)
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3)


def summary(axes: Axes, trends: pd.DataFrame) -> None:
    """Draw the ratio of every feature, best first: a dot a condition."""
    order = trends.groupby(["set", "feature", "origin"], sort=False)["ratio"].min().dropna()
    order = order.sort_values(ascending=False).reset_index()
    marks = {"speed": "o", "force": "s", "impact": "^"}
    tint = {"texclass": OURS, "strese2015": THIRD, "related work": OTHER}
    for y, row in order.iterrows():
        rows = trends[(trends["set"] == row["set"]) & (trends["feature"] == row["feature"])]
        axes.hlines(y, rows["ratio"].min(), rows["ratio"].max(), color=tint[row["origin"]], lw=1)
        for _, point in rows.iterrows():
            axes.plot(point["ratio"], y, marks[point["condition"]], ms=4, color=tint[row["origin"]])
    axes.axvline(1, color=MUTED, lw=0.8, ls=":")
    axes.set_yticks(range(len(order)), order["feature"] + ", " + order["origin"], fontsize=7)
    axes.set(ylim=(len(order) - 0.4, -0.6), xscale="log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("deviation between surfaces over that within one, times (right is better)", fontsize=8)
    axes.tick_params(axis="x", labelsize=7)
    axes.grid(axis="x", which="both", alpha=0.3)
    for origin, colour in tint.items():
        axes.plot([], [], "-", color=colour, label=origin)
    for condition, mark in marks.items():
        axes.plot([], [], mark, color=MUTED, ms=4, label=CONDITIONS[condition])
    axes.legend(fontsize=6.5, loc="lower right")


def draw(printed: pd.DataFrame, ours: pd.DataFrame, trends: pd.DataFrame, names: list[str]) -> Figure:
    """Draw the paper's figures on the left, every feature on the right."""
    figure = Figure(figsize=(13, 9), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1.15, 1))
    axes = left.subplots(3, 2).ravel()
    for place, values, condition, column, title in (
        (0, printed, "impact", "hardness", "Fig. 8: as printed"),
        (1, ours, "impact", "hardness", "corrected (texclass)"),
        (3, printed, "force", "temporal_roughness", "Fig. 10: as printed"),
        (4, printed, "speed", "fineness", "Fig. 12: as printed"),
        (5, ours, "speed", "fineness", "corrected (texclass)"),
    ):
        axes[place].set_ylabel(UNITS["texclass" if values is ours else "strese2015", column], fontsize=7)
        along = values[values["condition"] == condition]
        lines = {name: along.loc[along["surface"] == name, column] for name in names}
        course(axes[place], values, condition, title, lines)
    along = printed[(printed["surface"] == names[0]) & (printed["condition"] == "force")]
    eq3, power = 10 ** along["temporal_roughness"], along["standard_roughness"]
    lines = {
        "temporal roughness, eq. 3": eq3 / eq3.iloc[0],
        "power of the vibration [7]": power / power.iloc[0],
    }
    course(axes[2], printed, "force", f"Fig. 9: two roughnesses of {names[0]}", lines)
    axes[2].set_ylabel("times the first value", fontsize=7)
    for hardness in axes[:2]:
        hardness.set_yscale("log")
    axes[2].legend(fontsize=6, frameon=False)
    left.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=len(names), fontsize=7)
    summary(right.subplots(), trends)
    return figure


def main() -> None:
    args = command_line(__doc__, surfaces=24)
    surfaces = surface_catalogue(args.surfaces, SEED)
    (printed, first), (ours, second) = study("strese2015", surfaces), study("texclass", surfaces)
    trends = pd.concat([first, second], ignore_index=True)
    chosen = [surfaces[i].name for i in np.linspace(0, len(surfaces) - 1, 4).astype(int)]
    result = {
        "kind": "invariance",
        "seed": SEED,
        "rows": json.loads(trends.to_json(orient="records", double_precision=15)),  # NaN becomes null
    }
    of = trends.set_index(["set", "feature", "condition"])
    hard, corrected = of.loc["strese2015", "hardness", "impact"], of.loc["texclass", "hardness", "impact"]
    eq3 = of.loc["strese2015", "temporal_roughness", "force"]
    power = of.loc["strese2015", "standard_roughness", "force"]
    fine = of.loc["strese2015", "fineness", "speed"]
    medians = trends.pivot_table("ratio", "origin", "condition", "median")
    blocks = [
        f"{len(surfaces)} simulated surfaces; runs with rising speed (20 to 200 mm/s at 1 N) and rising "
        f"force (0.4 to 2.5 N at 100 mm/s) in {N_STEPS} pieces of 1 s; rising taps in threes. ratio: "
        "deviation between the surfaces' means over deviation within a surface along its run; above 1, "
        "surfaces differ more than conditions change the value. trend: mean |Spearman| with the condition; "
        "0: none, 1: follows it.",
        [
            f"Fig. 8, hardness, rising impacts: ratio {hard.ratio:.2f} printed, "
            f"{corrected.ratio:.2f} corrected.",
            f"Figs. 9 and 10, roughness, rising force: trend {eq3.trend:.2f} for eq. 3, {power.trend:.2f} "
            f"for the power of [7]; ratio {eq3.ratio:.2f} and {power.ratio:.2f}.",
            f"Fig. 12, fineness, rising speed: trend {fine.trend:.2f}, ratio {fine.ratio:.2f}. The paper "
            "finds it nearly constant.",
        ],
        table(
            trends,
            "set = {set} | feature = {feature} | from = {origin} | condition = {condition} | "
            "ratio = {ratio:.2f} | trend = {trend:.2f}",
            "nan: undefined on most surfaces.",
            n_words=4,
        ),
        "Median ratio of the features:",
        Table(medians.reset_index(names="from")),
    ]
    title = "Scan-time invariance: strese2015, Figs. 8-10 and 12, for every feature"
    write(args.out, "invariance", result, title, blocks, draw(printed, ours, trends, chosen))


if __name__ == "__main__":
    main()
