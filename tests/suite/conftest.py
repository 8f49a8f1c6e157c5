"""A small dataset with a card, and a table of the suite on it."""

import sys
from pathlib import Path

import numpy as np
import pytest

from texclass.suite import SuiteSettings, find_method, run_suite

CARD = """
title = "Three noises"
licence = "CC0-1.0"
format = "files"
fs_hz = 1000
unit = "m/s^2"
files = '(?P<surface>[a-z]+)/(?P<recording>[a-z]+_(?P<repetition>\\d+))\\.txt'
phases = "movement"

[[protocols]]
question = "published"
protocol = "shuffled-windows"
folds = 3
window_s = 0.5

[[protocols]]
question = "same operator"
protocol = "recording"
folds = 3
window_s = 0.5

[[protocols]]
question = "later"
protocol = "chronological"
"""


@pytest.fixture(scope="session")
def card(tmp_path_factory):
    """Card of three surfaces of coloured noise, six recordings of 2 s each."""
    root = tmp_path_factory.mktemp("suite-data")
    rng = np.random.default_rng(3)
    for i, surface in enumerate(("felt", "oak", "tile")):
        (root / surface).mkdir()
        for k in range(1, 7):
            smooth = np.convolve(rng.normal(size=2000), np.ones(1 + 3 * i), mode="same")
            np.savetxt(root / surface / f"{surface}_{k}.txt", smooth, fmt="%.5f")
    path = root / "noises.toml"
    path.write_text(CARD)
    return path


@pytest.fixture(scope="session")
def settings(tmp_path_factory):
    return SuiteSettings(tmp_path_factory.mktemp("suite"), Path(sys.executable), 300.0)


@pytest.fixture(scope="session")
def table(card, settings):
    """Rows of a pipeline, a baseline, and a baseline whose package is missing."""
    methods = [find_method(name) for name in ("coarse", "bands", "minirocket")]
    return run_suite([str(card)], methods, settings)
