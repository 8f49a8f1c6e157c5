"""Dataset cards: what a TOML file says of a dataset, checked key by key."""

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from texclass import shipped
from texclass.loaders.columns import ColumnRoles
from texclass.recording import ACCELERATION_UNITS, AUXILIARY_UNITS, SCALELESS_UNITS

GROUPS = ("recording", "material", "operator", "session", "repetition", "axis")
"""What a pattern of file names, and (but for the axis) a table of labels, can tell."""
MOST_LARGE = 1e100
"""Rates and factors beyond it are no measurement's."""
DeclaredPhases = Literal["detect", "movement", "tap"]


class CardError(ValueError):
    """A dataset card breaks a rule; the message names the file, the key and the rule."""


@dataclass(frozen=True)
class LabelTable:
    """A CSV beside the recordings, one row per recording.

    Attributes
    ----------
    file
        Relative to the dataset's folder.
    columns
        Of `GROUPS`, which one is in which column; "recording" is the id by which rows are found.
    """

    file: str
    columns: Mapping[str, str]


@dataclass(frozen=True)
class Card:
    """What is known of a dataset; the keys of the TOML file have the same names.

    Attributes
    ----------
    name, path
        Name and file of the card.
    title, source, licence
        What it is, where to get it, on which terms.
    format
        "files" (a recording is a file, or a file per axis), "rows" (a recording is a row of a CSV, one
        file per channel), "simulated" (made by a recipe).
    notes
        What a report must say: quirks, assumptions.
    folder
        Folder under the data root.
    fs_hz
        Sampling rate in Hz; the one a file states must agree.
    unit
        Of the acceleration.
    scale
        Factor from what is stored to `unit`.
    files
        "files": patterns of the relative file names, with the named groups of `GROUPS`. "rows": file names.
    label_column
        "rows": the column with the material.
    labels
        "files": table with labels and groups that the names do not tell.
    channels
        Which columns are acceleration and auxiliary signals.
    companions
        Auxiliary signal -> names its file may have, with {group} in place of groups.
    delimiter
        Of CSV files.
    topic
        Of bags: a topic's name, or a pattern of names with the named groups of `GROUPS`; every topic that
        matches is then a recording.
    phases
        What every recording holds: to "detect", "movement" only, one "tap".
    remove_resting_level
        Subtract each channel's median.
    trim
        Cut signals of different lengths to the shortest.
    recipe
        "simulated": arguments of `texclass.simulate.recipe.Recipe`.
    """

    name: str
    path: Path
    title: str
    source: str
    licence: str
    format: Literal["files", "rows", "simulated"]
    notes: tuple[str, ...] = ()
    folder: str = ""
    fs_hz: float = 0.0
    unit: str = ""
    scale: float = 1.0
    files: tuple[str, ...] = ()
    label_column: str = ""
    labels: LabelTable | None = None
    channels: ColumnRoles = field(default_factory=ColumnRoles)
    companions: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    delimiter: str | None = None
    topic: str | None = None
    phases: DeclaredPhases = "detect"
    remove_resting_level: bool = False
    trim: bool = False
    recipe: Mapping[str, float] = field(default_factory=dict)

    @property
    def facts(self) -> str:
        """Everything that changes a recording, as text for a digest; titles and notes do not.

        A key that cards got later counts where it is set: the digests of the others stay what they were.
        """
        told: tuple[str, ...] = ("name", "path", "title", "source", "licence", "notes")
        told += () if self.topic else ("topic",)
        return repr([(name, value) for name, value in vars(self).items() if name not in told])


_TEXT, _NUMBER, _FLAG, _TEXTS, _TABLE = (str,), (int, float), (bool,), (str, list), (dict,)
_COMMON = {"title": _TEXT, "source": _TEXT, "licence": _TEXT, "format": _TEXT, "notes": (list,)}
_READ = {
    **_COMMON,
    "folder": _TEXT,
    "fs_hz": _NUMBER,
    "unit": _TEXT,
    "files": _TEXTS,
    "scale": _NUMBER,
    "phases": _TEXT,
    "remove_resting_level": _FLAG,
}
_KEYS: dict[str, dict[str, tuple[type, ...]]] = {
    "files": {
        **_READ,
        "labels": _TABLE,
        "channels": _TABLE,
        "companions": _TABLE,
        "delimiter": _TEXT,
        "topic": _TEXT,
        "trim": _FLAG,
    },
    "rows": {**_READ, "label_column": _TEXT},
    "simulated": {**_COMMON, "recipe": _TABLE},
}
_REQUIRED: dict[str, tuple[str, ...]] = {
    "files": ("title", "folder", "fs_hz", "unit", "files", "phases"),
    "rows": ("title", "folder", "fs_hz", "unit", "files", "phases", "label_column"),
    "simulated": ("title", "recipe"),
}
_CHOICES = {"unit": (*ACCELERATION_UNITS, *SCALELESS_UNITS), "phases": ("detect", "movement", "tap")}
_RECIPE: dict[str, tuple[type, ...]] = {
    **dict.fromkeys(("n_surfaces", "n_recordings", "n_operators", "seed"), (int,)),
    **dict.fromkeys(("duration_s", "fs"), _NUMBER),
}


def read_card(name_or_path: str | Path) -> Card:
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
        return parse_card(path, shipped.read("datasets", name_or_path))
    except CardError:
        raise
    except ValueError as error:
        raise CardError(str(error)) from error


def parse_card(path: Path, content: Mapping[str, Any]) -> Card:
    """Check the content of a card and return it.

    Raises
    ------
    CardError
        Naming the file, the key and the rule.
    """
    format_ = content.get("format")
    if not isinstance(format_, str) or format_ not in _KEYS:
        raise CardError(f"{path}: format is {format_!r}; the rule is one of {', '.join(_KEYS)}")
    _check_keys(path, "", content, _KEYS[format_], _REQUIRED[format_])
    for key, choices in _CHOICES.items():
        if key in content and content[key] not in choices:
            raise CardError(f"{path}: {key} is {content[key]!r}; the rule is one of {', '.join(choices)}")
    told = {"source": "", "licence": "not stated"}
    values: dict[str, Any] = {**told, **content, "notes": tuple(content.get("notes", ()))}
    if format_ == "simulated":
        _check_keys(path, "recipe.", content["recipe"], _RECIPE, tuple(_RECIPE))
    else:
        values |= _reading(path, content)
    return Card(name=path.stem, path=path, **values)


def _reading(path: Path, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys that say how files are read, checked and in the types of `Card`."""
    for key, rule in (("fs_hz", "a rate in Hz above 0"), ("scale", "a finite factor other than 0")):
        value = content.get(key, 1.0)
        if not abs(value) <= MOST_LARGE or value == 0 or (key == "fs_hz" and value < 0):
            raise CardError(f"{path}: {key} is {value!r:.40}; the rule is {rule}")
    files = _texts(content["files"])
    values: dict[str, Any] = {"files": files, "fs_hz": float(content["fs_hz"])}
    if content["format"] == "rows":
        return values
    labels = _labels(path, content["labels"]) if "labels" in content else None
    if "delimiter" in content and (len(content["delimiter"]) != 1 or content["delimiter"] in '"\r\n'):
        raise CardError(
            f"{path}: delimiter is {content['delimiter']!r:.40}; the rule is one character, no quote"
        )
    told = _groups(path, "files", files) | set(labels.columns if labels else ())
    told |= _groups(path, "topic", (content["topic"],)) if "topic" in content else set()
    if "material" not in told:
        raise CardError(f"{path}: files and labels do not tell the material; the rule is (?P<material>...)")
    companions = content.get("companions", {})
    _check_keys(path, "companions.", companions, dict.fromkeys(AUXILIARY_UNITS, _TEXTS), ())
    return {
        **values,
        "labels": labels,
        "channels": _channels(path, content),
        "companions": {signal: _texts(names) for signal, names in companions.items()},
    }


def _groups(path: Path, key: str, patterns: tuple[str, ...]) -> set[str]:
    told: set[str] = set()
    for pattern in patterns:
        try:
            groups = set(re.compile(pattern).groupindex)
        except (re.error, OverflowError, RecursionError) as error:
            told_of = f"{path}: {key} holds {pattern!r:.200}, not a regular expression ({error})"
            raise CardError(told_of) from error
        if unknown := groups - set(GROUPS):
            raise CardError(f"{path}: {key} names groups {sorted(unknown)}; the rule is {', '.join(GROUPS)}")
        told |= groups
    return told


def _labels(path: Path, table: Mapping[str, Any]) -> LabelTable:
    columns = tuple(group for group in GROUPS if group != "axis")
    _check_keys(path, "labels.", table, dict.fromkeys(("file", *columns), _TEXT), ("file", "recording"))
    return LabelTable(table["file"], {key: name for key, name in table.items() if key != "file"})


def _channels(path: Path, content: Mapping[str, Any]) -> ColumnRoles:
    table = content.get("channels", {})
    _check_keys(path, "channels.", table, dict.fromkeys(("acceleration", *AUXILIARY_UNITS), _TEXTS), ())
    roles = {key: _texts(names) for key, names in table.items()}
    return ColumnRoles(roles.pop("acceleration", ()), roles)


def _texts(value: str | list[str]) -> tuple[str, ...]:
    return (value,) if isinstance(value, str) else tuple(value)


def _check_keys(
    path: Path,
    prefix: str,
    table: Mapping[str, Any],
    known: Mapping[str, tuple[type, ...]],
    required: tuple[str, ...],
) -> None:
    for key, value in table.items():
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = (
                f"; did you mean {prefix}{near[0]}?" if near else f"; the rule is one of {', '.join(known)}"
            )
            raise CardError(f"{path}: unknown key {prefix}{key}{hint}")
        types = known[key]
        is_wrong = not isinstance(value, types) or (isinstance(value, bool) and bool not in types)
        if is_wrong or (isinstance(value, list) and not (value and all(isinstance(v, str) for v in value))):
            expected = " or ".join("list of str" if kind is list else kind.__name__ for kind in types)
            raise CardError(f"{path}: {prefix}{key} is {value!r}; the rule is {expected}")
    for key in required:
        if key not in table:
            raise CardError(f"{path}: key {prefix}{key} is missing")
