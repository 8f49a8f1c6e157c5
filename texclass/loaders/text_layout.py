"""Find the layout of a text table: encoding, delimiter, comments, first row, names and units of columns.

Of the first 200 lines, the last three with numbers determine which columns are numeric. A row is a line with
numbers or missing values in all of these columns. The column names are in the last matching line above the
first row; a line of units may be in between.
"""

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

from texclass.loaders.columns import ACCELERATION, ROW_NUMBER, add_unit, parse_unit
from texclass.loaders.dates import is_date
from texclass.loaders.readers import ReaderSettings, reader_error
from texclass.recording import RecordingError
from texclass.reporting.wording import counted

MAX_LINE = 1 << 20
"""Largest number of characters in a line; the names of 10,000 columns need about a tenth of it."""
MAX_COLUMNS = 10_000
"""Largest number of columns."""
MISSING = ("", "na", "n/a", "null", "none", "-")
"""Cells without a value."""
DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d(?::?\d\d){0,2}(?:\.\d+)?(Z|[+-]\d\d:?\d*)?")
"""Date and time in a notation that pandas can parse; the group is the time zone."""


@dataclass(frozen=True)
class TextLayout:
    """Layout of a text table.

    Attributes
    ----------
    names : tuple of str
        Names of the columns, without trailing empty columns.
    delimiter : str
        Column delimiter, one character.
    width : int
        Number of cells per row.
    n_above : int
        Number of lines above the first row.
    first : tuple of str
        Cells of the first row.
    encoding : str
        Name of the encoding in Python.
    comments : tuple of str
        Characters that start comment lines.
    is_plain : bool
        Whether lines end with a line feed only.
    fs : float or None
        Sampling rate in Hz stated in the lines above the rows, if there is one.
    flags : tuple of str
        Assumptions reported to the user.
    """

    names: tuple[str, ...]
    delimiter: str
    width: int
    n_above: int = 0
    first: tuple[str, ...] = ()
    encoding: str = "utf-8-sig"
    comments: tuple[str, ...] = ()
    is_plain: bool = True
    fs: float | None = None
    flags: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Row:
    """Cells of line `n_above` to line `last` (several lines if a quoted cell contains line ends)."""

    n_above: int
    last: int
    cells: tuple[str, ...]
    is_comment: bool

    @property
    def n_filled(self) -> int:
        """Number of cells without trailing empty cells."""
        return max((i for i, cell in enumerate(self.cells, 1) if cell), default=0)

    @property
    def has_number(self) -> bool:
        return any(map(is_number, self.cells))


def open_text(
    data: bytes, encoding: str, *, errors: str = "strict", newline: str | None = None
) -> io.TextIOWrapper:
    """Open bytes as a text file."""
    return io.TextIOWrapper(io.BytesIO(data), encoding, errors, newline)


def find_layout(data: bytes, where: str, settings: ReaderSettings) -> TextLayout:
    """Find the layout of a text table.

    Parameters
    ----------
    data : bytes
        Content of the file.
    where : str
        File (or file and sheet), for messages. If it ends with ".txt", blanks may delimit columns.
    settings : ReaderSettings
        Options of the user.

    Returns
    -------
    TextLayout
        Layout, derived from the first 200 lines.

    Raises
    ------
    RecordingError
        If the data are not text, a line is too long, or there are no rows of numbers.
    """
    n_skipped, is_txt = settings.skip_rows or 0, where.lower().endswith(".txt")
    encoding, lines, is_whole = _head(data, where, n_skipped)
    delimiter, n_above = settings.delimiter, 0
    if lines and (match := re.fullmatch(r'"?sep=(.)"?\s*', lines[0])):
        delimiter, n_above = delimiter or match[1], 1
    labview: dict[str, list[str]] = {}
    if lines and lines[0].startswith("LabVIEW Measurement"):
        ends = [i for i, line in enumerate(lines) if line.startswith("***End_of_Header***")]
        n_above = 1 + max(ends, default=0)
        for words in (line.strip().split("\t") for line in lines[:n_above]):
            labview[words[0]] = words[1:]
        mark = {"Tab": "\t", "Comma": ","}.get("".join(labview.get("Separator", [])))
        delimiter = delimiter or mark or "\t"
    comments: tuple[str, ...] = (settings.comment,) if settings.comment else ("#", "%", "//")
    content = [line for line in lines[n_above:] if line.strip()]
    if not settings.comment and not any(
        any(map(str.isdigit, line)) for line in content if not _starts_with(line, comments)
    ):
        comments = ()  # row names may start like comments: "#1;0.5"
    data_lines = [line.strip() for line in content if not _starts_with(line, comments)]
    delimiter = delimiter or _delimiter(data_lines, is_txt=is_txt)
    rows = list(_rows(lines, n_above, delimiter or ",", comments))
    if widest := max((len(row.cells) for row in rows if len(row.cells) > MAX_COLUMNS), default=0):
        raise reader_error(where, f"its first lines have {widest} columns", f"at most {MAX_COLUMNS}")
    layout = _find_names(rows, where, labview, is_whole=is_whole, is_txt=is_txt)
    flags = ("encoding: the text is not UTF-8, read as Windows-1252",) if encoding == "cp1252" else ()
    return replace(
        layout,
        delimiter=delimiter or ",",
        n_above=n_skipped + layout.n_above,
        encoding=encoding,
        comments=comments,
        is_plain=not any(line.endswith("\r") for line in lines),
        flags=(*flags, *layout.flags),
    )


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with a decimal point or comma, or a date."""
    try:
        float(cell.replace("_", "x").replace(",", "."))
    except ValueError:
        return bool(DATE.fullmatch(cell)) or is_date(cell)
    return True


def split_cells(line: str, delimiter: str) -> list[str]:
    """Split a line into cells without surrounding blanks."""
    if delimiter == " ":
        line = line.replace("\t", " ").strip()
    try:
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=delimiter == " "), [])
    except csv.Error:
        cells = line.split(delimiter)
    return [cell.strip() for cell in cells]


def _head(data: bytes, where: str, n_skipped: int) -> tuple[str, list[str], bool]:
    """Return the encoding, the first lines that are not skipped, and whether the text ends with them."""
    is_wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    for codec in ("utf-16" if is_wide else "utf-8-sig", "cp1252"):
        try:
            lines, is_whole = _first_lines(open_text(data, codec, newline=""), where, n_skipped)
        except UnicodeError as error:
            problem = error
            continue
        if codec == "cp1252" and is_whole and any("\0" in line for line in lines):
            break
        return codec, lines, is_whole
    raise RecordingError(
        f"{where}: not a text file ({problem}). Expected UTF-8, or UTF-16 with a byte order mark"
    ) from problem


def _first_lines(file: io.TextIOWrapper, where: str, n_skipped: int) -> tuple[list[str], bool]:
    """Return up to 200 lines (fewer above 256 Ki characters), and whether the file ends with them."""
    lines, n_characters = list[str](), 0
    for _ in islice(iter(lambda: file.readline(MAX_LINE), ""), n_skipped):
        pass
    while line := file.readline(MAX_LINE):
        if len(line) == MAX_LINE:
            raise reader_error(where, "a line is too long", f"at most {MAX_LINE} characters")
        lines.append(line)
        n_characters += len(line)
        if len(lines) == 200 or (n_characters > 1 << 18 and len(lines) > 6):
            return lines, False
    return lines, True


def _starts_with(line: str, marks: Sequence[str]) -> bool:
    return line.lstrip().startswith(tuple(marks))


def _delimiter(lines: Sequence[str], *, is_txt: bool) -> str:
    """Return the delimiter that occurs in most of the last lines with digits; "" if there is none."""
    last = ([line for line in lines if any(map(str.isdigit, line))] or list(lines))[-5:]
    # Commas may be decimal points and blanks may be part of a text, so they are tried last.
    for mark in "\t;|":
        if 2 * sum(mark in line for line in last) > len(last):
            return mark
    words = [line.split() for line in last]
    aligned = [len(row) > 1 and all(is_number(word) and word[-1] != "," for word in row) for row in words]
    if 2 * sum(aligned) > len(last):
        return " "
    if 2 * sum("," in line for line in last) > len(last):
        return ","
    return " " if is_txt and 2 * sum(len(row) > 1 for row in words) > len(last) else ""


def _rows(lines: Sequence[str], begin: int, delimiter: str, comments: tuple[str, ...]) -> Iterator[_Row]:
    """Yield the non-blank lines as rows; comment characters are removed."""
    last = begin
    while last < len(lines):
        first, last = last, last + 1
        if not (line := lines[first]).strip():
            continue
        if is_comment := _starts_with(line, comments):
            line = re.sub(rf"^\s*(?:{'|'.join(map(re.escape, comments))})+[ ]*", "", line)
        elif line.count('"') % 2:
            for end in range(first + 2, first + 4):  # a quoted name has at most three lines
                if "".join(lines[first:end]).count('"') % 2 == 0:
                    line, last = " ".join(part.rstrip("\r\n") for part in lines[first:end]), end
                    break
        yield _Row(first, last, tuple(split_cells(line.rstrip("\r\n"), delimiter)), is_comment)


def _find_names(
    rows: list[_Row], where: str, labview: dict[str, list[str]], *, is_whole: bool, is_txt: bool
) -> TextLayout:
    """Return a layout with the names and units of the columns and the first row."""
    lines = [row for row in rows if not row.is_comment]
    reference = [row for row in lines if row.has_number][-3:]  # these lines are rows
    if not reference:
        if not is_whole:
            raise reader_error(
                where,
                f"the first {len(rows)} lines contain no numbers",
                "rows of numbers. To skip the lines above them, pass --skip-rows N (`skip_rows` in a card)",
            )
        cells = lines[0].cells if lines else ()
        return TextLayout(_unique(cells), ",", len(cells), lines[0].last if lines else 0)
    times = Counter(len(row.cells) for row in reference)
    width = max(times, key=lambda n: (times[n], n))
    reference = [row for row in reference if len(row.cells) == width]
    numeric = [i for i in range(width) if _is_numeric([row.cells[i] for row in reference])]
    at = next(k for k, row in enumerate(lines) if _fits(row, width, numeric))
    body = [row for row in lines[at:] if len(row.cells) == width]
    above = rows[: rows.index(lines[at])]
    flags = list[str]()
    if _is_counted(body, is_txt=is_txt):
        flags.append(f"names: the line {','.join(body[0].cells)!r:.40} is read as column names, not as a row")
        above, body = [*above, body[0]], body[1:]
    elif body[0].n_above == 0 and body[0].cells == ("0", "1"):
        flags.append("names: the first line '0,1' is read as a row; --skip-rows 1 skips it")
    n_filled = max(row.n_filled for row in body)
    units: Sequence[str] = ()
    if len(above) > 1 and _are_units(above[-1]) and above[-1].n_filled <= above[-2].n_filled:
        units, above = above[-1].cells, above[:-1]
    header = _header(above, body, width, n_filled, is_labview=bool(labview))
    n_ignored = len(above) - (header is not None)
    if n_ignored:
        first = f"starting with {above[0].cells[0]!r:.40}"
        flags.append(f"header: {counted(n_ignored, 'line')} above the rows ignored, {first}")
    names = list(header.cells[: header.n_filled] if header else ())
    fs, rate_text = _stated_rate(above)
    if labview:
        names, units, fs = _labview_columns(names, labview)
    elif header is None and _is_empatica(body):
        fs, rate_text = float(body[1].cells[0]), "start time, then rate, as in Empatica files"
        body = body[2:]
    if fs and not labview:
        flags.append(f"rate: {fs:g} Hz, from the lines above the rows: {rate_text!r:.50}")
    if unit_names := dict.fromkeys(filter(None, map(parse_unit, units))):
        flags.append(f"units: {', '.join(unit_names)}, from the lines above the rows")
    names = _column_names(names, units, body, n_filled) if header else _numbered_names(body, n_filled)
    return TextLayout(
        _unique(names[:width]), ",", width, body[0].n_above, body[0].cells, fs=fs, flags=tuple(flags)
    )


def _column_names(names: list[str], units: Sequence[str], body: Sequence[_Row], n_filled: int) -> list[str]:
    """Return a name with unit for each column; an unnamed column of row numbers is named `ROW_NUMBER`."""
    if len(names) == n_filled - 1 and _counts(body):
        names, units = [ROW_NUMBER, *names], ["", *units]
    elif names and not names[0] and _counts(body):
        names = [ROW_NUMBER, *names[1:]]
    names = [*names, *[""] * (n_filled - len(names))]
    all_units = [*map(parse_unit, units), *[""] * len(names)]
    return [add_unit(name, unit) for name, unit in zip(names, all_units, strict=False)]


def _numbered_names(body: Sequence[_Row], n_filled: int) -> list[str]:
    """Return the names "c1", "c2" and so on for unnamed columns; "time" for a first column of dates."""
    if n_filled == 1:
        return [ACCELERATION]
    names = [f"c{i}" for i in range(1, n_filled + 1)]
    first = body[0].cells[0]
    return ["time", *names[1:]] if DATE.fullmatch(first) or is_date(first) else names


def _stated_rate(above: Sequence[_Row]) -> tuple[float | None, str]:
    """Return the sampling rate in Hz stated in the lines above the rows, and the text that states it."""
    rate = re.compile(
        r"\b(?:(?:sampl\w*|update|measurement|acquisition)[ _-]*(?:rate|frequency)|abtastrate|"
        r"data[ _-]rate(?=[^\d\n]{0,12}[\d.,]+\s*k?hz))\b([^\d\n]{0,12})(\d+(?:[.,]\d+)?)\s*(k?hz\b)?",
        re.IGNORECASE,
    )
    for row in above:
        if match := rate.search(" ".join(row.cells)):
            separator, number, unit = match.groups()
            factor = 1000 if "khz" in f"{separator} {unit}".lower() else 1
            return factor * float(number.replace(",", ".")) or None, match[0]
    return None, ""


def _is_empatica(body: Sequence[_Row]) -> bool:
    """Return whether the first row is the start time in s since 1970, and the second the sampling rate."""
    if len(body) < 3:
        return False
    numbers = [set(row.cells) for row in body[:2]]
    if any(len(cells) != 1 or not re.fullmatch(r"\d+(\.\d*)?", min(cells)) for cells in numbers):
        return False
    start, rate = (float(min(cells)) for cells in numbers)
    return 1e9 < start < 1e10 and 1 <= rate <= 1000


def _is_numeric(cells: Sequence[str]) -> bool:
    n_numbers = sum(map(is_number, cells))
    n_texts = sum(not is_number(cell) and cell.lower() not in MISSING for cell in cells)
    return n_numbers > 0 and n_numbers >= n_texts


def _fits(row: _Row, width: int, numeric: Sequence[int]) -> bool:
    """Return whether a line has numbers or missing values in all numeric columns, and so is a row."""
    if len(row.cells) != width:
        return False
    cells = [row.cells[i] for i in numeric]
    return any(map(is_number, cells)) and all(is_number(cell) or cell.lower() in MISSING for cell in cells)


def _is_counted(body: Sequence[_Row], *, is_txt: bool) -> bool:
    """Return whether the first row contains the default column names of pandas: 0, 1, 2 and so on."""
    first, rest = list(body[0].cells), [row.cells for row in body[1:]]
    numbers = [cell for cell in first[1:] if cell] if not first[0] else [cell for cell in first if cell]
    if not rest or not numbers or numbers != [str(i) for i in range(len(numbers))]:
        return False
    if not first[0]:
        return all(row[0] for row in rest)
    if any(all(re.search("[.,eE]", row[i]) for row in rest) for i in range(len(numbers))):
        return len(numbers) > 1 or not is_txt
    return len(numbers) > 2 and not _counts(body)


def _counts(body: Sequence[_Row]) -> bool:
    """Return whether the first column numbers the rows."""
    numbers = [row.cells[0] for row in body]
    if not all(re.fullmatch(r"\d{1,9}", number) for number in numbers):
        return False
    return all(int(number) == int(numbers[0]) + k for k, number in enumerate(numbers))


def _are_units(row: _Row) -> bool:
    """Return whether all cells of a line are units."""
    cells = [cell for cell in row.cells if cell]
    return bool(cells) and all(
        parse_unit(cell) or re.fullmatch(r"[(\[].{0,12}[)\]]|-", cell) for cell in cells
    )


def _header(
    above: Sequence[_Row], body: Sequence[_Row], width: int, n_filled: int, *, is_labview: bool
) -> _Row | None:
    """Return the last line that names every column; a comment line only if no other line does."""

    def names_all(row: _Row) -> bool:
        if not (any(map(str.isalpha, "".join(row.cells))) or _is_counted([row, *body], is_txt=False)):
            return False
        if is_labview or n_filled <= row.n_filled <= width:
            return True
        # The first column may be an index without a name.
        return row.n_filled == n_filled - 1 and _counts(body)

    lines = [row for row in above if not row.is_comment]
    candidates = [*lines[:-4:-1]] if width > 1 else lines[-1:]  # the last three, in reverse order
    if width > 1:
        candidates += [row for row in reversed(above) if row.is_comment]
    return next(filter(names_all, candidates), None)


def _labview_columns(
    names: list[str], header: dict[str, list[str]]
) -> tuple[list[str], list[str], float | None]:
    """Return the names, units and rate of a LabVIEW measurement."""
    if names[-1:] == ["Comment"]:
        names = names[:-1]
    y_units = iter(header.get("Y_Unit_Label", []))
    units = ["" if name == "X_Value" else next(y_units, "") for name in names]
    is_time_axis, has_no_x = (
        header.get("X_Dimension", ["Time"])[:1] == ["Time"],
        header.get("X_Columns") == ["No"],
    )
    x_name = ROW_NUMBER if has_no_x else "time" if is_time_axis else "X_Value"
    column_names = [x_name if name == "X_Value" else name for name in names]
    steps = {step.replace(",", ".") for step in header.get("Delta_X", ()) if is_number(step)}
    step = float(steps.pop()) if has_no_x and is_time_axis and len(steps) == 1 else 0.0
    return column_names, units, 1 / step if step > 0 else None


def _unique(names: Sequence[str]) -> tuple[str, ...]:
    """Make names unique by adding the column number to blank and repeated names."""
    full_names = [name or f"c{i}" for i, name in enumerate(names, 1)]
    counts = Counter(full_names)
    return tuple(name if counts[name] == 1 else f"{name}#{i}" for i, name in enumerate(full_names, 1))
