"""Models of simulated surfaces, and a catalogue of everyday surfaces.

The surfaces of the catalogue are drawn at random from categories that overlap in each property.
"""

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples


@dataclass(frozen=True)
class Grating:
    """Periodic structure of a surface, such as ridges, threads or the bars of a mesh.

    Attributes
    ----------
    wavelength_mm
        Spatial period in mm.
    depth_um
        Peak-to-valley depth in um.
    sharpness
        Shape of the ridges, from 0 to 1. With 0, the profile is a sine. Larger values narrow the crests,
        which adds harmonics.
    jitter
        Standard deviation of the phase from exact periodicity, in rad per square root of a period.

    Examples
    --------
    >>> grating = Grating(wavelength_mm=1.0, depth_um=20.0)
    >>> grating.sharpness
    0.0
    """

    wavelength_mm: float
    depth_um: float
    sharpness: float = 0.0
    jitter: float = 0.0


@dataclass(frozen=True)
class Bumps:
    """Sparse bumps of a surface, such as grains, rims of pits or knots.

    Attributes
    ----------
    density_per_mm
        Mean number of bumps along a line, per mm.
    height_um
        Mean height in um; the heights have a gamma distribution of shape 3.
    width_mm
        Full width at half height in mm.

    Examples
    --------
    >>> Bumps(density_per_mm=0.1, height_um=8.0, width_mm=0.7)
    Bumps(density_per_mm=0.1, height_um=8.0, width_mm=0.7)
    """

    density_per_mm: float
    height_um: float
    width_mm: float


@dataclass(frozen=True)
class Surface:
    """Simulated surface: height statistics, contact, friction and the lowest mode of the object.

    The power spectrum of the heights along a line falls with f^-slope at wavelengths below the corner, and
    with f^-(1 + 2 hurst) between the corner and 20 mm (self-affine waviness). See `synthesize_profile`. The
    tip of the tool attenuates small structures; gratings and bumps are added. The contact force is
    F = K d^1.5 (1 + D d') at the indentation d: Hertz's law with the dissipation of Hunt and Crossley.

    Attributes
    ----------
    name, category
        Name of the surface, and its category in the catalogue.
    rms_um
        RMS of the random heights in um, without waviness and before the attenuation by the tip.
    slope
        Negative exponent of the spatial frequency in the power spectrum at wavelengths below the corner.
    corner_mm
        Wavelength in mm at which the slope changes.
    gratings, bumps
        Periodic structures, and sparse bumps or None.
    stiffness_n_m
        Tangent stiffness of the contact in N/m at a normal force of 1 N.
    dissipation_s_m
        Dissipation coefficient D of Hunt and Crossley in s/m.
    static_friction, kinetic_friction
        Friction coefficients.
    stribeck_mm_s
        Speed in mm/s over which static friction changes to kinetic friction.
    hurst
        Hurst exponent of the waviness.
    body_hz, body_damping, body_mass_kg
        Lowest mode of the explored object at the contact: natural frequency in Hz, damping ratio and
        effective mass in kg. The mode does not depend on the speed.

    Examples
    --------
    >>> (surface,) = surface_catalogue(1, seed=0)
    >>> surface.name, surface.category, bool(1e6 * surface.indentation_m(1.0) < 100)
    ('stone-01', 'stone', True)
    """

    name: str
    category: str
    rms_um: float
    slope: float
    corner_mm: float
    gratings: tuple[Grating, ...]
    bumps: Bumps | None
    stiffness_n_m: float
    dissipation_s_m: float
    static_friction: float
    kinetic_friction: float
    stribeck_mm_s: float = 6.0
    hurst: float = 0.85
    body_hz: float = 400.0
    body_damping: float = 0.1
    body_mass_kg: float = 0.3

    @property
    def hertz_n_m15(self) -> float:
        """Hertz's constant K in N / m^1.5, from dF/dd = 1.5 K^(2/3) F^(1/3) at F = 1 N."""
        return float((self.stiffness_n_m / 1.5) ** 1.5)

    def indentation_m(self, force_n: ArrayLike) -> Samples:
        """Return the indentation in m of a resting tip under the normal force `force_n`."""
        return np.asarray((np.asarray(force_n) / self.hertz_n_m15) ** (2.0 / 3.0))


# Median and standard deviation of the logarithm of each property for every category, and probabilities of
# gratings and bumps. The heights are those of the centre of a spherical tip, not of a profilometer: the tip
# moves over the crests, and the cusps between two crests lead to a spectrum that falls with the fourth power.
# The contact stiffness covers 4 kN/m (foam) to 200 kN/m, which is limited by the compliance of the tip.
_PROPERTIES = (
    "rms_um", "slope", "corner_mm", "stiffness_n_m", "dissipation_s_m", "kinetic_friction",
    "body_hz", "body_damping", "body_mass_kg",
    "grating_chance", "grating_mm", "depth_um", "bumps_chance", "bumps_um",
)  # fmt: skip
_FAMILIES: dict[str, tuple[Any, ...]] = {
    "stone": ((2, 0.6), (4.0, 0.14), (1.6, 0.6), (100e3, 0.35), (7, 0.4), (0.36, 0.40),
              (420, 0.4), (0.05, 0.5), (0.30, 0.4),
              0.15, (4.0, 0.4), (8.2, 0.5), 0.45, (8.2, 0.6)),
    "metal": ((0.64, 0.7), (3.9, 0.14), (0.9, 0.6), (120e3, 0.35), (6, 0.4), (0.26, 0.40),
              (620, 0.5), (0.03, 0.6), (0.15, 0.5),
              0.40, (1.8, 0.5), (4.9, 0.6), 0.25, (3.6, 0.7)),
    "wood": ((1.7, 0.6), (3.9, 0.14), (1.3, 0.6), (75e3, 0.35), (9, 0.4), (0.34, 0.40),
             (320, 0.45), (0.07, 0.4), (0.12, 0.4),
             0.30, (2.2, 0.5), (6.1, 0.6), 0.25, (6, 0.6)),
    "foam": ((5.5, 0.5), (3.7, 0.14), (2.0, 0.6), (8e3, 0.4), (14, 0.4), (0.58, 0.40),
             (90, 0.4), (0.40, 0.3), (0.04, 0.4),
             0.10, (3.0, 0.4), (16, 0.5), 0.30, (18, 0.5)),
    "mesh": ((1, 0.6), (3.9, 0.14), (1.1, 0.6), (70e3, 0.5), (8, 0.4), (0.32, 0.40),
             (380, 0.5), (0.05, 0.6), (0.08, 0.5),
             1.00, (2.2, 0.45), (9, 0.5), 0.15, (6, 0.6)),
    "textile": ((4.5, 0.5), (3.8, 0.14), (1.1, 0.6), (14e3, 0.4), (13, 0.4), (0.44, 0.40),
                (150, 0.4), (0.35, 0.3), (0.06, 0.4),
                0.65, (1.1, 0.45), (10, 0.5), 0.20, (15, 0.6)),
    "paper": ((1.1, 0.6), (3.8, 0.14), (0.8, 0.6), (45e3, 0.4), (10, 0.4), (0.32, 0.40),
              (240, 0.45), (0.18, 0.4), (0.08, 0.4),
              0.15, (1.6, 0.5), (4.9, 0.6), 0.15, (4.2, 0.6)),
    "rubber": ((3.1, 0.6), (3.9, 0.14), (1.4, 0.6), (22e3, 0.45), (15, 0.4), (0.62, 0.40),
               (170, 0.4), (0.30, 0.3), (0.08, 0.4),
               0.40, (3.0, 0.5), (14, 0.6), 0.25, (12, 0.6)),
    "plastic": ((0.91, 0.7), (3.9, 0.14), (1.0, 0.6), (65e3, 0.4), (9, 0.4), (0.32, 0.40),
                (380, 0.5), (0.08, 0.5), (0.10, 0.5),
                0.35, (2.4, 0.5), (6.6, 0.7), 0.20, (4.8, 0.7)),
    "tile": ((0.49, 0.7), (4.0, 0.14), (1.6, 0.6), (120e3, 0.35), (6, 0.4), (0.28, 0.40),
             (560, 0.45), (0.04, 0.5), (0.22, 0.4),
             0.15, (5.0, 0.4), (6.6, 0.6), 0.25, (4.8, 0.7)),
    "sandpaper": ((2.9, 0.5), (3.4, 0.14), (0.5, 0.6), (60e3, 0.4), (9, 0.4), (0.52, 0.40),
                  (260, 0.4), (0.15, 0.4), (0.10, 0.4),
                  0.00, (1.0, 0.1), (4.1, 0.1), 0.30, (9, 0.5)),
    "cork": ((4.1, 0.4), (3.8, 0.14), (1.6, 0.6), (22e3, 0.4), (14, 0.4), (0.46, 0.40),
             (190, 0.4), (0.25, 0.3), (0.09, 0.4),
             0.05, (3.0, 0.4), (10, 0.5), 0.50, (14, 0.5)),
}  # fmt: skip
_HURST = (0.7, 1.0)
"""Range of the Hurst exponents; fractal dimension 2.15 +- 0.15 (Persson, 2014, Tribology Letters 54, 99)."""
_ORDER = ("stone", "metal", "wood", "foam", "mesh", "textile", "paper", "rubber", "plastic", "tile", "stone",
          "mesh", "metal", "sandpaper", "wood", "textile", "cork", "foam", "plastic", "rubber")  # fmt: skip


@functools.lru_cache(maxsize=8)
def surface_catalogue(n: int, seed: int) -> tuple[Surface, ...]:
    """Return n surfaces. Surface i depends only on the seed and on i.

    The categories alternate. Within a category every property has a log-normal distribution that overlaps
    with the distributions of other categories, so that only the combination of several properties identifies
    a surface.

    Parameters
    ----------
    n : int
        Number of surfaces.
    seed : int
        Seed of the catalogue.

    Returns
    -------
    tuple of Surface
        Surfaces with unique names.

    Examples
    --------
    >>> [surface.name for surface in surface_catalogue(4, seed=0)]
    ['stone-01', 'metal-02', 'wood-03', 'foam-04']
    """
    surfaces = []
    for index in range(n):
        rng = np.random.default_rng(np.random.SeedSequence((seed, 0, index)))
        category = _ORDER[index % len(_ORDER)]
        family = dict(zip(_PROPERTIES, _FAMILIES[category], strict=True))
        properties = {"kinetic_friction": _draw(rng, family["kinetic_friction"])}
        properties |= {name: _draw(rng, family[name]) for name in ("rms_um", "slope", "corner_mm")}
        gratings, bumps = _structures(family, rng)
        properties |= {name: _draw(rng, family[name]) for name in ("stiffness_n_m", "dissipation_s_m")}
        properties["static_friction"] = properties["kinetic_friction"] * rng.uniform(1.1, 1.5)
        properties["stribeck_mm_s"] = rng.uniform(3.0, 10.0)
        properties |= {name: _draw(rng, family[name]) for name in ("body_hz", "body_damping", "body_mass_kg")}
        properties["hurst"] = rng.uniform(*_HURST)
        name = f"{category}-{index + 1:02d}"
        surfaces.append(Surface(name=name, category=category, gratings=gratings, bumps=bumps, **properties))
    return tuple(surfaces)


def _structures(family: dict[str, Any], rng: np.random.Generator) -> tuple[tuple[Grating, ...], Bumps | None]:
    """Draw the structures that are added to the random heights: gratings, bumps, both or neither."""
    gratings: tuple[Grating, ...] = ()
    if rng.random() < family["grating_chance"]:
        first = Grating(
            wavelength_mm=_draw(rng, family["grating_mm"]),
            depth_um=_draw(rng, family["depth_um"]),
            sharpness=rng.uniform(0.0, 0.8),
            jitter=rng.uniform(0.05, 0.6),
        )
        gratings = (first,)
        if rng.random() >= 0.7:  # a weave or an embossing has a second, coarser period
            wavelength_mm = first.wavelength_mm * rng.uniform(1.7, 3.5)
            gratings += (Grating(wavelength_mm, first.depth_um, rng.uniform(0.0, 0.5), first.jitter),)
    if rng.random() >= family["bumps_chance"]:
        return gratings, None
    density_per_mm, height_um = _draw(rng, (0.08, 0.7)), _draw(rng, family["bumps_um"])
    return gratings, Bumps(density_per_mm, height_um, _draw(rng, (0.7, 0.35)))


def _draw(rng: np.random.Generator, median_and_spread: tuple[float, float]) -> float:
    """Draw a log-normal value within two standard deviations."""
    median, spread = median_and_spread
    return float(median * np.exp(spread * np.clip(rng.standard_normal(), -2.0, 2.0)))
