"""Folders exported by sensor apps, with one folder per recording and one file per sensor.

Sensor Logger writes `TotalAcceleration.csv` (with gravity), `Accelerometer.csv` (without gravity),
`Gyroscope.csv` and others. phyphox writes `Accelerometer.csv` (with gravity), `Linear Accelerometer.csv`
(without gravity), `Gyroscope.csv`, others and a folder `meta`. For a single sensor, phyphox writes
`Raw Data.csv` and `meta`.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from texclass.loaders.data_files import data_files
from texclass.reporting.wording import counted

LINEAR_ACCELERATIONS = ("linear accelerometer", "linear acceleration")
"""Names of files that contain the acceleration without gravity, in any app."""
ACCELERATIONS = (
    *("total acceleration", "accelerometer", "acceleration"),
    *LINEAR_ACCELERATIONS,
    "raw data",
)
"""Names of files with an acceleration, in order of preference."""
TURN_RATE = "gyroscope"
"""Name of the file with the turn rate in rad/s."""
OTHER_SENSORS = (
    *(TURN_RATE, "gravity", "magnetometer", "magnetic field", "compass", "orientation", "rotation vector"),
    *("barometer", "pressure", "light", "proximity", "location", "gps", "pedometer", "microphone"),
    *("heart rate", "battery", "annotation", "metadata", "wrist motion", "device motion", "temperature"),
)
"""Names of files with other sensors or with a description of the recording."""


@dataclass(frozen=True)
class Export:
    """Files of one exported recording, by relative name.

    Attributes
    ----------
    acceleration : str
        File with the acceleration.
    turn_rate : str or None
        File with the turn rate, if there is one.
    ignored : tuple of str
        All other files.
    has_gravity : bool
        Whether the acceleration contains gravity.
    """

    acceleration: str
    turn_rate: str | None
    ignored: tuple[str, ...]
    has_gravity: bool = True

    @property
    def summary(self) -> str:
        """One-line summary of the files that are read and ignored."""
        gravity = "" if self.has_gravity else " (acceleration without gravity)"
        turn_rate = f" with the turn rate of {PurePosixPath(self.turn_rate).name}" if self.turn_rate else ""
        others = counted(len(self.ignored), "other file")
        return f"{PurePosixPath(self.acceleration).name} is read{gravity}{turn_rate}, {others} ignored"


def sensor_name(name: str) -> str:
    """Return the sensor in a file name ("gyroscope" for "Gyroscope.csv"); "" if it contains none."""
    path = PurePosixPath(name)
    if path.suffix.lower() not in {".csv", ".tsv", ".txt"}:
        return ""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|_+", " ", path.stem).lower()
    stem = re.sub(r" ?\(.*\)$| ?uncalibrated$", "", words).strip()
    return stem if stem in {*ACCELERATIONS, *OTHER_SENSORS} else ""


def other_sensor_name(path: Path) -> str:
    """Return the sensor in a file name, with or without number; "" for an accelerometer or no sensor."""
    if (sensor := sensor_name(path.name)) in OTHER_SENSORS:
        return sensor
    unnumbered = sensor_name(re.sub(r"[ _-]?\d+$", "", path.stem) + path.suffix)
    # Numbered names of other sensors, such as "light_1", may also be surfaces.
    return unnumbered if unnumbered in {TURN_RATE, "magnetometer", "barometer"} else ""


def find_export(folder: Path) -> Export | None:
    """Return the export that a folder contains; None if it is not an export."""
    names = (path.relative_to(folder).as_posix() for path in data_files(folder)) if folder.is_dir() else ()
    return next((export for export in find_exports(names) if "/" not in export.acceleration), None)


def find_exports(files: Iterable[str]) -> list[Export]:
    """Find all exports: folders with an acceleration file, and files of other sensors or a `meta` folder.

    Parameters
    ----------
    files : iterable of str
        Relative file names.
    """
    folders: dict[PurePosixPath, list[str]] = {}
    for name in files:
        folders.setdefault(PurePosixPath(name).parent, []).append(name)
    exports = []
    for folder, names in folders.items():
        sensors = {sensor_name(name): name for name in sorted(names, reverse=True)}
        accelerations = [sensor for sensor in ACCELERATIONS if sensor in sensors]
        meta_files = folders.get(folder / "meta", ())
        is_phyphox = str(folder / "meta" / "device.csv") in meta_files
        if not accelerations or (len(sensors.keys() - {""}) < 2 and not is_phyphox):
            continue
        sensor = accelerations[0]
        acceleration, turn_rate = sensors[sensor], sensors.get(TURN_RATE)
        other_files = [name for name in names if sensor_name(name) and name not in {acceleration, turn_rate}]
        # Both apps write `Accelerometer.csv`; only Sensor Logger removes gravity, and it adds `Metadata.csv`.
        is_sensor_logger = "metadata" in sensors and not is_phyphox
        is_linear = sensor in LINEAR_ACCELERATIONS or (sensor == "accelerometer" and is_sensor_logger)
        exports.append(Export(acceleration, turn_rate, (*other_files, *meta_files), not is_linear))
    return exports


def export_pattern(exports: Sequence[Export], *, is_labelled: bool = False) -> str:
    """Return the pattern of the acceleration files of exports for the card key `files`.

    Parameters
    ----------
    exports : sequence of Export
        All exports of a dataset.
    is_labelled : bool
        Whether a label table states the surfaces. Otherwise the surface is the first folder of the path.

    Returns
    -------
    str
        Regular expression in which the folder of the export is the recording.
    """
    names = sorted({re.escape(PurePosixPath(export.acceleration).name) for export in exports})
    folder = "(?P<recording>.+)" if is_labelled else "(?P<recording>(?P<surface>[^/]+)(?:/.+)?)"
    return f"{folder}/(?:{'|'.join(names)})"


def export_companions(exports: Sequence[Export]) -> dict[str, tuple[str, ...]]:
    """Return the names of the turn-rate files for the card key `companions`."""
    names = sorted({PurePosixPath(export.turn_rate).name for export in exports if export.turn_rate})
    return {"turn_rate": tuple(f"{{recording}}/{name}" for name in names)} if names else {}
