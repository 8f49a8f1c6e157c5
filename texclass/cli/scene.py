"""texclass scene: plan the cheapest textures of a scene, and play a path over it."""

from pathlib import Path
from typing import Annotated

import typer

from texclass.cli.app import app
from texclass.cli.options import console, progress_bar, write_json

scene = typer.Typer(
    help="Plan the cheapest textures that serve a scene, and render it sample by sample.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(scene, name="scene")

SceneArgument = Annotated[
    str,
    typer.Argument(metavar="SCENE", help="A scene's TOML, or the name of a shipped one: example, twenty."),
]


@scene.command()
def plan(
    definition: SceneArgument = "example",
    out: Annotated[
        Path | None, typer.Option(help="Where the planned models are written; SCENE.texture here by default.")
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the plan as JSON here.")] = None,
) -> None:
    """Choose the cheapest model of each surface within the tolerance, and prove the budget by measuring.

    Exit code 1 if a surface is outside the tolerance or the budget does not hold.
    """
    from texclass.reporting.scene import plan_lines, plan_table
    from texclass.scene import plan_scene, read_scene

    read = read_scene(definition)
    with progress_bar() as progress:
        found = plan_scene(read, progress=progress)
    console().print(plan_table(found))
    for line in plan_lines(found):
        typer.echo(line)
    write_json(json_file, found.to_json())
    path = found.scene.save(out or Path(f"{read.source.stem}.texture"))
    typer.echo(f"wrote {path}, {path.stat().st_size} bytes")
    if not found.met:
        raise typer.Exit(1)


@scene.command()
def render(
    definition: Annotated[
        str,
        typer.Argument(
            metavar="SCENE", help="A planned scene (.texture), or what `plan` takes: it is planned first."
        ),
    ],
    path: Annotated[
        Path | None,
        typer.Argument(help="CSV with time (s), x, y (mm), force (N), surface; a sweep over all by default."),
    ] = None,
    out: Annotated[Path, typer.Option(help="The WAV to be written, in the unit of the scene.")] = Path(
        "scene.wav"
    ),
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
) -> None:
    """Play a path over a scene to WAV, one sample a call, and say how long the samples took."""
    from texclass.exchange import write_wav
    from texclass.reporting.scene import played_lines
    from texclass.scene import load_scene, plan_scene, play_path, read_path, read_scene, sweep_of

    planned = (
        load_scene(definition)
        if definition.endswith(".texture")
        else plan_scene(read_scene(definition)).scene
    )
    played = play_path(planned, sweep_of(planned) if path is None else read_path(path), seed=seed)
    write_wav(out, played.samples, planned.fs, unit=planned.unit)
    for line in played_lines(played, planned):
        typer.echo(line)
    typer.echo(f"wrote {out}")
