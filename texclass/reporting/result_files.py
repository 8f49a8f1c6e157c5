"""What result files hold: read back and checked, so that a page tells nothing that no command wrote."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

from pydantic import ConfigDict, Field, field_validator, model_validator

from texclass.document import Document
from texclass.experiment.benchmark_document import benchmark_document
from texclass.experiment.new_feature_document import new_feature_document
from texclass.peers.peers_document import peers_document
from texclass.reporting.invariance_document import invariance_document
from texclass.stability.judging import Mark
from texclass.stability.stability_document import stability_document
from texclass.tradeoff.tradeoff_document import tradeoff_document
from texclass.validation import Written, checked

WRITERS = (
    "JSON of texclass benchmark (also --peers, --feature), tradeoff, stability or the study of invariance"
)
Number = Annotated[float, Field(ge=-1e100, le=1e100)]
"""What a figure can show."""
Fraction = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0, le=10**100)]


class _Part(Written):
    """A part of a result; keys that no page tells are let pass."""

    model_config = ConfigDict(extra="ignore")


class _Interval(_Part):
    mean: Fraction
    low: Fraction
    high: Fraction


class _Accuracy(_Interval):
    balanced: Fraction | None = None
    interval: str = ""
    per_recording: "_Accuracy | None" = None
    per_run: "_Accuracy | None" = None


class _Dataset(_Part):
    name: str
    title: str = ""
    n_recordings: Count
    n_materials: Annotated[int, Field(ge=1)]
    n_windows: Count | None = None
    n_operators: Count | None = None
    n_sessions: Count | None = None
    n_tests: Count | None = None
    materials: tuple[str, ...] = ()
    licence: str | None = None
    source: str | None = None
    notes: tuple[str, ...] = ()
    max_seconds: Number | None = None


class _Again(_Part):
    versions: dict[str, str]
    seed: Count


class _Row(_Part):
    name: str
    n_features: Count
    accuracy: dict[str, _Accuracy]
    paper: dict[str, Fraction] = Field(default_factory=dict)
    ms_per_recording: Number | None
    missing: str | None
    selected: dict[str, dict[str, Fraction]] = Field(default_factory=dict)


class _Confusion(_Part):
    row: str
    classifier: str
    materials: Annotated[tuple[str, ...], Field(min_length=1)]
    counts: tuple[tuple[Count, ...], ...]

    @model_validator(mode="after")
    def _square(self) -> Self:
        sizes = {len(self.counts), *map(len, self.counts)}
        if sizes != {len(self.materials)}:
            raise ValueError(
                f"counts has sides of {sorted(sizes)}; the rule is {len(self.materials)}, one a material"
            )
        return self


class _Paired(_Part):
    difference: Number
    low: Number
    high: Number
    p_value: Fraction
    test: str
    folds: tuple[tuple[Number, ...], ...] = ()


class _Sum(_Part):
    n_features: Count
    accuracy: Fraction
    ms_per_recording: Number


class _Group(_Part):
    name: str
    joined: _Sum | None
    paired: _Paired | None
    p_corrected: Fraction | None
    missing: str | None


class _Gains(_Part):
    row: str
    classifier: str
    chosen: str
    without: _Sum
    n_repeats: Count
    n_folds: Count
    groups: tuple[_Group, ...]


class _Choice(_Part):
    accuracy: _Accuracy
    chosen: Annotated[tuple[tuple[str, str], ...], Field(min_length=1)]
    protocol: str


class _Undefined(_Part):
    feature: str
    reason: str
    n_recordings: Count


class _Pipeline(_Part):
    name: str
    hash: str
    features: str


class _Benchmark(_Again):
    dataset: _Dataset
    pipeline: _Pipeline
    protocol: str
    protocol_description: str
    n_folds: Count
    rows: Annotated[tuple[_Row, ...], Field(min_length=1)]
    rank_agreement: dict[str, Number | None] = Field(default_factory=dict)
    confusion: _Confusion | None
    gains: _Gains | None = None
    choice: _Choice | None = None
    left_out: tuple[tuple[str, ...], ...] = ()
    flags: tuple[tuple[str, ...], ...] = ()
    undefined: tuple[_Undefined, ...] = ()
    input_hash: str


class _Law(_Part):
    power: Number
    shift: Number


class _GainLaw(_Part):
    declared: _Law
    measured: _Law
    deviation: Number
    measured_deviation: Number = 0.0
    holds: bool


class _Answer(_Part):
    input: str
    answer: str
    detail: str
    kept: bool


class _Kin(_Part):
    column: str
    rank_correlation: Number


class _Redundancy(_Part):
    column: str
    explained: Number | None
    nearest: tuple[_Kin, ...]


class _Feature(_Part):
    name: str
    summary: str = ""
    phase: str
    unit: str
    reference: str
    ms_alone: Number
    ms_added: Number | None
    gain_law: _GainLaw | None
    behaviour: tuple[_Answer, ...]
    redundancy: tuple[_Redundancy, ...]


class _NewFeature(_Benchmark):
    new_feature: _Feature


class _Point(_Part):
    budget_ms: Number
    ms: Number
    accuracy: _Interval
    plain: _Interval
    n_features: Number
    n_columns: Number


class _Curve(_Part):
    name: str
    unit: str
    series: str
    x: Annotated[tuple[Number, ...], Field(min_length=1)]
    accuracy: tuple[_Interval, ...]
    labels: tuple[str, ...] = ()
    note: str = ""

    @model_validator(mode="after")
    def _as_long(self) -> Self:
        sizes = {len(self.x), len(self.accuracy), len(self.labels or self.x)}
        if len(sizes) > 1:
            raise ValueError(f"x, accuracy and labels have {sorted(sizes)} members; the rule is one length")
        return self


class _FeatureMs(_Part):
    feature: str
    share: Number
    alone: Number
    last: Number


class _ClassifierMs(_Part):
    name: str
    fit_ms: Number
    predict_ms: Number


class _Chosen(_Part):
    why: str
    columns: tuple[str, ...]
    features: tuple[str, ...]
    predicted_ms: Number
    measured_ms: Number
    accuracy: _Interval
    file: str = ""


class _Tradeoff(_Again):
    dataset: _Dataset
    features: str
    protocol: str
    costs: Annotated[tuple[_FeatureMs, ...], Field(min_length=1)]
    parts: dict[str, Number]
    segmentation_ms: Number
    total_ms: Annotated[float, Field(gt=0, le=1e100)]
    model_check: tuple[tuple[Number, Annotated[float, Field(gt=0)]], ...] = ()
    classifiers: tuple[_ClassifierMs, ...]
    full: _Interval
    front: Annotated[tuple[_Point, ...], Field(min_length=1)]
    knee: _Point
    at_half_cost: _Point
    fewest: tuple[tuple[Count, _Interval], ...] = ()
    curves: tuple[_Curve, ...] = ()
    chosen: _Chosen
    notes: tuple[str, ...] = ()
    input_hash: str


class _PeerCost(_Part):
    feature_ms: Number
    fit_s: Number
    predict_ms: Number
    total_s: Number
    memory_mb: Number
    first_s: Number


class _Contestant(_Part):
    name: str
    title: str
    classifier: str
    ours: bool
    status: str
    message: str
    n_columns: Count
    n_folds: Count
    accuracy: _Accuracy | None
    cost: _PeerCost | None
    difference: _Paired | None


class _Peers(_Again):
    dataset: _Dataset
    pipeline: str
    pipeline_hash: str
    protocol: str
    protocol_description: str
    n_folds: Count
    contestants: Annotated[tuple[_Contestant, ...], Field(min_length=1)]
    signals: str
    time_limit_s: Number
    peer_versions: dict[str, str]
    notes: tuple[str, ...] = ()
    input_hash: str


class _Ratio(_Part):
    feature: str
    condition: str
    ratio: Number | None
    trend: Number | None = None
    set: str = ""
    origin: str = ""


class _Invariance(_Part):
    rows: Annotated[tuple[_Ratio, ...], Field(min_length=1)]
    versions: dict[str, str] = Field(default_factory=dict)
    seed: Count = 0


class _Tally(_Part):
    library: str
    group: str
    subject: str
    family: str
    cells: Count
    marks: dict[str, Count]

    @field_validator("marks")
    @classmethod
    def _known(cls, marks: dict[str, int]) -> dict[str, int]:
        if strange := marks.keys() - set(Mark):
            raise ValueError(f"has {min(strange)!r}; the rule is one of {', '.join(Mark)}")
        return marks


class _Wrong(_Part):
    library: str
    subject: str
    family: str
    mark: str
    reason: str
    cells: Count = 1


class _Stability(_Again):
    tallies: Annotated[tuple[_Tally, ...], Field(min_length=1)]
    ours_wrong: tuple[_Wrong, ...]
    theirs_wrong: tuple[_Wrong, ...]
    quick: bool
    left_out: tuple[str, ...]
    battery: str


class Kind(NamedTuple):
    """A kind of result: the keys that tell it from the others, what it must hold, and how it is told."""

    keys: frozenset[str]
    model: type[_Part]
    document: Callable[[Mapping[str, Any]], Document]


KINDS = {
    "feature": Kind(frozenset({"new_feature"}), _NewFeature, new_feature_document),
    "peers": Kind(frozenset({"contestants"}), _Peers, peers_document),
    "tradeoff": Kind(frozenset({"front", "costs"}), _Tradeoff, tradeoff_document),
    "stability": Kind(frozenset({"tallies", "battery"}), _Stability, stability_document),
    "benchmark": Kind(frozenset({"rows", "pipeline", "protocol"}), _Benchmark, benchmark_document),
    "invariance": Kind(frozenset({"rows"}), _Invariance, invariance_document),
}
"""Name -> kind; the first whose keys are there."""


def read_document(path: str | Path) -> Document:
    """Read a result that a command wrote as JSON, and tell it.

    Parameters
    ----------
    path : str or path
        A JSON file.

    Raises
    ------
    ValueError
        If it is no JSON, no result, or lacks what such a result has; the message names file,
        key, value and rule.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8"), parse_constant=_no_number)
    except RecursionError as error:
        raise ValueError(f"{path}: {error}; the rule is {WRITERS}") from error
    except ValueError as error:
        raise ValueError(f"{path}: no JSON ({error}); the rule is {WRITERS}") from error
    kind = next(
        (kind for kind in KINDS.values() if isinstance(data, dict) and kind.keys <= data.keys()), None
    )
    if kind is None or (kind.model is _Invariance and not _has_ratios(data["rows"])):
        held = ", ".join(list(data)[:6]) if isinstance(data, dict) else type(data).__name__
        raise ValueError(f"{path}: holds no result ({held or 'nothing'}); the rule is {WRITERS}")
    checked(kind.model, data, path)
    try:
        return kind.document(data)
    except (ValueError, TypeError, LookupError, ArithmeticError) as error:  # numbers that fit no figure
        raise ValueError(f"{path}: cannot be shown ({error}); the rule is what its command wrote") from error


def _has_ratios(rows: Any) -> bool:
    """Tell the study of invariance from other studies with rows."""
    return isinstance(rows, Sequence) and bool(rows) and isinstance(rows[0], dict) and "ratio" in rows[0]


def _no_number(constant: str) -> float:
    raise ValueError(f"{constant:.40} is no JSON number")
