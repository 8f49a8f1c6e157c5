"""Datasets in which a recording is a row of a CSV file, and each channel has a file of its own."""

import functools
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from texclass.loaders.cards import RowCard
from texclass.loaders.columns import UNNAMED
from texclass.loaders.dataset import Dataset, Entry
from texclass.loaders.filesets import check_ids, conditioned
from texclass.loaders.places import digest_files
from texclass.loaders.single import Signals, build_recording
from texclass.recording import Recording, RecordingError, Samples


@dataclass(frozen=True)
class RowLoader:
    """Loads the recordings of a card of rows; a `Dataset`'s `load`, picklable.

    Parameters
    ----------
    reading : RowCard
        Which files hold the channels.
    root : Path
        Folder of the files.
    rows : mapping of str to int
        Recording id -> row.
    """

    reading: RowCard
    root: Path
    rows: dict[str, int]

    def __call__(self, entry: Entry) -> Recording:
        """Load one recording.

        Raises
        ------
        RecordingError
            If it is bad; the message names file, value and rule.
        """
        card, row = self.reading, self.rows[entry.recording_id]
        source = f"{self.root / card.files[0]} row {row + 1}"
        samples = np.column_stack([table[row] for table in _tables(card, self.root)[1]])
        channels = tuple(f"c{i + 1}" for i in range(len(card.files)))
        recording = build_recording(
            Signals({UNNAMED: samples}, channels, None),
            fs=card.fs_hz,
            unit=card.unit,
            source=source,
            recording_id=entry.recording_id,
            material=entry.material,
            repetition=entry.repetition,
        )
        return conditioned(recording, card.scale, card.phases, remove_resting_level=card.remove_resting_level)


def open_rows(card: RowCard, root: Path, **about: Any) -> Dataset:
    """Return the dataset of a card of rows; `about` is what else a `Dataset` holds.

    Raises
    ------
    RecordingError
        If a file is unreadable, or the files disagree in rows or labels.
    """
    labels, _ = _tables(card, root)
    seen: Counter[str] = Counter()
    entries = []
    for label in labels:
        seen[label] += 1
        entries.append(Entry(f"{label}_{seen[label]:02d}", label, repetition=seen[label], paths=card.files))
    check_ids(entries, root)
    return Dataset(
        entries=tuple(entries),
        load=RowLoader(card, root, {entry.recording_id: row for row, entry in enumerate(entries)}),
        input_hash=digest_files(root, card.files, card.facts),
        **about,
    )


def _tables(card: RowCard, root: Path) -> tuple[tuple[str, ...], list[Samples]]:
    """Return the labels, and one array of shape (n_recordings, n_samples) per channel."""
    parts = []
    for name in card.files:
        path = root / name
        if not path.is_file():
            raise RecordingError(f"{path}: is missing; the rule is one file per channel, as the card says")
        parts.append(_read_table(path, path.stat().st_mtime_ns, card.label_column))
    labels, first = parts[0]
    for name, (others, values) in zip(card.files, parts, strict=True):
        if others != labels or values.shape != first.shape:
            raise RecordingError(
                f"{root / name}: has {values.shape} values, {card.files[0]} {first.shape}, or other labels; "
                "the rule is the same rows and labels in every channel's file"
            )
    return labels, [values for _, values in parts]


@functools.lru_cache(maxsize=16)
def _read_table(path: Path, modified_ns: int, label_column: str) -> tuple[tuple[str, ...], Samples]:
    """Read a channel's file; tables are small, so the last few stay in memory."""
    import pandas as pd

    try:
        table = pd.read_csv(path)
        labels = tuple(table.pop(label_column).astype(str))
        values = table.to_numpy(dtype=np.float64)
    except KeyError as error:
        raise RecordingError(f"{path}: lacks the column {label_column!r} of the labels") from error
    except (ValueError, TypeError, OverflowError, OSError) as error:
        raise RecordingError(f"{path}: is not a table of numbers and labels ({error})") from error
    values.flags.writeable = False
    return labels, values
