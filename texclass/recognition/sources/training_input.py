"""Input like that a model was trained on: which columns a stream needs, how files become recordings."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from texclass import shipped
from texclass.features.phase_view import TURN
from texclass.loaders import files, find_recording, open_dataset
from texclass.loaders.cards import DeclaredPhases, FileReading, Reading
from texclass.loaders.columns import TURN_RATE, choose_acceleration
from texclass.loaders.data_files import normalize_name
from texclass.loaders.dataset import Dataset
from texclass.loaders.exports import find_export
from texclass.loaders.filesets import condition_recording
from texclass.loaders.open import flat_files
from texclass.loaders.plausibility import build_recording, resolve_unit
from texclass.loaders.readers import BAG_METADATA, FORMATS, ReaderSettings, as_column_names, is_bag
from texclass.loaders.timestamps import TIMESTAMPS
from texclass.recording import Recording, RecordingError, Samples
from texclass.validation import StrictModel

Beside = Literal["turn_rate", "friction"]


class Member(NamedTuple):
    """A recording of a card or folder before it is loaded: its name, its loader, its surface if known."""

    name: str
    load: Callable[[], Recording]
    surface: str | None = None


@dataclass(frozen=True)
class Needs:
    """The columns of a stream, in this order: axes of the acceleration, turn rate, friction.

    Attributes
    ----------
    axes
        Names of the axes of the acceleration; empty: any number of them.
    beside
        Signals of `Recording` whose columns follow: "turn_rate" (3), then "friction" (1).
    of_friction
        Features that need the friction.
    """

    axes: tuple[str, ...] = ()
    beside: tuple[Beside, ...] = ()
    of_friction: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns; "acceleration" stands for any number of axes."""
        turn = TURN if "turn_rate" in self.beside else ()
        friction = ("friction",) if "friction" in self.beside else ()
        return (*(self.axes or ("acceleration",)), *turn, *friction)

    def columns_of(self, recording: Recording) -> Samples:
        """Return the columns of a recording, shape (n_samples, n_columns).

        Raises
        ------
        RecordingError
            If it lacks a signal.
        """
        where, n = recording.source or recording.recording_id, recording.n_samples
        signals = [recording.acceleration.reshape(n, -1)]
        for name in self.beside:
            if (signal := getattr(recording, name)) is None:
                raise RecordingError(f"{where}: {self.lacks(name)}")
            signals.append(signal.reshape(n, -1))
        return np.column_stack(signals)

    def lacks(self, name: Beside) -> str:
        """Return what to say of a source without one of the signals, and what to train instead."""
        expected = f"Expected {', '.join(self.names)}, as in training"
        if name == "friction":
            return (
                f"no friction, needed by {', '.join(self.of_friction)}. {expected} (texclass train with a "
                "--row of acceleration only makes a model that needs none)"
            )
        return f"no turn rate. {expected} (recordings without turn rate make a model that needs none)"

    def n_axes(self, n_columns: int) -> int:
        """Return how many of the columns of a stream are axes of the acceleration.

        Raises
        ------
        ValueError
            If it has too few columns, or other than as many as the model was trained with.
        """
        n_beside = len(self.names) - (len(self.axes) or 1)
        if n_columns <= n_beside or (self.axes and n_columns != len(self.names)):
            more = "" if self.axes else " or more"
            raise ValueError(
                f"the stream has {n_columns} columns. Expected {len(self.names)}{more}, "
                f"{', '.join(self.names)}, as the model was trained"
            )
        return n_columns - n_beside


ACCELERATION_ONLY: Needs = Needs()


class TrainingFiles(StrictModel):
    """What a dataset card says of its files, as far as one file of the same kind needs it.

    Attributes
    ----------
    fs
        Sampling rate in Hz of files that do not state theirs.
    unit
        Of the acceleration in the files.
    scale, phases, remove_resting_level, delimiter, skip_rows, comment, drop_incomplete
        As in a dataset card. The scale belongs to the unit: a file in another one is not scaled.
    turn_rate_scale
        As in a dataset card; what a message of ROS states as a turn rate is in rad/s.
    acceleration, auxiliary
        Columns of the acceleration, and of each signal beside it.
    axes
        Names of the channels of the recordings.
    topic
        Of bags, where these hold several.
    time_column, time_unit
        Column of the time stamps, and their unit.
    resample
        Whether files at other rates are brought to `fs`.
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

    @classmethod
    def of(cls, dataset: Dataset, like: Recording) -> "TrainingFiles":
        """Return what is to be known of the files of a dataset, one of whose recordings is `like`."""
        loader: Any = dataset.load
        while hasattr(loader, "load"):  # of windows, which wrap the loader of their recordings
            loader = loader.load
        told = loader.args[0] if isinstance(loader, partial) else None  # what `load_files` is to read
        if not isinstance(told, Reading):
            return cls(fs=like.fs, unit=like.unit, axes=like.channels)
        facts = {name: stated for name, stated in told if name in cls.model_fields}
        if isinstance(told, FileReading):
            channels = dict(told.channels)
            facts["acceleration"] = channels.pop("acceleration", ())
            facts |= {"auxiliary": channels, "resample": told.resample_hz is not None}
            if told.topic is not None and re.compile(told.topic).groupindex:  # a pattern, of many topics
                facts["topic"] = None
        return cls(**facts, fs=like.fs, axes=like.channels)

    def find(
        self, name: str | Path, *, fs: float | None = None, unit: str | None = None, **reading: Any
    ) -> Recording:
        """Return a file or bag, read as the training files were, or "DATASET:RECORDING" as its card has it.

        `reading` is what else `load_recording` takes: column, delimiter, time_column, time_unit, resample,
        skip_rows, comment, drop_incomplete.

        Raises
        ------
        RecordingError, FileNotFoundError, CardError
            As `find_recording`.
        """
        path = Path(name).expanduser()
        is_file = path.suffix.lower() in FORMATS and (path.exists() or ":" not in str(name))
        is_file |= find_export(path) is not None
        if is_file or _is_bag(name):
            resample = reading.pop("resample", None)
            told = {"acceleration": as_column_names(reading.pop("column", None)), **reading}
            like = self.model_copy(update={key: value for key, value in told.items() if value})
            return like.load(name, fs=fs, unit=unit, resample=resample)
        return find_recording(name, fs=fs, unit=unit, **reading)

    def references(
        self, names: Iterable[str | Path], labels: str | Path | None = None, **reading: Any
    ) -> list[Recording]:
        """Return recordings by their names, with the surfaces that these say.

        Parameters
        ----------
        names : iterable of str or Path
            "SURFACE=FILE"; a file, of an unknown surface; "DATASET:RECORDING"; a card; or a folder with one
            subfolder per surface.
        labels : str or Path, optional
            Table with the surfaces of a folder, as `open_dataset` takes it.
        **reading : optional
            What `find` takes.

        Raises
        ------
        RecordingError, FileNotFoundError, CardError
            As `find` and `open_dataset`.
        """
        found: list[Recording] = []
        for name in names:
            surface, equals, file = str(name).partition("=")
            if equals and not Path(name).expanduser().exists() and not files.is_bag_name(str(name)):
                found.append(self.find(file, **reading).with_(surface=normalize_name(surface)))
            else:
                for one in self.members(name, labels, **reading):
                    felt = one.load()
                    found.append(felt if one.surface is None else felt.with_(surface=one.surface))
        return found

    def members(self, name: str | Path, labels: str | Path | None = None, **reading: Any) -> list[Member]:
        """Return the recordings that a name means: those of a card or a folder, or one.

        Parameters
        ----------
        name : str or Path
            A card; a folder with one subfolder per surface, or with recordings of unknown surfaces; or what
            `find` takes.
        labels : str or Path, optional
            Table with the surfaces of a folder, as `open_dataset` takes it.
        **reading : optional
            What `find` takes.

        Raises
        ------
        RecordingError, FileNotFoundError, CardError
            As `open_dataset`, or if there are labels of something else than a folder.
        """
        path = Path(name).expanduser()
        if path.is_dir() and not (path / BAG_METADATA).is_file() and not find_export(path):
            if labels is None and (flat := flat_files(path)):
                return [Member(str(file), partial(self.find, file, **reading)) for file in flat]
            stated: dict[str, Any] = {"fs": self.fs, "unit": self.unit}
            stated |= {key: value for key, value in reading.items() if value is not None}
            dataset = open_dataset(path, labels=labels, **stated)
            found = [(path / entry.paths[0], entry.surface) for entry in dataset.entries]
            exported = {folder for folder in {file.parent for file, _ in found} if find_export(folder)}
            whole = [file.parent if file.parent in exported else file for file, _ in found]
            return [
                Member(str(file), partial(self.find, file, **reading), surface)
                for file, (_, surface) in zip(whole, found, strict=True)
            ]
        if labels is not None:
            raise RecordingError(f"{name}: labels are given ({labels}). Expected a folder")
        if path.suffix == ".toml" or str(name) in shipped.names("datasets"):
            dataset = open_dataset(name, **reading)
            return [
                Member(f"{name}:{entry.recording_id}", partial(dataset.load, entry), entry.surface)
                for entry in dataset.entries
            ]
        return [Member(str(name), partial(self.find, name, **reading))]

    def load(
        self,
        name: str | Path,
        *,
        fs: float | None = None,
        unit: str | None = None,
        resample: float | None = None,
    ) -> Recording:
        """Load a file: what it states of rate and unit counts, then what is given, then that of training.

        A bag whose columns have other names than the training files is read by its own: acceleration and turn
        rate of its messages, or the channels of an array, in the order of the training files.

        Raises
        ------
        RecordingError
            If the file is bad, or contradicts `fs` or `unit`.
        """
        path, asked = files.locate_recording(name) if _is_bag(name) else (Path(name).expanduser(), None)
        if not asked and self.topic is not None and is_bag(path) and self.topic in files.topics(path):
            asked = self.topic
        settings = ReaderSettings(
            fs=fs,
            unit=unit or self.unit,
            resample=resample,
            topic=asked,
            delimiter=self.delimiter,
            time_column=self.time_column,
            time_unit=self.time_unit,
            skip_rows=self.skip_rows,
            comment=self.comment,
            drop_incomplete=self.drop_incomplete,
        )
        settings.check(path)
        axes, beside, said = files.source_files(path)
        first = next(iter(axes.values()))
        of_bag = is_bag(first)
        roles = {"acceleration": self.acceleration, **self.auxiliary}
        if of_bag:
            roles = self._roles_in(first, settings)
        signals = files.read_signals(axes, roles, settings, companions=beside)
        if of_bag:
            if fs is None and 0 < abs(float(signals.fs or 0) / self.fs - 1) <= TIMESTAMPS.near_rate:
                signals = files.read_signals(axes, roles, replace(settings, fs=self.fs))
            if len(signals.channels) == len(self.axes):
                signals = replace(signals, channels=self.axes)
        own = signals.unit if of_bag or self.scale == 1.0 else None  # else it was scaled to another
        stated = resolve_unit(own, unit or own or self.unit, path)
        scale = self.scale if stated == self.unit else 1.0
        recording = build_recording(
            signals,
            scale=scale,
            fs=fs or (self.fs if signals.fs is None else None),
            unit=stated,
            resample=resample or (self.fs if self.resample else None),
            recording_id=files.recording_name(path, axes),
            source=str(path),
            flags=said,
        )
        as_trained = roles.get("turn_rate") == self.auxiliary.get("turn_rate")
        return condition_recording(
            recording,
            scale,
            self.phases,
            remove_resting_level=self.remove_resting_level,
            turn_rate_scale=self.turn_rate_scale if as_trained else 1.0,
        )

    def _roles_in(self, path: Path, settings: ReaderSettings) -> dict[str, tuple[str, ...]]:
        """Return which columns of a bag are what: as in the training files if it has those, else its own."""
        present = files.column_names(path, settings)
        own = [name for name in present if not name.startswith("/")]
        auxiliary = {field: names for field, names in self.auxiliary.items() if set(names) <= set(present)}
        if "turn_rate" in self.auxiliary and set(TURN_RATE) <= set(own):
            auxiliary.setdefault("turn_rate", TURN_RATE)
        if self.acceleration and set(self.acceleration) <= set(own):
            return {"acceleration": self.acceleration, **auxiliary}
        n_axes, n_turn = len(self.axes), len(TURN_RATE) * ("turn_rate" in self.auxiliary)
        if own == [f"c{i + 1}" for i in range(n_axes + n_turn)]:  # an array: its channels have no names
            turn = {"turn_rate": tuple(own[n_axes:])} if n_turn else {}
            return {"acceleration": tuple(own[:n_axes]), **auxiliary, **turn}
        return {"acceleration": choose_acceleration(own, path), **auxiliary}


def _is_bag(name: str | Path) -> bool:
    """Whether a name is of a bag: "bag:FILE", a file, or a folder of rosbag2."""
    path = Path(name).expanduser()
    is_there = (path.exists() or ":" not in str(name)) and is_bag(path)
    return files.is_bag_name(name) or is_there or (path / BAG_METADATA).is_file()
