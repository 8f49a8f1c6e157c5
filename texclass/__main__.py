"""Run the command line with `python -m texclass`."""

from texclass.cli import main

main()
