"""Feature sets: which features, with which overrides, under which column names; read from a TOML."""

import hashlib
import inspect
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from texclass import provenance
from texclass.features.contract import Feature, Phase, UndefinedFeatureError, find
from texclass.features.parts import outcomes
from texclass.features.views import Views
from texclass.recording import Samples
from texclass.shipped import locate, read

MOST_COUNTED = 1 << 16
"""Largest product of the whole-number overrides (orders, pieces, bands) of one feature."""
SAMPLES = frozenset({"length", "shift", "average", "frame", "spacing"})
"""Overrides that count samples, and no columns."""
SET_KEYS = frozenset({"name", "reference", "description", "features"})


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
    """

    name: str
    feature: Feature
    parameters: Mapping[str, Any] = field(default_factory=dict)
    columns: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        # A plain dict (not a mapping proxy) keeps the member picklable for worker processes.
        object.__setattr__(self, "parameters", dict(self.parameters))
        object.__setattr__(self, "columns", self.columns or self.all_columns)

    @cached_property
    def all_columns(self) -> tuple[str, ...]:
        """Every column that the feature gives, before any restriction."""
        return self.feature.columns(self.name, self.parameters)

    def values(self, views: Views) -> Samples:
        """Return the kept columns of one channel of one recording, shape (n_columns,).

        Raises
        ------
        UndefinedFeatureError
            If the phase is missing, the feature has no value, or a value is not finite.
        ValueError
            If the feature breaks its declaration or fails otherwise; the message names recording and feature.
        """
        view = views.of(self.feature.phase)
        try:
            given = np.atleast_1d(
                np.asarray(self.feature.function(view, **self.parameters), dtype=np.float64)
            )
        except UndefinedFeatureError:
            raise
        except Exception as error:
            what = f"{type(error).__name__}: {error}"
            raise ValueError(
                f"{views.recording.recording_id}: feature {self.name} failed with {what}"
            ) from error
        if given.shape != (len(self.all_columns),):
            raise ValueError(
                f"{views.recording.recording_id}: feature {self.name} gave shape {given.shape}; "
                f"it declares {len(self.all_columns)} outputs"
            )
        if not np.isfinite(given).all():
            raise UndefinedFeatureError(f"not a finite number ({given[~np.isfinite(given)][0]})")
        return given[self._kept]

    @cached_property
    def _kept(self) -> list[int]:
        return [self.all_columns.index(column) for column in self.columns]


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
    def column_names(self) -> tuple[str, ...]:
        """All columns in order."""
        return tuple(column for member in self.members for column in member.columns)

    @property
    def phases(self) -> frozenset[Phase]:
        """The phases that the features read."""
        return frozenset(member.feature.phase for member in self.members)

    @cached_property
    def hash(self) -> str:
        """Hex digest of the definition: functions, parameters (with defaults) and columns."""
        definition = [
            [
                f"{m.feature.function.__module__}.{m.feature.function.__qualname__}",
                sorted((k, repr(v)) for k, v in {**m.feature.defaults, **m.parameters}.items()),
                m.columns,
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
        chosen: list[str] = []
        for name in names:
            if name in self.columns:
                chosen += self.columns[name]
            elif name in self.column_names:
                chosen.append(name)
            else:
                raise ValueError(
                    f"feature set {self.name}: {name!r} is neither a feature nor a column; "
                    f"the features are {', '.join(self.columns)}"
                )
        return tuple(dict.fromkeys(chosen))

    def restricted_to(self, names: Iterable[str]) -> "FeatureSet":
        """Return the set that computes only what these features and columns need, in the set's order."""
        wanted = set(self.columns_of(names))
        members = tuple(
            Member(m.name, m.feature, m.parameters, kept)
            for m in self.members
            if (kept := tuple(column for column in m.columns if column in wanted))
        )
        return FeatureSet(self.name, members, self.reference, self.description)

    def reading(self, *phases: Phase) -> "FeatureSet":
        """Return the part of the set that reads these phases; it may be empty."""
        members = tuple(m for m in self.members if m.feature.phase in phases)
        return FeatureSet(self.name, members, self.reference, self.description)

    def compute(self, views: Views) -> tuple[Samples, tuple[tuple[str, str], ...]]:
        """Compute the set on one channel of one recording.

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
        values: list[Samples] = []
        reasons: list[tuple[str, str]] = []
        for member, result in zip(self.members, outcomes(self.members, views), strict=True):
            if isinstance(result, str):
                reasons.append((member.name, result))
                result = np.full(len(member.columns), np.nan)  # noqa: PLW2901
            values.append(result)
        return np.concatenate(values) if values else np.empty(0), tuple(reasons)


def load_feature_set(name_or_path: str | Path) -> FeatureSet:
    """Read a feature set: a shipped name or the path of a TOML.

    Raises
    ------
    FileNotFoundError
        If there is no such set.
    ValueError
        If the TOML breaks the schema; the message names file, key and the known keys.
    """
    definition = read("feature_defs", name_or_path)
    where = locate("feature_defs", name_or_path).name
    refuse_unknown(definition, SET_KEYS, where)
    tables = definition.get("features")
    if not isinstance(tables, dict) or not tables:
        raise ValueError(f"{where}: no [features.<name>] table; the rule is at least one feature")
    members = tuple(_member(name, table, where) for name, table in tables.items())
    columns = [column for member in members for column in member.columns]
    if len(set(columns)) < len(columns):
        twice = next(column for column, times in Counter(columns).items() if times > 1)
        raise ValueError(f"{where}: two columns are named {twice!r:.80}; the rule is one a name")
    return FeatureSet(
        str(definition.get("name", locate("feature_defs", name_or_path).stem)),
        members,
        str(definition.get("reference", "")),
        str(definition.get("description", "")),
    )


def refuse_unknown(table: Any, known: frozenset[str], where: str) -> None:
    """Check that a TOML table is a table and holds known keys only.

    Raises
    ------
    ValueError
        If not; the message begins with `where` and lists the known keys.
    """
    if not isinstance(table, dict):
        raise ValueError(f"{where}: {table!r}; the rule is a table")
    if unknown := [key for key in table if key not in known]:
        raise ValueError(
            f"{where}: unknown key {unknown[0]!r}; the known keys are {', '.join(sorted(known)) or '(none)'}"
        )


def code_hash(feature_set: FeatureSet) -> str:
    """Hex digest of the code that values depend on, so that an edited feature never meets a stale table."""
    own = {Path(inspect.getfile(member.feature.function)) for member in feature_set.members}
    return provenance.code_hash(
        "recording", "signals", "filters", "phases", "features", "vibration", files=own
    )


def _member(name: str, table: Any, where: str) -> Member:
    if not isinstance(table, dict):
        raise ValueError(f"{where}: features.{name} is {table!r}; the rule is a table [features.{name}]")
    try:
        feature = find(str(table.get("use", name)))
    except KeyError as error:
        raise ValueError(f"{where}: features.{name}: {error.args[0]}") from None
    overrides = {key: _hashable(value) for key, value in table.items() if key != "use"}
    refuse_unknown(overrides, frozenset(feature.defaults), f"{where}: features.{name}")
    for key, value in overrides.items():
        _check_kind(value, feature.defaults[key], f"{where}: features.{name}.{key}")
    if math.prod(_largest(value) for key, value in overrides.items() if key not in SAMPLES) > MOST_COUNTED:
        raise ValueError(
            f"{where}: features.{name} is {overrides!r:.80}; "
            f"the rule is whole numbers whose product is at most {MOST_COUNTED}"
        )
    try:
        return Member(name, feature, overrides)
    except Exception as error:  # names of columns are made of parameters whose values nobody has checked
        raise ValueError(f"{where}: features.{name}: its columns cannot be named ({error})") from error


def _check_kind(value: Any, default: Any, where: str) -> None:
    numbers, text = (int, float), (str,)
    for kind in (bool, numbers, text, tuple):
        if isinstance(default, kind):
            if not isinstance(value, kind) or (kind is numbers and isinstance(value, bool)):
                raise ValueError(f"{where} is {value!r}; the rule is the kind of its default, {default!r}")
            return


def _largest(value: Any) -> int:
    """Return the size of the largest whole number in an override, 1 if it holds none."""
    if isinstance(value, tuple):
        return max(map(_largest, value), default=1)
    return max(1, abs(value)) if isinstance(value, int) else 1


def _hashable(value: Any) -> Any:
    return tuple(_hashable(v) for v in value) if isinstance(value, list) else value
