"""The program: the typer application, what it says of errors, and how it ends."""

import ast
import copy
import gc
import inspect
import io
import re
import sys
from collections.abc import Callable
from typing import Annotated, Any, cast

import typer
from typer.core import TyperGroup

from texclass._version import __version__

GROUPS = {
    "Recordings": ("sample", "card", "datasets", "inspect", "describe"),
    "Which surface is this": ("benchmark", "features", "extract", "tradeoff", "stability", "report"),
    "On a robot": ("train", "model", "predict", "stream", "explore", "adapt", "export"),
    "Felt again": ("scene", "texture", "convert"),
}
"""The commands under their headings, in the order of a day's work."""
OPTION = re.compile(r"^(\w+)(?: : (.+))?\n((?: {4}.+\n?)+)", re.MULTILINE)
"""Of the parameters in a docstring: name, how it is spelled, what it is."""


class DaysWork(TyperGroup):
    """The commands in the order of `GROUPS`."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write each heading, and what its commands do; commands of other packages come last."""
        grouped = {name for names in GROUPS.values() for name in names}
        others = [name for name in self.list_commands(ctx) if name not in grouped]
        for heading, names in {**GROUPS, "Other packages": others}.items():
            commands = [(name, self.get_command(ctx, name)) for name in names]
            if commands:
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


def told(function: Callable[..., Any]) -> Callable[..., Any]:
    """Let the docstring of a function tell of its options: "name : -o, --output PATH", and below, what it is.

    An option is spelled as its argument where nothing is said; one that is False by default is a flag.
    """
    written = function.__doc__
    if written is None:  # python -OO keeps none
        (parsed,) = ast.parse(inspect.getsource(function)).body
        written = ast.get_docstring(cast(ast.FunctionDef, parsed)) or ""
    doc, _, listed = inspect.cleandoc(written).partition("\n\nParameters\n----------\n")
    parameters = dict(inspect.signature(function).parameters)
    for name, spelled, text in OPTION.findall(listed):
        asked, words = parameters[name], spelled.replace(",", " ").split()
        flags = [word for word in words if word.startswith("-")]
        metavar = " ".join(words[len(flags) :]) or None
        if asked.default is False and not flags:
            flags = [f"--{name.replace('_', '-')}"]
        stated = getattr(asked.annotation, "__metadata__", None)  # what a docstring cannot tell: min, max
        kind = asked.annotation.__origin__ if stated else asked.annotation
        is_option = bool(flags) or asked.default is not asked.empty
        info = copy.copy(stated[0]) if stated else typer.Option() if is_option else typer.Argument()
        info.param_decls, info.metavar, info.help = tuple(flags), metavar, " ".join(text.split())
        parameters[name] = asked.replace(annotation=Annotated[kind, info])
    function.__doc__ = doc
    vars(function)["__signature__"] = inspect.Signature([*parameters.values()])
    function.__annotations__ = {name: p.annotation for name, p in parameters.items()}
    return function


def command(example: str, group: typer.Typer = app) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return what makes a function a command, as its docstring tells, with an example below its help."""
    register = group.command(epilog=f"Example: {example}")
    return lambda function: register(told(function))


def shown(text: str) -> str:
    """Return a text that cannot steer a terminal: control characters of names in it stand escaped."""
    return "".join(c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in text)


def main() -> None:
    """Run the command line; a bad input ends with one clear line and exit code 1."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # what a terminal, or a pipe on Windows, cannot show is "?"
            stream.reconfigure(errors="replace")
    gc.set_threshold(100_000)  # the modules that a command loads are no garbage, here and at the end
    try:
        app(prog_name="texclass")
    except (ValueError, OSError, ImportError) as error:
        typer.echo(f"error: {shown(str(error))}", err=True)
        sys.exit(1)
    except MemoryError as error:
        typer.echo(f"error: not enough memory ({error})", err=True)
        sys.exit(1)
    except KeyboardInterrupt:
        typer.echo("interrupted; what was computed is kept", err=True)
        sys.exit(130)
    finally:
        gc.freeze()
