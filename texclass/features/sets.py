"""Feature sets: named lists of features with parameters and columns, read from TOML files."""

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

MAX_PRODUCT = 1 << 16
"""Largest product of the whole numbers (orders, segments, bands) among the parameters of one feature. It
limits the number of columns."""
SAMPLE_PARAMETERS = frozenset({"length", "shift", "average", "frame", "spacing"})
"""Parameters that are lengths in samples, which do not affect the number of columns."""
MAX_MOVEMENT_SAMPLES = 3_000_000
"""Longest movement in samples that is not divided: 5 minutes at 10 kHz, which take about 200 MB of memory."""


@dataclass(frozen=True)
class Member:
    """One feature of a set.

    Attributes
    ----------
    name : str
        Name of the feature in the set. The names of its columns start with it.
    feature : Feature
        The registered feature.
    parameters : mapping
        Parameters that replace the defaults of the feature.
    columns : tuple of str
        Columns to compute, in order (default: all columns of the feature).
    remove_hand_motion : bool
        Whether hand motion is removed from the movement; see `Views.vibration`.
    """

    name: str
    feature: Feature
    parameters: Mapping[str, Any] = field(default_factory=dict)
    columns: tuple[str, ...] = ()
    remove_hand_motion: bool = False

    def __post_init__(self) -> None:
        # A plain dict can be pickled for worker processes; a mapping proxy cannot.
        object.__setattr__(self, "parameters", dict(self.parameters))
        object.__setattr__(self, "columns", self.columns or self.all_columns)

    @cached_property
    def all_columns(self) -> tuple[str, ...]:
        """All columns of the feature, before any restriction."""
        return self.feature.columns(self.name, self.parameters)

    @cached_property
    def _column_indices(self) -> list[int] | slice:
        if self.columns == self.all_columns:
            return slice(None)
        return [self.all_columns.index(column) for column in self.columns]

    def view(self, views: Views) -> View:
        """Return the view that the feature reads."""
        return views.of(self.feature.phase, remove_hand_motion=self.remove_hand_motion)

    def values(self, views: Views) -> Samples:
        """Compute the columns for one channel of one recording, shape (n_columns,).

        Raises
        ------
        UndefinedFeatureError
            If the recording does not have the phase, the feature is undefined, or a value is not finite.
        ValueError
            If the function of the feature fails, or the number of outputs differs from the declaration. The
            message names the recording and the feature.
        """
        view = self.view(views)
        try:
            values = np.array(self.feature.function(view, **self.parameters), dtype=np.float64, ndmin=1)
        except UndefinedFeatureError:
            raise
        except Exception as error:
            where = f"{views.recording.recording_id}: feature {self.name}"
            raise ValueError(f"{where} failed with {type(error).__name__}: {error}") from error
        if values.shape != (len(self.all_columns),):
            where = f"{views.recording.recording_id}: feature {self.name}"
            raise ValueError(
                f"{where} returned shape {values.shape}, but it declares {len(self.all_columns)} outputs"
            )
        if not np.isfinite(values).all():
            raise UndefinedFeatureError(f"not a finite number ({values[~np.isfinite(values)][0]})")
        return values[self._column_indices]

    def outcome(self, views: Views) -> Samples | str:
        """Return the values, or the reason why the feature is undefined, as a string."""
        try:
            return self.values(views)
        except UndefinedFeatureError as undefined:
            return str(undefined)


@dataclass(frozen=True)
class FeatureSet:
    """A named set of features.

    Attributes
    ----------
    name, reference, description : str
        Entries of the TOML file.
    members : tuple of Member
        Features in the order of the TOML file.

    Examples
    --------
    >>> features = load_feature_set("scales")
    >>> [member.name for member in features.members][:4]
    ['damping', 'vibration_level', 'waviness', 'friction']
    >>> features.columns["vibration_level"], features.units["damping"]
    (('vibration_level.rms',), 'Hz')
    >>> features.restricted_to(["friction", "damping"]).column_names
    ('damping', 'friction')
    """

    name: str
    members: tuple[Member, ...]
    reference: str = ""
    description: str = ""

    @property
    def columns(self) -> Mapping[str, tuple[str, ...]]:
        """Mapping from feature names to the names of their columns."""
        return MappingProxyType({member.name: member.columns for member in self.members})

    @property
    def units(self) -> Mapping[str, str]:
        """Mapping from columns to units, for recordings in m/s^2."""
        return {column: member.feature.unit for member in self.members for column in member.columns}

    @property
    def remove_hand_motion(self) -> bool:
        """Whether hand motion is removed from the movement for at least one feature."""
        return any(member.remove_hand_motion for member in self.members)

    @property
    def movement(self) -> str:
        """Description of the treatment of hand motion, for reports."""
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
        """Return the columns for names of features or columns, in the order of the names.

        Raises
        ------
        ValueError
            If a name is neither a feature nor a column of the set.
        """
        columns = {column: (column,) for column in self.column_names} | dict(self.columns)
        names = tuple(names)
        if unknown := [name for name in names if name not in columns]:
            raise ValueError(
                f"feature set {self.name}: {', '.join(map(repr, unknown))} is neither a feature nor a "
                f"column. Features: {', '.join(self.columns)}"
            )
        return tuple(dict.fromkeys(column for name in names for column in columns[name]))

    def restricted_to(self, names: Iterable[str]) -> "FeatureSet":
        """Return a set that computes only these features and columns, in the order of this set."""
        required = set(self.columns_of(names))
        members = ((m, tuple(column for column in m.columns if column in required)) for m in self.members)
        return replace(self, members=tuple(replace(m, columns=columns) for m, columns in members if columns))

    def with_phases(self, *phases: Phase) -> "FeatureSet":
        """Return the subset of features that read one of these phases; it may be empty."""
        return replace(self, members=tuple(m for m in self.members if m.feature.phase in phases))

    def compute(self, views: Views) -> tuple[Samples, tuple[tuple[str, str], ...]]:
        """Compute the set on one channel of one recording.

        A movement longer than `MAX_MOVEMENT_SAMPLES` is divided into equal parts to limit the memory. The
        value of a feature is the mean over the parts in which it is defined. Features of taps and pairs, and
        features that depend on the length, are computed from the undivided recording.

        Parameters
        ----------
        views : Views
            Phase views of the recording.

        Returns
        -------
        values : ndarray of shape (n_columns,)
            Feature values; NaN where a feature is undefined.
        reasons : tuple of (feature, reason)
            Reasons why features are undefined.
        """
        part_outcomes = self._part_outcomes(views)
        values, reasons, start = np.full(len(self.column_names), np.nan), [], 0
        for member in self.members:
            stop = start + len(member.columns)
            if member.name not in part_outcomes:
                outcome = member.outcome(views)
            else:
                outcomes = part_outcomes[member.name]
                defined = [part for part in outcomes if not isinstance(part, str)]
                outcome = np.mean(defined, axis=0) if defined else outcomes[0]
            if isinstance(outcome, str):
                reasons.append((member.name, outcome))
            else:
                values[start:stop] = outcome
            start = stop
        return values, tuple(reasons)

    def _part_outcomes(self, views: Views) -> dict[str, list[Samples | str]]:
        """Return the outcomes of each feature for the parts of a long movement; empty for a short one."""
        start, stop = views.phases.movement or (0, 0)
        if stop - start <= MAX_MOVEMENT_SAMPLES:
            return {}
        whole = ("tap", "pair")
        divided = [
            m for m in self.members if m.feature.phase not in whole and "length" not in m.feature.depends_on
        ]
        outcomes: dict[str, list[Samples | str]] = {m.name: [] for m in divided}
        edges = np.linspace(start, stop, -(-(stop - start) // MAX_MOVEMENT_SAMPLES) + 1).astype(int).tolist()
        for span in pairwise(edges):
            part = replace(views, phases=replace(views.phases, movement=span))
            for member in divided:
                outcomes[member.name].append(member.outcome(part))
        return outcomes


class SetFile(StrictModel):
    """Keys of the TOML file of a feature set."""

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
        Name of a shipped feature set, or path of a TOML file with a feature set.

    Returns
    -------
    FeatureSet
        Feature set.

    Raises
    ------
    FileNotFoundError
        If neither a shipped feature set nor a file has this name.
    ValueError
        If the file is invalid. The message names the file, the key and the valid keys.

    Examples
    --------
    >>> sum(len(member.columns) for member in load_feature_set("strese2015").members)
    210
    """
    path = locate("feature_defs", name_or_path)
    definition = validate(SetFile, read_toml(path), path.name)
    members = tuple(
        replace(_member(name, table, path.name), remove_hand_motion=definition.remove_hand_motion)
        for name, table in definition.features.items()
    )
    counts = Counter(column for member in members for column in member.columns)
    if duplicates := [column for column, n in counts.items() if n > 1]:
        raise ValueError(
            f"{path.name}: two columns have the name {duplicates[0]!r:.80}. Rename one of their features"
        )
    return FeatureSet(definition.name or path.stem, members, definition.reference, definition.description)


def code_hash(feature_set: FeatureSet) -> str:
    """Return a hex digest of the code that determines the feature values.

    Cached tables with another digest are ignored.
    """
    sources = {member.feature.source for member in feature_set.members}
    return provenance.code_hash("recording", "signals", "phases", "features", "vibration", files=sources)


def _member(name: str, table: dict[str, Any], file: str) -> Member:
    where = f"{file}: features.{name}"
    try:
        feature = find_feature(str(table.get("use", name)))
    except KeyError as error:
        raise ValueError(f"{where}: {error.args[0]}") from None
    # A parameter must have the annotated type, or the type of the default if there is no annotation.
    fields: dict[str, Any] = {}
    for p in feature.parameters:
        is_annotated = p.annotation is not p.empty and not isinstance(p.annotation, str)
        fields[p.name] = (p.annotation if is_annotated else type(p.default), p.default)
    model = create_model(feature.name, __base__=Overrides, **fields)
    parameters = validate(model, {k: v for k, v in table.items() if k != "use"}, where)
    overrides = parameters.model_dump(exclude_unset=True)
    counts = [_largest(value) for key, value in overrides.items() if key not in SAMPLE_PARAMETERS]
    if math.prod(counts) > MAX_PRODUCT:
        raise ValueError(
            f"{where}: the product of the whole numbers must be at most {MAX_PRODUCT}, got {overrides!r:.80}"
        )
    try:
        return Member(name, feature, overrides)
    except Exception as error:  # column names are built from unchecked parameter values
        raise ValueError(f"{where}: column names cannot be built from the parameters ({error})") from error


class Overrides(StrictModel):
    """Base class of the models that validate the parameters of a feature in a set."""

    model_config = ConfigDict(allow_inf_nan=True)


def _largest(value: Any) -> int:
    """Return the largest magnitude of the whole numbers in a parameter, or 1 if there is none."""
    if isinstance(value, tuple):
        return max(map(_largest, value), default=1)
    return max(1, abs(value)) if isinstance(value, int) else 1
