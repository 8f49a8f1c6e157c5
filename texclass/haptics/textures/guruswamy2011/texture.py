"""A surface as decaying responses at places along a line: features fixed in space, decay fixed in time.

The renderer's inner loop finds which features the tip passes and steps the modes that ring. A mode is a
rotating and shrinking phasor z, its contribution Re z, and a sample later it is z p: a section of second
order in coupled form. What rings lies in the first rows of a pool that is allocated once.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import ClassVar, Literal, get_args

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from texclass.haptics.textures.contract import NOMINAL_FORCE_N, Texture, freeze
from texclass.recording import Samples

Course = Literal["line", "travelled"]
_RANGES = (("fs", 1e-3, 1e9), ("length_mm", 1e-6, 1e9), ("origin_mm", -1e9, 1e9), ("peak", 1e-100, 1e100))
"""Beyond, places could no longer be told apart or squares overflow; a file may hold anything."""


@dataclass(frozen=True)
class LevelLaw:
    """RMS acceleration of a tool that strokes a surface: a_RMS = k_v v_t + k_c f + a_0.

    Attributes
    ----------
    k_v : float
        Speed factor, (m/s^2) / (m/s) = 1/s; at least 0.
    k_c : float
        Force factor, (m/s^2) / N; at least 0.
    a_0 : float
        Offset, m/s^2; at least 0. Not all three are 0.

    Raises
    ------
    ValueError
        For a factor that breaks its rule.

    References
    ----------
    `guruswamy2011`, eq. (2); with k_v = 0 eq. (1).
    """

    k_v: float
    k_c: float
    a_0: float

    def __post_init__(self) -> None:
        values = np.array([self.k_v, self.k_c, self.a_0])
        if not (np.all(np.isfinite(values)) and np.all(values >= 0) and np.any(values > 0)):
            raise ValueError(f"{self}. Expected finite, at least 0, and not all 0")

    def rms(self, speed: ArrayLike, force: ArrayLike) -> Samples:
        """Return a_RMS (m/s^2) at a speed in mm/s and a force in N."""
        v_t = np.asarray(speed, dtype=np.float64) / 1000
        return np.asarray(self.k_v * v_t + self.k_c * np.asarray(force, dtype=np.float64) + self.a_0)


@dataclass(frozen=True)
class Amplitude:
    """The factor A_k of eq. (5) at a speed and a force: 1 where the surface was scanned.

    Attributes
    ----------
    law : LevelLaw
    speed : float
        Of the scan, mm/s, above 0.
    force : float
        Of the scan, N, at least 0.
    compensated : bool
        Whether faster strokes, which meet more features per second, are weakened for that, see `factor`.
    limit : float
        Largest factor, above 0.

    Raises
    ------
    ValueError
        If speed, force or limit break their rule, or the law is 0 there.
    """

    law: LevelLaw
    speed: float
    force: float
    compensated: bool = True
    limit: float = 4.0

    def __post_init__(self) -> None:
        values = np.array([self.speed, self.force, self.limit])
        if not (np.all(np.isfinite(values)) and self.speed > 0 and self.force >= 0 and self.limit > 0):
            raise ValueError(
                f"speed, force, limit are {self.speed} mm/s, {self.force} N, {self.limit}. "
                "Expected above 0, at least 0, above 0"
            )
        with np.errstate(over="ignore"):
            level = float(self.law.rms(self.speed, self.force))
        if not 0 < level < np.inf:
            raise ValueError(
                f"{self.law} is {level} at {self.speed} mm/s, {self.force} N. Expected finite, above 0"
            )

    def factor(self, speed: ArrayLike, force: ArrayLike) -> Samples:
        """Return A = a_RMS(v, f) / a_RMS(v_0, f_0) sqrt(v_0 / max(v, v_0)), at most `limit`.

        Eq. (2) is a law of the RMS of the whole vibration. Responses that overlap add in power, so a stroke
        twice as fast has sqrt(2) times the RMS without any change of amplitude; the root takes that back, and
        the rendered vibration obeys eq. (2). Without `compensated` it is left out, as the paper may be read.
        Slower than the scan the features stand alone and keep the amplitude of the law.
        """
        v = np.asarray(speed, dtype=np.float64)
        A = self.law.rms(v, force) / self.law.rms(self.speed, self.force)
        if self.compensated:
            A = A * np.sqrt(self.speed / np.maximum(v, self.speed))
        return np.minimum(A, self.limit)


@dataclass(frozen=True, eq=False)
class SpatialTexture(Texture):
    """Features along a line, each of which makes the tool ring in its modes when the tip passes it.

    F(t) = sum_k A_k h_k(t - t_k): t_k is when the tip passes x_k, and A_k follows speed and force at that
    moment (`Amplitude`). What rings goes on as it began, whatever speed and force do afterwards.

    Parameters
    ----------
    name : str
        Of the surface.
    fs : float
        Rate at which it was scanned and is rendered, Hz: between samples a fit says nothing. For another rate
        the scan is resampled first.
    length_mm : float
        Of the scanned line, which is repeated.
    position_mm : array_like of shape (n_features,)
        x_k, rising, in [0, length_mm); at least 1.
    feature : array_like of shape (n_modes,)
        Index of the feature that each mode belongs to, rising.
    frequency_hz, decay_per_s, amplitude, phase : array_like of shape (n_modes,)
        h_k(t) = sum A exp(-B t) cos(2 pi f t + phi) over its modes, as in `DecayingModes`.
    scaling : Amplitude
        Law of level, and the speed and force at which the amplitudes hold.
    peak : float
        Largest magnitude of the scanned profile, in the unit of the amplitudes.
    direction : array_like of shape (2,)
        Unit vector of the line on the surface.
    course : {"line", "travelled"}
        What the tip's coordinate is. "line": its position along `direction`. A return stroke meets the same
        features in reverse order, a stroke across none: grooves. "travelled": the length of its path, so that
        strokes of all directions feel alike and a return stroke meets further features: grains.
    origin_mm : float
        Where x = 0 lies: position along `direction`. Without effect for "travelled".

    Raises
    ------
    ValueError
        If a shape or value breaks its rule.

    Notes
    -----
    Passed in reverse, a feature rings as it did forwards: the ring is the tool's own, begins when the feature
    is met, and never runs backwards in time; of the other flank a scan in one direction knows nothing.

    References
    ----------
    `guruswamy2011`, section III, eq. (5).
    """

    family: ClassVar[str] = "guruswamy2011"
    name: str
    fs: float
    length_mm: float
    position_mm: Samples
    feature: Samples
    frequency_hz: Samples
    decay_per_s: Samples
    amplitude: Samples
    phase: Samples
    scaling: Amplitude
    peak: float
    direction: Samples
    course: Course = "line"
    origin_mm: float = 0.0

    def __post_init__(self) -> None:
        columns = "feature", "frequency_hz", "decay_per_s", "amplitude", "phase"
        modes = dict.fromkeys(columns, ("n_modes",))
        freeze(self, position_mm=("n_features",), **modes, direction=(2,))
        x, owner, f, A = self.position_mm, self.feature, self.frequency_hz, self.amplitude
        rising = np.all(owner == np.round(owner)) and np.all(np.diff(owner) >= 0)
        on_line = x.size and np.all(np.diff(x) >= 0) and x[0] >= 0 and x[-1] < self.length_mm
        owned = rising and np.all((owner >= 0) & (owner < x.size))
        audible = np.all((f >= 0) & (f <= self.fs / 2) & (self.decay_per_s > 0))
        rules = [
            (least <= getattr(self, name) <= most, name, f"{least:g} to {most:g}")
            for name, least, most in _RANGES
        ]
        rules += [
            (self.course in get_args(Course), "course", f"one of {get_args(Course)}"),
            (on_line, "position_mm", f"at least 1, rising, in [0, {self.length_mm:g})"),
            (abs(np.hypot(*self.direction) - 1) < 1e-6, "direction", "a unit vector"),
            (owned, "feature", f"whole numbers, rising, in [0, {x.size})"),
            (audible, "frequency_hz", "0 <= f <= fs/2, and B > 0 with each"),
            (np.all((A >= 0) & (1e9 * self.peak >= A)), "amplitude", "0 <= A <= 1e9 peaks"),
        ]
        for kept, name, rule in rules:
            if not kept:
                raise ValueError(f"texture {self.name!r}: {name} is {getattr(self, name)}. Expected {rule}")

    @cached_property
    def speeds(self) -> Samples:
        """Half and twice the speed of the scan, mm/s."""
        return self.scaling.speed * np.array([0.5, 2.0])

    @cached_property
    def forces(self) -> Samples:
        """Half and twice the force of the scan, N; about a usual one where the scan has none."""
        return (self.scaling.force or NOMINAL_FORCE_N) * np.array([0.5, 2.0])

    @property
    def n_features(self) -> int:
        """How many features the line has."""
        return int(self.position_mm.size)

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample at the scan's speed: ten for each mode that rings."""
        with np.errstate(over="ignore"):  # of modes that ring for ever, or drown all others
            loud = np.maximum(self.amplitude / (SILENT * self.peak), 1.0)
            ring_s = float(np.sum(np.log(loud) / self.decay_per_s))
        return 30.0 + 10.0 * ring_s * self.scaling.speed / self.length_mm

    def renderer(self, *, seed: int = 0) -> "SpatialRenderer":
        """Return a renderer at rest at the texture's rate; nothing is random, so the seed has no effect."""
        return SpatialRenderer(self)


@dataclass(frozen=True, eq=False)
class SinusoidTexture(SpatialTexture):
    """The baseline: one decaying sinusoid per feature, A exp(-beta t) sin(omega t).

    References
    ----------
    `guruswamy2011`, eq. (3) and (4), after `okamura2001`.
    """

    family: ClassVar[str] = "guruswamy2011-sinusoid"


# Rendering --------------------------------------------------------------------------------------------------

N_RINGING = 512
"""Modes that can ring at once; the weakest give way."""
SILENT = 1e-3
"""Part of the recorded peak below which a mode has decayed."""
LARGEST_OUTPUT = 8.0
"""The output stays within that many times the recorded peak."""
PLAY_MM = 0.1
"""A tip that turns round feels nothing for that long: it may rest on a feature and tremble."""


class SpatialRenderer:
    """Renders a `SpatialTexture` for any path, sample by sample, without allocating but for the result.

    A sample costs one step for each mode that rings, however many features the surface has (a binary search
    among them when one is passed). At most `N_RINGING` modes ring and at most four features are struck within
    a sample, those nearest to the tip: that bounds the cost of a sample at any speed. A feature passed
    between two samples begins at the later one, as printed. No feature is struck without contact.

    Parameters
    ----------
    texture : SpatialTexture

    Attributes
    ----------
    fs : float
        Hz.
    """

    def __init__(self, texture: "SpatialTexture") -> None:
        self.fs = texture.fs
        scaling = texture.scaling
        law = scaling.law
        here = scaling.speed, scaling.force, scaling.compensated, scaling.limit
        self._law = np.array([law.k_v, law.k_c, law.a_0, *here], float)
        quiet, loud = SILENT * texture.peak, LARGEST_OUTPUT * texture.peak
        course, line = texture.course == "travelled", (*texture.direction, texture.origin_mm)
        self._setting = np.array([texture.fs, texture.length_mm, *line, course, PLAY_MM, quiet, loud], float)
        self._position = np.array(texture.position_mm)
        owners = np.arange(texture.n_features + 1)
        self._first = np.searchsorted(texture.feature, owners).astype(np.int64)
        start = texture.amplitude * np.exp(1j * texture.phase)
        p = np.exp((-texture.decay_per_s + 2j * np.pi * texture.frequency_hz) / texture.fs)
        self._modes = np.column_stack([start.real, start.imag, p.real, p.imag])
        self._pool = np.zeros((N_RINGING, 4))
        self._counts = np.zeros(3, np.int64)
        self._where = np.zeros(4)
        self.reset()

    @property
    def n_ringing(self) -> int:
        """How many modes ring now."""
        return int(self._counts[Count.RINGING])

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples of a path, see `texclass.haptics.textures.Renderer`.

        Raises
        ------
        ValueError
            If the shapes do not fit, or a value is NaN, infinite or beyond 1e9; the state is then unchanged.
        """
        v, f = _block(velocity), _block(force)
        path = np.empty((0, 2)) if position is None else _block(position)
        n = f.size
        if f.ndim != 1 or v.shape != (n, 2) or (position is not None and path.shape != (n, 2)):
            raise ValueError(
                f"velocity {v.shape}, force {f.shape}, position {path.shape}. Expected (n, 2), (n,), (n, 2)"
            )
        out = np.empty(n)
        if not render(
            v, f, path, out, self._setting, self._law,
            self._position, self._first, self._modes, self._pool, self._counts, self._where,
        ):  # fmt: skip
            raise ValueError(f"a velocity, force or position is NaN or beyond {LARGEST:g}. Expected less")
        return out

    def reset(self) -> None:
        """Return to rest: nothing rings, the next sample is the first."""
        self._counts[:] = 0
        self._where[:] = 0.0


def _block(values: ArrayLike) -> Samples:
    array = np.ascontiguousarray(values, dtype=np.float64)
    return array if array.flags.writeable else array.copy()  # one compiled version serves all


Counts = NDArray[np.int64]


class Count(IntEnum):
    """Places in `counts`: modes in the pool, the next feature along x, whether there was a sample."""

    RINGING, NEXT, STARTED = range(3)


LARGEST = 1e9
"""Of any input: velocity in mm/s, force in N, position in mm."""


@njit(cache=True, error_model="numpy")
def locate(s: float, position: Samples, length: float) -> int:
    """Return how many features lie before s on the surface repeated with period `length`."""
    turn = np.floor(s / length)
    return int(turn) * position.size + int(np.searchsorted(position, s - turn * length))


@njit(cache=True, error_model="numpy")
def place_of(k: int, position: Samples, length: float) -> float:
    """Return the coordinate of feature k of the repeated surface."""
    turn = k // position.size
    return float(turn * length + position[k - turn * position.size])


@njit(cache=True, error_model="numpy")
def factor(speed: float, force: float, law: Samples) -> float:
    """Return A of `Amplitude.factor`; law: k_v, k_c, a_0, v_0, f_0, compensated, limit."""
    here = law[0] * speed / 1000 + law[1] * force + law[2]
    A = here / (law[0] * law[3] / 1000 + law[1] * law[4] + law[2])
    if law[5] != 0 and speed > law[3]:
        A *= np.sqrt(law[3] / speed)
    return float(min(A, law[6]))


@njit(cache=True, error_model="numpy")
def strike(k: int, A: float, first: Counts, modes: Samples, pool: Samples, counts: Counts) -> None:
    """Put the modes of a feature into the pool, (re, im, and by what they turn and shrink a sample).

    A full pool gives up its weakest mode for a stronger one.
    """
    for m in range(first[k], first[k + 1]):
        re, im = A * modes[m, 0], A * modes[m, 1]
        row = counts[Count.RINGING]
        if row < pool.shape[0]:
            counts[Count.RINGING] += 1
        else:
            row, least = -1, re * re + im * im
            for i in range(pool.shape[0]):
                power = pool[i, 0] * pool[i, 0] + pool[i, 1] * pool[i, 1]
                if power < least:
                    row, least = i, power
            if row < 0:
                continue
        pool[row] = re, im, modes[m, 2], modes[m, 3]


@njit(cache=True, error_model="numpy")
def ring(pool: Samples, counts: Counts, silent: float) -> float:
    """Return the sum of what rings now, and step every mode; those below `silent` leave the pool."""
    total = 0.0
    i = 0
    while i < counts[Count.RINGING]:
        re, im = pool[i, 0], pool[i, 1]
        total += re
        if re * re + im * im < silent * silent:
            counts[Count.RINGING] -= 1
            pool[i] = pool[counts[Count.RINGING]]
            continue
        pool[i, 0], pool[i, 1] = re * pool[i, 2] - im * pool[i, 3], re * pool[i, 3] + im * pool[i, 2]
        i += 1
    return total


@njit(cache=True, error_model="numpy")
def advance(
    now: float, A: float, position: Samples, length: float,
    first: Counts, modes: Samples, pool: Samples, counts: Counts,
) -> None:  # fmt: skip
    """Strike the features between the last coordinate of the tip and this one; x <= now are behind it."""
    n = position.size
    k = counts[Count.NEXT]
    if place_of(k, position, length) > now and place_of(k - 1, position, length) <= now:
        return
    end = locate(now, position, length)
    while place_of(end, position, length) <= now:
        end += 1
    if A > 0:
        # at most four, those nearest to the tip
        low, high = (max(k, end - 4), end) if end > k else (end, min(k, end + 4))
        for j in range(low, high):
            strike(j % n, A, first, modes, pool, counts)
    counts[Count.NEXT] = end


@njit(cache=True, error_model="numpy")
def render(
    velocity: Samples, force: Samples, path: Samples, out: Samples, setting: Samples, law: Samples,
    position: Samples, first: Counts, modes: Samples, pool: Samples, counts: Counts, where: Samples,
) -> bool:  # fmt: skip
    """Render a block into `out`; False, and nothing done, if an input is NaN, infinite or too large.

    setting: fs, length of the surface, direction x and y, origin along it, travelled (0 or 1), play, silent,
    largest output. where: coordinate of the tip, that with play, last position.
    `path` is empty where the velocity is to be summed up.
    """
    fs, length, along_x, along_y, origin, travelled, play, silent, largest = setting
    given = path.shape[0] > 0
    for t in range(force.size):
        ok = abs(velocity[t, 0]) <= LARGEST and abs(velocity[t, 1]) <= LARGEST and abs(force[t]) <= LARGEST
        if not ok or (given and not (abs(path[t, 0]) <= LARGEST and abs(path[t, 1]) <= LARGEST)):
            return False
    for t in range(force.size):
        place, felt, last_x, last_y = where
        if given:
            x, y = path[t, 0], path[t, 1]
        elif counts[Count.STARTED] == 0:
            x, y = 0.0, 0.0
        else:
            x, y = last_x + velocity[t, 0] / fs, last_y + velocity[t, 1] / fs
        if counts[Count.STARTED] == 0:
            s = 0.0 if travelled != 0 else x * along_x + y * along_y - origin
            felt = s
            counts[Count.NEXT] = locate(s, position, length)
        elif travelled != 0:
            s = place + np.sqrt((x - last_x) ** 2 + (y - last_y) ** 2)
        else:
            s = x * along_x + y * along_y - origin
        counts[Count.STARTED] = 1
        felt = min(max(felt, s), s + play)
        speed = np.sqrt(velocity[t, 0] ** 2 + velocity[t, 1] ** 2)
        A = factor(speed, force[t], law) if force[t] > 0 else 0.0
        advance(felt, A, position, length, first, modes, pool, counts)
        where[0], where[1], where[2], where[3] = s, felt, x, y
        out[t] = min(max(ring(pool, counts, silent), -largest), largest)
    return True
