"""How files become recordings like those a model was trained on."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, cast

from texclass.loaders import find_recording, formats
from texclass.loaders.cards import Card, DeclaredPhases
from texclass.loaders.columns import ColumnRoles, ReadOptions
from texclass.loaders.dataset import Dataset
from texclass.loaders.filesets import conditioned
from texclass.loaders.single import axis_files, build_recording, checked_unit, read_signals, without_axis
from texclass.recording import Recording


@dataclass(frozen=True)
class Source:
    """What a dataset card says of its files, as far as one file of the same kind needs it.

    Attributes
    ----------
    fs
        Sampling rate in Hz of files that do not state theirs.
    unit
        Of the acceleration in the files.
    scale, phases, remove_resting_level, delimiter
        As in `Card`.
    acceleration, auxiliary
        Columns; see `ColumnRoles`.
    """

    fs: float
    unit: str
    scale: float = 1.0
    phases: DeclaredPhases = "detect"
    remove_resting_level: bool = False
    delimiter: str | None = None
    acceleration: tuple[str, ...] = ()
    auxiliary: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, dataset: Dataset, like: Recording) -> "Source":
        """Return the source of a dataset, one of whose recordings is `like`."""
        card = _card_of(dataset.load)
        if card is None or card.format == "simulated":
            return cls(like.fs, like.unit)
        return cls(
            like.fs, card.unit, card.scale, card.phases, card.remove_resting_level, card.delimiter,
            card.channels.acceleration, card.channels.auxiliary,
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, as JSON gives it back."""
        facts: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return facts

    @classmethod
    def of_dict(cls, stated: Mapping[str, Any]) -> "Source":
        """Return what `to_dict` described."""
        auxiliary = {name: tuple(columns) for name, columns in stated.get("auxiliary", {}).items()}
        facts = {**stated, "acceleration": tuple(stated.get("acceleration", ())), "auxiliary": auxiliary}
        return cls(**facts)

    def load(self, path: Path, *, fs: float | None = None, unit: str | None = None) -> Recording:
        """Load a file: what it states of its rate counts, then `fs`, then the rate trained at.

        Raises
        ------
        RecordingError
            If the file is bad, or contradicts `fs`.
        """
        stated = checked_unit(path, fs, unit or self.unit)
        axes = axis_files(path)
        roles = ColumnRoles(self.acceleration, self.auxiliary)
        signals = read_signals(axes, roles, ReadOptions(self.delimiter, codes=stated == "counts"))
        name = path.stem if len(axes) == 1 else without_axis(path.name).rpartition(".")[0]
        recording = build_recording(
            signals,
            fs=fs or (self.fs if signals.fs is None else None),
            unit=stated,
            recording_id=name,
            source=str(path),
        )
        return conditioned(recording, cast(Card, self))


def find_like(source: Source, name: str, *, fs: float | None = None, unit: str | None = None) -> Recording:
    """Return a file, read as the training files were, or "DATASET:RECORDING" as its card has it.

    Raises
    ------
    RecordingError, FileNotFoundError, CardError
        As `find_recording`.
    """
    path = Path(name).expanduser()
    if path.suffix.lower() in formats.SUFFIXES and (path.exists() or ":" not in name):
        return source.load(path, fs=fs, unit=unit)
    return find_recording(name, fs=fs, unit=unit)


def _card_of(load: Any) -> Card | None:
    """Return the card of a loader, or of the loader it wraps."""
    return next((found for inner in _inside(load) if (found := getattr(inner, "card", None))), None)


def _inside(load: Any) -> Iterator[Any]:
    while load is not None:
        yield load
        load = getattr(load, "load", None)
