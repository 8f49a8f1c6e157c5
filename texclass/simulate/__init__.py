"""Freehand recordings of simulated surfaces: physically motivated, deterministic, the truth known."""

from texclass.simulate.catalogue import surface_catalogue
from texclass.simulate.controlled import record_rising_force, record_rising_speed, record_rising_taps
from texclass.simulate.freehand import record_freehand
from texclass.simulate.operators import Operator, operator_catalogue
from texclass.simulate.recipe import PRESETS, Recipe
from texclass.simulate.sensor import Sensor
from texclass.simulate.surfaces import Bumps, Grating, Surface

__all__ = [
    "PRESETS",
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
