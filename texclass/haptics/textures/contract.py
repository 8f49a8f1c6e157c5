"""What every texture offers, whichever paper it comes from: render, weigh, write down, make again.

It is written down by its fields, arrays apart from what JSON knows.
"""

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

USUAL_MM_S, USUAL_N = 100.0, 1.0
"""Speed and force of a usual stroke, for textures that depend on neither."""


@runtime_checkable
class Renderer(Protocol):
    """A texture being felt: it keeps its state between calls, so that pieces join without a click.

    Attributes
    ----------
    fs : float
        Rate of the samples it takes and returns, Hz.
    """

    fs: float

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples of a path.

        Parameters
        ----------
        velocity : array_like of shape (n, 2)
            Tangential, mm/s.
        force : array_like of shape (n,)
            Normal force, N; 0 or less: no contact.
        position : array_like of shape (n, 2), optional
            mm; by default the velocity is summed up. Textures without features in space do not use it.

        Returns
        -------
        ndarray of shape (n,)
            In the unit of the recorded acceleration; however a path is cut into calls, the same samples.
        """

    def reset(self) -> None:
        """Return to rest, with the random numbers of the first sample."""


class Stored:
    """What files can hold: a dataclass, of which what its fields hold is what is written.

    Fields may be numbers, texts, arrays, dataclasses, tuples and mappings of these; what is not an argument
    of the constructor is left out. A stored object is made by its own types and its own `__post_init__`, so
    that a file can hold nothing that a program could not make.

    Attributes
    ----------
    family : str
        Which kind; the name under which files know it.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Hum(Stored):
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
        """Return what is not an array, as JSON knows it; None where an array belongs."""
        return {name: _apart(value, name, {}) for name, value in _arguments(self).items()}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays; "mesh.speed" is that of the field `mesh`, "models.0.k" that of its first."""
        found: dict[str, NDArray[Any]] = {}
        for name, value in _arguments(self).items():
            _apart(value, name, found)
        return found

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Return the object of what `parameters` and `arrays` returned.

        Raises
        ------
        ValueError
            If something is missing, superfluous, of the wrong kind or shape, or breaks a rule of the object.
        """
        left = dict(arrays)
        tree = {name: _together(value, name, left) for name, value in parameters.items()}
        if left:
            raise ValueError(f"{cls.family}: array {min(left)!r:.80} has no place. Expected one for each")
        try:
            found = TypeAdapter(cls).validate_python(tree)
        except ValidationError as error:
            first = error.errors()[0]
            place, value = ".".join(map(str, first["loc"])), first["input"]
            if first["type"] == "value_error":
                told = ": ".join(filter(None, [place, str(first["ctx"]["error"])]))
                raise ValueError(f"{cls.family}: {told}") from None
            rule = {
                "unexpected_keyword_argument": "no such key", "missing_argument": "that each key is given"
            }.get(first["type"], first["msg"].removeprefix("Input should be "))  # fmt: skip
            raise ValueError(f"{cls.family}: {place} is {value!r:.80}. Expected {rule}") from None
        if _in_words(found.parameters()) != _in_words(parameters):
            rule = "each key once, numbers as numbers: no text or true for one"
            raise ValueError(f"{cls.family}: would not be written so. Expected {rule}")
        return found


class Texture(Stored, ABC):
    """A surface that can be rendered at any speed and force.

    Attributes
    ----------
    name : str
        Of the surface.
    fs : float
        Sampling rate of the vibration, Hz.
    speeds, forces : ndarray
        Rising speeds (mm/s) and forces (N), above 0, at which the surface is known: the first and the last
        are the ends of its range. One value where the texture depends on no other.
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
        """Multiplications and additions per rendered sample, in the mean."""

    @abstractmethod
    def renderer(self, *, seed: int = 0) -> Renderer:
        """Return a renderer at rest at the texture's rate; the seed is that of its noise, if it has any."""

    def autoregressions(self, speed: Samples, force: Samples) -> Autoregression:
        """Return the AR models of strokes along +x at speeds (n,), mm/s, and forces (n,), N.

        Raises
        ------
        ValueError
            If the texture holds no AR models.
        """
        raise ValueError(
            f"texture {self.name!r} must hold AR models, got the family {self.family!r}; "
            ".hjif, .ahap and .wav take every texture"
        )


def constant_stroke(
    texture: Any,
    speed: float,
    force: float,
    n: int,
    *,
    settled: int = 0,
    direction: ArrayLike = (1.0, 0.0),
    seed: int = 0,
) -> Samples:
    """Return the vibration (n,) of what has a renderer, stroked at one speed (mm/s) and force (N).

    What it plays in the first `settled` samples is thrown away; `direction` is a unit vector.
    """
    velocity = np.tile(speed * np.asarray(direction), (settled + n, 1))
    return np.asarray(texture.renderer(seed=seed).process(velocity, np.full(settled + n, force))[settled:])


def _arguments(value: Any) -> dict[str, Any]:
    return {each.name: getattr(value, each.name) for each in fields(value) if each.init}


def _apart(value: Any, place: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """Return a value as JSON knows it, its arrays put among `arrays` under where they stand."""
    if isinstance(value, np.ndarray):
        arrays[place] = value
        return None
    if is_dataclass(value) or isinstance(value, Mapping):
        inner = value if isinstance(value, Mapping) else _arguments(value)
        return {name: _apart(each, f"{place}.{name}", arrays) for name, each in inner.items()}
    if isinstance(value, tuple | list):
        return [_apart(each, f"{place}.{i}", arrays) for i, each in enumerate(value)]
    return value.item() if isinstance(value, np.generic) else value


def _together(value: Any, place: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """Return a value with its arrays where they belong, taken out of `arrays`."""
    if value is None:
        return arrays.pop(place, None)
    if isinstance(value, Mapping):
        return {name: _together(each, f"{place}.{name}", arrays) for name, each in value.items()}
    if isinstance(value, list):
        return [_together(each, f"{place}.{i}", arrays) for i, each in enumerate(value)]
    return value


def _in_words(parameters: Mapping[str, Any]) -> str:
    """Return parameters as JSON of sorted keys, whole numbers as others."""
    return json.dumps(json.loads(json.dumps(parameters), parse_int=float), sort_keys=True)


def freeze(owner: object, **shapes: tuple[int | str, ...]) -> None:
    """Make fields of a frozen dataclass read-only arrays of float64.

    Parameters
    ----------
    owner : dataclass
    **shapes : tuple of int or str
        Of each field; a length that has a name is the same wherever the name stands.

    Raises
    ------
    ValueError
        If a shape does not fit, or a value is NaN or infinite.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> path = SimpleNamespace(force=[1, 2], velocity=np.ones((3, 2)))
    >>> freeze(path, force=("n",), velocity=("n", 2))
    Traceback (most recent call last):
    ValueError: velocity has shape (3, 2). Expected (2, 2), finite
    """
    lengths: dict[int | str, int] = {}
    for name, shape in shapes.items():
        array = np.array(getattr(owner, name), dtype=np.float64, order="C")
        fits = array.ndim == len(shape) and all(
            size == (lengths.setdefault(length, size) if isinstance(length, str) else length)
            for size, length in zip(array.shape, shape, strict=True)
        )
        if not fits or not np.isfinite(array).all():
            rule = ", ".join(str(lengths.get(length, length)) for length in shape)
            raise ValueError(f"{name} has shape {array.shape}. Expected ({rule}), finite")
        array.setflags(write=False)
        object.__setattr__(owner, name, array)
