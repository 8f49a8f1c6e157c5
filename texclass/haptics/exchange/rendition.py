"""What other devices can be sent of a surface: its vibration at one speed and force, and what else it has.

Formats of other players know neither the speed nor the force of a hand. A texture is played once, at a speed
and a force, and what these would have changed is told beside it. What such a file plays becomes a texture
again, as far as it is one:

| what is played | as a texture |
|---|---|
| transients | taps; their decay is a player's, so that it is taken from how long one is felt |
| waves that stay as they are | the major frequencies |
| any other vibration, over time or over distance | an AR model, with the friction that stands beside it |
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
"""Played at most: the longest event of AHAP."""
SETTLED_S = 0.5
"""Played before it and thrown away, until hand and filters have settled."""
TAP_M_S, TAP_EVERY_S, TAP_FS = 0.1, 0.25, 8000.0
"""Impact velocity of taps, m/s, seconds from one material to the next, and rate, Hz."""
ORDER = 30
"""Of AR models of what was played, at most a tenth of the samples."""
LARGEST = 1e100
"""Samples of that size are no vibration."""
TRANSIENT_S = 0.022
"""How long a transient is felt, two turns of a sine, in the reference software of MPEG."""
DECAY_PER_S = np.log(100.0) / TRANSIENT_S
"""A tap has faded to a hundredth when a transient ends."""


class Playable(Protocol):
    """What has a name, a rate (Hz) and a renderer: a texture, or a surface of a planned scene."""

    @property
    def name(self) -> str:
        """Of the surface."""

    @property
    def fs(self) -> float:
        """Of the vibration, Hz."""

    @property
    def speeds(self) -> Samples:
        """Rising speeds at which it is known, mm/s."""

    @property
    def forces(self) -> Samples:
        """Rising forces at which it is known, N."""

    def renderer(self, *, seed: int = 0) -> Renderer:
        """Return a renderer at rest."""


@dataclass(frozen=True, eq=False)
class Rendition:
    """A surface, played.

    Attributes
    ----------
    name : str
        Of the surface.
    unit : str
        Of the samples: m/s^2 where the texture's unit has a known size.
    fs : float
        Hz.
    samples : ndarray of shape (n_samples,)
        The vibration at `speed` and `force`, or the taps one after another.
    speed, force : float
        mm/s and N; of taps, the impact velocity (mm/s) and 0.
    lines : ndarray of shape (n_lines, 3)
        Frequency (Hz), amplitude and phase (rad) of the cosines that the vibration consists of; none by
        default.
    taps : ndarray of shape (n_taps, 3)
        Time (s), peak and frequency (Hz) of each tap; none by default.
    friction : float
        Coefficient of kinetic friction; 0 where the texture has none.
    pitch_mm : float
        Distance from sample to sample of what repeats along the surface; 0 where only time counts.
    lost : mapping of str to str
        What playing at one speed and force leaves out.
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
    lost: Mapping[str, str] = field(default_factory=dict)

    @property
    def told(self) -> str:
        """Name, speed and force, in words."""
        pressed = f", {self.force:g} N" if self.force else ""
        return f"{self.name or 'surface'} at {self.speed:g} mm/s{pressed}"


def play_texture(
    texture: Playable,
    *,
    unit: str = "m/s^2",
    speed: float | None = None,
    force: float | None = None,
    seconds: float = 2.0,
    seed: int = 0,
) -> Rendition:
    """Play a texture for other formats.

    Parameters
    ----------
    texture : Texture or surface of a planned scene
    unit : str
        Of its vibration; g and mg become m/s^2.
    speed, force : float, optional
        mm/s and N; by default where the texture was scanned, or amid the speeds and forces that it knows
        (their geometric mean).
    seconds : float
        At most `LONGEST_S`. A texture whose features are fixed in space is played once along its line.
    seed : int
        Of its noise.

    Raises
    ------
    ValueError
        If the speed, the force or the duration is not above 0, or it is too long.
    """
    slow_fast, light_hard = ((float(axis[0]), float(axis[-1])) for axis in (texture.speeds, texture.forces))
    v = float(np.sqrt(np.prod(slow_fast))) if speed is None else speed
    f = float(np.sqrt(np.prod(light_hard))) if force is None else force
    check_positive(speed=v, force=f, seconds=seconds)
    factor = ACCELERATION_UNITS.get(unit, 1.0)
    length_mm = float(getattr(texture, "length_mm", 0.0))
    if length_mm:
        seconds = length_mm / v
    if seconds > LONGEST_S:
        raise ValueError(f"{seconds:g} s would be played. Expected at most {LONGEST_S:g}")
    x = factor * _played(texture, v, f, seconds, seed)
    by_speed = _change(texture, x / factor, [(end, f) for end in slow_fast], seed)
    by_force = _change(texture, x / factor, [(v, end) for end in light_hard], seed)
    lost = {"speed": f"fixed at {v:.4g} mm/s{_beyond(v, slow_fast)}; {by_speed}"}
    lost["force"] = f"fixed at {f:.4g} N{_beyond(f, light_hard)}; {by_force}"
    if getattr(texture, "tap", None) is not None and texture.tap.n_modes:  # type: ignore[attr-defined]
        lost["taps"] = "left out: a stroke is played"
    lines = np.zeros((0, 3))
    if isinstance(texture, FrequencyTexture):  # the major frequencies of this speed are all that it plays
        found = texture.at(v)
        lines = np.column_stack([found.frequency_hz, factor * found.amplitude, found.phase])
        lines = lines[(lines[:, 1] > 0) & (lines[:, 0] < texture.fs / 2)]
        x = factor * np.asarray(found.synthesize(x.size, texture.fs))
    pitch = v / texture.fs if length_mm else 0.0
    mu = float(getattr(texture, "mu", 0.0))
    known = "m/s^2" if unit in ACCELERATION_UNITS else unit
    return Rendition(texture.name, known, texture.fs, x, v, f, lines, friction=mu, pitch_mm=pitch, lost=lost)


def play_taps(taps: TapLibrary, *, velocity: float = TAP_M_S) -> Rendition:
    """Play the taps of a library for other formats, its materials one after another.

    Parameters
    ----------
    taps : TapLibrary
    velocity : float
        Of impact, m/s.

    Raises
    ------
    ValueError
        If the velocity is not above 0, or there are so many materials that `LONGEST_S` would be exceeded.
    """
    check_positive(velocity=velocity)
    n = round(TAP_EVERY_S * TAP_FS)
    if len(taps) * TAP_EVERY_S > LONGEST_S:
        raise ValueError(f"there are {len(taps)} materials. Expected at most {LONGEST_S / TAP_EVERY_S:g}")
    factor = ACCELERATION_UNITS.get(taps.unit, 1.0)
    models = taps.models
    x = factor * np.concatenate([model.synthesize(velocity, n, TAP_FS) for model in models])
    peaks = [factor * abs(model.amplitude_slope) * velocity * float(tap_peak(model)) for model in models]
    struck = np.column_stack([np.arange(len(taps)) * TAP_EVERY_S, peaks, [m.frequency_hz for m in models]])
    lost = {
        "speed": f"impacts of {velocity:g} m/s only; the amplitude is proportional to it",
        "order": ", ".join(taps.materials) + f", every {TAP_EVERY_S:g} s",
    }
    known = "m/s^2" if taps.unit in ACCELERATION_UNITS else taps.unit
    name = taps.materials[0] if len(taps) == 1 else "taps"
    return Rendition(name, known, TAP_FS, x, 1000 * velocity, 0.0, taps=struck, lost=lost)


def texture_of(rendition: Rendition) -> tuple[Serializable, dict[str, str]]:
    """Return the texture, or the taps, of what is played, and what is lost.

    Parameters
    ----------
    rendition : Rendition
        What `rendition_of` makes of a file that `read_hjif` read.

    Raises
    ------
    ValueError
        If it is silent, or too short for a model.
    """
    v, x = rendition.speed, rendition.samples
    lost = {"speed and force": f"what was played at {v:g} mm/s stands for all"}
    if rendition.taps.size:
        models = []
        for _, peak, hz in rendition.taps.tolist():
            per_peak = float(tap_peak(TapModel(1.0, DECAY_PER_S, hz)))
            models.append(TapModel(peak / (v / 1000) / per_peak, DECAY_PER_S, hz))
        lost = {"decay": f"unknown, taken for {DECAY_PER_S:.0f} 1/s", "names": "those of the materials"}
        names = tuple(f"tap {i + 1}" for i in range(len(models)))
        return TapLibrary(names, tuple(models), rendition.unit), lost
    if rendition.lines.size:
        if rendition.friction:
            lost["friction"] = f"{rendition.friction:g}: major frequencies have none"
        lines, speeds = MajorFrequencies(*rendition.lines.T), np.array([v / 2, 2 * v])
        peak = float(lines.amplitude.sum())
        return FrequencyTexture(speeds, (lines, lines), peak, rendition.fs, rendition.name), lost
    order = min(ORDER, x.size // 10)
    if order < 1 or not 0 < np.abs(x).max() < LARGEST or np.all(x == x[0]):
        raise ValueError(
            f"{x.size} samples are played. Expected ten at least, not silent, below {LARGEST:g} in size"
        )
    model = autoregressive.fit(x - x.mean(), order)
    lsf = line_spectrum.spread(line_spectrum.from_reflection(model.reflection))
    lost["waveform"] = f"noise of its spectrum, an AR model of order {order}"
    if rendition.pitch_mm:
        lost["place"] = "where on the surface something is felt"
    power, force = [float(model.gain) ** 2], [rendition.force or 1.0]
    texture = HattTexture.from_models(
        [v], force, lsf[np.newaxis], power, rendition.fs, name=rendition.name, mu=rendition.friction
    )
    return texture, lost


def level_db(x: Samples) -> float:
    """Return the RMS of samples (n,) in dB of their unit."""
    return float(20 * np.log10(max(np.sqrt(np.mean(np.square(x))), 1e-300)))


def told_level(sent: Samples, meant: Samples) -> str:
    """Return by how many dB the RMS of what a file plays (n,) differs from what was meant (m,), in words."""
    if not np.any(meant):
        return "silence"
    return f"{level_db(sent) - level_db(meant):+.2f} dB"


def _beyond(value: float, ends: tuple[float, float]) -> str:
    """Return in words that a value lies outside the range of a texture that depends on it, else nothing."""
    is_inside = ends[0] == ends[1] or ends[0] * (1 - 1e-9) <= value <= ends[1] * (1 + 1e-9)
    return "" if is_inside else f", outside the {ends[0]:.4g} to {ends[1]:.4g} that the texture knows"


def _played(texture: Playable, speed: float, force: float, seconds: float, seed: int) -> Samples:
    """Return the vibration (n,) at a constant speed and force, along the texture's direction."""
    before, n = round(SETTLED_S * texture.fs), max(round(seconds * texture.fs), 1)
    if length_mm := getattr(texture, "length_mm", 0.0):  # one whole turn, from its first feature on
        before = round(np.ceil(SETTLED_S * speed / length_mm) * length_mm / speed * texture.fs)
    direction = getattr(texture, "direction", (1.0, 0.0))
    return constant_stroke(texture, speed, force, n, n_settling=before, direction=direction, seed=seed)


def _change(texture: Playable, x: Samples, ends: list[tuple[float, float]], seed: int) -> str:
    """Return in words how the level at the ends of a range, (speed, force) each, differs from that of x."""
    if ends[0] == ends[1]:
        return "the texture knows no other"
    length_mm = float(getattr(texture, "length_mm", 0.0))
    played = [_played(texture, v, f, length_mm / v if length_mm else 1.0, seed) for v, f in ends]
    change = [level_db(one) - level_db(x) for one in played]
    axis = 0 if ends[0][0] != ends[1][0] else 1
    (low, high), unit = (end[axis] for end in ends), ("mm/s", "N")[axis]
    return f"{low:.4g} to {high:.4g} {unit} change the level by {change[0]:+.1f} to {change[1]:+.1f} dB"
