"""Phase views: what a feature function reads, with transforms computed once and only when asked for."""

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Concatenate, ParamSpec, TypeVar

from texclass.recording import Samples

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True, eq=False)
class PhaseView:
    """One phase of one channel: samples, sampling rate, and a memory for shared transforms.

    Attributes
    ----------
    samples : ndarray of shape (n,)
        The movement's acceleration (without gravity and the hand's path) or the friction voltage during it.
    fs : float
        Sampling rate in Hz.
    """

    samples: Samples
    fs: float
    memory: dict[Any, Any] = field(default_factory=dict, repr=False)

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return int(self.samples.shape[0])


@dataclass(frozen=True, eq=False)
class TapSignal:
    """One tap, split at the contact.

    Attributes
    ----------
    hand : ndarray of shape (n,)
        Acceleration of the hand towards the surface, before the contact; may be empty.
    impulse : ndarray of shape (m,)
        Impact and decay, from the contact on.
    """

    hand: Samples
    impulse: Samples


@dataclass(frozen=True, eq=False)
class TapView:
    """All taps of one channel of one recording.

    Attributes
    ----------
    taps : tuple of TapSignal
        At least one.
    fs : float
        Sampling rate in Hz.
    noise : float
        Root mean square of the quiet stretch (same unit as the samples); 0.0 when there is none.
    """

    taps: tuple[TapSignal, ...]
    fs: float
    noise: float = 0.0
    memory: dict[Any, Any] = field(default_factory=dict, repr=False)


V = TypeVar("V", PhaseView, TapView)

STOPWATCH = "stopwatch"
"""Key of a view's memory; what stands there, (key, compute) -> result, is asked to time each transform."""


def transform(function: Callable[Concatenate[V, P], R]) -> Callable[Concatenate[V, P], R]:
    """Remember the result of a transform of a view on the view, by the values of its (hashable) parameters.

    Whoever receives a remembered array must not write to it.
    """
    signature = inspect.signature(function)
    defaults: tuple[Any, ...] = tuple(p.default for p in signature.parameters.values())[1:]

    @functools.wraps(function)
    def remembered(view: V, /, *args: P.args, **kwargs: P.kwargs) -> R:
        if kwargs:
            bound: inspect.BoundArguments = signature.bind(view, *args, **kwargs)
            bound.apply_defaults()
            key = (function, *list(bound.arguments.values())[1:])
        else:  # the same key, without the time that binding takes
            key = (function, *args, *defaults[len(args) :])
        memory = view.memory
        if key not in memory:
            timed = memory.get(STOPWATCH)
            compute = functools.partial(function, view, *args, **kwargs)
            memory[key] = compute() if timed is None else timed(key, compute)
        result: R = memory[key]
        return result

    return remembered
