"""The commands that the README only mentions exist; its blocks are run, its links followed, by test_docs."""

import re
from pathlib import Path

import pytest
import typer

from texclass.cli import app

README = Path(__file__).parents[1] / "README.md"
TEXT = README.read_text(encoding="utf-8")
SAID = re.findall(r"(?:^|`|/)texclass ([a-z]+(?: --[a-z-]+)?)", TEXT, re.M)
COMMANDS = typer.main.get_command(app)


@pytest.mark.parametrize("command", sorted(set(SAID)))
def test_every_command_and_its_option_exist(command):
    name, *options = command.split()
    known = {option for parameter in COMMANDS.commands[name].params for option in parameter.opts}
    assert set(options) <= known
