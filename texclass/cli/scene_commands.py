"""Scenes and texture files: plan, render, texture."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from texclass.cli import options
from texclass.cli.app import app, command
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


@command("texclass scene plan example -o example.texture", scene)
def plan(
    definition: SceneArgument = "example",
    output: Path | None = None,
    report: Path | None = None,
    json_file: options.Json = None,
) -> None:
    """Choose the cheapest model of each surface. The budget is proved by measuring.

    Exit code 1 if a surface is outside the tolerance or the budget does not hold.

    Parameters
    ----------
    output : -o, --output
        Where the planned models are written; SCENE.texture here by default.
    report : FOLDER
        Write the plan here as Markdown, with a figure of what the speed does to each surface.
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


@command("texclass scene render example.texture -o example.wav", scene)
def render(
    definition: str,
    path: Annotated[Path | None, typer.Argument()] = None,
    output: Path = Path("scene.wav"),
    physical: bool = False,
    shift: float = 0.0,
    seed: int = 0,
) -> None:
    """Play a path over a scene to WAV. It is rendered one sample a call, and timed.

    The WAV is for ears: 48 kHz, 16 bit, as loud as it can be. What full scale stands for is printed, and
    noted in the file.

    Parameters
    ----------
    definition : SCENE
        A planned scene (.texture), or what `plan` takes: it is planned first.
    path
        CSV with time (s), x, y (mm), force (N), surface; a sweep over all by default.
    output : -o, --output
        The WAV to be written.
    physical
        For devices: 32-bit float in the unit of the scene, at its own rate.
    shift
        For ears: move the whole band up, Hz (0 ... 10000).
    seed
        Of the noise.
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


@command("texclass scene page example.texture -o feel.html", scene)
def page(
    definition: Annotated[str, typer.Argument()] = "example",
    output: Path = Path("feel.html"),
    taps: Path | None = None,
) -> None:
    """Write a page in which a planned scene is stroked, tapped, heard and felt.

    One file that needs no network: the very models of the plan, driven by the pointer's speed and pressure.

    Parameters
    ----------
    definition : SCENE
        A planned scene (.texture), or what `plan` takes: it is planned first.
    output : -o, --output
        The page to be written.
    taps
        A library of taps (.texture), by names of surfaces; guessed by default.
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


@command("texclass texture wood.texture --page wood.html")
def texture(
    file: Path,
    page_file: Path | None = None,
    slider_file: Path | None = None,
    json_file: options.Json = None,
) -> None:
    """Show what is in a texture file. Family, points, order, sampling rate, unit and bytes.

    Parameters
    ----------
    file
        A .texture, or the .xml of a HaTT texture.
    page_file : --page
        Also write a page in which it is stroked and heard.
    slider_file : --sliders
        The same with a slider for each scale of `describe`; see `convert`.
    """
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
        from texclass.exchange import load_texture
        from texclass.scene import write_slider_page

        felt = load_texture(file)
        with progress_bar() as progress:
            write_slider_page(slider_file, felt, file=file.name, unit=found["unit"], progress=progress)
        typer.echo(f"wrote {slider_file}, {slider_file.stat().st_size} bytes")


def _words(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_words(inner)}" for name, inner in value.items())
    if isinstance(value, list):
        return " x ".join(map(str, value)) or "number"
    return "-" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
