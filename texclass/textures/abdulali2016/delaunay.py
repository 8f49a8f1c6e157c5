"""The comparison: line spectra mixed in the simplex around the input, as the HaTT models do it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import spatial

from texclass.recording import Samples
from texclass.textures.abdulali2016 import _checks
from texclass.textures.abdulali2016.frame import Frame
from texclass.textures.abdulali2016.loudness import Loudness, level_of
from texclass.textures.abdulali2016.rendering import BUFFER, BufferedRenderer
from texclass.textures.abdulali2016.texture import LATTICE_OPERATIONS
from texclass.textures.stored import check_all_names, numbers
from texclass.vibration import line_spectrum


@dataclass(frozen=True, eq=False)
class DelaunayTexture:
    """Model points in a Delaunay triangulation of the input; outside of it, the nearest point.

    Parameters
    ----------
    name, fs, frame, loudness, growth, buffer, glide
        As for `NetworkTexture`.
    u : ndarray of shape (n_points, n_inputs)
        Normalised inputs of the points, which span the space.
    outputs : ndarray of shape (n_points, p + 1)
        Line spectral frequencies (rad per sample, increasing) and loudness.

    Raises
    ------
    ValueError
        If something breaks a rule, or the points lie in one plane.
    """

    family: ClassVar[str] = "abdulali2016-delaunay"
    name: str
    fs: float
    frame: Frame
    u: Samples
    outputs: Samples
    loudness: Loudness = "level"
    growth: tuple[float, float] = (0.0, 0.0)
    buffer: int = BUFFER
    glide: bool = True
    _mesh: spatial.Delaunay = field(init=False, repr=False)
    _tree: spatial.KDTree = field(init=False, repr=False)

    def __post_init__(self) -> None:
        _checks.check_common(self)
        _checks.check_loudness(self)
        u, outputs = (np.array(x, dtype=np.float64) for x in (self.u, self.outputs))
        if u.ndim != 2 or u.shape[1] != self.frame.n_inputs or outputs.ndim != 2 or len(u) != len(outputs):
            raise ValueError(
                f"u {u.shape} and outputs {outputs.shape}; the rule is (n, {self.frame.n_inputs}), (n, p + 1)"
            )
        if outputs.shape[1] < 2 or not (np.isfinite(u).all() and np.isfinite(outputs).all()):
            raise ValueError(
                "u or outputs hold NaN or infinity, or no frequency; the rule is finite, p at least 1"
            )
        if np.any(np.diff(outputs[:, :-1], axis=1) <= 0):
            raise ValueError("outputs are out of order; the rule is increasing frequencies")
        try:
            mesh = spatial.Delaunay(u)
        except (spatial.QhullError, ValueError) as error:
            raise ValueError(f"{len(u)} points do not span the input; the rule is a triangulation") from error
        for key, value in (("u", u), ("outputs", outputs), ("_mesh", mesh), ("_tree", spatial.KDTree(u))):
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, key, value)
        _checks.check_gap(self)

    @property
    def order(self) -> int:
        """Order p of the AR models."""
        return int(self.outputs.shape[1]) - 1

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample; LSF to k counts 4 p^2, finding the simplex nothing."""
        d, p = self.frame.n_inputs, self.order
        return LATTICE_OPERATIONS * p + (2 * d**2 + 2 * (d + 1) * (p + 1) + 4 * p**2) / self.buffer

    def models(self, velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples]:
        """Return reflection coefficients (n, p) and levels (n,); see `NetworkTexture.models`."""
        out = self._mixed(self.frame.inputs(velocity, force))
        k = line_spectrum.to_reflection(line_spectrum.spread(out[:, :-1], self.frame.gap))
        level = level_of(self.loudness, out[:, -1], k, self.frame.motion(velocity, force), self.growth)
        return k, np.minimum(level, self.frame.cap(velocity, force))

    def _mixed(self, u: Samples) -> Samples:
        """Return sum_i b_i f_i, with b the barycentric coordinates in the simplex of each input."""
        simplex = self._mesh.find_simplex(u)
        inside = simplex >= 0
        out = self.outputs[self._tree.query(u)[1]]
        to_b = self._mesh.transform[simplex[inside]]
        b = np.einsum("nij,nj->ni", to_b[:, :-1], u[inside] - to_b[:, -1])
        b = np.clip(np.column_stack([b, 1 - b.sum(axis=1)]), 0.0, None)
        flat = ~np.isfinite(b).all(axis=1)  # simplices without volume: stay with the nearest point
        corners = self.outputs[self._mesh.simplices[simplex[inside]]]
        mixed = np.einsum("ni,nij->nj", np.where(flat[:, np.newaxis], 0.0, b), corners)
        out[inside] = np.where(
            flat[:, np.newaxis], out[inside], mixed / np.maximum(b.sum(axis=1), 1e-300)[:, np.newaxis]
        )
        return np.asarray(out)

    def renderer(self, *, seed: int = 0) -> BufferedRenderer:
        """Return a renderer at rest."""
        return BufferedRenderer(self, buffer=self.buffer, glide=self.glide, seed=seed)

    def parameters(self) -> Mapping[str, Any]:
        """Return what is not an array, as JSON knows it."""
        rest = {key: getattr(self, key) for key in ("name", "fs", "loudness", "buffer", "glide")}
        return rest | {"frame": self.frame.parameters(), "growth": list(self.growth)}

    def arrays(self) -> Mapping[str, NDArray[np.float64]]:
        """Return the points and what they say."""
        return {"u": self.u, "outputs": self.outputs}

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the texture of what `parameters` and `arrays` returned; ValueError if it is none."""
        names = {"name", "fs", "frame", "loudness", "growth", "buffer", "glide"}, {"u", "outputs"}
        check_all_names(cls.family, parameters, arrays, names)
        rest = {key: parameters[key] for key in ("name", "fs", "loudness", "growth", "buffer", "glide")}
        return cls(
            frame=Frame.restore(parameters["frame"]),
            u=numbers(arrays, "u"),
            outputs=numbers(arrays, "outputs"),
            **rest,
        )
