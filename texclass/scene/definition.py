"""A scene's TOML: surfaces, device, what is expected of the hand, tolerance and budget; strictly checked."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from texclass.recording import ACCELERATION_UNITS, SCALELESS_UNITS
from texclass.scene.checked import Table, is_number
from texclass.validation import read_toml

Score = Literal["log_spectral_db", "band_db", "gfc"]
Over = Literal["worst", "mean"]
UNITS = (*ACCELERATION_UNITS, *SCALELESS_UNITS)
EXAMPLES = Path(__file__).with_name("examples")


@dataclass(frozen=True)
class Device:
    """What plays the scene.

    Attributes
    ----------
    rate_hz : float
        Samples per second.
    band_hz : (float, float)
        What it can make felt.
    noise_floor : float
        RMS of its own noise within the band, in `unit`: what is weaker is not felt.
    largest_output : float
        In `unit`.
    unit : str
        Of the vibration.
    """

    rate_hz: float
    band_hz: tuple[float, float]
    noise_floor: float
    largest_output: float
    unit: str = "m/s^2"


@dataclass(frozen=True)
class Expected:
    """What the hand will do.

    Attributes
    ----------
    speeds_mm_s, forces_n : (float, float)
        Lowest and highest.
    path : Path or None
        The path file the ranges were taken from, if any.
    """

    speeds_mm_s: tuple[float, float]
    forces_n: tuple[float, float]
    path: Path | None = None


@dataclass(frozen=True)
class Tolerance:
    """How far a model may be from the surface.

    Attributes
    ----------
    score : str
        "log_spectral_db": RMS difference of the power spectra over 64 equal parts of the band, dB.
        "band_db": the same over third octaves. "gfc": goodness of fit of the amplitudes, blind to level.
    limit : float
        At most so many dB; for "gfc" at least so much.
    over : {"worst", "mean"}
        Whether the worst held-out speed and force must be within it, or their mean.
    level_db : float or None
        Largest difference of level; None: none of its own (the scores in dB contain it). 3 for "gfc".
    """

    score: Score
    limit: float
    over: Over = "worst"
    level_db: float | None = None


@dataclass(frozen=True)
class Budget:
    """What the loop can afford: microseconds per sample for all contacts together, bytes, contacts."""

    microseconds: float
    bytes: int
    contacts: int


@dataclass(frozen=True)
class SurfaceDefinition:
    """Where one surface comes from: exactly one of the four sources.

    Attributes
    ----------
    name : str
    texture : Path or None
        A `.texture` file of ours or the `.xml` of a HaTT texture.
    simulated : str or None
        "abdulali2016/S1" ... "abdulali2016/S9", or "catalogue/0", "catalogue/1", ...
    recordings : tuple of RecordingDefinition
        Files, each with columns of speed and force, or constants.
    dataset, material : str or None
        A dataset card whose recordings carry speed and force, and a material in it.
    friction : float or None
        Kinetic friction coefficient, if known: bounds the number of speeds.
    """

    name: str
    texture: Path | None = None
    simulated: str | None = None
    recordings: "tuple[RecordingDefinition, ...]" = ()
    dataset: str | None = None
    material: str | None = None
    friction: float | None = None


@dataclass(frozen=True)
class RecordingDefinition:
    """One recording file: speed and force are the name of a column, or one number that holds throughout."""

    file: Path
    speed: str | float
    force: str | float
    fs_hz: float | None = None
    unit: str | None = None
    column: str | None = None


@dataclass(frozen=True)
class SceneDefinition:
    """A scene, as its TOML says."""

    name: str
    device: Device
    expected: Expected
    tolerance: Tolerance
    budget: Budget
    surfaces: tuple[SurfaceDefinition, ...]
    source: Path
    seed: int = 0


def examples() -> tuple[str, ...]:
    """Return the names of the scenes that are shipped."""
    return tuple(sorted(path.stem for path in EXAMPLES.glob("*.toml")))


def locate_scene(name_or_path: str | Path) -> Path:
    """Return the file of a shipped scene, or the given path."""
    shipped, path = EXAMPLES / f"{name_or_path}.toml", Path(name_or_path).expanduser()
    if shipped.is_file() and path.name == str(name_or_path):
        return shipped
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: no such file, and none of the shipped scenes ({', '.join(examples())})"
        )
    return path


def read_scene(name_or_path: str | Path) -> SceneDefinition:
    """Return a scene's definition; the paths in it are relative to its file.

    Parameters
    ----------
    name_or_path : str or Path
        A shipped scene (`examples`), or a TOML file.

    Raises
    ------
    ValueError
        If it is no TOML, a key is missing or unknown, or a value breaks its rule; the message names file,
        key, value and rule.
    FileNotFoundError
        If there is no such file.
    """
    path = locate_scene(name_or_path)
    top = Table(read_toml(path), str(path), path.parent)
    top.keys("device", "expected", "tolerance", "budget", "surfaces", optional=("name", "seed"))
    surfaces = top.table("surfaces")
    if not surfaces.values:
        raise ValueError(f"{path}: no surface; the rule is at least one [surfaces.NAME]")
    return SceneDefinition(
        top.text("name", path.stem),
        _device(top.table("device")),
        _expected(top.table("expected")),
        _tolerance(top.table("tolerance")),
        _budget(top.table("budget")),
        tuple(_surface(name, surfaces.table(name)) for name in surfaces.values),
        path,
        int(top.number("seed", at_least=0, default=0, whole=True)),
    )


def _device(table: Table) -> Device:
    table.keys("rate_hz", "band_hz", "noise_floor", "largest_output", optional=("unit",))
    rate, band = table.number("rate_hz", at_least=50, at_most=1e6), table.pair("band_hz")
    if band[1] > rate / 2:
        raise ValueError(f"{table.where}: band_hz ends at {band[1]:g}; the rule is at most rate_hz / 2")
    floor = table.number("noise_floor", at_least=0)
    largest = table.number("largest_output", above=0)
    return Device(rate, band, floor, largest, table.text("unit", "m/s^2", one_of=UNITS))


def _expected(table: Table) -> Expected:
    if "path" in table.values:
        from texclass.scene.paths import read_path

        table.keys("path")
        path = read_path(table.file("path"))
        try:
            return Expected(path.speed_range(), path.force_range(), table.file("path"))
        except ValueError as error:
            raise ValueError(f"{table.where}: path: {error}") from error
    table.keys("speeds_mm_s", "forces_n")
    ranges = [table.pair(key, equal=True) for key in ("speeds_mm_s", "forces_n")]
    for key, (low, _) in zip(("speeds_mm_s", "forces_n"), ranges, strict=True):
        if low <= 0:
            raise ValueError(f"{table.where}: {key} begins at {low:g}; the rule is above 0")
    return Expected(ranges[0], ranges[1])


def _tolerance(table: Table) -> Tolerance:
    table.keys("score", "limit", optional=("over", "level_db"))
    score: Any = table.text("score", one_of=get_args(Score))
    over: Any = table.text("over", "worst", one_of=get_args(Over))
    bounds = {"at_least": 0.0, "at_most": 0.9999} if score == "gfc" else {"above": 0.0}
    limit = table.number("limit", **bounds)  # type: ignore[arg-type]
    level = table.number("level_db", above=0, default=3.0)
    return Tolerance(score, limit, over, level if score == "gfc" or "level_db" in table.values else None)


def _budget(table: Table) -> Budget:
    table.keys("microseconds", "bytes", "contacts")
    n_bytes = table.number("bytes", at_least=1, whole=True)
    contacts = table.number("contacts", at_least=1, at_most=1000, whole=True)
    return Budget(table.number("microseconds", above=0), int(n_bytes), int(contacts))


def _surface(name: str, table: Table) -> SurfaceDefinition:
    sources = ("texture", "simulated", "recordings", "dataset")
    given = [key for key in sources if key in table.values]
    if len(given) != 1:
        raise ValueError(f"{table.where}: sources are {given}; the rule is one of {', '.join(sources)}")
    table.keys(given[0], optional=("friction", *(("material",) if given == ["dataset"] else ())))
    friction = table.number("friction", at_least=0) if "friction" in table.values else None
    match given[0]:
        case "texture":
            return SurfaceDefinition(name, texture=table.file("texture"), friction=friction)
        case "simulated":
            return SurfaceDefinition(name, simulated=table.text("simulated"), friction=friction)
        case "dataset":
            dataset, material = table.text("dataset"), table.text("material", name)
            beside = table.folder / dataset
            return SurfaceDefinition(
                name,
                dataset=str(beside) if dataset.endswith(".toml") and beside.is_file() else dataset,
                material=material,
                friction=friction,
            )
    files = table.values["recordings"]
    if not isinstance(files, list) or not files or not all(isinstance(one, dict) for one in files):
        raise ValueError(
            f"{table.where}: recordings is {files!r}; the rule is tables with file, speed, force"
        )
    rows = [Table(one, f"{table.where}: recordings {i}", table.folder) for i, one in enumerate(files, 1)]
    return SurfaceDefinition(name, recordings=tuple(map(_recording, rows)), friction=friction)


def _recording(table: Table) -> RecordingDefinition:
    table.keys("file", "speed", "force", optional=("fs_hz", "unit", "column"))
    speed, force = (_motion(table, key) for key in ("speed", "force"))
    return RecordingDefinition(
        table.file("file"),
        speed,
        force,
        table.number("fs_hz", above=0) if "fs_hz" in table.values else None,
        table.text("unit", one_of=UNITS) if "unit" in table.values else None,
        table.text("column") if "column" in table.values else None,
    )


def _motion(table: Table, key: str) -> str | float:
    return table.number(key, above=0) if is_number(table.values[key]) else table.text(key)
