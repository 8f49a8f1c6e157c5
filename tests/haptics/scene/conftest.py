"""Fixtures: a scene file, and a search small enough for tests."""

from dataclasses import replace

import pytest

from texclass.haptics.scene import measurement, plan, read_scene, surface_spectra

TOML = """
[device]
rate_hz = 1000
band_hz = [20, 450]
noise_floor = 0.05
largest_output = 30
[motion]
speeds_mm_s = [60, 120]
forces_n = [0.8, 1.2]
[tolerance]
score = "log_spectral_db"
limit = 4
[budget]
microseconds = 1e6
bytes = 1_000_000
contacts = 2
"""
WOOD = '[surfaces.wood]\nsimulated = "abdulali2016/S8"\nfriction = 0.4\n'


@pytest.fixture
def toml(tmp_path):
    """Return a function that writes a scene file of one surface (default), with some text replaced."""

    def write(*replacements, surfaces=WOOD):
        text = TOML + surfaces
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "scene.toml").write_text(text)
        return tmp_path / "scene.toml"

    return write


@pytest.fixture
def scene(toml):
    """Return a function that writes such a scene file and reads it."""
    return lambda *replacements, **options: read_scene(toml(*replacements, **options))


@pytest.fixture(scope="module")
def small_search():
    """Use fewer speeds, forces, nodes and orders than the defaults."""
    grids = {"n_speeds": (1, 2, 4), "n_forces": (1, 2), "reduced_grids": ((2, 2),)}
    with pytest.MonkeyPatch.context() as patch:
        small_sampling = replace(surface_spectra.SAMPLING, n_speeds=4, n_forces=2)
        patch.setattr(surface_spectra, "SAMPLING", small_sampling)
        patch.setattr(plan, "SEARCH", replace(plan.SEARCH, stages=(range(1, 9),), **grids))
        short_measurement = replace(measurement.MEASUREMENT, n_samples=600, n_surface_samples=100)
        patch.setattr(measurement, "MEASUREMENT", short_measurement)
        yield
