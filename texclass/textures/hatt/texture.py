"""The texture: an ARMA model of the vibration at each node of a mesh of speeds and forces."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.recording import Samples
from texclass.textures.hatt import _kernels as kernels
from texclass.textures.hatt.mesh import Mesh, triangulate
from texclass.textures.hatt.renderer import HattRenderer
from texclass.textures.stored import check_all_names
from texclass.vibration import line_spectrum

HOP_S = 0.01
"""The parameters aim anew at the model of the present speed and force so often, as in the toolkit."""
LIMIT = 8.0
"""Rendered samples are held within this times the RMS of the loudest node."""
LARGEST_ORDER = 1000
MOST_WORK = 500_000_000
"""Largest n_nodes (p^2 + q^2): a hostile file ends within seconds."""


@dataclass(frozen=True, eq=False)
class HattTexture:
    """ARMA models at nodes of speed and force; between them line spectra, variance and gain go linearly.

    At each node y = -sum_i a_i y[t-i] + gain (e[t] + sum_i c_i e[t-i]) with white noise e of its variance.

    Parameters
    ----------
    mesh : Mesh
        Nodes in mm/s and N, and triangles.
    ar_lsf : array_like of shape (n_nodes, p)
        Line spectral frequencies of A, rad per sample, strictly increasing, in (0, pi).
    ma_lsf : array_like of shape (n_nodes, q)
        Of C, the same rule; q may be 0.
    variance : array_like of shape (n_nodes,)
        Of the noise e, (m/s^2)^2, at least 0.
    gain : array_like of shape (n_nodes,)
        Of the MA part, at least 0.
    fs : float
        Hz; the published textures have 1000 Hz.
    name : str, optional
        Of the surface.
    mu : float
        Coefficient of kinetic friction, at least 0.

    Raises
    ------
    ValueError
        If a shape does not fit or a rule is broken; the message names which.

    References
    ----------
    Culbertson, Lopez Delgado, Kuchenbecker, "One hundred data-driven haptic texture models and open-source
    methods for rendering on 3D objects", 2014.

    Notes
    -----
    Our readings: outside the triangles the nearest point of an edge holds; at rest and without contact it is
    silent, whatever the nodes say; parameters glide from one aim to the next (`HOP_S`); the lattice replaces
    the direct form, whose changing coefficients are bounded by nothing.
    """

    family: ClassVar[str] = "hatt"
    mesh: Mesh
    ar_lsf: Samples
    ma_lsf: Samples
    variance: Samples
    gain: Samples
    fs: float
    name: str = ""
    mu: float = 0.0

    def __post_init__(self) -> None:
        for name in ("ar_lsf", "ma_lsf", "variance", "gain"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if not (np.isfinite(self.fs) and self.fs > 0):
            raise ValueError(f"fs is {self.fs}; the rule is above 0 Hz")
        if not (np.isfinite(self.mu) and self.mu >= 0):
            raise ValueError(f"mu is {self.mu}; the rule is finite, >= 0")
        self._check_shapes()
        for name in ("ar_lsf", "ma_lsf"):
            self._check_frequencies(name)
        for name in ("variance", "gain"):
            values = getattr(self, name)
            wrong = ~(np.isfinite(values) & (values >= 0))
            if wrong.any():
                raise ValueError(f"{name} of a node is {values[wrong][0]}; the rule is finite, >= 0")
        if not np.all(np.isfinite(self.levels)):
            raise ValueError("the RMS of a node exceeds a float; the rule is a finite one")

    def _check_shapes(self) -> None:
        n = self.mesh.speed.size
        shapes = {name: getattr(self, name).shape for name in ("ar_lsf", "ma_lsf", "variance", "gain")}
        for name, rank in (("ar_lsf", 2), ("ma_lsf", 2), ("variance", 1), ("gain", 1)):
            if len(shapes[name]) != rank or shapes[name][0] != n:
                raise ValueError(f"{name} has shape {shapes[name]}; the rule is {n} rows, one a node")
        p, q = shapes["ar_lsf"][1], shapes["ma_lsf"][1]
        if not (1 <= p <= LARGEST_ORDER and q <= LARGEST_ORDER):
            raise ValueError(f"orders are {p} (AR) and {q} (MA); the rule is 1 ... and 0 ... {LARGEST_ORDER}")
        if n * (p**2 + q**2) > MOST_WORK:
            raise ValueError(f"{n} nodes of orders {p} and {q}; the rule is n (p^2 + q^2) <= {MOST_WORK}")

    def _check_frequencies(self, name: str) -> None:
        lsf = getattr(self, name)
        gaps = np.diff(lsf, axis=1, prepend=0.0, append=np.pi) if lsf.shape[1] else np.ones((1, 1))
        if not np.all(gaps >= line_spectrum.MIN_GAP):  # of NaN neither
            node, i = np.argwhere(~(gaps >= line_spectrum.MIN_GAP))[0]
            raise ValueError(
                f"{name} of node {node} has a gap of {gaps[node, i]:.3g} at place {i}; the rule is rising in "
                f"(0, pi), gaps of at least {line_spectrum.MIN_GAP:g} rad: a stable model"
            )

    @classmethod
    def from_models(
        cls,
        speed: ArrayLike,
        force: ArrayLike,
        ar_lsf: ArrayLike,
        variance: ArrayLike,
        fs: float,
        *,
        ma_lsf: ArrayLike | None = None,
        gain: ArrayLike | None = None,
        name: str = "",
        mu: float = 0.0,
    ) -> Self:
        """Return the texture of models at any speeds and forces, triangulated, silent at rest.

        Parameters
        ----------
        speed, force : array_like of shape (n,)
            mm/s and N, of each model.
        ar_lsf : array_like of shape (n, p)
            Line spectral frequencies, rad per sample.
        variance : array_like of shape (n,)
            Of the innovation.
        fs : float
            Hz.
        ma_lsf : array_like of shape (n, q), optional
            None by default: AR models.
        gain : array_like of shape (n,), optional
            Of the MA part, 1 by default.
        name, mu
            As for the class.

        Raises
        ------
        ValueError
            As `triangulate` and the class.
        """
        mesh, source = triangulate(speed, force)
        ar, s2 = np.asarray(ar_lsf, dtype=np.float64), np.asarray(variance, dtype=np.float64)
        ma = np.zeros((len(ar), 0)) if ma_lsf is None else np.asarray(ma_lsf, dtype=np.float64)
        g = np.ones(len(ar)) if gain is None else np.asarray(gain, dtype=np.float64)
        if {ar.shape[:1], ma.shape[:1], s2.shape, g.shape} != {np.shape(np.ravel(speed))}:
            raise ValueError(f"ar_lsf has shape {ar.shape}, variance {s2.shape}; the rule is one row a speed")
        touching = (mesh.speed > 0) & (mesh.force > 0)
        silent = np.where(touching, s2[source], 0.0)
        return cls(mesh, ar[source], ma[source], silent, g[source], fs, name, mu)

    @property
    def order(self) -> int:
        """Order p of the AR part."""
        return int(self.ar_lsf.shape[1])

    @property
    def ma_order(self) -> int:
        """Order q of the MA part."""
        return int(self.ma_lsf.shape[1])

    @property
    def hop(self) -> int:
        """Samples between two aims of the parameters."""
        return max(1, round(HOP_S * self.fs))

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample: lattice, ladder, the glide, and each aim by its hop."""
        p, q = max(self.order, self.ma_order), self.ma_order
        aim = 4.0 * (self.order**2 + q**2) + 3.0 * q**2
        return 6.0 * p + 2.0 * (q + 1) + 5.0 * p + 2.0 * (q + 1) + aim / self.hop

    @cached_property
    def levels(self) -> Samples:
        """RMS of the vibration at each node, m/s^2, shape (n_nodes,)."""
        rows = [self._lattice(np.array([i, i, i]), np.array([1.0, 0.0, 0.0])) for i in range(len(self.gain))]
        return np.array([np.linalg.norm(nu) for _, nu in rows])

    def at(self, speed: float, force: float) -> tuple[Samples, Samples]:
        """Return the lattice at a speed (mm/s) and force (N).

        Returns
        -------
        reflection : ndarray of shape (max(p, q),)
            Of A, zeros beyond p.
        taps : ndarray of shape (q + 1,)
            nu_m in m/s^2; their norm is the RMS. Zeros at rest and without contact.
        """
        k, nu = self._lattice(*self.mesh.weights(abs(speed), max(force, 0.0)))
        return k, nu if speed != 0 and force > 0 else np.zeros_like(nu)

    def _lattice(self, nodes: NDArray[np.int64], weights: Samples) -> tuple[Samples, Samples]:
        k, nu = np.zeros(max(self.order, self.ma_order)), np.zeros(self.ma_order + 1)
        models = self.ar_lsf, self.ma_lsf, self.variance, self.gain
        kernels.model(nodes, weights, *models, k, nu)
        return k, nu

    def renderer(self, *, seed: int = 0) -> HattRenderer:
        """Return a renderer at rest; the seed is that of the noise."""
        return HattRenderer(
            self.mesh,
            (self.ar_lsf, self.ma_lsf, self.variance, self.gain),
            self.fs,
            hop=self.hop,
            limit=LIMIT * float(self.levels.max()),
            seed=seed,
        )

    def parameters(self) -> Mapping[str, Any]:
        """Return what is not an array."""
        return {"name": self.name, "fs": self.fs, "mu": self.mu}

    def arrays(self) -> Mapping[str, NDArray[np.float64]]:
        """Return nodes, triangles (nodes counted from 0) and models."""
        return {
            "speed": self.mesh.speed,
            "force": self.mesh.force,
            "triangles": self.mesh.triangles.astype(np.float64),
            "ar_lsf": self.ar_lsf,
            "ma_lsf": self.ma_lsf,
            "variance": self.variance,
            "gain": self.gain,
        }

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the texture that was written down; a ValueError says what is wrong with it."""
        names = {"speed", "force", "triangles", "ar_lsf", "ma_lsf", "variance", "gain"}
        check_all_names(cls.family, parameters, arrays, ({"name", "fs", "mu"}, names))
        mesh = Mesh(arrays["speed"], arrays["force"], arrays["triangles"])
        models = {name: arrays[name] for name in ("ar_lsf", "ma_lsf", "variance", "gain")}
        fs, mu = float(parameters["fs"]), float(parameters["mu"])
        return cls(mesh, **models, fs=fs, name=str(parameters["name"]), mu=mu)
