"""Pages to be stroked in a browser: a planned scene, or one texture with sliders for how it feels.

`feel/kernels.js` is `render_kernels` again, function by function, and plays the same arrays (`packed`);
around it stand a worklet, which brings the samples to the loudspeaker's rate below a limit, and the page.
A page with sliders holds the texture as `retouch` makes it at some values of each scale, one scale at a time.
`feel/sliders.js` adds up what several do: at those values it plays what `texclass convert --scale` writes.
"""

import base64
import json
import shlex
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from texclass.atomic_write import check_suffix, write_atomic
from texclass.haptics.scales import SCALES
from texclass.haptics.scene.renderer import PlannedScene, packed
from texclass.haptics.textures import PackedTexture, Texture, measure_scales, retouch
from texclass.haptics.textures.grid import GridModel
from texclass.haptics.textures.packing import SPECTRAL_SCALES, scales_halfway
from texclass.reporting.page import templates
from texclass.vibration import DecayingModes, TapModel
from texclass.vibration.autoregressive import Autoregression

HIGHEST_FS = 44_100.0
"""Models are brought up to the rate of the loudspeaker, never down."""
N_CONTACTS = 5
"""Four pointers, and one for keys or a gamepad."""
LOUDEST = 4.0
"""Full scale, in parts of the RMS of the loudest surface at a middle speed and force."""
QUICK_M_S = 0.1
"""Impact velocity that belongs to a force of 1 N."""
VALUES = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0)
"""Of each scale, beside its own; of `hard`, which goes by a law, and of `sticky`, not heard, the ends."""
APART = 0.5
"""From the texture's own value, at least."""
BLEND_ERROR = 0.75
"""Largest error of any scale halfway between two values of a slider, where the page blends their models."""


def feel_page(
    scene: PlannedScene,
    *,
    taps: Mapping[str, TapModel | DecayingModes] | None = None,
    title: str = "",
    more: Mapping[str, Any] | None = None,
) -> str:
    """Return a planned scene as a page of HTML that needs no network.

    The pointer's speed and force drive the scene's models in an AudioWorklet; a press also taps.

    Parameters
    ----------
    scene : PlannedScene
        At most at 44.1 kHz.
    taps : mapping of str to TapModel or DecayingModes, optional
        Surface -> its tap, as a `TapLibrary` has them, in the scene's unit; modes are those of a tap of 0.1
        m/s. Surfaces without one get a guess: a tap that rings at the strongest resonance of the planned
        model.
    title : str
        The scene's name by default.
    more : mapping, optional
        What `slider_page` adds.

    Raises
    ------
    ValueError
        If the scene's rate is above 44.1 kHz.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.haptics.scene import PlannedScene, feel_page
    >>> from texclass.haptics.textures.grid import GridModel
    >>> model = GridModel(([40.0, 160.0], [1.0]), np.full((2, 1, 1), 0.5), [[1.0], [4.0]], 8.0)
    >>> scene = PlannedScene("desk", 1000.0, "m/s^2", (20.0, 450.0), 30.0, 1, {"wood": 0}, (model,))
    >>> "AudioWorklet" in feel_page(scene)
    True
    """
    if scene.fs > HIGHEST_FS:
        raise ValueError(
            f"scene {scene.name} has {scene.fs:g} Hz. Expected for a page at most {HIGHEST_FS:g}: "
            "plan it for a lower rate_hz"
        )
    folder = files(__package__).joinpath("feel")
    named = [name for name in ("kernels", "worklet", "sliders", "page") if more or name != "sliders"]
    scripts = {name: folder.joinpath(f"{name}.js").read_text(encoding="utf-8") for name in named}
    styles = files("texclass.reporting").joinpath("templates", "page.css"), folder.joinpath("page.css")
    bank, index = packed(scene)
    surfaces = [_surface(name, scene, taps or {}) for name in scene.assigned]
    heard = [one for one in surfaces if one["rms"] > 0]
    nodes = [np.array([one[key] for one in heard or surfaces[:1]]) for key in ("speeds", "forces")]
    ends = [(x.min(), x.max()) if x.min() < x.max() else (x.min() / 2, 2 * x.max()) for x in nodes]
    (slow, fast), (soft, hard) = ends
    speed, force = np.sqrt(slow * fast), np.sqrt(soft * hard)
    data = {
        "fs": scene.fs, "unit": _shown(scene.unit), "forces": (soft, hard), "surfaces": surfaces,
        "full": LOUDEST * max([one["rms"] for one in heard], default=1.0),
        "bank": base64.b64encode(bank.astype("<f8").tobytes()).decode(), "index": index.ravel().tolist(),
    }  # fmt: skip
    data |= more or {}
    if more:
        surfaces[0]["about"] = "as the sliders say"
    n_guessed = sum(one["guessed"] for one in surfaces)
    return templates("texclass.haptics.scene", "feel").get_template("page.html").render(
        title=title or f"Feel: {scene.name}",
        scene=scene,
        scales=(more or {}).get("scales", {}),
        unit=_shown(scene.unit),
        surfaces=surfaces,
        sliders=[
            ("volume", "Volume", -48, 0, 1, -18, "dB"),
            ("force", "Force without a pen", *(f"{x:.2g}" for x in (soft, hard)), 0.05, f"{force:.2g}", "N"),
            ("speed", "Speed of arrow keys", round(slow), round(fast), 1, round(speed), "mm/s"),
        ],
        tap_note="Taps are guessed from the textures: none was measured." if n_guessed == len(surfaces)
        else f"Taps were measured{f', but for {n_guessed} that are guessed' if n_guessed else ''}.",
        data=Markup(json.dumps(data).replace("<", "\\u003c")),
        scripts={name: Markup(text) for name, text in scripts.items()},
        style=Markup("\n".join(style.read_text(encoding="utf-8") for style in styles)),
        n_contacts=N_CONTACTS,
    )  # fmt: skip


def write_feel_page(
    path: str | Path,
    scene: PlannedScene,
    *,
    taps: Mapping[str, TapModel | DecayingModes] | None = None,
    title: str = "",
) -> Path:
    """Write what `feel_page` returns; a file of that name is replaced at once.

    Raises
    ------
    ValueError
        As `feel_page`, or if the name does not end in `.html`.
    """
    path = check_suffix(path, ".html")
    write_atomic(path, feel_page(scene, taps=taps, title=title).encode())
    return path


def slider_page(
    texture: Texture,
    *,
    file: str = "surface.texture",
    unit: str = "m/s^2",
    n_bytes: int = 128,
    progress: Callable[[int, int, str], None] | None = None,
) -> str:
    """Return a texture as a page of HTML with a slider for each scale that it has (see `measure_scales`).

    Parameters
    ----------
    texture : Texture
        As for `retouch`.
    file : str
        Its name in the command that the page says.
    unit : str
        Of the vibration.
    n_bytes : int
        Of each model; see `pack`.
    progress : callable, optional
        Called with (done, total, what).

    Raises
    ------
    ValueError
        If the texture cannot be retouched at all. What is out of reach shortens a slider.
    """
    felt = {name: round(value, 1) for name, value in measure_scales(texture).items()}
    base = retouch(texture, n_bytes, unit=unit, rough=felt["rough"])
    models, scales = [base], dict[str, Any]()
    for done, (name, value) in enumerate(felt.items()):
        if progress is not None:
            progress(done, len(felt), name)
        source = texture if name in SPECTRAL_SCALES else base
        found = _along(source, name, felt, base, n_bytes, unit)
        if len(found) == 1:  # nothing else is in reach
            continue
        scales[name] = {"value": value, "values": list(found), "end": SCALES[name].other_end}
        if name in SPECTRAL_SCALES:
            scales[name]["models"] = list(range(len(models), len(models) + len(found)))
            models += found.values()
        elif name == "hard":
            scales[name]["taps"] = [tap_modes(one.tap) for one in found.values()]
    grids = [one.model for one in (*models, base, base)]  # the last two take what is blended
    order = max(one.order for one in grids)
    grids = [replace(one, rows=np.pad(one.rows, [(0, 0), (0, 0), (0, order - one.order)])) for one in grids]
    name = texture.name or Path(file).stem
    scene = PlannedScene(name, base.fs, base.unit, (20.0, 0.45 * base.fs), 1e6, 1, {name: 0}, tuple(grids))
    command = f"texclass convert {shlex.quote(file)} -o changed.texture"
    command += f" --bytes {n_bytes}" if n_bytes != 128 else ""
    taps = {name: base.tap} if base.tap.n_modes else {}
    more = {"scales": scales, "command": command}
    return feel_page(scene, taps=taps, title=f"How {name} feels", more=more)


def write_slider_page(path: str | Path, texture: Texture, **given: Any) -> Path:
    """Write what `slider_page` returns; a file of that name is replaced at once.

    Raises
    ------
    ValueError
        As `slider_page`, or if the name does not end in `.html`.
    """
    path = check_suffix(path, ".html")
    write_atomic(path, slider_page(texture, **given).encode())
    return path


def tap_modes(tap: TapModel | DecayingModes) -> list[list[float]]:
    """Return amplitude per m/s, decay rate (1/s), frequency (Hz) and phase (rad, of a sine) of each mode."""
    modes = tap.modes(QUICK_M_S) if isinstance(tap, TapModel) else tap
    rows = modes.amplitude / QUICK_M_S, modes.decay_per_s, modes.frequency_hz, modes.phase + np.pi / 2
    return [[float(x) for x in row] for row in np.transpose(rows)]


def _surface(name: str, scene: PlannedScene, taps: Mapping[str, TapModel | DecayingModes]) -> dict[str, Any]:
    """Return what the page knows of a surface beside its model."""
    model = scene.model_of(name)
    middle = [float(np.sqrt(axis[0] * axis[-1])) for axis in model.axes]
    rms = float(np.sqrt(model.at(*([x] for x in middle))[1][0]))
    tap = taps[name] if name in taps else _guessed_tap(model, scene, middle, rms)
    parts = [f"AR of order {model.order}"] * bool(model.order) + [f"{model.n_lines} lines"] * bool(
        model.n_lines
    )
    where = f"{middle[0]:.0f}\u00a0mm/s and {middle[1]:.2g}\u00a0N"
    felt = f"{' + '.join(parts)}, {rms:.2g}\u00a0{_shown(scene.unit)} at {where}"
    return {
        "name": name,
        "model": scene.assigned[name],
        "speeds": (model.speeds[0], model.speeds[-1]),
        "forces": (model.forces[0], model.forces[-1]),
        "rms": rms,
        "tap": None if tap is None else tap_modes(tap),
        "guessed": name not in taps,
        "about": felt if parts else "too weak for the device to be felt",
    }


def _shown(unit: str) -> str:
    return unit.replace("^2", "²")


def _guessed_tap(model: GridModel, scene: PlannedScene, middle: list[float], rms: float) -> TapModel | None:
    """Return a tap at a model's strongest resonance: f of its largest power, B of its half-power width."""
    if model.kind == "silence" or not rms:
        return None
    row = model.at(*([x] for x in middle))[0][0]
    hz = np.linspace(*scene.band_hz, 500)
    if model.order:
        power = Autoregression(row[: model.order], np.ones(())).log_spectrum_db(2 * np.pi * hz / scene.fs)
        at, width = hz[np.argmax(power)], np.sum(power > power.max() - 3) * (hz[1] - hz[0])
    else:
        at, width = (model.frequency_hz + middle[0] * model.per_mm)[np.argmax(row)], 0.0
    decay = float(np.clip(np.pi * width, 20.0, 400.0))
    return TapModel(LOUDEST * rms / QUICK_M_S, decay, float(max(at, scene.band_hz[0], 1.0)))


def _along(
    texture: Texture, name: str, own: dict[str, float], base: PackedTexture, n_bytes: int, unit: str
) -> dict[float, PackedTexture]:
    """Return the texture at values of a scale, on both sides of its own.

    A side ends where a value is out of reach, or where the blend halfway to it (what the page plays between
    them) would change another scale.
    """
    value = own[name]
    found = {value: base}
    below = [v for v in reversed(VALUES) if v < value - APART]
    above = [v for v in VALUES if v > value + APART]
    for beyond in (below, above):
        at = value
        for v in beyond if name in SPECTRAL_SCALES else beyond[-1:]:
            try:
                one = retouch(texture, n_bytes, unit=unit, **{name: v})
            except ValueError:
                break
            if name in SPECTRAL_SCALES:
                halfway = scales_halfway(found[at], one)
                wanted = own | {name: (at + v) / 2}
                if any(
                    abs(halfway[scale] - wanted[scale]) > BLEND_ERROR for scale in halfway if scale in own
                ):
                    break
            found[at := v] = one
    return dict(sorted(found.items()))
