"""Major frequencies: a vibration as the few strongest lines of its spectrum that cause no beats."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from texclass.recording import Samples
from texclass.signals import one_channel, to_unit_scale
from texclass.vibration.decaying_modes import Sinusoids

BEAT_BOUNDS_HZ = (50.0, 100.0, 150.0, 250.0, 500.0)
BEAT_THRESHOLDS_HZ = (6.0, 7.0, 9.0, 9.0, 15.0, 80.0)
"""`oeztuerk2018`, Table 3.2: least distance of two frequencies up to each bound, and above the last one."""


@dataclass(frozen=True, eq=False)
class MajorFrequencies(Sinusoids):
    """A vibration as x(t) = sum_i A_i cos(2 pi f_i t + phi_i).

    Attributes
    ----------
    frequency_hz : ndarray of shape (n_frequencies,)
        f_i, rising.
    amplitude : ndarray of shape (n_frequencies,)
        A_i >= 0, in the unit of the vibration.
    phase : ndarray of shape (n_frequencies,)
        phi_i at the first sample, in rad.
    """

    amplitude: Samples
    phase: Samples

    def synthesize(self, n_samples: int, fs: float) -> Samples:
        """Return the vibration, shape (n_samples,): eq. (3.16) in the time domain, at any length and rate.

        Parameters
        ----------
        n_samples : int
            Any length. At the length and rate of the fit it is the inverse transform of the chosen lines.
        fs : float
            Sampling rate in Hz. Frequencies of fs/2 and above are left out.
        """
        t = np.arange(n_samples) / fs
        x = np.zeros(n_samples)
        for f, A, phi in zip(self.frequency_hz, self.amplitude, self.phase, strict=True):
            if f < fs / 2:
                x += A * np.cos(2 * np.pi * f * t + phi)
        return x


def beat_threshold_hz(frequency_hz: ArrayLike) -> Samples:
    """Return how far (Hz) a second frequency must lie from each of these not to be felt as beats.

    Table 3.2 of `oeztuerk2018`; a bound belongs to the lower interval, and 80 Hz hold above 1400 Hz too.
    """
    which = np.searchsorted(BEAT_BOUNDS_HZ, np.asarray(frequency_hz, dtype=np.float64), side="left")
    return np.asarray(np.array(BEAT_THRESHOLDS_HZ)[which])


def strongest_lines(
    values: Samples, f: Samples, most: int, *, least: float = 0.0, width: float = 0.0
) -> list[int]:
    """Return the places of the largest values above `least`, `most` of them or fewer, the largest first.

    No two are closer than the beat threshold of the lower one, nor than twice `width` of the stronger one.
    """
    found: list[int] = []
    left = values.copy()
    while len(found) < most and left.max(initial=0.0) > least:
        found.append(int(np.argmax(left)))
        g = f[found[-1]]
        left[np.abs(f - g) < np.maximum(beat_threshold_hz(np.minimum(f, g)), 2 * width * g)] = 0.0
    return found


def fit_major_frequencies(
    x: ArrayLike, fs: float, *, n_frequencies: int = 13, upper_hz: float = 1400.0
) -> MajorFrequencies:
    """Choose the lines of largest amplitude that keep the beat threshold from each other.

    Of the discrete Fourier transform X of the signal, lines are taken from the largest |X| downwards; one
    that lies closer to a line already taken than the threshold of the lower of the two is skipped.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Any unit. The constant part is left out.
    fs : float
        Sampling rate in Hz.
    n_frequencies : int
        How many at most. The thesis tries 2 to 30 and finds 12 to 14 enough.
    upper_hz : float
        Highest frequency in Hz (default 1400, where Table 3.2 and what is felt end).

    Returns
    -------
    MajorFrequencies
        Fewer than `n_frequencies` where the band has no more lines, or the rest of them is 0.

    Raises
    ------
    ValueError
        For fewer than 3 samples, NaN or infinity, `n_frequencies` below 1, or `fs` or `upper_hz` not above 0.

    Notes
    -----
    Table 3.2 gives one threshold per interval and says nothing of two frequencies in different ones. The
    threshold of the lower frequency is our reading: it is the smaller one, and the table holds inside.

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
            f"n_frequencies, fs, upper_hz are {n_frequencies}, {fs}, {upper_hz}. Expected all above 0"
        )
    n = samples.size
    f = np.asarray(np.arange(1, (n + 1) // 2) * (fs / n), dtype=np.float64)
    within = f <= upper_hz
    X = fft.rfft(samples - samples.mean())[1 : f.size + 1][within]
    f = f[within]
    taken = sorted(strongest_lines(np.abs(X), f, n_frequencies))
    return MajorFrequencies(f[taken], np.ldexp(np.abs(X[taken]) * 2 / n, exponent), np.angle(X[taken]))


def interpolate(slow: MajorFrequencies, fast: MajorFrequencies, weight: float) -> MajorFrequencies:
    """Return the vibration between two recordings of one surface: linear interpolation of the amplitudes.

    A frequency that only one of them has fades towards the other. A frequency of `slow` and one of `fast`
    that are closer than the beat threshold count as one line, nearest pairs first: frequency and amplitude go
    linearly from one to the other, the phase the shorter way round. Nothing jumps anywhere between them.

    Parameters
    ----------
    slow, fast : MajorFrequencies
        Of one unit.
    weight : float
        0 gives `slow`, 1 gives `fast`.

    Returns
    -------
    MajorFrequencies

    Raises
    ------
    ValueError
        If the weight does not lie between 0 and 1.

    Notes
    -----
    The thesis interpolates amplitudes and leaves open what close frequencies do; both kept, they would beat.
    Lines left over from the pairing may still come closer than the threshold while they fade.

    References
    ----------
    `oeztuerk2018`, section 3.2 and Fig. 3.9.
    """
    if not 0 <= weight <= 1:
        raise ValueError(f"weight is {weight}. Expected 0 <= weight <= 1")
    i, j = pairs_closer_than_beats(slow.frequency_hz, fast.frequency_hz)
    turn = np.angle(np.exp(1j * (fast.phase[j] - slow.phase[i])))
    rows = [
        (
            (1 - weight) * slow.frequency_hz[i] + weight * fast.frequency_hz[j],
            (1 - weight) * slow.amplitude[i] + weight * fast.amplitude[j],
            slow.phase[i] + weight * turn,
        )
    ]
    for lines, paired, share in ((slow, i, 1 - weight), (fast, j, weight)):
        alone = np.setdiff1d(np.arange(lines.frequency_hz.size), paired)
        rows.append((lines.frequency_hz[alone], share * lines.amplitude[alone], lines.phase[alone]))
    f, A, phi = (np.concatenate(column) for column in zip(*rows, strict=True))
    order = np.argsort(f, kind="stable")
    order = order[A[order] > 0]
    return MajorFrequencies(f[order], A[order], phi[order])


def pairs_closer_than_beats(f: Samples, g: Samples) -> tuple[list[int], list[int]]:
    """Return indices of frequencies of `f` and `g` that are closer than the beat threshold, one to one."""
    gap = np.abs(f[:, np.newaxis] - g)
    gap[gap >= beat_threshold_hz(np.minimum(f[:, np.newaxis], g))] = np.inf
    i, j = [], []
    while gap.size and np.isfinite(gap.min()):
        row, column = divmod(int(np.argmin(gap)), g.size)
        i.append(row)
        j.append(column)
        gap[row], gap[:, column] = np.inf, np.inf
    return i, j
