"""Datasets with one file per recording, one file per axis, or one row of a file per recording."""

import os
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
from texclass.loaders.phases_files import (
    PhasesFile,
    find_phases_file,
    marked_note,
    phases_path,
    use_marked_phases,
)
from texclass.loaders.places import combine_digests, digest_files, file_digests, is_outside
from texclass.loaders.plausibility import build_recording, resolve_rate, similar_label_notes
from texclass.loaders.readers import (
    BAG_METADATA,
    STORAGE_SUFFIXES,
    ReadSignals,
    is_bag,
    is_topic_pattern,
    reader_error,
    storage_suffix,
)
from texclass.loaders.timestamps import TIMESTAMPS
from texclass.phase_settings import PhaseSettings
from texclass.recording import Phases, Recording, RecordingError, Samples, Tap
from texclass.reporting.wording import counted

MATCH_TIMEOUT_S = 0.2
"""Time limit in s for matching a pattern with one file name; usual patterns take microseconds."""
Groups = dict[str, str]
"""Values of the groups of a recording, from its file name, topic or row of the label table."""


def load_files(reading: FileReading, root: Path, entry: Entry) -> Recording:
    """Load the recording of an entry from its files.

    Parameters
    ----------
    reading : FileReading
        Keys of the card that describe the files.
    root : Path
        Folder of the dataset.
    entry : Entry
        Files and labels of the recording.

    Raises
    ------
    RecordingError
        If a file is missing or invalid.
    """
    axes, companions = {}, dict[str, Path]()
    for name in entry.paths:
        if root / name in companions.values():
            continue
        if (match := match_name(reading.files, name)) is not None:
            groups, _ = match
            axes[groups.get("axis", "").lower()] = root / name
            for signal, candidates in _companion_names(reading, groups).items():
                for other_name in entry.paths:
                    if normalize_name(other_name) in candidates:
                        companions[signal] = root / other_name
    settings = replace(reading.settings, topic=entry.topic or reading.topic)
    read = read_signals(axes, reading.channels, settings, trim=reading.trim, companions=companions)
    signals, rates = dict(read.signals), dict(read.rates)
    flags = [f"missing: no file with the {name}" for name in reading.companions if name not in companions]
    for name, path in companions.items():
        if name not in signals:
            columns = signal_columns(column_names(path, settings), path)
            companion = read_signals({"": path}, {ACCELERATION: columns}, replace(settings, time_column=None))
            signals[name] = companion.signals[ACCELERATION]
            stated_fs, fs = reading.auxiliary_fs_hz.get(name), read.fs or reading.fs_hz
            rate = resolve_rate(companion.fs, stated_fs, path) if companion.fs or stated_fs else fs
            if abs(rate / fs - 1) > TIMESTAMPS.near_rate:
                rates[name] = rate
                flags.append(f"joined: {name} of {path.name}, at its own rate, {rate:g} Hz")
    rate_of = {name: rates.get(name, read.fs or reading.fs_hz) for name in signals}
    lengths = {name: len(signal) for name, signal in signals.items()}
    shortest_s = min(lengths[name] / rate for name, rate in rate_of.items())
    if reading.trim and any(lengths[name] > round(shortest_s * rate) for name, rate in rate_of.items()):
        signals = {name: signal[: round(shortest_s * rate_of[name])] for name, signal in signals.items()}
        flags.append(f"trimmed: {lengths} samples cut to {shortest_s:.4g} s")
    read = replace(read, signals=signals, flags=(*flags, *read.flags), rates=rates)
    path = root / entry.paths[0]
    whole = replace(entry, recording_id=entry.whole_id)
    return use_marked_phases(_build_recording(read, reading, whole, str(path)), path, entry.part)


def open_files(
    reading: FileReading,
    root: Path,
    *,
    ignored: Collection[str] = (),
    notes: tuple[str, ...] = (),
    skip_bad: bool = False,
    **attributes: str,
) -> Dataset:
    """Open a dataset of files; only file names and the label table are read.

    Parameters
    ----------
    reading : FileReading
        Keys of the card that describe the files.
    root : Path
        Folder of the files.
    ignored : collection of str
        Relative names of files that are not recordings and are left out without a note.
    notes, skip_bad, **attributes
        Attributes of the `Dataset`.

    Raises
    ------
    RecordingError
        If no file matches, or a recording id occurs twice.
    CardError
        If the label table lacks a column or a recording.
    """
    table = reading.labels
    labels = Labels.read((root / table.file).resolve(), table) if table else None
    table_files = [table.file] if table else []
    candidates = _recording_candidates(root, table_files)
    unmatched = candidates.difference(ignored)
    left_out: list[str] = []
    entries: list[Entry] = []
    marks: dict[str, PhasesFile] = {}
    for names, groups in _match_files(reading, candidates, ignored):
        unmatched -= set(names)
        try:
            if marked := find_phases_file(root / names[0]):
                marks[names[0]] = marked
            is_marked = marked is not None and bool(marked.surfaces)
            entries += _entries(reading, root, names, groups, labels, is_marked=is_marked)
        except RecordingError as error:
            if not skip_bad:
                raise
            left_out.append(f"left out: {error}")
    if not entries and not left_out:
        example = f": {min(unmatched)!r} does not match {reading.files[0]!r}" if unmatched else ""
        expected = "at least one file that matches `files` of the card"
        raise reader_error(root, f"it contains no recordings{example}", expected)
    _check_names(entries, root)
    contents = {entry: _content_files(root, entry) for entry in entries}
    phases_files = [Path(os.path.relpath(phases_path(root / name), root)).as_posix() for name in marks]
    files = [*table_files, *phases_files, *(name for names in contents.values() for name in names)]
    digests = file_digests(root, files)
    keys = {
        entry: (*(digests[name] for name in names), entry.topic or "") for entry, names in contents.items()
    }
    copies, copy_notes = _find_copies(keys)
    entries = [part for entry in entries for part in _parts(entry, marks.get(entry.paths[0]))]
    file_notes = [
        *similar_label_notes(entry.surface for entry in entries),
        *_unmatched_file_notes(reading, candidates - unmatched, unmatched),
    ]
    if table and isinstance(reading, FileCard) and is_outside(root / table.file, (root,)):
        file_notes.append(f"the label table {table.file!r} is outside the folder of the recordings")
    unused_rows = sorted(set(labels.rows).difference(labels.recording_ids)) if labels else []
    file_notes += [f"{name} is in the label table, but has no file" for name in unused_rows]
    if marks:
        file_notes.append(marked_note(len(marks), "file"))
    return Dataset(
        entries=tuple(entries),
        load=partial(load_files, reading, root),
        input_hash=combine_digests(digests, reading.hash_input),
        notes=(*notes, *file_notes, *left_out, *copy_notes),
        skip_bad=skip_bad,
        copies=copies,
        **attributes,
    )


def _recording_candidates(root: Path, table_files: Collection[str]) -> set[str]:
    """Return the relative names of the files that may be recordings; label tables are left out."""
    candidates = {path.relative_to(root).as_posix() for path in data_files(root)}
    candidates -= bag_parts(candidates).union(table_files)
    by_normal_form: dict[str, str] = {}
    for name in sorted(candidates, reverse=True):
        if (other := by_normal_form.setdefault(normalize_name(name), name)) != name:
            raise RecordingError(
                f"{root} contains {other!a} and {name!a}, one name in two Unicode normal forms. "
                "Expected different names: rename or remove one"
            )
    return candidates


def _content_files(root: Path, entry: Entry) -> list[str]:
    """Return the files with the content of a recording, including the storage files of a bag folder."""
    names = list(entry.paths)
    for folder in [(root / name).parent for name in names if PurePosixPath(name).name == BAG_METADATA]:
        names += [
            file.relative_to(root).as_posix()
            for file in sorted(folder.iterdir())
            if storage_suffix(file.name) in STORAGE_SUFFIXES and not is_hidden(file.name)
        ]
    return names


def _find_copies(keys: Mapping[Entry, Hashable]) -> tuple[tuple[tuple[Entry, ...], ...], list[str]]:
    """Return groups of recordings with equal keys (identical content), and notes for the user."""
    entries_by_key: dict[Hashable, tuple[Entry, ...]] = {}
    for entry, key in keys.items():
        entries_by_key[key] = (*entries_by_key.get(key, ()), entry)
    copies = tuple(group for group in entries_by_key.values() if len(group) > 1)
    notes = []
    for has_several_labels, suffix in ((True, " but a different label"), (False, "")):
        groups = [
            group for group in copies if (len({entry.surface for entry in group}) > 1) == has_several_labels
        ]
        if groups:
            names = ", ".join(repr(entry.recording_id) for entry in groups[0])
            n = sum(map(len, groups))
            problem = f"{counted(n, 'recording')} have the same content as another{suffix}"
            notes.append(f"{problem}, for example {names}")
    return copies, notes


def _unmatched_file_notes(reading: FileReading, used: set[str], unmatched: set[str]) -> list[str]:
    """Return a note on files that are left out although files of the same format are recordings."""
    suffixes = {PurePosixPath(name).suffix.lower() for name in used}
    left_out = [name for name in unmatched if PurePosixPath(name).suffix.lower() in suffixes]
    if not left_out:
        return []
    is_card = isinstance(reading, FileCard)
    hint = f"change `files`, {reading.files[0]!r}," if is_card else "move it to the folder of a surface"
    return [f"{counted(len(left_out), 'file')} left out, for example {min(left_out)!r}: {hint} to include it"]


def load_row(card: RowCard, where: str, samples: Mapping[str, Samples], entry: Entry) -> Recording:
    """Return the recording stored in one row of the tables.

    Parameters
    ----------
    card : RowCard
        Card of the dataset.
    where : str
        File of the first channel, for messages.
    samples : mapping of str to ndarray of shape (n_samples, n_channels)
        Samples by recording id, in the order of the rows.
    entry : Entry
        Labels of the recording.

    Raises
    ------
    RecordingError
        If the recording is invalid.
    """
    row = 1 + list(samples).index(entry.recording_id)
    rows = samples[entry.recording_id]
    signals = ReadSignals({ACCELERATION: rows}, channels=tuple(f"c{i + 1}" for i in range(rows.shape[1])))
    return _build_recording(signals, card, entry, f"{where} row {row}")


def open_rows(card: RowCard, root: Path, **attributes: Any) -> Dataset:
    """Open a dataset with one recording per row; its tables are small and are read immediately.

    Parameters
    ----------
    card : RowCard
        Card with one file per channel.
    root : Path
        Folder of the files.
    **attributes
        Attributes of the `Dataset`.

    Raises
    ------
    RecordingError
        If a file is unreadable, or the files differ in shape or labels.
    """
    (labels, first), *others = [_read_rows(root / name, card.label_column) for name in card.files]
    if "" in labels:
        row = labels.index("") + 2
        raise CardError(f"{root / card.files[0]}: row {row} has a blank label. Expected a name")
    for name, (other_labels, values) in zip(card.files[1:], others, strict=True):
        if other_labels != labels or values.shape != first.shape:
            raise RecordingError(
                f"{root / name}: its values have shape {values.shape}, those of {card.files[0]} have shape "
                f"{first.shape}, or the labels differ. Expected the same rows and labels in every file"
            )
    repetitions: Counter[str] = Counter()
    entries = []
    for label in labels:
        repetitions[label] += 1
        k = repetitions[label]
        entries.append(Entry(f"{label}_{k:02d}", label, repetition=k, paths=card.files))
    samples = np.stack([first, *(values for _, values in others)], axis=-1)
    _check_names(entries, root)
    ids = [entry.recording_id for entry in entries]
    copies, copy_notes = _find_copies(dict(zip(entries, map(np.ndarray.tobytes, samples), strict=True)))
    return Dataset(
        entries=tuple(entries),
        load=partial(load_row, card, str(root / card.files[0]), dict(zip(ids, samples, strict=True))),
        input_hash=digest_files(root, card.files, card.hash_input),
        **attributes | {"notes": (*attributes.get("notes", ()), *copy_notes), "copies": copies},
    )


def match_name(patterns: Sequence[str], name: str) -> tuple[Groups, str] | None:
    """Match the relative name of a file against patterns; the first match of the whole name is used.

    Parameters
    ----------
    patterns : sequence of str
        Regular expressions with named groups.
    name : str
        Relative name of the file, compared in Unicode normal form C.

    Returns
    -------
    groups : dict of str to str
        Values of the groups.
    name_without_axis : str
        Name without the group `axis`, which is the same for all axes of a recording.
        The function returns None if no pattern matches.

    Examples
    --------
    >>> match_name([r"(?P<surface>[a-z]+)_(?P<axis>[XYZ])[.]txt"], "oak_X.txt")
    ({'surface': 'oak', 'axis': 'X'}, 'oak.txt')
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
    """Match a pattern against a whole name, within a time limit."""
    import regex  # takes 0.1 s, only needed for cards

    try:
        return regex.fullmatch(normalize_name(pattern), name, timeout=MATCH_TIMEOUT_S)
    except (TimeoutError, regex.error) as error:
        raise CardError(
            f"files or topic contains {pattern!r:.200}, which is invalid or takes more than "
            f"{MATCH_TIMEOUT_S:g} s for {name!r:.200} ({error}). Expected a pattern without nested "
            "repetitions such as (a+)+"
        ) from error


def bag_parts(files: Iterable[str]) -> set[str]:
    """Return the files that are not recordings themselves, but belong to bag folders.

    In a folder with storage files, `metadata.yaml` represents the bag. In other folders, a file of that name
    does not belong to a bag.
    """
    paths = [PurePosixPath(name) for name in files]
    storage_files = {path for path in paths if storage_suffix(path.name) in STORAGE_SUFFIXES}
    storage_folders = {path.parent for path in storage_files}
    metadata_folders = {path.parent for path in paths if path.name == BAG_METADATA}
    return {
        str(path)
        for path in paths
        if (path in storage_files and path.parent in metadata_folders)
        or (path.name == BAG_METADATA and path.parent not in storage_folders)
    }


def condition_recording(
    recording: Recording,
    scale: float,
    phases: DeclaredPhases,
    *,
    remove_resting_level: bool,
    turn_rate_scale: float = 1.0,
) -> Recording:
    """Scale a recording, remove its resting level, and set its phases as a card declares.

    Parameters
    ----------
    recording : Recording
        Recording with stored values.
    scale, turn_rate_scale : float
        Factors of acceleration and turn rate.
    phases : {"detect", "movement", "tap", "taps"}
        Content that the card declares.
    remove_resting_level : bool
        Subtract the median of each channel.
    """
    acceleration = recording.acceleration
    if scale != 1.0:
        acceleration = acceleration * scale
    if remove_resting_level:
        acceleration = acceleration - np.median(acceleration, axis=0)
    n = len(acceleration)
    declared_phases = None
    if phases == "movement":
        declared_phases = Phases(
            movement=(0, n), notes=("the card declares the whole recording as movement",)
        )
    elif phases == "tap":
        declared_phases = Phases(
            taps=(Tap(0, find_contact(acceleration), n),), notes=("the card declares one tap",)
        )
    turn_rate = recording.turn_rate
    if turn_rate is not None and turn_rate_scale != 1.0:
        turn_rate = turn_rate * turn_rate_scale
    settings = replace(recording.phase_settings, contents="taps") if phases == "taps" else PhaseSettings()
    return recording.with_(
        acceleration=acceleration, turn_rate=turn_rate, phases=declared_phases, phase_settings=settings
    )


def find_contact(acceleration: Samples) -> int:
    """Return the index of the first sample of contact in a recording of one tap.

    This is the first sample at which any channel changes by more than a tenth of its largest change between
    consecutive samples. Differences, unlike levels, do not depend on the resting level of a channel.

    Parameters
    ----------
    acceleration : ndarray of shape (n,) or (n, n_channels)
        Acceleration of one tap, in any unit.

    Examples
    --------
    >>> import numpy as np
    >>> find_contact(np.array([5.0, 5.1, 5.0, 9.0, 2.0, 5.0]))
    3
    """
    change = np.abs(np.diff(acceleration.reshape(len(acceleration), -1), axis=0))
    is_large = (change > 0.1 * change.max(axis=0)).any(axis=1)  # above noise, below the impact
    return 1 + int(np.argmax(is_large))


def _build_recording(signals: ReadSignals, reading: Reading, entry: Entry, source: str) -> Recording:
    options = {name: getattr(entry, name) for name in ("recording_id", *GROUPS)}
    if isinstance(reading, FileReading):
        options |= {"resample": reading.resample_hz, "rate_of": reading._rate_of}
    recording = build_recording(
        signals, fs=reading.fs_hz, unit=reading.unit, source=source, scale=reading.scale, **options
    )
    return condition_recording(
        recording,
        reading.scale,
        reading.phases,
        remove_resting_level=reading.remove_resting_level,
        turn_rate_scale=reading.turn_rate_scale,
    )


def _check_names(entries: Sequence[Entry], root: Path) -> None:
    """Check that there are recordings, that their names are printable, and that their ids are unique."""
    if not entries:
        raise reader_error(root, "it contains no recordings", "at least one file that matches the card")
    entry_by_id: dict[str, Entry] = {}
    for entry in entries:
        names = (
            entry.recording_id,
            entry.surface,
            entry.operator,
            entry.session,
            *dict(entry.labels).values(),
        )
        if unprintable := next((name for name in names if name and not name.isprintable()), None):
            problem = f"the name {unprintable!r} contains a control character"
            raise reader_error(root, problem, "printable names: rename the file")
        if (first := entry_by_id.setdefault(entry.recording_id, entry)) is not entry:
            files = ", ".join((*first.paths, *entry.paths))
            raise reader_error(
                root,
                f"recording id {entry.recording_id!r} occurs twice ({files})",
                "unique ids: rename one of them",
            )


def _match_files(
    reading: FileReading, files: set[str], ignored: Collection[str]
) -> Iterator[tuple[tuple[str, ...], Groups]]:
    """Yield the files of each recording (one, or one per axis, then companion files) and their groups.

    Ignored files are used only as companion files.
    """
    recordings: dict[str, tuple[list[str], Groups]] = {}
    # In natural order, 2 comes before 10.
    sort_keys = {
        name: [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]
        for name in files.difference(ignored)
    }
    for name in sorted(sort_keys, key=sort_keys.__getitem__):
        if (match := match_name(reading.files, name)) is not None:
            groups, common_name = match
            bag_folder = common_name.removesuffix(f"/{BAG_METADATA}")
            is_bag_folder = bag_folder != common_name
            groups.setdefault("recording", bag_folder if is_bag_folder else common_name.rpartition(".")[0])
            recordings.setdefault(common_name, ([], groups))[0].append(name)
    by_name = {normalize_name(name): name for name in files}
    for names, groups in recordings.values():
        companions = (
            [by_name[name] for name in candidates if name in by_name]
            for candidates in _companion_names(reading, groups).values()
        )
        yield (*names, *(matches[0] for matches in companions if matches)), groups


def _companion_names(reading: FileReading, groups: Groups) -> dict[str, tuple[str, ...]]:
    """Return the possible relative file names of each auxiliary signal, with groups replaced by values."""
    return {
        signal: tuple(
            normalize_name(re.sub(r"\{(\w+)\}", lambda match: groups.get(match[1], match[0]), template))
            for template in templates
        )
        for signal, templates in reading.companions.items()
    }


def _entries(
    reading: FileReading,
    root: Path,
    names: tuple[str, ...],
    groups: Groups,
    labels: Labels | None,
    *,
    is_marked: bool,
) -> Iterator[Entry]:
    """Yield the recordings in a file: one, or one per matching topic of a bag.

    The card key `topic` is a pattern if it has named groups, otherwise the name of a topic. If surfaces are
    marked in the recording (`is_marked`), the label table may lack it.
    """
    path, pattern = root / names[0], reading.topic
    renamed = {normalize_name(name): surface for name, surface in reading.surfaces.items()}
    by_topic: dict[str | None, Groups] = {None: groups}
    if pattern and is_topic_pattern(pattern) and is_bag(path):
        by_topic = {
            name: groups | {"recording": f"{groups['recording']}/{name.strip('/')}"} | topic_groups
            for name, topic_groups in matching_topics(path, pattern).items()
        }
    for topic, topic_groups in by_topic.items():
        recording_id = topic_groups["recording"]
        all_groups = dict(topic_groups)
        try:
            all_groups |= labels.groups_of(recording_id, names, root.name) if labels else {}
        except RecordingError:
            if not is_marked:
                raise
        repetition = all_groups.get("repetition")
        if repetition is not None and not repetition.isdecimal():
            raise CardError(f"{path}: repetition is {repetition!r}. Expected a whole number")
        if "surface" not in all_groups and not is_marked:
            expected = f"a surface in the name of the file, the label table or {phases_path(path).name}"
            raise reader_error(path, "no surface", expected)
        surface = normalize_name(all_groups.get("surface", ""))
        yield Entry(
            recording_id=recording_id,
            surface=renamed.get(surface, surface),
            operator=all_groups.get("operator"),
            session=all_groups.get("session"),
            repetition=int(repetition) if repetition is not None else None,
            paths=names,
            topic=topic,
            labels=tuple((name, all_groups.get(name, "")) for name in reading.label_names),
        )


def matching_topics(path: Path, pattern: str) -> dict[str, Groups]:
    """Return the values of the groups of a pattern, by topic of a bag that matches it.

    Raises
    ------
    RecordingError
        If no topic matches, or the bag cannot be read.
    """
    names = topics(path)
    matches = {name: match for name in sorted(names) if (match := _match(pattern, name))}
    if not matches:
        expected = f"a pattern that matches some of {', '.join(names)}"
        raise reader_error(path, f"no topic matches {pattern!r}", expected)
    return {
        name: {group: text for group, text in match.groupdict().items() if text is not None}
        for name, match in matches.items()
    }


def _parts(entry: Entry, marked: PhasesFile | None) -> list[Entry]:
    """Return an entry for each surface that is marked in a recording, or the entry itself."""
    if marked is None or not marked.surfaces:
        return [entry]
    return [
        replace(entry, recording_id=f"{entry.recording_id}#{number}", surface=one.surface, part=number)
        for number, one in enumerate(marked.surfaces, start=1)
    ]


def _read_rows(path: Path, label_column: str) -> tuple[tuple[str, ...], Samples]:
    """Read the file of one channel. Return labels, and values of shape (n_recordings, n_samples)."""
    import pandas as pd

    try:
        table = pd.read_csv(path)
        table.pop(label_column)
        # Labels are text exactly as in the file: "001" is not 1, and "NA" is not a missing value.
        texts = pd.read_csv(path, usecols=[label_column], dtype=str, keep_default_na=False)
        labels = tuple(texts[label_column].str.strip())
        return labels, table.to_numpy(dtype=np.float64)
    except FileNotFoundError as error:
        raise reader_error(path, "the file is missing", "one file per channel, as in the card") from error
    except KeyError as error:
        raise reader_error(
            path, f"no column {label_column!r}", "the column given by the key label_column"
        ) from error
    except (ValueError, TypeError, OverflowError, OSError) as error:
        problem = f"cannot be read as a table ({error})"
        raise reader_error(path, problem, "columns of numbers and one column of labels") from error
