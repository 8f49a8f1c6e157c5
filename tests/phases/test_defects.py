"""Single-sample glitches."""

import itertools

import numpy as np
import pytest

from texclass.phases import find_glitches, find_phases
from texclass.phases.defects import BLOCK, GLITCH_RATIO, N_NEIGHBOURS, get_glitches
from texclass.recording import Recording

FS = 10_000.0
PLACES = np.array([1, 700, BLOCK - 1, BLOCK + 500, 2 * BLOCK, 20_000, 24_998])


def rest_with_glitches(n=25_000, n_channels=3):
    rng = np.random.default_rng(4)
    x = 0.01 * rng.normal(size=(n, n_channels)) + [0.0, 3.0, 9.8][:n_channels]
    x[PLACES, n_channels - 1] += 5.0
    return x


def by_definition(x):
    """Return the glitches by their definition, sample by sample."""
    indices = []
    for i, column in itertools.product(range(1, len(x) - 1), x.T):
        first = min(max(i - N_NEIGHBOURS, 0), len(x) - 2 * N_NEIGHBOURS - 1)
        neighbours = column[first : first + 2 * N_NEIGHBOURS + 1].copy()
        neighbours[i - first] = column[i - 1]
        if abs(column[i] - np.median(neighbours)) > GLITCH_RATIO * np.ptp(neighbours):
            indices.append(i)
    return np.unique(indices)


@pytest.mark.parametrize("n_channels", [1, 2, 3])
def test_glitches_are_found_at_any_place_and_nothing_else(n_channels):
    x = rest_with_glitches(n_channels=n_channels)
    np.testing.assert_array_equal(find_glitches(x), PLACES)


def test_vibration_of_a_channel_does_not_hide_glitches_of_another():
    x = rest_with_glitches()
    x[BLOCK + 1000 : 2 * BLOCK - 500, 0] *= 300
    np.testing.assert_array_equal(find_glitches(x), PLACES)


@pytest.mark.parametrize("n", [9, 10, 255, 256, 257, 600])
def test_glitches_of_short_signals_match_the_definition(n):
    rng = np.random.default_rng(n)
    for _ in range(20):
        x = rng.normal(size=(n, 2))
        x[rng.integers(1, n - 1), 1] += 80.0
        np.testing.assert_array_equal(find_glitches(x), by_definition(x))


@pytest.mark.parametrize("stop", [0, 2, 700, BLOCK - 1, BLOCK, 2 * BLOCK + 1, 25_000])
def test_glitches_do_not_depend_on_a_previous_search_for_phases(stop):
    recording = Recording(rest_with_glitches(), FS, "m/s^2")
    glitches = get_glitches(recording, stop)
    np.testing.assert_array_equal(glitches, PLACES[stop > PLACES])
    find_phases(recording)
    np.testing.assert_array_equal(get_glitches(recording, stop), glitches)


@pytest.mark.parametrize("distance", [0.999, 1.001])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_glitch_exceeds_the_threshold_distance_from_its_neighbours(distance, side):
    for seed in range(20):
        x = np.random.default_rng(seed).normal(size=(40, 1))
        neighbours = np.array([*x[16:20, 0], x[19, 0], *x[21:25, 0]])
        x[20] = np.median(neighbours) + side * distance * GLITCH_RATIO * np.ptp(neighbours)
        assert find_glitches(x).tolist() == ([20] if distance > 1 else [])
