"""Comparison of two results on the same folds: changed settings, accuracies, rows and predictions."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from texclass.evaluation.accuracy import LEVEL, compare
from texclass.evaluation.protocols import Protocol, find_protocol
from texclass.evaluation.result_facts import (
    best_pair,
    classifier_title,
    cluster_phrase,
    dataset_facts,
    list_pairs,
)
from texclass.evaluation.splits import Split
from texclass.reporting import Document, Finding, Heading, Table
from texclass.reporting.blocks import Block
from texclass.reporting.result_files import Result, read_result
from texclass.reporting.wording import (
    counted,
    digits,
    estimate,
    gain,
    p_value,
    percent,
    points,
    points_interval,
)

Data = Mapping[str, Any]
COMPARED_KINDS = ("benchmark", "feature", "baselines")
"""Kinds of results that contain the hits of every test."""
MAX_LISTED = 20
"""Largest number of recordings or rows in a sentence of the report. The JSON file lists all of them."""
SETTINGS = {
    "dataset": "Dataset", "pipeline": "Pipeline", "pipeline_hash": "Pipeline hash", "features": "Feature set",
    "features_hash": "Feature set hash", "movement": "Movement", "channels": "Channels", "axes": "Axes",
    "signals": "Signals of the baselines", "time_limit_s": "Time limit of the baselines in s",
    "protocol": "Protocol", "n_folds": "Folds", "seed": "Seed", "input_hash": "Input hash",
    "code_hash": "Code hash",
}  # fmt: skip
"""Titles of the settings that are compared, in display order."""
TITLES = {"nested_cv": "Nested cross-validation", "best": "Best pair on the test folds, optimistic"}
"""Titles of the accuracies of a benchmark."""


def list_tests(
    frame: pd.DataFrame,
    splits: Sequence[Split],
    protocol: Protocol,
    hits: Mapping[str, Sequence[NDArray[np.bool_]]],
) -> dict[str, Any]:
    """Return the tested recordings of each fold and the correct predictions as JSON values.

    Parameters
    ----------
    frame : DataFrame
        Feature table.
    splits : sequence of (train, test)
        Row indices of each fold.
    protocol : Protocol
        Protocol of the splits.
    hits : mapping of str to sequence of ndarray of shape (n_test,)
        Whether each prediction is correct, by fold, under the name of what predicted.

    Returns
    -------
    dict
        `folds_hash`, a hash of the training and test recordings of each fold; `recordings`, the tested
        recordings or windows of each fold; `units`, their independent units, or None if each recording is its
        own unit; `n_train`, the sizes of the training sets; `hits`, with one text per fold, in which "1" is a
        correct and "0" a wrong prediction.
    """
    ids = frame["recording_id"].to_numpy(dtype=str)
    folds = [[sorted(ids[train].tolist()), ids[test].tolist()] for train, test in splits]
    units = protocol.independent(frame)[1]
    return {
        "folds_hash": hashlib.sha256(json.dumps(folds).encode()).hexdigest()[:16],
        "recordings": [test for _, test in folds],
        "units": None if (units == ids).all() else [units[test].tolist() for _, test in splits],
        "n_train": [int(train.size) for train, _ in splits],
        "hits": {name: ["".join(np.where(h, "1", "0")) for h in by_fold] for name, by_fold in hits.items()},
    }


class ResultComparison(Result, kind="comparison"):
    """Comparison of two results on the same folds, as returned by `compare_results`.

    `data` contains `first` and `second` (name of each file), `settings` (changed settings with both values),
    `accuracies` (both accuracies, their paired `difference`, and the recordings that are `gained` or `lost`)
    and `rows` (accuracy of each row and classifier in both results, None where it is absent).
    """

    @property
    def stem(self) -> str:
        """Prefix of the file names."""
        return f"{Path(self.data['first']).stem}-to-{Path(self.data['second']).stem}"

    def document(self) -> Document:
        """Return the comparison as a document."""
        return comparison_document(self.data)


def compare_results(
    first: Result | str | Path,
    second: Result | str | Path,
    *,
    names: tuple[str, str] = ("first result", "second result"),
) -> ResultComparison:
    """Compare two results of one kind that were computed on the same folds.

    Parameters
    ----------
    first, second : Result, str or path
        Results of a benchmark or of a comparison with baselines, or their JSON files.
    names : tuple of str
        Names of the results in messages and in the report.

    Returns
    -------
    ResultComparison
        Differences are those of the second result minus the first. Their tests are paired and respect the
        independent units (see `accuracy.compare`).

    Raises
    ------
    ValueError
        If the results are of different kinds, contain no predictions, or have different folds.
    """
    results = [one if isinstance(one, Result) else read_result(one) for one in (first, second)]
    _check_comparable(results, names)
    a, b = (result.data for result in results)
    one, two = map(_settings, (a, b))
    rows_a, rows_b = map(_rows, (a, b))
    return ResultComparison(
        {
            "first": names[0],
            "second": names[1],
            "dataset": b["dataset"],
            "protocol": b["protocol"],
            "seed": b["seed"],
            "input_hash": b["input_hash"],
            "versions": b["versions"],
            "settings": [
                [key, one.get(key), two.get(key)] for key in one | two if one.get(key) != two.get(key)
            ],
            "accuracies": list(_compare_accuracies(a, b)),
            "rows": [
                {"row": pair[0], "classifier": pair[1], "first": rows_a.get(pair), "second": rows_b.get(pair)}
                for pair in rows_a | rows_b
            ],
        }
    )


def _check_comparable(results: Sequence[Result], names: Sequence[str]) -> None:
    kinds = [result.kind for result in results]
    if kinds[0] != kinds[1] or kinds[0] not in COMPARED_KINDS:
        raise ValueError(
            f"cannot compare {names[0]} (kind {kinds[0]!r}) with {names[1]} (kind {kinds[1]!r}). Expected "
            f"two results of the same kind: {', '.join(COMPARED_KINDS)}"
        )
    for result, name in zip(results, names, strict=True):
        if "tests" not in result.data:
            raise ValueError(f"{name} contains no predictions. Run the command that wrote it again")
    a, b = (result.data for result in results)
    if a["tests"]["folds_hash"] != b["tests"]["folds_hash"]:
        raise ValueError(
            f"cannot compare {names[0]} with {names[1]}, because their folds differ: "
            f"{'; '.join(_fold_differences(a, b))}. Run both with the same recordings, protocol, number of "
            "folds and seed"
        )


def _fold_differences(a: Data, b: Data) -> Iterator[str]:
    """Yield what differs between the folds of two results."""
    recordings = [set(chain(*data["tests"]["recordings"])) for data in (a, b)]
    for name, only in (("first", recordings[0] - recordings[1]), ("second", recordings[1] - recordings[0])):
        if only:
            some = ", ".join(sorted(only)[:3])
            yield f"{counted(len(only), 'recording')} only in the {name} (for example {some})"
    differences = [
        f"{SETTINGS[key].lower()} {a[key]} and {b[key]}"
        for key in ("protocol", "n_folds", "seed")
        if a[key] != b[key]
    ]
    yield from differences
    if not differences and recordings[0] == recordings[1]:
        yield "the same recordings, in other training or test sets"


def _settings(data: Data) -> dict[str, Any]:
    """Return the compared settings of a result by title."""
    pipeline = data["pipeline"]
    if isinstance(pipeline, Mapping):
        names = {"name": "pipeline", "hash": "pipeline_hash"}
        pipeline = {names.get(key, key): value for key, value in pipeline.items()}
        data = {**data, **pipeline}
    data = {**data, "dataset": data["dataset"]["name"]}
    versions = {**data["versions"], **data.get("baseline_versions", {})}
    settings = {title: data[key] for key, title in SETTINGS.items() if key in data}
    return settings | {f"Version of {name}": version for name, version in versions.items()}


def _rows(data: Data) -> dict[tuple[str, str], Data]:
    """Return the accuracy of each row (or tool) and classifier."""
    if "contestants" in data:
        return {
            (one["title"], one["classifier"]): one["accuracy"]
            for one in data["contestants"]
            if one["accuracy"]
        }
    return {(pair.row["name"], pair.classifier): pair.accuracy for pair in list_pairs(data)}


def _accuracies(data: Data) -> dict[str, tuple[str, Data]]:
    """Return, for each name in the hits of a result, what predicted, and its accuracy."""
    if "contestants" in data:
        return {f"{title}, {name}": (title, accuracy) for (title, name), accuracy in _rows(data).items()}
    accuracies: dict[str, tuple[str, Data]] = {}
    if nested := data.get("nested_cv"):
        accuracies["nested_cv"] = ("selected", nested["accuracy"])
    if best := best_pair(data):
        title = f"{best.row['name']} with {classifier_title(best.classifier)}"
        accuracies["best"] = (title, best.accuracy)
    return accuracies


def _compare_accuracies(a: Data, b: Data) -> Iterator[dict[str, Any]]:
    """Yield a paired comparison for each predictor that occurs in both results."""
    tests, protocol = b["tests"], find_protocol(b["protocol"])
    ids = list(chain(*tests["recordings"]))
    units = ids if tests["units"] is None else list(chain(*tests["units"]))
    stops = np.cumsum([len(fold) for fold in tests["recordings"]])
    splits = [
        (np.arange(n_train), np.arange(stop - len(fold), stop))
        for n_train, fold, stop in zip(tests["n_train"], tests["recordings"], stops, strict=True)
    ]
    (accuracies_a, accuracies_b), hits_a, hits_b = map(_accuracies, (a, b)), a["tests"]["hits"], tests["hits"]
    for name in accuracies_a:
        if name not in accuracies_b or name not in hits_a or name not in hits_b:
            continue
        # A baseline may have finished only some folds.
        n = min(len(hits_a[name]), len(hits_b[name]))
        one, two = ([np.array(list(fold)) == "1" for fold in hits[name][:n]] for hits in (hits_a, hits_b))
        unit = accuracies_b[name][1].get("clusters", protocol.unit)
        difference = compare([two], [one], splits, protocol, (unit, np.array(units)))
        first_hits, second_hits, tested = (
            np.concatenate(one),
            np.concatenate(two),
            np.array(ids[: stops[n - 1]]),
        )
        yield {
            "name": name,
            "first": {"by": accuracies_a[name][0], **accuracies_a[name][1]},
            "second": {"by": accuracies_b[name][0], **accuracies_b[name][1]},
            "difference": difference,
            "gained": tested[second_hits & ~first_hits].tolist(),
            "lost": tested[first_hits & ~second_hits].tolist(),
        }


def comparison_document(data: Data) -> Document:
    """Return a comparison as a document.

    Parameters
    ----------
    data : mapping
        Values of a `ResultComparison`.
    """
    return Document(
        "Comparison of two results",
        list(_blocks(data)),
        f"First: {data['first']}; second: {data['second']}. Differences are second minus first",
        _finding(data),
        dataset_facts(data),
        {
            "First": data["first"],
            "Second": data["second"],
            "Protocol": data["protocol"],
            "Seed": str(data["seed"]),
        },
        data["versions"],
    )


def _finding(data: Data) -> Finding:
    """Return the difference of the first pair of accuracies, usually those of nested cross-validation."""
    if not data["accuracies"]:
        return Finding("none", "", "", "of the accuracies occurs in both results.")
    one = data["accuracies"][0]
    difference, p = one["difference"], one["difference"]["p_value"]
    remark = "" if p < LEVEL else (
        f" No significant difference; differences from {100 * difference['minimum_detectable']:.1f} points "
        "would be detected with a power of 80 %."
    )  # fmt: skip
    return Finding(
        points(difference["difference"]), "points", points_interval(difference),
        f"from {percent(one['first']['mean'])} % to {percent(one['second']['mean'])} % "
        f"({_title(one['name'])}; 95 % confidence interval{cluster_phrase(difference)}); p {p_value(p)} by "
        f"{difference['test']}. {counted(len(one['gained']), 'test')} gained, {len(one['lost'])} lost."
        f"{remark}",
    )  # fmt: skip


def _title(name: str) -> str:
    return TITLES.get(name, name)


def _blocks(data: Data) -> Iterator[Block]:
    yield Heading("Changed settings")
    if data["settings"]:
        cells = [(key, _text(one), _text(two)) for key, one, two in data["settings"]]
        yield Table(pd.DataFrame(cells, columns=["Setting", "First", "Second"]), n_words=3)
    else:
        yield "No setting, version or code has changed."
    yield Heading("Accuracies")
    columns = ["Accuracy", "First, % [95 %]", "Second, % [95 %]", "Points [95 %]", "p"]
    accuracies = [
        (
            _title(one["name"]), estimate(one["first"]), estimate(one["second"]), gain(one["difference"]),
            p_value(one["difference"]["p_value"]),
        )
        for one in data["accuracies"]
    ]  # fmt: skip
    yield Table(pd.DataFrame(accuracies, columns=columns), n_words=1)
    pairs = [(one["name"], one["first"]["by"], one["second"]["by"]) for one in data["accuracies"]]
    if changed := [f"{_title(name)}: first {a}, second {b}" for name, a, b in pairs if a != b]:
        yield changed
    yield Heading("Changed predictions")
    yield [line for one in data["accuracies"] for line in _changes(one)] or ["None."]
    yield Heading("Rows")
    yield from _row_blocks(data["rows"])


def _changes(one: Data) -> Iterator[str]:
    """Yield the tests that only one of the results predicts correctly."""
    for key, what in (("gained", "wrong, now correct"), ("lost", "correct, now wrong")):
        if one[key]:
            yield f"{_title(one['name'])}, {what}, {len(one[key])}: {_shortened(one[key])}"


def _row_blocks(rows: Sequence[Data]) -> Iterator[Block]:
    """Yield the rows that were added, removed or have another accuracy."""
    named = [(f"{row['row']} ({classifier_title(row['classifier'])})", row) for row in rows]
    added = [name for name, row in named if row["first"] is None]
    removed = [name for name, row in named if row["second"] is None]
    both = [(row, row["first"], row["second"]) for row in rows if row["first"] and row["second"]]
    changed = [
        (row["row"], classifier_title(row["classifier"]), estimate(one), estimate(two),
         points(two["mean"] - one["mean"]))
        for row, one, two in both if one["mean"] != two["mean"]
    ]  # fmt: skip
    lines = [f"{len(both) - len(changed)} of {len(both)} accuracies are the same in both results"]
    lines += [f"Added: {_shortened(added)}"] if added else []
    lines += [f"Removed: {_shortened(removed)}"] if removed else []
    yield lines
    if changed:
        columns = ["Row", "Classifier", "First, % [95 %]", "Second, % [95 %]", "Points"]
        yield Table(pd.DataFrame(changed, columns=columns), "Accuracies that differ.", n_words=2)


def _shortened(names: Sequence[str]) -> str:
    more = f" and {len(names) - MAX_LISTED} more in the JSON" if len(names) > MAX_LISTED else ""
    return ", ".join(names[:MAX_LISTED]) + more


def _text(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(str, value))
    return "" if value is None else digits(value) if isinstance(value, float) else str(value)
