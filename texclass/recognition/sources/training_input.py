"""Input of a trained model: the columns of a stream, and files to be read like the training files."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, Unpack

import numpy as np

from texclass import shipped
from texclass.features.phase_view import TURN_CHANNELS
from texclass.loaders import files, find_recording, lerobot, open_dataset
from texclass.loaders.cards import DeclaredPhases, EpisodeReading, FileReading, Reading
from texclass.loaders.columns import TURN_RATE, choose_acceleration
from texclass.loaders.data_files import normalize_name
from texclass.loaders.dataset import Dataset
from texclass.loaders.exports import find_export
from texclass.loaders.filesets import condition_recording
from texclass.loaders.open import flat_files
from texclass.loaders.phases_files import find_phases_file, split_part, use_marked_phases
from texclass.loaders.plausibility import build_recording, resolve_unit
from texclass.loaders.readers import (
    BAG_METADATA,
    FORMATS,
    LoadingOptions,
    ReaderSettings,
    as_column_names,
    is_bag,
    is_topic_pattern,
)
from texclass.loaders.source_files import recording_name, source_files
from texclass.loaders.timestamps import TIMESTAMPS
from texclass.recording import Recording, RecordingError, Samples
from texclass.validation import StrictModel

AuxiliarySignal = Literal["turn_rate", "friction"]


class Member(NamedTuple):
    """Recording of a dataset card or folder that is not yet loaded, with its surface if known."""

    name: str
    load: Callable[[], Recording]
    surface: str | None = None


@dataclass(frozen=True)
class InputColumns:
    """Columns of a stream, in this order: axes of the acceleration, turn rate, friction.

    Attributes
    ----------
    axes
        Names of the axes of the acceleration (default: any number of axes).
    auxiliary
        Further signals of `Recording`: "turn_rate" (3 columns), then "friction" (1 column).
    friction_features
        Names of the features that need the friction signal.

    Examples
    --------
    >>> columns = InputColumns(("ax", "ay", "az"), ("friction",), ("waviness",))
    >>> columns.names
    ('ax', 'ay', 'az', 'friction')
    >>> columns.n_axes(n_columns=4)
    3
    """

    axes: tuple[str, ...] = ()
    auxiliary: tuple[AuxiliarySignal, ...] = ()
    friction_features: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns; "acceleration" represents any number of axes."""
        turn = TURN_CHANNELS if "turn_rate" in self.auxiliary else ()
        friction = ("friction",) if "friction" in self.auxiliary else ()
        return (*(self.axes or ("acceleration",)), *turn, *friction)

    def extract(self, recording: Recording) -> Samples:
        """Return the columns of a recording, shape (n_samples, n_columns).

        Raises
        ------
        RecordingError
            If the recording lacks a signal.
        """
        name, n = recording.source or recording.recording_id, recording.n_samples
        signals = [recording.acceleration.reshape(n, -1)]
        for signal_name in self.auxiliary:
            if (signal := getattr(recording, signal_name)) is None:
                raise RecordingError(f"{name}: {self.missing_signal(signal_name)}")
            signals.append(signal.reshape(n, -1))
        return np.column_stack(signals)

    def missing_signal(self, name: AuxiliarySignal) -> str:
        """Return the error message for a source that lacks a signal, with a remedy."""
        expected = f"Expected {', '.join(self.names)}, as in training"
        if name == "friction":
            features = ", ".join(self.friction_features)
            return (
                f"no friction signal, but the model needs it ({features}). {expected}, or train a model with "
                "'texclass train --row ROW', where ROW has features of the acceleration only"
            )
        return f"no turn rate. {expected}, or train a model on recordings without turn rate"

    def n_axes(self, n_columns: int) -> int:
        """Return the number of axes of the acceleration in a stream with `n_columns` columns.

        Raises
        ------
        ValueError
            If the number of columns differs from that in training.
        """
        n_auxiliary = len(self.names) - (len(self.axes) or 1)
        if n_columns <= n_auxiliary or (self.axes and n_columns != len(self.names)):
            more = "" if self.axes else " or more"
            raise ValueError(
                f"the stream must have {len(self.names)}{more} columns as in training "
                f"({', '.join(self.names)}), got {n_columns}"
            )
        return n_columns - n_auxiliary


ACCELERATION_ONLY: InputColumns = InputColumns()


class TrainingFiles(StrictModel):
    """Facts about the training files that are needed to read another file of the same kind.

    Attributes
    ----------
    fs
        Sampling rate in Hz of files that do not state it.
    unit
        Unit of the acceleration in the files.
    scale, phases, remove_resting_level, delimiter, skip_rows, comment, drop_incomplete
        Settings of the dataset card. The scale is not applied to files in another unit.
    turn_rate_scale
        Setting of the dataset card. It is not applied to turn rates in ROS messages, which are in rad/s.
    acceleration, auxiliary
        Names of the columns of the acceleration, and of each auxiliary signal.
    axes
        Names of the channels of the recordings.
    topic
        Topic that is read from bags with several topics.
    time_column, time_unit
        Column of the time stamps, and their unit.
    resample
        Whether files with another sampling rate are resampled to `fs`.
    auxiliary_fs
        Sampling rates in Hz of auxiliary signals with another rate, if the files do not state them.
    """

    fs: float
    unit: str
    scale: float = 1.0
    phases: DeclaredPhases = "detect"
    remove_resting_level: bool = False
    delimiter: str | None = None
    skip_rows: int | None = None
    comment: str | None = None
    drop_incomplete: bool = False
    turn_rate_scale: float = 1.0
    acceleration: tuple[str, ...] = ()
    auxiliary: Mapping[str, tuple[str, ...]] = {}
    axes: tuple[str, ...] = ()
    topic: str | None = None
    time_column: str | None = None
    time_unit: str | None = None
    resample: bool = False
    auxiliary_fs: Mapping[str, float] = {}

    @classmethod
    def from_dataset(cls, dataset: Dataset, recording: Recording) -> "TrainingFiles":
        """Return the facts about the files of a dataset, given one of its recordings."""
        loader: Any = dataset.load
        while hasattr(loader, "load"):  # windows wrap the loader of their recordings
            loader = loader.load
        card = loader.args[0] if isinstance(loader, partial) else None  # the first argument of `load_files`
        if not isinstance(card, Reading):
            return cls(fs=recording.fs, unit=recording.unit, axes=recording.channels)
        facts = {name: value for name, value in card if name in cls.model_fields}
        if isinstance(card, FileReading | EpisodeReading):
            channels = dict(card.channels)
            facts["acceleration"] = channels.pop("acceleration", ())
            facts |= {"auxiliary": channels, "resample": card.resample_hz is not None}
        if isinstance(card, FileReading):
            facts["auxiliary_fs"] = card.auxiliary_fs_hz
            if is_topic_pattern(card.topic):
                facts["topic"] = None
        return cls(**facts, fs=recording.fs, axes=recording.channels)

    def find(self, name: str | Path, **reading: Unpack[LoadingOptions]) -> Recording:
        """Load a file or bag like the training files, or "DATASET:RECORDING" as its dataset card defines.

        Parameters
        ----------
        name : str or Path
            File, bag or "DATASET:RECORDING".
        **reading : optional
            Options of `find_recording` (default of the unit: that of the training files).

        Raises
        ------
        RecordingError, FileNotFoundError, CardError
            If `load` or `find_recording` raises it.
        """
        whole_name, _ = split_part(name)
        path = Path(whole_name).expanduser()
        is_file = path.suffix.lower() in FORMATS and (path.exists() or ":" not in str(name))
        is_file |= find_export(path) is not None
        if is_file or _is_bag(whole_name):
            options: dict[str, Any] = dict(reading)
            loading = {key: options.pop(key, None) for key in ("fs", "unit", "resample", "topic")}
            options["acceleration"] = as_column_names(options.pop("column", None))
            training_files = self.model_copy(update={key: value for key, value in options.items() if value})
            return training_files.load(name, **loading)
        folder, _, recording_id = str(name).rpartition(":")
        if folder and lerobot.is_lerobot(Path(folder).expanduser()):
            dataset = self._open_lerobot(Path(folder).expanduser(), None, **reading)
            return dataset.find(recording_id)
        return find_recording(name, **reading)

    def references(
        self,
        names: Iterable[str | Path],
        labels: str | Path | None = None,
        **reading: Unpack[LoadingOptions],
    ) -> list[Recording]:
        """Load recordings by name, with their surfaces.

        Parameters
        ----------
        names : iterable of str or Path
            Each name is "SURFACE=FILE", a file of an unknown surface, "DATASET:RECORDING", a dataset card, or
            a folder with one subfolder per surface.
        labels : str or Path, optional
            Table with the surfaces of a folder; see `open_dataset`.
        **reading : optional
            Options of `find`.

        Raises
        ------
        RecordingError, FileNotFoundError, CardError
            If `find` or `members` raises it.
        """
        recordings: list[Recording] = []
        for name in names:
            surface, equals, file = str(name).partition("=")
            if equals and not Path(name).expanduser().exists() and not files.is_bag_name(str(name)):
                recordings.append(self.find(file, **reading).with_(surface=normalize_name(surface)))
            else:
                for member in self.members(name, labels, **reading):
                    recording = member.load()
                    if member.surface is not None:
                        recording = recording.with_(surface=member.surface)
                    recordings.append(recording)
        return recordings

    def members(
        self, name: str | Path, labels: str | Path | None = None, **reading: Unpack[LoadingOptions]
    ) -> list[Member]:
        """Return the recordings of a dataset card or folder, or the single recording of a file.

        Parameters
        ----------
        name : str or Path
            Dataset card; folder with one subfolder per surface, or with recordings of unknown surfaces; or a
            name that `find` accepts.
        labels : str or Path, optional
            Table with the surfaces of a folder; see `open_dataset`.
        **reading : optional
            Options of `find`.

        Raises
        ------
        RecordingError, FileNotFoundError, CardError
            If `open_dataset` raises it; a RecordingError also if `labels` is given and `name` is not a
            folder.
        """
        path = Path(name).expanduser()
        if lerobot.is_lerobot(path):
            dataset = self._open_lerobot(path, labels, **reading)
            return [
                Member(f"{name}:{entry.recording_id}", partial(dataset.load, entry), entry.surface or None)
                for entry in dataset.entries
            ]
        if path.is_dir() and not (path / BAG_METADATA).is_file() and not find_export(path):
            if labels is None and (flat := flat_files(path)):
                return [member for file in flat for member in self._file_members(file, reading)]
            options: dict[str, Any] = {"fs": self.fs, "unit": self.unit}
            options |= {key: value for key, value in reading.items() if value is not None}
            entries = open_dataset(path, labels=labels, **options).entries
            paths = [path / entry.paths[0] for entry in entries]
            # An export of a recording app is a folder: its files are one recording.
            export_folders = {folder for folder in {file.parent for file in paths} if find_export(folder)}
            paths = [file.parent if file.parent in export_folders else file for file in paths]
            names = [
                f"{file}#{entry.part}" if entry.part else str(file)
                for file, entry in zip(paths, entries, strict=True)
            ]
            return [
                Member(
                    f"{name}?topic={entry.topic}" if entry.topic else name,
                    partial(self.find, name, **reading | ({"topic": entry.topic} if entry.topic else {})),
                    entry.surface,
                )
                for name, entry in zip(names, entries, strict=True)
            ]
        if labels is not None:
            raise RecordingError(
                f"{name}: labels ({labels}) require a folder of recordings. Pass a folder, or omit the labels"
            )
        if path.suffix == ".toml" or str(name) in shipped.names("datasets"):
            dataset = open_dataset(name, **reading)
            return [
                Member(f"{name}:{entry.recording_id}", partial(dataset.load, entry), entry.surface)
                for entry in dataset.entries
            ]
        return self._file_members(name, reading)

    def _file_members(self, name: str | Path, reading: LoadingOptions) -> list[Member]:
        """Return the recording of a file, or one recording for each surface that is marked in it."""
        path = Path(name).expanduser()
        marked = find_phases_file(path) if path.exists() else None
        if marked is None or not marked.surfaces:
            return [Member(str(name), partial(self.find, name, **reading))]
        return [
            Member(f"{name}#{number}", partial(self.find, f"{name}#{number}", **reading), one.surface)
            for number, one in enumerate(marked.surfaces, start=1)
        ]

    def _open_lerobot(
        self, root: Path, labels: str | Path | None, **reading: Unpack[LoadingOptions]
    ) -> Dataset:
        """Open a dataset of LeRobot with the columns and the conditioning of the training files."""
        options: dict[str, Any] = {name: value for name, value in reading.items() if value is not None}
        trained = {"unit": self.unit, "column": self.acceleration or None}
        resample = {"resample": self.fs if self.resample else None}
        settings = ReaderSettings(**{**resample, **trained, **options})
        settings.check(root)
        names = ("scale", "turn_rate_scale", "phases", "remove_resting_level")
        keys = {name: getattr(self, name) for name in names} | {"channels": dict(self.auxiliary)}
        return lerobot.open_folder(
            root.absolute(), settings, labels, is_labelled=labels is not None, keys=keys, name=root.name
        )

    def load(
        self,
        name: str | Path,
        *,
        fs: float | None = None,
        unit: str | None = None,
        resample: float | None = None,
        topic: str | None = None,
    ) -> Recording:
        """Load a file in the same way as the training files.

        The sampling rate and unit are those that the file states, otherwise the arguments, otherwise those of
        the training files.

        If a bag lacks the columns of the training files, the columns of its messages are used instead:
        acceleration and turn rate, or the channels of an array, in the order of the training files.

        Parameters
        ----------
        name : str or Path
            File or bag.
        fs : float, optional
            Sampling rate in Hz, if the file does not state it.
        unit : str, optional
            Unit of the acceleration (default: that of the training files).
        resample : float, optional
            New sampling rate in Hz.
        topic : str, optional
            Topic of a bag (default: that of the training files if the bag has it, otherwise the only one with
            an acceleration).

        Raises
        ------
        RecordingError
            If the file is invalid, or contradicts `fs` or `unit`.
        """
        name, part = split_part(name)
        path = Path(name).expanduser()
        if _is_bag(name):
            path, topic = files.locate_recording(name, topic)
        if not topic and self.topic is not None and is_bag(path) and self.topic in files.topics(path):
            topic = self.topic
        settings = ReaderSettings(
            fs=fs,
            unit=unit or self.unit,
            resample=resample,
            topic=topic,
            delimiter=self.delimiter,
            time_column=self.time_column,
            time_unit=self.time_unit,
            skip_rows=self.skip_rows,
            comment=self.comment,
            drop_incomplete=self.drop_incomplete,
            auxiliary_fs=self.auxiliary_fs,
        )
        settings.check(path)
        axes, companions, flags = source_files(path)
        first_file = next(iter(axes.values()))
        from_bag = is_bag(first_file)
        roles = {"acceleration": self.acceleration, **self.auxiliary}
        if from_bag:
            roles = self._roles_in(first_file, settings)
        signals = files.read_signals(axes, roles, settings, companions=companions)
        if from_bag:
            if fs is None and 0 < abs(float(signals.fs or 0) / self.fs - 1) <= TIMESTAMPS.near_rate:
                signals = files.read_signals(axes, roles, replace(settings, fs=self.fs))
            if len(signals.channels) == len(self.axes):
                signals = replace(signals, channels=self.axes)
        # The scale of a card converts the unit, so the unit in the file does not apply to the scaled signal.
        file_unit = signals.unit if from_bag or self.scale == 1.0 else None
        unit = resolve_unit(file_unit, unit or file_unit or self.unit, path)
        scale = self.scale if unit == self.unit else 1.0
        recording = build_recording(
            signals,
            scale=scale,
            fs=fs or (self.fs if signals.fs is None else None),
            unit=unit,
            resample=resample or (self.fs if self.resample else None),
            recording_id=recording_name(path, axes),
            source=str(path),
            flags=flags,
        )
        has_trained_columns = roles.get("turn_rate") == self.auxiliary.get("turn_rate")
        recording = condition_recording(
            recording,
            scale,
            self.phases,
            remove_resting_level=self.remove_resting_level,
            turn_rate_scale=self.turn_rate_scale if has_trained_columns else 1.0,
        )
        return use_marked_phases(recording, path, part)

    def _roles_in(self, path: Path, settings: ReaderSettings) -> dict[str, tuple[str, ...]]:
        """Return the columns of a bag for each signal: as in the training files or, if missing, its own."""
        columns = files.column_names(path, settings)
        own_columns = [name for name in columns if not name.startswith("/")]
        auxiliary = {signal: names for signal, names in self.auxiliary.items() if set(names) <= set(columns)}
        if "turn_rate" in self.auxiliary and set(TURN_RATE) <= set(own_columns):
            auxiliary.setdefault("turn_rate", TURN_RATE)
        if self.acceleration and set(self.acceleration) <= set(own_columns):
            return {"acceleration": self.acceleration, **auxiliary}
        n_axes, n_turn = len(self.axes), len(TURN_RATE) * ("turn_rate" in self.auxiliary)
        if own_columns == [f"c{i + 1}" for i in range(n_axes + n_turn)]:  # channels of an array have no names
            turn = {"turn_rate": tuple(own_columns[n_axes:])} if n_turn else {}
            return {"acceleration": tuple(own_columns[:n_axes]), **auxiliary, **turn}
        return {"acceleration": choose_acceleration(own_columns, path), **auxiliary}


def _is_bag(name: str | Path) -> bool:
    """Return whether a name refers to a bag: "bag:FILE", a bag file, or a folder of rosbag2."""
    path = Path(name).expanduser()
    is_bag_file = (path.exists() or ":" not in str(name)) and is_bag(path)
    return files.is_bag_name(name) or is_bag_file or (path / BAG_METADATA).is_file()
