"""A trade-off as a document: what a millisecond buys, and accuracy against whatever else costs."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from texclass.document import Document, Figure, Finding, Folded, Heading, Table, write_document
from texclass.document.blocks import Block, Savable
from texclass.document.wording import aligned, digits, estimate, interval, percent, points, sentence
from texclass.experiment.result_words import again_facts, classifier_title, dataset_facts, size
from texclass.tradeoff.tradeoff_figures import draw_costs, draw_curves, draw_front

Data = Mapping[str, Any]


def write_tradeoff(result: Savable, folder: str | Path) -> tuple[Path, ...]:
    """Write a trade-off's JSON, Markdown and pictures into a folder, named by `tradeoff_stem`."""
    data = result.to_dict()
    stem = tradeoff_stem(data["dataset"])
    return write_document(tradeoff_document(data), folder, stem, json=result.to_json())


def tradeoff_stem(dataset: Data) -> str:
    """Return what the names of a trade-off's files begin with, from the facts of its dataset."""
    scene = f"-{len(dataset['materials'])}-materials" if dataset.get("materials") else ""
    seconds = f"-{dataset['max_seconds']:g}s" if dataset.get("max_seconds") else ""
    return f"{dataset['name']}{scene}{seconds}-tradeoff"


def tradeoff_document(data: Data) -> Document:
    """Return a trade-off as a document.

    Parameters
    ----------
    data : mapping
        As `Tradeoff.to_dict` returns it, or its JSON read back.
    """
    felt = data["dataset"].get("max_seconds")
    return Document(
        f"{data['dataset']['name']}, speed against accuracy",
        list(_blocks(data)),
        f"Features {data['features']}: {size(data['dataset'])}{f', {felt:g} s of each' if felt else ''}",
        _finding(data),
        dataset_facts(data),
        again_facts(data, data["features"]),
        data["versions"],
    )


def _finding(data: Data) -> Finding:
    knee, full, half, total = data["knee"], data["full"], data["at_half_cost"], data["total_ms"]
    against = f"{points(knee['accuracy']['mean'] - full['mean'])} points against the full set"
    return Finding(
        percent(knee["accuracy"]["mean"]),
        "%",
        interval(knee["accuracy"]),
        f"of recordings recognised at the knee, for a budget of {digits(knee['budget_ms'])} ms per recording "
        f"({100 * knee['budget_ms'] / total:.0f} % of the {digits(total)} ms of the full set). Protocol: "
        f"{data['protocol']}; features are chosen inside each training part; 95 % interval.",
        f"{against} ({estimate(full)} %); at half its cost "
        f"{points(half['accuracy']['mean'] - full['mean'])} points, and "
        f"{points(half['plain']['mean'] - full['mean'])} by plain sequential selection, which does not look "
        "at costs and ends at the budget.",
        f"At the knee, for {digits(knee['budget_ms'])} ms per recording; {against}, {digits(total)} ms.",
    )


def _blocks(data: Data) -> Iterator[Block]:
    yield Heading("What a millisecond buys")
    yield _front(data)
    first, last, knee = data["front"][0], data["front"][-1], data["knee"]
    yield Figure(
        "front",
        "Accuracy against the cost of features",
        f"From {_at(first)} to {_at(last)}; knee: {_at(knee)}.",
        lambda width: draw_front(data, width),
    )
    yield list(_notes(data))
    if data.get("fewest"):
        scene = ", ".join(data["dataset"].get("materials") or ()) or "this scene"
        rows = [(str(n), estimate(found)) for n, found in data["fewest"]]
        yield Heading("The fewest columns for this scene")
        caption = f"Accuracy of the best columns, chosen inside each training part, for {scene}."
        yield Table(pd.DataFrame(rows, columns=["Columns", "% [95 %]"]), caption)
    if data.get("curves"):
        yield Heading("Accuracy against what else costs")
        yield _curves(data)
    yield Heading("What each feature costs")
    yield _costs(data)
    parts = sorted(data["parts"].items(), key=lambda part: -part[1])
    yield Folded("Shared transforms", [Table(pd.DataFrame(parts, columns=["Transform", "ms per recording"]))])
    times = [(classifier_title(c["name"]), c["fit_ms"], c["predict_ms"]) for c in data["classifiers"]]
    titles = ["Classifier", "fit, all recordings, ms", "predict, one recording, ms"]
    yield Folded("Classifiers", [Table(pd.DataFrame(times, columns=titles), "On all columns.")])


def _at(point: Data) -> str:
    return f"{percent(point['accuracy']['mean'])} % for {digits(point['budget_ms'])} ms"


def _front(data: Data) -> Table:
    """Return accuracy and columns at each budget, and of the full set."""
    front = data["front"]
    marks = {"knee": "knee", "half the cost": "at_half_cost"}
    marked = [", ".join(name for name, key in marks.items() if point == data[key]) for point in front]
    rows = [
        (digits(p["budget_ms"]), digits(p["ms"]), digits(p["n_features"]), digits(p["n_columns"]),
         estimate(p["accuracy"]), estimate(p["plain"]), mark)
        for p, mark in zip(front, marked, strict=True)
    ]  # fmt: skip
    every = len({cost["feature"] for cost in data["costs"]})
    rows.append(
        ("full set", digits(data["total_ms"]), str(every), "", estimate(data["full"]), "", "full set")
    )
    titles = [
        "Budget, ms",
        "Used, ms",
        "Features",
        "Columns",
        "Accuracy, % [95 %]",
        "Plain, % [95 %]",
        "Mark",
    ]
    return Table(
        pd.DataFrame(rows, columns=titles),
        "Features and columns: mean over folds; ms: one recording, one thread, this machine, conditioning "
        "included; plain: sequential selection that does not look at costs. Intervals: resampled t.",
        strong=[i for i, mark in enumerate(marked) if mark.startswith("knee")],
    )


def _notes(data: Data) -> Iterator[str]:
    chosen = data["chosen"]
    saved = f"; saved as {chosen['file']}" if chosen.get("file") else ""
    yield (
        f"Pipeline at the budget ({chosen['why']}): {len(chosen['columns'])} columns of "
        f"{', '.join(chosen['features'])}; {digits(chosen['predicted_ms'])} ms by the cost model, "
        f"{digits(chosen['measured_ms'])} ms measured when pruned; {estimate(chosen['accuracy'])} %{saved}."
    )
    yield f"Finding the phases takes {digits(data['segmentation_ms'])} ms more, whatever is chosen."
    if rule := data.get("knee_rule"):
        yield sentence(f"Knee: {rule}")
    if pairs := data.get("model_check"):
        worst = max(abs(predicted / measured - 1) for predicted, measured in pairs)
        yield (
            f"The cost model misses the measured cost of {len(pairs)} random subsets by at most "
            f"{100 * worst:.0f} %."
        )
    yield from map(sentence, [*data.get("notes", ()), *data["dataset"].get("notes", ())])


def _curves(data: Data) -> Figure:
    """Return accuracy against everything that is varied: one panel each."""
    curves = data["curves"]
    rows = [
        (curve["name"], curve["series"], label, estimate(found))
        for curve in curves
        for label, found in zip(_labels(curve), curve["accuracy"], strict=True)
    ]
    said = [
        f"{curve['name']} ({curve['series']}): {percent(curve['accuracy'][0]['mean'])} % at "
        f"{_labels(curve)[0]}, {percent(curve['accuracy'][-1]['mean'])} % at {_labels(curve)[-1]}"
        for curve in curves
    ]
    notes = dict.fromkeys(sentence(curve["note"]) for curve in curves if curve.get("note"))
    return Figure(
        "curves",
        "Accuracy in %, with 95 % intervals",
        " ".join([f"{'; '.join(said)}.", *notes]),
        lambda width: draw_curves(curves, width),
        Table(pd.DataFrame(rows, columns=["Varied", "Curve", "Value", "% [95 %]"]), n_words=3),
    )


def _labels(curve: Data) -> list[str]:
    return curve.get("labels") or [f"{x:g}" for x in curve["x"]]


def _costs(data: Data) -> Figure:
    """Return what each feature costs: alone, its share of the full set, and what leaving it out saves."""
    costs = sorted(data["costs"], key=lambda cost: -cost["share"])
    frame = pd.DataFrame({"Feature": [cost["feature"] for cost in costs]})
    for title, key in {
        "Share of the full set": "share",
        "Alone": "alone",
        "Saved when left out": "last",
    }.items():
        frame[title] = aligned(cost[key] for cost in costs)
    return Figure(
        "costs",
        "Cost of features, one recording",
        f"The full set takes {digits(data['total_ms'])} ms; the dearest of {len(costs)} features is "
        f"{costs[0]['feature']} with a share of {digits(costs[0]['share'])} ms.",
        lambda width: draw_costs(costs, set(data["chosen"]["features"]), width),
        Table(
            frame, "ms per recording; share: shared transforms split equally between those that need them."
        ),
    )
