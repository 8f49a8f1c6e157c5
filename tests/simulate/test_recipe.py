"""Tests of recipes, whose recordings do not depend on order and process."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from texclass.simulate import Recipe

SMALL = Recipe(n_surfaces=3, n_recordings=4, n_operators=2, duration_s=3.0, fs=2_000, seed=5)
PROGRAM = """
import hashlib
from texclass.simulate import Recipe
recipe = Recipe(n_surfaces=3, n_recordings=4, n_operators=2, duration_s=3.0, fs=2_000, seed=5)
print(hashlib.sha256(recipe.record(2, 3).acceleration.tobytes()).hexdigest())
"""


def changed(**changes):
    return Recipe(**{**dict(SMALL), **changes})


def test_operators_alternate():
    entries = changed(n_recordings=10, n_operators=5).entries()
    first = [operator for _, _, operator, _ in entries[:10]]
    assert sorted(first.count(name) for name in set(first)) == [2] * 5
    assert len({recording_id for recording_id, *_ in entries}) == 30


def test_recording_is_the_same_in_another_process_with_another_hash_seed():
    SMALL.record(0, 1)
    ours = hashlib.sha256(SMALL.record(2, 3).acceleration.tobytes()).hexdigest()
    theirs = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, "PYTHONHASHSEED": "77", "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert theirs.stdout.strip() == ours


def test_a_larger_dataset_contains_the_smaller_one():
    larger = changed(n_surfaces=6, n_recordings=8)
    np.testing.assert_array_equal(SMALL.record(1, 2).acceleration, larger.record(1, 2).acceleration)


def test_fingerprint_changes_with_the_recipe():
    assert SMALL.fingerprint() == changed().fingerprint()
    assert SMALL.fingerprint() != changed(seed=6).fingerprint()


def test_recordings_outside_the_recipe_raise_an_index_error():
    for surface, repetition in ((-1, 1), (3, 1), (0, 0), (0, 5)):
        with pytest.raises(IndexError, match=r"between 0 and 2 and repetition between 1 and 4"):
            SMALL.record(surface, repetition)


def test_fingerprint_changes_with_the_code_of_the_simulation(monkeypatch):
    fingerprint = SMALL.fingerprint()
    monkeypatch.setattr("texclass.simulate.recipe.code_hash", lambda *places, words: "edited")
    assert SMALL.fingerprint() != fingerprint
