"""texclass explore: a simulated hand that is told what to do next."""

import json
from pathlib import Path
from typing import Annotated

import typer

from texclass.cli import options
from texclass.cli.app import app
from texclass.cli.options import progress_bar


@app.command(epilog="Example: texclass explore --surface wood-03 -o gestures")
def explore(
    models: Annotated[
        Path | None,
        typer.Argument(
            help="Folder of models that `-o` wrote; by default they are trained on simulated gestures."
        ),
    ] = None,
    surface: Annotated[
        list[str] | None,
        typer.Option("--surface", help="What is explored, several times; each of the six by default."),
    ] = None,
    confidence: Annotated[float, typer.Option(help="Probability from which on a surface is sure.")] = 0.95,
    seconds: options.Seconds = None,
    seed: Annotated[int, typer.Option(min=0, help="Of what the simulated hand does.")] = 0,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder to write the models to; `texclass stream` takes it."),
    ] = None,
    as_lines: options.JsonLines = False,
) -> None:
    """Show how to explore: a simulated hand makes the gesture that would tell most, until it is sure."""
    from texclass.recognition import load_gestures
    from texclass.recognition.rehearsal import REHEARSED, rehearse, train_gestures

    if models is not None:
        trained = load_gestures(models)
    else:
        with progress_bar() as progress:
            trained = train_gestures(progress=progress)
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        for name, model in trained.items():
            model.save(output / f"{name.replace(' ', '_')}.skops")
    for name in surface or [one.name for one in REHEARSED.surfaces]:
        costs = options.seconds_of(seconds)
        for step in rehearse(trained, name, seed=seed, seconds=costs, confidence=confidence):
            told = f"{step.surface}, {100 * step.probability:.1f} %{', sure' if step.sure else ''}"
            following = f"; next: {step.advice}" if step.advice is not None else ""
            if as_lines:
                facts = {
                    "felt": name,
                    "gesture": step.gesture,
                    "seconds": round(step.seconds, 6),
                    "surface": step.surface,
                    "probability": round(step.probability, 6),
                    "sure": step.sure,
                    "next": None if step.advice is None else step.advice.gesture,
                }
                typer.echo(json.dumps(facts))
            else:
                typer.echo(f"{name}: {step.seconds:5.2f} s  {step.gesture:<12} {told}{following}")
