"""Filters: Butterworth as second-order sections, zero-phase or causal, and a linear-phase FIR high-pass."""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from texclass.recording import Samples
from texclass.signals import all_finite


def butterworth(
    kind: Literal["lowpass", "highpass", "bandpass"],
    cutoff_hz: float | tuple[float, float],
    fs: float,
    *,
    order: int = 4,
) -> Samples:
    """Design a Butterworth filter as second-order sections.

    Parameters
    ----------
    kind : {"lowpass", "highpass", "bandpass"}
        What passes.
    cutoff_hz : float or tuple of float
        Frequency of the -3 dB point in Hz; lower and upper one for a band.
    fs : float
        Sampling rate in Hz.
    order : int
        Order of the filter (of each edge, for a band), 1 or above.

    Returns
    -------
    ndarray of shape (n_sections, 6)

    Raises
    ------
    ValueError
        If a cut-off does not lie between 0 and fs/2, the band's edges do not rise, the order is below 1 or no
        integer, or `fs` is not finite.
    """
    if not (isinstance(order, (int, np.integer)) and order >= 1):
        raise ValueError(f"order is {order!r}; the rule is an integer of at least 1")
    edges = np.atleast_1d(np.asarray(cutoff_hz, dtype=np.float64))
    _check_cutoffs(edges, fs, n_edges=2 if kind == "bandpass" else 1)
    band = edges if kind == "bandpass" else edges[0]
    return np.asarray(signal.butter(order, band, btype=kind, fs=fs, output="sos"))


def zero_phase(sos: Samples, x: ArrayLike) -> Samples:
    """Filter forwards and backwards along the first axis: the gain is applied twice, nothing is delayed.

    Parameters
    ----------
    sos : ndarray of shape (n_sections, 6)
        From `butterworth`.
    x : array_like of shape (n_samples, ...)
        Of any length; at its ends it is continued by point reflection, as far as it is long enough.

    Returns
    -------
    ndarray of the shape of `x`

    Raises
    ------
    ValueError
        If there is no sample, or one is NaN or infinite: it would spread over the whole signal.
    """
    samples = _at_least_one(all_finite(np.asarray(x, dtype=np.float64), "zero_phase"), "zero_phase")
    wished = 3 * (2 * len(sos) + 1)
    return np.asarray(signal.sosfiltfilt(sos, samples, axis=0, padlen=min(wished, len(samples) - 1)))


def causal(sos: Samples, x: ArrayLike, state: Samples | None = None) -> tuple[Samples, Samples | None]:
    """Filter forwards only, piece by piece: pieces give what the whole signal would.

    Parameters
    ----------
    sos : ndarray of shape (n_sections, 6)
        From `butterworth`.
    x : array_like of shape (n_samples, ...)
        The next piece; it may be empty.
    state : ndarray of shape (n_sections, 2, ...), optional
        What the previous call returned. Without it the filter is at rest on the value of the first sample, so
        a constant offset causes no transient.

    Returns
    -------
    filtered : ndarray of the shape of `x`
    state : ndarray of shape (n_sections, 2, ...), or None
        For the next piece; None as long as all pieces were empty.

    Raises
    ------
    ValueError
        If a sample is NaN or infinite: it would stay in the state for ever.
    """
    samples = all_finite(np.asarray(x, dtype=np.float64), "causal")
    if len(samples) == 0:
        return samples.copy(), state
    if state is None:
        unit = signal.sosfilt_zi(sos).reshape(len(sos), 2, *(1,) * (samples.ndim - 1))
        state = unit * samples[0]
    filtered, state = signal.sosfilt(sos, samples, axis=0, zi=state)
    return np.asarray(filtered), np.asarray(state)


def lowpass(x: ArrayLike, cutoff_hz: float, fs: float, *, order: int = 4) -> Samples:
    """Return `x` without what lies above `cutoff_hz` (Hz), undelayed; -6 dB at the cut-off.

    See `butterworth` for the parameters and errors, `zero_phase` for the ends.
    """
    return zero_phase(butterworth("lowpass", cutoff_hz, fs, order=order), x)


def highpass(x: ArrayLike, cutoff_hz: float, fs: float, *, order: int = 4) -> Samples:
    """Return `x` without what lies below `cutoff_hz` (Hz), undelayed; -6 dB at the cut-off.

    See `butterworth` for the parameters and errors, `zero_phase` for the ends.
    """
    return zero_phase(butterworth("highpass", cutoff_hz, fs, order=order), x)


def bandpass(x: ArrayLike, band_hz: tuple[float, float], fs: float, *, order: int = 4) -> Samples:
    """Return what of `x` lies between the two frequencies (Hz), undelayed; -6 dB at both.

    See `butterworth` for the parameters and errors, `zero_phase` for the ends.
    """
    return zero_phase(butterworth("bandpass", band_hz, fs, order=order), x)


def highpass_fir(x: ArrayLike, cutoff_hz: float, fs: float, *, transition_hz: float | None = None) -> Samples:
    """Return `x` after a linear-phase FIR high-pass, its constant delay compensated.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Continued by point reflection at its ends, as far as it is long enough, then by its last value.
    cutoff_hz : float
        Frequency of half the amplitude, in Hz.
    fs : float
        Sampling rate in Hz.
    transition_hz : float, optional
        Width of the transition of the Hamming-windowed filter, in Hz; `cutoff_hz` by default. The stop band
        lies at -53 dB, the filter has 3.3 fs / transition_hz coefficients.

    Returns
    -------
    ndarray of shape (n_samples,)

    Raises
    ------
    ValueError
        If the cut-off does not lie between 0 and fs/2, the transition is not positive, or the signal is not
        one-dimensional, empty, or holds NaN or infinity.

    Examples
    --------
    >>> import numpy as np
    >>> bool(np.abs(highpass_fir(np.full(2000, 9.81), 100.0, 10_000.0)).max() < 1e-12)
    True
    """
    samples = _at_least_one(all_finite(np.asarray(x, dtype=np.float64), "highpass_fir"), "highpass_fir")
    if samples.ndim != 1:
        raise ValueError(f"highpass_fir got shape {samples.shape}; the rule is (n_samples,)")
    _check_cutoffs(np.array([cutoff_hz]), fs, n_edges=1)
    width = cutoff_hz if transition_hz is None else transition_hz
    if not width > 0:
        raise ValueError(f"transition_hz is {width}; the rule is a width above 0 Hz")
    half = int(np.ceil(3.3 * fs / width / 2))
    smooth = signal.firwin(2 * half + 1, cutoff_hz, fs=fs, window="hamming")  # sums to 1
    return np.asarray(samples - signal.oaconvolve(_continued(samples, half), smooth, mode="valid"))


def _check_cutoffs(edges: Samples, fs: float, n_edges: int) -> None:
    shown = " ... ".join(f"{edge:g}" for edge in edges)
    if edges.size != n_edges:
        raise ValueError(f"cut-off is {shown} Hz; the rule is {n_edges} frequency value(s) for this filter")
    if not fs < np.inf:
        raise ValueError(f"fs is {fs} Hz; the rule is a sampling rate in Hz above 0")
    if not (np.all(edges > 0) and np.all(edges < fs / 2) and np.all(np.diff(edges) > 0)):
        raise ValueError(
            f"cut-off is {shown} Hz at fs = {fs:g} Hz; "
            f"the rule is 0 < cut-off < fs/2 = {fs / 2:g} Hz, the edges of a band rising"
        )


def _at_least_one(x: Samples, who: str) -> Samples:
    if x.ndim == 0 or len(x) == 0:
        raise ValueError(f"{who} got shape {x.shape}; the rule is at least one sample")
    return x


def _continued(x: Samples, half: int) -> Samples:
    """Continue `x` by `half` samples at both ends: reflected in its end points, then constant."""
    mirrored = min(half, x.size - 1)
    reflected = np.pad(x, mirrored, mode="reflect", reflect_type="odd") if mirrored else x
    return np.pad(reflected, half - mirrored, mode="edge")
