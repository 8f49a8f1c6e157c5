"""Open datasets by name, dataset card or folder, and load single recordings by name."""

import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from texclass import shipped
from texclass.loaders import lerobot
from texclass.loaders.cards import (
    AnyCard,
    FileCard,
    FileReading,
    LabelTable,
    LeRobotCard,
    ModelsCard,
    RowCard,
    SimulatedCard,
    read_card,
)
from texclass.loaders.columns import ACCELERATION
from texclass.loaders.data_files import data_files
from texclass.loaders.dataset import Dataset
from texclass.loaders.exports import Export, export_companions, export_pattern, find_exports
from texclass.loaders.files import is_bag_name, load_recording, read_signals
from texclass.loaders.filesets import bag_parts, matching_topics, open_files, open_rows
from texclass.loaders.labels import find_label_columns
from texclass.loaders.phases_files import find_phases_file
from texclass.loaders.places import data_roots, find_folder, is_outside
from texclass.loaders.plausibility import folder_level_notes, resolve_rate, resolve_unit
from texclass.loaders.readers import (
    BAG_METADATA,
    LoadingOptions,
    ReaderSettings,
    as_column_names,
    formats,
    is_bag,
    is_topic_pattern,
    reader_error,
)
from texclass.loaders.source_files import axis_files
from texclass.phase_settings import PhaseSettings
from texclass.recording import Recording, RecordingError
from texclass.reporting.wording import counted
from texclass.validation import validate


def open_dataset(
    name_or_path: str | Path,
    *,
    fs: float | None = None,
    unit: str | None = None,
    resample: float | None = None,
    labels: str | Path | None = None,
    tap_spacing: float | None = None,
    skip_bad: bool = False,
    column: str | Sequence[str] | None = None,
    topic: str | None = None,
    delimiter: str | None = None,
    time_column: str | None = None,
    time_unit: str | None = None,
    skip_rows: int | None = None,
    comment: str | None = None,
    drop_incomplete: bool = False,
) -> Dataset:
    """Open a dataset without reading its recordings; each is read when it is used.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped dataset, path of a dataset card (TOML), a folder with one subfolder per surface, or
        the folder of a LeRobot dataset.
    fs : float, optional
        Sampling rate in Hz of files that do not state it. It must agree with the card, if there is one.
    unit : str, optional
        Unit of the acceleration in files that do not state it. It must agree with the card, if there is one.
    resample : float, optional
        Target sampling rate in Hz of a band-limited resampling of all recordings.
    labels : str or Path, optional
        Table (CSV) with a column `file` and a column `surface` for a folder of any layout, optionally with
        `operator`, `session`, `repetition` and further labels. A dataset card has the table [labels] instead.
        For a LeRobot dataset also "task" or the name of a feature.
    tap_spacing : float, optional
        Time in s. Impulses that are less than this time apart are one tap and its rebounds (default: the
        value of the card, or 0.08).
    skip_bad : bool
        Let `Dataset.attempt` return the error of an invalid recording instead of raising it (default False).
    column, topic, delimiter, time_column, time_unit, skip_rows, comment, drop_incomplete : optional
        How the files of a folder are read, see `load_recording`. A dataset card has keys for these instead.

    Returns
    -------
    dataset : Dataset
        Recordings in a fixed order.

    Raises
    ------
    FileNotFoundError
        If the card or folder does not exist; `DataNotFoundError` if the recordings of a card are missing.
    CardError
        If the card is invalid.
    RecordingError
        If the sampling rate or unit is missing or contradicts the files, or the folder has no recordings.

    Examples
    --------
    >>> dataset = open_dataset("simulated6")
    >>> len(dataset), dataset.surfaces[0]
    (72, 'foam-04')
    """
    path = Path(name_or_path).expanduser()
    changes: dict[str, Any] = {} if tap_spacing is None else {"tap_spacing_s": tap_spacing}
    PhaseSettings(**changes)  # checks the value before any file is read
    settings = ReaderSettings(
        fs=fs,
        unit=unit,
        resample=resample,
        column=column,
        topic=topic,
        delimiter=delimiter,
        time_column=time_column,
        time_unit=time_unit,
        skip_rows=skip_rows,
        comment=comment,
        drop_incomplete=drop_incomplete,
    )
    settings.check(path)
    if str(name_or_path) in shipped.names("datasets") or not path.is_dir():
        card = read_card(name_or_path)
        dataset = _open_card(card, settings, labels, skip_bad=skip_bad)
        return dataset.with_phase_settings(card.phase_settings.changes | changes)
    if lerobot.is_lerobot(path):
        return _open_lerobot(path, settings, labels, skip_bad=skip_bad).with_phase_settings(changes)
    try:
        return _open_folder(path, settings, labels, skip_bad=skip_bad).with_phase_settings(changes)
    except RecordingError as error:
        hint = f"Or draft a dataset card: texclass card {path} -o card.toml"
        raise RecordingError(f"{error}. {hint}") from error


def find_recording(
    name: str | Path,
    *,
    fs: float | None = None,
    unit: str | None = None,
    resample: float | None = None,
    column: str | Sequence[str] | None = None,
    topic: str | None = None,
    delimiter: str | None = None,
    time_column: str | None = None,
    time_unit: str | None = None,
    skip_rows: int | None = None,
    comment: str | None = None,
    drop_incomplete: bool = False,
) -> Recording:
    """Load one recording from a file, a bag or a dataset.

    Parameters
    ----------
    name : str or Path
        Path of a file, "bag:FILE?topic=/name", or "DATASET:RECORDING".
    fs : float, optional
        Sampling rate in Hz of a file that does not state it.
    unit : str, optional
        Unit of the acceleration in a file that does not state it.
    resample : float, optional
        Target sampling rate in Hz.
    column, topic, delimiter, time_column, time_unit, skip_rows, comment, drop_incomplete : optional
        How a file, or the files of a dataset folder, are read; see `load_recording`.

    Returns
    -------
    Recording
        Recording, with the labels of the dataset if it belongs to one.

    Raises
    ------
    RecordingError
        If the dataset has no recording with that id, or `load_recording` rejects the file.
    FileNotFoundError, CardError
        If `open_dataset` cannot open the dataset.

    Examples
    --------
    >>> find_recording("simulated6:wood-03-01")
    <Recording 'wood-03-01' of wood-03: 5 s at 10000 Hz, 3 axes in m/s^2>
    """
    reading: LoadingOptions = {
        "fs": fs,
        "unit": unit,
        "resample": resample,
        "column": column,
        "topic": topic,
        "delimiter": delimiter,
        "time_column": time_column,
        "time_unit": time_unit,
        "skip_rows": skip_rows,
        "comment": comment,
        "drop_incomplete": drop_incomplete,
    }
    dataset_name, colon, recording_id = str(name).rpartition(":")
    is_drive = len(dataset_name) == 1 and recording_id[:1] in {"/", "\\"}  # as in C:\oak\oak_01.txt
    if not colon or is_drive or Path(name).exists() or is_bag_name(name):
        return load_recording(name, **reading)
    if lerobot.is_lerobot(folder := Path(dataset_name).expanduser()):  # the surface is not needed
        settings = ReaderSettings(**reading)
        settings.check(folder)
        dataset = _open_lerobot(folder, settings, None, is_labelled=False)
    else:
        dataset = open_dataset(dataset_name, **reading)
    return dataset.find(recording_id)


def _open_card(
    card: AnyCard, settings: ReaderSettings, labels: str | Path | None, *, skip_bad: bool
) -> Dataset:
    options = {"[channels]": settings.column, "[labels]": labels and str(labels)}
    option_names = {"[channels]": "column", "[labels]": "labels"}
    for key, value in {**settings.card_keys, **options}.items():
        if value is not None:
            raise reader_error(
                card.path,
                f"{option_names.get(key, key)} = {value!r} cannot be combined with a dataset card",
                f"the key {key} in the card",
            )
    if settings.resample is not None and not isinstance(card, FileCard | LeRobotCard):
        problem = f"its recordings cannot be resampled to {settings.resample:g} Hz"
        raise reader_error(card.path, problem, "a card with format = 'files' or 'lerobot'")
    attributes: dict[str, Any] = {"name": card.name, "title": card.title, "licence": card.licence}
    attributes |= {"source": card.source, "notes": card.notes, "skip_bad": skip_bad}
    resolve_rate(card.recipe.fs if isinstance(card, SimulatedCard) else card.fs_hz, settings.fs, card.path)
    resolve_unit(
        card.unit if isinstance(card, FileCard | RowCard | LeRobotCard) else "m/s^2", settings.unit, card.path
    )
    if isinstance(card, SimulatedCard):
        from texclass.loaders.simulated import open_simulated

        return open_simulated(card.recipe, **attributes)
    root = find_folder(card).absolute()
    if is_outside(root, data_roots(card.path)):
        note = f"the folder {card.folder!r} of the card is outside the card's own folder and the data folders"
        attributes["notes"] = (*card.notes, f"{note}: {root}")
    if isinstance(card, ModelsCard):
        module = shipped.module_of("dataset_formats", card.format)
        dataset: Dataset = module.open_models(card, root, **attributes)
        return dataset
    if isinstance(card, RowCard):
        return open_rows(card, root, **attributes)
    if settings.resample is not None:
        card = card.model_copy(update={"resample_hz": settings.resample})
    if isinstance(card, LeRobotCard):
        return lerobot.open_episodes(card, root, **attributes)
    return open_files(card, root, **attributes)


def _open_lerobot(root: Path, settings: ReaderSettings, labels: str | Path | None, **options: Any) -> Dataset:
    """Open a folder in the layout of LeRobot."""
    return lerobot.open_folder(
        root.absolute(),
        settings,
        labels,
        name=root.resolve().name,
        title=f"Episodes in {root}",
        licence="not stated",
        source=str(root),
        **options,
    )


def _open_folder(
    root: Path, settings: ReaderSettings, labels: str | Path | None, *, skip_bad: bool
) -> Dataset:
    # Absolute paths, because worker processes may run in another folder.
    root, root_as_typed = root.absolute(), root
    all_files, files = data_files(root), recording_files(root)
    exports = find_exports(path.relative_to(root).as_posix() for path in all_files)
    topic = settings.topic or ""
    names_surface = is_topic_pattern(topic) and "surface" in re.compile(topic).groupindex
    columns = None
    if not names_surface or labels is not None:
        files, columns = _labelled_files(files, root, labels)
    if not files:
        layout = "one subfolder per surface with files" if labels is None else "files"
        hint = "" if labels else ", or --labels LABELS.csv with columns `file` and `surface`"
        raise RecordingError(
            f"{root_as_typed} contains no recordings. Expected {layout} of {', '.join(formats())}{hint}"
        )
    # The folder of an export or a bag is the recording; its files have the same names in all of them.
    in_folder = {root / export.acceleration for export in exports}
    in_folder |= {path for path in files if path.name == BAG_METADATA}
    path_parts = [(path.parent if path in in_folder else path).relative_to(root).parts for path in files]
    notes = [] if labels else folder_level_notes(parts for parts in path_parts if len(parts) > 1)
    fs, unit, rate_of = settings.fs, settings.unit, ""
    channels = {ACCELERATION: as_column_names(settings.column)} if settings.column else {}
    if fs is None or unit is None:
        file_unit, file_fs, path = _first_unit_and_rate(files, channels, settings, skip_bad=skip_bad)
        if unit is None:
            unit = resolve_unit(file_unit, None, path)
            notes.append(f"unit {unit}, from the messages or column names of {path}")
        if fs is None:
            fs, rate_of = resolve_rate(file_fs, None, path), str(path)
    notes += sorted(
        f"{counted(n, 'sensor app export')}: {summary}"
        for summary, n in Counter(export.summary for export in exports).items()
    )
    ignored = {name for export in exports for name in (export.turn_rate, *export.ignored) if name}
    other_files = {path.relative_to(root).as_posix() for path in all_files if not _is_recording(path)}
    if n_others := len(other_files - ignored):
        notes.append(f"{counted(n_others, 'file')} of other formats ignored")
    marked = [path.name for path in files if path.parent == root]
    keys = {
        "fs_hz": fs,
        "unit": unit,
        "files": _folder_patterns(exports, marked, is_labelled=names_surface or columns is not None),
        "labels": columns and columns.model_dump(),
        "channels": channels,
        "companions": export_companions(exports),
        "resample_hz": settings.resample,
    }
    reading = validate(FileReading, keys | settings.card_keys, root_as_typed)
    reading._rate_of = rate_of
    return open_files(
        reading,
        root,
        ignored=ignored,
        notes=tuple(notes),
        skip_bad=skip_bad,
        name=root.resolve().name,
        title=f"Recordings in {root_as_typed}",
        licence="not stated",
        source=str(root_as_typed),
    )


def _labelled_files(
    files: Sequence[Path], root: Path, labels: str | Path | None
) -> tuple[list[Path], LabelTable | None]:
    """Return the files whose surface is in a table, folder name or phases file, and the table's columns."""
    if labels is None:
        return [path for path in files if path.parent != root or _has_marked_surfaces(path)], None
    table = Path(labels).expanduser().absolute()
    columns = find_label_columns(table, Path(os.path.relpath(table, root)).as_posix())
    return [path for path in files if path != table], columns


def _first_unit_and_rate(
    files: Sequence[Path], channels: dict[str, tuple[str, ...]], settings: ReaderSettings, *, skip_bad: bool
) -> tuple[str | None, float | None, Path]:
    """Return the unit, sampling rate and path of the first file (with `skip_bad`: first readable file)."""
    settings = ReaderSettings(unit=settings.unit, **settings.card_keys)
    for path in files:
        try:
            if (topic := settings.topic) and is_topic_pattern(topic) and is_bag(path):
                topic = next(iter(matching_topics(path, topic)))
            first = read_signals({"": path}, channels, replace(settings, topic=topic))
            break
        except RecordingError:
            if not skip_bad or path == files[-1]:
                raise
    return first.unit, first.fs, path


def _folder_patterns(
    exports: Sequence[Export], marked: Sequence[str], *, is_labelled: bool
) -> tuple[str, ...]:
    """Return the file name patterns of exports, files per axis, files per recording, and bag folders.

    The surfaces of the files `marked`, which are in no subfolder, are marked in their phases files.
    """
    suffixes = rf"\.(?i:{'|'.join(re.escape(suffix[1:]) for suffix in formats())})"
    surface = "" if is_labelled else "(?P<surface>[^/]+)/"
    export_patterns = (export_pattern(exports, is_labelled=is_labelled),) if exports else ()
    names = "|".join(map(re.escape, marked))
    marked_patterns = (rf"(?=(?:{names})$).+_(?P<axis>[XYZxyz])(?:_[^/]*)?{suffixes}", names) if names else ()
    return (
        *export_patterns,
        *(() if is_labelled else marked_patterns),
        rf"{surface}(?:.+/)?[^/]+_(?P<axis>[XYZxyz])(?:_[^/]*)?{suffixes}",
        rf"{surface}.+{suffixes}",
        rf"{surface}.+/{re.escape(BAG_METADATA)}",
    )


def _has_marked_surfaces(path: Path) -> bool:
    marked = find_phases_file(path)
    return marked is not None and bool(marked.surfaces)


def recording_files(folder: Path) -> list[Path]:
    """Return the files of all recordings in a folder and its subfolders: one per recording or axis."""
    all_files = data_files(folder)
    candidates = list(filter(_is_recording, all_files))
    secondary = bag_parts(map(str, candidates))
    for export in find_exports(map(str, all_files)):
        secondary |= {*export.ignored, str(export.turn_rate)}
    return [path for path in candidates if str(path) not in secondary]


def flat_files(folder: Path) -> list[Path]:
    """Return one file for each recording in a folder, or an empty list if recordings are in subfolders."""
    files = recording_files(folder)
    if any(path.parent != folder for path in files):
        return []
    return list({tuple(axis_files(path).values()): path for path in reversed(files)}.values())[::-1]


def _is_recording(path: Path) -> bool:
    return path.suffix.lower() in formats() or is_bag(path)
