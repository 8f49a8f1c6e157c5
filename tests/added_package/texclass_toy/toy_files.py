"""Files of somebody else: the rate on the first line, one sample on each other."""

import numpy as np

from texclass.loaders.readers import ReadSignals


def names(path, settings):
    """Return the names of the columns of a file."""
    return ("acceleration",)


def read(path, wanted, settings):
    """Read a file."""
    fs, *samples = path.read_text().split()
    return ReadSignals({"acceleration": np.array(samples, dtype=float)}, fs=float(fs))
