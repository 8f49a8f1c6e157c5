"""Distance in dB of two vibrations as the hand perceives them, from levels above the detection threshold."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from texclass.recording import Samples
from texclass.signals import all_finite, one_channel, positive
from texclass.vibration.scores import root_mean_square

BAND_CENTRES_HZ: Samples = 10 ** (np.arange(13, 31) / 10)
"""Centres in Hz of 18 one-third-octave bands, 20 to 1000 Hz (base-ten series of IEC 61260-1)."""
BAND_CENTRES_HZ.flags.writeable = False
HALF_BAND = 10**0.05
"""Ratio of the upper edge of a band to its centre."""
REFERENCE_UM = 0.1
"""Default threshold at 250 Hz, peak displacement in µm; see `detection_threshold`."""
SEGMENT_S = 0.125
"""Length in s of the segments of the power spectrum. Bands below 60 Hz are narrower than its resolution of
12 Hz. Of 0.064, 0.125, 0.25 and 0.5 s, it separates the surfaces of `biotac20` best."""


def detection_threshold(frequency_hz: ArrayLike, *, reference_um: float = REFERENCE_UM) -> Samples:
    """Return the smallest acceleration of a sinusoid that the hand detects, in m/s^2 (RMS).

    The threshold of displacement rises from its minimum at 250 Hz by
    50 dB (log(f + 300 Hz over 550 Hz) / log(300 / 550))^2. The acceleration is (2 pi f)^2 times the
    displacement.

    Parameters
    ----------
    frequency_hz : array_like
        Frequencies in Hz, positive.
    reference_um : float
        Peak displacement in µm at the threshold at 250 Hz (default 0.1).

    Returns
    -------
    ndarray
        Threshold in m/s^2 (RMS), in the shape of `frequency_hz`.

    Raises
    ------
    ValueError
        If a frequency or `reference_um` is not positive and finite.

    Notes
    -----
    The shape is the threshold of the psychohaptic model of the MPEG reference software. The model does not
    state the quantity. We read it as displacement: from 40 to 250 Hz it falls by 31.5 dB, and Verrillo (1963)
    measured 12 dB per octave (31.7 dB) for displacement. Above 40 Hz, the acceleration then has its minimum
    near 160 Hz. Griffin (2012) states the greatest sensitivity to acceleration around 125 Hz for a hand that
    grips.

    The absolute level depends on the contact by tens of dB: at 300 Hz, the threshold of a hand that grasps a
    cylinder is 18.5 dB lower than that of a 1 mm probe, and it is below 0.01 µm for some subjects (Brisben et
    al., 1999). The default, 0.1 µm, is our choice.

    References
    ----------
    - ISO/IEC 23090-31, reference software, psychohaptic model; Noll et al., "VC-PWQ: vibrotactile signal
      compression based on perceptual wavelet quantization", World Haptics 2021.
    - Verrillo, "Effect of contactor area on the vibrotactile threshold", J. Acoust. Soc. Am. 35, 1963.
    - Griffin, "Frequency-dependence of psychophysical and physiological responses to hand-transmitted
      vibration", Industrial Health 50, 2012.
    - Brisben, Hsiao, Johnson, "Detection of vibration transmitted through an object grasped in the hand",
      J. Neurophysiol. 81, 1999.

    Examples
    --------
    >>> detection_threshold([40.0, 125.0, 250.0, 500.0]).round(2)
    array([0.17, 0.12, 0.17, 6.3 ])
    """
    f = all_finite(frequency_hz, "frequency_hz")
    if not np.all(f > 0):
        raise ValueError(f"frequency_hz must be positive, got {f.min()} Hz")
    rise_db = 50 * (np.log((f + 300) / 550) / np.log(300 / 550)) ** 2
    displacement = 1e-6 * positive(reference_um, "reference_um") / np.sqrt(2) * 10 ** (rise_db / 20)
    return np.asarray((2 * np.pi * f) ** 2 * displacement)


def band_powers(x: ArrayLike, fs: float) -> Samples:
    """Return the mean power of a signal in each one-third-octave band that ends below fs/2.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Signal.
    fs : float
        Sampling rate in Hz.

    Returns
    -------
    ndarray of shape (n_bands,)
        Mean power in the squared unit of `x`, in the bands of `BAND_CENTRES_HZ`. Welch's method:
        Hann segments of 0.125 s or the whole signal, if it is shorter, half overlapping, without their means.

    Raises
    ------
    ValueError
        If the signal has fewer than 4 samples or contains NaN or infinity, or fs/2 lies below the end of the
        first band.

    Examples
    --------
    >>> tone = np.sqrt(2) * np.sin(2 * np.pi * 100 * np.arange(2000) / 2000)
    >>> powers = band_powers(tone, fs=2000.0)
    >>> powers.size, float(BAND_CENTRES_HZ[powers.argmax()]), float(powers.sum().round(3))
    (17, 100.0, 1.0)
    """
    samples = one_channel(x, "x", at_least=4)
    edges = np.append(BAND_CENTRES_HZ / HALF_BAND, BAND_CENTRES_HZ[-1] * HALF_BAND)
    edges = edges[edges <= fs / 2]
    if edges.size < 2:
        raise ValueError(
            f"fs must be at least {2 * HALF_BAND * BAND_CENTRES_HZ[0]:.1f} Hz for one band, got {fs} Hz"
        )
    n = min(samples.size, round(SEGMENT_S * fs))
    f, density = signal.welch(samples, fs, window="hann", nperseg=n, detrend="constant")
    width = fs / n
    cumulative = np.concatenate([[0.0], np.cumsum(density * width)])
    return np.diff(np.interp(edges, np.concatenate([[0.0], f + width / 2]), cumulative))


def perceptual_distance(
    recorded: ArrayLike, synthesized: ArrayLike, fs: float, *, strongest_db: float | None = None,
    equal_level: bool = False, reference_um: float = REFERENCE_UM,
) -> float:  # fmt: skip
    """Return the RMS difference in dB of two vibrations over the bands that the hand can feel.

    In each one-third-octave band, the sensation level is L = max(10 log10(P / T^2), 0), with the mean power P
    and the threshold T at the centre of the band (`detection_threshold`). The distance is
    D = sqrt(mean_b (L_b - L'_b)^2), over the bands in which at least one signal exceeds the threshold.

    Parameters
    ----------
    recorded, synthesized : array_like of shape (n_samples,)
        Accelerations in m/s^2, at the same sampling rate. Lengths may differ.
    fs : float
        Sampling rate in Hz. Bands that end above fs/2 are ignored.
    strongest_db : float, optional
        For recordings in an arbitrary unit: sensation level in dB that the strongest band of the recording is
        assumed to have, for instance 30. Both signals are scaled by the same factor. By default, the unit is
        m/s^2.
    equal_level : bool
        Whether the synthesized signal is scaled to the level of the recording in all bands first, so that a
        gain does not count (default False).
    reference_um : float
        Threshold at 250 Hz in µm (default 0.1).

    Returns
    -------
    float
        Distance in dB. Equal spectra give 0, a gain of 2 gives 6.02 dB if all bands that are felt stay above
        the threshold, and differences below the threshold do not count. The smallest difference in level that
        subjects perceive is 20 to 58 % (1.6 to 4.0 dB).

    Raises
    ------
    ValueError
        If the recording lies below the threshold in all bands, a signal has fewer than 4 samples or contains
        NaN or infinity, or `fs` is too low for one band.

    Notes
    -----
    In the goodness-of-fit criterion only the strongest bands count; here, all bands that are felt do. Touch
    resolves frequencies coarsely: masking separates only its channels (Labs et al., 1978), so no detail
    within a third of an octave is expected to matter.

    References
    ----------
    - Bensmaia, Hollins, "The vibrations of texture", Somatosens. Mot. Res. 20, 2003 (power weighted by
      the sensitivity of the Pacinian channel).
    - Labs, Gescheider, Fay, Lyons, "Psychophysical tuning curves in vibrotaction", Sens. Processes 2, 1978.
    - Forta, Griffin, Morioka, "Vibrotactile difference thresholds", Somatosens. Mot. Res. 29, 2012.

    Examples
    --------
    >>> x = 3 * np.random.default_rng(0).standard_normal(4000)
    >>> round(perceptual_distance(x, 2 * x, fs=1000.0), 2)
    6.02
    >>> perceptual_distance(x, 2 * x, fs=1000.0, equal_level=True)
    0.0
    """
    P, P_s = band_powers(recorded, fs), band_powers(synthesized, fs)
    if not P.any():
        raise ValueError(
            "recorded must not be silent in all bands from 20 to 1000 Hz. Pass another recording"
        )
    if equal_level and P_s.any():
        P_s = P_s * (P.sum() / P_s.sum())
    threshold = detection_threshold(BAND_CENTRES_HZ[: P.size], reference_um=reference_um) ** 2
    if strongest_db is not None:
        threshold *= np.max(P / threshold) / 10 ** (positive(strongest_db, "strongest_db") / 10)
    elif np.all(threshold >= P):
        raise ValueError(
            "recorded must exceed the detection threshold in a band, but its RMS from 20 to 1000 Hz is "
            f"{np.sqrt(P.sum()):.2g} m/s^2. Pass strongest_db if its unit is not m/s^2"
        )
    L, L_s = (10 * np.log10(np.maximum(p / threshold, 1.0)) for p in (P, P_s))
    is_felt = (L > 0) | (L_s > 0)
    return float(root_mean_square((L - L_s)[is_felt]))
