"""texclass reproduce: says where the reproductions of the papers are."""

from enum import StrEnum
from typing import Annotated

import typer

from texclass.cli.app import app


class Paper(StrEnum):
    """The papers whose textures are reproduced."""

    GURUSWAMY2011 = "guruswamy2011"
    ABDULALI2016 = "abdulali2016"
    OEZTUERK2018 = "oeztuerk2018"
    OKAMURA2001 = "okamura2001"


@app.command()
def reproduce(paper: Annotated[Paper, typer.Argument(help="Which paper.")]) -> None:
    """Say how the tables and figures of a paper are computed beside the published ones."""
    raise ValueError(
        "the reproductions are scripts of the source distribution now: "
        f"python examples/papers/{paper.value}.py --out DIR"
    )
