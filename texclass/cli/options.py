"""What the commands share: arguments and options, opening a dataset, the console, the progress bar."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

if TYPE_CHECKING:
    from pathlib import Path

    from texclass.loaders import Dataset


class Protocol(StrEnum):
    """How recordings are divided into training and test."""

    RECORDING = "recording"
    OPERATOR = "operator"
    BLOCKS = "blocks"
    FEW_SHOT = "few-shot"
    RUN = "run"
    PAPER = "paper"


class Backend(StrEnum):
    """Where the work runs."""

    LOCAL = "local"
    DASK = "dask"


def shipped(folder: Literal["feature_defs", "pipelines", "datasets"]) -> Callable[[str], list[str]]:
    """Return a completion that offers the shipped names of a definition folder."""

    def complete(incomplete: str) -> list[str]:
        from texclass.shipped import names

        return [name for name in names(folder) if name.startswith(incomplete)]

    return complete


DatasetArgument = Annotated[
    str,
    typer.Argument(
        help="A shipped dataset card, a card of yours (TOML), or a folder with one subfolder per material.",
        autocompletion=shipped("datasets"),
    ),
]
FeatureSetName = Annotated[
    str,
    typer.Option(help="A shipped feature set, or a TOML of yours.", autocompletion=shipped("feature_defs")),
]
FsOption = Annotated[
    float | None, typer.Option("--fs", help="Sampling rate in Hz, where the files do not state it.")
]
UnitOption = Annotated[
    str | None,
    typer.Option("--unit", help="Unit of the acceleration: m/s^2, g, mg, counts, V or arbitrary."),
]
JobsOption = Annotated[int, typer.Option("--jobs", help="Processes; -1 uses every core.")]
BackendOption = Annotated[
    Backend, typer.Option("--backend", help="Run on processes of this machine, or on a Dask cluster.")
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        help="Address of the Dask scheduler (tcp://host:8786); by default what Dask is configured for, "
        "or a cluster on this machine."
    ),
]
SkipBadOption = Annotated[
    bool, typer.Option("--skip-bad", help="Leave bad recordings out and list them, instead of stopping.")
]

TouchOption = Annotated[
    float | None,
    typer.Option("--touch", help="Classify single windows of so many seconds of movement, not recordings."),
]
TouchesOption = Annotated[
    int | None,
    typer.Option("--touches", help="At most so many windows of each recording, the first; all by default."),
]


def open_recordings(dataset: str, fs: float | None, unit: str | None, skip_bad: bool) -> "Dataset":
    """Open a shipped card, a card of the user's, or a folder."""
    from texclass.loaders import open_dataset

    return open_dataset(dataset, fs=fs, unit=unit, skip_bad=skip_bad)


def cut_touches(
    dataset: "Dataset", seconds: float | None, per_recording: int | None, jobs: int, progress: Any = None
) -> "Dataset":
    """Cut a dataset into touches if their length is given, else return it as it is."""
    from texclass.experiment import touches

    if seconds is None:
        if per_recording is not None:
            raise ValueError(f"--touches is {per_recording}, but there is no --touch; the rule is both")
        return dataset
    return touches(dataset, seconds, per_recording=per_recording, n_jobs=jobs, progress=progress)


def write_json(path: "Path | None", text: str) -> None:
    """Write a result as JSON where --json asked for it, if it did."""
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def console() -> Any:
    """Return a rich console on standard output."""
    from rich.console import Console

    return Console()


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
