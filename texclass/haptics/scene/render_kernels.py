"""The loop over samples: every contact plays one model, or two while one fades into the other.

Four arrays hold everything: what the models are is in `bank` (numbers) and `index` (counts and places), what
each contact is doing in `state` (numbers) and `phase` (counts). Nothing is allocated in the loop.
"""

import numpy as np
from numba import njit

from texclass.haptics.textures.grid import cell
from texclass.vibration.lattice import turn
from texclass.vibration.reflection import LARGEST

GLIDE, HOP, FADE, STILL, RADIANS, OUTPUT = range(6)
N_FACTS = 6
"""`bank` begins with: share of the way that speed and force go per sample, samples between renewals, samples
of a crossfade, the part of the slowest speed where fading begins, 2 pi / fs, the device's largest output."""
N_LINES, ORDER, N_SPEEDS, N_FORCES, AT_SPEEDS, AT_FORCES, AT_ROWS, AT_POWER, AT_COURSE, AT_BOUNDS = range(10)
N_INDEX = 10
"""Columns of `index`: what a model is, and where its parts begin in `bank`. Axes are logarithms there, and so
is power; bounds are the slowest speed, the softest force and the largest sample."""
VX, VY, PRESS, OUT, SPEED, FORCE, VOICES = range(7)
"""`state` of a contact: motion to come and sample that came of it, followed speed and force, then two voices
of 3 (order + lines + 1) numbers each."""
MODEL, OTHER, WANTED, FADED, COUNT, STARTED, NOISE = range(7)
N_COUNTS = 7
"""`phase` of a contact: the model that plays, the one that fades out, the one asked for (-1: none), samples
into the crossfade (0: none), samples since the renewal, whether speed and force are known, the noise."""
NONE = -1
UNKNOWN = -1.0
"""Loudness before the first sample of a voice, which takes its own at once."""

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1, _MIX_2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31 = np.uint64(30), np.uint64(27), np.uint64(31)
_S16, _S32, _S48, _LOW = np.uint64(16), np.uint64(32), np.uint64(48), np.uint64(0xFFFF)
_MEAN, _DEVIATION = 131070.0, float(np.sqrt((65536.0**2 - 1) / 3))


@njit(cache=True, error_model="numpy")
def draw(phase, contact):  # type: ignore[no-untyped-def]
    """Return white noise of unit variance within 3.47 deviations: four 16-bit parts of SplitMix64, summed."""
    z = np.uint64(phase[contact, NOISE]) + _GOLDEN
    phase[contact, NOISE] = np.int64(z)
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    z = z ^ (z >> _S31)
    total = (z & _LOW) + ((z >> _S16) & _LOW) + ((z >> _S32) & _LOW) + (z >> _S48)
    return (np.float64(total) - _MEAN) / _DEVIATION


@njit(cache=True, error_model="numpy")
def start(index, state, phase, contact, model, voice):  # type: ignore[no-untyped-def]
    """Give a voice the state of a vibration that has been going on: all residuals of unit variance."""
    p, n = index[model, ORDER], index[model, N_LINES]
    for m in range(p + 1):
        state[contact, voice + m] = draw(phase, contact)
    for m in range(p + 1, p + 1 + n):
        state[contact, voice + m] = draw(phase, contact) * (np.pi / 3.5)
    state[contact, voice + 2 * ((state.shape[1] - VOICES) // 6) + p + n] = UNKNOWN


@njit(cache=True, error_model="numpy")
def sound(bank, index, state, phase, contact, model, voice, renew):  # type: ignore[no-untyped-def]
    """Return the next sample of one voice.

    `b` holds the lattice and the phases, `k` reflection coefficients, amplitudes and the share of the noise,
    `c` sqrt(1 - k^2), the steps of the phases and the followed loudness.
    """
    p, n = index[model, ORDER], index[model, N_LINES]
    if p + n == 0:
        return 0.0
    v, f = state[contact, SPEED], state[contact, FORCE]
    n_f, at_v, at_f = index[model, N_FORCES], index[model, AT_SPEEDS], index[model, AT_FORCES]
    i0, i1, wv = cell(bank[at_v : at_v + index[model, N_SPEEDS]], np.log(v))
    j0, j1, wf = cell(bank[at_f : at_f + n_f], np.log(f))
    n00, n01, n10, n11 = i0 * n_f + j0, i0 * n_f + j1, i1 * n_f + j0, i1 * n_f + j1
    w00, w01, w10, w11 = (1 - wv) * (1 - wf), (1 - wv) * wf, wv * (1 - wf), wv * wf
    span = (state.shape[1] - VOICES) // 6
    b, k, c = voice, voice + span, voice + 2 * span
    if renew:
        at, row = index[model, AT_ROWS], p + n
        a00, a01, a10, a11 = at + n00 * row, at + n01 * row, at + n10 * row, at + n11 * row
        share = 1.0
        for m in range(row):
            x = w00 * bank[a00 + m] + w01 * bank[a01 + m] + w10 * bank[a10 + m] + w11 * bank[a11 + m]
            if m < p:
                x = min(max(x, -LARGEST), LARGEST)
                state[contact, c + m] = np.sqrt((1.0 - x) * (1.0 + x))
            else:
                course = index[model, AT_COURSE] + m - p
                hz = bank[course] + bank[course + n] * v
                state[contact, c + m] = min(hz * bank[RADIANS], np.pi)
                share -= 0.5 * x * x
            state[contact, k + m] = x
        state[contact, k + row] = np.sqrt(max(share, 0.0))
    x = 0.0
    if p > 0:
        x = draw(phase, contact)
        for m in range(p - 1, -1, -1):
            x, up = turn(x, state[contact, b + m], state[contact, k + m], state[contact, c + m])
            state[contact, b + m + 1] = up
        state[contact, b] = x
        x *= state[contact, k + p + n]
    for m in range(p, p + n):
        angle = state[contact, b + 1 + m]
        if state[contact, c + m] < np.pi:
            x += state[contact, k + m] * np.cos(angle)
        angle += state[contact, c + m]
        state[contact, b + 1 + m] = angle - 2.0 * np.pi if angle > np.pi else angle
    at, bounds = index[model, AT_POWER], index[model, AT_BOUNDS]
    ln_power = w00 * bank[at + n00] + w01 * bank[at + n01] + w10 * bank[at + n10] + w11 * bank[at + n11]
    loud = min(v / (bank[STILL] * bank[bounds]), 1.0) * min(f / bank[bounds + 1], 1.0)
    heard = state[contact, c + p + n]
    heard = loud if heard < 0.0 else heard + bank[GLIDE] * (loud - heard)
    state[contact, c + p + n] = heard if heard > 1e-30 else 0.0
    limit = bank[bounds + 2]
    return min(max(heard * np.exp(0.5 * ln_power) * x, -limit), limit)


@njit(cache=True, error_model="numpy")
def follow(bank, state, phase, contact, vx, vy, force):  # type: ignore[no-untyped-def]
    """Move speed and force one sample towards the hand's: s += glide (target - s)."""
    v, f = np.sqrt(vx * vx + vy * vy), max(force, 0.0)
    share = bank[GLIDE] if phase[contact, STARTED] else 1.0
    phase[contact, STARTED] = 1
    state[contact, SPEED] += share * (v - state[contact, SPEED])
    state[contact, FORCE] += share * (f - state[contact, FORCE])
    for s in (SPEED, FORCE):
        if state[contact, s] < 1e-30:  # not into the range of slow, subnormal numbers
            state[contact, s] = 0.0


@njit(cache=True, error_model="numpy")
def change_over(index, state, phase, contact):  # type: ignore[no-untyped-def]
    """Begin the crossfade to what was asked for, unless one is under way."""
    if phase[contact, FADED] != 0 or phase[contact, WANTED] == phase[contact, MODEL]:
        return
    width = (state.shape[1] - VOICES) // 2
    for i in range(width):
        state[contact, VOICES + width + i] = state[contact, VOICES + i]
    phase[contact, OTHER] = phase[contact, MODEL]
    phase[contact, MODEL] = phase[contact, WANTED]
    phase[contact, FADED] = 1
    phase[contact, COUNT] = 0
    if phase[contact, MODEL] >= 0:
        start(index, state, phase, contact, phase[contact, MODEL], VOICES)


@njit(cache=True, error_model="numpy")
def step(bank, index, state, phase, contact, vx, vy, force):  # type: ignore[no-untyped-def]
    """Return the next sample of a contact; NaN, and nothing done, if the input is not finite."""
    if not (np.isfinite(vx) and np.isfinite(vy) and np.isfinite(force)):
        return np.nan
    change_over(index, state, phase, contact)
    model, other, faded = phase[contact, MODEL], phase[contact, OTHER], phase[contact, FADED]
    if model < 0 and other < 0:
        phase[contact, STARTED] = 0
        phase[contact, FADED] = 0
        return 0.0
    follow(bank, state, phase, contact, vx, vy, force)
    renew = phase[contact, COUNT] == 0
    phase[contact, COUNT] += 1
    if phase[contact, COUNT] >= bank[HOP]:
        phase[contact, COUNT] = 0
    x = 0.0
    if model >= 0:
        x = sound(bank, index, state, phase, contact, model, VOICES, renew)
    if faded > 0:
        angle = 0.5 * np.pi * faded / bank[FADE]  # powers add up to one: sin^2 + cos^2
        x *= np.sin(angle)
        if other >= 0:
            voice = VOICES + (state.shape[1] - VOICES) // 2
            x += np.cos(angle) * sound(bank, index, state, phase, contact, other, voice, renew)
        phase[contact, FADED] = faded + 1
        if faded + 1 >= bank[FADE]:
            phase[contact, FADED], phase[contact, OTHER] = 0, NONE
    return min(max(x, -bank[OUTPUT]), bank[OUTPUT])


@njit(cache=True, error_model="numpy")
def step_all(bank, index, state, phase):  # type: ignore[no-untyped-def]
    """Take the motion of every contact out of its state, and put its sample there; return whether finite."""
    finite = True
    for c in range(state.shape[0]):
        x = step(bank, index, state, phase, c, state[c, VX], state[c, VY], state[c, PRESS])
        state[c, OUT] = x
        finite = finite and np.isfinite(x)
    return finite


@njit(cache=True, error_model="numpy")
def play(bank, index, state, phase, velocity, force, wanted, out):  # type: ignore[no-untyped-def]
    """Fill `out` (n_contacts, n); `wanted` is the model of each contact and sample, or of none, (0, 0)."""
    for t in range(force.shape[1]):
        for c in range(force.shape[0]):
            if wanted.size:
                phase[c, WANTED] = wanted[c, t]
            out[c, t] = step(bank, index, state, phase, c, velocity[c, t, 0], velocity[c, t, 1], force[c, t])
