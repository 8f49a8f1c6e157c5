"""Textures that are one model at the nodes of a grid of speeds and forces, as fitted to a recording."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from texclass.haptics.textures.contract import Texture
from texclass.haptics.textures.grid import GridModel
from texclass.haptics.textures.motion_renderer import MotionRenderer
from texclass.recording import Samples
from texclass.signals import positive
from texclass.vibration.autoregressive import Autoregression
from texclass.vibration.reflection import log_cosines

REST_MM_S, LIGHT_N = 5.0, 0.05
"""Speed and force below which samples of scans are ignored and renderers fade to silence."""
PEAK_FACTOR = 6.0
"""Limit of rendered samples, as a multiple of the largest level (RMS)."""


@dataclass(frozen=True, eq=False)
class GridTexture(Texture):
    """A model over speed and force, with interpolation between the nodes of its grid.

    Pages, planned scenes and C headers render the same model without an approximation.

    Parameters
    ----------
    name : str
        Name of the surface.
    fs : float
        Sampling rate in Hz.
    grid : GridModel
        Model with the axes speed (mm/s) and force (N), scale "log" and a lattice. The outermost nodes are the
        range of the texture.

    Raises
    ------
    ValueError
        If the grid has other axes, another scale or no lattice.

    Examples
    --------
    >>> grid = GridModel(([40.0, 160.0], [0.5, 2.0]), np.full((2, 2, 1), 0.5), np.ones((2, 2)), 8.0)
    >>> texture = GridTexture("oak", 1000.0, grid)
    >>> texture.order, texture.speeds.tolist()
    (1, [40.0, 160.0])
    """

    family: ClassVar[str] = "grid"
    name: str
    fs: float
    grid: GridModel

    def __post_init__(self) -> None:
        positive(self.fs, "fs")
        if (len(self.grid.axes), self.grid.scale) != (2, "log") or not self.grid.order:
            raise ValueError(
                "grid must have the axes speed and force, scale 'log' and a lattice, got "
                f"{len(self.grid.axes)} axes, scale {self.grid.scale!r} and order {self.grid.order}"
            )

    @property
    def speeds(self) -> Samples:
        """Speeds of the nodes in mm/s."""
        return self.grid.speeds

    @property
    def forces(self) -> Samples:
        """Forces of the nodes in N."""
        return self.grid.forces

    @property
    def order(self) -> int:
        """Order of the AR models."""
        return self.grid.order

    @property
    def operations(self) -> float:
        """Multiplications and additions per rendered sample."""
        return self.grid.operations(self.fs)

    def autoregressions(self, speed: Samples, force: Samples) -> Autoregression:
        """Return the AR models at speeds (n,) in mm/s and forces (n,) in N.

        Raises
        ------
        ValueError
            If the model has spectral lines, which an AR model does not contain.
        """
        if self.grid.n_lines:
            return super().autoregressions(speed, force)
        k, power = self.grid.at(speed, force)
        return Autoregression(k, np.sqrt(power) * np.exp(log_cosines(k).sum(axis=-1)))

    def renderer(self, *, seed: int = 0) -> MotionRenderer:
        """Return a renderer whose motion starts at rest; `seed` is the seed of the noise."""
        return grid_renderer(self.grid, self.fs, seed=seed)


def grid_renderer(model: GridModel, fs: float, *, seed: int = 0) -> MotionRenderer:
    """Return a renderer of a model over speed and force; it fades to silence at low speed or force."""
    slow, light = (axis[0] for axis in model.axes)

    def parameter_map(motion: Samples) -> tuple[Samples, Samples]:
        speed, force = np.hypot(motion[:, 0], motion[:, 1]), motion[:, 2]
        rows, power = model.at(np.maximum(speed, slow), np.maximum(force, light))
        k, a = rows[:, : model.order], rows[:, model.order :]
        fade = np.clip(speed / min(slow, REST_MM_S), 0.0, 1.0)
        fade *= np.clip(force / min(light, LIGHT_N), 0.0, 1.0)
        hz = model.frequency_hz + np.multiply.outer(speed, model.per_mm)
        noise = np.sqrt(np.maximum(1 - (a**2).sum(axis=1) / 2, 0.0))
        level = (fade * np.sqrt(power))[:, np.newaxis]
        stages = np.hstack([k, np.minimum(2 * np.pi * hz / fs, np.pi)])
        return stages, level * np.column_stack([noise, a])

    return MotionRenderer(
        parameter_map,
        fs=fs,
        order=model.order,
        phase=2.4
        * np.arange(model.n_lines),  # the golden angle, so that the lines do not add up at the start
        hop=max(1, round(fs / 1000)),
        limit=PEAK_FACTOR * float(np.sqrt(model.power.max())),
        seed=seed,
        motion_hz=30.0,
        n_stationary=model.order + 1,
    )
