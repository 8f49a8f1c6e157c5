"""A surface whose vibration a radial basis function network knows at any direction, speed and force."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.recording import Samples
from texclass.textures.abdulali2016 import _checks
from texclass.textures.abdulali2016.frame import Frame
from texclass.textures.abdulali2016.loudness import Loudness, level_of
from texclass.textures.abdulali2016.network import RadialNetwork
from texclass.textures.abdulali2016.rendering import BUFFER, BufferedRenderer
from texclass.textures.stored import check_all_names, numbers
from texclass.vibration import line_spectrum

LATTICE_OPERATIONS = 12
"""Per stage and sample: k between two, sqrt(1 - k^2), and the rotation."""


@dataclass(frozen=True, eq=False)
class NetworkTexture:
    """Texture of `abdulali2016`: velocity and force -> RBF network -> LSF and loudness -> AR process.

    Parameters
    ----------
    name : str
        Of the surface.
    fs : float
        Hz.
    frame : Frame
        Normalisation, range and bounds.
    network : RadialNetwork
        p line spectral frequencies (rad per sample) and the loudness, in this order.
    loudness : {"level", "variance"}
        What the last output is, see `level_of`: what the law of growth leaves, or a variance.
    growth : tuple of float
        Exponents of speed and of force in the level; for "level" only.
    buffer : int
        Samples between two readings of the network.
    glide : bool
        Whether parameters move between readings (else they jump, as in the paper).

    Raises
    ------
    ValueError
        If something breaks a rule; the message names it.
    """

    family: ClassVar[str] = "abdulali2016"
    name: str
    fs: float
    frame: Frame
    network: RadialNetwork
    loudness: Loudness = "level"
    growth: tuple[float, float] = (0.0, 0.0)
    buffer: int = BUFFER
    glide: bool = True

    def __post_init__(self) -> None:
        _checks.check_common(self)
        _checks.check_loudness(self)
        n_inputs, n_outputs = self.network.centres.shape[1], self.network.weights.shape[1]
        if n_inputs != self.frame.n_inputs or n_outputs < 2:
            raise ValueError(
                f"network has {n_inputs} inputs and {n_outputs} outputs; "
                f"the rule is {self.frame.n_inputs}, at least 2"
            )
        _checks.check_gap(self)

    @property
    def order(self) -> int:
        """Order p of the AR models."""
        return int(self.network.weights.shape[1]) - 1

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample: lattice, and network and LSF -> k over the buffer.

        The way from LSF to k counts 4 p^2.
        """
        n, p, d = len(self.network.centres), self.order, self.frame.n_inputs
        reading = n * (3 * d + 1) + 2 * (n + d + 1) * (p + 1) + 4 * p**2
        return LATTICE_OPERATIONS * p + reading / self.buffer

    def models(self, velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples]:
        """Return reflection coefficients (n, p) and levels (n,) at velocities (n, 2) and forces (n,).

        Frequencies out of order or too close are moved by `line_spectrum.spread`; no level
        exceeds the loudest segment's, see `Frame.cap`.
        """
        out = self.network.at(self.frame.inputs(velocity, force))
        k = line_spectrum.to_reflection(line_spectrum.spread(out[:, :-1], self.frame.gap))
        level = level_of(self.loudness, out[:, -1], k, self.frame.motion(velocity, force), self.growth)
        return k, np.minimum(level, self.frame.cap(velocity, force))

    def renderer(self, *, seed: int = 0) -> BufferedRenderer:
        """Return a renderer at rest."""
        return BufferedRenderer(self, buffer=self.buffer, glide=self.glide, seed=seed)

    def parameters(self) -> Mapping[str, Any]:
        """Return what is not an array, as JSON knows it."""
        return {
            "name": self.name,
            "fs": self.fs,
            "frame": self.frame.parameters(),
            "loudness": self.loudness,
            "growth": list(self.growth),
            "buffer": self.buffer,
            "glide": self.glide,
        }

    def arrays(self) -> Mapping[str, NDArray[np.float64]]:
        """Return centres, weights and polynomial of the network."""
        net = self.network
        return {"centres": net.centres, "weights": net.weights, "polynomial": net.polynomial}

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the texture of what `parameters` and `arrays` returned; ValueError if it is none."""
        names = (
            {"name", "fs", "frame", "loudness", "growth", "buffer", "glide"},
            {"centres", "weights", "polynomial"},
        )
        check_all_names(cls.family, parameters, arrays, names)
        network = RadialNetwork(**{key: numbers(arrays, key) for key in names[1]})
        rest = {key: parameters[key] for key in ("name", "fs", "loudness", "growth", "buffer", "glide")}
        return cls(frame=Frame.restore(parameters["frame"]), network=network, **rest)
