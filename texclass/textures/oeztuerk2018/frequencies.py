"""The second method: major frequencies at a few speeds, followed from each recorded speed to the next."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, NamedTuple, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.recording import Samples
from texclass.signals import positive
from texclass.textures.oeztuerk2018 import _kernels as kernels
from texclass.textures.oeztuerk2018.speeds import (
    GLIDE_S,
    PEAK_FACTOR,
    STILL,
    checked_signals,
    place_of,
    rising_speeds,
)
from texclass.textures.path import checked_path
from texclass.textures.stored import check_all_names, number, numbers, text
from texclass.vibration import MajorFrequencies, fit_major_frequencies
from texclass.vibration.major_frequencies import at_speed, pairs_closer_than_beats

N_FREQUENCIES = 13
"""`oeztuerk2018`, sections 5.3 and 7: 12 to 14 are enough."""
Scale = Literal["peak", "rms", "none"]


class Tracks(NamedTuple):
    """Lines followed through the recorded speeds, shape (n_speeds, n_tracks) each; phase (n_tracks,)."""

    frequency_hz: Samples
    amplitude: Samples
    phase: Samples


@dataclass(frozen=True, eq=False)
class FrequencyTexture:
    """Major frequencies of one surface at rising speeds; between them amplitudes go linearly.

    Parameters
    ----------
    speeds : array_like of shape (n_speeds,)
        Recorded speeds, mm/s, two or more.
    models : sequence of MajorFrequencies
        One a speed, in the unit of the recordings.
    peak : float
        Largest magnitude of the recordings.
    fs : float
        Sampling rate, Hz.
    name : str, optional
        Of the surface.

    Notes
    -----
    A frequency that has a partner closer than the beat threshold (Table 3.2) at the next speed glides to it;
    one that has none fades out. Outside the recorded speeds as `LpcTexture`.

    References
    ----------
    `oeztuerk2018`, section 3.2.
    """

    family: ClassVar[str] = "oeztuerk2018-frequencies"
    speeds: Samples
    models: tuple[MajorFrequencies, ...]
    peak: float
    fs: float
    name: str = ""
    tracks: Tracks = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "speeds", rising_speeds(self.speeds))
        object.__setattr__(self, "models", tuple(self.models))
        positive(self.fs, "fs")
        positive(self.peak, "peak")
        if len(self.models) != self.speeds.size or not any(m.frequency_hz.size for m in self.models):
            raise ValueError(
                f"there are {len(self.models)} models for speeds {self.speeds}; the rule is one for each, "
                "with a frequency in one of them at least"
            )
        with np.errstate(over="ignore"):
            largest = max(float(m.amplitude.sum()) for m in self.models)
        if not np.isfinite(largest):
            raise ValueError(f"amplitudes add up to {largest}; the rule is a finite sum")
        object.__setattr__(self, "tracks", follow_lines(self.models))

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample: 8 a line (its cosine counted as one)."""
        return 8.0 * self.tracks.phase.size

    def at(self, speed: float) -> MajorFrequencies:
        """Return the frequencies at a speed (mm/s)."""
        place_of(speed, self.speeds)
        return at_speed(self.models, self.speeds, speed)

    def signal(self, speed: float, n_samples: int, *, seed: int = 0) -> Samples:
        """Return the vibration at a constant speed (mm/s), shape (n_samples,); nothing in it is random."""
        return self.at(speed).synthesize(n_samples, self.fs)

    def renderer(self, *, seed: int = 0) -> "FrequencyRenderer":
        """Return a renderer at rest; it has no noise, so the seed changes nothing."""
        return FrequencyRenderer(self)

    def parameters(self) -> Mapping[str, Any]:
        """Return what is not an array."""
        return {"name": self.name, "fs": self.fs, "peak": self.peak}

    def arrays(self) -> Mapping[str, NDArray[np.float64]]:
        """Return speeds (mm/s), lines per speed, and all lines: frequency (Hz), amplitude, phase (rad)."""
        lines = {
            name: np.concatenate([getattr(m, name) for m in self.models])
            for name in ("frequency_hz", "amplitude", "phase")
        }
        n_lines = np.array([m.frequency_hz.size for m in self.models], dtype=np.float64)
        return {"speeds": self.speeds, "n_lines": n_lines, **lines}

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the texture that was written down; a ValueError says what is wrong with it."""
        lines = ("frequency_hz", "amplitude", "phase")
        names = {"name", "fs", "peak"}, {"speeds", "n_lines", *lines}
        check_all_names(cls.family, parameters, arrays, names)
        n, columns = numbers(arrays, "n_lines", 1), [numbers(arrays, line, 1) for line in lines]
        sizes = [column.size for column in columns]
        if np.any(n < 0) or np.any(n % 1 != 0) or any(size != n.sum() for size in sizes):
            raise ValueError(f"n_lines is {n} for {sizes} values; the rule is whole numbers, as many in sum")
        ends = np.cumsum(n.astype(int))[:-1]
        models = zip(*(np.split(column, ends) for column in columns), strict=True)
        return cls(
            numbers(arrays, "speeds", 1),
            tuple(MajorFrequencies(*one) for one in models),
            number(parameters, "peak"),
            number(parameters, "fs"),
            text(parameters, "name"),
        )


def fit_frequencies(
    signals: Sequence[ArrayLike],
    speeds: ArrayLike,
    fs: float,
    *,
    n_frequencies: int = N_FREQUENCIES,
    name: str = "",
    scale: Scale = "peak",
) -> FrequencyTexture:
    """Fit the texture to recordings of one surface at two or more speeds.

    Parameters
    ----------
    signals : sequence of array_like, each of shape (n_samples,)
        One recording a speed, any one unit; lengths may differ. Means are removed.
    speeds : array_like of shape (n_speeds,)
        mm/s, rising.
    fs : float
        Sampling rate, Hz.
    n_frequencies : int
        Lines per recording, at most.
    name : str, optional
        Of the surface.
    scale : {"peak", "rms", "none"}
        What of each recording the sum of its lines is scaled to: its largest magnitude as in the thesis (a
        few lines alone would be too weak), its RMS, or nothing.

    Raises
    ------
    ValueError
        As `checked_signals` and `fit_major_frequencies`, and for an unknown scale.

    References
    ----------
    `oeztuerk2018`, eqs. (3.13) to (3.16), Table 3.2.
    """
    if scale not in get_args(Scale):
        raise ValueError(f"scale is {scale!r}; the rule is one of {get_args(Scale)}")
    found, v = checked_signals(signals, speeds)
    models = [_scaled(fit_major_frequencies(x, fs, n_frequencies=n_frequencies), x, fs, scale) for x in found]
    return FrequencyTexture(v, tuple(models), max(float(np.abs(x).max()) for x in found), fs, name)


def follow_lines(models: Sequence[MajorFrequencies]) -> Tracks:
    """Follow every line to its partner at the next speed, as `interpolate` pairs them.

    A track without a line at some speed has amplitude 0 there and keeps the frequency of its nearest line, so
    that linear interpolation between two speeds is that of `interpolate`.
    """
    tracks: list[dict[int, int]] = []
    current: dict[int, int] = {}  # line of this speed -> its track
    for i, model in enumerate(models):
        before, current = current, {}
        if i:
            j, k = pairs_closer_than_beats(models[i - 1].frequency_hz, model.frequency_hz)
            current = {line: before[partner] for partner, line in zip(j, k, strict=True)}
        for line in range(model.frequency_hz.size):
            if line not in current:
                current[line] = len(tracks)
                tracks.append({})
            tracks[current[line]][i] = line
    return _table(models, tracks)


def _table(models: Sequence[MajorFrequencies], tracks: list[dict[int, int]]) -> Tracks:
    """Return the tables of tracks that are given as line by speed."""
    f, A = np.zeros((2, len(models), len(tracks)))
    phase = np.zeros(len(tracks))
    for j, lines in enumerate(tracks):
        known = sorted(lines)
        f[:, j] = np.interp(np.arange(len(models)), known, [models[i].frequency_hz[lines[i]] for i in known])
        A[known, j] = [models[i].amplitude[lines[i]] for i in known]
        phase[j] = models[known[0]].phase[lines[known[0]]]
    return Tracks(f, A, phase)


class FrequencyRenderer:
    """Plays a `FrequencyTexture` along a path with oscillators whose phases never jump; see `Renderer`."""

    def __init__(self, texture: FrequencyTexture) -> None:
        self.fs = texture.fs
        f, A, self._start = texture.tracks
        self._omega = 2 * np.pi * np.minimum(f / texture.fs, 0.5)
        self._amplitude = np.where(f < texture.fs / 2, A, 0.0)
        self._speeds = texture.speeds
        self._still = STILL * float(texture.speeds[0])
        self._glide = -float(np.expm1(-1 / (GLIDE_S * texture.fs)))
        self._limit = PEAK_FACTOR * texture.peak
        self._phase = np.empty(self._start.size)
        self._state = np.empty(kernels.N_STATES)
        self.reset()

    def reset(self) -> None:
        """Return to rest, with the phases of the recordings."""
        self._phase[:] = self._start
        self._state[:] = kernels.UNKNOWN, 0.0, 0.0

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples; the position is not used."""
        v, f = checked_path(velocity, force)
        out = np.empty(f.size)
        kernels.render_lines(
            v, f, self._speeds, self._omega, self._amplitude, self._still, self._glide, self._limit,
            self._state, self._phase, out,
        )  # fmt: skip
        return out


def _scaled(model: MajorFrequencies, x: Samples, fs: float, scale: Scale) -> MajorFrequencies:
    sum_of_lines = model.synthesize(x.size, fs)
    level = _measure(sum_of_lines, scale)
    gain = _measure(x, scale) / level if level > 0 else 1.0
    return MajorFrequencies(model.frequency_hz, gain * model.amplitude, model.phase)


def _measure(x: Samples, scale: Scale) -> float:
    match scale:
        case "peak":
            return float(np.max(np.abs(x)))
        case "rms":
            return float(np.std(x))
    return 1.0
