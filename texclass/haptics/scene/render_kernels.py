"""The loop over samples: every contact plays one model, or two while one fades into the other.

Four arrays hold everything: what the models are is in `bank` (numbers) and `index` (counts and places), what
each contact is doing in `state` (numbers) and `phase` (counts). Nothing is allocated in the loop.
"""

from enum import IntEnum

import numpy as np
from numba import njit

from texclass.haptics.textures.grid import cell
from texclass.haptics.textures.motion_renderer import lattice, oscillators
from texclass.vibration.reflection import MAX_REFLECTION


class Fact(IntEnum):
    """Places at the beginning of `bank`.

    Share of the way that speed and force go per sample, samples between renewals, samples of a crossfade, the
    part of the slowest speed where fading begins, 2 pi / fs, the device's largest output.
    """

    GLIDE, HOP, FADE, STILL, RADIANS, OUTPUT = range(6)


class Column(IntEnum):
    """Columns of `index`: what a model is, and where its parts begin in `bank`.

    Axes are logarithms there, and so is power; bounds are the slowest speed, the softest force and the
    largest sample.
    """

    N_LINES, ORDER, N_SPEEDS, N_FORCES = range(4)
    AT_SPEEDS, AT_FORCES, AT_ROWS, AT_POWER, AT_COURSE, AT_BOUNDS = range(4, 10)


class State(IntEnum):
    """Columns of `state`: motion to come, the sample that came of it, followed speed and force.

    From `VOICES` on stand two voices of 3 (order + lines + 1) numbers each.
    """

    VX, VY, PRESS, OUT, SPEED, FORCE, VOICES = range(7)


class Phase(IntEnum):
    """Columns of `phase`.

    The model that plays, the one that fades out, the one asked for (-1: none), samples into the crossfade (0:
    none), samples since the renewal, whether speed and force are known, the noise.
    """

    MODEL, OTHER, WANTED, FADED, COUNT, STARTED, NOISE = range(7)


NONE = -1
UNKNOWN = -1.0
"""Loudness before the first sample of a voice, which takes its own at once."""


@njit(cache=True, error_model="numpy")
def draw(phase, contact):  # type: ignore[no-untyped-def]
    """Return white noise of unit variance within 3.47 deviations: four 16-bit parts of SplitMix64, summed."""
    z = np.uint64(phase[contact, Phase.NOISE]) + np.uint64(0x9E3779B97F4A7C15)
    phase[contact, Phase.NOISE] = np.int64(z)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    low, total = np.uint64(0xFFFF), z >> np.uint64(48)
    for shift in (0, 16, 32):
        total += (z >> np.uint64(shift)) & low
    return (np.float64(total) - 2 * 65535.0) / np.sqrt((65536.0**2 - 1) / 3)  # of four uniform parts


@njit(cache=True, error_model="numpy")
def start(index, state, phase, contact, model, voice):  # type: ignore[no-untyped-def]
    """Give a voice the state of a vibration that has been going on: all residuals of unit variance."""
    p, n = index[model, Column.ORDER], index[model, Column.N_LINES]
    for m in range(p + 1):
        state[contact, voice + m] = draw(phase, contact)
    for m in range(p + 1, p + 1 + n):
        state[contact, voice + m] = draw(phase, contact) * (np.pi / 3.5)
    state[contact, voice + 2 * ((state.shape[1] - State.VOICES) // 6) + p + n] = UNKNOWN


@njit(cache=True, error_model="numpy")
def sound(bank, index, state, phase, contact, model, voice, renew):  # type: ignore[no-untyped-def]
    """Return the next sample of one voice.

    `b` holds the lattice and the phases, `k` reflection coefficients, amplitudes and the share of the noise,
    `c` sqrt(1 - k^2), the steps of the phases and the followed loudness.
    """
    here, parts = state[contact], index[model]
    p, n = parts[Column.ORDER], parts[Column.N_LINES]
    if p + n == 0:
        return 0.0
    v, f = here[State.SPEED], here[State.FORCE]
    n_f, at_v, at_f = parts[Column.N_FORCES], parts[Column.AT_SPEEDS], parts[Column.AT_FORCES]
    i0, i1, wv = cell(bank[at_v : at_v + parts[Column.N_SPEEDS]], np.log(v))
    j0, j1, wf = cell(bank[at_f : at_f + n_f], np.log(f))
    n00, n01, n10, n11 = i0 * n_f + j0, i0 * n_f + j1, i1 * n_f + j0, i1 * n_f + j1
    w00, w01, w10, w11 = (1 - wv) * (1 - wf), (1 - wv) * wf, wv * (1 - wf), wv * wf
    span = (state.shape[1] - State.VOICES) // 6
    b, k, c = voice, voice + span, voice + 2 * span
    if renew:
        at, row = parts[Column.AT_ROWS], p + n
        a00, a01, a10, a11 = at + n00 * row, at + n01 * row, at + n10 * row, at + n11 * row
        share = 1.0
        for m in range(row):
            x = w00 * bank[a00 + m] + w01 * bank[a01 + m] + w10 * bank[a10 + m] + w11 * bank[a11 + m]
            if m < p:
                x = min(max(x, -MAX_REFLECTION), MAX_REFLECTION)
                here[c + m] = np.sqrt((1.0 - x) * (1.0 + x))
            else:
                course = parts[Column.AT_COURSE] + m - p
                hz = bank[course] + bank[course + n] * v
                here[c + m] = min(hz * bank[Fact.RADIANS], np.pi)
                share -= 0.5 * x * x
            here[k + m] = x
        here[k + row] = np.sqrt(max(share, 0.0))
    x = 0.0
    if p > 0:
        x = lattice(draw(phase, contact), here[k : k + p], here[c : c + p], here[b : b + p + 1])
        x *= here[k + p + n]
    x = oscillators(x, here[k + p : k + p + n], here[c + p : c + p + n], here[b + p + 1 : b + p + 1 + n])
    at, bounds = parts[Column.AT_POWER], parts[Column.AT_BOUNDS]
    ln_power = w00 * bank[at + n00] + w01 * bank[at + n01] + w10 * bank[at + n10] + w11 * bank[at + n11]
    loud = min(v / (bank[Fact.STILL] * bank[bounds]), 1.0) * min(f / bank[bounds + 1], 1.0)
    heard = here[c + p + n]
    heard = loud if heard < 0.0 else heard + bank[Fact.GLIDE] * (loud - heard)
    here[c + p + n] = heard if heard > 1e-30 else 0.0
    limit = bank[bounds + 2]
    return min(max(heard * np.exp(0.5 * ln_power) * x, -limit), limit)


@njit(cache=True, error_model="numpy")
def follow(bank, state, phase, contact, vx, vy, force):  # type: ignore[no-untyped-def]
    """Move speed and force one sample towards the hand's: s += glide (target - s)."""
    v, f = np.sqrt(vx * vx + vy * vy), max(force, 0.0)
    here, now = state[contact], phase[contact]
    share = bank[Fact.GLIDE] if now[Phase.STARTED] else 1.0
    now[Phase.STARTED] = 1
    here[State.SPEED] += share * (v - here[State.SPEED])
    here[State.FORCE] += share * (f - here[State.FORCE])
    for s in (State.SPEED, State.FORCE):
        if here[s] < 1e-30:  # not into the range of slow, subnormal numbers
            here[s] = 0.0


@njit(cache=True, error_model="numpy")
def change_over(index, state, phase, contact):  # type: ignore[no-untyped-def]
    """Begin the crossfade to what was asked for, unless one is under way."""
    here, now = state[contact], phase[contact]
    if now[Phase.FADED] != 0 or now[Phase.WANTED] == now[Phase.MODEL]:
        return
    width = (state.shape[1] - State.VOICES) // 2
    for i in range(width):
        here[State.VOICES + width + i] = here[State.VOICES + i]
    now[Phase.OTHER] = now[Phase.MODEL]
    now[Phase.MODEL] = now[Phase.WANTED]
    now[Phase.FADED] = 1
    now[Phase.COUNT] = 0
    if now[Phase.MODEL] >= 0:
        start(index, state, phase, contact, now[Phase.MODEL], State.VOICES)


@njit(cache=True, error_model="numpy")
def step(bank, index, state, phase, contact, vx, vy, force):  # type: ignore[no-untyped-def]
    """Return the next sample of a contact; NaN, and nothing done, if the input is not finite."""
    if not (np.isfinite(vx) and np.isfinite(vy) and np.isfinite(force)):
        return np.nan
    change_over(index, state, phase, contact)
    now = phase[contact]
    model, other, faded = now[Phase.MODEL], now[Phase.OTHER], now[Phase.FADED]
    if model < 0 and other < 0:
        now[Phase.STARTED] = 0
        now[Phase.FADED] = 0
        return 0.0
    follow(bank, state, phase, contact, vx, vy, force)
    renew = now[Phase.COUNT] == 0
    now[Phase.COUNT] += 1
    if now[Phase.COUNT] >= bank[Fact.HOP]:
        now[Phase.COUNT] = 0
    x = 0.0
    if model >= 0:
        x = sound(bank, index, state, phase, contact, model, State.VOICES, renew)
    if faded > 0:
        angle = 0.5 * np.pi * faded / bank[Fact.FADE]  # powers add up to one: sin^2 + cos^2
        x *= np.sin(angle)
        if other >= 0:
            voice = State.VOICES + (state.shape[1] - State.VOICES) // 2
            x += np.cos(angle) * sound(bank, index, state, phase, contact, other, voice, renew)
        now[Phase.FADED] = faded + 1
        if faded + 1 >= bank[Fact.FADE]:
            now[Phase.FADED], now[Phase.OTHER] = 0, NONE
    return min(max(x, -bank[Fact.OUTPUT]), bank[Fact.OUTPUT])


@njit(cache=True, error_model="numpy")
def step_all(bank, index, state, phase):  # type: ignore[no-untyped-def]
    """Take the motion of every contact out of its state, and put its sample there; return whether finite."""
    finite = True
    for c in range(state.shape[0]):
        x = step(bank, index, state, phase, c, state[c, State.VX], state[c, State.VY], state[c, State.PRESS])
        state[c, State.OUT] = x
        finite = finite and np.isfinite(x)
    return finite


@njit(cache=True, error_model="numpy")
def play(bank, index, state, phase, velocity, force, wanted, out):  # type: ignore[no-untyped-def]
    """Fill `out` (n_contacts, n); `wanted` is the model of each contact and sample, or of none, (0, 0)."""
    for t in range(force.shape[1]):
        for c in range(force.shape[0]):
            if wanted.size:
                phase[c, Phase.WANTED] = wanted[c, t]
            out[c, t] = step(bank, index, state, phase, c, velocity[c, t, 0], velocity[c, t, 1], force[c, t])
