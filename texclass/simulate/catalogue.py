"""A catalogue of everyday surfaces, drawn from families whose single properties overlap."""

from dataclasses import dataclass

import numpy as np

from texclass.simulate.surfaces import Bumps, Grating, Surface

Range = tuple[float, float]
"""Median and deviation of the logarithm."""


@dataclass(frozen=True)
class _Family:
    """Distributions of one category: medians and log-deviations, and how often it has a structure."""

    rms_um: Range
    slope: Range
    corner_mm: Range
    stiffness_n_m: Range
    dissipation_s_m: Range
    kinetic_friction: Range
    body_hz: Range
    body_damping: Range
    body_mass_kg: Range
    grating_chance: float
    grating_mm: Range
    depth_um: Range
    bumps_chance: float
    bumps_um: Range


# Heights as a ball-ended tip feels them, not as a profilometer would: it rides on the crests, and the cusps
# between two crests give a spectrum that falls as the fourth power. The contact spans 4 kN/m (foam) to
# 200 kN/m, where the compliance of the tip itself ends the scale.
_FAMILIES = {
    "stone": _Family((2, 0.6), (4.0, 0.14), (1.6, 0.6), (100e3, 0.35), (7, 0.4), (0.36, 0.40),
                     (420, 0.4), (0.05, 0.5), (0.30, 0.4),
                     0.15, (4.0, 0.4), (8.2, 0.5), 0.45, (8.2, 0.6)),
    "metal": _Family((0.64, 0.7), (3.9, 0.14), (0.9, 0.6), (120e3, 0.35), (6, 0.4), (0.26, 0.40),
                     (620, 0.5), (0.03, 0.6), (0.15, 0.5),
                     0.40, (1.8, 0.5), (4.9, 0.6), 0.25, (3.6, 0.7)),
    "wood": _Family((1.7, 0.6), (3.9, 0.14), (1.3, 0.6), (75e3, 0.35), (9, 0.4), (0.34, 0.40),
                    (320, 0.45), (0.07, 0.4), (0.12, 0.4),
                    0.30, (2.2, 0.5), (6.1, 0.6), 0.25, (6, 0.6)),
    "foam": _Family((5.5, 0.5), (3.7, 0.14), (2.0, 0.6), (8e3, 0.4), (14, 0.4), (0.58, 0.40),
                    (90, 0.4), (0.40, 0.3), (0.04, 0.4),
                    0.10, (3.0, 0.4), (16, 0.5), 0.30, (18, 0.5)),
    "mesh": _Family((1, 0.6), (3.9, 0.14), (1.1, 0.6), (70e3, 0.5), (8, 0.4), (0.32, 0.40),
                    (380, 0.5), (0.05, 0.6), (0.08, 0.5),
                    1.00, (2.2, 0.45), (9, 0.5), 0.15, (6, 0.6)),
    "textile": _Family((4.5, 0.5), (3.8, 0.14), (1.1, 0.6), (14e3, 0.4), (13, 0.4), (0.44, 0.40),
                       (150, 0.4), (0.35, 0.3), (0.06, 0.4),
                       0.65, (1.1, 0.45), (10, 0.5), 0.20, (15, 0.6)),
    "paper": _Family((1.1, 0.6), (3.8, 0.14), (0.8, 0.6), (45e3, 0.4), (10, 0.4), (0.32, 0.40),
                     (240, 0.45), (0.18, 0.4), (0.08, 0.4),
                     0.15, (1.6, 0.5), (4.9, 0.6), 0.15, (4.2, 0.6)),
    "rubber": _Family((3.1, 0.6), (3.9, 0.14), (1.4, 0.6), (22e3, 0.45), (15, 0.4), (0.62, 0.40),
                      (170, 0.4), (0.30, 0.3), (0.08, 0.4),
                      0.40, (3.0, 0.5), (14, 0.6), 0.25, (12, 0.6)),
    "plastic": _Family((0.91, 0.7), (3.9, 0.14), (1.0, 0.6), (65e3, 0.4), (9, 0.4), (0.32, 0.40),
                       (380, 0.5), (0.08, 0.5), (0.10, 0.5),
                       0.35, (2.4, 0.5), (6.6, 0.7), 0.20, (4.8, 0.7)),
    "tile": _Family((0.49, 0.7), (4.0, 0.14), (1.6, 0.6), (120e3, 0.35), (6, 0.4), (0.28, 0.40),
                    (560, 0.45), (0.04, 0.5), (0.22, 0.4),
                    0.15, (5.0, 0.4), (6.6, 0.6), 0.25, (4.8, 0.7)),
    "sandpaper": _Family((2.9, 0.5), (3.4, 0.14), (0.5, 0.6), (60e3, 0.4), (9, 0.4), (0.52, 0.40),
                         (260, 0.4), (0.15, 0.4), (0.10, 0.4),
                         0.00, (1.0, 0.1), (4.1, 0.1), 0.30, (9, 0.5)),
    "cork": _Family((4.1, 0.4), (3.8, 0.14), (1.6, 0.6), (22e3, 0.4), (14, 0.4), (0.46, 0.40),
                    (190, 0.4), (0.25, 0.3), (0.09, 0.4),
                    0.05, (3.0, 0.4), (10, 0.5), 0.50, (14, 0.5)),
}  # fmt: skip
_ORDER = ("stone", "metal", "wood", "foam", "mesh", "textile", "paper", "rubber", "plastic", "tile", "stone",
          "mesh", "metal", "sandpaper", "wood", "textile", "cork", "foam", "plastic", "rubber")  # fmt: skip


def surface_catalogue(n: int, seed: int) -> tuple[Surface, ...]:
    """Return n surfaces; surface i depends on the seed and on i alone.

    Categories take turns. Within a category every property is log-normal, wide enough to reach into its
    neighbours, so that a surface is told by the combination of its properties.

    Parameters
    ----------
    n : int
        How many.
    seed : int
        Of the catalogue.
    """
    return tuple(_surface(i, np.random.default_rng(np.random.SeedSequence((seed, 0, i)))) for i in range(n))


def _surface(index: int, rng: np.random.Generator) -> Surface:
    category = _ORDER[index % len(_ORDER)]
    family = _FAMILIES[category]
    kinetic = _draw(rng, family.kinetic_friction)
    return Surface(
        name=f"{category}-{index + 1:02d}",
        category=category,
        rms_um=_draw(rng, family.rms_um),
        slope=_draw(rng, family.slope),
        corner_mm=_draw(rng, family.corner_mm),
        gratings=_gratings(family, rng),
        bumps=_bumps(family, rng),
        stiffness_n_m=_draw(rng, family.stiffness_n_m),
        dissipation_s_m=_draw(rng, family.dissipation_s_m),
        static_friction=kinetic * rng.uniform(1.1, 1.5),
        kinetic_friction=kinetic,
        stribeck_mm_s=rng.uniform(3.0, 10.0),
        body_hz=_draw(rng, family.body_hz),
        body_damping=_draw(rng, family.body_damping),
        body_mass_kg=_draw(rng, family.body_mass_kg),
    )


def _gratings(family: _Family, rng: np.random.Generator) -> tuple[Grating, ...]:
    if rng.random() >= family.grating_chance:
        return ()
    first = Grating(
        wavelength_mm=_draw(rng, family.grating_mm),
        depth_um=_draw(rng, family.depth_um),
        sharpness=rng.uniform(0.0, 0.8),
        jitter=rng.uniform(0.05, 0.6),
    )
    if rng.random() < 0.7:
        return (first,)
    ratio = rng.uniform(1.7, 3.5)  # a weave or an embossing has a second, coarser period
    return (first, Grating(first.wavelength_mm * ratio, first.depth_um, rng.uniform(0.0, 0.5), first.jitter))


def _bumps(family: _Family, rng: np.random.Generator) -> Bumps | None:
    if rng.random() >= family.bumps_chance:
        return None
    return Bumps(
        density_per_mm=_draw(rng, (0.08, 0.7)),
        height_um=_draw(rng, family.bumps_um),
        width_mm=_draw(rng, (0.7, 0.35)),
    )


def _draw(rng: np.random.Generator, median_and_spread: Range) -> float:
    median, spread = median_and_spread
    return float(median * np.exp(spread * np.clip(rng.standard_normal(), -2.0, 2.0)))
