"""Datasets in files: a recording is a file (or one per axis) whose name tells what it is, or a row of one."""

import re
from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from texclass.loaders.cards import CardError, DeclaredPhases, FileCard, FileReading, Reading, RowCard
from texclass.loaders.columns import ACCELERATION, signal_columns
from texclass.loaders.data_files import data_files, is_hidden, normalize_name
from texclass.loaders.dataset import GROUPS, Dataset, Entry
from texclass.loaders.files import column_names, read_signals, topics
from texclass.loaders.labels import Labels
from texclass.loaders.places import combine_digests, digest_files, file_digests, is_outside
from texclass.loaders.plausibility import build_recording, similar_label_notes
from texclass.loaders.readers import (
    BAG_METADATA,
    STORAGE_SUFFIXES,
    ReadSignals,
    is_bag,
    reader_error,
    storage_suffix,
)
from texclass.loaders.timestamps import TIMESTAMPS
from texclass.phase_settings import PhaseSettings
from texclass.recording import Phases, Recording, RecordingError, Samples, Tap
from texclass.reporting.wording import counted

MATCH_TIMEOUT_S = 0.2
"""Seconds of the processor that a pattern may take on one name; usual ones take microseconds."""
Groups = dict[str, str]
"""Facts of a recording that names, topics and tables state: group -> text."""


def load_files(reading: FileReading, root: Path, entry: Entry) -> Recording:
    """Load one recording that is a file, or several.

    Parameters
    ----------
    reading : FileReading
        How the files become recordings.
    root : Path
        Folder to which the entry's paths are relative.
    entry : Entry
        Which recording.

    Raises
    ------
    RecordingError
        If it is bad; the message names file, value and rule.
    """
    axes, companions = {}, dict[str, Path]()
    for name in entry.paths:
        if root / name in companions.values():
            continue
        if (matched := match_name(reading.files, name)) is not None:
            groups, _ = matched
            axes[groups.get("axis", "").lower()] = root / name
            for signal, candidates in _companion_names(reading, groups).items():
                for companion in entry.paths:
                    if normalize_name(companion) in candidates:
                        companions[signal] = root / companion
    settings = replace(reading.settings, topic=entry.topic or reading.topic)
    signals = read_signals(axes, reading.channels, settings, trim=reading.trim, companions=companions)
    named = dict(signals.named)
    flags = [f"absent: no file with the {name}" for name in reading.companions if name not in companions]
    for name, path in companions.items():
        if name not in named:
            columns = signal_columns(column_names(path, settings), path)
            one = read_signals({"": path}, {ACCELERATION: columns}, replace(settings, time_column=None))
            if one.fs and signals.fs and abs(one.fs / signals.fs - 1) > TIMESTAMPS.near_rate:
                raise reader_error(
                    path, f"its rate is {one.fs:g} Hz, that of the acceleration {signals.fs:g}", "one"
                )
            named[name] = one.named[ACCELERATION]
    lengths = {name: len(signal) for name, signal in named.items()}
    if reading.trim and len(set(lengths.values())) > 1:
        shortest = min(lengths.values())
        named = {name: signal[:shortest] for name, signal in named.items()}
        flags.append(f"trimmed: {lengths} samples cut to {shortest}")
    signals = replace(signals, named=named, flags=(*flags, *signals.flags))
    return _recording(signals, reading, entry, str(root / entry.paths[0]))


def open_files(
    reading: FileReading,
    root: Path,
    *,
    ignored: Collection[str] = (),
    notes: tuple[str, ...] = (),
    skip_bad: bool = False,
    **about: str,
) -> Dataset:
    """Return a dataset of files; only names and the table of labels are read.

    Parameters
    ----------
    reading : FileReading
        How the files become recordings.
    root : Path
        Folder of the files.
    ignored : collection of str
        Relative names of files that are neither recordings nor reported.
    notes, skip_bad, **about
        Of the `Dataset`.

    Raises
    ------
    RecordingError
        If no file matches, or an id occurs twice.
    CardError
        If the table of labels lacks a column or a recording.
    """
    table = reading.labels
    labels = Labels.read((root / table.file).resolve(), table) if table else None
    own = [table.file] if table else []
    present = _recording_candidates(root, own)
    others = present.difference(ignored)
    left_out: list[str] = []
    entries: list[Entry] = []
    for names, groups in _find(reading, present, ignored):
        others -= set(names)
        try:
            entries += _entries(reading, root, names, groups, labels)
        except RecordingError as error:
            if not skip_bad:
                raise
            left_out.append(f"left out: {error}")
    if not entries and not left_out:
        beside = f": {min(others)!r} is not like {reading.files[0]!r}" if others else ""
        rule = "at least one file as `files` of the card describes"
        raise reader_error(root, f"holds no recording{beside}", rule)
    _check_names(entries, root)
    contents = {entry: _content_files(root, entry) for entry in entries}
    digests = file_digests(root, [*own, *(name for names in contents.values() for name in names)])
    keys = {
        entry: (*(digests[name] for name in names), entry.topic or "") for entry, names in contents.items()
    }
    copies, copy_notes = _find_copies(keys)
    doubts = [
        *similar_label_notes(entry.surface for entry in entries),
        *_unmatched_file_notes(reading, present - others, others),
    ]
    if table and isinstance(reading, FileCard) and is_outside(root / table.file, (root,)):
        doubts.append(f"the table of labels {table.file!r} is outside of the folder of the recordings")
    unmatched = sorted(set(labels.rows).difference(labels.used)) if labels else []
    doubts += [f"{name} is in the table of labels, but has no file" for name in unmatched]
    return Dataset(
        entries=tuple(entries),
        load=partial(load_files, reading, root),
        input_hash=combine_digests(digests, reading.facts),
        notes=(*notes, *doubts, *left_out, *copy_notes),
        skip_bad=skip_bad,
        copies=copies,
        **about,
    )


def _recording_candidates(root: Path, own: Collection[str]) -> set[str]:
    """Return the relative names of the files that can be recordings, each in one Unicode normal form."""
    present = {path.relative_to(root).as_posix() for path in data_files(root)}
    present -= bag_parts(present).union(own)
    alike: dict[str, str] = {}
    for name in sorted(present, reverse=True):
        if (other := alike.setdefault(normalize_name(name), name)) != name:
            raise RecordingError(
                f"{root} contains {other!a} and {name!a}, one name in two Unicode normal forms. "
                "Expected different names: rename or remove one"
            )
    return present


def _content_files(root: Path, entry: Entry) -> list[str]:
    """Return the files that hold a recording: its own, and those of the storage of a bag."""
    names = list(entry.paths)
    for folder in [(root / name).parent for name in names if PurePosixPath(name).name == BAG_METADATA]:
        names += [
            file.relative_to(root).as_posix()
            for file in sorted(folder.iterdir())
            if storage_suffix(file.name) in STORAGE_SUFFIXES and not is_hidden(file.name)
        ]
    return names


def _find_copies(keys: Mapping[Entry, Hashable]) -> tuple[tuple[tuple[Entry, ...], ...], list[str]]:
    """Return the recordings that have equal keys, together, and notes on them."""
    same: dict[Hashable, tuple[Entry, ...]] = {}
    for entry, key in keys.items():
        same[key] = (*same.get(key, ()), entry)
    copies = tuple(alike for alike in same.values() if len(alike) > 1)
    notes = []
    for of_several, end in ((True, " but different labels"), (False, "")):
        found = [alike for alike in copies if (len({entry.surface for entry in alike}) > 1) == of_several]
        if found:
            names = ", ".join(repr(entry.recording_id) for entry in found[0])
            n = sum(map(len, found))
            notes.append(f"{counted(n, 'recording')} have the same content as another{end}, first {names}")
    return copies, notes


def _unmatched_file_notes(reading: FileReading, taken: set[str], others: set[str]) -> list[str]:
    """Return a note on files that are left out although others of their kind are recordings."""
    kinds = {PurePosixPath(name).suffix.lower() for name in taken}
    missed = [name for name in others if PurePosixPath(name).suffix.lower() in kinds]
    if not missed:
        return []
    is_card = isinstance(reading, FileCard)
    way_out = f"widen `files`, {reading.files[0]!r}" if is_card else "put it into the folder of a surface"
    return [f"{counted(len(missed), 'file')} left out, {min(missed)!r} first: {way_out}, to take it in"]


def load_row(card: RowCard, where: str, samples: Mapping[str, Samples], entry: Entry) -> Recording:
    """Return one recording that is a row.

    Parameters
    ----------
    card : RowCard
        How the rows become recordings.
    where : str
        File of the first channel.
    samples : mapping of str to ndarray of shape (n_samples, n_channels)
        Recording id -> its samples, in the order of the rows.
    entry : Entry
        Which recording.

    Raises
    ------
    RecordingError
        If it is bad; the message names file, value and rule.
    """
    row = 1 + list(samples).index(entry.recording_id)
    rows = samples[entry.recording_id]
    signals = ReadSignals({ACCELERATION: rows}, channels=tuple(f"c{i + 1}" for i in range(rows.shape[1])))
    return _recording(signals, card, entry, f"{where} row {row}")


def open_rows(card: RowCard, root: Path, **about: Any) -> Dataset:
    """Return the dataset of a card of rows, whose tables are small: they are read at once.

    Parameters
    ----------
    card : RowCard
        Which files hold the channels.
    root : Path
        Folder of the files.
    **about
        What else a `Dataset` holds.

    Raises
    ------
    RecordingError
        If a file is unreadable, or the files disagree in rows or labels.
    """
    (labels, first), *others = [_read_rows(root / name, card.label_column) for name in card.files]
    if "" in labels:
        row = labels.index("") + 2
        raise CardError(f"{root / card.files[0]}: row {row} has a blank label. Expected a name")
    for name, (its_labels, values) in zip(card.files[1:], others, strict=True):
        if its_labels != labels or values.shape != first.shape:
            raise RecordingError(
                f"{root / name}: has {values.shape} values, {card.files[0]} {first.shape}, or other labels. "
                "Expected the same rows and labels in every channel's file"
            )
    seen: Counter[str] = Counter()
    entries = []
    for label in labels:
        seen[label] += 1
        entries.append(Entry(f"{label}_{seen[label]:02d}", label, repetition=seen[label], paths=card.files))
    samples = np.stack([first, *(values for _, values in others)], axis=-1)
    _check_names(entries, root)
    ids = [entry.recording_id for entry in entries]
    copies, copy_notes = _find_copies(dict(zip(entries, map(np.ndarray.tobytes, samples), strict=True)))
    return Dataset(
        entries=tuple(entries),
        load=partial(load_row, card, str(root / card.files[0]), dict(zip(ids, samples, strict=True))),
        input_hash=digest_files(root, card.files, card.facts),
        **about | {"notes": (*about.get("notes", ()), *copy_notes), "copies": copies},
    )


def match_name(patterns: Sequence[str], name: str) -> tuple[Groups, str] | None:
    """Return what a file's relative name tells, and that name without the part that tells the axis.

    The first pattern that matches the whole name counts; None if there is none. Names are compared in NFC.
    """
    name = normalize_name(name)
    for pattern in patterns:
        if match := _match(pattern, name):
            groups = {group: text for group, text in match.groupdict().items() if text is not None}
            if "axis" not in groups:
                return groups, name
            first, last = match.span("axis")
            return groups, name[:first].removesuffix("_") + name[last:]
    return None


def _match(pattern: str, name: str) -> Any:
    """Return how a pattern of a card matches a whole name; one that takes for ever is an error."""
    import regex  # a tenth of a second, which only cards wait for

    try:
        return regex.fullmatch(normalize_name(pattern), name, timeout=MATCH_TIMEOUT_S)
    except (TimeoutError, regex.error) as error:
        raise CardError(
            f"files or topic holds {pattern!r:.200}, which is no pattern or takes over {MATCH_TIMEOUT_S:g} s "
            f"on {name!r:.200} ({error}). Expected no repetition inside a repetition, as in (a+)+"
        ) from error


def bag_parts(files: Iterable[str]) -> set[str]:
    """Return, of relative names, those that are no recordings themselves but parts of bags that are folders.

    A `metadata.yaml` stands for the bag files beside it; without any it is somebody else's.
    """
    paths = [PurePosixPath(name) for name in files]
    storing = {path for path in paths if storage_suffix(path.name) in STORAGE_SUFFIXES}
    holding = {path.parent for path in storing}
    described = {path.parent for path in paths if path.name == BAG_METADATA}
    return {
        str(path)
        for path in paths
        if (path in storing and path.parent in described)
        or (path.name == BAG_METADATA and path.parent not in holding)
    }


def condition_recording(
    recording: Recording,
    scale: float,
    phases: DeclaredPhases,
    *,
    remove_resting_level: bool,
    turn_rate_scale: float = 1.0,
) -> Recording:
    """Return a recording scaled, without its resting level and with its phases, as a card declares them.

    The resting level of a channel is its median.
    """
    acceleration = recording.acceleration
    if scale != 1.0:
        acceleration = acceleration * scale
    if remove_resting_level:
        acceleration = acceleration - np.median(acceleration, axis=0)
    n = len(acceleration)
    declared = None
    if phases == "movement":
        declared = Phases(movement=(0, n), notes=("the card declares the whole recording as movement",))
    elif phases == "tap":
        declared = Phases(taps=(Tap(0, contact(acceleration), n),), notes=("the card declares one tap",))
    turn = recording.turn_rate
    if turn is not None and turn_rate_scale != 1.0:
        turn = turn * turn_rate_scale
    settings = replace(recording.phase_settings, contents="taps") if phases == "taps" else PhaseSettings()
    return recording.with_(
        acceleration=acceleration, turn_rate=turn, phases=declared, phase_settings=settings
    )


def contact(acceleration: Samples) -> int:
    """Return the first sample of the contact in a recording of one tap.

    That is the first sample at which any channel changes by more than a tenth of its own largest change
    from one sample to the next. Changes, unlike levels, do not depend on what the channel reads at rest.

    Parameters
    ----------
    acceleration : ndarray of shape (n,) or (n, n_channels)
        One tap.
    """
    change = np.abs(np.diff(acceleration.reshape(len(acceleration), -1), axis=0))
    is_large = (change > 0.1 * change.max(axis=0)).any(axis=1)  # above the noise, below the impact
    return 1 + int(np.argmax(is_large))


def _recording(signals: ReadSignals, reading: Reading, entry: Entry, source: str) -> Recording:
    facts = {name: getattr(entry, name) for name in ("recording_id", *GROUPS)}
    if isinstance(reading, FileReading):
        facts |= {"resample": reading.resample_hz, "rate_of": reading._rate_of}
    recording = build_recording(
        signals, fs=reading.fs_hz, unit=reading.unit, source=source, scale=reading.scale, **facts
    )
    return condition_recording(
        recording,
        reading.scale,
        reading.phases,
        remove_resting_level=reading.remove_resting_level,
        turn_rate_scale=reading.turn_rate_scale,
    )


def _check_names(entries: Sequence[Entry], root: Path) -> None:
    """Check that there are recordings with printable names, and that no two have the same id."""
    if not entries:
        raise reader_error(root, "holds no recording", "at least one file as the card describes")
    seen: dict[str, Entry] = {}
    for entry in entries:
        names = (entry.recording_id, entry.surface, entry.operator, entry.session)
        if steering := next((name for name in names if name and not name.isprintable()), None):
            found = f"the name {steering!r} holds a control character"
            raise reader_error(root, found, "printable names: rename it")
        if (first := seen.setdefault(entry.recording_id, entry)) is not entry:
            files = ", ".join((*first.paths, *entry.paths))
            raise reader_error(root, f"recording id {entry.recording_id!r} occurs twice ({files})", "once")


def _find(
    reading: FileReading, files: set[str], ignored: Collection[str]
) -> Iterator[tuple[tuple[str, ...], Groups]]:
    """Yield the files of each recording (one, or one per axis, and companions) and what their names tell.

    Of ignored files, only companions are taken.
    """
    joined: dict[str, tuple[list[str], Groups]] = {}
    # 2 before 10
    naturally = {
        name: [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]
        for name in files.difference(ignored)
    }
    for name in sorted(naturally, key=naturally.__getitem__):
        if (matched := match_name(reading.files, name)) is not None:
            groups, shared = matched
            shortened = shared.removesuffix(f"/{BAG_METADATA}")
            groups.setdefault("recording", shortened if shortened != shared else shared.rpartition(".")[0])
            joined.setdefault(shared, ([], groups))[0].append(name)
    by_name = {normalize_name(name): name for name in files}
    for names, groups in joined.values():
        present = (
            [by_name[name] for name in candidates if name in by_name]
            for candidates in _companion_names(reading, groups).values()
        )
        yield (*names, *(found[0] for found in present if found)), groups


def _companion_names(reading: FileReading, groups: Groups) -> dict[str, tuple[str, ...]]:
    """Return auxiliary signal -> relative names its file may have, the groups filled in."""
    return {
        signal: tuple(
            normalize_name(re.sub(r"\{(\w+)\}", lambda match: groups.get(match[1], match[0]), template))
            for template in templates
        )
        for signal, templates in reading.companions.items()
    }


def _entries(
    reading: FileReading, root: Path, names: tuple[str, ...], groups: Groups, labels: Labels | None
) -> Iterator[Entry]:
    """Yield the recordings in a file (or one per axis): one, or one per topic of a bag that a pattern fits.

    A pattern has named groups; else `topic` is a name.
    """
    path, pattern = root / names[0], reading.topic
    renamed = {normalize_name(name): surface for name, surface in reading.surfaces.items()}
    by_topic: dict[str | None, Groups] = {None: groups}
    if pattern and re.compile(pattern).groupindex and is_bag(path):
        present = topics(path)
        matched = {name: found for name in sorted(present) if (found := _match(pattern, name))}
        if not matched:
            raise RecordingError(f"{path}: no topic matches {pattern!r}; its topics are {', '.join(present)}")
        by_topic = {
            name: groups
            | {"recording": f"{groups['recording']}/{name.strip('/')}"}
            | {group: text for group, text in found.groupdict().items() if text is not None}
            for name, found in matched.items()
        }
    for topic, stated in by_topic.items():
        recording_id = stated["recording"]
        facts = stated | (dict(labels.of(recording_id, names, root.name)) if labels else {})
        repetition = facts.get("repetition")
        if repetition is not None and not repetition.isdecimal():
            raise CardError(f"{path}: repetition is {repetition!r}. Expected a whole number")
        surface = normalize_name(facts["surface"])
        yield Entry(
            recording_id=recording_id,
            surface=renamed.get(surface, surface),
            operator=facts.get("operator"),
            session=facts.get("session"),
            repetition=int(repetition) if repetition is not None else None,
            paths=names,
            topic=topic,
        )


def _read_rows(path: Path, label_column: str) -> tuple[tuple[str, ...], Samples]:
    """Return the labels of a channel's file, and its values of shape (n_recordings, n_samples)."""
    import pandas as pd

    try:
        table = pd.read_csv(path)
        table.pop(label_column)
        # As written: "001" is not 1, and "NA" is a text.
        written = pd.read_csv(path, usecols=[label_column], dtype=str, keep_default_na=False)
        labels = tuple(written[label_column].str.strip())
        return labels, table.to_numpy(dtype=np.float64)
    except FileNotFoundError as error:
        raise reader_error(path, "is missing", "one file per channel, as the card says") from error
    except KeyError as error:
        raise RecordingError(f"{path}: lacks the column {label_column!r} of the labels") from error
    except (ValueError, TypeError, OverflowError, OSError) as error:
        raise RecordingError(f"{path}: is not a table of numbers and labels ({error})") from error
