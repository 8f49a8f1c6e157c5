"""texclass benchmark: a dataset against every row of a table."""

from pathlib import Path
from typing import Annotated

import typer

from texclass.cli.app import app
from texclass.cli.options import (
    DatasetArgument,
    FsOption,
    JobsOption,
    Protocol,
    SkipBadOption,
    UnitOption,
    console,
    open_recordings,
    progress_bar,
    shipped,
)


@app.command()
def benchmark(
    dataset: DatasetArgument = "simulated",
    pipeline: Annotated[
        str,
        typer.Option(help="A shipped pipeline, or a TOML of yours.", autocompletion=shipped("pipelines")),
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
    recordings = open_recordings(dataset, fs, unit, skip_bad)
    with progress_bar() as progress:
        result = run_benchmark(
            recordings,
            definition,
            protocol=protocol.value if protocol else None,
            n_folds=folds,
            n_jobs=jobs,
            skip_bad=skip_bad,
            progress=progress,
        )
    console().print(benchmark_table(result))
    if json_file is not None:
        json_file.parent.mkdir(parents=True, exist_ok=True)
        json_file.write_text(result.to_json(), encoding="utf-8")
    for path in write_report(result, out):
        typer.echo(f"wrote {path}")
