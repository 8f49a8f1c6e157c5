"""Report of a comparison with baselines: accuracy and computing time of all tools and classifiers."""

from collections.abc import Iterator, Mapping
from textwrap import fill
from typing import TYPE_CHECKING, Any

import pandas as pd

from texclass.evaluation.protocols import find_protocol
from texclass.evaluation.result_facts import (
    NESTED_CV_TITLE,
    caution,
    chance_level,
    classifier_title,
    cluster_phrase,
    dataset_facts,
    dataset_size,
    reproduction_facts,
)
from texclass.reporting import Details, Document, Figure, Finding, Heading, Table
from texclass.reporting.blocks import Block
from texclass.reporting.figure_style import (
    OTHER,
    OURS,
    PAPER,
    chance_line,
    legend_above,
    log_x,
    new_figure,
    per_cent_limits,
)
from texclass.reporting.wording import (
    aligned,
    digits,
    estimate,
    gain,
    p_value,
    percent,
    points,
    points_interval,
    sentence,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing


Data = Mapping[str, Any]
COSTS = {
    "Features, ms": "feature_ms", "Fit, s": "fit_s", "Total, s": "total_s", "MB": "memory_mb",
    "First call, s": "first_s",
}  # fmt: skip
COST_NOTE = (
    "Times are CPU times of one thread in a separate process, without compilation. Features: features of one "
    "recording, without segmentation; Fit: fit of scaling, selection and classifier in one fold; Total: "
    "features of all recordings of a fold, fit and prediction; MB: largest memory growth of the "
    "process after "
    "the first call; First call: features of two recordings, with imports and compilation."
)


def baselines_document(data: Data) -> Document:
    """Return a comparison as a document.

    Parameters
    ----------
    data : mapping
        Values of a `BaselineComparison`.
    """
    pipeline, contestants = data["pipeline"], data["contestants"]
    blocks: list[Block] = [Heading("All tools and classifiers"), _all_contestants(data)]
    if any(map(_has_time, contestants)):
        blocks.append(_accuracy_against_time(contestants, 100 * chance_level(data)))
    settings = dict.fromkeys((c["title"], c.get("reference", "")) for c in contestants if not c["ours"])
    baseline_tables = {
        "Settings of the baselines": pd.DataFrame(list(settings), columns=["Tool", "Setting"]),
        "Versions of the baselines": pd.DataFrame(
            data["baseline_versions"].items(), columns=["Package", "Version"]
        ),
    }
    details = [Details(title, [Table(frame, n_words=2)]) for title, frame in baseline_tables.items()]
    return Document(
        f"{data['dataset']['name']}, comparison with baselines",
        [*blocks, list(_notes(data)), *details],
        f"Pipeline {pipeline}, {find_protocol(data['protocol']).title}: {dataset_size(data['dataset'])}",
        _finding(data),
        dataset_facts(data),
        reproduction_facts(data, f"{pipeline} ({data['pipeline_hash']})"),
        data["versions"],
    )


def best_baseline(data: Data) -> Data | None:
    """Return the most accurate baseline that finished every fold; None if there is none."""
    baselines = [c for c in data["contestants"] if not c["ours"] and c["accuracy"]]
    finished = [c for c in baselines if c["n_folds"] == data["n_folds"]]
    return max(finished, key=lambda c: float(c["accuracy"]["mean"]), default=None)


def _finding(data: Data) -> Finding:
    ours = data["contestants"][0]
    best = best_baseline(data)
    if best is None or best["difference"] is None or not ours["accuracy"]:
        return Finding("none", "", "", "of the baselines can be compared with ours on every fold.")
    difference = best["difference"]
    conclusion = "no significant difference"
    if difference["low"] > 0 or difference["high"] < 0:
        conclusion = f"ours is {'better' if difference['low'] > 0 else 'worse'}"
    cost = ""
    if best["cost"] and ours["cost"] and best["cost"]["total_s"] > 0 and best["cost"]["feature_ms"] > 0:
        ratios = (ours["cost"][key] / best["cost"][key] for key in ("total_s", "feature_ms"))
        total, features = (
            f"{digits(1 / ratio)} times as fast" if ratio <= 1 else f"{digits(ratio)} times as slow"
            for ratio in ratios
        )
        cost = f"In total, ours is {total}; in feature extraction, it is {features}."
    ours_text, best_text = (
        f"{c['title']}, {classifier_title(c['classifier'])}: {percent(c['accuracy']['mean'])} %"
        for c in (ours, best)
    )
    return Finding(
        points(difference["difference"]),
        "points",
        points_interval(difference),
        f"for ours ({ours_text}) minus the best baseline ({best_text}), on the same folds: {conclusion} (95 "
        f"% confidence interval{cluster_phrase(difference)}; chance level {percent(chance_level(data))} %). "
        f"p {p_value(difference['p_value'])} by {difference['test']}. {_selection_text(data)} Protocol: "
        f"{data['protocol_description']}.",
        cost,
        f"Ours minus the best baseline, {best['title']} with {classifier_title(best['classifier'])}, on the "
        f"same folds: {conclusion}. {cost}",
    )


def _selection_text(data: Data) -> str:
    """Return sentences that state which accuracies were selected on the test folds."""
    n_baselines = sum(bool(not c["ours"] and c["accuracy"]) for c in data["contestants"])
    baseline = f"The best baseline is the most accurate of {n_baselines}, selected on the test folds."
    if data["contestants"][0]["name"] == NESTED_CV_TITLE:
        return f"Ours is selected inside each training set (nested cross-validation). {baseline}"
    pairs = f" of {data['n_pairs']} pairs of row and classifier" if data.get("n_pairs") else ""
    if data.get("n_pairs") == 1:
        return baseline
    return (
        f"Ours is the most accurate{pairs}, selected on the test folds (optimistic: without nested "
        f"cross-validation). {baseline}"
    )


def _all_contestants(data: Data) -> Table:
    """Return a table of all tools and classifiers. If a tool did not finish, the table states the reason."""
    contestants, messages, rows = data["contestants"], {}, []
    for i, c in enumerate(contestants):
        accuracy, difference = c["accuracy"], c["difference"]
        if accuracy is None or c["cost"] is None:
            messages[i] = f"{c['status']}: {c['message']}" if c["message"] else c["status"]
            rows.append((_tool(c), *[""] * 6))
            continue
        part = f" ({c['n_folds']} of {data['n_folds']} folds)" if c["n_folds"] != data["n_folds"] else ""
        comparison = (gain(difference), p_value(difference["p_value"])) if difference else ("reference", "")
        balanced = accuracy["mean"] if accuracy.get("balanced") is None else accuracy["balanced"]
        classifier = classifier_title(c["classifier"]) + part
        rows.append(
            (_tool(c), classifier, estimate(accuracy), *comparison, str(c["n_columns"]), percent(balanced))
        )
    titles = ["Tool", "Classifier", "% [95 %]", "Ours ahead by, points [95 %]", "p", "Columns", "Balanced, %"]
    frame = pd.DataFrame(rows, columns=titles)
    for title, key in COSTS.items():
        frame[title] = aligned(
            None if i in messages else c["cost"].get(key) for i, c in enumerate(contestants)
        )
    strong = [i for i, c in enumerate(contestants) if c["ours"]]
    return Table(frame, COST_NOTE, n_words=2, bold_rows=strong, messages=messages, n_narrow=5)


def _notes(data: Data) -> Iterator[str]:
    yield f"Input of the baselines: {data['signals']}; scaling is fitted inside each fold."
    if ms := data.get("segmentation_ms"):
        yield (f"Segmentation takes {digits(ms)} ms per recording, included in all totals.")
    tests = sorted({c["difference"]["test"] for c in data["contestants"] if c["difference"]})
    first = data["contestants"][0]
    yield (
        f"Ours ahead by: accuracy of {first['title']}, {classifier_title(first['classifier'])}, minus the "
        f"accuracy of the row, in percentage points, paired on the same folds ({', '.join(tests)}); p is not "
        "corrected for multiple comparisons."
    )
    if accuracy := first["accuracy"]:
        yield (
            f"Chance level {percent(chance_level(data))} %; 95 % confidence "
            f"intervals{cluster_phrase(accuracy)}. {caution(accuracy)}"
        ).strip()
    yield f"Time limit per baseline: {digits(data['time_limit_s'])} s."
    for c in data["contestants"]:
        if c["status"] == "out of time" and c["accuracy"]:
            yield (
                f"{c['title']}, {classifier_title(c['classifier'])}: {c['message']}; accuracy and difference "
                f"are computed on {c['n_folds']} of {data['n_folds']} folds."
            )
    yield from map(sentence, [*data.get("notes", ()), *data["dataset"].get("notes", ())])


def _accuracy_against_time(contestants: list[Data], chance: float) -> Figure:
    """Return a figure of accuracy against time for the best classifier of each tool, numbered by accuracy."""
    best: dict[str, Data] = {}
    for c in sorted(filter(_has_time, contestants), key=lambda c: -float(c["accuracy"]["mean"])):
        best.setdefault(c["name"], c)
    ranked = list(best.values())
    names = [f"{i}. {_tool(c)}, {classifier_title(c['classifier'])}" for i, c in enumerate(ranked, start=1)]
    rank = next((i for i, c in enumerate(ranked, start=1) if c["ours"]), None)
    ours = "" if rank is None else f"; our most accurate one is number {rank} of {len(ranked)}"
    fastest = min(ranked, key=lambda c: float(c["cost"]["feature_ms"]))
    rows = [
        (name, estimate(c["accuracy"]), digits(c["cost"]["feature_ms"]))
        for name, c in zip(names, ranked, strict=True)
    ]
    return Figure(
        "time",
        "Accuracy against time for feature extraction (better towards the upper left)",
        f"The most accurate tool is {_tool(ranked[0])}, and the fastest is {_tool(fastest)}{ours}. "
        "Each tool is "
        f"shown with its best classifier and 95 % confidence interval, numbered by accuracy; chance level "
        f"{chance:.1f} %.",
        lambda width: _draw(ranked, names, width, chance),
        Table(pd.DataFrame(rows, columns=["Tool", "% [95 %]", "CPU ms"])),
    )


def _draw(ranked: list[Data], names: list[str], width: float, chance: float) -> "Drawing":
    figure, axes = new_figure(width, 3.2 + 0.22 * len(ranked))
    for rank, (c, name) in enumerate(zip(ranked, names, strict=True), start=1):
        x, colour = c["cost"]["feature_ms"], OURS if c["ours"] else OTHER
        mean, low, high = (100 * c["accuracy"][key] for key in ("mean", "low", "high"))
        axes.plot([x, x], [low, high], color=colour)
        gid = f"{name}: {estimate(c['accuracy'])} %, {digits(x)} ms"
        label = fill(f"{name}: {percent(c['accuracy']['mean'])} %, {digits(x)} ms", int(11 * width))
        axes.plot(x, mean, "o", color=colour, markersize=13, gid=gid, label=label, clip_on=False)
        axes.annotate(str(rank), (x, mean), color=PAPER, fontsize=8, weight="bold", ha="center", va="center")
    log_x(axes)
    axes.set(xlabel="CPU ms of features, one recording (log scale)", ylabel="accuracy, %")
    low, high = per_cent_limits([100 * c["accuracy"]["low"] for c in ranked])
    chance_line(axes.axhline, chance, low)
    axes.set_ylim(low, high)
    legend_above(figure, axes)
    return figure


def _has_time(c: Data) -> bool:
    return bool(c["accuracy"] and c["cost"] and c["cost"]["feature_ms"] > 0)


def _tool(c: Data) -> str:
    return f"ours: {c['title']}" if c["ours"] else str(c["title"])
