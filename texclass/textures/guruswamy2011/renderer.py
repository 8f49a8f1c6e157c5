"""A surface of `guruswamy2011` being felt: the sum of the filters that ring."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.textures.guruswamy2011 import _kernels

if TYPE_CHECKING:
    from texclass.textures.guruswamy2011.texture import SpatialTexture

N_RINGING = 512
"""Modes that can ring at once; the weakest give way."""
SILENT = 1e-3
"""Part of the recorded peak below which a mode has decayed."""
LARGEST_OUTPUT = 8.0
"""The output stays within that many times the recorded peak."""
PLAY_MM = 0.1
"""A tip that turns round feels nothing for that long: it may rest on a feature and tremble."""

_NO_PATH = np.empty((0, 2))


class SpatialRenderer:
    """Renders a `SpatialTexture` for any path, sample by sample, without allocating but for the result.

    A sample costs one step for each mode that rings, however many features the surface has (a binary search
    among them when one is passed). At most `N_RINGING` modes ring and at most four features are struck within
    a sample, those nearest to the tip: that bounds the cost of a sample at any speed. A feature passed
    between two samples begins at the later one, as printed. No feature is struck without contact.

    Parameters
    ----------
    texture : SpatialTexture

    Attributes
    ----------
    fs : float
        Hz.
    """

    def __init__(self, texture: "SpatialTexture") -> None:
        self.fs = texture.fs
        scaling = texture.scaling
        law = scaling.law
        self._law = np.array(
            [law.k_v, law.k_c, law.a_0, scaling.speed, scaling.force, scaling.compensated, scaling.limit],
            float,
        )
        quiet, loud = SILENT * texture.peak, LARGEST_OUTPUT * texture.peak
        course, line = texture.course == "travelled", (*texture.direction, texture.origin_mm)
        self._setting = np.array([texture.fs, texture.length_mm, *line, course, PLAY_MM, quiet, loud], float)
        self._position = np.array(texture.position_mm)
        owners = np.arange(texture.n_features + 1)
        self._first = np.searchsorted(texture.feature, owners).astype(np.int64)
        self._modes = _table(
            texture.frequency_hz, texture.decay_per_s, texture.amplitude, texture.phase, fs=texture.fs
        )
        self._pool = np.zeros((N_RINGING, 4))
        self._counts = np.zeros(3, np.int64)
        self._where = np.zeros(4)
        self.reset()

    @property
    def n_ringing(self) -> int:
        """How many modes ring now."""
        return int(self._counts[_kernels.RINGING])

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples of a path, see `texclass.textures.Renderer`.

        Raises
        ------
        ValueError
            If the shapes do not fit, or a value is NaN, infinite or beyond 1e9; the state is then unchanged.
        """
        v, f = _block(velocity), _block(force)
        path = _NO_PATH if position is None else _block(position)
        n = f.size
        if f.ndim != 1 or v.shape != (n, 2) or (position is not None and path.shape != (n, 2)):
            raise ValueError(
                f"velocity {v.shape}, force {f.shape}, position {path.shape}; "
                "the rule is (n, 2), (n,), (n, 2)"
            )
        out = np.empty(n)
        if not _kernels.render(
            v, f, path, out, self._setting, self._law,
            self._position, self._first, self._modes, self._pool, self._counts, self._where,
        ):  # fmt: skip
            raise ValueError(
                f"a velocity, force or position is NaN or beyond {_kernels.LARGEST:g}; the rule is less"
            )
        return out

    def reset(self) -> None:
        """Return to rest: nothing rings, the next sample is the first."""
        self._counts[:] = 0
        self._where[:] = 0.0


def _block(values: ArrayLike) -> Samples:
    array = np.ascontiguousarray(values, dtype=np.float64)
    return array if array.flags.writeable else array.copy()  # one compiled version serves all


def _table(f: Samples, B: Samples, A: Samples, phi: Samples, *, fs: float) -> Samples:
    """Return a row per mode: its start (re, im) and its factor per sample (re, im)."""
    start = A * np.exp(1j * phi)
    p = np.exp((-B + 2j * np.pi * f) / fs)
    return np.column_stack([start.real, start.imag, p.real, p.imag])
