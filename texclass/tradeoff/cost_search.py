"""The search of a cost-aware selection: which columns to buy next, which to give up."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from texclass.experiment.cost import CostModel
from texclass.recording import Samples
from texclass.tradeoff.criterion import Criterion

FREE = 0.01
"""Least cost that a move is taken to have, in units of the total: what is free is not infinitely good."""
Unit = Literal["column", "feature"]


@dataclass(frozen=True)
class Choice:
    """A subset of columns on the way of a selection.

    Attributes
    ----------
    columns : tuple of int
        Sorted.
    cost : float
        In the unit of the costs (ms).
    score : float
        Inner cross-validated score.
    """

    columns: tuple[int, ...]
    cost: float
    score: float


def best_within(path: Iterable[Choice], max_cost: float) -> Choice | None:
    """Return the best choice of a path that a budget affords, the cheapest of equals; None without one."""
    affordable = [choice for choice in path if choice.cost <= max_cost]
    return max(affordable, key=lambda choice: (choice.score, -choice.cost), default=None)


@dataclass(frozen=True, eq=False)
class Search:
    """One search; see `CostAwareSelector` for what the settings mean.

    Attributes
    ----------
    model
        What columns cost.
    criterion
        How good a subset of them is.
    budget
        In the unit of the costs.
    most
        Largest number of columns.
    floating, unit, tolerance
        As in `CostAwareSelector`.
    """

    model: CostModel
    criterion: Criterion
    budget: float
    most: int
    floating: bool = True
    unit: Unit = "feature"
    tolerance: float = 0.0

    @cached_property
    def features(self) -> list[list[int]]:
        """The columns of each feature, by number."""
        names = np.array(self.model.features)
        return [np.flatnonzero(names == f).tolist() for f in dict.fromkeys(self.model.features)]

    @cached_property
    def least(self) -> float:
        """What a move costs at least."""
        return max(FREE * self.model.total, np.finfo(np.float64).tiny)

    def forward(self, thrift: float) -> Iterator[Choice]:
        """Yield each better choice: add the move that is worth most, then drop what earns nothing."""
        now = Choice((), 0.0, self.criterion.of(()))
        while (better := self._add(now, thrift)) is not None:
            now = better
            yield now
            while self.floating and (lighter := self._drop(now)) is not None:
                now = lighter
                yield now

    def backward(self, thrift: float) -> Iterator[Choice]:
        """Yield the full set and what is left of it as the feature that earns least goes, to the last."""
        now: Choice | None = self._choice(range(len(self.model.columns)))
        while now is not None:
            if now.cost <= self.budget and len(now.columns) <= self.most:
                yield now
            now = self._leave(now, thrift)

    def _choice(self, columns: Iterable[int]) -> Choice:
        chosen = tuple(sorted(columns))
        return Choice(chosen, self.model.of(chosen), self.criterion.of(chosen))

    def _add(self, now: Choice, thrift: float) -> Choice | None:
        moves = [m for m in self._moves(now) if len(m) <= self.most and self.model.of(m) <= self.budget]
        if not moves:
            return None
        scores = self._scores(now, moves)
        gain = scores - now.score
        price = np.array([max(self.model.of(m) - now.cost, self.least) for m in moves])
        worth = np.where(gain > self.tolerance, gain / price**thrift, -np.inf)
        if not now.columns and (gain <= self.tolerance).all():
            worth = gain  # something has to be selected
        best = int(worth.argmax())
        if worth[best] == -np.inf:
            return None
        return Choice(tuple(sorted(moves[best])), self.model.of(moves[best]), float(scores[best]))

    def _moves(self, now: Choice) -> list[list[int]]:
        """Return every single column added, then all that is left of every feature (two columns or more)."""
        have = set(now.columns)
        single = [[*now.columns, i] for i in range(len(self.model.columns)) if i not in have]
        left = [[i for i in feature if i not in have] for feature in self.features]
        if self.unit == "feature":
            return [[*now.columns, *rest] for rest in left if rest]
        return single + [[*now.columns, *rest] for rest in left if len(rest) > 1]

    def _scores(self, now: Choice, moves: Sequence[list[int]]) -> Samples:
        """Return the score of every move; single columns come first and are compared at once."""
        n = len(now.columns)
        single = [m[-1] for m in moves if len(m) == n + 1]
        added = self.criterion.adding(now.columns, single) if single else np.empty(0)
        more = iter(added)
        return np.array([next(more) if len(m) == n + 1 else self.criterion.of(m) for m in moves])

    def _without_each(self, now: Choice, *, columns: bool) -> list[Choice]:
        """Return what is left when one feature (or one column) goes, unless nothing is."""
        rest = [tuple(c for c in now.columns if c not in feature) for feature in self.features]
        if columns:
            rest += [now.columns[:i] + now.columns[i + 1 :] for i in range(len(now.columns))]
        return [self._choice(r) for r in dict.fromkeys(rest) if 0 < len(r) < len(now.columns)]

    def _drop(self, now: Choice) -> Choice | None:
        """Return the best choice that is cheaper and no worse, or better and no dearer; None without one."""
        lighter = self._without_each(now, columns=self.unit == "column")
        kept = [
            c
            for c in lighter
            if (c.score, now.cost) > (now.score, c.cost) or (c.score >= now.score and c.cost < now.cost)
        ]
        return max(kept, key=lambda c: (now.cost - c.cost, c.score), default=None)

    def _leave(self, now: Choice, thrift: float) -> Choice | None:
        """Return the choice without the feature that loses least for what its going saves."""
        lighter = self._without_each(now, columns=False)

        def price(choice: Choice) -> float:
            loss, saved = now.score - choice.score, max(now.cost - choice.cost, self.least)
            return loss / saved**thrift if loss > 0 else loss

        return min(lighter, key=lambda c: (price(c), c.cost), default=None)
