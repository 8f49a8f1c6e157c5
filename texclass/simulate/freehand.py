"""Simulation of a freehand recording: rest, taps, pressing, onset of sliding and free strokes."""

from collections.abc import Sequence

import numpy as np

from texclass.compilation import njit
from texclass.recording import STANDARD_GRAVITY, Phases, Recording, Samples, Tap, make_read_only
from texclass.signals import lowpass
from texclass.simulate import hand
from texclass.simulate.hand import Operator
from texclass.simulate.profile import synthesize_profile
from texclass.simulate.surfaces import Surface
from texclass.simulate.tool import Mechanics, Motion, Sensor, Tool, move_tool, steps_per_sample

Seed = int | Sequence[int]
Generators = tuple[np.random.Generator, np.random.Generator, np.random.Generator]
"""Random generators of the hand and its pose, the height profile, and the electronics."""


def record_freehand(
    surface: Surface,
    operator: Operator,
    *,
    duration_s: float,
    fs: float = 10_000.0,
    seed: Seed,
    with_taps: bool = True,
    snr_db: float | None = None,
    tool: Tool | None = None,
    sensor: Sensor | None = None,
    recording_id: str | None = None,
    repetition: int | None = None,
) -> Recording:
    """Simulate one freehand recording. The same arguments always give the same samples.

    Parameters
    ----------
    surface : Surface
        Explored surface.
    operator : Operator
        Person who explores the surface. The habits of each recording vary around the typical values.
    duration_s : float
        Duration in s: at least 3 with taps, 1 without.
    fs : float
        Sampling rate in Hz, 1,000 to 50,000 (default 10,000). The motion does not depend on it.
    seed : int or sequence of int
        Seed of all random numbers.
    with_taps : bool
        Whether the recording begins with 3 to 6 taps (default True). Otherwise the tip rests on the surface
        from the start.
    snr_db : float, optional
        Signal-to-noise ratio in dB: level of the vibration during the strokes relative to white noise that is
        added to each axis (default: no noise is added).
    tool : Tool, optional
        Masses and structural mode of the tool (default `Tool()`).
    sensor : Sensor, optional
        Electronics (default `Sensor()`, similar to an LIS344ALH).
    recording_id : str, optional
        Name of the recording (default: surface and operator).
    repetition : int, optional
        Repetition number of the recording.

    Returns
    -------
    Recording
        Three axes in m/s^2, friction in V, normal force in N, speed in mm/s, and the true phases.

    Raises
    ------
    ValueError
        If the duration or the sampling rate is out of range.

    Examples
    --------
    >>> from texclass.simulate import operator_catalogue, surface_catalogue
    >>> (surface,), (operator,) = surface_catalogue(1, seed=0), operator_catalogue(1, seed=0)
    >>> recording = record_freehand(surface, operator, duration_s=3.0, fs=1_000.0, seed=0)
    >>> recording.recording_id, recording.unit, len(recording.phases.taps)
    ('stone-01 by operator-1', 'm/s^2', 3)
    """
    check_duration_and_rate(duration_s, fs, shortest_s=3.0 if with_taps else 1.0)
    rngs = generators(seed)
    rng = rngs[0]
    person = operator.vary(rng)
    n_knots = int(np.ceil(duration_s * hand.CONTROL_RATE)) + 2
    force = person.force_n * np.exp(person.force_spread * hand.smooth_noise(n_knots, 1.2, rng))
    normal = -pressing_depth(surface, person, force)
    quiet_s = rng.uniform(0.32, 0.5)
    times: tuple[tuple[float, float], ...] = ()
    stroke_start = int(quiet_s * hand.CONTROL_RATE)
    if with_taps:
        max_taps = 6 if duration_s >= 5.0 else 3
        taps = hand.draw_taps(person, int(rng.integers(3, max_taps + 1)), rng)
        depth = float(pressing_depth(surface, person, 0.3 * person.force_n))
        tapping, times = hand.tap_path(taps, quiet_s, depth, stay=True)
        stroke_start = len(tapping) + int(rng.uniform(0.2, 0.4) * hand.CONTROL_RATE)
        normal[: len(tapping)] = tapping
        normal[len(tapping) : stroke_start] = hand.minimum_jerk(
            -depth, float(normal[stroke_start]), stroke_start - len(tapping)
        )
    velocity, lateral, line = np.zeros(n_knots), np.zeros(n_knots), np.zeros(n_knots)
    velocity[stroke_start:], lateral[stroke_start:], line[stroke_start:] = hand.draw_strokes(
        person, n_knots - stroke_start, rng
    )
    tremor = [hand.tremor(person, n_knots, rng) for _ in range(2)]
    velocity += np.gradient(tremor[1]) * hand.CONTROL_RATE
    path = hand.Gesture(normal + tremor[0], velocity, lateral, line, times, stroke_start / hand.CONTROL_RATE)
    return perform(
        path,
        surface,
        person,
        duration_s=duration_s,
        fs=fs,
        rngs=rngs,
        tool=tool,
        sensor=sensor,
        snr_db=snr_db,
        recording_id=recording_id or f"{surface.name} by {operator.name}",
        repetition=repetition,
    )


def generators(seed: Seed) -> Generators:
    """Return independent random generators of hand, profile and electronics."""
    hand_rng, profile_rng, sensor_rng = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(3))
    return hand_rng, profile_rng, sensor_rng


def perform(
    path: hand.Gesture,
    surface: Surface,
    person: Operator,
    *,
    duration_s: float,
    fs: float,
    rngs: Generators,
    tool: Tool | None = None,
    sensor: Sensor | None = None,
    snr_db: float | None = None,
    recording_id: str,
    repetition: int | None = None,
) -> Recording:
    """Simulate the recording of a hand that follows `path`; `rngs` draw pose, profile and electronics."""
    sensor = sensor or Sensor()
    pose_rng, profile_rng, sensor_rng = rngs
    profile = synthesize_profile(surface, path.n_lines, profile_rng, direction_deg=person.direction_deg)
    n_samples = round(duration_s * fs)
    sos = sensor.analogue_filter(fs, fs * steps_per_sample(fs))
    constants = mechanics(surface, person, tool or Tool())
    motion = move_tool(path, profile, constants, n_samples=n_samples, fs=fs, sos=sos)
    phases = true_phases(path, motion, constants, fs)
    noise = 0.0
    if snr_db is not None and phases.movement is not None:
        vibration = motion.acceleration[slice(*phases.movement)]
        noise = float(np.sqrt(vibration.var(axis=0).mean()) * 10.0 ** (-snr_db / 20.0))
    _rotate_to_sensor(motion.acceleration, person, fs, pose_rng)
    acceleration = sensor.read(motion.acceleration, fs, sensor_rng, extra_noise=noise)
    # A position tracker with a bandwidth of 20 Hz would measure this speed, without the vibration of the tip.
    speed = lowpass(motion.speed, 20.0, fs, order=2)
    _planar_speed_mm_s(speed, path.lateral_m_s, hand.CONTROL_RATE / fs)
    return Recording(
        acceleration=make_read_only(acceleration),
        fs=fs,
        unit="m/s^2",
        recording_id=recording_id,
        surface=surface.name,
        operator=person.name,
        repetition=repetition,
        friction=make_read_only(sensor.read_bridge(motion.grip_force, fs, sensor_rng)),
        normal_force=motion.contact_force,
        speed=make_read_only(speed),
        phases=phases,
        source="simulated",
    )


def mechanics(surface: Surface, person: Operator, tool: Tool) -> Mechanics:
    """Return the mechanical constants of a person who holds a tool on a surface."""
    grip = person.grip_stiffness_n_m
    return Mechanics(
        mass=tool.tip_mass_kg,
        stiffness=grip,
        damping=2.0 * person.grip_damping * float(np.sqrt(grip * tool.tip_mass_kg)),
        mode_mass=tool.mode_mass_kg,
        mode_hz=tool.mode_hz * (grip / 700.0) ** 0.15,
        mode_damping=0.25 * person.grip_damping,
        hertz=surface.hertz_n_m15,
        dissipation=surface.dissipation_s_m,
        static_friction=surface.static_friction,
        kinetic_friction=surface.kinetic_friction,
        stribeck=1e-3 * surface.stribeck_mm_s,
        body_hz=surface.body_hz,
        body_damping=surface.body_damping,
        body_mass=surface.body_mass_kg,
    )


def pressing_depth(surface: Surface, person: Operator, force_n: float | Samples) -> Samples:
    """Return the depth (m) of the hand below the surface at which it presses with `force_n`."""
    return np.asarray(surface.indentation_m(force_n) + force_n / person.grip_stiffness_n_m)


def true_phases(path: hand.Gesture, motion: Motion, constants: Mechanics, fs: float) -> Phases:
    """Return the true phases from the path of the hand and the motion of the tip.

    The impact of a tap is the first contact. Its decay ends when the RMS vibration over 5 ms stays below 3 %
    of its peak, or when the hand starts its next motion.
    """
    taps = []
    for start, stop in (np.round(np.multiply(span, fs)).astype(int).tolist() for span in path.taps_s):
        impact = start + int(np.argmax(motion.contact_force[start:stop] > 0.0))
        power = (motion.acceleration[impact:stop] ** 2).sum(axis=1)
        n = max(round(0.005 * fs), 1)
        envelope = np.sqrt(np.convolve(power, np.ones(n) / n)[: power.size])
        vibrating = np.flatnonzero(envelope > 0.03 * np.sqrt(power.max()))
        taps.append(Tap(start, impact, impact + int(vibrating[-1]) + 1))
    if path.strokes_s is None:
        return Phases(taps=tuple(taps))
    start = round(path.strokes_s * fs)
    limit = constants.static_friction * max(float(motion.contact_force[start]), 0.1)
    distance = np.abs(np.cumsum(motion.speed[start:])) / fs
    onset = start + int(np.argmax(distance > 1.5 * limit / constants.bristle))
    return Phases(taps=tuple(taps), movement=(onset, motion.speed.size), onset=onset)


def _rotate_to_sensor(acceleration: Samples, person: Operator, fs: float, rng: np.random.Generator) -> None:
    """Rotate the acceleration in place into the axes of the sensor, with gravity and a drifting pose."""
    n_knots = int(np.ceil(len(acceleration) / fs * hand.CONTROL_RATE)) + 2
    tilt = np.deg2rad(person.tilt_deg + 2.0 * hand.smooth_noise(n_knots, 0.4, rng))
    azimuth = np.deg2rad(person.azimuth_deg + 3.0 * hand.smooth_noise(n_knots, 0.4, rng))
    knots = np.stack([f(angle) for angle in (tilt, azimuth) for f in (np.cos, np.sin)], axis=1)
    _rotate(acceleration, knots, hand.CONTROL_RATE / fs)


@njit(cache=True, error_model="numpy")
def _planar_speed_mm_s(speed, lateral, knots_per_sample):  # type: ignore[no-untyped-def]
    """Convert velocities along the stroke to speeds in the plane, in place.

    The velocity across the stroke is interpolated linearly between knots.
    """
    last = len(lateral) - 1
    for i in range(len(speed)):
        position = min(i * knots_per_sample, last)
        knot = int(position)
        across = lateral[knot] + (position - knot) * (lateral[min(knot + 1, last)] - lateral[knot])
        speed[i] = 1e3 * np.sqrt(speed[i] * speed[i] + across * across)


@njit(cache=True, error_model="numpy")
def _rotate(acceleration, knots, knots_per_sample):  # type: ignore[no-untyped-def]
    """Rotate each sample in place; the cosines and sines of the angles are linear between knots."""
    for i in range(len(acceleration)):
        position = i * knots_per_sample
        knot = int(position)
        w = position - knot
        a, b = knots[knot], knots[knot + 1]
        cos_tilt, sin_tilt = a[0] + w * (b[0] - a[0]), a[1] + w * (b[1] - a[1])
        cos_azimuth, sin_azimuth = a[2] + w * (b[2] - a[2]), a[3] + w * (b[3] - a[3])
        normal, along, across = acceleration[i, 0] + STANDARD_GRAVITY, acceleration[i, 1], acceleration[i, 2]
        forward = cos_azimuth * along + sin_azimuth * across
        acceleration[i, 0] = cos_tilt * forward - sin_tilt * normal
        acceleration[i, 1] = cos_azimuth * across - sin_azimuth * along
        acceleration[i, 2] = sin_tilt * forward + cos_tilt * normal


def check_duration_and_rate(duration_s: float, fs: float, *, shortest_s: float) -> None:
    """Raise ValueError if the duration or the sampling rate is out of range."""
    if not (np.isfinite(duration_s) and duration_s >= shortest_s):
        raise ValueError(f"duration_s must be at least {shortest_s} s, got {duration_s}")
    if not 1_000 <= fs <= 50_000:
        raise ValueError(f"fs must lie between 1,000 and 50,000 Hz, got {fs}")
