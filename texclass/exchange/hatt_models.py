"""A texture of AR models as a HaTT texture: models at a grid of speeds and forces, at the toolkit's rate."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from texclass.recording import ACCELERATION_UNITS, Samples
from texclass.textures import Texture
from texclass.textures.hatt import HattTexture
from texclass.vibration import Autoregression, line_spectrum
from texclass.vibration.autoregressive import from_autocorrelation

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
    reach = _reach(texture)
    grid = [np.array(speeds or reach[0], dtype=np.float64), np.array(forces or reach[1], dtype=np.float64)]
    if not all(np.all(np.isfinite(axis) & (axis > 0)) for axis in grid):
        raise ValueError(f"speeds are {grid[0].tolist()}, forces {grid[1].tolist()}; the rule is above 0")
    if not 0 < fs <= texture.fs:
        raise ValueError(f"fs is {fs:g}; the rule is at most that of the texture, {texture.fs:g} Hz")
    speed, force = (axis.ravel() for axis in np.meshgrid(*grid, indexing="ij"))
    model = _at_rate(_models(texture, speed, force), texture.fs, fs, order)
    lsf = line_spectrum.from_reflection(model.reflection)
    variance = (model.gain * factor) ** 2
    return HattTexture.from_models(speed, force, line_spectrum.spread(lsf), variance, fs, name=texture.name)


def _reach(texture: Any) -> tuple[list[float], list[float]]:
    """Return the speeds (mm/s) and forces (N) at which models of a texture are taken."""
    if texture.family in ("abdulali2016", "abdulali2016-delaunay"):
        frame, steps = texture.frame, np.arange(1, N_STEPS + 1) / N_STEPS
        return (frame.fastest * steps).tolist(), (frame.hardest * steps).tolist()
    if texture.family == "oeztuerk2018-lpc":
        return texture.speeds.tolist(), [1.0]
    raise ValueError(
        f"family is {texture.family!r}; the rule is one of AR models: hatt, abdulali2016, "
        "abdulali2016-delaunay, oeztuerk2018-lpc"
    )


def _models(texture: Any, speed: Samples, force: Samples) -> Autoregression:
    """Return the AR models at speeds (n,) and forces (n,), of leading shape (n,)."""
    if texture.family == "oeztuerk2018-lpc":
        found = [texture.at(v) for v in speed.tolist()]
        return Autoregression(np.stack([m.reflection for m in found]), np.stack([m.gain for m in found]))
    k, level = texture.models(np.column_stack([speed, np.zeros_like(speed)]), force)
    log_cosines = (np.log1p(k) + np.log1p(-k)).sum(axis=1) / 2
    return Autoregression(k, level * np.exp(log_cosines))


def _at_rate(model: Autoregression, fs: float, to_fs: float, order: int) -> Autoregression:
    """Return models at another rate: those with the autocorrelation of the spectrum below to_fs / 2.

    r_i = (1 / N) sum_n S(w_n) (to_fs / fs) e^{j i w_n}, w_n over the circle of the new rate.
    """
    if fs == to_fs and model.order <= order:
        return model
    omega = np.linspace(0, np.pi, _BINS + 1) * (to_fs / fs)
    with np.errstate(under="ignore"):
        power = 10 ** (model.log_spectrum_db(omega) / 10) * (to_fs / fs)
    r = np.fft.irfft(power, axis=-1)[..., : order + 1]
    return from_autocorrelation(r)
