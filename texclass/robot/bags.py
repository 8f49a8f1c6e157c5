"""Reader for bags of ROS 1 and 2, without ROS.

Columns of the selected topic have short names: the `linear_acceleration` of an Imu is ax, ay, az. Columns of
other topics are named "/topic/column", and keep their sampling rate.
"""

import difflib
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from texclass.loaders.columns import TURN_RATE
from texclass.loaders.readers import (
    ReaderSettings,
    ReadSignals,
    check_coverage,
    check_size,
    is_topic_pattern,
    quote_names,
    reader_error,
    require_columns,
)
from texclass.loaders.timestamps import Timestamps, align, to_uniform_rate
from texclass.recording import STANDARD_GRAVITY, RecordingError, Samples
from texclass.reporting.wording import counted
from texclass.robot.bag_files import Connection, bag_messages, bag_topics
from texclass.robot.ros_messages import (
    MULTI_ARRAY,
    READABLE,
    TYPES,
    decode_multi_array,
    decode_stamped,
    type_of,
)


def names(path: Path, settings: ReaderSettings) -> tuple[str, ...]:
    """Return the names of the columns: those of the selected topic, then "/topic/column" of other topics.

    Parameters
    ----------
    path : Path
        Bag.
    settings : ReaderSettings
        Settings of the reader, in which `topic` selects a topic.

    Raises
    ------
    RecordingError
        If the bag cannot be read, or `select_topic` raises it.
    """
    topics = bag_topics(path)
    connection = select_topic(topics, settings.topic, path)
    others = (c for c in topics.values() if c.topic != connection.topic and c.type_name in READABLE)
    return (
        *_columns_of(path, connection),
        *(f"{other.topic}/{column}" for other in others for column in _columns_if_valid(path, other)),
    )


def _columns_if_valid(path: Path, connection: Connection) -> tuple[str, ...]:
    """Return the columns of a topic; none if it has no valid message."""
    try:
        return _columns_of(path, connection)
    except RecordingError:
        return ()


def _columns_of(path: Path, connection: Connection) -> tuple[str, ...]:
    """Return the columns of a topic; those of arrays are numbered."""
    if (type_ := type_of(*connection.type_key)) is not None:
        return tuple(type_.columns)
    if connection.type_name != MULTI_ARRAY:
        return ()
    _, message = next(bag_messages(path, connection), (0, None))
    if message is None:
        raise RecordingError(f"{path}: topic {connection.topic!r} has no messages")
    try:
        return _channel_names(decode_multi_array(message, ros1=connection.ros1).shape[1])
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from error


def readable_topics(path: Path) -> tuple[str, ...]:
    """Return the names of the topics with a readable message type.

    Raises
    ------
    RecordingError
        If the bag cannot be read.
    """
    topics = bag_topics(path).items()
    return tuple(topic for topic, connection in topics if connection.type_name in READABLE)


def read(path: Path, columns: tuple[str, ...], settings: ReaderSettings) -> ReadSignals:
    """Read columns at uniform sampling rates; that of the selected topic is the stated one if they agree.

    Columns of another topic keep its sampling rate, unless it is nearly that of the selected topic. They are
    aligned by the time stamps in the headers or, if one of the topics has none, by the times of receipt.

    Parameters
    ----------
    path : Path
        Bag.
    columns : tuple of str
        Columns to read; see `names`.
    settings : ReaderSettings
        Settings of the reader, with topic and sampling rate.

    Raises
    ------
    RecordingError
        If a column is missing or not measured, a message is damaged, the time stamps contradict the stated
        rate, or another topic covers less than 90 % of the time of the selected one.
    """
    topics = bag_topics(path)
    connection = select_topic(topics, settings.topic, path)
    own_columns = tuple(name for name in columns if not name.startswith("/"))
    own = _read_topic(path, connection, own_columns, settings)
    signals = {name: np.ascontiguousarray(own.samples[:, i]) for i, name in enumerate(own_columns)}
    rates, flags = dict.fromkeys(own_columns, own.fs), list(own.flags)
    for topic, names in _by_topic(path, topics, columns).items():
        other = _read_topic(path, topics[topic], tuple(names.values()), ReaderSettings())
        start_s = other.received_s - own.received_s
        if has_stamps := own.stamped_s is not None and other.stamped_s is not None:
            start_s = other.stamped_s - own.stamped_s
        aligned, rate, coverage = align(other.samples, other.fs, start_s, to_fs=own.fs, n=len(own.samples))
        if coverage == 0:
            problem = f"{topic} and {connection.topic} do not overlap in time"
            raise reader_error(path, problem, "time stamps of one clock")
        check_coverage(coverage, f"{path}?topic={topic}")
        signals |= {name: np.ascontiguousarray(aligned[:, i]) for i, name in enumerate(names)}
        rates |= dict.fromkeys(names, rate)
        flags += [f"{topic}: {flag}" for flag in other.flags]
        if not has_stamps:
            flags.append(f"{topic}: aligned by the times of receipt, since a topic has no time stamps")
    axes = [signals[name] for name in ("ax", "ay", "az") if name in signals]
    rest = float(np.median(np.sqrt(sum(axis**2 for axis in axes)))) if len(axes) == 3 else 0.0
    if abs(rest - 1) <= 0.05 and connection.type_name in TYPES:
        flags.append(
            f"unit: {rest:.3g} m/s^2 at rest, but gravity is {STANDARD_GRAVITY:.3g} m/s^2. Check whether "
            "the driver sends g"
        )
    type_ = type_of(*connection.type_key)
    return ReadSignals(
        signals, own.fs, tuple(flags), unit=type_.unit if type_ is not None else None, rates=rates
    )


class _Uniform(NamedTuple):
    """Samples (n, n_columns) of a topic at fs Hz, with their start in s by headers (if any) and receipt."""

    samples: Samples
    fs: float
    stamped_s: float | None
    received_s: float
    flags: tuple[str, ...]


def _read_topic(
    path: Path, connection: Connection, columns: tuple[str, ...], settings: ReaderSettings
) -> _Uniform:
    """Read columns of one topic at a uniform sampling rate."""
    where = f"{path}?topic={connection.topic}"
    timestamps, received, samples = _read_messages(path, connection, columns)
    # NaN and values above 1e100 are damage; for smaller values, sums of squares remain finite.
    is_valid = (np.abs(samples) < 1e100).all(axis=(1, 2))
    if n_invalid := int(np.count_nonzero(~is_valid)):
        if n_invalid > len(samples) / 2:
            raise reader_error(
                where,
                f"{n_invalid} of {len(samples)} messages contain NaN or values above 1e+100",
                "at most half of them",
            )
        samples, received = samples[is_valid], received[is_valid]
        timestamps = None if timestamps is None else timestamps[is_valid]
    turn = [columns.index(name) for name in TURN_RATE if name in columns]
    if turn and not samples[:, :, turn].any():  # a real gyroscope has noise, so there is none
        raise reader_error(where, "the turn rate is 0 in every message", "a sensor that measures it")
    by_header = timestamps is not None and bool(np.any(timestamps != 0))
    order = np.argsort(received, kind="stable")
    samples, received = samples[order], received[order]
    times = timestamps[order] if timestamps is not None and by_header else received
    uniform, fs, start_s, rate_flags = to_uniform_rate(
        samples, times, received, settings.fs, by_header=by_header, where=where, rate_of=settings.rate_of
    )
    delay_s = float(np.median(received - times)) / 1e9
    # A block of samples is received after its last sample.
    received_s = start_s + delay_s - (samples.shape[1] - 1) / fs
    flags = ["time stamps: none in the headers"] if timestamps is not None and not by_header else []
    flags += [f"not finite: {n_invalid} messages left out"] if n_invalid else []
    return _Uniform(uniform, fs, start_s if by_header else None, received_s, (*flags, *rate_flags))


def _by_topic(
    path: Path, topics: Mapping[str, Connection], columns: tuple[str, ...]
) -> dict[str, dict[str, str]]:
    """Return the columns named "/topic/column": for each topic, the column of the topic by full name."""
    by_topic: dict[str, dict[str, str]] = {}
    for name in columns:
        topic, slash, column = name.rpartition("/")
        if not slash:
            continue
        if topic not in topics or column not in _columns_of(path, topics[topic]):
            raise reader_error(path, f"column {name!r} does not exist", "/topic/column of a bag")
        by_topic.setdefault(topic, {})[name] = column
    return by_topic


def select_topic(topics: Mapping[str, Connection], name: str | None, path: Path) -> Connection:
    """Return the topic with the given name or, without a name, the only topic with an acceleration.

    Parameters
    ----------
    topics : mapping of str to Connection
        Topics of the bag.
    name : str or None
        Name of the topic, with or without the leading slash.
    path : Path
        Bag, for error messages.

    Raises
    ------
    RecordingError
        If there is no such topic, its message type cannot be read, or, without a name, several topics have an
        acceleration.
    """
    if name is not None:
        connection = topics.get(name) or topics.get(f"/{name}")
        if connection is None:
            if is_topic_pattern(name):
                problem = f"topic {name!r} is a pattern with groups, which selects one recording per topic"
                raise reader_error(path, problem, f"the name of one topic of {quote_names([*topics])}")
            closest = difflib.get_close_matches(name, topics, n=1)
            hint = f". Try --topic {closest[0]}" if closest else ""
            raise RecordingError(
                f"{path} has no topic {name!r}. Expected one of {quote_names([*topics])}{hint}"
            )
        if connection.type_name not in READABLE and type_of(*connection.type_key) is None:
            expected = f"{', '.join(READABLE)}, or a type with a header and numbers that the bag defines"
            raise reader_error(path, f"topic {name!r} has type {connection.type_name!r}", expected)
        return connection
    for type_names in (tuple(name for name, type_ in TYPES.items() if type_.acceleration), (MULTI_ARRAY,)):
        candidates = [connection for connection in topics.values() if connection.type_name in type_names]
        if len(candidates) == 1:
            return candidates[0]
        if candidates:
            described = ", ".join(_describe_topic(path, connection) for connection in candidates[:8])
            n_others = f" and {len(candidates) - 8} more" if len(candidates) > 8 else ""
            raise RecordingError(
                f"{path} has several topics with an acceleration: {described}{n_others}. Select one with "
                f"--topic {candidates[0].topic} (`topic` in Python or in a dataset card)"
            )
    available = quote_names([f"{c.topic} ({c.type_name})" for c in topics.values()])
    readable = ", ".join(name for name in READABLE if name == MULTI_ARRAY or TYPES[name].unit)
    raise RecordingError(
        f"{path} has no topic with an acceleration ({readable}), only {available}. To read another "
        "topic, name it and its fields: --topic NAME --column FIELD.x,FIELD.y,FIELD.z --unit UNIT"
    )


def _describe_topic(path: Path, connection: Connection) -> str:
    """Return name, message type, number of messages and rate of a topic as text."""
    received = [receipt_ns for receipt_ns, _ in bag_messages(path, connection)]
    seconds = (max(received, default=0) - min(received, default=0)) / 1e9
    rate = f" at {(len(received) - 1) / seconds:.4g} Hz" if seconds > 0 else ""
    return f"{connection.topic} ({connection.type_name}, {counted(len(received), 'message')}{rate})"


def _channel_names(n: int) -> tuple[str, ...]:
    return tuple(f"c{i + 1}" for i in range(n))


def _read_messages(
    path: Path, connection: Connection, columns: tuple[str, ...]
) -> tuple[Timestamps | None, Timestamps, Samples]:
    """Return time stamps (None if there are no headers), times of receipt, and samples (n, k, n_columns)."""
    where = f"{path}?topic={connection.topic}"
    type_ = type_of(*connection.type_key)
    if type_ is not None:
        require_columns(columns, tuple(type_.columns), path)
    received: list[int] = []
    timestamp_batches: list[Timestamps] = []
    sample_batches: list[Samples] = []
    messages = bag_messages(path, connection)
    while batch := list(islice(messages, 4096)):
        received += [receipt_ns for receipt_ns, _ in batch]
        raws = [raw for _, raw in batch]
        try:
            if type_ is not None:
                timestamps, samples = decode_stamped(type_, raws, columns, ros1=connection.ros1)
                timestamp_batches.append(timestamps)
                sample_batches.append(samples[:, None, :])
            else:
                sample_batches += [decode_multi_array(raw, ros1=connection.ros1)[None] for raw in raws]
        except ValueError as error:
            raise RecordingError(f"{where}: {error}") from error
        check_size(len(received) * sample_batches[-1][0].size, path)
    if len(received) < 2:
        raise reader_error(where, f"has {len(received)} messages", "at least 2")
    if not 0 <= min(received) <= max(received) < 2**63:
        raise reader_error(where, f"the time of receipt {max(received)} ns is too large", "less than 2^63 ns")
    if len({samples.shape[1:] for samples in sample_batches}) > 1:
        raise reader_error(where, "its messages differ in size", "the same number of samples in each")
    samples = np.concatenate(sample_batches)
    if type_ is None:
        channels = _channel_names(samples.shape[2])
        require_columns(columns, channels, path)
        samples = samples[:, :, [channels.index(name) for name in columns]]
    timestamps_ns = np.concatenate(timestamp_batches) if timestamp_batches else None
    return timestamps_ns, np.array(received, np.int64), samples
