"""texclass reproduce: the tables and figures of a paper, published beside ours."""

from enum import StrEnum
from importlib import import_module
from pathlib import Path
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
def reproduce(
    paper: Annotated[Paper, typer.Argument(help="Which paper.")],
    out: Annotated[Path, typer.Option(help="Folder for the tables, the figures and the JSON.")] = Path(
        "reports"
    ),
    seed: Annotated[int, typer.Option(help="Of what is simulated.")] = 0,
) -> None:
    """Compute the tables and figures of a paper, and write them beside the published ones.

    Recordings of the papers are not public: what is simulated is said in the report. Real recordings are used
    where they are present (TEXCLASS_DATA).
    """
    chapter = import_module(f"texclass.reporting.reproductions.{paper.value}")
    out.mkdir(parents=True, exist_ok=True)
    for path in chapter.reproduce(out, seed=seed):
        typer.echo(f"wrote {path}")
