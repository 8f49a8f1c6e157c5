"""Dataset cards: what a TOML file says of a dataset, one model for each format of datasets."""

import re
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from annotated_types import Predicate
from pydantic import BeforeValidator, Field, PrivateAttr, RootModel, model_validator

from texclass import shipped
from texclass.loaders.dataset import GROUPS
from texclass.loaders.readers import COMMENT_PATTERN, TIME_UNITS, ReaderSettings
from texclass.phase_settings import PhaseSettings
from texclass.recording import AUXILIARY_UNITS, Unit
from texclass.simulate.recipe import Recipe
from texclass.validation import StrictModel, read_toml, validate

PATTERN_GROUPS = ("recording", *GROUPS, "axis")
"""Groups of a pattern of file names, and (but for the axis) of a table of labels."""
MAX_MAGNITUDE = 1e100
"""Rates and factors beyond it are no measurement's."""
Convert = Literal["", "frames", "rounded", "counts", "sheets"]
DeclaredPhases = Literal["detect", "movement", "tap", "taps"]
if TYPE_CHECKING:
    Signal = str
    Role = str
    TimeUnit = str
else:  # each is listed once, elsewhere
    Signal = Literal[*AUXILIARY_UNITS]
    TimeUnit = Literal[*TIME_UNITS]
    Role = Literal["acceleration", *AUXILIARY_UNITS]


Texts = Annotated[
    tuple[str, ...],
    BeforeValidator(lambda given: (given,) if isinstance(given, str) else given),
    BeforeValidator(lambda given: tuple(given) if isinstance(given, list) else given),
    Field(min_length=1, description="text or a list of text"),
]
"""One text, or several."""


def _as_column_texts(given: Any) -> Any:
    """Return columns as text, also those that are told by number."""
    listed = given if isinstance(given, list | tuple) else [given]
    return tuple(str(one) if isinstance(one, int) and one is not True else one for one in listed)


Factor = Annotated[
    float,
    Predicate(bool),
    Field(ge=-MAX_MAGNITUDE, le=MAX_MAGNITUDE, description="a finite factor other than 0"),
]
Columns = Annotated[
    tuple[str, ...],
    BeforeValidator(_as_column_texts),
    Field(min_length=1, description="a column or a list of columns, by name or by number from 1"),
]
"""Columns of a file."""


class CardError(ValueError):
    """A dataset card breaks a rule; the message names the file, the key and the rule."""


class Card(StrictModel):
    """What every card says; each format has a class of its own.

    Attributes
    ----------
    title, source, licence, citation
        Title (default: the name of the card), where to get it, terms of use, publication to cite.
    notes
        What a report must say: quirks, assumptions.
    phase_settings
        Settings by which phases are found; see `PhaseSettings`.
    """

    title: str = ""
    source: str = ""
    licence: str = "not stated"
    citation: str = ""
    notes: tuple[str, ...] = ()
    phase_settings: PhaseSettings = PhaseSettings()
    _path: Path = PrivateAttr(default=Path())

    @property
    def path(self) -> Path:
        """File of the card."""
        return self._path

    @property
    def name(self) -> str:
        """Name of the card."""
        return self._path.stem


class Reading(StrictModel):
    """How the values of files become recordings.

    Attributes
    ----------
    fs_hz
        Sampling rate in Hz; the one a file states must agree.
    unit
        Of the acceleration.
    files
        Which files there are.
    scale
        Factor from what is stored to `unit`.
    turn_rate_scale
        Factor from what is stored to rad/s, of a turn rate: 0.0174533 of degrees per second.
    phases
        What every recording holds: to "detect"; "movement" only (always in contact); one "tap"; or "taps"
        only, as many as are found, however long they ring.
    remove_resting_level
        Subtract each channel's median.
    """

    fs_hz: float = Field(gt=0, le=MAX_MAGNITUDE, description="a rate in Hz above 0")
    unit: Unit
    files: Texts
    scale: Factor = 1.0
    turn_rate_scale: Factor = 1.0
    phases: DeclaredPhases = "detect"
    remove_resting_level: bool = False

    @property
    def facts(self) -> str:
        """What changes a recording, as text for a digest."""
        return _hash_input(self)


def _hash_input(card: StrictModel) -> str:
    """Return the keys that are set, without those that change no recording: titles, notes, places."""
    return card.model_dump_json(exclude={*StoredCard.model_fields}, exclude_defaults=True)


class LabelTable(StrictModel):
    """A CSV beside the recordings, one row per recording.

    Attributes
    ----------
    file
        Relative to the dataset's folder.
    recording
        Column of the ids by which rows are found.
    surface, operator, session, repetition
        Columns of what the names of files do not tell.
    """

    file: str
    recording: str
    surface: str | None = None
    operator: str | None = None
    session: str | None = None
    repetition: str | None = None

    @property
    def columns(self) -> dict[str, str]:
        """Of `PATTERN_GROUPS`, which one is in which column."""
        return {group: column for group, column in self if group != "file" and column is not None}


class FileReading(Reading):
    """How files become recordings if one is a file, or a file per axis, whose name tells what it is.

    Attributes
    ----------
    files
        Patterns of relative file names, with the named groups of `PATTERN_GROUPS`.
    surfaces
        What the names tell of the surface -> what it is called; those that are not in it keep theirs.
    labels
        Table with labels and groups that the names do not tell.
    channels
        Which columns are acceleration and auxiliary signals, by name or by number from 1.
    companions
        Auxiliary signal -> names its file may have, with {group} in place of groups.
    delimiter
        Of text files.
    skip_rows
        Number of lines at the beginning of text files that are not read (default 0).
    comment
        Beginning of comment lines in text files (default: #, % and //).
    drop_incomplete
        Leave out lines of text files without a number in each column (default: they are an error).
    time_column
        Column of the time stamps, by name or number; "none" ignores all time stamps.
    time_unit
        Unit of the time stamps, by default inferred: s, ms, us, ns, min, h or days.
    resample_hz
        Rate to which recordings are brought, band-limited; then each file may state its own, and `fs_hz` is
        that of files which state none.
    topic
        Of bags: name of a topic, or a pattern of names with groups of `PATTERN_GROUPS`; each topic that
        matches is then a recording.
    trim
        Cut signals of different lengths to the shortest.
    """

    surfaces: dict[str, str] = Field(default_factory=dict)
    labels: LabelTable | None = None
    channels: dict[Role, Columns] = Field(default_factory=dict)
    companions: dict[Signal, Texts] = Field(default_factory=dict)
    delimiter: str | None = Field(default=None, pattern=r'^[^"\r\n]$', description="one character, no quote")
    skip_rows: int | None = Field(default=None, ge=0, description="a number of lines")
    comment: str | None = Field(
        default=None,
        pattern=f"^{COMMENT_PATTERN}$",
        description="1 to 8 characters, no blank, digit or quote",
    )
    drop_incomplete: bool = False
    time_column: Annotated[
        str | None, BeforeValidator(lambda given: given and _as_column_texts(given)[0])
    ] = None
    time_unit: TimeUnit | None = None
    resample_hz: float | None = Field(
        default=None, gt=0, le=MAX_MAGNITUDE, description="a rate in Hz above 0"
    )
    topic: str | None = None
    trim: bool = False
    _rate_of: str = PrivateAttr(default="")
    """File whose rate `fs_hz` is, where neither user nor card state one."""

    @property
    def settings(self) -> ReaderSettings:
        """How its files are read."""
        shared = {field.name for field in fields(ReaderSettings)} & set(FileReading.model_fields)
        fs = self.fs_hz if self.resample_hz is None else None
        return ReaderSettings(fs=fs, rate_of=self._rate_of, **{name: getattr(self, name) for name in shared})

    @model_validator(mode="after")
    def _has_surface(self) -> "FileReading":
        groups = _groups("files", self.files) | set(self.labels.columns if self.labels else ())
        if self.topic is not None:
            groups |= _groups("topic", (self.topic,))
        if "surface" not in groups:
            raise ValueError("files and labels do not define the group (?P<surface>...)")
        return self


def _groups(key: str, patterns: tuple[str, ...]) -> set[str]:
    """Return the groups of patterns; raise ValueError for an invalid pattern or an unknown group."""
    groups: set[str] = set()
    for pattern in patterns:
        try:
            groups |= set(re.compile(pattern).groupindex)
        except (re.error, OverflowError, RecursionError) as error:
            raise ValueError(f"{key} holds {pattern!r:.200}, not a regular expression ({error})") from error
    if unknown := groups - set(PATTERN_GROUPS):
        raise ValueError(
            f"{key} defines groups {sorted(unknown)}. Expected some of {', '.join(PATTERN_GROUPS)}"
        )
    return groups


class Download(StrictModel):
    """Where the files are published that `NAME.sha256`, beside the card, lists with their digests.

    Attributes
    ----------
    url
        What stands before their names there; of one commit or record that does not change.
    convert
        What is done to each of them (`published.converted`); by default nothing.
    sha256
        Over the names and digests of the files that come of it, those that the card reads.
    """

    url: str = Field(pattern=r"^https?://.+/$", description="an address that ends in /")
    convert: Convert = ""
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$", description="64 hexadecimal digits")


class StoredCard(Card):
    """A card of recordings that are stored.

    Attributes
    ----------
    folder
        Folder under the data root (default: the folder of the card itself).
    published
        From where `texclass datasets get` fetches them.
    """

    folder: str = ""
    published: Download | None = None

    @model_validator(mode="after")
    def _published_has_folder(self) -> "StoredCard":
        if self.published and not self.folder:
            raise ValueError("missing key folder. Expected a folder into which [published] is fetched")
        return self


class FileCard(StoredCard, FileReading):
    """A card of recordings that are files."""

    format: Literal["files"]


class RowCard(StoredCard, Reading):
    """A card of recordings that are rows of CSV files, one file (of `files`) per channel.

    Attributes
    ----------
    label_column
        The column with the surface.
    """

    format: Literal["rows"]
    label_column: str


class ModelsCard(StoredCard):
    """A card of recordings that models of textures make: those of the Penn Haptic Texture Toolkit.

    Attributes
    ----------
    files
        Patterns of relative file names, one file a texture, that tell its surface.
    fs_hz
        Of the models; the one that a file states must agree.
    n_recordings, duration_s
        Of each texture: how many, and seconds of each.
    seed
        Of speeds, forces and noise.
    """

    format: Literal["hatt-models"]
    files: Texts = (r"(?:.*/)?(?:Models_)?(?P<surface>[^/]+)\.xml",)
    fs_hz: float = Field(default=1000.0, gt=0, le=MAX_MAGNITUDE, description="a rate in Hz above 0")
    n_recordings: int = Field(default=10, ge=1, le=1000)
    duration_s: float = Field(default=10.0, ge=0.1, le=600)
    seed: int = Field(default=0, ge=0, le=2**63)
    phases: DeclaredPhases = "movement"

    @model_validator(mode="after")
    def _has_surface(self) -> "ModelsCard":
        if (groups := _groups("files", self.files)) != {"surface"}:
            found = ", ".join(sorted(groups)) or "no group"
            raise ValueError(f"files must define the group (?P<surface>...) and no other, got {found}")
        return self

    @property
    def facts(self) -> str:
        """What changes a recording, as text for a digest."""
        return _hash_input(self)


class SimulatedCard(Card):
    """A card of recordings that a recipe makes."""

    format: Literal["simulated"]
    recipe: Recipe


AnyCard = FileCard | RowCard | ModelsCard | SimulatedCard


class _Content(RootModel[Annotated[AnyCard, Field(discriminator="format")]]):
    """What a file of a card may hold."""


def read_card(name_or_path: str | Path) -> AnyCard:
    """Read a shipped card by name, or a user's own TOML file.

    Raises
    ------
    FileNotFoundError
        If there is neither; the message lists the shipped names.
    CardError
        If it breaks a rule: unknown or missing key, wrong type or value.
    """
    path = shipped.locate("datasets", name_or_path)
    try:
        content = read_toml(path)
        implied = "simulated" if "recipe" in content else "rows" if "label_column" in content else "files"
        by_default = {"title": path.stem, "format": implied}
        card = validate(_Content, by_default | content, path).root
    except ValueError as error:
        raise CardError(str(error)) from error
    card._path = path
    return card
