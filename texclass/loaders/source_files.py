"""Files of one recording: one file, one file per axis, or the folder of a bag or of a sensor app."""

import re
from collections.abc import Mapping
from pathlib import Path

from texclass.loaders.exports import find_export, sensor_name
from texclass.loaders.readers import BAG_METADATA

AXIS = re.compile(r"_(?P<axis>[XYZxyz])(?=[_.])")
"""Part of a file name that states the axis: `<name>_X.txt`, `<name>_X_train1.txt`."""


def source_files(path: Path) -> tuple[dict[str, Path], dict[str, Path], tuple[str, ...]]:
    """Return the files of one recording.

    Parameters
    ----------
    path : Path
        File, or folder exported by a sensor app.

    Returns
    -------
    axes : dict of str to Path
        Files by axis; the axis is "" if one file contains all.
    companions : dict of str to Path
        Files of other signals, by field of `Recording`.
    flags : tuple of str
        Notes for the user.
    """
    if (export := find_export(path)) is None:
        return axis_files(path), {}, ()
    companions = {"turn_rate": path / export.turn_rate} if export.turn_rate else {}
    return {"": path / export.acceleration}, companions, (f"export: {export.summary}",)


def recording_name(path: Path, axes: Mapping[str, Path]) -> str:
    """Return the name of a recording: the name of its file or folder without suffix and axis."""
    if path.is_dir():
        return path.name
    if len(axes) == 1:
        return (path.parent if path.name == BAG_METADATA else path).stem
    *_, axis = AXIS.finditer(path.name)
    return (path.name[: axis.start()] + path.name[axis.end() :]).rpartition(".")[0]


def axis_files(path: Path) -> dict[str, Path]:
    """Return the files of all axes, given the file of one axis; a file without axis has the key ""."""
    matches = list(AXIS.finditer(path.name))
    if not matches:
        return {"": path}
    first, last = matches[-1].span("axis")
    letters = "XYZ" if path.name[first].isupper() else "xyz"
    siblings = {
        letter.lower(): path.with_name(path.name[:first] + letter + path.name[last:]) for letter in letters
    }
    return {axis: file for axis, file in siblings.items() if file.is_file()} or {"": path}


def recording_path(path: Path) -> Path:
    """Return the path that represents a recording: the folder of a bag or export, otherwise the file itself.

    Parameters
    ----------
    path : Path
        Any file of the recording, or its folder.
    """
    if path.name == BAG_METADATA or (sensor_name(path.name) and find_export(path.parent)):
        return path.parent
    return path
