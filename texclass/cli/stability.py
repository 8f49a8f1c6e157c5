"""texclass stability: every model, filter, transform and feature at the extremes, ours and public ones."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from texclass.cli.app import app
from texclass.cli.options import console, progress_bar, write_json


class Part(StrEnum):
    """What can be tried alone."""

    MODELS = "models"
    FILTERS = "filters"
    TRANSFORMS = "transforms"
    FEATURES = "features"
    PEERS = "peers"


@app.command()
def stability(
    quick: Annotated[
        bool, typer.Option("--quick", help="A small part of the battery, in half a minute.")
    ] = False,
    only: Annotated[Part | None, typer.Option(help="One part alone.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for stability.md, .json and .png.")] = Path("reports"),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the result as JSON here.")] = None,
) -> None:
    """Try hard inputs on every model, filter, transform and feature, and on public libraries installed here.

    Exit code 1 if any of ours is wrong.
    """
    from texclass.reporting.stability import stability_table, write_stability_report, wrong_lines
    from texclass.stability import run_stability

    with progress_bar() as progress:
        result = run_stability(quick=quick, only=only.value if only else None, progress=progress)
    console().print(stability_table(result))
    for line in wrong_lines(result):
        typer.echo(line)
    for reason in result.left_out:
        typer.echo(f"left out: {reason}")
    write_json(json_file, result.to_json())
    for path in write_stability_report(result, out):
        typer.echo(f"wrote {path}")
    typer.echo(f"texclass: {len(result.wrong)} of {len(result.ours)} cells wrong")
    if result.wrong:
        raise typer.Exit(1)
