"""Draft a dataset card from a folder of recordings; what the folder leaves open becomes a question."""

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

from texclass.loaders.columns import (
    ACCELERATION,
    choose_acceleration,
    is_time,
    match_convention,
    normalize_column,
)
from texclass.loaders.data_files import data_files
from texclass.loaders.exports import Export, export_companions, export_pattern, find_exports
from texclass.loaders.files import AXIS, axis_files, column_names, read_signals
from texclass.loaders.filesets import match_name
from texclass.loaders.labels import Labels, find_label_columns, is_label_table
from texclass.loaders.open import recording_files
from texclass.loaders.plausibility import folder_level_notes
from texclass.loaders.readers import ReaderSettings, ReadSignals, as_column_names, quote_names
from texclass.recording import AUXILIARY_UNITS, RecordingError, Samples
from texclass.reporting.wording import counted

QUESTION = "# QUESTION: "
"""Start of a line about something that the folder leaves open."""


@dataclass(frozen=True)
class _Layout:
    """How names become recordings: the pattern, what it matches (name -> groups), and what is open."""

    pattern: str
    named: Mapping[str, Mapping[str, str]]
    questions: tuple[str, ...] = ()

    @property
    def surfaces(self) -> Counter[str]:
        """Number of files of each surface."""
        return Counter(groups["surface"] for groups in self.named.values())


@dataclass(frozen=True)
class _Signals:
    """What was read of the sampled files: columns, unit, rates, and what is open."""

    channels: Mapping[str, Sequence[str]]
    unit: str
    unit_from: str
    rates: Mapping[str, float | None]
    has_gravity: bool
    questions: tuple[str, ...] = ()


def draft_card(
    folder: str | Path,
    beside: str | Path,
    *,
    fs: float | None = None,
    unit: str | None = None,
    resample: float | None = None,
    labels: str | Path | None = None,
    **reading: Any,
) -> str:
    """Return the text of a dataset card for a folder.

    Parameters
    ----------
    folder : str or Path
        Folder of recordings: one subfolder per surface, or files named by surface and number.
    beside : str or Path
        Folder in which the card will be written.
    fs, unit, resample, **reading : optional
        Facts of the files, as `open_dataset` takes them.
    labels : str or Path, optional
        Table with the surface of each file (default: a CSV in the folder with the columns `file` and
        `surface`, if there is one).

    Raises
    ------
    RecordingError
        If the folder does not exist or contains no file of a known format.
    CardError
        If the given table of labels cannot be used.
    """
    root = Path(folder).expanduser()
    settings = ReaderSettings(fs=fs, unit=unit, resample=resample, **reading)
    settings.check(root)
    if not root.is_dir():
        raise RecordingError(f"{root} is not a folder. Expected a folder of recordings")
    files = recording_files(root)
    table = Path(labels).expanduser() if labels else next(filter(is_label_table, files), None)
    names = [path.relative_to(root).as_posix() for path in files if path != table]
    columns = None
    if table:
        columns = find_label_columns(table, Path(os.path.relpath(table.resolve(), root.resolve())).as_posix())
    if not names:
        raise RecordingError(f"{root} contains no file of a known format. Expected one file per recording")
    exports = find_exports(path.relative_to(root).as_posix() for path in data_files(root))
    if table and columns:
        layout = _labelled(names, Labels.read(table, columns), root, exports)
    else:
        layout = _of_exports(names, exports) if exports else _layout(names)
    signals = _signals(root, layout, settings)
    rates = sorted({rate for rate in signals.rates.values() if rate is not None})
    surfaces = [f"{surface} ({n})" for surface, n in sorted(layout.surfaces.items())]
    left_out = sorted(set(names) - set(layout.named))
    environment = Environment(
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True, undefined=StrictUndefined
    )
    environment.filters |= {"toml": _toml, "printable": _printable}
    template = environment.from_string(Path(__file__).with_suffix(".toml.j2").read_text("utf-8"))
    return template.render(
        folder=_folder_in_card(root.resolve(), Path(beside).resolve()),
        n_surfaces=counted(len(surfaces), "surface"),
        surfaces=f"{', '.join(surfaces[:20])}{' ...' if len(surfaces) > 20 else ''}",
        groups={
            group: len({groups[group] for groups in layout.named.values() if group in groups})
            for group in ("session", "repetition")
        },
        layout=layout,
        n_left_out=counted(len(left_out), "file") if left_out else "",
        left_out=left_out[0] if left_out else "",
        settings=settings,
        rates=rates,
        several_rates=", ".join(f"{rate:g}" for rate in rates),
        signals=signals,
        labels=columns,
        companions=export_companions(exports),
        export_facts=exports[0].facts if exports else "",
    )


def _folder_in_card(root: Path, beside: Path) -> str:
    """Return the folder as a card beside it states it; "" for the folder of the card."""
    if root == beside:
        return ""
    return (root.relative_to(beside) if root.is_relative_to(beside) else root).as_posix()


def _labelled(names: Sequence[str], labels: Labels, root: Path, exports: Sequence[Export]) -> _Layout:
    """Return how names become recordings if a table states their surfaces."""
    pattern = rf"(?:.+/)?[^/]+?{_axis(names)}\.(?i:{_suffixes(names)})"
    pattern = export_pattern(exports, labelled=True) if exports else pattern
    named: dict[str, Mapping[str, str]] = {}
    problems = []
    for name in names:
        if found := match_name((pattern,), name):
            try:
                stem = PurePosixPath(found[1]).with_suffix("").as_posix()
                named[name] = labels.of(found[0].get("recording", stem), [name], root.name)
            except RecordingError as error:
                problems.append(str(error))
    questions = (f"{counted(len(problems), 'file')} without a label: {problems[0]}",) if problems else ()
    return _Layout(pattern, named, questions)


def _of_exports(names: Sequence[str], exports: Sequence[Export]) -> _Layout:
    """Return how names become recordings if folders are exports of sensor apps."""
    pattern = export_pattern(exports)
    named = {name: found[0] for name in names if (found := match_name((pattern,), name))}
    return _Layout(pattern, named)


def _axis(names: Sequence[str]) -> str:
    """Return the pattern of an axis if most names have one."""
    has_axes = sum(AXIS.search(name) is not None for name in names) > len(names) / 2
    return r"_(?P<axis>[XYZxyz])(?:_[^/]*)?" if has_axes else ""


def _suffixes(names: Sequence[str]) -> str:
    return "|".join(sorted({PurePosixPath(name).suffix[1:].lower() for name in names}))


def _layout(names: Sequence[str]) -> _Layout:
    """Return how names become recordings: by subfolders if there are any, else by the names of the files."""
    session = r"(?P<session>(?i:s|sess|session)[_-]?\d+)[_\- ]+"
    repetition = r"[A-Za-z]*(?P<repetition>\d+)"
    below = [name for name in names if "/" in name]
    questions: list[str] = []
    # names without axis and suffix, the most specific pattern first; the last one fits all
    if below:
        heads, names = _folders(below), below
        stems = [rf"(?:[^/]*[_\- ])?{session}{repetition}", r"[^/]*?(?P<repetition>\d+)", r"[^/]+?"]
        candidates = [(head, stem) for head in heads for stem in stems]
    else:
        surface = r"(?P<surface>[^/]+?)"
        stems = [rf"{surface}[_\- ]+{session}{repetition}", rf"{surface}[_\- ]+{repetition}"]
        stems += [r"(?P<surface>[^/]*[^\d/_\- ])(?P<repetition>\d+)", surface]
        candidates = [("", stem) for stem in stems]
    kinds, axis = _suffixes(names), _axis(names)
    for head, stem in candidates:
        pattern = rf"{head}{stem}{axis}\.(?i:{kinds})"
        matched = {name: found[0] for name in names if (found := match_name((pattern,), name))}
        layout = _Layout(pattern, matched)
        if len(matched) > len(names) / 2 and (len(layout.surfaces) > 1 or below):
            break
    if len(layout.surfaces) < 2:
        questions.append("only one surface was found. Which part of a file's path names the surface?")
    elif min(layout.surfaces.values()) < 2:
        questions.append(
            "some surfaces have only one recording. Is it `surface` that names the surface in `files`?"
        )
    return _Layout(layout.pattern, layout.named, tuple(questions))


def _folders(names: Sequence[str]) -> list[str]:
    """Return patterns of the folders of files, the more specific first: a surface, and sessions if any."""
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
    """Read files of all surfaces: columns and unit of the first one, rates of all."""
    firsts: dict[str, str] = {}
    for name, groups in layout.named.items():
        firsts.setdefault(groups["surface"], name)
    files = list(dict.fromkeys([*firsts.values(), *layout.named]))[:100]  # enough to know them all
    unit, column = settings.unit, as_column_names(settings.column)
    settings = ReaderSettings(unit=unit, **settings.of_a_card)
    channels: dict[str, Sequence[str]] = {}
    questions: list[str] = []
    rates: dict[str, float | None] = {}
    read: ReadSignals | None = None
    errors: list[RecordingError] = []
    for name in files:
        try:
            if read is None:
                channels, questions = _channels(root / name, settings, column)
            signals = read_signals(axis_files(root / name), channels, settings)
        except RecordingError as error:
            errors.append(error)
            continue
        rates[name] = signals.fs
        read = read or signals
    if errors:
        questions.append(f"{len(errors)} of {counted(len(files), 'file')} cannot be read: {errors[0]}")
    if read is None:
        return _Signals(channels, unit or "arbitrary", "", rates, False, tuple(questions))
    acceleration = read.named[ACCELERATION]
    gravity = _gravity_at_rest(acceleration)
    if unit or read.unit:
        source = "given" if unit else "from the names of the columns or the messages"
        unit = unit or read.unit
    elif gravity:
        unit, level = gravity
        source = f"the level at rest, {level:.4g}, is gravity in {unit}"
    elif np.abs(acceleration).max() > 100 and np.all(acceleration == np.rint(acceleration)):
        unit, source = "counts", "all values are whole numbers"
    else:
        source = ""
        questions.append("what is the unit of the acceleration: m/s^2, g, mg, counts, V or arbitrary?")
    return _Signals(channels, unit or "arbitrary", source, rates, gravity is not None, tuple(questions))


def _gravity_at_rest(acceleration: Samples) -> tuple[str, float] | None:
    """Return the unit in which the median of three axes has the magnitude of gravity, and that magnitude."""
    if acceleration.shape[1:] != (3,):
        return None
    level = float(np.linalg.norm(np.median(acceleration, axis=0)))
    gravities = {"m/s^2": 9.81, "g": 1.0, "mg": 1000.0}
    return next(((u, level) for u, size in gravities.items() if abs(level / size - 1) < 0.06), None)


def _channels(
    path: Path, settings: ReaderSettings, column: tuple[str, ...]
) -> tuple[dict[str, Sequence[str]], list[str]]:
    """Return the columns of each signal of a file, and what is open; none for a file of one column."""
    present = column_names(path, settings)
    others = [name for name in present if not is_time(name)]
    if len(others) < 2:
        return ({ACCELERATION: column} if column else {}), []
    channels: dict[str, Sequence[str]] = {}
    for field in AUXILIARY_UNITS:
        if (found := [name for name in others if normalize_column(name) == normalize_column(field)]) and len(
            found
        ) == 1:
            channels[field] = found
    for stem in ("w", "g", "gyro ", "gyroscope "):
        if axes := match_convention([f"{stem}{axis}" for axis in "xyz"], others):
            channels.setdefault("turn_rate", axes)
    taken = {name for names in channels.values() for name in names}
    questions = list[str]()
    acceleration: Sequence[str]
    try:
        acceleration = column or choose_acceleration([name for name in others if name not in taken], path)
    except RecordingError:
        acceleration = [name for name in others if name not in taken][:3]
        questions = [
            f"which columns are the acceleration? {quote_names(acceleration)} is a guess; "
            f"the columns are {quote_names(present)}. "
            "If each row is a recording, see `format = 'rows'`."
        ]
    return {ACCELERATION: acceleration, **channels}, questions


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)


def _toml(value: Any) -> str:
    if isinstance(value, int):
        return json.dumps(value)
    text = str(value)
    return f"'{text}'" if "'" not in text and text.isprintable() else json.dumps(text)
