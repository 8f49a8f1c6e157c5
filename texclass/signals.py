"""Signals, as many rooms need them: checks, one signal from three axes, averages and filters.

Filters are Butterworth as second-order sections, zero-phase or causal. What one answer needs of
`scipy.signal` is here: loading that takes longer than everything else that such an answer needs.
"""

import functools
import itertools
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from texclass import fourier
from texclass.recording import Samples

HAND_SPAN_S = 0.2
"""Window of the moving average that stands for gravity and the path of the hand; first zero at 5 Hz."""
AXIS_PREFERENCE, AXIS_PREFERENCE_SINGLE = 1e-9, 1e-6
"""Relative extra weight of an earlier axis in the sum whose phase DFT321 takes; in single precision."""
STEPS = 32
"""Samples that a causal filter takes at once, blocks of them, and groups of these blocks."""
_FEW = 16
_SUMS = np.triu(np.ones((_FEW, _FEW)))
"""Few samples times it are their cumulative sums."""


def dft321(acceleration: ArrayLike, *, single: bool = False) -> Samples:
    """Reduce several axes to one signal of the same spectral energy (DFT321).

    The spectrum of the result is::

        |A(f)| = sqrt(sum_i |A_i(f)|^2),    arg A(f) = arg sum_i A_i(f)

    with A_i the discrete Fourier transform of axis i without its mean. The energy is that of all axes
    together, bin by bin, so a rotation of the sensor leaves the magnitude spectrum as it is.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples, n_axes)
        Any unit. The mean of each axis (gravity, for a tool held still) is removed.
    single : bool
        Whether single precision will do, where 4 divides n_samples: errors of some millionths of the largest
        magnitude, in half the time or less.

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
    which moves a well-defined phase by about 1e-9 rad and lets the earlier axis decide where the axes cancel;
    in single precision it is `AXIS_PREFERENCE_SINGLE`. The weighted sum is linear in the input, so nothing
    jumps at a threshold. Where it vanishes as well, the phase is 0.

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
    (n, n_axes), exponent = axes.shape, 0
    peak = max(axes.max(), -axes.min())  # NaN and infinity pass through
    if not np.isfinite(peak):
        all_finite(axes, "dft321")
    largest = int(np.frexp(peak)[1])
    if abs(largest) > (20 if single else 100):  # no gain over- or underflows when squared
        axes, exponent = np.ldexp(axes, -largest), largest
    if n_axes == 1:
        signal: Samples = axes[:, 0] - axes[:, 0].mean()
    else:
        single = single and n % fourier.INTERLEAVED == 0
        moved: Any = np.empty(n, dtype=np.float32 if single else np.float64)
        mean = np.ones(n) @ axes / n if single else axes.mean(axis=0)  # which takes ten times as long
        preference = AXIS_PREFERENCE_SINGLE if single else AXIS_PREFERENCE
        energy: Any = 0.0
        total: Any = 0.0
        for i in range(n_axes):  # one after the other: little memory, most of it used again
            np.subtract(axes[:, i], mean[i], out=moved, casting="same_kind")
            spectrum = fourier.folded(moved) if single else fft.rfft(moved)
            energy += spectrum.real**2
            energy += spectrum.imag**2
            spectrum *= 1 + (n_axes - 1 - i) * preference
            total += spectrum
        energy.flat[0] = 0.0
        power = total.real**2 + total.imag**2
        vanishing = power == 0
        total[vanishing], power[vanishing] = 1.0, 1.0
        energy /= power
        total *= np.sqrt(energy, out=energy)
        combined = fourier.unfolded(total, n) if single else fft.irfft(total, n, overwrite_x=True)
        signal = np.asarray(combined, dtype=np.float64)
    return np.asarray(np.ldexp(signal, exponent)) if exponent else signal


def combine(acceleration: ArrayLike, *, single: bool = False) -> Samples:
    """Return one zero-mean signal: the only channel as it is, several axes by `dft321`.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,) or (n_samples, n_axes)
        Any unit.
    single : bool
        Of several axes: see `dft321`.

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
    return dft321(samples[:, np.newaxis] if samples.ndim == 1 else samples, single=single)


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
    A window of n samples covers the end of one block of n samples and the start of the next. Sums are
    accumulated within the blocks: rounding never travels further than 2 n samples, whatever the length of the
    signal, and the cost does not depend on n.
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
    np.subtract(samples, offset, out=blocks.reshape(-1)[n // 2 : n // 2 + size])
    few = np.zeros((n_blocks + 1, -(-n // _FEW), _FEW))
    few.reshape(n_blocks + 1, -1)[:, :n] = blocks
    sums = few @ _SUMS  # numpy's cumulative sum of all takes twice as long
    sums[:, 1:] += np.cumsum(sums[:, :-1, -1:], axis=1)
    sums = sums.reshape(n_blocks + 1, -1)
    blocks = blocks[:-1]
    blocks[:] = sums[:-1, -1:]  # a block, less its start, with that of the next
    blocks[:, 1:] += sums[1:, : n - 1]
    blocks[:, 1:] -= sums[:-1, : n - 1]
    average = blocks.reshape(-1)[:size]
    ends = np.r_[: min(n // 2, size), max(n // 2, size - (n - n // 2) + 1) : size]
    average[ends] *= n / (np.minimum(ends + n - n // 2, size) - np.maximum(ends - n // 2, 0))
    average *= 1 / n
    average += offset
    return average


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
    k, warped = 2 * fs, 2 * fs * np.tan(np.pi * edges / fs)  # s = k (1 - 1/z) / (1 + 1/z) bends frequencies
    w, middle = warped[-1] - (warped[0] if edges.size == 2 else 0.0), float(np.prod(warped))
    sections = []
    for i in range((order + 1) // 2)[::-1]:  # the poles above the real axis, the sharpest last
        p = w * np.exp(0.5j * np.pi * (1 + (2 * i + 1) / order))
        is_real = 2 * i + 1 == order
        if kind == "bandpass" and is_real:
            sections.append(_digital((0, w, 0), (1, w, middle), k))
        elif kind == "bandpass":  # s^2 - p s + middle, and its conjugate
            root = np.sqrt((p / 2) ** 2 - middle)
            low, high = sorted((p / 2 + root, p / 2 - root), key=abs)
            # (w s)^2 is shared so that no section amplifies: a wide band is a high-pass and a low-pass
            passing = ((1, 0, 0), (0, 0, w * w)) if w * w > middle else ((0, w, 0), (0, w, 0))
            for numerator, r in zip(passing, (low, high), strict=True):
                sections.append(_digital(numerator, (1, -2 * r.real, abs(r) ** 2), k))
        elif is_real:
            sections.append(_digital((0, w) if kind == "lowpass" else (1, 0), (1, w), k))
        else:
            numerator = (0, 0, w * w) if kind == "lowpass" else (1, 0, 0)
            sections.append(_digital(numerator, (1, -2 * p.real, w * w), k))
    return np.array(sections)


def _digital(numerator: tuple[float, ...], denominator: tuple[float, ...], k: float) -> Samples:
    """Return b0, b1, b2, 1, a1, a2 of a ratio of polynomials in s = k (1 - 1/z) / (1 + 1/z)."""
    n = len(denominator)
    powers = np.array([[1, -2, 1], [1, 0, -1], [1, 2, 1]] if n == 3 else [[1, -1], [1, 1]])
    b, a = (np.array(each) * k ** np.arange(n)[::-1] @ powers for each in (numerator, denominator))
    found = np.zeros(6)
    found[:n], found[3 : 3 + n] = b / a[0], a / a[0]
    return found


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
    from scipy import signal

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
        state = np.empty((len(sos), 2, *samples.shape[1:]))
        level = samples[0]
        for z, (b0, b1, b2, _, a1, a2) in zip(state, sos, strict=True):
            before, level = level, level * ((b0 + b1 + b2) / (1 + a1 + a2))
            z[1] = b2 * before - a2 * level
            z[0] = b1 * before - a1 * level + z[1]
    basis, inverse = _basis(sos.tobytes())
    z = state.reshape(2 * len(sos), -1).T @ inverse.T
    filtered, z = causal_channels(sos, np.ascontiguousarray(samples.reshape(len(samples), -1).T), z)
    return filtered.T.reshape(samples.shape), (basis @ z.T).reshape(state.shape)


def causal_channels(sos: Samples, x: Any, z: Any) -> tuple[Any, Any]:
    """Filter forwards only, in the precision of the samples: what `causal` does, unchecked.

    Parameters
    ----------
    sos : ndarray of shape (n_sections, 6)
        From `butterworth`.
    x : ndarray of shape (n_channels, n_samples)
        Single or double precision; at least one sample.
    z : ndarray of shape (n_channels, 2 * n_sections)
        The state before, in coordinates of this filter's own; at rest on 0, it is 0.

    Returns
    -------
    filtered : ndarray of shape (n_channels, n_samples)
    z : ndarray of shape (n_channels, 2 * n_sections)
        The state after.
    """
    size, key = x.shape[1], sos.tobytes()
    whole = size - size % STEPS
    edges = sorted({*range(0, whole, STEPS**3), whole, size})
    if len(edges) == 2:
        return _at_once(key, x, z)
    filtered = np.empty_like(x)
    for first, stop in itertools.pairwise(edges):
        filtered[:, first:stop], z = _at_once(key, x[:, first:stop], z)
    return filtered, z


def _normal_form(section: Samples) -> tuple[Samples, Samples, Samples]:
    """Return A, B and V of a section with the state V m, where m' = A m + B x, and y = b0 x + m_0.

    Of a pair of poles, A turns and shrinks: its powers stay as exact as it is, those of the usual form, whose
    states nearly cancel at low frequencies, do not.
    """
    b0, b1, b2, _, a1, a2 = section
    V, A = np.eye(2), np.array([[-a1, 1.0], [-a2, 0.0]])
    if (square := a2 - a1**2 / 4) > 0:
        re, im = -a1 / 2, np.sqrt(square)
        V, A = np.array([[1.0, 0.0], [-re, im]]), np.array([[re, im], [-im, re]])
    return A, np.linalg.solve(V, [b1 - a1 * b0, b2 - a2 * b0]), V


def _at_once(sos: bytes, x: Any, z: Any) -> tuple[Any, Any]:
    """Filter up to `STEPS` samples of each channel, or whole blocks of so many, without a loop.

    The n outputs of a block and the state after it are a matrix times its samples and the state before it,
    and so are the states after many blocks.
    """
    (n_channels, size), n_states = x.shape, z.shape[1]
    n = min(size, STEPS)
    n_blocks, n_groups = size // n, -(-size // (n * STEPS))
    outputs, onwards = _matrices(sos, n, x.dtype.char)
    known = np.empty((n_channels, n_blocks, n + n_states), dtype=x.dtype)  # samples, and the state before
    known[..., :n] = x.reshape(n_channels, n_blocks, n)
    known[:, 0, n:] = z
    added = (x.reshape(-1, n) @ onwards[:n]).reshape(n_channels, -1)
    if n_blocks == 1:
        after = added + z @ onwards[n:]
    else:
        if n_groups > 1:
            full = np.zeros((n_channels, n_groups * STEPS * n_states), dtype=x.dtype)
            full[:, : added.shape[1]] = added
            added = full
        after = _many_states(sos, n, x.dtype.char, added.reshape(n_channels * n_groups, -1), z)
        known[:, 1:, n:] = after[:, : (n_blocks - 1) * n_states].reshape(n_channels, -1, n_states)
    z = after[:, (n_blocks - 1) * n_states : n_blocks * n_states]
    return (known.reshape(-1, n + n_states) @ outputs).reshape(n_channels, size), z


@functools.lru_cache(maxsize=32)
def _basis(sos: bytes) -> tuple[Samples, Samples]:
    """Return the matrix from the states of the normal form to those of the usual one, and its inverse."""
    V = [_normal_form(section)[2] for section in np.frombuffer(sos).reshape(-1, 6)]
    both = np.zeros((2, len(V), 2, len(V), 2))
    for i, one in enumerate(V):
        both[0, i, :, i], both[1, i, :, i] = one, np.linalg.inv(one)
    basis, inverse = both.reshape(2, 2 * len(V), 2 * len(V))
    return basis, inverse


@functools.lru_cache(maxsize=256)
def _matrices(sos: bytes, n: int, kind: str) -> tuple[Any, Any]:
    """Return what n samples and the state before them are multiplied by: for outputs, for the next state."""
    sections = np.frombuffer(sos).reshape(-1, 6)
    n_states = 2 * len(sections)
    y = np.eye(n, n + n_states)  # one signal a column: an impulse at each time, and each state at work alone
    states = np.eye(n_states, n + n_states, n).reshape(-1, 2, n + n_states)
    for z, section in zip(states, sections, strict=True):
        A, B, _ = _normal_form(section)
        for t in range(n):
            x = y[t].copy()
            y[t] = section[0] * x + z[0]
            z[:] = A @ z + B[:, None] * x
    onwards = states.reshape(n_states, -1).T
    return np.ascontiguousarray(y.T, dtype=kind), np.ascontiguousarray(onwards, dtype=kind)


def _many_states(sos: bytes, n: int, kind: str, added: Any, z: Any) -> Any:
    """Return the states (n_channels, blocks' states) after each of many blocks of n samples.

    `added` has a row a group of at most `STEPS` blocks: what each block adds. Within a group, and from group
    to group, all states are a matrix times what is added and the state before.
    """
    (n_rows, width), (n_channels, n_states) = added.shape, z.shape
    within, since = _transitions(sos, n, kind)
    after = added @ within[:width, :width]
    before = z
    if n_rows > n_channels:
        ends = after[:, -n_states:].reshape(n_channels, -1)
        within_groups, since_groups = _transitions(sos, n * STEPS, kind)
        of_groups = ends.shape[1] - n_states
        later = ends[:, :-n_states] @ within_groups[:of_groups, :of_groups] + z @ since_groups[:, :of_groups]
        before = np.concatenate([z, later], axis=1).reshape(-1, n_states)
    after += before @ since[:, :width]
    return after.reshape(n_channels, -1)


@functools.lru_cache(maxsize=64)
def _transitions(sos: bytes, n: int, kind: str) -> tuple[Any, Any]:
    """Return what turns what `STEPS` blocks of n samples add, and the state before, into the states after."""
    once = np.linalg.matrix_power(_matrices(sos, 1, "d")[1][1:], n)
    n_states = len(once)
    powers = [np.eye(n_states)]
    for _ in range(STEPS):
        powers.append(powers[-1] @ once)
    within = np.zeros((STEPS, n_states, STEPS, n_states))
    for first in range(STEPS):
        within[first, :, first:] = np.stack(powers[: STEPS - first], axis=1)
    return within.reshape(2 * [STEPS * n_states]).astype(kind), np.hstack(powers[1:]).astype(kind)


def find_peaks(x: Samples, *, height: float, distance: int = 1, prominence: float = 0.0) -> NDArray[np.intp]:
    """Return the peaks of a signal, as `scipy.signal.find_peaks` has them.

    Parameters
    ----------
    x : ndarray of shape (n_samples,)
        Finite. A flat peak is found in its middle; the first and the last sample are none.
    height, prominence : float
        Least height, and least height above what lies between the peak and a higher one, on either side.
    distance : int
        Least distance of two peaks, in samples: the higher one stays, of equal ones the later.

    Returns
    -------
    ndarray of int, shape (n_peaks,)
    """
    steps = np.flatnonzero(np.diff(x))
    rises = x[steps + 1] > x[steps]
    tops = np.flatnonzero(rises[:-1] & ~rises[1:])
    peaks = (steps[tops] + 1 + steps[tops + 1]) // 2
    peaks = peaks[x[peaks] >= height]
    if distance > 1:
        rank, stays = np.zeros((2, len(peaks) + 1), dtype=np.intp)  # the last one ends the last neighbourhood
        rank[np.argsort(x[peaks], kind="stable")] = np.arange(1, len(peaks) + 1)
        near = np.searchsorted(peaks, np.column_stack([peaks - distance + 1, peaks + distance])).ravel()
        while rank.any():
            stays[:-1] |= (rank[:-1] > 0) & (rank[:-1] == np.maximum.reduceat(rank, near)[::2])
            rank[:-1][np.maximum.reduceat(stays, near)[::2] > 0] = 0
        peaks = peaks[stays[:-1] > 0]
    if prominence <= 0:
        return np.asarray(peaks)
    after = _stands_out(x, peaks, prominence)
    return np.asarray(peaks[after & _stands_out(x[::-1], len(x) - 1 - peaks, prominence)])


def _stands_out(x: Samples, peaks: NDArray[np.intp], prominence: float) -> NDArray[np.bool_]:
    """Return whether the signal falls so far below each peak before it rises above it."""
    ahead, width, found = peaks + 1, 64, np.zeros(len(peaks), dtype=np.bool_)
    left = np.arange(len(peaks))
    ending = np.append(x, np.inf)
    while len(left):
        near = ending[np.minimum(ahead[left, None] + np.arange(width), len(x))]
        top = x[peaks[left], None]
        low, high = top - near >= prominence, near > top
        decided = (low | high).any(axis=1)
        found[left] = low.any(axis=1) & (
            low.argmax(axis=1) < np.where(high.any(axis=1), high.argmax(axis=1), width)
        )
        ahead[left] += width
        left, width = left[~decided], 2 * width
    return found


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
