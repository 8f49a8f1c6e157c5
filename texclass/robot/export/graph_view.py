"""What features as graphs are made with: a view of movements as tensors, and which feature has a builder.

A builder takes a `GraphView`, which stands for `PhaseView`, and the parameters of the feature; it returns
a tensor (n, n_outputs) of double precision, NaN in a row where the signal leaves the feature undefined. Where
the length or the rate of a window does, nothing is built. Comparisons are made on samples of single
precision, as the functions do, so that counts are equal; sums are made in double precision.

A feature of one's own gets a graph under ``@graph_of("its_name")``, anywhere in the module that defines it.
"""

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial, wraps
from typing import Any, Concatenate, ParamSpec

import numpy as np

from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import MIN_SEGMENT_SAMPLES, PhaseView
from texclass.features.sets import FeatureSet, Member
from texclass.robot.export.graph import Graph, Made, Tensor

Builder = Callable[..., Tensor]
Given = ParamSpec("Given")
GRAPHS: dict[str, Builder] = {}
"""Feature -> its builder; see `builders`."""


@dataclass(frozen=True, eq=False)
class GraphView:
    """Movements of one length, as tensors: what `PhaseView` is to the function of a feature.

    Attributes
    ----------
    samples : Tensor
        Of shape (n, n_samples), double, conditioned.
    fs : float
        Sampling rate in Hz.
    n_samples : int
        Samples of each movement.
    """

    samples: Tensor
    fs: float
    n_samples: int

    @property
    def graph(self) -> Graph:
        """What grows."""
        return self.samples.graph

    @cached_property
    def level(self) -> Tensor:
        """The largest magnitude, shape (n, 1)."""
        return abs(self.samples).reduced("ReduceMax", -1)

    @cached_property
    def silent(self) -> Tensor:
        """Whether all samples are the same, or one is not finite, shape (n, 1), bool."""
        range_ = self.samples.reduced("ReduceMax", -1) - self.samples.reduced("ReduceMin", -1)
        is_broken = self.add("IsNaN", self.level * 0.0)
        return self.add("Not", range_ > 0.0) | is_broken

    @cached_property
    def unit32(self) -> Tensor:
        """The samples divided by `level`, in single precision, shape (n, n_samples)."""
        return (self.samples / self.level).cast(np.float32)

    @cached_property
    def unit(self) -> Tensor:
        """What `unit32` holds, in double precision."""
        return self.unit32.cast(np.float64)

    @cached_property
    def log_level(self) -> Tensor:
        """log10 of `level`, shape (n, 1)."""
        return self.level.log10()

    def add(self, operator: str, *operands: Any, **attributes: Any) -> Tensor:
        """Add a node; see `Graph.add`."""
        return self.graph.add(operator, *operands, **attributes)

    def running(self, operand: Tensor) -> Tensor:
        """Add sums of the first 0, 1, 2 ... elements of rows."""
        return self.add(
            "Pad", self.add("CumSum", operand, np.array(1)), np.array([0, 1, 0, 0], dtype=np.int64)
        )

    def moving_average(self, operand: Tensor, size: int, n: int) -> Tensor:
        """Add the centred moving average over n of rows of `size`, cut at the ends; see `moving_average`."""
        start = np.arange(size) - min(n, 2 * size) // 2
        first, stop = np.maximum(start, 0), np.minimum(start + min(n, 2 * size), size)
        running = self.running(operand)
        low, high = (running.take(at) for at in (first, stop))
        return (high - low) / (stop - first).astype(np.float64)


def once(
    adds: Callable[Concatenate[GraphView, Given], Made],
) -> Callable[Concatenate[GraphView, Given], Made]:
    """Let the decorated function add for a view what it adds only once: asked again, it returns the same."""

    @wraps(adds)
    def added(view: GraphView, /, *args: Given.args, **options: Given.kwargs) -> Made:
        key = adds, view, args, *sorted(options.items())
        return view.graph.once(key, partial(adds, view, *args, **options))

    return added


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
    importlib.import_module(f"{__package__}.feature_graphs")
    return GRAPHS


def without_graph(feature_set: FeatureSet) -> tuple[str, ...]:
    """Return the names of the members of a set that have no graph, or read no movement."""
    known = builders()
    return tuple(
        m.name for m in feature_set.members if m.feature.phase != "movement" or m.feature.name not in known
    )


def member_graph(view: GraphView, member: Member) -> Tensor:
    """Add all columns of a member of a set, shape (n, n_columns): NaN in all where one is undefined.

    Whether the length or the rate of the movements leaves them undefined is found by trying.

    Parameters
    ----------
    view : GraphView
        The movements.
    member : Member
        Its feature has a graph.
    """
    noise = np.random.default_rng(0).standard_normal(view.n_samples)
    try:
        member.feature.function(PhaseView(noise, view.fs), **member.parameters)
    except UndefinedFeatureError:
        return view.level * 0.0 + np.full((1, len(member.all_columns)), np.nan)
    given: dict[str, Any] = {**member.feature.defaults, **member.parameters}
    n_segments = given.pop("n_segments", 1) if member.feature.divisible else 1
    cut = n_segments > 1 and view.n_samples >= n_segments * MIN_SEGMENT_SAMPLES
    part = segments_of(view, n_segments) if cut else view
    made = once(builders()[member.feature.name])(part, **given)
    values = part.add("Where", part.silent, np.nan, made)
    n_outputs = len(member.all_columns) // n_segments
    if cut:
        values = values.reshape(-1, n_segments, n_outputs)
        values = view.add("Transpose", values, perm=[0, 2, 1]).reshape(0, n_outputs * n_segments)
    elif n_segments > 1:
        values = values.take(np.repeat(np.arange(n_outputs), n_segments))
    broken = view.add("IsNaN", (values * 0.0).sum())  # one is NaN or infinite
    return view.add("Where", broken, np.nan, values)


@once
def segments_of(view: GraphView, n_segments: int) -> GraphView:
    """Return the view of equal pieces, one after the other: n_segments rows of each movement."""
    size = view.n_samples // n_segments
    return GraphView(view.samples.cut(0, size * n_segments).reshape(-1, size), view.fs, size)
