"""The command line: parse, call one function, print. Nothing heavy is imported before a command needs it."""

# Importing a command's module puts the command into the program, in this order.
from texclass.cli import (
    benchmark,
    convert,
    export,
    extract,
    inspect,
    listings,
    model,
    predict,
    report,
    reproduce,
    scene,
    stability,
    stream,
    tradeoff,
    train,
)
from texclass.cli.app import app, main

__all__ = ["app", "main"]
