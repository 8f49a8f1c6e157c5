"""Surfaces whose vibration is a function of direction, speed and force: a network, a mesh or a grid."""

from abc import abstractmethod
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any, ClassVar, get_args

import numpy as np
from numba import njit
from numpy.typing import ArrayLike
from scipy import interpolate, spatial

from texclass.haptics.textures.abdulali2016.model_points import MOTION_HZ, STEEPEST, Loudness, level_of
from texclass.haptics.textures.contract import Texture, freeze
from texclass.haptics.textures.grid import GridModel
from texclass.haptics.textures.motion_renderer import MotionRenderer
from texclass.recording import Samples
from texclass.signals import positive
from texclass.vibration import line_spectrum
from texclass.vibration.autoregressive import Autoregression
from texclass.vibration.reflection import log_cosines

LIMIT = 2.0
"""No rendered sample exceeds this many times the recorded peak."""
LATTICE_OPERATIONS = 12
"""Per stage and sample: k between two, sqrt(1 - k^2), and the rotation."""
ANISOTROPIC, ISOTROPIC = (17, 17, 8), (24, 10)
"""Nodes of a baked texture over v_x, v_y, f_n, and over |v|, f_n."""


@dataclass(frozen=True)
class Frame:
    """What a texture's map stands in: how an input is normalised, how far it reaches, how loud it may get.

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
    gap: float = line_spectrum.MIN_GAP

    def __post_init__(self) -> None:
        n = 2 if self.isotropic else 3
        if not len(self.mean) == len(self.deviation) == n:
            raise ValueError(f"frame has {len(self.mean)} inputs, isotropic {self.isotropic}. Expected {n}")
        sizes = [self.fastest, self.hardest, self.slow, self.light, self.loudest, self.peak, self.gap]
        finite = np.isfinite([*sizes, *self.mean, *self.deviation]).all()
        if not finite or min(sizes) < 0 or min(self.deviation) <= 0:
            raise ValueError(f"{self}. Expected finite numbers, sizes at least 0, deviations above 0")

    @property
    def n_inputs(self) -> int:
        """3, or 2 if isotropic."""
        return len(self.mean)

    @property
    def speeds(self) -> Samples:
        """Lowest and highest speed, mm/s: at least a tenth of the fastest segment."""
        return np.array([max(self.slow, self.fastest / 10), self.fastest])

    @property
    def forces(self) -> Samples:
        """Lowest and highest force, N: at least a tenth of the hardest segment."""
        return np.array([max(self.light, self.hardest / 10), self.hardest])

    def motion(self, velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples]:
        """Return speed (n,) and force (n,) of velocities (n, 2) and forces (n,), kept in range."""
        speed = np.hypot(*np.asarray(velocity, dtype=np.float64).T)
        hard = np.clip(np.asarray(force, dtype=np.float64), 0.0, self.hardest)
        return np.minimum(speed, self.fastest), hard

    def inputs(self, velocity: ArrayLike, force: ArrayLike) -> Samples:
        """Return the normalised inputs (n, n_inputs) of velocities (n, 2) and forces (n,), kept in range."""
        v = np.asarray(velocity, dtype=np.float64)
        speed = np.hypot(*v.T)
        reach, f = self.motion(v, force)
        kept = v * (reach / np.where(speed > 0, speed, 1.0))[:, np.newaxis]
        along = [reach] if self.isotropic else [*kept.T]
        return np.asarray((np.column_stack([*along, f]) - self.mean) / self.deviation)

    def cap(self, velocity: ArrayLike, force: ArrayLike) -> Samples:
        """Return the largest level (n,) allowed: `loudest`, fading to 0 at rest and without contact."""
        speed, f = np.hypot(*np.asarray(velocity, dtype=np.float64).T), np.asarray(force, dtype=np.float64)
        slow, light = max(self.slow, 1e-12), max(self.light, 1e-12)
        return np.asarray(self.loudest * (np.clip(speed / slow, 0.0, 1.0) * np.clip(f / light, 0.0, 1.0)))


@dataclass(frozen=True, eq=False)
class RadialNetwork:
    """A function of several outputs, given by centres and weights, with phi(r) = r and a linear polynomial.

    f(u) = sum_j w_j |u - q_j| + d_0 + sum_k d_k u_k                              [abdulali2016, eq. (4)]

    Attributes
    ----------
    centres : ndarray of shape (n_centres, n_inputs)
        q, normalised inputs.
    weights : ndarray of shape (n_centres, n_outputs)
        w.
    polynomial : ndarray of shape (n_inputs + 1, n_outputs)
        d: the constant, then one row per input.

    Raises
    ------
    ValueError
        If the shapes do not fit or a value is not finite.
    """

    centres: Samples
    weights: Samples
    polynomial: Samples

    def __post_init__(self) -> None:
        freeze(self, centres=("n", "d"), weights=("n", "m"))
        freeze(self, polynomial=(self.centres.shape[1] + 1, self.weights.shape[1]))

    def at(self, u: ArrayLike) -> Samples:
        """Return f at inputs (n, n_inputs), shape (n, n_outputs); every row by itself, bit for bit."""
        points = np.ascontiguousarray(u, dtype=np.float64)
        out = np.empty((len(points), self.weights.shape[1]))
        _evaluate(points, self.centres, self.weights, self.polynomial, out)
        return out


class FramedTexture(Texture):
    """A texture whose range is that of its frame."""

    frame: Frame

    @property
    def speeds(self) -> Samples:
        """Ends of the range, mm/s."""
        return self.frame.speeds

    @property
    def forces(self) -> Samples:
        """Ends of the range, N."""
        return self.frame.forces


@dataclass(frozen=True, eq=False)
class MapTexture(FramedTexture):
    """A map from velocity and force to line spectrum and loudness -> AR process.

    Parameters
    ----------
    name : str
        Of the surface.
    fs : float
        Hz.
    frame : Frame
        Normalisation, range and bounds.
    loudness : {"level", "variance"}
        What the last output is, see `level_of`: what the law of growth leaves, or a variance.
    growth : tuple of float
        Exponents of speed and of force in the level; for "level" only.
    buffer : int
        Samples between two readings of the map; `abdulali2016`, section 4.2.
    glide : bool
        Whether parameters move between readings (else they jump, as in the paper).

    Raises
    ------
    ValueError
        If something breaks a rule; the message names it.
    """

    name: str
    fs: float
    frame: Frame
    _: KW_ONLY
    loudness: Loudness = "level"
    growth: tuple[float, float] = (0.0, 0.0)
    buffer: int = 16
    glide: bool = True

    def __post_init__(self) -> None:
        positive(self.fs, "fs")
        if self.buffer < 1:
            raise ValueError(f"buffer is {self.buffer!r}. Expected an integer of at least 1")
        if self.loudness not in get_args(Loudness):
            raise ValueError(f"loudness is {self.loudness!r}. Expected one of {get_args(Loudness)}")
        if len(self.growth) != 2 or not all(0 <= power <= STEEPEST for power in self.growth):
            raise ValueError(f"growth is {self.growth}. Expected two numbers, 0 to {STEEPEST}")
        largest = np.pi / (self.order + 1)
        if self.frame.gap > largest:
            raise ValueError(f"gap is {self.frame.gap}. Expected at most pi / (p + 1) = {largest:g}")

    @property
    @abstractmethod
    def order(self) -> int:
        """Order p of the AR models."""

    @abstractmethod
    def outputs_at(self, u: Samples) -> Samples:
        """Return line spectral frequencies and loudness (n, p + 1) at normalised inputs (n, n_inputs)."""

    def models(self, velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples]:
        """Return reflection coefficients (n, p) and levels (n,) at velocities (n, 2) and forces (n,).

        Frequencies out of order or too close are moved by `line_spectrum.spread`; no level
        exceeds the loudest segment's, see `Frame.cap`.
        """
        out = self.outputs_at(self.frame.inputs(velocity, force))
        k = line_spectrum.to_reflection(line_spectrum.spread(out[:, :-1], self.frame.gap))
        level = level_of(self.loudness, out[:, -1], k, self.frame.motion(velocity, force), self.growth)
        return k, np.minimum(level, self.frame.cap(velocity, force))

    def autoregressions(self, speed: Samples, force: Samples) -> Autoregression:
        """Return the AR models of strokes along +x at speeds (n,) and forces (n,)."""
        k, level = self.models(np.column_stack([speed, np.zeros_like(speed)]), force)
        return Autoregression(k, level * np.exp(log_cosines(k).sum(axis=-1)))

    def renderer(self, *, seed: int = 0) -> MotionRenderer:
        """Return a renderer at rest, which follows the motion with the bandwidth it was recorded with."""

        def read(course: Samples) -> tuple[Samples, Samples]:
            k, level = self.models(course[:, :2], course[:, 2])
            return k, level[:, np.newaxis]

        return MotionRenderer(
            read,
            fs=self.fs,
            order=self.order,
            hop=self.buffer,
            limit=LIMIT * self.frame.peak,
            seed=seed,
            motion_hz=MOTION_HZ,
            glide=self.glide,
            n_stationary=self.order + 1,
        )


@dataclass(frozen=True, eq=False)
class NetworkTexture(MapTexture):
    """Texture of `abdulali2016`: the map is a radial basis function network.

    Parameters
    ----------
    name, fs, frame, loudness, growth, buffer, glide
        As for `MapTexture`.
    network : RadialNetwork
        p line spectral frequencies (rad per sample) and the loudness, in this order.
    """

    family: ClassVar[str] = "abdulali2016"
    network: RadialNetwork

    def __post_init__(self) -> None:
        n_inputs, n_outputs = self.network.centres.shape[1], self.network.weights.shape[1]
        if n_inputs != self.frame.n_inputs or n_outputs < 2:
            raise ValueError(
                f"network has {n_inputs} inputs and {n_outputs} outputs. "
                f"Expected {self.frame.n_inputs}, at least 2"
            )
        super().__post_init__()

    @property
    def order(self) -> int:
        """Order p of the AR models."""
        return int(self.network.weights.shape[1]) - 1

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample; the way from LSF to k counts 4 p^2."""
        n, p, d = len(self.network.centres), self.order, self.frame.n_inputs
        reading = n * (3 * d + 1) + 2 * (n + d + 1) * (p + 1) + 4 * p**2
        return LATTICE_OPERATIONS * p + reading / self.buffer

    def outputs_at(self, u: Samples) -> Samples:
        """Return what the network says."""
        return self.network.at(u)


@dataclass(frozen=True, eq=False)
class DelaunayTexture(MapTexture):
    """The comparison: line spectra mixed in the simplex around the input, as the HaTT models do it.

    Outside of the triangulation the nearest point holds.

    Parameters
    ----------
    name, fs, frame, loudness, growth, buffer, glide
        As for `MapTexture`.
    u : ndarray of shape (n_points, n_inputs)
        Normalised inputs of the points, which span the space.
    outputs : ndarray of shape (n_points, p + 1)
        Line spectral frequencies (rad per sample, increasing) and loudness.
    """

    family: ClassVar[str] = "abdulali2016-delaunay"
    u: Samples
    outputs: Samples

    def __post_init__(self) -> None:
        freeze(self, u=("n_points", self.frame.n_inputs), outputs=("n_points", "outputs"))
        if self.order < 1:
            raise ValueError(f"outputs have shape {self.outputs.shape}. Expected p + 1 columns, p at least 1")
        if np.any(np.diff(self.outputs[:, :-1], axis=1) <= 0):
            raise ValueError("outputs are out of order. Expected increasing frequencies")
        try:
            _ = self._maps
        except (spatial.QhullError, ValueError) as error:
            raise ValueError(
                f"{len(self.u)} points do not span the input, so they have no triangulation"
            ) from error
        super().__post_init__()

    @cached_property
    def _maps(self) -> tuple[Any, Any]:
        inside = interpolate.LinearNDInterpolator(spatial.Delaunay(self.u), self.outputs)
        return inside, interpolate.NearestNDInterpolator(self.u, self.outputs)

    @property
    def order(self) -> int:
        """Order p of the AR models."""
        return int(self.outputs.shape[1]) - 1

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample; LSF to k counts 4 p^2, finding the simplex nothing."""
        d, p = self.frame.n_inputs, self.order
        return LATTICE_OPERATIONS * p + (2 * d**2 + 2 * (d + 1) * (p + 1) + 4 * p**2) / self.buffer

    def outputs_at(self, u: Samples) -> Samples:
        """Return sum_i b_i f_i, with b the barycentric coordinates in the simplex of each input."""
        inside, outside = self._maps
        out = np.asarray(inside(u))
        alone = np.isnan(out).any(axis=1)  # outside, or in a simplex without volume
        out[alone] = outside(u[alone])
        return out


@dataclass(frozen=True, eq=False)
class BakedTexture(FramedTexture):
    """A texture read at the nodes of a grid, see `bake`: what a loop of one sample per call can afford.

    The motion is followed with 25 Hz, and the grid is read at every sample.

    Parameters
    ----------
    name : str
        Of the surface.
    fs : float
        Hz.
    frame : Frame
        Range and bounds.
    grid : GridModel
        Over v_x, v_y, f_n, or |v|, f_n, with the scale "root": finer where spectra change faster.

    Raises
    ------
    ValueError
        If something breaks a rule.
    """

    family: ClassVar[str] = "abdulali2016-baked"
    name: str
    fs: float
    frame: Frame
    grid: GridModel

    def __post_init__(self) -> None:
        positive(self.fs, "fs")
        grid, n = self.grid, self.frame.n_inputs
        found = len(grid.axes), min(grid.n_nodes), grid.scale, grid.kind
        if found != (n, max(found[1], 2), "root", "AR"):
            raise ValueError(
                f"grid has {found[0]} axes of {found[1]} nodes or more, scale {grid.scale!r}, {grid.kind}. "
                f"Expected {n} axes of 2 nodes or more, scale 'root', AR"
            )

    @property
    def order(self) -> int:
        """Order p of the AR models."""
        return self.grid.order

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample: 2^d corners, sqrt(1 - k^2), and the lattice."""
        return float(2 ** (self.frame.n_inputs + 1) * (self.order + 1) + 10 * self.order)

    def autoregressions(self, speed: Samples, force: Samples) -> Autoregression:
        """Return the AR models of strokes along +x at speeds (n,) and forces (n,)."""
        velocity = np.column_stack([speed, np.zeros_like(speed)])
        along = [speed] if self.frame.isotropic else [*velocity.T]
        k, power = self.grid.at(*along, force)
        level = np.minimum(np.sqrt(power), self.frame.cap(velocity, force))
        return Autoregression(k, level * np.exp(log_cosines(k).sum(axis=-1)))

    def renderer(self, *, seed: int = 0) -> MotionRenderer:
        """Return a renderer at rest."""
        frame, nodes = self.frame, self.grid.nodes
        bounds = (*np.maximum([frame.fastest, frame.hardest, frame.slow, frame.light], 1e-12), frame.loudest)

        def read(course: Samples) -> tuple[Samples, Samples]:
            at, cap = np.empty((len(course), frame.n_inputs)), np.empty(len(course))
            _keep_in_range(course, bounds, at, cap)
            found = nodes.at_warped(at)
            return found[:, :-1], np.minimum(found[:, -1], cap)[:, np.newaxis]

        return MotionRenderer(
            read,
            fs=self.fs,
            order=self.order,
            hop=1,
            limit=LIMIT * frame.peak,
            seed=seed,
            motion_hz=MOTION_HZ,
            n_stationary=self.order + 1,
        )


def bake(texture: MapTexture, name: str, nodes: tuple[int, ...] | None = None) -> BakedTexture:
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
        raise ValueError(f"nodes are {size}. Expected {frame.n_inputs} numbers of at least 2")
    parts = [np.linspace(0 if frame.isotropic else -1, 1, n) for n in size[:-1]]
    axes = [frame.fastest * np.sign(part) * part**2 for part in parts]
    axes.append(frame.hardest * np.linspace(0, 1, size[-1]) ** 2)
    *v, force = (each.ravel() for each in np.meshgrid(*axes, indexing="ij"))
    velocity = np.column_stack([*v, np.zeros(force.size)][:2])
    k, level = texture.models(velocity, force)
    grid = GridModel(tuple(axes), k.reshape(*size, -1), level.reshape(size) ** 2, frame.peak, scale="root")
    return BakedTexture(name, texture.fs, frame, grid)


@njit(cache=True, error_model="numpy")
def _evaluate(u, q, w, d, out):  # type: ignore[no-untyped-def]
    """Write f(u) of a network into `out`, row by row."""
    for t in range(len(u)):
        out[t] = d[0]
        for k in range(u.shape[1]):
            for i in range(out.shape[1]):
                out[t, i] += u[t, k] * d[k + 1, i]
        for j in range(len(q)):
            r = 0.0
            for k in range(u.shape[1]):
                r += (u[t, k] - q[j, k]) ** 2
            r = np.sqrt(r)
            for i in range(out.shape[1]):
                out[t, i] += r * w[j, i]


@njit(cache=True, error_model="numpy")
def _keep_in_range(course, bounds, at, cap):  # type: ignore[no-untyped-def]
    """Write the signed roots of inputs kept in range, and the largest level allowed; see `Frame.cap`."""
    fastest, hardest, slow, light, loudest = bounds
    n = at.shape[1]
    for t in range(len(course)):
        speed = np.sqrt(course[t, 0] ** 2 + course[t, 1] ** 2)
        shrink = fastest / speed if speed > fastest else 1.0
        if n == 2:
            at[t, 0] = speed * shrink
        else:
            at[t, 0], at[t, 1] = course[t, 0] * shrink, course[t, 1] * shrink
        at[t, n - 1] = min(course[t, 2], hardest)
        for i in range(n):
            at[t, i] = np.sign(at[t, i]) * np.sqrt(abs(at[t, i]))
        cap[t] = loudest * (min(speed / slow, 1.0) * min(course[t, 2] / light, 1.0))
