"""A scan cut where the hand changes direction, speed or force: two-phase segmentation of the input."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples
from texclass.textures.abdulali2016 import _bottom_up as kernels
from texclass.textures.scan import Scan

Indices = NDArray[np.int64]

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
MOTION_FS = 1000.0
"""The motion has no content beyond 25 Hz: at higher rates it is segmented at about this one."""


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


def segment_input(
    scan: Scan,
    *,
    line_mm: float = LINE_MM,
    variation: float = VARIATION,
    nothing: float = NOTHING,
    shortest_s: float = SHORTEST_S,
) -> InputSegments:
    """Cut a scan by its input alone: first into straight lines, then into pieces of steady speed and force.

    Phase 1 merges while every point p of a segment from a to b keeps, with A = p - a, B = b - p, C = b - a,

        h = |A x B| / |C| <= tau_1,    (sqrt(|A|^2 - h^2) + sqrt(|B|^2 - h^2)) / |C| = 1,

    phase 2, within each line, while ``(sigma_v / E(V) + sigma_f / E(F)) / 2 <= tau_2``.

    Parameters
    ----------
    scan : Scan
        Conditioned, see `condition`.
    line_mm : float
        tau_1, mm.
    variation : float
        tau_2.
    nothing : float
        epsilon: segments with a mean speed (m/s) or force (N) up to this do not merge.
    shortest_s : float
        Shorter segments are dropped, s.

    Returns
    -------
    InputSegments

    Raises
    ------
    ValueError
        If a threshold is negative or not finite.

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
    for name, value in (
        ("line_mm", line_mm), ("variation", variation), ("nothing", nothing), ("shortest_s", shortest_s),
    ):  # fmt: skip
        if not (np.isfinite(value) and value >= 0):
            raise ValueError(f"{name} is {value}; the rule is finite and at least 0")
    step = max(int(scan.fs // MOTION_FS), 1)
    lines = straight_lines(scan.position[::step], line_mm)
    bounds = steady_pieces(scan.speed[::step] / 1000, scan.force[::step], lines, variation, nothing)
    ends = np.concatenate([np.column_stack([b[:-1], b[1:]]) for b in bounds])
    start, stop = np.minimum(ends * step, len(scan)).T
    every = InputSegments(np.minimum(lines * step, len(scan)), start, stop)
    touching = (every.means(scan.speed) / 1000 > nothing) & (every.means(scan.force) > nothing)
    return every.chosen((every.n_samples >= shortest_s * scan.fs) & touching)


def straight_lines(position: Samples, line_mm: float = LINE_MM) -> Indices:
    """Return the bounds of the straight lines of a path (n, 2) in mm, shape (n_lines + 1,); phase 1."""
    xy = np.ascontiguousarray(position, dtype=np.float64)
    return np.asarray(kernels.bottom_up(kernels.LINE, xy, 0, len(xy), line_mm, FOOT * line_mm))


def steady_pieces(
    speed: Samples,
    force: Samples,
    lines: Indices,
    variation: float = VARIATION,
    nothing: float = NOTHING,
) -> list[Indices]:
    """Return the bounds of the pieces of steady speed (n,) and force (n,) in each line; phase 2."""
    values = np.column_stack([speed, force])
    sums = np.zeros((len(values) + 1, 4))
    np.cumsum(np.concatenate([values, values**2], axis=1), axis=0, out=sums[1:])
    return [
        np.asarray(kernels.bottom_up(kernels.STEADY, sums, a, b, variation, nothing))
        for a, b in pairwise(lines)
    ]
