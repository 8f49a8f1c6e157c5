"""Views of movements as tensors, and the registry of features with a graph.

A builder is a function that adds the graph of a feature. It receives a `GraphView`, which corresponds to
`PhaseView`, and the parameters of the feature. It returns a tensor (n, n_outputs) in double precision, with
NaN in rows where the feature is undefined for the signal. Builders compare samples in single precision, as
the feature functions do, so that counts are equal; they compute sums in double precision.

The decorator ``@graph_of("name")`` registers a builder for your own feature. Use it anywhere in the module
that defines the feature.
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
from texclass.robot.export.graph import Cached, Graph, Tensor

Builder = Callable[..., Tensor]
Parameters = ParamSpec("Parameters")
GRAPHS: dict[str, Builder] = {}
"""Name of a feature -> builder of its graph; see `builders`."""


@dataclass(frozen=True, eq=False)
class GraphView:
    """Conditioned movements of equal length as a tensor, the counterpart of `PhaseView`.

    Attributes
    ----------
    samples : Tensor
        Conditioned samples (n, n_samples) in double precision.
    fs : float
        Sampling rate in Hz.
    n_samples : int
        Number of samples of each movement.
    """

    samples: Tensor
    fs: float
    n_samples: int

    @property
    def graph(self) -> Graph:
        """Graph to which nodes are added."""
        return self.samples.graph

    @cached_property
    def level(self) -> Tensor:
        """Largest magnitude of the samples of each movement, shape (n, 1)."""
        return abs(self.samples).reduced("ReduceMax", -1)

    @cached_property
    def is_undefined(self) -> Tensor:
        """Whether all samples of a movement are equal, or one is not finite; boolean, shape (n, 1)."""
        range_ = self.samples.reduced("ReduceMax", -1) - self.samples.reduced("ReduceMin", -1)
        is_not_finite = self.add("IsNaN", self.level * 0.0)
        return self.add("Not", range_ > 0.0) | is_not_finite

    @cached_property
    def unit32(self) -> Tensor:
        """Samples divided by `level`, in single precision, shape (n, n_samples)."""
        return (self.samples / self.level).cast(np.float32)

    @cached_property
    def unit(self) -> Tensor:
        """Samples of `unit32`, cast to double precision."""
        return self.unit32.cast(np.float64)

    @cached_property
    def log_level(self) -> Tensor:
        """Logarithm (base 10) of `level`, shape (n, 1)."""
        return self.level.log10()

    def add(self, operator: str, *operands: Any, **attributes: Any) -> Tensor:
        """Add a node; see `Graph.add`."""
        return self.graph.add(operator, *operands, **attributes)

    def running(self, operand: Tensor) -> Tensor:
        """Add the cumulative sums of each row, starting with 0."""
        return self.add(
            "Pad", self.add("CumSum", operand, np.array(1)), np.array([0, 1, 0, 0], dtype=np.int64)
        )

    def moving_average(self, operand: Tensor, size: int, n: int) -> Tensor:
        """Add the centred moving average over `n` of `size` elements in each row, truncated at the ends."""
        start = np.arange(size) - min(n, 2 * size) // 2
        first, stop = np.maximum(start, 0), np.minimum(start + min(n, 2 * size), size)
        running = self.running(operand)
        low, high = (running.take(indices) for indices in (first, stop))
        return (high - low) / (stop - first).astype(np.float64)


def once(
    function: Callable[Concatenate[GraphView, Parameters], Cached],
) -> Callable[Concatenate[GraphView, Parameters], Cached]:
    """Cache the tensors that a function adds, so that it adds them once per view and set of arguments."""

    @wraps(function)
    def cached(view: GraphView, /, *args: Parameters.args, **options: Parameters.kwargs) -> Cached:
        key = function, view, args, *sorted(options.items())
        return view.graph.once(key, partial(function, view, *args, **options))

    return cached


def graph_of(feature: str) -> Callable[[Builder], Builder]:
    """Register the decorated function as the builder of the graph of a feature; see the module docstring.

    Parameters
    ----------
    feature : str
        Name of the feature.

    Examples
    --------
    >>> @graph_of("my_level")
    ... def my_level(view):
    ...     return view.log_level
    >>> GRAPHS.pop("my_level") is my_level
    True
    """

    def register(builder: Builder) -> Builder:
        GRAPHS[feature] = builder
        return builder

    return register


def builders() -> Mapping[str, Builder]:
    """Return the builders of all features with a graph."""
    importlib.import_module(f"{__package__}.feature_graphs")
    return GRAPHS


def features_without_graph(feature_set: FeatureSet) -> tuple[str, ...]:
    """Return the names of the members of a set that have no graph or do not use the movement phase."""
    graphs = builders()
    return tuple(
        m.name for m in feature_set.members if m.feature.phase != "movement" or m.feature.name not in graphs
    )


def member_graph(view: GraphView, member: Member) -> Tensor:
    """Add all columns of a member of a feature set, shape (n, n_columns); if one is undefined, all are NaN.

    Parameters
    ----------
    view : GraphView
        Movements.
    member : Member
        Member of a feature set, whose feature has a graph.
    """
    # A test with noise shows whether the feature is defined for this length and sampling rate.
    noise = np.random.default_rng(0).standard_normal(view.n_samples)
    try:
        member.feature.function(PhaseView(noise, view.fs), **member.parameters)
    except UndefinedFeatureError:
        return view.level * 0.0 + np.full((1, len(member.all_columns)), np.nan)
    parameters: dict[str, Any] = {**member.feature.defaults, **member.parameters}
    n_segments = parameters.pop("n_segments", 1) if member.feature.divisible else 1
    is_divided = n_segments > 1 and view.n_samples >= n_segments * MIN_SEGMENT_SAMPLES
    segments = segments_of(view, n_segments) if is_divided else view
    outputs = once(builders()[member.feature.name])(segments, **parameters)
    values = segments.add("Where", segments.is_undefined, np.nan, outputs)
    n_outputs = len(member.all_columns) // n_segments
    if is_divided:
        values = values.reshape(-1, n_segments, n_outputs)
        values = view.add("Transpose", values, perm=[0, 2, 1]).reshape(0, n_outputs * n_segments)
    elif n_segments > 1:
        values = values.take(np.repeat(np.arange(n_outputs), n_segments))
    is_not_finite = view.add("IsNaN", (values * 0.0).sum())  # true if any value is NaN or infinite
    return view.add("Where", is_not_finite, np.nan, values)


@once
def segments_of(view: GraphView, n_segments: int) -> GraphView:
    """Divide movements into segments; each movement becomes `n_segments` consecutive rows of the result."""
    size = view.n_samples // n_segments
    return GraphView(view.samples.cut(0, size * n_segments).reshape(-1, size), view.fs, size)
