"""How close a synthesized vibration comes to the recorded one: scores of the papers, and two in dB."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft, signal

from texclass.recording import Samples
from texclass.signals import one_channel, to_unit_scale

N_DFT = 2800
"""N, points of the DFT in `oeztuerk2018`, section 3.1; even."""
FLOOR = 1e-12
"""Power below this part of the largest power of the recording counts as this part (-120 dB)."""
BAND_EDGES_HZ: Samples = np.geomspace(20.0, 1000.0, 10)
"""Nine bands of one ratio, 1.54, over what fingers feel as vibration; see `band_energy_distance`."""
BAND_EDGES_HZ.flags.writeable = False


def rms_spectral_error(recorded: ArrayLike, synthesized: ArrayLike) -> float:
    """Return the RMS difference of the magnitude spectra over the RMS of the recorded one.

    C = RMS(|DFT{a}| - |DFT{a_g}|) / RMS(|DFT{a}|), with transforms of `N_DFT` points: longer signals are cut,
    shorter ones padded with zeros.

    Parameters
    ----------
    recorded, synthesized : array_like of shape (n_samples,)
        Of one unit and rate; lengths may differ.

    Returns
    -------
    float
        0 for equal magnitudes, 1 for silence.

    Raises
    ------
    ValueError
        If the recorded part is silent, a signal is empty, or holds NaN or infinity.

    Notes
    -----
    Printed as a difference of transforms. Read with phases, a synthesis from another noise, which the thesis
    calls close, would score sqrt(2) at any order; hence magnitudes. Two independent realisations of one
    Gaussian process then differ by sqrt(2 - pi/2) = 0.655: no model of the spectrum gets below that on
    average, and a lower figure means that detail of one recording was learnt.

    References
    ----------
    `oeztuerk2018`, eqs. (3.11) and (3.12).
    """
    a, a_g = _in_one_scale(recorded, synthesized)
    A, A_g = (np.abs(fft.rfft(x, N_DFT)) for x in (a, a_g))
    _not_silent(float(A.max()), f"in its first {N_DFT} samples")
    return float(relative_error(A, A_g))


def goodness_of_fit(
    recorded: ArrayLike, synthesized: ArrayLike, *, window: int = 500, n_hamming: int = 50
) -> float:
    """Return the goodness-of-fit criterion (GFC) of the spectra, averaged over windows.

    In each window, GFC = sum_i A_d A_m / sqrt(sum_j A_d^2 sum_k A_m^2), where the amplitudes A are the square
    roots of Welch's power spectral density (Hamming segments of 50 points, half overlapping). Windows overlap
    by half; an incomplete last one is left out.

    Parameters
    ----------
    recorded, synthesized : array_like of shape (n_samples,)
        Of one rate and length. A gain of either does not change the result.
    window : int
        Samples per window.
    n_hamming : int
        Points of the Hamming segments, at most `window`.

    Returns
    -------
    float
        Between 0 and 1. Above 0.9 is called a good match. A window that is silent in both signals counts 1,
        one that is silent in one of them 0.

    Raises
    ------
    ValueError
        For different lengths, fewer samples than one window, NaN or infinity, or windows that do not fit.

    References
    ----------
    `abdulali2016`, eq. (6) and section 4.1.
    """
    a_d, _ = to_unit_scale(one_channel(recorded, "recorded", at_least=window))
    a_m, _ = to_unit_scale(one_channel(synthesized, "synthesized", at_least=window))
    _same_length(a_d, a_m)
    if not 2 <= n_hamming <= window:
        raise ValueError(f"window, n_hamming are {window}, {n_hamming}. Expected 2 <= n_hamming <= window")
    fits = []
    for i in range(0, a_d.size - window + 1, max(window // 2, 1)):
        units = (to_unit_scale(a[i : i + window])[0] for a in (a_d, a_m))
        spectra = (signal.welch(x, window="hamming", nperseg=n_hamming, detrend=False)[1] for x in units)
        A_d, A_m = (np.sqrt(power) for power in spectra)
        size = np.sqrt(A_d @ A_d) * np.sqrt(A_m @ A_m)
        fits.append(min(float(A_d @ A_m / size), 1.0) if size > 0 else np.any(A_d) == np.any(A_m))
    return float(np.mean(fits))


def mean_absolute_difference(recorded: ArrayLike, synthesized: ArrayLike) -> float:
    """Return the sum of absolute differences over the number of samples, in the unit of the signals.

    Parameters
    ----------
    recorded, synthesized : array_like of shape (n_samples,)
        Of one length.

    Raises
    ------
    ValueError
        For different lengths, no sample, NaN or infinity.

    References
    ----------
    `guruswamy2011`, section IV-A and Table I (SAD).
    """
    a, a_g = one_channel(recorded, "recorded"), one_channel(synthesized, "synthesized")
    _same_length(a, a_g)
    return float(np.mean(np.abs(a - a_g)))


def log_spectral_distance(
    recorded: ArrayLike, synthesized: ArrayLike, *, n_segment: int | None = None
) -> float:
    """Return the RMS difference of two power spectra in dB, all frequencies alike.

    D = sqrt(mean_f (10 log10 P(f) - 10 log10 P_g(f))^2), with Welch's estimate of P (Hann, half overlap).
    Powers below `FLOOR` of the recording's largest count as that.

    Parameters
    ----------
    recorded, synthesized : array_like of shape (n_samples,)
        Of one unit and rate; lengths may differ.
    n_segment : int, optional
        Samples per segment; 256, or what the shorter signal has, by default.

    Returns
    -------
    float
        In dB: a gain of 2 alone is 6.02 dB.

    Raises
    ------
    ValueError
        If the recording is silent (or not, but only where the windows are 0), a signal has fewer than
        `n_segment` (and than 4) samples, or holds NaN or infinity.

    References
    ----------
    Gray, Markel, "Distance measures for speech processing", 1976.
    """
    a, a_g = _in_one_scale(recorded, synthesized)
    n = min(256, a.size, a_g.size) if n_segment is None else n_segment
    if not 4 <= n <= min(a.size, a_g.size):
        raise ValueError(
            f"n_segment is {n} for {a.size} and {a_g.size} samples. Expected 4 to the shorter of them"
        )
    P, P_g = (signal.welch(s, window="hann", nperseg=n, detrend=False)[1] for s in (a, a_g))
    if not P.any():
        raise ValueError(
            "the recording has no power in any windowed segment. Expected a signal that is not zero "
            "inside one (Hann's window is 0 at its ends)"
        )
    return float(root_mean_square(_decibel_difference(P, P_g, float(P.max()))))


def band_energy_distance(recorded: ArrayLike, synthesized: ArrayLike, fs: float) -> float:
    """Return the RMS difference, in dB, of the energies in nine bands of what fingers feel.

    The bands lie between `BAND_EDGES_HZ`: 20, 31, 48, 74, 114, 176, 271, 419, 647, 1000 Hz. The choice is
    ours: `okamura2001` puts the sensitivity to vibration between dc and over 1 kHz with its peak near 250 Hz,
    below about 20 Hz single strokes and the hand's motion are felt rather than vibration, and one ratio per
    band stands for a resolution of frequency that is roughly proportional to frequency. Bands count alike.

    Parameters
    ----------
    recorded, synthesized : array_like of shape (n_samples,)
        Of one unit and rate; lengths may differ. Means are removed, and a Hann window applied.
    fs : float
        Sampling rate in Hz. Bands that end above fs/2 are left out.

    Returns
    -------
    float
        In dB of mean power. Powers below `FLOOR` of the recording's total count as that.

    Raises
    ------
    ValueError
        If the recording is silent or constant, a signal has fewer than 4 samples or holds NaN or infinity,
        or fs/2 lies below the end of the first band.
    """
    a, a_g = _in_one_scale(recorded, synthesized, at_least=4)
    edges = BAND_EDGES_HZ[fs / 2 >= BAND_EDGES_HZ]
    if edges.size < 2:
        raise ValueError(f"fs is {fs} Hz. Expected fs/2 >= {BAND_EDGES_HZ[1]:.1f} Hz, one band at least")
    E, total = _band_powers(a, fs, edges)
    _not_silent(total if total > FLOOR**2 else 0.0, "apart from its mean")
    E_g, _ = _band_powers(a_g, fs, edges)
    return float(root_mean_square(_decibel_difference(E, E_g, total)))


def _in_one_scale(recorded: ArrayLike, synthesized: ArrayLike, at_least: int = 1) -> tuple[Samples, Samples]:
    """Return both signals times one power of two, which brings the recorded one to about 1."""
    a, exponent = to_unit_scale(one_channel(recorded, "recorded", at_least=at_least))
    _not_silent(float(np.max(np.abs(a))), "anywhere")
    with np.errstate(under="ignore", over="ignore"):
        a_g = np.ldexp(one_channel(synthesized, "synthesized", at_least=at_least), -exponent)
    return a, np.clip(a_g, -1e150, 1e150)


def _same_length(a: Samples, b: Samples) -> None:
    if a.size != b.size:
        raise ValueError(f"signals have {a.size} and {b.size} samples. Expected one length for both")


def _not_silent(level: float, where: str) -> None:
    if level == 0:
        raise ValueError(f"the recorded signal is 0 {where}. Expected a level to compare with")


def _decibel_difference(P: Samples, P_g: Samples, reference: float) -> Samples:
    least = FLOOR * reference
    return np.asarray(10 * (np.log10(np.maximum(P, least)) - np.log10(np.maximum(P_g, least))))


def _band_powers(x: Samples, fs: float, edges: Samples) -> tuple[Samples, float]:
    """Return the mean power in each band and in all, the power of a bin spread evenly over its width."""
    f, power = signal.periodogram(x, fs, window="hann", scaling="density", detrend="constant")
    width = fs / x.size
    cumulative = np.concatenate([[0.0], np.cumsum(power * width)])
    bounds = np.concatenate([[0.0], f + width / 2])
    return np.diff(np.interp(edges, bounds, cumulative)), float(cumulative[-1])


def relative_error(A: Samples, A_g: Samples) -> Samples:
    """Return C = RMS(A_g - A) / RMS(A), the RMS taken over all N = `N_DFT` bins.

    The upper half of the bins mirrors the lower one, the first and the middle one apart.

    Parameters
    ----------
    A : ndarray of shape (N // 2 + 1,)
        Magnitudes of the recorded signal at the bins of `rfft`, not all 0.
    A_g : ndarray of shape (..., N // 2 + 1)
        Those of the synthesized ones.

    Returns
    -------
    ndarray of shape (...)
    """
    twice = np.full(N_DFT // 2 + 1, 2.0)
    twice[[0, -1]] = 1.0
    return np.asarray(root_mean_square(A_g - A, twice) / root_mean_square(A, twice))


def root_mean_square(x: Samples, weight: ArrayLike = 1.0) -> Samples:
    """Return sqrt(sum w x^2 / sum w) over the last axis; no square of a float64 under- or overflows."""
    largest = np.max(np.abs(x), axis=-1, initial=0.0)
    unit = x / np.where(largest > 0, largest, 1.0)[..., np.newaxis]
    w = np.broadcast_to(np.asarray(weight, dtype=np.float64), x.shape[-1:])
    return np.asarray(largest * np.sqrt(unit**2 @ w / w.sum()))
