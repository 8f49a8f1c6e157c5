"""A benchmark as a document: every row beside the paper's, who is taken for whom, what groups add."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import pandas as pd

from texclass.document import Document, Figure, Finding, Heading, Heat, Shade, Table
from texclass.document.blocks import Block
from texclass.document.figure_style import (
    OTHER,
    OURS,
    PAPER,
    chance_line,
    legend_above,
    per_cent_limits,
    row_axes,
)
from texclass.document.wording import aligned, digits, estimate, interval, percent, points, sentence
from texclass.experiment.gains_document import gains_blocks
from texclass.experiment.result_words import (
    again_facts,
    caution,
    chance_of,
    classifier_title,
    dataset_facts,
    over,
    protocol_title,
    size,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

MOST_LISTED = 6
"""Recordings, flags or features that a note lists one by one; the JSON holds all of them."""
SHADES = {"d1 d2 d3 d4 d5": "right", "e1 e2 e3 e4 e5": "wrong; each step a fifth of the material's"}
Data = Mapping[str, Any]


class _Pair(NamedTuple):
    row: Data
    classifier: str
    accuracy: Data
    published: Any


def _pairs(data: Data) -> list[_Pair]:
    """Return every pair of row and classifier that was computed, and the published accuracy or None."""
    return [
        _Pair(row, name, found, row.get("paper", {}).get(name))
        for row in data["rows"]
        for name, found in row["accuracy"].items()
    ]


def _best_of(data: Data) -> _Pair | None:
    """Return the pair of row and classifier of the highest accuracy; the first of equals."""
    return max(_pairs(data), key=lambda pair: float(pair.accuracy["mean"]), default=None)


def benchmark_document(data: Data) -> Document:
    """Return a benchmark as a document.

    Parameters
    ----------
    data : mapping
        As `BenchmarkResult.to_dict` returns it, or its JSON read back.
    """
    best = _best_of(data)
    pipeline = data["pipeline"]
    return Document(
        f"{data['dataset']['name']}, {protocol_title(data['protocol'])}",
        list(benchmark_blocks(data)),
        f"Pipeline {pipeline['name']}: {size(data['dataset'])}",
        _finding(data, best)
        if best
        else Finding("none", "", "", "of the rows could be computed; the table says what the dataset lacks."),
        dataset_facts(data),
        again_facts(data, f"{pipeline['name']} ({pipeline['hash']}), features {pipeline['features']}"),
        data["versions"],
    )


def benchmark_blocks(data: Data) -> Iterator[Block]:
    """Yield what a benchmark's document is made of."""
    best = _best_of(data)
    published = any(row.get("paper") for row in data["rows"])
    yield Heading("Every row beside the paper's" if published else "Every row")
    yield _rows(data, best)
    beside = _beside(data)
    if beside is not None:
        yield beside
    if best is not None:
        yield _ranking(data, best)
    if data["confusion"]:
        yield Heading("Which materials are taken for which")
        yield _confusion(data["confusion"], _tested(data))
    if data.get("gains"):
        yield Heading("What each group of features adds")
        yield from gains_blocks(data["gains"], data["seed"])
    if notes := list(_notes(data, best)):
        yield Heading("Notes")
        yield notes


def _finding(data: Data, best: _Pair) -> Finding:
    """Return the accuracy of the choice inside the training parts, if it was made, else the highest."""
    name, n_pairs = classifier_title(best.classifier), len(_pairs(data))
    folds = f", {data['n_folds']} folds" if data["n_folds"] > 1 else ""
    of = f"of the {_tested(data)} recognised among {data['dataset']['n_materials']} materials"
    under = f"Protocol: {data['protocol_description']}{folds}."
    highest = f"the highest of {n_pairs} pairs of row and classifier, chosen with the tests in view"
    row, chance = f"{best.row['name']} with {name}", f"chance {percent(chance_of(data))} %"
    beside, brief = _beside_paper(data, best)
    if choice := data.get("choice"):
        found = choice["accuracy"]
        said = f"{of}, by row and classifier chosen inside each training part"
        beside = f"{percent(best.accuracy['mean'])} % by {row}: {highest}, so optimistic. {beside}".rstrip()
        brief = f"Chosen inside the training parts; {percent(best.accuracy['mean'])} % by {row} is {highest}."
    else:
        found, said = best.accuracy, f"{of}, by {row}"
        if n_pairs > 1:
            said += f": {highest}, so optimistic (`--choose` says what the choice is worth)"
        brief = f"{row}; {brief}" if brief else f"{row}."
    return Finding(
        percent(found["mean"]), "%", interval(found),
        f"{said} (95 % interval{over(found)}; {chance}). {under}{_space(caution(found))}", beside, brief,
    )  # fmt: skip


def _beside_paper(data: Data, best: _Pair) -> tuple[str, str]:
    """Return how far the best row, or else the best published one, is from its published figure, twice.

    Only where as many surfaces were told apart under the same protocol.
    """
    what, which = "for this row with this classifier", ""
    published = [pair for pair in _pairs(data) if pair.published is not None]
    if not published:
        return "No row of this table has a published figure.", "no published figure."
    if unlike := unlike_published(data):
        return f"The published figures are no measure of ours: {unlike}.", ""
    if best.published is None:
        best = max(published, key=lambda pair: float(pair.published))
        what = (
            f"for {best.row['name']} with {classifier_title(best.classifier)}, the best published row here, "
            f"where ours is {percent(best.accuracy['mean'])} %"
        )
        which = f" of {best.row['name']}, for that row"
    theirs = best.published
    difference, low, high = (points(best.accuracy[key] - theirs) for key in ("mean", "low", "high"))
    return (
        f"{difference} points [{low}, {high}] against the {100 * theirs:.0f} % published {what}. The "
        "published figure has no interval and comes from other recordings.",
        f"{difference} points against the published {100 * theirs:.0f} %{which}.",
    )


def unlike_published(data: Data) -> str:
    """Return why published figures cannot be compared with ours; nothing if they can."""
    theirs, n, tested = data.get("published_on"), data["dataset"]["n_materials"], _tested(data)
    if not theirs:
        return "it is not said on how many surfaces and under which protocol they were measured"
    unlike = []
    if n != theirs["n_materials"]:
        unlike.append(f"{n} surfaces here, {theirs['n_materials']} there")
    if data["protocol"] not in theirs["protocols"]:
        there = " or ".join(f"`{name}`" for name in theirs["protocols"])
        unlike.append(f"protocol `{data['protocol']}` here, {there} there")
    if tested == "windows":
        unlike.append("windows here, recordings there")
    return "; ".join(unlike)


def _space(text: str) -> str:
    return text and f" {text}"


def _rows(data: Data, best: _Pair | None) -> Table:
    """Return each classifier's accuracy in every row, and the published one beside it."""
    names = _classifiers(data) or ["accuracy"]
    published = [name for name in names if any(name in row.get("paper", {}) for row in data["rows"])]
    columns: dict[tuple[str, str], list[str]] = {
        ("Row", ""): [row["name"] for row in data["rows"]],
        ("Dim", ""): [str(row["n_features"]) for row in data["rows"]],
    }
    for name in names:
        title, found = classifier_title(name), [row["accuracy"].get(name) for row in data["rows"]]
        columns[title, "% [95 %]"] = [estimate(accuracy) if accuracy else "" for accuracy in found]
        if name in published:
            theirs = [row.get("paper", {}).get(name) for row in data["rows"]]
            columns[title, "Paper %"] = ["" if value is None else f"{100 * value:.0f}" for value in theirs]
    columns["ms", ""] = aligned(row["ms_per_recording"] for row in data["rows"])
    tested, also = _tested(data), ", and the published one" if published else ""
    if published and (unlike := unlike_published(data)):
        also += f" (no measure of ours: {unlike})"
    clusters = over(best.accuracy) if best else ""
    return Table(
        pd.DataFrame(columns),
        f"Accuracy over {tested} in % with its 95 % interval{clusters}{also}; chance is "
        f"{percent(chance_of(data))} %; the best row is bold: it is chosen with the tests in view. "
        "Dim: columns that reach the classifier; ms: features of one "
        f"{tested[:-1]}, one thread, shared transforms counted once, without segmentation.",
        strong=[i for i, row in enumerate(data["rows"]) if best is not None and row is best.row],
        instead={
            i: f"not computed: {row['missing'] or 'no reason given'}"
            for i, row in enumerate(data["rows"])
            if not row["accuracy"]
        },
    )


def _beside(data: Data) -> Table | None:
    """Return balanced accuracies and votes of a recording's (or run's) windows; None if they add nothing."""
    every = [pair.accuracy for pair in _pairs(data)]
    unit = next((u for u in ("recording", "run") if any(f"per_{u}" in found for found in every)), None)
    balanced = any(abs(found.get("balanced", found["mean"]) - found["mean"]) > 1e-9 for found in every)
    if unit is None and not balanced:
        return None
    rows = [row for row in data["rows"] if row["accuracy"]]
    columns: dict[tuple[str, str], list[str]] = {("Row", ""): [row["name"] for row in rows]}
    for name in _classifiers(data):
        found = [row["accuracy"].get(name, {}) for row in rows]
        if balanced:
            means = [one.get("balanced", one.get("mean")) for one in found]
            columns[classifier_title(name), "balanced"] = [percent(m) if m is not None else "" for m in means]
        if unit is not None:
            votes = [one.get(f"per_{unit}") for one in found]
            columns[classifier_title(name), f"per {unit}"] = [estimate(v) if v else "" for v in votes]
    caption = "The same in other terms, in %. " + "Balanced: mean over materials. " * balanced
    caption += f"Per {unit}: by majority of its {_tested(data)} [95 %]." if unit else ""
    return Table(pd.DataFrame(columns), caption)


def _ranking(data: Data, best: _Pair) -> Figure:
    """Return all rows as a picture: ours and the published figures."""
    name = best.classifier
    found = [pair for pair in _pairs(data) if pair.classifier == name]
    unlike = unlike_published(data)
    gaps = [pair.accuracy["mean"] - pair.published for pair in found if pair.published is not None]
    gaps = [] if unlike else gaps
    reached = f"; {sum(gap >= 0 for gap in gaps)} of {len(gaps)} rows reach their published figure"
    rows = []
    for row, _, ours, theirs in found:
        against = ("", "") if theirs is None else (f"{100 * theirs:.0f}", points(ours["mean"] - theirs))
        against = (against[0], "") if unlike else against
        rows.append((row["name"], estimate(ours), *against))
    return Figure(
        "ranking",
        f"Every row with {classifier_title(name)}",
        f"The best of {len(found)} rows, with the tests in view, is {best.row['name']} with "
        f"{percent(best.accuracy['mean'])} %{reached if gaps else ''}; chance is "
        f"{percent(chance_of(data))} %.",
        lambda width: draw_rows(data, name, width),
        Table(pd.DataFrame(rows, columns=["Row", "Ours, % [95 %]", "Published, %", "Points"])),
    )


def draw_rows(data: Data, classifier: str, width: float) -> "Drawing":
    """Draw each row's accuracy with its interval beside the published figure, and chance where in sight."""
    rows = [row for row in data["rows"] if classifier in row["accuracy"]]
    figure, axes = row_axes(width, [row["name"] for row in rows], "accuracy, %")
    lows = []
    for y, row in enumerate(rows):
        found, theirs = row["accuracy"][classifier], row.get("paper", {}).get(classifier)
        mean, low, high = (100 * found[key] for key in ("mean", "low", "high"))
        lows.append(low)
        axes.plot([low, high], [y, y], color=OURS)
        if theirs is not None:
            lows.append(100 * theirs)
            axes.plot(
                100 * theirs, y, "D", color=OTHER, markerfacecolor=PAPER, markersize=5.5,
                gid=f"{row['name']}: published {100 * theirs:.0f} %", label="published",
            )  # fmt: skip
        said = f"{row['name']}: ours {estimate(found)}"
        axes.plot(mean, y, "o", color=OURS, gid=said, label="ours, 95 % interval")
    low, high = per_cent_limits(lows)
    chance_line(axes.axvline, 100 * chance_of(data), low)
    axes.set_xlim(low, high)
    legend_above(figure, axes)
    return figure


def _confusion(found: Data, tested: str) -> Heat:
    """Return the confusion matrix, and the confusions as a list, the most frequent first."""
    names, totals = found["materials"], [sum(counts) for counts in found["counts"]]
    wrong = [
        (felt, taken, count, totals[i])
        for i, (felt, counts) in enumerate(zip(names, found["counts"], strict=True))
        for j, (taken, count) in enumerate(zip(names, counts, strict=True))
        if i != j and count
    ]
    wrong.sort(key=lambda one: -one[2])
    says = f"{sum(one[2] for one in wrong)} of {sum(totals)} {tested} are taken for another material"
    if wrong:
        says += "; the most frequent: {} taken for {}, {} of {}".format(*wrong[0])
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
        {looks: f"{what}{f' {tested}' * what.startswith('wrong')}" for looks, what in SHADES.items()},
        "never",
        "Felt (rows), and taken for (columns)",
        " taken for ",
        Table(pd.DataFrame(listed, columns=["Material", "taken for", "times", "% of its tests"]), n_words=2),
    )


def _notes(data: Data, best: _Pair | None) -> Iterator[str]:
    """Yield what a reader of the table must know."""
    told = [pair.accuracy for pair in _pairs(data)]
    clustered = [a for a in told if a.get("interval", "").startswith(("t over", "Wilson over"))]
    if clustered:
        what = clustered[0].get("clusters", "recording")
        yield (
            f"Accuracy is the share of {_tested(data)}; its interval is{over(clustered[0])}, as those of one "
            f"{what} are no independent tests (t, jackknife of the logit)."
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
        yield f"Rank agreement of the rows with the published figures (Spearman, 95 %): {listed}."
    if best is not None and (columns := best.row.get("selected", {}).get(best.classifier)):
        chosen = sorted(columns.items(), key=lambda item: -item[1])
        listed = ", ".join(f"{column} {share:.0%}" for column, share in chosen)
        yield f"Columns that {best.row['name']} selects, by share of folds: {listed}."
    if choice := data.get("choice"):
        folds = Counter((row, name) for row, name in choice["chosen"]).most_common()
        n = len(choice["chosen"])
        listed = "; ".join(f"{row}, {classifier_title(name)} ({k} of {n} folds)" for (row, name), k in folds)
        yield (
            "Row and classifier chosen inside each training part (by "
            f"{protocol_title(choice['protocol'])}): {_chosen_accuracy(choice['accuracy'])}; chosen: "
            f"{listed}."
        )
    for row in data["rows"]:
        if row["accuracy"] and row["missing"]:
            yield f"{row['name']}: without features the dataset lacks: {row['missing']}."
    yield from _problems(data)
    yield from map(sentence, data["dataset"].get("notes", ()))


def _problems(data: Data) -> Iterator[str]:
    """Yield recordings left out, flags and undefined features, each list cut to a readable length."""
    n = data["dataset"].get("n_windows", data["dataset"]["n_recordings"])
    undefined = [one for one in data.get("undefined", []) if one["n_recordings"] < n]
    for what, lines in {
        "Recordings left out": [": ".join(item) for item in data.get("left_out", [])],
        "Recordings flagged by the loader": [": ".join(item) for item in data.get("flags", [])],
        "Features without a value in some recordings (where the training median stands in)": [
            f"{one['feature']} in {one['n_recordings']} of {n}: {one['reason']}" for one in undefined
        ],
    }.items():
        if lines:
            more = f"; and {len(lines) - MOST_LISTED} more, in the JSON" if len(lines) > MOST_LISTED else ""
            yield sentence(f"{what}, {len(lines)}: {'; '.join(lines[:MOST_LISTED])}{more}")


def _chosen_accuracy(accuracy: Data) -> str:
    mean, low, high = (digits(round(100 * accuracy[key], 1)) for key in ("mean", "low", "high"))
    return f"{mean} % [{low}, {high}]"


def _classifiers(data: Data) -> list[str]:
    return list(dict.fromkeys(pair.classifier for pair in _pairs(data)))


def _tested(data: Data) -> str:
    return "windows" if "n_windows" in data["dataset"] else "recordings"
