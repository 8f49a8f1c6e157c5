"""Command line: parse the options, call one function of the package, print its result.

The signature of a command defines its options; types that several commands share are in `parameters`.
Subpackages and other packages register modules with commands as entry points `texclass.commands`. Scientific
packages are imported inside the commands, so that help pages and errors in options appear without delay.
"""

import typer

# Importing a module registers its commands. The help page lists them in this order.
from texclass import shipped
from texclass.cli import (
    dataset_commands,
    evaluation_commands,
    model_commands,
    score_command,
    stream_command,
    suite_command,
)
from texclass.cli.app import app, main

for _name in shipped.entry_point_modules("commands"):
    try:
        shipped.module_of("commands", _name)
    except ImportError as error:
        typer.echo(f"warning: {error}", err=True)

__all__ = ["app", "main"]
