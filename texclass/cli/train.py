"""texclass train: recordings in, a model file out."""

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
def train(
    dataset: DatasetArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="Model file to write (.skops).")],
    pipeline: Annotated[
        str,
        typer.Option(help="A shipped pipeline, or a TOML of yours.", autocompletion=shipped("pipelines")),
    ] = "texclass",
    row: Annotated[
        str | None, typer.Option(help="Row of the pipeline; the best by cross-validation by default.")
    ] = None,
    classifier: Annotated[
        str | None, typer.Option(help="Classifier of the pipeline; the best by default.")
    ] = None,
    max_ms: Annotated[
        float | None, typer.Option(help="Milliseconds that the features of a recording may take.")
    ] = None,
    max_features: Annotated[int | None, typer.Option(help="Columns that may reach the classifier.")] = None,
    touch: Annotated[
        float | None,
        typer.Option("--touch", help="Seconds of movement of one answer; whole recordings by default."),
    ] = None,
    protocol: Annotated[
        Protocol | None,
        typer.Option(
            help="How recordings are held out; by default as the pipeline says, or, from 20 numbered "
            "repetitions of each surface on, the later ones (`blocks`): a sensor may drift."
        ),
    ] = None,
    false_alarms: Annotated[
        float, typer.Option(help="Share of known surfaces that may be called unknown.")
    ] = 0.05,
    fs: FsOption = None,
    unit: UnitOption = None,
    jobs: JobsOption = -1,
    skip_bad: SkipBadOption = False,
) -> None:
    """Train a model on all recordings; what is chosen is chosen by cross-validation."""
    from texclass.recognition import train as train_model
    from texclass.reporting.models import model_table

    recordings = open_recordings(dataset, fs, unit, skip_bad)
    with progress_bar() as progress:
        model = train_model(
            recordings,
            pipeline,
            row=row,
            classifier=classifier,
            max_ms=max_ms,
            max_features=max_features,
            touch_s=touch,
            protocol=None if protocol is None else protocol.value,
            false_alarms=false_alarms,
            n_jobs=jobs,
            skip_bad=skip_bad,
            progress=progress,
        )
    model.save(output)
    console().print(model_table(model.manifest, len(model.columns)))
    for line in model.left_out:
        typer.echo(f"left out: {line}")
    typer.echo(f"wrote {output}, {output.stat().st_size / 1e6:.1f} MB")
