"""A planned scene in words: what was chosen, why, what it saves, and whether the budget holds."""

from typing import TYPE_CHECKING

from texclass.reporting.terminal import table_of
from texclass.scene import PlannedScene, PlannedSurface, Played, ScenePlan
from texclass.textures.grid import GridModel

if TYPE_CHECKING:
    from rich.table import Table

_UNITS = {"log_spectral_db": "dB", "band_db": "dB", "gfc": "GFC"}


def plan_table(plan: ScenePlan) -> "Table":
    """Return the table of a plan: one line a surface."""
    tolerance = plan.definition.tolerance
    titles = [
        "surface",
        "model",
        "nodes",
        f"{tolerance.over}\n{_UNITS[tolerance.score]}",
        "of the\ntolerance",
    ]
    titles += ["oper-\nations", "bytes", "us"]
    rows = [_cells(one, plan) for one in plan.surfaces]
    styles = ["" if one.verdict.within else "bold red" for one in plan.surfaces]
    return table_of(titles, rows, styles, n_text=2)


def _cells(one: PlannedSurface, plan: ScenePlan) -> list[str]:
    model, scores = one.model, one.verdict.scores
    worst = min(scores) if plan.definition.tolerance.score == "gfc" else max(scores)
    shown = worst if plan.definition.tolerance.over == "worst" else sum(scores) / len(scores)
    return [
        one.name,
        _words(model),
        "" if model.kind == "silence" else "x".join(map(str, model.n_nodes)),
        f"{shown:.2f}",
        f"{100 * one.verdict.relative:.0f} %",
        f"{model.operations(plan.scene.fs):.0f}",
        "shared" if one.shares else str(model.n_bytes),
        f"{plan.proof.each[one.name]:.1f}",
    ]


def _words(model: GridModel) -> str:
    parts = [f"AR {model.order}"] if model.order else []
    parts += [f"{model.n_lines} lines"] if model.n_lines else []
    return " + ".join(parts) or "silence"


def plan_lines(plan: ScenePlan) -> list[str]:
    """Return what stands below the table: held out, savings, budget, and recognition."""
    scene, proof, budget = plan.scene, plan.proof, plan.proof.budget
    held = sorted({one.held_out for one in plan.surfaces})
    lines = [
        *(f"{one.name}: {one.why}" for one in plan.surfaces),
        f"judged on, and not fitted to: {'; '.join(held)}",
        f"{scene.operations:.0f} operations per sample and contact, {plan.everything:.0f} at order 400 "
        f"everywhere: {plan.saving:.1f} times fewer",
        f"models for {len(plan.surfaces)} surfaces: {len(scene.models)}, {scene.n_bytes} bytes",
        f"{budget.contacts} contacts: {proof.quiet.p50:.1f} us a sample (median), "
        f"{proof.quiet.p999:.1f} us (99.9 %), "
        f"each sample the least of 5 runs; one run by itself {proof.as_it_was.p999:.1f} us (99.9 %), "
        f"{proof.as_it_was.worst:.0f} us (worst); budget {budget.microseconds:g} us: "
        f"{'met' if proof.quiet.p999 <= budget.microseconds else 'NOT met'}",
        f"renderer: {proof.n_bytes} bytes; budget {budget.bytes}: "
        f"{'met' if proof.n_bytes <= budget.bytes else 'NOT met'}",
    ]
    return [*lines, *_costs(plan), *_outside(plan), *(f"to recognise them: {c}" for c in plan.recognition)]


def _costs(plan: ScenePlan) -> list[str]:
    if plan.proof.met:
        return []
    dearest = sorted(plan.surfaces, key=lambda one: -plan.proof.each[one.name])
    costs = [f"{s.name} {plan.proof.each[s.name]:.1f} us, {s.model.n_bytes} bytes" for s in dearest]
    return [f"what a contact costs on each: {'; '.join(costs)}"]


def _outside(plan: ScenePlan) -> list[str]:
    outside = [f"{s.name} ({100 * s.verdict.relative:.0f} %)" for s in plan.surfaces if not s.verdict.within]
    return [f"outside the tolerance: {', '.join(outside)}"] if outside else []


def played_lines(played: Played, scene: PlannedScene) -> list[str]:
    """Return how long the samples took, and how large they are."""
    t = played.timing
    seconds = played.samples.size / scene.fs
    return [
        f"{seconds:.1f} s at {scene.fs:g} Hz, one sample a call: {t.p50:.1f} us (median), "
        f"{t.p99:.1f} us (99 %), {t.p999:.1f} us (99.9 %), {t.worst:.0f} us (worst)",
        f"peak {abs(played.samples).max():.3g} {scene.unit}, the device's largest {scene.largest_output:g}",
    ]
