"""What a feature is: one decorated function, and everything the rest of texclass derives from it."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np

Phase = Literal["tap", "movement", "friction"]
Dependence = Literal["length", "rate"]
Outputs = tuple[str, ...] | Callable[..., tuple[str, ...]]
F = TypeVar("F", bound=Callable[..., Any])


class UndefinedFeatureError(ValueError):
    """The feature has no value for this signal; the message is the reason (value and rule).

    Extraction turns it into NaN and keeps the reason for the user.
    """


@dataclass(frozen=True)
class Gain:
    """What a feature becomes when its signal is multiplied by g > 0.

    y(g x) = g**power * y(x) + shift * log10(g); `Gain()` is an invariant feature.
    """

    power: float = 0.0
    shift: float = 0.0

    def apply(self, value: Any, gain: float) -> Any:
        """Return what `value` becomes under `gain`."""
        return gain**self.power * np.asarray(value) + self.shift * np.log10(gain)


@dataclass(frozen=True)
class Feature:
    """One registered feature: its function and what the decorator declared.

    Attributes
    ----------
    name
        The function's name; unique.
    function
        Takes a phase view and keyword parameters; returns a float or an array of shape (n_outputs,).
    phase
        Which view it reads.
    unit
        Of every output; "1" for a pure number.
    reference
        Paper key and equation or section.
    outputs
        Names of the outputs of a vector feature, or a function of the parameters that gives them; empty for a
        scalar, whose one column bears the feature's name.
    gain
        How it scales with the signal.
    depends_on
        What its value is known to depend on, as printed: "length" of the phase, sampling "rate".
    """

    name: str
    function: Callable[..., Any]
    phase: Phase
    unit: str
    reference: str
    outputs: Outputs = ()
    gain: Gain = Gain()
    depends_on: frozenset[Dependence] = frozenset()

    @property
    def summary(self) -> str:
        """First line of the docstring."""
        return (inspect.getdoc(self.function) or "").split("\n", 1)[0]

    @property
    def defaults(self) -> dict[str, Any]:
        """Parameters and their defaults, from the signature."""
        parameters = list(inspect.signature(self.function).parameters.values())[1:]
        return {p.name: p.default for p in parameters}

    def columns(self, name: str, parameters: Mapping[str, Any]) -> tuple[str, ...]:
        """Return the column names under which a set that calls this feature `name` stores it."""
        outputs = self.outputs
        if callable(outputs):
            outputs = outputs(**{**self.defaults, **parameters})
        return tuple(f"{name}.{output}" for output in outputs) or (name,)


_REGISTRY: dict[str, Feature] = {}


def feature(
    *,
    phase: Phase,
    unit: str,
    reference: str,
    outputs: Outputs = (),
    gain: Gain = Gain(),
    depends_on: tuple[Dependence, ...] = (),
) -> Callable[[F], F]:
    """Register the decorated function as a feature; see `Feature` for what is declared."""

    def register(function: F) -> F:
        name = function.__name__
        known = _REGISTRY.get(name)
        if known is not None and known.function.__module__ != function.__module__:
            raise ValueError(f"feature {name!r} is already defined in {known.function.__module__}")
        _REGISTRY[name] = Feature(
            name, function, phase, unit, reference, outputs, gain, frozenset(depends_on)
        )
        return function

    return register


def registered() -> dict[str, Feature]:
    """Return every registered feature by name, sorted by name."""
    import texclass.features  # noqa: F401  (importing the index registers all of them)

    return dict(sorted(_REGISTRY.items()))


def find(name: str) -> Feature:
    """Return the feature of that name.

    Raises
    ------
    KeyError
        If there is none; the message lists the nearest names.
    """
    import difflib

    known = registered()
    if name not in known:
        near = difflib.get_close_matches(name, known, n=3)
        hint = f"; did you mean {', '.join(near)}?" if near else ""
        raise KeyError(f"no feature is named {name!r}{hint}")
    return known[name]
