"""Bottom-up segmentation: neighbours whose union costs least are merged, until every union costs too much.

Merging costs lie in a heap; those of segments that changed meanwhile are recognised by their ends and thrown
away. Of equal costs the shorter union comes first, so that pauses and exact lines grow evenly: each sample is
then looked at some log2(n) times.
"""

import heapq
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from texclass.recording import Samples

LINE, STEADY = 0, 1
"""What a union costs: `line_cost` of points (n, 2), or `steady_cost` of running sums (n + 1, 4)."""


@njit(cache=True, error_model="numpy")
def line_cost(xy: Samples, start: int, stop: int, slack: float) -> float:
    """Return the largest distance h of the points from the line through the first and the last of them.

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
def steady_cost(sums: Samples, start: int, stop: int, least: float) -> float:
    """Return (sigma_v / E(V) + sigma_f / E(F)) / 2, infinite where a mean is `least` or below."""
    n, total = stop - start, 0.0
    for j in range(2):
        mean = (sums[stop, j] - sums[start, j]) / n
        if mean <= least:
            return np.inf
        variance = (sums[stop, j + 2] - sums[start, j + 2]) / n - mean * mean
        total += np.sqrt(max(variance, 0.0)) / mean
    return 0.5 * total


@njit(cache=True, error_model="numpy")
def _cost(kind: int, table: Samples, start: int, stop: int, limit: float) -> float:
    if kind == LINE:
        return line_cost(table, start, stop, limit)
    return steady_cost(table, start, stop, limit)


@njit(cache=True, error_model="numpy")
def bottom_up(
    kind: int, table: Samples, start: int, stop: int, threshold: float, limit: float
) -> NDArray[np.int64]:
    """Return the first samples of the segments of [start, stop), and `stop`.

    `threshold` is the largest cost of a merged segment; `limit` what the cost function takes besides.
    """
    n = (stop - start + 1) // 2  # the finest segments: two samples
    first = np.empty(n + 1, np.int64)
    for i in range(n):
        first[i] = start + 2 * i
    first[n] = stop
    right, left = np.arange(1, n + 1), np.arange(-1, n - 1)
    heap = [(0.0, 0, 0, 0) for _ in range(0)]
    for i in range(n - 1):
        cost = _cost(kind, table, first[i], first[i + 2], limit)
        if cost <= threshold:
            heapq.heappush(heap, (cost, first[i + 2] - first[i], i, i + 1))
    alive = np.ones(n, np.bool_)
    while len(heap) > 0:
        _, length, i, j = heapq.heappop(heap)
        if not (alive[i] and alive[j] and first[right[j]] - first[i] == length):
            continue
        alive[j] = False
        after = right[j]
        right[i] = after
        if after < n:
            left[after] = i
            _offer(heap, kind, table, first, right, i, after, threshold, limit)
        if left[i] >= 0:
            _offer(heap, kind, table, first, right, left[i], i, threshold, limit)
    kept = first[:n][alive]
    return np.append(kept, stop)


@njit(cache=True, error_model="numpy")
def _offer(
    heap: Any,
    kind: int,
    table: Samples,
    first: NDArray[np.int64],
    right: NDArray[np.int64],
    i: int,
    j: int,
    threshold: float,
    limit: float,
) -> None:
    """Put the union of the neighbours i and j on the heap, if it may ever be made."""
    start, stop = first[i], first[right[j]]
    cost = _cost(kind, table, start, stop, limit)
    if cost <= threshold:
        heapq.heappush(heap, (cost, stop - start, i, j))
