"""Detection of recordings without contact: no vibration, or only the noise of the sensor."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from texclass.phases import find_phases
from texclass.recording import Phases, Recording, Samples

MIN_LEVEL = 0.25
"""Smallest level of a contact, relative to the lowest level of the training recordings.

12 dB: in the study `later_recordings`, no later recording of a trained surface was so much quieter.
"""
N_BANDS = 8
"""Number of frequency bands of the spread."""
FIRST_BIN = 0.02
"""Lowest frequency of the bands, relative to half the sampling rate; below it, sensors drift."""
FLATNESS_DB = 0.5
"""Spread of the spectrum of sensor noise in dB, in addition to the random spread of white noise."""
N_DEVIATIONS = 4.0
"""Standard deviations by which the spread of white noise may exceed its mean."""
CORRELATED_BINS = 1.94
"""Variance of a sum of bins of a Hann spectrum of white noise, relative to that of independent bins."""
MAX_TRAINING_SPREAD = 0.9
"""Largest spread of noise, relative to the smallest spread of the training recordings."""
N_PER_SURFACE = 3
"""Number of training recordings of each surface from which the limits are determined."""


class Vibration(NamedTuple):
    """Level and spectrum of the analysed part of a recording.

    Attributes
    ----------
    level : float
        Standard deviation of the acceleration without its linear trend, root of the sum over axes.
    spread : float
        Standard deviation of the band levels of the acceleration and the turn rate in dB; infinite if the
        recording is too short.
    noise_spread : float
        Largest spread of white noise of this length in dB.
    """

    level: float
    spread: float
    noise_spread: float


class ContactLimits(NamedTuple):
    """Lowest level and smallest spread of training recordings.

    A recording has no contact if its level is far below these recordings, or its spectrum is that of white
    noise. Coloured noise of a higher level cannot be distinguished from a surface.

    Attributes
    ----------
    level : float
        Lowest level, in the unit of the acceleration.
    spread : float
        Smallest spread in dB.
    """

    level: float
    spread: float

    @classmethod
    def from_recordings(cls, recordings: Iterable[Recording]) -> "ContactLimits | None":
        """Return the limits of training recordings; None if none of them has a tap or a movement."""
        values = [measure_vibration(one, find_phases(one)) for one in recordings]
        contacts = [one for one in values if one is not None and one.level > 0]
        if not contacts:
            return None
        return cls(min(one.level for one in contacts), min(one.spread for one in contacts))

    def problem(self, recording: Recording, phases: Phases) -> str:
        """Return the reason why a recording has no contact; empty if it has one."""
        vibration = measure_vibration(recording, phases)
        if vibration is None:
            return "no contact: neither a tap nor a movement was found"
        if vibration.level < MIN_LEVEL * self.level:
            return (
                f"no contact: the level of the vibration is {vibration.level:.2g} {recording.unit}, trained "
                f"on {self.level:.2g} {recording.unit} and more"
            )
        if vibration.spread <= min(vibration.noise_spread, MAX_TRAINING_SPREAD * self.spread):
            return (
                f"no contact: the spectrum is flat like sensor noise (band levels differ by "
                f"{vibration.spread:.2g} dB, trained on {self.spread:.2g} dB and more)"
            )
        return ""


def measure_vibration(recording: Recording, phases: Phases) -> Vibration | None:
    """Return level and spread of the movement of a recording, or of its taps; None if it has neither.

    For white noise, the level of each band is a mean of m independent bins, so its standard deviation is
    10 / (ln 10 sqrt(m)) dB.

    Parameters
    ----------
    recording : Recording
        Recording.
    phases : Phases
        Its taps and movement.

    Examples
    --------
    >>> noise = Recording(np.random.default_rng(0).standard_normal(4000), fs=1000.0)
    >>> vibration = measure_vibration(noise, Phases(movement=(0, 4000)))
    >>> round(vibration.level, 1), vibration.spread < vibration.noise_spread
    (1.0, True)
    """
    spans = [phases.movement] if phases.movement else [(tap.impact, tap.end) for tap in phases.taps]
    if not spans:
        return None
    acceleration = _detrended(recording.acceleration, spans)
    signals = [acceleration]
    turn_rate = recording.with_interpolated("turn_rate").turn_rate
    if turn_rate is not None:
        signals.append(_detrended(turn_rate, spans))
    level = float(np.sqrt((acceleration**2).mean(axis=0).sum()))
    columns = np.concatenate(signals, axis=1)
    power = np.abs(np.fft.rfft(columns * np.hanning(len(columns))[:, None], axis=0)) ** 2
    power = power[max(1, round(FIRST_BIN * len(power))) :]
    n_bins = len(power) / N_BANDS / CORRELATED_BINS
    if n_bins < 1:
        return Vibration(level, np.inf, 0.0)
    bands = np.array([band.mean(axis=0) for band in np.array_split(power, N_BANDS)])
    decibels = 10 * np.log10(bands[:, bands.min(axis=0) > 0])
    if not decibels.size:
        return Vibration(level, np.inf, 0.0)
    variance = (10 / np.log(10)) ** 2 / n_bins + FLATNESS_DB**2
    deviation = np.sqrt(2 / ((N_BANDS - 1) * decibels.shape[1]))
    spread = float(np.sqrt(decibels.var(axis=0, ddof=1).mean()))
    return Vibration(level, spread, float(np.sqrt(variance * (1 + N_DEVIATIONS * deviation))))


def _detrended(signals: Samples, spans: list[tuple[int, int]]) -> Samples:
    """Return spans of signals (n_samples, n_channels) without their linear trends, concatenated."""
    from scipy.signal import detrend

    columns = signals.reshape(len(signals), -1)
    return np.concatenate([detrend(columns[start:stop], axis=0) for start, stop in spans if stop > start])
