"""Define textures as functions of direction, speed and force: a network, a triangulation or a grid."""

from abc import abstractmethod
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any, ClassVar, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy import interpolate, spatial

from texclass.compilation import njit
from texclass.haptics.textures.abdulali2016.model_points import (
    MAX_EXPONENT,
    MOTION_HZ,
    Loudness,
    compute_level,
)
from texclass.haptics.textures.contract import Texture, freeze
from texclass.haptics.textures.grid import GridModel
from texclass.haptics.textures.motion_renderer import MotionRenderer
from texclass.recording import Samples
from texclass.signals import positive
from texclass.vibration import line_spectrum
from texclass.vibration.autoregressive import Autoregression
from texclass.vibration.reflection import log_cosines

PEAK_FACTOR = 2.0
"""Limit of rendered samples, as a multiple of the recorded peak (our choice)."""
LATTICE_OPERATIONS = 12
"""Operations per lattice stage and sample: linear change of k, sqrt(1 - k^2), and the rotation."""
ANISOTROPIC, ISOTROPIC = (17, 17, 8), (24, 10)
"""Number of nodes of a baked texture over v_x, v_y, f_n, and over |v|, f_n."""


@dataclass(frozen=True)
class Frame:
    """Normalisation and range of the inputs of a texture, and limits of its output.

    Parameters
    ----------
    isotropic : bool
        Whether the inputs are (|v|, f_n) instead of (v_x, v_y, f_n).
    mean, deviation : tuple of float
        Mean and standard deviation of each input over the recording (mm/s, N), for normalisation.
    fastest, hardest : float
        Largest speed (mm/s) and force (N) of a segment; larger inputs are clipped to these values.
    slow, light : float
        Speed (mm/s) and force (N) below which the limit of the level decreases linearly to 0.
    loudest : float
        Largest RMS of a segment, which is the upper limit of the level.
    peak : float
        Largest recorded sample.
    speed_range, force_range : (float, float)
        5th and 95th percentiles of speed (mm/s) and force (N) in the segments, both positive.
    gap : float
        Smallest distance between line spectral frequencies in rad. Rendered resonances are not sharper than
        those in three quarters of the segments.

    Raises
    ------
    ValueError
        If a number is negative or not finite, or the number of inputs is not 2 (isotropic) or 3.
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
    speed_range: tuple[float, float]
    force_range: tuple[float, float]
    gap: float = line_spectrum.MIN_GAP

    def __post_init__(self) -> None:
        n = 2 if self.isotropic else 3
        if not len(self.mean) == len(self.deviation) == n:
            raise ValueError(f"mean and deviation must have {n} values, one per input, got {len(self.mean)}")
        sizes = [self.fastest, self.hardest, self.slow, self.light, self.loudest, self.peak, self.gap]
        is_finite = np.isfinite([*sizes, *self.mean, *self.deviation]).all()
        if not is_finite or min(sizes) < 0 or min(self.deviation) <= 0:
            raise ValueError(
                f"all values must be finite and non-negative, and deviations positive, got {self}"
            )
        for name, (low, high) in (("speed_range", self.speed_range), ("force_range", self.force_range)):
            if not 0 < low <= high < np.inf:
                raise ValueError(f"{name} must be two increasing, positive numbers, got {low:g} and {high:g}")

    @property
    def n_inputs(self) -> int:
        """Number of inputs: 3, or 2 if isotropic."""
        return len(self.mean)

    @property
    def speeds(self) -> Samples:
        """5th and 95th percentile of the speed in mm/s, one value if they are equal."""
        return np.unique(self.speed_range)

    @property
    def forces(self) -> Samples:
        """5th and 95th percentile of the force in N, one value if they are equal."""
        return np.unique(self.force_range)

    def motion(self, velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples]:
        """Return speeds (n,) and forces (n,), clipped to the range, for velocities (n, 2) and forces."""
        speed = np.hypot(*np.asarray(velocity, dtype=np.float64).T)
        clipped_force = np.clip(np.asarray(force, dtype=np.float64), 0.0, self.hardest)
        return np.minimum(speed, self.fastest), clipped_force

    def inputs(self, velocity: ArrayLike, force: ArrayLike) -> Samples:
        """Return normalised inputs (n, n_inputs), clipped to the range, from velocities and forces."""
        v = np.asarray(velocity, dtype=np.float64)
        speed = np.hypot(*v.T)
        clipped_speed, f = self.motion(v, force)
        clipped = v * (clipped_speed / np.where(speed > 0, speed, 1.0))[:, np.newaxis]
        columns = [clipped_speed] if self.isotropic else [*clipped.T]
        return np.asarray((np.column_stack([*columns, f]) - self.mean) / self.deviation)

    def cap(self, velocity: ArrayLike, force: ArrayLike) -> Samples:
        """Return the upper limit of the level (n,): `loudest`, decreasing to 0 at zero speed or force."""
        speed, f = np.hypot(*np.asarray(velocity, dtype=np.float64).T), np.asarray(force, dtype=np.float64)
        slow, light = max(self.slow, 1e-12), max(self.light, 1e-12)
        return np.asarray(self.loudest * (np.clip(speed / slow, 0.0, 1.0) * np.clip(f / light, 0.0, 1.0)))


@dataclass(frozen=True, eq=False)
class RadialNetwork:
    """Radial basis function network with phi(r) = r, a linear polynomial, and several outputs.

    f(u) = sum_j w_j |u - q_j| + d_0 + sum_k d_k u_k                              [abdulali2016, eq. (4)]

    Attributes
    ----------
    centres : ndarray of shape (n_centres, n_inputs)
        Centres q, normalised inputs.
    weights : ndarray of shape (n_centres, n_outputs)
        Weights w.
    polynomial : ndarray of shape (n_inputs + 1, n_outputs)
        Coefficients d: a row for the constant, then one row per input.

    Raises
    ------
    ValueError
        If the shapes do not match, or a value is not finite.

    Examples
    --------
    >>> network = RadialNetwork(np.zeros((1, 2)), np.ones((1, 1)), np.zeros((3, 1)))
    >>> network.at([[3.0, 4.0]]).tolist()
    [[5.0]]
    """

    centres: Samples
    weights: Samples
    polynomial: Samples

    def __post_init__(self) -> None:
        freeze(self, centres=("n", "d"), weights=("n", "m"))
        freeze(self, polynomial=(self.centres.shape[1] + 1, self.weights.shape[1]))

    def at(self, u: ArrayLike) -> Samples:
        """Return f (n, n_outputs) at inputs (n, n_inputs)."""
        points = np.ascontiguousarray(u, dtype=np.float64)
        out = np.empty((len(points), self.weights.shape[1]))
        _evaluate(points, self.centres, self.weights, self.polynomial, out)
        return out


class FramedTexture(Texture):
    """Base class of textures whose speed and force range is defined by a `Frame`."""

    frame: Frame

    @property
    def speeds(self) -> Samples:
        """Range of the recorded speed in mm/s, see `Frame.speeds`."""
        return self.frame.speeds

    @property
    def forces(self) -> Samples:
        """Range of the recorded force in N, see `Frame.forces`."""
        return self.frame.forces


@dataclass(frozen=True, eq=False)
class MapTexture(FramedTexture):
    """Base class of textures that map velocity and force to the line spectrum and loudness of an AR process.

    Parameters
    ----------
    name : str
        Name of the surface.
    fs : float
        Sampling rate in Hz.
    frame : Frame
        Normalisation and range of the inputs, and limits of the output.
    loudness : {"level", "variance"}
        Meaning of the last output: residual from the level law (default), or variance of the innovation. See
        `compute_level`.
    growth : tuple of float
        Exponents of speed and force in the level law; used for "level" only.
    buffer : int
        Number of samples between two evaluations of the mapping (default 16); `abdulali2016`, section 4.2.
    glide : bool
        Whether parameters change linearly between evaluations (default), instead of in steps as in the paper.

    Raises
    ------
    ValueError
        If a value is invalid.
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
            raise ValueError(f"buffer must be an integer of at least 1, got {self.buffer!r}")
        if self.loudness not in get_args(Loudness):
            raise ValueError(f"loudness must be one of {get_args(Loudness)}, got {self.loudness!r}")
        if len(self.growth) != 2 or not all(0 <= power <= MAX_EXPONENT for power in self.growth):
            raise ValueError(f"growth must be two numbers between 0 and {MAX_EXPONENT}, got {self.growth}")
        largest = np.pi / (self.order + 1)
        if self.frame.gap > largest:
            raise ValueError(f"gap must be at most pi / (p + 1) = {largest:g}, got {self.frame.gap}")

    @property
    @abstractmethod
    def order(self) -> int:
        """Order p of the AR models."""

    @abstractmethod
    def outputs_at(self, u: Samples) -> Samples:
        """Return line spectral frequencies and loudness (n, p + 1) at normalised inputs (n, n_inputs)."""

    def models(self, velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples]:
        """Return reflection coefficients (n, p) and levels (n,) at velocities (n, 2) and forces (n,).

        Line spectral frequencies that are out of order or too close are corrected by `line_spectrum.spread`.
        The level is limited by `Frame.cap`.
        """
        out = self.outputs_at(self.frame.inputs(velocity, force))
        k = line_spectrum.to_reflection(line_spectrum.spread(out[:, :-1], self.frame.gap))
        level = compute_level(self.loudness, out[:, -1], k, self.frame.motion(velocity, force), self.growth)
        return k, np.minimum(level, self.frame.cap(velocity, force))

    def autoregressions(self, speed: Samples, force: Samples) -> Autoregression:
        """Return the AR models of strokes along +x at speeds (n,) and forces (n,)."""
        k, level = self.models(np.column_stack([speed, np.zeros_like(speed)]), force)
        return Autoregression(k, level * np.exp(log_cosines(k).sum(axis=-1)))

    def renderer(self, *, seed: int = 0) -> MotionRenderer:
        """Return a renderer that low-pass filters the motion at `MOTION_HZ`, like the recordings."""

        def parameter_map(motion: Samples) -> tuple[Samples, Samples]:
            k, level = self.models(motion[:, :2], motion[:, 2])
            return k, level[:, np.newaxis]

        return MotionRenderer(
            parameter_map,
            fs=self.fs,
            order=self.order,
            hop=self.buffer,
            limit=PEAK_FACTOR * self.frame.peak,
            seed=seed,
            motion_hz=MOTION_HZ,
            glide=self.glide,
            n_stationary=self.order + 1,
        )


@dataclass(frozen=True, eq=False)
class NetworkTexture(MapTexture):
    """Texture of `abdulali2016`, whose mapping is a radial basis function network.

    Parameters
    ----------
    name, fs, frame, loudness, growth, buffer, glide
        See `MapTexture`.
    network : RadialNetwork
        Network with p line spectral frequencies (rad per sample) and the loudness as outputs, in this order.

    Examples
    --------
    >>> ranges = (16.0, 160.0), (0.2, 2.0)
    >>> frame = Frame(True, (80.0, 1.0), (40.0, 0.5), 160.0, 2.0, 4.0, 0.05, 5.0, 20.0, *ranges)
    >>> polynomial = np.array([[1.0, 2.0, 0.4], [0.05, 0.05, 0.1], [0.0, 0.0, 0.1]])
    >>> network = RadialNetwork(np.zeros((1, 2)), np.zeros((1, 3)), polynomial)
    >>> texture = NetworkTexture("slate", 1000.0, frame, network)
    >>> k, level = texture.models([[80.0, 0.0]], [1.0])
    >>> texture.order, k.shape, level.round(3).tolist()
    (2, (1, 2), [1.492])
    """

    family: ClassVar[str] = "abdulali2016"
    network: RadialNetwork

    def __post_init__(self) -> None:
        n_inputs, n_outputs = self.network.centres.shape[1], self.network.weights.shape[1]
        if n_inputs != self.frame.n_inputs or n_outputs < 2:
            raise ValueError(
                f"network must have {self.frame.n_inputs} inputs and at least 2 outputs, got {n_inputs} and "
                f"{n_outputs}"
            )
        super().__post_init__()

    @property
    def order(self) -> int:
        """Order p of the AR models."""
        return int(self.network.weights.shape[1]) - 1

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample; the conversion of LSF to k counts as 4 p^2."""
        n, p, d = len(self.network.centres), self.order, self.frame.n_inputs
        evaluation = n * (3 * d + 1) + 2 * (n + d + 1) * (p + 1) + 4 * p**2
        return LATTICE_OPERATIONS * p + evaluation / self.buffer

    def outputs_at(self, u: Samples) -> Samples:
        """Return the outputs of the network."""
        return self.network.at(u)


@dataclass(frozen=True, eq=False)
class DelaunayTexture(MapTexture):
    """Baseline texture that interpolates line spectra linearly in a triangulation, like HaTT models.

    Outside the triangulation, the outputs of the nearest point are used.

    Parameters
    ----------
    name, fs, frame, loudness, growth, buffer, glide
        See `MapTexture`.
    u : ndarray of shape (n_points, n_inputs)
        Normalised inputs of the points, which must not lie in one plane (or line, if isotropic).
    outputs : ndarray of shape (n_points, p + 1)
        Line spectral frequencies (rad per sample, increasing) and loudness.
    """

    family: ClassVar[str] = "abdulali2016-delaunay"
    u: Samples
    outputs: Samples

    def __post_init__(self) -> None:
        freeze(self, u=("n_points", self.frame.n_inputs), outputs=("n_points", "outputs"))
        if self.order < 1:
            raise ValueError(f"outputs must have at least 2 columns, got shape {self.outputs.shape}")
        if np.any(np.diff(self.outputs[:, :-1], axis=1) <= 0):
            raise ValueError("the line spectral frequencies in outputs must increase")
        try:
            _ = self._interpolators
        except (spatial.QhullError, ValueError) as error:
            raise ValueError(
                f"the {len(self.u)} points cannot be triangulated: they must not all lie in one plane (line)"
            ) from error
        super().__post_init__()

    @cached_property
    def _interpolators(self) -> tuple[Any, Any]:
        linear = interpolate.LinearNDInterpolator(spatial.Delaunay(self.u), self.outputs)
        return linear, interpolate.NearestNDInterpolator(self.u, self.outputs)

    @property
    def order(self) -> int:
        """Order p of the AR models."""
        return int(self.outputs.shape[1]) - 1

    @property
    def operations(self) -> float:
        """Operations per sample; the conversion of LSF to k counts as 4 p^2, the simplex search as 0."""
        d, p = self.frame.n_inputs, self.order
        return LATTICE_OPERATIONS * p + (2 * d**2 + 2 * (d + 1) * (p + 1) + 4 * p**2) / self.buffer

    def outputs_at(self, u: Samples) -> Samples:
        """Return sum_i b_i f_i with the barycentric coordinates b in the simplex of each input."""
        linear, nearest = self._interpolators
        out = np.asarray(linear(u))
        is_outside = np.isnan(out).any(axis=1)  # or in a simplex of zero volume
        out[is_outside] = nearest(u[is_outside])
        return out


@dataclass(frozen=True, eq=False)
class BakedTexture(FramedTexture):
    """A texture sampled at the nodes of a grid (see `bake`), fast enough for one sample per call.

    The motion is low-pass filtered at 25 Hz, and the grid is evaluated at every sample.

    Parameters
    ----------
    name : str
        Name of the surface.
    fs : float
        Sampling rate in Hz.
    frame : Frame
        Range of the inputs, and limits of the output.
    grid : GridModel
        Model at the nodes of a grid over (v_x, v_y, f_n) or (|v|, f_n). Its scale must be "root", because
        spectra change faster at low speeds and forces, where this scale has smaller steps.

    Raises
    ------
    ValueError
        If the grid does not match the frame.
    """

    family: ClassVar[str] = "abdulali2016-baked"
    name: str
    fs: float
    frame: Frame
    grid: GridModel

    def __post_init__(self) -> None:
        positive(self.fs, "fs")
        grid, n = self.grid, self.frame.n_inputs
        shape = len(grid.axes), min(grid.n_nodes), grid.scale, grid.kind
        if shape != (n, max(shape[1], 2), "root", "AR"):
            raise ValueError(
                f"grid must have {n} axes of 2 nodes or more, scale 'root' and AR models, got {shape[0]} "
                f"axes of {shape[1]} nodes or more, scale {grid.scale!r} and {grid.kind}"
            )

    @property
    def order(self) -> int:
        """Order p of the AR models."""
        return self.grid.order

    @property
    def operations(self) -> float:
        """Operations per sample for 2^d corners of a grid cell, sqrt(1 - k^2), and the lattice."""
        return float(2 ** (self.frame.n_inputs + 1) * (self.order + 1) + 10 * self.order)

    def autoregressions(self, speed: Samples, force: Samples) -> Autoregression:
        """Return the AR models of strokes along +x at speeds (n,) and forces (n,)."""
        velocity = np.column_stack([speed, np.zeros_like(speed)])
        columns = [speed] if self.frame.isotropic else [*velocity.T]
        k, power = self.grid.at(*columns, force)
        level = np.minimum(np.sqrt(power), self.frame.cap(velocity, force))
        return Autoregression(k, level * np.exp(log_cosines(k).sum(axis=-1)))

    def renderer(self, *, seed: int = 0) -> MotionRenderer:
        """Return a renderer whose motion starts at rest."""
        frame, nodes = self.frame, self.grid.nodes
        bounds = (*np.maximum([frame.fastest, frame.hardest, frame.slow, frame.light], 1e-12), frame.loudest)

        def parameter_map(motion: Samples) -> tuple[Samples, Samples]:
            points, cap = np.empty((len(motion), frame.n_inputs)), np.empty(len(motion))
            _clip_and_warp(motion, bounds, points, cap)
            values = nodes.at_warped(points)
            return values[:, :-1], np.minimum(values[:, -1], cap)[:, np.newaxis]

        return MotionRenderer(
            parameter_map,
            fs=self.fs,
            order=self.order,
            hop=1,
            limit=PEAK_FACTOR * frame.peak,
            seed=seed,
            motion_hz=MOTION_HZ,
            n_stationary=self.order + 1,
        )


def bake(texture: MapTexture, name: str, nodes: tuple[int, ...] | None = None) -> BakedTexture:
    """Sample a texture at the nodes of a grid.

    Parameters
    ----------
    texture : NetworkTexture or DelaunayTexture
        Texture to sample.
    name : str
        Name of the surface.
    nodes : tuple of int, optional
        Number of nodes along (v_x, v_y, f_n) or (|v|, f_n) (default `ANISOTROPIC` or `ISOTROPIC`).

    Raises
    ------
    ValueError
        If the number of axes is wrong, or an axis has fewer than 2 nodes.

    Examples
    --------
    >>> ranges = (16.0, 160.0), (0.2, 2.0)
    >>> frame = Frame(True, (80.0, 1.0), (40.0, 0.5), 160.0, 2.0, 4.0, 0.05, 5.0, 20.0, *ranges)
    >>> polynomial = np.array([[1.0, 2.0, 0.4], [0.05, 0.05, 0.1], [0.0, 0.0, 0.1]])
    >>> network = RadialNetwork(np.zeros((1, 2)), np.zeros((1, 3)), polynomial)
    >>> bake(NetworkTexture("slate", 1000.0, frame, network), "slate", (5, 4)).grid.n_nodes
    (5, 4)
    """
    frame = texture.frame
    size = nodes or (ISOTROPIC if frame.isotropic else ANISOTROPIC)
    if len(size) != frame.n_inputs or min(size) < 2:
        raise ValueError(f"nodes must be {frame.n_inputs} numbers of at least 2, got {size}")
    steps = [np.linspace(0 if frame.isotropic else -1, 1, n) for n in size[:-1]]
    axes = [frame.fastest * np.sign(step) * step**2 for step in steps]
    axes.append(frame.hardest * np.linspace(0, 1, size[-1]) ** 2)
    *v, force = (values.ravel() for values in np.meshgrid(*axes, indexing="ij"))
    velocity = np.column_stack([*v, np.zeros(force.size)][:2])
    k, level = texture.models(velocity, force)
    grid = GridModel(tuple(axes), k.reshape(*size, -1), level.reshape(size) ** 2, frame.peak, scale="root")
    return BakedTexture(name, texture.fs, frame, grid)


@njit(cache=True, error_model="numpy")
def _evaluate(u, q, w, d, out):  # type: ignore[no-untyped-def]
    """Write the output f(u) of a network to `out`, row by row."""
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
def _clip_and_warp(motion, bounds, points, cap):  # type: ignore[no-untyped-def]
    """Write the signed square roots of the clipped inputs, and the limit of the level (`Frame.cap`)."""
    fastest, hardest, slow, light, loudest = bounds
    n = points.shape[1]
    for t in range(len(motion)):
        speed = np.sqrt(motion[t, 0] ** 2 + motion[t, 1] ** 2)
        scale = fastest / speed if speed > fastest else 1.0
        if n == 2:
            points[t, 0] = speed * scale
        else:
            points[t, 0], points[t, 1] = motion[t, 0] * scale, motion[t, 1] * scale
        points[t, n - 1] = min(motion[t, 2], hardest)
        for i in range(n):
            points[t, i] = np.sign(points[t, i]) * np.sqrt(abs(points[t, i]))
        cap[t] = loudest * (min(speed / slow, 1.0) * min(motion[t, 2] / light, 1.0))
