"""`python -m texclass` is `texclass`."""

from texclass.cli import main

main()
