"""What texture files may hold: a fixed list of families, each imported when it is first asked for."""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray


class Stored(Protocol):
    """What can be written down: every `Texture`, and the tap library of `okamura2001`."""

    family: ClassVar[str]

    def parameters(self) -> Mapping[str, Any]:
        """Return what is not an array, as JSON knows it."""

    def arrays(self) -> Mapping[str, NDArray[np.float64]]:
        """Return the arrays by name."""

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return what was written down, or raise a ValueError."""


def family_class(family: str) -> type[Stored]:
    """Return the class of a family.

    Raises
    ------
    ValueError
        If no family has that name, or this installation lacks it.
    """
    if family not in FAMILIES:
        raise ValueError(f"family is {family!r:.80}; the rule is one of {sorted(FAMILIES)}")
    try:
        found: type[Stored] = FAMILIES[family]()
    except ImportError as error:
        raise ValueError(
            f"family {family!r} is not installed ({error}); the rule is a whole texclass"
        ) from error
    return found


def _guruswamy2011() -> Any:
    from texclass.textures.guruswamy2011 import SpatialTexture

    return SpatialTexture


def _guruswamy2011_sinusoid() -> Any:
    from texclass.textures.guruswamy2011 import SinusoidTexture

    return SinusoidTexture


def _abdulali2016() -> Any:
    from texclass.textures.abdulali2016 import NetworkTexture

    return NetworkTexture


def _abdulali2016_baked() -> Any:
    from texclass.textures.abdulali2016 import BakedTexture

    return BakedTexture


def _abdulali2016_delaunay() -> Any:
    from texclass.textures.abdulali2016 import DelaunayTexture

    return DelaunayTexture


def _oeztuerk2018_lpc() -> Any:
    from texclass.textures.oeztuerk2018 import LpcTexture

    return LpcTexture


def _oeztuerk2018_frequencies() -> Any:
    from texclass.textures.oeztuerk2018 import FrequencyTexture

    return FrequencyTexture


def _okamura2001() -> Any:
    from texclass.textures.okamura2001 import TapLibrary

    return TapLibrary


def _hatt() -> Any:
    from texclass.textures.hatt import HattTexture

    return HattTexture


def _scene() -> Any:
    from texclass.scene.planned import PlannedScene

    return PlannedScene


FAMILIES: dict[str, Callable[[], Any]] = {
    "abdulali2016": _abdulali2016,
    "abdulali2016-baked": _abdulali2016_baked,
    "abdulali2016-delaunay": _abdulali2016_delaunay,
    "guruswamy2011": _guruswamy2011,
    "guruswamy2011-sinusoid": _guruswamy2011_sinusoid,
    "hatt": _hatt,
    "oeztuerk2018-frequencies": _oeztuerk2018_frequencies,
    "oeztuerk2018-lpc": _oeztuerk2018_lpc,
    "okamura2001": _okamura2001,
    "scene": _scene,
}
"""How the class of each family is had."""
