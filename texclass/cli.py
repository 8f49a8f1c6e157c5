"""The command line: parse, call one function, print. Nothing heavy is imported before a command needs it."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from texclass._version import __version__

if TYPE_CHECKING:
    from texclass.loaders import Dataset

app = typer.Typer(
    name="texclass",
    help="Which surface is this, and how does it feel, from what a tool's accelerometer recorded.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


class Protocol(StrEnum):
    """How recordings are divided into training and test."""

    RECORDING = "recording"
    OPERATOR = "operator"
    BLOCKS = "blocks"
    PAPER = "paper"


def _dataset_names(incomplete: str) -> list[str]:
    from texclass.shipped import names

    return [name for name in names("datasets") if name.startswith(incomplete)]


def _pipeline_names(incomplete: str) -> list[str]:
    from texclass.shipped import names

    return [name for name in names("pipelines") if name.startswith(incomplete)]


def _feature_set_names(incomplete: str) -> list[str]:
    from texclass.shipped import names

    return [name for name in names("feature_defs") if name.startswith(incomplete)]


DatasetArgument = Annotated[
    str,
    typer.Argument(
        help="A shipped dataset card, a card of yours (TOML), or a folder with one subfolder per material.",
        autocompletion=_dataset_names,
    ),
]
FsOption = Annotated[
    float | None, typer.Option("--fs", help="Sampling rate in Hz, where the files do not state it.")
]
UnitOption = Annotated[
    str | None,
    typer.Option("--unit", help="Unit of the acceleration: m/s^2, g, mg, counts, V or arbitrary."),
]
JobsOption = Annotated[int, typer.Option("--jobs", help="Processes; -1 uses every core.")]
SkipBadOption = Annotated[
    bool, typer.Option("--skip-bad", help="Leave bad recordings out and list them, instead of stopping.")
]


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"texclass {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Which surface is this, and how does it feel, from what a tool's accelerometer recorded."""


@app.command()
def benchmark(
    dataset: DatasetArgument = "simulated",
    pipeline: Annotated[
        str,
        typer.Option(help="A shipped pipeline, or a TOML of yours.", autocompletion=_pipeline_names),
    ] = "strese2015",
    protocol: Annotated[
        Protocol | None, typer.Option(help="How recordings are split; the pipeline's own by default.")
    ] = None,
    folds: Annotated[int | None, typer.Option(help="Number of folds; the pipeline's own by default.")] = None,
    fs: FsOption = None,
    unit: UnitOption = None,
    jobs: JobsOption = -1,
    skip_bad: SkipBadOption = False,
    out: Annotated[
        Path, typer.Option(help="Folder for the table (Markdown, PNG), the confusion matrix and the JSON.")
    ] = Path("reports"),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the result as JSON here.")] = None,
) -> None:
    """Classify a dataset with every row of a pipeline's table, beside the published figures."""
    from texclass.experiment import load_pipeline, run_benchmark
    from texclass.reporting import benchmark_table, write_report

    definition = load_pipeline(pipeline)
    recordings = _open(dataset, fs, unit, skip_bad)
    with _progress() as progress:
        result = run_benchmark(
            recordings,
            definition,
            protocol=protocol.value if protocol else None,
            n_folds=folds,
            n_jobs=jobs,
            skip_bad=skip_bad,
            progress=progress,
        )
    _console().print(benchmark_table(result))
    if json_file is not None:
        json_file.parent.mkdir(parents=True, exist_ok=True)
        json_file.write_text(result.to_json(), encoding="utf-8")
    for path in write_report(result, out):
        typer.echo(f"wrote {path}")


@app.command()
def extract(
    dataset: DatasetArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="Parquet file to write.")],
    features: Annotated[
        str,
        typer.Option(help="A shipped feature set, or a TOML of yours.", autocompletion=_feature_set_names),
    ] = "texclass",
    fs: FsOption = None,
    unit: UnitOption = None,
    jobs: JobsOption = -1,
    skip_bad: SkipBadOption = False,
) -> None:
    """Compute a feature table; a run that was killed goes on where it stopped."""
    from texclass.experiment import extract_table
    from texclass.features import load_feature_set

    feature_set = load_feature_set(features)
    recordings = _open(dataset, fs, unit, skip_bad)
    with _progress() as progress:
        table = extract_table(
            recordings, feature_set, output, n_jobs=jobs, skip_bad=skip_bad, progress=progress
        )
    _report_extraction(table, output)


@app.command()
def inspect(
    recording: Annotated[
        str,
        typer.Argument(help="A file in any supported format, or DATASET:RECORDING (simulated:wood-03-01)."),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Picture to write; <recording>.inspect.png here by default.")
    ] = None,
    features: Annotated[
        str,
        typer.Option(help="Feature set whose values are shown.", autocompletion=_feature_set_names),
    ] = "strese2015",
    fs: FsOption = None,
    unit: UnitOption = None,
) -> None:
    """Draw one recording: signal, phases, taps, spectrogram and feature values."""
    from texclass.features import FeatureExtractor
    from texclass.loaders import find_recording
    from texclass.phases import segment
    from texclass.reporting import draw_inspection

    found = find_recording(recording, fs=fs, unit=unit)
    phases = segment(found)
    declared = [found.with_(phases=phases)]
    extraction = FeatureExtractor(features).fit(declared).extract(declared)
    values = dict(zip(extraction.columns, extraction.values[0], strict=True))
    path = out or Path(f"{Path(found.recording_id).name}.inspect.png")
    draw_inspection(found, phases, values, path)
    typer.echo(f"{phases.kind}: {len(phases.taps)} taps, movement {_seconds(phases.movement, found.fs)}")
    for note in (*found.flags, *phases.notes):
        typer.echo(f"note: {note}")
    typer.echo(f"wrote {path}")


@app.command()
def datasets() -> None:
    """List the shipped dataset cards, and which of them have their recordings on this machine."""
    from texclass.reporting import dataset_table

    _console().print(dataset_table())


@app.command()
def features(
    name: Annotated[
        str | None,
        typer.Argument(help="A shipped feature set or a TOML of yours.", autocompletion=_feature_set_names),
    ] = None,
) -> None:
    """List every feature with phase, unit, gain law and source; or those of one set."""
    from texclass.reporting import feature_table

    _console().print(feature_table(name))


def main() -> None:
    """Run the command line; a bad input ends with one clear line and exit code 1."""
    try:
        app()
    except (ValueError, OSError) as error:
        typer.echo(f"error: {error}", err=True)
        sys.exit(1)
    except KeyboardInterrupt:
        typer.echo("interrupted; what was computed is kept", err=True)
        sys.exit(130)


def _open(dataset: str, fs: float | None, unit: str | None, skip_bad: bool) -> "Dataset":
    from texclass.loaders import open_dataset

    return open_dataset(dataset, fs=fs, unit=unit, skip_bad=skip_bad)


def _console() -> Any:
    from rich.console import Console

    return Console()


@contextmanager
def _progress() -> Iterator[Any]:
    """Give a callable (done, total, what) that draws a progress bar on standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        tasks: dict[str, Any] = {}

        def advance(done: int, total: int, what: str) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=total)
            bar.update(tasks[what], completed=done, total=total)

        yield advance


def _seconds(movement: tuple[int, int] | None, fs: float) -> str:
    return "none" if movement is None else f"{movement[0] / fs:.2f} to {movement[1] / fs:.2f} s"


def _report_extraction(table: Any, output: Path) -> None:
    typer.echo(f"wrote {output}: {table.n_recordings} recordings, {table.n_columns} columns")
    for line in table.left_out:
        typer.echo(f"left out: {line}")
