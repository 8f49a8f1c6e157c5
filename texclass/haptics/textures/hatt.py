"""Define HaTT textures: ARMA models at the nodes of a triangulated mesh of speeds and forces.

With white noise e of unit variance, the states b_m of the normalised lattice of A are uncorrelated and have
unit variance: b_m = prod_{j > m} c_j Ã_m / A e, where Ã_m(z) = z^-m A_m(1/z). Expanding the MA part in terms
of Ã_m,

    C(z) = sum_m nu_m prod_{j > m} c_j Ã_m(z),    C / A e = sum_m nu_m b_m,

gives a filter (Gray and Markel, "Digital lattice and ladder filter synthesis", 1973) whose states stay
bounded and whose output has the RMS |nu| at every sample, even while k and nu change.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import Delaunay

from texclass.compilation import njit
from texclass.haptics.textures.contract import Texture, freeze
from texclass.haptics.textures.motion_renderer import MotionRenderer
from texclass.recording import Samples
from texclass.signals import positive
from texclass.vibration import line_spectrum

PEAK_FACTOR = 8.0
"""Limit of rendered samples, as a multiple of the RMS of the loudest node."""
MAX_ORDER = 1000
MAX_WORK = 500_000_000
"""Largest n_nodes (p^2 + q^2), which limits the time to validate a file to a few seconds."""
MAX_TRIANGLES = 20_000
"""Largest number of triangles; all triangles are searched for each point."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh over speed and force. The mesh is frozen, and its arrays are read-only.

    Parameters
    ----------
    speed : array_like of shape (n_nodes,)
        Speed of the nodes in mm/s, at least 0.
    force : array_like of shape (n_nodes,)
        Force of the nodes in N, at least 0.
    triangles : array_like of shape (n_triangles, 3)
        Indices (from 0) of the nodes at the corners. At least one triangle is required, and each must have a
        positive area.

    Raises
    ------
    ValueError
        If a shape or a value is not valid.
    """

    speed: Samples
    force: Samples
    triangles: NDArray[np.integer | np.floating]

    def __post_init__(self) -> None:
        freeze(self, speed=("n_nodes",), force=("n_nodes",), triangles=("n_triangles", 3))
        for name in ("speed", "force"):
            if np.any(getattr(self, name) < 0):
                raise ValueError(f"{name} of the nodes must be at least 0, got {getattr(self, name).min():g}")
        n, indices = self.speed.size, self.triangles
        if not 0 < len(indices) <= MAX_TRIANGLES:
            raise ValueError(
                f"triangles must have shape (n, 3) with n between 1 and {MAX_TRIANGLES}, got {indices.shape}"
            )
        is_invalid = ~((indices >= 0) & (indices < n) & (indices == np.floor(indices)))
        if is_invalid.any():
            raise ValueError(
                f"triangles must contain node indices from 0 to {n - 1}, got {indices[is_invalid][0]:g}"
            )
        corners = indices.astype(np.int64)
        corners.setflags(write=False)
        object.__setattr__(self, "triangles", corners)
        flat = np.flatnonzero(~(np.abs(_doubled_areas(self.points[corners])) > 1e-12))
        if flat.size:
            raise ValueError(
                f"triangles must have a positive area, got triangle {flat[0]} {corners[flat[0]].tolist()}"
            )

    @cached_property
    def points(self) -> Samples:
        """Nodes (n_nodes, 2) as fractions of the largest speed and the largest force."""
        return np.column_stack([self.speed, self.force]) / self.largest

    @cached_property
    def largest(self) -> tuple[float, float]:
        """Largest speed (mm/s) and force (N) of the nodes; 1 if all are 0."""
        return float(self.speed.max(initial=0.0)) or 1.0, float(self.force.max(initial=0.0)) or 1.0

    def weights(self, speed: ArrayLike, force: ArrayLike) -> tuple[NDArray[np.int64], Samples]:
        """Return three nodes and their barycentric weights (non-negative, sum 1) at each point.

        Outside all triangles, the nearest point on an edge is used, with distances in the plane of `points`.

        Parameters
        ----------
        speed, force : array_like of shape (...)
            Speed in mm/s and force in N.

        Returns
        -------
        nodes : ndarray of int, shape (..., 3)
            Indices of the nodes.
        weights : ndarray of shape (..., 3)
            Weight of each node.
        """
        query = np.stack([np.ravel(speed), np.ravel(force)], axis=1) / self.largest
        nodes, weights = np.zeros((len(query), 3), dtype=np.int64), np.zeros((len(query), 3))
        _locate(query, self.points, self.triangles, nodes, weights)
        shape = (*np.shape(speed), 3)
        return nodes.reshape(shape), weights.reshape(shape)


N_SIDE = 6
"""Number of nodes on each side of the border of a mesh, as in the published files."""


def triangulate(speed: ArrayLike, force: ArrayLike) -> tuple[Mesh, NDArray[np.int64]]:
    """Triangulate models and a border around them; return the mesh and the model index of each node.

    The border is the rectangle from zero to the largest speed and force, with six nodes per side. Each border
    node uses the model of the nearest point. The published files have the same border, because their renderer
    only handles points inside the rectangle.

    Parameters
    ----------
    speed, force : array_like of shape (n,)
        Speed (mm/s) and force (N) of at least one model; non-negative, and the largest of each positive.

    Returns
    -------
    mesh : Mesh
        Mesh whose first n nodes are the models.
    source : ndarray of int, shape (n_nodes,)
        Index of the model of each node.

    Raises
    ------
    ValueError
        If a value is negative or not finite, or the largest speed or force is 0.

    Examples
    --------
    >>> mesh, source = triangulate([50.0, 150.0], [1.0, 2.0])
    >>> mesh.speed.size, source[:2].tolist()
    (21, [0, 1])
    """
    points = np.column_stack([np.ravel(speed), np.ravel(force)]).astype(np.float64)
    top = points.max(axis=0, initial=0.0)
    if not (np.all(np.isfinite(points) & (points >= 0)) and np.all(top > 0)):
        raise ValueError(
            f"speeds and forces must be finite, at least 0, and with positive maxima, got {top.tolist()}"
        )
    scaled = points / top
    side = np.linspace(0.0, 1.0, N_SIDE)
    border = np.array([(x, y) for x in side for y in side if x in (0.0, 1.0) or y in (0.0, 1.0)])
    distance = np.linalg.norm(border[:, np.newaxis] - scaled, axis=2)
    is_new = distance.min(axis=1) > 1e-6
    source = np.concatenate([np.arange(len(points)), distance[is_new].argmin(axis=1)])
    scaled_nodes = np.concatenate([scaled, border[is_new]])
    triangles = Delaunay(scaled_nodes).simplices
    has_area = np.abs(_doubled_areas(scaled_nodes[triangles])) > 1e-9
    nodes = np.concatenate([points, border[is_new] * top])
    return Mesh(nodes[:, 0], nodes[:, 1], triangles[has_area].astype(np.int64)), source


def _doubled_areas(corners: Samples) -> Samples:
    """Return twice the signed area of triangles (n, 3, 2)."""
    return np.asarray(np.linalg.det(np.diff(corners, axis=1)))


@njit(cache=True, error_model="numpy")
def _locate(query, points, triangles, nodes, weights):  # type: ignore[no-untyped-def]
    """Write nodes and weights at each query point, inside a triangle or on the nearest edge."""
    for i in range(len(query)):
        (x, y), nearest = query[i], np.inf
        for a, b, c in triangles:
            (ax, ay), (bx, by), (cx, cy) = points[a], points[b], points[c]
            area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            wb = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
            wc = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
            if wb >= 0.0 and wc >= 0.0 and wb + wc <= 1.0:
                nodes[i] = a, b, c
                weights[i] = max(1.0 - wb - wc, 0.0), wb, wc
                break
            for first, second in ((a, b), (b, c), (c, a)):
                (px, py), (qx, qy) = points[first], points[second]
                dx, dy = qx - px, qy - py
                w = min(max(((x - px) * dx + (y - py) * dy) / (dx * dx + dy * dy), 0.0), 1.0)
                distance = (x - px - w * dx) ** 2 + (y - py - w * dy) ** 2
                if distance < nearest:
                    nearest = distance
                    nodes[i] = first, second, first
                    weights[i] = 1.0 - w, w, 0.0


@dataclass(frozen=True, eq=False)
class HattTexture(Texture):
    """ARMA models at nodes of speed and force, with linear interpolation of line spectra, variance and gain.

    The vibration at a node is y = -sum_i a_i y[t-i] + gain (e[t] + sum_i c_i e[t-i]), with white noise e.

    Parameters
    ----------
    mesh : Mesh
        Nodes in mm/s and N, and triangles.
    ar_lsf : array_like of shape (n_nodes, p)
        Line spectral frequencies of A in rad per sample, strictly increasing, in (0, pi).
    ma_lsf : array_like of shape (n_nodes, q)
        Line spectral frequencies of C in rad per sample; q may be 0.
    variance : array_like of shape (n_nodes,)
        Variance of the noise e in (m/s^2)^2, at least 0.
    gain : array_like of shape (n_nodes,)
        Gain of the MA part, at least 0.
    fs : float
        Sampling rate in Hz (1000 in the published textures).
    name : str, optional
        Name of the surface.
    mu : float
        Kinetic friction coefficient, at least 0 (default 0).

    Raises
    ------
    ValueError
        If a shape or a value is not valid.

    References
    ----------
    Culbertson, Lopez Delgado, Kuchenbecker, "One hundred data-driven haptic texture models and open-source
    methods for rendering on 3D objects", 2014.

    Notes
    -----
    Our choices where the published description is incomplete:

    - Outside the triangles, the nearest point on an edge is used.
    - At zero speed or force the texture is silent, regardless of the models at the nodes.
    - Parameters change linearly to their new values within 10 ms.
    - A lattice replaces the direct form, whose output is unbounded while its coefficients change.

    Examples
    --------
    >>> texture = HattTexture.from_models([100.0], [1.0], [[1.0, 2.0]], [0.25], fs=1000.0)
    >>> k, taps = texture.at(100.0, 1.0)
    >>> k.round(3).tolist(), texture.at(0.0, 1.0)[1].tolist()
    ([-0.119, 0.044], [0.0])
    """

    family: ClassVar[str] = "hatt"
    mesh: Mesh
    ar_lsf: Samples
    ma_lsf: Samples
    variance: Samples
    gain: Samples
    fs: float
    name: str = ""
    mu: float = 0.0

    def __post_init__(self) -> None:
        n, nodes = self.mesh.speed.size, (self.mesh.speed.size,)
        freeze(self, ar_lsf=(*nodes, "p"), ma_lsf=(*nodes, "q"), variance=nodes, gain=nodes)
        positive(self.fs, "fs")
        p, q = self.order, self.ma_order
        if not (1 <= p <= MAX_ORDER and q <= MAX_ORDER):
            raise ValueError(
                f"the AR order must be 1 to {MAX_ORDER} and the MA order 0 to {MAX_ORDER}, got {p} and {q}"
            )
        if n * (p**2 + q**2) > MAX_WORK:
            raise ValueError(
                f"n_nodes (p^2 + q^2) must be at most {MAX_WORK}, got {n} nodes of orders {p} and {q}"
            )
        for name in ("mu", "variance", "gain"):
            lowest = np.min(getattr(self, name))
            if not 0 <= lowest < np.inf:
                raise ValueError(f"{name} must be finite and at least 0, got {lowest}")
        for name in ("ar_lsf", "ma_lsf")[: 2 if q else 1]:
            gaps = np.diff(getattr(self, name), axis=1, prepend=0.0, append=np.pi)
            narrow = np.argwhere(gaps < line_spectrum.MIN_GAP)
            if narrow.size:
                node, i = narrow[0]
                raise ValueError(
                    f"{name} of node {node} has a gap of {gaps[node, i]:.3g} rad at position {i}. Expected "
                    "a stable model: increasing values in (0, pi) with gaps of at least "
                    f"{line_spectrum.MIN_GAP:g} rad"
                )
        if not np.all(np.isfinite(self.levels)):
            raise ValueError("the RMS of each node must be finite, got infinity")

    @classmethod
    def from_models(
        cls,
        speed: ArrayLike,
        force: ArrayLike,
        ar_lsf: ArrayLike,
        variance: ArrayLike,
        fs: float,
        *,
        ma_lsf: ArrayLike | None = None,
        gain: ArrayLike | None = None,
        name: str = "",
        mu: float = 0.0,
    ) -> Self:
        """Create a texture from models at arbitrary speeds and forces by triangulation.

        Parameters
        ----------
        speed, force : array_like of shape (n,)
            Speed (mm/s) and force (N) of each model.
        ar_lsf : array_like of shape (n, p)
            Line spectral frequencies in rad per sample.
        variance : array_like of shape (n,)
            Variance of the innovation.
        fs : float
            Sampling rate in Hz.
        ma_lsf : array_like of shape (n, q), optional
            Line spectral frequencies of the MA part (default: pure AR models).
        gain : array_like of shape (n,), optional
            Gain of the MA part (default 1).
        name, mu
            Name of the surface and kinetic friction coefficient; see `HattTexture`.

        Raises
        ------
        ValueError
            If the lengths differ, `triangulate` rejects the speeds and forces, or a model is invalid.
        """
        mesh, source = triangulate(speed, force)
        ar, s2 = np.asarray(ar_lsf, dtype=np.float64), np.asarray(variance, dtype=np.float64)
        ma = np.zeros((len(ar), 0)) if ma_lsf is None else np.asarray(ma_lsf, dtype=np.float64)
        g = np.ones(len(ar)) if gain is None else np.asarray(gain, dtype=np.float64)
        if {ar.shape[:1], ma.shape[:1], s2.shape, g.shape} != {np.shape(np.ravel(speed))}:
            raise ValueError(
                "speed, ar_lsf, variance, ma_lsf and gain must have the same length, "
                f"got {np.size(speed)} speeds, ar_lsf {ar.shape}, variance {s2.shape}, ma_lsf {ma.shape}, "
                f"gain {g.shape}"
            )
        is_stroke = (mesh.speed > 0) & (mesh.force > 0)
        silent = np.where(is_stroke, s2[source], 0.0)
        return cls(mesh, ar[source], ma[source], silent, g[source], fs, name, mu)

    @cached_property
    def speeds(self) -> Samples:
        """Speeds of the models in mm/s, increasing, without the border of the mesh."""
        return self._values_of_models(self.mesh.speed)

    @cached_property
    def forces(self) -> Samples:
        """Forces of the models in N, increasing, without the border of the mesh."""
        return self._values_of_models(self.mesh.force)

    def _values_of_models(self, values: Samples) -> Samples:
        """Return the values (n,) of the models; without a model of a stroke, those of all nodes above 0."""
        of_models = values[self._is_model]
        return np.unique(of_models if of_models.size else values[values > 0])

    @property
    def _is_model(self) -> NDArray[np.bool_]:
        """Whether each node (n,) is a model at a positive speed and force, and no copy of one on the border.

        Files do not mark the border of `triangulate`; its nodes repeat another model.
        """
        scaled = np.column_stack([self.mesh.speed, self.mesh.force]) / self.mesh.largest
        is_on_side = np.any((scaled == 0) | (scaled == 1), axis=1)
        steps = (N_SIDE - 1) * scaled
        is_on_border = is_on_side & np.all(np.abs(steps - np.rint(steps)) < 1e-6, axis=1)
        is_stroke = np.all(scaled > 0, axis=1)
        rows = np.column_stack([self.ar_lsf, self.ma_lsf, self.variance, self.gain])
        inner_first = np.argsort(is_on_border, kind="stable")
        inner_first = inner_first[is_stroke[inner_first]]
        _, first = np.unique(rows[inner_first], axis=0, return_index=True)
        is_model = is_stroke & ~is_on_border
        is_model[inner_first[first]] = True
        return np.asarray(is_model)

    @property
    def order(self) -> int:
        """Order p of the AR part."""
        return int(self.ar_lsf.shape[1])

    @property
    def ma_order(self) -> int:
        """Order q of the MA part."""
        return int(self.ma_lsf.shape[1])

    @property
    def hop(self) -> int:
        """Number of samples between two parameter updates: 10 ms, as in the toolkit."""
        return max(1, round(0.01 * self.fs))

    @property
    def operations(self) -> float:
        """Operations per sample: lattice, ladder, linear parameter changes and updates."""
        p, q = max(self.order, self.ma_order), self.ma_order
        return 11.0 * p + 4.0 * (q + 1) + (4.0 * self.order**2 + 7.0 * q**2) / self.hop

    @cached_property
    def levels(self) -> Samples:
        """RMS of the vibration at each node in m/s^2, shape (n_nodes,)."""
        with np.errstate(over="ignore", invalid="ignore"):
            level = self.gain * np.sqrt(self.variance)
            return np.asarray(np.linalg.norm(_filters(self.ar_lsf, self.ma_lsf, level)[1], axis=1))

    def at(self, speed: float, force: float) -> tuple[Samples, Samples]:
        """Return the lattice parameters at a speed (mm/s) and force (N).

        Returns
        -------
        reflection : ndarray of shape (max(p, q),)
            Reflection coefficients of A, padded with zeros beyond p.
        taps : ndarray of shape (q + 1,)
            Weights nu_m in m/s^2, whose norm is the RMS of the vibration. All weights are 0 at zero speed or
            force.
        """
        k, taps = self._parameters(np.array([[speed, 0.0]]), np.array([force]))
        return k[0], taps[0]

    def _parameters(self, velocity: Samples, force: Samples) -> tuple[Samples, Samples]:
        """Return reflection coefficients (n, max(p, q)) and taps (n, q + 1) at velocities and forces."""
        speed = np.hypot(velocity[:, 0], velocity[:, 1])
        nodes, weights = self.mesh.weights(speed, np.maximum(force, 0.0))

        def interpolate(values: Samples) -> Samples:
            return np.asarray(np.einsum("ni,ni...->n...", weights, values[nodes]))

        level = np.where(
            (speed > 0) & (force > 0), interpolate(self.gain) * np.sqrt(interpolate(self.variance)), 0.0
        )
        return _filters(interpolate(self.ar_lsf), interpolate(self.ma_lsf), level)

    def renderer(self, *, seed: int = 0) -> MotionRenderer:
        """Return a renderer that is silent without motion or contact; `seed` is the seed of the noise."""
        return MotionRenderer(
            lambda motion: self._parameters(motion[:, :2], motion[:, 2]),
            fs=self.fs,
            order=max(self.order, self.ma_order),
            n_taps=self.ma_order + 1,
            hop=self.hop,
            limit=PEAK_FACTOR * float(self.levels.max()),
            seed=seed,
        )


def _filters(ar_lsf: Samples, ma_lsf: Samples, level: Samples) -> tuple[Samples, Samples]:
    """Return k (n, max(p, q)) and nu (n, q + 1) from line spectra (n, p), (n, q) and noise levels (n,)."""
    p, q = ar_lsf.shape[1], ma_lsf.shape[1]
    k, nu = np.zeros((level.size, max(p, q))), np.zeros((level.size, q + 1))
    k[:, :p] = line_spectrum.to_reflection(ar_lsf)
    # same memory layout with and without an MA part; another layout would be compiled separately
    _ladder(k, line_spectrum.to_reflection(ma_lsf) if q else np.zeros((level.size, 0)), level, nu)
    return k, nu


@njit(cache=True, error_model="numpy")
def _ladder(k, numerator, level, nu):  # type: ignore[no-untyped-def]
    """Write the taps nu (n, q + 1) for lattices k (n, q or more), MA parts (n, q) and noise levels (n,)."""
    q = numerator.shape[1]
    for row in range(level.size):
        A, rest = _polynomials(k[row], q), _polynomials(numerator[row], q)[q]
        log_c = 0.5 * (np.log1p(k[row, q:]) + np.log1p(-k[row, q:])).sum()
        for m in range(q, -1, -1):
            value = rest[m]
            for i in range(m + 1):
                rest[i] -= value * A[m, m - i]
            nu[row, m] = level[row] * value * np.exp(-log_c)
            if m > 0:
                log_c += 0.5 * (np.log1p(k[row, m - 1]) + np.log1p(-k[row, m - 1]))


@njit(cache=True, error_model="numpy")
def _polynomials(k, q):  # type: ignore[no-untyped-def]
    """Return the polynomials A_0 ... A_q of reflection coefficients k, one per row: a_i + k_m a_{m-i}."""
    A = np.zeros((q + 1, q + 1))
    A[0, 0] = 1.0
    for m in range(1, q + 1):
        for i in range(m + 1):
            A[m, i] = A[m - 1, i] + k[m - 1] * A[m - 1, m - i]
    return A
