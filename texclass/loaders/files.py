"""Load a recording from a file of any format, or from one file per axis."""

import importlib
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
from texclass.loaders.exports import other_sensor_name
from texclass.loaders.phases_files import split_part, use_marked_phases
from texclass.loaders.plausibility import build_recording
from texclass.loaders.readers import (
    BAG_METADATA,
    FORMATS,
    NO_TIME_COLUMN,
    ReaderSettings,
    ReadSignals,
    as_column_names,
    as_samples,
    check_coverage,
    formats,
    is_bag,
    rate_conflict_error,
    reader_error,
)
from texclass.loaders.source_files import recording_name, source_files
from texclass.loaders.time_columns import is_increasing, resample_by_time_column
from texclass.loaders.timestamps import align
from texclass.recording import AUXILIARY_UNITS, Recording, RecordingError, Samples, make_read_only

_COMPANION = "companion\0"
"""Prefix of signals from companion files; no column name contains a null character."""


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
        File in a format given by its suffix: text (one value per line, or columns), CSV, TSV, LVM,
        WAV, FLAC, MATLAB, NPY, NPZ or HDF5; with the extra `parquet` also Parquet; with the extra `formats`
        also Excel (.xlsx) and TDMS; with the extra `robot` also ROS bags (.bag, .mcap, .db3, a rosbag2
        folder, or "bag:FILE?topic=/name"). Files
        `_X`, `_Y` and `_Z` of the same name form one recording, as do the files in a folder exported by a
        sensor app. "FILE#2" is the second surface that is marked in FILE.phases.json.
    fs : float, optional
        Sampling rate in Hz, required if the file does not state it. Time stamps must agree with it.
    unit : {"m/s^2", "g", "mg", "counts", "V", "arbitrary"}, optional
        Unit of the acceleration, required if neither the message type of a bag nor a column name ("x [g]")
        states it. "counts" keeps the integer values of audio; with other units, full scale is 1.
    column : str or sequence of str, optional
        Column(s) or array of the acceleration, by name or by number from 1 (default: the conventional names
        x, y, z; ax, ay, az; acceleration; or the only column).
    auxiliary : mapping of str to str or sequence of str, optional
        Column(s) of other signals, by field of `Recording` and in the unit of that field.
    delimiter : str, optional
        Column delimiter of a text file (default: detected). Decimal commas are accepted if the delimiter is
        not a comma.
    time_column : str, optional
        Column of the time stamps, numbers or dates (default: an increasing column named time, t or
        timestamp). Time stamps give the sampling rate, or must agree with `fs`. Samples are interpolated to
        a uniform rate; short gaps are filled, long gaps divide the recording. "none" ignores time stamps.
    time_unit : {"s", "ms", "us", "ns", "min", "h", "days"}, optional
        Unit of the time stamps (default: from the column name, or inferred from range and step).
    resample : float, optional
        Target sampling rate in Hz of a band-limited resampling.
    topic : str, optional
        Topic of a bag (default: the only one with an acceleration).
    skip_rows : int, optional
        Number of lines to skip at the start of a text file (default 0).
    comment : str, optional
        Start of comment lines in a text file (default: #, % and //).
    drop_incomplete : bool
        Drop lines of a text file that lack a number in a column (default False: raise an error).

    Returns
    -------
    recording : Recording
        Recording without surface, operator and session. Phases that a user marked (NAME.phases.json next to
        the file) are its `phases`.

    Raises
    ------
    RecordingError
        If the sampling rate or unit is missing or contradicts the file, or the file is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> samples = np.random.default_rng(0).standard_normal((1000, 3))
    >>> np.savetxt("oak.csv", samples, delimiter=",", header="ax,ay,az", comments="")
    >>> load_recording("oak.csv", fs=1000, unit="g")
    <Recording 'oak': 1 s at 1000 Hz, 3 axes in m/s^2>
    """
    name, part = split_part(path)
    path, topic = locate_recording(name, topic)
    settings = ReaderSettings(
        fs=fs,
        unit=unit,
        column=column,
        delimiter=delimiter,
        time_column=time_column,
        time_unit=time_unit,
        resample=resample,
        topic=topic,
        skip_rows=skip_rows,
        comment=comment,
        drop_incomplete=drop_incomplete,
    )
    settings.check(path)
    roles = {
        name: as_column_names(names) for name, names in {ACCELERATION: column, **(auxiliary or {})}.items()
    }
    axes, companions, flags = source_files(path)
    signals = read_signals(axes, roles, settings, companions=companions)
    if unit is None and signals.unit is not None and not is_bag(path):
        flags = (*flags, f"unit {signals.unit}, from the column names")
    recording = build_recording(
        signals,
        fs=fs,
        unit=unit,
        resample=resample,
        flags=flags,
        recording_id=recording_name(path, axes),
        source=str(path),
    )
    return use_marked_phases(recording, path, part)


def locate_recording(name: str | Path, topic: str | None = None) -> tuple[Path, str | None]:
    """Return the file and topic of a name such as "bag:FILE?topic=/name".

    Parameters
    ----------
    name : str or Path
        File, or "bag:FILE", optionally with a topic.
    topic : str, optional
        Topic, if the name has none.

    Raises
    ------
    RecordingError
        If the file does not exist, or `topic` differs from that in the name.
    """
    path = Path(name).expanduser()
    if is_bag_name(name):
        rest, _, query = str(name).removeprefix("bag:").partition("?")
        path, named_topic = Path(rest).expanduser(), query.removeprefix("topic=")
        if query and not query.startswith("topic="):
            raise reader_error(name, f"unknown query {query!r}", "bag:FILE?topic=/name")
        if topic and named_topic and topic.strip("/") != named_topic.strip("/"):
            raise reader_error(name, f"topic {topic!r} contradicts it", "the topic in one place")
        topic = topic or named_topic or None
    if not path.exists():
        raise RecordingError(f"{path}: cannot be opened (no such file)")
    return path / BAG_METADATA if (path / BAG_METADATA).is_file() else path, topic


def is_bag_name(name: str | Path) -> bool:
    """Return whether a name has the form "bag:FILE" and is not the name of a file."""
    return str(name).startswith("bag:") and not Path(name).exists()


def column_names(path: Path, settings: ReaderSettings) -> tuple[str, ...]:
    """Return the names of the columns or arrays of a file.

    Raises
    ------
    RecordingError
        If the file does not exist, is empty or unreadable, or has an unknown format.
    """
    names: tuple[str, ...] = _reader(path).names(path, settings)
    return names


def topics(path: Path) -> tuple[str, ...]:
    """Return the topics of a bag that can be read as recordings.

    Raises
    ------
    RecordingError
        If the file is not a readable bag.
    """
    names: tuple[str, ...] = _reader(path).readable_topics(path)
    return names


def _reader(path: Path) -> ModuleType:
    """Check that a file exists, and import the module that reads its format."""
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
        raise reader_error(path, f"unknown suffix {path.suffix!r}", f"one of {', '.join(formats())}")
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


def read_signals(
    axes: Mapping[str, Path],
    roles: Mapping[str, Sequence[str]],
    settings: ReaderSettings,
    *,
    trim: bool = False,
    companions: Mapping[str, Path] | None = None,
) -> ReadSignals:
    """Read the signals of a recording from one file, or join one file per axis.

    Parameters
    ----------
    axes : mapping of str to Path
        File by axis; the axis is "" if one file contains all.
    roles : mapping of str to sequence of str
        Columns, in the order of the axes, by signal ("acceleration" or an auxiliary field of `Recording`). By
        default, the acceleration is in the columns with conventional names, or in the only column.
    settings : ReaderSettings
        Options of the reader.
    trim : bool
        Cut axes of different lengths to the shortest (default False: raise an error).
    companions : mapping of str to Path, optional
        File by auxiliary field. The file must have the same time column as the acceleration; its signal keeps
        its sampling rate or, if the rates are nearly equal, is interpolated at the times of the acceleration.
        Without a time column, the result lacks the field.

    Returns
    -------
    ReadSignals
        Signals by field of `Recording`.

    Raises
    ------
    RecordingError
        If a file is invalid or from another sensor, the axes differ in length or rate, or a companion covers
        less than 90 % of the time of the acceleration.
    """
    if unknown := set(roles) - {ACCELERATION, *AUXILIARY_UNITS}:
        raise RecordingError(
            f"unknown signals {sorted(unknown)}. Expected {', '.join((ACCELERATION, *AUXILIARY_UNITS))}"
        )
    parts = {axis: _read_file(path, roles, settings, companions or {}) for axis, path in axes.items()}
    axis, first = next(iter(parts.items()))
    if len(parts) == 1:
        is_one_axis = axis and first.signals[ACCELERATION].ndim == 1
        return replace(first, channels=(axis,)) if is_one_axis else first
    where = str(axes[axis])
    lengths = {axis: len(part.signals[ACCELERATION]) for axis, part in parts.items()}
    if len(set(lengths.values())) > 1 and not trim:
        raise reader_error(
            where,
            f"its axes have {lengths} samples",
            "the same length; to cut all axes to the shortest, set `trim = true` in a card",
        )
    rates = [part.fs for part in parts.values()]
    if len(set(rates)) > 1:
        raise reader_error(where, f"its axes have the rates {rates} Hz", "the same rate for all axes")
    units = {part.unit: None for part in parts.values() if part.unit is not None}
    if len(units) > 1:
        problem = f"its axes have the units {' and '.join(sorted(units))}"
        raise reader_error(where, problem, "the same unit for all axes")
    n = min(lengths.values())
    acceleration = make_read_only(
        np.column_stack([part.signals[ACCELERATION][:n] for part in parts.values()])
    )
    signals = {**first.signals, ACCELERATION: acceleration}
    flags = tuple(dict.fromkeys(flag for part in parts.values() for flag in part.flags))
    return ReadSignals(signals, first.fs, flags, tuple(parts), next(iter(units), None), first.rates)


def _read_file(
    path: Path, roles: Mapping[str, Sequence[str]], settings: ReaderSettings, companions: Mapping[str, Path]
) -> ReadSignals:
    """Read the signals of one file and of its companions, by field of `Recording`."""
    acceleration = roles.get(ACCELERATION, ())
    names = () if is_bag(path) and acceleration else column_names(path, settings)
    if not acceleration and (sensor := other_sensor_name(path)):
        expected = "an accelerometer file; if it contains an acceleration, pass its columns with --column"
        raise reader_error(path, f"the file name denotes another sensor ({sensor})", expected)
    find_varying = partial(_varying_columns, path, settings)
    chosen = resolve_columns(acceleration, names) or choose_acceleration(names, path, find_varying)
    if unprintable := next((name for name in chosen if not name.isprintable()), None):
        raise reader_error(
            path, f"the column {unprintable!r} contains a control character", "printable names"
        )
    columns = {field: resolve_columns(wanted, names) for field, wanted in roles.items()}
    columns[ACCELERATION] = chosen
    wanted_columns = tuple(dict.fromkeys(name for wanted in columns.values() for name in wanted))
    read = _read(path, wanted_columns, settings, companions)
    joined = [field for field in companions if _COMPANION + field in read.signals]
    columns |= {field: (_COMPANION + field,) for field in joined}
    rates = {field: _rate_of_columns(read, wanted, path) for field, wanted in columns.items()}
    signals = {field: _stack_columns(read, wanted, path) for field, wanted in columns.items()}
    fs = rates.pop(ACCELERATION)
    for field, rate in settings.auxiliary_fs.items():
        if field in columns and rates[field] not in (None, fs, rate):
            raise rate_conflict_error(path, f"{rates[field]:g} Hz for the {field}", rate, "auxiliary_fs_hz")
        rates |= {field: rate} if field in columns else {}
    return replace(
        read,
        signals=signals,
        fs=fs,
        rates={field: rate for field, rate in rates.items() if rate not in (None, fs)},
        flags=(*read.flags, *ambiguous_number_flags(acceleration, names)),
        unit=read.unit or acceleration_unit(chosen, path),
        channels=tuple(map(strip_unit, chosen)) if len(chosen) > 1 else (),
    )


def _stack_columns(read: ReadSignals, names: Sequence[str], path: Path) -> Samples:
    """Stack columns of a file into one signal."""
    columns = [read.signals[name] for name in names]
    if len({len(column) for column in columns}) > 1:
        lengths = ", ".join(f"{name!r} has {len(read.signals[name])}" for name in names)
        problem = f"its columns differ in length: {lengths} samples"
        raise reader_error(path, problem, "the same length for all columns")
    return make_read_only(columns[0] if len(columns) == 1 else np.column_stack(columns))


def _rate_of_columns(read: ReadSignals, names: Sequence[str], path: Path) -> float | None:
    """Return the sampling rate in Hz of the columns of one signal, None if it is not stated."""
    rates = {name: read.rates.get(name, None if read.rates else read.fs) for name in names}
    stated = {name: rate for name, rate in rates.items() if rate is not None}
    if len(set(stated.values())) > 1:
        rate_list = ", ".join(f"{name!r} at {rate:g} Hz" for name, rate in stated.items())
        raise reader_error(path, f"its columns differ in rate: {rate_list}", "the same rate in one signal")
    return next(iter(stated.values()), None)


def _varying_columns(path: Path, settings: ReaderSettings, names: Sequence[str]) -> list[str]:
    """Return the longest columns of one group that are not monotonic and may contain an acceleration.

    Only the first 12 columns are read, because the result is only a suggestion in a message.
    """
    candidates: dict[str, Samples] = {}
    tolerant = replace(settings, drop_incomplete=True)
    for name in names[:12]:
        try:
            samples = as_samples(_reader(path).read(path, (name,), tolerant).signals[name], name, path)
        except RecordingError:
            continue
        steps = np.diff(samples, axis=0)
        is_monotonic = (steps >= 0).all() or (steps <= 0).all()
        if not is_monotonic and group_path(name) == group_path(next(iter(candidates), name)):
            candidates[name] = samples
    n_samples = max(map(len, candidates.values()), default=0)
    return [name for name, samples in candidates.items() if len(samples) == n_samples]


def _read(
    path: Path, wanted: tuple[str, ...], settings: ReaderSettings, companions: Mapping[str, Path]
) -> ReadSignals:
    """Read columns of a file; if it has time stamps, resample the columns to a uniform rate."""
    read: ReadSignals
    reader, time_column = _reader(path), settings.time_column
    if is_bag(path):  # the reader of bags uses their time stamps
        return reader.read(path, wanted, settings)  # type: ignore[no-any-return]
    if settings.topic is not None:
        raise reader_error(path, f"topic {settings.topic!r} cannot be selected, it is not a bag", "a bag")
    if time_column is not None and time_column != NO_TIME_COLUMN:
        (time,) = resolve_columns((time_column,), reader.names(path, settings))
        read = reader.read(path, tuple(dict.fromkeys((*wanted, time))), settings)
        return _resample_columns(replace(read, fs=None), wanted, time, path, settings, companions)
    ignored = list[str]()
    for time in [] if time_column else _time_candidates(reader.names(path, settings), wanted):
        try:
            read = reader.read(path, (*wanted, time), settings)
        except RecordingError:  # reading without the time column may succeed
            ignored.append(f"time: column {time!r} is ignored, some rows contain no number or date")
            continue
        if any(len(read.signals[name]) != len(read.signals[time]) for name in wanted):
            ignored.append(f"time: column {time!r} is ignored, its length differs from the signals")
        elif not is_increasing(read.signals[time]):
            ignored.append(f"time: column {time!r} is ignored, it does not increase like time stamps")
        else:
            read = replace(read, flags=(*read.flags, *ignored))
            try:
                return _resample_columns(read, wanted, time, path, settings, companions)
            except RecordingError as error:
                if read.fs is None or companions:
                    raise
                raise RecordingError(
                    f"{path}: its time column {time!r} contradicts its sampling rate, {read.fs:g} Hz. "
                    "Pass --time-column none to use the sampling rate, or --time-column "
                    f"{shlex.quote(time)} to use the time stamps (in a card: `time_column`)"
                ) from error
    read = reader.read(path, wanted, settings)
    signals = {name: as_samples(read.signals[name], name, path) for name in wanted}
    return replace(read, signals=signals, flags=(*read.flags, *ignored))


def _time_candidates(names: Sequence[str], wanted: Sequence[str]) -> list[str]:
    """Return the columns named like time stamps whose group contains all signals, innermost group first."""

    def has_signals(name: str) -> bool:
        return all(group_path(signal)[: len(group_path(name))] == group_path(name) for signal in wanted)

    candidates = [name for name in names if is_time(name) and name not in wanted and has_signals(name)]
    return sorted(candidates, key=lambda name: (-len(group_path(name)), time_unit(name) is None))


def _resample_columns(
    read: ReadSignals,
    wanted: tuple[str, ...],
    time: str,
    path: Path,
    settings: ReaderSettings,
    companions: Mapping[str, Path],
) -> ReadSignals:
    """Resample signals to a uniform rate, given a column of time stamps."""
    times = read.signals[time]
    signals = {name: as_samples(read.signals[name], name, path) for name in wanted}
    if lengths := {len(signal) for signal in signals.values()} - {len(times)}:
        raise reader_error(
            path,
            f"its time column {time!r} has {len(times)} values, a signal has {lengths.pop()}",
            "the same length, or --time-column none",
        )
    columns = [signal.reshape(len(times), -1) for signal in signals.values()]
    uniform, fs, start_s, flags = resample_by_time_column(
        np.column_stack(columns),
        times,
        time,
        settings.fs if read.fs is None else read.fs,
        where=str(path),
        unit=settings.time_unit,
        rate_of=settings.rate_of,
        origin=times[0],
    )
    parts = np.split(uniform, np.cumsum([column.shape[1] for column in columns])[:-1], axis=1)
    resampled = {
        name: part.reshape(len(part), *signal.shape[1:])
        for (name, signal), part in zip(signals.items(), parts, strict=True)
    }
    rates, join_flags = dict.fromkeys(resampled, fs), list[str]()
    for field, file in companions.items():
        companion, companion_fs, companion_start_s = _read_companion(file, field, time, times, settings)
        signal, rate, coverage = align(
            companion, companion_fs, companion_start_s - start_s, to_fs=fs, n=len(uniform)
        )
        check_coverage(coverage, file)
        name = _COMPANION + field
        resampled[name] = signal[:, 0] if signal.shape[1] == 1 else signal
        rates[name] = rate
        kept = f"at its own rate, {rate:g} Hz" if rate != fs else f"at the times of {path.name}"
        join_flags.append(f"joined: {field} of {file.name}, {kept}")
    return replace(read, signals=resampled, fs=fs, rates=rates, flags=(*read.flags, *flags, *join_flags))


def _read_companion(
    path: Path, field: str, time: str, times: NDArray[np.generic], settings: ReaderSettings
) -> tuple[Samples, float, float]:
    """Return signal (n, n_columns) and rate in Hz of a companion file, and its start in s after times[0]."""
    reader = _reader(path)
    names = signal_columns(reader.names(path, settings), path)
    read = reader.read(path, (*names, time), settings)
    companion_times = read.signals[time]
    if companion_times.dtype.kind != times.dtype.kind:
        raise reader_error(
            path,
            f"the type of its column {time!r} differs from that column in the acceleration file",
            "numbers in both files, or dates in both",
        )
    factor = turn_rate_factor(names, path) if field == "turn_rate" else 1.0
    columns = np.column_stack([as_samples(read.signals[name], name, path) * factor for name in names])
    unit, stated_fs = settings.time_unit, settings.auxiliary_fs.get(field)
    uniform, fs, start_s, _ = resample_by_time_column(
        columns, companion_times, time, stated_fs, where=str(path), unit=unit, origin=times[0]
    )
    return uniform, fs, start_s
