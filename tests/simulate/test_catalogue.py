"""Tests of the catalogues of surfaces and operators."""

from dataclasses import astuple
from itertools import pairwise

import numpy as np
import pytest

from texclass.simulate import operator_catalogue, surface_catalogue

SURFACES = surface_catalogue(69, 2015)
PROPERTIES = (
    "rms_um",
    "slope",
    "corner_mm",
    "stiffness_n_m",
    "dissipation_s_m",
    "kinetic_friction",
    "body_hz",
    "body_damping",
)


def test_catalogue_has_unique_names_and_many_categories():
    assert len({surface.name for surface in SURFACES}) == 69
    assert len({surface.category for surface in SURFACES}) >= 10


def test_surface_depends_on_its_index_alone():
    assert surface_catalogue(10, 2015) == SURFACES[:10]
    assert surface_catalogue(10, 2016) != SURFACES[:10]


def test_no_single_property_separates_surfaces_or_categories():
    """In each property, half of the surfaces have a neighbour within 5 %, mostly of another category."""
    for name in PROPERTIES:
        ordered = sorted(SURFACES, key=lambda surface, name=name: getattr(surface, name))
        values = np.log([getattr(surface, name) for surface in ordered])
        gaps = np.minimum(np.diff(values, prepend=-np.inf), np.diff(values, append=np.inf))
        assert np.median(gaps) < 0.05, name
        assert np.mean([a.category == b.category for a, b in pairwise(ordered)]) < 0.4, name


def test_static_friction_exceeds_kinetic_friction():
    assert all(surface.static_friction > surface.kinetic_friction > 0 for surface in SURFACES)


def test_recordings_vary_around_the_habits_of_the_operator():
    operator = operator_catalogue(3, 1)[1]
    rng = np.random.default_rng(0)
    speeds = [operator.vary(rng).speed_mm_s for _ in range(400)]
    assert np.median(speeds) == pytest.approx(operator.speed_mm_s, rel=0.05)
    assert 0.05 < np.std(np.log(speeds)) < 0.3
    assert {operator.vary(rng).name} == {operator.name}


def test_operators_differ_from_each_other():
    first, second = operator_catalogue(2, 1)
    assert all(a != b for a, b in zip(astuple(first), astuple(second), strict=True))
