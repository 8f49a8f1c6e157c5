"""A vibration on a grid of speeds and forces: a model at each node, and what holds between the nodes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from texclass.haptics.textures.contract import freeze
from texclass.recording import Samples

Kind = Literal["silence", "AR", "lines", "AR + lines"]
Scale = Literal["log", "root"]
LEAST_POWER = 1e-300
"""A node without power counts as this, so that it has a logarithm."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Numbers at the nodes of a grid: multilinear over warped axes in between, held beyond the outermost.

    Parameters
    ----------
    axes : sequence of ndarray of shape (n_nodes,)
        Of the nodes, rising; warped, see `warped`.
    values : ndarray of shape (product of n_nodes, m)
        The nodes of the last axis stand together.
    """

    axes: tuple[Samples, ...]
    values: Samples

    def at_warped(self, points: Samples) -> Samples:
        """Return the numbers (n, m) at warped points (n, n_axes); every row by itself, bit for bit."""
        out = np.zeros((len(points), self.values.shape[1]))
        _mix(self.axes, np.ascontiguousarray(points), self.values, out)
        return out


@dataclass(frozen=True, eq=False)
class GridModel:
    """A vibration at the nodes of a grid of speeds and forces, and between them.

    It is an autoregressive process, lines, both, or nothing::

        x = level (sqrt(1 - sum a_i^2 / 2) noise through the lattice + sum_i a_i cos(phase_i))

    Between the nodes, k and a go linearly over w(speed) and w(force), and so does w(power), where w is the
    logarithm or the (signed) square root. Over logarithms a power law of speed and force needs no node
    between the ends; over square roots a grid reaches rest and, with two axes of velocity, all directions. A
    mean of numbers below 1 in size is below 1 in size: between stable models a model is stable. Beyond the
    outermost nodes, these hold.

    Parameters
    ----------
    axes : sequence of array_like of shape (n_nodes,)
        Of the nodes, rising: speed (mm/s) and force (N); or velocity along x and along y, and force.
        Above 0 for "log".
    rows : array_like of shape (*n_nodes, order + n_lines)
        Reflection coefficients, |k| < 1, and amplitudes of lines, at least 0, of a vibration of unit RMS.
    power : array_like of shape n_nodes
        Mean square of the vibration, level^2.
    peak : float
        Largest magnitude that was recorded.
    frequency_hz, per_mm : array_like of shape (n_lines,), optional
        frequency = frequency_hz + per_mm * speed: what rings keeps its frequency, what repeats along the
        surface follows the speed. No lines by default.
    scale : {"log", "root"}
        Which w.

    Raises
    ------
    ValueError
        If a shape does not fit or a value breaks its rule.

    Notes
    -----
    A texture that is dear to read becomes one by being read at the nodes: of the network of `abdulali2016`,
    `k, level = network.models(velocity, force)` at all nodes, in the order of `meshgrid(*axes,
    indexing="ij")`, is `GridModel(axes, k.reshape(*n_nodes, -1), level.reshape(n_nodes) ** 2, frame.peak,
    scale="root")`.
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
            rising = axis.ndim == 1 and axis.size and np.isfinite(axis).all() and np.all(np.diff(axis) > 0)
            if not rising or (self.scale == "log" and axis[0] <= 0):
                above = ", above 0" if self.scale == "log" else ""
                raise ValueError(f"an axis is {axis}. Expected rising{above}")
            axis.setflags(write=False)
        if len(axes) not in (2, 3):
            raise ValueError(f"axes are {len(axes)}. Expected speed and force, or v_x, v_y and force")
        object.__setattr__(self, "axes", axes)
        lines, size = ("n_lines",), self.n_nodes
        freeze(self, rows=(*size, "columns"), power=size, frequency_hz=lines, per_mm=lines)
        lowest = min(self.power.min(), self.peak, self.frequency_hz.min(initial=0.0))
        if lowest < 0 or not np.isfinite(self.peak):
            raise ValueError(
                f"power, peak or a frequency is {lowest}. Expected a finite number of at least 0"
            )
        if self.order < 0:
            raise ValueError(f"rows have {self.rows.shape[-1]} columns. Expected {self.n_lines} at least")
        k, a = self.rows[..., : self.order], self.rows[..., self.order :]
        if np.abs(k).max(initial=0.0) >= 1:
            raise ValueError(f"a reflection coefficient is {np.abs(k).max()}. Expected below 1 in size")
        in_range = a.min(initial=0.0) >= 0 and a.max(initial=0.0) <= 2
        if not in_range or (a**2).sum(axis=-1).max(initial=0.0) > 2 * (1 + 1e-9):
            raise ValueError("amplitudes of lines. Expected at least 0, their squares 2 at most in sum")

    @classmethod
    def silence(cls) -> "GridModel":
        """Return the model of a surface that the device cannot make felt."""
        return cls((np.ones(1), np.ones(1)), np.zeros((1, 1, 0)), np.zeros((1, 1)), 0.0)

    @property
    def kind(self) -> Kind:
        """What it is made of."""
        if not self.rows.shape[-1]:
            return "silence"
        return "lines" if not self.order else "AR + lines" if self.n_lines else "AR"

    @property
    def speeds(self) -> Samples:
        """Nodes of the first axis, mm/s."""
        return self.axes[0]

    @property
    def forces(self) -> Samples:
        """Nodes of the last axis, N."""
        return self.axes[-1]

    @property
    def n_lines(self) -> int:
        """Lines."""
        return int(self.frequency_hz.size)

    @property
    def order(self) -> int:
        """Stages of the lattice."""
        return int(self.rows.shape[-1]) - self.n_lines

    @property
    def n_nodes(self) -> tuple[int, ...]:
        """Along each axis."""
        return tuple(axis.size for axis in self.axes)

    @property
    def n_bytes(self) -> int:
        """Of its arrays."""
        return sum(a.nbytes for a in (*self.axes, self.rows, self.power, self.frequency_hz, self.per_mm))

    @cached_property
    def nodes(self) -> Grid:
        """Rows and w(power) over warped axes: what a renderer reads."""
        power = np.maximum(self.power, LEAST_POWER) if self.scale == "log" else self.power
        values = np.concatenate([self.rows, warped(power, self.scale)[..., np.newaxis]], axis=-1)
        axes = tuple(warped(axis, self.scale) for axis in self.axes)
        return Grid(axes, values.reshape(self.power.size, -1))

    def operations(self, fs: float) -> float:
        """Return multiplications and additions per sample of one contact; see `operations`."""
        return operations(self.order, self.n_lines, fs)

    def at(self, *points: ArrayLike) -> tuple[Samples, Samples]:
        """Return rows (n, order + n_lines) and power (n,) at points, one array of shape (n,) an axis."""
        found = self.nodes.at_warped(np.column_stack([warped(point, self.scale) for point in points]))
        w = found[:, -1]
        return found[:, :-1], np.exp(w) if self.scale == "log" else w**2


def renewal(fs: float) -> int:
    """Return the samples from one renewal of the parameters between the nodes to the next, 1000 a second.

    The level is renewed at each sample.
    """
    return max(1, round(fs / 1000))


def operations(order: int, n_lines: int, fs: float) -> float:
    """Return multiplications and additions per sample of one contact, renewals spread over the samples.

    6 p for a lattice of order p and 21 p a renewal; 18 n for n lines and 12 n a renewal; 70 for speed, force,
    level and noise of any that sounds. A logarithm, exponential, root or cosine counts 10.
    """
    if order + n_lines == 0:
        return 0.0
    return 70 + order * (6 + 21 / renewal(fs)) + n_lines * (18 + 12 / renewal(fs))


def warped(values: ArrayLike, scale: Scale = "log") -> Samples:
    """Return w(values), over which what lies between nodes is linear: ln x, or sign(x) sqrt(|x|)."""
    x = np.asarray(values, dtype=np.float64)
    return np.asarray(np.log(x) if scale == "log" else np.sign(x) * np.sqrt(np.abs(x)))


def shares(axes: Sequence[ArrayLike], points: Sequence[ArrayLike], scale: Scale = "log") -> Samples:
    """Return the shares of the nodes at points: multilinear over warped axes, held at the outermost nodes.

    Parameters
    ----------
    axes : sequence of array_like of shape (n_nodes,)
        See `GridModel`.
    points : sequence of array_like of shape (n,)
        One array an axis.
    scale : {"log", "root"}
        Which w.

    Returns
    -------
    ndarray of shape (n, product of n_nodes)
        Rows sum to 1; the nodes of the last axis stand together.
    """
    nodes = Grid(tuple(warped(axis, scale) for axis in axes), np.eye(math.prod(map(np.size, axes))))
    return nodes.at_warped(np.column_stack([warped(point, scale) for point in points]))


def mixed_power(share: Samples, power: ArrayLike) -> Samples:
    """Return the powers at points, shares (n, n_nodes) of those of the nodes (n_nodes, ...): ln P mixes."""
    return np.asarray(np.exp(np.tensordot(share, np.log(np.maximum(power, LEAST_POWER)), axes=1)))


def likeliest_logarithms(H: Samples, power: Samples, tie: ArrayLike = 0.0) -> Samples:
    """Return the theta (n,) for which the powers P_i about exp(H theta) are likeliest.

    Estimates of a power scatter about it as gamma variables: a regression with logarithmic link, by scoring::

        theta <- theta + (H'H + T)^-1 (H' (P / M - 1) - T theta),    M = exp(H theta)

    Parameters
    ----------
    H : ndarray of shape (n_points, n)
    power : ndarray of shape (n_points,)
        P, above 0.
    tie : array_like of shape (n, n) or ()
        T, what holds theta where no point does.

    References
    ----------
    McCullagh, Nelder, "Generalized linear models", 1989, chapter 8.
    """
    T = np.broadcast_to(tie, (H.shape[1], H.shape[1]))
    solve = np.linalg.pinv(H.T @ H + T)
    theta = solve @ (H.T @ np.log(power))
    for _ in range(12):  # it has settled to 1e-3 after about 8
        step = np.minimum(power * np.exp(-H @ theta) - 1, 2.0)
        theta = theta + solve @ (H.T @ step - T @ theta)
    return np.asarray(theta)


@njit(cache=True, error_model="numpy")
def cell(nodes, x):  # type: ignore[no-untyped-def]
    """Return the node below x, the one above, and the share of the latter; held at both ends, all warped."""
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
    """Add the values of the corners around each point, each with its share."""
    n = len(axes)
    below, above, share = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n)
    for t in range(len(points)):
        for i in range(n):
            below[i], above[i], share[i] = cell(axes[i], points[t, i])
        for corner in range(1 << n):
            weight, node = 1.0, 0
            for i in range(n):
                up = (corner >> i) & 1
                weight *= share[i] if up else 1.0 - share[i]
                node = node * axes[i].size + (above[i] if up else below[i])
            if weight > 0.0:
                for m in range(out.shape[1]):
                    out[t, m] += weight * values[node, m]
