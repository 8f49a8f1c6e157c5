"""One recording from one file of any format, or from one file per axis."""

import importlib
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from texclass import shipped
from texclass.loaders.columns import (
    ACCELERATION,
    acceleration_unit,
    ambiguous_number_flags,
    choose_acceleration,
    group_path,
    is_time,
    resolve_columns,
    signal_columns,
    strip_unit,
    time_unit,
    turn_rate_factor,
)
from texclass.loaders.exports import find_export, other_sensor_name
from texclass.loaders.plausibility import build_recording
from texclass.loaders.readers import (
    BAG_METADATA,
    FORMATS,
    NO_TIME_COLUMN,
    ReaderSettings,
    ReadSignals,
    as_column_names,
    as_samples,
    formats,
    is_bag,
    reader_error,
)
from texclass.loaders.time_columns import is_increasing, resample_by_time_column
from texclass.recording import AUXILIARY_UNITS, Recording, RecordingError, Samples, make_read_only

AXIS = re.compile(r"_(?P<axis>[XYZxyz])(?=[_.])")
"""The part of a file's name that says which axis it holds: `<name>_X.txt`, `<name>_X_train1.txt`."""
_COMPANION = "beside\0"
"""Before the name of a signal in another file, as no column is named."""


def load_recording(
    path: str | Path,
    *,
    fs: float | None = None,
    unit: str | None = None,
    column: str | Sequence[str] | None = None,
    auxiliary: Mapping[str, str | Sequence[str]] | None = None,
    delimiter: str | None = None,
    time_column: str | None = None,
    time_unit: str | None = None,
    resample: float | None = None,
    topic: str | None = None,
    skip_rows: int | None = None,
    comment: str | None = None,
    drop_incomplete: bool = False,
) -> Recording:
    """Load one recording from a file.

    Parameters
    ----------
    path : str or Path
        Text (one value per line, or columns), CSV, TSV, LVM, Parquet, WAV, FLAC, MATLAB, NPY, NPZ, HDF5,
        with the extra `formats` Excel (.xlsx) and TDMS, or a
        bag of ROS (.bag, .mcap, .db3, a folder of rosbag2, also as "bag:FILE?topic=/name"), by suffix. If its
        name says `_X`, `_Y` or `_Z` and files of the other axes are beside it, they form one recording.
    fs : float, optional
        Sampling rate in Hz; needed unless the file states it. Stamps of a bag, times of a table must agree.
    unit : str, optional
        Unit of the acceleration: "m/s^2", "g", "mg", "counts", "V" or "arbitrary". Needed unless the type of
        a bag's messages or the name of a column ("x [g]") states it. Integer audio keeps its codes when this
        is "counts"; else full scale is 1.
    column : str or sequence of str, optional
        Column(s) or array of the acceleration, by name or by number from 1; by default the conventional names
        (x, y, z; ax, ay, az; acceleration) or the only column.
    auxiliary : mapping of str to str or sequence of str, optional
        Signals beside the acceleration: field of `Recording` -> column(s), in the unit the field is kept in.
    delimiter : str, optional
        Of a text; by default what its first line has. Decimal points may be commas where it is none.
    time_column : str, optional
        Column of the time stamps (numbers or dates); by default one named time, t or timestamp that
        increases. Time stamps give the rate, or must agree with `fs`; samples are interpolated at their
        times, and lost ones are filled in or divide the recording. "none" ignores all time stamps.
    time_unit : str, optional
        Unit of the time stamps: "s", "ms", "us", "ns", "min", "h" or "days". By default the one in the name
        of the column, or the one that range and step imply.
    resample : float, optional
        Rate in Hz to which the signals are brought, band-limited.
    topic : str, optional
        Of a bag; by default the only one that carries an acceleration.
    skip_rows : int, optional
        Number of lines at the beginning of a text that are not read (default 0).
    comment : str, optional
        Beginning of comment lines of a text (default: #, % and //).
    drop_incomplete : bool
        Leave out lines of a text without a number in each column (default: they are an error).

    Returns
    -------
    recording : Recording
        Recording without surface, operator and session.

    Raises
    ------
    RecordingError
        If rate or unit are missing or contradicted, or the file is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> samples = np.random.default_rng(0).standard_normal((1000, 3))
    >>> np.savetxt("oak.csv", samples, delimiter=",", header="ax,ay,az", comments="")
    >>> load_recording("oak.csv", fs=1000, unit="g")
    <Recording 'oak': 1 s at 1000 Hz, 3 axes in m/s^2>
    """
    path, asked = locate_recording(path)
    settings = ReaderSettings(
        fs=fs,
        unit=unit,
        column=column,
        delimiter=delimiter,
        time_column=time_column,
        time_unit=time_unit,
        resample=resample,
        topic=topic or asked,
        skip_rows=skip_rows,
        comment=comment,
        drop_incomplete=drop_incomplete,
    )
    settings.check(path)
    roles = {
        name: as_column_names(names) for name, names in {ACCELERATION: column, **(auxiliary or {})}.items()
    }
    axes, beside, flags = source_files(path)
    signals = read_signals(axes, roles, settings, companions=beside)
    if unit is None and signals.unit is not None and not is_bag(path):
        flags = (*flags, f"in {signals.unit}: the names of its columns say so")
    return build_recording(
        signals,
        fs=fs,
        unit=unit,
        resample=resample,
        flags=flags,
        recording_id=recording_name(path, axes),
        source=str(path),
    )


def locate_recording(name: str | Path) -> tuple[Path, str | None]:
    """Return the file that a name means, and the topic if it names one ("bag:FILE?topic=/name").

    Raises
    ------
    RecordingError
        If there is no such file.
    """
    topic = None
    path = Path(name).expanduser()
    if is_bag_name(name):
        rest, _, query = str(name).removeprefix("bag:").partition("?")
        path, topic = Path(rest).expanduser(), query.removeprefix("topic=") or None
        if query and not query.startswith("topic="):
            raise reader_error(name, f"asks for {query!r}", "bag:FILE?topic=/name")
    if not path.exists():
        raise RecordingError(f"{path}: cannot be opened (no such file)")
    return path / BAG_METADATA if (path / BAG_METADATA).is_file() else path, topic


def is_bag_name(name: str | Path) -> bool:
    """Whether a name is of the form "bag:FILE" and not a file itself."""
    return str(name).startswith("bag:") and not Path(name).exists()


def column_names(path: Path, settings: ReaderSettings) -> tuple[str, ...]:
    """Return the names of the columns or arrays of a file.

    Raises
    ------
    RecordingError
        If the file does not exist, is empty, unreadable, or of an unknown kind.
    """
    names: tuple[str, ...] = _reader(path).names(path, settings)
    return names


def topics(path: Path) -> tuple[str, ...]:
    """Return the topics of a bag that can be recordings.

    Raises
    ------
    RecordingError
        If it is no readable bag.
    """
    found: tuple[str, ...] = _reader(path).readable_topics(path)
    return found


def _reader(path: Path) -> ModuleType:
    """Return the module that reads a file that is there; its libraries are imported only now."""
    try:
        size = path.stat().st_size
    except OSError as error:
        raise RecordingError(f"{path}: cannot be opened ({error.strerror})") from error
    if not path.is_file():
        raise reader_error(path, "is not a file", "one file per recording (or axis)")
    if size == 0:
        raise reader_error(path, "is empty (0 bytes)", "at least two samples")
    suffix = ".mcap" if path.name == BAG_METADATA else path.suffix.lower()
    if (kind := formats().get(suffix)) is None:
        raise reader_error(path, f"suffix is {path.suffix!r}", f"one of {', '.join(formats())}")
    try:
        if suffix in FORMATS:
            return importlib.import_module(kind.module)
        return shipped.module_of("readers", suffix[1:])
    except ImportError as error:
        if not kind.extra:
            raise
        raise RecordingError(
            f"{path}: {suffix} files require the extra `{kind.extra}` ({error}): "
            f"pip install 'texclass[{kind.extra}]'"
        ) from error


def source_files(path: Path) -> tuple[dict[str, Path], dict[str, Path], tuple[str, ...]]:
    """Return the files of a recording by axis, those of other signals by field, and what a user should know.

    `path` is a file, or a folder that a sensor app exported.
    """
    if (export := find_export(path)) is None:
        return axis_files(path), {}, ()
    beside = {"turn_rate": path / export.turn_rate} if export.turn_rate else {}
    return {"": path / export.acceleration}, beside, (f"export: {export.facts}",)


def recording_name(path: Path, axes: Mapping[str, Path]) -> str:
    """Return the name of a recording by its file, or by one of its files, without suffix and axis."""
    if path.is_dir():
        return path.name
    if len(axes) == 1:
        return (path.parent if path.name == BAG_METADATA else path).stem
    *_, axis = AXIS.finditer(path.name)
    return (path.name[: axis.start()] + path.name[axis.end() :]).rpartition(".")[0]


def axis_files(path: Path) -> dict[str, Path]:
    """Return axis -> file for a file that is one of several axes; else the file itself under ""."""
    found = list(AXIS.finditer(path.name))
    if not found:
        return {"": path}
    first, last = found[-1].span("axis")
    letters = "XYZ" if path.name[first].isupper() else "xyz"
    siblings = {a.lower(): path.with_name(path.name[:first] + a + path.name[last:]) for a in letters}
    return {axis: file for axis, file in siblings.items() if file.is_file()} or {"": path}


def read_signals(
    axes: Mapping[str, Path],
    roles: Mapping[str, Sequence[str]],
    settings: ReaderSettings,
    *,
    trim: bool = False,
    companions: Mapping[str, Path] | None = None,
) -> ReadSignals:
    """Read a recording's signals from one file, or join one file per axis.

    Parameters
    ----------
    axes : mapping of str to Path
        Axis -> file; the axis is "" when one file holds all.
    roles : mapping of str to sequence of str
        "acceleration" or an auxiliary field of `Recording` -> its column(s), in the order of the axes. By
        default the acceleration is in the columns of conventional names, or in the only one.
    settings : ReaderSettings
        How to read.
    trim : bool
        Cut axes of different lengths to the shortest instead of refusing them.
    companions : mapping of str to Path, optional
        Auxiliary field -> file with the same time column, in which it is interpolated. Without time column, a
        field is not in the result.

    Raises
    ------
    RecordingError
        If a file is bad or of another sensor, the axes differ in length or rate, or a signal beside them
        covers too little of their time.
    """
    if unknown := set(roles) - {ACCELERATION, *AUXILIARY_UNITS}:
        raise RecordingError(
            f"signals {sorted(unknown)} are unknown. Expected some of {', '.join(AUXILIARY_UNITS)}"
        )
    parts = {axis: _read_file(path, roles, settings, companions or {}) for axis, path in axes.items()}
    axis, first = next(iter(parts.items()))
    if len(parts) == 1:
        is_one_axis = axis and first.named[ACCELERATION].ndim == 1
        return replace(first, channels=(axis,)) if is_one_axis else first
    where = str(axes[axis])
    lengths = {axis: len(part.named[ACCELERATION]) for axis, part in parts.items()}
    if len(set(lengths.values())) > 1 and not trim:
        raise reader_error(where, f"its axes have {lengths} samples", "one length")
    rates = [part.fs for part in parts.values()]
    if len(set(rates)) > 1:
        raise reader_error(where, f"its axes have rates {rates}", "one")
    units = {part.unit: None for part in parts.values() if part.unit is not None}
    if len(units) > 1:
        raise reader_error(where, f"its axes are in {' and '.join(sorted(units))}", "one unit")
    n = min(lengths.values())
    acceleration = make_read_only(np.column_stack([part.named[ACCELERATION][:n] for part in parts.values()]))
    named = {**first.named, ACCELERATION: acceleration}
    flags = tuple(dict.fromkeys(flag for part in parts.values() for flag in part.flags))
    return ReadSignals(named, first.fs, flags, tuple(parts), next(iter(units), None))


def _read_file(
    path: Path, roles: Mapping[str, Sequence[str]], settings: ReaderSettings, companions: Mapping[str, Path]
) -> ReadSignals:
    """Read the signals of one file, and those beside them, by the fields of `Recording`."""
    stated = roles.get(ACCELERATION, ())
    present = () if is_bag(path) and stated else column_names(path, settings)
    if not stated and (sensor := other_sensor_name(path)):
        rule = "an accelerometer: --column names its columns, if they hold an acceleration"
        raise reader_error(path, f"its name is that of a {sensor}", rule)
    varying = partial(_varying_columns, path, settings)
    chosen = resolve_columns(stated, present) or choose_acceleration(present, path, varying)
    if steering := next((name for name in chosen if not name.isprintable()), None):
        raise reader_error(path, f"the column {steering!r} holds a control character", "printable names")
    columns = {field: resolve_columns(names, present) for field, names in roles.items()} | {
        ACCELERATION: chosen
    }
    wanted = tuple(dict.fromkeys(name for names in columns.values() for name in names))
    read = _read(path, wanted, settings, companions)
    named = {field: _stack_columns(read, names, path) for field, names in columns.items()}
    named |= {
        field: read.named[_COMPANION + field] for field in companions if _COMPANION + field in read.named
    }
    return replace(
        read,
        named=named,
        flags=(*read.flags, *ambiguous_number_flags(stated, present)),
        unit=read.unit or acceleration_unit(chosen, path),
        channels=tuple(map(strip_unit, chosen)) if len(chosen) > 1 else (),
    )


def _stack_columns(read: ReadSignals, names: Sequence[str], path: Path) -> Samples:
    """Return columns of a file as one signal."""
    columns = [read.named[name] for name in names]
    if len({len(column) for column in columns}) > 1:
        found = ", ".join(f"{name!r} has {len(read.named[name])}" for name in names)
        raise reader_error(path, f"its columns differ in length: {found} samples", "one length")
    return make_read_only(columns[0] if len(columns) == 1 else np.column_stack(columns))


def _varying_columns(path: Path, settings: ReaderSettings, names: Sequence[str]) -> list[str]:
    """Return the columns of varying numbers that neither rise nor fall throughout, as long as the first."""
    found: dict[str, Samples] = {}
    tolerant = replace(settings, drop_incomplete=True)
    for name in names[:12]:  # enough for a suggestion
        try:
            samples = as_samples(_reader(path).read(path, (name,), tolerant).named[name], name, path)
        except RecordingError:
            continue
        steps = np.diff(samples, axis=0)
        is_monotonic = (steps >= 0).all() or (steps <= 0).all()
        if not is_monotonic and group_path(name) == group_path(next(iter(found), name)):
            found[name] = samples
    most = max(map(len, found.values()), default=0)
    return [name for name, samples in found.items() if len(samples) == most]


def _read(
    path: Path, wanted: tuple[str, ...], settings: ReaderSettings, beside: Mapping[str, Path]
) -> ReadSignals:
    """Read columns of a file, at the rate of its time stamps if there are any."""
    read: ReadSignals
    reader, stated = _reader(path), settings.time_column
    if is_bag(path):  # it has time stamps
        return reader.read(path, wanted, settings)  # type: ignore[no-any-return]
    if stated is not None and stated != NO_TIME_COLUMN:
        (time,) = resolve_columns((stated,), reader.names(path, settings))
        read = reader.read(path, tuple(dict.fromkeys((*wanted, time))), settings)
        return _resample_columns(replace(read, fs=None), wanted, time, path, settings, beside)
    ignored = list[str]()
    for time in [] if stated else _time_candidates(reader.names(path, settings), wanted):
        try:
            read = reader.read(path, (*wanted, time), settings)
        except RecordingError:  # if reading without it succeeds
            ignored.append(f"time: column {time!r} is ignored, it has neither numbers nor dates in each row")
            continue
        if any(len(read.named[name]) != len(read.named[time]) for name in wanted):
            ignored.append(f"time: column {time!r} is ignored, it has another length than the signals")
        elif not is_increasing(read.named[time]):
            ignored.append(f"time: column {time!r} is ignored, it does not increase like time stamps")
        else:
            read = replace(read, flags=(*read.flags, *ignored))
            try:
                return _resample_columns(read, wanted, time, path, settings, beside)
            except RecordingError as error:
                if read.fs is None or beside:
                    raise
                raise RecordingError(
                    f"{path}: its time column {time!r} contradicts the rate that it states, {read.fs:g} Hz. "
                    "Expected one rate: --time-column none uses the stated one, "
                    f"--time-column {shlex.quote(time)} the time stamps (`time_column` in a card)"
                ) from error
    read = reader.read(path, wanted, settings)
    signals = {name: as_samples(read.named[name], name, path) for name in wanted}
    return replace(read, named=signals, flags=(*read.flags, *ignored))


def _time_candidates(names: Sequence[str], wanted: Sequence[str]) -> list[str]:
    """Return the columns named like time in the groups of all signals: the nearest first."""

    def is_above(name: str) -> bool:
        return all(group_path(signal)[: len(group_path(name))] == group_path(name) for signal in wanted)

    found = [name for name in names if is_time(name) and name not in wanted and is_above(name)]
    return sorted(found, key=lambda name: (-len(group_path(name)), time_unit(name) is None))


def _resample_columns(
    read: ReadSignals,
    wanted: tuple[str, ...],
    time: str,
    path: Path,
    settings: ReaderSettings,
    beside: Mapping[str, Path],
) -> ReadSignals:
    """Return signals at the uniform rate that a column of time stamps implies."""
    times = read.named[time]
    signals = {name: as_samples(read.named[name], name, path) for name in wanted}
    for field, file in beside.items():
        signals[_COMPANION + field] = _interpolate_companion(file, field, time, times, settings)
    if lengths := {len(signal) for signal in signals.values()} - {len(times)}:
        raise reader_error(
            path,
            f"its time column {time!r} has {len(times)} values, a signal {lengths.pop()}",
            "one length, or --time-column none",
        )
    columns = [signal.reshape(len(times), -1) for signal in signals.values()]
    uniform, fs, flags = resample_by_time_column(
        np.column_stack(columns),
        times,
        time,
        settings.fs if read.fs is None else read.fs,
        where=str(path),
        unit=settings.time_unit,
        rate_of=settings.rate_of,
    )
    parts = np.split(uniform, np.cumsum([column.shape[1] for column in columns])[:-1], axis=1)
    named = {
        name: part.reshape(len(part), *signal.shape[1:])
        for (name, signal), part in zip(signals.items(), parts, strict=True)
    }
    joined = [
        f"joined: {field} of {file.name}, at the times of {path.name}" for field, file in beside.items()
    ]
    return replace(read, named=named, fs=fs, flags=(*read.flags, *flags, *joined))


def _interpolate_companion(
    path: Path, field: str, time: str, times: NDArray[np.generic], settings: ReaderSettings
) -> Samples:
    """Return a signal of another file at some times, linearly interpolated."""
    reader = _reader(path)
    names = signal_columns(reader.names(path, settings), path)
    read = reader.read(path, (*names, time), settings)
    own = read.named[time]
    if own.dtype.kind != times.dtype.kind:
        raise reader_error(
            path, f"its column {time!r} is of another kind", "the time stamps of the acceleration"
        )
    at, known = (
        clock.astype(np.int64 if clock.dtype.kind == "M" else float).astype(float) for clock in (times, own)
    )
    share = float(np.mean((at >= known.min()) & (at <= known.max())))
    if share < 0.9:  # of the time of the acceleration
        raise reader_error(path, f"it covers {share:.0%} of the times of the acceleration", "90% or more")
    order = np.argsort(known, kind="stable")
    factor = turn_rate_factor(names, path) if field == "turn_rate" else 1.0
    columns = [as_samples(read.named[name], name, path)[order] * factor for name in names]
    found = np.column_stack([np.interp(at, known[order], column) for column in columns])
    return found[:, 0] if len(names) == 1 else found
