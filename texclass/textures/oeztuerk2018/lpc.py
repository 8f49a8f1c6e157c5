"""The first method: LPC models of recordings at a few speeds, and a model for every speed between them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.recording import Samples
from texclass.signals import positive
from texclass.textures.oeztuerk2018 import _kernels as kernels
from texclass.textures.oeztuerk2018.speeds import (
    GLIDE_S,
    PEAK_FACTOR,
    STILL,
    checked_signals,
    place_of,
    rising_speeds,
)
from texclass.textures.path import checked_path
from texclass.textures.stored import check_all_names, number, numbers, text
from texclass.vibration import Autoregression, ModelBlend, fit, synthesize
from texclass.vibration.interpolation import Loudness

ORDER = 400
"""`oeztuerk2018`, figure 3.2: beyond it additional coefficients have minimal benefit."""
N_SUB = 16
"""Models laid out between two recorded speeds; between these k moves linearly."""
UPDATE_HZ = 1000.0
"""How often the renderer renews k."""


@dataclass(frozen=True, eq=False)
class LpcTexture:
    """LPC models of one surface at rising speeds; between them line spectra and log gain go linearly.

    Parameters
    ----------
    speeds : array_like of shape (n_speeds,)
        Recorded speeds, mm/s, two or more.
    models : Autoregression
        Of leading shape (n_speeds,) and one order, in the unit of the recordings.
    peak : float
        Largest magnitude of the recordings.
    fs : float
        Sampling rate, Hz.
    name : str, optional
        Of the surface.
    loudness : {"gain", "level"}
        What is mixed beside the line spectra, see `ModelBlend`.

    Notes
    -----
    Slower than the slowest and faster than the fastest recording, that one holds (nothing is extrapolated);
    below `STILL` of the slowest speed the vibration fades to silence at rest. Both are our readings.

    References
    ----------
    `oeztuerk2018`, section 3.1.
    """

    family: ClassVar[str] = "oeztuerk2018-lpc"
    speeds: Samples
    models: Autoregression
    peak: float
    fs: float
    name: str = ""
    loudness: Loudness = "gain"
    _blend: ModelBlend = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "speeds", rising_speeds(self.speeds))
        positive(self.fs, "fs")
        positive(self.peak, "peak")
        k = self.models.reflection
        if k.ndim != 2 or k.shape[0] != self.speeds.size or k.shape[1] < 1:
            raise ValueError(
                f"models have reflection {k.shape}; the rule is ({self.speeds.size}, order), one a speed"
            )
        with np.errstate(over="ignore"):
            if not np.all(np.isfinite(self.models.level)):
                raise ValueError(f"levels are {self.models.level}; the rule is finite ones")
        object.__setattr__(self, "_blend", ModelBlend(self.models, loudness=self.loudness))

    @property
    def order(self) -> int:
        """The order of the models."""
        return self.models.order

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample: 6 a stage, and 6 a stage each time k is renewed."""
        return 6.0 * self.order + 6.0 * self.order / self.update_samples

    @property
    def update_samples(self) -> int:
        """Samples between two renewals of k."""
        return max(1, round(self.fs / UPDATE_HZ))

    def at(self, speed: float) -> Autoregression:
        """Return the model at a speed (mm/s)."""
        return self._at_places(np.array(place_of(speed, self.speeds)))

    def signal(self, speed: float, n_samples: int, *, seed: int = 0) -> Samples:
        """Return the vibration at a constant speed (mm/s), shape (n_samples,)."""
        return synthesize(self.at(speed), n_samples, np.random.default_rng(seed))

    @cached_property
    def grid(self) -> tuple[Samples, Samples]:
        """Reflection coefficients (n_rows, p) and levels (n_rows,) at `N_SUB` places an interval."""
        n_rows = (self.speeds.size - 1) * N_SUB + 1
        models = self._at_places(np.arange(n_rows) / N_SUB)
        return np.ascontiguousarray(models.reflection), np.ascontiguousarray(models.level)

    def renderer(self, *, seed: int = 0) -> "LpcRenderer":
        """Return a renderer at rest."""
        return LpcRenderer(self, seed)

    def parameters(self) -> Mapping[str, Any]:
        """Return what is not an array."""
        return {"name": self.name, "fs": self.fs, "peak": self.peak, "loudness": self.loudness}

    def arrays(self) -> Mapping[str, NDArray[np.float64]]:
        """Return speeds (mm/s), reflection coefficients and gains."""
        return {"speeds": self.speeds, "reflection": self.models.reflection, "gain": self.models.gain}

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the texture that was written down; a ValueError says what is wrong with it."""
        names = {"name", "fs", "peak", "loudness"}, {"speeds", "reflection", "gain"}
        check_all_names(cls.family, parameters, arrays, names)
        models = Autoregression(numbers(arrays, "reflection", 2), numbers(arrays, "gain", 1))
        p = parameters
        loudness: Any = text(p, "loudness")
        return cls(
            numbers(arrays, "speeds", 1),
            models,
            number(p, "peak"),
            number(p, "fs"),
            text(p, "name"),
            loudness,
        )

    def _at_places(self, place: Samples) -> Autoregression:
        """Return the models at places (...) among the speeds: weights 1 - w and w of two neighbours."""
        lower = np.minimum(place.astype(int), self.speeds.size - 2)
        w = (place - lower)[..., np.newaxis]
        one = np.eye(self.speeds.size)
        return self._blend.at((1 - w) * one[lower] + w * one[lower + 1])


def fit_lpc(
    signals: Sequence[ArrayLike],
    speeds: ArrayLike,
    fs: float,
    *,
    order: int = ORDER,
    name: str = "",
    loudness: Loudness = "gain",
) -> LpcTexture:
    """Fit the texture to recordings of one surface at two or more speeds, by Burg's method.

    Parameters
    ----------
    signals : sequence of array_like, each of shape (n_samples,)
        One recording a speed, any one unit; lengths may differ. Means are removed.
    speeds : array_like of shape (n_speeds,)
        mm/s, rising.
    fs : float
        Sampling rate, Hz.
    order : int
        Of the models.
    name, loudness
        As for `LpcTexture`.

    Raises
    ------
    ValueError
        As `checked_signals` and `fit`.

    References
    ----------
    `oeztuerk2018`, section 3.1; the thesis solves the Wiener-Hopf equations by Levinson's recursion, Burg's
    method smears the ends of short recordings less.
    """
    found, v = checked_signals(signals, speeds)
    models = [fit(x, order) for x in found]
    stack = Autoregression(np.stack([m.reflection for m in models]), np.stack([m.gain for m in models]))
    return LpcTexture(v, stack, max(float(np.abs(x).max()) for x in found), fs, name, loudness)


class LpcRenderer:
    """Plays an `LpcTexture` along a path; see `Renderer`."""

    def __init__(self, texture: LpcTexture, seed: int) -> None:
        self.fs, self._seed = texture.fs, seed
        self._rows, self._levels = texture.grid
        self._speeds = texture.speeds
        self._still = STILL * float(texture.speeds[0])
        self._glide = -float(np.expm1(-1 / (GLIDE_S * texture.fs)))
        self._hop = float(texture.update_samples)
        self._limit = PEAK_FACTOR * texture.peak
        self._k, self._c = np.empty((2, texture.order))
        self._b = np.empty(texture.order + 1)
        self._state = np.empty(kernels.N_STATES)
        self.reset()

    def reset(self) -> None:
        """Return to rest, with the random numbers of the first sample."""
        self._rng = np.random.default_rng(self._seed)
        self._b[-1] = 0.0
        self._b[:-1] = self._rng.standard_normal(self._b.size - 1)
        self._state[:] = kernels.UNKNOWN, 0.0, 0.0

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples; the position is not used."""
        v, f = checked_path(velocity, force)
        out = np.empty(f.size)
        kernels.render_lattice(
            v, f, self._rng.standard_normal(f.size), self._speeds, self._rows, self._levels, N_SUB,
            self._still, self._glide, self._hop, self._limit, self._state, self._k, self._c, self._b, out,
        )  # fmt: skip
        return out
