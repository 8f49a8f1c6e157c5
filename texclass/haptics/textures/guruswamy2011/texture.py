"""Define and render spatial textures: responses at fixed positions along a line that decay over time.

The inner loop of the renderer finds the features that the tip passes, and advances the active modes. A mode
is a rotating and decaying phasor z: it contributes Re z to the output, and its next value is z p (a
second-order section in coupled form). Active modes are the first rows of a preallocated pool.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import ClassVar, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.compilation import njit
from texclass.haptics.textures.contract import NOMINAL_FORCE_N, Texture, freeze
from texclass.haptics.textures.motion_renderer import MAX_INPUT
from texclass.recording import Samples

Course = Literal["line", "travelled"]
_RANGES = (("fs", 1e-3, 1e9), ("length_mm", 1e-6, 1e9), ("origin_mm", -1e9, 1e9), ("peak", 1e-100, 1e100))
"""Allowed ranges of values, within which positions are distinct and squares do not overflow."""


@dataclass(frozen=True)
class LevelLaw:
    """RMS acceleration of a tool that strokes a surface (level law): a_RMS = k_v v_t + k_c f + a_0.

    Attributes
    ----------
    k_v : float
        Speed factor in (m/s^2) / (m/s) = 1/s, at least 0.
    k_c : float
        Force factor in (m/s^2) / N, at least 0.
    a_0 : float
        Offset in m/s^2, at least 0. At least one of the three factors must be positive.

    Raises
    ------
    ValueError
        If a factor is negative or not finite, or all are 0.

    References
    ----------
    `guruswamy2011`, eq. (2); with k_v = 0 eq. (1).

    Examples
    --------
    >>> float(LevelLaw(k_v=20.0, k_c=0.5, a_0=0.25).rms(speed=50.0, force=1.0))
    1.75
    """

    k_v: float
    k_c: float
    a_0: float

    def __post_init__(self) -> None:
        values = np.array([self.k_v, self.k_c, self.a_0])
        if not (np.all(np.isfinite(values)) and np.all(values >= 0) and np.any(values > 0)):
            raise ValueError(
                f"factors must be finite and non-negative, and at least one must be positive, got {self}"
            )

    def rms(self, speed: ArrayLike, force: ArrayLike) -> Samples:
        """Return a_RMS (m/s^2) at a speed in mm/s and a force in N."""
        v_t = np.asarray(speed, dtype=np.float64) / 1000
        return np.asarray(self.k_v * v_t + self.k_c * np.asarray(force, dtype=np.float64) + self.a_0)


@dataclass(frozen=True)
class Amplitude:
    """Factor A_k of eq. (5) as a function of speed and force, which is 1 at the speed and force of the scan.

    Attributes
    ----------
    law : LevelLaw
        Level law.
    speed : float
        Speed of the scan in mm/s, positive.
    force : float
        Force of the scan in N, at least 0.
    compensated : bool
        Whether to compensate for the higher feature rate of faster strokes, see `factor`.
    limit : float
        Largest factor, positive (default 4).

    Raises
    ------
    ValueError
        If speed, force or limit is invalid, or the level at this speed and force is 0.

    Examples
    --------
    >>> amplitude = Amplitude(LevelLaw(k_v=0.0, k_c=2.0, a_0=0.0), speed=20.0, force=0.5)
    >>> amplitude.factor([20.0, 20.0, 80.0], [0.5, 1.0, 1.0]).tolist()
    [1.0, 2.0, 1.0]
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
                "speed and limit must be positive and force at least 0, got speed "
                f"{self.speed} mm/s, limit {self.limit} and force {self.force} N"
            )
        with np.errstate(over="ignore"):
            level = float(self.law.rms(self.speed, self.force))
        if not 0 < level < np.inf:
            raise ValueError(
                f"the level of {self.law} must be finite and positive at {self.speed} mm/s and "
                f"{self.force} N, got {level}"
            )

    def factor(self, speed: ArrayLike, force: ArrayLike) -> Samples:
        """Return A = a_RMS(v, f) / a_RMS(v_0, f_0) sqrt(v_0 / max(v, v_0)), at most `limit`.

        Eq. (2) describes the RMS of the whole vibration. The powers of overlapping responses add up, so at
        equal amplitudes, a stroke at twice the speed has sqrt(2) times the RMS. The square root compensates
        for this: the rendered vibration satisfies eq. (2). If `compensated` is False, the square root is
        omitted, which is another interpretation of the paper. Below the speed of the scan, features do not
        overlap, and no compensation is needed.
        """
        v = np.asarray(speed, dtype=np.float64)
        A = self.law.rms(v, force) / self.law.rms(self.speed, self.force)
        if self.compensated:
            A = A * np.sqrt(self.speed / np.maximum(v, self.speed))
        return np.minimum(A, self.limit)


@dataclass(frozen=True, eq=False)
class SpatialTexture(Texture):
    """Features along a line, each of which excites decaying modes when the tip passes it.

    The vibration is F(t) = sum_k A_k h_k(t - t_k), where t_k is the time at which the tip passes x_k. A_k
    depends on speed and force at t_k (`Amplitude`); later changes do not affect the response.

    Parameters
    ----------
    name : str
        Name of the surface.
    fs : float
        Sampling rate of the scan and of the rendered vibration in Hz. Modes are functions of time, so
        `dataclasses.replace(texture, fs=1000.0)` renders at another rate, at least twice their frequencies.
    length_mm : float
        Length of the scanned line in mm; the line is repeated periodically.
    position_mm : array_like of shape (n_features,)
        Positions x_k in mm, at least one, increasing, in [0, length_mm).
    feature : array_like of shape (n_modes,)
        Index of the feature of each mode, non-decreasing.
    frequency_hz, decay_per_s, amplitude, phase : array_like of shape (n_modes,)
        Frequency f, decay rate B, amplitude A and phase phi of each mode, see `DecayingModes`. The response
        is h_k(t) = sum A exp(-B t) cos(2 pi f t + phi) over the modes of feature k.
    scaling : Amplitude
        Level law, and speed and force of the scan.
    peak : float
        Largest magnitude of the filtered vibration of the scan, in the unit of the amplitudes.
    direction : array_like of shape (2,)
        Unit vector of the line on the surface.
    course : {"line", "travelled"}
        Coordinate of the tip. "line" (default): position along `direction`, for example for grooves. A return
        stroke passes the same features in reverse order; a perpendicular stroke passes none. "travelled":
        length of the path, for example for grains. All directions are equivalent, and a return stroke passes
        new features.
    origin_mm : float
        Position of x = 0 along `direction` in mm; ignored for "travelled".

    Raises
    ------
    ValueError
        If a shape or a value is invalid.

    Notes
    -----
    A feature has the same response in both directions, because the response is a property of the tool, and a
    scan in one direction contains no information about the other flank.

    References
    ----------
    `guruswamy2011`, section III, eq. (5).

    Examples
    --------
    >>> scaling = Amplitude(LevelLaw(k_v=20.0, k_c=0.5, a_0=0.25), speed=20.0, force=0.5)
    >>> modes = {"frequency_hz": [60.0], "decay_per_s": [30.0], "amplitude": [2.0], "phase": [-1.57]}
    >>> texture = SpatialTexture("ridge", 500.0, 5.0, [1.0], [0], **modes, scaling=scaling, peak=2.0,
    ...                          direction=[1.0, 0.0])
    >>> vibration = texture.renderer().process([[20.0, 0.0]] * 100, [0.5] * 100)
    >>> int(np.flatnonzero(vibration)[0])
    25
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
        is_sorted = np.all(owner == np.round(owner)) and np.all(np.diff(owner) >= 0)
        is_on_line = x.size and np.all(np.diff(x) >= 0) and x[0] >= 0 and x[-1] < self.length_mm
        is_index = is_sorted and np.all((owner >= 0) & (owner < x.size))
        is_decaying = np.all((f >= 0) & (f <= self.fs / 2) & (self.decay_per_s > 0))
        rules = [
            (low <= getattr(self, name) <= high, name, f"{low:g} to {high:g}") for name, low, high in _RANGES
        ]
        rules += [
            (self.course in get_args(Course), "course", f"one of {get_args(Course)}"),
            (is_on_line, "position_mm", f"at least one value, increasing, in [0, {self.length_mm:g})"),
            (abs(np.hypot(*self.direction) - 1) < 1e-6, "direction", "a unit vector"),
            (is_index, "feature", f"integers in [0, {x.size}), not decreasing"),
            (is_decaying, "frequency_hz", "0 to fs/2, with a positive decay_per_s"),
            (np.all((A >= 0) & (1e9 * self.peak >= A)), "amplitude", "0 to 1e9 times the peak"),
        ]
        for is_valid, name, rule in rules:
            if not is_valid:
                raise ValueError(f"texture {self.name!r}: {name} must be {rule}, got {getattr(self, name)}")

    @cached_property
    def speeds(self) -> Samples:
        """Half and twice the speed of the scan in mm/s."""
        return self.scaling.speed * np.array([0.5, 2.0])

    @cached_property
    def forces(self) -> Samples:
        """Half and twice the force of the scan in N; the nominal force if the force of the scan is 0."""
        return (self.scaling.force or NOMINAL_FORCE_N) * np.array([0.5, 2.0])

    @property
    def n_features(self) -> int:
        """Number of features on the line."""
        return int(self.position_mm.size)

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample at the speed of the scan: ten per active mode."""
        with np.errstate(over="ignore"):  # modes may decay very slowly, or be much larger than the peak
            loud = np.maximum(self.amplitude / (SILENCE_RATIO * self.peak), 1.0)
            ring_s = float(np.sum(np.log(loud) / self.decay_per_s))
        return 30.0 + 10.0 * ring_s * self.scaling.speed / self.length_mm

    def renderer(self, *, seed: int = 0) -> "SpatialRenderer":
        """Return a renderer without active modes; rendering is deterministic, so `seed` has no effect."""
        return SpatialRenderer(self)


@dataclass(frozen=True, eq=False)
class SinusoidTexture(SpatialTexture):
    """Baseline with one decaying sinusoid per feature, A exp(-beta t) sin(omega t).

    References
    ----------
    `guruswamy2011`, eq. (3) and (4), based on `okamura2001`.
    """

    family: ClassVar[str] = "guruswamy2011-sinusoid"


# Rendering --------------------------------------------------------------------------------------------------

MAX_RINGING = 512
"""Largest number of active modes. Beyond this number, a stronger mode replaces the weakest mode."""
SILENCE_RATIO = 1e-3
"""Fraction of the recorded peak below which a mode is considered decayed."""
PEAK_FACTOR = 8.0
"""Limit of the output, as a multiple of the recorded peak."""
BACKLASH_MM = 0.1
"""Distance in mm after a reversal within which no feature is excited, because the tip may tremble."""


class SpatialRenderer:
    """Render a `SpatialTexture` along any path, sample by sample.

    The cost of a sample is one step per active mode, plus a binary search if a feature is passed. The cost is
    bounded at any speed: at most `MAX_RINGING` modes are active, and at most the four features nearest to the
    tip are excited per sample. A feature that is passed between two samples starts at the later sample, as in
    the paper. Without contact, no feature is excited.

    Parameters
    ----------
    texture : SpatialTexture
        Texture to render.

    Attributes
    ----------
    fs : float
        Sampling rate in Hz.
    """

    def __init__(self, texture: "SpatialTexture") -> None:
        self.fs = texture.fs
        scaling = texture.scaling
        law = scaling.law
        reference = scaling.speed, scaling.force, scaling.compensated, scaling.limit
        self._law = np.array([law.k_v, law.k_c, law.a_0, *reference], float)
        quiet, loud = SILENCE_RATIO * texture.peak, PEAK_FACTOR * texture.peak
        is_travelled, line = texture.course == "travelled", (*texture.direction, texture.origin_mm)
        self._settings = np.array(
            [texture.fs, texture.length_mm, *line, is_travelled, BACKLASH_MM, quiet, loud], float
        )
        self._position = np.array(texture.position_mm)
        owners = np.arange(texture.n_features + 1)
        self._first = np.searchsorted(texture.feature, owners).astype(np.int64)
        start = texture.amplitude * np.exp(1j * texture.phase)
        p = np.exp((-texture.decay_per_s + 2j * np.pi * texture.frequency_hz) / texture.fs)
        self._modes = np.column_stack([start.real, start.imag, p.real, p.imag])
        self._pool = np.zeros((MAX_RINGING, 4))
        self._counts = np.zeros(3, np.int64)
        self._tip = np.zeros(4)
        self.reset()

    @property
    def n_ringing(self) -> int:
        """Number of active modes."""
        return int(self._counts[Count.RINGING])

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples of a path, see `texclass.haptics.textures.Renderer`.

        Raises
        ------
        ValueError
            If the shapes do not match, or a value is NaN, infinite or above 1e9 in magnitude. The state of
            the renderer is then unchanged.
        """
        v, f = _block(velocity), _block(force)
        path = np.empty((0, 2)) if position is None else _block(position)
        n = f.size
        if f.ndim != 1 or v.shape != (n, 2) or (position is not None and path.shape != (n, 2)):
            raise ValueError(
                "velocity, force and position must have shapes (n, 2), (n,) and (n, 2), "
                f"got {v.shape}, {f.shape} and {path.shape}"
            )
        out = np.empty(n)
        if not render(
            v, f, path, out, self._settings, self._law,
            self._position, self._first, self._modes, self._pool, self._counts, self._tip,
        ):  # fmt: skip
            raise ValueError(
                f"velocity, force and position must be finite and at most {MAX_INPUT:g} in magnitude"
            )
        return out

    def reset(self) -> None:
        """Remove all active modes; the next sample is treated as the first."""
        self._counts[:] = 0
        self._tip[:] = 0.0


def _block(values: ArrayLike) -> Samples:
    array = np.ascontiguousarray(values, dtype=np.float64)
    return (
        array if array.flags.writeable else array.copy()
    )  # avoids compiling a second version for read-only arrays


Counts = NDArray[np.int64]


class Count(IntEnum):
    """Indices of `counts`: number of active modes, next feature, and whether a sample has been rendered."""

    RINGING, NEXT, STARTED = range(3)


@njit(cache=True, error_model="numpy")
def locate(s: float, position: Samples, length: float) -> int:
    """Return the number of features before coordinate s on the periodic surface."""
    period = np.floor(s / length)
    return int(period) * position.size + int(np.searchsorted(position, s - period * length))


@njit(cache=True, error_model="numpy")
def feature_position(k: int, position: Samples, length: float) -> float:
    """Return the coordinate of feature k on the periodic surface."""
    period = k // position.size
    return float(period * length + position[k - period * position.size])


@njit(cache=True, error_model="numpy")
def factor(speed: float, force: float, law: Samples) -> float:
    """Return A, see `Amplitude.factor`; `law` contains k_v, k_c, a_0, v_0, f_0, compensated and limit."""
    level = law[0] * speed / 1000 + law[1] * force + law[2]
    A = level / (law[0] * law[3] / 1000 + law[1] * law[4] + law[2])
    if law[5] != 0 and speed > law[3]:
        A *= np.sqrt(law[3] / speed)
    return float(min(A, law[6]))


@njit(cache=True, error_model="numpy")
def excite(k: int, A: float, first: Counts, modes: Samples, pool: Samples, counts: Counts) -> None:
    """Add the modes of feature k to the pool, each as real and imaginary part of z and of the pole p.

    In a full pool, a stronger mode replaces the weakest one.
    """
    for m in range(first[k], first[k + 1]):
        re, im = A * modes[m, 0], A * modes[m, 1]
        row = counts[Count.RINGING]
        if row < pool.shape[0]:
            counts[Count.RINGING] += 1
        else:
            row, lowest = -1, re * re + im * im
            for i in range(pool.shape[0]):
                power = pool[i, 0] * pool[i, 0] + pool[i, 1] * pool[i, 1]
                if power < lowest:
                    row, lowest = i, power
            if row < 0:
                continue
        pool[row] = re, im, modes[m, 2], modes[m, 3]


@njit(cache=True, error_model="numpy")
def ring(pool: Samples, counts: Counts, silent: float) -> float:
    """Return the sum of the active modes and advance them; modes below `silent` are removed."""
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
    x_now: float, A: float, position: Samples, length: float,
    first: Counts, modes: Samples, pool: Samples, counts: Counts,
) -> None:  # fmt: skip
    """Excite the features between the previous and the current coordinate of the tip."""
    n = position.size
    k = counts[Count.NEXT]
    if feature_position(k, position, length) > x_now and feature_position(k - 1, position, length) <= x_now:
        return
    end = locate(x_now, position, length)
    while feature_position(end, position, length) <= x_now:
        end += 1
    if A > 0:
        # at most the four features nearest to the tip
        low, high = (max(k, end - 4), end) if end > k else (end, min(k, end + 4))
        for j in range(low, high):
            excite(j % n, A, first, modes, pool, counts)
    counts[Count.NEXT] = end


@njit(cache=True, error_model="numpy")
def render(
    velocity: Samples, force: Samples, path: Samples, out: Samples, settings: Samples, law: Samples,
    position: Samples, first: Counts, modes: Samples, pool: Samples, counts: Counts, tip: Samples,
) -> bool:  # fmt: skip
    """Render a block to `out`. If an input is not finite or too large, return False and change nothing.

    `settings` contains fs, length of the surface, x and y of the direction, origin along the direction,
    is_travelled (0 or 1), backlash, silence level and largest output. `tip` contains the coordinate of the
    tip, the coordinate with backlash, and the last position. If `path` is empty, the velocity is integrated.
    """
    fs, length, along_x, along_y, origin, is_travelled, backlash, silent, largest = settings
    has_path = path.shape[0] > 0
    for t in range(force.size):
        is_valid = (
            abs(velocity[t, 0]) <= MAX_INPUT
            and abs(velocity[t, 1]) <= MAX_INPUT
            and abs(force[t]) <= MAX_INPUT
        )
        if not is_valid or (has_path and not (abs(path[t, 0]) <= MAX_INPUT and abs(path[t, 1]) <= MAX_INPUT)):
            return False
    for t in range(force.size):
        last_s, contact_s, last_x, last_y = tip
        if has_path:
            x, y = path[t, 0], path[t, 1]
        elif counts[Count.STARTED] == 0:
            x, y = 0.0, 0.0
        else:
            x, y = last_x + velocity[t, 0] / fs, last_y + velocity[t, 1] / fs
        if counts[Count.STARTED] == 0:
            s = 0.0 if is_travelled != 0 else x * along_x + y * along_y - origin
            contact_s = s
            counts[Count.NEXT] = locate(s, position, length)
        elif is_travelled != 0:
            s = last_s + np.sqrt((x - last_x) ** 2 + (y - last_y) ** 2)
        else:
            s = x * along_x + y * along_y - origin
        counts[Count.STARTED] = 1
        contact_s = min(max(contact_s, s), s + backlash)
        speed = np.sqrt(velocity[t, 0] ** 2 + velocity[t, 1] ** 2)
        A = factor(speed, force[t], law) if force[t] > 0 else 0.0
        advance(contact_s, A, position, length, first, modes, pool, counts)
        tip[0], tip[1], tip[2], tip[3] = s, contact_s, x, y
        out[t] = min(max(ring(pool, counts, silent), -largest), largest)
    return True
