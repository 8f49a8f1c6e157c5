"""Define the base classes of textures: rendering, cost, and conversion to JSON values and arrays."""

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
"""Speed and force of a typical stroke, for textures that do not depend on them (our choice)."""


@runtime_checkable
class Renderer(Protocol):
    """Render a texture block by block; state is kept between calls, so blocks join without clicks.

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
            Normal force in N; values of 0 or less mean no contact.
        position : array_like of shape (n, 2), optional
            Position in mm (default: the integral of the velocity), used by textures with spatial features.

        Returns
        -------
        ndarray of shape (n,)
            Vibration in the unit of the recorded acceleration. It does not depend on the block lengths.
        """

    def reset(self) -> None:
        """Reset the motion and restart the random numbers."""


class Serializable:
    """Convert a dataclass to JSON values and arrays, and back.

    Fields may be numbers, strings, arrays and dataclasses, and tuples and mappings of these. Only constructor
    arguments are stored. Files are read by calling the constructor, so the values in a file are validated
    like the arguments in a program.

    Attributes
    ----------
    family : str
        Name that identifies the class in files, for example "hatt".

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
        """Return the fields as JSON values; arrays are replaced by None."""
        return {name: _extract_arrays(value, name, {}) for name, value in _arguments(self).items()}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return a dictionary of the arrays; its keys are paths such as "mesh.speed" or "models.0.k"."""
        arrays: dict[str, NDArray[Any]] = {}
        for name, value in _arguments(self).items():
            _extract_arrays(value, name, arrays)
        return arrays

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Create the object from the results of `parameters()` and `arrays()`.

        Raises
        ------
        ValueError
            If a value is missing or unknown, has the wrong type or shape, or is rejected by the constructor.
        """
        unused = dict(arrays)
        tree = {name: _insert_arrays(value, name, unused) for name, value in parameters.items()}
        if unused:
            raise ValueError(
                f"{cls.family}: array {min(unused)!r:.80} does not belong to a parameter. "
                "Expected a parameter with the value null for each array"
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
        Increasing, positive speeds (mm/s) and forces (N) of the recordings. The first and last values are the
        limits of the range of the texture. A texture that does not depend on speed or force has one nominal
        value.
    """

    name: str
    if TYPE_CHECKING:  # declared read-only, because they are fields in some families and properties in others

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
        """Return a renderer at the sampling rate of the texture; `seed` is the seed of its noise."""

    def autoregressions(self, speed: Samples, force: Samples) -> Autoregression:
        """Return the AR models of strokes along +x at speeds (n,) in mm/s and forces (n,) in N.

        Raises
        ------
        ValueError
            If the texture contains no AR models.
        """
        raise ValueError(
            f"texture {self.name!r} must contain AR models, got the family {self.family!r}. "
            "Use .hjif, .ahap or .wav, which support all textures"
        )


def stroke_range(texture: Any) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the lowest and highest speed (mm/s) and force (N) over which a texture is stroked.

    These are the limits of the texture, which are those of its recording. If a texture has a single speed or
    force, the range is half to twice that value.

    Parameters
    ----------
    texture : Texture or surface of a planned scene
        Object with the attributes `speeds` and `forces`.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> stroke_range(SimpleNamespace(speeds=np.array([20.0, 40.0, 60.0]), forces=np.array([1.0])))
    ((20.0, 60.0), (0.5, 2.0))
    """
    (slow, fast), (light, hard) = (
        (float(axis[0]), float(axis[-1])) if len(axis) > 1 else (float(axis[0] / 2), float(2 * axis[0]))
        for axis in (texture.speeds, texture.forces)
    )
    return (slow, fast), (light, hard)


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
    """Render the vibration (n,) of a texture stroked at a constant speed (mm/s) and force (N).

    Parameters
    ----------
    texture : Texture or planned scene
        Object with a method `renderer(seed=)`.
    speed, force : float
        Speed in mm/s and force in N.
    n : int
        Number of samples to return.
    n_settling : int
        Number of samples that are rendered first and discarded (default 0).
    direction : array_like of shape (2,)
        Unit vector of the stroke (default +x).
    seed : int
        Seed of the noise (default 0).
    """
    velocity = np.tile(speed * np.asarray(direction), (n_settling + n, 1))
    vibration = texture.renderer(seed=seed).process(velocity, np.full(n_settling + n, force))
    return np.asarray(vibration[n_settling:])


def _arguments(value: Any) -> dict[str, Any]:
    return {each.name: getattr(value, each.name) for each in fields(value) if each.init}


def _extract_arrays(value: Any, path: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """Convert a value to a JSON value, and move its arrays to `arrays`, with their paths as keys."""
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
    """Insert the arrays of a JSON value, and remove them from `arrays`."""
    if value is None:
        return arrays.pop(path, None)
    if isinstance(value, Mapping):
        return {name: _insert_arrays(each, f"{path}.{name}", arrays) for name, each in value.items()}
    if isinstance(value, list):
        return [_insert_arrays(each, f"{path}.{i}", arrays) for i, each in enumerate(value)]
    return value


def _canonical_json(parameters: Mapping[str, Any]) -> str:
    """Return parameters as JSON with sorted keys, with integers written as floats."""
    return json.dumps(json.loads(json.dumps(parameters), parse_int=float), sort_keys=True)


def freeze(owner: object, **shapes: tuple[int | str, ...]) -> None:
    """Replace fields of a frozen dataclass by read-only float64 arrays, and validate their shapes.

    Parameters
    ----------
    owner : dataclass
        Object whose fields are replaced.
    **shapes : tuple of int or str
        Shape of each field. A string is the name of a length; lengths with the same name must be equal.

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
