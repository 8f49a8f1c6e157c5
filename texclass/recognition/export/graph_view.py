"""What features as graphs are made with: a view of movements as tensors, and which feature has a builder.

A builder takes a `GraphView`, which stands for `PhaseView`, and the parameters of the feature; it returns
the name of a tensor (n, n_outputs) of double precision, NaN in a row where the signal leaves the feature
undefined. Where the length or the rate of a window does, nothing is built. Comparisons are made on samples of
single precision, as the functions do, so that counts are equal; sums are made in double precision.

A feature of one's own gets a graph under ``@graph_of("its_name")``, anywhere in the module that defines it.
"""

import importlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from texclass.features.phase_view import LEAST_PIECE
from texclass.features.sets import FeatureSet, Member

if TYPE_CHECKING:
    from texclass.recognition.export.graph import Graph

Builder = Callable[..., str]
GRAPHS: dict[str, Builder] = {}
"""Feature -> its builder; see `builders`."""
MODULES = ("feature_graphs", "filtered_graphs")
"""The modules beside this one that hold builders."""


@dataclass(frozen=True, eq=False)
class GraphView:
    """Movements of one length, as tensors: what `PhaseView` is to the function of a feature.

    Attributes
    ----------
    graph : Graph
        Grows.
    samples : str
        Tensor of shape (n, n_samples), double, conditioned.
    fs : float
        Sampling rate in Hz.
    n_samples : int
        Samples of each movement.
    """

    graph: "Graph"
    samples: str
    fs: float
    n_samples: int

    def once(self, key: tuple[Any, ...], make: Callable[[], Any]) -> Any:
        """Return what `make` adds for these movements, added once."""
        return self.graph.once((self.samples, *key), make)

    @property
    def level(self) -> str:
        """The largest magnitude, shape (n, 1)."""
        return str(self.once(("level",), lambda: self.mean(self.add("Abs", self.samples), "ReduceMax")))

    @property
    def silent(self) -> str:
        """Whether all samples are the same, or one is not finite, shape (n, 1), bool."""

        def make() -> str:
            range_ = self.add(
                "Sub", self.mean(self.samples, "ReduceMax"), self.mean(self.samples, "ReduceMin")
            )
            finite = self.add("IsNaN", self.add("Mul", self.level, 0.0))
            return self.add("Or", self.add("Not", self.add("Greater", range_, 0.0)), finite)

        return str(self.once(("silent",), make))

    @property
    def unit32(self) -> str:
        """The samples divided by `level`, in single precision, shape (n, n_samples)."""
        unit = partial(self.add, "Div", self.samples, self.level)
        return str(self.once(("unit32",), lambda: self.graph.cast(unit(), np.float32)))

    @property
    def unit(self) -> str:
        """What `unit32` holds, in double precision."""
        return str(self.once(("unit",), lambda: self.graph.cast(self.unit32, np.float64)))

    @property
    def log_level(self) -> str:
        """log10 of `level`, shape (n, 1)."""
        return str(self.once(("log_level",), lambda: self.log10(self.level)))

    def add(self, operator: str, *operands: Any, **attributes: Any) -> str:
        """Add a node; see `Graph.add`."""
        return self.graph.add(operator, *operands, **attributes)

    def shifted(self, operand: str, at: int, n: int) -> str:
        """Add the elements [at, at + n) of the last axis."""
        return self.graph.cut(operand, at, at + n)

    def mean(self, operand: str, reduction: str = "ReduceMean", axis: int = -1) -> str:
        """Add a reduction over an axis, which is kept."""
        return self.add(reduction, operand, np.array([axis], dtype=np.int64), keepdims=1)

    def log10(self, operand: str) -> str:
        """Add a logarithm."""
        return self.add("Mul", self.add("Log", operand), 1 / math.log(10))

    def running(self, operand: str) -> str:
        """Add sums of the first 0, 1, 2 ... elements of rows."""
        return self.add(
            "Pad", self.add("CumSum", operand, np.array(1)), np.array([0, 1, 0, 0], dtype=np.int64)
        )

    def moving_average(self, operand: str, size: int, n: int) -> str:
        """Add the centred moving average over n of rows of `size`, cut at the ends; see `moving_average`."""
        start = np.arange(size) - min(n, 2 * size) // 2
        first, stop = np.maximum(start, 0), np.minimum(start + min(n, 2 * size), size)
        running = self.running(operand)
        low, high = (self.add("Gather", running, at, axis=1) for at in (first, stop))
        return self.add("Div", self.add("Sub", high, low), (stop - first).astype(np.float64))

    def beside(self, *columns: str) -> str:
        """Add what has tensors (n, ...) side by side."""
        return self.add("Concat", *columns, axis=1)

    def where(self, defined: str, values: str) -> str:
        """Add values, NaN where they are not defined."""
        return self.add("Where", defined, values, np.nan)


def graph_of(feature: str) -> Callable[[Builder], Builder]:
    """Register the decorated function as the graph of a feature; see the module.

    Parameters
    ----------
    feature : str
        Its name.
    """

    def register(builder: Builder) -> Builder:
        GRAPHS[feature] = builder
        return builder

    return register


def builders() -> Mapping[str, Builder]:
    """Return the builder of every feature that has one."""
    for module in MODULES:
        importlib.import_module(f"{__package__}.{module}")
    return GRAPHS


def without_graph(feature_set: FeatureSet) -> tuple[str, ...]:
    """Return the names of the members of a set that have no graph, or read no movement."""
    known = builders()
    return tuple(
        m.name for m in feature_set.members if m.feature.phase != "movement" or m.feature.name not in known
    )


def member_graph(view: GraphView, member: Member) -> str:
    """Add all columns of a member of a set, shape (n, n_columns): NaN in all where one is undefined.

    Parameters
    ----------
    view : GraphView
        The movements.
    member : Member
        Its feature has a graph.
    """
    given: dict[str, Any] = {**member.feature.defaults, **member.parameters}
    n_pieces = given.pop("n_pieces", 1) if member.feature.divisible else 1
    cut = n_pieces > 1 and view.n_samples >= n_pieces * LEAST_PIECE
    part = pieces_of(view, n_pieces) if cut else view
    name = member.feature.name
    made = part.once(("feature", name, *sorted(given.items())), lambda: builders()[name](part, **given))
    values = part.add("Where", part.silent, np.nan, made)
    n_outputs = len(member.all_columns) // n_pieces
    if cut:
        values = view.graph.reshape(values, -1, n_pieces, n_outputs)
        values = view.graph.reshape(view.add("Transpose", values, perm=[0, 2, 1]), 0, n_outputs * n_pieces)
    elif n_pieces > 1:
        values = view.add("Gather", values, np.repeat(np.arange(n_outputs), n_pieces), axis=1)
    finite = view.mean(view.add("Mul", values, 0.0), "ReduceSum")  # NaN if one is NaN or infinite
    return view.add("Where", view.add("IsNaN", finite), np.nan, values)


def pieces_of(view: GraphView, n_pieces: int) -> GraphView:
    """Return the view of equal pieces, one after the other: n_pieces rows of each movement."""

    def make() -> GraphView:
        size = view.n_samples // n_pieces
        whole = view.shifted(view.samples, 0, size * n_pieces)
        return GraphView(view.graph, view.graph.reshape(whole, -1, size), view.fs, size)

    found: GraphView = view.once(("pieces", n_pieces), make)
    return found
