"""texclass model: what is inside a model file."""

from pathlib import Path
from typing import Annotated

import typer

from texclass.cli.app import app
from texclass.cli.options import console


@app.command()
def model(
    file: Annotated[Path, typer.Argument(metavar="MODEL", help="A model file that `texclass train` wrote.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON.")] = False,
) -> None:
    """Show what is in a model: surfaces, features, accuracy, calibration, cost, versions."""
    from texclass.recognition import load_model
    from texclass.reporting.models import model_table

    loaded = load_model(file)
    if as_json:
        typer.echo(loaded.manifest.to_json())
        return
    console().print(model_table(loaded.manifest, len(loaded.columns)))
