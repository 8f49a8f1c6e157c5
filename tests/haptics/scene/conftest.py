"""A scene's TOML and a search small enough for tests."""

from dataclasses import replace

import pytest

from texclass.haptics.scene import observations, plan, proof, read_scene

TOML = """
[device]
rate_hz = 1000
band_hz = [20, 450]
noise_floor = 0.05
largest_output = 30
[expected]
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
    """Return a function that writes a scene of one surface, or of others, with some of its text replaced."""

    def write(*changes, surfaces=WOOD):
        text = TOML + surfaces
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "scene.toml").write_text(text)
        return tmp_path / "scene.toml"

    return write


@pytest.fixture
def scene(toml):
    """Return a function that reads such a scene."""
    return lambda *changes, **options: read_scene(toml(*changes, **options))


@pytest.fixture(scope="module")
def few():
    """Look at fewer speeds, forces, nodes and orders than a user would."""
    grids = {"n_speeds": (1, 2, 4), "n_forces": (1, 2), "few_grids": ((2, 2),)}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(observations, "SAMPLING", replace(observations.SAMPLING, n_speeds=4, n_forces=2))
        patch.setattr(plan, "SEARCH", replace(plan.SEARCH, stages=(range(1, 9),), **grids))
        patch.setattr(proof, "PROOF", replace(proof.PROOF, n_samples=600, n_each=100))
        yield
