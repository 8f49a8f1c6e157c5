"""What no sensor felt: single wild samples."""

import itertools

import numpy as np
import pytest

from texclass.phases import find_glitches, find_phases
from texclass.phases.defects import BLOCK, GLITCH_RATIO, N_NEIGHBOURS, get_glitches
from texclass.recording import Recording

FS = 10_000.0
PLACES = np.array([1, 700, BLOCK - 1, BLOCK + 500, 2 * BLOCK, 20_000, 24_998])


def rest_with_wild_samples(n=25_000, n_channels=3):
    rng = np.random.default_rng(4)
    x = 0.01 * rng.normal(size=(n, n_channels)) + [0.0, 3.0, 9.8][:n_channels]
    x[PLACES, n_channels - 1] += 5.0
    return x


def by_definition(x):
    """Return the glitches, sample by sample."""
    found = []
    for i, column in itertools.product(range(1, len(x) - 1), x.T):
        first = min(max(i - N_NEIGHBOURS, 0), len(x) - 2 * N_NEIGHBOURS - 1)
        near = column[first : first + 2 * N_NEIGHBOURS + 1].copy()
        near[i - first] = column[i - 1]
        if abs(column[i] - np.median(near)) > GLITCH_RATIO * np.ptp(near):
            found.append(i)
    return np.unique(found)


@pytest.mark.parametrize("n_channels", [1, 2, 3])
def test_wild_samples_are_found_wherever_they_stand_and_nothing_else_is(n_channels):
    x = rest_with_wild_samples(n_channels=n_channels)
    np.testing.assert_array_equal(find_glitches(x), PLACES)


def test_a_channel_that_moves_hides_no_glitch_of_another():
    x = rest_with_wild_samples()
    x[BLOCK + 1000 : 2 * BLOCK - 500, 0] *= 300
    np.testing.assert_array_equal(find_glitches(x), PLACES)


@pytest.mark.parametrize("n", [9, 10, 255, 256, 257, 600])
def test_glitches_of_short_signals_are_those_of_the_definition(n):
    rng = np.random.default_rng(n)
    for _ in range(20):
        x = rng.normal(size=(n, 2))
        x[rng.integers(1, n - 1), 1] += 80.0
        np.testing.assert_array_equal(find_glitches(x), by_definition(x))


@pytest.mark.parametrize("stop", [0, 2, 700, BLOCK - 1, BLOCK, 2 * BLOCK + 1, 25_000])
def test_what_is_mended_does_not_depend_on_whether_phases_were_searched(stop):
    recording = Recording(rest_with_wild_samples(), FS, "m/s^2")
    before = get_glitches(recording, stop)
    np.testing.assert_array_equal(before, PLACES[stop > PLACES])
    find_phases(recording)
    np.testing.assert_array_equal(get_glitches(recording, stop), before)


@pytest.mark.parametrize("far", [0.999, 1.001])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_glitch_is_so_far_from_the_median_of_its_neighbours_and_no_nearer(far, side):
    for seed in range(20):
        x = np.random.default_rng(seed).normal(size=(40, 1))
        near = np.array([*x[16:20, 0], x[19, 0], *x[21:25, 0]])
        x[20] = np.median(near) + side * far * GLITCH_RATIO * np.ptp(near)
        assert find_glitches(x).tolist() == ([20] if far > 1 else [])
