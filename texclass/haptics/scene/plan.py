"""The choice: for each surface the cheapest model within the tolerance, one model where two do not differ.

All that could stand for a surface is fitted, from cheap to dear, and judged on what it was not fitted to.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd

from texclass.haptics.scene.definition import Expected, SceneDefinition, SurfaceDefinition, read_scene
from texclass.haptics.scene.fits import (
    LARGEST_ORDER,
    Axes,
    Course,
    LatticeGrid,
    fit_lattices,
    fit_lines,
    model_spectra,
    pattern_frequencies,
)
from texclass.haptics.scene.observations import Judge, Observed, Scored, observe, slopes
from texclass.haptics.scene.proof import measure, prove
from texclass.haptics.scene.renderer import PlannedScene
from texclass.haptics.scene.speed_figure import against_speed, speed_figure
from texclass.haptics.textures.grid import GridModel, operations
from texclass.recording import Samples
from texclass.reporting import Document, Table
from texclass.reporting.wording import counted

UNITS = {"log_spectral_db": "dB", "band_db": "dB", "gfc": "GFC"}
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class SearchSettings:
    """What is tried for a surface, from cheap to dear.

    Attributes
    ----------
    margins : tuple[float, ...]
        Parts of the tolerance that a choice is given, one after the other, until the proof holds.
    n_speeds, n_forces : tuple[int, ...]
        Nodes of the grids.
    few_grids : tuple[tuple[int, int], ...]
        Nodes of the grids for lines and for high orders.
    stages : tuple[range, ...]
        Orders, one stage after the other, until one is within the tolerance.
    n_lines : tuple[int, ...]
        Lines without a lattice; `oeztuerk2018`, section 3.2: from 2 to 30 were tried.
    """

    margins: tuple[float, ...] = (0.95, 0.85, 0.75, 0.65, 0.55, 0.45, 0.35)
    n_speeds: tuple[int, ...] = (1, 2, 3, 4, 6, 8)
    n_forces: tuple[int, ...] = (1, 2, 3, 4)
    few_grids: tuple[tuple[int, int], ...] = ((2, 2), (4, 3), (8, 4))
    stages: tuple[range, ...] = (range(1, 33), range(40, 129, 8), range(160, LARGEST_ORDER + 1, 40))
    n_lines: tuple[int, ...] = (1, 2, 3, 4, 6, 8, 10, 13, 16, 20, 25, 30)


SEARCH = SearchSettings()
MOST_SPEEDS = SEARCH.n_speeds[-1]


@dataclass(frozen=True, eq=False)
class PlannedSurface:
    """What one surface got, and why.

    Attributes
    ----------
    name : str
    model : GridModel
    verdict : dict
        Of the rendered model on the held-out speeds and forces, see `Judge.verdict`.
    why : str
        In words.
    observed : Observed
        What it was fitted to and judged on.
    shares : str or None
        The surface whose model it uses.
    """

    name: str
    model: GridModel
    verdict: Scored
    why: str
    observed: Observed
    shares: str | None = None

    @property
    def held_out(self) -> str:
        """What it was judged on, in words."""
        return self.observed.how


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
        return self.proof["met"] and all(one.verdict["within"] for one in self.surfaces)

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
        surfaces: dict[str, list[str]] = {}
        for name, surface in self.definition.surfaces.items():
            if surface.dataset is not None:
                surfaces.setdefault(surface.dataset, []).append(surface.surface or name)
        return tuple(
            f"texclass tradeoff {dataset} --surfaces {','.join(names)}"
            for dataset, names in surfaces.items()
            if len(names) > 1
        )

    def to_json(self) -> str:
        """Return all of it as JSON."""
        return json.dumps(self._told, indent=1)

    @cached_property
    def _told(self) -> dict[str, Any]:
        judge = Judge(self.definition.device, self.definition.tolerance)
        surfaces = [
            {
                "surface": one.name,
                "family": one.model.kind,
                "order": one.model.order,
                "lines": one.model.n_lines,
                "speeds": one.model.speeds.tolist(),
                "forces": one.model.forces.tolist(),
                "operations": one.model.operations(self.scene.fs),
                "bytes": one.model.n_bytes,
                **one.verdict,
                "held_out": one.held_out,
                "why": one.why,
                "over_speed": against_speed(one.model, one.observed, one.verdict, judge),
                "shares": one.shares,
            }
            for one in self.surfaces
        ]
        return {
            "scene": self.scene.name,
            "met": self.met,
            "tolerance": self.definition.tolerance.model_dump(),
            "device": self.definition.device.model_dump(),
            "surfaces": surfaces,
            "operations_per_sample": self.scene.operations,
            "operations_at_order_400": self.everything,
            "saving": self.saving,
            "models": len(self.scene.models),
            "bytes": self.scene.n_bytes,
            "budget": self.proof,
            "recognition": self.recognition,
            "seed": self.definition.seed,
        }

    def document(self) -> Document:
        """Return the plan as a table of surfaces, with the reasons and the budget."""
        data, tolerance = self._told, self.definition.tolerance
        each, score = self.proof["microseconds_each"], f"{tolerance.over} {UNITS[tolerance.score]}"
        rows = []
        for one in data["surfaces"]:
            scores = one["scores"]
            worst = min(scores) if tolerance.score == "gfc" else max(scores)
            judged = worst if tolerance.over == "worst" else sum(scores) / len(scores)
            nodes = "" if one["family"] == "silence" else f"{len(one['speeds'])}x{len(one['forces'])}"
            words = (
                one["family"].replace("AR", f"AR {one['order']}").replace("lines", f"{one['lines']} lines")
            )
            rows.append(
                {
                    "surface": one["surface"],
                    "model": words,
                    "nodes": nodes,
                    score: f"{judged:.2f}",
                    "level": f"{max(map(abs, one['levels_db'])):.1f}",
                    "slope": f"{max(map(abs, one['slopes_db'])):.1f}",
                    "of it all": f"{100 * one['relative']:.0f} %",
                    "operations": f"{one['operations']:.0f}",
                    "bytes": "shared" if one["shares"] else str(one["bytes"]),
                    "us": f"{each[one['surface']]:.1f}",
                }
            )
        table = Table(
            pd.DataFrame(rows),
            "Where it was not fitted: the score asked for, the largest difference of level (dB) and of its "
            "slope (dB at twice the speed or force), and the deciding one in parts of the tolerance.",
            n_words=2,
            strong=[i for i, one in enumerate(data["surfaces"]) if not one["within"]],
        )
        figures = [speed_figure(one["surface"], one["over_speed"], one) for one in data["surfaces"]]
        return Document(f"Scene {data['scene']}", [table, list(_notes(data)), *figures])


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
    return ScenePlan(definition, chosen, planned, measure(planned, definition))


@dataclass(frozen=True, eq=False)
class Search:
    """Everything that was fitted to one surface.

    Attributes
    ----------
    observed : Observed
    judge : Judge
    expected : Expected
        Speeds and forces, between which nodes lie.
    fitted : list of (LatticeGrid, ndarray of shape (p + 1,))
        Grids of nodes, and what their orders score, in parts of the tolerance; infinity where one was not
        tried.
    """

    observed: Observed
    judge: Judge
    expected: Expected
    fitted: list[tuple[LatticeGrid, Samples]]

    def cheapest(self, margin: float, most_speeds: int = MOST_SPEEDS) -> GridModel | None:
        """Return the model of the fewest operations, then bytes, that scores at most `margin`."""
        if self.silence <= margin:
            return GridModel.silence()
        lattice, fs = self._lattice(margin, most_speeds), self.judge.device.rate_hz
        limit = np.inf if lattice is None else lattice.operations(fs)
        for n, course, (n_v, n_f) in product(SEARCH.n_lines, get_args(Course), SEARCH.few_grids):
            if operations(0, n, fs) >= limit:
                break
            axes = nodes_between(self.observed, self.expected, (min(n_v, most_speeds), n_f))
            model = fit_lines(self.observed, self.judge, axes, n, course)
            if model and _chosen_by(model, self.observed, self.judge)["relative"] <= margin:
                return model
        return lattice

    def nearest(self) -> GridModel:
        """Return the model of the best score, whatever it costs; 5 % of it may be given away."""
        found = self._lattice(1.05 * min(float(row[1:].min()) for _, row in self.fitted), MOST_SPEEDS)
        assert found is not None
        return found

    @property
    def silence(self) -> float:
        """What silence scores."""
        return float(_chosen_by(GridModel.silence(), self.observed, self.judge)["relative"])

    def _lattice(self, margin: float, most_speeds: int) -> GridModel | None:
        fs, best, found = self.judge.device.rate_hz, (np.inf, np.inf), None
        for grid, row in self.fitted:
            if grid.axes[0].size <= most_speeds and np.any(row[1:] <= margin):
                order = int(np.argmax(row[1:] <= margin)) + 1
                cost = operations(order, grid.per_mm.size, fs), grid.n_nodes
                if cost < best:
                    best, found = cost, (grid, order)
        return None if found is None else found[0].model(found[1])


def search(observed: Observed, judge: Judge, expected: Expected) -> Search:
    """Fit models of every order on every grid of nodes to a surface, and judge them where it is chosen.

    Beyond the first stage of orders only a few grids are tried.
    """
    most = [np.unique(np.round(at, 3)).size for at in (observed.fit.speed, observed.fit.force)]
    every = product(SEARCH.n_speeds, SEARCH.n_forces)
    sizes = [(n_v, n_f) for n_v, n_f in every if n_v <= most[0] and n_f <= most[1]]
    # beside a lattice, lines that follow the speed
    pattern = pattern_frequencies(observed.fit, judge, 12)
    tones = [pattern[:n] for n in (2, 4, 8, pattern.size) if 0 < n <= pattern.size]
    few = [size for size in sizes if size in SEARCH.few_grids]
    found = Search(observed, judge, expected, [])
    for stage in SEARCH.stages:
        orders = np.array([order for order in stage if order < judge.n_segment])
        for n, lines in (*product(sizes, [pattern[:0]]), *product(few, tones)):
            grid = fit_lattices(observed, judge, nodes_between(observed, expected, n), int(orders[-1]), lines)
            seen = grid.spectra(observed.choose, judge, orders)
            relative = np.full(orders[-1] + 1, np.inf)
            scores, levels = judge.errors(observed.choose.spectra[:, np.newaxis], seen)
            relative[orders] = judge.relative(scores, levels, slopes(levels, observed.choose))
            found.fitted.append((grid, relative))
        if found.cheapest(0.75) is not None:  # of the tolerance: no higher order is tried
            break
        sizes, tones = few, tones[-1:]
    return found


def nodes_between(observed: Observed, expected: Expected, size: tuple[int, int]) -> Axes:
    """Return nodes at equal ratios between the ends of what is expected, as far as was observed."""
    speeds = expected.speeds_mm_s, observed.fit.speed, size[0]
    axes = []
    for within, values, n in (speeds, (expected.forces_n, observed.fit.force, size[1])):
        low, high = max(within[0], values.min()), min(within[1], values.max())
        alone = n == 1 or low >= high
        axes.append(np.array([np.sqrt(values.min() * values.max())]) if alone else np.geomspace(low, high, n))
    return axes[0], axes[1]


def reaching_lowest(model: GridModel, expected: Expected) -> GridModel:
    """Return a model whose only speed, or force, is the lowest expected: below its nodes it fades out."""
    lowest = expected.speeds_mm_s[0], expected.forces_n[0]
    axes = (np.minimum(a, low) if a.size == 1 else a for a, low in zip(model.axes, lowest, strict=True))
    return replace(model, axes=tuple(axes))


def _chosen_by(model: GridModel, observed: Observed, judge: Judge) -> Scored:
    """Return what a model scores where models are chosen."""
    return judge.verdict(observed.choose, model_spectra(model, observed.choose, judge))


def choose(
    observed: Observed, surface: SurfaceDefinition, definition: SceneDefinition, judge: Judge
) -> PlannedSurface:
    """Return the cheapest model of a surface whose rendered form is within the tolerance where held out."""
    found, limits = search(observed, judge, definition.expected), [(MOST_SPEEDS, "")]
    if surface.friction is not None:
        from texclass.haptics.textures.oeztuerk2018 import speed_intervals

        n = speed_intervals(surface.friction).n_intervals
        bound = f"friction {surface.friction:g} allows {n} speeds"
        limits = [(min(n, MOST_SPEEDS), bound), (MOST_SPEEDS, f"{bound}, too few")]
    for most, bound in limits:
        tried = set()
        for margin in SEARCH.margins:  # narrowed until the model holds in the proof
            model = found.cheapest(margin, most)
            if model is None:
                break
            model = reaching_lowest(model, definition.expected)
            key = model.kind, model.order, model.n_nodes
            if key not in tried:
                tried.add(key)
                verdict = prove(model, observed.prove, judge)
                if verdict["within"]:
                    why = _why(found, model, margin, bound)
                    return PlannedSurface(observed.name, model, verdict, why, observed)
    nearest = reaching_lowest(found.nearest(), definition.expected)
    verdict = prove(nearest, observed.prove, judge)
    why = "; all cheaper ones failed in the proof" if verdict["within"] else ": nothing met the tolerance"
    return PlannedSurface(observed.name, nearest, verdict, f"the best there is{why}", observed)


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
    words += [f"{margin:g} asked for, as the proof failed at more"] if margin < SEARCH.margins[0] else []
    return "; ".join([*words, *([bound] if bound else [])])


def share(found: Sequence[tuple[PlannedSurface, Observed]], judge: Judge) -> tuple[PlannedSurface, ...]:
    """Let surfaces use the model of another one that serves them within the tolerance, at no more operations.

    The model that serves most of those that are left is taken first; of several, the one of fewest bytes.
    """
    fs, chosen = judge.device.rate_hz, {one.name: one for one, _ in found}
    serves: dict[str, dict[str, PlannedSurface]] = {name: {name: one} for name, one in chosen.items()}
    for giver, (taker, observed) in product(chosen.values(), found):
        cheaper = giver.model.operations(fs) <= taker.model.operations(fs)
        if taker is giver or not (cheaper and giver.verdict["within"]):
            continue
        verdict = _chosen_by(giver.model, observed, judge)
        if verdict["within"] and (verdict := prove(giver.model, observed.prove, judge))["within"]:
            why = f"does not differ from {giver.name} within the tolerance"
            served = replace(taker, model=giver.model, verdict=verdict, why=why, shares=giver.name)
            serves[giver.name][taker.name] = served
    final: dict[str, PlannedSurface] = {}
    while left := [name for name in chosen if name not in final]:
        best = max(left, key=lambda g: (sum(n in serves[g] for n in left), -chosen[g].model.n_bytes))
        final.update({name: serves[best][name] for name in left if name in serves[best]})
    return tuple(final[name] for name in chosen)


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
