"""A comparison with peers: as a table on the terminal, as Markdown, and as accuracy against milliseconds."""

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from texclass.peers.result import Contestant, PeerComparison
from texclass.reporting.figures import FAINT, OURS, PAPER
from texclass.reporting.report import save_figure
from texclass.reporting.terminal import Fitting, accuracy_column, name_cell, table_of
from texclass.reporting.words import line_of, title_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from rich.console import RenderableType
    from rich.text import Text

HEADER = (
    "Tool", "Classifier", "Dim", "% [95 %]", "Balanced %", "Ours ahead by [95 %]", "p", "Features ms",
    "Fit s", "Total s", "MB", "First call s",
)  # fmt: skip
TITLES = ("Tool", "Classifier", "%", "Ours ahead by\n[95 %]", "Features\nms", "Fit\ns", "Total\ns", "MB")
"""Of the columns in a terminal; a narrow one has the first five."""
N_TEXT = 2
"""Columns of text, at the left."""
COST_NOTE = (
    "Times are CPU seconds of one thread in a process of its own, compilation left out (first call: two "
    "recordings, with imports and compilation). Features ms: one recording, from its movement to values; "
    "Fit s: all that learns, one fold; Total s: features of all recordings of a fold, fit, predictions; MB: "
    "growth of the process at its largest, after the first call."
)


def peer_headline(comparison: PeerComparison) -> str:
    """Return one line: dataset, protocol, folds."""
    facts = comparison.dataset
    folds = f", {comparison.n_folds} folds" if comparison.n_folds > 1 else ""
    return (
        f"{facts['name']}, ours and peers on the same folds: {facts['n_recordings']} recordings of "
        f"{facts['n_materials']} materials, protocol `{comparison.protocol}`{folds}"
    )


def peer_cells(contestant: Contestant) -> tuple[str, ...]:
    """Return one line as text, in the order of `HEADER`; where nothing ran it says why."""
    accuracy, cost = contestant.accuracy, contestant.cost
    name = f"ours: {contestant.title}" if contestant.ours else contestant.title
    if accuracy is None or cost is None:
        return (name, "", "", _why(contestant), *[""] * (len(HEADER) - 4))
    low, high = accuracy.interval
    return (
        name,
        title_of(contestant.classifier),
        str(contestant.n_columns),
        f"{100 * accuracy.mean:.1f} [{100 * low:.1f}, {100 * high:.1f}]",
        f"{100 * (accuracy.mean if accuracy.balanced is None else accuracy.balanced):.1f}",
        *_ahead(contestant),
        f"{cost.feature_ms:.3g}",
        f"{cost.fit_s:.2g}",
        f"{cost.total_s:.3g}",
        f"{cost.memory_mb:.0f}",
        f"{cost.first_s:.2g}",
    )


def peer_notes(comparison: PeerComparison) -> Iterator[str]:
    """Yield what a reader of the comparison must know, one sentence a note."""
    yield verdict(comparison)
    yield f"Protocol `{comparison.protocol}`: {comparison.protocol_description}."
    yield f"Signals of the peers: {comparison.signals}; scaling is fitted inside each fold."
    reference = comparison.reference
    tests = {c.difference.test for c in comparison.contestants if c.difference is not None}
    yield (
        f"Ours ahead by: points of {reference.title}, {title_of(reference.classifier)}, over the line's, "
        f"paired on the same tests ({', '.join(sorted(tests))}); p is not corrected for the number of lines."
    )
    for contestant in comparison.contestants:
        if contestant.status == "out of time" and contestant.accuracy:
            yield (
                f"{contestant.title}, {title_of(contestant.classifier)}: {contestant.message}; accuracy and "
                f"difference are those of {contestant.n_folds} of {comparison.n_folds} folds."
            )
    yield COST_NOTE
    yield from (f"{note[0].upper()}{note[1:]}." for note in comparison.notes)
    yield from comparison.dataset.get("notes", ())


def verdict(comparison: PeerComparison) -> str:
    """Return one sentence: our row against the best peer that finished every fold."""
    ours, best = comparison.reference, comparison.best_peer
    if best is None or best.difference is None or best.cost is None or ours.cost is None:
        return "No peer finished every fold."
    low, high = best.difference.interval
    clear = "ahead" if low > 0 else "behind" if high < 0 else "not told apart"
    return (
        f"Best peer: {best.title}, {title_of(best.classifier)}; ours minus it: "
        f"{100 * best.difference.difference:+.1f} points [{100 * low:+.1f}, {100 * high:+.1f}] ({clear}), in "
        f"{ours.cost.total_s / best.cost.total_s:.2g} times its total time and "
        f"{ours.cost.feature_ms / best.cost.feature_ms:.2g} times its time for features."
    )


def peer_table(comparison: PeerComparison) -> "RenderableType":
    """Return the comparison for a terminal, with its notes below."""
    from rich.console import Group
    from rich.text import Text

    above = Text(f"{peer_headline(comparison)}; accuracy in %, its 95 % interval beside it", style="bold")
    table = Fitting(tuple(partial(_table, comparison, n_columns) for n_columns in (len(TITLES), 5)))
    return Group(above, table, *(Text(f"- {note}", style="dim") for note in peer_notes(comparison)))


def _table(comparison: PeerComparison, n_columns: int) -> "RenderableType":
    contestants = comparison.contestants
    rows: list[tuple[str | Text, ...]] = []
    for contestant, accuracy in zip(
        contestants, accuracy_column([c.accuracy for c in contestants]), strict=True
    ):
        found = dict(zip(HEADER, peer_cells(contestant), strict=True))
        ran = contestant.accuracy is not None
        numbers = [found[title] if ran else "" for title in (HEADER[5], *HEADER[7:11])]
        name = name_cell(found["Tool"], None if ran else _why(contestant))
        row: tuple[str | Text, ...] = (name, found["Classifier"], accuracy, *numbers)
        rows.append(row[:n_columns])
    styles = ["bold" if c.ours else "" if c.accuracy else "dim" for c in contestants]
    return table_of(TITLES[:n_columns], rows, styles, n_text=N_TEXT)


def peer_markdown(comparison: PeerComparison) -> str:
    """Return the comparison as Markdown, with everything that is needed to compute it again."""
    lines = [f"# {peer_headline(comparison)}", "", line_of(HEADER)]
    lines.append("|---|---|" + "---:|" * (len(HEADER) - N_TEXT))
    lines += [line_of(peer_cells(contestant)) for contestant in comparison.contestants]
    lines += ["", "## Notes", "", *(f"- {note}" for note in peer_notes(comparison))]
    settings = {c.title: c.reference for c in comparison.contestants if not c.ours}
    lines += ["", "## Settings of the peers", "", *(f"- {title}: {how}" for title, how in settings.items())]
    lines += [
        "",
        "## To compute it again",
        "",
        f"- dataset `{comparison.dataset['name']}`, input hash `{comparison.input_hash}`",
        f"- pipeline `{comparison.pipeline}` (hash `{comparison.pipeline_hash}`), seed {comparison.seed}, "
        f"{comparison.time_limit_s:g} s for each peer",
        f"- versions: {_versions(comparison.versions)}",
        f"- versions of the peers' environment: {_versions(comparison.peer_versions)}",
    ]
    return "\n".join(lines) + "\n"


def draw_peers(comparison: PeerComparison) -> "Figure":
    """Draw accuracy against milliseconds: the best classifier of each tool, numbered by accuracy."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.2, 4.4), layout="constrained")
    axes = figure.add_subplot()
    for rank, contestant in enumerate(_best_of_each(comparison), start=1):
        _point(axes, contestant, rank)
    axes.set_xscale("log")
    axes.set_xlabel("features of one recording, CPU milliseconds on one thread (log scale)", fontsize=9)
    axes.set_ylabel("accuracy (%), 95 % interval", fontsize=9)
    axes.margins(x=0.08, y=0.08)
    axes.grid(color=FAINT, linewidth=0.5)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=8, frameon=False, handlelength=1.4)
    title = peer_headline(comparison).replace("`", "")
    figure.suptitle(title, fontsize=9, x=0.01, ha="left", weight="bold")
    return figure


def write_peer_report(comparison: PeerComparison, folder: str | Path) -> tuple[Path, ...]:
    """Write JSON, Markdown and figure; files are named dataset-pipeline-protocol-peers."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    stem = f"{comparison.dataset['name']}-{comparison.pipeline}-{comparison.protocol}-peers"
    paths = tuple(folder / f"{stem}{ending}" for ending in (".json", ".md", ".png"))
    paths[0].write_text(comparison.to_json(), encoding="utf-8")
    paths[1].write_text(peer_markdown(comparison), encoding="utf-8")
    save_figure(draw_peers(comparison), paths[2])
    return paths


def _best_of_each(comparison: PeerComparison) -> list[Contestant]:
    best: dict[str, Contestant] = {}
    for contestant in comparison.contestants:
        if contestant.accuracy is None:
            continue
        known = best.get(contestant.name)
        if known is None or known.accuracy is None or contestant.accuracy.mean > known.accuracy.mean:
            best[contestant.name] = contestant
    return sorted(best.values(), key=lambda c: -c.accuracy.mean if c.accuracy else 0.0)


def _point(axes: "Axes", contestant: Contestant, rank: int) -> None:
    """Draw a numbered disc (a square for ours) with its interval; the list at the side says what it is."""
    if contestant.accuracy is None or contestant.cost is None:
        return
    colour = OURS if contestant.ours else PAPER
    x, y = contestant.cost.feature_ms, 100 * contestant.accuracy.mean
    low, high = (100 * limit for limit in contestant.accuracy.interval)
    name = f"ours: {contestant.title}" if contestant.ours else contestant.title
    axes.errorbar(
        x, y, yerr=[[y - low], [high - y]], color=colour, fmt="s" if contestant.ours else "o", markersize=12,
        linewidth=1.1, capsize=2, zorder=3,
        label=f"{rank}  {name}, {title_of(contestant.classifier)}\n    {y:.1f} %, {x:.3g} ms",
    )  # fmt: skip
    axes.annotate(
        str(rank), (x, y), color="white", fontsize=8, weight="bold", ha="center", va="center", zorder=4
    )


def _ahead(contestant: Contestant) -> tuple[str, str]:
    paired = contestant.difference
    if paired is None:
        return "reference", ""
    low, high = paired.interval
    p = "<0.001" if paired.p_value < 0.001 else f"{paired.p_value:.3f}"
    return f"{100 * paired.difference:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]", p


def _why(contestant: Contestant) -> str:
    return f"{contestant.status}: {contestant.message}" if contestant.message else contestant.status


def _versions(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {version}" for name, version in versions.items()) or "none"
