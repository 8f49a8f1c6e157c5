"""Write HTML pages on which users stroke a planned scene, or one texture with sliders, in a browser.

`web/kernels.js` contains the functions of `render_kernels` in JavaScript and renders the same arrays, see
`build_kernel_arrays`. A worklet resamples the vibration to the sampling rate of the loudspeaker and limits
its level. A page with sliders contains the models that `retouch` returns at some values of each scale, and
`web/sliders.js` interpolates between these values. At the values themselves the page renders the same
texture that `texclass convert --scale` writes.
"""

import base64
import json
import shlex
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from texclass.atomic_write import check_suffix, write_atomic
from texclass.haptics.scales import SCALES
from texclass.haptics.scene.renderer import PlannedScene, SceneSurface, build_kernel_arrays
from texclass.haptics.textures.contract import (
    NOMINAL_FORCE_N,
    NOMINAL_SPEED_MM_S,
    Texture,
    constant_stroke,
)
from texclass.haptics.textures.grid import GridModel
from texclass.recording import Samples
from texclass.reporting.page import templates
from texclass.vibration import DecayingModes, TapModel
from texclass.vibration.autoregressive import Autoregression

if TYPE_CHECKING:
    from texclass.haptics.exchange import Equalizer
    from texclass.haptics.textures import PackedTexture

MAX_FS = 44_100.0
"""Largest sampling rate of a scene in Hz; the worklet can only upsample, to the rate of the loudspeaker."""
N_CONTACTS = 5
"""Number of contacts: four pointers, and one contact for the keyboard or a gamepad."""
FULL_SCALE_FACTOR = 4.0
"""Ratio of full scale to the RMS of the strongest surface at medium speed and force."""
TAP_FS = 8000.0
"""Smallest sampling rate in Hz of the filter that equalises taps."""
TAP_M_S_PER_N = 0.1
"""Impact velocity of a tap per unit of pointer force, in m/s per N."""
SLIDER_VALUES = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0)
"""Values of each scale for which a page contains a model, in addition to the texture's own value. Only the
two ends are used for `hard`, which has a closed form, and for `sticky`, which is not audible."""
MIN_DISTANCE = 0.5
"""Smallest distance between a slider value and the texture's own value."""
MAX_BLEND_ERROR = 0.75
"""Largest accepted error of any scale halfway between two slider values, where the page interpolates."""


def scene_page(
    scene: PlannedScene,
    *,
    taps: Mapping[str, TapModel | DecayingModes] | None = None,
    title: str = "",
    equalizer: "Equalizer | None" = None,
    sliders: Mapping[str, Any] | None = None,
) -> str:
    """Return a self-contained HTML page on which users stroke the surfaces of a planned scene.

    Speed and force of the pointer control the models in an AudioWorklet. Pressing a surface also taps it.

    Parameters
    ----------
    scene : PlannedScene
        Scene with a sampling rate of at most 44.1 kHz.
    taps : mapping of str to TapModel or DecayingModes, optional
        Tap of each surface, in the unit of the scene; `DecayingModes` describe a tap at 0.1 m/s. If a surface
        is missing, its tap is estimated from the strongest resonance of its model.
    title : str
        Title of the page (default: from the name of the scene).
    equalizer : Equalizer, optional
        Inverse of the response of the device that plays the page (default: no equalisation), see
        `texclass.haptics.exchange.read_response`.
    sliders : mapping, optional
        Perceptual scales and command line, as set by `slider_page`.

    Returns
    -------
    str
        The page.

    Raises
    ------
    ValueError
        If the sampling rate of the scene is above 44.1 kHz.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.haptics.scene import PlannedScene, scene_page
    >>> from texclass.haptics.textures.grid import GridModel
    >>> model = GridModel(([40.0, 160.0], [1.0]), np.full((2, 1, 1), 0.5), [[1.0], [4.0]], 8.0)
    >>> scene = PlannedScene("desk", 1000.0, "m/s^2", (20.0, 450.0), 30.0, 1, {"wood": 0}, (model,))
    >>> "AudioWorklet" in scene_page(scene)
    True
    """
    if scene.fs > MAX_FS:
        raise ValueError(
            f"scene {scene.name}: sampling rate must be at most {MAX_FS:g} Hz for a page, got "
            f"{scene.fs:g} Hz. Plan the scene with a lower device.rate_hz"
        )
    folder = files(__package__).joinpath("web")
    script_names = [
        name for name in ("kernels", "worklet", "sliders", "page") if sliders or name != "sliders"
    ]
    scripts = {name: folder.joinpath(f"{name}.js").read_text(encoding="utf-8") for name in script_names}
    styles = files("texclass.reporting").joinpath("templates", "page.css"), folder.joinpath("page.css")
    bank, index = build_kernel_arrays(scene)
    surfaces = [_surface(name, scene, taps or {}, equalizer) for name in scene.model_indices]
    audible = [surface for surface in surfaces if surface["rms"] > 0]
    nodes = [np.array([surface[key] for surface in audible or surfaces[:1]]) for key in ("speeds", "forces")]
    # a model of one speed or force is constant above it
    nominal = [
        max(x.max(), typical) for x, typical in zip(nodes, (NOMINAL_SPEED_MM_S, NOMINAL_FORCE_N), strict=True)
    ]
    ranges = [
        (x.min(), x.max()) if x.min() < x.max() else (typical / 2, 2 * typical)
        for x, typical in zip(nodes, nominal, strict=True)
    ]
    (slow, fast), (soft, hard) = ranges
    speed, force = np.sqrt(slow * fast), np.sqrt(soft * hard)
    data = {
        "fs": scene.fs, "unit": _display_unit(scene.unit), "forces": (soft, hard), "surfaces": surfaces,
        "full_scale": FULL_SCALE_FACTOR * max([surface["output_rms"] for surface in audible], default=1.0),
        "bank": base64.b64encode(bank.astype("<f8").tobytes()).decode(), "index": index.ravel().tolist(),
    }  # fmt: skip
    if equalizer is not None:
        data["equalizer"] = equalizer.taps(scene.fs).tolist()
    data |= sliders or {}
    if sliders:
        surfaces[0]["description"] = "set by the sliders"
    n_estimated = sum(surface["is_tap_estimated"] for surface in surfaces)
    if n_estimated == len(surfaces):
        tap_note = "Taps are estimated from the textures."
    else:
        tap_note = f"Taps were measured{f', except {n_estimated} that are estimated' if n_estimated else ''}."
    return templates("texclass.haptics.scene", "web").get_template("page.html").render(
        title=title or f"Surfaces: {scene.name}",
        scene=scene,
        scales=(sliders or {}).get("scales", {}),
        unit=_display_unit(scene.unit),
        surfaces=surfaces,
        sliders=[
            ("volume", "Volume", -48, 0, 1, -18, "dB"),
            ("force", "Force without a pen", *(f"{x:.2g}" for x in (soft, hard)), 0.05, f"{force:.2g}", "N"),
            ("speed", "Speed of arrow keys", round(slow), round(fast), 1, round(speed), "mm/s"),
        ],
        tap_note=tap_note,
        data=Markup(json.dumps(data).replace("<", "\\u003c")),
        scripts={name: Markup(text) for name, text in scripts.items()},
        style=Markup("\n".join(style.read_text(encoding="utf-8") for style in styles)),
        n_contacts=N_CONTACTS,
    )  # fmt: skip


def write_scene_page(
    path: str | Path,
    scene: PlannedScene,
    *,
    taps: Mapping[str, TapModel | DecayingModes] | None = None,
    title: str = "",
    equalizer: "Equalizer | None" = None,
) -> Path:
    """Write the page of `scene_page` to a file; an existing file is replaced.

    Parameters
    ----------
    path : str or Path
        File name ending in `.html`.
    scene, taps, title, equalizer
        Arguments of `scene_page`.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    ValueError
        If the name does not end in `.html`, or the sampling rate of the scene is above 44.1 kHz.

    Examples
    --------
    >>> import tempfile
    >>> from texclass.haptics.scene import PlannedScene, write_scene_page
    >>> from texclass.haptics.textures.grid import GridModel
    >>> scene = PlannedScene(
    ...     "desk", 1000.0, "m/s^2", (20.0, 450.0), 30.0, 1, {"oak": 0}, (GridModel.silence(),)
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_scene_page(f"{folder}/desk.html", scene).name
    'desk.html'
    """
    path = check_suffix(path, ".html")
    write_atomic(path, scene_page(scene, taps=taps, title=title, equalizer=equalizer).encode())
    return path


def slider_page(
    texture: Texture,
    *,
    file: str = "surface.texture",
    unit: str = "m/s^2",
    n_bytes: int = 128,
    equalizer: "Equalizer | None" = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> str:
    """Return an HTML page of a texture with a slider for each of its perceptual scales.

    Parameters
    ----------
    texture : Texture
        Texture to change, see `retouch`.
    file : str
        File name of the texture in the displayed command (default "surface.texture").
    unit : str
        Unit of the vibration (default "m/s^2").
    n_bytes : int
        Size of each model in bytes (default 128), see `pack`.
    equalizer : Equalizer, optional
        See `scene_page`.
    progress : callable, optional
        Callback `progress(n_done, n_total, name)`; `name` is the next scale.

    Returns
    -------
    str
        The page. A slider covers only values that `retouch` can reach.

    Raises
    ------
    ValueError
        If the texture cannot be changed on any scale.
    """
    from texclass.haptics.textures import packing

    own_values = {name: round(value, 1) for name, value in packing.measure_scales(texture).items()}
    base = packing.retouch(texture, n_bytes, unit=unit, rough=own_values["rough"])
    models, scales = [base], dict[str, Any]()
    for n_done, (name, value) in enumerate(own_values.items()):
        if progress is not None:
            progress(n_done, len(own_values), name)
        source = texture if name in packing.SPECTRAL_SCALES else base
        variants = _slider_variants(source, name, own_values, base, n_bytes, unit)
        if len(variants) == 1:  # no other value can be reached
            continue
        scales[name] = {"value": value, "values": list(variants), "low_end": SCALES[name].low_end}
        if name in packing.SPECTRAL_SCALES:
            scales[name]["models"] = list(range(len(models), len(models) + len(variants)))
            models += variants.values()
        elif name == "hard":
            scales[name]["taps"] = [tap_modes(variant.tap, equalizer) for variant in variants.values()]
    grids = [packed.model for packed in (*models, base, base)]  # the page overwrites the last two
    order = max(grid.order for grid in grids)
    grids = [replace(g, rows=np.pad(g.rows, [(0, 0), (0, 0), (0, order - g.order)])) for g in grids]
    name = texture.name or Path(file).stem
    scene = PlannedScene(name, base.fs, base.unit, (20.0, 0.45 * base.fs), 1e6, 1, {name: 0}, tuple(grids))
    command = f"texclass convert {shlex.quote(file)} -o changed.texture"
    command += f" --bytes {n_bytes}" if n_bytes != 128 else ""
    taps = {name: base.tap} if base.tap.n_modes else {}
    sliders = {"scales": scales, "command": command}
    title = f"Perceptual scales of {name}"
    return scene_page(scene, taps=taps, title=title, equalizer=equalizer, sliders=sliders)


def write_slider_page(
    path: str | Path,
    texture: Texture,
    *,
    file: str = "surface.texture",
    unit: str = "m/s^2",
    n_bytes: int = 128,
    equalizer: "Equalizer | None" = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> Path:
    """Write the page of `slider_page` to a file; an existing file is replaced.

    Parameters
    ----------
    path : str or Path
        File name ending in `.html`.
    texture : Texture
        Texture to change.
    file, unit, n_bytes, equalizer, progress : optional
        See `slider_page`.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    ValueError
        If the name does not end in `.html`, or the texture cannot be changed on any scale.

    Examples
    --------
    >>> from texclass.haptics.scene import write_slider_page
    >>> from texclass.haptics.textures import pack
    >>> texture = pack(np.random.default_rng(0).standard_normal(4000), n_bytes=32, fs=1000)
    >>> write_slider_page("oak.htm", texture)
    Traceback (most recent call last):
    ValueError: cannot write oak.htm: the suffix is '.htm'. Expected .html
    """
    path = check_suffix(path, ".html")
    page = slider_page(texture, file=file, unit=unit, n_bytes=n_bytes, equalizer=equalizer, progress=progress)
    write_atomic(path, page.encode())
    return path


def tap_modes(tap: TapModel | DecayingModes, equalizer: "Equalizer | None" = None) -> list[list[float]]:
    """Return amplitude per m/s, decay rate (1/s), frequency (Hz) and phase (rad, of a sine) of each mode."""
    modes = tap.modes(TAP_M_S_PER_N) if isinstance(tap, TapModel) else tap
    hz = modes.frequency_hz
    gain = (
        np.ones(hz.size) if equalizer is None else equalizer.gain_at(hz, max(TAP_FS, 2.5 * hz.max(initial=0)))
    )
    amplitude, phase = modes.amplitude * np.abs(gain), modes.phase + np.angle(gain)
    rows = amplitude / TAP_M_S_PER_N, modes.decay_per_s, hz, phase + np.pi / 2
    return [[float(x) for x in row] for row in np.transpose(rows)]


def _surface(
    name: str,
    scene: PlannedScene,
    taps: Mapping[str, TapModel | DecayingModes],
    equalizer: "Equalizer | None",
) -> dict[str, Any]:
    """Return the data of a surface for the page, except its model."""
    model = scene.model_of(name)
    middle = [float(np.sqrt(axis[0] * axis[-1])) for axis in model.axes]
    rms = float(np.sqrt(model.at(*([x] for x in middle))[1][0]))
    tap = taps[name] if name in taps else _estimate_tap(model, scene, middle, rms)
    output_rms = rms
    if equalizer is not None and rms:
        output_rms = float(equalizer.apply(middle_stroke(scene, name), scene.fs).std())
    components = [f"AR of order {model.order}"] if model.order else []
    components += [f"{model.n_lines} lines"] if model.n_lines else []
    conditions = f"{middle[0]:.0f}\u00a0mm/s and {middle[1]:.2g}\u00a0N"
    level = f"{rms:.2g}\u00a0{_display_unit(scene.unit)}"
    return {
        "name": name,
        "model": scene.model_indices[name],
        "speeds": (model.speeds[0], model.speeds[-1]),
        "forces": (model.forces[0], model.forces[-1]),
        "rms": rms,
        "output_rms": output_rms,
        "tap": None if tap is None else tap_modes(tap, equalizer),
        "is_tap_estimated": name not in taps,
        "description": f"{' + '.join(components)}, {level} at {conditions}"
        if components
        else "too weak for the device",
    }


def middle_stroke(scene: PlannedScene, name: str) -> Samples:
    """Return 2 s of the vibration of a surface at the middle of its speeds and forces."""
    surface = SceneSurface(scene, name)
    speed, force = (float(np.sqrt(axis[0] * axis[-1])) for axis in (surface.speeds, surface.forces))
    return constant_stroke(surface, speed, force, round(2 * scene.fs), n_settling=round(0.5 * scene.fs))


def _display_unit(unit: str) -> str:
    return unit.replace("^2", "²")


def _estimate_tap(model: GridModel, scene: PlannedScene, middle: list[float], rms: float) -> TapModel | None:
    """Estimate a tap from the strongest resonance of a model; its half-power bandwidth sets the decay."""
    if model.kind == "silence" or not rms:
        return None
    row = model.at(*([x] for x in middle))[0][0]
    hz = np.linspace(*scene.band_hz, 500)
    if model.order:
        power = Autoregression(row[: model.order], np.ones(())).log_spectrum_db(2 * np.pi * hz / scene.fs)
        resonance_hz, bandwidth_hz = hz[np.argmax(power)], np.sum(power > power.max() - 3) * (hz[1] - hz[0])
    else:
        resonance_hz = (model.frequency_hz + middle[0] * model.per_mm)[np.argmax(row)]
        bandwidth_hz = 0.0
    decay_per_s = float(np.clip(np.pi * bandwidth_hz, 20.0, 400.0))
    amplitude = FULL_SCALE_FACTOR * rms / TAP_M_S_PER_N
    return TapModel(amplitude, decay_per_s, float(max(resonance_hz, scene.band_hz[0], 1.0)))


def _slider_variants(
    texture: Texture, name: str, own_values: dict[str, float], base: "PackedTexture", n_bytes: int, unit: str
) -> dict[float, "PackedTexture"]:
    """Return the texture at several values of a scale, below and above its own value.

    Each direction stops before the first value that cannot be reached, or for which interpolating halfway
    would change another scale.
    """
    from texclass.haptics.textures import packing

    own_value = own_values[name]
    variants = {own_value: base}
    lower = [v for v in reversed(SLIDER_VALUES) if v < own_value - MIN_DISTANCE]
    higher = [v for v in SLIDER_VALUES if v > own_value + MIN_DISTANCE]
    for side in (lower, higher):
        previous = own_value
        for value in side if name in packing.SPECTRAL_SCALES else side[-1:]:
            try:
                with warnings.catch_warnings(action="error"):  # another scale would change
                    variant = packing.retouch(texture, n_bytes, unit=unit, **{name: value})
            except (ValueError, UserWarning):
                break
            if name in packing.SPECTRAL_SCALES:
                halfway = packing.scales_halfway(variants[previous], variant)
                expected = own_values | {name: (previous + value) / 2}
                errors = [abs(halfway[scale] - expected[scale]) for scale in halfway if scale in own_values]
                if any(error > MAX_BLEND_ERROR for error in errors):
                    break
            variants[value] = variant
            previous = value
    return dict(sorted(variants.items()))
