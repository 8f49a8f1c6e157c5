"""Base classes of all textures: rendering, cost, and conversion to JSON values and arrays for files."""

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError

from texclass.recording import Samples
from texclass.vibration.autoregressive import Autoregression

NOMINAL_SPEED_MM_S, NOMINAL_FORCE_N = 100.0, 1.0
"""Speed and force of a typical stroke, for textures that depend on neither (our choice)."""


@runtime_checkable
class Renderer(Protocol):
    """Play a texture block by block; the state is kept between calls, so that blocks join without a click.

    Attributes
    ----------
    fs : float
        Sampling rate of input and output in Hz.
    """

    fs: float

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples of a path.

        Parameters
        ----------
        velocity : array_like of shape (n, 2)
            Tangential velocity in mm/s.
        force : array_like of shape (n,)
            Normal force in N; 0 or less means no contact.
        position : array_like of shape (n, 2), optional
            Position in mm (default: the integral of the velocity), used by textures with spatial features.

        Returns
        -------
        ndarray of shape (n,)
            Vibration in the unit of the recorded acceleration. It does not depend on the block lengths.
        """

    def reset(self) -> None:
        """Return to rest and restart the random numbers."""


class Serializable:
    """Convert a dataclass to JSON values and arrays, and back.

    Fields may be numbers, strings, arrays, dataclasses, tuples and mappings of these. Only arguments of the
    constructor are stored. Reading a file calls the constructor with its checks, so a file cannot contain an
    object that a program could not create.

    Attributes
    ----------
    family : str
        Name of the kind of object in files.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Hum(Serializable):
    ...     family = "hum"
    ...     name: str
    ...     tones: np.ndarray
    >>> hum = Hum("low", np.array([50.0, 120.5]))
    >>> hum.parameters(), hum.arrays()
    ({'name': 'low', 'tones': None}, {'tones': array([ 50. , 120.5])})
    >>> Hum.restore(hum.parameters(), hum.arrays()).name
    'low'
    """

    family: ClassVar[str]
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(
        arbitrary_types_allowed=True, extra="forbid", allow_inf_nan=False
    )

    def parameters(self) -> dict[str, Any]:
        """Return the fields as JSON values, with None in the place of each array."""
        return {name: _extract_arrays(value, name, {}) for name, value in _arguments(self).items()}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by their path, for example "mesh.speed" or "models.0.k"."""
        arrays: dict[str, NDArray[Any]] = {}
        for name, value in _arguments(self).items():
            _extract_arrays(value, name, arrays)
        return arrays

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Return the object whose `parameters()` and `arrays()` are given.

        Raises
        ------
        ValueError
            If a value is missing or unknown, has the wrong type or shape, or is refused by the constructor.
        """
        unused = dict(arrays)
        tree = {name: _insert_arrays(value, name, unused) for name, value in parameters.items()}
        if unused:
            raise ValueError(
                f"{cls.family}: array {min(unused)!r:.80} belongs to no parameter. "
                "Expected a parameter that is null for each array"
            )
        try:
            restored = TypeAdapter(cls).validate_python(tree)
        except ValidationError as error:
            first = error.errors()[0]
            path, value = ".".join(map(str, first["loc"])), first["input"]
            if first["type"] == "value_error":
                message = ": ".join(filter(None, [path, str(first["ctx"]["error"])]))
                raise ValueError(f"{cls.family}: {message}") from None
            if first["type"] == "unexpected_keyword_argument":
                raise ValueError(f"{cls.family}: unknown key {path}. Remove it") from None
            if first["type"] == "missing_argument":
                raise ValueError(f"{cls.family}: key {path} is missing. Add it") from None
            expected = first["msg"].removeprefix("Input should be ")
            raise ValueError(f"{cls.family}: {path} is {value!r:.80}. Expected {expected}") from None
        if _canonical_json(restored.parameters()) != _canonical_json(parameters):
            raise ValueError(
                f"{cls.family}: the parameters differ from those of the restored object. "
                "Expected each key once, and numbers instead of strings or booleans"
            )
        return restored


class Texture(Serializable, ABC):
    """Base class of surfaces that can be rendered at any speed and force.

    Attributes
    ----------
    name : str
        Name of the surface.
    fs : float
        Sampling rate of the vibration in Hz.
    speeds, forces : ndarray
        Increasing speeds (mm/s) and forces (N), above 0, of the recordings; the first and the last bound the
        range of the texture. One nominal value if the texture does not depend on speed or force.
    """

    name: str
    if TYPE_CHECKING:  # read-only here; a field in one family, a property in another

        @property
        def fs(self) -> float: ...  # noqa: D102
        @property
        def speeds(self) -> Samples: ...  # noqa: D102
        @property
        def forces(self) -> Samples: ...  # noqa: D102

    @property
    @abstractmethod
    def operations(self) -> float:
        """Mean number of multiplications and additions per rendered sample."""

    @abstractmethod
    def renderer(self, *, seed: int = 0) -> Renderer:
        """Return a renderer at rest, at the sampling rate of the texture; `seed` sets its noise, if any."""

    def autoregressions(self, speed: Samples, force: Samples) -> Autoregression:
        """Return the AR models of strokes along +x at speeds (n,) in mm/s and forces (n,) in N.

        Raises
        ------
        ValueError
            If the texture contains no AR models.
        """
        raise ValueError(
            f"texture {self.name!r} must contain AR models, got the family {self.family!r}. "
            "Write .hjif, .ahap or .wav, which take every texture"
        )


def constant_stroke(
    texture: Any,
    speed: float,
    force: float,
    n: int,
    *,
    n_settling: int = 0,
    direction: ArrayLike = (1.0, 0.0),
    seed: int = 0,
) -> Samples:
    """Return the vibration (n,) of a texture that is stroked at a constant speed (mm/s) and force (N).

    Parameters
    ----------
    texture : Texture or planned scene
        Object with a method `renderer(seed=)`.
    speed, force : float
        Speed in mm/s and force in N.
    n : int
        Number of samples to return.
    n_settling : int
        Number of samples that are rendered before these and discarded (default 0).
    direction : array_like of shape (2,)
        Unit vector of the stroke (default +x).
    seed : int
        Seed of the noise.
    """
    velocity = np.tile(speed * np.asarray(direction), (n_settling + n, 1))
    vibration = texture.renderer(seed=seed).process(velocity, np.full(n_settling + n, force))
    return np.asarray(vibration[n_settling:])


def _arguments(value: Any) -> dict[str, Any]:
    return {each.name: getattr(value, each.name) for each in fields(value) if each.init}


def _extract_arrays(value: Any, path: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """Return a value as JSON value and move its arrays into `arrays`, by their path."""
    if isinstance(value, np.ndarray):
        arrays[path] = value
        return None
    if is_dataclass(value) or isinstance(value, Mapping):
        inner = value if isinstance(value, Mapping) else _arguments(value)
        return {name: _extract_arrays(each, f"{path}.{name}", arrays) for name, each in inner.items()}
    if isinstance(value, tuple | list):
        return [_extract_arrays(each, f"{path}.{i}", arrays) for i, each in enumerate(value)]
    return value.item() if isinstance(value, np.generic) else value


def _insert_arrays(value: Any, path: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """Return a JSON value with its arrays inserted, and remove them from `arrays`."""
    if value is None:
        return arrays.pop(path, None)
    if isinstance(value, Mapping):
        return {name: _insert_arrays(each, f"{path}.{name}", arrays) for name, each in value.items()}
    if isinstance(value, list):
        return [_insert_arrays(each, f"{path}.{i}", arrays) for i, each in enumerate(value)]
    return value


def _canonical_json(parameters: Mapping[str, Any]) -> str:
    """Return parameters as JSON with sorted keys; integers are written as floats."""
    return json.dumps(json.loads(json.dumps(parameters), parse_int=float), sort_keys=True)


def freeze(owner: object, **shapes: tuple[int | str, ...]) -> None:
    """Replace fields of a frozen dataclass by read-only float64 arrays, after a check of their shapes.

    Parameters
    ----------
    owner : dataclass
        Object whose fields are replaced.
    **shapes : tuple of int or str
        Shape of each field. A string names a length that must be the same wherever the name occurs.

    Raises
    ------
    ValueError
        If a shape is wrong, or a value is NaN or infinite.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> path = SimpleNamespace(force=[1, 2], velocity=np.ones((3, 2)))
    >>> freeze(path, force=("n",), velocity=("n", 2))
    Traceback (most recent call last):
    ValueError: velocity must have shape (2, 2) and finite values, got shape (3, 2)
    """
    lengths: dict[int | str, int] = {}
    for name, shape in shapes.items():
        array = np.array(getattr(owner, name), dtype=np.float64, order="C")
        fits = array.ndim == len(shape) and all(
            size == (lengths.setdefault(length, size) if isinstance(length, str) else length)
            for size, length in zip(array.shape, shape, strict=True)
        )
        if not fits or not np.isfinite(array).all():
            expected = ", ".join(str(lengths.get(length, length)) for length in shape)
            expected += "," * (len(shape) == 1)
            raise ValueError(
                f"{name} must have shape ({expected}) and finite values, got shape {array.shape}"
            )
        array.setflags(write=False)
        object.__setattr__(owner, name, array)
