"""A texture on a grid of reflection coefficients: what a loop of one sample per call can afford at any order.

A mean of numbers below 1 in size is below 1 in size: between stable models multilinear interpolation of k is
stable. The axes go with the square root of speed and force, finer where spectra change faster.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.recording import Samples
from texclass.textures.abdulali2016 import _checks
from texclass.textures.abdulali2016 import _kernels as kernels
from texclass.textures.abdulali2016.frame import LIMIT, Frame
from texclass.textures.abdulali2016.preprocessing import MOTION_HZ
from texclass.textures.abdulali2016.rendering import Model, Noise
from texclass.textures.path import checked_path
from texclass.textures.stored import check_all_names, numbers

ANISOTROPIC, ISOTROPIC = (17, 17, 8), (24, 10)
"""Nodes over v_x, v_y, f_n, and over |v|, f_n."""
ROWS = 64
"""Models computed at a time while baking."""


@dataclass(frozen=True, eq=False)
class BakedTexture:
    """Reflection coefficients and level on a regular grid; from `bake`.

    Parameters
    ----------
    name : str
        Of the surface.
    fs : float
        Hz.
    frame : Frame
        Range and bounds.
    grid : ndarray of shape (n_vx, n_vy, n_f, p + 1), or (n_v, n_f, p + 1)
        k_1 ... k_p, each below 1 in size, and the level.

    Raises
    ------
    ValueError
        If something breaks a rule.
    """

    family: ClassVar[str] = "abdulali2016-baked"
    name: str
    fs: float
    frame: Frame
    grid: Samples

    def __post_init__(self) -> None:
        _checks.check_common(self)
        grid = np.array(self.grid, dtype=np.float64, order="C")
        if grid.ndim != self.frame.n_inputs + 1 or min(grid.shape) < 2 or not np.isfinite(grid).all():
            raise ValueError(
                f"grid has shape {grid.shape}; the rule is {self.frame.n_inputs} axes of 2 nodes or more, "
                "and p + 1 finite numbers"
            )
        if np.abs(grid[..., :-1]).max() >= 1 or grid[..., -1].min() < 0:
            raise ValueError(
                "grid holds a |k| of 1 or more or a level below 0; the rule is |k| < 1, level >= 0"
            )
        grid.setflags(write=False)
        object.__setattr__(self, "grid", grid)

    @property
    def order(self) -> int:
        """Order p of the AR models."""
        return int(self.grid.shape[-1]) - 1

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample: 2^d corners, sqrt(1 - k^2), and the lattice."""
        return float(2 ** (self.frame.n_inputs + 1) * (self.order + 1) + 10 * self.order)

    def renderer(self, *, seed: int = 0) -> "GridRenderer":
        """Return a renderer at rest."""
        return GridRenderer(self, seed=seed)

    def parameters(self) -> Mapping[str, Any]:
        """Return what is not an array, as JSON knows it."""
        return {"name": self.name, "fs": self.fs, "frame": self.frame.parameters()}

    def arrays(self) -> Mapping[str, NDArray[np.float64]]:
        """Return the grid."""
        return {"grid": self.grid}

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the texture of what `parameters` and `arrays` returned; ValueError if it is none."""
        check_all_names(cls.family, parameters, arrays, ({"name", "fs", "frame"}, {"grid"}))
        frame = Frame.restore(parameters["frame"])
        return cls(parameters["name"], parameters["fs"], frame, numbers(arrays, "grid"))


def bake(texture: Model, name: str, nodes: tuple[int, ...] | None = None) -> BakedTexture:
    """Read a texture at the nodes of a grid.

    Parameters
    ----------
    texture : NetworkTexture or DelaunayTexture
    name : str
        Of the surface.
    nodes : tuple of int, optional
        Along v_x, v_y, f_n, or |v|, f_n; `ANISOTROPIC` or `ISOTROPIC` by default.

    Raises
    ------
    ValueError
        If the number of axes is wrong, or one has fewer than 2 nodes.
    """
    frame = texture.frame
    size = nodes or (ISOTROPIC if frame.isotropic else ANISOTROPIC)
    if len(size) != frame.n_inputs or min(size) < 2:
        raise ValueError(f"nodes are {size}; the rule is {frame.n_inputs} numbers of at least 2")
    velocity, force = _nodes(frame, size)
    grid = np.empty((len(force), texture.order + 1))
    for start in range(0, len(force), ROWS):
        rows = slice(start, start + ROWS)
        grid[rows, :-1], grid[rows, -1] = texture.models(velocity[rows], force[rows])
    return BakedTexture(name, texture.fs, frame, grid.reshape(*size, -1))


def _nodes(frame: Frame, size: tuple[int, ...]) -> tuple[Samples, Samples]:
    """Return velocities (n, 2) and forces (n,) of the nodes, in the order of the grid."""
    force = frame.hardest * np.linspace(0, 1, size[-1]) ** 2
    if frame.isotropic:
        v, f = np.meshgrid(frame.fastest * np.linspace(0, 1, size[0]) ** 2, force, indexing="ij")
        return np.column_stack([v.ravel(), np.zeros(v.size)]), f.ravel()
    along = [np.linspace(-1, 1, n) for n in size[:2]]
    x, y = (frame.fastest * np.sign(a) * a**2 for a in along)
    each = [axis.ravel() for axis in np.meshgrid(x, y, force, indexing="ij")]
    return np.column_stack(each[:2]), each[2]


class GridRenderer:
    """Plays a `BakedTexture` along a path; see `Renderer`.

    The motion is followed with 25 Hz (first order), so that a jump of speed or force cannot click, and
    the grid is read at every sample.
    """

    def __init__(self, texture: BakedTexture, *, seed: int = 0) -> None:
        self.fs, self._seed, frame = texture.fs, seed, texture.frame
        self._share = 1 - float(np.exp(-2 * np.pi * MOTION_HZ / texture.fs))
        self._size = np.array(texture.grid.shape[:-1], dtype=np.int64)
        self._grid = texture.grid.reshape(-1, texture.order + 1)
        bounds = frame.fastest, frame.hardest, frame.slow, frame.light
        self._bounds = np.array([*np.maximum(bounds, 1e-12), frame.loudest, LIMIT * frame.peak])
        self._motion, self._b, self._k = np.zeros(3), np.zeros(texture.order + 1), np.zeros(texture.order + 1)
        self.reset()

    def reset(self) -> None:
        """Return to rest, with the random numbers of the first sample."""
        self._motion[:] = 0.0
        self._noise = Noise(self._seed)
        self._b[:] = self._noise.rng.standard_normal(self._b.size)

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples of a path; the position is not used."""
        v, f = checked_path(velocity, force)
        out, start = np.empty(f.size), 0
        while start < f.size:
            n, noise = self._noise.next(f.size - start)
            stop = start + n
            kernels.render_grid(
                v[start:stop], f[start:stop], noise, self._share, self._grid, self._size, self._bounds,
                self._motion, self._b, self._k, out[start:stop],
            )  # fmt: skip
            start = stop
        return out
