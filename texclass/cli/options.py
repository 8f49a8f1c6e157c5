"""What the commands share: arguments and options, telling a result, the progress bar."""

import functools
import inspect
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from texclass.atomic_write import path_ending
from texclass.cli.app import told

if TYPE_CHECKING:
    from texclass.evaluation.result import Result
    from texclass.reporting import Document


FILE_SUFFIXES = (
    ".csv",
    ".htm",
    ".html",
    ".json",
    ".md",
    ".parquet",
    ".pdf",
    ".png",
    ".skops",
    ".txt",
    ".xlsx",
)
"""Suffixes that an output folder cannot have."""


def shipped(folder: Literal["feature_defs", "pipelines", "datasets"]) -> Callable[[str], list[str]]:
    """Return a completion that offers the shipped names of a definition folder."""

    def complete(incomplete: str) -> list[str]:
        from texclass.shipped import names

        return [name for name in names(folder) if name.startswith(incomplete)]

    return complete


def _of_format(*suffixes: str) -> Callable[[Path | None], Path | None]:
    """Return a check of an output file's suffix, which runs before the command does any work."""

    def check(path: Path | None) -> Path | None:
        return None if path is None else path_ending(path, *suffixes)

    return check


def writes(*suffixes: str) -> Any:
    """Return an option for an output file whose suffix is one of some; the suffix decides the format."""
    return typer.Option(callback=_of_format(*suffixes))


def check_folder(path: Path | None) -> Path | None:
    """Check that an output folder is not named like a file: `-o results.csv` would create a folder."""
    if path is not None and path.suffix.lower() in FILE_SUFFIXES and not path.is_dir():
        raise ValueError(f"cannot write {path}: the suffix is {path.suffix!r}. Expected a folder")
    return path


WRITES_FOLDER = typer.Option(callback=check_folder)
"""Option for an output folder."""
Recordings = Annotated[
    str,
    typer.Argument(
        help="A shipped dataset card, a card of yours (TOML), or a folder with one subfolder per material.",
        autocompletion=shipped("datasets"),
    ),
]
FeatureSet = Annotated[
    str,
    typer.Option(help="A shipped feature set, or a TOML of yours.", autocompletion=shipped("feature_defs")),
]
Unit = Annotated[
    str | None, typer.Option("--unit", help="Unit of the acceleration: m/s^2, g, mg, counts, V or arbitrary.")
]
Column = Annotated[
    str | None,
    typer.Option(
        "--column",
        help="Columns of the acceleration, by name or by number from 1: --column ax,ay,az or 2,3,4.",
    ),
]
Delimiter = Annotated[
    str | None, typer.Option("--delimiter", help="What divides the columns of text files: ';', 'tab'.")
]
TimeColumn = Annotated[
    str | None,
    typer.Option(
        "--time-column", help="Column of the time stamps, by name or number; 'none' ignores them all."
    ),
]
TimeUnit = Annotated[
    str | None,
    typer.Option(
        "--time-unit", help="Unit of the time stamps: s, ms, us, ns, min, h or days; inferred by default."
    ),
]
SkipRows = Annotated[
    int | None,
    typer.Option("--skip-rows", min=0, help="Lines at the beginning of text files that are not read."),
]
Comment = Annotated[
    str | None,
    typer.Option("--comment", help="Beginning of comment lines in text files; by default #, % and //."),
]
DropIncomplete = Annotated[
    bool,
    typer.Option("--drop-incomplete", help="Leave out lines of text files without a number in each column."),
]
Labels = Annotated[
    Path | None,
    typer.Option(
        "--labels",
        metavar="CSV",
        help="Table with the columns `file` and `surface` for a folder without one subfolder per surface.",
    ),
]
Jobs = Annotated[int, typer.Option("--jobs", help="Processes; -1 uses every core.")]
RunOn = Annotated[
    Literal["local", "dask"],
    typer.Option("--backend", help="Run on processes of this machine, or on a Dask cluster."),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        help="Address of the Dask scheduler (tcp://host:8786); by default what Dask is configured for, "
        "or a cluster on this machine."
    ),
]
SkipBad = Annotated[
    bool, typer.Option("--skip-bad", help="Leave bad recordings out and list them, instead of stopping.")
]
Json = Annotated[
    Path | None,
    typer.Option(
        "--json",
        metavar="PATH",
        callback=_of_format(".json", ""),
        help="Write the result as JSON here; - prints it.",
    ),
]
JsonLines = Annotated[bool, typer.Option("--jsonl", help="Print the result as one JSON object a line.")]
MaxMs = Annotated[
    float | None, typer.Option(help="Milliseconds that the features of a recording may take here.")
]
MaxFeatures = Annotated[int | None, typer.Option(help="Columns that may reach the classifier.")]
Seconds = Annotated[
    list[str] | None,
    typer.Option(
        "--seconds",
        metavar="GESTURE=S",
        help="What a gesture costs, several times: tap=0.5; by default what it feels, and half a second.",
    ),
]


def named_numbers(option: str, given: list[str] | None, rule: str) -> dict[str, float]:
    """Return numbers by name, as people write them on a command line: NAME=NUMBER, several times."""
    found = {}
    for one in given or ():
        name, _, text = one.partition("=")
        try:
            found[name.strip()] = float(text)
        except ValueError as error:
            raise ValueError(f"{option} is {one!r}; the rule is {rule}") from error
    return found


def seconds_of(given: list[str] | None) -> dict[str, float]:
    """Return what gestures cost."""
    return named_numbers("--seconds", given, "GESTURE=SECONDS, tap=0.5")


def shared(name: str) -> Callable[[Callable[..., Any]], Callable[[Callable[..., None]], Callable[..., None]]]:
    """Return what turns a function into a decorator that gives commands the function's options.

    The command gets what the function makes of them under a name.
    """

    def of(made: Callable[..., Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
        given_to_it = inspect.signature(told(made)).parameters

        def with_options(command: Callable[..., None]) -> Callable[..., None]:
            @functools.wraps(command)
            def called(**given: Any) -> None:
                found = made(**{option: given.pop(option) for option in given_to_it})
                command(**given, **{name: found})

            own = [p for other, p in inspect.signature(command).parameters.items() if other != name]
            parameters = [*(p.replace(kind=p.KEYWORD_ONLY) for p in own), *given_to_it.values()]
            vars(called)["__signature__"] = inspect.Signature(parameters)
            called.__annotations__ = {p.name: p.annotation for p in parameters}
            return called

        return with_options

    return of


@shared("protocol")
def holds_out(
    *,
    protocol: Literal["recording", "operator", "blocks", "few-shot", "run", "paper"] | None = None,
    shots: Annotated[int | None, typer.Option(min=1)] = None,
    train: list[str] | None = None,
    test: list[str] | None = None,
    leave_out: str | None = None,
) -> str | None:
    """Give a command the options that say what trains and what tests; it gets the name of a protocol.

    Parameters
    ----------
    protocol
        How recordings are held out; by default as the pipeline says. `texclass train` takes the later
        ones (`blocks`) from 20 numbered repetitions of each surface on: a sensor may drift.
    shots
        Repetitions of each material that train under `few-shot`; 3 by default.
    train : LABEL=VALUES
        Instead, train on these recordings alone: repetition=1-20, session=a,b; several all hold.
    test : LABEL=VALUES
        And test on those: repetition=31-40.
    leave_out : LABEL
        Or test on each operator, session or repetition in turn.
    """
    if bool(train) != bool(test):
        raise ValueError("--train without --test, or --test without --train; the rule is both")
    if sum(map(bool, (protocol, train, leave_out))) > 1:
        raise ValueError("--protocol, --train with --test and --leave-out are alternatives; the rule is one")
    if shots is not None and protocol != "few-shot":
        raise ValueError(f"--shots is {shots}, but the protocol is not few-shot; the rule is both")
    if shots is not None:
        return f"{protocol} {shots}"
    if train and test:
        return f"{' & '.join(train)} -> {' & '.join(test)}"
    return f"leave-out {leave_out}" if leave_out else protocol


@shared("reading")
def reads_files(
    *,
    fs: float | None = None,
    unit: Unit = None,
    column: Column = None,
    delimiter: Delimiter = None,
    time_column: TimeColumn = None,
    time_unit: TimeUnit = None,
    skip_rows: SkipRows = None,
    comment: Comment = None,
    drop_incomplete: DropIncomplete = False,
    resample: float | None = None,
) -> dict[str, Any]:
    """Give a command the options that say how files are read; it gets them as one mapping.

    Parameters
    ----------
    fs
        Sampling rate in Hz, where the files do not state it.
    resample
        Rate in Hz to which all files are brought, band-limited.
    """
    read = columns_read(column, delimiter)
    read |= {"time_column": time_column, "time_unit": time_unit, "skip_rows": skip_rows, "comment": comment}
    read["drop_incomplete"] = drop_incomplete or None
    return {"fs": fs, "unit": unit, "resample": resample, **read}


def columns_read(column: str | None, delimiter: str | None) -> dict[str, Any]:
    """Return how files are read, several columns and a tab as people write them on a command line."""
    from texclass.loaders.columns import split_columns

    divided_by = "\t" if delimiter in ("tab", "\\t") else delimiter
    return {"column": split_columns(column) if column else None, "delimiter": divided_by}


def write_json(path: Path | None, text: str) -> None:
    """Write a result as JSON where --json asked for it, if it did; `-` is standard output."""
    if path == Path("-"):
        typer.echo(text)
    elif path is not None:
        from texclass.atomic_write import write_atomic

        write_atomic(path, text)


def tell(document: "Document", lines: Iterable[str] = ()) -> None:
    """Print a document, and lines below it."""
    from texclass.reporting import print_document

    print_document(document)
    for line in lines:
        typer.echo(line)


def wrote(paths: Iterable[Path]) -> None:
    """Say which files were written."""
    for path in paths:
        typer.echo(f"wrote {path}")


def tell_and_save(result: "Result", folder: Path, json_file: Path | None = None, *beside: Path) -> None:
    """Print a result, write it as JSON where that was asked for, and say what was written into a folder."""
    tell(result.document())
    write_json(json_file, result.to_json())
    wrote((*result.save(folder), *beside))


@contextmanager
def progress_bar() -> Iterator[Any]:
    """Give a callable (done, total, what) that draws a progress bar on standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    shown = Console(stderr=True)
    if not shown.is_interactive:  # where nothing can be drawn, rich would leave an empty line
        yield lambda done, total, what: None
        return
    with Progress(*columns, console=shown, transient=True) as bar:
        tasks: dict[str, Any] = {}

        def advance(done: int, total: int, what: str) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=total)
            bar.update(tasks[what], completed=done, total=total)

        yield advance
