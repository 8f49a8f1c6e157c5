"""From results to the page."""

import base64
import hashlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from texclass.reporting.page.benchmark import benchmark_section
from texclass.reporting.page.blocks import Section
from texclass.reporting.page.feature import feature_section
from texclass.reporting.page.invariance import invariance_section
from texclass.reporting.page.peers import peers_section
from texclass.reporting.page.provenance import again_table, dataset_facts, version_table
from texclass.reporting.page.read import Result, read_result
from texclass.reporting.page.stability import stability_section
from texclass.reporting.page.svg import SHAPES
from texclass.reporting.page.tradeoff import tradeoff_section

if TYPE_CHECKING:
    from jinja2 import Environment

SECTIONS: dict[str, Callable[[dict[str, Any]], Section]] = {
    "benchmark": benchmark_section,
    "feature": feature_section,
    "tradeoff": tradeoff_section,
    "peers": peers_section,
    "invariance": invariance_section,
    "stability": stability_section,
}
TITLE = "Surfaces from what a tool felt"


def render_page(results: Sequence[Result], title: str = "") -> str:
    """Return the page as HTML: everything is in it, and it asks for nothing outside.

    Parameters
    ----------
    results : sequence of Result
        In the order of the page; see `read_result`.
    title : str
        Its title; by default the datasets'.

    Raises
    ------
    ValueError
        If there are no results, or one holds what no figure can show.
    """
    if not results:
        raise ValueError("0 results; the rule is at least 1")
    sections = _told_apart([_section(result) for result in results], results)
    script, style = (_text(name).strip() for name in ("page.js", "page.css"))
    return _environment().get_template("page.html").render(
        title=title or _title(results),
        sections=list(zip(sections, results, strict=True)),
        datasets=dataset_facts(results),
        again=again_table(results),
        versions=version_table(results),
        shapes={**SHAPES, "bar": "M-6,-4H6V4H-6Z"},
        script=script,
        style=style,
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )  # fmt: skip


def write_page(paths: Sequence[str | Path], output: str | Path, title: str = "") -> Path:
    """Read results and write the page.

    Parameters
    ----------
    paths : sequence of str or path
        JSON files.
    output : str or path
        The HTML file; its folder is made if it does not exist.
    title : str
        See `render_page`.

    Raises
    ------
    ValueError
        If a file is no result, or the page would replace one.
    """
    output = Path(output)
    if output.resolve() in [Path(path).resolve() for path in paths]:
        raise ValueError(f"{output} is one of the results; the rule is a file of its own")
    page = render_page([read_result(path) for path in paths], title)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(page, encoding="utf-8")
    return output


def _section(result: Result) -> Section:
    try:
        return SECTIONS[result.kind](result.data)
    except (ValueError, TypeError, LookupError, ArithmeticError) as error:  # numbers that fit no figure
        raise ValueError(
            f"{result.file}: cannot be shown ({error}); the rule is what its command wrote"
        ) from error


def _told_apart(sections: Sequence[Section], results: Sequence[Result]) -> list[Section]:
    """Return the sections; those of equal titles have the name of their pipeline, or of their file, added."""
    counts = Counter(section.title for section in sections)
    told = []
    for section, result in zip(sections, results, strict=True):
        pipeline = result.data.get("pipeline", result.file)
        name = pipeline["name"] if isinstance(pipeline, dict) else pipeline
        title = f"{section.title}: {name}" if counts[section.title] > 1 else section.title
        told.append(replace(section, title=title))
    return told


def _title(results: Sequence[Result]) -> str:
    names = list(dict.fromkeys(r.data["dataset"]["name"] for r in results if r.data.get("dataset")))
    return f"{TITLE}: {', '.join(names)}" if 0 < len(names) <= 3 else TITLE


def _text(name: str) -> str:
    return files(__package__).joinpath("templates", name).read_text(encoding="utf-8")


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("texclass.reporting.page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
