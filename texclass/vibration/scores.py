"""Scores that compare a synthesized with a recorded vibration: three published scores, and two in dB."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft, signal

from texclass.recording import Samples
from texclass.signals import one_channel, to_unit_scale

N_DFT = 2800
"""Number N of points of the DFT (even), from `oeztuerk2018`, section 3.1."""
POWER_FLOOR = 1e-12
"""Lower limit of powers relative to the largest power of the recording: -120 dB."""
BAND_EDGES_HZ: Samples = np.geomspace(20.0, 1000.0, 10)
"""Edges in Hz of nine bands of the ratio 1.54 over perceptible vibration; see `band_energy_distance`."""
BAND_EDGES_HZ.flags.writeable = False


def rms_spectral_error(recorded: ArrayLike, synthesized: ArrayLike) -> float:
    """Return the RMS difference of the magnitude spectra, divided by the RMS of the recorded spectrum.

    C = RMS(|DFT{a}| - |DFT{a_g}|) / RMS(|DFT{a}|), with transforms of `N_DFT` points. Longer signals are
    truncated, and shorter ones padded with zeros.

    Parameters
    ----------
    recorded, synthesized : array_like of shape (n_samples,)
        Signals in the same unit and at the same sampling rate. Lengths may differ.

    Returns
    -------
    float
        Error: 0 for equal magnitudes, 1 for a silent synthesis.

    Raises
    ------
    ValueError
        If the recorded signal is silent, or a signal is empty or contains NaN or infinity.

    Notes
    -----
    The printed formula is the difference of the complex transforms. If phases were included, a synthesis from
    different noise would score sqrt(2) at any order, although the thesis regards it as close. Therefore only
    magnitudes are compared. Two independent realisations of one Gaussian process differ by sqrt(2 - pi/2) =
    0.655. No model of the spectrum scores below this value on average. A lower score means that the model
    reproduces details of one recording.

    References
    ----------
    `oeztuerk2018`, eqs. (3.11) and (3.12).

    Examples
    --------
    >>> x = np.sin(0.2 * np.arange(2800))
    >>> round(rms_spectral_error(x, 1.5 * x), 6)
    0.5
    """
    a, a_g = _scale_pair(recorded, synthesized)
    A, A_g = (np.abs(fft.rfft(x, N_DFT)) for x in (a, a_g))
    _not_silent(float(A.max()), f"in its first {N_DFT} samples")
    return float(relative_error(A, A_g))


def goodness_of_fit(
    recorded: ArrayLike, synthesized: ArrayLike, *, window: int = 500, n_hamming: int = 50
) -> float:
    """Return the goodness-of-fit criterion (GFC) of the amplitude spectra, averaged over windows.

    In each window, GFC = sum_i A_d A_m / sqrt(sum_j A_d^2 sum_k A_m^2), where the amplitudes A are the square
    roots of Welch's power spectral density (Hamming segments of 50 points, half overlapping). Windows overlap
    by half; an incomplete last window is ignored.

    Parameters
    ----------
    recorded, synthesized : array_like of shape (n_samples,)
        Signals of the same sampling rate and length. Multiplying a signal by a positive factor does not
        change the result.
    window : int
        Samples per window (default 500).
    n_hamming : int
        Points of the Hamming segments, at most `window` (default 50).

    Returns
    -------
    float
        Score between 0 and 1; the paper calls a score above 0.9 a good match. A window scores 1 if both
        signals are silent, and 0 if only one of them is.

    Raises
    ------
    ValueError
        If the lengths differ, a signal is shorter than one window or contains NaN or infinity, or `n_hamming`
        does not lie between 2 and `window`.

    References
    ----------
    `abdulali2016`, eq. (6) and section 4.1.

    Examples
    --------
    >>> slow, fast = (np.sin(w * np.arange(1000)) for w in (0.2, 0.9))
    >>> round(goodness_of_fit(slow, 3 * slow), 6), bool(goodness_of_fit(slow, fast) < 0.2)
    (1.0, True)
    """
    a_d, _ = to_unit_scale(one_channel(recorded, "recorded", at_least=window))
    a_m, _ = to_unit_scale(one_channel(synthesized, "synthesized", at_least=window))
    _same_length(a_d, a_m)
    if not 2 <= n_hamming <= window:
        raise ValueError(f"n_hamming must lie between 2 and window = {window}, got {n_hamming}")
    fits = []
    for i in range(0, a_d.size - window + 1, max(window // 2, 1)):
        units = (to_unit_scale(a[i : i + window])[0] for a in (a_d, a_m))
        spectra = (signal.welch(x, window="hamming", nperseg=n_hamming, detrend=False)[1] for x in units)
        A_d, A_m = (np.sqrt(power) for power in spectra)
        size = np.sqrt(A_d @ A_d) * np.sqrt(A_m @ A_m)
        fits.append(min(float(A_d @ A_m / size), 1.0) if size > 0 else np.any(A_d) == np.any(A_m))
    return float(np.mean(fits))


def mean_absolute_difference(recorded: ArrayLike, synthesized: ArrayLike) -> float:
    """Return the mean absolute difference of two signals, in their unit.

    Parameters
    ----------
    recorded, synthesized : array_like of shape (n_samples,)
        Signals of the same length and unit.

    Returns
    -------
    float
        Mean absolute difference.

    Raises
    ------
    ValueError
        If the lengths differ, there is no sample, or a sample is NaN or infinite.

    References
    ----------
    `guruswamy2011`, section IV-A and Table I (SAD).

    Examples
    --------
    >>> mean_absolute_difference([1.0, -1.0], [1.5, 0.0])
    0.75
    """
    a, a_g = one_channel(recorded, "recorded"), one_channel(synthesized, "synthesized")
    _same_length(a, a_g)
    return float(np.mean(np.abs(a - a_g)))


def log_spectral_distance(
    recorded: ArrayLike, synthesized: ArrayLike, *, n_segment: int | None = None
) -> float:
    """Return the RMS difference of two power spectra in dB, with equal weights of all frequencies.

    D = sqrt(mean_f (10 log10 P(f) - 10 log10 P_g(f))^2), with Welch's estimate of P (Hann, half overlap).
    Powers are raised to at least `POWER_FLOOR` times the largest power of the recording.

    Parameters
    ----------
    recorded, synthesized : array_like of shape (n_samples,)
        Signals in the same unit and at the same sampling rate. Lengths may differ.
    n_segment : int, optional
        Samples per segment (default 256, or the length of the shorter signal).

    Returns
    -------
    float
        Distance in dB. If the signals differ only by a factor of 2, it is 6.02 dB.

    Raises
    ------
    ValueError
        If the recording is silent or non-zero only where the windows are 0, or if a signal has fewer than
        `n_segment` or fewer than 4 samples, or contains NaN or infinity.

    References
    ----------
    Gray, Markel, "Distance measures for speech processing", 1976.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal(1000)
    >>> round(log_spectral_distance(x, 2 * x), 2)
    6.02
    """
    a, a_g = _scale_pair(recorded, synthesized)
    n = min(256, a.size, a_g.size) if n_segment is None else n_segment
    if not 4 <= n <= min(a.size, a_g.size):
        raise ValueError(
            f"n_segment must lie between 4 and the length of the shorter signal, got {n} for {a.size} and "
            f"{a_g.size} samples"
        )
    P, P_g = (signal.welch(s, window="hann", nperseg=n, detrend=False)[1] for s in (a, a_g))
    if not P.any():
        raise ValueError(
            "recorded must not be zero inside all segments, but it has power only where the Hann windows are "
            "0. Pass a longer recording"
        )
    return float(root_mean_square(_decibel_difference(P, P_g, float(P.max()))))


def band_energy_distance(recorded: ArrayLike, synthesized: ArrayLike, fs: float) -> float:
    """Return the RMS difference in dB of the energies in nine bands of perceptible vibration.

    The band edges are 20, 31, 48, 74, 114, 176, 271, 419, 647 and 1000 Hz (`BAND_EDGES_HZ`), and all bands
    have equal weights. The bands are our choice. According to `okamura2001`, humans perceive vibration from 0
    Hz to over 1 kHz, and are most sensitive near 250 Hz. Below about 20 Hz they perceive single strokes and
    hand motion rather than vibration. The edges have a constant ratio, because the frequency resolution of
    touch is roughly proportional to frequency.

    Parameters
    ----------
    recorded, synthesized : array_like of shape (n_samples,)
        Signals in the same unit and at the same sampling rate. Lengths may differ. The means are removed, and
        a Hann window is applied.
    fs : float
        Sampling rate in Hz. Bands that end above fs/2 are ignored.

    Returns
    -------
    float
        RMS difference of the mean powers in dB. Powers are raised to at least `POWER_FLOOR` times the total
        power of the recording.

    Raises
    ------
    ValueError
        If the recording is silent or constant, a signal has fewer than 4 samples or contains NaN or infinity,
        or fs/2 lies below the end of the first band.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> round(band_energy_distance(x, 2 * x, fs=10_000.0), 2)
    6.02
    """
    a, a_g = _scale_pair(recorded, synthesized, at_least=4)
    edges = BAND_EDGES_HZ[fs / 2 >= BAND_EDGES_HZ]
    if edges.size < 2:
        raise ValueError(f"fs must be at least {2 * BAND_EDGES_HZ[1]:.1f} Hz for one band, got {fs} Hz")
    E, total = _band_powers(a, fs, edges)
    _not_silent(total if total > POWER_FLOOR**2 else 0.0, "apart from its mean")
    E_g, _ = _band_powers(a_g, fs, edges)
    return float(root_mean_square(_decibel_difference(E, E_g, total)))


def _scale_pair(recorded: ArrayLike, synthesized: ArrayLike, at_least: int = 1) -> tuple[Samples, Samples]:
    """Scale both signals by one power of two, so that the largest recorded sample is about 1."""
    a, exponent = to_unit_scale(one_channel(recorded, "recorded", at_least=at_least))
    _not_silent(float(np.max(np.abs(a))), "anywhere")
    with np.errstate(under="ignore", over="ignore"):
        a_g = np.ldexp(one_channel(synthesized, "synthesized", at_least=at_least), -exponent)
    return a, np.clip(a_g, -1e150, 1e150)


def _same_length(a: Samples, b: Samples) -> None:
    if a.size != b.size:
        raise ValueError(
            f"recorded and synthesized must have the same length, got {a.size} and {b.size} samples"
        )


def _not_silent(level: float, where: str) -> None:
    if level == 0:
        raise ValueError(f"recorded must contain a signal to compare with, but it is 0 {where}")


def _decibel_difference(P: Samples, P_g: Samples, reference: float) -> Samples:
    floor = POWER_FLOOR * reference
    return np.asarray(10 * (np.log10(np.maximum(P, floor)) - np.log10(np.maximum(P_g, floor))))


def _band_powers(x: Samples, fs: float, edges: Samples) -> tuple[Samples, float]:
    """Return the mean power in each band, and the total power, with a constant density in each bin."""
    f, power = signal.periodogram(x, fs, window="hann", scaling="density", detrend="constant")
    width = fs / x.size
    cumulative = np.concatenate([[0.0], np.cumsum(power * width)])
    bounds = np.concatenate([[0.0], f + width / 2])
    return np.diff(np.interp(edges, bounds, cumulative)), float(cumulative[-1])


def relative_error(A: Samples, A_g: Samples) -> Samples:
    """Return C = RMS(A_g - A) / RMS(A), with the RMS over all N = `N_DFT` bins.

    All bins of `rfft` except the first and the last count twice, because the upper half of the DFT mirrors
    the lower half.

    Parameters
    ----------
    A : ndarray of shape (N // 2 + 1,)
        Magnitudes of the recorded signal at the bins of `rfft`, not all 0.
    A_g : ndarray of shape (..., N // 2 + 1)
        Magnitudes of the synthesized signals.

    Returns
    -------
    ndarray of shape (...)
        Relative error.
    """
    twice = np.full(N_DFT // 2 + 1, 2.0)
    twice[[0, -1]] = 1.0
    return np.asarray(root_mean_square(A_g - A, twice) / root_mean_square(A, twice))


def root_mean_square(x: Samples, weight: ArrayLike = 1.0) -> Samples:
    """Return sqrt(sum w x^2 / sum w) over the last axis, without under- or overflow of the squares."""
    largest = np.max(np.abs(x), axis=-1, initial=0.0)
    unit = x / np.where(largest > 0, largest, 1.0)[..., np.newaxis]
    w = np.broadcast_to(np.asarray(weight, dtype=np.float64), x.shape[-1:])
    return np.asarray(largest * np.sqrt(unit**2 @ w / w.sum()))
