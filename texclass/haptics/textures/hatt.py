"""A texture of ARMA models, one at each node of a mesh of speeds and forces, and how it is rendered.

With white noise e of unit variance the states b_m of the normalised lattice of A are uncorrelated and of unit
variance, b_m = prod_{j > m} c_j Ã_m / A e, where Ã_m(z) = z^-m A_m(1/z). Expanding the MA part in them,

    C(z) = sum_m nu_m prod_{j > m} c_j Ã_m(z),    C / A e = sum_m nu_m b_m,

gives a filter (Gray and Markel, "Digital lattice and ladder filter synthesis", 1973) whose states stay
bounded and whose output has the RMS |nu| at every sample, even while k and nu move.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import Delaunay

from texclass.haptics.textures.contract import Texture, freeze
from texclass.haptics.textures.motion_renderer import MotionRenderer
from texclass.recording import Samples
from texclass.signals import positive
from texclass.vibration import line_spectrum

LIMIT = 8.0
"""Rendered samples are held within this times the RMS of the loudest node."""
LARGEST_ORDER = 1000
MOST_WORK = 500_000_000
"""Largest n_nodes (p^2 + q^2): a hostile file ends within seconds."""
MOST_TRIANGLES = 20_000
"""All are looked at for each point."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Nodes and triangles. Frozen; its arrays are read-only.

    Parameters
    ----------
    speed : array_like of shape (n_nodes,)
        mm/s, at least 0.
    force : array_like of shape (n_nodes,)
        N, at least 0.
    triangles : array_like of shape (n_triangles, 3)
        Nodes at the corners, counted from 0; at least one triangle, none without an area.

    Raises
    ------
    ValueError
        If a shape does not fit or a rule is broken; the message names which.
    """

    speed: Samples
    force: Samples
    triangles: NDArray[np.integer | np.floating]

    def __post_init__(self) -> None:
        freeze(self, speed=("n_nodes",), force=("n_nodes",), triangles=("n_triangles", 3))
        for name in ("speed", "force"):
            if np.any(getattr(self, name) < 0):
                raise ValueError(f"{name} of a node is {getattr(self, name).min()}. Expected >= 0")
        n, found = self.speed.size, self.triangles
        if not 0 < len(found) <= MOST_TRIANGLES:
            raise ValueError(
                f"triangles have shape {found.shape}. Expected (n, 3), n in 1 ... {MOST_TRIANGLES}"
            )
        wrong = ~((found >= 0) & (found < n) & (found == np.floor(found)))
        if wrong.any():
            raise ValueError(f"a corner is node {found[wrong][0]:g} of {n}. Expected one of them")
        corners = found.astype(np.int64)
        corners.setflags(write=False)
        object.__setattr__(self, "triangles", corners)
        flat = np.flatnonzero(~(np.abs(_doubled_areas(self.points[corners])) > 1e-12))
        if flat.size:
            raise ValueError(f"triangle {flat[0]} {corners[flat[0]].tolist()} has no area. Expected one")

    @cached_property
    def points(self) -> Samples:
        """Nodes (n_nodes, 2) as shares of the largest speed and the largest force."""
        return np.column_stack([self.speed, self.force]) / self.largest

    @cached_property
    def largest(self) -> tuple[float, float]:
        """Largest speed (mm/s) and force (N) of a node; 1 where all are 0."""
        return float(self.speed.max(initial=0.0)) or 1.0, float(self.force.max(initial=0.0)) or 1.0

    def weights(self, speed: ArrayLike, force: ArrayLike) -> tuple[NDArray[np.int64], Samples]:
        """Return three nodes and their barycentric coordinates (at least 0, 1 in sum) at each point.

        Outside all triangles they are those of the nearest point of an edge, in the plane of `points`.

        Parameters
        ----------
        speed, force : array_like of shape (...)
            mm/s and N.

        Returns
        -------
        nodes : ndarray of int, shape (..., 3)
        weights : ndarray of shape (..., 3)
        """
        at = np.stack([np.ravel(speed), np.ravel(force)], axis=1) / self.largest
        nodes, weights = np.zeros((len(at), 3), dtype=np.int64), np.zeros((len(at), 3))
        _locate(at, self.points, self.triangles, nodes, weights)
        shape = (*np.shape(speed), 3)
        return nodes.reshape(shape), weights.reshape(shape)


def triangulate(speed: ArrayLike, force: ArrayLike) -> tuple[Mesh, NDArray[np.int64]]:
    """Return the Delaunay triangulation of models and of the border around them, and whose model a node has.

    The border is the rectangle from rest to the largest speed and force, six nodes a side; each takes
    the model of the nearest given point. The published files have it too: their renderer walks through the
    triangles of that rectangle and leaves it nowhere.

    Parameters
    ----------
    speed, force : array_like of shape (n,)
        Of the models, mm/s and N, at least 0, the largest of each above 0; n at least 1.

    Returns
    -------
    mesh : Mesh
        The given points come first.
    source : ndarray of int, shape (n_nodes,)
        Whose model each node has.

    Raises
    ------
    ValueError
        If a value is not finite, negative, or the largest speed or force is 0.
    """
    given = np.column_stack([np.ravel(speed), np.ravel(force)]).astype(np.float64)
    top = given.max(axis=0, initial=0.0)
    if not (np.all(np.isfinite(given) & (given >= 0)) and np.all(top > 0)):
        raise ValueError(
            f"speeds and forces reach {top.tolist()}. Expected a finite number of at least 0, largest above 0"
        )
    scaled = given / top
    side = np.linspace(0.0, 1.0, 6)
    border = np.array([(x, y) for x in side for y in side if x in (0.0, 1.0) or y in (0.0, 1.0)])
    away = np.linalg.norm(border[:, np.newaxis] - scaled, axis=2)
    new = away.min(axis=1) > 1e-6
    source = np.concatenate([np.arange(len(given)), away[new].argmin(axis=1)])
    points = np.concatenate([scaled, border[new]])
    triangles = Delaunay(points).simplices
    sound = np.abs(_doubled_areas(points[triangles])) > 1e-9
    nodes = np.concatenate([given, border[new] * top])
    return Mesh(nodes[:, 0], nodes[:, 1], triangles[sound].astype(np.int64)), source


def _doubled_areas(corners: Samples) -> Samples:
    """Return twice the signed area of triangles (n, 3, 2)."""
    return np.asarray(np.linalg.det(np.diff(corners, axis=1)))


@njit(cache=True, error_model="numpy")
def _locate(at, points, triangles, nodes, weights):  # type: ignore[no-untyped-def]
    """Write the nodes and weights at each place: inside a triangle, or on the nearest edge."""
    for i in range(len(at)):
        (x, y), nearest = at[i], np.inf
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
    """ARMA models at nodes of speed and force; between them line spectra, variance and gain go linearly.

    At each node y = -sum_i a_i y[t-i] + gain (e[t] + sum_i c_i e[t-i]) with white noise e of its variance.

    Parameters
    ----------
    mesh : Mesh
        Nodes in mm/s and N, and triangles.
    ar_lsf : array_like of shape (n_nodes, p)
        Line spectral frequencies of A, rad per sample, strictly increasing, in (0, pi).
    ma_lsf : array_like of shape (n_nodes, q)
        Of C, the same rule; q may be 0.
    variance : array_like of shape (n_nodes,)
        Of the noise e, (m/s^2)^2, at least 0.
    gain : array_like of shape (n_nodes,)
        Of the MA part, at least 0.
    fs : float
        Hz; the published textures have 1000 Hz.
    name : str, optional
        Of the surface.
    mu : float
        Coefficient of kinetic friction, at least 0.

    Raises
    ------
    ValueError
        If a shape does not fit or a rule is broken; the message names which.

    References
    ----------
    Culbertson, Lopez Delgado, Kuchenbecker, "One hundred data-driven haptic texture models and open-source
    methods for rendering on 3D objects", 2014.

    Notes
    -----
    Our readings: outside the triangles the nearest point of an edge holds; at rest and without contact it is
    silent, whatever the nodes say; parameters glide from one aim to the next, 10 ms later; the lattice
    replaces the direct form, whose changing coefficients are bounded by nothing.
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
        if not (1 <= p <= LARGEST_ORDER and q <= LARGEST_ORDER):
            raise ValueError(f"orders are {p} (AR) and {q} (MA). Expected 1 ... and 0 ... {LARGEST_ORDER}")
        if n * (p**2 + q**2) > MOST_WORK:
            raise ValueError(f"{n} nodes of orders {p} and {q}. Expected n (p^2 + q^2) <= {MOST_WORK}")
        for name in ("mu", "variance", "gain"):
            lowest = np.min(getattr(self, name))
            if not 0 <= lowest < np.inf:
                raise ValueError(f"{name} is {lowest}. Expected a finite number of at least 0 (at each node)")
        for name in ("ar_lsf", "ma_lsf")[: 2 if q else 1]:
            gaps = np.diff(getattr(self, name), axis=1, prepend=0.0, append=np.pi)
            narrow = np.argwhere(gaps < line_spectrum.MIN_GAP)
            if narrow.size:
                node, i = narrow[0]
                raise ValueError(
                    f"{name} of node {node} has a gap of {gaps[node, i]:.3g} at place {i}. Expected "
                    f"rising in (0, pi), gaps of at least {line_spectrum.MIN_GAP:g} rad: a stable model"
                )
        if not np.all(np.isfinite(self.levels)):
            raise ValueError("the RMS of a node exceeds a float. Expected a finite one")

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
        """Return the texture of models at any speeds and forces, triangulated, silent at rest.

        Parameters
        ----------
        speed, force : array_like of shape (n,)
            mm/s and N, of each model.
        ar_lsf : array_like of shape (n, p)
            Line spectral frequencies, rad per sample.
        variance : array_like of shape (n,)
            Of the innovation.
        fs : float
            Hz.
        ma_lsf : array_like of shape (n, q), optional
            None by default: AR models.
        gain : array_like of shape (n,), optional
            Of the MA part, 1 by default.
        name, mu
            As for the class.

        Raises
        ------
        ValueError
            As `triangulate` and the class.
        """
        mesh, source = triangulate(speed, force)
        ar, s2 = np.asarray(ar_lsf, dtype=np.float64), np.asarray(variance, dtype=np.float64)
        ma = np.zeros((len(ar), 0)) if ma_lsf is None else np.asarray(ma_lsf, dtype=np.float64)
        g = np.ones(len(ar)) if gain is None else np.asarray(gain, dtype=np.float64)
        if {ar.shape[:1], ma.shape[:1], s2.shape, g.shape} != {np.shape(np.ravel(speed))}:
            raise ValueError(f"ar_lsf has shape {ar.shape}, variance {s2.shape}. Expected one row a speed")
        touching = (mesh.speed > 0) & (mesh.force > 0)
        silent = np.where(touching, s2[source], 0.0)
        return cls(mesh, ar[source], ma[source], silent, g[source], fs, name, mu)

    @cached_property
    def speeds(self) -> Samples:
        """Speeds of the nodes that move, mm/s."""
        return np.unique(self.mesh.speed[self.mesh.speed > 0])

    @cached_property
    def forces(self) -> Samples:
        """Forces of the nodes in contact, N."""
        return np.unique(self.mesh.force[self.mesh.force > 0])

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
        """Samples between two aims of the parameters: 10 ms, as in the toolkit."""
        return max(1, round(0.01 * self.fs))

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample: lattice, ladder, the glide, and each aim by its hop."""
        p, q = max(self.order, self.ma_order), self.ma_order
        return 11.0 * p + 4.0 * (q + 1) + (4.0 * self.order**2 + 7.0 * q**2) / self.hop

    @cached_property
    def levels(self) -> Samples:
        """RMS of the vibration at each node, m/s^2, shape (n_nodes,)."""
        with np.errstate(over="ignore", invalid="ignore"):
            level = self.gain * np.sqrt(self.variance)
            return np.asarray(np.linalg.norm(_filters(self.ar_lsf, self.ma_lsf, level)[1], axis=1))

    def at(self, speed: float, force: float) -> tuple[Samples, Samples]:
        """Return the lattice at a speed (mm/s) and force (N).

        Returns
        -------
        reflection : ndarray of shape (max(p, q),)
            Of A, zeros beyond p.
        taps : ndarray of shape (q + 1,)
            nu_m in m/s^2; their norm is the RMS. Zeros at rest and without contact.
        """
        k, taps = self._read(np.array([[speed, 0.0]]), np.array([force]))
        return k[0], taps[0]

    def _read(self, velocity: Samples, force: Samples) -> tuple[Samples, Samples]:
        """Return reflection coefficients (n, max(p, q)) and taps (n, q + 1) at velocities and forces."""
        speed = np.hypot(velocity[:, 0], velocity[:, 1])
        nodes, weights = self.mesh.weights(speed, np.maximum(force, 0.0))

        def mixed(values: Samples) -> Samples:
            return np.asarray(np.einsum("ni,ni...->n...", weights, values[nodes]))

        level = np.where((speed > 0) & (force > 0), mixed(self.gain) * np.sqrt(mixed(self.variance)), 0.0)
        return _filters(mixed(self.ar_lsf), mixed(self.ma_lsf), level)

    def renderer(self, *, seed: int = 0) -> MotionRenderer:
        """Return a renderer at rest, silent there and without contact; the seed is that of the noise."""
        return MotionRenderer(
            lambda course: self._read(course[:, :2], course[:, 2]),
            fs=self.fs,
            order=max(self.order, self.ma_order),
            n_taps=self.ma_order + 1,
            hop=self.hop,
            limit=LIMIT * float(self.levels.max()),
            seed=seed,
        )


def _filters(ar_lsf: Samples, ma_lsf: Samples, level: Samples) -> tuple[Samples, Samples]:
    """Return k (n, max(p, q)) and nu (n, q + 1) of line spectra (n, p), (n, q) and noise of a level (n,)."""
    p, q = ar_lsf.shape[1], ma_lsf.shape[1]
    k, nu = np.zeros((level.size, max(p, q))), np.zeros((level.size, q + 1))
    k[:, :p] = line_spectrum.to_reflection(ar_lsf)
    # of one kind of array with and without an MA part: another would be compiled for by itself
    _ladder(k, line_spectrum.to_reflection(ma_lsf) if q else np.zeros((level.size, 0)), level, nu)
    return k, nu


@njit(cache=True, error_model="numpy")
def _ladder(k, numerator, level, nu):  # type: ignore[no-untyped-def]
    """Write the taps nu (n, q + 1) of lattices k (n, q or more), MA parts (n, q) and levels of noise (n,)."""
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
    """Return A_0 ... A_q of the reflection coefficients k, one a row: a_i + k_m a_{m-i}."""
    A = np.zeros((q + 1, q + 1))
    A[0, 0] = 1.0
    for m in range(1, q + 1):
        for i in range(m + 1):
            A[m, i] = A[m - 1, i] + k[m - 1] * A[m - 1, m - i]
    return A
