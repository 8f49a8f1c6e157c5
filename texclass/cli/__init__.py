"""The command line: parse, call one function, print.

Nothing heavy is imported before a command needs it: recordings are opened first, so that a missing unit is
said at once. The options of a command are the arguments of its function, told in its docstring (`app.told`);
groups of them that several commands have, or that belong together, are functions of their own
(`options.shared`).
"""

# Importing commands puts them into the program, in this order.
from texclass.cli import (
    experiment_commands,
    listing_commands,
    model_commands,
    stream_command,
    texture_commands,
)
from texclass.cli.app import app, main

__all__ = ["app", "main"]
