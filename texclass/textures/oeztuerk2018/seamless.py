"""A short signal made endless: reflected, repeated, scaled, and written as audio."""

from pathlib import Path
from typing import Literal, get_args

import numpy as np
import soundfile as sf
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.signals import one_channel, positive

DURATION_S = 10.0
N_COPIES = 5
SampleFormat = Literal["FLOAT", "PCM_16"]


def mirrored(x: ArrayLike) -> Samples:
    """Return the signal with its reflection behind it, shape (2 n_samples,): x_0 ... x_n-1 x_n-1 ... x_0.

    Wherever copies of it meet, one sample stands beside its equal: no join has a jump.
    """
    samples = one_channel(x, "signal")
    return np.concatenate([samples, samples[::-1]])


def seamless(
    x: ArrayLike, fs: float, *, duration_s: float = DURATION_S, peak: float | None = None
) -> Samples:
    """Return a signal of the duration: the mirrored one, as often as needed, scaled.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Any unit. Of 1 s, 5 mirrored copies make 10 s, as printed.
    fs : float
        Sampling rate, Hz.
    duration_s : float
        Of the result; the last copy is cut there.
    peak : float, optional
        Largest magnitude of the result: that of the reference it is compared with, as in the thesis.

    Returns
    -------
    ndarray of shape (round(duration_s * fs),)

    References
    ----------
    `oeztuerk2018`, end of section 3.2.

    Examples
    --------
    >>> seamless([1.0, 2.0, 4.0], 3.0, duration_s=3.0, peak=2.0)
    array([0.5, 1. , 2. , 2. , 1. , 0.5, 0.5, 1. , 2. ])
    """
    n = round(positive(duration_s, "duration_s") * positive(fs, "fs"))
    both = mirrored(x)
    endless = np.resize(both, n)
    largest = np.max(np.abs(endless), initial=0.0)
    return endless if peak is None or largest == 0 else endless * (peak / largest)


def largest_jump_at_joins(endless: ArrayLike, n_samples: int) -> float:
    """Return the largest step between neighbours where copies of `n_samples` meet, in the signal's unit."""
    x = one_channel(endless, "signal")
    joins = np.arange(n_samples, x.size, n_samples)
    return float(np.max(np.abs(x[joins] - x[joins - 1]), initial=0.0))


def write_wav(path: Path, x: ArrayLike, fs: float, *, sample_format: SampleFormat = "FLOAT") -> float:
    """Write a signal as WAV and return the factor from what stands in the file back to its unit.

    Parameters
    ----------
    path : Path
        Of the file.
    x : array_like of shape (n_samples,)
        Any unit.
    fs : float
        A whole number of Hz.
    sample_format : {"FLOAT", "PCM_16"}
        32-bit float keeps the unit (factor 1); 16 bit is scaled to full scale.

    Raises
    ------
    ValueError
        For an unknown format, NaN or infinity, or a rate that is not whole.
    """
    samples = one_channel(x, "signal")
    if sample_format not in get_args(SampleFormat) or fs != round(positive(fs, "fs")):
        raise ValueError(
            f"sample_format is {sample_format!r}, fs {fs} Hz; the rule is one of {get_args(SampleFormat)}, "
            "and a whole number of Hz"
        )
    peak = float(np.max(np.abs(samples)))
    factor = peak if sample_format == "PCM_16" and peak > 0 else 1.0
    sf.write(path, samples / factor, round(fs), subtype=sample_format, format="WAV")
    return factor
