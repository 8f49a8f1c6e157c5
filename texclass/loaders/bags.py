"""Bags of ROS 1 and 2 as recordings, without ROS: `linear_acceleration` of an Imu is ax, ay, az, and so on.

Columns of the chosen topic have short names; those of another topic are "/topic/column", interpolated at the
samples of the chosen one.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from texclass.loaders.bag_files import bag_messages, bag_topics
from texclass.loaders.bag_storages import Connection
from texclass.loaders.columns import Columns, ReadOptions, check_size, listed, require
from texclass.loaders.ros_messages import (
    MULTI_ARRAY,
    READABLE,
    TURN_RATE,
    TYPES,
    MessageError,
    column_values,
    decode_multi_array,
    decode_stamped,
    lacking,
    not_measured,
)
from texclass.loaders.stamps import place
from texclass.loaders.uniform import at_uniform_rate
from texclass.recording import STANDARD_GRAVITY, RecordingError, Samples

BATCH = 4096
"""Messages decoded at a time."""
MOST_LARGE = 1e100
"""A larger value is no signal but damage; sums of squares must stay finite."""
Stamps = NDArray[np.int64]


def names(path: Path, options: ReadOptions) -> tuple[str, ...]:
    """Return the names of the columns: those of the chosen topic, then "/topic/column" of the others.

    Raises
    ------
    RecordingError
        If it is no bag, or no topic can be chosen.
    """
    topics = bag_topics(path)
    chosen = choose_topic(topics, options.topic, path)
    own = _own_names(path, chosen)
    others = (c for c in topics.values() if c.topic != chosen.topic and c.type_name in TYPES)
    return (*own, *(f"{c.topic}/{column}" for c in others for column in TYPES[c.type_name].columns))


def readable_topics(path: Path) -> list[str]:
    """Return the topics whose messages can be read.

    Raises
    ------
    RecordingError
        If it is no readable bag.
    """
    return [connection.topic for connection in bag_topics(path).values() if connection.type_name in READABLE]


def unit(path: Path, options: ReadOptions) -> str | None:
    """Return the unit of the acceleration if the type of the messages says it.

    Raises
    ------
    RecordingError
        As `names`.
    """
    chosen = choose_topic(bag_topics(path), options.topic, path)
    return TYPES[chosen.type_name].unit if chosen.type_name in TYPES else None


def read(path: Path, wanted: tuple[str, ...], options: ReadOptions) -> Columns:
    """Read columns at a uniform rate: the one given if the stamps agree, else the one the stamps say.

    Raises
    ------
    RecordingError
        If a column is missing or not measured, a message damaged, or the stamps contradict the given rate.
    """
    topics = bag_topics(path)
    chosen = choose_topic(topics, options.topic, path)
    where = f"{path}?topic={chosen.topic}"
    own = tuple(name for name in wanted if not name.startswith("/"))
    stamps, received, samples, present = _signals(path, chosen, where, own)
    require(own, present, path)
    samples = _finite(samples[:, :, [present.index(name) for name in own]], where)
    _check_turning(samples, own, where)
    by_header = stamps is not None and bool(np.any(stamps != 0))
    order = np.argsort(received, kind="stable")
    samples, received = samples[order], received[order]
    instants = stamps[order] if stamps is not None and by_header else received
    repeats = np.append(False, np.all(samples[1:] == samples[:-1], axis=(1, 2)))
    sampling = place(instants, received, repeats, where)
    uniform, fs, flags = at_uniform_rate(
        samples[sampling.messages], sampling, options.fs, by_header=by_header, where=where
    )
    named = {name: np.ascontiguousarray(uniform[:, i]) for i, name in enumerate(own)}
    t = sampling.start_s + np.arange(len(uniform)) / fs
    named |= {name: _other(path, topics, name, t) for name in wanted if name not in named}
    absent = ("stamps: none in the headers",) if stamps is not None and not by_header else ()
    return Columns(named, fs, (*absent, *sampling.flags, *flags, *_looks_like_g(named, chosen)))


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
            raise RecordingError(f"{path}: topic {wanted!r} is not there; its topics are {listed([*topics])}")
        if found.type_name not in READABLE:
            raise RecordingError(
                f"{path}: topic {wanted!r} carries {found.type_name!r}; the rule is {', '.join(READABLE)}"
            )
        return found
    for kinds in (tuple(name for name, type_ in TYPES.items() if type_.acceleration), (MULTI_ARRAY,)):
        fitting = [connection for connection in topics.values() if connection.type_name in kinds]
        if len(fitting) == 1:
            return fitting[0]
        if fitting:
            raise RecordingError(
                f"{path}: topics {listed([c.topic for c in fitting])} can be the acceleration; the rule is "
                f"to say which (bag:{path.name}?topic=NAME, `topic` in a card)"
            )
    raise RecordingError(
        f"{path}: its topics are {listed([f'{c.topic} ({c.type_name})' for c in topics.values()])}; the rule "
        f"is one with an acceleration ({', '.join(n for n in READABLE if n == MULTI_ARRAY or TYPES[n].unit)})"
    )


def _own_names(path: Path, chosen: Connection) -> tuple[str, ...]:
    if chosen.type_name in TYPES:
        return tuple(TYPES[chosen.type_name].columns)
    for connection, _, raw in bag_messages(path, chosen.topic):
        return _channel_names(_multi_array(raw, connection, path).shape[1])
    raise RecordingError(f"{path}: topic {chosen.topic!r} holds no message")


def _channel_names(n: int) -> tuple[str, ...]:
    return tuple(f"c{i + 1}" for i in range(n))


def _multi_array(raw: bytes, connection: Connection, path: Path) -> Samples:
    try:
        return decode_multi_array(raw, ros1=connection.ros1)
    except MessageError as error:
        raise RecordingError(f"{path}: {error}") from error


def _finite(samples: Samples, where: str) -> Samples:
    """Return samples, none of which is NaN, infinite or beyond `MOST_LARGE`."""
    if not (np.isfinite(samples).all() and np.abs(samples).max(initial=0.0) < MOST_LARGE):
        raise RecordingError(
            f"{where}: holds values that are NaN or beyond {MOST_LARGE:g}; the rule is finite"
        )
    return samples


def _check_turning(samples: Samples, own: tuple[str, ...], where: str) -> None:
    """Check that a turn rate is not 0 throughout: no sensor is so quiet, but one that has no gyroscope."""
    turn = [own.index(name) for name in TURN_RATE if name in own]
    if turn and not samples[:, :, turn].any():
        raise RecordingError(
            f"{where}: the turn rate is 0 in each of its messages; the rule is a sensor that measures it"
        )


def _signals(
    path: Path, chosen: Connection, where: str, wanted: tuple[str, ...]
) -> tuple[Stamps | None, Stamps, Samples, tuple[str, ...]]:
    """Return stamps (None without headers), times of receipt, samples (n, k, columns), and the columns."""
    received: list[int] = []
    parts: list[tuple[Stamps | None, Samples]] = []
    for batch in _batches(path, chosen, where, received):
        parts.append(_decoded(batch, chosen, where, wanted))
        check_size(len(received) * parts[-1][1][0].size, path)
    if len(received) < 2:
        raise RecordingError(f"{where}: holds {len(received)} messages; the rule is at least 2")
    if len({samples.shape[1:] for _, samples in parts}) > 1:
        raise RecordingError(f"{where}: its messages differ in size; the rule is one number of samples")
    if not 0 <= min(received) <= max(received) < 2**63:
        raise RecordingError(f"{where}: a message was received at {max(received)} ns; the rule is 63 bits")
    samples = np.concatenate([samples for _, samples in parts])
    heads = [stamps for stamps, _ in parts if stamps is not None]
    is_stamped = chosen.type_name in TYPES
    present = tuple(TYPES[chosen.type_name].columns) if is_stamped else _channel_names(samples.shape[2])
    return np.concatenate(heads) if heads else None, np.array(received, np.int64), samples, present


def _batches(path: Path, chosen: Connection, where: str, received: list[int]) -> Iterator[list[bytes]]:
    """Yield messages of a topic, many at a time; when each was received is added to a list."""
    batch: list[bytes] = []
    for connection, at, raw in bag_messages(path, chosen.topic):
        if connection != chosen:
            raise RecordingError(f"{where}: carries {connection.type_name} and {chosen.type_name}")
        received.append(at)
        batch.append(raw)
        if len(batch) == BATCH:
            yield batch
            batch = []
    if batch:
        yield batch


def _decoded(
    batch: Sequence[bytes], chosen: Connection, where: str, wanted: tuple[str, ...]
) -> tuple[Stamps | None, Samples]:
    """Return stamps (None without headers) and samples of shape (n, k, columns)."""
    try:
        if chosen.type_name == MULTI_ARRAY:
            return None, _stacked([decode_multi_array(raw, ros1=chosen.ros1) for raw in batch])
        type_ = TYPES[chosen.type_name]
        stamps, numbers = decode_stamped(type_, batch, ros1=chosen.ros1)
    except MessageError as error:
        raise RecordingError(f"{where}: {error}") from error
    if absent := lacking(type_, numbers, set(wanted) & set(type_.columns)):
        raise RecordingError(f"{where}: {not_measured(absent)}")
    columns = [column_values(type_, numbers, column) for column in type_.columns]
    return stamps, np.column_stack(columns)[:, None, :]


def _stacked(blocks: Sequence[Samples]) -> Samples:
    if len(shapes := {block.shape for block in blocks}) > 1:
        raise MessageError(f"blocks of {sorted(shapes)} samples and channels; the rule is one size")
    return np.stack(blocks)


def _other(path: Path, topics: Mapping[str, Connection], name: str, t: Samples) -> Samples:
    """Return a column of another topic at given instants; beyond its ends it keeps its last value."""
    topic, _, column = name.rpartition("/")
    if topic not in topics or column not in getattr(TYPES.get(topics[topic].type_name), "columns", ()):
        raise RecordingError(f"{path}: column {name!r} is not there; the rule is /topic/column of a bag")
    stamps, _, samples, present = _signals(path, topics[topic], f"{path}?topic={topic}", (column,))
    if stamps is None or not stamps.any():
        raise RecordingError(f"{path}: {topic} has no stamps in its headers; the rule is those of one clock")
    order = np.argsort(stamps, kind="stable")
    at = stamps[order] / 1e9
    if at[0] > t[-1] or at[-1] < t[0]:
        raise RecordingError(f"{path}: {topic} and the acceleration share no time; the rule is one clock")
    return np.asarray(np.interp(t, at, samples[order, 0, present.index(column)]))


def _looks_like_g(named: Mapping[str, Samples], chosen: Connection) -> tuple[str, ...]:
    """Say so when an acceleration that should be in m/s^2 rests at 1."""
    axes = [named[name] for name in ("ax", "ay", "az") if name in named]
    if len(axes) < 3 or chosen.type_name not in TYPES or not len(axes[0]):
        return ()
    rest = float(np.median(np.hypot(np.hypot(axes[0], axes[1]), axes[2])))
    if abs(rest - 1) > 0.05:
        return ()
    return (f"unit: rests at {rest:.3g} m/s^2, gravity is {STANDARD_GRAVITY:.3g}: does the driver send g?",)
