"""Datasets in the layout of LeRobot 3: one recording per episode."""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from texclass.loaders.cards import EpisodeReading
from texclass.loaders.columns import ACCELERATION, acceleration_unit
from texclass.loaders.data_files import normalize_name
from texclass.loaders.dataset import GROUPS, Dataset, Entry
from texclass.loaders.filesets import condition_recording
from texclass.loaders.labels import Labels, find_label_columns
from texclass.loaders.lerobot_files import (
    INFO,
    Episode,
    Feature,
    Info,
    episode_files,
    find_acceleration,
    read_episodes,
    read_info,
    read_rows,
    resolve_signals,
    values_of,
)
from texclass.loaders.places import digest_files
from texclass.loaders.plausibility import build_recording, resolve_rate, resolve_unit, similar_label_notes
from texclass.loaders.readers import ReaderSettings, ReadSignals, as_column_names, quote_names, reader_error
from texclass.loaders.time_columns import resample_by_time_column
from texclass.loaders.timestamps import TIMESTAMPS
from texclass.recording import Recording, Samples
from texclass.reporting.wording import counted
from texclass.validation import validate

TASK = "task"
"""Name that selects the text of the task as the label."""
EPISODE = "episode_"
"""Prefix of the id of a recording."""


def is_lerobot(folder: Path) -> bool:
    """Return whether a folder is a dataset of LeRobot."""
    return (folder / INFO).is_file()


def open_folder(
    root: Path,
    settings: ReaderSettings,
    labels: str | Path | None,
    *,
    is_labelled: bool = True,
    keys: Mapping[str, Any] | None = None,
    **attributes: Any,
) -> Dataset:
    """Open a folder in the layout of LeRobot.

    Parameters
    ----------
    root : Path
        Folder of the dataset.
    settings : ReaderSettings
        Options for reading; only fs, unit, column and resample apply.
    labels : str or Path or None
        "task", the name of a feature, or a table (CSV) with the columns `file` and `surface`.
    is_labelled : bool
        Whether the surfaces are needed (default True).
    keys : mapping of str to Any, optional
        Further keys of `EpisodeReading`.
    **attributes
        Attributes of the `Dataset`.

    Raises
    ------
    RecordingError
        If the dataset is damaged or of another version, an option is missing or invalid, or the surface of an
        episode is not unique.
    """
    if options := sorted(settings.card_keys):
        problem = f"{', '.join(options)} cannot be used with a LeRobot dataset"
        raise reader_error(root, problem, "only --fs, --unit, --column, --labels and --resample")
    info, notes = read_info(root), list[str]()
    columns = as_column_names(settings.column)
    if not columns:
        columns = (find_acceleration(info, root),)
        notes.append(f"acceleration: {columns[0]}, the only feature with the name of an acceleration")
    resolved = resolve_signals(info, columns, root)
    fs = info.fps * info.features[info.feature_of(resolved[0])].n_samples
    channels = (keys or {}).get("channels", {})
    keys = dict(keys or {}) | {
        "fs_hz": resolve_rate(fs, settings.fs, root / INFO),
        "unit": resolve_unit(acceleration_unit(resolved, root / INFO), settings.unit, root / INFO),
        "channels": {**channels, ACCELERATION: columns},
        "resample_hz": settings.resample,
    }
    if labels is not None and Path(labels).suffix.lower() == ".csv":
        table = Path(labels).expanduser().absolute()
        file = Path(os.path.relpath(table, root)).as_posix()  # both can be moved together
        keys["labels"] = find_label_columns(table, file).model_dump()
    elif labels is not None:
        keys["surface"] = str(labels)
    reading = validate(EpisodeReading, keys, root)
    return open_episodes(reading, root, is_labelled=is_labelled, notes=tuple(notes), **attributes)


def open_episodes(
    reading: EpisodeReading,
    root: Path,
    *,
    is_labelled: bool = True,
    notes: tuple[str, ...] = (),
    **attributes: Any,
) -> Dataset:
    """Open a dataset of LeRobot; the frames of an episode are read when its recording is used.

    Parameters
    ----------
    reading : EpisodeReading
        Columns of the signals, and features of the labels.
    root : Path
        Folder of the dataset.
    is_labelled : bool
        Whether the surfaces are needed (default True).
    notes, **attributes
        Attributes of the `Dataset`.

    Raises
    ------
    RecordingError
        If the dataset is damaged, a column or feature does not exist, or the surface of an episode is not
        unique.
    """
    info = read_info(root)
    roles = _roles(reading, info, root)
    episodes = read_episodes(info, root)
    labels = _labels(reading, info, root, episodes) if is_labelled else {}
    repetitions: Counter[str] = Counter()
    renamed = {normalize_name(name): surface for name, surface in reading.surfaces.items()}
    entries = []
    for index, episode in sorted(episodes.items()):
        groups = labels.get(index, {"surface": ""})
        surface = normalize_name(groups["surface"])
        surface = renamed.get(surface, surface)
        repetitions[surface] += 1
        repetition = groups.get("repetition", str(repetitions[surface]))
        if not repetition.isdecimal():
            problem = f"repetition of episode {index} is {repetition!r}"
            raise reader_error(root, problem, "a whole number")
        entries.append(
            Entry(
                f"{EPISODE}{index:06d}",
                surface,
                groups.get("operator"),
                groups.get("session"),
                repetition=int(repetition),
                paths=(episode.file,),
                labels=tuple((name, text) for name, text in groups.items() if name not in GROUPS),
            )
        )
    if is_labelled:
        notes = (*notes, *similar_label_notes(entry.surface for entry in entries))
    table = [] if reading.labels is None else [reading.labels.file]
    files = [INFO, *episode_files(root), *sorted({episode.file for episode in episodes.values()}), *table]
    return Dataset(
        entries=tuple(entries),
        load=partial(load_episode, reading, root, info, roles, episodes),
        input_hash=digest_files(root, files, reading.hash_input),
        notes=notes,
        **attributes,
    )


def _roles(reading: EpisodeReading, info: Info, root: Path) -> dict[str, tuple[str, ...]]:
    """Return the columns of each signal, which all have the same number of samples per frame."""
    channels = {ACCELERATION: (), **reading.channels}
    channels[ACCELERATION] = channels[ACCELERATION] or (find_acceleration(info, root),)
    roles = {name: resolve_signals(info, columns, root) for name, columns in channels.items()}
    features = {info.feature_of(column) for columns in roles.values() for column in columns}
    if len({info.features[name].n_samples for name in features}) > 1:
        shapes = ", ".join(f"{name} {info.features[name].shape}" for name in sorted(features))
        problem = f"the features have the shapes {shapes}"
        raise reader_error(root / INFO, problem, "equal numbers of samples per frame")
    return roles


def load_episode(
    reading: EpisodeReading,
    root: Path,
    info: Info,
    roles: Mapping[str, Sequence[str]],
    episodes: Mapping[int, Episode],
    entry: Entry,
) -> Recording:
    """Load the recording of an episode; only its rows and the columns of its signals are read.

    Parameters
    ----------
    reading : EpisodeReading
        Unit, scale and phases.
    root : Path
        Folder of the dataset.
    info : Info
        Description of the dataset.
    roles : mapping of str to sequence of str
        Columns of each signal.
    episodes : mapping of int to Episode
        Episodes by their index.
    entry : Entry
        Recording.

    Raises
    ------
    RecordingError
        If the episode is damaged, or its time stamps contradict the sampling rate of the dataset.
    """
    index = int(entry.recording_id.removeprefix(EPISODE))
    where = f"{root / episodes[index].file} (episode {index})"
    features = {column: info.feature_of(column) for columns in roles.values() for column in columns}
    frames = read_rows(
        root / episodes[index].file, [*dict.fromkeys(features.values()), "frame_index", "timestamp"], index
    )
    number = Feature(dtype="int64", shape=(1,))
    numbers = values_of(frames, "frame_index", number, where)[:, 0, 0]
    times = values_of(frames, "timestamp", number, where)[:, 0, 0]
    if len(frames) != episodes[index].length or (numbers != np.arange(len(frames))).any():
        problem = f"it has {counted(len(frames), 'frame')} with numbers up to {numbers.max(initial=-1):.0f}"
        expected = f"{episodes[index].length} frames, numbered from 0, as in meta/episodes"
        raise reader_error(where, problem, expected)
    arrays = {name: values_of(frames, name, info.features[name], where) for name in set(features.values())}
    samples = np.column_stack(
        [arrays[name][:, :, info.signals[name].index(column)].ravel() for column, name in features.items()]
    )
    n_per_frame = info.features[next(iter(arrays))].n_samples
    samples, fs, flags = _at_uniform_rate(samples, times, info.fps, n_per_frame, where)
    by_column = dict(zip(features, samples.T, strict=True))
    signals = {
        name: np.column_stack([by_column[c] for c in columns]) if len(columns) > 1 else by_column[columns[0]]
        for name, columns in roles.items()
    }
    channels = tuple(column.rpartition(".")[2] for column in roles[ACCELERATION])
    recording = build_recording(
        ReadSignals(signals, fs, flags, channels),
        fs=reading.fs_hz,
        unit=reading.unit,
        source=where,
        scale=reading.scale,
        resample=reading.resample_hz,
        recording_id=entry.recording_id,
    )
    recording = condition_recording(
        recording,
        reading.scale,
        reading.phases,
        remove_resting_level=reading.remove_resting_level,
        turn_rate_scale=reading.turn_rate_scale,
    )
    return recording.with_(**{name: getattr(entry, name) or None for name in GROUPS})


def _at_uniform_rate(
    samples: Samples, times: Samples, fps: float, n_per_frame: int, where: str
) -> tuple[Samples, float, tuple[str, ...]]:
    """Return samples at a uniform rate, given the time stamps of the frames in seconds.

    LeRobot stores time stamps as float32. Those that are uniform within this resolution are not needed.
    """
    deviation = np.abs(times - times[:1] - np.arange(len(times)) / fps).max(initial=0.0)
    resolution = float(np.spacing(np.float32(np.abs(times).max(initial=1.0))))
    if deviation <= max(TIMESTAMPS.even_jitter / fps, 2 * resolution):
        return samples, n_per_frame * fps, ()
    if n_per_frame > 1:
        problem = f"its time stamps deviate by up to {deviation:.3g} s from {fps:g} frames per second"
        raise reader_error(where, problem, "uniform time stamps, because a frame has several samples")
    uniform, fs, _, flags = resample_by_time_column(
        samples, times, "timestamp", fps, where=where, unit="s", rate_of=INFO
    )
    return uniform, fs, flags


def _labels(
    reading: EpisodeReading, info: Info, root: Path, episodes: Mapping[int, Episode]
) -> dict[int, dict[str, str]]:
    """Return the labels of each episode, from its task, from features, or from a table."""
    labels: dict[int, dict[str, str]] = {index: {} for index in episodes}
    if reading.labels is not None:
        table = Labels.read((root / reading.labels.file).resolve(), reading.labels)
        for index in episodes:
            name = f"{EPISODE}{index:06d}"
            labels[index] |= table.groups_of(name, (name,), root.name)
    for group in ("surface", "operator", "session"):
        if (source := getattr(reading, group)) is None:
            continue
        texts = {index: list(episode.tasks) for index, episode in episodes.items()}
        if source != TASK:
            texts = _values_by_episode(source, info, root, episodes)
        for index in episodes:
            values = texts.get(index, [])
            if len(values) != 1 or not values[0]:
                problem = f"episode {index} has {counted(len(values), 'value')} of {source!r}: "
                raise reader_error(root, problem + quote_names(values), f"one {group} per episode")
            labels[index][group] = values[0]
    if unlabelled := [index for index, groups in labels.items() if not groups.get("surface")]:
        features = ", ".join(info.labels) or "no feature has texts or whole numbers"
        raise reader_error(
            root,
            f"the surface of episode {unlabelled[0]} is unknown",
            f"--labels {TASK} (the text of the task), --labels FEATURE ({features}), or --labels LABELS.csv "
            f"with the columns `file` ({EPISODE}000000) and `surface`; in a card, the key `surface` or the "
            "table [labels]",
        )
    return labels


def _values_by_episode(
    name: str, info: Info, root: Path, episodes: Mapping[int, Episode]
) -> dict[int, list[str]]:
    """Return the different values of a feature in each episode."""
    if name not in info.labels:
        problem = f"{name!r} is not a feature with one text or whole number per frame"
        raise reader_error(root / INFO, problem, f"one of {', '.join((TASK, *info.labels))}")
    texts: dict[int, list[str]] = {}
    for file in sorted({episode.file for episode in episodes.values()}):
        table = read_rows(root / file, ["episode_index", name])
        values = table[name].to_pylist()
        values = [value[0] if isinstance(value, list) and value else value for value in values]
        labels = ["" if value is None else str(value) for value in values]
        for index, label in dict.fromkeys(zip(table["episode_index"].to_pylist(), labels, strict=True)):
            texts.setdefault(index, []).append(label)
    return texts
