"""Read the files of a dataset in the layout of LeRobot 3: description, list of episodes, and frames.

`meta/info.json` describes the features and the sampling rate, `meta/episodes` lists the episodes, and each
file in `data` contains the frames of many episodes.
"""

import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from texclass.loaders.columns import match_convention, normalize_column
from texclass.loaders.places import is_outside
from texclass.loaders.readers import check_size, quote_names, reader_error, wrap_library_errors
from texclass.recording import RecordingError
from texclass.reporting.wording import counted
from texclass.validation import validate

INFO = "meta/info.json"
"""File by which a folder is recognised."""
MAX_INFO = 1 << 24
"""Largest size of `INFO` in bytes; usual ones have some thousand."""
INDEX_FEATURES = ("timestamp", "frame_index", "episode_index", "index", "task_index")
"""Features of every dataset, which are no signals."""
ACCELERATION_NAMES = ("acceleration", "linear acceleration", "accelerometer", "accel", "acc")
"""Last part of the name of a feature that may be an acceleration."""
NUMERIC = re.compile(r"float\d+|u?int\d+")
"""Data types of features that are signals."""
LABEL = re.compile(r"string|bool|u?int\d+")
"""Data types of features that may be labels."""
DATA_PATH = re.compile(r"(?:[^{}]|\{(?:chunk|file)_index(?::0?\d?d)?\})+")
"""Valid values of `data_path`; other format specifications could need any amount of memory."""


class Feature(BaseModel):
    """Feature of a dataset: type and shape of its value in one frame, and names of its components.

    A value is a number, a vector, or a block of samples with shape (n_samples, n_channels).
    """

    dtype: str
    shape: tuple[int, ...]
    names: Any = None

    @property
    def is_signal(self) -> bool:
        """Whether the feature is a number, a vector or a block; a block has more samples than channels."""
        is_block = len(self.shape) == 2 and self.shape[0] > self.shape[1]
        has_size = min(self.shape, default=1) > 0
        return bool(NUMERIC.fullmatch(self.dtype)) and has_size and (len(self.shape) < 2 or is_block)

    @property
    def n_samples(self) -> int:
        """Number of samples per frame."""
        return self.shape[0] if len(self.shape) == 2 else 1

    @property
    def n_channels(self) -> int:
        """Number of components of a sample."""
        return math.prod(self.shape[-1:])

    def components(self) -> tuple[str, ...]:
        """Return the names of the components, or their numbers from 1; () for a single number."""
        if self.n_channels == 1:
            return ()
        names = self.names
        while isinstance(names, Mapping):  # such as {"motors": [...]}
            names = next(iter(names.values()), None)
        is_complete = isinstance(names, list) and len({*map(str, names)}) == self.n_channels == len(names)
        return tuple(map(str, names if is_complete else range(1, self.n_channels + 1)))


class Info(BaseModel):
    """Content of `meta/info.json`, as far as it is needed."""

    fps: float = Field(gt=0, description="a rate in Hz above 0")
    features: dict[str, Feature]
    data_path: str = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"

    @property
    def signals(self) -> dict[str, tuple[str, ...]]:
        """Columns of each feature that is a signal: the feature, or its components as FEATURE.COMPONENT."""
        return {
            name: tuple(f"{name}.{component}" for component in feature.components()) or (name,)
            for name, feature in self.features.items()
            if feature.is_signal and name not in INDEX_FEATURES
        }

    @property
    def labels(self) -> list[str]:
        """Features that may be labels: single texts and whole numbers."""
        return [
            name
            for name, feature in self.features.items()
            if name not in INDEX_FEATURES and math.prod(feature.shape) == 1 and LABEL.fullmatch(feature.dtype)
        ]

    def description(self) -> str:
        """Return the signals with their components, for messages."""
        texts = []
        for name, columns in self.signals.items():
            components = [column.removeprefix(f"{name}.") for column in columns if column != name]
            texts.append(f"{name} ({', '.join(components)})" if components else name)
        return "; ".join(texts) or "none of numbers"

    def feature_of(self, column: str) -> str:
        """Return the feature of a column."""
        return next(name for name, columns in self.signals.items() if column in columns)


class Episode(NamedTuple):
    """Episode of a dataset: data file, number of frames, and texts of its tasks."""

    file: str
    length: int
    tasks: tuple[str, ...]


def read_info(root: Path) -> Info:
    """Read `meta/info.json`.

    Raises
    ------
    RecordingError
        If the file is damaged, or the dataset has another version than 3.
    """
    path = root / INFO
    try:
        with path.open("rb") as file:
            data = file.read(MAX_INFO + 1)
        if len(data) > MAX_INFO:
            raise ValueError(f"it has more than {MAX_INFO} bytes")
        content = json.loads(data)
        version = str(content["codebase_version"])
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        problem = f"not readable as the description of a LeRobot dataset ({error!r})"
        raise reader_error(path, problem, "JSON with codebase_version, fps and features") from error
    if not re.fullmatch(r"v?3\.\d+(\.\d+)?", version):
        hint = ""
        if version.lstrip("v").startswith("2."):
            hint = ": convert it with lerobot.scripts.convert_dataset_v21_to_v30"
        raise reader_error(path, f"codebase_version is {version!r}", f"v3.0{hint}")
    try:
        info = validate(Info, content, path)
    except ValueError as error:
        raise RecordingError(str(error)) from error
    if not DATA_PATH.fullmatch(info.data_path):
        expected = "a path with {chunk_index:03d} and {file_index:03d}"
        raise reader_error(path, f"data_path is {info.data_path!r}", expected)
    return info


def find_acceleration(info: Info, root: Path) -> str:
    """Return the only feature whose name denotes an acceleration.

    Raises
    ------
    RecordingError
        If there is no such feature, or several.
    """
    names = [
        name for name in info.signals if normalize_column(re.split(r"[./]", name)[-1]) in ACCELERATION_NAMES
    ]
    if len(names) == 1:
        return names[0]
    problem = f"several features have the name of an acceleration: {', '.join(names)}"
    if not names:
        problem = f"no feature has the name of an acceleration; the features are {info.description()}"
    expected = f"--column {_suggestion(info)} (`acceleration` under [channels] in a card)"
    raise reader_error(root / INFO, problem, expected)


def _suggestion(info: Info) -> str:
    """Return three axes with conventional names as a value of --column, or a placeholder."""
    for name, columns in info.signals.items():
        components = [column.removeprefix(f"{name}.") for column in columns]
        for stem in ACCELERATION_NAMES:
            if axes := match_convention(tuple(f"{stem} {axis}" for axis in "xyz"), components):
                return ",".join(f"{name}.{axis}" for axis in axes)
    return "FEATURE (or FEATURE.COMPONENT,FEATURE.COMPONENT)"


def resolve_signals(info: Info, wanted: Sequence[str], root: Path) -> tuple[str, ...]:
    """Return the columns for names of columns, and of features, which stand for all of their components.

    Raises
    ------
    RecordingError
        If a name does not exist, or a column is selected twice.
    """
    signals = info.signals
    columns: list[str] = []
    for name in wanted:
        if not (name in signals or any(name in others for others in signals.values())):
            problem = f"no feature or component {name!r} of numbers; the features are {info.description()}"
            raise reader_error(root / INFO, problem, f"--column {_suggestion(info)}")
        columns += signals.get(name, (name,))
    if repeated := [name for name, n in Counter(columns).items() if n > 1]:
        raise reader_error(root / INFO, f"{repeated[0]} is selected twice", "each column once")
    return tuple(columns)


def episode_files(root: Path) -> list[str]:
    """Return the files that list the episodes."""
    return [path.relative_to(root).as_posix() for path in sorted(root.glob("meta/episodes/*/*.parquet"))]


def read_episodes(info: Info, root: Path) -> dict[int, Episode]:
    """Return the episodes by their index.

    Raises
    ------
    RecordingError
        If the list is missing or damaged, or a data file is missing.
    """
    names = ("episode_index", "data/chunk_index", "data/file_index", "length", "tasks")
    episodes: dict[int, Episode] = {}
    for file in episode_files(root):
        table = read_rows(root / file, names)
        for index, *numbers, tasks in zip(*(table[name].to_pylist() for name in names), strict=True):
            if not all(isinstance(number, int) and 0 <= number < 1 << 40 for number in (index, *numbers)):
                problem = f"an episode has the index, chunk, file and length {(index, *numbers)}"
                raise reader_error(root / file, problem, "whole numbers of at least 0")
            if index in episodes:
                raise reader_error(root / file, f"episode {index} occurs twice", "each episode once")
            chunk, number, length = numbers
            name = info.data_path.format(chunk_index=chunk, file_index=number)
            if is_outside(root / name, (root,)):
                raise reader_error(root / INFO, f"data_path leads to {name!r}", "a file in the dataset")
            episodes[index] = Episode(name, length, tuple(map(str, tasks or ())))
    if not episodes:
        raise reader_error(root, "it lists no episode", "meta/episodes/chunk-000/file-000.parquet")
    if missing := {e.file for e in episodes.values() if not (root / e.file).is_file()}:
        raise reader_error(root, f"missing files: {quote_names(sorted(missing))}", "all files of the dataset")
    return episodes


def read_rows(path: Path, columns: Iterable[str], episode: int | None = None) -> Any:
    """Return columns of a Parquet file, and only the rows of an episode if it is given.

    Raises
    ------
    RecordingError
        If pyarrow is not installed, or the file is damaged or lacks a column.
    """
    try:
        import pyarrow.parquet as pq
    except ImportError as error:
        raise RecordingError(
            f"{path}: LeRobot datasets require the extra `parquet` ({error}): pip install 'texclass[parquet]'"
        ) from error
    columns = list(columns)
    with wrap_library_errors(path, "Parquet"):
        names = pq.read_schema(path).names
        if missing := [name for name in columns if name not in names]:
            problem = f"no column {quote_names(missing)}; the columns are {quote_names(names)}"
            raise reader_error(path, problem, "a complete dataset of LeRobot 3")
        check_size(pq.read_metadata(path).num_rows, path)
        rows = None if episode is None else [("episode_index", "=", episode)]
        return pq.read_table(path, columns=columns, filters=rows, partitioning=None, use_threads=False)


def values_of(table: Any, name: str, feature: Feature, where: str) -> NDArray[np.float64]:
    """Return a column of frames as an array of shape (n_frames, n_samples, n_channels).

    Parameters
    ----------
    table : pyarrow.Table
        Frames.
    name : str
        Name of the column.
    feature : Feature
        Type and shape of its values.
    where : str
        Episode named in messages.

    Raises
    ------
    RecordingError
        If values are missing, or have another type or shape than `feature` states.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    array = table[name].combine_chunks()
    if isinstance(array, pa.ChunkedArray):  # of no chunks
        array = pa.concat_arrays(array.chunks) if array.chunks else pa.array([], array.type)
    n_missing, sizes = array.null_count, []
    while isinstance(array, pa.ListArray | pa.LargeListArray | pa.FixedSizeListArray):
        sizes.append(pc.list_value_length(array).unique().drop_null().to_pylist())
        array = array.flatten()
        n_missing += array.null_count
    if n_missing:
        problem = f"{name} has {counted(n_missing, 'missing value')}"
        raise reader_error(where, problem, "a number in every frame")
    values = array.to_numpy(zero_copy_only=False)
    shape = (len(table), feature.n_samples, feature.n_channels)
    is_expected = all(len(lengths) <= 1 for lengths in sizes) and values.size == math.prod(shape)
    if values.dtype.kind not in "iuf" or not is_expected:
        problem = f"{name} has {values.size} values of type {values.dtype} in {counted(len(table), 'frame')}"
        raise reader_error(where, problem, f"numbers in the shape {feature.shape}, as in {INFO}")
    return np.asarray(values, np.float64).reshape(shape)
