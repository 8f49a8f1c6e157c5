"""Folders that sensor apps export: one file per sensor, together one recording.

Sensor Logger writes `TotalAcceleration.csv` (with gravity), `Accelerometer.csv` (without), `Gyroscope.csv`
and others. phyphox writes `Accelerometer.csv` (with gravity), `Linear Accelerometer.csv` (without),
`Gyroscope.csv`, others and a folder `meta`; of one sensor, it writes `Raw Data.csv` and `meta`.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from texclass.loaders.data_files import data_files
from texclass.reporting.wording import counted

ACCELERATIONS = (
    *("total acceleration", "accelerometer", "acceleration"),
    *("linear accelerometer", "linear acceleration", "raw data"),
)
"""Names of files with an acceleration; the first of them that is there is read."""
TURN_RATE = "gyroscope"
"""Name of the file with the turn rate in rad/s."""
OTHER_SENSORS = (
    *(TURN_RATE, "gravity", "magnetometer", "magnetic field", "compass", "orientation", "rotation vector"),
    *("barometer", "pressure", "light", "proximity", "location", "gps", "pedometer", "microphone"),
    *("heart rate", "battery", "annotation", "metadata", "wrist motion", "device motion", "temperature"),
)
"""Names of files of other sensors, and of what is known of a recording."""


@dataclass(frozen=True)
class Export:
    """The files of one recording, by their relative names.

    Attributes
    ----------
    acceleration : str
        File that is read.
    turn_rate : str or None
        File of the turn rate, if there is one.
    ignored : tuple of str
        The others.
    """

    acceleration: str
    turn_rate: str | None
    ignored: tuple[str, ...]

    @property
    def facts(self) -> str:
        """What is read, for a user."""
        turn_rate = f" with the turn rate of {PurePosixPath(self.turn_rate).name}" if self.turn_rate else ""
        others = counted(len(self.ignored), "other file")
        return f"{PurePosixPath(self.acceleration).name} is read{turn_rate}, {others} ignored"


def sensor_name(name: str) -> str:
    """Return the sensor in the name of a file: "total acceleration" of "TotalAcceleration.csv"; else ""."""
    path = PurePosixPath(name)
    if path.suffix.lower() not in {".csv", ".tsv", ".txt"}:
        return ""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|_+", " ", path.stem).lower()
    stem = re.sub(r" ?\(.*\)$| ?uncalibrated$", "", words).strip()
    return stem if stem in {*ACCELERATIONS, *OTHER_SENSORS} else ""


def other_sensor_name(path: Path) -> str:
    """Return the sensor other than an accelerometer in the name of a file, numbered or not; else ""."""
    if (sensor := sensor_name(path.name)) in OTHER_SENSORS:
        return sensor
    unnumbered = sensor_name(re.sub(r"[ _-]?\d+$", "", path.stem) + path.suffix)
    # other numbered names are surfaces, too: "light_1"
    return unnumbered if unnumbered in {TURN_RATE, "magnetometer", "barometer"} else ""


def find_export(folder: Path) -> Export | None:
    """Return the files of the recording that a folder is, if it is one."""
    names = (path.relative_to(folder).as_posix() for path in data_files(folder)) if folder.is_dir() else ()
    return next((export for export in find_exports(names) if "/" not in export.acceleration), None)


def find_exports(files: Iterable[str]) -> list[Export]:
    """Return the exports among files, one per folder with an acceleration beside other sensors or `meta`.

    Parameters
    ----------
    files : iterable of str
        Relative names.
    """
    folders: dict[PurePosixPath, list[str]] = {}
    for name in files:
        folders.setdefault(PurePosixPath(name).parent, []).append(name)
    found = []
    for folder, names in folders.items():
        sensors = {sensor_name(name): name for name in sorted(names, reverse=True)}
        usable = [sensors[one] for one in ACCELERATIONS if one in sensors]
        described = folders.get(folder / "meta", ())
        is_phyphox = str(folder / "meta" / "device.csv") in described
        if not usable or (len(sensors.keys() - {""}) < 2 and not is_phyphox):
            continue
        turn_rate = sensors.get(TURN_RATE)
        beside = [name for name in names if sensor_name(name) and name not in {usable[0], turn_rate}]
        found.append(Export(usable[0], turn_rate, (*beside, *described)))
    return found


def export_pattern(exports: Sequence[Export], *, labelled: bool = False) -> str:
    """Return the pattern of the files that are read: the folder is the recording, its first part the surface.

    `labelled` is whether a table of labels states the surfaces.
    """
    names = sorted({re.escape(PurePosixPath(export.acceleration).name) for export in exports})
    folder = "(?P<recording>.+)" if labelled else "(?P<recording>(?P<surface>[^/]+)(?:/.+)?)"
    return f"{folder}/(?:{'|'.join(names)})"


def export_companions(exports: Sequence[Export]) -> dict[str, tuple[str, ...]]:
    """Return the names of the files of the turn rate, for a card's `companions`."""
    names = sorted({PurePosixPath(export.turn_rate).name for export in exports if export.turn_rate})
    return {"turn_rate": tuple(f"{{recording}}/{name}" for name in names)} if names else {}
