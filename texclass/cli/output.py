"""Print and write the results of commands, and draw progress bars."""

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import typer

if TYPE_CHECKING:
    from texclass.reporting.result_files import Result


RECORDING_KERNELS = ("phases", "simulate", "vibration")
"""Subpackages with the compiled functions that load and segment recordings, and compute their features."""
SCENE_KERNELS = ("haptics.scene",)
"""Subpackage with the compiled functions that plan and render scenes."""
CLEAR_LINE = "\r\x1b[2K"
"""Control sequence that erases the line of the cursor on a terminal."""


_standard_outputs: list[TextIO] = []
"""Standard output of the program during `text_on_standard_error`, for `write_json`."""


@contextmanager
def text_on_standard_error() -> Iterator[None]:
    """Print the text of a command on standard error, so that `--json -` prints only JSON."""
    _standard_outputs.append(sys.stdout)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        _standard_outputs.pop()


def write_json(path: Path | None, text: str) -> None:
    """Write a result as JSON to the file given by the option --json, if any; `-` is standard output."""
    if path == Path("-"):
        typer.echo(text, file=_standard_outputs[-1])
    elif path is not None:
        from texclass.atomic_write import write_atomic

        write_atomic(path, text)


def print_lines(prefix: str, lines: Iterable[object]) -> None:
    """Print lines with a prefix such as "note:" or "wrote"."""
    for line in lines:
        typer.echo(f"{prefix} {line}")


def print_and_save(
    result: "Result",
    folder: Path,
    json_file: Path | None = None,
    *,
    written: Iterable[Path] = (),
    mlflow: bool = False,
) -> None:
    """Print a result, write its JSON and report, and list the written files, including those in `written`.

    If `mlflow` is True, the result is also logged as a run of MLflow.
    """
    from texclass.reporting import print_document

    print_document(result.document())
    write_json(json_file, result.to_json())
    files = (*result.save(folder), *written)
    print_lines("wrote", files)
    if mlflow:
        from texclass.cli.mlflow_run import log_run

        typer.echo(log_run(result, files))


def line_start() -> str:
    """Return what erases an unfinished line on a terminal, such as "loading libraries ..."."""
    return CLEAR_LINE if sys.stderr.isatty() else ""


def announce_start(*subpackages: str) -> None:
    """Tell at once what the command is doing, and later which functions are compiled.

    Importing libraries takes a second, and compiling functions on a new machine up to a minute.

    Parameters
    ----------
    *subpackages : str
        Subpackages whose compiled functions the command needs. If the machine has compiled none of them, this
        is announced.
    """
    from texclass import compilation

    modules = set[str]()

    def report(function: str) -> None:
        module = function.rpartition(".")[0]
        if module not in modules:
            modules.add(module)
            typer.echo(f"{line_start()}compiling {module} (once per machine)", err=True)

    compilation.reporters[:] = [report]
    if not compilation.has_compiled(*subpackages):
        typer.echo("first run on this machine: compiling functions, which takes up to a minute", err=True)
    if sys.stderr.isatty():
        typer.echo("loading libraries ...", err=True, nl=False)


@contextmanager
def progress_bar() -> Iterator[Any]:
    """Yield a callback `progress(n_done, n_total, label)` that draws a progress bar on standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_interactive:  # otherwise rich prints an empty line
        yield lambda n_done, n_total, label: None
        return
    typer.echo(CLEAR_LINE, err=True, nl=False)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        tasks: dict[str, Any] = {}

        def advance(n_done: int, n_total: int, label: str) -> None:
            if label not in tasks:
                tasks[label] = bar.add_task(label, total=n_total)
            bar.update(tasks[label], completed=n_done, total=n_total)

        yield advance
