"""Scenes small enough for tests."""

import pytest

from texclass.scene import observations, search


@pytest.fixture(scope="module")
def few():
    """Look at fewer speeds, forces, nodes and orders than a user would."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("N_SPEEDS", 4), ("N_FORCES", 2)):
            patch.setattr(observations, name, value)
        for name, value in (
            ("N_SPEEDS", (1, 2, 4)),
            ("N_FORCES", (1, 2)),
            ("STAGES", (range(1, 9),)),
            ("FEW_GRIDS", ((2, 2),)),
        ):
            patch.setattr(search, name, value)
        yield
