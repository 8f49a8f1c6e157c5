"""Open a dataset by the name of its card, by a card's path, or by a folder; find one recording by name."""

import difflib
import re
from pathlib import Path
from typing import Any

from texclass import shipped
from texclass.loaders.cards import FileReading, RowCard, SimulatedCard, read_card
from texclass.loaders.columns import BAG_FOLDER, ReadOptions, refused
from texclass.loaders.dataset import Dataset
from texclass.loaders.files import (
    READERS,
    agreed_rate,
    agreed_unit,
    axis_files,
    checked_unit,
    is_bag,
    is_bag_name,
    load_recording,
    stated_rate,
)
from texclass.loaders.filesets import not_recordings, open_files, open_rows
from texclass.loaders.places import find_folder
from texclass.recording import Recording, RecordingError

_SUFFIXES = "|".join(re.escape(suffix[1:]) for suffix in READERS)
PATTERNS = (
    rf"(?P<material>[^/]+)/(?:.+/)?[^/]+_(?P<axis>[XYZxyz])(?:_[^/]*)?\.(?i:{_SUFFIXES})",
    rf"(?P<material>[^/]+)/.+\.(?i:{_SUFFIXES})",
    rf"(?P<material>[^/]+)/.+/{re.escape(BAG_FOLDER)}",
)
"""How the files of a folder without a card are named; first, one file per axis; last, a folder of rosbag2."""


def open_dataset(
    name_or_path: str | Path,
    *,
    fs: float | None = None,
    unit: str | None = None,
    skip_bad: bool = False,
) -> Dataset:
    """Return a lazy dataset; no recording is read before it is asked for.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped card, path of a card (.toml), or a folder with one subfolder per material. There,
        every file with a known suffix is a recording, or one of its axes.
    fs : float, optional
        Sampling rate in Hz, for a folder whose files do not state it; all recordings share it. What a card
        says must agree.
    unit : str, optional
        Unit of the acceleration, for a folder; not needed for bags whose messages state it. What a card says
        must agree.
    skip_bad : bool
        Let `Dataset.attempt` return the error of a bad recording instead of raising it.

    Returns
    -------
    dataset : Dataset
        Entries in a fixed order.

    Raises
    ------
    FileNotFoundError
        If there is no such card or folder, or (`DataNotFoundError`) the card's recordings are not here.
    CardError
        If the card breaks a rule.
    RecordingError
        If a fact is missing or contradicted, or the folder holds no recording.
    """
    path = Path(name_or_path).expanduser()
    if str(name_or_path) not in shipped.names("datasets") and path.is_dir():
        return _open_folder(path, fs, unit, skip_bad=skip_bad)
    card = read_card(name_or_path)
    about: dict[str, Any] = {"name": card.name, "title": card.title, "licence": card.licence}
    about |= {"source": card.source, "notes": card.notes, "skip_bad": skip_bad}
    if isinstance(card, SimulatedCard):
        from texclass.loaders.simulated import open_simulated

        _check_agreement(card.path, card.recipe.fs, "m/s^2", fs, unit)
        return open_simulated(card.recipe, **about)
    _check_agreement(card.path, card.fs_hz, card.unit, fs, unit)
    root = find_folder(card.folder, card_path=card.path, source=card.source).absolute()
    if isinstance(card, RowCard):
        return open_rows(card, root, **about)
    return open_files(card, root, **about)


def find_recording(name: str | Path, *, fs: float | None = None, unit: str | None = None) -> Recording:
    """Return one recording: a file, "bag:FILE?topic=/name", or "DATASET:RECORDING" for one of a dataset.

    Raises
    ------
    RecordingError
        If the dataset holds no recording of that id, or as `load_recording`.
    FileNotFoundError, CardError
        As `open_dataset`.
    """
    dataset_name, colon, recording_id = str(name).rpartition(":")
    if not colon or Path(name).exists() or is_bag_name(name):
        return load_recording(name, fs=fs, unit=unit)
    dataset = open_dataset(dataset_name, fs=fs, unit=unit)
    ids = [entry.recording_id for entry in dataset.entries]
    if recording_id not in ids:
        near = ", ".join(difflib.get_close_matches(recording_id, ids, n=3) or ids[:3])
        raise refused(dataset_name, f"no recording is {recording_id!r}", f"an id like {near}")
    return dataset[ids.index(recording_id)]


def _open_folder(root: Path, fs: float | None, unit: str | None, *, skip_bad: bool) -> Dataset:

    found = [path for path in sorted(root.rglob("*")) if path.is_file()]
    recordings = [path for path in found if path.parent != root and _is_recording(path)]
    within = not_recordings(map(str, recordings))
    files = [path for path in recordings if str(path) not in within]
    unit = checked_unit(root, fs, agreed_unit(files[0], ReadOptions(), unit) if files else unit)
    if not files:
        raise RecordingError(
            f"{root}: holds no recording; the rule is one subfolder per material with files of "
            f"{', '.join(READERS)}"
        )
    if fs is None:
        first = next(iter(axis_files(files[0]).values()))
        fs = agreed_rate(stated_rate(first, ReadOptions(codes=unit == "counts")), None, str(root))
    n_others = sum(not (path.name.startswith(".") or _is_recording(path)) for path in found)
    return open_files(
        FileReading(fs_hz=fs, unit=unit, files=PATTERNS),
        # A process that works elsewhere, such as one kept from an earlier call, finds the files too.
        root.absolute(),
        notes=(f"{n_others} files of other kinds are ignored",) if n_others else (),
        skip_bad=skip_bad,
        name=root.resolve().name,
        title=f"Recordings in {root}",
        licence="not stated",
        source=str(root),
    )


def _is_recording(path: Path) -> bool:
    return path.suffix.lower() in READERS or is_bag(path)


def _check_agreement(
    where: Path, stated_fs: float, stated_unit: str, fs: float | None, unit: str | None
) -> None:
    agreed_rate(stated_fs, fs, str(where))
    if unit not in (None, stated_unit):
        raise refused(where, f"unit is {stated_unit!r}, {unit!r} was given", "one unit")
