"""Recordings as a cheaper sensor would have given them: at a lower sampling rate, with fewer bits."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass.loaders.dataset import Dataset, Entry
from texclass.recording import AUXILIARY_UNITS, Phases, Recording, Samples, Tap


@dataclass(frozen=True)
class Degraded:
    """A dataset's `load` through a cheaper sensor; picklable when `load` is.

    Attributes
    ----------
    load
        Entry -> Recording.
    fs
        Sampling rate in Hz, at most the recording's; None keeps it.
    bits
        Of the acceleration's converter; None keeps what there is.
    full_scale
        Largest magnitude that the converter holds; what is beyond is clipped.
    """

    load: Callable[[Entry], Recording]
    fs: float | None = None
    bits: int | None = None
    full_scale: float = 1.0

    def __call__(self, entry: Entry) -> Recording:
        """Load one recording, resample it, then quantise it."""
        recording = self.load(entry)
        if self.fs is not None and self.fs < recording.fs:
            recording = resampled(recording, self.fs)
        if self.bits is not None:
            coarse = quantised(recording.acceleration, self.bits, self.full_scale)
            recording = recording.with_(acceleration=coarse)
        return recording


def degraded(
    dataset: Dataset, *, fs: float | None = None, bits: int | None = None, full_scale: float = 1.0
) -> Dataset:
    """Return a dataset as a cheaper sensor would have recorded it; see `Degraded`.

    Raises
    ------
    ValueError
        If the rate, the bits or the full scale is not above 0.
    """
    for name, value in (("fs", fs), ("bits", bits), ("full_scale", full_scale)):
        if value is not None and not 0 < value < np.inf:
            raise ValueError(f"{name} is {value!r}; the rule is above 0, and finite")
    how = f"{dataset.input_hash} fs {fs} bits {bits} of {full_scale}"
    return replace(
        dataset,
        load=Degraded(dataset.load, fs, bits, full_scale),
        input_hash=hashlib.sha256(how.encode()).hexdigest(),
    )


def quantised(x: Samples, bits: int, full_scale: float) -> Samples:
    """Return x on the levels of a converter: q round(x / q) with q = 2 full_scale / 2^bits, clipped.

    Parameters
    ----------
    x : ndarray
        Signal.
    bits : int
        Of the converter.
    full_scale : float
        It reaches from -full_scale to full_scale - q, in the unit of x.
    """
    q = 2 * full_scale / 2**bits
    return np.asarray(np.clip(q * np.round(x / q), -full_scale, full_scale - q))


def resampled(recording: Recording, fs: float) -> Recording:
    """Return a recording at a lower rate (Hz), declared phases and all.

    The spectrum is cut at the new fs/2, where an ideal anti-aliasing filter ends. The signal is continued
    by its mirror image, so that it does not jump at its ends.
    """
    n = max(1, round(recording.n_samples * fs / recording.fs))
    ratio = n / recording.n_samples
    signals = {name: getattr(recording, name) for name in ("acceleration", *AUXILIARY_UNITS)}
    changes: dict[str, Any] = {
        name: _cut_band(signal, n) for name, signal in signals.items() if signal is not None
    }
    return recording.with_(**changes, fs=ratio * recording.fs, phases=_scaled(recording.phases, ratio, n))


def _cut_band(x: Samples, n: int) -> Samples:
    # DCT-II is the Fourier transform of the signal and its mirror image; its first n bins lie below fs/2.
    spectrum = fft.dct(x, axis=0, norm="ortho")[:n]
    return np.asarray(fft.idct(spectrum, axis=0, norm="ortho") * np.sqrt(n / x.shape[0]))


def _scaled(phases: Phases | None, ratio: float, n: int) -> Phases | None:
    if phases is None:
        return None

    def at(sample: int) -> int:
        return min(n, round(sample * ratio))

    taps = tuple(
        Tap(at(t.start), at(t.impact), max(at(t.end), at(t.impact) + 1))
        for t in phases.taps
        if at(t.impact) < n
    )
    movement = None if phases.movement is None else (at(phases.movement[0]), at(phases.movement[1]))
    onset = None if phases.onset is None else at(phases.onset)
    return Phases(taps, movement, onset, phases.notes)


def full_scale_of(dataset: Dataset, n: int = 12) -> float:
    """Return a converter's full scale: the largest magnitude in `n` recordings spread over a dataset."""
    step = ceil(len(dataset) / n)
    peaks: list[NDArray[Any]] = [np.abs(dataset[i].acceleration).max() for i in range(0, len(dataset), step)]
    return float(max(peaks))
