"""Surfaces: what of a material the tool can feel, and a catalogue of everyday ones."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples


@dataclass(frozen=True)
class Grating:
    """A repeating structure: ribs, threads, the bars of a mesh.

    Attributes
    ----------
    wavelength_mm
        Period.
    depth_um
        Peak to valley.
    sharpness
        0 is a sine; towards 1 the crests narrow and harmonics grow.
    jitter
        Deviation of the phase from a perfect repetition, in radians per square root of a period.
    """

    wavelength_mm: float
    depth_um: float
    sharpness: float = 0.0
    jitter: float = 0.0


@dataclass(frozen=True)
class Bumps:
    """Sparse grains, pits' rims or knots that stand out of the profile.

    Attributes
    ----------
    density_per_mm
        Mean number along a line.
    height_um
        Mean of their gamma-distributed heights (shape 3: few are much higher than the rest).
    width_mm
        Full width at half height.
    """

    density_per_mm: float
    height_um: float
    width_mm: float


@dataclass(frozen=True)
class Surface:
    """A simulated surface.

    The spectrum of its heights along a line is S(f) ~ (1 + (f * corner_mm)^2)^(-slope / 2), f in 1/mm, cut at
    small scales by the tip of the tool; gratings and bumps are added. The contact is F = K d^1.5 (1 + D d'),
    Hertz's law with the dissipation of Hunt and Crossley, d the indentation.

    Attributes
    ----------
    name, category
        Label, and the family it was drawn from.
    rms_um
        Root mean square of the random heights before the tip's cut.
    slope
        Fall of the power spectrum above the corner (power of the spatial frequency).
    corner_mm
        Wavelength above which the spectrum is flat.
    gratings, bumps
        Repeating structures; sparse ones (None: there are none).
    stiffness_n_m
        Tangent stiffness of the contact at a normal force of 1 N.
    dissipation_s_m
        D of Hunt and Crossley.
    static_friction, kinetic_friction
        Coefficients.
    stribeck_mm_s
        Speed over which static becomes kinetic friction.
    body_hz, body_damping, body_mass_kg
        The lowest mode of the explored object itself, where it is touched: natural frequency, damping ratio,
        effective mass. It is what a plate "sounds" like, whatever the speed.
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
    body_hz: float = 400.0
    body_damping: float = 0.1
    body_mass_kg: float = 0.3

    @property
    def hertz_n_m15(self) -> float:
        """K in N / m^1.5, from dF/dd = 1.5 K^(2/3) F^(1/3) at F = 1 N."""
        return float((self.stiffness_n_m / 1.5) ** 1.5)

    def indentation_m(self, force_n: ArrayLike) -> Samples:
        """Return how deep a resting tip sinks in under `force_n`."""
        return np.asarray((np.asarray(force_n) / self.hertz_n_m15) ** (2.0 / 3.0))
