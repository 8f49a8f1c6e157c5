"""The renderer of every texture whose parameters are a function of the motion, and the kernels of a sample.

A sample is the sum of a lattice filter's states and of oscillators::

    y = sum_m nu_m b_m + sum_j a_j cos(phase_j)

with b_m the states of a lattice of reflection coefficients k, driven by white noise. `lattice` and
`oscillators` are also those of planned scenes (`texclass.haptics.scene.render_kernels`).
"""

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.vibration.lattice import turn

SHRINK = 1 - 2 * float(np.finfo(np.float64).eps)
"""Takes from each rotation more than its rounding may add."""

Read = Callable[[Samples], tuple[Samples, Samples]]


def checked_path(velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples]:
    """Return a path as contiguous float64 arrays.

    Parameters
    ----------
    velocity : array_like of shape (n, 2)
        mm/s.
    force : array_like of shape (n,)
        N.

    Raises
    ------
    ValueError
        If the shapes do not fit, or a value is NaN or infinite.
    """
    v = np.ascontiguousarray(velocity, dtype=np.float64)
    f = np.ascontiguousarray(force, dtype=np.float64)
    if f.ndim != 1 or v.shape != (f.size, 2):
        raise ValueError(f"velocity has shape {v.shape}, force {f.shape}. Expected (n, 2) and (n,)")
    if not _all_finite(v, f):
        raise ValueError("the path holds NaN or infinity. Expected finite velocities and forces")
    return v, f


@njit(cache=True, error_model="numpy")
def _all_finite(velocity: Samples, force: Samples) -> bool:
    """Return whether neither holds NaN or infinity, in a tenth of NumPy's time for one sample."""
    for t in range(force.size):
        if not (np.isfinite(velocity[t, 0]) and np.isfinite(velocity[t, 1]) and np.isfinite(force[t])):
            return False
    return True


def velocity_and_force(velocity: Samples, force: Samples) -> Samples:
    """Return a path as (v_x, v_y, f) with f at least 0, shape (n, 3)."""
    return np.column_stack([velocity, np.maximum(force, 0.0)])


class MotionRenderer:
    """Plays a map from motion to the parameters of a lattice filter and of oscillators; see `Renderer`.

    1. The motion is followed: the course moves towards it by a share of the difference at each sample.
    2. Every `hop` samples the map is read on the course.
    3. The parameters glide, sample by sample on a straight line, to what the map says by the next reading (a
       change is felt one to two hops later), or jump there at once.

    Parameters
    ----------
    read : callable
        From the course (n, d) to `stages` (n, order + n_lines) and `taps` (n, n_taps + n_lines): reflection
        coefficients k, then steps of the lines, radians per sample; weights nu of the lattice's states (a
        single one is the level), then amplitudes of the lines.
    fs : float
        Hz.
    hop : int
        Samples between readings, at least 1.
    limit : float
        No sample exceeds it in size.
    seed : int
        Of the noise that drives the lattice.
    order, n_taps : int
        Of the lattice; n_taps at most order + 1.
    phase : array_like of shape (n_lines,)
        Of the lines at the first sample, rad.
    motion : callable
        From velocity (n, 2) and force (n,) to what the course follows (n, d); see `velocity_and_force`.
    start : array_like of shape (d,)
        Where the course begins; NaN: at the first motion.
    motion_hz : float
        Bandwidth (first order) with which the motion is followed, so that a jump of it cannot click;
        infinite: the course is the motion.
    glide : bool
        False: the parameters jump at each reading and stay until the next.
    factor : callable, optional
        From the course to what multiplies each sample (n,).
    n_drawn : int
        States that begin as those of a vibration that has gone on for ever; the coefficients then glide from
        those of white noise. 0: it begins with empty states and the coefficients first read.
    """

    def __init__(
        self,
        read: Read,
        *,
        fs: float,
        hop: int,
        limit: float,
        seed: int,
        order: int = 0,
        n_taps: int = 1,
        phase: ArrayLike = (),
        motion: Callable[[Samples, Samples], Samples] = velocity_and_force,
        start: ArrayLike = (0.0, 0.0, 0.0),
        motion_hz: float = np.inf,
        glide: bool = True,
        factor: Callable[[Samples], Samples] | None = None,
        n_drawn: int = 0,
    ) -> None:
        self.fs, self._read, self._motion, self._factor = fs, read, motion, factor
        self._hop, self._limit, self._glide = hop, limit, glide
        self._share = 1 - float(np.exp(-2 * np.pi * motion_hz / fs))
        self._rest = seed, n_drawn, np.array(phase, dtype=np.float64), np.array(start, dtype=np.float64)
        self._order, n_lines = order, self._rest[2].size
        self._stages, self._taps = np.zeros((2, order + n_lines)), np.zeros((2, n_taps + n_lines))
        self._turns, self._b = np.zeros((2, order)), np.zeros(order + 1)
        self._phase, self._course = self._rest[2].copy(), self._rest[3].copy()
        self.reset()

    def reset(self) -> None:
        """Return to rest, with the random numbers and the phases of the first sample."""
        seed, n_drawn, phase, start = self._rest
        self._rng = np.random.default_rng(seed)
        for state in (self._stages, self._taps, self._b):
            state[...] = 0.0
        self._b[:n_drawn] = self._rng.standard_normal(n_drawn)
        self._phase[:], self._course[:] = phase, start
        self._place, self._has_begun = 0, n_drawn > 0

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples of a path; the position is not used."""
        v, f = checked_path(velocity, force)
        at_once = 4096  # samples of a path for which readings are held at a time
        pieces = [slice(i, i + at_once) for i in range(0, max(f.size, 1), at_once)]
        played = [self._process(v[piece], f[piece]) for piece in pieces]
        return played[0] if len(played) == 1 else np.concatenate(played)

    def _process(self, velocity: Samples, force: Samples) -> Samples:
        n, place, hop = force.size, self._place, self._hop
        course = self._motion(velocity, force)
        _follow(course, self._share, self._course)
        # of one layout: another one would be compiled for by itself, at the first sample that has it
        stages, taps = map(np.ascontiguousarray, self._read(course[-place % hop :: hop]))
        if len(stages) and not self._has_begun:
            self._stages[1], self._has_begun = stages[0], True
        noise = self._rng.standard_normal(n) if self._order else np.zeros(n)
        factor, out = np.ones(n) if self._factor is None else self._factor(course), np.empty(n)
        state = self._stages, self._taps, self._turns, self._b, self._phase
        _play(noise, stages, taps, factor, place, hop, self._glide, *state, self._limit, out)
        self._place = (place + n) % hop
        return out


@njit(cache=True, error_model="numpy")
def _follow(course, share, state):  # type: ignore[no-untyped-def]
    """Let the state approach each target of the course, and put itself in its place: s += share (x - s)."""
    for t in range(course.shape[0]):
        for i in range(course.shape[1]):
            if np.isnan(state[i]):
                state[i] = course[t, i]
            state[i] += share * (course[t, i] - state[i])
            course[t, i] = state[i]


@njit(cache=True, error_model="numpy")
def lattice(f, k, c, b):  # type: ignore[no-untyped-def]
    """Pass a sample f of the noise through a lattice of k and c = sqrt(1 - k^2); return its state b_0."""
    for m in range(k.size - 1, -1, -1):
        f, b[m + 1] = turn(f, b[m], k[m], c[m])
    b[0] = f
    return f


@njit(cache=True, error_model="numpy")
def oscillators(x, amplitude, step, phase):  # type: ignore[no-untyped-def]
    """Return x + sum_j a_j cos(phase_j), and move the phases; a step of pi is beyond fs / 2, and silent."""
    for j in range(phase.size):
        if step[j] < np.pi:
            x += amplitude[j] * np.cos(phase[j])
        angle = phase[j] + step[j]
        phase[j] = angle - 2.0 * np.pi if angle > np.pi else angle
    return x


@njit(cache=True, error_model="numpy")
def _play(  # type: ignore[no-untyped-def]
    noise, read_stages, read_taps, factor, place, hop, glide, stages, taps, turns, b, phase, limit, out
):
    """Fill `out` while stages and taps move from their first row to their second."""
    p, q, row = turns.shape[1], taps.shape[1] - phase.size, 0
    now_stages, now_taps = stages[1].copy(), taps[1].copy()
    for t in range(noise.size):
        since = (place + t) % hop
        if since == 0:
            stages[0], taps[0] = (stages[1], taps[1]) if glide else (read_stages[row], read_taps[row])
            stages[1], taps[1] = read_stages[row], read_taps[row]
            row += 1
        if glide or since == 0 or t == 0:
            w = (since + 1) / hop if glide else 1.0
            for m in range(now_stages.size):
                now_stages[m] = (1.0 - w) * stages[0, m] + w * stages[1, m]
            for m in range(now_taps.size):
                now_taps[m] = (1.0 - w) * taps[0, m] + w * taps[1, m]
            for m in range(p):
                k = now_stages[m] * SHRINK
                turns[0, m], turns[1, m] = k, np.sqrt((1.0 - k) * (1.0 + k)) * SHRINK
        lattice(noise[t], turns[0], turns[1], b)
        y = 0.0
        for m in range(q):
            y += now_taps[m] * b[m]
        y = factor[t] * oscillators(y, now_taps[q:], now_stages[p:], phase)
        out[t] = min(max(y, -limit), limit)
