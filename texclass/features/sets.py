"""Feature sets: which features, with which overrides, under which column names; read from a TOML."""

import hashlib
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field, create_model

from texclass import provenance
from texclass.features.contract import Feature, find_feature
from texclass.features.phase_view import Phase, UndefinedFeatureError, View, Views
from texclass.recording import Samples
from texclass.shipped import locate
from texclass.validation import StrictModel, read_toml, validate

MOST_COUNTED = 1 << 16
"""Largest product of the whole-number overrides (orders, pieces, bands) of one feature."""
SAMPLES = frozenset({"length", "shift", "average", "frame", "spacing"})
"""Overrides that count samples, and no columns."""
LONGEST = 3_000_000
"""Samples from which on a movement is computed in equal parts: 5 minutes at 10 kHz, some 200 MB."""


@dataclass(frozen=True)
class Member:
    """One feature of a set.

    Attributes
    ----------
    name
        Name in the set; its columns begin with it.
    feature
        The registered feature.
    parameters
        Overrides of its defaults.
    columns
        The columns that are kept, in order; all of the feature's columns unless the set was restricted.
    remove_hand_motion
        Whether a movement is read hand motion removed, see `Views.vibration`.
    """

    name: str
    feature: Feature
    parameters: Mapping[str, Any] = field(default_factory=dict)
    columns: tuple[str, ...] = ()
    remove_hand_motion: bool = False

    def __post_init__(self) -> None:
        # A plain dict (not a mapping proxy) keeps the member picklable for worker processes.
        object.__setattr__(self, "parameters", dict(self.parameters))
        object.__setattr__(self, "columns", self.columns or self.all_columns)

    @cached_property
    def all_columns(self) -> tuple[str, ...]:
        """Every column that the feature gives, before any restriction."""
        return self.feature.columns(self.name, self.parameters)

    @cached_property
    def _kept(self) -> list[int] | slice:
        if self.columns == self.all_columns:
            return slice(None)
        return [self.all_columns.index(column) for column in self.columns]

    def view(self, views: Views) -> View:
        """Return what the feature reads of a channel of a recording, or of two."""
        return views.of(self.feature.phase, remove_hand_motion=self.remove_hand_motion)

    def values(self, views: Views) -> Samples:
        """Return the kept columns of one channel of one recording, shape (n_columns,).

        Raises
        ------
        UndefinedFeatureError
            If the phase is missing, the feature has no value, or a value is not finite.
        ValueError
            If the feature breaks its declaration or fails otherwise; the message names recording and feature.
        """
        view = self.view(views)
        try:
            given = np.array(self.feature.function(view, **self.parameters), dtype=np.float64, ndmin=1)
        except UndefinedFeatureError:
            raise
        except Exception as error:
            where = f"{views.recording.recording_id}: feature {self.name}"
            raise ValueError(f"{where} failed with {type(error).__name__}: {error}") from error
        if given.shape != (len(self.all_columns),):
            where = f"{views.recording.recording_id}: feature {self.name}"
            raise ValueError(f"{where} gave shape {given.shape}; it declares {len(self.all_columns)} outputs")
        if not np.isfinite(given).all():
            raise UndefinedFeatureError(f"not a finite number ({given[~np.isfinite(given)][0]})")
        return given[self._kept]

    def outcome(self, views: Views) -> Samples | str:
        """Return the values, or the reason why there is none."""
        try:
            return self.values(views)
        except UndefinedFeatureError as undefined:
            return str(undefined)


@dataclass(frozen=True)
class FeatureSet:
    """A named, citable set of features.

    Attributes
    ----------
    name, reference, description
        From the TOML.
    members
        The features in the order of the TOML.
    """

    name: str
    members: tuple[Member, ...]
    reference: str = ""
    description: str = ""

    @property
    def columns(self) -> Mapping[str, tuple[str, ...]]:
        """Feature name -> names of its columns."""
        return MappingProxyType({member.name: member.columns for member in self.members})

    @property
    def units(self) -> Mapping[str, str]:
        """Column -> its unit where recordings are in m/s^2."""
        return {column: member.feature.unit for member in self.members for column in member.columns}

    @property
    def remove_hand_motion(self) -> bool:
        """Whether its movements are read hand motion removed."""
        return any(member.remove_hand_motion for member in self.members)

    @property
    def movement(self) -> str:
        """Which movement it reads, in words."""
        return "hand motion removed" if self.remove_hand_motion else "hand motion kept, as printed"

    @cached_property
    def column_names(self) -> tuple[str, ...]:
        """All columns in order."""
        return tuple(column for member in self.members for column in member.columns)

    @cached_property
    def hash(self) -> str:
        """Hex digest of the definition: functions, parameters (with defaults) and columns."""
        definition = [
            [
                f"{m.feature.function.__module__}.{m.feature.function.__qualname__}",
                sorted((k, repr(v)) for k, v in {**m.feature.defaults, **m.parameters}.items()),
                m.columns,
                m.remove_hand_motion,
            ]
            for m in self.members
        ]
        return hashlib.sha256(json.dumps(definition).encode()).hexdigest()[:16]

    def columns_of(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return the columns of features and columns given by name, in the order given.

        Raises
        ------
        ValueError
            If a name is neither a feature nor a column of the set.
        """
        known = {column: (column,) for column in self.column_names} | dict(self.columns)
        names = tuple(names)
        if unknown := [name for name in names if name not in known]:
            raise ValueError(
                f"feature set {self.name}: {unknown[0]!r} is neither a feature nor a column; "
                f"the features are {', '.join(self.columns)}"
            )
        return tuple(dict.fromkeys(column for name in names for column in known[name]))

    def restricted_to(self, names: Iterable[str]) -> "FeatureSet":
        """Return the set that computes only what these features and columns need, in the set's order."""
        wanted = set(self.columns_of(names))
        kept = ((m, tuple(column for column in m.columns if column in wanted)) for m in self.members)
        return replace(self, members=tuple(replace(m, columns=columns) for m, columns in kept if columns))

    def reading(self, *phases: Phase) -> "FeatureSet":
        """Return the part of the set that reads these phases; it may be empty."""
        return replace(self, members=tuple(m for m in self.members if m.feature.phase in phases))

    def compute(self, views: Views) -> tuple[Samples, tuple[tuple[str, str], ...]]:
        """Compute the set on one channel of one recording, a movement above `LONGEST` in equal parts.

        A feature's value over a long movement is the mean of its values over the parts where it has one, in
        the memory that one part takes. What is read from taps or from two channels, and what is declared
        to depend on the length, is computed as a whole.

        Parameters
        ----------
        views : Views
            The recording's phases.

        Returns
        -------
        values : ndarray of shape (n_columns,)
            NaN where a feature is undefined.
        reasons : tuple of (feature, reason)
            Why.
        """
        of_parts = self._of_parts(views)
        values, reasons, at = np.full(len(self.column_names), np.nan), [], 0
        for member in self.members:
            stop = at + len(member.columns)
            if member.name not in of_parts:
                outcome = member.outcome(views)
            else:
                defined = [part for part in of_parts[member.name] if not isinstance(part, str)]
                outcome = np.mean(defined, axis=0) if defined else of_parts[member.name][0]
            if isinstance(outcome, str):
                reasons.append((member.name, outcome))
            else:
                values[at:stop] = outcome
            at = stop
        return values, tuple(reasons)

    def _of_parts(self, views: Views) -> dict[str, list[Samples | str]]:
        """Return what features give of each part of a movement above `LONGEST`."""
        start, stop = views.phases.movement or (0, 0)
        if stop - start <= LONGEST:
            return {}
        whole = ("tap", "pair")
        divided = [
            m for m in self.members if m.feature.phase not in whole and "length" not in m.feature.depends_on
        ]
        found: dict[str, list[Samples | str]] = {m.name: [] for m in divided}
        edges = np.linspace(start, stop, -(-(stop - start) // LONGEST) + 1).astype(int).tolist()
        for span in pairwise(edges):
            part = replace(views, phases=replace(views.phases, movement=span))  # goes with its transforms
            for member in divided:
                found[member.name].append(member.outcome(part))
        return found


class SetFile(StrictModel):
    """What the TOML of a feature set holds."""

    name: str = ""
    reference: str = ""
    description: str = ""
    remove_hand_motion: bool = False
    features: Annotated[dict[str, dict[str, Any]], Field(min_length=1)]


def load_feature_set(name_or_path: str | Path) -> FeatureSet:
    """Read a feature set.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped feature set, or path of a feature set (TOML).

    Returns
    -------
    FeatureSet
        Features with their parameters and columns.

    Raises
    ------
    FileNotFoundError
        If there is no such set.
    ValueError
        If the file is invalid; the message names file, key and valid keys.

    Examples
    --------
    >>> sum(len(member.columns) for member in load_feature_set("strese2015").members)
    210
    """
    path = locate("feature_defs", name_or_path)
    written = validate(SetFile, read_toml(path), path.name)
    members = tuple(
        replace(_member(name, table, path.name), remove_hand_motion=written.remove_hand_motion)
        for name, table in written.features.items()
    )
    times = Counter(column for member in members for column in member.columns)
    if twice := [column for column, n in times.items() if n > 1]:
        raise ValueError(f"{path.name}: two columns are named {twice[0]!r:.80}. Expected unique names")
    return FeatureSet(written.name or path.stem, members, written.reference, written.description)


def code_hash(feature_set: FeatureSet) -> str:
    """Hex digest of the code that values depend on, so that an edited feature never meets a stale table."""
    own = {member.feature.source for member in feature_set.members}
    return provenance.code_hash("recording", "signals", "phases", "features", "vibration", files=own)


def _member(name: str, table: dict[str, Any], file: str) -> Member:
    where = f"{file}: features.{name}"
    try:
        feature = find_feature(str(table.get("use", name)))
    except KeyError as error:
        raise ValueError(f"{where}: {error.args[0]}") from None
    # What a set may give is of the declared type, else of the type of the default.
    fields: dict[str, Any] = {}
    for p in feature.parameters:
        declared = p.annotation is not p.empty and not isinstance(p.annotation, str)
        fields[p.name] = (p.annotation if declared else type(p.default), p.default)
    model = create_model(feature.name, __base__=Overrides, **fields)
    given = validate(model, {k: v for k, v in table.items() if k != "use"}, where)
    overrides = given.model_dump(exclude_unset=True)
    if math.prod(_largest(value) for key, value in overrides.items() if key not in SAMPLES) > MOST_COUNTED:
        raise ValueError(
            f"{where} is {overrides!r:.80}. Expected whole numbers whose product is at most {MOST_COUNTED}"
        )
    try:
        return Member(name, feature, overrides)
    except Exception as error:  # names of columns are made of parameters whose values nobody has checked
        raise ValueError(f"{where}: its columns cannot be named ({error})") from error


class Overrides(StrictModel):
    """Parameters that a set gives a feature."""

    model_config = ConfigDict(allow_inf_nan=True)


def _largest(value: Any) -> int:
    """Return the size of the largest whole number in an override, 1 if it holds none."""
    if isinstance(value, tuple):
        return max(map(_largest, value), default=1)
    return max(1, abs(value)) if isinstance(value, int) else 1
