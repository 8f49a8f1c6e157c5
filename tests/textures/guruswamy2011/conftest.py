"""A short scan of the simulated rubber mat and its texture, shared by the tests."""

import numpy as np
import pytest
from guruswamy2011_objects import OBJECTS, lay_out, simulate_scan

from texclass.textures.guruswamy2011 import FittedScan, fit_texture

RUBBER = OBJECTS[2]


@pytest.fixture(scope="session")
def rubber_fit() -> FittedScan:
    rng = np.random.default_rng(3)
    section = lay_out(RUBBER, 80.0, rng)
    return fit_texture(simulate_scan(RUBBER, section, rng), RUBBER.law)
