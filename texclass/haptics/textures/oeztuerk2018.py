"""Fit and render textures of `oeztuerk2018`: LPC models or major frequencies at a few speeds.

Models are interpolated between the speeds. `speed_intervals` returns the speed intervals, each with one
recording, that a surface needs according to its friction.
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
from texclass.haptics.textures.contract import NOMINAL_FORCE_N, Texture
from texclass.haptics.textures.grid import Grid
from texclass.haptics.textures.motion_renderer import MotionRenderer, ParameterMap
from texclass.recording import Samples
from texclass.signals import one_channel, positive
from texclass.vibration import Autoregression, MajorFrequencies, ModelBlend
from texclass.vibration.interpolation import Loudness
from texclass.vibration.major_frequencies import interpolate, match_close_frequencies

ORDER = 400
"""Default order of LPC models. `oeztuerk2018`, figure 3.2: more coefficients have minimal benefit."""
N_FREQUENCIES = 13
"""Default number of major frequencies. `oeztuerk2018`, sections 5.3 and 7: 12 to 14 are sufficient."""
FADE_FRACTION = 0.25
"""Fraction of the lowest recorded speed below which a texture fades linearly to silence (our choice)."""
PEAK_FACTOR = 3.0
"""Limit of rendered samples, as a multiple of the recorded peak; it clips Gaussian noise (our choice)."""
N_SUB = 16
"""Number of LPC models computed per interval of recorded speeds; k is linear between them."""
BIN_MM_S = 40.0
"""Width of a speed interval in mm/s: `oeztuerk2018`, figure 4.2."""
FRICTION = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
N_INTERVALS = (7, 5, 4, 3, 2, 2)
"""Number of speed intervals at each friction coefficient in `FRICTION`; `oeztuerk2018`, section 4.2."""
EXTREME_FRICTION = 1.2
"""Friction coefficient from which one interval is sufficient (our choice). The thesis describes its seventh
value as extreme, without stating it."""


@dataclass(frozen=True, eq=False)
class SpeedTexture(Texture):
    """Base class of textures with models at a few speeds and interpolation between them.

    Outside the range of recorded speeds, the nearest recording is used (no extrapolation). Below
    `FADE_FRACTION` times the lowest speed, the vibration fades to silence. Both are our choices.
    """

    family: ClassVar[str]
    speeds: Samples
    models: Any
    peak: float
    fs: float
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "speeds", _check_speeds(self.speeds))
        positive(self.fs, "fs")
        positive(self.peak, "peak")

    @cached_property
    def forces(self) -> Samples:
        """Nominal force in N; the models do not depend on the force."""
        return np.array([NOMINAL_FORCE_N])

    def fractional_index(self, speed: ArrayLike) -> Samples:
        """Return the fractional index (0 to n_speeds - 1) of speeds in mm/s among the recorded speeds."""
        v = np.asarray(speed, dtype=np.float64)
        if not np.all(np.isfinite(v) & (v >= 0)):
            raise ValueError(f"speed must be finite and at least 0 mm/s, got {speed!r}")
        return np.asarray(np.interp(v, self.speeds, np.arange(self.speeds.size)))

    @abstractmethod
    def signal(self, speed: float, n_samples: int, *, seed: int = 0) -> Samples:
        """Render `n_samples` samples at a constant speed in mm/s; `seed` is the seed of the noise."""

    def _make_renderer(self, parameter_map: ParameterMap, seed: int, **options: Any) -> MotionRenderer:
        """Return a renderer whose motion is the fractional index of the speed and a loudness from 0 to 1."""

        def motion(velocity: Samples, force: Samples) -> Samples:
            speed = np.hypot(velocity[:, 0], velocity[:, 1])
            loudness = np.minimum(speed / (FADE_FRACTION * self.speeds[0]), 1.0) * (force > 0)
            return np.column_stack([np.interp(speed, self.speeds, np.arange(self.speeds.size)), loudness])

        return MotionRenderer(
            parameter_map,
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
    """LPC models of one surface at increasing speeds, with linear interpolation of line spectra and log gain.

    Parameters
    ----------
    speeds : array_like of shape (n_speeds,)
        Recorded speeds in mm/s, at least two, increasing.
    models : Autoregression
        Models with leading shape (n_speeds,), in the unit of the recordings.
    peak : float
        Largest magnitude of the recordings.
    fs : float
        Sampling rate in Hz.
    name : str, optional
        Name of the surface.
    loudness : {"gain", "level"}
        Quantity that is interpolated in addition to the line spectra, see `ModelBlend`.

    References
    ----------
    `oeztuerk2018`, section 3.1.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> slow, fast = rng.standard_normal((2, 4000)) * [[1.0], [2.0]]
    >>> texture = fit_lpc([slow, fast], [50.0, 150.0], fs=1000, order=4)
    >>> texture.at([50.0, 100.0, 150.0]).level.round(1).tolist()
    [1.0, 1.4, 2.0]
    """

    family: ClassVar[str] = "oeztuerk2018-lpc"
    models: Autoregression
    loudness: Loudness = "gain"

    def __post_init__(self) -> None:
        super().__post_init__()
        k = self.models.reflection
        if k.ndim != 2 or k.shape[0] != self.speeds.size or k.shape[1] < 1:
            raise ValueError(
                f"models must have reflection coefficients of shape ({self.speeds.size}, order), one row "
                f"per speed, got {k.shape}"
            )
        with np.errstate(over="ignore"):
            if not np.all(np.isfinite(self.models.level)):
                raise ValueError(f"levels of the models must be finite, got {self.models.level}")
        _ = self._blend  # validates `loudness`

    @cached_property
    def _blend(self) -> ModelBlend:
        return ModelBlend(self.models, loudness=self.loudness)

    @property
    def order(self) -> int:
        """Order of the models."""
        return self.models.order

    @property
    def operations(self) -> float:
        """Operations per sample: 6 per stage, plus 6 per stage at each update of k."""
        return 6.0 * self.order + 6.0 * self.order / self.update_samples

    @property
    def update_samples(self) -> int:
        """Number of samples between two updates of k (1000 per second)."""
        return max(1, round(self.fs / 1000))

    def at(self, speed: ArrayLike) -> Autoregression:
        """Return the models at speeds (mm/s), with the shape of `speed`."""
        return self._at_index(self.fractional_index(speed))

    def signal(self, speed: float, n_samples: int, *, seed: int = 0) -> Samples:
        """Render `n_samples` samples at a constant speed in mm/s; `seed` is the seed of the noise."""
        return vibration.synthesize(self.at(speed), n_samples, np.random.default_rng(seed))

    @cached_property
    def grid(self) -> tuple[Samples, Samples]:
        """Reflection coefficients (n_rows, p) and levels (n_rows,), with `N_SUB` rows per speed interval."""
        n_rows = (self.speeds.size - 1) * N_SUB + 1
        models = self._at_index(np.arange(n_rows) / N_SUB)
        return np.ascontiguousarray(models.reflection), np.ascontiguousarray(models.level)

    def autoregressions(self, speed: Samples, force: Samples) -> Autoregression:
        """Return the models at speeds (n,); the forces have no effect."""
        return self.at(speed)

    def _at_index(self, index: ArrayLike) -> Autoregression:
        """Return the models at fractional indices (...), interpolated between the two nearest speeds."""
        distance = np.abs(np.asarray(index)[..., np.newaxis] - np.arange(self.speeds.size))
        return self._blend.at(np.maximum(1 - distance, 0.0))

    def renderer(self, *, seed: int = 0) -> MotionRenderer:
        """Return a renderer that fades in from silence; `seed` is the seed of the noise."""
        rows, levels = self.grid
        indices = np.arange(levels.size) / N_SUB
        nodes = Grid((indices,), rows)
        return self._make_renderer(
            lambda motion: (nodes.at_warped(motion[:, :1]), np.ones((len(motion), 1))),
            seed,
            order=self.order,
            hop=self.update_samples,
            factor=lambda motion: motion[:, 1] * np.interp(motion[:, 0], indices, levels),
            n_stationary=self.order,
        )

    def parameters(self) -> dict[str, Any]:
        """Return the fields that are not arrays; models are stored as reflection coefficients and gains."""
        return super().parameters() | {"models": {"reflection": None, "gain": None}}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return speeds (mm/s), reflection coefficients and gains."""
        stored = ("speeds", "models.reflection", "models.gain")
        return {name: array for name, array in super().arrays().items() if name in stored}


@dataclass(frozen=True, eq=False)
class FrequencyTexture(SpeedTexture):
    """Major frequencies of one surface at increasing speeds, with linear interpolation of amplitudes.

    Parameters
    ----------
    speeds : array_like of shape (n_speeds,)
        Recorded speeds in mm/s, at least two, increasing.
    models : sequence of MajorFrequencies
        One model per speed, in the unit of the recordings.
    peak : float
        Largest magnitude of the recordings.
    fs : float
        Sampling rate in Hz.
    name : str, optional
        Name of the surface.

    Notes
    -----
    If two lines at neighbouring speeds are closer than the beat threshold (Table 3.2), they form
    one line whose frequency changes from one to the other. A line without a partner fades out.

    References
    ----------
    `oeztuerk2018`, section 3.2.

    Examples
    --------
    >>> t = np.arange(1000) / 1000
    >>> slow, fast = np.sin(2 * np.pi * 100 * t), 2 * np.sin(2 * np.pi * 104 * t)
    >>> texture = fit_frequencies([slow, fast], [50.0, 150.0], fs=1000, n_frequencies=1)
    >>> middle = texture.at(100.0)
    >>> middle.frequency_hz.round(1).tolist(), middle.amplitude.round(1).tolist()
    ([102.0], [1.5])
    """

    family: ClassVar[str] = "oeztuerk2018-frequencies"
    models: tuple[MajorFrequencies, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "models", tuple(self.models))
        if len(self.models) != self.speeds.size or not any(m.frequency_hz.size for m in self.models):
            raise ValueError(
                f"models must have one entry per speed, and at least one frequency in total, got "
                f"{len(self.models)} models for speeds {self.speeds}"
            )
        with np.errstate(over="ignore"):
            largest = max(float(m.amplitude.sum()) for m in self.models)
        if not np.isfinite(largest):
            raise ValueError(f"the sum of the amplitudes must be finite, got {largest}")

    @cached_property
    def tracks(self) -> tuple[Samples, Samples, Samples]:
        """Lines tracked over speed, see `track_lines`."""
        return track_lines(self.models)

    @property
    def operations(self) -> float:
        """Operations per sample: 8 per line (a cosine counts as one operation)."""
        return 8.0 * self.tracks[2].size

    def at(self, speed: float) -> MajorFrequencies:
        """Return the major frequencies at a speed (mm/s), interpolated between the two nearest recordings."""
        index = float(self.fractional_index(speed))
        below = min(int(index), len(self.models) - 2)
        return interpolate(self.models[below], self.models[below + 1], index - below)

    def signal(self, speed: float, n_samples: int, *, seed: int = 0) -> Samples:
        """Render `n_samples` samples at a constant speed in mm/s; `seed` has no effect."""
        return self.at(speed).synthesize(n_samples, self.fs)

    def renderer(self, *, seed: int = 0) -> MotionRenderer:
        """Return a deterministic renderer with continuous phases; `seed` has no effect."""
        f, A, phase = self.tracks
        omega, amplitude = 2 * np.pi * np.minimum(f / self.fs, 0.5), np.where(f < self.fs / 2, A, 0.0)
        nodes = Grid((np.arange(float(self.speeds.size)),), np.hstack([omega, amplitude]))

        def parameter_map(motion: Samples) -> tuple[Samples, Samples]:
            values = nodes.at_warped(motion[:, :1])
            return values[:, : phase.size], values[:, phase.size :]

        return self._make_renderer(
            parameter_map, seed, hop=1, n_taps=0, phase=phase, factor=lambda motion: motion[:, 1]
        )


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
        One recording per speed, all in the same unit; lengths may differ. The means are removed.
    speeds : array_like of shape (n_speeds,)
        Speeds in mm/s, increasing.
    fs : float
        Sampling rate in Hz.
    order : int
        Order of the models (default 400).
    name, loudness
        See `LpcTexture`.

    Raises
    ------
    ValueError
        If the numbers of recordings and speeds differ, a recording is constant or not finite, the speeds are
        not positive and increasing, or `texclass.vibration.fit` rejects the order or a recording.

    References
    ----------
    `oeztuerk2018`, section 3.1. The thesis solves the Wiener-Hopf equations by Levinson's recursion. Burg's
    method needs no window and is more accurate for short recordings.

    Examples
    --------
    >>> slow, fast = np.random.default_rng(0).standard_normal((2, 2000))
    >>> texture = fit_lpc([slow, 3 * fast], [50.0, 150.0], fs=1000, order=4, name="noise")
    >>> texture.order, texture.signal(100.0, 500).shape
    (4, (500,))
    """
    v, recordings, peak = _check_recordings(signals, speeds)
    models = [vibration.fit(x, order) for x in recordings]
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

    As in the thesis, the sum of the lines is scaled to the peak of the recording, because a few lines have
    less power than the recording.

    Parameters
    ----------
    signals, speeds, fs, name
        See `fit_lpc`.
    n_frequencies : int
        Largest number of lines per recording (default 13).

    Raises
    ------
    ValueError
        If the recordings or speeds are invalid (see `fit_lpc`), or `fit_major_frequencies` rejects an
        argument.

    References
    ----------
    `oeztuerk2018`, eqs. (3.13) to (3.16), Table 3.2.

    Examples
    --------
    >>> t = np.arange(1000) / 1000
    >>> tones = [np.sin(2 * np.pi * 100 * t), 2 * np.sin(2 * np.pi * 200 * t)]
    >>> texture = fit_frequencies(tones, [50.0, 150.0], fs=1000, n_frequencies=1)
    >>> [model.frequency_hz.round(1).tolist() for model in texture.models]
    [[100.0], [200.0]]
    """
    v, recordings, peak = _check_recordings(signals, speeds)
    models = []
    for x in recordings:
        model = vibration.fit_major_frequencies(x, fs, n_frequencies=n_frequencies)
        largest = np.abs(model.synthesize(x.size, fs)).max()
        gain = np.abs(x).max() / largest if largest > 0 else 1.0
        models.append(replace(model, amplitude=gain * model.amplitude))
    return FrequencyTexture(v, tuple(models), peak, fs, name)


def _check_speeds(speeds: ArrayLike) -> Samples:
    v = np.array(one_channel(speeds, "speeds"))
    if v.size < 2 or v[0] <= 0 or np.any(np.diff(v) <= 0):
        raise ValueError(f"speeds must be at least two positive, increasing values, got {v}")
    v.setflags(write=False)
    return v


def _check_recordings(
    signals: Sequence[ArrayLike], speeds: ArrayLike
) -> tuple[Samples, list[Samples], float]:
    """Validate recordings; return speeds, recordings without their means, and the largest magnitude."""
    v = _check_speeds(speeds)
    if len(signals) != v.size:
        raise ValueError(f"signals and speeds must have the same length, got {len(signals)} and {v.size}")
    recordings = []
    for signal, speed in zip(signals, v, strict=True):
        x = one_channel(signal, f"recording at speed {speed:g}", at_least=3)
        x = x - x.mean()
        if not np.any(x):
            raise ValueError(f"the recording at speed {speed:g} is constant. Expected a vibration")
        recordings.append(x)
    return v, recordings, max(float(np.abs(x).max()) for x in recordings)


def track_lines(models: Sequence[MajorFrequencies]) -> tuple[Samples, Samples, Samples]:
    """Connect spectral lines at consecutive speeds to tracks, with the same pairs as in `interpolate`.

    At speeds where a track has no line, its amplitude is 0, and its frequency is the frequency of its nearest
    line. Linear interpolation between two speeds is then identical to `interpolate`.

    Parameters
    ----------
    models : sequence of MajorFrequencies
        Models at increasing speeds.

    Returns
    -------
    frequency_hz, amplitude : ndarray of shape (n_speeds, n_tracks)
        Frequency in Hz and amplitude of each track.
    phase : ndarray of shape (n_tracks,)
        Phase in rad at the first speed at which the track has a line.
    """
    tracks: list[dict[int, int]] = []  # for each track: index of the speed -> index of the line
    track_of: dict[int, int] = {}  # at one speed: index of the line -> index of the track
    for i, model in enumerate(models):
        previous, track_of = track_of, {}
        if i:
            slower, faster = match_close_frequencies(models[i - 1].frequency_hz, model.frequency_hz)
            track_of = {line: previous[partner] for partner, line in zip(slower, faster, strict=True)}
        for line in range(model.frequency_hz.size):
            if line not in track_of:
                track_of[line] = len(tracks)
                tracks.append({})
            tracks[track_of[line]][i] = line
    f, A = np.zeros((2, len(models), len(tracks)))
    phase = np.zeros(len(tracks))
    for j, lines in enumerate(tracks):
        present = list(lines)
        f[:, j] = np.interp(
            np.arange(len(models)), present, [models[i].frequency_hz[lines[i]] for i in present]
        )
        A[present, j] = [models[i].amplitude[lines[i]] for i in present]
        phase[j] = models[present[0]].phase[lines[present[0]]]
    return f, A, phase


# Number of signals that a surface needs ---------------------------------------------------------------------


@dataclass(frozen=True)
class SpeedIntervals:
    """Speed intervals, each of which is represented by one signal.

    Attributes
    ----------
    bounds_mm_s : tuple of float
        Increasing interval bounds in mm/s, n_intervals + 1 values from 0 to infinity.
    """

    bounds_mm_s: tuple[float, ...]

    @classmethod
    def equal(cls, n: int) -> "SpeedIntervals":
        """Return n intervals of 40 mm/s, except that the last one has no upper bound."""
        return cls((*(i * BIN_MM_S for i in range(n)), np.inf))

    @property
    def n_intervals(self) -> int:
        """Number of intervals."""
        return len(self.bounds_mm_s) - 1

    @property
    def centres_mm_s(self) -> tuple[float, ...]:
        """Centre of each interval in mm/s; for the last interval, the centre of its first 40 mm/s."""
        bounds = [*self.bounds_mm_s[:-1], self.bounds_mm_s[-2] + BIN_MM_S]
        return tuple((a + b) / 2 for a, b in pairwise(bounds))

    def __str__(self) -> str:
        edges = [f"{b / 10:g}" for b in self.bounds_mm_s[:-1]]
        return ", ".join([*(f"{a}-{b}" for a, b in pairwise(edges)), f"> {edges[-1]}"]) + " cm/s"


def speed_intervals(friction: float) -> SpeedIntervals:
    """Return the speed intervals that a surface needs according to its friction coefficient.

    Each interval is 40 mm/s wide; the last one has no upper bound. The thesis states the number of intervals
    for a few coefficients. Between two of these coefficients, the larger number is used, so that no signal is
    missing. From `EXTREME_FRICTION` on, one interval is used.

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
        raise ValueError(f"friction must be finite and at least 0, got {friction}")
    row = int(np.searchsorted(FRICTION, friction + 1e-9, side="right")) - 1
    return SpeedIntervals.equal(1 if friction >= EXTREME_FRICTION else N_INTERVALS[row])
