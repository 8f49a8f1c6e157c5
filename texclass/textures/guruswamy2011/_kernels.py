"""The renderer's inner loop: which features the tip passes, and the modes that ring, sample by sample.

A mode is a rotating and shrinking phasor z, its contribution Re z, and a sample later it is z p: a section of
second order in coupled form. What rings lies in the first `counts[RINGING]` rows of a pool that is allocated
once.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from texclass.recording import Samples

Counts = NDArray[np.int64]

RINGING, NEXT, STARTED = 0, 1, 2
"""Places in `counts`: modes in the pool, the next feature along x, whether there was a sample."""
PLACE, FELT, X, Y = 0, 1, 2, 3
"""Places in `where`: coordinate of the tip, that with play, last position."""
MAX_PASSED = 4
"""Features felt within one sample, at most: those nearest to the tip."""
LARGEST = 1e9
"""Of any input: velocity in mm/s, force in N, position in mm."""


@njit(cache=True, error_model="numpy")
def locate(s: float, position: Samples, length: float) -> int:
    """Return how many features lie before s on the surface repeated with period `length`."""
    turn = np.floor(s / length)
    rest = s - turn * length
    low, high = 0, position.size
    while low < high:
        middle = (low + high) // 2
        if position[middle] < rest:
            low = middle + 1
        else:
            high = middle
    return int(turn) * position.size + low


@njit(cache=True, error_model="numpy")
def place_of(k: int, position: Samples, length: float) -> float:
    """Return the coordinate of feature k of the repeated surface."""
    turn = k // position.size
    return float(turn * length + position[k - turn * position.size])


@njit(cache=True, error_model="numpy")
def factor(speed: float, force: float, law: Samples) -> float:
    """Return A of `level.Amplitude.factor`; law: k_v, k_c, a_0, v_0, f_0, compensated, limit."""
    here = law[0] * speed / 1000 + law[1] * force + law[2]
    A = here / (law[0] * law[3] / 1000 + law[1] * law[4] + law[2])
    if law[5] != 0 and speed > law[3]:
        A *= np.sqrt(law[3] / speed)
    return float(min(A, law[6]))


@njit(cache=True, error_model="numpy")
def strike(k: int, A: float, first: Counts, modes: Samples, pool: Samples, counts: Counts) -> None:
    """Put the modes of a feature into the pool. A full pool gives up its weakest mode for a stronger one."""
    for m in range(first[k], first[k + 1]):
        re, im = A * modes[m, 0], A * modes[m, 1]
        row = counts[0]
        if row < pool.shape[0]:
            counts[0] += 1
        else:
            row, least = -1, re * re + im * im
            for i in range(pool.shape[0]):
                power = pool[i, 0] * pool[i, 0] + pool[i, 1] * pool[i, 1]
                if power < least:
                    row, least = i, power
            if row < 0:
                continue
        pool[row, 0], pool[row, 1] = re, im
        pool[row, 2], pool[row, 3] = modes[m, 2], modes[m, 3]


@njit(cache=True, error_model="numpy")
def ring(pool: Samples, counts: Counts, silent: float) -> float:
    """Return the sum of what rings now, and step every mode; those below `silent` leave the pool."""
    total = 0.0
    i = 0
    while i < counts[0]:
        re, im = pool[i, 0], pool[i, 1]
        total += re
        if re * re + im * im < silent * silent:
            counts[0] -= 1
            last = counts[0]
            for j in range(4):
                pool[i, j] = pool[last, j]
            continue
        pool[i, 0], pool[i, 1] = re * pool[i, 2] - im * pool[i, 3], re * pool[i, 3] + im * pool[i, 2]
        i += 1
    return total


@njit(cache=True, error_model="numpy")
def advance(
    now: float, A: float, position: Samples, length: float,
    first: Counts, modes: Samples, pool: Samples, counts: Counts,
) -> None:  # fmt: skip
    """Strike the features between the last coordinate of the tip and this one; x <= now are behind it."""
    n = position.size
    k = counts[1]
    if place_of(k, position, length) > now and place_of(k - 1, position, length) <= now:
        return
    end = locate(now, position, length)
    while place_of(end, position, length) <= now:
        end += 1
    if A > 0:
        low, high = (max(k, end - MAX_PASSED), end) if end > k else (end, min(k, end + MAX_PASSED))
        for j in range(low, high):
            strike(j % n, A, first, modes, pool, counts)
    counts[1] = end


@njit(cache=True, error_model="numpy")
def render(
    velocity: Samples, force: Samples, path: Samples, out: Samples, setting: Samples, law: Samples,
    position: Samples, first: Counts, modes: Samples, pool: Samples, counts: Counts, where: Samples,
) -> bool:  # fmt: skip
    """Render a block into `out`; False, and nothing done, if an input is NaN, infinite or too large.

    setting: fs, length of the surface, direction x and y, origin along it, travelled (0 or 1), play, silent,
    largest output.
    `path` is empty where the velocity is to be summed up.
    """
    fs, length, along_x, along_y, origin, travelled, play, silent, largest = setting
    given = path.shape[0] > 0
    for t in range(force.size):
        ok = abs(velocity[t, 0]) <= LARGEST and abs(velocity[t, 1]) <= LARGEST and abs(force[t]) <= LARGEST
        if not ok or (given and not (abs(path[t, 0]) <= LARGEST and abs(path[t, 1]) <= LARGEST)):
            return False
    for t in range(force.size):
        if given:
            x, y = path[t, 0], path[t, 1]
        elif counts[2] == 0:
            x, y = 0.0, 0.0
        else:
            x, y = where[2] + velocity[t, 0] / fs, where[3] + velocity[t, 1] / fs
        if counts[2] == 0:
            s = 0.0 if travelled != 0 else x * along_x + y * along_y - origin
            where[1] = s
            counts[1] = locate(s, position, length)
        elif travelled != 0:
            s = where[0] + np.sqrt((x - where[2]) ** 2 + (y - where[3]) ** 2)
        else:
            s = x * along_x + y * along_y - origin
        counts[2] = 1
        where[0], where[2], where[3] = s, x, y
        felt = min(max(where[1], s), s + play)
        speed = np.sqrt(velocity[t, 0] ** 2 + velocity[t, 1] ** 2)
        A = factor(speed, force[t], law) if force[t] > 0 else 0.0
        advance(felt, A, position, length, first, modes, pool, counts)
        where[1] = felt
        out[t] = min(max(ring(pool, counts, silent), -largest), largest)
    return True
