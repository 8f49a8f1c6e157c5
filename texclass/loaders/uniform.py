"""Samples at the instants of their stamps -> samples at a uniform rate; the choice is stated in words."""

from fractions import Fraction

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.signal import resample_poly

from texclass.loaders.stamps import SHOWN_JITTER, Sampling
from texclass.recording import RecordingError, Samples

SAME_RATE = 1e-3
"""Rates that differ by less are one rate: crystals differ by 1e-4."""
NEAR_RATE = 0.02
"""Rates that differ by less are resampled; by more, one of them is wrong."""
MOST_JITTER = 0.5
"""Stamps that deviate by more, in periods (root mean square), say nothing of when a sample was taken."""
MOST_RESOLUTION = 0.05
"""Stamps in coarser units, in periods (whole milliseconds at 100 Hz and more), say too little, too."""
KEPT_JITTER = 0.02
"""Stamps that deviate by less are taken as evenly spaced."""


def nominal_rate(rate: float) -> float:
    """Return the roundest rate within `SAME_RATE` of a measured one: 99.98 Hz is 100 Hz, 104.2 Hz stays."""
    for digits in range(1, 6):
        if abs((rounded := float(f"{rate:.{digits}g}")) - rate) <= SAME_RATE * rate:
            return rounded
    return rate


def resample(samples: Samples, fs: float, to: float) -> Samples:
    """Resample along the first axis, band-limited: a polyphase filter ends below both Nyquist frequencies.

    Parameters
    ----------
    samples : ndarray of shape (n,) or (n, n_channels)
        At `fs`.
    fs, to : float
        Rates in Hz.

    Returns
    -------
    resampled : ndarray of shape (round(n * to / fs), ...)

    Raises
    ------
    ValueError
        If a rate is not above 0, or they differ by more than a factor of 1000.
    """
    if not (fs > 0 and to > 0 and 1e-3 <= to / fs <= 1e3):
        raise ValueError(f"from {fs} Hz to {to} Hz; the rule is rates above 0, at most a factor 1000 apart")
    ratio = Fraction(to / fs).limit_denominator(1000)
    return np.asarray(resample_poly(samples, ratio.numerator, ratio.denominator, axis=0, padtype="line"))


def at_uniform_rate(
    samples: Samples, sampling: Sampling, given: float | None, *, by_header: bool, where: str
) -> tuple[Samples, float, tuple[str, ...]]:
    """Return samples at a uniform rate.

    Stamps of a header say when a sample was taken: samples are put there and interpolated (monotone cubic).
    Times of receipt do not: samples are then taken as evenly spaced, as they are where stamps nearly are.

    Parameters
    ----------
    samples : ndarray of shape (n, k, n_channels)
        k samples a message, the messages of `sampling`.
    sampling : Sampling
        Which samples they are.
    given : float or None
        Rate in Hz that the user states; None: the nominal rate nearest to the measured one.
    by_header : bool
        Whether the stamps are of headers.
    where : str
        For messages of errors.

    Returns
    -------
    uniform : ndarray of shape (n_uniform, n_channels)
    fs : float
        Its rate in Hz.
    flags : tuple of str
        What was measured and chosen.

    Raises
    ------
    RecordingError
        If the measured rate contradicts the given one.
    """
    per_message = samples.shape[1]
    measured = sampling.rate * per_message
    fs = nominal_rate(measured) if given is None else given
    if abs(measured - fs) > NEAR_RATE * fs:
        raise RecordingError(
            f"{where}: fs is {measured:.6g} Hz by its stamps, {fs:g} Hz was given; the rule is one rate"
        )
    is_jittery = sampling.jitter > KEPT_JITTER
    tells = sampling.jitter <= MOST_JITTER and sampling.resolution <= MOST_RESOLUTION
    at_stamps = is_jittery and by_header and tells and per_message == 1
    uniform = _on_grid(samples, sampling, at_stamps=at_stamps)
    by = "header stamps" if by_header else "times of receipt"
    flags = [f"rate: {measured:.6g} Hz by the {by}"]
    if sampling.jitter > SHOWN_JITTER:
        chosen = "samples interpolated at their stamps" if at_stamps else "samples taken as evenly spaced"
        flags.append(f"jitter: {100 * sampling.jitter:.2g} % of a period (rms), {chosen}")
    if abs(measured - fs) > SAME_RATE * fs:
        uniform = resample(uniform, measured, fs)
        flags[0] += f", resampled (band-limited) to {fs:g} Hz"
    elif f"{measured:.6g}" != f"{fs:.6g}":
        flags[0] += f", taken as {fs:g} Hz"
    return uniform, fs, tuple(flags)


def _on_grid(samples: Samples, sampling: Sampling, *, at_stamps: bool) -> Samples:
    """Return samples at 0, 1, 2, ... periods; what is missing is interpolated."""
    n, per_message, n_channels = samples.shape
    flat = samples.reshape(n * per_message, n_channels)
    index = (sampling.index[:, None] * per_message + np.arange(per_message)).ravel()
    if not at_stamps and index[-1] + 1 == len(flat):
        return flat
    position = index.astype(np.float64)
    if at_stamps:
        position += sampling.offset
        later = np.concatenate(([True], np.diff(np.maximum.accumulate(position)) > 1e-6))
        position, flat = position[later], flat[later]
    grid = np.arange(index[-1] + 1, dtype=np.float64)
    if len(position) < 2:
        return flat
    with np.errstate(all="ignore"):  # of damaged numbers: what becomes infinite is refused as such
        return np.asarray(PchipInterpolator(position, flat, axis=0)(np.clip(grid, position[0], position[-1])))
