"""What was made to be played, as a texture again: .hjif and .gltf, where they hold enough of one.

| in the file | as a texture |
|---|---|
| transients | taps; their decay is a player's, so that it is taken from how long one is felt |
| vectorial waves that stay as they are | the major frequencies |
| any other vibration, over time or over distance | an AR model, with the friction that stands beside it |

A file knows one speed and one force: the texture feels the same at all of them.
"""

import re

import numpy as np

from texclass.exchange.hjif import FS, TRANSIENT_S, Effect, Haptics, Perception, basis_effects, play_hjif
from texclass.exchange.rendition import Rendition
from texclass.recording import UNITS, Samples
from texclass.textures.contract import Stored
from texclass.textures.hatt import HattTexture
from texclass.textures.oeztuerk2018 import FrequencyTexture
from texclass.textures.okamura2001 import TapLibrary, tap_peak
from texclass.validation import check_above_0
from texclass.vibration import MajorFrequencies, TapModel, autoregressive, line_spectrum

ORDER = 30
"""Of AR models, at most a tenth of the samples."""
LARGEST = 1e100
DECAY_PER_S = np.log(100.0) / TRANSIENT_S
"""A tap has faded to a hundredth when a transient ends."""
USUAL = 100.0, 1.0, "arbitrary"
"""mm/s, N and unit of files that do not say them as ours do."""
_TOLD = re.compile(r"(.*) at ([\d.]+(?:e[+-]\d\d)?) mm/s(?:, ([\d.]+(?:e[+-]\d\d)?) N)?, (\S+)")


def texture_of(rendition: Rendition) -> tuple[Stored, dict[str, str]]:
    """Return the texture, or the taps, of what is played, and what is lost.

    Parameters
    ----------
    rendition : Rendition
        Of `read_gltf`, or `rendition_of` what `read_hjif` returns.

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
    if rendition.friction and rendition.lines.size:
        lost["friction"] = f"{rendition.friction:g}: major frequencies have none"
    if rendition.lines.size:
        lines, speeds = MajorFrequencies(*rendition.lines.T), np.array([v / 2, 2 * v])
        peak = float(lines.amplitude.sum())
        return FrequencyTexture(speeds, (lines, lines), peak, rendition.fs, rendition.name), lost
    order = min(ORDER, x.size // 10)
    if order < 1 or not 0 < np.abs(x).max() < LARGEST or np.all(x == x[0]):
        raise ValueError(
            f"{x.size} samples are played; the rule is ten at least, not silent, below {LARGEST:g} in size"
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


def rendition_of(haptics: Haptics) -> Rendition:
    """Return the first vibration of a .hjif file as it is played, with what of it is known beyond samples.

    Raises
    ------
    ValueError
        If there is none, or as `play_hjif`.
    """
    felt = [one for one in haptics.perceptions if one.perception_modality.startswith("Vibrotactile")]
    rough = [one for one in haptics.perceptions if one.perception_modality == "Friction"][:1]
    if not felt:
        raise ValueError("it holds no vibration; the rule is a Vibrotactile perception")
    channel = felt[0].channels[0]
    told = _TOLD.fullmatch(felt[0].description)
    name, (speed, force, unit) = haptics.description, USUAL
    if told and told[4] in UNITS:
        name, speed, force, unit = told[1], float(told[2]), float(told[3] or 0), told[4]
    check_above_0(speed=speed)
    kinds = {band.band_type for band in channel.bands}
    effects = [one for band in channel.bands for one in basis_effects(band.effects, felt[0].library)]
    gain = 10.0 ** felt[0].perception_unit_exponent * channel.gain
    taps = _taps(effects if kinds == {"Transient"} else [], gain, haptics.timescale)
    lines = _lines(effects if kinds == {"VectorialWave"} else [], gain)
    fs = float(max(channel.bands[0].upper_frequency_limit, 40)) if kinds == {"WaveletWave"} else FS
    x = play_hjif(_only(haptics, felt[0]), fs)[:, 0]
    mu = [float(np.median(play_hjif(_only(haptics, one), 100.0)[:, 0])) for one in rough]
    pitch = 0.0
    if felt[0].perception_modality == "Vibrotactile Texture":  # 1000 ticks are so many mm
        pitch = 10.0 ** (felt[0].unit_exponent + 6) / fs
        fs = speed / pitch
    return Rendition(name, unit, fs, x, speed, force, lines, taps, max([0.0, *mu]), pitch)


def _only(haptics: Haptics, perception: Perception) -> Haptics:
    return haptics.model_copy(update={"perceptions": (perception,)})


def _taps(effects: list[tuple[int, Effect]], gain: float, timescale: int) -> Samples:
    """Return time (s), peak and frequency (Hz) of each transient, (n, 3)."""
    found = [
        ((at + (frame.relative_position or 0)) / timescale, gain * abs(frame.amplitude_modulation or 0), hz)
        for at, effect in effects
        for frame in effect.keyframes
        if (hz := frame.frequency_modulation or 0)
    ]
    return np.array(found, dtype=np.float64).reshape(-1, 3)


def _lines(effects: list[tuple[int, Effect]], gain: float) -> Samples:
    """Return frequency (Hz), amplitude and phase of cosines, (n, 3); none if one of the waves changes."""
    found = []
    for at, effect in effects:
        levels = {frame.amplitude_modulation for frame in effect.keyframes} - {None}
        tones = {frame.frequency_modulation for frame in effect.keyframes} - {None}
        if at or effect.base_signal != "Sine" or len(levels) != 1 or len(tones) != 1:
            return np.zeros((0, 3))
        level, hz = levels.pop() or 0.0, tones.pop() or 0
        turn = effect.phase - np.pi / 2 + (np.pi if level < 0 else 0)
        found += [(hz, gain * abs(level), turn)] * (0 < hz < FS / 2)
    return np.array(found, dtype=np.float64).reshape(-1, 3)
