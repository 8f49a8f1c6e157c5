"""The library: one tap model per material, written down and read again."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.textures.contract import StoredFields
from texclass.textures.okamura2001.alignment import AlignedTaps, fit_aligned
from texclass.vibration import TapModel


@dataclass(frozen=True)
class TapLibrary(StoredFields, Mapping[str, TapModel]):
    """Tap models by material: a(t) = A v exp(-B t) sin(w t) at impact velocity v.

    It is written and read like a `Texture`, but is none: a tap is not a stroke, it has a velocity once and
    then runs by itself. A `VirtualWall` makes one of its materials felt.

    Parameters
    ----------
    materials : sequence of str
        Different names.
    models : sequence of TapModel
        One for each.
    unit : str
        Of the accelerations per velocity times m/s; "m/s^2" unless the sensor's scale is unknown.

    Raises
    ------
    ValueError
        If there is no material, names repeat, or there is not one model for each.
    """

    family: ClassVar[str] = "okamura2001"
    materials: tuple[str, ...]
    models: tuple[TapModel, ...]
    unit: str = "m/s^2"

    def __post_init__(self) -> None:
        object.__setattr__(self, "materials", tuple(self.materials))
        object.__setattr__(self, "models", tuple(self.models))
        n = len(self.materials)
        if not n or len(set(self.materials)) != n or len(self.models) != n:
            raise ValueError(
                f"{len(self.models)} models for materials {self.materials}; the rule is one for each name, "
                "names that differ, one at least"
            )

    def __getitem__(self, material: str) -> TapModel:
        return dict(zip(self.materials, self.models, strict=True))[material]

    def __iter__(self) -> Iterator[str]:
        return iter(self.materials)

    def __len__(self) -> int:
        return len(self.materials)

    @property
    def table(self) -> Samples:
        """A (1/s), B (1/s) and w (Hz) of each material, shape (n_materials, 3)."""
        return np.array([(m.amplitude_slope, m.decay_per_s, m.frequency_hz) for m in self.models])


def fit_library(
    taps: Mapping[str, Sequence[ArrayLike]],
    velocity: Mapping[str, ArrayLike],
    fs: float,
    *,
    unit: str = "m/s^2",
) -> tuple[TapLibrary, dict[str, AlignedTaps]]:
    """Fit one tap model per material, and return what was found beside it.

    Parameters
    ----------
    taps : mapping of str to sequence of array_like, each of shape (n_samples,)
        Taps of each material at several velocities; they need not begin with the impact.
    velocity : mapping of str to array_like of shape (n_taps,)
        Impact velocities, m/s.
    fs : float
        Sampling rate, Hz.
    unit : str
        Of the accelerations.

    Raises
    ------
    ValueError
        If the materials differ between the two mappings, or as `fit_aligned`.
    """
    if set(taps) != set(velocity):
        raise ValueError(f"materials are {sorted(taps)} and {sorted(velocity)}; the rule is the same ones")
    found = {material: fit_aligned(taps[material], velocity[material], fs) for material in taps}
    return TapLibrary(tuple(found), tuple(one.model for one in found.values()), unit), found


def tap_peak(model: TapModel) -> Samples:
    """Return max_t exp(-B t) sin(w t): at t = arctan(w / B) / w, sin is w / sqrt(w^2 + B^2)."""
    w, B = 2 * np.pi * model.frequency_hz, model.decay_per_s
    return np.asarray(np.exp(-B * np.arctan2(w, B) / w) * w / np.hypot(w, B))
