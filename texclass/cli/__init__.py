"""The command line: parse, call one function, print.

Commands of the areas and of other packages are modules named by entry points under `texclass.commands`.

Nothing heavy is imported before a command needs it: recordings are opened first, so that a missing unit is
said at once. The options of a command are the arguments of its function, told in its docstring (`app.told`);
groups of them that several commands have, or that belong together, are functions of their own
(`options.shared`).
"""

import typer

# Importing a module of commands registers them.
from texclass import shipped
from texclass.cli import evaluation_commands, listing_commands, model_commands, stream_command
from texclass.cli.app import app, main

for _name in shipped.added("commands"):
    try:
        shipped.module_of("commands", _name)
    except ImportError as error:
        typer.echo(f"warning: {error}", err=True)

__all__ = ["app", "main"]
