"""What a researcher asks for: benchmark, extract, tradeoff, stability, report."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from texclass.cli import options
from texclass.cli.app import app
from texclass.cli.options import progress_bar, tell_and_save


@app.command(epilog="Example: texclass benchmark recordings --fs 10000 --unit m/s^2 --jobs 1")
@options.reads_files
@options.holds_out
def benchmark(
    dataset: options.Recordings = "simulated",
    pipeline: options.Pipeline = "strese2015",
    feature: Annotated[
        str | None,
        typer.Option(
            help="A feature of yours to put against the table: module:function or file.py:function."
        ),
    ] = None,
    touch: Annotated[
        float | None,
        typer.Option(help="Classify single windows of so many seconds of movement, not recordings."),
    ] = None,
    touches: Annotated[
        int | None, typer.Option(help="At most so many windows of each recording, the first; all by default.")
    ] = None,
    folds: Annotated[
        int | None, typer.Option(min=2, help="Number of folds; the pipeline's own by default.")
    ] = None,
    choose: Annotated[
        bool,
        typer.Option(
            "--choose", help="Also choose row and classifier inside each training part, unseen by tests."
        ),
    ] = False,
    peers: Annotated[
        bool,
        typer.Option(
            "--peers",
            help="Run librosa MFCC, TSFEL, tsfresh, catch22, QUANT and the rockets on the same folds, too.",
        ),
    ] = False,
    peers_python: Annotated[
        Path | None,
        typer.Option(
            help="The interpreter that has the peers and scikit-learn; this one by default (extra `peers`)."
        ),
    ] = None,
    peers_only: Annotated[
        str | None, typer.Option(help="Only these peers, separated by commas: mfcc,minirocket.")
    ] = None,
    peers_limit: Annotated[
        int | None,
        typer.Option(help="At most so many recordings: materials are left out whole, for ours as well."),
    ] = None,
    peers_seconds: Annotated[
        float, typer.Option(help="Time limit for each peer, in seconds; the folds it finished count.")
    ] = 900.0,
    peers_signals: Annotated[
        str,
        typer.Option(
            help="What peers are given: the `same` signals as our features, or `each` channel by itself."
        ),
    ] = "same",
    jobs: options.Jobs = -1,
    backend: options.RunOn = "local",
    scheduler: options.Scheduler = None,
    skip_bad: options.SkipBad = False,
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", help="Folder for the table (Markdown), the pictures (PNG) and the JSON."
        ),
    ] = Path("reports"),
    json_file: options.Json = None,
    *,
    protocol: str | None,
    reading: dict[str, Any],
) -> None:
    """Classify a dataset with every row of a pipeline's table. Published figures stand beside ours."""
    from texclass.loaders import open_dataset

    if peers and feature:
        raise ValueError("--peers and --feature are given; the rule is one of them at a time")
    if touches is not None and touch is None:
        raise ValueError(f"--touches is {touches}, but there is no --touch; the rule is both")
    recordings = open_dataset(dataset, **reading, skip_bad=skip_bad)
    from texclass.experiment.workers import begin_loading

    if backend == "local":
        begin_loading(jobs)
    from texclass.experiment import load_pipeline, run_benchmark, running_on, study_feature
    from texclass.experiment import touches as cut_touches
    from texclass.features import load_feature

    if peers:
        from texclass.peers import PeerSettings, compare_with_peers, whole_materials

        given: dict[str, Any] = {"time_limit_s": peers_seconds, "signals": peers_signals}
        if peers_python is not None:
            # Not resolved: the interpreter of a virtual environment is a link.
            given["python"] = peers_python.expanduser().absolute()
        if peers_only is not None:
            given["names"] = tuple(name.strip() for name in peers_only.split(","))
        settings = PeerSettings(**given)
    definition = load_pipeline(pipeline)
    new = load_feature(feature) if feature else None
    if peers and peers_limit is not None:
        recordings = whole_materials(recordings, peers_limit)
    work: dict[str, Any] = {"n_folds": folds, "n_jobs": jobs, "skip_bad": skip_bad}
    asked = {"protocol": protocol, "choose": choose, **work}
    with running_on(backend, scheduler), progress_bar() as progress:
        if touch is not None:
            recordings = cut_touches(recordings, touch, per_recording=touches, n_jobs=jobs, progress=progress)
        if new is None:
            result = run_benchmark(recordings, definition, **asked, progress=progress)
        else:
            result = study_feature(recordings, definition, new, **asked, progress=progress)
    tell_and_save(result, output, json_file)
    if peers:
        with progress_bar() as progress:
            compared = compare_with_peers(recordings, definition, result, settings, **work, progress=progress)
        tell_and_save(compared, output)


@app.command(epilog="Example: texclass extract recordings --fs 10000 --unit m/s^2 -o features.parquet")
@options.reads_files
def extract(
    dataset: options.Recordings,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Parquet file to write, with --partition a folder of them.")
    ],
    features: options.FeatureSet = "texclass",
    partition: Annotated[
        int | None,
        typer.Option(
            help="Recordings of a file: each is computed and written by one worker, and no process holds "
            "them all."
        ),
    ] = None,
    jobs: options.Jobs = -1,
    backend: options.RunOn = "local",
    scheduler: options.Scheduler = None,
    skip_bad: options.SkipBad = False,
    *,
    reading: dict[str, Any],
) -> None:
    """Compute a feature table. A run that was killed goes on where it stopped."""
    from texclass.loaders import open_dataset

    recordings = open_dataset(dataset, **reading, skip_bad=skip_bad)
    from texclass.document.wording import counted
    from texclass.experiment import extract_partitions, extract_table, running_on
    from texclass.features import load_feature_set

    feature_set = load_feature_set(features)
    with running_on(backend, scheduler), progress_bar() as progress:
        work: dict[str, Any] = {"n_jobs": jobs, "skip_bad": skip_bad, "progress": progress}
        if partition is not None:
            parts = extract_partitions(recordings, feature_set, output, partition, **work)
            for name, _, left_out, doubts in parts.itertuples():
                for said in (*(f"left out: {bad}" for bad in left_out), *(f"note: {one}" for one in doubts)):
                    typer.echo(f"{name}: {said}")
            counts = counted(int(parts["recordings"].sum()), "recording"), counted(len(parts), "file")
            typer.echo(f"wrote {output}: {counts[0]} in {counts[1]}")
            for note in recordings.notes:
                typer.echo(f"note: {note}")
            return
        table = extract_table(recordings, feature_set, output, **work)
    typer.echo(
        f"wrote {output}: {counted(table.n_recordings, 'recording')}, {counted(table.n_columns, 'column')}"
    )
    for line in table.left_out:
        typer.echo(f"left out: {line}")
    for note in (*recordings.notes, *table.doubts):
        typer.echo(f"note: {note}")


@app.command(epilog="Example: texclass tradeoff recordings --fs 10000 --unit m/s^2 --max-ms 5")
@options.reads_files
@options.holds_out
def tradeoff(
    dataset: options.Recordings = "simulated",
    features: options.FeatureSet = "texclass",
    max_ms: options.MaxMs = None,
    max_seconds: Annotated[
        float | None, typer.Option(help="Seconds of movement that are felt; whole recordings by default.")
    ] = None,
    max_features: options.MaxFeatures = None,
    materials: Annotated[
        str | None,
        typer.Option(help="Materials of a scene, separated by commas: the fewest columns for these."),
    ] = None,
    curves: Annotated[
        bool, typer.Option(help="Also accuracy against touch, training, rate, bits and model order.")
    ] = True,
    whom: Annotated[
        Literal["embedded"] | None,
        typer.Option("--for", help="For a small computer: bytes, operations, rate, window and word length."),
    ] = None,
    max_bytes: Annotated[
        float | None,
        typer.Option(help="With --for embedded: for samples, constants and what is computed of them."),
    ] = None,
    max_ops: Annotated[
        float | None, typer.Option(help="With --for embedded: operations a second of signal.")
    ] = None,
    jobs: options.Jobs = -1,
    backend: options.RunOn = "local",
    scheduler: options.Scheduler = None,
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", help="Folder for the report (Markdown, JSON, PNG) and the pipeline (skops)."
        ),
    ] = Path("reports"),
    json_file: options.Json = None,
    *,
    protocol: str | None,
    reading: dict[str, Any],
) -> None:
    """Measure what accuracy costs on a dataset. The pipeline at the budget, or at the knee, is saved."""
    small = {"--max-bytes": max_bytes, "--max-ops": max_ops}
    large = {"--max-ms": max_ms, "--max-features": max_features, "--materials": materials}
    for name, given in (small if whom is None else large).items():
        if given is not None:
            rule = f"with --for embedded: {', '.join(small)}; without: {', '.join(large)}"
            raise ValueError(f"{name} is {given}; the rule is {rule}")
    from texclass.loaders import open_dataset

    recordings = open_dataset(dataset, **reading, skip_bad=True)
    from texclass.experiment import running_on

    if whom is not None:
        from texclass.recognition import SmallLimits, embedded_tradeoff

        with running_on(backend, scheduler), progress_bar() as progress:
            fitting = embedded_tradeoff(
                recordings,
                features,
                SmallLimits(max_bytes, max_ops),
                protocol=protocol,
                max_seconds=max_seconds,
                n_jobs=jobs,
                progress=progress,
                model_file=output / f"{recordings.name}-embedded.skops",
            )
        tell_and_save(fitting, output, json_file, Path(fitting.data["chosen"]["file"]))
        return
    from texclass.features import load_feature_set
    from texclass.tradeoff import Limits, trade_off
    from texclass.tradeoff.trading import tradeoff_stem

    scene = tuple(name.strip() for name in (materials or "").split(",") if name.strip())
    facts = {"name": recordings.name, "materials": scene, "max_seconds": max_seconds}
    with running_on(backend, scheduler), progress_bar() as progress:
        result = trade_off(
            recordings,
            load_feature_set(features),
            Limits(max_ms, max_seconds, max_features, scene),
            protocol=protocol or "recording",
            with_curves=curves,
            n_jobs=jobs,
            progress=progress,
            model_file=output / f"{tradeoff_stem(facts)}.skops",
        )
    tell_and_save(result, output, json_file, Path(result.data["chosen"]["file"]))


@app.command(epilog="Example: texclass stability --quick")
def stability(
    quick: Annotated[
        bool, typer.Option("--quick", help="A small part of the battery, in half a minute.")
    ] = False,
    only: Annotated[
        Literal["models", "filters", "transforms", "features", "peers"] | None,
        typer.Option(help="One part alone."),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder for stability.md, .json and pictures.")
    ] = Path("reports"),
    json_file: options.Json = None,
) -> None:
    """Try hard inputs on every model, filter and feature.

    Public libraries that are installed here answer the same inputs. Exit code 1 if any of ours is wrong.
    """
    from texclass.peers import extreme_inputs
    from texclass.stability import run_stability

    peers, left_out = extreme_inputs.installed(quick)
    with progress_bar() as progress:
        result = run_stability(quick=quick, only=only, peers=peers, left_out=left_out, progress=progress)
    tell_and_save(result, output, json_file)
    for cell in result.data["ours_wrong"]:
        typer.echo(f"{cell['mark']}: {cell['subject']}, {cell['case']} ({cell['family']}): {cell['reason']}")
    typer.echo(f"texclass: {len(result.wrong)} of {len(result.ours)} cells wrong")
    if len(result.wrong):
        raise typer.Exit(1)


@app.command(epilog="Example: texclass report reports/*.json -o report.html")
def report(
    results: Annotated[
        list[Path],
        typer.Argument(
            help="JSON files that benchmark, tradeoff, stability or the study of invariance wrote."
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="HTML, or Markdown (.md).")] = Path(
        "report.html"
    ),
    title: Annotated[str, typer.Option(help="Its title; the datasets' names by default.")] = "",
    stale: Annotated[
        bool,
        typer.Option("--stale", help="List those whose code, pipeline or features have changed; no page."),
    ] = False,
) -> None:
    """Write results as one page that needs no network. It holds tables, figures, datasets and versions."""
    from texclass.reporting import stale_results, write_page

    if stale:
        found = stale_results(results)
        for path, why in found.items():
            typer.echo(f"{path}: {why}")
        typer.echo(f"{len(found)} of {len(results)} are to be made again")
        return
    typer.echo(f"wrote {write_page(results, output, title)}")
