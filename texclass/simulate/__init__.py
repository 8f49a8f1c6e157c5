"""Freehand recordings of simulated surfaces: physically motivated, deterministic, the truth known."""

from typing import TYPE_CHECKING

import lazy_loader as lazy

if TYPE_CHECKING:
    from texclass.simulate.catalogue import surface_catalogue
    from texclass.simulate.controlled import record_rising_force, record_rising_speed, record_rising_taps
    from texclass.simulate.freehand import record_freehand
    from texclass.simulate.operators import Operator, operator_catalogue
    from texclass.simulate.recipe import Recipe
    from texclass.simulate.sensor import Sensor
    from texclass.simulate.surfaces import Bumps, Grating, Surface

__getattr__, __dir__, _ = lazy.attach(
    __name__,
    submod_attrs={
        "catalogue": ["surface_catalogue"],
        "controlled": ["record_rising_force", "record_rising_speed", "record_rising_taps"],
        "freehand": ["record_freehand"],
        "operators": ["Operator", "operator_catalogue"],
        "recipe": ["Recipe"],
        "sensor": ["Sensor"],
        "surfaces": ["Bumps", "Grating", "Surface"],
    },
)

__all__ = [
    "Bumps",
    "Grating",
    "Operator",
    "Recipe",
    "Sensor",
    "Surface",
    "operator_catalogue",
    "record_freehand",
    "record_rising_force",
    "record_rising_speed",
    "record_rising_taps",
    "surface_catalogue",
]
