"""Define models on a grid of speeds and forces, and interpolate between the nodes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from texclass.compilation import njit
from texclass.haptics.textures.contract import freeze
from texclass.recording import Samples

Kind = Literal["silence", "AR", "lines", "AR + lines"]
Scale = Literal["log", "root"]
MIN_POWER = 1e-300
"""Smallest power of a node, which keeps its logarithm finite."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Interpolate values multilinearly over warped axes; values are constant beyond the outermost nodes.

    Parameters
    ----------
    axes : sequence of ndarray of shape (n_nodes,)
        Increasing coordinates of the nodes, after `warp`.
    values : ndarray of shape (product of n_nodes, m)
        Values at the nodes, in C order (the last axis varies fastest).
    """

    axes: tuple[Samples, ...]
    values: Samples

    def at_warped(self, points: Samples) -> Samples:
        """Return the interpolated values (n, m) at points (n, n_axes) in warped coordinates."""
        out = np.zeros((len(points), self.values.shape[1]))
        _mix(self.axes, np.ascontiguousarray(points), self.values, out)
        return out


@dataclass(frozen=True, eq=False)
class GridModel:
    """A vibration model at the nodes of a grid of speeds and forces, with interpolation between the nodes.

    The model is an autoregressive process, spectral lines, both, or silence::

        x = level (sqrt(1 - sum a_i^2 / 2) noise through the lattice + sum_i a_i cos(phase_i))

    Between the nodes, k, a and w(power) are linear in w(speed) and w(force). The warping w is the logarithm
    or the signed square root:

    - With logarithms, a power law of speed and force needs nodes only at the ends.
    - With square roots, a grid includes zero speed and, with two velocity axes, all directions.

    Since |k| < 1 at all nodes, |k| < 1 between them as well, and interpolated models are stable. Beyond the
    outermost nodes, the model at the nearest edge of the grid is used.

    Parameters
    ----------
    axes : sequence of array_like of shape (n_nodes,)
        Increasing coordinates of the nodes: speed (mm/s) and force (N), or velocity along x, velocity along
        y, and force. Coordinates must be positive for the scale "log".
    rows : array_like of shape (*n_nodes, order + n_lines)
        Reflection coefficients (|k| < 1) and non-negative line amplitudes of a vibration with unit RMS.
    power : array_like of shape n_nodes
        Mean square of the vibration (the square of the level) at each node.
    peak : float
        Largest magnitude of the recorded vibration.
    frequency_hz, per_mm : array_like of shape (n_lines,), optional
        Constant part and slope of the line frequencies (default: no lines): frequency = frequency_hz + per_mm
        * speed. Resonances have a constant frequency; the frequency of spatial periods
        is proportional to the speed.
    scale : {"log", "root"}
        Warping w of the axes and of the power.

    Raises
    ------
    ValueError
        If a shape or a value is invalid.

    Notes
    -----
    A texture that is expensive to evaluate can be sampled at the nodes. For a texture of
    `abdulali2016`, compute `k, level = texture.models(velocity, force)` at all nodes, in the order of
    `meshgrid(*axes, indexing="ij")`. The grid is then `GridModel(axes, k.reshape(*n_nodes, -1),
    level.reshape(n_nodes) ** 2, frame.peak, scale="root")`.

    Examples
    --------
    An AR process of order 1 whose power is proportional to the speed, at 100 mm/s and 1 N:

    >>> model = GridModel(([50.0, 200.0], [1.0]), [[[0.5]], [[0.3]]], [[1.0], [4.0]], peak=8.0)
    >>> rows, power = model.at([100.0], [1.0])
    >>> model.kind, rows.round(3).tolist(), power.round(3).tolist()
    ('AR', [[0.4]], [2.0])
    """

    axes: tuple[Samples, ...]
    rows: Samples
    power: Samples
    peak: float
    frequency_hz: Samples = field(default_factory=lambda: np.zeros(0))
    per_mm: Samples = field(default_factory=lambda: np.zeros(0))
    scale: Scale = "log"

    def __post_init__(self) -> None:
        axes = tuple(np.array(axis, dtype=np.float64) for axis in self.axes)
        for axis in axes:
            is_increasing = (
                axis.ndim == 1 and axis.size and np.isfinite(axis).all() and np.all(np.diff(axis) > 0)
            )
            if not is_increasing or (self.scale == "log" and axis[0] <= 0):
                bound = " and be positive" if self.scale == "log" else ""
                raise ValueError(f"the values of an axis must increase{bound}, got {axis}")
            axis.setflags(write=False)
        if len(axes) not in (2, 3):
            raise ValueError(f"axes must be speed and force, or v_x, v_y and force, got {len(axes)} axes")
        object.__setattr__(self, "axes", axes)
        lines, size = ("n_lines",), self.n_nodes
        freeze(self, rows=(*size, "columns"), power=size, frequency_hz=lines, per_mm=lines)
        lowest = min(self.power.min(), self.peak, self.frequency_hz.min(initial=0.0))
        if lowest < 0 or not np.isfinite(self.peak):
            raise ValueError(f"power, peak and frequency_hz must be finite and at least 0, got {lowest}")
        if self.order < 0:
            raise ValueError(
                f"rows must have at least {self.n_lines} columns, one per line, got {self.rows.shape[-1]}"
            )
        k, a = self.rows[..., : self.order], self.rows[..., self.order :]
        if np.abs(k).max(initial=0.0) >= 1:
            raise ValueError(f"reflection coefficients must be below 1 in magnitude, got {np.abs(k).max():g}")
        is_valid = a.min(initial=0.0) >= 0 and a.max(initial=0.0) <= 2
        if not is_valid or (a**2).sum(axis=-1).max(initial=0.0) > 2 * (1 + 1e-9):
            raise ValueError("line amplitudes must be non-negative, and the sum of their squares at most 2")

    @classmethod
    def silence(cls) -> "GridModel":
        """Return a silent model, for surfaces whose vibration the device cannot render perceptibly."""
        return cls((np.ones(1), np.ones(1)), np.zeros((1, 1, 0)), np.zeros((1, 1)), 0.0)

    @property
    def kind(self) -> Kind:
        """Components of the model: "silence", "AR", "lines" or "AR + lines"."""
        if not self.rows.shape[-1]:
            return "silence"
        return "lines" if not self.order else "AR + lines" if self.n_lines else "AR"

    @property
    def speeds(self) -> Samples:
        """Nodes of the first axis in mm/s."""
        return self.axes[0]

    @property
    def forces(self) -> Samples:
        """Nodes of the last axis in N."""
        return self.axes[-1]

    @property
    def n_lines(self) -> int:
        """Number of spectral lines."""
        return int(self.frequency_hz.size)

    @property
    def order(self) -> int:
        """Order of the lattice."""
        return int(self.rows.shape[-1]) - self.n_lines

    @property
    def n_nodes(self) -> tuple[int, ...]:
        """Number of nodes along each axis."""
        return tuple(axis.size for axis in self.axes)

    @property
    def n_bytes(self) -> int:
        """Size of the arrays in bytes."""
        return sum(a.nbytes for a in (*self.axes, self.rows, self.power, self.frequency_hz, self.per_mm))

    @cached_property
    def nodes(self) -> Grid:
        """Values of `rows` and w(`power`) at the nodes in warped coordinates, as used by the renderers."""
        power = np.maximum(self.power, MIN_POWER) if self.scale == "log" else self.power
        values = np.concatenate([self.rows, warp(power, self.scale)[..., np.newaxis]], axis=-1)
        axes = tuple(warp(axis, self.scale) for axis in self.axes)
        return Grid(axes, values.reshape(self.power.size, -1))

    def operations(self, fs: float) -> float:
        """Return the number of multiplications and additions per sample of a contact; see `operations`."""
        return operations(self.order, self.n_lines, fs)

    def at(self, *points: ArrayLike) -> tuple[Samples, Samples]:
        """Return rows (n, order + n_lines) and power (n,) interpolated at points, one array (n,) per axis."""
        values = self.nodes.at_warped(np.column_stack([warp(point, self.scale) for point in points]))
        w = values[:, -1]
        return values[:, :-1], np.exp(w) if self.scale == "log" else w**2


def update_interval(fs: float) -> int:
    """Return the number of samples between two updates of the interpolated parameters (1000 per second).

    The level is updated at every sample.
    """
    return max(1, round(fs / 1000))


def operations(order: int, n_lines: int, fs: float) -> float:
    """Return the number of multiplications and additions per sample of one contact, including updates.

    A lattice of order p needs 6 p operations per sample and 21 p per update; n lines need 18 n and 12 n,
    respectively. Speed, force, level and noise need 70 operations, and none if the model is silent. A
    logarithm, exponential, root or cosine counts as 10 operations.
    """
    if order + n_lines == 0:
        return 0.0
    return 70 + order * (6 + 21 / update_interval(fs)) + n_lines * (18 + 12 / update_interval(fs))


def warp(values: ArrayLike, scale: Scale = "log") -> Samples:
    """Map values to the scale on which interpolation is linear: ln x, or sign(x) sqrt(|x|)."""
    x = np.asarray(values, dtype=np.float64)
    return np.asarray(np.log(x) if scale == "log" else np.sign(x) * np.sqrt(np.abs(x)))


def interpolation_weights(
    axes: Sequence[ArrayLike], points: Sequence[ArrayLike], scale: Scale = "log"
) -> Samples:
    """Return the multilinear interpolation weights of all nodes at each point.

    Parameters
    ----------
    axes : sequence of array_like of shape (n_nodes,)
        Coordinates of the nodes on each axis; see `GridModel`.
    points : sequence of array_like of shape (n,)
        Coordinates of the points, one array per axis.
    scale : {"log", "root"}
        Warping w of the axes (default "log").

    Returns
    -------
    ndarray of shape (n, product of n_nodes)
        Weights in C order of the nodes; each row sums to 1.
    """
    nodes = Grid(tuple(warp(axis, scale) for axis in axes), np.eye(math.prod(map(np.size, axes))))
    return nodes.at_warped(np.column_stack([warp(point, scale) for point in points]))


def interpolate_power(weights: Samples, power: ArrayLike) -> Samples:
    """Return powers (n, ...), interpolated in the logarithm from (n_nodes, ...) with weights (n, n_nodes)."""
    return np.asarray(np.exp(np.tensordot(weights, np.log(np.maximum(power, MIN_POWER)), axes=1)))


def fit_gamma_regression(H: Samples, power: Samples, penalty: ArrayLike = 0.0) -> Samples:
    """Fit a gamma regression with logarithmic link, E[P] = exp(H theta), and return theta (n,).

    Estimates of a power have a gamma distribution around the true value. The fit uses Fisher scoring::

        theta <- theta + (H'H + T)^-1 (H' (P / M - 1) - T theta),    M = exp(H theta)

    Parameters
    ----------
    H : ndarray of shape (n_points, n)
        Design matrix.
    power : ndarray of shape (n_points,)
        Power P, positive.
    penalty : array_like of shape (n, n) or ()
        Quadratic penalty T on theta (default 0).

    References
    ----------
    McCullagh, Nelder, "Generalized linear models", 1989, chapter 8.
    """
    T = np.broadcast_to(penalty, (H.shape[1], H.shape[1]))
    solve = np.linalg.pinv(H.T @ H + T)
    theta = solve @ (H.T @ np.log(power))
    for _ in range(12):  # about 8 iterations reach 1e-3
        step = np.minimum(power * np.exp(-H @ theta) - 1, 2.0)
        theta = theta + solve @ (H.T @ step - T @ theta)
    return np.asarray(theta)


@njit(cache=True, error_model="numpy")
def cell(nodes, x):  # type: ignore[no-untyped-def]
    """Return the nodes below and above x, and the weight of the upper node; x is clamped to the nodes."""
    last = nodes.size - 1
    if last == 0 or x <= nodes[0]:
        return 0, 0, 0.0
    if x >= nodes[last]:
        return last, last, 0.0
    i = 0
    while x >= nodes[i + 1]:
        i += 1
    return i, i + 1, (x - nodes[i]) / (nodes[i + 1] - nodes[i])


@njit(cache=True, error_model="numpy")
def _mix(axes, points, values, out):  # type: ignore[no-untyped-def]
    """Add to `out` the values at the corners of the cell of each point, weighted by linear interpolation."""
    n = len(axes)
    below, above, fraction = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n)
    for t in range(len(points)):
        for i in range(n):
            below[i], above[i], fraction[i] = cell(axes[i], points[t, i])
        for corner in range(1 << n):
            weight, node = 1.0, 0
            for i in range(n):
                up = (corner >> i) & 1
                weight *= fraction[i] if up else 1.0 - fraction[i]
                node = node * axes[i].size + (above[i] if up else below[i])
            if weight > 0.0:
                for m in range(out.shape[1]):
                    out[t, m] += weight * values[node, m]
