"""Files of somebody else: the rate on the first line, one sample on each other."""

import numpy as np

from texclass.loaders.columns import ReadSignals


def names(path, options):
    """Return the names of the columns of a file."""
    return ("acceleration",)


def read(path, wanted, options):
    """Read a file."""
    fs, *samples = path.read_text().split()
    return ReadSignals({"acceleration": np.array(samples, dtype=float)}, fs=float(fs))
