"""What a small computer gets, as a document: accuracy against bytes, operations, rate, window and word."""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import pandas as pd

from texclass.document import Document, Figure, Finding, Heading, Table
from texclass.document.blocks import Block
from texclass.document.figure_style import (
    INK,
    LOOKS,
    MUTED,
    legend_above,
    log_x,
    new_figure,
)
from texclass.document.wording import digits, estimate, interval, percent, points, sentence
from texclass.experiment.result import again_facts, chance_of, dataset_facts, over, protocol_title, size
from texclass.tradeoff.tradeoff_document import limit_accuracy

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

Data = Mapping[str, Any]
CLASSIFIER_TITLES = {"lda": "linear", "network": "network"}


def embedded_document(data: Data) -> Document:
    """Return the trade-off of a small computer as a document.

    Parameters
    ----------
    data : mapping
        As `Embedded.to_dict` returns it, or its JSON read back.
    """
    chosen, full = data["chosen"], data["full"]
    lost = points(chosen["accuracy"]["mean"] - full["accuracy"]["mean"])
    finding = Finding(
        percent(chosen["accuracy"]["mean"]),
        "%",
        interval(chosen["accuracy"]),
        f"of windows of {chosen['window_s']:g} s recognised with {_cost(chosen)}, at {chosen['fs_hz']:g} Hz, "
        f"{_word(chosen)} ({chosen['why']}; picked on the very folds that measure it, so optimistic). "
        f"Protocol: {protocol_title(data['protocol'])}; columns are chosen and classifiers fitted inside "
        f"each training part; 95 % interval{over(data)}; chance {percent(chance_of(data))} %.",
        f"{lost} points against all {full['n_columns']} columns with a kernel discriminant, which keeps what "
        f"it was trained on: {estimate(full['accuracy'])} % with {_cost(full)} at {full['fs_hz']:g} Hz.",
        f"With {_cost(chosen)}; {lost} points against the full model, {_cost(full)}.",
    )
    return Document(
        f"{data['dataset']['name']}, for small computers",
        list(_blocks(data)),
        f"Features {data['features']}: {size(data['dataset'])}",
        finding,
        dataset_facts(data),
        again_facts(data, data["features"]),
        data["versions"],
    )


def _blocks(data: Data) -> Iterator[Block]:
    yield Heading("What a kilobyte buys")
    yield _front(data)
    first, last = data["front"][0], data["front"][-1]
    yield Figure(
        "bytes",
        "Accuracy against kB",
        f"From {percent(first['accuracy']['mean'])} % with {_cost(first)} to "
        f"{percent(last['accuracy']['mean'])} % with {_cost(last)}; chance is {percent(chance_of(data))} %.",
        lambda width: draw_bytes(data, width),
    )
    yield list(_notes(data))
    yield Heading("What rate, window and words of fewer bits cost")
    yield _best_of_each(data)


def _front(data: Data) -> Table:
    """Return the points that nothing beats, the knee and what was chosen marked."""
    front, chosen = data["front"], data["chosen"]
    tried = next((point for point in data["points"] if point.items() <= chosen.items()), chosen)
    marks = {"knee": data["knee"], "chosen": tried}
    marked = [", ".join(name for name, point in marks.items() if point == one) for one in front]
    rows = [
        (digits(p["fs_hz"]), digits(p["window_s"]), f"{p['sample_bits']}/{p['bits']}",
         CLASSIFIER_TITLES[p["classifier"]], str(p["n_columns"]), f"{p['bytes'] / 1000:.1f}",
         f"{p['ops_per_s'] / 1e6:.2f}", estimate(p["accuracy"]), mark)
        for p, mark in zip(front, marked, strict=True)
    ]  # fmt: skip
    titles = [
        "Rate, Hz", "Window, s", "Bits", "Classifier", "Columns", "kB", "Mops/s", "% [95 %]", "Mark",
    ]  # fmt: skip
    return Table(
        pd.DataFrame(rows, columns=titles),
        "Points that no other beats in accuracy, bytes and operations a second (Mops: millions). Bits: of "
        "samples, and of tables and weights; 32: single precision.",
        strong=[i for i, mark in enumerate(marked) if mark],
    )


def _best_of_each(data: Data) -> Table:
    """Return the best point within the limits of each rate, window and word."""
    most = {key: data[limit] or math.inf for key, limit in (("bytes", "max_bytes"), ("ops_per_s", "max_ops"))}
    kept = [p for p in data["points"] if all(p[key] <= most[key] for key in most)]
    kept.sort(key=lambda p: (p["accuracy"]["mean"], -p["bytes"]))
    best = {(p["fs_hz"], p["window_s"], _word(p)): p for p in kept}  # the last of each
    words = list(dict.fromkeys(_word(p) for p in data["points"]))
    rows = [
        (f"{fs:g}", f"{seconds:g}", *(
            f"{percent(p['accuracy']['mean'])} ({p['bytes'] / 1000:.0f} kB)"
            if (p := best.get((fs, seconds, word))) else "" for word in words
        ))
        for fs, seconds in sorted({at[:2] for at in best}, reverse=True)
    ]  # fmt: skip
    limits = "within the limits" if data["max_bytes"] or data["max_ops"] else "whatever it takes"
    frame = pd.DataFrame(rows, columns=["Rate, Hz", "Window, s", *words])
    return Table(frame, f"The most accurate point {limits}, in %, and what it takes.")


def _notes(data: Data) -> Iterator[str]:
    chosen = data["chosen"]
    features = dict.fromkeys(c.rpartition("/")[2].partition(".")[0] for c in chosen["columns"])
    parts = {
        "the window of samples": "window_bytes",
        "constants": "constant_bytes",
        "what is computed": "intermediate_bytes",
    }
    told = ", ".join(f"{chosen[key] / 1000:.1f} kB for {what}" for what, key in parts.items())
    saved = f"; saved as {chosen['file']}, which computes in double precision" if chosen.get("file") else ""
    yield f"Chosen: {told}; columns of {', '.join(features)}{saved}."
    yield (
        "Bytes and operations are counted in the graph that `texclass export --from samples` writes, up to "
        "the decisions: multiply-adds of matrix products, elements of all else, one answer a window; "
        "constants as they are once the file is loaded. Transforms are products of two small matrices in it, "
        "where a fast transform of the computer's own library would take fewer of both."
    )
    yield (
        "Tables and weights of 64 elements and more have the bits that are told, on equal steps. Accuracies "
        "are those of features that were computed in single precision, from such samples and with such "
        "tables. A cost is that of the model that the same rule makes of all windows."
    )
    if lacking := data["without_graph"]:
        yield f"Without a graph, so not on offer: {', '.join(lacking)}."
    yield sentence(f"Recordings are held out by the protocol `{data['protocol']}`: {data['why']}")
    yield from map(sentence, data.get("notes", ()))


def draw_bytes(data: Data, width: float) -> "Drawing":
    """Draw accuracy against bytes: a colour a rate, the front as a line, knee and choice as rings."""
    figure, axes = new_figure(width, 3.8)
    rates = sorted({p["fs_hz"] for p in data["points"]}, reverse=True)
    for fs, (colour, shape) in zip(rates, LOOKS, strict=False):
        for p in (p for p in data["points"] if p["fs_hz"] == fs):
            at = p["bytes"] / 1000, 100 * p["accuracy"]["mean"]
            said = f"{p['window_s']:g} s, {_word(p)}, {p['n_columns']} columns: {estimate(p['accuracy'])} %"
            axes.plot(*at, shape, markersize=3, color=colour, alpha=0.6, gid=said)
        axes.plot([], [], shape, color=colour, label=f"{fs:g} Hz")
    highest, line = 0.0, []
    for p in data["front"]:
        if p["accuracy"]["mean"] > highest:
            highest = p["accuracy"]["mean"]
            line.append((p["bytes"] / 1000, 100 * highest))
    axes.plot(*zip(*line, strict=True), "-", color=MUTED, linewidth=1, label="front")
    for name, point, ring in (("knee", data["knee"], 13), ("chosen", data["chosen"], 17)):
        label = f"{name}: {percent(point['accuracy']['mean'])} %, {point['bytes'] / 1000:.0f} kB"
        at = point["bytes"] / 1000, 100 * point["accuracy"]["mean"]
        axes.plot(*at, "o", markersize=ring, fillstyle="none", color=INK, label=label)
    if data["max_bytes"]:
        axes.axvline(data["max_bytes"] / 1000, color=MUTED, linestyle=":", label="limit")
    log_x(axes)
    limit_accuracy(axes, [100 * p["accuracy"]["mean"] for p in data["points"]], 100 * chance_of(data))
    axes.set(xlabel="window, constants and what is computed, kB", ylabel="accuracy, %")
    legend_above(figure, axes)
    return figure


def _cost(point: Data) -> str:
    return (
        f"{point['bytes'] / 1000:,.1f} kB and {digits(point['ops_per_s'] / 1e6)} million operations a second"
    )


def _word(point: Data) -> str:
    samples, tables = (
        "float32" if bits == 32 else f"{bits} bit" for bits in (point["sample_bits"], point["bits"])
    )
    return samples if samples == tables else f"samples of {samples}, tables of {tables}"
