"""Commands to evaluate features and pipelines: features, extract, benchmark, tradeoff, stability, report."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer import Argument, Option

from texclass.atomic_write import check_suffix
from texclass.cli import parameters as p
from texclass.cli.app import app
from texclass.cli.mlflow_run import require_mlflow
from texclass.cli.output import (
    RECORDING_KERNELS,
    announce_start,
    print_and_save,
    print_lines,
    progress_bar,
    write_json,
)

if TYPE_CHECKING:
    from texclass.baselines import BaselineSettings


@app.command(rich_help_panel="Evaluation", epilog="Example: texclass features strese2015 --phase tap")
def features(
    name: Annotated[
        str | None,
        Argument(
            help="Shipped feature set or feature set file (TOML) (default: all features).",
            autocompletion=p.shipped_names("feature_defs"),
        ),
    ] = None,
    feature_set: Annotated[
        list[str] | None,
        Option(
            "--set",
            metavar="NAME",
            help="List the features of this set, too (repeatable).",
            autocompletion=p.shipped_names("feature_defs"),
        ),
    ] = None,
    phase: Annotated[
        Literal["tap", "movement", "travel", "friction", "pair"] | None,
        Option(help="List only features that are computed from this phase (default: all)."),
    ] = None,
) -> None:
    """List all features, or the features of sets, with unit and reference."""
    from texclass.cli.listings import features_document
    from texclass.reporting import print_document

    print_document(features_document([*([name] if name else []), *(feature_set or [])], phase))


@app.command(
    rich_help_panel="Evaluation",
    epilog="Example: texclass extract recordings --fs 10000 --unit m/s^2 -o features.csv",
)
@p.with_reader_options
def extract(
    dataset: p.Dataset,
    *,
    features: p.FeatureSet = "texclass",
    reader: p.Reader,
    labels: p.Labels = None,
    tap_spacing: p.TapSpacing = None,
    skip_bad: p.SkipBad = False,
    jobs: p.Jobs = -1,
    backend: p.Backend = "local",
    scheduler: p.Scheduler = None,
    output: Annotated[
        Path,
        p.output_option(
            "--output",
            "-o",
            metavar="FILE",
            help="Feature table to write (.csv or .parquet); with --partition a folder of files.",
        ),
    ],
    partition: Annotated[
        int | None,
        p.output_option(
            min=1,
            metavar="N",
            help="Write one file per N recordings, for tables that do not fit into memory.",
        ),
    ] = None,
    partition_format: Annotated[
        Literal["csv", "parquet"] | None,
        p.output_option(help="Format of the files of --partition (default: csv)."),
    ] = None,
) -> None:
    """Compute a feature table. An interrupted run resumes where it stopped."""
    p.check_scheduler(backend, scheduler)
    suffix: Literal[".csv", ".parquet"] = ".parquet" if partition_format == "parquet" else ".csv"
    if partition is not None:
        p.check_folder(output)
        check_suffix(output / f"part{suffix}", ".csv", ".parquet")
    elif partition_format is not None:
        raise typer.BadParameter("--partition-format requires --partition")
    else:
        check_suffix(output, ".csv", ".parquet")
    announce_start(*RECORDING_KERNELS)
    from texclass.loaders import open_dataset

    recordings = open_dataset(dataset, **reader, labels=labels, tap_spacing=tap_spacing, skip_bad=skip_bad)
    from texclass.evaluation.workers import begin_loading

    if backend == "local":
        begin_loading(jobs, "texclass.evaluation.checkpoints")
    from texclass.evaluation import extract_partitions, extract_table, use_backend
    from texclass.features import load_feature_set
    from texclass.reporting.wording import counted

    feature_set = load_feature_set(features)
    with use_backend(backend, scheduler), progress_bar() as progress:
        work: dict[str, Any] = {"n_jobs": jobs, "skip_bad": skip_bad, "progress": progress}
        if partition is not None:
            parts = extract_partitions(
                recordings,
                feature_set,
                output,
                partition,
                suffix=suffix,
                **work,
            )
            for name, _, left_out, notes in parts.itertuples():
                print_lines(f"{name}: left out:", left_out)
                print_lines(f"{name}: note:", notes)
            n_recordings = int(parts["recordings"].sum())
            typer.echo(
                f"wrote {output}: {counted(n_recordings, 'recording')} in {counted(len(parts), 'file')}"
            )
            print_lines("note:", recordings.notes)
            return
        table = extract_table(recordings, feature_set, output, **work)
    typer.echo(
        f"wrote {output}: {counted(table.n_recordings, 'recording')}, {counted(table.n_columns, 'column')}"
    )
    typer.echo(table.summary)
    print_lines("left out:", table.left_out)
    print_lines("note:", (*recordings.notes, *table.notices))


@app.command(
    rich_help_panel="Evaluation",
    epilog="Example: texclass benchmark recordings --fs 10000 --unit m/s^2 --jobs 1",
)
@p.with_reader_options
def benchmark(
    dataset: p.Dataset = "simulated",
    pipeline: Annotated[
        str | None,
        Option(
            metavar="NAME",
            help="Shipped pipeline or pipeline file (TOML). Default: the published table (strese2015), and "
            "the default pipeline of `texclass train` (surfaces) on the same folds.",
            autocompletion=p.shipped_names("pipelines"),
        ),
    ] = None,
    feature: Annotated[
        str | None,
        Option(
            metavar="FUNCTION",
            help="Your own feature, compared with the table: module:function or file.py:function.",
        ),
    ] = None,
    window: Annotated[
        float | None, Option(metavar="S", help="Classify windows of this length instead of whole recordings.")
    ] = None,
    max_windows: Annotated[
        int | None,
        Option(min=1, metavar="N", help="Use the first N windows of each recording (default: all)."),
    ] = None,
    *,
    reader: p.Reader,
    labels: p.Labels = None,
    tap_spacing: p.TapSpacing = None,
    skip_bad: p.SkipBad = False,
    axes: p.Axes = "auto",
    protocol: p.Protocol = None,
    shots: p.Shots = None,
    train: p.TrainingSet = None,
    test: p.TestSet = None,
    leave_out: p.LeaveOut = None,
    folds: Annotated[
        int | None,
        p.evaluation_option(min=2, metavar="N", help="Number of folds (default: as in the pipeline)."),
    ] = None,
    nested_cv: Annotated[
        bool | None,
        p.evaluation_option(
            "--nested-cv/--no-nested-cv",
            help="Nested cross-validation: select feature subset and classifier in each training set "
            "(default: where possible).",
        ),
    ] = None,
    baselines: Annotated[
        bool,
        p.baseline_option(
            "--baselines",
            help="Compare with MFCC, TSFEL, tsfresh, catch22, QUANT and ROCKET on the same folds.",
        ),
    ] = False,
    baseline: Annotated[
        list[str] | None,
        p.baseline_option(metavar="NAME", help="Compare only with this baseline, e.g. mfcc (repeatable)."),
    ] = None,
    baselines_python: Annotated[
        Path | None,
        p.baseline_option(
            metavar="FILE", help="Python interpreter with the baselines installed (default: this one)."
        ),
    ] = None,
    baselines_limit: Annotated[
        int | None,
        p.baseline_option(
            metavar="N",
            help="Use at most N recordings, also for texclass; each surface is used completely or "
            "not at all.",
        ),
    ] = None,
    baselines_timeout: Annotated[
        float,
        p.baseline_option(
            metavar="S", help="Time limit per baseline; only folds that finish in time are used."
        ),
    ] = 900.0,
    baselines_signals: Annotated[
        Literal["same", "each"],
        p.baseline_option(
            help="Input of the baselines: the same signals as texclass, or each channel separately."
        ),
    ] = "same",
    jobs: p.Jobs = -1,
    backend: p.Backend = "local",
    scheduler: p.Scheduler = None,
    output: p.OutputFolder = Path("reports"),
    confusion: Annotated[
        Path | None,
        p.output_file(
            "--confusion", suffixes=[".csv", ""], help="Also write the best row's confusion matrix (CSV)."
        ),
    ] = None,
    json_file: p.JsonFile = None,
    mlflow: Annotated[
        bool,
        p.output_option(
            "--mlflow",
            callback=require_mlflow,
            help="Also log parameters, accuracies, hashes and report as a run of MLflow (pip install mlflow) "
            "at $MLFLOW_TRACKING_URI.",
        ),
    ] = False,
) -> None:
    """Evaluate every feature subset and classifier of a pipeline on a dataset.

    The report opens with the accuracy of nested cross-validation. Its table contains accuracies with 95 %
    confidence intervals, the chance level, and published accuracies if the pipeline contains any.
    """
    if confusion and feature:
        raise typer.BadParameter(
            "--confusion cannot be combined with --feature, which computes no confusion matrix"
        )
    if baselines and feature:
        raise typer.BadParameter("use only one of --baselines and --feature")
    if baseline and not baselines:
        raise typer.BadParameter("--baseline requires --baselines")
    if max_windows is not None and window is None:
        raise typer.BadParameter("--max-windows requires --window")
    p.check_scheduler(backend, scheduler)
    chosen_protocol = p.protocol_name(protocol, shots, train, test, leave_out)
    announce_start(*RECORDING_KERNELS)
    from texclass.loaders import open_dataset

    recordings = open_dataset(dataset, **reader, labels=labels, tap_spacing=tap_spacing, skip_bad=skip_bad)
    from texclass.evaluation.workers import begin_loading

    if backend == "local":
        begin_loading(jobs, "texclass.evaluation.checkpoints", "texclass.evaluation.benchmark")
    from texclass.evaluation import (
        BenchmarkResult,
        cut_windows,
        load_pipeline,
        run_benchmark,
        study_feature,
        use_backend,
    )
    from texclass.features import load_feature

    definition = load_pipeline(pipeline or "strese2015")
    recordings = recordings.with_phase_settings(definition.phase_settings.changes, override=False)
    new_feature = load_feature(feature) if feature else None
    if baselines:
        from texclass.baselines import compare_with_baselines, whole_surfaces

        settings = _baseline_settings(baseline, baselines_python, baselines_timeout, baselines_signals)
        if baselines_limit is not None:
            recordings = whole_surfaces(recordings, baselines_limit)
    work: dict[str, Any] = {"n_folds": folds, "n_jobs": jobs, "skip_bad": skip_bad}
    how: dict[str, Any] = {"protocol": chosen_protocol, "nested_cv": nested_cv, "axes": axes, **work}
    with use_backend(backend, scheduler), progress_bar() as progress:
        if window is not None:
            recordings = cut_windows(
                recordings, window, per_recording=max_windows, n_jobs=jobs, progress=progress
            )
        if new_feature is None:
            result = run_benchmark(recordings, pipeline and definition, **how, progress=progress)
        else:
            result = study_feature(recordings, definition, new_feature, **how, progress=progress)
    print_and_save(result, output, json_file, mlflow=mlflow)
    if confusion is not None and isinstance(result, BenchmarkResult):
        print_lines("wrote", [result.save_confusion(confusion)])
    if baselines:
        with progress_bar() as progress:
            comparison = compare_with_baselines(
                recordings, definition, result, settings, **work, progress=progress
            )
        print_and_save(comparison, output, mlflow=mlflow)


def _baseline_settings(
    names: list[str] | None, python: Path | None, timeout_s: float, signals: Literal["same", "each"]
) -> "BaselineSettings":
    from texclass.baselines import BaselineSettings

    settings = BaselineSettings(time_limit_s=timeout_s, signals=signals)
    if names:
        settings = replace(settings, names=tuple(names))
    if python is not None:
        # The path is not resolved, since the interpreter of a virtual environment is a symbolic link.
        settings = replace(settings, python=python.expanduser().absolute())
    return settings


@app.command(
    rich_help_panel="Evaluation",
    epilog="Example: texclass tradeoff recordings --fs 10000 --unit m/s^2 --max-ms 5",
)
@p.with_reader_options
def tradeoff(
    dataset: p.Dataset = "simulated",
    features: p.FeatureSet = "texclass",
    max_ms: p.MaxMs = None,
    max_seconds: Annotated[
        float | None,
        Option(metavar="S", help="Budget of movement per recording in s (default: whole recordings)."),
    ] = None,
    max_features: p.MaxFeatures = None,
    surfaces: Annotated[
        str | None,
        Option(
            metavar="NAMES",
            help="Only these surfaces, e.g. oak,felt; also list the smallest subsets for them.",
        ),
    ] = None,
    curves: Annotated[
        bool,
        Option(
            help="Also measure accuracy against signal length, training set size, rate, bits and model order."
        ),
    ] = True,
    *,
    reader: p.Reader,
    labels: p.Labels = None,
    tap_spacing: p.TapSpacing = None,
    protocol: p.Protocol = None,
    shots: p.Shots = None,
    train: p.TrainingSet = None,
    test: p.TestSet = None,
    leave_out: p.LeaveOut = None,
    jobs: p.Jobs = -1,
    backend: p.Backend = "local",
    scheduler: p.Scheduler = None,
    output: Annotated[
        Path,
        p.output_folder(
            "--output",
            "-o",
            help="Folder for the report (Markdown), JSON, figures (PNG) and model (.skops).",
        ),
    ] = Path("reports"),
    json_file: p.JsonFile = None,
) -> None:
    """Measure accuracy against cost, and save a model.

    The saved model is the best within the budgets, or the knee point of the Pareto front without budgets.
    """
    p.check_scheduler(backend, scheduler)
    chosen_protocol = p.protocol_name(protocol, shots, train, test, leave_out)
    from texclass.evaluation import use_backend
    from texclass.features import load_feature_set

    announce_start(*RECORDING_KERNELS)
    from texclass.loaders import open_dataset
    from texclass.tradeoff import Limits, trade_off
    from texclass.tradeoff.study import tradeoff_stem

    recordings = open_dataset(dataset, **reader, labels=labels, tap_spacing=tap_spacing, skip_bad=True)
    scene = tuple(name.strip() for name in (surfaces or "").split(",") if name.strip())
    stem = tradeoff_stem({"name": recordings.name, "surfaces": scene, "max_seconds": max_seconds})
    with use_backend(backend, scheduler), progress_bar() as progress:
        result = trade_off(
            recordings,
            load_feature_set(features),
            Limits(max_ms, max_seconds, max_features, scene),
            protocol=chosen_protocol or "recording",
            with_curves=curves,
            model_file=output / f"{stem}.skops",
            n_jobs=jobs,
            progress=progress,
        )
    print_and_save(result, output, json_file, written=[Path(result.data["selection"]["file"])])


@app.command(rich_help_panel="Evaluation", epilog="Example: texclass stability --quick")
def stability(
    quick: Annotated[
        bool, Option("--quick", help="Run a small part of the tests, for about half a minute.")
    ] = False,
    only: Annotated[
        Literal["models", "filters", "transforms", "features", "baselines"] | None,
        Option(
            metavar="GROUP", help="Test only this group: models, filters, transforms, features or baselines."
        ),
    ] = None,
    output: p.OutputFolder = Path("reports"),
    json_file: p.JsonFile = None,
) -> None:
    """Test every model, filter and feature on extreme inputs.

    Installed baseline libraries are tested with the same inputs. The exit code is 1 if a result of texclass
    is wrong.
    """
    from texclass.baselines import extreme_inputs
    from texclass.stability import run_stability

    baselines, skipped = extreme_inputs.installed(quick)
    with progress_bar() as progress:
        result = run_stability(
            quick=quick, only=only, baselines=baselines, skipped=skipped, progress=progress
        )
    print_and_save(result, output, json_file)
    for cell in result.data["failures"]:
        typer.echo(f"{cell['mark']}: {cell['subject']}, {cell['case']} ({cell['family']}): {cell['reason']}")
    typer.echo(f"texclass: {len(result.failures)} of {len(result.ours)} results wrong")
    if len(result.failures):
        raise typer.Exit(1)


@app.command(rich_help_panel="Evaluation", epilog="Example: texclass report reports/*.json -o report.html")
def report(
    results: Annotated[
        list[Path],
        Argument(help="JSON files written by benchmark, tradeoff, stability or the invariance study."),
    ],
    title: Annotated[
        str, Option(metavar="TEXT", help="Title of the page (default: the names of the datasets).")
    ] = "",
    stale: Annotated[
        bool,
        Option(
            "--stale",
            help="Write no page; list results that are out of date because their code or definitions "
            "changed.",
        ),
    ] = False,
    compare: Annotated[
        bool,
        Option(
            "--compare",
            help="Print what changed from the first of two results to the second, on the same folds.",
        ),
    ] = False,
    output: Annotated[
        Path | None,
        p.output_file(
            "--output",
            "-o",
            suffixes=[".html", ".htm", ".md"],
            help="Page to write, .html or .md (default: report.html; with --compare: none).",
        ),
    ] = None,
    json_file: p.JsonFile = None,
) -> None:
    """Write one self-contained page with the tables, figures, datasets and versions of results."""
    if json_file and not compare:
        raise typer.BadParameter("--json requires --compare: results are JSON files already")
    if compare and (stale or len(results) != 2):
        raise typer.BadParameter(f"--compare requires two results and no --stale, got {len(results)} results")
    from texclass.cli.result_files import compare_files, stale_results, write_document_page, write_page

    if compare:
        from texclass.reporting import print_document

        comparison = compare_files(*results)
        print_document(comparison.document())
        write_json(json_file, comparison.to_json())
        if output is not None:
            typer.echo(f"wrote {write_document_page(comparison.document(), output, title)}")
        return
    if stale:
        reasons, skipped = stale_results(results)
        for path, reason in reasons.items():
            typer.echo(f"{path}: {reason}")
        print_lines("skipped", (f"{path}: {reason}" for path, reason in skipped.items()))
        typer.echo(f"{len(reasons)} of {len(results) - len(skipped)} results are out of date")
        return
    typer.echo(f"wrote {write_page(results, output or Path('report.html'), title)}")
