"""Scenes and texture files: plan, render, texture."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from texclass.cli import options
from texclass.cli.app import app
from texclass.cli.options import progress_bar, tell, write_json, wrote

if TYPE_CHECKING:
    from texclass.scene import PlannedScene

scene = typer.Typer(
    help="Plan the cheapest textures of a scene, and render it.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(scene, name="scene")

SceneArgument = Annotated[
    str,
    typer.Argument(metavar="SCENE", help="A scene's TOML, or the name of a shipped one: example, twenty."),
]


@scene.command(epilog="Example: texclass scene plan example -o example.texture")
def plan(
    definition: SceneArgument = "example",
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Where the planned models are written; SCENE.texture here by default."
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Write the plan here as Markdown, with a figure of what the speed does to each surface.",
        ),
    ] = None,
    json_file: options.Json = None,
) -> None:
    """Choose the cheapest model of each surface. The budget is proved by measuring.

    Exit code 1 if a surface is outside the tolerance or the budget does not hold.
    """
    from texclass.document import write_document
    from texclass.scene import plan_scene, read_scene

    read = read_scene(definition)
    with progress_bar() as progress:
        found = plan_scene(read, progress=progress)
    document = found.document()
    tell(document)
    write_json(json_file, found.to_json())
    if report is not None:
        wrote(write_document(document, report, read.source.stem))
    path = found.scene.save(output or Path(f"{read.source.stem}.texture"))
    typer.echo(f"wrote {path}, {path.stat().st_size} bytes")
    if not found.met:
        raise typer.Exit(1)


@scene.command(epilog="Example: texclass scene render example.texture -o example.wav")
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
    output: Annotated[Path, typer.Option("-o", "--output", help="The WAV to be written.")] = Path(
        "scene.wav"
    ),
    physical: Annotated[
        bool,
        typer.Option(
            "--physical", help="For devices: 32-bit float in the unit of the scene, at its own rate."
        ),
    ] = False,
    shift: Annotated[
        float, typer.Option("--shift", help="For ears: move the whole band up, Hz (0 ... 10000).")
    ] = 0.0,
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
) -> None:
    """Play a path over a scene to WAV. It is rendered one sample a call, and timed.

    The WAV is for ears: 48 kHz, 16 bit, as loud as it can be. What full scale stands for is printed, and
    noted in the file.
    """
    from texclass.exchange import read_wav, write_wav
    from texclass.scene import play_path, read_path, sweep_of

    planned = _planned(definition)
    played = play_path(planned, sweep_of(planned) if path is None else read_path(path), seed=seed)
    write_wav(
        output,
        played.samples,
        planned.fs,
        unit=planned.unit,
        encoding="float32" if physical else "audible",
        shift_hz=shift,
    )
    for line in played.lines(planned):
        typer.echo(line)
    wav = read_wav(output)
    full = f"; full scale is {wav.peak:.4g} {wav.unit}, gain {1 / max(wav.peak, 1e-300):.4g}"
    typer.echo(f"wrote {output}, {wav.fs:g} Hz{'' if physical else full}")


@scene.command(epilog="Example: texclass scene page example.texture -o feel.html")
def page(
    definition: Annotated[
        str,
        typer.Argument(
            metavar="SCENE", help="A planned scene (.texture), or what `plan` takes: it is planned first."
        ),
    ] = "example",
    output: Annotated[Path, typer.Option("-o", "--output", help="The page to be written.")] = Path(
        "feel.html"
    ),
    taps: Annotated[
        Path | None,
        typer.Option(
            "--taps", help="A library of taps (.texture), by names of surfaces; guessed by default."
        ),
    ] = None,
) -> None:
    """Write a page in which a planned scene is stroked, tapped, heard and felt.

    One file that needs no network: the very models of the plan, driven by the pointer's speed and pressure.
    """
    from texclass.exchange import load_taps
    from texclass.scene import write_feel_page

    library = None if taps is None else load_taps(taps)
    path = write_feel_page(output, _planned(definition), taps=library)
    typer.echo(f"wrote {path}, {path.stat().st_size} bytes")


def _planned(definition: str) -> "PlannedScene":
    """Return a planned scene from its file, or of what is planned first."""
    from texclass.scene import load_scene, plan_scene, read_scene

    if definition.endswith(".texture"):
        return load_scene(definition)
    with progress_bar() as progress:
        return plan_scene(read_scene(definition), progress=progress).scene


@app.command(epilog="Example: texclass texture wood.texture --page wood.html")
def texture(
    file: Annotated[Path, typer.Argument(help="A .texture, or the .xml of a HaTT texture.")],
    page_file: Annotated[
        Path | None,
        typer.Option("--page", help="Also write a page in which it is stroked and heard."),
    ] = None,
    slider_file: Annotated[
        Path | None,
        typer.Option("--sliders", help="The same with a slider for each scale of `describe`; see `convert`."),
    ] = None,
    json_file: options.Json = None,
) -> None:
    """Show what is in a texture file. Family, points, order, sampling rate, unit and bytes."""
    import json

    from texclass.document import Document
    from texclass.exchange import describe

    found = describe(file)
    tell(Document(str(file), [{key: _words(value) for key, value in found.items()}]))
    write_json(json_file, json.dumps(found, indent=1))
    if page_file is not None:
        from texclass.scene import load_scene, plan_scene, scene_of_texture, write_feel_page
        from texclass.textures import PackedTexture

        taps = {}
        if found["family"] == "scene":
            planned = load_scene(file)
        else:
            with progress_bar() as progress:
                planned = plan_scene(scene_of_texture(file), progress=progress).scene
        if found["family"] == PackedTexture.family:
            tap = PackedTexture.from_bytes(file.read_bytes()).tap
            taps = dict.fromkeys(planned.assigned, tap) if tap.n_modes else {}
        write_feel_page(page_file, planned, taps=taps)
        typer.echo(f"wrote {page_file}, {page_file.stat().st_size} bytes")
    if slider_file is not None:
        from texclass.exchange import load_texture, read_hatt
        from texclass.scene import write_slider_page

        felt = read_hatt(file) if file.suffix.lower() == ".xml" else load_texture(file)
        with progress_bar() as progress:
            write_slider_page(slider_file, felt, file=file.name, unit=found["unit"], progress=progress)
        typer.echo(f"wrote {slider_file}, {slider_file.stat().st_size} bytes")


def _words(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_words(inner)}" for name, inner in value.items())
    if isinstance(value, list):
        return " x ".join(map(str, value)) or "number"
    return "-" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
