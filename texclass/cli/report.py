"""texclass report: results as one self-contained HTML page."""

from pathlib import Path
from typing import Annotated

import typer

from texclass.cli.app import app


@app.command()
def report(
    results: Annotated[
        list[Path],
        typer.Argument(
            help="JSON files that benchmark, tradeoff, stability or the study of invariance wrote."
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="The page.")] = Path("report.html"),
    title: Annotated[str, typer.Option(help="Its title; the datasets' names by default.")] = "",
) -> None:
    """Write results as one HTML page that needs no network: tables, figures, datasets, versions."""
    from texclass.reporting.page import write_page

    typer.echo(f"wrote {write_page(results, output, title)}")
