"""The typer application, its error messages and exit codes."""

import gc
import io
import sys
from pathlib import Path
from typing import Annotated

import typer

from texclass._version import __version__
from texclass.cli.output import line_start

app = typer.Typer(
    name="texclass",
    epilog="Exit codes: 0 success, 1 invalid input or a failed check, 2 invalid command or option, "
    "3 stream without an answer, 130 interrupted.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _print_version(is_wanted: bool) -> None:
    if is_wanted:
        typer.echo(f"texclass {__version__}")
        raise typer.Exit


@app.callback()
def texclass(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Classify and render surfaces from the vibration of a hand-held tool."""


def escape_control_characters(text: str) -> str:
    """Escape the control characters of a text, so that file names cannot control the terminal."""
    return "".join(c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in text)


def error_message(error: Exception) -> str:
    """Return the message of an error; messages of the operating system start with the file."""
    if not isinstance(error, OSError) or error.filename is None or error.strerror is None:
        return str(error)
    if isinstance(error, FileNotFoundError):
        return f"{error.filename} does not exist. Check the path (the current folder is {Path.cwd()})"
    return f"{error.filename}: {error.strerror}"


def main() -> None:
    """Run the command line; print a one-line message and exit with code 1 if the input is invalid."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # characters that the output cannot encode become "?"
            stream.reconfigure(errors="replace")
    gc.set_threshold(100_000)  # imported modules are never freed, so collect less often
    try:
        app(prog_name="texclass")
    except (ValueError, OSError, ImportError) as error:
        typer.echo(f"{line_start()}error: {escape_control_characters(error_message(error))}", err=True)
        sys.exit(1)
    except MemoryError as error:
        typer.echo(f"{line_start()}error: not enough memory ({error})", err=True)
        sys.exit(1)
    except KeyboardInterrupt:
        typer.echo(f"{line_start()}interrupted; finished results are kept", err=True)
        sys.exit(130)
    finally:
        gc.freeze()
