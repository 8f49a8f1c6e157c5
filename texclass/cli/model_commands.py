"""Models: train, predict, adapt, model."""

from pathlib import Path
from typing import Annotated, Any

import typer

from texclass.cli import options
from texclass.cli.app import command, shown
from texclass.cli.options import progress_bar, shipped, tell, write_json


@command("texclass train recordings --fs 10000 --unit m/s^2 -o surfaces.skops")
@options.reads_files
@options.holds_out
def train(
    dataset: options.Recordings,
    output: Annotated[Path, options.writes(".skops")],
    pipeline: Annotated[str | None, typer.Option(autocompletion=shipped("pipelines"))] = None,
    row: str | None = None,
    classifier: str | None = None,
    max_ms: options.MaxMs = None,
    max_features: options.MaxFeatures = None,
    max_kb: float | None = None,
    touch: float | None = None,
    false_alarms: float = 0.05,
    exportable: bool = False,
    jobs: options.Jobs = -1,
    labels: options.Labels = None,
    skip_bad: options.SkipBad = False,
    *,
    protocol: str | None,
    reading: dict[str, Any],
) -> None:
    """Train a model on all recordings. What is chosen is chosen by cross-validation.

    Parameters
    ----------
    output : -o, --output
        Model file to write (.skops).
    pipeline
        A shipped pipeline, or a TOML of yours; by default surfaces, for an inertial unit coarse, with a
        row, a classifier or a budget texclass.
    row
        Row of the pipeline; the best by cross-validation by default.
    classifier
        Classifier of the pipeline; the best by default.
    max_kb
        Kilobytes of an exported kernel: fewer training samples, in fewer bits.
    touch
        Seconds of movement of one answer; whole recordings by default.
    false_alarms
        Share of known surfaces that may be called unknown.
    exportable
        Only features that `export --from samples` can write.
    """
    from texclass.loaders import open_dataset

    recordings = open_dataset(dataset, **reading, labels=labels, skip_bad=skip_bad)
    from texclass.recognition import train as train_model
    from texclass.recognition.model_document import model_document

    with progress_bar() as progress:
        model = train_model(
            recordings,
            pipeline,
            row=row,
            classifier=classifier,
            max_ms=max_ms,
            max_features=max_features,
            max_kb=max_kb,
            touch_s=touch,
            exportable=exportable,
            protocol=protocol,
            false_alarms=false_alarms,
            n_jobs=jobs,
            skip_bad=skip_bad,
            progress=progress,
        )
    model.save(output)
    left_out = (f"left out: {line}" for line in model.left_out)
    tell(model_document(model), (*left_out, *(f"note: {note}" for note in recordings.notes)))
    typer.echo(f"wrote {output}, {output.stat().st_size / 1e6:.1f} MB")


@command("texclass predict surfaces.skops felt.txt")
@options.reads_files
def predict(
    model: Path,
    files: list[str],
    as_lines: options.JsonLines = False,
    json_file: options.Json = None,
    confusion: Annotated[Path | None, options.writes(".csv", "")] = None,
    labels: options.Labels = None,
    skip_bad: bool = False,
    *,
    reading: dict[str, Any],
) -> None:
    """Predict the surface of each recording. Bad files are named, the others answered.

    Parameters
    ----------
    model
        A model file that `texclass train` wrote.
    files
        Recordings: files, folders, cards, or DATASET:RECORDING. Of a folder with one subfolder per surface,
        and of a card, accuracy and confusion matrix are reported.
    confusion
        File for the confusion matrix (CSV).
    skip_bad
        Exit with 0 although some files were bad; they are named.
    """
    import json

    from texclass.recognition import load_model
    from texclass.recognition import predict as predict_files
    from texclass.recognition.model_document import answers_document

    trained, found, facts = load_model(model), [], []
    with progress_bar() as progress:
        for prediction in predict_files(trained, files, labels=labels, **reading):
            found.append(prediction)
            if prediction.answer is None:
                typer.echo(f"error: {shown(str(prediction.problem))}", err=True)
            told = {"error": prediction.problem} if prediction.answer is None else prediction.answer.to_dict()
            true = {} if prediction.surface is None else {"true_surface": prediction.surface}
            facts.append({"file": prediction.name, **true, **told})
            if as_lines:
                typer.echo(json.dumps(facts[-1]))
            progress(len(found), max(len(found), len(files)), "recordings")
    write_json(json_file, json.dumps(facts, indent=1))
    answered = [(p.name, p.answer) for p in found if p.answer is not None]
    if answered and not as_lines:
        tell(answers_document(answered))
    if confusion is not None or (not as_lines and any(p.surface for p in found if p.answer is not None)):
        from texclass.recognition.evaluation import PredictionSummary

        summary = PredictionSummary.of(found, trained.materials)
        if not as_lines:
            tell(summary.document())
        if confusion is not None:
            typer.echo(f"wrote {summary.save_confusion(confusion)}", err=as_lines)
    if len(answered) < len(found) and not skip_bad:
        raise typer.Exit(1)


@command("texclass adapt surfaces.skops oak=new/1.txt slate=new/2.txt foam=new/3.txt -o new.skops")
@options.reads_files
def adapt(
    model: Path,
    references: list[str],
    output: Annotated[Path, options.writes(".skops")],
    unlabelled: bool = False,
    labels: options.Labels = None,
    *,
    reading: dict[str, Any],
) -> None:
    """Let a model follow another sensor. From a few references felt with it, without training again.

    Parameters
    ----------
    model
        A model file that `texclass train` wrote.
    references
        Recordings felt with the other sensor: SURFACE=FILE, files of unknown surfaces, DATASET:RECORDING,
        cards, or folders with one subfolder per surface.
    output : -o, --output
        Model file to write (.skops).
    unlabelled
        Do not believe which surfaces they are of.
    """
    from texclass.recognition import load_model
    from texclass.recognition.adaptation import adapt as adapt_model
    from texclass.recognition.model_document import adapted_facts

    trained = load_model(model)
    felt = trained.manifest.input.references(references, labels=labels, **reading)
    adapted = adapt_model(trained, felt, labelled=not unlabelled, resampled=reading["resample"] is not None)
    adapted.save(output)
    typer.echo(f"adapted to {adapted_facts(adapted.manifest)}")
    typer.echo(f"wrote {output}, {output.stat().st_size / 1e6:.1f} MB")


@command("texclass model surfaces.skops")
def model(
    file: Path,
    json_file: options.Json = None,
) -> None:
    """Show what is in a model. Surfaces, features, accuracy, calibration, cost and versions.

    Parameters
    ----------
    file : MODEL
        A model file that `texclass train` wrote.
    """
    from texclass.recognition import load_model
    from texclass.recognition.model_document import model_document

    loaded = load_model(file)
    write_json(json_file, loaded.manifest.to_json())
    if json_file != Path("-"):
        tell(model_document(loaded))
