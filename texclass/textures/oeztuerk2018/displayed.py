"""What the thesis plays: one seamless signal for each interval of speed, chosen by friction."""

from dataclasses import dataclass
from pathlib import Path

from texclass.recording import Samples
from texclass.textures.oeztuerk2018.frequencies import FrequencyTexture
from texclass.textures.oeztuerk2018.intervals import SpeedIntervals, speed_intervals
from texclass.textures.oeztuerk2018.lpc import LpcTexture
from texclass.textures.oeztuerk2018.seamless import DURATION_S, N_COPIES, SampleFormat, seamless, write_wav


@dataclass(frozen=True, eq=False)
class DisplayedSignals:
    """A signal for each interval of speed.

    Attributes
    ----------
    intervals : SpeedIntervals
        By friction.
    speeds_mm_s : tuple of float
        The speed each signal was made for.
    signals : tuple of ndarray
        Seamless, in the unit of the recordings.
    fs : float
        Hz.
    """

    intervals: SpeedIntervals
    speeds_mm_s: tuple[float, ...]
    signals: tuple[Samples, ...]
    fs: float

    def write(self, folder: Path, stem: str, *, sample_format: SampleFormat = "FLOAT") -> list[Path]:
        """Write `stem`-1.wav, `stem`-2.wav, ... from slow to fast and return the paths."""
        paths = [folder / f"{stem}-{i + 1}.wav" for i in range(len(self.signals))]
        for path, x in zip(paths, self.signals, strict=True):
            write_wav(path, x, self.fs, sample_format=sample_format)
        return paths


def displayed_signals(
    texture: LpcTexture | FrequencyTexture,
    friction: float,
    *,
    duration_s: float = DURATION_S,
    peaks: tuple[float, ...] | None = None,
    seed: int = 0,
) -> DisplayedSignals:
    """Make one seamless signal for each interval of speed that a friction coefficient asks for.

    Parameters
    ----------
    texture : LpcTexture or FrequencyTexture
        Of the surface.
    friction : float
        Its kinetic friction coefficient.
    duration_s : float
        Of each signal: a tenth of it is synthesized, mirrored and repeated 5 times, as printed.
    peaks : tuple of float, optional
        Largest magnitude of the reference of each interval, to scale to; by default the signals stay as the
        texture makes them.
    seed : int
        Of the noise.

    References
    ----------
    `oeztuerk2018`, sections 3.2 and 6.1, Table 6.1.
    """
    intervals = speed_intervals(friction)
    if peaks is not None and len(peaks) != intervals.n_intervals:
        raise ValueError(
            f"there are {len(peaks)} peaks; the rule is {intervals.n_intervals}, one an interval"
        )
    n = max(1, round(duration_s * texture.fs / (2 * N_COPIES)))
    signals = [
        seamless(
            texture.signal(v, n, seed=seed + i),
            texture.fs,
            duration_s=duration_s,
            peak=None if peaks is None else peaks[i],
        )
        for i, v in enumerate(intervals.centres_mm_s)
    ]
    return DisplayedSignals(intervals, intervals.centres_mm_s, tuple(signals), texture.fs)
