"""Read a table of labels: the surface of each recording, and who made it, in which session."""

import codecs
import csv
import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path, PurePosixPath

from texclass.loaders.cards import CardError, LabelTable
from texclass.loaders.data_files import normalize_name
from texclass.loaders.readers import formats
from texclass.recording import RecordingError
from texclass.reporting.wording import counted

HEADERS = {
    "recording": ("file", "recording", "filename", "file name", "name", "path", "id"),
    "surface": ("surface", "surface", "label", "class", "texture"),
    "operator": ("operator", "subject", "participant", "user"),
    "session": ("session",),
    "repetition": ("repetition",),
}
"""Names of the columns that are looked for where no card names them; case does not matter."""


def find_label_columns(path: Path, file: str) -> LabelTable:
    """Return which columns of a table are file, surface and groups, by their conventional names.

    Parameters
    ----------
    path : Path
        The table (CSV).
    file : str
        Its name in the result.

    Raises
    ------
    CardError
        If the table is unreadable, or file or surface are in no column or in several.
    """
    header = _rows(path)[0][1]
    found: dict[str, str] = {}
    for group, names in HEADERS.items():
        columns = [column for column in header if column.lower().replace("_", " ") in names]
        if len(columns) > 1 or (not columns and group in {"recording", "surface"}):
            listed = ", ".join(map(repr, columns or header))
            raise CardError(
                f"{path}: columns {listed} for the {'file' if group == 'recording' else group}. "
                "Expected one column `file` and one column `surface`, optionally `operator`, `session` and "
                "`repetition`"
            )
        found |= dict.fromkeys([group] * len(columns), "".join(columns))
    return LabelTable(file=file, **found)


def is_label_table(path: Path) -> bool:
    """Whether a file is a CSV with a column of files and a column of surfaces."""
    try:
        return path.suffix.lower() == ".csv" and bool(find_label_columns(path, path.name))
    except CardError:
        return False


@dataclass(frozen=True)
class Labels:
    """What a table of labels states of recordings.

    Attributes
    ----------
    path : Path
        File of the table.
    rows : mapping of str to mapping of str to str
        Name of the recording -> group -> text, exactly as written: "001" is not "1", "NA" is a text.
    lines : mapping of str to int
        Name of the recording -> number of its line.
    used : dict of str to str
        Names that were looked up -> id of the recording.
    """

    path: Path
    rows: Mapping[str, Mapping[str, str]]
    lines: Mapping[str, int]
    used: dict[str, str] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path, table: LabelTable) -> "Labels":
        """Read a table.

        Raises
        ------
        CardError
            If it is unreadable or lacks a column, or a row has a blank label, other cells than the header or
            the recording of another row.
        """
        (_, header), *rows = _rows(path)
        if absent := sorted(set(table.columns.values()) - set(header)):
            raise CardError(f"{path}: missing columns {absent}. Expected those that [labels] names")
        found: dict[str, dict[str, str]] = {}
        lines: dict[str, int] = {}
        for line, cells in rows:
            if len(cells) != len(header):
                raise CardError(
                    f"{path}: row {line} has {counted(len(cells), 'cell')}. Expected {len(header)}"
                )
            row = dict(zip(header, cells, strict=True))
            groups = {group: row[column] for group, column in table.columns.items()}
            for group in ("recording", "surface"):
                if groups.get(group) == "":
                    raise CardError(
                        f"{path}: row {line} has a blank {table.columns[group]!r}. Expected a name"
                    )
            name = normalize_name(groups.pop("recording").replace("\\", "/"))
            if name in found:
                raise CardError(
                    f"{path}: rows {lines[name]} and {line} are both of {name!r}. Expected one row each"
                )
            found[name] = {group: text for group, text in groups.items() if text}
            lines[name] = line
        return cls(path, found, lines)

    def of(self, recording_id: str, files: Sequence[str], folder: str) -> Mapping[str, str]:
        """Return the groups of a recording, found by its id, or by a file with or without path and suffix.

        Parameters
        ----------
        recording_id : str
            Of the recording.
        files : sequence of str
            Its files, relative to the folder of the dataset.
        folder : str
            Name of that folder, with which paths in the table may begin.

        Raises
        ------
        RecordingError
            If the table does not have the recording.
        CardError
            If a name in the table means several recordings, or several rows mean one file.
        """
        ids = [PurePosixPath(recording_id), *map(PurePosixPath, files)]
        paths = [recording_id, *files, *(str(path.with_suffix("")) for path in ids[1:])]
        whole = {normalize_name(name) for path in paths for name in (path, f"{folder}/{path}")}
        short = {normalize_name(PurePosixPath(path).name) for path in paths}
        found = (
            whole.intersection(self.rows)
            or short.intersection(self.rows)
            or {name for stem in whole for name in self._by_stem.get(stem, ())}
            or {name for stem in short for name in self._by_stem.get(stem, ())}
        )
        names = sorted(found, key=self.lines.__getitem__)
        if not names:
            near = difflib.get_close_matches(recording_id, self.rows, n=1, cutoff=0.0)
            closest = f", the closest is {near[0]!r}" if near else ""
            raise RecordingError(
                f"{self.path}: no row for {recording_id!r} ({', '.join(files)}){closest}. Expected one row "
                "per recording: add it, or --skip-bad leaves the recording out"
            )
        if len(names) > len(files) or any(self.rows[name] != self.rows[names[0]] for name in names):
            listed = ", ".join(f"{name!r} (row {self.lines[name]})" for name in names)
            raise CardError(
                f"{self.path}: {listed} are all of {recording_id!r} ({', '.join(files)}). Expected one row"
            )
        for name in names:
            if (other := self.used.setdefault(name, recording_id)) != recording_id:
                raise CardError(
                    f"{self.path}: {name!r} is both {other!r} and {recording_id!r}. "
                    "Expected the path of the file within the folder"
                )
        return self.rows[names[0]]

    @cached_property
    def _by_stem(self) -> dict[str, list[str]]:
        """Names that end in a suffix of recordings, by what stands before it."""
        stems: dict[str, list[str]] = {}
        for name in self.rows:
            path = PurePosixPath(name)
            if path.suffix.lower() in formats():
                stems.setdefault(str(path.with_suffix("")), []).append(name)
        return stems


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """Return the rows that are not blank, with the number of their line; the header is the first."""
    try:
        data = path.read_bytes()
        is_wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        text = data.decode("utf-16" if is_wide else "utf-8-sig")
        first = next(filter(str.strip, text.splitlines()), "")
        reader = csv.reader(text.splitlines(), delimiter=max(",;\t", key=first.count), strict=True)
        rows = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CardError(f"{path}: the table of labels cannot be read ({error})") from error
    rows = [(line, cells) for line, cells in rows if any(cells)]
    if not rows:
        raise CardError(f"{path}: no rows. Expected a header and one row per recording")
    header = rows[0][1]
    while header and not header[-1]:
        header.pop()
    for _, cells in rows:
        while len(cells) > len(header) and not cells[-1]:
            cells.pop()
    return rows
