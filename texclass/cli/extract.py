"""texclass extract: recordings in, a table of features out."""

from pathlib import Path
from typing import Annotated, Any

import typer

from texclass.cli.app import app
from texclass.cli.options import (
    Backend,
    BackendOption,
    DatasetArgument,
    FeatureSetName,
    FsOption,
    JobsOption,
    SchedulerOption,
    SkipBadOption,
    UnitOption,
    open_recordings,
    progress_bar,
)


@app.command()
def extract(
    dataset: DatasetArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="Parquet file to write.")],
    features: FeatureSetName = "texclass",
    fs: FsOption = None,
    unit: UnitOption = None,
    jobs: JobsOption = -1,
    backend: BackendOption = Backend.LOCAL,
    scheduler: SchedulerOption = None,
    skip_bad: SkipBadOption = False,
) -> None:
    """Compute a feature table; a run that was killed goes on where it stopped."""
    from texclass.experiment import extract_table, running_on
    from texclass.features import load_feature_set

    feature_set = load_feature_set(features)
    recordings = open_recordings(dataset, fs, unit, skip_bad)
    with running_on(backend.value, scheduler), progress_bar() as progress:
        table = extract_table(
            recordings, feature_set, output, n_jobs=jobs, skip_bad=skip_bad, progress=progress
        )
    _report_extraction(table, output)


def _report_extraction(table: Any, output: Path) -> None:
    typer.echo(f"wrote {output}: {table.n_recordings} recordings, {table.n_columns} columns")
    for line in table.left_out:
        typer.echo(f"left out: {line}")
