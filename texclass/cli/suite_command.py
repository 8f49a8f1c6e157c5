"""Command `suite`: evaluate methods on many datasets, and write the leaderboard."""

import sys
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from texclass.cli import parameters as p
from texclass.cli.app import app
from texclass.cli.output import RECORDING_KERNELS, announce_start, print_lines, progress_bar, write_json


@app.command(rich_help_panel="Evaluation", epilog="Example: texclass suite --datasets simulated6 -o my-suite")
def suite(
    tables: Annotated[
        list[Path] | None,
        Argument(
            metavar="[TABLE]...",
            help="Tables of other runs (leaderboard.csv) to join with this one; with --no-run, only these.",
        ),
    ] = None,
    *,
    datasets: Annotated[
        list[str] | None,
        Option(
            metavar="NAMES",
            help="Shipped datasets or dataset cards, e.g. taps5,borealtc (default: all on this machine).",
        ),
    ] = None,
    methods: Annotated[
        list[str] | None,
        Option(
            metavar="NAMES",
            help="Pipelines (name or TOML), baselines, or your feature (file.py:function). Default: the "
            "pipelines of texclass and the baselines.",
        ),
    ] = None,
    run: Annotated[
        bool, Option("--run/--no-run", help="Evaluate missing cells, or only join the tables.")
    ] = True,
    show: Annotated[
        bool, Option("--list", help="List the datasets and methods, and evaluate nothing.")
    ] = False,
    author: Annotated[str, Option(metavar="NAME", help="Author of your methods, for a submission.")] = "",
    baselines_python: Annotated[
        Path | None,
        p.baseline_option(
            metavar="FILE", help="Python interpreter with the baselines installed (default: this one)."
        ),
    ] = None,
    baselines_timeout: Annotated[
        float,
        p.baseline_option(
            metavar="S",
            help="Time limit for the features of a baseline on a dataset.",
        ),
    ] = 1800.0,
    jobs: p.Jobs = -1,
    backend: p.Backend = "local",
    scheduler: p.Scheduler = None,
    output: Annotated[
        Path, p.output_folder("--output", "-o", help="Folder for folds, finished cells, table and pages.")
    ] = Path("suite"),
    json_file: p.JsonFile = None,
) -> None:
    """Evaluate methods on many datasets with the same folds, and write the leaderboard.

    An interrupted run resumes where it stopped. Every method is tuned inside the training sets.
    """
    p.check_scheduler(backend, scheduler)
    if not run and not tables:
        raise typer.BadParameter("--no-run needs the tables to join")
    announce_start(*RECORDING_KERNELS)
    from texclass.suite import DEFAULT_METHODS, available_datasets, find_method

    available, unavailable = available_datasets()
    chosen = [find_method(name, author) for name in _names(methods) or DEFAULT_METHODS]
    if show:
        print_lines("dataset:", available)
        print_lines("not evaluated:", (f"{name}: {reason}" for name, reason in unavailable.items()))
        print_lines("method:", (f"{method.name}: {method.title}" for method in chosen))
        return
    from texclass.atomic_write import write_atomic
    from texclass.evaluation import use_backend
    from texclass.evaluation.workers import begin_loading
    from texclass.leaderboard import Leaderboard
    from texclass.reporting import print_document
    from texclass.suite import SuiteSettings, run_suite
    from texclass.suite.runner import join_rows, read_table

    # The path is not resolved, since the interpreter of a virtual environment is a symbolic link.
    python = (baselines_python or Path(sys.executable)).expanduser().absolute()
    results = [read_table(path) for path in tables or ()]
    if run:
        if backend == "local":
            begin_loading(jobs, "texclass.suite.cells")
        with use_backend(backend, scheduler), progress_bar() as progress:
            settings = SuiteSettings(output.absolute(), python, baselines_timeout)
            names = _names(datasets) or available
            results.append(run_suite(names, chosen, settings, n_jobs=jobs, progress=progress))
    table = join_rows(results)
    result = Leaderboard.from_table(table)
    for document in result.documents.values():
        print_document(document)
    write_json(json_file, result.to_json())
    table_file = output / "leaderboard.csv"
    output.mkdir(parents=True, exist_ok=True)
    write_atomic(table_file, table.to_csv(index=False))
    print_lines("wrote", (table_file, *result.save(output)))


def _names(texts: list[str] | None) -> list[str]:
    """Split the values of a repeatable option at commas."""
    return [name.strip() for text in texts or () for name in text.split(",") if name.strip()]
