"""From what sensors recorded of a stroking hand to segments of steady input, and what each says."""

import heapq
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy import signal, spatial

from texclass.haptics.textures.scan import Scan
from texclass.recording import Samples
from texclass.signals import butterworth, combine, zero_phase
from texclass.vibration import autoregressive, line_spectrum
from texclass.vibration.autoregressive import Method
from texclass.vibration.reflection import log_cosines

Indices = NDArray[np.int64]
Loudness = Literal["level", "variance"]
"""Of a point: RMS of its vibration, or variance of the innovation as in the paper."""

MOTION_HZ = 25.0
"""Cut-off of position, velocity and force; `abdulali2016`, section 2.2."""
VIBRATION_HZ = (10.0, 1000.0)
"""Band of the acceleration; `abdulali2016`, section 2.2."""
LINE_MM = 2.0
"""tau_1 of `abdulali2016`, mm."""
VARIATION = 0.08
"""tau_2 of `abdulali2016`."""
NOTHING = 0.001
"""epsilon of `abdulali2016`, in m/s and in N."""
SHORTEST_S = 0.075
"""75 samples at 1 kHz."""
FOOT = 0.05
"""How far, in tau_1, the foot of a point may lie outside its line: eq. (2) allows nothing, sensors jitter."""
STEEPEST = 2.0
"""Largest exponent of speed or force in the level: above, a few segments have misled the regression."""


def smooth_motion(x: ArrayLike, fs: float) -> Samples:
    """Low-pass what a hand does: Bessel, forwards and backwards, so that nothing is delayed.

    The two passes together take away 6 dB at `MOTION_HZ`.

    Parameters
    ----------
    x : array_like of shape (n_samples, ...)
        Position, velocity or force.
    fs : float
        Hz, above twice `MOTION_HZ`.

    Raises
    ------
    ValueError
        If the rate is too low, there is no sample, or one is not finite.

    References
    ----------
    `abdulali2016`, section 2.2, which gives neither the order (2 a pass here) nor the direction.
    """
    if not fs > 2 * MOTION_HZ:
        raise ValueError(f"fs is {fs}. Expected above {2 * MOTION_HZ:g} Hz, twice the band of the motion")
    sos = signal.bessel(2, MOTION_HZ, fs=fs, norm="mag", output="sos")
    return zero_phase(np.asarray(sos), x)


def limit_vibration(x: ArrayLike, fs: float) -> Samples:
    """Keep `VIBRATION_HZ` alone, without delay: gravity and the hand go below it, noise above.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Acceleration.
    fs : float
        Hz. Where the upper edge reaches fs/2 (as the printed 1000 Hz does at the printed 1 kHz) the sampling
        has already cut there, and the lower edge alone is left.

    Raises
    ------
    ValueError
        If the lower edge is not between 0 and fs/2, there is no sample, or one is not finite.

    References
    ----------
    `abdulali2016`, section 2.2.
    """
    if VIBRATION_HZ[1] >= 0.99 * fs / 2:
        return zero_phase(butterworth("highpass", VIBRATION_HZ[0], fs), x)
    return zero_phase(butterworth("bandpass", VIBRATION_HZ, fs), x)


def condition(scan: Scan) -> Scan:
    """Return the scan with its motion smoothed and its vibration limited to their bands."""
    position, velocity, force = (
        smooth_motion(x, scan.fs) for x in (scan.position, scan.velocity, scan.force)
    )
    vibration = limit_vibration(scan.acceleration, scan.fs)
    return Scan(vibration, position, velocity, force, scan.fs, scan.name)


def scan_from_sensors(
    acceleration: ArrayLike,
    position: ArrayLike,
    force: ArrayLike,
    fs: float,
    *,
    normal: ArrayLike = (0.0, 0.0, 1.0),
    name: str = "",
) -> Scan:
    """Return the scan of a tool whose 3D position and force were recorded, conditioned.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,) or (n_samples, 3)
        m/s^2; axes are combined to one with their spectrum (DFT321).
    position : array_like of shape (n_samples, 3)
        mm.
    force : array_like of shape (n_samples, 3)
        N, of the tool on the surface or back: its part along the normal counts, by its mean as pressing.
    fs : float
        Hz, of all three: bring them to one rate first, see `downsample`.
    normal : array_like of shape (3,)
        Of the surface, of any length.
    name : str, optional
        Of the surface.

    Raises
    ------
    ValueError
        If a shape does not fit, the normal is 0, or a value is not finite.

    Notes
    -----
    The velocity is the derivative of the smoothed position (central differences), projected on the plane.
    Its first axis is the x axis seen along the normal (the y axis, where x is the normal).

    References
    ----------
    `abdulali2016`, section 2.2.
    """
    n, length = np.asarray(normal, dtype=np.float64), np.linalg.norm(normal)
    if n.shape != (3,) or not (np.isfinite(length) and length > 0):
        raise ValueError(f"normal is {n}. Expected three finite numbers, not all 0")
    n = n / length
    seen = np.eye(3) - np.outer(n, n)
    along = seen[0] if seen[0] @ seen[0] > 1e-6 else seen[1]
    along = along / np.linalg.norm(along)
    x, f = np.asarray(position, dtype=np.float64), np.asarray(force, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != 3 or f.shape != x.shape or len(x) < 2:
        raise ValueError(f"position {x.shape} and force {f.shape}. Expected (n_samples, 3), 2 at least")
    tangential = smooth_motion(x @ np.stack([along, np.cross(n, along)]).T, fs)
    velocity = np.gradient(tangential, 1 / fs, axis=0)
    pressing = smooth_motion(f @ n, fs)
    pressing = pressing if pressing.mean() >= 0 else -pressing
    return Scan(limit_vibration(combine(acceleration), fs), tangential, velocity, pressing, fs, name)


@dataclass(frozen=True, eq=False)
class InputSegments:
    """Pieces of a scan with nearly constant direction, speed and force.

    Attributes
    ----------
    lines : ndarray of shape (n_lines + 1,)
        Phase 1: straight line i holds the samples lines[i] ... lines[i + 1] - 1; together the whole scan.
    start, stop : ndarray of shape (n_segments,)
        Phase 2: segment i holds the samples start[i] ... stop[i] - 1; what lies between was too short.
    """

    lines: Indices
    start: Indices
    stop: Indices

    def __len__(self) -> int:
        return int(self.start.size)

    @property
    def n_samples(self) -> Indices:
        """Length of each segment, shape (n_segments,)."""
        return self.stop - self.start

    def pieces(self, x: Samples) -> list[Samples]:
        """Return the segments of a signal (n_samples, ...), as views of it."""
        return [x[a:b] for a, b in zip(self.start, self.stop, strict=True)]

    def means(self, x: Samples) -> Samples:
        """Return the mean of each segment of a signal (n_samples, ...), shape (n_segments, ...)."""
        return np.array([piece.mean(axis=0) for piece in self.pieces(x)])

    def chosen(self, which: NDArray[np.bool_]) -> "InputSegments":
        """Return the segments of a mask."""
        return InputSegments(self.lines, self.start[which], self.stop[which])


def segment_input(scan: Scan, *, variation: float = VARIATION) -> InputSegments:
    """Cut a scan by its input alone: first into straight lines, then into pieces of steady speed and force.

    Neighbours whose union costs least are merged, until every union costs too much. Phase 1 merges while
    every point p of a segment from a to b keeps, with A = p - a, B = b - p, C = b - a,

        h = |A x B| / |C| <= tau_1,    (sqrt(|A|^2 - h^2) + sqrt(|B|^2 - h^2)) / |C| = 1,

    phase 2, within each line, while ``(sigma_v / E(V) + sigma_f / E(F)) / 2 <= tau_2``.

    Parameters
    ----------
    scan : Scan
        Conditioned, see `condition`.
    variation : float
        tau_2. (tau_1 is `LINE_MM`; segments with a mean speed or force up to `NOTHING` do not merge, and
        those shorter than `SHORTEST_S` are dropped.)

    Raises
    ------
    ValueError
        If the threshold is negative or not finite.

    Notes
    -----
    Readings. The paper normalises positions to 0 ... 1 and gives tau_1 in mm: we leave positions in mm.
    Eq. (2) is printed with |C|^2, which fits no unit: read |C|, that is, the foot of p lies between a and b;
    it may lie outside by `FOOT` tau_1. Speed and force of eq. (3) are magnitudes in m/s and N (normalised to
    zero mean, a coefficient of variation means nothing), to which epsilon then belongs. 75 samples
    are 75 ms. Above 1 kHz the motion is segmented at about 1 kHz and the bounds are exact to 1 ms.

    References
    ----------
    `abdulali2016`, section 3.1, eq. (1)-(3); Keogh et al., "An online algorithm for segmenting time series",
    2001.
    """
    if not 0 <= variation < np.inf:
        raise ValueError(f"variation is {variation}. Expected a finite number of at least 0")
    step = max(int(scan.fs // 1000.0), 1)  # the motion has no content beyond 25 Hz
    lines = straight_lines(scan.position[::step])
    felt = np.column_stack([scan.speed[::step] / 1000, scan.force[::step]])
    sums = np.zeros((len(felt) + 1, 4))
    np.cumsum(np.concatenate([felt, felt**2], axis=1), axis=0, out=sums[1:])
    bounds = [_bottom_up(False, sums, a, b, variation, NOTHING) for a, b in pairwise(lines)]
    ends = np.concatenate([np.column_stack([b[:-1], b[1:]]) for b in bounds])
    start, stop = np.minimum(ends * step, len(scan)).T
    every = InputSegments(np.minimum(lines * step, len(scan)), start, stop)
    touching = (every.means(scan.speed) / 1000 > NOTHING) & (every.means(scan.force) > NOTHING)
    return every.chosen((every.n_samples >= SHORTEST_S * scan.fs) & touching)


def straight_lines(position: Samples) -> Indices:
    """Return the bounds of the straight lines of a path (n, 2) in mm, shape (n_lines + 1,); phase 1."""
    xy = np.ascontiguousarray(position, dtype=np.float64)
    return np.asarray(_bottom_up(True, xy, 0, len(xy), LINE_MM, FOOT * LINE_MM))


class ModelPoints(NamedTuple):
    """Samples of the map from input to vibration: what each segment says at its mean input, or silence.

    Attributes
    ----------
    u : ndarray of shape (n_points, n_inputs)
        Normalised inputs (v_x, v_y, f_n), or (|v|, f_n).
    lsf : ndarray of shape (n_points, p)
        Line spectral frequencies, rad per sample.
    loudness : ndarray of shape (n_points,)
        What a network learns of it besides the spectrum, see `level_of`; in a new point, the RMS of the
        vibration (unit of the acceleration) or the variance of the innovation (its square).
    weight : ndarray of shape (n_points,)
        Seconds of signal behind each point.
    """

    u: Samples
    lsf: Samples
    loudness: Samples
    weight: Samples

    def joined(self, others: "ModelPoints") -> "ModelPoints":
        """Return these points and the others."""
        pairs: Any = zip(self, others, strict=True)
        return ModelPoints(*map(np.concatenate, pairs))


def segment_points(
    scan: Scan, segments: InputSegments, u: Samples, order: int, method: Method, loudness: Loudness
) -> ModelPoints:
    """Return one point per segment: its mean input, the LSF of its AR model, and its loudness.

    Parameters
    ----------
    scan : Scan
        Conditioned.
    segments : InputSegments
        Of the scan.
    u : ndarray of shape (n_samples, n_inputs)
        Its normalised inputs.
    order : int
        p of the AR models.
    method : str
        As for `vibration.fit`.
    loudness : {"level", "variance"}
        RMS of the vibration in the segment, or the variance the fit gives (`abdulali2016`).

    Raises
    ------
    ValueError
        If there is no segment.
    """
    if not len(segments):
        raise ValueError(
            f"scan {scan.name!r} has no segment of steady direction, speed and force. Expected at least one"
        )
    pieces = segments.pieces(scan.acceleration)
    models = [autoregressive.fit(x, order, method=method, variance="yule_walker") for x in pieces]
    lsf = line_spectrum.spread(line_spectrum.from_reflection(np.stack([m.reflection for m in models])))
    loud = np.array([m.gain**2 for m in models])
    if loudness == "level":
        loud = np.array([np.sqrt(np.mean(x**2)) for x in pieces])
    return ModelPoints(segments.means(u), lsf, loud, segments.n_samples / scan.fs)


def growth_of(speed: Samples, force: Samples, level: Samples, weight: Samples) -> tuple[float, float]:
    """Return alpha and beta of segments, each 0 ... `STEEPEST`; 0 where speed or force never changed.

    Parameters
    ----------
    speed, force, level : ndarray of shape (n_segments,)
        mm/s, N and the unit of the acceleration; all above 0.
    weight : ndarray of shape (n_segments,)
        Of each segment in the regression.
    """
    columns = np.log(np.column_stack([speed, force, level]))
    centred = (columns - np.average(columns, axis=0, weights=weight)) * np.sqrt(weight)[:, np.newaxis]
    powers = np.linalg.lstsq(centred[:, :2], centred[:, 2], rcond=1e-6)[0]
    alpha, beta = np.clip(powers, 0.0, STEEPEST).tolist()
    return alpha, beta


def level_of(
    kind: Loudness, output: Samples, k: Samples, motion: tuple[Samples, Samples], growth: tuple[float, float]
) -> Samples:
    """Return the RMS of the vibration (n,) from the loudness a map says.

    The paper interpolates the variance of the innovation, with zeros at zero speed and force. What lies
    between large numbers and zeros is too quiet on average, and where a network swings below zero it is
    silent. So by default

        ln level = alpha ln v + beta ln f + g(u)

    and g, which the network learns, is what remains: the direction and whatever departs from the law. It
    needs no points of silence, and is never negative.

    Parameters
    ----------
    kind : {"level", "variance"}
        What the output is: g, or the variance of the innovation, of which what is below 0 counts 0.
    output : ndarray of shape (n,)
    k : ndarray of shape (n, p)
        Reflection coefficients.
    motion : tuple of ndarray of shape (n,)
        Speed v (mm/s) and force f (N), at least 0.
    growth : tuple of float
        alpha and beta.
    """
    if kind == "variance":
        loss = log_cosines(k).sum(axis=1)
        return np.asarray(np.sqrt(np.maximum(output, 0.0)) * np.exp(np.minimum(-loss, 700.0)))
    law = motion[0] ** growth[0] * motion[1] ** growth[1]
    return np.asarray(law * np.exp(np.minimum(output, 300.0)))


def zero_force_points(points: ModelPoints, scaling: Samples) -> ModelPoints:
    """Return silent points at zero force below the hull of the points: their input projected, LSF as theirs.

    The vertices of the facets of the convex hull whose outward normal points to lower force are projected. If
    the points have no hull (too few, or in one plane) all of them are.

    Parameters
    ----------
    points : ModelPoints
    scaling : ndarray of shape (2, n_inputs)
        Mean and deviation of each input, as here and below.

    References
    ----------
    `abdulali2016`, section 3.2 and Fig. 4(b).
    """
    try:
        hull = spatial.ConvexHull(points.u)
    except (spatial.QhullError, ValueError):
        lowest = np.arange(len(points.u))
    else:
        lowest = np.unique(hull.simplices[hull.equations[:, -2] < -1e-9])
    u = points.u[lowest].copy()
    u[:, -1] = -scaling[0, -1] / scaling[1, -1]
    return ModelPoints(u, points.lsf[lowest], np.zeros(len(lowest)), points.weight[lowest])


def zero_speed_points(points: ModelPoints, scaling: Samples, n: int = 10) -> ModelPoints:
    """Return n silent points at rest, from zero force to the largest, with the LSF of the nearest point.

    The paper leaves their number open.

    References
    ----------
    `abdulali2016`, section 3.2.
    """
    still = np.zeros((n, points.u.shape[1]))
    force = points.u[:, -1] * scaling[1, -1] + scaling[0, -1]
    still[:, -1] = np.linspace(0.0, max(float(force.max()), 0.0), n)
    u = (still - scaling[0]) / scaling[1]
    nearest = spatial.KDTree(points.u).query(u)[1]
    return ModelPoints(u, points.lsf[nearest], np.zeros(n), points.weight[nearest])


def mirrored(points: ModelPoints, scaling: Samples) -> ModelPoints:
    """Return the points at the opposite velocities (inputs v_x, v_y, f_n)."""
    raw = points.u * scaling[1] + scaling[0]
    return points._replace(u=(raw * [-1.0, -1.0, 1.0] - scaling[0]) / scaling[1])


@njit(cache=True, error_model="numpy")
def _bottom_up(is_line, table, start, stop, threshold, limit):  # type: ignore[no-untyped-def]
    """Return the first samples of the segments of [start, stop), and `stop`.

    `threshold` is the largest cost of a union; `limit` what the cost takes besides. Costs lie in a heap;
    those of segments that changed meanwhile are recognised by their ends and thrown away. Of equal costs the
    shorter union comes first, so that pauses and exact lines grow evenly: each sample is looked at some
    log2(n) times.
    """
    n = (stop - start + 1) // 2  # the finest segments: two samples
    first = np.append(start + 2 * np.arange(n), stop)
    right, left = np.arange(1, n + 1), np.arange(-1, n - 1)
    heap = [(0.0, 0, 0, 0) for _ in range(0)]
    for i in range(n - 1):
        _offer(heap, is_line, table, first, right, i, threshold, limit)
    alive = np.ones(n, np.bool_)
    while len(heap) > 0:
        _, length, i, j = heapq.heappop(heap)
        if not (alive[i] and alive[j] and first[right[j]] - first[i] == length):
            continue
        alive[j] = False
        right[i] = right[j]
        if right[i] < n:
            left[right[i]] = i
            _offer(heap, is_line, table, first, right, i, threshold, limit)
        if left[i] >= 0:
            _offer(heap, is_line, table, first, right, left[i], threshold, limit)
    return np.append(first[:n][alive], stop)


@njit(cache=True, error_model="numpy")
def _offer(heap, is_line, table, first, right, i, threshold, limit):  # type: ignore[no-untyped-def]
    """Put the union of segment i and its right neighbour on the heap, if it may ever be made."""
    start, stop = first[i], first[right[right[i]]]
    extra = table, start, stop, limit
    cost = _line_cost(*extra) if is_line else _steady_cost(*extra)
    if cost <= threshold:
        heapq.heappush(heap, (cost, stop - start, i, right[i]))


@njit(cache=True, error_model="numpy")
def _line_cost(xy, start, stop, slack):  # type: ignore[no-untyped-def]
    """Return the largest distance h of points (n, 2) from the line through the first and the last of them.

    Infinite where the foot of a point lies more than `slack` outside of them.
    """
    ax, ay = xy[start, 0], xy[start, 1]
    cx, cy = xy[stop - 1, 0] - ax, xy[stop - 1, 1] - ay
    length = np.sqrt(cx * cx + cy * cy)
    worst = 0.0
    for i in range(start + 1, stop - 1):
        px, py = xy[i, 0] - ax, xy[i, 1] - ay
        if length > 0:
            h, foot = abs(px * cy - py * cx) / length, (px * cx + py * cy) / length
        else:
            h, foot = 0.0, np.sqrt(px * px + py * py)
        if foot < -slack or foot > length + slack:
            return np.inf
        worst = max(worst, h)
    return worst


@njit(cache=True, error_model="numpy")
def _steady_cost(sums, start, stop, least):  # type: ignore[no-untyped-def]
    """Return (sigma_v / E(V) + sigma_f / E(F)) / 2 of running sums; infinite at a mean of `least`."""
    n, total = stop - start, 0.0
    for j in range(2):
        mean = (sums[stop, j] - sums[start, j]) / n
        if mean <= least:
            return np.inf
        variance = (sums[stop, j + 2] - sums[start, j + 2]) / n - mean * mean
        total += np.sqrt(max(variance, 0.0)) / mean
    return 0.5 * total
