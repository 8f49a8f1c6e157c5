"""From what a scene's TOML says of a surface to what is known of it: textures, simulations, recordings."""

from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np

from texclass.recording import ACCELERATION_UNITS, Recording, Samples
from texclass.scene.definition import RecordingDefinition, SceneDefinition, SurfaceDefinition
from texclass.scene.judge import Judge
from texclass.scene.observed import Observed, Piece, at_rate, of_segments, of_speeds, points_of, segments

SECONDS, SETTLE_S = 4.0, 0.5
"""What a texture or a simulation is felt for at each speed and force, and what is cut off before."""
N_SPEEDS, N_FORCES = 8, 4
"""Speeds and forces at which they are fitted; between them they are chosen."""
N_PROOFS = 8
"""Random speeds and forces at which the choice is judged."""
SIMULATION_HZ = 2000.0

Felt = Callable[[float, float, int], Samples]
"""Vibration at a speed (mm/s), a force (N) and a seed, at the device's rate."""


def observe(surface: SurfaceDefinition, scene: SceneDefinition, judge: Judge) -> Observed:
    """Return what is known of a surface.

    Raises
    ------
    ValueError
        If its files are bad or too short, its unit is not the device's, or its name is unknown.
    OSError
        If a file cannot be read.
    """
    if surface.texture is not None:
        return _of_felt(surface, scene, judge, _texture(surface.texture, scene))
    if surface.simulated is not None:
        return _of_felt(surface, scene, judge, _simulated(surface.simulated, scene))
    if surface.dataset is not None:
        found = _from_dataset(surface)
        pieces = [p for r in found for p in _cut(r, [r.speed, r.normal_force], scene, judge)]
        return of_segments(surface.name, pieces, judge, surface.friction)
    steady = [not isinstance(r.speed, str) and not isinstance(r.force, str) for r in surface.recordings]
    pieces = [p for r in surface.recordings for p in _recorded(r, scene, judge)]
    divide = of_speeds if all(steady) else of_segments
    return divide(surface.name, pieces, judge, surface.friction)


def _of_felt(surface: SurfaceDefinition, scene: SceneDefinition, judge: Judge, felt: Felt) -> Observed:
    """Feel a texture on a grid, between its nodes, and at random."""
    v, f = _places(scene.expected.speeds_mm_s, N_SPEEDS), _places(scene.expected.forces_n, N_FORCES)
    between = [_between(v), _between(f)]
    ranges = np.log([scene.expected.speeds_mm_s, scene.expected.forces_n])
    rng = np.random.default_rng((scene.seed, 1))
    drawn = np.exp(rng.uniform(ranges[:, 0], ranges[:, 1], (N_PROOFS, 2)))
    parts = [list(product(v, f)), list(product(*between)), drawn.tolist()]
    seed, peak, points = 0, 0.0, []
    for part in parts:
        pieces = []
        for speed, force in part:
            seed += 1
            x = felt(speed, force, seed)
            peak = max(peak, float(np.abs(x).max()))
            pieces.append(Piece(x, speed, force))
        points.append(points_of(pieces, judge))
    how = f"{len(parts[2])} random speeds and forces"
    return Observed(surface.name, points[0], points[1], points[2], peak, how, surface.friction)


def _places(between: tuple[float, float], n: int) -> list[float]:
    low, high = between
    return [low] if low == high else np.geomspace(low, high, n).tolist()


def _between(places: list[float]) -> list[float]:
    at = np.array(places)
    return np.sqrt(at[:-1] * at[1:]).tolist() if at.size > 1 else places


def _texture(path: Path, scene: SceneDefinition) -> Felt:
    from texclass.exchange import load_texture, read_hatt, read_texture_file

    is_hatt = path.suffix.lower() == ".xml"
    texture = read_hatt(path) if is_hatt else load_texture(path)
    unit = "m/s^2" if is_hatt else read_texture_file(path).unit
    factor = _factor(unit, scene.device.unit, path)

    def felt(speed: float, force: float, seed: int) -> Samples:
        n = round((SECONDS + SETTLE_S) * texture.fs)
        velocity = np.column_stack([np.full(n, speed), np.zeros(n)])
        x = texture.renderer(seed=seed).process(velocity, np.full(n, force))
        return at_rate(factor * x[round(SETTLE_S * texture.fs) :], texture.fs, scene.device.rate_hz)

    return felt


def _simulated(name: str, scene: SceneDefinition) -> Felt:
    family, _, which = name.partition("/")
    if scene.device.unit != "m/s^2":
        raise ValueError(f"unit of the device is {scene.device.unit}; the rule for simulations is m/s^2")
    match family:
        case "abdulali2016":
            return _resonant(which, scene)
        case "catalogue" if which.isdecimal():
            return _catalogued(int(which), scene)
    raise ValueError(f"simulated is {name!r}; the rule is abdulali2016/S1 ... S9 or catalogue/0, 1, ...")


def _resonant(which: str, scene: SceneDefinition) -> Felt:
    from texclass.textures.abdulali2016 import surface

    what, fs = surface(which), scene.device.rate_hz

    def felt(speed: float, force: float, seed: int) -> Samples:
        n = round(SECONDS * fs)
        velocity = np.column_stack([np.full(n, speed), np.zeros(n)])
        x = what.vibration(velocity, np.full(n, force), fs, np.random.default_rng((scene.seed, seed)))
        return at_rate(x, fs, fs)

    return felt


def _catalogued(which: int, scene: SceneDefinition) -> Felt:
    from texclass.signals import combine, remove_hand_motion
    from texclass.simulate import operator_catalogue, record_rising_speed, surface_catalogue

    what, operator = surface_catalogue(which + 1, 0)[which], operator_catalogue(1, 0)[0]
    fs = max(SIMULATION_HZ, scene.device.rate_hz)

    def felt(speed: float, force: float, seed: int) -> Samples:
        plate = record_rising_speed(
            what,
            operator,
            duration_s=SECONDS + SETTLE_S,
            fs=fs,
            seed=(scene.seed, which, seed),
            speed_mm_s=(speed, speed),
            force_n=force,
        )
        moving = combine(plate.acceleration[round(SETTLE_S * fs) :])
        return at_rate(remove_hand_motion(moving, fs), fs, scene.device.rate_hz)

    return felt


def _recorded(recording: RecordingDefinition, scene: SceneDefinition, judge: Judge) -> list[Piece]:
    from texclass.loaders import load_recording

    named = {
        field: column
        for field, column in (("speed", recording.speed), ("normal_force", recording.force))
        if isinstance(column, str)
    }
    unit = recording.unit or scene.device.unit
    found = load_recording(
        recording.file, fs=recording.fs_hz, unit=unit, column=recording.column, auxiliary=named
    )
    if named:
        motion = [
            np.full(len(found.acceleration), given) if not isinstance(given, str) else column
            for given, column in ((recording.speed, found.speed), (recording.force, found.normal_force))
        ]
        return _cut(found, motion, scene, judge)
    x = _vibration(found, scene)
    return [Piece(x, float(recording.speed), float(recording.force))]


def _from_dataset(surface: SurfaceDefinition) -> list[Recording]:
    from texclass.loaders import open_dataset

    recordings = open_dataset(str(surface.dataset))
    wanted = [r for r in recordings if r.material == surface.material]
    if not wanted:
        raise ValueError(
            f"surface {surface.name}: dataset {surface.dataset} has no material {surface.material!r}; "
            "the rule is one of its materials"
        )
    lacking = [r.recording_id for r in wanted if r.speed is None or r.normal_force is None]
    if lacking:
        raise ValueError(
            f"surface {surface.name}: recording {lacking[0]} has no speed or no force; the rule is both"
        )
    return wanted


def _cut(found: Recording, motion: list[Samples | None], scene: SceneDefinition, judge: Judge) -> list[Piece]:
    x = _vibration(found, scene)
    when = np.arange(x.size) / scene.device.rate_hz
    clock = np.arange(len(found.acceleration)) / found.fs
    speed, force = (np.interp(when, clock, np.asarray(one)) for one in motion)
    return segments(x, speed, force, judge, (scene.expected.speeds_mm_s, scene.expected.forces_n))


def _vibration(found: Recording, scene: SceneDefinition) -> Samples:
    from texclass.signals import combine

    where = found.source or found.recording_id
    if found.fs < 2 * scene.device.band_hz[1]:
        raise ValueError(
            f"{where}: fs is {found.fs:g} Hz; the rule is twice the end of the band, "
            f"{2 * scene.device.band_hz[1]:g} Hz, at least"
        )
    x = combine(np.asarray(found.acceleration, dtype=np.float64))
    return at_rate(_factor(found.unit, scene.device.unit, where) * x, found.fs, scene.device.rate_hz)


def _factor(unit: str, wanted: str, where: object) -> float:
    if unit == wanted:
        return 1.0
    if unit in ACCELERATION_UNITS and wanted in ACCELERATION_UNITS:
        return ACCELERATION_UNITS[unit] / ACCELERATION_UNITS[wanted]
    raise ValueError(f"{where}: unit is {unit}, the device's {wanted}; the rule is the same, or both known")
