"""The program: the typer application, what it says of errors, and how it ends."""

import sys
from typing import Annotated

import typer

from texclass._version import __version__

app = typer.Typer(
    name="texclass",
    help="Which surface is this, and how does it feel, from what a tool's accelerometer recorded.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"texclass {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Which surface is this, and how does it feel, from what a tool's accelerometer recorded."""


def shown(text: str) -> str:
    """Return a text that cannot steer a terminal: control characters of names in it stand escaped."""
    return "".join(c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in text)


def main() -> None:
    """Run the command line; a bad input ends with one clear line and exit code 1."""
    try:
        app()
    except (ValueError, OSError, ModuleNotFoundError) as error:
        typer.echo(f"error: {shown(str(error))}", err=True)
        sys.exit(1)
    except KeyboardInterrupt:
        typer.echo("interrupted; what was computed is kept", err=True)
        sys.exit(130)
