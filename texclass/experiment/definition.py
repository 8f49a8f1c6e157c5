"""A pipeline TOML: features, scikit-learn steps, classifiers and table rows, checked before anything runs."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast, get_args

from sklearn.pipeline import Pipeline, make_pipeline

from texclass.experiment.kinds import at_least, refuse_repeated, require, texts, typed
from texclass.experiment.protocols import find_protocol
from texclass.experiment.selection import ForwardSelector
from texclass.experiment.use import Use, read_use
from texclass.features.sets import FeatureSet, load_feature_set, refuse_unknown
from texclass.features.views import Channels
from texclass.shipped import locate, read

SETTINGS = {"name", "description", "reference", "features", "channels", "seed"}
PIPELINE_KEYS = frozenset(SETTINGS | {"protocol", "steps", "classifiers", "rows", "additions", "gain"})
ROW_KEYS = frozenset({"name", "features", "select", "published", "reference", "skip_missing", "classifiers"})
ADDITION_KEYS = frozenset({"name", "features", "reference", "skip_missing"})
GAIN_KEYS = frozenset({"base", "classifier", "repeats"})
ALL = "all"
"""Stands for every feature of the set in a row."""


@dataclass(frozen=True)
class Selection:
    """Sequential forward selection of a row: how many columns, judged in how many inner folds."""

    n: int
    folds: int = 5


@dataclass(frozen=True)
class RowDefinition:
    """One row of the table.

    Attributes
    ----------
    name
        As printed.
    features
        Names of features and columns of the set.
    select
        Sequential selection among them; None keeps all.
    published
        Classifier -> published accuracy in per cent.
    reference
        Where the published figures or the features come from.
    skip_missing
        Whether a dataset that lacks some of the features is evaluated with the others.
    classifiers
        Which of the pipeline's classifiers evaluate it; all of them by default.
    """

    name: str
    features: tuple[str, ...]
    select: Selection | None = None
    published: Mapping[str, float] = field(default_factory=dict)
    reference: str = ""
    skip_missing: bool = False
    classifiers: tuple[str, ...] = ()

    def judged_by(self, classifiers: Iterable[str]) -> tuple[str, ...]:
        """Return those of a pipeline's classifiers that evaluate this row."""
        return self.classifiers or tuple(classifiers)


@dataclass(frozen=True)
class GainSettings:
    """How it is measured what each addition adds to a row.

    Attributes
    ----------
    base
        The row that is added to; None takes the most accurate one without features of any addition.
    classifier
        None takes the one that is most accurate there.
    repeats
        How many times folds are drawn (with seed, seed + 1, ...), where a protocol draws them.
    """

    base: str | None = None
    classifier: str | None = None
    repeats: int = 5


@dataclass(frozen=True)
class PipelineDefinition:
    """Everything a benchmark does, apart from the dataset; see `load_pipeline`.

    `additions` are groups of features whose gain, added to a row, is measured; they are no rows of the table.
    `apart` names features whose table is kept apart from that of the others: new ones, likely to change.
    """

    name: str
    feature_set: FeatureSet
    steps: tuple[Use, ...]
    classifiers: Mapping[str, Use]
    rows: tuple[RowDefinition, ...]
    seed: int
    channels: Channels = "combine"
    protocol: str = "recording"
    folds: int = 10
    description: str = ""
    reference: str = ""
    hash: str = ""
    additions: tuple[RowDefinition, ...] = ()
    gain: GainSettings = GainSettings()
    apart: tuple[str, ...] = ()

    @property
    def needed(self) -> tuple[FeatureSet, ...]:
        """The parts of the feature set that rows and additions read: the set's own, then each of `apart`."""
        names = {f for row in (*self.rows, *self.additions) for f in row.features}
        own = self.feature_set.restricted_to(names.difference(self.apart))
        return (own, *(self.feature_set.restricted_to([name]) for name in self.apart))

    @property
    def bases(self) -> tuple[RowDefinition, ...]:
        """The rows that hold no column of any addition, so that each addition has something to add."""
        added = set(self.feature_set.columns_of(f for group in self.additions for f in group.features))
        return tuple(r for r in self.rows if added.isdisjoint(self.feature_set.columns_of(r.features)))

    def preparation(self, row: RowDefinition, classifier: str) -> Pipeline:
        """Return the unfitted steps before a classifier: the common ones, then the row's selection."""
        steps = [use.make() for use in self.steps]
        if row.select is not None:
            judge = self.classifiers[classifier].make()
            steps.append(ForwardSelector(judge, n_features_to_select=row.select.n, cv=row.select.folds))
        return make_pipeline(*(steps or ["passthrough"]))


def load_pipeline(name_or_path: str | Path) -> PipelineDefinition:
    """Read a pipeline: a shipped name or the path of a TOML.

    A `features` that ends in ".toml" is looked for beside the pipeline's file.

    Raises
    ------
    FileNotFoundError
        If the pipeline or its feature set does not exist.
    ValueError
        If the TOML breaks the schema; the message names file, key and rule.
    """
    definition = read("pipelines", name_or_path)
    path = locate("pipelines", name_or_path)
    where = path.name
    refuse_unknown(definition, PIPELINE_KEYS, where)
    require(definition, ("features", "seed", "classifiers", "rows"), where)
    for key, kind in (("classifiers", dict), ("rows", list), ("additions", list), ("steps", list)):
        typed(definition.get(key, kind()), kind, f"{where}: {key}")
    if not definition["rows"] or not definition["classifiers"]:
        raise ValueError(f"{where}: no row or no classifier; the rule is one of each at least")
    feature_set = _feature_set(path, typed(definition["features"], str, f"{where}: features"))
    classifiers = {
        name: read_use(table, f"{where}: classifiers.{name}", classifier=True)
        for name, table in definition["classifiers"].items()
    }
    rows = tuple(
        _row(table, feature_set, classifiers, f"{where}: rows {number}")
        for number, table in enumerate(definition["rows"], start=1)
    )
    additions = tuple(
        _addition(table, feature_set, f"{where}: additions {number}")
        for number, table in enumerate(definition.get("additions", []), start=1)
    )
    refuse_repeated([row.name for row in rows], where, "rows")
    refuse_repeated([group.name for group in additions], where, "additions")
    protocol = definition.get("protocol", {})
    refuse_unknown(protocol, frozenset(("name", "folds")), f"{where}: protocol")
    pipeline = PipelineDefinition(
        name=str(definition.get("name", path.stem)),
        feature_set=feature_set,
        steps=tuple(read_use(s, f"{where}: steps {i}") for i, s in enumerate(definition.get("steps", []), 1)),
        classifiers=classifiers,
        rows=rows,
        seed=at_least(0, definition["seed"], f"{where}: seed"),
        channels=_channels(definition.get("channels", "combine"), f"{where}: channels"),
        protocol=_protocol(protocol.get("name", "recording"), f"{where}: protocol.name"),
        folds=at_least(2, protocol.get("folds", 10), f"{where}: protocol.folds"),
        description=str(definition.get("description", "")),
        reference=str(definition.get("reference", "")),
        hash=hashlib.sha256(path.read_bytes()).hexdigest()[:16],
        additions=additions,
        gain=_gain(definition.get("gain", {}), f"{where}: gain"),
    )
    _check_gain(pipeline, where)
    return pipeline


def _row(table: Any, feature_set: FeatureSet, classifiers: Mapping[str, Use], where: str) -> RowDefinition:
    if not isinstance(table, dict):
        raise ValueError(f"{where}: {table!r}; the rule is a table [[rows]]")
    refuse_unknown(table, ROW_KEYS, where)
    require(table, ("name", "features"), where)
    features = _features(table, feature_set, where)
    published = table.get("published", {})
    refuse_unknown(published, frozenset(classifiers), f"{where}: published")
    for name, value in published.items():
        if not isinstance(value, int | float) or not 0 <= value <= 100:
            raise ValueError(f"{where}: published.{name} is {value!r}; the rule is per cent, 0 to 100")
    judges = texts(table.get("classifiers", []), f"{where}: classifiers")
    if unknown := [judge for judge in judges if judge not in classifiers]:
        raise ValueError(
            f"{where}: classifiers names {unknown[0]!r}; the rule is of {', '.join(classifiers)}"
        )
    return RowDefinition(
        typed(table["name"], str, f"{where}: name"),
        features,
        _selection(table["select"], where) if "select" in table else None,
        published,
        str(table.get("reference", "")),
        typed(table.get("skip_missing", False), bool, f"{where}: skip_missing"),
        judges,
    )


def _addition(table: Any, feature_set: FeatureSet, where: str) -> RowDefinition:
    if not isinstance(table, dict):
        raise ValueError(f"{where}: {table!r}; the rule is a table [[additions]]")
    refuse_unknown(table, ADDITION_KEYS, where)
    require(table, ("name", "features"), where)
    return RowDefinition(
        typed(table["name"], str, f"{where}: name"),
        _features(table, feature_set, where),
        reference=str(table.get("reference", "")),
        skip_missing=typed(table.get("skip_missing", False), bool, f"{where}: skip_missing"),
    )


def _features(table: Mapping[str, Any], feature_set: FeatureSet, where: str) -> tuple[str, ...]:
    given = table["features"]
    features = tuple(feature_set.columns) if given == ALL else texts(given, f"{where}: features")
    try:
        feature_set.columns_of(features)
    except ValueError as error:
        raise ValueError(f"{where} ({table['name']}): {error}") from None
    return features


def _gain(table: Any, where: str) -> GainSettings:
    refuse_unknown(table, GAIN_KEYS, where)
    named = {key: typed(table[key], str, f"{where}.{key}") for key in ("base", "classifier") if key in table}
    return GainSettings(**named, repeats=at_least(1, table.get("repeats", 5), f"{where}.repeats"))


def _check_gain(pipeline: PipelineDefinition, where: str) -> None:
    rows, settings = [row.name for row in pipeline.bases], pipeline.gain
    if pipeline.additions and not rows:
        raise ValueError(f"{where}: every row has features of an addition; the rule is one row without any")
    for key, known in (("base", rows), ("classifier", list(pipeline.classifiers))):
        given = getattr(settings, key)
        if given is not None and given not in known:
            what = "a row without features of an addition" if key == "base" else "a classifier"
            raise ValueError(f"{where}: gain.{key} is {given!r}; the rule is {what}: {', '.join(known)}")


def _selection(table: Any, where: str) -> Selection:
    where = f"{where}: select"
    if not isinstance(table, dict):
        raise ValueError(f"{where} is {table!r}; the rule is a table with n and, optionally, folds")
    refuse_unknown(table, frozenset(("n", "folds")), where)
    require(table, ("n",), where)
    folds = at_least(2, table.get("folds", Selection.folds), f"{where}.folds")
    return Selection(at_least(1, table["n"], f"{where}.n"), folds)


def _feature_set(path: Path, features: str) -> FeatureSet:
    beside = path.parent / features
    try:
        return load_feature_set(beside if features.endswith(".toml") and beside.is_file() else features)
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{path.name}: features: {error}") from None
    except (OSError, ValueError) as error:
        raise ValueError(f"{path.name}: features: {error}") from error


def _protocol(name: Any, where: str) -> str:
    try:
        return find_protocol(typed(name, str, where)).name
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _channels(value: Any, where: str) -> Channels:
    if value not in get_args(Channels):
        raise ValueError(f"{where} is {value!r}; the rule is one of {', '.join(get_args(Channels))}")
    return cast(Channels, value)
