"""Friction, as the force-sensing resistors of the stylus feel it [strese2015, section IV-E]."""

import numpy as np

from texclass.features.contract import Gain, feature
from texclass.features.movement_filters import magnitude_of
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
    size = np.abs(view.samples)
    peak = float(size.max(initial=0.0))
    mean = peak * float((size / peak).mean()) if 0 < peak < np.inf else 0.0  # a sum may overflow
    if not mean:
        magnitude_of(view.samples)  # says why
    return mean
