"""texclass datasets and texclass features: what there is."""

from typing import Annotated

import typer

from texclass.cli.app import app
from texclass.cli.options import (
    console,
    shipped,
)


@app.command()
def datasets() -> None:
    """List the shipped dataset cards, and which of them have their recordings on this machine."""
    from texclass.reporting import dataset_table

    console().print(dataset_table())


@app.command()
def features(
    name: Annotated[
        str | None,
        typer.Argument(
            help="A shipped feature set or a TOML of yours.", autocompletion=shipped("feature_defs")
        ),
    ] = None,
) -> None:
    """List every feature with phase, unit, gain law and source; or those of one set."""
    from texclass.reporting import feature_table

    console().print(feature_table(name))
