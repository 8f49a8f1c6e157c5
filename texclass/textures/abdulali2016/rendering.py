"""A texture being felt: a map from input to line spectrum and loudness, made to sound buffer by buffer."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.textures.abdulali2016 import _kernels as kernels
from texclass.textures.abdulali2016.frame import LIMIT, Frame
from texclass.textures.abdulali2016.preprocessing import MOTION_HZ
from texclass.textures.path import checked_path

BUFFER = 16
"""Samples between two readings of the map; `abdulali2016`, section 4.2."""
NOISE = 256
"""Random numbers drawn at a time."""


class Model(Protocol):
    """What can be rendered: see `NetworkTexture` and `DelaunayTexture`."""

    @property
    def fs(self) -> float:
        """Hz."""

    @property
    def frame(self) -> Frame:
        """Range and bounds."""

    @property
    def order(self) -> int:
        """P."""

    def models(self, velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples]:
        """Return reflection coefficients (n, p) and levels (n,) at velocities (n, 2) and forces (n,)."""


class BufferedRenderer:
    """Plays a map along a path; see `Renderer`.

    The motion is followed with the bandwidth it was recorded with (25 Hz, first order), so that a jump of
    speed, force or direction cannot click. Every `buffer` samples the map is read, and the parameters move,
    sample by sample, to what it says by the next reading: a change is felt one buffer later.

    Parameters
    ----------
    model : Model
    buffer : int
        Samples between readings, at least 1.
    glide : bool
        False: the parameters jump at each reading and stay until the next, as in the paper.
    seed : int
        Of the noise.
    """

    def __init__(self, model: Model, *, buffer: int = BUFFER, glide: bool = True, seed: int = 0) -> None:
        if buffer < 1:
            raise ValueError(f"buffer is {buffer}; the rule is at least 1 sample")
        self.fs, self._model, self._buffer, self._glide, self._seed = model.fs, model, buffer, glide, seed
        self._share = 1 - float(np.exp(-2 * np.pi * MOTION_HZ / model.fs))
        self._limit = LIMIT * model.frame.peak
        self._k, self._level = np.zeros((2, model.order)), np.zeros(2)
        self._b, self._motion = np.zeros(model.order + 1), np.zeros(3)
        self._noise = Noise(seed)
        self.reset()

    def reset(self) -> None:
        """Return to rest, with the random numbers of the first sample."""
        for state in (self._k, self._level, self._motion):
            state[...] = 0.0
        self._place = 0
        self._noise = Noise(self._seed)
        self._b[:] = self._noise.rng.standard_normal(self._b.size)

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples of a path; the position is not used."""
        v, f = checked_path(velocity, force)
        out, course = np.empty(f.size), np.empty((f.size, 3))
        kernels.follow(v, f, self._share, self._motion, course)
        due = course[-self._place % self._buffer :: self._buffer]
        readings = zip(*self._model.models(due[:, :2], due[:, 2]), strict=True) if len(due) else iter(())
        start = 0
        while start < f.size:
            if self._place == 0:
                self._aim(*next(readings))
            n = min(f.size - start, self._buffer - self._place)
            n, noise = self._noise.next(n)
            stop, when = start + n, (self._place, self._buffer)
            kernels.glide(noise, self._k, self._level, *when, self._b, self._limit, out[start:stop])
            start, self._place = stop, (self._place + n) % self._buffer
        return out

    def _aim(self, k: Samples, level: float) -> None:
        """Let the parameters move to what the map says."""
        self._k[0], self._level[0] = (self._k[1], self._level[1]) if self._glide else (k, level)
        self._k[1], self._level[1] = k, level


class Noise:
    """Standard normal numbers, the same however many are asked for at a time."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self._drawn, self._at = np.empty(NOISE), NOISE

    def next(self, n: int) -> tuple[int, Samples]:
        """Return up to n numbers, at least one, and how many."""
        if self._at == NOISE:
            self.rng.standard_normal(out=self._drawn)
            self._at = 0
        n = min(n, NOISE - self._at)
        self._at += n
        return n, self._drawn[self._at - n : self._at]
