"""texclass export: a model for a computer without Python."""

from pathlib import Path
from typing import Annotated

import typer

from texclass.cli.app import app


@app.command()
def export(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="A model file that `texclass train` wrote.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="ONNX file to write (.onnx).")],
) -> None:
    """Write what follows the features as ONNX; refused where its answers differ from scikit-learn's."""
    from texclass.recognition import export_onnx, load_model

    exported = export_onnx(load_model(model), output)
    typer.echo(str(exported.parity))
    if exported.single_precision:
        typer.echo(f"in single precision: {', '.join(exported.single_precision)}")
    typer.echo(f"wrote {output}, {output.stat().st_size / 1e6:.1f} MB")
