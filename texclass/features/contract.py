"""What a feature is: one decorated function, and everything the rest of texclass derives from it."""

import difflib
import functools
import hashlib
import importlib
import importlib.util
import inspect
import itertools
import string
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, TypeVar

import numpy as np

from texclass import shipped
from texclass.features.phase_view import (
    Phase,
    PhaseView,
    UndefinedFeatureError,
    View,
    cut_segments,
    segment_views,
    undefined_if,
    view_of,
)
from texclass.recording import Samples

__all__ = [
    "Feature",
    "Gain",
    "UndefinedFeatureError",
    "feature",
    "feature_in_samples",
    "find_feature",
    "list_features",
    "load_feature",
]

Dependence = Literal["length", "rate", "sign"]
Divisible = bool | Literal["at once"]
Outputs = str | tuple[str, ...] | Callable[..., tuple[str, ...]]
R = TypeVar("R")
DIMENSIONS = (
    "autoregression", "bands", "cepstrum", "channels", "decaying_segments", "fineness", "friction",
    "hardness", "related_work", "residual_bands", "roughness", "slopes", "tap_modes",
)  # fmt: skip
"""The modules of this room that hold features."""
OWN = "texclass_own_"
"""Begins the name of every module loaded from a file, so that no file shadows an installed module."""


@dataclass(frozen=True)
class Gain:
    """What a feature becomes when its signal is multiplied by g > 0.

    y(g x) = g**power * y(x) + shift * log10(g); `Gain()` is an invariant feature.
    """

    power: float = 0.0
    shift: float = 0.0

    def __str__(self) -> str:
        """Return what y becomes: g^0.5 y + 20 log10 g."""
        scaled = "y" if self.power == 0 else "g y" if self.power == 1 else f"g^{self.power:.3g} y"
        times = "" if abs(self.shift) == 1 else f"{abs(self.shift):.3g} "
        return f"{scaled} {'+' if self.shift > 0 else '-'} {times}log10 g" if self.shift else scaled

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
        Names of the outputs of a vector feature. A parameter in one, "lag{lags}.b{n_bands}", stands for each
        of its elements, or for 1 ... n of a whole number, the last one running fastest; what cannot be said
        so is said by a function of the parameters. Empty for a scalar, whose one column bears the feature's
        name.
    gain
        How it scales with the signal.
    depends_on
        What its value is known to depend on: "length" of the phase, sampling "rate", "sign" of the samples,
        which a sensor mounted the other way round turns over.
    divisible
        Whether, and how, a parameter `n_segments` computes it of equal pieces of the movement; see `feature`.
    """

    name: str
    function: Callable[..., Any]
    phase: Phase
    unit: str
    reference: str
    outputs: Outputs = ()
    gain: Gain = Gain()
    depends_on: frozenset[Dependence] = frozenset()
    divisible: Divisible = False

    @property
    def summary(self) -> str:
        """First line of the docstring."""
        return (inspect.getdoc(self.function) or "").split("\n", 1)[0]

    @property
    def parameters(self) -> list[inspect.Parameter]:
        """What the function takes beside the view."""
        return list(inspect.signature(self.function).parameters.values())[1:]

    @property
    def defaults(self) -> dict[str, Any]:
        """Parameters and their defaults, from the signature."""
        return {p.name: p.default for p in self.parameters}

    @property
    def source(self) -> Path:
        """The file that defines the function."""
        return Path(inspect.getfile(inspect.unwrap(self.function)))

    def columns(self, name: str, parameters: Mapping[str, Any]) -> tuple[str, ...]:
        """Return the column names under which a set that calls this feature `name` stores it."""
        given = {**self.defaults, **parameters}
        n_segments = given.pop("n_segments", 1) if self.divisible else 1
        if callable(self.outputs):
            outputs = self.outputs(**given)
        else:
            outputs = ()
            for template in (self.outputs,) if isinstance(self.outputs, str) else self.outputs:
                keys = [key for _, key, _, _ in string.Formatter().parse(template) if key]
                held = [given[key] for key in keys]
                ways = itertools.product(*(h if isinstance(h, tuple) else range(1, h + 1) for h in held))
                outputs += tuple(template.format(**dict(zip(keys, way, strict=True))) for way in ways)
        if n_segments > 1:
            outputs = tuple(f"{output}.segment{i}" for output in outputs for i in range(1, n_segments + 1))
        return tuple(f"{name}.{output}" for output in outputs) or (name,)

    def __reduce_ex__(self, protocol: Any) -> Any:
        # A registered feature travels as where it is found: functions that name outputs cannot be pickled.
        module = self.function.__module__
        if module == "__main__" or getattr(_REGISTRY.get(self.name), "function", None) is not self.function:
            return super().__reduce_ex__(protocol)
        return load_feature, (f"{self.source if module.startswith(OWN) else module}:{self.name}",)


_REGISTRY: dict[str, Feature] = {}


def feature(
    phase: Phase,
    unit: str,
    reference: str,
    *,
    outputs: Outputs = (),
    gain: Gain = Gain(),
    depends_on: tuple[Dependence, ...] = (),
    divisible: Divisible = False,
) -> Callable[[Callable[..., R]], Callable[..., R]]:
    """Register the decorated function as a feature; see `Feature` for what is declared.

    The function returned takes a phase view, or an array and its rate: ``waviness(x, fs=10_000)``. Keywords
    are those of the function, and with an array `fs` (Hz) and `unit`; see `view_of`.

    Parameters
    ----------
    phase, unit, reference, outputs, gain, depends_on
        See `Feature`.
    divisible : bool or "at once"
        Whether to add a keyword `n_segments` (default 1) that computes the feature on equal segments of the
        movement, for segment voting. The values are a flat array of shape (n_outputs * n_segments,): the
        segments of one output are adjacent, with the names b1.segment1, b1.segment2, b2.segment1. A movement
        that is too short (see `cut_segments`) counts as n_segments equal segments. If the feature is
        undefined for a segment, it is undefined; the reason names the segment. "at once" is for functions
        that work along the last axis: they return (n_segments, n_outputs) for samples (n_segments, n), and
        (n_outputs,) for samples (n,). This is almost as fast as one segment.

    Raises
    ------
    ValueError
        If the name is that of a feature of another module; by the feature returned, if it is given an array
        without `fs`, or `n_segments` is not a whole number above 0.

    Examples
    --------
    >>> from texclass.features.fineness import fineness
    >>> x = np.sin(2 * np.pi * 432.0 * np.arange(20_000) / 10_000)
    >>> round(fineness(x, fs=10_000))
    432
    """

    def register(function: Callable[..., R]) -> Callable[..., R]:
        name = function.__name__
        known = _REGISTRY.get(name)
        if known is not None and known.function.__module__ != function.__module__:
            raise ValueError(f"feature {name!r} is already defined in {known.function.__module__}")

        @functools.wraps(function)
        def of_signal(
            view: Any, /, *args: Any, fs: float | None = None, unit: str = "arbitrary", **parameters: Any
        ) -> Any:
            try:
                with np.errstate(over="ignore", invalid="ignore"):
                    if not isinstance(view, View):
                        view = view_of(phase, view, fs, unit)
                    if not divisible or "n_segments" not in parameters:
                        value: Any = function(view, *args, **parameters)
                    else:
                        value = _compute_segments(
                            function, view, *args, at_once=divisible == "at once", **parameters
                        )
            except OverflowError:
                value = np.inf
            undefined_if(not np.isfinite(value).all(), "the value exceeds double precision")
            return value

        if divisible:
            own = inspect.signature(function)
            added = inspect.Parameter("n_segments", inspect.Parameter.KEYWORD_ONLY, default=1, annotation=int)
            signature = own.replace(parameters=[*own.parameters.values(), added])
            of_signal.__signature__ = signature  # type: ignore[attr-defined]
        _REGISTRY[name] = Feature(
            name, of_signal, phase, unit, reference, outputs, gain, frozenset(depends_on), divisible
        )
        return of_signal

    return register


feature_in_samples = functools.partial(feature, "movement", depends_on=("rate",), divisible="at once")
"""Like `feature`, of a movement whose spans or bands are counted in samples; also of its pieces."""


def list_features() -> dict[str, Feature]:
    """Return every registered feature by name, sorted by name."""
    for module in DIMENSIONS:
        importlib.import_module(f"texclass.features.{module}")
    for name in shipped.entry_point_modules("features"):
        shipped.module_of("features", name)
    return dict(sorted(_REGISTRY.items()))


def find_feature(name: str, module: str = "") -> Feature:
    """Return the feature of that name; where its module is given, no other one of this room is loaded.

    Raises
    ------
    KeyError
        If there is none; the message lists the nearest names.
    """
    if module.rpartition(".")[2] in DIMENSIONS:
        importlib.import_module(f"texclass.features.{module.rpartition('.')[2]}")
        if name in _REGISTRY:
            return _REGISTRY[name]
    known = list_features()
    if name not in known:
        near = difflib.get_close_matches(name, known, n=3)
        hint = f"; did you mean {', '.join(near)}?" if near else ""
        raise KeyError(f"no feature is named {name!r}{hint}")
    return known[name]


def load_feature(named: str) -> Feature:
    """Import the feature that a user names. This runs the code of its module.

    Parameters
    ----------
    named : str
        "module:function" with an importable module, or "path/to/file.py:function".

    Returns
    -------
    Feature
        Ready for a `Member` of a feature set, in worker processes too.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the name has another form, the module cannot be imported, or the function is not a decorated
        feature whose parameters have defaults.
    """
    place, _, name = named.rpartition(":")
    if not place or not name.isidentifier():
        raise ValueError(
            f"feature {named!r} not understood. Expected module:function or path/to/file.py:function"
        )
    try:
        module = _module_of(Path(place)) if place.endswith(".py") else importlib.import_module(place)
    except OSError:
        raise
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise ValueError(f"feature {named!r}: {place} cannot be imported ({reason})") from error
    function = getattr(module, name, None)
    found = next((f for f in _REGISTRY.values() if f.function is function), None)
    if found is None:
        what = "is not decorated" if callable(function) else "is not a function of it"
        raise ValueError(f"feature {named!r}: {name} {what}. Expected a function under @feature(...)")
    if bare := [key for key, value in found.defaults.items() if value is inspect.Parameter.empty]:
        raise ValueError(
            f"feature {named!r}: parameter {bare[0]!r} has no default. Expected a default for each parameter"
        )
    return found


def _module_of(file: Path) -> ModuleType:
    """Run a file as a module, once for each content; what lies beside it can be imported by it."""
    path = file.expanduser().resolve()
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    name = OWN + path.stem
    known = sys.modules.get(name)
    if known is not None and (known.__file__, known.__dict__.get("digest_")) == (str(path), digest):
        return known
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is no Python source")
    module = importlib.util.module_from_spec(spec)
    module.__dict__["digest_"] = digest
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _compute_segments(
    function: Callable[..., Any], view: PhaseView, *, at_once: bool, n_segments: int = 1, **parameters: Any
) -> Samples:
    """Return what a function gives for equal pieces of a movement; see `feature`."""
    if not isinstance(n_segments, int) or n_segments < 1:
        raise ValueError(f"n_segments is {n_segments!r}. Expected a whole number of at least 1")
    cut = cut_segments(view, n_segments)
    if cut is view:
        return np.repeat(function(view, **parameters), n_segments)
    if at_once:
        with suppress(UndefinedFeatureError):  # which piece is undefined, they say one by one
            return np.asarray(function(cut, **parameters)).T.reshape(-1)
    found = []
    for number, piece in enumerate(segment_views(cut), 1):
        try:
            found.append(np.atleast_1d(function(piece, **parameters)))
        except UndefinedFeatureError as undefined:
            raise UndefinedFeatureError(f"segment {number}: {undefined}") from None
    return np.stack(found, axis=-1).reshape(-1)
