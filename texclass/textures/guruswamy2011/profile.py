"""The acceleration profile of a scan within the band that holds it, cut into segments."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from texclass import signals
from texclass.recording import Samples
from texclass.textures.guruswamy2011.level import LOWER_HZ
from texclass.vibration.rising_peaks import Segmentation, VibrationBand, segment_rising_peaks, vibration_band

RESOLUTION = 0.153
"""One bit of the paper's sensor, m/s^2 (2 g / 128)."""
DEAD_BAND_BITS = 2.0
SMOOTHING_HZ = 3.0
"""Standard deviation of the Gaussian that low-passes the spectrum. The paper names none; ours."""
HIGHEST = 0.9
"""An upper cut-off above that part of fs/2 would only turn the phase of what it keeps: none is applied."""

Phase = Literal["causal", "zero"]


@dataclass(frozen=True, eq=False)
class Profile:
    """A vibration within its band.

    Attributes
    ----------
    samples : ndarray of shape (n_samples,)
        Unit of the acceleration.
    band : VibrationBand
        Major frequency and automatic cut-off, Hz.
    cutoff_hz : float
        Upper cut-off that was used: that of the band, or fs/2 where that lies above `HIGHEST` fs/2.
    segmentation : Segmentation
    """

    samples: Samples
    band: VibrationBand
    cutoff_hz: float
    segmentation: Segmentation


def band_of(acceleration: ArrayLike, fs: float, *, smoothing_hz: float = SMOOTHING_HZ) -> VibrationBand:
    """Return major frequency and automatic upper cut-off of a vibration.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,)
        Any unit; a linear trend is left out.
    fs : float
        Hz.
    smoothing_hz : float
        Standard deviation of the low-pass of the spectrum, Hz.

    References
    ----------
    `guruswamy2011`, eq. (6) and (7), between 0.122 Hz and fs/2.
    """
    a = np.asarray(acceleration, dtype=np.float64)
    n_fft = max(a.size, int(2 ** np.ceil(np.log2(fs / LOWER_HZ))))
    f, power = signal.periodogram(signal.detrend(a), fs, nfft=n_fft, detrend=False)
    return vibration_band(f[f >= LOWER_HZ], power[f >= LOWER_HZ], smoothing_hz=smoothing_hz)


def profile_of(
    acceleration: ArrayLike,
    fs: float,
    *,
    resolution: float = RESOLUTION,
    phase: Phase = "causal",
    smoothing_hz: float = SMOOTHING_HZ,
) -> Profile:
    """Band-pass an acceleration by a 4th-order Butterworth filter and cut it where peaks rise.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,)
        Normalised to one speed and force. Not silent.
    fs : float
        Hz.
    resolution : float
        Of the sensor, in the unit of the acceleration; the dead band is twice that.
    phase : {"causal", "zero"}
        "causal": forwards once, then moved back by the delay at the major frequency (whole samples). "zero":
        forwards and backwards. See the notes.
    smoothing_hz : float
        See `band_of`.

    Returns
    -------
    Profile

    Raises
    ------
    ValueError
        For silence, NaN or infinity, or fewer than 8 samples.

    Notes
    -----
    The paper does not say which. A filter that runs backwards, too, rings *before* each onset: the peaks then
    rise in steps, and the rule of rising peaks cuts the onset into several segments (a quarter to a half more
    of them on the simulated regular surfaces). Forwards only, what decayed still decays, and the edges are at
    -3 dB as designed instead of -6 dB; the delay of some samples is known and taken back.

    References
    ----------
    `guruswamy2011`, sections IV-B, IV-C and V-A.
    """
    a = np.asarray(acceleration, dtype=np.float64)
    if a.ndim != 1 or a.size < 8 or not np.all(np.isfinite(a)) or np.ptp(a) == 0:
        raise ValueError(
            f"acceleration of shape {a.shape}: the rule is 8 samples or more of one channel, "
            "finite, not constant"
        )
    band = band_of(a, fs, smoothing_hz=smoothing_hz)
    is_wide = band.upper_hz > HIGHEST * fs / 2
    cutoff = fs / 2 if is_wide else band.upper_hz
    sos = (
        signals.butterworth("highpass", LOWER_HZ, fs)
        if is_wide
        else signals.butterworth("bandpass", (LOWER_HZ, cutoff), fs)
    )
    a = a - np.mean(a)
    if phase == "zero":
        samples = signals.zero_phase(sos, a)
    else:
        delay = min(_delay(sos, band.major_hz, fs), a.size - 1)
        samples = signals.causal(sos, np.pad(a, (0, delay), mode="edge"))[0][delay:]
    return Profile(samples, band, cutoff, segment_rising_peaks(samples, DEAD_BAND_BITS * resolution))


def _delay(sos: Samples, frequency_hz: float, fs: float) -> int:
    """Return the group delay -d phi / d omega at a frequency, in whole samples, not negative."""
    around = np.clip([frequency_hz - 0.5, frequency_hz + 0.5], LOWER_HZ, 0.499 * fs)
    _, H = signal.freqz_sos(sos, around, fs=fs)
    turned = np.angle(H[0] * np.conj(H[1]))
    return max(round(float(turned / (2 * np.pi * (around[1] - around[0])) * fs)), 0)
