"""texclass tradeoff: what accuracy costs, and the pipeline at a budget."""

from pathlib import Path
from typing import Annotated

import typer

from texclass.cli.app import app
from texclass.cli.options import (
    Backend,
    BackendOption,
    DatasetArgument,
    FeatureSetName,
    FsOption,
    JobsOption,
    Protocol,
    SchedulerOption,
    UnitOption,
    console,
    open_recordings,
    progress_bar,
    write_json,
)


@app.command()
def tradeoff(
    dataset: DatasetArgument = "simulated",
    features: FeatureSetName = "texclass",
    max_ms: Annotated[
        float | None, typer.Option(help="Milliseconds that the features of a recording may take.")
    ] = None,
    max_seconds: Annotated[
        float | None, typer.Option(help="Seconds of movement that are felt; whole recordings by default.")
    ] = None,
    max_features: Annotated[int | None, typer.Option(help="Columns that may reach the classifier.")] = None,
    materials: Annotated[
        str | None,
        typer.Option(help="Materials of a scene, separated by commas: the fewest columns for these."),
    ] = None,
    protocol: Annotated[Protocol, typer.Option(help="How recordings are split.")] = Protocol.RECORDING,
    curves: Annotated[
        bool, typer.Option(help="Also accuracy against touch, training, rate, bits and model order.")
    ] = True,
    fs: FsOption = None,
    unit: UnitOption = None,
    jobs: JobsOption = -1,
    backend: BackendOption = Backend.LOCAL,
    scheduler: SchedulerOption = None,
    out: Annotated[
        Path, typer.Option(help="Folder for the report (Markdown, JSON, PNG) and the pipeline (skops).")
    ] = Path("reports"),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the study as JSON here.")] = None,
) -> None:
    """Measure what accuracy costs on a dataset; save the pipeline at the budget, or at the knee."""
    from texclass.experiment.choice import Limits
    from texclass.experiment.workers import running_on
    from texclass.features import load_feature_set
    from texclass.reporting.tradeoff import stem_of, tradeoff_table, write_tradeoff
    from texclass.tradeoff.trade import run_tradeoff

    scene = tuple(name.strip() for name in (materials or "").split(",") if name.strip())
    recordings = open_recordings(dataset, fs, unit, skip_bad=True)
    facts = {"name": recordings.name, "materials": scene, "max_seconds": max_seconds}
    with running_on(backend.value, scheduler), progress_bar() as progress:
        result = run_tradeoff(
            recordings,
            load_feature_set(features),
            Limits(max_ms, max_seconds, max_features, scene),
            protocol=protocol.value,
            with_curves=curves,
            n_jobs=jobs,
            progress=progress,
            model_file=out / f"{stem_of(facts)}.skops",
        )
    console().print(tradeoff_table(result))
    write_json(json_file, result.to_json())
    for path in (*write_tradeoff(result, out), Path(result.chosen.file)):
        typer.echo(f"wrote {path}")
