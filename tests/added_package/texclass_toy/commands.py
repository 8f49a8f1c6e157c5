"""A command of somebody else."""

from pathlib import Path
from typing import Annotated

import typer

from texclass.cli.app import app


@app.command(rich_help_panel="Toys", epilog="Example: texclass crest oak.toy --unit g")
def crest(
    file: Annotated[Path, typer.Argument(help="Recording.")],
    unit: Annotated[str, typer.Option(metavar="UNIT", help="Unit of the acceleration.")] = "m/s^2",
) -> None:
    """Print the crest factor of a recording."""
    from texclass.loaders import load_recording

    x = load_recording(file, unit=unit).acceleration
    typer.echo(f"{abs(x).max() / (x**2).mean() ** 0.5:.3f}")
