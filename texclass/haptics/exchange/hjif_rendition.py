"""Surfaces as MPEG haptics (.hjif): taps, lines, what repeats along a surface, any other vibration; and back.

All files that are written have 1000 ticks a second: the public reference software takes some durations for
milliseconds whatever the file says.
"""

import base64
import json
import math
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal

from texclass.atomic_write import check_suffix, write_atomic
from texclass.haptics.exchange import wavelet_stream
from texclass.haptics.exchange.hjif import (
    FS,
    HIGHEST_HZ,
    MOST_BANDS,
    TICKS,
    Effect,
    Haptics,
    Perception,
    basis_effects,
    play_hjif,
)
from texclass.haptics.exchange.rendition import Rendition, told_level
from texclass.haptics.textures.contract import NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S
from texclass.recording import UNITS, Samples
from texclass.validation import check_positive

RATE = 8000
"""Samples of wavelet bands in 1000 ticks. Players have 8000 a second and hold a sample until the next one: a
lower rate would be played as steps, with images above half of it."""
BLOCK = 512
"""Samples of a wavelet block, which lasts 64 ticks: a power of two, as players ask for."""
HEADROOM = 1.01
"""Gains over the largest sample: 16-bit players may wrap at 1, which rounded coefficients exceed a little."""
_TOLD = re.compile(r"(.*) at ([\d.]+(?:e[+-]\d\d)?) mm/s(?:, ([\d.]+(?:e[+-]\d\d)?) N)?, (\S+)")
"""How a vibration is described: `Rendition.told`, then the unit."""

Content = dict[str, Any]
"""A part of a file by its keys; `Haptics` checks the whole."""


def write_hjif(
    rendition: Rendition, path: str | Path, *, planes: int = wavelet_stream.PLANES
) -> dict[str, str]:
    """Write a surface as .hjif, and return what is lost.

    Taps become transients; a vibration of a few lines, vectorial waves; what repeats along the surface, a
    vibrotactile texture over distance; all else, wavelet bands. A coefficient of friction stands beside it.

    Parameters
    ----------
    rendition : Rendition
        Of `texclass.haptics.exchange.play_texture` or `play_taps`.
    path : str or Path
        Ends in `.hjif`.
    planes : int
        Bits of the largest wavelet coefficient, 1 to 15.

    Returns
    -------
    dict of str to str
        Speed, force, level, band and what else a player will not know, in words.

    Raises
    ------
    ValueError
        If the path has another ending, or `planes` breaks its rule.
    """
    path = check_suffix(path, ".hjif")
    if not 1 <= planes <= wavelet_stream.MOST_PLANES:
        raise ValueError(f"planes are {planes}. Expected 1 to {wavelet_stream.MOST_PLANES}")
    haptics, lost = made_hjif(rendition, planes)
    write_atomic(path, haptics.model_dump_json(exclude_none=True))
    return lost


def made_hjif(rendition: Rendition, planes: int = wavelet_stream.PLANES) -> tuple[Haptics, dict[str, str]]:
    """Return what `write_hjif` writes, and what is lost."""
    over, lost = bool(rendition.pitch_mm), dict(rendition.lost)
    exponent, rate = -3, rendition.fs
    if over:  # samples in 1000 ticks of 10^exponent m
        rate = 1000 / rendition.pitch_mm
        while rate > RATE and exponent > -6:
            exponent, rate = exponent - 1, rate / 10
    if rendition.taps.size:
        channel = _transients(rendition.taps)
        lost["waveform"] = "a player's own: of a tap, time, peak and frequency are kept, not its decay"
    elif rendition.lines.size:
        channel = _oscillators(rendition)
        lost["lines"] = f"{len(channel['bands'])} of {len(rendition.lines)}, frequencies in whole Hz"
    else:
        channel = _wavelets(rendition.samples, rate, planes)
        top, own, unit = float(RATE), rendition.fs, "Hz"
        if over:
            top, own, unit = top / 10.0 ** (3 + exponent + 3), 1 / rendition.pitch_mm, "/mm"
        lost["band"] = f"0 to {min(top, own) / 2:g} {unit} of 0 to {own / 2:g} {unit}"
    if over:
        lost["speed"] = f"how a feature rings: as at {rendition.speed:.4g} mm/s, drawn out with distance"
    if rendition.unit != "m/s^2":
        lost["unit"] = f"{rendition.unit}: its level in m/s^2 is unknown"
    modality = "Vibrotactile Texture" if over else "Vibrotactile"
    felt = _perception(0, modality, rendition.told, channel)
    felt |= {"description": f"{rendition.told}, {rendition.unit}", "unit_exponent": exponent}
    mu = rendition.friction
    rubbed = [_perception(1, "Friction", "coefficient of kinetic friction", _constant(mu))] if mu else []
    content = {
        "version": "2023",
        "profile": "Main",
        "level": 1 if len(channel["bands"]) <= MOST_BANDS[1] else 2,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "description": rendition.name or "surface",
        "timescale": TICKS,
        "avatars": [{"id": 1, "lod": 0, "type": "Vibration"}],
        "perceptions": [felt, *rubbed],
        "syncs": [],
    }
    found = Haptics.model_validate_json(json.dumps(content))
    lost["level"] = "the peak of each tap is kept"
    if not rendition.taps.size:
        lost["level"] = told_level(play_hjif(found)[:, 0], rendition.samples)
    return found, lost


def _transients(taps: Samples) -> Content:
    """Return a channel of transients for taps (n, 3): time (s), peak and frequency (Hz)."""
    gain = HEADROOM * float(taps[:, 1].max())
    effects = [
        _effect(round(TICKS * at), keyframes=[_keyframe(0, peak / gain, frequency)])
        for at, peak, frequency in taps.tolist()
    ]
    return {"gain": gain, "bands": [_band("Transient", _limits(taps[:, 2]), effects)]}


def _oscillators(rendition: Rendition) -> Content:
    """Return a channel with a band for each of the strongest lines."""
    strongest = np.argsort(-rendition.lines[:, 1], kind="stable")[: MOST_BANDS[2]]
    lines = rendition.lines[np.sort(strongest)]
    gain = HEADROOM * float(lines[:, 1].sum())  # so that they never add up to more than 1
    end = max(round(TICKS * rendition.samples.size / rendition.fs), 1)
    bands = []
    for frequency, amplitude, phase in lines.tolist():
        # players begin a sine; a cosine is a quarter of a turn ahead
        turn = min((phase + math.pi / 2) % (2 * math.pi), 6.28318)
        frames = [_keyframe(at, amplitude / gain, frequency) for at in (0, end)]
        effect = _effect(0, phase=turn, base_signal="Sine", keyframes=frames)
        bands.append(_band("VectorialWave", _limits(np.array([frequency])), [effect]))
    return {"gain": gain, "bands": bands}


def _wavelets(x: Samples, rate: float, planes: int) -> Content:
    """Return the channel of samples (n,) of a rate (in 1000 ticks), with their rate and number."""
    own = max(min(round(rate), RATE), 1)
    count = max(round(x.size * own / rate), 1)
    x = signal.resample(x, max(round(x.size * RATE / rate), 1))  # by its spectrum: nothing above rate / 2
    blocks = np.pad(x, (0, -x.size % BLOCK)).reshape(-1, BLOCK)
    coefficients = np.array([wavelet_stream.transform(block) for block in blocks])
    largest = float(np.abs(coefficients).max()) / wavelet_stream.LARGEST
    gain = HEADROOM * max(float(np.abs(x).max()), largest) or 1.0
    length = BLOCK * TICKS // RATE
    streams = [base64.b64encode(wavelet_stream.encode(one / gain, planes)).decode() for one in coefficients]
    # players take a final = for further bits
    effects = [_effect(i * length, wavelet_stream=stream.rstrip("=")) for i, stream in enumerate(streams)]
    band = _band("WaveletWave", (0, RATE), effects) | {"block_length": length}
    return {"gain": gain, "bands": [band], "frequency_sampling": own, "sample_count": count}


def _constant(value: float) -> Content:
    """Return a channel that holds a number above 0."""
    gain = max(value, 1.0)
    frames = [{"relative_position": at, "amplitude_modulation": value / gain} for at in (0, TICKS)]
    band = _band("Curve", (0, 0), [_effect(0, keyframes=frames)]) | {"curve_type": "Linear"}
    return {"gain": gain, "bands": [band]}


def _keyframe(at: int, amplitude: float, frequency: float) -> Content:
    whole = min(round(frequency), int(HIGHEST_HZ))
    return {"relative_position": at, "amplitude_modulation": amplitude, "frequency_modulation": whole}


def _effect(at: int, **more: Any) -> Content:
    return {"effect_type": "Basis", "position": at, **more}


def _limits(frequency_hz: Samples) -> tuple[int, int]:
    """Return whole frequencies around some, Hz."""
    return max(int(frequency_hz.min()) - 1, 0), min(int(frequency_hz.max()) + 2, int(HIGHEST_HZ))


def _band(kind: str, limits: tuple[int, int], effects: list[Content]) -> Content:
    low, high = limits
    return {
        "band_type": kind, "lower_frequency_limit": low, "upper_frequency_limit": high, "effects": effects
    }  # fmt: skip


def _perception(i: int, modality: str, description: str, channel: Content) -> Content:
    """Return a perception of one channel, which bears its description."""
    only = {"id": 0, "description": description, "mixing_coefficient": 1.0, "body_part_mask": 0} | channel
    return {
        "id": i, "perception_modality": modality, "description": description, "avatar_id": 1,
        "effect_library": [], "channels": [only],
    }  # fmt: skip


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
        raise ValueError("it holds no vibration. Expected a Vibrotactile perception")
    channel = felt[0].channels[0]
    told = _TOLD.fullmatch(felt[0].description)
    name, speed, force, unit = haptics.description, NOMINAL_SPEED_MM_S, NOMINAL_FORCE_N, "arbitrary"
    if told and told[4] in UNITS:
        name, speed, force, unit = told[1], float(told[2]), float(told[3] or 0), told[4]
    check_positive(speed=speed)
    kinds = {band.band_type for band in channel.bands}
    effects = [(at, effect) for at, effect, _ in basis_effects(channel, felt[0])]
    gain = 10.0 ** felt[0].perception_unit_exponent * channel.gain
    taps = _taps(effects if kinds == {"Transient"} else [], gain, haptics.timescale)
    lines = _lines(effects if kinds == {"VectorialWave"} else [], gain)
    fs = float(max(channel.bands[0].upper_frequency_limit, 40)) if kinds == {"WaveletWave"} else FS
    if kinds == {"WaveletWave"} and 40 <= (own := channel.frequency_sampling or 0) < fs:
        fs = float(own)  # nothing was coded above half of the channel's own rate
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
