"""What people write of a scene: its TOML, strictly checked, and the paths of hands over it.

The TOML names surfaces, device, what is expected of the hand, tolerance and budget.
"""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import pandas as pd
from pydantic import (
    AfterValidator,
    Field,
    PlainValidator,
    PrivateAttr,
    Strict,
    ValidationInfo,
    model_validator,
)

from texclass.recording import Samples, Unit
from texclass.validation import StrictModel, read_toml, validate

EXAMPLES = Path(__file__).with_name("examples")
COLUMNS = ("time", "x", "y", "force", "surface")


def _rising(pair: tuple[float, float]) -> tuple[float, float]:
    if not 0 <= pair[0] <= pair[1]:
        raise ValueError(f"is {list(pair)}. Expected rising numbers of at least 0")
    return pair


def _existing(path: Path, info: ValidationInfo) -> Path:
    """Return the path of a file beside the definition, whose own path is the context."""
    found = Path(info.context or "").parent / os.path.expanduser(path)  # no error where there is no such user
    if not os.path.isfile(found):  # no error where a name is too long for one
        raise ValueError(f"is {str(path)!r:.200}. Expected an existing file")
    return found


def _card(name: str, info: ValidationInfo) -> str:
    """Return the path of a dataset card beside the definition, or the name of another one."""
    beside = Path(info.context or "").parent / name
    return str(beside) if name.endswith(".toml") and beside.is_file() else name


def _motion(value: Any) -> float | str:
    """Return the name of a column, or a number that holds throughout."""
    named = isinstance(value, str) and value
    if not named and not (type(value) in (int, float) and 0 < value < math.inf):
        raise ValueError(f"is {value!r:.80}. Expected the name of a column, or a number above 0")
    return value  # type: ignore[no-any-return]


Text = Annotated[str, Field(min_length=1)]
File = Annotated[Path, Strict(False), AfterValidator(_existing)]
Range = Annotated[tuple[float, float], Strict(False), AfterValidator(_rising)]


class Device(StrictModel):
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

    rate_hz: float = Field(ge=50, le=1e6)
    band_hz: Range
    noise_floor: float = Field(ge=0)
    largest_output: float = Field(gt=0)
    unit: Unit = "m/s^2"

    @model_validator(mode="after")
    def _can_play_its_band(self) -> Self:
        if not self.band_hz[0] < self.band_hz[1] <= self.rate_hz / 2:
            raise ValueError(f"band_hz is {list(self.band_hz)}. Expected rising, at most rate_hz / 2")
        return self


class Expected(StrictModel):
    """What the hand will do: ranges, or the path file that they are taken from.

    Attributes
    ----------
    speeds_mm_s, forces_n : (float, float)
        Lowest and highest, above 0.
    path : Path or None
    """

    speeds_mm_s: Range
    forces_n: Range
    path: File | None = None

    @model_validator(mode="before")
    @classmethod
    def _of_path(cls, given: Any, info: ValidationInfo) -> Any:
        if not (isinstance(given, dict) and isinstance(given.get("path"), str)):
            return given
        if len(given) > 1:
            raise ValueError(f"holds {', '.join(given)}. Expected a path alone, or speeds_mm_s and forces_n")
        try:
            speeds, forces = read_path(_existing(Path(given["path"]), info)).ranges()
            return given | {"speeds_mm_s": speeds, "forces_n": forces}
        except ValueError as error:
            raise ValueError(f"path: {error}") from error

    @model_validator(mode="after")
    def _moves(self) -> Self:
        for key in ("speeds_mm_s", "forces_n"):
            if not getattr(self, key)[0] > 0:
                raise ValueError(f"{key} begins at {getattr(self, key)[0]:g}. Expected a positive number")
        return self


class Tolerance(StrictModel):
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
    slope_db : float
        Largest difference between how much the levels rise from one speed, or force, to twice as much, over
        all held-out points: what keeps a surface within the limits on average may not lose what speed does.
    """

    score: Literal["log_spectral_db", "band_db", "gfc"]
    limit: float
    over: Literal["worst", "mean"] = "worst"
    level_db: float | None = Field(default=None, gt=0)
    slope_db: float = Field(default=1.5, gt=0)  # 3 dB over two octaves

    @model_validator(mode="before")
    @classmethod
    def _with_level(cls, given: Any) -> Any:
        blind = isinstance(given, dict) and given.get("score") == "gfc"
        return {"level_db": 3.0} | given if blind else given

    @model_validator(mode="after")
    def _can_be_met(self) -> Self:
        rule = "at least 0, at most 0.9999" if self.score == "gfc" else "above 0"
        if not (0 <= self.limit <= 0.9999 if self.score == "gfc" else self.limit > 0):
            raise ValueError(f"limit is {self.limit:g}. Expected for {self.score}: {rule}")
        return self


class Budget(StrictModel):
    """What the loop can afford: microseconds per sample for all contacts together, bytes, contacts."""

    microseconds: float = Field(gt=0)
    bytes: int = Field(ge=1)
    contacts: int = Field(ge=1, le=1000)


class RecordingDefinition(StrictModel):
    """One recording file: speed and force are the name of a column, or one number that holds throughout."""

    file: File
    speed: Annotated[float | str, PlainValidator(_motion)]
    force: Annotated[float | str, PlainValidator(_motion)]
    fs_hz: float | None = Field(default=None, gt=0)
    unit: Unit | None = None
    column: Text | None = None


class SurfaceDefinition(StrictModel):
    """Where one surface comes from: exactly one of the four sources.

    Attributes
    ----------
    texture : Path or None
        A `.texture` file of ours or the `.xml` of a HaTT texture.
    simulated : str or None
        "abdulali2016/S1" ... "abdulali2016/S9", or "catalogue/0", "catalogue/1", ...
    recordings : tuple of RecordingDefinition
        Files, each with columns of speed and force, or constants.
    dataset, surface : str or None
        A dataset card whose recordings carry speed and force, and a surface in it: the surface's name by
        default.
    friction : float or None
        Kinetic friction coefficient, if known: bounds the number of speeds.
    """

    texture: File | None = None
    simulated: Text | None = None
    recordings: tuple[RecordingDefinition, ...] = ()
    dataset: Annotated[Text, AfterValidator(_card)] | None = None
    surface: Text | None = None
    friction: float | None = Field(default=None, ge=0)

    @model_validator(mode="after")
    def _has_one_source(self) -> Self:
        sources = ("texture", "simulated", "recordings", "dataset")
        given = [key for key in sources if getattr(self, key)]
        if len(given) != 1:
            raise ValueError(f"sources are {given}. Expected one of {', '.join(sources)}")
        if self.surface and not self.dataset:
            raise ValueError(f"surface is {self.surface!r}. Expected it only with a dataset")
        return self


class SceneDefinition(StrictModel):
    """A scene, as its TOML says; paths in it are relative to it."""

    name: Text
    device: Device
    expected: Expected
    tolerance: Tolerance
    budget: Budget
    surfaces: dict[str, SurfaceDefinition] = Field(min_length=1)
    seed: int = Field(default=0, ge=0, lt=1 << 63)
    _source: Path = PrivateAttr(default=Path())

    def model_post_init(self, context: Any, /) -> None:
        """Keep the file that was read, which is the context."""
        self._source = Path(context or "")

    @property
    def source(self) -> Path:
        """The file."""
        return self._source


def examples() -> tuple[str, ...]:
    """Return the names of the scenes that are shipped."""
    return tuple(sorted(path.stem for path in EXAMPLES.glob("*.toml")))


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
    path = Path(name_or_path).expanduser()
    if str(name_or_path) in examples():
        path = EXAMPLES / f"{name_or_path}.toml"
    elif not path.is_file():
        raise FileNotFoundError(
            f"{path}: no such file, and none of the shipped scenes ({', '.join(examples())})"
        )
    return validate(SceneDefinition, {"name": path.stem, **read_toml(path)}, path, context=path)


def scene_of_texture(file: str | Path) -> SceneDefinition:
    """Return a scene of one texture file, for a device of at most 2 kHz and everyday speeds and forces.

    Its tolerance is 3 dB between 20 Hz and 0.45 of the rate, its unit the texture's.

    Raises
    ------
    ValueError
        If the file is damaged, or holds no texture to be stroked.
    OSError
        If it cannot be read.
    """
    from texclass.haptics.exchange import describe

    path = Path(file)
    found = describe(path)
    if found["fs"] is None:
        raise ValueError(f"{path}: holds {found['family']!r}, which has no rate. Expected a texture")
    rate = min(float(found["fs"]), 2000.0)
    band = (min(20.0, 0.1 * rate), 0.45 * rate)
    content = {
        "name": found["name"] or path.stem,
        "device": {
            "rate_hz": rate, "band_hz": band, "noise_floor": 0.0, "largest_output": 1e6,
            "unit": found["unit"],
        },
        "expected": {"speeds_mm_s": (40.0, 200.0), "forces_n": (0.4, 2.0)},
        "tolerance": {"score": "log_spectral_db", "limit": 3.0},
        "budget": {"microseconds": 1e6, "bytes": 1 << 30, "contacts": 1},
        "surfaces": {found["name"] or path.stem: {"texture": str(path.resolve())}},
    }  # fmt: skip
    return validate(SceneDefinition, content, path, context=path)


@dataclass(frozen=True, eq=False)
class HandPath:
    """A path at any times.

    Attributes
    ----------
    time_s : ndarray of shape (n,)
        Rising.
    position_mm : ndarray of shape (n, 2)
    force_n : ndarray of shape (n,)
    surface : tuple of (str or None), n of them
        Under the finger; None: none.
    """

    time_s: Samples
    position_mm: Samples
    force_n: Samples
    surface: tuple[str | None, ...]

    @property
    def speed_mm_s(self) -> Samples:
        """Magnitude of the velocity, shape (n,)."""
        with np.errstate(all="ignore"):  # of places and times that no hand reaches
            return np.asarray(np.hypot(*np.gradient(self.position_mm, self.time_s, axis=0).T))

    def ranges(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return what speeds (mm/s) and forces (N) in contact lie between: their 5th and 95th percentiles."""
        speed = self.speed_mm_s
        touching = (self.force_n > 0) & (speed > 0)
        if not np.isfinite(speed).all():
            raise ValueError("the path has infinite speeds. Expected finite speeds")
        if not touching.any():
            raise ValueError("the path never moves under force. Expected a movement with force")
        (slow, fast), (light, hard) = (np.quantile(x[touching], (0.05, 0.95)) for x in (speed, self.force_n))
        return (float(slow), float(fast)), (float(light), float(hard))

    def at_rate(self, fs: float) -> tuple[Samples, Samples, list[str | None]]:
        """Return velocity (n, 2) in mm/s, force (n,) in N and surface of each sample, at a rate in Hz."""
        t = np.arange(max(1, int((self.time_s[-1] - self.time_s[0]) * fs))) / fs + self.time_s[0]
        velocity = np.gradient(self.position_mm, self.time_s, axis=0)
        moved = np.column_stack([np.interp(t, self.time_s, one) for one in velocity.T])
        before = np.searchsorted(self.time_s, t, side="right") - 1
        return moved, np.interp(t, self.time_s, self.force_n), [self.surface[i] for i in before]


def read_path(file: str | Path) -> HandPath:
    """Return the path of a CSV file with the columns time (s), x, y (mm), force (N) and surface.

    An empty surface is none.

    Raises
    ------
    ValueError
        If it is no such file, a number is NaN or infinite, or the time does not rise; the message says where.
    OSError
        If it cannot be read.
    """
    try:
        table = pd.read_csv(file, dtype={"surface": "string"})
        rest = [name for name in COLUMNS if name not in table.columns]
        if rest or len(table.columns) != len(COLUMNS):
            raise ValueError(
                f"columns are {', '.join(map(str, table.columns))}. Expected {', '.join(COLUMNS)}"
            )
        t, x, y, force = (table[name].to_numpy(dtype=np.float64) for name in COLUMNS[:4])
    except (ValueError, TypeError, OverflowError) as error:  # pandas has its own kinds of ValueError
        raise ValueError(f"{file}: {error}") from error
    numbers = np.column_stack([t, x, y, force])
    if len(t) < 2 or not np.isfinite(numbers).all() or np.any(np.diff(t) <= 0):
        row = int(np.argmin(np.isfinite(numbers).all(axis=1))) if len(t) else 0
        raise ValueError(f"{file}: row {row + 2}. Expected finite numbers, a time that rises, 2 rows or more")
    surface = tuple(None if pd.isna(name) else str(name) for name in table["surface"])
    return HandPath(t, np.column_stack([x, y]), force, surface)


def sweep(
    surfaces: Sequence[str],
    speeds_mm_s: tuple[float, float],
    forces_n: tuple[float, float],
    *,
    seconds: float = 2.0,
    fs: float = 1000.0,
) -> HandPath:
    """Return the default path: over each surface in turn, from slow to fast, harder and softer meanwhile."""
    n = max(4, round(seconds * fs))
    rising = np.linspace(0, 1, n, endpoint=False)
    speed = speeds_mm_s[0] + (speeds_mm_s[1] - speeds_mm_s[0]) * rising
    force = forces_n[0] + (forces_n[1] - forces_n[0]) * np.sin(np.pi * rising) ** 2
    x = np.cumsum(np.tile(speed, len(surfaces))) / fs
    named = tuple(name for name in surfaces for _ in range(n))
    return HandPath(
        np.arange(x.size) / fs,
        np.column_stack([x, np.zeros(x.size)]),
        np.tile(force, len(surfaces)),
        named,
    )
