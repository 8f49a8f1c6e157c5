"""Resolution of samples: signals with too few distinct values, or with a vibration below one step."""

import numpy as np

from texclass.recording import Samples

MIN_LEVELS = 7
"""Smallest number of distinct values. A Gaussian signal whose deviation is one quantisation step takes about
seven values (plus and minus three deviations)."""
MIN_STEPS = 1.0
"""Smallest deviation in quantisation steps. Above it, the rounding error of a Gaussian signal is independent
of the signal, with a deviation of 0.29 steps (Widrow and Kollar, Quantization Noise, 2008). Below it, levels
and spectra depend on the converter."""
MIN_SAMPLES = 50
"""Smallest number of samples from which the quantisation step is detected."""
BLOCK_S = 0.2
"""Duration in s of the blocks whose means are removed, as long as the moving average that removes hand
motion."""
MIN_REPEATED_SHARE = 0.9
"""Smallest fraction of samples whose value occurs more than once, in a coarsely quantised signal."""
MIN_EQUAL_SHARE = 0.1
"""Smallest fraction of samples that equal their predecessor, in a coarsely quantised signal. For Gaussian
signals with a deviation of at most one step, the fraction is at least 0.2."""


def resolution_problem(axes: Samples, fs: float) -> str:
    """Return why the resolution of a signal is too low, or "" if it suffices.

    The quantisation step is the smallest distance between values that occur more than once. The resolution
    suffices if at least one channel has 7 distinct values and a deviation of one step. The deviation is the
    RMS after the mean of each block of 0.2 s is removed.

    Parameters
    ----------
    axes : ndarray of shape (n,) or (n, n_channels)
        Samples in any unit.
    fs : float
        Sampling rate in Hz.

    Returns
    -------
    str
        Problem and remedy. Constant signals and signals with fewer than 50 samples are not checked.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal(5000)
    >>> resolution_problem(np.round(8 * x), fs=1000)
    ''
    >>> resolution_problem(np.round(0.4 * x), fs=1000).partition(",")[0]
    'few levels: 4 distinct values'
    """
    if len(axes) < MIN_SAMPLES:
        return ""
    columns = axes.reshape(len(axes), -1).T
    resolutions = [_resolution(column, fs) for column in columns if np.ptp(column) > 0]
    if not resolutions or any(n >= MIN_LEVELS and steps >= MIN_STEPS for n, steps in resolutions):
        return ""
    n_levels, n_steps = max(resolutions, key=lambda resolution: resolution[1])
    return (
        f"few levels: {n_levels} distinct values, with a deviation of {n_steps:.2g} quantisation steps. "
        f"Expected at least {MIN_LEVELS} values and {MIN_STEPS:g} step. "
        "Record with a higher gain or more bits per sample"
    )


def _resolution(signal: Samples, fs: float) -> tuple[float, float]:
    """Return the number of distinct values and the deviation in steps; both infinite if not quantised."""
    n, fine = len(signal), (np.inf, np.inf)
    has_few_repeats = np.mean(signal[1:] == signal[:-1]) < MIN_EQUAL_SHARE
    if has_few_repeats and np.unique(signal[:: max(1, n // 200)]).size >= MIN_LEVELS:
        return fine  # for most signals, so that not all samples must be sorted
    levels, counts = np.unique(signal, return_counts=True)
    repeated = levels[counts > 1]
    if len(repeated) < 2 or counts[counts > 1].sum() < MIN_REPEATED_SHARE * n:
        return fine
    size = min(n, max(MIN_LEVELS, round(BLOCK_S * fs)))
    variances = signal[: n // size * size].reshape(-1, size).var(axis=1)
    return len(levels), float(np.sqrt(variances.mean()) / np.diff(repeated).min())
