"""Read and validate scene files (TOML) and hand paths (CSV).

A scene file defines the surfaces, the device, the motion of the hand, the tolerance and the budget.
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

from texclass.haptics.textures.contract import stroke_range
from texclass.recording import Samples, Unit
from texclass.validation import StrictModel, read_toml, validate

EXAMPLES = Path(__file__).with_name("examples")
COLUMNS = ("time", "x", "y", "force", "surface")


def _check_range(pair: tuple[float, float]) -> tuple[float, float]:
    if not 0 <= pair[0] <= pair[1]:
        raise ValueError(f"must be two increasing, non-negative numbers, got {list(pair)}")
    return pair


def _resolve_file(path: Path, info: ValidationInfo) -> Path:
    """Resolve a file path relative to the scene file, whose path is the validation context."""
    file = Path(info.context or "").parent / os.path.expanduser(path)  # does not raise for an unknown user
    if not os.path.isfile(file):  # Path.is_file raises if the name is too long
        raise ValueError(f"must be an existing file, got {str(path)!r:.200}")
    return file


def _resolve_card(name: str, info: ValidationInfo) -> str:
    """Return the path of a dataset card next to the scene file, or the name of a shipped card."""
    path = Path(info.context or "").parent / name
    return str(path) if name.endswith(".toml") and path.is_file() else name


def _check_motion(value: Any) -> float | str:
    """Return a column name or a positive constant."""
    is_column = isinstance(value, str) and value
    if not is_column and not (type(value) in (int, float) and 0 < value < math.inf):
        raise ValueError(f"must be a column name or a positive number, got {value!r:.80}")
    return value  # type: ignore[no-any-return]


Text = Annotated[str, Field(min_length=1)]
File = Annotated[Path, Strict(False), AfterValidator(_resolve_file)]
Range = Annotated[tuple[float, float], Strict(False), AfterValidator(_check_range)]


class Device(StrictModel):
    """Table `[device]`: the device that renders the scene.

    Attributes
    ----------
    rate_hz : float
        Sampling rate of the output in Hz.
    band_hz : (float, float)
        Frequency range that the device reproduces, in Hz.
    noise_floor : float
        RMS of the device's own noise within the band, in `unit`. Weaker vibration is imperceptible.
    largest_output : float
        Largest output in `unit`.
    unit : str
        Unit of the vibration (default "m/s^2").

    Examples
    --------
    >>> Device(rate_hz=1000, band_hz=(20, 450), noise_floor=0.05, largest_output=30).unit
    'm/s^2'
    """

    rate_hz: float = Field(ge=50, le=1e6)
    band_hz: Range
    noise_floor: float = Field(ge=0)
    largest_output: float = Field(gt=0)
    unit: Unit = "m/s^2"

    @model_validator(mode="after")
    def _check_band(self) -> Self:
        if not self.band_hz[0] < self.band_hz[1] <= self.rate_hz / 2:
            raise ValueError(
                f"band_hz must increase and end at or below rate_hz / 2, got {list(self.band_hz)}"
            )
        return self


class MotionRange(StrictModel):
    """Table `[motion]`: the range of hand motion, or a path file to derive it from.

    Attributes
    ----------
    speeds_mm_s : (float, float)
        Lowest and highest speed in mm/s, both positive.
    forces_n : (float, float)
        Lowest and highest normal force in N, both positive.
    path : Path or None
        Hand path (CSV, see `read_path`) whose 5th and 95th percentiles of speed and force define both ranges.

    Examples
    --------
    >>> MotionRange(speeds_mm_s=(40, 200), forces_n=(0.4, 2)).forces_n
    (0.4, 2.0)
    """

    speeds_mm_s: Range
    forces_n: Range
    path: File | None = None

    @model_validator(mode="before")
    @classmethod
    def _read_path(cls, content: Any, info: ValidationInfo) -> Any:
        if not (isinstance(content, dict) and isinstance(content.get("path"), str)):
            return content
        if len(content) > 1:
            keys = ", ".join(content)
            raise ValueError(f"must define either path or speeds_mm_s and forces_n, got {keys}")
        try:
            speeds, forces = read_path(_resolve_file(Path(content["path"]), info)).ranges()
            return content | {"speeds_mm_s": speeds, "forces_n": forces}
        except ValueError as error:
            raise ValueError(f"path: {error}") from error

    @model_validator(mode="after")
    def _check_positive(self) -> Self:
        for key in ("speeds_mm_s", "forces_n"):
            if not getattr(self, key)[0] > 0:
                raise ValueError(f"the lower end of {key} must be positive, got {getattr(self, key)[0]:g}")
        return self


class Tolerance(StrictModel):
    """Table `[tolerance]`: the largest accepted difference between a model and its surface.

    Attributes
    ----------
    score : {"log_spectral_db", "band_db", "gfc"}
        "log_spectral_db": RMS difference of the power spectra in dB, over 64 equal subbands.
        "band_db": RMS difference of the power spectra in dB, over third-octave bands.
        "gfc": goodness-of-fit criterion of the amplitude spectra, which ignores the level.
    limit : float
        Largest accepted score in dB; for "gfc", the smallest accepted score.
    aggregate : {"worst", "mean"}
        Whether the limits apply to the worst test point (default) or to the mean over the test points.
    level_db : float or None
        Largest accepted level error in dB. The default is 3 for "gfc", and None (no separate limit) for the
        scores in dB, which include the level.
    slope_db : float
        Largest accepted error of the level change per doubling of speed or force, in dB, over all test points
        (default 1.5). This limit rejects models that ignore the speed although their mean error is small.

    Examples
    --------
    >>> Tolerance(score="gfc", limit=0.9).level_db
    3.0
    """

    score: Literal["log_spectral_db", "band_db", "gfc"]
    limit: float
    aggregate: Literal["worst", "mean"] = "worst"
    level_db: float | None = Field(default=None, gt=0)
    slope_db: float = Field(default=1.5, gt=0)  # 3 dB over two octaves

    @model_validator(mode="before")
    @classmethod
    def _add_level(cls, content: Any) -> Any:
        ignores_level = isinstance(content, dict) and content.get("score") == "gfc"
        return {"level_db": 3.0} | content if ignores_level else content

    @model_validator(mode="after")
    def _check_limit(self) -> Self:
        if self.score == "gfc" and not 0 <= self.limit <= 0.9999:
            raise ValueError(f"limit must be between 0 and 0.9999 for gfc, got {self.limit:g}")
        if self.score != "gfc" and not self.limit > 0:
            raise ValueError(f"limit must be positive for {self.score}, got {self.limit:g}")
        return self


class Budget(StrictModel):
    """Table `[budget]`: the time and memory available in the haptic loop.

    Attributes
    ----------
    microseconds : float
        Time per sample for all contacts together, in us.
    bytes : int
        Memory of the renderer in bytes.
    contacts : int
        Number of simultaneous contacts, 1 to 1000.

    Examples
    --------
    >>> Budget(microseconds=10, bytes=100_000, contacts=4).contacts
    4
    """

    microseconds: float = Field(gt=0)
    bytes: int = Field(ge=1)
    contacts: int = Field(ge=1, le=1000)


class RecordingDefinition(StrictModel):
    """One recording file of a surface.

    Attributes
    ----------
    file : Path
        Recording file in any format that `texclass.load_recording` supports.
    speed : float or str
        Constant speed in mm/s, or the name of the column that contains it.
    force : float or str
        Constant normal force in N, or the name of the column that contains it.
    fs_hz : float or None
        Sampling rate in Hz, if the file does not contain it.
    unit : str or None
        Unit of the vibration (default: unit of the device).
    column : str or None
        Name of the acceleration column.

    Examples
    --------
    >>> RecordingDefinition(file=__file__, speed=80, force="normal_force").speed
    80
    """

    file: File
    speed: Annotated[float | str, PlainValidator(_check_motion)]
    force: Annotated[float | str, PlainValidator(_check_motion)]
    fs_hz: float | None = Field(default=None, gt=0)
    unit: Unit | None = None
    column: Text | None = None


class SurfaceDefinition(StrictModel):
    """Table `[surfaces.NAME]`: the source of one surface.

    Define exactly one of `texture`, `simulated`, `recordings` and `dataset`.

    Attributes
    ----------
    texture : Path or None
        A `.texture` file, or the `.xml` file of a HaTT texture.
    simulated : str or None
        "abdulali2016/S1" to "abdulali2016/S9", or "catalogue/0", "catalogue/1", ...
    recordings : tuple of RecordingDefinition
        Recording files with speed and force.
    dataset : str or None
        Dataset card whose recordings contain speed and force.
    surface : str or None
        Surface of the dataset (default: NAME).
    friction : float or None
        Kinetic friction coefficient (optional). It limits the number of speed nodes of the model.

    Examples
    --------
    >>> SurfaceDefinition(simulated="abdulali2016/S8", friction=0.4).friction
    0.4
    """

    texture: File | None = None
    simulated: Text | None = None
    recordings: tuple[RecordingDefinition, ...] = ()
    dataset: Annotated[Text, AfterValidator(_resolve_card)] | None = None
    surface: Text | None = None
    friction: float | None = Field(default=None, ge=0)

    @model_validator(mode="after")
    def _check_source(self) -> Self:
        sources = ("texture", "simulated", "recordings", "dataset")
        defined = [key for key in sources if getattr(self, key)]
        if len(defined) != 1:
            raise ValueError(f"must define exactly one of {', '.join(sources)}, got {defined}")
        if self.surface and not self.dataset:
            raise ValueError(f"the key surface requires the key dataset, got only surface = {self.surface!r}")
        return self


class SceneDefinition(StrictModel):
    """Content of a scene file. Relative paths are resolved from the folder of the file.

    Attributes
    ----------
    name : str
        Name of the scene (default: name of the file).
    device : Device
        Device that renders the scene.
    motion : MotionRange
        Range of hand motion.
    tolerance : Tolerance
        Largest accepted difference between models and surfaces.
    budget : Budget
        Time and memory available in the haptic loop.
    surfaces : dict of str to SurfaceDefinition
        Surfaces by name, at least one.
    seed : int
        Seed of simulations and random test points (default 0).

    Examples
    --------
    >>> from texclass.haptics.scene import read_scene
    >>> scene = read_scene("example")
    >>> scene.device.rate_hz, list(scene.surfaces)[:2]
    (1000.0, ['fabric', 'wood'])
    """

    name: Text
    device: Device
    motion: MotionRange
    tolerance: Tolerance
    budget: Budget
    surfaces: dict[str, SurfaceDefinition] = Field(min_length=1)
    seed: int = Field(default=0, ge=0, lt=1 << 63)
    _source: Path = PrivateAttr(default=Path())

    def model_post_init(self, context: Any, /) -> None:
        """Store the path of the scene file, which is the validation context."""
        self._source = Path(context or "")

    @property
    def source(self) -> Path:
        """Path of the scene file."""
        return self._source


def shipped_scenes() -> tuple[str, ...]:
    """Return the names of the shipped scenes."""
    return tuple(sorted(path.stem for path in EXAMPLES.glob("*.toml")))


def read_scene(name_or_path: str | Path) -> SceneDefinition:
    """Read and validate a scene file.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped scene ("example", "twenty") or path of a TOML file.

    Returns
    -------
    SceneDefinition
        Validated scene, with paths resolved from the folder of the file.

    Raises
    ------
    ValueError
        If the file is not valid TOML, a key is missing or unknown, or a value is invalid. The message
        contains the file, the key and the value.
    FileNotFoundError
        If the file does not exist.

    Examples
    --------
    >>> from texclass.haptics.scene import read_scene
    >>> read_scene("example").tolerance.limit
    3.0
    """
    path = Path(name_or_path).expanduser()
    if str(name_or_path) in shipped_scenes():
        path = EXAMPLES / f"{name_or_path}.toml"
    elif not path.is_file():
        raise FileNotFoundError(
            f"{path} does not exist. Expected a scene file (TOML) or a shipped scene: "
            f"{', '.join(shipped_scenes())}"
        )
    return validate(SceneDefinition, {"name": path.stem, **read_toml(path)}, path, context=path)


def scene_from_texture(file: str | Path) -> SceneDefinition:
    """Return a scene that contains a single texture file.

    The device has a sampling rate of at most 2 kHz, a band from 20 Hz to 0.45 times this rate, and the unit
    of the texture. The motion range is that of the texture, see
    `texclass.haptics.textures.contract.stroke_range`. The tolerance is 3 dB.

    Parameters
    ----------
    file : str or Path
        A `.texture` file, or the `.xml` file of a HaTT texture.

    Returns
    -------
    SceneDefinition
        Scene with one surface, named after the texture.

    Raises
    ------
    ValueError
        If the file is damaged or contains no texture.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> from texclass.haptics import save_texture
    >>> from texclass.haptics.scene import scene_from_texture
    >>> from texclass.haptics.textures.hatt import HattTexture
    >>> speed, force = [20.0, 200.0, 20.0, 200.0], [0.5, 0.5, 2.0, 2.0]
    >>> lsf = [[0.6, 1.1]] * 4
    >>> texture = HattTexture.from_models(speed, force, lsf, [1.0] * 4, 1000.0, name="oak")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     scene = scene_from_texture(save_texture(texture, f"{folder}/oak.texture"))
    >>> list(scene.surfaces), scene.device.band_hz, scene.motion.speeds_mm_s
    (['oak'], (20.0, 450.0), (20.0, 200.0))
    """
    from texclass.haptics.exchange import describe, load_texture

    path = Path(file)
    facts = describe(path)
    if facts["fs"] is None:
        raise ValueError(f"{path}: expected a texture, got {facts['family']!r}, which has no sampling rate")
    rate = min(float(facts["fs"]), 2000.0)
    band = (min(20.0, 0.1 * rate), 0.45 * rate)
    speeds, forces = stroke_range(load_texture(path))
    name = facts["name"] or path.stem
    content = {
        "name": name,
        "device": {
            "rate_hz": rate, "band_hz": band, "noise_floor": 0.0, "largest_output": 1e6,
            "unit": facts["unit"],
        },
        "motion": {"speeds_mm_s": speeds, "forces_n": forces},
        "tolerance": {"score": "log_spectral_db", "limit": 3.0},
        "budget": {"microseconds": 1e6, "bytes": 1 << 30, "contacts": 1},
        "surfaces": {name: {"texture": str(path.resolve())}},
    }  # fmt: skip
    return validate(SceneDefinition, content, path, context=path)


@dataclass(frozen=True, eq=False)
class HandPath:
    """Position and force of one contact over time; the sampling times need not be uniform.

    Attributes
    ----------
    time_s : ndarray of shape (n,)
        Strictly increasing times in s.
    position_mm : ndarray of shape (n, 2)
        Position in mm.
    force_n : ndarray of shape (n,)
        Normal force in N.
    surfaces : tuple of (str or None) of length n
        Touched surface at each time; None if there is no contact.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.haptics.scene import HandPath
    >>> position = np.array([[0.0, 0.0], [30.0, 40.0], [60.0, 80.0]])
    >>> HandPath(np.arange(3.0), position, np.ones(3), ("oak",) * 3).speed_mm_s
    array([50., 50., 50.])
    """

    time_s: Samples
    position_mm: Samples
    force_n: Samples
    surfaces: tuple[str | None, ...]

    @property
    def speed_mm_s(self) -> Samples:
        """Magnitude of the velocity in mm/s, shape (n,)."""
        with np.errstate(all="ignore"):  # huge positions overflow; `ranges` rejects infinite speeds
            return np.asarray(np.hypot(*np.gradient(self.position_mm, self.time_s, axis=0).T))

    def ranges(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the 5th and 95th percentiles of speed (mm/s) and force (N) during contact.

        Raises
        ------
        ValueError
            If a speed is infinite, or the path contains no movement with a positive force.
        """
        speed = self.speed_mm_s
        in_contact = (self.force_n > 0) & (speed > 0)
        if not np.isfinite(speed).all():
            raise ValueError(
                "the speeds of the path must be finite, got infinity. Check the columns time, x and y"
            )
        if not in_contact.any():
            raise ValueError("path must contain a movement with a positive force, got none")
        (slow, fast), (light, hard) = (
            np.quantile(x[in_contact], (0.05, 0.95)) for x in (speed, self.force_n)
        )
        return (float(slow), float(fast)), (float(light), float(hard))

    def resample(self, fs: float) -> tuple[Samples, Samples, list[str | None]]:
        """Return velocity, force and surface at a constant sampling rate.

        Parameters
        ----------
        fs : float
            Sampling rate in Hz.

        Returns
        -------
        velocity : ndarray of shape (n, 2)
            Velocity in mm/s.
        force : ndarray of shape (n,)
            Normal force in N.
        surfaces : list of (str or None)
            Surface in contact at each sample.
        """
        t = np.arange(max(1, int((self.time_s[-1] - self.time_s[0]) * fs))) / fs + self.time_s[0]
        gradient = np.gradient(self.position_mm, self.time_s, axis=0)
        velocity = np.column_stack([np.interp(t, self.time_s, axis) for axis in gradient.T])
        rows = np.searchsorted(self.time_s, t, side="right") - 1
        return velocity, np.interp(t, self.time_s, self.force_n), [self.surfaces[row] for row in rows]


def read_path(file: str | Path) -> HandPath:
    """Read a hand path from a CSV file.

    Parameters
    ----------
    file : str or Path
        CSV file with the columns time (s), x and y (mm), force (N) and surface. An empty surface cell means
        no contact.

    Returns
    -------
    HandPath
        Hand path at the sampling times of the file.

    Raises
    ------
    ValueError
        If columns are missing or unknown, a number is not finite, or the times do not increase.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from texclass.haptics.scene import read_path
    >>> rows = ["time,x,y,force,surface", "0,0,0,1,oak", "1,50,0,1,oak"]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "path.csv")
    ...     size = file.write_text(chr(10).join(rows))
    ...     path = read_path(file)
    >>> path.ranges()
    ((50.0, 50.0), (1.0, 1.0))
    """
    try:
        table = pd.read_csv(file, dtype={"surface": "string"})
        if len(table.columns) != len(COLUMNS) or not set(COLUMNS) <= set(table.columns):
            columns = ", ".join(map(str, table.columns))
            raise ValueError(f"columns must be {', '.join(COLUMNS)}, got {columns}")
        t, x, y, force = (table[name].to_numpy(dtype=np.float64) for name in COLUMNS[:4])
    except (ValueError, TypeError, OverflowError) as error:  # pandas raises several subclasses of ValueError
        raise ValueError(f"{file}: {error}") from error
    numbers = np.column_stack([t, x, y, force])
    if len(t) < 2 or not np.isfinite(numbers).all() or np.any(np.diff(t) <= 0):
        row = int(np.argmin(np.isfinite(numbers).all(axis=1))) if len(t) else 0
        raise ValueError(
            f"{file}: row {row + 2} is invalid. Expected finite numbers, increasing times and at least 2 rows"
        )
    surfaces = tuple(None if pd.isna(name) else str(name) for name in table["surface"])
    return HandPath(t, np.column_stack([x, y]), force, surfaces)


def sweep_path(
    surfaces: Sequence[str],
    speeds_mm_s: tuple[float, float],
    forces_n: tuple[float, float],
    *,
    seconds: float = 2.0,
    fs: float = 1000.0,
) -> HandPath:
    """Return a path that strokes the surfaces one after another, each with increasing speed.

    Parameters
    ----------
    surfaces : sequence of str
        Names of the surfaces, in order.
    speeds_mm_s : (float, float)
        First and last speed on each surface in mm/s.
    forces_n : (float, float)
        Force at the beginning and end of each stroke, and force in the middle of the stroke, in N.
    seconds : float
        Duration on each surface in s (default 2).
    fs : float
        Sampling rate in Hz (default 1000).

    Returns
    -------
    HandPath
        Path along x.

    Examples
    --------
    >>> from texclass.haptics.scene import sweep_path
    >>> path = sweep_path(["oak", "cork"], (40.0, 200.0), (0.5, 2.0), seconds=1.0)
    >>> path.time_s.size, path.surfaces[0], path.surfaces[-1]
    (2000, 'oak', 'cork')
    """
    n = max(4, round(seconds * fs))
    phase = np.linspace(0, 1, n, endpoint=False)
    speed = speeds_mm_s[0] + (speeds_mm_s[1] - speeds_mm_s[0]) * phase
    force = forces_n[0] + (forces_n[1] - forces_n[0]) * np.sin(np.pi * phase) ** 2
    x = np.cumsum(np.tile(speed, len(surfaces))) / fs
    return HandPath(
        np.arange(x.size) / fs,
        np.column_stack([x, np.zeros(x.size)]),
        np.tile(force, len(surfaces)),
        tuple(name for name in surfaces for _ in range(n)),
    )
