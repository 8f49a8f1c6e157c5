"""Arguments and options shared by several commands, as annotated types of their parameters."""

import functools
import inspect
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import typer
from typer import Argument, Option

from texclass.atomic_write import check_suffix
from texclass.cli.output import text_on_standard_error
from texclass.shipped import Kind

# Options in one panel of the help page.
data_option = partial(Option, rich_help_panel="Data")
evaluation_option = partial(Option, rich_help_panel="Evaluation")
baseline_option = partial(Option, rich_help_panel="Baselines")
running_option = partial(Option, rich_help_panel="Running")
output_option = partial(Option, rich_help_panel="Output")

ProtocolName = Literal[
    "recording", "operator", "chronological", "few-shot", "grouped", "paper", "shuffled-windows"
]
"""Names in `texclass.evaluation.protocols.PROTOCOLS`, copied because importing that module is slow."""


def shipped_names(kind: Kind) -> Callable[[str], list[str]]:
    """Return a shell-completion function for the names of shipped definitions."""

    def complete(incomplete: str) -> list[str]:
        from texclass.shipped import names

        return [name for name in names(kind) if name.startswith(incomplete)]

    return complete


def output_file(*flags: str, suffixes: Sequence[str], help: str) -> Any:
    """Return an option for an output file. Its suffix selects the format and is checked first."""

    def check(path: Path | None) -> Path | None:
        return None if path is None else check_suffix(path, *suffixes)

    return output_option(*flags, metavar="FILE", callback=check, help=help)


def check_json_file(context: typer.Context, path: Path | None) -> Path | None:
    """Check the suffix of a JSON file. If it is `-`, print the text of the command on standard error."""
    if path == Path("-"):
        context.with_resource(text_on_standard_error())
        return path
    return None if path is None else check_suffix(path, ".json", "")


def check_folder(path: Path | None) -> Path | None:
    """Raise an error if an output folder has the suffix of a file, such as `-o results.csv`."""
    files = {".csv", ".htm", ".html", ".json", ".md", ".parquet", ".pdf", ".png", ".skops", ".txt", ".xlsx"}
    if path is not None and path.suffix.lower() in files and not path.is_dir():
        raise ValueError(f"cannot write {path}: the suffix is {path.suffix!r}. Expected a folder")
    return path


def output_folder(*flags: str, help: str) -> Any:
    """Return an option for an output folder."""
    return output_option(*flags, metavar="FOLDER", callback=check_folder, help=help)


# Data
Dataset = Annotated[
    str,
    Argument(
        help="Shipped dataset, dataset card (TOML), or folder with one subfolder per surface.",
        autocompletion=shipped_names("datasets"),
    ),
]
SamplingRate = Annotated[
    float | None, data_option("--fs", metavar="HZ", help="Sampling rate, if the files do not state it.")
]
Unit = Annotated[
    str | None,
    data_option(metavar="UNIT", help="Unit of the acceleration: m/s^2, g, mg, counts, V or arbitrary."),
]
Column = Annotated[
    str | None,
    data_option(
        metavar="COLUMNS", help="Columns of the acceleration, by name or number, e.g. ax,ay,az or 2,3,4."
    ),
]
Topic = Annotated[
    str | None,
    data_option(metavar="NAME", help="Topic of a bag that has several topics with an acceleration."),
]
Delimiter = Annotated[
    str | None, data_option(metavar="CHAR", help="Column delimiter of text files, e.g. ';' or 'tab'.")
]
TimeColumn = Annotated[
    str | None,
    data_option(
        metavar="COLUMN", help="Column of the time stamps, by name or number; 'none' ignores time stamps."
    ),
]
TimeUnit = Annotated[
    str | None,
    data_option(
        metavar="UNIT", help="Unit of the time stamps: s, ms, us, ns, min, h or days (default: inferred)."
    ),
]
SkipRows = Annotated[
    int | None, data_option(min=0, metavar="N", help="Skip the first N lines of text files.")
]
Comment = Annotated[
    str | None,
    data_option(metavar="TEXT", help="Prefix of comment lines in text files (default: #, % and //)."),
]
DropIncomplete = Annotated[
    bool, data_option("--drop-incomplete", help="Drop lines of text files in which a column has no number.")
]
Resample = Annotated[
    float | None, data_option(metavar="HZ", help="Resample all recordings (or the stream) to this rate.")
]
Labels = Annotated[
    Path | None,
    data_option(
        metavar="CSV",
        help="Table with the columns `file` and `surface`, for a folder without subfolders per surface. "
        "Other columns are further labels, such as speed. For a LeRobot dataset also 'task' or a feature.",
    ),
]
TapSpacing = Annotated[
    float | None,
    data_option(
        metavar="S",
        help="Impulses closer than this time are one tap and its rebounds (default: as in the card or "
        "pipeline, otherwise 0.08).",
    ),
]
SkipBad = Annotated[
    bool, data_option("--skip-bad", help="Skip and list unreadable recordings instead of stopping.")
]

Reader = dict[str, Any]
"""Options of `load_recording`, for commands with `with_reader_options`."""

# Evaluation
Protocol = Annotated[
    ProtocolName | None,
    evaluation_option(
        metavar="NAME",
        help=f"Evaluation protocol: {', '.join(get_args(ProtocolName))} (default: as in the pipeline).",
    ),
]
Shots = Annotated[
    int | None,
    evaluation_option(min=1, metavar="N", help="Training repetitions per surface for few-shot (default: 3)."),
]
TrainingSet = Annotated[
    list[str] | None,
    evaluation_option(
        "--train",
        metavar="LABEL=VALUES",
        help="Training set, e.g. repetition=1-20 or speed=20,30 (repeatable: all conditions must hold). Any "
        "label of the dataset can be used.",
    ),
]
TestSet = Annotated[
    list[str] | None,
    evaluation_option(
        "--test",
        metavar="LABEL=VALUES",
        help="Test set, e.g. repetition=31-40 or speed=50 (repeatable: all conditions must hold).",
    ),
]
LeaveOut = Annotated[
    str | None,
    evaluation_option(
        metavar="LABEL",
        help="Leave out one value of a label at a time, e.g. operator, session or speed; speed,force leaves "
        "out each combination.",
    ),
]
Axes = Annotated[
    Literal["auto", "merged", "separate"],
    evaluation_option(
        help="Merge the axes of the accelerometer, or keep them separate. auto: as in the pipeline, or "
        "decided from the orientation of the sensor in the recordings.",
    ),
]

# Features and their cost
FeatureSet = Annotated[
    str,
    Option(
        metavar="NAME",
        help="Shipped feature set or feature set file (TOML).",
        autocompletion=shipped_names("feature_defs"),
    ),
]
MaxMs = Annotated[
    float | None,
    Option(metavar="MS", help="Latency budget for the features of one recording, on this machine."),
]
MaxFeatures = Annotated[
    int | None, Option(metavar="N", help="Largest number of feature columns that the classifier uses.")
]

# Models and streams
ModelFile = Annotated[Path, Argument(help="Model file written by `texclass train`.")]
Confidence = Annotated[
    float, Option(metavar="P", help="Probability from which the answer for a contact is sure.")
]
GestureTime = Annotated[
    list[str] | None,
    Option(
        metavar="GESTURE=S",
        help="Duration of a gesture, e.g. tap=0.5 (repeatable; default: its signal length plus 0.5 s).",
    ),
]

# Running
Jobs = Annotated[int, running_option(metavar="N", help="Number of processes; -1 uses all cores.")]
Backend = Annotated[
    Literal["local", "dask"], running_option(help="Run on this machine or on a Dask cluster.")
]
Scheduler = Annotated[
    str | None,
    running_option(
        metavar="ADDRESS",
        help="Dask scheduler, e.g. tcp://host:8786 (default: from the Dask configuration, otherwise a "
        "cluster on this machine).",
    ),
]
Seed = Annotated[int, running_option(min=0, metavar="N", help="Seed of the random numbers.")]

# Output
OutputFolder = Annotated[
    Path, output_folder("--output", "-o", help="Folder for the report (Markdown), figures (PNG) and JSON.")
]
JsonFile = Annotated[
    Path | None,
    output_option(
        "--json",
        metavar="FILE",
        callback=check_json_file,
        help="Also write the result as JSON; '-' prints it (and all text on standard error).",
    ),
]
JsonLines = Annotated[bool, output_option("--jsonl", help="Print one JSON object per line instead of text.")]


def reader_settings(
    fs: SamplingRate = None,
    unit: Unit = None,
    column: Column = None,
    topic: Topic = None,
    delimiter: Delimiter = None,
    time_column: TimeColumn = None,
    time_unit: TimeUnit = None,
    skip_rows: SkipRows = None,
    comment: Comment = None,
    drop_incomplete: DropIncomplete = False,
    resample: Resample = None,
) -> Reader:
    """Convert the options for reading recordings to keyword arguments of `load_recording`."""
    columns = None
    if column:  # the import is slow
        from texclass.loaders.columns import split_columns

        columns = split_columns(column)
    return {
        "fs": fs,
        "unit": unit,
        "column": columns,
        "topic": topic,
        "delimiter": "\t" if delimiter in ("tab", "\\t") else delimiter,
        "time_column": time_column,
        "time_unit": time_unit,
        "skip_rows": skip_rows,
        "comment": comment,
        "drop_incomplete": drop_incomplete or None,
        "resample": resample,
    }


def with_reader_options(command: Callable[..., None]) -> Callable[..., None]:
    """Replace the parameter `reader` of a command by the options of `reader_settings`.

    The command receives the settings as `reader`. An option that it declares itself is not a setting.
    """
    own = inspect.signature(command).parameters
    options = [one for name, one in inspect.signature(reader_settings).parameters.items() if name not in own]

    @functools.wraps(command)
    def run(**values: Any) -> None:
        settings = reader_settings(**{option.name: values.pop(option.name) for option in options})
        command(**values, reader={name: value for name, value in settings.items() if name not in own})

    parameters = [
        parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for name in own
        for parameter in (options if name == "reader" else [own[name]])
    ]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return run


def protocol_name(
    protocol: str | None,
    shots: int | None,
    train: list[str] | None,
    test: list[str] | None,
    leave_out: str | None,
) -> str | None:
    """Return the name of the protocol that the options select; None selects the protocol of the pipeline."""
    if bool(train) != bool(test):
        raise typer.BadParameter("--train and --test must be given together")
    if sum(map(bool, (protocol, train, leave_out))) > 1:
        raise typer.BadParameter("use only one of --protocol, --train with --test, and --leave-out")
    if shots is not None and protocol != "few-shot":
        raise typer.BadParameter("--shots requires --protocol few-shot")
    if shots is not None:
        return f"few-shot {shots}"
    if train and test:
        return f"{' & '.join(train)} -> {' & '.join(test)}"
    return f"leave-out {leave_out}" if leave_out else protocol


def check_scheduler(backend: str, scheduler: str | None) -> None:
    """Raise an error if a Dask scheduler is given without `--backend dask`."""
    if scheduler is not None and backend != "dask":
        raise typer.BadParameter("--scheduler requires --backend dask")


def numbers_by_name(option: str, pairs: list[str] | None) -> dict[str, float]:
    """Parse the values of a repeatable option, each of the form NAME=NUMBER."""
    numbers = {}
    for pair in pairs or ():
        name, _, number = pair.partition("=")
        try:
            numbers[name.strip()] = float(number)
        except ValueError as error:
            raise typer.BadParameter(f"{option} must have the form NAME=NUMBER, got {pair!r}") from error
    return numbers
