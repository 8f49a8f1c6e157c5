"""Pipeline files (TOML): definition and validation of feature set, steps, classifiers and rows."""

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

DEFAULT_PIPELINE = "surfaces"
"""Name of the pipeline with which models are trained by default."""
ALL = "all"
"""Keyword in a row that selects every feature of the set."""


class Use(StrictModel):
    """Estimator in a TOML file: the path of its class, and the arguments of its constructor.

    An argument can itself be an estimator: `estimator = { use = "..." }`.

    Attributes
    ----------
    use
        Path of a class in `ESTIMATORS`.
    """

    model_config = ConfigDict(extra="allow")
    use: str

    def make(self) -> Any:
        """Return a new unfitted estimator."""
        arguments = dict(self.parameters)
        for key, value in arguments.items():
            if _is_use(value):
                try:
                    arguments[key] = Use(**value).make()
                except ValidationError as error:  # report the first fault in one line
                    raise ValueError(error.errors()[0]["msg"]) from None
        return resolve(self.use)(**arguments)

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Arguments of the constructor."""
        return self.model_extra or {}

    @model_validator(mode="after")
    def _check_arguments(self) -> Self:
        check_parameters(self.use, self.parameters)
        try:
            estimator = self.make()
        except Exception as error:  # estimators raise many types of errors for bad arguments
            raise ValueError(str(error)) from None
        try:
            estimator.fit(None, None)
        except Exception as error:
            # `fit` checks parameters before data, so an error that names a parameter concerns its value.
            names = [key for key, value in self.parameters.items() if not _is_use(value)]
            if any(re.search(rf"\b{re.escape(key)}\b", str(error)) for key in names):
                raise ValueError(str(error)) from None
        return self


def _is_use(value: Any) -> bool:
    return isinstance(value, dict) and "use" in value


def _check_classifier(use: Use) -> Use:
    if not is_classifier(use.make()):
        raise ValueError(f"{use.use} is not a classifier. Use a classifier of scikit-learn or texclass")
    return use


def _check_transformer(use: Use) -> Use:
    if is_classifier(estimator := use.make()) or not hasattr(estimator, "transform"):
        raise ValueError(f"{use.use} is not a transformer. Use a transformer of scikit-learn or texclass")
    return use


class Selection(StrictModel):
    """Settings of forward selection in a pipeline row: `n` columns, selected with `folds` inner folds."""

    n: Annotated[int, Field(ge=1)]
    folds: Annotated[int, Field(ge=2)] = 5


def _feature_names(value: Any) -> Any:
    """Convert a TOML list to a tuple, and the keyword "all" to the tuple ("all",)."""
    return (ALL,) if value == ALL else tuple(value) if isinstance(value, list) else value


class RowDefinition(StrictModel):
    """Row of the benchmark table (a feature subset), or feature group of the ablation.

    Attributes
    ----------
    name
        Name in reports.
    features
        Names of features or columns of the feature set. A TOML file can contain "all" instead of a list.
    reference
        Source of the features or of the published accuracies.
    skip_missing
        Whether to evaluate the row without the features that are undefined for a dataset.
    select
        Rows only: settings of sequential forward selection among the columns (default: no selection).
    published
        Rows only: published accuracy in per cent by classifier.
    classifiers
        Rows only: classifiers of the pipeline that evaluate this row (default: all).
    note
        Rows only: note printed below the table.

    Examples
    --------
    >>> row = RowDefinition(name="MFCC", features=("mfcc",))
    >>> row.select_classifiers(["lda", "naive_bayes"])
    ('lda', 'naive_bayes')
    """

    name: str
    features: Annotated[tuple[str, ...], BeforeValidator(_feature_names)]
    reference: str = ""
    skip_missing: bool = False
    select: Selection | None = None
    published: dict[str, Annotated[float, Field(ge=0, le=100)]] = Field(default_factory=dict)
    classifiers: tuple[str, ...] = ()
    note: str = ""

    def select_classifiers(self, classifiers: Iterable[str]) -> tuple[str, ...]:
        """Return the classifiers of a pipeline that evaluate this row."""
        return self.classifiers or tuple(classifiers)


class FoldSettings(StrictModel):
    """Name of the protocol of a pipeline, and number of folds for protocols that draw folds."""

    name: Annotated[str, AfterValidator(lambda name: find_protocol(name).name)] = "recording"
    folds: Annotated[int, Field(ge=2)] = 10


class PublishedOn(StrictModel):
    """Conditions under which the published accuracies were measured.

    Attributes
    ----------
    n_surfaces
        Number of surfaces.
    protocols
        Names of the texclass protocols that split recordings in the same way as the publication.
    """

    n_surfaces: Annotated[int, Field(ge=2)]
    protocols: tuple[str, ...] = ()

    @field_validator("protocols")
    @classmethod
    def _check_protocols(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(find_protocol(name).name for name in names)


class AblationSettings(StrictModel):
    """Settings of the ablation: the row to which feature groups are added, and the number of repeats.

    Attributes
    ----------
    base
        Row to which the groups are added (default: the most accurate row without features of any group).
    classifier
        Classifier (default: the most accurate classifier for that row).
    repeats
        Number of repeats, whose seeds are consecutive integers beginning with the seed of the pipeline
        (default 5). Only protocols that draw folds use it.
    """

    base: str | None = None
    classifier: str | None = None
    repeats: Annotated[int, Field(ge=1)] = 5


def _to_feature_set(value: Any) -> FeatureSet:
    if isinstance(value, FeatureSet):
        return value
    if not isinstance(value, str):
        raise ValueError(f"expected the name of a shipped feature set or a path, got {value!r:.60}")
    try:
        return load_feature_set(value)
    except OSError as error:
        raise ValueError(str(error)) from None


class PipelineDefinition(StrictModel):
    """Definition of a benchmark, without the dataset; see `load_pipeline`.

    Attributes
    ----------
    name, description, reference
        Name, description and source of the pipeline.
    features
        Feature set. A TOML file contains the name of a shipped feature set or a path.
    steps
        Transformers that run before every classifier.
    classifiers
        Classifiers by name.
    rows
        Rows of the benchmark table.
    additions
        Feature groups of the ablation.
    seed
        Random seed of the folds.
    channels
        See `FeatureExtractor`. If it is "auto", `decide_axes` decides it from the recordings.
    overlap
        Number of training windows that start within each short window; see `add_overlapping_windows`.
    protocol, gain
        Settings of the protocol and of the ablation.
    published_on
        Conditions of the published accuracies. If it is None, measured and published accuracies are not
        compared.
    phase_settings
        Settings of the segmentation, used unless the dataset has its own settings; see `PhaseSettings`.

    Examples
    --------
    >>> pipeline = load_pipeline("strese2015")
    >>> list(pipeline.classifiers)
    ['naive_bayes', 'lda', 'euclidean']
    """

    model_config = ConfigDict(arbitrary_types_allowed=True)
    features: Annotated[FeatureSet, PlainValidator(_to_feature_set)]
    seed: Annotated[int, Field(ge=0)]
    classifiers: Annotated[dict[str, Annotated[Use, AfterValidator(_check_classifier)]], Field(min_length=1)]
    rows: Annotated[tuple[RowDefinition, ...], Field(min_length=1)]
    additions: tuple[RowDefinition, ...] = ()
    steps: tuple[Annotated[Use, AfterValidator(_check_transformer)], ...] = ()
    channels: Channels = "combine"
    overlap: Annotated[int, Field(ge=1)] = 1
    protocol: FoldSettings = FoldSettings()
    gain: AblationSettings = AblationSettings()
    phase_settings: PhaseSettings = PhaseSettings()
    published_on: PublishedOn | None = None
    name: str = ""
    description: str = ""
    reference: str = ""
    _hash: str = PrivateAttr("")
    _separate: tuple[str, ...] = PrivateAttr(())
    """Features with a separate table in the cache: new features, whose code is likely to change."""

    @field_validator("rows", "additions")
    @classmethod
    def _check_features(
        cls, rows: tuple[RowDefinition, ...], info: ValidationInfo
    ) -> tuple[RowDefinition, ...]:
        """Replace "all" by all features; reject unknown features and duplicate names."""
        feature_set: FeatureSet | None = info.data.get("features")
        if feature_set is None:  # pydantic already reports this fault
            return rows
        checked_rows = {}
        for row in rows:
            names = tuple(feature_set.columns) if row.features == (ALL,) else row.features
            if row.name in checked_rows:
                raise ValueError(f"two entries have the name {row.name!r}. Rename one of them")
            extra = row.model_fields_set & {"select", "published", "classifiers"}
            if info.field_name == "additions" and extra:
                raise ValueError(
                    f"{row.name}: the key {min(extra)!r} is allowed in [[rows]], not in [[additions]]. "
                    "Remove it"
                )
            try:
                feature_set.columns_of(names)
            except ValueError as error:
                raise ValueError(f"{row.name}: features: {error}") from None
            checked_rows[row.name] = row.model_copy(update={"features": names})
        return tuple(checked_rows.values())

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        classifiers = ", ".join(self.classifiers)
        for row in self.rows:
            for key in ("published", "classifiers"):
                for name in getattr(row, key):
                    if name not in self.classifiers:
                        raise ValueError(
                            f"rows: {row.name}: {key} contains {name!r}. Expected one of {classifiers}"
                        )
        bases = [row.name for row in self.bases]
        if self.additions and not bases:
            raise ValueError(
                "cannot compute the ablation: every row already contains features of [[additions]]. Expected "
                "at least one row without them"
            )
        for key, expected, choices in (
            ("base", f"one of the rows without features of [[additions]]: {', '.join(bases)}", bases),
            ("classifier", f"one of {classifiers}", self.classifiers),
        ):
            if (value := getattr(self.gain, key)) not in (None, *choices):
                raise ValueError(f"gain.{key} is {value!r}. Expected {expected}")
        return self

    @property
    def hash(self) -> str:
        """Digest of the pipeline file and of the code of an added feature, or "" if there is no file."""
        return self._hash

    @property
    def needed(self) -> tuple[FeatureSet, ...]:
        """Feature sets that rows and additions need. Each has its own table in the cache."""
        names = {f for group in (*self.rows, *self.additions) for f in group.features}
        shared = self.features.restricted_to(names.difference(self._separate))
        return (shared, *(self.features.restricted_to([name]) for name in self._separate))

    @property
    def bases(self) -> tuple[RowDefinition, ...]:
        """Rows that contain no column of any addition."""
        columns = set(self.features.columns_of(f for group in self.additions for f in group.features))
        return tuple(r for r in self.rows if columns.isdisjoint(self.features.columns_of(r.features)))

    def preparation(self, row: RowDefinition, classifier: str) -> Pipeline:
        """Return the unfitted steps before a classifier: the pipeline's steps, then forward selection."""
        steps = [use.make() for use in self.steps]
        if row.select is not None:
            criterion = self.classifiers[classifier].make()
            steps.append(ForwardSelector(criterion, n_features_to_select=row.select.n, cv=row.select.folds))
        return make_pipeline(*(steps or ["passthrough"]))

    def trial(self, row: "MatchedRow", classifier: str, table: FeatureTable) -> Callable[..., Evaluation]:
        """Return `evaluate` for a row and a classifier, with all required arguments bound except splits."""
        return partial(
            evaluate,
            table.select(row.columns),
            table.surfaces,
            preparation=self.preparation(row.definition, classifier),
            classifier=with_segment_columns(self.classifiers[classifier].make(), row.columns),
        )

    def trials(
        self, row: "MatchedRow", classifiers: Sequence[str], table: FeatureTable
    ) -> Callable[..., list[Evaluation]]:
        """Return `evaluate_each` for a row, with all required arguments bound except splits."""
        return partial(
            evaluate_each,
            table.select(row.columns),
            table.surfaces,
            preparation=self.preparation(row.definition, classifiers[0]),
            classifiers=[
                with_segment_columns(self.classifiers[name].make(), row.columns) for name in classifiers
            ],
        )

    def with_feature(self, feature: Feature) -> Self:
        """Return the pipeline with a new feature as an additional row, and as the only addition.

        Raises
        ------
        ValueError
            If the feature set has a feature or column of this name.
        """
        base, name = self.features, feature.name
        if name in base.columns or name in base.column_names:
            raise ValueError(
                f"the feature set {base.name!r} already contains a feature or column {name!r}. Rename the "
                "new feature"
            )
        members = (*base.members, Member(name, feature, remove_hand_motion=base.remove_hand_motion))
        row = RowDefinition(name=name, features=(name,), reference=feature.reference)
        update = {
            "name": f"{self.name}+{name}",
            "features": FeatureSet(base.name, members, base.reference, base.description),
            "rows": (*self.rows, row.model_copy(update={"name": f"New: {name}"})),
            "additions": (row,),
        }
        extended = self.model_copy(update=update)
        # A notebook cell has no file: Jupyter derives the name from the code of the cell.
        file = feature.source
        code = hashlib.sha256(file.read_bytes() if file.is_file() else file.name.encode()).hexdigest()[:8]
        extended._hash, extended._separate = f"{self.hash}+{code}", (name,)
        return extended


def load_pipeline(name_or_path: str | Path) -> PipelineDefinition:
    """Read a pipeline file.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped pipeline, or path of a TOML file. If `features` in this file is a path, it is
        relative to the folder of the file.

    Returns
    -------
    PipelineDefinition
        Feature set, steps, classifiers, rows, protocol and seed.

    Raises
    ------
    FileNotFoundError
        If the pipeline does not exist.
    ValueError
        If the file is invalid.

    Examples
    --------
    >>> load_pipeline("strese2015").protocol.name
    'recording'
    """
    path = locate("pipelines", name_or_path)
    content = {"name": path.stem, **read_toml(path)}
    feature_file = path.parent / str(content.get("features"))
    if feature_file.suffix == ".toml" and feature_file.is_file():
        content["features"] = str(feature_file)
    pipeline = validate(PipelineDefinition, content, path.name)
    pipeline._hash = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    return pipeline


@dataclass(frozen=True)
class MatchedRow:
    """Row of a pipeline, and those of its columns that have values in a dataset.

    Attributes
    ----------
    definition
        Definition of the row.
    columns
        Names of the columns in the feature table; empty if the row cannot be evaluated.
    n_features
        Number of columns that the classifier receives, even if the row cannot be evaluated.
    missing
        Reasons why features are missing in the dataset, or None if no feature is missing.
    """

    definition: RowDefinition
    columns: tuple[str, ...]
    n_features: int
    missing: str | None = None

    @classmethod
    def match(cls, row: RowDefinition, features: FeatureSet, table: FeatureTable) -> Self:
        """Match a row with a feature table. A feature is missing if no recording has a value for it."""
        columns_by_feature = {name: table.match_columns(features.columns_of([name])) for name in row.features}
        defined = {
            column
            for columns in columns_by_feature.values()
            for column in columns
            if table.frame[column].notna().any()
        }
        features_by_reason: dict[str, list[str]] = {}
        for name, columns in columns_by_feature.items():
            if not defined.intersection(columns):
                features_by_reason.setdefault(table.reason_of(name), []).append(name)
        missing = (
            "; ".join(f"{why} ({', '.join(names)})" for why, names in features_by_reason.items()) or None
        )
        all_columns = tuple(dict.fromkeys(c for columns in columns_by_feature.values() for c in columns))
        usable = tuple(c for c in all_columns if c in defined)
        n = len(usable if row.skip_missing else all_columns)
        computable = usable if missing is None or row.skip_missing else ()
        return cls(row, computable, min(row.select.n, n) if row.select else n, missing)
