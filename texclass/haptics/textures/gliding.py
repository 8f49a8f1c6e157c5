"""A texture of lattice filters being felt: every few samples a map is read, and the filter glides there."""

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.vibration.lattice import turn

AT_ONCE = 4096
"""Samples of a path for which readings are held at a time."""
SHRINK = 1 - 2 * float(np.finfo(np.float64).eps)
"""Takes from each rotation more than its rounding may add."""


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
        raise ValueError(f"velocity has shape {v.shape}, force {f.shape}; the rule is (n, 2) and (n,)")
    if not _all_finite(v, f):
        raise ValueError("the path holds NaN or infinity; the rule is finite velocities and forces")
    return v, f


@njit(cache=True, error_model="numpy")
def _all_finite(velocity: Samples, force: Samples) -> bool:
    """Return whether neither holds NaN or infinity, in a tenth of NumPy's time for one sample."""
    for t in range(force.size):
        if not (np.isfinite(velocity[t, 0]) and np.isfinite(velocity[t, 1]) and np.isfinite(force[t])):
            return False
    return True


class GlidingRenderer:
    """Plays a map from motion to a lattice filter along a path; see `Renderer`.

    Every `hop` samples the map is read, and the parameters move, sample by sample on a straight line, to what
    it says by the next reading: a change is felt one to two hops later.

    Parameters
    ----------
    read : callable
        From velocities (n, 2), mm/s, and forces (n,), N, at least 0, to reflection coefficients (n, order)
        and taps (n, n_taps): a sample is the sum of taps times first states; a single tap is the level.
    fs : float
        Hz.
    order, n_taps : int
        Of the filter; n_taps at most order + 1.
    hop : int
        Samples between readings, at least 1.
    limit : float
        No sample exceeds it in size.
    seed : int
        Of the noise that drives the filter.
    motion_hz : float, optional
        Bandwidth (first order) with which the motion is followed, so that a jump of it cannot click; by
        default it is taken as it comes.
    glide : bool
        False: the parameters jump at each reading and stay until the next.
    running : bool
        Whether the process has gone on for ever: its states are drawn and its reflection coefficients glide
        from those of white noise. Else it begins with empty states and the coefficients first read.
    """

    def __init__(
        self,
        read: Callable[[Samples, Samples], tuple[Samples, Samples]],
        *,
        fs: float,
        order: int,
        n_taps: int = 1,
        hop: int,
        limit: float,
        seed: int,
        motion_hz: float = np.inf,
        glide: bool = True,
        running: bool = True,
    ) -> None:
        self.fs, self._read, self._seed = fs, read, seed
        self._hop, self._limit, self._glide, self._running = hop, limit, glide, running
        self._share = 1 - float(np.exp(-2 * np.pi * motion_hz / fs))
        self._k, self._taps = np.zeros((2, order)), np.zeros((2, n_taps))
        self._b, self._motion = np.zeros(order + 1), np.zeros(3)
        self._nothing = np.zeros((0, order)), np.zeros((0, n_taps))
        self.reset()

    def reset(self) -> None:
        """Return to rest, with the random numbers of the first sample."""
        self._rng = np.random.default_rng(self._seed)
        for state in (self._k, self._taps, self._b, self._motion):
            state[...] = 0.0
        if self._running:
            self._b[:] = self._rng.standard_normal(self._b.size)
        self._place, self._begun = 0, self._running

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples of a path; the position is not used."""
        v, f = checked_path(velocity, force)
        if f.size > AT_ONCE:
            cuts = range(AT_ONCE, f.size, AT_ONCE)
            pieces = zip(np.split(v, cuts), np.split(f, cuts), strict=True)
            return np.concatenate([self.process(*piece) for piece in pieces])
        course_v, course_f, out = np.empty(v.shape), np.empty(f.size), np.empty(f.size)
        _follow(v, f, self._share, self._motion, course_v, course_f)
        due = slice(-self._place % self._hop, None, self._hop)
        at, pressed = course_v[due], course_f[due]
        k, taps = self._read(at, pressed) if pressed.size else self._nothing
        if len(k) and not self._begun:
            self._k[1], self._begun = k[0], True
        state = self._k, self._taps, self._b
        noise = self._rng.standard_normal(f.size)
        _play(noise, k, taps, self._place, self._hop, self._glide, *state, self._limit, out)
        self._place = (self._place + f.size) % self._hop
        return out


@njit(cache=True, error_model="numpy")
def _follow(velocity, force, share, state, out_velocity, out_force):  # type: ignore[no-untyped-def]
    """Let the state (v_x, v_y, f) approach each input by a share of the difference; write its course."""
    for t in range(force.size):
        state[0] += share * (velocity[t, 0] - state[0])
        state[1] += share * (velocity[t, 1] - state[1])
        state[2] += share * (max(force[t], 0.0) - state[2])
        out_velocity[t, 0], out_velocity[t, 1], out_force[t] = state


@njit(cache=True, error_model="numpy")
def _play(noise, read_k, read_taps, place, hop, glide, k, taps, b, limit, out):  # type: ignore[no-untyped-def]
    """Pass noise through the lattice while k and taps move from their first row to their second."""
    row = 0
    for t in range(noise.size):
        since = (place + t) % hop
        if since == 0:
            k[0], taps[0] = (k[1], taps[1]) if glide else (read_k[row], read_taps[row])
            k[1], taps[1] = read_k[row], read_taps[row]
            row += 1
        w = (since + 1) / hop
        f = noise[t]
        for m in range(k.shape[1] - 1, -1, -1):
            r = ((1.0 - w) * k[0, m] + w * k[1, m]) * SHRINK
            f, b[m + 1] = turn(f, b[m], r, np.sqrt((1.0 - r) * (1.0 + r)) * SHRINK)
        b[0] = f
        y = 0.0
        for m in range(taps.shape[1]):
            y += ((1.0 - w) * taps[0, m] + w * taps[1, m]) * b[m]
        out[t] = min(max(y, -limit), limit)
