"""Condition scans, segment their input, and compute the model points of the segments."""

import heapq
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal, spatial

from texclass.compilation import njit
from texclass.haptics.textures.scan import Scan
from texclass.phases import exclude_outliers
from texclass.recording import Samples
from texclass.signals import butterworth, combine, zero_phase
from texclass.vibration import autoregressive, line_spectrum
from texclass.vibration.autoregressive import Method
from texclass.vibration.reflection import log_cosines

Indices = NDArray[np.int64]
Loudness = Literal["level", "variance"]
"""Loudness of a model point: RMS of its vibration, or variance of the innovation as in the paper."""

MOTION_HZ = 25.0
"""Cut-off of position, velocity and force in Hz; `abdulali2016`, section 2.2."""
VIBRATION_HZ = (10.0, 1000.0)
"""Band of the acceleration in Hz; `abdulali2016`, section 2.2."""
LINE_MM = 2.0
"""Threshold tau_1 of `abdulali2016` in mm: largest distance from a straight line."""
VARIATION = 0.08
"""Threshold tau_2 of `abdulali2016`: largest coefficient of variation of speed and force."""
MIN_INPUT = 0.001
"""Threshold epsilon of `abdulali2016` in m/s and N; segments with lower speed or force are not merged."""
MIN_SEGMENT_S = 0.075
"""Shortest segment in s; `abdulali2016`: 75 samples at 1 kHz."""
FOOT_SLACK = 0.05
"""Largest distance by which the projection of a point may lie beyond the ends of its line, as a fraction of
tau_1. Eq. (2) allows no distance, but positions are noisy (our choice)."""
MAX_EXPONENT = 2.0
"""Largest exponent of speed or force in the level law; larger estimates are due to outlying segments."""


def smooth_motion(x: ArrayLike, fs: float) -> Samples:
    """Low-pass filter position, velocity or force with a zero-phase Bessel filter.

    The two passes of the filter together attenuate by 6 dB at `MOTION_HZ`.

    Parameters
    ----------
    x : array_like of shape (n_samples, ...)
        Position, velocity or force.
    fs : float
        Sampling rate in Hz, above twice `MOTION_HZ`.

    Raises
    ------
    ValueError
        If the sampling rate is too low, `x` is empty, or a value is not finite.

    References
    ----------
    `abdulali2016`, section 2.2, which does not specify the order (here 2 per pass) or the direction.
    """
    if not fs > 2 * MOTION_HZ:
        raise ValueError(
            f"fs must be above {2 * MOTION_HZ:g} Hz, twice the bandwidth of the motion, got {fs} Hz"
        )
    sos = signal.bessel(2, MOTION_HZ, fs=fs, norm="mag", output="sos")
    return zero_phase(np.asarray(sos), x)


def speed_of(position: Samples, fs: float, name: str) -> Samples:
    """Return the speed (n,) in mm/s from recorded positions (n, n_axes) in mm.

    Outliers are excluded, see `texclass.phases.exclude_outliers`, and the position is smoothed, see
    `smooth_motion`.
    """
    smooth = smooth_motion(exclude_outliers(position, fs, "position", "mm", f"scan {name!r}"), fs)
    return np.asarray(np.linalg.norm(np.gradient(smooth, 1 / fs, axis=0), axis=1))


def limit_vibration(x: ArrayLike, fs: float) -> Samples:
    """Band-pass filter an acceleration to `VIBRATION_HZ` with zero phase.

    The filter removes gravity, hand motion and noise.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Acceleration.
    fs : float
        Sampling rate in Hz. If the upper edge is at or above fs/2 (as in the paper, with an edge of
        1000 Hz at a rate of 1 kHz), only a high-pass filter is applied.

    Raises
    ------
    ValueError
        If the lower edge is not between 0 and fs/2, `x` is empty, or a value is not finite.

    References
    ----------
    `abdulali2016`, section 2.2.
    """
    if VIBRATION_HZ[1] >= 0.99 * fs / 2:
        return zero_phase(butterworth("highpass", VIBRATION_HZ[0], fs), x)
    return zero_phase(butterworth("bandpass", VIBRATION_HZ, fs), x)


def condition(scan: Scan) -> Scan:
    """Low-pass filter the motion of a scan, and band-pass filter its vibration.

    Parameters
    ----------
    scan : Scan
        Recorded scan.

    Examples
    --------
    >>> scan = Scan.along_line(9.81 + np.zeros(500), speed=80.0, force=1.0, fs=1000.0)
    >>> bool(np.abs(condition(scan).acceleration).max() < 1e-6)
    True
    """
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
    """Create a conditioned scan from the recorded 3D position and force of a tool.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,) or (n_samples, 3)
        Acceleration in m/s^2; three axes are combined into one with the same spectrum (DFT321).
    position : array_like of shape (n_samples, 3)
        Position in mm.
    force : array_like of shape (n_samples, 3)
        Force in N, either of the tool on the surface or the reaction force. The component along the normal
        is used, with the sign that makes its mean positive.
    fs : float
        Sampling rate of all signals in Hz; resample them to a common rate first.
    normal : array_like of shape (3,)
        Normal vector of the surface, of any length (default z).
    name : str, optional
        Name of the surface.

    Raises
    ------
    ValueError
        If the shapes do not match, the normal is zero, or a value is not finite.

    Notes
    -----
    The velocity is the derivative of the smoothed position (central differences), projected onto the surface.
    The first axis of the surface is the projection of the x axis (of the y axis if x is the normal).

    References
    ----------
    `abdulali2016`, section 2.2.

    Examples
    --------
    >>> t = np.arange(1000) / 1000
    >>> position = np.column_stack([50 * t, 0 * t, 0 * t])
    >>> force = np.column_stack([0 * t, 0 * t, 0 * t + 1.5])
    >>> scan = scan_from_sensors(np.sin(900 * t), position, force, fs=1000.0)
    >>> round(float(scan.speed.mean()), 1), round(float(scan.force.mean()), 1)
    (49.9, 1.5)
    """
    n, length = np.asarray(normal, dtype=np.float64), np.linalg.norm(normal)
    if n.shape != (3,) or not (np.isfinite(length) and length > 0):
        raise ValueError(f"normal must be three finite numbers, not all 0, got {n}")
    n = n / length
    projection = np.eye(3) - np.outer(n, n)
    axis = projection[0] if projection[0] @ projection[0] > 1e-6 else projection[1]
    axis = axis / np.linalg.norm(axis)
    x, f = np.asarray(position, dtype=np.float64), np.asarray(force, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != 3 or f.shape != x.shape or len(x) < 2:
        raise ValueError(
            f"position and force must have shape (n_samples, 3), n_samples >= 2, got {x.shape} and {f.shape}"
        )
    x = exclude_outliers(x, fs, "position", "mm", f"scan {name!r}")
    f = exclude_outliers(f, fs, "force", "N", f"scan {name!r}")
    tangential = smooth_motion(x @ np.stack([axis, np.cross(n, axis)]).T, fs)
    velocity = np.gradient(tangential, 1 / fs, axis=0)
    pressing = smooth_motion(f @ n, fs)
    pressing = pressing if pressing.mean() >= 0 else -pressing
    return Scan(limit_vibration(combine(acceleration), fs), tangential, velocity, pressing, fs, name)


@dataclass(frozen=True, eq=False)
class InputSegments:
    """Segments of a scan in which direction, speed and force are nearly constant.

    Attributes
    ----------
    lines : ndarray of shape (n_lines + 1,)
        Result of phase 1 of `segment_input`. Straight line i consists of the samples lines[i] to
        lines[i + 1] - 1. The lines cover the whole scan.
    start, stop : ndarray of shape (n_segments,)
        Result of phase 2 of `segment_input`. Segment i consists of the samples start[i] to stop[i] - 1.
        Samples between segments are unused.
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

    def cut(self, x: Samples) -> list[Samples]:
        """Split a signal (n_samples, ...) into the segments; return one view per segment."""
        return [x[a:b] for a, b in zip(self.start, self.stop, strict=True)]

    def means(self, x: Samples) -> Samples:
        """Return the mean of each segment of a signal (n_samples, ...), shape (n_segments, ...)."""
        return np.array([segment.mean(axis=0) for segment in self.cut(x)])

    def select(self, mask: NDArray[np.bool_]) -> "InputSegments":
        """Return the segments selected by a boolean mask (n_segments,)."""
        return InputSegments(self.lines, self.start[mask], self.stop[mask])


def segment_input(scan: Scan, *, variation: float = VARIATION) -> InputSegments:
    """Segment a scan into straight lines, and each line into segments of steady speed and force.

    Both phases work bottom-up: the neighbours whose union has the lowest cost are merged until every union
    exceeds the threshold. In phase 1, every point p of a merged segment from a to b must satisfy, with A = p
    - a, B = b - p and C = b - a,

        h = |A x B| / |C| <= tau_1,    (sqrt(|A|^2 - h^2) + sqrt(|B|^2 - h^2)) / |C| = 1,

    In phase 2, segments within a line are merged while ``(sigma_v / E(V) + sigma_f / E(F)) / 2 <= tau_2``.

    Parameters
    ----------
    scan : Scan
        Conditioned scan, see `condition`.
    variation : float
        Threshold tau_2 (default 0.08); tau_1 is `LINE_MM`. Segments with a mean speed or force of at most
        `MIN_INPUT` are not merged, and segments shorter than `MIN_SEGMENT_S` are discarded.

    Raises
    ------
    ValueError
        If the threshold is negative or not finite.

    Notes
    -----
    Our interpretation of the paper:

    - The paper normalises positions to 0 ... 1 but specifies tau_1 in mm. We keep positions in mm.
    - Eq. (2) is printed with |C|^2, which is dimensionally inconsistent. We use |C|: the projection of p lies
      between a and b, within `FOOT_SLACK` tau_1.
    - Speed and force in eq. (3) are magnitudes in m/s and N, as is epsilon. A coefficient of variation is
      meaningless for values of zero mean.
    - 75 samples are 75 ms. Above 1 kHz the motion is decimated to about 1 kHz, so segment bounds are exact to
      1 ms.

    References
    ----------
    `abdulali2016`, section 3.1, eq. (1)-(3); Keogh et al., "An online algorithm for segmenting time series",
    2001.

    Examples
    --------
    >>> speed = np.repeat([50.0, 120.0], 500)
    >>> scan = Scan.along_line(np.zeros(1000), speed, 1.0, fs=1000.0)
    >>> segments = segment_input(scan)
    >>> segments.start.tolist(), segments.stop.tolist()
    ([0, 500], [500, 1000])
    """
    if not 0 <= variation < np.inf:
        raise ValueError(f"variation must be finite and at least 0, got {variation}")
    step = max(int(scan.fs // 1000.0), 1)  # the motion is band-limited to 25 Hz
    lines = straight_lines(scan.position[::step])
    inputs = np.column_stack([scan.speed[::step] / 1000, scan.force[::step]])
    sums = np.zeros((len(inputs) + 1, 4))
    np.cumsum(np.concatenate([inputs, inputs**2], axis=1), axis=0, out=sums[1:])
    bounds = [_merge_bottom_up(False, sums, a, b, variation, MIN_INPUT) for a, b in pairwise(lines)]
    ends = np.concatenate([np.column_stack([b[:-1], b[1:]]) for b in bounds])
    start, stop = np.minimum(ends * step, len(scan)).T
    candidates = InputSegments(np.minimum(lines * step, len(scan)), start, stop)
    means = candidates.means(scan.speed) / 1000, candidates.means(scan.force)
    is_stroke = (means[0] > MIN_INPUT) & (means[1] > MIN_INPUT)
    return candidates.select((candidates.n_samples >= MIN_SEGMENT_S * scan.fs) & is_stroke)


def straight_lines(position: Samples) -> Indices:
    """Return the bounds (n_lines + 1,) of straight lines in a path (n, 2) in mm; see `segment_input`."""
    xy = np.ascontiguousarray(position, dtype=np.float64)
    return np.asarray(_merge_bottom_up(True, xy, 0, len(xy), LINE_MM, FOOT_SLACK * LINE_MM))


class ModelPoints(NamedTuple):
    """Samples of the mapping from input to vibration, at the mean input of segments or at silent points.

    Attributes
    ----------
    u : ndarray of shape (n_points, n_inputs)
        Normalised inputs (v_x, v_y, f_n), or (|v|, f_n).
    lsf : ndarray of shape (n_points, p)
        Line spectral frequencies in rad per sample.
    loudness : ndarray of shape (n_points,)
        Loudness output of the network, see `compute_level`. Before the fit of the level law: RMS of the
        vibration (unit of the acceleration), or variance of the innovation (its square).
    weight : ndarray of shape (n_points,)
        Duration in s of the signal from which each point was estimated.
    """

    u: Samples
    lsf: Samples
    loudness: Samples
    weight: Samples

    def concatenate(self, others: "ModelPoints") -> "ModelPoints":
        """Return these points followed by the points `others`."""
        pairs: Any = zip(self, others, strict=True)
        return ModelPoints(*map(np.concatenate, pairs))


def segment_points(
    scan: Scan, segments: InputSegments, u: Samples, order: int, method: Method, loudness: Loudness
) -> ModelPoints:
    """Compute one point per segment: mean input, LSF of the AR model, and loudness.

    Parameters
    ----------
    scan : Scan
        Conditioned scan.
    segments : InputSegments
        Segments of the scan.
    u : ndarray of shape (n_samples, n_inputs)
        Normalised inputs of the scan.
    order : int
        Order p of the AR models.
    method : str
        Fitting method; see `vibration.fit`.
    loudness : {"level", "variance"}
        RMS of the vibration in the segment, or variance of the innovation (`abdulali2016`).

    Raises
    ------
    ValueError
        If there is no segment.
    """
    if not len(segments):
        raise ValueError(
            f"scan {scan.name!r} must have at least one segment of steady direction, speed and force, "
            "got none"
        )
    vibrations = segments.cut(scan.acceleration)
    models = [autoregressive.fit(x, order, method=method, variance="yule_walker") for x in vibrations]
    lsf = line_spectrum.spread(line_spectrum.from_reflection(np.stack([m.reflection for m in models])))
    loud = np.array([m.gain**2 for m in models])
    if loudness == "level":
        loud = np.array([np.sqrt(np.mean(x**2)) for x in vibrations])
    return ModelPoints(segments.means(u), lsf, loud, segments.n_samples / scan.fs)


def fit_growth(speed: Samples, force: Samples, level: Samples, weight: Samples) -> tuple[float, float]:
    """Fit the exponents alpha and beta of speed and force in the level, each 0 ... `MAX_EXPONENT`.

    An exponent is 0 if the speed or the force is constant.

    Parameters
    ----------
    speed, force, level : ndarray of shape (n_segments,)
        Speed in mm/s, force in N and level in the unit of the acceleration; all positive.
    weight : ndarray of shape (n_segments,)
        Weight of each segment in the regression.
    """
    columns = np.log(np.column_stack([speed, force, level]))
    centred = (columns - np.average(columns, axis=0, weights=weight)) * np.sqrt(weight)[:, np.newaxis]
    powers = np.linalg.lstsq(centred[:, :2], centred[:, 2], rcond=1e-6)[0]
    alpha, beta = np.clip(powers, 0.0, MAX_EXPONENT).tolist()
    return alpha, beta


def compute_level(
    kind: Loudness, output: Samples, k: Samples, motion: tuple[Samples, Samples], growth: tuple[float, float]
) -> Samples:
    """Compute the RMS of the vibration (n,) from the loudness output of a texture map.

    The paper interpolates the variance of the innovation, with zeros at zero speed and force. Between large
    values and zeros, the result is too quiet on average, and it is silent where the network output is
    negative. Our default is

        ln level = alpha ln v + beta ln f + g(u)

    The network represents g, the deviation from the power law, for example as a function of the direction.
    This form needs no silent points, and the level is never negative.

    Parameters
    ----------
    kind : {"level", "variance"}
        Kind of output: g, or the variance of the innovation (negative values are replaced by 0).
    output : ndarray of shape (n,)
        Loudness output of the texture map.
    k : ndarray of shape (n, p)
        Reflection coefficients.
    motion : tuple of ndarray of shape (n,)
        Speed v in mm/s and force f in N, at least 0.
    growth : tuple of float
        Exponents alpha and beta.
    """
    if kind == "variance":
        loss = log_cosines(k).sum(axis=1)
        return np.asarray(np.sqrt(np.maximum(output, 0.0)) * np.exp(np.minimum(-loss, 700.0)))
    law = motion[0] ** growth[0] * motion[1] ** growth[1]
    return np.asarray(law * np.exp(np.minimum(output, 300.0)))


def zero_force_points(points: ModelPoints, scaling: Samples) -> ModelPoints:
    """Create silent points at zero force by projecting the lower hull of the points; the LSF are unchanged.

    The lower hull consists of the facets of the convex hull whose outward normal points to lower force. If
    the hull is undefined (too few points, or all in one plane), all points are projected.

    Parameters
    ----------
    points : ModelPoints
        Points of the segments.
    scaling : ndarray of shape (2, n_inputs)
        Mean and standard deviation of each input.

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
    """Create n silent points at zero speed, from zero to the largest force, with the LSF of nearest points.

    The paper does not specify the number of points.

    References
    ----------
    `abdulali2016`, section 3.2.
    """
    raw = np.zeros((n, points.u.shape[1]))
    force = points.u[:, -1] * scaling[1, -1] + scaling[0, -1]
    raw[:, -1] = np.linspace(0.0, max(float(force.max()), 0.0), n)
    u = (raw - scaling[0]) / scaling[1]
    nearest = spatial.KDTree(points.u).query(u)[1]
    return ModelPoints(u, points.lsf[nearest], np.zeros(n), points.weight[nearest])


def mirror_points(points: ModelPoints, scaling: Samples) -> ModelPoints:
    """Return the points at the opposite velocities, for inputs (v_x, v_y, f_n)."""
    raw = points.u * scaling[1] + scaling[0]
    return points._replace(u=(raw * [-1.0, -1.0, 1.0] - scaling[0]) / scaling[1])


@njit(cache=True, error_model="numpy")
def _merge_bottom_up(is_line, table, start, stop, threshold, limit):  # type: ignore[no-untyped-def]
    """Return the first sample of each merged segment of [start, stop), followed by `stop`.

    `threshold` is the largest cost of a union, and `limit` a parameter of the cost function. Costs are kept
    in a heap; a heap entry is outdated if the ends of its segments have changed. Among equal costs, the
    shorter union comes first: pauses and exact lines then grow evenly, and each sample is visited about
    log2(n) times.
    """
    n = (stop - start + 1) // 2  # the initial segments have two samples
    first = np.append(start + 2 * np.arange(n), stop)
    following, previous = np.arange(1, n + 1), np.arange(-1, n - 1)
    heap = [(0.0, 0, 0, 0) for _ in range(0)]
    for i in range(n - 1):
        _push_union(heap, is_line, table, first, following, i, threshold, limit)
    is_active = np.ones(n, np.bool_)
    while len(heap) > 0:
        _, length, i, j = heapq.heappop(heap)
        if not (is_active[i] and is_active[j] and first[following[j]] - first[i] == length):
            continue
        is_active[j] = False
        following[i] = following[j]
        if following[i] < n:
            previous[following[i]] = i
            _push_union(heap, is_line, table, first, following, i, threshold, limit)
        if previous[i] >= 0:
            _push_union(heap, is_line, table, first, following, previous[i], threshold, limit)
    return np.append(first[:n][is_active], stop)


@njit(cache=True, error_model="numpy")
def _push_union(heap, is_line, table, first, following, i, threshold, limit):  # type: ignore[no-untyped-def]
    """Push the union of segment i and the next one onto the heap if its cost is at most the threshold."""
    start, stop = first[i], first[following[following[i]]]
    extra = table, start, stop, limit
    cost = _line_cost(*extra) if is_line else _steady_cost(*extra)
    if cost <= threshold:
        heapq.heappush(heap, (cost, stop - start, i, following[i]))


@njit(cache=True, error_model="numpy")
def _line_cost(xy, start, stop, slack):  # type: ignore[no-untyped-def]
    """Return the largest distance h of points (n, 2) from the line through the first and the last point.

    The cost is infinite if the projection of a point lies more than `slack` beyond an end of the line.
    """
    ax, ay = xy[start, 0], xy[start, 1]
    cx, cy = xy[stop - 1, 0] - ax, xy[stop - 1, 1] - ay
    length = np.sqrt(cx * cx + cy * cy)
    largest = 0.0
    for i in range(start + 1, stop - 1):
        px, py = xy[i, 0] - ax, xy[i, 1] - ay
        if length > 0:
            h, foot = abs(px * cy - py * cx) / length, (px * cx + py * cy) / length
        else:
            h, foot = 0.0, np.sqrt(px * px + py * py)
        if foot < -slack or foot > length + slack:
            return np.inf
        largest = max(largest, h)
    return largest


@njit(cache=True, error_model="numpy")
def _steady_cost(sums, start, stop, min_mean):  # type: ignore[no-untyped-def]
    """Return (sigma_v / E(V) + sigma_f / E(F)) / 2 from cumulative sums; infinity if a mean is too small."""
    n, total = stop - start, 0.0
    for j in range(2):
        mean = (sums[stop, j] - sums[start, j]) / n
        if mean <= min_mean:
            return np.inf
        variance = (sums[stop, j + 2] - sums[start, j + 2]) / n - mean * mean
        total += np.sqrt(max(variance, 0.0)) / mean
    return 0.5 * total
