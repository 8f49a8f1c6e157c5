"""Compiled sample loop of the renderer: each contact renders one model, or two during a crossfade.

All data are in four arrays, and the loop allocates no memory. `bank` (floats) and `index` (counts and
offsets) describe the models; `state` (floats) and `status` (integers) describe the contacts.
"""

from enum import IntEnum

import numpy as np

from texclass.compilation import njit
from texclass.haptics.textures.grid import cell
from texclass.haptics.textures.motion_renderer import is_valid_motion, lattice, oscillators
from texclass.vibration.reflection import MAX_REFLECTION


class Constant(IntEnum):
    """Indices of the constants at the beginning of `bank`.

    - SMOOTHING: fraction of the remaining difference by which the smoothed speed and force change per sample;
    - UPDATE_INTERVAL: number of samples between two updates of the coefficients;
    - FADE_SAMPLES: number of samples of a crossfade;
    - REST_RATIO: fraction of the slowest speed below which the output fades out linearly;
    - RADIANS_PER_HZ: 2 pi / fs;
    - OUTPUT_LIMIT: largest output of the device.
    """

    SMOOTHING, UPDATE_INTERVAL, FADE_SAMPLES, REST_RATIO, RADIANS_PER_HZ, OUTPUT_LIMIT = range(6)


class Column(IntEnum):
    """Columns of `index`: sizes of a model, and offsets of its arrays in `bank`.

    Speeds, forces and powers are stored as logarithms. The bounds are the slowest speed, the lowest force and
    the largest sample.
    """

    N_LINES, ORDER, N_SPEEDS, N_FORCES = range(4)
    SPEED_OFFSET, FORCE_OFFSET, ROW_OFFSET, POWER_OFFSET, LINE_OFFSET, BOUND_OFFSET = range(4, 10)


class State(IntEnum):
    """Columns of `state`: velocity and force of the next sample, last output, smoothed speed and force.

    The columns from `VOICES` on contain two voices of 3 (order + lines + 1) numbers each.
    """

    VX, VY, INPUT_FORCE, OUTPUT, SPEED, FORCE, VOICES = range(7)


class Status(IntEnum):
    """Columns of `status`.

    - MODEL, PREVIOUS, NEXT: index of the model that is rendered, that fades out, and that was requested;
    - FADE_COUNT: samples since the crossfade began (0: no crossfade);
    - UPDATE_COUNT: samples since the last update of the coefficients;
    - HAS_MOTION: whether the smoothed speed and force are initialized;
    - NOISE: state of the random number generator.
    """

    MODEL, PREVIOUS, NEXT, FADE_COUNT, UPDATE_COUNT, HAS_MOTION, NOISE = range(7)


NO_MODEL = -1
UNSET = -1.0
"""Loudness of a voice before its first sample. The first sample sets the loudness without smoothing."""


@njit(cache=True, error_model="numpy")
def draw_noise(status, contact):  # type: ignore[no-untyped-def]
    """Draw a sample of unit-variance white noise, at most 3.47: a sum of four 16-bit parts of SplitMix64."""
    z = np.uint64(status[contact, Status.NOISE]) + np.uint64(0x9E3779B97F4A7C15)
    status[contact, Status.NOISE] = np.int64(z)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    low_bits, total = np.uint64(0xFFFF), z >> np.uint64(48)
    for shift in (0, 16, 32):
        total += (z >> np.uint64(shift)) & low_bits
    # Mean and standard deviation of the sum of four uniform 16-bit integers.
    return (np.float64(total) - 2 * 65535.0) / np.sqrt((65536.0**2 - 1) / 3)


@njit(cache=True, error_model="numpy")
def start_voice(index, state, status, contact, model, voice):  # type: ignore[no-untyped-def]
    """Initialize a voice in its stationary state, in which all lattice residuals have unit variance."""
    p, n = index[model, Column.ORDER], index[model, Column.N_LINES]
    for m in range(p + 1):
        state[contact, voice + m] = draw_noise(status, contact)
    for m in range(p + 1, p + 1 + n):
        state[contact, voice + m] = draw_noise(status, contact) * (np.pi / 3.5)
    state[contact, voice + 2 * ((state.shape[1] - State.VOICES) // 6) + p + n] = UNSET


@njit(cache=True, error_model="numpy")
def render_voice(bank, index, state, status, contact, model, voice, update):  # type: ignore[no-untyped-def]
    """Return the next sample of one voice.

    Part `b` of the voice contains the lattice state and the phases. Part `k` contains the reflection
    coefficients, the amplitudes and the noise gain. Part `c` contains sqrt(1 - k^2), the phase steps and the
    smoothed loudness.
    """
    row, layout = state[contact], index[model]
    p, n = layout[Column.ORDER], layout[Column.N_LINES]
    if p + n == 0:
        return 0.0
    v, f = row[State.SPEED], row[State.FORCE]
    n_v, n_f = layout[Column.N_SPEEDS], layout[Column.N_FORCES]
    speed_offset, force_offset = layout[Column.SPEED_OFFSET], layout[Column.FORCE_OFFSET]
    i0, i1, wv = cell(bank[speed_offset : speed_offset + n_v], np.log(v))
    j0, j1, wf = cell(bank[force_offset : force_offset + n_f], np.log(f))
    n00, n01, n10, n11 = i0 * n_f + j0, i0 * n_f + j1, i1 * n_f + j0, i1 * n_f + j1
    w00, w01, w10, w11 = (1 - wv) * (1 - wf), (1 - wv) * wf, wv * (1 - wf), wv * wf
    span = (state.shape[1] - State.VOICES) // 6
    b, k, c = voice, voice + span, voice + 2 * span
    if update:
        offset, width = layout[Column.ROW_OFFSET], p + n
        a00, a01 = offset + n00 * width, offset + n01 * width
        a10, a11 = offset + n10 * width, offset + n11 * width
        noise_share = 1.0
        for m in range(width):
            x = w00 * bank[a00 + m] + w01 * bank[a01 + m] + w10 * bank[a10 + m] + w11 * bank[a11 + m]
            if m < p:
                x = min(max(x, -MAX_REFLECTION), MAX_REFLECTION)
                row[c + m] = np.sqrt((1.0 - x) * (1.0 + x))
            else:
                line = layout[Column.LINE_OFFSET] + m - p
                hz = bank[line] + bank[line + n] * v
                row[c + m] = min(hz * bank[Constant.RADIANS_PER_HZ], np.pi)
                noise_share -= 0.5 * x * x
            row[k + m] = x
        row[k + width] = np.sqrt(max(noise_share, 0.0))
    x = 0.0
    if p > 0:
        x = lattice(draw_noise(status, contact), row[k : k + p], row[c : c + p], row[b : b + p + 1])
        x *= row[k + p + n]
    x = oscillators(x, row[k + p : k + p + n], row[c + p : c + p + n], row[b + p + 1 : b + p + 1 + n])
    offset, bounds = layout[Column.POWER_OFFSET], layout[Column.BOUND_OFFSET]
    ln_power = w00 * bank[offset + n00] + w01 * bank[offset + n01]
    ln_power = ln_power + w10 * bank[offset + n10] + w11 * bank[offset + n11]
    target = min(v / (bank[Constant.REST_RATIO] * bank[bounds]), 1.0) * min(f / bank[bounds + 1], 1.0)
    loudness = row[c + p + n]
    loudness = target if loudness < 0.0 else loudness + bank[Constant.SMOOTHING] * (target - loudness)
    row[c + p + n] = loudness if loudness > 1e-30 else 0.0
    limit = bank[bounds + 2]
    return min(max(loudness * np.exp(0.5 * ln_power) * x, -limit), limit)


@njit(cache=True, error_model="numpy")
def smooth_motion(bank, state, status, contact, vx, vy, force):  # type: ignore[no-untyped-def]
    """Move the smoothed speed and force one sample towards the input: s += smoothing (input - s)."""
    v, f = np.sqrt(vx * vx + vy * vy), max(force, 0.0)
    row, counters = state[contact], status[contact]
    smoothing = bank[Constant.SMOOTHING] if counters[Status.HAS_MOTION] else 1.0
    counters[Status.HAS_MOTION] = 1
    row[State.SPEED] += smoothing * (v - row[State.SPEED])
    row[State.FORCE] += smoothing * (f - row[State.FORCE])
    for s in (State.SPEED, State.FORCE):
        if row[s] < 1e-30:  # avoids subnormal numbers, which are slow
            row[s] = 0.0


@njit(cache=True, error_model="numpy")
def start_crossfade(index, state, status, contact):  # type: ignore[no-untyped-def]
    """Start the crossfade to the requested model, unless another crossfade is in progress."""
    row, counters = state[contact], status[contact]
    if counters[Status.FADE_COUNT] != 0 or counters[Status.NEXT] == counters[Status.MODEL]:
        return
    width = (state.shape[1] - State.VOICES) // 2
    for i in range(width):
        row[State.VOICES + width + i] = row[State.VOICES + i]
    counters[Status.PREVIOUS] = counters[Status.MODEL]
    counters[Status.MODEL] = counters[Status.NEXT]
    counters[Status.FADE_COUNT] = 1
    counters[Status.UPDATE_COUNT] = 0
    if counters[Status.MODEL] >= 0:
        start_voice(index, state, status, contact, counters[Status.MODEL], State.VOICES)


@njit(cache=True, error_model="numpy")
def step(bank, index, state, status, contact, vx, vy, force):  # type: ignore[no-untyped-def]
    """Return the next sample of a contact. If the input is invalid, return NaN and keep the state."""
    if not is_valid_motion(vx, vy, force):
        return np.nan
    start_crossfade(index, state, status, contact)
    counters = status[contact]
    model, previous = counters[Status.MODEL], counters[Status.PREVIOUS]
    fade_count = counters[Status.FADE_COUNT]
    if model < 0 and previous < 0:
        counters[Status.HAS_MOTION] = 0
        counters[Status.FADE_COUNT] = 0
        return 0.0
    smooth_motion(bank, state, status, contact, vx, vy, force)
    update = counters[Status.UPDATE_COUNT] == 0
    counters[Status.UPDATE_COUNT] += 1
    if counters[Status.UPDATE_COUNT] >= bank[Constant.UPDATE_INTERVAL]:
        counters[Status.UPDATE_COUNT] = 0
    x = 0.0
    if model >= 0:
        x = render_voice(bank, index, state, status, contact, model, State.VOICES, update)
    if fade_count > 0:
        # Equal-power crossfade: sin^2 + cos^2 = 1.
        angle = 0.5 * np.pi * fade_count / bank[Constant.FADE_SAMPLES]
        x *= np.sin(angle)
        if previous >= 0:
            voice = State.VOICES + (state.shape[1] - State.VOICES) // 2
            x += np.cos(angle) * render_voice(bank, index, state, status, contact, previous, voice, update)
        counters[Status.FADE_COUNT] = fade_count + 1
        if fade_count + 1 >= bank[Constant.FADE_SAMPLES]:
            counters[Status.FADE_COUNT], counters[Status.PREVIOUS] = 0, NO_MODEL
    return min(max(x, -bank[Constant.OUTPUT_LIMIT]), bank[Constant.OUTPUT_LIMIT])


@njit(cache=True, error_model="numpy")
def step_all(bank, index, state, status):  # type: ignore[no-untyped-def]
    """Render one sample of each contact from the motion in `state`; return whether all inputs are valid."""
    is_valid = True
    for c in range(state.shape[0]):
        vx, vy, force = state[c, State.VX], state[c, State.VY], state[c, State.INPUT_FORCE]
        x = step(bank, index, state, status, c, vx, vy, force)
        state[c, State.OUTPUT] = x
        is_valid = is_valid and np.isfinite(x)
    return is_valid


@njit(cache=True, error_model="numpy")
def render_block(bank, index, state, status, velocity, force, models, out):  # type: ignore[no-untyped-def]
    """Fill `out` (n_contacts, n). `models` is the model index per contact and sample, or has shape (0, 0)."""
    for t in range(force.shape[1]):
        for c in range(force.shape[0]):
            if models.size:
                status[c, Status.NEXT] = models[c, t]
            out[c, t] = step(bank, index, state, status, c, velocity[c, t, 0], velocity[c, t, 1], force[c, t])
