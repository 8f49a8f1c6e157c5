"""A surface as decaying responses at places along a line: features fixed in space, decay fixed in time."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples
from texclass.textures.guruswamy2011.level import Amplitude, LevelLaw
from texclass.textures.guruswamy2011.renderer import SILENT, SpatialRenderer
from texclass.textures.stored import check_all_names, check_names, is_number

Course = Literal["line", "travelled"]
_RANGES = (("fs", 1e-3, 1e9), ("length_mm", 1e-6, 1e9), ("origin_mm", -1e9, 1e9), ("peak", 1e-100, 1e100))
"""Beyond, places could no longer be told apart or squares overflow; a file may hold anything."""
MOST = 1e9
"""Largest amplitude of a mode, in peaks: modes of one feature may cancel."""
_MODES = ("frequency_hz", "decay_per_s", "amplitude", "phase")
_SCALARS = {
    "name": str, "fs": float, "length_mm": float, "peak": float, "course": str, "origin_mm": float,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class SpatialTexture:
    """Features along a line, each of which makes the tool ring in its modes when the tip passes it.

    F(t) = sum_k A_k h_k(t - t_k): t_k is when the tip passes x_k, and A_k follows speed and force at that
    moment (`Amplitude`). What rings goes on as it began, whatever speed and force do afterwards.

    Parameters
    ----------
    name : str
        Of the surface.
    fs : float
        Rate at which it was scanned and is rendered, Hz: between samples a fit says nothing. For another rate
        the scan is resampled first.
    length_mm : float
        Of the scanned line, which is repeated.
    position_mm : array_like of shape (n_features,)
        x_k, rising, in [0, length_mm); at least 1.
    feature : array_like of shape (n_modes,)
        Index of the feature that each mode belongs to, rising.
    frequency_hz, decay_per_s, amplitude, phase : array_like of shape (n_modes,)
        h_k(t) = sum A exp(-B t) cos(2 pi f t + phi) over its modes, as in `DecayingModes`.
    scaling : Amplitude
        Law of level, and the speed and force at which the amplitudes hold.
    peak : float
        Largest magnitude of the scanned profile, in the unit of the amplitudes.
    direction : array_like of shape (2,)
        Unit vector of the line on the surface.
    course : {"line", "travelled"}
        What the tip's coordinate is. "line": its position along `direction`. A return stroke meets the same
        features in reverse order, a stroke across none: grooves. "travelled": the length of its path, so that
        strokes of all directions feel alike and a return stroke meets further features: grains.
    origin_mm : float
        Where x = 0 lies: position along `direction`. Without effect for "travelled".

    Raises
    ------
    ValueError
        If a shape or value breaks its rule.

    Notes
    -----
    Passed in reverse, a feature rings as it did forwards: the ring is the tool's own, begins when the feature
    is met, and never runs backwards in time; of the other flank a scan in one direction knows nothing.

    References
    ----------
    `guruswamy2011`, section III, eq. (5).
    """

    family: ClassVar[str] = "guruswamy2011"
    name: str
    fs: float
    length_mm: float
    position_mm: Samples
    feature: Samples
    frequency_hz: Samples
    decay_per_s: Samples
    amplitude: Samples
    phase: Samples
    scaling: Amplitude
    peak: float
    direction: Samples
    course: Course = "line"
    origin_mm: float = 0.0

    def __post_init__(self) -> None:
        for name in ("position_mm", "feature", *_MODES, "direction"):
            values = np.array(getattr(self, name), dtype=np.float64, ndmin=1)
            if values.ndim != 1 or not np.all(np.isfinite(values)):
                raise ValueError(
                    f"texture {self.name!r}: {name} of shape {values.shape}; the rule is finite, (n,)"
                )
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        self._check_line()
        self._check_modes()

    def _check_line(self) -> None:
        for name, least, most in _RANGES:
            if not least <= getattr(self, name) <= most:
                self._refuse(f"{name} is {getattr(self, name)}", f"{least:g} to {most:g}")
        if self.course not in get_args(Course):
            self._refuse(f"course is {self.course!r}", f"one of {get_args(Course)}")
        x = self.position_mm
        if not x.size or np.any(np.diff(x) < 0) or x[0] < 0 or x[-1] >= self.length_mm:
            self._refuse(f"positions are {x} mm", f"at least 1, rising, in [0, {self.length_mm:g})")
        if self.direction.shape != (2,) or abs(np.hypot(*self.direction) - 1) > 1e-6:
            self._refuse(f"direction is {self.direction}", "a unit vector of shape (2,)")

    def _check_modes(self) -> None:
        owner = self.feature
        if any(getattr(self, name).shape != owner.shape for name in _MODES):
            self._refuse(f"modes of {owner.size} features", "one frequency, decay, amplitude, phase for each")
        rising = np.all(owner == np.round(owner)) and np.all(np.diff(owner) >= 0)
        if not rising or np.any(owner < 0) or np.any(owner >= self.n_features):
            self._refuse(f"modes belong to {owner}", f"whole numbers, rising, in [0, {self.n_features})")
        beyond = np.any(self.frequency_hz < 0) or np.any(self.frequency_hz > self.fs / 2)
        too_large = np.any(self.amplitude < 0) or np.any(self.amplitude > MOST * self.peak)
        if beyond or np.any(self.decay_per_s <= 0) or too_large:
            self._refuse("a mode breaks", f"0 <= f <= fs/2, B > 0, 0 <= A <= {MOST:g} peaks")

    def _refuse(self, what: str, rule: str) -> None:
        raise ValueError(f"texture {self.name!r}: {what}; the rule is {rule}")

    @property
    def n_features(self) -> int:
        """How many features the line has."""
        return int(self.position_mm.size)

    @property
    def features_per_mm(self) -> float:
        """Density of the features."""
        return self.n_features / self.length_mm

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample at the scan's speed: ten for each mode that rings."""
        with np.errstate(over="ignore"):  # of modes that ring for ever, or drown all others
            loud = np.maximum(self.amplitude / (SILENT * self.peak), 1.0)
            ring_s = float(np.sum(np.log(loud) / self.decay_per_s))
        return 30.0 + 10.0 * ring_s * self.scaling.speed / self.length_mm

    def renderer(self, *, seed: int = 0) -> SpatialRenderer:
        """Return a renderer at rest at the texture's rate; nothing is random, so the seed has no effect."""
        return SpatialRenderer(self)

    def parameters(self) -> Mapping[str, Any]:
        """Return what is not an array, as JSON knows it."""
        return {**{name: getattr(self, name) for name in _SCALARS}, "scaling": asdict(self.scaling)}

    def arrays(self) -> Mapping[str, NDArray[np.float64]]:
        """Return positions, modes and direction, by name."""
        return {name: getattr(self, name) for name in ("position_mm", "feature", *_MODES, "direction")}

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the texture of what `parameters` and `arrays` returned.

        Raises
        ------
        ValueError
            If something is missing, superfluous, of the wrong kind or shape, or breaks a rule of the texture.
        """
        names = {"position_mm", "feature", *_MODES, "direction"}
        check_all_names(cls.family, parameters, arrays, ({*_SCALARS, "scaling"}, names))
        for name, kind in _SCALARS.items():
            _of_kind(name, parameters[name], kind)
        scaling = _restored_scaling(parameters["scaling"])
        given: dict[str, Any] = {name: kind(parameters[name]) for name, kind in _SCALARS.items()}
        given.update({name: arrays[name] for name in names})
        return cls(**given, scaling=scaling)


@dataclass(frozen=True, eq=False)
class SinusoidTexture(SpatialTexture):
    """The baseline: one decaying sinusoid per feature, A exp(-beta t) sin(omega t).

    References
    ----------
    `guruswamy2011`, eq. (3) and (4), after `okamura2001`.
    """

    family: ClassVar[str] = "guruswamy2011-sinusoid"


def _restored_scaling(given: Any) -> Amplitude:
    if not isinstance(given, Mapping) or not isinstance(given.get("law"), Mapping):
        raise ValueError("scaling is no table with a law; the rule is what `parameters` returned")
    check_names("guruswamy2011", "scaling", given, {"law", "speed", "force", "compensated", "limit"})
    check_names("guruswamy2011", "law", given["law"], {"k_v", "k_c", "a_0"})
    for table, names in ((given, ("speed", "force", "limit")), (given["law"], ("k_v", "k_c", "a_0"))):
        for name in names:
            _of_kind(name, table[name], float)
    _of_kind("compensated", given["compensated"], bool)
    law = LevelLaw(*(float(given["law"][name]) for name in ("k_v", "k_c", "a_0")))
    rest = {name: float(given[name]) for name in ("speed", "force", "limit")}
    return Amplitude(law, compensated=given["compensated"], **rest)


def _of_kind(name: str, value: Any, kind: type) -> None:
    if not (is_number(value) if kind is float else isinstance(value, kind)):
        raise ValueError(f"{name} is {value!r}; the rule is a value of type {kind.__name__}")
