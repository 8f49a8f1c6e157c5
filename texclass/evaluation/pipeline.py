"""A pipeline TOML: features, scikit-learn steps, classifiers and table rows, checked before anything runs."""

import hashlib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    PrivateAttr,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from sklearn.base import is_classifier
from sklearn.pipeline import Pipeline, make_pipeline

from texclass.classifiers.forward_selection import ForwardSelector
from texclass.classifiers.segment_voting import with_segment_columns
from texclass.evaluation.allowed_estimators import check_parameters, resolve
from texclass.evaluation.feature_table import FeatureTable
from texclass.evaluation.folds import Evaluation, evaluate, evaluate_each
from texclass.evaluation.protocols import find_protocol
from texclass.features.contract import Feature
from texclass.features.phase_view import Channels
from texclass.features.sets import FeatureSet, Member, load_feature_set
from texclass.phase_settings import PhaseSettings
from texclass.shipped import locate
from texclass.validation import StrictModel, read_toml, validate

ALL = "all"
"""Stands for every feature of the set in a row."""


class Use(StrictModel):
    """One scikit-learn object of a TOML: the class it names, and beside it the arguments of its constructor.

    An argument that is another such object, `estimator = { use = "..." }`, is made, too.

    Attributes
    ----------
    use
        Dotted path of a class of `ESTIMATORS`.
    """

    model_config = ConfigDict(extra="allow")
    use: str

    def make(self) -> Any:
        """Return a new, unfitted object."""
        made = dict(self.parameters)
        for key, value in made.items():
            if _is_use(value):
                try:
                    made[key] = Use(**value).make()
                except ValidationError as error:  # its first fault, in one line
                    raise ValueError(error.errors()[0]["msg"]) from None
        return resolve(self.use)(**made)

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The arguments of its constructor."""
        return self.model_extra or {}

    @model_validator(mode="after")
    def _takes_its_parameters(self) -> Self:
        check_parameters(self.use, self.parameters)
        try:
            made = self.make()
        except Exception as error:  # estimators raise almost anything of parameters they do not expect
            raise ValueError(str(error)) from None
        try:
            made.fit(None, None)
        except Exception as error:
            # Parameters are checked before data, so a message that names one is about its value.
            own = [key for key, value in self.parameters.items() if not _is_use(value)]
            if any(re.search(rf"\b{re.escape(key)}\b", str(error)) for key in own):
                raise ValueError(str(error)) from None
        return self


def _is_use(value: Any) -> bool:
    return isinstance(value, dict) and "use" in value


def _classifies(use: Use) -> Use:
    if not is_classifier(use.make()):
        raise ValueError(f"{use.use} is not a classifier")
    return use


def _transforms(use: Use) -> Use:
    if is_classifier(made := use.make()) or not hasattr(made, "transform"):
        raise ValueError(f"{use.use} is not a transformer")
    return use


class Selection(StrictModel):
    """Sequential forward selection of a row: how many columns, judged in how many inner folds."""

    n: Annotated[int, Field(ge=1)]
    folds: Annotated[int, Field(ge=2)] = 5


def _names(given: Any) -> Any:
    """Return what stands for features: a list as a tuple, the word "all" as one name."""
    return (ALL,) if given == ALL else tuple(given) if isinstance(given, list) else given


class RowDefinition(StrictModel):
    """One row of the table; or, without what only rows have, a group of features that is added to one.

    Attributes
    ----------
    name
        As printed.
    features
        Names of features and columns of the set; a TOML may say "all".
    reference
        Where the published figures or the features come from.
    skip_missing
        Whether a dataset that lacks some of the features is evaluated with the others.
    select
        Of rows: sequential selection among the features; None keeps all.
    published
        Of rows: classifier -> published accuracy in per cent.
    classifiers
        Of rows: which of the pipeline's classifiers evaluate it; all of them by default.
    note
        Of rows: what a reader of its accuracy must know; printed below the table.
    """

    name: str
    features: Annotated[tuple[str, ...], BeforeValidator(_names)]
    reference: str = ""
    skip_missing: bool = False
    select: Selection | None = None
    published: dict[str, Annotated[float, Field(ge=0, le=100)]] = Field(default_factory=dict)
    classifiers: tuple[str, ...] = ()
    note: str = ""

    def judged_by(self, classifiers: Iterable[str]) -> tuple[str, ...]:
        """Return those of a pipeline's classifiers that evaluate this row."""
        return self.classifiers or tuple(classifiers)


class FoldSettings(StrictModel):
    """How recordings are split: name of a protocol, and folds of those that draw them."""

    name: Annotated[str, AfterValidator(lambda name: find_protocol(name).name)] = "recording"
    folds: Annotated[int, Field(ge=2)] = 10


class PublishedOn(StrictModel):
    """Under which conditions the published figures of a table were measured.

    Attributes
    ----------
    n_surfaces
        How many surfaces were told apart.
    protocols
        Those of ours that split as the publication did.
    """

    n_surfaces: Annotated[int, Field(ge=2)]
    protocols: tuple[str, ...] = ()

    @field_validator("protocols")
    @classmethod
    def _known(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(find_protocol(name).name for name in names)


class AdditionSettings(StrictModel):
    """How it is measured what each group adds to a row.

    Attributes
    ----------
    base
        The row that is added to; None takes the most accurate one without features of any group.
    classifier
        None takes the one that is most accurate there.
    repeats
        How many times folds are drawn (with seed, seed + 1, ...), where a protocol draws them.
    """

    base: str | None = None
    classifier: str | None = None
    repeats: Annotated[int, Field(ge=1)] = 5


def _set_of(given: Any) -> FeatureSet:
    if isinstance(given, FeatureSet):
        return given
    if not isinstance(given, str):
        raise ValueError(f"{given!r:.60}. Expected a shipped name or a path")
    try:
        return load_feature_set(given)
    except OSError as error:
        raise ValueError(str(error)) from None


class PipelineDefinition(StrictModel):
    """Everything a benchmark does, apart from the dataset; see `load_pipeline`.

    Attributes
    ----------
    name, description, reference
        What it is, and where it comes from.
    features
        The set that rows choose from; a TOML gives a shipped name or a path.
    steps
        scikit-learn transformers before every classifier.
    classifiers
        Name -> scikit-learn classifier.
    rows, additions
        Lines of the table; groups of features whose effect on a row is measured, which are no lines of it.
    seed
        Of folds, and of the bootstrap.
    channels
        See `FeatureExtractor`.
    overlap
        Windows that begin within each short touch of a training part; see `texclass.evaluation.windows`.
    protocol, gain
        How recordings are split, and how it is measured what groups add.
    published_on
        Under which conditions the published figures of the rows were measured; without it they are not
        compared with ours.
    phase_settings
        Settings by which phases are found, unless the dataset states them; see `PhaseSettings`.
    """

    model_config = ConfigDict(arbitrary_types_allowed=True)
    features: Annotated[FeatureSet, PlainValidator(_set_of)]
    seed: Annotated[int, Field(ge=0)]
    classifiers: Annotated[dict[str, Annotated[Use, AfterValidator(_classifies)]], Field(min_length=1)]
    rows: Annotated[tuple[RowDefinition, ...], Field(min_length=1)]
    additions: tuple[RowDefinition, ...] = ()
    steps: tuple[Annotated[Use, AfterValidator(_transforms)], ...] = ()
    channels: Channels = "combine"
    overlap: Annotated[int, Field(ge=1)] = 1
    protocol: FoldSettings = FoldSettings()
    gain: AdditionSettings = AdditionSettings()
    phase_settings: PhaseSettings = PhaseSettings()
    published_on: PublishedOn | None = None
    name: str = ""
    description: str = ""
    reference: str = ""
    _hash: str = PrivateAttr("")
    _apart: tuple[str, ...] = PrivateAttr(())
    """Features whose table is kept apart from that of the others: new ones, likely to change."""

    @field_validator("rows", "additions")
    @classmethod
    def _of_the_set(cls, rows: tuple[RowDefinition, ...], info: ValidationInfo) -> tuple[RowDefinition, ...]:
        """Put all features for "all"; refuse names that are unknown or stand twice."""
        known: FeatureSet | None = info.data.get("features")
        if known is None:  # a fault that is told already
            return rows
        found = {}
        for row in rows:
            names = tuple(known.columns) if row.features == (ALL,) else row.features
            if row.name in found:
                raise ValueError(f"two are named {row.name!r}. Expected unique names")
            extra = row.model_fields_set & {"select", "published", "classifiers"}
            if info.field_name == "additions" and extra:
                raise ValueError(f"{row.name}: {min(extra)} is of rows. Expected features alone")
            try:
                known.columns_of(names)
            except ValueError as error:
                raise ValueError(f"{row.name}: features: {error}") from None
            found[row.name] = row.model_copy(update={"features": names})
        return tuple(found.values())

    @model_validator(mode="after")
    def _names_what_it_has(self) -> Self:
        judges = ", ".join(self.classifiers)
        for row in self.rows:
            for key in ("published", "classifiers"):
                for name in getattr(row, key):
                    if name not in self.classifiers:
                        raise ValueError(f"rows: {row.name}: {key} names {name!r}. Expected one of {judges}")
        bases = [row.name for row in self.bases]
        if self.additions and not bases:
            raise ValueError("every row has features of an addition. Expected one row without any")
        for key, rule, known in (
            ("base", f"a row without features of an addition: {', '.join(bases)}", bases),
            ("classifier", f"a classifier: {judges}", self.classifiers),
        ):
            if (named := getattr(self.gain, key)) not in (None, *known):
                raise ValueError(f"gain.{key} is {named!r}. Expected {rule}")
        return self

    @property
    def hash(self) -> str:
        """Digest of the file it was read from, and of the feature that was added since; "" without a file."""
        return self._hash

    @property
    def needed(self) -> tuple[FeatureSet, ...]:
        """The parts of the feature set that rows and additions read: those tables are cached apart."""
        names = {f for group in (*self.rows, *self.additions) for f in group.features}
        own = self.features.restricted_to(names.difference(self._apart))
        return (own, *(self.features.restricted_to([name]) for name in self._apart))

    @property
    def bases(self) -> tuple[RowDefinition, ...]:
        """The rows that hold no column of any addition, so that each addition has something to add."""
        added = set(self.features.columns_of(f for group in self.additions for f in group.features))
        return tuple(r for r in self.rows if added.isdisjoint(self.features.columns_of(r.features)))

    def preparation(self, row: RowDefinition, classifier: str) -> Pipeline:
        """Return the unfitted steps before a classifier: the common ones, then the row's selection."""
        steps = [use.make() for use in self.steps]
        if row.select is not None:
            judge = self.classifiers[classifier].make()
            steps.append(ForwardSelector(judge, n_features_to_select=row.select.n, cv=row.select.folds))
        return make_pipeline(*(steps or ["passthrough"]))

    def trial(self, row: "MatchedRow", classifier: str, table: FeatureTable) -> Callable[..., Evaluation]:
        """Return what evaluates a row with a classifier on any splits: `evaluate` but for these."""
        return partial(
            evaluate,
            table.of(row.columns),
            table.surfaces,
            preparation=self.preparation(row.definition, classifier),
            classifier=with_segment_columns(self.classifiers[classifier].make(), row.columns),
        )

    def trials(
        self, row: "MatchedRow", classifiers: Sequence[str], table: FeatureTable
    ) -> Callable[..., list[Evaluation]]:
        """Return what evaluates a row with classifiers that share their preparation; see `evaluate_each`."""
        return partial(
            evaluate_each,
            table.of(row.columns),
            table.surfaces,
            preparation=self.preparation(row.definition, classifiers[0]),
            classifiers=[
                with_segment_columns(self.classifiers[name].make(), row.columns) for name in classifiers
            ],
        )

    def with_feature(self, feature: Feature) -> Self:
        """Return a pipeline with one more row, a feature alone, and the feature as its only addition.

        Raises
        ------
        ValueError
            If the feature set has a feature or column of that name.
        """
        known, name = self.features, feature.name
        if name in known.columns or name in known.column_names:
            raise ValueError(f"feature {name!r} is in the feature set {known.name!r}. Expected a new name")
        members = (*known.members, Member(name, feature, remove_hand_motion=known.remove_hand_motion))
        added = RowDefinition(name=name, features=(name,), reference=feature.reference)
        changed = {
            "name": f"{self.name}+{name}",
            "features": FeatureSet(known.name, members, known.reference, known.description),
            "rows": (*self.rows, added.model_copy(update={"name": f"New: {name}"})),
            "additions": (added,),
        }
        extended = self.model_copy(update=changed)
        code = hashlib.sha256(feature.source.read_bytes()).hexdigest()[:8]
        extended._hash, extended._apart = f"{self.hash}+{code}", (name,)
        return extended


def load_pipeline(name_or_path: str | Path) -> PipelineDefinition:
    """Read a pipeline.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped pipeline, or path of a pipeline (TOML). A feature set in `features` that ends in
        ".toml" is relative to the pipeline.

    Returns
    -------
    PipelineDefinition
        Feature set, steps, classifiers, rows, protocol and seed.

    Raises
    ------
    FileNotFoundError
        If the pipeline does not exist.
    ValueError
        If the file is invalid; the message names file, key and expectation.

    Examples
    --------
    >>> load_pipeline("strese2015").protocol.name
    'recording'
    """
    path = locate("pipelines", name_or_path)
    content = {"name": path.stem, **read_toml(path)}
    beside = path.parent / str(content.get("features"))
    if beside.suffix == ".toml" and beside.is_file():
        content["features"] = str(beside)
    pipeline = validate(PipelineDefinition, content, path.name)
    pipeline._hash = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    return pipeline


@dataclass(frozen=True)
class MatchedRow:
    """A row of a pipeline matched with what the recordings of a dataset have.

    Attributes
    ----------
    definition
        The row.
    columns
        Its columns in the table; empty when the row cannot be computed.
    n_features
        Columns that reach the classifier, or would if the dataset lacked nothing.
    missing
        What the dataset lacks for it.
    """

    definition: RowDefinition
    columns: tuple[str, ...]
    n_features: int
    missing: str | None = None

    @classmethod
    def of(cls, row: RowDefinition, features: FeatureSet, table: FeatureTable) -> Self:
        """Match a row with a table; a feature that no recording has is missing."""
        found = {name: table.matching(features.columns_of([name])) for name in row.features}
        defined = {c for names in found.values() for c in names if table.frame[c].notna().any()}
        lacking: dict[str, list[str]] = {}
        for name, columns in found.items():
            if not defined.intersection(columns):
                lacking.setdefault(table.reason_of(name), []).append(name)
        missing = "; ".join(f"{reason} ({', '.join(names)})" for reason, names in lacking.items()) or None
        every = tuple(dict.fromkeys(c for names in found.values() for c in names))
        usable = tuple(c for c in every if c in defined)
        n = len(usable if row.skip_missing else every)
        computable = usable if missing is None or row.skip_missing else ()
        return cls(row, computable, min(row.select.n, n) if row.select else n, missing)
