"""Every command of the command line by the words that call it, with its parameters."""

import typer

from texclass.cli import app

PROGRAM = typer.main.get_command(app)
COMMANDS = {
    f"{group}{name}": command
    for group, of in (
        ("", PROGRAM),
        *((f"{g} ", PROGRAM.commands[g]) for g in ("datasets", "scene", "texture")),
    )
    for name, command in of.commands.items()
    if name not in ("scene", "texture")
}


def flags(command):
    """Return the parameter behind each spelling of an option."""
    return {flag: p for p in command.params for flag in (*p.opts, *p.secondary_opts)}
