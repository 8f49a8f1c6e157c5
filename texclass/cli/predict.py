"""texclass predict: a model and files in, surfaces out."""

from pathlib import Path
from typing import Annotated

import typer

from texclass.cli.app import app
from texclass.cli.options import FsOption, console


@app.command()
def predict(
    model: Annotated[Path, typer.Argument(help="A model file that `texclass train` wrote.")],
    files: Annotated[list[str], typer.Argument(help="Recordings: files, or DATASET:RECORDING.")],
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object a line, as answers come.")] = False,
    fs: FsOption = None,
    unit: Annotated[
        str | None, typer.Option("--unit", help="Unit in the files; that of the training files by default.")
    ] = None,
    skip_bad: Annotated[
        bool, typer.Option("--skip-bad", help="Exit with 0 although some files were bad; they are named.")
    ] = False,
) -> None:
    """Say which surface each recording is of; bad files are named, the others answered."""
    import json

    from texclass.recognition import load_model
    from texclass.recognition import predict as predict_files
    from texclass.reporting.models import answer_table

    trained, found = load_model(model), []
    for prediction in predict_files(trained, files, fs=fs, unit=unit):
        found.append(prediction)
        if prediction.answer is None:
            typer.echo(f"error: {prediction.problem}", err=True)
        if as_json:
            told = {"error": prediction.problem} if prediction.answer is None else prediction.answer.to_dict()
            typer.echo(json.dumps({"file": prediction.name, **told}))
    answered = [(p.name, p.answer) for p in found if p.answer is not None]
    if answered and not as_json:
        console().print(answer_table(answered))
    if len(answered) < len(found) and not skip_bad:
        raise typer.Exit(1)
