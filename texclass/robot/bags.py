"""Bags of ROS 1 and 2 as recordings, without ROS: `linear_acceleration` of an Imu is ax, ay, az, and so on.

Columns of the chosen topic have short names; those of another topic are "/topic/column", interpolated at the
samples of the chosen one.
"""

from collections.abc import Mapping
from itertools import islice
from pathlib import Path

import numpy as np

from texclass.loaders.columns import TURN_RATE
from texclass.loaders.readers import (
    ReaderSettings,
    ReadSignals,
    check_size,
    quote_names,
    reader_error,
    require_columns,
)
from texclass.loaders.timestamps import Timestamps, to_uniform_rate
from texclass.recording import STANDARD_GRAVITY, RecordingError, Samples
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
    """Return the names of the columns: those of the chosen topic, then "/topic/column" of the others.

    Raises
    ------
    RecordingError
        If it is no bag, or no topic can be chosen.
    """
    topics = bag_topics(path)
    chosen = choose_topic(topics, settings.topic, path)
    if (type_ := type_of(*chosen.of_type)) is not None:
        own = tuple(type_.columns)
    else:
        _, first = next(bag_messages(path, chosen), (0, None))
        if first is None:
            raise RecordingError(f"{path}: topic {chosen.topic!r} holds no message")
        try:
            own = _channel_names(decode_multi_array(first, ros1=chosen.ros1).shape[1])
        except ValueError as error:
            raise RecordingError(f"{path}: {error}") from error
    others = (c for c in topics.values() if c.topic != chosen.topic and c.type_name in TYPES)
    return (*own, *(f"{c.topic}/{column}" for c in others for column in TYPES[c.type_name].columns))


def readable_topics(path: Path) -> tuple[str, ...]:
    """Return the topics whose messages can be read.

    Raises
    ------
    RecordingError
        If it is no readable bag.
    """
    return tuple(topic for topic, sent in bag_topics(path).items() if sent.type_name in READABLE)


def read(path: Path, wanted: tuple[str, ...], settings: ReaderSettings) -> ReadSignals:
    """Read columns at a uniform rate: the one given if the stamps agree, else the one the stamps say.

    Raises
    ------
    RecordingError
        If a column is missing or not measured, a message damaged, or the stamps contradict the given rate.
    """
    topics = bag_topics(path)
    chosen = choose_topic(topics, settings.topic, path)
    where = f"{path}?topic={chosen.topic}"
    own = tuple(name for name in wanted if not name.startswith("/"))
    stamps, received, samples = _messages(path, chosen, own)
    # A larger value is no signal but damage; sums of squares must stay finite. Nor is NaN a signal.
    is_good = (np.abs(samples) < 1e100).all(axis=(1, 2))
    if n_bad := int(np.count_nonzero(~is_good)):
        if n_bad > len(samples) / 2:
            raise reader_error(
                where, f"{n_bad} of {len(samples)} messages hold NaN or values beyond 1e+100", "half"
            )
        samples, received = samples[is_good], received[is_good]
        stamps = None if stamps is None else stamps[is_good]
    turn = [own.index(name) for name in TURN_RATE if name in own]
    if turn and not samples[:, :, turn].any():  # no gyroscope is so quiet: the sensor has none
        raise reader_error(where, "the turn rate is 0 in each of its messages", "a sensor that measures it")
    by_header = stamps is not None and bool(np.any(stamps != 0))
    order = np.argsort(received, kind="stable")
    samples, received = samples[order], received[order]
    instants = stamps[order] if stamps is not None and by_header else received
    uniform, fs, start_s, flags = to_uniform_rate(
        samples, instants, received, settings.fs, by_header=by_header, where=where, rate_of=settings.rate_of
    )
    named = {name: np.ascontiguousarray(uniform[:, i]) for i, name in enumerate(own)}
    t = start_s + np.arange(len(uniform)) / fs
    named |= {name: _other(path, topics, name, t) for name in wanted if name not in named}
    said = ["stamps: none in the headers"] if stamps is not None and not by_header else []
    said += [f"not finite: {n_bad} messages left out as lost"] if n_bad else []
    said += flags
    axes = [named[name] for name in ("ax", "ay", "az") if name in named]
    rest = float(np.median(np.sqrt(sum(axis**2 for axis in axes)))) if len(axes) == 3 else 0.0
    if abs(rest - 1) <= 0.05 and chosen.type_name in TYPES:
        told = f"unit: rests at {rest:.3g} m/s^2, gravity is {STANDARD_GRAVITY:.3g}"
        said.append(f"{told}: does the driver send g?")
    type_ = type_of(*chosen.of_type)
    return ReadSignals(named, fs, tuple(said), unit=type_.unit if type_ is not None else None)


def choose_topic(topics: Mapping[str, Connection], wanted: str | None, path: Path) -> Connection:
    """Return the topic to read: the wanted one, else the only one that carries an acceleration.

    Raises
    ------
    RecordingError
        If there is none, or a choice to be made.
    """
    if wanted is not None:
        found = topics.get(wanted) or topics.get(f"/{wanted}")
        if found is None:
            raise RecordingError(
                f"{path}: topic {wanted!r} is not there; its topics are {quote_names([*topics])}"
            )
        if found.type_name not in READABLE and type_of(*found.of_type) is None:
            rule = f"{', '.join(READABLE)}, or a type with a header and numbers that the bag defines"
            raise reader_error(path, f"topic {wanted!r} carries {found.type_name!r}", rule)
        return found
    for kinds in (tuple(name for name, type_ in TYPES.items() if type_.acceleration), (MULTI_ARRAY,)):
        fitting = [connection for connection in topics.values() if connection.type_name in kinds]
        if len(fitting) == 1:
            return fitting[0]
        if fitting:
            raise RecordingError(
                f"{path}: topics {quote_names([c.topic for c in fitting])} can be the acceleration. Expected "
                f"to say which (bag:{path.name}?topic=NAME, `topic` in a card)"
            )
    there = quote_names([f"{c.topic} ({c.type_name})" for c in topics.values()])
    known = ", ".join(name for name in READABLE if name == MULTI_ARRAY or TYPES[name].unit)
    raise RecordingError(
        f"{path}: its topics are {there}. Expected one with an acceleration ({known}), or to name another "
        f"and its fields (bag:{path.name}?topic=NAME, --column FIELD.x,FIELD.y,FIELD.z, --unit)"
    )


def _channel_names(n: int) -> tuple[str, ...]:
    return tuple(f"c{i + 1}" for i in range(n))


def _messages(
    path: Path, chosen: Connection, wanted: tuple[str, ...]
) -> tuple[Timestamps | None, Timestamps, Samples]:
    """Return stamps (None without headers), times of receipt and samples (n, k, columns) as wanted."""
    where = f"{path}?topic={chosen.topic}"
    type_ = type_of(*chosen.of_type)
    if type_ is not None:
        require_columns(wanted, tuple(type_.columns), path)
    received: list[int] = []
    heads: list[Timestamps] = []
    parts: list[Samples] = []
    messages = bag_messages(path, chosen)
    while batch := list(islice(messages, 4096)):
        received += [at for at, _ in batch]
        raws = [raw for _, raw in batch]
        try:
            if type_ is not None:
                stamps, samples = decode_stamped(type_, raws, wanted, ros1=chosen.ros1)
                heads.append(stamps)
                parts.append(samples[:, None, :])
            else:
                parts += [decode_multi_array(raw, ros1=chosen.ros1)[None] for raw in raws]
        except ValueError as error:
            raise RecordingError(f"{where}: {error}") from error
        check_size(len(received) * parts[-1][0].size, path)
    if len(received) < 2:
        raise reader_error(where, f"holds {len(received)} messages", "at least 2")
    if not 0 <= min(received) <= max(received) < 2**63:
        raise reader_error(where, f"a message was received at {max(received)} ns", "63 bits")
    if len({samples.shape[1:] for samples in parts}) > 1:
        raise reader_error(where, "its messages differ in size", "one number of samples")
    samples = np.concatenate(parts)
    if type_ is None:
        present = _channel_names(samples.shape[2])
        require_columns(wanted, present, path)
        samples = samples[:, :, [present.index(name) for name in wanted]]
    return np.concatenate(heads) if heads else None, np.array(received, np.int64), samples


def _other(path: Path, topics: Mapping[str, Connection], name: str, t: Samples) -> Samples:
    """Return a column of another topic at given instants; beyond its ends it keeps its last value."""
    topic, _, column = name.rpartition("/")
    if topic not in topics or column not in getattr(type_of(*topics[topic].of_type), "columns", ()):
        raise reader_error(path, f"column {name!r} is not there", "/topic/column of a bag")
    stamps, _, samples = _messages(path, topics[topic], (column,))
    if stamps is None or not stamps.any():
        raise reader_error(path, f"{topic} has no stamps in its headers", "those of one clock")
    order = np.argsort(stamps, kind="stable")
    at = stamps[order] / 1e9
    if at[0] > t[-1] or at[-1] < t[0]:
        raise reader_error(path, f"{topic} and the acceleration share no time", "one clock")
    return np.asarray(np.interp(t, at, samples[order, 0, 0]))
