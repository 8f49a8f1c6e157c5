"""Command `texclass export`, which writes a model as an ONNX file."""

from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Argument, Option

from texclass.cli import parameters as p
from texclass.cli.app import app
from texclass.cli.output import write_json


@app.command(
    rich_help_panel="Models", epilog="Example: texclass export surfaces.skops --from samples -o surfaces.onnx"
)
def export(
    model: Annotated[
        Path, Argument(help="Model file written by `texclass train`; with --check, an ONNX file.")
    ],
    start: Annotated[
        Literal["features", "samples"],
        Option(
            "--from",
            help="Input of the ONNX model: features that your program computes, or windows of samples.",
        ),
    ] = "features",
    window: Annotated[
        float | None,
        Option(metavar="S", help="Length of the windows with --from samples (default: as in training)."),
    ] = None,
    check: Annotated[
        bool, Option("--check", help="Compare the answers of an ONNX file with the answers stored in it.")
    ] = False,
    output: Annotated[
        Path | None, p.output_file("--output", "-o", suffixes=[".onnx"], help="ONNX file to write (.onnx).")
    ] = None,
    json_file: p.JsonFile = None,
) -> None:
    """Export a model to ONNX, if the answers of the exported model equal those of texclass."""
    if not check and output is None:
        raise typer.BadParameter("pass --output to write an ONNX file, or --check to check one")
    if window is not None and start != "samples":
        raise typer.BadParameter("--window requires --from samples")
    import json

    from texclass.recognition import load_model
    from texclass.robot import check_onnx, export_onnx

    if output is None or check:
        summary = check_onnx(model)
        typer.echo(f"{model}: {summary}")
        write_json(json_file, json.dumps({"check": summary}, indent=1))
        return
    exported = export_onnx(load_model(model), output, start=start, window_s=window)
    write_json(json_file, json.dumps(exported.facts, indent=1))
    typer.echo(str(exported.parity))
    if exported.sample_parity is not None:
        typer.echo(str(exported.sample_parity))
    if exported.single_precision:
        typer.echo(f"operators in single precision: {', '.join(exported.single_precision)}")
    typer.echo(f"wrote {output}, {output.stat().st_size / 1e6:.1f} MB")
