"""Generate a page per feature: its declaration, its results for bad input, and what changes its value."""

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
PERSON = operator_catalogue(1, seed=0)[0]
SWEEPS = {
    "roughness in µm": (np.geomspace(0.5, 8, 5), lambda v: (replace(SURFACE, rms_um=v), PERSON)),
    "stiffness in kN/m": (
        np.geomspace(8, 128, 5),
        lambda v: (replace(SURFACE, stiffness_n_m=1e3 * v), PERSON),
    ),
    "period of a grating in mm": (
        np.geomspace(1, 8, 5),
        lambda v: (replace(SURFACE, gratings=(Grating(v, depth_um=30.0),)), PERSON),
    ),
    "coefficient of friction": (
        np.geomspace(0.15, 0.9, 5),
        lambda v: (replace(SURFACE, kinetic_friction=v, static_friction=1.3 * v), PERSON),
    ),
    "speed of the hand in mm/s": (
        np.geomspace(50, 200, 5),
        lambda v: (SURFACE, replace(PERSON, speed_mm_s=v)),
    ),
    "force of the hand in N": (np.geomspace(0.4, 2.4, 5), lambda v: (SURFACE, replace(PERSON, force_n=v))),
}
"""Property that is varied -> its values, and a function from value to surface and operator."""
SEEDS = range(4)


def write_feature_pages(folder):
    """Write the index, and a page with a figure for each registered feature."""
    folder.mkdir()
    features = tx.features.list_features()
    values = swept(features)
    costs = {
        cost["feature"]: cost["alone"] for cost in json.loads(COSTS.read_text(encoding="utf-8"))["costs"]
    }
    sets = {
        name: {m.feature.name for m in tx.load_feature_set(name).members} for name in names("feature_defs")
    }
    for name, feature in features.items():
        draw(feature, values, folder / f"{name}.png")
        within = [f"``{name_of_set}``" for name_of_set, members in sets.items() if name in members]
        (folder / f"{name}.rst").write_text(page(feature, costs.get(name), within), encoding="utf-8")
    (folder / "index.rst").write_text(index(features.values()), encoding="utf-8")


def swept(features):
    """Return the values of each property and the features of recordings simulated with them."""
    printed = {member.feature.name for member in tx.load_feature_set("strese2015").members}
    with tempfile.TemporaryDirectory() as place:
        sets = []
        for of_paper in (True, False):  # only corrected features remove hand motion
            listed = [f"[features.{name}]" for name in features if (name in printed) == of_paper]
            file = Path(place) / f"printed_{of_paper}.toml"
            file.write_text(
                "\n".join([f"remove_hand_motion = {str(not of_paper).lower()}", *listed]), encoding="utf-8"
            )
            sets.append(tx.load_feature_set(file))
    tables = {}
    for title, (xs, made) in SWEEPS.items():
        recordings = [record_freehand(*made(x), duration_s=4.0, seed=seed) for x in xs for seed in SEEDS]
        tables[title] = xs, pd.concat([tx.extract(recordings, one) for one in sets], axis=1)
    return tables


def draw(feature, values, path):
    """Plot a feature against each property: a dot per recording, or a line per column minus its median."""
    columns = list(feature.columns(feature.name, {}))
    alone = len(columns) == 1
    colours = [OURS] if alone else mpl.colormaps["viridis"](np.linspace(0, 0.85, len(columns)))
    level = 0.0 if alone else pd.concat([table[columns] for _, table in values.values()]).median()
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8, 4.6), layout="constrained")
        panels = figure.subplots(2, 3, sharey=True)
        for axes in panels[:, 0]:
            axes.set_ylabel(feature.unit if feature.unit != "1" else "value")
        for axes, (title, (xs, table)) in zip(panels.flat, values.items(), strict=True):
            at = np.repeat(xs, len(SEEDS))
            y = (table[columns] - level).set_axis(at)
            axes.set_prop_cycle(color=colours)
            axes.plot(y.groupby(level=0).median(), linewidth=1.5 if len(columns) < 10 else 0.8)
            if alone:
                axes.plot(at, y, "o", markersize=3, alpha=0.6)
            axes.set_xscale("log")
            axes.set_xticks(xs, [f"{x:.2g}" if x < 10 else f"{x:.0f}" for x in xs])
            axes.set_xticks([], minor=True)
            axes.set_xlabel(title)
        figure.savefig(path, dpi=DPI)


def page(feature, alone_ms, sets):
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
        "Cost": f"{alone_ms:.2g} ms per recording if computed alone (:doc:`/reports/tables/simulated`)"
        if alone_ms
        else "``texclass tradeoff`` measures it on your recordings",
    }
    results = [
        (result["input"], "value" if result["outcome"] == "value" else "NaN", result["detail"])
        for result in check_degenerate_inputs(feature)
    ]
    drawn = "Dots: recordings; lines: medians"
    if len(columns) > 1:
        drawn = "Lines: columns, from dark (first) to bright (last); median minus the median of all"
    return "\n".join(
        [
            *titled(feature.name, "="),
            *listed(facts.items(), widths="20 80", stub=True),
            *titled("Dependence on surface and operator", "-"),
            "Simulated recordings in which one property of surface or operator is varied.",
            f"{drawn}. All panels have the same vertical axis.",
            "",
            f".. image:: {feature.name}.png",
            f"   :alt: {feature.name} against six properties of surface and hand",
            "",
            *titled("Definition", "-"),
            f".. autofunction:: {feature.function.__module__}.{feature.name}",
            "",
            *titled("Results for bad input", "-"),
            *listed([("Input", "Result", "Value or reason"), *results], widths="25 15 60", header=True),
        ]
    )


def index(features):
    """Return the table of all features, by the phase they read."""
    lines = [
        *titled("Features", "="),
        "Each page shows the declaration of a feature (reference, phase, unit, gain law), its dependence on",
        "surface and operator, and its results for bad input. See :doc:`/evaluate-feature` for your own.",
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
        lines += titled(title, "-") + listed(
            [("Feature", "Summary", "Source"), *rows], "25 50 25", header=True
        )
    return "\n".join([*lines, ".. toctree::", "   :hidden:", "", *(f"   {f.name}" for f in features)])


def titled(text, line):
    """Return a heading."""
    return [text, line * len(text), ""]


def listed(rows, widths, *, header=False, stub=False):
    """Return a table."""
    lines = [".. list-table::", f"   :widths: {widths}"]
    lines += ["   :header-rows: 1"] * header + ["   :stub-columns: 1"] * stub + [""]
    for row in rows:
        lines += [
            f"   {'*' if i == 0 else ' '} - {cell.replace('|', chr(92) + '|')}" for i, cell in enumerate(row)
        ]
    return [*lines, ""]
