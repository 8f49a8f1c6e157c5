"""Register scans with triangle meshes: a smooth surface, and a profile on it.

A triangle mesh has facets, at whose edges the normal jumps. Contact forces need a surface with a continuous
normal. The surface is therefore the zero set of a weighted mean of the signed distances to the planes of
nearby triangles (implicit moving least squares), with interpolated vertex normals::

    f(x) = sum_i w_i n_i (x - c_i) / sum_i w_i,    w_i = a_i (1 - |x - c_i|^2 / r^2)^4 for |x - c_i| < r

where a_i, c_i and n_i are area, centre and normal of the triangles, and r is the smoothing radius. The
gradient of f is exact and continuous, and f is positive outside. Large triangles are divided into cells.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from texclass import signals
from texclass.haptics.textures.contract import freeze
from texclass.haptics.textures.guruswamy2011.fit import PATH_CUTOFF_HZ
from texclass.haptics.textures.scan import Scan
from texclass.recording import Samples
from texclass.signals import all_finite, positive

if TYPE_CHECKING:
    import trimesh

SHARP_ANGLE = np.radians(40)
"""Angle between triangles in rad above which normals are not interpolated across their edge (our choice)."""
MAX_CELLS = 4_000_000
"""Largest number of cells of a surface, which limits the memory to about 1 GB."""
NEWTON_STEPS = 20
"""Largest number of steps of a projection, which usually needs three."""
PROFILE_STEP_MM = 2.0
"""Distance between the points of a profile in mm (our choice). The noise of a tracker turns shorter segments,
which shifts positions at the side of the profile."""


@dataclass(frozen=True, eq=False)
class MeshSurface:
    """A smooth surface through the triangles of a mesh; create it with `from_mesh`.

    Attributes
    ----------
    centre, normal : ndarray of shape (n_cells, 3)
        Centres in mm and outward unit normals of the cells.
    area : ndarray of shape (n_cells,)
        Areas of the cells in mm^2.
    radius_mm : float
        Smoothing radius in mm. Edges are rounded over this distance.

    References
    ----------
    `guruswamy2011`, section III-A. The paper does not specify how the force changes between triangles.
    """

    centre: Samples
    normal: Samples
    area: Samples
    radius_mm: float
    _tree: KDTree = field(init=False, repr=False)

    def __post_init__(self) -> None:
        positive(self.radius_mm, "radius_mm")
        freeze(self, centre=("n", 3), normal=("n", 3), area=("n",))
        object.__setattr__(self, "_tree", KDTree(self.centre))

    @classmethod
    def from_mesh(cls, mesh: "trimesh.Trimesh", *, smoothing_mm: float = 2.0) -> Self:
        """Create the surface of a mesh, for example of `trimesh.load_mesh("part.stl")`.

        Triangles are divided into cells of at most half the smoothing radius. Normals are interpolated across
        edges of less than 40 degrees.

        Parameters
        ----------
        mesh : trimesh.Trimesh
            Triangle mesh in mm with outward normals. Parts must be thicker than the smoothing radius.
        smoothing_mm : float
            Smoothing radius in mm (default 2). Facets that are larger than the radius remain perceptible.

        Raises
        ------
        ValueError
            If the mesh has no area, or `smoothing_mm` is too small for its size.
        ModuleNotFoundError
            If the extra `haptics` is not installed.

        Examples
        --------
        >>> import trimesh
        >>> surface = MeshSurface.from_mesh(trimesh.creation.box([20, 20, 10]))
        >>> distance, normal = surface.evaluate([1.0, 2.0, 5.5])
        >>> round(distance, 9), normal.round(9).tolist()
        (0.5, [0.0, 0.0, 1.0])
        """
        try:
            from trimesh.graph import smooth_shade
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(
                f"meshes require {error.name}, which is not installed: pip install 'texclass[haptics]'",
                name=error.name,
            ) from error

        positive(smoothing_mm, "smoothing_mm")
        if not (len(mesh.faces) and np.isfinite(mesh.area) and mesh.area > 0):
            raise ValueError(f"mesh must have triangles with an area, got {len(mesh.faces)} triangles")
        shaded = smooth_shade(mesh, angle=SHARP_ANGLE, facet_minarea=None)
        rows = np.column_stack([shaded.vertices, shaded.vertex_normals])
        cell, area = divide_triangles(rows[shaded.faces], smoothing_mm / 2)
        length = np.linalg.norm(cell[:, 3:], axis=1)
        cell, area, length = (each[length > 0] for each in (cell, area, length))
        return cls(cell[:, :3], cell[:, 3:] / length[:, np.newaxis], area, smoothing_mm)

    def evaluate(self, point: ArrayLike) -> tuple[float, Samples] | None:
        """Return the signed distance f (mm) of a point (3,) and its gradient (3,).

        The distance is positive outside. Further than the smoothing radius from all triangles, it is
        undefined, and the result is None.
        """
        x = np.asarray(point, dtype=np.float64)
        index = self._tree.query_ball_point(x, self.radius_mm)
        offset = x - self.centre[index]
        near = 1 - np.einsum("ij,ij->i", offset, offset) / self.radius_mm**2
        w = self.area[index] * near**4
        total = w.sum()
        if not total > 0:
            return None
        n = self.normal[index]
        h = np.einsum("ij,ij->i", n, offset)
        f = float(w @ h / total)
        slope = self.area[index] * near**3 * (h - f) * (-8 / self.radius_mm**2)
        return f, (w @ n + slope @ offset) / total

    def project(self, point: ArrayLike) -> tuple[Samples, Samples] | None:
        """Return the point (3,) of the surface along the gradient from `point`, and its unit normal (3,).

        The result is None if `point` is too far from the surface, or the surface ends.

        Examples
        --------
        >>> import trimesh
        >>> surface = MeshSurface.from_mesh(trimesh.creation.box([20, 20, 10]))
        >>> point, normal = surface.project([1.0, 2.0, 4.2])
        >>> point.round(9).tolist(), normal.round(9).tolist()
        ([1.0, 2.0, 5.0], [0.0, 0.0, 1.0])
        """
        x = np.array(point, dtype=np.float64)
        for _ in range(NEWTON_STEPS):
            if (here := self.evaluate(x)) is None:
                return None
            f, gradient = here
            if (size := float(gradient @ gradient)) < 1e-6:  # between two sheets of a thin part
                return None
            if abs(f) < 1e-9 * self.radius_mm:
                return x, gradient / np.sqrt(size)
            x -= f * gradient / size
        return None


def divide_triangles(corners: Samples, size_mm: float) -> tuple[Samples, Samples]:
    """Divide triangles into cells, and interpolate the values of their corners.

    Cells are columns along the longest edge of a triangle, and rows above it.

    Parameters
    ----------
    corners : ndarray of shape (n_triangles, 3, 3 + n_values)
        Coordinates of the corners in mm, followed by other values.
    size_mm : float
        Largest width and height of a cell in mm.

    Returns
    -------
    cell : ndarray of shape (n_cells, 3 + n_values)
        Coordinates of the centres of the cells, and values there.
    area : ndarray of shape (n_cells,)
        Areas of the cells in mm^2.

    Examples
    --------
    >>> cell, area = divide_triangles(np.array([[[0.0, 0, 0], [4, 0, 0], [2, 1, 0]]]), size_mm=2)
    >>> cell.tolist(), area.tolist()
    ([[1.0, 0.25, 0.0], [3.0, 0.25, 0.0]], [1.0, 1.0])
    """
    sides = np.roll(corners, -1, axis=1)[..., :3] - corners[..., :3]
    order = (np.argmax(np.linalg.norm(sides, axis=2), axis=1)[:, np.newaxis] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(corners, order[..., np.newaxis], axis=1).transpose(1, 0, 2)
    base = b[:, :3] - a[:, :3]
    length = np.linalg.norm(base, axis=1)
    height = np.linalg.norm(np.cross(base, c[:, :3] - a[:, :3]), axis=1) / np.maximum(length, 1e-12)
    a, b, c, base, length, height = (each[height > 0] for each in (a, b, c, base, length, height))
    apex = np.clip(np.einsum("ij,ij->i", base, c[:, :3] - a[:, :3]) / length**2, 1e-9, 1 - 1e-9)
    columns, rows = np.ceil(length / size_mm), np.ceil(height / size_mm)
    if (n_cells := float(np.sum(columns * rows))) > MAX_CELLS:
        raise ValueError(
            f"smoothing_mm is too small for the size of the mesh: {n_cells:.0f} cells of {size_mm:g} mm are "
            f"necessary. Expected at most {MAX_CELLS}; pass a larger smoothing_mm"
        )
    count = (columns * rows).astype(np.int64)
    owner = np.repeat(np.arange(count.size), count)
    index = np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
    column, row = np.divmod(index, rows[owner])
    u, v = (column + 0.5) / columns[owner], (row + 0.5) / rows[owner]
    rise = np.minimum(
        u / apex[owner], (1 - u) / (1 - apex[owner])
    )  # height here, relative to that of the apex
    of_c = v * rise
    of_b = u - of_c * apex[owner]
    weights = np.stack([1 - of_b - of_c, of_b, of_c])[..., np.newaxis]
    cell = np.sum(weights * np.stack([a[owner], b[owner], c[owner]]), axis=0)
    return cell, (length * height)[owner] * rise / count[owner]


# Profile on the surface -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class SurfaceProfile:
    """The path of a scan on a surface, which gives each point of the surface two coordinates.

    Attributes
    ----------
    point : ndarray of shape (n_points, 3)
        Points of the path in mm; at least two, and different.
    along_mm : ndarray of shape (n_points,)
        Increasing positions of these points along the path in mm.
    is_closed : bool
        Whether the last point is connected to the first, for example around a cylinder.
    """

    point: Samples
    along_mm: Samples
    is_closed: bool = False
    _tree: KDTree = field(init=False, repr=False)

    def __post_init__(self) -> None:
        freeze(self, point=("n", 3), along_mm=("n",))
        if len(self.point) < 2 or not np.all(np.diff(self.along_mm) > 0):
            raise ValueError(
                f"along_mm must be increasing and have at least two values, got {self.along_mm.size} values"
            )
        object.__setattr__(self, "_tree", KDTree(self.point))

    @property
    def length_mm(self) -> float:
        """Length of the profile in mm; if it is closed, of the whole loop."""
        gap = np.linalg.norm(self.point[0] - self.point[-1]) if self.is_closed else 0.0
        return float(self.along_mm[-1] - self.along_mm[0] + gap)

    def locate(self, point: ArrayLike, normal: ArrayLike) -> tuple[Samples, Samples]:
        """Return the positions along the profile (mm) and the distances from it (mm) of surface points.

        Parameters
        ----------
        point : array_like of shape (n, 3)
            Points on the surface in mm.
        normal : array_like of shape (n, 3)
            Unit normals at these points.

        Returns
        -------
        along, across : ndarray of shape (n,)
            Position of the nearest point of the profile, and the straight distance to it, which is positive
            to the left of the profile. Beyond the ends of an open profile, its first and last segments are
            extended, so that positions are negative or exceed its length.

        Examples
        --------
        >>> line = SurfaceProfile([[0, 0, 0], [10, 0, 0]], [0, 10])
        >>> along, across = line.locate([[4, 2, 0], [13, -1, 0]], [[0, 0, 1], [0, 0, 1]])
        >>> along.tolist(), across.tolist()
        ([4.0, 13.0], [2.0, -1.0])
        """
        x, n = np.asarray(point, np.float64), np.asarray(normal, np.float64)
        node, start = self.point, self.along_mm
        if self.is_closed:
            node, start = np.vstack([node, node[:1]]), np.append(start, start[0] + self.length_mm)
        n_segments = len(node) - 1
        nearest = self._tree.query(x)[1]
        along, across, best = np.zeros(len(x)), np.zeros(len(x)), np.full(len(x), np.inf)
        for neighbour in (nearest - 1, nearest):
            i = neighbour % n_segments if self.is_closed else np.clip(neighbour, 0, n_segments - 1)
            side = node[i + 1] - node[i]
            share = np.einsum("ij,ij->i", x - node[i], side) / np.einsum("ij,ij->i", side, side)
            low = np.where((i == 0) & (not self.is_closed), -np.inf, 0.0)
            high = np.where((i == n_segments - 1) & (not self.is_closed), np.inf, 1.0)
            share = np.clip(share, low, high)
            offset = x - node[i] - share[:, np.newaxis] * side
            distance = np.linalg.norm(offset, axis=1)
            is_left = np.einsum("ij,ij->i", np.cross(n, side), offset) >= 0
            is_nearer = distance < best
            best = np.where(is_nearer, distance, best)
            along = np.where(is_nearer, start[i] + share * (start[i + 1] - start[i]), along)
            across = np.where(is_nearer, np.where(is_left, distance, -distance), across)
        return along, across


def register_scan(
    surface: MeshSurface,
    acceleration: ArrayLike,
    position: ArrayLike,
    force: ArrayLike,
    fs: float,
    *,
    name: str = "",
    is_closed: bool = False,
) -> tuple[Scan, SurfaceProfile]:
    """Register a scan with a surface: project its path, and measure its position along the path.

    The path is low-pass filtered at 10 Hz first, because the noise of a tracker would lengthen it.

    Parameters
    ----------
    surface : MeshSurface
        Surface of the scanned object.
    acceleration : array_like of shape (n_samples,)
        Vibration in m/s^2.
    position : array_like of shape (n_samples, 3)
        Position of the tip in the coordinates of the mesh in mm, at most about one smoothing radius from the
        surface.
    force : array_like of shape (n_samples,)
        Normal force in N.
    fs : float
        Sampling rate of all signals in Hz.
    name : str
        Name of the surface.
    is_closed : bool
        Whether the path is a closed loop that ends where it starts.

    Returns
    -------
    scan : Scan
        Scan along a straight line, for `fit_texture`. Its positions are those along the profile.
    profile : SurfaceProfile
        Path on the surface.

    Raises
    ------
    ValueError
        If a shape is wrong, the path leaves the surface, or the tip does not move.

    References
    ----------
    `guruswamy2011`, section III-A: "A point on the surface is parametrized as a position along the 1D
    scanning profile and a distance normal to the profile."

    Examples
    --------
    >>> import trimesh
    >>> surface = MeshSurface.from_mesh(trimesh.creation.box([60, 20, 10]))
    >>> path = np.column_stack([np.linspace(-20, 20, 100), np.zeros(100), np.full(100, 5.0)])
    >>> scan, profile = register_scan(surface, np.zeros(100), path, np.ones(100), fs=50.0)
    >>> round(profile.length_mm, 3), round(float(scan.speed.mean()), 1)
    (40.0, 20.2)
    """
    x = all_finite(position, "position")
    if x.ndim != 2 or x.shape[1] != 3 or len(x) < 2:
        raise ValueError(f"position must have shape (n_samples, 3) with at least 2 samples, got {x.shape}")
    smooth = x
    if fs > 2.5 * PATH_CUTOFF_HZ:
        n = min(int(fs), len(x) - 1)  # a second of the loop, or of the path reflected at its ends
        margin = ((n, n), (0, 0))
        padded = np.pad(x, margin, "wrap") if is_closed else np.pad(x, margin, "reflect", reflect_type="odd")
        smooth = signals.lowpass(padded, PATH_CUTOFF_HZ, fs)[n : n + len(x)]
    on_surface = [surface.project(each) for each in smooth]
    missing = [i for i, projection in enumerate(on_surface) if projection is None]
    if missing:
        raise ValueError(
            f"the position of {len(missing)} samples is too far from the surface, the first is sample "
            f"{missing[0]} at {smooth[missing[0]].round(2).tolist()} mm. Align the mesh with the positions, "
            "or pass a larger smoothing_mm to MeshSurface.from_mesh"
        )
    point = np.array([projection[0] for projection in on_surface if projection is not None])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(point, axis=0), axis=1))])
    if not along[-1] > 0:
        raise ValueError(f"scan {name!r} must contain a movement, got a path of {along[-1]:g} mm")
    nodes = np.linspace(0.0, along[-1], max(int(along[-1] / PROFILE_STEP_MM), 1) + 1)
    knots, index = np.unique(along, return_index=True)
    path = np.column_stack([np.interp(nodes, knots, column) for column in point[index].T])
    zero = np.zeros(along.size)
    speed = np.gradient(along, 1 / fs)
    scan = Scan(
        np.asarray(acceleration, np.float64), np.column_stack([along, zero]), np.column_stack([speed, zero]),
        np.asarray(force, np.float64), fs, name,
    )  # fmt: skip
    return scan, SurfaceProfile(path, nodes, is_closed)
