"""How far features change with speed and force on one surface, against how far apart surfaces are.

Run `python tests/benchmarks/invariance_study.py`; it writes `reports/studies/invariance.{md,json,png}`:
strese2015, Figs. 8-10 and 12, for every feature of both sets, ours and the related work's, on controlled
runs of simulated surfaces (a plate that turns faster and faster, a force that rises, taps that hit harder).
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from texclass import __version__
from texclass.features import FeatureSet, load_feature_set
from texclass.features.extractor import Plan
from texclass.phases import segment
from texclass.recording import AUXILIARY_UNITS, Phases, Recording, Tap
from texclass.simulate import (
    Surface,
    operator_catalogue,
    record_rising_force,
    record_rising_speed,
    record_rising_taps,
    surface_catalogue,
)

ROOT = Path(__file__).parents[2]
SEED = 2015
N_SURFACES, N_STEPS, REST_S, RUN_S = 24, 9, 0.5, 9.5
RELATED = {
    "gaussian_band_energies", "discretized_spectrogram", "spectral_centroid", "standard_roughness",
    "lpc_coefficients", "mean_magnitude", "variance", "wavelet_energy", "spectral_peaks",
}  # fmt: skip
"""Features of the works that strese2015 compares with."""
CONDITIONS = {"speed": "speed 20 to 200 mm/s", "force": "force 0.4 to 2.5 N", "impact": "rising impacts"}
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#555555")


def pieces(surface: Surface, seed: int) -> Iterator[tuple[str, int, Recording]]:
    """Yield (condition, step, recording): each second of a rising run, every three rising taps."""
    operator = replace(operator_catalogue(1, SEED)[0], direction_deg=0.0)
    for condition, record in (("speed", record_rising_speed), ("force", record_rising_force)):
        run = record(surface, operator, duration_s=RUN_S, seed=seed)
        for step in range(N_STEPS):
            start = int((REST_S + step) * run.fs)
            yield condition, step, run.with_(phases=Phases(movement=(start, start + int(run.fs))))
    taps = record_rising_taps(surface, operator, n_taps=3 * N_STEPS, seed=seed)
    found = segment(taps).taps
    for step in range(len(found) // 3):
        yield "impact", step, with_taps(taps, found[0].start, found[3 * step : 3 * step + 3])


def with_taps(recording: Recording, rest: int, taps: tuple[Tap, ...]) -> Recording:
    """The rest before the first tap of a run, then some of its taps: what came between is left out."""
    start, stop = taps[0].start, taps[-1].end
    kept = np.r_[0:rest, start:stop]
    moved = tuple(Tap(t.start - start + rest, t.impact - start + rest, t.end - start + rest) for t in taps)
    names = [name for name in AUXILIARY_UNITS if getattr(recording, name) is not None]
    return recording.with_(
        acceleration=recording.acceleration[kept],
        phases=Phases(taps=moved),
        **{name: getattr(recording, name)[kept] for name in names},
    )


def measure(feature_set: FeatureSet, surfaces: tuple[Surface, ...]) -> pd.DataFrame:
    """One row a piece: surface, condition, step, then the columns of the set (NaN where undefined)."""
    plan, rows = Plan.of(feature_set), []
    for i, surface in enumerate(surfaces):
        for condition, step, recording in pieces(surface, SEED + i):
            values = dict(zip(plan.columns, plan.compute(recording).values, strict=True))
            rows.append({"surface": surface.name, "condition": condition, "step": step, **values})
    return pd.DataFrame(rows)


def spreads(values: pd.DataFrame, columns: tuple[str, ...], condition: str) -> dict[str, float] | None:
    """Return between-surface over within-surface deviation of a feature, and how monotonic it is.

    b^2 is the variance of the surfaces' means, w^2 the mean variance within a surface along the run; columns
    of a vector feature are averaged in units of their own total variance.
    """
    part = values[values["condition"] == condition].dropna(subset=list(columns))
    if part["surface"].nunique() < N_SURFACES // 2 or part.groupby("surface").size().min() < 3:
        return None
    grouped = part.groupby("surface")[list(columns)]
    between, within = grouped.mean().var(ddof=1), grouped.var(ddof=1).mean()
    total = between + within
    rank = part.groupby("surface").apply(
        lambda g: g[list(columns)].corrwith(g["step"], method="spearman"), include_groups=False
    )
    return {
        "ratio": float(np.sqrt((between / total).mean() / (within / total).mean())),
        "trend": float(rank.abs().mean().mean()),
    }


def study(name: str, surfaces: tuple[Surface, ...]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the measured values of a set, and one row a feature and condition."""
    feature_set = load_feature_set(name)
    values, rows = measure(feature_set, surfaces), []
    for member in feature_set.members:
        for condition in ("impact",) if member.feature.phase == "tap" else ("speed", "force"):
            found = spreads(values, member.columns, condition)
            origin = "related work" if member.name in RELATED else name
            facts = {"set": name, "origin": origin, "feature": member.name, "condition": condition}
            rows.append(facts | (found or {"ratio": np.nan, "trend": np.nan}))
    return values, pd.DataFrame(rows)


def course(
    axes: Axes, values: pd.DataFrame, condition: str, column: str, names: list[str], title: str
) -> None:
    """Draw a feature along a run, one line a surface."""
    for name, colour in zip(names, COLOURS, strict=False):
        run = values[(values["surface"] == name) & (values["condition"] == condition)]
        axes.plot(run["step"] + 1, run[column], "o-", ms=3, lw=1, color=colour, label=name)
    axes.set_title(title, fontsize=8, loc="left")
    axes.set_xlabel(CONDITIONS[condition], fontsize=7)
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3)


def roughness(axes: Axes, values: pd.DataFrame, name: str) -> None:
    """Fig. 9: two definitions of roughness on one surface, rising force, each over its own first value."""
    run = values[(values["surface"] == name) & (values["condition"] == "force")]
    for column, label, colour in (
        ("standard_roughness", "power of the vibration [7]", COLOURS[1]),
        ("temporal_roughness", "temporal roughness, eq. 3", COLOURS[0]),
    ):
        amount = run[column] if column == "standard_roughness" else 10 ** run[column]
        axes.plot(run["step"] + 1, amount / amount.iloc[0], "o-", ms=3, lw=1, color=colour, label=label)
    axes.set_title(f"Fig. 9: two roughnesses of {name}, over the first value", fontsize=8, loc="left")
    axes.set_xlabel(CONDITIONS["force"], fontsize=7)
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=6, frameon=False)


def summary(axes: Axes, table: pd.DataFrame) -> None:
    """Draw the ratio of every feature, best first: a dot a condition."""
    order = table.groupby(["set", "feature", "origin"], sort=False)["ratio"].min().dropna()
    order = order.sort_values(ascending=False).reset_index()
    marks = {"speed": "o", "force": "s", "impact": "^"}
    tint = {"texclass": COLOURS[0], "strese2015": COLOURS[2], "related work": COLOURS[1]}
    for y, row in order.iterrows():
        rows = table[(table["set"] == row["set"]) & (table["feature"] == row["feature"])]
        axes.hlines(y, rows["ratio"].min(), rows["ratio"].max(), color=tint[row["origin"]], lw=1)
        for _, point in rows.iterrows():
            axes.plot(point["ratio"], y, marks[point["condition"]], ms=4, color=tint[row["origin"]])
    axes.axvline(1, color="#888888", lw=0.8, ls=":")
    axes.set_yticks(range(len(order)), order["feature"], fontsize=7)
    for label, origin in zip(axes.get_yticklabels(), order["origin"], strict=True):
        label.set_color(tint[origin])
    axes.set_ylim(len(order) - 0.4, -0.6)
    axes.set_xscale("log")
    axes.set_xlabel("between-surface / within-surface deviation (right is better)", fontsize=8)
    axes.tick_params(axis="x", labelsize=7)
    axes.grid(axis="x", which="both", alpha=0.3)
    for origin, colour in tint.items():
        axes.plot([], [], "-", color=colour, label=origin)
    for condition, mark in marks.items():
        axes.plot([], [], mark, color="#555555", ms=4, label=CONDITIONS[condition])
    axes.legend(fontsize=6.5, loc="lower right")


def draw(
    printed: pd.DataFrame, ours: pd.DataFrame, table: pd.DataFrame, names: list[str], path: Path
) -> None:
    """Draw the paper's figures on the left, every feature on the right."""
    figure = Figure(figsize=(13, 9), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1.15, 1))
    axes = left.subplots(3, 2).ravel()
    course(axes[0], printed, "impact", "hardness", names, "Fig. 8: hardness as printed")
    course(axes[1], ours, "impact", "hardness", names, "hardness, corrected (texclass)")
    for hardness in axes[:2]:
        hardness.set_yscale("log")
    roughness(axes[2], printed, names[0])
    course(axes[3], printed, "force", "temporal_roughness", names, "Fig. 10: temporal roughness as printed")
    course(axes[4], printed, "speed", "fineness", names, "Fig. 12: fineness as printed")
    course(axes[5], ours, "speed", "fineness", names, "fineness, corrected (texclass)")
    axes[5].legend(fontsize=6, frameon=False)
    summary(right.subplots(), table)
    figure.savefig(path, dpi=130, metadata={"Software": None})


def verdicts(table: pd.DataFrame) -> list[str]:
    """Say what became of the paper's four figures, in numbers."""

    def of(name: str, feature: str, condition: str) -> pd.Series:
        found = table["set"].eq(name) & table["feature"].eq(feature) & table["condition"].eq(condition)
        return table[found].iloc[0]

    printed, ours = of("strese2015", "hardness", "impact"), of("texclass", "hardness", "impact")
    eq3, power = (
        of("strese2015", "temporal_roughness", "force"),
        of("strese2015", "standard_roughness", "force"),
    )
    fine = of("strese2015", "fineness", "speed")
    return [
        f"- Fig. 8, hardness, rising impacts: ratio {printed.ratio:.2f} printed, {ours.ratio:.2f} corrected.",
        f"- Figs. 9 and 10, roughness, rising force: trend {eq3.trend:.2f} for eq. 3, {power.trend:.2f} for "
        f"the power of [7]; ratio {eq3.ratio:.2f} and {power.ratio:.2f}.",
        f"- Fig. 12, fineness, rising speed: trend {fine.trend:.2f}, ratio {fine.ratio:.2f}. The paper finds "
        "it nearly constant.",
    ]


def report(table: pd.DataFrame) -> list[str]:
    """Return the Markdown: both sets, feature by feature."""
    lines = [
        "# Scan-time invariance: strese2015, Figs. 8-10 and 12, for every feature",
        "",
        "![courses and ratios](invariance.png)",
        "",
        f"{N_SURFACES} simulated surfaces; runs with rising speed (20 to 200 mm/s at 1 N) and rising force "
        f"(0.4 to 2.5 N at 100 mm/s) in {N_STEPS} pieces of 1 s; rising taps in threes. "
        "ratio: deviation between the surfaces' means over deviation within a surface along its run; above "
        "1, surfaces differ more than conditions change the value. trend: mean |Spearman| with the "
        "condition; 0: none, 1: follows it.",
        "",
        *verdicts(table),
        "",
        "| set | feature | from | condition | ratio | trend |",
        "|---|---|---|---|---:|---:|",
    ]
    lines += [
        f"| {r.set} | {r.feature} | {r.origin} | {r.condition} | "
        + ("undefined | |" if np.isnan(r.ratio) else f"{r.ratio:.2f} | {r.trend:.2f} |")
        for r in table.itertuples()
    ]
    medians = table.pivot_table("ratio", "origin", "condition", "median")
    lines += ["", "Median ratio of the features:", "", "| from | " + " | ".join(medians.columns) + " |"]
    lines += ["|---|" + "---:|" * len(medians.columns)]
    for origin, row in medians.iterrows():
        cells = " | ".join("-" if np.isnan(v) else f"{v:.2f}" for v in row)
        lines.append(f"| {origin} | {cells} |")
    return lines


def main() -> None:
    """Run the study and write its report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "studies")
    out: Path = parser.parse_args().out
    surfaces = surface_catalogue(N_SURFACES, SEED)
    printed, first = study("strese2015", surfaces)
    ours, second = study("texclass", surfaces)
    table = pd.concat([first, second], ignore_index=True)
    chosen = [surfaces[i].name for i in np.linspace(0, N_SURFACES - 1, 4).astype(int)]
    out.mkdir(parents=True, exist_ok=True)
    draw(printed, ours, table, chosen, out / "invariance.png")
    lines = report(table)
    lines += [
        "",
        f"texclass {__version__}, numpy {np.__version__}, seed {SEED}; the recordings are simulated.",
    ]
    (out / "invariance.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    rows = json.loads(table.to_json(orient="records"))
    document = {"versions": {"texclass": __version__, "numpy": np.__version__}, "seed": SEED, "rows": rows}
    (out / "invariance.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
