"""Gestures on demand: each is what its name says, by the same hand on the same surface."""

from dataclasses import replace

import numpy as np
import pytest

from texclass.loaders.simulated import open_gestures
from texclass.simulate import GESTURES, Recipe, operator_catalogue, record_gesture, surface_catalogue

SURFACE, OPERATOR = surface_catalogue(3, 6)[2], operator_catalogue(1, 6)[0]


def made(gesture, seed=1):
    return record_gesture(gesture, SURFACE, OPERATOR, seed=seed)


def test_a_tap_is_one_tap_and_a_stroke_a_movement():
    assert (made("tap").phases.kind, len(made("tap").phases.taps)) == ("taps only", 1)
    assert {made(name).phases.kind for name in GESTURES if name != "tap"} == {"movement only"}


def test_strokes_are_slow_fast_or_hard():
    felt = {name: [made(name, seed) for seed in range(4)] for name in GESTURES if name != "tap"}
    speed = {name: np.median([r.speed[r.phases.onset :].mean() for r in some]) for name, some in felt.items()}
    force = {name: np.median([r.normal_force.mean() for r in some]) for name, some in felt.items()}
    assert 2 * speed["slow stroke"] < speed["hard stroke"]
    assert 1.5 * speed["hard stroke"] < speed["fast stroke"]
    assert force["hard stroke"] == pytest.approx(2.5 * force["fast stroke"], rel=0.2)


def test_taps_of_one_hand_differ_in_strength_and_are_the_same_again():
    peaks = [np.abs(made("tap", seed).acceleration).max() for seed in range(5)]
    assert np.std(peaks) > 0.03 * np.mean(peaks)
    assert made("tap", 3).acceleration.tobytes() == made("tap", 3).acceleration.tobytes()


def test_a_dataset_of_a_gesture_has_the_people_of_its_recipe_and_withholds_the_phases():
    recipe = Recipe(n_surfaces=2, n_recordings=4, n_operators=2, duration_s=5, fs=8000, seed=6)
    taps, strokes = open_gestures(recipe, "tap"), open_gestures(recipe, "fast stroke")
    assert taps.input_hash != strokes.input_hash
    assert taps.input_hash != open_gestures(recipe.model_copy(update={"seed": 7}), "tap").input_hash
    entry = taps.entries[1]
    recording = taps.load(entry)
    assert (recording.operator, recording.material) == (entry.operator, entry.material)
    assert (recording.phases, recording.fs) == (None, 8000)
    other = taps.load(replace(entry, operator=taps.entries[0].operator))
    assert recording.n_samples != other.n_samples or (recording.acceleration != other.acceleration).any()
