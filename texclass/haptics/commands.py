"""Commands that describe and render surfaces: describe, scene, texture (show, fit), convert."""

import json
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option
from typer.core import TyperGroup

from texclass.cli import parameters as p
from texclass.cli.app import app
from texclass.cli.output import SCENE_KERNELS, announce_start, print_lines, progress_bar, write_json
from texclass.haptics.fit_command import fit

if TYPE_CHECKING:
    from texclass.haptics.exchange import Equalizer, Rendition
    from texclass.haptics.exchange.rendition import Playable
    from texclass.haptics.exchange.wav import Encoding
    from texclass.haptics.scene import PlannedScene

TEXTURES, PATTERNS = (".texture", ".xml"), (".hjif", ".ahap")
"""Suffixes of textures, and of files with the vibration of a texture at one speed and force."""

scene = typer.Typer(no_args_is_help=True)

PlannedSceneName = Annotated[
    str,
    Argument(
        metavar="SCENE",
        help="Planned scene (.texture), or a scene to plan first: TOML file, or shipped scene "
        "(example, twenty).",
    ),
]
DeviceFile = Annotated[
    Path | None,
    Option(
        "--device",
        metavar="CSV",
        help="Frequency response of the device that plays the output (columns frequency in Hz, and gain or "
        "gain_db), which is compensated.",
    ),
]
MaxBoost = Annotated[
    float, Option("--max-boost", metavar="DB", help="Largest boost in dB that compensates --device.")
]
MAX_BOOST_DB = 20.0
"""Default of `read_response` in dB; importing it would load SciPy for `--help`."""
Physical = Annotated[
    bool, Option("--physical", help="Write 32-bit floats in the unit of the vibration, for haptic devices.")
]


@app.command(
    rich_help_panel="Recordings",
    epilog="Example: texclass describe recordings/oak/oak_01.txt --fs 10000 --unit m/s^2",
)
@p.with_reader_options
def describe(
    recordings: Annotated[list[str], Argument(help="Recordings: files, or DATASET:RECORDING.")],
    references: Annotated[
        str | None,
        Option(
            metavar="DATASET",
            help="Dataset of reference surfaces: shipped dataset, dataset card, or folder that needs no --fs "
            "(default: 100 simulated surfaces, stored with the program).",
            autocompletion=p.shipped_names("datasets"),
        ),
    ] = None,
    *,
    reader: p.Reader,
    jobs: p.Jobs = -1,
    json_file: p.JsonFile = None,
) -> None:
    """Rate surfaces on perceptual scales: hard, rough, bumpy, sticky, fine, regular.

    Each value from 0 to 10 is the rank of a feature among reference surfaces.
    """
    from texclass.loaders import find_recording

    loaded = [find_recording(name, **reader) for name in recordings]
    from texclass import haptics
    from texclass.reporting import print_document

    with progress_bar() as progress:
        description = haptics.describe(loaded, references, n_jobs=jobs, progress=progress)
    # pandas writes undefined values as null.
    rows = json.loads(description.to_json(orient="records"))
    write_json(json_file, json.dumps({"descriptions": rows}, indent=1))
    print_document(haptics.description_document(description))


@scene.command(epilog="Example: texclass scene plan example -o example.texture")
def plan(
    definition: Annotated[
        str, Argument(metavar="SCENE", help="Scene file (TOML), or shipped scene (example, twenty).")
    ] = "example",
    output: Annotated[
        Path | None,
        p.output_file(
            "--output", "-o", suffixes=[".texture"], help="Planned scene to write (default: SCENE.texture)."
        ),
    ] = None,
    report: Annotated[
        Path | None,
        p.output_folder(
            "--report", help="Folder for a report of the plan (Markdown) and a figure of the effect of speed."
        ),
    ] = None,
    json_file: p.JsonFile = None,
) -> None:
    """Select the cheapest model within the tolerance for each surface.

    The exit code is 1 if a surface is outside the tolerance, or if time or
    memory exceed the budget.
    """
    announce_start(*SCENE_KERNELS)
    from texclass.haptics.scene import plan_scene, read_scene
    from texclass.reporting import print_document, write_document

    scene_definition = read_scene(definition)
    with progress_bar() as progress:
        result = plan_scene(scene_definition, progress=progress)
    document = result.document()
    print_document(document)
    write_json(json_file, result.to_json())
    if report is not None:
        print_lines("wrote", write_document(document, report, scene_definition.source.stem))
    path = result.scene.save(output or Path(f"{scene_definition.source.stem}.texture"))
    typer.echo(f"wrote {path}, {path.stat().st_size} bytes")
    if not result.is_feasible:
        raise typer.Exit(1)


@scene.command(epilog="Example: texclass scene render example.texture -o example.wav")
def render(
    definition: PlannedSceneName,
    path: Annotated[
        Path | None,
        Argument(
            help="CSV file with time (s), x, y (mm), force (N), surface (default: a sweep over all surfaces)."
        ),
    ] = None,
    physical: Physical = False,
    shift: Annotated[
        float, Option(metavar="HZ", help="Shift the band up by 0 to 10000 Hz, to make it audible.")
    ] = 0.0,
    device: DeviceFile = None,
    max_boost: MaxBoost = MAX_BOOST_DB,
    seed: p.Seed = 0,
    output: Annotated[
        Path, p.output_file("--output", "-o", suffixes=[".wav"], help="WAV file to write.")
    ] = Path("scene.wav"),
) -> None:
    """Render a path over a scene to WAV, sample by sample, and measure the time per sample.

    By default, the WAV file is for listening: 48 kHz, 16 bit, normalised to
    full scale. The gain is printed and stored in the file.
    """
    from texclass.haptics.exchange import read_wav, write_wav
    from texclass.haptics.scene import default_path, read_path, render_path

    planned = _planned_scene(definition)
    hand_path = default_path(planned) if path is None else read_path(path)
    rendered = render_path(planned, hand_path, seed=seed)
    samples, equalizer = rendered.samples, _equalizer(device, max_boost)
    if equalizer is not None:
        _print_losses(equalizer.describe(samples, planned.fs))
        samples = equalizer.apply(samples, planned.fs)
    write_wav(
        output,
        samples,
        planned.fs,
        unit=planned.unit,
        encoding="float32" if physical else "audible",
        shift_hz=shift,
    )
    for line in rendered.summary_lines(planned):
        typer.echo(line)
    wav = read_wav(output)
    scale = f"; full scale is {wav.peak:.4g} {wav.unit}, gain {1 / max(wav.peak, 1e-300):.4g}"
    typer.echo(f"wrote {output}, {wav.fs:g} Hz{'' if physical else scale}")


@scene.command(epilog="Example: texclass scene page example.texture -o scene.html")
def page(
    definition: PlannedSceneName = "example",
    taps: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Tap library (.texture) with the same surface names (default: estimated taps).",
        ),
    ] = None,
    device: DeviceFile = None,
    max_boost: MaxBoost = MAX_BOOST_DB,
    output: Annotated[
        Path, p.output_file("--output", "-o", suffixes=[".html"], help="Page to write (.html).")
    ] = Path("scene.html"),
) -> None:
    """Write a self-contained HTML page on which you can stroke, tap and hear a scene.

    Speed and pressure of the pointer control the models of the plan.
    """
    announce_start(*SCENE_KERNELS)
    from texclass.haptics.exchange import load_taps
    from texclass.haptics.scene import write_scene_page

    library, equalizer = None if taps is None else load_taps(taps), _equalizer(device, max_boost)
    planned = _planned_scene(definition)
    path = write_scene_page(output, planned, taps=library, equalizer=equalizer)
    _describe_page(planned, equalizer)
    typer.echo(f"wrote {path}, {path.stat().st_size} bytes")


app.add_typer(
    scene,
    name="scene",
    rich_help_panel="Rendering",
    help="Select the cheapest models for a scene, and render it.",
)


def _equalizer(device: Path | None, max_boost: float) -> "Equalizer | None":
    from texclass.haptics.exchange import read_response

    return None if device is None else read_response(device, max_boost)


def _describe_page(planned: "PlannedScene", equalizer: "Equalizer | None") -> None:
    """Print the remaining error of each surface of a page on its device."""
    if equalizer is not None:
        from texclass.haptics.scene.pages import middle_stroke

        for name in planned.model_indices:
            losses = equalizer.describe(middle_stroke(planned, name), planned.fs)
            _print_losses({f"{name}, {topic}": text for topic, text in losses.items()})


def _print_losses(losses: dict[str, str]) -> None:
    from texclass.reporting import Document, print_document

    print_document(Document("Equalisation", [losses]))


def _planned_scene(definition: str) -> "PlannedScene":
    """Load a planned scene, or plan a scene file."""
    from texclass.haptics.scene import load_scene, plan_scene, read_scene

    if definition.endswith(".texture"):
        return load_scene(definition)
    with progress_bar() as progress:
        return plan_scene(read_scene(definition), progress=progress).scene


class ShowByDefault(TyperGroup):
    """Group of commands in which `texture FILE` is `texture show FILE`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Insert the name of the default command, unless the arguments begin with a command."""
        is_file = args and args[0] not in (*self.commands, "--help")
        return super().parse_args(ctx, ["show", *args] if is_file else args)


textures = typer.Typer(cls=ShowByDefault, no_args_is_help=True)
textures.command(
    epilog="Example: texclass texture fit oak.csv --speed-column v --force-column f -o oak.texture --page"
)(fit)


@textures.command("show", epilog="Example: texclass texture show wood.texture --page wood.html")
def texture(
    file: Annotated[Path, Argument(help="Texture (.texture or HaTT .xml).")],
    page_file: Annotated[
        Path | None,
        p.output_file(
            "--page",
            suffixes=[".html"],
            help="Also write a page on which you can stroke and hear the texture.",
        ),
    ] = None,
    slider_file: Annotated[
        Path | None,
        p.output_file(
            "--sliders",
            suffixes=[".html"],
            help="Also write a page with one slider per scale of `texclass describe`.",
        ),
    ] = None,
    device: DeviceFile = None,
    max_boost: MaxBoost = MAX_BOOST_DB,
    json_file: p.JsonFile = None,
) -> None:
    """Show the properties of a texture: family, range of speed and force, order, sampling rate, unit.

    The word `show` can be omitted: `texclass texture wood.texture`.
    """
    from texclass.haptics.exchange import describe
    from texclass.reporting import Document, print_document

    facts = describe(file)
    print_document(Document(str(file), [{key: _as_text(value) for key, value in facts.items()}]))
    write_json(json_file, json.dumps(facts, indent=1))
    equalizer = _equalizer(device, max_boost)
    if equalizer is not None and page_file is None and slider_file is None:
        raise ValueError("--device applies to pages: add --page or --sliders, or use texclass convert")
    if page_file is not None:
        from texclass.haptics.scene import scene_of_file, write_scene_page
        from texclass.haptics.scene.pages import MAX_FS

        with progress_bar() as progress:
            planned, taps, _ = scene_of_file(file, max_fs=MAX_FS, progress=progress)
        write_scene_page(page_file, planned, taps=taps, equalizer=equalizer)
        _describe_page(planned, equalizer)
        typer.echo(f"wrote {page_file}, {page_file.stat().st_size} bytes")
    if slider_file is not None:
        from texclass.haptics.exchange import load_texture
        from texclass.haptics.scene import write_slider_page

        loaded = load_texture(file)
        with progress_bar() as progress:
            write_slider_page(
                slider_file,
                loaded,
                file=file.name,
                unit=facts["unit"],
                equalizer=equalizer,
                progress=progress,
            )
        typer.echo(f"wrote {slider_file}, {slider_file.stat().st_size} bytes")


app.add_typer(
    textures,
    name="texture",
    rich_help_panel="Rendering",
    help="Show the properties of a texture, or fit a texture to recordings.",
)


def _as_text(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_as_text(inner)}" for name, inner in value.items())
    if isinstance(value, list) and value and isinstance(value[0], float):
        return " to ".join(f"{end:.4g}" for end in value)
    if isinstance(value, list):
        return " x ".join(map(str, value)) or "number"
    return "-" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


@app.command(
    rich_help_panel="Rendering",
    epilog="Example: texclass convert wood.texture -o wood.hjif --speed 80 --force 1",
)
def convert(
    source: Annotated[
        Path,
        Argument(
            help="Texture, taps or scene (.texture), HaTT model (.xml) or pattern (.hjif, .ahap); with "
            "--bytes, a texture or a recording."
        ),
    ],
    *,
    n_bytes: Annotated[
        int | None,
        Option("--bytes", metavar="N", help="Pack a texture or a recording into a .texture of N bytes."),
    ] = None,
    scale: Annotated[
        list[str] | None,
        Option(
            metavar="SCALE=VALUE",
            help="Set a texture's value on a scale of `texclass describe` (repeatable): rough=8, "
            "bumpy=2, fine=5, "
            "regular=4; hard=7 if the texture has a tap, sticky=3 if it has friction.",
        ),
    ] = None,
    fs: Annotated[
        float | None,
        Option(
            metavar="HZ",
            help="Sampling rate of the models in .xml (default: 1000), or of a recording whose file "
            "states none.",
        ),
    ] = None,
    unit: Annotated[
        str | None, Option(metavar="UNIT", help="Unit of a recording: m/s^2, g, mg, counts, V or arbitrary.")
    ] = None,
    resample: p.Resample = None,
    order: Annotated[
        int, Option(min=1, max=100, metavar="N", help="Largest order of the models in .xml.")
    ] = 20,
    surface: Annotated[
        str | None, Option(metavar="NAME", help="Surface of a scene or of taps (default for taps: all).")
    ] = None,
    speed: Annotated[
        float | None,
        Option(
            metavar="MM/S",
            help="Speed at which the vibration is rendered (default: the middle of the texture's range).",
        ),
    ] = None,
    force: Annotated[
        float | None,
        Option(
            metavar="NEWTON",
            help="Force at which the vibration is rendered (default: the middle of the texture's range).",
        ),
    ] = None,
    duration: Annotated[float, Option(metavar="S", help="Duration of the vibration, at most 30 s.")] = 2.0,
    full_scale: Annotated[
        float | None,
        Option(
            "--full-scale",
            metavar="LEVEL",
            help="RMS (taps: peak) of intensity 1 in .ahap, in the unit of the vibration (default: the "
            "strongest moment of the file). Use one value for files that are compared.",
        ),
    ] = None,
    physical: Physical = False,
    device: DeviceFile = None,
    max_boost: MaxBoost = MAX_BOOST_DB,
    seed: p.Seed = 0,
    output: Annotated[
        Path,
        p.output_file(
            "--output",
            "-o",
            suffixes=[*TEXTURES, *PATTERNS, ".wav", ".h"],
            help="File to write: .texture, .xml, .hjif, .ahap, .wav or .h.",
        ),
    ],
) -> None:
    """Convert a surface to the format of another device, and list the losses.

    .texture and HaTT .xml contain a texture for all speeds and forces. MPEG
    haptics (.hjif), Apple patterns (.ahap) and WAV contain its vibration at one
    speed and force. A C header (.h) contains all speeds and forces, for devices.
    Patterns can be rendered to WAV. A .hjif file can be
    converted to a texture if it contains one.
    """
    scales = p.numbers_by_name("--scale", scale)
    if resample is not None and n_bytes is None:
        raise typer.BadParameter("--resample applies to a recording, which requires --bytes")
    from texclass.reporting import Document, print_document

    kinds = source.suffix.lower(), output.suffix.lower()
    equalizer = _equalizer(device, max_boost)
    if equalizer is not None and kinds[1] not in (".wav", ".hjif"):
        raise ValueError(
            f"--device applies to .wav and .hjif, and to pages (texclass texture --page), got {output.name}"
        )
    if full_scale is not None and kinds[1] != ".ahap":
        raise ValueError(f"--full-scale applies to .ahap, got {output.name}")
    if scales:
        losses = _retouch(source, output, scales, n_bytes)
    elif n_bytes is not None:
        losses = _pack(source, output, n_bytes, fs, unit, resample)
    elif kinds[0] in PATTERNS and kinds[1] in (".wav", ".texture") and kinds != (".ahap", ".texture"):
        try:
            is_wav = kinds[1] == ".wav"
            losses = (
                _render_pattern(source, output, physical, equalizer)
                if is_wav
                else _read_texture(source, output)
            )
        except ValueError as error:  # the readers of patterns do not name the file
            raise ValueError(str(error) if str(source) in str(error) else f"{source}: {error}") from error
    elif kinds[0] in TEXTURES and kinds[1] in (*PATTERNS, ".wav"):
        rendition = _rendition(source, surface, speed, force, duration, seed)
        losses = _write_rendition(rendition, output, physical, equalizer, full_scale)
    elif kinds[0] in TEXTURES and kinds[1] == ".h":
        losses = _write_c_header(source, output)
    elif kinds in {(".xml", ".texture"), (".texture", ".xml")}:
        losses = _convert_texture(source, output, 1000.0 if fs is None else fs, order)
    else:
        raise ValueError(
            f"cannot convert {source} to {output.name}. Expected .texture to .xml, .hjif, .ahap, .wav or "
            ".h; .xml to .texture, .hjif, .ahap, .wav or .h; .hjif to .texture or .wav; or .ahap to .wav"
        )
    typer.echo(f"wrote {output}, {output.stat().st_size} bytes")
    if losses:
        print_document(Document("Perceptual scales" if scales else "Losses of the conversion", [losses]))


def _pack(
    source: Path, target: Path, n_bytes: int, fs: float | None, unit: str | None, resample: float | None
) -> dict[str, str]:
    """Write a texture or a recording as a packed texture of `n_bytes`, and return the losses."""
    from texclass.haptics import exchange
    from texclass.haptics.textures import pack
    from texclass.haptics.textures.contract import stroke_range
    from texclass.loaders import load_recording

    if source.suffix.lower() in TEXTURES:
        loaded = exchange.load_texture(source)
        packed = pack(loaded, n_bytes, unit=exchange.describe(source)["unit"])
        (slow, fast), (light, hard) = stroke_range(loaded)
        validity = f"{slow:.4g} to {fast:.4g} mm/s, {light:.4g} to {hard:.4g} N"
        taps = "none in the texture, or too few bytes"
        friction = ""
    else:
        packed = pack(load_recording(source, fs=fs, unit=unit, resample=resample), n_bytes, name=source.stem)
        validity = "speeds and forces of the recording"
        taps = "none detected, or too few bytes"
        friction = ", in the unit of the recording's channel; devices interpret it as a friction coefficient"
    if packed.model.speeds.size > 1:
        conditions = f"{validity}: level as a function of speed and force, two spectra"
    else:
        conditions = "one spectrum and one level for all speeds and forces"
    if n_modes := packed.tap.n_modes:
        taps = f"one tap of medium hardness, as {n_modes} decaying sinusoids"
    exchange.save_texture(packed, target)
    return {
        "speed and force": conditions,
        "taps": taps,
        "friction": f"{packed.mu:.2f}{friction}" if packed.mu else "unknown, or too few bytes",
        "spectrum": f"an AR model of order {packed.order}",
    }


def _retouch(source: Path, target: Path, scales: dict[str, float], n_bytes: int | None) -> dict[str, str]:
    """Write a texture with new values on some scales, and return the old and new values of all scales."""
    from texclass.haptics import exchange
    from texclass.haptics.scales import SCALES
    from texclass.haptics.textures import measure_scales, retouch

    if unknown := ", ".join(name for name in scales if name not in SCALES):
        raise ValueError(f"--scale: unknown scale {unknown}. Expected one of {', '.join(SCALES)}")

    texture = exchange.load_texture(source)
    unit = exchange.describe(source)["unit"]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        retouched = retouch(texture, 128 if n_bytes is None else n_bytes, unit=unit, **scales)
    for warning in caught:
        typer.echo(f"notice: {warning.message}", err=True)
    exchange.save_texture(retouched, target)
    old_values, new_values = measure_scales(texture), measure_scales(retouched)
    return {name: f"{old_values[name]:.1f} before, {new_values[name]:.1f} now" for name in new_values}


def _convert_texture(source: Path, target: Path, fs: float, order: int) -> dict[str, str]:
    """Convert between .texture and HaTT .xml, and return the losses."""
    from texclass.haptics import exchange
    from texclass.haptics.exchange.rendition import describe_level_change

    if source.suffix.lower() == ".xml":
        exchange.save_texture(exchange.read_hatt(source), target)
        return {}
    texture, unit = exchange.load_texture(source), exchange.describe(source)["unit"]
    hatt = exchange.to_hatt(texture, unit=unit, fs=fs, order=order)
    exchange.write_hatt(hatt, target)
    if texture.family == "hatt":
        return {}
    original = exchange.play_texture(texture, unit=unit)
    converted = exchange.play_texture(hatt, speed=original.speed, force=original.force)
    return {
        "level": f"{describe_level_change(converted.samples, original.samples)}, {original.caption}",
        "band": f"0 to {hatt.fs / 2:g} Hz of 0 to {texture.fs / 2:g} Hz",
        "models": f"{hatt.mesh.speed.size} of order {hatt.order}, strokes along +x",
    }


def _rendition(
    source: Path, surface: str | None, speed: float | None, force: float | None, seconds: float, seed: int
) -> "Rendition":
    """Return the vibration of a texture, of taps, or of one surface of a scene."""
    from texclass.haptics.exchange import describe, load_taps, load_texture, play_taps, play_texture
    from texclass.haptics.exchange.rendition import TAP_M_S
    from texclass.haptics.scene import SceneSurface, load_scene
    from texclass.haptics.textures.okamura2001 import TapLibrary

    facts = describe(source)
    if facts["family"] == TapLibrary.family:
        taps = load_taps(source)
        if surface is not None:
            _check_surface(source, surface, list(taps))
            taps = TapLibrary((surface,), (taps[surface],), taps.unit)
        return play_taps(taps, velocity=TAP_M_S if speed is None else speed / 1000)
    texture: Playable
    if facts["family"] == "scene":
        scene = load_scene(source)
        names = list(scene.model_indices)
        name = names[0] if surface is None and len(names) == 1 else surface
        _check_surface(source, name, names)
        texture = SceneSurface(scene, str(name))
    elif surface is not None:
        raise ValueError(f"{source} contains a single texture, but --surface is {surface!r}. Omit --surface")
    else:
        texture = load_texture(source)
    return play_texture(texture, unit=facts["unit"], speed=speed, force=force, seconds=seconds, seed=seed)


def _check_surface(source: Path, surface: str | None, names: list[str]) -> None:
    if surface not in names:
        raise ValueError(f"{source}: --surface must be one of {', '.join(names)}, got {surface!r}")


def _write_rendition(
    rendition: "Rendition",
    target: Path,
    physical: bool,
    equalizer: "Equalizer | None",
    full_scale: float | None,
) -> dict[str, str]:
    """Write a vibration in the format of the suffix, and return the losses."""
    from texclass.haptics.exchange import equalize, write_ahap, write_hjif, write_wav

    if equalizer is not None:
        rendition = equalize(rendition, equalizer)
    match target.suffix.lower():
        case ".hjif":
            return write_hjif(rendition, target)
        case ".ahap":
            return write_ahap(rendition, target, full_scale=full_scale)
    encoding: Encoding = "float32" if physical else "audible"
    write_wav(target, rendition.samples, rendition.fs, unit=rendition.unit, encoding=encoding)
    return dict(rendition.losses)


def _write_c_header(source: Path, target: Path) -> dict[str, str]:
    """Write a texture, taps or a scene as a C header next to its renderer, and return the losses."""
    from texclass.haptics.scene import scene_of_file, write_c_header

    with progress_bar() as progress:
        scene, taps, losses = scene_of_file(source, progress=progress)
    _, renderer = write_c_header(target, scene, taps=taps)
    typer.echo(f"wrote {renderer}, {renderer.stat().st_size} bytes")
    return losses


def _read_texture(source: Path, target: Path) -> dict[str, str]:
    """Write the texture in a .hjif file, and return the losses."""
    from texclass.haptics.exchange import read_hjif, save_texture, to_rendition, to_texture

    rendition = to_rendition(read_hjif(source))
    texture, losses = to_texture(rendition)
    save_texture(texture, target, unit=rendition.unit)
    return losses


def _render_pattern(
    source: Path, target: Path, physical: bool, equalizer: "Equalizer | None"
) -> dict[str, str]:
    """Render a .hjif or .ahap pattern to WAV, and return the losses."""
    from texclass.haptics.exchange import play_ahap, play_hjif, read_ahap, read_hjif, write_wav
    from texclass.haptics.exchange.hjif import FS

    encoding: Encoding = "float32" if physical else "audible"
    if source.suffix.lower() == ".hjif":
        haptics = read_hjif(source)
        vibrations = [p for p in haptics.perceptions if p.perception_modality.startswith("Vibrotactile")]
        if not vibrations:
            raise ValueError(f"{source} contains no vibration. Expected at least one Vibrotactile perception")
        samples = play_hjif(haptics.model_copy(update={"perceptions": tuple(vibrations)}))
        samples = samples[:, 0] if samples.shape[1] == 1 else samples
        n_dropped, unit = len(haptics.perceptions) - len(vibrations), "m/s^2"
        losses = {"perceptions": f"{n_dropped} other than vibrations omitted"} if n_dropped else {}
    else:
        samples, unit = play_ahap(read_ahap(source), FS), "arbitrary"
        losses = {"unit": "AHAP has no unit: 1 is its full intensity"}
    if equalizer is not None:
        losses |= equalizer.describe(samples if samples.ndim == 1 else samples[:, 0], FS)
        samples = equalizer.apply(samples, FS)
    write_wav(target, samples, FS, unit=unit, encoding=encoding)
    return losses
