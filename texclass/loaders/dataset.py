"""Datasets that keep all labels in memory and load the signals of one recording at a time."""

import difflib
import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import TYPE_CHECKING, Any

from texclass.loaders.data_files import normalize_name
from texclass.recording import Recording, RecordingError

if TYPE_CHECKING:
    import pandas as pd

GROUPS = ("surface", "operator", "session", "repetition")
"""Label and groups that every recording has; a dataset can have further labels."""


@dataclass(frozen=True)
class Entry:
    """Labels and files of a recording that is not loaded yet.

    Attributes
    ----------
    recording_id
        Identifier, unique within the dataset.
    surface
        Class label.
    operator, session, repetition
        Groups; None if unknown.
    paths
        Files relative to the dataset's folder; empty for simulated recordings.
    topic
        Topic of a bag with several recordings.
    labels
        Further labels, such as the speed, as pairs of name and value. The value is "" if it is missing.
    part
        Number of the marked surface in the files, from 1; 0 (default) for the whole recording. Parts have the
        id of the whole recording with "#" and this number.

    Examples
    --------
    >>> entry = Entry("oak_01", "oak", repetition=1, labels=(("speed", "20"),))
    >>> entry.surface, dict(entry.labels)
    ('oak', {'speed': '20'})
    """

    recording_id: str
    surface: str
    operator: str | None = None
    session: str | None = None
    repetition: int | None = None
    paths: tuple[str, ...] = ()
    topic: str | None = None
    labels: tuple[tuple[str, str], ...] = ()
    part: int = 0

    @property
    def whole_id(self) -> str:
        """Id of the whole recording."""
        return self.recording_id.removesuffix(f"#{self.part}") if self.part else self.recording_id

    def __post_init__(self) -> None:
        for name in ("recording_id", "surface", "operator", "session"):
            if (text := getattr(self, name)) is not None:
                object.__setattr__(self, name, normalize_name(text))
        labels = tuple((normalize_name(name), normalize_name(value)) for name, value in self.labels)
        object.__setattr__(self, "labels", labels)


def label_columns(entries: Sequence[Entry]) -> dict[str, list[str | None]]:
    """Return the values of each further label of some recordings, None where it is missing.

    Examples
    --------
    >>> label_columns([Entry("a", "oak", labels=(("speed", "20"),)), Entry("b", "oak")])
    {'speed': ['20', None]}
    """
    labels = [dict(entry.labels) for entry in entries]
    names = dict.fromkeys(name for values in labels for name in values)
    return {name: [values.get(name) or None for values in labels] for name in names}


@dataclass(frozen=True)
class LoadWithSettings:
    """Picklable function that loads a recording and changes its segmentation settings."""

    load: Callable[[Entry], Recording]
    changes: Mapping[str, Any]
    override: bool

    def __call__(self, entry: Entry) -> Recording:
        """Return the recording of an entry with changed settings."""
        recording = self.load(entry)
        settings = replace(recording.phase_settings, **self.changes)
        if not self.override:
            settings = replace(settings, **recording.phase_settings.changes)
        return recording.with_(phase_settings=settings)


@dataclass(frozen=True, eq=False, repr=False)
class Dataset(Sequence[Recording]):
    """Sequence of recordings that are loaded on access and not cached.

    Parameters
    ----------
    name : str
        Name of the card or folder.
    entries : tuple of Entry
        Labels and files, one per recording, in a fixed order.
    load : callable
        Function that loads the recording of an entry, or raises RecordingError if the recording is invalid. A
        dataset is picklable if this function is picklable.
    input_hash : str
        Hex digest that changes when any recording changes.
    title, licence, source : str
        Keys of the card.
    notes : tuple of str
        Remarks on the dataset, shown in every report.
    skip_bad : bool
        Let `attempt` return the error of an invalid recording instead of raising it (default False).
    copies : tuple of tuple of Entry
        Groups of entries with identical content. Copies in both the training set and the test set would
        inflate the accuracy.

    Examples
    --------
    >>> from texclass.loaders import open_dataset
    >>> dataset = open_dataset("simulated6")
    >>> dataset
    <Dataset 'simulated6': 72 recordings, 6 surfaces, 4 operators>
    >>> dataset.table.loc["wood-03-01", "surface"]
    'wood-03'
    """

    name: str
    entries: tuple[Entry, ...]
    load: Callable[[Entry], Recording]
    input_hash: str
    title: str = ""
    licence: str = ""
    source: str = ""
    notes: tuple[str, ...] = ()
    skip_bad: bool = False
    copies: tuple[tuple[Entry, ...], ...] = ()

    def __len__(self) -> int:
        return len(self.entries)

    def __getitem__(self, index: int) -> Recording:  # type: ignore[override]
        return self.load(self.entries[index])

    def __iter__(self) -> Iterator[Recording]:
        return (self.load(entry) for entry in self.entries)

    def attempt(self, entry: Entry) -> Recording | RecordingError:
        """Return the recording of an entry or, with `skip_bad`, the error if the recording is invalid."""
        try:
            return self.load(entry)
        except RecordingError as error:
            if not self.skip_bad:
                raise
            return error

    def find(self, recording_id: str) -> Recording:
        """Return the recording with the given id.

        Raises
        ------
        RecordingError
            If there is no such recording, or it is invalid.
        """
        ids, wanted = [entry.recording_id for entry in self.entries], normalize_name(recording_id)
        parts = (entry for entry in self.entries if entry.part and entry.whole_id == wanted)
        if part := next(parts, None):  # a recording of several marked surfaces as a whole
            return self.load(replace(part, recording_id=wanted, part=0)).with_(surface=None)
        if wanted not in ids:
            similar_ids = ", ".join(difflib.get_close_matches(wanted, ids, n=3) or ids[:3])
            raise RecordingError(
                f"{self.name}: there is no recording {wanted!r}. Expected an id such as {similar_ids}"
            )
        return self[ids.index(wanted)]

    def with_phase_settings(self, changes: Mapping[str, Any], *, override: bool = True) -> "Dataset":
        """Return a copy of the dataset with changed segmentation settings.

        Parameters
        ----------
        changes : mapping of str to Any
            New values by field name of `PhaseSettings`.
        override : bool
            Also replace settings that differ from the default in a recording (default True).

        Returns
        -------
        Dataset
            Dataset with the same entries and a different `input_hash`.
        """
        if not changes:
            return self
        digest = hashlib.sha256(f"{self.input_hash} {sorted(changes.items())} {override}".encode())
        load = LoadWithSettings(self.load, changes, override)
        return replace(self, load=load, input_hash=digest.hexdigest())

    @property
    def table(self) -> "pd.DataFrame":
        """Surface, operator, session, repetition and further labels: one row per recording.

        The index is `recording_id`.
        """
        import pandas as pd

        index = pd.Index([entry.recording_id for entry in self.entries], name="recording_id")
        columns = {name: [getattr(entry, name) for entry in self.entries] for name in GROUPS}
        columns |= label_columns(self.entries)
        return pd.DataFrame(columns, index).astype({"repetition": "Int64"})

    @property
    def labels(self) -> "pd.Series[str]":
        """Surface of every recording, indexed by `recording_id`: the target y of scikit-learn."""
        return self.table["surface"]

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Distinct surface labels, sorted."""
        return tuple(sorted({entry.surface for entry in self.entries}))

    def __repr__(self) -> str:
        """Return a one-line summary: name, and numbers of recordings and of values of the labels."""
        counts = {"recording": len(self)}
        for name in ("surface", "operator", "session"):
            counts[name] = len({getattr(entry, name) for entry in self.entries} - {None})
        summary = ", ".join(f"{n} {name}{'s' * (n > 1)}" for name, n in counts.items() if n)
        further = {name: len({*values} - {None}) for name, values in label_columns(self.entries).items()}
        labels = ", ".join(f"{name} ({n})" for name, n in further.items() if n > 1)
        return f"<Dataset {self.name!r}: {summary}{f'; values of {labels}' if labels else ''}>"

    def _repr_html_(self) -> str:
        """Return title, size and the first rows of the table for notebooks."""
        head = f"<p><strong>{escape(self.title or self.name)}</strong><br>{escape(repr(self))}</p>"
        table = self.table.dropna(axis=1, how="all").astype(object)
        return head + table.where(table.notna(), "").to_html(max_rows=10, border=0)
