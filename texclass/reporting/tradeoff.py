"""A trade-off study for people: on the terminal, as Markdown, and in pictures."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from texclass.reporting.tradeoff_figures import draw_costs, draw_curves, draw_front
from texclass.tradeoff.tradeoff_result import KNEE_LOSS, Estimate, Tradeoff

if TYPE_CHECKING:
    from rich.console import RenderableType

DPI = 150
HEADER = ("budget ms", "ms", "feats", "cols", "accuracy % [95 %]", "plain %", "")


def write_tradeoff(result: Tradeoff, folder: str | Path) -> tuple[Path, ...]:
    """Write a study's report into a folder: JSON, Markdown, and the pictures of front, costs and curves."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    stem = stem_of(result.dataset)
    figures = {f"{stem}-front.png": draw_front(result), f"{stem}-costs.png": draw_costs(result)}
    if result.curves or result.fewest:
        figures[f"{stem}-curves.png"] = draw_curves(result)
    texts = {f"{stem}.json": result.to_json(), f"{stem}.md": markdown(result, tuple(figures))}
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    for name, figure in figures.items():
        figure.savefig(folder / name, dpi=DPI, metadata={"Software": None})
    return tuple(folder / name for name in (*texts, *figures))


def stem_of(facts: Mapping[str, Any]) -> str:
    """Return the beginning of a report's file names from the facts of its dataset."""
    scene = f"-{len(facts['materials'])}-materials" if facts.get("materials") else ""
    seconds = f"-{facts['max_seconds']:g}s" if facts.get("max_seconds") else ""
    return f"{facts['name']}{scene}{seconds}-tradeoff"


def headline(result: Tradeoff) -> str:
    """Return one line: dataset, set, protocol."""
    facts = result.dataset
    felt = f" of {facts['max_seconds']:g} s" if facts.get("max_seconds") else ""
    return (
        f"{facts['name']}: {facts['n_recordings']} recordings{felt}, {facts['n_materials']} materials, "
        f"features {result.features}, {result.protocol}"
    )


def percent(accuracy: Estimate, digits: int = 1) -> str:
    """Return an accuracy with its interval in per cent."""
    mean, low, high = (f"{100 * a:.{digits}f}" for a in (accuracy.mean, accuracy.low, accuracy.high))
    return f"{mean} [{low}, {high}]"


def rows(result: Tradeoff) -> Iterator[tuple[str, ...]]:
    """Yield the front as text, in the order of `HEADER`."""
    for point in result.front:
        marks = ["knee"] if point is result.knee else []
        marks += ["half"] if point is result.at_half else []
        yield (
            f"{point.budget_ms:.3g}",
            f"{point.ms:.3g}",
            f"{point.n_features:.1f}",
            f"{point.n_columns:.1f}",
            percent(point.accuracy),
            f"{100 * point.plain.mean:.1f}",
            ", ".join(marks),
        )
    every = len({cost.feature for cost in result.costs})
    yield ("", f"{result.total_ms:.3g}", str(every), "", percent(result.full), "", "full set")


def notes(result: Tradeoff) -> Iterator[str]:
    """Yield what a reader must know, one sentence a note."""
    chosen = result.chosen
    yield (
        f"Pipeline at the budget ({chosen.why}): {len(chosen.columns)} columns of "
        f"{', '.join(chosen.features)}; "
        f"{chosen.predicted_ms:.3g} ms by the model, {chosen.measured_ms:.3g} ms measured when pruned; "
        f"accuracy {percent(chosen.accuracy)} %" + (f"; saved as {chosen.file}" if chosen.file else "") + "."
    )
    loss = 100 * (result.full.mean - result.at_half.accuracy.mean)
    yield (
        f"At half the cost of the full set the cost-aware choice {'loses' if loss >= 0 else 'gains'} "
        f"{abs(loss):.1f} points; plain sequential selection (which does not look at costs, and ends at the "
        f"budget) loses {100 * (result.full.mean - result.at_half.plain.mean):.1f}."
    )
    yield (
        f"Knee: the cheapest budget within {100 * KNEE_LOSS:g} point of the best. Features are chosen inside "
        "each training part; intervals: corrected resampled t, 95 %."
    )
    yield (
        "feats, cols: features and columns, mean over folds; ms: one recording, one thread, this machine, "
        f"conditioning included; finding phases takes {result.segmentation_ms:.3g} ms more."
    )
    if result.model_check:
        worst = max(abs(predicted / measured - 1) for predicted, measured in result.model_check)
        yield (
            f"The cost model misses the measured cost of {len(result.model_check)} random subsets "
            f"by at most {100 * worst:.0f} %."
        )
    yield from result.notes


def tradeoff_table(result: Tradeoff) -> "RenderableType":
    """Return the front for a terminal, with its notes below."""
    from rich import box
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    for i, title in enumerate(HEADER):
        table.add_column(title, justify="left" if i == len(HEADER) - 1 else "right", no_wrap=True)
    for row in rows(result):
        table.add_row(*map(Text, row), style="bold" if "knee" in row[-1] else "")
    scene = [Text(f"{n} columns: {percent(a)} %") for n, a in result.fewest]
    return Group(
        Text(headline(result), style="bold"),
        table,
        *scene,
        *(Text(f"- {n}", style="dim") for n in notes(result)),
    )


def markdown(result: Tradeoff, figures: tuple[str, ...] = ()) -> str:
    """Return the study as Markdown, with everything that is needed to do it again."""
    lines = [f"# {headline(result)}", "", *(f"![{name}]({name})" for name in figures), ""]
    lines += _table(HEADER, rows(result))
    lines += ["", *(f"- {note}" for note in notes(result))]
    if result.fewest:
        scene = ", ".join(result.dataset["materials"])
        lines += ["", f"## The fewest columns for {scene}", ""]
        lines += _table(("columns", "accuracy % [95 %]"), ((str(n), percent(a)) for n, a in result.fewest))
    lines += ["", "## Costs", "", "ms per recording. share: shared transforms split equally between the", ""]
    lines[-2] += " features that need them; alone: nothing else computed; saved: left out of the full set."
    lines += _table(
        ("feature", "share", "alone", "saved"),
        ((c.feature, f"{c.share:.2f}", f"{c.alone:.2f}", f"{c.last:.2f}") for c in result.costs),
    )
    lines += ["", *_table(("shared part", "ms"), ((n, f"{v:.2f}") for n, v in result.parts.items()))]
    lines += ["", *_table(("classifier", "fit ms", "predict ms"), _classifiers(result))]
    for curve in result.curves:
        title = f"{curve.name}{f', {curve.unit}' if curve.unit else ''} ({curve.series})"
        lines += ["", f"## Accuracy against {title}", "", *([curve.note, ""] if curve.note else [])]
        pairs = zip(curve.labels, curve.accuracy, strict=True)
        lines += _table((curve.unit or "number", "accuracy % [95 %]"), ((x, percent(a)) for x, a in pairs))
    lines += ["", f"Input hash `{result.input_hash}`, seed {result.seed}, versions: "]
    lines[-1] += ", ".join(f"{name} {version}" for name, version in result.versions.items()) + "."
    return "\n".join(lines) + "\n"


def _classifiers(result: Tradeoff) -> Iterator[tuple[str, ...]]:
    return ((c.name, f"{c.fit_ms:.2f}", f"{c.predict_ms:.3f}") for c in result.classifiers)


def _table(header: tuple[str, ...], body: Iterable[tuple[str, ...]]) -> list[str]:
    lines = ["| " + " | ".join(header) + " |", "|---|" + "---:|" * (len(header) - 1)]
    return lines + ["| " + " | ".join(row) + " |" for row in body]
