"""Friction, measured by the force-sensing resistors of the tool [strese2015, section IV-E]."""

import numpy as np

from texclass.features.contract import Gain, feature
from texclass.features.movement_filters import magnitude_of
from texclass.features.phase_view import PhaseView


@feature("friction", "V", "strese2015, eq. 8", gain=Gain(power=1))
def friction(view: PhaseView) -> float:
    """Return the mean magnitude of the friction voltage during the movement, Fr = mean |v|.

    The value does not depend on the direction of the stroke, but it does depend on the offset of the
    measuring bridge.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Friction voltage. For an array, also pass `fs` in Hz.

    Returns
    -------
    float
        Mean magnitude in V.

    Raises
    ------
    UndefinedFeatureError
        If the voltage is always 0 (for example because the sensor is not connected) or not finite.

    References
    ----------
    `strese2015`, eq. 8.

    Examples
    --------
    >>> friction([0.2, 0.3, -0.2, -0.3], fs=1000)  # a stroke forwards and backwards
    0.25
    """
    magnitude = np.abs(view.samples)
    peak = float(magnitude.max(initial=0.0))
    mean = peak * float((magnitude / peak).mean()) if 0 < peak < np.inf else 0.0  # a sum may overflow
    if not mean:
        magnitude_of(view.samples)  # raises with the reason
    return mean
