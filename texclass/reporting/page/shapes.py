"""The shapes that results have as JSON, and a check that names what does not fit."""

from collections.abc import Callable
from typing import Any

from texclass.stability.judging import Mark

Rule = Callable[[Any, str], None]
"""Raises a ValueError that names the place and the rule."""
LARGEST = 1e100
"""Size of a number that a figure can show."""


def number(value: Any, where: str) -> None:
    """Accept a number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST:
        raise ValueError(f"{where} is {_shown(value)}; the rule is a number of at most {LARGEST:g}")


def fraction(value: Any, where: str) -> None:
    """Accept a number from 0 to 1."""
    number(value, where)
    if not 0 <= value <= 1:
        raise ValueError(f"{where} is {_shown(value)}; the rule is a fraction from 0 to 1")


def count(value: Any, where: str) -> None:
    """Accept a whole number from 0."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= LARGEST:
        raise ValueError(f"{where} is {_shown(value)}; the rule is a whole number from 0")


def text(value: Any, where: str) -> None:
    """Accept a text."""
    if not isinstance(value, str):
        raise ValueError(f"{where} is {_shown(value)}; the rule is a text")


def anything(value: Any, where: str) -> None:
    """Accept whatever there is."""


def listed(rule: Rule, *, least: int = 0) -> Rule:
    """Return a rule for a list of so many members at least."""

    def check(value: Any, where: str) -> None:
        if not isinstance(value, list):
            raise ValueError(f"{where} is {_shown(value)}; the rule is a list")
        if len(value) < least:
            raise ValueError(f"{where} has {len(value)} members; the rule is at least {least}")
        for i, member in enumerate(value):
            rule(member, f"{where}[{i}]")

    return check


def mapped(rule: Rule) -> Rule:
    """Return a rule for an object with any keys."""

    def check(value: Any, where: str) -> None:
        if not isinstance(value, dict):
            raise ValueError(f"{where} is {_shown(value)}; the rule is an object")
        for key, member in value.items():
            rule(member, f"{where}.{key}")

    return check


def optional(rule: Rule) -> Rule:
    """Return a rule that also accepts null."""

    def check(value: Any, where: str) -> None:
        if value is not None:
            rule(value, where)

    return check


def fields(**rules: Rule) -> Rule:
    """Return a rule for an object; keys ending in `_` (left out of the name) may be missing."""

    def check(value: Any, where: str) -> None:
        if not isinstance(value, dict):
            raise ValueError(f"{where or 'it'} is {_shown(value)}; the rule is an object")
        for key, rule in rules.items():
            name, may_miss = key.removesuffix("_"), key.endswith("_")
            place = f"{where}.{name}" if where else name
            if name in value:
                rule(value[name], place)
            elif not may_miss:
                raise ValueError(f"{place} is missing; the rule is that it is there")

    return check


def square(value: Any, where: str) -> None:
    """Accept a confusion matrix: one row and one column of counts for each material."""
    fields(row=text, classifier=text, materials=listed(text, least=1), counts=listed(listed(count)))(
        value, where
    )
    n = len(value["materials"])
    sizes = {len(value["counts"]), *(len(row) for row in value["counts"])}
    if sizes != {n}:
        raise ValueError(f"{where}.counts has sides of {sorted(sizes)}; the rule is {n}, one a material")


def pair(value: Any, where: str) -> None:
    """Accept a row and a classifier."""
    listed(text, least=2)(value, where)
    if len(value) > 2:
        raise ValueError(f"{where} has {len(value)} members; the rule is a row and a classifier")


def _shown(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 40 else f"{shown[:37]}..."


def _vote(value: Any, where: str) -> None:
    accuracy(value, where)


estimate = fields(mean=fraction, low=fraction, high=fraction)
accuracy = fields(
    mean=fraction, low=fraction, high=fraction, balanced_=optional(fraction), interval_=text,
    per_recording_=_vote, per_run_=_vote,
)  # fmt: skip
DATASET = fields(
    name=text, title_=text, n_recordings=count, n_materials=count, n_windows_=count, n_operators_=count,
    n_sessions_=count, n_tests_=count, materials_=listed(text), licence_=text, source_=text,
    notes_=listed(text), max_seconds_=optional(number),
)  # fmt: skip
_AGAIN = {"versions": mapped(text), "seed": count, "input_hash": text}
_SUM = fields(n_features=count, accuracy=fraction, ms_per_recording=number)
_PAIRED = fields(
    difference=number, low=number, high=number, p_value=fraction, test=text, folds=listed(listed(number))
)
_GAINS = fields(
    row=text, classifier=text, chosen=text, without=_SUM, n_repeats=count, n_folds=count,
    groups=listed(
        fields(
            name=text, joined=optional(_SUM), paired=optional(_PAIRED), p_corrected=optional(fraction),
            missing=optional(text),
        )
    ),
)  # fmt: skip
_CHOICE = fields(accuracy=accuracy, chosen=listed(pair, least=1), protocol=text)
_BENCHMARK = {
    "dataset": DATASET,
    "pipeline": fields(name=text, hash=text, features=text),
    "protocol": text,
    "protocol_description": text,
    "n_folds": count,
    "rows": listed(
        fields(
            name=text, n_features=count, accuracy=mapped(accuracy), paper_=mapped(fraction),
            ms_per_recording=optional(number), missing=optional(text), selected_=mapped(mapped(fraction)),
            reference_=text,
        ),
        least=1,
    ),
    "rank_agreement_": mapped(optional(number)),
    "confusion": optional(square),
    "gains_": optional(_GAINS),
    "choice_": optional(_CHOICE),
    "left_out_": listed(listed(text)),
    "flags_": listed(listed(text)),
    "undefined_": listed(fields(feature=text, reason=text, n_recordings=count)),
    **_AGAIN,
}  # fmt: skip
_GAIN = fields(power=number, shift=number)
_FEATURE = fields(
    name=text, phase=text, unit=text, reference=text, ms_alone=number, ms_added=optional(number),
    gain_law=optional(fields(declared=_GAIN, measured=_GAIN, deviation=number, holds=anything)),
    behaviour=listed(fields(input=text, answer=text, detail=text, kept=anything)),
    redundancy=listed(
        fields(
            column=text, explained=optional(number),
            nearest=listed(fields(column=text, rank_correlation=number)),
        )
    ),
)  # fmt: skip
_POINT = fields(
    budget_ms=number, ms=number, accuracy=estimate, plain=estimate, n_features=number, n_columns=number
)
_CURVE = fields(
    name=text, unit=text, x=listed(number, least=1), accuracy=listed(estimate, least=1), labels_=listed(text),
    series=text, note_=text,
)  # fmt: skip
_COST = fields(
    feature_ms=number, fit_s=number, predict_ms=number, total_s=number, memory_mb=number, first_s=number
)
_CONTESTANT = fields(
    name=text, title=text, classifier=text, ours=anything, status=text, message=text, n_columns=count,
    n_folds=count, accuracy=optional(estimate), cost=optional(_COST),
    difference=optional(fields(difference=number, low=number, high=number, p_value=fraction, test=text)),
)  # fmt: skip


_WRONG = fields(library=text, subject=text, family=text, mark=text, reason=text, cells_=count)


def _marks(value: Any, where: str) -> None:
    mapped(count)(value, where)
    known = {mark.value for mark in Mark}
    if strange := value.keys() - known:
        raise ValueError(f"{where} has {_shown(min(strange))}; the rule is one of {', '.join(sorted(known))}")


def _few(value: Any, where: str) -> None:
    listed(anything, least=2)(value, where)
    count(value[0], f"{where}[0]")
    estimate(value[1], f"{where}[1]")


def _curve(value: Any, where: str) -> None:
    _CURVE(value, where)
    sizes = {len(value["x"]), len(value["accuracy"]), len(value.get("labels") or value["x"])}
    if len(sizes) > 1:
        raise ValueError(f"{where} has lists of {sorted(sizes)} members; the rule is one length")


SHAPES: dict[str, Rule] = {
    "benchmark": fields(**_BENCHMARK),
    "feature": fields(**_BENCHMARK, new_feature=_FEATURE),
    "tradeoff": fields(
        dataset=DATASET, features=text, protocol=text,
        costs=listed(fields(feature=text, share=number, alone=number, last=number), least=1),
        parts=mapped(number), segmentation_ms=number, total_ms=number,
        classifiers=listed(fields(name=text, fit_ms=number, predict_ms=number)),
        full=estimate, front=listed(_POINT, least=1), knee=_POINT, at_half_cost=_POINT,
        fewest_=listed(_few), curves_=listed(_curve),
        chosen=fields(why=text, columns=listed(text), features=listed(text), predicted_ms=number,
                      measured_ms=number, accuracy=estimate, file_=text),
        notes_=listed(text), **_AGAIN,
    ),
    "peers": fields(
        dataset=DATASET, pipeline=text, pipeline_hash=text, protocol=text, protocol_description=text,
        n_folds=count, contestants=listed(_CONTESTANT, least=1), signals=text, time_limit_s=number,
        peer_versions=mapped(text), notes_=listed(text), **_AGAIN,
    ),
    "invariance": fields(
        rows=listed(
            fields(feature=text, condition=text, ratio=optional(number), trend_=optional(number),
                   set_=text, origin_=text),
            least=1,
        ),
        versions_=mapped(text), seed_=count, input_hash_=text,
    ),
    "stability": fields(
        tallies=listed(
            fields(library=text, group=text, subject=text, family=text, cells=count, marks=_marks), least=1
        ),
        ours_wrong=listed(_WRONG), theirs_wrong=listed(_WRONG), quick=anything, left_out=listed(text),
        battery=text, versions=mapped(text), seed=count,
    ),
}  # fmt: skip
"""Kind of result -> its rule; other keys are let pass."""


def kind_of(document: Any) -> str | None:
    """Return the kind of result that a JSON document is; None if it is none."""
    if not isinstance(document, dict):
        return None
    rows = document.get("rows")
    of_features = isinstance(rows, list) and rows and isinstance(rows[0], dict) and "condition" in rows[0]
    marks = {
        "feature": "new_feature" in document,
        "peers": "contestants" in document,
        "tradeoff": {"front", "costs"} <= document.keys(),
        "stability": {"tallies", "battery"} <= document.keys(),
        "invariance": bool(of_features) and "ratio" in rows[0] if rows else False,
        "benchmark": {"rows", "pipeline", "protocol"} <= document.keys(),
    }
    return next((kind for kind, there in marks.items() if there), None)
