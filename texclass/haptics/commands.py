"""Commands that describe and render surfaces: describe, scene (plan, render, page), texture, convert."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from texclass.cli import options
from texclass.cli.app import app, command
from texclass.cli.options import progress_bar, shipped, tell, write_json, wrote

if TYPE_CHECKING:
    from texclass.haptics.exchange import Rendition
    from texclass.haptics.exchange.rendition import Playable
    from texclass.haptics.exchange.wav import Encoding
    from texclass.haptics.scene import PlannedScene

TEXTURES, PATTERNS = (".texture", ".xml"), (".hjif", ".ahap")
"""What holds a texture, and what holds it as played once."""

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


@command("texclass describe recordings/oak/oak_01.txt --fs 10000 --unit m/s^2")
@options.reads_files
def describe(
    recordings: list[str],
    references: Annotated[str, typer.Option(autocompletion=shipped("datasets"))] = "simulated",
    jobs: options.Jobs = -1,
    json_file: options.Json = None,
    *,
    reading: dict[str, Any],
) -> None:
    """Say how a surface feels. Hard, rough, bumpy, sticky, fine, regular, among reference surfaces.

    Parameters
    ----------
    recordings
        Recordings: files, or DATASET:RECORDING.
    references
        Surfaces to compare with: a shipped dataset card, a card, or a folder that needs no --fs.
    """
    from texclass.loaders import find_recording

    found = [find_recording(name, **reading) for name in recordings]
    from texclass.haptics import describe as describe_recordings
    from texclass.haptics import felt_document

    with progress_bar() as progress:
        felt = describe_recordings(found, references, n_jobs=jobs, progress=progress)
    write_json(json_file, felt.to_json(orient="records", indent=1))
    if json_file != Path("-"):
        tell(felt_document(felt))


@command("texclass scene plan example -o example.texture", scene)
def plan(
    definition: SceneArgument = "example",
    output: Annotated[Path | None, options.writes(".texture")] = None,
    report: Annotated[Path | None, options.WRITES_FOLDER] = None,
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
    from texclass.haptics.scene import plan_scene, read_scene
    from texclass.reporting import write_document

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
    output: Annotated[Path, options.writes(".wav")] = Path("scene.wav"),
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
    from texclass.haptics.exchange import read_wav, write_wav
    from texclass.haptics.scene import play_path, read_path, sweep_of

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
    output: Annotated[Path, options.writes(".html")] = Path("feel.html"),
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
    from texclass.haptics.exchange import load_taps
    from texclass.haptics.scene import write_feel_page

    library = None if taps is None else load_taps(taps)
    path = write_feel_page(output, _planned(definition), taps=library)
    typer.echo(f"wrote {path}, {path.stat().st_size} bytes")


def _planned(definition: str) -> "PlannedScene":
    """Return a planned scene from its file, or of what is planned first."""
    from texclass.haptics.scene import load_scene, plan_scene, read_scene

    if definition.endswith(".texture"):
        return load_scene(definition)
    with progress_bar() as progress:
        return plan_scene(read_scene(definition), progress=progress).scene


@command("texclass texture wood.texture --page wood.html")
def texture(
    file: Path,
    page_file: Annotated[Path | None, options.writes(".html")] = None,
    slider_file: Annotated[Path | None, options.writes(".html")] = None,
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

    from texclass.haptics.exchange import describe
    from texclass.reporting import Document

    found = describe(file)
    tell(Document(str(file), [{key: _words(value) for key, value in found.items()}]))
    write_json(json_file, json.dumps(found, indent=1))
    if page_file is not None:
        from texclass.haptics.scene import load_scene, plan_scene, scene_of_texture, write_feel_page
        from texclass.haptics.textures import PackedTexture

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
        from texclass.haptics.exchange import load_texture
        from texclass.haptics.scene import write_slider_page

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


@command("texclass convert wood.texture -o wood.hjif --speed 80 --force 1")
def convert(
    source: Path,
    target: Annotated[Path | None, options.writes(*TEXTURES, *PATTERNS, ".wav")] = None,
    n_bytes: int | None = None,
    scale: list[str] | None = None,
    fs: float | None = None,
    unit: options.Unit = None,
    order: Annotated[int, typer.Option(min=1, max=100)] = 20,
    surface: str | None = None,
    speed: float | None = None,
    force: float | None = None,
    seconds: float = 2.0,
    physical: bool = False,
    seed: int = 0,
) -> None:
    """Convert a surface to the format of another device. What is lost there is told.

    HaTT XML holds a texture, as .texture does. MPEG haptics (.hjif), Apple's patterns (.ahap) and WAV hold
    the vibration at one speed and force. A .hjif or .ahap is rendered to WAV; a .hjif becomes a texture
    again, as far as it holds one. With --bytes a texture or a recording becomes a small texture; --scale
    changes how a texture feels.

    Parameters
    ----------
    source : IN
        A .texture (a texture, taps, a scene), a HaTT .xml; or .hjif, .ahap, rendered; with --bytes
        a recording, too.
    target : -o, --output
        File to write: .texture, .xml, .hjif, .ahap or .wav.
    n_bytes : --bytes
        Pack a texture or a recording into a .texture so small.
    scale : SCALE=VALUE
        Of a texture, several times: rough=8, bumpy=2, fine=5, regular=4, as `describe` tells; hard=7
        where it holds a tap, sticky=3 where it holds friction.
    fs
        To XML: sampling rate of the models, Hz, 1000 by default. Of a recording: its own.
    order
        To XML: largest order of the models.
    surface
        Which one, of a scene or of taps; of taps all by default.
    speed
        To be played at, mm/s; amid what the texture knows by default.
    force
        The same, N.
    seconds
        To be played, at most 30.
    physical
        To WAV: 32-bit float in the unit, not for ears.
    seed
        Of the noise.
    """
    from texclass.reporting import Document

    if target is None:
        raise ValueError(f"{source}: where to is missing; the rule is -o OUT")
    kinds = source.suffix.lower(), target.suffix.lower()
    if scale:
        lost = _retouch(source, target, scale, n_bytes)
    elif n_bytes is not None:
        lost = _pack(source, target, n_bytes, fs, unit)
    elif kinds[0] in PATTERNS and kinds[1] in (".wav", ".texture") and kinds != (".ahap", ".texture"):
        try:
            heard = kinds[1] == ".wav"
            lost = _play_pattern(source, target, physical) if heard else _read_played(source, target)
        except ValueError as error:  # what plays does not know the file
            raise ValueError(str(error) if str(source) in str(error) else f"{source}: {error}") from error
    elif kinds[0] in TEXTURES and kinds[1] in (*PATTERNS, ".wav"):
        lost = _write_played(_rendition(source, surface, speed, force, seconds, seed), target, physical)
    elif kinds in {(".xml", ".texture"), (".texture", ".xml")}:
        lost = _convert_texture(source, target, 1000.0 if fs is None else fs, order)
    else:
        raise ValueError(
            f"{source} to {target}; the rule is .texture or .xml to the other one, .hjif, .ahap or .wav, "
            ".hjif or .ahap to .wav, .hjif to .texture"
        )
    typer.echo(f"wrote {target}, {target.stat().st_size} bytes")
    if lost:
        tell(Document("How it feels" if scale else "What is lost", [lost]))


def _pack(source: Path, target: Path, n_bytes: int, fs: float | None, unit: str | None) -> dict[str, str]:
    """Write a texture, or what a recording holds, in so few bytes, and return what is lost."""
    from texclass.haptics import exchange
    from texclass.haptics.textures import pack
    from texclass.loaders import load_recording

    if source.suffix.lower() in TEXTURES:
        packed = pack(exchange.load_texture(source), n_bytes, unit=exchange.describe(source)["unit"])
        law, taps = "40 to 200 mm/s, 0.4 to 2 N", "none in the texture, or too few bytes"
        rubs_as = ""
    else:
        packed = pack(load_recording(source, fs=fs, unit=unit), n_bytes, name=source.stem)
        law = "those of the recording"
        taps = "none found, or too few bytes"
        rubs_as = ", as the recording's channel says it; other devices take it for a coefficient"
    several = packed.model.speeds.size > 1
    felt = f"{law}: a level law, two spectra" if several else "one spectrum and one level, whatever they are"
    if n_modes := packed.tap.n_modes:
        taps = f"one, neither the hardest nor the softest, as {n_modes} decaying sinusoids"
    rubs = f"{packed.mu:.2f}{rubs_as}" if packed.mu else "none known, or too few bytes"
    exchange.save_texture(packed, target)
    return {
        "speed and force": felt,
        "taps": taps,
        "friction": rubs,
        "spectrum": f"an AR model of order {packed.order}",
    }


def _retouch(source: Path, target: Path, scales: list[str], n_bytes: int | None) -> dict[str, str]:
    """Write a texture that feels otherwise on some scales, and return how it feels now."""
    from texclass.haptics import exchange
    from texclass.haptics.textures import felt_scales, retouch

    asked = options.named_numbers("--scale", scales, "SCALE=VALUE, rough=8")
    texture = exchange.load_texture(source)
    unit = exchange.describe(source)["unit"]
    retouched = retouch(texture, 128 if n_bytes is None else n_bytes, unit=unit, **asked)
    exchange.save_texture(retouched, target)
    before, after = felt_scales(texture), felt_scales(retouched)
    return {name: f"{before[name]:.1f} before, {after[name]:.1f} now" for name in after}


def _convert_texture(source: Path, target: Path, fs: float, order: int) -> dict[str, str]:
    """Write a texture as the other of the two kinds, and return what is lost."""
    from texclass.haptics import exchange
    from texclass.haptics.exchange.rendition import told_level

    if source.suffix.lower() == ".xml":
        exchange.save_texture(exchange.read_hatt(source), target)
        return {}
    texture, unit = exchange.load_texture(source), exchange.describe(source)["unit"]
    written = exchange.to_hatt(texture, unit=unit, fs=fs, order=order)
    exchange.write_hatt(written, target)
    if texture.family == "hatt":
        return {}
    meant = exchange.play_texture(texture, unit=unit)
    played = exchange.play_texture(written, speed=meant.speed, force=meant.force)
    return {
        "level": f"{told_level(played.samples, meant.samples)}, {meant.told}",
        "band": f"0 to {written.fs / 2:g} Hz of 0 to {texture.fs / 2:g} Hz",
        "models": f"{written.mesh.speed.size} of order {written.order}, strokes along +x",
    }


def _rendition(
    source: Path, surface: str | None, speed: float | None, force: float | None, seconds: float, seed: int
) -> "Rendition":
    """Return what a file holds, played; the surface is one of a scene or of taps."""
    from texclass.haptics.exchange import describe, load_taps, load_texture, play_taps, play_texture
    from texclass.haptics.exchange.rendition import TAP_M_S
    from texclass.haptics.scene import SceneSurface, load_scene
    from texclass.haptics.textures.okamura2001 import TapLibrary

    known = describe(source)
    if known["family"] == TapLibrary.family:
        taps = load_taps(source)
        if surface is not None:
            _check_surface(source, surface, list(taps))
            taps = TapLibrary((surface,), (taps[surface],), taps.unit)
        return play_taps(taps, velocity=TAP_M_S if speed is None else speed / 1000)
    texture: Playable
    if known["family"] == "scene":
        scene = load_scene(source)
        names = list(scene.assigned)
        name = names[0] if surface is None and len(names) == 1 else surface
        _check_surface(source, name, names)
        texture = SceneSurface(scene, str(name))
    elif surface is not None:
        raise ValueError(f"{source}: holds one texture; the rule is no --surface")
    else:
        texture = load_texture(source)
    return play_texture(texture, unit=known["unit"], speed=speed, force=force, seconds=seconds, seed=seed)


def _check_surface(source: Path, surface: str | None, names: list[str]) -> None:
    if surface not in names:
        raise ValueError(f"{source}: --surface is {surface!r}; the rule is one of {', '.join(names)}")


def _write_played(rendition: "Rendition", target: Path, physical: bool) -> dict[str, str]:
    """Write what was played, and return what is lost."""
    from texclass.haptics.exchange import write_ahap, write_hjif, write_wav

    match target.suffix.lower():
        case ".hjif":
            return write_hjif(rendition, target)
        case ".ahap":
            return write_ahap(rendition, target)
    encoding: Encoding = "float32" if physical else "audible"
    write_wav(target, rendition.samples, rendition.fs, unit=rendition.unit, encoding=encoding)
    return dict(rendition.lost)


def _read_played(source: Path, target: Path) -> dict[str, str]:
    """Write the texture of a file that is made to be played, and return what is lost."""
    from texclass.haptics.exchange import read_hjif, rendition_of, save_texture, texture_of

    played = rendition_of(read_hjif(source))
    texture, lost = texture_of(played)
    save_texture(texture, target, unit=played.unit)
    return lost


def _play_pattern(source: Path, target: Path, physical: bool) -> dict[str, str]:
    """Write what a pattern plays as WAV, and return what is lost."""
    from texclass.haptics.exchange import play_ahap, play_hjif, read_ahap, read_hjif, write_wav
    from texclass.haptics.exchange.hjif import FS

    encoding: Encoding = "float32" if physical else "audible"
    if source.suffix.lower() == ".hjif":
        haptics = read_hjif(source)
        vibrations = [
            one for one in haptics.perceptions if one.perception_modality.startswith("Vibrotactile")
        ]
        if not vibrations:
            raise ValueError(f"{source}: holds no vibration; the rule is a Vibrotactile perception")
        played = play_hjif(haptics.model_copy(update={"perceptions": tuple(vibrations)}))
        write_wav(target, played[:, 0] if played.shape[1] == 1 else played, FS, encoding=encoding)
        left = len(haptics.perceptions) - len(vibrations)
        return {"perceptions": f"{left} that are no vibrations"} if left else {}
    played = play_ahap(read_ahap(source), FS)
    write_wav(target, played, FS, unit="arbitrary", encoding=encoding)
    return {"unit": "AHAP has none: 1 is its full intensity"}
