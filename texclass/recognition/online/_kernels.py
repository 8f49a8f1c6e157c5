"""Inner loop of the causal filter: every sample meets the same operations in the same order."""

from numba import njit

from texclass.recording import Samples


@njit(cache=True, error_model="numpy")
def filter_sections(sos: Samples, rows: Samples, state: Samples) -> None:
    """Filter rows (n, n_axes) in place by second-order sections: what scipy's `sosfilt` gives.

    Transposed direct form II; for each section in turn::

        y = b0 x + z0,    z0 = b1 x - a1 y + z1,    z1 = b2 x - a2 y

    Parameters
    ----------
    sos : ndarray of shape (n_sections, 6)
        b0, b1, b2, 1, a1, a2.
    rows : ndarray of shape (n, n_axes)
        What is filtered, and what becomes of it.
    state : ndarray of shape (n_sections, 2, n_axes)
        z0 and z1; carried on.
    """
    for t in range(rows.shape[0]):
        for axis in range(rows.shape[1]):
            x = rows[t, axis]
            for s in range(sos.shape[0]):
                y = sos[s, 0] * x + state[s, 0, axis]
                state[s, 0, axis] = sos[s, 1] * x - sos[s, 4] * y + state[s, 1, axis]
                state[s, 1, axis] = sos[s, 2] * x - sos[s, 5] * y
                x = y
            rows[t, axis] = x
