"""Generate a page per feature: declaration, dependence on surface and operator, results for bad input."""

import json
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import texclass as tx
from texclass.features.contract_checks import check_degenerate_inputs
from texclass.reporting.figure_style import DPI, OURS, STYLE
from texclass.shipped import names
from texclass.simulate import Grating, Surface, operator_catalogue, record_freehand

COSTS = Path(__file__).parents[2] / "reports" / "tables" / "simulated-tradeoff.json"
SURFACE = Surface(
    "plain", "wood", rms_um=2.0, slope=3.9, corner_mm=1.3, gratings=(), bumps=None, stiffness_n_m=60e3,
    dissipation_s_m=9.0, static_friction=0.46, kinetic_friction=0.35,
)  # fmt: skip
OPERATOR = operator_catalogue(1, seed=0)[0]
SWEEPS = {
    "roughness in µm": (np.geomspace(0.5, 8, 5), lambda v: (replace(SURFACE, rms_um=v), OPERATOR)),
    "stiffness in kN/m": (
        np.geomspace(8, 128, 5),
        lambda v: (replace(SURFACE, stiffness_n_m=1e3 * v), OPERATOR),
    ),
    "period of a grating in mm": (
        np.geomspace(1, 8, 5),
        lambda v: (replace(SURFACE, gratings=(Grating(v, depth_um=30.0),)), OPERATOR),
    ),
    "coefficient of friction": (
        np.geomspace(0.15, 0.9, 5),
        lambda v: (replace(SURFACE, kinetic_friction=v, static_friction=1.3 * v), OPERATOR),
    ),
    "speed of the hand in mm/s": (
        np.geomspace(50, 200, 5),
        lambda v: (SURFACE, replace(OPERATOR, speed_mm_s=v)),
    ),
    "force of the hand in N": (np.geomspace(0.4, 2.4, 5), lambda v: (SURFACE, replace(OPERATOR, force_n=v))),
}
"""Property -> its values, and a function that returns surface and operator for a value."""
SEEDS = range(4)


def write_feature_pages(folder):
    """Write the index page, and a page with a figure for each registered feature."""
    folder.mkdir()
    features = tx.features.list_features()
    values = sweep_properties(features)
    costs = {
        cost["feature"]: cost["alone"] for cost in json.loads(COSTS.read_text(encoding="utf-8"))["costs"]
    }
    sets = {
        name: {m.feature.name for m in tx.load_feature_set(name).members} for name in names("feature_defs")
    }
    for name, feature in features.items():
        plot_feature(feature, values, folder / f"{name}.png")
        members_of = [f"``{set_name}``" for set_name, members in sets.items() if name in members]
        (folder / f"{name}.rst").write_text(
            feature_page(feature, costs.get(name), members_of), encoding="utf-8"
        )
    (folder / "index.rst").write_text(index_page(features.values()), encoding="utf-8")


def sweep_properties(features):
    """Return, for each property, its values and the features of recordings simulated with them."""
    printed = {member.feature.name for member in tx.load_feature_set("strese2015").members}
    with tempfile.TemporaryDirectory() as folder:
        sets = []
        for is_printed in (True, False):  # only corrected features remove hand motion
            sections = [f"[features.{name}]" for name in features if (name in printed) == is_printed]
            file = Path(folder) / f"printed_{is_printed}.toml"
            file.write_text(
                "\n".join([f"remove_hand_motion = {str(not is_printed).lower()}", *sections]),
                encoding="utf-8",
            )
            sets.append(tx.load_feature_set(file))
    tables = {}
    for title, (xs, surface_and_operator) in SWEEPS.items():
        recordings = [
            record_freehand(*surface_and_operator(x), duration_s=4.0, seed=seed) for x in xs for seed in SEEDS
        ]
        tables[title] = xs, pd.concat([tx.extract(recordings, one) for one in sets], axis=1)
    return tables


def plot_feature(feature, values, path):
    """Plot a feature against each property: a dot per recording, or a line per column minus its median."""
    columns = list(feature.columns(feature.name, {}))
    is_scalar = len(columns) == 1
    colours = [OURS] if is_scalar else mpl.colormaps["viridis"](np.linspace(0, 0.85, len(columns)))
    level = 0.0 if is_scalar else pd.concat([table[columns] for _, table in values.values()]).median()
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8, 4.6), layout="constrained")
        panels = figure.subplots(2, 3, sharey=True)
        for axes in panels[:, 0]:
            axes.set_ylabel(feature.unit if feature.unit != "1" else "value")
        for axes, (title, (xs, table)) in zip(panels.flat, values.items(), strict=True):
            x_values = np.repeat(xs, len(SEEDS))
            y = (table[columns] - level).set_axis(x_values)
            axes.set_prop_cycle(color=colours)
            axes.plot(y.groupby(level=0).median(), linewidth=1.5 if len(columns) < 10 else 0.8)
            if is_scalar:
                axes.plot(x_values, y, "o", markersize=3, alpha=0.6)
            axes.set_xscale("log")
            axes.set_xticks(xs, [f"{x:.2g}" if x < 10 else f"{x:.0f}" for x in xs])
            axes.set_xticks([], minor=True)
            axes.set_xlabel(title)
        figure.savefig(path, dpi=DPI)


def feature_page(feature, cost_ms, sets):
    """Return the page of a feature."""
    columns = feature.columns(feature.name, {})
    outputs = (
        f"``{columns[0]}``" if len(columns) == 1 else f"{len(columns)}: ``{columns[0]}`` … ``{columns[-1]}``"
    )
    facts = {
        "Reads": {
            "tap": "the taps",
            "movement": "the movement",
            "travel": "the movement over the path of the tool (needs its speed)",
            "friction": "the friction signal",
            "pair": "the movements of two channels",
        }[feature.phase],
        "Source": feature.reference,
        "Unit": feature.unit if feature.unit != "1" else "1 (dimensionless)",
        "Columns": outputs,
        "Signal multiplied by g": f"y becomes {feature.gain}"
        if str(feature.gain) != "y"
        else "y is unchanged",
        "Depends on": ", ".join(sorted(feature.depends_on)) or "not on length, rate or sign of the signal",
        "In the sets": ", ".join(sets) or "no shipped set",
        "Cost": f"{cost_ms:.2g} ms per recording if computed alone (:doc:`/reports/tables/simulated`)"
        if cost_ms
        else "``texclass tradeoff`` measures it on your recordings",
    }
    results = [
        (result["input"], "value" if result["outcome"] == "value" else "NaN", result["detail"])
        for result in check_degenerate_inputs(feature)
    ]
    legend = "Dots: recordings; lines: medians"
    if len(columns) > 1:
        legend = "Lines: columns, from dark (first) to bright (last); median minus the median of all"
    return "\n".join(
        [
            *heading(feature.name, "="),
            *list_table(facts.items(), widths="20 80", stub=True),
            *heading("Dependence on surface and operator", "-"),
            "Simulated recordings in which one property of surface or operator is varied.",
            f"{legend}. All panels have the same vertical axis.",
            "",
            f".. image:: {feature.name}.png",
            f"   :alt: {feature.name} against six properties of surface and hand",
            "",
            *heading("Definition", "-"),
            f".. autofunction:: {feature.function.__module__}.{feature.name}",
            "",
            *heading("Results for bad input", "-"),
            *list_table([("Input", "Result", "Value or reason"), *results], widths="25 15 60", header=True),
        ]
    )


def index_page(features):
    """Return the table of all features, by the phase they read."""
    lines = [
        *heading("Features", "="),
        "Each page shows the declaration of a feature (reference, phase, unit, gain law), its dependence on",
        "surface and operator, an example, and its results for bad input. To test your own feature, see",
        ":doc:`/evaluate-feature`.",
        "",
    ]
    by_phase = {
        "movement": "Movement",
        "travel": "Movement over the path of the tool (needs its speed)",
        "tap": "Taps",
        "friction": "Friction signal",
        "pair": "Pairs of channels",
    }
    for phase, title in by_phase.items():
        rows = [(f":doc:`{f.name}`", f.summary, f.reference) for f in features if f.phase == phase]
        lines += heading(title, "-") + list_table(
            [("Feature", "Summary", "Source"), *rows], "25 50 25", header=True
        )
    return "\n".join([*lines, ".. toctree::", "   :hidden:", "", *(f"   {f.name}" for f in features)])


def heading(text, line):
    """Return the lines of a heading."""
    return [text, line * len(text), ""]


def list_table(rows, widths, *, header=False, stub=False):
    """Return the lines of a list table."""
    lines = [".. list-table::", f"   :widths: {widths}"]
    lines += ["   :header-rows: 1"] * header + ["   :stub-columns: 1"] * stub + [""]
    for row in rows:
        lines += [
            f"   {'*' if i == 0 else ' '} - {cell.replace('|', chr(92) + '|')}" for i, cell in enumerate(row)
        ]
    return [*lines, ""]
