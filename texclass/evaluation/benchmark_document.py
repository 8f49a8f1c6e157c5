"""A benchmark as a document: accuracies of all rows, confusion matrix, cost, ablation."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from texclass.evaluation.additions import gains_blocks
from texclass.evaluation.protocols import find_protocol
from texclass.evaluation.result import (
    Pair,
    again_facts,
    best_of,
    caution,
    chance_of,
    classifier_title,
    dataset_facts,
    over,
    pairs_of,
    size,
)
from texclass.reporting import Document, Figure, Finding, Heading, Heat, Shade, Table
from texclass.reporting.blocks import Block
from texclass.reporting.figure_style import (
    FAINT,
    INK,
    LOOKS,
    OTHER,
    OURS,
    PAPER,
    chance_line,
    legend_above,
    new_figure,
    per_cent_limits,
    row_axes,
)
from texclass.reporting.wording import aligned, counted, digits, estimate, interval, percent, points, sentence

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

MOST_LISTED = 6
"""Recordings, flags or features that a note lists one by one; the JSON holds all of them."""
NEAR = 0.05
"""Accuracy that a faster row may lack to be named beside the best one."""
Data = Mapping[str, Any]


def benchmark_document(data: Data) -> Document:
    """Return a benchmark as a document.

    Parameters
    ----------
    data : mapping
        As `BenchmarkResult.to_dict` returns it, or its JSON read back.
    """
    best = best_of(data)
    pipeline = data["pipeline"]
    return Document(
        f"{data['dataset']['name']}, {find_protocol(data['protocol']).title}",
        list(benchmark_blocks(data)),
        f"Pipeline {pipeline['name']}: {size(data['dataset'])}",
        _finding(data, best)
        if best
        else Finding(
            "none", "", "", "of the rows could be evaluated; the table states what the dataset lacks."
        ),
        dataset_facts(data),
        again_facts(data, f"{pipeline['name']} ({pipeline['hash']}), features {pipeline['features']}"),
        data["versions"],
    )


def benchmark_blocks(data: Data) -> Iterator[Block]:
    """Yield the blocks of a benchmark's document."""
    best = best_of(data)
    published = any(row.get("paper") for row in data["rows"])
    if data.get("example"):
        yield _example(data["example"])
    yield Heading("All rows, with published accuracies" if published else "All rows")
    yield _rows(data, best)
    beside = _beside(data)
    if beside is not None:
        yield beside
    if best is not None:
        yield _ranking(data, best)
    if data["confusion"]:
        yield Heading("Confusion matrix")
        yield _confusion(data["confusion"], "tests" if data.get("n_starts") else _tested(data))
    if best is not None and best.row["ms_per_recording"] is not None:
        yield Heading("Cost of each row")
        yield _costs(data, best)
    if data.get("gains"):
        yield Heading("Ablation: accuracy gained by adding a feature group")
        yield from gains_blocks(data["gains"], data["seed"])
    if notes := list(_notes(data, best)):
        yield Heading("Notes")
        yield notes


def _finding(data: Data, best: Pair) -> Finding:
    """Return the accuracy of nested cross-validation if it was done, else the highest of the table."""
    name, n_pairs = classifier_title(best.classifier), len(pairs_of(data))
    of = f"of the {_tested(data)} of {data['dataset']['n_surfaces']} surfaces classified correctly"
    folds = f", {data['n_folds']} folds" if data["n_folds"] > 1 else ""
    folds += f" of {counted(data['n_starts'], 'start')}" if data.get("n_starts") else ""
    under = f"Protocol: {data['protocol_description']}{folds}."
    highest = f"the best of {n_pairs} pairs of row and classifier, selected on the test folds"
    row, chance = f"{best.row['name']} with {name}", f"chance level {percent(chance_of(data))} %"
    beside, brief = _beside_paper(data, best)
    note = ""
    if choice := data.get("choice"):
        found = choice["accuracy"]
        said = f"{of}, with row and classifier selected in each training set (nested cross-validation)"
        beside = f"{percent(best.accuracy['mean'])} % by {row}: {highest} (optimistic). {beside}".rstrip()
        brief = "Nested cross-validation."
    else:
        found, said = best.accuracy, f"{of}, with {row}"
        if n_pairs > 1:
            said, note = f"{said}: {highest}", "optimistic; "
            under = f"`--nested-cv` gives an unbiased accuracy. {under}"
        brief = f"{row}; {brief}" if brief else f"{row}."
    if data.get("n_starts"):
        under += f" The worst fold: {percent(found['worst'])} %."
    return Finding(
        percent(found["mean"]), "%", interval(found),
        f"{said} ({note}95 % confidence interval{over(found)}; {chance}). {under} {caution(found)}".rstrip(),
        beside, brief,
    )  # fmt: skip


def _beside_paper(data: Data, best: Pair) -> tuple[str, str]:
    """Return the difference of the best row, or of the best published one, to its published accuracy, twice.

    Only for the same number of surfaces and the same protocol.
    """
    what, brief = "for this row with this classifier", True
    published = [pair for pair in pairs_of(data) if pair.published is not None]
    if not published:
        return "No row of this table has a published accuracy.", "no published accuracy."
    if unlike := unlike_published(data):
        return f"Published accuracies are not comparable: {unlike}.", ""
    if best.published is None:
        best = max(published, key=lambda pair: float(pair.published))
        what = (
            f"for {best.row['name']} with {classifier_title(best.classifier)}, the best published row here, "
            f"where ours is {percent(best.accuracy['mean'])} %"
        )
        brief = False  # another row's
    theirs = best.published
    difference, low, high = (points(best.accuracy[key] - theirs) for key in ("mean", "low", "high"))
    return (
        f"{difference} points [{low}, {high}] against the {100 * theirs:.0f} % published {what}. The "
        "published accuracy has no interval and is from other recordings.",
        f"{difference} points against the published {100 * theirs:.0f} %." if brief else "",
    )


def unlike_published(data: Data) -> str:
    """Return why published accuracies are not comparable; an empty string if they are."""
    theirs, n, tested = data.get("published_on"), data["dataset"]["n_surfaces"], _tested(data)
    if not theirs:
        return "number of surfaces and protocol of the publication are not stated"
    unlike = []
    if n != theirs["n_surfaces"]:
        unlike.append(f"{n} surfaces here, {theirs['n_surfaces']} there")
    if data["protocol"] not in theirs["protocols"]:
        there = " or ".join(f"`{name}`" for name in theirs["protocols"])
        unlike.append(f"protocol `{data['protocol']}` here, {there} there")
    if tested == "windows":
        unlike.append("windows here, recordings there")
    return "; ".join(unlike)


def _rows(data: Data, best: Pair | None) -> Table:
    """Return the accuracy of each row and classifier, next to the published one."""
    names = _classifiers(data) or ["accuracy"]
    published = [name for name in names if any(name in row.get("paper", {}) for row in data["rows"])]
    columns: dict[tuple[str, str], list[str]] = {
        ("Row", ""): [row["name"] for row in data["rows"]],
    }
    for name in names:
        title, found = classifier_title(name), [row["accuracy"].get(name) for row in data["rows"]]
        columns[title, "% [95 %]"] = [estimate(accuracy) if accuracy else "" for accuracy in found]
        if name in published:
            theirs = [row.get("paper", {}).get(name) for row in data["rows"]]
            columns[title, "Paper %"] = ["" if value is None else f"{100 * value:.0f}" for value in theirs]
    columns["Dim", ""] = [str(row["n_features"]) for row in data["rows"]]
    columns["ms", ""] = aligned(row["ms_per_recording"] for row in data["rows"])
    tested, also = _tested(data), ", next to the published one" if published else ""
    if published and (unlike := unlike_published(data)):
        also += f" (not comparable: {unlike})"
    clusters = over(best.accuracy) if best else ""
    return Table(
        pd.DataFrame(columns),
        f"Accuracy over {tested} in % with 95 % confidence interval{clusters}{also}; chance level "
        f"{percent(chance_of(data))} %. The best row is bold (selected on the test folds, optimistic). "
        f"Dim: columns at the classifier; ms: latency per {tested[:-1]}, from {_path(data)}, one thread, "
        "shared transforms counted once.",
        strong=[i for i, row in enumerate(data["rows"]) if best is not None and row is best.row],
        instead={
            i: f"not evaluated: {row['missing'] or 'no reason given'}"
            for i, row in enumerate(data["rows"])
            if not row["accuracy"]
        },
    )


def _beside(data: Data) -> Table | None:
    """Return balanced accuracies, worst folds and majority votes of windows; None if there are none."""
    every = [pair.accuracy for pair in pairs_of(data)]
    unit = next((u for u in ("recording", "run") if any(f"per_{u}" in found for found in every)), None)
    balanced = any(abs(found.get("balanced", found["mean"]) - found["mean"]) > 1e-9 for found in every)
    starts = data.get("n_starts")
    if unit is None and not balanced and not starts:
        return None
    rows = [row for row in data["rows"] if row["accuracy"]]
    columns: dict[tuple[str, str], list[str]] = {("Row", ""): [row["name"] for row in rows]}
    for name in _classifiers(data):
        found = [row["accuracy"].get(name, {}) for row in rows]
        if balanced:
            means = [one.get("balanced", one.get("mean")) for one in found]
            columns[classifier_title(name), "balanced"] = [percent(m) if m is not None else "" for m in means]
        if starts:
            columns[classifier_title(name), "worst"] = [percent(one["worst"]) if one else "" for one in found]
        if unit is not None:
            votes = [one.get(f"per_{unit}") for one in found]
            columns[classifier_title(name), f"per {unit}"] = [estimate(v) if v else "" for v in votes]
    caption = "Further accuracies in %. " + "Balanced: mean over surfaces. " * balanced
    caption += (
        f"Worst: lowest of {data['n_folds']} folds (one start and one part of the test set each). "
        if starts
        else ""
    )
    caption += f"Per {unit}: majority vote of its {_tested(data)} [95 %]." if unit else ""
    return Table(pd.DataFrame(columns), caption)


def _ranking(data: Data, best: Pair) -> Figure:
    """Return a figure of all rows with every classifier, and the published accuracies."""
    unlike, pairs = unlike_published(data), pairs_of(data)
    title = classifier_title(best.classifier)
    found = [pair for pair in pairs if pair.classifier == best.classifier]
    gaps = [pair.accuracy["mean"] - pair.published for pair in found if pair.published is not None]
    gaps = [] if unlike else gaps
    reached = (
        f"; with {title}, {sum(gap >= 0 for gap in gaps)} of {len(gaps)} rows reach the published accuracy"
    )
    rows = []
    for row, name, ours, theirs in pairs:
        against = ("", "") if theirs is None else (f"{100 * theirs:.0f}", points(ours["mean"] - theirs))
        against = (against[0], "") if unlike else against
        rows.append((row["name"], classifier_title(name), estimate(ours), *against))
    columns = ["Row", "Classifier", "Ours, % [95 %]", "Published, %", "Points"]
    return Figure(
        "ranking",
        "All rows and classifiers" if len(_classifiers(data)) > 1 else f"All rows with {title}",
        f"The best of {counted(len(pairs), 'pair')}, selected on the test folds, is {best.row['name']} with "
        f"{title}, {percent(best.accuracy['mean'])} %{reached if gaps else ''}; chance level "
        f"{percent(chance_of(data))} %.",
        lambda width: draw_rows(data, None, width),
        Table(pd.DataFrame(rows, columns=columns), n_words=2),
    )


def draw_rows(data: Data, classifiers: Sequence[str] | None, width: float) -> "Drawing":
    """Plot accuracies with intervals, published accuracies, and the chance level if it is in range.

    Each classifier (default: all) has a colour and a shape.
    """
    names = classifiers or _classifiers(data)
    rows = [row for row in data["rows"] if row["accuracy"].keys() & set(names)]
    figure, axes = row_axes(width, [row["name"] for row in rows], "accuracy, %", n_marks=len(names))
    lows = []
    for i, (name, (colour, _), shape) in enumerate(zip(names, cycle(LOOKS), cycle("os^v"), strict=False)):
        place, title = 0.6 * ((i + 0.5) / len(names) - 0.5), classifier_title(name)
        for y, row in enumerate(rows):
            if (theirs := row.get("paper", {}).get(name)) is not None and name in row["accuracy"]:
                lows.append(100 * theirs)
                axes.plot(
                    100 * theirs, y + place, "D", color=colour, markerfacecolor=PAPER, markersize=4.5,
                    gid=f"{row['name']}, {title}: published {100 * theirs:.0f} %", label="hollow: published",
                )  # fmt: skip
        for y, row in enumerate(rows):
            if found := row["accuracy"].get(name):
                mean, low, high = (100 * found[key] for key in ("mean", "low", "high"))
                lows.append(low)
                axes.plot([low, high], 2 * [y + place], color=colour, linewidth=1.2)
                said = f"{row['name']}, {title}: ours {estimate(found)} %"
                label = f"{title}, 95 % interval"
                axes.plot(mean, y + place, shape, color=colour, markersize=5, gid=said, label=label)
    low, high = per_cent_limits(lows)
    chance_line(axes.axvline, 100 * chance_of(data), low)
    axes.set_xlim(low, high)
    legend_above(figure, axes)
    return figure


def _example(example: Data) -> Figure:
    """Return a figure of the phases of one recording."""
    taps, movement, seconds = example["taps"], example["movement"], example["seconds"]
    spans = [(f"tap {i}", start, end) for i, (start, _, end) in enumerate(taps, start=1)]
    spans += [("movement", *movement)] if movement else []
    moved = "movement from {:.2f} to {:.2f} s".format(*movement) if movement else "no movement"
    rows = [(name, f"{start:.3f}", f"{end:.3f}") for name, start, end in spans]
    return Figure(
        "example",
        "Phases of one recording",
        f"{example['recording']} ({example['surface'] or 'surface unknown'}, {seconds:.3g} s): "
        f"{counted(len(taps), 'tap') if taps else 'no taps'}, {moved}.",
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


def _confusion(found: Data, tested: str) -> Heat:
    """Return the confusion matrix, and a list of confusions, the most frequent first."""
    names, totals = found["surfaces"], [sum(counts) for counts in found["counts"]]
    wrong = [
        (felt, taken, count, totals[i])
        for i, (felt, counts) in enumerate(zip(names, found["counts"], strict=True))
        for j, (taken, count) in enumerate(zip(names, counts, strict=True))
        if i != j and count
    ]
    wrong.sort(key=lambda one: -one[2])
    says = f"{sum(one[2] for one in wrong)} of {sum(totals)} {tested} are misclassified"
    if wrong:
        says += "; most frequent: {} predicted as {}, {} of {}".format(*wrong[0])
    rows = {}
    for i, felt in enumerate(names):
        shades = []
        for j, count in enumerate(found["counts"][i]):
            said = f"{count} of {totals[i]} {tested} ({100 * count / max(totals[i], 1):.0f} %)"
            fifth = max(1, -(-5 * count // max(totals[i], 1)))
            shades.append(Shade(f"{'d' if i == j else 'e'}{fifth}", str(count), said) if count else Shade())
        rows[felt] = shades
    listed = [(felt, taken, str(count), f"{100 * count / n:.0f}") for felt, taken, count, n in wrong]
    return Heat(
        "confusion",
        f"Confusion matrix of {found['row']}, {classifier_title(found['classifier'])}",
        f"{says}.",
        dict.fromkeys(names, ""),
        rows,
        {
            "d1 d2 d3 d4 d5": "correct",
            "e1 e2 e3 e4 e5": f"wrong; each step is a fifth of the {tested} of a surface",
        },
        "never",
        "True label (rows), predicted label (columns)",
        " predicted as ",
        Table(
            pd.DataFrame(listed, columns=["True label", "Predicted label", "Count", "% of its tests"]),
            n_words=2,
        ),
    )


def _costs(data: Data, best: Pair) -> Figure:
    """Return the latency of each row with its best classifier, the most accurate row first."""
    of_row: dict[str, Pair] = {}
    for pair in sorted(pairs_of(data), key=lambda pair: -float(pair.accuracy["mean"])):
        if pair.row["ms_per_recording"] is not None:
            of_row.setdefault(pair.row["name"], pair)
    pairs, what = list(of_row.values()), _tested(data)[:-1]
    near = [pair for pair in pairs if pair.accuracy["mean"] >= best.accuracy["mean"] - NEAR]
    fastest = min(near, key=lambda pair: float(pair.row["ms_per_recording"]))
    told = "no faster row comes within"
    if fastest.row is not best.row:
        told = f"{_cost_of(fastest, what)} is the fastest within"
    return Figure(
        "row-costs",
        f"Latency per {what} in ms, from {_path(data)}, the most accurate row first",
        f"{_cost_of(best, what)}, is the most accurate; {told} {100 * NEAR:g} points of it.",
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


def _path(data: Data) -> str:
    """Return the path that the latency of a row covers."""
    found = data.get("segmentation_ms")
    if found is None:
        return "phases to features"
    return f"samples to features ({digits(found)} ms of it segmentation)"


def _cost_of(pair: Pair, what: str) -> str:
    return f"{pair.row['name']}, {digits(pair.row['ms_per_recording'])} ms per {what}"


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


def _notes(data: Data, best: Pair | None) -> Iterator[str]:
    """Yield the notes on the table."""
    told = [pair.accuracy for pair in pairs_of(data)]
    clustered = [a for a in told if a.get("interval", "").startswith(("t over", "Wilson over"))]
    if clustered:
        what = clustered[0].get("clusters", "recording")
        tested = "tests" if data.get("n_starts") else _tested(data)
        yield (
            f"Accuracy is the share of {tested}; its interval is{over(clustered[0])}, because those of one "
            f"{what} are not independent (t, jackknife of the logit)."
        )
    yield from dict.fromkeys(filter(None, map(caution, clustered)))
    agreement = {n: value for n, value in data.get("rank_agreement", {}).items() if value is not None}
    if agreement:
        bounds = data.get("rank_agreement_interval", {})
        listed = ", ".join(
            f"{classifier_title(n)} {v:.2f}"
            + (" [{:.2f}, {:.2f}]".format(*bounds[n]) if bounds.get(n) else "")
            for n, v in agreement.items()
        )
        yield f"Rank correlation of the rows with the published accuracies (Spearman, 95 %): {listed}."
    if best is not None and (columns := best.row.get("selected", {}).get(best.classifier)):
        chosen = sorted(columns.items(), key=lambda item: -item[1])
        listed = ", ".join(f"{column} {share:.0%}" for column, share in chosen)
        yield f"Columns selected by {best.row['name']}, with the share of folds: {listed}."
    if choice := data.get("choice"):
        folds = Counter((row, name) for row, name in choice["chosen"]).most_common()
        n, found = len(choice["chosen"]), choice["accuracy"]
        mean, low, high = (digits(round(100 * found[key], 1)) for key in ("mean", "low", "high"))
        listed = "; ".join(f"{row}, {classifier_title(name)} ({k} of {n} folds)" for (row, name), k in folds)
        titles = ", ".join(find_protocol(name).title for name in choice["protocols"])
        yield (
            "Nested cross-validation (inner folds: "
            f"{titles or 'none, one pair'}): {mean} % [{low}, {high}]; selected: {listed}."
        )
    for row in data["rows"]:
        if row["accuracy"] and row.get("note"):
            yield sentence(f"{row['name']}: {row['note']}")
        if row["accuracy"] and row["missing"]:
            yield f"{row['name']}: without features that the dataset does not allow: {row['missing']}."
    yield from _problems(data)
    yield from map(sentence, data["dataset"].get("notes", ()))


def _problems(data: Data) -> Iterator[str]:
    """Yield recordings left out, flags and undefined features, each list shortened."""
    n = data["dataset"].get("n_windows", data["dataset"]["n_recordings"])
    undefined = [one for one in data.get("undefined", []) if one["n_recordings"] < n]
    for what, lines in {
        "Recordings left out": [": ".join(item) for item in data.get("left_out", [])],
        "Recordings flagged by the loader": [": ".join(item) for item in data.get("flags", [])],
        "Features that are undefined in some recordings (replaced by the training median)": [
            f"{one['feature']} in {one['n_recordings']} of {n}: {one['reason']}" for one in undefined
        ],
    }.items():
        if lines:
            more = f"; and {len(lines) - MOST_LISTED} more, in the JSON" if len(lines) > MOST_LISTED else ""
            yield sentence(f"{what}, {len(lines)}: {'; '.join(lines[:MOST_LISTED])}{more}")


def _classifiers(data: Data) -> list[str]:
    return list(dict.fromkeys(pair.classifier for pair in pairs_of(data)))


def _tested(data: Data) -> str:
    return "windows" if "n_windows" in data["dataset"] else "recordings"
