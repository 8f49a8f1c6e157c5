"""All that could stand for a surface, from cheap to dear, as judged on what it was not fitted to."""

from dataclasses import dataclass
from itertools import product
from typing import get_args

import numpy as np

from texclass.recording import Samples
from texclass.scene.definition import Expected
from texclass.scene.fits import (
    LARGEST_ORDER,
    Axes,
    Course,
    LatticeGrid,
    axis,
    fit_lattices,
    fit_lines,
    model_spectra,
)
from texclass.scene.judge import Judge
from texclass.scene.observations import Observed
from texclass.scene.patterns import pattern_frequencies
from texclass.textures.grid import GridModel, operations

N_SPEEDS, N_FORCES = (1, 2, 3, 4, 6, 8), (1, 2, 3, 4)
"""Nodes tried."""
MOST_SPEEDS = N_SPEEDS[-1]
FEW_GRIDS = ((2, 2), (4, 3), (8, 4))
"""Nodes tried for lines and for high orders."""
STAGES = (range(1, 33), range(40, 129, 8), range(160, LARGEST_ORDER + 1, 40))
"""Orders tried, one stage after the other, until one is within."""
COMFORTABLE = 0.75
"""Part of the tolerance at which no higher order is tried."""
N_LINES = (1, 2, 3, 4, 6, 8, 10, 13, 16, 20, 25, 30)
"""Lines without a lattice; `oeztuerk2018`, section 3.2: from 2 to 30 were tried."""
N_TONES = (2, 4, 8)
MOST_TONES = 12
"""Lines that follow the speed tried beside a lattice, where a pattern is found."""


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
        for n, course, (n_v, n_f) in product(N_LINES, get_args(Course), FEW_GRIDS):
            if operations(0, n, fs) >= limit:
                break
            axes = _axes(self.observed, self.expected, min(n_v, most_speeds), n_f)
            model = fit_lines(self.observed, self.judge, axes, n, course)
            if model is not None and self._score(model) <= margin:
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
        return self._score(GridModel.silence())

    def _score(self, model: GridModel) -> float:
        choose = self.observed.choose
        return self.judge.verdict(choose.spectra, model_spectra(model, choose, self.judge)).relative

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
    sizes = [(n_v, n_f) for n_v, n_f in product(N_SPEEDS, N_FORCES) if n_v <= most[0] and n_f <= most[1]]
    pattern = pattern_frequencies(observed.fit, judge, MOST_TONES)
    tones = [pattern[:n] for n in (*N_TONES, pattern.size) if 0 < n <= pattern.size]
    few = [size for size in sizes if size in FEW_GRIDS]
    found = Search(observed, judge, expected, [])
    for stage in STAGES:
        orders = np.array([order for order in stage if order < judge.n_segment])
        for n, lines in (*product(sizes, [pattern[:0]]), *product(few, tones)):
            grid = fit_lattices(observed, judge, _axes(observed, expected, *n), int(orders[-1]), lines)
            seen = grid.spectra(observed.choose, judge, orders)
            relative = np.full(orders[-1] + 1, np.inf)
            relative[orders] = judge.relative(*judge.errors(observed.choose.spectra[:, np.newaxis], seen))
            found.fitted.append((grid, relative))
        if found.cheapest(COMFORTABLE) is not None:
            break
        sizes, tones = few, tones[-1:]
    return found


def _axes(observed: Observed, expected: Expected, n_v: int, n_f: int) -> Axes:
    return (
        axis(observed.fit.speed, n_v, expected.speeds_mm_s),
        axis(observed.fit.force, n_f, expected.forces_n),
    )
