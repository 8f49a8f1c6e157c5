"""Plan a scene: select the cheapest model of each surface within the tolerance.

Candidate models are fitted to the fitting set of a surface, from cheap to expensive. A model is selected on
the selection set and accepted if it is within the tolerance on the test set. Surfaces share a model if that
model is within the tolerance for each of them.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd

from texclass.haptics.scene.definition import MotionRange, SceneDefinition, SurfaceDefinition, read_scene
from texclass.haptics.scene.fits import (
    LARGEST_ORDER,
    Axes,
    LatticeGrid,
    LineKind,
    fit_lattices,
    fit_lines,
    model_spectra,
    spatial_frequencies,
)
from texclass.haptics.scene.measurement import measure_scene, score_rendered
from texclass.haptics.scene.renderer import PlannedScene
from texclass.haptics.scene.speed_figure import speed_dependence, speed_figure
from texclass.haptics.scene.surface_spectra import (
    Score,
    SpectralScorer,
    SurfaceSpectra,
    level_slopes,
    load_surface_spectra,
)
from texclass.haptics.textures.grid import GridModel, operations
from texclass.recording import Samples
from texclass.reporting import Document, Table
from texclass.reporting.wording import counted

SCORE_UNITS = {"log_spectral_db": "dB", "band_db": "dB", "gfc": "GFC"}
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class SearchSettings:
    """Settings of the search for the cheapest model of a surface.

    Attributes
    ----------
    margins : tuple of float
        Fractions of the tolerance that a model must meet on the selection set, tried in this order until the
        model is within the tolerance on the test set.
    n_speeds, n_forces : tuple of int
        Numbers of nodes of the grids.
    reduced_grids : tuple of (int, int)
        Numbers of nodes of the grids for lines and for high orders.
    stages : tuple of range
        Model orders of each stage. The search ends after the first stage with a model well within the
        tolerance (see `stop_margin`).
    n_lines : tuple of int
        Numbers of lines of models without a lattice; `oeztuerk2018`, section 3.2, uses 2 to 30.
    stop_margin : float
        Fraction of the tolerance at which a stage ends the search.
    """

    margins: tuple[float, ...] = (0.95, 0.85, 0.75, 0.65, 0.55, 0.45, 0.35)
    n_speeds: tuple[int, ...] = (1, 2, 3, 4, 6, 8)
    n_forces: tuple[int, ...] = (1, 2, 3, 4)
    reduced_grids: tuple[tuple[int, int], ...] = ((2, 2), (4, 3), (8, 4))
    stages: tuple[range, ...] = (range(1, 33), range(40, 129, 8), range(160, LARGEST_ORDER + 1, 40))
    n_lines: tuple[int, ...] = (1, 2, 3, 4, 6, 8, 10, 13, 16, 20, 25, 30)
    stop_margin: float = 0.75


SEARCH = SearchSettings()
MAX_SPEEDS = SEARCH.n_speeds[-1]


@dataclass(frozen=True, eq=False)
class PlannedSurface:
    """Selected model of one surface.

    Attributes
    ----------
    name : str
        Name of the surface.
    model : GridModel
        Selected model.
    score : dict
        Score of the rendered model on the test set, see `SpectralScorer.score`.
    reason : str
        Reason for the selection.
    spectra : SurfaceSpectra
        Fitting set, selection set and test set.
    shared_from : str or None
        Surface whose model is used; None if the model was fitted to this surface.

    Examples
    --------
    >>> from texclass.haptics.scene import PlannedSurface
    >>> from texclass.haptics.scene.surface_spectra import OperatingPoints, SurfaceSpectra
    >>> from texclass.haptics.textures import GridModel
    >>> points = OperatingPoints(np.zeros((1, 513)), np.array([80.0]), np.array([1.0]))
    >>> spectra = SurfaceSpectra("foam", points, points, points, 0.0, "speeds 80 mm/s")
    >>> PlannedSurface("foam", GridModel.silence(), {"within_tolerance": True}, "weak", spectra).test_set
    'speeds 80 mm/s'
    """

    name: str
    model: GridModel
    score: Score
    reason: str
    spectra: SurfaceSpectra
    shared_from: str | None = None

    @property
    def test_set(self) -> str:
        """Description of the test set."""
        return self.spectra.test_set


@dataclass(frozen=True, eq=False)
class ScenePlan:
    """Result of `plan_scene`.

    Attributes
    ----------
    definition : SceneDefinition
        Scene that was planned.
    surfaces : tuple of PlannedSurface
        Selected model of each surface.
    scene : PlannedScene
        Planned scene, ready to render.
    measurement : dict
        Time and memory of the renderer, and the budget; see `measure_scene`.

    Examples
    --------
    >>> from texclass.haptics.scene import PlannedScene, ScenePlan, read_scene
    >>> from texclass.haptics.textures import GridModel
    >>> models = (GridModel.silence(),)
    >>> scene = PlannedScene("desk", 1000.0, "m/s^2", (20.0, 450.0), 30.0, 4, {"foam": 0}, models)
    >>> ScenePlan(read_scene("example"), (), scene, {"within_budget": True}).is_feasible
    True
    """

    definition: SceneDefinition
    surfaces: tuple[PlannedSurface, ...]
    scene: PlannedScene
    measurement: Mapping[str, Any]

    @property
    def is_feasible(self) -> bool:
        """Whether all surfaces are within the tolerance and the renderer is within the budget."""
        is_within_tolerance = all(surface.score["within_tolerance"] for surface in self.surfaces)
        return self.measurement["within_budget"] and is_within_tolerance

    @property
    def operations_at_order_400(self) -> float:
        """Operations per sample of one contact if every surface had a model of order 400."""
        return operations(LARGEST_ORDER, 0, self.scene.fs)

    @property
    def saving(self) -> float:
        """Ratio of the operations at order 400 to those of the plan, mean over the surfaces."""
        return self.operations_at_order_400 / max(self.scene.operations, 1.0)

    @property
    def recognition_commands(self) -> tuple[str, ...]:
        """Commands that search for the fewest features that distinguish the surfaces of each dataset."""
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
        """Return the plan as JSON."""
        return json.dumps(self._content, indent=1)

    @cached_property
    def _content(self) -> dict[str, Any]:
        scorer = SpectralScorer(self.definition.device, self.definition.tolerance)
        surfaces = [
            {
                "surface": surface.name,
                "model": surface.model.kind,
                "order": surface.model.order,
                "lines": surface.model.n_lines,
                "speeds": surface.model.speeds.tolist(),
                "forces": surface.model.forces.tolist(),
                "operations": surface.model.operations(self.scene.fs),
                "bytes": surface.model.n_bytes,
                **surface.score,
                "test_set": surface.test_set,
                "reason": surface.reason,
                "speed_dependence": speed_dependence(surface.model, surface.spectra, surface.score, scorer),
                "shared_from": surface.shared_from,
            }
            for surface in self.surfaces
        ]
        return {
            "scene": self.scene.name,
            "is_feasible": self.is_feasible,
            "tolerance": self.definition.tolerance.model_dump(),
            "device": self.definition.device.model_dump(),
            "surfaces": surfaces,
            "operations_per_sample": self.scene.operations,
            "operations_at_order_400": self.operations_at_order_400,
            "saving": self.saving,
            "n_models": len(self.scene.models),
            "bytes": self.scene.n_bytes,
            "measurement": self.measurement,
            "recognition_commands": self.recognition_commands,
            "seed": self.definition.seed,
        }

    def document(self) -> Document:
        """Return a report with a table of the surfaces, reasons, budget, and one figure per surface."""
        content, tolerance = self._content, self.definition.tolerance
        microseconds = self.measurement["microseconds_per_surface"]
        rows = []
        for surface in content["surfaces"]:
            scores = surface["scores"]
            worst = min(scores) if tolerance.score == "gfc" else max(scores)
            score = worst if tolerance.aggregate == "worst" else sum(scores) / len(scores)
            kind = surface["model"]
            model = kind.replace("AR", f"AR {surface['order']}").replace("lines", f"{surface['lines']} lines")
            rows.append(
                {
                    "surface": surface["surface"],
                    "model": model,
                    "nodes": ""
                    if kind == "silence"
                    else f"{len(surface['speeds'])}x{len(surface['forces'])}",
                    f"{tolerance.aggregate} {SCORE_UNITS[tolerance.score]}": f"{score:.2f}",
                    "level": f"{max(map(abs, surface['level_errors_db'])):.1f}",
                    "slope": f"{max(map(abs, surface['slope_errors_db'])):.1f}",
                    "tolerance": f"{100 * surface['tolerance_ratio']:.0f} %",
                    "operations": f"{surface['operations']:.0f}",
                    "bytes": "shared" if surface["shared_from"] else str(surface["bytes"]),
                    "us": f"{microseconds[surface['surface']]:.1f}",
                }
            )
        table = Table(
            pd.DataFrame(rows),
            "On the test set: the score, the largest level error (dB), the largest slope error (dB per "
            "doubling of speed or force), and the largest error relative to the tolerance. Operations and us "
            "are per sample.",
            n_words=2,
            bold_rows=[i for i, surface in enumerate(content["surfaces"]) if not surface["within_tolerance"]],
        )
        figures = [
            speed_figure(surface["surface"], surface["speed_dependence"], surface)
            for surface in content["surfaces"]
        ]
        return Document(f"Scene {content['scene']}", [table, list(_notes(content)), *figures])


def plan_scene(
    scene: str | Path | SceneDefinition = "example", *, progress: Progress | None = None
) -> ScenePlan:
    """Select the cheapest model of each surface within the tolerance, share models, and measure the scene.

    Parameters
    ----------
    scene : str, Path or SceneDefinition
        Name of a shipped scene ("example", "twenty"), path of a scene file, or result of `read_scene`.
    progress : callable, optional
        Callback `progress(n_done, n_total, "surfaces")`.

    Returns
    -------
    ScenePlan
        Plan. It is returned even if the tolerance or the budget is exceeded; see `ScenePlan.is_feasible`.

    Raises
    ------
    ValueError, OSError
        If `read_scene` rejects the scene, the source of a surface is damaged or too short, or its unit cannot
        be converted.

    Examples
    --------
    >>> from texclass.haptics.scene import plan_scene
    >>> plan_scene("desk.toml")
    Traceback (most recent call last):
    FileNotFoundError: desk.toml does not exist. Expected a scene file (TOML)
        or a shipped scene: example, twenty
    """
    definition = scene if isinstance(scene, SceneDefinition) else read_scene(scene)
    scorer, selected = SpectralScorer(definition.device, definition.tolerance), []
    for i, (name, surface) in enumerate(definition.surfaces.items(), 1):
        spectra = load_surface_spectra(name, surface, definition, scorer)
        selected.append(select_model(spectra, surface, definition, scorer))
        if progress is not None:
            progress(i, len(definition.surfaces), "surfaces")
    surfaces = share_models(selected, scorer)
    owners = [surface for surface in surfaces if surface.shared_from is None]
    index = {owner.name: i for i, owner in enumerate(owners)}
    device = definition.device
    planned = PlannedScene(
        definition.name,
        device.rate_hz,
        device.unit,
        device.band_hz,
        device.largest_output,
        definition.budget.contacts,
        {surface.name: index[surface.shared_from or surface.name] for surface in surfaces},
        tuple(owner.model for owner in owners),
    )
    return ScenePlan(definition, surfaces, planned, measure_scene(planned, definition))


@dataclass(frozen=True, eq=False)
class Candidates:
    """Candidate models of one surface, with their scores on the selection set.

    Attributes
    ----------
    spectra : SurfaceSpectra
        Spectra of the surface.
    scorer : SpectralScorer
        Score and tolerance.
    motion : MotionRange
        Motion range that the nodes cover.
    grids : list of (LatticeGrid, ndarray of shape (p + 1,))
        Lattices on different grids, and the tolerance ratio of each order; infinity for orders that were not
        evaluated.
    lines : dict of (int, str, (int, int)) to (GridModel or None, float)
        Models of lines by number, kind and size of the grid, and their tolerance ratios. They are fitted when
        they are first needed.
    """

    spectra: SurfaceSpectra
    scorer: SpectralScorer
    motion: MotionRange
    grids: list[tuple[LatticeGrid, Samples]] = field(default_factory=list)
    lines: dict[tuple[int, LineKind, tuple[int, int]], tuple[GridModel | None, float]] = field(
        default_factory=dict
    )

    def cheapest(self, margin: float, max_speeds: int = MAX_SPEEDS) -> GridModel | None:
        """Return the model with fewest operations (then bytes) among those with a ratio up to `margin`."""
        if self.silence_ratio <= margin:
            return GridModel.silence()
        lattice, fs = self._cheapest_lattice(margin, max_speeds), self.scorer.device.rate_hz
        limit = np.inf if lattice is None else lattice.operations(fs)
        for n, kind, (n_v, n_f) in product(SEARCH.n_lines, get_args(LineKind), SEARCH.reduced_grids):
            if operations(0, n, fs) >= limit:
                break
            model, ratio = self._lines(n, kind, (min(n_v, max_speeds), n_f))
            if model and ratio <= margin:
                return model
        return lattice

    def most_accurate(self) -> GridModel:
        """Return the cheapest lattice whose tolerance ratio is within 5 % of the best one."""
        best_ratio = min(float(ratios[1:].min()) for _, ratios in self.grids)
        model = self._cheapest_lattice(1.05 * best_ratio, MAX_SPEEDS)
        assert model is not None
        return model

    @cached_property
    def silence_ratio(self) -> float:
        """Tolerance ratio of silence."""
        score = _selection_score(GridModel.silence(), self.spectra, self.scorer)
        return float(score["tolerance_ratio"])

    def _lines(self, n: int, kind: LineKind, size: tuple[int, int]) -> tuple[GridModel | None, float]:
        """Return the model of n lines on a grid, and its tolerance ratio."""
        key = n, kind, size
        if key not in self.lines:
            axes = grid_nodes(self.spectra, self.motion, size)
            model = fit_lines(self.spectra, self.scorer, axes, n, kind)
            ratio = np.inf
            if model is not None:
                ratio = _selection_score(model, self.spectra, self.scorer)["tolerance_ratio"]
            self.lines[key] = model, ratio
        return self.lines[key]

    def _cheapest_lattice(self, margin: float, max_speeds: int) -> GridModel | None:
        fs, lowest_cost, cheapest = self.scorer.device.rate_hz, (np.inf, np.inf), None
        for grid, ratios in self.grids:
            if grid.axes[0].size <= max_speeds and np.any(ratios[1:] <= margin):
                order = int(np.argmax(ratios[1:] <= margin)) + 1
                cost = operations(order, grid.per_mm.size, fs), grid.n_nodes
                if cost < lowest_cost:
                    lowest_cost, cheapest = cost, (grid, order)
        return None if cheapest is None else cheapest[0].model(cheapest[1])


def fit_candidates(spectra: SurfaceSpectra, scorer: SpectralScorer, motion: MotionRange) -> Candidates:
    """Fit models of all orders on all grids to a surface, and score them on the selection set.

    To limit the time, the stages after the first one use only the reduced grids.
    """
    points = spectra.fitting
    n_observed = [np.unique(np.round(values, 3)).size for values in (points.speed, points.force)]
    all_sizes = product(SEARCH.n_speeds, SEARCH.n_forces)
    sizes = [(n_v, n_f) for n_v, n_f in all_sizes if n_v <= n_observed[0] and n_f <= n_observed[1]]
    reduced_sizes = [size for size in sizes if size in SEARCH.reduced_grids]
    # Each lattice is fitted without lines, and with the most prominent spatial lines.
    per_mm = spatial_frequencies(points, scorer, 12)
    line_sets = [per_mm[:n] for n in (2, 4, 8, per_mm.size) if 0 < n <= per_mm.size]
    candidates = Candidates(spectra, scorer, motion)
    for stage in SEARCH.stages:
        orders = np.array([order for order in stage if order < scorer.n_segment])
        for size, lines in (*product(sizes, [per_mm[:0]]), *product(reduced_sizes, line_sets)):
            nodes = grid_nodes(spectra, motion, size)
            grid = fit_lattices(spectra, scorer, nodes, int(orders[-1]), lines)
            modelled = grid.spectra(spectra.selection, scorer, orders)
            ratios = np.full(orders[-1] + 1, np.inf)
            scores, levels = scorer.errors(spectra.selection.spectra[:, np.newaxis], modelled)
            slopes = level_slopes(levels, spectra.selection)
            ratios[orders] = scorer.tolerance_ratio(scores, levels, slopes)
            candidates.grids.append((grid, ratios))
        if candidates.cheapest(SEARCH.stop_margin) is not None:
            break
        sizes, line_sets = reduced_sizes, line_sets[-1:]
    return candidates


def grid_nodes(spectra: SurfaceSpectra, motion: MotionRange, size: tuple[int, int]) -> Axes:
    """Return geometrically spaced nodes over the part of the motion range that the fitting set covers.

    Parameters
    ----------
    spectra : SurfaceSpectra
        Spectra of the surface.
    motion : MotionRange
        Motion range of the scene.
    size : (int, int)
        Numbers of speed nodes and force nodes.

    Returns
    -------
    (ndarray, ndarray)
        Speeds (mm/s) and forces (N). An axis with a single node, or whose ranges do not overlap, consists of
        the geometric mean of the fitting set.
    """
    axes = []
    ranges = (motion.speeds_mm_s, spectra.fitting.speed), (motion.forces_n, spectra.fitting.force)
    for (limits, values), n in zip(ranges, size, strict=True):
        low, high = max(limits[0], values.min()), min(limits[1], values.max())
        if n == 1 or low >= high:
            axes.append(np.array([np.sqrt(values.min() * values.max())]))
        else:
            axes.append(np.geomspace(low, high, n))
    return axes[0], axes[1]


def extend_to_lowest(model: GridModel, motion: MotionRange) -> GridModel:
    """Lower the speed or force of a model with a single node on that axis to the start of the motion range.

    The renderer fades out below the nodes of a model. This must not happen within the motion range.
    """
    lowest = motion.speeds_mm_s[0], motion.forces_n[0]
    axes = (np.minimum(a, low) if a.size == 1 else a for a, low in zip(model.axes, lowest, strict=True))
    return replace(model, axes=tuple(axes))


def _selection_score(model: GridModel, spectra: SurfaceSpectra, scorer: SpectralScorer) -> Score:
    return scorer.score(spectra.selection, model_spectra(model, spectra.selection, scorer))


def select_model(
    spectra: SurfaceSpectra, surface: SurfaceDefinition, definition: SceneDefinition, scorer: SpectralScorer
) -> PlannedSurface:
    """Select the cheapest model of a surface that is within the tolerance on the test set.

    1. Fit the candidates.
    2. Select the cheapest candidate whose tolerance ratio on the selection set is at most the margin.
    3. Render this candidate and score it on the test set. Reduce the margin until a candidate is within the
       tolerance.
    4. If no candidate is within the tolerance, return the most accurate one.

    If the friction coefficient is defined, it limits the number of speed nodes (`oeztuerk2018`, chapter 4).
    The limit is dropped if no model within it meets the tolerance.
    """
    candidates, limits = fit_candidates(spectra, scorer, definition.motion), [(MAX_SPEEDS, "")]
    if surface.friction is not None:
        from texclass.haptics.textures.oeztuerk2018 import speed_intervals

        n = speed_intervals(surface.friction).n_intervals
        note = f"friction {surface.friction:g} allows {n} speeds"
        limits = [(min(n, MAX_SPEEDS), note), (MAX_SPEEDS, f"{note}, too few")]
    for max_speeds, note in limits:
        tested = set()
        for margin in SEARCH.margins:
            model = candidates.cheapest(margin, max_speeds)
            if model is None:
                break
            model = extend_to_lowest(model, definition.motion)
            key = model.kind, model.order, model.n_nodes
            if key not in tested:
                tested.add(key)
                score = score_rendered(model, spectra.test, scorer)
                if score["within_tolerance"]:
                    reason = _reason(candidates, model, margin, note)
                    return PlannedSurface(spectra.name, model, score, reason, spectra)
    model = extend_to_lowest(candidates.most_accurate(), definition.motion)
    score = score_rendered(model, spectra.test, scorer)
    is_within = score["within_tolerance"]
    cause = "cheaper models exceeded" if is_within else "no model is within"
    reason = f"most accurate model, regardless of cost: {cause} the tolerance on the test set"
    return PlannedSurface(spectra.name, model, score, reason, spectra)


def _reason(candidates: Candidates, model: GridModel, margin: float, note: str) -> str:
    """Return why a model was selected: the tolerance ratios of cheaper candidates, and the limits applied."""
    if model.kind == "silence":
        return "does not exceed the noise of the device by more than the tolerance"
    if model.kind == "lines":
        return "fewer operations than any lattice within the tolerance"
    fs = candidates.scorer.device.rate_hz
    cost, size = model.operations(fs), model.power.size
    cheaper_ratios, smaller_ratios = [candidates.silence_ratio], []
    for grid, ratios in candidates.grids:
        n_lines = grid.per_mm.size
        cheaper_ratios += [ratios[p] for p in range(1, ratios.size) if operations(p, n_lines, fs) < cost]
        if n_lines == model.n_lines and grid.n_nodes < size and ratios.size > model.order:
            smaller_ratios.append(float(ratios[model.order]))
    reasons = [f"best with fewer operations: {min(cheaper_ratios):.2f} of the tolerance"]
    if smaller_ratios:
        reasons.append(f"with fewer nodes: {min(smaller_ratios):.2f}")
    if margin < SEARCH.margins[0]:
        reasons.append(f"margin {margin:g}, since larger margins exceeded the tolerance on the test set")
    if note:
        reasons.append(note)
    return "; ".join(reasons)


def share_models(surfaces: Sequence[PlannedSurface], scorer: SpectralScorer) -> tuple[PlannedSurface, ...]:
    """Share a model between surfaces if it is within the tolerance for them and needs no more operations.

    Greedy set cover: repeatedly select the model that covers most of the remaining surfaces; ties are broken
    by the smaller memory.
    """
    fs, own = scorer.device.rate_hz, {surface.name: surface for surface in surfaces}
    served: dict[str, dict[str, PlannedSurface]] = {name: {name: surface} for name, surface in own.items()}
    for source, target in product(surfaces, surfaces):
        is_cheaper = source.model.operations(fs) <= target.model.operations(fs)
        if target is source or not (is_cheaper and source.score["within_tolerance"]):
            continue
        score = _selection_score(source.model, target.spectra, scorer)
        if not score["within_tolerance"]:
            continue
        score = score_rendered(source.model, target.spectra.test, scorer)
        if score["within_tolerance"]:
            served[source.name][target.name] = replace(
                target,
                model=source.model,
                score=score,
                reason=f"does not differ from {source.name} within the tolerance",
                shared_from=source.name,
            )
    shared: dict[str, PlannedSurface] = {}
    while remaining := [name for name in own if name not in shared]:
        best = max(
            remaining,
            key=lambda source: (sum(n in served[source] for n in remaining), -own[source].model.n_bytes),
        )
        shared.update({name: served[best][name] for name in remaining if name in served[best]})
    return tuple(shared[name] for name in own)


def _notes(content: Mapping[str, Any]) -> Iterator[str]:
    """Yield the notes of the report: reasons, test set, saving, budget, and recognition commands."""
    surfaces, measurement = content["surfaces"], content["measurement"]
    budget, fastest = measurement["budget"], measurement["microseconds"]
    single_run = measurement["microseconds_single_run"]
    yield from (f"{surface['surface']}: {surface['reason']}" for surface in surfaces)
    yield f"test set, excluded from fitting: {'; '.join(sorted({s['test_set'] for s in surfaces}))}"
    yield (
        f"{content['operations_per_sample']:.0f} operations per sample and contact, "
        f"{content['operations_at_order_400']:.0f} with order 400 for all surfaces: "
        f"{content['saving']:.1f} times fewer"
    )
    yield f"models for {counted(len(surfaces), 'surface')}: {content['n_models']}, {content['bytes']} bytes"
    yield (
        f"{counted(budget['contacts'], 'contact')}: {fastest['p50']:.1f} us per sample (median), "
        f"{fastest['p999']:.1f} us (99.9 %), minimum of 5 runs per sample; "
        f"single run {single_run['p999']:.1f} us (99.9 %), {single_run['worst']:.0f} us (worst); "
        f"budget {budget['microseconds']:g} us: "
        f"{'met' if fastest['p999'] <= budget['microseconds'] else 'NOT met'}"
    )
    yield (
        f"renderer: {measurement['bytes']} bytes; budget {budget['bytes']}: "
        f"{'met' if measurement['bytes'] <= budget['bytes'] else 'NOT met'}"
    )
    if not measurement["within_budget"]:
        microseconds = measurement["microseconds_per_surface"]
        by_cost = sorted(surfaces, key=lambda surface: -microseconds[surface["surface"]])
        costs = [f"{s['surface']} {microseconds[s['surface']]:.1f} us, {s['bytes']} bytes" for s in by_cost]
        yield f"cost of one contact on each surface: {'; '.join(costs)}"
    exceeded = [
        f"{surface['surface']} ({100 * surface['tolerance_ratio']:.0f} %)"
        for surface in surfaces
        if not surface["within_tolerance"]
    ]
    if exceeded:
        yield f"outside the tolerance: {', '.join(exceeded)}"
    yield from (f"to recognize these surfaces: {command}" for command in content["recognition_commands"])
