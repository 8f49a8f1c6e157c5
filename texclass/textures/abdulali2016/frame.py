"""What a texture's map stands in: how an input is normalised, how far it reaches, how loud it may get."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.textures.abdulali2016.points import ModelPoints, Normalisation
from texclass.vibration.line_spectrum import MIN_GAP

LIMIT = 2.0
"""No rendered sample exceeds this many times the recorded peak."""
SHARP = 0.25
"""Part of the segments whose sharpest resonance counts as chance: 75 samples are easily overfitted."""
HUSH = 0.1
"""Below this part of the slowest and lightest segment the vibration fades out, whatever the map says."""


@dataclass(frozen=True)
class Frame:
    """Range of a texture; plain numbers.

    Parameters
    ----------
    isotropic : bool
        Whether the inputs are (|v|, f_n) rather than (v_x, v_y, f_n).
    mean, deviation : tuple of float
        Of each input over the recording: what normalises it (mm/s, N).
    fastest, hardest : float
        Largest speed (mm/s) and force (N) of a segment: more is felt as this.
    slow, light : float
        Speed and force below which the level is capped proportionally, so that it ends at 0.
    loudest : float
        Largest RMS of a segment: the level of the vibration does not exceed it.
    peak : float
        Largest recorded sample.
    gap : float
        Least distance of line spectral frequencies, rad: no rendered resonance is sharper than those of the
        segments, but for a quarter of these.

    Raises
    ------
    ValueError
        If a number is not finite, negative, or there are not 2 inputs (isotropic) or 3.
    """

    isotropic: bool
    mean: tuple[float, ...]
    deviation: tuple[float, ...]
    fastest: float
    hardest: float
    slow: float
    light: float
    loudest: float
    peak: float
    gap: float = MIN_GAP

    def __post_init__(self) -> None:
        n = 2 if self.isotropic else 3
        if not (isinstance(self.isotropic, bool) and len(self.mean) == len(self.deviation) == n):
            raise ValueError(
                f"frame has {len(self.mean)} inputs, isotropic {self.isotropic}; the rule is {n}"
            )
        numbers = [self.fastest, self.hardest, self.slow, self.light, self.loudest, self.peak, self.gap]
        if not np.all(np.isfinite([*numbers, *self.mean])) or min(numbers) < 0:
            raise ValueError(f"frame holds {numbers}; the rule is finite, at least 0")
        if not (np.all(np.isfinite(self.deviation)) and min(self.deviation) > 0):
            raise ValueError(f"frame has deviations {self.deviation}; the rule is finite, above 0")

    @classmethod
    def around(
        cls,
        points: ModelPoints,
        normalisation: Normalisation,
        *,
        isotropic: bool,
        loudest: float,
        peak: float,
    ) -> Self:
        """Return the frame of model points (without the silent ones); see the parameters of the class."""
        u = points.u * normalisation.deviation + normalisation.mean
        speed = u[:, 0] if isotropic else np.hypot(u[:, 0], u[:, 1])
        narrowest = np.diff(points.lsf, axis=1, prepend=0.0, append=np.pi).min(axis=1)
        return cls(
            isotropic,
            tuple(map(float, normalisation.mean)),
            tuple(map(float, normalisation.deviation)),
            float(speed.max()),
            float(u[:, -1].max()),
            HUSH * float(speed.min()),
            HUSH * float(u[:, -1].min()),
            loudest,
            peak,
            float(min(np.quantile(narrowest, SHARP), 0.9 * np.pi / (points.lsf.shape[1] + 1))),
        )

    @property
    def n_inputs(self) -> int:
        """3, or 2 if isotropic."""
        return len(self.mean)

    def inputs(self, velocity: ArrayLike, force: ArrayLike) -> Samples:
        """Return the normalised inputs (n, n_inputs) of velocities (n, 2) and forces (n,), kept in range."""
        v = np.asarray(velocity, dtype=np.float64)
        speed = np.hypot(*v.T)
        reach, f = self.motion(v, force)
        if self.isotropic:
            columns = [reach]
        else:
            columns = list((v * (reach / np.where(speed > 0, speed, 1.0))[:, np.newaxis]).T)
        u = np.column_stack([*columns, f])
        return np.asarray((u - self.mean) / self.deviation)

    def motion(self, velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples]:
        """Return speed (n,) and force (n,), kept in range."""
        speed = np.hypot(*np.asarray(velocity, dtype=np.float64).T)
        return np.minimum(speed, self.fastest), np.clip(
            np.asarray(force, dtype=np.float64), 0.0, self.hardest
        )

    def cap(self, velocity: ArrayLike, force: ArrayLike) -> Samples:
        """Return the largest level (n,) allowed: `loudest`, fading to 0 at rest and without contact."""
        speed, f = np.hypot(*np.asarray(velocity, dtype=np.float64).T), np.asarray(force, dtype=np.float64)
        slow, light = max(self.slow, 1e-12), max(self.light, 1e-12)
        fade = np.clip(speed / slow, 0.0, 1.0) * np.clip(f / light, 0.0, 1.0)
        return np.asarray(self.loudest * fade)

    def parameters(self) -> dict[str, Any]:
        """Return the frame as JSON knows it."""
        return asdict(self) | {"mean": list(self.mean), "deviation": list(self.deviation)}

    @classmethod
    def restore(cls, values: Mapping[str, Any]) -> Self:
        """Return the frame of what `parameters` returned, or a ValueError."""
        if not isinstance(values, Mapping) or set(values) != {f.name for f in fields(cls)}:
            raise ValueError(
                f"frame is {values!r:.80}; the rule is the fields {[f.name for f in fields(cls)]}"
            )
        numbers: dict[str, Any] = {}
        for name, value in values.items():
            try:
                if name == "isotropic":
                    numbers[name] = value
                elif name in ("mean", "deviation"):
                    numbers[name] = tuple(float(x) for x in value)
                else:
                    numbers[name] = float(value)
            except (TypeError, ValueError) as error:
                raise ValueError(f"frame: {name} is {value!r:.80}; the rule is numbers") from error
        return cls(**numbers)
