"""texclass benchmark: a dataset against every row of a table."""

from pathlib import Path
from typing import Annotated, Any

import typer

from texclass.cli.app import app
from texclass.cli.options import (
    Backend,
    BackendOption,
    DatasetArgument,
    FsOption,
    JobsOption,
    Protocol,
    SchedulerOption,
    SkipBadOption,
    TouchesOption,
    TouchOption,
    UnitOption,
    console,
    cut_touches,
    open_recordings,
    progress_bar,
    shipped,
    write_json,
)
from texclass.cli.peer_options import (
    PeersLimitOption,
    PeersOnlyOption,
    PeersOption,
    PeersPythonOption,
    PeersSecondsOption,
    PeersSignalsOption,
    limited,
    peer_settings,
    run_peers,
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
    feature: Annotated[
        str | None,
        typer.Option(
            help="A feature of yours to put against the table: module:function or file.py:function."
        ),
    ] = None,
    touch: TouchOption = None,
    touches: TouchesOption = None,
    folds: Annotated[int | None, typer.Option(help="Number of folds; the pipeline's own by default.")] = None,
    choose: Annotated[
        bool,
        typer.Option(
            "--choose", help="Also choose row and classifier inside each training part, unseen by tests."
        ),
    ] = False,
    peers: PeersOption = False,
    peers_python: PeersPythonOption = None,
    peers_only: PeersOnlyOption = None,
    peers_limit: PeersLimitOption = None,
    peers_seconds: PeersSecondsOption = 900.0,
    peers_signals: PeersSignalsOption = "same",
    fs: FsOption = None,
    unit: UnitOption = None,
    jobs: JobsOption = -1,
    backend: BackendOption = Backend.LOCAL,
    scheduler: SchedulerOption = None,
    skip_bad: SkipBadOption = False,
    out: Annotated[
        Path, typer.Option(help="Folder for the table (Markdown, PNG), the confusion matrix and the JSON.")
    ] = Path("reports"),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the result as JSON here.")] = None,
) -> None:
    """Classify a dataset with every row of a pipeline's table, beside the published figures."""
    from texclass.experiment import load_pipeline, run_benchmark, running_on, study_feature
    from texclass.features import load_feature
    from texclass.reporting import benchmark_table, feature_card, write_feature_report, write_report

    if peers and feature:
        raise ValueError("--peers and --feature are given; the rule is one of them at a time")
    settings = peer_settings(peers_python, peers_only, peers_seconds, peers_signals) if peers else None
    definition = load_pipeline(pipeline)
    new = load_feature(feature) if feature else None
    recordings = limited(open_recordings(dataset, fs, unit, skip_bad), peers_limit if peers else None)
    asked: dict[str, Any] = {
        "protocol": protocol.value if protocol else None,
        "n_folds": folds,
        "choose": choose,
        "n_jobs": jobs,
        "skip_bad": skip_bad,
    }
    with running_on(backend.value, scheduler), progress_bar() as progress:
        recordings = cut_touches(recordings, touch, touches, jobs, progress)
        study = new and study_feature(recordings, definition, new, **asked, progress=progress)
        result = study.result if study else run_benchmark(recordings, definition, **asked, progress=progress)
    console().print(benchmark_table(result))
    if study:
        console().print("", feature_card(study))
    write_json(json_file, (study or result).to_json())
    for path in write_feature_report(study, out) if study else write_report(result, out):
        typer.echo(f"wrote {path}")
    if settings is not None:
        run_peers(
            recordings, definition, result, settings, out, n_folds=folds, n_jobs=jobs, skip_bad=skip_bad
        )
