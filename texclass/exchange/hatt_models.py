"""A texture of AR models as a HaTT texture: models at a grid of speeds and forces, at the toolkit's rate."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from texclass.recording import ACCELERATION_UNITS, Samples
from texclass.textures import Texture
from texclass.textures.hatt import HattTexture
from texclass.vibration import Autoregression, line_spectrum
from texclass.vibration.autoregressive import from_autocorrelation
from texclass.vibration.reflection import log_cosines

FS = 1000.0
"""What the toolkit renders at, Hz."""
ORDER = 20
"""Of the AR models in the published textures, about."""
N_STEPS = 6
"""Speeds and forces at which a texture without nodes of its own is read."""
_BINS = 1 << 14


def to_hatt(
    texture: Texture,
    *,
    unit: str = "m/s^2",
    speeds: Sequence[float] | None = None,
    forces: Sequence[float] | None = None,
    fs: float = FS,
    order: int = ORDER,
) -> HattTexture:
    """Return a texture as HaTT files hold it.

    A model of a higher order or rate is fitted anew to its own spectrum below fs / 2: what it says above is
    left out. Of an anisotropic texture, strokes along +x are taken. A texture that does not know force gets
    its models at 1 N: softer is fainter, harder is the same.

    Parameters
    ----------
    texture : Texture
        With AR models: hatt (kept but for the unit), abdulali2016 or its Delaunay variant, oeztuerk2018-lpc.
    unit : str
        Of its vibration: m/s^2, g or mg.
    speeds, forces : sequence of float, optional
        Of the models, mm/s and N, above 0; by default evenly over the texture's range (the speeds of an LPC
        texture as they are).
    fs : float
        Hz, at most the texture's.
    order : int
        Largest order of the models.

    Raises
    ------
    ValueError
        If the texture has no AR models, its rate is below `fs`, its unit has no known size, or a speed or a
        force is not above 0.
    """
    if unit not in ACCELERATION_UNITS:
        raise ValueError(f"unit is {unit!r}; the rule for HaTT is one of {list(ACCELERATION_UNITS)}")
    factor = ACCELERATION_UNITS[unit]
    if isinstance(texture, HattTexture):
        return replace(texture, variance=texture.variance * factor**2)
    own_speeds, own_forces, models = _read(texture)
    grid = [np.array(each, dtype=np.float64) for each in (speeds or own_speeds, forces or own_forces)]
    if not all(np.all(np.isfinite(axis) & (axis > 0)) for axis in grid):
        raise ValueError(f"speeds are {grid[0].tolist()}, forces {grid[1].tolist()}; the rule is above 0")
    if not 0 < fs <= texture.fs:
        raise ValueError(f"fs is {fs:g}; the rule is at most that of the texture, {texture.fs:g} Hz")
    speed, force = (axis.ravel() for axis in np.meshgrid(*grid, indexing="ij"))
    model = models(speed, force)
    if fs != texture.fs or model.order > order:
        # the autocorrelation of the spectrum below fs / 2: r_i = (1 / N) sum_n S(w_n) (fs / fs_0) e^{j i w_n}
        share = fs / texture.fs
        with np.errstate(under="ignore"):
            power = 10 ** (model.log_spectrum_db(np.linspace(0, np.pi, _BINS + 1) * share) / 10) * share
        model = from_autocorrelation(np.fft.irfft(power, axis=-1)[..., : order + 1])
    lsf = line_spectrum.from_reflection(model.reflection)
    variance = (model.gain * factor) ** 2
    return HattTexture.from_models(speed, force, line_spectrum.spread(lsf), variance, fs, name=texture.name)


def _read(texture: Any) -> tuple[Sequence[float], Sequence[float], Callable[..., Autoregression]]:
    """Return speeds (mm/s) and forces (N) to read a texture at, and what reads its models at (n,) of each."""
    if texture.family == "oeztuerk2018-lpc":
        return texture.speeds.tolist(), [1.0], lambda speed, _: texture.at(speed)
    if texture.family not in ("abdulali2016", "abdulali2016-delaunay"):
        raise ValueError(
            f"family is {texture.family!r}; the rule is one of AR models: hatt, abdulali2016, "
            "abdulali2016-delaunay, oeztuerk2018-lpc"
        )

    def models(speed: Samples, force: Samples) -> Autoregression:
        k, level = texture.models(np.column_stack([speed, np.zeros_like(speed)]), force)
        return Autoregression(k, level * np.exp(log_cosines(k).sum(axis=-1)))

    steps = np.arange(1, N_STEPS + 1) / N_STEPS
    return (texture.frame.fastest * steps).tolist(), (texture.frame.hardest * steps).tolist(), models
