"""Inner loops of rendering, sample by sample: the same operations in one order, however calls cut a path."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from texclass.recording import Samples
from texclass.vibration.lattice_kernels import turn
from texclass.vibration.recursions import LARGEST

SHRINK = 1 - 2 * float(np.finfo(np.float64).eps)
"""Takes from each rotation more than its rounding may add."""


@njit(cache=True, error_model="numpy")
def follow(velocity: Samples, force: Samples, share: float, state: Samples, out: Samples) -> None:
    """Let the state (v_x, v_y, f) approach each input by a share of the difference; its course into `out`."""
    for t in range(len(force)):
        state[0] += share * (velocity[t, 0] - state[0])
        state[1] += share * (velocity[t, 1] - state[1])
        state[2] += share * (max(force[t], 0.0) - state[2])
        for i in range(3):
            out[t, i] = state[i]


@njit(cache=True, error_model="numpy")
def glide(
    noise: Samples,
    k: Samples,
    level: Samples,
    done: int,
    total: int,
    b: Samples,
    limit: float,
    out: Samples,
) -> None:
    """Pass noise through the lattice while k and level move from their first row to their second."""
    p = k.shape[1]
    for t in range(noise.size):
        w = (done + t + 1) / total
        f = noise[t]
        for m in range(p - 1, -1, -1):
            r = min(max((1.0 - w) * k[0, m] + w * k[1, m], -LARGEST), LARGEST) * SHRINK
            f, b[m + 1] = turn(f, b[m], r, np.sqrt((1.0 - r) * (1.0 + r)) * SHRINK)
        b[0] = f
        out[t] = min(max(f * ((1.0 - w) * level[0] + w * level[1]), -limit), limit)


@njit(cache=True, error_model="numpy")
def _cell(x: float, n: int) -> tuple[int, float]:
    """Return the cell of a place in 0 ... n - 1 and how far into it the place lies."""
    x = min(max(x, 0.0), n - 1.0)
    i = min(int(x), max(n - 2, 0))
    return i, x - i


@njit(cache=True, error_model="numpy")
def grid_place(
    motion: Samples,
    size: NDArray[np.int64],
    fastest: float,
    hardest: float,
    where: NDArray[np.int64],
    into: Samples,
) -> None:
    """Find the cell of a motion (v_x, v_y, f) in a grid whose axes go with the square root."""
    n = size.size
    speed = np.sqrt(motion[0] ** 2 + motion[1] ** 2)
    shrink = fastest / speed if speed > fastest else 1.0
    for i in range(n - 1):
        if n == 2:
            x = np.sqrt(speed * shrink / fastest) * (size[i] - 1)
        else:
            part = motion[i] * shrink / fastest
            x = (1.0 + np.sign(part) * np.sqrt(abs(part))) * 0.5 * (size[i] - 1)
        where[i], into[i] = _cell(x, size[i])
    where[n - 1], into[n - 1] = _cell(np.sqrt(max(motion[2], 0.0) / hardest) * (size[n - 1] - 1), size[n - 1])


@njit(cache=True, error_model="numpy")
def render_grid(
    velocity: Samples,
    force: Samples,
    noise: Samples,
    share: float,
    grid: Samples,
    size: NDArray[np.int64],
    bounds: Samples,
    motion: Samples,
    b: Samples,
    k: Samples,
    out: Samples,
) -> None:
    """Render from a grid (nodes, p + 1) of reflection coefficients and levels: multilinear, every sample.

    `bounds`: fastest, hardest, slow, light, loudest, largest sample. `k` (p + 1,) is working space.
    """
    p, n = grid.shape[1] - 1, size.size
    where, into = np.empty(n, np.int64), np.empty(n)
    course = np.empty((1, 3))
    for t in range(noise.size):
        follow(velocity[t : t + 1], force[t : t + 1], share, motion, course)
        grid_place(motion, size, bounds[0], bounds[1], where, into)
        k[:] = 0.0
        for corner in range(1 << n):
            weight, node = 1.0, 0
            for i in range(n):
                up = (corner >> i) & 1
                weight *= into[i] if up else 1.0 - into[i]
                node = node * size[i] + min(where[i] + up, size[i] - 1)
            if weight > 0.0:
                row = grid[node]
                for m in range(p + 1):
                    k[m] += weight * row[m]
        speed = np.sqrt(motion[0] ** 2 + motion[1] ** 2)
        fade = min(speed / bounds[2], 1.0) * min(motion[2] / bounds[3], 1.0)
        f = noise[t]
        for m in range(p - 1, -1, -1):
            r = k[m] * SHRINK
            f, b[m + 1] = turn(f, b[m], r, np.sqrt((1.0 - r) * (1.0 + r)) * SHRINK)
        b[0] = f
        out[t] = min(max(f * min(k[p], fade * bounds[4]), -bounds[5]), bounds[5])
