"""What the renderer plays: a model of one surface on a grid of speeds and forces, and what it costs."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples

Kind = Literal["silence", "AR", "lines", "AR + lines"]
PER_STAGE, PER_LINE, PER_SAMPLE = 6, 18, 70
"""Multiplications and additions per sample: a lattice stage, an oscillator, and what every sample costs."""
PER_STAGE_RENEWAL, PER_LINE_RENEWAL = 21, 12
"""Those of a stage's k and sqrt(1 - k^2) between four nodes, and of a line's amplitude and step."""
LEAST_POWER = 1e-300
"""A node without power counts as this, so that it has a logarithm."""
RENEWAL_HZ = 1000.0
"""How often the parameters between the nodes are renewed; the level is renewed at each sample."""


def renewal(fs: float) -> int:
    """Return the samples from one renewal of the parameters to the next."""
    return max(1, round(fs / RENEWAL_HZ))


@dataclass(frozen=True, eq=False)
class GridModel:
    """A vibration at the nodes of a grid of speeds and forces, and between them.

    Over the logarithms of speed and force, reflection coefficients and amplitudes go linearly, and so does
    the logarithm of the power: a power law of speed and force needs no node between the ends.

    It is an autoregressive process, lines, both, or nothing::

        x = level (sqrt(1 - sum a_i^2 / 2) noise through the lattice + sum_i a_i cos(phase_i))

    Parameters
    ----------
    speeds : array_like of shape (n_speeds,)
        Of the nodes, mm/s, above 0, rising; at least one. Beyond the outermost, that one holds.
    forces : array_like of shape (n_forces,)
        N, the same rule.
    rows : array_like of shape (n_speeds, n_forces, order + n_lines)
        Reflection coefficients, |k| < 1, and amplitudes of lines, at least 0, of a vibration of unit RMS.
    power : array_like of shape (n_speeds, n_forces)
        Mean square of the vibration.
    peak : float
        Largest magnitude that was recorded.
    frequency_hz, per_mm : array_like of shape (n_lines,), optional
        frequency = frequency_hz + per_mm * speed: what rings keeps its frequency, what repeats along the
        surface follows the speed. No lines by default.

    Raises
    ------
    ValueError
        If a shape does not fit or a value breaks its rule.
    """

    speeds: Samples
    forces: Samples
    rows: Samples
    power: Samples
    peak: float
    frequency_hz: Samples = field(default_factory=lambda: np.zeros(0))
    per_mm: Samples = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        size, columns = (np.size(self.speeds), np.size(self.forces)), np.shape(self.rows)[-1:]
        n_lines = np.size(self.frequency_hz)
        shapes = {
            "speeds": size[:1],
            "forces": size[1:],
            "rows": (*size, *columns),
            "power": size,
            "frequency_hz": (n_lines,),
            "per_mm": (n_lines,),
        }
        for name, shape in shapes.items():
            array = np.array(getattr(self, name), dtype=np.float64, order="C")
            if array.shape != shape or not np.isfinite(array).all() or not min(size):
                raise ValueError(f"{name} has shape {array.shape}; the rule is {shape}, finite")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        self._check_values()

    def _check_values(self) -> None:
        for name in ("speeds", "forces"):
            axis = getattr(self, name)
            if axis[0] <= 0 or np.any(np.diff(axis) <= 0):
                raise ValueError(f"{name} are {axis}; the rule is above 0 and rising")
        lowest = min(self.power.min(), self.peak, self.frequency_hz.min(initial=0.0))
        if lowest < 0 or not np.isfinite(self.peak):
            raise ValueError(f"power, peak or a frequency is {lowest}; the rule is finite and at least 0")
        if self.order < 0:
            raise ValueError(f"rows have {self.rows.shape[-1]} columns; the rule is {self.n_lines} at least")
        k, a = self.rows[..., : self.order], self.rows[..., self.order :]
        if np.abs(k).max(initial=0.0) >= 1:
            raise ValueError(f"a reflection coefficient is {np.abs(k).max()}; the rule is below 1 in size")
        if (
            a.min(initial=0.0) < 0
            or a.max(initial=0.0) > 2
            or (a**2).sum(axis=-1).max(initial=0.0) > 2 * (1 + 1e-9)
        ):
            raise ValueError("amplitudes of lines; the rule is at least 0, their squares 2 at most in sum")

    @classmethod
    def silence(cls) -> "GridModel":
        """Return the model of a surface that the device cannot make felt."""
        return cls(np.ones(1), np.ones(1), np.zeros((1, 1, 0)), np.zeros((1, 1)), 0.0)

    @property
    def kind(self) -> Kind:
        """What it is made of."""
        if not self.rows.shape[-1]:
            return "silence"
        return "lines" if not self.order else "AR + lines" if self.n_lines else "AR"

    @property
    def n_lines(self) -> int:
        """Lines."""
        return int(self.frequency_hz.size)

    @property
    def order(self) -> int:
        """Stages of the lattice."""
        return int(self.rows.shape[-1]) - self.n_lines

    @property
    def n_nodes(self) -> tuple[int, int]:
        """Speeds and forces."""
        return self.speeds.size, self.forces.size

    @property
    def n_bytes(self) -> int:
        """Of its arrays."""
        names = ("speeds", "forces", "rows", "power", "frequency_hz", "per_mm")
        return sum(getattr(self, name).nbytes for name in names)

    def operations(self, fs: float) -> float:
        """Return multiplications and additions per sample of one contact, renewals spread over the samples.

        6 p for a lattice of order p and 21 p a renewal; 18 n for n lines and 12 n a renewal; 70 for speed,
        force, level and noise of any that sounds. A logarithm, exponential, root or cosine counts 10.
        """
        return operations(self.order, self.n_lines, fs)


def operations(order: int, n_lines: int, fs: float) -> float:
    """Return what `GridModel.operations` does for an order and a number of lines."""
    if order + n_lines == 0:
        return 0.0
    stage, line = (
        each + renewed / renewal(fs)
        for each, renewed in ((PER_STAGE, PER_STAGE_RENEWAL), (PER_LINE, PER_LINE_RENEWAL))
    )
    return PER_SAMPLE + order * stage + n_lines * line


def weights(speeds: ArrayLike, forces: ArrayLike, speed: ArrayLike, force: ArrayLike) -> Samples:
    """Return the shares of the nodes at points (n,): bilinear in the logarithms, held at the outermost nodes.

    Returns
    -------
    ndarray of shape (n, n_speeds * n_forces)
        Rows sum to 1; the nodes of one speed stand together.
    """
    shares = [_hats(axis, at) for axis, at in ((speeds, speed), (forces, force))]
    return np.asarray(np.einsum("ni,nj->nij", *shares).reshape(len(shares[0]), -1))


def _hats(axis: ArrayLike, at: ArrayLike) -> Samples:
    nodes, x = np.log(np.asarray(axis, dtype=np.float64)), np.log(np.atleast_1d(np.asarray(at, np.float64)))
    return np.column_stack([np.interp(x, nodes, one) for one in np.eye(nodes.size)])


def mixed_power(shares: Samples, power: ArrayLike) -> Samples:
    """Return the powers at points, shares (n, n_nodes) of those of the nodes (n_nodes, ...): ln P mixes."""
    ln_power = np.log(np.maximum(np.asarray(power, dtype=np.float64), LEAST_POWER))
    return np.asarray(np.exp(np.tensordot(shares, ln_power, axes=1)))


def total_bytes(models: Sequence[GridModel]) -> int:
    """Return the bytes of several models."""
    return sum(model.n_bytes for model in models)
