"""What every texture offers, whichever paper it comes from: render it, weigh it, write it down."""

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol, Self, runtime_checkable

from numpy.typing import ArrayLike, NDArray

from texclass.recording import Samples


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


@runtime_checkable
class Stored(Protocol):
    """What files can hold: textures, tap libraries, planned scenes. `storage.StoredFields` gives the methods.

    Attributes
    ----------
    family : str
        Which kind; the name under which files know it.
    """

    family: ClassVar[str]

    def parameters(self) -> Mapping[str, Any]:
        """Return what is not an array, as JSON knows it."""

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Return the arrays by name."""

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Return the object of what `parameters` and `arrays` returned.

        Raises
        ------
        ValueError
            If something is missing, superfluous, of the wrong kind or shape, or breaks a rule of the object.
        """


@runtime_checkable
class Texture(Stored, Protocol):
    """A surface that can be rendered at any speed and force."""

    @property
    def name(self) -> str:
        """Of the surface."""

    @property
    def fs(self) -> float:
        """Sampling rate of the vibration, Hz."""

    @property
    def operations(self) -> float:
        """Multiplications and additions per rendered sample, in the mean."""

    def renderer(self, *, seed: int = 0) -> Renderer:
        """Return a renderer at rest at the texture's rate; the seed is that of its noise, if it has any."""
