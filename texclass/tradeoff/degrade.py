"""Recordings as a cheaper sensor would have given them: at a lower sampling rate, with fewer bits."""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass.loaders.dataset import Dataset, Entry
from texclass.recording import AUXILIARY_UNITS, Phases, Recording, Samples, Tap


def degraded(
    dataset: Dataset, *, fs: float | None = None, bits: int | None = None, full_scale: float = 1.0
) -> Dataset:
    """Return a dataset as a cheaper sensor would have recorded it.

    Parameters
    ----------
    dataset : Dataset
        As it was recorded.
    fs : float, optional
        Sampling rate in Hz; recordings that have a lower one keep it.
    bits : int, optional
        Of the acceleration's converter.
    full_scale : float
        Largest magnitude that the converter holds; what is beyond is clipped.

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
        load=partial(_degraded, dataset.load, fs, bits, full_scale),
        input_hash=hashlib.sha256(how.encode()).hexdigest(),
    )


def _degraded(
    load: Callable[[Entry], Recording], fs: float | None, bits: int | None, full_scale: float, entry: Entry
) -> Recording:
    recording = load(entry)
    if fs is not None and fs < recording.fs:
        recording = resampled(recording, fs)
    if bits is not None:
        recording = recording.with_(acceleration=quantised(recording.acceleration, bits, full_scale))
    return recording


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
    ratio, changes = n / recording.n_samples, dict[str, Any]()
    for name in ("acceleration", *AUXILIARY_UNITS):
        if (signal := getattr(recording, name)) is not None:
            # DCT-II is the Fourier transform of signal and mirror image; its first n bins lie below fs/2.
            spectrum = fft.dct(signal, axis=0, norm="ortho")[:n]
            changes[name] = fft.idct(spectrum, axis=0, norm="ortho") * np.sqrt(ratio)
    if (phases := recording.phases) is not None:

        def at(sample: int) -> int:
            return min(n, round(sample * ratio))

        kept = (tap for tap in phases.taps if at(tap.impact) < n)
        taps = tuple(
            Tap(at(t.start), at(t.impact), max(at(t.end), at(t.impact) + 1), at(t.width), t.quality)
            for t in kept
        )
        movement = phases.movement and (at(phases.movement[0]), at(phases.movement[1]))
        onset = None if phases.onset is None else at(phases.onset)
        changes["phases"] = Phases(taps, movement, onset, phases.notes)
    return recording.with_(**changes, fs=ratio * recording.fs)


def full_scale_of(dataset: Dataset, n: int = 12) -> float:
    """Return a converter's full scale: the largest magnitude in `n` recordings spread over a dataset."""
    step = ceil(len(dataset) / n)
    peaks: list[NDArray[Any]] = [np.abs(dataset[i].acceleration).max() for i in range(0, len(dataset), step)]
    return float(max(peaks))
