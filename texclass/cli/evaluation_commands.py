"""What a researcher asks for: benchmark, extract, tradeoff, stability, report."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from texclass.atomic_write import path_ending
from texclass.cli import options
from texclass.cli.app import command
from texclass.cli.options import progress_bar, tell_and_save, wrote

if TYPE_CHECKING:
    from texclass.baselines import BaselineSettings


@options.shared("baselines")
def compares_baselines(
    *,
    baselines: bool = False,
    baselines_python: Path | None = None,
    baselines_only: str | None = None,
    baselines_limit: int | None = None,
    baselines_seconds: float = 900.0,
    baselines_signals: str = "same",
) -> "tuple[BaselineSettings, int | None] | None":
    """Give a command how baselines are compared, and on how many recordings at most; None where they are not.

    Parameters
    ----------
    baselines
        Run librosa MFCC, TSFEL, tsfresh, catch22, QUANT and the rockets on the same folds, too.
    baselines_python
        The interpreter that has the baselines and scikit-learn; this one by default (extra `baselines`).
    baselines_only
        Only these baselines, separated by commas: mfcc,minirocket.
    baselines_limit
        At most so many recordings: materials are left out whole, for ours as well.
    baselines_seconds
        Time limit for each baseline, in seconds; the folds it finished count.
    baselines_signals
        What baselines are given: the `same` signals as our features, or `each` channel by itself.
    """
    if not baselines:
        return None
    from texclass.baselines import BaselineSettings

    given: dict[str, Any] = {"time_limit_s": baselines_seconds, "signals": baselines_signals}
    if baselines_python is not None:
        # Not resolved: the interpreter of a virtual environment is a link.
        given["python"] = baselines_python.expanduser().absolute()
    if baselines_only is not None:
        given["names"] = tuple(name.strip() for name in baselines_only.split(","))
    return BaselineSettings(**given), baselines_limit


@command("texclass benchmark recordings --fs 10000 --unit m/s^2 --jobs 1")
@compares_baselines
@options.reads_files
@options.holds_out
def benchmark(
    dataset: options.Recordings = "simulated",
    pipeline: Annotated[str, typer.Option(autocompletion=options.shipped("pipelines"))] = "strese2015",
    feature: str | None = None,
    touch: float | None = None,
    touches: int | None = None,
    folds: Annotated[int | None, typer.Option(min=2)] = None,
    choose: bool = False,
    jobs: options.Jobs = -1,
    backend: options.RunOn = "local",
    scheduler: options.Scheduler = None,
    labels: options.Labels = None,
    skip_bad: options.SkipBad = False,
    output: Annotated[Path, options.WRITES_FOLDER] = Path("reports"),
    confusion: Annotated[Path | None, options.writes(".csv", "")] = None,
    json_file: options.Json = None,
    *,
    protocol: str | None,
    reading: dict[str, Any],
    baselines: "tuple[BaselineSettings, int | None] | None",
) -> None:
    """Classify a dataset with every row of a pipeline's table. Published figures stand beside ours.

    Parameters
    ----------
    pipeline
        A shipped pipeline, or a TOML of yours.
    feature
        A feature of yours to put against the table: module:function or file.py:function.
    touch
        Classify single windows of so many seconds of movement, not recordings.
    touches
        At most so many windows of each recording, the first; all by default.
    folds
        Number of folds; the pipeline's own by default.
    choose
        Also choose row and classifier inside each training part, unseen by tests.
    output : -o, --output
        Folder for the table (Markdown), the pictures (PNG), the confusion matrix (CSV) and the JSON.
    confusion
        Another file for the confusion matrix of the best row (CSV).
    """
    from texclass.loaders import open_dataset

    if confusion and feature:
        raise ValueError("--confusion and --feature exclude each other: a feature study has no matrix")
    if baselines and feature:
        raise ValueError("--baselines and --feature are given; the rule is one of them at a time")
    if touches is not None and touch is None:
        raise ValueError(f"--touches is {touches}, but there is no --touch; the rule is both")
    recordings = open_dataset(dataset, **reading, labels=labels, skip_bad=skip_bad)
    from texclass.evaluation.workers import begin_loading

    if backend == "local":
        begin_loading(jobs)
    from texclass.evaluation import BenchmarkResult, load_pipeline, run_benchmark, running_on, study_feature
    from texclass.evaluation import touches as cut_touches
    from texclass.features import load_feature

    definition = load_pipeline(pipeline)
    new = load_feature(feature) if feature else None
    if baselines:
        from texclass.baselines import compare_with_baselines, whole_materials

        settings, most = baselines
        recordings = recordings if most is None else whole_materials(recordings, most)
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
    if confusion is not None and isinstance(result, BenchmarkResult):
        wrote([result.save_confusion(confusion)])
    if baselines:
        with progress_bar() as progress:
            compared = compare_with_baselines(
                recordings, definition, result, settings, **work, progress=progress
            )
        tell_and_save(compared, output)


@command("texclass extract recordings --fs 10000 --unit m/s^2 -o features.parquet")
@options.reads_files
def extract(
    dataset: options.Recordings,
    output: Path,
    features: options.FeatureSet = "texclass",
    partition: int | None = None,
    jobs: options.Jobs = -1,
    backend: options.RunOn = "local",
    scheduler: options.Scheduler = None,
    labels: options.Labels = None,
    skip_bad: options.SkipBad = False,
    *,
    reading: dict[str, Any],
) -> None:
    """Compute a feature table. A run that was killed goes on where it stopped.

    Parameters
    ----------
    output : -o, --output
        Feature table to write (.parquet or .csv); with --partition a folder of Parquet files.
    partition
        Recordings of a file: each is computed and written by one worker, and no process holds them all.
    """
    if partition is None:
        path_ending(output, ".parquet", ".csv")
    else:
        options.check_folder(output)
    from texclass.loaders import open_dataset

    recordings = open_dataset(dataset, **reading, labels=labels, skip_bad=skip_bad)
    from texclass.evaluation import extract_partitions, extract_table, running_on
    from texclass.features import load_feature_set
    from texclass.reporting.wording import counted

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
    typer.echo(table.summary)
    for line in table.left_out:
        typer.echo(f"left out: {line}")
    for note in (*recordings.notes, *table.doubts):
        typer.echo(f"note: {note}")


@command("texclass tradeoff recordings --fs 10000 --unit m/s^2 --max-ms 5")
@options.reads_files
@options.holds_out
def tradeoff(
    dataset: options.Recordings = "simulated",
    features: options.FeatureSet = "texclass",
    max_ms: options.MaxMs = None,
    max_seconds: float | None = None,
    max_features: options.MaxFeatures = None,
    materials: str | None = None,
    curves: bool = True,
    jobs: options.Jobs = -1,
    backend: options.RunOn = "local",
    scheduler: options.Scheduler = None,
    output: Annotated[Path, options.WRITES_FOLDER] = Path("reports"),
    json_file: options.Json = None,
    labels: options.Labels = None,
    *,
    protocol: str | None,
    reading: dict[str, Any],
) -> None:
    """Measure what accuracy costs on a dataset. The pipeline at the budget, or at the knee, is saved.

    Parameters
    ----------
    max_seconds
        Seconds of movement that are felt; whole recordings by default.
    materials
        Materials of a scene, separated by commas: the fewest columns for these.
    curves
        Also accuracy against touch, training, rate, bits and model order.
    output : -o, --output
        Folder for the report (Markdown, JSON, PNG) and the pipeline (skops).
    """
    from texclass.evaluation import running_on
    from texclass.features import load_feature_set
    from texclass.loaders import open_dataset
    from texclass.tradeoff import Limits, trade_off
    from texclass.tradeoff.trading import tradeoff_stem

    recordings = open_dataset(dataset, **reading, labels=labels, skip_bad=True)
    scene = tuple(name.strip() for name in (materials or "").split(",") if name.strip())
    stem = tradeoff_stem({"name": recordings.name, "materials": scene, "max_seconds": max_seconds})
    with running_on(backend, scheduler), progress_bar() as progress:
        result = trade_off(
            recordings,
            load_feature_set(features),
            Limits(max_ms, max_seconds, max_features, scene),
            protocol=protocol or "recording",
            with_curves=curves,
            model_file=output / f"{stem}.skops",
            n_jobs=jobs,
            progress=progress,
        )
    tell_and_save(result, output, json_file, Path(result.data["chosen"]["file"]))


@command("texclass stability --quick")
def stability(
    quick: bool = False,
    only: Literal["models", "filters", "transforms", "features", "baselines"] | None = None,
    output: Annotated[Path, options.WRITES_FOLDER] = Path("reports"),
    json_file: options.Json = None,
) -> None:
    """Try hard inputs on every model, filter and feature.

    Public libraries that are installed here answer the same inputs. Exit code 1 if any of ours is wrong.

    Parameters
    ----------
    quick
        A small part of the battery, in half a minute.
    only
        One part alone.
    output : -o, --output
        Folder for stability.md, .json and pictures.
    """
    from texclass.baselines import extreme_inputs
    from texclass.stability import run_stability

    baselines, left_out = extreme_inputs.installed(quick)
    with progress_bar() as progress:
        result = run_stability(
            quick=quick, only=only, baselines=baselines, left_out=left_out, progress=progress
        )
    tell_and_save(result, output, json_file)
    for cell in result.data["ours_wrong"]:
        typer.echo(f"{cell['mark']}: {cell['subject']}, {cell['case']} ({cell['family']}): {cell['reason']}")
    typer.echo(f"texclass: {len(result.wrong)} of {len(result.ours)} cells wrong")
    if len(result.wrong):
        raise typer.Exit(1)


@command("texclass report reports/*.json -o report.html")
def report(
    results: list[Path],
    output: Annotated[Path, options.writes(".html", ".htm", ".md")] = Path("report.html"),
    title: str = "",
    stale: bool = False,
) -> None:
    """Write results as one page that needs no network. It holds tables, figures, datasets and versions.

    Parameters
    ----------
    results
        JSON files that benchmark, tradeoff, stability or the study of invariance wrote.
    output : -o, --output
        Page to write: HTML (.html) or Markdown (.md).
    title
        Its title; the datasets' names by default.
    stale
        List results whose code, pipeline or features have changed, and skipped files; write no page.
    """
    from texclass.cli.result_files import stale_results, write_page

    if stale:
        found, skipped = stale_results(results)
        for path, why in found.items():
            typer.echo(f"{path}: {why}")
        for path, why in skipped.items():
            typer.echo(f"skipped {path}: {why}")
        typer.echo(f"{len(found)} of {len(results) - len(skipped)} results are to be made again")
        return
    typer.echo(f"wrote {write_page(results, output, title)}")
