"""A dataset: the facts of every recording at hand, the recordings themselves loaded one at a time."""

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
"""What recordings are told apart by: the label, and what is known of who made them and when."""


@dataclass(frozen=True)
class Entry:
    """What is known of a recording before it is loaded.

    Attributes
    ----------
    recording_id
        Unique within the dataset.
    surface
        The label.
    operator, session, repetition
        Groups, as far as they are known.
    paths
        The file(s) it comes from, relative to the dataset's root; empty for simulated recordings.
    topic
        Of a bag that holds several recordings.
    """

    recording_id: str
    surface: str
    operator: str | None = None
    session: str | None = None
    repetition: int | None = None
    paths: tuple[str, ...] = ()
    topic: str | None = None

    def __post_init__(self) -> None:
        for name in ("recording_id", "surface", "operator", "session"):
            if (text := getattr(self, name)) is not None:
                object.__setattr__(self, name, normalize_name(text))


@dataclass(frozen=True)
class LoadWithSettings:
    """Load a recording and change its settings of segmentation."""

    load: Callable[[Entry], Recording]
    changes: Mapping[str, Any]
    override: bool

    def __call__(self, entry: Entry) -> Recording:
        """Return the recording of an entry."""
        recording = self.load(entry)
        settings = replace(recording.phase_settings, **self.changes)
        if not self.override:
            settings = replace(settings, **recording.phase_settings.changes)
        return recording.with_(phase_settings=settings)


@dataclass(frozen=True, eq=False, repr=False)
class Dataset(Sequence[Recording]):
    """A lazy sequence of recordings; indexing loads one and keeps nothing. Picklable when `load` is.

    Parameters
    ----------
    name : str
        Name of the card, or of the folder.
    entries : tuple of Entry
        One a recording, in a fixed order.
    load : callable
        Entry -> Recording; raises RecordingError for a bad one.
    input_hash : str
        Hex digest that changes when any recording changes.
    title, licence, source : str
        From the card.
    notes : tuple of str
        What a report must say of this dataset.
    skip_bad : bool
        Let `attempt` return the error of a bad recording instead of raising it.
    copies : tuple of tuple of Entry
        Entries with the same content, together: on both sides of a split they would make an accuracy too
        high.
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
        """Load a recording; if it is bad, return the error when `skip_bad`, else raise it."""
        try:
            return self.load(entry)
        except RecordingError as error:
            if not self.skip_bad:
                raise
            return error

    def with_phase_settings(self, changes: Mapping[str, Any], *, override: bool = True) -> "Dataset":
        """Return the dataset with other settings of segmentation, by their names in `PhaseSettings`.

        Settings that its recordings change themselves are kept unless `override` is true.
        """
        if not changes:
            return self
        digest = hashlib.sha256(f"{self.input_hash} {sorted(changes.items())} {override}".encode())
        load = LoadWithSettings(self.load, changes, override)
        return replace(self, load=load, input_hash=digest.hexdigest())

    @property
    def table(self) -> "pd.DataFrame":
        """One row a recording, indexed by `recording_id`: surface, operator, session, repetition."""
        import pandas as pd

        index = pd.Index([entry.recording_id for entry in self.entries], name="recording_id")
        told = {name: [getattr(entry, name) for entry in self.entries] for name in GROUPS}
        return pd.DataFrame(told, index).astype({"repetition": "Int64"})

    @property
    def labels(self) -> "pd.Series[str]":
        """The surface of every recording, indexed by `recording_id`: what scikit-learn calls y."""
        return self.table["surface"]

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Distinct labels, sorted."""
        return tuple(sorted({entry.surface for entry in self.entries}))

    def __repr__(self) -> str:
        """Return one line."""
        counts = {"recording": len(self)}
        for name in ("surface", "operator", "session"):
            counts[name] = len({getattr(entry, name) for entry in self.entries} - {None})
        told = ", ".join(f"{n} {name}{'s' * (n > 1)}" for name, n in counts.items() if n)
        return f"<Dataset {self.name!r}: {told}>"

    def _repr_html_(self) -> str:
        """Return title, size and the first rows of the table for notebooks."""
        head = f"<p><strong>{escape(self.title or self.name)}</strong><br>{escape(repr(self))}</p>"
        return head + self.table.to_html(max_rows=10, na_rep="", border=0)
