"""A new feature against the table: what a researcher wants to know before it goes into a paper."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from texclass.experiment.new_feature import FeatureStudy, Redundancy
from texclass.features.contract import Gain
from texclass.features.examination import EXACT, Behaviour, GainLaw
from texclass.reporting.cells import accuracy_cell
from texclass.reporting.gains import gain_cells, verdict
from texclass.reporting.report import stem_of, write_report
from texclass.reporting.tables import headline
from texclass.reporting.words import line_of, title_of

if TYPE_CHECKING:
    from rich.console import RenderableType

MARKS = {True: "kept", False: "BROKEN"}


def facts(study: FeatureStudy) -> Iterator[tuple[str, str]]:
    """Yield what was found about a feature, as (what, finding) pairs."""
    feature, result = study.feature, study.result
    row = result.rows[-1]
    yield "Feature", f"{feature.name}: {feature.summary} Phase {feature.phase}, unit {feature.unit}."
    alone = (f"{title_of(name)} {accuracy_cell(row.accuracy.get(name))}" for name in result.classifiers)
    yield "Alone", row.missing or ", ".join(alone)
    gains = result.gains
    if gains is not None:
        (group,) = gains.groups
        _, _, accuracy, gain, folds, p, *_ = gain_cells(group)
        if group.paired is not None:
            base = f"{gains.row} {100 * gains.without.accuracy:.1f} % -> {accuracy} %"
            yield (
                "Added to the best row",
                f"{base}, {gain} points, p {p}, folds +/- {folds}. {verdict(gains)}",
            )
        else:
            yield "Added to the best row", verdict(gains)
    added = "" if study.ms_added is None else f"; {max(study.ms_added, 0.0):.3g} ms more beside the best row"
    yield "Cost", f"{study.ms_alone:.3g} ms per recording alone{added}"
    yield "Gain law", _law(study.law)
    yield "Repeats", "; ".join(map(_repeats, study.redundancy)) or "nothing: it does not vary"
    broken = [answer.input for answer in study.behaviour if not answer.kept]
    n = len(study.behaviour)
    yield (
        "Degenerate input",
        f"{n - len(broken)} of {n} answered as the contract asks"
        + (f"; not: {', '.join(broken)}" if broken else ""),
    )


def feature_card(study: FeatureStudy) -> "RenderableType":
    """Return the findings for a terminal."""
    from rich import box
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(
        box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False, show_header=False
    )
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for what, finding in facts(study):
        table.add_row(Text(what), Text(finding))
    lines = [Text(f"- {a.input}: {a.answer}: {a.detail}", style="dim") for a in study.behaviour if not a.kept]
    return Group(Text(f"New feature `{study.feature.name}` against the table", style="bold"), table, *lines)


def feature_markdown(study: FeatureStudy) -> str:
    """Return the findings as Markdown."""
    lines = [f"# New feature `{study.feature.name}` against the table", "", f"{headline(study.result)}.", ""]
    lines += ["| what | finding |", "|---|---|", *map(line_of, facts(study))]
    lines += [
        "",
        "## Answers to degenerate input",
        "",
        "| input | answer | detail | contract |",
        "|---|---|---|---|",
    ]
    lines += [line_of(_behaviour(answer)) for answer in study.behaviour]
    lines += ["", "The table itself, the gains and all versions stand in the report beside this one."]
    return "\n".join(lines) + "\n"


def write_feature_report(study: FeatureStudy, folder: str | Path) -> tuple[Path, ...]:
    """Write the report of the table with the feature in it, and beside it what was found about it."""
    written = write_report(study.result, folder)
    stem = Path(folder) / f"{stem_of(study.result)}-feature"
    texts = {Path(f"{stem}.json"): study.to_json(), Path(f"{stem}.md"): feature_markdown(study)}
    for path, text in texts.items():
        path.write_text(text, encoding="utf-8")
    return (*written, *texts)


def law_of(gain: Gain) -> str:
    """Return a gain law as an equation."""
    power = "y" if gain.power == 0 else f"g^{gain.power:.3g} y" if gain.power != 1 else "g y"
    shift = "" if gain.shift == 0 else f" {'+' if gain.shift > 0 else '-'} {abs(gain.shift):.3g} log10 g"
    return f"y(g x) = {power}{shift}"


def _law(law: GainLaw | None) -> str:
    if law is None:
        return "not measured: the feature has no value on the recordings it was tried on"
    if law.holds:
        return f"declared {law_of(law.declared)}; measured the same (to {law.deviation:.0e})"
    found = law_of(law.measured) if law.measured_deviation <= EXACT else "another, of no power and no shift"
    return f"declared {law_of(law.declared)}; BROKEN by {law.deviation:.2g}; measured {found}"


def _repeats(found: Redundancy) -> str:
    nearest = ", ".join(f"{kin.column} {kin.rank_correlation:+.2f}" for kin in found.nearest)
    explained = (
        "" if found.explained is None else f"; all columns together explain R^2 = {found.explained:.2f}"
    )
    return f"{found.column}: rank correlation with {nearest or 'nothing'}{explained}"


def _behaviour(answer: Behaviour) -> tuple[str, ...]:
    return (answer.input, answer.answer, answer.detail, MARKS[answer.kept])
