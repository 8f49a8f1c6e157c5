"""The tool in the hand: contact, friction and one structural mode, stepped in time; and its electronics.

The tip (mass m) hangs on the hand's spring and damper along the normal (z) and along the stroke (x):

    m z'' = F + k (z_hand - z) + c (z_hand' - z')
    m x'' = T + k (x_hand - x) + c (x_hand' - x')
    q'' + 2 zeta w q' + w^2 q = (F + T) / m_mode          the shaft bends
    b'' + 2 zeta_b w_b b' + w_b^2 b = -F / m_body         the explored object gives way and rings
    F = K d^1.5 (1 + D d'),  d = h(x) + b - z             Hertz, with the dissipation of Hunt and Crossley
    T = -LuGre friction(x', F) - s F h'(x)                Stribeck's curve; slopes push back

Friction acts against the whole velocity in the plane: while the hand goes around at the end of a stroke, the
part of it along x turns over smoothly.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from texclass.recording import STANDARD_GRAVITY, Samples
from texclass.signals import butterworth
from texclass.simulate.hand import CONTROL_RATE, Gesture


@dataclass(frozen=True)
class Tool:
    """The tool: a tip on a shaft with one structural mode.

    Attributes
    ----------
    tip_mass_kg
        Mass that the hand's spring carries.
    mode_mass_kg, mode_hz
        Effective mass and natural frequency of the bending shaft, in a grip of 700 N/m.
    """

    tip_mass_kg: float = 0.030
    mode_mass_kg: float = 0.060
    mode_hz: float = 420.0


class Mechanics(NamedTuple):
    """Constants of tool, hand, contact and object in SI units.

    Attributes
    ----------
    bristle, bristle_damping
        Stiffness of the contact along the stroke before it slides, and its damping ratio.
    asperity_slope
        How much steeper the crests that touch the tip are than the smoothed profile its ball follows (s
        above).
    """

    mass: float
    stiffness: float
    damping: float
    mode_mass: float
    mode_hz: float
    mode_damping: float
    hertz: float
    dissipation: float
    static_friction: float
    kinetic_friction: float
    stribeck: float
    body_hz: float
    body_damping: float
    body_mass: float
    bristle: float = 2.0e4
    bristle_damping: float = 0.3
    asperity_slope: float = 3.0


class Motion(NamedTuple):
    """What happened at the tool, one row per sample.

    Attributes
    ----------
    acceleration : ndarray of shape (n, 3)
        Along the normal, along the stroke, and across, behind the analogue filter (m/s^2, no gravity).
    contact_force, grip_force : ndarray of shape (n,)
        Normal force of the contact, lateral force of the hand: mean over the sample (N).
    speed : ndarray of shape (n,)
        Of the tip along the stroke, signed: mean over the sample (m/s).
    """

    acceleration: Samples
    contact_force: Samples
    grip_force: Samples
    speed: Samples


@dataclass(frozen=True)
class Sensor:
    """An LIS344ALH-like accelerometer on a data acquisition board, and two FSRs in a Wheatstone bridge.

    Attributes
    ----------
    range_g
        The accelerometer saturates at plus and minus this.
    bandwidth_hz
        Of its second-order low-pass.
    noise_ug_rt_hz
        Density of its noise, micro-g per root hertz.
    offset_mg
        Deviation of the zero-g level of each axis.
    converter_bits, converter_range_g
        Resolution and span (plus and minus) of the converter.
    bridge_v, bridge_noise_v, bridge_drift_v
        Bridge: voltage at full imbalance, deviation of its noise, size of its drift.
    """

    range_g: float = 6.0
    bandwidth_hz: float = 1800.0
    noise_ug_rt_hz: float = 50.0
    offset_mg: float = 20.0
    converter_bits: int = 14
    converter_range_g: float = 10.0
    bridge_v: float = 2.5
    bridge_noise_v: float = 0.002
    bridge_drift_v: float = 0.02

    @property
    def quantum_m_s2(self) -> float:
        """One step of the converter."""
        return float(2 * self.converter_range_g * STANDARD_GRAVITY / 2**self.converter_bits)

    def analogue_filter(self, fs: float, internal_rate: float) -> Samples:
        """Return second-order sections: the sensor's low-pass, then one against aliases of `fs`."""
        highest = min(self.bandwidth_hz, 0.49 * internal_rate)
        sensor = butterworth("lowpass", highest, internal_rate, order=2)
        return np.vstack([sensor, butterworth("lowpass", 0.4 * fs, internal_rate)])

    def read(
        self, acceleration: Samples, fs: float, rng: np.random.Generator, *, extra_noise: float = 0.0
    ) -> Samples:
        """Return what the converter stores of the true acceleration.

        Parameters
        ----------
        acceleration : ndarray of shape (n, 3)
            In the sensor's axes, gravity included (m/s^2).
        fs : float
            Sampling rate in Hz.
        rng : numpy.random.Generator
            Of offset and noise.
        extra_noise : float
            Deviation of further white noise (m/s^2).

        Returns
        -------
        ndarray of shape (n, 3)
            In m/s^2, clipped and quantised.
        """
        bandwidth = min(1.11 * self.bandwidth_hz, 0.41 * fs)  # of the noise, behind both filters
        density = 1e-6 * self.noise_ug_rt_hz * STANDARD_GRAVITY
        noise = np.hypot(density * np.sqrt(bandwidth), extra_noise)
        offset = 1e-3 * self.offset_mg * STANDARD_GRAVITY * rng.standard_normal(3)
        read = rng.standard_normal(acceleration.shape, dtype=np.float32) * noise
        read += acceleration
        for i, level in enumerate(offset):  # axis by axis: half the time of all at once
            read[:, i] += level
        limit = self.range_g * STANDARD_GRAVITY
        np.clip(read, -limit, limit, out=read)
        read /= self.quantum_m_s2
        np.rint(read, out=read)
        read *= self.quantum_m_s2
        return np.asarray(read, dtype=np.float64)

    def read_bridge(self, lateral_force_n: Samples, fs: float, rng: np.random.Generator) -> Samples:
        """Return the bridge's voltage for the lateral force of the grip (N); odd, saturating, drifting.

        The two FSRs of one tool are never alike: gain and balance change with every grip.
        """
        gain = 0.6 * np.exp(0.08 * rng.standard_normal())  # 1/N
        smooth = lateral_force_n.copy()
        _filter(butterworth("lowpass", min(150.0, 0.4 * fs), fs, order=1), np.zeros((1, 1, 2)), smooth[None])
        drive = np.abs(smooth)
        np.power(drive, 0.9, out=drive)
        drive *= gain
        np.copysign(drive, smooth, out=drive)
        limited = np.abs(drive)
        limited += 1.0
        drive *= self.bridge_v
        drive /= limited
        drift = np.linspace(0.0, rng.standard_normal(), drive.size)
        drift += rng.standard_normal()
        drift *= self.bridge_drift_v
        drive += drift
        noise = rng.standard_normal(drive.size)
        noise *= self.bridge_noise_v
        drive += noise
        return drive


def steps_per_sample(fs: float) -> int:
    """Return how many time steps one sample at `fs` takes: at least four, and 40,000 in a second."""
    return max(4, int(np.ceil(40_000.0 / fs - 1e-9)))


def move_tool(
    gesture: Gesture,
    profile: tuple[Samples, float],
    mechanics: Mechanics,
    *,
    n_samples: int,
    fs: float,
    sos: Samples,
) -> Motion:
    """Let the hand carry the tool through `gesture` over `profile`.

    Parameters
    ----------
    gesture : Gesture
        Path of the hand.
    profile : (ndarray of shape (n_lines, n_points), float)
        Heights under the tip and distance of two points along a line (m).
    mechanics : Mechanics
        Constants.
    n_samples : int
        Length of the result.
    fs : float
        Its sampling rate in Hz.
    sos : ndarray of shape (n_sections, 6)
        Analogue filter in front of the converter, designed at `fs * steps_per_sample(fs)`.
    """
    acceleration, other = np.empty((n_samples, 3)), np.empty((3, n_samples)).T
    path = np.column_stack([gesture.normal_m_s, gesture.tangential_m_s, gesture.lateral_m_s, gesture.line])
    n_substeps = steps_per_sample(fs)
    _run(
        mechanics,
        (path, float(gesture.normal_m[0]), profile),
        np.ascontiguousarray(sos),
        (n_substeps, 1.0 / (fs * n_substeps)),
        (acceleration, other),
    )
    return Motion(acceleration, *other.T)


@njit(cache=True, inline="always", error_model="numpy")
def _height_and_slope(row, per_m, x):  # type: ignore[no-untyped-def]
    """Catmull-Rom interpolation: smooth enough that the grid is not heard as a line at speed over step."""
    last = row.shape[0] - 1  # the number of points is a power of two: "& last" wraps
    position = x * per_m
    whole = np.floor(position)
    t = position - whole
    i = int(whole)
    before, at, after, beyond = row[(i - 1) & last], row[i & last], row[(i + 1) & last], row[(i + 2) & last]
    b = 0.5 * (after - before)
    c = before - 2.5 * at + 2.0 * after - 0.5 * beyond
    d = 1.5 * (at - after) + 0.5 * (beyond - before)
    return at + t * (b + t * (c + t * d)), (b + t * (2.0 * c + 3.0 * d * t)) * per_m


@njit(cache=True, inline="always", error_model="numpy")
def _under_tip(heights, per_m, x, line):  # type: ignore[no-untyped-def]
    """Height and slope between two lines (`line` is fractional only while the stroke turns)."""
    first = int(line)
    weight = line - first
    h, slope = _height_and_slope(heights[first], per_m, x)
    if weight > 0.0:
        h_next, slope_next = _height_and_slope(heights[first + 1], per_m, x)
        h += weight * (h_next - h)
        slope += weight * (slope_next - slope)
    return h, slope


@njit(cache=True, inline="always", error_model="numpy")
def _friction(p, force, along, across, bristle, dt):  # type: ignore[no-untyped-def]
    """One implicit step of s' = v_x - bristle |v| s / g(|v|), which no step length makes unstable."""
    if force <= 0.0:
        return 0.0, 0.0
    speed = np.sqrt(along * along + across * across)
    sliding = (speed / p.stribeck) ** 2
    stuck = np.exp(-sliding) if sliding < 40.0 else 0.0  # less than a rounding
    limit = (p.kinetic_friction + (p.static_friction - p.kinetic_friction) * stuck) * force
    moved = (bristle + along * dt) * limit / (limit + p.bristle * speed * dt)
    damping = 2.0 * p.bristle_damping * np.sqrt(p.bristle * p.mass)
    return p.bristle * moved + damping * (moved - bristle) * (1.0 / dt), moved


@njit(cache=True, inline="always", error_model="numpy")
def _ring(p, modes, force, lateral, dt):  # type: ignore[no-untyped-def]
    """One step of the modes of the shaft and of the object; return the acceleration of the shaft."""
    q, vq, b, vb = modes
    w_q, w_b = 2.0 * np.pi * p.mode_hz, 2.0 * np.pi * p.body_hz
    aq = (force + lateral) / p.mode_mass - 2.0 * p.mode_damping * w_q * vq - w_q * w_q * q
    ab = -force / p.body_mass - 2.0 * p.body_damping * w_b * vb - w_b * w_b * b
    vq += aq * dt
    vb += ab * dt
    return aq, (q + vq * dt, vq, b + vb * dt, vb)


@njit(cache=True, inline="always", error_model="numpy")
def _advance(p, state, hand, surface, dt):  # type: ignore[no-untyped-def]
    """One step (semi-implicit Euler); return accelerations z, x, q, contact and grip force, next state."""
    v_hand_z, v_hand_x, v_across, line = hand
    (z, vz, x, vx), modes, (bristle, z_hand, x_hand) = state
    z_hand += v_hand_z * dt
    x_hand += v_hand_x * dt
    h, slope = _under_tip(surface[0], surface[1], x, line)
    depth = h + modes[2] - z
    force = 0.0
    if depth > 0.0:
        rate = slope * vx + modes[3] - vz
        force = p.hertz * depth * np.sqrt(depth) * min(max(1.0 + p.dissipation * rate, 0.0), 4.0)
    friction, bristle = _friction(p, force, vx, v_across, bristle, dt)
    lateral = -friction - force * min(max(p.asperity_slope * slope, -1.0), 1.0)
    lift = p.stiffness * (z_hand - z) + p.damping * (v_hand_z - vz)
    grip = p.stiffness * (x_hand - x) + p.damping * (v_hand_x - vx)
    per_kg = 1.0 / p.mass
    az, ax = (force + lift) * per_kg, (lateral + grip) * per_kg
    aq, modes = _ring(p, modes, force, lateral, dt)
    vz += az * dt
    vx += ax * dt
    return az, ax, aq, force, grip, ((z + vz * dt, vz, x + vx * dt, vx), modes, (bristle, z_hand, x_hand))


@njit(cache=True, inline="always", error_model="numpy")
def _filter(sos, memory, values):  # type: ignore[no-untyped-def]
    """Second-order sections on each row in place, transposed direct form II; `memory` in and out."""
    for row in range(values.shape[0]):
        for s in range(sos.shape[0]):
            b0, b1, b2, a1, a2 = sos[s, 0], sos[s, 1], sos[s, 2], sos[s, 4], sos[s, 5]
            z0, z1 = memory[s, row, 0], memory[s, row, 1]
            for j in range(values.shape[1]):
                value = values[row, j]
                out = b0 * value + z0
                z0 = b1 * value - a1 * out + z1
                z1 = b2 * value - a2 * out
                values[row, j] = out
            memory[s, row, 0], memory[s, row, 1] = z0, z1


@njit(cache=True, error_model="numpy")
def _run(p, drive, sos, clock, out):  # type: ignore[no-untyped-def]
    path, height, surface = drive
    n_substeps, dt = clock
    acceleration, other = out
    memory = np.zeros((sos.shape[0], 3, 2))
    under = surface[0], 1.0 / surface[1]
    height += _under_tip(under[0], under[1], 0.0, path[0, 3])[0]
    state = (height, path[0, 0], 0.0, path[0, 1]), (0.0, 0.0, 0.0, 0.0), (0.0, height, 0.0)
    other[:] = 0.0
    felt = np.empty((3, n_substeps))
    k = 0
    for i in range(acceleration.shape[0]):
        sums = other[i]
        for j in range(n_substeps):
            knot_time = k * dt * CONTROL_RATE
            knot = min(int(knot_time), path.shape[0] - 2)
            w, now, then = knot_time - knot, path[knot], path[knot + 1]
            hand = (  # velocities and line, linear between knots
                now[0] + w * (then[0] - now[0]),
                now[1] + w * (then[1] - now[1]),
                now[2] + w * (then[2] - now[2]),
                now[3] + w * (then[3] - now[3]),
            )
            az, ax, aq, force, grip, state = _advance(p, state, hand, under, dt)
            felt[0, j], felt[1, j], felt[2, j] = az + 0.4 * aq, ax + 0.6 * aq, 0.4 * aq + 0.1 * az
            sums[0] += force / n_substeps
            sums[1] += grip / n_substeps
            sums[2] += state[0][3] / n_substeps
            k += 1
        _filter(sos, memory, felt)
        acceleration[i] = felt[:, -1]
