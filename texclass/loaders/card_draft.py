"""Draft dataset cards for folders of recordings, with open questions as comments."""

import json
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined

from texclass.loaders import lerobot
from texclass.loaders.columns import (
    ACCELERATION,
    choose_acceleration,
    is_time,
    match_convention,
    normalize_column,
)
from texclass.loaders.data_files import data_files
from texclass.loaders.exports import Export, export_companions, export_pattern, find_exports
from texclass.loaders.files import column_names, read_signals
from texclass.loaders.filesets import match_name
from texclass.loaders.labels import Labels, find_label_columns, is_label_table
from texclass.loaders.open import recording_files
from texclass.loaders.plausibility import folder_level_notes
from texclass.loaders.readers import (
    BAG_METADATA,
    ReaderSettings,
    ReadSignals,
    as_column_names,
    formats,
    quote_names,
)
from texclass.loaders.source_files import AXIS, axis_files
from texclass.recording import AUXILIARY_UNITS, RecordingError, Samples
from texclass.reporting.wording import counted

QUESTION = "# QUESTION: "
"""Start of a comment line with a question that the files do not answer."""


@dataclass(frozen=True)
class _Layout:
    """Pattern of the file names, groups (such as the surface) of each matching file, and open questions."""

    pattern: str
    groups: Mapping[str, Mapping[str, str]]
    questions: tuple[str, ...] = ()

    @property
    def surfaces(self) -> Counter[str]:
        """Number of files of each surface."""
        return Counter(groups["surface"] for groups in self.groups.values())


@dataclass(frozen=True)
class _Signals:
    """Columns, unit and sampling rates of the inspected files, and open questions."""

    channels: Mapping[str, Sequence[str]]
    unit: str
    unit_source: str
    rates: Mapping[str, float | None]
    has_gravity: bool
    questions: tuple[str, ...] = ()


def draft_card(
    folder: str | Path,
    card_folder: str | Path,
    *,
    fs: float | None = None,
    unit: str | None = None,
    resample: float | None = None,
    labels: str | Path | None = None,
    column: str | Sequence[str] | None = None,
    topic: str | None = None,
    delimiter: str | None = None,
    time_column: str | None = None,
    time_unit: str | None = None,
    skip_rows: int | None = None,
    comment: str | None = None,
    drop_incomplete: bool = False,
) -> str:
    """Draft a dataset card for a folder.

    Parameters
    ----------
    folder : str or Path
        Folder of recordings: one subfolder per surface, or files named by surface and number.
    card_folder : str or Path
        Folder in which the card will be written.
    fs, unit, resample : optional
        See `open_dataset`.
    labels : str or Path, optional
        Table with the surface of each file (default: a CSV in the folder with the columns `file` and
        `surface`, if there is one).
    column, topic, delimiter, time_column, time_unit, skip_rows, comment, drop_incomplete : optional
        How the files are read, see `load_recording`.

    Returns
    -------
    str
        Content of the card (TOML). Lines that start with `# QUESTION:` are open questions.

    Raises
    ------
    RecordingError
        If the folder does not exist or contains no file of a known format.
    CardError
        If the label table is invalid.

    Examples
    --------
    >>> from texclass.loaders import write_sample
    >>> files = write_sample("recordings")
    >>> print(draft_card("recordings", ".", fs=10_000, unit="m/s^2").splitlines()[3])
    # 4 surfaces, with number of files: foam (6), mesh (6), oak (6), slate (6)
    """
    root = Path(folder).expanduser()
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
    settings.check(root)
    if not root.is_dir():
        raise RecordingError(f"{root} is not a folder. Expected a folder of recordings")
    if lerobot.is_lerobot(root):
        raise RecordingError(
            f"{root} is a LeRobot dataset, which needs no card. Expected its folder as the dataset, with "
            "--labels; or write a card with format = 'lerobot'"
        )
    files = recording_files(root)
    table = Path(labels).expanduser() if labels else next(filter(is_label_table, files), None)
    names = [path.relative_to(root).as_posix() for path in files if path != table]
    columns = None
    if table:
        columns = find_label_columns(table, Path(os.path.relpath(table.resolve(), root.resolve())).as_posix())
    if not names:
        raise RecordingError(
            f"{root} contains no file of a known format. Expected one file per recording, with one of the "
            f"suffixes {', '.join(formats())}"
        )
    exports = find_exports(path.relative_to(root).as_posix() for path in data_files(root))
    if table and columns:
        layout = _label_layout(names, Labels.read(table, columns), root, exports)
    else:
        layout = _export_layout(names, exports) if exports else _name_layout(names)
    signals = _signals(root, layout, settings)
    rates = sorted({rate for rate in signals.rates.values() if rate is not None})
    surfaces = [f"{surface} ({n})" for surface, n in sorted(layout.surfaces.items())]
    unmatched = sorted(set(names) - set(layout.groups))
    environment = Environment(
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True, undefined=StrictUndefined
    )
    environment.filters |= {"toml": _toml, "printable": _printable}
    template = environment.from_string(Path(__file__).with_suffix(".toml.j2").read_text("utf-8"))
    return template.render(
        folder=_folder_key(root.resolve(), Path(card_folder).resolve()),
        n_surfaces=counted(len(surfaces), "surface"),
        surfaces=f"{', '.join(surfaces[:20])}{' ...' if len(surfaces) > 20 else ''}",
        groups={
            group: len({groups[group] for groups in layout.groups.values() if group in groups})
            for group in ("session", "repetition")
        },
        layout=layout,
        n_unmatched=counted(len(unmatched), "file") if unmatched else "",
        first_unmatched=unmatched[0] if unmatched else "",
        settings=settings,
        rates=rates,
        rate_list=", ".join(f"{rate:g}" for rate in rates),
        signals=signals,
        labels=columns,
        companions=export_companions(exports),
        export_summary=exports[0].summary if exports else "",
    )


def _folder_key(root: Path, card_folder: Path) -> str:
    """Return the value of the card key `folder`; "" for the folder of the card itself."""
    if root == card_folder:
        return ""
    return (root.relative_to(card_folder) if root.is_relative_to(card_folder) else root).as_posix()


def _label_layout(names: Sequence[str], labels: Labels, root: Path, exports: Sequence[Export]) -> _Layout:
    """Return the layout of files whose surfaces are listed in a label table."""
    pattern = rf"(?:.+/)?[^/]+?{_axis(names)}\.(?i:{_suffixes(names)})"
    pattern = export_pattern(exports, is_labelled=True) if exports else pattern
    file_groups: dict[str, Mapping[str, str]] = {}
    errors = []
    for name in names:
        if match := match_name((pattern,), name):
            groups, name_without_axis = match
            try:
                stem = PurePosixPath(name_without_axis).with_suffix("").as_posix()
                file_groups[name] = labels.groups_of(groups.get("recording", stem), [name], root.name)
            except RecordingError as error:
                errors.append(str(error))
    questions = (f"{counted(len(errors), 'file')} without a label: {errors[0]}",) if errors else ()
    return _Layout(pattern, file_groups, questions)


def _export_layout(names: Sequence[str], exports: Sequence[Export]) -> _Layout:
    """Return the layout of folders exported by sensor apps."""
    pattern = export_pattern(exports)
    return _Layout(pattern, _match_names(pattern, names))


def _match_names(pattern: str, names: Sequence[str]) -> dict[str, Mapping[str, str]]:
    """Return the groups of each name that matches a pattern."""
    matches = {name: match_name((pattern,), name) for name in names}
    return {name: match[0] for name, match in matches.items() if match}


def _axis(names: Sequence[str]) -> str:
    """Return the pattern of the axis in file names; "" if at most half of the names have one."""
    has_axes = sum(AXIS.search(name) is not None for name in names) > len(names) / 2
    return r"_(?P<axis>[XYZxyz])(?:_[^/]*)?" if has_axes else ""


def _suffixes(names: Sequence[str]) -> str:
    return "|".join(sorted({PurePosixPath(name).suffix[1:].lower() for name in names}))


def _name_layout(names: Sequence[str]) -> _Layout:
    """Return the layout given by subfolders if there are any, otherwise by the file names."""
    session = r"(?P<session>(?i:s|sess|session)[_-]?\d+)[_\- ]+"
    repetition = r"[A-Za-z]*(?P<repetition>\d+)"
    # A folder of rosbag2 is one recording, like a file.
    is_bags = all(PurePosixPath(name).name == BAG_METADATA for name in names)
    name_of = {name: name.removesuffix(f"/{BAG_METADATA}") if is_bags else name for name in names}
    names_in_subfolders = [name for name in names if "/" in name_of[name]]
    questions: list[str] = []
    # Patterns of names without axis and suffix, from the most specific one to one that matches all names.
    if names_in_subfolders:
        names = names_in_subfolders
        heads = _folder_patterns([name_of[name] for name in names])
        stems = [rf"(?:[^/]*[_\- ])?{session}{repetition}", r"[^/]*?(?P<repetition>\d+)", r"[^/]+?"]
        candidates = [(head, stem) for head in heads for stem in stems]
    else:
        surface = r"(?P<surface>[^/]+?)"
        stems = [rf"{surface}[_\- ]+{session}{repetition}", rf"{surface}[_\- ]+{repetition}"]
        stems += [r"(?P<surface>[^/]*[^\d/_\- ])(?P<repetition>\d+)", surface]
        candidates = [("", stem) for stem in stems]
    ending = f"/{re.escape(BAG_METADATA)}" if is_bags else rf"{_axis(names)}\.(?i:{_suffixes(names)})"
    for head, stem in candidates:
        pattern = f"{head}{stem}{ending}"
        layout = _Layout(pattern, _match_names(pattern, names))
        if len(layout.groups) > len(names) / 2 and (len(layout.surfaces) > 1 or names_in_subfolders):
            break
    if len(layout.surfaces) < 2:
        questions.append("there is only one surface. Which part of the file paths is the surface?")
    elif min(layout.surfaces.values()) < 2:
        questions.append(
            "some surfaces have only one recording. Does the group `surface` in `files` match the surface "
            "and nothing else?"
        )
    return _Layout(layout.pattern, layout.groups, tuple(questions))


def _folder_patterns(names: Sequence[str]) -> list[str]:
    """Return patterns of the folders that name the surface and session, the most specific pattern first."""
    parts = [PurePosixPath(name).parts for name in names]
    shared = ""
    while len({part[0] for part in parts}) == 1 and min(map(len, parts)) > 2:
        shared += f"{re.escape(parts[0][0])}/"
        parts = [part[1:] for part in parts]
    if folder_level_notes(parts):
        return [rf"{shared}(?P<session>[^/]+)/(?P<surface>[^/]+)/(?:.+/)?"]
    deeper = Counter(part[:2] for part in parts if len(part) > 2)
    has_sessions = deeper.total() == len(parts) and min(deeper.values()) > 1
    sessions = [rf"{shared}(?P<surface>[^/]+)/(?P<session>[^/]+)/(?:.+/)?"] * has_sessions
    return [*sessions, rf"{shared}(?P<surface>[^/]+)/(?:.+/)?"]


def _signals(root: Path, layout: _Layout, settings: ReaderSettings) -> _Signals:
    """Read up to 100 files. Return the columns and unit of the first file, and the rates of all files.

    One file of each surface is read before a second file of any surface.
    """
    first_files: dict[str, str] = {}
    for name, groups in layout.groups.items():
        first_files.setdefault(groups["surface"], name)
    files = list(dict.fromkeys([*first_files.values(), *layout.groups]))[:100]
    unit, column = settings.unit, as_column_names(settings.column)
    settings = ReaderSettings(unit=unit, **settings.card_keys)
    channels: dict[str, Sequence[str]] = {}
    questions: list[str] = []
    rates: dict[str, float | None] = {}
    first_signals: ReadSignals | None = None
    errors: list[RecordingError] = []
    for name in files:
        try:
            if first_signals is None:
                channels, questions = _channels(root / name, settings, column)
            signals = read_signals(axis_files(root / name), channels, settings)
        except RecordingError as error:
            errors.append(error)
            continue
        rates[name] = signals.fs
        first_signals = first_signals or signals
    if errors:
        questions.append(f"{len(errors)} of {counted(len(files), 'file')} cannot be read: {errors[0]}")
    if first_signals is None:
        return _Signals(channels, unit or "arbitrary", "", rates, False, tuple(questions))
    acceleration = first_signals.signals[ACCELERATION]
    gravity = _gravity_at_rest(acceleration)
    if unit or first_signals.unit:
        source = "given" if unit else "from the column names or the message type"
        unit = unit or first_signals.unit
    elif gravity:
        unit, level = gravity
        source = f"the level at rest is {level:.4g}, which is gravity in {unit}"
    elif np.abs(acceleration).max() > 100 and np.all(acceleration == np.rint(acceleration)):
        unit, source = "counts", "all values are whole numbers"
    else:
        source = ""
        questions.append("what is the unit of the acceleration: m/s^2, g, mg, counts, V or arbitrary?")
    return _Signals(channels, unit or "arbitrary", source, rates, gravity is not None, tuple(questions))


def _gravity_at_rest(acceleration: Samples) -> tuple[str, float] | None:
    """Return the unit in which the median of three axes equals gravity, and the magnitude of the median.

    The result is None for fewer axes, or if the median equals gravity in no unit.
    """
    if acceleration.shape[1:] != (3,):
        return None
    level = float(np.linalg.norm(np.median(acceleration, axis=0)))
    gravities = {"m/s^2": 9.81, "g": 1.0, "mg": 1000.0}
    return next(((unit, level) for unit, g in gravities.items() if abs(level / g - 1) < 0.06), None)


def _channels(
    path: Path, settings: ReaderSettings, column: tuple[str, ...]
) -> tuple[dict[str, Sequence[str]], list[str]]:
    """Return the columns of each signal in a file, and open questions. A single column is omitted."""
    names = column_names(path, settings)
    candidates = [name for name in names if not is_time(name)]
    if len(candidates) < 2:
        return ({ACCELERATION: column} if column else {}), []
    channels: dict[str, Sequence[str]] = {}
    for field in AUXILIARY_UNITS:
        matches = [name for name in candidates if normalize_column(name) == normalize_column(field)]
        if len(matches) == 1:
            channels[field] = matches
    for stem in ("w", "g", "gyro ", "gyroscope "):
        if axes := match_convention([f"{stem}{axis}" for axis in "xyz"], candidates):
            channels.setdefault("turn_rate", axes)
    assigned = {name for columns in channels.values() for name in columns}
    candidates = [name for name in candidates if name not in assigned]
    questions = list[str]()
    acceleration: Sequence[str]
    try:
        acceleration = column or choose_acceleration(candidates, path)
    except RecordingError:
        acceleration = candidates[:3]
        questions = [
            f"which columns are the acceleration? {quote_names(acceleration)} are a guess; the columns are "
            f"{quote_names(names)}. If each row is a recording, set `format = 'rows'`."
        ]
    return {ACCELERATION: acceleration, **channels}, questions


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)


def _toml(value: Any) -> str:
    if isinstance(value, int):
        return json.dumps(value)
    text = str(value)
    return f"'{text}'" if "'" not in text and text.isprintable() else json.dumps(text)
