"""Label tables: CSV files with the surface, the groups and further labels of each recording."""

import codecs
import csv
import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path, PurePosixPath

from texclass.loaders.cards import PATTERN_GROUPS, RESERVED_LABELS, CardError, LabelTable, check_label_name
from texclass.loaders.data_files import normalize_name
from texclass.loaders.readers import formats
from texclass.recording import RecordingError
from texclass.reporting.wording import counted

HEADERS: dict[str, tuple[str, ...]] = {
    "recording": ("file", "recording", "filename", "file name", "name", "path", "id"),
    "surface": ("surface", "material", "label", "class", "texture"),
    "operator": ("operator", "subject", "participant", "user"),
    "session": ("session",),
    "repetition": ("repetition",),
}
"""Conventional column names of each group, used if no card defines the columns; case is ignored."""


def find_label_columns(path: Path, file: str) -> LabelTable:
    """Find the columns of file, surface and groups in a label table by their conventional names.

    All other columns are further labels. Their names are lower case, with underscores for blanks and symbols:
    the column "Speed (mm/s)" is the label "speed_mm_s". Columns named `file` or as in `RESERVED_LABELS` are
    ignored.

    Parameters
    ----------
    path : Path
        Label table (CSV).
    file : str
        Value of `LabelTable.file` in the result.

    Raises
    ------
    CardError
        If the table is unreadable, has no column for the file or the surface, has several columns for one
        group or label, or a column name resembles that of a group.
    """
    header = read_rows(path)[0][1]
    columns = _group_columns(path, header)
    for column in header:
        name = re.sub(r"\W+", "_", normalize_name(column)).strip("_").lower()
        if column in columns.values() or name in ("", "file", *RESERVED_LABELS):
            continue
        if name in columns:
            problem = f"several columns for the label {name!r}: {columns[name]!r}, {column!r}"
            raise CardError(f"{path}: {problem}. Expected different names: rename one of them")
        try:
            check_label_name(name, "a column defines the label")
        except ValueError as error:
            raise CardError(f"{path}: {error}") from error
        columns[name] = column
    return LabelTable(file=file, **columns)


def _group_columns(path: Path, header: Sequence[str]) -> dict[str, str]:
    """Return the column of each group, found by conventional names."""
    group_columns: dict[str, str] = {}
    for group, names in HEADERS.items():
        columns = [column for column in header if column.lower().replace("_", " ") in names]
        if len(columns) > 1 or (not columns and group in {"recording", "surface"}):
            name = "file" if group == "recording" else group
            column_list = ", ".join(map(repr, columns or header))
            problem = f"several columns for the {name}" if columns else f"no column for the {name}"
            raise CardError(
                f"{path}: {problem}: {column_list}. Expected one column `file` and one column `surface`, "
                "optionally `operator`, `session` and `repetition`"
            )
        group_columns |= dict.fromkeys([group] * len(columns), "".join(columns))
    return group_columns


def is_label_table(path: Path) -> bool:
    """Return whether a file is a CSV with a column of files and a column of surfaces."""
    try:
        return path.suffix.lower() == ".csv" and bool(_group_columns(path, read_rows(path)[0][1]))
    except CardError:
        return False


@dataclass(frozen=True)
class Labels:
    """Content of a label table.

    Attributes
    ----------
    path : Path
        File of the table.
    rows : mapping of str to mapping of str to str
        Groups and further labels of each recording, by its name in the table. Values are text exactly as
        written: "001" differs from "1", and "NA" is text.
    lines : mapping of str to int
        Line number of each recording.
    recording_ids : dict of str to str
        Id of the recording for each name in the table that was looked up so far.
    """

    path: Path
    rows: Mapping[str, Mapping[str, str]]
    lines: Mapping[str, int]
    recording_ids: dict[str, str] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path, table: LabelTable) -> "Labels":
        """Read a label table.

        Parameters
        ----------
        path : Path
            CSV file.
        table : LabelTable
            Names of its columns.

        Raises
        ------
        CardError
            If the file is unreadable or lacks a column, a row has a blank label or does not have as many
            cells as the header, or two rows have the same recording.
        """
        (_, header), *rows = read_rows(path)
        if missing := sorted(set(table.columns.values()) - set(header)):
            raise CardError(f"{path}: missing columns {missing}. Expected all columns named in [labels]")
        recordings: dict[str, dict[str, str]] = {}
        lines: dict[str, int] = {}
        for line, cells in rows:
            if len(cells) != len(header):
                raise CardError(
                    f"{path}: row {line} has {counted(len(cells), 'cell')}. Expected {len(header)}, as in "
                    "the header"
                )
            row = dict(zip(header, cells, strict=True))
            groups = {group: row[column] for group, column in table.columns.items()}
            for group in ("recording", "surface"):
                if groups.get(group) == "":
                    raise CardError(
                        f"{path}: row {line} has a blank {table.columns[group]!r}. Expected a name"
                    )
            name = normalize_name(groups.pop("recording").replace("\\", "/"))
            if name in recordings:
                raise CardError(
                    f"{path}: rows {lines[name]} and {line} both describe {name!r}. Expected one row per "
                    "recording"
                )
            recordings[name] = {group: text for group, text in groups.items() if text}
            lines[name] = line
        return cls(path, recordings, lines)

    def groups_of(self, recording_id: str, files: Sequence[str], folder: str) -> Mapping[str, str]:
        """Return the groups and further labels of a recording.

        Rows are matched by the id of the recording, or by the name of a file, with or without path and
        suffix. If each axis has a file and a row, further labels that differ between these rows are omitted.

        Parameters
        ----------
        recording_id : str
            Identifier of the recording.
        files : sequence of str
            Files of the recording, relative to the folder of the dataset.
        folder : str
            Name of the folder of the dataset; paths in the table may start with it.

        Raises
        ------
        RecordingError
            If the table has no row for the recording.
        CardError
            If a name in the table matches several recordings, or several rows match one file.
        """
        ids = [PurePosixPath(recording_id), *map(PurePosixPath, files)]
        paths = [recording_id, *files, *(str(path.with_suffix("")) for path in ids[1:])]
        full_paths = {normalize_name(name) for path in paths for name in (path, f"{folder}/{path}")}
        file_names = {normalize_name(PurePosixPath(path).name) for path in paths}
        matches = (
            full_paths.intersection(self.rows)
            or file_names.intersection(self.rows)
            or {name for stem in full_paths for name in self._names_by_stem.get(stem, ())}
            or {name for stem in file_names for name in self._names_by_stem.get(stem, ())}
        )
        names = sorted(matches, key=self.lines.__getitem__)
        if not names:
            closest_names = difflib.get_close_matches(recording_id, self.rows, n=1, cutoff=0.0)
            closest = f", the closest is {closest_names[0]!r}" if closest_names else ""
            raise RecordingError(
                f"{self.path}: no row for {recording_id!r} ({', '.join(files)}){closest}. Expected one row "
                "per recording: add it, or leave the recording out with --skip-bad"
            )
        rows = [self.rows[name] for name in names]
        groups = [{key: text for key, text in row.items() if key in PATTERN_GROUPS} for row in rows]
        if len(names) > len(files) or any(row != groups[0] for row in groups):
            row_list = ", ".join(f"{name!r} (row {self.lines[name]})" for name in names)
            raise CardError(
                f"{self.path}: {row_list} all match {recording_id!r} ({', '.join(files)}). Expected one row "
                "per recording"
            )
        for name in names:
            if (other := self.recording_ids.setdefault(name, recording_id)) != recording_id:
                raise CardError(
                    f"{self.path}: {name!r} matches both {other!r} and {recording_id!r}. "
                    "Expected a path within the folder of the dataset instead of a file name"
                )
        shared = {key: text for key, text in rows[0].items() if all(row.get(key) == text for row in rows)}
        return groups[0] | shared

    @cached_property
    def _names_by_stem(self) -> dict[str, list[str]]:
        """Names in the table that have the suffix of a recording file, grouped by the name without suffix."""
        stems: dict[str, list[str]] = {}
        for name in self.rows:
            path = PurePosixPath(name)
            if path.suffix.lower() in formats():
                stems.setdefault(str(path.with_suffix("")), []).append(name)
        return stems


def read_rows(path: Path, kind: str = "label table") -> list[tuple[int, list[str]]]:
    """Return line number and cells of all rows of a CSV that are not blank; the first row is the header.

    Parameters
    ----------
    path : Path
        CSV file, with commas, semicolons or tabs.
    kind : str
        Content of the file, for messages (default "label table").

    Raises
    ------
    CardError
        If the file is unreadable or has no rows.
    """
    try:
        data = path.read_bytes()
        is_wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        text = data.decode("utf-16" if is_wide else "utf-8-sig")
        first = next(filter(str.strip, text.splitlines()), "")
        reader = csv.reader(text.splitlines(), delimiter=max(",;\t", key=first.count), strict=True)
        rows = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CardError(f"{path}: the {kind} cannot be read ({error})") from error
    rows = [(line, cells) for line, cells in rows if any(cells)]
    if not rows:
        raise CardError(f"{path}: the {kind} has no rows. Expected a header and the rows below it")
    header = rows[0][1]
    while header and not header[-1]:
        header.pop()
    for _, cells in rows:
        while len(cells) > len(header) and not cells[-1]:
            cells.pop()
    return rows
