"""texclass inspect: one recording, drawn."""

from pathlib import Path
from typing import Annotated

import typer

from texclass.cli.app import app
from texclass.cli.options import (
    FsOption,
    UnitOption,
    shipped,
)


@app.command()
def inspect(
    recording: Annotated[
        str,
        typer.Argument(help="A file in any supported format, or DATASET:RECORDING (simulated:wood-03-01)."),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Picture to write; <recording>.inspect.png here by default.")
    ] = None,
    features: Annotated[
        str,
        typer.Option(help="Feature set whose values are shown.", autocompletion=shipped("feature_defs")),
    ] = "strese2015",
    fs: FsOption = None,
    unit: UnitOption = None,
) -> None:
    """Draw one recording: signal, phases, taps, spectrogram and feature values."""
    from texclass.features import FeatureExtractor
    from texclass.loaders import find_recording
    from texclass.phases import segment
    from texclass.reporting import draw_inspection

    found = find_recording(recording, fs=fs, unit=unit)
    phases = segment(found)
    declared = [found.with_(phases=phases)]
    extraction = FeatureExtractor(features).fit(declared).extract(declared)
    values = dict(zip(extraction.columns, extraction.values[0], strict=True))
    path = out or Path(f"{Path(found.recording_id).name}.inspect.png")
    draw_inspection(found, phases, values, path)
    typer.echo(f"{phases.kind}: {len(phases.taps)} taps, movement {_seconds(phases.movement, found.fs)}")
    for note in (*found.flags, *phases.notes):
        typer.echo(f"note: {note}")
    typer.echo(f"wrote {path}")


def _seconds(movement: tuple[int, int] | None, fs: float) -> str:
    return "none" if movement is None else f"{movement[0] / fs:.2f} to {movement[1] / fs:.2f} s"
