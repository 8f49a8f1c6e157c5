"""A folder with one subfolder per material: a dataset without a card."""

import re
from pathlib import Path

from texclass.loaders import formats
from texclass.loaders.bags_of_datasets import not_recordings
from texclass.loaders.cards import FileReading
from texclass.loaders.columns import ReadOptions
from texclass.loaders.dataset import Dataset
from texclass.loaders.filesets import open_files
from texclass.loaders.single import agreed_rate, agreed_unit, axis_files, checked_unit
from texclass.recording import RecordingError

_SUFFIXES = "|".join(re.escape(suffix[1:]) for suffix in (*formats.SUFFIXES, *formats.BAG_SUFFIXES))
PATTERNS = (
    rf"(?P<material>[^/]+)/(?:.+/)?[^/]+_(?P<axis>[XYZxyz])(?:_[^/]*)?\.(?i:{_SUFFIXES})",
    rf"(?P<material>[^/]+)/.+\.(?i:{_SUFFIXES})",
    rf"(?P<material>[^/]+)/.+/{re.escape(formats.BAG_FOLDER)}",
)
"""How the files of such a folder are named; first, one file per axis; last, a folder of rosbag2."""


def open_folder(
    root: Path, *, fs: float | None = None, unit: str | None = None, skip_bad: bool = False
) -> Dataset:
    """Return the dataset of a folder with one subfolder per material.

    Parameters
    ----------
    root : Path
        The folder. Every file below a subfolder with a known suffix is a recording, or one of its axes.
    fs : float, optional
        Sampling rate in Hz; needed unless the files state it. All recordings must share it.
    unit : str, optional
        Of the acceleration; needed unless the files are bags whose messages state it.
    skip_bad : bool
        See `Dataset`.

    Raises
    ------
    RecordingError
        If there is no recording, or `fs` or `unit` is missing.
    """
    candidates = [path for path in sorted(root.glob("*/**/*")) if _is_recording(path)]
    within = not_recordings(map(str, candidates))
    files = [path for path in candidates if str(path) not in within]
    first = files[0] if files else root
    unit = checked_unit(root, fs, agreed_unit(first, ReadOptions(), unit))
    if not files:
        raise RecordingError(
            f"{root}: holds no recording; the rule is one subfolder per material with files of "
            f"{', '.join((*formats.SUFFIXES, *formats.BAG_SUFFIXES))}"
        )
    rate = agreed_rate(_stated_rate(files, unit) if fs is None else None, fs, str(root))
    return open_files(
        FileReading(fs_hz=rate, unit=unit, files=PATTERNS),
        # A process that works elsewhere, such as one kept from an earlier call, finds the files too.
        root.absolute(),
        notes=_ignored(root),
        skip_bad=skip_bad,
        name=root.resolve().name,
        title=f"Recordings in {root}",
        licence="not stated",
        source=str(root),
    )


def _stated_rate(files: list[Path], unit: str) -> float | None:
    """Return the sampling rate that the first file states, if it states one."""
    options = ReadOptions(codes=unit == "counts")
    first = next(iter(axis_files(files[0]).values()))
    return formats.read(first, formats.names(first, options)[:1], options).fs


def _is_recording(path: Path) -> bool:
    return path.suffix.lower() in formats.SUFFIXES or formats.is_bag(path)


def _ignored(root: Path) -> tuple[str, ...]:
    """Say how many files are not recordings, so that nobody misses them unawares."""
    others = [
        path
        for path in root.rglob("*")
        if path.is_file() and not path.name.startswith(".") and not _is_recording(path)
    ]
    return (f"{len(others)} files of other kinds are ignored",) if others else ()
