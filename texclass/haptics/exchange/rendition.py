"""Play surfaces at one speed and force for other file formats, and convert such files back to textures.

In other formats, the vibration does not depend on the speed or force of a hand. A texture is therefore played
once at a fixed speed and force (a rendition), and the losses are described. A file is converted back as
follows:

| contents | result |
|---|---|
| transients | taps, with a decay estimated from the duration of a transient in the player |
| constant waves | major frequencies |
| any other vibration, over time or distance | an AR model, with the friction of the file |
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from texclass.haptics.textures.contract import Renderer, Serializable, constant_stroke
from texclass.haptics.textures.hatt import HattTexture
from texclass.haptics.textures.oeztuerk2018 import FrequencyTexture
from texclass.haptics.textures.okamura2001 import TapLibrary, tap_peak
from texclass.recording import ACCELERATION_UNITS, Samples
from texclass.validation import check_positive
from texclass.vibration import MajorFrequencies, TapModel, autoregressive, line_spectrum

LONGEST_S = 30.0
"""Longest rendition in s; the longest event that AHAP allows."""
SETTLING_S = 0.5
"""Duration in s that is rendered first and discarded, while motion and filters settle."""
TAP_M_S, TAP_EVERY_S, TAP_FS = 0.1, 0.25, 8000.0
"""Impact velocity of taps in m/s, time between consecutive taps in s, and sampling rate in Hz."""
ORDER = 30
"""Largest order of AR models of played vibrations; the order is also at most a tenth of the sample count."""
MAX_MAGNITUDE = 1e100
"""Largest magnitude of samples that can be converted."""
TRANSIENT_S = 0.022
"""Duration in s of a transient in the MPEG reference software (two cycles of a sine wave)."""
DECAY_PER_S = np.log(100.0) / TRANSIENT_S
"""Decay rate in 1/s that attenuates a tap to 1 % at the end of a transient."""


class Playable(Protocol):
    """Protocol of objects that can be played: textures, and surfaces of planned scenes."""

    @property
    def name(self) -> str:
        """Name of the surface."""

    @property
    def fs(self) -> float:
        """Sampling rate in Hz."""

    @property
    def speeds(self) -> Samples:
        """Increasing speeds in mm/s that bound the range of the model."""

    @property
    def forces(self) -> Samples:
        """Increasing forces in N that bound the range of the model."""

    def renderer(self, *, seed: int = 0) -> Renderer:
        """Return a renderer whose motion starts at rest."""


@dataclass(frozen=True, eq=False)
class Rendition:
    """A surface played at one speed and force.

    Attributes
    ----------
    name : str
        Name of the surface.
    unit : str
        Unit of the samples; m/s^2 if the unit of the texture can be converted to it.
    fs : float
        Sampling rate in Hz.
    samples : ndarray of shape (n_samples,)
        Vibration at `speed` and `force`, or the taps in sequence.
    speed, force : float
        Speed in mm/s and force in N. For taps, `speed` is the impact velocity in mm/s, and `force` is 0.
    lines : ndarray of shape (n_lines, 3)
        Frequency (Hz), amplitude and phase (rad) of the cosines that make up the vibration (default: none).
    taps : ndarray of shape (n_taps, 3)
        Time (s), peak and frequency (Hz) of each tap (default: none).
    friction : float
        Kinetic friction coefficient; 0 if unknown.
    pitch_mm : float
        Distance between samples of spatial textures in mm; 0 for vibrations over time.
    losses : mapping of str to str
        Description of the information that the rendition loses, by topic.

    Examples
    --------
    >>> rendition = Rendition("felt", "m/s^2", 1000.0, np.zeros(100), speed=80.0, force=1.5)
    >>> rendition.caption
    'felt at 80 mm/s, 1.5 N'
    """

    name: str
    unit: str
    fs: float
    samples: Samples
    speed: float
    force: float
    lines: Samples = field(default_factory=lambda: np.zeros((0, 3)))
    taps: Samples = field(default_factory=lambda: np.zeros((0, 3)))
    friction: float = 0.0
    pitch_mm: float = 0.0
    losses: Mapping[str, str] = field(default_factory=dict)

    @property
    def caption(self) -> str:
        """Name, speed and force as text."""
        force_text = f", {self.force:g} N" if self.force else ""
        return f"{self.name or 'surface'} at {self.speed:g} mm/s{force_text}"


def play_texture(
    texture: Playable,
    *,
    unit: str = "m/s^2",
    speed: float | None = None,
    force: float | None = None,
    seconds: float = 2.0,
    seed: int = 0,
) -> Rendition:
    """Play a texture at one speed and force, to write it in another format.

    Parameters
    ----------
    texture : Texture or surface of a planned scene
        Texture to play.
    unit : str
        Unit of the vibration (default "m/s^2"); g and mg are converted to m/s^2.
    speed, force : float, optional
        Speed in mm/s and force in N (default: geometric mean of the range of the texture).
    seconds : float
        Duration in s (default 2), at most `LONGEST_S`. It does not apply to spatial textures, which are
        played once along their line.
    seed : int
        Seed of the noise (default 0).

    Raises
    ------
    ValueError
        If speed, force or duration is not positive, or the duration exceeds `LONGEST_S`.

    Examples
    --------
    >>> from texclass.haptics.textures import pack
    >>> texture = pack(np.random.default_rng(0).standard_normal(2000), n_bytes=32, fs=1000, name="noise")
    >>> rendition = play_texture(texture, seconds=0.5)
    >>> rendition.caption, rendition.samples.size
    ('noise at 100 mm/s, 1 N', 500)
    """
    speed_range, force_range = (
        (float(axis[0]), float(axis[-1])) for axis in (texture.speeds, texture.forces)
    )
    v = float(np.sqrt(np.prod(speed_range))) if speed is None else speed
    f = float(np.sqrt(np.prod(force_range))) if force is None else force
    check_positive(speed=v, force=f, seconds=seconds)
    factor = ACCELERATION_UNITS.get(unit, 1.0)
    length_mm = float(getattr(texture, "length_mm", 0.0))
    if length_mm:
        seconds = length_mm / v
    if seconds > LONGEST_S:
        raise ValueError(f"the duration must be at most {LONGEST_S:g} s, got {seconds:g} s")
    x = factor * _render(texture, v, f, seconds, seed)
    by_speed = _describe_range(texture, x / factor, [(end, f) for end in speed_range], seed)
    by_force = _describe_range(texture, x / factor, [(v, end) for end in force_range], seed)
    losses = {"speed": f"fixed at {v:.4g} mm/s{_range_note(v, speed_range)}; {by_speed}"}
    losses["force"] = f"fixed at {f:.4g} N{_range_note(f, force_range)}; {by_force}"
    if getattr(texture, "tap", None) is not None and texture.tap.n_modes:  # type: ignore[attr-defined]
        losses["taps"] = "omitted: a stroke is played"
    lines = np.zeros((0, 3))
    if isinstance(texture, FrequencyTexture):  # the vibration consists of the major frequencies at this speed
        model = texture.at(v)
        lines = np.column_stack([model.frequency_hz, factor * model.amplitude, model.phase])
        lines = lines[(lines[:, 1] > 0) & (lines[:, 0] < texture.fs / 2)]
        x = factor * np.asarray(model.synthesize(x.size, texture.fs))
    pitch = v / texture.fs if length_mm else 0.0
    mu = float(getattr(texture, "mu", 0.0))
    unit = "m/s^2" if unit in ACCELERATION_UNITS else unit
    return Rendition(
        texture.name, unit, texture.fs, x, v, f, lines, friction=mu, pitch_mm=pitch, losses=losses
    )


def play_taps(taps: TapLibrary, *, velocity: float = TAP_M_S) -> Rendition:
    """Play one tap of each material in a library in sequence, to write the taps in another format.

    Parameters
    ----------
    taps : TapLibrary
        Library to play.
    velocity : float
        Impact velocity in m/s (default 0.1).

    Raises
    ------
    ValueError
        If the velocity is not positive, or the taps of all surfaces together are longer than `LONGEST_S`.

    Examples
    --------
    >>> library = TapLibrary(("wood", "steel"), (TapModel(300.0, 80.0, 155.0), TapModel(800.0, 40.0, 600.0)))
    >>> play_taps(library).taps[:, [0, 2]].tolist()
    [[0.0, 155.0], [0.25, 600.0]]
    """
    check_positive(velocity=velocity)
    n = round(TAP_EVERY_S * TAP_FS)
    if len(taps) * TAP_EVERY_S > LONGEST_S:
        raise ValueError(
            f"the library must contain at most {LONGEST_S / TAP_EVERY_S:g} surfaces, got {len(taps)}"
        )
    factor = ACCELERATION_UNITS.get(taps.unit, 1.0)
    models = taps.models
    x = factor * np.concatenate([model.synthesize(velocity, n, TAP_FS) for model in models])
    peaks = [factor * abs(model.amplitude_slope) * velocity * float(tap_peak(model)) for model in models]
    rows = np.column_stack([np.arange(len(taps)) * TAP_EVERY_S, peaks, [m.frequency_hz for m in models]])
    losses = {
        "speed": f"impacts at {velocity:g} m/s only; the amplitude is proportional to the velocity",
        "order": ", ".join(taps.materials) + f", every {TAP_EVERY_S:g} s",
    }
    unit = "m/s^2" if taps.unit in ACCELERATION_UNITS else taps.unit
    name = taps.materials[0] if len(taps) == 1 else "taps"
    return Rendition(name, unit, TAP_FS, x, 1000 * velocity, 0.0, taps=rows, losses=losses)


def to_texture(rendition: Rendition) -> tuple[Serializable, dict[str, str]]:
    """Fit a texture or a tap library to a rendition; return it with a description of the lost information.

    Parameters
    ----------
    rendition : Rendition
        Result of `texclass.haptics.exchange.hjif_rendition.to_rendition`, for example.

    Raises
    ------
    ValueError
        If the rendition is silent, or too short for a model.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal(2000)
    >>> texture, losses = to_texture(Rendition("noise", "m/s^2", 1000.0, x, speed=80.0, force=1.0))
    >>> texture.family, losses["waveform"]
    ('hatt', 'noise with the same spectrum, an AR model of order 30')
    """
    v, x = rendition.speed, rendition.samples
    losses = {"speed and force": f"the vibration at {v:g} mm/s is used for all speeds and forces"}
    if rendition.taps.size:
        models = []
        for _, peak, hz in rendition.taps.tolist():
            per_peak = float(tap_peak(TapModel(1.0, DECAY_PER_S, hz)))
            models.append(TapModel(peak / (v / 1000) / per_peak, DECAY_PER_S, hz))
        losses = {
            "decay": f"unknown, assumed to be {DECAY_PER_S:.0f} 1/s",
            "names": "the names of the materials",
        }
        names = tuple(f"tap {i + 1}" for i in range(len(models)))
        return TapLibrary(names, tuple(models), rendition.unit), losses
    if rendition.lines.size:
        if rendition.friction:
            losses["friction"] = f"{rendition.friction:g}: textures of major frequencies have no friction"
        lines, speeds = MajorFrequencies(*rendition.lines.T), np.array([v / 2, 2 * v])
        peak = float(lines.amplitude.sum())
        return FrequencyTexture(speeds, (lines, lines), peak, rendition.fs, rendition.name), losses
    order = min(ORDER, x.size // 10)
    if order < 1 or not 0 < np.abs(x).max() < MAX_MAGNITUDE or np.all(x == x[0]):
        raise ValueError(
            f"the rendition must have at least ten samples, which must not be silent or exceed a magnitude "
            f"of {MAX_MAGNITUDE:g}, got {x.size} samples"
        )
    model = autoregressive.fit(x - x.mean(), order)
    lsf = line_spectrum.spread(line_spectrum.from_reflection(model.reflection))
    losses["waveform"] = f"noise with the same spectrum, an AR model of order {order}"
    if rendition.pitch_mm:
        losses["position"] = "the positions of features on the surface"
    power, force = [float(model.gain) ** 2], [rendition.force or 1.0]
    texture = HattTexture.from_models(
        [v], force, lsf[np.newaxis], power, rendition.fs, name=rendition.name, mu=rendition.friction
    )
    return texture, losses


def level_db(x: Samples) -> float:
    """Return the RMS of samples (n,) in dB re 1 unit."""
    return float(20 * np.log10(max(np.sqrt(np.mean(np.square(x))), 1e-300)))


def describe_level_change(output: Samples, reference: Samples) -> str:
    """Describe the level difference in dB between an output (n,) and a reference (m,)."""
    if not np.any(reference):
        return "silence"
    return f"{level_db(output) - level_db(reference):+.2f} dB"


def _range_note(value: float, bounds: tuple[float, float]) -> str:
    """Return a note if a value is outside the range of a texture, else an empty string."""
    is_inside = bounds[0] == bounds[1] or bounds[0] * (1 - 1e-9) <= value <= bounds[1] * (1 + 1e-9)
    return "" if is_inside else f", outside the range of the texture, {bounds[0]:.4g} to {bounds[1]:.4g}"


def _render(texture: Playable, speed: float, force: float, seconds: float, seed: int) -> Samples:
    """Return the vibration (n,) at a constant speed and force, along the direction of the texture."""
    n_settling, n = round(SETTLING_S * texture.fs), max(round(seconds * texture.fs), 1)
    if length_mm := getattr(
        texture, "length_mm", 0.0
    ):  # whole periods, so that the vibration starts at the first feature
        n_settling = round(np.ceil(SETTLING_S * speed / length_mm) * length_mm / speed * texture.fs)
    direction = getattr(texture, "direction", (1.0, 0.0))
    return constant_stroke(texture, speed, force, n, n_settling=n_settling, direction=direction, seed=seed)


def _describe_range(texture: Playable, x: Samples, ends: list[tuple[float, float]], seed: int) -> str:
    """Describe the levels at both ends of a range of speeds or forces, relative to the level of x."""
    if ends[0] == ends[1]:
        return "the texture has only this value"
    length_mm = float(getattr(texture, "length_mm", 0.0))
    renditions = [_render(texture, v, f, length_mm / v if length_mm else 1.0, seed) for v, f in ends]
    change = [level_db(samples) - level_db(x) for samples in renditions]
    axis = 0 if ends[0][0] != ends[1][0] else 1
    (low, high), unit = (end[axis] for end in ends), ("mm/s", "N")[axis]
    return f"{low:.4g} to {high:.4g} {unit} change the level by {change[0]:+.1f} to {change[1]:+.1f} dB"
