"""The hand that moves the tool: the habits of operators, and the path of a gesture made with them."""

import functools
from dataclasses import dataclass, replace

import numpy as np

from texclass.recording import Samples

CONTROL_RATE = 1000.0
"""Knots per second of the hand's path (Hz); no hand moves faster than that resolves."""


@dataclass(frozen=True)
class Operator:
    """A person's habits; one recording is made with values drawn around them (`redrawn`).

    Attributes
    ----------
    name
        Of the person.
    speed_mm_s
        Typical mean speed of a stroke.
    force_n
        Typical normal force while stroking.
    stroke_mm
        Typical length of a stroke.
    roundness
        Speed around the end of a stroke over the speed in its middle: 0 stops dead, 1 draws circles.
    speed_spread, force_spread
        Deviation of the logarithm of speed (stroke to stroke) and force (all the time) within a recording.
    grip_stiffness_n_m, grip_damping
        Of the hand that holds the tool: stiffness along the tool's axis, damping ratio.
    tilt_deg, azimuth_deg
        Of the tool against the surface normal, and about it.
    direction_deg
        Of the strokes against the surface's own direction (normal to its gratings).
    tap_speed_mm_s
        Typical speed at which a tap meets the surface.
    tremor_m_s2, tremor_hz
        Root mean square and centre frequency of the hand's physiological tremor.
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

    def redrawn(self, rng: np.random.Generator) -> "Operator":
        """Return the same person on one occasion: every habit drawn anew around its typical value."""

        def around(value: float, spread: float) -> float:
            return value * _factor(spread, rng, most=2.5)

        return replace(
            self,
            speed_mm_s=around(self.speed_mm_s, 0.10),
            force_n=around(self.force_n, 0.12),
            stroke_mm=around(self.stroke_mm, 0.15),
            grip_stiffness_n_m=around(self.grip_stiffness_n_m, 0.12),
            grip_damping=around(self.grip_damping, 0.12),
            tilt_deg=self.tilt_deg + 4.0 * rng.standard_normal(),
            azimuth_deg=self.azimuth_deg + 8.0 * rng.standard_normal(),
            direction_deg=self.direction_deg + 6.0 * rng.standard_normal(),
            tap_speed_mm_s=around(self.tap_speed_mm_s, 0.15),
            tremor_m_s2=around(self.tremor_m_s2, 0.2),
            tremor_hz=float(np.clip(self.tremor_hz + 0.4 * rng.standard_normal(), 7.5, 12.5)),
        )


@functools.lru_cache(maxsize=8)
def operator_catalogue(n: int, seed: int) -> tuple[Operator, ...]:
    """Return n operators; operator i depends on the seed and on i alone.

    Parameters
    ----------
    n : int
        How many.
    seed : int
        Of the catalogue.
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
    """Path of the hand on knots 1 / CONTROL_RATE apart, and the times of what it does.

    Attributes
    ----------
    normal_m, normal_m_s : ndarray of shape (n_knots,)
        Height of the hand above the place where the tip would just touch, and its velocity.
    tangential_m_s : ndarray of shape (n_knots,)
        Velocity along the stroke.
    lateral_m_s : ndarray of shape (n_knots,)
        Velocity across the stroke, which carries the tip around the turns; 0 for straight strokes.
    line : ndarray of shape (n_knots,)
        Line of the profile under the tip; fractional while a stroke turns.
    taps_s : tuple of (float, float)
        For each tap the start of the hand's acceleration, and the time at which the hand does something else.
    strokes_s : float or None
        Start of the first stroke.
    """

    normal_m: Samples
    tangential_m_s: Samples
    lateral_m_s: Samples
    line: Samples
    taps_s: tuple[tuple[float, float], ...] = ()
    strokes_s: float | None = None

    @property
    def normal_m_s(self) -> Samples:
        """Velocity of the hand along the normal."""
        return np.gradient(self.normal_m) * CONTROL_RATE

    @property
    def n_lines(self) -> int:
        """Lines of the profile it needs."""
        return int(np.ceil(self.line.max())) + 1


def draw_taps(operator: Operator, n: int, rng: np.random.Generator) -> Samples:
    """Return n taps of different strength, each in the operator's rhythm, as `tap_path` takes them."""
    strengths = rng.permutation(np.linspace(0.55, 1.6, n)) * np.exp(0.08 * rng.standard_normal(n))
    speed = 1e-3 * operator.tap_speed_mm_s * strengths
    least, most = (0.05, 0.08, 0.22, 0.02), (0.08, 0.12, 0.30, 0.08)
    return np.column_stack([speed, rng.uniform(least, most, (n, 4))])


def tap_path(
    taps: Samples, quiet_s: float, depth: float, *, stay: bool
) -> tuple[Samples, tuple[tuple[float, float], ...]]:
    """Return the hand's height while it waits and taps, and the times of the taps.

    Parameters
    ----------
    taps : ndarray of shape (n_taps, 5)
        Of each, at least one: speed at contact (m/s), and the seconds of acceleration towards the surface,
        of pressing, of retreat, and of waiting for the next.
    quiet_s : float
        Time before the first.
    depth : float
        How far below the surface the hand goes to press after contact (m).
    stay : bool
        Whether the hand stays on the surface after the last tap.
    """
    height_m = 0.5 * taps[:, 0] * taps[:, 1]  # the velocity rises as half a cosine from 0 to the speed
    pieces = [np.full(_knots(quiet_s), height_m[0])]
    times = []
    for i, (speed, approach_s, hold_s, lift_s, pause_s) in enumerate(taps.tolist()):
        start = sum(map(len, pieces)) / CONTROL_RATE
        approach, press = _tau(approach_s), _tau(2.0 * depth / speed)
        pieces += [
            height_m[i] * (1.0 - approach + np.sin(np.pi * approach) / np.pi),
            -depth * (press + np.sin(np.pi * press) / np.pi),
            np.full(_knots(hold_s), -depth),
        ]
        times.append((start, sum(map(len, pieces)) / CONTROL_RATE))
        if i + 1 < len(taps) or not stay:
            following = float(height_m[min(i + 1, len(taps) - 1)])
            pieces += [least_jerk(-depth, following, _knots(lift_s)), np.full(_knots(pause_s), following)]
    return np.concatenate(pieces), tuple(times)


def draw_strokes(
    operator: Operator, n_knots: int, rng: np.random.Generator
) -> tuple[Samples, Samples, Samples]:
    """Return velocity along and across (m/s) and line of back-and-forth strokes that fill `n_knots`.

    A stroke's speed is half a sine, modulated by some tens of per cent; strokes differ in speed and length.
    Its ends are round: the hand does not stop there but goes around, `operator.roundness` as fast as along.
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
        around = np.cos(np.pi * tau) if stroke else np.minimum(np.cos(np.pi * tau), 0.0)  # begins from rest
        velocity[start:stop] = (peak * np.sin(np.pi * tau))[: stop - start]
        lateral[start:stop] = (operator.roundness * peak * around)[: stop - start]
        seconds_to_turn = (np.arange(n_knots) - (start + n)) / CONTROL_RATE
        line += np.clip(seconds_to_turn / 0.06 + 0.5, 0.0, 1.0)  # turning takes 0.06 s
        start, stroke, sign = start + n, stroke + 1, -sign
    unsteady = np.exp(0.12 * smooth_noise(n_knots, 2.5, rng))
    return velocity * unsteady, lateral * unsteady, line


def smooth_noise(n_knots: int, cutoff_hz: float, rng: np.random.Generator) -> Samples:
    """Return noise of about unit deviation with content up to about `cutoff_hz`."""
    n = int(np.ceil(n_knots / CONTROL_RATE * 2 * cutoff_hz)) + 4
    support = (np.arange(n) - 1.5) / (2 * cutoff_hz)
    noise = np.clip(rng.standard_normal(n), -2.5, 2.5)
    from scipy.interpolate import CubicSpline  # not to say what a dataset holds

    return np.asarray(CubicSpline(support, noise)(np.arange(n_knots) / CONTROL_RATE))


def tremor(operator: Operator, n_knots: int, rng: np.random.Generator) -> Samples:
    """Return the displacement of the trembling hand (m): a few close lines about the centre frequency."""
    time = np.arange(n_knots) / CONTROL_RATE
    omega = 2 * np.pi * (operator.tremor_hz + np.linspace(-1.0, 1.0, 4) + 0.2 * rng.standard_normal(4))
    phase = rng.uniform(0, 2 * np.pi, 4)
    lines = (np.sin(w * time + p) / w**2 for w, p in zip(omega, phase, strict=True))
    return np.asarray(operator.tremor_m_s2 / np.sqrt(2) * sum(lines))


def _factor(spread: float, rng: np.random.Generator, most: float = 2.0) -> float:
    """Return a log-normal factor about 1; nobody strays by more than `most` deviations from a habit."""
    return float(np.exp(spread * np.clip(rng.standard_normal(), -most, most)))


def _knots(seconds: float) -> int:
    return max(round(seconds * CONTROL_RATE), 1)


def _tau(seconds: float) -> Samples:
    n = _knots(seconds)
    return np.arange(n) / n


def least_jerk(low: float, high: float, n_knots: int) -> Samples:
    """Return the path of least jerk from `low` to `high`."""
    tau = np.arange(n_knots) / n_knots
    return low + (high - low) * tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2)
