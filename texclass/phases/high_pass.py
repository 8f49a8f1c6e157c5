"""Power of the acceleration above the frequencies of hand motion, computed in one pass over a recording.

This takes a third of the time of filtering with `scipy.signal.sosfilt` and summing the output, because the
temporary arrays of that method do not fit into the cache of the processor. The tests compare both methods.
"""

import numpy as np

from texclass.compilation import njit
from texclass.recording import Samples


@njit(cache=True, error_model="numpy")
def high_pass_power(
    axes: Samples, rest: Samples, first: int, sos: Samples, step: int, bin_size: int
) -> tuple[Samples, Samples, float]:
    """Return the power of the high-passed acceleration.

    The filter only runs forwards, so that it does not ring before an impact.

    Parameters
    ----------
    axes : ndarray of shape (n_samples, n_channels)
        Acceleration.
    rest : ndarray of shape (n_channels,)
        Level at rest, which replaces the samples before `first`.
    first : int
        First sample with data.
    sos : ndarray of shape (n_sections, 6)
        Second-order sections of the high-pass filter.
    step, bin_size : int
        Number of samples that are averaged into one row of `power` before filtering, and number of rows per
        bin.

    Returns
    -------
    power : ndarray of shape (n_rows,)
        Squared acceleration after filtering, summed over channels.
    means : ndarray of shape (n_channels, n_bins)
        Means of the bins before filtering, relative to rest.
    correlation : float
        Autocorrelation after filtering at a lag of one row, from -1 to 1.
    """
    n, n_channels = axes.shape
    n_rows = -(-n // step)
    power, means = np.zeros(n_rows), np.zeros((n_channels, -(-n_rows // bin_size)))
    state, previous, product = np.zeros((n_channels, len(sos), 2)), np.zeros(n_channels), 0.0
    for row in range(n_rows):
        start, stop = row * step, min((row + 1) * step, n)
        n_in_bin = min(bin_size, n_rows - row // bin_size * bin_size)
        for c in range(n_channels):
            y = 0.0
            for i in range(max(start, first), stop):
                y += axes[i, c] - rest[c]
            y /= stop - start
            means[c, row // bin_size] += y / n_in_bin
            for s in range(len(sos)):  # direct form II, transposed
                x = y
                y = sos[s, 0] * x + state[c, s, 0]
                state[c, s, 0] = sos[s, 1] * x - sos[s, 4] * y + state[c, s, 1]
                state[c, s, 1] = sos[s, 2] * x - sos[s, 5] * y
            power[row] += y * y
            product += y * previous[c]
            previous[c] = y
    total = power.sum()
    return power, means, product / total if total > 0 else 0.0
