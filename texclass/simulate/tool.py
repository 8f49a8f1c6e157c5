"""Time-domain simulation of the tool in the hand (contact, friction, structural mode) and its electronics.

The tip (mass m) is coupled to the hand by a spring and a damper along the normal (z) and along the stroke
(x):

    m z'' = F + k (z_hand - z) + c (z_hand' - z')
    m x'' = T + k (x_hand - x) + c (x_hand' - x')
    q'' + 2 zeta w q' + w^2 q = (F + T) / m_mode          bending of the shaft
    b'' + 2 zeta_b w_b b' + w_b^2 b = -F / m_body         lowest mode of the explored object
    F = K d^1.5 (1 + D d'),  d = h(x) + b - z             Hertz, with the dissipation of Hunt and Crossley
    T = -LuGre friction(x', F) - s F h'(x)                Stribeck's curve, and the force of the slopes

Friction opposes the whole velocity in the plane, so its component along x changes sign smoothly while the
hand turns at the end of a stroke.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from texclass.compilation import njit
from texclass.recording import STANDARD_GRAVITY, Samples
from texclass.signals import butterworth
from texclass.simulate.hand import CONTROL_RATE, Gesture


@dataclass(frozen=True)
class Tool:
    """Tool with a tip on a shaft with one structural mode.

    Attributes
    ----------
    tip_mass_kg
        Mass of the tip in kg, coupled to the hand.
    mode_mass_kg, mode_hz
        Effective mass in kg and natural frequency in Hz of the bending shaft, in a grip of 700 N/m.

    Examples
    --------
    >>> Tool(tip_mass_kg=0.05)
    Tool(tip_mass_kg=0.05, mode_mass_kg=0.06, mode_hz=420.0)
    """

    tip_mass_kg: float = 0.030
    mode_mass_kg: float = 0.060
    mode_hz: float = 420.0


class Mechanics(NamedTuple):
    """Constants of tool, hand, contact and object in SI units.

    Attributes
    ----------
    bristle, bristle_damping
        Stiffness of the contact along the stroke before sliding, and its damping ratio.
    asperity_slope
        Ratio s of the slopes of the asperities at the contact to the slopes of the profile smoothed by the
        tip.
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
    """Simulated motion and forces of the tool, one row per sample.

    Attributes
    ----------
    acceleration : ndarray of shape (n, 3)
        Acceleration along the normal, along and across the stroke, after the analogue filter, in m/s^2
        without gravity.
    contact_force, grip_force : ndarray of shape (n,)
        Normal force of the contact and lateral force of the hand, mean over each sample, in N.
    speed : ndarray of shape (n,)
        Signed velocity of the tip along the stroke, mean over each sample, in m/s.
    """

    acceleration: Samples
    contact_force: Samples
    grip_force: Samples
    speed: Samples


@dataclass(frozen=True)
class Sensor:
    """Accelerometer (similar to an LIS344ALH) on a data acquisition board, and two FSRs in a bridge circuit.

    Attributes
    ----------
    range_g
        Range of the accelerometer in g; it saturates at plus and minus this value.
    bandwidth_hz
        Cut-off frequency in Hz of its second-order low-pass filter.
    noise_ug_rt_hz
        Noise density in micro-g per root hertz.
    offset_mg
        Standard deviation of the zero-g level of each axis in mg.
    converter_bits, converter_range_g
        Resolution in bits and range (plus and minus) in g of the converter.
    bridge_v, bridge_noise_v, bridge_drift_v
        Voltage of the bridge at full imbalance, standard deviation of its noise and size of its drift, in V.

    Examples
    --------
    >>> sensor = Sensor(range_g=2.0)
    >>> still = np.zeros((1000, 3))
    >>> still[:, 2] = 30.0
    >>> float(sensor.read(still, 1_000.0, np.random.default_rng(0)).max().round(1))
    19.6
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
        """Quantisation step of the converter in m/s^2."""
        return float(2 * self.converter_range_g * STANDARD_GRAVITY / 2**self.converter_bits)

    def analogue_filter(self, fs: float, internal_rate: float) -> Samples:
        """Return second-order sections of the low-pass of the sensor and of the anti-aliasing filter."""
        highest = min(self.bandwidth_hz, 0.49 * internal_rate)
        sensor = butterworth("lowpass", highest, internal_rate, order=2)
        return np.vstack([sensor, butterworth("lowpass", 0.4 * fs, internal_rate)])

    def read(
        self, acceleration: Samples, fs: float, rng: np.random.Generator, *, extra_noise: float = 0.0
    ) -> Samples:
        """Return the digitised acceleration, with offset, noise, saturation and quantisation.

        Parameters
        ----------
        acceleration : ndarray of shape (n, 3)
            True acceleration in the axes of the sensor, including gravity, in m/s^2.
        fs : float
            Sampling rate in Hz.
        rng : numpy.random.Generator
            Generator of offset and noise.
        extra_noise : float
            Standard deviation of additional white noise in m/s^2 (default 0).

        Returns
        -------
        ndarray of shape (n, 3)
            Digitised acceleration in m/s^2.
        """
        bandwidth = min(1.11 * self.bandwidth_hz, 0.41 * fs)  # noise bandwidth after both filters, in Hz
        density = 1e-6 * self.noise_ug_rt_hz * STANDARD_GRAVITY
        noise = np.hypot(density * np.sqrt(bandwidth), extra_noise)
        offset = 1e-3 * self.offset_mg * STANDARD_GRAVITY * rng.standard_normal(3)
        read = rng.standard_normal(acceleration.shape, dtype=np.float32) * noise
        read += acceleration
        for i, level in enumerate(offset):  # one axis at a time takes half the time
            read[:, i] += level
        limit = self.range_g * STANDARD_GRAVITY
        np.clip(read, -limit, limit, out=read)
        read /= self.quantum_m_s2
        np.rint(read, out=read)
        read *= self.quantum_m_s2
        return np.asarray(read, dtype=np.float64)

    def read_bridge(self, lateral_force_n: Samples, fs: float, rng: np.random.Generator) -> Samples:
        """Return the voltage of the bridge for the lateral force of the grip in N.

        The characteristic is odd and saturates, and the zero drifts. Gain and zero change with every grip,
        because the two FSRs of a tool are never identical.
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
    """Return the number of time steps per sample: at least 4, and at least 40,000 per second."""
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
    """Simulate the motion of the tool when the hand follows `gesture` over `profile`.

    Parameters
    ----------
    gesture : Gesture
        Path of the hand.
    profile : (ndarray of shape (n_lines, n_points), float)
        Heights under the tip, and distance between adjacent points of a line, in m.
    mechanics : Mechanics
        Constants of tool, hand, contact and object.
    n_samples : int
        Number of samples.
    fs : float
        Sampling rate of the result in Hz.
    sos : ndarray of shape (n_sections, 6)
        Analogue filter before the converter, designed for the rate `fs * steps_per_sample(fs)`.
    """
    acceleration, other = np.empty((n_samples, 3)), np.empty((3, n_samples)).T
    path = np.column_stack([gesture.normal_m_s, gesture.tangential_m_s, gesture.lateral_m_s, gesture.line])
    n_substeps = steps_per_sample(fs)
    _run(
        mechanics,
        (path, (float(gesture.normal_m[0]), _tip_at_rest(gesture.normal_m[0], mechanics)), profile),
        np.ascontiguousarray(sos),
        (n_substeps, 1.0 / (fs * n_substeps)),
        (acceleration, other),
    )
    return Motion(acceleration, *other.T)


def _tip_at_rest(hand_m: float, mechanics: Mechanics) -> float:
    """Return the height of the tip at which contact and grip are in balance when the hand does not move."""
    if hand_m >= 0.0:
        return float(hand_m)
    excess = lambda d: mechanics.hertz * d**1.5 + mechanics.stiffness * (hand_m + d)  # noqa: E731
    return -float(brentq(excess, 0.0, -hand_m, xtol=1e-12))


@njit(cache=True, inline="always", error_model="numpy")
def _height_and_slope(row, per_m, x):  # type: ignore[no-untyped-def]
    """Interpolate by a Catmull-Rom spline, so that the grid adds no tone at the frequency speed / step."""
    last = row.shape[0] - 1  # the number of points is a power of two, so "& last" wraps around
    position = x * per_m
    whole = np.floor(position)
    t = position - whole
    i = int(whole)
    h0, h1, h2, h3 = row[(i - 1) & last], row[i & last], row[(i + 1) & last], row[(i + 2) & last]
    b = 0.5 * (h2 - h0)
    c = h0 - 2.5 * h1 + 2.0 * h2 - 0.5 * h3
    d = 1.5 * (h1 - h2) + 0.5 * (h3 - h0)
    return h1 + t * (b + t * (c + t * d)), (b + t * (2.0 * c + 3.0 * d * t)) * per_m


@njit(cache=True, inline="always", error_model="numpy")
def _under_tip(heights, per_m, x, line):  # type: ignore[no-untyped-def]
    """Interpolate height and slope between two lines; `line` is fractional only while a stroke turns."""
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
    """Return friction and bristle state after one implicit step of s' = v_x - bristle |v| s / g(|v|).

    An implicit step is stable for every step length.
    """
    if force <= 0.0:
        return 0.0, 0.0
    speed = np.sqrt(along * along + across * across)
    sliding = (speed / p.stribeck) ** 2
    stick = np.exp(-sliding) if sliding < 40.0 else 0.0  # beyond 40 it is smaller than the rounding
    limit = (p.kinetic_friction + (p.static_friction - p.kinetic_friction) * stick) * force
    deflection = (bristle + along * dt) * limit / (limit + p.bristle * speed * dt)
    damping = 2.0 * p.bristle_damping * np.sqrt(p.bristle * p.mass)
    return p.bristle * deflection + damping * (deflection - bristle) * (1.0 / dt), deflection


@njit(cache=True, inline="always", error_model="numpy")
def _ring(p, modes, force, lateral, dt):  # type: ignore[no-untyped-def]
    """Advance the modes of shaft and object by one step; return the shaft acceleration and the modes."""
    q, vq, b, vb = modes
    w_q, w_b = 2.0 * np.pi * p.mode_hz, 2.0 * np.pi * p.body_hz
    aq = (force + lateral) / p.mode_mass - 2.0 * p.mode_damping * w_q * vq - w_q * w_q * q
    ab = -force / p.body_mass - 2.0 * p.body_damping * w_b * vb - w_b * w_b * b
    vq += aq * dt
    vb += ab * dt
    return aq, (q + vq * dt, vq, b + vb * dt, vb)


@njit(cache=True, inline="always", error_model="numpy")
def _advance(p, state, hand, surface, dt):  # type: ignore[no-untyped-def]
    """Return accelerations z, x, q, contact and grip force, and the next state (semi-implicit Euler step)."""
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
    """Filter each row in place with second-order sections (transposed direct form II); update `memory`."""
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
    path, (hand, tip), surface = drive
    n_substeps, dt = clock
    acceleration, other = out
    memory = np.zeros((sos.shape[0], 3, 2))
    profile = surface[0], 1.0 / surface[1]
    height = _under_tip(profile[0], profile[1], 0.0, path[0, 3])[0]
    state = (tip + height, path[0, 0], 0.0, path[0, 1]), (0.0, 0.0, 0.0, 0.0), (0.0, hand + height, 0.0)
    other[:] = 0.0
    axes = np.empty((3, n_substeps))
    k = 0
    for i in range(acceleration.shape[0]):
        sums = other[i]
        for j in range(n_substeps):
            knot_time = k * dt * CONTROL_RATE
            knot = min(int(knot_time), path.shape[0] - 2)
            w, a, b = knot_time - knot, path[knot], path[knot + 1]
            motion = (  # velocities and line, linear between knots
                a[0] + w * (b[0] - a[0]),
                a[1] + w * (b[1] - a[1]),
                a[2] + w * (b[2] - a[2]),
                a[3] + w * (b[3] - a[3]),
            )
            az, ax, aq, force, grip, state = _advance(p, state, motion, profile, dt)
            axes[0, j], axes[1, j], axes[2, j] = az + 0.4 * aq, ax + 0.6 * aq, 0.4 * aq + 0.1 * az
            sums[0] += force / n_substeps
            sums[1] += grip / n_substeps
            sums[2] += state[0][3] / n_substeps
            k += 1
        _filter(sos, memory, axes)
        acceleration[i] = axes[:, -1]
