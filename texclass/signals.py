"""Signals, as many rooms need them: checks, one signal from three axes, averages and filters.

Filters are Butterworth as second-order sections, zero-phase or causal.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft, signal

from texclass.recording import Samples

HAND_SPAN_S = 0.2
"""Window of the moving average that stands for gravity and the path of the hand; first zero at 5 Hz."""
AXIS_PREFERENCE = 1e-9
"""Relative extra weight of an earlier axis in the sum whose phase DFT321 takes."""


def dft321(acceleration: ArrayLike) -> Samples:
    """Reduce several axes to one signal of the same spectral energy (DFT321).

    The spectrum of the result is::

        |A(f)| = sqrt(sum_i |A_i(f)|^2),    arg A(f) = arg sum_i A_i(f)

    with A_i the discrete Fourier transform of axis i without its mean. The energy is that of all axes
    together, bin by bin, so a rotation of the sensor leaves the magnitude spectrum as it is.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples, n_axes)
        Any unit. The mean of each axis (gravity, for a tool held still) is removed.

    Returns
    -------
    ndarray of shape (n_samples,)
        In the unit of the input, zero mean.

    Raises
    ------
    ValueError
        If the array is not two-dimensional, holds no sample, or NaN or infinity.

    Notes
    -----
    The phase is ill-defined where the axes cancel, as in axes of opposite sign: there the printed sum is
    rounding noise. Axis i of c therefore enters the sum with the weight 1 + (c - 1 - i) `AXIS_PREFERENCE`,
    which moves a well-defined phase by about 1e-9 rad and lets the earlier axis decide where the axes cancel.
    The weighted sum is linear in the input, so nothing jumps at a threshold. Where it vanishes as well, the
    phase is 0.

    Phases of different axes are mixed, so a short event may leak to where no axis moved: locate events on
    the axes themselves.

    The transform has the length of the signal. Padding to a fast length would spread energy into the padding,
    and cutting that off would lose it; scipy's transform of a prime length costs about three to five times
    that of a fast one.

    References
    ----------
    Landin et al., "Dimensional reduction of high-frequency accelerations for haptic rendering", 2010;
    used by `strese2015`, section III.

    Examples
    --------
    >>> import numpy as np
    >>> shake = np.sin(np.arange(64))
    >>> one = dft321(np.stack([3 * shake, 4 * shake], axis=1))
    >>> bool(np.allclose(one, 5 * (shake - shake.mean())))
    True
    """
    axes = np.asarray(acceleration, dtype=np.float64)
    if axes.ndim != 2 or axes.size == 0:
        raise ValueError(f"dft321 got shape {axes.shape}; the rule is (n_samples, n_axes), none of them 0")
    n, n_axes = axes.shape
    rows, exponent = to_unit_scale(all_finite(axes, "dft321"))  # no gain over- or underflows when squared
    rows = np.ascontiguousarray(rows.T)
    rows -= rows.mean(axis=1, keepdims=True)
    if n_axes == 1:
        return np.asarray(np.ldexp(rows[0], exponent))
    spectra = fft.rfft(rows)
    del rows  # of a long signal, a third of all the memory
    energy: Samples = np.zeros(n // 2 + 1)
    total = np.zeros(n // 2 + 1, dtype=np.complex128)
    for i, spectrum in enumerate(spectra):
        energy += spectrum.real**2 + spectrum.imag**2
        total += (1 + (n_axes - 1 - i) * AXIS_PREFERENCE) * spectrum
    energy[0] = 0.0
    magnitude = np.abs(total)
    vanishing = magnitude == 0
    total[vanishing], magnitude[vanishing] = 1.0, 1.0
    total *= np.sqrt(energy) / magnitude
    return np.asarray(np.ldexp(fft.irfft(total, n), exponent))


def combine(acceleration: ArrayLike) -> Samples:
    """Return one zero-mean signal: the only channel as it is, several axes by `dft321`.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,) or (n_samples, n_axes)
        Any unit.

    Returns
    -------
    ndarray of shape (n_samples,)
        In the unit of the input, zero mean.

    Raises
    ------
    ValueError
        As `dft321`.
    """
    samples = np.asarray(acceleration, dtype=np.float64)
    return dft321(samples[:, np.newaxis] if samples.ndim == 1 else samples)


def remove_hand_motion(x: ArrayLike, fs: float) -> Samples:
    """Return a movement without gravity, which turns with the tool, and without the path of the hand.

    The centred moving average over `HAND_SPAN_S` is subtracted: 1 - sin(pi f T) / (pi f T), which passes 6 %
    of the amplitude at 1 Hz, 36 % at 2.5 Hz and all at 5 Hz, where voluntary strokes end and textures begin.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Any unit.
    fs : float
        Sampling rate in Hz.

    Returns
    -------
    ndarray of shape (n_samples,)
        Zero mean up to what the cut window leaves at the ends.

    Raises
    ------
    ValueError
        As `moving_average`, or if `fs` is not finite and above 0.
    """
    samples = np.asarray(x, dtype=np.float64)
    if not 0 < fs < np.inf:
        raise ValueError(f"fs is {fs} Hz; the rule is a sampling rate in Hz above 0")
    return samples - moving_average(samples, max(2 * round(HAND_SPAN_S * fs / 2) + 1, 3))


def moving_average(x: ArrayLike, n: int) -> Samples:
    """Return the centred moving average over `n` samples.

    Output i is the mean of x[i - n//2], ..., x[i - n//2 + n - 1]. At the ends the window is cut: the mean is
    taken over the samples it still holds, so a constant stays a constant.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Any unit.
    n : int
        Length of the window in samples, at least 1; may exceed the signal.

    Returns
    -------
    ndarray of shape (n_samples,)

    Raises
    ------
    ValueError
        If `x` is not one-dimensional, empty, or holds NaN or infinity, or `n` is below 1.

    Notes
    -----
    A window of n samples covers the end of one block of n samples and the start of the next. Its sum is that
    of the two parts, accumulated within the blocks: rounding never travels further than 2 n samples, whatever
    the length of the signal, and the cost does not depend on n.
    """
    samples = np.asarray(x, dtype=np.float64)
    if samples.ndim != 1 or samples.size == 0 or n < 1:
        raise ValueError(
            f"moving_average got shape {samples.shape} and n = {n}; the rule is (n_samples,), n >= 1"
        )
    all_finite(samples, "moving_average")
    size = samples.size
    some = np.sort(samples[:: -(-size // 1000)])
    offset = some[(some.size - 1) // 2] / 2 + some[some.size // 2] / 2  # median: no outlier costs precision
    n = min(n, 2 * size)
    n_blocks = -(-size // n)
    blocks = np.zeros((n_blocks + 1, n))
    blocks.reshape(-1)[n // 2 : n // 2 + size] = samples - offset
    sums = np.cumsum(blocks[:-1, ::-1], axis=1)[:, ::-1]  # from each sample to the end of its block
    sums[:, 1:] += np.cumsum(blocks[1:, :-1], axis=1)  # and from the start of the next to n samples later
    stop = np.arange(n - n // 2, n - n // 2 + size, dtype=np.float64)
    held = np.minimum(stop, size) - np.maximum(stop - n, 0)
    return np.asarray(sums.reshape(-1)[:size] / held + offset)


def all_finite(x: ArrayLike, who: str, *, at_least: int = 0) -> Samples:
    """Return `x` as float64; refuse NaN and infinity: in a filter or a mean they would spread without a word.

    Raises
    ------
    ValueError
        Naming `who`, and how many samples are not finite with the place of the first, or the shape of fewer
        samples than `at_least`.
    """
    samples = np.asarray(x, dtype=np.float64)
    if at_least and (samples.ndim == 0 or len(samples) < at_least):
        raise ValueError(f"{who} got shape {samples.shape}; the rule is at least one sample")
    if not np.isfinite(samples).all():
        bad = np.argwhere(~np.isfinite(samples))
        raise ValueError(
            f"{who} got {len(bad)} samples that are NaN or infinite (first at {bad[0].tolist()}); "
            "the rule is finite samples"
        )
    return samples


def one_channel(x: ArrayLike, name: str, *, at_least: int = 1) -> Samples:
    """Return `x` as float64 of shape (n_samples,), or say which rule it breaks."""
    samples = np.asarray(x, dtype=np.float64)
    if samples.ndim != 1 or samples.size < at_least:
        raise ValueError(
            f"{name} has shape {samples.shape}; the rule is one channel of at least {at_least} samples"
        )
    bad = np.flatnonzero(~np.isfinite(samples))
    if bad.size:
        raise ValueError(
            f"{name} has {bad.size} values that are NaN or infinite, the first at sample {bad[0]}; "
            "the rule is finite samples"
        )
    return samples


def to_unit_scale(x: Samples) -> tuple[Samples, int]:
    """Return `x` times 2^-e, of largest magnitude in [0.5, 1), and e; exact at 1e-300 as at 1e300."""
    exponent = int(np.frexp(np.max(np.abs(x), initial=0.0))[1])
    with np.errstate(under="ignore"):
        return np.ldexp(x, -exponent), exponent


def positive(value: float, name: str) -> float:
    """Return a value that is finite and above 0; else raise the ValueError that names it."""
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name} is {value}; the rule is finite and above 0")
    return value


def angular_frequencies(omega: ArrayLike) -> Samples:
    """Return `omega` (rad per sample) as float64 of shape (n_frequencies,), or say which rule it breaks."""
    w = np.ascontiguousarray(omega, dtype=np.float64)
    if w.ndim != 1 or not np.all(np.isfinite(w)):
        raise ValueError(f"omega has shape {w.shape}; the rule is (n_frequencies,) finite radians per sample")
    return w


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
    samples = all_finite(x, "zero_phase", at_least=1)
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
    samples = all_finite(x, "causal")
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
