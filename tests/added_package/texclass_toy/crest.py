"""A feature of somebody else."""

import numpy as np

from texclass.features import Gain, feature
from texclass.features.movement_filters import unit


@feature("movement", unit="1", reference="an example", gain=Gain())
def toy_crest(view):
    """Peak over root mean square."""
    x = unit(view)
    return np.abs(x).max() / np.sqrt(np.mean(x**2))
