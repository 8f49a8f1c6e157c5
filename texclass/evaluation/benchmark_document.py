"""Report of a benchmark: accuracies of all rows, confusion matrix, latency and ablation."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from texclass.evaluation.ablation import ablation_blocks
from texclass.evaluation.plots import axes_or_new
from texclass.evaluation.protocols import find_protocol
from texclass.evaluation.result_facts import (
    Pair,
    best_pair,
    caution,
    chance_level,
    classifier_title,
    cluster_phrase,
    dataset_facts,
    dataset_size,
    list_pairs,
    reproduction_facts,
)
from texclass.reporting import Document, Figure, Finding, Heading, HeatMap, Shade, Table
from texclass.reporting.blocks import Block
from texclass.reporting.figure_style import (
    FAINT,
    INK,
    LOOKS,
    OTHER,
    OURS,
    PAPER,
    chance_line,
    label_rows,
    legend_above,
    new_figure,
    per_cent_limits,
    row_axes,
)
from texclass.reporting.wording import aligned, counted, digits, estimate, interval, percent, points, sentence

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

MAX_LISTED = 6
"""Largest number of recordings, notices or features in a note. The JSON file lists all of them."""
NEAR = 0.05
"""Largest loss of accuracy at which a faster row is named as an alternative to the best row."""
MAX_UNITS = 20
"""Largest number of operators, speeds, ... whose accuracies a note lists."""
Data = Mapping[str, Any]


def benchmark_document(data: Data) -> Document:
    """Return a benchmark as a document.

    Parameters
    ----------
    data : mapping
        Values of a `BenchmarkResult`.
    """
    best = best_pair(data)
    pipeline = data["pipeline"]
    return Document(
        f"{data['dataset']['name']}, {find_protocol(data['protocol']).title}",
        list(benchmark_blocks(data)),
        f"Pipeline {pipeline['name']}: {dataset_size(data['dataset'])}",
        _finding(data, best)
        if best
        else Finding("none", "", "", "of the rows could be evaluated; the table lists the missing features."),
        dataset_facts(data),
        reproduction_facts(data, f"{pipeline['name']} ({pipeline['hash']}), features {pipeline['features']}"),
        data["versions"],
    )


def benchmark_blocks(data: Data) -> Iterator[Block]:
    """Yield the blocks of a benchmark's document."""
    best = best_pair(data)
    published = any(row.get("paper") for row in data["rows"])
    if data.get("example"):
        yield _example(data["example"])
    yield Heading("All rows, with published accuracies" if published else "All rows")
    yield _rows(data, best)
    if footnotes := [*_best_on_test_folds(data, best), *_default_pipeline(data)]:
        yield footnotes
    further = _further_accuracies(data)
    if further is not None:
        yield further
    if best is not None:
        yield _ranking(data, best)
    if data["confusion"]:
        yield Heading("Confusion matrix")
        yield confusion_heat_map(data["confusion"], "tests" if data.get("n_starts") else _test_units(data))
    if best is not None and best.row["ms_per_recording"] is not None:
        yield Heading("Cost of each row")
        yield _costs(data, best)
    if data.get("ablation"):
        yield Heading("Ablation: accuracy gained by adding a feature group")
        yield from ablation_blocks(data["ablation"], data["seed"])
    if notes := list(_notes(data, best)):
        yield Heading("Notes")
        yield notes


def _finding(data: Data, best: Pair) -> Finding:
    """Return the accuracy of nested cross-validation; without it, that of the best pair, and the reason."""
    n_pairs, nested = len(list_pairs(data)), data.get("nested_cv")
    share = f"of the {_test_units(data)} of {data['dataset']['n_surfaces']} surfaces classified correctly"
    folds = f", {data['n_folds']} folds" if data["n_folds"] > 1 else ""
    folds += f" of {counted(data['n_starts'], 'start')}" if data.get("n_starts") else ""
    protocol = f"Protocol: {data['protocol_description']}{folds}."
    pair, chance = _pair_title(best), f"chance level {percent(chance_level(data))} %"
    accuracy, comparison, brief, note, why = best.accuracy, *_compare_with_paper(data, best), "", ""
    brief = f"{pair}; {brief}" if brief else f"{pair}."
    if n_pairs == 1:
        start = f"{share}, with {pair}, the only pair of row and classifier: nothing was selected"
    elif nested:
        accuracy, comparison, brief = nested["accuracy"], "", "Nested cross-validation."
        start = f"{share}, with row and classifier selected inside each training set"
        note, why = "nested cross-validation; ", f"Selected: {_selected_pairs(nested)}. "
    else:
        start = f"{share}, with {pair}: {_selection(data)}"
        note = "optimistic; "
        reason = data.get("nested_cv_skipped") or "the command that wrote this result did not run it"
        why = f"Nested cross-validation, which gives an unbiased accuracy, was not run: {reason}. "
    if data.get("n_starts"):
        protocol += f" Accuracy in the worst fold: {percent(accuracy['worst'])} %."
    remarks = f"{note}95 % confidence interval{cluster_phrase(accuracy)}; {chance}"
    return Finding(
        percent(accuracy["mean"]), "%", interval(accuracy),
        f"{start} ({remarks}). {why}{protocol} {caution(accuracy)}".rstrip(),
        comparison, brief,
    )  # fmt: skip


def _pair_title(pair: Pair) -> str:
    return f"{pair.row['name']} with {classifier_title(pair.classifier)}"


def _selection(data: Data) -> str:
    n_pairs = counted(len(list_pairs(data)), "pair")
    return f"the best of {n_pairs} of row and classifier, selected on the test folds"


def _selected_pairs(nested: Data) -> str:
    """Return the pairs that nested cross-validation selected, with the number of folds of each."""
    n, counts = len(nested["selected"]), Counter(map(tuple, nested["selected"]))
    return "; ".join(
        f"{row} with {classifier_title(name)} ({k} of {counted(n, 'fold')})"
        for (row, name), k in counts.most_common()
    )


def _best_on_test_folds(data: Data, best: Pair | None) -> Iterator[str]:
    """Yield the footnote on the best pair if the report opens with nested cross-validation instead."""
    if best is not None and data.get("nested_cv") and len(list_pairs(data)) > 1:
        yield (
            f"Optimistic: {percent(best.accuracy['mean'])} % {interval(best.accuracy)} by "
            f"{_pair_title(best)}, {_selection(data)}. "
            f"{_compare_with_paper(data, best)[0]}"
        )


def _compare_with_paper(data: Data, best: Pair) -> tuple[str, str]:
    """Return a comparison with the published accuracy, in full and in short.

    Accuracies are compared only if the number of surfaces and the protocol are the same.
    """
    what, is_best = "for this row with this classifier", True
    published = [pair for pair in list_pairs(data) if pair.published is not None]
    if not published:
        return "No row of this table has a published accuracy.", "no published accuracy."
    if differences := differences_to_published(data):
        return f"Published accuracies are not comparable: {differences}.", ""
    if best.published is None:
        best = max(published, key=lambda pair: float(pair.published))
        what = (
            f"for {best.row['name']} with {classifier_title(best.classifier)}, the most accurate "
            "published row of "
            f"this table (ours: {percent(best.accuracy['mean'])} %)"
        )
        is_best = False
    theirs = best.published
    difference, low, high = (points(best.accuracy[key] - theirs) for key in ("mean", "low", "high"))
    return (
        f"{difference} points [{low}, {high}] relative to the published {100 * theirs:.0f} % {what}. The "
        "published accuracy has no confidence interval, and was measured on other recordings.",
        f"{difference} points relative to the published {100 * theirs:.0f} %." if is_best else "",
    )


def differences_to_published(data: Data) -> str:
    """Return the reason why published accuracies are not comparable, or an empty string if they are."""
    conditions, n = data.get("published_on"), data["dataset"]["n_surfaces"]
    if not conditions:
        return "the pipeline does not state the number of surfaces and the protocol of the publication"
    differences = []
    if n != conditions["n_surfaces"]:
        differences.append(f"{n} surfaces here, {conditions['n_surfaces']} in the publication")
    if data["protocol"] not in conditions["protocols"]:
        protocols = " or ".join(f"`{name}`" for name in conditions["protocols"])
        differences.append(f"protocol `{data['protocol']}` here, {protocols} in the publication")
    if _test_units(data) == "windows":
        differences.append("windows here, recordings in the publication")
    return "; ".join(differences)


def _rows(data: Data, best: Pair | None) -> Table:
    """Return a table with the measured and published accuracies of each row and classifier."""
    names = _classifiers(data) or ["accuracy"]
    published = [name for name in names if any(name in row.get("paper", {}) for row in data["rows"])]
    columns: dict[tuple[str, str], list[str]] = {
        ("Row", ""): [row["name"] for row in data["rows"]],
    }
    for name in names:
        title, accuracies = classifier_title(name), [row["accuracy"].get(name) for row in data["rows"]]
        columns[title, "% [95 %]"] = [estimate(accuracy) if accuracy else "" for accuracy in accuracies]
        if name in published:
            theirs = [row.get("paper", {}).get(name) for row in data["rows"]]
            columns[title, "Paper %"] = ["" if value is None else f"{100 * value:.0f}" for value in theirs]
    columns["Dim", ""] = [str(row["n_features"]) for row in data["rows"]]
    columns["ms", ""] = aligned(row["ms_per_recording"] for row in data["rows"])
    units, paper = _test_units(data), ", with published accuracies" if published else ""
    if published and (differences := differences_to_published(data)):
        paper += f" (not comparable: {differences})"
    clusters = cluster_phrase(best.accuracy) if best else ""
    return Table(
        pd.DataFrame(columns),
        f"Accuracy over {units} in % with 95 % confidence interval{clusters}{paper}; chance level "
        f"{percent(chance_level(data))} %. The best row is bold (selected on the test folds, optimistic). "
        f"Dim: number of feature columns; ms: latency per {units[:-1]}, {_latency_scope(data)}, one thread, "
        "shared transforms counted once.",
        bold_rows=[i for i, row in enumerate(data["rows"]) if best is not None and row is best.row],
        messages={
            i: f"not evaluated: {row['missing'] or 'no reason given'}"
            for i, row in enumerate(data["rows"])
            if not row["accuracy"]
        },
    )


def _default_pipeline(data: Data) -> Iterator[str]:
    """Yield the accuracy of the default pipeline of `texclass train`, if it was evaluated."""
    if not data.get("default"):
        return
    name, row = data["default"]["pipeline"]["name"], data["default"]["rows"][0]
    accuracies = list(row["accuracy"].values())
    result = f"not evaluated ({row['missing']})"
    if accuracies:
        result = (
            f"{estimate(accuracies[0])} % on the same folds, {counted(row['n_features'], 'column')}, "
            f"{row['ms_per_recording']:.3g} ms"
        )
        result += f"; axes {axes}" if (axes := data["default"]["axes"]) else ""
    yield (
        f"This table contains the published feature subsets. `texclass train` uses the pipeline `{name}` by "
        f"default: {result}. For its report, use `--pipeline {name}`."
    )


def _further_accuracies(data: Data) -> Table | None:
    """Return a table of balanced accuracies, worst folds and majority votes, or None if there are none."""
    accuracies = [pair.accuracy for pair in list_pairs(data)]
    unit = next((u for u in ("recording", "run") if any(f"per_{u}" in a for a in accuracies)), None)
    is_unbalanced = any(abs(a.get("balanced", a["mean"]) - a["mean"]) > 1e-9 for a in accuracies)
    starts = data.get("n_starts")
    if unit is None and not is_unbalanced and not starts:
        return None
    rows = [row for row in data["rows"] if row["accuracy"]]
    columns: dict[tuple[str, str], list[str]] = {("Row", ""): [row["name"] for row in rows]}
    for name in _classifiers(data):
        title, accuracies = classifier_title(name), [row["accuracy"].get(name, {}) for row in rows]
        if is_unbalanced:
            means = [accuracy.get("balanced", accuracy.get("mean")) for accuracy in accuracies]
            columns[title, "balanced"] = [percent(m) if m is not None else "" for m in means]
        if starts:
            columns[title, "worst"] = [percent(a["worst"]) if a else "" for a in accuracies]
        if unit is not None:
            votes = [accuracy.get(f"per_{unit}") for accuracy in accuracies]
            columns[title, f"per {unit}"] = [estimate(v) if v else "" for v in votes]
    caption = "Further accuracies in %. " + "Balanced: mean recall over surfaces. " * is_unbalanced
    caption += (
        f"Worst: lowest accuracy of {data['n_folds']} folds (each one start and one part of the test set). "
        if starts
        else ""
    )
    caption += f"Per {unit}: majority vote of its {_test_units(data)} [95 %]." if unit else ""
    return Table(pd.DataFrame(columns), caption)


def _ranking(data: Data, best: Pair) -> Figure:
    """Return a figure of the measured and published accuracies of all rows with every classifier."""
    is_comparable, pairs = not differences_to_published(data), list_pairs(data)
    title = classifier_title(best.classifier)
    same_classifier = [pair for pair in pairs if pair.classifier == best.classifier]
    gaps = [pair.accuracy["mean"] - pair.published for pair in same_classifier if pair.published is not None]
    gaps = gaps if is_comparable else []
    reached = (
        f"; with {title}, {sum(gap >= 0 for gap in gaps)} of {len(gaps)} rows reach their published accuracy"
    )
    rows = []
    for row, name, ours, theirs in pairs:
        paper = "" if theirs is None else f"{100 * theirs:.0f}"
        difference = points(ours["mean"] - theirs) if is_comparable and theirs is not None else ""
        rows.append((row["name"], classifier_title(name), estimate(ours), paper, difference))
    columns = ["Row", "Classifier", "Ours, % [95 %]", "Published, %", "Points"]
    return Figure(
        "ranking",
        "All rows and classifiers" if len(_classifiers(data)) > 1 else f"All rows with {title}",
        f"The best of {counted(len(pairs), 'pair')}, selected on the test folds, is {best.row['name']} with "
        f"{title}, {percent(best.accuracy['mean'])} %{reached if gaps else ''}; chance level "
        f"{percent(chance_level(data))} %.",
        lambda width: draw_rows(data, None, width),
        Table(pd.DataFrame(rows, columns=columns), n_words=2),
    )


def draw_rows(data: Data, classifiers: Sequence[str] | None, width: float) -> "Drawing":
    """Draw a figure of accuracies with confidence intervals, published accuracies and the chance level.

    Each classifier has its own colour and marker. If `classifiers` is None, all are drawn.
    """
    names = classifiers or _classifiers(data)
    row_names = [row["name"] for row in _rows_of(data, names)]
    figure, axes = row_axes(width, row_names, "accuracy, %", n_marks=len(names))
    plot_rows(data, names, axes)
    legend_above(figure, axes)
    return figure


def plot_benchmark(data: Data, classifiers: Sequence[str] | None, ax: "Axes | None") -> "Axes":
    """Plot accuracies with confidence intervals, row names and a legend. Return the axes."""
    names = classifiers or _classifiers(data)
    row_names = [row["name"] for row in _rows_of(data, names)]
    ax = axes_or_new(ax, height=1.2 + 0.35 * len(row_names) * (1 + 0.3 * (len(names) - 1)))
    label_rows(ax, row_names, "accuracy, %")
    plot_rows(data, names, ax)
    handles = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    ax.legend(handles.values(), handles.keys(), loc="lower left", bbox_to_anchor=(0, 1), frameon=False)
    return ax


def _rows_of(data: Data, classifiers: Sequence[str]) -> list[Data]:
    """Return the rows that were evaluated with at least one of the classifiers."""
    return [row for row in data["rows"] if row["accuracy"].keys() & set(classifiers)]


def plot_rows(data: Data, classifiers: Sequence[str], axes: "Axes") -> None:
    """Plot accuracies with intervals, published accuracies and the chance level. Row i is at y = i."""
    names, rows = classifiers, _rows_of(data, classifiers)
    lows = []
    for i, (name, (colour, _), shape) in enumerate(zip(names, cycle(LOOKS), cycle("os^v"), strict=False)):
        offset, title = 0.6 * ((i + 0.5) / len(names) - 0.5), classifier_title(name)
        for y, row in enumerate(rows):
            if (theirs := row.get("paper", {}).get(name)) is not None and name in row["accuracy"]:
                lows.append(100 * theirs)
                axes.plot(
                    100 * theirs, y + offset, "D", color=colour, markerfacecolor=PAPER, markersize=4.5,
                    gid=f"{row['name']}, {title}: published {100 * theirs:.0f} %", label="hollow: published",
                )  # fmt: skip
        for y, row in enumerate(rows):
            if accuracy := row["accuracy"].get(name):
                mean, low, high = (100 * accuracy[key] for key in ("mean", "low", "high"))
                lows.append(low)
                axes.plot([low, high], 2 * [y + offset], color=colour, linewidth=1.2)
                gid = f"{row['name']}, {title}: ours {estimate(accuracy)} %"
                label = f"{title}, 95 % interval"
                axes.plot(mean, y + offset, shape, color=colour, markersize=5, gid=gid, label=label)
    low, high = per_cent_limits(lows)
    chance_line(axes.axvline, 100 * chance_level(data), low)
    axes.set_xlim(low, high)


def _example(example: Data) -> Figure:
    """Return a figure of the phases of one recording."""
    taps, movement, seconds = example["taps"], example["movement"], example["seconds"]
    spans = [(f"tap {i}", start, end) for i, (start, _, end) in enumerate(taps, start=1)]
    spans += [("movement", *movement)] if movement else []
    movement_text = "movement from {:.2f} to {:.2f} s".format(*movement) if movement else "no movement"
    rows = [(name, f"{start:.3f}", f"{end:.3f}") for name, start, end in spans]
    return Figure(
        "example",
        "Phases of one recording",
        f"{example['recording']} ({example['surface'] or 'surface unknown'}, {seconds:.3g} s): "
        f"{counted(len(taps), 'tap') if taps else 'no taps'}, {movement_text}.",
        lambda width: draw_example(example, width),
        Table(pd.DataFrame(rows, columns=["Phase", "from, s", "to, s"])),
    )


def draw_example(example: Data, width: float) -> "Drawing":
    """Plot the envelope of a recording, its taps and its movement."""
    figure, axes = new_figure(width, 2.6)
    low, high = example["low"], example["high"]
    times = (np.arange(len(low)) + 0.5) * example["seconds"] / len(low)
    axes.fill_between(times, low, high, color=INK, linewidth=0.5, label="signal")
    for start, _, end in example["taps"]:
        axes.axvspan(start, end, color=OTHER, alpha=0.35, linewidth=0, label="tap: hand, impact, decay")
    if movement := example["movement"]:
        axes.axvspan(*movement, color=OURS, alpha=0.2, linewidth=0, label="movement")
    unit = example["unit"].replace("^2", "²")
    axes.set(xlim=(0, example["seconds"]), xlabel="time, s", ylabel=f"acceleration, {unit}")
    legend_above(figure, axes)
    return figure


def confusion_heat_map(confusion: Data, units: str = "recordings") -> HeatMap:
    """Return a confusion matrix as a heat map, with a table of its errors in descending order of frequency.

    Parameters
    ----------
    confusion : mapping
        `row`, `classifier`, `surfaces` and `counts` (rows: true labels), as in `BenchmarkResult.data`.
    units : str
        Plural noun for the tested items: "recordings" (default), "windows" or "tests".
    """
    names, totals = confusion["surfaces"], [sum(counts) for counts in confusion["counts"]]
    errors = [
        (true, predicted, count, totals[i])
        for i, (true, counts) in enumerate(zip(names, confusion["counts"], strict=True))
        for j, (predicted, count) in enumerate(zip(names, counts, strict=True))
        if i != j and count
    ]
    errors.sort(key=lambda error: -error[2])
    summary = f"{sum(error[2] for error in errors)} of {sum(totals)} {units} are misclassified"
    if errors:
        summary += "; most frequent: {} predicted as {}, {} of {}".format(*errors[0])
    rows = {}
    for i, true in enumerate(names):
        shades = []
        for j, count in enumerate(confusion["counts"][i]):
            description = f"{count} of {totals[i]} {units} ({100 * count / max(totals[i], 1):.0f} %)"
            fifth = max(1, -(-5 * count // max(totals[i], 1)))
            colour = f"{'d' if i == j else 'e'}{fifth}"
            shades.append(Shade(colour, str(count), description) if count else Shade())
        rows[true] = shades
    table = [(true, predicted, str(count), f"{100 * count / n:.0f}") for true, predicted, count, n in errors]
    return HeatMap(
        "confusion",
        f"Confusion matrix of {confusion['row']}, {classifier_title(confusion['classifier'])}",
        f"{summary}.",
        dict.fromkeys(names, ""),
        rows,
        {
            "d1 d2 d3 d4 d5": "correct",
            "e1 e2 e3 e4 e5": f"wrong; each step is a fifth of the {units} of a surface",
        },
        "never",
        "True label (rows), predicted label (columns)",
        " predicted as ",
        Table(
            pd.DataFrame(table, columns=["True label", "Predicted label", "Count", "% of its tests"]),
            n_words=2,
        ),
        row_label="True label",
        column_label="Predicted label",
    )


def _costs(data: Data, best: Pair) -> Figure:
    """Return a figure of the latency of each row with its best classifier, sorted by accuracy."""
    pair_of_row: dict[str, Pair] = {}
    for pair in sorted(list_pairs(data), key=lambda pair: -float(pair.accuracy["mean"])):
        if pair.row["ms_per_recording"] is not None:
            pair_of_row.setdefault(pair.row["name"], pair)
    pairs, unit = list(pair_of_row.values()), _test_units(data)[:-1]
    near = [pair for pair in pairs if pair.accuracy["mean"] >= best.accuracy["mean"] - NEAR]
    fastest = min(near, key=lambda pair: float(pair.row["ms_per_recording"]))
    alternative = "no faster row has an accuracy within"
    if fastest.row is not best.row:
        alternative = f"{_cost_of(fastest, unit)}, is the fastest row with an accuracy within"
    return Figure(
        "row-costs",
        f"Latency per {unit} in ms, {_latency_scope(data)}; rows sorted by accuracy",
        f"{_cost_of(best, unit)}, is the most accurate row; {alternative} {100 * NEAR:g} points of it.",
        lambda width: draw_row_costs(pairs, width),
        Table(
            pd.DataFrame(
                {
                    "Row": [pair.row["name"] for pair in pairs],
                    "Classifier": [classifier_title(pair.classifier) for pair in pairs],
                    "Accuracy, %": [percent(pair.accuracy["mean"]) for pair in pairs],
                    "ms": aligned(pair.row["ms_per_recording"] for pair in pairs),
                }
            ),
            n_words=2,
        ),
    )


def _latency_scope(data: Data) -> str:
    return f"from samples to features (including {digits(data['segmentation_ms'])} ms for segmentation)"


def _cost_of(pair: Pair, unit: str) -> str:
    return f"{pair.row['name']}, {digits(pair.row['ms_per_recording'])} ms per {unit}"


def draw_row_costs(pairs: Sequence[Pair], width: float) -> "Drawing":
    """Plot the latency of rows, annotated with their accuracies."""
    figure, axes = row_axes(width, [pair.row["name"] for pair in pairs], "latency, ms (label: accuracy)")
    for y, pair in enumerate(pairs):
        ms, accuracy = pair.row["ms_per_recording"], f"{percent(pair.accuracy['mean'])} %"
        axes.plot([0, ms], [y, y], color=FAINT)
        axes.plot(ms, y, "o", color=OURS, gid=f"{pair.row['name']}: {digits(ms)} ms, {accuracy}")
        axes.annotate(accuracy, (ms, y), (7, 0), textcoords="offset points", va="center", fontsize=8)
    axes.set_xlim(0, 1.15 * max(pair.row["ms_per_recording"] for pair in pairs))
    return figure


def _accuracy_of_each_unit(data: Data, best: Pair | None) -> Iterator[str]:
    """Yield the accuracy of each operator (or speed, ...) if each fold tests one of them."""
    units = (data.get("tests") or {}).get("units") or []
    if best is None or not 1 < len(units) <= MAX_UNITS or any(len({*fold}) > 1 for fold in units):
        return
    nested = data.get("nested_cv")
    accuracy = nested["accuracy"] if nested else best.accuracy
    shares = zip((fold[0] for fold in units), accuracy["folds"], strict=True)
    yield (
        f"Accuracy in % of each {accuracy['clusters']} outside the training set, with "
        f"{'nested cross-validation' if nested else _pair_title(best)}: "
        f"{'; '.join(f'{unit}: {percent(share)}' for unit, share in shares)}."
    )


def _notes(data: Data, best: Pair | None) -> Iterator[str]:
    """Yield the notes on the table of accuracies."""
    if data.get("axes"):
        yield f"Axes {data['axes']}. To change this, use `--axes merged` or `--axes separate`."
    accuracies = [pair.accuracy for pair in list_pairs(data)]
    clustered = [a for a in accuracies if a.get("interval", "").startswith(("t over", "Wilson over"))]
    if clustered:
        cluster = clustered[0].get("clusters", "recording")
        units = "tests" if data.get("n_starts") else _test_units(data)
        yield (
            f"Accuracy is the fraction of {units} classified correctly. Its confidence interval is"
            f"{cluster_phrase(clustered[0])}, because {units} of one {cluster} are not independent "
            "(t interval, jackknife of the logit)."
        )
    yield from dict.fromkeys(filter(None, map(caution, clustered)))
    yield from _accuracy_of_each_unit(data, best)
    agreement = {n: value for n, value in data.get("rank_agreement", {}).items() if value is not None}
    if agreement:
        bounds = data.get("rank_agreement_interval", {})
        correlations = ", ".join(
            f"{classifier_title(n)} {v:.2f}"
            + (" [{:.2f}, {:.2f}]".format(*bounds[n]) if bounds.get(n) else "")
            for n, v in agreement.items()
        )
        yield (
            "Rank correlation between measured and published accuracies of the rows (Spearman, 95 "
            f"%): {correlations}."
        )
    if best is not None and (columns := best.row.get("selected", {}).get(best.classifier)):
        by_share = sorted(columns.items(), key=lambda item: -item[1])
        shares = ", ".join(f"{column} {share:.0%}" for column, share in by_share)
        yield f"Columns selected in {best.row['name']}, with the fraction of folds: {shares}."
    if (nested := data.get("nested_cv")) and nested["inner_protocols"]:
        titles = ", ".join(find_protocol(name).title for name in nested["inner_protocols"])
        yield (
            f"Nested cross-validation selects the pair with the highest accuracy in inner folds ({titles}); "
            "of equal pairs, the one with the most columns."
        )
    for row in data["rows"]:
        if row["accuracy"] and row.get("note"):
            yield sentence(f"{row['name']}: {row['note']}")
        if row["accuracy"] and row["missing"]:
            yield (
                f"{row['name']}: evaluated without features that the dataset does not allow: "
                f"{row['missing']}."
            )
    yield from _problems(data)
    yield from map(sentence, data["dataset"].get("notes", ()))


def _problems(data: Data) -> Iterator[str]:
    """Yield shortened lists of omitted recordings, notices of the loaders and undefined features."""
    n = data["dataset"].get("n_windows", data["dataset"]["n_recordings"])
    undefined = [one for one in data.get("undefined", []) if one["n_recordings"] < n]
    for what, lines in {
        "Recordings left out": [": ".join(item) for item in data.get("left_out", [])],
        "Recordings flagged by the loader": [": ".join(item) for item in data.get("flags", [])],
        "Features that are undefined in some recordings (replaced by the median of the training set)": [
            f"{one['feature']} in {one['n_recordings']} of {n}: {one['reason']}" for one in undefined
        ],
    }.items():
        if lines:
            more = f"; and {len(lines) - MAX_LISTED} more in the JSON file" if len(lines) > MAX_LISTED else ""
            yield sentence(f"{what}, {len(lines)}: {'; '.join(lines[:MAX_LISTED])}{more}")


def _classifiers(data: Data) -> list[str]:
    return list(dict.fromkeys(pair.classifier for pair in list_pairs(data)))


def _test_units(data: Data) -> str:
    return "windows" if "n_windows" in data["dataset"] else "recordings"
