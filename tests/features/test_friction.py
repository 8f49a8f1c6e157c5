import numpy as np
import pytest

from texclass.features.contract import UndefinedFeatureError
from texclass.features.friction import friction
from texclass.features.phase_view import PhaseView


def test_friction_is_the_mean_magnitude_whatever_the_direction() -> None:
    assert friction(PhaseView(np.array([0.5, -1.5, 1.0]), 1e4)) == pytest.approx(1.0)


def test_a_sensor_that_is_not_connected_has_no_friction() -> None:
    with pytest.raises(UndefinedFeatureError, match="silence: all 10 samples are 0"):
        friction(PhaseView(np.zeros(10), 1e4))
