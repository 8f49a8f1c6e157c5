"""A texture of ARMA models on a mesh, being felt."""

import math

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.textures.hatt import _kernels as kernels
from texclass.textures.hatt.mesh import Mesh
from texclass.textures.path import checked_path

NOISE = 1024
"""Random numbers drawn at a time."""


class HattRenderer:
    """Plays a `HattTexture` along a path; see `Renderer`. Silent at rest and without contact.

    Every `hop` samples the parameters aim at the model of the speed and force of that sample, and reach it,
    sample by sample on a straight line, when the next aim is taken: a change is felt for one to two hops.

    Parameters
    ----------
    mesh : Mesh
        Nodes and triangles.
    models : tuple of ndarray
        Line spectra of AR (n, p) and MA (n, q), variance (n,) and gain (n,) of the nodes.
    fs : float
        Hz.
    hop : int
        Samples between two aims.
    limit : float
        Bound of the samples, m/s^2.
    seed : int
        Of the noise.
    """

    def __init__(
        self,
        mesh: Mesh,
        models: tuple[Samples, Samples, Samples, Samples],
        fs: float,
        *,
        hop: int,
        limit: float,
        seed: int,
    ) -> None:
        self.fs, self._seed, self._hop, self._limit = fs, seed, hop, limit
        self._mesh, self._models, self._points = mesh, models, mesh.points
        p, q = models[0].shape[1], models[1].shape[1]
        self._k, self._nu = np.zeros((4, max(p, q))), np.zeros((3, q + 1))
        self._now = self._k[0], self._k[1], self._nu[0]
        self._glide = self._k[2], self._k[3], self._nu[1], self._nu[2]
        self._b, self._noise = np.zeros(max(p, q) + 1), np.empty(NOISE)
        self._nodes, self._weights = np.zeros(3, dtype=np.int64), np.zeros(3)
        self.reset()

    def reset(self) -> None:
        """Return to rest, with the random numbers of the first sample."""
        self._rng = np.random.default_rng(self._seed)
        for state in (self._k, self._nu, self._b):
            state[...] = 0
        self._drawn, self._place = NOISE, 0
        self._felt: tuple[float, float] | None = None

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples, m/s^2; the position is not used."""
        v, f = checked_path(velocity, force)
        out = np.empty(f.size)
        start = 0
        while start < f.size:
            if self._place == 0:
                self._aim(math.hypot(v[start, 0], v[start, 1]), float(f[start]))
            if self._drawn == NOISE:
                self._rng.standard_normal(out=self._noise)
                self._drawn = 0
            n = min(f.size - start, NOISE - self._drawn, self._hop - self._place)
            piece, e = out[start : start + n], self._noise[self._drawn : self._drawn + n]
            kernels.render(e, self._place, self._hop, self._limit, self._now, self._glide, self._b, piece)
            self._drawn += n
            self._place = (self._place + n) % self._hop
            start += n
        return out

    def _aim(self, speed: float, force: float) -> None:
        """Set the model that the parameters glide to."""
        k0, k1, nu0, nu1 = self._glide
        k0[:], nu0[:] = k1, nu1
        if self._felt == (speed, force):
            return
        x, y = speed / self._mesh.largest[0], max(force, 0.0) / self._mesh.largest[1]
        kernels.locate(x, y, self._points, self._mesh.triangles, self._nodes, self._weights)
        kernels.model(self._nodes, self._weights, *self._models, k1, nu1)
        if not (speed > 0 and force > 0):
            nu1[:] = 0.0
        if self._felt is None:
            k0[:] = k1
        self._felt = speed, force
