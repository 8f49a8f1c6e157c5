"""The program: the typer application, what it says of errors, and how it ends."""

import gc
import io
import itertools
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from texclass._version import __version__

GROUPS = {
    "Recordings": ("sample", "datasets", "inspect", "describe"),
    "Which surface is this": ("benchmark", "features", "extract", "tradeoff", "stability", "report"),
    "On a robot": ("train", "model", "predict", "stream", "explore", "adapt", "export"),
    "Felt again": ("scene", "texture", "convert"),
}
"""The commands under their headings, in the order of a day's work."""
SPELLED = {"--out": "--output", "--window": "--touch", "--rate": "--fs"}
"""How options were spelled until 0.2, and are now; both are understood until 1.0."""


class DaysWork(TyperGroup):
    """The commands in the order of `GROUPS`."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write each heading, and what its commands do."""
        for heading, names in GROUPS.items():
            commands = [(name, self.get_command(ctx, name)) for name in names]
            with formatter.section(heading):
                formatter.write_dl([(name, c.get_short_help_str(60)) for name, c in commands if c])


app = typer.Typer(
    name="texclass",
    cls=DaysWork,
    help="Which surface is this, and how does it feel, from what a tool's accelerometer recorded.",
    epilog="Exit codes: 0 done, 1 bad input or a check that failed, 2 no such command or option, 3 a stream "
    "without an answer, 130 interrupted.",
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


def as_spelled_now(arguments: list[str]) -> list[str]:
    """Return arguments in the spelling of today.

    `--json` without a path printed what `--jsonl` prints now (predict, stream), or `--json -` (model).
    """
    now = []
    for word, following in itertools.zip_longest(arguments, arguments[1:], fillvalue=""):
        option, *value = word.split("=", 1)
        if word == "--json" and not following.endswith(".json") and following != "-":
            now += {"predict": ["--jsonl"], "stream": ["--jsonl"], "model": ["--json", "-"]}.get(
                arguments[0], [word]
            )
        else:
            now.append("=".join([SPELLED.get(option, option), *value]))
    return now


def main() -> None:
    """Run the command line; a bad input ends with one clear line and exit code 1."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # what a terminal, or a pipe on Windows, cannot show is "?"
            stream.reconfigure(errors="replace")
    gc.set_threshold(100_000)  # the modules that a command loads are no garbage, here and at the end
    try:
        app(as_spelled_now(sys.argv[1:]), prog_name="texclass")
    except (ValueError, OSError, ImportError) as error:
        typer.echo(f"error: {shown(str(error))}", err=True)
        sys.exit(1)
    except KeyboardInterrupt:
        typer.echo("interrupted; what was computed is kept", err=True)
        sys.exit(130)
    finally:
        gc.freeze()
