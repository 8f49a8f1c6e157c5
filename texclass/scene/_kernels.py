"""The loop over samples: every contact plays one model, or two while one fades into the other.

All models lie in one array (`bank`), where is what in another (`index`). Nothing is allocated, not even what
numba allocates for each array that comes from Python: a call for one sample hands over one address, of the
`table` that says where the arrays are.
"""

from typing import Any

import numpy as np
from numba import carray, njit, types  # type: ignore[attr-defined]
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from texclass.vibration.lattice_kernels import turn
from texclass.vibration.recursions import LARGEST

N_LINES, ORDER, N_SPEEDS, N_FORCES, AT_SPEEDS, AT_FORCES, AT_ROWS, AT_POWER, AT_COURSE, AT_LIMIT = range(10)
N_INDEX = 10
"""Columns of `index`: what a model is, and where its parts begin in `bank`."""
GLIDE, HOP, FADE, STILL, RADIANS, OUTPUT = range(6)
N_FACTS = 6
"""`facts`: share of the way that speed and force go per sample, samples between renewals, samples of a
crossfade, the part of the slowest speed where fading begins, 2 pi / fs, the device's largest output."""
SPEED, FORCE, VOICES = 0, 1, 2
"""`state` of a contact: followed speed and force, then two voices of 3 (order + lines + 1) numbers each."""
MODEL, OTHER, WANTED, FADED, COUNT, STARTED = range(6)
N_NUMBERS = 6
"""`numbers` of a contact: the model that plays, the one that fades out, the one asked for (-1: none), samples
into the crossfade (0: none), samples since the renewal, whether speed and force are known."""
NONE = -1
UNKNOWN = -1.0
"""Loudness before the first sample of a voice, which takes its own at once."""

BANK, N_BANK, INDEX, N_MODELS, FACTS, STATE, N_CONTACTS, N_STATE, NUMBERS, NOISE, MOTION, OUT = range(12)
"""`table`: addresses of the arrays, and their sizes."""


def table_of(*arrays: NDArray[Any]) -> NDArray[np.int64]:
    """Return the table of bank, index, facts, state, numbers, noise, motion, out; hold them along with it."""
    bank, index, _, state, *_ = arrays
    found: NDArray[np.int64] = np.zeros(12, dtype=np.int64)
    where = (BANK, INDEX, FACTS, STATE, NUMBERS, NOISE, MOTION, OUT)
    for place_, array in zip(where, arrays, strict=True):
        found[place_] = array.ctypes.data
    found[[N_BANK, N_MODELS, N_CONTACTS, N_STATE]] = bank.size, len(index), *state.shape
    return found


def _pointer(typing_context: Any, address: Any) -> Any:
    """Type and generate the pointer to an address."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(address), generate


pointer: Any = intrinsic(_pointer)


@njit(cache=True, error_model="numpy")
def arrays_of(address):  # type: ignore[no-untyped-def]
    """Return bank, index, facts, state, numbers and noise of a table at an address."""
    t = carray(pointer(address), (12,), np.int64)
    n = t[N_CONTACTS]
    return (
        carray(pointer(t[BANK]), (t[N_BANK],), np.float64),
        carray(pointer(t[INDEX]), (t[N_MODELS], N_INDEX), np.int64),
        carray(pointer(t[FACTS]), (N_FACTS,), np.float64),
        carray(pointer(t[STATE]), (n, t[N_STATE]), np.float64),
        carray(pointer(t[NUMBERS]), (n, N_NUMBERS), np.int64),
        carray(pointer(t[NOISE]), (n,), np.uint64),
    )


_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1, _MIX_2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31 = np.uint64(30), np.uint64(27), np.uint64(31)
_S16, _S32, _S48, _LOW = np.uint64(16), np.uint64(32), np.uint64(48), np.uint64(0xFFFF)
_MEAN, _DEVIATION = 131070.0, float(np.sqrt((65536.0**2 - 1) / 3))


@njit(cache=True, error_model="numpy")
def draw(noise, contact):  # type: ignore[no-untyped-def]
    """Return white noise of unit variance within 3.47 deviations: four 16-bit parts of SplitMix64, summed."""
    noise[contact] += _GOLDEN
    z = noise[contact]
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    z = z ^ (z >> _S31)
    total = (z & _LOW) + ((z >> _S16) & _LOW) + ((z >> _S32) & _LOW) + (z >> _S48)
    return (np.float64(total) - _MEAN) / _DEVIATION


@njit(cache=True, error_model="numpy")
def place(bank, at, n, x):  # type: ignore[no-untyped-def]
    """Return the node below x, the one above, and the share of the latter in ln x; held at both ends."""
    if n == 1 or x <= bank[at]:
        return 0, 0, 0.0
    if x >= bank[at + n - 1]:
        return n - 1, n - 1, 0.0
    i = 0
    while x >= bank[at + i + 1]:
        i += 1
    return i, i + 1, np.log(x / bank[at + i]) / np.log(bank[at + i + 1] / bank[at + i])


@njit(cache=True, error_model="numpy")
def start(bank, index, state, noise, contact, model, voice):  # type: ignore[no-untyped-def]
    """Give a voice the state of a vibration that has been going on: all residuals of unit variance."""
    p, n = index[model, ORDER], index[model, N_LINES]
    for m in range(p + 1):
        state[contact, voice + m] = draw(noise, contact)
    for m in range(p + 1, p + 1 + n):
        state[contact, voice + m] = draw(noise, contact) * (np.pi / 3.5)
    state[contact, voice + 2 * ((state.shape[1] - VOICES) // 6) + p + n] = UNKNOWN


@njit(cache=True, error_model="numpy")
def sound(bank, index, facts, state, noise, contact, model, voice, renew):  # type: ignore[no-untyped-def]
    """Return the next sample of one voice.

    `b` holds the lattice and the phases, `k` reflection coefficients, amplitudes and the share of the noise,
    `c` sqrt(1 - k^2), the steps of the phases and the followed loudness.
    """
    p, n = index[model, ORDER], index[model, N_LINES]
    if p + n == 0:
        return 0.0
    v, f = state[contact, SPEED], state[contact, FORCE]
    n_f = index[model, N_FORCES]
    i0, i1, wv = place(bank, index[model, AT_SPEEDS], index[model, N_SPEEDS], v)
    j0, j1, wf = place(bank, index[model, AT_FORCES], n_f, f)
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
                state[contact, c + m] = min(hz * facts[RADIANS], np.pi)
                share -= 0.5 * x * x
            state[contact, k + m] = x
        state[contact, k + row] = np.sqrt(max(share, 0.0))
    x = 0.0
    if p > 0:
        x = draw(noise, contact)
        for m in range(p - 1, -1, -1):
            x, up = turn(x, state[contact, b + m], state[contact, k + m], state[contact, c + m])
            state[contact, b + m + 1] = up
        state[contact, b] = x
        x *= state[contact, k + p + n]
    for m in range(p, p + n):
        phase = state[contact, b + 1 + m]
        if state[contact, c + m] < np.pi:
            x += state[contact, k + m] * np.cos(phase)
        phase += state[contact, c + m]
        state[contact, b + 1 + m] = phase - 2.0 * np.pi if phase > np.pi else phase
    at = index[model, AT_POWER]
    ln_power = w00 * bank[at + n00] + w01 * bank[at + n01] + w10 * bank[at + n10] + w11 * bank[at + n11]
    loud = min(v / (facts[STILL] * bank[index[model, AT_SPEEDS]]), 1.0)
    loud *= min(f / bank[index[model, AT_FORCES]], 1.0)
    heard = state[contact, c + p + n]
    heard = loud if heard < 0.0 else heard + facts[GLIDE] * (loud - heard)
    state[contact, c + p + n] = heard if heard > 1e-30 else 0.0
    limit = bank[index[model, AT_LIMIT]]
    return min(max(heard * np.exp(0.5 * ln_power) * x, -limit), limit)


@njit(cache=True, error_model="numpy")
def follow(facts, state, numbers, contact, vx, vy, force):  # type: ignore[no-untyped-def]
    """Move speed and force one sample towards the hand's: s += glide (target - s)."""
    v, f = np.sqrt(vx * vx + vy * vy), max(force, 0.0)
    share = facts[GLIDE] if numbers[contact, STARTED] else 1.0
    numbers[contact, STARTED] = 1
    state[contact, SPEED] += share * (v - state[contact, SPEED])
    state[contact, FORCE] += share * (f - state[contact, FORCE])
    for s in (SPEED, FORCE):
        if state[contact, s] < 1e-30:  # not into the range of slow, subnormal numbers
            state[contact, s] = 0.0


@njit(cache=True, error_model="numpy")
def exchange(bank, index, facts, state, numbers, noise, contact):  # type: ignore[no-untyped-def]
    """Begin the crossfade to what was asked for, unless one is under way."""
    if numbers[contact, FADED] != 0 or numbers[contact, WANTED] == numbers[contact, MODEL]:
        return
    width = (state.shape[1] - VOICES) // 2
    for i in range(width):
        state[contact, VOICES + width + i] = state[contact, VOICES + i]
    numbers[contact, OTHER] = numbers[contact, MODEL]
    numbers[contact, MODEL] = numbers[contact, WANTED]
    numbers[contact, FADED] = 1
    numbers[contact, COUNT] = 0
    if numbers[contact, MODEL] >= 0:
        start(bank, index, state, noise, contact, numbers[contact, MODEL], VOICES)


@njit(cache=True, error_model="numpy")
def step(bank, index, facts, state, numbers, noise, contact, vx, vy, force):  # type: ignore[no-untyped-def]
    """Return the next sample of a contact; NaN, and nothing done, if the input is not finite."""
    if not (np.isfinite(vx) and np.isfinite(vy) and np.isfinite(force)):
        return np.nan
    exchange(bank, index, facts, state, numbers, noise, contact)
    model, other, faded = numbers[contact, MODEL], numbers[contact, OTHER], numbers[contact, FADED]
    if model < 0 and other < 0:
        numbers[contact, STARTED] = 0
        numbers[contact, FADED] = 0
        return 0.0
    follow(facts, state, numbers, contact, vx, vy, force)
    renew = numbers[contact, COUNT] == 0
    numbers[contact, COUNT] += 1
    if numbers[contact, COUNT] >= facts[HOP]:
        numbers[contact, COUNT] = 0
    x = 0.0
    if model >= 0:
        x = sound(bank, index, facts, state, noise, contact, model, VOICES, renew)
    if faded > 0:
        angle = 0.5 * np.pi * faded / facts[FADE]  # powers add up to one: sin^2 + cos^2
        x *= np.sin(angle)
        if other >= 0:
            voice = VOICES + (state.shape[1] - VOICES) // 2
            old = sound(bank, index, facts, state, noise, contact, other, voice, renew)
            x += np.cos(angle) * old
        numbers[contact, FADED] = faded + 1
        if faded + 1 >= facts[FADE]:
            numbers[contact, FADED], numbers[contact, OTHER] = 0, NONE
    return min(max(x, -facts[OUTPUT]), facts[OUTPUT])


@njit(cache=True, error_model="numpy")
def step_one(address, contact, vx, vy, force):  # type: ignore[no-untyped-def]
    """Return what `step` does, of the arrays in the table at an address."""
    bank, index, facts, state, numbers, noise = arrays_of(address)
    return step(bank, index, facts, state, numbers, noise, contact, vx, vy, force)


@njit(cache=True, error_model="numpy")
def step_all(address):  # type: ignore[no-untyped-def]
    """Fill `out` from `motion`; return whether all of it was finite."""
    bank, index, facts, state, numbers, noise = arrays_of(address)
    t = carray(pointer(address), (12,), np.int64)
    n = t[N_CONTACTS]
    motion = carray(pointer(t[MOTION]), (n, 3), np.float64)
    out = carray(pointer(t[OUT]), (n,), np.float64)
    finite = True
    for contact in range(n):
        vx, vy, force = motion[contact, 0], motion[contact, 1], motion[contact, 2]
        out[contact] = step(bank, index, facts, state, numbers, noise, contact, vx, vy, force)
        finite = finite and np.isfinite(out[contact])
    return finite


@njit(cache=True, error_model="numpy")
def play(address, velocity, force, wanted, out):  # type: ignore[no-untyped-def]
    """Fill `out` (n_contacts, n); `wanted` is the model of each contact and sample, or of none, (0, 0)."""
    bank, index, facts, state, numbers, noise = arrays_of(address)
    for t in range(force.shape[1]):
        for contact in range(force.shape[0]):
            if wanted.size:
                numbers[contact, WANTED] = wanted[contact, t]
            vx, vy = velocity[contact, t, 0], velocity[contact, t, 1]
            f = force[contact, t]
            out[contact, t] = step(bank, index, facts, state, numbers, noise, contact, vx, vy, f)
