"""texclass stability: every model, filter, transform and feature at the extremes, ours and public ones."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from texclass.cli.app import app
from texclass.cli.options import progress_bar, write_json


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
    out: Annotated[Path, typer.Option(help="Folder for stability.md, .json and pictures.")] = Path("reports"),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the result as JSON here.")] = None,
) -> None:
    """Try hard inputs on every model, filter, transform and feature, and on public libraries installed here.

    Exit code 1 if any of ours is wrong.
    """
    from texclass.document import print_document, write_document
    from texclass.peers import extreme_inputs
    from texclass.stability import run_stability
    from texclass.stability.stability_document import stability_document, wrong_lines

    peers, left_out = extreme_inputs.installed(quick)
    with progress_bar() as progress:
        result = run_stability(
            quick=quick, only=only.value if only else None, peers=peers, left_out=left_out, progress=progress
        )
    found = result.to_dict()
    document = stability_document(found)
    print_document(document)
    for line in wrong_lines(found):
        typer.echo(line)
    written = (*write_document(document, out, "stability"), out / "stability.json")
    written[-1].write_text(result.to_json(), encoding="utf-8")
    write_json(json_file, result.to_json())
    for path in written:
        typer.echo(f"wrote {path}")
    typer.echo(f"texclass: {len(result.wrong)} of {len(result.ours)} cells wrong")
    if len(result.wrong):
        raise typer.Exit(1)
