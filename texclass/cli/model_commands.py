"""Commands on models: train, model, predict, adapt."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from texclass.cli import parameters as p
from texclass.cli.app import app, escape_control_characters
from texclass.cli.output import RECORDING_KERNELS, announce_start, print_lines, progress_bar, write_json

if TYPE_CHECKING:
    from texclass.recognition import Drift, Model, Prediction

NewModelFile = Annotated[
    Path, p.output_file("--output", "-o", suffixes=[".skops"], help="Model file to write (.skops).")
]


@app.command(
    rich_help_panel="Models",
    epilog="Example: texclass train recordings --fs 10000 --unit m/s^2 -o surfaces.skops",
)
@p.with_reader_options
def train(
    dataset: p.Dataset,
    *,
    pipeline: Annotated[
        str | None,
        Option(
            metavar="NAME",
            help="Shipped pipeline or pipeline file (TOML). Default: surfaces, or texclass if a row, "
            "classifier or budget is given.",
            autocompletion=p.shipped_names("pipelines"),
        ),
    ] = None,
    row: Annotated[
        str | None,
        Option(metavar="NAME", help="Feature subset: name of a row of the pipeline (default: the best)."),
    ] = None,
    classifier: Annotated[
        str | None, Option(metavar="NAME", help="Classifier of the pipeline (default: the best).")
    ] = None,
    max_ms: p.MaxMs = None,
    max_features: p.MaxFeatures = None,
    max_kb: Annotated[
        float | None,
        Option(
            metavar="KB",
            help="Size limit of an exported kernel classifier: it stores fewer training samples, in 16 bits.",
        ),
    ] = None,
    window: Annotated[
        float | None, Option(metavar="S", help="Train on windows of this length instead of whole recordings.")
    ] = None,
    false_alarms: Annotated[
        float,
        Option(metavar="P", help="Fraction of recordings of known surfaces that may be reported as unknown."),
    ] = 0.05,
    exportable: Annotated[
        bool, Option("--exportable", help="Use only features that `texclass export --from samples` supports.")
    ] = False,
    reader: p.Reader,
    labels: p.Labels = None,
    tap_spacing: p.TapSpacing = None,
    skip_bad: p.SkipBad = False,
    axes: p.Axes = "auto",
    protocol: Annotated[
        p.ProtocolName | None,
        p.evaluation_option(
            metavar="NAME",
            help="Evaluation protocol, see `texclass benchmark --help`. Default: chronological for 20 or "
            "more numbered repetitions per surface, since sensors drift; otherwise as in the pipeline.",
        ),
    ] = None,
    shots: p.Shots = None,
    train: p.TrainingSet = None,
    test: p.TestSet = None,
    leave_out: p.LeaveOut = None,
    jobs: p.Jobs = -1,
    output: NewModelFile,
) -> None:
    """Train a model on all recordings of a dataset.

    Feature subset and classifier are selected by cross-validation, unless --row and --classifier set them.
    """
    chosen_protocol = p.protocol_name(protocol, shots, train, test, leave_out)
    announce_start(*RECORDING_KERNELS)
    from texclass.loaders import open_dataset

    recordings = open_dataset(dataset, **reader, labels=labels, tap_spacing=tap_spacing, skip_bad=skip_bad)
    from texclass.evaluation.workers import begin_loading

    begin_loading(jobs, "texclass.evaluation.checkpoints", "texclass.recognition.training")
    from texclass import recognition
    from texclass.recognition.model_document import model_document
    from texclass.reporting import print_document

    with progress_bar() as progress:
        model = recognition.train(
            recordings,
            pipeline,
            row=row,
            classifier=classifier,
            max_ms=max_ms,
            max_features=max_features,
            max_kb=max_kb,
            window_s=window,
            exportable=exportable,
            axes=axes,
            protocol=chosen_protocol,
            false_alarms=false_alarms,
            n_jobs=jobs,
            skip_bad=skip_bad,
            progress=progress,
        )
    model.save(output)
    print_document(model_document(model))
    print_lines("left out:", model.left_out)
    print_lines("note:", recordings.notes)
    typer.echo(f"wrote {output}, {output.stat().st_size / 1e6:.1f} MB")


@app.command(rich_help_panel="Models", epilog="Example: texclass model surfaces.skops")
def model(model: p.ModelFile, json_file: p.JsonFile = None) -> None:
    """Show surfaces, features, accuracy, calibration, cost and versions of a model."""
    from texclass.recognition import load_model
    from texclass.recognition.model_document import model_document
    from texclass.reporting import print_document

    loaded = load_model(model)
    write_json(json_file, loaded.manifest.to_json())
    print_document(model_document(loaded))


@app.command(rich_help_panel="Models", epilog="Example: texclass predict surfaces.skops new.txt")
@p.with_reader_options
def predict(
    model: p.ModelFile,
    files: Annotated[
        list[str],
        Argument(
            help="Recordings: files, DATASET:RECORDING, dataset cards or folders. If their surfaces "
            "are known, "
            "accuracy and confusion matrix are reported."
        ),
    ],
    *,
    reader: p.Reader,
    labels: p.Labels = None,
    skip_bad: Annotated[
        bool, p.data_option("--skip-bad", help="Exit with code 0 even if files are unreadable.")
    ] = False,
    as_lines: p.JsonLines = False,
    json_file: p.JsonFile = None,
    confusion: Annotated[
        Path | None,
        p.output_file("--confusion", suffixes=[".csv", ""], help="Also write the confusion matrix (CSV)."),
    ] = None,
    adapt: Annotated[
        bool,
        Option(
            "--adapt",
            help="Adapt the model to all recordings, without labels, and answer with the adapted model. "
            "Requires 10 recordings of several surfaces.",
        ),
    ] = False,
    save: Annotated[
        Path | None,
        p.output_file("--save", suffixes=[".skops"], help="With --adapt: write the adapted model (.skops)."),
    ] = None,
) -> None:
    """Predict the surface of each recording; list and skip unreadable files.

    If the features of several surfaces have shifted as a whole, a message on standard error reports it.
    """
    if save is not None and not adapt:
        raise typer.BadParameter("--save requires --adapt")
    announce_start(*RECORDING_KERNELS)
    import json

    from texclass import recognition
    from texclass.recognition.model_document import answers_document
    from texclass.reporting import print_document

    trained, predictions = recognition.load_model(model), list[recognition.Prediction]()

    def show(prediction: recognition.Prediction) -> None:
        if prediction.answer is None:
            typer.echo(f"error: {escape_control_characters(str(prediction.problem))}", err=True)
        if as_lines:
            typer.echo(json.dumps(_result(prediction)))

    with progress_bar() as progress:
        for prediction in recognition.predict(trained, files, labels=labels, **reader):
            predictions.append(prediction)
            if not adapt:
                show(prediction)
            progress(len(predictions), max(len(predictions), len(files)), "recordings")
    drift, adapted = _follow_drift(trained, predictions, adapt=adapt, save=save)
    if adapt:
        predictions = [_answer_again(adapted, prediction) for prediction in predictions]
        for prediction in predictions:
            show(prediction)
    changes = {"drift": drift.to_dict(), "adapted": dict(adapted.manifest.adapted)}
    if as_lines and (adapt or drift.is_detected):
        typer.echo(json.dumps(changes))
    results = {"recordings": [_result(prediction) for prediction in predictions], **changes}
    write_json(json_file, json.dumps(results, indent=1))
    answers = [(item.name, item.answer) for item in predictions if item.answer is not None]
    if answers and not as_lines:
        print_document(answers_document(answers))
    has_labels = any(item.surface for item in predictions if item.answer is not None)
    if confusion is not None or (has_labels and not as_lines):
        from texclass.recognition.evaluation import PredictionSummary

        summary = PredictionSummary.from_predictions(predictions, trained.surfaces)
        if not as_lines:
            print_document(summary.document())
        if confusion is not None:
            typer.echo(f"wrote {summary.save_confusion(confusion)}", err=as_lines)
    if len(answers) < len(predictions) and not skip_bad:
        raise typer.Exit(1)


def _result(prediction: "Prediction") -> dict[str, Any]:
    """Return a prediction as JSON-compatible data."""
    true_surface = {} if prediction.surface is None else {"true_surface": prediction.surface}
    answer = {"error": prediction.problem} if prediction.answer is None else prediction.answer.to_dict()
    return {"file": prediction.name, **true_surface, **answer}


def _follow_drift(
    model: "Model", predictions: "Sequence[Prediction]", *, adapt: bool, save: Path | None
) -> "tuple[Drift, Model]":
    """Report drift, adapt the model to it if requested, and return drift and model."""
    from texclass.recognition import adapt_to_answers, detect_drift
    from texclass.recognition.model_document import describe_adaptation

    answers = [item.answer for item in predictions if item.answer is not None]
    drift = detect_drift(model, answers)
    if not adapt:
        if drift.is_detected:
            solution = "Adapt the model with --adapt, or with 'texclass adapt MODEL FOLDER --unlabelled'"
            if model.manifest.adapted:
                solution = "Adapt the original model to these recordings"
            typer.echo(f"{drift.message}. {solution}", err=True)
        return drift, model
    try:
        adapted = adapt_to_answers(model, answers)
    except ValueError as error:
        typer.echo(f"not adapted, the answers are those of the original model: {error}", err=True)
        return drift, model
    typer.echo(f"adapted to {describe_adaptation(adapted.manifest)}", err=True)
    if save is not None:
        adapted.save(save)
        typer.echo(f"wrote {save}, {save.stat().st_size / 1e6:.1f} MB", err=True)
    return drift, adapted


def _answer_again(model: "Model", prediction: "Prediction") -> "Prediction":
    """Return the prediction of an adapted model for the same recording."""
    if prediction.answer is None:
        return prediction
    return prediction._replace(answer=model.answer_again(prediction.answer))


@app.command(
    rich_help_panel="Models",
    epilog="Example: texclass adapt surfaces.skops oak=new/1.txt slate=new/2.txt foam=new/3.txt -o new.skops",
)
@p.with_reader_options
def adapt(
    model: p.ModelFile,
    references: Annotated[
        list[str],
        Argument(
            help="Reference recordings of the other sensor: SURFACE=FILE, FILE if the surface is not known, "
            "DATASET:RECORDING, dataset cards, or folders with one subfolder per surface."
        ),
    ],
    *,
    unlabelled: Annotated[
        bool, Option("--unlabelled", help="Ignore the surface labels of the reference recordings.")
    ] = False,
    reader: p.Reader,
    labels: p.Labels = None,
    output: NewModelFile,
) -> None:
    """Adapt a model to another sensor with a few reference recordings, without retraining."""
    from texclass import recognition
    from texclass.loaders.phases_files import is_marked, marked_note
    from texclass.recognition import adaptation
    from texclass.recognition.model_document import describe_adaptation

    trained = recognition.load_model(model)
    recordings = trained.manifest.input.references(references, labels=labels, **reader)
    if n_marked := sum(map(is_marked, recordings)):
        typer.echo(f"note: {marked_note(n_marked)}", err=True)
    adapted = adaptation.adapt(
        trained, recordings, use_labels=not unlabelled, resample=reader["resample"] is not None
    )
    adapted.save(output)
    typer.echo(f"adapted to {describe_adaptation(adapted.manifest)}")
    typer.echo(f"wrote {output}, {output.stat().st_size / 1e6:.1f} MB")
