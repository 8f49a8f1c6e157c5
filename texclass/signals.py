"""Condition acceleration signals: check, combine axes, remove hand motion, smooth and filter.

Filters are Butterworth filters in second-order sections. This module wraps functions of `scipy.signal` and
`scipy.ndimage` and adds input checks and the conventions of the package. The subpackages of scipy are loaded
on first use, so importing this module is fast.
"""

from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from texclass.fourier import LANES, irfft_quarters, rfft_quarters
from texclass.recording import Samples

HAND_WINDOW_S = 0.2
"""Window of the moving average that estimates gravity and hand motion, in s; its first zero is at 5 Hz."""
TIE_BREAK, TIE_BREAK_SINGLE = 1e-9, 1e-6
"""Relative extra weight of an earlier axis in the phase of `dft321`, in double and in single precision."""


def dft321(acceleration: ArrayLike, *, single: bool = False) -> Samples:
    """Combine several axes into one signal with the same spectral energy (DFT321).

    The spectrum of the result is::

        |A(f)| = sqrt(sum_i |A_i(f)|^2),    arg A(f) = arg sum_i A_i(f)

    where A_i is the discrete Fourier transform of axis i without its mean. The energy of every frequency bin
    is the sum over all axes, so rotating the sensor does not change the magnitude spectrum.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples, n_axes)
        Acceleration in any unit. The mean of each axis is removed.
    single : bool
        Compute in single precision if n_samples is a multiple of 4 (default False). This takes at most half
        the time, with errors of a few millionths of the largest magnitude.

    Returns
    -------
    ndarray of shape (n_samples,)
        Signal with zero mean, in the unit of the input.

    Raises
    ------
    ValueError
        If the array is not two-dimensional, is empty, or contains NaN or infinity.

    Notes
    -----
    Where axes cancel, such as two axes of opposite sign, the phase of the sum would be rounding noise. Axis i
    of c axes is therefore weighted with 1 + (c - 1 - i) `TIE_BREAK`, so that the earlier axis determines the
    phase.

    Phases of different axes are mixed, so a short event may spread in time. Locate events on the single axes.

    The transform is not padded to a fast length, because padding would move energy out of the signal.

    References
    ----------
    Landin et al., "Dimensional reduction of high-frequency accelerations for haptic rendering", 2010;
    used by `strese2015`, section III.

    Examples
    --------
    >>> import numpy as np
    >>> vibration = np.sin(np.arange(64))
    >>> combined = dft321(np.stack([3 * vibration, 4 * vibration], axis=1))
    >>> bool(np.allclose(combined, 5 * (vibration - vibration.mean())))
    True
    """
    axes = all_finite(acceleration, "acceleration")
    if axes.ndim != 2 or axes.size == 0:
        raise ValueError(f"acceleration must have shape (n_samples, n_axes), got {axes.shape}")
    n, n_axes = axes.shape
    if n_axes == 1:
        return np.asarray(axes[:, 0] - axes[:, 0].mean())
    exponent = int(np.frexp(max(axes.max(), -axes.min()))[1])
    if abs(exponent) <= 20:  # squares neither overflow nor underflow
        exponent = 0
    else:
        axes = np.ldexp(axes, -exponent)
    single = single and n % LANES == 0
    tie_break = TIE_BREAK_SINGLE if single else TIE_BREAK
    centred: Any = np.empty(n, dtype=np.float32 if single else np.float64)
    energy: Any = 0.0
    total: Any = 0.0
    for i, mean in enumerate(np.ones(n) @ axes / n):  # axis by axis and in place, to save memory
        np.subtract(axes[:, i], mean, out=centred, casting="same_kind")
        A = rfft_quarters(centred) if single else scipy.fft.rfft(centred)
        energy += A.real**2
        energy += A.imag**2
        A *= 1 + (n_axes - 1 - i) * tie_break
        total += A
    energy.flat[0] = 0.0  # the mean, which is 0 except for rounding errors
    power = total.real**2 + total.imag**2
    vanishing = power == 0
    total[vanishing], power[vanishing] = 1.0, 1.0
    energy /= power
    total *= np.sqrt(energy, out=energy)
    combined = irfft_quarters(total, n) if single else scipy.fft.irfft(total, n, overwrite_x=True)
    return np.ldexp(combined.astype(np.float64), exponent)


def combine(acceleration: ArrayLike, *, single: bool = False) -> Samples:
    """Return one zero-mean signal: a single channel without its mean, or several axes combined by `dft321`.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,) or (n_samples, n_axes)
        Acceleration in any unit.
    single : bool
        Compute `dft321` in single precision (default False).

    Returns
    -------
    ndarray of shape (n_samples,)
        Signal with zero mean, in the unit of the input.

    Examples
    --------
    >>> combine([1.0, 2.0, 3.0]).tolist()
    [-1.0, 0.0, 1.0]
    """
    samples = np.asarray(acceleration, dtype=np.float64)
    return dft321(samples[:, np.newaxis] if samples.ndim == 1 else samples, single=single)


def remove_hand_motion(x: ArrayLike, fs: float) -> Samples:
    """Subtract gravity and slow hand motion, estimated by a moving average over T = `HAND_WINDOW_S`.

    The gain 1 - sin(pi f T) / (pi f T) is 0.06 at 1 Hz, 0.36 at 2.5 Hz and 1 at 5 Hz. Voluntary strokes are
    below 5 Hz, vibrations of textures above.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Acceleration during movement, in any unit.
    fs : float
        Sampling rate in Hz.

    Returns
    -------
    ndarray of shape (n_samples,)
        Signal without hand motion, in the unit of the input.

    Examples
    --------
    >>> import numpy as np
    >>> bool(np.allclose(remove_hand_motion(np.full(1000, 9.81), fs=1000), 0))
    True
    """
    half_window = max(round(HAND_WINDOW_S * positive(fs, "fs") / 2), 1)
    return np.asarray(x, dtype=np.float64) - moving_average(x, 2 * half_window + 1)


def moving_average(x: ArrayLike, n: int) -> Samples:
    """Return the centred moving average over `n` samples; at the ends, over the available samples.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Signal in any unit.
    n : int
        Window length in samples, at least 1; may exceed the length of the signal.

    Returns
    -------
    ndarray of shape (n_samples,)
        Output i is the mean of x[i - n//2 : i - n//2 + n], so a constant signal is unchanged.

    Examples
    --------
    >>> moving_average([0.0, 3.0, 0.0, 3.0], 3).tolist()
    [1.5, 1.0, 2.0, 1.5]
    """
    samples = one_channel(x, "x")
    if n < 1:
        raise ValueError(f"n must be at least 1, got {n}")
    size = samples.size
    n = min(n, 2 * size)
    n_left, n_right = n // 2, n - n // 2
    # A large offset reduces the precision of the running sum in scipy.
    offset = np.median(samples[:: -(-size // 1000)])
    average = scipy.ndimage.uniform_filter1d(samples - offset, n, mode="constant")
    ends = np.r_[: min(n_left, size), max(n_left, size - n_right + 1) : size]
    average[ends] *= n / (np.minimum(ends + n_right, size) - np.maximum(ends - n_left, 0))
    average += offset
    return np.asarray(average)


def butterworth(
    kind: Literal["lowpass", "highpass", "bandpass"],
    cutoff_hz: float | tuple[float, float],
    fs: float,
    *,
    order: int = 4,
) -> Samples:
    """Return a Butterworth filter as second-order sections (n_sections, 6); see `scipy.signal.butter`."""
    if order < 1:  # scipy returns a gain of 1 for order 0
        raise ValueError(f"order must be at least 1, got {order}")
    edges = all_finite(cutoff_hz, "cutoff_hz")  # scipy checks 0 < cutoff < fs/2, but lets NaN pass
    return np.asarray(scipy.signal.butter(order, edges, kind, fs=positive(fs, "fs"), output="sos"))


def zero_phase(sos: Samples, x: ArrayLike) -> Samples:
    """Filter forwards and backwards along the first axis: without delay, with the gain applied twice.

    Parameters
    ----------
    sos : ndarray of shape (n_sections, 6)
        Filter, from `butterworth`.
    x : array_like of shape (n_samples, ...)
        Signal of any length. The ends are extended by point reflection.

    Returns
    -------
    ndarray of the shape of `x`
    """
    samples = all_finite(x, "x", at_least=1)
    padding = min(3 * (2 * len(sos) + 1), len(samples) - 1)
    return scipy.signal.sosfiltfilt(sos, samples, axis=0, padlen=padding)


def causal(sos: Samples, x: ArrayLike, state: Samples | None = None) -> tuple[Samples, Samples | None]:
    """Filter the next block of a signal along the first axis, forwards only.

    Parameters
    ----------
    sos : ndarray of shape (n_sections, 6)
        Filter, from `butterworth`.
    x : array_like of shape (n_samples, ...)
        Next block; may be empty.
    state : ndarray of shape (n_sections, 2, ...), optional
        State returned for the previous block. By default, the filter starts in the steady state of the first
        sample, so that a constant offset causes no transient.

    Returns
    -------
    filtered : ndarray of the shape of `x`
    state : ndarray of shape (n_sections, 2, ...), or None
        State for the next block; None as long as all blocks were empty.
    """
    samples = all_finite(x, "x")
    if len(samples) == 0:
        return samples.copy(), state
    if state is None:
        state = np.multiply.outer(scipy.signal.sosfilt_zi(sos), samples[0])
    return scipy.signal.sosfilt(sos, samples, axis=0, zi=state)


def lowpass(x: ArrayLike, cutoff_hz: float, fs: float, *, order: int = 4) -> Samples:
    """Apply a zero-phase Butterworth low-pass filter; -6 dB at `cutoff_hz` (Hz)."""
    return zero_phase(butterworth("lowpass", cutoff_hz, fs, order=order), x)


def highpass(x: ArrayLike, cutoff_hz: float, fs: float, *, order: int = 4) -> Samples:
    """Apply a zero-phase Butterworth high-pass filter; -6 dB at `cutoff_hz` (Hz)."""
    return zero_phase(butterworth("highpass", cutoff_hz, fs, order=order), x)


def bandpass(x: ArrayLike, band_hz: tuple[float, float], fs: float, *, order: int = 4) -> Samples:
    """Apply a zero-phase Butterworth band-pass filter; -6 dB at both edges of `band_hz` (Hz)."""
    return zero_phase(butterworth("bandpass", band_hz, fs, order=order), x)


def all_finite(x: ArrayLike, name: str, *, at_least: int = 0) -> Samples:
    """Convert `x` to float64; raise ValueError if it contains NaN or infinity or has too few samples."""
    samples = np.asarray(x, dtype=np.float64)
    if at_least and (samples.ndim == 0 or len(samples) < at_least):
        raise ValueError(f"{name} must have at least {at_least} sample(s), got shape {samples.shape}")
    is_bad = ~np.isfinite(samples)
    if is_bad.any():
        first = np.argwhere(is_bad)[0].tolist()
        raise ValueError(f"{name} contains {is_bad.sum()} NaN or infinite samples, the first at {first}")
    return samples


def one_channel(x: ArrayLike, name: str, *, at_least: int = 1) -> Samples:
    """Convert `x` to float64 of shape (n_samples,); raise ValueError if that is not possible."""
    samples = all_finite(x, name)
    if samples.ndim != 1 or samples.size < at_least:
        raise ValueError(
            f"{name} must be one channel of at least {at_least} samples, got shape {samples.shape}"
        )
    return samples


def to_unit_scale(x: Samples) -> tuple[Samples, int]:
    """Return `x` / 2^e, whose largest magnitude is in [0.5, 1), and e; the scaling is exact."""
    exponent = int(np.frexp(np.max(np.abs(x), initial=0.0))[1])
    with np.errstate(under="ignore"):
        return np.ldexp(x, -exponent), exponent


def positive(value: float, name: str) -> float:
    """Return `value`, or raise ValueError if it is not finite and positive."""
    if not 0 < value < np.inf:
        raise ValueError(f"{name} must be positive and finite, got {value}")
    return value


def angular_frequencies(omega: ArrayLike) -> Samples:
    """Convert angular frequencies (rad per sample) to float64; raise ValueError if they are not 1-D."""
    w = np.ascontiguousarray(all_finite(omega, "omega"))
    if w.ndim != 1:
        raise ValueError(f"omega must have shape (n_frequencies,), got {w.shape}")
    return w
