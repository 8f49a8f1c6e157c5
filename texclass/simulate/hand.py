"""Model of the hand that moves the tool: habits of the operators, and paths of their gestures."""

import functools
from dataclasses import dataclass, replace

import numpy as np

from texclass.recording import Samples

CONTROL_RATE = 1000.0
"""Rate of the knots of the hand's path in Hz, which is far above the bandwidth of a hand."""


@dataclass(frozen=True)
class Operator:
    """Habits of a person. In each recording, the values vary around these typical values; see `vary`.

    Attributes
    ----------
    name
        Name of the person.
    speed_mm_s
        Typical mean speed of a stroke in mm/s.
    force_n
        Typical normal force during a stroke in N.
    stroke_mm
        Typical length of a stroke in mm.
    roundness
        Ratio of the speed at the end of a stroke to the speed in its middle: at 0 the hand stops, and at 1 it
        draws circles.
    speed_spread, force_spread
        Standard deviations of the logarithms of speed (between strokes) and force (continuously) within a
        recording.
    grip_stiffness_n_m, grip_damping
        Stiffness of the grip along the axis of the tool in N/m, and damping ratio.
    tilt_deg, azimuth_deg
        Angle between the tool and the surface normal, and azimuth of the tool, in degrees.
    direction_deg
        Angle between the strokes and the normal of the gratings of the surface, in degrees.
    tap_speed_mm_s
        Typical speed at the contact of a tap in mm/s.
    tremor_m_s2, tremor_hz
        RMS acceleration (m/s^2) and centre frequency (Hz) of the physiological tremor.

    Examples
    --------
    >>> (operator,) = operator_catalogue(1, seed=0)
    >>> operator.name, round(operator.vary(np.random.default_rng(0)).speed_mm_s)
    ('operator-1', 113)
    """

    name: str
    speed_mm_s: float
    force_n: float
    stroke_mm: float
    roundness: float
    speed_spread: float
    force_spread: float
    grip_stiffness_n_m: float
    grip_damping: float
    tilt_deg: float
    azimuth_deg: float
    direction_deg: float
    tap_speed_mm_s: float
    tremor_m_s2: float
    tremor_hz: float

    def vary(self, rng: np.random.Generator) -> "Operator":
        """Return the operator of one recording, with habits drawn at random around the typical values."""

        def vary(value: float, spread: float) -> float:
            return value * _factor(spread, rng, max_deviations=2.5)

        return replace(
            self,
            speed_mm_s=vary(self.speed_mm_s, 0.10),
            force_n=vary(self.force_n, 0.12),
            stroke_mm=vary(self.stroke_mm, 0.15),
            grip_stiffness_n_m=vary(self.grip_stiffness_n_m, 0.12),
            grip_damping=vary(self.grip_damping, 0.12),
            tilt_deg=self.tilt_deg + 4.0 * rng.standard_normal(),
            azimuth_deg=self.azimuth_deg + 8.0 * rng.standard_normal(),
            direction_deg=self.direction_deg + 6.0 * rng.standard_normal(),
            tap_speed_mm_s=vary(self.tap_speed_mm_s, 0.15),
            tremor_m_s2=vary(self.tremor_m_s2, 0.2),
            tremor_hz=float(np.clip(self.tremor_hz + 0.4 * rng.standard_normal(), 7.5, 12.5)),
        )


@functools.lru_cache(maxsize=8)
def operator_catalogue(n: int, seed: int) -> tuple[Operator, ...]:
    """Return n operators. Operator i depends only on the seed and on i.

    Parameters
    ----------
    n : int
        Number of operators.
    seed : int
        Seed of the catalogue.

    Returns
    -------
    tuple of Operator
        Operators ``operator-1`` ... ``operator-n``.

    Examples
    --------
    >>> [operator.name for operator in operator_catalogue(2, seed=0)]
    ['operator-1', 'operator-2']
    """
    operators = []
    for index in range(n):
        rng = np.random.default_rng(np.random.SeedSequence((seed, 1, index)))
        operators.append(
            Operator(
                name=f"operator-{index + 1}",
                speed_mm_s=110.0 * _factor(0.18, rng),
                force_n=1.0 * _factor(0.18, rng),
                stroke_mm=65.0 * _factor(0.25, rng),
                roundness=rng.uniform(0.15, 0.45),
                speed_spread=rng.uniform(0.15, 0.35),
                force_spread=rng.uniform(0.12, 0.30),
                grip_stiffness_n_m=700.0 * _factor(0.25, rng),
                grip_damping=0.9 * _factor(0.2, rng),
                tilt_deg=rng.uniform(10.0, 40.0),
                azimuth_deg=rng.uniform(-35.0, 35.0),
                direction_deg=rng.uniform(-12.0, 12.0),
                tap_speed_mm_s=20.0 * _factor(0.2, rng),
                tremor_m_s2=0.05 * _factor(0.3, rng),
                tremor_hz=rng.uniform(8.0, 12.0),
            )
        )
    return tuple(operators)


@dataclass(frozen=True, eq=False)
class Gesture:
    """Path of the hand at knots that are 1 / CONTROL_RATE apart, with the times of taps and strokes.

    Attributes
    ----------
    normal_m, normal_m_s : ndarray of shape (n_knots,)
        Height of the hand above the height of first contact in m, and its velocity in m/s.
    tangential_m_s : ndarray of shape (n_knots,)
        Velocity along the stroke in m/s.
    lateral_m_s : ndarray of shape (n_knots,)
        Velocity across the stroke in m/s, which moves the tip around the turns; 0 for straight strokes.
    line : ndarray of shape (n_knots,)
        Index of the profile line under the tip; fractional while a stroke turns.
    taps_s : tuple of (float, float)
        Start of the hand's acceleration and end of the tap motion, in s, for each tap.
    strokes_s : float or None
        Start of the first stroke in s.
    """

    normal_m: Samples
    tangential_m_s: Samples
    lateral_m_s: Samples
    line: Samples
    taps_s: tuple[tuple[float, float], ...] = ()
    strokes_s: float | None = None

    @property
    def normal_m_s(self) -> Samples:
        """Velocity of the hand along the normal in m/s."""
        return np.gradient(self.normal_m) * CONTROL_RATE

    @property
    def n_lines(self) -> int:
        """Number of profile lines under the path."""
        return int(np.ceil(self.line.max())) + 1


def draw_taps(operator: Operator, n: int, rng: np.random.Generator) -> Samples:
    """Return n taps of different strength in the operator's rhythm, as rows for `tap_path`."""
    strengths = rng.permutation(np.linspace(0.55, 1.6, n)) * np.exp(0.08 * rng.standard_normal(n))
    speed = 1e-3 * operator.tap_speed_mm_s * strengths
    min_s, max_s = (0.05, 0.08, 0.22, 0.02), (0.08, 0.12, 0.30, 0.08)
    return np.column_stack([speed, rng.uniform(min_s, max_s, (n, 4))])


def tap_path(
    taps: Samples, quiet_s: float, depth: float, *, stay: bool
) -> tuple[Samples, tuple[tuple[float, float], ...]]:
    """Return the height of the hand during the taps and the pauses, and the times of the taps.

    Parameters
    ----------
    taps : ndarray of shape (n_taps, 5)
        At least one row per tap: speed at contact (m/s), and the durations (s) of the approach, of pressing,
        of the retreat, and of the pause before the next tap.
    quiet_s : float
        Time before the first tap in s.
    depth : float
        Depth of the hand below the surface while it presses, in m.
    stay : bool
        Whether the hand stays on the surface after the last tap.
    """
    height_m = 0.5 * taps[:, 0] * taps[:, 1]  # the velocity rises from 0 to the speed as half a cosine
    sections = [np.full(_knots(quiet_s), height_m[0])]
    times = []
    for i, (speed, approach_s, hold_s, lift_s, pause_s) in enumerate(taps.tolist()):
        start = sum(map(len, sections)) / CONTROL_RATE
        approach, press = _tau(approach_s), _tau(2.0 * depth / speed)
        sections += [
            height_m[i] * (1.0 - approach + np.sin(np.pi * approach) / np.pi),
            -depth * (press + np.sin(np.pi * press) / np.pi),
            np.full(_knots(hold_s), -depth),
        ]
        times.append((start, sum(map(len, sections)) / CONTROL_RATE))
        if i + 1 < len(taps) or not stay:
            following = float(height_m[min(i + 1, len(taps) - 1)])
            sections += [minimum_jerk(-depth, following, _knots(lift_s)), np.full(_knots(pause_s), following)]
    return np.concatenate(sections), tuple(times)


def draw_strokes(
    operator: Operator, n_knots: int, rng: np.random.Generator
) -> tuple[Samples, Samples, Samples]:
    """Return velocities along and across (m/s) and profile lines of back-and-forth strokes over `n_knots`.

    The speed of a stroke follows half a sine period, modulated by several tens of per cent. Strokes differ in
    speed and length. At the ends of a stroke the hand does not stop, but moves sideways at
    `operator.roundness` times the peak speed.
    """
    velocity, lateral, line = np.zeros(n_knots), np.zeros(n_knots), np.zeros(n_knots)
    start, stroke, sign = 0, 0, rng.choice([-1.0, 1.0])
    while start < n_knots:
        length = 1e-3 * operator.stroke_mm * _factor(0.2, rng)
        speed = 1e-3 * operator.speed_mm_s * _factor(operator.speed_spread, rng)
        n = _knots(max(length / speed, 0.15))
        tau = np.arange(n) / n
        stop = min(start + n, n_knots)
        peak = sign * speed * 0.5 * np.pi
        turn = np.cos(np.pi * tau) if stroke else np.minimum(np.cos(np.pi * tau), 0.0)  # starts from rest
        velocity[start:stop] = (peak * np.sin(np.pi * tau))[: stop - start]
        lateral[start:stop] = (operator.roundness * peak * turn)[: stop - start]
        seconds_to_turn = (np.arange(n_knots) - (start + n)) / CONTROL_RATE
        line += np.clip(seconds_to_turn / 0.06 + 0.5, 0.0, 1.0)  # a turn takes 0.06 s
        start, stroke, sign = start + n, stroke + 1, -sign
    modulation = np.exp(0.12 * smooth_noise(n_knots, 2.5, rng))
    return velocity * modulation, lateral * modulation, line


def smooth_noise(n_knots: int, cutoff_hz: float, rng: np.random.Generator) -> Samples:
    """Return noise with a standard deviation of about 1 and frequencies up to about `cutoff_hz`."""
    n = int(np.ceil(n_knots / CONTROL_RATE * 2 * cutoff_hz)) + 4
    support = (np.arange(n) - 1.5) / (2 * cutoff_hz)
    noise = np.clip(rng.standard_normal(n), -2.5, 2.5)
    from scipy.interpolate import CubicSpline  # not needed to list the recordings of a dataset

    return np.asarray(CubicSpline(support, noise)(np.arange(n_knots) / CONTROL_RATE))


def tremor(operator: Operator, n_knots: int, rng: np.random.Generator) -> Samples:
    """Return the displacement of the hand by tremor in m: four tones close to the centre frequency."""
    time = np.arange(n_knots) / CONTROL_RATE
    omega = 2 * np.pi * (operator.tremor_hz + np.linspace(-1.0, 1.0, 4) + 0.2 * rng.standard_normal(4))
    phase = rng.uniform(0, 2 * np.pi, 4)
    lines = (np.sin(w * time + p) / w**2 for w, p in zip(omega, phase, strict=True))
    return np.asarray(operator.tremor_m_s2 / np.sqrt(2) * sum(lines))


def _factor(spread: float, rng: np.random.Generator, max_deviations: float = 2.0) -> float:
    """Return a log-normal factor with the median 1, within `max_deviations` standard deviations."""
    return float(np.exp(spread * np.clip(rng.standard_normal(), -max_deviations, max_deviations)))


def _knots(seconds: float) -> int:
    return max(round(seconds * CONTROL_RATE), 1)


def _tau(seconds: float) -> Samples:
    n = _knots(seconds)
    return np.arange(n) / n


def minimum_jerk(low: float, high: float, n_knots: int) -> Samples:
    """Return the minimum-jerk path from `low` to `high`."""
    tau = np.arange(n_knots) / n_knots
    return low + (high - low) * tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2)
