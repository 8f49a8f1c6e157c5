"""Render textures whose parameters are functions of the motion, with compiled kernels per sample.

A sample is a weighted sum of the states of a lattice filter plus a sum of oscillators::

    y = sum_m nu_m b_m + sum_j a_j cos(phase_j)

where b_m are the states of a lattice with reflection coefficients k, driven by white noise. Planned scenes
use the same kernels `lattice` and `oscillators` (`texclass.haptics.scene.render_kernels`).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from texclass.compilation import njit
from texclass.recording import Samples
from texclass.vibration.lattice import rotate

SHRINK = 1 - 2 * float(np.finfo(np.float64).eps)
"""Factor applied to each rotation of the lattice. It outweighs rounding errors, which bounds the states."""
MAX_BLOCK = 4096
"""Largest number of samples that are rendered at a time, which limits the memory for parameters."""
MAX_INPUT = 1e9
"""Largest magnitude of the inputs of all renderers: velocity in mm/s, force in N, position in mm. No hand
comes near it, and squares of inputs remain exact enough to recover from one wrong sample (our choice)."""

ParameterMap = Callable[[Samples], tuple[Samples, Samples]]


def check_path(velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples]:
    """Validate a path and return it as contiguous float64 arrays.

    Parameters
    ----------
    velocity : array_like of shape (n, 2)
        Velocity in mm/s.
    force : array_like of shape (n,)
        Normal force in N.

    Raises
    ------
    ValueError
        If the shapes do not match, or a value is NaN or exceeds `MAX_INPUT` in magnitude.
    """
    v = np.ascontiguousarray(velocity, dtype=np.float64)
    f = np.ascontiguousarray(force, dtype=np.float64)
    if f.ndim != 1 or v.shape != (f.size, 2):
        raise ValueError(f"velocity and force must have shapes (n, 2) and (n,), got {v.shape} and {f.shape}")
    if not _all_within_bounds(v, f):
        raise ValueError(describe_refused(v, f))
    return v, f


def describe_refused(velocity: Samples, force: Samples) -> str:
    """Return the message about the first invalid sample of velocities (..., 2) and forces (...)."""
    inputs = np.concatenate([velocity, force[..., np.newaxis]], axis=-1).reshape(-1, 3)
    first = inputs[np.argmin((np.abs(inputs) <= MAX_INPUT).all(axis=1))]
    vx, vy, f = (f"{x:g}" for x in first)
    return (
        f"velocity and force must be finite and at most {MAX_INPUT:g} mm/s and N in magnitude, "
        f"got {vx} and {vy} mm/s and {f} N. Check the sensor, or exclude the sample"
    )


@njit(cache=True, error_model="numpy")
def _all_within_bounds(velocity: Samples, force: Samples) -> bool:
    """Return whether no value is NaN or above `MAX_INPUT`; ten times faster than NumPy for one sample."""
    is_valid = True
    for t in range(force.size):
        is_valid = is_valid and is_valid_motion(velocity[t, 0], velocity[t, 1], force[t])
    return is_valid


@njit(cache=True, error_model="numpy")
def is_valid_motion(vx, vy, force):  # type: ignore[no-untyped-def]
    """Return whether no input is NaN or exceeds `MAX_INPUT` in magnitude."""
    return abs(vx) <= MAX_INPUT and abs(vy) <= MAX_INPUT and abs(force) <= MAX_INPUT


def stack_motion(velocity: Samples, force: Samples) -> Samples:
    """Stack a path as columns (v_x, v_y, f), shape (n, 3), with negative forces replaced by 0."""
    return np.column_stack([velocity, np.maximum(force, 0.0)])


class MotionRenderer:
    """Render a lattice filter and oscillators whose parameters are functions of the motion; see `Renderer`.

    1. The motion is smoothed by a first-order low-pass filter (`motion_hz`).
    2. Every `hop` samples, new parameters are computed from the smoothed motion.
    3. The parameters change linearly and reach the new values at the next update, so a change of motion takes
       effect within one to two hops. With `glide=False`, they change at once.

    Parameters
    ----------
    parameter_map : callable
        Function that maps the smoothed motion (n, d) to `stages` (n, order + n_lines) and `taps` (n, n_taps +
        n_lines). Stages are the reflection coefficients k, followed by the phase steps of the lines in rad
        per sample. Taps are the weights nu of the lattice states, followed by the line amplitudes. If n_taps
        is 1, the weight is the level.
    fs : float
        Sampling rate in Hz.
    hop : int
        Number of samples between parameter updates, at least 1.
    limit : float
        Largest magnitude of the output.
    seed : int
        Seed of the noise that drives the lattice.
    order, n_taps : int
        Order and number of taps of the lattice; n_taps is at most order + 1.
    phase : array_like of shape (n_lines,)
        Phase of the lines in rad at the first sample.
    motion : callable
        Function that maps velocity (n, 2) and force (n,) to the motion (n, d) (default `stack_motion`).
    start : array_like of shape (d,)
        Initial value of the smoothed motion; NaN means the motion at the first sample.
    motion_hz : float
        Bandwidth of the smoothing in Hz, which prevents clicks when the motion jumps (default: no smoothing).
    glide : bool
        Whether the parameters change linearly between updates (default) or in steps.
    factor : callable, optional
        Function that maps the smoothed motion to factors (n,) that multiply the output.
    n_stationary : int
        Number of lattice states whose random initial values have the variance of a stationary vibration. The
        reflection coefficients then start at 0 (white noise). If 0 (default), all states start at 0, and the
        coefficients start at the values of the first update.

    Examples
    --------
    A tone whose frequency in Hz equals the speed in mm/s:

    >>> def tone(motion):
    ...     step = 2 * np.pi * motion[:, :1] / 1000
    ...     return step, np.ones_like(step)
    >>> renderer = MotionRenderer(tone, fs=1000, hop=1, limit=2, seed=0, n_taps=0, phase=[0.0])
    >>> y = renderer.process([[250.0, 0.0]] * 4, [1.0] * 4)
    >>> [round(abs(sample), 3) for sample in y.tolist()]
    [1.0, 0.0, 1.0, 0.0]
    """

    def __init__(
        self,
        parameter_map: ParameterMap,
        *,
        fs: float,
        hop: int,
        limit: float,
        seed: int,
        order: int = 0,
        n_taps: int = 1,
        phase: ArrayLike = (),
        motion: Callable[[Samples, Samples], Samples] = stack_motion,
        start: ArrayLike = (0.0, 0.0, 0.0),
        motion_hz: float = np.inf,
        glide: bool = True,
        factor: Callable[[Samples], Samples] | None = None,
        n_stationary: int = 0,
    ) -> None:
        self.fs, self._parameter_map, self._motion, self._factor = fs, parameter_map, motion, factor
        self._hop, self._limit, self._glide = hop, limit, glide
        self._smoothing = 1 - float(np.exp(-2 * np.pi * motion_hz / fs))
        self._initial = (
            seed,
            n_stationary,
            np.array(phase, dtype=np.float64),
            np.array(start, dtype=np.float64),
        )
        self._order, n_lines = order, self._initial[2].size
        self._stages, self._taps = np.zeros((2, order + n_lines)), np.zeros((2, n_taps + n_lines))
        self._turns, self._b = np.zeros((2, order)), np.zeros(order + 1)
        self._phase, self._smoothed = self._initial[2].copy(), self._initial[3].copy()
        self.reset()

    def reset(self) -> None:
        """Reset the motion, and restart the random numbers and the phases."""
        seed, n_stationary, phase, start = self._initial
        self._rng = np.random.default_rng(seed)
        for state in (self._stages, self._taps, self._b):
            state[...] = 0.0
        self._b[:n_stationary] = self._rng.standard_normal(n_stationary)
        self._phase[:], self._smoothed[:] = phase, start
        self._index, self._has_begun = 0, n_stationary > 0

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples of a path; the position is ignored."""
        v, f = check_path(velocity, force)
        blocks = [slice(i, i + MAX_BLOCK) for i in range(0, max(f.size, 1), MAX_BLOCK)]
        output = [self._process(v[block], f[block]) for block in blocks]
        return output[0] if len(output) == 1 else np.concatenate(output)

    def _process(self, velocity: Samples, force: Samples) -> Samples:
        n, index, hop = force.size, self._index, self._hop
        smoothed = self._motion(velocity, force)
        _smooth(smoothed, self._smoothing, self._smoothed)
        updates = smoothed[-index % hop :: hop]
        stages, taps = self._stages[:0], self._taps[:0]
        if len(updates):  # contiguous, because another memory layout would trigger a compilation
            stages, taps = map(np.ascontiguousarray, self._parameter_map(updates))
        if len(stages) and not self._has_begun:
            self._stages[1], self._has_begun = stages[0], True
        noise = self._rng.standard_normal(n) if self._order else np.zeros(n)
        factor, out = np.ones(n) if self._factor is None else self._factor(smoothed), np.empty(n)
        state = self._stages, self._taps, self._turns, self._b, self._phase
        _play(noise, stages, taps, factor, index, hop, self._glide, *state, self._limit, out)
        self._index = (index + n) % hop
        return out


@njit(cache=True, error_model="numpy")
def _smooth(motion, smoothing, state):  # type: ignore[no-untyped-def]
    """Low-pass filter the motion in place: s += smoothing (x - s)."""
    for t in range(motion.shape[0]):
        for i in range(motion.shape[1]):
            if np.isnan(state[i]):
                state[i] = motion[t, i]
            state[i] += smoothing * (motion[t, i] - state[i])
            motion[t, i] = state[i]


@njit(cache=True, error_model="numpy")
def lattice(f, k, c, b):  # type: ignore[no-untyped-def]
    """Filter one noise sample f with a lattice, given k and c = sqrt(1 - k^2); return the state b_0."""
    for m in range(k.size - 1, -1, -1):
        f, b[m + 1] = rotate(f, b[m], k[m], c[m])
    b[0] = f
    return f


@njit(cache=True, error_model="numpy")
def oscillators(x, amplitude, step, phase):  # type: ignore[no-untyped-def]
    """Return x + sum_j a_j cos(phase_j) and advance the phases; lines with a phase step of pi are silent."""
    for j in range(phase.size):
        if step[j] < np.pi:
            x += amplitude[j] * np.cos(phase[j])
        angle = phase[j] + step[j]
        phase[j] = angle - 2.0 * np.pi if angle > np.pi else angle
    return x


@njit(cache=True, error_model="numpy")
def _play(  # type: ignore[no-untyped-def]
    noise, next_stages, next_taps, factor, index, hop, glide, stages, taps, turns, b, phase, limit, out
):
    """Render a block to `out`; stages and taps change linearly from their first row to their second row."""
    p, q, row = turns.shape[1], taps.shape[1] - phase.size, 0
    current_stages, current_taps = stages[1].copy(), taps[1].copy()
    for t in range(noise.size):
        n_since = (index + t) % hop
        if n_since == 0:
            stages[0], taps[0] = (stages[1], taps[1]) if glide else (next_stages[row], next_taps[row])
            stages[1], taps[1] = next_stages[row], next_taps[row]
            row += 1
        if glide or n_since == 0 or t == 0:
            w = (n_since + 1) / hop if glide else 1.0
            for m in range(current_stages.size):
                current_stages[m] = (1.0 - w) * stages[0, m] + w * stages[1, m]
            for m in range(current_taps.size):
                current_taps[m] = (1.0 - w) * taps[0, m] + w * taps[1, m]
            for m in range(p):
                k = current_stages[m] * SHRINK
                turns[0, m], turns[1, m] = k, np.sqrt((1.0 - k) * (1.0 + k)) * SHRINK
        lattice(noise[t], turns[0], turns[1], b)
        y = 0.0
        for m in range(q):
            y += current_taps[m] * b[m]
        y = factor[t] * oscillators(y, current_taps[q:], current_stages[p:], phase)
        out[t] = min(max(y, -limit), limit)
