"""Textures of oeztuerk2018, between recordings at a few speeds: LPC models, or major frequencies.

How many speeds a surface needs, its friction tells: `speed_intervals`.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass import vibration
from texclass.haptics.textures.contract import USUAL_N, Texture
from texclass.haptics.textures.grid import Grid
from texclass.haptics.textures.motion_renderer import MotionRenderer, Read
from texclass.recording import Samples
from texclass.signals import one_channel, positive
from texclass.vibration import Autoregression, MajorFrequencies, ModelBlend
from texclass.vibration.interpolation import Loudness
from texclass.vibration.major_frequencies import interpolate, pairs_closer_than_beats

ORDER = 400
"""`oeztuerk2018`, figure 3.2: beyond it additional coefficients have minimal benefit."""
N_FREQUENCIES = 13
"""`oeztuerk2018`, sections 5.3 and 7: 12 to 14 are enough."""
STILL = 0.25
"""Below this part of the slowest recorded speed a texture fades linearly to silence at rest."""
PEAK_FACTOR = 3.0
"""No rendered sample exceeds this times the largest recorded one: ours, to bound Gaussian noise."""
N_SUB = 16
"""LPC models laid out between two recorded speeds; between these k moves linearly."""
BIN_MM_S = 40.0
"""`oeztuerk2018`, figure 4.2: bins of 4 cm/s."""
FRICTION = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
N_INTERVALS = (7, 5, 4, 3, 2, 2)
"""`oeztuerk2018`, section 4.2: intervals at each of these coefficients."""
EXTREME = 1.2
"""From here on 1 interval. The thesis calls its seventh coefficient extreme and does not print it."""


@dataclass(frozen=True, eq=False)
class SpeedTexture(Texture):
    """A model of one surface at each of a few speeds, and what lies between them.

    Slower than the slowest and faster than the fastest recording, that one holds (nothing is extrapolated);
    below `STILL` of the slowest speed the vibration fades to silence at rest. Both are our readings.
    """

    family: ClassVar[str]
    speeds: Samples
    models: Any
    peak: float
    fs: float
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "speeds", _rising(self.speeds))
        positive(self.fs, "fs")
        positive(self.peak, "peak")

    @cached_property
    def forces(self) -> Samples:
        """One usual force, N: the models depend on none."""
        return np.array([USUAL_N])

    def place(self, speed: ArrayLike) -> Samples:
        """Return where speeds (mm/s) lie among the recorded ones, 0 ... n_speeds - 1, held at both ends."""
        v = np.asarray(speed, dtype=np.float64)
        if not np.all(np.isfinite(v) & (v >= 0)):
            raise ValueError(f"speed is {speed!r}. Expected a finite number of at least 0")
        return np.asarray(np.interp(v, self.speeds, np.arange(self.speeds.size)))

    @abstractmethod
    def signal(self, speed: float, n_samples: int, *, seed: int = 0) -> Samples:
        """Return the vibration at a constant speed (mm/s), shape (n_samples,); the seed is that of noise."""

    def _rendered(self, read: Read, seed: int, **options: Any) -> MotionRenderer:
        """Return a renderer that follows (place, loudness): among the speeds, and 0 without contact ... 1."""

        def motion(velocity: Samples, force: Samples) -> Samples:
            speed = np.hypot(velocity[:, 0], velocity[:, 1])
            loudness = np.minimum(speed / (STILL * self.speeds[0]), 1.0) * (force > 0)
            return np.column_stack([np.interp(speed, self.speeds, np.arange(self.speeds.size)), loudness])

        return MotionRenderer(
            read,
            fs=self.fs,
            limit=PEAK_FACTOR * self.peak,
            seed=seed,
            motion=motion,
            start=(np.nan, 0.0),
            motion_hz=1 / (2 * np.pi * 0.01),  # a time constant of 10 ms
            glide=False,
            **options,
        )


@dataclass(frozen=True, eq=False)
class LpcTexture(SpeedTexture):
    """LPC models of one surface at rising speeds; between them line spectra and log gain go linearly.

    Parameters
    ----------
    speeds : array_like of shape (n_speeds,)
        Recorded speeds, mm/s, two or more.
    models : Autoregression
        Of leading shape (n_speeds,) and one order, in the unit of the recordings.
    peak : float
        Largest magnitude of the recordings.
    fs : float
        Sampling rate, Hz.
    name : str, optional
        Of the surface.
    loudness : {"gain", "level"}
        What is mixed beside the line spectra, see `ModelBlend`.

    References
    ----------
    `oeztuerk2018`, section 3.1.
    """

    family: ClassVar[str] = "oeztuerk2018-lpc"
    models: Autoregression
    loudness: Loudness = "gain"

    def __post_init__(self) -> None:
        super().__post_init__()
        k = self.models.reflection
        if k.ndim != 2 or k.shape[0] != self.speeds.size or k.shape[1] < 1:
            raise ValueError(
                f"models have reflection {k.shape}. Expected ({self.speeds.size}, order), one a speed"
            )
        with np.errstate(over="ignore"):
            if not np.all(np.isfinite(self.models.level)):
                raise ValueError(f"levels are {self.models.level}. Expected finite ones")
        _ = self._blend  # refuses an unknown loudness

    @cached_property
    def _blend(self) -> ModelBlend:
        return ModelBlend(self.models, loudness=self.loudness)

    @property
    def order(self) -> int:
        """The order of the models."""
        return self.models.order

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample: 6 a stage, and 6 a stage each time k is renewed."""
        return 6.0 * self.order + 6.0 * self.order / self.update_samples

    @property
    def update_samples(self) -> int:
        """Samples between two renewals of k, 1000 a second."""
        return max(1, round(self.fs / 1000))

    def at(self, speed: ArrayLike) -> Autoregression:
        """Return the models at speeds (mm/s), of their shape."""
        return self._at_places(self.place(speed))

    def signal(self, speed: float, n_samples: int, *, seed: int = 0) -> Samples:
        """Return the vibration at a constant speed (mm/s), shape (n_samples,)."""
        return vibration.synthesize(self.at(speed), n_samples, np.random.default_rng(seed))

    @cached_property
    def grid(self) -> tuple[Samples, Samples]:
        """Reflection coefficients (n_rows, p) and levels (n_rows,) at `N_SUB` places an interval."""
        n_rows = (self.speeds.size - 1) * N_SUB + 1
        models = self._at_places(np.arange(n_rows) / N_SUB)
        return np.ascontiguousarray(models.reflection), np.ascontiguousarray(models.level)

    def autoregressions(self, speed: Samples, force: Samples) -> Autoregression:
        """Return the models at speeds (n,), whatever the force."""
        return self.at(speed)

    def _at_places(self, place: ArrayLike) -> Autoregression:
        """Return the models at places (...) among the speeds, 0 ... n_speeds - 1: of two neighbours."""
        distance = np.abs(np.asarray(place)[..., np.newaxis] - np.arange(self.speeds.size))
        return self._blend.at(np.maximum(1 - distance, 0.0))

    def renderer(self, *, seed: int = 0) -> MotionRenderer:
        """Return a renderer at rest; the seed is that of the noise."""
        rows, levels = self.grid
        places = np.arange(levels.size) / N_SUB
        nodes = Grid((places,), rows)
        return self._rendered(
            lambda course: (nodes.at_warped(course[:, :1]), np.ones((len(course), 1))),
            seed,
            order=self.order,
            hop=self.update_samples,
            factor=lambda course: course[:, 1] * np.interp(course[:, 0], places, levels),
            n_drawn=self.order,
        )

    def parameters(self) -> dict[str, Any]:
        """Return what is not an array; of the models all follows from reflection coefficients and gains."""
        return super().parameters() | {"models": {"reflection": None, "gain": None}}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return speeds (mm/s), reflection coefficients and gains."""
        kept = ("speeds", "models.reflection", "models.gain")
        return {name: array for name, array in super().arrays().items() if name in kept}


@dataclass(frozen=True, eq=False)
class FrequencyTexture(SpeedTexture):
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
    one that has none fades out.

    References
    ----------
    `oeztuerk2018`, section 3.2.
    """

    family: ClassVar[str] = "oeztuerk2018-frequencies"
    models: tuple[MajorFrequencies, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "models", tuple(self.models))
        if len(self.models) != self.speeds.size or not any(m.frequency_hz.size for m in self.models):
            raise ValueError(
                f"there are {len(self.models)} models for speeds {self.speeds}. Expected one for each, "
                "with a frequency in one of them at least"
            )
        with np.errstate(over="ignore"):
            largest = max(float(m.amplitude.sum()) for m in self.models)
        if not np.isfinite(largest):
            raise ValueError(f"amplitudes add up to {largest}. Expected a finite sum")

    @cached_property
    def tracks(self) -> tuple[Samples, Samples, Samples]:
        """The lines followed through the speeds, see `follow_lines`."""
        return follow_lines(self.models)

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample: 8 a line (its cosine counted as one)."""
        return 8.0 * self.tracks[2].size

    def at(self, speed: float) -> MajorFrequencies:
        """Return the frequencies at a speed (mm/s): between those of the two nearest recordings."""
        place = float(self.place(speed))
        below = min(int(place), len(self.models) - 2)
        return interpolate(self.models[below], self.models[below + 1], place - below)

    def signal(self, speed: float, n_samples: int, *, seed: int = 0) -> Samples:
        """Return the vibration at a constant speed (mm/s), shape (n_samples,); nothing in it is random."""
        return self.at(speed).synthesize(n_samples, self.fs)

    def renderer(self, *, seed: int = 0) -> MotionRenderer:
        """Return a renderer at rest, whose oscillators' phases never jump; nothing is random in it."""
        f, A, phase = self.tracks
        omega, amplitude = 2 * np.pi * np.minimum(f / self.fs, 0.5), np.where(f < self.fs / 2, A, 0.0)
        nodes = Grid((np.arange(float(self.speeds.size)),), np.hstack([omega, amplitude]))

        def read(course: Samples) -> tuple[Samples, Samples]:
            found = nodes.at_warped(course[:, :1])
            return found[:, : phase.size], found[:, phase.size :]

        return self._rendered(read, seed, hop=1, n_taps=0, phase=phase, factor=lambda course: course[:, 1])


def fit_lpc(
    signals: Sequence[ArrayLike],
    speeds: ArrayLike,
    fs: float,
    *,
    order: int = ORDER,
    name: str = "",
    loudness: Loudness = "gain",
) -> LpcTexture:
    """Fit LPC models to recordings of one surface at two or more speeds, by Burg's method.

    Parameters
    ----------
    signals : sequence of array_like, each of shape (n_samples,)
        One recording a speed, any one unit; lengths may differ. Means are removed.
    speeds : array_like of shape (n_speeds,)
        mm/s, rising.
    fs : float
        Sampling rate, Hz.
    order : int
        Of the models.
    name, loudness
        As for `LpcTexture`.

    Raises
    ------
    ValueError
        If there is not one recording for each speed, one holds NaN, infinity or no change, the speeds do not
        rise from above 0, or as `texclass.vibration.fit`.

    References
    ----------
    `oeztuerk2018`, section 3.1; the thesis solves the Wiener-Hopf equations by Levinson's recursion, Burg's
    method smears the ends of short recordings less.
    """
    v, found, peak = _checked(signals, speeds)
    models = [vibration.fit(x, order) for x in found]
    stack = Autoregression(np.stack([m.reflection for m in models]), np.stack([m.gain for m in models]))
    return LpcTexture(v, stack, peak, fs, name, loudness)


def fit_frequencies(
    signals: Sequence[ArrayLike],
    speeds: ArrayLike,
    fs: float,
    *,
    n_frequencies: int = N_FREQUENCIES,
    name: str = "",
) -> FrequencyTexture:
    """Fit major frequencies to recordings of one surface at two or more speeds.

    The sum of the lines of each recording is scaled to its largest magnitude, as in the thesis: a few lines
    alone would be too weak.

    Parameters
    ----------
    signals, speeds, fs, name
        As for `fit_lpc`.
    n_frequencies : int
        Lines per recording, at most.

    Raises
    ------
    ValueError
        As `fit_lpc` and `fit_major_frequencies`.

    References
    ----------
    `oeztuerk2018`, eqs. (3.13) to (3.16), Table 3.2.
    """
    v, found, peak = _checked(signals, speeds)
    models = []
    for x in found:
        model = vibration.fit_major_frequencies(x, fs, n_frequencies=n_frequencies)
        made = np.abs(model.synthesize(x.size, fs)).max()
        gain = np.abs(x).max() / made if made > 0 else 1.0
        models.append(replace(model, amplitude=gain * model.amplitude))
    return FrequencyTexture(v, tuple(models), peak, fs, name)


def _rising(speeds: ArrayLike) -> Samples:
    v = np.array(one_channel(speeds, "speeds"))
    if v.size < 2 or v[0] <= 0 or np.any(np.diff(v) <= 0):
        raise ValueError(f"speeds are {v}. Expected two or more, above 0 and rising")
    v.setflags(write=False)
    return v


def _checked(signals: Sequence[ArrayLike], speeds: ArrayLike) -> tuple[Samples, list[Samples], float]:
    """Return speeds, recordings without their means, and the largest magnitude of these; or a ValueError."""
    v = _rising(speeds)
    if len(signals) != v.size:
        raise ValueError(f"there are {len(signals)} recordings and {v.size} speeds. Expected one for each")
    found = [one_channel(x, f"recording at speed {u:g}", at_least=3) for x, u in zip(signals, v, strict=True)]
    found = [x - x.mean() for x in found]
    for x, u in zip(found, v, strict=True):
        if not np.any(x):
            raise ValueError(f"the recording at speed {u:g} is constant. Expected a vibration")
    return v, found, max(float(np.abs(x).max()) for x in found)


def follow_lines(models: Sequence[MajorFrequencies]) -> tuple[Samples, Samples, Samples]:
    """Follow every line to its partner at the next speed, as `interpolate` pairs them.

    A track without a line at some speed has amplitude 0 there and keeps the frequency of its nearest line, so
    that linear interpolation between two speeds is that of `interpolate`.

    Returns
    -------
    frequency_hz, amplitude : ndarray of shape (n_speeds, n_tracks)
    phase : ndarray of shape (n_tracks,)
        At the first speed that has the line, rad.
    """
    tracks: list[dict[int, int]] = []  # each: speed -> line
    track_of: dict[int, int] = {}  # of the lines of one speed
    for i, model in enumerate(models):
        before, track_of = track_of, {}
        if i:
            slower, faster = pairs_closer_than_beats(models[i - 1].frequency_hz, model.frequency_hz)
            track_of = {line: before[partner] for partner, line in zip(slower, faster, strict=True)}
        for line in range(model.frequency_hz.size):
            if line not in track_of:
                track_of[line] = len(tracks)
                tracks.append({})
            tracks[track_of[line]][i] = line
    f, A = np.zeros((2, len(models), len(tracks)))
    phase = np.zeros(len(tracks))
    for j, lines in enumerate(tracks):
        known = list(lines)
        f[:, j] = np.interp(np.arange(len(models)), known, [models[i].frequency_hz[lines[i]] for i in known])
        A[known, j] = [models[i].amplitude[lines[i]] for i in known]
        phase[j] = models[known[0]].phase[lines[known[0]]]
    return f, A, phase


# How many signals a surface needs ---------------------------------------------------------------------------


@dataclass(frozen=True)
class SpeedIntervals:
    """Speeds for each of which one signal is displayed.

    Attributes
    ----------
    bounds_mm_s : tuple of float
        Rising, from 0 to infinity: n_intervals + 1 of them.
    """

    bounds_mm_s: tuple[float, ...]

    @classmethod
    def equal(cls, n: int) -> "SpeedIntervals":
        """Return n intervals of 40 mm/s, the last one open."""
        return cls((*(i * BIN_MM_S for i in range(n)), np.inf))

    @property
    def n_intervals(self) -> int:
        """How many signals are needed."""
        return len(self.bounds_mm_s) - 1

    @property
    def centres_mm_s(self) -> tuple[float, ...]:
        """A speed for each interval: its middle, for the last that of its first 40 mm/s."""
        bounds = [*self.bounds_mm_s[:-1], self.bounds_mm_s[-2] + BIN_MM_S]
        return tuple((a + b) / 2 for a, b in pairwise(bounds))

    def __str__(self) -> str:
        edges = [f"{b / 10:g}" for b in self.bounds_mm_s[:-1]]
        return ", ".join([*(f"{a}-{b}" for a, b in pairwise(edges)), f"> {edges[-1]}"]) + " cm/s"


def speed_intervals(friction: float) -> SpeedIntervals:
    """Return the intervals for a friction coefficient: 40 mm/s each, the last one open.

    At the coefficients of the thesis their number is its own; between two of them the larger one, so that
    never a signal is lacking; 1 from `EXTREME` on.

    Parameters
    ----------
    friction : float
        Kinetic friction coefficient.

    Raises
    ------
    ValueError
        If the coefficient is negative, NaN or infinite.

    References
    ----------
    `oeztuerk2018`, chapter 4 and Table 6.1.

    Examples
    --------
    >>> print(speed_intervals(0.4))
    0-4, 4-8, 8-12, > 12 cm/s
    """
    if not (np.isfinite(friction) and friction >= 0):
        raise ValueError(f"friction is {friction}. Expected a finite number of at least 0")
    known = int(np.searchsorted(FRICTION, friction + 1e-9, side="right")) - 1
    return SpeedIntervals.equal(1 if friction >= EXTREME else N_INTERVALS[known])
