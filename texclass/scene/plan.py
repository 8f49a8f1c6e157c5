"""The choice: for each surface the cheapest model within the tolerance, one model where two do not differ."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from texclass.scene.definition import SceneDefinition, SurfaceDefinition, read_scene
from texclass.scene.fits import LARGEST_ORDER, model_spectra
from texclass.scene.judge import Judge, Verdict
from texclass.scene.observations import Observed, observe
from texclass.scene.planned import PlannedScene
from texclass.scene.proof import measure, prove
from texclass.scene.search import MOST_SPEEDS, Search, search
from texclass.textures.grid import GridModel, operations
from texclass.textures.oeztuerk2018 import speed_intervals

MARGINS = (0.95, 0.85, 0.75, 0.65, 0.55, 0.45, 0.35)
"""Parts of the tolerance that a choice is given, one after the other, until the proof holds."""
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, eq=False)
class PlannedSurface:
    """What one surface got, and why.

    Attributes
    ----------
    name : str
    model : GridModel
    verdict : Verdict
        Of the rendered model on the held-out speeds and forces.
    why : str
        In words.
    held_out : str
        What it was judged on.
    shares : str or None
        The surface whose model it uses.
    """

    name: str
    model: GridModel
    verdict: Verdict
    why: str
    held_out: str
    shares: str | None = None


@dataclass(frozen=True, eq=False)
class ScenePlan:
    """A planned scene and the reasons.

    Attributes
    ----------
    definition : SceneDefinition
    surfaces : tuple of PlannedSurface
    scene : PlannedScene
        For the renderer.
    proof : dict
        The budget beside measured time and bytes; see `proof.measure`.
    """

    definition: SceneDefinition
    surfaces: tuple[PlannedSurface, ...]
    scene: PlannedScene
    proof: Mapping[str, Any]

    @property
    def met(self) -> bool:
        """Whether every surface is within the tolerance, and the budget holds."""
        return self.proof["met"] and all(one.verdict.within for one in self.surfaces)

    @property
    def everything(self) -> float:
        """Operations per sample of one contact if every surface had a model of order 400."""
        return operations(LARGEST_ORDER, 0, self.scene.fs)

    @property
    def saving(self) -> float:
        """How many times fewer operations per sample the plan needs, mean over the surfaces."""
        return self.everything / max(self.scene.operations, 1.0)

    @property
    def recognition(self) -> tuple[str, ...]:
        """Commands that pick the fewest features that separate the surfaces, where a dataset has them."""
        materials: dict[str, list[str]] = {}
        for name, surface in self.definition.surfaces.items():
            if surface.dataset is not None:
                materials.setdefault(surface.dataset, []).append(surface.material or name)
        return tuple(
            f"texclass tradeoff {dataset} --materials {','.join(names)}"
            for dataset, names in materials.items()
            if len(names) > 1
        )

    def to_json(self) -> str:
        """Return all of it as JSON."""
        return json.dumps(
            {
                "scene": self.scene.name,
                "met": self.met,
                "tolerance": self.definition.tolerance.model_dump(),
                "device": self.definition.device.model_dump(),
                "surfaces": [_row(one, self.scene.fs) for one in self.surfaces],
                "operations_per_sample": self.scene.operations,
                "operations_at_order_400": self.everything,
                "saving": self.saving,
                "models": len(self.scene.models),
                "bytes": self.scene.n_bytes,
                "budget": self.proof,
                "recognition": self.recognition,
                "seed": self.definition.seed,
            },
            indent=1,
        )


def plan_scene(
    scene: str | Path | SceneDefinition = "example", *, progress: Progress | None = None
) -> ScenePlan:
    """Choose, share, prove and measure.

    Parameters
    ----------
    scene : str, Path or SceneDefinition
        A shipped scene ("example", "twenty"), a scene's TOML, or what `read_scene` returned.
    progress : callable, optional
        Told how many of how many surfaces are done, and what is being done.

    Returns
    -------
    ScenePlan
        Also where tolerance or budget are not met: it says which surface costs what.

    Raises
    ------
    ValueError, OSError
        As `read_scene`, or if what a surface is made of is bad, too short, or not in the device's unit.
    """
    definition = scene if isinstance(scene, SceneDefinition) else read_scene(scene)
    judge, found = Judge(definition.device, definition.tolerance), []
    for i, (name, surface) in enumerate(definition.surfaces.items(), 1):
        observed = observe(name, surface, definition, judge)
        found.append((choose(observed, surface, definition, judge), observed))
        if progress is not None:
            progress(i, len(definition.surfaces), "surfaces")
    chosen = share(found, judge)
    owners = [one for one in chosen if one.shares is None]
    index = {one.name: i for i, one in enumerate(owners)}
    device = definition.device
    planned = PlannedScene(
        definition.name,
        device.rate_hz,
        device.unit,
        device.band_hz,
        device.largest_output,
        definition.budget.contacts,
        {one.name: index[one.shares or one.name] for one in chosen},
        tuple(one.model for one in owners),
    )
    expected = definition.expected
    proof = measure(planned, definition.budget, expected.speeds_mm_s, expected.forces_n)
    return ScenePlan(definition, chosen, planned, proof)


def choose(
    observed: Observed, surface: SurfaceDefinition, definition: SceneDefinition, judge: Judge
) -> PlannedSurface:
    """Return the cheapest model of a surface whose rendered form is within the tolerance where held out."""
    found = search(observed, judge, definition.expected)
    allowed, bound = MOST_SPEEDS, ""
    if surface.friction is not None:
        n = speed_intervals(surface.friction).n_intervals
        allowed, bound = min(n, MOST_SPEEDS), f"friction {surface.friction:g} allows {n} speeds"
    for most, words in dict.fromkeys(((allowed, bound), (MOST_SPEEDS, f"{bound}, too few" if bound else ""))):
        if (planned := _within(found, most, words)) is not None:
            return planned
    nearest = found.nearest()
    verdict = prove(nearest, observed.prove, judge)
    why = "the best there is"
    why += "; all cheaper ones failed in the proof" if verdict.within else ": nothing met the tolerance"
    return PlannedSurface(observed.name, nearest, verdict, why, observed.how)


def _within(found: Search, most_speeds: int, bound: str) -> PlannedSurface | None:
    """Return the cheapest that holds in the proof, the margin of the choice narrowed until one does."""
    tried: set[tuple[str, int, tuple[int, ...]]] = set()
    for margin in MARGINS:
        model = found.cheapest(margin, most_speeds)
        if model is None:
            return None
        if (key := (model.kind, model.order, model.n_nodes)) in tried:
            continue
        tried.add(key)
        verdict = prove(model, found.observed.prove, found.judge)
        if verdict.within:
            why = _why(found, model, margin, bound)
            return PlannedSurface(found.observed.name, model, verdict, why, found.observed.how)
    return None


def _why(found: Search, model: GridModel, margin: float, bound: str) -> str:
    """Say what the next cheaper choices miss the tolerance by."""
    if model.kind == "silence":
        return "not above the device's noise by more than the tolerance"
    if model.kind == "lines":
        return "fewer operations than any lattice within the tolerance"
    fs = found.judge.device.rate_hz
    cost, size = model.operations(fs), model.power.size
    cheaper, fewer = [found.silence], []
    for grid, row in found.fitted:
        lines = grid.per_mm.size
        cheaper += [row[p] for p in range(1, row.size) if operations(p, lines, fs) < cost]
        if lines == model.n_lines and grid.n_nodes < size and row.size > model.order:
            fewer.append(float(row[model.order]))
    words = [f"with fewer operations {min(cheaper):.2f} of the tolerance"]
    words += [f"with fewer nodes {min(fewer):.2f}"] if fewer else []
    words += [f"{margin:g} asked for, as the proof failed at more"] if margin < MARGINS[0] else []
    return "; ".join([*words, *([bound] if bound else [])])


def share(found: Sequence[tuple[PlannedSurface, Observed]], judge: Judge) -> tuple[PlannedSurface, ...]:
    """Let surfaces use the model of another one that serves them within the tolerance, at no more operations.

    The model that serves most of those that are left is taken first; of several, the one of fewest bytes.
    """
    fs, chosen = judge.device.rate_hz, {one.name: one for one, _ in found}
    serves: dict[str, dict[str, PlannedSurface]] = {name: {name: one} for name, one in chosen.items()}
    for giver, (taker, observed) in product(chosen.values(), found):
        cheaper = giver.model.operations(fs) <= taker.model.operations(fs)
        if taker is not giver and cheaper and giver.verdict.within:
            verdict = _served(giver.model, observed, judge)
            if verdict is not None:
                why = f"does not differ from {giver.name} within the tolerance"
                served = replace(taker, model=giver.model, verdict=verdict, why=why, shares=giver.name)
                serves[giver.name][taker.name] = served
    final: dict[str, PlannedSurface] = {}
    while left := [name for name in chosen if name not in final]:
        best = max(left, key=lambda g: (sum(n in serves[g] for n in left), -chosen[g].model.n_bytes))
        final.update({name: serves[best][name] for name in left if name in serves[best]})
    return tuple(final[name] for name in chosen)


def _served(model: GridModel, observed: Observed, judge: Judge) -> Verdict | None:
    """Return the verdict of a model on a surface it was not made for, if it is within the tolerance twice."""
    choose = observed.choose
    if not judge.verdict(choose.spectra, model_spectra(model, choose, judge)).within:
        return None
    verdict = prove(model, observed.prove, judge)
    return verdict if verdict.within else None


def _row(one: PlannedSurface, fs: float) -> Mapping[str, Any]:
    return {
        "surface": one.name,
        "family": one.model.kind,
        "order": one.model.order,
        "lines": one.model.n_lines,
        "speeds": one.model.speeds.tolist(),
        "forces": one.model.forces.tolist(),
        "operations": one.model.operations(fs),
        "bytes": one.model.n_bytes,
        "scores": one.verdict.scores,
        "levels_db": one.verdict.levels_db,
        "relative": one.verdict.relative,
        "within": one.verdict.within,
        "held_out": one.held_out,
        "why": one.why,
        "shares": one.shares,
    }
