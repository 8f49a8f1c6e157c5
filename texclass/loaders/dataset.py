"""A dataset: the facts of every recording at hand, the recordings themselves loaded one at a time."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from texclass.recording import Recording, RecordingError


@dataclass(frozen=True)
class Entry:
    """What is known of a recording before it is loaded.

    Attributes
    ----------
    recording_id
        Unique within the dataset.
    material
        The label.
    operator, session, repetition
        Groups, as far as they are known.
    paths
        The file(s) it comes from, relative to the dataset's root; empty for simulated recordings.
    topic
        Of a bag that holds several recordings.
    """

    recording_id: str
    material: str
    operator: str | None = None
    session: str | None = None
    repetition: int | None = None
    paths: tuple[str, ...] = ()
    topic: str | None = None


@dataclass(frozen=True, eq=False)
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

    def attempts(self) -> Iterator[tuple[Entry, Recording | RecordingError]]:
        """Yield every entry with its recording or, when `skip_bad`, the error that keeps it out."""
        return ((entry, self.attempt(entry)) for entry in self.entries)

    @property
    def materials(self) -> tuple[str, ...]:
        """Distinct labels, sorted."""
        return tuple(sorted({entry.material for entry in self.entries}))
