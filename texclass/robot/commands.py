"""Command that writes models for robots: export."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from texclass.cli import options
from texclass.cli.app import command
from texclass.cli.options import write_json


@command("texclass export surfaces.skops --from samples -o surfaces.onnx")
def export(
    model: Path,
    output: Annotated[Path | None, options.writes(".onnx")] = None,
    start: Literal["features", "samples"] = "features",
    touch: float | None = None,
    check: bool = False,
    json_file: options.Json = None,
) -> None:
    """Write a model as ONNX. It is refused where its answers differ from texclass's.

    Parameters
    ----------
    model : MODEL
        A model file that `texclass train` wrote; with --check, the ONNX file.
    output : -o, --output
        ONNX file to write (.onnx).
    start : --from
        What the file takes: features of your own, or windows of samples.
    touch
        Seconds of a window of samples; as in the training by default.
    check
        Ask an ONNX file what it holds the answers to.
    """
    import json

    from texclass.recognition import load_model
    from texclass.robot import check_onnx, export_onnx

    if check:
        typer.echo(f"{model}: {check_onnx(model)}")
        return
    if output is None:
        raise typer.BadParameter("missing; the rule is -o FILE.onnx, or --check", param_hint="--output")
    exported = export_onnx(load_model(model), output, start=start, touch_s=touch)
    write_json(json_file, json.dumps(exported.facts, indent=1))
    if json_file == Path("-"):
        return
    typer.echo(str(exported.parity))
    if exported.of_samples is not None:
        typer.echo(str(exported.of_samples))
    if exported.single_precision:
        typer.echo(f"in single precision: {', '.join(exported.single_precision)}")
    typer.echo(f"wrote {output}, {output.stat().st_size / 1e6:.1f} MB")
