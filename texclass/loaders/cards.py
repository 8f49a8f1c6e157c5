"""Dataset cards: pydantic models of the TOML files that describe datasets, one model per format."""

import difflib
import re
from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from annotated_types import Predicate
from pydantic import BeforeValidator, ConfigDict, Field, PrivateAttr, RootModel, model_validator

from texclass import shipped
from texclass.loaders.dataset import GROUPS
from texclass.loaders.readers import COMMENT_PATTERN, TIME_UNITS, ReaderSettings
from texclass.phase_settings import PhaseSettings
from texclass.recording import AUXILIARY_UNITS, Unit
from texclass.simulate.recipe import Recipe
from texclass.validation import StrictModel, read_toml, validate

PATTERN_GROUPS = ("recording", *GROUPS, "axis")
"""Named groups with a meaning in file name patterns; any other group is a further label.

All except `axis` can also be columns of a label table.
"""
RESERVED_LABELS = (*PATTERN_GROUPS, "recording_id", "parent", "file_id", "is_train_only")
"""Names that a further label cannot have: the groups, and other columns of feature tables."""
SIMILAR_NAME = 0.85
"""Similarity (`difflib`, 0 to 1) above which a label name counts as a typing error. One wrong letter in the
name of a group of seven letters or more gives 0.857 or more."""
MAX_MAGNITUDE = 1e100
"""Largest sampling rate in Hz and scale factor accepted in a card; real values are far smaller."""
Convert = Literal["", "frames", "rounded", "counts", "sheets"]
DeclaredPhases = Literal["detect", "movement", "tap", "taps"]
Question = Literal[
    "published", "same operator", "other operator", "later", "other speed", "few-shot", "other condition"
]
"""Question that an evaluation protocol answers: accuracy under which conditions of the test recordings."""
if TYPE_CHECKING:
    Signal = str
    Role = str
    TimeUnit = str
else:  # the values are listed once, in the modules that use them
    Signal = Literal[*AUXILIARY_UNITS]
    TimeUnit = Literal[*TIME_UNITS]
    Role = Literal["acceleration", *AUXILIARY_UNITS]


Texts = Annotated[
    tuple[str, ...],
    BeforeValidator(lambda value: (value,) if isinstance(value, str) else value),
    BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value),
    Field(min_length=1, description="text or a list of text"),
]
"""One or several strings."""


def _as_column_texts(value: Any) -> Any:
    """Convert columns given by name or number to strings."""
    columns = value if isinstance(value, list | tuple) else [value]
    return tuple(
        str(column) if isinstance(column, int) and column is not True else column for column in columns
    )


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
"""Columns of a file, by name or number."""


Rate = Annotated[float, Field(gt=0, le=MAX_MAGNITUDE, description="a rate in Hz above 0")]


class CardError(ValueError):
    """Invalid dataset card; the message contains the file, the key and what was expected."""


class DeclaredProtocol(StrictModel):
    """Evaluation protocol that a card declares for its dataset.

    Attributes
    ----------
    question
        Question that the protocol answers. "published" is the split of the publication, which may be
        optimistic. The others name the test recordings relative to the training set.
    protocol
        Name of the protocol as on the command line, for example "recording" or "leave-out speed"; see
        `texclass.evaluation.find_protocol`.
    folds
        Number of folds, for protocols that draw folds (default 10).
    window_s
        Length in s of the windows that are classified (default: whole recordings).
    max_windows
        Largest number of windows per recording; the first windows are used (default: all windows).
    note
        Remark on the protocol.

    Examples
    --------
    >>> DeclaredProtocol(question="later", protocol="chronological").folds
    10
    """

    question: Question
    protocol: str = Field(min_length=1)
    folds: int = Field(default=10, ge=2, description="a number of folds of at least 2")
    window_s: float | None = Field(default=None, gt=0, description="a length in s above 0")
    max_windows: int | None = Field(default=None, ge=1, description="a number of windows")
    note: str = ""

    @model_validator(mode="after")
    def _has_window(self) -> "DeclaredProtocol":
        if self.max_windows is not None and self.window_s is None:
            raise ValueError(
                "max_windows limits windows, but window_s is missing. Set window_s, or remove it"
            )
        return self


class Card(StrictModel):
    """Keys common to all dataset cards; each format has a subclass.

    Attributes
    ----------
    title
        Title of the dataset (default: the name of the card).
    source
        Where the recordings can be obtained.
    licence
        Terms of use.
    citation
        Publication to cite.
    notes
        Remarks shown in every report, such as known defects and assumptions.
    phase_settings
        Settings of the segmentation into taps and movement; see `PhaseSettings`.
    protocols
        Evaluation protocols that suit the dataset, each with the question that it answers.

    Examples
    --------
    >>> card = read_card("simulated6")
    >>> card.name, card.licence
    ('simulated6', 'MIT')
    """

    title: str = ""
    source: str = ""
    licence: str = "not stated"
    citation: str = ""
    notes: tuple[str, ...] = ()
    phase_settings: PhaseSettings = PhaseSettings()
    protocols: tuple[DeclaredProtocol, ...] = ()
    _path: Path = PrivateAttr(default=Path())

    @property
    def path(self) -> Path:
        """File of the card."""
        return self._path

    @property
    def name(self) -> str:
        """Name of the card."""
        return self._path.stem

    @model_validator(mode="after")
    def _has_distinct_protocols(self) -> "Card":
        keys = Counter((one.question, one.protocol, one.window_s) for one in self.protocols)
        if copies := [key for key, n in keys.items() if n > 1]:
            question, protocol, window_s = copies[0]
            window = "" if window_s is None else f" with windows of {window_s:g} s"
            raise ValueError(
                f"protocols lists {protocol!r}{window} twice for the question {question!r}. Expected "
                "different protocols: remove one"
            )
        return self


class Reading(StrictModel):
    """Keys that define how the values in files are converted to recordings.

    Attributes
    ----------
    fs_hz
        Sampling rate in Hz. Rates stored in the files must agree with it.
    unit
        Unit of the acceleration.
    files
        Names or patterns of the files.
    scale
        Factor from stored values to `unit`.
    turn_rate_scale
        Factor from stored turn rates to rad/s; 0.0174533 if they are in degrees per second.
    phases
        Content of every recording: "detect" (find taps and movement), "movement" (contact throughout), "tap"
        (one tap), or "taps" (only taps, in any number and of any length).
    remove_resting_level
        Subtract the median of each channel.
    """

    fs_hz: Rate
    unit: Unit
    files: Texts
    scale: Factor = 1.0
    turn_rate_scale: Factor = 1.0
    phases: DeclaredPhases = "detect"
    remove_resting_level: bool = False

    @property
    def hash_input(self) -> str:
        """Keys that affect the recordings, as text for the hash of the dataset."""
        return _hash_input(self)


def _hash_input(card: StrictModel) -> str:
    """Serialize all non-default keys except those that do not affect recordings (title, notes, folder)."""
    return card.model_dump_json(exclude={*StoredCard.model_fields}, exclude_defaults=True)


class LabelTable(StrictModel):
    """Label table: a CSV with one row per recording.

    Attributes
    ----------
    file
        Path of the CSV relative to the dataset's folder.
    recording
        Column of the recording ids or file names.
    surface, operator, session, repetition
        Columns of labels and groups that the file names do not contain.

    Any other key is the name of a further label, for example `speed = "speed in mm/s"`.

    Examples
    --------
    >>> LabelTable(file="labels.csv", recording="file", surface="material", speed="v").columns
    {'recording': 'file', 'surface': 'material', 'speed': 'v'}
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, str] = Field(init=False)

    file: str
    recording: str
    surface: str | None = None
    operator: str | None = None
    session: str | None = None
    repetition: str | None = None

    @property
    def columns(self) -> dict[str, str]:
        """Column of each group of `PATTERN_GROUPS` and of each further label that the table contains."""
        return {group: column for group, column in self if group != "file" and column is not None}

    @model_validator(mode="after")
    def _has_valid_labels(self) -> "LabelTable":
        for name in self.model_extra or ():
            check_label_name(name, "[labels] defines")
        return self


class FileReading(Reading):
    """Keys that define how files are converted to recordings, with one file per recording or per axis.

    Attributes
    ----------
    files
        Patterns (regular expressions) of relative file names, with the named groups of `PATTERN_GROUPS`. Any
        other named group is a further label.
    surfaces
        Surface in the dataset for each surface in the file names; surfaces that are not listed are unchanged.
    labels
        Label table with labels and groups that the file names do not contain.
    channels
        Columns of the acceleration and of auxiliary signals, by name or by number from 1.
    companions
        Possible file names of each auxiliary signal, in which {group} stands for the value of a group of
        `files`.
    auxiliary_fs_hz
        Sampling rates in Hz of auxiliary signals that have another rate than the acceleration, for files that
        do not state them.
    delimiter
        Column delimiter of text files.
    skip_rows
        Number of lines to skip at the start of text files (default 0).
    comment
        Start of comment lines in text files (default: #, % and //).
    drop_incomplete
        Drop lines of text files that lack a number in a column (default false: raise an error).
    time_column
        Column of the time stamps, by name or number; "none" ignores all time stamps.
    time_unit
        Unit of the time stamps: s, ms, us, ns, min, h or days (default: inferred).
    resample_hz
        Target sampling rate in Hz of a band-limited resampling. If it is set, the files may have different
        rates, and `fs_hz` is the rate of files that do not store one.
    topic
        Topic of a bag, or a regular expression with groups as in `files`. In the second case, every matching
        topic is a recording.
    trim
        Cut signals of different lengths to the shortest one.
    """

    surfaces: dict[str, str] = Field(default_factory=dict)
    labels: LabelTable | None = None
    channels: dict[Role, Columns] = Field(default_factory=dict)
    companions: dict[Signal, Texts] = Field(default_factory=dict)
    auxiliary_fs_hz: dict[Signal, Rate] = Field(default_factory=dict)
    delimiter: str | None = Field(default=None, pattern=r'^[^"\r\n]$', description="one character, no quote")
    skip_rows: int | None = Field(default=None, ge=0, description="a number of lines")
    comment: str | None = Field(
        default=None,
        pattern=f"^{COMMENT_PATTERN}$",
        description="1 to 8 characters, no blank, digit or quote",
    )
    drop_incomplete: bool = False
    time_column: Annotated[
        str | None, BeforeValidator(lambda value: value and _as_column_texts(value)[0])
    ] = None
    time_unit: TimeUnit | None = None
    resample_hz: float | None = Field(
        default=None, gt=0, le=MAX_MAGNITUDE, description="a rate in Hz above 0"
    )
    topic: str | None = None
    trim: bool = False
    _rate_of: str = PrivateAttr(default="")
    """File from which `fs_hz` was read; "" if it is set by the user or the card."""

    @property
    def settings(self) -> ReaderSettings:
        """Options for reading the files."""
        names = {field.name for field in fields(ReaderSettings)} & set(FileReading.model_fields)
        fs = self.fs_hz if self.resample_hz is None else None
        options = {name: getattr(self, name) for name in names} | {"auxiliary_fs": self.auxiliary_fs_hz}
        return ReaderSettings(fs=fs, rate_of=self._rate_of, **options)

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of the further labels that file names, topics and the label table define."""
        patterns = (*self.files, *([self.topic] if self.topic else []))
        groups = [name for pattern in patterns for name in re.compile(pattern).groupindex]
        columns = self.labels.columns if self.labels else ()
        return tuple(name for name in dict.fromkeys((*groups, *columns)) if name not in PATTERN_GROUPS)

    @model_validator(mode="after")
    def _has_surface(self) -> "FileReading":
        groups = _groups("files", self.files) | set(self.labels.columns if self.labels else ())
        if self.topic is not None:
            groups |= _groups("topic", (self.topic,))
        if "surface" not in groups:
            raise ValueError(
                "neither files nor labels define the surface. Expected the group (?P<surface>...) in files, "
                "or the key surface in [labels]"
            )
        return self


def _groups(key: str, patterns: tuple[str, ...]) -> set[str]:
    """Return the groups of patterns after checking them."""
    groups: set[str] = set()
    for pattern in patterns:
        try:
            groups |= set(re.compile(pattern).groupindex)
        except (re.error, OverflowError, RecursionError) as error:
            raise ValueError(
                f"{key} contains {pattern!r:.200}, which is not a valid regular expression ({error})"
            ) from error
    for name in sorted(groups - set(PATTERN_GROUPS)):
        check_label_name(name, f"{key} defines the group")
    return groups


def check_label_name(name: str, subject: str) -> None:
    """Raise ValueError for the name of a label that is reserved, or similar to the name of a group.

    Parameters
    ----------
    name : str
        Name of a label.
    subject : str
        Start of the message, for example "files defines the group".
    """
    if name in RESERVED_LABELS or not re.fullmatch(r"\w+", name):
        raise ValueError(
            f"{subject} {name!r}, which cannot be the name of a label. Expected letters, digits and "
            f"underscores, and a name other than {', '.join(RESERVED_LABELS)}"
        )
    if similar := difflib.get_close_matches(name.lower(), PATTERN_GROUPS, n=1, cutoff=SIMILAR_NAME):
        raise ValueError(
            f"{subject} {name!r}, which resembles {similar[0]!r}. Correct it, or choose a label name that is "
            "less similar"
        )


class Download(StrictModel):
    """Address of published recordings.

    A file `NAME.sha256` in the folder of the card lists the files with their SHA-256.

    Attributes
    ----------
    url
        Base URL of the files, in a fixed commit of a repository or a fixed record of an archive.
    convert
        Conversion of each file, see `places.convert_files` (default: none).
    sha256
        SHA-256 of the list of converted files (names and SHA-256 of each).
    """

    url: str = Field(pattern=r"^https?://.+/$", description="an address that ends with /")
    convert: Convert = ""
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$", description="64 hexadecimal digits")


class StoredCard(Card):
    """Card of a dataset that is stored in files.

    Attributes
    ----------
    folder
        Folder under the data root (default: the folder of the card itself).
    download
        Source for `texclass datasets get`.
    """

    folder: str = ""
    download: Download | None = None

    @model_validator(mode="after")
    def _download_has_folder(self) -> "StoredCard":
        if self.download and not self.folder:
            raise ValueError("missing key folder. Expected the folder into which [download] writes")
        return self


class FileCard(StoredCard, FileReading):
    """Card of a dataset with one file per recording, or one file per axis."""

    format: Literal["files"]


class RowCard(StoredCard, Reading):
    """Card of a dataset with one recording per row of CSV files, and one file per channel.

    Attributes
    ----------
    label_column
        Column of the surface.
    """

    format: Literal["rows"]
    label_column: str


class EpisodeReading(Reading):
    """Keys that define how the episodes of a LeRobot dataset are converted to recordings.

    Attributes
    ----------
    files
        Description of the dataset.
    channels
        Features, or components of features, of the acceleration and of auxiliary signals.
    surface, operator, session
        Feature with the label or group of an episode, or "task" for the text of its task.
    labels
        Label table with labels and groups, by the ids of the recordings (episode_000000).
    surfaces
        Surface in the dataset for each label; labels that are not listed are unchanged.
    resample_hz
        Target sampling rate in Hz of a band-limited resampling.
    """

    files: Texts = ("meta/info.json",)
    channels: dict[Role, Columns] = Field(default_factory=dict)
    surface: str | None = None
    operator: str | None = None
    session: str | None = None
    labels: LabelTable | None = None
    surfaces: dict[str, str] = Field(default_factory=dict)
    resample_hz: float | None = Field(
        default=None, gt=0, le=MAX_MAGNITUDE, description="a rate in Hz above 0"
    )


class LeRobotCard(StoredCard, EpisodeReading):
    """Card of a LeRobot dataset, with one recording per episode."""

    format: Literal["lerobot"]


class ModelsCard(StoredCard):
    """Card of recordings synthesized from texture models of the Penn Haptic Texture Toolkit.

    Attributes
    ----------
    files
        Patterns of relative file names with the group `surface`, one file per texture.
    fs_hz
        Sampling rate in Hz of the models. Rates stored in the files must agree with it.
    n_recordings
        Number of recordings per texture.
    duration_s
        Duration of a recording in s.
    seed
        Random seed for speeds, forces and noise.
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
            names = ", ".join(sorted(groups)) or "no group"
            raise ValueError(f"files must define the group (?P<surface>...) and no other, got {names}")
        return self

    @property
    def hash_input(self) -> str:
        """Keys that affect the recordings, as text for the hash of the dataset."""
        return _hash_input(self)


class SimulatedCard(Card):
    """Card of simulated recordings."""

    format: Literal["simulated"]
    recipe: Recipe


AnyCard = FileCard | RowCard | LeRobotCard | ModelsCard | SimulatedCard


class _Content(RootModel[Annotated[AnyCard, Field(discriminator="format")]]):
    """Content of a card file: a card of any format."""


def read_card(name_or_path: str | Path) -> AnyCard:
    """Read a dataset card.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped card, or path of a TOML file.

    Returns
    -------
    FileCard, RowCard, LeRobotCard, ModelsCard or SimulatedCard
        Card. Its class is determined by the key `format` (default: inferred from the other keys).

    Raises
    ------
    FileNotFoundError
        If there is no such card; the message lists the shipped names.
    CardError
        If a key is missing or unknown, or a value is invalid.

    Examples
    --------
    >>> card = read_card("taps5")
    >>> card.format, card.phases
    ('rows', 'tap')
    """
    path = shipped.locate("datasets", name_or_path)
    try:
        content = read_toml(path)
        default_format = (
            "simulated" if "recipe" in content else "rows" if "label_column" in content else "files"
        )
        defaults = {"title": path.stem, "format": default_format}
        card = validate(_Content, defaults | content, path).root
    except ValueError as error:
        raise CardError(str(error)) from error
    card._path = path
    return card
