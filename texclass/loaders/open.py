"""Open a dataset by the name of its card, by a card's path, or by a folder."""

import difflib
from pathlib import Path
from typing import Any

from texclass import shipped
from texclass.loaders.cards import AnyCard, RowCard, SimulatedCard, read_card
from texclass.loaders.dataset import Dataset
from texclass.loaders.filesets import open_files
from texclass.loaders.folder import open_folder
from texclass.loaders.places import find_folder
from texclass.loaders.rowsets import open_rows
from texclass.loaders.single import agreed_rate, is_bag_name, load_recording
from texclass.recording import Recording, RecordingError


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
        Name of a shipped card, path of a card (.toml), or a folder with one subfolder per material.
    fs : float, optional
        Sampling rate in Hz, for a folder whose files do not state it. What a card says must agree.
    unit : str, optional
        Unit of the acceleration, for a folder. What a card says must agree.
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
        return open_folder(path, fs=fs, unit=unit, skip_bad=skip_bad)
    card = read_card(name_or_path)
    _check_agreement(card, fs, unit)
    about: dict[str, Any] = {"name": card.name, "title": card.title, "licence": card.licence}
    about |= {"source": card.source, "notes": card.notes, "skip_bad": skip_bad}
    if isinstance(card, SimulatedCard):
        from texclass.loaders.simulated import open_simulated

        return open_simulated(card.recipe, **about)
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
        raise RecordingError(
            f"{dataset_name}: no recording is {recording_id!r}; the rule is an id like {near}"
        )
    return dataset[ids.index(recording_id)]


def _check_agreement(card: AnyCard, fs: float | None, unit: str | None) -> None:
    rate, stated = (card.recipe.fs, "m/s^2") if isinstance(card, SimulatedCard) else (card.fs_hz, card.unit)
    agreed_rate(rate, fs, str(card.path))
    if unit not in (None, stated):
        raise RecordingError(f"{card.path}: unit is {stated!r}, {unit!r} was given; the rule is one unit")
