"""Compensate the frequency response of a device, so that it plays the vibration of the surface.

The filter is the inverse of the response H, limited to a boost b above the filter gain at the frequency where
the device is most sensitive:

    |F(f)| = min(1 / |H(f)|, b / max |H|)

It is a minimum-phase FIR filter, so it adds no echo before a tap, and it also compensates the phase of
devices that are minimum-phase themselves, such as resonant actuators.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import signal

from texclass.haptics.exchange.external_files import read_limited
from texclass.haptics.exchange.rendition import Rendition
from texclass.recording import Samples

MAX_BOOST_DB = 20.0
"""Default limit of the boost in dB (our choice): ten times the amplitude."""
MAX_FILE_BYTES = 4 << 20
FILTER_S, MAX_TAPS = 0.25, 2047
"""Length of a filter in s, which resolves resonances 4 Hz apart, and its largest number of taps, with which a
browser can filter in real time."""
WEAK_DB = 40.0
"""Third-octave bands that are weaker than the strongest band by more than this (dB) are not compared."""


@dataclass(frozen=True, eq=False)
class Equalizer:
    """Inverse of the frequency response of a device, with a limited boost.

    Parameters
    ----------
    frequency_hz : ndarray of shape (n,)
        Increasing, positive frequencies in Hz. Below the first and above the last frequency, the response is
        assumed to be constant.
    gain : ndarray of shape (n,)
        Magnitude of the response: vibration of the device relative to the requested vibration.
    max_boost_db : float
        Largest boost in dB, relative to the filter gain at the frequency where the device is most sensitive
        (default 20).

    Raises
    ------
    ValueError
        If the frequencies do not increase, a gain is not positive, or the boost is not between 0 and 100 dB.

    Examples
    --------
    >>> equalizer = Equalizer(np.array([50.0, 100.0, 200.0]), np.array([0.5, 1.0, 0.01]))
    >>> equalizer.target_gain([50.0, 100.0, 200.0]).round(2).tolist()
    [2.0, 1.0, 10.0]
    """

    frequency_hz: Samples
    gain: Samples
    max_boost_db: float = MAX_BOOST_DB

    def __post_init__(self) -> None:
        hz, gain = self.frequency_hz, self.gain
        values = np.concatenate([hz, gain])
        is_valid = hz.size == gain.size >= 2 and np.all(np.isfinite(values) & (values > 0))
        if not is_valid or np.any(np.diff(hz) <= 0):
            raise ValueError(
                "a response must have at least 2 rows of increasing, positive frequencies (Hz) and positive "
                f"gains, got frequencies {hz[:4].tolist()}... and gains {gain[:4].tolist()}..."
            )
        if not 0 <= self.max_boost_db <= 100:
            raise ValueError(f"the largest boost must be between 0 and 100 dB, got {self.max_boost_db:g} dB")

    def response(self, hz: Samples | list[float]) -> Samples:
        """Return the gain of the device at frequencies (n,) in Hz, linear in dB over log frequency."""
        x = np.log(np.maximum(hz, 1e-3 * self.frequency_hz[0]))
        return np.asarray(np.exp(np.interp(x, np.log(self.frequency_hz), np.log(self.gain))))

    def target_gain(self, hz: Samples | list[float]) -> Samples:
        """Return the intended gain of the filter at frequencies (n,) in Hz."""
        limit = 10 ** (self.max_boost_db / 20) / self.gain.max()
        return np.asarray(np.minimum(1 / self.response(hz), limit))

    def taps(self, fs: float) -> Samples:
        """Return the minimum-phase FIR filter (n_taps,) at a sampling rate in Hz."""
        return _design(self, fs)

    def gain_at(self, hz: Samples, fs: float) -> NDArray[np.complex128]:
        """Return the complex gain of the filter for sampling rate `fs` at frequencies (n,) in Hz."""
        return np.asarray(signal.freqz(self.taps(fs), worN=np.minimum(hz, fs / 2), fs=fs)[1])

    def apply(self, x: Samples, fs: float) -> Samples:
        """Filter samples (n, ...) along the first axis."""
        return np.asarray(signal.lfilter(self.taps(fs), [1.0], x, axis=0))

    def describe(self, x: Samples, fs: float) -> dict[str, str]:
        """Describe the remaining error on the device and the headroom for a vibration (n,), by topic."""
        y = self.apply(x, fs)
        if not np.any(x):
            return {"device": "silence"}
        original, equalized = (self._band_errors_db(x, played, fs) for played in (x, y))
        (rms, largest), (rms_before, largest_before) = (
            (np.sqrt(np.mean(errors**2)), np.abs(errors).max()) for errors in (equalized, original)
        )
        text = (
            f"third-octave levels on the device differ by {rms:.1f} dB RMS, at most {largest:.1f} dB "
            f"(without equalisation {rms_before:.1f} and {largest_before:.1f} dB)"
        )
        hz = np.geomspace(self.frequency_hz[0], self.frequency_hz[-1], 2000)
        hz = hz[hz < fs / 2]
        lack_db = -20 * np.log10(self.target_gain(hz) * self.response(hz))
        is_limited = lack_db > 0.05
        if is_limited.any():
            bounds = [f"{low:.0f} to {high:.0f} Hz" for low, high in _ranges(hz, is_limited)]
            text += (
                f"; the boost is limited to {self.max_boost_db:g} dB, so {', '.join(bounds)} stay up to "
                f"{lack_db.max():.1f} dB too weak"
            )
        low, high = self.frequency_hz[0], self.frequency_hz[-1]
        if high < fs / 2:
            text += f"; the response is known from {low:g} to {high:g} Hz and is assumed constant outside"
        headroom_db = 20 * math.log10(np.abs(y).max() / np.abs(x).max())
        return {"device": text, "headroom": f"the peak changes by {headroom_db:+.1f} dB through equalisation"}

    def _band_errors_db(self, x: Samples, played: Samples, fs: float) -> Samples:
        """Return the level errors in dB of a signal played by the device, in third-octave bands of x."""
        n = min(x.size, 1 << int(np.ceil(np.log2(FILTER_S * fs))))
        hz, wanted = signal.welch(x, fs, nperseg=n)
        device = signal.welch(played, fs, nperseg=n)[1] * self.response(hz) ** 2
        edges = np.geomspace(20.0, fs / 2, max(2, round(3 * np.log2(fs / 40.0)) + 1))
        rows = np.add.reduceat(np.stack([wanted, device]), np.unique(np.searchsorted(hz, edges[:-1])), axis=1)
        is_heard = rows[0] > rows[0].max() * 10 ** (-WEAK_DB / 10)
        return np.asarray(10 * np.log10(rows[1] / rows[0])[is_heard])


@lru_cache(maxsize=8)
def _design(equalizer: Equalizer, fs: float) -> Samples:
    n = min(2 * round(FILTER_S * fs / 2) + 1, MAX_TAPS)
    hz = np.linspace(0, fs / 2, 8 * n + 1)
    linear_phase = signal.firwin2(n, hz, equalizer.target_gain(hz), nfreqs=_power_of_two(8 * n) + 1, fs=fs)
    taps = signal.minimum_phase(linear_phase, n_fft=16 * _power_of_two(n), half=False)
    return np.asarray(taps)


def _power_of_two(n: int) -> int:
    return 1 << (n - 1).bit_length()


def _ranges(hz: Samples, is_inside: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return the first and last frequency of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], is_inside.astype(int), [0]])))
    return [(float(hz[i]), float(hz[j - 1])) for i, j in edges.reshape(-1, 2)]


def read_response(path: str | Path, max_boost_db: float = MAX_BOOST_DB) -> Equalizer:
    """Read the frequency response of a device from a CSV file.

    Parameters
    ----------
    path : str or Path
        CSV file with the columns `frequency` (Hz) and either `gain` (ratio) or `gain_db`.
    max_boost_db : float
        Largest boost in dB (default 20); see `Equalizer`.

    Raises
    ------
    ValueError
        If columns are missing or unknown, or a value is invalid.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "response.csv"
    >>> _ = path.write_text(chr(10).join(["frequency,gain_db", "50,-6", "150,0", "400,-12"]))
    >>> read_response(path).gain.round(2).tolist()
    [0.5, 1.0, 0.25]
    """
    path = Path(path)
    read_limited(path, MAX_FILE_BYTES)
    try:
        table = pd.read_csv(path, skipinitialspace=True, comment="#")
        if sorted(table.columns) not in (["frequency", "gain"], ["frequency", "gain_db"]):
            raise ValueError(
                "columns must be frequency (Hz) and gain (ratio) or gain_db, got "
                f"{', '.join(map(str, table.columns))}"
            )
        hz = table["frequency"].to_numpy(dtype=np.float64)
        is_db = "gain_db" in table
        gain = table["gain_db" if is_db else "gain"].to_numpy(dtype=np.float64)
        with np.errstate(over="ignore"):  # the equalizer refuses infinity
            return Equalizer(hz, 10 ** (gain / 20) if is_db else gain, max_boost_db)
    except (ValueError, TypeError, OverflowError) as error:  # pandas raises subclasses of ValueError
        raise ValueError(f"{path}: {error}") from error


def equalize(rendition: Rendition, equalizer: Equalizer) -> Rendition:
    """Filter a rendition for a device, and describe the remaining error.

    Parameters
    ----------
    rendition : Rendition
        Result of `texclass.haptics.exchange.play_texture` or `play_taps`.
    equalizer : Equalizer
        Result of `read_response`.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal(4000)
    >>> rendition = Rendition("noise", "m/s^2", 1000.0, x, speed=80.0, force=1.0)
    >>> equalizer = Equalizer(np.array([20.0, 500.0]), np.array([0.5, 0.5]))
    >>> bool(np.allclose(equalize(rendition, equalizer).samples, 2 * x, atol=1e-3))
    True
    """
    losses = dict(rendition.losses) | equalizer.describe(rendition.samples, rendition.fs)
    if rendition.pitch_mm:
        losses["device"] += f"; this holds at {rendition.speed:.4g} mm/s"
    lines, taps = rendition.lines.copy(), rendition.taps.copy()
    gain = equalizer.gain_at(lines[:, 0], rendition.fs)
    lines[:, 1] *= np.abs(gain)
    lines[:, 2] += np.angle(gain)
    taps[:, 1] *= np.abs(equalizer.gain_at(taps[:, 2], rendition.fs))
    samples = equalizer.apply(rendition.samples, rendition.fs)
    return replace(rendition, samples=samples, lines=lines, taps=taps, losses=losses)
