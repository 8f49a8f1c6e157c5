"""When the hand begins to move towards a tap."""

import numpy as np
import pytest

from texclass.phases import hand_start


def test_a_long_pull_of_the_hand_starts_where_it_leaves_the_rest():
    fs, pull_s, t = 10_000.0, 0.11, np.arange(2500) / 10_000.0
    pull = np.outer(1.5 * np.clip(1.0 - (0.25 - t) / pull_s, 0.0, 1.0), [0.6, 0.8])
    rest = 9.81 + 0.01 * np.random.default_rng(0).standard_normal((2500, 2))
    assert hand_start(rest + pull, fs) / fs == pytest.approx(0.25 - 0.8 * pull_s, abs=0.008)
