"""What result files hold, read back and checked, and a page of several: it tells only what commands wrote."""

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any, NamedTuple

from pydantic import ConfigDict, Field, create_model, model_validator

from texclass.atomic_write import path_ending, write_atomic
from texclass.baselines.baselines_document import baselines_document
from texclass.cli.invariance_document import invariance_document
from texclass.evaluation.benchmark_document import benchmark_document
from texclass.evaluation.new_feature import new_feature_document
from texclass.evaluation.pipeline import load_pipeline
from texclass.evaluation.result import COMPUTED_BY
from texclass.features.sets import load_feature_set
from texclass.provenance import code_hash
from texclass.reporting import Document, render_markdown, render_page
from texclass.stability.battery import stability_document
from texclass.stability.rules import Mark
from texclass.tradeoff.tradeoff_document import tradeoff_document
from texclass.validation import Written, checked

TITLE = "Surfaces from what a tool felt"
"""Of a page of several datasets."""
WRITERS = (
    "JSON of texclass benchmark (also --baselines, --feature), tradeoff, stability or the study of invariance"
)
NUMBER = Annotated[float, Field(ge=-1e100, le=1e100)]
"""What a figure can show."""
ABOVE_0 = Annotated[float, Field(gt=0, le=1e100)]
FRACTION = Annotated[float, Field(ge=0, le=1)]
COUNT = Annotated[int, Field(ge=0, le=10**100)]


class ResultPart(Written):
    """A part of a result; keys that no document tells are let pass."""

    model_config = ConfigDict(extra="ignore")


def part(*bases: type[ResultPart], check: Callable[[Any], Any] | None = None, **fields: Any) -> Any:
    """Return a model of these fields; those that may be missing are given by `maybe`, `some` or `named`."""
    told: Any = {name: kind if isinstance(kind, tuple) else (kind, ...) for name, kind in fields.items()}
    checks: Any = {"_check": model_validator(mode="after")(check)} if check else {}
    return create_model("ResultPart", __base__=bases or (ResultPart,), __validators__=checks, **told)


def maybe(kind: Any) -> tuple[Any, Any]:
    """Return a field that may be null or missing."""
    return kind | None, None


def listed(kind: Any, *, least: int = 0) -> Any:
    """Return the kind of a list of so many members at least."""
    return Annotated[GenericAlias(tuple, (kind, ...)), Field(min_length=least)]


def some(kind: Any) -> tuple[Any, Any]:
    """Return a field that is a list, or missing."""
    return listed(kind), ()


def named(kind: Any) -> Any:
    """Return the kind of an object with any keys."""
    return GenericAlias(dict, (str, kind))


def square(found: Any) -> Any:
    """Check that a confusion matrix has a row and a column for each material."""
    sizes, n = {len(found.counts), *map(len, found.counts)}, len(found.materials)
    if sizes != {n}:
        raise ValueError(f"counts has sides of {sorted(sizes)}; the rule is {n}, one a material")
    return found


def paired_outline(example: Any) -> Any:
    """Check that the outline of a signal has as many least as greatest samples."""
    sizes = [len(example.low), len(example.high)]
    if sizes[0] != sizes[1]:
        raise ValueError(f"low and high have {sizes} members; the rule is one length")
    return example


def as_long(curve: Any) -> Any:
    """Check that a curve has as many accuracies, and labels if any, as places."""
    sizes = {len(curve.x), len(curve.accuracy), len(curve.labels or curve.x)}
    if len(sizes) > 1:
        raise ValueError(f"x, accuracy and labels have {sorted(sizes)} members; the rule is one length")
    return curve


def known(tally: Any) -> Any:
    """Check that the marks of a tally are those of the battery."""
    if strange := tally.marks.keys() - set(Mark):
        raise ValueError(f"marks has {min(strange)!r}; the rule is one of {', '.join(Mark)}")
    return tally


INTERVAL = part(mean=FRACTION, low=FRACTION, high=FRACTION)
ACCURACY = part(
    INTERVAL,
    balanced=maybe(FRACTION),
    worst=maybe(FRACTION),
    interval=(str, ""),
    clusters=(str, ""),
    n_clusters=maybe(COUNT),
    per_recording=maybe(INTERVAL),
    per_run=maybe(INTERVAL),
)
DATASET = part(
    name=str, title=(str, ""), n_recordings=COUNT, n_materials=Annotated[int, Field(ge=1)],
    n_windows=maybe(COUNT), n_operators=maybe(COUNT), n_sessions=maybe(COUNT), n_tests=maybe(COUNT),
    chance=maybe(FRACTION), fs_hz=maybe(ABOVE_0), unit=(str, ""),
    materials=some(str), licence=maybe(str), source=maybe(str), notes=some(str), max_seconds=maybe(NUMBER),
)  # fmt: skip
CODE = part(code_hash=(str, ""), code_of=some(Annotated[str, Field(pattern=r"^\w+$")]))
AGAIN = part(CODE, versions=named(str), seed=COUNT)
MEASURED = part(AGAIN, movement=(str, ""), dataset=DATASET, protocol=str, input_hash=str)
PAIRED = part(
    difference=NUMBER, low=NUMBER, high=NUMBER, p_value=FRACTION, test=str, folds=some(listed(NUMBER)),
    least=maybe(NUMBER), clusters=(str, ""), n_clusters=maybe(COUNT),
)  # fmt: skip
SUM = part(n_features=COUNT, accuracy=FRACTION, ms_per_recording=NUMBER)
ROW = part(
    name=str, n_features=COUNT, accuracy=named(ACCURACY), paper=(named(FRACTION), {}),
    ms_per_recording=NUMBER | None, missing=str | None, selected=(named(named(FRACTION)), {}),
)  # fmt: skip
GROUP = part(
    name=str, joined=SUM | None, paired=PAIRED | None, p_corrected=FRACTION | None, missing=str | None
)
GAINS = part(
    row=str, classifier=str, chosen=str, without=SUM, n_repeats=COUNT, n_folds=COUNT, groups=listed(GROUP)
)
CHOICE = part(accuracy=ACCURACY, chosen=listed(tuple[str, str], least=1), protocols=listed(str))
EXAMPLE = part(
    recording=str, material=(str, ""), unit=str, seconds=ABOVE_0,
    low=listed(NUMBER, least=1), high=listed(NUMBER, least=1),
    taps=some(tuple[NUMBER, NUMBER, NUMBER]), movement=maybe(tuple[NUMBER, NUMBER]), check=paired_outline,
)  # fmt: skip
BENCHMARK = part(
    MEASURED,
    pipeline=part(name=str, hash=str, features=str), protocol_description=str, n_folds=COUNT,
    n_starts=maybe(COUNT), rows=listed(ROW, least=1), segmentation_ms=maybe(NUMBER),
    rank_agreement=(named(NUMBER | None), {}),
    rank_agreement_interval=(named(tuple[NUMBER, NUMBER] | None), {}),
    published_on=maybe(part(n_materials=COUNT, protocols=listed(str))),
    confusion=part(
        row=str, classifier=str, materials=listed(str, least=1), counts=listed(listed(COUNT)), check=square
    ) | None,
    gains=maybe(GAINS),
    choice=maybe(CHOICE),
    example=maybe(EXAMPLE),
    left_out=some(listed(str)), flags=some(listed(str)),
    undefined=some(part(feature=str, reason=str, n_recordings=COUNT)),
)  # fmt: skip
LAW = part(power=NUMBER, shift=NUMBER)
NEW_FEATURE = part(
    BENCHMARK,
    new_feature=part(
        name=str, summary=(str, ""), phase=str, unit=str, reference=str, ms_alone=NUMBER,
        ms_added=NUMBER | None,
        gain_law=part(
            declared=LAW, measured=LAW, deviation=NUMBER, measured_deviation=(NUMBER, 0.0), holds=bool
        ) | None,
        behaviour=listed(part(input=str, answer=str, detail=str, kept=bool)),
        redundancy=listed(
            part(
                column=str, explained=NUMBER | None,
                nearest=listed(part(column=str, rank_correlation=NUMBER)),
            )
        ),
    ),
)  # fmt: skip
POINT = part(
    budget_ms=NUMBER, ms=NUMBER, accuracy=INTERVAL, plain=INTERVAL, n_features=NUMBER, n_columns=NUMBER
)
TRADEOFF = part(
    MEASURED,
    clusters=(str, ""), n_clusters=maybe(COUNT), features_hash=(str, ""),
    features=str, costs=listed(part(feature=str, share=NUMBER, alone=NUMBER, last=NUMBER), least=1),
    parts=named(NUMBER), whole_path=(bool, False), segmentation_ms=NUMBER, total_ms=ABOVE_0,
    costs_of=(str, ""),
    model_check=some(tuple[NUMBER, ABOVE_0]),
    classifiers=listed(part(name=str, fit_ms=NUMBER, predict_ms=NUMBER)), full=INTERVAL,
    front=listed(POINT, least=1), knee=POINT, at_half_cost=POINT,
    fewest=some(GenericAlias(tuple, (COUNT, INTERVAL))),
    curves=some(
        part(
            name=str, unit=str, series=str, x=listed(NUMBER, least=1), accuracy=listed(INTERVAL),
            labels=some(str), note=(str, ""), check=as_long,
        )
    ),
    chosen=part(
        why=str, columns=listed(str), features=listed(str), predicted_ms=NUMBER, measured_ms=NUMBER,
        accuracy=INTERVAL, file=(str, ""),
    ),
    notes=some(str),
)  # fmt: skip
COST = part(
    feature_ms=NUMBER, fit_s=NUMBER, predict_ms=NUMBER, total_s=NUMBER, memory_mb=NUMBER, first_s=NUMBER
)
BASELINES = part(
    MEASURED, segmentation_ms=maybe(NUMBER),
    pipeline=str, pipeline_hash=str, protocol_description=str, n_folds=COUNT, n_pairs=maybe(COUNT),
    contestants=listed(
        part(
            name=str, title=str, classifier=str, ours=bool, status=str, message=str, n_columns=COUNT,
            n_folds=COUNT, accuracy=ACCURACY | None, cost=COST | None, difference=PAIRED | None,
        ),
        least=1,
    ),
    signals=str, time_limit_s=NUMBER, baseline_versions=named(str), notes=some(str),
)  # fmt: skip
INVARIANCE = part(
    rows=listed(
        part(
            feature=str, condition=str, ratio=NUMBER | None, trend=maybe(NUMBER), set=(str, ""),
            origin=(str, ""),
        ),
        least=1,
    ),
    versions=(named(str), {}), seed=(COUNT, 0),
)  # fmt: skip
WRONG = part(library=str, subject=str, family=str, mark=str, reason=str, cells=(COUNT, 1))
STABILITY = part(
    AGAIN,
    tallies=listed(
        part(
            library=str, group=str, subject=str, family=str, cells=COUNT, marks=named(COUNT), check=known
        ),
        least=1,
    ),
    ours_wrong=listed(WRONG), theirs_wrong=listed(WRONG), quick=bool, left_out=listed(str), battery=str,
)  # fmt: skip


class Kind(NamedTuple):
    """A kind of result: the keys that tell it from the others, what it must hold, and how it is told."""

    keys: frozenset[str]
    model: type[ResultPart]
    document: Callable[[Mapping[str, Any]], Document]


KINDS = {
    "feature": Kind(frozenset({"new_feature"}), NEW_FEATURE, new_feature_document),
    "baselines": Kind(frozenset({"contestants"}), BASELINES, baselines_document),
    "tradeoff": Kind(frozenset({"front", "costs"}), TRADEOFF, tradeoff_document),
    "stability": Kind(frozenset({"tallies", "battery"}), STABILITY, stability_document),
    "benchmark": Kind(frozenset({"rows", "pipeline", "protocol"}), BENCHMARK, benchmark_document),
    "invariance": Kind(frozenset({"rows"}), INVARIANCE, invariance_document),
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
    kind, data = _read(Path(path))
    try:
        return KINDS[kind].document(data)
    except (ValueError, TypeError, LookupError, ArithmeticError) as error:  # numbers that fit no figure
        raise ValueError(f"{path}: cannot be shown ({error}); the rule is what its command wrote") from error


def _read(path: Path, *, or_study: bool = False) -> tuple[str, Any]:
    """Return kind and values of a result, checked; a study that no document tells is of the kind "study"."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"), parse_constant=None if or_study else _no_number)
    except RecursionError as error:
        raise ValueError(f"{path}: {error}; the rule is {WRITERS}") from error
    except ValueError as error:
        raise ValueError(f"{path}: no JSON ({error}); the rule is {WRITERS}") from error
    kind = next(
        (name for name, kind in KINDS.items() if isinstance(data, dict) and kind.keys <= data.keys()), None
    )
    # The study of invariance is told from other studies by what its rows hold.
    rows = data["rows"] if kind == "invariance" else [{"ratio": None}]
    has_ratios = isinstance(rows, list) and bool(rows) and isinstance(rows[0], dict) and "ratio" in rows[0]
    if or_study and isinstance(data, dict) and "versions" in data and (kind is None or not has_ratios):
        checked(CODE, data, path)
        return "study", data
    if kind is None or not has_ratios:
        held = ", ".join(list(data)[:6]) if isinstance(data, dict) else type(data).__name__
        raise ValueError(f"{path}: holds no result ({held or 'nothing'}); the rule is {WRITERS}")
    checked(KINDS[kind].model, data, path)
    return kind, data


def stale_results(paths: Sequence[str | Path]) -> tuple[dict[Path, str], dict[Path, str]]:
    """Return the results to be made again, and the files that contain no result, each with the reason.

    A result is made again where its code, pipeline or features have changed; comments, docstrings and the
    modules that put results into words do not count as code.

    Parameters
    ----------
    paths : sequence of str or path
        JSON files.

    Returns
    -------
    dict of Path to str
        Results to be made again.
    dict of Path to str
        Skipped files: folders, and files that contain no result.

    Raises
    ------
    OSError
        If a file does not exist or cannot be read.
    """
    now = cache(partial(code_hash, words=False))
    found, skipped = dict[Path, str](), dict[Path, str]()
    for path in map(Path, paths):
        if path.is_dir():
            skipped[path] = "is a folder"
            continue
        try:
            kind, data = _read(path, or_study=True)
        except ValueError as error:
            skipped[path] = str(error).removeprefix(f"{path}: ")
            continue
        reasons = []
        if not (made_by := data.get("code_hash")):
            reasons.append("made before results carried a hash of their code")
        else:
            try:
                same = made_by == now(*data.get("code_of", COMPUTED_BY))
            except ValueError:  # a room that is gone
                same = False
            reasons += [] if same else ["made by other code"]
        for what, name, its, load in _definitions(kind, data):
            if name and its:
                try:
                    reasons += [f"{what} {name} has changed"] if load(name).hash != its else []
                except (ValueError, OSError):
                    reasons.append(f"{what} {name} is not here")
        if reasons:
            found[path] = "; ".join(reasons)
    return found, skipped


def _definitions(kind: str, data: Any) -> Iterator[tuple[str, Any, Any, Callable[[str], Any]]]:
    """Yield what a result was made by: pipeline and feature set, the name and hash of each, what loads it."""
    pipeline = data.get("pipeline")
    if kind == "feature":  # the pipeline that the feature was added to
        name = pipeline["name"].removesuffix(f"+{data['new_feature']['name']}")
        yield "pipeline", name, pipeline["hash"].partition("+")[0], load_pipeline
    elif kind == "benchmark":
        yield "pipeline", pipeline["name"], pipeline["hash"], load_pipeline
        yield "feature set", pipeline["features"], pipeline.get("features_hash"), load_feature_set
    elif kind != "study":
        yield "pipeline", pipeline, data.get("pipeline_hash"), load_pipeline
        yield "feature set", data.get("features"), data.get("features_hash"), load_feature_set


def write_page(paths: Sequence[str | Path], output: str | Path, title: str = "") -> Path:
    """Read results and write a page that holds all it shows and asks for nothing outside, or their Markdown.

    Parameters
    ----------
    paths : sequence of str or path
        JSON files, in the order of the page.
    output : str or path
        The file; its folder is made if it does not exist. Its suffix decides: HTML (.html, .htm), or Markdown
        without pictures (.md).
    title : str
        Its title; by default the datasets'.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    ValueError
        If there are none, a file is no result, the page would replace one, or has another suffix.
    """
    output = Path(output)
    if output.resolve() in [Path(path).resolve() for path in paths]:
        raise ValueError(f"{output} is one of the results; the rule is a file of its own")
    path_ending(output, ".html", ".htm", ".md")
    read = [(Path(path).name, read_document(path)) for path in paths]
    counts = Counter(document.title for _, document in read)
    documents = []
    for file, document in read:
        # Results of equal titles are told apart by their pipelines, or else by their files.
        told = document.subtitle.partition(":")[0] if document.data else file
        told_apart = f"{document.title}: {told}" if counts[document.title] > 1 else document.title
        documents.append(replace(document, title=told_apart, again={"File": file, **document.again}))
    names = list(dict.fromkeys(document.data[0] for document in documents if document.data))
    title = title or (f"{TITLE}: {', '.join(names)}" if 0 < len(names) <= 3 else TITLE)
    if output.suffix.lower() == ".md":
        page = "\n".join(map(render_markdown, documents))
    else:
        page = render_page(documents, title, written_by="texclass report")
    write_atomic(output, page)
    return output


def _no_number(constant: str) -> float:
    raise ValueError(f"{constant:.40} is no JSON number")
