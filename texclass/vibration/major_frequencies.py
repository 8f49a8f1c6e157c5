"""Major frequencies: the few strongest spectral lines of a vibration that cause no perceptible beats."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from texclass.recording import Samples
from texclass.signals import one_channel, to_unit_scale
from texclass.vibration.decaying_modes import Sinusoids

BEAT_BOUNDS_HZ = (50.0, 100.0, 150.0, 250.0, 500.0)
BEAT_THRESHOLDS_HZ = (6.0, 7.0, 9.0, 9.0, 15.0, 80.0)
"""Smallest distance of two frequencies up to each bound and above the last one; `oeztuerk2018`, Table 3.2."""


@dataclass(frozen=True, eq=False)
class MajorFrequencies(Sinusoids):
    """Vibration model x(t) = sum_i A_i cos(2 pi f_i t + phi_i).

    Attributes
    ----------
    frequency_hz : ndarray of shape (n_frequencies,)
        Frequencies f_i in Hz, increasing.
    amplitude : ndarray of shape (n_frequencies,)
        Amplitudes A_i >= 0 in the unit of the vibration.
    phase : ndarray of shape (n_frequencies,)
        Phases phi_i at the first sample in rad.

    Examples
    --------
    >>> model = MajorFrequencies([80.0, 300.0], [2.0, 1.0], [0.0, 0.0])
    >>> model.synthesize(n_samples=3, fs=10_000.0).round(3)
    array([3.  , 2.98, 2.92])
    """

    amplitude: Samples
    phase: Samples

    def synthesize(self, n_samples: int, fs: float) -> Samples:
        """Return the vibration as a sum of cosines, eq. (3.16); shape (n_samples,).

        Parameters
        ----------
        n_samples : int
            Number of samples. With the length and sampling rate of the fitted signal, the result is the
            inverse Fourier transform of the selected lines.
        fs : float
            Sampling rate in Hz. Frequencies of fs/2 and above are omitted.
        """
        t = np.arange(n_samples) / fs
        x = np.zeros(n_samples)
        for f, A, phi in zip(self.frequency_hz, self.amplitude, self.phase, strict=True):
            if f < fs / 2:
                x += A * np.cos(2 * np.pi * f * t + phi)
        return x


def beat_threshold_hz(frequency_hz: ArrayLike) -> Samples:
    """Return the smallest distance (Hz) to a second frequency at which no beats are perceived.

    The values are those of `oeztuerk2018`, Table 3.2. A bound belongs to the interval below it. Above 1400
    Hz, where the table ends, 80 Hz is used.

    Examples
    --------
    >>> beat_threshold_hz([40.0, 200.0, 600.0])
    array([ 6.,  9., 80.])
    """
    interval = np.searchsorted(BEAT_BOUNDS_HZ, np.asarray(frequency_hz, dtype=np.float64), side="left")
    return np.asarray(np.array(BEAT_THRESHOLDS_HZ)[interval])


def strongest_lines(
    magnitude: Samples, f: Samples, max_lines: int, *, min_magnitude: float = 0.0, width: float = 0.0
) -> list[int]:
    """Return the indices of the strongest spectral lines above `min_magnitude`, the strongest first.

    At most `max_lines` lines are returned. Any two of them differ by at least the beat threshold of the lower
    line, and by at least 2 `width` times the frequency of the stronger line.
    """
    lines: list[int] = []
    remaining = magnitude.copy()
    while len(lines) < max_lines and remaining.max(initial=0.0) > min_magnitude:
        lines.append(int(np.argmax(remaining)))
        g = f[lines[-1]]
        remaining[np.abs(f - g) < np.maximum(beat_threshold_hz(np.minimum(f, g)), 2 * width * g)] = 0.0
    return lines


def fit_major_frequencies(
    x: ArrayLike, fs: float, *, n_frequencies: int = 13, upper_hz: float = 1400.0
) -> MajorFrequencies:
    """Model a vibration by its strongest spectral lines that are far enough apart not to beat.

    Lines of the discrete Fourier transform X of the signal are selected in the order of decreasing |X|. A
    line is skipped if it is closer to a selected line than the beat threshold of the lower of the two.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Signal in any unit. The mean is removed.
    fs : float
        Sampling rate in Hz.
    n_frequencies : int
        Largest number of lines (default 13). The thesis compares 2 to 30 and recommends 12 to 14.
    upper_hz : float
        Highest frequency in Hz (default 1400, the upper end of Table 3.2 and of the perceptible range).

    Returns
    -------
    MajorFrequencies
        Model with at most `n_frequencies` lines, and fewer if the band does not contain enough lines with a
        positive amplitude.

    Raises
    ------
    ValueError
        If `x` has fewer than 3 samples or contains NaN or infinity, or if `n_frequencies`, `fs` or `upper_hz`
        is not positive.

    Notes
    -----
    Table 3.2 states one threshold per interval, but none for two frequencies in different intervals. We use
    the threshold of the lower frequency, which is smaller.

    References
    ----------
    `oeztuerk2018`, section 3.2, eqs. (3.13) to (3.16).

    Examples
    --------
    >>> t = np.arange(10_000) / 10_000
    >>> x = 2 * np.cos(2 * np.pi * 80 * t + 0.3) + np.cos(2 * np.pi * 84 * t) + np.sin(2 * np.pi * 300 * t)
    >>> fit_major_frequencies(x, 10_000.0, n_frequencies=2).frequency_hz
    array([ 80., 300.])
    """
    samples, exponent = to_unit_scale(one_channel(x, "signal", at_least=3))
    if n_frequencies < 1 or not (fs > 0 and upper_hz > 0):
        raise ValueError(
            f"n_frequencies, fs and upper_hz must be positive, got {n_frequencies}, {fs} Hz and {upper_hz} Hz"
        )
    n = samples.size
    f = np.asarray(np.arange(1, (n + 1) // 2) * (fs / n), dtype=np.float64)
    is_in_band = f <= upper_hz
    X = fft.rfft(samples - samples.mean())[1 : f.size + 1][is_in_band]
    f = f[is_in_band]
    lines = sorted(strongest_lines(np.abs(X), f, n_frequencies))
    return MajorFrequencies(f[lines], np.ldexp(np.abs(X[lines]) * 2 / n, exponent), np.angle(X[lines]))


def interpolate(slow: MajorFrequencies, fast: MajorFrequencies, weight: float) -> MajorFrequencies:
    """Interpolate linearly between the models of two recordings of one surface.

    The amplitude of a line that only one model has fades to 0 towards the other model. A line of `slow` and a
    line of `fast` that are closer than the beat threshold are merged into one line; the nearest lines are
    paired first. The frequency and amplitude of the merged line change linearly, and its phase changes along
    the shorter arc. The result is a continuous function of the weight.

    Parameters
    ----------
    slow, fast : MajorFrequencies
        Models in the same unit.
    weight : float
        Weight of `fast` between 0 and 1: 0 gives `slow`, 1 gives `fast`.

    Returns
    -------
    MajorFrequencies

    Raises
    ------
    ValueError
        If the weight does not lie between 0 and 1.

    Notes
    -----
    The thesis interpolates amplitudes and does not treat close frequencies, which would beat. Lines without a
    partner may still come closer than the threshold while they fade.

    References
    ----------
    `oeztuerk2018`, section 3.2 and Fig. 3.9.

    Examples
    --------
    >>> slow = MajorFrequencies([80.0, 300.0], [2.0, 1.0], [0.0, 0.0])
    >>> fast = MajorFrequencies([84.0], [4.0], [0.0])
    >>> middle = interpolate(slow, fast, 0.5)
    >>> middle.frequency_hz, middle.amplitude
    (array([ 82., 300.]), array([3. , 0.5]))
    """
    if not 0 <= weight <= 1:
        raise ValueError(f"weight must lie between 0 and 1, got {weight}")
    i, j = match_close_frequencies(slow.frequency_hz, fast.frequency_hz)
    rotation = np.angle(np.exp(1j * (fast.phase[j] - slow.phase[i])))
    rows = [
        (
            (1 - weight) * slow.frequency_hz[i] + weight * fast.frequency_hz[j],
            (1 - weight) * slow.amplitude[i] + weight * fast.amplitude[j],
            slow.phase[i] + weight * rotation,
        )
    ]
    for lines, paired, share in ((slow, i, 1 - weight), (fast, j, weight)):
        single = np.setdiff1d(np.arange(lines.frequency_hz.size), paired)
        rows.append((lines.frequency_hz[single], share * lines.amplitude[single], lines.phase[single]))
    f, A, phi = (np.concatenate(column) for column in zip(*rows, strict=True))
    order = np.argsort(f, kind="stable")
    order = order[A[order] > 0]
    return MajorFrequencies(f[order], A[order], phi[order])


def match_close_frequencies(f: Samples, g: Samples) -> tuple[list[int], list[int]]:
    """Match the frequencies `f` and `g` one to one.

    Returns the indices of the pairs that are closer than the beat threshold, the nearest pair first.
    """
    gap = np.abs(f[:, np.newaxis] - g)
    gap[gap >= beat_threshold_hz(np.minimum(f[:, np.newaxis], g))] = np.inf
    i, j = [], []
    while gap.size and np.isfinite(gap.min()):
        row, column = divmod(int(np.argmin(gap)), g.size)
        i.append(row)
        j.append(column)
        gap[row], gap[:, column] = np.inf, np.inf
    return i, j
