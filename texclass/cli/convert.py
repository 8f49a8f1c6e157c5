"""texclass convert and texclass texture: texture files, and what is in them."""

from pathlib import Path
from typing import Annotated

import typer

from texclass.cli.app import app
from texclass.cli.options import console, write_json


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="A .texture, or the .xml of a HaTT texture.")],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="The other one of the two, to be written.")],
    fs: Annotated[
        float, typer.Option("--fs", help="To XML: sampling rate of the models, Hz; HaTT renders 1000.")
    ] = 1000.0,
    order: Annotated[int, typer.Option(help="To XML: largest order of the models.", min=1, max=100)] = 20,
) -> None:
    """Convert a texture between our format and Penn HaTT XML."""
    from texclass.exchange import (
        describe,
        load_texture,
        read_hatt,
        save_texture,
        to_hatt,
        write_hatt,
    )

    kinds = source.suffix.lower(), target.suffix.lower()
    if kinds == (".xml", ".texture"):
        save_texture(read_hatt(source), target)
    elif kinds == (".texture", ".xml"):
        unit = describe(source)["unit"]
        write_hatt(to_hatt(load_texture(source), unit=unit, fs=fs, order=order), target)
    else:
        raise ValueError(f"{source} to {target}; the rule is .texture to .xml or .xml to .texture")
    typer.echo(f"wrote {target}, {target.stat().st_size} bytes")


@app.command()
def texture(
    file: Annotated[Path, typer.Argument(help="A .texture, or the .xml of a HaTT texture.")],
    json_file: Annotated[Path | None, typer.Option("--json", help="Write it as JSON here.")] = None,
) -> None:
    """Show what is in a texture file: family, points, order, sampling rate, unit, bytes."""
    import json

    from rich.table import Table
    from rich.text import Text

    from texclass.exchange import describe

    found = describe(file)
    shown = Table(box=None, show_header=False, title=Text(str(file)), title_justify="left")
    for key, value in found.items():
        shown.add_row(key, Text(_words(value)))
    console().print(shown)
    write_json(json_file, json.dumps(found, indent=1))


def _words(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_words(inner)}" for name, inner in value.items())
    if isinstance(value, list):
        return " x ".join(map(str, value)) or "number"
    return "-" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
