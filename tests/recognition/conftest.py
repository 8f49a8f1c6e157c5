"""Models that are trained once."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from toy_surfaces import pipeline, surfaces
from turning_surfaces import turning_model

from texclass.recognition import train


@pytest.fixture(scope="session")
def kernel_model(_own_cache):
    return train(surfaces(), pipeline(), row="Spectrum", classifier="kernel")


@pytest.fixture(scope="session")
def linear_model(_own_cache):
    return train(surfaces(), pipeline(), row="Spectrum", classifier="lda")


@pytest.fixture(scope="session")
def touch_model(_own_cache):
    return train(surfaces(), pipeline(), row="Spectrum", classifier="lda", touch_s=0.25)


@pytest.fixture(scope="session")
def turning(_own_cache):
    return turning_model()
