"""Friction, as the force-sensing resistors of the stylus feel it [strese2015, section IV-E]."""

import numpy as np

from texclass.features.conditioning import magnitude_of
from texclass.features.contract import Gain, feature
from texclass.features.phase_view import PhaseView


@feature("friction", "V", "strese2015, eq. 8", gain=Gain(power=1))
def friction(view: PhaseView) -> float:
    """Mean magnitude of the friction voltage during the movement, Fr = mean |v|.

    The direction of the stroke drops out; an offset of the bridge does not.

    Raises
    ------
    UndefinedFeatureError
        If the voltage is 0 throughout (a sensor that is not connected), or not finite.
    """
    mean = float(np.abs(view.samples).mean()) if view.n_samples else 0.0
    if not 0 < mean < np.inf:
        magnitude_of(view.samples)  # says why
    return mean
