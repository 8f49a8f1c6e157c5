"""Features: the decorator that registers a function as a feature, and the registry."""

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
FEATURE_MODULES = (
    "autoregression", "bands", "cepstrum", "channels", "decaying_segments", "fineness", "friction",
    "hardness", "related_work", "residual_bands", "roughness", "slopes", "tap_modes",
)  # fmt: skip
"""Modules of this subpackage that define features."""
FILE_MODULE_PREFIX = "texclass_own_"
"""Prefix of the names of modules loaded from files, so that no file shadows an installed module."""


@dataclass(frozen=True)
class Gain:
    """Effect of a gain g > 0 of the signal on a feature: y(g x) = g**power * y(x) + shift * log10(g).

    `Gain()` declares that the feature does not depend on the gain.

    Attributes
    ----------
    power : float
        Exponent of the gain (default 0).
    shift : float
        Change of the value per decade of gain (default 0).

    Examples
    --------
    >>> print(Gain(power=2), "|", Gain(shift=1))  # a power, and a level in log10
    g^2 y | y + log10 g
    >>> float(Gain(shift=20).apply(-3.0, 10))
    17.0
    """

    power: float = 0.0
    shift: float = 0.0

    def __str__(self) -> str:
        """Return the right-hand side of the equation, for example "g^0.5 y + 20 log10 g"."""
        product = "y" if self.power == 0 else "g y" if self.power == 1 else f"g^{self.power:.3g} y"
        factor = "" if abs(self.shift) == 1 else f"{abs(self.shift):.3g} "
        return f"{product} {'+' if self.shift > 0 else '-'} {factor}log10 g" if self.shift else product

    def apply(self, value: Any, gain: float) -> Any:
        """Return the value of the feature after multiplying the signal by `gain`."""
        return gain**self.power * np.asarray(value) + self.shift * np.log10(gain)


@dataclass(frozen=True)
class Feature:
    """A registered feature: its function, and the properties declared in its decorator.

    Attributes
    ----------
    name : str
        Name of the function; unique.
    function : callable
        Function of a phase view and keyword parameters; returns a float or an array of shape (n_outputs,).
    phase : {"tap", "movement", "travel", "friction", "pair"}
        Phase whose view is passed to the function.
    unit : str
        Unit of every output; "1" for a dimensionless number.
    reference : str
        Paper key and equation or section.
    outputs : str, tuple of str, or callable
        Names of the outputs of a vector feature. If empty (default), the feature is a scalar, and its only
        column has the name of the feature. A name can contain parameters in braces, as in
        "lag{lags}.b{n_bands}". Each one is replaced by the elements of the parameter, or by 1 ... n if it is
        a whole number n; the last one varies fastest. If a template does not suffice, pass a function that
        returns the names for given parameters.
    gain : Gain
        Effect of multiplying the signal by a constant.
    depends_on : frozenset of {"length", "rate", "sign"}
        Properties of the signal that affect the value: length of the phase, sampling rate, and sign of the
        samples (the mounting direction of the sensor).
    divisible : bool or "at once"
        Whether the feature can be computed per segment (parameter `n_segments`); see `feature`.

    Examples
    --------
    >>> waviness = list_features()["waviness"]
    >>> waviness.phase, waviness.unit, waviness.reference
    ('movement', 'log10(m/s^2)', 'strese2015, eq. 5, corrected')
    >>> list_features()["slope_level"].columns("slope", {"lags": (1, 2)})
    ('slope.lag1', 'slope.lag2')
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
        """First line of the docstring of the function."""
        return (inspect.getdoc(self.function) or "").split("\n", 1)[0]

    @property
    def parameters(self) -> list[inspect.Parameter]:
        """Parameters of the function, without the view."""
        return list(inspect.signature(self.function).parameters.values())[1:]

    @property
    def defaults(self) -> dict[str, Any]:
        """Default of each parameter, from the signature."""
        return {p.name: p.default for p in self.parameters}

    @property
    def source(self) -> Path:
        """File that defines the function."""
        return Path(inspect.getfile(inspect.unwrap(self.function)))

    def columns(self, name: str, parameters: Mapping[str, Any]) -> tuple[str, ...]:
        """Return the column names of this feature under the given name in a feature set."""
        arguments = {**self.defaults, **parameters}
        n_segments = arguments.pop("n_segments", 1) if self.divisible else 1
        if callable(self.outputs):
            outputs = self.outputs(**arguments)
        else:
            outputs = ()
            for template in (self.outputs,) if isinstance(self.outputs, str) else self.outputs:
                keys = [key for _, key, _, _ in string.Formatter().parse(template) if key]
                values = [arguments[key] for key in keys]
                rows = itertools.product(*(v if isinstance(v, tuple) else range(1, v + 1) for v in values))
                outputs += tuple(template.format(**dict(zip(keys, row, strict=True))) for row in rows)
        if n_segments > 1:
            outputs = tuple(f"{output}.segment{i}" for output in outputs for i in range(1, n_segments + 1))
        return tuple(f"{name}.{output}" for output in outputs) or (name,)

    def __reduce_ex__(self, protocol: Any) -> Any:
        # A registered feature is pickled as its location: the lambda functions in `outputs` cannot be
        # pickled.
        module = self.function.__module__
        if module == "__main__" or getattr(_REGISTRY.get(self.name), "function", None) is not self.function:
            return super().__reduce_ex__(protocol)
        location = self.source if module.startswith(FILE_MODULE_PREFIX) else module
        return load_feature, (f"{location}:{self.name}",)


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
    """Register the decorated function as a feature.

    The decorated function accepts a phase view, or an array with the keywords `fs` (sampling rate in Hz) and
    `unit`, as in ``waviness(x, fs=10_000)``; see `texclass.features.phase_view.view_of`.

    Parameters
    ----------
    phase, unit, reference, outputs, gain, depends_on
        See `Feature`.
    divisible : bool or "at once"
        Whether to add a keyword `n_segments` (default 1), with which the feature is computed on each of
        several equal segments of the movement, for segment voting. The values are a flat array of shape
        (n_outputs * n_segments,). The segments of one output are adjacent: b1.segment1, b1.segment2,
        b2.segment1. If the movement is too short (see `texclass.features.phase_view.cut_segments`), the value
        of the whole movement is repeated for each segment. If the feature is undefined for one segment, it is
        undefined as a whole, and the reason names the segment. Use "at once" for functions that work along
        the last axis: they return (n_segments, n_outputs) for samples (n_segments, n), and (n_outputs,) for
        samples (n,). All segments together then take little longer than one segment.

    Returns
    -------
    callable
        Decorator.

    Raises
    ------
    ValueError
        If another module has already defined a feature of this name. The decorated function raises this error
        if `fs` is missing for an array, or if `n_segments` is not a positive whole number.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.features.fineness import fineness
    >>> x = np.sin(2 * np.pi * 432.0 * np.arange(20_000) / 10_000)
    >>> round(fineness(x, fs=10_000))
    432
    """

    def register(function: Callable[..., R]) -> Callable[..., R]:
        name = function.__name__
        namesake = _REGISTRY.get(name)
        if namesake is not None and namesake.function.__module__ != function.__module__:
            raise ValueError(
                f"feature {name!r} is already defined in {namesake.function.__module__}. "
                "Choose another name for the function"
            )

        @functools.wraps(function)
        def compute(
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
            signature = inspect.signature(function)
            n_segments = inspect.Parameter(
                "n_segments", inspect.Parameter.KEYWORD_ONLY, default=1, annotation=int
            )
            signature = signature.replace(parameters=[*signature.parameters.values(), n_segments])
            compute.__signature__ = signature  # type: ignore[attr-defined]
        _REGISTRY[name] = Feature(
            name, compute, phase, unit, reference, outputs, gain, frozenset(depends_on), divisible
        )
        return compute

    return register


feature_in_samples = functools.partial(feature, "movement", depends_on=("rate",), divisible="at once")
"""Decorator like `feature`, for divisible features of the movement whose lags or bands scale with the
sampling rate."""


def list_features() -> dict[str, Feature]:
    """Return all registered features by name, in alphabetical order.

    Returns
    -------
    dict
        Mapping from name to `Feature`. It contains the features of texclass, of installed packages that add
        features, and of loaded files.

    Examples
    --------
    >>> features = list_features()
    >>> [name for name in features if features[name].phase == "friction"]
    ['friction']
    """
    for module in FEATURE_MODULES:
        importlib.import_module(f"texclass.features.{module}")
    for name in shipped.entry_point_modules("features"):
        shipped.module_of("features", name)
    return dict(sorted(_REGISTRY.items()))


def find_feature(name: str, module: str = "") -> Feature:
    """Return the feature with this name.

    Parameters
    ----------
    name : str
        Name of a registered feature.
    module : str, optional
        Module that defines the feature. If given, only this module is imported, provided that it defines the
        feature.

    Returns
    -------
    Feature

    Raises
    ------
    KeyError
        If no feature has this name. The message lists the closest names.

    Examples
    --------
    >>> find_feature("ridge_densities")
    Traceback (most recent call last):
    ...
    KeyError: "there is no feature 'ridge_densities'. Did you mean ridge_density?"
    """
    if module.rpartition(".")[2] in FEATURE_MODULES:
        importlib.import_module(f"texclass.features.{module.rpartition('.')[2]}")
        if name in _REGISTRY:
            return _REGISTRY[name]
    features = list_features()
    if name not in features:
        matches = difflib.get_close_matches(name, features, n=3)
        hint = f"Did you mean {' or '.join(matches)}?" if matches else "'texclass features' lists them"
        raise KeyError(f"there is no feature {name!r}. {hint}")
    return features[name]


def load_feature(path: str) -> Feature:
    """Import a feature from a user's module or file. This runs the code of the module.

    Parameters
    ----------
    path : str
        "module:function" for an importable module, or "path/to/file.py:function".

    Returns
    -------
    Feature
        The feature. It can be pickled, so worker processes can load it.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    ValueError
        If `path` does not have one of these forms, the module cannot be imported, the function is not
        decorated with `feature`, or one of its parameters has no default.

    Examples
    --------
    >>> load_feature("texclass.features.roughness:waviness").unit
    'log10(m/s^2)'
    """
    source, _, name = path.rpartition(":")
    if not source or not name.isidentifier():
        raise ValueError(f"feature must be module:function or path/to/file.py:function, got {path!r}")
    try:
        module = _module_of(Path(source)) if source.endswith(".py") else importlib.import_module(source)
    except OSError:
        raise
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise ValueError(f"feature {path!r}: {source} cannot be imported ({reason})") from error
    function = getattr(module, name, None)
    match = next((f for f in _REGISTRY.values() if f.function is function), None)
    if match is None:
        fault = f"{name} is not decorated" if callable(function) else f"{source} has no function {name}"
        raise ValueError(f"feature {path!r}: {fault}. Expected a function decorated with @feature(...)")
    if missing := [key for key, value in match.defaults.items() if value is inspect.Parameter.empty]:
        raise ValueError(
            f"feature {path!r}: every parameter must have a default. Add one to {', '.join(missing)}"
        )
    return match


def _module_of(file: Path) -> ModuleType:
    """Import a file as a module, and import it again if its content has changed.

    The file can import other files of its folder.
    """
    path = file.expanduser().resolve()
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    name = FILE_MODULE_PREFIX + path.stem
    loaded = sys.modules.get(name)
    if loaded is not None and (loaded.__file__, loaded.__dict__.get("digest_")) == (str(path), digest):
        return loaded
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is not a Python source file")
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
    function: Callable[..., Any],
    view: Any,
    *,
    at_once: bool,
    n_segments: int = 1,
    **parameters: Any,
) -> Samples:
    """Return the values of a function for equal segments of a movement; see `feature`."""
    if not isinstance(n_segments, int) or n_segments < 1:
        raise ValueError(f"n_segments must be a positive whole number, got {n_segments!r}")
    segments = cut_segments(view, n_segments)
    if segments is view:
        return np.repeat(function(view, **parameters), n_segments)
    if at_once:
        with suppress(UndefinedFeatureError):  # the loop below names the segment
            return np.asarray(function(segments, **parameters)).T.reshape(-1)
    values = []
    for number, segment in enumerate(segment_views(segments), 1):
        try:
            values.append(np.atleast_1d(function(segment, **parameters)))
        except UndefinedFeatureError as undefined:
            raise UndefinedFeatureError(f"segment {number}: {undefined}") from None
    return np.stack(values, axis=-1).reshape(-1)
