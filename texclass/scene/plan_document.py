"""A planned scene as a document: what was chosen, why, what it saves, and whether the budget holds."""

import json
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import pandas as pd

from texclass.document import Document, Table
from texclass.document.wording import counted

if TYPE_CHECKING:
    from texclass.scene.plan import ScenePlan
    from texclass.scene.proof import Played
    from texclass.scene.renderer import PlannedScene

UNITS = {"log_spectral_db": "dB", "band_db": "dB", "gfc": "GFC"}


def plan_document(plan: "ScenePlan") -> Document:
    """Return a plan as a document: a row a surface, and what stands below it."""
    data = json.loads(plan.to_json())
    tolerance, each = data["tolerance"], data["budget"]["microseconds_each"]
    rows = []
    for one in data["surfaces"]:
        scores = one["scores"]
        worst = min(scores) if tolerance["score"] == "gfc" else max(scores)
        judged = worst if tolerance["over"] == "worst" else sum(scores) / len(scores)
        nodes = "" if one["family"] == "silence" else f"{len(one['speeds'])}x{len(one['forces'])}"
        words = one["family"].replace("AR", f"AR {one['order']}").replace("lines", f"{one['lines']} lines")
        rows.append(
            (
                one["surface"], words, nodes, f"{judged:.2f}", f"{100 * one['relative']:.0f} %",
                f"{one['operations']:.0f}", "shared" if one["shares"] else str(one["bytes"]),
                f"{each[one['surface']]:.1f}",
            )
        )  # fmt: skip
    score = f"{tolerance['over']} {UNITS[tolerance['score']]}"
    titles = ["surface", "model", "nodes", score, "of the tolerance", "operations", "bytes", "us"]
    table = Table(
        pd.DataFrame(rows, columns=titles),
        n_words=2,
        strong=[i for i, one in enumerate(data["surfaces"]) if not one["within"]],
    )
    return Document(f"Scene {data['scene']}", [table, list(_notes(data))])


def _notes(data: Mapping[str, Any]) -> Iterator[str]:
    """Yield reasons, what was held out, savings, budget, and how to recognise the surfaces."""
    surfaces, proof = data["surfaces"], data["budget"]
    budget, quiet, once = proof["budget"], proof["microseconds"], proof["microseconds_as_it_was"]
    yield from (f"{one['surface']}: {one['why']}" for one in surfaces)
    yield f"judged on, and not fitted to: {'; '.join(sorted({one['held_out'] for one in surfaces}))}"
    yield (
        f"{data['operations_per_sample']:.0f} operations per sample and contact, "
        f"{data['operations_at_order_400']:.0f} at order 400 everywhere: {data['saving']:.1f} times fewer"
    )
    yield f"models for {counted(len(surfaces), 'surface')}: {data['models']}, {data['bytes']} bytes"
    yield (
        f"{counted(budget['contacts'], 'contact')}: {quiet['p50']:.1f} us a sample (median), "
        f"{quiet['p999']:.1f} us (99.9 %), each sample the least of 5 runs; "
        f"one run by itself {once['p999']:.1f} us (99.9 %), "
        f"{once['worst']:.0f} us (worst); budget {budget['microseconds']:g} us: "
        f"{'met' if quiet['p999'] <= budget['microseconds'] else 'NOT met'}"
    )
    yield (
        f"renderer: {proof['bytes']} bytes; budget {budget['bytes']}: "
        f"{'met' if proof['bytes'] <= budget['bytes'] else 'NOT met'}"
    )
    if not proof["met"]:
        each = proof["microseconds_each"]
        dearest = sorted(surfaces, key=lambda one: -each[one["surface"]])
        costs = [f"{one['surface']} {each[one['surface']]:.1f} us, {one['bytes']} bytes" for one in dearest]
        yield f"what a contact costs on each: {'; '.join(costs)}"
    if outside := [f"{o['surface']} ({100 * o['relative']:.0f} %)" for o in surfaces if not o["within"]]:
        yield f"outside the tolerance: {', '.join(outside)}"
    yield from (f"to recognise them: {command}" for command in data["recognition"])


def played_lines(played: "Played", scene: "PlannedScene") -> list[str]:
    """Return how long the samples took, and how large they are."""
    t = played.microseconds
    seconds = played.samples.size / scene.fs
    return [
        f"{seconds:.1f} s at {scene.fs:g} Hz, one sample a call: {t['p50']:.1f} us (median), "
        f"{t['p99']:.1f} us (99 %), {t['p999']:.1f} us (99.9 %), {t['worst']:.0f} us (worst)",
        f"peak {abs(played.samples).max():.3g} {scene.unit}, the device's largest {scene.largest_output:g}",
    ]
