"""Inner loops of the renderers: one pass per sample, so that any blocking gives the same samples."""

import numpy as np
from numba import njit

from texclass.vibration.lattice_kernels import turn
from texclass.vibration.recursions import LARGEST

PLACE, LOUDNESS, COUNT, N_STATES = 0, 1, 2, 3
UNKNOWN = -1.0
"""Place before the first sample, which takes its own at once."""


@njit(inline="always", error_model="numpy")
def follow(vx, vy, force, speeds, still, glide, state):  # type: ignore[no-untyped-def]
    """Move place and loudness one sample towards the speed's: s += glide (target - s)."""
    v = np.sqrt(vx * vx + vy * vy)
    last = speeds.size - 1
    if v <= speeds[0]:
        place = 0.0
    elif v >= speeds[last]:
        place = float(last)
    else:
        i = 0
        while v >= speeds[i + 1]:
            i += 1
        place = i + (v - speeds[i]) / (speeds[i + 1] - speeds[i])
    loudness = min(v / still, 1.0) if force > 0.0 else 0.0
    if state[PLACE] < 0.0:
        state[PLACE] = place
    state[PLACE] += glide * (place - state[PLACE])
    state[LOUDNESS] += glide * (loudness - state[LOUDNESS])


@njit(cache=True, error_model="numpy")
def render_lattice(  # type: ignore[no-untyped-def]
    velocity, force, noise, speeds, rows, levels, n_sub, still, glide, hop, limit, state, k, c, b, out
):
    """Drive the lattice of the place with noise; k is renewed every `hop` samples, the level at each."""
    p, last = k.size, levels.size - 1
    for t in range(force.size):
        follow(velocity[t, 0], velocity[t, 1], force[t], speeds, still, glide, state)
        at = state[PLACE] * n_sub
        i = min(int(at), last - 1)
        w = at - i
        if state[COUNT] == 0.0:
            for m in range(p):
                between = min(max((1.0 - w) * rows[i, m] + w * rows[i + 1, m], -LARGEST), LARGEST)
                k[m] = between
                c[m] = np.sqrt((1.0 - between) * (1.0 + between))
        state[COUNT] = (state[COUNT] + 1.0) % hop
        f = noise[t]
        for m in range(p - 1, -1, -1):
            f, b[m + 1] = turn(f, b[m], k[m], c[m])
        b[0] = f
        level = state[LOUDNESS] * ((1.0 - w) * levels[i] + w * levels[i + 1])
        out[t] = min(max(level * f, -limit), limit)


@njit(cache=True, error_model="numpy")
def render_lines(  # type: ignore[no-untyped-def]
    velocity, force, speeds, omega, amplitude, still, glide, limit, state, phase, out
):
    """Add up oscillators whose frequencies and amplitudes are those of the place; their phases run on."""
    last = speeds.size - 1
    for t in range(force.size):
        follow(velocity[t, 0], velocity[t, 1], force[t], speeds, still, glide, state)
        i = min(int(state[PLACE]), last - 1)
        w = state[PLACE] - i
        x = 0.0
        for j in range(phase.size):
            a = (1.0 - w) * amplitude[i, j] + w * amplitude[i + 1, j]
            if a > 0.0:
                x += a * np.cos(phase[j])
            phase[j] += (1.0 - w) * omega[i, j] + w * omega[i + 1, j]
            if phase[j] > np.pi:
                phase[j] -= 2.0 * np.pi
        out[t] = min(max(state[LOUDNESS] * x, -limit), limit)
