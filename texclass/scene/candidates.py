"""All that could stand for a surface, from cheap to dear, as judged on what it was not fitted to."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples
from texclass.scene.definition import Expected
from texclass.scene.judge import Judge
from texclass.scene.lattices import LARGEST_ORDER, LatticeGrid, fit_lattices
from texclass.scene.models import GridModel, operations
from texclass.scene.nodes import axis
from texclass.scene.observed import Observed
from texclass.scene.patterns import pattern_frequencies
from texclass.scene.sinusoids import COUNTS, Course, fit_lines, line_spectra

N_SPEEDS, N_FORCES = (1, 2, 3, 4, 6, 8), (1, 2, 3, 4)
"""Nodes tried."""
MOST_SPEEDS = N_SPEEDS[-1]
FEW_GRIDS = ((2, 2), (4, 3), (8, 4))
"""Nodes tried for lines and for high orders."""
STAGES = (range(1, 33), range(40, 129, 8), range(160, LARGEST_ORDER + 1, 40))
"""Orders tried, one stage after the other, until one is within."""
COMFORTABLE = 0.75
"""Part of the tolerance at which no higher order is tried."""
N_TONES = (2, 4, 8)
MOST_TONES = 12
"""Lines that follow the speed tried beside a lattice, where a pattern is found."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model and what it scores where order and nodes are chosen.

    Attributes
    ----------
    model : GridModel
    relative : float
        Score in parts of the tolerance; 1 or less is within.
    """

    model: GridModel
    relative: float


@dataclass(frozen=True, eq=False)
class Search:
    """Everything that was fitted to one surface.

    Attributes
    ----------
    observed : Observed
    judge : Judge
    grids : tuple of LatticeGrid
        All grids of nodes.
    relative : tuple of ndarray of shape (p + 1,)
        What the orders of each grid score, in parts of the tolerance; infinity where an order was not tried.
    expected : Expected
        Speeds and forces, between which nodes lie.
    """

    observed: Observed
    judge: Judge
    grids: tuple[LatticeGrid, ...]
    relative: tuple[Samples, ...]
    expected: Expected

    def cheapest(self, margin: float, most_speeds: int = MOST_SPEEDS) -> Candidate | None:
        """Return the candidate of the fewest operations, then bytes, that scores at most `margin`."""
        silent = self.silence()
        if silent.relative <= margin:
            return silent
        lattice = self._lattice(margin, most_speeds)
        fs = self.judge.device.rate_hz
        limit = np.inf if lattice is None else lattice.model.operations(fs)
        for candidate in self._lines(limit, most_speeds):
            if candidate.relative <= margin:
                return candidate
        return lattice

    def nearest(self) -> Candidate:
        """Return the candidate of the best score, whatever it costs; 5 % of it may be given away."""
        allowed = 1.05 * min(float(row[1:].min()) for row in self.relative)
        found = self._lattice(allowed, MOST_SPEEDS)
        assert found is not None
        return found

    def silence(self) -> Candidate:
        """Return what silence scores."""
        recorded = self.observed.choose.spectra
        verdict = self.judge.verdict(recorded, np.zeros_like(recorded))
        return Candidate(GridModel.silence(), verdict.relative)

    def _lattice(self, margin: float, most_speeds: int) -> Candidate | None:
        fs, best, found = self.judge.device.rate_hz, (np.inf, np.inf), None
        for grid, row in zip(self.grids, self.relative, strict=True):
            if grid.speeds.size <= most_speeds and np.any(row[1:] <= margin):
                order = int(np.argmax(row[1:] <= margin)) + 1
                cost = operations(order, grid.per_mm.size, fs), grid.n_nodes
                if cost < best:
                    best, found = cost, (grid, order, float(row[order]))
        return None if found is None else Candidate(found[0].model(found[1]), found[2])

    def _lines(self, limit: float, most_speeds: int) -> Iterator[Candidate]:
        """Give lines that cost less than `limit`, the cheapest first."""
        fs = self.judge.device.rate_hz
        for n, course, (n_v, n_f) in product(COUNTS, get_args(Course), FEW_GRIDS):
            if operations(0, n, fs) >= limit:
                return
            nodes = _nodes(self.observed, self.expected, min(n_v, most_speeds), n_f)
            model = fit_lines(self.observed, self.judge, *nodes, n, course)
            if model is not None:
                seen = line_spectra(model, self.observed.choose, self.judge)
                yield Candidate(model, self.judge.verdict(self.observed.choose.spectra, seen).relative)


def search(observed: Observed, judge: Judge, expected: Expected) -> Search:
    """Fit models of every order on every grid of nodes to a surface, and judge them where it is chosen.

    Beyond the first stage of orders only a few grids are tried.
    """
    most = [np.unique(np.round(at, 3)).size for at in (observed.fit.speed, observed.fit.force)]
    sizes = [(n_v, n_f) for n_v, n_f in product(N_SPEEDS, N_FORCES) if n_v <= most[0] and n_f <= most[1]]
    pattern = pattern_frequencies(observed.fit, judge, MOST_TONES)
    tones = [pattern[:n] for n in (*N_TONES, pattern.size) if 0 < n <= pattern.size]
    few = [size for size in sizes if size in FEW_GRIDS]
    found = Search(observed, judge, (), (), expected)
    for stage in STAGES:
        orders = np.array([order for order in stage if order < judge.n_segment])
        tried = [*product(sizes, [pattern[:0]]), *product(few, tones)]
        fitted = [
            fit_lattices(observed, judge, *_nodes(observed, expected, *n), int(orders[-1]), lines)
            for n, lines in tried
        ]
        found = replace(
            found,
            grids=(*found.grids, *fitted),
            relative=(*found.relative, *(_relative(grid, observed, judge, orders) for grid in fitted)),
        )
        if found.cheapest(COMFORTABLE) is not None:
            break
        sizes, tones = few, tones[-1:]
    return found


def _relative(grid: LatticeGrid, observed: Observed, judge: Judge, orders: NDArray[np.int64]) -> Samples:
    """Return what orders 0 ... p score where they are chosen, in parts of the tolerance."""
    recorded = observed.choose.spectra[:, np.newaxis]
    found = np.full(orders[-1] + 1, np.inf)
    found[orders] = judge.relative(*judge.errors(recorded, grid.spectra(observed.choose, judge, orders)))
    return found


def _nodes(observed: Observed, expected: Expected, n_v: int, n_f: int) -> tuple[Samples, Samples]:
    return (
        axis(observed.fit.speed, n_v, expected.speeds_mm_s),
        axis(observed.fit.force, n_f, expected.forces_n),
    )
