"""Datasets in which a recording is a file, or a file per axis, whose name tells what it is."""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from texclass.loaders import bags_of_datasets, formats
from texclass.loaders.cards import CardError, DeclaredPhases, FileReading
from texclass.loaders.columns import UNNAMED, ReadOptions
from texclass.loaders.dataset import Dataset, Entry
from texclass.loaders.places import digest_files
from texclass.loaders.single import Signals, agreed_unit, build_recording, read_signals
from texclass.recording import Phases, Recording, RecordingError, Samples, Tap

Groups = dict[str, str]


@dataclass(frozen=True)
class FileLoader:
    """Loads recordings that are files; a `Dataset`'s `load`, picklable.

    Parameters
    ----------
    reading : FileReading
        How the files become recordings.
    root : Path
        Folder to which the entries' paths are relative.
    """

    reading: FileReading
    root: Path

    def __call__(self, entry: Entry) -> Recording:
        """Load one recording.

        Raises
        ------
        RecordingError
            If it is bad; the message names file, value and rule.
        """
        told = self.reading
        axes, companions = self._parts(entry)
        topic = entry.topic or told.topic
        options = ReadOptions(told.delimiter, codes=told.unit == "counts", topic=topic, fs=told.fs_hz)
        for path in axes.values():
            agreed_unit(path, options, told.unit)
        signals = read_signals(axes, told.channels, options, trim=told.trim)
        signals, flags = self._with_companions(signals, companions, options)
        recording = build_recording(
            signals,
            fs=told.fs_hz,
            unit=told.unit,
            source=str(self.root / entry.paths[0]),
            flags=flags,
            recording_id=entry.recording_id,
            material=entry.material,
            operator=entry.operator,
            session=entry.session,
            repetition=entry.repetition,
        )
        return conditioned(recording, told.scale, told.phases, remove_resting_level=told.remove_resting_level)

    def _parts(self, entry: Entry) -> tuple[dict[str, Path], dict[str, Path]]:
        """Return axis -> file, and auxiliary signal -> file."""
        axes, companions = {}, {}
        for name in entry.paths:
            if (matched := match_name(self.reading.files, name)) is not None:
                groups, _ = matched
                axes[groups.get("axis", "").lower()] = self.root / name
                for signal, candidates in companion_names(self.reading, groups).items():
                    for companion in set(candidates) & set(entry.paths):
                        companions[signal] = self.root / companion
        return axes, companions

    def _with_companions(
        self, signals: Signals, companions: Mapping[str, Path], options: ReadOptions
    ) -> tuple[Signals, tuple[str, ...]]:
        """Add the signals that have files of their own; say which are absent or were cut."""
        fields = dict(signals.fields)
        flags = [
            f"absent: no file with the {name}" for name in self.reading.companions if name not in companions
        ]
        for name, path in companions.items():
            fields[name] = read_signals({"": path}, {}, options).fields[UNNAMED]
        lengths = {name: len(signal) for name, signal in fields.items()}
        if self.reading.trim and len(set(lengths.values())) > 1:
            shortest = min(lengths.values())
            fields = {name: signal[:shortest] for name, signal in fields.items()}
            flags.append(f"trimmed: {lengths} samples cut to {shortest}")
        return replace(signals, fields=fields), tuple(flags)


def open_files(
    reading: FileReading, root: Path, *, notes: tuple[str, ...] = (), skip_bad: bool = False, **about: str
) -> Dataset:
    """Return a dataset of files; only names and the table of labels are read.

    Parameters
    ----------
    reading : FileReading
        How the files become recordings.
    root : Path
        Folder of the files.
    notes, skip_bad, **about
        Of the `Dataset`.

    Raises
    ------
    RecordingError
        If no file matches, or an id occurs twice.
    CardError
        If the table of labels lacks a column or a recording.
    """
    table = _read_labels(reading, root)
    left_out: list[str] = []
    entries = [
        _entry(reading, root, names, groups, table, topic)
        for names, groups in _find(reading, root)
        for topic, groups in bags_of_datasets.by_topic(
            reading.topic, root / names[0], groups, left_out, skip_bad=skip_bad
        )
    ]
    check_ids(entries, root)
    absent = set(table) - {entry.recording_id for entry in entries}
    digested = [name for entry in entries for name in entry.paths]
    digested += bags_of_datasets.inside_folders(root, digested)
    digested += [reading.labels.file] if reading.labels else []
    return Dataset(
        entries=tuple(entries),
        load=FileLoader(reading, root),
        input_hash=digest_files(root, digested, reading.facts),
        notes=(
            *notes,
            *(f"{name} is in the table of labels, but has no file" for name in sorted(absent)),
            *left_out,
        ),
        skip_bad=skip_bad,
        **about,
    )


def match_name(patterns: Sequence[str], name: str) -> tuple[Groups, str] | None:
    """Return what a file's relative name tells, and that name without the part that tells the axis.

    The first pattern that matches the whole name counts; None if there is none.
    """
    for pattern in patterns:
        if match := re.fullmatch(pattern, name):
            groups = {group: text for group, text in match.groupdict().items() if text is not None}
            if "axis" not in groups:
                return groups, name
            first, last = match.span("axis")
            return groups, name[:first].removesuffix("_") + name[last:]
    return None


def companion_names(reading: FileReading, groups: Groups) -> dict[str, tuple[str, ...]]:
    """Return auxiliary signal -> relative names its file may have, the groups filled in."""
    return {
        signal: tuple(
            re.sub(r"\{(\w+)\}", lambda match: groups.get(match[1], match[0]), template)
            for template in templates
        )
        for signal, templates in reading.companions.items()
    }


def conditioned(
    recording: Recording, scale: float, phases: DeclaredPhases, *, remove_resting_level: bool
) -> Recording:
    """Return a recording scaled, without its resting level and with its phases, as a card declares them.

    The resting level of a channel is its median.
    """
    acceleration = recording.acceleration
    if scale != 1.0:
        acceleration = acceleration * scale
    if remove_resting_level:
        acceleration = acceleration - np.median(acceleration, axis=0)
    return recording.with_(acceleration=acceleration, phases=_declared_phases(phases, acceleration))


def _declared_phases(phases: DeclaredPhases, acceleration: Samples) -> Phases | None:
    """Return the phases a card declares for each of its recordings; None leaves them to be detected."""
    n = len(acceleration)
    match phases:
        case "movement":
            return Phases(movement=(0, n), notes=("the card declares the whole recording as movement",))
        case "tap":
            return Phases(taps=(Tap(0, contact(acceleration), n),), notes=("the card declares one tap",))
    return None


def contact(acceleration: Samples, share: float = 0.1) -> int:
    """Return the first sample of the contact in a recording of one tap.

    That is the first sample at which any channel changes by more than `share` of its own largest change
    from one sample to the next. Changes, unlike levels, do not depend on what the channel reads at rest.

    Parameters
    ----------
    acceleration : ndarray of shape (n,) or (n, n_channels)
        One tap.
    share : float
        Of the largest change; above the noise, below the impact.
    """
    change = np.abs(np.diff(acceleration.reshape(len(acceleration), -1), axis=0))
    is_large = (change > share * change.max(axis=0)).any(axis=1)
    return 1 + int(np.argmax(is_large))


def check_ids(entries: Sequence[Entry], root: Path) -> None:
    """Check that there are recordings, and that no two bear the same id.

    Raises
    ------
    RecordingError
        Naming the folder, or the first id that occurs twice and its files.
    """
    if not entries:
        raise RecordingError(
            f"{root}: holds no recording; the rule is at least one file as the card describes"
        )
    seen: dict[str, Entry] = {}
    for entry in entries:
        if (first := seen.setdefault(entry.recording_id, entry)) is not entry:
            files = ", ".join((*first.paths, *entry.paths))
            raise RecordingError(
                f"{root}: recording id {entry.recording_id!r} occurs twice ({files}); the rule is once"
            )


def _find(reading: FileReading, root: Path) -> Iterator[tuple[tuple[str, ...], Groups]]:
    """Yield the files of each recording (one, or one per axis, and companions) and what their names tell."""
    joined: dict[str, tuple[list[str], Groups]] = {}
    files = {path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()}
    files -= bags_of_datasets.not_recordings(files)
    for name in sorted(files, key=_natural):
        if (matched := match_name(reading.files, name)) is not None:
            groups, shared = matched
            shortened = shared.removesuffix(f"/{formats.BAG_FOLDER}")
            groups.setdefault("recording", shortened if shortened != shared else shared.rpartition(".")[0])
            joined.setdefault(shared, ([], groups))[0].append(name)
    for names, groups in joined.values():
        present = (
            [name for name in names_ if name in files] for names_ in companion_names(reading, groups).values()
        )
        yield (*names, *(found[0] for found in present if found)), groups


def _natural(name: str) -> list[tuple[int, str]]:
    """Return a sorting key under which 2 comes before 10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


def _entry(
    reading: FileReading,
    root: Path,
    names: tuple[str, ...],
    groups: Groups,
    table: Mapping[str, Groups],
    topic: str | None,
) -> Entry:
    recording_id = groups["recording"]
    if reading.labels and recording_id not in table:
        raise CardError(
            f"{root / reading.labels.file}: has no row for {recording_id!r}; the rule is one each"
        )
    told = groups | table.get(recording_id, {})
    repetition = told.get("repetition")
    if repetition is not None and not repetition.isdecimal():
        raise CardError(f"{root / names[0]}: repetition is {repetition!r}; the rule is a whole number")
    return Entry(
        recording_id=recording_id,
        material=told["material"],
        operator=told.get("operator"),
        session=told.get("session"),
        repetition=int(repetition) if repetition is not None else None,
        paths=names,
        topic=topic,
    )


def _read_labels(reading: FileReading, root: Path) -> dict[str, Groups]:
    if (labels := reading.labels) is None:
        return {}
    path = root / labels.file
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file, delimiter=reading.delimiter or ","))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CardError(f"{path}: the table of labels cannot be read ({error})") from error
    columns = set(rows[0]) if rows else set()
    if absent := set(labels.columns.values()) - columns:
        raise CardError(f"{path}: lacks the columns {sorted(absent)}; the rule is those named in [labels]")
    if short := next((i for i, row in enumerate(rows, 1) if None in row.values() or None in row), 0):
        raise CardError(f"{path}: row {short} has other cells than the header; the rule is one a column")
    return {
        row[labels.columns["recording"]]: {group: row[name] for group, name in labels.columns.items()}
        for row in rows
    }
